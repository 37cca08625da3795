"""Every laboratory file of known truth is read right, refused with a remedy that works, or doubted by column.

`python tests/laboratory_files.py` prints the table. Random mutations of good files never change an exponent without a
message, and no file ends with an internal error: `benchmarks/mutations.py` tries 2000, `benchmarks/fuzz.py` hundreds.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import fuzz
import mutations
from laboratory_files import CASES
from laboratory_truth import READ, SILENT, deviation, judge, reads, table, wear_test

for folder in ("tests", "benchmarks"):
    while str(Path(__file__).resolve().parent.parent / folder) in sys.path:
        sys.path.remove(str(Path(__file__).resolve().parent.parent / folder))


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


FILES, SEED = 60, 18


@pytest.fixture(scope="module")
def results():
    return mutations.run(FILES, SEED)


def test_no_exponent_changes_without_a_message(results):
    assert not [(one.seed, one.base, one.done, one.change) for one in results if one.verdict == "SILENT"]


def test_every_kind_is_tried_and_some_change_nothing(results):
    assert {one.kind for one in results} == set(mutations.KINDS)
    assert {"unchanged", "refused", "message"} <= {one.verdict for one in results}


def test_a_silent_change_would_be_seen(monkeypatch, tmp_path):
    """With every sentence of the reading and every check taken away, mutations are silent."""
    monkeypatch.setattr(mutations, "sentences", lambda outcome: set())
    monkeypatch.setattr(mutations, "failed_checks", lambda outcome: set())
    found = [mutations.mutate(seed, tmp_path) for seed in range(18_000_000, 18_000_012)]
    assert any(one is not None and one.verdict == "SILENT" for one in found)


@pytest.mark.parametrize("number", [5005, 6001, 6002, 6004])
def test_an_odd_file_ends_without_an_internal_error_and_without_a_part_that_failed(number):
    what, options, code, trace, failed, _ = fuzz.tried("odd", number)
    assert code in fuzz.DONE, (what, options, trace)
    assert not failed, (what, options, trace)


def test_an_internal_error_and_a_part_that_failed_would_be_seen(monkeypatch):
    def raises(*_, **__):
        raise ZeroDivisionError("deliberate")

    monkeypatch.setattr("fitmodels.fit.checks.judgement.compare_forms", raises)
    assert "ZeroDivisionError: deliberate" in fuzz.tried("odd", 5005)[4][0]
    monkeypatch.setattr("fitmodels.pipeline.analysis.with_posteriors", raises)
    assert fuzz.tried("odd", 5005)[2] == 70
