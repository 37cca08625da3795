"""The exports in the whole LinuxCNC, headless: a program cuts, the tool wears, faults are injected; a plan is turned.

Every period of the servo thread equals `ConstantLoad` on the same inputs, and each run ends as its scenario states.
``benchmarks/linuxcnc_faults.py`` runs the scenarios that are not chosen here.
"""

import os
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitmodels.controllers.exports.turning_job import Stretch, TurningJob
from fitmodels.controllers.exports.turning_program import TurningRequest, nc_program, turning_export
from fitmodels.controllers.recursion.plan import PlanOptions
from fitmodels.parameters.published import published

sys.path.insert(0, str(Path(__file__).parent))

from linuxcnc_faults import SCENARIOS, loops_and_runs
from linuxcnc_machine import lacking, plant_module, run_lathe, run_machine
from linuxcnc_outcomes import PRINTED, closed, faults_of, unequal

sys.path.remove(str(Path(__file__).parent))

AT_ONCE = 4  # a machine takes a fifth of a core
CHOSEN = {
    "hal": (
        "wear until the change", "lost in mid-cut, healed; reset during and after", "stuck below the reference",
        "loss to idle", "dead source", "spindle-on lost", "zero, wear 224 um",
        "end of the cut, then the end of the program", "operator's pause in the cut",
    ),
    "comp": (
        "wear until the change", "NaN, stop chosen", "overload: load 1.4 times", "F twice that of the file",
        "operator's override 120 %, load 0.85 times", "operator's pause in the cut",
    ),
}  # fmt: skip
CASES = [(kind, name) for kind, names in CHOSEN.items() for name in names]


@pytest.fixture(scope="module")
def machine_runs(tmp_path_factory):
    """Scenario, loop, run and the future trace of each case; all begin at once, ``AT_ONCE`` at a time."""
    reason = lacking()
    if reason:
        pytest.fail(reason) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(reason)
    folder = tmp_path_factory.mktemp("plant")
    plant = plant_module(folder)
    cases = {}
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for kind, names in CHOSEN.items():
            scenarios = [next(scenario for scenario in SCENARIOS if scenario.name == name) for name in names]
            loops, runs = loops_and_runs(scenarios, kind, folder)
            for scenario, loop, run in zip(scenarios, loops, runs, strict=True):
                trace: Future = pool.submit(run_machine, run, plant)
                cases[kind, scenario.name] = (scenario, loop, run, trace)
        yield cases


@pytest.mark.consumer
@pytest.mark.parametrize(("kind", "name"), CASES)
def test_the_machine_ends_each_fault_as_stated(machine_runs, kind, name):
    scenario, loop, _, trace = machine_runs[kind, name]
    assert faults_of(scenario, kind, trace.result(), loop) == []


@pytest.mark.consumer
@pytest.mark.parametrize("kind", CHOSEN)
def test_feed_current_and_tool_change_are_those_of_a_replay(machine_runs, kind):
    """In closed loop from .3 s after contact, whatever the phase of the drive's samples at contact."""
    _, loop, run, future = machine_runs[kind, "wear until the change"]
    trace = future.result()
    replay = closed(loop, trace, run)
    settled = slice(int(np.argmax(trace["cutting"] > 0)) + 150, None)
    for name, most in (("feed", 0.01), ("current", 1e-5)):  # mm/min of 600 to 1000, A of 0.24
        assert np.abs(trace[name] - replay[name])[settled].max() < most
    assert trace["worn"][-1]
    assert abs(int(np.argmax(trace["worn"] > 0)) - int(np.argmax(replay["worn"] > 0))) <= 10  # 20 ms


@pytest.mark.consumer
def test_a_changed_gain_is_seen_in_the_trace(machine_runs):
    scenario, loop, _, trace = machine_runs["hal", "loss to idle"]
    assert unequal(scenario, "hal", trace.result(), replace(loop, ki=1.01 * loop.ki)) > 10 * PRINTED


@pytest.fixture(scope="module")
def lathe_runs():
    """The moves and the future trace of a plan with rows of 3 s, by modes of speed and feed."""
    reason = lacking()
    if reason:
        pytest.fail(reason) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(reason)
    passes = ((Stretch(80.0, 24.0),), (Stretch(75.0, 24.0),))
    runs = {}
    with ThreadPoolExecutor(2) as pool:
        for speed, feed in (("G96", "G95"), ("G97", "G94")):
            job = TurningJob(passes, max_rpm=2500.0, parts=1, speed=speed, feed=feed)
            made = turning_export(published("AC-2017"), TurningRequest(PlanOptions(interval=0.05, time=0.6), job))
            runs[feed] = made.part, pool.submit(run_lathe, nc_program(made), 60.0)
        yield runs


@pytest.mark.consumer
@pytest.mark.parametrize("feed", ["G95", "G94"])
def test_the_machine_turns_at_the_speeds_and_feeds_of_the_plan(lathe_runs, feed):
    """Spindle within 0.1 %, feed within 0.2 % of the plan, but for .4 mm after each change, in which both move."""
    part, future = lathe_runs[feed]
    trace, start = future.result(), 0.0
    for move in part.moves:
        start = 0.0 if start < move.Z else start
        here = (np.abs(trace["x"] - move.X / 2) < 1e-3) & (trace["z"] < start - 0.4) & (trace["z"] > move.Z + 0.2)
        start = move.Z
        here &= trace["velocity"] < 20.0  # mm/s: not the rapid back
        assert here.sum() > 50
        assert np.abs(60.0 * trace["commanded"][here] / move.n - 1).max() < 1e-3
        expected = move.feed(part.job) * move.n / 60.0
        assert np.abs(trace["velocity"][here] / expected - 1).max() < 2e-3


@pytest.mark.consumer
@pytest.mark.parametrize("feed", ["G95", "G94"])
def test_no_chip_is_thicker_than_planned_while_the_spindle_changes_its_speed(lathe_runs, feed):
    part, future = lathe_runs[feed]
    trace = future.result()
    thickest = max(move.f for move in part.moves)
    cut = (trace["z"] < 0.0) & np.isin(np.round(trace["x"], 3), [move.X / 2 for move in part.moves])
    cut &= trace["velocity"] < 20.0
    assert cut.sum() > 2000
    assert (trace["velocity"][cut] / trace["spindle"][cut]).max() < thickest * 1.002
