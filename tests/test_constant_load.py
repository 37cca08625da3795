"""The constant-load controller by itself: limits and rates of its command, its states, and what latches a fault.

Its arithmetic is that of the exports; test_export_hal.py proves the position form against LinuxCNC. In the form of
eq. 16 of Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587) it is compared with that equation and
with the tuner's loop.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitmodels import controllers, parameters
from fitmodels.controllers.constant_load_milling.control_laws import loop_of
from fitmodels.controllers.constant_load_milling.plant import MillingCut
from fitmodels.controllers.constant_load_milling.states import STATES, State
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.loop import FAULTS, FaultyPlant, saturated
from fitmodels.core.errors import GateError, UsageError
from fitmodels.parameters.exports.loop import loop_settings
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.load_line import Engagement
from hypothesis import given, settings
from hypothesis import strategies as st

B18, A18 = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
GAIN = 1.2416e-4 * 1000 / (sum(B18) / sum(A18))  # A per override, at rest: CLM-2023's three points, 1000 mm/min


@pytest.fixture
def plant(linear_cut):
    return lambda **more: linear_cut(**{"b": [GAIN * b for b in B18], "a": A18, "offset": 0.1158, **more})


@pytest.fixture
def controller(constant_load_file):
    def make(**more):
        return controllers.ConstantLoad.from_parameters(constant_load_file(**more))

    return make


def test_a_file_alone_makes_it_and_a_file_read_back_makes_the_same(constant_load_file, tmp_path):
    pf = constant_load_file()
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert controllers.ConstantLoad.from_parameters(again).loop == controllers.ConstantLoad.from_parameters(pf).loop


def test_it_settles_at_the_reference_within_four_seconds(controller, plant):
    trace = controllers.replay(controller(), plant(noise=1e-6), duration=20, dt=0.02)
    late = trace.time > 1 + 4 + 2.5  # entry, and the rise of the feed over its whole range
    assert np.abs(trace.measurement[late] - 0.22).max() < 0.01 * 0.22  # CLM-2023: within 1 % of the reference


def test_the_same_seed_gives_the_same_trace(controller, plant):
    traces = [controllers.replay(controller(), plant(noise=0.01), duration=4, dt=0.02, seed=seed) for seed in (1, 1, 2)]
    assert (traces[0].command == traces[1].command).all()
    assert (traces[0].command != traces[2].command).any()


readings = st.lists(st.floats(), min_size=1, max_size=300)  # NaN and infinity too
inputs = st.lists(st.tuples(st.floats(), *[st.booleans()] * 6, st.one_of(st.none(), st.floats())), max_size=200)


@settings(deadline=None, max_examples=60)
@given(inputs)
def test_whatever_it_reads_the_command_is_finite_bounded_and_slow(loaded, inputs):
    c, last = controllers.ConstantLoad(loaded), None
    for reading, c.enabled, c.spindle_on, c.idle, c.beat, c.reset, c.slowed, c.requested in inputs:
        command = c.step(reading, loaded.sample_time)
        assert 0 < command <= 1.0
        u = c._u
        assert loaded.low <= u <= loaded.high
        assert not (c.cutting and c.slowed and last is not None and u > last)
        assert command <= u or c.state != State.FAULT
        if last is not None:
            assert -loaded.back_off * loaded.sample_time - 1e-12 <= u - last
            assert u - last <= loaded.recover * loaded.sample_time + 1e-12
        last = u


@pytest.fixture(scope="module")
def loaded(constant_load_file):
    return controllers.ConstantLoad.from_parameters(constant_load_file()).loop


# ---- states


def run(c, loads, **changes):
    """Steps of a controller with inputs changed before them: the commands."""
    for name, value in changes.items():
        setattr(c, name, value)
    return [c.step(load, c.loop.sample_time) for load in loads]


def noisy(load, n, seed=0):
    """A load with a scatter far below any threshold, so that no two readings are equal."""
    return (load + 1e-6 * np.random.default_rng(seed).standard_normal(n)).tolist()


def worn_cut(loaded):
    """In the cut with a worn tool: the feed rests between its limits, and has been there for a while."""
    c = controllers.ConstantLoad(loaded, running=True)
    run(c, noisy(0.2, 60))
    run(c, noisy(0.22, 30))
    assert c.state is State.CONTROL
    assert loaded.low < c.command < loaded.high
    return c


class Slowed:
    """The path of a cut, slower than its feed by the operator's override or in a corner: the share of a time in s."""

    def __init__(self, plant, controller, share, *, wired=True) -> None:
        self.plant, self.controller, self.share, self.wired, self.time = plant, controller, share, wired, 0.0

    def step(self, command, dt, noise):
        self.time, share = self.time + dt, self.share(self.time)
        self.controller.slowed = self.wired and share < 1
        return self.plant.step(command * share, dt, noise)


