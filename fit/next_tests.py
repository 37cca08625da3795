"""D-optimal augmentation of a design: further tests, or repeats where pure error is unknown.

A test is an edge cut at one setting of what changes only between edges; time and wear then follow by themselves.
Where the file names no edges a test is a row. A design in which no setting was cut twice has no pure error: lack of
fit cannot be separated from differences between edges. Repeats then come first, at the most informative settings.

Adding rows to Z multiplies the determinant of Z'Z by ``det(I + A M A')`` with ``M = (Z'Z)^-1`` and A the added rows;
by the matrix determinant lemma one row z gains ``1 + z'Mz``, and swapping row a for row z, with M of both old and
added rows, ``(1 + z'Mz)(1 - a'Ma) + (z'Ma)^2``.

Sources: Myers, Montgomery & Anderson-Cook 2016, Response Surface Methodology, sections 2.7 and 8.3; Fedorov 1972,
Theory of Optimal Experiments, section 3.2; Cook & Nachtsheim 1980, Technometrics 22, 315 (exchange).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.errors import FitError, UsageError
from ..datasets import region
from ..datasets.design import round_significant
from .edges import changes_within
from .lawfit import LawFit
from .least_squares import linear
from .region import DesignRegion
from .rows import Points, as_table, level_names

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MOST = 1000  # tests in one plan
GRID = 20_000  # candidates at most
ALIKE = 4  # decimals of a coded level: closer settings are one
DIGITS = 4
GAIN = 1e-9  # a swap that gains less is rounding, and would go round in circles
STARTS = 8  # the greedy one, and random ones: exchange stops at a local best


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
    >>> from fitmodels.fit.next_tests import next_runs
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> plan = next_runs(law, 4, seed=1)
    >>> plan.attrs["criterion"], list(plan.columns)
    ('D-optimal', ['run', 'edge', 'point', 'V', 'f', 'd'])
    """
    if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= MOST:
        raise UsageError(f"n={n!r}: the number of tests to add is a whole number from 1 to {MOST}.")
    cut, place = trials(law), law.region
    old = _rows(place, cut, cut.X, cut.level)
    M = linear(old, np.zeros(len(old))).cov_unscaled
    repeats = candidates is None and not replicated(place, cut)
    X, level = _candidates(place, cut, repeats) if candidates is None else _given(law, place, cut, candidates)
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
    part = {"logs": place.logs, "centre": np.array(place.centre)[at], "half_range": np.array(place.half_range)[at]}
    return region.coded(part, X)


def _rows(place: DesignRegion, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> Array:
    """Columns of the law that a test sets: 1, coded factors, indicators; shape (T, p)."""
    shifts = [] if level is None else [(level == name).astype(float) for name in place.levels[1:]]
    return np.column_stack([np.ones(len(X)), _coded(place, cut, X), *shifts])


def _candidates(place: DesignRegion, cut: Trials, repeats: bool) -> tuple[Array, NDArray[np.object_] | None]:
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


def _reached(place: DesignRegion, cut: Trials, grid: Array, name: str | None) -> NDArray[np.bool_]:
    """Whether each setting of the grid lies in the region of the tests."""
    level = None if name is None else np.full(len(grid), name, dtype=object)
    old = _rows(place, cut, cut.X, cut.level)
    M = linear(old, np.zeros(len(old))).cov_unscaled
    h, largest = (np.einsum("ij,jk,ik->i", z, M, z) for z in (_rows(place, cut, grid, level), old))
    limit = largest.max() if cut.level is None else largest[cut.level == name].max(initial=0.0)
    far = np.square(_coded(place, cut, cut.X)).sum(axis=1).max()
    near = np.square(_coded(place, cut, grid)).sum(axis=1)
    return np.asarray((h <= limit * (1 + region.SLACK)) & (near <= far * (1 + region.SLACK)))


def _given(law: LawFit, place: DesignRegion, cut: Trials, given: Points) -> tuple[Array, NDArray[np.object_] | None]:
    """Candidates given by the user."""
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
    return X, level_names(table[place.by], place.levels, place.by)


def _plan(place: DesignRegion, cut: Trials, X: Array, level: NDArray[np.object_] | None) -> pd.DataFrame:
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
    estimated = ", ".join(cut.names) or "the constant"
    return (
        f"{law.response}: {why}; the determinant of the information on {estimated} grows {gain:.3g} times, which "
        f"leaves {100 * gain**-0.5:.0f} % of the volume of the joint confidence region."
    )


def d_optimal(M: Array, candidates: Array, n: int, most: int, rng: np.random.Generator) -> tuple[Index, float]:
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


def _greedy(M: Array, candidates: Array, n: int, most: int) -> Index:
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


def _exchanged(M: Array, candidates: Array, start: Index, most: int) -> Index:
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
