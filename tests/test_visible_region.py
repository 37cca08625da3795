"""The visible region and its optimum: AC-2016 (Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006), and any power laws.

The reference of the linear programme is scipy.optimize.linprog (HiGHS); of probabilities, normal integrals of scipy.
"""

import json
import math
import sys

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cards.replays import region as replay_of_region
from fitmodels.controllers.region.figures import plot_region_detail
from fitmodels.controllers.region.probability import best_point, feasibility
from fitmodels.controllers.region.visible import visible_region, wear_front
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets import central_composite, runs_from_frame
from fitmodels.datasets.published_laws import PUBLISHED
from fitmodels.fit.regression import fit_form
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.load_line import LimitsSection
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from matplotlib.text import Text
from scipy.optimize import linprog
from scipy.stats import multivariate_normal, norm

ROUND = 1e-9  # of a logarithm: what clipping and twelve digits leave
UNITS = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm"}
RANGE = {"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0), "t": (2.0, 15.0), "AW": (0.05, 0.3)}


def law(response, unit, c0, exponents, **more):
    """A law section of a power law."""
    factors = [
        {"symbol": s, "quantity": s, "unit": UNITS[s], "low": RANGE[s][0], "high": RANGE[s][1]} for s in exponents
    ]
    return {
        "form": "power", "response": response, "quantity": response, "unit": unit, "equation": "", "factors": factors,
        "error": "multiplicative", "coefficients": {"c0": c0, **exponents}, "residual_scale": "ln", "n": 9, "df": 5,
        "uncertainty": {"kind": "none", "reason": "given"}, **more,
    }  # fmt: skip


def file(*laws, limits=None):
    return ParameterFile.model_validate(
        {
            "identity": {"tool": "T", "work": "W", "simulated": True},
            "provenance": {"fitmodels": "0.1.0"},
            "laws": {each["response"]: each for each in laws},
            "limits": limits,
        }
    )


def kW(value):
    return {"power": {"value": value, "unit": "kW"}}


POWER = law("P", "kW", 0.1, {"V": 1.0, "f": 0.7, "d": 0.9})
WEAR = law("AW", "mm", 0.01, {"V": 0.5, "f": 0.2, "t": 0.25})
OF_WEAR = law("P", "kW", 0.14, {"V": 0.8, "f": 0.6, "d": 0.8, "AW": 0.4})


@pytest.fixture(scope="module")
def paper():
    return published("AC-2016")


@pytest.fixture(scope="module")
def region(paper):
    return visible_region(paper, d=2.5, t=10.0)


def fine_grid(region, points=801):
    axes = [np.exp(np.linspace(region.box.low[i], region.box.high[i], points)) for i in (0, 1)]
    return np.meshgrid(*axes)


# --- AC-2016


@pytest.mark.parametrize("name", ["AC-2016", "AC-2017"])
def test_the_published_file_holds_the_printed_laws_and_passes_the_check(name, tmp_path):
    pf = published(name)
    assert parameters.check(pf).ok
    assert parameters.read(parameters.write(pf, tmp_path / "p.json")) == pf
    printed = {each.response: each for each in PUBLISHED if each.tool == "GC435"}
    assert set(pf.laws) == {"AW", "P", "Fxz"} == set(printed)
    for response, each in pf.laws.items():
        assert each.coefficients == printed[response].coefficients
        assert each.residual_se == printed[response].standard_error
    assert (pf.limits.power.value, pf.limits.force.of) == (7.0, "Fxz")
    assert (pf.limits.force.value, pf.limits.wear is None) == ((1300.0, True) if name == "AC-2016" else (1500.0, False))


def test_the_exact_optimum_lies_on_both_limits(region):
    best = region.best
    assert best.values["P"] == pytest.approx(7.0, rel=ROUND)
    assert best.values["Fxz"] == pytest.approx(1300.0, rel=ROUND)
    assert best.held_by == ("P 7 kW", "Fxz 1300 N")
    assert (best.exceeds, best.tested) == ((), True)
    assert pytest.approx(2500 * best.V * best.f) == best.MRR


def test_a_fine_grid_finds_the_exact_optimum_and_nothing_better(region):
    V, f = fine_grid(region, 1001)
    inside = region.contains(V, f)
    MRR = np.where(inside, 2500 * V * f, 0.0)
    most = np.unravel_index(MRR.argmax(), MRR.shape)
    assert MRR.max() <= region.best.MRR * (1 + ROUND)
    assert MRR.max() == pytest.approx(region.best.MRR, rel=4e-3)  # a cell is 0.14 % by 0.23 %
    assert V[most] == pytest.approx(region.best.V, rel=0.01)


@pytest.mark.parametrize(
    ("pair", "P", "Fxz", "over"),
    [
        ((154.7, 0.53), 7.33, 1309, ("P 7 kW", "Fxz 1300 N")),
        ((144.0, 0.54), 6.90, 1305, ("Fxz 1300 N",)),
        ((147.0, 0.54), 7.045, 1309, ("P 7 kW", "Fxz 1300 N")),
    ],
)
def test_the_points_of_the_paper_draw_what_its_own_laws_say(region, pair, P, Fxz, over):
    point = region.at(*pair)
    assert point.values["P"] == pytest.approx(P, abs=0.005)
    assert point.values["Fxz"] == pytest.approx(Fxz, abs=0.5)
    assert point.exceeds == over
    assert not region.contains(*pair)


def test_the_wear_rate_is_the_derivative_of_the_wear(paper, region):
    at = {"V": 154.7, "f": 0.53, "d": 2.5}
    wear = paper.laws["AW"]
    slope = (wear.values(**at, t=10.001) - wear.values(**at, t=9.999)) / 0.002 * 1000
    point = region.at(154.7, 0.53)
    assert point.wear_rate == pytest.approx(slope, rel=1e-6)
    assert point.wear_rate == pytest.approx(0.245 * point.values["AW"] / 10 * 1000)  # eq. 7 and 13 leave out 0.245


def test_the_wear_put_in_gives_equations_10_11_and_14(region):
    constants = {name: math.exp(float(each.intercept)) for name, each in region.planes.items()}
    assert constants["P"] == pytest.approx(0.067, abs=5e-5)
    assert constants["Fxz"] == pytest.approx(799.62, abs=5e-3)
    assert constants["AW"] == pytest.approx(0.01681, abs=5e-6)
    assert region.planes["P"].slopes == pytest.approx([1.0173, 0.6845], abs=5e-5)
    assert region.planes["Fxz"].slopes == pytest.approx([0.1507, 0.4208], abs=5e-5)


def test_the_region_has_the_six_corners_of_figure_4_with_b_the_best(region):
    assert "".join(corner.letter for corner in region.corners) == "ABCDEF"
    assert region.corners[1].limits == ("P 7 kW", "Fxz 1300 N")
    assert (region.corners[1].V, region.corners[1].f) == region.best.xy
    assert all(len(corner.limits) == 2 for corner in region.corners)
    assert {corner.V for corner in region.corners} >= {50.0, 200.0}  # to the last digit


def test_a_point_has_the_predictions_of_the_laws(paper, region):
    point = region.at(120.0, 0.3)
    AW = paper.laws["AW"].values(V=120.0, f=0.3, d=2.5, t=10.0)
    assert point.values["AW"] == pytest.approx(AW)
    for name in ("P", "Fxz"):
        assert point.values[name] == pytest.approx(paper.laws[name].values(V=120.0, f=0.3, d=2.5, t=10.0, AW=AW))


def test_what_a_limit_is_worth_is_what_raising_it_brings(paper, region):
    for name, kind, value in (("P 7 kW", "power", 7.0), ("Fxz 1300 N", "force", 1300.0)):
        more = best_point(paper, limits={kind: value * 1.0001})
        assert math.log(more.MRR / region.best.MRR) / math.log(1.0001) == pytest.approx(
            region.sensitivities[name], rel=1e-6
        )


# --- the front of metal and wear


def test_no_allowed_pair_removes_as_much_and_wears_less(region):
    V, f = fine_grid(region, 401)
    inside = region.contains(V, f)
    wear = region.planes["AW"].value(np.log(np.stack([V, f], axis=-1)))
    front = wear_front(region, [0.0, 0.02, 0.05, 0.2, 0.5, 0.9])
    for MRR, least in zip(front.MRR, front.wear, strict=True):
        candidates = inside & (2500 * V * f >= MRR * (1 - ROUND))
        assert wear[candidates].min(initial=np.inf) >= least * (1 - ROUND)
    assert pytest.approx(region.best.MRR * (1 - front.loss)) == front.MRR
    assert np.all(np.diff(front.wear) < 0)
    assert front.points[0].xy == pytest.approx(region.best.xy)


def test_least_wear_and_least_wear_rate_are_one_pair(region):
    front = wear_front(region, [0.0, 0.1, 0.3])
    assert front.wear_rate == pytest.approx(0.0245 * 1000 * front.wear)


def test_less_metal_buys_nothing_where_wear_does_not_depend_on_speed_or_feed():
    flat = law("AW", "mm", 0.01, {"t": 0.25})
    point = visible_region(file(POWER, flat, limits=kW(5.0))).least_wear(0.3)
    assert point.xy == pytest.approx(best_point(file(POWER, flat, limits=kW(5.0))).xy)


# --- any power laws

exponent = st.floats(-1.5, 1.5).map(lambda b: round(b, 3))
some_law = st.tuples(exponent, exponent, st.floats(-1.0, 1.0))


def made(rows):
    """Laws R0, R1 .. of V and f, each limited so that the limit passes near the middle of the ranges."""
    middle = np.log([100.0, 0.19])
    names = ("P", "Fxz", "AW")
    laws, limits = [], {}
    for (a, b, off), name, kind, unit in zip(rows, names, ("power", "force", "wear"), ("kW", "N", "mm"), strict=False):
        laws.append(law(name, unit, 2.0, {"V": a, "f": b}))
        limits[kind] = {"value": 2.0 * math.exp(float(middle @ [a, b]) + off), "unit": unit, "of": name}
    return file(*laws, limits=limits)


def room(region):
    """By how much every limit can be kept at once, in logarithms (below 0: not at all), at most 1; by HiGHS."""
    A = [[*each.a, 1.0] for each in region.limits] + [[0.0, 0.0, 1.0]]
    b = [each.b for each in region.limits] + [1.0]
    return -linprog([0, 0, -1], A_ub=A, b_ub=b, bounds=(None, None)).fun


@settings(max_examples=50, deadline=None)
@given(rows=st.lists(some_law, min_size=1, max_size=3))
def test_no_feasible_pair_of_a_grid_beats_the_corner_and_linprog_agrees(rows):
    region = visible_region(made(rows))
    spare = room(region)
    assume(abs(spare) > 1e-6)  # HiGHS keeps limits to 1e-7: on the brink it cannot be asked
    assert region.empty == (spare < 0)
    V, f = fine_grid(region, 61)
    inside = region.contains(V, f)
    if region.empty:
        assert not inside.any()
        return
    found = linprog([-1, -1], A_ub=[each.a for each in region.limits], b_ub=[each.b for each in region.limits],
                    bounds=(None, None))  # fmt: skip
    assert math.log(region.best.V * region.best.f) == pytest.approx(-found.fun, abs=1e-6)
    assert (V * f)[inside].max(initial=0.0) <= region.best.V * region.best.f * (1 + 1e-8)


@settings(max_examples=40, deadline=None)
@given(rows=st.lists(some_law, min_size=1, max_size=3))
def test_the_polygon_is_the_region(rows):
    region = visible_region(made(rows))
    assume(abs(room(region)) > 1e-6)
    V, f = fine_grid(region, 41)
    x = np.log(np.stack([V, f], axis=-1)).reshape(-1, 2)
    clear = np.min([np.abs(each.beyond(x)) for each in region.limits[:-4]], axis=0) > 1e-6
    inside = region.contains(V, f).ravel()
    if region.empty:
        assert not inside.any()
        assert "at most" in region.conflict
        return
    assert all(region.contains(corner.V, corner.f) for corner in region.corners)
    assert np.array_equal(inside[clear], _in_polygon(x, region.polygon)[clear])


def _in_polygon(points, corners):
    """Right of every side of a clockwise polygon."""
    ok = np.ones(len(points), dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        ok &= side <= 1e-8
    return ok


# --- edges of the problem


def test_no_limit_but_the_machine_leaves_its_fastest_corner():
    best = best_point(file(POWER, limits=None))
    assert (best.xy, best.held_by) == ((200.0, 0.6), ("V 200 m/min", "f 0.6 mm/rev"))


def test_one_limit_alone_moves_along_itself_to_the_machine_s_end():
    best = best_point(file(POWER, limits=kW(10.0)))  # V costs more than f, so f is at its largest
    assert best.held_by == ("P 10 kW", "f 0.6 mm/rev")


def test_a_limit_as_steep_as_the_removal_rate_is_broken_by_wear():
    same = law("P", "kW", 0.1, {"V": 0.8, "f": 0.8})
    best = best_point(file(same, WEAR, limits=kW(2.0)))
    assert best.f == 0.6  # every pair along the limit removes alike; the slowest wears least


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (kW(0.01), "V at least 50 m/min, f at least 0.06 mm/rev and P at most 0.01 kW exclude each other"),
        ({**kW(20.0), "speed": {"low": 300.0, "high": 400.0, "unit": "m/min"}}, ""),
        ({**kW(1.0), "speed": {"low": 300.0, "high": 400.0, "unit": "m/min"}}, "V at least 300 m/min"),
    ],
)
def test_an_empty_region_says_which_limits_exclude_each_other(limits, words):
    region = visible_region(file(POWER, limits=limits))
    assert region.empty == bool(words)
    assert words in region.conflict
    if words:
        assert "P is" in region.conflict
        with pytest.raises(DataError, match="exclude each other"):
            _ = region.best


