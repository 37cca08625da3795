"""Estimate of one edge: against a regression on all its windows, gauge readings, faults and snapshots; decisions."""

import json
import sys
from math import inf, log
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.core.errors import UsageError
from fitmodels.live.advice import Bounds, advise, highest
from fitmodels.live.decision import change_now
from fitmodels.live.detection import Detection
from fitmodels.live.edge_estimate import NOISE_DF, EdgeEstimate
from fitmodels.live.edge_scatter import Assumptions, Wander, level_correlation, slope_variance
from fitmodels.live.edge_state import EdgeState
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.samples import LoadMean, Window
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.file import sealed
from fitmodels.parameters.sections.costs import CostsSection

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import filter_and_regression

sys.path.remove(str(Path(__file__).parent))

AT = {"V": 150.0, "f": 0.25, "d": 2.0}


@pytest.fixture(scope="module")
def pf():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    given = ["V", "f", "d", "t"]
    laws = [fit.power_law(runs, "AW", given), *(fit.power_law(runs, name, [*given, "AW"]) for name in ("P", "Fxz"))]
    return parameters.collect(laws=laws)


@pytest.fixture(scope="module")
def laws(pf):
    return LiveLaws.of(pf)


def window(loads, minutes=1 / 6, at=AT, se=0.02):
    return Window(0.0, 60 * minutes, minutes, at, {name: LoadMean(ln, se, 500) for name, ln in loads.items()})


def cut(edge, windows, change=0.0, at=AT):
    for _ in range(windows):
        edge.add(window({name: edge.expected_ln(name, at)[0] + change for name in edge.laws.loads}, at=at))


def test_wear_without_loads_is_that_of_the_law_with_its_interval(laws, pf):
    edge = EdgeEstimate(laws, 0.3)
    edge.advance(6.0, AT)
    edge.advance(4.0, AT)
    law = pf.laws["AW"]
    assert edge.wear().median == pytest.approx(law.predict(**AT, t=10.0).value, rel=1e-9)
    end = 10.0 + edge.life(AT).median  # wear that wanders is past the criterion before its curve is
    earlier = laws.scatter.wear_wander.highest(np.array([law.coefficients["t"] / end]))[0]
    assert 0 < earlier < laws.scatter.wear_wander.sd
    assert law.predict(**AT, t=end).value * np.exp(earlier) == pytest.approx(0.3, rel=2e-3)


def test_changed_conditions_add_up_as_small_steps_at_the_wear_so_far(laws, pf):
    c, other = pf.laws["AW"].coefficients, {"V": 80.0, "f": 0.4, "d": 2.5}
    edge, wear = EdgeEstimate(laws, 0.3), 0.0
    for at, minutes in ((AT, 5.0), (other, 8.0), (AT, 3.0)):
        edge.advance(minutes, at)
        C = c["c0"] * at["V"] ** c["V"] * at["f"] ** c["f"] * at["d"] ** c["d"]
        wear = C * ((wear / C) ** (1 / c["t"]) + minutes) ** c["t"]  # the same wear at these conditions, and then on
    assert edge.wear().median == pytest.approx(wear, rel=1e-9)


def test_many_settings_are_joined_and_memory_stays(laws):
    edge, rng = EdgeEstimate(laws, 0.3), np.random.default_rng(1)
    for V in rng.uniform(80.0, 200.0, 300):
        edge.advance(0.1, {**AT, "V": V})
    exact, size = EdgeEstimate(laws, 0.3), len(edge.as_json()["exposure"]["minutes"])
    rng = np.random.default_rng(1)
    z = np.array([laws.wear.columns({**AT, "V": V, "t": 1.0}) for V in rng.uniform(80.0, 200.0, 300)])
    m = laws.wear.theta[exact._state.time]
    assert size <= 64
    assert log(edge.wear().median) == pytest.approx(m * np.log(0.1 * np.exp(z @ laws.wear.theta / m).sum()), abs=2e-4)


