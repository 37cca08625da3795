"""Authors as they are written in card.toml: a person as ``Family, Given``, anything else as an institution."""

import re
from dataclasses import dataclass

ORCID = re.compile(r"\s*\(?(?:https?://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])\)?\s*$")


@dataclass(frozen=True, slots=True)
class Author:
    """A person with both names, or an institution with ``name`` alone; ORCID where it is told."""

    name: str
    family: str = ""
    given: str = ""
    orcid: str = ""


def author(written: str) -> Author:
    """What an entry of ``authors`` says.

    >>> author("Doe, Jane (0000-0002-1825-0097)")
    Author(name='Doe, Jane', family='Doe', given='Jane', orcid='0000-0002-1825-0097')
    >>> author("Laboratory of Machining").family
    ''
    """
    found = ORCID.search(written)
    name = " ".join((written[: found.start()] if found else written).split())
    family, comma, given = (part.strip() for part in name.partition(","))
    both = bool(comma and family and given)
    return Author(name, family if both else "", given if both else "", found[1] if found else "")
