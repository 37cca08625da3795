"""Presentation of results as one line, as plain text and in a notebook, all three from one `Display`.

A result class inherits `Displayable` and is decorated with ``@dataclass(..., repr=False)``; the dataclass's own
``repr`` would print every array. Without more it shows its fields. What is shown of it, and its figure, are
registered from outside in the modules ``display`` and ``figures`` of its package, so that a result imports
neither::

    @display_of.register
    def _(law: LawFit) -> Display: ...

    @plot.register
    def _(law: LawFit, ax: Axes | None = None) -> Axes: ...

    @figures_of.register  # where there are several kinds of figure
    def _(law: LawFit) -> Mapping[str, Drawing]: ...

These modules are imported when the first result of their package is shown or drawn.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache, singledispatch
from html import escape
from importlib import import_module
from importlib.util import find_spec
from inspect import signature
from itertools import zip_longest
from re import fullmatch, sub
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any

from .errors import UsageError
from .rounding import format_plain, format_rounded
from .suggestions import did_you_mean
from .text import printable

if TYPE_CHECKING:
    from typing import TypeAlias

    from pandas import DataFrame

    Frame: TypeAlias = DataFrame  # for packages that use pandas nowhere else

WIDTH, LINES = 110, 4  # of a repr
SENTENCE = 26  # letters of a cell beyond which it is aligned as text, not as a number
LONG = 90  # letters of a fact beyond which it is left out
FEW = 8  # names or numbers that are listed one by one; of more, their count
SENTENCES = ("verdict", "words", "argument", "reason", "sentence")  # fields and properties that hold a sentence

CELL = "padding: 0.15em 0.7em; text-align: {}; border: none; background: none"
RULE = "; border-bottom: 1px solid"  # without a colour: the text's own, on light and on dark pages


@dataclass(frozen=True, slots=True)
class TextTable:
    """A small table of text: a header, and rows as long as it; the first column names the row."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    tones: tuple[str, ...] = ()  # colour of the last cell of each row in a notebook, "" for that of the text

    def text(self) -> str:
        """Rows in columns: names and sentences to the left, numbers to the right."""
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
        """An HTML table without colours but those of its last column."""
        left = [self._left(j) for j in range(len(self.header))]
        head = "".join(_cell("th", *of, RULE) for of in zip(self.header, left, strict=True)) if any(self.header) else ""
        body = (
            "".join(_cell("td", *of) for of in zip(row[:-1], left, strict=False))
            + _cell("td", row[-1], left[-1] or bool(tone), f"; color: {tone}" if tone else "")
            for row, tone in zip_longest(self.rows, self.tones[: len(self.rows)])
        )
        rows = "".join(f"<tr>{row}</tr>" for row in (head, *body) if row)
        return f'<table style="border-collapse: collapse; margin: 0.4em 0">{rows}</table>'


@dataclass(frozen=True, slots=True)
class Display:
    """Display of a result: ``head`` with its main numbers and units, then tables, facts and sentences."""

    head: str
    facts: tuple[tuple[str, str], ...] = ()
    table: TextTable | None = None
    sentences: tuple[str, ...] = ()
    checks: TextTable | None = None

    @property
    def tables(self) -> tuple[TextTable, ...]:
        """Table, facts and checks, those that there are."""
        facts = TextTable(("", ""), self.facts) if self.facts else None
        return tuple(table for table in (self.table, facts, self.checks) if table is not None)


def by_fields(result: object) -> Display:
    """The sentence of a result or its first facts, then all its facts and notes."""
    facts = tuple(facts_of(result))
    sentence = next((text for name in SENTENCES if (text := _sentence(result, name))), "")
    notes = tuple(str(note) for note in getattr(result, "notes", ()) or ())
    return Display(sentence or joined_facts(facts) or "no fields", facts, sentences=notes)


@singledispatch
def display_of(result: object) -> Display:
    """Display of a result; registered per class, `by_fields` otherwise."""
    return by_fields(result)


@singledispatch
def plot(result: object, ax: Any = None, **options: Any) -> Any:  # noqa: ANN401
    """Draw a result on ``ax`` or on axes of its own, which are returned; registered per class.

    Raises
    ------
    TypeError
        No figure is registered for the class.
    """
    raise TypeError(f"{type(result).__name__} has no figure; see summary().")


