"""Outliers of the output: spikes and jumps, found in the innovations of a regression of high order.

Spikes are additive outliers: an isolated wrong sample appears in the innovations as the polynomial a, which a matched
filter separates from a load impulse (a single innovation). Their samples are then treated as missing. Source: Chang,
Tiao & Chen 1988, doi 10.1080/00401706.1988.10488367.
"""

import itertools
from dataclasses import replace

import numpy as np

from ..core.arrays import MAD, Array, Flags, Ints
from ..datasets.records.record import Record
from .estimators.filters import filtered
from .estimators.high_order_arx import U_LAGS, LongArx, input_lags, long_arx, spread

SPIKE = 6.0  # robust standard deviations of the innovations
SMALLEST = 0.02  # of the standard deviation of y: smaller spikes do no harm
EARLY = (10.0, 0.1)  # the same two of the first samples of a segment, which respond to an unknown input before it
PATCH = (1, 2, 3)  # samples of one spike
MOST_NEAR = 3  # further spikes within the response of one
DEPENDENT = 0.1  # share of a response that the others must leave
JUMP = (10.0, 0.1)  # least jump, in robust standard deviations of the innovations and in standard deviations of y
LIKE_A_SPIKE = 0.95  # of the response as a load impulse, a change of the innovation
MOST_SPIKES, ROUNDS = 0.05, 6  # share of the samples above which the noise has heavy tails; repetitions
SKIP = 30.0  # median errors of the prediction of a smooth input at samples that may be missing
SKIP_LAGS, SKIP_NEAR, SKIP_AFTER = 6, 60, 6  # lags of the prediction; samples before it, and after it that must agree
MOST_SKIPS, LONGEST_SKIP = 5, 25  # more places are edges of the input; samples missing at one place
FEWEST_HELD, CHANCE = 4, 1e-3  # equal readings of a held output, and their probability in a record without one
FEWEST_READINGS, REGULAR, UNEVEN = 20, 0.9, 4  # readings, share of equal intervals, and intervals that may vary by 1
AGREES = 0.2  # of the difference that remains


def without_spikes(rec: Record, y_lags: int, least_lag: int = 0) -> tuple[Record, Ints, bool]:
    """The record with spikes of y replaced, their samples, and whether outliers are too many to be spikes.

    The first samples of a segment have no innovations; their spikes are found in the reversed record. Those that begin
    with the very first sample are kept: where a machine at rest gets an input that is not zero, as at the start of a
    chirp by cosine, the first samples respond to an input before the record, and only they do not fit the others. After
    a dead time they begin later, and are known by their values, which lie between those before and after them. With
    ``least_lag`` 1, in closed loop, the record is not reversed: the next u of a controller determines the present y.
    """
    clean, bad = _cleaned(rec, y_lags, np.ones(len(rec), dtype=bool), (SPIKE, SMALLEST), least_lag)
    if not least_lag and bad.mean() <= MOST_SPIKES:
        first = np.zeros(len(rec), dtype=bool)
        for s in rec.stretches:
            first[s.start : s.start + y_lags * len(U_LAGS)] = True
        back, early = _cleaned(_reversed(clean), y_lags, first[::-1], EARLY)
        early = _not_from_the_start(early[::-1], rec.stretches)
        early &= ~_within_neighbours(rec.y, early)
        clean, bad = replace(clean, y=np.where(early, back.y[::-1], clean.y)), bad | early
    if bad.mean() > MOST_SPIKES:
        return rec, np.empty(0, dtype=np.intp), True
    return clean, np.flatnonzero(bad), False


def _not_from_the_start(bad: Flags, stretches: tuple[slice, ...]) -> Flags:
    """The samples without the runs that begin with the first sample of a segment."""
    kept = bad.copy()
    for s in stretches:
        kept[s] &= np.logical_or.accumulate(~bad[s])
    return kept


