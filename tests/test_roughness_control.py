"""Turning at constant roughness (SURF): the controller, its plant, the eight simulations, faults, the replay.

References: the constant-roughness paper, eq. 5, Table 1 and the text round Fig. 4 and 5; scipy's exact discretisation;
Routh's criterion for the third-order loop.
"""

import importlib.util
import json
import math
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from fitmodels.cards import replays
from fitmodels.cli import main
from fitmodels.controllers.gate.roughness import check_roughness
from fitmodels.controllers.loop import FAULTS, FaultyPlant, replay, saturated
from fitmodels.controllers.roughness.controller import ConstantRoughness
from fitmodels.controllers.roughness.plant import TurningForce, loop_theory
from fitmodels.controllers.roughness.reference import reference_force
from fitmodels.controllers.roughness.simulations import simulated_table, steady, turn
from fitmodels.core.errors import ParameterError, UsageError
from fitmodels.parameters import check, read, write
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.published.roughness import surf, table1
from fitmodels.parameters.sections.force_control import RoughnessSection
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.signal import cont2discrete

TC, TS, DT = 60 / 610, 0.13, 0.01  # s: a revolution at 610 rpm, Fig. 4, one force sample
WITHIN, RIPPLE = 0.03, 0.08  # aims: mean Ra from its reference; peak-to-peak feed in steady cut, mm/rev
LOW, HIGH = 0.1 * 0.2, 1.5 * 0.2  # mm/rev


@pytest.fixture(scope="module")
def pf():
    return published("SURF")


def changed(pf, **fields):
    return sealed(pf, roughness={**pf.roughness.model_dump(), **fields})


def with_limits(pf, **limits):
    held = {} if pf.limits is None else pf.limits.model_dump()
    return sealed(pf, limits={**held, **limits})


def commanded(controller, forces):
    return np.array([controller.step(force, DT) for force in forces])


# --- the file -----------------------------------------------------------------------------------------


def test_the_published_file_holds_the_papers_numbers_and_passes_the_check(pf):
    told = pf.roughness
    assert (told.servo_time, told.sample_time, told.threshold, told.feed, told.override_high) == (
        0.13,
        0.01,
        100,
        0.2,
        1.5,
    )
    assert pf.laws["Ra"].coefficients == {"a": 0.2401, "b": 0.0034}
    assert told.force_per_feed == pytest.approx(556.23 / 0.2)  # Table 1, simulation 3
    assert told.process_time == pytest.approx(TC)
    assert check(pf).ok


def test_a_file_read_back_makes_the_same_controller(pf, tmp_path):
    again = read(write(pf, tmp_path / "params.json"))
    assert ConstantRoughness.from_parameters(again) == ConstantRoughness.from_parameters(pf)


def test_the_limit_of_force_in_the_file_is_the_overload_and_lies_above_the_reference(pf):
    """A limit of force was not used: the control let twice the reference pass."""
    free = ConstantRoughness.from_parameters(pf)
    force = free.references[0][1]
    assert free.loop.overload_at == pytest.approx(2.1 * force)
    limited = ConstantRoughness.from_parameters(with_limits(pf, force={"value": 0.7, "unit": "kN", "of": "F"}))
    assert limited.loop.overload_at == pytest.approx(700.0)
    other = ConstantRoughness.from_parameters(with_limits(pf, force={"value": 0.7, "unit": "kN", "of": "Fxz"}))
    assert other.loop == free.loop
    with pytest.raises(ParameterError, match="F at most 500 N, but the reference force is"):
        ConstantRoughness.from_parameters(with_limits(pf, force={"value": 500.0, "unit": "N", "of": None}))


def test_a_limit_of_force_below_the_reference_fails_the_check_of_the_file(pf, tmp_path, capsys):
    """It was a note, and all checks passed."""
    limited = with_limits(pf, force={"value": 500.0, "unit": "N", "of": "F"})
    (found,) = check_roughness(limited)
    assert found.passed is False
    assert "F at most 500 N, but the reference force is" in found.words
    write(limited, tmp_path / "params.json")
    assert main(["check", str(tmp_path / "params.json")]) != 0
    assert "all checks passed" not in capsys.readouterr().out
    (open_,) = check_roughness(changed(pf, servo_time=None))  # not complete: no control yet
    assert open_.passed is None


