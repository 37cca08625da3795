from .design import central_composite as central_composite
from .planning import plan_tests as plan_tests
from .reading import read_runs as read_runs
from .reading import runs_from_frame as runs_from_frame
from .records.reading import read_record as read_record
from .records.record import Record as Record
from .records.record import join_records as join_records
from .runs import Runs as Runs
from .sets import bundled as bundled
from .sets import bundled_names as bundled_names
from .sets import fetch as fetch
from .simulation import SimulatedLaw as SimulatedLaw
from .simulation import simulate as simulate
from .simulation import write_csv as write_csv
from .tables.read import read_table as read_table

__all__ = [
    "Record",
    "Runs",
    "SimulatedLaw",
    "bundled",
    "bundled_names",
    "central_composite",
    "fetch",
    "join_records",
    "plan_tests",
    "read_record",
    "read_runs",
    "read_table",
    "runs_from_frame",
    "simulate",
    "write_csv",
]
