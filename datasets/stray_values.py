"""Single cells of a file of tests that are impossible or far from all others, and levels shifted by a known factor."""

import numpy as np
from numpy.typing import NDArray

from ..core.rounding import format_decimal
from .doubts import Doubt
from .draft import Draft
from .options import Process, ReadOptions
from .quantities import table_process
from .ranges import plausible
from .vocabulary import ROLES

FACTORS = {10.0: "a decimal mark", 100.0: "a decimal mark", 1000.0: "a decimal mark or a unit", 25.4: "a unit, inch"}
LATTICE = (25.4, 3.280839895, 60.0, 10.0, 1000.0)
NEAR = 0.012  # of a level, for values rounded in another unit
GAP = 1.3  # ratio between the shifted rows and the others; a plan may span a decade, so a factor of 10 needs more
FAR = 3.0  # ratio to the next value beyond which a single cell is doubted
FEWEST = 8  # rows below which no cell is judged by the others
MOST_LEVELS = 7
MOST_VALUES = 500  # different values beyond which a column has no levels
SAMPLE = 20000
LISTED = 4

Array = NDArray[np.float64]


def check_cells(draft: Draft, options: ReadOptions) -> None:
    """Leave out single cells that are impossible, and doubt those that are far from all others."""
    process = table_process(draft, options)
    for use in draft.uses:
        if use.role is None or use.role in options.ranges or not ROLES[use.role].unit:
            continue
        values = np.asarray(draft.data[use.role], dtype=float)
        if len(values) >= FEWEST:
            draft.data[use.role] = values = _without_impossible(draft, use.role, values, process)
            _doubt_far(draft, use.role, values)


def _without_impossible(draft: Draft, role: str, values: Array, process: Process | None) -> Array:
    """The values, NaN where a few are impossible."""
    ranges = plausible(role, process)
    if ranges is None:
        return values
    wrong = np.flatnonzero(np.abs(values) > ranges.hard[1])  # negative ones are left out by the fit, by name
    if not 0 < len(wrong) <= max(1, len(values) // 20):
        return values
    kept = values.copy()
    kept[wrong] = np.nan
    unit, low, high = ROLES[role].unit, *map(format_decimal, ranges.usual)
    sentence = (
        f"{places(draft, wrong)}: {role} {listed(values[wrong])} {unit} cannot be (usual {low} to {high}) "
        f"and is left out"
        f"{_cause(float(values[wrong[0]]), kept)}"
    )
    draft.doubts.append(Doubt((role,), sentence))
    return kept


def _doubt_far(draft: Draft, role: str, values: Array) -> None:
    """Doubt one cell that is several times the next: a wrong decimal mark or unit in a single cell."""
    if role == "T":
        return
    size = np.abs(values)
    known = size[size > 0]
    if len(known) < FEWEST:
        return
    lows = ROLES[role].kind not in ("time", "wear")  # both begin near zero
    for far, beyond in (
        (known.max(), size > known.max() / FAR),
        (known.min(), (size < known.min() * FAR) & (size > 0)),
    ):
        if (far == known.min() and not lows) or np.count_nonzero(beyond) != 1:
            continue
        row = np.flatnonzero(beyond)
        rest = np.where(beyond, np.nan, size)
        ends = f"{format_decimal(np.nanmin(np.where(rest > 0, rest, np.nan)))} to {format_decimal(np.nanmax(rest))}"
        sentence = (
            f"{places(draft, row)}: {role} {listed(values[row])} {ROLES[role].unit} is far from all other rows, "
            f"which hold {ends}{_cause(float(far), rest)}"
        )
        draft.doubts.append(Doubt((role,), sentence))


def _cause(value: float, rest: Array) -> str:
    """The likely cause of a stray value: a factor that brings it among the others."""
    known = np.abs(rest[np.isfinite(rest) & (rest != 0)])
    if value <= 0 or not known.size:
        return "; a sign or a missing value" if value < 0 else ""
    low, high = np.quantile(known, [0.05, 0.95])
    for factor, cause in FACTORS.items():
        for moved in (value / factor, value * factor):
            if low <= moved <= high:
                return f"; {format_decimal(moved)} if {cause} is wrong (x{factor:g})"
    return ""


def check_levels(draft: Draft, options: ReadOptions) -> None:
    """Doubt rows of a condition whose values are levels of the other rows in another unit, and single near misses."""
    for use in draft.uses:
        if use.role is None or use.role in options.ranges or ROLES[use.role].kind != "condition":
            continue
        values = np.asarray(draft.data[use.role], dtype=float)
        if len(values) >= FEWEST and not _doubt_shifted(draft, use.role, values):
            _doubt_single(draft, use.role, values)


def _doubt_shifted(draft: Draft, role: str, values: Array) -> bool:
    """Whether a minority of rows lies outside the others and becomes their levels when multiplied by a known factor."""
    known = values[values > 0]
    if not known.size:
        return False
    first, third = np.quantile(known[:: len(known) // SAMPLE + 1], [0.25, 0.75])
    outside = (values > 0) & ((values < first / 3) | (values > third * 3))
    count = int(np.count_nonzero(outside))
    if not 0 < count <= len(known) // 3:
        return False
    levels, moved = np.unique(known[(known >= first / 3) & (known <= third * 3)]), np.unique(values[outside])
    if len(levels) > MOST_VALUES or len(moved) > MOST_VALUES:
        return False
    gap = max(levels[0] / moved[-1], moved[0] / levels[-1])
    for factor in (*LATTICE, *(1 / k for k in LATTICE)):
        ratio = moved[:, None] * factor / levels[None, :]
        if gap > (3 if factor in (10, 0.1) else GAP) and np.all(np.any(np.abs(np.log(ratio)) < NEAR, axis=1)):
            rows = np.flatnonzero(outside)
            name = f"{factor:.4g}" if factor > 1 else f"1/{1 / factor:.4g}"
            sentence = (
                f"{places(draft, rows)}: {role} {listed(moved)} {ROLES[role].unit} times {name} are levels of the "
                f"other rows ({listed(levels)}): another unit or decimal mark in these rows"
            )
            draft.doubts.append(Doubt((role,), sentence))
            return True
    return False


def _doubt_single(draft: Draft, role: str, values: Array) -> None:
    """Doubt a value that occurs once in a column of few levels, each of which occurs three times and more."""
    known = values[:SAMPLE][np.isfinite(values[:SAMPLE])]
    levels, counts = np.unique(known, return_counts=True)
    levels, counts = levels[counts > 1], counts[counts > 1]
    if not 2 <= len(levels) <= MOST_LEVELS or counts.min() < 3:
        return
    rows = np.flatnonzero(np.isfinite(values) & ~np.logical_or.reduce([values == level for level in levels]))
    if len(rows) != 1:
        return
    sentence = (
        f"{places(draft, rows)}: {role} {listed(values[rows])} {ROLES[role].unit} occurs once, "
        f"every other row holds one of {listed(levels)}"
    )
    draft.doubts.append(Doubt((role,), sentence))


def places(draft: Draft, rows: NDArray[np.intp]) -> str:
    """Lines of the file of some rows, in words."""
    lines = draft.lines[rows].tolist()
    named = ", ".join(map(str, lines[:LISTED])) + (f" and {len(lines) - LISTED} more" if len(lines) > LISTED else "")
    return f"line {named}" if len(lines) == 1 else f"lines {named}"


def listed(values: Array) -> str:
    """The first values in words."""
    shown = ", ".join(format_decimal(float(v)) for v in values[: LISTED + 3])
    return shown + (", ..." if len(values) > LISTED + 3 else "")
