"""How a result presents itself: on a line, as plain text and in a notebook, all three from one `Telling`.

A class inherits `Told` and is decorated with ``@dataclass(..., repr=False)``, or its own ``repr`` would dump every
array. Without more it tells its verdict and its fields; a `_telling` of its own chooses what matters.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from re import fullmatch, sub
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any

from .rounding import plain, told

if TYPE_CHECKING:
    from typing import TypeAlias

    from pandas import DataFrame

    Frame: TypeAlias = DataFrame  # for rooms that use pandas nowhere else

WIDTH, LINES = 110, 4  # of a repr
SENTENCE = 26  # letters of a cell beyond which it is read as a sentence, not as a number
LONG = 90  # letters: a fact beyond them is no fact but a result of its own
FEW = 8  # names or numbers that are told one by one; of more, how many there are
SENTENCES = ("verdict", "words", "argument", "reason", "sentence")  # under which results already speak

CELL = "padding: 0.15em 0.7em; text-align: {}; border: none; background: none"
RULE = "; border-bottom: 1px solid"  # without a colour: the text's own, on light and on dark pages


@dataclass(frozen=True, slots=True)
class Grid:
    """A small table of text: a header, and rows as long as it; the first column names the row."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def text(self) -> str:
        """In columns: names and sentences to the left, numbers to the right."""
        lines = (self.header, *self.rows) if any(self.header) else self.rows
        wide = [max(len(line[j]) for line in lines) for j in range(len(self.header))]
        return "\n".join(
            "  ".join(
                cell.ljust(w) if self._left(j) else cell.rjust(w)
                for j, (cell, w) in enumerate(zip(line, wide, strict=True))
            ).rstrip()
            for line in lines
        )

    def _left(self, column: int) -> bool:
        return column == 0 or any(len(row[column]) > SENTENCE for row in self.rows)

    def html(self) -> str:
        """As a table without colours of its own."""
        left = [self._left(j) for j in range(len(self.header))]
        head = "".join(_cell("th", *of, RULE) for of in zip(self.header, left, strict=True)) if any(self.header) else ""
        body = ("".join(_cell("td", *of) for of in zip(row, left, strict=True)) for row in self.rows)
        rows = "".join(f"<tr>{row}</tr>" for row in (head, *body) if row)
        return f'<table style="border-collapse: collapse; margin: 0.4em 0">{rows}</table>'


@dataclass(frozen=True, slots=True)
class Telling:
    """What a result says of itself: ``head`` with its main numbers and units, then what stands under it."""

    head: str
    facts: tuple[tuple[str, str], ...] = ()
    grid: Grid | None = None
    words: tuple[str, ...] = ()


class Displayed:
    """What shows itself on a line and in a notebook, from its `_telling`."""

    __slots__ = ()

    def _telling(self) -> Telling:
        return by_fields(self)

    def __repr__(self) -> str:
        return "\n".join(wrap(f"{type(self).__name__}: {self._telling().head}", WIDTH, max_lines=LINES) or [""])

    def _repr_html_(self) -> str:
        told = self._telling()
        parts = [f"<p><strong>{escape(_spaced(type(self).__name__))}</strong>: {escape(told.head)}</p>"]
        if told.grid is not None:
            parts.append(told.grid.html())
        if told.facts:
            parts.append(Grid(("", ""), told.facts).html())
        parts += [f"<p>{escape(sentence)}</p>" for sentence in told.words]
        return f"<div>{''.join(parts)}</div>"


class Told(Displayed):
    """Results that say what they are.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, slots=True, repr=False)
    ... class Stop(Told):
    ...     minutes: float
    ...     worn: bool
    >>> Stop(12.34567, True)
    Stop: minutes 12.35, worn yes
    """

    __slots__ = ()

    def summary(self) -> str:
        """What is told of it, as plain text."""
        told = self._telling()
        grid = [told.grid.text()] if told.grid is not None else []
        facts = [Grid(("", ""), told.facts).text()] if told.facts else []
        head, *words = (fill(text, WIDTH) for text in (f"{_spaced(type(self).__name__)}: {told.head}", *told.words))
        return "\n".join([head, *grid, *facts, *words])


def by_fields(result: object) -> Telling:
    """What can be told of any result: the sentence it has, or else its first facts; then facts and notes."""
    facts = tuple(facts_of(result))
    said = next((text for name in SENTENCES if (text := _sentence(result, name))), "")
    notes = tuple(str(note) for note in getattr(result, "notes", ()) or ())
    return Telling(said or in_line(facts) or "nothing to tell", facts, words=notes)


def facts_of(result: object) -> Iterator[tuple[str, str]]:
    """Names and values of the public fields that can be told in a few words; longer ones are left to themselves."""
    for name, value in _public(result):
        text = worded(value)
        if text and len(text) <= LONG and name not in (*SENTENCES, "notes"):
            yield name.replace("_", " "), text


def as_columns(result: object, *names: str, **more: object) -> "DataFrame":
    """Fields of one length as the columns of a frame, what a sheet or a plot elsewhere wants."""
    from pandas import DataFrame

    return DataFrame({**{name: getattr(result, name) for name in names}, **more})


