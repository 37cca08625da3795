"""Decisions of a law, their intervals, and the tests that narrow them: closed forms, brute force, refits."""

from itertools import combinations_with_replacement
from math import log, sqrt

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cards.content.uncertainty import of_life
from fitmodels.cli import main
from fitmodels.core.errors import FitError, UsageError
from fitmodels.fit.decisions import cost_decision, life_decision, limit_decision
from fitmodels.fit.next_tests import candidate_settings, next_runs
from fitmodels.fit.optimal_tests import c_optimal, information, information_of_test, narrowing

EXACT = 1e-9
FACTORS = ["V", "f", "d", "t"]
LIFE = {"Cm": 0.5, "Ct": 3.0, "tc": 2.0}


@pytest.fixture(scope="module")
def wear():
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", FACTORS)


def law_of_lives(K, exponents, seed=1, scatter=1e-4):
    """A law of T with K, p, q, r to four digits: a factorial of edges, one life each."""
    rng = np.random.default_rng(seed)
    at = np.array([[V, f, d] for V in (80, 130, 200, 320) for f in (0.1, 0.2, 0.4) for d in (1, 2, 3)], dtype=float)
    lives = K * np.prod(at ** np.array(exponents), axis=1) * np.exp(scatter * rng.standard_normal(len(at)))
    frame = pd.DataFrame({"V": at[:, 0], "f": at[:, 1], "d": at[:, 2], "T": lives})
    return fit.power_law(datasets.runs_from_frame(frame), "T", ["V", "f", "d"])


def test_the_life_is_that_of_tool_life_and_its_interval_that_of_the_card(wear):
    found, life = life_decision(wear), fit.tool_life(wear, 0.3)
    assert found.value == pytest.approx(life.typical, rel=EXACT)
    now = narrowing(wear, found, next_runs(wear, 2).attrs["readings"])
    pf = parameters.collect(laws=[wear], tool_life=life)
    law, edge = of_life(pf.tool_life, pf.laws["AW"])
    assert now.now == pytest.approx((law.low.value, law.high.value), rel=0.02)  # the card takes Fieller's interval
    assert now.edge_now == pytest.approx((edge.low.value, edge.high.value), rel=0.05)
    t = 2.06865761  # Student's t, 23 degrees of freedom
    half = t * sqrt(found.gradient @ wear.covariance() @ found.gradient)
    assert now.now == pytest.approx((found.value * np.exp(-half), found.value * np.exp(half)), rel=1e-6)
    assert "5 times the longest test (20 min)" in found.beyond


@pytest.mark.parametrize(("f", "speed"), [(0.1, 300.994), (0.2, 228.111), (0.4, 172.876)])
def test_the_speed_of_least_cost_is_the_closed_form(f, speed):
    """K 7.5e9, p 4, q 1.6, r .6, d 2: T* = (p - 1)(tc + Ct/Cm) = 24 min whatever the feed."""
    law = law_of_lives(7.5e9, (-4.0, -1.6, -0.6))
    found = cost_decision(law, LIFE, at={"f": f, "d": 2.0})
    assert found.value == pytest.approx(speed, rel=1e-4)
    assert life_decision(law, at={"V": found.value, "f": f, "d": 2.0}).value == pytest.approx(24, rel=1e-3)


def test_taylors_case_of_least_cost():
    """n .125, C 70, tc 2, Cm .5, Ct 3: V 42.32281, T 56 (closed form and minimiser)."""
    V = np.array([30, 35, 40, 45, 50, 55], dtype=float)
    lives = (70 / V) ** 8 * np.exp(1e-5 * np.array([1, -1, 1, -1, 1, -1]))
    law = fit.power_law(datasets.runs_from_frame(pd.DataFrame({"V": V, "T": lives})), "T", ["V"])
    found = cost_decision(law, LIFE)
    assert found.value == pytest.approx(42.32281, rel=1e-4)
    assert life_decision(law, at={"V": found.value}).value == pytest.approx(56, rel=1e-3)


@pytest.mark.parametrize(("response", "factor", "limit"), [("AW", "V", 0.2), ("AW", "t", 0.3)])
def test_the_law_reaches_the_limit_at_the_value_found(wear, response, factor, limit):
    found = limit_decision(wear, limit, factor)
    assert wear.values({**found.at, factor: found.value}) == pytest.approx(limit, rel=EXACT)
    assert response in found.name


