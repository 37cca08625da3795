"""What a card lacks before it may be published."""

from ...datasets.vocabulary import UNNAMED
from ..content.parts import Card
from .ask import DATA, NAMES, QUESTIONS, Missing


def missing(card: Card) -> list[Missing]:
    """Everything that is required and not told, in the order of card.toml.

    Required are licence, an author, contact, machine, ISO 513 group, set-up, a sensor or why there was none, names of
    tool and work, and the checksum of the data.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.compose import compose
    >>> [item.field for item in missing(compose(parameters.collect(tool="GC435", work="709M40")))]
    ['license', 'authors', 'contact', 'machine', 'iso513', 'setup', 'sensors', 'data_sha256']
    """
    p, i = card.publication, card.identity
    told = {
        "license": p.license,
        "authors": "".join(p.authors),
        "contact": p.contact,
        "machine": i.machine,
        "iso513": i.iso513,
        "setup": i.setup,
    }
    lacking = [name for name, value in told.items() if not value.strip()] + ([] if i.sensors else ["sensors"])
    asked = [Missing(name, QUESTIONS[name].why, QUESTIONS[name].ask) for name in lacking]
    unnamed = [NAMES[name] for name, nothing in UNNAMED.items() if getattr(i, name) == nothing]
    return [*asked, *unnamed, *([] if card.provenance.data_sha256 else [DATA])]
