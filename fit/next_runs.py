"""Which tests to cut next: those that tell the exponents best, or the repeats that pure error lacks.

A test is an edge cut at one setting of what changes only between edges; time and wear then follow by themselves.
Where the file names no edges a test is a row.

A design in which no setting was cut twice has no pure error: nobody can say whether a law misses because its form
is wrong or because edges differ. Repeats then come first, at those settings that also tell the exponents best.

Source: Myers, Montgomery & Anderson-Cook 2016, Response Surface Methodology, sections 2.7 and 8.3.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.errors import FitError, UsageError
from ..datasets import region
from ..datasets.design import round_significant
from .domain import Domain, Points, changes_within, domain
from .exchange import d_optimal
from .lawfit import LawFit, as_table
from .linear import linear

Array = NDArray[np.float64]

MOST = 1000  # tests in one plan
GRID = 20_000  # candidates at most
ALIKE = 4  # decimals of a coded level: closer settings are one
DIGITS = 4


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


def next_runs(law: LawFit, n: int, *, candidates: Points | None = None, seed: int = 1) -> pd.DataFrame:
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
    seed : int
        Seed of the run order, and of the search's random starts.

    Returns
    -------
    DataFrame, one row a test in run order: run (1..n), edge (a new name), point (``repeat of E03`` or ``new``), the
    factors in the units of the law and the category. ``attrs``: criterion ("repeats" or "D-optimal"),
    determinant_gain (of the information matrix of the tests), volume (what is left of the volume of the joint
    confidence region), units, and words.

    Raises
    ------
    UsageError
        n out of bounds.
    FitError
        Candidates that lack a factor.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.next_runs import next_runs
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> plan = next_runs(law, 4, seed=1)
    >>> plan.attrs["criterion"], list(plan.columns)
    ('D-optimal', ['run', 'edge', 'point', 'V', 'f', 'd'])
    """
    if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= MOST:
        raise UsageError(f"n={n!r}: the number of tests to add is a whole number from 1 to {MOST}.")
    cut, place = trials(law), domain(law)
    old = _rows(place, cut, cut.X, cut.level)
    M = linear(old, np.zeros(len(old))).cov_unscaled
    repeats = candidates is None and not replicated(place, cut)
    X, level = _candidates(place, cut, repeats) if candidates is None else _asked(law, place, cut, candidates)
    rng = np.random.default_rng(seed)
    most = -(-n // len(X)) if repeats else n
    chosen, gain = d_optimal(M, _rows(place, cut, X, level), n, most, rng)
    chosen = rng.permutation(chosen)
    plan = _plan(place, cut, X[chosen], None if level is None else level[chosen])
    criterion = "repeats" if repeats else "D-optimal"
    facts: dict[str, object] = {
        "criterion": criterion,
        "determinant_gain": gain,
        "volume": gain**-0.5,
        "units": {name: law.units[name] for name in cut.names if law.units.get(name)},
        "words": _words(law, cut, n, criterion, gain),
    }
    plan.attrs.update(facts)
    return plan


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


def replicated(place: Domain, cut: Trials) -> bool:
    """Whether some setting was cut more than once."""
    return len(set(_settings(place, cut, cut.X, cut.level))) < len(cut.X)


def _settings(place: Domain, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> list[tuple[object, ...]]:
    """Each setting as a key: two that differ in rounding only have the same."""
    U = np.round(_coded(place, cut, X), ALIKE) + 0.0
    names = [""] * len(X) if level is None else [str(name) for name in level]
    return [(*u, name) for u, name in zip(map(tuple, U.tolist()), names, strict=True)]


def _coded(place: Domain, cut: Trials, X: Array) -> Array:
    at = [place.factors.index(name) for name in cut.names]
    part = {"logs": place.logs, "centre": np.array(place.centre)[at], "half_range": np.array(place.half_range)[at]}
    return region.coded(part, X)


def _rows(place: Domain, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> Array:
    """Columns of the law that a test tells: 1, coded factors, indicators; shape (T, p)."""
    shifts = [] if level is None else [(level == name).astype(float) for name in place.levels[1:]]
    return np.column_stack([np.ones(len(X)), _coded(place, cut, X), *shifts])


def _candidates(place: Domain, cut: Trials, repeats: bool) -> tuple[Array, NDArray[np.object_] | None]:
    """Settings already cut, each once; and a grid over the region, unless repeats are wanted."""
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
    grid = round_significant(np.exp(terms) if place.logs else terms, DIGITS)
    kept = [grid[_reached(place, cut, grid, name)] for name in levels]
    if level is None:
        return np.vstack([X, *kept]), None
    names = np.repeat(np.array(levels, dtype=object), [len(part) for part in kept])
    return np.vstack([X, *kept]), np.concatenate([level, names])


def _reached(place: Domain, cut: Trials, grid: Array, name: str | None) -> NDArray[np.bool_]:
    """Which settings of the grid the region of the tests reaches: no further out than the furthest test."""
    level = None if name is None else np.full(len(grid), name, dtype=object)
    old = _rows(place, cut, cut.X, cut.level)
    M = linear(old, np.zeros(len(old))).cov_unscaled
    h, largest = (np.einsum("ij,jk,ik->i", z, M, z) for z in (_rows(place, cut, grid, level), old))
    limit = largest.max() if cut.level is None else largest[cut.level == name].max(initial=0.0)
    far = np.square(_coded(place, cut, cut.X)).sum(axis=1).max()
    near = np.square(_coded(place, cut, grid)).sum(axis=1)
    return np.asarray((h <= limit * (1 + region.SLACK)) & (near <= far * (1 + region.SLACK)))


def _asked(law: LawFit, place: Domain, cut: Trials, given: Points) -> tuple[Array, NDArray[np.object_] | None]:
    """Candidates of the user's own."""
    table = as_table(law.response, given)
    needed = (*cut.names, *([place.by] if cut.level is not None and place.by else []))
    missing = [name for name in needed if name not in table]
    if missing or not len(table):
        lack = f"lack {', '.join(missing)}" if missing else "are none"
        raise FitError(f"{law.response}: the candidates {lack}; a test sets {', '.join(needed) or 'nothing'}.")
    X = table[list(cut.names)].to_numpy(dtype=float)
    if not np.isfinite(X).all() or (place.logs and (X <= 0).any()):
        wanted = "above zero" if place.logs else "that are finite"
        raise FitError(f"{law.response}: the candidates hold {X.min():g}; levels are numbers {wanted}.")
    if cut.level is None or place.by is None:
        return X, None
    level = np.array([f"{v:.15g}" if isinstance(v, float) else str(v) for v in table[place.by]], dtype=object)
    strange = sorted(set(level) - set(place.levels))
    if strange:
        raise FitError(f"{place.by} {strange[0]!r} of a candidate is not among the fitted: {', '.join(place.levels)}.")
    return X, level


def _plan(place: Domain, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> pd.DataFrame:
    keys = _settings(place, cut, cut.X, cut.level)
    here = _settings(place, cut, X, level)
    same = [keys.index(key) if key in keys else None for key in here]
    point = ["new" if j is None else f"repeat of {cut.label[j]}" for j in same]
    plan = pd.DataFrame({"run": np.arange(1, len(X) + 1), "edge": _new_names(cut, len(X)), "point": point})
    for j, name in enumerate(cut.names):
        plan[name] = X[:, j]
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
    why = (
        f"{added} repeat settings already cut, since no setting was cut twice and pure error is unknown"
        if criterion == "repeats"
        else f"{added}, D-optimal over the {len(cut.X)} cut so far"
    )
    told = ", ".join(cut.names) or "the constant"
    return (
        f"{law.response}: {why}; the determinant of the information on {told} grows {gain:.3g} times, which leaves "
        f"{100 * gain**-0.5:.0f} % of the volume of the joint confidence region."
    )