def test_a_limit_of_time_is_the_life(wear):
    as_limit, as_life = limit_decision(wear, 0.3, "t"), life_decision(wear)
    assert as_limit.value == pytest.approx(as_life.value, rel=EXACT)
    assert as_limit.gradient == pytest.approx(as_life.gradient, rel=1e-5)
    assert as_limit.edge_sd == pytest.approx(as_life.edge_sd, rel=EXACT)


def test_a_line_reaches_a_limit_too():
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    law = fit.load_law(runs)
    middle, (factor,) = float(np.median(law.observed)), law.factors
    found = limit_decision(law, middle, factor)
    assert law.values({factor: found.value}) == pytest.approx(middle, rel=EXACT)


def test_the_information_is_the_inverse_covariance_of_the_random_level(wear):
    """Generalised least squares with the estimated components: the standard errors that the mixed model prints."""
    assert np.sqrt(np.diag(np.linalg.inv(information(wear)))) == pytest.approx(wear.edges.mixed.bse, rel=1e-6)


def test_the_information_of_a_test_is_that_of_its_rows(wear):
    readings = pd.DataFrame({"V": 120.0, "f": 0.2, "d": 2.0, "t": [2.0, 5.0, 9.0]})
    Z = wear.design_of(readings)
    between, within = wear.edges.mixed.sd_between**2, wear.edges.mixed.sd_within**2
    V = within * np.eye(3) + between
    assert information_of_test(wear, readings) == pytest.approx(Z.T @ np.linalg.solve(V, Z), rel=1e-6)