def test_the_nearest_value_of_a_conflict_is_one_that_lets_something_through():
    told = visible_region(file(POWER, limits=kW(0.01))).conflict
    nearest = float(told.split("P is ")[1].split()[0])
    assert not visible_region(file(POWER, limits=kW(nearest * 1.001))).empty
    assert visible_region(file(POWER, limits=kW(nearest * 0.999))).empty


def test_a_law_without_speed_or_feed_allows_all_or_nothing():
    flat = law("P", "kW", 3.0, {"d": 1.0})
    assert visible_region(file(POWER | flat, WEAR, limits=kW(8.0))).best.xy == (200.0, 0.6)
    region = visible_region(file(flat, WEAR, limits=kW(7.0)))
    assert region.conflict == "P at most 7 kW is never met: P is 7.5 kW there at best."


def test_a_range_of_one_value_leaves_a_line():
    limits = {**kW(8.0), "feed": {"low": 0.3, "high": 0.3, "unit": "mm/rev"}}
    region = visible_region(file(POWER, WEAR, limits=limits))
    assert region.best.f == 0.3
    assert region.best.values["P"] == pytest.approx(8.0)
    assert pytest.approx(0.9 * region.best.V) == region.least_wear(0.1).V
    region.plot()


def test_where_the_ranges_come_from_is_said():
    assert "No" not in "".join(visible_region(published("AC-2016")).notes)
    notes = visible_region(file(POWER, limits=kW(5.0))).notes
    assert notes[0] == "The limits have no range of V: the tested range 50 to 200 m/min is used."
    wide = visible_region(file(POWER, limits={"speed": {"low": 0.0, "high": 900.0, "unit": "m/min"}}))
    assert "no lower end of V above zero: the tested range 50 to 900 m/min" in wide.notes[0]
    assert not wide.best.tested
    far = visible_region(published("AC-2016"), t=60.0)
    assert "t 60 lies outside 2 to 15 min, the tested range of" in " ".join(far.notes)


