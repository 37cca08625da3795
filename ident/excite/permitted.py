"""Limits of an excitation: level, rate of change, frequency.

What lies beyond a limit is refused in words, or the whole is made smaller when that is asked for (``limit="scale"``).
It is never cut off: a clipped signal has other frequencies than the one that was planned.
"""

from typing import Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError

Array = NDArray[np.float64]


class Limits(TypedDict, total=False):
    """Limits of every excitation: level from ``low`` to ``high``, ``max_rate`` in units a second."""

    low: float | None
    high: float | None
    max_rate: float | None
    limit: Literal["refuse", "scale"]


def within(
    x: Array,
    rate: float,
    offset: float = 0.0,
    low: float | None = None,
    high: float | None = None,
    max_rate: float | None = None,
    limit: Literal["refuse", "scale"] = "refuse",
) -> Array:
    """``offset`` + x where that keeps the limits; else refused, or x made smaller as a whole."""
    check_kind("limit", limit, ("refuse", "scale"))
    if not np.isfinite([x.min(), x.max(), offset]).all():
        raise IdentError(f"amplitude or offset {offset:g} is not finite: give numbers.")
    change = float(np.abs(np.diff(x)).max(initial=0.0)) * rate
    asked = (
        ("level", offset + float(x.max()), high, float(x.max()), None if high is None else high - offset, "above"),
        ("level", offset + float(x.min()), low, -float(x.min()), None if low is None else offset - low, "below"),
        ("rate of change a second", change, max_rate, change, max_rate, "above"),
    )
    scale = 1.0
    for what, value, bound, size, room, side in asked:
        if bound is None or room is None or size <= room * (1 + 1e-12):
            continue
        if room <= 0 or limit == "refuse":
            cure = (
                "offset alone is beyond it" if room <= 0 else f'{room / size:.4g} of the amplitude fits: limit="scale"'
            )
            raise IdentError(f"{what} {value:.6g} is {side} the limit {bound:g}; {cure}.")
        scale = min(scale, room / size)
    return np.asarray(offset + scale * x, dtype=np.float64)


def samples(duration: float, rate: float) -> int:
    """Number of samples of a duration in s at a rate in Hz."""
    if not (np.isfinite([duration, rate]).all() and duration > 0 and rate > 0):
        raise IdentError(f"duration {duration:g} s at {rate:g} Hz: both lie above zero, for instance 15 s at 50 Hz.")
    n = round(duration * rate)
    if n < 2:
        raise IdentError(f"duration {duration:g} s at {rate:g} Hz is {n} samples: 2 or more, so longer or faster.")
    return n


def check_frequency(name: str, f: float, rate: float) -> None:
    """Above zero and not above half the rate, or IdentError."""
    if not 0 < f <= rate / 2:
        raise IdentError(
            f"{name} {f:g} Hz at {rate:g} Hz: above zero and not above {rate / 2:g} Hz, half the rate. "
            "Sample faster or sweep less."
        )


def check_kind(name: str, value: str, known: tuple[str, ...]) -> None:
    """One of the known words, or IdentError."""
    if value not in known:
        raise IdentError(f"{name} {value!r}: one of {', '.join(known)}.")
