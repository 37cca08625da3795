"""``fitmodels predict``: the same numbers as the laws give, reported once for people and once for programs."""

import contextlib
import io
import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.app.command_forms import actions, subject_of
from fitmodels.cli import main
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.file import sealed
from fitmodels.parameters.sections.base import VerdictSection
from statsmodels.regression.linear_model import OLS

AT = ("V=120", "f=0.2", "d=2", "t=8")
POINT = {"V": 120.0, "f": 0.2, "d": 2.0, "t": 8.0}
EXACT = 1e-9  # of a covariance that two libraries reach by different decompositions


def run(*arguments):
    """The command in this process: exit code, standard output on one line, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["predict", *map(str, arguments)])
    return SimpleNamespace(code=code, out=" ".join(out.getvalue().split()), raw=out.getvalue(), err=err.getvalue())


def refused(result, code, *words):
    assert (result.code, result.raw) == (code, "")
    assert result.err.count("\n") == 1
    assert result.err.endswith(".\n")
    for word in words:
        assert word in result.err


def report(*arguments):
    result = run(*arguments, "--json")
    assert (result.code, result.err) == (0, "")
    return json.loads(result.raw)


def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@pytest.fixture(scope="module")
def params(tmp_path_factory):
    """The parameter file of the bundled set, its laws fitted without power on time, as some laboratories do."""
    runs = bundled()
    laws = [fit.power_law(runs, "AW", list("Vfdt")), fit.power_law(runs, "P", ["V", "f", "d", "AW"])]
    pf = parameters.collect(tool="GC435", work="709M40", laws=laws, simulated=True)
    return parameters.write(pf, tmp_path_factory.mktemp("told") / "params.json")


@pytest.fixture(scope="module")
def by_material(tmp_path_factory):
    frame = bundled().data.drop(columns="point")
    hard = frame["edge"].isin(sorted(set(frame["edge"]))[::2])
    runs = datasets.runs_from_frame(
        frame.assign(material=np.where(hard, "hard", "soft"), AW=frame["AW"] * (1 + 0.3 * hard))
    )
    law = fit.power_law(runs, "AW", list("Vfdt"), by="material")
    pf = parameters.collect(tool="GC435", work="two", laws=[law])
    return parameters.write(pf, tmp_path_factory.mktemp("told") / "params.json")


# --- what it says


def test_a_power_computed_from_the_force_is_named_as_that_of_the_cut(params, tmp_path):
    rng = np.random.default_rng(7)
    V, f = map(np.ravel, np.meshgrid([80.0, 120, 180], [0.1, 0.2, 0.3]))
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": f, "Fc": 1800 * f**0.75 * rng.lognormal(0, 0.03, 9)}))
    pf = parameters.collect(tool="A", work="B", laws=fit.default_laws(runs)[0])
    file = parameters.write(pf, tmp_path / "params.json")
    words = "P is the power of the cut, without the losses of the drive, computed by P = Fc V/60000."
    assert words in run(file, "V=120", "f=0.2").out
    assert report(file, "V=120", "f=0.2")["remarks"] == [words]
    assert words not in run(file, "V=120", "f=0.2", "--law", "Fc").out
    assert "power of the cut" not in run(params, *AT).out
    forms = {form.name: form.inputs for form in actions(subject_of(tmp_path, "d", file.name, []))}
    assert "power of the cut P at most, kW" in {one.label for one in forms["limits"]}


def test_each_law_in_one_sentence(params):
    result = run(params, *AT)
    law = parameters.read(params).laws["AW"]
    assert (result.code, result.err) == (0, "")
    assert law.predict(**POINT).words in result.out
    assert re.search(
        r"P 2\.\d+ kW at V 120 m/min, f 0\.2 mm/rev, d 2 mm, AW 0\.176 mm from its own law; 95 % prediction interval "
        r"for one row of a new edge .* kW \(the variance of AW is not included\); inside the tested region\.",
        result.out,
    )
    assert result.out.endswith("Not measured: the laws were fitted to a simulation.")
    assert max(map(len, result.raw.splitlines())) <= 120


def test_the_verdict_of_a_law_and_of_the_wear_law_it_takes_is_printed(params, tmp_path):
    """A law that is usable has no sentence; one without a verdict is named."""
    pf = parameters.read(params)
    reasons = ["R2 is .02.", "The wear falls with time."]
    usable = {"level": "usable inside the tested region"}
    verdicts = {"AW": {"level": "do not use for control", "reasons": reasons}, "P": usable}
    laws = {name: {**pf.laws[name].model_dump(), "verdict": verdict} for name, verdict in verdicts.items()}
    file = parameters.write(sealed(pf, laws=laws), tmp_path / "params.json")
    said = f"Verdict on the law of AW: do not use for control. {' '.join(reasons)}"
    result = run(file, *AT, "--law", "P")
    assert said in result.out
    assert "law of P:" not in result.out
    assert report(file, *AT)["verdicts"] == [said]
    assert said not in run(file, *AT, "AW=0.2", "--law", "P").out
    laws["P"]["verdict"] = None
    parameters.write(sealed(pf, laws=laws), file, force=True)
    assert "No verdict on the law of P: it is not known how far it can be used" in run(file, *AT).out


def test_json_holds_the_same_facts(params):
    reported = report(params, *AT, "--interval", "tolerance", "--level", ".9", "--coverage", "0.8")
    assert (reported["schema"], reported["file"], reported["simulated"], reported["not_predicted"]) == (
        "fitmodels.prediction/2", "params.json", True, [],
    )  # fmt: skip
    laws = parameters.read(params).laws
    wear, power = reported["predictions"]
    assert (wear["low"], wear["high"]) == laws["AW"].interval(0.9, "tolerance", coverage=0.8, **POINT)
    assert wear["value"] == laws["AW"].values(**POINT)
    assert (wear["inside"], wear["interval"], wear["level"], wear["coverage"]) == (True, "tolerance", 0.9, 0.8)
    at = {name: POINT[name] for name in "Vfd"}
    assert (power["low"], power["high"]) == laws["P"].interval(0.9, "tolerance", coverage=0.8, AW=wear["value"], **at)
    assert power["given"]["AW"]["from_law"] == "AW"
    assert power["given"]["V"] == {
        "value": 120.0, "unit": "m/min", "low": 50.0, "high": 200.0, "beyond": 0, "from_law": None,
    }  # fmt: skip
    for one in reported["predictions"]:
        assert one["words"] in run(params, *AT, "--interval", "tolerance", "--level", ".9", "--coverage", "0.8").out


def test_the_interval_is_that_of_statsmodels(tmp_path):
    """Rows without edges: ln AW on ln V and ln f, as summary_frame has a new observation and the mean."""
    law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    pf = parameters.collect(tool="a", work="b", laws=[law])
    path = parameters.write(pf, tmp_path / "params.json")
    V, f = (math.sqrt(low * high) for low, high in law.domain.values())
    fitted = OLS(np.log(law.observed), np.column_stack([np.ones(law.nobs), np.log(law.X)])).fit()
    theirs = fitted.get_prediction([[1, np.log(V), np.log(f)]]).summary_frame(alpha=0.1).iloc[0]
    for kind, stem in (("mean", "mean_ci"), ("prediction", "obs_ci")):
        (ours,) = report(path, f"V={V!r}", f"f={f!r}", "--interval", kind, "--level", "0.9")["predictions"]
        expected = np.exp([theirs["mean"], theirs[f"{stem}_lower"], theirs[f"{stem}_upper"]])
        np.testing.assert_allclose([ours["value"], ours["low"], ours["high"]], expected, rtol=EXACT)


def test_units_and_order_do_not_matter(params):
    """400 ft/min is 121.92 m/min and 0.08 in are 2.032 mm, exactly (NIST SP 811)."""
    ours = run(params, "--law", "AW", "V=400ft/min", "f=0.2 mm/rev", "--level", "0.9", "d=0.08in", "t=480s")
    law = parameters.read(params).laws["AW"]
    assert law.predict(kind="prediction", level=0.9, V=121.92, f=0.2, d=2.032, t=8.0).words in ours.out


def test_wear_that_is_given_is_taken(params):
    (power,) = report(params, "V=120", "f=0.2", "d=2", "AW=0.2", "--law", "P")["predictions"]
    assert power["value"] == parameters.read(params).laws["P"].values(V=120.0, f=0.2, d=2.0, AW=0.2)
    assert power["given"]["AW"]["from_law"] is None
    reported = run(params, "V=120", "f=0.2", "d=2", "AW=0.2")
    assert reported.code == 0
    assert "not included" not in reported.out
    assert "AW is not predicted: the law of AW needs t (cutting time, min); add for instance t=6.3." in reported.out


def test_outside_is_said_of_whatever_stands_on_it(params):
    wear, power = report(params, "V=120", "f=0.2", "d=2", "t=25")["predictions"]
    assert (wear["inside"], power["inside"]) == (False, False)
    assert wear["words"].endswith(
        "outside the tested region: t 25 min is above 20 min, the highest tested; do not rely on it."
    )
    assert power["words"].endswith(
        "outside the tested region: AW comes from outside the region of its own law; do not rely on it."
    )
    assert parameters.read(params).laws["P"].inside(V=120.0, f=0.2, d=2.0, AW=wear["value"])


def test_a_level_shifts_the_law(by_material):
    hard, soft = (report(by_material, *AT, "--by", level)["predictions"][0] for level in ("hard", "soft"))
    law = parameters.read(by_material).laws["AW"]
    assert [hard["value"], soft["value"]] == [law.values(by=level, **POINT) for level in ("hard", "soft")]
    assert hard["by"] == {"material": "hard"}
    assert "material hard; 95 %" in hard["words"]


# --- what it refuses


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["V=120", "f=0.2", "d=2"], 2, ["the law of AW needs t (cutting time, min); add for instance t=6.3"]),
        (["--law", "P", "V=120", "f=0.2", "d=2"], 2, ["needs AW (average wear, mm), or t for its own law"]),
        ([], 2, ["needs V (cutting speed, m/min), f (feed, mm/rev), d", "add for instance V=100 f=0.19 d=2.1 t=6.3"]),
        ([*AT, "vcc=3"], 2, ["vcc=3: no law of the file has a factor vcc; they have V, f, d, t, AW (did you mean V?)"]),
        (["V=120", "f=0.2", "d=2", "P=3"], 2, ["P=3: P is what its law gives, not a condition. Leave it out."]),
        ([*AT, "vc=3"], 2, ["vc=3: V is given twice, also as V=120"]),
        ([*AT, "Ra=3"], 2, ["Ra=3: no law of the file has a factor Ra"]),
        ([*AT, "n=500", "D=200"], 2, ["V=120 contradicts V = pi D n/1000 = 314.2"]),
        ([*AT, "--law", "PP"], 2, ["--law PP: the file has laws of AW, P (did you mean P?)"]),
        ([*AT, "--by", "hard"], 2, ["--by hard: no law has levels"]),
        ([*AT, "--level", "95"], 2, ["--level 95", "between 0 and 1"]),
        ([*AT, "--coverage", "1"], 2, ["--coverage 1"]),
        ([*AT, "--interval", "typical"], 2, ["invalid choice: 'typical'"]),
        ([*AT, "--intervall", "mean"], 2, ["did you mean --interval?"]),
        (["V=-1", *AT[1:]], 2, ["V = -1 m/min", "positive"]),
        (["n=4001/min", "D=80", *AT[1:]], 2, ["n=4001/min: number and unit /min cannot be separated", "rpm"]),
        (["V=fast", *AT[1:]], 2, ["V=fast: give a number with a decimal point"]),
        (["V=12,5", *AT[1:]], 2, ["V=12,5: give a number with a decimal point"]),
        (["V", *AT[1:]], 2, ["condition V: write it as V=120"]),
        (["V=1", *AT], 2, ["V is given twice"]),
        ([*AT[1:], "vc=1", "Vc=2"], 2, ["V is given twice"]),
        (["V=120kN", *AT[1:]], 2, ["V=120kN: V of the law is in m/min, and kN measures another quantity"]),
        (["V=120mm/minn", *AT[1:]], 2, ["unit 'mm/minn' is not listed", "did you mean"]),
        (["V=1e999", *AT[1:]], 2, ["V = inf"]),
    ],
)
def test_what_cannot_be_asked_is_one_sentence(params, arguments, code, words):
    result = run(params, *arguments)
    assert (result.code, result.raw) == (code, "")
    assert result.err.count("\n") == 1
    for word in words:
        assert word in result.err


MILLED = """edge,n [rpm],D [mm],feed [mm/s],ap [mm],t [min],VB [mm]
""" + "\n".join(
    f"E{n}{f},{n},80,{f * n / 60:.6f},2.5,{t},{4e-3 * (math.pi * 0.08 * n) ** 0.6 * f**0.3 * t**0.5 * (1 + i / 50):.4f}"
    for n in (300, 500, 800)
    for f in (0.1, 0.2, 0.4)
    for i, t in enumerate((2, 5, 9))
)


@pytest.fixture(scope="module")
def milled(tmp_path_factory):
    """A law in V and f of a file that has n, D, a feed in mm/s and one depth."""
    data = tmp_path_factory.mktemp("milled") / "data.csv"
    data.write_text(MILLED, encoding="utf-8")
    runs = datasets.read_runs(data)
    law = fit.power_law(runs, "VB", ["V", "f", "t"])
    return parameters.write(parameters.collect(tool="a", work="b", laws=[law], design=runs), data.with_name("p.json"))


def test_headers_of_the_fitted_file_and_quantities_that_give_a_factor_are_understood(milled):
    same = report(milled, f"V={math.pi * 80 * 500 / 1000}", "f=0.24", "t=9")["predictions"]
    asked = report(milled, "n=500", "feed=2mm/s", "time=540s", "ap=2.5")
    assert asked["predictions"][0]["value"] == pytest.approx(same[0]["value"], rel=1e-12)
    assert asked["remarks"] == [
        "time=540s is taken as t (cutting time), column 't [min]' of the fitted file.",
        "V = pi D n/1000 = 125.7 m/min, from D = 80 mm (constant in the fitted file) and n = 500 1/min (n=500).",
        "f = fm/n = 0.24 mm/rev, from fm = 120 mm/min (feed=2mm/s) and n = 500 1/min (n=500).",
    ]
    refused(run(milled, "n=500", "feed=2", "t=9"), 2, "feed=2: the fitted file has 'feed [mm/s]' in mm/s", "feed=2mm/s")


def test_a_condition_that_no_law_has_is_named_and_another_value_than_the_tested_one_is_no_prediction(milled, params):
    at = ("V=120", "f=0.2", "t=8")
    assert report(milled, *at, "d=2.5")["remarks"] == []
    assert (
        "d 2.5 mm; no law depends on d, and the predictions are not valid" in report(milled, *at, "ap=1")["remarks"][0]
    )
    assert all(one["inside"] for one in report(milled, *at)["predictions"])
    assert not any(one["inside"] for one in report(milled, *at, "ap=1")["predictions"])
    assert "outside the tested region: d 1 mm is below 2.5 mm, the lowest tested" in run(milled, *at, "ap=1").out
    assert "no law of the file depends on ae (width of cut)" in run(params, *AT, "ae=40").out
    refused(run(params, *AT, "lc=40"), 2, "t=8 contradicts t = lc/V = 0.3333")


def test_a_level_must_be_named_and_known(by_material):
    of_life = "The law of AW has levels, and tool life is computed for one: fit each level alone, in a file of its own."
    refused(run(by_material, "V=120", "f=0.2", "d=2", "--by", "hard"), 2, "needs t (cutting time, min)", of_life)
    refused(run(by_material, "T", "V=120", "f=0.2", "d=2", "--by", "hard"), 2, of_life)
    refused(run(by_material, *AT), 2, "by material: give the level (hard, soft) with --by")
    refused(run(by_material, *AT, "--by", "Hard"), 2, "there are hard, soft (did you mean hard?)")


def test_a_file_that_cannot_be_read(tmp_path):
    refused(run(tmp_path / "no.json", *AT), 3, "the file does not exist")
    (tmp_path / "bad.json").write_text("{")
    refused(run(tmp_path / "bad.json", *AT), 3, "bad.json")
    (tmp_path / "tests.csv").write_text("V,t,VB\n100,5,0.1\n")
    refused(run(tmp_path / "tests.csv", *AT), 3, "is a table, not a parameter file: fit it first")


def test_a_file_without_a_law_or_without_its_interval(tmp_path):
    empty = parameters.write(parameters.collect(tool="a", work="b"), tmp_path / "empty.json")
    refused(run(empty, *AT), 2, "has no law")
    two = datasets.runs_from_frame(bundled().data.iloc[:2][["t", "AW"]])
    pf = parameters.collect(tool="a", work="b", laws=[fit.power_law(two, "AW", ["t"])])
    refused(run(parameters.write(pf, tmp_path / "two.json"), "t=3"), 3, "2 observations fix 2 parameters exactly")


def test_an_earlier_file_says_what_it_lacks(params, tmp_path):
    data = json.loads(params.read_text("utf-8"))
    for law in data["laws"].values():
        for name in ("rows_per_edge", "df_between", "df_within", "smearing_within"):
            del law["edges"][name]
    old = parameters.write(ParameterFile.model_validate(data), tmp_path / "old.json")
    assert report(old, *AT) == report(params, *AT) | {"file": "old.json"}
    refused(
        run(old, *AT, "--interval", "tolerance"), 3, "the law of AW lacks edges.rows_per_edge", "fit the data again"
    )


def test_the_life_of_a_wear_law_comes_with_the_verdicts_on_the_law_and_on_the_life(tmp_path):
    law = fit.power_law(bundled(), "AW", list("Vfdt"))
    life = fit.tool_life(law, float(law.observed.max()) * 1.2)
    pf = parameters.collect(tool="T", work="W", laws=[law], tool_life=life)
    doubted = VerdictSection(level="usable with reservations", reasons=["Doubt."])
    laws = {"AW": pf.laws["AW"].model_copy(update={"verdict": doubted})}
    path = parameters.write(pf.model_copy(update={"laws": laws}), tmp_path / "params.json")
    out = run(path, "T", "V=180", "f=0.3", "d=2").out
    assert out.startswith("Verdict on the law of AW: usable with reservations. Doubt. Verdict on the tool life to AW")
    assert "No test reached the criterion" in out
    assert "EXTRAPOLATED" in out
    refused(run(path, "T", "V=180", "f=0.3", "d=2", "AW=0.2"), 2, "AW=0.2: AW is what its law gives", "--criterion")
