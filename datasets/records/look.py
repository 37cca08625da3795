"""Whether a file holds a record of samples or a table of cutting tests."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ...core.errors import DataError, UsageError
from ..tables import Table, read_table
from ..tables.decode import load_bytes
from ..units import is_unit
from ..vocabulary import ROLES
from .columns import heads, is_label, rises_evenly, seconds_in, signals, time_column, times
from .formats import kind_of

FEW = 50  # rows; a shorter table of even times may as well be a wear test
TESTED = ("edge", "V", "f")  # roles of a cutting test


@dataclass(frozen=True, slots=True, repr=False)
class Look(Displayable):
    """What a file looks like, and why; true when it is a record.

    Attributes
    ----------
    kind : {"record", "table", "either"}
    reason : str

    Examples
    --------
    >>> bool(Look("either", "12 rows at even times")), bool(Look("record", "even times"))
    (False, True)
    """

    kind: Literal["record", "table", "either"]
    reason: str

    def __bool__(self) -> bool:
        return self.kind == "record"


def looks_like_record(file: str | os.PathLike[str] | Table) -> Look:
    r"""Tell a record from a table of cutting tests.

    A record has an evenly spaced column of times and two or more signals, and no column that is an edge, a cutting
    speed V, a feed f or a wear. Even times beside such a column, a few rows, or times in minutes leave it open
    (``either``): the user is asked to say ``fitmodels ident``.

    Parameters
    ----------
    file : path, or a Table that was read with ``is_unit`` of this room

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "run.csv")
    >>> _ = path.write_text("t [s],u,y\n" + "".join(f"{k / 50},{k % 3},{k % 5}\n" for k in range(60)))
    >>> looks_like_record(path).reason
    't rises evenly beside 2 signals, and nothing tells of a cutting test'
    """
    if not isinstance(file, Table):
        path = Path(file)
        kind = kind_of(load_bytes(path), path.name)
        if kind != "table":
            return Look("record", f"a file of samples ({kind})")
        file = read_table(path, is_unit=is_unit)
    known = heads(file.columns)
    wear = [h.role for h in known if h.role and ROLES[h.role].kind == "wear"]
    if wear:
        return Look("table", f"a column of wear, {wear[0]}")
    try:
        clock = time_column(known)
        values, scale = times(clock) if clock is not None and clock.column.is_numeric else (None, 1.0)
    except UsageError:
        return Look("table", "more than one column may be the time")
    except DataError as refusal:
        return Look("table", str(refusal))
    if clock is None:
        return Look("table", "no column rises evenly as a time does")
    count = len(signals(known, clock))
    if count < 2:
        return Look("table", f"{count} signal(s) beside the time {clock.name}")
    if values is not None and not _even(np.asarray(values, dtype=np.float64), any(is_label(h) for h in known)):
        return Look("table", f"{clock.name} does not rise evenly")
    tested = [h.name for h in known if h.role in TESTED]
    even = f"{clock.name} rises evenly beside {count} signals"
    if tested:
        return Look("either", f"{even}, as in a record, but {tested[0]} reads as that of a cutting test")
    if file.n_rows < FEW or scale == seconds_in("min"):
        return Look("either", f"{even}, but {file.n_rows} rows in {clock.unit or 'no unit'} may be a cutting test")
    return Look("record", f"{even}, and nothing tells of a cutting test")


def _even(values: NDArray[np.float64], runs: bool) -> bool:
    """Whether times rise evenly, but for gaps and, told by a label or by falling back, further runs."""
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    rising = finite[1:][steps > 0]
    if len(rising) < 3 or np.count_nonzero(steps < 0) > 0.05 * len(steps):
        return False
    middle = float(np.median(steps[steps > 0]))
    return rises_evenly(finite) or bool(np.mean(np.abs(steps - middle) <= 0.1 * middle) >= 0.9 or runs)