def test_a_spindle_speed_beyond_the_limits_of_the_file_is_refused(pf):
    spindle = {"low": 50.0, "high": 600.0, "unit": "rev/min"}
    pf = changed(pf, spindle_speed=610.0)
    with pytest.raises(ParameterError, match="Spindle speed 610 1/min: the limits of the file are 50 to 600 1/min"):
        ConstantRoughness.from_parameters(with_limits(pf, spindle_speed=spindle))
    assert ConstantRoughness.from_parameters(with_limits(pf, spindle_speed={**spindle, "high": 610.0}))


PER_MINUTE = {"low": 61.0, "high": 122.0, "unit": "mm/min"}  # 0.1 to 0.2 mm/rev at 610 1/min


def test_a_limit_of_feed_rate_holds_at_the_spindle_speed(pf):
    """It was ignored: the file allowed 10 to 90 mm/min, the export went to 170.8 and all checks passed."""
    limited = with_limits(changed(pf, spindle_speed=610.0), feed_rate={**PER_MINUTE, "high": 140.3})
    control = ConstantRoughness.from_parameters(limited)
    assert (control.low, control.high) == pytest.approx((0.1, 0.23))
    assert not [f for f in check_roughness(limited) if f.passed is False and f.name == "limits"]
    narrow = with_limits(changed(pf, spindle_speed=610.0), feed_rate={**PER_MINUTE, "high": 90.0})
    with pytest.raises(ParameterError, match=r"leave 0\.1 to 0\.1475 mm/rev, and the reference of .* needs 0\.2"):
        ConstantRoughness.from_parameters(narrow)
    assert any("leave 0.1 to 0.1475 mm/rev" in f.words for f in check_roughness(narrow) if f.passed is False)
    with pytest.raises(ParameterError, match=r"feed_rate cannot be compared .* without the spindle speed"):
        ConstantRoughness.from_parameters(with_limits(changed(pf, spindle_speed=None), feed_rate=PER_MINUTE))


def test_a_required_roughness_beyond_the_limit_of_the_file_is_refused(pf):
    """The file limited Ra to 0.8 um, the control held 1.6 um."""
    Ra, limit = pf.roughness.roughness, {"unit": "um"}
    with pytest.raises(ParameterError, match=r"limits\.responses\.Ra: at most 0\.5 um, but a roughness of"):
        ConstantRoughness.from_parameters(with_limits(pf, responses={"Ra": {"high": 0.5, **limit}}))
    assert ConstantRoughness.from_parameters(with_limits(pf, responses={"Ra": {"high": Ra, **limit}}))
    inside = with_limits(pf, responses={"Ra": {"high": Ra, **limit}})
    with pytest.raises(ParameterError, match="but a roughness of 3 um is required"):
        ConstantRoughness.from_parameters(inside, schedule=[(1.0, 3.0)])


def test_limits_that_the_control_does_not_apply_are_named(pf):
    limited = with_limits(
        pf, power={"value": 7.0, "unit": "kW", "of": "P"}, speed={"low": 1, "high": 9, "unit": "m/min"}
    )
    (found,) = (f for f in check_roughness(limited) if f.name == "limits" and "does not apply" in f.words)
    assert found.passed is None
    assert "limits.power, limits.speed" in found.words
    assert not [f for f in check_roughness(pf) if "does not apply" in f.words]


def test_table_1_has_eight_rows_and_no_ninth():
    assert [row.number for row in table1()] == list(range(1, 9))
    with pytest.raises(UsageError, match="1, 2, 3, 4, 5, 6, 7, 8"):
        surf(9)


def test_a_reference_force_that_is_not_that_of_its_regression_is_refused(pf):
    fields = {**surf(force_from="regression").roughness.model_dump(), "force": 600.0}
    with pytest.raises(ValidationError, match=r"600 is not that of its regression, 572\.761"):
        RoughnessSection(**fields)
    with pytest.raises(ValidationError, match="the regression is in 'kN', the force in 'N'"):
        RoughnessSection(**{**fields, "regression": {"constant": 0.45, "slope": 0.26, "unit": "kN"}})


# --- the reference force ------------------------------------------------------------------------------


def test_the_inverse_of_equation_5_gives_the_roughness_back(pf):
    for row in table1():
        F = reference_force(pf, row.Ra_ref, "inverse")
        assert 0.2401 * math.exp(0.0034 * F) == pytest.approx(row.Ra_ref, rel=1e-12)


