"""Recursive turning: tables and sequence of AC-2017, the exact optimum, the one replay loop, and what goes wrong.

Printed numbers: A. M. Alaskari and S. E. Oraby, "Adaptive control simulation to optimize metal removal for rough
turning", Kuwait J. Sci. (accepted June 2017), Tables 1 and 2, as bundled with every printed digit.
"""

import csv
import itertools
from dataclasses import replace

import numpy as np
import pytest
from fitmodels import datasets
from fitmodels.cards.replays import replayed
from fitmodels.controllers.loop import FAULTS, FaultyPlant, replay
from fitmodels.controllers.recursion.controller import TurningRecursion, WearingEdge
from fitmodels.controllers.recursion.figures import life_figure, pairs_figure, plane_figure, speeds_figure
from fitmodels.controllers.recursion.from_file import life_laws, shortfall
from fitmodels.controllers.recursion.interval_optimum import best_exact, grid_of, not_convex, surfaces
from fitmodels.controllers.recursion.laws import Rules, response_at_end, wear_after
from fitmodels.controllers.recursion.life import apply_plan, best_fixed, by_speed, fixed_life, life_ratios, whole_life
from fitmodels.controllers.recursion.plan import PlanOptions, plan_of
from fitmodels.controllers.recursion.sequence import best_sequence
from fitmodels.controllers.region.limits import limited
from fitmodels.core.errors import UsageError
from fitmodels.datasets.units import canonical
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

PUBLISHED = Rules(times="published")
ALL_RULES = [Rules(times, wear) for times in ("published", "full") for wear in ("clock", "wear_state")]
# minutes 1, 2 and 14 are in the paper's text; the others follow from eq. 4-8
SEQUENCE = [
    (150, 0.58), (140, 0.58), (140, 0.55), (150, 0.485), (160, 0.435), (170, 0.39), (180, 0.355), (190, 0.325),
    (200, 0.295), (200, 0.295), (200, 0.27), (200, 0.245), (200, 0.22), (200, 0.205),
]  # fmt: skip


@pytest.fixture(scope="module")
def laws():
    return life_laws(published("AC-2017"))


@pytest.fixture(scope="module")
def life(laws):
    return whole_life(laws, PUBLISHED)


def printed(name: str) -> list[dict[str, str]]:
    lines = [line for line in datasets.bundled(name).read_text("utf-8").splitlines() if not line.startswith("#")]
    return [{key.split(" [")[0]: cell for key, cell in row.items()} for row in csv.DictReader(lines)]


def units_of_the_last_digit(cell: str, ours: float) -> float:
    return abs(float(cell) - ours) * 10 ** len(cell.partition(".")[2])


def to_the_digits(cell: str, ours: float) -> float:
    """Ours, rounded to the digits of the cell."""
    return round(ours, len(cell.partition(".")[2]))


def changed(pf: ParameterFile, **sections) -> ParameterFile:
    data = pf.model_dump()
    return ParameterFile.model_validate({**data, **sections, "content_sha256": None})


def pairs(life) -> list[tuple[float, float]]:
    return list(zip(life.V.tolist(), life.f.tolist(), strict=True))


# Table 1, Table 2 and the sequence


def test_every_printed_digit_of_table_1_is_reproduced(life):
    table, rows = by_speed(life, 0), printed("ac2017_table1")
    assert table.V.tolist() == [float(row["V"]) for row in rows]
    for k, row in enumerate(rows):
        for name in ("f", "AW", "P", "Fxz", "MRR"):
            assert to_the_digits(row[name], float(getattr(table, name)[k])) == float(row[name]), (k, name)


def test_table_2_is_reproduced_within_a_unit_of_its_last_digit_but_for_its_misprint(life):
    table, rows = by_speed(life, 1), printed("ac2017_table2")
    dAW = table.fresh_end - table.fresh_start
    ours = {"V": table.V, "f": table.f, "Wo_i": table.fresh_end, "Wo_i-1": table.fresh_start, "dAW": dAW,
            "AW": table.AW, "P": table.P, "Fxz": table.Fxz, "MRR": table.MRR}  # fmt: skip
    off = []
    for k, row in enumerate(rows):
        assert to_the_digits(row["AW_past"], table.before) == float(row["AW_past"])
        off += [(k, name) for name in ours if units_of_the_last_digit(row[name], float(ours[name][k])) > 1.0]
    assert off == [(0, "dAW")]
    assert round(dAW[0], 5) == 0.0125
    assert rows[0]["dAW"] == "0.01255"


