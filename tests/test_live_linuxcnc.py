"""LinuxCNC as a source: with a module of the name ``hal`` in its place, and whole, with a wear that is hidden."""

import os
import sys
import time
from pathlib import Path

import pytest
from fitmodels.core.errors import DataError, UsageError
from fitmodels.live.samples import Notice, Sample
from fitmodels.live.sources import SourceOptions, open_source

sys.path.insert(0, str(Path(__file__).parent))

from linuxcnc_machine import lacking
from linuxcnc_watch import WINDOW, run_worn, wear_module, worn_file, worn_run

sys.path.remove(str(Path(__file__).parent))

HAL = """
import json, os, time
FILE = os.environ["FAKE_HAL"]

class error(Exception):
    pass

class component:
    def __init__(self, name):
        self.name = name

    def ready(self):
        pass

def get_value(name):
    values = json.load(open(FILE))
    if values.get("running", True):
        values["servo-thread.time"] = time.perf_counter_ns() % 100000
    if values.get("end"):
        os._exit(0)
    if name not in values:
        raise RuntimeError("no such pin")
    return values[name]
"""
PINS = {
    "drive.load": 1.8, "spindle.0.on": True, "spindle.0.speed-out-abs": 3000.0, "motion.feed-mm-per-minute": 300.0,
    "motion.motion-type": 2, "motion.current-vel": 5.0, "iocontrol.0.tool-number": 3, "servo-thread.time": 100,
}  # fmt: skip


class Machine:
    def __init__(self, folder, monkeypatch):
        (folder / "hal.py").write_text(HAL)
        self.file = folder / "pins.json"
        monkeypatch.setenv("FAKE_HAL", str(self.file))
        monkeypatch.setenv("PYTHONPATH", str(folder))
        self.set()

    def set(self, **changes):
        import json

        other = self.file.with_suffix(".new")
        other.write_text(json.dumps(PINS | {name.replace("_", "."): value for name, value in changes.items()}))
        other.replace(self.file)


@pytest.fixture
def machine(tmp_path, monkeypatch):
    return Machine(tmp_path, monkeypatch)


def options(**changes):
    known = {"loads": {"P": "kW"}, "map": {"P": "drive.load"}, "python": sys.executable}
    return SourceOptions(**{**known, **changes})


def until(source, wanted, seconds=8.0):
    end = time.monotonic() + seconds
    for item in source:
        if wanted(item):
            return item
        assert time.monotonic() < end, "it did not come"
    raise AssertionError("the source ended")


def a_sample(item):
    return isinstance(item, Sample)


def test_pins_are_read_with_speed_feed_state_and_tool(machine):
    with open_source("linuxcnc", options()) as source:
        connected = until(source, lambda item: isinstance(item, Notice))
        assert "P from 'drive.load'" in connected.text
        assert "fm: " not in connected.text  # no unit is assumed where LinuxCNC's own pins are read
        sample = until(source, a_sample)
        assert sample.loads == {"P": 1.8}
        assert {name: sample.conditions[name] for name in ("n", "fm")} == {"n": 3000.0, "fm": 300.0}
        assert (sample.state, sample.tool) == ("feed", "T3")
        assert abs(sample.time - time.time()) < 5.0


@pytest.mark.parametrize(
    ("changes", "state"),
    [({"motion.motion-type": 1}, "idle"), ({"motion.current-vel": 0.0}, "idle"), ({"spindle.0.on": False}, "off")],
)
def test_a_rapid_and_a_pause_are_no_feed(machine, changes, state):
    machine.set(**changes)
    with open_source("linuxcnc", options()) as source:
        assert until(source, a_sample).state == state


def test_a_realtime_thread_that_stands_still_is_lost_and_comes_back(machine):
    with open_source("linuxcnc", options()) as source:
        until(source, a_sample)
        machine.set(running=False)
        assert "realtime" in until(source, lambda item: getattr(item, "kind", "") == "lost").text
        machine.set()
        until(source, lambda item: getattr(item, "kind", "") == "connected")
        until(source, a_sample)


def test_a_machine_that_ends_is_lost_and_read_again(machine):
    with open_source("linuxcnc", options()) as source:
        until(source, a_sample)
        machine.set(end=True)
        until(source, lambda item: getattr(item, "kind", "") == "lost")
        machine.set()
        until(source, a_sample)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"map": {}}, UsageError, "no pin is named for a load"),
        ({"map": {"P": "drive.lod"}}, UsageError, "has no pin, signal or parameter drive.lod"),
        ({"python": "/nowhere/python3"}, DataError, "does not run"),
        ({"python": "/bin/true"}, DataError, "no reading"),
        ({"replay": 2.0}, UsageError, "recorded run"),
    ],
)
def test_what_cannot_be_read_is_refused_at_once(machine, changes, error, words):
    with pytest.raises(error, match=words):
        open_source("linuxcnc", options(**changes))


def test_a_python_without_linuxcnc_is_refused(tmp_path, monkeypatch):
    (tmp_path / "hal.py").write_text("raise ImportError('No module named hal')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(DataError, match="no LinuxCNC"):
        open_source("linuxcnc", options())


@pytest.mark.consumer
def test_watch_calls_the_tool_change_of_a_hidden_wear_in_the_whole_machine(tmp_path):
    """`benchmarks/live_linuxcnc.py` prints 50 such runs."""
    reason = lacking()
    if reason:
        pytest.fail(reason) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(reason)
    run, _ = worn_run(7, worn_file(tmp_path))
    found = run_worn(run, wear_module(tmp_path))
    assert WINDOW[0] <= found["wear"] <= WINDOW[1], found["printed"]
    assert "gauge reading" in found["printed"]
