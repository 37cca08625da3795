"""The check before a controller: it finds each thing that is wrong, passes what is right, and never falls over."""

import json
import random
from dataclasses import replace

import control
import numpy as np
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.controllers import AdaptiveForceControl, ConstantLoad, ConstantRoughness, TurningRecursion
from fitmodels.core.errors import GateError, ParameterError
from fitmodels.fit.bayes.priors import Normal
from fitmodels.ident.model import Model
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loop import loop_of
from fitmodels.parameters import check, collect, read, write
from fitmodels.parameters.checks.loop_figures import closed_loop, figures
from fitmodels.parameters.file import _parse, sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.dynamics import DynamicsSection, PiSection
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import dlsim

MUTATIONS = 2500  # benchmarks/fuzz.py tries more
NONE = {"kind": "none", "reason": "given"}
# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18, at 50 Hz: feed voltage to spindle current
B, A = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
PLANT = {"b": B, "a": A, "nk": 1, "sample_time": 0.02, "unit_u": "V", "unit_y": "A"}
GAINS = {"kp": 0.3, "ki": 4.5, "sample_time": 0.02, "unit_u": "V", "unit_y": "A"}
SPECIFICATION = {"rise_time": 2.5, "settling_time": 5.0, "overshoot": 0.02, "ms": 1.4, "phase_margin": 60.0}
FORCE = {
    "m": 0.01, "alpha": 0.2, "beta": 1.0, "g1": 1e-5, "g2": 1e-4, "g3": 1e-4, "Kd": 0.5, "lam": 10.0,
    "unit_u": "mm/min", "set_points": [{"depth": 1.0, "force": 150.0}, {"depth": 2.0, "force": 200.0}],
}  # fmt: skip
ENGAGEMENT = {"engage_at": 0.15, "hysteresis": 0.02, "load_low": 0.01, "load_high": 0.6, "feed_programmed": 800.0}


def built():
    """A file of which everything is right."""
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    covariance = np.diag([4e-8, 1e-8, 1e-8, 1e-8, 4e-8, 1e-8])
    pf = collect(
        tool="end mill", work="S45C", laws=[fit.load_law(runs)], dynamics=Model(**PLANT, cov_params=covariance, n=750),
        pi={**GAINS, "specification": SPECIFICATION}, limits={"wear": 0.3, "feed_rate": (100, 2000), "power": 7},
        adaptive_force=FORCE, reading={"doubts": []},
    )  # fmt: skip
    line = parameters.settings(pf, 0.28, wear_limit=0.2, engagement=ENGAGEMENT)
    return with_verdict(sealed(pf, load_line=line), "laws.fm", "dynamics", "adaptive_force")


def with_verdict(pf, *parts, level="usable inside the tested region", reasons=()):
    """The file with another verdict of some parts, and laws without checks: seven rows have their own reservations."""
    verdict = {"level": level, "reasons": list(reasons)}
    for part in parts:
        pf = changed(pf, put(part, verdict=verdict, **({"checks": {}} if part.startswith("laws.") else {})))
    return pf


@pytest.fixture(scope="module")
def pf():
    return built()


def changed(pf, change):
    data = json.loads(json.dumps(pf.model_dump()))
    change(data)
    return sealed(_parse(json.dumps(data).encode(), "params.json"))


def put(section, **values):
    def change(data):
        here = data
        for step in section.split("."):
            here = here[int(step)] if isinstance(here, list) else here[step]
        here.update(values)

    return change


def test_a_good_file_passes_every_question(pf):
    report = check(pf)
    assert report.ok, report.failed
    assert {f.name for f in report.findings} == {
        "checksum", "verdict", "reading", "units", "covariance", "dynamics", "gains", "specification", "feed limits",
        "window", "reference", "engagement", "set points",
    }  # fmt: skip
    assert all(f.passed for f in report.findings)


