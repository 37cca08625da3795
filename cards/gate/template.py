"""card.toml as a template: comments and empty fields for exactly what a card lacks."""

from collections.abc import Iterator

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
    return "".join(f"{line}\n" for line in _lines(card))


def _lines(card: Card) -> Iterator[str]:
    lacking = [item.field for item in missing(card) if item.field in QUESTIONS]
    of = f"the card of {one_line(card.title)}"
    yield f"# What {of} does not tell yet." if lacking else f"# Nothing is missing: {of} may be published."
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