CORNERS = {"override 60 %": lambda t: 0.6 if 15 < t < 25 else 1.0,
           "override 40 %": lambda t: 0.4 if 15 < t < 25 else 1.0,
           "corners": lambda t: 0.5 if t > 15 and t % 4 < 2 else 1.0}  # fmt: skip


@pytest.mark.parametrize("share", CORNERS.values(), ids=CORNERS)
@pytest.mark.parametrize("form", ["position", "incremental_sum"])
def test_a_feed_slowed_from_outside_is_not_compensated(controller, plant, share, form):
    """It was, and the feed returned to the upper limit: 948 mm/min after 573 at a load of 0.285 A."""
    gains = {} if form == "position" else {"form": form, "kp": 160.0, "ki": 0.0}
    c = controller(pi=gains)
    trace = controllers.replay(c, Slowed(plant(offset=0.1358, noise=1e-4), c, share), duration=35, dt=0.02)
    before = trace.command[(trace.time > 10) & (trace.time < 15)]
    assert c.loop.low < before.mean() < 0.9 * c.loop.high
    assert trace.command[trace.time > 15].max() < 1.02 * before.max()
    assert not c.worn
    other = controller(pi=gains)
    free = Slowed(plant(offset=0.1358, noise=1e-4), other, share, wired=False)
    assert controllers.replay(other, free, duration=35, dt=0.02).command.max() > 1.2 * before.max()


def test_a_program_that_requests_less_than_the_loop_does_not_raise_its_feed(controller, plant):
    """F 400 of 1000 mm/min for 10 s, then 1000 again: the loop went to its upper limit meanwhile."""
    c, seen = controller(), []
    cut, noise = plant(offset=0.1358), np.random.default_rng(1)
    for k in range(1750):
        c.requested = 400.0 if 750 <= k < 1250 else 1000.0
        seen.append(c.step(cut.step(c.command * c.requested / 1000, 0.02, noise) + 1e-5 * (k % 2), 0.02))
    assert max(seen[750:1250]) == 1.0
    assert max(seen[1250:]) < 1.02 * seen[749] < 0.9


def test_a_slowed_feed_at_the_lower_limit_is_no_worn_tool_until_the_load_is_the_reference(loaded):
    c = controllers.ConstantLoad(loaded, running=True)
    run(c, noisy(0.2, 800), slowed=True)
    assert (c.command, c.worn) == (loaded.low, False)
    run(c, noisy(0.225, 800))
    assert c.worn


def test_before_the_first_cut_the_feed_is_the_programmed_one_until_it_is_switched_on(loaded):
    c = controllers.ConstantLoad(loaded)
    assert set(run(c, noisy(0.05, 50), enabled=False, spindle_on=False)) == {1.0}
    assert c.state is State.OFF
    fall = loaded.samples((1.0 - loaded.low) / loaded.back_off)
    assert run(c, noisy(0.05, 100), enabled=True)[fall:] == [loaded.low] * (100 - fall)
    assert c.state is State.OFF
    assert set(run(c, noisy(0.05, 200), spindle_on=True)) == {loaded.low}
    assert c.state is State.AIR


def test_the_upper_limit_bounds_the_feed_where_it_is_below_the_programmed_one(loaded):
    c = controllers.ConstantLoad(replace(loaded, feed_high=900.0))
    assert set(run(c, noisy(0.05, 10), enabled=False)) == {0.9}


