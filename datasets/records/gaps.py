"""Gaps of a record: short ones are filled, longer ones end a segment, and segments too short to use are left out.

A gap of at most 3 samples is filled, each signal on its own, by the rule that reproduces its known samples best when
they are hidden in gaps of the same length: its level, where that is the same before and after (a signal in steps), a
straight line, or a cubic through two samples on each side. Filled samples add noise of a known size: gaps are filled,
the shortest first, while the squared errors so measured, added over the filled samples, stay below ``BUDGET`` of the
sum of squares of the record. What is not filled separates two segments, each with an initial state and an operating
point of its own.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.rounding import count
from .record import Record

MOST_FILLED = 3  # samples of a gap; a cubic over more follows the noise
BUDGET = 1e-3  # of the variance of a signal: errors of filled samples 30 dB below it, as a fair sensor's noise
FEWEST = 8  # hidden gaps on which a rule is judged, at least
WINDOWS = 20_000  # hidden gaps on which the rules are compared, at most
SHORTEST = 30  # samples: the initial state and operating point of a shorter segment use up most of what it adds
LEFT_OUT = 0.1  # of all samples, at most
RULES = (
    "its level, where that is the same before and after",
    "a straight line",
    "a cubic through 2 samples on each side",
)
HOLD, LINE, CUBIC = range(3)
HELD, STEPS = 0.5, 0.1  # a signal in steps: equal before and after half of the gaps, and there nearly always in between


@dataclass(frozen=True, slots=True)
class Filled:
    """Rows at an even rate.

    Attributes
    ----------
    values : ndarray, shape (m, k), finite
    starts : tuple of int
        First row of each segment.
    notes : tuple of str
        What was filled, by which rule and how well it does, and what was left open.
    """

    values: Array
    starts: tuple[int, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Column:
    """A signal with its short holes filled: which rows, and by length of the hole the rule and its relative error."""

    values: Array
    filled: Flags
    rules: dict[int, tuple[int, float]]


def fill_gaps(values: Array, lost: Ints, lines: Ints, sample_time: float, names: Iterable[str]) -> Filled:
    """Fill short gaps, end a segment at the others.

    Parameters
    ----------
    values : ndarray, shape (n, k)
        One column per signal; NaN where a cell is empty.
    lost : ndarray of int, shape (n,)
        Samples lost before each row; -1 where a segment begins in any case.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    sample_time : float, s
    names : iterable of str
        Signals, for the notes.

    Examples
    --------
    >>> wave = np.sin(np.arange(100) / 8)[:, None]
    >>> rows = np.delete(np.arange(100), [50])
    >>> lost = np.diff(rows, prepend=-1) - 1
    >>> even = fill_gaps(wave[rows], lost, rows + 2, 0.02, ["u"])
    >>> even.starts, float(np.abs(even.values - wave).max()) < 1e-3
    ((0,), True)
    """
    short = (lost > 0) & (lost <= MOST_FILLED)
    place = np.cumsum(np.where(short, lost, 0) + 1) - 1
    place -= place[0]
    grid = np.full((int(place[-1]) + 1, values.shape[1]), np.nan)
    grid[place] = values
    segment = np.zeros(len(grid), dtype=np.intp)
    cut = place[(lost < 0) | (lost > MOST_FILLED)]
    segment[cut] = 1
    segment = np.cumsum(segment)
    columns = [_filled(column, segment) for column in grid.T]
    full = np.column_stack([column.values for column in columns])
    kept = np.isfinite(full).all(axis=1)
    number = np.cumsum((np.diff(segment, prepend=0) != 0) | ~kept)[kept]  # rises at each break
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    begins, lengths = _runs(np.asarray(~kept))
    far = np.flatnonzero(lost > MOST_FILLED)
    notes = (
        *_filled_note(columns, names, lambda row: int(lines[np.searchsorted(place, row)])),
        *_open_note(
            [
                *zip(lines[np.searchsorted(place, begins)], lengths, strict=True),
                *zip(lines[far], lost[far], strict=True),
            ],
            sample_time,
        ),
    )
    return Filled(full[kept], tuple(int(s) for s in starts), notes)


def _filled_note(columns: Sequence[_Column], names: Iterable[str], line_of: Callable[[int], int]) -> tuple[str, ...]:
    """Number of filled samples, where they are, by which rule, and how well it reproduces hidden samples."""
    any_filled = np.logical_or.reduce([column.filled for column in columns])
    begins, lengths = _runs(any_filled)
    if not len(begins):
        return ()
    rules = [
        f"{name} by {RULES[rule]} (rms error {100 * error:.2g} % of its standard deviation, measured on known samples)"
        for name, column in zip(names, columns, strict=True)
        for rule, error in [max(column.rules.values(), key=lambda found: found[1], default=(0, -1.0))]
        if error >= 0
    ]
    samples, verb = count(int(lengths.sum()), "sample"), "is" if lengths.sum() == 1 else "are"
    return (
        f"{samples} in {count(len(begins), 'gap')} of at most {lengths.max()} {verb} filled "
        f"({_lines([line_of(int(b)) for b in begins])}): {'; '.join(rules)}",
    )


def _open_note(gaps: Sequence[tuple[int, int]], sample_time: float) -> tuple[str, ...]:
    """Number, length and place of the gaps that are not filled."""
    if not gaps:
        return ()
    low, high = min(n for _, n in gaps), max(n for _, n in gaps)
    size = f"{low}" if low == high else f"{low} to {high}"
    samples, verb = "sample" if high == 1 else "samples", "is" if len(gaps) == 1 else "are"
    return (
        f"{count(len(gaps), 'gap')} of {size} {samples}, the longest {high * sample_time:.3g} s, {verb} not filled "
        f"({_lines(sorted(int(line) for line, _ in gaps))}): a new segment begins after each",
    )


def _lines(lines: Sequence[int]) -> str:
    return f"line {', '.join(map(str, lines[:3]))}{', ...' if len(lines) > 3 else ''}"


def _runs(flags: Flags) -> tuple[Ints, Ints]:
    """First row and length of each run of set flags."""
    padded = np.concatenate([[False], flags, [False]])
    begins = np.flatnonzero(~padded[:-1] & padded[1:])
    return begins, np.flatnonzero(padded[:-1] & ~padded[1:]) - begins


def _filled(values: Array, segment: Ints) -> _Column:
    """One signal, shape (m,), NaN where missing, with the short holes filled within the budget."""
    missing, filled = np.isnan(values), np.zeros(len(values), dtype=bool)
    if not missing.any() or missing.all():
        return _Column(values, filled, {})
    known = values[~missing]
    variance, out = float(np.var(known)), values.copy()
    left, rules = BUDGET * variance * len(known), {}
    begins, lengths = _holes(missing, segment)
    for length in range(1, MOST_FILLED + 1):
        begin = begins[lengths == length]
        rule, error = _best_rule(values, segment, length) if len(begin) else (0, np.inf)
        if rule == HOLD:  # between two levels the place of the step is unknown
            begin = begin[values[begin - 1] == values[begin + length]]
        cost = len(begin) * length * error**2
        if len(begin) and cost <= left:
            left -= cost
            rules[length] = (rule, error / np.sqrt(variance) if variance else 0.0)
            rows = begin[:, None] + np.arange(length)
            out[rows] = _interpolated(values, segment, begin, length, rule)
            filled[rows] = True
    return _Column(out, filled, rules)


def _holes(missing: Flags, segment: Ints) -> tuple[Ints, Ints]:
    """First row and length of each run of missing values between two known ones of one segment."""
    begins, lengths = _runs(missing)
    inside = (begins > 0) & (begins + lengths < len(missing))
    begins, lengths = begins[inside], lengths[inside]
    same = segment[begins - 1] == segment[begins + lengths]
    return begins[same], lengths[same]


def _weights(length: int, rule: int) -> Array:
    """Weights, shape (length, 4), of the two samples before and the two after a hole."""
    at, nodes = np.arange(length, dtype=np.float64), np.array([-2.0, -1.0, length, length + 1.0])
    out = np.zeros((length, 4))
    if rule == HOLD:
        out[:, 1] = 1.0
    elif rule == LINE:
        out[:, 2] = (at + 1) / (length + 1)
        out[:, 1] = 1 - out[:, 2]
    else:  # Lagrange's polynomials
        for k in range(4):
            others = np.delete(nodes, k)
            out[:, k] = np.prod((at[:, None] - others) / (nodes[k] - others), axis=1)
    return out


def _best_rule(values: Array, segment: Ints, length: int) -> tuple[int, float]:
    """The rule with the least rms error in hidden gaps of one length, and that error: infinite where it is unknown."""
    width = length + 4
    if len(values) < width:
        return 0, np.inf
    windows = np.lib.stride_tricks.sliding_window_view(values, width)
    usable = np.flatnonzero(np.isfinite(windows).all(axis=1) & (segment[: 1 - width] == segment[width - 1 :]))
    if len(usable) < FEWEST:
        return 0, np.inf
    hidden = windows[usable[:: max(1, len(usable) // WINDOWS)]]
    nodes, truth = hidden[:, [0, 1, -2, -1]], hidden[:, 2:-2]
    level = nodes[:, 1] == nodes[:, 2]
    errors = [
        float(np.sqrt(np.mean((nodes[rows] @ _weights(length, rule).T - truth[rows]) ** 2))) if rows.any() else np.inf
        for rule, rows in ((HOLD, level), (LINE, np.ones_like(level)), (CUBIC, np.ones_like(level)))
    ]
    if level.mean() > HELD and errors[HOLD] <= STEPS * min(errors[1:]):
        return HOLD, errors[HOLD]
    best = LINE if errors[LINE] <= errors[CUBIC] else CUBIC
    return best, errors[best]


def _interpolated(values: Array, segment: Ints, begin: Ints, length: int, rule: int) -> Array:
    """Values of the holes of one length, shape (holes, length); a line where an outer sample is missing."""
    rows = begin[:, None] + np.array([-2, -1, length, length + 1])
    bounded = rows.clip(0, len(values) - 1)
    nodes = values[bounded]
    whole = np.isfinite(nodes).all(axis=1) & (rows == bounded).all(axis=1)
    whole &= (segment[bounded] == segment[bounded[:, 1:2]]).all(axis=1)
    simple = _weights(length, min(rule, LINE))[:, 1:3]
    return np.asarray(np.where(whole[:, None], nodes @ _weights(length, rule).T, nodes[:, 1:3] @ simple.T))


def without_short(rec: Record, shortest: int = SHORTEST) -> Record:
    """The record without segments of fewer than ``shortest`` samples, with a note.

    They may hold at most a tenth of all samples together: of a record in many short segments only the shortest are left
    out.

    Examples
    --------
    >>> rec = Record(u=np.arange(100.0), y=np.ones(100), sample_time=0.1, starts=(0, 70, 74))
    >>> kept = without_short(rec, 20)
    >>> len(kept), kept.starts, kept.notes
    (96, (0, 70), ('1 of 3 segments has fewer than 20 samples and is left out: 4 samples, from 7 s on',))
    """
    lengths = np.diff([*rec.starts, len(rec)])
    ordered = np.sort(lengths)
    limit = min(shortest, int(ordered[np.searchsorted(np.cumsum(ordered), LEFT_OUT * len(rec), "right")]))
    kept = lengths >= limit
    if kept.all():
        return rec
    rows = np.repeat(kept, lengths)
    out = np.flatnonzero(~kept)
    places = ", ".join(f"{rec.starts[k] * rec.sample_time:.3g}" for k in out[:3]) + (", ..." if len(out) > 3 else "")
    note = (
        f"{len(out)} of {len(kept)} segments {'has' if len(out) == 1 else 'have'} fewer than {limit} samples and "
        f"{'is' if len(out) == 1 else 'are'} left out: {int(lengths[~kept].sum())} samples, from {places} s on"
    )
    assert rec.offsets is not None  # noqa: S101  set in __post_init__
    starts = np.concatenate([[0], np.cumsum(lengths[kept])])[:-1]
    return replace(
        rec, u=rec.u[rows], y=rec.y[rows], starts=tuple(int(s) for s in starts), offsets=rec.offsets[kept],
        sha256=None, notes=(*rec.notes, note), reference=None if rec.reference is None else rec.reference[rows],
    )  # fmt: skip