def test_the_regression_lies_within_18_newton_of_every_controlled_force_of_table_1(pf):
    off = [reference_force(pf, row.Ra_ref, "regression") - row.F for row in table1()]
    assert max(map(abs, off)) < 18
    assert abs(sum(off)) < 1e-9  # least squares
    assert reference_force(pf, 1.0, "regression") == pytest.approx(450, abs=0.5)  # 450 + 260 ln Ra
    assert reference_force(pf, math.e, "regression") - 450.35 == pytest.approx(260, abs=0.5)


def test_a_roughness_without_a_force_is_refused_in_a_sentence(pf):
    with pytest.raises(UsageError, match=r"needs a force of 53\.99 N, not above the threshold"):
        reference_force(pf, 0.2401 * math.exp(0.0034 * 53.99))
    with pytest.raises(UsageError, match="give a value above zero"):
        reference_force(pf, -1.0)
    with pytest.raises(UsageError, match="no regression"):
        reference_force(changed(pf, regression=None), 1.0, "regression")


# --- the plant ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tc", "ts"), [(TC, TS), (0.13, 0.13), (0.1300001, 0.13), (1e-3, 0.5), (0.5, 1e-3)])
def test_the_plant_is_scipys_zero_order_hold_of_both_lags(tc, ts):
    commands = np.random.default_rng(1).uniform(0.05, 0.3, 60)
    A, B = [[-1 / ts, 0], [1 / tc, -1 / tc]], [[1 / ts], [0]]
    a, b, *_ = cont2discrete((np.array(A), np.array(B), np.eye(2), np.zeros((2, 1))), DT)
    x, theirs = np.zeros(2), []
    for u in commands:
        x = a @ x + b[:, 0] * u
        theirs.append(2700 * x[1])
    plant, noise = TurningForce(gain=2700, tc=tc, ts=ts, disturbance=0.0), np.random.default_rng(1)
    assert [plant.step(u, DT, noise) for u in commands] == pytest.approx(theirs, rel=1e-6)


def test_the_servo_reaches_0_632_of_a_step_after_0_13_s():
    """Fig. 4 of the paper."""
    plant, noise = TurningForce(gain=1.0, tc=TC, ts=TS, disturbance=0.0), np.random.default_rng(1)
    for _ in range(13):
        plant.step(0.3, DT, noise)
    assert plant.feed / 0.3 == pytest.approx(0.632, abs=5e-4)


def test_the_force_is_disturbed_by_up_to_10_percent_and_held_as_long_as_is_said(pf):
    for hold, longest in ((TC, 10), (0.0, 1)):
        trace = turn(pf, control=False, hold=hold).trace
        factor = trace.measurement[300:] / (pf.roughness.force_per_feed * 0.2) - 1
        assert 0.095 < np.abs(factor).max() <= 0.1 + 1e-9
        assert abs(factor.mean()) < 0.02
        ends = np.flatnonzero(np.abs(np.diff(factor)) > 1e-6)
        assert np.diff(ends).max() == longest
    assert factor.std() == pytest.approx(0.1 / math.sqrt(3), rel=0.05)  # of a uniform distribution


def test_the_same_seed_gives_the_same_cut(pf):
    one, same, other = (turn(pf, seed=seed, duration=3).trace.measurement for seed in (1, 1, 2))
    assert (one == same).all()
    assert (one != other).any()


# --- what is asked of the loop ------------------------------------------------------------------------


@cache
def table(reading, hold, seed):
    return simulated_table(reading, hold=hold, seed=seed)


EVERY = [
    ("inverse", None, 1),
    ("inverse", None, 2),
    ("inverse", 0.0, 1),
    ("regression", None, 1),
    ("regression", 0.0, 1),
]


@pytest.mark.parametrize(("reading", "hold", "seed"), EVERY)
def test_mean_roughness_lies_within_3_percent_of_each_reference_of_table_1(reading, hold, seed):
    assert [round(run.error, 3) for run in table(reading, hold, seed) if abs(run.error) > WITHIN] == []


@pytest.mark.parametrize(("reading", "hold", "seed"), EVERY)
def test_the_feed_ripples_by_at_most_0_08_mm_per_rev_in_steady_cut(reading, hold, seed):
    assert max(run.controlled.ripple for run in table(reading, hold, seed)) <= RIPPLE


