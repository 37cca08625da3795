"""Scale of the response: Box-Cox transform, and multiplicative against additive errors by their likelihood.

Box-Cox: ``z(lambda) = (y^lambda - 1) / (lambda g^(lambda - 1))`` with g the geometric mean of y; the residual sum of
squares of z on the law's terms is a likelihood. 0 is the logarithm, on which a power law is linear; 1 is the response
itself. Where edges have several rows, each has a random level, with the variance split of the law.

Error structure: R2 of the two fits is on different scales and cannot be compared. Densities can: the log fit gives
``y`` the density of ``ln y`` divided by ``y``, so its log-likelihood carries the Jacobian ``- sum ln y``. Both fits
have the same number of parameters, so the difference of AIC is minus twice that of the log-likelihoods.

Sources: Box & Cox 1964, J. Royal Statistical Society B 26, 211; Xiao et al. 2011, Ecology 92, 1887 (power laws);
Vuong 1989, Econometrica 57, 307 (standard error of the difference, here summed by edge).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.display import Displayable, Plottable
from ..available import NotAvailable
from ..lawfit import LawFit
from ..laws import Error
from .check import concern_of, p_in_words
from .strata import Array, Strata, has_repeated_edges, linear_columns, no_scatter, orthonormal, units_of, without_levels

Profile = Callable[[Array], Array]

DROP = 1.920729410347062  # half the .95 quantile of chi-squared on one degree of freedom
WIDEST = 10.0  # powers beyond it are no transformation anybody would use
STEPS = 12  # parts of one zoom: the top lies in two of them, an end in one
ZOOMS = 6


@dataclass(frozen=True, slots=True, repr=False)
class BoxCox(Displayable):
    """Power of the response that the rows ask for.

    Attributes
    ----------
    power : float
        Lambda of the largest profile likelihood.
    low, high : float
        Its 95 % profile-likelihood interval.
    of_law : float
        The power that the law has: 0 for logarithms, 1 for a line.
    statistic : float
        Twice the log-likelihood between ``power`` and ``of_law``, chi-squared on ``df``.
    pvalue : float
    """

    power: float
    low: float
    high: float
    of_law: float
    statistic: float
    pvalue: float

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return f"the response to the power {self.of_law:g}{' (its logarithm)' if self.of_law == 0 else ''} fits best"

    @property
    def df(self) -> int:
        """One: the power."""
        return 1

    @property
    def concern(self) -> int:
        """0 fine, 1 the interval leaves the law's power out, 2 it does so by far (p below .001)."""
        return concern_of(self.pvalue)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"Box-Cox power {_power(self.power)} ({_power(self.low)} to {_power(self.high)})"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        found = f"Box-Cox power {_power(self.power)}, 95 % {_power(self.low)} to {_power(self.high)}"
        own = "logarithms" if self.of_law == 0 else "natural units"
        if not self.concern:
            return f"The response asks for no other scale than {own} ({found})."
        if self.low <= 1 - self.of_law <= self.high:
            other = "natural units" if self.of_law == 0 else "logarithms"
            return f"The response asks for {other} rather than {own} ({found}): compare the other error structure."
        side = "weaker" if self.power > self.of_law else "stronger"
        return (
            f"The response asks for a {side} curve than {own} ({found}, {p_in_words(self.pvalue)}): a factor's effect "
            "bends or the scatter is uneven; compare rival forms."
        )


def box_cox(law: LawFit, strata: Strata | NotAvailable) -> BoxCox | NotAvailable:
    """Profile likelihood of the power of the response, rows above zero only.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t"])
    >>> found = box_cox(law, split(law))
    >>> found.low < 0 < found.high
    True
    """
    from scipy.special import chdtrc

    if reason := no_scatter(law):
        return NotAvailable(reason)
    if law.law.logarithmic and law.error == "additive":
        return NotAvailable(
            "the law is fitted in natural units, where it is no straight line: Box-Cox is asked of its logarithm"
        )
    if not (law.observed > 0).all():
        return NotAvailable(f"{law.response} is not above zero in every row, and a power of it needs that")
    if has_repeated_edges(law) and not isinstance(strata, Strata):
        return strata
    of_law = 0.0 if law.law.logarithmic else 1.0
    profile = profile_of(law, strata)
    found = _interval(profile)
    if found is None:
        return NotAvailable(
            f"{law.response} changes by a factor of {law.observed.max() / law.observed.min():.2g} only: rows cannot "
            "tell one power of it from another"
        )
    best, low, high = found
    top, own = profile(np.array([best, of_law]))
    statistic = max(0.0, 2 * float(top - own))
    return BoxCox(best, low, high, of_law, statistic, float(chdtrc(1, statistic)))


