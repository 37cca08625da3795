"""What is told: the model card, its figures, and what the command prints.

content/    what a card holds: parameter file -> Card, every number with its text
forms/      Card -> README.md, card.html, card.json, linked data, citation
gate/       what a card must tell before it is published, and the card.toml that asks for it
publishing/ many cards -> a static site
replays/    what a replay of a controller tells
card        a parameter file as README.md, in one step
folder      the folder of a pair, all of it or none
"""

from typing import TYPE_CHECKING

from .card import markdown
from .folder import FILES, files, write

if TYPE_CHECKING:
    from .publishing import publish as site

__all__ = ["FILES", "files", "markdown", "site", "write"]


def __getattr__(name: str) -> object:
    if name != "site":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .publishing import publish

    globals()[name] = publish
    return publish
