"""Every laboratory file of known truth is read right, refused with a remedy that works, or doubted by column.

`python tests/laboratory_files.py` prints the table.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from laboratory_files import CASES
from laboratory_truth import READ, SILENT, deviation, judge, reads, table, wear_test

sys.path.remove(str(Path(__file__).parent))

PENDING: set[str] = {
    "averages among the rows, by label",
    "times as min:s",
    "times as h:min:s",
    "n and f, no diameter",
    "workbook: cover sheet, two header rows, units row, remarks",
    "workbook: times as [mm]:ss",
    "workbook: times as h:mm:ss",
    "a folder: a file for each test",
    "a folder: the conditions in notes of each file",
    "a folder: one file in other units",
    "a folder: two files of the same edge numbers, two tools",
}  # cases that are not yet as expected


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
