"""Lines of CSV or JSON as samples: header, units and dialect are found as the lines arrive."""

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from time import monotonic
from time import time as wall_time
from typing import Any, Final

from ...core.errors import FitmodelsError
from ...core.text import shortened
from ...datasets.units import is_unit
from ..samples import Notice, Sample
from .channels import Blanks, Channel, Channels, Value, channels_of, require_conditions
from .clock import Clock, Stamps, no_time
from .options import SourceOptions

MOST_HEADER_LINES: Final = 50  # lines above the header
LONGEST: Final = 65_536  # characters of a line
MOST_KEYS: Final = 1000  # of a JSON object, nested ones counted
IDLE: Final = 0.5  # s without a reading, after which the monitor gets its turn
SAY_AGAIN: Final = 5.0  # s between two notices on unreadable lines
_COMMA = re.compile(r"[+-]?(?:\d+|\d{1,3}(?:\.\d{3})+),\d+(?:[eE][+-]?\d+)?")  # 5,39 or 1.005,39
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_DELIMITERS = (";", "\t", ",", "|")


class Lines:
    """Samples from the lines of a source, whichever of CSV and JSON lines it is.

    Parameters
    ----------
    name : str
        Of the source.
    options : SourceOptions

    Examples
    --------
    >>> lines = Lines("run.csv", SourceOptions(loads={"P": "kW"}))
    >>> [item for line in ("t [s];P [W]", "0,02;1800") for item in lines.take(line)][-1].loads
    {'P': 1.8}
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        self.name, self._options = name, options
        self._clock = Clock()
        self._last_said = -SAY_AGAIN
        self._unsaid = 0
        self._said: set[str] = set()
        self._loaded: float | None = None  # time of the last sample with a load
        self._missed = False  # a load, for ``silent`` s
        self._skipped = False  # samples that the journal holds
        self.samples = 0  # that were read
        self.fault = ""  # of the last line that could not be read
        self.restart()

    def restart(self) -> None:
        """Begin a new file: its header is read anew; the clock goes on."""
        self._table: _Csv | _Json | None = None
        self._stamps: Stamps | None = None
        self._refusal: FitmodelsError | None = None
        self._number = self._count = 0

    def take(self, line: str, arrival: float | None = None) -> Iterator[Sample | Notice]:
        """Samples and notices of a line; ``arrival`` (s, monotonic) where it was written just now.

        Raises
        ------
        FitmodelsError
            There is no header, or it names no load of the laws.
        """
        self._number += 1
        if self._number == 1:
            line = line.removeprefix("\ufeff")
        if not line.strip():
            return
        if len(line) > LONGEST:
            yield from self._unreadable(f"line {self._number} has {len(line)} characters, more than {LONGEST}")
        elif self._table is None:
            yield from self._begin(line, arrival)
        else:
            yield from self._row(self._table, line, arrival)

    def _begin(self, line: str, arrival: float | None) -> Iterator[Sample | Notice]:
        """Find the header: the first line that names a load of the laws."""
        if line.lstrip().startswith("{"):
            self._table = _Json(self.name, self._options)
            yield from self._row(self._table, line, arrival)
            return
        try:
            self._table = _Csv(line, self.name, self._options)
        except FitmodelsError as error:
            cells = _split(line, _delimiter(line))
            values = sum(_NUMBER.fullmatch(cell.replace(",", ".")) is not None for cell in cells)
            if (
                not line.startswith(("#", "%"))
                and (len(cells) > 1 or self._refusal is None)
                and 2 * values <= len(cells)
            ):
                self._refusal = error  # of the line that is most like a header
            if 2 * values > len(cells) or self._number > MOST_HEADER_LINES:
                raise (self._refusal or error) from None

    def _row(self, table: "_Csv | _Json", line: str, arrival: float | None) -> Iterator[Sample | Notice]:
        try:
            read = table.read(line)
        except ValueError as error:
            yield from self._unreadable(f"line {self._number}: {error}")
            return
        if read is None:
            return
        channels, clock, values = read
        if self._stamps is None:
            if channels.time is None and self._options.rate is None:
                raise no_time(self.name)
            self._stamps = Stamps(channels.time_unit, self.name)
            yield Notice(wall_time(), "connected", f"{self.name}: {channels.describe()}")
        elif text := table.news():
            yield Notice(wall_time(), "connected", f"{self.name}: {text}")
        time = self._time(clock)
        if self._stamps.assumed not in (*self._said, ""):
            self._said.add(self._stamps.assumed)
            yield Notice(wall_time(), "connected", self._stamps.assumed)
        if time is None:
            value = shortened(str(clock), 30)
            yield from self._unreadable(f"line {self._number}: {value!r} is no time (2026-12-31 08:15:00.5 is one)")
        else:
            yield from self._sample(channels.sample(time, values), arrival)

    def _time(self, clock: Value) -> float | None:
        """Time of a row, s."""
        if self._options.rate is not None:
            self._count += 1
            return (self._count - 1) / self._options.rate
        assert self._stamps is not None  # noqa: S101  set before
        return self._stamps.seconds(clock)

    def _sample(self, sample: Sample, arrival: float | None) -> Iterator[Sample | Notice]:
        if self._known(sample, arrival):
            if not self._skipped:
                self._skipped = True
                yield Notice(wall_time(), "connected", f"{self.name}: readings that the journal holds are left out")
            return
        if self._options.after is not None and self._clock.last is None and sample.time <= self._options.after:
            text = f"times are {self._options.after - sample.time:.3g} s before those of the journal"
            yield Notice(wall_time(), "clock", f"{text}: the clock of the source was set back")
        self.samples += 1
        yield from self._without_load(sample)
        use, notice = self._clock.take(sample.time, arrival)
        if notice is not None:
            yield notice
        if use:
            yield sample

    def _known(self, sample: Sample, arrival: float | None) -> bool:
        """Whether the journal holds a sample: not one that was written just now, whatever its time is."""
        after = self._options.after
        return after is not None and self._clock.last is None and sample.time <= after and arrival is None

    def _without_load(self, sample: Sample) -> Iterator[Notice]:
        """A notice where no sample has held a load for ``silent`` s, once."""
        if sample.loads or self._loaded is None:
            self._loaded, self._missed = sample.time, False
        elif abs(sample.time - self._loaded) > self._options.silent and not self._missed:
            self._missed = True
            why = sample.bad or "its cells are empty"
            yield Notice(wall_time(), "bad", f"{self.name}: no load for {self._options.silent:g} s; {why}")

    def _unreadable(self, text: str) -> Iterator[Notice]:
        """A notice on lines that cannot be read, not more often than every 5 s."""
        self._unsaid, self.fault = self._unsaid + 1, text
        now = wall_time()
        if abs(now - self._last_said) >= SAY_AGAIN:
            others = f" ({self._unsaid} lines in all)" if self._unsaid > 1 else ""
            self._last_said, self._unsaid = now, 0
            yield Notice(now, "bad", f"{self.name}: {text}; left out{others}")


class Feed:
    """Lines of a source that may fall silent: samples, and notices on silence and on headers that cannot be used.

    The first header has to name a load of the laws (FitmodelsError); a later one that does not is refused in a notice.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        self.name, self._silent = name, options.silent
        self._lines = Lines(name, options)
        self._refused = False  # the header of the present file was not understood
        self._lost = False
        self._last = self._given = monotonic()  # of a reading, and of anything

    def restart(self) -> None:
        """Begin another file or connection, with a header of its own."""
        self._lines.restart()
        self._refused = False

    def take(self, line: bytes, arrival: float | None) -> Iterator[Sample | Notice]:
        """The content of a line; ``arrival`` as for `Lines`."""
        if self._refused:
            return
        try:
            for item in self._lines.take(decoded(line), arrival):
                self._given = monotonic()
                if isinstance(item, Sample):
                    self._last = self._given
                    if self._lost:
                        self._lost = False
                        yield Notice(wall_time(), "connected", f"{self.name} gives readings again")
                yield item
        except FitmodelsError as error:
            if self._lines.samples < 2:  # the unit of times without one is known from the second
                raise
            self._refused = True
            yield Notice(wall_time(), "refused", f"{error} Its rows are not read.")

    def lose(self, reason: str) -> Iterator[Notice]:
        """A notice that the source is lost, once."""
        if not self._lost:
            self._lost, self._given = True, monotonic()
            yield Notice(wall_time(), "lost", f"{self.name}: {reason}")

    def quiet(self, reason: str) -> Iterator[Notice]:
        """Notices of a source that gives nothing; it is lost after ``silent`` s, for a reason."""
        now = monotonic()
        if not self._lost and now - self._last >= self._silent:
            yield from self.lose(f"no reading for {now - self._last:.1f} s; {reason}")
        elif now - self._given >= IDLE:
            self._given = now
            yield Notice(wall_time(), "idle")


