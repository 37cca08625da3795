"""A parameter file and a card take tool, work, data file and "simulated" from the laws themselves."""

from dataclasses import replace

import pytest
from fitmodels import cards, datasets, fit, parameters
from fitmodels.core.errors import ParameterError
from fitmodels.fit.fitted_rows import LawSource

FACTORS = ["V", "f", "d", "t"]


def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def test_a_law_of_simulated_data_gives_a_file_and_a_card_that_say_so(tmp_path):
    law = fit.power_law(runs(), "AW", FACTORS)
    pf = parameters.collect(laws=[law])
    assert pf.identity.simulated is True
    assert (pf.identity.tool, pf.identity.work) == (runs().tool, runs().work)
    assert "simulated" in pf.identity.note
    assert pf.provenance.data_sha256 == runs().source.sha256
    assert (pf.provenance.data_file, pf.provenance.n_rows) == (runs().source.name, 239)
    cards.write(pf, tmp_path / "card")
    assert "simulated" in (tmp_path / "card" / "README.md").read_text("utf-8").lower()


def test_arguments_take_precedence_over_the_source():
    law = fit.power_law(runs(), "AW", FACTORS)
    pf = parameters.collect(tool="A", work="B", laws=[law], simulated=False, data_file="other.csv", n_rows=7)
    assert (pf.identity.tool, pf.identity.work, pf.identity.simulated, pf.identity.note) == ("A", "B", False, None)
    assert (pf.provenance.data_file, pf.provenance.data_sha256, pf.provenance.n_rows) == ("other.csv", None, 7)


def test_every_kind_of_law_carries_its_source():
    rough = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    load = fit.load_law(datasets.read_runs(datasets.bundled("clm2023_end_milling")))
    for law in (rough, load):
        assert len(law.source.sha256) == 64
        assert parameters.collect(laws=[law]).provenance.data_sha256 == law.source.sha256
    assert load.alternative is None
    assert rough.alternative.source == rough.source


def test_a_law_of_a_stream_carries_the_source_that_is_given():
    source = LawSource("big.parquet", "a" * 64, "GC435", "709M40", simulated=True, note="simulated: no measurement")
    law = fit.streamed_power_law([runs().data[:100], runs().data[100:]], "AW", FACTORS, source=source)
    assert law.source == replace(source, n_rows=239)
    pf = parameters.collect(laws=[law])
    assert (pf.identity.tool, pf.identity.simulated, pf.provenance.data_file) == ("GC435", True, "big.parquet")


def test_whether_a_stream_without_a_source_was_simulated_is_unknown(tmp_path):
    law = fit.streamed_power_law([runs().data], "AW", FACTORS)
    pf = parameters.collect(tool="GC435", work="709M40", laws=[law])
    assert (pf.identity.simulated, pf.reading) == (None, None)
    assert parameters.read(parameters.write(pf, tmp_path / "params.json")) == pf
    cards.write(pf, tmp_path / "card")
    readme, page = ((tmp_path / "card" / name).read_text("utf-8") for name in ("README.md", "card.html"))
    assert "Measured or simulated: unknown" in readme
    assert "simulated: null" in readme
    assert "measured" not in readme.split("---")[1]
    assert "<dt>Measured</dt><dd>unknown</dd>" in page
    assert parameters.collect(tool="a", work="b", limits={"power": 7.0}).identity.simulated is False


def test_laws_of_different_data_are_refused():
    law = fit.power_law(runs(), "AW", FACTORS)
    rough = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    with pytest.raises(ParameterError, match="laws of AW and Ra come from different data"):
        parameters.collect(laws=[law, rough])
    both = parameters.collect(tool="a", work="b", laws=[law, rough], data_file="both.csv")
    assert list(both.laws) == ["AW", "Ra"]


def test_without_laws_tool_and_work_are_needed():
    with pytest.raises(ParameterError, match="give tool= and work="):
        parameters.collect(tool="a")
