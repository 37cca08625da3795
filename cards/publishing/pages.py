"""The pages of a site, each one file with its style and script, allowed by their checksums; marks of a draft.

For programs, the Atom feed of the site (RFC 4287) and its list of cards.
"""

import re
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from markupsafe import Markup, escape

from ...core.text import json_text, printable
from ...core.verdict import MARKS
from ...core.version import __version__
from ..forms.markdown import text
from ..forms.rendering import asset, checksum, data_block, environment
from .entries import CardEntry, exponents_data, sources, tables
from .site_folder import SCHEMA

if TYPE_CHECKING:
    from jinja2 import Environment

GROUPS = {
    "P": "P, steel",
    "M": "M, stainless steel",
    "K": "K, cast iron",
    "N": "N, non-ferrous",
    "S": "S, heat-resistant alloys and titanium",
    "H": "H, hardened",
}


ATOM = "http://www.w3.org/2005/Atom"
UNDATED = "1970-01-01T00:00:00Z"  # of a card without a date: the feed has no clock
NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "fitmodels.site/1")
DRAFT = "Draft, not published."
NO_GAPS = "Nothing is missing in this card."
ROBOTS = '<meta name="robots" content="noindex">'


def index_page(
    entries: Sequence[CardEntry], title: str, *, draft: bool = False, left_out: Sequence[tuple[str, str]] = ()
) -> str:
    """``index.html``: a table of links, which a script lets one search, filter and sort.

    Parameters
    ----------
    entries : sequence of CardEntry
    title : str
    draft : bool
        Whether the page is marked as a draft.
    left_out : sequence of (str, str)
        Folder of each pair of a draft that has no card, and the reason.

    Examples
    --------
    >>> "<h1>Cards</h1>" in index_page([], "Cards")
    True
    """
    more = {"choices": _choices(entries), "sources": sources(entries)}
    return _page("site_index", title, entries, draft=draft, left_out=left_out, **more)


def compare_page(entries: Sequence[CardEntry], title: str, *, draft: bool = False) -> str:
    """``compare.html``: exponents with their intervals in tables, which a script draws on one axis.

    Examples
    --------
    >>> "Compare exponents" in compare_page([], "Cards")
    True
    """
    data = json_text(exponents_data(entries), separators=(",", ":"))
    facts = {"tables": tables(entries), "sources": sources(entries), "data": data_block(data)}
    return _page("site_compare", title, entries, draft=draft, choices=_choices(entries), **facts)


def mark_page(page: bytes, gaps: Sequence[str]) -> bytes:
    """The page of a card marked as a draft: in its title, for search engines, and as a list of the gaps at its top.

    Examples
    --------
    >>> mark_page(b"<head><title>a</title></head><body></body>", ["missing: <b>."]).decode()[-50:]
    '<ul><li>Missing: &lt;b&gt;.</li></ul></div></body>'
    """
    listed = "".join(f"<li>{escape(_capital(gap))}</li>" for gap in gaps or [NO_GAPS])
    note = f'<div class="warn" role="note"><p><strong>{DRAFT}</strong></p><ul>{listed}</ul></div>'
    marked = page.decode().replace("<title>", f"{ROBOTS}\n<title>Draft: ", 1)
    return re.sub(r"<body[^<>]*>(?:\s*<header[^<>]*>)?", lambda found: f"{found[0]}\n{note}", marked, count=1).encode()


def mark_readme(readme: bytes, gaps: Sequence[str]) -> bytes:
    r"""The Markdown of a card marked as a draft below its front matter.

    Examples
    --------
    >>> print(mark_readme(b"---\na: 1\n---\n# T", ["missing: license."]).decode())
    ---
    a: 1
    ---
    <BLANKLINE>
    > **Draft, not published.** Missing: license.
    # T
    """
    _, head, body = readme.decode().split("---\n", 2)
    words = " ".join(text(_capital(gap)) for gap in gaps or [NO_GAPS])
    return f"---\n{head}---\n\n> **{DRAFT}** {words}\n{body}".encode()


