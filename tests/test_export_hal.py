"""The HAL export does what `ConstantLoad` does, sample by sample: by an evaluator of its text, and in halrun.

Plant of the closed loop: eq. 18 of Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587) with unit gain, behind their
load line; in halrun from HAL's biquad, lowpass, sum2 and mux2, the same difference equation as `LinearCut` of
conftest.py.
"""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fitmodels import controllers
from fitmodels.controllers.constant_load_milling.states import STATES
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.exports.hal import hal_file
from fitmodels.controllers.gate import gated_control
from fitmodels.controllers.loop import Trace
from fitmodels.core.errors import GateError
from fitmodels.parameters.exports.loop import LoadLoop
from fitmodels.parameters.setting_words import window_note

sys.path.insert(0, str(Path(__file__).parent))

from hal_evaluator import Hal, HalError
from hal_sequences import (
    MACHINE,
    OUTPUTS,
    Halrun,
    first_difference,
    hal_answer,
    random_inputs,
    reference_answers,
    scattered_inputs,
    worn_inputs,
)

sys.path.remove(str(Path(__file__).parent))

SAMPLES = 2500
PRINTED = 1e-5  # halsampler prints six decimals: 5e-7 is what rounding leaves
INSTALL = "apt-get install linuxcnc-uspace"
B18, A18 = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
A, B, IDLE, PROGRAMMED = 0.1158, 1.2416e-4, 0.05, 1000.0  # A, A/(mm/min), A, mm/min
GAIN = B * PROGRAMMED / (sum(B18) / sum(A18))
SHORT = {
    "arm_after": 3,
    "engage_after": 4,
    "lost_after": 3,
    "stuck_after": 9,
    "heartbeat": 12,
    "overload_after": 5,
    "dwell": 40,
}  # samples


# Sample -> wear's share of the load: sharp, worn until the low limit, fresh until the high one; with a ripple, as equal
# readings are those of a stuck sensor.
def wear(k: int) -> float:
    ripple = 1e-5 * (37 * k % 11 - 5)
    return ripple + float(np.interp(k, [0, 800, 1100, 1400, 1700, 2000, 2200], [0.0, 0.0, 0.06, 0.06, -0.08, -0.08, 0]))


def cutting(k: int) -> bool:
    return 100 <= k < 2350


def hal_of(pf) -> str:
    return rendered(pf, "hal")


def loop_of(pf) -> LoadLoop:
    return gated_control(pf).loop


@pytest.fixture
def replayed(linear_cut):
    def run(pf, samples: int = SAMPLES, controller=None) -> Trace:
        dt = pf.pi.sample_time
        plant = linear_cut(
            b=[GAIN * b for b in B18], a=A18, offset=A, idle=IDLE,
            wear=lambda t: wear(round(t / dt)), cutting=lambda t: cutting(round(t / dt)),
        )  # fmt: skip
        controller = controller or controllers.ConstantLoad(loop_of(pf))
        return controllers.replay(controller, plant, duration=samples * dt, dt=dt, command=0.0)

    return run


@pytest.fixture
def short(constant_load_file):
    """HAL text and loop with times of a few samples and every part of the net in use: limits below 1, entry, stop."""
    control = gated_control(constant_load_file())

    def make(sample_time: float = 0.02, **settings) -> tuple[str, LoadLoop]:
        times = {name: samples * sample_time for name, samples in SHORT.items()}
        rates = {"ki": 160.0 / sample_time, "filter_time": 4 * sample_time, "back_off": 0.02 / sample_time,
                 "recover": 0.008 / sample_time}  # fmt: skip
        changes = {"feed_high": 950.0, "load_high": 1.0, "stop_on_fault": True, "entry_gain": 0.4, **settings}
        loop = replace(control.loop, sample_time=sample_time, **{**times, **rates, **changes})
        return hal_file(SimpleNamespace(view=control.view, loop=loop)), loop

    return make


class HalController:
    """HAL text under `controllers.replay`: switched on, the spindle running, the heartbeat toggling."""

    command = 0.0

    def __init__(self, text: str, period: float) -> None:
        self.hal = Hal(text, period)
        self.hal["fm-enable"] = self.hal["fm-spindle-on"] = True
        self.hal["fm-velocity"] = 10.0  # mm/s

    def step(self, measurement: float, dt: float) -> float:
        self.hal["fm-load"] = measurement
        self.hal["fm-heartbeat"] = not self.hal["fm-heartbeat"]
        self.hal.step()
        return self.hal["fm-feed"]


