"""Citation of a card: CITATION.cff (version 1.2.0) and .zenodo.json."""

import html
import re
from dataclasses import dataclass
from typing import Any

from ...core.errors import UsageError
from ...core.text import json_text
from ..content.card import Card
from .front_matter import KINDS, yaml_text

MESSAGE = "If you use this card, please cite it, and the papers whose laws it refits."
DAY = re.compile(r"\d{4}-\d{2}-\d{2}")


ORCID = re.compile(r"(?:(?<!\s)\s+)?\(?(?:https?://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])\)?\s*+$")


@dataclass(frozen=True, slots=True)
class Author:
    """A person with both names, or an institution with ``name`` alone; ORCID if given."""

    name: str
    family: str = ""
    given: str = ""
    orcid: str = ""


def author(written: str) -> Author:
    """An entry of ``authors`` as an author.

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


def citation_cff(card: Card) -> str:
    """CITATION.cff: required keys ``cff-version``, ``message``, ``title`` and ``authors``, and what the card knows.

    Raises
    ------
    UsageError
        There is no author.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> from fitmodels.cards.content.parts import PublicationPart
    >>> pf = parameters.collect(tool="GC435", work="709M40")
    >>> print(citation_cff(compose(pf, publication=PublicationPart(authors=("Doe, Jane",)))).splitlines()[2])
    title: "GC435 on 709M40"
    """
    p = card.publication
    day = DAY.match(card.provenance.created)
    said = {
        "cff-version": "1.2.0",
        "message": MESSAGE,
        "title": card.title,
        "type": "dataset",
        "abstract": card.summary,
        "authors": [_cff(each) for each in _authors(card)],
        "version": card.identity.content_sha256[:12],
        "doi": p.doi,
        "license": p.license,
        "keywords": _keywords(card),
        "date-released": day[0] if day else "",
        "identifiers": [{"type": "other", "value": f"sha256:{card.identity.content_sha256}",
                         "description": "checksum of the parameter file's content"}],
    }  # fmt: skip
    return yaml_text({name: value for name, value in said.items() if value})


def zenodo_json(card: Card) -> str:
    """.zenodo.json; its description is HTML, so its content is escaped.

    Raises
    ------
    UsageError
        There is no author.
    """
    p = card.publication
    paragraphs = (card.summary, *card.safety, f"{card.end}.")
    said: dict[str, Any] = {
        "title": card.title,
        "upload_type": "dataset",
        "description": "".join(f"<p>{html.escape(each)}</p>" for each in paragraphs),
        "creators": [_zenodo(each) for each in _authors(card)],
        "keywords": _keywords(card),
        "license": p.license,
        "access_right": "open" if p.license else "closed",
        "version": card.identity.content_sha256[:12],
        "language": "eng",
        "doi": p.doi,
    }
    given = {name: value for name, value in said.items() if value}
    return json_text(given, indent=1) + "\n"


def _authors(card: Card) -> list[Author]:
    if not card.publication.authors:
        raise UsageError(f"{card.title}: no author is given, and a citation needs one; add authors in card.toml.")
    return [author(each) for each in card.publication.authors]


def _keywords(card: Card) -> list[str]:
    known = ["machining", *KINDS[card.identity.simulated], *(law.quantity for law in card.laws)]
    return list(dict.fromkeys([*known, *card.publication.keywords]))


def _cff(a: Author) -> dict[str, str]:
    said = {"family-names": a.family, "given-names": a.given} if a.family else {"name": a.name}
    return {**said, **({"orcid": f"https://orcid.org/{a.orcid}"} if a.orcid else {})}


def _zenodo(a: Author) -> dict[str, str]:
    return {"name": a.name, **({"orcid": a.orcid} if a.orcid else {})}
