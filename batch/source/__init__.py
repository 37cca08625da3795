"""Sources: a source -> Plan; a block of the plan -> Rows, or chunks of a stream.

selection       kind of a source                        common           suffixes, limits, blocks of pairs
lab_plan        lab files -> Plan                       lab_files        a block -> Rows, pairs of several files joined
csv_copy        a CSV too large for memory -> Parquet   csv_head         its dialect and columns
csv_rows        its rows in batches                     sorted_copies    a Parquet copy sorted by block
parquet_blocks  Parquet -> Plan                         parquet_reading  a block -> Rows, or chunks
parquet_schema  files and columns of a Parquet source   parquet_index    the pairs in each row group
parquet_arrow   Arrow arrays -> numbers and labels
"""

from .selection import chunks_of, existing_path, open_source, rows_of

__all__ = ["chunks_of", "existing_path", "open_source", "rows_of"]
