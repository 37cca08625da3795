"""`fitmodels.analyse`: the main job of the command in one call, with the same files."""

import dataclasses
import json
import shlex
import subprocess
import sys

import fitmodels
import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.core.errors import DataError, FitError, UsageError
from fitmodels.fit.law_figures import response_surface
from fitmodels.pipeline import FitOptions, analyse, analysis
from fitmodels.pipeline.analysis import analyse_runs, analysis_stages
from fitmodels.pipeline.options import RECORDED

SMALL = datasets.bundled("ac2017_table1")
GC435 = datasets.bundled("gc435_709m40")


@pytest.fixture(scope="module")
def small():
    return analyse(SMALL, draws=1000)


def frame(tools=("A",), seed=1):
    """Simulated wear of two edges at each of six speeds, for each tool."""
    rng = np.random.default_rng(seed)
    rows = [
        {"tool": tool, "work": "steel", "edge": f"{tool}{i}", "V [m/min]": V, "t [min]": t}
        for tool in tools
        for i, V in enumerate((60.0, 80.0, 110.0, 150.0, 200.0, 70.0))
        for t in (2.0, 5.0, 10.0)
    ]
    table = pd.DataFrame(rows)
    table["VB [mm]"] = (
        0.01 * table["V [m/min]"] ** 0.5 * table["t [min]"] ** 0.3 * np.exp(rng.normal(0, 0.05, len(table)))
    )
    return table


def test_the_root_offers_the_main_job_and_lists_its_names():
    assert {"analyse", "Analysis", "FitOptions", "FitmodelsError", "__version__", "pipeline"} <= set(dir(fitmodels))
    assert fitmodels.analyse is analyse
    assert issubclass(DataError, fitmodels.FitmodelsError)
    with pytest.raises(AttributeError, match="analyze"):
        _ = fitmodels.analyze


def test_the_root_is_cheap_to_import():
    code = "import sys, fitmodels; print(fitmodels.__version__, dir(fitmodels) != [], 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[1:] == ["True", "False"]


def test_a_path_gives_laws_checks_posteriors_and_a_parameter_file(small):
    assert [law.response for law in small.laws] == ["AW", "Fxz", "P"]
    assert [post.response for post in small.posteriors] == ["AW", "Fxz", "P"]
    assert set(small.checks) == {"AW", "Fxz", "P"}
    pf = small.parameters
    assert (pf.identity.tool, pf.identity.simulated) == ("GC435", small.runs.simulated)
    assert pf.provenance.data_sha256 == small.runs.source.sha256
    assert pf.provenance.command is None
    assert small.pair.reason == ""


def test_the_files_are_those_of_the_command(tmp_path):
    words = [str(GC435), "--out", str(tmp_path / "command"), "--draws", "1200", "--criterion", "0.25", "--seed", "7"]
    assert main(words) == 0
    command = shlex.join(["fitmodels", *words])
    analysis = analyse(GC435, draws=1200, criterion=0.25, seed=7, command=command)
    (folder,) = analysis.write(tmp_path / "call")
    other = tmp_path / "command" / folder.name
    names = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(other) for path in other.rglob("*") if path.is_file())
    for name in ("params.json", "draws.npz", "README.md", "card.json", "card.html"):
        assert (folder / name).read_bytes() == (other / name).read_bytes()


