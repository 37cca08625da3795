"""Times written as a clock shows them, such as 2:30 or 0:02:30, as minutes."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from shlex import quote

import numpy as np

from ..core.arrays import Array, Flags
from ..core.errors import DataError
from .doubts import Doubt
from .headers import last_bracket, parse_header
from .options import ReadOptions
from .tables import Column
from .units import canonical
from .vocabulary import roles_named

_CLOCK = re.compile(r"(\d{1,4}):([0-5]?\d)(?::([0-5]?\d(?:[.,]\d+)?))?(?:\s*(?:h|min|hrs?))?")
_STAMP = re.compile(r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T]+\d{1,2}:\d\d(?::\d\d(?:[.,]\d+)?)?(?:\s*[AaPp]\.?[Mm]\.?)?")
_WORDS = re.compile(
    r"(?=\d)(?:(\d+)\s*h(?:rs?|ours?)?\s*)?(?:(\d+(?:[.,]\d+)?)\s*(?:minutes?|mins?|m|['′])\s*)?"
    r"(?:(\d+(?:[.,]\d+)?)\s*(?:seconds?|sec|sek|s|''|[\"″])\s*)?\.?",
    re.IGNORECASE,
)
_FORMATS = {
    "min": re.compile(r"m{1,2}(?:in)?:s{1,2}(?:ec|ek)?", re.IGNORECASE),
    "h": re.compile(r"h{1,2}:m{1,2}(?:in)?(?::s{1,2}(?:ec|ek)?)?", re.IGNORECASE),
}  # notations by the unit of their first number
_USUAL = (0.2, 120.0)  # min, time in cut
_LONGEST = 600.0  # min
_FEW = 3  # times that show a course
_RISING = 0.6  # share of rising steps in a column of times
_MORNING = 240.0  # min after midnight: before it nobody starts a test


@dataclass(frozen=True, slots=True)
class _Times:
    """The cells of a column: shape (n, 3), nan where there is no number, and which of them have three parts."""

    parts: Array
    example: str

    @property
    def has_seconds(self) -> Flags:
        return np.isfinite(self.parts[:, 2])

    def minutes(self, first: str) -> Array:
        """Minutes where the first number of two is in this unit; three numbers are h:mm:ss, unless all end in :00."""
        a, b, c = self.parts.T
        hours: Array = 60 * a + b + np.nan_to_num(c) / 60
        whole = bool((c[self.has_seconds] == 0).all())
        minutes: Array = np.where(self.has_seconds & (not whole), hours, a + b / 60)
        return hours if first == "h" else minutes


def clock_columns(
    columns: tuple[Column, ...], options: ReadOptions
) -> tuple[tuple[Column, ...], dict[str, str], list[str], list[Doubt]]:
    """Columns of times with their clock texts as minutes, the units left, what was assumed, and doubts.

    Raises
    ------
    DataError
        It is open whether the first number is hours or minutes, or the cells are times of day.

    >>> column = Column(1, "t", "", np.array(["2:30", "15:00"], dtype=object), False)
    >>> read, _, assumed, _ = clock_columns((column,), ReadOptions())
    >>> read[0].values.tolist(), assumed
    ([2.5, 15.0], ['t: 2:30 is read as min:s, 2.5 min'])
    """
    units, assumed, doubts, made = dict(options.units), [], [], []
    for column in columns:
        role = "" if column.is_numeric else _role(column, options.map)
        if not role and not column.is_numeric and _first_text(_STAMP, column):
            doubts += _unused(None, column, columns)
        times = None if column.is_numeric or not (role or _first_text(_CLOCK, column)) else _times(column)
        if times is not None and not role:
            doubts += _unused(times, column, columns)
        elif times is not None:
            named = units.get(role, "") or column.unit_cell or _unit_of(column.name)
            if units.get(role) and notation(units[role]):
                del units[role]
            unit, doubt = _decided(times, role, column, named)
            minutes = times.minutes(unit)
            column = replace(column, values=minutes, is_numeric=True, unit_cell="min", bad=(), bad_count=0)
            shown = float(minutes[np.isfinite(minutes)][0])
            written = ("h:min" if unit == "h" else "min:s") + (":s" if unit == "h" and times.has_seconds.any() else "")
            assumed.append(f"{role}: {times.example} is read as {written}, {shown:g} min")
            doubts += doubt
        made.append(column)
    return tuple(made), units, assumed, doubts


def notation(unit: str) -> str:
    """Unit of the first number in a notation of times: "min" for mm:ss, "h" for h:mm and h:mm:ss, else "".

    >>> notation("mm:ss"), notation("h:min"), notation("min")
    ('min', 'h', '')
    """
    return next((first for first, form in _FORMATS.items() if form.fullmatch(unit.strip(" []()"))), "")


def _role(column: Column, mapping: Mapping[str, str]) -> str:
    name = parse_header(column.name).name
    for role in ("t", "T"):
        if mapping.get(role, "").strip() in (column.name, name, f"col{column.number}"):
            return role
    found = roles_named(name) or roles_named(column.name[: last_bracket(column.name)])
    return found[0] if found and found[0] in ("t", "T") and found[0] not in mapping else ""


def _unit_of(name: str) -> str:
    return name[last_bracket(name) :].strip(" []()") or parse_header(name).unit_text


def _first_text(pattern: re.Pattern[str], column: Column) -> str:
    """The first filled cell of a column of texts if it is of this pattern, else ""."""
    first = next((text for text in column.values if text), "")
    return first if pattern.fullmatch(first) else ""


def _unused(times: _Times | None, column: Column, columns: tuple[Column, ...]) -> list[Doubt]:
    """A doubt on a column of rising clock times or of dates with times in a file that has no other time."""
    if any(_role(other, {}) for other in columns):
        return []
    if times is None or _is_time_of_day(times.minutes("h")):
        if times is None and len(set(column.values.tolist())) < len(column.values) / 2:
            return []
        example = times.example if times is not None else _first_text(_STAMP, column)
        sentence = (
            f"column {column.name!r} ({example}) holds times of day and is not used, and the file has no time in "
            "cut: write the minutes in cut since the start of each edge in a column t [min]"
        )
        return [Doubt((column.name,), sentence)]
    known = times.minutes("min")[np.isfinite(times.parts[:, 0])]
    if len(set(known.tolist())) < _FEW or (np.diff(known) > 0).mean() < _RISING:
        return []
    sentence = f"column {column.name!r} ({times.example}) may be the time in cut and is not used"
    return [Doubt((column.name,), sentence, f"--map {quote(f't={column.name}')}")]


def _times(column: Column) -> _Times | None:
    """The cells as numbers, None where one of them is no clock time; times in words have their own units."""
    texts = [str(text).strip() for text in column.values]
    known = {text: _parts(text) for text in set(texts) if text}
    clocks = [text for text in texts if text and ":" in text]
    if not known or any(parts is None for parts in known.values()) or (not clocks and not _WORDS.search(texts[0])):
        return None
    nothing = (np.nan, np.nan, np.nan)
    return _Times(np.array([known.get(text) or nothing for text in texts], dtype=float), (clocks or texts)[0])


def _parts(text: str) -> tuple[float, float, float] | None:
    if match := _CLOCK.fullmatch(text):
        return float(match[1]), float(match[2]), float(match[3].replace(",", ".")) if match[3] else np.nan
    if (match := _WORDS.fullmatch(text)) and any(match.groups()):
        hours, minutes, seconds = (float((part or "0").replace(",", ".")) for part in match.groups())
        return hours, minutes, seconds
    return (0.0, 0.0, np.nan) if text in ("0", "0.0", "0,0") else None


def _decided(times: _Times, role: str, column: Column, named: str) -> tuple[str, list[Doubt]]:
    """Unit of the first number of two, and a doubt where another unit is possible."""
    if first := notation(named):
        return first, []
    in_hours, in_minutes = times.minutes("h"), times.minutes("min")
    unit = canonical(named) if named else None
    if unit is None and _is_time_of_day(in_hours):
        raise DataError(_of_day(times, role, column))
    seconds = times.parts[:, 2][times.has_seconds]
    if seconds.size == times.parts.shape[0] - np.isnan(times.parts[:, 0]).sum() and (seconds != 0).any():
        return "h", []
    if np.array_equal(in_hours, in_minutes, equal_nan=True):
        return "h", []
    usual_h, usual_min = _is_usual(in_hours), _is_usual(in_minutes)
    if seconds.size and usual_h:
        return "h", []
    if unit in ("min", "s", "h"):
        first = "h" if unit == "h" else "min"
        as_other, flag = ("min:s", "mm:ss") if first == "h" else ("h:min", "h:mm")
        sentence = (
            f"{role}, {times.example}: read as {'h:min' if first == 'h' else 'min:s'}, since the header names {unit}; "
            f"as {as_other} the times would be {_span(in_minutes if first == 'h' else in_hours)} min"
        )
        return first, [Doubt((role,), sentence, f"--unit {role}={flag}")]
    if usual_h == usual_min:
        raise DataError(_open(times, role, column))
    first, other = ("h", in_minutes) if usual_h else ("min", in_hours)
    if np.nanmax(other) > _LONGEST or np.nanmax(other) < _USUAL[0] / 4:
        return first, []
    flag = "mm:ss" if first == "h" else "h:mm"
    sentence = (
        f"{role}, {times.example}: read as {'h:min' if first == 'h' else 'min:s'}; as "
        f"{'min:s' if first == 'h' else 'h:min'} the times would be {_span(other)} min, which is not usual"
    )
    return first, [Doubt((role,), sentence, f"--unit {role}={flag}")]


def _is_usual(minutes: Array) -> bool:
    return bool(_USUAL[0] <= np.nanmax(minutes) <= _USUAL[1])


def _is_time_of_day(minutes: Array) -> bool:
    """Whether times lie in a day after its beginning, and each rising stretch within the last half of its end."""
    known = minutes[np.isfinite(minutes)]
    if len(known) < _FEW or known.min() < _MORNING or known.max() >= 24 * 60:
        return False
    stretches = np.split(known, np.flatnonzero(np.diff(known) < 0) + 1)
    narrow = [part[-1] - part[0] < part[-1] / 2 for part in stretches]
    return all(narrow) and max(map(len, stretches)) >= _FEW


def _span(minutes: Array) -> str:
    return f"{np.nanmin(minutes):.4g} to {np.nanmax(minutes):.4g}"


def _of_day(times: _Times, role: str, column: Column) -> str:
    return (
        f"column {column.name!r} holds times of day ({times.example}, rising within each edge), not the time in cut "
        f"{role}: they count pauses and do not begin at the start of an edge. Write the minutes in cut since the start "
        f"of each edge, or give --unit {role}=mm:ss if the cells are minutes and seconds, or --map {role}=none."
    )


def _open(times: _Times, role: str, column: Column) -> str:
    return (
        f"column {column.name!r}: {times.example} may be hours and minutes ({_span(times.minutes('h'))} min) or "
        f"minutes and seconds ({_span(times.minutes('min'))} min). Give --unit {role}=h:mm or --unit {role}=mm:ss."
    )