def test_entry_starts_at_the_lower_limit_and_later_cuts_at_the_last_feed(loaded):
    c = controllers.ConstantLoad(loaded, running=True)
    n = loaded.samples(loaded.engage_after)
    entered = run(c, noisy(0.2, n + 3))
    assert entered[0] == loaded.low
    assert c.state in (State.ENTRY, State.CONTROL)
    run(c, noisy(0.2, 60))
    last = c.command
    assert set(run(c, noisy(0.05, 100))) == {last}
    assert c.state is State.AIR
    again = run(c, noisy(0.2, n))
    assert again[: n - 1] == [last] * (n - 1)
    assert c.state in (State.ENTRY, State.CONTROL)


def test_losing_enable_in_the_cut_keeps_the_feed_until_motion_and_load_are_at_rest(loaded):
    c = worn_cut(loaded)
    last = c.command
    assert set(run(c, noisy(0.22, 100), enabled=False)) == {last}
    assert c.state is State.OFF
    assert set(run(c, noisy(0.22, 100), idle=True)) == {last}  # a tool at rest in the cut
    assert set(run(c, noisy(0.05, 100), idle=False)) == {last}
    assert set(run(c, [math.nan] * 100, idle=True)) == {last}
    assert run(c, noisy(0.05, 200), idle=True)[-1] == 1.0


def test_losing_the_spindle_signal_in_the_cut_takes_the_feed_to_its_lower_limit(loaded):
    """A spindle that stalls is below its speed, and nothing monitors the load: the last feed was kept."""
    c = worn_cut(loaded)
    last = c.command
    fall = run(c, noisy(0.3, 100), spindle_on=False)
    assert fall[:3] == pytest.approx([last - loaded.back_off * loaded.sample_time * n for n in (1, 2, 3)])
    assert (fall[-1], c.state) == (loaded.low, State.OFF)
    assert set(run(c, noisy(0.22, 20), spindle_on=True)) == {loaded.low}


def test_a_pause_in_the_cut_keeps_the_feed(loaded):
    """A worn tool's load stays above the threshold in a pause; the PI would raise the feed to its upper limit."""
    c = worn_cut(loaded)
    last = c.command
    assert set(run(c, noisy(0.17, 100), idle=True)) == {last}
    assert set(run(c, [0.17] * 100)) == {last}
    assert (c.state, c.fault) == (State.ENTRY, False)
    run(c, noisy(0.22, 5), idle=False)
    assert c.state is State.CONTROL


LOST = {"not a number": math.nan, "infinite": math.inf, "zero": 0.0, "negative": -0.22, "too large": 50.0}


@pytest.mark.parametrize("reading", LOST.values(), ids=LOST)
def test_a_lost_reading_is_a_fault_that_takes_the_feed_to_its_lower_limit(loaded, reading):
    c = worn_cut(loaded)
    last, n = c.command, loaded.samples(loaded.lost_after)
    commands = run(c, [reading] * 200)
    assert max(commands) <= last + loaded.recover * loaded.lost_after
    assert c.fault
    assert c.state is State.FAULT
    reached = next(k for k, command in enumerate(commands) if command == loaded.low)
    assert reached <= n + (last - loaded.low) / (loaded.back_off * loaded.sample_time) + 1
    assert not c.feed_inhibit


def test_a_spike_is_no_fault(loaded):
    c = worn_cut(loaded)
    run(c, [math.nan] * (loaded.samples(loaded.lost_after) - 1))
    run(c, noisy(0.22, 10))
    assert not c.fault


def test_a_reading_that_stands_still_in_the_cut_is_a_fault(loaded):
    c = worn_cut(loaded)
    run(c, [0.21] * (loaded.samples(loaded.stuck_after) + 1))
    assert (c.fault, c.news) == (True, ("load stuck", "air"))


def test_without_monitoring_of_equal_readings_they_are_used(loaded):
    c = worn_cut(replace(loaded, stuck_after=0.0))
    run(c, [0.21] * 1000)
    assert not c.fault


