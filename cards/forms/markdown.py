"""The card as README.md: YAML front matter, and Markdown for print and for a forge."""

import keyword
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING
from urllib.parse import quote

from ..content.coefficients import between
from ..content.numbers import quantity
from ..content.parts import (
    Card,
    CoefficientPart,
    DrawnParameterPart,
    FactorRangePart,
    FactPart,
    LawPart,
    NumberPart,
    PosteriorPart,
    UncertaintyPart,
)
from .front_matter import hub_metadata, yaml_text

if TYPE_CHECKING:
    from jinja2 import Template

FIELDS = {"tool_life": "tool life", "windows": "window of operation", "design": "tests"}


def card_markdown(card: Card) -> str:
    """The card as Markdown with a YAML head.

    Parameters
    ----------
    card : Card
        Its numbers are told by their texts, and names stay names whatever letters they hold.

    Returns
    -------
    str
        The same card gives the same text.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> "# GC435 on 709M40" in card_markdown(compose(parameters.collect(tool="GC435", work="709M40")))
    True
    """
    head = yaml_text(hub_metadata(card))
    return _template().render(card=card, head=head, example=_example(card), fitted_to=_fitted_to(card))


def _fitted_to(card: Card) -> str:
    rows, name = card.provenance.rows, card.provenance.data_file
    return f"{'rows' if rows is None else f'{rows} rows'} of {code(name) if name else 'data without a name'}"


def _what(law: LawPart) -> str:
    return f"{law.quantity}, {law.unit}" if law.unit else law.quantity


def _structure(law: LawPart) -> str:
    form = law.form if "line" in law.form else f"{law.form} law"
    return f"{form[:1].upper()}{form[1:]}; {law.structure}"


def _reasons(empty: Mapping[str, str]) -> list[str]:
    names = {field: FIELDS.get(field, field) for field in empty}
    return [f"{names[field][:1].upper()}{names[field][1:]}: {why}" for field, why in empty.items()]


def _example(card: Card) -> str:
    """Python that asks the first law for its answer at the middle of its ranges."""
    if not card.laws:
        return ""
    law = card.laws[0]
    at = {f.symbol: _middle(f.low.value or 0.0, f.high.value or 0.0) for f in law.domain}
    if all(name.isidentifier() and not keyword.iskeyword(name) for name in at):
        said = [f"{name}={value}" for name, value in at.items()]
    else:
        said = ["**{" + ", ".join(f"{python_text(name)}: {value}" for name, value in at.items()) + "}"]
    levels = any("[" in c.name and c.name not in at for c in law.coefficients[1:])
    asked = ", ".join([*(["by=law.by.reference"] if levels else []), *said])
    unit = f"  # {one_line(law.unit)}" if law.unit and "`" not in law.unit else ""
    return f"law = pf.laws[{python_text(law.response)}]\nlaw.predict({asked}){unit}"


def _middle(low: float, high: float) -> str:
    return f"{(low * high) ** 0.5 if low > 0 else (low + high) / 2:.3g}"


