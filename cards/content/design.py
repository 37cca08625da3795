"""The tests behind the laws as a part of a card: ranges of the factors, their middle, counts."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Protocol

from ...core.files import STANDARD_INPUT
from ...core.rounding import middle_of
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.origin import DesignSection, EdgeFacts, LeftOutRows
from .numbers import NONE, count, fact, figure, quantity
from .parts import DesignPart, DoubtPart, FactorRangePart, FactPart, NumberPart


class _Ranged(Protocol):
    @property
    def symbol(self) -> str: ...
    @property
    def quantity(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...


def design_part(design: DesignSection | None) -> DesignPart | None:
    """Factors, counts and how the file was read; None where the file does not describe its tests."""
    if design is None:
        return None
    return DesignPart(factors=factor_ranges(design.factors, design), facts=facts(design), understood=design.understood)


def doubts(pf: ParameterFile) -> tuple[DoubtPart, ...]:
    """Doubts about the data file, each with the command that reads it corrected."""
    held = () if pf.reading is None else pf.reading.doubts
    file = "-" if pf.provenance.data_file == STANDARD_INPUT else shlex.quote(pf.provenance.data_file or "FILE")
    return tuple(
        DoubtPart(
            columns=doubt.columns,
            sentence=doubt.sentence,
            remedy=doubt.remedy,
            command=f"fitmodels {file} {doubt.remedy}" if doubt.remedy else "",
        )
        for doubt in held
    )


def factor_ranges(factors: Sequence[_Ranged], design: DesignSection | None) -> tuple[FactorRangePart, ...]:
    """Range of each factor, with the levels of the tests inside it where they are few."""
    levels = {} if design is None else {f.symbol: f.levels for f in design.factors}
    return tuple(
        FactorRangePart(
            symbol=f.symbol,
            quantity=f.quantity,
            unit=f.unit,
            low=figure(f.low, 4, f.unit),
            high=figure(f.high, 4, f.unit),
            levels=tuple(figure(x, 6, f.unit) for x in levels.get(f.symbol, ()) if f.low <= x <= f.high),
        )
        for f in factors
    )


def facts(design: DesignSection) -> tuple[FactPart, ...]:
    """Counts of the tests by name."""
    criterion = design.criterion
    where = "" if criterion is None else f"{criterion.wear}{f', {criterion.source}' if criterion.source else ''}"
    worn = NONE if criterion is None else figure(criterion.value, 6, criterion.unit)
    return (
        *fact("plan", NONE, design.plan or ""),
        *fact("rows", count(design.rows)),
        *(_edges(design.edges) if design.edges else fact("edges", NONE, "no edge column")),
        *(item for level in design.levels for item in _level(f"{design.by} {level.level}", level.rows, level.edges)),
        *(fact("wear criterion", worn, where) if criterion is not None else ()),
        *(item for rows in design.left_out for item in _left_out(rows)),
    )


def _edges(e: EdgeFacts) -> tuple[FactPart, ...]:
    held = ", ".join(e.set_by_edge)
    names = ", ".join(e.short_edges) + (", ..." if e.short > len(e.short_edges) else "")
    short = f"fewer than half the median rows: {names}" if e.short else "none has fewer than half the median rows"
    return (
        *fact("edges", count(e.edges)),
        *fact("rows per edge, minimum", count(e.rows_least)),
        *fact("rows per edge, median", count(e.rows_median)),
        *fact("rows per edge, maximum", count(e.rows_most)),
        *(fact("settings", count(e.settings), f"of {held}, constant for each edge") if held else ()),
        *(fact("replicated settings", count(e.replicated), _replicates(e)) if held else ()),
        *fact("edges that ended early", count(e.short), short),
        *(fact("edges worn to the criterion", count(e.worn)) if e.worn is not None else ()),
    )


def _replicates(e: EdgeFacts) -> str:
    if not e.replicated:
        return "no setting was repeated on another edge"
    return f"tested with {e.replicated_edges} edges, which estimate the variance between edges"


def _level(name: str, rows: int, edges: int | None) -> tuple[FactPart, ...]:
    return fact(f"rows of {name}", count(rows), "" if edges is None else f"{edges} edge{'s' if edges != 1 else ''}")


def _left_out(rows: LeftOutRows) -> tuple[FactPart, ...]:
    lines = ", ".join(map(str, rows.lines)) + (", ..." if rows.count > len(rows.lines) else "")
    where = f" (line {lines})" if rows.lines else ""
    return fact(f"rows left out of {', '.join(rows.laws)}", count(rows.count), f"{rows.reason}{where}")


def span(low: NumberPart, high: NumberPart) -> str:
    """``50 to 200 m/min``."""
    return f"{low.text} to {quantity(high)}"


def middle(law: LawSection) -> dict[str, float]:
    """Middle of each factor's range: geometric where the law takes logarithms of it.

    >>> from fitmodels.parameters.sections.law import EXAMPLE
    >>> middle(LawSection.model_validate(EXAMPLE))
    {'V': 100.0}
    """
    return {f.symbol: middle_of(f.low, f.high, logs=log) for f, log in zip(law.factors, law.formula.logs, strict=True)}


def at_words(law: LawSection, at: Mapping[str, float], by: str | None = None, digits: int = 6) -> str:
    """``V 100 m/min, f 0.19 mm/rev``."""
    parts = [f"{f.symbol} {quantity(figure(at[f.symbol], digits, f.unit))}" for f in law.factors if f.symbol in at]
    return ", ".join([*parts, *([f"{law.by.column} {by}"] if law.by is not None and by is not None else [])])


def reference(law: LawSection) -> str | None:
    """The level at which a law with levels is shown."""
    return None if law.by is None else law.by.reference
