"""A card as the pages of a site know it: names, laws with their exponents, hashes.

Exponents of many cards side by side: as tables to read, and as numbers for the script that draws and tests them.

Two exponents b and b0 with standard errors s and s0 on nu and nu0 degrees of freedom differ at the 95 % level where
|b - b0| / sqrt(s^2 + s0^2) is beyond the quantile of t with (s^2 + s0^2)^2 / (s^4/nu + s0^4/nu0) degrees of freedom
(Welch 1947, doi 10.1093/biomet/34.1-2.28). Of many pairs compared with one, some differ by chance; Holm's adjusted
p values (Holm 1979, Scand. J. Statist. 6, 65) keep the chance of a single wrong mark among all of them below 5 %.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, Field

from ...core.text import printable
from ...core.verdict import MARKS, NOT_JUDGED
from ...datasets.vocabulary import ROLES
from ...parameters import ParameterFile
from ..content.card import Card
from ..content.laws import degrees
from ..content.parts import LawPart, NumberPart, Part

Shown = Annotated[str, AfterValidator(printable)]  # alike on the pages, in their data and in the list


class ExponentEntry(Part):
    """An exponent of a law, or the rate of an exponential one, with what compares it to another.

    ``se`` and ``df`` are None where the law has no interval; ``unit`` is empty of an exponent.
    """

    factor: Shown
    unit: Shown = ""
    estimate: NumberPart
    low: NumberPart
    high: NumberPart
    se: float | None = None
    df: int | None = None


class LawEntry(Part):
    """A law of a card; ``verdict`` states how far it can be used."""

    response: Shown
    verdict: str = ""
    quantity: Shown
    unit: Shown
    form: Shown
    equation: Shown
    exponents: tuple[ExponentEntry, ...] = ()


class CardEntry(Part):
    """A card in the list of a site, as ``cards.json`` (schema ``fitmodels.site/5``) has it.

    ``slug`` names the folder of the card; ``files`` are paths in it -> SHA-256; ``made_from`` is the SHA-256 of the
    files and of the code that the card was made from; ``gaps`` of a draft are sentences on what keeps the card from
    being published.
    """

    slug: str
    title: Shown
    verdict: str = ""  # the worst of its results
    summary: Shown
    tool: Shown
    work: Shown
    iso513: Shown = ""
    machine: Shown = ""
    simulated: bool
    created: Shown = ""
    rows: int | None = None
    license: Shown = ""
    laws: tuple[LawEntry, ...] = ()
    dynamics: bool = False
    content_sha256: str
    data_sha256: str = ""
    data_file: Shown = ""
    files: dict[str, str] = Field(default_factory=dict)
    made_from: str = ""
    gaps: tuple[Shown, ...] = ()

    @property
    def href(self) -> str:
        """Link to the card from the top of the site."""
        return f"cards/{self.slug}/index.html"

    @property
    def judged(self) -> str:
        """Results that the verdict is of: laws, else the tool life by a law of wear, or another part of the card."""
        laws = [law.response for law in self.laws if law.verdict == self.verdict]
        has_life = not self.dynamics and any(
            ROLES[law.response].kind == "wear" for law in self.laws if law.response in ROLES
        )
        return ", ".join(laws) or ("T (tool life)" if has_life else "see the card")

    @property
    def group(self) -> str:
        """Letter of the ISO 513 group, or nothing."""
        return self.iso513[:1]


def card_entry(card: Card, pf: ParameterFile, files: dict[str, str], gaps: tuple[str, ...] = ()) -> CardEntry:
    """The entry of a card, with the ``gaps`` of a draft.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> pf = parameters.collect(tool="GC435", work="709M40", limits={"power": 7})
    >>> card_entry(compose(pf), pf, {}).href
    'cards/gc435-709m40/index.html'
    """
    i = card.identity
    return CardEntry(
        slug=card.slug,
        title=card.title,
        verdict=card.verdict,
        summary=card.summary,
        tool=i.tool,
        work=i.work,
        iso513=i.iso513,
        machine=i.machine,
        simulated=bool(i.simulated),
        created=card.provenance.created,
        rows=card.provenance.rows or max((law.n for law in pf.laws.values()), default=None),
        license=card.publication.license,
        laws=tuple(_law(law, pf) for law in card.laws),
        dynamics=card.dynamics is not None,
        content_sha256=i.content_sha256,
        data_sha256=card.provenance.data_sha256,
        data_file=card.provenance.data_file,
        files=files,
        gaps=gaps,
    )


def with_slugs(entries: Sequence[CardEntry]) -> list[CardEntry]:
    """Entries whose slugs are all different: those of one tool and work get eight digits of their content.

    Examples
    --------
    >>> one = CardEntry(slug="a-b", title="a", summary="", tool="a", work="b", simulated=True, content_sha256="0" * 64)
    >>> two = one.model_copy(update={"content_sha256": "1" * 64})
    >>> [e.slug for e in with_slugs([one, two])]
    ['a-b-00000000', 'a-b-11111111']
    """
    named = list(entries)
    for digits in (8, 64):  # a tool may be called as another's slug ends
        taken = Counter(e.slug for e in named)
        named = [
            e.model_copy(update={"slug": f"{one.slug}-{e.content_sha256[:digits]}"}) if taken[e.slug] > 1 else e
            for e, one in zip(named, entries, strict=True)
        ]
    return named


def _law(law: LawPart, pf: ParameterFile) -> LawEntry:
    return LawEntry(
        response=law.response,
        verdict=law.verdict.words,
        quantity=law.quantity,
        unit=law.unit,
        form=law.form,
        equation=law.equation,
        exponents=tuple(_exponents(law, pf)),
    )


def _exponents(law: LawPart, pf: ParameterFile) -> Iterator[ExponentEntry]:
    """One for each factor of a law that is linear for ln R: its exponent, or its rate where it enters as it is."""
    section = pf.laws[law.response]
    if not section.logarithmic:
        return
    formula = section.formula
    logs = dict(zip(formula.factors, formula.logs, strict=True))
    symbols = {f.symbol: f for f in law.domain}
    named = dict(zip(formula.names[1:], (term.name for term in formula.all_terms), strict=True))
    for c in law.coefficients:
        factor = named.get(c.name, "")
        if factor not in symbols or c.estimate.value is None:
            continue
        rate = not logs[factor] and symbols[factor].unit
        known = c.low.value is not None and c.high.value is not None and bool(c.se.value)
        yield ExponentEntry(
            factor=factor,
            unit=f"1/({symbols[factor].unit})" if rate else "",
            estimate=c.estimate,
            low=c.low,
            high=c.high,
            se=c.se.value if known else None,
            df=degrees(section) if known else None,
        )


Key = tuple[str, str, str]  # response, quantity, form


class ComparisonRow(NamedTuple):
    """A card in a table: its law, and exponents in the order of the table's factors, None where the law lacks one."""

    entry: CardEntry
    law: LawEntry
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
    texts, and the place of the verdict on its law. Numbers have seven digits: enough for every mark, and a third of
    the page size.

    Examples
    --------
    >>> list(exponents_data([]))
    ['pairs', 'verdicts', 'sets']
    """
    place = {e.slug: at for at, e in enumerate(entries)}
    named = sources(entries)
    pairs = [
        {"slug": e.slug, "title": e.title, "source": named.get(e.slug, ""), "tool": e.tool, "work": e.work,
         "group": e.group, "simulated": e.simulated}
        for e in entries
    ]  # fmt: skip
    verdicts = [[mark.icon, mark.words, mark.css] for mark in MARKS.values()]
    sets = [one for table in tables(entries) for one in _sets(table, place)]
    return {"pairs": pairs, "verdicts": verdicts, "sets": sets}


def sources(entries: Sequence[CardEntry]) -> dict[str, str]:
    """Data files of the cards of equal title, by slug; the slug itself where the files have one name, too.

    Examples
    --------
    >>> one = CardEntry(slug="a-1", title="a", summary="", tool="a", work="b", simulated=True, content_sha256="0" * 64)
    >>> two = one.model_copy(update={"slug": "a-2", "data_file": "may.csv"})
    >>> sources([one, two]), sources([one])
    ({'a-1': 'a-1', 'a-2': 'may.csv'}, {})
    """
    titles, files = Counter(e.title for e in entries), Counter((e.title, e.data_file) for e in entries)
    return {
        e.slug: e.data_file if e.data_file and files[e.title, e.data_file] == 1 else e.slug
        for e in entries
        if titles[e.title] > 1
    }


def _table(key: Key, held: Sequence[tuple[CardEntry, LawEntry]]) -> ComparisonTable:
    factors = {_name(x): None for _, law in held for x in law.exponents}  # in the order of the laws
    rows = []
    for e, law in held:
        own = {_name(x): x for x in law.exponents}
        rows.append(ComparisonRow(e, law, tuple(own.get(name) for name in factors)))
    return ComparisonTable(*key, tuple(factors), tuple(rows))


def _name(x: ExponentEntry) -> str:
    """Rates in different units are different things."""
    return f"{x.factor}, {x.unit}" if x.unit else x.factor


def _sets(table: ComparisonTable, place: dict[str, int]) -> Iterator[dict[str, Any]]:
    for column, factor in enumerate(table.factors):
        rows = [
            [place[row.entry.slug], *_numbers(x), x.estimate.text, x.low.text, x.high.text, _place(row.law.verdict)]
            for row in table.rows
            if (x := row.exponents[column]) is not None
        ]
        yield {
            "law": table.response,
            "words": f"{table.response}, {table.quantity}" + ("" if table.form == "power" else f" ({table.form})"),
            "factor": factor,
            "rows": rows,
        }


def _place(verdict: str) -> int:
    """Place of a verdict in the data of the script."""
    words = [mark.words for mark in MARKS.values()]
    return words.index(verdict if verdict in words else NOT_JUDGED)


def _numbers(x: ExponentEntry) -> list[float | int | None]:
    values = (x.estimate.value, x.se, x.df, x.low.value, x.high.value)
    return [float(f"{v:.7g}") if isinstance(v, float) else v for v in values]
