"""Which rows a law is fitted to: chosen once, and every row that is left out is counted and named."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.display import Displayable
from ..core.errors import FitError, UsageError
from ..datasets import Runs

Array = NDArray[np.float64]

# Fewer distinct rows than this may repeat by chance, where a gauge reads to 0.01 mm.
FEWEST = 4


@dataclass(frozen=True, slots=True, repr=False)
class Dropped(Displayable):
    """Rows that a fit leaves out: why, how many, and the first lines of the file they stand in."""

    reason: str
    count: int
    lines: tuple[int, ...]


@dataclass(frozen=True, slots=True, repr=False)
class By(Displayable):
    """A category whose level shifts a law: its column, the level of reference and the others."""

    column: str
    reference: str
    levels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Rows:
    """The numbers that one fit sees.

    Attributes
    ----------
    X : ndarray, shape (n, k)
        Factors, in the units of the runs.
    y : ndarray, shape (n,)
        Response.
    shifts : ndarray, shape (n, s)
        One indicator column for each level beyond the reference.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    edge : ndarray of str, shape (n,), or None
        Cutting edge of each row.
    by : By or None
    dropped : tuple of Dropped
    repeats : int
        How often each measurement was repeated in the file; 1 where rows are rows.
    """

    X: Array
    y: Array
    shifts: Array
    lines: NDArray[np.intp]
    edge: NDArray[np.object_] | None
    by: By | None
    dropped: tuple[Dropped, ...]
    repeats: int

    def factors(self, keep: Sequence[int]) -> Array:
        """Columns ``keep`` of X."""
        return self.X[:, list(keep)]


def select(
    runs: Runs,
    response: str,
    factors: Sequence[str],
    *,
    by: str | None = None,
    edge: str | None = "edge",
    positive: Literal["all", "factors", "none"] = "all",
) -> Rows:
    """Rows of ``runs`` in which response, factors and category are there and, where asked, above zero."""
    if not factors:
        raise UsageError(f"{response}: no factor is named; a law needs at least one, for instance V.")
    if response in factors:
        raise UsageError(f"{response} is the response and cannot be its own factor; leave it out of the factors.")
    columns = {name: runs.values(name) for name in (response, *factors)}
    level = runs.labels(by) if by is not None else None
    keep = np.ones(len(runs), dtype=bool)
    dropped: list[Dropped] = []
    lines = np.asarray(runs.lines)

    def drop(bad: NDArray[np.bool_], reason: str) -> None:
        bad = bad & keep
        if bad.any():
            dropped.append(Dropped(reason, int(bad.sum()), tuple(int(i) for i in lines[bad][:5])))
            keep[bad] = False

    for name, values in columns.items():
        drop(np.isnan(values), f"{name} missing")
    if by is not None and level is not None:
        drop(np.asarray(level == "", dtype=bool), f"{by} missing")
    must_be_positive = {"all": columns, "factors": list(factors), "none": []}[positive]
    for name in must_be_positive:
        drop(columns[name] <= 0, f"{name} zero or negative")
    labels = runs.labels(edge) if edge is not None and runs.has(edge) else None
    keep, repeats = _without_copies(columns, (labels, level), keep)
    shifts, category = _indicators(level, keep, by)
    return Rows(
        X=np.column_stack([columns[name][keep] for name in factors]),
        y=columns[response][keep],
        shifts=shifts,
        lines=lines[keep],
        edge=None if labels is None else labels[keep],
        by=category,
        dropped=tuple(dropped),
        repeats=repeats,
    )


def _without_copies(
    columns: dict[str, Array],
    labels: tuple[NDArray[np.object_] | None, ...],
    keep: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], int]:
    """Keep one row of each measurement where a file repeats every one of them.

    A mean force written beside six roughness readings is one measurement, not six. Only the plain case
    counts: every distinct row (response, factors, edge and category, to all digits) stands there 6, 12 ...
    times.
    """
    table = pd.DataFrame({name: values[keep] for name, values in columns.items()})
    if len(table) < 2 * FEWEST or _alone(table):
        return keep, 1
    for i, label in enumerate(labels):
        if label is not None:
            table[f"label {i} of the row"] = label[keep]
    group = table.groupby(list(table.columns), sort=False)
    counts = group.size().to_numpy()
    repeats = int(np.gcd.reduce(counts))
    if repeats < 2 or len(counts) < FEWEST:
        return keep, 1
    kept = keep.copy()
    kept[np.flatnonzero(keep)[group.cumcount().to_numpy() % repeats > 0]] = False
    return kept, repeats


def _alone(table: pd.DataFrame) -> bool:
    """Whether the first row has no equal, which settles that not every row has one."""
    equal = np.ones(len(table), dtype=bool)
    for name in table:
        values = table[name].to_numpy()
        equal &= values == values[0]
    return bool(equal.sum() == 1)


def _indicators(level: NDArray[np.object_] | None, keep: NDArray[np.bool_], by: str | None) -> tuple[Array, By | None]:
    if level is None or by is None:
        return np.empty((int(keep.sum()), 0)), None
    names = sorted(set(level[keep]))
    if len(names) < 2:
        raise FitError(
            f"by={by!r}: the usable rows hold one level only ({', '.join(names) or 'none'}); "
            "a shift needs two. Fit without by."
        )
    shifts = np.column_stack([(level[keep] == name).astype(float) for name in names[1:]])
    return shifts, By(by, names[0], tuple(names[1:]))
