"""The structured text export: interpreted call by call, it is `controllers.ConstantLoad`; blark accepts its text.

No free compiler of structured text is packaged, so `st_evaluator` interprets the part of the language that the export
uses. blark (https://klauer.github.io/blark/), a parser made for TwinCAT's code, judges the same texts independently.
"""

import importlib
import math
import os
import re
import sys
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from fitmodels import controllers
from fitmodels.controllers.constant_load_milling.control_laws import loop_of
from fitmodels.controllers.constant_load_milling.states import STATES
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.exports.st import real, structured_text
from fitmodels.core.errors import GateError
from fitmodels.parameters.exports.view import export_view
from hypothesis import given
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))

from hal_sequences import SCATTERED
from st_evaluator import DeclarationError, FunctionBlock, GrammarError, UndefinedError

sys.path.remove(str(Path(__file__).parent))

ROUNDING = 1e-12  # of an override; Python 3.12 sums a moving average with a correction, structured text does not
INPUTS = ("enable", "spindle_on", "motion_idle", "beat", "reset", "load", "slowed")
OUTPUTS = ("state", "cause", "fault", "worn", "overload", "feed_inhibit")
KINDS = {
    "position form": {},
    "no low-pass": {"filter_time": 0.0},
    "trapezoidal sum": {"integration": "trapezoidal"},
    "higher limit": {"low": 700.0},
    "average of the load": {"average": 3},
    "average of the command": {"average": 3, "average_of": "command"},
    "eq. 16": {"form": "incremental_sum", "kp": 30.0, "ki": 40.0},
    "eq. 16, average of the command": {"form": "incremental_sum", "kp": 30.0, "ki": 40.0, "average": 3,
                                       "average_of": "command"},
}  # fmt: skip
AT_FILE = {  # nothing zero or one that could be mistaken for another
    "feed_programmed": 1000.0, "engage_at": 0.15, "hysteresis": 0.02, "engage_after": 0.4, "back_off": 1.0,
    "recover": 0.4, "load_low": 0.02, "load_high": 10.0, "arm_after": 0.2, "lost_after": 0.06, "stuck_after": 1.0,
    "heartbeat": 0.2, "overload_after": 0.5,
}  # fmt: skip


class Control:
    """A control that has not passed the gate: the texts of this file are interpreted, never written for a machine."""

    def __init__(self, pf) -> None:
        self.view = export_view(pf, loop_only=True)
        self.loop = loop_of(pf)


@pytest.fixture(scope="module")
def control(constant_load_file):
    """A control by the changes of its gains and its settings; its upper limit is below the programmed feed."""

    def make(gains=None, **settings) -> Control:
        pi = {"setpoint_weight": 0.8, **(gains or {})}
        exact = {"kind": "none", "reason": "given"}
        line = {"upper": {"value": 950.0, "wear": 0.0, "interval": exact}, "dwell": 0.6}
        return Control(constant_load_file(pi=pi, load_line={**line, "engagement": {**AT_FILE, **settings}}))

    return make