Drawing = Callable[..., Any]  # (result, ax or None, **options) -> Axes, or an array of them


@singledispatch
def figures_of(result: object) -> Mapping[str, Drawing]:
    """Figures of a result by kind, the default first; registered per class where there are several."""
    return {}


def drawing_of(result: object, kind: str | None, options: Iterable[str] = ()) -> Drawing:
    """The function that draws a kind of figure of a result, by default the first kind.

    Raises
    ------
    UsageError
        There is no such kind, or the figure does not have one of the ``options``.
    """
    kinds, name = figures_of(result), _spaced(type(result).__name__)
    if kind is not None and kind not in kinds:
        others = did_you_mean(kind, kinds, names="There are ") if kinds else "It has one figure: omit the kind."
        raise UsageError(f"{name}: no figure of kind {kind!r}. {others}")
    function = kinds[kind or next(iter(kinds))] if kinds else plot.dispatch(type(result))
    known = [*signature(function).parameters][1:]
    for option in options:
        if option not in known and "options" not in known:
            others = did_you_mean(option, known, names="Its options are ")
            raise UsageError(f"{name}: no option {option!r} of {f'the figure {kind!r}' if kind else 'plot'}. {others}")
    return function


def draw_figure(result: object, kind: str | None = None, ax: Any = None, **options: Any) -> Any:  # noqa: ANN401
    """Draw a figure of a result on ``ax`` or on a figure that pyplot does not know; the axes are returned.

    Raises
    ------
    UsageError
        No such kind or option, or ``ax`` is no Axes.
    """
    from .plotting import checked_axes, with_plain_texts

    _load("figures", type(result).__module__)
    drawn = drawing_of(result, kind, options)(result, checked_axes(ax), **options)
    return drawn if ax is not None else with_plain_texts(drawn)


class HasRepr:
    """Base of what has a one-line ``repr`` and a notebook view from its `Display`."""

    __slots__ = ()

    def _display(self) -> Display:
        _load("display", type(self).__module__)
        return display_of(self)

    def __repr__(self) -> str:
        return printable("\n".join(wrap(f"{type(self).__name__}: {self._display().head}", WIDTH, max_lines=LINES)))

    def _repr_html_(self) -> str:
        shown = self._display()
        parts = [f"<p><strong>{escape(_spaced(type(self).__name__))}</strong>: {escape(shown.head)}</p>"]
        parts += [table.html() for table in shown.tables]
        parts += [f"<p>{escape(sentence)}</p>" for sentence in shown.sentences]
        return printable(f"<div>{''.join(parts)}</div>")


class Displayable(HasRepr):
    """Base of results: ``repr``, notebook view, ``summary()``.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, slots=True, repr=False)
    ... class Stop(Displayable):
    ...     minutes: float
    ...     worn: bool
    >>> Stop(12.34567, True)
    Stop: minutes 12.35, worn yes
    """

    __slots__ = ()

    def summary(self) -> str:
        """The result as plain text."""
        shown = self._display()
        lines = (f"{_spaced(type(self).__name__)}: {shown.head}", *shown.sentences)
        head, *sentences = (fill(text, WIDTH) for text in lines)
        return printable("\n".join([head, *(table.text() for table in shown.tables), *sentences]))


class Plottable(Displayable):
    """Base of results with a figure, registered with `plot`."""

    __slots__ = ()

    def plot(self, kind: Any = None, ax: Any = None, **options: Any) -> Any:  # noqa: ANN401
        """Draw a figure of the result; its axes are returned.

        Parameters
        ----------
        kind : str, optional
            Which figure, where the result has several. ``plot(ax)`` is accepted as ``plot(ax=ax)``.
        ax : Axes, optional
            Axes to draw on. Without them the figure is new and known to pyplot, as is one of ``plt.figure``: a notebook
            shows it once, ``plt.show()`` shows it, ``plt.savefig`` writes it, ``plt.close()`` closes it.
        **options
            Of this kind of figure.

        Raises
        ------
        UsageError
            No such kind or option, or ``ax`` is no Axes; the message names those that exist.
        """
        from .plotting import to_pyplot

        if ax is None and kind is not None and not isinstance(kind, str):
            kind, ax = None, kind
        drawn = draw_figure(self, kind, ax, **options)
        return to_pyplot(drawn) if ax is None else drawn


