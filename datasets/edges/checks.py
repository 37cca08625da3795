"""Contradictions within cutting edges: settings that change, wear that falls, single cells that stand out."""

from collections.abc import Iterator

import numpy as np

from ...core.arrays import MAD, Array, Flags, Ints
from ...core.rounding import format_plain
from ..doubts import Doubt
from ..draft import Draft, lines_of, numbers_of, target_of
from ..plausibility.stray_values import section_of
from ..vocabulary import MEASURED, ROLES
from .columns import differs
from .merged_cells import lines_text
from .rows import EdgeRows, by_edge, listed, median, of_equal_tests, of_repeated_pairs
from .times import begun_anew, doubts_of_no_time, doubts_of_time

MOST_ROWS = 100_000  # of a table whose edges are checked cell by cell
JUMP = 3.0  # factor of a cell against its neighbours above which a digit or decimal mark may have slipped
STEADY = 1.5  # factor between two neighbours of which a third cell is judged
FALL = 0.8  # of the wear before
# Robust standard deviations of the steps of wear that a fall must exceed, where two rows above it and two below agree,
# and where one row decides: heavy tails (Student's t, 4 df) then give a fall in less than 1 % of sound files.
SPREADS, SPREADS_ALONE = 4.0, 11.0
CLOSER = 0.6  # of the variation within edges, which a column moved by one row must be below
APART = 15.0  # factor between the level of an edge and that of the others
FACTORS = ((25.4, "in and mm"), (60.0, "min and s"), (3.2808, "m and ft"), (10.0, ""), (100.0, ""), (1000.0, ""))
SHIFTED = "shifted by one row against the other columns"
LEVELS_APART = 4.0  # robust standard deviations between the levels of two edges that distinguish their values
HALFWAY = 0.5  # of the way between two levels
MOST_VOTES = 0.75  # share of the edges that decides
MOST_KNOWN = 0.9  # share of known values from which a column is looked at for a shift
FEW_STEPS = 5.5  # of a reading, between readings of one cut
COPIED = "rows that stand twice"
ANOTHER_ORDER = "is of another order than in the other edges"


def check_edges(draft: Draft) -> None:
    """Add a doubt for each contradiction within the edges of a draft, and for rows that occur twice."""
    if len(draft.lines) < 3:
        return
    if len(draft.lines) > MOST_ROWS:
        draft.assumed.append(
            f"not checked, since the table has more than {MOST_ROWS} rows: cells, times and settings within edges, and "
            "rows that occur twice"
        )
        return
    numbers = draft.numbers()
    kinds = {role: ROLES[role].kind for role in numbers}
    copies = _copies(draft, numbers)
    draft.doubts += _of_copies(draft, copies)
    if "edge" not in draft.data:
        draft.doubts += [] if "t" in draft.data else of_equal_tests(draft, numbers, MEASURED)
        return
    edges = by_edge(draft)
    if edges.several == 0:
        return
    t = numbers.get("t")
    if t is None and "T" not in numbers:
        draft.doubts += doubts_of_no_time(draft, edges, numbers)
    shifted = {role for doubt in draft.doubts if SHIFTED in doubt.sentence for role in doubt.columns}
    for role in (role for role, kind in kinds.items() if kind == "condition" and role not in shifted):
        draft.doubts += _of_setting(draft, edges, role, numbers[role])
    if t is not None:
        wear = next((numbers[role] for role, kind in kinds.items() if kind == "wear"), None)
        draft.doubts += doubts_of_time(draft, edges, t, wear, copies)
    order = edges.order if t is None else np.lexsort((t, edges.codes))
    computed = {one.role for one in draft.derived}
    for role in (role for role, kind in kinds.items() if kind in MEASURED and role not in computed):
        draft.doubts += _of_response(draft, edges, role, numbers[role], t, order)


