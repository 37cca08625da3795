"""What was measured: a lab file becomes columns, units and Runs; bundled sets; plans and simulated tests.

Names are imported when they are first used, so that a reader of parameter files need not load pandas.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .bundles import bundled, bundled_names
    from .columns import ColumnUse
    from .design import central_composite
    from .fetching import fetch
    from .reading import read_runs, runs_from_frame
    from .records.look import looks_like_record
    from .records.reading import read_record
    from .records.record import Record
    from .records.record import join as join_records
    from .runs import Runs, Source
    from .simulation import SimulatedLaw, simulate, write_csv
    from .tables import Table, read_table

_HOME = {
    "ColumnUse": "columns",
    "Record": "records.record",
    "Runs": "runs",
    "SimulatedLaw": "simulation",
    "Source": "runs",
    "Table": "tables",
    "bundled": "bundles",
    "bundled_names": "bundles",
    "central_composite": "design",
    "fetch": "fetching",
    "join_records": "records.record",
    "looks_like_record": "records.look",
    "read_record": "records.reading",
    "read_runs": "reading",
    "read_table": "tables",
    "runs_from_frame": "reading",
    "simulate": "simulation",
    "write_csv": "simulation",
}

_INSIDE = {"join_records": "join"}  # what a name is called in its module, where that differs

__all__ = [
    "ColumnUse",
    "Record",
    "Runs",
    "SimulatedLaw",
    "Source",
    "Table",
    "bundled",
    "bundled_names",
    "central_composite",
    "fetch",
    "join_records",
    "looks_like_record",
    "read_record",
    "read_runs",
    "read_table",
    "runs_from_frame",
    "simulate",
    "write_csv",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), _INSIDE.get(name, name))
    globals()[name] = value
    return value
