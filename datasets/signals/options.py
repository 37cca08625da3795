"""Options of reducing records to rows, and the roles of their channels."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Literal, TypeAlias

from ...core.errors import UsageError
from ..options import DecimalMark, check_choice
from ..vocabulary import ROLES

Join: TypeAlias = Literal["name", "time", "order"]
LOADS = tuple(symbol for symbol, role in ROLES.items() if role.kind == "load" and symbol != "theta")
DRIVEN = ("P", "M", "I")  # loads that an idle spindle has too: off, idle and cut are three levels


@dataclass(frozen=True, slots=True, kw_only=True)
class ReduceOptions:
    """Options of reducing records to rows.

    Attributes
    ----------
    map, units : mapping of str to str
        Column and unit of a channel (``Fc``, ``I``), or of ``time``; a channel mapped to ``none`` is not read.
    scales : mapping of str to float
        Factor of a channel recorded in volts, in the unit of the channel per volt.
    constants : mapping of str to float
        ``n`` (1/min), or ``V`` (m/min) and ``D`` (mm), where the plan does not contain them.
    rate : float or None, Hz
        Samples per second, where the records contain no times.
    shortest : float, s
        A shorter excursion is no cut.
    guard : float
        Share of a cut that is left out at its entry and at its exit, beyond the transients.
    threshold : float
        A cut exceeds this share of the largest load of its record.
    channel : str or None
        Channel on which cuts are found; None: the one of the highest contrast.
    join : {"name", "time", "order"} or None
        How cuts are assigned to the rows of the plan; None: the first of these that is possible.
    decimal, delimiter, sheet : as in `datasets.read_table`
    """

    map: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    rate: float | None = None
    shortest: float = 1.0
    guard: float = 0.05
    threshold: float = 0.06
    channel: str | None = None
    join: Join | None = None
    decimal: DecimalMark | None = None
    delimiter: str | None = None
    sheet: str | None = None

    def __post_init__(self) -> None:
        check_choice("join", self.join, (None, "name", "time", "order"))
        bounds = {"shortest": (0, inf), "guard": (0, 0.4), "threshold": (0, 0.9), "rate": (0, inf)}
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            if value is not None and not low <= value < high:
                raise UsageError(f"--{name} {value:g}: give a number from {low:g} to {high:g}.")
        for symbol in (*self.scales, *([self.channel] if self.channel else [])):
            _known(symbol)
        for symbol in (*self.map, *self.units):
            if symbol != "time":
                _known(symbol)
        for symbol, value in self.constants.items():
            if symbol not in ("n", "V", "D") or not 0 < value < inf:
                raise UsageError(f"--value {symbol}={value:g}: give n (1/min), or V (m/min) and D (mm), above zero.")


def _known(symbol: str) -> None:
    if symbol not in LOADS:
        raise UsageError(f"{symbol!r} is no channel of a record; the channels are {', '.join(LOADS)}.")