def test_the_text_evaluates_to_the_reference_sample_by_sample(short):
    """Loads about every threshold, NaN, infinite, out of range, stuck; switches, resets, a source that dies."""
    occurred = np.zeros((2, len(OUTPUTS)))
    for sample_time, seed in ((0.02, 1), (0.02, 2), (0.01, 3), (0.002, 4), (0.001, 5)):
        text, loop = short(sample_time)
        rows = list(random_inputs(loop, seed, 4000))
        hal = Hal(text, sample_time)
        ours = [hal_answer(hal, row) for row in rows]
        assert first_difference(ours, reference_answers(controllers.ConstantLoad(loop), rows), 1e-12) is None
        occurred += [np.sum(ours, axis=0), np.sum(~np.array(ours, dtype=bool), axis=0)]
    assert (occurred[0] > 50).all()
    assert (occurred[1, 1:] > 50).all()


@pytest.mark.parametrize("unmonitored", ["stuck_after", "heartbeat"])
def test_what_is_not_monitored_is_not_in_the_net(short, unmonitored):
    text, loop = short(**{unmonitored: 0.0}, stop_on_fault=False)
    assert ("fm.stuck" in text, "fm.alive" in text) == (bool(loop.stuck_after), bool(loop.heartbeat))
    rows = list(random_inputs(loop, 3, 4000))
    hal = Hal(text.replace("net fm-fault", "newsig fm-heartbeat bit\nnet fm-fault", 1 - bool(loop.heartbeat)))
    assert first_difference(
        [hal_answer(hal, row) for row in rows], reference_answers(controllers.ConstantLoad(loop), rows), 1e-12
    ) is None  # fmt: skip


def test_in_closed_loop_the_text_replays_as_the_reference(constant_load_file, replayed):
    pf = constant_load_file()
    text = hal_of(pf)
    ours, theirs = replayed(pf, controller=HalController(text, 0.001)), replayed(pf)
    assert np.abs(ours.command - theirs.command).max() < 1e-12


def test_the_replay_settles_meets_both_limits_and_keeps_its_feed_after_the_cut(constant_load_file, replayed):
    pf = constant_load_file(0.001)
    trace, loop = replayed(pf), loop_of(pf)
    assert np.abs(trace.measurement[600:800] - loop.reference).max() < 1e-4
    assert trace.command[:100] == pytest.approx([loop.low] * 100)
    assert trace.command[1350] == pytest.approx(loop.low, abs=1e-15)
    assert trace.command[1950] == pytest.approx(loop.high, abs=1e-15)
    assert (trace.command[2360:] == trace.command[2360]).all()
    assert trace.command[2360] <= trace.command[2340:2350].max()


def _by_meaning(hal: Hal, loop: LoadLoop) -> bool:
    """Values that a second limit hides in a trace, as each is a second line of defence to the other."""
    lower = {hal[f"fm.{pin}"] for pin in ("limit.min", "before.in1", "target.in1")}
    return lower == {loop.low} and hal["fm.limit.max"] == loop.high and hal["fm.before.in0"] == 1.0


def _changed(text: str) -> Iterator[tuple[str, str]]:
    """Each constant of a HAL text changed by 5 %, by one period, in one bit: description and text."""
    period = int(re.search(r"period1=(\d+)", text)[1]) * 1e-9
    for line in text.splitlines():
        words = line.split()
        if not words or (words[0] not in ("setp", "sets") and "period1" not in line):
            continue
        head, value = line.rsplit("=" if "period1" in line else " ", 1)
        for new in _other_values(head, value, period):
            changed = head + line[len(head)] + new
            yield changed, text.replace(line + "\n", changed + "\n", 1)


