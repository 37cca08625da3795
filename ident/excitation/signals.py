"""Excitation signals (chirp, PRBS, multisine, steps) within limits of level, rate of change and frequency.

A signal beyond a limit raises an error, or is scaled as a whole (``limit="scale"``). It is never clipped: a clipped
signal has another spectrum.
"""

from collections.abc import Sequence
from typing import Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array
from ...core.errors import IdentError


class SignalLimits(TypedDict, total=False):
    """Limits of every excitation: level from ``low`` to ``high``, ``max_rate`` in units a second."""

    low: float | None
    high: float | None
    max_rate: float | None
    limit: Literal["refuse", "scale"]


def _scaled(amplitude: float, x: Array) -> Array:
    """A signal of this amplitude; IdentError where that is no number."""
    if not np.isfinite(amplitude):
        raise IdentError(f"amplitude {amplitude:g} is not finite: give a number.")
    return amplitude * x


def within_limits(
    x: Array,
    rate: float,
    offset: float = 0.0,
    low: float | None = None,
    high: float | None = None,
    max_rate: float | None = None,
    limit: Literal["refuse", "scale"] = "refuse",
) -> Array:
    """``offset`` + x if within the limits; otherwise an error, or x scaled as a whole."""
    check_kind("limit", limit, ("refuse", "scale"))
    if not np.isfinite([x.min(), x.max(), offset]).all():
        raise IdentError(f"amplitude or offset {offset:g} is not finite: give numbers.")
    change = float(np.abs(np.diff(x)).max(initial=0.0)) * rate
    checks = (
        ("level", offset + float(x.max()), high, float(x.max()), None if high is None else high - offset, "above"),
        ("level", offset + float(x.min()), low, -float(x.min()), None if low is None else offset - low, "below"),
        ("rate of change a second", change, max_rate, change, max_rate, "above"),
    )
    scale = 1.0
    for what, value, bound, size, margin, side in checks:
        if bound is None or margin is None or size <= margin * (1 + 1e-12):
            continue
        if margin <= 0 or limit == "refuse":
            fits = f'{margin / size:.4g} of the amplitude fits: limit="scale"'
            remedy = "offset alone is beyond it" if margin <= 0 else fits
            raise IdentError(f"{what} {value:.6g} is {side} the limit {bound:g}; {remedy}.")
        scale = min(scale, margin / size)
    return np.asarray(offset + scale * x, dtype=np.float64)


def sample_count(duration: float, rate: float) -> int:
    """Number of samples of a duration in s at a rate in Hz."""
    if not (np.isfinite([duration, rate]).all() and duration > 0 and rate > 0):
        raise IdentError(f"duration {duration:g} s at {rate:g} Hz: both lie above zero, for instance 15 s at 50 Hz.")
    n = round(duration * rate)
    if n < 2:
        raise IdentError(f"duration {duration:g} s at {rate:g} Hz is {n} samples: 2 or more, so longer or faster.")
    return n


def check_frequency(name: str, f: float, rate: float) -> None:
    """Raise IdentError unless the frequency is above zero and at most half the rate."""
    if not 0 < f <= rate / 2:
        raise IdentError(
            f"{name} {f:g} Hz at {rate:g} Hz: above zero and not above {rate / 2:g} Hz, half the rate. "
            "Sample faster or sweep less."
        )


def check_kind(name: str, value: str, known: tuple[str, ...]) -> None:
    """Raise IdentError unless the value is one of the known ones."""
    if value not in known:
        raise IdentError(f"{name} {value!r}: one of {', '.join(known)}.")


# Feedback of shift registers whose period is 2^n - 1, by n (two or four taps; Peterson & Weldon 1972, appendix C).
TAPS = {
    3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4), 9: (9, 5), 10: (10, 7), 11: (11, 9),
    12: (12, 11, 10, 4), 13: (13, 12, 11, 8), 14: (14, 13, 12, 2), 15: (15, 14), 16: (16, 15, 13, 4),
}  # fmt: skip