def test_a_source_that_stops_is_a_fault_after_the_time_of_the_heartbeat(loaded):
    c = worn_cut(loaded)
    n = loaded.samples(loaded.heartbeat)
    run(c, noisy(0.22, n - 1), beat=True)
    for beat in (False, True):
        run(c, noisy(0.22, n), beat=beat)
        assert not c.fault
    run(c, noisy(0.22, 1))
    assert (c.fault, c.news[0]) == (True, "no heartbeat")


def test_a_heartbeat_that_never_came_is_a_fault_once_the_spindle_runs(loaded):
    c = controllers.ConstantLoad(loaded, beat=False)
    run(c, noisy(0.05, 100), spindle_on=False)
    assert not c.fault
    run(c, noisy(0.05, 100), spindle_on=True)
    assert c.fault


def test_a_loss_to_the_load_in_air_never_raises_the_feed(loaded):
    """It cannot be distinguished from air: the feed stays at the last one."""
    c = worn_cut(loaded)
    last = c.command
    assert max(run(c, [0.1158] * 500)) == last
    assert c.state is State.AIR


def test_a_fault_is_latched_until_a_reset_that_finds_no_cause(loaded):
    c = worn_cut(loaded)
    run(c, [math.nan] * 50)
    run(c, [math.nan], reset=True)
    run(c, [math.nan], reset=False)
    assert c.fault
    run(c, noisy(0.22, 50))
    assert (c.fault, c.command) == (True, loaded.low)
    run(c, noisy(0.22, 1), reset=True)
    assert (c.fault, c.news[0]) == (False, "reset")
    assert c.command <= loaded.low + loaded.recover * loaded.sample_time  # goes on from the lower limit


def test_a_fault_stops_the_feed_where_that_is_chosen(loaded):
    c = worn_cut(replace(loaded, stop_on_fault=True))
    run(c, [math.nan] * 50)
    assert c.feed_inhibit


def test_an_overload_inhibits_the_feed_and_is_latched(loaded):
    c = worn_cut(loaded)
    run(c, noisy(1.04 * loaded.worn_load, 200))
    assert not c.overload
    high = run(c, noisy(1.2 * loaded.worn_load, loaded.samples(loaded.overload_after)))
    assert high[-1] == loaded.low
    run(c, noisy(1.2 * loaded.worn_load, loaded.samples(0.3)))  # and the mean of 0.1 s
    assert (c.overload, c.feed_inhibit, c.fault) == (True, True, False)
    run(c, noisy(0.1158, 100))
    assert c.feed_inhibit
    run(c, noisy(0.1158, 1), reset=True)
    assert not c.feed_inhibit


def test_the_feed_in_mm_per_min_stays_inside_its_limits_whatever_is_requested(loaded):
    c = worn_cut(loaded)
    last = c.command
    (command,) = run(c, noisy(0.22, 1), requested=2000.0)
    assert 2000.0 * command == pytest.approx(1000.0 * last, rel=0.02)
    assert run(c, noisy(0.22, 1), requested=0.0)[0] == pytest.approx(command, rel=0.02)  # at rest: the last factor
    assert run(c, noisy(0.22, 1), requested=100.0) == [1.0]
    assert not c.fault
    run(c, noisy(0.22, 1), requested=math.nan)
    assert (c.fault, c.news[0]) == (True, "feed unknown")


@pytest.mark.parametrize("state", ["fault", "overload"])
@pytest.mark.parametrize(("share", "expected"), [(1 / 25.4, 1.0), (0.5, 1.0), (2.0, 0.5)])
def test_in_a_fault_the_requested_feed_only_reduces_the_command(loaded, state, share, expected):
    """A requested feed in inch/s taken for mm/s seems 25.4 times too small; the feed would go to 100 %."""
    c = worn_cut(loaded)
    loads = [math.nan] * 200 if state == "fault" else noisy(1.2 * loaded.worn_load, loaded.samples(2.0))
    run(c, loads, requested=share * loaded.feed_programmed)
    assert (getattr(c, state), c.state) == (True, State.FAULT)
    assert c.command == pytest.approx(expected * loaded.low, rel=1e-12)