def _within_neighbours(y: Array, bad: Flags) -> Flags:
    """The samples of runs whose values lie between those before and after them: a response that begins, no spike."""
    found, slack = np.zeros(len(bad), dtype=bool), EARLY[1] * float(np.std(y))
    edges = np.flatnonzero(np.diff(bad, prepend=False, append=False))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        low, high = sorted((y[max(start - 1, 0)], y[min(stop, len(y) - 1)]))
        part = y[start:stop]
        found[start:stop] = bool((part > low - slack).all() and (part < high + slack).all())
    return found


def _cleaned(
    rec: Record, y_lags: int, searched: Flags, least: tuple[float, float], least_lag: int = 0
) -> tuple[Record, Flags]:
    """The record with spikes among the ``searched`` samples replaced, and these; too many are not replaced.

    ``least`` is the smallest spike, relative to the innovations and to the output.
    """
    bad = np.zeros(len(rec), dtype=bool)
    clean, lags = rec, input_lags(spread(rec), y_lags, least_lag)
    for _ in range(ROUNDS):
        fit = long_arx(spread(clean), y_lags, lags)
        e = innovations(clean, fit)
        new = _spikes(e, fit.a, clean.stretches, (least[0], least[1] * float(np.std(clean.y)))) & ~bad & searched
        if not new.any():
            break
        bad |= new
        if bad.mean() > MOST_SPIKES:
            return rec, bad
        clean = _filled(clean, e, fit.a, bad)
    return clean, bad


def _reversed(rec: Record) -> Record:
    """The record in reverse order of time."""
    starts = tuple(len(rec) - s.stop for s in reversed(rec.stretches))
    offsets = np.asarray(rec.offsets)[::-1]
    return replace(rec, u=rec.u[::-1], y=rec.y[::-1], starts=starts, offsets=offsets, reference=None)


def innovations(rec: Record, fit: LongArx) -> Array:
    """Innovations e of all samples (N,), without the level of each stretch; 0 where lags are missing."""
    e = filtered(fit.a, [1.0], rec.y, rec.stretches) - filtered(fit.b, [1.0], rec.u, rec.stretches)
    for s in rec.stretches:
        start = min(s.start + max(len(fit.a), len(fit.b)) - 1, s.stop)
        if start < s.stop:
            e[start : s.stop] -= np.median(e[start : s.stop])
        e[s.start : start] = 0.0
    return np.asarray(e)


def jumps(e: Array, least: float) -> Ints:
    """Samples of single innovations (N,) that no noise of the record explains, ``least`` or more in the unit of y.

    A jump of the level of y is one innovation where the high-order regression has a pole near 1, as it has with it.
    """
    scale = MAD * float(np.median(np.abs(e[e != 0.0]))) if e.any() else 0.0
    return np.flatnonzero(np.abs(e) > max(JUMP[0] * scale, least)) if scale else np.empty(0, dtype=np.intp)


def skips(u: Array, stretches: tuple[slice, ...]) -> list[tuple[int, int]]:
    """Samples (k, n) of an input (N,) where it continues as if n samples before sample k were missing.

    A smooth input (a chirp, a sum of sines) is predicted by its own last samples; where it is not, it may agree with
    its prediction n samples later.
    """
    found = []
    for s in stretches:
        part = u[s]
        if len(part) < 2 * SKIP_NEAR or not np.ptp(part):
            continue
        lags = np.lib.stride_tricks.sliding_window_view(part[:-1], SKIP_LAGS) - part.mean()
        after = part[SKIP_LAGS:] - part.mean()
        off = np.abs(after - lags @ np.linalg.lstsq(lags, after)[0])
        at = np.flatnonzero(off > max(SKIP * float(np.median(off)), 1e-9 * float(np.ptp(part)))) + SKIP_LAGS
        at = at[np.diff(at, prepend=-SKIP_LAGS) > SKIP_LAGS]  # the first of those that see the same place
        if len(at) <= MOST_SKIPS:
            for k in at:  # at an extreme of the input the samples after the place deviate first
                agree = ((int(j), n) for j in (k, k - 1, k - 2) if (n := _missing(part, int(j))))
                found += [(s.start + j, n) for j, n in itertools.islice(agree, 1)]
    return found