def test_filter_equals_the_regression_on_all_windows(laws):
    """One Gaussian regression with all windows at once has the same mean and variance of everything that stays."""
    found = filter_and_regression(laws)
    assert np.abs(found.filter_mean - found.mean).max() < 1e-9
    assert np.abs(found.filter_covariance - found.covariance).max() < 1e-10


@pytest.mark.parametrize("slope", [0.2, 0.6, 1.5, 5.0])
def test_highest_value_of_a_wander_with_a_trend_is_that_of_simulated_ones(slope):
    """Ornstein-Uhlenbeck process of correlation time 1 in steps of .005, looked at backwards from now."""
    rng, step, kept = np.random.default_rng(8), 0.005, np.exp(-0.005)
    value = rng.standard_normal(3000)
    highest = value.copy()
    for k in range(1, int((4.0 + 3.0 / slope) / step)):
        value = kept * value + np.sqrt(1 - kept**2) * rng.standard_normal(len(value))
        highest = np.maximum(highest, value - slope * k * step)
    assert float(Wander(0.02, 2.0).highest(np.array([0.01 * slope]))[0]) == pytest.approx(
        0.02 * highest.mean(), abs=0.0025
    )


def test_greater_load_means_more_wear_and_a_gauge_reading_gives_the_level(laws):
    edge, normal = EdgeEstimate(laws, 0.3), EdgeEstimate(laws, 0.3)
    cut(edge, 60), cut(normal, 60)
    level = edge.level_correlations()
    assert min(level.values()) < -0.7
    assert any("gauge AW once" in note for note in edge.notes)
    cut(edge, 30, change=0.05)
    cut(normal, 30)
    assert edge.wear().median > normal.wear().median
    wide = log(edge.wear().high / edge.wear().low)
    edge.gauge(0.9 * edge.wear().median, 0.02)
    assert log(edge.wear().high / edge.wear().low) < 0.5 * wide
    assert not any("gauge AW once" in note for note in edge.notes)


def test_probability_and_life_agree(laws):
    edge = EdgeEstimate(laws, 0.3)
    cut(edge, 60)
    life = edge.life(AT, 0.9)
    assert [edge.probability_past(t, AT) for t in (life.low, life.median, life.high)] == pytest.approx(
        [0.05, 0.5, 0.95], abs=0.01
    )
    assert edge.probability_past(5.0, {**AT, "V": 190.0}) > edge.probability_past(5.0, AT) > edge.probability_past()


def test_outlying_window_hardly_moves_the_estimate(laws):
    edge = EdgeEstimate(laws, 0.3)
    cut(edge, 60)
    before = edge.wear().median
    edge.add(window({name: edge.expected_ln(name, AT)[0] + 3.0 for name in laws.loads}))
    assert edge.wear().median == pytest.approx(before, rel=0.02)


def test_load_that_is_no_number_is_left_out(laws):
    edge, other = EdgeEstimate(laws, 0.3), EdgeEstimate(laws, 0.3)
    for one in (edge, other):
        one.advance(5.0, AT)
    edge.add(window({"P": float("nan"), "Fxz": inf, "unknown": 1.0}))
    other.advance(1 / 6, AT)
    assert edge.wear() == other.wear()


def test_missing_condition_keeps_its_last_value_and_says_so_or_is_refused(laws):
    edge = EdgeEstimate(laws, 0.3)
    with pytest.raises(UsageError, match="d is not known"):
        edge.advance(1.0, {"V": 150.0, "f": 0.25})
    assert edge.minutes == 0
    edge.advance(1.0, AT)
    edge.advance(1.0, {"V": 150.0, "f": 0.25, "d": float("nan")})
    assert any("d was not read" in note for note in edge.notes)


@pytest.mark.parametrize("minutes", [-1.0, inf, float("nan")])
def test_impossible_time_is_refused(laws, minutes):
    with pytest.raises(UsageError, match="finite time"):
        EdgeEstimate(laws, 0.3).advance(minutes, AT)


