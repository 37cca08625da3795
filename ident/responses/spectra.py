"""Spectra: the excited band of an input, and frequency responses by averaged cross-spectra (Welch 1967).

    G = S_uy / S_uu,    coherence = |S_uy|^2 / (S_uu S_yy),    var |G| / |G|^2 = (1 - coh) / (2 n coh)

n is the equivalent number of independent windows. Source: Bendat & Piersol 2010, section 9.1.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.input_checks import check_varies

SHARE = 0.1  # of the largest smoothed power: at -10 dB the errors of a response are three times the smallest
BINS = 5  # of the longest segment, averaged: a sweep has ripples, a random input gaps of a single bin


def excited_band(rec: Record, share: float = SHARE) -> tuple[float, float]:
    """Lowest and highest frequency, Hz, at which the input has at least a tenth of its largest power.

    Periodograms of all segments, means removed, are added and averaged over 5 bins; the band extends from the first to
    the last bin with at least ``share`` of the largest.

    Parameters
    ----------
    rec : Record
    share : float

    Returns
    -------
    tuple of float

    Raises
    ------
    IdentError
        The input does not vary.

    Notes
    -----
    The band may contain gaps: a square wave has only odd harmonics. The resolution of its limits is one over the
    length of the longest segment.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> t = np.arange(750) * 0.02  # CLM-2023 eq. 17, 0.1 to 2 Hz
    >>> u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / 30 * t) * t)
    >>> [round(f, 1) for f in excited_band(Record(u=u, y=u, sample_time=0.02))]
    [0.1, 2.1]
    """
    check_varies(rec)
    f, power = input_power(rec)
    there = np.flatnonzero(power >= share * power.max())
    return float(f[there[0]]), float(f[there[-1]])


def input_power(rec: Record) -> tuple[Array, Array]:
    """Frequencies in Hz and the smoothed power of the input, in its unit squared, per sample."""
    n = max(s.stop - s.start for s in rec.stretches)
    transforms = (np.fft.rfft(rec.u[s] - rec.u[s].mean(), n) for s in rec.stretches)
    power = sum((np.abs(U) ** 2 for U in transforms), np.zeros(n // 2 + 1))[1:] / len(rec)
    smooth = np.convolve(power, np.ones(BINS) / BINS, "same") if len(power) > BINS else power
    return np.arange(1, n // 2 + 1) * rec.rate / n, smooth


WINDOWS = 8  # per record by default, and
FEWEST = 4  # below which a coherence is meaningless
OVERLAPPED = 1 / 36  # squared correlation of spectra from Hann windows that overlap by half


def welch_estimate(
    rec: Record, frequency: Array, resolution: float | None
) -> tuple[NDArray[np.complex128], Array, Array, Array, float]:
    """G, its complex standard error, coherence and degrees of freedom at frequencies, and the resolution in Hz."""
    from scipy.signal import csd

    lengths = [s.stop - s.start for s in rec.stretches]
    n = max(int(2 * sum(lengths) / (WINDOWS + 1)), 8) if resolution is None else round(2 * rec.rate / resolution)
    n = min(n, max(lengths)) if resolution is None else n
    usable = [s for s in rec.stretches if s.stop - s.start >= n > 3]
    count = sum((s.stop - s.start - n) // (n - n // 2) + 1 for s in usable)
    if count < FEWEST:
        raise IdentError(
            f"{count} windows of {n} samples: averaging needs {FEWEST} or more. Give a coarser resolution, record "
            'longer, or use method="impulse".'
        )
    f = np.fft.rfftfreq(n, rec.sample_time)
    uu, uy, yy = np.zeros(len(f)), np.zeros(len(f), dtype=np.complex128), np.zeros(len(f))
    for s in usable:
        weight = (s.stop - s.start - n) // (n - n // 2) + 1
        u, y = rec.u[s] - rec.u[s].mean(), rec.y[s] - rec.y[s].mean()
        uy = uy + weight * csd(u, y, rec.rate, nperseg=n, noverlap=n // 2)[1]
        uu, yy = (p + weight * csd(x, x, rec.rate, nperseg=n, noverlap=n // 2)[1].real for p, x in ((uu, u), (yy, y)))
    at = np.clip(np.rint(frequency / f[1]).astype(np.intp), 1, len(f) - 1)
    s_uu, s_uy, s_yy = uu[at], uy[at], yy[at]
    g = s_uy / s_uu
    coherence = np.clip(np.abs(s_uy) ** 2 / (s_uu * s_yy), 0.0, 1.0)
    worth = count / (1 + 2 * OVERLAPPED * (count - 1) / count)
    error = np.sqrt(np.maximum(1 - coherence, 0.0) * s_yy / s_uu / max(worth - 1, 1.0))
    return g, error, coherence, np.full(len(at), worth - 1), 2 * float(f[1])


def checked_frequencies(frequency: ArrayLike, nyquist: float) -> Array:
    """Frequencies in Hz as an array (F,); IdentError unless above zero and not above half the sample rate."""
    f = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    if f.ndim != 1 or not f.size or not ((f > 0) & (f <= nyquist * (1 + 1e-9))).all():
        raise IdentError(f"frequencies lie above zero and not above {nyquist:g} Hz, half the sample rate.")
    return f
