"""Fault table of the HAL export in closed loop: by the evaluator in plain pytest, by halrun on the same readings.

A worn tool cuts at the reference (plant of `test_export_hal.py`); the fault begins; a reset is tried while it is there;
it ends; a reset clears it. Times are in samples, which the file of conftest.py scales with its sample time.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from fitmodels.controllers import ConstantLoad
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.gate import gated_control
from fitmodels.parameters.exports.loop import LoadLoop

sys.path.insert(0, str(Path(__file__).parent))

from hal_evaluator import Hal
from hal_sequences import OUTPUTS, Answer, Halrun, Row, first_difference, hal_answer, reference_answer

sys.path.remove(str(Path(__file__).parent))

T = 0.0002  # s
PRINTED = 1e-5
B18, A18 = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
A, B, IDLE = 0.1158, 0.12416, 0.05  # A, A at the programmed feed, A
WEAR = 0.22 - A - 0.75 * B  # A, of a tool that the reference holds at 75 % of the programmed feed
ARMED, ENGAGED, CUT, FAULT, OVERLOAD, WORN, INHIBIT = range(1, len(OUTPUTS))
START, HELD, HEALED = 250, 200, 150  # samples


@dataclass(frozen=True)
class Fault:
    """A fault: reading of a true load k samples after its begin, other inputs, factor on the feed, and its length."""

    reading: Callable[[float, int], float] = lambda load, k: load
    inputs: Row = field(default_factory=dict)
    factor: float = 1.0
    held: int = HELD


def _is(value: float) -> Fault:
    return Fault(lambda load, k: value)


LOST = {
    "not a number": _is(math.nan), "infinite": _is(math.inf), "minus infinite": _is(-math.inf), "zero": _is(0.0),
    "negative": _is(-0.2), "too large": _is(99.0), "at load_high": _is(10.0), "at load_low": _is(0.02),
    "lost in mid-cut and back for one sample": Fault(lambda load, k: load if k == 2 else math.nan),
}  # fmt: skip
STUCK = {"stuck": _is(0.2200071), "stuck below the reference": _is(0.19), "stuck above it": _is(0.25)}
DEAD = {"dead source": Fault(inputs={"beat": False})}
QUIET = {
    "spike of two samples": Fault(lambda load, k: 99.0 if k < 2 else load),
    "loss to the load in air": _is(IDLE), "spindle-on lost": Fault(inputs={"spindle_on": False}),
    "enable lost": Fault(inputs={"enabled": False}), "pause": Fault(inputs={"idle": True}, factor=0.0),
}  # fmt: skip
FEED = {"F x 2": Fault(factor=2.0, held=2000), "override 120 %": Fault(factor=1.2)}
FAULTS = {**LOST, **STUCK, **DEAD, **QUIET, **FEED}


class Bench:
    """The export, the reference and the plant in one loop; keeps inputs, answers and true loads."""

    def __init__(self, text: str, loop: LoadLoop, linear_cut) -> None:
        self.loop, self.hal, self.reference = loop, Hal(text, T), ConstantLoad(loop)
        self.rows: list[Row] = []
        self.answers: list[Answer] = []
        self.expected: list[Answer] = []
        self.loads: list[float] = []
        self.cutting, self.noise = False, np.random.default_rng(1)
        gain = B / (sum(B18) / sum(A18))
        self.plant = linear_cut(
            b=[gain * b for b in B18], a=A18, offset=A, idle=IDLE, wear=self.wear, cutting=lambda t: self.cutting
        )

    def wear(self, t: float) -> float:
        return WEAR + 1e-5 * (37 * round(t / T) % 11 - 5)  # a ripple: equal readings are those of a stuck sensor

    def step(self, fault: Fault, k: int, **inputs: float | bool) -> None:
        feed, inhibited = (self.answers[-1][0], self.answers[-1][INHIBIT]) if self.answers else (0.0, False)
        load = self.plant.step(0.0 if inhibited else fault.factor * feed, T, self.noise)
        beat = len(self.rows) % 2 == 1
        usual = {"enabled": True, "spindle_on": True, "idle": False, "beat": beat, "reset": False}
        row = {"load": fault.reading(load, k), **usual, **inputs, **fault.inputs}
        self.rows.append(row)
        self.loads.append(load)
        self.answers.append(hal_answer(self.hal, row))
        self.expected.append(reference_answer(self.reference, row))

    def run(self, fault: Fault) -> int:
        """The whole course of a fault; the sample of its begin."""
        well = Fault()
        self.cutting = False
        for k in range(60):
            self.step(well, 0, enabled=False, idle=True, reset=k == 30)
        for k in range(START):
            self.cutting = k >= 30
            self.step(well, 0)
        begin = len(self.rows)
        for k in range(fault.held):
            self.step(fault, k, reset=k == fault.held - 50)
        for k in range(HEALED):
            self.step(well, 0, reset=k == HEALED - 50)
        return begin


@pytest.fixture(scope="module")
def bench(constant_load_file, linear_cut):
    pf = constant_load_file(T)
    text = rendered(pf, "hal")
    made = Bench(text, gated_control(pf).loop, linear_cut)
    made.text = text
    made.begins = {name: made.run(fault) for name, fault in FAULTS.items()}
    return made


def course(bench: Bench, name: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Answers from the begin of a fault to its end after healing, true loads, and the length of the fault."""
    begin, held = bench.begins[name], FAULTS[name].held
    rows = slice(begin, begin + held + HEALED)
    return np.array(bench.answers[rows], dtype=float), np.array(bench.loads[rows]), held


