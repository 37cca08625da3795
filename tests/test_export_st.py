"""The structured text export: blark parses it, and its statements, run one by one, are `controllers.ConstantLoad`.

blark (https://klauer.github.io/blark/) is a parser of IEC 61131-3 made for TwinCAT's code. No free program here runs
structured text, so the statements are turned into Python, each by the meaning that the standard gives it.
"""

import importlib
import math
import os
import re

import numpy as np
import pytest
from fitmodels import controllers
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.exports.st import real
from fitmodels.core.errors import GateError
from fitmodels.parameters.exports.view import export_view
from hypothesis import given
from hypothesis import strategies as st

SAMPLES = 3000
ROUNDING = 1e-12  # of an override; Python sums a moving average with a correction, structured text does not


def st_of(pf) -> str:
    return rendered(pf, "st")


@pytest.fixture(scope="module")
def parsed():
    """Parse structured text with blark; None, or what it takes exception to."""
    try:
        parse = importlib.import_module("blark.parse")
    except ImportError:
        missing = "blark is not installed: pip install blark"
        pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)
    return lambda text: parse.parse_source_code(text).exception


def in_python(text: str) -> tuple[str, dict[str, object]]:
    """Statements as Python, and every variable with its first value."""
    text = re.sub(r"\(\*.*?\*\)", "", text)
    names: dict[str, object] = {}
    for name, kind, first in re.findall(r"^ +(\w+) : ([^:;]+?)(?: := ([^;]+))?;", text, re.MULTILINE):
        many = re.fullmatch(r"\[(\d+)\((.+)\)\]", first)
        if many:
            names[name] = [float(many[2])] * int(many[1])
        else:
            names[name] = first == "TRUE" if kind == "BOOL" else int(first) if kind == "DINT" else float(first or 0)
    lines, depth = [], 0
    for line in text[text.rindex("END_VAR") + 7 : text.index("END_FUNCTION_BLOCK")].splitlines():
        said = line.strip()
        if said in ("END_IF;", "END_FOR;"):
            depth -= 1
            continue
        loop = re.fullmatch(r"FOR (\w+) := (.+) TO (.+) DO", said)
        test = re.fullmatch(r"IF (.+) THEN", said)
        if said == "ELSE":
            lines.append("    " * (depth - 1) + "else:")
        elif loop or test:
            words = f"for {loop[1]} in range({loop[2]}, {loop[3]} + 1):" if loop else f"if {operators(test[1])}:"
            lines.append("    " * depth + words)
            depth += 1
        elif said:
            left, right = re.fullmatch(r"(.+?) := (.+);", said).groups()
            lines.append(f"{'    ' * depth}{left} = {operators(right)}")
    assert depth == 0
    return "\n".join(lines), names


def operators(expression: str) -> str:
    for theirs, ours in ((" = ", " == "), (" <> ", " != "), ("AND", "and"), ("TRUE", "True"), ("FALSE", "False")):
        expression = expression.replace(theirs, ours)
    return expression


class Block:
    """The function block as a controller of `controllers.replay`."""

    def __init__(self, text: str) -> None:
        statements, self.names = in_python(text)
        self.code = compile(statements, "the function block", "exec")
        self.names |= {"MIN": min, "MAX": max, "ABS": abs, "DINT_TO_LREAL": float, "enable": True}

    def step(self, load: float, dt: float) -> float:
        self.names["load"] = load
        exec(self.code, self.names)  # noqa: S102  our own export
        return self.names["feed_override"]