@pytest.mark.parametrize(
    ("change", "name", "words"),
    [
        (put("laws.fm", unit="furlong"), "units", r"laws\.fm \(fm\): the unit 'furlong' is not known"),
        (put("laws.fm", unit="mm"), "units", r"the unit is 'mm', which does not have the dimension of mm/min"),
        (put("laws.fm.factors.0", unit="N"), "units", r"\(VB\): the unit is 'N'"),
        (
            put("limits.power", unit="N"),
            "units",
            r"limits\.power: the unit is 'N', which does not have the dimension of kW",
        ),
        (put("load_line", unit_load="V"), "units", r"load_line \(load\): the unit is 'V'"),
        (put("dynamics", unit_u="volts per hour"), "units", r"dynamics \(input\): the unit 'volts per hour'"),
        (put("dynamics", a=[1.0, -2.1, 1.2104, -0.1655]), "dynamics", "not stable, a pole at radius"),
        (put("dynamics", b=[0.0, 0.1, -0.2, 0.1]), "dynamics", "static gain is 0"),
        (
            put("dynamics.uncertainty", matrix=np.diag([1e-3] * 6).tolist()),
            "dynamics",
            "0.1812 A/V, has a standard error of .* sign is not known",
        ),
        (
            put("pi", probability=0.5, required_probability=0.9, verdict={"level": "usable inside the tested region"}),
            "gains",
            r"holds with probability 50 % .* required 90 %\), which allows 'usable with reservations' at best",
        ),
        (
            put(
                "pi", probability=0.95, required_probability=0.97, verdict={"level": "usable inside the tested region"}
            ),
            "gains",
            "probability 95 % .* allows 'usable with reservations' at best",
        ),
        (
            put(
                "pi",
                probability=0.4,
                probability_interval=[0.38, 0.42],
                verdict={"level": "usable with reservations", "reasons": ["Short."]},
            ),
            "gains",
            r"\(upper end of its interval 42 %\), which allows 'do not use for control' at best",
        ),
        (put("pi", kp=8.0), "gains", "not stable on the file's dynamics, a pole at radius 1.0"),
        (put("pi", kp=-0.3, ki=-4.5), "gains", "opposite signs"),
        (put("pi", sample_time=0.01), "gains", "run at 0.01 s and the dynamics at 0.02 s"),
        (put("pi", unit_u="mm/min"), "gains", "'mm/min' and the dynamics in 'V', and scaling_u is 1"),
        (put("pi", kp=0.1, ki=1.0), "specification", "miss rise time .* above the 2.5 asked for"),
        (put("pi.specification", phase_margin=85.0), "specification", "miss phase margin .* below the 85"),
        (put("pi", figures={"stable": True, "rise_time": 1.0}), "figures", "rise time 1 is 2"),
        (put("pi", figures={"stable": False}), "figures", "stated to be unstable"),
        (put("load_line.lower", value=-5.0, interval=NONE), "feed limits", "lower feed limit is -5 mm/min"),
        (put("load_line.lower", value=1100.0, interval=NONE), "feed limits", "1100 is not below the upper"),
        (put("load_line.lower", value=1.0), "feed limits", "lies outside its own interval"),
        (put("limits.feed_rate", high=900.0), "feed limits", "upper feed limit 996.372 is outside the machine's"),
        (put("load_line", window=[0.22, 0.18]), "window", "wrong order"),
        (put("load_line.lower", wear=0.3), "window", "a wear of 0.3 mm, outside the window"),
        (put("load_line.upper", wear=0.25), "window", "is for more wear than the lower"),
        (put("limits.wear", value=0.1), "window", "is above the criterion, 0.1"),
        (put("load_line", reference=0.3), "reference", "not between 0 and the load that a worn tool withstands"),
        (put("load_line", reference=0.2), "reference", "is not 0.85 x 0.28 = 0.238 A"),
        (put("load_line", worn=2.2, safety_factor=0.109), "reference", r"factor 0\.109 is below 0\.5: twice the ref"),
        (put("load_line", worn=0.85, safety_factor=0.28), "reference", r"0\.476 A, is below 0\.85 A and would not be"),
        (put("load_line", law="I"), "reference", "law of 'I' that the limits come from is not in the file"),
        (put("load_line.engagement", engage_at=0.24), "engagement", "engages at 0.25 A, not below the reference 0.24"),
        (put("load_line.engagement", load_low=0.7), "engagement", "leave no range"),
        (put("load_line.engagement", feed_programmed=500.0), "engagement", "below the lower feed limit"),
        (put("adaptive_force", lam=1e3), "set points", "alpha . Kd is not above lambda m"),
        (
            put("adaptive_force", set_points=[{"depth": 2.0, "force": 1.0}, {"depth": 1.0, "force": 1.0}]),
            "set points",
            "not in order of depth",
        ),
    ],
)
def test_each_thing_that_is_wrong_is_found(pf, change, name, words):
    report = check(changed(pf, change))
    assert not report.ok
    assert pytest.approx(0) == sum("\n" in f.words or not f.words.endswith((".", "?")) for f in report.findings)
    found = [f.words for f in report.failed if f.name == name]
    assert found, report.failed
    assert any(__import__("re").search(words, reported) for reported in found), found


