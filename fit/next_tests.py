"""Further tests for a design: most informative for a law, for a decision, or repeats where pure error is unknown.

A test is an edge cut at one setting of what changes only between edges; time and wear then follow by themselves.
Where the file names no edges a test is a row. A design in which no setting was cut twice has no pure error: lack of
fit cannot be separated from differences between edges. Repeats then come first, at the most informative settings.

Source: Myers, Montgomery & Anderson-Cook 2016, Response Surface Methodology, sections 2.7 and 8.3.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.censored import RUN_OUT
from ..core.errors import FitError, UsageError
from ..datasets import region
from ..datasets.design import round_significant
from .decisions import Decision
from .edges import changes_within
from .lawfit import LawFit
from .least_squares import linear
from .optimal_tests import c_optimal, d_optimal, determinant_gain, estimated, information, information_of_test
from .region import DesignRegion
from .rows import Points, as_table, level_names

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MOST = 1000  # tests in one plan
GRID = 20_000  # candidates at most
ALIKE = 4  # decimals of a coded level: closer settings are one
DIGITS = 4
CHOICES = 700  # settings at most to choose from for a decision
TWICE = 2  # tests of one setting at most
RUN_OUTS = (
    " Not proposed: settings where every test ran out, or whose {} by the law is longer than the longest test, since "
    "they would give bounds only; give --longest to run them longer."
)


@dataclass(frozen=True, slots=True)
class Trials:
    """The tests cut so far, one a row.

    Attributes
    ----------
    what : {"edge", "row"}
    names : tuple of str
        Factors that a test sets.
    X : ndarray, shape (T, k)
        Their levels, in the units of the law.
    level : ndarray of str, shape (T,), or None
        Level of the category.
    label : tuple of str
        Name of each test.
    """

    what: str
    names: tuple[str, ...]
    X: Array
    level: NDArray[np.object_] | None
    label: tuple[str, ...]


def next_runs(
    law: LawFit,
    n: int,
    *,
    candidates: Points | None = None,
    decision: Decision | None = None,
    durations: Callable[[pd.DataFrame], Array] | None = None,
    longest: float | None = None,
    seed: int = 1,
) -> pd.DataFrame:
    """Plan n further tests for a law.

    Parameters
    ----------
    law : LawFit
    n : int
        How many edges (or rows, where the file names no edges) to add, 1 to 1000.
    candidates : mapping or DataFrame, optional
        Settings to choose from, a column for each factor that a test sets (and the category). Left out: repeats of
        settings already cut, where none was cut twice; else a grid in coded logarithms over the design's region
        and the settings already cut.
    decision : Decision, optional
        Choose the tests that narrow its interval most (c-optimal), each setting at most twice, in place of those that
        are most informative for the law as a whole.
    durations : callable, optional
        Minutes in cut of each setting of a table, for a law with t; the longest test so far unless given.
    longest : float, optional
        Of a law of tool lives with run-outs, the longest test in its unit, by default the longest so far: settings
        where every test ran out, or whose life by the law is longer, would give bounds only and are no candidates.
    seed : int
        Seed of the run order, and of the search's random starts.

    Returns
    -------
    DataFrame, one row a test in run order: run (1..n), edge (a new name), point (``repeat of E03`` or ``new``), the
    factors in the units of the law and the category, and t where ``durations`` are given. ``attrs``: criterion
    ("repeats", "D-optimal" or "c-optimal"), determinant_gain (of the information matrix of the tests), volume (what is
    left of the volume of the joint confidence region), units, words, and readings: a table of the expected readings of
    each test, for `decisions.narrowing`.

    Raises
    ------
    UsageError
        n out of bounds.
    FitError
        Candidates that lack a factor.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.next_tests import next_runs
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> plan = next_runs(law, 4, seed=1)
    >>> plan.attrs["criterion"], list(plan.columns)
    ('D-optimal', ['run', 'edge', 'point', 'V', 'f', 'd'])
    """
    if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= MOST:
        raise UsageError(f"n={n!r}: the number of tests to add is a whole number from 1 to {MOST}.")
    cut, rng = trials(law), np.random.default_rng(seed)
    repeats = candidates is None and decision is None and not replicated(law.region, cut)
    X, level = _candidates(law, cut, repeats) if candidates is None else _given(law, cut, candidates)
    ends = _ends_in_time(law, cut, X, level, longest) if candidates is None else np.ones(len(X), dtype=bool)
    X, level = X[ends], None if level is None else level[ends]
    old = _rows(law, cut, cut.X, cut.level)
    M = linear(old, np.zeros(len(old))).cov_unscaled
    if decision is None:
        chosen, gain = d_optimal(M, _rows(law, cut, X, level), n, -(-n // len(X)) if repeats else n, rng)
    else:
        chosen = _for_decision(law, decision, n, durations, cut, X, level)
        gain = determinant_gain(M, _rows(law, cut, X, level)[chosen])
    chosen = rng.permutation(chosen)
    plan = _plan(law, cut, X[chosen], None if level is None else level[chosen])
    readings = expected_readings(law, plan, durations)
    if durations is not None and "t" in law.factors:
        plan["t"] = [test["t"][-1] for test in readings]
    criterion = "c-optimal" if decision is not None else "repeats" if repeats else "D-optimal"
    facts: dict[str, object] = {
        "criterion": criterion,
        "determinant_gain": gain,
        "volume": gain**-0.5,
        "units": {name: law.units[name] for name in law.factors if name in plan and law.units.get(name)},
        "words": _words(law, cut, len(plan), criterion, gain) + ("" if ends.all() else RUN_OUTS.format(law.response)),
        "readings": readings,
    }
    plan.attrs.update(facts)
    return plan


def candidate_settings(law: LawFit) -> pd.DataFrame:
    """Settings that further tests are chosen from: those already cut, and a grid over the region of the design."""
    cut = trials(law)
    X, level = _candidates(law, cut, repeats=False)
    return _plan(law, cut, X, level).drop(columns=["run", "edge", "point"])


def trials(law: LawFit) -> Trials:
    """The tests a law was fitted to: its edges, each once, or its rows where the file names no edges."""
    columns = np.hstack([np.ones((law.nobs, 1)), law.X, law.shifts])
    first, what, within = np.arange(law.nobs), "row", np.zeros(columns.shape[1], dtype=bool)
    label = tuple(f"line {line}" for line in law.lines)
    if law.edge is not None:
        names, first, number = np.unique(law.edge, return_index=True, return_inverse=True)
        what, within, label = "edge", changes_within(columns, number), tuple(str(name) for name in names)
    keep = [j for j in range(len(law.factors)) if not within[1 + j]]
    level = None
    if law.by is not None and not within[1 + len(law.factors) :].any():
        known = np.array([law.by.reference, *law.by.levels], dtype=object)
        level = known[(law.shifts[first] @ np.arange(1, len(known))).astype(int)]
    return Trials(what, tuple(law.factors[j] for j in keep), law.X[first][:, keep], level, label)


def replicated(place: DesignRegion, cut: Trials) -> bool:
    """Whether some setting was cut more than once."""
    return len(set(_settings(place, cut, cut.X, cut.level))) < len(cut.X)


def _settings(
    place: DesignRegion, cut: Trials, X: Array, level: NDArray[np.object_] | None
) -> list[tuple[object, ...]]:
    """Each setting as a key: two that differ in rounding only have the same."""
    U = np.round(_coded(place, cut, X), ALIKE) + 0.0
    names = [""] * len(X) if level is None else [str(name) for name in level]
    return [(*u, name) for u, name in zip(map(tuple, U.tolist()), names, strict=True)]


def _coded(place: DesignRegion, cut: Trials, X: Array) -> Array:
    at = [place.factors.index(name) for name in cut.names]
    part = {
        "logs": _logs(place, cut),
        "centre": np.array(place.centre)[at],
        "half_range": np.array(place.half_range)[at],
    }
    return region.coded(part, X)


def _logs(place: DesignRegion, cut: Trials) -> tuple[bool, ...]:
    """For each factor of a test, whether it is coded in logarithms."""
    each = dict(zip(place.factors, np.broadcast_to(place.logs, len(place.factors)).tolist(), strict=True))
    return tuple(each[name] for name in cut.names)


def _rows(law: LawFit, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> Array:
    """Columns of the law that a test sets: 1, coded factors (of second order their terms), indicators; shape (T, p)."""
    shifts = [] if level is None else [(level == name).astype(float) for name in law.region.levels[1:]]
    U = _coded(law.region, cut, X)
    if not law.formula.first_order:
        at = [law.factors.index(name) for name in cut.names]
        powers = [np.array(term.degrees) for term in law.formula.terms]
        U = np.column_stack([np.prod(U ** d[at], axis=1) for d in powers if d[at].sum() == d.sum()] or [U[:, :0]])
    return np.column_stack([np.ones(len(X)), U, *shifts])


def _candidates(law: LawFit, cut: Trials, repeats: bool) -> tuple[Array, NDArray[np.object_] | None]:
    """Settings already cut, each once; and a grid over the region, unless repeats are wanted."""
    place = law.region
    keys = _settings(place, cut, cut.X, cut.level)
    once = [keys.index(key) for key in dict.fromkeys(keys)]
    X, level = cut.X[once], None if cut.level is None else cut.level[once]
    if repeats or not cut.names:
        return X, level
    levels = [None] if cut.level is None else list(place.levels)
    steps = next(s for s in (9, 5, 3, 2) if s == 2 or s ** len(cut.names) * len(levels) <= GRID)
    U = np.array(list(product(np.linspace(-1, 1, steps), repeat=len(cut.names))))
    at = [place.factors.index(name) for name in cut.names]
    terms = np.array(place.centre)[at] + U * np.array(place.half_range)[at]
    with np.errstate(over="ignore"):
        grid = round_significant(np.where(_logs(place, cut), np.exp(terms), terms), DIGITS)
    kept = [grid[_reached(law, cut, grid, name)] for name in levels]
    if level is None:
        return np.vstack([X, *kept]), None
    names = np.repeat(np.array(levels, dtype=object), [len(part) for part in kept])
    return np.vstack([X, *kept]), np.concatenate([level, names])


def _reached(law: LawFit, cut: Trials, grid: Array, name: str | None) -> NDArray[np.bool_]:
    """Whether each setting of the grid lies in the region of the tests."""
    place = law.region
    level = None if name is None else np.full(len(grid), name, dtype=object)
    old = _rows(law, cut, cut.X, cut.level)
    M = linear(old, np.zeros(len(old))).cov_unscaled
    h, largest = (np.einsum("ij,jk,ik->i", z, M, z) for z in (_rows(law, cut, grid, level), old))
    limit = largest.max() if cut.level is None else largest[cut.level == name].max(initial=0.0)
    far = np.square(_coded(place, cut, cut.X)).sum(axis=1).max()
    near = np.square(_coded(place, cut, grid)).sum(axis=1)
    return np.asarray((h <= limit * (1 + region.SLACK)) & (near <= far * (1 + region.SLACK)))


def _ends_in_time(
    law: LawFit, cut: Trials, X: Array, level: NDArray[np.object_] | None, longest: float | None
) -> NDArray[np.bool_]:
    """Whether a test at each setting is expected to end; all where no life is a run-out, or none would end."""
    every = np.ones(len(X), dtype=bool)
    if law.life is None or not law.life.run_outs or law.rows is None or law.rows.side is None:
        return every
    table = pd.DataFrame(X, columns=list(cut.names))
    if law.by is not None:
        table[law.by.column] = level
    end = float(law.observed.max()) if longest is None else longest
    kept = np.asarray(law.values(table)) <= end
    if longest is None:
        keys = _settings(law.region, cut, law.X, _levels_of_rows(law, cut))
        ended = {key for key, side in zip(keys, law.rows.side.tolist(), strict=True) if side != RUN_OUT}
        only_run_outs = {*keys} - ended
        kept &= np.array([key not in only_run_outs for key in _settings(law.region, cut, X, level)])
    return kept if kept.any() else every


def _levels_of_rows(law: LawFit, cut: Trials) -> NDArray[np.object_] | None:
    """Level of the category of each row, None without one."""
    if cut.level is None or law.by is None:
        return None
    known = np.array([law.by.reference, *law.by.levels], dtype=object)
    return np.asarray(known[(law.shifts @ np.arange(1, len(known))).astype(int)], dtype=object)


def _given(law: LawFit, cut: Trials, given: Points) -> tuple[Array, NDArray[np.object_] | None]:
    """Candidates given by the user."""
    place = law.region
    table = as_table(law.response, given)
    needed = (*cut.names, *([place.by] if cut.level is not None and place.by else []))
    missing = [name for name in needed if name not in table]
    if missing or not len(table):
        lack = f"lack {', '.join(missing)}" if missing else "are none"
        raise FitError(f"{law.response}: the candidates {lack}; a test sets {', '.join(needed) or 'nothing'}.")
    X = table[list(cut.names)].to_numpy(dtype=float)
    logs = np.array(_logs(place, cut), dtype=bool)
    if not np.isfinite(X).all() or (X[:, logs] <= 0).any():
        wanted = "above zero" if logs.any() else "that are finite"
        raise FitError(f"{law.response}: the candidates hold {X.min():g}; levels are numbers {wanted}.")
    if cut.level is None or place.by is None:
        return X, None
    return X, level_names(table[place.by], place.levels, place.by)


def _plan(law: LawFit, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> pd.DataFrame:
    place = law.region
    keys = _settings(place, cut, cut.X, cut.level)
    here = _settings(place, cut, X, level)
    same = [keys.index(key) if key in keys else None for key in here]
    point = ["new" if j is None else f"repeat of {cut.label[j]}" for j in same]
    plan = pd.DataFrame({"run": np.arange(1, len(X) + 1), "edge": _new_names(cut, len(X)), "point": point})
    for j, name in enumerate(cut.names):
        plan[name] = round_significant(X[:, j], 12)
    if level is not None and place.by is not None:
        plan[place.by] = level
    return plan


def _new_names(cut: Trials, n: int) -> list[str]:
    """N01, N02 ...: none of them the name of a test already cut."""
    letter = "N"
    while any(name.startswith(letter) for name in cut.label):
        letter += "N"
    width = max(2, len(str(n)))
    return [f"{letter}{i:0{width}d}" for i in range(1, n + 1)]


def _words(law: LawFit, cut: Trials, n: int, criterion: str, gain: float) -> str:
    added = f"{n} more {cut.what}{'s' if n > 1 else ''}"
    why = {
        "repeats": f"{added} repeat settings already cut, since no setting was cut twice and pure error is unknown",
        "c-optimal": f"{added}, chosen for the interval of the decision",
    }.get(criterion, f"{added}, D-optimal over the {len(cut.X)} cut so far")
    estimated = " and ".join(["the constant", ", ".join(cut.names)] if cut.names else ["the constant"])
    return (
        f"{law.response}: {why}; the determinant of the information on {estimated} grows {gain:.3g} times, which "
        f"leaves {100 * gain**-0.5:.0f} % of the volume of the joint confidence region."
    )


def expected_readings(
    law: LawFit, plan: pd.DataFrame, durations: Callable[[pd.DataFrame], Array] | None = None
) -> list[dict[str, list[Any]]]:
    """Readings that each test of a plan is expected to give, by column: as many as an edge has had, at equal steps.

    Time steps to the duration of the test, or to the longest test so far; any other factor that changes within an edge
    steps over its range.
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
    if "t" in within:
        ends = np.full(len(plan), within["t"][1]) if durations is None else round_significant(durations(plan), 2)
        for test, end in zip(tests, ends, strict=True):
            test["t"] = (share * end).tolist()
    return tests


def _for_decision(
    law: LawFit, decision: Decision, n: int, durations: Callable[[pd.DataFrame], Array] | None, cut: Trials,
    X: Array, level: NDArray[np.object_] | None,
) -> Index:  # fmt: skip
    """Positions of the n settings, each at most twice, that leave least variance of a decision."""
    keys = _settings(law.region, cut, X, level)
    once = np.array([keys.index(key) for key in dict.fromkeys(keys)], dtype=np.intp)
    kept = once[np.unique(np.linspace(0, len(once) - 1, min(len(once), CHOICES)).astype(np.intp))]
    settings = _plan(law, cut, X[kept], None if level is None else level[kept])
    new = np.array([information_of_test(law, test) for test in expected_readings(law, settings, durations)])
    return np.asarray(
        kept[c_optimal(decision.gradient[estimated(law)], information(law), new, n, TWICE)], dtype=np.intp
    )
