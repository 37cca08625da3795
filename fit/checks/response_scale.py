"""Scale of the response: Box-Cox transform, and multiplicative against additive errors by their likelihood.

Box-Cox: ``z(lambda) = (y^lambda - 1) / (lambda g^(lambda - 1))`` with g the geometric mean of y; the residual sum of
squares of z on the law's terms is a likelihood. 0 is the logarithm, on which a power law is linear; 1 is the response
itself. Where edges have several rows, each has a random level, with the variance split of the law. Heavy
tails of the errors raise this likelihood as a wrong power does; so the power of the law is rejected only where its
score over the units, edges or independent rows, rejects it as well, in units of its scatter between them.

Error structure: R2 of the two fits is on different scales and cannot be compared. Densities can: the log fit gives
``y`` the density of ``ln y`` divided by ``y``, so its log-likelihood carries the Jacobian ``- sum ln y``. Both fits
have the same number of parameters, so the difference of AIC is minus twice that of the log-likelihoods.

Sources: Box & Cox 1964, J. Royal Statistical Society B 26, 211; White 1982, Econometrica 50, 1 (score in units of its
own scatter); Xiao et al. 2011, Ecology 92, 1887 (power laws);
Vuong 1989, Econometrica 57, 307 (standard error of the difference, here summed by edge).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.display import Plottable
from ..available import NotAvailable
from ..lawfit import LawFit
from ..laws import Error
from .check import Check, concern_of, format_p
from .strata import Strata, has_repeated_edges, linear_columns, no_scatter, orthonormal, units_of, without_levels

Profile = Callable[[Array], Array]

DROP = 1.920729410347062  # half the .95 quantile of chi-squared on one degree of freedom
WIDEST = 10.0  # powers beyond it are no useful transformation
NEAR = 1e-4  # distance of powers for a derivative
STEPS = 12  # parts of one zoom: the top lies in two of them, an end in one
ZOOMS = 6


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class BoxCox(Check):
    """Score test of the power of the response that the law has; ``df``: units, edges or independent rows, less one.

    It is a concern only where the interval of the likelihood excludes that power as well.

    Attributes
    ----------
    power : float
        Lambda of the largest profile likelihood.
    low, high : float
        Its 95 % profile-likelihood interval.
    of_law : float
        The power that the law has: 0 for logarithms, 1 for a line.
    likelihood_ratio : float
        Chi-squared of that power on one degree of freedom, for normal errors.
    """

    power: float
    low: float
    high: float
    of_law: float
    likelihood_ratio: float


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
    if reason := no_scatter(law):
        return NotAvailable(reason)
    if not law.formula.linearisable:
        return NotAvailable("with additive wear the law is not linear on any scale of the response")
    if law.formula.logarithmic and law.error == "additive":
        return NotAvailable(
            "with additive errors the law is not linear on the scale of the response: fit with multiplicative errors"
        )
    if not (law.observed > 0).all():
        return NotAvailable(f"{law.response} is not above zero in every row, as its powers require")
    if has_repeated_edges(law) and not isinstance(strata, Strata):
        return strata
    of_law = 0.0 if law.formula.logarithmic else 1.0
    profile = profile_of(law, strata)
    found = _interval(profile)
    if found is None:
        return NotAvailable(
            f"{law.response} changes by a factor of {law.observed.max() / law.observed.min():.2g} only, too little to "
            "distinguish powers of it"
        )
    best, low, high = found
    top, own = profile(np.array([best, of_law]))
    ratio = max(0.0, 2 * float(top - own))
    score, df, p = _score(law, strata, of_law)
    rejected = bool(concern_of(p)) and ratio > 2 * DROP
    transform, other = ("log transform", "original scale") if of_law == 0 else ("original scale", "log transform")
    unit = units_of(law)[0]
    result = (
        f"score over {unit}s t({df}) = {score:.2f}, {format_p(p)}; lambda = {_power(best)}, 95 % CI {_power(low)} to "
        f"{_power(high)} with normal errors"
    )
    kept = f"Box-Cox: the {transform} is not rejected ({result})."
    if not rejected:
        verdict = kept
    elif low <= 1 - of_law <= high:
        verdict = (
            f"Box-Cox: the {transform} is rejected in favour of the {other} ({result}): compare the error structures."
        )
    else:
        verdict = (
            f"Box-Cox: the {transform} is rejected ({result}): the effect of a factor is curved or the variance is not "
            "constant; compare forms (fitmodels compare)."
        )
    return BoxCox(
        null=f"the {transform} of the response (lambda = {of_law:g}) is adequate",
        statistic=score,
        symbol="score t",
        df=df,
        pvalue=p,
        concern=int(rejected),
        verdict=verdict,
        kept=kept,
        power=best,
        low=low,
        high=high,
        of_law=of_law,
        likelihood_ratio=ratio,
    )


def _score(law: LawFit, strata: Strata | NotAvailable, power: float) -> tuple[float, int, float]:
    """Slope of the likelihood at a power over the scatter of its parts over the units: t, its df and p."""
    from scipy.special import stdtr

    columns, log_y = linear_columns(law)[0], np.log(law.observed)
    z = transformed(log_y, power + np.array([-NEAR, 0.0, NEAR]))
    if isinstance(strata, Strata):
        columns, z = _whitened(strata, columns), _whitened(strata, z)
    z = z - columns @ np.linalg.lstsq(columns, z, rcond=None)[0]
    by_unit = np.bincount(units_of(law)[1], weights=(z[:, 2] - z[:, 0]) / (2 * NEAR) * z[:, 1])
    G, scatter = len(by_unit), float(by_unit.std(ddof=1)) if len(by_unit) > 1 else 0.0
    if scatter <= 0:
        return 0.0, max(G - 1, 1), 1.0
    t = -float(by_unit.sum()) / (scatter * G**0.5)  # the sum of squares falls where the likelihood rises
    return t, G - 1, float(2 * stdtr(G - 1, -abs(t)))


def _whitened(strata: Strata, A: Array) -> Array:
    """Rows of A with the levels of edges shrunk to their weight."""
    levels, _ = without_levels(A, strata.level, strata.edge, len(strata.names))
    shrunk = 1 - np.sqrt(strata.weights / strata.weight)
    return np.asarray(A - strata.level[:, None] * (shrunk[:, None] * levels)[strata.edge])


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
    """Power of the largest likelihood and the ends of its interval; None where an end is beyond ``WIDEST``."""
    at, apart = 0.0, WIDEST
    for _ in range(ZOOMS):
        points = np.linspace(max(at - apart, -WIDEST), min(at + apart, WIDEST), STEPS + 1)
        at = float(points[int(np.argmax(profile(points)))])
        apart = 2 * apart / STEPS
    step = 2 * WIDEST / STEPS**2  # a parabola through three points finds the top where the zoom meets rounding
    left, top, right = profile(np.array([at - step / 100, at, at + step / 100]))
    move = step / 200 * float((left - right) / min(left - 2 * top + right, -1e-300))
    at += min(max(move, -step), step)  # where the likelihood is flat but for rounding, the parabola has no definite top
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


EQUAL = 1.0  # units of log-likelihood (2 of AIC) below which two fits are equivalent
SURE = 2.0  # standard errors


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class ErrorStructure(Check, Plottable):
    """Multiplicative against additive errors of one law on the same rows.

    The statistic is the log-likelihood with multiplicative errors less that with additive errors.

    Attributes
    ----------
    response : str
    fitted : {"multiplicative", "additive"}
        Error structure of the law.
    multiplicative, additive : float
        Log-likelihood of ``y``, rows taken as independent, at the maximum-likelihood variance.
    preferred : {"multiplicative", "additive"} or None
        The structure of higher likelihood; None where they differ by less than one unit.
    standard_error : float or None
        Of the difference, from its scatter over ``units``; None where there is only one edge.
    unit, units : str, int
        ``edge`` or ``row``, and how many.
    """

    response: str
    fitted: Error
    multiplicative: float
    additive: float
    preferred: Error | None
    standard_error: float | None
    unit: str
    units: int

    @property
    def aic_difference(self) -> float:
        """AIC with multiplicative errors less that with additive errors."""
        return -2.0 * self.statistic

    @property
    def sure(self) -> bool:
        """Whether the difference is more than two of its standard errors."""
        return self.standard_error is not None and abs(self.statistic) > SURE * self.standard_error


def error_structure(law: LawFit, other: LawFit | None = None) -> ErrorStructure | NotAvailable:
    """Compare the two error structures of a law on its own rows.

    Parameters
    ----------
    law : LawFit
        With either structure.
    other : LawFit, optional
        ``law.alternative``, the other side, where it is known.

    Returns
    -------
    ErrorStructure, or NotAvailable for a line, rows that are not above zero, or a law that meets every row.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> error_structure(law).verdict
    'Multiplicative errors are preferred (log-likelihood higher by 33).'
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
    multiplicative, additive = float(by_row[0].sum()), float(by_row[1].sum())
    difference, units = multiplicative - additive, len(by_unit)
    error = float(np.sqrt(units) * by_unit.std(ddof=1)) if units > 1 else None
    preferred: Error | None = "multiplicative" if difference > 0 else "additive"
    if abs(difference) < EQUAL:
        preferred = None
    sure = error is not None and abs(difference) > SURE * error
    p = _p_of_other(difference if law.error == "additive" else -difference, error, units)
    concern = int(preferred not in (None, law.error) and p is not None and concern_of(p))
    facts = (preferred, abs(difference), None if sure else error, f"{units} {unit}s")
    return ErrorStructure(
        null=f"{law.error} errors have a likelihood at least as high as the other structure",
        statistic=difference,
        symbol="log-likelihood difference",
        pvalue=p,
        concern=concern,
        verdict=_structure_verdict(*facts, refit=bool(concern)),
        kept=_structure_verdict(*facts, refit=False),
        response=law.response,
        fitted=law.error,
        multiplicative=multiplicative,
        additive=additive,
        preferred=preferred,
        standard_error=error,
        unit=unit,
        units=units,
    )