def chirp(
    amplitude: float = 2.5,
    f0: float = 0.1,
    f1: float = 2.0,
    duration: float = 15.0,
    rate: float = 50.0,
    *,
    kind: Literal["linear", "logarithmic"] = "linear",
    offset: float = 0.0,
    **limits: Unpack[SignalLimits],
) -> Array:
    """Swept sine; linear is eq. 17 of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587.

        y = A sin(2 pi (f0 + (f1 - f0) / (2 Te) t) t)

    Parameters
    ----------
    amplitude, offset : float
        In the unit of the input.
    f0, f1 : float
        First and last frequency, Hz. A logarithmic sweep spends the same time in every octave.
    duration, rate : float
        s, Hz; the samples are t = 0, 1/rate, ... below the duration.
    low, high, max_rate : float, optional
        Limits of level, and of its change in units a second.
    limit : {"refuse", "scale"}
        Behaviour beyond the limits: raise an error, or scale the signal.

    Returns
    -------
    ndarray, shape (duration * rate,)

    Raises
    ------
    IdentError
        A frequency of zero or less or above half the rate, a limit exceeded.

    Examples
    --------
    >>> u = chirp()
    >>> len(u), round(float(u[100]), 4)
    (750, 0.7226)
    """
    n = sample_count(duration, rate)
    check_frequency("f0", f0, rate)
    check_frequency("f1", f1, rate)
    check_kind("kind", kind, ("linear", "logarithmic"))
    t = np.arange(n) / rate
    if kind == "linear" or f0 == f1:
        phase = (f0 + (f1 - f0) / (2 * duration) * t) * t
    else:
        growth = np.log(f1 / f0) / duration
        phase = f0 / growth * np.expm1(growth * t)
    return within_limits(_scaled(amplitude, np.sin(2 * np.pi * phase)), rate, offset, **limits)


