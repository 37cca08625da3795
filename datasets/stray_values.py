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
RATIOS: dict[str, dict[float, str]] = {
    "wear": {1000: "um or mm", 25.4: "inch or mm"},
    "time": {60: "s or min"},
    "load": {1000: "another unit"},
    "surface": {39.37: "uin or um", 1000: "another unit"},
}
LATTICE = (25.4, 3.280839895, 60.0, 10.0, 1000.0)
NEAR = 0.012  # of a level, for values rounded in another unit
GAP = 1.3  # ratio between the shifted rows and the others
CLEAR_GAP = 2.2  # needed for one shifted level, and for a factor of 10, which a plan may span
MOST_ROWS = 1 / 3  # shifted rows are a minority
GAP_OF_RESULTS = 2.0
NEARLY = 1.5  # results in another unit need not lie exactly among the others
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
    if not 0 < len(wrong) <= max(1, len(values) // 10):
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
        if use.role is None or use.role in options.ranges or not ROLES[use.role].unit or len(draft.lines) < FEWEST:
            continue
        values = np.asarray(draft.data[use.role], dtype=float)
        if ROLES[use.role].kind != "condition":
            _doubt_group(draft, use.role, values)
        elif not _doubt_shifted(draft, use.role, values):
            _doubt_single(draft, use.role, values)


def _doubt_shifted(draft: Draft, role: str, values: Array) -> bool:
    """Whether a minority of rows lies apart from the others and holds their levels in another unit."""
    levels, counts = np.unique(values[values > 0], return_counts=True)
    if not 2 <= len(levels) <= MOST_VALUES:
        return False
    shares = np.cumsum(counts) / counts.sum()
    for cut in np.flatnonzero(levels[1:] > levels[:-1] * GAP) + 1:
        gap, lower = levels[cut] / levels[cut - 1], shares[cut - 1]
        if min(lower, 1 - lower) > MOST_ROWS:
            continue
        moved, kept = (levels[:cut], levels[cut:]) if lower < 0.5 else (levels[cut:], levels[:cut])
        for factor in LATTICE if lower < 0.5 else (1 / k for k in LATTICE):
            ratio = moved[:, None] * factor / kept[None, :]
            apart = gap > CLEAR_GAP or (len(moved) > 1 and factor not in (10, 0.1))
            if apart and np.all(np.any(np.abs(np.log(ratio)) < NEAR, axis=1)):
                _add_shifted(draft, role, np.flatnonzero(np.isin(values, moved)), moved, kept, factor)
                return True
    return False


def _add_shifted(draft: Draft, role: str, rows: NDArray[np.intp], moved: Array, kept: Array, factor: float) -> None:
    way = f"times {factor:.4g}" if factor > 1 else f"divided by {1 / factor:.4g}"
    sentence = (
        f"{places(draft, rows)}: {role} {listed(moved)} {ROLES[role].unit} {way} are levels of the other rows "
        f"({listed(kept)}): another unit or decimal mark in these rows"
    )
    draft.doubts.append(Doubt((role,), sentence))


def _doubt_group(draft: Draft, role: str, values: Array) -> None:
    """Doubt a minority of rows of a result that a known ratio of units brings among the others."""
    size = np.abs(values)
    known = size[size > 0]
    if not known.size:
        return
    first, third = np.quantile(known[:: len(known) // SAMPLE + 1], [0.25, 0.75])
    for outside, power in ((size > third * 3, -1), ((size > 0) & (size < first / 3), 1)):
        count = int(np.count_nonzero(outside))
        if not 1 < count <= len(known) // 4:
            continue
        group, rest = size[outside], size[(size > 0) & ~outside]
        gap = max(group.min() / rest.max(), rest.min() / group.max())
        for factor, units in RATIOS.get(ROLES[role].kind, {}).items():
            moved = group * factor**power
            if gap > GAP_OF_RESULTS and rest.min() / NEARLY <= moved.min() and moved.max() <= rest.max() * NEARLY:
                rows = np.flatnonzero(outside)
                way = "divided by" if power < 0 else "times"
                sentence = (
                    f"{places(draft, rows)}: {role} {listed(values[rows])} {ROLES[role].unit} {way} {factor:g} would "
                    f"lie among the other rows: these rows may be in {units}"
                )
                draft.doubts.append(Doubt((role,), sentence))
                return


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