@pytest.mark.parametrize(("reading", "hold", "seed"), EVERY)
def test_mean_absolute_error_over_the_eight_is_smaller_with_control(reading, hold, seed):
    """Of the mean roughness of each simulation, and of every sample."""
    found = table(reading, hold, seed)
    for on, off in (
        ([run.error for run in found], [run.error_without for run in found]),
        ([run.controlled.error for run in found], [run.without.error for run in found]),
    ):
        assert np.mean(np.abs(on)) < np.mean(np.abs(off))


def test_a_force_drawn_each_revolution_ripples_the_feed_more_than_one_drawn_each_sample():
    held, white = (max(run.controlled.ripple for run in table("inverse", hold, 1)) for hold in (None, 0.0))
    assert 1.5 * white < held


def test_simulations_7_and_8_lean_on_150_percent_of_the_one_feed_that_the_paper_states():
    leaning = [run.row.number for run in table("inverse", None, 1) if run.controlled.at_high > 0.05]
    assert leaning == [7, 8]
    own = simulated_table(feed=None)  # each row's recommended feed as the programme
    assert max(run.controlled.at_high for run in own) == 0
    assert max(abs(run.error) for run in own) < WITHIN
    assert max(run.controlled.ripple for run in own) <= RIPPLE


def test_a_servo_half_as_slow_again_as_the_file_says_is_still_held(pf):
    plant = TurningForce.from_parameters(pf, ts=1.5 * TS)
    trace = replay(ConstantRoughness.from_parameters(pf), plant, duration=15, dt=DT, record=("feed", "force"))
    late = trace.time > 3
    assert np.ptp(trace.recorded["feed"][late]) <= RIPPLE
    assert (0.2401 * np.exp(0.0034 * trace.measurement[late])).mean() == pytest.approx(1.6, rel=WITHIN)


def test_a_cut_20_percent_stiffer_is_corrected_where_a_constant_feed_is_44_percent_off(pf):
    on, off = (steady(turn(pf, control=control, engaged=lambda t: 1.2)) for control in (True, False))
    assert on.Ra == pytest.approx(1.6, rel=WITHIN)
    assert off.Ra > 1.4 * 1.6


def test_the_reference_changed_along_the_run_is_followed(pf):
    """Sections A to D of Fig. 5: Ra 1.6 um, then 1.0 um; the table's feeds are 0.20 and 0.15 mm/rev."""
    cut = turn(pf, schedule=[(7.5, 1.0)])
    before, after = steady(cut, end=7.5), steady(cut, 10.5)
    assert (before.Ra, after.Ra) == (pytest.approx(1.6, rel=WITHIN), pytest.approx(1.0, rel=WITHIN))
    assert (round(before.f, 2), round(after.f, 2)) == (0.20, 0.15)
    assert cut.trace.first("reference") == pytest.approx(7.5)
    assert np.unique(cut.trace.reference).size == 2


@pytest.mark.parametrize("schedule", [[(5.0, 1.0), (5.0, 1.2)], [(5.0, 1.0), (3.0, 1.2)], [(0.0, 1.0)], [(-1.0, 1.0)]])
def test_a_schedule_out_of_order_is_refused(pf, schedule):
    with pytest.raises(UsageError, match="give increasing times above 0"):
        ConstantRoughness.from_parameters(pf, schedule=schedule)


# --- stability, and the other reading -----------------------------------------------------------------


def test_the_command_reading_is_an_integrator_of_gain_100_against_a_limit_of_17_9():
    """Routh: s (tc s + 1)(ts s + 1) + k is stable for k < (tc + ts) / (tc ts)."""
    loop = loop_theory(TC, TS, DT)
    assert (round(loop.gain), round(loop.limit, 1)) == (100, 17.9)
    for k, stable in ((0.999 * loop.limit, True), (1.001 * loop.limit, False)):
        poles = np.roots([TC * TS, TC + TS, 1.0, k])
        assert (poles.real.max() < 0) == stable
    assert loop.servo_radius < 1 < loop.command_radius


def test_the_poles_of_theory_are_those_of_the_replay(pf):
    """A small deviation dies out as fast as the largest pole says, and grows so in the other reading."""
    loop = loop_theory(TC, TS, DT)
    for feed, radius in (("servo", loop.servo_radius), ("command", loop.command_radius)):
        pf1 = changed(pf, roughness=1.6, force=pf.roughness.force_per_feed * 0.2 * (1 + 1e-7), threshold_time=3.0)
        trace = turn(pf1, feed=feed, disturbance=0.0, duration=6.0).trace
        off = np.abs(trace.measurement / trace.reference - 1)[301:]
        period = 2 * math.pi / abs(_angle(feed))
        peaks = [off[round(i * period) : round((i + 1) * period)].max() for i in (0, 2)]
        assert (peaks[1] / peaks[0]) ** (1 / (2 * period)) == pytest.approx(radius, abs=0.01)


