"""Control by consent: nothing is written before consent, the exported controller, and a trip of its heartbeat.

The controller is the HAL export in the evaluator of `hal_evaluator`, one period at a time, behind the program's own
`Beat` and `Writer`.
"""

import math
import os
import re
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from fitmodels import parameters
from fitmodels.core.errors import GateError, UsageError
from fitmodels.live.control import ControlOutlet, ControlSession, open_control
from fitmodels.live.controller import (
    CHANGED,
    READINGS,
    STATUS,
    consent_words,
    controller_of,
    differences,
    require_consent,
    write_order,
)
from fitmodels.live.linuxcnc_control import Beat, HalLink, Refused, Runner, Writer, connect

sys.path.insert(0, str(Path(__file__).parent))

from hal_evaluator import Hal
from linuxcnc_faults import exported, machine_file
from linuxcnc_machine import PERIOD as CYCLE
from linuxcnc_machine import lacking, plant_module
from linuxcnc_watch import control_figures, control_run, run_beside, worn_file

sys.path.remove(str(Path(__file__).parent))

PERIOD = 0.02  # s, of the loop in these tests
AIR, CUT = 0.11584, 0.2  # A


class Machine:
    """The HAL export, its program and a clock; a link for `ControlSession`."""

    def __init__(self, controller, text):
        self.controller, self.hal = controller, Hal(text, PERIOD)
        self.beat = Beat(0.5, controller.heartbeat)
        self.writer = Writer(self, controller.limits())
        self.now, self.load, self.mute, self.stopped, self.written, self.said = 0.0, AIR, False, False, {}, []
        self.hal["fm-enable"], self.hal["fm-spindle-on"] = True, True
        self.last = None

    def set_p(self, pin, value):
        self.written[pin] = float(value)
        self.hal.cells[self.hal.pins[pin].cell] = float(value)

    def values(self):
        return self.last

    def problem(self):
        return ""

    def send(self, beat, pins):
        if not self.stopped:
            self.beat.command(self.now, beat)
            self.writer.write(pins)

    def close(self):
        self.stopped = True
        self.beat.command(self.now, False)

    def run(self, seconds, session=None):
        """Periods of the controller; the program beats in each second one, the session is stepped in each third."""
        for k in range(round(seconds / PERIOD)):
            self.now += PERIOD
            self.hal["fm-load"] = self.load + 1e-4 * (k % 3)
            self.hal["fm-velocity"] = 10.0 + 0.1 * (self.load > AIR)
            if k % 2 == 0 and not self.mute:
                self.hal["fm-heartbeat"] = self.beat.step(self.now, False)
            self.hal.step()
            names = (*STATUS, *READINGS, *self.controller.settings)
            self.last = (self.now, {name: self.hal[name] for name in names})
            if session and k % 3 == 0:
                self.said += session.step(self.now)

    def reset(self, session=None):
        self.hal["fm-reset"] = True
        self.run(0.1, session)
        self.hal["fm-reset"] = False


@pytest.fixture(scope="module")
def export():
    pf = machine_file(sample_time=PERIOD)
    return controller_of(pf), exported(pf, "hal", Path())[0]


@pytest.fixture
def machine(export):
    return Machine(*export)


def proved(machine):
    session = ControlSession(machine.controller, machine)
    machine.run(0.5, session)
    machine.reset(session)
    machine.run(2.0, session)
    assert session.phase == "latched"
    machine.reset(session)
    machine.run(0.2, session)
    return session


def test_nothing_is_written_before_trip_latch_and_reset(machine):
    session = ControlSession(machine.controller, machine)
    session.request(reference=0.2)
    machine.run(0.5, session)
    machine.reset(session)
    machine.run(2.5, session)
    assert session.phase == "latched"
    assert machine.hal["fm-fault"]
    assert machine.hal["fm-feed"] == pytest.approx(machine.controller.loop.low)
    assert session.trip == pytest.approx(machine.controller.heartbeat, abs=0.06)  # a beat, and a step of the session
    assert machine.written == {}
    machine.reset(session)
    machine.run(0.3, session)
    assert session.phase == "writing"
    assert machine.written["fm.pid.command"] == 0.2
    assert any("tripped" in text for text in machine.said)