def test_limits_given_stand_in_place_of_the_file_s(paper):
    assert visible_region(paper, limits={"force": None}).best.held_by == ("P 7 kW", "f 0.6 mm/rev")
    assert visible_region(paper, limits={"force": 1500.0}).limits[1].name == "Fxz 1500 N"
    assert visible_region(paper, limits=LimitsSection(wear={"value": 0.2, "unit": "mm"})).best.values["AW"] <= 0.2 * (
        1 + ROUND
    )
    assert visible_region(paper, limits={"speed": (50, 120)}).best.V <= 120.0


def test_units_of_limits_and_laws_are_reconciled(paper, region):
    W = {"power": {"value": 7000.0, "unit": "W"}, "force": {"value": 1.3, "unit": "kN", "of": "Fxz"}}
    speed = {"speed": {"low": 50 / 0.3048, "high": 200 / 0.3048, "unit": "ft/min"}}
    assert best_point(paper, limits=W | speed).xy == pytest.approx(region.best.xy)
    wear = law("AW", "um", 10.0, {"V": 0.5, "f": 0.2, "t": 0.25})
    other = visible_region(file(OF_WEAR, wear, limits=kW(5.0)))
    same = visible_region(file(OF_WEAR, WEAR, limits=kW(5.0)))
    assert other.best.xy == pytest.approx(same.best.xy)
    assert other.best.wear_rate == pytest.approx(same.best.wear_rate)


