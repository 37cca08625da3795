"""Limits and settings, as short as one says them, become their sections."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...core.errors import ParameterError
from ..messages import short
from ..sections.load_line import LimitsSection
from .dynamics import as_data

BOUNDS = {"power": "kW", "force": "N", "wear": "mm"}
RANGES = {"feed": "mm/rev", "feed_rate": "mm/min", "speed": "m/min", "spindle_speed": "1/min"}


def limits_section(limits: LimitsSection | Mapping[str, Any]) -> dict[str, Any]:
    """The section of limits; a bare number or pair is in the usual unit: kW, N, mm, mm/rev, mm/min, m/min, 1/min.

    Raises
    ------
    ParameterError
        A limit that is neither a number, a pair, nor a section of its own.

    Examples
    --------
    >>> limits_section({"power": 7, "speed": (50, 200)})
    {'power': {'value': 7.0, 'unit': 'kW'}, 'speed': {'low': 50.0, 'high': 200.0, 'unit': 'm/min'}}
    """
    return {name: _one(name, value) for name, value in as_data(limits).items()}


def _one(name: str, value: Any) -> Any:  # noqa: ANN401
    if name in BOUNDS and isinstance(value, int | float) and not isinstance(value, bool):
        return {"value": float(value), "unit": BOUNDS[name]}
    if name in RANGES and isinstance(value, Sequence) and not isinstance(value, str):
        if len(value) != 2:
            raise ParameterError(
                f"limits: {name} {short(list(value))} of {len(value)} numbers; a range is low and high."
            )
        return {"low": float(value[0]), "high": float(value[1]), "unit": RANGES[name]}
    return value
