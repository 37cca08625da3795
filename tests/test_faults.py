"""A failed sensor, a wrong sign, a cut ten times stiffer: whatever the controller, the feed stays in bounds.

Every controller that reads a sensor meets every fault of `controllers.FAULTS`, for good and for a while.
"""

import numpy as np
import pytest
from fitmodels import controllers
from fitmodels.controllers.adaptive_force.plant import DriveAndCut
from fitmodels.controllers.loop import FAULTS, FaultyPlant, saturated
from fitmodels.controllers.roughness.plant import TurningForce
from fitmodels.controllers.sensor_check import CREEP, SensorCheck
from fitmodels.core.errors import GateError
from fitmodels.parameters.published import published
from hypothesis import given
from hypothesis import strategies as st

START = 8.0  # s: every loop has settled


def constant_load():
    pf = published("CLM-2023")
    c = controllers.ConstantLoad.from_parameters(pf, running=True)
    low, high = c.loop.low, c.loop.high
    return c, controllers.MillingCut.from_parameters(pf), c.loop.sample_time, (low, high)


def roughness():
    pf = published("SURF")
    c = controllers.ConstantRoughness.from_parameters(pf).approached()
    return c, TurningForce.from_parameters(pf), pf.roughness.sample_time, (0.0, 0.3)


def adaptive_force():
    pf = published("LYAP")
    c = controllers.AdaptiveForceControl.from_parameters(pf, depth=1.0, stuck_after=0.0)
    return (
        c,
        DriveAndCut.from_parameters(pf, depth=1.0),
        0.001,
        (pf.adaptive_force.low, pf.adaptive_force.high),
    )


LOOPS = {"constant load": constant_load, "roughness": roughness, "adaptive force": adaptive_force}


@pytest.fixture(params=LOOPS)
def loop(request):
    return LOOPS[request.param]()


@pytest.mark.parametrize("name", LOOPS)
def test_a_reading_may_be_a_number_of_numpys(name):
    commands = []
    for kind in (float, np.float64):
        controller, plant, dt, _ = LOOPS[name]()
        told = FaultyPlant(plant, lambda reading, _, kind=kind: kind(reading))
        commands.append(controllers.replay(controller, told, duration=0.5, dt=dt).command.tolist())
    assert commands[0] == commands[1]


@pytest.mark.parametrize("lasts", [float("inf"), 0.5])
@pytest.mark.parametrize("name", FAULTS)
def test_the_feed_stays_inside_its_limits_and_above_zero(loop, name, lasts):
    controller, plant, dt, (low, high) = loop
    faulty = FaultyPlant(plant, FAULTS[name], START, START + lasts)
    trace = controllers.replay(controller, faulty, duration=START + 4, dt=dt)
    feed = trace.command[trace.time > 2]  # a limiter may ramp from 0 first
    assert np.isfinite(trace.command).all()
    assert (feed > 0).all()
    assert feed.min() >= low - 1e-12
    assert feed.max() <= high + 1e-12


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("name", LOOPS)
def test_a_sensor_that_saturates_below_the_set_point_is_reported_and_leaves_the_feed_inside_its_limits(name, share):
    controller, plant, dt, (low, high) = LOOPS[name]()
    settled = controllers.replay(controller, plant, duration=START, dt=dt).measurement[-1]
    controller, plant, *_ = LOOPS[name]()
    faulty = FaultyPlant(plant, saturated(share * settled), START)
    trace = controllers.replay(controller, faulty, duration=START + 4, dt=dt)
    feed = trace.command[trace.time > 2]
    assert low - 1e-12 <= feed.min() <= feed.max() <= high + 1e-12
    assert feed.min() > 0
    assert any(event.time >= START - 2 * dt for event in trace.events), "nothing is told"


@pytest.mark.parametrize("name", ["not a number", "infinite", "wrong sign"])
def test_an_impossible_reading_is_reported_when_it_comes(loop, name):
    controller, plant, dt, _ = loop
    faulty = FaultyPlant(plant, FAULTS[name], START)
    trace = controllers.replay(controller, faulty, duration=START + 4, dt=dt)
    told = [event for event in trace.events if event.time >= START - 2 * dt]
    assert any("unknown" in event.what or event.what in ("air", "out of cut") for event in told), trace.events