@pytest.mark.parametrize(
    ("law", "values", "words"),
    [
        ("P", {"V": -0.82}, "lacks its coefficient V = -0.82 and has 0.82 there"),
        ("P", {"V": 0.0}, "lacks its coefficient V = 0"),
        ("P", {"f": 1.0}, "lacks its coefficient f = 1"),
        ("P", {"V": 0.61, "f": 0.82}, "lacks its coefficient V = 0.61 and has 0.82 there"),
        ("AW", {"t": 0.0}, "lacks its coefficient t = 0"),
    ],
)
def test_an_exponent_is_compared_with_its_sign_and_with_that_of_its_own_symbol(tmp_path, law, values, words):
    data = published("AC-2016").model_dump()
    exponents = data["laws"][law]["coefficients"]
    exponents |= values
    path = write(parameters.ParameterFile.model_validate(data), tmp_path / "params.json")
    assert words in " ".join(finding.words for finding in check(read(path), tmp_path).failed)


def test_powers_that_an_equation_leaves_out_are_1_and_0(tmp_path):
    milling = published("CLM-2023")
    assert milling.laws["VB"].equation.endswith(" t")
    exponents = milling.laws["VB"].coefficients
    assert (exponents["t"], exponents["fm"]) == (1.0, 0.0)
    assert not [one for one in check(milling, tmp_path).findings if one.name == "equation"]
    wrong = changed(milling, put("laws.VB.coefficients", fm=1.0))
    assert "lacks its coefficient fm = 1 and has 0 there" in " ".join(
        one.words for one in check(wrong, tmp_path).failed
    )


def test_a_load_of_a_worn_tool_that_no_test_comes_near_fails():
    milling = published("CLM-2023")  # tests up to 0.293 A
    reference = {"reference": 0.52, "worn": 1.0, "safety_factor": 0.52}
    words = "load_line: the load that a worn tool withstands, 1 A, is 3.41 times the largest load tested, 0.293 A, more"
    assert words in " ".join(one.words for one in check(changed(milling, put("load_line", **reference))).failed)
    assert not [one for one in check(milling).failed if one.name == "reference"]


@pytest.mark.parametrize("shifts", [{"2": -0.3}, {"2": 0.0}])
def test_the_shift_of_a_level_is_that_of_the_equation(pf, tmp_path, shifts):
    law = pf.model_dump()["laws"]["fm"]
    right = {"column": "material", "reference": "1", "shifts": {"2": 0.3}}
    none = {"kind": "none", "reason": "given"}
    words = law["equation"] + " for material 1; plus 0.3 for 2"
    leveled = changed(pf, put("laws.fm", by=right, equation=words, uncertainty=none, region=None, sums=None))
    assert not [one for one in check(leveled, tmp_path).findings if one.name == "equation"]
    wrong = check(changed(leveled, put("laws.fm.by", shifts=shifts)), tmp_path)
    assert "of level '2'" in next(one.words for one in wrong.failed if one.name == "equation")


@pytest.mark.parametrize("part", ["laws.fm", "dynamics", "adaptive_force"])
def test_a_part_that_must_not_be_used_fails_the_file(pf, part):
    reasons = [f"Reason {number}." for number in range(1, 6)]
    (finding,) = check(with_verdict(pf, part, level="do not use for control", reasons=reasons)).failed
    assert finding.name == "verdict"
    assert finding.words == (
        f"{part}: do not use for control. Reason 1. Reason 2. Reason 3. And 2 more reasons: see the card."
    )


@pytest.mark.parametrize("part", ["laws.fm", "dynamics", "adaptive_force"])
def test_reservations_and_an_unknown_verdict_are_notes(pf, part):
    held = with_verdict(pf, part, level="usable with reservations", reasons=["The file names no edges."])
    unknown = changed(pf, put(part, verdict=None))
    for file, words in ((held, "usable with reservations. The file names no edges."), (unknown, "there is no verdict")):
        report = check(file)
        assert report.ok
        (finding,) = [one for one in report.findings if one.name == "verdict" and one.passed is None]
        assert finding.words.startswith(f"{part}: {words}")


def test_a_tool_life_that_is_extrapolated_qualifies_itself_alone(pf):
    life = {
        "wear": "AW", "criterion": 0.3, "unit_of_wear": "mm", "unit": "min", "coefficients": {"c0": 200.0},
        "t_observed": 20.0, "typical": 200.0, "typical_at": {},
        "verdict": {"level": "do not use for control", "reasons": ["200 min is 10 times the longest test."]},
    }  # fmt: skip
    report = check(sealed(pf, tool_life=life))
    assert report.ok
    assert any(one.words.startswith("tool_life: do not use for control. 200 min") for one in report.findings)