@pytest.mark.parametrize(("wear", "words"), [(210.0, "check unit and edge"), (-0.2, "above zero"), (inf, "above zero")])
def test_gauge_reading_in_a_wrong_unit_is_refused_and_changes_nothing(laws, wear, words):
    edge = EdgeEstimate(laws, 0.3)
    edge.advance(10.0, AT)
    before = edge.as_json()
    with pytest.raises(UsageError, match=words):
        edge.gauge(wear, 0.02)
    assert edge.as_json() == before


def test_reopened_level_is_wide(laws):
    edge = EdgeEstimate(laws, 0.3)
    cut(edge, 60)
    before = edge.wear()
    edge.reopen()
    assert edge.wear().high > 1.5 * before.high
    assert any("chipping" in note for note in edge.notes)


@pytest.mark.parametrize("scale", [1e-3, 0.6, 1e3])
def test_load_in_a_wrong_unit_does_not_lower_the_wear(laws, scale):
    edge, alone = EdgeEstimate(laws, 0.3), EdgeEstimate(laws, 0.3)
    for _ in range(60):
        edge.add(window({"P": edge.expected_ln("P", AT)[0] + log(scale)}))
        alone.add(window({}))
    assert edge.wear() == alone.wear()
    assert edge.life(AT) == alone.life(AT)
    assert any("check its unit and scale" in note for note in edge.notes)
    assert "without P" in change_now(edge).text
    for one in advise(edge, Bounds({"V": (50.0, 200.0), "f": (0.06, 0.6)}), AT, 1.0):
        assert all(value <= AT[name] * 1.0001 for name, value in one.settings.items())
    again = EdgeEstimate.from_json(laws, json.loads(json.dumps(edge.as_json())))
    assert again.distrusted == edge.distrusted


def test_chipping_seen_late_is_taken_for_wear_after_all(laws):
    """Loads rise as wear times 1.5 makes them; two windows later the level is opened, and the wear is found."""
    edge, slope = (
        EdgeEstimate(laws, 0.3),
        {name: law.slope("AW", {**AT, "t": 10.0, "AW": 0.2}) for name, law in laws.loads.items()},
    )
    cut(edge, 60)
    before = edge.wear().median
    expected = {name: edge.expected_ln(name, AT)[0] for name in laws.loads}
    chipped = {name: expected[name] + slope[name] * log(1.5) for name in laws.loads}
    for k in range(20):
        edge.add(window(chipped))
        if k == 1:
            edge.reopen()
    assert edge.wear().median == pytest.approx(1.5 * before, rel=0.04)


def test_snapshot_goes_on_bit_for_bit(laws, pf):
    edge = EdgeEstimate(laws, 0.3)
    cut(edge, 30)
    edge.gauge(edge.wear().median, 0.02)
    again = EdgeEstimate.from_json(laws, json.loads(json.dumps(edge.as_json())))
    for one in (edge, again):
        cut(one, 20, change=0.01)
    assert again.as_json() == edge.as_json()
    with pytest.raises(UsageError, match=r"another parameter file .* after \d+.* min; .* with --used"):
        EdgeEstimate.from_json(LiveLaws.of(pf, loads=["P"]), edge.as_json())
    broken = [{"minutes": "many"}, {"mean": [1.0]}, {"covariance": None}, {"exposure": {}}, {"fast": {}}, {"before": 3}]
    for part in broken:
        with pytest.raises(UsageError, match="cannot be read"):
            EdgeEstimate.from_json(laws, {**edge.as_json(), **part})


def test_beyond_the_tests_is_said(laws):
    edge = EdgeEstimate(laws, 0.3)
    edge.advance(30.0, {**AT, "V": 300.0})
    assert any("V 300 (tested 50 to 200)" in note for note in edge.notes)
    assert any("times the longest test" in note for note in edge.notes)
    assert any("largest wear tested" in note for note in EdgeEstimate(laws, 0.6).notes)
    assert not any("largest wear tested" in note for note in EdgeEstimate(laws, 0.3).notes)


