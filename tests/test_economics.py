"""Cost and time of a part: closed forms, an independent optimiser, age replacement, what the draws state."""

import json
from dataclasses import replace
from math import inf, log
from pathlib import Path

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cards.replays import replayed
from fitmodels.cli import main
from fitmodels.controllers.economics.age_replacement import change_interval
from fitmodels.controllers.economics.display import of_economic_settings
from fitmodels.controllers.economics.optimum import economic_settings
from fitmodels.controllers.economics.part_cost import PowerSum, Sides, cost_of_part, least, time_of_part
from fitmodels.controllers.region.log_planes import LogPlane
from fitmodels.core.errors import DataError, UsageError
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.base import VerdictSection
from fitmodels.parameters.sections.costs import CostsSection, PartCut
from pydantic import ValidationError
from scipy.optimize import minimize

CLOSED = 1e-6  # relative, of speeds and costs with a closed form
SEARCHED = 1e-4  # relative, of the end of another optimiser
PRINTED = 6e-6  # half a unit of the last digit of reference figures with five decimals

# Taylor's n .125, C 70; L 500 mm, D 100 mm, f .25 mm/rev; th 5 min, tc 2 min, Cm .50 and Ct 3: closed forms of
# Kalpakjian & Schmid, Manufacturing Engineering and Technology, section on economics of machining
TAYLOR = CostsSection(
    currency="USD", machine=30.0, edge=3.0, change=2.0, handling=5.0, cut=PartCut(length=500.0, diameter=100.0)
)


def taylor(n: float, C: float) -> LogPlane:
    return LogPlane(
        "T", "tool life", "min", np.array([log(C) / n]), np.array([[-1 / n, 0.0]]), np.zeros(1), np.zeros(1)
    )


def within(V: tuple[float, float], f: tuple[float, float]) -> Sides:
    a = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
    return Sides(np.array([a]), np.array([[log(V[1]), -log(V[0]), log(f[1]), -log(f[0])]]))


def test_taylor_speeds_equal_the_closed_forms():
    life, sides = taylor(0.125, 70.0), within((10.0, 400.0), (0.25, 0.25))
    cost, time = cost_of_part(TAYLOR, 2.0, life), time_of_part(TAYLOR, 2.0, life)
    for which, T in ((time, 7 * 2.0), (cost, 7 * (2.0 + 3.0 / 0.5))):  # 1/n - 1 times tc, and times tc + Ct/Cm
        V = float(np.exp(least(which, sides)[0, 0]))
        assert pytest.approx(70.0 / T**0.125, rel=CLOSED) == V
    at = least(time, sides), least(cost, sides)
    found = [float(of.value(x)[0]) for x in at for of in (time, cost)]
    assert found == pytest.approx([19.26723, 12.30872, 20.37607, 10.98335], abs=PRINTED)


def of_lives(power: float = 5.0, roughness: float = 3.2) -> parameters.ParameterFile:
    """T = 7.5e9 V^-4 f^-1.6 d^-.6, P = 1780 d f^.74 V / 60000 kW, Ra = 1000 f^2 / 25.6 um."""

    def law(response, quantity, unit, c0, exponents):
        ends = {"V": (20.0, 1000.0, "m/min"), "f": (0.05, 1.0, "mm/rev"), "d": (0.5, 5.0, "mm")}
        equation = f"{response} = {c0:.15g} {' '.join(f'{s}^{p:.15g}' for s, p in exponents.items())}"
        return {
            "form": "power", "response": response, "quantity": quantity, "unit": unit, "equation": equation,
            "error": "multiplicative", "coefficients": {"c0": c0, **exponents}, "n": 0, "df": 0,
            "factors": [
                {"symbol": s, "quantity": s, "unit": ends[s][2], "low": ends[s][0], "high": ends[s][1]}
                for s in exponents
            ],
            "uncertainty": {"kind": "none", "reason": "stated"}, "residual_se": 0.1, "residual_scale": "ln",
        }  # fmt: skip

    return parameters.ParameterFile.model_validate(
        {
            "identity": {"tool": "A", "work": "B", "simulated": True},
            "laws": {
                "T": law("T", "tool life", "min", 7.5e9, {"V": -4.0, "f": -1.6, "d": -0.6}),
                "P": law("P", "power", "kW", 1780 / 60000, {"V": 1.0, "f": 0.74, "d": 1.0}),
                "Ra": law("Ra", "roughness", "um", 1000 / 25.6, {"f": 2.0}),
            },
            "limits": {
                "power": {"value": power, "unit": "kW"}, "responses": {"Ra": {"high": roughness, "unit": "um"}},
                "speed": {"low": 20.0, "high": 1000.0, "unit": "m/min"},
                "feed": {"low": 0.05, "high": 1.0, "unit": "mm/rev"},
            },
            "provenance": {"fitmodels": "0.1.0"},
        }
    )  # fmt: skip


