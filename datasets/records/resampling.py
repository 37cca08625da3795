"""Resampling through an anti-alias filter, and interpolation of uneven samples.

Input and output pass the same filter, which therefore drops out of the relation between them.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Final

import numpy as np

from ...core.arrays import Array, is_positive
from ...core.errors import DataError, UsageError

STOP = 70.0  # dB of stop-band attenuation against aliasing: below 16 bits, far below the noise of a sensor
KEPT = 0.8  # share of the new half rate that passes unchanged; from there to 1.0 the filter falls
LONGEST = 1000  # up and down factors beyond it are not a plausible ratio
GAP = 3.0  # median steps; uneven samples further apart are not joined by a line
MOST_TEETH, HARMONICS = 8, 3  # of a cutter whose teeth are not known; of the tooth frequency that a mean excludes
LEAKS: Final = 0.25  # share of a harmonic that a mean over one revolution may hold; 0 or 1 where the step divides it


@lru_cache(maxsize=8)
def taps(up: int, down: int) -> Array:
    """Symmetric low-pass for ``up`` / ``down`` at the rate between, odd length, shape (m,), sum 1.

    Kaiser window: Kaiser & Schafer 1980, doi:10.1109/TASSP.1980.1163349.

    >>> taps(1, 4).sum().round(12).item(), len(taps(1, 4)) % 2
    (1.0, 1)
    """
    from scipy.signal import firwin, kaiserord

    band = 1.0 / max(up, down)
    count, beta = kaiserord(STOP, (1 - KEPT) * band)
    return np.asarray(firwin(int(count) | 1, (1 + KEPT) / 2 * band, window=("kaiser", beta)), dtype=np.float64)


def rational(values: Array, up: int, down: int) -> Array:
    """One stretch, shape (n,), at ``up`` / ``down`` times its rate; the first sample stays the first.

    The filter has no phase. Beyond its ends the stretch goes on mirrored about its end points, so that a straight
    line stays one.

    >>> rational(np.arange(9.0), 1, 4).round(9).tolist()
    [0.0, 4.0, 8.0]
    """
    from scipy.signal import upfirdn

    n = len(values)
    if up == down or n < 2:
        return values[:: max(1, down // up)].copy()
    line = values[0] + (values[-1] - values[0]) * np.arange(n) / (n - 1)
    h = taps(up, down) * up
    half = len(h) // 2
    pad = -(-half // up) + 1
    padded = np.pad(values - line, pad, mode="reflect", reflect_type="odd")
    late = -(pad * up + half) % down  # zeros that bring the first sample onto the grid of kept ones
    out = upfirdn(np.concatenate([np.zeros(late), h]), padded, up, down)
    first = (pad * up + half + late) // down
    count = (n - 1) * up // down + 1
    ends = values[0] + (values[-1] - values[0]) * np.arange(count) * (down / up) / (n - 1)
    return np.asarray(out[first : first + count] + ends, dtype=np.float64)


def ratio_of(rate: float, sample_time: float) -> Fraction:
    """Ratio of a wanted rate in Hz to that of a sample time in s.

    Raises
    ------
    UsageError
        The rate is not above zero, or no ratio of whole numbers up to 1000 gives it.

    >>> ratio_of(100.0, 0.004)
    Fraction(2, 5)
    """
    if not is_positive(rate):
        raise UsageError(f"rate {rate!r} Hz to resample to: it must be above zero, for instance 50.")
    exact = rate * sample_time
    ratio = Fraction(exact).limit_denominator(LONGEST)
    if not ratio or max(ratio.numerator, ratio.denominator) > LONGEST or abs(float(ratio) / exact - 1) > 1e-6:
        near = f"; near it is {float(ratio) / sample_time:.6g} Hz" if ratio else ""
        raise UsageError(
            f"{rate:g} Hz is not a simple ratio of {1 / sample_time:.6g} Hz (whole numbers up to {LONGEST}){near}."
        )
    return ratio


def interpolated(time: Array, values: Array, starts: tuple[int, ...], rate: float) -> tuple[Array, tuple[int, ...]]:
    """Lines between unevenly timed samples, read at an even rate in each stretch.

    Parameters
    ----------
    time : ndarray, shape (n,), s, rising in each stretch
    values : ndarray, shape (n, k)
    starts : tuple of int
        First row of each stretch.
    rate : float, Hz

    Returns
    -------
    values : ndarray, shape (m, k)
    starts : tuple of int
        Stretches too short for two samples are left out.

    >>> values, starts = interpolated(np.array([0.0, 0.5, 2.0]), np.array([[0.0], [1.0], [4.0]]), (0,), 1.0)
    >>> values.ravel().tolist(), starts
    ([0.0, 2.0, 4.0], (0,))
    """
    parts: list[Array] = []
    for begin, end in zip(starts, (*starts[1:], len(time)), strict=True):
        t = time[begin:end]
        count = int((t[-1] - t[0]) * rate + 1e-6) + 1
        if count > 1:
            grid = t[0] + np.arange(count) / rate
            parts.append(np.column_stack([np.interp(grid, t, column) for column in values[begin:end].T]))
    if not parts:
        raise DataError(f"no segment is long enough for two samples at {rate:g} Hz: take a higher rate.")
    begins = np.concatenate([[0], np.cumsum([len(part) for part in parts])])[:-1]
    return np.concatenate(parts), tuple(int(b) for b in begins)


def aliased_teeth(revolution: float, step: float, teeth: int | None = None) -> tuple[int, ...]:
    """Numbers of teeth of a cutter whose mean force over a revolution the samples do not give.

    The mean of N samples of a revolution holds the harmonic h of z teeth in full where N divides z h, and nothing of it
    elsewhere; where the step does not divide the revolution it holds |sin(pi N x) / (N sin(pi x))|, x = z h step /
    revolution (the Dirichlet kernel). Without the first 3 harmonics, the mean of a force that is zero for up to 3/5 of
    the pitch of the teeth is within a quarter of the true one.

    Parameters
    ----------
    revolution, step : float
        s of a revolution of the spindle, and between two samples.
    teeth : int or None
        Of the cutter; None tries 1 to 8.

    Examples
    --------
    >>> aliased_teeth(0.02, 0.001), aliased_teeth(0.02, 0.004), aliased_teeth(0.02, 0.004, teeth=2)
    ((), (5,), ())
    >>> aliased_teeth(0.02, 0.01)
    (1, 2, 3, 4, 5, 6, 7, 8)
    """
    samples = max(round(revolution / step), 1)
    found = []
    for z in range(1, MOST_TEETH + 1) if teeth is None else (teeth,):
        x = z * np.arange(1, HARMONICS + 1) * step / revolution
        x -= np.round(x)
        if np.abs(np.sinc(samples * x) / np.sinc(x)).max() > LEAKS:
            found.append(z)
    return tuple(found)


def samples_of_revolution(least: float, teeth: int | None = None) -> int:
    """Smallest number of samples of a revolution, at least ``least``, that gives its mean force.

    >>> samples_of_revolution(2.0), samples_of_revolution(12.0, teeth=4), samples_of_revolution(20.0)
    (11, 13, 20)
    """
    samples = max(int(np.ceil(least * (1 - 1e-9))), 1)
    while aliased_teeth(1.0, 1.0 / samples, teeth):
        samples += 1
    return samples


def aliased_words(revolution: float, step: float, aliased: Sequence[int], teeth: int | None = None) -> str:
    """A sentence on samples from which `aliased_teeth` finds no mean force.

    >>> print(aliased_words(0.02, 0.01, (2,), 2)[:80])
    2 samples in a revolution of 20 ms do not give the mean force of a cutter with 2
    """
    of = f"{', '.join(map(str, aliased[:-1]))} or {aliased[-1]}" if len(aliased) > 1 else f"{aliased[0]}"
    unknown = " (their number is not stated)" if teeth is None else ""
    return (
        f"{revolution / step:.3g} samples in a revolution of {1e3 * revolution:.4g} ms do not give the mean force of a "
        f"cutter with {of} {'tooth' if aliased[-1] == 1 else 'teeth'}{unknown}: samples at the same few angles of the "
        "teeth do not show how the force swings with them"
    )