def _angle(feed):
    """Angle of the slowest pole, from an independent discretisation."""
    a, b, *_ = cont2discrete(
        (np.array([[-1 / TS, 0], [1 / TC, -1 / TC]]), np.array([[1 / TS], [0]]), np.eye(2), np.zeros((2, 1))), DT
    )
    c = np.array([[1.0, -1.0, 0.0]]) if feed == "servo" else np.array([[0.0, -1.0, 1.0]])
    whole = np.vstack([np.hstack([a + b @ c[:, :2], b * c[0, 2]]), c])
    poles = np.linalg.eigvals(whole)
    return np.angle(poles[np.argmax(np.abs(poles))])


def test_the_command_reading_swings_over_the_whole_override_range(pf):
    command = turn(pf, feed="command").trace.command[300:]
    assert (command.min(), command.max()) == pytest.approx((LOW, HIGH))
    assert np.ptp(command) > 4 * np.ptp(turn(pf).trace.command[300:])


def test_the_command_reading_swings_by_itself(pf):
    """Without any disturbance, from the entry alone, it goes on and on."""
    servo, command = (turn(pf, feed=feed, disturbance=0.0).trace.command[1000:] for feed in ("servo", "command"))
    assert np.ptp(servo) < 1e-6
    assert command.max() == pytest.approx(HIGH)
    assert np.ptp(command) > 0.15


def test_slower_changes_than_the_crossover_are_lessened_and_faster_ones_enlarged(pf):
    loop = loop_theory(TC, TS, DT)
    for times, lessened in ((0.5, True), (2.0, False)):
        hertz = times * loop.crossover
        cut = turn(pf, disturbance=0.0, engaged=lambda t, w=2 * math.pi * hertz: 1 + 0.02 * math.sin(w * t))
        s = 2j * math.pi * hertz
        lag = abs(1 / (TC * s + 1))  # this change enters before the process lag
        factor = np.ptp(cut.trace.measurement[500:]) / (0.04 * lag * cut.trace.reference[0])
        assert (factor < 1) == lessened
        assert factor <= 1.05 * loop.enlarged


# --- limits, threshold, no runaway --------------------------------------------------------------------


def test_from_power_on_the_feed_is_at_its_lower_limit_until_air_is_known(pf):
    """Below the threshold for its time: air; then the feed rises at the rate `recover`, 0.14 mm/rev per s."""
    controller = ConstantRoughness.from_parameters(pf)
    assert controller.command == LOW
    feeds = commanded(controller, [80.0 + k % 2 for k in range(200)])
    assert set(feeds[:28]) == {LOW}
    assert 0 < np.diff(feeds).max() <= (HIGH - LOW) / 2 * DT * (1 + 1e-9)
    assert feeds[-1] == pytest.approx(0.2)
    assert not controller.acting


def test_a_power_cycle_in_the_cut_never_gives_the_programmed_feed_at_once(pf):
    """At the lower limit the force of a sharp tool is below the threshold: the feed rises slowly until it is not."""
    plant = TurningForce.from_parameters(pf, feed=LOW, engaged=lambda t: 2.0)
    trace = replay(ConstantRoughness.from_parameters(pf), plant, duration=8, dt=DT, record=("feed", "force"))
    start = trace.time < trace.first("cut")
    assert np.diff(trace.command[start], prepend=LOW).max() <= (HIGH - LOW) / 2 * DT * (1 + 1e-9)
    assert trace.command.max() < 0.12  # half of 0.2 mm/rev in a cut twice as stiff
    assert trace.recorded["force"].max() < 1.2 * pf.roughness.force
    assert trace.measurement[trace.time > 4].mean() == pytest.approx(pf.roughness.force, rel=0.03)


@pytest.mark.parametrize("force", [300.0, math.nan, -500.0, 1e6])
def test_a_power_on_without_known_air_keeps_the_lower_limit(pf, force):
    controller = ConstantRoughness.from_parameters(pf)
    controller.control.enabled = False
    assert set(commanded(controller, [force] * 300)) == {LOW}