def test_a_written_controller_is_that_of_a_file_with_these_settings(machine):
    """Reference and upper limit as `settings_of` gives them for such a loop; everything else stays."""
    from dataclasses import replace

    from fitmodels.controllers.exports.hal import settings_of

    session = proved(machine)
    session.request(reference=0.2, high=800.0)
    machine.run(0.3, session)
    changed = settings_of(replace(machine.controller.loop, reference=0.2, feed_high=800.0))
    for pin, value in changed:
        seen = machine.hal[f"fm.{pin}"]
        if pin != "above-rest.max":  # the threshold of worn depends on the range by a thousandth, and stays
            wanted = value == "TRUE" if value in ("TRUE", "FALSE") else float.fromhex(value) if "0x" in value else value
            assert float(seen) == pytest.approx(float(wanted), rel=1e-9), pin
    assert set(machine.written) == set(CHANGED)


@pytest.mark.parametrize(("asked", "taken"), [(9.0, 0.24), (-1.0, 0.177), (0.22, 0.22)])
def test_requests_stay_in_the_range_of_the_controller(machine, asked, taken):
    session = proved(machine)
    words = session.request(reference=asked)
    machine.run(0.2, session)
    assert machine.hal["fm.pid.command"] == pytest.approx(taken, abs=1e-3)
    assert ("asked for" in words) == (asked != taken)
    with pytest.raises(UsageError, match="no number"):
        session.request(high=math.nan)


def test_the_upper_limit_waits_for_the_end_of_the_cut_and_the_reference_does_not(machine):
    session = proved(machine)
    machine.load = CUT
    machine.run(0.5, session)
    assert machine.hal["fm-cut"]
    session.request(reference=0.2, high=700.0)
    machine.run(0.3, session)
    assert machine.hal["fm.pid.command"] == 0.2
    assert machine.hal["fm.limit.max"] == 1.0
    machine.load = AIR
    machine.run(1.0, session)
    assert machine.hal["fm.limit.max"] == pytest.approx(0.7)


def test_the_load_is_held_at_the_written_reference(machine):
    session = proved(machine)
    session.request(reference=0.2)
    for _ in range(400):
        machine.load = 0.13 + 0.09 * machine.hal["fm-feed"]  # reaches 0.2 at an override of 0.78
        machine.run(PERIOD, session)
    assert machine.hal["fm-filtered"] == pytest.approx(0.2, rel=0.01)


def test_death_in_mid_cut_ends_in_the_safe_state(machine):
    session = proved(machine)
    machine.load = CUT
    machine.run(2.0, session)
    assert machine.hal["fm-cut"]
    machine.run(0.5 + machine.controller.heartbeat + 1.0)  # no step any more: hung or dead
    assert machine.hal["fm-fault"]
    assert machine.hal["fm-feed"] == pytest.approx(machine.controller.loop.low)
    machine.run(1.0, session)
    assert session.phase == "suspended"
    machine.reset(session)
    machine.run(0.2, session)
    assert session.phase == "writing"


def test_a_controller_that_does_not_trip_is_refused(machine):
    session = ControlSession(machine.controller, machine)
    machine.run(0.5, session)
    machine.hal.cells[machine.hal.pins["fm.cause.function"].cell] = 0
    machine.reset(session)
    machine.run(3.0, session)
    assert session.phase == "refused"
    assert "did not trip" in session.text
    assert machine.written == {}


def test_a_cut_that_begins_before_the_trip_is_waited_for(machine):
    session = ControlSession(machine.controller, machine)
    machine.run(0.5, session)
    machine.reset(session)
    while session.phase != "tripping":
        machine.run(PERIOD, session)
    machine.last = (machine.now, {**machine.last[1], "fm-cut": True})
    session.step(machine.now)
    assert not machine.last[1]["fm-fault"]
    assert session.phase == "waiting"
    assert "a cut, another fault" in session.text


def test_a_fault_of_another_cause_is_no_trip(machine):
    session = ControlSession(machine.controller, machine)
    machine.run(0.5, session)
    machine.reset(session)
    while session.phase != "tripping":
        machine.run(PERIOD, session)
    machine.load = math.nan
    machine.run(0.15, session)
    assert machine.hal["fm-fault"]
    assert session.phase == "waiting"
    assert math.isnan(session.trip)
    assert machine.written == {}


def test_a_fault_that_does_not_latch_is_refused(machine):
    session = ControlSession(machine.controller, machine)
    machine.run(0.5, session)
    for _ in range(100):
        machine.reset(session)
        machine.run(0.1, session)
    assert session.phase == "refused"
    assert "latched" in session.text
    assert machine.written == {}


