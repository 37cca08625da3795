"""The static site of many cards: found, judged, written, compared."""

from .build import TITLE, check, publish
from .entry import Entry, Exponent, LawEntry
from .report import Problem, Report

__all__ = ["TITLE", "Entry", "Exponent", "LawEntry", "Problem", "Report", "check", "publish"]
