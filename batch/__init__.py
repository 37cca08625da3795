"""Thousands of tool/work pairs fitted on one machine or a cluster.

plan, rows        what is fitted with which options; rows as they are read
outcome, tables   results of pairs and blocks, and their laws as a table
source/           SOURCE -> Plan; Block -> Rows, or chunks of a stream
fitting/          Block -> BlockOutcome: the table of laws of all pairs at once, parameter files pair by pair
engine/           tasks -> results as they are finished: in this process, in several, on a Dask cluster
run_batch         `run`: all of it, one after the other
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
