"""Single cells of a file of tests that are impossible or far from all others, and levels shifted by a known factor."""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.rounding import format_decimal, listed
from ..doubts import Doubt
from ..draft import Draft, correction, numbers_of, whole_edges
from ..options import Process, ReadOptions
from ..vocabulary import ROLES
from .quantities import table_process
from .ranges import plausible
from .unit_shifts import EVIDENCE

FACTORS = {10.0: "a decimal mark", 100.0: "a decimal mark", 1000.0: "a decimal mark or a unit", 25.4: "a unit, inch"}
RATIOS: dict[str, dict[float, str]] = {
    "wear": {1000: "um or mm", 25.4: "inch or mm"},
    "time": {60: "s or min"},
    "load": {1000: "another unit"},
    "surface": {1000: "another unit"},
}
LATTICE = {
    "V": (3.280839895, 60.0, 1000.0, 10.0),
    "n": (60.0, 10.0),
    "fm": (25.4, 60.0, 1000.0, 10.0),
}  # ratios of units and decimal marks; of the other conditions as follows
LENGTHS = (25.4, 10.0, 1000.0)
NEAR = 0.012  # of a level, for values rounded in another unit
EXACT = 0.002  # of a level, for values that are converted without rounding
GAP = 1.3  # ratio between the shifted rows and the others
CLEAR_GAP = 2.2  # needed for one shifted level, and for a factor of 10, which a plan may span
CHANCE = 0.01  # that levels of a sound plan lie at a unit ratio
MOST_ROWS = 1 / 3  # shifted rows are a minority
GAP_OF_RESULTS = 2.0
NEARLY = 1.5  # results in another unit need not lie exactly among the others
FAR = 3.0  # ratio to the next value beyond which a single cell is doubted
FAR_ALONE = 4.0  # the same for conditions, roughness, and loads that are not divided by the section of the chip
FEWEST_LEVELS = 3  # values beside which one may be a code of a missing value
FEWEST = 8  # rows below which no cell is judged by the others
MOST_LEVELS = 7
SEVERAL = 3  # rows of every other level beside which a value of one row is doubted
SAMPLE = 20000
FEWEST_FREE = 3  # lives beyond the coefficients of a law by which others are doubted
TINY = 1e-9  # sum of squares of logarithms: lives without scatter
LISTED = 4
MOST_EDGES = 8  # in a sentence


def leave_out_codes(draft: Draft, options: ReadOptions) -> None:
    """Leave out codes of missing values, such as -999, and state them; of one above zero with a doubt."""
    for use in draft.uses:
        if use.role is None or use.role in options.ranges or not ROLES[use.role].unit:
            continue
        values = np.asarray(draft.data[use.role], dtype=float)
        for code in codes_of_missing(values):
            rows = np.flatnonzero(values == code)
            values = np.where(values == code, np.nan, values)
            draft.data[use.role] = values
            n = f"{len(rows)} row{'s' * (len(rows) > 1)}"
            words = f"{use.role}: {format_decimal(code)} in {n} ({places(draft, rows)}) is a code of a missing value"
            if code < 0:
                draft.assumed.append(words)
            else:  # it may also be a reading beyond the range of the instrument
                draft.doubts.append(Doubt((use.role,), f"{words}, and is left out", lines=numbers_of(draft, rows)))


def codes_of_missing(values: Array) -> list[float]:
    """Values that are written as a code of a missing one: of nines alone, and far from all others.

    A negative one stands beside values of which none is; any other one is three times as large as the largest, and
    occurs several times.

    >>> codes_of_missing(np.array([512.0, -999.0, 731.0, 620.0, 555.0, 9999.0, 9999.0]))
    [-999.0, 9999.0]
    >>> codes_of_missing(np.array([512.0, 999.0, 999.0, 731.0, 1450.0]))
    []
    """
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    nines = np.array([set(f"{abs(level):.12g}".replace(".", "")) == {"9"} for level in levels.tolist()], dtype=bool)
    rest = levels[~nines]
    if not nines.any() or len(rest) < FEWEST_LEVELS or 2 * counts[nines].sum() > counts.sum():
        return []
    negative = (levels <= -99) & (rest.min() >= 0)
    far = (counts > 1) & (np.abs(levels) >= 9) & (np.abs(levels) > FAR * np.abs(rest).max())
    return [float(level) for level in levels[nines & (negative | far)]]