def test_levels_shift_the_law():
    two = law(
        "P", "kW", 0.1, {"V": 1.0, "f": 0.7}, by={"column": "work", "reference": "a", "shifts": {"b": math.log(2)}}
    )
    pf = file(two, limits=kW(5.0))
    assert visible_region(pf, by="b").best.xy == pytest.approx(visible_region(pf, by="a", limits=kW(2.5)).best.xy)
    with pytest.raises(UsageError, match=r"by work: no level was named; give by=, one of a, b"):
        visible_region(pf)


def test_a_measured_wear_takes_the_place_of_its_law():
    pf = file(OF_WEAR, WEAR, limits=kW(5.0))
    best = visible_region(pf, at={"AW": 0.25}).best
    assert best.values["P"] == pytest.approx(5.0)
    assert parameters.LawSection.model_validate(OF_WEAR).values(V=best.V, f=best.f, d=2.5, AW=0.25) == pytest.approx(
        5.0
    )


def test_spindle_and_feed_rate_limit_through_the_diameter():
    limits = {"spindle_speed": {"low": 100.0, "high": 300.0, "unit": "1/min"},
              "feed_rate": {"low": 0.0, "high": 90.0, "unit": "mm/min"}}  # fmt: skip
    region = visible_region(file(POWER, limits=limits), at={"D": 100.0})
    n = 1000 * region.best.V / (math.pi * 100.0)
    assert n <= 300 * (1 + ROUND)
    assert n * region.best.f == pytest.approx(90.0)
    assert "not applied" in visible_region(file(POWER, limits=limits)).notes[-1]


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: visible_region(file(POWER), limits={"force": 9.0}), UsageError, "no law of Fxz; fit it, or leave"),
        (lambda: visible_region(file(OF_WEAR, limits=kW(5.0))), UsageError, r"needs AW \(mm\); give the file its law"),
        (lambda: visible_region(file(POWER), limits={"powr": 5}), UsageError, "no limit 'powr'; there are power"),
        (lambda: visible_region(file(POWER), limits={"power": -5}), UsageError, "greater than 0"),
        (lambda: visible_region(file()), UsageError, "no law has V and there is no range of it"),
        (lambda: visible_region(file(POWER), d=0.0), UsageError, "d = 0: a power law needs a positive value"),
        (lambda: visible_region(file(POWER), at={"V": 3.0}), UsageError, "V is not allowed here"),
        (lambda: visible_region(file(POWER), at={"ae": 3.0}), UsageError, "no law has a factor 'ae'"),
        (lambda: visible_region(file(POWER)).at(0.0, 0.3), UsageError, "V = 0"),
        (lambda: visible_region(file(POWER)).least_wear(), UsageError, "no law of wear"),
        (lambda: visible_region(file(POWER, WEAR)).least_wear(1.0), UsageError, "loss = 1"),
        (lambda: best_point(file(POWER), draws={}), UsageError, "without a probability"),
        (lambda: best_point(file(POWER, limits=kW(5.0)), probability=0.9), UsageError, "no residual standard error"),
        (lambda: feasibility(file(POWER), kind="median"), UsageError, "kind='median'"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said_in_a_sentence(call, error, words):
    with pytest.raises(error, match=words):
        call()


# --- probability


def scattered(sd, **more):
    return law("P", "kW", 0.1, {"V": 1.0, "f": 0.7}, residual_se=sd, **more)


@pytest.mark.parametrize(("V", "f"), [(100.0, 0.3), (120.0, 0.4), (150.0, 0.5)])
def test_the_scatter_of_one_law_gives_the_normal_probability(V, f):
    chance = feasibility(file(scattered(0.2), limits=kW(6.0)), most=40_000, grid=(2, 2))
    exact = norm.cdf(math.log(6.0 / (0.1 * V * f**0.7)) / 0.2)
    assert chance.at(V, f) == pytest.approx(exact, abs=4 * math.sqrt(exact * (1 - exact) / 40_000) + 1e-6)


def test_errors_that_add_are_added():
    chance = feasibility(
        file(scattered(0.5, error="additive", residual_scale="kW"), limits=kW(6.0)), most=40_000, grid=(2, 2)
    )
    exact = norm.cdf((6.0 - 0.1 * 120.0 * 0.4**0.7) / 0.5)
    assert chance.at(120.0, 0.4) == pytest.approx(exact, abs=0.006)


def test_the_paper_s_points_risk_what_a_double_normal_integral_says(paper, region):
    """Power and force share the luck of the wear: sd 0.1 times 0.342 and 1.1, beside their own 0.062 and 0.12."""
    s = np.array(
        [[0.062**2 + (0.342 * 0.1) ** 2, 0.342 * 1.1 * 0.1**2], [0.342 * 1.1 * 0.1**2, 0.12**2 + (1.1 * 0.1) ** 2]]
    )
    chance = feasibility(paper, most=40_000, grid=(2, 2))
    for pair in ((154.7, 0.53), (144.0, 0.54), region.best.xy):
        values = region.at(*pair).values
        room = np.log([7.0 / values["P"], 1300.0 / values["Fxz"]])
        exact = multivariate_normal.cdf(room, cov=s)
        assert chance.at(*pair) == pytest.approx(exact, abs=0.01)
        assert chance.risks(*pair)["P"] == pytest.approx(norm.sf(room[0] / math.sqrt(s[0, 0])), abs=0.01)


def test_the_best_pair_for_a_probability_is_that_of_a_lower_limit():
    """One law: to keep P below L with probability p is to keep its median below L exp(-z_p sd)."""
    pf = file(scattered(0.2), limits=kW(6.0))
    found = best_point(pf, probability=0.95)
    exact = best_point(pf, limits={"power": 6.0 * math.exp(-norm.ppf(0.95) * 0.2)})
    assert found.xy == pytest.approx(exact.xy, rel=0.03)  # 2000 draws: the quantile is known to 0.2 / sqrt(2000) / 0.1
    assert found.probability >= 0.95
    assert best_point(pf, probability=0.99).MRR < found.MRR


def test_no_allowed_pair_of_a_grid_with_the_probability_removes_more(paper):
    chance = feasibility(paper, most=500)
    best = chance.best(0.9)
    assert best.probability >= 0.9
    V, f = np.meshgrid(chance.V, chance.f)
    assert (2500 * V * f)[chance.probability >= 0.9].max() <= best.MRR * 1.002  # draws leave the edge jagged


def test_without_limits_or_scatter_the_demanded_pair_is_the_corner():
    assert best_point(file(scattered(0.2), limits=None), probability=0.5).xy == pytest.approx((200.0, 0.6), rel=1e-4)
    pf = published("AC-2016")
    found = best_point(pf, probability=0.9, kind="mean")
    assert pytest.approx(best_point(pf).MRR, rel=1e-4) == found.MRR


def test_draws_of_one_seed_are_not_taken_as_knowing_of_each_other():
    """Both laws with the very same draws: independent, the probabilities multiply; row by row they would be one."""
    rng = np.random.default_rng(3)
    values = np.column_stack(
        [math.log(0.1) + 0.2 * rng.standard_normal(4000), np.ones(4000), np.full(4000, 0.7), np.full(4000, 1e-9)]
    )
    force = law("Fxz", "N", 0.1, {"V": 1.0, "f": 0.7})
    pf = file(
        law("P", "kW", 0.1, {"V": 1.0, "f": 0.7}), force, limits={**kW(6.0), "force": {"value": 6.0, "unit": "N"}}
    )
    draws = {name: Draws(("ln c0", "V", "f", "sd"), values) for name in ("P", "Fxz")}
    V = 6.0 / 0.1 / 0.4**0.7
    assert feasibility(pf, draws=draws, kind="mean", most=4000, grid=(2, 2)).at(V, 0.4) == pytest.approx(0.25, abs=0.03)


def test_the_scatter_of_a_new_edge_counts_the_edges():
    n = 20_000
    columns = {"ln c0": math.log(0.1), "V": 1.0, "f": 0.7, "sd": 0.1, "icc": 0.75}
    draws = {"P": Draws(tuple(columns), np.tile(list(columns.values()), (n, 1)))}
    chance = feasibility(file(scattered(0.1), limits=kW(6.0)), draws=draws, most=n, grid=(2, 2))
    exact = norm.cdf(math.log(6.0 / (0.1 * 120.0 * 0.4**0.7)) / 0.2)  # 0.1 / sqrt(1 - 0.75)
    assert chance.at(120.0, 0.4) == pytest.approx(exact, abs=0.012)


def test_wear_whose_errors_add_is_worked_out_at_every_pair():
    wear = law(
        "AW", "mm", 0.01, {"V": 0.5, "f": 0.2, "t": 0.25}, error="additive", residual_se=0.03, residual_scale="mm"
    )
    pf = file({**OF_WEAR, "residual_se": 0.05}, wear, limits=kW(5.0))
    chance = feasibility(pf, most=20_000, grid=(2, 2))
    rng = np.random.default_rng(7)
    AW = 0.01 * 120.0**0.5 * 0.35**0.2 * 10**0.25 + 0.03 * rng.standard_normal(200_000)
    P = (
        0.14
        * 120.0**0.8
        * 0.35**0.6
        * 2.5**0.8
        * np.maximum(AW, 1e-300) ** 0.4
        * np.exp(0.05 * rng.standard_normal(200_000))
    )
    assert chance.at(120.0, 0.35) == pytest.approx((P <= 5.0).mean(), abs=0.012)


def test_a_covariance_stands_in_for_draws_that_are_not_there():
    held = {
        "kind": "covariance",
        "of": ["ln c0", "V", "f"],
        "matrix": [[0.04, 0, 0], [0, 0, 0], [0, 0, 0]],
        "df": 10_000,
    }
    chance = feasibility(file(scattered(0.1, uncertainty=held), limits=kW(6.0)), kind="mean", most=20_000, grid=(2, 2))
    exact = norm.cdf(math.log(6.0 / (0.1 * 120.0 * 0.4**0.7)) / 0.2)
    assert chance.at(120.0, 0.4) == pytest.approx(exact, abs=0.012)
    assert chance.sources == ("P by its covariance (no draws of it)",)


def test_a_probability_out_of_reach_says_how_near_one_comes():
    with pytest.raises(DataError, match=r"probability 0.9: the most is 0\.\d+, at V 50 m/min and f 0.06 mm/rev"):
        best_point(file(scattered(1.0), limits=kW(0.7)), probability=0.9)
    wrong = {"P": Draws(("ln c0", "V"), np.ones((5, 2)))}
    with pytest.raises(UsageError, match="lack f: they belong to another fit"):
        feasibility(file(scattered(0.1), limits=kW(5.0)), draws=wrong)


def test_the_same_seed_gives_the_same_answer(paper):
    first, again = (feasibility(paper, most=200, grid=(9, 9), seed=5).probability for _ in range(2))
    assert np.array_equal(first, again)


# --- what is told


def test_the_replay_reports_the_optimum_the_paper_s_points_and_the_risk(paper):
    found = replay_of_region.replayed(paper, {}, 1)
    words = "\n".join(found.lines)
    assert found.lines[0].startswith(
        "Greatest metal removal rate within the limits at d 2.5 mm and t 10 min: V 147.9 m/min, f 0.5302"
    )
    for told in ("P 7.33 kW for 7", "Fxz 1309 N for 1300", "P 6.90 kW", "5 % less MRR", "for 95 % the best is"):
        assert told in words
    assert "exactly known" in " ".join(found.assumed)
    assert json.loads(json.dumps(found.facts))["optimum"]["held_by"] == ["P 7 kW", "Fxz 1300 N"]
    for figure in found.figures.values():
        texts = [text.get_text() for text in figure.findobj(Text)]
        assert any("alculated" in text for text in texts)


def test_a_file_that_cannot_drive_the_system_is_refused_with_the_reason():
    assert "no limit of a response" in replay_of_region.lacks(file(POWER))
    zero = [*OF_WEAR["factors"][:3], {**OF_WEAR["factors"][3], "low": 0.0}]  # no middle in logarithms
    assert "needs AW" in replay_of_region.lacks(file({**OF_WEAR, "factors": zero}, limits=kW(5.0)))
    assert replay_of_region.lacks(published("AC-2017")) == ""


def test_the_replay_of_an_empty_region_is_its_conflict_and_of_another_file_says_nothing_of_the_paper():
    empty = replay_of_region.replayed(file(POWER, limits=kW(0.01)), {}, 1)
    assert len(empty.lines) == 1
    assert "exclude each other" in empty.lines[0]
    other = replay_of_region.replayed(file(POWER, WEAR, limits=kW(5.0)), {}, 1)
    assert not any("AC-2016's" in line for line in other.lines)
    assert any("not known" in line for line in (*other.lines, *other.assumed))


def test_the_room_is_imported_without_matplotlib_or_scipy():
    import subprocess

    code = "import sys, fitmodels.controllers.region; print([m for m in ('matplotlib', 'scipy') if m in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )


# --- laws of other forms: curves in ln V and ln f

CURVED = ["second_order", "second_order_original", "linear", "exponential", "power_exponential"]


@pytest.fixture(scope="module")
def runs_of_two_laws():
    """A central composite design of 24 edges at 5 times: wear and power with known curvature."""
    rng = np.random.default_rng(3)
    plan = central_composite({"V": (60.0, 200.0), "f": (0.1, 0.5), "d": (1.0, 3.0)}, seed=3)
    rows = plan.loc[plan.index.repeat(5), ["edge", "V", "f", "d"]].reset_index(drop=True)
    t = np.tile([2.0, 4.0, 6.0, 8.0, 10.0], len(plan))
    off = rng.normal(size=(2, len(plan))).repeat(5, axis=1)
    u, v, w, s = np.log([rows["V"] / 110, rows["f"] / 0.22, rows["d"] / 1.7, t / 5])
    AW = 0.15 * np.exp(0.6 * u + 0.2 * v + 0.25 * w + 0.3 * s + 0.15 * u * u + 0.04 * off[0])
    e = rng.normal(size=(2, len(t)))
    P = 3 * np.exp(0.9 * u + 0.65 * v + 0.85 * w + 0.8 * (AW - 0.15) + 0.02 * (off[1] + e[0]))
    return runs_from_frame(rows.assign(t=t, AW=AW * np.exp(0.03 * e[1]), P=P), judge=False)


def file_of(runs, **forms):
    factors = {"AW": ["V", "f", "d", "t"], "P": ["V", "f", "d", "AW"]}
    laws = [fit_form(runs, form, response, factors[response]) for response, form in forms.items()]
    limits = {"power": 5.0, "wear": 0.3, "speed": (60.0, 200.0), "feed": (0.1, 0.5)}
    return parameters.collect(tool="T", work="W", laws=laws, limits=limits)


@pytest.mark.parametrize("form", CURVED)
def test_the_best_pair_within_curves_is_feasible_and_no_grid_finds_a_better(form, runs_of_two_laws):
    pf = file_of(runs_of_two_laws, AW=form, P=form)
    region = visible_region(pf, d=1.7, t=5.0)
    best, less = region.best, region.least_wear(0.05)
    assert region.curved
    assert best.tested
    assert less.tested
    assert (best.exceeds, less.exceeds) == ((), ())
    V, f = fine_grid(region, 501)
    MRR = np.where(region.contains(V, f), 1700 * V * f, 0.0)
    assert best.MRR * (1 - 0.01) < MRR.max() <= best.MRR * (1 + ROUND)
    wear = region.planes["AW"].value(np.log(np.stack([V, f], axis=-1)))
    assert wear[0.95 * best.MRR <= MRR].min() >= less.values["AW"] * (1 - 1e-6)
    for corner in region.corners:
        values = region.at(corner.V, corner.f)
        assert values.exceeds == ()
        assert corner.limits == values.held_by
    assert all("limited to where it was tested" in note for note in region.notes)


def test_a_power_law_as_a_curve_has_the_region_of_its_half_planes(runs_of_two_laws):
    """A second-order law without terms of second order is a power law: corners and best pair to 1e-8."""
    pf = file_of(runs_of_two_laws, AW="power", P="power")
    exact = visible_region(pf, d=1.7, t=5.0)
    data = pf.model_dump()
    for law in data["laws"].values():
        centres = {factor["symbol"]: 1.0 for factor in law["factors"]}
        wide = [{**factor, "low": factor["low"] / 3, "high": factor["high"] * 3} for factor in law["factors"]]
        terms = [{"name": symbol, "powers": {symbol: 1}} for symbol in centres]
        law |= {"form": "second_order", "terms": terms, "centres": centres, "region": None, "factors": wide}
    found = visible_region(ParameterFile.model_validate({**data, "content_sha256": None}), d=1.7, t=5.0)
    assert found.curved
    np.testing.assert_allclose(found.best.xy, exact.best.xy, rtol=1e-8)
    by_speed = [np.array(sorted((c.V, c.f) for c in region.corners)) for region in (found, exact)]
    np.testing.assert_allclose(by_speed[0], by_speed[1], rtol=1e-8)
    assert found.sensitivities == pytest.approx(exact.sensitivities, rel=1e-5)
    for loss in (0.05, 0.3):
        assert found.least_wear(loss).values["AW"] == pytest.approx(exact.least_wear(loss).values["AW"], rel=1e-7)
    chances = [feasibility(each, d=1.7, t=5.0, grid=(9, 9), most=500).probability
               for each in (pf, ParameterFile.model_validate({**data, "content_sha256": None}))]  # fmt: skip
    np.testing.assert_allclose(chances[0], chances[1], atol=1e-9)


def test_limits_of_further_responses_bound_from_above_and_below(runs_of_two_laws):
    pf = file_of(runs_of_two_laws, AW="second_order", P="power")
    limits = {"power": None, "wear": None, "responses": {"P": {"low": 2.0, "high": 5.0, "unit": "kW"}}}
    region = visible_region(pf, limits=limits, d=1.7, t=5.0)
    assert {limit.words for limit in region.limits[:2]} == {"P at least 2 kW", "P at most 5 kW"}
    assert region.best.values["P"] == pytest.approx(5.0, rel=1e-8)
    V, f = fine_grid(region, 101)
    P = region.planes["P"].value(np.log(np.stack([V, f], axis=-1)))
    assert ((P >= 2.0) & (P <= 5.0))[region.contains(V, f)].all()
    chance = feasibility(pf, limits=limits, d=1.7, t=5.0, grid=(5, 5), most=200, kind="mean")
    assert chance.at(*region.best.xy) == pytest.approx(0.5, abs=0.15)


def test_limits_that_curves_exclude_are_named_with_the_best_value(runs_of_two_laws):
    pf = file_of(runs_of_two_laws, AW="second_order", P="second_order")
    region = visible_region(pf, limits={"power": 0.2}, d=1.7, t=5.0)
    assert region.empty
    assert "P at most 0.2 kW" in region.conflict
    assert region.conflict.endswith("kW there at best.")
    with pytest.raises(DataError, match="P at most"):
        _ = region.best
    with pytest.raises(UsageError, match=r"d 9 mm lies outside 1 to 3, the tested range of the second order law of"):
        visible_region(pf, d=9.0, t=5.0)


def test_the_detail_of_pairs_far_apart_stays_above_zero():
    region = visible_region(file(POWER, limits=kW(5.0)))
    low = np.exp(region.box.low)
    ax = plot_region_detail(region, {"slow": region.at(*low)})
    assert min(ax.get_xlim()[0] / low[0], ax.get_ylim()[0] / low[1]) > 0