def _copies(draft: Draft, numbers: dict[str, Array]) -> Flags:
    """Rows all of whose cells stand in a row before; of one measured quantity alone two may be equal by chance."""
    n = len(draft.lines)
    copy = np.zeros(n, dtype=bool)
    measured = sum(ROLES[role].kind in MEASURED for role in numbers)
    if len(numbers) < 3 or measured == 0 or (measured == 1 and "t" not in numbers):
        return copy
    chance = measured == 1 and all(use.role != "edge" for use in draft.uses)
    key = np.zeros(n)  # equal rows have equal sums
    for k, values in enumerate(numbers.values()):
        missing = np.isnan(values)
        key += (k + np.sqrt(2)) * (np.where(missing, 0.1234, values) if missing.any() else values)
    order = np.argsort(key, kind="stable")
    for i in np.flatnonzero(key[order[1:]] == key[order[:-1]]):
        a, b = sorted((int(order[i]), int(order[i + 1])))
        texts = (column.values for column in draft.columns)
        if chance and b > a + 1:
            continue
        copy[b] = all(cells[a] == cells[b] or (cells[a] != cells[a] and cells[b] != cells[b]) for cells in texts)
    return copy if "t" in numbers or not copy.any() else copy & ~_read_again(draft, numbers)


def _read_again(draft: Draft, numbers: dict[str, Array]) -> Flags:
    """Rows of an edge and setting whose readings differ, by a few steps of the readings at most: equal ones occur."""
    measured = {use.role for use in draft.uses if use.role and ROLES[use.role].kind in MEASURED}
    settings = [values for role, values in numbers.items() if ROLES[role].kind not in MEASURED]
    keys = np.column_stack([draft.codes("edge")[0] if "edge" in draft.data else np.zeros(len(draft.lines)), *settings])
    group = np.unique(np.nan_to_num(keys, nan=-1.0), axis=0, return_inverse=True)[1].ravel()
    near = [_a_few_steps_apart(values, group) for role, values in numbers.items() if role in measured]
    return np.asarray(np.logical_and.reduce([np.ones(len(group), dtype=bool), *near]))


