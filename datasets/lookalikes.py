"""Letters of other scripts that look like Latin ones, such as a Cyrillic a or a Greek nu, in headers."""

from dataclasses import replace

from .headers import parse_header
from .tables import Table
from .units import is_unit
from .vocabulary import roles_named

_CYRILLIC = dict(zip("АВСЕНІЈКМОРЅТХаеорсухіјѕԁһ", "ABCEHIJKMOPSTXaeopcyxijsdh", strict=True))
_GREEK = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧνορ", "ABEZHIKMNOPTYXvop", strict=True))
_LETTERS = str.maketrans(_CYRILLIC | _GREEK)


def with_latin_headers(table: Table) -> Table:
    r"""The table with Latin letters in headers that only then name a quantity or a unit, and a warning on each.

    >>> import pathlib, tempfile
    >>> from .tables import read_table
    >>> path = pathlib.Path(tempfile.mkdtemp(), "a.csv")
    >>> _ = path.write_text("V,\N{CYRILLIC SMALL LETTER A}p [mm]\n100,2\n", "utf-8")
    >>> [column.name for column in with_latin_headers(read_table(path)).columns]
    ['V', 'ap [mm]']
    """
    columns = list(table.columns)
    said: list[str] = []
    for i, column in enumerate(columns):
        if column.name.isascii() and column.unit_cell.isascii():
            continue
        name = _latin(column.name) if _gains(column.name) else column.name
        cell = column.unit_cell
        cell = _latin(cell) if cell and not is_unit(cell) and is_unit(_latin(cell)) else cell
        if (name, cell) != (column.name, column.unit_cell):
            columns[i] = replace(column, name=name, unit_cell=cell)
            said.append(f"Column {column.number}: {name!r} is written with letters of another script.")
    return replace(table, columns=tuple(columns), warnings=(*table.warnings, *said)) if said else table


def _gains(text: str) -> bool:
    """Whether a header names a quantity, or has a known unit, only in Latin letters."""
    latin = _latin(text)
    if latin == text:
        return False
    old, new = parse_header(text), parse_header(latin)
    if not roles_named(new.name):
        return False
    return not roles_named(old.name) or (is_unit(new.unit_text) and not is_unit(old.unit_text))


def _latin(text: str) -> str:
    return text.translate(_LETTERS)
