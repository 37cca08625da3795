"""What came of a pair and of a block: rows of the table, files, reasons."""

from collections.abc import Mapping
from dataclasses import dataclass, field

Cell = str | float | int | bool | None


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
    laws : tuple of mapping
        A row of the results table for each law that its columns ask for: ``response``, ``reason`` (empty where there
        is a law) and the columns of `ManyLaws.table` (``nobs, n_edges, df, ..., params_V, bse_V ...``).
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
    laws: tuple[Mapping[str, Cell], ...] = ()
    reason: str = ""
    concerns: tuple[Concern, ...] = ()
    groups: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False
    files: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BlockOutcome:
    """What came of a block: one outcome for each of its pairs, in its order.

    Attributes
    ----------
    pairs : tuple of PairOutcome
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
    unreadable: Mapping[str, str]
    units: Mapping[str, str]
    seconds: float
    memory: int
