"""The Atom feed of a site (RFC 4287) and its list of cards for programs."""

import json
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from xml.etree import ElementTree as ET

from ...core.version import __version__
from .entries import CardEntry
from .site_folder import SCHEMA

ATOM = "http://www.w3.org/2005/Atom"
UNDATED = "1970-01-01T00:00:00Z"  # of a card without a date: the feed has no clock
NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "fitmodels.site/1")


def atom_feed(entries: Sequence[CardEntry], title: str) -> bytes:
    """The feed as XML.

    An entry's id comes from the content of its parameter file, the feed's from its title: the same content keeps its
    id wherever the site is. Links are relative, so that the feed works in the folder of its pages.

    Parameters
    ----------
    entries : sequence of Entry
    title : str

    Returns
    -------
    bytes

    Examples
    --------
    >>> atom_feed([], "Cards").split()[-1]
    b'</feed>'
    """
    dated = sorted(((updated(e.created), e) for e in entries), key=lambda pair: pair[1].slug)
    dated.sort(key=lambda pair: pair[0], reverse=True)
    top = ET.Element("feed", xmlns=ATOM)
    _add(top, "id", f"urn:uuid:{uuid.uuid5(NAMESPACE, title)}")
    _add(top, "title", title)
    _add(top, "subtitle", f"Model cards, newest first. Cards without a date are dated {UNDATED[:10]}.")
    _add(top, "updated", max((date for date, _ in dated), default=UNDATED))
    ET.SubElement(_add(top, "author"), "name").text = _clean(title)
    _add(top, "generator", "fitmodels")
    _add(top, "link", rel="self", href="atom.xml", type="application/atom+xml")
    _add(top, "link", rel="alternate", href="index.html", type="text/html")
    for date, e in dated:
        _entry(top, e, date)
    ET.indent(top)
    content: bytes = ET.tostring(top, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


def updated(created: str) -> str:
    """A date of a parameter file as RFC 3339 in UTC, which a date without a zone is taken to be in.

    >>> updated("2024-05-01"), updated("2024-05-01T12:00:00+02:00"), updated("")
    ('2024-05-01T00:00:00Z', '2024-05-01T10:00:00Z', '1970-01-01T00:00:00Z')
    """
    try:
        date = datetime.fromisoformat(created)
        date = date.astimezone(UTC) if date.tzinfo else date
    except (ValueError, OverflowError):  # none, or one at the end of the calendar
        return UNDATED
    return date.replace(tzinfo=None, microsecond=0).isoformat() + "Z"


def _entry(top: ET.Element, e: CardEntry, date: str) -> None:
    item = _add(top, "entry")
    _add(item, "id", f"urn:uuid:{uuid.uuid5(NAMESPACE, e.content_sha256)}")
    _add(item, "title", f"{'Simulated: ' if e.simulated else ''}{e.title}")
    _add(item, "updated", date)
    _add(item, "link", rel="alternate", href=e.href, type="text/html")
    _add(item, "summary", e.summary)
    for term in (e.tool, e.work, *([f"ISO 513 {e.group}"] if e.group else [])):
        _add(item, "category", term=_clean(term))


def _add(parent: ET.Element, name: str, text: str | None = None, **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, name, attributes)
    element.text = None if text is None else _clean(text)
    return element


def _clean(text: str) -> str:
    """Without the characters that XML 1.0 has no way to write."""
    return "".join(c if (c >= " " and c not in "\ufffe\uffff") or c in "\t\n\r" else "\ufffd" for c in text)


def card_list(entries: Sequence[CardEntry], title: str) -> bytes:
    """The list, schema ``fitmodels.site/2``.

    Examples
    --------
    >>> json.loads(card_list([], "Cards"))["cards"]
    []
    """
    cards = [{"href": e.href, **e.model_dump(mode="json")} for e in entries]
    facts = {"schema": SCHEMA, "title": title, "fitmodels": __version__, "cards": cards}
    return (json.dumps(facts, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()
