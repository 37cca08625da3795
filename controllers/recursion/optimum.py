"""The exact best pair of an interval, where the laws make it a convex problem.

In x = ln V and y = ln f the metal removal rate is linear. The wear at the end of an interval is what was there before
and a monomial, its logarithm convex; power and force are monomials times a power of it, convex too where that power is
not negative: a geometric programme. It is solved by cutting planes (J. E. Kelley, J. SIAM 8 (1960) 703-712): each
limit is replaced by its tangents, each linear programme in two variables by its corners. A tangent never cuts off what
is allowed, so the corner found is at least as good as every allowed pair, and no corner proves that there is none.
"""

import math

import numpy as np

from ...core.errors import UsageError
from .choice import Choice, outcome
from .laws import Array, LifeLaws, Terms
from .rules import Rules, wear_after

ALLOWED = 1e-10  # in logarithms, what a pair may pass a limit by: less than any machine or gauge tells
CORNER = 1e-11  # of a corner of tangents; the intersection of two is solved to some 1e-14
ACTIVE = 1e-7  # in logarithms, how near a limit is called active
MOST = 80  # rounds of tangents; the paper's laws take 2 to 6, a rounded optimum some 20


def not_convex(laws: LifeLaws) -> str:
    """Why there is no exact optimum, in a sentence; empty where there is.

    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import life_laws
    >>> not_convex(life_laws(published("AC-2017")))
    ''
    """
    falls = [f"{terms.response} (AW^{terms.AW:.3g})" for _, terms in laws.limited if terms.AW < 0]
    return f"{' and '.join(falls)} falls with wear: not a convex problem; the grid has the answer." if falls else ""


def best_exact(laws: LifeLaws, rules: Rules, before: float, start: float) -> Choice | None:
    """The pair of the largest MRR in the interval that begins at ``start`` min with wear ``before``, or None.

    Raises
    ------
    UsageError
        Power or force falls as wear grows.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.controllers.recursion import Rules, life_laws
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
            return _told(laws, rules, before, start, z, over)
        cut = over > ALLOWED
        slopes = np.vstack([slopes, tangents[cut]])
        bounds = np.append(bounds, tangents[cut] @ z - over[cut])
    raise UsageError(f"no optimum within {ALLOWED:g} after {MOST} rounds; use the grid (choose='grid').")


def _box(laws: LifeLaws) -> tuple[Array, Array]:
    (v, V), (f, F) = laws.V, laws.f
    return np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]), np.log([V, 1 / v, F, 1 / f])


def _best_corner(slopes: Array, bounds: Array) -> Array | None:
    """The z, shape (2,), with the largest sum under slopes @ z <= bounds, or None where nothing is."""
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
    """How far wear, power and force lie over their limits, in logarithms, shape (k,), and their gradients, (k, 2)."""
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


def _told(laws: LifeLaws, rules: Rules, before: float, start: float, z: Array, over: Array) -> Choice:
    names = ("wear", *(name for name, _ in laws.limited))
    stops = [name for name, by in zip(names, over, strict=True) if by > -ACTIVE]
    ends = zip(("most speed", "most feed"), z, (laws.V[1], laws.f[1]), strict=True)
    stops += [name for name, at, most in ends if at > math.log(most) - ACTIVE]
    V, f = (min(max(math.exp(at), low), high) for at, (low, high) in zip(z, (laws.V, laws.f), strict=True))
    end = start + rules.interval
    return outcome(laws, rules, V, f, float(wear_after(laws, rules, V, f, before, start, end)), end, tuple(stops))
