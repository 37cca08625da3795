"""The two pages of a site, each one file with its style and script, allowed by their checksums."""

import json
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

from markupsafe import Markup

from ..forms.page import data_block
from ..forms.rendering import asset, checksum, environment
from .comparison import exponents_data, tables
from .entries import CardEntry

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


def index_page(entries: Sequence[CardEntry], title: str) -> str:
    """``index.html``: a table of links, which a script lets one search, filter and sort.

    Examples
    --------
    >>> "<h1>Cards</h1>" in index_page([], "Cards")
    True
    """
    return _page("site_index", title, entries, choices=_choices(entries))


def compare_page(entries: Sequence[CardEntry], title: str) -> str:
    """``compare.html``: exponents with their intervals in tables, which a script draws on one axis.

    Examples
    --------
    >>> "Compare exponents" in compare_page([], "Cards")
    True
    """
    data = json.dumps(exponents_data(entries), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return _page(
        "site_compare", title, entries, choices=_choices(entries), tables=tables(entries), data=data_block(data)
    )


def _page(name: str, title: str, entries: Sequence[CardEntry], **more: object) -> str:
    style = asset("page.css") + asset("site.css")
    script = asset(f"{name}.js")
    return (
        _environment()
        .get_template(f"{name}.html")
        .render(
            title=title,
            entries=entries,
            simulated=sum(e.simulated for e in entries),
            style=Markup(style),  # noqa: S704  our own
            script=Markup(script),  # noqa: S704  our own
            style_hash=checksum(style),
            script_hash=checksum(script),
            **more,
        )
    )


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
