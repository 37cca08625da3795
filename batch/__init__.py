"""Thousands of tool/work pairs fitted on one machine or a cluster.

run_batch                  `run`: plan the source, fit its blocks, write the results
plan, rows                 the pairs, blocks and options of a batch; rows as they are read
source/                    a source -> Plan; Block -> Rows, or chunks of a stream
fitting/                   Block -> BlockOutcome: the laws of all pairs at once, parameter files pair by pair
engine/                    tasks -> results as they are finished: in this process, in several, on a Dask cluster
outcomes, law_rows         results of pairs and blocks; laws as rows of a table
records, output_folder     finished blocks on disk, the output folder and its owner
pair_table                 the groups of pairs from a separate table
comparison, attention      families of pairs, and pairs that need attention
tables, figures, site      what is written; result, terminal: what is returned and printed
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