def test_the_control_acts_only_after_its_time_above_the_threshold(pf):
    controller = ConstantRoughness.from_parameters(pf).approached()
    feeds = commanded(controller, [300.0] * 29 + [50.0] + [300.0] * 30)
    np.testing.assert_allclose(feeds[:-1], 0.2, rtol=1e-12)
    assert feeds[-1] > 0.2


def test_no_runaway_as_the_force_falls_to_zero(pf):
    controller = ConstantRoughness.from_parameters(pf)
    feeds = commanded(controller, [*[558.0] * 50, *(558.0 * 0.9 ** np.arange(200)), *[0.0] * 50])
    assert feeds.max() <= HIGH
    assert feeds[-1] == pytest.approx(0.2)
    assert not controller.acting


def test_the_tool_leaves_the_work_and_enters_again_without_a_peak(pf):
    trace = turn(pf, disturbance=0.0, engaged=lambda t: 0.0 if 5 <= t < 8 else 1.0).trace
    away, again = (trace.time > 5.5) & (trace.time < 8), trace.time >= 8
    np.testing.assert_allclose(trace.command[away], 0.2, rtol=1e-12)
    assert trace.recorded["feed"].max() <= HIGH
    assert trace.measurement[again].max() < 1.05 * pf.roughness.force
    assert [event.what for event in trace.events] == ["cut", "at high", "air", "cut", "free"]
    assert trace.measurement[-1] == pytest.approx(pf.roughness.force, rel=1e-3)


def test_an_interrupted_cut_ends_each_time_at_the_reference(pf):
    trace = turn(pf, disturbance=0.0, engaged=lambda t: float(t % 3 < 2)).trace
    for end in (1.95, 4.95, 7.95, 10.95):
        assert trace.measurement[round(end / DT)] == pytest.approx(pf.roughness.force, rel=0.01)
    assert trace.measurement.max() < 1.1 * pf.roughness.force


@pytest.mark.parametrize(
    ("fields", "machine", "expected"),
    [
        ({}, None, (0.02, 0.3)),
        ({"chip_thickness": 0.22}, None, (0.02, 0.22)),
        ({"override_low": 0.5}, None, (0.1, 0.3)),
        ({}, {"low": 0.05, "high": 0.25, "unit": "mm/rev"}, (0.05, 0.25)),
        ({"chip_thickness": 0.15}, {"low": 0.0, "high": 0.25, "unit": "mm/rev"}, (0.02, 0.15)),
    ],
)
def test_the_feed_stays_inside_the_narrowest_of_override_machine_and_chip_thickness(pf, fields, machine, expected):
    file = changed(pf, **fields)
    file = sealed(file, limits={"feed": machine}) if machine else file
    for engaged in (0.3, 10.0):
        command = turn(file, duration=6.0, engaged=lambda t, share=engaged: share).trace.command
        assert expected[0] - 1e-12 <= command.min() <= command.max() <= expected[1] + 1e-12
    low, high = ConstantRoughness.from_parameters(file).low, ConstantRoughness.from_parameters(file).high
    assert (low, high) == pytest.approx(expected)


def test_limits_that_leave_no_feed_are_refused(pf):
    with pytest.raises(ParameterError, match=r"0\.02 to 0\.01 mm/rev are an empty range"):
        ConstantRoughness.from_parameters(changed(pf, chip_thickness=0.01))
    with pytest.raises(ParameterError, match="mm/min; write it in mm/rev"):
        ConstantRoughness.from_parameters(sealed(pf, limits={"feed": {"low": 1.0, "high": 2.0, "unit": "mm/min"}}))


readings = st.lists(st.floats() | st.floats(0.0, 2000.0), min_size=1, max_size=200)


@settings(deadline=None, max_examples=60)
@given(readings, st.sampled_from(["servo", "command"]))
def test_whatever_it_reads_the_feed_is_inside_its_limits_and_above_zero(forces, feed):
    controller = ConstantRoughness(
        references=((0.0, 558.0),), programmed=0.2, low=LOW, high=HIGH, threshold=100.0, wait=0.3, sample_time=DT,
        servo_time=TS, reading=feed,
    )  # fmt: skip
    for force in [*[500.0] * 40, *forces]:
        assert LOW <= controller.step(force, DT) <= HIGH


