"""Box and Cox's power: that of the response on which the terms of a law are straight and its scatter even.

``z(lambda) = (y^lambda - 1) / (lambda g^(lambda - 1))`` with g the geometric mean of y; the residual sum of
squares of z on the law's terms is a likelihood. 0 is the logarithm, on which a power law is straight; 1 is the
response itself. Where edges gave several rows, each has a random level, with the variance split of the law.

Source: Box & Cox 1964, J. Royal Statistical Society B 26, 211, section 3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import concern_of, p_in_words
from .columns import Array, linear_columns, orthonormal, without_levels
from .evidence import has_repeated_edges, no_scatter
from .strata import Strata

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