def check_cells(draft: Draft, options: ReadOptions) -> None:
    """Leave out single cells that are impossible, each with a doubt."""
    process = table_process(draft, options)
    for use in draft.uses:
        if use.role is None or use.role in options.ranges or not ROLES[use.role].unit:
            continue
        values = np.asarray(draft.data[use.role], dtype=float)
        if len(values) >= FEWEST:
            draft.data[use.role] = _without_impossible(draft, use.role, values, process)


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
        f"{places(draft, wrong)}: {role} {numbers(values[wrong])} {unit} cannot be (usual {low} to {high}) "
        f"and is left out"
        f"{_cause(float(values[wrong[0]]), kept)}"
    )
    draft.doubts.append(Doubt((role,), sentence, lines=numbers_of(draft, wrong)))
    return kept


def _doubt_far(draft: Draft, role: str, values: Array) -> None:
    """Doubt one cell that is several times the next: a wrong decimal mark or unit in a single cell."""
    kind = ROLES[role].kind
    size, section = np.abs(values), section_of(draft, role)
    if section is not None:
        size = size / section
    known = size[size > 0]
    if len(known) < FEWEST or role == "T":
        return
    limit = FAR if section is not None or kind in ("time", "wear") else FAR_ALONE
    least, most = float(known.min()), float(known.max())
    ends = [(most, known > most / limit)]
    if kind not in ("time", "wear"):  # both begin near zero
        ends.append((least, known < least * limit))
    for far, near in ends:
        if np.count_nonzero(near) == 1:
            beyond = size == far
            row, rest = np.flatnonzero(beyond), np.abs(values[~beyond & (values != 0) & np.isfinite(values)])
            range_of_rest = f"{format_decimal(float(rest.min()))} to {format_decimal(float(rest.max()))}"
            per = " at its feed and depth" if section is not None else ""
            moved = _cause(float(far), size[~beyond], 1.0 if section is None else float(section[row[0]]))
            sentence = (
                f"{places(draft, row)}: {role} {numbers(values[row])} {ROLES[role].unit} is far from all other rows"
                f"{per}, which hold {range_of_rest}{moved}"
            )
            _add(draft, role, row, sentence, _to_a_level(float(far), rest) if kind == "condition" else None)


def _to_a_level(value: float, levels: Array) -> float | None:
    """The factor of a decimal mark or of inches that makes a value a level of the other rows; None without one.

    >>> _to_a_level(20.0, np.array([1.0, 2.0])), _to_a_level(30.0, np.array([1.0, 2.0]))
    (0.1, None)
    """
    moves = [move for factor in FACTORS for move in (1 / factor, factor)]
    return next((move for move in moves if (np.abs(value * move / levels - 1) < EXACT).any()), None)


def section_of(draft: Draft, role: str) -> Array | None:
    """Section of the chip f d (times V for a power), to which loads are nearly proportional; None without it."""
    needed = ("f", "d", "V") if role == "P" else ("f", "d")
    if ROLES[role].kind != "load" or role in ("M", "I") or any(one not in draft.data for one in needed):
        return None
    section: Array = np.ones(len(draft.lines))
    for one in needed:
        section = section * np.asarray(draft.data[one], dtype=float)
    return np.where(section > 0, section, np.nan)


def _cause(value: float, rest: Array, scale: float = 1.0) -> str:
    """The likely cause of a stray value: a factor that brings it among the others."""
    known = np.abs(rest[np.isfinite(rest) & (rest != 0)])
    if value <= 0 or not known.size:
        return "; a sign or a missing value" if value < 0 else ""
    low, high = np.quantile(known, [0.05, 0.95])
    for factor, cause in FACTORS.items():
        for moved in (value / factor, value * factor):
            if low <= moved <= high:
                return f"; {format_decimal(moved * scale)} if {cause} is wrong (x{factor:g})"
    return ""


def check_levels(draft: Draft, options: ReadOptions) -> None:
    """Doubt cells far from all others, and rows of a column that seem to be in another unit."""
    for use in draft.uses:
        if use.role is None or use.role in options.ranges or not ROLES[use.role].unit or len(draft.lines) < FEWEST:
            continue
        values = np.asarray(draft.data[use.role], dtype=float)
        _doubt_far(draft, use.role, values)
        if ROLES[use.role].kind != "condition":
            _doubt_group(draft, use.role, values)
        elif len(values) <= SAMPLE or len(np.unique(values[:SAMPLE])) <= 3 * MOST_LEVELS:
            levels, counts = np.unique(values[values > 0], return_counts=True)
            if len(levels) <= 3 * MOST_LEVELS and not _doubt_shifted(draft, use.role, values, levels, counts):
                _doubt_single(draft, use.role, values, levels, counts)