@pytest.mark.parametrize("dt", [0.02, float("nan"), float("inf")])
def test_another_period_than_the_files_is_refused(pf, dt):
    with pytest.raises(UsageError, match=r"every 0\.01 s; replay it at that"):
        ConstantRoughness.from_parameters(pf).step(500.0, dt)


# --- faults -------------------------------------------------------------------------------------------

BROKEN = {
    **FAULTS,
    "saturated below the reference": saturated(450.0),
    "saturated at twice the reference": lambda reading, told: 1116.0,
}
EVENT = {
    "dropout": "air",
    "not a number": "force unknown",
    "infinite": "force unknown",
    "stuck": "force stuck",
    "wrong sign": "force unknown",
    "ten times stiffer": "at low",
    "saturated below the reference": "at high",
    "saturated at twice the reference": "at low",
}
LATCHED = {
    "not a number": "force lost",
    "infinite": "force lost",
    "wrong sign": "force lost",
    "stuck": "force stuck",
    "saturated below the reference": "force stuck",
    "saturated at twice the reference": "force stuck",
}


def broken(pf, name, end=9.0):
    inner = TurningForce.from_parameters(pf)
    controller = ConstantRoughness.from_parameters(pf).approached()
    plant = FaultyPlant(inner, BROKEN[name], start=5.0, end=end)
    return replay(controller, plant, duration=15, dt=DT, seed=3)


@pytest.mark.parametrize("name", EVENT)
def test_a_fault_leaves_the_feed_inside_its_limits_and_stands_in_the_trace(pf, name):
    trace = broken(pf, name)
    assert np.isfinite(trace.command).all()
    assert LOW <= trace.command.min() <= trace.command.max() <= HIGH
    events = [event for event in trace.events if 5.0 - 1e-9 <= event.time <= 6.0]
    assert EVENT[name] in [event.what for event in events]


@pytest.mark.parametrize("name", LATCHED)
def test_a_fault_takes_the_feed_to_its_lower_limit_and_is_latched(pf, name):
    trace = broken(pf, name)
    at = trace.first(LATCHED[name])
    assert at < 5.0 + (1.3 if LATCHED[name] == "force stuck" else 0.06)
    assert set(trace.command[trace.time > at + 0.5]) == {LOW}


def test_a_dropout_to_zero_gives_the_programmed_feed_at_most(pf):
    trace = broken(pf, "dropout", end=float("inf"))
    assert trace.command[trace.time > 5.5].max() <= 0.2 * (1 + 1e-12)


@pytest.mark.parametrize("every", [2, 3])
def test_a_sensor_that_loses_every_second_or_third_reading_is_a_fault(pf, every):
    controller, plant = ConstantRoughness.from_parameters(pf).approached(), TurningForce.from_parameters(pf)
    replay(controller, plant, duration=4, dt=DT)
    feeds = commanded(controller, [math.nan if k % every == 0 else 558.0 + k % 5 for k in range(150)])
    assert controller.control.fault
    assert feeds[-1] == LOW


def test_a_sensor_that_loses_one_reading_in_six_is_none(pf):
    controller, plant = ConstantRoughness.from_parameters(pf).approached(), TurningForce.from_parameters(pf)
    replay(controller, plant, duration=4, dt=DT)
    commanded(controller, [math.nan if k % 6 == 0 else 558.0 + k % 5 for k in range(3000)])
    assert not controller.control.fault


def test_a_reset_takes_the_control_up_again_from_the_lower_limit(pf):
    controller, plant = ConstantRoughness.from_parameters(pf).approached(), TurningForce.from_parameters(pf)
    faulty = FaultyPlant(plant, BROKEN["infinite"], start=2.0, end=3.0)
    replay(controller, faulty, duration=5, dt=DT)
    assert (controller.control.fault, controller.command) == (True, LOW)
    controller.control.reset = True
    trace = replay(controller, faulty, duration=8, dt=DT)
    assert trace.command[0] < LOW + 0.002
    assert trace.measurement[trace.time > 4].mean() == pytest.approx(558, rel=0.03)


def test_an_enormous_upper_limit_is_no_worn_tool(pf):
    """1 % of a range of 20 mm/rev is the feed itself: the threshold of rest is 1 % of the lower limit at most."""
    trace = turn(changed(pf, override_high=100.0)).trace
    assert trace.first("change tool") is None
    assert trace.measurement[trace.time > 5].mean() == pytest.approx(558, rel=0.03)


