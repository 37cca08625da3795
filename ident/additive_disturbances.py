"""Drift and spectral lines of the output, tested in a regression of high order.

A line is tested by the F test of a sine and a cosine in addition to all lags, at every frequency of a grid: the
regression alone absorbs a line almost completely. Source: Thomson 1982, doi 10.1109/PROC.1982.12433 (F test of a line).
"""

import numpy as np

from ..core.arrays import Array, Flags, Ints
from ..datasets.records.record import Record
from .estimators.filters import filtered
from .estimators.high_order_arx import LongArx, golden, input_lags, long_arx

FALSE_ALARM = 1e-5  # probability that a record without lines has one
NEGLIGIBLE = 0.005  # of the standard deviation of y: smaller lines are left to the noise model
CONFIRMED = 1e-3  # p value of a drift or line in a regression with twice as many lags
DRIFT, DRIFT_ALARM = 3, 1e-5  # degree; stricter, as a slow plant leaves some of its dynamics
INTEGRATING = 1e-6  # a(1) of an integrator, relative to the sum of |a|: its output drifts without a disturbance
MOST_LINES, MOST_SEGMENTS = 4, 3  # lines, and segments in which they are searched
SLOWEST = 4.0  # periods of a line within a stretch; slower ones are drift
PADDED = 4  # points of the search per independent frequency
ALIASES = 2  # multiples of the sample rate for which the true frequency of a line is named
MAINS = (50.0, 60.0)
UNDAMPED = 0.98  # modulus of a root that may stand for a line
REFINED = 12  # evaluations of the exact frequency


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


def drift_degree(fit: LongArx, columns: Array) -> int:
    """Degree of the drift, 0 for none; ``columns`` (N, k) are the powers 1 to 3 of time in each stretch."""
    x, n = columns[fit.rows], len(fit.rows)
    tested = [fit.f_test(x[:, _powers(x, degree)]) for degree in range(1, DRIFT + 1)]
    if min(p for p, _ in tested) > DRIFT_ALARM:
        return 0
    stretches = x.shape[1] // DRIFT
    bic = [n * np.log(max(1 - share, 1e-300)) + k * stretches * np.log(n) for k, (_, share) in enumerate(tested, 1)]
    return 1 + int(np.argmin(bic))


def _powers(x: Array, degree: int) -> Flags:
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


def _peak(fit: LongArx, groups: list[Ints], size: int) -> float:
    """Frequency on the grid, not slow, at which a line explains most."""
    fell = line_decreases(fit, groups, size)
    fell[: int(np.ceil(SLOWEST * size / len(groups[0])))] = 0.0
    return float(np.argmax(fell)) / size


def line_decreases(fit: LongArx, groups: list[Ints], size: int) -> Array:
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


def decrease(fit: LongArx, groups: list[Ints], f: float) -> float:
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


def drift_and_lines(rec: Record, fit: LongArx) -> tuple[int, tuple[float, ...], LongArx]:
    """Degree of drift, frequencies of lines, and the regression with both."""
    drift, lines = _additive(rec, fit)
    if drift or lines:
        drift, lines = _confirmed(rec, fit, drift, lines)
    additional = additional_columns(rec, lines, drift)
    return drift, lines, long_arx(rec, len(fit.a) - 1, fit.lags, additional) if additional.shape[1] else fit


def _additive(rec: Record, fit: LongArx) -> tuple[int, tuple[float, ...]]:
    """Degree of drift and frequencies of lines in Hz."""
    lines: tuple[float, ...] = ()
    order, held = len(fit.a) - 1, fit
    powers = additional_columns(rec, (), DRIFT)
    drift = drift_degree(fit, powers) if powers.shape[1] < fit.free / 10 else 0
    if drift:
        held = long_arx(rec, order, fit.lags, additional_columns(rec, (), drift))
        drift, held = (drift, held) if _plausible(rec, held, drift) else (0, fit)
    while len(lines) < MOST_LINES:
        f, p = strongest_line(held, rec, additional_columns(rec, lines, drift))
        if p > FALSE_ALARM:
            break
        lines = (*lines, f / rec.sample_time)
        held = long_arx(rec, order, fit.lags, additional_columns(rec, lines, drift))
    sizes = amplitudes(rec, held, lines, drift)
    return drift, tuple(f for f, size in zip(lines, sizes, strict=True) if relative_size(size, rec) > NEGLIGIBLE)


def amplitudes(rec: Record, fit: LongArx, lines: tuple[float, ...], drift: int) -> list[float]:
    """Amplitude of each line of the output, in the stretch where it is largest."""
    if not lines:
        return []
    block = fit.additional.reshape(len(rec.starts), -1)[:, drift:]
    z = np.exp(-2j * np.pi * rec.sample_time * np.outer(lines, np.arange(len(fit.a))))
    sizes = np.hypot(block[:, ::2], block[:, 1::2]).max(axis=0) / np.abs(z @ fit.a)
    return [float(size) for size in sizes]


def _confirmed(rec: Record, plain: LongArx, drift: int, lines: tuple[float, ...]) -> tuple[int, tuple[float, ...]]:
    """Drift and lines that are significant with twice as many lags: a lightly damped plant needs them."""
    order = 2 * (len(plain.a) - 1)
    lags = input_lags(rec, order, int(plain.lags.min(initial=0) > 0))

    def p_value(own: Array, others: Array) -> float:
        fit = long_arx(rec, order, lags, others)
        return fit.f_test(own[fit.rows])[0]

    if drift and p_value(additional_columns(rec, (), drift), additional_columns(rec, lines, 0)) > CONFIRMED:
        drift = 0
    kept = tuple(
        f
        for f in lines
        if p_value(additional_columns(rec, (f,), 0), additional_columns(rec, tuple(x for x in lines if x != f), drift))
        < CONFIRMED
    )
    return drift, kept


def _plausible(rec: Record, fit: LongArx, drift: int) -> bool:
    """Whether the drift of the output is known and within its range: an integrator drifts without a disturbance."""
    size = drift_of_longest(rec, fit, drift)[0]
    return size is not None and size < float(np.ptp(rec.y))


def drift_of_longest(rec: Record, fit: LongArx, drift: int) -> tuple[float | None, int]:
    """Range of the drift over the longest stretch, and its samples."""
    longest = int(np.argmax(np.diff([*rec.starts, len(rec)])))
    count = rec.stretches[longest].stop - rec.stretches[longest].start
    block = len(fit.additional) // len(rec.starts)
    return drift_range(fit.a, fit.additional[longest * block : longest * block + drift], count), count


def relative_size(size: float, rec: Record) -> float:
    """Size relative to the standard deviation of y."""
    return size / max(float(np.std(rec.y)), 1e-300)