def test_a_changed_number_is_found_by_its_checksum(pf, tmp_path):
    path = write(pf, tmp_path / "params.json")
    path.write_text(path.read_text().replace('"kp": 0.3', '"kp": 0.30000000000000004'))
    (bad,) = check(read(path)).failed
    assert bad.name == "checksum"
    assert "changed after it was written" in bad.words


def test_a_file_without_a_checksum_is_reported_and_passes(pf):
    bare = pf.model_copy(update={"content_sha256": None})
    report = check(bare)
    assert report.ok
    assert (report.findings[0].name, report.findings[0].passed) == ("checksum", None)


CONTROLLERS = {
    "CLM-2023": ConstantLoad.from_parameters,
    "LYAP": lambda pf: AdaptiveForceControl.from_parameters(pf, depth=2.0),
    "SURF": ConstantRoughness.from_parameters,
    "AC-2017": TurningRecursion.from_parameters,
}


@pytest.mark.parametrize("paper", CONTROLLERS)
def test_a_file_from_disk_without_a_checksum_drives_no_controller(tmp_path, paper):
    path = tmp_path / "params.json"
    path.write_text(json.dumps({**published(paper).model_dump(), "content_sha256": None}), "utf-8")
    assert check(read(path)).failed[0].name == "checksum"
    with pytest.raises(GateError, match="no content_sha256"):
        CONTROLLERS[paper](read(path))
    CONTROLLERS[paper](read(write(published(paper), path, force=True)))


def test_gains_that_are_marked_as_forced_may_miss_but_not_be_unstable(pf):
    missing = check(changed(pf, put("pi", kp=0.1, ki=1.0, forced="a trial at the bench")))
    assert missing.ok
    assert any(f.passed is None and "marked as forced: a trial at the bench" in f.words for f in missing.findings)
    assert not check(changed(pf, put("pi", kp=8.0, forced="a trial at the bench"))).ok


@pytest.mark.parametrize(("name", "words"), [("gain_margin", "gain margin"), ("delay_margin", "delay margin")])
def test_stated_margins_are_those_of_the_loop(pf, name, words):
    right = figures(closed_loop(pf.dynamics, pf.pi))[name]
    for times, ok in ((1.0, True), (0.1, False), (10.0, False)):
        stated = check(changed(pf, put("pi", figures={"stable": True, name: times * right})))
        assert stated.ok is ok
        assert any(words in finding.words for finding in stated.failed) is not ok


def test_a_reference_is_a_multiple_of_its_rounding(pf):
    assert check(changed(pf, put("load_line", rounded_to=None if pf.load_line.rounded_to is None else 0.01))).ok
    wrong = check(changed(pf, put("load_line", rounded_to=0.1))).failed
    assert any("is not rounded to 0.1" in finding.words for finding in wrong)


def test_gains_in_other_units_are_tried_through_their_scaling(pf):
    """1459 mm/min in one volt: the same controller."""
    scaled = put("pi", kp=0.3 * 1459, ki=4.5 * 1459, unit_u="mm/min", scaling_u=1459.0)
    one, other = (figures(closed_loop(f.dynamics, f.pi)) for f in (pf, changed(pf, scaled)))
    for name in ("rise_time", "ms", "phase_margin", "gain_margin"):
        assert other[name] == pytest.approx(one[name], rel=1e-9)
    assert other["travel"] == pytest.approx(1459 * one["travel"], rel=1e-9)
    assert check(changed(pf, scaled)).ok


# --- the posterior and its draws ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"criterion": 2.0},
            "tool_life: the law of AW gives 0.3 mm after the typical life, 99.06 min, not its criterion",
        ),
        ({"c0": 10.0}, "tool_life: its coefficients give 990.6 min, not the typical life, 99.06 min"),
        ({"c0": 10.0, "typical": 10.0}, "after the typical life, 990.6 min, not its criterion"),
    ],
)
def test_a_tool_life_is_that_of_its_law_of_wear(values, words):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    wear = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    pf = collect(tool="GC435", work="709M40", laws=[wear], tool_life=fit.tool_life(wear, 0.3))
    assert check(pf).ok

    def change(data):
        life = data["tool_life"]
        life["criterion"] = values.get("criterion", life["criterion"])
        life["typical"] *= values.get("typical", 1.0)
        life["coefficients"]["c0"] *= values.get("c0", 1.0)

    assert words in " ".join(finding.words for finding in check(changed(pf, change)).failed)


@pytest.fixture(scope="module")
def of_wear():
    """A file with a wear law, its sums and a tool life."""
    wear = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    return collect(tool="GC435", work="709M40", laws=[wear], tool_life=fit.tool_life(wear, 0.3))


