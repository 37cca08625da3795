"""The card as README.md: a head for programs, and Markdown that reads on paper and on a forge."""

import keyword
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING
from urllib.parse import quote

from ..content.parts import Card, Law
from . import markdown_blocks as blocks
from .hub_metadata import hub_metadata
from .plain_text import code, one_line, python_text, text
from .yaml_text import yaml_text

if TYPE_CHECKING:
    from jinja2 import Template

FIELDS = {"tool_life": "tool life", "windows": "window of operation", "design": "tests"}


def markdown(card: Card) -> str:
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
    >>> from fitmodels.cards.content.compose import compose
    >>> "# GC435 on 709M40" in markdown(compose(parameters.collect(tool="GC435", work="709M40")))
    True
    """
    head = yaml_text(hub_metadata(card))
    return _template().render(card=card, head=head, example=_example(card), fitted_to=_fitted_to(card))


def _fitted_to(card: Card) -> str:
    rows, name = card.provenance.rows, card.provenance.data_file
    return f"{'rows' if rows is None else f'{rows} rows'} of {code(name) if name else 'data without a name'}"


def _what(law: Law) -> str:
    return f"{law.quantity}, {law.unit}" if law.unit else law.quantity


def _structure(law: Law) -> str:
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
        bullets=blocks.bullets, line=blocks.line, table=blocks.facts_table, domain=blocks.domain,
        by_edge=blocks.by_edge, law_table=blocks.law_table, drawn_table=blocks.drawn_table,
        model_table=blocks.model_table, uncertainty_table=blocks.uncertainty_table,
        factor_table=blocks.factor_table, identity=blocks.identity_list,
        provenance=blocks.provenance_list, publication=blocks.publication_list,
    )  # fmt: skip
    return environment.get_template("card.md")