def _a_few_steps_apart(values: Array, group: Ints) -> Flags:
    """Whether the values of the group of each row differ, by a few of the smallest steps between values at most."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    low, high = (np.full(group.max() + 1, end) for end in (np.inf, -np.inf))
    np.minimum.at(low, group, values)
    np.maximum.at(high, group, values)
    spread = (high - low)[group]
    return np.asarray((spread > 0) & (spread <= FEW_STEPS * steps.min(initial=np.inf)))


def _of_copies(draft: Draft, copies: Flags) -> Iterator[Doubt]:
    """Doubt rows that occur twice, and state those of pairs all of whose rows do: a fit counts each of them once."""
    if not copies.any() or not ("t" in draft.data or "edge" in draft.data):
        return
    repeated = of_repeated_pairs(draft)
    whole = copies & repeated
    if whole.any():
        count, others = np.count_nonzero(whole), np.count_nonzero(repeated & ~whole)
        draft.assumed.append(
            f"{COPIED}: {count} rows ({lines_of(draft.lines[whole])}) repeat the {others} others in every cell, and "
            "each measurement is counted once"
        )
    twice = copies & ~whole
    if twice.any():
        repeat = "repeats an earlier row" if twice.sum() == 1 else "repeat earlier rows"
        target = target_of(draft, np.flatnonzero(twice))
        yield Doubt(
            tuple(role for role in draft.data if role in ROLES),
            f"{lines_text(draft.lines[twice])} {repeat} in every cell, and would count twice in a fit; remove what was "
            "copied",
            f'--leave-out "{target}"' if target else "",
            lines=numbers_of(draft, twice),
        )


def _of_setting(draft: Draft, edges: EdgeRows, role: str, values: Array) -> Iterator[Doubt]:
    """Cells of a setting that differ from the rest of their edge."""
    x = values[edges.order]
    moved = edges.same & differs(x[1:], x[:-1])
    if not moved.any():
        return
    if edges.edges_of(moved) > edges.few:
        yield from _shifted(edges, role, moved)
        return
    cells: list[str] = []
    codes = dict.fromkeys(edges.codes[edges.order[1:][moved]].tolist())
    for code in codes:
        rows = np.flatnonzero(edges.codes == code)
        cells += _odd_cells(draft, values, rows[~np.isnan(values[rows])], str(edges.names[rows[0]]))
    sentence = f"{role} changes within an edge: {listed(cells)}; correct the cell, or the name of the edge"
    yield Doubt((role,), sentence, lines=numbers_of(draft, np.isin(edges.codes, list(codes))))


def _odd_cells(draft: Draft, values: Array, rows: Ints, name: str) -> Iterator[str]:
    """The cells of an edge that differ from most, or all of them where most do."""
    usual = median(values[rows])
    odd = rows[differs(values[rows], np.full(len(rows), usual))]
    if len(rows) == 2 or 2 * len(odd) > len(rows):
        yield f"edge {name} has {', '.join(f'{format_plain(values[i])} (line {draft.lines[i]})' for i in rows)}"
        return
    for i in odd:
        others = f"the other rows of edge {name} have {format_plain(usual)}"
        yield f"line {draft.lines[i]} has {format_plain(values[i])} where {others}{_factor_words(values[i], usual)}"


def _shifted(edges: EdgeRows, role: str, moved: Flags) -> Iterator[Doubt]:
    """A setting that changes in most edges, in each after its first row or before its last one."""
    step = np.flatnonzero(moved) + 1  # as sorted: the row that differs from the one before
    edge = np.searchsorted(edges.first, step, side="right") - 1
    once = len(set(edge.tolist())) == len(edge)
    second, last = step - edges.first[edge] == 1, edges.first[edge] + edges.sizes[edge] - 1 == step
    long = edges.sizes[edge] >= 3
    for name, there in (("after the first row", second), ("before the last row", last)):
        if once and long.any() and there[long].all():
            yield Doubt(
                (role,),
                f"{role} changes {name} of {len(edge)} of {edges.several} edges: the column is "
                f"{SHIFTED}; correct it in the file",
            )
            return


def _factor_words(value: float, usual: float) -> str:
    """A factor between a cell and the rest that points to a unit or a slipped mark.

    >>> _factor_words(2540.0, 100.0), _factor_words(130.0, 100.0)
    (', a factor of 25.4 as between in and mm', '')
    """
    if not (value > 0 and usual > 0):
        return ""
    ratio = max(value / usual, usual / value)
    for factor, units in FACTORS:
        if abs(ratio / factor - 1) < 0.02:
            return f", a factor of {factor:g}" + (f" as between {units}" if units else ": a decimal mark or a digit")
    return ""


def _of_response(
    draft: Draft, edges: EdgeRows, role: str, values: Array, t: Array | None, order: Ints
) -> Iterator[Doubt]:
    """Single cells that jump against their neighbours, wear that falls, and edges far from the others."""
    x = values[order]
    known = x > 0 if t is None else (x > 0) & ~np.isnan(t[order])
    if not known.all():
        order, x = order[known], x[known]
    if len(order) < 3:
        return
    code, y = edges.codes[order], np.log(x)
    step = np.where(code[1:] == code[:-1], np.diff(y), np.nan)
    grows = ROLES[role].kind == "wear"
    slipped = np.zeros(len(y), dtype=bool)
    if (np.abs(step) > np.log(JUMP)).any():
        slipped = _slips(y, step, None if t is None else np.log(np.maximum(t[order], 1e-9)), grows=grows)
        if 0 < slipped.sum() <= edges.few:
            cells = (_slip_words(draft, edges, values, order, step, int(i), role) for i in np.flatnonzero(slipped))
            what = "a digit or decimal mark may have slipped"
            sentence = f"{role} jumps within an edge: {listed(cells)}; {what}"
            yield Doubt((role,), sentence, lines=numbers_of(draft, order[slipped]))
    if grows and (step < np.log(FALL)).any():
        log_t = np.zeros(len(y)) if t is None else np.log(np.maximum(t[order], 1e-9))
        yield from _falls(draft, edges, role, values, order, step, np.diff(log_t), slipped)
    yield from _levels(draft, edges, role, *_over_section(draft, role, order, code, y))
    yield from _shifted_response(edges, role, values)


def _falls(
    draft: Draft,
    edges: EdgeRows,
    role: str,
    values: Array,
    order: Ints,
    step: Array,
    later: Array,
    slipped: Flags,
) -> Iterator[Doubt]:
    """Steps down beyond the scatter about a power of time; ``later`` are the steps of the logarithm of time."""
    known = ~np.isnan(step)
    rising = known & (later > 0)
    exponent = median(step[rising] / later[rising]) if rising.any() else 0.0
    left = step - exponent * np.maximum(later, 0)
    centre = median(left[known])
    spread = MAD * median(np.abs(left[known] - centre))
    anew = begun_anew(draft, edges, role, values, order, left < centre - SPREADS * spread)
    if anew is not None:
        yield anew
        return
    falls = (step < np.log(FALL)) & ~slipped[1:] & ~slipped[:-1]
    falls &= (left < centre - SPREADS_ALONE * spread) | (_lasting(step) < min(np.log(FALL), -SPREADS * spread))
    if 0 < falls.sum() <= max(2, 0.1 * known.sum()):
        cells = (
            f"from {format_plain(values[order[i]])} to {format_plain(values[order[i + 1]])} {draft.units.get(role, '')}"
            f" at line {draft.lines[order[i + 1]]}"
            for i in np.flatnonzero(falls)
        )
        what = "wear does not heal: check these lines"
        ends = np.append(falls, False) | np.append(False, falls)  # either may be the wrong one
        sentence = f"{role} falls by more than 20 % along an edge: {listed(cells)}; {what}"
        yield Doubt((role,), sentence, lines=numbers_of(draft, order[ends]))


def _lasting(step: Array) -> Array:
    """Step from the lower of the two rows before to the higher of the two rows after, nan where one is missing."""
    nothing = np.array([np.nan])
    before, after = np.concatenate([nothing, step[:-1]]), np.concatenate([step[1:], nothing])
    return np.asarray(step + np.maximum(before, 0) + np.maximum(after, 0))


def _slips(y: Array, step: Array, log_t: Array | None, *, grows: bool) -> Flags:
    """Cells that stand out by the factor from both neighbours, or at an end from two that agree."""
    jump, steady = np.log(JUMP), np.log(STEADY)
    nothing = np.array([np.nan])
    before, after = np.concatenate([nothing, step]), np.concatenate([-step, nothing])  # against the neighbours
    both = (np.minimum(before, after) > jump) | (np.maximum(before, after) < -jump)
    beyond = np.concatenate([np.abs(step[1:]), nothing, nothing])  # step between the two rows that follow
    ahead = np.concatenate([nothing, nothing, np.abs(step[:-1])])
    first = np.isnan(before) & (np.abs(after) > jump) & (beyond < steady)
    last = np.isnan(after) & (np.abs(before) > jump) & (ahead < steady)
    if grows:  # wear is low at first, and may rise fast at last
        later = np.zeros(len(y)) if log_t is None else np.append(np.diff(log_t), 0.0)
        first &= (after > 0) | (-after > jump + 1.5 * later)
        last &= (before < 0) | (before > jump + steady)
    return np.asarray(both | first | last)


def _slip_words(draft: Draft, edges: EdgeRows, values: Array, order: Ints, step: Array, i: int, role: str) -> str:
    beside = [k for k, s in ((i - 1, i - 1), (i + 1, i)) if 0 <= s < len(step) and not np.isnan(step[s])]
    around = " and ".join(format_plain(values[order[k]]) for k in beside)
    value = f"{format_plain(values[order[i]])} {draft.units.get(role, '')}"
    return f"line {draft.lines[order[i]]} has {value}, its neighbours in edge {edges.names[order[i]]} {around}"


def _over_section(draft: Draft, role: str, order: Ints, code: Ints, y: Array) -> tuple[Ints, Array, float]:
    """Edges, logarithms of a load over the section of its chip, and the distance of another order."""
    section = section_of(draft, role)
    if section is None:
        return code, y, float(np.log(APART if ROLES[role].kind == "wear" else APART**2))
    y = y - np.log(section[order])
    known = np.isfinite(y)
    return code[known], y[known], float(np.log(APART))


def _levels(draft: Draft, edges: EdgeRows, role: str, code: Ints, y: Array, far: float) -> Iterator[Doubt]:
    """Edges in which a measured quantity is of another order than in the others: another unit."""
    if len(y) < 3 or np.ptp(y) < far:
        return
    at = np.flatnonzero(np.concatenate([[True], code[1:] != code[:-1]]))
    level = np.add.reduceat(y, at) / np.diff(at, append=len(y))
    apart = np.abs(level - median(level))
    odd = apart > far
    if len(at) < 6 or not 0 < odd.sum() <= edges.few or apart[odd].min() < 2 * apart[~odd].max():
        return
    name = dict(zip(edges.codes.tolist(), edges.names.tolist(), strict=True))
    which = listed(f"edge {name[code[i]]} by a factor of {np.exp(apart[k]):.3g}" for k, i in enumerate(at) if odd[k])
    sentence = f"{role} {ANOTHER_ORDER}: {which}; in another unit, or of another column?"
    yield Doubt((role,), sentence, lines=numbers_of(draft, np.isin(edges.codes, code[at[odd]])))


def _may_be_shifted(edges: EdgeRows, known: Flags) -> bool:
    """Whether there are edges and values enough to recognize a shifted column, which lacks its first or last value."""
    enough = len(edges.first) >= 6 and len(known) >= 3 * len(edges.first)
    return enough and edges.together and bool(known.mean() >= MOST_KNOWN)


def _shifted_response(edges: EdgeRows, role: str, values: Array) -> Iterator[Doubt]:
    """A measured column that varies far less within the edges if it is moved by one row."""
    known = values > 0
    if not _may_be_shifted(edges, known):
        return
    y = np.log(np.where(known, values, np.nan))
    same = edges.codes[1:] == edges.codes[:-1]
    step = np.nan_to_num(np.abs(y[1:] - y[:-1]))
    here = step[same].sum()
    fall = (y[1:] < y[:-1]) & same
    second, last = same & np.append(True, ~same[:-1]), same & np.append(~same[1:], True)
    wear = ROLES[role].kind == "wear"
    for where, moved, place in (("first", step[1:][same[:-1]], second), ("last", step[:-1][same[1:]], last)):
        there, elsewhere = int(fall[place].sum()), int(fall[same & ~place].sum())
        falls = wear and there > 0.8 * place.sum() and elsewhere < 0.3 * (same & ~place).sum()
        if falls or moved.sum() < CLOSER * here or (not wear and _of_the_next(y, ~same, at_end=where == "last")):
            words = f"{role} jumps at the {where} row of most edges, and would not if it were moved by one row"
            yield Doubt((role,), f"{words}: the column is {SHIFTED}; correct it in the file")
            return


def _of_the_next(y: Array, begins: Flags, *, at_end: bool) -> bool:
    """Whether the last values of the edges (the first ones) are of the level of the next edge (of the one before).

    Only edges whose level differs from that of the neighbour by far more than the scatter are asked; there must be
    some above their neighbour and some below, which no trend along an edge explains.
    """
    if not at_end:
        y, begins = y[::-1], begins[::-1]
    ends = np.append(np.flatnonzero(begins), len(y) - 1)
    sizes = np.diff(ends, prepend=-1)
    if sizes.min() < 3:
        return False
    inner = np.delete(y, ends)
    code = np.repeat(np.arange(len(ends)), sizes - 1)
    level = np.bincount(code, weights=inner) / (sizes - 1)  # NaN with a missing value, which no edge is asked for
    scatter = MAD * median(np.abs(inner - level[code])[np.isfinite(level[code])])
    gap = np.diff(level)
    asked = np.abs(gap) > LEVELS_APART * scatter
    beyond = (y[ends[:-1]] - level[:-1]) * np.sign(gap) > HALFWAY * np.abs(gap)
    votes = (beyond[asked & (gap > 0)], beyond[asked & (gap < 0)])
    return all(len(vote) >= 2 and vote.mean() > MOST_VOTES for vote in votes)