def _doubt_shifted(draft: Draft, role: str, values: Array, levels: Array, counts: Ints) -> bool:
    """Whether a minority of rows lies apart from the others and holds their levels in another unit."""
    if not _shifted_levels(role, levels, counts):
        return False
    # the least correction after which no level is left that another one would bring among the others
    found = _shifted_levels(role, levels, counts, exact=True)
    best = min(
        found, key=lambda one: (len(_shifted_levels(role, *one.corrected(levels, counts), exact=True)), one.rows)
    )
    _add_shifted(draft, role, np.flatnonzero(np.isin(values, best.moved)), best.moved, best.kept, best.factor)
    return True


@dataclass(frozen=True, slots=True)
class _Shifted:
    """Levels apart from the others that a factor brings among them, and the number of their rows."""

    moved: Array
    kept: Array
    factor: float
    rows: int

    def corrected(self, levels: Array, counts: Ints) -> tuple[Array, Ints]:
        """Levels and their counts with the shifted ones joined to those of the others."""
        among = np.isin(levels, self.kept)
        joined = counts[among].copy()
        near = np.abs(np.log(self.moved[:, None] * self.factor / self.kept[None, :])).argmin(axis=1)
        np.add.at(joined, near, counts[~among])
        return self.kept, joined


def _shifted_levels(role: str, levels: Array, counts: Ints, *, exact: bool = False) -> list[_Shifted]:
    """Minorities of levels beyond a gap that may be in another unit; with ``exact`` also those of an exact ratio."""
    if not 2 <= len(levels) <= 2 * MOST_LEVELS:
        return []
    found = []
    ratios = [ratio for ratio in LATTICE.get(role, LENGTHS) if ratio < levels[-1] / levels[0] * (1 + NEAR)]
    shares = np.cumsum(counts) / counts.sum()
    for cut in np.flatnonzero(levels[1:] > levels[:-1] * GAP) + 1:
        gap, lower = levels[cut] / levels[cut - 1], shares[cut - 1]
        if min(lower, 1 - lower) > MOST_ROWS:
            continue
        moved, kept = (levels[:cut], levels[cut:]) if lower < 0.5 else (levels[cut:], levels[:cut])
        for factor in ratios if lower < 0.5 else [1 / k for k in ratios]:
            ratio = moved[:, None] * factor / kept[None, :]
            chance = min(1.0, 2 * NEAR * len(kept) / np.log(max(2.0, kept[-1] / kept[0]))) ** len(moved)
            if factor in (10, 0.1):
                apart = gap > CLEAR_GAP and len(moved) > 1
            else:
                apart = chance < CHANCE or (gap > CLEAR_GAP and chance < 10 * CHANCE)
            off = np.abs(np.log(ratio)).min(axis=1).max()
            if (apart and off < NEAR) or (exact and off < EXACT and factor not in (10, 0.1)):
                found.append(_Shifted(moved, kept, float(factor), int(counts[np.isin(levels, moved)].sum())))
    return found


def _add_shifted(draft: Draft, role: str, rows: Ints, moved: Array, kept: Array, factor: float) -> None:
    way = f"times {factor:.4g}" if factor > 1 else f"divided by {1 / factor:.4g}"
    sentence = (
        f"{places(draft, rows)}: {role} {numbers(moved)} {ROLES[role].unit} {way} are levels of the other rows "
        f"({numbers(kept)}): another unit or decimal mark in these rows"
    )
    _add(draft, role, rows, sentence, factor)