def test_a_plant_ten_times_stiffer_is_cut_at_a_feed_above_zero(pf):
    trace = turn(pf, disturbance=0.0, engaged=lambda t: 10.0 if t >= 5 else 1.0).trace
    assert trace.command[-1] == pytest.approx(pf.roughness.force / (10 * pf.roughness.force_per_feed), rel=1e-3)
    assert trace.first("at low") < 5.5
    rough = turn(surf(1), engaged=lambda t: 10.0 if t >= 5 else 1.0).trace  # asks for less than the floor
    assert rough.command[rough.time > 5].min() == LOW


# --- what is missing, and what is told ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"servo_time": None}, "has no servo_time"),
        ({"threshold_time": 3e11}, "above 60 s: the cut would not be controlled"),
        ({"sample_time": None}, "has no sample_time"),
        ({"feed": None}, "has no feed"),
        ({"force_per_feed": None, "process_time": None}, "lacks force_per_feed, process_time"),
        ({"servo_time": 0.0}, "servo_time or process_time of 0"),
        ({"law": "Rz"}, "no law of 'Rz'"),
        ({"unit_feed": "mm/min"}, "write them in um, N and mm/rev"),
    ],
)
def test_a_file_that_cannot_drive_it_says_why(pf, fields, words):
    assert words in replays.lacks("roughness", changed(pf, **fields))


def test_another_papers_file_cannot_drive_it_and_the_published_one_can(pf):
    assert "no roughness section" in replays.lacks("roughness", published("AC-2016"))
    assert replays.lacks("roughness", pf) == ""


def test_a_replay_reports_the_reference_force_the_roughness_and_the_reconstructions(pf):
    told = replays.replayed("roughness", pf, {}, 1)
    text = "\n".join(told.lines)
    for words in ("558 N", "mean Ra 1.62 um", "peak-to-peak", "17.9/s, not stable", "eight simulations", "No draws"):
        assert words in text
    assert sum(line.startswith("Reconstruction") for line in told.assumed) >= 4
    assert json.loads(json.dumps(told.facts))["Ra_ref_um"] == 1.6
    assert set(told.figures) == {"roughness_run", "roughness_readings", "roughness_table"}
    for figure in told.figures.values():
        titles = [figure.get_suptitle(), *(ax.get_title() for ax in figure.axes)]
        assert any("Simulated" in title for title in titles)


def test_draws_give_a_band_and_the_force_that_is_safe(pf):
    rng = np.random.default_rng(1)
    ln_a = np.log(0.2401) + rng.normal(0, 0.05, 4000)
    draws = {"Ra": Draws(("ln a", "b"), np.column_stack([ln_a, np.full(4000, 0.0034)]))}
    facts = replays.replayed("roughness", pf, draws, 1).facts
    assert facts["Ra_band_um"] == pytest.approx([1.6 * math.exp(-1.96 * 0.05), 1.6 * math.exp(1.96 * 0.05)], rel=0.01)
    assert facts["F_safe_N"] == pytest.approx(pf.roughness.force - 1.645 * 0.05 / 0.0034, abs=1.5)


def test_a_file_of_another_work_is_replayed_without_the_papers_table(pf):
    own = sealed(pf, provenance={**pf.provenance.model_dump(), "options": {}})
    assert "table" not in replays.replayed("roughness", own, {}, 1).facts


def test_the_ledger_has_every_number_of_table_1_and_the_digits_of_equation_5(monkeypatch):
    room = Path(__file__).parents[1] / "docs" / "reproduction"
    monkeypatch.syspath_prepend(str(room))
    spec = importlib.util.spec_from_file_location("surf_ledger", room / "surf.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "surf_ledger", module)
    spec.loader.exec_module(module)
    found = module.entries()
    for row in table1():
        printed = {entry.printed for entry in found if entry.place == f"Table 1, simulation {row.number}"}
        assert {str(v) for v in (row.Ra_ref, row.F_without, row.f_without, row.F, row.f, row.Ra)} <= printed
    of_5 = {entry.printed: entry for entry in found if entry.place == "eq. 5"}
    assert (round(of_5["0.2401"].ours, 4), round(of_5["0.0034"].ours, 4)) == (0.2401, 0.0034)
    assert {entry.printed for entry in found} >= {"0.13", "448", "570", "582.12", "1.59", "2", "1500"}
    assert all(entry.why for entry in found if entry.verdict != "reproduced")
    assert all((entry.ours is None) == (entry.verdict == "not computable") for entry in found)