def test_load_that_falls_with_wear_is_read_and_not_used(pf):
    law = pf.laws["P"].model_copy(update={"coefficients": {**pf.laws["P"].coefficients, "AW": -0.1}})
    found = LiveLaws.of(pf.model_copy(update={"laws": {**pf.laws, "P": law}}))
    assert [law.shows_wear for law in found.loads.values()] == [False, True]
    assert any("exponent of AW is -0.1 (95 %" in note and '--law "P ~ V, f, d, AW"' in note for note in found.notes)


def test_a_load_whose_draws_do_not_show_the_wear_leaves_it_to_time_and_jumps_are_still_seen(pf):
    """The draws are what is used: their exponent of AW is here 0, the printed one clearly above it."""
    rng, names, law = np.random.default_rng(4), pf.laws["P"].parameter_names, pf.laws["P"]
    mean = np.where(np.array(names) == "AW", 0.0, law.theta)
    draws = {"P": Draws(names, rng.multivariate_normal(mean, np.diag(np.full(len(names), 1e-4)), 400))}
    assert LiveLaws.of(pf, loads=["P"]).loads["P"].shows_wear
    laws = LiveLaws.of(pf, draws, loads=["P"])
    assert not laws.loads["P"].shows_wear
    assert laws.unused[0] in laws.notes
    assert laws.df == laws.wear.df
    edge, by_time, detection, seen = EdgeEstimate(laws, 0.3), EdgeEstimate(laws, 0.3), Detection(), []
    for change in (0.0,) * 20 + (0.3,) * 12:
        cut(edge, 1, change=change)
        by_time.advance(1 / 6, AT)
        seen += [alarm.kind for alarm in detection.add(edge)]
    assert edge.wear() == by_time.wear()
    assert seen == ["chipping"]


def test_laws_that_cannot_serve_are_refused_by_name(pf):
    with pytest.raises(UsageError, match="no law of VB"):
        LiveLaws.of(pf, wear="VB")
    with pytest.raises(UsageError, match="no law of Q"):
        LiveLaws.of(pf, loads=["Q"])
    with pytest.raises(UsageError, match="does not depend on AW"):
        LiveLaws.of(pf, loads=["AW"])
    with pytest.raises(UsageError, match="wear must grow"):
        LiveLaws.of(pf, wear="P")


def test_a_limit_of_another_wear_is_no_criterion(pf):
    """A limit of VB ended the edge of a law of AW."""
    own, other = (
        LiveLaws.of(sealed(pf, limits={"wear": {"value": 0.2, "unit": "mm", "of": of}})) for of in ("AW", "VB")
    )
    assert own.criterion == pytest.approx(0.2)
    assert other.criterion == LiveLaws.of(sealed(pf, limits=None)).criterion
    assert "the limit of VB is not applied: the wear law in use is that of AW" in other.notes


def test_change_is_called_at_the_risk_and_not_before(laws):
    edge = EdgeEstimate(laws, 0.3)
    edge.advance(5.0, AT)
    assert change_now(edge, 0.05, 1.0, AT).kind == "go on"
    late = edge.life(AT, 0.9).low
    found = change_now(edge, 0.05, 1.05 * late, AT)
    assert found.kind == "change"
    assert found.probability > 0.05
    with pytest.raises(UsageError, match="risk 5"):
        change_now(edge, 5.0)


def test_dearer_failures_bring_the_change_forward(laws):
    def minutes(failure):
        costs = CostsSection(currency="EUR", machine=60.0, edge=4.0, change=1.5, failure=failure)
        edge = EdgeEstimate(laws, 0.3)
        while change_now(edge, 0.05, 0.5, AT, costs).kind == "go on":
            edge.advance(0.5, AT)
        return edge.minutes

    assert minutes(200.0) < minutes(20.0) < EdgeEstimate(laws, 0.3).life(AT).high


