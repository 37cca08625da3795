"""Convergence checks of draws, and the comparison of two sampling methods on one posterior.

Comparison: mean, standard deviation and the 5, 50 and 95 % quantiles of each parameter are compared over the Monte
Carlo standard errors of both. With q parameters that makes 5 q comparisons, and the familywise error rate is 0.001:
each is tested at the level 0.001 / (5 q) (Bonferroni). Differences below a fiftieth of a standard deviation are
negligible and never count as a disagreement, however many draws could resolve them.

Source of the errors: Vehtari et al. 2021, Bayesian Analysis 16, 667, section 4 (effective draws of a quantile are those
of the share below it); of a standard deviation: the delta method on squared deviations.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from ...core.arrays import Array, Flags
from ...core.display import Displayable
from .diagnostics import PIECES, Diagnostics, ess_mean
from .psis_loo import K_HAT

ESS = 400.0  # Vehtari et al. 2021, doi:10.1214/20-BA1221, sec. 4.1: 100 for each of four chains
R_HAT = 1.01  # the same section
TIMES = 50.0  # autocorrelation times in a chain: documentation of emcee, "Autocorrelation analysis & convergence"


@dataclass(frozen=True, slots=True, repr=False)
class ConvergenceChecks(Displayable):
    """Result of the convergence checks of draws.

    Attributes
    ----------
    passed : bool
        Draws that did not pass are not written to a parameter file.
    reasons : tuple of str
        One sentence for each failed check: value, limit, remedy. Empty where all passed.
    """

    passed: bool
    reasons: tuple[str, ...] = ()


def check_convergence(
    diagnostics: Diagnostics, agreement: "Agreement | None" = None, interrupted: bool = False
) -> ConvergenceChecks:
    """Convergence checks of draws.

    They fail below 400 effective draws in bulk, in the tails or of the sampling method, above R-hat 1.01, above
    k-hat 0.7, for chains shorter than 50 autocorrelation times, for methods that disagree, and where the run was
    interrupted. Values that are not finite fail.

    Parameters
    ----------
    diagnostics : Diagnostics
    agreement : Agreement, optional
        With an independent run.
    interrupted : bool

    Examples
    --------
    >>> from fitmodels.fit.bayes.diagnostics import diagnose
    >>> from fitmodels.fit.bayes.density import Sample
    >>> draws = np.random.default_rng(1).normal(size=(4000, 2))
    >>> check_convergence(diagnose(("V", "f"), draws, Sample(draws, 1, "exact", "drawn independently")))
    ConvergenceChecks: convergence checks passed
    >>> poor = Sample(draws, 1, "importance", "reweighted", k_hat=0.83)
    >>> check_convergence(diagnose(("V", "f"), draws, poor)).reasons[0][:46]
    'k-hat 0.83 of the importance weights is above '
    """
    reasons = (
        *diagnostics.notes,
        *_effective(diagnostics),
        *_chains_agree(diagnostics),
        *_weights(diagnostics.k_hat),
        *_long_enough(diagnostics),
        *(() if agreement is None or agreement.agrees else (agreement.words.rstrip(".") + ".",)),
        *(("the run was interrupted: run it again to its end.",) if interrupted else ()),
    )
    return ConvergenceChecks(not reasons, reasons)


def _effective(found: Diagnostics) -> list[str]:
    """Effective draws of parameters in bulk and tails, and of the sampling method."""
    S, reasons = found.chains * found.length, []
    for where, ess in (("in bulk", found.ess_bulk), ("in the tails", found.ess_tail)):
        low = ~(ess >= ESS) & _assessed(found)
        if low.any():
            j = int(np.argmin(np.where(low, np.nan_to_num(ess, nan=-1.0), np.inf)))
            of = _with_others(found.names[j], low)
            reasons.append(f"{of}: {ess[j]:.0f} effective draws {where}, below {ESS:.0f}: {_longer(S, ess[j])}.")
    route = found.ess_route
    if route is not None and not route >= ESS:
        reasons.append(
            f"{route:.0f} of {S} draws are effective by their weights, below {ESS:.0f}: {_longer(S, route)}."
        )
    return reasons


def _chains_agree(found: Diagnostics) -> list[str]:
    """R-hat of all parameters."""
    high = ~(found.r_hat <= R_HAT) & _assessed(found)
    if not high.any():
        return []
    j = int(np.argmax(np.where(high, np.nan_to_num(found.r_hat, nan=np.inf, posinf=np.inf), -np.inf)))
    return [
        f"{_with_others(found.names[j], high)}: R-hat {found.r_hat[j]:.3f} is above {R_HAT:g}: the chains differ; run "
        "twice the draws or more; if they still differ, give informative --priors for it, or leave its term out."
    ]


def _weights(k_hat: float | None) -> list[str]:
    if k_hat is None or k_hat <= K_HAT:
        return []
    return [
        f"k-hat {k_hat:.2f} of the importance weights is above {K_HAT:g}: a few draws have most of the weight; "
        'use MCMC, method="emcee".'
    ]


def _long_enough(found: Diagnostics) -> list[str]:
    """Length of chains in autocorrelation times, with a tolerance of one draw lost by thinning."""
    if found.tau is None or (found.length + 1 >= TIMES * found.tau).all():
        return []
    j = int(np.argmax(np.nan_to_num(found.tau, nan=np.inf, posinf=np.inf)))
    slowest = f" of {found.names[j]}" if len(found.tau) == len(found.names) else ""
    if not np.isfinite(found.tau[j]):
        return [
            f"the autocorrelation time{slowest} is infinite: a walker accepted no proposal; run longer, "
            "with another seed."
        ]
    return [
        f"chains of {found.length} draws hold {found.length / found.tau[j]:.0f} autocorrelation times{slowest}, fewer "
        f"than {TIMES:.0f}: run longer: {ceil(TIMES * found.tau[j])} draws a chain."
    ]


def _assessed(found: Diagnostics) -> Flags:
    """Parameters whose draws could be assessed: the notes name the others."""
    return np.isfinite(found.r_hat) if found.notes else np.ones(len(found.names), bool)


def _with_others(name: str, bad: Flags) -> str:
    more = int(bad.sum()) - 1
    return name + (f" (and {more} more)" if more else "")


def _longer(S: int, ess: float) -> str:
    """Remedy for too few effective draws, with a margin of a tenth."""
    if not ess >= 1:
        return "run longer, ten times the draws or more"
    need = 1.1 * S * ESS / ess
    unit = 10 ** max(len(str(int(need))) - 2, 0)
    return f"run longer: {ceil(need / unit) * unit} draws instead of {S}"


LEVEL = 1e-3  # chance of a false alarm in a whole comparison; of chains 2 or 3 times that, as errors are estimates
FLOOR = 0.02  # standard deviations
QUANTILES = (0.05, 0.5, 0.95)
FIGURES = ("mean", "standard deviation", *(f"{100 * share:g} % quantile" for share in QUANTILES))


@dataclass(frozen=True, slots=True, repr=False)
class Agreement(Displayable):
    """Comparison of the draws of two sampling methods.

    Attributes
    ----------
    agrees : bool
        False where a method has not explored the whole posterior, or two densities differ. Remedy: more draws by MCMC,
        another seed; if it persists, another model.
    name, figure : str
        The parameter and its statistic in which the methods differ most, relative to the limit.
    difference : float
        Of that statistic, second method less first, in standard deviations of the parameter.
    allowed : float
        Its limit, in the same unit.
    errors : float
        The same difference in Monte Carlo standard errors.
    words : str
        The comparison in one sentence.
    """

    agrees: bool
    name: str
    figure: str
    difference: float
    allowed: float
    errors: float
    words: str


def compare_draws(
    a: tuple[Array, int], b: tuple[Array, int], names: tuple[str, ...], interrupted: bool = False
) -> Agreement:
    """Compare two sets of draws.

    Parameters
    ----------
    a, b : tuple of ndarray, shape (S, q), and int
        Draws of the parameters, chain after chain, and of how many chains; 1 where draws are independent. Copies of a
        weighted draw must be adjacent, so that the autocorrelation accounts for them.
    names : tuple of str
        Of the q parameters.
    interrupted : bool
        Whether one of the runs was interrupted: then the result is never an agreement.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> found = compare_draws((rng.normal(size=(4000, 2)), 1), (rng.normal(size=(4000, 2)), 4), ("V", "f"))
    >>> found.agrees
    True
    """
    from scipy.special import ndtri

    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        difference, errors, sd = _compared(a, b)
        by = difference / sd
        ratio = np.minimum(errors / -float(ndtri(LEVEL / 2 / errors.size)), np.abs(by) / FLOOR)
        may = np.abs(by) / ratio
    known = np.isfinite(ratio)  # false where draws are constant or not finite
    ratio[~known] = np.inf
    at = np.unravel_index(int(ratio.argmax()), ratio.shape)
    agrees = bool(ratio[at] <= 1) and not interrupted
    figure, name = FIGURES[at[0]], names[at[1]]
    gap = float(by[at]), float(may[at] if ratio[at] > 0 else FLOOR)
    words = _words(agrees, interrupted, bool(known[at]), name, figure, *gap)
    return Agreement(agrees, name, figure, *gap, float(errors[at]), words)


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
    """Monte Carlo standard error of the mean of each column; NaN where it is constant."""
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
        return f"the two methods cannot be compared: draws of {name} are constant or not finite; run more draws"
    most = f"the {figure} of {name} differs most, by {abs(difference):.2g} standard deviations ({allowed:.2g} allowed)"
    if interrupted:
        return f"the comparison of the two methods is incomplete, as one was interrupted: so far {most}"
    if agrees:
        return f"the two methods agree within Monte Carlo error: {most}"
    return f"the two methods disagree: {most}; run more draws, and revise the model if it persists"