def profile_of(law: LawFit, strata: Strata | NotAvailable) -> Profile:
    """Profile log-likelihood of powers, but for a constant: a function of an array of lambdas, shape (k,)."""
    columns = linear_columns(law)[0]
    log_y = np.log(law.observed)
    residue = _edge_residue(strata) if isinstance(strata, Strata) else _row_residue(columns)

    def profile(powers: ArrayLike) -> Array:
        rss = residue(transformed(log_y, np.atleast_1d(np.asarray(powers, dtype=float))))
        return np.asarray(-law.nobs / 2 * np.log(rss / law.nobs) - log_y.sum())

    return profile


def transformed(log_y: Array, powers: Array) -> Array:
    """``z(lambda)`` over the geometric mean, shape (n, k), from ln y; exact through lambda = 0.

    Examples
    --------
    >>> transformed(np.log([1.0, 4.0]), np.array([1.0])).round(3).tolist()
    [[-0.5], [1.0]]
    """
    about = (log_y - log_y.mean())[:, None]
    flat = np.abs(powers) < 1e-12
    safe = np.where(flat, 1.0, powers)
    return np.asarray(np.where(flat, about, np.expm1(safe * about) / safe))


def _row_residue(columns: Array) -> Profile:
    Q = np.linalg.qr(columns)[0]

    def rss(z: Array) -> Array:
        z = z - z.mean(axis=0)
        left = z - Q @ (Q.T @ z)
        return np.asarray(np.einsum("ij,ij->j", left, left))

    return rss


def _edge_residue(strata: Strata) -> Profile:
    Q = orthonormal(strata.stacked()[:, :-1])
    root = np.sqrt(strata.weights)[:, None]

    def rss(z: Array) -> Array:
        levels, inside = without_levels(z, strata.level, strata.edge, len(strata.names))
        inner = strata.basis.T @ inside
        rest = inside - strata.basis @ inner
        stacked = np.vstack([inner, root * levels])
        left = stacked - Q @ (Q.T @ stacked)
        return np.asarray(np.einsum("ij,ij->j", rest, rest) + np.einsum("ij,ij->j", left, left))

    return rss


def _interval(profile: Profile) -> tuple[float, float, float] | None:
    """Power of the largest likelihood and the ends of its interval; None where an end lies beyond ``WIDEST``."""
    at, apart = 0.0, WIDEST
    for _ in range(ZOOMS):
        points = np.linspace(max(at - apart, -WIDEST), min(at + apart, WIDEST), STEPS + 1)
        at = float(points[int(np.argmax(profile(points)))])
        apart = 2 * apart / STEPS
    step = 2 * WIDEST / STEPS**2  # a parabola through three points finds the top where the zoom meets rounding
    left, top, right = profile(np.array([at - step / 100, at, at + step / 100]))
    move = step / 200 * float((left - right) / min(left - 2 * top + right, -1e-300))
    at += min(max(move, -step), step)  # where the likelihood is flat but for rounding, the parabola's top is anywhere
    limit = float(profile(np.array([at]))[0]) - DROP
    if (profile(np.array([-WIDEST, WIDEST])) >= limit).any():
        return None
    ends = []
    for far in (-WIDEST, WIDEST):
        inside, outside = at, far
        for _ in range(ZOOMS):
            points = np.linspace(inside, outside, STEPS + 1)
            above = int(np.argmax(profile(points) < limit))
            inside, outside = float(points[max(above - 1, 0)]), float(points[max(above, 1)])
        ends.append((inside + outside) / 2)
    return at, ends[0], ends[1]


def _power(value: float) -> str:
    """Two digits, and no minus before a zero."""
    return f"{round(value, 2) + 0.0:.2f}"


TELLS = 1.0  # units of log-likelihood (2 of AIC) below which two fits are as good as each other
SURE = 2.0  # standard errors