def test_with_the_times_counted_table_2_is_not_the_printed_one(laws):
    table = by_speed(whole_life(laws, Rules("full")), 1)
    assert pairs(table)[9] != (140.0, 0.58)


def test_the_published_sequence_is_exact_and_ends_at_minute_15_as_every_pair_wears_too_much(life):
    assert pairs(life) == [(float(V), f) for V, f in SEQUENCE]
    assert life.ended
    last = life.surfaces(14)
    assert last.breaks["wear"].all()
    assert last.best() is None
    assert (life.V.min(), life.V.max(), life.f.min(), life.f.max()) == (140.0, 200.0, 0.205, 0.58)


def test_the_grid_has_the_papers_1744_pairs(life):
    assert life.surfaces(0).AW.shape == (16, 109)


def test_with_full_times_the_edge_lasts_one_minute_more_and_gives_37_per_cent_more_metal(laws, life):
    full = whole_life(laws, Rules("full"))
    assert full.minutes - life.minutes == 1
    assert round(100 * (full.removed / life.removed - 1)) == 37


# The one replay loop


@pytest.mark.parametrize("how", ["grid", "exact"])
@pytest.mark.parametrize("rules", ALL_RULES, ids=str)
def test_the_controller_on_an_edge_of_the_same_laws_gives_the_same_numbers_as_the_life(laws, rules, how):
    life = whole_life(laws, rules, how=how)
    controller = TurningRecursion(laws, rules, grid_of(laws), how)
    trace = replay(
        controller, WearingEdge(laws, rules), duration=7200, dt=60, until="worn out", record=("power", "force")
    )
    n = len(life.time)
    np.testing.assert_allclose(trace.command[:n], np.column_stack([life.V, life.f]), rtol=1e-8)
    np.testing.assert_allclose(trace.measurement[1:], life.AW, rtol=1e-9)
    np.testing.assert_allclose(trace.recorded["power"][1:], life.P, rtol=1e-9)
    np.testing.assert_allclose(trace.recorded["force"][1:], life.Fxz, rtol=1e-9)
    assert trace.first("worn out") == 60.0 * n
    assert trace.command[n].tolist() == [0.0, 0.0]


def test_the_file_alone_gives_the_published_sequence_through_the_replay_loop():
    controller = TurningRecursion.from_parameters(published("AC-2017"))
    edge = WearingEdge(controller.laws)
    trace = replay(controller, edge, duration=7200, dt=60, until="worn out")
    assert [tuple(pair) for pair in trace.command[:-1].tolist()] == SEQUENCE
    assert edge.removed == pytest.approx(2_213_750.0)


def test_a_file_that_is_not_the_papers_counts_every_time():
    pf = published("AC-2017")
    other = changed(pf, provenance={"fitmodels": "0.1.0"})
    assert TurningRecursion.from_parameters(pf).rules.times == "published"
    assert TurningRecursion.from_parameters(other).rules.times == "full"


def test_an_edge_that_wears_faster_than_the_laws_is_changed_earlier_and_kept_under_the_criterion(laws):
    faster = replace(laws, wear=replace(laws.wear, ln_c=laws.wear.ln_c + 0.1))
    controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
    trace = replay(controller, WearingEdge(faster, PUBLISHED), duration=7200, dt=60, until="worn out")
    assert trace.first("worn out") < 14 * 60
    assert trace.measurement.max() < 0.3 * 1.02  # one interval may pass it: the increment is the faster edge's


@pytest.mark.parametrize("fault", sorted(set(FAULTS) - {"ten times stiffer"}))
def test_a_gauge_that_fails_leaves_the_laws_in_charge(laws, life, fault):
    controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
    plant = FaultyPlant(WearingEdge(laws, PUBLISHED), FAULTS[fault], start=300, end=600)
    trace = replay(controller, plant, duration=7200, dt=60, until="worn out")
    assert trace.first("wear unknown") is not None
    assert trace.first("wear known") is not None
    assert [tuple(pair) for pair in trace.command[:-1].tolist()] == pairs(life)


