"""Additive disturbances of the output: spikes, drift and spectral lines, tested in a regression of high order.

Spikes are additive outliers: an isolated wrong sample appears in the innovations as the polynomial a, which a matched
filter separates from a load impulse (a single innovation). Their samples are then treated as missing. Source: Chang,
Tiao & Chen 1988, doi 10.1080/00401706.1988.10488367.

A line is tested by the F test of a sine and a cosine in addition to all lags, at every frequency of a grid: the
regression alone absorbs a line almost completely. Source: Thomson 1982, doi 10.1109/PROC.1982.12433 (F test of a line).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Array
from ..datasets.records.record import Record
from .estimators.filters import filtered
from .estimators.high_order_arx import U_LAGS, LongArx, golden, input_lags, long_arx, spread

SPIKE = 6.0  # robust standard deviations of the innovations
SMALLEST = 0.02  # of the standard deviation of y: smaller spikes do no harm
EARLY = (10.0, 0.1)  # the same two of the first samples of a segment, which respond to an unknown input before it
PATCH = (1, 2, 3)  # samples of one spike
MOST_NEAR = 3  # further spikes within the response of one
DEPENDENT = 0.1  # share of a response that the others must leave
LIKE_A_SPIKE = 0.95  # of the response as a load impulse, a change of the innovation
MOST_SPIKES, ROUNDS = 0.05, 6  # share of the samples above which the noise has heavy tails; repetitions
FALSE_ALARM = 1e-5  # probability that a record without lines has one
DRIFT, DRIFT_ALARM = 3, 1e-5  # degree; stricter, as a slow plant leaves some of its dynamics
INTEGRATING = 1e-6  # a(1) of an integrator, relative to the sum of |a|: its output drifts without a disturbance
MOST_LINES, MOST_SEGMENTS = 4, 3  # lines, and segments in which they are searched
SLOWEST = 4.0  # periods of a line within a stretch; slower ones are drift
PADDED = 4  # points of the search per independent frequency
ALIASES = 2  # multiples of the sample rate for which the true frequency of a line is named
MAINS = (50.0, 60.0)
UNDAMPED = 0.98  # modulus of a root that may stand for a line
REFINED = 12  # evaluations of the exact frequency
MAD = 1.4826  # standard deviation of a normal distribution per median absolute deviation


def additional_columns(rec: Record, lines: tuple[float, ...], drift: int) -> Array:
    """Cosine and sine of each line and powers of time in each stretch, shape (N, k), zero outside the stretch."""
    columns = []
    for s in rec.stretches:
        n = s.stop - s.start
        t = np.arange(n)
        x = 2 * (t + 0.5) / n - 1
        own = [x**k for k in range(1, drift + 1)]
        for f in lines:
            own += [np.cos(2 * np.pi * f * rec.sample_time * t), np.sin(2 * np.pi * f * rec.sample_time * t)]
        for values in own:
            columns.append(np.zeros(len(rec)))
            columns[-1][s] = values
    return np.column_stack(columns) if columns else np.empty((len(rec), 0))


def without_spikes(rec: Record, y_lags: int) -> tuple[Record, NDArray[np.intp], bool]:
    """The record with spikes of y replaced, their samples, and whether outliers are too many to be spikes.

    The first samples of a segment have no innovations; their spikes are found in the reversed record.
    """
    clean, bad = _cleaned(rec, y_lags, np.ones(len(rec), dtype=bool), (SPIKE, SMALLEST))
    if bad.mean() <= MOST_SPIKES:
        first = np.zeros(len(rec), dtype=bool)
        for s in rec.stretches:
            first[s.start : s.start + y_lags * len(U_LAGS)] = True
        back, early = _cleaned(_reversed(clean), y_lags, first[::-1], EARLY)
        clean, bad = replace(clean, y=back.y[::-1].copy()), bad | early[::-1]
    if bad.mean() > MOST_SPIKES:
        return rec, np.empty(0, dtype=np.intp), True
    return clean, np.flatnonzero(bad), False


def _cleaned(
    rec: Record, y_lags: int, searched: NDArray[np.bool_], least: tuple[float, float]
) -> tuple[Record, NDArray[np.bool_]]:
    """The record with spikes among the ``searched`` samples replaced, and these; too many are not replaced.

    ``least`` is the smallest spike, relative to the innovations and to the output.
    """
    bad = np.zeros(len(rec), dtype=bool)
    clean, lags = rec, input_lags(spread(rec), y_lags)
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


def _spikes(e: Array, a: Array, stretches: tuple[slice, ...], least: tuple[float, float]) -> NDArray[np.bool_]:
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


def _filled(rec: Record, e: Array, a: Array, bad: NDArray[np.bool_]) -> Record:
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


def drift_degree(fit: LongArx, columns: Array) -> int:
    """Degree of the drift, 0 for none; ``columns`` (N, k) are the powers 1 to 3 of time in each stretch."""
    x, n = columns[fit.rows], len(fit.rows)
    tested = [fit.f_test(x[:, _powers(x, degree)]) for degree in range(1, DRIFT + 1)]
    if min(p for p, _ in tested) > DRIFT_ALARM:
        return 0
    stretches = x.shape[1] // DRIFT
    bic = [n * np.log(max(1 - share, 1e-300)) + k * stretches * np.log(n) for k, (_, share) in enumerate(tested, 1)]
    return 1 + int(np.argmin(bic))


def _powers(x: Array, degree: int) -> NDArray[np.bool_]:
    return np.arange(x.shape[1]) % DRIFT < degree


def drift_range(a: Array, coefficients: Array, length: int) -> float | None:
    """Range of the drift of the output over a stretch from the polynomial of the regression; None if a has a root at 1.

    The polynomial a maps polynomials of time to polynomials of the same degree; its inverse gives that of the output.
    """
    t = 2 * (np.arange(length) + 0.5) / length - 1
    powers = t[:, None] ** np.arange(len(coefficients) + 1)
    after = filtered(a, [1.0], powers, (slice(0, length),))[len(a) - 1 :]
    maps = np.linalg.lstsq(powers[len(a) - 1 :], after, rcond=None)[0]
    if np.abs(np.diag(maps)).min() < INTEGRATING * np.abs(a).sum():
        return None
    return float(np.ptp(powers @ np.linalg.solve(maps, np.r_[0.0, coefficients])))


def strongest_line(fit: LongArx, rec: Record, additional: Array | None = None) -> tuple[float, float]:
    """Frequency (cycles per sample) of the line that explains most, and its p value over the grid.

    The phase is free in each of the longest segments: samples between segments are not counted. With lags of y the
    decrease of a strong line is large at its exact frequency only, between the points of the grid; its frequency is
    therefore searched also without lags of y (``additional`` are the columns of ``fit``), and at undamped roots of a.
    """
    from scipy.special import fdtrc

    stretch = np.searchsorted(rec.starts, fit.rows, side="right") - 1
    count = np.bincount(stretch)
    groups = [np.flatnonzero(stretch == k) for k in np.argsort(-count)[:MOST_SEGMENTS] if count[k] > len(fit.a)]
    n = len(groups[0])
    size = 1 << int(np.ceil(np.log2(PADDED * n)))
    slowest, step = SLOWEST / n, 1 / size
    f = _peak(fit, groups, size)
    found = [golden(lambda x: -decrease(fit, groups, x), f - step, f + step, REFINED)]
    plain = long_arx(rec, 0, fit.lags, additional, len(fit.a) - 1)
    z = np.roots(fit.a)
    rings = np.angle(z[(np.abs(z) > UNDAMPED) & (z.imag > 0)]) / (2 * np.pi)
    starts = (_peak(plain, groups, size), *rings[rings > slowest].tolist())
    found += [golden(lambda x: -decrease(plain, groups, x), f - step, f + step, 2 * REFINED) for f in starts]
    found += starts[1:]
    fell = [decrease(fit, groups, x) for x in found]
    k, added = int(np.argmax(fell)), 2 * len(groups)
    rest = max(fit.rss - fell[k], 1e-300) / (fit.free - added)
    return found[k], min(1.0, n * float(fdtrc(added, fit.free - added, fell[k] / added / rest)))


def _peak(fit: LongArx, groups: list[NDArray[np.intp]], size: int) -> float:
    """Frequency on the grid, not slow, at which a line explains most."""
    fell = line_decreases(fit, groups, size)
    fell[: int(np.ceil(SLOWEST * size / len(groups[0])))] = 0.0
    return float(np.argmax(fell)) / size


def line_decreases(fit: LongArx, groups: list[NDArray[np.intp]], size: int) -> Array:
    """Decrease of the sum of squares by a line at frequencies k / size, k = 0 ... size / 2.

    With Q the columns of the regression and z = exp(-jwt) in each group of rows, Fourier transforms of Q and of e give
    the products with cosines and sines at all frequencies, and G = Z'Z - Z'QQ'Z those orthogonal to the regressors.
    """
    frequencies, own = size // 2 + 1, 2 * len(groups)
    held, c = np.empty((frequencies, fit.q.shape[1], own)), np.empty((frequencies, own))
    G = np.zeros((frequencies, own, own))
    for k, rows in enumerate(groups):
        Z, g = np.fft.rfft(fit.q[rows], size, axis=0), np.fft.rfft(fit.left[rows], size)
        held[:, :, 2 * k], held[:, :, 2 * k + 1] = Z.real, Z.imag
        c[:, 2 * k], c[:, 2 * k + 1] = g.real, g.imag
        G[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = _products(len(rows), size)
    G -= held.transpose(0, 2, 1) @ held
    length = np.sqrt(np.maximum(G.diagonal(axis1=1, axis2=2), 0.0))
    usable = np.asarray((length**2 > 1e-11 * len(groups[0])).all(axis=1))
    usable[[0, -1]] = False
    scale = np.where(usable[:, None], length, 1.0)
    G = np.where(usable[:, None, None], G / (scale[:, :, None] * scale[:, None, :]), np.eye(own))
    G += 1e-6 * np.eye(own)  # of unit diagonals: dependent columns add nothing
    c = np.where(usable[:, None], c / scale, 0.0)
    return np.asarray((c * np.linalg.solve(G, c[:, :, None])[:, :, 0]).sum(axis=1))


def _products(n: int, size: int) -> Array:
    """Products of cosine and -sine over n samples at frequencies k / size, shape (size / 2 + 1, 2, 2)."""
    w = 2 * np.pi * np.arange(size // 2 + 1) / size
    doubled = np.full(len(w), n, dtype=np.complex128)  # sum of z^2
    doubled[1:-1] = (1 - np.exp(-2j * w[1:-1] * n)) / (1 - np.exp(-2j * w[1:-1]))
    both = np.stack([n + doubled.real, doubled.imag, doubled.imag, n - doubled.real], axis=1) / 2
    return both.reshape(-1, 2, 2)


def decrease(fit: LongArx, groups: list[NDArray[np.intp]], f: float) -> float:
    """Decrease of the sum of squares by a line of frequency f, cycles per sample."""
    x = np.zeros((len(fit.rows), 2 * len(groups)))
    for k, rows in enumerate(groups):
        t = np.arange(len(rows))
        x[rows, 2 * k], x[rows, 2 * k + 1] = np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)
    return fit.tested(fit.orthogonal(x), np.linalg.norm(x, axis=0))[1] * fit.rss


def origins_of_line(f: float, rate: float) -> str:
    """Frequencies that a sampled line may have.

    >>> origins_of_line(10.0, 50.0)
    'Sampled at 50 Hz, it may stem from 10, 40, 60 (mains), 90 or 110 Hz: compare with teeth x rpm / 60'
    """
    true = [f, *(x for n in range(1, ALIASES + 1) for x in (n * rate - f, n * rate + f))]
    named = []
    for x in true:
        mains = next((m for m in MAINS if abs(x / m - round(x / m)) * m < 0.002 * x and 1 <= round(x / m) <= 3), None)
        named.append(f"{x:.4g}" + (" (mains)" if mains else ""))
    return (
        f"Sampled at {rate:.4g} Hz, it may stem from {', '.join(named[:-1])} or {named[-1]} Hz: compare with teeth x "
        "rpm / 60"
    )