@pytest.mark.parametrize("name", ["roughness", "adaptive force"])
def test_a_loop_stays_at_its_lower_limit_after_a_second_without_a_reading_until_reset(name):
    """As that of constant load: tests/test_constant_load.py."""
    controller, plant, dt, _ = LOOPS[name]()
    faulty = FaultyPlant(plant, FAULTS["not a number"], START, START + 1)
    trace = controllers.replay(controller, faulty, duration=START + 3, dt=dt)
    assert any(event.what == "force lost" and event.time > START for event in trace.events)
    assert trace.command[-1] == trace.command.min()
    controller.control.reset = True
    before = trace.measurement[(trace.time > START - 1) & (trace.time < START)].mean()
    again = controllers.replay(controller, plant, duration=8, dt=dt)
    assert again.measurement[-int(1 / dt) :].mean() == pytest.approx(before, rel=0.1)


# Whether a reading can be believed: its range, and a sensor that stands still while the feed moves


def states(readings, commands, **more):
    sensing = SensorCheck(**{"low": -1.0, "high": 10.0, "least_move": 0.02, **more})
    for reading, command in zip(readings, commands, strict=True):
        sensing.valid(reading, command)
        yield sensing.state


@pytest.mark.parametrize("reading", [float("nan"), float("inf"), -1.0, 10.0, 11.0])
def test_a_reading_outside_its_range_is_none(reading):
    assert list(states([0.2, reading, 0.3], [1.0] * 3)) == ["known", "unknown", "known"]


def test_a_fast_move_on_one_reading_is_a_stuck_sensor_until_the_reading_changes():
    commands = [1.0 + 0.002 * k for k in range(40)]
    seen = list(states([0.2] * 39 + [0.21], commands))
    assert seen[24] == "known"
    assert set(seen[26:39]) == {"stuck"}
    assert seen[39] == "known"


def test_a_slow_creep_on_one_reading_is_reported_in_the_end():
    step = 0.0002  # 0.005 in 25 samples: a quarter of the least move
    seen = list(states([0.2] * 2000, [1.0 + step * k for k in range(2000)]))
    assert seen.index("stuck") == pytest.approx(CREEP * 0.02 / step, abs=2)


def test_a_held_load_reads_the_same_for_ever_while_the_command_stands():
    assert set(states([0.24] * 5000, [0.8] * 5000)) == {"known"}


def test_a_coarse_sensor_that_changes_now_and_then_is_believed():
    readings = [0.24 + 0.01 * (k // 400 % 2) for k in range(4000)]
    assert set(states(readings, [1.0 - 0.0001 * k for k in range(4000)])) == {"known"}


@given(st.lists(st.floats(), max_size=60), st.floats(0, 1))
def test_what_is_believed_is_a_number_inside_the_range(readings, command):
    sensing = SensorCheck(low=-1.0, high=10.0, least_move=0.02)
    for reading in readings:
        if sensing.valid(reading, command):
            assert -1.0 < reading < 10.0


@pytest.mark.parametrize(
    ("paper", "section", "edit", "make"),
    [
        ("SURF", "roughness", {"force": 1200.0}, controllers.ConstantRoughness.from_parameters),
        (
            "LYAP",
            "adaptive_force",
            {"high": 650.0},
            lambda pf: controllers.AdaptiveForceControl.from_parameters(pf, 1.0),
        ),
        ("AC-2017", "limits", {"wear": None}, controllers.TurningRecursion.from_parameters),
        ("CLM-2023", "load_line", {"worn": 0.3}, controllers.ConstantLoad.from_parameters),
    ],
)
def test_no_controller_is_made_from_a_file_that_was_edited_without_a_new_checksum(paper, section, edit, make):
    """Roughness and recursion took it: they did not look at the checksum."""
    pf = published(paper)
    assert make(pf)
    edited = getattr(pf, section).model_copy(update=edit)
    with pytest.raises(GateError, match="content was changed after it was written"):
        make(pf.model_copy(update={section: edited}))
