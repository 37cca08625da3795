"""Rows of names and conditions that stand above the numbers of a wide table."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .headers import parse_header
from .notes import response_in
from .tables import Column, Table, is_number
from .tables.numerals import parse_number
from .vocabulary import ROLES, role_of

_LONGEST = 10_000  # rows of a wide table with a column for each edge
_TEXTS = 5  # of a column of numbers that may be such a row
_NAMES_ABOVE = 12  # rows of names and conditions above it


def with_header(table: Table) -> tuple[Table, tuple[Column, ...]]:
    """The table without the rows of names and conditions that its first rows hold, and a condition for each column.

    A header that holds times as numbers is no header to the reader of tables: it comes as the first row. Rows such as
    ``V [m/min], 100, 150, 200`` above a wide table hold a condition of each of its columns.
    """
    table = replace(table, columns=(as_numbers(table.columns[0], table), *table.columns[1:]))
    cells = [_leading_texts(column) for column in table.columns]
    if not table.dialect.has_header and table.n_rows > 1 and any(cells) and len(cells[0]) < 2:
        first = [texts.get(0, "") for texts in cells]
        if sum(bool(text) and role_of(parse_header(text).name, None) is not None for text in first) >= 1 and all(
            text or np.isfinite(column.values[0])
            for text, column in zip(first, table.columns, strict=True)
            if column.is_numeric
        ):
            names = [text or f"{column.values[0]:g}" for text, column in zip(first, table.columns, strict=True)]
            return _below(table, 1, names), ()
    return _with_conditions(table)


def _with_conditions(table: Table) -> tuple[Table, tuple[Column, ...]]:
    """Read rows of conditions above a wide table, named by the texts of its first column."""
    first, others = table.columns[0], table.columns[1:]
    lead = _leading_texts(first)
    rows = sorted(lead)
    if not first.is_numeric or not rows or rows != list(range(len(rows))) or len(rows) >= table.n_rows:
        return table, ()
    roles = [role_of(parse_header(lead[row]).name, None) for row in rows]
    known = [row for row, role in zip(rows, roles, strict=True) if role and ROLES[role].kind in ("condition", "other")]
    if not known or not all(roles):
        return table, ()
    conditions = tuple(
        Column(0, lead[row], "", np.array([column.values[row] for column in others], dtype=float), True)
        for row in known
        if all(column.is_numeric for column in others)
    )
    names = [column.name for column in table.columns]
    below = first.values[len(rows) :]
    if "t" not in roles and role_of(parse_header(names[0]).name, None) == "edge" and bool(np.all(np.diff(below) > 0)):
        names[0] = "t"  # the numbers below the conditions rise and have no name
    for row, role in zip(rows, roles, strict=True):
        texts = [_leading_texts(column).get(row, "") for column in others]
        if role == "edge" and any(texts):
            names[1:] = [text or name for text, name in zip(texts, names[1:], strict=True)]
        if role == "t":
            names[0] = lead[row]
            if len(set(texts)) == len(texts) and all(texts):
                names[1:] = texts
            elif len(set(texts)) == 1 and response_in(parse_header(texts[0]).name)[0]:
                names[1:] = [f"{texts[0]} {name}" for name in names[1:]]
    return _below(table, len(rows), names), conditions


def as_numbers(column: Column, table: Table) -> Column:
    """A column of a few names above numbers as a column of numbers; any other unchanged."""
    if column.is_numeric:
        return column
    texts = [str(value) for value in column.values[:_NAMES_ABOVE]]
    count = next((i for i, text in enumerate(texts) if is_number(text)), 0)
    if not count or not all(texts[:count]) or table.n_rows > _LONGEST:
        return column
    numbers = [parse_number(str(value), table.dialect.decimal) for value in column.values[count:]]
    if any(number is None for number in numbers):
        return column
    values = np.array([np.nan] * count + numbers, dtype=float)
    bad = tuple(zip(table.lines[:count].tolist(), texts[:count], strict=True))
    return replace(column, values=values, is_numeric=True, bad=bad, bad_count=count)


def _leading_texts(column: Column) -> dict[int, str]:
    """Texts of the first rows of a column, by row; of a numeric column its cells that are no numbers."""
    if not column.is_numeric:
        return {0: str(column.values[0])} if len(column.values) and column.values[0] else {}
    if not column.bad or column.bad_count > _TEXTS:
        return {}
    empty = np.flatnonzero(np.isnan(column.values))[: len(column.bad)].tolist()
    return dict(zip(empty, (text for _, text in column.bad), strict=False))


def _below(table: Table, count: int, names: Sequence[str]) -> Table:
    """The table without its first rows, under other names; texts of the removed rows are no bad cells."""
    above = int(table.lines[count - 1])
    columns = []
    for column, name in zip(table.columns, names, strict=True):
        bad = tuple(cell for cell in column.bad if cell[0] > above)
        marks = tuple((row - count, mark) for row, mark in column.marks if row >= count)
        columns.append(
            replace(column, name=name, values=column.values[count:], bad=bad, marks=marks,
                    bad_count=column.bad_count - len(column.bad) + len(bad))
        )  # fmt: skip
    dialect = replace(table.dialect, has_header=True)
    warnings = tuple(text for text in table.warnings if not text.startswith("There is no header row"))
    return replace(table, columns=tuple(columns), lines=table.lines[count:], dialect=dialect, warnings=warnings)