@pytest.mark.parametrize(("weight", "forward"), [(1.0, 0.0), (0.0, 0.0), (0.5, 0.0), (1.0, 0.5)])
def test_the_first_command_in_the_cut_follows_setpoint_weight_and_feed_forward(constant_load_file, weight, forward):
    """u = u_entry + weight p e + forward e / B + i e T; e: error at entry, B: slope of the load line."""
    law = {
        "quantity": "", "error": "additive", "residual_scale": "A", "n": 20, "df": 17, "unit": "A",
        "response": "I", "form": "load_line", "equation": "",
        "coefficients": {"A": 0.1158, "B": 1.2416e-4, "k1": 2.47e-4},
        "factors": [{"symbol": "fm", "quantity": "", "unit": "mm/min", "low": 500.0, "high": 1000.0},
                    {"symbol": "VB", "quantity": "", "unit": "mm", "low": 0.0, "high": 0.25}],
        "uncertainty": {"kind": "none", "reason": "given"}, "verdict": {"level": "usable inside the tested region"},
    }  # fmt: skip
    engagement = {**constant_load_file().load_line.engagement.model_dump(), "feed_forward": forward}
    pf = constant_load_file(laws={"I": law}, pi={"setpoint_weight": weight}, load_line={"engagement": engagement})
    loop = loop_settings(pf).loop
    loop = replace(loop, filter_time=0.0, back_off=1e9, recover=1e9)
    c = controllers.ConstantLoad(loop, running=True)
    load = 0.21
    first = run(c, [load] * loop.samples(loop.engage_after))[-1]
    e = loop.reference - load
    expected = loop.low + weight * loop.p * e + forward * e / (1.2416e-4 * 1000.0) + loop.i * e * loop.sample_time
    assert first == pytest.approx(min(expected, loop.high), rel=1e-12)


def test_the_sum_does_not_wind_up_at_a_limit(loaded):
    """A long load above the reference is forgotten as fast as a short one."""

    def recovery(loads):
        c = controllers.ConstantLoad(loaded, running=True)
        commands = run(c, [*noisy(0.25, loads), *noisy(0.2, 200, 1)])
        return commands[loads:]

    assert recovery(300) == pytest.approx(recovery(3000), abs=1e-4)


def test_switched_off_it_does_nothing(loaded):
    c = controllers.ConstantLoad(loaded, enabled=False)
    assert set(run(c, [0.3] * 300)) == {1.0}


def test_a_restart_in_the_cut_gives_the_lower_limit_until_it_is_armed(loaded):
    """It was the programmed feed: a worn tool bore more than it withstands until the loop closed."""
    c = controllers.ConstantLoad(loaded)
    armed = loaded.samples(loaded.arm_after)
    assert set(run(c, noisy(0.27, armed))) == {loaded.low}
    assert run(c, noisy(0.27, 400)) == pytest.approx([loaded.low] * 400)  # a load above the reference
    assert c.state in (State.CONTROL, State.WORN)


@pytest.mark.parametrize("dt", [0.001, 0.0, float("nan"), float("inf")])
def test_another_period_is_refused(loaded, dt):
    with pytest.raises(UsageError, match=r"made for 0\.02 s"):
        controllers.ConstantLoad(loaded).step(0.2, dt)


@pytest.mark.parametrize("average_of", ["measurement", "command"])
def test_a_moving_average_lags_by_half_its_length(constant_load_file, average_of):
    """Impulse response of the average alone, through a loop without integral."""
    loop = controllers.ConstantLoad.from_parameters(constant_load_file()).loop
    plain = replace(loop, filter_time=0.0, ki=0.0, kp=-1e-3, back_off=1e9, recover=1e9, engage_after=0.0)
    traces = []
    for n in (1, 5):
        c = controllers.ConstantLoad(replace(plain, average=n, average_of=average_of), running=True)
        run(c, [0.25] * 40)
        traces.append(run(c, [0.25 + 0.01 * (k == 10) for k in range(60)]))
    one, five = (np.array(t) - t[0] for t in traces)
    assert np.abs(one).max() > 1e-9
    assert five == pytest.approx(np.convolve(one, np.full(5, 0.2))[: len(one)], abs=1e-12)