def test_a_gauge_that_reads_ten_times_the_wear_stops_the_cut(laws):
    controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
    plant = FaultyPlant(WearingEdge(laws, PUBLISHED), FAULTS["ten times stiffer"], start=300)
    trace = replay(controller, plant, duration=7200, dt=60, until="worn out")
    assert trace.first("worn out") == 300.0
    assert (trace.command[:-1] > 0).all()


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_a_gauge_that_reads_low_gives_no_more_than_the_plan(laws, life, share):
    controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
    edge, noise, command, news = WearingEdge(laws, PUBLISHED), np.random.default_rng(1), (0.0, 0.0), []
    found = []
    while "worn out" not in controller.news:
        command = controller.step(share * edge.wear, 60.0)
        news += controller.news
        found.append(command)
        edge.step(command, 60.0, noise)
    assert found[:-1] == pairs(life)
    assert edge.wear <= 0.3
    assert ("wear unknown" in news) == (share < 0.6)


def test_a_wear_that_falls_from_interval_to_interval_is_reported_and_not_used(laws, life):
    controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
    commands, news = [controller.step(0.0, 60.0)], []
    for k in range(1, len(life.time)):
        commands.append(controller.step(0.15 * 0.6**k, 60.0))
        news += controller.news
    assert commands == pairs(life)
    assert news[:1] == ["wear unknown"]


def test_a_worn_edge_stays_out_of_the_cut(laws):
    controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
    assert controller.step(0.31, 60.0) == (0.0, 0.0)
    assert controller.news == ("worn out",)
    assert controller.step(0.0, 60.0) == (0.0, 0.0)
    assert controller.news == ()


# The exact optimum


@pytest.mark.parametrize("rules", ALL_RULES, ids=str)
def test_the_exact_optimum_is_no_worse_than_a_very_fine_grid_and_hardly_better(laws, rules):
    """400 x 400 pairs about the optimum: none allowed is better, and the best of them is within their spacing."""
    life = whole_life(laws, rules)
    for k in (0, 1, 4, 9, 13):
        before, start = life.before(k), float(k)
        best = best_exact(laws, rules, before, start)
        V = np.clip(best.V * np.exp(np.linspace(-0.05, 0.05, 400)), *laws.V)
        f = np.clip(best.f * np.exp(np.linspace(-0.05, 0.05, 400)), *laws.f)
        AW = wear_after(laws, rules, V[:, None], f, before, start, start + 1)
        allowed = laws.wear.most >= AW
        for _, terms in laws.limited:
            allowed &= response_at_end(terms, rules, V[:, None], f, start + 1, AW) <= terms.most
        fine = laws.mrr(V[:, None], f)[allowed].max()
        assert fine <= best.MRR * (1 + 1e-9)
        assert fine >= best.MRR * 0.999


@pytest.mark.parametrize("rules", ALL_RULES, ids=str)
def test_the_exact_optimum_is_that_of_slsqp(laws, rules):
    """Reference: D. Kraft's SLSQP in scipy, on the logarithms, from the best pair of the grid and pairs below it.

    Of some starts its line search ends outside of the limits and says so, depending on the kernels of BLAS.
    """
    life = whole_life(laws, rules)
    bounds = [np.log(laws.V), np.log(laws.f)]
    for k in range(len(life.time)):
        before, start = life.before(k), float(k)

        def room(z, before=before, start=start):
            V, f = np.exp(z)
            AW = wear_after(laws, rules, V, f, before, start, start + 1)
            rest = [
                np.log(terms.most / response_at_end(terms, rules, V, f, start + 1, AW)) for _, terms in laws.limited
            ]
            return np.array([np.log(laws.wear.most / AW), *rest])

        tried = [
            minimize(
                lambda z: -z.sum(), np.maximum(np.log([life.V[k], life.f[k]]) - below, np.transpose(bounds)[0]),
                jac=lambda z: -np.ones(2), method="SLSQP", bounds=bounds,
                constraints={"type": "ineq", "fun": room}, options={"ftol": 1e-13},
            )
            for below in (0.0, 0.02, 0.05)
        ]  # fmt: skip
        found = [one for one in tried if one.success and room(one.x).min() > -1e-9]
        assert found
        ours = best_exact(laws, rules, before, start).MRR
        assert ours == pytest.approx(max(float(laws.mrr(*np.exp(one.x))) for one in found), rel=1e-6)


