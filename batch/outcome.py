"""What came of a pair and of a block: laws, files, reasons."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

from .failures import DEFECT

Cell = str | float | int | bool | None

NO_LAW, REFUSED = "no law", "law refused"  # kinds of concern that several look for


@dataclass(frozen=True, slots=True)
class Concern:
    """Why a pair needs attention: ``kind`` is that of all pairs that need it for this reason, ``words`` are its own.

    >>> Concern("few edges", "4 edges for 5 parameters").kind
    'few edges'
    """

    kind: str
    words: str


@dataclass(frozen=True, slots=True)
class PairOutcome:
    """What came of a pair.

    Attributes
    ----------
    tool, work : str
    nobs : int
        Rows that name the pair, usable or not.
    reason : str
        Why there is no law at all; empty otherwise.
    concerns : tuple of Concern
    groups : mapping of str to str
        What the pair belongs to, by header; empty text where its rows do not say.
    simulated : bool
        Its rows say of themselves that they are no measurements.
    files : mapping of str to bytes
        ``params.json``, and ``draws.npz`` where draws are kept.
    """

    tool: str
    work: str
    nobs: int
    reason: str = ""
    concerns: tuple[Concern, ...] = ()
    groups: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False
    files: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class BlockOutcome:
    """What came of a block: one outcome for each of its pairs, in its order, and all their laws.

    Attributes
    ----------
    pairs : tuple of PairOutcome
    laws : DataFrame
        A row for each law that the columns of a pair ask for, as `law_table` makes it: ``pair``, its number among
        ``pairs``; ``response, form, unit, reason`` (empty where there is a law); the columns of `ManyLaws.table`
        (``nobs, n_edges, df, ..., params_V, bse_V ...``).
    unreadable : mapping of str to str
        Pieces that could not be read, with the sentence that says why.
    units : mapping of str to str
        Unit of each role.
    seconds : float
        How long it took.
    memory : int
        Largest memory of the process so far, in bytes.
    """

    pairs: tuple[PairOutcome, ...]
    laws: pd.DataFrame
    unreadable: Mapping[str, str]
    units: Mapping[str, str]
    seconds: float
    memory: int

    @property
    def settled(self) -> bool:
        """Whether it may stand: all could be read, and nothing failed by a defect of this program, which may pass."""
        said = (words for pair in self.pairs for words in (pair.reason, *(each.words for each in pair.concerns)))
        return not self.unreadable and not any(DEFECT in words for words in said)


def cell(value: object) -> Cell:
    """A value of a row as Python's own; what is no number, or none that is finite, is None.

    Examples
    --------
    >>> import numpy as np
    >>> cell(np.float64(0.5)), cell(np.int64(3)), cell(float("nan")), cell("exact")
    (0.5, 3, None, 'exact')
    """
    if isinstance(value, str | bool | int) or value is None:
        return value
    if value is pd.NA:
        return None
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value if isinstance(value, str | bool | int) else str(value)