def test_the_table_of_states_names_each_state_once_and_stands_in_the_documentation():
    assert [row.state for row in STATES] == list(State)
    page = (Path(__file__).parent.parent / "docs" / "explanation" / "controller.md").read_text("utf-8")
    for row in STATES:
        assert f"| {row.state.name.lower()} ({row.state}) | {row.condition} | {row.feed} | {row.time} |" in page


@pytest.mark.parametrize(
    ("form", "integration", "shift"),
    [("position", "backward", 0.0), ("position", "forward", 1.0), ("position", "trapezoidal", 0.5),
     ("incremental", "backward", 0.0)],
)  # fmt: skip
def test_every_form_of_pi_becomes_the_same_controller_in_position_form(constant_load_file, form, integration, shift):
    """Against the tuner's own transfer function: (b0 + b1 z^-1) / (1 - z^-1), b0 = kp + ki T of the backward rule."""
    from fitmodels.ident.pi.gains import PiGains

    pf = constant_load_file(pi={"form": form, "integration": integration, "filter_time": 0.0})
    loop = controllers.ConstantLoad.from_parameters(pf).loop
    num, den = PiGains(pf.pi.kp, pf.pi.ki, 0.02, form=form, integration=integration).transfer_function
    T = loop.sample_time
    assert num == pytest.approx(np.array([loop.kp + loop.ki * T, -loop.kp]))
    assert den == pytest.approx(np.array([1.0, -1.0]))
    assert loop.kp == pytest.approx(pf.pi.kp - shift * pf.pi.ki * T)


def test_the_incremental_sum_of_eq_16_without_its_ki_is_an_integral(constant_load_file):
    pf = constant_load_file(pi={"form": "incremental_sum", "kp": 160.0, "ki": 0.0})
    loop = controllers.ConstantLoad.from_parameters(pf).loop
    assert (loop.kp, loop.ki) == (0.0, 160.0 / 0.02)


@pytest.mark.parametrize(
    ("more", "words"),
    [({"pi": None}, "no PI gains"),
     ({"load_line": None}, "no reference load"),
     ({"pi": {"ki": 8.0e6}}, "not stable"),
     ({"pi": {"ki": -8000.0}}, "not stable"),
     ({"pi": {"specification": {"rise_time": 0.001}}}, "miss rise time"),
     ({"pi": {"unit_u": "V", "scaling_u": 1.0, "kp": 0.2, "ki": 5.0}}, "feed limits in"),
     ({"limits": {"feed_rate": {"low": 1100.0, "high": 2000.0, "unit": "mm/min"}}}, "feed limit")],
)  # fmt: skip
def test_what_cannot_run_is_refused_with_exit_code_5(constant_load_file, more, words):
    with pytest.raises(GateError, match=words) as error:
        controllers.ConstantLoad.from_parameters(constant_load_file(**more))
    assert error.value.exit_code == 5


def test_what_the_file_leaves_open_is_assumed_and_said(constant_load_file):
    found = loop_settings(constant_load_file(load_line={"engagement": None}))
    assert found.loop.back_off > found.loop.recover > 0
    assert 0 < found.loop.engage_at < found.loop.reference
    left_open = Engagement.model_fields.keys() - {"filter_corner", "idle", "feed_forward", "sample_time"}
    assert {words.split()[0] for words in found.assumed} == left_open | {"dwell"}


def test_a_lower_limit_of_the_gains_and_the_machine_narrows_the_range(constant_load_file):
    limits = {"feed_rate": {"low": 10.0, "high": 1200.0, "unit": "mm/min"}}
    pf = constant_load_file(pi={"low": 650.0, "high": 950.0}, limits=limits)
    loop = controllers.ConstantLoad.from_parameters(pf).loop
    assert (loop.feed_low, loop.feed_high, loop.high) == (650.0, 950.0, 0.95)


