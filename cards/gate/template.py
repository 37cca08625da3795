"""card.toml as a template: comments and empty fields for exactly what a card lacks."""

from collections.abc import Iterator, Sequence

from ..content.parts import Card
from ..forms.plain_text import one_line
from .ask import QUESTIONS, SENSOR_EXAMPLE
from .missing import missing


def template(card: Card) -> str:
    """The text of a card.toml that asks for what the card lacks; it reads back as it is, telling nothing yet.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.compose import compose
    >>> print(template(compose(parameters.collect(tool="GC435", work="709M40"))).splitlines()[0])
    # What the card of GC435 on 709M40 does not tell yet.
    """
    lacking = [item.field for item in missing(card) if item.field in QUESTIONS]
    of = f"the card of {one_line(card.title)}"
    head = f"# What {of} does not tell yet." if lacking else f"# Nothing is missing: {of} may be published."
    return _asking(head, lacking)


def template_of_many(pairs: int, fields: Sequence[str]) -> str:
    """The text of a card.toml above many pairs, which asks once for what none of them tells.

    >>> template_of_many(40, ["license"]).splitlines()[0]
    '# What none of the 40 cards below tells yet. A card.toml beside a pair adds to this one and counts first.'
    """
    words = (
        f"What none of the {pairs} cards below tells yet. A card.toml beside a pair adds to this one and counts first."
    )
    return _asking(f"# {words}", fields)


def _asking(head: str, lacking: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in (head, *_questions(lacking)))


def _questions(lacking: Sequence[str]) -> Iterator[str]:
    for name in lacking:
        question = QUESTIONS[name]
        yield ""
        yield f"# {name}: {question.why}."
        yield f"# {question.ask}"
        yield f"# for example: {question.example}"
        yield question.line
    yield ""
    yield '# Also, if you like: title, doi, keywords = ["..."], a block [tool_properties] with symbols of ISO 13399.'
    if "sensors" in lacking:
        yield "# A sensor, at the end of the file:"
        yield from (f"# {line}" for line in SENSOR_EXAMPLE)