def _other_values(pin: str, value: str, period: float) -> list[str]:
    if value in ("TRUE", "FALSE"):
        return ["FALSE" if value == "TRUE" else "TRUE"]
    if value.startswith("0x"):
        bits = int(value, 0)
        return [hex(bits & bits - 1), hex(bits << 1)]  # the lowest case less, the cases of another input
    if pin.endswith(("delay", "width")):
        return [repr(float(value) + 2 * period)] + [repr(float(value) - period)] * (float(value) > period)
    if "period1" in pin:
        return [str(int(value) * 21 // 20), str(int(value) * 19 // 20)]
    if float(value) == 0:
        return ["1.0", "-2.0"]
    return [repr(float(value) * 1.05), repr(float(value) * 0.95)]


def test_every_changed_constant_is_seen(short):
    """Each constant of the text, changed by 5 % or by one period: the answers differ from the reference's."""
    text, loop = short()
    seeds = ((14, False), (18, True), (12, True), (12, False))
    sequences = [list(random_inputs(loop, seed, 2000, impatient=impatient)) for seed, impatient in seeds]
    sequences += [list(worn_inputs(loop)), list(scattered_inputs(loop))]
    expected = [reference_answers(controllers.ConstantLoad(loop), rows) for rows in sequences]

    def equal(changed: str) -> bool:
        hal = Hal(changed)
        if not _by_meaning(hal, loop):
            return False
        for rows, theirs in zip(sequences, expected, strict=True):
            for row, answer in zip(rows, theirs, strict=True):
                ours = hal_answer(hal, row)
                if abs(ours[0] - answer[0]) > 1e-9 or ours[1:] != answer[1:]:
                    return False
            hal = Hal(changed)
        return True

    changes = dict(_changed(text))
    assert len(changes) >= 30
    assert equal(text)
    assert [name for name, changed in changes.items() if equal(changed)] == []


@pytest.mark.parametrize("function", ["filter", "bias", "cut", "falling", "begun", "fault", "rested", "alive"])
def test_a_function_that_does_not_run_is_seen(short, function):
    text, loop = short()
    rows = [*worn_inputs(loop), *random_inputs(loop, 14, 2000)]
    hal = Hal(re.sub(rf"addf fm\.{function} .*", "", text))
    theirs = reference_answers(controllers.ConstantLoad(loop), rows)
    assert first_difference([hal_answer(hal, row) for row in rows], theirs, 1e-9) is not None


def test_it_is_off_until_it_is_switched_on(short):
    text, loop = short()
    hal = Hal(text)
    hal["fm-load"], hal["fm-spindle-on"] = 0.9 * loop.reference, True
    feeds = []
    for _ in range(100):
        hal.step()
        feeds.append(hal["fm-feed"])
    assert set(feeds) == {loop.high}  # from the first sample
    assert (hal["fm-enable"], hal["fm-armed"], hal["fm-fault"], hal["motion.feed-inhibit"]) == (False,) * 4


def test_the_head_states_every_state_the_settings_and_what_is_not_included(short):
    head = short()[0].split("\nloadrt")[0].replace("\n#  ", "")
    for row in STATES:
        assert f"# {row.state.name.lower()}: {row.condition}. Feed: {row.feed}. Time: {row.time}." in head
    for words in ("M52 P1", "M52 P0", ">>>", "lost_after 0.06 s", "overload 0.273 A", "a fault stops", "(kind comp)",
                  "motion.feed-inhibit is in use", "100 %"):  # fmt: skip
        assert words in head


def test_the_first_lines_state_safety_a_fault_and_the_limits_in_units_of_the_machine(short):
    """And directly below, what another F or an override above 100 % does."""
    head = short()[0].replace("\n#  ", "").splitlines()
    assert head[1].startswith("# No safety function in the sense of ISO 13849")
    assert "emergency stop" in head[1]
    assert head[2] == "# On a fault the feed stops: --on-fault stop was chosen."
    loop = short()[1]
    assert head[3].startswith(f"# Load {loop.reference:g} A; feed {loop.feed_low:.4g} to {loop.feed_high:.4g} mm/min")
    assert "another F, or an operator's override other than 100 %, moves the real feed" in head[4]


def test_the_head_names_the_data_their_corrections_and_the_tool_change(constant_load_file):
    options = {"correct": ["lines 9:I/1000"], "leave_out": ["lines 5"]}
    then = ["fitmodels ident 'new/drive.csv' --params a/params.json"]
    origin = {"fitmodels": "0.1.0", "data_file": "tests.csv", "options": options, "then": then}
    note = window_note(0.18, 0.22, "mm")
    pf = constant_load_file(provenance=origin, load_line={"notes": [note]}, identity={"machine": "VMC 3, LinuxCNC"})
    text = rendered(pf, "hal")
    for line in ("# Load limit of a worn tool 0.26 A, safety factor 0.85.",
                 "# data tests.csv, drive.csv", "# corrected lines 9:I/1000", "# left out lines 5",
                 "# Tool change at a wear of 0.18 to 0.22 mm, assumed."):  # fmt: skip
        assert line in text.splitlines()
    assert "machine VMC 3, LinuxCNC;" in text
    assert "its noise (equal readings for stuck_after are a fault)." in text.replace("\n# ", " ")
    assert "Assumed: window 0.18 to 0.22 mm, the wear at tool change" in text
    assert "to stop: fitmodels settings --on-fault stop." in text


def test_the_head_states_what_gains_meet_tested_ranges_and_a_record_outside_of_them(constant_load_file):
    gains = {"probability": 0.964, "specification": {"rise_time": 2.0, "settling_time": 4.0, "overshoot": 0.02}}
    pf = constant_load_file(pi=gains, dynamics={"operating_point": [0.1, 0.001]})
    for kind in ("hal", "st", "c", "comp"):
        text = re.sub(r"[\s#*()]+", " ", rendered(pf, kind))
        assert "Gains for rise time 2 s, settling time 4 s, overshoot 2 %, with probability 96 % over the" in text
        assert "The law of I was tested at fm 600 to 1000 mm/min, VB 0 to 0.2 mm." in text
        assert "the dynamics are those of a cut: The record of the dynamics was made about 0.001 A" in text
    stated = constant_load_file(dynamics={"operating_point": [0.1, 0.001], "notes": ["deviations from a cut"]})
    assert "those of a cut" not in rendered(stated, "hal")


def test_a_moving_average_and_the_other_form_are_refused_with_the_export_that_has_them(short):
    with pytest.raises(GateError, match=r"moving average of 2 samples.*kind comp"):
        short(average=2)
    with pytest.raises(GateError, match=r"incremental_sum.*kind comp"):
        short(form="incremental_sum")


BROKEN = [
    ("loadrt pid names=fm.pid\n", ""), ("net fm-cut fm.cut.out", "net fm-cut fm.cut.nowhere"),
    ("setp fm.pid.Pgain ", "setp fm.pid.Pgain x"), ("net fm-pid fm.pid.output", "net fm-feed fm.pid.output"),
    ("net fm-bias fm.bias.out", "net fm-cut fm.bias.out"), ("addf fm.limit ", "addf fm.limits "),
    ("net fm-worn fm.worn.out", "setp fm.bias.in0 1"), ("loadrt ddt", "loadrt pid names=x\nloadrt ddt"),
]  # fmt: skip


@pytest.mark.parametrize(("broken", "by"), BROKEN)
def test_a_broken_file_does_not_load_in_the_evaluator(short, broken, by):
    text, _ = short()
    assert broken in text
    with pytest.raises(HalError, match=r"^line \d+"):
        Hal(text.replace(broken, by))


@pytest.fixture
def halrun(consumer):
    run = Halrun(consumer("halrun", INSTALL))
    yield run
    run.close()


@pytest.mark.consumer
@pytest.mark.parametrize(("broken", "by"), BROKEN[2:7:2])
def test_a_broken_file_does_not_load_in_halrun(halrun, short, broken, by):
    said = halrun(MACHINE.format(period=1_000_000) + short(0.001)[0].replace(broken, by))
    assert said.returncode != 0


@pytest.mark.consumer
@pytest.mark.parametrize("seed", [1, 2])
def test_halrun_answers_as_the_evaluator_does(halrun, short, seed):
    """Random inputs with every fault, at the period of a servo thread and in a thread of its own."""
    sample_time, samples, thread = ((0.0005, 4000, "servo-thread"), (0.01, 200, "fm-thread"))[seed - 1]
    text, loop = short(sample_time)
    rows = [*worn_inputs(loop)] * (seed == 1) + [*random_inputs(loop, seed, samples, impatient=seed == 2)]
    hal = Hal(text, sample_time)
    ours = [hal_answer(hal, row) for row in rows]
    assert first_difference(ours, halrun.answers(text, rows, thread, sample_time), PRINTED) is None


def plant_in_hal(folder: Path, samples: int) -> str:
    """Eq. 18 as a biquad and a lowpass, the load line, the cut; its schedule comes through streamer."""
    pole = min(np.roots(A18), key=abs).real
    pair = np.polydiv(A18, [1.0, -pole])[0]
    n = [float(GAIN * b / (1 - pole)) for b in B18[1:]]
    (folder / "schedule").write_text(
        "".join(f"{A + wear(k)!r} {int(cutting(k))} 1 1 10.0 {k % 2}\n" for k in range(samples))
    )
    values = {
        "pair.n0": n[0], "pair.n1": n[1], "pair.n2": n[2], "pair.d1": float(pair[1]), "pair.d2": float(pair[2]),
        "pair.enable": "TRUE", "pole.gain": 1 - float(pole), "cut.in0": IDLE,
    }  # fmt: skip
    return f"""
loadrt biquad names=plant.pair
loadrt streamer depth=4000 cfg=fbbbfb
loadrt sampler depth=25000 cfg=ff
{"".join(f"setp plant.{pin} {value}" + chr(10) for pin, value in values.items())}
net fm-feed plant.pair.in
net p1 plant.pair.out plant.pole.in
net p2 plant.pole.out plant.line.in0
net p3 streamer.0.pin.0 plant.line.in1
net p4 streamer.0.pin.1 plant.cut.sel
net p5 plant.line.out plant.cut.in1
net fm-enable streamer.0.pin.2
net fm-spindle-on streamer.0.pin.3
net fm-velocity streamer.0.pin.4
net fm-heartbeat streamer.0.pin.5
net fm-load plant.cut.out sampler.0.pin.0
net fm-feed sampler.0.pin.1
addf streamer.0 servo-thread 1
addf plant.pair servo-thread 2
addf plant.pole servo-thread 3
addf plant.line servo-thread 4
addf plant.cut servo-thread 5
addf motion-command-handler servo-thread 1
addf motion-controller servo-thread
addf sampler.0 servo-thread
loadusr -w halstreamer {folder}/schedule
start
loadusr -w halsampler -t -n {samples} {folder}/trace
"""


@pytest.mark.consumer
def test_linuxcnc_runs_the_closed_loop_as_the_replay_does(halrun, constant_load_file, replayed):
    pf = constant_load_file(0.0005)
    text = hal_of(pf)
    for component, of_the_plant in (("lowpass", "pole"), ("sum2", "line"), ("mux2", "cut")):
        text = text.replace(f"loadrt {component} names=", f"loadrt {component} names=plant.{of_the_plant},")
    (halrun.folder / "fm.hal").write_text(text)
    machine = MACHINE.format(period=500_000) + f"source {halrun.folder}/fm.hal\n"
    said = halrun(machine + plant_in_hal(halrun.folder, SAMPLES))
    assert said.returncode == 0, said.stderr
    table, ours = np.loadtxt(halrun.folder / "trace"), replayed(pf)
    assert (np.diff(table[:, 0]) == 1).all()  # none lost
    assert np.abs(table[:, 1] - ours.measurement).max() < PRINTED
    assert np.abs(table[:, 2] - ours.command).max() < PRINTED


@pytest.mark.consumer
def test_without_the_load_pin_the_armed_loop_falls_to_the_lower_limit(halrun, constant_load_file):
    show = "show pin fm.limit.out\nshow pin fm.fault.out\nloadusr -w sleep 0.3\n"
    said = halrun(
        MACHINE.format(period=1_000_000) + hal_of(constant_load_file(0.001)) + "start\nloadusr -w sleep 0.1\n" + show
        + "sets fm-enable TRUE\nsets fm-spindle-on TRUE\nloadusr -w sleep 0.3\n" + show
    )  # fmt: skip
    assert re.findall(r"(?:OUT|I/O)\s+(\S+)\s+fm\.(?:limit|fault)\.out ", said.stdout) == ["1", "FALSE", "0.6", "TRUE"]
