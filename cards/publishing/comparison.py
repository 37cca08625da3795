"""Exponents of many cards side by side: as tables to read, and as numbers for the script that draws and tests them.

Two exponents b and b0 with standard errors s and s0 on nu and nu0 degrees of freedom differ at the 95 % level where
|b - b0| / sqrt(s^2 + s0^2) is beyond the quantile of t with (s^2 + s0^2)^2 / (s^4/nu + s0^4/nu0) degrees of freedom
(Welch 1947, doi 10.1093/biomet/34.1-2.28). Of many pairs compared with one, some differ by chance; Holm's adjusted
p values (Holm 1979, Scand. J. Statist. 6, 65) keep the chance of a single wrong mark among all of them below 5 %.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from .entries import CardEntry, ExponentEntry, LawEntry

Key = tuple[str, str, str]  # response, quantity, form


class ComparisonRow(NamedTuple):
    """A card in a table: its exponents in the order of the table's factors, None where its law lacks one."""

    entry: CardEntry
    exponents: tuple[ExponentEntry | None, ...]


class ComparisonTable(NamedTuple):
    """A law over all cards that hold it."""

    response: str
    quantity: str
    form: str
    factors: tuple[str, ...]
    rows: tuple[ComparisonRow, ...]


def tables(entries: Sequence[CardEntry]) -> list[ComparisonTable]:
    """A table a law, those that most cards hold first.

    Examples
    --------
    >>> tables([])
    []
    """
    found: dict[Key, list[tuple[CardEntry, LawEntry]]] = {}
    for e in entries:
        for law in e.laws:
            if law.exponents:
                found.setdefault((law.response, law.quantity, law.form), []).append((e, law))
    ordered = sorted(found.items(), key=lambda item: (-len(item[1]), item[0]))
    return [_table(key, held) for key, held in ordered]


def exponents_data(entries: Sequence[CardEntry]) -> dict[str, Any]:
    """Data of the script: pairs, and for each law and factor the exponents.

    An exponent is a list: place of its pair, value, standard error, degrees of freedom, low, high, then the three
    texts. Numbers have seven digits: enough for every mark, and a third of the page size.

    Examples
    --------
    >>> exponents_data([])
    {'pairs': [], 'sets': []}
    """
    place = {e.slug: at for at, e in enumerate(entries)}
    pairs = [
        {"slug": e.slug, "title": e.title, "tool": e.tool, "work": e.work, "group": e.group, "simulated": e.simulated}
        for e in entries
    ]
    return {"pairs": pairs, "sets": [one for table in tables(entries) for one in _sets(table, place)]}


def _table(key: Key, held: Sequence[tuple[CardEntry, LawEntry]]) -> ComparisonTable:
    factors = {_name(x): None for _, law in held for x in law.exponents}  # in the order of the laws
    rows = []
    for e, law in held:
        own = {_name(x): x for x in law.exponents}
        rows.append(ComparisonRow(e, tuple(own.get(name) for name in factors)))
    return ComparisonTable(*key, tuple(factors), tuple(rows))


def _name(x: ExponentEntry) -> str:
    """Rates in different units are different things."""
    return f"{x.factor}, {x.unit}" if x.unit else x.factor


def _sets(table: ComparisonTable, place: dict[str, int]) -> Iterator[dict[str, Any]]:
    for column, factor in enumerate(table.factors):
        rows = [
            [place[row.entry.slug], *_numbers(x), x.estimate.text, x.low.text, x.high.text]
            for row in table.rows
            if (x := row.exponents[column]) is not None
        ]
        yield {
            "law": table.response,
            "words": f"{table.response}, {table.quantity}" + ("" if table.form == "power" else f" ({table.form})"),
            "factor": factor,
            "rows": rows,
        }


def _numbers(x: ExponentEntry) -> list[float | int | None]:
    values = (x.estimate.value, x.se, x.df, x.low.value, x.high.value)
    return [float(f"{v:.7g}") if isinstance(v, float) else v for v in values]
