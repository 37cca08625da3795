"""Every laboratory file of known truth is read right, refused with a remedy that works, or doubted by column.

`python tests/laboratory_files.py` prints the table.
"""

import sys
from pathlib import Path

import pytest

PATH = list(sys.path)
sys.path.insert(0, str(Path(__file__).parent))

from laboratory_files import CASES
from laboratory_truth import READ, SILENT, deviation, judge, reads, table, wear_test

sys.path[:] = PATH

PENDING: set[str] = {
    "VB in um, no unit named",
    "VB in um under a header in mm",
    "VB in um, said in a note",
    "inch file: SFM, IPR, DOC, Wear",
    "inch file: SFM, IPR, DOC, Wear, none with a unit",
    "wear in thousandths of an inch, no unit named",
    "V in m/s, no unit named",
    "V in sfm, no unit named, beside P and Fc",
    "t in s, no unit named",
    "t in s under a header in min",
    "d in cm under a header in mm",
    "f in um/rev under a header in mm/rev",
    "power in W, no unit named",
    "power in W under a header in kW",
    "force in kN, no unit named",
    "feed in mm/min under a header f, with n",
    "feed in mm/min under a header f, without n",
    "headers of V and t exchanged",
    "headers of f and d exchanged",
    "headers of AW and f exchanged",
    "a header with one cell more than every row",
    "a zero-width character in a header",
    "soft hyphen, bidi mark and two blanks in headers",
    "a header with a look-alike Cyrillic letter",
    "a factor under a name nobody knows",
    "a factor under a code",
    "headers of a parameter list, with remarks",
    "the header repeated on every page",
    "row names of R's write.table",
    "missing wear as 999",
    "wear below the gauge: <0.09",
    "wear above the scale: >0.3",
    "wear with a mark: 0.24*",
    "averages among the rows, by label",
    "averages among the rows, without a label",
    "times as min:s",
    "times as h:min:s",
    "time running through all edges",
    "time of each sub-test instead of the time on the edge",
    "Insert: 24 values are edges",
    "Insert: 13 values are edges",
    "Platte: the edges of a German table",
    "plate and corner together are the edge",
    "blank edge cells below the first",
    "blank cells of edge and conditions below the first",
    "no edge column, in file order",
    "no edge column, random conditions, two edges alike",
    "no edge column, shuffled",
    "an edge column that numbers every row",
    "an edge name in three spellings",
    "an edge name misspelled in a row",
    "rows copied twice",
    "n, D and vf instead of V and f",
    "n and f, the diameter in a note",
    "n and f, no diameter",
    "milling: n, vf, z, D",
    "milling: fz and z",
    "nose, flank and notch wear",
    "three readings of the land",
    "cutting length and vf instead of time",
    "one cell of wear x10",
    "one cell of wear x1000",
    "one cell of wear x25.4",
    "one cell of wear without its decimal mark",
    "one digit swapped in V",
    "one cell of f x10",
    "three rows of wear in inches",
    "f in inches on 4 edges",
    "V in sfm on 4 edges",
    "t in seconds on 3 edges",
    "wear in um on 2 edges",
    "a row shifted by one cell",
    "the wear column shifted by a row",
    "a tool-life table with run-outs",
    "three forces at 1 kHz",
    "a record of spindle current",
    "wide: a column of wear for each edge",
    "wide: a column of wear for each time",
    "wide: times as headers below a title",
    "blocks: a heading row for each test",
    "workbook: .xls",
    "workbook: .ods",
    "workbook: .xlsb",
    "workbook: merged edge cells",
    "workbook: merged cells of edge and conditions",
    "workbook: cover sheet, two header rows, units row, remarks",
    "workbook: a summary sheet before the data",
    "workbook: hidden rows of bad measurements",
    "workbook: a filter hides half of the edges",
    "workbook: a hidden column of an older measurement",
    "workbook: times as [mm]:ss",
    "workbook: times as h:mm:ss",
    "workbook: a sheet for each test",
    "a folder: a file for each test",
    "a folder: the conditions in notes of each file",
    "a folder: one file in other units",
    "a folder: two files of the same edge numbers, two tools",
}  # cases that are not yet read; empty when the reading is complete


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_read_right_refused_or_doubted(tmp_path, name):
    verdict = judge(CASES[name], tmp_path)
    if name in PENDING:
        pytest.xfail(verdict.fault)
    assert verdict.fault == ""
    assert verdict.outcome not in (SILENT, "ERROR")


def test_there_are_enough_of_them():
    assert len(CASES) >= 60


def test_the_comparison_sees_a_wrong_factor_and_a_wrong_unit(tmp_path):
    w = wear_test("comparison")
    truth = w[["edge", "V", "f", "d", "t", "AW"]]
    for wrong in (truth.assign(AW=truth["AW"] * 25.4), truth.assign(f=1 / truth["f"]), truth.drop(columns="d")):
        path = tmp_path / "wrong.csv"
        path.write_text(table(wrong))
        assert deviation(reads(path).laws, truth) > 3
    assert CASES["the clean table"].expected == (READ,)