def in_line(facts: Iterable[tuple[str, str]]) -> str:
    """Facts one after the other.

    >>> in_line([("V", "250 m/min"), ("f", "0.2 mm/rev")])
    'V 250 m/min, f 0.2 mm/rev'
    """
    return ", ".join(f"{name} {value}" for name, value in facts)


def worded(value: object) -> str:
    """A value in a few words; empty where it has none to tell.

    >>> worded((1.0, 2.5)), worded({"V": 0.57712}), worded([0.5] * 40), worded(None)
    ('1, 2.5', 'V 0.5771', '40 values, 0.5 to 0.5', '')
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return f"{value[:12]}..." if fullmatch("[0-9a-f]{64}", value) else value
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return plain(value)
    if isinstance(value, Displayed):
        return value._telling().head
    if isinstance(value, Mapping):
        return _mapping(value)
    return _many(value)


def measured(value: float, error: float | None, unit: str = "") -> str:
    """A value with its standard error, rounded by it, and its unit.

    >>> measured(0.577123, 0.0213), measured(95.1089, 0.0213, "kg"), measured(2.0, None, "A")
    ('0.577 ± 0.021', '95.109 ± 0.021 kg', '2 A')
    """
    number, plus = told(value, error)
    return " ".join(filter(None, (f"{number} ± {plus}" if plus else number, unit)))


def estimates(
    names: Sequence[str],
    values: Iterable[float],
    errors: Iterable[float | None],
    low: Sequence[float] = (),
    high: Sequence[float] = (),
    *,
    units: Sequence[str] | None = None,
    more: Mapping[str, Sequence[str]] | None = None,
    level: float = 0.95,
) -> Grid:
    """Estimates as a grid: each with its standard error, and its interval where ``low`` and ``high`` are given.

    >>> print(estimates(["V", "f"], [0.577123, 0.33], [0.0213, 0.1], [0.53, 0.1], [0.62, 0.56]).text())
       estimate     se  95 % low   high
    V     0.577  0.021     0.530  0.620
    f      0.33   0.10      0.10   0.56
    """
    rows = []
    for j, (name, value, error) in enumerate(zip(names, values, errors, strict=True)):
        error = None if error is None else float(error)
        ends = [] if not len(low) else [told(end, error)[0] if _known(end) else "" for end in (low[j], high[j])]
        extra = [texts[j] for texts in (more or {}).values()]
        rows.append((name, *told(float(value), error), *ends, *([units[j]] if units else []), *extra))
    ends_named = [] if not len(low) else [f"{100 * level:g} % low", "high"]
    return Grid(("", "estimate", "se", *ends_named, *(["unit"] if units else []), *(more or {})), tuple(rows))


def with_unit(symbol: str, unit: str) -> str:
    """A symbol with its unit in brackets, where it has one."""
    return f"{symbol} [{unit}]" if unit else symbol


def _known(value: float | None) -> bool:
    return value is not None and value == value and abs(value) != float("inf")


def _public(result: object) -> Iterator[tuple[str, object]]:
    """Fields of a dataclass or of a pydantic model, private ones left out."""
    if is_dataclass(result):
        names: Iterable[str] = [field.name for field in fields(result)]
    else:
        names = [*getattr(type(result), "model_fields", {}), *(getattr(result, "model_extra", None) or {})]
    for name in names:
        if not name.startswith("_"):
            yield name, getattr(result, name)


def _sentence(result: object, name: str) -> str:
    """What a field or property of this name says; empty where it is not text."""
    own = getattr(type(result), name, None)
    if own is None and name not in dict(_public(result)):
        return ""
    value = getattr(result, name)
    return value if isinstance(value, str) else ""


def _mapping(value: Mapping[Any, Any]) -> str:
    if len(value) > FEW:
        return f"{len(value)} of them"
    return in_line((str(key), text) for key, item in value.items() if (text := worded(item)))


def _many(value: object) -> str:
    """Several values: one by one where they are few, else how many; of an array also from where to where."""
    shape = getattr(value, "shape", None)
    if shape == ():
        return worded(value.item())  # type: ignore[attr-defined]
    if shape is not None and len(shape) > 1:
        return f"{' by '.join(map(str, shape))} values"
    if isinstance(value, Sequence) or shape is not None:
        return _row(list(value))  # type: ignore[call-overload]
    return ""


def _row(items: list[Any]) -> str:
    if not items:
        return ""
    if isinstance(items[0], complex):
        return ", ".join(f"{item:.4g}" for item in items) if len(items) <= FEW else f"{len(items)} values"
    numbers = [item for item in items if isinstance(item, float | int) or getattr(item, "shape", None) == ()]
    if len(items) <= FEW:
        return "; ".join(map(worded, items)) if len(numbers) < len(items) else ", ".join(plain(float(v)) for v in items)
    if len(numbers) == len(items):
        return f"{len(items)} values, {plain(float(min(items)))} to {plain(float(max(items)))}"
    return f"{len(items)} of them"


def _spaced(name: str) -> str:
    """``FrequencyResponse`` as it is read: ``Frequency response``."""
    words = sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return words[0] + words[1:].lower()


def _cell(kind: str, text: str, left: bool, rule: str = "") -> str:
    style = CELL.format("left" if left else "right") + rule
    return f'<{kind} style="{style}">{escape(text)}</{kind}>'
