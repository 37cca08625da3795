"""Sources: SOURCE -> Plan; a block of the plan -> Rows, or chunks of a stream.

open_source   which kind of source it is             lab_file     a lab file -> Runs, named where it names no tool
files_plan    lab files -> Plan                      files_rows   a block -> Rows, pairs of several files joined
csv_stream    a CSV too large for memory -> Parquet  csv_head     how it is written
csv_rows      its rows, block by block               csv_cells    cells -> numbers
parquet_plan  Parquet -> Plan                        parquet_rows a block -> Rows, or chunks
"""

from .selection import chunks_of, existing_path, open_source, rows_of

__all__ = ["chunks_of", "existing_path", "open_source", "rows_of"]