COSTS = CostsSection(currency="EUR", machine=30.0, edge=3.0, change=2.0, cut=PartCut(length=120.0, diameter=100.0))


@pytest.mark.parametrize(
    ("f", "V", "cost"), [(0.1, 300.994, 0.834991), (0.2, 228.111, 0.550889), (0.4, 172.876, 0.363451)]
)
def test_without_limits_the_life_is_the_same_at_every_feed(f, V, cost):
    """T* = (p - 1)(tc + Ct / Cm) = 24 min; the feed goes to its bound."""
    limits = {"power": None, "responses": {}, "feed": (f / 2, f)}
    best = economic_settings(of_lives(), COSTS, d=2.0, limits=limits).least_cost
    assert (best.V, best.cost) == (pytest.approx(V, abs=6e-4), pytest.approx(cost, abs=6e-7))
    assert (best.f, best.life) == (pytest.approx(f, rel=CLOSED), pytest.approx(24.0, rel=CLOSED))


def test_with_limits_the_optimum_is_that_of_slsqp():
    found = economic_settings(of_lives(), COSTS, d=2.0)
    best = found.least_cost
    assert (best.f, best.V, best.cost) == (
        pytest.approx(0.2862167, abs=6e-8), pytest.approx(197.642, abs=6e-4), pytest.approx(0.4442883, abs=6e-8)
    )  # fmt: skip
    assert best.held_by == ("Ra 3.2 um",)
    laws = of_lives().laws

    def cost(x):
        V, f = np.exp(x)
        cut = np.pi * 100 * 120 / (1000 * V * f)
        return 0.5 * cut + (0.5 * 2 + 3) * cut / laws["T"].values(V=V, f=f, d=2.0)

    power = {"type": "ineq", "fun": lambda x: 5 - laws["P"].values(V=np.exp(x[0]), f=np.exp(x[1]), d=2.0)}
    rough = {"type": "ineq", "fun": lambda x: 3.2 - laws["Ra"].values(f=np.exp(x[1]))}
    other = minimize(cost, np.log([100.0, 0.2]), constraints=[power, rough], method="SLSQP", options={"ftol": 1e-14})
    assert [best.V, best.f] == pytest.approx(np.exp(other.x).tolist(), rel=SEARCHED)


@pytest.mark.parametrize("seed", range(12))
def test_the_optimum_of_any_convex_sum_is_that_of_another_optimiser(seed):
    """Random terms and half planes about a square; SLSQP from several points, and nothing below it on a grid."""
    rng = np.random.default_rng(seed)
    m = 3 + seed % 2
    cost = PowerSum(("a", "b", "c", "d")[:m], rng.normal(0, 1, (1, m)), rng.normal(0, 1.5, (1, m, 2)))
    square = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    a = np.concatenate([rng.normal(0, 1, (3, 2)), square])
    b = np.concatenate([rng.uniform(0.1, 1.0, 3), np.full(4, 1.5)])
    sides = Sides(a[None], b[None])
    x = least(cost, sides)
    assert float(sides.beyond(x)[0]) < 1e-9
    ends = [
        minimize(lambda x: cost.value(x[None])[0], start, constraints={"type": "ineq", "fun": lambda x: b - a @ x},
                 method="SLSQP", options={"ftol": 1e-13, "maxiter": 200})
        for start in (np.zeros(2), np.array([0.05, -0.05]))
    ]  # fmt: skip
    assert float(cost.value(x)[0]) == pytest.approx(min(end.fun for end in ends), rel=SEARCHED)
    points = np.stack(np.meshgrid(*[np.linspace(-1.5, 1.5, 81)] * 2), axis=-1).reshape(-1, 2)
    kept = points[(points @ a.T <= b).all(axis=-1)]
    assert float(cost.value(x)[0]) <= float(cost.value(kept[:, None, :]).min()) * (1 + 1e-9)