def before(bench: Bench, name: str) -> float:
    return bench.answers[bench.begins[name] - 1][0]


def test_the_text_follows_the_reference_through_every_fault(bench):
    assert first_difference(bench.answers, bench.expected, 1e-12) is None
    for name, begin in bench.begins.items():
        assert bench.loads[begin - 1] == pytest.approx(0.22, abs=2e-3), name
        assert bench.answers[begin - 1][CUT]
        assert not any(bench.answers[begin - 1][FAULT:])


@pytest.mark.parametrize(
    ("name", "time"),
    [*((name, "lost_after") for name in LOST), *((name, "stuck_after") for name in STUCK),
     *((name, "heartbeat") for name in DEAD)],
)  # fmt: skip
def test_a_fault_is_latched_at_its_time_and_the_feed_falls_to_the_lower_limit(bench, name, time):
    """The feed at most the one before plus recover times the detection time; at the lower limit after back_off."""
    answers, loads, held = course(bench, name)
    loop, feeds, fault = bench.loop, answers[:, 0], answers[:, FAULT].astype(bool)
    late = 3 if "for one sample" in name else 0
    detected = loop.samples(getattr(loop, time)) + late
    at = int(np.argmax(fault))
    assert at in (detected - 1, detected)  # equal to the reading before the fault, or the first of equal ones
    assert feeds.max() <= before(bench, name) + loop.recover * T * (at + 1) + 1e-12
    falls = math.ceil((feeds[at - 1] - loop.low) / (loop.back_off * T)) + 1
    assert (feeds[at + falls : held] == loop.low).all()
    assert fault[at : held + HEALED - 50].all()  # latched: with the fault present, and after it
    assert not fault[held + HEALED - 50 :].any()  # cleared by a reset without it
    assert loads.max() <= 1.05 * loop.worn_load


@pytest.mark.parametrize("name", QUIET)
def test_without_a_fault_the_feed_is_never_above_the_one_before(bench, name):
    """A short spike, a loss that looks like air, a switch or the spindle lost in the cut, a pause: no fault."""
    answers, _, held = course(bench, name)
    feeds = answers[:held, 0]
    assert not answers[:, [FAULT, OVERLOAD]].any()
    assert feeds.max() <= before(bench, name) + (2 * bench.loop.recover * T if "spike" in name else 1e-12)
    if "spike" not in name:
        assert not answers[2:held, CUT].any()
        assert feeds.min() == (bench.loop.low if "spindle" in name else feeds.max())  # kept where it is switched off
    assert answers[held + 60, CUT]


def test_twice_the_programmed_feed_is_not_bounded_but_ends_in_an_overload(bench):
    """HAL holds shares: the real feed is 1.2 times the programmed one at the lower limit. Overload stops it."""
    answers, loads, held = course(bench, "F x 2")
    loop, inhibited = bench.loop, answers[:, INHIBIT].astype(bool)
    at = int(np.argmax(inhibited))
    assert 2 * answers[:at, 0].min() * loop.feed_programmed > loop.feed_high  # the limit that does not hold
    assert 0 < at < held
    assert loads[:at].max() > loop.overload_at
    assert inhibited[at : held - 50].all()  # until the reset
    mean = np.convolve(loads, np.ones(1000) / 1000, "valid")  # over .2 s
    assert mean.max() < 1.1 * loop.worn_load


def test_an_override_of_120_percent_is_followed_down_to_the_lower_limit(bench):
    answers, loads, held = course(bench, "override 120 %")
    loop = bench.loop
    assert not answers[:, [FAULT, OVERLOAD]].any()
    assert answers[held - 60, 0] == pytest.approx(0.75 / 1.2, abs=0.01)
    assert loads[held - 60] == pytest.approx(loop.reference, rel=0.01)
    assert loads.max() < loop.overload_at


@pytest.mark.consumer
def test_halrun_follows_every_fault_as_the_evaluator_does(bench, consumer):
    halrun = Halrun(consumer("halrun", "apt-get install linuxcnc-uspace"))
    try:
        theirs = halrun.answers(bench.text, bench.rows, "servo-thread", T)
    finally:
        halrun.close()
    assert first_difference(bench.answers, theirs, PRINTED) is None
