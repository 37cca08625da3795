"""The files of a card, all of its forms at once."""

from collections.abc import Sequence

from ...parameters import ParameterFile
from ..content.parts import Card
from .linked_data import json_ld
from .markdown import markdown
from .page import page
from .program import as_json

README, PROGRAM, PAGE = "README.md", "card.json", "card.html"


def forms(card: Card, pf: ParameterFile, beside: Sequence[str] = ()) -> dict[str, bytes]:
    """Name of each file -> its bytes.

    Parameters
    ----------
    card, pf
        What is told, and the file behind it, for figures.
    beside : sequence of str
        Files beside the page, in a site: the page then links to them and back to the site.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.compose import compose
    >>> pf = parameters.collect(tool="GC435", work="709M40", limits={"power": 7})
    >>> list(forms(compose(pf), pf))
    ['README.md', 'card.json', 'card.html']
    """
    browsed = page(card, pf, json_ld=json_ld(card), beside=beside)
    return {name: text.encode() for name, text in zip(
        (README, PROGRAM, PAGE), (markdown(card), as_json(card), browsed), strict=True
    )}  # fmt: skip
