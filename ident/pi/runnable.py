"""What a PI must be told before it can run: the names of its forms, and a check of each number."""

import math
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from ...core.errors import UsageError

if TYPE_CHECKING:
    from .gains import PiGains

Form = Literal["position", "incremental", "incremental_sum"]
Integration = Literal["backward", "forward", "trapezoidal"]
AntiWindup = Literal["clamping", "back_calculation", "none"]
Averaged = Literal["measurement", "command"]


def check_gains(gains: "PiGains") -> None:
    """UsageError for gains that no controller could run."""
    _check_numbers(gains)
    _check_names(gains)
    _check_limits(gains)


def above_zero(name: str, value: object) -> None:
    """UsageError unless a value is a finite number above zero."""
    if not _finite(value) or not value > 0:  # type: ignore[operator]
        raise UsageError(f"{name} {value!r}: a finite number above zero.")


def _check_numbers(gains: "PiGains") -> None:
    for name in ("kp", "ki"):
        if not _finite(getattr(gains, name)):
            raise UsageError(f"{name} {getattr(gains, name)!r}: a gain is a finite number.")
    for name in ("sample_time", "tracking_time", "rate"):
        value = getattr(gains, name)
        if not (name != "sample_time" and value is None):
            above_zero(name, value)
    if not _finite(gains.filter_time) or gains.filter_time < 0:
        raise UsageError(f"filter_time {gains.filter_time!r} s: 0 for no filter, or above.")
    for name, least in (("delay", 0), ("average", 1)):
        value = getattr(gains, name)
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise UsageError(f"{name} {value!r}: a whole number of samples, {least} or more.")


def _finite(value: object) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(float(value))


def _check_names(gains: "PiGains") -> None:
    kinds: dict[str, Any] = {
        "form": Form, "integration": Integration, "anti_windup": AntiWindup, "average_of": Averaged
    }  # fmt: skip
    for name, kind in kinds.items():
        value, allowed = getattr(gains, name), get_args(kind)
        if value not in allowed:
            raise UsageError(f"{name} {value!r} of PI gains: one of {', '.join(allowed)}.")


def _check_limits(gains: "PiGains") -> None:
    low, high = gains.low, gains.high
    if any(v is not None and not _finite(v) for v in (low, high)):
        raise UsageError(f"limits low {low!r}, high {high!r}: finite numbers, or None for no limit.")
    if low is not None and high is not None and not low < high:
        raise UsageError(f"limits low {low!r}, high {high!r}: low lies below high.")
