"""A shop of pairs: thousands of tool/work pairs fitted in one go, on one machine or a cluster.

plan, rows, how            what is to be done, rows as they are read, options
outcome, law_table         what came of pairs, and their laws as a table
failures                   what failed, as a sentence
source/    SOURCE -> Plan; Block -> Rows, or chunks of a stream
fitting/   Block -> BlockOutcome: the table of laws from stacks, parameter files pair by pair
engine/    tasks -> results as they are done: here, in processes, on a Dask cluster
result/    outcomes -> records to resume from, tables, who needs attention, families
whole_way  all of it, one after the other
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .how import How
from .plan import Pair, Plan, Reading

if TYPE_CHECKING:
    from .made import Batch
    from .whole_way import run

__all__ = ["Batch", "How", "Pair", "Plan", "Reading", "run"]

_HOME = {"Batch": "made", "run": "whole_way"}  # imported on first use


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(f".{_HOME[name]}", __name__), name)
    return globals()[name]