@dataclass(frozen=True, slots=True, repr=False)
class ErrorStructure(Plottable):
    """Multiplicative against additive errors of one law on the same rows.

    Attributes
    ----------
    response : str
    fitted : {"multiplicative", "additive"}
        What the law was fitted with.
    multiplicative, additive : float
        Log-likelihood of ``y``, rows taken as independent, at the maximum-likelihood variance.
    standard_error : float or None
        Of the difference, from its scatter over ``units``; None where there is only one edge.
    unit, units : str, int
        ``edge`` or ``row``, and how many.
    """

    response: str
    fitted: Error
    multiplicative: float
    additive: float
    standard_error: float | None
    unit: str
    units: int

    @property
    def difference(self) -> float:
        """Log-likelihood of the log fit less that of the natural one; positive where errors multiply."""
        return self.multiplicative - self.additive

    @property
    def aic_difference(self) -> float:
        """AIC of the log fit less that of the natural one; negative where errors multiply."""
        return -2.0 * self.difference

    @property
    def preferred(self) -> Error | None:
        """The better structure; None where the two are as good as each other."""
        if abs(self.difference) < TELLS:
            return None
        return "multiplicative" if self.difference > 0 else "additive"

    @property
    def sure(self) -> bool:
        """Whether the difference is more than two of its standard errors."""
        return self.standard_error is not None and abs(self.difference) > SURE * self.standard_error

    @property
    def concern(self) -> int:
        """0 fine, 1 the other structure is better, 2 surely so. Cure: fit with the other ``error``."""
        return 0 if self.preferred in (None, self.fitted) else 1 + self.sure

    @property
    def verdict(self) -> str:
        """One sentence: which, and by how much."""
        size = abs(self.difference)
        if self.preferred is None:
            return f"These rows do not tell whether errors multiply or add: {size:.1f} units of log-likelihood apart."
        word, better = ("multiply", "log") if self.preferred == "multiplicative" else ("add", "natural")
        found = f"the {better} fit is {size:.{0 if size >= 10 else 1}f} units of log-likelihood better"
        told = f"Errors {word}: {found}"
        if self.standard_error is not None and not self.sure:
            told = f"Errors seem to {word}: {found}, with a standard error of {self.standard_error:.2g}"
            told += f" over {self.units} {self.unit}s"
        return f"{told}; fit with error='{self.preferred}'." if self.concern else f"{told}."


def error_structure(law: LawFit, other: LawFit | None = None) -> ErrorStructure | NotAvailable:
    """Compare the two error structures of a law on its own rows.

    Parameters
    ----------
    law : LawFit
        With either structure.
    other : LawFit, optional
        ``law.alternative``, the other side, where somebody has it already.

    Returns
    -------
    ErrorStructure, or NotAvailable for a line, rows that are not above zero, or a law that meets every row.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> error_structure(law).verdict
    'Errors multiply: the log fit is 33 units of log-likelihood better.'
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    other = law.alternative if other is None else other
    if other is None:
        return NotAvailable(_no_alternative(law))
    if reason := no_scatter(other):
        return NotAvailable(reason)
    log, natural = (law, other) if law.error == "multiplicative" else (other, law)
    by_row = (_loglik(log) - np.log(log.observed), _loglik(natural))
    unit, codes = units_of(law)
    by_unit = np.bincount(codes, weights=by_row[0] - by_row[1])
    return ErrorStructure(
        response=law.response,
        fitted=law.error,
        multiplicative=float(by_row[0].sum()),
        additive=float(by_row[1].sum()),
        standard_error=float(np.sqrt(len(by_unit)) * by_unit.std(ddof=1)) if len(by_unit) > 1 else None,
        unit=unit,
        units=len(by_unit),
    )


def _loglik(law: LawFit) -> Array:
    """Normal log-likelihood of each residual at the maximum-likelihood variance, shape (n,)."""
    variance = law.rss / law.nobs
    return np.asarray(-0.5 * (np.log(2 * np.pi * variance) + law.residuals**2 / variance))


def _no_alternative(law: LawFit) -> str:
    if not law.law.logarithmic:
        return f"a {law.form.replace('_', ' ')} is a straight line: its errors add, and there is no other fit"
    below = int((law.observed <= 0).sum())
    if below:
        return f"{below} of {law.nobs} rows of {law.response} are not above zero and have no logarithm"
    return "least squares in natural units does not converge from the log fit: there is nothing to compare with"
