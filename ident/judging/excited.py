"""Which band an input excites: outside it no model and no measured response has seen anything."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..estimators.refusals import check_moves

if TYPE_CHECKING:
    from ...datasets import Record

Array = NDArray[np.float64]
SHARE = 0.1  # of the largest smoothed power: 10 dB down the errors of a response are three times those at its best
BINS = 5  # of the longest stretch, averaged: a sweep has ripples, a random input has gaps of a single bin


def excited_band(rec: "Record", share: float = SHARE) -> tuple[float, float]:
    """Lowest and highest frequency, Hz, at which the input has a tenth of its largest power or more.

    The rule: periodograms of all stretches, less their means, are added and averaged over 5 bins; the band runs from
    the first to the last bin with ``share`` or more of the largest.

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
    A band may hold gaps: of a square wave it spans the first harmonics, of which only the odd ones are there. An edge
    is no sharper than one over the length of the longest stretch.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> t = np.arange(750) * 0.02  # CLM-2023 eq. 17, 0.1 to 2 Hz
    >>> u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / 30 * t) * t)
    >>> [round(f, 1) for f in excited_band(Record(u=u, y=u, sample_time=0.02))]
    [0.1, 2.1]
    """
    check_moves(rec)
    f, power = input_power(rec)
    there = np.flatnonzero(power >= share * power.max())
    return float(f[there[0]]), float(f[there[-1]])


def input_power(rec: "Record") -> tuple[Array, Array]:
    """Frequencies in Hz and the smoothed power of the input there, in its unit squared, per sample."""
    n = max(s.stop - s.start for s in rec.stretches)
    transforms = (np.fft.rfft(rec.u[s] - rec.u[s].mean(), n) for s in rec.stretches)
    power = sum((np.abs(U) ** 2 for U in transforms), np.zeros(n // 2 + 1))[1:] / len(rec)
    smooth = np.convolve(power, np.ones(BINS) / BINS, "same") if len(power) > BINS else power
    return np.arange(1, n // 2 + 1) * rec.rate / n, smooth
