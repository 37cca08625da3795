"""Plans of speed and feed: objectives, settings, units, bounds, and what lies outside the tests."""

import itertools

import numpy as np
import pytest
from fitmodels.controllers import life_laws, whole_life
from fitmodels.controllers.recursion.interval_optimum import grid_of
from fitmodels.controllers.recursion.laws import Rules, response_at_end, wear_after
from fitmodels.controllers.recursion.plan import PlanOptions, plan_of
from fitmodels.controllers.recursion.sequence import best_sequence
from fitmodels.core.errors import UsageError
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.published import published

STATE = Rules("published", "wear_state")
COARSE = (50.0, 0.09)  # 4 x 7 pairs, few enough to try every sequence


@pytest.fixture(scope="module")
def pf():
    return published("AC-2017")


def with_costs(pf):
    costs = {"currency": "USD", "machine": 30.0, "edge": 3.0, "change": 2.0}
    return ParameterFile.model_validate({**pf.model_dump(), "costs": costs, "content_sha256": None})


def test_by_default_the_plan_is_that_of_the_paper(pf):
    plan = plan_of(pf)
    life = whole_life(life_laws(pf))
    assert (plan.minutes, plan.removed) == (14.0, 2_213_750.0)
    assert [(row.V, row.f) for row in plan.rows] == list(zip(life.V.tolist(), life.f.tolist(), strict=True))
    assert plan.extrapolated == ()
    assert all(row.tested for row in plan.rows)


def test_the_best_sequence_by_the_wear_state_is_three_per_cent_above_the_recursion(pf):
    """Greedy 2158 cm3, best sequence of the same time 2235, bound 2237."""
    laws = life_laws(pf)
    greedy = whole_life(laws, STATE)
    best = best_sequence(laws, STATE, grid_of(laws), len(greedy.time), greedy)
    assert round(greedy.removed / 1000) == 2158
    assert round(best.life.removed / 1000) == 2235
    assert best.life.removed <= best.bound < 1.002 * best.life.removed
    assert (laws.wear.most >= best.life.AW).all()
    assert (laws.power.most >= best.life.P).all()
    assert (best.life.Fxz <= laws.force.most).all()


@pytest.mark.parametrize("wear", ["clock", "wear_state"])
@pytest.mark.parametrize("times", ["published", "full"])
def test_no_sequence_of_all_that_there_are_beats_the_best(pf, wear, times):
    """Every sequence of four intervals of 4 min over 28 pairs, tried one by one."""
    laws, rules = life_laws(pf), Rules(times, wear, 4.0)
    grid = grid_of(laws, *COARSE)
    best = best_sequence(laws, rules, grid, 4)
    most = _tried(laws, rules, grid, 4)
    assert best.life.removed == pytest.approx(most, rel=1e-12)
    assert best.bound >= most * (1 - 1e-12)


def _tried(laws, rules, grid, count):
    """Greatest metal of all sequences, by depth-first search without any bound."""
    pairs = list(itertools.product(grid.V.tolist(), grid.f.tolist()))

    def after(wear, k):
        if k == count:
            return 0.0
        start, end = k * rules.interval, (k + 1) * rules.interval
        V, f = np.array(pairs).T
        reached = wear_after(laws, rules, V, f, wear, start, end)
        allowed = reached <= laws.wear.most
        for _, terms in laws.limited:
            allowed &= response_at_end(terms, rules, V, f, end, reached) <= terms.most
        rate = laws.mrr(V, f) * rules.interval
        return max((rate[j] + after(float(reached[j]), k + 1) for j in np.flatnonzero(allowed)), default=-np.inf)

    return after(0.0, 0)


def test_the_longest_life_at_a_removal_rate_is_the_longest_of_all_sequences(pf):
    plan = plan_of(pf, options=PlanOptions(objective="life", removal=90_000.0, interval=4.0, grid=COARSE))
    assert all(row.rate >= 90_000 for row in plan.rows)
    laws, rules = life_laws(pf), plan.life.rules
    count = len(plan.rows)
    with pytest.raises(UsageError, match="no plan on this grid lasts"):
        best_sequence(laws, rules, grid_of(laws, 150.0, 0.54), 400)  # no bound of the rate: the slowest pair ends too
    slower = [k for k in range(count + 1) if np.isfinite(_longest(laws, rules, plan.life.grid, k, 90_000.0))]
    assert max(slower) == count