@given(
    st.floats(-1.5, 1.5), st.floats(-0.5, 1.5), st.floats(0.0, 2.0), st.floats(-1.0, 1.0), st.floats(0.05, 1.5),
    st.floats(0.0, 2.0), st.floats(0.0, 0.29), st.integers(0, 20), st.sampled_from(ALL_RULES),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_whatever_the_exponents_no_allowed_pair_of_the_grid_beats_the_exact_optimum(a, b, c, e, g, h, before, k, rules):
    laws = life_laws(published("AC-2017"))
    laws = replace(
        laws,
        power=replace(
            laws.power, V=a, f=b, AW=c, ln_c=np.log(6.0) - a * np.log(110) - b * np.log(0.25) - c * np.log(0.2)
        ),
        force=replace(
            laws.force, V=e, f=g, AW=h, ln_c=np.log(1300) - e * np.log(110) - g * np.log(0.25) - h * np.log(0.2)
        ),
    )
    before = before if k else 0.0
    tried = surfaces(laws, rules, grid_of(laws), before, float(k))
    best = best_exact(laws, rules, before, float(k))
    rate = np.where(tried.allowed, tried.MRR, 0.0).max()
    if best is None:
        assert rate == 0.0
    else:
        assert rate <= best.MRR * (1 + 1e-9)
        assert laws.wear.most * (1 + 1e-9) >= best.AW
        assert best.P <= 7.0 * (1 + 1e-9)
        assert best.Fxz <= 1500.0 * (1 + 1e-9)


def test_an_optimum_on_the_round_of_a_limit_is_found(laws):
    """Power's slope in V turns as new wear takes over: its limit touches the largest MRR, no corner of two limits."""
    power = replace(laws.power, V=0.3, f=1.0, AW=1.0, ln_c=np.log(5.0) - 0.3 * np.log(110) - np.log(0.2) - np.log(0.2))
    round_one = replace(laws, power=power, force=None, wear=replace(laws.wear, V=2.0, f=0.0, ln_c=-12.5, t=0.9))
    best = best_exact(round_one, PUBLISHED, 0.1, 1.0)
    assert best.stops == ("power",)
    V = np.linspace(best.V * 0.8, best.V * 1.2, 20001)
    AW = wear_after(round_one, PUBLISHED, V, 0.2, 0.1, 1.0, 2.0)  # of speed alone
    f = 7.0 / (power(V, 1.0) * AW / power.AW)
    ours = best.MRR
    assert ours == pytest.approx(float(laws.mrr(V, f).max()), rel=1e-8)


def test_the_exact_optimum_of_each_interval_removes_more_than_the_grid(laws):
    for rules in ALL_RULES:
        assert whole_life(laws, rules, how="exact").removed > whole_life(laws, rules).removed


def test_power_that_falls_with_wear_is_no_convex_problem_and_says_so(laws):
    odd = replace(laws, power=replace(laws.power, AW=-0.3))
    assert "falls with wear" in not_convex(odd)
    with pytest.raises(UsageError, match="use the grid"):
        best_exact(odd, PUBLISHED, 0.1, 1.0)
    assert whole_life(odd, PUBLISHED).ended  # the grid needs no sign


# Fixed parameters, other readings


def best_of_all(laws, grid, score):
    """The pair of a grid with the greatest score of its life, by a loop."""
    lives = [fixed_life(laws, V, f, PUBLISHED) for V in grid.V for f in grid.f]
    return max((one for one in lives if not one.passes), key=score)


def test_the_best_fixed_pair_is_that_of_the_objective(laws):
    grid = grid_of(laws, 10.0, 0.02)
    longest = best_fixed(laws, PUBLISHED, grid, "minutes", rate=100e3)
    loop = best_of_all(laws, grid, lambda one: one.minutes if one.per_minute >= 100e3 else 0.0)
    assert (longest.V, longest.f) == (loop.V, loop.f)
    assert longest.per_minute >= 100e3
    cheapest = best_fixed(laws, PUBLISHED, grid, (9.0, 0.5))
    loop = best_of_all(laws, grid, lambda one: one.removed / (9.0 + 0.5 * one.minutes))
    assert (cheapest.V, cheapest.f) == (loop.V, loop.f)
    short = best_fixed(laws, PUBLISHED, grid, until=5.0)
    assert (short.minutes, short.passes) == (5.0, ())
    assert short.per_minute > best_fixed(laws, PUBLISHED, grid).per_minute  # the limits hold for 5 min, not to the end
    assert fixed_life(laws, short.V, short.f, PUBLISHED).minutes >= 5.0
    with pytest.raises(UsageError, match="per_minute, removed, minutes"):
        best_fixed(laws, PUBLISHED, grid, "cost")


@pytest.mark.parametrize(
    ("removal", "end"),
    [
        (100e3, "every pair of the grid that removes 100 cm3 per min or more would exceed 0.3 mm in the next interval"),
        (60e3, "the pairs that remove 60 cm3 per min or more and keep it below 0.3 mm in the next interval exceed the "
               "limits of force"),
    ],
)  # fmt: skip
def test_a_plan_for_the_longest_life_is_compared_with_the_fixed_pair_of_longest_life(pf, removal, end):
    report = replayed("recursion", pf, {}, 1, PlanOptions(depth=2.5, objective="life", removal=removal))
    words, best = " ".join(report.lines), report.facts["best_fixed"]
    assert removal <= best["removed_mm3_per_min"] * (1 + 1e-9)
    assert f"The fixed pair of longest life, within the limits to the end, that removes {removal / 1000:g} " in words
    assert f"the plan lasts {report.facts['life_min'] / best['life_min']:.2f} times as long" in words
    assert end in words


def test_a_plan_of_one_pair_is_named_so(pf):
    unlimited = sealed(pf, limits={**pf.limits.model_dump(), "force": None})
    report = replayed("recursion", unlimited, {}, 1, PlanOptions(depth=1.5, objective="life", removal=60e3))
    (V, f), *others = {(one["V_m_per_min"], one["f_mm_per_rev"]) for one in report.facts["intervals"]}
    assert others == []
    words = " ".join(report.lines)
    assert f"The plan is one fixed pair, {V:g} m/min and {f:g} mm/rev in every interval: the fixed pair of lo" in words
    assert "times as much per edge" not in words


def test_a_fixed_pair_wears_to_the_criterion_at_the_time_its_law_says(laws):
    fixed = fixed_life(laws, 145.0, 0.3, PUBLISHED)
    pf = published("AC-2017")
    assert pf.laws["AW"].values(V=145.0, f=0.3, d=2.5, t=fixed.minutes) == pytest.approx(0.3)
    assert fixed.removed == pytest.approx(1000 * 145 * 0.3 * 2.5 * fixed.minutes)


def test_the_recursion_beats_the_best_fixed_pair_within_the_same_limits(laws, life):
    fixed = best_fixed(laws, PUBLISHED)
    assert fixed.passes == ()
    ratio = life_ratios(life, fixed)
    assert ratio.per_minute > 1.5
    assert ratio.removed > 1.4


@pytest.mark.parametrize("rules", ALL_RULES, ids=str)
def test_the_best_fixed_pair_is_the_best_that_a_loop_over_all_pairs_finds(laws, rules):
    tried = [fixed_life(laws, V, f, rules) for V in grid_of(laws).V for f in grid_of(laws).f[::9]]
    best = max(one.per_minute for one in tried if not one.passes)
    assert best_fixed(laws, rules).per_minute >= best


def test_a_plan_carried_out_under_its_own_rules_is_the_plan(laws):
    for rules in ALL_RULES:
        plan = whole_life(laws, rules)
        again = apply_plan(plan, laws, rules)
        n = len(plan.time)
        assert pairs(again)[:n] == pairs(plan)
        np.testing.assert_allclose(again.AW[:n], plan.AW, rtol=1e-12)


def test_at_one_pair_throughout_both_ways_to_add_wear_are_the_law(laws):
    pf = published("AC-2017")
    for wear in ("clock", "wear_state"):
        AW = 0.0
        for k in range(10):
            AW = float(wear_after(laws, Rules(wear=wear), 120.0, 0.3, AW, k, k + 1))
        assert pf.laws["AW"].values(V=120.0, f=0.3, d=2.5, t=10.0) == pytest.approx(AW, rel=1e-12)


# What a file may lack


def test_a_file_without_force_or_power_is_run_without_that_limit(laws, life):
    pf = published("AC-2017")
    bare = changed(pf, laws={name: law for name, law in pf.model_dump()["laws"].items() if name != "Fxz"})
    found = life_laws(bare)
    assert found.force is None
    assert "has no law of it" in found.notes[0]
    without = whole_life(found, PUBLISHED)
    assert without.removed > life.removed
    assert np.isnan(without.Fxz).all()
    assert not_convex(found) == ""
    for figure in (life_figure(without), pairs_figure(without), plane_figure(without), speeds_figure(without)):
        assert figure.axes


def test_a_limit_without_of_bounds_the_law_that_the_region_bounds(laws):
    """The force of the file is Fc, and collect(limits={"force": 1500}) names none."""
    data = published("AC-2017").model_dump()
    data["laws"]["Fc"] = {**data["laws"].pop("Fxz"), "response": "Fc", "quantity": "cutting force"}
    data["limits"]["force"].pop("of")
    pf = ParameterFile.model_validate({**data, "content_sha256": None})
    found = life_laws(pf)
    assert found.force == replace(laws.force, response="Fc")
    assert not [words for words in found.notes if "force" in words]
    assert [one.symbol for one in limited(pf, pf.limits)] == ["P", "Fc", "AW"]
    data["laws"]["Ff"] = {**data["laws"]["Fc"], "response": "Ff", "quantity": "feed force"}
    assert "laws of Fc, Ff; name one of them" in shortfall(ParameterFile.model_validate(data))


def _other_form(law):
    law["form"] = "power_exponential"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: data["limits"].pop("wear"), "no wear criterion"),
        (lambda data: data["laws"].pop("AW"), "holds no power law of the wear AW"),
        (
            lambda data: _other_form(data["laws"]["P"]),
            'power exponential; the recursion computes with power laws: fit it again with --form "P=power"',
        ),
        (lambda data: _without_time(data["laws"]["AW"]), "without t"),
        (lambda data: data["laws"]["AW"]["coefficients"].update(t=-0.1), "does not grow with time"),
        (lambda data: data["laws"]["P"]["factors"][0].update(unit="1/min"), "computes in m/min"),
        (lambda data: data["limits"]["force"].update(unit="kW"), "give it in that"),
        (lambda data: data["limits"]["feed"].update(low=0.0), "above zero"),
        (lambda data: _with_factor(data["laws"]["P"], "HB"), "needs HB"),
    ],
)
def test_a_file_that_cannot_drive_the_recursion_says_why(change, words):
    data = published("AC-2017").model_dump()
    change(data)
    assert words in shortfall(ParameterFile.model_validate({**data, "content_sha256": None}))