def _doubt_group(draft: Draft, role: str, values: Array) -> None:
    """Doubt a minority of rows of a result that a known ratio of units brings among the others."""
    size = np.abs(values)
    known = size[size > 0]
    if not known.size:
        return
    some = np.sort(known[:: len(known) // SAMPLE + 1])
    first, third = some[len(some) // 4], some[3 * len(some) // 4]
    for outside, power in ((size > third * 3, -1), ((size > 0) & (size < first / 3), 1)):
        count = int(np.count_nonzero(outside))
        if not 1 < count <= len(known) // 4:
            continue
        group, rest = size[outside], size[(size > 0) & ~outside]
        if power > 0 and ROLES[role].kind == "wear" and _early(draft, outside):
            continue
        gap = max(group.min() / rest.max(), rest.min() / group.max())
        for factor, units in RATIOS.get(ROLES[role].kind, {}).items():
            moved = group * factor**power
            if gap > GAP_OF_RESULTS and rest.min() / NEARLY <= moved.min() and moved.max() <= rest.max() * NEARLY:
                if role == "T" and not _nearer_the_law(draft, size, outside, factor**power):
                    continue
                rows = np.flatnonzero(outside)
                way = "divided by" if power < 0 else "times"
                sentence = (
                    f"{places(draft, rows)}: {role} {numbers(values[rows])} {ROLES[role].unit} {way} {factor:g} would "
                    f"lie among the other rows: these rows may be in {units}"
                )
                _add(draft, role, rows, sentence, factor**power)
                return


def _nearer_the_law(draft: Draft, lives: Array, rows: Flags, factor: float) -> bool:
    """Whether a factor brings lives of some rows to a power law of the conditions that the others follow.

    Lives of a sound plan span a factor of 100, as speed, feed and depth act together.
    """
    numbers = draft.numbers()
    known = np.flatnonzero(lives > 0)
    X = [x for name in numbers if ROLES[name].kind == "condition" and (x := numbers[name][known]).min() > 0]
    codes = [draft.codes(name)[0][known] for name in ("tool", "work") if name in draft.data]
    levels = [(code == one).astype(float) for code in codes for one in np.unique(code)[1:]]
    Z = np.column_stack([np.ones(len(known)), *np.log(X), *levels])
    y = np.log(np.column_stack([lives, np.where(rows, lives * factor, lives)])[known])
    theta, _, rank, _ = np.linalg.lstsq(Z, y, rcond=None)
    r, n = y - Z @ theta, len(known)
    rss = np.sum(r**2, axis=0) + TINY
    each = np.abs(r[rows[known], 1]).max() < abs(np.log(factor)) / 2
    return bool(each and n >= rank + FEWEST_FREE and n * np.log(rss[0] / rss[1]) > EVIDENCE)


def _early(draft: Draft, rows: Flags) -> bool:
    """Whether rows are mostly among the first times, where wear is small."""
    if "t" not in draft.data:
        return True
    t = np.asarray(draft.data["t"], dtype=float)
    return bool(np.nanmedian(t[rows]) < np.nanmedian(t[~rows]) / 2)


def _doubt_single(draft: Draft, role: str, values: Array, levels: Array, counts: Ints) -> None:
    """Doubt a value that occurs once in a column of few levels, each of which occurs three times and more.

    Twice is enough where the levels of a plan are even once the value is taken for that which lacks one.
    """
    once, several = levels[counts == 1], levels[counts > 1]
    if len(once) != 1 or not 2 <= len(several) <= MOST_LEVELS:
        return
    often = np.sort(counts[counts > 1])
    even = len(often) > 2 and often[0] + 1 == often[1] == often[-1]
    if often[0] < SEVERAL and not even:
        return
    rows = np.flatnonzero(values == once[0])
    sentence = (
        f"{places(draft, rows)}: {role} {numbers(values[rows])} {ROLES[role].unit} occurs once, "
        f"every other row holds one of {numbers(several)}"
    )
    _add(draft, role, rows, sentence)


def _add(draft: Draft, role: str, rows: Ints, sentence: str, factor: float | None = None) -> None:
    """Add a doubt about rows of a role, unless each line is named by an earlier one; a factor would correct them."""
    named = {line for doubt in draft.doubts if role in doubt.columns for line in doubt.lines}
    if not named.issuperset(lines := numbers_of(draft, rows)):
        remedy = "" if factor is None else correction(draft, rows, role, factor)
        draft.doubts.append(Doubt((role,), sentence, remedy, lines=lines))


def places(draft: Draft, rows: Ints) -> str:
    """Edges of some rows, where they are all rows of these, or else their lines, in words."""
    edges = whole_edges(draft, rows) if len(rows) > 1 else []
    if edges:
        return f"edge{'s' * (len(edges) > 1)} {listed(edges, MOST_EDGES)}"
    lines = [str(line) for line in draft.lines[rows]]
    return f"line{'s' * (len(lines) != 1)} {listed(lines, LISTED)}"


def numbers(values: Array) -> str:
    """The first values in words."""
    shown = ", ".join(format_decimal(float(v)) for v in values[: LISTED + 3])
    return shown + (", ..." if len(values) > LISTED + 3 else "")
