"""Results of one pair and of one block, and failures as sentences."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import pandas as pd

from ..core.errors import FitmodelsError

T = TypeVar("T")

DEFECT = "internal error of fitmodels, not of the data"
GONE = "the source has no row of this pair any more: it changed after it was planned. Run the command again."


@dataclass(frozen=True, slots=True)
class Failure:
    """The reason of a failure; ``expected`` where its cause is in the data."""

    reason: str
    expected: bool


def attempt(work: Callable[[], T]) -> T | Failure:
    """The result of ``work``, or its failure; only a lack of memory is not caught.

    Examples
    --------
    >>> attempt(lambda: 1 / 0).reason
    'internal error of fitmodels, not of the data: ZeroDivisionError: division by zero.'
    """
    try:
        return work()
    except MemoryError:
        raise
    except FitmodelsError as error:
        return Failure(str(error), True)
    except Exception as error:
        return Failure(defect_sentence(error), False)


def defect_sentence(error: Exception) -> str:
    """An unexpected error as a sentence on one line.

    Examples
    --------
    >>> defect_sentence(TypeError("no"))
    'internal error of fitmodels, not of the data: TypeError: no.'
    """
    words = " ".join(str(error).split())[:500].rstrip(".")
    return f"{DEFECT}: {type(error).__name__}{f': {words}' if words else ''}."


Cell = str | float | int | bool | None

# Kinds of concern that are used in several modules.
NO_LAW, REFUSED, NOT_CONVERGED, DOUBT = "no law", "law refused", "not converged", "doubt in reading"
GROUPS_DIFFER = "group differs"


@dataclass(frozen=True, slots=True)
class Concern:
    """A reason why a pair needs attention: ``kind`` is shared by pairs, ``words`` are those of the pair.

    >>> Concern("few edges", "4 edges for 5 parameters").kind
    'few edges'
    """

    kind: str
    words: str

    def __reduce__(self) -> tuple[type["Concern"], tuple[str, str]]:  # a third of the time that a dataclass takes
        return Concern, (self.kind, self.words)


@dataclass(frozen=True, slots=True)
class PairOutcome:
    """Result of one pair.

    Attributes
    ----------
    tool, work : str
    nobs : int
        Rows that name the pair, usable or not.
    reason : str
        Reason why there is no law; empty otherwise.
    concerns : tuple of Concern
    groups : mapping of str to str
        Groups of the pair by header; empty text where its rows name none.
    simulated : bool
        Its rows are marked as simulated.
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

    def __reduce__(self) -> tuple[type["PairOutcome"], tuple[object, ...]]:
        given = (self.tool, self.work, self.nobs, self.reason, self.concerns, self.groups, self.simulated, self.files)
        return PairOutcome, given


@dataclass(frozen=True, slots=True, eq=False)
class BlockOutcome:
    """Result of one block: an outcome for each of its pairs, in its order, and all their laws.

    Attributes
    ----------
    pairs : tuple of PairOutcome
    laws : DataFrame
        A row for each law that the columns of a pair ask for, as `law_table` makes it: ``pair``, its number among
        ``pairs``; ``response, form, unit, reason`` (empty where there is a law); the columns of `ManyLaws.table`
        (``nobs, n_edges, df, ..., params_V, bse_V ...``).
    unreadable : mapping of str to str
        Pieces that could not be read, with the reason in a sentence.
    units : mapping of str to str
        Unit of each role.
    seconds : float
        How long it took.
    memory : int
        Largest memory of the process so far, in bytes.
    csv : bytes
        Its part of ``results.csv``, with the header; empty where the process that fitted it did not write it.
    """

    pairs: tuple[PairOutcome, ...]
    laws: pd.DataFrame
    unreadable: Mapping[str, str]
    units: Mapping[str, str]
    seconds: float = 0.0
    memory: int = 0
    csv: bytes = b""

    @property
    def settled(self) -> bool:
        """Whether it is final: everything could be read, and there was no internal error, which may be temporary."""
        found = (words for pair in self.pairs for words in (pair.reason, *(each.words for each in pair.concerns)))
        return not self.unreadable and not any(DEFECT in words for words in found)


def cell(value: object) -> Cell:
    """A value of a row as a Python object; None where it is no finite number.

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