def _without_time(law):
    law["coefficients"].pop("t")
    law["factors"] = [factor for factor in law["factors"] if factor["symbol"] != "t"]


def _with_factor(law, name):
    law["coefficients"][name] = 0.5
    law["factors"] = [*law["factors"], {"symbol": name, "quantity": "hardness", "unit": "HB", "low": 200, "high": 300}]


def test_a_factor_beside_those_that_move_and_a_level_are_put_in():
    data = published("AC-2017").model_dump()
    _with_factor(data["laws"]["P"], "HB")
    data["laws"]["AW"]["by"] = {"column": "material", "reference": "1", "shifts": {"2": 0.1}}
    pf = ParameterFile.model_validate({**data, "content_sha256": None})
    laws = life_laws(pf, at={"HB": 250.0}, by="2")
    assert laws.power(150.0, 0.3, 5.0, 0.2) == pytest.approx(
        pf.laws["P"].values(V=150.0, f=0.3, d=2.5, t=5.0, AW=0.2, HB=250.0)
    )
    assert laws.wear(150.0, 0.3, 5.0) == pytest.approx(pf.laws["AW"].values(by="2", V=150.0, f=0.3, d=2.5, t=5.0))


def test_laws_in_inches_and_wear_in_um_give_the_same_plan(laws, life):
    """V in ft/min, f in inch/rev, d in inch in the laws of loads, wear in um there: the constants follow."""
    data = published("AC-2017").model_dump()
    per = {"V": ("ft/min", 1 / 0.3048), "f": ("inch/rev", 1 / 25.4), "d": ("inch", 1 / 25.4), "AW": ("um", 1000.0)}
    for law in data["laws"].values():
        for factor in law["factors"]:
            unit, times = per.get(factor["symbol"], (factor["unit"], 1.0))
            law["coefficients"]["c0"] *= times ** -law["coefficients"][factor["symbol"]]
            factor |= {"unit": canonical(unit), "low": factor["low"] * times, "high": factor["high"] * times}
    pf = ParameterFile.model_validate({**data, "content_sha256": None})
    found = life_laws(pf)
    assert found.d == 2.5  # mm, though the tested depths are in inch
    for mine, theirs in zip((found.wear, found.power, found.force), (laws.wear, laws.power, laws.force), strict=True):
        assert mine(130.0, 0.4, 5.0, 0.2) == pytest.approx(theirs(130.0, 0.4, 5.0, 0.2), rel=1e-12)
    again = whole_life(found, PUBLISHED)
    assert (again.V.tolist(), again.f.tolist()) == (life.V.tolist(), life.f.tolist())