def test_the_expected_interval_is_that_of_a_refit_with_the_same_scatter(wear):
    found = life_decision(wear)
    plan = next_runs(wear, 6, decision=found, durations=lambda table: np.full(len(table), 60.0))
    stated = narrowing(wear, found, plan.attrs["readings"])
    added = [wear.design_of(pd.DataFrame(test)) for test in plan.attrs["readings"]]
    between, within = wear.edges.mixed.sd_between**2, wear.edges.mixed.sd_within**2
    number = wear.rows.edge_numbers
    parts = [wear.design[number == g] for g in range(number.max() + 1)]

    def variance(edges):
        total = sum(Z.T @ np.linalg.solve(within * np.eye(len(Z)) + between, Z) for Z in edges)
        return found.gradient @ np.linalg.solve(total, found.gradient)

    ratio = sqrt(variance([*parts, *added]) / variance(parts))
    t = {23: 2.06865761, 29: 2.04522964}  # Student's t, 0.975
    widths = [log(high / low) for low, high in (stated.now, stated.after)]
    assert widths[1] / widths[0] == pytest.approx(ratio * t[29] / t[23], rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_search_for_a_decision_finds_what_brute_force_finds(seed):
    rng = np.random.default_rng(seed)
    old, rows, g = rng.normal(size=(8, 3)), rng.normal(size=(7, 2, 3)), rng.normal(size=3)
    known, new = old.T @ old, np.einsum("cmi,cmj->cij", rows, rows)

    def left(chosen):
        return g @ np.linalg.solve(known + new[list(chosen)].sum(axis=0), g)

    every = [c for c in combinations_with_replacement(range(7), 3) if max(np.bincount(c)) <= 2]
    assert left(c_optimal(g, known, new, 3, 2)) == pytest.approx(min(map(left, every)), rel=0.01)


def test_tests_for_a_decision_narrow_it_more_than_those_for_the_law(wear):
    found = life_decision(wear, at={"V": 180.0, "f": 0.15})
    ends = lambda table: np.full(len(table), 20.0)  # noqa: E731
    direct, whole = (next_runs(wear, 4, decision=d, durations=ends) for d in (found, None))
    widths = [log(np.divide(*narrowing(wear, found, plan.attrs["readings"]).after[::-1])) for plan in (direct, whole)]
    assert widths[0] < widths[1]
    assert direct.attrs["criterion"] == "c-optimal"
    assert direct.groupby(["V", "f", "d"]).size().max() <= 2
    assert (direct["t"] == 20).all()
    assert len(pd.concat([direct, direct])) == 8  # attrs that pandas can compare


def test_the_number_of_tests_until_enough_is_where_the_interval_says_so(wear):
    found = life_decision(wear, at={"V": 180.0, "f": 0.3})
    plan = next_runs(wear, 3, decision=found, durations=lambda table: np.full(len(table), 20.0))
    readings = plan.attrs["readings"]
    stated = narrowing(wear, found, readings, within=0.15)
    for times, holds in ((-(-stated.enough // 3), True), ((stated.enough - 1) // 3, False)):
        again = narrowing(wear, found, readings * times)
        law, edge = (log(ends[1] / found.value) for ends in (again.after, again.edge_after))
        wider = edge / sqrt(edge**2 - law**2) - 1  # than with the law known
        assert (wider <= 0.05 + 1e-9) == holds
    asked = -(-stated.reached // 3)
    assert log(narrowing(wear, found, readings * asked).after[1] / found.value) <= log(1.15) + 1e-9


def test_what_is_not_decided(wear):
    with pytest.raises(UsageError, match="V is no condition"):
        cost_decision(wear, LIFE, at={"V": 100.0})
    with pytest.raises(UsageError, match="give Cm"):
        cost_decision(wear, {"Cm": 0.5})
    with pytest.raises(FitError, match="at 1 or less"):
        cost_decision(law_of_lives(100.0, (-0.5, -0.1, -0.1)), LIFE)
    with pytest.raises(FitError, match="has no limit of x"):
        limit_decision(wear, 0.3, "x")
    with pytest.raises(UsageError, match="above zero"):
        limit_decision(wear, -0.3, "V")
    no_time = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d"])
    with pytest.raises(FitError, match="without t"):
        life_decision(no_time)


def test_candidates_of_a_second_order_law_make_its_terms_estimable():
    plan = datasets.central_composite({"V": (50, 200), "f": (0.06, 0.6)}, seed=1)
    law = datasets.SimulatedLaw("AW", "mm", 0.01, {"V": 0.5, "f": 0.2, "t": 0.3}, 0.05, 0.03)
    frame = datasets.simulate(plan, [law], t_max=10.0, criterion=None, seed=2)
    runs = datasets.runs_from_frame(frame)
    surface = fit.regression.fit_form(runs, "second_order", "AW", ["V", "f", "t"])
    added = next_runs(surface, 4)
    assert set(added.columns) >= {"V", "f"}
    assert len(candidate_settings(surface)) > 20
    assert added.attrs["determinant_gain"] > 1
    assert "V" in fit.regression.fit_form(runs, "linear", "AW", ["V", "f", "t"]).factors


def test_the_command_proposes_longer_tests_where_the_life_is_extrapolated(tmp_path, capsys):
    data = str(datasets.bundled("gc435_709m40"))
    assert main(["next", data, "--out", str(tmp_path / "next.csv")]) == 0
    runs = datasets.read_runs(tmp_path / "next.csv")
    assert (runs.values("t") > 20).all()
    assert runs.values("t").max() <= 60
    notes = " ".join(runs.notes)
    for words in (
        "Tool life is extrapolated",
        "95 % interval of the law",
        "expected after 4 more tests",
        "Do not stop before",
    ):
        assert words in notes
    assert "those of the first screen and of predict are by the theorem of Fieller" in notes
    assert main(["next", data, "--decision", "P=7000W", "--vary", "V", "--within", "10"]) == 0
    assert "V at which P reaches 7 kW" in capsys.readouterr().out
    assert main(["next", data, "--decision", "cost", "--cost", "Cm=.5,Ct=3,tc=2"]) == 0
    assert "speed of least cost" in capsys.readouterr().out
    for wrong, words in (
        (["--decision", "cost"], "--cost Cm=0.5,Ct=3,tc=2"),
        (["--decision", "price"], "life, cost, or a limit"),
        (["--decision", "P=7mm"], "give a number in kW"),
        (["--decision", "Ra=3"], "there are laws of"),
        (["--within", "0"], "--within 0"),
        (["--at", "x=3"], "no condition"),
    ):
        assert main(["next", data, *wrong]) == 2, wrong
        assert words in " ".join(capsys.readouterr().err.split())


ADVICE = [
    (1, "", "Stop after about 1 more test"),
    (582, "", "do not pay"),
    (582, "Far.", "run edges to the criterion"),
    (1, "Far.", "if the law holds so far"),
]


@pytest.mark.parametrize(("enough", "beyond", "says"), ADVICE)
def test_when_to_stop_does_not_contradict_what_is_extrapolated(enough, beyond, says):
    from fitmodels.fit.decisions import Decision
    from fitmodels.fit.optimal_tests import Narrowing

    held = dict.fromkeys(Decision.__dataclass_fields__) | {"name": "T", "unit": "min", "value": 9.0}
    decision = Decision(**{**held, "beyond": beyond})
    words = " ".join(Narrowing(decision, (8, 10), (8.5, 9.5), (7, 11), (8, 10), 4, enough, None, None).words)
    assert says in words
    assert not ("Stop after" in words and beyond)


def test_a_life_beyond_every_number_is_refused(wear):
    with pytest.raises(FitError, match="too large a number: check the criterion"):
        life_decision(wear, criterion=1e307)
