"""Information of tests on the parameters of a law, and searches for the tests that add most of it.

Adding rows to Z multiplies the determinant of Z'Z by ``det(I + A M A')`` with ``M = (Z'Z)^-1`` and A the added rows;
by the matrix determinant lemma one row z gains ``1 + z'Mz``, and swapping row a for row z, with M of both old and
added rows, ``(1 + z'Mz)(1 - a'Ma) + (z'Ma)^2`` (D-optimal). Rows of one edge share its level:

    I = sum over edges of Z'V^-1 Z,   V = s_within^2 I + s_between^2 11',

and a decision with gradient g has the variance ``g I^-1 g'`` (c-optimal). ``g (I + I_new)^-1 g' / g I^-1 g'`` is the
variance that remains after further tests, if the law and its scatter are true. The present interval (jackknife by edge)
is scaled by it; the degrees of freedom grow by the number of new edges.

Sources: Fedorov 1972, Theory of Optimal Experiments, sections 2.7 and 3.2; Cook & Nachtsheim 1980, Technometrics 22,
315 (exchange); Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2 (V).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, log, sqrt
from typing import Any

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags, Ints
from ..core.display import Displayable
from ..core.rounding import format_rounded
from .decisions import Decision, variances_of
from .edges import EdgeInference
from .lawfit import LawFit
from .rows import Points, as_table

GAIN = 1e-9  # a swap that gains less is rounding, and would go round in circles
STARTS = 8  # the greedy one, and random ones: exchange stops at a local best
LEVEL = 0.95
ENOUGH = 0.05  # share by which the law may widen the interval of one new edge: then more tests narrow little
TOO_MANY = 50  # further tests that do not pay
MOST_MORE = 1000  # tests beyond which no number is stated
SWEEPS, MOST_EXCHANGED = 5, 20  # of exchanges for a decision, and tests up to which they are made


@dataclass(frozen=True, slots=True, repr=False)
class Narrowing(Displayable):
    """Interval of a decision now, and expected after further tests.

    Attributes
    ----------
    decision : Decision
    now, after : tuple of float
        Ends of the 95 % interval from the uncertainty of the law.
    edge_now, edge_after : tuple of float
        The same for one new edge.
    tests : int
        Number of further tests.
    enough : int or None
        Tests like these after which the law widens the interval of a new edge by 5 % at most; 0 now already, None
        where 1000 are too few.
    reached : int or None
        Tests like these after which the interval of the law is as narrow as asked for; None: not asked, or never.
    within : float or None
        Half width asked for, as a share.
    unsound : str
        Why there is no advice to stop, empty where there is.
    """

    decision: Decision
    now: tuple[float, float]
    after: tuple[float, float]
    edge_now: tuple[float, float]
    edge_after: tuple[float, float]
    tests: int
    enough: int | None
    reached: int | None
    within: float | None
    unsound: str = ""

    @property
    def words(self) -> tuple[str, ...]:
        """Interval now and expected; when to stop."""
        d, (low, high) = self.decision, self.now
        bounded = 0 < low < high < inf and self.after[0] > 0
        ratio = log(self.after[1] / self.after[0]) / log(high / low) if bounded else 1.0
        width = f" ({100 * ratio:.0f} % of the width, in logarithms)" if bounded else ""
        out = [
            f"{d.name}: {_rounded(d.value, low, high)} {d.unit}, 95 % interval of the law {_ends(low, high)} {d.unit}; "
            f"expected after {_tests(self.tests)} {_ends(*self.after)} {d.unit}{width}.",
        ]
        if d.no_edge:  # when to stop is not known either
            also = "The interval of the law does not allow for that either."
            return (*out, f"No interval of one new edge: {d.no_edge}.", also, *filter(None, [d.beyond]))
        out.append(f"One new edge: {_ends(*self.edge_now)} {d.unit} now, {_ends(*self.edge_after)} {d.unit} expected.")
        return (*out, *self._stop())

    def _stop(self) -> list[str]:
        out = [self.unsound] if self.unsound else [*self._when_within(), *self._when_enough()]
        if self.decision.beyond:
            out.append(f"Do not stop before tests have covered what is extrapolated. {self.decision.beyond}")
        return out

    def _when_within(self) -> list[str]:
        """When the interval of the law is as narrow as asked for."""
        out = []
        if self.within is not None:
            asked = f"an interval of the law within ±{100 * self.within:.3g} %"
            out.append(
                f"Stop: {asked} is reached." if self.reached == 0
                else f"Stop after about {_tests(self.reached)} like these: then {asked} is expected." if self.reached
                else f"{asked[0].upper()}{asked[1:]} is not reached with {MOST_MORE} tests like these."
            )  # fmt: skip
        return out

    def _when_enough(self) -> list[str]:
        """When further tests hardly narrow the interval of a new edge."""
        out, beyond = [], self.decision.beyond
        rest = f"the interval of one new edge is at most {100 * ENOUGH:.0f} % wider than with a law known exactly"
        if self.enough == 0:
            head = "Tests like these do not pay" if beyond else "Stop"
            out.append(f"{head}: {rest}; more tests hardly narrow it, what is left is the scatter between edges.")
        elif self.enough is None:
            out.append(f"More than {MOST_MORE} tests like these are needed until {rest}: vary the conditions more.")
        elif self.enough > TOO_MANY:
            instead = "run edges to the criterion" if beyond else "vary the conditions more"
            out.append(f"Further tests at these points do not pay ({self.enough} until {rest}): {instead}.")
        elif beyond:
            out.append(f"After about {_tests(self.enough)} like these {rest}, if the law holds so far.")
        else:
            out.append(f"Stop after about {_tests(self.enough)} like these: then {rest}.")
        return out


def narrowing(
    law: LawFit, decision: Decision, tests: Sequence[Points], within: float | None = None, unsound: str = ""
) -> Narrowing:
    """Interval of a decision now, and expected after further tests.

    Parameters
    ----------
    law : LawFit
    decision : Decision
    tests : sequence of mapping or DataFrame
        One for each further test: its readings, a column for each factor (and the category).
    within : float, optional
        Half width asked for, as a share: 0.15 for ±15 %.
    unsound : str
        Why the law allows no advice to stop; empty where it does.
    """
    from scipy.special import stdtrit

    free = estimated(law)
    g, C = decision.gradient[free], law.covariance()[np.ix_(free, free)]
    old = information(law)
    new = sum((information_of_test(law, test) for test in tests), np.zeros_like(old))
    variance = float(g @ C @ g)
    model = _remaining(old, g)

    def expected(share: float) -> tuple[float, float]:
        """Variance with this many times the tests, and t."""
        left = variance * _remaining(old + share * new, g) / model
        return left, float(stdtrit(law.df + share * len(tests), (1 + LEVEL) / 2))

    def after(n: float) -> tuple[float, float]:
        left, t = expected(n / len(tests))
        return t * sqrt(left), t * sqrt(left + decision.edge_sd**2)

    half, half_edge = after(0.0)
    less, less_edge = after(float(len(tests)))

    def first(holds: Callable[[float], bool]) -> int | None:
        """Least number of tests at which it holds."""
        if not holds(MOST_MORE):
            return None
        low, high = -1, MOST_MORE
        while high - low > 1:
            low, high = (low, (low + high) // 2) if holds((low + high) // 2) else ((low + high) // 2, high)
        return high

    wide = (1 + ENOUGH) ** 2 - 1
    return Narrowing(
        decision, _interval(decision.value, half), _interval(decision.value, less),
        _interval(decision.value, half_edge), _interval(decision.value, less_edge), len(tests),
        first(lambda n: expected(n / len(tests))[0] <= wide * decision.edge_sd**2),
        None if within is None else first(lambda n: after(n)[0] <= log(1 + within)), within, unsound,
    )  # fmt: skip


def estimated(law: LawFit) -> Flags:
    """Mask of the parameters that are estimated, shape (p,): not those whose value is fixed, which have no variance."""
    return np.asarray(np.diag(law.covariance()) > 0)


def information(law: LawFit) -> Array:
    """Information of the tests so far on the estimated parameters, shape (q, q), with the scatter of the law."""
    A = law.gradient_at(law.design)[:, estimated(law)]
    between, within = variances_of(law)
    if not isinstance(law.edges, EdgeInference) or law.rows is None:
        return np.asarray(A.T @ A / within, dtype=float)
    number = law.rows.edge_numbers
    each = [_of_edge(A[number == g], between, within) for g in range(number.max() + 1)]
    return np.asarray(np.sum(each, axis=0), dtype=float)


def information_of_test(law: LawFit, readings: Points) -> Array:
    """Information of one further test, shape (q, q): its readings share the level of an edge."""
    return _of_edge(
        law.gradient_at(law.design_of(as_table(law.response, readings)))[:, estimated(law)], *variances_of(law)
    )


def expected_readings(
    law: LawFit, plan: pd.DataFrame, durations: Callable[[pd.DataFrame], Array] | None = None
) -> list[dict[str, list[Any]]]:
    """Readings that each test of a plan is expected to give, by column: as many as an edge has had, at equal steps.

    Time steps to the duration of the test, or to the longest test so far; where the plan sets it, it is no longer than
    that duration. Any other factor that changes within an edge steps over its range.
    """
    m = 1 if law.edge is None else max(int(np.median(np.unique(law.edge, return_counts=True)[1])), 1)
    share = np.arange(1, m + 1) / m
    by = None if law.by is None else law.by.column
    between = [name for name in map(str, plan) if name in law.factors or name == by]
    within = {name: law.domain[name] for name in law.factors if name not in plan}
    steps = {name: (low + share * (high - low)).tolist() for name, (low, high) in within.items() if name != "t"}
    tests: list[dict[str, list[Any]]] = [
        {**{name: [plan[name].iloc[i]] * m for name in between}, **steps} for i in range(len(plan))
    ]
    if "t" not in law.factors:
        return tests
    longest = np.full(len(plan), law.domain["t"][1]) if "t" in within else plan["t"].to_numpy(dtype=float)
    ends = longest if durations is None else durations(plan) if "t" in within else np.minimum(durations(plan), longest)
    for test, end in zip(tests, ends.tolist(), strict=True):
        test["t"] = (share * end).tolist() if "t" in within else [end] * m
    return tests


def _of_edge(A: Array, between: float, within: float) -> Array:
    """``Z'V^-1 Z`` of the rows of one edge, by the formula of Sherman and Morrison."""
    total = A.sum(axis=0)
    return np.asarray(A.T @ A - np.outer(total, total) * between / (within + len(A) * between)) / within