@pytest.mark.parametrize(
    ("section", "name", "words"),
    [
        ("laws.AW", "residual_se", "laws.AW: its coefficients and sums give a scatter of 0.095"),
        ("laws.AW", "smearing", "laws.AW: its mean is "),
        ("tool_life", "taylor_n", "tool_life: its exponent of V, "),
        ("tool_life", "t_observed", "tool_life: its longest test, 200 min, is longer than those of the law of AW, 20"),
    ],
)
@pytest.mark.parametrize("times", [0.1, 10.0])
def test_figures_of_a_law_are_those_of_its_sums_and_coefficients(of_wear, section, name, words, times):
    assert check(of_wear).ok
    held = of_wear.laws["AW"] if section == "laws.AW" else of_wear.tool_life
    found = check(changed(of_wear, put(section, **{name: times * getattr(held, name)}))).failed
    harmless = (name, times) == ("t_observed", 0.1)  # more is extrapolated
    assert any(words in finding.words for finding in found) is not harmless, found


def test_wears_at_which_an_edge_is_changed_are_in_the_range_of_limits(pf):
    for section, field in (("limits.wear", "value"), ("load_line", "window")):
        high = {"value": 2.2, "window": [0.18, 2.2]}[field]
        found = [one.words for one in check(changed(pf, put(section, **{field: high}))).findings if one.name == "doubt"]
        assert any("up to 2.2 mm is unusual, beyond 1 mm" in words for words in found), found
    worn = check(changed(pf, put("load_line", window=[0.18, 7.0]))).failed
    assert "load_line.window: VB up to 7 mm is impossible, beyond 5 mm; correct it." in [one.words for one in worn]


@pytest.mark.parametrize(("name", "value"), [("power", 7.0), ("force", 1500.0)])
def test_a_limit_of_load_that_its_law_never_reaches_in_the_tests_is_doubted(name, value):
    pf = published("AC-2017")
    limits = pf.limits.model_dump()

    def doubts(times):
        of = sealed(pf, limits={**limits, name: {**limits[name], "value": times * value}})
        return [one.words for one in check(of).findings if "has no effect there" in one.words]

    assert not doubts(1.0)
    assert not doubts(3.0)  # a strong machine and a light cut
    (words,) = doubts(10.0)
    assert words.startswith(f"limits.{name}: ")


@pytest.fixture(scope="module")
def with_posterior():
    """A file with a law and its posterior, and the same with a prior that the data contradict."""
    law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    weak = fit.posterior(law, seed=1, draws=1000)
    narrow = replace(weak.priors, of={**weak.priors.of, "V": Normal(-0.4, 0.01)}, name="given")
    posteriors = (weak, fit.posterior(law, seed=1, draws=1000, priors=narrow))
    return [collect(tool="GC435", work="709M40", laws=[law], posteriors=[post]) for post in posteriors]


def with_equation(pf, **coefficients):
    """The file with other coefficients of its law, and the equation of these."""

    def change(data):
        law = data["laws"]["AW"]
        law["coefficients"] |= coefficients
        law["sums"] = None  # by them any change of a coefficient is seen
        texts = [f"{law['coefficients'][name]:.6g}" for name in pf.laws["AW"].formula.names]
        law["equation"] = f"AW = {pf.laws['AW'].formula.equation(texts)}"

    return changed(pf, change)


def test_a_law_is_compared_with_its_own_posterior(with_posterior):
    pf = with_posterior[0]
    of = pf.laws["AW"].coefficients
    assert check(pf).ok
    assert check(with_equation(pf, V=of["V"] + 1e-3)).ok
    for other in ({"c0": of["c0"] / 10}, {"V": of["V"] + 0.6}, {"V": -of["V"]}, {"c0": of["c0"] * 1.3}):
        report = check(with_equation(pf, **other))
        assert {finding.name for finding in report.failed} == {"law"}, other
    assert "laws.AW: in the middle of the tests it gives" in report.failed[0].words
    assert check(with_equation(pf, V=of["V"] + 1.0)).failed[1].words.startswith("laws.AW: its coefficient V is 1.53")


def test_an_informative_prior_may_move_the_posterior_away_from_the_law(with_posterior):
    law, post = with_posterior[1].laws["AW"], with_posterior[1].posterior.laws["AW"]
    assert law.coefficients["V"] - post.parameters["V"].mean > 10 * post.parameters["V"].sd
    assert not [finding for finding in check(with_posterior[1]).failed if finding.name == "law"]


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"high": 200000.0}, "the tested range of V is 50 to 200000 m/min, in its own region 50 to 200 m/min"),
        ({"low": 5.0}, "is 5 to 200 m/min, in its own region 50 to 200 m/min"),
        ({"low": -50.0}, "is -50 to 200 m/min; it cannot be below zero"),
    ],
)
def test_a_tested_range_is_that_of_the_region_and_not_below_zero(with_posterior, ends, words):
    wrong = changed(with_posterior[0], put("laws.AW.factors.0", **ends))
    assert [words in finding.words for finding in check(wrong).failed] == [True]


