"""Time in cut from lengths of cut that were written for each pass, or while the feed changed."""

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .derived import Array, Derived, Known
from .doubts import Doubt
from .draft import Draft

CONDITIONS = ("V", "n", "f", "fz", "fm", "d", "ae")
MOST, FEW = 0.9, 0.1  # shares of steps along an edge that rise
EQUAL = 1e-9


def summed(draft: Draft, known: Known, made: Derived) -> Derived:
    """The time in cut of an edge up to each row, and how it was made.

    Lengths that rise along an edge count from its start; their increments are divided by the speed of their row where
    the speed changes along an edge. Lengths that do not rise are of one pass each, and are summed over the edge. A
    mixture is taken as the first kind, with a doubt.
    """
    length = np.asarray(known.value(made.inputs[0]), dtype=np.float64)
    t: Array = np.asarray(draft.data["t"], dtype=np.float64)
    edge = _edges(draft)
    place = pd.Series(np.arange(len(edge))).groupby(edge)
    order = np.concatenate([np.asarray(rows) for rows in place.indices.values()])
    same = np.r_[False, edge[order][1:] == edge[order][:-1]]
    steps = np.where(same, np.diff(length[order], prepend=np.nan), np.nan)
    steps = steps[~np.isnan(steps)]
    if not steps.size:
        return made
    rising = float(np.mean(steps > 0))
    name = f"{made.inputs[0]} ({_header(draft, made.inputs[0])})"
    if rising <= FEW:
        draft.data["t"] = np.asarray(pd.Series(t).groupby(edge).cumsum(), dtype=float)
        if "edge" not in draft.data:
            draft.doubts.append(
                Doubt(
                    ("t", made.inputs[0]),
                    f"{name} does not rise: it is taken as the length of one pass, summed over rows of equal "
                    "conditions; a column of the edges is needed where two edges have the same conditions",
                )
            )
        words = "each row is one pass, and the passes of an edge are summed"
        return replace(made, equation=f"{made.equation}, summed", sentence=f"{made.sentence}; {words}")
    if rising < MOST:
        draft.doubts.append(
            Doubt(
                ("t", made.inputs[0]),
                f"{name} rises in {100 * rising:.0f} % of the steps along an edge: it is taken as counted from a new "
                "edge; write the time in cut, or the length since the edge was new",
            )
        )
        return made
    with np.errstate(all="ignore"):
        speed = (length / t)[order]
        changes = np.nanmax(np.where(same, np.abs(speed / np.r_[np.nan, speed[:-1]] - 1), 0), initial=0)
    if changes <= EQUAL:
        return made
    increments = np.where(same, np.diff(length[order], prepend=0), length[order]) / speed
    sums = np.asarray(pd.Series(increments).groupby(edge[order]).cumsum(), dtype=float)
    t[order] = sums
    words = "the speed changes along an edge, so increments of the length are divided by the speed of their row"
    return replace(made, equation=f"{made.equation}, summed", sentence=f"{made.sentence}; {words}")


def _edges(draft: Draft) -> NDArray[np.intp]:
    """Number of the edge of each row: by the column of edges, or else by runs of equal conditions."""
    labels = [draft.data[role] for role in ("tool", "work", "edge") if role in draft.data]
    if "edge" in draft.data:
        return np.asarray(
            pd.DataFrame(dict(enumerate(labels))).groupby(list(range(len(labels)))).ngroup(), dtype=np.intp
        )
    columns = [draft.data[role] for role in CONDITIONS if role in draft.data] + labels
    changed = np.zeros(len(draft.lines), dtype=bool)
    for values in columns:
        changed[1:] |= values[1:] != values[:-1]
    return np.cumsum(changed)


def _header(draft: Draft, role: str) -> str:
    return next((repr(use.name) for use in draft.uses if use.role == role), role)
