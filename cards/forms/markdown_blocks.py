"""Tables and lists of the card in Markdown, each with its blank line after it and nothing where there is nothing."""

from collections.abc import Iterable, Sequence

from ..content.coefficients import between
from ..content.numbers import quantity
from ..content.parts import Card, Coefficient, DrawnParameter, FactorRange, Law, Named, Number, Posterior, Uncertain
from .plain_text import code, text

LEFT, RIGHT = "---", "--:"


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return _list(text(words) for words in sentences if words)


def named(item: Named) -> str:
    """``residual SE 0.0958 in ln (one row scatters by about 10 %)``."""
    told = quantity(item.number)
    if not told:
        return text(f"{item.name}: {item.words}")
    return text(f"{item.name} {told}" + (f" ({item.words})" if item.words else ""))


def line(facts: Iterable[Named]) -> str:
    """Facts one after the other, in one sentence."""
    return "; ".join(map(named, facts))


def facts_table(facts: Sequence[Named], head: str) -> str:
    """Facts as a table: name, value, what it is."""
    rows = [(text(item.name), _n(item.number), text(item.words)) for item in facts]
    return _table((head, "value", ""), (LEFT, RIGHT, LEFT), rows)


def domain(factors: Sequence[FactorRange]) -> str:
    """Ranges of the factors, in a sentence."""
    said = ", ".join(f"{f.symbol} {f.low.text} to {quantity(f.high)}" for f in factors)
    return text(f"Range of the data: {said}.") + "\n\n" if said else ""


def by_edge(law: Law) -> str:
    """What the edges say, in a paragraph."""
    parts = [f"By edge: {line(law.by_edge)}." if law.by_edge else "", text(law.edge_words)]
    said = " ".join(part for part in parts if part)
    return f"{said}\n\n" if said else ""


def law_table(law: Law) -> str:
    """Coefficients of a law, with the columns that it has."""
    more = ((law.has_row_se, "row SE"), (bool(law.other_heading), law.other_heading), (law.has_printed, "as printed"))
    head = ["coefficient", "estimate", "SE", "t", "p", f"{law.level.text} % interval"]
    rows = []
    for c in law.coefficients:
        beside = (n for (there, _), n in zip(more, (c.row_se, c.other, c.printed), strict=True) if there)
        rows.append([text(c.name), *map(_n, (c.estimate, c.se, c.t, c.p)), _ends(c), *map(_n, beside)])
    head += [text(words) for there, words in more if there]
    return _table(head, [LEFT, *[RIGHT] * (len(head) - 1)], rows)


def model_table(coefficients: Sequence[Coefficient]) -> str:
    """Coefficients of a model, with standard errors where there are any."""
    judged = any(c.se.text for c in coefficients)
    head = ["coefficient", "estimate", *(["SE", "95 % interval"] if judged else [])]
    rows = [[text(c.name), _n(c.estimate), *([_n(c.se), _ends(c)] if judged else [])] for c in coefficients]
    return _table(head, [LEFT, *[RIGHT] * (len(head) - 1)], rows)


def drawn_table(of: Posterior) -> str:
    """What the draws say of each parameter."""
    head = ("parameter", "median", "sd", f"{of.level.text} % credible", "prior",
            "moved by priors half, twice as wide (sd)")  # fmt: skip
    rows = [(text(p.name), _n(p.median), _n(p.sd), _ends(p), text(p.prior), text(p.moved)) for p in of.parameters]
    return _table(head, (LEFT, RIGHT, RIGHT, RIGHT, LEFT, RIGHT), rows)


def uncertainty_table(statements: Sequence[Uncertain]) -> str:
    """Value, u, U, k and interval of each statement."""
    rows = [
        (text(s.symbol), text(s.of), _n(s.value), text(s.standard.text), text(s.expanded.text), _n(s.k), _n(s.df),
         _n(s.level), _ends(s))
        for s in statements
    ]  # fmt: skip
    head = ("quantity", "of", "value", "u", "U", "k", "df", "level", "interval")
    return _table(head, (LEFT, LEFT, *[RIGHT] * 7), rows)


def factor_table(factors: Sequence[FactorRange]) -> str:
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


def _n(n: Number) -> str:
    return text(quantity(n))


def _ends(item: Coefficient | DrawnParameter | Uncertain) -> str:
    return text(between(item.low, item.high))