def drawn(folder):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    post = fit.posterior(law, seed=1, draws=1000)
    pf = collect(tool="GC435", work="709M40", laws=[law], posteriors=[post])
    (folder / "draws.npz").write_bytes(parameters.draws_of([post]))
    return pf


def test_draws_beside_the_file_are_looked_at(tmp_path):
    pf = drawn(tmp_path)
    assert check(pf, tmp_path).ok
    assert any(f.name == "draws" and f.passed is None for f in check(pf).findings)
    shut = changed(pf, put("posterior.laws.AW", r_hat=1.2, ess=30.0, k_hat=0.9))
    (gate,) = [f.words for f in check(shut, tmp_path).failed]
    for words in ("R-hat 1.2 is above 1.01", "30 effective draws, fewer than 400", "k-hat 0.9 is above 0.7"):
        assert words in gate
    content = bytearray((tmp_path / "draws.npz").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "draws.npz").write_bytes(bytes(content))
    assert "not the draws" in check(pf, tmp_path).failed[0].words
    (tmp_path / "draws.npz").unlink()
    assert "cannot be read" in check(pf, tmp_path).failed[0].words


@pytest.mark.parametrize("name", ["../draws.npz", "/tmp/draws.npz", "a\\b.npz", ".draws.npz", "draws.npz\n", "x.pkl"])  # noqa: S108
def test_a_draws_file_stands_beside_its_file(pf, name):
    with pytest.raises(ParameterError, match=r"posterior\.draws_file"):
        changed(pf, lambda d: d.update(posterior={"seed": 1, "draws_file": name}))


# --- the loop, against others -------------------------------------------------------------------------


def loop_by_control(kp, ki):
    plant = control.TransferFunction(B[1:], A, 0.02)
    pi = control.TransferFunction([kp + ki * 0.02, -kp], [1, -1], 0.02)  # backward sum
    return plant * pi


@pytest.mark.parametrize(("kp", "ki"), [(0.3, 4.5), (0.05, 2.0), (2.0, 8.0)])
def test_margins_are_those_of_python_control(kp, ki):
    found = figures(closed_loop(DynamicsSection(**PLANT, uncertainty=NONE), PiSection(kp=kp, ki=ki, sample_time=0.02)))
    gm, pm, *_ = control.stability_margins(loop_by_control(kp, ki), method="poly")
    assert found["gain_margin"] == pytest.approx(gm, rel=1e-5)
    assert found["phase_margin"] == pytest.approx(pm, rel=1e-4)


def test_the_gain_where_the_published_loop_becomes_unstable():
    """A gain alone above 7.868 V/A is unstable at 50 Hz, from the printed decimals."""
    model = DynamicsSection(**PLANT, uncertainty=NONE)
    inside, outside = (closed_loop(model, PiSection(kp=kp, ki=0.0, sample_time=0.02)).radius for kp in (7.86, 7.88))
    assert inside < 1 < outside


def test_the_step_is_that_of_scipy():
    T = control.feedback(loop_by_control(0.3, 4.5), 1)
    num, den = T.num[0][0], T.den[0][0]
    _, y = dlsim((num, den, 0.02), np.ones(2000))
    y = y[:, 0]
    found = figures(
        closed_loop(DynamicsSection(**PLANT, uncertainty=NONE), PiSection(kp=0.3, ki=4.5, sample_time=0.02))
    )
    assert found["rise_time"] == pytest.approx((np.argmax(y >= 0.9) - np.argmax(y >= 0.1)) * 0.02, abs=0.02)
    assert found["settling_time"] == pytest.approx((np.flatnonzero(abs(y - 1) > 0.02)[-1] + 1) * 0.02, abs=0.02)
    assert found["overshoot"] == pytest.approx(max(y.max() - 1, 0), abs=1e-6)


FORMS = [
    {},
    {"form": "incremental"},
    {"form": "incremental_sum", "kp": 0.005, "ki": 0.001},
    {"integration": "trapezoidal", "delay": 2},
    {"integration": "forward", "filter_time": 0.05},
    {"average": 5},
    {"average": 5, "average_of": "command", "filter_time": 0.03},
    {"ki": 0.0, "kp": 2.0},
]