@pytest.mark.parametrize("pin", ["fm.pid.Pgain", "fm.alive.width", "fm.limit.min", "fm.limit.max", "fm.cause.function"])
def test_another_controller_is_refused(machine, pin):
    machine.hal.cells[machine.hal.pins[pin].cell] *= 2
    session = ControlSession(machine.controller, machine)
    machine.run(0.2, session)
    assert session.phase == "refused"
    assert pin in session.text


@pytest.mark.parametrize("high", [700.0, 1000.0])
def test_an_interrupted_write_leaves_the_lower_limit_in_reach(export, high):
    """After each value of a write, the range of the PI reaches the lower limit and not beyond the upper one."""
    controller = export[0]
    loop = controller.loop
    state = controller.pins(0.24, 1700.0 - high)
    for pin in write_order(wanted := controller.pins(0.2, high), state):
        state[pin] = wanted[pin]
        middle, half = state["fm.centre.offset"], state["fm.pid.maxoutput"]
        assert middle - half <= loop.low + 1e-12
        assert middle + half <= loop.high + 1e-12
        assert state["fm.entry.offset"] + middle <= 1e-12  # no rise at entry, as the gain there is 0
    assert state == wanted


def test_a_feed_limit_that_was_written_in_part_is_refused(machine):
    machine.hal.cells[machine.hal.pins["fm.limit.max"].cell] = 0.8
    session = ControlSession(machine.controller, machine)
    machine.run(0.2, session)
    assert session.phase == "refused"
    assert "in part" in session.text


def test_missing_pins_and_nan_are_refused(export, machine):
    machine.run(0.1)
    values = machine.last[1]
    assert differences(export[0], values) == []
    assert "HAL has no fm.pid.Igain" in differences(export[0], {k: v for k, v in values.items() if "Igain" not in k})[0]
    assert "fm.pid.command is nan" in differences(export[0], {**values, "fm.pid.command": math.nan})[0]


@pytest.mark.parametrize("reference", [220.0, -0.2, math.nan, 0.0])
def test_a_reference_out_of_range_is_refused(export, monkeypatch, reference):
    monkeypatch.setattr("fitmodels.live.control.controller_of", lambda pf: export[0])
    with pytest.raises(UsageError, match="the range of the file"):
        open_control(None, consent_words(export[0]), reference, sys.executable)


def test_a_value_that_another_changes_ends_writing(machine):
    session = proved(machine)
    machine.hal.cells[machine.hal.pins["fm.pid.command"].cell] = 0.23
    machine.run(2.0, session)
    assert session.phase == "refused"
    assert "fm.pid.command is 0.23, but 0.24 before" in session.text


def test_values_that_stop_coming_end_the_session(machine):
    session = proved(machine)
    assert "no values" in session.step(machine.now + 5.0)[0]
    assert session.phase == "lost"
    assert machine.stopped


def test_consent_repeats_the_range(export):
    words = consent_words(export[0])
    require_consent(export[0], f"  {words.upper()} ")
    for given in ("", "yes", words.replace("1000", "2000")):
        with pytest.raises(UsageError, match="needs consent"):
            require_consent(export[0], given)


@pytest.mark.parametrize(
    ("changes", "words"), [({"heartbeat": 0.0}, "no heartbeat"), ({"form": "incremental_sum"}, "the HAL export")]
)
def test_files_without_such_a_controller_are_refused(changes, words, monkeypatch, export):
    from dataclasses import replace

    loop = replace(export[0].loop, **changes)
    monkeypatch.setattr("fitmodels.controllers.constant_load_milling.control_laws.loop_of", lambda pf: loop)
    with pytest.raises(GateError, match=words):
        controller_of(None)


def test_a_writer_refuses_what_is_outside_of_its_limits(machine):
    for value in (math.nan, math.inf, 0.3, 0.0, "0.2", True, None):
        with pytest.raises(ValueError, match="nothing was written"):
            machine.writer.write({"fm.limit.max": 0.8, "fm.pid.command": value})
    with pytest.raises(ValueError, match="nothing was written"):
        machine.writer.write({"fm.limit.min": 0.5})
    assert machine.written == {}


def test_the_heartbeat_follows_that_of_the_load():
    beat = Beat(0.5, 0.2, follows=True)
    values = []
    for k in range(40):
        beat.command(0.05 * k, True)
        values.append(beat.step(0.05 * k, k % 2 == 1 and k < 20))
    assert len(set(values[5:15])) == 2
    assert len(set(values[25:])) == 1