def decoded(line: bytes) -> str:
    """A line of UTF-8, or of Windows-1252 where it is none."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


class _Csv:
    """Rows of a table under a header."""

    def __init__(self, header: str, name: str, options: SourceOptions) -> None:
        self._name, self._options = name, options
        self._delimiter = _delimiter(header)
        self._labels = _split(header, self._delimiter)
        while self._labels and not self._labels[-1]:
            self._labels.pop()
        self._decimal = ""
        self._first, self._blanks = True, Blanks()
        self._use(channels_of(self._labels, options, name))

    def _use(self, channels: Channels) -> None:
        self._channels = channels
        self._places = [(c.place, c.kind in ("state", "tool")) for c in channels.channels]
        require_conditions(channels, self._options, self._name)

    def news(self) -> str:
        """Nothing: a table has one header."""
        return ""

    def read(self, line: str) -> tuple[Channels, Value, list[Value]] | None:
        """Channels, time and values of a row; None for a row of units. ValueError where the row is torn."""
        cells = _split(line, self._delimiter)
        if self._first:
            self._first = False
            if (units := self._units(cells)) is not None:
                self._use(channels_of(self._labels, self._options, self._name, units))
                return None
        if not len(self._labels) <= len(cells) <= len(self._labels) + 1 or any(cells[len(self._labels) :]):
            raise ValueError(f"{len(cells)} cells, not {len(self._labels)}")
        values: list[Value] = [cells[place] if text else self._value(cells[place]) for place, text in self._places]
        clock, values = self._channels.time, self._blanks.mark(self._channels, values, empty=True)
        return self._channels, None if clock is None else self._value(cells[clock.place]), values

    def _units(self, cells: Sequence[str]) -> list[str] | None:
        """A row of units under the header, None where it is a row of values."""
        filled = [cell.strip(" []()") for cell in cells if cell]
        if filled and all(is_unit(cell) or not cell for cell in filled) and not any(map(str.isdigit, filled)):
            return [cell.strip(" []()") for cell in cells]
        return None

    def _value(self, cell: str) -> Value:
        """A cell as a number, or as text where it is none; the decimal mark of the file is that of its first number."""
        if _NUMBER.fullmatch(cell):
            if "." in cell and self._decimal != ".":
                if self._decimal:
                    return cell
                self._decimal = "."
            return float(cell)
        if _COMMA.fullmatch(cell) and self._decimal != ".":
            self._decimal = ","
            return float(cell.replace(".", "").replace(",", "."))
        return cell or None


class _Json:
    """Objects of JSON lines; keys may differ from line to line."""

    def __init__(self, name: str, options: SourceOptions) -> None:
        self._name, self._options = name, options
        self._channels: Channels | None = None
        self._labels: list[str] = []
        self._objects, self._blanks = 0, Blanks()
        self._news = ""

    def news(self) -> str:
        """Notices of what new keys were found to be, once each."""
        text, self._news = self._news, ""
        return text

    def read(self, line: str) -> tuple[Channels, Value, list[Value]] | None:
        """Channels, time and values of an object. ValueError where the line is no object."""
        try:
            data = json.loads(line)
        except RecursionError:
            raise ValueError("nested too deep") from None
        except ValueError:
            raise ValueError("not JSON") from None
        if not isinstance(data, dict):
            raise ValueError("no JSON object")
        flat = dict(_flat(data))
        new = [key for key in flat if key not in self._labels]
        if new or self._channels is None:
            if len(self._labels) + len(new) > MOST_KEYS:
                raise ValueError(f"more than {MOST_KEYS} different keys")
            self._labels += new
            self._learn(new)
        channels = self._channels
        if channels is None:
            return None
        values = [_json_value(channel, flat) for channel in channels.channels]
        values = self._blanks.mark(channels, values, empty=False)
        return channels, None if channels.time is None else _plain(flat.get(channels.time.label)), values

    def _learn(self, new: Sequence[str]) -> None:
        """Take new keys in; before an object with a load there are no channels."""
        before, self._objects = self._channels, self._objects + 1
        try:
            channels = channels_of(self._labels, self._options, self._name)
        except FitmodelsError:
            if before is None and self._objects > MOST_HEADER_LINES:
                raise
            if before is not None:
                raise ValueError(f"new keys {', '.join(new[:5])} do not fit") from None
            return
        self._channels = channels
        if before is not None and {c.symbol for c in channels.channels} != {c.symbol for c in before.channels}:
            self._news = channels.describe()


def _flat(data: dict[str, Any], above: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Keys of nested objects, joined by points."""
    for key, value in data.items():
        if isinstance(value, dict) and depth < 3:
            yield from _flat(value, f"{above}{key}.", depth + 1)
        else:
            yield f"{above}{key}", value


def _json_value(channel: Channel, flat: Mapping[str, Any]) -> Value:
    """A value of an object, None where it has no such key; a condition that is null is NaN."""
    plain = _plain(flat.get(channel.label))
    if channel.kind == "condition" and plain is None and channel.label in flat:
        return "NaN"
    return f"{plain:g}" if channel.kind == "tool" and isinstance(plain, float) else plain


def _plain(value: Any) -> Value:  # noqa: ANN401  of JSON
    """A JSON value as a number or a text; None for null and lists."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return float(value) if abs(value) < 1e300 else None
    return value if isinstance(value, str) else None


def _delimiter(header: str) -> str:
    """Delimiter of a header line: the most frequent one."""
    return max(_DELIMITERS, key=header.count)


def _split(line: str, delimiter: str) -> list[str]:
    """Cells of a line without blanks around them."""
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
        except csv.Error:
            return []
    return [cell.strip() for cell in line.split(delimiter)]
