"""Further tests for a design: most informative for a law, for a decision, or repeats where pure error is unknown.

A test is an edge cut at one setting of what changes only between edges; time and wear then follow by themselves.
Where the file names no edges a test is a row. A design in which no setting was cut twice has no pure error: lack of
fit cannot be separated from differences between edges. Repeats then come first, at the most informative settings.

Source: Myers, Montgomery & Anderson-Cook 2016, Response Surface Methodology, sections 2.7 and 8.3.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags, Ints, Texts
from ..core.censored import RUN_OUT
from ..core.errors import FitError, UsageError
from ..datasets import region
from ..datasets.design import round_significant
from ..datasets.vocabulary import ROLES
from .checks.model_checks import HIGH_VIF
from .decisions import Decision
from .edges import changes_within
from .lawfit import LawFit
from .least_squares import linear
from .optimal_tests import (
    c_optimal,
    d_optimal,
    determinant_gain,
    estimated,
    expected_readings,
    information,
    information_of_test,
)
from .region import SETTABLE, DesignRegion, in_box, inflation
from .rows import Points, as_table, level_names

MOST = 1000  # tests in one plan
GRID = 20_000  # candidates at most
ALIKE = 4  # decimals of a coded level: closer settings are one
DIGITS = 4
CHOICES = 700  # settings at most to choose from for a decision
TWICE = 2  # tests of one setting at most
UNLIMITED = 1e6  # variance inflation of factors that follow others exactly
RIDGE = 1e-6  # added to the information of factors that follow others exactly
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
    place : DesignRegion
        Ranges of the factors.
    """

    what: str
    names: tuple[str, ...]
    X: Array
    level: Texts | None
    label: tuple[str, ...]
    place: DesignRegion