def test_runs_and_a_frame_give_the_same_laws_as_a_file():
    table = frame()
    of_frame = analyse(table, draws=1000)
    of_runs = analyse(of_frame.runs, draws=1000)
    assert dict(of_frame.laws[0].params) == dict(of_runs.laws[0].params)
    assert of_frame.parameters.provenance.data_sha256
    assert of_frame.parameters.provenance.data_file == "DataFrame"
    assert of_frame.parameters.provenance.data_sha256 != analyse(frame(seed=2), draws=1000).runs.source.sha256
    mapped = analyse(table.rename(columns={"VB [mm]": "wear"}), map={"VB": "wear"}, units={"VB": "mm"}, draws=1000)
    assert dict(mapped.laws[0].params) == dict(of_frame.laws[0].params)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"criterion": -1}, "criterion -1: a wear criterion is above zero, for instance 0.3"),
        ({"criterion": "0.3"}, "criterion 0.3: a wear criterion"),
        ({"criterion": float("nan")}, "criterion nan"),
        ({"gauge_sd": -0.1}, "gauge_sd -0.1: a standard deviation is not below zero"),
        ({"draws": 10}, "draws 10: give a whole number from 1000"),
        ({"draws": 1500.5}, "draws 1500.5: give a whole number"),
        ({"seed": -1}, "seed -1: give a whole number from 0 to 4294967295"),
        ({"seed": True}, "seed True: give a whole number"),
        ({"error": "both"}, "error 'both': give one of 'multiplicative', 'additive'"),
        ({"decimal": ","}, "decimal ',': give one of None, 'point', 'comma'"),
        ({"student": "yes"}, "student 'yes': give one of True, False"),
        ({"map": "VB=col7"}, "map 'VB=col7': give a mapping"),
        ({"by": 3}, "by 3: give a text, or leave it out"),
        ({"priors": 3}, "priors 3: give 'weak', 'reference', the path of a TOML file"),
        ({"criterium": 0.3}, "criterium: there is no such option. Did you mean 'criterion'?"),
        ({"options": FitOptions(), "seed": 2}, "seed: give either options or keywords, not both"),
    ],
    ids=str,
)
def test_a_bad_option_is_named_with_its_remedy(options, words):
    with pytest.raises(UsageError) as refused:
        analyse(SMALL, **options)
    assert words in str(refused.value)


def test_priors_that_cannot_be_read_are_refused_before_anything_is_fitted():
    with pytest.raises(DataError, match=r"nowhere\.toml cannot be read"):
        FitOptions(priors="nowhere.toml")


@pytest.mark.parametrize(("options", "words"), [({"sheet": "a"}, "sheet"), ({"ranges": {"V": (1.0, 2.0)}}, "ranges")])
def test_options_of_files_are_refused_for_a_frame(options, words):
    with pytest.raises(UsageError, match=f"{words}: a DataFrame has no such option"):
        analyse(frame(), **options)


def test_reading_options_are_refused_for_runs(small):
    with pytest.raises(UsageError, match="tool: Runs have been read already"):
        analyse(small.runs, tool="K10")


def test_options_are_frozen_and_recorded_as_the_command_names_them():
    options = FitOptions(units={"V": "m/s"}, ranges={"f": (0.1, 0.25)}, seed=2, gauge_sd=0.01, priors="reference")
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.seed = 3
    recorded = options.recorded()
    assert recorded == {
        "unit": ["V=m/s"], "range": ["f=0.1:0.25"], "error": "multiplicative", "gauge_sd": 0.01, "seed": 2,
        "priors": "reference",
    }  # fmt: skip
    assert set(recorded) <= set(RECORDED)
    assert FitOptions().recorded() == {"error": "multiplicative"}
    assert json.loads(json.dumps(recorded)) == recorded


def test_numbers_of_numpy_are_options():
    options = FitOptions(seed=np.int64(3), draws=np.int64(1000), criterion=np.float32(0.25), gauge_sd=np.float64(0.01))
    assert json.loads(json.dumps(options.recorded()))["seed"] == 3
    assert [type(value) for value in (options.seed, options.draws, options.criterion)] == [int, int, float]


def test_a_criterion_in_micrometres_is_refused():
    with pytest.raises(UsageError, match=r"criterion 300 mm: more than the 5 mm of wear that an edge can have"):
        FitOptions(criterion=300)


def test_several_pairs_have_an_analysis_each(tmp_path):
    analysis = analyse(frame(("A", "B")), draws=1000)
    assert [pair.name for pair in analysis.pairs] == ["A on steel", "B on steel"]
    with pytest.raises(UsageError, match=r"2 pairs \(A on steel, B on steel\): choose one"):
        _ = analysis.laws
    assert [path.name for path in analysis.write(tmp_path / "out")] == ["A_steel", "B_steel"]
    for pair, path in zip(analysis.pairs, ("A_steel", "B_steel"), strict=True):
        assert parameters.read(tmp_path / "out" / path / "params.json") == pair.parameters


