"""Time, input and output of a record among the columns of a table, and their units."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...core.errors import DataError, UsageError
from ...core.rounding import count
from ...core.suggestions import closest
from ..headers import parse_header
from ..tables import Column
from ..units import canonical, convert, same_dimension
from ..vocabulary import ROLES, role_of, roles_named

SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
LABELS = frozenset({"stretch", "segment", "record", "section", "abschnitt", "messung", "tramo", "tronçon"})
_TIME = re.compile(
    r"(elapsed|relative|date|datum|fecha)?\W*(time|zeit|uhrzeit|temps|tiempo|heure|hora|x_?values?)\W*(stamp|stempel)?"
)
_INPUT = re.compile(r"u|in|input|cmd|command(ed)?|excitation|eingang|commande|entrée|entrada", re.IGNORECASE)
_OUTPUT = re.compile(r"y|out|output|response|measured|ausgang|antwort|réponse|sortie|respuesta|salida", re.IGNORECASE)
# What a unit is brought to; a unit of another dimension, or one that is not listed, stays as it is written.
_KEPT = ("mm", "mm/s", "N", "A", "V", "Nm", "kW", "1/min", "MPa", "Hz", "s")


@dataclass(frozen=True, slots=True)
class ColumnHeader:
    """A column with its header split into name, unit as written, and role of the vocabulary or None."""

    column: Column
    name: str
    unit: str
    role: str | None

    @property
    def label(self) -> str:
        """Number and header, for messages."""
        named = self.column.name != f"col{self.column.number}"
        return f"{self.column.number} {self.column.name!r}" if named else self.column.name


def heads(columns: Sequence[Column]) -> tuple[ColumnHeader, ...]:
    """The columns with their headers split."""
    out = []
    for column in columns:
        header = parse_header(column.name)
        unit = column.unit_cell or header.unit_text
        known = canonical(unit) if unit else None
        out.append(ColumnHeader(column, header.name, unit.strip(" []()"), role_of(header.name, known)))
    return tuple(out)


def find(known: Sequence[ColumnHeader], wanted: str | int, option: str) -> ColumnHeader:
    """The column of this header, name without unit, number (``3``, ``col3``) or role; what counts first comes first.

    Raises
    ------
    UsageError
        There is none, or more than one.
    """
    text = str(wanted).strip()
    tests = (
        lambda h: h.column.name == text,
        lambda h: h.name == text,
        lambda h: text.removeprefix("col") == str(h.column.number),
        lambda h: h.role == text,
        lambda h: h.name.casefold() == text.casefold(),
    )
    for test in tests:
        found = [head for head in known if test(head)]
        if len(found) == 1:
            return found[0]
        if found:
            places = " or ".join(f"col{head.column.number}" for head in found)
            raise UsageError(f"--{option} {text}: {len(found)} columns match. Give {places}.")
    near = closest(text, [h.name for h in known])
    meant = next((h.column.name for h in known if h.name == near), None)
    hint = f"did you mean {meant!r}?" if meant else f"there are {', '.join(head.label for head in known)}."
    raise UsageError(f"--{option} {text}: the file has no such column; {hint}")


def seconds_in(unit: str) -> float | None:
    """Seconds in a unit of time, None when it is none.

    >>> seconds_in("Sekunden"), seconds_in("µs"), seconds_in("mm")
    (1.0, 1e-06, None)
    """
    plain = unicodedata.normalize("NFKC", unit).replace("μ", "u").strip(" []()")
    return SECONDS.get(canonical(unit) or plain, SECONDS.get(plain))


def is_time(head: ColumnHeader) -> bool:
    """Whether a header denotes a time: by its name (unit of time or none), or by such a unit and no other role."""
    named = "t" in roles_named(head.name) or bool(_TIME.fullmatch(head.name.casefold()))
    if not head.unit:
        return named
    return seconds_in(head.unit) is not None and (named or head.role is None)


def is_label(head: ColumnHeader) -> bool:
    """Whether a column names the run or stretch of each row."""
    return head.role == "run" or head.name.casefold() in LABELS


def rises_evenly(values: Array) -> bool:
    """Whether a column only rises, nine steps of ten by the same amount within 1 %."""
    if len(values) < 4 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    middle = float(np.median(steps))
    return bool(steps.min() > 0 and np.mean(np.abs(steps - middle) <= 0.01 * middle) >= 0.9)


def is_counter(head: ColumnHeader) -> bool:
    """Whether a column counts rows: whole numbers, each one more than the last, and no time by its header."""
    if not head.column.is_numeric or is_time(head):
        return False
    values = head.column.values
    return bool(len(values) > 1 and (np.diff(values) == 1).all() and float(values[0]).is_integer())


def time_column(known: Sequence[ColumnHeader]) -> ColumnHeader | None:
    """The column of times: by its header, otherwise the only one that rises evenly; None when there is none.

    Raises
    ------
    UsageError
        Several columns may be it.
    """
    named = [h for h in known if is_time(h) and not is_label(h)]
    if len(named) > 1:
        named = [h for h in named if not h.column.is_numeric or np.nanmedian(np.diff(h.column.values)) > 0] or named
    found = named or [
        h
        for h in known
        if h.column.is_numeric
        and not (h.role or h.unit or is_counter(h) or is_label(h))
        and rises_evenly(h.column.values)
    ]
    if len(found) > 1:
        raise UsageError(f"columns {' and '.join(h.label for h in found)} may both be the time: give one with --time.")
    return found[0] if found else None


def times(head: ColumnHeader) -> tuple[Array, float | None]:
    """Values of a time column, and seconds in its unit (None when it names none).

    Raises
    ------
    DataError
        The column contains text that is not a time of day.
    """
    if not head.column.is_numeric:
        clock = clock_seconds(list(head.column.values))
        if clock is None:
            shown = next((v for v in head.column.values if v), "")
            raise DataError(
                f"column {head.label} contains text, for instance {shown!r}, instead of times: write seconds, or times "
                "of day as 12:30:00.020."
            )
        return clock, 1.0
    only_numbers(head)
    if not head.unit:
        return head.column.values, None
    scale = seconds_in(head.unit)
    if scale is None:
        raise UsageError(
            f"column {head.label}: {head.unit!r} is not a unit of time. Give --unit time=s (or ms, us, min)."
        )
    return head.column.values, scale


def signals(known: Sequence[ColumnHeader], time: ColumnHeader | None) -> tuple[ColumnHeader, ...]:
    """Columns that may be input or output: numbers that are neither time, label nor row count."""
    return tuple(
        h
        for h in known
        if h.column.is_numeric
        and (time is None or h.column.number != time.column.number)
        and not (is_label(h) or is_time(h) or is_counter(h) or np.isnan(h.column.values).all())
    )


def choose(
    known: Sequence[ColumnHeader],
    time: ColumnHeader | None,
    input: str | int | None,  # noqa: A002
    output: str | int | None,
) -> tuple[ColumnHeader, ColumnHeader, tuple[str, ...]]:
    """Input, output, and the assumption made: of two signals the first is the input, unless their names say otherwise.

    Raises
    ------
    UsageError
        They are not named, and there are not just two signals; or both names mean one column.
    """
    u = find(known, input, "input") if input is not None else None
    y = find(known, output, "output") if output is not None else None
    if u is not None and y is not None:
        if u.column.number == y.column.number:
            raise UsageError(f"--input and --output both mean column {u.label}: a record needs two columns.")
        return u, y, ()
    candidates = signals(known, time)
    if u is None and y is None:
        if len(candidates) == 2:
            u, y = candidates
            if _INPUT.fullmatch(y.name.strip()) or _OUTPUT.fullmatch(u.name.strip()):
                u, y = y, u
            is_named = _INPUT.fullmatch(u.name.strip()) or _OUTPUT.fullmatch(y.name.strip())
            how = "names" if is_named else "order"
            return u, y, (f"input {u.name} and output {y.name} are assumed from their {how}",)
        raise UsageError(_unnamed(candidates, "--input and --output"))
    chosen, option = (u, "--output") if u is not None else (y, "--input")
    rest = [h for h in candidates if chosen is not None and h.column.number != chosen.column.number]
    if len(rest) != 1:
        raise UsageError(_unnamed(rest, option))
    role = option.removeprefix("--")
    note = (f"{role} {rest[0].name} is assumed: the only other signal",)
    return (u, rest[0], note) if u is not None else (rest[0], chosen or rest[0], note)


def _unnamed(candidates: Sequence[ColumnHeader], options: str) -> str:
    if len(candidates) < 1 + (" and " in options):
        return (
            f"the file has {count(len(candidates), 'signal')} besides time, and a record needs an input and an output."
        )
    shown = ", ".join(h.label for h in candidates[:12]) + (", ..." if len(candidates) > 12 else "")
    number = candidates[0].column.number
    return (
        f"{len(candidates)} columns are possible: {shown}. Give {options}, by name or number, as --input col{number}."
    )


def only_numbers(head: ColumnHeader) -> None:
    """Refuse a column with text among its numbers.

    Raises
    ------
    DataError
        Lines and texts of the first such cells.
    """
    column = head.column
    if not column.is_numeric:
        shown = next((str(v) for v in column.values if v != ""), "")
        raise DataError(f"column {head.label} holds text, for instance {shown!r}, and no signal: name another column.")
    if column.bad:
        raise DataError(
            f"column {head.label} contains text instead of numbers: {column.bad_cells()}. Write a number, or leave "
            "the cell empty: it then counts as a gap."
        )


def in_unit(head: ColumnHeader, given: str | None) -> tuple[Array, str, tuple[str, ...]]:
    """Values, shape (n,), their unit, and a note on conversion; ``given`` overrides the header."""
    only_numbers(head)
    written = given if given is not None else head.unit
    unit = canonical(written) if written else None
    if unit is None or unit == "1":
        return head.column.values, written if unit is None else "", ()
    kept = ROLES[head.role].unit if head.role else ""
    for target in (kept, *_KEPT):
        if target and unit != target and same_dimension(unit, target):
            values = convert(np.asarray(head.column.values, dtype=np.float64), unit, target)
            return values, target, (f"{head.name}: {unit} is converted to {target}",)
        if unit == target:
            break
    return head.column.values, unit, ()


DAY = 86400.0
_CLOCK = re.compile(
    r"(?:(?P<date>\d[\d./ -]*\d)[T ,;]+)?(?:(?P<h>\d{1,2}):)?(?P<m>\d{1,2}):(?P<s>\d{1,2}(?:[.,]\d+)?)"
    r"(?:\s*(?P<half>[AP])\.?M\.?)?(?:Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)


def clock_seconds(texts: Sequence[str]) -> Array | None:
    """Seconds since the first midnight, shape (n,), nan where a text is empty; None when one is no time.

    A date counts only by its change, which is one day on: so 01.03. and 03/01 need not be distinguished. A fall of
    more than half a day is midnight.

    >>> clock_seconds(["23:59:59,5", "00:00:00,0"]), clock_seconds(["1.3.24 11:59:59.5 PM", "2.3.24 12:00:00 AM"])
    (array([86399.5, 86400. ]), array([86399.5, 86400. ]))
    """
    out = np.full(len(texts), np.nan)
    days, today, before = 0, None, -1.0
    for i, text in enumerate(texts):
        if not text.strip():
            continue
        match = _CLOCK.fullmatch(text.strip())
        if match is None:
            return None
        if match["date"] != today:
            days, today = days + (today is not None), match["date"]
        hours = int(match["h"] or 0)
        if match["half"]:
            hours = hours % 12 + (12 if match["half"] in "Pp" else 0)
        seconds = 3600 * hours + 60 * int(match["m"]) + float(match["s"].replace(",", "."))
        if match["date"] is None and seconds < before - DAY / 2:
            days += 1
        out[i], before = days * DAY + seconds, seconds
    return out