def next_runs(
    law: LawFit,
    n: int,
    *,
    candidates: Points | None = None,
    decision: Decision | None = None,
    durations: Callable[[pd.DataFrame], Array] | None = None,
    longest: float | None = None,
    left_out: Mapping[str, Array] | None = None,
    seed: int = 1,
) -> pd.DataFrame:
    """Plan n further tests for a law.

    Parameters
    ----------
    law : LawFit
    n : int
        How many edges (or rows, where the file names no edges) to add, 1 to 1000.
    candidates : mapping or DataFrame, optional
        Settings to choose from, a column for each factor that a test sets (and the category). Left out: where factors
        vary together, the tested range of each of them, so that their exponents can be separated; else repeats of
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
    left_out : mapping of ndarray, shape (n,), optional
        Values, in the rows of the law, of settings that it left out because they follow others; they are planned too.
    seed : int
        Seed of the run order, and of the search's random starts.

    Returns
    -------
    DataFrame, one row a test in run order: run (1..n), edge (a new name), point (``repeat of E03`` or ``new``), the
    factors in the units of the law and the category, and t where ``durations`` are given. ``attrs``: criterion
    ("separating", "repeats", "D-optimal" or "c-optimal"), determinant_gain (of the information matrix of the tests),
    volume (what is left of the volume of the joint confidence region), units, words, together (factors that vary
    together), and readings: a table of the expected readings of each test, for `decisions.narrowing`.

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
    cut, rng = trials(law, left_out), np.random.default_rng(seed)
    together = varying_together(cut) if candidates is None and decision is None else ()
    repeats = candidates is None and decision is None and not together and not replicated(cut)
    X, level = _candidates(law, cut, repeats, together != ()) if candidates is None else _given(law, cut, candidates)
    every = np.ones(len(X), dtype=bool)
    ends = every if candidates is not None or left_out else _ends_in_time(law, cut, X, level, longest)
    X, level = X[ends], None if level is None else level[ends]
    M = _uncertainty(law, cut, together != ())
    if decision is None:
        chosen, gain = d_optimal(M, _rows(law, cut, X, level), n, -(-n // len(X)) if repeats else n, rng)
    else:
        chosen = _for_decision(law, decision, n, durations, cut, X, level)
        gain = determinant_gain(M, _rows(law, cut, X, level)[chosen])
    chosen = rng.permutation(chosen)
    plan = _plan(cut, X[chosen], None if level is None else level[chosen])
    readings = expected_readings(law, plan, durations)
    if durations is not None and "t" in law.factors:
        plan["t"] = [test["t"][-1] for test in readings]
    kinds = {"c-optimal": decision is not None, "separating": together != (), "repeats": repeats, "D-optimal": True}
    criterion = next(name for name, holds in kinds.items() if holds)
    words = _separation(law, cut, plan, together) if together else _words(law, cut, len(plan), criterion, gain)
    units = dict(zip(cut.place.factors, cut.place.units, strict=True))
    facts: dict[str, object] = {
        "criterion": criterion,
        "determinant_gain": gain,
        "volume": gain**-0.5,
        "units": {name: unit for name, unit in units.items() if name in plan and unit},
        "words": words + ("" if ends.all() else RUN_OUTS.format(law.response)),
        "together": together,
        "readings": readings,
    }
    plan.attrs.update(facts)
    return plan


def candidate_settings(law: LawFit) -> pd.DataFrame:
    """Settings that further tests are chosen from: those already cut, and a grid over the region of the design."""
    cut = trials(law)
    X, level = _candidates(law, cut, repeats=False)
    return _plan(cut, X, level).drop(columns=["run", "edge", "point"])


def trials(law: LawFit, left_out: Mapping[str, Array] | None = None) -> Trials:
    """The tests a law was fitted to: its edges, each once, or its rows where the file names no edges.

    ``left_out`` are values, in the rows of the law, of settings that it left out.
    """
    columns = np.hstack([np.ones((law.nobs, 1)), law.X, law.shifts])
    first, what, within = np.arange(law.nobs), "row", np.zeros(columns.shape[1], dtype=bool)
    label = tuple(f"line {line}" for line in law.lines)
    if law.edge is not None:
        names, first, number = np.unique(law.edge, return_index=True, return_inverse=True)
        what, within, label = "edge", changes_within(columns, number), tuple(str(name) for name in names)
    keep = [j for j in range(len(law.factors)) if not within[1 + j]]
    level = _levels_of_rows(law)
    level = None if level is None or within[1 + len(law.factors) :].any() else level[first]
    more = {name: x[first] for name, x in (left_out or {}).items()}
    are_set, X = (*(law.factors[j] for j in keep), *more), np.column_stack([law.X[first][:, keep], *more.values()])
    return Trials(what, are_set, X, level, label, law.region.with_factors(more))


def varying_together(cut: Trials) -> tuple[str, ...]:
    """Settings of the machine that the tests did not vary independently: with a variance inflation above 10.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> varying_together(trials(law))
    ()
    """
    return tuple(name for name, size in _inflated(cut, cut.X).items() if size > HIGH_VIF and name in SETTABLE)


def _inflated(cut: Trials, X: Array) -> dict[str, float]:
    """Variance inflation of each setting in tests at X; time and wear, which follow from them, are none."""
    are_set = [j for j, name in enumerate(cut.names) if name not in ROLES or ROLES[name].kind not in ("time", "wear")]
    found = inflation(cut.place.coded(cut.names, X)[:, are_set])
    return {cut.names[j]: size for j, size in zip(are_set, found.tolist(), strict=True)}


def _uncertainty(law: LawFit, cut: Trials, together: bool) -> Array:
    """``(Z'Z)^-1`` of the tests so far; of factors that vary together with a little information added to each."""
    old = _rows(law, cut, cut.X, cut.level)
    if together:
        return np.asarray(np.linalg.inv(old.T @ old + RIDGE * np.eye(old.shape[1])))
    return linear(old, np.zeros(len(old))).cov_unscaled


def replicated(cut: Trials) -> bool:
    """Whether some setting was cut more than once."""
    return len(set(_settings(cut, cut.X, cut.level))) < len(cut.X)


def _settings(cut: Trials, X: Array, level: Texts | None) -> list[tuple[object, ...]]:
    """Each setting as a key: two that differ in rounding only have the same."""
    U = np.round(cut.place.coded(cut.names, X), ALIKE) + 0.0
    names = [""] * len(X) if level is None else [str(name) for name in level]
    return [(*u, name) for u, name in zip(map(tuple, U.tolist()), names, strict=True)]


def _rows(law: LawFit, cut: Trials, X: Array, level: Texts | None) -> Array:
    """Columns of the law that a test sets: 1, coded factors (of second order their terms), indicators; shape (T, p)."""
    shifts = [] if level is None else [(level == name).astype(float) for name in cut.place.levels[1:]]
    U = cut.place.coded(cut.names, X)
    if not law.formula.first_order:
        at = [law.factors.index(name) for name in cut.names]
        powers = [np.array(term.degrees) for term in law.formula.terms]
        U = np.column_stack([np.prod(U ** d[at], axis=1) for d in powers if d[at].sum() == d.sum()] or [U[:, :0]])
    return np.column_stack([np.ones(len(X)), U, *shifts])


def _candidates(law: LawFit, cut: Trials, repeats: bool, together: bool = False) -> tuple[Array, Texts | None]:
    """Settings already cut, each once; unless repeats are wanted a grid, over the region or all tested ranges."""
    keys, place = _settings(cut, cut.X, cut.level), cut.place
    once = [keys.index(key) for key in dict.fromkeys(keys)]
    X, level = cut.X[once], None if cut.level is None else cut.level[once]
    if repeats or not cut.names:
        return X, level
    levels = [None] if cut.level is None else list(place.levels)
    steps = next(s for s in (9, 5, 3, 2) if s == 2 or s ** len(cut.names) * len(levels) <= GRID)
    grid = round_significant(place.grid(cut.names, steps), DIGITS)
    kept = [grid[_combined(cut, grid, name) if together else _reached(law, cut, grid, name)] for name in levels]
    if level is None:
        return np.vstack([X, *kept]), None
    names = np.repeat(np.array(levels, dtype=object), [len(part) for part in kept])
    return np.vstack([X, *kept]), np.concatenate([level, names])


def _reached(law: LawFit, cut: Trials, grid: Array, name: str | None) -> Flags:
    """Whether each setting of the grid lies in the region of the tests."""
    level = None if name is None else np.full(len(grid), name, dtype=object)
    old, M = _rows(law, cut, cut.X, cut.level), _uncertainty(law, cut, False)
    h, largest = (np.einsum("ij,jk,ik->i", z, M, z) for z in (_rows(law, cut, grid, level), old))
    limit = largest.max() if cut.level is None else largest[cut.level == name].max(initial=0.0)
    return np.asarray((h <= limit * (1 + region.SLACK)) & _near(cut, grid))


def _near(cut: Trials, grid: Array) -> Flags:
    """Whether each setting of the grid is no further from the centre than the outermost test."""
    near, far = (np.square(cut.place.coded(cut.names, X)).sum(axis=1) for X in (grid, cut.X))
    return np.asarray(near <= far.max() * (1 + region.SLACK))


def _combined(cut: Trials, grid: Array, name: str | None) -> Flags:
    """Whether each setting of the grid combines values that were cut at this level, and loads the tool no more."""
    return in_box(cut.names, cut.X if name is None else cut.X[cut.level == name], grid) & _near(cut, grid)


def _ends_in_time(law: LawFit, cut: Trials, X: Array, level: Texts | None, longest: float | None) -> Flags:
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
        keys = _settings(cut, law.X, None if cut.level is None else _levels_of_rows(law))  # a life is a row
        ended = {key for key, side in zip(keys, law.rows.side.tolist(), strict=True) if side != RUN_OUT}
        only_run_outs = {*keys} - ended
        kept &= np.array([key not in only_run_outs for key in _settings(cut, X, level)])
    return kept if kept.any() else every


def _levels_of_rows(law: LawFit) -> Texts | None:
    """Level of the category of each row, None without one."""
    if law.by is None:
        return None
    known = np.array([law.by.reference, *law.by.levels], dtype=object)
    return np.asarray(known[(law.shifts @ np.arange(1, len(known))).astype(int)], dtype=object)


def _given(law: LawFit, cut: Trials, given: Points) -> tuple[Array, Texts | None]:
    """Candidates given by the user."""
    place, table = cut.place, as_table(law.response, given)
    needed = (*cut.names, *([place.by] if cut.level is not None and place.by else []))
    missing = [name for name in needed if name not in table]
    if missing or not len(table):
        lack = f"lack {', '.join(missing)}" if missing else "are none"
        raise FitError(f"{law.response}: the candidates {lack}; a test sets {', '.join(needed) or 'nothing'}.")
    X = table[list(cut.names)].to_numpy(dtype=float)
    logs = np.array(cut.place.logs_of(cut.names), dtype=bool)
    if not np.isfinite(X).all() or (X[:, logs] <= 0).any():
        wanted = "above zero" if logs.any() else "that are finite"
        raise FitError(f"{law.response}: the candidates hold {X.min():g}; levels are numbers {wanted}.")
    if cut.level is None or place.by is None:
        return X, None
    return X, level_names(table[place.by], place.levels, place.by)


def _plan(cut: Trials, X: Array, level: Texts | None) -> pd.DataFrame:
    place, keys, here = cut.place, _settings(cut, cut.X, cut.level), _settings(cut, X, level)
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


def _separation(law: LawFit, cut: Trials, plan: pd.DataFrame, together: tuple[str, ...]) -> str:
    """What tests that separate factors are chosen for, with the variance inflation before and after."""
    both = np.vstack([cut.X, plan[list(cut.names)].to_numpy(dtype=float)])
    now, then = (max(_inflated(cut, X)[name] for name in together) for X in (cut.X, both))
    size = "without limit" if now > UNLIMITED else f"{now:.2g}"
    return (
        f"{law.response}: {len(plan)} more {cut.what}{'s' if len(plan) > 1 else ''}, D-optimal over the tested range "
        f"of each factor, since {', '.join(together)} varied together in the tests so far; the largest variance "
        f"inflation is {size} now and {then:.2g} after these tests."
    )


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


def _for_decision(
    law: LawFit, decision: Decision, n: int, durations: Callable[[pd.DataFrame], Array] | None, cut: Trials,
    X: Array, level: Texts | None,
) -> Ints:  # fmt: skip
    """Positions of the n settings, each at most twice, that leave least variance of a decision."""
    keys = _settings(cut, X, level)
    once = np.array([keys.index(key) for key in dict.fromkeys(keys)], dtype=np.intp)
    kept = once[np.unique(np.linspace(0, len(once) - 1, min(len(once), CHOICES)).astype(np.intp))]
    settings = _plan(cut, X[kept], None if level is None else level[kept])
    new = np.array([information_of_test(law, test) for test in expected_readings(law, settings, durations)])
    return np.asarray(
        kept[c_optimal(decision.gradient[estimated(law)], information(law), new, n, TWICE)], dtype=np.intp
    )