def _remaining(information: Array, g: Array) -> float:
    return float(g @ np.linalg.solve(information, g))


def _interval(value: float, half: float) -> tuple[float, float]:
    with np.errstate(over="ignore"):
        return float(value * np.exp(-half)), float(value * np.exp(half))


def _rounded(value: float, low: float, high: float) -> str:
    return format_rounded(value, min((high - low) / 2, value))[0]


def _ends(low: float, high: float) -> str:
    if not np.isfinite(high) or high > 1e6 * low:
        return f"{low:.2g} to no upper end"
    half = min((high - low) / 2, low)
    return f"{format_rounded(low, half)[0]} to {format_rounded(high, half)[0]}"


def _tests(n: int | None) -> str:
    return f"{n} more test{'' if n == 1 else 's'}"


def c_optimal(g: Array, known: Array, new: Array, n: int, most: int) -> list[int]:
    """Choose n tests, each at most ``most`` times, that leave least variance ``g (I + sum I_new)^-1 g``.

    Greedy, then exchange one by one until nothing is gained.

    Parameters
    ----------
    g : ndarray, shape (p,)
    known : ndarray, shape (p, p)
        Information of the tests so far.
    new : ndarray, shape (c, p, p)
        Information of each candidate.

    Examples
    --------
    >>> points = np.array([[1, -1.0], [1, 0], [1, 1]])
    >>> c_optimal(np.array([0.0, 1.0]), np.eye(2), points[:, :, None] * points[:, None, :], 2, 1)
    [0, 2]
    """
    chosen: list[int] = []

    def best(others: list[int]) -> int:
        held = known + new[others].sum(axis=0)
        left = np.linalg.solve(held + new, np.broadcast_to(g[:, None], (len(new), len(g), 1)))[..., 0] @ g
        left[np.bincount(others, minlength=len(new)) >= most] = np.inf
        return int(np.argmin(left))

    for _ in range(min(n, most * len(new))):
        chosen.append(best(chosen))
    for _ in range(SWEEPS if n <= MOST_EXCHANGED else 0):
        before = list(chosen)
        for i in range(len(chosen)):
            chosen[i] = best(chosen[:i] + chosen[i + 1 :])
        if chosen == before:
            break
    return sorted(chosen)


