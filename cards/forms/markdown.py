"""The card as README.md: YAML front matter, and Markdown for print and for a forge."""

import keyword
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING
from urllib.parse import quote

from ...core.display import TextTable
from ...core.text import one_line, printable
from ...core.verdict import DO_NOT_USE, MARKS, RESERVATIONS
from ..content.card import Card
from ..content.numbers import ends_words, fact_line, fact_text, quantity
from ..content.parts import DoubtPart, FactorRangePart, LawPart, RemedyPart, SuspectPart, ToolLifePart, VerdictPart
from ..content.tables import (
    budget_table,
    check_table,
    coefficient_table,
    fact_table,
    factor_table,
    holds_words,
    plan_table,
    posterior_table,
    uncertainty_table,
)
from .front_matter import hub_metadata, yaml_text
from .rendering import environment

if TYPE_CHECKING:
    from jinja2 import Template

FIELDS = {
    "tool_life": "tool life",
    "windows": "operating window",
    "plan": "plan of an edge",
    "costs": "costs of a part",
    "design": "tests",
    "doubts": "doubts about the data",
}
# Markdown's own characters; an underscore inside a word is none of them
SPECIAL = re.compile(r"([\\`*\[\]|~#{}$]|(?<![^\W_])_|_(?![^\W_]))")
ENTITY = re.compile(r"&(?=[#\w])")
TAG = re.compile(r"<(?![\d ])")  # <0.001 is no tag
LEAD = re.compile(r"^(?:(\d+)(?=[.)](?:\s|$))|(?=[-+](?:[\s-]|$)|=+$))")
PLAIN = re.compile(r"-?[0-9]+(?:\.[0-9]+)?|[A-Za-z][A-Za-z0-9.,:;()/%-]*(?: [A-Za-z0-9.,:;()/%-]+)*")  # as it is
NO_PREDICTION = "No prediction: this law must not be used."
OUTSIDE = f"{MARKS[RESERVATIONS].icon} outside the tested region: extrapolated"