def test_an_edge_that_is_likely_past_the_criterion_is_changed_at_least_cost_whatever_the_next_cut_adds(laws):
    """Where the level is open, another minute adds little to a probability of .7: it is the failure that counts."""
    costs = CostsSection(currency="EUR", machine=60.0, edge=4.0, change=1.5, failure=20.0)
    edge = EdgeEstimate(laws, 0.3)
    edge.advance(1.3 * edge.life(AT).median, AT)
    edge.reopen()
    now, after = edge.probability_past(0.0, AT), edge.probability_past(0.5, AT)
    assert 0.5 < now < after < now + 0.02
    assert change_now(edge, 0.05, 0.5, AT, costs).kind == "change"


def test_a_window_that_is_far_off_counts_less_than_one_that_is_near(laws):
    """Student t weights: one window 8 standard deviations off moves the mean less than one that is 2 off."""

    def moved(deviations):
        state, H = EdgeState(laws), np.zeros(len(EdgeState(laws).x))
        H[state.u] = 1.0
        sd = (state.P[state.u, state.u] + 0.02**2) ** 0.5
        state.update(H, deviations * sd, 0.02**2, NOISE_DF)
        return state.x[state.u] / sd

    assert 0 < moved(8.0) < 8.0 / 2.0 * moved(2.0)
    assert moved(60.0) < moved(20.0)


def test_advised_feed_and_speed_keep_to_the_risk_the_limits_and_the_tests(pf, laws):
    edge = EdgeEstimate(laws, 0.3)
    cut(edge, 60)
    bounds = Bounds.of(pf, laws)
    found = {one.kind: one for one in advise(edge, bounds, AT, 8.0)}
    assert set(found) == {"feed", "speed"}
    assert all(one.probability <= 0.05 for one in found.values())
    assert 50.0 <= found["speed"].settings["V"] <= 200.0
    limits = {"speed": {"low": 1.0, "high": 2.0, "unit": "m/s"}, "power": {"value": 1000.0, "unit": "W"}}
    narrow = Bounds.of(parameters.ParameterFile.model_validate({**pf.model_dump(), "limits": limits}), laws)
    assert narrow.ranges["V"] == pytest.approx((60.0, 120.0))
    assert narrow.loads == {"P": pytest.approx(1.0)}
    limits = {"force": {"value": 1.2, "unit": "kN"}}  # of no law by name: of all forces
    assert Bounds.of(parameters.ParameterFile.model_validate({**pf.model_dump(), "limits": limits}), laws).loads == {
        "Fxz": pytest.approx(1200.0)
    }
    for one in advise(edge, narrow, AT, 8.0):
        at = {**AT, **one.settings}
        assert edge.expected_load("P", at).high <= 1.0
    assert highest(edge, "V", Bounds({"V": (150.0, 200.0)}), AT, 500.0, 1e-9) is None
    for minutes, risk in ((0.0, 0.05), (8.0, 5.0)):
        with pytest.raises(UsageError):
            advise(edge, bounds, AT, minutes, risk)


def test_advised_feed_holds_the_reference_load_and_is_lowered_as_the_edge_wears(laws):
    bounds, feeds = Bounds({"f": (0.06, 0.6)}, reference={"Fxz": 700.0}), []
    for windows in (20, 150):
        edge = EdgeEstimate(laws, 0.3)
        cut(edge, windows)
        one = next(one for one in advise(edge, bounds, AT, 5.0) if one.kind == "load")
        assert edge.expected_load("Fxz", {**AT, **one.settings}).median == pytest.approx(700.0, rel=0.01)
        feeds.append(one.settings["f"])
    assert feeds[1] < feeds[0]


def test_least_cost_is_near_taylors_speed(laws):
    """With time paid alone the speed is highest; with dear edges it is lower."""
    bounds, edge, speeds = Bounds({"V": (60.0, 200.0), "f": (0.1, 0.4)}), EdgeEstimate(laws, 0.3), []
    cut(edge, 12)
    for price in (0.01, 100.0):
        costs = CostsSection(currency="EUR", machine=60.0, edge=price, change=0.1)
        one = next(one for one in advise(edge, bounds, AT, 5.0, costs=costs) if one.kind == "cost")
        speeds.append(one.settings["V"])
        assert one.settings["f"] == pytest.approx(0.4)
    assert speeds[0] > 1.3 * speeds[1]


