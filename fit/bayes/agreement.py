"""Whether two routes to the same posterior agree, as far as so many draws can tell.

Mean, standard deviation and the 5, 50 and 95 % quantiles of each parameter are compared over the Monte Carlo
standard errors of both. With q parameters that makes 5 q comparisons, and routes that do agree are to be accused once
in a thousand runs: each is held to the level 0.001 / (5 q) (Bonferroni). Differences below a fiftieth of a standard
deviation matter to nobody and are never called a disagreement, however many draws could show them.

Source of the errors: Vehtari et al. 2021, Bayesian Analysis 16, 667, section 4 (effective draws of a quantile are those
of the share below it); of a standard deviation: the delta method on squared deviations.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from .diagnostics import PIECES, ess_mean

Array = NDArray[np.float64]

LEVEL = 1e-3  # chance of a false alarm in a whole comparison; of chains 2 or 3 times that, as errors are estimates
FLOOR = 0.02  # standard deviations
QUANTILES = (0.05, 0.5, 0.95)
FIGURES = ("mean", "standard deviation", *(f"{100 * share:g} % quantile" for share in QUANTILES))


@dataclass(frozen=True, slots=True, repr=False)
class Agreement(Displayable):
    """What a comparison of two routes came to.

    Attributes
    ----------
    agrees : bool
        Causes of no: a route that has not found the whole posterior, or two densities that are not the same. Cure:
        more draws by chains, another seed; if it stays, the model.
    name, figure : str
        The parameter and the figure of it in which the routes differ most, for what was allowed.
    difference : float
        Of that figure, second route less first, in standard deviations of the parameter.
    allowed : float
        How far it might be from zero, in the same unit.
    errors : float
        The same difference in Monte Carlo standard errors.
    words : str
        All this in one sentence.
    """

    agrees: bool
    name: str
    figure: str
    difference: float
    allowed: float
    errors: float
    words: str


def agree(a: tuple[Array, int], b: tuple[Array, int], names: tuple[str, ...], interrupted: bool = False) -> Agreement:
    """Compare two sets of draws.

    Parameters
    ----------
    a, b : tuple of ndarray, shape (S, q), and int
        Draws of the parameters, chain after chain, and of how many chains; 1 where draws are independent. Copies of a
        weighted draw count for what they are as long as they stand side by side.
    names : tuple of str
        Of the q parameters.
    interrupted : bool
        Whether one of the routes was stopped: then nothing is verified, whatever the draws say.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> told = agree((rng.normal(size=(4000, 2)), 1), (rng.normal(size=(4000, 2)), 4), ("V", "f"))
    >>> told.agrees
    True
    """
    from scipy.special import ndtri

    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        difference, errors, sd = _compared(a, b)
        by = difference / sd
        ratio = np.minimum(errors / -float(ndtri(LEVEL / 2 / errors.size)), np.abs(by) / FLOOR)
        may = np.abs(by) / ratio
    known = np.isfinite(ratio)  # not so where draws stand still or are no numbers
    ratio[~known] = np.inf
    at = np.unravel_index(int(ratio.argmax()), ratio.shape)
    agrees = bool(ratio[at] <= 1) and not interrupted
    figure, name = FIGURES[at[0]], names[at[1]]
    told = float(by[at]), float(may[at] if ratio[at] > 0 else FLOOR)
    words = _words(agrees, interrupted, bool(known[at]), name, figure, *told)
    return Agreement(agrees, name, figure, *told, float(errors[at]), words)


def _compared(a: tuple[Array, int], b: tuple[Array, int]) -> tuple[Array, Array, Array]:
    """Differences of figures, b less a, the same in Monte Carlo errors, (5, q), and the sd of each parameter, (q,).

    Quantiles are compared by the share of draws below a point halfway between the two: the error of a share needs no
    density, that of a quantile needs the density where draws are few.
    """
    one, two = (draws[: len(draws) // _pieces(chains) * _pieces(chains)] for draws, chains in (a, b))
    pieces = _pieces(a[1]), _pieces(b[1])
    (mean_a, sd_a), (mean_b, sd_b) = ((x.mean(axis=0), x.std(axis=0, ddof=1)) for x in (one, two))
    squares = [
        _error((x - x.mean(axis=0)) ** 2, n) / (2 * x.std(axis=0)) for x, n in zip((one, two), pieces, strict=True)
    ]
    differences = [mean_b - mean_a, sd_b - sd_a]
    errors = [
        np.abs(differences[0]) / np.hypot(_error(one, pieces[0]), _error(two, pieces[1])),
        np.abs(differences[1]) / np.hypot(*squares),
    ]
    for share, low, high in zip(QUANTILES, *(np.quantile(x, QUANTILES, axis=0) for x in (one, two)), strict=True):
        below = [_share(x, (low + high) / 2, share, n) for x, n in zip((one, two), pieces, strict=True)]
        differences.append(high - low)
        errors.append(np.abs(below[0][0] - below[1][0]) / np.hypot(below[0][1], below[1][1]))
    return np.array(differences), np.array(errors), np.sqrt((sd_a**2 + sd_b**2) / 2)


def _pieces(chains: int) -> int:
    return PIECES if chains == 1 else chains


def _error(x: Array, pieces: int) -> Array:
    """Monte Carlo standard error of the mean of each column; no number where it stands still."""
    effective = ess_mean(x.reshape(pieces, -1, x.shape[1]))
    return np.asarray(x.std(axis=0, ddof=1) / np.sqrt(np.where(effective > 0, effective, np.nan)))


def _share(x: Array, point: Array, share: float, pieces: int) -> tuple[Array, Array]:
    """Share of draws below a point, and its Monte Carlo error where it should be ``share``."""
    below = (x <= point).astype(float)
    effective = ess_mean(below.reshape(pieces, -1, x.shape[1]))
    where_all_or_none = ess_mean(x.reshape(pieces, -1, x.shape[1]))
    effective = np.where(effective > 0, effective, np.where(where_all_or_none > 0, where_all_or_none, np.nan))
    return below.mean(axis=0), np.sqrt(share * (1 - share) / effective)


def _words(
    agrees: bool, interrupted: bool, known: bool, name: str, figure: str, difference: float, allowed: float
) -> str:
    if not known:
        return f"the two routes cannot be compared: draws of {name} stand still or are no numbers; run more draws"
    most = f"the {figure} of {name} differs most, by {abs(difference):.2g} standard deviations ({allowed:.2g} allowed)"
    if interrupted:
        return f"the two routes were not compared to the end, because one was interrupted: so far {most}"
    if agrees:
        return f"the two routes agree within Monte Carlo error: {most}"
    return f"the two routes disagree: {most}; run more draws, and distrust the model if it stays so"