def test_limits_in_other_units_are_the_same_limits(laws):
    pf = published("AC-2017")
    limits = pf.model_dump()["limits"]
    limits["power"] |= {"value": 7000.0, "unit": "W"}
    limits["wear"] |= {"value": 300.0, "unit": "um"}
    found = life_laws(changed(pf, limits=limits))
    assert (found.power.most, found.wear.most) == (pytest.approx(7.0), pytest.approx(0.3))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda pf: life_laws(pf, d=-1.0), "give a depth of cut above zero"),
        (lambda pf: Rules(times="half"), "give 'published' or 'full'"),
        (lambda pf: Rules(interval=0.0), "above zero"),
        (lambda pf: grid_of(life_laws(pf), feed_step=1e-9), "use larger steps"),
        (lambda pf: TurningRecursion.from_parameters(pf).step(0.1, 30.0), "intervals of 1 min"),
        (lambda pf: TurningRecursion.from_parameters(pf).step(0.1, float("nan")), "intervals of 1 min"),
        (lambda pf: TurningRecursion.from_parameters(pf).step(0.1, float("inf")), "intervals of 1 min"),
        (lambda pf: TurningRecursion.from_parameters(pf, how="best").step(0.0, 60.0), "'grid' or 'exact'"),
        (lambda pf: fixed_life(life_laws(pf), 0.0, 0.1), "give both above zero"),
        (lambda pf: WearingEdge(life_laws(pf)).step((1.0,), 60.0, np.random.default_rng(1)), "two, V and f"),
        (lambda pf: whole_life(life_laws(pf)).surfaces(20), "interval 20: give 0 to 14"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(call, words):
    with pytest.raises(UsageError, match=words):
        call(published("AC-2017"))


# Plans: objectives, settings, bounds

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
        ({"depth": 1e5}, "EXTRAPOLATED: d 1e+05 mm, tested 1.5 to 3 mm"),  # of which no pair is within the limits
        ({"objective": "life", "removal": 1e5}, "EXTRAPOLATED: t up to 52 min, tested 2 to 15 min"),
    ],
)
def test_what_lies_outside_the_tests_is_extrapolated(pf, options, says):
    plan = plan_of(pf, options=PlanOptions(**options))
    assert any(line.startswith(says) for line in plan.extrapolated)
    assert not any(row.tested for row in plan.rows[-1:])