@pytest.mark.parametrize("changes", FORMS, ids=str)
def test_figures_are_those_of_the_tuner(changes):
    """Two programs, polynomials here and a recursion there; times, peaks and margins agree."""
    given_ = {**GAINS, **changes}
    theirs = loop_of(Model(**PLANT), PiGains(**given_)).figures()
    ours = figures(closed_loop(DynamicsSection(**PLANT, uncertainty=NONE), PiSection(**given_)))
    for name, value in ours.items():
        other = getattr(theirs, "disturbance_peak" if name == "disturbance" else name)
        assert value == pytest.approx(other, rel=2e-3, abs=1e-5), name


@settings(max_examples=60, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_units_of_command_and_load_do_not_matter(u, y):
    model, gains = DynamicsSection(**PLANT, uncertainty=NONE), PiSection(**GAINS)
    scaled = PiSection(**{**GAINS, "kp": 0.3 * u / y, "ki": 4.5 * u / y, "scaling_u": u, "scaling_y": y})
    one, other = figures(closed_loop(model, gains)), figures(closed_loop(model, scaled))
    for name in ("rise_time", "settling_time", "ms", "gain_margin", "phase_margin"):
        assert other[name] == pytest.approx(one[name], rel=1e-6)


@pytest.mark.slow
def test_a_long_average_does_not_take_long():
    """Of 1000 samples: the characteristic polynomial is too long for its roots, and stable or not all the same."""
    model = DynamicsSection(**PLANT, uncertainty=NONE)
    slow, fast = (
        closed_loop(model, PiSection(kp=0.0, ki=ki, sample_time=0.02, average=1000, delay=1000)) for ki in (0.01, 5.0)
    )
    assert slow.radius < 1 < fast.radius
    assert figures(slow)["settling_time"] > 20.0


# --- never a traceback, never a hang --------------------------------------------------------------------

WORST = [None, -1, 0, 1e308, -1e308, -0.0, 5e-324, 1e-300, True, "", "V", [], {}, [[1.0]], {"a": 1}, 10**30, "../x"]


def places(data, here=()):
    for key, inner in data.items() if isinstance(data, dict) else enumerate(data):
        yield data, key
        if isinstance(inner, dict | list):
            yield from places(inner, (*here, key))


def damaged(rng, content):
    start = rng.randrange(len(content))
    stop = min(len(content), start + rng.randrange(1, 30))
    tokens = [b"null", b"-1", b"1e400", b"NaN", b'""', b"[]", b"{}", b"9", b"1e308", b"-", b"\xff", b"}"]
    return content[:start] + rng.choice([b"", content[start:stop] * 2, rng.choice(tokens)]) + content[stop:]


def judged(content):
    """Whether a file passes the check, or the sentence that refuses to read it."""
    try:
        return check(_parse(content, "params.json")).ok
    except ParameterError as error:
        return str(error)


@pytest.mark.slow
def test_thousands_of_damaged_files_are_named_errors_or_valid_files(pf):
    """A file is read and checked, or refused in one sentence; what is read can be written again."""
    rng = random.Random(20240501)  # noqa: S311
    bulk = {"checks", "verdicts", "region", "edges", "statistics", "notes"}  # long, and never looked at by the check
    data = json.loads(json.dumps(pf.model_dump(exclude_none=True, exclude={"laws": {"fm": bulk}})))
    good = json.dumps(data).encode()
    where = list(places(data))
    valid = failed = 0
    for turn in range(MUTATIONS):
        if turn % 2:
            content = damaged(rng, good)
        else:
            holder, key = rng.choice(where)
            kept, holder[key] = holder[key], rng.choice(WORST)
            content = json.dumps(data).encode()
            holder[key] = kept
        found = judged(content)
        assert isinstance(found, bool) or "\n" not in found
        valid += isinstance(found, bool)
        failed += found is False
    assert MUTATIONS / 10 < valid < MUTATIONS
    assert failed > valid / 2  # by the checksum alone: nearly all


# --- the command --------------------------------------------------------------------------------------


def test_the_command_prints_every_finding(pf, tmp_path, capsys):
    path = write(pf, tmp_path / "params.json")
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "ok    The content is unchanged." in out
    assert "note  No control can be exported: the file has a PI that commands 'V'" in out
    assert "`fitmodels tune params.json ... --scaling S --unit mm/min --force`, S in mm/min per V." in " ".join(
        out.split()
    )
    of_controls = 2  # constant load, and adaptive force, which lacks settings
    assert out.endswith(f"{len(check(pf).findings) + of_controls} findings, all checks passed.\n")


def test_the_command_shows_doubts_about_the_data_and_passes(pf, tmp_path, capsys):
    doubt = {"columns": ["VB"], "sentence": "VB 1.2 to 1.9 mm is unusual", "remedy": "--unit VB=um"}
    path = write(sealed(pf, reading={"doubts": [doubt]}), tmp_path / "params.json")
    assert main(["check", str(path)]) == 0
    assert "doubt VB 1.2 to 1.9 mm is unusual. Remedy: fitmodels data.csv --unit VB=um" in capsys.readouterr().out


def test_a_corrected_reading_says_that_no_doubt_is_left_with_all_corrections(pf):
    options = {"correct": ["lines 31:I/1000", "E07:f*25.4"], "leave_out": ["lines 5"]}
    origin = {"fitmodels": "0.1.0", "data_file": "x.xlsx", "options": options}
    (found,) = [f for f in check(sealed(pf, provenance=origin)).findings if f.name == "reading"]
    assert found.passed
    assert found.words == (
        "No doubt is left about the reading of x.xlsx; corrected: lines 31:I/1000, E07:f*25.4; left out: lines 5."
    )


RECORD = "The record of the dynamics was made about"


@pytest.mark.parametrize(
    ("point", "noted"),
    [((0.14, 0.026), True), ((5.0, 0.24), False), ((5.0, 240.0), True), (None, False)],
)
def test_a_record_made_outside_the_loads_tested_is_a_note(point, noted):
    """At 0.24 A lie the tests of the paper; a note that states deviations answers the question."""
    pf = published("CLM-2023")
    usable = {"level": "usable inside the tested region"}
    laws = {"I": {**pf.laws["I"].model_dump(), "verdict": usable}}
    model = {**pf.dynamics.model_dump(), "operating_point": point}
    report = check(sealed(pf, laws=laws, dynamics=model))
    found = [f for f in report.findings if f.name == "record"]
    assert bool(found) == noted
    assert all(f.passed is None and RECORD in f.words for f in found)
    said = {**model, "notes": ["From the file: deviations from a cut at 0.24 A."]}
    assert not [f for f in check(sealed(pf, laws=laws, dynamics=said)).findings if f.name == "record"]


def test_a_file_whose_data_were_not_judged_says_so(pf):
    (found,) = [f for f in check(sealed(pf, reading=None)).findings if f.name == "reading"]
    assert found.passed is None
    assert "fitmodels look data.csv" in found.words


def test_the_command_fails_with_5(pf, tmp_path, capsys):
    path = write(changed(pf, put("pi", kp=8.0)), tmp_path / "params.json")
    assert main(["check", str(path), "--json"]) == 5
    facts = json.loads(capsys.readouterr().out)
    assert (facts["schema"], facts["ok"]) == ("fitmodels.check/1", False)
    assert any(f["passed"] is False and "not stable" in f["words"] for f in facts["findings"])


@pytest.mark.parametrize(("content", "code"), [("{}", 3), ("", 3), (None, 3)])
def test_the_command_names_what_is_no_parameter_file(tmp_path, capsys, content, code):
    path = tmp_path / "params.json"
    if content is not None:
        path.write_text(content)
    assert main(["check", str(path)]) == code
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("section", "change", "words"),
    [
        ("dynamics", {"held_out_fit": 188.5}, "held_out_fit is 188.5 %, and a fit is at most 100 %"),
        ("dynamics", {"own_fit": 188.5}, "own_fit is 188.5 %, and a fit is at most 100 %"),
        ("dynamics", {"held_out_fit": -99.0}, "held_out_fit is -99 %, which does not allow 'usable"),
        ("dynamics", {"own_fit": -99.0}, "own_fit is -99 %, which does not allow 'usable"),
        ("dynamics", {"unit_u": "mm/s"}, "which are units of one dimension: 60"),
        ("pi", {"unit_u": "kW"}, "the command is in 'kW', and the feed limits of the file in mm/min"),
    ],
)
def test_one_value_that_cannot_be_beside_the_others_fails(section, change, words):
    """Each of these, sealed again, passed."""
    pf = published("CLM-2023")
    usable = {"level": "usable inside the tested region", "reasons": []}
    pf = sealed(pf, dynamics={**pf.dynamics.model_dump(), "verdict": usable, "held_out_fit": 98.0, "own_fit": 98.0})
    gains = {"kp": 644.7, "ki": 7291.6, "form": "position", "average": 1, "setpoint_weight": 1.0, "scaling_u": 1533.0}
    pf = sealed(pf, pi={**gains, "sample_time": pf.dynamics.sample_time, "unit_u": "mm/min", "unit_y": "A"})
    assert not any(words in f.words for f in parameters.check(pf).failed)
    changed = sealed(pf, **{section: {**getattr(pf, section).model_dump(), **change}})
    assert any(words in finding.words for finding in parameters.check(changed).failed)
