"""The exports in the whole LinuxCNC, headless: a program cuts, the tool wears, faults are injected.

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

sys.path.insert(0, str(Path(__file__).parent))

from linuxcnc_faults import SCENARIOS, loops_and_runs
from linuxcnc_machine import lacking, plant_module, run_machine
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