@pytest.mark.parametrize("depth", [1.5, 2.0, 3.0])
def test_tested_depths_are_not_extrapolated(pf, depth):
    assert plan_of(pf, options=PlanOptions(depth=depth, time=10.0)).extrapolated == ()


def test_the_time_holds_whole_intervals_and_says_what_is_left(pf):
    plan = plan_of(pf, options=PlanOptions(time=5.7, interval=0.5))
    assert plan.minutes == 5.5
    assert "Of 5.7 min 5.5 are planned: whole intervals of 0.5 min." in plan.assumed


def test_a_sequence_adds_wear_from_the_wear_reached_by_default(pf):
    """By the time a sequence gains by cutting slowly first, and exceeds the limits on an edge by the wear state."""
    asked = {"objective": "time", "time": 12.0, "grid": (25.0, 0.06)}
    plan, clock = (plan_of(pf, options=PlanOptions(**asked, wear_state=by)) for by in (None, False))
    assert (plan.life.rules.wear, clock.life.rules.wear) == ("wear_state", "clock")
    assert any(line.startswith("Wear adds up from the wear reached") for line in plan.assumed)
    held = apply_plan(clock.life, clock.laws, Rules("published", "wear_state"))
    assert clock.removed > 1.2 * plan.removed
    assert held.P[:12].max() > 8 > 7 >= plan.life.P.max()
    assert held.Fxz[:12].max() > 2000 > 1500 >= plan.life.Fxz.max()
    assert plan_of(pf, options=PlanOptions(time=2.0)).life.rules.wear == "clock"