def card_markdown(card: Card) -> str:
    """The card as Markdown with YAML front matter.

    Parameters
    ----------
    card : Card
        Its numbers are shown by their texts; names are escaped.

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
    return printable(_template().render(card=card, head=head, example=_example(card), fitted_to=_fitted_to(card)))


def text(value: object) -> str:
    r"""Text that Markdown and HTML leave unchanged.

    >>> print(text("<b> a_1 [x](y) p <0.001"))
    &lt;b&gt; a_1 \[x\](y) p <0.001
    """
    words = str(value)
    return words if PLAIN.fullmatch(words) else _escaped(words)


@lru_cache(maxsize=2048)  # the same sentences stand in many cards
def _escaped(words: str) -> str:
    safe = ENTITY.sub("&amp;", one_line(words))
    safe = TAG.sub("&lt;", SPECIAL.sub(r"\\\1", safe)).replace(">", "&gt;")
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


def _bullets(sentences: Iterable[str]) -> str:
    lines = "".join(f"- {text(words)}\n" for words in sentences if words)
    return f"{lines}\n" if lines else ""


def _doubts(doubts: Sequence[DoubtPart]) -> str:
    """Each doubt as a bullet, with the command that reads the file corrected."""
    remedies = (f" Corrected with: {code(doubt.command)}" if doubt.command else "" for doubt in doubts)
    lines = (f"- {text(d.sentence.rstrip('.'))}.{how}\n" for d, how in zip(doubts, remedies, strict=True))
    return "".join(lines) + "\n"


def _results(card: Card) -> str:
    """Each result as a bullet: verdict, equation, worked prediction, scatter; then its reasons and remedies."""
    laws = {law.response: law for law in card.laws}
    life = card.tool_life
    lines = []
    for verdict in card.verdicts:
        law = laws.get(verdict.of)
        more = _of_law(law) if law else _of_life(life) if life is not None and verdict is life.verdict else []
        lines.append(f"- {verdict.mark.icon} **{text(verdict.of)}**: {text(verdict.words)}.")
        lines += [f"  - {line}" for line in (*more, *_reservations(verdict, law.suspects if law else ()))]
    return "\n".join(lines) + "\n\n"


def _of_law(law: LawPart) -> list[str]:
    """Rounded equation, worked predictions with the command of the first, scatter."""
    unit = f", {law.unit}" if law.unit else ""
    lines = [f"{text(law.quantity + unit)}: {code(law.short)}"]
    for one in law.worked:
        where = ", ".join(filter(None, (one.at, one.wear))) + ("" if one.inside else f"; {OUTSIDE}")
        ends = f"{one.low.text} to {quantity(one.high)}"
        lines.append(text(f"{quantity(one.value)} ({ends}, {quantity(one.level)} for {one.of}) at {where}"))
    lines += [code(law.worked[0].command)] if law.worked else []
    lines += [NO_PREDICTION] if law.verdict.level == DO_NOT_USE else []
    return lines + ([text(f"scatter {quantity(law.scatter.number)}: {law.scatter.words}")] if law.scatter else [])


def _of_life(life: ToolLifePart) -> list[str]:
    """Life at the middle with its intervals, whether it is extrapolated, and the command."""
    beyond = "extrapolated: the" if life.extrapolated else "the"
    edge = f"{ends_words(life.edge_low, life.edge_high)}, {quantity(life.level)} for one new edge"
    edge = edge if life.edge_low.text else "no interval of one new edge"
    interval = f" ({edge}; {ends_words(life.low, life.high)} for the law)" if life.low.text else ""
    at = f" at {life.at}" if life.at else ""
    said = f"{life.criterion} after {quantity(life.typical)}{interval}{at}; {beyond} longest test lasted "
    return [text(f"{said}{quantity(life.longest)}"), code(life.command)]


def _reservations(verdict: VerdictPart, suspects: Sequence[SuspectPart]) -> list[str]:
    """Each reason with its icon, and what is suspected with the command that corrects it."""
    reasons = [f"{verdict.mark.icon} {text(why)}{_remedy(remedy)}" for why, remedy in verdict.reservations]
    return reasons + [f"{text(one.words)} {code(one.command)}" for one in verdict.without_remedy(suspects)]


def _remedy(remedy: RemedyPart | None) -> str:
    if remedy is None:
        return ""
    return f" **Remedy:** {text(remedy.words)}{f' {code(remedy.command)}' if remedy.command else ''}"


def _verdict(verdict: VerdictPart) -> str:
    """The verdict on one result with its icon."""
    return f"**{verdict.mark.icon} Verdict: {text(verdict.words)}.**"


def _table(table: TextTable) -> str:
    """A table with its blank line, columns of words aligned left; nothing where there are no rows."""
    if not table.rows:
        return ""
    words = [holds_words(table, j) for j in range(len(table.header))]
    rows = (table.header, *table.rows)
    head, *lines = (f"| {' | '.join(map(text, row))} |" for row in rows)
    return "\n".join([head, f"|{'|'.join('---' if left else '--:' for left in words)}|", *lines]) + "\n\n"


def _domain(factors: Sequence[FactorRangePart]) -> str:
    said = ", ".join(f"{f.symbol} {f.low.text} to {quantity(f.high)}" for f in factors)
    return text(f"Range of the data: {said}.") + "\n\n" if said else ""


def _by_edge(law: LawPart) -> str:
    parts = [f"By edge: {fact_line(law.by_edge)}." if law.by_edge else "", law.edge_words]
    said = " ".join(text(part) for part in parts if part)
    return f"{said}\n\n" if said else ""


def _fitted_to(card: Card) -> str:
    rows, name = card.provenance.rows, card.provenance.data_file
    return f"{'rows' if rows is None else f'{rows} rows'} of {code(name) if name else 'unnamed data'}"


def _what(law: LawPart) -> str:
    return f"{law.quantity}, {law.unit}" if law.unit else law.quantity


def _structure(law: LawPart) -> str:
    form = law.form if "line" in law.form else f"{law.form} law"
    return f"{form[:1].upper()}{form[1:]}; {law.structure}"


def _reasons(empty: Mapping[str, str]) -> list[str]:
    names = {field: FIELDS.get(field, field) for field in empty}
    return [f"{names[field][:1].upper()}{names[field][1:]}: {why}" for field, why in empty.items()]


def _example(card: Card) -> str:
    """Python that predicts the first law at the middle of its ranges."""
    if not card.laws:
        return ""
    law = card.laws[0]
    at = {f.symbol: _middle(f.low.value or 0.0, f.high.value or 0.0) for f in law.domain}
    if all(name.isidentifier() and not keyword.iskeyword(name) for name in at):
        said = [f"{name}={value}" for name, value in at.items()]
    else:
        said = ["**{" + ", ".join(f"{_python_text(name)}: {value}" for name, value in at.items()) + "}"]
    levels = any("[" in c.name and c.name not in at for c in law.coefficients[1:])
    asked = ", ".join([*(["by=law.by.reference"] if levels else []), *said])
    return f"law = pf.laws[{_python_text(law.response)}]\nprint(law.predict({asked}).words)"


def _python_text(value: str) -> str:
    """A Python string that cannot end the fence around it."""
    return repr(value).replace("`", "\\x60")


def _middle(low: float, high: float) -> str:
    return f"{(low * high) ** 0.5 if low > 0 else (low + high) / 2:.3g}"


@lru_cache(maxsize=1)
def _template() -> "Template":
    def tabulated(table: Callable[..., TextTable]) -> Callable[..., str]:
        return lambda *of: _table(table(*of))

    return environment(
        autoescape=False,  # Markdown, not HTML: the filters escape for it
        t=text,
        code=code,
        one_line=one_line,
        path=quote,
        what=_what,
        structure=_structure,
        reasons=_reasons,
        bullets=_bullets,
        doubts=_doubts,
        results=_results,
        verdict=_verdict,
        line=lambda facts: text(fact_line(facts)),
        fact=lambda item: text(fact_text(item)),
        domain=_domain,
        by_edge=_by_edge,
        coefficients=tabulated(coefficient_table),
        table=tabulated(fact_table),
        checks=tabulated(check_table),
        plan=tabulated(plan_table),
        posterior=tabulated(posterior_table),
        factors=tabulated(factor_table),
        statements=tabulated(uncertainty_table),
        budget=tabulated(budget_table),
    ).get_template("card.md")