def _longest(laws, rules, grid, count, least):
    """0 where a sequence of so many intervals exists with pairs of at least this rate, else minus infinity."""
    V, f = np.array([(V, f) for V in grid.V for f in grid.f if laws.mrr(V, f) >= least]).T
    states = {0.0}
    for k in range(count):
        start, end = k * rules.interval, (k + 1) * rules.interval
        found = set()
        for wear in states:
            reached = wear_after(laws, rules, V, f, wear, start, end)
            allowed = reached <= laws.wear.most
            for _, terms in laws.limited:
                allowed &= response_at_end(terms, rules, V, f, end, reached) <= terms.most
            found |= set(np.round(reached[allowed], 6).tolist())
        states = found
    return 0.0 if states else -np.inf


def test_least_cost_is_below_that_of_every_time(pf):
    """Cost per cm3 over the life: the plan of least cost against the best of each given time."""
    priced, grid = with_costs(pf), (25.0, 0.06)
    plan = plan_of(priced, options=PlanOptions(objective="cost", wear_state=True, grid=grid))
    costs = []
    for minutes in range(4, 24):
        asked = PlanOptions(objective="time", time=float(minutes), wear_state=True, grid=grid)
        try:
            costs.append(plan_of(priced, options=asked).cost[0])
        except UsageError:
            break
    assert plan.cost[0] == pytest.approx(min(costs), rel=2e-3)
    assert plan.least[0] <= min(costs)
    assert plan.cost[1] == "USD"


def test_the_plan_of_the_paper_with_costs_is_the_reference_number(pf):
    """30 USD/h, an edge of 3, 2 min of change: .0049689 per cm3 by hand (2213.75 cm3 in 14 min)."""
    assert plan_of(with_costs(pf)).cost[0] == pytest.approx(0.0049689, abs=5e-8)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"depth": 0.01, "time": 3.0}, "EXTRAPOLATED: d 0.01 mm, tested 1.5 to 3 mm (AW, P, Fxz)."),
        ({"depth": 3.2}, "EXTRAPOLATED: d 3.2 mm, tested 1.5 to 3 mm"),
        ({"objective": "life", "removal": 1e5}, "EXTRAPOLATED: t up to 52 min, tested 2 to 15 min"),
    ],
)
def test_what_lies_outside_the_tests_is_extrapolated(pf, options, says):
    plan = plan_of(pf, options=PlanOptions(**options))
    assert any(line.startswith(says) for line in plan.extrapolated)
    assert not plan.rows[-1].tested


@pytest.mark.parametrize("depth", [1.5, 2.0, 3.0])
def test_tested_depths_are_not_extrapolated(pf, depth):
    assert plan_of(pf, options=PlanOptions(depth=depth, time=10.0)).extrapolated == ()


def test_the_time_holds_whole_intervals_and_says_what_is_left(pf):
    plan = plan_of(pf, options=PlanOptions(time=5.7, interval=0.5))
    assert plan.minutes == 5.5
    assert "Of 5.7 min 5.5 are planned: whole intervals of 0.5 min." in plan.assumed


def test_the_diameter_gives_the_spindle_speed(pf):
    row = plan_of(pf, options=PlanOptions(at={"D": 80.0})).rows[0]
    assert row.n == pytest.approx(1000 * 150 / (np.pi * 80))
    assert plan_of(pf).rows[0].n is None


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"objective": "speed"}, "give removal, life, cost or time"),
        ({"objective": "time"}, "give the time that the edge must last"),
        ({"objective": "life"}, "Give the removal rate that every interval must reach"),
        ({"objective": "life", "removal": 1e9}, "no pair within the limits of a new edge removes as much"),
        ({"removal": 1e4}, "belongs to objective life"),
        ({"objective": "cost"}, "the file has no costs"),
        ({"objective": "time", "time": 900.0, "grid": (50.0, 0.27)}, "no plan on this grid lasts 900 min"),
        ({"depth": -1.0}, "depth -1 mm: give a value above zero"),
        ({"time": 0.4}, "shorter than one interval"),
        ({"at": {"HB": 200.0}}, "no law has this factor"),
        ({"at": {"AW": 0.2}}, "the plan gives V, f, t and the wear"),
        ({"grid": (1e-4, 0.005)}, "use larger steps"),
    ],
)
def test_what_cannot_be_planned_is_one_sentence(pf, options, says):
    with pytest.raises(UsageError, match=says):
        plan_of(pf, options=PlanOptions(**options))


def test_force_that_falls_with_wear_has_a_recursion_and_no_best_sequence(pf):
    data = pf.model_dump()
    data["laws"]["Fxz"]["coefficients"]["AW"] = -0.2
    data["laws"]["Fxz"]["coefficients"]["c0"] = 3000.0
    falling = ParameterFile.model_validate({**data, "content_sha256": None})
    assert plan_of(falling, options=PlanOptions(time=3.0)).minutes == 3.0
    with pytest.raises(UsageError, match=r"Fxz .* falls with wear"):
        plan_of(falling, options=PlanOptions(objective="time", time=3.0))