def test_wear_before_the_first_test_is_named(pf):
    data = pf.model_dump()
    next(factor for factor in data["laws"]["AW"]["factors"] if factor["symbol"] == "t")["low"] = 10.0
    late = ParameterFile.model_validate({**data, "content_sha256": None})
    words = "No test is shorter than 10 min: the wear before is that of the law."
    assert words in plan_of(late, options=PlanOptions(time=2.0)).assumed
    assert words not in plan_of(pf, options=PlanOptions(time=2.0)).assumed


def test_the_diameter_gives_the_spindle_speed(pf):
    row = plan_of(pf, options=PlanOptions(at={"D": 80.0})).rows[0]
    assert row.n == pytest.approx(1000 * 150 / (np.pi * 80))
    assert plan_of(pf).rows[0].n is None


def on_machine(pf):
    """The file with limits of spindle speed and feed rate."""
    ranges = {"spindle_speed": (50.0, 2500.0, "1/min"), "feed_rate": (10.0, 120.0, "mm/min")}
    limits = {name: {"low": low, "high": high, "unit": unit} for name, (low, high, unit) in ranges.items()}
    data = {**pf.model_dump(), "content_sha256": None}
    return ParameterFile.model_validate({**data, "limits": {**data["limits"], **limits}})


@pytest.mark.parametrize("objective", [{}, {"objective": "life", "removal": 8e3}, {"objective": "time", "time": 6.0}])
@pytest.mark.parametrize("diameter", [12.0, 60.0])
def test_a_plan_keeps_the_limits_of_spindle_and_feed_rate_where_the_diameter_is_known(pf, objective, diameter):
    """12 mm: 2500 1/min is 94 m/min; 60 mm: 120 mm/min is a feed of 0.226 mm/rev at 100 m/min."""
    options = {"time": 6.0, **objective, "at": {"D": diameter}, "grid": (10.0, 0.02)}
    plan = plan_of(on_machine(pf), options=PlanOptions(**options))
    assert plan.rows
    for row in plan.rows:
        assert row.n <= 2500 * (1 + 1e-9)
        assert 10 <= row.f * row.n <= 120 * (1 + 1e-9)
    words = "V and f keep the limits of the machine, n 50 to 2500 1/min and fm 10 to 120 mm/min, on a diameter of"
    assert f"{words} {diameter:g} mm." in plan.assumed
    free = plan_of(pf, options=PlanOptions(**{**options, "objective": "removal", "removal": None})).rows[0]
    assert free.f * free.n > 120
    assert free.n > 2500 or diameter > 12


def test_the_exact_optimum_and_the_best_fixed_pair_keep_the_limits_of_the_machine(pf):
    laws = life_laws(on_machine(pf), at={"D": 60.0})
    best, rules = best_exact(laws, Rules(), 0.0, 0.0), Rules()
    assert laws.V == (50.0, 200.0)
    assert best.V * best.f == pytest.approx(np.pi * 60 * 120 / 1000, rel=1e-9)
    assert "feed rate" in best.stops
    fixed = best_fixed(laws, rules)
    assert fixed.V * fixed.f <= np.pi * 60 * 120 / 1000 * (1 + 1e-9)


def test_limits_of_the_machine_are_named_where_the_diameter_is_not_known(pf):
    words = "not held by the limits of the machine, n 50 to 2500 1/min and fm 10 to 120 mm/min: these need the diameter"
    assert words in " ".join(plan_of(on_machine(pf), options=PlanOptions(time=2.0)).assumed)
    assert "limits of the machine" not in " ".join(plan_of(pf, options=PlanOptions(time=2.0)).assumed)
    with pytest.raises(UsageError, match=r"diameter of 2 mm the limits of n allow 0\.3142 to 15\.71 m/min"):
        plan_of(on_machine(pf), options=PlanOptions(time=2.0, at={"D": 2.0}))


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
        ({"objective": "time", "time": 12.0, "interval": 0.02}, "Give a longer --interval or larger steps"),
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
