"""What a card must tell before it is published: what is missing, the card.toml that asks for it, and refusals.

ask         the fields of card.toml: what each is, why it is needed, an example
missing     a card -> what it lacks
template    a card -> card.toml with questions for exactly that
told        card.toml -> what it tells, and a parameter file with the identity that it tells
judge       everything that stands against publishing, in one go
"""

from .ask import Missing
from .judge import GateReport, judge
from .missing import missing
from .publication_metadata import PublicationMetadata
from .reading import read_toml
from .template import template, template_of_many

__all__ = [
    "GateReport",
    "Missing",
    "PublicationMetadata",
    "judge",
    "missing",
    "read_toml",
    "template",
    "template_of_many",
]