def test_limits_that_exclude_each_other_are_named():
    with pytest.raises(DataError, match=r"P at most 0.01 kW exclude each other.*worn edge"):
        economic_settings(of_lives(power=0.01), COSTS, d=2.0)
    empty = Sides(np.array([[[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]]), np.array([[0.0, -1.0, 1.0, 1.0]]))
    assert np.isnan(least(PowerSum(("a",), np.zeros((1, 1)), -np.ones((1, 1, 2))), empty)).all()


def test_the_paper_of_2017_at_a_constant_pair():
    """200 m/min and .200 mm/rev: T 14.730 min, .0077155 per cm3 and 88.045 cm3/min with a change of 2 min."""
    costs = CostsSection(currency="USD", machine=30.0, edge=3.0, change=2.0)
    found = economic_settings(published("AC-2017"), costs, today=(200.0, 0.2))
    now = found.today
    assert (now.life, now.cost, 1 / now.time) == (
        pytest.approx(14.730, abs=6e-4), pytest.approx(0.0077155, abs=6e-8), pytest.approx(88.045, abs=6e-4)
    )  # fmt: skip
    assert now.exceeds == ()
    assert found.least_cost.held_by == ("Fxz 1500 N", "V 200 m/min")
    full = economic_settings(published("AC-2017"), costs, times="full").least_cost
    assert full.held_by == ("P 7 kW", "f 0.6 mm/rev")  # with the factors t the force of a worn edge is lower
    assert full.beyond == ("life 18 min (longest test 15 min)",)


def test_a_depth_outside_the_tests_is_named_as_a_speed_would_be():
    costs = CostsSection(currency="USD", machine=30.0, edge=3.0, change=2.0)
    low, high = next((one.low, one.high) for one in published("AC-2017").laws["AW"].factors if one.symbol == "d")
    deep = economic_settings(published("AC-2017"), costs, d=1.2 * high).least_cost
    assert f"d {1.2 * high:.4g} mm (tested {low:g} to {high:g})" in deep.beyond
    assert not any(words.startswith("d ") for words in economic_settings(published("AC-2017"), costs).least_cost.beyond)


def of_lives_in_a_ball(radius: float) -> parameters.ParameterFile:
    """`of_lives` whose tests lie within a coded radius of their centre, V 141 m/min, f .224 mm/rev, d 1.58 mm."""
    pf = of_lives()
    law = pf.laws["T"]
    ends = np.log([[f.low, f.high] for f in law.factors])
    region = {
        "logs": True, "centre": ends.mean(axis=1).tolist(), "half_range": (np.ptp(ends, axis=1) / 2).tolist(),
        "largest_radius": radius, "levels": [], "spaces": [],
    }  # fmt: skip
    whole = json.loads(pf.model_dump_json(exclude_none=True))
    whole["laws"]["T"]["region"] = region
    return parameters.ParameterFile.model_validate(whole)


def test_a_combination_outside_the_tests_is_named_as_by_a_prediction_with_the_best_setting_inside():
    pf = of_lives_in_a_ball(0.25)
    law, found = pf.laws["T"], economic_settings(pf, COSTS, d=2.0)
    best, held = found.least_cost, found.tested
    assert not law.inside(V=best.V, f=best.f, d=2.0)
    assert best.beyond == ("the combination is farther from the centre of the tests than any test of T",)
    shown = of_economic_settings(found)
    assert "outside the tests" in shown.head
    assert any("Least cost lies outside the tests: the combination" in words for words in shown.sentences)
    assert held is not None
    assert (held.beyond, held.held_by) == ((), ("tested region of T",))
    assert "least within tests" in shown.table.header
    V, f = np.exp(np.meshgrid(np.linspace(np.log(100), np.log(400), 301), np.linspace(np.log(0.1), np.log(0.5), 301)))
    kept = law.inside(V=V, f=f, d=np.full_like(V, 2.0)) & (pf.laws["P"].values(V=V, f=f, d=np.full_like(V, 2.0)) <= 5)
    cost = found.cost.value(np.log(np.stack([V, f], axis=-1)).reshape(-1, 2)).reshape(V.shape)
    assert held.cost <= cost[kept & (f <= 0.2862)].min()
    assert held.cost == pytest.approx(cost[kept & (f <= 0.2862)].min(), rel=1e-3)


def test_a_setting_inside_the_tests_has_no_second_one_beside_it():
    found = economic_settings(of_lives_in_a_ball(0.5), COSTS, d=2.0)
    assert (found.least_cost.beyond, found.tested) == ((), None)
    assert "outside" not in of_economic_settings(found).head
    nowhere = economic_settings(of_lives_in_a_ball(0.1), COSTS, d=2.0)
    assert nowhere.tested is None
    assert "No pair within the limits was found inside the tested region" in " ".join(
        of_economic_settings(nowhere).sentences
    )


@pytest.mark.parametrize("not_knowing", [0.0, 0.02])
def test_tests_are_not_called_worthless_where_the_optimum_is_extrapolated(not_knowing):
    for d in (2.0, 6.0):
        found = replace(economic_settings(of_lives(), COSTS, d=d), not_knowing=not_knowing)
        words = " ".join(of_economic_settings(found).sentences)
        assert bool(found.least_cost.beyond) == (d > 5)
        assert ("only tests at this setting show" in words) == (d > 5)
        assert ("further tests are worth no more" in words or "would not change it" in words) == (d < 5)


def test_energy_is_that_of_the_mean_power_over_the_life():
    costs = CostsSection(currency="EUR", machine=30.0, edge=3.0, change=2.0, energy=0.3, efficiency=0.8)
    found = economic_settings(published("AC-2017"), costs, times="full").least_cost
    laws = published("AC-2017").laws
    t = np.linspace(0, found.life, 200001)[1:]
    wear = laws["AW"].values(V=found.V, f=found.f, d=2.5, t=t)
    power = laws["P"].values(V=found.V, f=found.f, d=2.5, t=t, AW=wear)
    assert found.parts["energy"] == pytest.approx(power.mean() * found.cut / 60 * 0.3 / 0.8, rel=1e-3)
    assert sum(found.parts.values()) == pytest.approx(found.cost, rel=1e-12)


# Least costs per minute with planned change 4; the root of the first-order condition and a minimiser agree
REPLACED = [
    ("weibull", 1 / 4, 3, 9.62392, 0.56343, 0.88261, 0.156),
    ("weibull", 1 / 4, 10, 6.58646, 0.81274, 2.94203, 0.036),
    ("weibull", 1 / 2, 3, 11.06871, 0.78711, 0.90270, 0.420),
    ("weibull", 1 / 2, 10, 5.04677, 1.61497, 3.00901, 0.107),
    ("lognormal", 0.3, 3, 10.03994, 0.47577, 0.76480, 0.090),
    ("lognormal", 0.3, 10, 7.80468, 0.58120, 2.54933, 0.015),
    ("lognormal", 0.6, 3, 11.90904, 0.63844, 0.66822, 0.350),
    ("lognormal", 0.6, 10, 5.29273, 1.04501, 2.22739, 0.041),
]


@pytest.mark.parametrize(("distribution", "scale", "share", "time", "cost", "to_failure", "failed"), REPLACED)
def test_age_replacement(distribution, scale, share, time, cost, to_failure, failed):
    """Weibull lives of scale 15 min, lognormal ones of median 15 min."""
    median = 15.0 * log(2) ** scale if distribution == "weibull" else 15.0
    found = change_interval(distribution, median=median, scale=scale, planned=4.0, failure=4.0 * share)
    assert [found.time, found.cost, found.to_failure] == pytest.approx([time, cost, to_failure], abs=PRINTED)
    assert found.failed == pytest.approx(failed, abs=6e-4)


def test_simulated_changes_cost_what_is_stated():
    """Seed 1; 2e5 edges: 1 % is three standard errors."""
    found = change_interval("weibull", median=15.0 * log(2) ** 0.25, scale=0.25, planned=4.0, failure=40.0)
    lives = 15.0 * np.random.default_rng(1).weibull(4.0, 200_000)
    costs, times = np.where(lives < found.time, 40.0, 4.0), np.minimum(lives, found.time)
    assert costs.sum() / times.sum() == pytest.approx(found.cost, rel=0.01)


def test_edges_run_to_failure_where_a_planned_change_saves_nothing():
    found = change_interval("lognormal", median=15.0, scale=1.2, planned=4.0, failure=4.4)
    assert (found.time, found.cost, found.planned_change) == (inf, found.to_failure, False)
    assert not change_interval("weibull", median=15.0, scale=1.0, planned=1.0, failure=9.0).planned_change  # no ageing
    with pytest.raises(UsageError, match="planned 0: give a number above zero"):
        change_interval("weibull", median=15.0, scale=1.0, planned=0.0, failure=9.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"edge": 8.0, "insert": 16.0, "edges": 2}, "not both"),
        ({}, "price of one edge"),
        ({"insert": 16.0}, "number of edges"),
        ({"edge": 8.0, "machine": 0.0}, "time would cost nothing"),
        ({"edge": 8.0, "handling": 2.0}, "cut of one part"),
        ({"edge": 8.0, "cut": {"length": 100.0}}, "length and diameter"),
        ({"edge": 8.0, "cut": {"volume": 10.0, "length": 100.0, "diameter": 20.0}}, "not as both"),
        ({"edge": -8.0}, "greater than or equal to 0"),
        ({"edge": 8.0, "efficiency": 1.4}, "less than or equal to 1"),
    ],
)
def test_costs_that_contradict_each_other_are_refused(given, words):
    with pytest.raises(ValidationError, match=words):
        CostsSection.model_validate({"currency": "EUR", "machine": 60.0, "change": 1.0, **given})