def held(rec: Record, scatter: float) -> list[tuple[int, int]]:
    """Runs (k, n) of n equal readings of the output from sample k on, while the input changes; none that are chance.

    An innovation of standard deviation ``scatter`` lets a reading of resolution q repeat with probability
    q / (scatter sqrt(2 pi)) at most; a sensor that is read more often than it measures repeats others, too.
    """
    levels = np.unique(rec.y)
    if len(levels) < 2 or not scatter:
        return []
    chance = float(np.diff(levels).min()) / (scatter * np.sqrt(2 * np.pi))
    first = np.r_[True, np.diff(rec.y) != 0.0]
    first[[s.start for s in rec.stretches]] = True
    at = np.flatnonzero(first)
    counts = np.diff(np.r_[at, len(rec)])
    others = (len(rec) - len(at) - (counts - 1) + 1) / len(rec)  # repeated readings outside of each run
    rare = len(rec) * np.minimum(np.maximum(chance, others), 1.0) ** (counts - 1) < CHANCE
    runs = zip(at[rare].tolist(), counts[rare].tolist(), strict=True)
    return [(k, n) for k, n in runs if n >= FEWEST_HELD and np.ptp(rec.u[k : k + n])]


def repeats(rec: Record) -> int:
    """Samples from one reading of a slow sensor to the next, where each is repeated as often; 1 of any other output.

    >>> repeats(Record(u=np.arange(200.0), y=np.repeat(np.sin(np.arange(50.0)), 4), sample_time=0.01))
    4
    """
    change = np.diff(rec.y)
    change[[s.start - 1 for s in rec.stretches[1:]]] = 0.0
    at = np.flatnonzero(change)
    if len(at) < FEWEST_READINGS or len(np.unique(np.abs(change[at]))) < len(at) / 2:  # a coarse one has few steps
        return 1
    gaps = np.diff(at)
    usual = int(np.median(gaps))
    apart = np.abs(gaps - usual) <= (
        1 if usual >= UNEVEN else 0
    )  # with a clock of its own it is a sample late or early
    return usual if usual > 1 and apart.mean() > REGULAR else 1


def _missing(u: Array, k: int) -> int:
    """Samples that are missing before sample k of a smooth input, 0 where none agree."""
    before = u[max(k - SKIP_NEAR, 0) : k]
    after = u[k : k + SKIP_AFTER]
    if len(before) < SKIP_NEAR // 2 or len(after) < SKIP_AFTER:
        return 0
    mean = before.mean()
    lags = np.lib.stride_tricks.sliding_window_view(before[:-1] - mean, SKIP_LAGS)
    weights = np.linalg.lstsq(lags, before[SKIP_LAGS:] - mean)[0]
    path = list(before[-SKIP_LAGS:] - mean)
    for _ in range(LONGEST_SKIP + SKIP_AFTER):
        path.append(float(weights @ path[-SKIP_LAGS:]))
    future = np.array(path[SKIP_LAGS:]) + mean
    off = [float(np.abs(after - future[n : n + SKIP_AFTER]).max()) for n in range(LONGEST_SKIP + 1)]
    best = int(np.argmin(off))
    return best if off[best] < AGREES * off[0] else 0


