"""Cuts of a record: where a load leaves its local idle level, by hysteresis, and the air before and after each.

The load is averaged over blocks of 20 ms and over a revolution; its median over half a second is free of short peaks.
The idle level follows the air between cuts, so that a slow drift of the zero is no cut. A spindle drive has three
levels: off, idle and cut. All times are for cuts of a second and more, and shorter in proportion for shorter cuts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import MAD, Array
from ...core.errors import DataError
from .contrast import Interval, chosen_signal, noise_and_reach, widened
from .options import DRIVEN, ReduceOptions
from .recording import Recording

BLOCK = 0.02  # s, a period of 50 Hz
SMOOTHED = 0.2  # s, at least
STARTING = 5.0  # s in which a spindle starts or stops
SETTLED = 0.3  # s between a cut and the air that counts
AIR = 5.0  # s of air used before and after a cut, at most
FOLLOWING = 2.0  # s, time constant of the idle level
MERGED = 0.5  # s; a shorter fall to idle is part of the cut
NOISE = 6.0  # standard deviations of the idle level
SMALL = 0.4  # of the threshold; such loads are air, but named
LEFT = 0.25  # share of the load of a cut below which it has ended
PLATEAU = 0.9  # share of the load from which entry and exit have ended
SCATTER = 4.0  # standard deviations of the load that count as steady
OFF = 0.1  # share of the next level below which a spindle is off
RESTLESS = 3.0  # ratio of the scatter of two seconds that distinguishes cut from air
ALIKE = 0.2  # difference of the idle levels before and after, as a share of the load
DETECTABLE = 5.0  # contrast, in standard deviations


@dataclass(frozen=True, slots=True)
class Cut:
    """One cut of a record, in samples; each interval is [first, end).

    Attributes
    ----------
    span : from where the load leaves idle to where it is back
    window : part without entry, exit and guard
    before, after : air next to it; empty where there is none
    """

    span: Interval
    window: Interval
    before: Interval
    after: Interval


@dataclass(frozen=True, slots=True)
class CutsFound:
    """Cuts of a record, and how they were found.

    Attributes
    ----------
    cuts : tuple of Cut
    signal : str
        Channel, or standard deviation of a channel, on which they were found.
    levels : mapping of str to float
        Median level of the states found: off (a drive only), idle and cut.
    remarks : tuple of str
    """

    cuts: tuple[Cut, ...]
    signal: str
    levels: Mapping[str, float]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Search:
    """A smoothed load without and with its short peaks, shape (m,), and the sizes of the search in blocks."""

    load: Array
    peaks: Array
    step: float
    high: float
    scale: float
    driven: bool

    def count(self, seconds: float) -> int:
        return max(1, round(seconds * self.scale / self.step))


def find_cuts(recording: Recording, how: ReduceOptions, revolution: float = 0.0) -> CutsFound:
    """The cuts of a record.

    Parameters
    ----------
    recording : Recording
    how : ReduceOptions
    revolution : float, s
        Longest revolution of the tests, over which the load is smoothed; 0 where it is not known.

    Raises
    ------
    DataError
        No load exceeds its idle level, or no cut is as long as the shortest allowed.
    UsageError
        The channel chosen does not exist.
    """
    scale = min(1.0, how.shortest)
    size = max(1, round(BLOCK * scale / recording.sample_time))
    step = size * recording.sample_time
    width = max(1, round(max(SMOOTHED * scale, revolution) / step))
    signal, peaks, load = chosen_signal(recording, how, size, width, step / scale)
    noise, reach = noise_and_reach(load, step / scale)
    if reach < DETECTABLE * noise or reach == 0:
        raise DataError(_no_cut(recording.name, signal, load, noise))
    driven = signal.removeprefix("standard deviation of ") in DRIVEN
    search = _Search(load, peaks, step, max(NOISE * noise, how.threshold * reach), scale, driven)
    spans, levels = _three_states(search, _spans(search))
    spans = [span for span in spans if _exceeds(search, span)]
    long = [span for span in spans if (span[1] - span[0]) * step >= how.shortest]
    if not long:
        raise DataError(_no_cut(recording.name, signal, load, noise, [(b - a) * step for a, b in spans]))
    remarks = []
    if len(long) < len(spans):
        shown = ", ".join(f"{(b - a) * step:.2g} s at {a * step:.4g} s" for a, b in spans if (a, b) not in long)
        remarks.append(f"shorter than {how.shortest:g} s and left out: {shown}")
    if "off" not in levels:
        remarks += _small_loads(search, long, NOISE * noise, reach, how)
    cuts = tuple(_cut(search, k, long, how, width, size, len(recording)) for k in range(len(long)))
    middle = float(np.median(np.concatenate([load[a:b] for a, b in long])))
    idle = levels["idle"]
    if driven and abs(middle) < abs(idle):
        raise DataError(
            f"{recording.name}: {signal} is {middle:.4g} in the cut and {idle:.4g} when idle; a cut must exceed idle. "
            "Look at the picture; name another channel with --channel, or take the record out."
        )
    return CutsFound(cuts, signal, {**levels, "cut": middle}, tuple(remarks))


def _small_loads(search: _Search, cuts: list[Interval], noise: float, reach: float, how: ReduceOptions) -> list[str]:
    """A remark on loads below the threshold that last as long as a cut."""
    lowest = max(noise, SMALL * how.threshold * reach)
    if lowest > 0.8 * search.high:
        return []
    found = _spans(replace(search, high=lowest))
    small = [
        (a, b)
        for a, b in found
        if (b - a) * search.step >= how.shortest and not any(a < end and first < b for first, end in cuts)
    ]
    if not small:
        return []
    shown = ", ".join(f"{(b - a) * search.step:.3g} s at {a * search.step:.4g} s" for a, b in small[:4])
    more = f" and {len(small) - 4} more" if len(small) > 4 else ""
    return [f"loads below {100 * how.threshold:g} % of the largest are taken as air: {shown}{more} (--threshold)"]


def _spans(search: _Search, begin: Interval | None = None) -> list[Interval]:
    """Intervals in blocks in which the load is away from its local idle level."""
    load, rate = search.load, min(1.0, search.step / (FOLLOWING * search.scale))
    first, end = begin or (0, len(load))
    idle = _first_idle(search, first, end)
    spans: list[Interval] = []
    start, level, sign, j = -1, 0.0, 1.0, first
    values = load.tolist()
    while j < end:
        away = sign * (values[j] - idle)
        if start < 0:
            if abs(away) > search.high:
                start, level, sign = j, abs(away), 1.0 if values[j] > idle else -1.0
            else:
                idle += rate * (values[j] - idle)
        else:
            level += rate * (away - level)
            if away < max(LEFT * level, min(search.high / 2, level / 2)):
                spans.append((start, j))
                start = -1
                ahead = load[j + search.count(SETTLED) : min(end, j + search.count(SETTLED + 1.0))]
                near = ahead[sign * (ahead - idle) < max(LEFT * level, search.high)]
                idle = float(np.median(near)) if near.size else idle
        j += 1
    if start >= 0:
        spans.append((start, end))
    return _merged(spans, search.count(MERGED))


def _first_idle(search: _Search, first: int, end: int) -> float:
    """Level of the first second, or the lowest one where the record begins in a cut.

    It begins in air where the first level is the lowest; and where it is the last one too, an offset of the amplifier,
    unless it is less quiet or the load is that of a drive.
    """
    size = search.count(1.0)
    load = search.load[first:end]
    level, last = float(np.median(load[:size])), float(np.median(load[-size:]))
    windows = load[: len(load) // size * size].reshape(-1, size)
    if not len(windows):
        return level
    medians = np.median(windows, axis=1)
    at = int(np.argmin(np.abs(medians)))
    lowest = float(medians[at])
    if abs(level) - abs(lowest) <= 1.5 * search.high:
        return level
    peaks = search.peaks[first:end]
    restless = peaks[:size].std() > RESTLESS * peaks[at * size : (at + 1) * size].std()
    return lowest if search.driven or restless or abs(last - level) > search.high else level


def _exceeds(search: _Search, span: Interval) -> bool:
    """Whether the load of a span differs from the level beside it by more than the threshold."""
    near = search.count(1.0)
    beside = [search.load[max(0, span[0] - near) : span[0]], search.load[span[1] : span[1] + near]]
    levels = [float(np.median(part)) for part in beside if part.size]
    return not levels or abs(float(np.median(search.load[span[0] : span[1]])) - float(np.mean(levels))) > search.high


def _merged(spans: Sequence[Interval], gap: int) -> list[Interval]:
    out: list[Interval] = []
    for first, end in spans:
        if out and first - out[-1][1] < gap:
            out[-1] = (out[-1][0], end)
        else:
            out.append((first, end))
    return out


def _three_states(search: _Search, spans: list[Interval]) -> tuple[list[Interval], dict[str, float]]:
    """Cuts of a drive between the starts and stops of its spindle, where it has these; the levels of off and idle."""
    load = search.load
    if search.driven:
        rest, running = _running(search)
        inner = [(span, *_inner(search, span, rest)) for span in running]
        idles = [idle for _, _, idle in inner if idle is not None]
        if idles:
            idle = float(np.median(idles))
            cuts: list[Interval] = []
            for span, found, own in inner:
                level = float(np.median(load[span[0] : span[1]]))
                cuts += found if own is not None or abs(level - idle) > ALIKE * abs(idle) else []
            return cuts, {"off": rest, "idle": idle}
    outside = np.ones(len(load), dtype=bool)
    margin = search.count(SETTLED)
    for first, end in spans:
        outside[max(0, first - margin) : end + margin] = False
    return spans, {"idle": float(np.median(load[outside])) if outside.any() else float("nan")}


def _running(search: _Search) -> tuple[float, list[Interval]]:
    """Level of the lowest second, and the intervals in which the load is above it."""
    size = search.count(1.0)
    windows = search.load[: len(search.load) // size * size].reshape(-1, size)
    medians = np.median(windows, axis=1) if len(windows) else search.load
    rest = float(medians[np.argmin(np.abs(medians))])
    level = OFF / 2 * float(np.abs(search.load - rest).max())
    return rest, widened(np.flatnonzero(np.abs(search.load - rest) > level), search.count(MERGED))


def _inner(search: _Search, span: Interval, rest: float) -> tuple[list[Interval], float | None]:
    """Cuts between the start and the stop of a spindle, and its idle level; the span itself where it is a cut."""
    margin = search.count(SETTLED)
    first, end = span[0] + margin, span[1] - margin
    second = search.count(1.0)
    if end - first < 3 * second:
        return [span], None
    head, tail = min(search.count(STARTING), (end - first) // 2), second // 2 + 1
    skipped, before = _lowest(search.load[first : first + head], tail)
    left, after = _lowest(search.load[end - head : end][::-1], tail)
    first, end = first + skipped, end - left
    noise, reach = noise_and_reach(search.load[first:end], search.step / search.scale)
    inside = replace(search, high=max(NOISE * noise, 0.1 * reach))
    idle = (before + after) / 2
    if not abs(rest) < OFF * abs(idle) or reach < DETECTABLE * noise or reach < ALIKE * abs(idle):
        return [span], None
    found = [(a, b) for a, b in _spans(inside, (first, end)) if b - a >= second // 2]  # the rest of a surge is none
    complete = bool(found) and found[0][0] > first + 1 and found[-1][1] < end - 1
    higher = all(abs(float(np.median(search.load[a:b]))) > abs(idle) for a, b in found)
    if not complete or not higher or abs(before - after) > ALIKE * reach:
        return [span], None
    return found, idle


def _lowest(load: Array, size: int) -> tuple[int, float]:
    """Place and level of the lowest median of ``size`` values, shape (m,): idle, after the surge of a start."""
    medians = [float(np.median(load[k : k + size])) for k in range(0, max(1, len(load) - size + 1), size)]
    at = int(np.argmin(np.abs(medians)))
    return at * size, medians[at]


def _cut(search: _Search, k: int, spans: Sequence[Interval], how: ReduceOptions, width: int, size: int, n: int) -> Cut:
    """Span k with its window and the air around it, in samples."""
    first, end = spans[k]
    lower = spans[k - 1][1] if k else 0
    upper = spans[k + 1][0] if k + 1 < len(spans) else len(search.load)
    settled, air = search.count(SETTLED) + width // 2, search.count(AIR)
    before = _same_level(search, (max(lower + settled, first - settled - air), first - settled), from_end=True)
    after = _same_level(
        search, (end + settled, min(upper - settled if k + 1 < len(spans) else upper, end + settled + air))
    )
    away = np.abs(search.peaks[first:end] - _idle_at(search, before, after))
    begins = settled_blocks(away, search.count(SETTLED))
    ends = settled_blocks(away[::-1], search.count(SETTLED))
    guard = max(round(how.guard * len(away)), width // 2 + 1)
    inner = (first + begins + guard, end - ends - guard)
    if inner[1] - inner[0] < max(1, len(away) // 10):
        middle = (first + end) // 2
        inner = (middle - len(away) // 4, middle + len(away) // 4 + 1)
    scaled = [(min(a * size, n), min(b * size, n)) for a, b in ((first, end), inner, before, after)]
    return Cut(*scaled)


def settled_blocks(away: Array, run: int) -> int:
    """Blocks until the load, shape (m,), stays near the line through its middle half; a third at most."""
    quarter, third = max(1, len(away) // 4), max(1, len(away) // 3)
    middle = away[quarter : len(away) - quarter]
    half = max(1, len(middle) // 2)
    first, second = float(np.median(middle[:half])), float(np.median(middle[-half:]))
    slope = (second - first) / max(1, len(middle) - half)
    line = first + slope * (np.arange(len(away)) - quarter - (half - 1) / 2)
    off = np.abs(away - line)
    band = max((1 - PLATEAU) * first, SCATTER * MAD * float(np.median(off[quarter : len(away) - quarter])))
    outside = np.flatnonzero(off[: third + run] > band)
    if not outside.size:
        return 0
    quiet = np.flatnonzero(np.diff(np.append(outside, third + run)) > run)
    return min(int(outside[quiet[0]]) + 1, third) if quiet.size else third


def _idle_at(search: _Search, before: Interval, after: Interval) -> float:
    parts = [search.load[a:b] for a, b in (before, after) if b > a]
    return float(np.mean([np.median(part) for part in parts])) if parts else 0.0


def _same_level(search: _Search, air: Interval, *, from_end: bool = False) -> Interval:
    """The part of an interval of air next to the cut that stays at one level: not the start or stop of the spindle."""
    first, end = max(air[0], 0), min(air[1], len(search.load))
    if end <= first:
        return (first, first)
    part = search.load[first:end]
    near = part[-search.count(0.5) :] if from_end else part[: search.count(0.5)]
    off = np.abs(part - np.median(near)) > search.high
    if from_end:
        stop = len(off) - int(np.argmax(off[::-1])) if off.any() else 0
        return (min(first + stop + (search.count(SETTLED) if stop else 0), end), end)
    stop = int(np.argmax(off)) if off.any() else len(off)
    return (first, max(first + stop - (search.count(SETTLED) if stop < len(off) else 0), first))


def _no_cut(name: str, signal: str, load: Array, noise: float, short: Sequence[float] = ()) -> str:
    if short:
        return (
            f"{name} contains no cut: its loads last {', '.join(f'{s:.2g}' for s in short[:5])} s. Give the shortest "
            "cut with --shortest (s), or take the record out of the folder, with its row of the plan."
        )
    return (
        f"{name} contains no cut: {signal} stays within {load.min():.4g} to {load.max():.4g} (noise {noise:.2g}) and "
        "does not leave its idle level. Take the record out of the folder, with its row of the plan, or name another "
        "channel with --channel."
    )