def _capital(sentence: str) -> str:
    return f"{sentence[:1].upper()}{sentence[1:]}"


def _page(name: str, title: str, entries: Sequence[CardEntry], **more: object) -> str:
    style = asset("page.css") + asset("site.css")
    script = asset(f"{name}.js")
    template = _environment().get_template(f"{name}.html")
    page = template.render(
        title=title,
        entries=entries,
        marks={mark.words: mark for mark in MARKS.values()},
        simulated=sum(e.simulated for e in entries),
        gaps=sum(bool(e.gaps) for e in entries),
        style=Markup(style),  # noqa: S704  our own
        script=Markup(script),  # noqa: S704  our own
        style_hash=checksum(style),
        script_hash=checksum(script),
        **more,
    )
    return printable(page)


def _choices(entries: Sequence[CardEntry]) -> dict[str, list[tuple[str, str]]]:
    """Value and words of each filter, in order; one that would leave nothing to choose is empty."""
    found = {
        "tool": [(name, name) for name in {e.tool for e in entries}],
        "work": [(name, name) for name in {e.work for e in entries}],
        "group": [(letter, GROUPS[letter]) for letter in {e.group for e in entries} if letter],
        "verdict": [(words, words) for words in {e.verdict for e in entries} if words],
        "law": list({(law.response, f"{law.response}, {law.quantity}") for e in entries for law in e.laws}),
    }
    return {name: sorted(options, key=lambda o: (o[1].casefold(), o)) for name, options in found.items()}


@lru_cache(maxsize=1)
def _environment() -> "Environment":
    return environment(autoescape=True)


def atom_feed(entries: Sequence[CardEntry], title: str, *, draft: bool = False) -> bytes:
    """The feed as XML.

    An entry's id comes from the content of its parameter file, the feed's from its title: the same content keeps its
    id wherever the site is. Links are relative, so that the feed works in the folder of its pages.

    Parameters
    ----------
    entries : sequence of CardEntry
    title : str
    draft : bool
        Whether the title of the feed and of each card says so.

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
    _add(top, "title", f"{'Draft: ' if draft else ''}{title}")
    _add(top, "subtitle", f"Model cards, newest first. Cards without a date are dated {UNDATED[:10]}.")
    _add(top, "updated", max((date for date, _ in dated), default=UNDATED))
    ET.SubElement(_add(top, "author"), "name").text = printable(title)
    _add(top, "generator", "fitmodels")
    _add(top, "link", rel="self", href="atom.xml", type="application/atom+xml")
    _add(top, "link", rel="alternate", href="index.html", type="text/html")
    for date, e in dated:
        _entry(top, e, date, "Draft: " if draft else "")
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


def _entry(top: ET.Element, e: CardEntry, date: str, mark: str) -> None:
    item = _add(top, "entry")
    _add(item, "id", f"urn:uuid:{uuid.uuid5(NAMESPACE, e.content_sha256)}")
    _add(item, "title", f"{mark}{'Simulated: ' if e.simulated else ''}{e.title}")
    _add(item, "updated", date)
    _add(item, "link", rel="alternate", href=e.href, type="text/html")
    _add(item, "summary", e.summary)
    for term in (e.tool, e.work, *([f"ISO 513 {e.group}"] if e.group else [])):
        _add(item, "category", term=printable(term))


def _add(parent: ET.Element, name: str, text: str | None = None, **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, name, attributes)
    element.text = None if text is None else printable(text)
    return element


def card_list(entries: Sequence[CardEntry], title: str, *, draft: bool = False) -> bytes:
    """The list, schema ``fitmodels.site/5``; ``draft`` is true where its cards are not published.

    Examples
    --------
    >>> import json
    >>> json.loads(card_list([], "Cards"))["cards"]
    []
    """
    cards = [{"href": e.href, **e.model_dump(mode="json")} for e in entries]
    facts = {"schema": SCHEMA, "title": title, "fitmodels": __version__, "draft": draft, "cards": cards}
    return (json_text(facts, indent=1) + "\n").encode()