def _spikes(e: Array, a: Array, stretches: tuple[slice, ...], least: tuple[float, float]) -> Flags:
    """Samples of spikes of at least the size ``least``, in standard deviations of e and in the unit of y.

    A spike is the largest matched response within the length of a, and larger than that of a load impulse.
    """
    scale = MAD * float(np.median(np.abs(e[e != 0.0]))) if e.any() else 0.0
    found = np.zeros(len(e), dtype=bool)
    if scale == 0.0:
        return found
    limit = max(least[0] * scale, least[1] * float(np.linalg.norm(a)))
    for s in stretches:
        part, width = e[s], np.ones(s.stop - s.start, dtype=np.intp)
        best, ends = np.zeros(len(part)), len(part) - 1 - np.arange(len(part))
        for count in PATCH:
            shape = np.convolve(a, np.ones(count))
            length = np.sqrt(np.cumsum(shape**2))[
                np.minimum(ends, len(shape) - 1)
            ]  # the last samples see its beginning
            response = np.abs(_matched(part, shape)) / length
            larger = response > best * (1.1 if count > 1 else 1.0)  # fewer samples where both explain it
            best, width = np.where(larger, response, best), np.where(larger, count, width)
        for k in np.flatnonzero(best > limit):
            near = slice(max(k - len(a), 0), k + len(a))
            if best[k] < best[near].max():
                continue
            if best[k] >= LIKE_A_SPIKE * np.abs(part[near]).max():
                found[s.start + k : min(s.start + k + width[k], s.stop)] = True
            else:
                found[s.start + np.array(_overlapping(part, a, int(k), limit), dtype=np.intp)] = True
    return found


def _overlapping(e: Array, a: Array, k: int, limit: float) -> list[int]:
    """Samples of two or more spikes, k and those near it, that together explain more than as many load impulses.

    The largest responses are taken one after the other, each given those before it.
    """
    products = np.r_[np.correlate(a, a, "full")[len(a) - 1 :], 0.0]
    c, at = _matched(e, a), [k]
    last = len(e) - len(a)
    if k > last:
        return []
    for _ in range(MOST_NEAR):
        near = np.arange(max(min(at) - len(a), 0), min(max(at) + len(a), last))
        lags = products[np.minimum(np.abs(near[:, None] - np.array(at)), len(a))]
        inverse = np.linalg.inv(products[np.minimum(np.abs(np.subtract.outer(at, at)), len(a))])
        left = c[near] - lags @ inverse @ c[at]
        own = np.maximum(products[0] - np.einsum("ij,jk,ik->i", lags, inverse, lags), 0.0)
        apart = np.abs(near[:, None] - np.array(at)).min(axis=1) >= len(PATCH)
        further = np.where(apart, left**2 / np.maximum(own, DEPENDENT * products[0]), 0.0)
        if not further.size or further.max() <= limit**2:
            return []
        at.append(int(near[np.argmax(further)]))
        explained = c[at] @ np.linalg.solve(products[np.minimum(np.abs(np.subtract.outer(at, at)), len(a))], c[at])
        around = e[max(min(at) - len(a), 0) : max(at) + len(a)]
        if explained >= LIKE_A_SPIKE**2 * np.sort(around**2)[-len(at) :].sum():
            return at
    return []


def _matched(e: Array, shape: Array) -> Array:
    """Sum of shape(i) e(k + i) for every k of a stretch (n,)."""
    return np.convolve(e, shape[::-1])[len(shape) - 1 :][: len(e)]


def _filled(rec: Record, e: Array, a: Array, bad: Flags) -> Record:
    """The record with the samples ``bad`` replaced by the values with the smallest innovations."""
    y = rec.y.copy()
    for s in rec.stretches:
        at = np.flatnonzero(bad[s])
        for group in np.split(at, np.flatnonzero(np.diff(at) >= len(a)) + 1):
            if group.size:
                first, stop = group[0], min(group[-1] + len(a), s.stop - s.start)
                effect = np.zeros((stop - first, len(group)))
                for k, sample in enumerate(group):
                    effect[sample - first : sample - first + len(a), k] = a[: stop - sample]
                y[s.start + group] -= np.linalg.lstsq(effect, e[s.start + first : s.start + stop])[0]
    return replace(rec, y=y)
