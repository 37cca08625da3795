"""Tables of a card as text, the same in the terminal and in Markdown."""

from collections.abc import Mapping, Sequence

from ...core.display import TextTable
from ...core.verdict import MARKS
from ...fit.checks.check import check_table as table_of_checks
from .numbers import between, quantity
from .parts import (
    CheckPart,
    CoefficientPart,
    FactorRangePart,
    FactPart,
    LawPart,
    PosteriorPart,
)
from .tool_life import PlanPart
from .uncertainty import BudgetLinePart, UncertaintyPart


def coefficient_table(lines: Sequence[CoefficientPart], law: LawPart | None = None) -> TextTable:
    """Coefficients with standard errors and intervals; of a law also other error structure and published values."""
    some = law is not None and any(c.se.text for c in lines)
    ends = ["fixed" if some and not c.se.text else between(c.low, c.high) for c in lines]
    texts = {field: [getattr(c, field).text for c in lines] for field in ("estimate", "se", "t", "p", "row_se")}
    return _table({
        "coefficient": [c.name for c in lines],
        "estimate": texts["estimate"],
        "without the suspects": [c.without.text for c in lines],
        "SE": texts["se"],
        "t": texts["t"],
        "p": texts["p"],
        f"{law.level.text if law else 95} % interval": ends,
        "SE, rows independent": texts["row_se"],
        law.other_heading if law else "": [c.other.text for c in lines],
        "published value": [c.printed.text for c in lines],
    })  # fmt: skip


def check_table(checks: Sequence[CheckPart]) -> TextTable:
    """Checks of a law: statistic, p value, verdict, as in a notebook."""
    statistics = (f"{c.statistic_name} = {c.statistic.text}" if c.statistic.text else "" for c in checks)
    lines = ((c.name, said, c.p.text, c.verdict) for c, said in zip(checks, statistics, strict=True))
    return table_of_checks(lines)


def holds_words(table: TextTable, column: int) -> bool:
    """Whether a column is aligned left: the first, and those with a cell that begins with a letter or an icon."""
    icons = tuple(mark.icon for mark in MARKS.values())
    cells = (row[column] for row in table.rows)
    return column == 0 or any(cell[:1].isalpha() or cell.startswith(icons) for cell in cells)


def plan_table(plan: PlanPart) -> TextTable:
    """Rows of a plan of an edge's life."""
    unit = plan.rows[0].wear.unit if plan.rows else ""
    return _table({
        "until min": [row.end.text for row in plan.rows],
        "V m/min": [row.V.text for row in plan.rows],
        "f mm/rev": [row.f.text for row in plan.rows],
        f"{plan.wear} {unit}": [row.wear.text for row in plan.rows],
        "removal cm3/min": [row.rate.text for row in plan.rows],
        "limited by": [row.limits for row in plan.rows],
        "tests": ["" if row.tested else "EXTRAPOLATED" for row in plan.rows],
    })  # fmt: skip


def posterior_table(of: PosteriorPart) -> TextTable:
    """Marginal posterior of each parameter, its prior, and its prior sensitivity."""
    return _table({
        "parameter": [p.name for p in of.parameters],
        "median": [p.median.text for p in of.parameters],
        "SD": [p.sd.text for p in of.parameters],
        f"{of.level.text} % credible interval": [between(p.low, p.high) for p in of.parameters],
        "prior": [p.prior for p in of.parameters],
        "prior sensitivity (half, double width)": [p.moved for p in of.parameters],
    })  # fmt: skip


def uncertainty_table(statements: Sequence[UncertaintyPart]) -> TextTable:
    """Value, u, U, k and interval of each statement."""
    headings = ("quantity", "of", "value", "u", "U", "k", "df", "level", "interval")
    return _table_of_rows(headings, [
        (s.symbol, s.of, quantity(s.value), s.standard.text, s.expanded.text, s.k.text, s.df.text, quantity(s.level),
         between(s.low, s.high))
        for s in statements
    ])  # fmt: skip


def budget_table(lines: Sequence[BudgetLinePart]) -> TextTable:
    """Contributions to the uncertainty of one prediction."""
    unit = next((line.contribution.unit for line in lines if line.contribution.unit), "")
    contribution = f"contribution, {unit}".rstrip(", ")
    return _table_of_rows(("source", "type", "u", "sensitivity", contribution, "share", "df"), [
        (line.name, line.evaluation, quantity(line.standard), line.sensitivity.text, line.contribution.text,
         quantity(line.share), line.df.text)
        for line in lines
    ])  # fmt: skip


def factor_table(factors: Sequence[FactorRangePart]) -> TextTable:
    """Factors of the tests with their ranges and levels."""
    return _table_of_rows(("factor", "quantity", "unit", "minimum", "maximum", "levels"), [
        (f.symbol, f.quantity, f.unit, f.low.text, f.high.text, ", ".join(n.text for n in f.levels) or "many")
        for f in factors
    ])  # fmt: skip


def fact_table(facts: Sequence[FactPart], heading: str) -> TextTable:
    """Facts: name, value with unit, explanation."""
    return _table({
        heading: [item.name for item in facts],
        "value": [quantity(item.number) for item in facts],
        "explanation": [item.words for item in facts],
    })  # fmt: skip


def _table_of_rows(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> TextTable:
    """The columns that are not empty, of a table by rows."""
    return _table({heading: [row[place] for row in rows] for place, heading in enumerate(headings)})


def _table(columns: Mapping[str, Sequence[str]]) -> TextTable:
    """The columns that are not empty."""
    kept = {name: cells for name, cells in columns.items() if any(cells)}
    return TextTable(tuple(kept), tuple(zip(*kept.values(), strict=True)))