def d_optimal(M: Array, candidates: Array, n: int, most: int, rng: np.random.Generator) -> tuple[Ints, float]:
    """Choose n rows of ``candidates`` that make the determinant of the information largest.

    Parameters
    ----------
    M : ndarray, shape (p, p)
        ``(Z'Z)^-1`` of the design so far.
    candidates : ndarray, shape (c, p)
    n, most : int
        How many to choose, and how often each candidate at most (``n <= most * c``).
    rng : Generator
        Of the random starts.

    Returns
    -------
    chosen : ndarray of int, shape (n,), ascending
    gain : float
        Factor of the determinant of Z'Z.

    Examples
    --------
    >>> points = np.array([[1, -1.0], [1, 0], [1, 1]])
    >>> chosen, gain = d_optimal(np.diag([0.25, 0.5]), points, 2, 2, np.random.default_rng(1))
    >>> chosen.tolist(), round(gain, 3)
    ([0, 2], 3.0)
    """
    starts = [_greedy(M, candidates, n, most)]
    places = np.repeat(np.arange(len(candidates)), min(most, n))
    starts += [rng.choice(places, size=n, replace=False) for _ in range(STARTS - 1)]
    best, largest = starts[0], -1.0
    for start in starts:
        chosen = _exchanged(M, candidates, start, most)
        gain = determinant_gain(M, candidates[chosen])
        if gain > largest * (1 + GAIN):
            best, largest = np.sort(chosen), gain
    return best, largest