def simulated(seed=3, edges=40, rows=8, exponent_sd=0.03, correlation=0.0):
    """Wear tests whose edges have their own exponents, and levels that agree with those of the load."""
    rng = np.random.default_rng(seed)
    at = np.repeat(np.arange(edges), rows)
    t = np.tile(np.geomspace(2.0, 20.0, rows), edges)
    V, f = (np.exp(rng.uniform(-0.6, 0.6, edges))[at] * middle for middle in (100.0, 0.2))
    u, v = rng.multivariate_normal([0, 0], [[1, correlation], [correlation, 1]], edges).T
    own = 0.25 + exponent_sd * rng.standard_normal(edges)
    ln = np.log(0.01 * (V / 100) ** 0.5 * (f / 0.2) ** 0.2) + own[at] * np.log(t) + 0.08 * u[at]
    wear = np.exp(ln + 0.03 * rng.standard_normal(len(t)))
    P = 0.5 * V * f**0.6 * wear**0.4 * np.exp(0.06 * v[at] + 0.02 * rng.standard_normal(len(t)))
    frame = pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V, "f": f, "t": t, "AW": wear, "P": P})
    runs = datasets.runs_from_frame(frame, judge=False)
    return parameters.collect(
        laws=[fit.power_law(runs, "AW", ["V", "f", "t"]), fit.power_law(runs, "P", ["V", "f", "AW"])]
    )


def test_exponents_of_edges_are_found_from_the_sums_of_the_file():
    laws = simulated(exponent_sd=0.05).laws
    variance, se, edges = slope_variance(laws["AW"], "t")
    assert edges == 40
    assert abs(variance - 0.05**2) < 3 * se
    none, se, _ = slope_variance(simulated(exponent_sd=0.0).laws["AW"], "t")
    assert none < 3 * se < 0.05**2


def test_few_tests_do_not_show_that_nothing_scatters(laws):
    assert laws.scatter.exponent_sd >= 0.05 * laws.wear.theta[4]
    assert laws.scatter.wear_wander.sd >= 0.02
    assert sum("at least" in note for note in laws.notes) == 2


@pytest.mark.parametrize("true", [0.6, -0.6])
def test_correlation_of_levels_is_found_from_the_sums_of_the_file(true):
    """Part of it only: the coefficient of wear in the law of the load takes up the rest."""
    pf = simulated(correlation=true)
    found = level_correlation(pf.laws["AW"], pf.laws["P"])
    assert 0.15 < found / true < 1.0
    assert LiveLaws.of(pf).scatter.correlation[0, 1] == pytest.approx(found)


def test_a_file_without_sums_says_what_is_assumed():
    pf = simulated()
    bare = {name: law.model_copy(update={"sums": None}) for name, law in pf.laws.items()}
    notes = LiveLaws.of(pf.model_copy(update={"laws": bare})).notes
    assert any("assumed: sd of the time exponent" in note for note in notes)
    assert any("assumed: correlation" in note for note in notes)
    given = LiveLaws.of(pf, assumptions=Assumptions(0.2, Wander(0.05, 3.0), Wander(0.04, 2.0), 0.3)).scatter
    assert given.wear_wander == Wander(0.05, 3.0)
    assert given.correlation[0, 1] == pytest.approx(0.3)
    assert sum("given" in note for note in given.notes) == 4


def test_wander_that_windows_show_is_taken_in(laws):
    """Loads that swing by 10 % between windows widen the interval; steady ones narrow it."""
    rng, steady, swinging = np.random.default_rng(4), EdgeEstimate(laws, 0.3), EdgeEstimate(laws, 0.3)
    for _ in range(120):
        cut(steady, 1)
        swinging.add(window({name: swinging.expected_ln(name, AT)[0] + rng.normal(0, 0.1) for name in laws.loads}))
    width = [log(edge.wear().high / edge.wear().low) for edge in (steady, swinging)]
    assert width[1] > 1.03 * width[0]
    assert min(swinging._state.fast.values()) > 3 * max(steady._state.fast.values())