@lru_cache(maxsize=1)
def _template() -> "Template":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(  # noqa: S701  Markdown, not HTML: the filters escape for it
        loader=PackageLoader("fitmodels.cards"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        t=text, code=code, one_line=one_line, path=quote, what=_what, structure=_structure, reasons=_reasons,
        bullets=bullets, line=line, table=facts_table, domain=domain,
        by_edge=by_edge, law_table=law_table, drawn_table=drawn_table,
        model_table=model_table, uncertainty_table=uncertainty_table,
        factor_table=factor_table, identity=identity_list,
        provenance=provenance_list, publication=publication_list,
    )  # fmt: skip
    return environment.get_template("card.md")


LEFT, RIGHT = "---", "--:"


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return _list(text(words) for words in sentences if words)


def named(item: FactPart) -> str:
    """``residual SE 0.0958 in ln (one row scatters by about 10 %)``."""
    told = quantity(item.number)
    if not told:
        return text(f"{item.name}: {item.words}")
    return text(f"{item.name} {told}" + (f" ({item.words})" if item.words else ""))


def line(facts: Iterable[FactPart]) -> str:
    """Facts one after the other, in one sentence."""
    return "; ".join(map(named, facts))


def facts_table(facts: Sequence[FactPart], head: str) -> str:
    """Facts as a table: name, value, what it is."""
    rows = [(text(item.name), _n(item.number), text(item.words)) for item in facts]
    return _table((head, "value", ""), (LEFT, RIGHT, LEFT), rows)


def domain(factors: Sequence[FactorRangePart]) -> str:
    """Ranges of the factors, in a sentence."""
    said = ", ".join(f"{f.symbol} {f.low.text} to {quantity(f.high)}" for f in factors)
    return text(f"Range of the data: {said}.") + "\n\n" if said else ""


def by_edge(law: LawPart) -> str:
    """What the edges say, in a paragraph."""
    parts = [f"By edge: {line(law.by_edge)}." if law.by_edge else "", text(law.edge_words)]
    said = " ".join(part for part in parts if part)
    return f"{said}\n\n" if said else ""


def law_table(law: LawPart) -> str:
    """Coefficients of a law, with the columns that it has."""
    more = ((law.has_row_se, "row SE"), (bool(law.other_heading), law.other_heading), (law.has_printed, "as printed"))
    head = ["coefficient", "estimate", "SE", "t", "p", f"{law.level.text} % interval"]
    rows = []
    for c in law.coefficients:
        beside = (n for (there, _), n in zip(more, (c.row_se, c.other, c.printed), strict=True) if there)
        rows.append([text(c.name), *map(_n, (c.estimate, c.se, c.t, c.p)), _ends(c), *map(_n, beside)])
    head += [text(words) for there, words in more if there]
    return _table(head, [LEFT, *[RIGHT] * (len(head) - 1)], rows)


def model_table(coefficients: Sequence[CoefficientPart]) -> str:
    """Coefficients of a model, with standard errors where there are any."""
    judged = any(c.se.text for c in coefficients)
    head = ["coefficient", "estimate", *(["SE", "95 % interval"] if judged else [])]
    rows = [[text(c.name), _n(c.estimate), *([_n(c.se), _ends(c)] if judged else [])] for c in coefficients]
    return _table(head, [LEFT, *[RIGHT] * (len(head) - 1)], rows)


def drawn_table(of: PosteriorPart) -> str:
    """What the draws say of each parameter."""
    head = ("parameter", "median", "sd", f"{of.level.text} % credible", "prior",
            "moved by priors half, twice as wide (sd)")  # fmt: skip
    rows = [(text(p.name), _n(p.median), _n(p.sd), _ends(p), text(p.prior), text(p.moved)) for p in of.parameters]
    return _table(head, (LEFT, RIGHT, RIGHT, RIGHT, LEFT, RIGHT), rows)


def uncertainty_table(statements: Sequence[UncertaintyPart]) -> str:
    """Value, u, U, k and interval of each statement."""
    rows = [
        (text(s.symbol), text(s.of), _n(s.value), text(s.standard.text), text(s.expanded.text), _n(s.k), _n(s.df),
         _n(s.level), _ends(s))
        for s in statements
    ]  # fmt: skip
    head = ("quantity", "of", "value", "u", "U", "k", "df", "level", "interval")
    return _table(head, (LEFT, LEFT, *[RIGHT] * 7), rows)


def factor_table(factors: Sequence[FactorRangePart]) -> str:
    """Factors of the tests with their ranges and levels."""
    rows = [
        (text(f.symbol), text(f.quantity), text(f.unit), text(f.low.text), text(f.high.text),
         text(", ".join(n.text for n in f.levels) or "many"))
        for f in factors
    ]  # fmt: skip
    head = ("factor", "quantity", "unit", "lowest", "highest", "levels")
    return _table(head, (LEFT, LEFT, LEFT, RIGHT, RIGHT, LEFT), rows)


def identity_list(card: Card) -> str:
    """Tool, work, machine, set-up, sensors: what is told of them."""
    i = card.identity
    group = f", ISO 513 group {i.iso513}" if i.iso513 else ""
    told = {"Tool": i.tool, "Work": f"{i.work}{group}", "Machine": i.machine, "Set-up": i.setup}
    said = [text(f"{name}: {value}") for name, value in told.items() if value]
    said += [f"ISO 13399 {named(item)}" for item in i.tool_properties]
    for s in i.sensors:
        unit, more = (f", {s.unit}" if s.unit else ""), "; ".join(part for part in (s.model, s.words) if part)
        said.append(text(f"Sensor {s.symbol}{unit}{f': {more}' if more else ''}"))
    return _list([*said, *([text(f"Note: {i.note}")] if i.note and not i.simulated else [])])


def provenance_list(card: Card) -> str:
    """Data, parameter file, versions and command: what repeats it."""
    i, p = card.identity, card.provenance
    data = code(p.data_file) if p.data_file else "data"
    data += f", SHA-256 {code(p.data_sha256)}" if p.data_sha256 else ""
    data += f", {p.rows} rows" if p.rows is not None else ""
    said = [data] if data != "data" else []
    said.append(
        f"parameter file `params.json`, {code(i.parameters_schema)}, SHA-256 of its content {code(i.content_sha256)}"
    )
    said.append(text(", ".join(f"{name} {version}" for name, version in p.versions.items())))
    said += [f"made by {code(p.command)}"] if p.command else []
    said += [f"seed {p.seed}"] if p.seed is not None else []
    return _list([*said, *([text(f"created {p.created}")] if p.created else [])])


def publication_list(card: Card) -> str:
    """Who publishes it, and what one may do with it."""
    p = card.publication
    told = {"authors": "; ".join(p.authors), "licence": p.license, "contact": p.contact, "doi": p.doi,
            "keywords": ", ".join(p.keywords)}  # fmt: skip
    return bullets(f"{name}: {value}" for name, value in told.items() if value)


def _list(lines: Iterable[str]) -> str:
    said = "".join(f"- {words}\n" for words in lines)
    return f"{said}\n" if said else ""


def _table(head: Sequence[str], rule: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    lines = [_row(head), f"|{'|'.join(rule)}|", *map(_row, rows)]
    return "\n".join(lines) + "\n\n"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _n(n: NumberPart) -> str:
    return text(quantity(n))


def _ends(item: CoefficientPart | DrawnParameterPart | UncertaintyPart) -> str:
    return text(between(item.low, item.high))


# Markdown's own letters; an underscore inside a word is none of them
MARKS = re.compile(r"([\\`*\[\]|~#{}$]|(?<![^\W_])_|_(?![^\W_]))")
ENTITY = re.compile(r"&(?=[#\w])")
TAG = re.compile(r"<(?!\d)")  # <0.001 is no tag
LEAD = re.compile(r"^(?:(\d+)(?=[.)](?:\s|$))|(?=[-+](?:[\s-]|$)|=+$))")
UNSEEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")  # control letters, and those that turn a line


def one_line(value: object) -> str:
    r"""Text on one line, without letters that cannot be seen.

    >>> one_line("a\n\n b\x1b")
    'a b�'
    """
    return UNSEEN.sub("\N{REPLACEMENT CHARACTER}", " ".join(str(value).split()))


def text(value: object) -> str:
    r"""Text that Markdown and HTML leave alone.

    >>> print(text("<b> a_1 [x](y) p <0.001"))
    &lt;b&gt; a_1 \[x\](y) p <0.001
    """
    safe = ENTITY.sub("&amp;", one_line(value))
    safe = TAG.sub("&lt;", MARKS.sub(r"\\\1", safe)).replace(">", "&gt;")
    return LEAD.sub(lambda found: f"{found[1] or ''}\\", safe, count=1)


def code(value: object) -> str:
    """A code span, its fence longer than any run of backticks inside.

    >>> print(code("a`b"))
    ``a`b``
    """
    inside = one_line(value)
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", inside)), default=0))
    pad = " " if inside[:1] in ("`", "") or inside[-1:] == "`" else ""
    return f"{fence}{pad}{inside}{pad}{fence}"


def python_text(value: str) -> str:
    """A Python string that cannot end the fence that it stands in."""
    return repr(value).replace("`", "\\x60")
