"""Columns, keys or nodes of a source as the quantities of a `Sample`, in the units of the laws."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Literal

import numpy as np

from ...core.errors import DataError, UsageError
from ...core.text import shortened
from ...datasets.headers import Header, parse_header
from ...datasets.units import canonical, convert, same_dimension
from ...datasets.vocabulary import role_of, understood_unit
from ..blocks import derived
from ..samples import Sample, State
from .options import CONDITIONS, OWN, PROGRAMMED, SourceOptions

Kind = Literal["load", "condition", "time", "state", "tool"]
Value = float | str | None

_NAMES = {
    "time": ("time", "timestamp", "time stamp", "datetime", "date time", "utc", "zeit", "temps", "tiempo"),
    "state": ("state", "status", "machine state", "execution", "zustand", "maschinenzustand", "etat", "estado"),
    "tool": ("tool", "tool number", "tool no", "tool id", "werkzeug", "werkzeugnummer", "outil", "herramienta"),
}
_BY_NAME = {name: symbol for symbol, names in _NAMES.items() for name in names}
_WORDS: Mapping[str, State] = {
    **dict.fromkeys(("off", "aus", "spindle off", "spindle stopped", "power off", "unavailable"), "off"),
    **dict.fromkeys(("idle", "ready", "stopped", "interrupted", "feed hold", "hold", "paused", "halt"), "idle"),
    **dict.fromkeys(("feed", "cut", "cutting", "feeding", "vorschub"), "feed"),
}
_USUAL = {"V": "120m/min", "f": "0.2mm/rev", "fz": "0.1mm", "d": "2mm", "ae": "10mm", "D": "50mm"}
FEWEST_ROWS = 20  # with a condition, before an empty cell of it is a loss
_STANDS = 1e-9  # a speed or feed below this is zero


@dataclass(frozen=True, slots=True)
class Channel:
    """One quantity of a source.

    Attributes
    ----------
    symbol, kind : str
    place : int
        Of its label in the source.
    label : str
        Header, key or node.
    factor, shift : float
        Value here = factor x value of the source + shift.
    """

    symbol: str
    kind: Kind
    place: int
    label: str
    factor: float = 1.0
    shift: float = 0.0


@dataclass(frozen=True, slots=True)
class Channels:
    """Quantities of a source, and what was assumed of them.

    Attributes
    ----------
    channels : tuple of Channel
        All but the time.
    time : Channel or None
    time_unit : str
        As the source names it; empty where it does not.
    notes : tuple of str
    """

    channels: tuple[Channel, ...]
    time: Channel | None
    time_unit: str
    notes: tuple[str, ...]

    @property
    def loads(self) -> tuple[str, ...]:
        """Symbols of the loads."""
        return tuple(c.symbol for c in self.channels if c.kind == "load")

    def describe(self) -> str:
        """One line: each quantity with its label, and what was assumed."""
        every = [*self.channels, *([self.time] if self.time else [])]
        return "; ".join([", ".join(f"{c.symbol} from {shortened(c.label, 60)!r}" for c in every), *self.notes])

    def sample(self, time: float, values: Sequence[Value]) -> Sample:
        """Reading at a time (s) from the values of ``channels``: numbers, or None where nothing was read.

        A load that is a text, such as a cell that is no number or a bad status, is absent and named in ``bad``; such a
        condition is NaN.
        """
        loads: dict[str, float] = {}
        conditions: dict[str, float] = {}
        state: State = "unknown"
        tool = bad = ""
        for channel, value in zip(self.channels, values, strict=True):
            kind = channel.kind
            if kind == "state" or kind == "tool":
                text = "" if value is None else f"{value:g}" if isinstance(value, float) else value.strip()
                state, tool = (state_of(text), tool) if kind == "state" else (state, text)
            elif isinstance(value, float) and isfinite(x := channel.factor * value + channel.shift):
                (loads if kind == "load" else conditions)[channel.symbol] = x
            elif kind == "condition" and value is not None:
                conditions[channel.symbol] = nan
            elif value is not None:
                text = f"{channel.symbol} is {shortened(str(value), 40)!r}"
                bad = f"{bad}, {text}" if bad else text
        if "override" in conditions:
            _apply_override(conditions)
        if state == "unknown":
            state = _state_by_motion(conditions)
        return Sample(time, loads, conditions, state, tool, bad)


class Blanks:
    """Conditions of rows that are lost: empty or NaN where most rows before held a value.

    A table that holds changes alone is empty most of the time, and what it does not hold is as it was.

    Examples
    --------
    >>> found = channels_of(["P [kW]", "V [m/min]"], SourceOptions(loads={"P": "kW"}), "run.csv")
    >>> blanks = Blanks()
    >>> [blanks.mark(found, [1.0, v], empty=True)[1] for v in [120.0] * 20 + [None]][-2:]
    [120.0, 'empty']
    """

    def __init__(self) -> None:
        self._filled, self._blank, self._now = Counter[str](), Counter[str](), Counter[str]()

    def mark(self, channels: Channels, values: Sequence[Value], *, empty: bool) -> list[Value]:
        """The values of a row, with a text for each condition that is lost; ``empty``: None is a blank."""
        return [
            self._condition(channel.symbol, value, empty=empty) if channel.kind == "condition" else value
            for channel, value in zip(channels.channels, values, strict=True)
        ]

    def _condition(self, symbol: str, value: Value, *, empty: bool) -> Value:
        if isinstance(value, float):
            self._filled[symbol] += 1
            self._blank[symbol] += self._now.pop(symbol, 0)
            return value
        if (value is None and not empty) or (value and value.casefold() != "nan"):
            return value
        self._now[symbol] += 1
        usual = self._filled[symbol] >= FEWEST_ROWS and self._filled[symbol] > self._blank[symbol]
        return "empty" if usual else None


def state_of(text: str) -> State:
    """State that a word of a machine denotes; ``"unknown"`` for other words.

    Examples
    --------
    >>> state_of("Feed-Hold"), state_of("ACTIVE")
    ('idle', 'unknown')
    """
    return _WORDS.get(" ".join(text.casefold().replace("-", " ").replace("_", " ").split()), "unknown")


def _apply_override(conditions: dict[str, float]) -> None:
    """Replace programmed feeds by programmed feed x override."""
    for programmed, symbol in PROGRAMMED.items():
        if programmed in conditions:
            conditions[symbol] = conditions.pop(programmed) * conditions["override"]


def _state_by_motion(conditions: Mapping[str, float]) -> State:
    if abs(conditions.get("n", 1.0)) < _STANDS:
        return "off"
    if not isfinite(conditions.get("fm", nan)):
        return "unknown"
    return "idle" if abs(conditions["fm"]) < _STANDS else "feed"


def channels_of(labels: Sequence[str], options: SourceOptions, name: str, units: Sequence[str] = ()) -> Channels:
    """Quantities that labels name, with their units.

    Parameters
    ----------
    labels : sequence of str
        Headers of columns, or keys; ``P [kW]`` and ``P_kW`` hold a unit.
    options : SourceOptions
    name : str
        Of the source, for messages.
    units : sequence of str, optional
        Unit of each label, from a row of units.

    Raises
    ------
    DataError
        No label names a load of the laws, or a unit does not fit.
    UsageError
        A mapped label does not exist, or two labels name one quantity.

    Examples
    --------
    >>> channels_of(["t [s]", "Power [W]"], SourceOptions(loads={"P": "kW"}), "run.csv").sample(0.0, [1800.0]).loads
    {'P': 1.8}
    """
    heads = [parse_header(label) for label in labels]
    found = {
        symbol: _mapped(symbol, wanted, labels, heads, name)
        for symbol, wanted in options.map.items()
        if wanted.strip().casefold() != "none"
    }
    others = _named(found, labels, heads, options, name)
    if not any(symbol in options.loads for symbol in found):
        wanted = " or ".join(f"{symbol} [{unit}]" for symbol, unit in options.loads.items())
        first, other = next(iter(options.loads), "P"), next(iter(others), "COLUMN")
        raise DataError(
            f"{name} gives no load of the laws ({wanted or 'none'}); it has {_list(labels)}. Name it, for "
            f'instance --map "{first}={shortened(other, 30)}", and --scale {first}=... where it is of another unit.'
        )
    placed = {symbol: (place, labels[place], _unit_at(place, heads, units)) for symbol, place in found.items()}
    return _made(placed, options, name, [f"not read: {_list(others)}"] if others else [])


def require_conditions(channels: Channels, options: SourceOptions, name: str) -> None:
    """Refuse a source without a condition that the laws need and that neither it nor the user gives.

    Raises
    ------
    DataError
        The message names the conditions and how to give them.

    Examples
    --------
    >>> found = channels_of(["t [s]", "P [kW]", "V [m/min]"], SourceOptions(loads={"P": "kW"}), "run.csv")
    >>> require_conditions(found, SourceOptions(loads={"P": "kW"}, needs=("V",)), "run.csv")
    """
    symbols = [PROGRAMMED.get(c.symbol, c.symbol) for c in channels.channels if c.kind == "condition"]
    known = derived({**dict.fromkeys(symbols, 1.0), **options.given})
    missing = [symbol for symbol in options.needs if symbol not in known]
    if missing:
        values = " ".join(f"--value {symbol}={_USUAL.get(symbol, '1')}" for symbol in missing)
        diameter = ", or the diameter of the spindle speed (--value D=50mm)" if "V" in missing and "n" in known else ""
        raise DataError(
            f"{name} does not give {', '.join(missing)}, which the laws need: give {values}{diameter}, or name the "
            f"column with --map {missing[0]}=..."
        )


def channels_for(places: Mapping[str, tuple[str, str]], options: SourceOptions, name: str) -> Channels:
    """Quantities of a source whose places are given: symbol -> (node or pin, unit); errors as for `channels_of`.

    Examples
    --------
    >>> channels_for({"P": ("ns=2;i=5", "W")}, SourceOptions(loads={"P": "kW"}), "server").loads
    ('P',)
    """
    return _made({symbol: (k, *place) for k, (symbol, place) in enumerate(places.items())}, options, name, [])


def _made(
    placed: Mapping[str, tuple[int, str, str]], options: SourceOptions, name: str, notes: Sequence[str]
) -> Channels:
    """Channels by symbol -> (place, label, unit), with what was assumed."""
    made, said = [], []
    for symbol, (place, label, unit) in placed.items():
        channel, note = _channel(symbol, place, label, options.units.get(symbol) or unit, options)
        made.append(channel)
        said += [note] if note else []
    if "override" not in placed and (left := [s for s in PROGRAMMED if s in placed]):
        raise UsageError(f"{name}: {left[0]} is a programmed feed and needs the override: give --map override=...")
    missing = [symbol for symbol in options.loads if symbol not in placed]
    said += [f"{name} does not give {', '.join(missing)}: not used"] if missing else []
    clock = next((c for c in made if c.kind == "time"), None)
    time_unit = (options.units.get("time") or placed["time"][2]) if clock else ""
    return Channels(tuple(c for c in made if c.kind != "time"), clock, time_unit, (*said, *notes))


def _unit_at(place: int, heads: Sequence[Header], units: Sequence[str]) -> str:
    return (units[place] if place < len(units) else "") or heads[place].unit_text


def _list(labels: Sequence[str]) -> str:
    return ", ".join(repr(shortened(label, 30)) for label in labels[:12]) or "no column"


def _mapped(symbol: str, wanted: str, labels: Sequence[str], heads: Sequence[Header], name: str) -> int:
    """Place of the label that a quantity is mapped to: the label, its name without unit, or col3."""
    wanted = wanted.strip()
    for texts in (list(labels), [head.name for head in heads], [f"col{k}" for k in range(1, len(labels) + 1)]):
        if texts.count(wanted) == 1:
            return texts.index(wanted)
    raise UsageError(f"--map {symbol}={shortened(wanted)}: {name} has no such column; it has {_list(labels)}.")


def _named(
    found: dict[str, int], labels: Sequence[str], heads: Sequence[Header], options: SourceOptions, name: str
) -> list[str]:
    """Add the quantities that labels name themselves to ``found``; returns the labels that are not read."""
    others, taken = [], set(found.values())
    for place, (label, head) in enumerate(zip(labels, heads, strict=True)):
        symbol = None if place in taken else _symbol(head, options)
        if place in taken or (symbol in options.map and symbol is not None):
            continue
        if symbol is None:
            others.append(label)
        elif symbol in found:
            raise UsageError(
                f"{name}: columns {labels[found[symbol]]!r} and {label!r} are both {symbol}: choose one with "
                f"--map {symbol}=col{found[symbol] + 1} or --map {symbol}=col{place + 1}."
            )
        else:
            found[symbol] = place
    return others


def _symbol(head: Header, options: SourceOptions) -> str | None:
    """Symbol of the quantity of a header that is wanted here, None for others."""
    if head.name in options.loads:
        return head.name
    if head.name == "t":
        return "time"
    if own := _BY_NAME.get(" ".join(head.name.casefold().replace("_", " ").split())):
        return own
    role = role_of(head.name, head.unit_text or None)
    return role if role in options.loads or role in CONDITIONS else None


def _channel(symbol: str, place: int, label: str, unit: str, options: SourceOptions) -> tuple[Channel, str]:
    """Channel of a quantity, and what was assumed."""
    if symbol in OWN and symbol != "override":
        kind: Kind = "time" if symbol == "time" else "state" if symbol == "state" else "tool"
        return Channel(symbol, kind, place, label), ""
    kind = "load" if symbol in options.loads else "condition"
    if symbol in options.scales:
        return Channel(symbol, kind, place, label, options.scales[symbol]), ""
    if symbol == "override":
        percent = canonical(unit) == "%"
        note = "" if unit else "override: a factor is assumed (1 is 100 %)"
        return Channel(symbol, kind, place, label, 0.01 if percent else 1.0), note
    target = options.target(symbol)
    if not unit:
        return Channel(symbol, kind, place, label), f"{symbol}: {target} is assumed, the source names no unit"
    written = understood_unit(PROGRAMMED.get(symbol, symbol), unit)
    if written is None or not same_dimension(written, target):
        raise DataError(
            f"{shortened(label, 60)!r} is in {shortened(unit)}, and {symbol} in {target}: give the unit with --unit "
            f"{symbol}={target}, a factor with --scale {symbol}=... ({target} per {shortened(unit)}), or leave it out "
            f"with --map {symbol}=none."
        )
    zero, one = (float(x) for x in convert(np.array([0.0, 1.0]), written, target))
    return Channel(symbol, kind, place, label, one - zero, zero), ""
