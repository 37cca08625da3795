"""Model cards, their figures, the output of the command, and a site of many cards.

content/    parameter file -> Card: facts with numbers and texts, shown by every form and by the command
forms/      Card -> README.md, card.html, card.json, linked data, citation
publishing/ requirements for publishing, card.toml, and a static site of many cards
replays/    output of a replay of a controller
folder      the folder of a pair, all of it or none
terminal    output of the main job and of an identification
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
