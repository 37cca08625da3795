"""The design section: the tests behind the laws, so that a card can be made from the file alone."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from ..errors import short
from .base import Count, Number, Positive, Section, Text
from .law_parts import DroppedRows

FEW = 15  # levels that are listed; more of them are a range
OneOrMore = Annotated[int, Field(strict=True, ge=1, lt=2**63)]


class DesignFactor(Section):
    """A factor of the tests: its range in ``unit``, and its distinct levels where they are few (at most 15).

    Examples
    --------
    >>> DesignFactor(symbol="f", quantity="feed", unit="mm/rev", low=0.25, high=0.5, levels=(0.25, 0.5)).low
    0.25
    """

    symbol: Text
    quantity: str
    unit: str
    low: Number
    high: Number
    levels: Annotated[tuple[Number, ...], Field(max_length=FEW)] = ()

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"the range of {short(self.symbol)} has low {self.low:g} above high {self.high:g}")
        return self


class DesignLevel(Section):
    """A level of the category that shifts the laws, and what was cut at it."""

    level: str
    rows: Count
    edges: Count | None = None


class LeftOutRows(DroppedRows):
    """Rows that laws did not use, and of which responses; ``lines`` are the first of them in the data file."""

    laws: tuple[Text, ...]


class EdgeFacts(Section):
    """What the cutting edges of the tests are like.

    Attributes
    ----------
    edges : int
        Edges in the file.
    rows_least, rows_median, rows_most
        Rows of an edge.
    replicated, replicated_edges : int
        Settings that more than one edge was cut at, and how many edges stand there.
    settings : int
        Distinct settings of the conditions that stay the same on every edge, which ``set_by_edge`` names.
    short, short_edges
        Edges with fewer than half the median rows, and the first of their names: they ended early.
    worn : int or None
        Edges of which some wear reached the criterion; None where wear or criterion is not known.
    """

    edges: OneOrMore
    rows_least: OneOrMore
    rows_median: Positive
    rows_most: OneOrMore
    set_by_edge: tuple[Text, ...] = ()
    settings: Count = 0
    replicated: Count = 0
    replicated_edges: Count = 0
    short: Count = 0
    short_edges: tuple[str, ...] = ()
    worn: Count | None = None


class Criterion(Section):
    """The wear at which an edge counts as worn out; ``source`` says who set it."""

    wear: Text
    value: Positive
    unit: str
    source: str = ""


class DesignSection(Section):
    """The tests behind the laws.

    Files of earlier versions lack this section; it came with schema version 1 and is optional, so that they stay
    valid and need no step.

    Attributes
    ----------
    rows : int
        Of the data, those no law uses among them.
    factors : tuple of DesignFactor
        Conditions and time, and what else a law has as a factor.
    plan : str or None
        Kind of plan, where the settings are those of one that is known: ``central composite`` ...
    edges : EdgeFacts or None
        None where no column names the edges.
    by, levels
        Category that shifts the laws, and its levels.
    left_out : tuple of LeftOutRows
        Rows that some law does without, and why.
    criterion : Criterion or None
    understood : tuple of str
        What was understood of the data file, a sentence each.

    Examples
    --------
    >>> feed = {"symbol": "f", "quantity": "feed", "unit": "mm/rev", "low": 0.1, "high": 0.4}
    >>> DesignSection(rows=12, factors=[feed]).rows
    12
    """

    rows: Count
    factors: tuple[DesignFactor, ...] = ()
    plan: str | None = None
    edges: EdgeFacts | None = None
    by: str | None = None
    levels: tuple[DesignLevel, ...] = ()
    left_out: tuple[LeftOutRows, ...] = ()
    criterion: Criterion | None = None
    understood: tuple[str, ...] = ()