def prbs(
    amplitude: float = 1.0,
    duration: float = 15.0,
    rate: float = 50.0,
    *,
    hold: float = 0.1,
    order: int | None = None,
    seed: int = 1,
    offset: float = 0.0,
    **limits: Unpack[SignalLimits],
) -> Array:
    """Pseudo-random binary sequence from a maximum-length shift register (period 2^order - 1).

    Parameters
    ----------
    amplitude, offset : float
        Levels are offset - amplitude and offset + amplitude.
    duration, rate : float
        s, Hz.
    hold : float
        Clock period, s, a whole number of samples. The power falls to half at 0.44 / hold Hz.
    order : int, optional
        Of the register, 3 to 16; by default the smallest whose period exceeds the duration.
    seed : int
        Initial state of the register: 1 to 2^order - 1, modulo that.
    low, high, max_rate, limit
        See :func:`chirp`; a jump has a rate of its height times ``rate``.

    Examples
    --------
    >>> prbs(2.5, duration=3.5, rate=2, hold=0.5).tolist()
    [2.5, -2.5, -2.5, 2.5, -2.5, 2.5, 2.5]
    """
    n = sample_count(duration, rate)
    held = round(hold * rate)
    if held < 1 or abs(held - hold * rate) > 1e-6 * held:
        raise IdentError(f"hold {hold:g} s at {rate:g} Hz is {hold * rate:g} samples: a whole number, 1 or more.")
    needed = -(-n // held)
    order = order if order is not None else next((k for k in TAPS if 2**k - 1 >= needed), max(TAPS))
    if order not in TAPS:
        raise IdentError(f"order {order!r} of a shift register: {min(TAPS)} to {max(TAPS)}.")
    bits = shift_register(order, seed, needed)
    return within_limits(_scaled(amplitude, np.repeat(2.0 * bits - 1, held)[:n]), rate, offset, **limits)


def shift_register(order: int, seed: int, length: int) -> NDArray[np.int8]:
    """Bits of a maximum-length shift register."""
    state = (int(seed) - 1) % (2**order - 1) + 1
    out = np.empty(length, dtype=np.int8)
    for k in range(length):
        out[k] = state & 1
        feedback = 0
        for tap in TAPS[order]:
            feedback ^= state >> (order - tap)
        state = state >> 1 | (feedback & 1) << (order - 1)
    return out


def multisine(
    amplitude: float = 2.5,
    lines: ArrayLike | None = None,
    duration: float = 20.0,
    rate: float = 50.0,
    *,
    weights: ArrayLike | None = None,
    offset: float = 0.0,
    **limits: Unpack[SignalLimits],
) -> Array:
    """Multisine with Schroeder phases: one whole period, to be repeated.

    Parameters
    ----------
    amplitude : float
        Largest magnitude of the sum; see `crest_factor`.
    lines : array_like, optional
        Hz, each a whole number of periods in the duration; by default all from 0.1 to 2 Hz.
    weights : array_like, optional
        Power of each line; by default equal.
    duration, rate, offset, low, high, max_rate, limit
        See :func:`chirp`.

    Notes
    -----
    phi_k = -2 pi sum_{j<k} (k - j) p_j with p_j the shares of power: Schroeder 1970, doi 10.1109/TIT.1970.1054411.

    Examples
    --------
    >>> u = multisine(2.5, [0.1, 0.3, 0.5, 0.7, 0.9], duration=10)
    >>> round(float(np.abs(u).max()), 9), round(crest_factor(u), 1)
    (2.5, 1.6)
    """
    n = sample_count(duration, rate)
    if lines is None:
        lines = np.arange(np.ceil(0.1 * duration), np.floor(2.0 * duration) + 1) / duration
    f = np.atleast_1d(np.asarray(lines, dtype=np.float64))
    for line in f:
        check_frequency("line", float(line), rate)
    off = np.abs(f * n / rate - np.round(f * n / rate)) > 1e-6
    if not f.size or off.any() or len(np.unique(np.round(f * n / rate))) < len(f):
        which = f"line {f[off][0]:g} Hz" if off.any() else f"{len(f)} lines"
        raise IdentError(
            f"{which} in {n / rate:g} s: each line once, and a whole number of periods (k / {n / rate:g} Hz)."
        )
    power = np.ones(len(f)) if weights is None else np.asarray(weights, dtype=np.float64)
    if power.shape != f.shape or not (power > 0).all():
        raise IdentError(f"weights {power.tolist()} of {len(f)} lines: one above zero for each.")
    share = power / power.sum()
    phase = -2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(share)[:-1])])
    x = np.sqrt(share) @ np.cos(2 * np.pi * np.outer(f, np.arange(n) / rate) + phase[:, None])
    return within_limits(_scaled(amplitude, x / np.abs(x).max()), rate, offset, **limits)


def steps(
    levels: Sequence[float], hold: float, rate: float = 50.0, *, offset: float = 0.0, **limits: Unpack[SignalLimits]
) -> Array:
    """Sequence of steps: each level for ``hold`` seconds.

    Examples
    --------
    >>> steps([0, 1, -1], hold=0.04).tolist()
    [0.0, 0.0, 1.0, 1.0, -1.0, -1.0]
    """
    heights = np.asarray(levels, dtype=np.float64)
    if heights.ndim != 1 or len(heights) < 2 or not np.isfinite(heights).all():
        raise IdentError(f"levels {levels!r}: two numbers or more, for instance [0, 1, 0].")
    return within_limits(np.repeat(heights, sample_count(hold, rate)), rate, offset, **limits)


def crest_factor(u: ArrayLike) -> float:
    """Largest deviation from the mean over the root mean square: 1 for two levels, 1.41 for a sine; small is good.

    >>> crest_factor([1.0, -1.0, 1.0, -1.0])
    1.0
    """
    x = np.asarray(u, dtype=np.float64)
    x = x - x.mean()
    rms = float(np.sqrt(np.mean(x * x)))
    if rms == 0:
        raise IdentError("crest factor of a constant signal, which does not vary: undefined.")
    return float(np.abs(x).max()) / rms
