"""Checks of joined cuts against the table of tests: durations against times, loads against the chip cross-section."""

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Array
from .joining import Plan, column_values

AGREE = 0.25  # deviation of a duration from the time in the plan
FEWEST = 8  # rows
VARIED = 1.5  # ratio of the largest to the smallest chip cross-section that moves a load beyond its scatter
RISES = 0.3  # rank correlation of a load with the chip cross-section


def duration_remarks(plan: Plan, durations: Array) -> dict[int, str]:
    """Remark of each row whose cut is shorter or longer than its time in the plan, where the others agree.

    ``durations`` has shape (rows,), s.
    """
    t = column_values(plan.table, "t")
    if t is None or not any(plan.edges):
        return {}
    steps = np.full(len(t), np.nan)
    last: dict[str, float] = {}
    for row, edge in enumerate(plan.edges):
        steps[row] = 60 * (t[row] - last.get(edge, 0.0))
        last[edge] = float(t[row])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = durations / np.where(steps > 0, steps, np.nan)
    agree = np.abs(ratio - 1) <= AGREE
    if np.count_nonzero(agree) < 0.7 * np.count_nonzero(np.isfinite(ratio)):
        return {}
    return {
        int(row): f"the cut lasts {durations[row]:.3g} s, and t rises by {steps[row]:.3g} s"
        for row in np.flatnonzero(np.isfinite(ratio) & ~agree)
    }


def load_doubts(plan: Plan, loads: Sequence[tuple[str, Array]]) -> list[str]:
    """A doubt where the largest load does not rise with feed times depth: cuts and rows may not correspond.

    ``loads`` holds the symbol and the means, shape (rows,), of each channel.
    """
    factors = [column_values(plan.table, symbol) for symbol in ("f", "fz", "fm", "d", "ae")]
    given = [values for values in factors if values is not None]
    if not given or not loads:
        return []
    section = np.prod(given, axis=0)
    name, load = max(loads, key=lambda item: (item[0] not in ("I", "P", "M"), float(np.nanmedian(np.abs(item[1])))))
    if name in ("P", "I", "M") and (V := column_values(plan.table, "V")) is not None and name != "M":
        section = section * V
    known = np.isfinite(section) & np.isfinite(load) & (section > 0)
    if np.count_nonzero(known) < FEWEST or section[known].max() < VARIED * section[known].min():
        return []
    rank = _rank_correlation(section[known], np.abs(load[known]))
    if rank >= RISES:
        return []
    return [
        f"{name} does not rise with feed and depth (rank correlation {rank:.2f}): check in the pictures and in the "
        "column record that cuts and rows correspond"
    ]


def _rank_correlation(x: Array, y: Array) -> float:
    from scipy.stats import rankdata

    return float(np.corrcoef(rankdata(x), rankdata(y))[0, 1])