def test_a_pair_without_a_law_has_a_reason_and_no_folder(tmp_path):
    table = frame(("A", "B"))
    few = table[(table["tool"] == "A") | (table.index == len(table) - 1)]
    analysis = analyse(few, draws=1000)
    with_law, without = analysis.pairs
    assert without.parameters is None
    assert without.reason in analysis.summary().replace("\n", " ")
    assert with_law.reason == ""
    assert [path.name for path in analysis.write(tmp_path)] == ["A_steel"]
    alone = analyse(table[table.index == 0], draws=1000)
    with pytest.raises(FitError, match="A on steel has no parameter file"):
        _ = alone.parameters
    with pytest.raises(FitError, match="A on steel has no parameter file"):
        alone.write(tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_result_is_written_whole_and_replaced_by_force_alone(small, tmp_path):
    (folder,) = small.write(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert small.write(tmp_path) == (folder,)  # same result: nothing is written
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    other = analyse(SMALL, draws=1000, criterion=None, seed=2)
    with pytest.raises(UsageError, match="contains a different result"):
        other.write(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    other.write(tmp_path, force=True)
    assert parameters.read(folder / "params.json") == other.parameters


def test_several_folders_are_checked_before_the_first_is_written(tmp_path):
    analysis = analyse(frame(("A", "B")), draws=1000)
    (tmp_path / "B_steel").mkdir()
    (tmp_path / "B_steel" / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="B_steel exists and contains a different result or other files"):
        analysis.write(tmp_path)
    assert not (tmp_path / "A_steel").exists()


def test_a_record_is_refused_with_the_command_for_it(tmp_path):
    path = tmp_path / "run.csv"
    t = np.arange(400) / 50
    pd.DataFrame({"time [s]": t, "u": np.sin(t), "y": np.sin(t - 0.2)}).to_csv(path, index=False)
    with pytest.raises(DataError, match=r"run\.csv is a record of one run .* fitmodels ident run\.csv"):
        analyse(path)


def test_the_views_name_pairs_laws_and_simulation(small):
    said = small.summary()
    assert "3 laws of 1 pair, 16 rows" in said
    assert all(law in said for law in ("AW = ", "Fxz = ", "P = "))
    assert repr(small).startswith("Analysis: data.csv: 3 laws of 1 pair")
    assert "<table" in small._repr_html_()
    assert ("simulated, not measured" in said) == small.runs.simulated


@pytest.mark.parametrize("source", [None, 3, [1.0, 2.0]], ids=["nothing", "a number", "a list"])
def test_a_source_of_another_type_is_refused(source):
    with pytest.raises(UsageError, match=r"source of type \w+: give the path of a file, a DataFrame or Runs"):
        fitmodels.analyse(source)


def raises(*_, **__):
    raise ZeroDivisionError("deliberate")


OPTIONAL = {
    "fit.published.compare_published": "published not available",
    "fit.lawfit.design_region": "region not available",
    "fit.regression.other_structure": "additive errors not available",
    "fit.bayes.posterior.Posterior.sensitivity": "prior sensitivity not available",
    "fit.bayes.posterior.Posterior.leave_out": "leaving out edges not available",
    "fit.checks.judgement.preferable_form": '"competing forms"',
    "cards.content.card.profiler_part": '"profiler": "Not composed',
    "cards.content.card.window_parts": '"windows": "Not composed',
    "cards.content.card.figures": '"figures": "Not composed',
}


def test_optional_parts_that_fail_cost_only_themselves_and_give_their_reason(monkeypatch, tmp_path):
    for place in OPTIONAL:
        monkeypatch.setattr(f"fitmodels.{place}", raises)
    (folder,) = analyse(SMALL, draws=1000).write(tmp_path)
    text = (folder / "params.json").read_text("utf-8") + (folder / "card.json").read_text("utf-8")
    for words in OPTIONAL.values():
        at = text.index(words)
        assert "the computation failed (ZeroDivisionError: deliberate)" in text[at : at + 200], words
    assert list(parameters.read(folder / "params.json").laws) == ["AW", "Fxz", "P"]
    assert (folder / "card.html").is_file()


@pytest.mark.parametrize(
    ("what", "words"), [("posterior", '"posterior"'), ("judge", "checks not available"), ("composite", "composite")]
)
def test_a_larger_part_that_fails_costs_only_itself(monkeypatch, what, words):
    monkeypatch.setattr(f"fitmodels.fit.{what}", raises)
    table = frame().assign(**{"P [kW]": lambda x: x["V [m/min]"] ** 0.8 * x["VB [mm]"] ** 0.3 / 20})
    table["P [kW]"] *= np.exp(np.random.default_rng(3).normal(0, 0.05, len(table)))
    text = analyse(table, draws=1000).parameters.model_dump_json()
    at = text.index(words)
    assert "deliberate" in text[at:]


def test_laws_by_a_category_say_why_there_is_no_tool_life():
    table = frame()
    table["machine"] = np.where(np.arange(len(table)) % 8 < 4, "A", "B")
    pair = analyse(table, by="machine", draws=1000).pair
    assert pair.no_life == "a law by 'machine' has no tool life: fit each level alone, in a file of its own."
    assert analyse(table, draws=1000).pair.no_life == ""


def test_a_law_or_a_tool_life_that_fails_costs_only_itself(monkeypatch):
    monkeypatch.setattr("fitmodels.fit.tool_life", raises)
    pair = analyse(frame(), draws=1000).pair
    assert [law.response for law in pair.laws] == ["VB"]
    assert pair.no_life == "No tool life: the computation failed (ZeroDivisionError: deliberate)."
    monkeypatch.setattr("fitmodels.fit.defaults.exponential_law", raises)
    found = analyse(datasets.bundled("surf_table1"), draws=1000).pair
    assert "deliberate" in found.refused[0].reason


def test_a_figure_that_fails_is_a_figure_of_the_reason(monkeypatch, tmp_path):
    monkeypatch.setattr("fitmodels.cards.figures.response_surface", raises)
    monkeypatch.setattr("fitmodels.fit.bayes.figures.SHEETS", {})
    (folder,) = analyse(SMALL, draws=1000, posterior_figures=True).write(tmp_path)
    for name in ("response_surfaces", "residuals", "posterior_AW_pairs"):
        assert (folder / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("level", [1e-9, 1.0, 123456789.0])
def test_a_surface_without_slope_is_drawn_without_contours(level, tmp_path):
    """The power of one level of V and f, to rounding: there is nothing to contour."""
    table = frame().assign(**{"f [mm/rev]": np.repeat([0.1, 0.2, 0.1, 0.2, 0.1, 0.2], 3)}).drop(columns="VB [mm]")
    rng = np.random.default_rng(2)
    table["P [kW]"] = level * np.exp(1e-12 * rng.normal(size=len(table)))
    law = fit.power_law(datasets.runs_from_frame(table, judge=False), "P", ["V", "f"])
    drawn = response_surface(law)
    assert "no contours: P is" in drawn.texts[0].get_text()
    drawn.figure.savefig(tmp_path / "surface.png")


def test_a_pair_comes_with_its_judged_laws_before_its_posteriors_are_drawn(monkeypatch):
    drawn = []
    draw = analysis.with_posteriors
    monkeypatch.setattr(analysis, "with_posteriors", lambda *of, **more: drawn.append(of) or draw(*of, **more))
    runs, options = datasets.read_runs(SMALL), FitOptions(draws=1000)
    stages = analysis_stages(runs, options)
    first, complete = next(stages)
    assert (complete, drawn, first.parameters.posterior) == (False, [], None)
    assert first.parameters.content_sha256 is None
    (last, complete), *others = stages
    assert complete
    assert not others
    assert last.parameters == analyse_runs(runs, options).pairs[0].parameters
    assert [law.verdict for law in last.parameters.laws.values()] == [
        law.verdict for law in first.parameters.laws.values()
    ]


def test_a_posterior_that_disagrees_changes_the_verdict_after_the_first_stage(monkeypatch):
    from fitmodels.fit.checks import agreement

    compared = agreement.posterior_agreement
    found = []

    def disagreeing(law, post):
        found.append(law.response)
        return dataclasses.replace(compared(law, post), concern=1, verdict="the posterior differs")

    monkeypatch.setattr(agreement, "posterior_agreement", disagreeing)
    runs, options = datasets.read_runs(GC435), FitOptions(draws=1000, laws=("AW ~ V, f, d, t",))
    (first, _), (last, _) = analysis_stages(runs, options)
    assert set(found) == set(last.parameters.laws)
    sentences = [" ".join(str(law.checks) for law in one.parameters.laws.values()) for one in (first, last)]
    assert "the posterior differs" not in sentences[0]
    assert "the posterior differs" in sentences[1]
    assert last.parameters == analyse_runs(runs, options).pairs[0].parameters
