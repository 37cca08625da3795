"""Best pair of speed and feed of one interval: by the published grid search, or the exact optimum.

In x = ln V and y = ln f the metal removal rate is linear. The wear at the end of an interval is what was there before
and a monomial, its logarithm convex; power and force are monomials times a power of it, convex too where that power is
not negative: a geometric programme. It is solved by cutting planes (J. E. Kelley, J. SIAM 8 (1960) 703-712): each
limit is replaced by its tangents, each linear programme in two variables by its corners. A tangent never cuts off what
is allowed, so the corner found is at least as good as every allowed pair, and no corner proves that there is none.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ...core.arrays import Array, Flags
from ...core.display import Displayable
from ...core.errors import UsageError
from .laws import LifeLaws, Rules, Terms, response_at_end, wear_after

SPEED_STEP, FEED_STEP = 10.0, 0.005  # m/min, mm/rev: the paper's
MOST_PAIRS = 1_000_000
EVEN = 1e-9  # of a step: 0.06 + 108 x 0.005 is 0.6 but for rounding


@dataclass(frozen=True, slots=True, repr=False)
class Grid(Displayable):
    """Speeds V, shape (m,), m/min, and feeds f, shape (n,), mm/rev, both rising."""

    V: Array
    f: Array


@dataclass(frozen=True, slots=True, repr=False)
class IntervalSurfaces(Displayable):
    """Responses of every pair of a grid in one interval.

    Attributes
    ----------
    grid : Grid
    AW, MRR : ndarray, shape (m, n)
        Wear at the end, in the unit of the law; mm3/min.
    P, Fxz : ndarray, shape (m, n), or None
        Power and force at the end, where they are limited.
    breaks : dict of ndarray, shape (m, n), bool
        Pairs that exceed a limit, by its name: ``wear``, ``power``, ``force``, ``feed rate``.
    """

    grid: Grid
    AW: Array
    P: Array | None
    Fxz: Array | None
    MRR: Array
    breaks: dict[str, Flags]

    @property
    def allowed(self) -> Flags:
        """Pairs within every limit, shape (m, n)."""
        return np.asarray(~np.logical_or.reduce(list(self.breaks.values())))

    def best(self) -> tuple[int, int] | None:
        """Speed and feed of the largest MRR within the limits, by position, or None; of equals the slower."""
        rate = np.where(self.allowed, self.MRR, 0.0)
        i, j = divmod(int(rate.argmax()), rate.shape[1])
        return (i, j) if rate[i, j] > 0 else None

    def stops(self, i: int, j: int) -> tuple[str, ...]:
        """Limits that one more step of speed or of feed would exceed: by name, or ``most speed``, ``most feed``."""
        m, n = self.AW.shape
        higher = [(i + 1, j)] * (i + 1 < m) + [(i, j + 1)] * (j + 1 < n)
        found = [name for name, broken in self.breaks.items() if any(broken[at] for at in higher)]
        return (*found, *(["most speed"] * (i + 1 == m)), *(["most feed"] * (j + 1 == n)))


def grid_of(laws: LifeLaws, speed_step: float = SPEED_STEP, feed_step: float = FEED_STEP) -> Grid:
    """The grid over the ranges of the laws: V 50(10)200 and f 0.06(0.005)0.6 in the paper, 16 x 109 pairs.

    Raises
    ------
    UsageError
        A step that is not above zero, or more than a million pairs.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> grid = grid_of(life_laws(published("AC-2017")))
    >>> len(grid.V), len(grid.f), float(grid.f[-1])
    (16, 109, 0.6)
    """
    if not (speed_step > 0 and feed_step > 0):
        raise UsageError(f"steps of {speed_step!r} m/min and {feed_step!r} mm/rev: give both above zero.")
    counts = [int((high - low) / step + EVEN) + 1 for (low, high), step in ((laws.V, speed_step), (laws.f, feed_step))]
    if counts[0] * counts[1] > MOST_PAIRS:
        raise UsageError(f"a grid of {counts[0]} x {counts[1]} pairs; at most {MOST_PAIRS}: use larger steps.")
    V, f = (
        np.round(low + step * np.arange(n), 10)
        for low, step, n in ((laws.V[0], speed_step, counts[0]), (laws.f[0], feed_step, counts[1]))
    )
    return Grid(V, f)


def rates(laws: LifeLaws, grid: Grid) -> Array:
    """MRR of every pair, shape (m, n), rounded so that equal products are equal: 200 x 0.3 and 150 x 0.4."""
    return np.round(laws.mrr(grid.V[:, None], grid.f), 6)


def beyond_feed_rate(laws: LifeLaws, grid: Grid) -> Flags:
    """Pairs outside the limits of the feed rate at the diameter, shape (m, n)."""
    Vf = grid.V[:, None] * grid.f
    return np.asarray((Vf < laws.Vf[0] * (1 - EVEN)) | (Vf > laws.Vf[1] * (1 + EVEN)))


def surfaces(laws: LifeLaws, rules: Rules, grid: Grid, before: float, start: float) -> IntervalSurfaces:
    """Wear, power, force and MRR of every pair in the interval that begins at ``start`` min with wear ``before``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion.laws import Rules
    >>> from fitmodels.controllers import life_laws
    >>> laws = life_laws(published("AC-2017"))
    >>> first = surfaces(laws, Rules(), grid_of(laws), 0.0, 0.0)
    >>> i, j = first.best()
    >>> float(first.grid.V[i]), float(first.grid.f[j]), float(first.MRR[i, j])
    (150.0, 0.58, 217500.0)
    """
    V, f, end = grid.V[:, None], grid.f[None, :], start + rules.interval
    AW = wear_after(laws, rules, V, f, before, start, end)
    values = {name: response_at_end(terms, rules, V, f, end, AW) for name, terms in laws.limited}
    breaks = {"wear": laws.wear.most < AW, **{name: terms.most < values[name] for name, terms in laws.limited}}
    if (beyond := beyond_feed_rate(laws, grid)).any():
        breaks["feed rate"] = beyond
    return IntervalSurfaces(grid, AW, values.get("power"), values.get("force"), rates(laws, grid), breaks)


SearchMethod = Literal["grid", "exact"]


@dataclass(frozen=True, slots=True, repr=False)
class Choice(Displayable):
    """A pair of speed and feed with its responses in an interval.

    Attributes
    ----------
    V, f : float
        m/min, mm/rev.
    AW, P, Fxz : float
        Wear, power and force at the end of the interval, in the units of their laws; NaN where a law is missing.
    MRR : float
        mm3/min.
    stops : tuple of str
        Active limits: ``power``, ``force``, ``wear``, ``feed rate``, ``most speed``, ``most feed``.
    """

    V: float
    f: float
    AW: float
    P: float
    Fxz: float
    MRR: float
    stops: tuple[str, ...] = ()


def choose(laws: LifeLaws, rules: Rules, grid: Grid, how: SearchMethod, before: float, start: float) -> Choice | None:
    """The pair of the largest MRR in the interval that begins at ``start`` min with wear ``before``, or None.

    Raises
    ------
    UsageError
        ``exact`` of laws that do not allow it; see `best_exact`.
    """
    if how not in get_args(SearchMethod):
        raise UsageError(f"how={how!r}: give 'grid' or 'exact'.")
    if how == "exact":
        return best_exact(laws, rules, before, start)
    tried = surfaces(laws, rules, grid, before, start)
    if (at := tried.best()) is None:
        return None
    AW = float(tried.AW[at])
    return outcome(
        laws, rules, float(grid.V[at[0]]), float(grid.f[at[1]]), AW, start + rules.interval, tried.stops(*at)
    )


def outcome(
    laws: LifeLaws, rules: Rules, V: float, f: float, AW: float, end: float, stops: tuple[str, ...] = ()
) -> Choice:
    """A pair with its power and force at the end of the interval."""
    values = {name: float(response_at_end(terms, rules, V, f, end, AW)) for name, terms in laws.limited}
    none = float("nan")
    return Choice(V, f, AW, values.get("power", none), values.get("force", none), float(laws.mrr(V, f)), stops)


ALLOWED = 1e-10  # in logarithms, tolerance of a limit: below the resolution of any machine or gauge
CORNER = 1e-11  # of a corner of tangents; the intersection of two is solved to some 1e-14
ACTIVE = 1e-7  # in logarithms, distance at which a limit counts as active
MOST = 80  # rounds of tangents; the paper's laws take 2 to 6, a rounded optimum some 20


def not_convex(laws: LifeLaws) -> str:
    """Reason why there is no exact optimum; empty where there is one.

    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers import life_laws
    >>> not_convex(life_laws(published("AC-2017")))
    ''
    """
    falls = [f"{terms.response} (AW^{terms.AW:.3g})" for _, terms in laws.limited if terms.AW < 0]
    return f"{' and '.join(falls)} falls with wear: not a convex problem; use the grid." if falls else ""


def best_exact(laws: LifeLaws, rules: Rules, before: float, start: float) -> Choice | None:
    """The pair of the largest MRR in the interval that begins at ``start`` min with wear ``before``, or None.

    Raises
    ------
    UsageError
        Power or force falls as wear grows.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion.laws import Rules
    >>> from fitmodels.controllers import life_laws
    >>> best = best_exact(life_laws(published("AC-2017")), Rules(), 0.0, 0.0)
    >>> print(f"{best.V:.2f} {best.f:.3f} {best.MRR:.0f} {best.stops}")
    147.23 0.600 220844 ('power', 'most feed')
    """
    if why := not_convex(laws):
        raise UsageError(why)
    slopes, bounds = _box(laws)
    for _ in range(MOST):
        z = _best_corner(slopes, bounds)
        if z is None:
            return None
        over, tangents = _limits_at(laws, rules, before, start, z)
        if over.max() <= ALLOWED:
            return _choice(laws, rules, before, start, z, over)
        cut = over > ALLOWED
        slopes = np.vstack([slopes, tangents[cut]])
        bounds = np.append(bounds, tangents[cut] @ z - over[cut])
    raise UsageError(f"no optimum within {ALLOWED:g} after {MOST} rounds; use the grid (how='grid').")


def _box(laws: LifeLaws) -> tuple[Array, Array]:
    (v, V), (f, F), (least, most) = laws.V, laws.f, laws.Vf
    slopes, bounds = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], [V, 1 / v, F, 1 / f]
    if math.isfinite(most):
        slopes, bounds = [*slopes, [1.0, 1.0]], [*bounds, most]
    if least > 0:
        slopes, bounds = [*slopes, [-1.0, -1.0]], [*bounds, 1 / least]
    return np.array(slopes), np.log(bounds)


def _best_corner(slopes: Array, bounds: Array) -> Array | None:
    """The z, shape (2,), with the largest sum under slopes @ z <= bounds; None where infeasible."""
    i, j = np.triu_indices(len(bounds), 1)
    (a, b), (c, d), p, q = slopes[i].T, slopes[j].T, bounds[i], bounds[j]
    cross = a * d - b * c
    meet = np.abs(cross) > 1e-12  # parallel lines have no corner
    corners = np.stack([d * p - b * q, a * q - c * p])[:, meet] / cross[meet]
    corners = corners[:, (slopes @ corners <= bounds[:, None] + CORNER).all(axis=0)]
    if not corners.size:
        return None
    best: Array = corners[:, corners.sum(axis=0).argmax()]
    return best


def _limits_at(laws: LifeLaws, rules: Rules, before: float, start: float, z: Array) -> tuple[Array, Array]:
    """Excess of wear, power and force over their limits, in logarithms, shape (k,), and its gradients, (k, 2)."""
    (V, f), end, wear = np.exp(z), start + rules.interval, laws.wear
    AW = float(wear_after(laws, rules, V, f, before, start, end))
    u = 1.0 if rules.wear == "clock" else 1.0 / wear.t  # in AW^u the increment is a monomial
    share = 1.0 - (before / AW) ** u
    grows = share * np.array([wear.V, wear.f])  # gradient of ln AW
    late = math.log(end) if rules.times == "full" else 0.0

    def over(terms: Terms) -> float:
        at = terms.ln_c + terms.V * z[0] + terms.f * z[1] + terms.t * late + terms.AW * math.log(AW)
        return float(at - math.log(terms.most))

    limited = [terms for _, terms in laws.limited]
    values = [math.log(AW / wear.most), *map(over, limited)]
    gradients = [grows, *(np.array([terms.V, terms.f]) + terms.AW * grows for terms in limited)]
    return np.array(values), np.array(gradients)


def _choice(laws: LifeLaws, rules: Rules, before: float, start: float, z: Array, over: Array) -> Choice:
    names = ("wear", *(name for name, _ in laws.limited))
    stops = [name for name, by in zip(names, over, strict=True) if by > -ACTIVE]
    ends = zip(("most speed", "most feed", "feed rate"), (*z, z.sum()), (laws.V[1], laws.f[1], laws.Vf[1]), strict=True)
    stops += [name for name, at, most in ends if at > math.log(most) - ACTIVE]
    V, f = (min(max(math.exp(at), low), high) for at, (low, high) in zip(z, (laws.V, laws.f), strict=True))
    end = start + rules.interval
    return outcome(laws, rules, V, f, float(wear_after(laws, rules, V, f, before, start, end)), end, tuple(stops))