@lru_cache(maxsize=256)
def _load(kind: str, module: str) -> None:
    """Import the modules ``kind`` of the packages that hold a result; they register its classes."""
    *packages, _ = module.split(".")
    for depth in range(2, len(packages) + 1):
        name = ".".join([*packages[:depth], kind])
        if packages[0] == __name__.partition(".")[0] and find_spec(name) is not None:
            import_module(name)


def facts_of(result: object) -> Iterator[tuple[str, str]]:
    """Names and values of the public fields that fit in a few words; longer ones are left out."""
    for name, value in _public(result):
        text = format_value(value)
        if text and len(text) <= LONG and name not in (*SENTENCES, "notes"):
            yield name.replace("_", " "), text


def as_columns(result: object, *names: str, **more: object) -> "DataFrame":
    """Fields of one length as the columns of a DataFrame."""
    from pandas import DataFrame

    return DataFrame({**{name: getattr(result, name) for name in names}, **more})


def joined_facts(facts: Iterable[tuple[str, str]]) -> str:
    """Facts one after the other.

    >>> joined_facts([("V", "250 m/min"), ("f", "0.2 mm/rev")])
    'V 250 m/min, f 0.2 mm/rev'
    """
    return ", ".join(f"{name} {value}" for name, value in facts)


def format_value(value: object) -> str:
    """A value in a few words; empty where it has none.

    >>> format_value((1.0, 2.5)), format_value({"V": 0.57712}), format_value([0.5] * 40), format_value(None)
    ('1, 2.5', 'V 0.5771', '40 values, 0.5 to 0.5', '')
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return f"{value[:12]}..." if fullmatch("[0-9a-f]{64}", value) else value
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return format_plain(value)
    if isinstance(value, HasRepr):
        return value._display().head
    if isinstance(value, Mapping):
        return _mapping(value)
    return _many(value)


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
) -> TextTable:
    """Estimates as a table: each with its standard error, and its interval where ``low`` and ``high`` are given.

    >>> print(estimates(["V", "f"], [0.577123, 0.33], [0.0213, 0.1], [0.53, 0.1], [0.62, 0.56]).text())
       estimate     se  95 % low   high
    V     0.577  0.021     0.530  0.620
    f      0.33   0.10      0.10   0.56
    """
    rows = []
    for j, (name, value, error) in enumerate(zip(names, values, errors, strict=True)):
        error = None if error is None else float(error)
        limits = (low[j], high[j]) if len(low) else ()
        ends = [format_rounded(end, error)[0] if _known(end) else "" for end in limits]
        extra = [texts[j] for texts in (more or {}).values()]
        rows.append((name, *format_rounded(float(value), error), *ends, *([units[j]] if units else []), *extra))
    interval = [] if not len(low) else [f"{100 * level:g} % low", "high"]
    return TextTable(("", "estimate", "se", *interval, *(["unit"] if units else []), *(more or {})), tuple(rows))


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
    """The text of a field or property of this name; empty where it is not text."""
    own = getattr(type(result), name, None)
    if own is None and name not in dict(_public(result)):
        return ""
    value = getattr(result, name)
    return value if isinstance(value, str) else ""


def _mapping(value: Mapping[Any, Any]) -> str:
    if len(value) > FEW:
        return f"{len(value)} items"
    return joined_facts((str(key), text) for key, item in value.items() if (text := format_value(item)))


def _many(value: object) -> str:
    """Several values: one by one where they are few, else their count; of an array also its range."""
    shape = getattr(value, "shape", None)
    if shape == ():
        return format_value(value.item())  # type: ignore[attr-defined]
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
        if len(numbers) < len(items):
            return "; ".join(map(format_value, items))
        return ", ".join(format_plain(float(item)) for item in items)
    if len(numbers) == len(items):
        return f"{len(items)} values, {format_plain(float(min(items)))} to {format_plain(float(max(items)))}"
    return f"{len(items)} items"


def _spaced(name: str) -> str:
    """``FrequencyResponse`` as it is read: ``Frequency response``."""
    words = sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return words[0] + words[1:].lower()


def _cell(kind: str, text: str, left: bool, rule: str = "") -> str:
    style = CELL.format("left" if left else "right") + rule
    return f'<{kind} style="{style}">{escape(text)}</{kind}>'