def loads(loop) -> list[float]:
    """A wild load: cuts, air, noise, both limits, and readings that are none."""
    rng = np.random.default_rng(7)
    level = np.repeat(rng.uniform(0.0, 2.0, SAMPLES // 100) * loop.reference, 100)
    load = level + rng.normal(0, 0.05 * loop.reference, SAMPLES)
    load[1500:1700] = loop.reference
    load[[700, 1550, 1555, 2200]] = math.nan, math.inf, -math.inf, 99.0
    return load.tolist()


@pytest.mark.parametrize(
    ("changes", "within"),
    [({}, 0.0), ({"filter_time": 0.0}, 0.0), ({"integration": "trapezoidal"}, 0.0), ({"low": 700.0}, 0.0),
     ({"average": 3}, ROUNDING), ({"average": 3, "average_of": "command"}, ROUNDING)],
    ids=["as it is", "no low-pass", "trapezoidal sum", "a higher limit", "average of the load", "of the command"],
)  # fmt: skip
def test_the_block_does_what_the_replayed_controller_does(constant_load_file, changes, within):
    pf = constant_load_file(pi=changes)
    loop = export_view(pf).needed_loop()
    block, ours = Block(st_of(pf)), controllers.ConstantLoad(loop, command=1.0)
    happened = set()
    for load in loads(loop):
        theirs, command = block.step(load, loop.sample_time), ours.step(load, loop.sample_time)
        assert abs(theirs - command) <= within
        assert block.names["cutting"] == ours.cutting
        happened |= set(ours.news)
    assert {"cut", "air", "at low", "at high", "load unknown", "load known"} <= happened


def test_in_a_cut_the_block_holds_the_reference(constant_load_file, linear_cut):
    pf = constant_load_file()
    loop = export_view(pf).needed_loop()
    b, a = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
    gain = 1.2416e-4 * 1000 / (sum(b) / sum(a))
    plant = linear_cut(b=[gain * c for c in b], a=a, offset=0.1158)
    trace = controllers.replay(Block(st_of(pf)), plant, duration=30, dt=loop.sample_time)
    assert np.abs(trace.measurement[-200:] - loop.reference).max() < 1e-6


def test_until_it_is_enabled_the_feed_is_the_programmes(constant_load_file):
    block = Block(st_of(constant_load_file()))
    assert re.search(r"enable : BOOL := FALSE", st_of(constant_load_file()))
    block.names["enable"] = False
    assert {block.step(0.5, 0.02) for _ in range(500)} == {1.0}


@pytest.mark.parametrize("broken", [("KI : LREAL := 8.0", "KI : LREAL := 8.1"), ("filtered) * F", "filtered) / F")])
def test_a_broken_number_or_sign_is_seen(constant_load_file, broken):
    pf = constant_load_file()
    loop, text = export_view(pf).needed_loop(), st_of(pf)
    assert broken[0] in text
    block, ours = Block(text.replace(*broken)), controllers.ConstantLoad(loop, command=1.0)
    apart = [abs(block.step(x, loop.sample_time) - ours.step(x, loop.sample_time)) for x in loads(loop)[:600]]
    assert max(apart) > 1e-5


@pytest.mark.consumer
@pytest.mark.parametrize("average", [{}, {"average": 3}, {"average": 3, "average_of": "command"}])
def test_blark_parses_it(parsed, constant_load_file, average):
    assert parsed(st_of(constant_load_file(pi=average))) is None


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("END_IF;", ""), ("END_VAR", ""), ("KP : LREAL", "KP LREAL"), (" := 0.0;", " := 0.0"), ("(* A *)", "A"),
     ("cutting := enable AND", "cutting := enable AND AND")],
)  # fmt: skip
def test_blark_refuses_a_broken_one(parsed, constant_load_file, broken, by):
    text = st_of(constant_load_file())
    assert broken in text
    assert parsed(text.replace(broken, by, 1)) is not None


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_real_literal_has_digits_on_both_sides_and_reads_back(value):
    assert re.fullmatch(r"-?\d+\.\d+(E[+-]\d+)?", real(value))
    assert float(real(value)) == value


def test_no_two_names_differ_in_case_alone_and_none_is_a_word_of_the_language(constant_load_file):
    """Identifiers of IEC 61131-3 have no case (clause 6.1.2), and no two underscores together."""
    _, names = in_python(st_of(constant_load_file(pi={"average": 3})))
    folded = [name.upper() for name in names]
    assert len(set(folded)) == len(folded)
    reserved = {"R", "S", "N", "ST", "LD", "AT", "BY", "DO", "OF", "TO", "LIMIT", "MIN", "MAX", "SEL", "MUX", "ADD"}
    reserved |= {"REFERENCE", "POINTER", "ACTION", "STEP", "TASK", "RETAIN", "OVERRIDE", "FINAL"}  # TwinCAT's too
    assert reserved.isdisjoint(folded)
    assert not any("__" in name or name.endswith("_") for name in names)


def test_without_a_loop_there_is_no_block(constant_load_file):
    with pytest.raises(GateError, match="no PI gains"):
        st_of(constant_load_file(pi=None))
