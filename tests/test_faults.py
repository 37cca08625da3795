"""A failed sensor, a wrong sign, a cut ten times stiffer: whatever the controller, the feed stays in bounds.

Every controller that reads a sensor meets every fault of `controllers.FAULTS`, for good and for a while.
"""

import numpy as np
import pytest
from fitmodels import controllers
from fitmodels.controllers.adaptive_force.plant import DriveAndCut
from fitmodels.controllers.faults import FAULTS, FaultyPlant, saturated
from fitmodels.controllers.roughness.plant import TurningForce
from fitmodels.parameters.published import published

START = 8.0  # s: every loop has settled


def constant_load():
    pf = published("CLM-2023")
    c = controllers.ConstantLoad.from_parameters(pf, running=True)
    low, high = c.loop.low, c.loop.high
    return c, controllers.MillingCut.from_parameters(pf), c.loop.sample_time, (low, high)


def roughness():
    pf = published("SURF")
    c = controllers.ConstantRoughness.from_parameters(pf)
    return c, TurningForce.from_parameters(pf), pf.roughness.sample_time, (0.0, 0.3)


def adaptive_force():
    pf = published("LYAP")
    c = controllers.AdaptiveForceControl.from_parameters(pf, depth=1.0)
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
def test_a_sensor_that_saturates_below_the_set_point_is_told_and_leaves_the_feed_inside_its_limits(name, share):
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
def test_a_reading_that_cannot_be_is_told_when_it_comes(loop, name):
    controller, plant, dt, _ = loop
    faulty = FaultyPlant(plant, FAULTS[name], START)
    trace = controllers.replay(controller, faulty, duration=START + 4, dt=dt)
    told = [event for event in trace.events if event.time >= START - 2 * dt]
    assert any("unknown" in event.what or event.what in ("air", "out of cut") for event in told), trace.events


@pytest.mark.parametrize("name", ["roughness", "adaptive force"])
def test_a_loop_comes_back_after_a_second_without_a_reading(name):
    """That of constant load stays at its lower limit until reset: tests/test_constant_load.py."""
    controller, plant, dt, _ = LOOPS[name]()
    faulty = FaultyPlant(plant, FAULTS["not a number"], START, START + 1)
    trace = controllers.replay(controller, faulty, duration=START + 10, dt=dt)
    assert any(event.what.endswith("known") and event.time > START + 0.9 for event in trace.events)
    before = trace.measurement[(trace.time > START - 1) & (trace.time < START)].mean()
    assert trace.measurement[-int(1 / dt) :].mean() == pytest.approx(before, rel=0.1)
