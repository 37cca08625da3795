"""A text file or workbook becomes columns, with no knowledge of what they mean.

decode     bytes -> lines of text              dialect   lines -> delimiter and kind of file
numerals   a cell -> a number, or not          layout    which row is header, units, data, footer
workbook   a book -> sheets -> rows of cells   body      the rows of data, block by block
sheets     which sheet holds the table         header_rows  several rows -> names and units
gather     blocks -> columns                   read      all steps in order, with warnings and doubts
"""

from .gather import Column, column_of_texts, rows_to_leave_out
from .numerals import STOPPED, is_number
from .read import Table, no_units, read_table

__all__ = ["STOPPED", "Column", "Table", "column_of_texts", "is_number", "no_units", "read_table", "rows_to_leave_out"]
