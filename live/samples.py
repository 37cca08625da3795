"""Readings of a running machine, notices of their source, and the steady parts of cuts that are found in them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

State = Literal["unknown", "off", "idle", "feed"]
Kind = Literal["connected", "lost", "gap", "bad", "clock", "replaced", "idle", "end", "refused"]


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of a machine.

    Attributes
    ----------
    time : float
        s since 1970 (UTC) by the clock of the source, or s since the start of a recorded run.
    loads : mapping
        Readings of loads by their symbol in the parameter file (``P``, ``Fc``, ``I``), in the units of its laws. A load
        that was not read, or whose quality is bad, is absent.
    conditions : mapping
        ``V`` in m/min, ``f`` in mm/rev, ``d`` in mm and others, as far as the source has them.
    state : str
        Of the machine as it says itself: ``"off"`` (spindle stopped), ``"idle"`` (no feed motion), ``"feed"``.
    tool : str
        As the source names it; empty where it does not.
    bad : str
        What is wrong with the reading, empty where nothing is.

    Examples
    --------
    >>> Sample(12.5, {"P": 1.8}, {"V": 120.0, "f": 0.2, "d": 2.0}).state
    'unknown'
    """

    time: float
    loads: Mapping[str, float]
    conditions: Mapping[str, float] = field(default_factory=dict)
    state: State = "unknown"
    tool: str = ""
    bad: str = ""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that happened to a source, or ``"idle"``: nothing was read for a moment.

    Attributes
    ----------
    time : float
        s by the clock of this program.
    kind : str
        ``"connected"``, ``"lost"``, ``"gap"`` (samples are missing), ``"bad"`` (quality), ``"clock"`` (times jumped),
        ``"replaced"`` (another file under the same name), ``"idle"``, ``"refused"`` (what cannot be used) or ``"end"``.
    text : str
        What happened, in one sentence with its values.
    """

    time: float
    kind: Kind
    text: str = ""


@dataclass(frozen=True, slots=True)
class LoadMean:
    """Mean of a load over a window, idle load subtracted where the law is one of cutting alone.

    Attributes
    ----------
    ln : float
        Of the mean load.
    se : float
        Its standard error, with the errors of the idle load and of serial correlation.
    samples : int
    """

    ln: float
    se: float
    samples: int


@dataclass(frozen=True, slots=True)
class Window:
    """A steady part of a cut.

    Attributes
    ----------
    start, end : float
        s, by the clock of the source.
    contact : float
        Minutes of cutting since the window before it ended (or the cut began), with parts that were not steady.
    conditions : mapping
        Means of V, f, d and others over the steady part, and over parts before it that were in no window.
    loads : mapping
        `LoadMean` by symbol.
    cut : int
        Number of the cut.
    """

    start: float
    end: float
    contact: float
    conditions: Mapping[str, float]
    loads: Mapping[str, LoadMean]
    cut: int = 0


@dataclass(frozen=True, slots=True)
class CutEnd:
    """End of a cut.

    Attributes
    ----------
    time : float
        s, by the clock of the source.
    contact : float
        Minutes of cutting since the last window.
    cut : int
        Number of the cut.
    lost : bool
        Whether it ended because the signal was lost: the cut may have gone on.
    unseen : bool
        Whether it began before the source was read.
    """

    time: float
    contact: float
    cut: int = 0
    lost: bool = False
    unseen: bool = False