def test_a_life_that_no_tool_has_is_refused():
    pf = published("AC-2017")
    steep = sealed(pf, limits={"wear": {"value": 1e99, "unit": "mm", "of": "AW"}})
    with pytest.raises(DataError, match=r"tool life at V \S+ m/min, f \S+ mm/rev is 1e\d+ min by its law"):
        economic_settings(steep, COSTS, draws={})


def test_the_plan_of_2017_with_its_cost():
    """.0049689 USD per cm3 and 138.36 cm3/min with a change of 2 min."""
    costs = {"currency": "USD", "machine": 30.0, "edge": 3.0, "change": 2.0}
    report = replayed("recursion", sealed(published("AC-2017"), costs=costs), {}, seed=1)
    (line,) = [line for line in report.lines if "USD" in line]
    assert "0.004969 USD per cm3 and 138.4 cm3/min; at the best fixed pair 0.007716 and 88.05" in line


# --- the commands


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parameters.write(of_lives(), "params.json")
    return "params.json"


EUROS = ("machine=30/h", "edge=3", "change=2min", "length=120mm", "diameter=100mm", "currency=EUR")


def test_costs_are_written_and_the_optimum_is_printed(file, capsys):
    assert main(["costs", file, *EUROS]) == 0
    assert "3 EUR an edge; change 2 min; handling 0 min." in capsys.readouterr().out
    assert parameters.read(file).costs.per_minute == 0.5
    assert main(["optimum", file, "--depth", "2", "--today", "V=150", "--today", "f=0.2", "--figure", "c.svg"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "least 0.4443 EUR at V 197.6 m/min, f 0.286 mm/rev" in out
    assert "Least cost: limited by Ra 3.2 um." in out
    assert "Not measured: the laws were fitted to a simulation." in out
    assert "No intervals" in out
    assert Path("c.svg").read_text("utf-8").startswith("<?xml")
    assert main(["optimum", file, "--depth", "2", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["least_cost"]["cost"] == pytest.approx(0.4442883, abs=6e-8)


def test_no_optimum_is_calculated_from_a_law_that_must_not_be_used(file, capsys):
    assert main(["costs", file, *EUROS]) == 0
    pf = parameters.read(file)
    barred = VerdictSection(level="do not use for control", reasons=("The mean T predicts about as well.",))
    laws = {**pf.laws, "T": pf.laws["T"].model_copy(update={"verdict": barred})}
    parameters.write(sealed(pf, laws=laws), file, force=True)
    capsys.readouterr()
    assert main(["optimum", file, "--depth", "2"]) == 5
    said = capsys.readouterr()
    assert said.out == ""
    assert "the law of T must not be used for control, so no setting is calculated from it. The mean T" in said.err
    assert main(["optimum", file, "--depth", "2", "--accept-verdict"]) == 0
    assert "Verdict on the law of T: do not use for control." in " ".join(capsys.readouterr().out.split())


def test_the_depth_of_all_tests_is_that_of_the_optimum(tmp_path, monkeypatch, capsys):
    """Tests at one depth have laws without d: 2.5 mm, the depth of the papers, would be another cut."""
    monkeypatch.chdir(tmp_path)
    rng, rows = np.random.default_rng(1), ["edge,vc [m/min],f [mm/rev],ap [mm],t [min],VB [mm]"]
    for edge, (V, f) in enumerate((V, f) for V in (100, 150, 220) for f in (0.1, 0.2, 0.3)):
        wear = ((t, 0.006 * V**0.5 * f**0.2 * t**0.3 * np.exp(rng.normal(0, 0.04))) for t in (2, 5, 9, 14))
        rows += [f"{edge},{V},{f},2,{t},{VB:.4f}" for t, VB in wear]
    Path("tests.csv").write_text("\n".join(rows))
    assert main(["tests.csv", "--quiet", "--draws", "1000"]) == 0
    (path,) = Path("tests-fit").glob("*/params.json")
    assert main(["costs", str(path), *EUROS]) == 0
    capsys.readouterr()
    assert main(["optimum", str(path)]) == 0
    assert "cost of a part at d 2 mm" in capsys.readouterr().out
    assert main(["optimum", str(path), "--depth", "3"]) == 0
    assert "d 3 mm (tested 2 alone)" in " ".join(capsys.readouterr().out.split())


def test_units_of_costs_are_converted(file):
    words = (
        "machine=0.5/min",
        "labour=20EUR/h",
        "insert=12€",
        "edges=4",
        "change=90s",
        "handling=0.05h",
        "efficiency=80%",
    )
    assert main(["costs", file, *words, "volume=7.32in3"]) == 2  # two currencies
    assert main(["costs", file, *words[:2], "insert=12", *words[3:], "volume=7.32in3", "energy=0.3/kWh"]) == 0
    held = parameters.read(file).costs
    assert (held.machine, held.labour, held.price_of_edge, held.change, held.handling) == (30.0, 20.0, 3.0, 1.5, 3.0)
    assert (held.cut.volume, held.energy, held.efficiency) == (pytest.approx(7.32 * 2.54**3, rel=1e-12), 0.3, 0.8)
    assert main(["costs", file, "edge=2.5"]) == 0  # the price of an edge replaces that of an insert
    assert parameters.read(file).costs.insert is None


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["machine=60", *EUROS[1:]], "give the rate per time, as machine=60/h"),
        (["machine=60/d", *EUROS[1:]], "give the rate per time"),
        (["edge=8/h", *EUROS[:1], *EUROS[2:]], "edge=8/h: give it as edge=8"),
        (["change=2", *EUROS[:2], *EUROS[3:]], "change=2: the unit is missing; give it as change=2min"),
        (["change=2mm", *EUROS[:2], *EUROS[3:]], "mm is not a unit of change"),
        (["edge=1,5", *EUROS[:1], *EUROS[2:]], "with a decimal point"),
        (["edge=-8", *EUROS[:1], *EUROS[2:]], "zero or more"),
        (["edgs=4", *EUROS], "Did you mean 'edges'"),
        (["edges=0", "insert=4"], "1 or more"),
        (["volume=120", *EUROS[:3], EUROS[5]], "volume=120cm3"),
        (EUROS[:5], "currency is missing"),
        (["edge=3", "currency=EUR"], "machine and change missing"),
        ([*EUROS, "insert=9", "edges=3"], "not both"),
        ([*EUROS, "insert=9"], "cost insert=9: the number of its edges is missing; add edges=4"),
        ([*EUROS[:4], EUROS[5]], "cost length=120: the diameter of the part is missing; add diameter=100mm"),
        ([*EUROS, "energy=0.3"], "energy=0.3/kWh"),
    ],
)
def test_costs_that_are_wrong_are_one_sentence(words, says, file, capsys):
    before = Path(file).read_bytes()
    assert main(["costs", file, *words]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert Path(file).read_bytes() == before


def test_the_optimum_needs_costs_a_life_and_limits_that_allow_a_pair(file, capsys):
    for words, says in (
        ([], "has no costs; write them with fitmodels costs params.json"),
        (["--level", "95"], "between 0 and 1"),
        (["--figure", "c.gif"], "ends in .png"),
    ):
        assert main(["optimum", file, *words]) == 2
        assert says in capsys.readouterr().err
    pf = published("LYAP")
    parameters.write(sealed(pf, costs=COSTS), "load.json")
    assert main(["optimum", "load.json"]) == 2
    assert "the file has no tool life" in capsys.readouterr().err
    assert main(["costs", file, *EUROS]) == 0
    assert main(["optimum", file, "--today", "V=100"]) == 2
    assert "give both" in capsys.readouterr().err
    assert main(["costs", file, "edge=4"]) == 2
    assert "replace them with --force" in capsys.readouterr().err
