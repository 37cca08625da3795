"""Every laboratory file of known truth is read right, refused with a remedy that works, or doubted by column.

`python tests/laboratory_files.py` prints the table. Random files of every kind are equal where they should be, never
change an exponent without a message and never end with an internal error: `benchmarks/fuzz.py` tries ten thousand.
"""

import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import fuzz
import fuzz_records
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


SEED = 25


@pytest.fixture(scope="module", params=fuzz.SHORT)
def tried(request):
    kind, files = request.param, fuzz.SHORT[request.param]
    return [fuzz.tried(kind, number) for number in fuzz.numbers(kind, files, SEED)]


def test_no_random_file_is_at_fault(tried):
    """`python benchmarks/fuzz.py --only KIND:NUMBER` repeats one of them."""
    assert [(one.kind, one.number, one.what, one.fault) for one in tried if one.fault] == []
    if tried[0].kind == "table":
        assert {"equal", "cell"} <= {one.verdict.split(":")[0] for one in tried}
    elif tried[0].kind == "record":
        assert len({one.verdict for one in tried}) >= 3


def test_a_silent_change_would_be_seen(monkeypatch):
    """With every sentence of the reading, every check and every row left out taken away, mutations are silent."""
    monkeypatch.setattr(mutations, "sentences", lambda outcome: set())
    monkeypatch.setattr(mutations, "failed_checks", lambda outcome: set())
    monkeypatch.setattr(mutations, "named", lambda *_: "")
    found = [fuzz.tried("table", number) for number in fuzz.numbers("table", 24, 18)]
    assert {"cell: MISSED"} <= {one.verdict for one in found if one.fault}


def test_a_record_that_differs_would_be_seen(monkeypatch, tmp_path):
    monkeypatch.setattr(fuzz_records, "EQUAL", (fuzz_records.wrong_rate,))
    monkeypatch.setattr(fuzz_records, "SHARE", 1.0)
    verdict, fault, *_ = fuzz_records.trial(1, tmp_path)
    assert verdict == "equal: DIFFERENT"
    assert "the response differs" in fault


def test_limits_of_cpu_and_memory_and_warnings_are_faults(monkeypatch):
    def slow(number, folder):
        while True:
            sum(range(1000))

    def warns(number, folder):
        np.log(np.zeros(1))
        warnings.warn_explicit("overflow", RuntimeWarning, "numpy/core.py", 1)
        return "read", "", "", 0

    def reads(number, folder):
        return "read", "", "", 0

    monkeypatch.setitem(fuzz.KINDS, "slow", slow)
    monkeypatch.setitem(fuzz.KINDS, "warns", warns)
    monkeypatch.setattr(fuzz, "CPU", 0.05)
    monkeypatch.setattr(fuzz, "CPU_PER_MB", 0.01)
    assert "s of CPU" in fuzz.tried("slow", 1).fault
    assert "core.py:1 RuntimeWarning: overflow" in fuzz.tried("warns", 1).fault
    monkeypatch.setitem(fuzz.KINDS, "reads", reads)
    monkeypatch.setattr(fuzz, "_memory", iter((100.0, 100.0 + 2 * fuzz.MEMORY)).__next__)
    assert "800 MB more memory for 0 bytes" in fuzz.tried("reads", 1).fault


@pytest.mark.parametrize("number", [5005, 6001, 6002, 6004])
def test_an_odd_file_ends_without_an_internal_error_and_without_a_part_that_failed(number):
    assert fuzz.tried("odd", number).fault == ""


def test_an_internal_error_and_a_part_that_failed_would_be_seen(monkeypatch):
    def raises(*_, **__):
        raise ZeroDivisionError("deliberate")

    monkeypatch.setattr("fitmodels.fit.checks.judgement.preferable_form", raises)
    assert "ZeroDivisionError: deliberate" in fuzz.tried("odd", 5005).fault
    monkeypatch.setattr("fitmodels.pipeline.analysis.with_posteriors", raises)
    assert fuzz.tried("odd", 5005).fault.startswith("exit 70")