def wild(loop, samples=1000, seed=7) -> list[tuple]:
    """Random cuts, air, noise, wrong readings, and switches that come and go."""
    rng = np.random.default_rng(seed)
    level = np.repeat(rng.uniform(0.2, 1.5, samples // 50) * loop.reference, 50)
    load = level + rng.normal(0, 0.05 * loop.reference, samples) * (rng.random(samples) < 0.9)
    wrong = rng.choice([math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300], samples)
    load = np.where(np.repeat(rng.random(samples // 5) < 0.02, 5), wrong, load)

    def switch(mostly: float, for_: int) -> list[bool]:
        return np.repeat(rng.random(samples // for_ + 1) < mostly, for_)[:samples].tolist()

    beat = (np.arange(samples) // 3 % 2 == 1) & np.repeat(rng.random(samples // 25) < 0.95, 25)
    return list(zip(switch(0.97, 50), switch(0.95, 50), switch(0.2, 20), beat.tolist(), switch(0.1, 2), load.tolist(),
                    switch(0.2, 20), strict=True))  # fmt: skip


class Course:
    """A course of inputs, appended piece by piece; the load swings by a little, so that it does not stand still."""

    def __init__(self) -> None:
        self.rows: list[tuple] = []

    def go(
        self, samples, load, *, to=None, swing=1e-4, enable=True, spindle=True, idle=False, beats=True, reset=False,
        slowed=False,
    ):  # fmt: skip
        """Samples at a load, or on a straight line to another."""
        for k in range(samples):
            value = load if to is None else load + (to - load) * k / samples
            value += swing * math.sin(1.7 * len(self.rows))
            beat = len(self.rows) // 4 % 2 == 1 if beats else self.rows[-1][3]
            self.rows.append((enable, spindle, idle, beat, reset, value, slowed))
        return self


def directed(loop) -> list[tuple]:
    """Each state, each fault and each threshold, with readings on both sides of it and times around each delay."""
    low, high, nan, worn = loop.load_low, loop.load_high, math.nan, loop.overload_at
    course = Course().go(3, nan, enable=False).go(5, 0.1, enable=False).go(5, 0.1, spindle=False).go(20, 0.1)
    course.go(60, 0.1, to=0.2).go(60, 0.2).go(40, 0.2, to=0.12).go(20, 0.12).go(15, 0.2).go(30, 0.1)  # also a short cut
    course.go(200, 0.17)  # to the upper limit
    for upwards, load in ((40, 0.27), (50, 0.265), (60, 0.268), (70, 0.262)):  # to the lower limit, until worn
        course.go(upwards, 0.2).go(150, load).go(1, load, reset=True).go(20, load).go(2, load, reset=True)
    course.go(35, 0.25).go(80, 0.15, to=0.2).go(60, 0.15).go(260, 0.25)  # from the upper limit
    course.go(30, 0.13).go(3, 0.25, reset=True).go(40, 0.15)  # entry with a large error
    for excess in (1e-6, 1e-7, 1e-8):  # overload: the mean approaches its limit slowly
        course.go(80, 0.2).go(130, worn * (1 + excess), swing=0).go(2, 0.27, reset=True).go(30, 0.2)
        course.go(1, 0.2, reset=True).go(40, 0.2)
    course.go(100, 0.26, to=0.29).go(2, 0.29, reset=True).go(20, 0.29).go(40, 0.2).go(1, 0.2, reset=True).go(40, 0.2)
    course.go(24, 0.4).go(40, 0.2).go(1, 0.2, reset=True).go(40, 0.2)
    for equal in (49, 50, 52):
        course.go(equal, 0.2, swing=0).go(10, 0.2).go(1, 0.2, reset=True).go(40, 0.2)
    course.go(20, 0.2, swing=0).go(40, 0.2, swing=0, idle=True).go(30, 0.2, swing=0).go(20, 0.21)  # a pause
    for dead in (9, 10, 12):
        course.go(dead, 0.2, beats=False).go(1, 0.2, beats=False, reset=True).go(10, 0.2).go(1, 0.2, reset=True).go(
            30, 0.2
        )
    for wrong in (nan, math.inf, -math.inf, 0.0, -1.0, low * 0.995, low * 1.005, high * 0.995, high * 1.005):
        course.go(4, wrong, swing=0).go(2, wrong, swing=0, reset=True).go(20, 0.2).go(1, 0.2, reset=True).go(30, 0.2)
    for pattern in SCATTERED:
        for sign in pattern:
            course.go(1, nan if sign == "b" else 0.2, reset=sign == "r", enable=sign != "o")
    course.go(40, 0.22).go(30, 0.2, slowed=True).go(2, 0.2).go(20, 0.24, slowed=True).go(60, 0.2)
    course.go(200, 0.25).go(150, 0.2, slowed=True).go(60, 0.2).go(60, 0.27).go(130, 0.24, slowed=True).go(40, 0.2)
    for rested in (94, 98, 102):  # on the lower limit, until worn; slowed with less load in between
        course.go(1, 0.2, reset=True).go(100, 0.2).go(rested, 0.27).go(5, 0.2, slowed=True).go(23, 0.2).go(60, 0.27)
    course.go(1, 0.2, reset=True).go(2, nan).go(20, 0.2).go(3, nan).go(10, 0.2).go(1, 0.2, reset=True).go(40, 0.2)
    course.go(40, 0.2, spindle=False).go(15, 0.2).go(40, 0.2, enable=False).go(30, 0.2).go(20, 0.13, spindle=False)
    course.go(20, 0.138, to=0.142, spindle=False, idle=True).go(10, nan, spindle=False, idle=True)
    course.go(40, 0.12, spindle=False, idle=True).go(110, 0.12, enable=False, idle=True).go(30, 0.12)
    course.go(5, nan, spindle=False).go(40, 0.2).go(8, 0.25).go(8, 0.2).go(30, 0.24).go(30, 0.13)
    course.go(80, 0.159, to=0.161, swing=1e-6).go(80, 0.141, to=0.139, swing=1e-6).go(20, 0.1)
    return course.rows


Trail = list[tuple]


class Watched(controllers.ConstantLoad):
    """The reference, with the number of the latched fault's cause, as the C source numbers it."""

    CAUSES = ("", "load lost", "load stuck", "no heartbeat")

    def _cause(self, equal):
        found = super()._cause(equal)
        if not self.fault or self.acknowledged:
            self.number = self.CAUSES.index(found)
        return found


def trail_of_the_reference(loop, rows) -> Trail:
    ours, trail = Watched(loop), []
    for enable, spindle, idle, beat, reset, load, ours.slowed in rows:
        ours.acknowledged = reset and not ours.reset
        ours.enabled, ours.spindle_on, ours.idle, ours.beat, ours.reset = enable, spindle, idle, beat, reset
        u = ours.step(load, loop.sample_time)
        trail.append((u, int(ours.state), ours.number, ours.fault, ours.worn, ours.overload, ours.feed_inhibit))
    return trail


def starts_as_specified(block: FunctionBlock, low: float) -> bool:
    """Flags FALSE, numbers zero, the feed on its lower limit; until it is wired it counts as slowed from outside."""
    at_start = {name: block[name] for name, of in block.variables.items() if of.section != "CONSTANT"}
    values = [at_start.pop("FEED_OVERRIDE"), at_start.pop("U"), at_start.pop("SLOWED")]
    return values == [low, low, True] and not any(any(v) if isinstance(v, list) else v for v in at_start.values())


def first_difference(text: str, rows, expected: Trail, low: float, within: float = ROUNDING) -> int | None:
    """Sample in which the block differs from the reference; -1 before the first call; None where it never does."""
    try:
        block = FunctionBlock(text)
    except (GrammarError, DeclarationError, UndefinedError):
        return -1
    if not starts_as_specified(block, low):
        return -1
    for k, (row, (u, *others)) in enumerate(zip(rows, expected, strict=True)):
        try:
            block.call(**dict(zip(INPUTS, row, strict=True)))
        except UndefinedError:
            return k
        if not abs(block["feed_override"] - u) <= within or [block[name] for name in OUTPUTS] != others:
            return k
    return None


def scene(control) -> tuple[str, list[tuple], Trail, float]:
    """Text, inputs, expected outputs, and the lower limit."""
    rows = wild(control.loop) + directed(control.loop)
    return structured_text(control), rows, trail_of_the_reference(control.loop, rows), control.loop.low


@pytest.mark.parametrize("gains", KINDS.values(), ids=KINDS)
def test_the_block_is_the_replayed_controller_in_every_sample(control, gains):
    text, rows, expected, low = scene(control(gains))
    assert first_difference(text, rows, expected, low, ROUNDING if gains.get("average") else 0.0) is None
    states = {state for _, state, *_ in expected}
    assert states == {int(row.state) for row in STATES}
    assert {cause for _, _, cause, *_ in expected} == {0, 1, 2, 3}


def mutants(text: str) -> dict[str, str]:
    """The block with one number or flag changed, by line: 1 % of a constant, one sample, the other truth value."""
    found: dict[str, str] = {}
    start, body = text.index("FUNCTION_BLOCK"), text.rindex("END_VAR")
    literal = re.compile(r"(?<![\w.])(?:TRUE|FALSE|-?\d+\.\d+(?:E[+-]?\d+)?|-?\d+)(?![\w.])")
    for match in literal.finditer(re.sub(r"\(\*.*?\*\)", lambda m: " " * len(m[0]), text), start):
        line = text[text.rindex("\n", 0, match.start()) + 1 : text.index("\n", match.end())].split("(*")[0].strip()
        number = text.count("\n", 0, match.start())
        for name, other in changes(match[0], in_body=match.start() > body):
            found[f"{number}: {line} -> {name}"] = f"{text[: match.start()]}{other}{text[match.end() :]}"
    return found


def changes(literal: str, *, in_body: bool) -> list[tuple[str, str]]:
    if literal in ("TRUE", "FALSE"):
        return [("flipped", "FALSE" if literal == "TRUE" else "TRUE")]
    if "." in literal:
        value = float(literal)
        others = [-1.0 - value] if in_body or value == 0 else [value * 1.01, value * 0.99]
        return [(f"{other:.6g}", real(other)) for other in others]
    return [(str(other), str(other)) for other in (int(literal) - 1, int(literal) + 1)]


EQUIVALENT = (
    "FOR place := 0 TO AVERAGE - 1 DO -> 1",  # the first place of the command's average is dropped next
    "ELSIF slow > 0 THEN -> -1",  # then it ends at -1, which is not above 0 either
)


def law_of(text: str) -> str:
    """The statements of the control law, which differ by its form."""
    return text[text.index("(* 7.") : text.index("(* 8.")]


@pytest.mark.parametrize(("gains", "count"), [({"average": 3}, 180), (KINDS["eq. 16, average of the command"], 20)],
                         ids=["position form", "law of eq. 16"])  # fmt: skip
def test_one_changed_number_or_flag_of_the_block_is_seen(control, gains, count):
    """Every constant, initial value and number in a statement, by 1 % or one sample; only an equivalent one passes."""
    text, rows, expected, low = scene(control(gains, on_fault="stop"))
    changed = {
        words: mutant for words, mutant in mutants(text).items() if count > 100 or law_of(mutant) != law_of(text)
    }
    assert len(changed) > count
    missed = [words for words, mutant in changed.items() if first_difference(mutant, rows, expected, low) is None]
    assert [words for words in missed if not any(same in words for same in EQUIVALENT)] == []


# behaviour of the block


def called(text: str, rows) -> FunctionBlock:
    block = FunctionBlock(text)
    for row in rows:
        block.call(**dict(zip(INPUTS, row, strict=True)))
    return block


def test_until_it_is_enabled_the_feed_is_the_programmed_one_within_its_limits(control):
    """No input but the load: the inputs that are not wired keep the block off."""
    block = FunctionBlock(structured_text(control()))
    for _ in range(500):
        block.call(load=0.5)
    assert (block["feed_override"], block["state"]) == (0.95, block["STATE_OFF"])


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 0.0, -1.0, 11.0])
def test_a_lost_reading_in_the_cut_takes_the_feed_to_the_lower_limit_until_reset(control, wrong):
    """The export before this one took a lost sensor for air: the feed of a worn tool went to the programmed one."""
    text, loop = structured_text(control()), control().loop
    cut = Course().go(20, 0.1).go(60, 0.2).rows
    before = called(text, cut)["feed_override"]
    most = before + loop.recover * loop.lost_after
    block = called(text, cut + Course().go(3, wrong, swing=0).rows)
    assert block["fault"]
    assert block["feed_override"] <= most
    assert not block["feed_inhibit"]
    gone = called(text, cut + Course().go(30, wrong, swing=0).go(1, wrong, swing=0, reset=True).rows)
    assert (gone["feed_override"], gone["fault"]) == (loop.low, True)  # a reset clears nothing while it is lost
    healed = cut + Course().go(30, wrong, swing=0).go(20, 0.2).rows
    assert called(text, healed)["fault"]
    assert not called(text, healed + Course().go(1, 0.2, reset=True).rows)["fault"]


@pytest.mark.parametrize("lost", [{"spindle": False}, {"enable": False}, {"load_in_air": 0.1}])
def test_a_cut_that_seems_to_end_keeps_the_last_feed(control, lost):
    """Spindle-on or enable lost, or a load that falls to that of air, in the cut of a worn tool."""
    text = structured_text(control())
    cut = Course().go(20, 0.1).go(60, 0.2).go(200, 0.25).rows
    before = called(text, cut)["feed_override"]
    load = lost.pop("load_in_air", 0.25)
    block = called(text, cut + Course().go(300, load, **lost).rows)
    assert block["feed_override"] <= before
    assert block["state"] in (block["STATE_OFF"], block["STATE_AIR"])


def test_a_pause_in_the_cut_keeps_the_feed(control):
    """The load of a worn tool that stands still in its cut is below the reference: the PI would raise the feed."""
    text = structured_text(control())
    cut = Course().go(20, 0.1).go(60, 0.2).go(200, 0.25).rows
    before = called(text, cut)["feed_override"]
    block = called(text, cut + Course().go(300, 0.18, swing=0, idle=True).rows)
    assert (block["feed_override"], block["fault"]) == (before, False)


def test_a_fault_stops_the_feed_where_the_file_asks_for_it(control):
    text = structured_text(control(on_fault="stop"))
    block = called(text, Course().go(20, 0.1).go(60, 0.2).go(5, math.nan).rows)
    assert (block["fault"], block["feed_inhibit"]) == (True, True)


readings = st.floats() | st.floats(0.0, 0.5)


@hypothesis.settings(max_examples=40)
@given(st.lists(st.tuples(*[st.booleans()] * 5, readings, st.booleans()), max_size=60))
def test_whatever_it_reads_the_feed_stays_within_its_limits_and_rates(quick, rows):
    text, loop = quick
    block, last = FunctionBlock(text), None
    for row, (u, *others) in zip(rows, trail_of_the_reference(loop, rows), strict=True):
        block.call(**dict(zip(INPUTS, row, strict=True)))
        feed = block["feed_override"]
        assert loop.low <= feed <= loop.high
        if last is not None:
            assert -loop.back_off * loop.sample_time <= feed - last + 1e-12
            assert feed - last <= loop.recover * loop.sample_time + 1e-12
        assert (feed, *(block[name] for name in OUTPUTS)) == (u, *others)
        last = feed


@pytest.fixture(scope="module")
def quick(control):
    """A block whose delays are one to three samples, so that short courses reach each state."""
    control = control(arm_after=0.02, lost_after=0.04, engage_after=0.02, stuck_after=0.06, heartbeat=0.06)
    return structured_text(control), control.loop


def test_monitors_that_the_file_switches_off_stay_silent(control):
    text = structured_text(control(stuck_after=0.0, heartbeat=0.0))
    assert not called(text, Course().go(20, 0.1).go(200, 0.2, swing=0, beats=False).rows)["fault"]


def test_no_counter_grows_beyond_its_limit(control):
    """A DINT that counts periods of 1 ms overflows after 25 days: the counters of the block stop at their limits."""
    text = structured_text(control())
    block = called(text, Course().go(500, 0.2).go(300, 0.26).go(300, math.nan).rows)
    highest = {block[name] for name in block.names("CONSTANT") if name.endswith("_SAMPLES")}
    counters = [name for name in block.names("VAR") if block.variables[name].kind == "DINT"]
    assert len(counters) >= 7
    assert all(0 <= block[name] <= max(highest) for name in counters)


def test_a_time_beyond_a_counter_is_refused(control):
    with pytest.raises(
        GateError, match=r"overload_after: 1e\+09 s are 50000000000 samples .*DINT.* Give a shorter time"
    ):
        structured_text(control(overload_after=1e9))


def test_the_head_lists_every_state_and_what_the_block_cannot_do(control):
    head = " ".join(re.findall(r"\(\* (.*?) \*\)", structured_text(control()).split("FUNCTION_BLOCK")[0]))
    for row in STATES:
        assert f"state {int(row.state)} {row.state.name}: " in head
        assert re.sub(r"[;]", "", row.feed) in re.sub(r"[;]", "", head)
    for words in ("No safety function in the sense of ISO 13849", "a block that is no longer called keeps its last",
                  "not detected - a load that falls to exactly the load in air"):  # fmt: skip
        assert words in head


def test_in_a_cut_the_block_holds_the_reference(control, linear_cut):
    text, loop = structured_text(control()), control().loop
    b, a = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
    gain = 1.2416e-4 * 1000 / (sum(b) / sum(a))
    plant, noise = linear_cut(b=[gain * c for c in b], a=a, offset=0.1158), np.random.default_rng(1)
    block, load = FunctionBlock(text), 0.0
    for k in range(1500):
        load = plant.step(block["feed_override"], loop.sample_time, noise)
        block.call(load=load, enable=True, spindle_on=True, beat=k // 3 % 2 == 1, slowed=False)
        if block["fault"]:
            break
    assert abs(load - loop.reference) < 1e-6


# the language


@pytest.fixture(scope="module")
def parsed():
    """Parse structured text with blark; None, or what it takes exception to."""
    try:
        parse = importlib.import_module("blark.parse")
    except ImportError:
        missing = "blark is not installed: pip install blark"
        pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)
    return lambda text: parse.parse_source_code(text).exception


@pytest.mark.consumer
def test_blark_parses_it(parsed, control):
    """The whole block, and the other law by itself: parsing takes seconds."""
    assert parsed(structured_text(control(KINDS["average of the load"]))) is None
    other = law_of(structured_text(control(KINDS["eq. 16, average of the command"])))
    assert parsed(f"FUNCTION_BLOCK f\n{other}END_FUNCTION_BLOCK\n") is None


BROKEN = [
    ("END_IF;", ""), ("END_VAR", ""), ("KP : LREAL", "KP LREAL"), (" := 0.0;", " := 0.0"), ("(* A *)", "A"),
    ("enable AND", "enable AND AND"), ("IF valid THEN", "IF valid"), ("ELSIF bad", "ELSE IF bad"),
    (" := 0.6;", " := .6;"), ("bad + 1", "bad + + 1)"), ("DINT := 0", "DINT := (0"),
    ("valid := (", "valid = ("), ("NOT spindle_on", "NOT NOT_ spindle_on"), ("END_FUNCTION_BLOCK", ""),
]  # fmt: skip


@pytest.mark.consumer
@pytest.mark.parametrize("broken", BROKEN)
def test_blark_refuses_what_the_interpreter_refuses(parsed, control, broken):
    text = re.sub(r"\(\* 3\..*END_FUNCTION_BLOCK", "END_FUNCTION_BLOCK", structured_text(control()), flags=re.DOTALL)
    assert broken[0] in text
    FunctionBlock(text)
    mutant = text.replace(*broken, 1)
    assert parsed(mutant) is not None
    with pytest.raises((GrammarError, DeclarationError)):
        FunctionBlock(mutant)


@pytest.mark.parametrize(
    ("statement", "fault"),
    [
        ("KP := 1.0;", DeclarationError),
        ("load := 0.2;", DeclarationError),
        ("target := 1;", DeclarationError),
        ("bad := 1.0;", DeclarationError),
        ("valid := bad;", DeclarationError),
        ("target := nowhere;", DeclarationError),
        ("IF bad THEN bad := 0; END_IF;", DeclarationError),
        ("target := MIN(target, 1);", DeclarationError),
        ("valid := valid + valid;", DeclarationError),
        ("bad := bad / 2;", DeclarationError),
        ("valid := 0.1 < target < 0.2;", DeclarationError),
        ("target := ABS(valid);", DeclarationError),
        ("target = 1.0;", GrammarError),
        ("valid := armed OR;", GrammarError),
        ("(* (* *) *)", GrammarError),
        ("target := 1.;", GrammarError),
        ("target := 1.0 / 0.0;", UndefinedError),
        ("bad := 2147483647 + 1;", UndefinedError),
        ("target := MIN(load, 1.0);", UndefinedError),
        ("kept[3] := 0.0;", UndefinedError),
        ("target := kept[0 - 1];", UndefinedError),
        ("FOR bad := 0 TO 2 DO bad := 0; END_FOR;", DeclarationError),
    ],
)
def test_the_interpreter_refuses_what_the_standard_does_not_define(control, statement, fault):
    text = structured_text(control({"average": 3}))
    FunctionBlock(text).call(load=math.nan)
    broken = text.replace("END_FUNCTION_BLOCK", f"{statement}\nEND_FUNCTION_BLOCK")
    with pytest.raises(fault):
        FunctionBlock(broken).call(load=math.nan)


def test_operators_bind_as_the_standard_orders_them():
    """Table 71 of IEC 61131-3:2013: negation, product, sum, comparison, equality, AND, XOR, OR; each from the left."""
    text = (
        "FUNCTION_BLOCK f VAR a : BOOL; b : BOOL; x : LREAL; n : DINT; END_VAR\n"
        "a := TRUE OR FALSE AND FALSE XOR TRUE; b := 1.0 + 2.0 * 3.0 < 8.0 = TRUE;\n"
        "x := 8.0 / 4.0 / 2.0 - 1.0 - -2.0 * 3.0; n := 7 - 2 - 1;\nEND_FUNCTION_BLOCK"
    )
    block = FunctionBlock(text)
    block.call()
    assert (block["A"], block["B"], block["x"], block["N"]) == (True, True, 6.0, 4)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_real_literal_has_digits_on_both_sides_and_reads_back(value):
    assert re.fullmatch(r"-?\d+\.\d+(E[+-]\d+)?", real(value))
    assert float(real(value)) == value


@pytest.mark.parametrize("gains", [{"average": 3}, KINDS["eq. 16"]])
def test_no_two_names_differ_in_case_alone_and_none_is_a_word_of_the_language(control, gains):
    """Identifiers of IEC 61131-3 have no case (clause 6.1.2), and no two underscores together."""
    names = FunctionBlock(structured_text(control(gains))).variables
    reserved = {"R", "S", "N", "ST", "LD", "AT", "BY", "DO", "OF", "TO", "LIMIT", "MIN", "MAX", "SEL", "MUX", "ADD"}
    reserved |= {"REFERENCE", "POINTER", "ACTION", "STEP", "TASK", "RETAIN", "OVERRIDE", "FINAL"}  # TwinCAT's too
    reserved |= {"EQ", "NE", "GT", "GE", "LT", "LE", "ABS", "TIME", "DATE", "STRING", "ON", "WITH", "EXIT", "RETURN"}
    assert reserved.isdisjoint(names)
    assert not any("__" in name or name.endswith("_") for name in names)


def test_without_a_loop_there_is_no_block(constant_load_file):
    with pytest.raises(GateError, match="no PI gains"):
        rendered(constant_load_file(pi=None), "st")