class FakeHal:
    """Signals with their writers, as ``hal`` of LinuxCNC has them."""

    HAL_BIT, HAL_IN, HAL_OUT = 1, 2, 3
    error = OSError

    def __init__(self, **signals):
        self.signals = {name.replace("_", "-"): driver for name, driver in signals.items()}
        self.links = {}

    def component(self, name):
        return SimpleNamespace(newpin=lambda *of: None, ready=lambda: None)

    def get_info_signals(self):
        return [{"NAME": name, "DRIVER": driver} for name, driver in self.signals.items()]

    def disconnect(self, pin):
        self.signals = {name: None if driver == pin else driver for name, driver in self.signals.items()}

    def connect(self, pin, signal):
        assert not (pin.endswith(".heartbeat") and self.signals[signal])
        self.links[pin.rpartition(".")[2]] = signal


@pytest.mark.parametrize(
    ("signals", "links"),
    [
        ({"fm_heartbeat": None}, {"heartbeat": "fm-heartbeat"}),
        ({"fm_heartbeat": "fitmodels-watch-4194999.heartbeat"}, {"heartbeat": "fm-heartbeat"}),  # no such process
        (
            {"fm_heartbeat": None, "fm_source_heartbeat": "drive.beat"},
            {"heartbeat": "fm-heartbeat", "source-heartbeat": "fm-source-heartbeat"},
        ),
        ({"fm_heartbeat": None, "fm_source_heartbeat": None}, {"heartbeat": "fm-heartbeat"}),
    ],
)
def test_the_heartbeat_is_connected(signals, links):
    hal = FakeHal(**signals)
    assert connect(hal)[1] == ("source-heartbeat" in links)
    assert hal.links == links


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        ({}, "HAL has no signal fm-heartbeat"),
        ({"fm_heartbeat": "drive.beat"}, "is written by drive.beat"),
        ({"fm_heartbeat": f"fitmodels-watch-{os.getpid()}.heartbeat"}, "is written by fitmodels-watch"),
    ],
)
def test_a_heartbeat_of_another_is_left_alone(signals, words):
    hal = FakeHal(**signals)
    with pytest.raises(Refused, match=words):
        connect(hal)
    assert hal.links == {}


def test_a_python_without_linuxcnc_is_said(tmp_path):
    for python, words in ((sys.executable, "no LinuxCNC"), (str(tmp_path / "none"), "does not run")):
        link = HalLink(["fm-fault"], {}, 0.2, python)
        until = time.monotonic() + 5.0
        while not link.problem() and time.monotonic() < until:
            time.sleep(0.02)
        assert words in link.problem()
        link.close()


def test_a_main_loop_that_hangs_is_no_sign_of_life(monkeypatch):
    monkeypatch.setattr("fitmodels.live.linuxcnc_control.STALL", 0.3)
    steps = []

    class Counted:
        def step(self, now):
            steps.append(now)
            return ("step",)

        def close(self):
            steps.append(None)

    def steps_until(count):
        end = time.monotonic() + 5.0
        while len(steps) < count and time.monotonic() < end:
            assert set(runner.take()) <= {"step"}
            time.sleep(0.02)

    runner = Runner(Counted())
    steps_until(2)
    time.sleep(0.6)  # it hangs
    hung = len(steps)
    time.sleep(0.3)
    assert 2 <= len(steps) == hung
    steps_until(hung + 2)
    assert len(steps) >= hung + 2
    runner.close()
    assert steps[-1] is None


@pytest.mark.parametrize("pin", [*STATUS, *CHANGED])
def test_a_pin_that_goes_ends_the_session_as_lost(machine, pin):
    session = proved(machine)
    when, values = machine.last
    machine.last = when, {name: value for name, value in values.items() if name != pin}
    assert session.step(machine.now) == (f"HAL no longer gives {pin}. Nothing more is written; start again to write.",)
    assert session.phase == "lost"
    assert machine.stopped


def test_an_error_of_a_step_ends_the_session_and_is_said(machine, monkeypatch):
    session = proved(machine)
    monkeypatch.setattr(machine, "values", lambda: (time.monotonic(), machine.last[1]))

    def wrong(beat, pins):
        raise RuntimeError("a fault of the program")

    monkeypatch.setattr(machine, "send", wrong)
    runner, said, end = Runner(session), [], time.monotonic() + 5.0
    while session.phase != "lost" and time.monotonic() < end:
        said += runner.take()
        time.sleep(0.02)
    runner.close()
    assert session.facts()["phase"] == "lost"
    assert machine.stopped
    assert "RuntimeError: a fault of the program. Nothing more is written" in [*said, *runner.take()][-1]