def test_feed_stays_above_zero_where_a_file_says_next_to_nothing(constant_load_file):
    exact = {"kind": "none", "reason": "given"}
    pf = constant_load_file(laws=None, load_line={"lower": {"value": 0.001, "wear": 0.2, "interval": exact}})
    assert controllers.ConstantLoad.from_parameters(pf).loop.low == 0.05


@pytest.mark.parametrize(("duration", "dt"), [(0, 0.02), (1, 0), (-1, 0.02), (1e9, 1e-9), (math.nan, 0.02)])
def test_a_replay_of_no_length_or_no_step_is_refused(controller, duration, dt, plant):
    with pytest.raises(UsageError, match="give both above zero"):
        controllers.replay(controller(), plant(), duration=duration, dt=dt)


def test_the_plant_is_the_difference_equation_of_the_file(constant_load_file, linear_cut):
    model = constant_load_file().dynamics
    rng = np.random.default_rng(3)
    u = rng.standard_normal(200)
    cut = linear_cut(b=model.b, a=model.a)
    ours = [cut.step(0.0, 0.02, rng), *(cut.step(value, 0.02, rng) for value in u[:-1])]  # each answers the one before
    assert ours == pytest.approx(model.simulate(u), abs=1e-12)


# ---- eq. 16 as it is worded


@pytest.fixture(scope="module", params=["CLM-2023", "CLM-2023-slot"])
def paper(request):
    return published(request.param)


def in_cut(pf, average=1, **more):
    """Its loop about to close at the upper limit, so that every further step in a cut is eq. 16."""
    loop = replace(loop_of(pf), average=average, engage_after=0.0, arm_after=0.0, **more)
    c = controllers.ConstantLoad(loop, enabled=False)
    c.step(0.1, loop.sample_time)
    assert c.command == loop.high
    c.enabled = True
    return c


def test_the_paper_s_gains_run_here_and_hal_has_no_component_for_them(paper):
    loop = controllers.ConstantLoad.from_parameters(paper).loop
    assert (loop.form, loop.kp, loop.ki * loop.sample_time) == ("incremental_sum", 160.0, pytest.approx(0.006))
    with pytest.raises(GateError, match="use the component"):
        rendered(paper, "hal", accept_verdict=True)


def test_it_is_equation_16_term_by_term(paper):
    """U = U0 + Kp e + Ki sum e, U0 the last control signal; mm/min, per sample."""
    c = in_cut(paper, back_off=1e9, recover=1e9)
    loads = 0.24 + 0.004 * np.sin(np.arange(200) / 7) + 0.001
    u, total, feeds = c.loop.feed_high, 0.0, []
    for load in loads:
        total += 0.24 - load
        u += 160.0 * (0.24 - load) + 0.006 * total
        feeds.append(u)
    assert max(feeds) < c.loop.feed_high
    assert min(feeds) > c.loop.feed_low
    ours = [c.step(load, 0.02) * c.loop.feed_programmed for load in loads]
    assert ours == pytest.approx(feeds, rel=1e-12)


def test_its_average_is_the_mean_of_the_last_ten_feeds(paper):
    loads = 0.24 + 0.01 * np.random.default_rng(2).random(150)
    plain, mean = ([c.step(load, 0.02) for load in loads] for c in (in_cut(paper), in_cut(paper, average=10)))
    filled = np.r_[np.full(9, controllers.ConstantLoad.from_parameters(paper).loop.high), plain]
    assert mean == pytest.approx(np.convolve(filled, np.full(10, 0.1), "valid"), abs=1e-12)


