"""Every laboratory file of known truth is read right, refused with a remedy that works, or doubted by column.

`python tests/laboratory_files.py` prints the table.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from laboratory_files import CASES
from laboratory_truth import READ, SILENT, deviation, judge, reads, table, wear_test

sys.path.remove(str(Path(__file__).parent))


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_read_right_refused_or_doubted(tmp_path, name):
    verdict = judge(CASES[name], tmp_path)
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


NASA = {
    "as it is": lambda runs: runs,
    "fz and z": lambda runs: runs.assign(fz=runs["feed"] / 6, z=6).drop(columns="feed"),
    "vf and n": lambda runs: runs.assign(vf=runs["feed"] * 826, n=826).drop(columns="feed"),
    "um": lambda runs: runs.assign(VB=runs["VB"] * 1000),
    "no edge column": lambda runs: runs.drop(columns=["case", "run"]),
    "run without case": lambda runs: runs.drop(columns="case"),
}


@pytest.mark.parametrize("variant", NASA)
def test_nasa_milling_gets_its_laws_by_edge_without_options(measurements, tmp_path, variant):
    """16 cases are 16 edges, of which 8 and 7 of the two materials have wear above zero at t > 0."""
    runs = pd.read_csv(measurements / "nasa_milling/nasa_mill_runs.csv")
    runs = runs[["case", "run", "VB", "time", "DOC", "feed", "material"]]
    path = tmp_path / "runs.csv"
    NASA[variant](runs).to_csv(path, index=False)
    laws = reads(path).laws
    assert [law.n_edges for law in laws.values()] == [8, 7]
    assert [law.factors for law in laws.values()] == [("f", "d", "t")] * 2
    exponents = np.array([law.theta[1:] for law in laws.values()])
    np.testing.assert_allclose(exponents, [[0.2285, 0.6351, 0.7354], [0.6399, 0.6616, 0.9894]], atol=6e-5)