def test_the_feed_limit_follows_the_highest_feed_that_is_advised(machine):
    session = proved(machine)

    class Stepped:
        def take(self):
            return ("text",)

    class Watch:
        now, monitor, records = SimpleNamespace(control={}), SimpleNamespace(time=1.0), []

        def record(self, kind, **facts):
            self.records.append((kind, facts["text"]))

    stepped, watch = Stepped(), Watch()
    stepped.session = session
    outlet = ControlOutlet(stepped, watch)
    advice = [{"kind": "go on"}, {"kind": "feed", "settings": {"f": 0.1}}, {"kind": "speed", "settings": {"V": 90.0}}]
    outlet.show({"conditions": {"n": 8000.0}, "advice": advice})
    assert watch.now.control["feed_limit"]["wanted"] == pytest.approx(800.0)
    outlet.show({"conditions": {}, "advice": advice[:1]})
    assert watch.now.control["feed_limit"]["wanted"] == pytest.approx(800.0)
    session.close()
    outlet.show({"conditions": {}, "advice": []})
    assert [kind for kind, _ in watch.records] == ["notice", "notice", "notice", "alarm"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with worn.json, whose laws `watch` needs, and control.json, of the exported controller."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "worn.json").write_text(worn_file(folder))
    parameters.write(machine_file(), folder / "control.json")
    return folder


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--write", "--from", "run.csv"], "has no controller whose heartbeat can be seen to trip"),
        (["--write", "--from", "linuxcnc"], "no settings of milling at constant load|has no"),
        (["--write", "--from", "linuxcnc", "--controller", "control.json"], '--consent "write reference 0.177 to'),
        (["--write", "--from", "linuxcnc", "--controller", "control.json", "--consent", "yes"], "given was .yes."),
        (["--from", "linuxcnc", "--consent", "yes"], "--consent goes with --write"),
        (["--from", "linuxcnc", "--reference", "0.2A"], "--reference goes with --write"),
    ],
)  # fmt: skip
def test_the_command_refuses_to_write_and_says_why(files, monkeypatch, capsys, words, said):
    from fitmodels.cli import main

    monkeypatch.chdir(files)
    monkeypatch.setenv("COLUMNS", "300")
    assert main(["watch", "worn.json", "--criterion", "0.2mm", *words]) in (2, 3, 5)
    assert re.search(said, capsys.readouterr().err)


HEARTBEAT, DEADLINE = 0.2, 0.5  # s


def _held_run(folder, signal, plant):
    """Trace and output of a run; repeated where the program got no processor for longer than the heartbeat.

    The fault before the signal is then right: the trace shows that the heartbeat did not change.
    """
    for attempt in range(4):
        (place := folder / f"{signal}-{attempt}").mkdir()
        trace, printed = run_beside(*control_run(place, signal), plant)
        found = control_figures(trace)
        if not (found["early"] and found["still"] >= HEARTBEAT):
            break
    return trace, printed


@pytest.mark.consumer
def test_the_whole_machine_holds_the_written_reference_and_death_ends_in_the_safe_state(tmp_path):
    """Killed, the program's end is seen within the heartbeat; stopped (SIGSTOP), within the deadline more."""
    reason = lacking()
    if reason:
        pytest.fail(reason) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(reason)
    plant, loop = plant_module(tmp_path), controller_of(machine_file()).loop
    signals = {"KILL": 0.0, "STOP": DEADLINE}
    with ThreadPoolExecutor(2) as pool:
        runs = [pool.submit(_held_run, tmp_path, signal, plant) for signal in signals]
    for (signal, later), done in zip(signals.items(), runs, strict=True):
        trace, printed = done.result()
        printed = " ".join(printed.split())
        assert "proved: tripped" in printed, printed
        assert "written: reference 0.22 A" in printed
        found = control_figures(trace)
        assert not found["early"], found
        assert found["load"] == pytest.approx(1.0, rel=0.01)
        assert found["beat"] == pytest.approx(HEARTBEAT, abs=2 * CYCLE), signal
        assert found["fault"] < HEARTBEAT + later + 0.3, signal  # .3: the program gets no processor
        assert found["latched"]
        assert found["u"] == pytest.approx(loop.low)
        assert found["feed"] == pytest.approx(loop.feed_low, rel=1e-3)