def test_it_is_the_tuner_s_own_controller_limits_and_average_included(paper):
    """ident simulates the same gains in code of its own; loads so far off that both limits hold at times."""
    from fitmodels.ident.pi.controller import PiController
    from fitmodels.ident.pi.gains import PiGains

    c = in_cut(paper, average=10, back_off=1e9, recover=1e9)
    loop = c.loop
    theirs = PiController(
        PiGains(160.0, 0.3, 0.02, "incremental_sum", average=10, average_of="command", low=loop.feed_low,
                high=loop.feed_high), last=loop.feed_high,
    )  # fmt: skip
    noise = 0.005 * np.random.default_rng(3).standard_normal(3000)
    loads = (0.24 + 0.03 * np.sin(np.arange(3000) / 60) + noise).tolist()
    ours = [c.step(load, 0.02) * loop.feed_programmed for load in loads]
    assert ours == pytest.approx([theirs.step(0.24, load) for load in loads], rel=1e-9)
    assert min(ours) == pytest.approx(loop.feed_low)
    assert max(ours) == pytest.approx(loop.feed_high)


@settings(deadline=None, max_examples=20)
@given(readings)
def test_whatever_it_reads_in_its_own_form_the_feed_stays_within_its_limits(readings):
    c = controllers.ConstantLoad(OWN, running=True)
    for reading in readings:
        assert c.loop.low <= c.step(reading, 0.02) <= c.loop.high


OWN = loop_of(published("CLM-2023-slot"))


def test_out_of_the_cut_it_keeps_its_last_feed(paper):
    c = in_cut(paper)
    run(c, noisy(0.25, 50))
    last = c.command
    assert set(run(c, noisy(0.1158, 500))) == {last}
    assert not c.cutting


def test_a_command_that_rests_on_its_limit_for_the_dwell_asks_for_another_tool(paper):
    news, c = [], in_cut(paper, average=10)
    for load in 0.27 + 0.002 * np.random.default_rng(4).standard_normal(700):
        c.step(load, 0.02)
        news.append(c.news)
    asked = [k for k, what in enumerate(news) if "change tool" in what]
    low = next(k for k, what in enumerate(news) if "at low" in what)
    assert len(asked) == 1
    assert asked[0] - low == pytest.approx(c.loop.dwell / 0.02, abs=60)  # the means of 0.2 s and 10 samples come later
    assert (c.worn, c.state) == (True, State.WORN)


@pytest.mark.parametrize(("rests", "asks"), [(170, False), (250, True)])
def test_a_rest_shorter_than_the_dwell_is_no_worn_tool_and_air_does_not_count(paper, rests, asks):
    c, rng = in_cut(paper), np.random.default_rng(5)

    def cut(load, samples):
        run(c, (load + 1e-4 * rng.standard_normal(samples)).tolist())

    cut(0.285, 150)  # to the lower limit, the mean too
    assert c._average < c.rest
    c._rested = 0
    cut(0.27, rests // 2)
    cut(0.1158, 500)
    cut(0.27, rests // 2)
    assert c.worn is asks
    c.worn, c._rested = False, 0
    cut(0.20, 40)
    cut(0.27, 20)
    assert not c.worn


REFUSED = {"dropout": "load lost", "not a number": "load lost", "infinite": "load lost", "stuck": "load stuck",
           "wrong sign": "load lost", "ten times stiffer": "load lost", "saturated": "load stuck"}  # fmt: skip


@pytest.mark.parametrize("fault", REFUSED)
@pytest.mark.parametrize("form", ["position", "eq. 16"])
def test_a_fault_in_the_loop_takes_the_feed_to_its_lower_limit_and_stays_until_reset(
    paper, controller, plant, form, fault
):
    own = form == "eq. 16"
    c = controllers.ConstantLoad.from_parameters(paper, running=True) if own else controller()
    mill = MillingCut.from_parameters(paper, noise=0.003) if own else plant(noise=0.002)
    fails = {**FAULTS, "saturated": saturated(0.19)}[fault]
    trace = controllers.replay(c, FaultyPlant(mill, fails, start=8.0, end=12.0), duration=20, dt=0.02)
    assert c.loop.low <= trace.command.min() <= trace.command.max() <= 1.0
    stiff = fault == "ten times stiffer" and not own  # a reading inside the range of this file
    cause = "overload" if stiff else REFUSED[fault]
    assert next(e.time for e in trace.events if e.what == cause and e.time >= 8) < 9.5
    assert np.abs(trace.command[trace.time > 10] - c.loop.low).max() < 1e-12
    assert c.overload if stiff else c.fault
