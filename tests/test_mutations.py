"""Random mutations of good files never change an exponent without a message, and no file ends with an internal error.

`benchmarks/mutations.py` tries 2000, `benchmarks/fuzz.py` hundreds through all commands.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))

import fuzz
import mutations

for folder in ("tests", "benchmarks"):
    while str(Path(__file__).resolve().parent.parent / folder) in sys.path:
        sys.path.remove(str(Path(__file__).resolve().parent.parent / folder))

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
    monkeypatch.setattr("fitmodels.pipeline.analysis.fit_pair", raises)
    assert fuzz.tried("odd", 5005)[2] == 70
