"""The static site of many cards: found, checked, written, compared."""

from .build import TITLE, PublicationReport, check, publish
from .build import publish as site
from .entries import CardEntry, ExponentEntry, LawEntry
from .pair import PublicationProblem

__all__ = [
    "TITLE",
    "CardEntry",
    "ExponentEntry",
    "LawEntry",
    "PublicationProblem",
    "PublicationReport",
    "check",
    "publish",
    "site",
]