def _p_of_other(gain: float, error: float | None, units: int) -> float | None:
    """P of a log-likelihood that the other structure gains over units, one-sided; None without a standard error."""
    from scipy.special import stdtr

    return None if not error else float(stdtr(units - 1, -gain / error))


def _structure_verdict(preferred: Error | None, size: float, error: float | None, over: str, *, refit: bool) -> str:
    """The preferred structure; with the standard error where the difference is not significant."""
    if preferred is None:
        return f"Multiplicative and additive errors fit equally well (log-likelihoods differ by {size:.1f})."
    found = f"log-likelihood higher by {size:.{0 if size >= 10 else 1}f}"
    if error is not None:
        found += f" ± {error:.2g} over {over}, not significant"
    remedy = f"; fit with {preferred} errors" if refit else ""
    return f"{preferred.capitalize()} errors are preferred ({found}){remedy}."


def _loglik(law: LawFit) -> Array:
    """Normal log-likelihood of each residual at the maximum-likelihood variance, shape (n,)."""
    variance = law.rss / law.nobs
    return np.asarray(-0.5 * (np.log(2 * np.pi * variance) + law.residuals**2 / variance))


def _no_alternative(law: LawFit) -> str:
    if not law.formula.logarithmic:
        return f"a {law.form.replace('_', ' ')} is linear: its errors are additive, and there is no alternative"
    if law.formula.fixed:
        return "a law with fixed exponents has multiplicative errors"
    below = int((law.observed <= 0).sum())
    if below:
        return f"{below} of {law.nobs} rows of {law.response} are not above zero and have no logarithm"
    return "least squares with additive errors does not converge from the log fit"
