"""``cards.json``: the cards of a site for a program."""

import json
from collections.abc import Sequence

from ...core.version import __version__
from .entry import Entry
from .place import SCHEMA


def listing(entries: Sequence[Entry], title: str) -> bytes:
    """The list, schema ``fitmodels.site/1``.

    Examples
    --------
    >>> json.loads(listing([], "Cards"))["cards"]
    []
    """
    cards = [{"href": e.href, **e.model_dump(mode="json")} for e in entries]
    facts = {"schema": SCHEMA, "title": title, "fitmodels": __version__, "cards": cards}
    return (json.dumps(facts, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()