def determinant_gain(M: Array, added: Array) -> float:
    """Factor by which the determinant of the information grows when rows (n, p) are added."""
    return float(np.linalg.det(np.eye(len(M)) + M @ added.T @ added))


def _greedy(M: Array, candidates: Array, n: int, most: int) -> Ints:
    chosen: list[int] = []
    count = np.zeros(len(candidates), dtype=np.intp)
    for _ in range(n):
        d = np.einsum("ij,jk,ik->i", candidates, M, candidates)
        best = int(np.argmax(np.where(count < most, d, -1.0)))
        chosen.append(best)
        count[best] += 1
        M = _with_row(M, candidates[best])
    return np.array(chosen, dtype=np.intp)


def _with_row(M: Array, z: Array) -> Array:
    """(Z'Z + zz')^-1, by Sherman and Morrison."""
    v = M @ z
    return np.asarray(M - np.outer(v, v) / (1 + z @ v))


def _exchanged(M: Array, candidates: Array, start: Ints, most: int) -> Ints:
    """Swap one chosen row for one candidate, the best swap of all, until none gains."""
    chosen = start.copy()
    for _ in range(50 * len(chosen)):
        rows = candidates[chosen]
        inverse = np.linalg.inv(np.linalg.inv(M) + rows.T @ rows)
        cross = candidates @ inverse @ rows.T
        d = np.einsum("ij,jk,ik->i", candidates, inverse, candidates)
        ratio = np.outer(1 + d, 1 - d[chosen]) + cross**2
        ratio[np.bincount(chosen, minlength=len(candidates)) >= most] = 0.0
        into, out = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        if ratio[into, out] <= 1 + GAIN:
            break
        chosen[out] = into
    return chosen
