"""The controller in C, alone and as LinuxCNC component, is `controllers.ConstantLoad` sample by sample.

Plain tests evaluate the text of the exports (`c_evaluator`), the consumer tests compile it.
"""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitmodels.controllers.constant_load_milling.states import State
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.exports.c_source import c_controller, c_settings
from fitmodels.controllers.exports.component import hal_lines
from fitmodels.parameters.exports.loop import loop_settings

sys.path.insert(0, str(Path(__file__).parent))

from c_evaluator import evaluated
from load_control import DRIVER, INPUTS, OUTPUTS, STRICT, compiled, interpreted, reference, sequence, variants

sys.path.remove(str(Path(__file__).parent))

INSTALL = "apt-get install gcc libc6-dev"
DOUBLE, SINGLE = 1e-12, 1e-4  # of an override; the closing condition of the requirement, measured 0 and 1.2e-6
NAMES = ("position", "stop, feed-forward", "average of the load", "average of the command", "incremental sum",
         "incremental sum, average", "shortest times", "limits below 1")  # fmt: skip
FLOAT = ("-DLOAD_CONTROL_REAL=float", "-Wdouble-promotion")
ROUNDING = 2.0**-24  # of a number in single precision


@pytest.fixture
def loop(constant_load_file):
    return loop_settings(constant_load_file()).loop


def differences(run, loop, inputs, expected):
    """Names of the outputs that differ from the Python controller."""
    found = run(inputs)
    away = [np.abs(found[:, k] - expected[:, k]).max() > (DOUBLE if k < 2 else 0) for k in range(len(OUTPUTS))]
    return [name for name, is_away in zip(OUTPUTS, away, strict=True) if is_away]


def faults(text, loop, inputs, expected):
    """What a C text does that the controller of the loop does not."""
    c = evaluated(text)
    found = [name for name, value in c_settings(loop).items() if getattr(c["load_settings"], name) != value]
    if found:
        return found
    step = inputs[:40].copy()
    step[:, 0], step[:, 1] = loop.sample_time * 1.0098, 0.2
    within = interpreted(text)(step)[-1, OUTPUTS.index("fault")]
    step[:, 0] = loop.sample_time * 1.0102
    beyond = interpreted(text)(step)[-1, OUTPUTS.index("fault")]
    return (["period"] if within or not beyond else []) or differences(interpreted(text), loop, inputs, expected)


def test_the_sequences_reach_every_state_and_every_output(loop):
    each = enumerate(variants(loop).values())
    reached = np.concatenate([reference(one, sequence(one, seed)) for seed, one in each])
    assert set(reached[:, 2]) == {0, 1, 2, 3, 4, 5}
    assert (reached[:, 3:].mean(0) > 0.01).all(), dict(zip(OUTPUTS, reached.mean(0), strict=True))
    assert (reached[:, 2] == 3).mean() > 0.1


@pytest.mark.parametrize("name", NAMES)
def test_the_text_is_the_python_controller(loop, name):
    one, seed = variants(loop)[name], NAMES.index(name)
    inputs = sequence(one, seed, samples=2500)
    assert faults(c_controller(one), one, inputs, reference(one, inputs)) == []


MUTATIONS = [
    *c_settings.__globals__["_NUMBERS"], "average", "average_command", "incremental", "stop_on_fault",
    "LOAD_OVERLOAD_SHARE", "LOAD_OVERLOAD_MEAN", "LOAD_REST_SHARE", "LOAD_WORN_MEAN", "LOAD_PERIOD_SHARE",
    "LOAD_SLOW_AFTER",
]  # fmt: skip


def mutated(text, name):
    """The text with one constant changed by 3 % (10 % for constants of the code), or by one."""
    if name.startswith("LOAD_"):
        changed, count = re.subn(rf"(#define {name} )(\S+)", lambda m: f"{m[1]}{float(m[2]) * 1.1!r}", text)
    else:
        line = rf"(    )(\(LoadReal\))?(\S+)(, /\* {name}\b)"
        new = lambda m: m[1] + (f"{m[2]}{float(m[3]) * 1.03 + 1e-3!r}" if m[2] else str(int(m[3]) + 1)) + m[4]  # noqa: E731
        changed, count = re.subn(line, new, text)
    assert count == 1
    return changed


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_changed_constant_is_seen(loop, name):
    one = variants(loop)["stop, feed-forward"]
    inputs = sequence(one, 9, samples=2500)
    assert faults(mutated(c_controller(one), name), one, inputs, reference(one, inputs))


@pytest.mark.parametrize(
    ("line", "other"),
    [
        ("x->held = in->load;", "x->held = in->load * (LoadReal)1.03;"),
        ("x->bias = x->u + s->entry_gain * error;", "x->bias = s->entry_gain * error;"),
        ("else if (!x->armed) x->held = 0;", ""),
        ("x->same = loaded && !in->idle && equal", "x->same = equal"),
        (" && !x->overload && !in->idle;", " && !x->overload;"),
        ("(in->enable && !x->armed)) return s->low;", "(in->enable && !x->armed)) return s->high;"),
        ("if (x->fault || x->overload || (in->enable", "if (x->overload || (in->enable"),
        ("x->overload || (in->enable && !x->armed)", "x->overload"),
        ("x->fault = present || (x->fault && !reset);", "x->fault = present && !reset;"),
        ("if (x->had_cut) return x->u;", "if (x->had_cut) return (LoadReal)1;"),
        ("x->factor = s->feed_programmed / in->requested", "x->factor = in->requested / s->feed_programmed"),
        ("x->falling ? x->fall : x->rise", "x->falling ? x->rise : x->fall"),
        ("x->high_for >= x->n_overload", "x->high_for > x->n_overload"),
    ],
)  # fmt: skip
def test_a_changed_statement_is_seen(loop, line, other):
    one = variants(loop)["stop, feed-forward"]
    text, inputs = c_controller(one), sequence(one, 9, samples=2500)
    assert text.count(line) == 1
    assert faults(text.replace(line, other), one, inputs, reference(one, inputs))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sample_time", 0.0), ("sample_time", float("nan")), ("reference", -1.0), ("low", 0.0), ("low", 1.5),
        ("high", 1.1), ("feed_programmed", 0.0), ("p", float("inf")), ("i", float("nan")), ("entry_gain", 1e31),
        ("filter_time", -1.0), ("engage_at", 5.0), ("hysteresis", -0.1), ("engage_after", 1e9), ("arm_after", -1.0),
        ("lost_after", float("nan")), ("stuck_after", 1e12), ("heartbeat", -1.0), ("overload_after", 1e9),
        ("dwell", 1e9), ("worn_load", 0.0), ("back_off", 0.0), ("recover", -1.0), ("load_low", 0.0),
        ("load_high", 0.01), ("average", 0), ("average", 3),
    ],
)  # fmt: skip
def test_a_setting_out_of_range_stops_the_feed(loop, name, value):
    c = evaluated(c_controller(loop))
    setattr(c["load_settings"], name, value)
    state, inputs, out = (c["new"](kind) for kind in ("LoadState", "LoadInput", "LoadOutput"))
    expected = list(c_settings(loop)).index(name) + 1
    assert c["load_control_init"](c["load_settings"], state) in ({2, expected} if name == "load_high" else {expected})
    c["load_control_step"](c["load_settings"], state, inputs, out)
    assert (out.feed_override, out.feed_inhibit, out.state) == (0, 1, State.FAULT)


def test_the_structure_of_settings_has_their_order_and_states_their_numbers(loop):
    c = evaluated(c_controller(loop))
    assert [name for name, _ in c["load_settings"]._members] == list(c_settings(loop))
    assert {name: c[f"LOAD_{name}"] for name in State.__members__} == dict(State.__members__)


CAUSES = {"load": ("LOST", float("nan")), "beat": ("NO_HEARTBEAT", 0), "requested": ("REQUESTED_INVALID", -1.0),
          "period": ("PERIOD_WRONG", 0.03), "": ("NO_CAUSE", 0), "same": ("STUCK", 0.2)}  # fmt: skip


@pytest.mark.parametrize("name", CAUSES)
def test_the_first_cause_of_a_fault_is_named_until_the_reset(loop, name):
    c, (cause, value) = evaluated(c_controller(loop)), CAUSES[name]
    state, inputs, out = (c["new"](kind) for kind in ("LoadState", "LoadInput", "LoadOutput"))
    assert c["load_control_init"](c["load_settings"], state) == 0
    seen = []
    for k in range(300):
        values = {
            "period": loop.sample_time,
            "requested": loop.feed_programmed,
            "enable": 1,
            "spindle_on": 1,
            "idle": 0,
        }
        values |= {"load": 0.2 + 1e-3 * (k % 3), "beat": k // 3 % 2, "reset": int(k == 250)}
        if 100 <= k < 200 and name:
            values["load" if name == "same" else name] = value
        for field, number in values.items():
            setattr(inputs, field, number)
        c["load_control_step"](c["load_settings"], state, inputs, out)
        seen.append((out.cause, out.fault))
    named = c[f"LOAD_{cause}"]
    assert (seen[99], seen[180], seen[249], seen[299]) == ((0, 0), (named, named > 0), (named, named > 0), (0, 0))


def test_the_real_feed_stays_inside_its_limits_at_any_requested_feed(loop):
    """At F doubled and at an override of 120 %, a ratio alone would break the upper limit."""
    for factor in (0.5, 1.2, 2.0, 4.8):
        inputs = sequence(loop, 3, samples=1500)
        inputs[:, 2] = factor * loop.feed_programmed
        out = interpreted(c_controller(loop))(inputs)
        real = out[:, 0] * inputs[:, 2]
        assert real.max() <= loop.feed_high * (1 + 1e-12)
        in_fault = out[:, OUTPUTS.index("state")] == State.FAULT
        assert in_fault.any()
        assert real[~in_fault].min() >= min(loop.feed_low, inputs[0, 2]) * (1 - 1e-12)
        assert out[in_fault, 0].max() <= loop.high * min(1 / factor, 1.0)
        assert real[in_fault].min() >= min(loop.feed_low, loop.low * inputs[0, 2]) * (1 - 1e-12)


def test_in_a_fault_a_requested_feed_in_a_wrong_unit_does_not_raise_the_feed(loop):
    """Inch/s taken for mm/s, so 25.4 times too small: 100 % in the cut, the lower limit in a fault."""
    inputs = sequence(loop, 3, samples=200)
    inputs[:] = [loop.sample_time, 0.0, loop.feed_programmed / 25.4, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    inputs[:, 1] = 0.2 + 1e-3 * (np.arange(200) % 3)
    inputs[:, 6] = np.arange(200) // 3 % 2
    inputs[100:, 1] = np.nan
    text = c_controller(loop)
    out = interpreted(text)(inputs)
    assert (out[99, 0], out[99, 2]) == (1.0, State.CONTROL)
    assert (out[-1, 0], out[-1, 2]) == (loop.low, State.FAULT)
    assert differences(interpreted(text), loop, inputs, reference(loop, inputs)) == []
    changed = text.replace("fault && x->factor > (LoadReal)1 ?", "0 ?")
    assert "feed_override" in differences(interpreted(changed), loop, inputs, reference(loop, inputs))


SCALE = r"^//\| # >>> setp fm-control\.feed-scale (\S+)$"


def component(text):
    """The function of a component, and its pins and parameters at their first values, the marked scale confirmed."""
    declared, code = text.split("\n;;\n")
    lines = re.findall(r"^(?:pin (?:in|out)|param rw) \w+ (\w+)(?: = (\S+))?", declared, re.MULTILINE)
    c = evaluated(code, rtapi_print_msg=None, RTAPI_MSG_ERR=0, EINVAL=22)
    pins = type("Pins", (), {name: float(first.rstrip(";") or 0) for name, first in lines})()
    assert c["extra_setup"](pins, "fm-control", 0) == 0
    assert pins.feed_scale == 0
    pins.feed_scale = float(re.search(SCALE, declared, re.MULTILINE)[1])
    return c["_"], pins


def ran(step, pins, loop, inputs, operator=1.0):
    """Outputs of a component under inputs that LinuxCNC would give it: the path or the operator slows the feed."""
    found = []
    for k, row in enumerate(inputs.tolist()):
        named = dict(zip(INPUTS, row, strict=True))
        by_path = named["slowed"] and named["requested"] > 0 and k % 80 < 40
        pins.operator_override = 0.998 if named["slowed"] and not by_path else operator
        pins.load, pins.requested_vel = named["load"], named["requested"] / 60 / max(pins.operator_override, 1.0)
        pins.enable, pins.spindle_on, pins.idle, pins.heartbeat, pins.reset, _ = row[3:]
        commanded = named["requested"] / 60 * pins.adaptive_feed
        pins.current_vel = 0.949 * commanded if by_path else max(0.951 * commanded, 1.0)
        step(pins, round(named["period"] * 1e9))
        found.append([getattr(pins, "adaptive_feed" if name == "feed_override" else name) for name in OUTPUTS])
    return np.array(found, float)


@pytest.mark.parametrize("operator", [1.0, 1.2])
def test_the_component_is_the_python_controller(constant_load_file, loop, operator):
    step, pins = component(rendered(constant_load_file(), "comp"))
    assert pins.adaptive_feed == loop.low
    inputs = sequence(loop, 4, samples=1500)
    expected = reference(loop, inputs)
    assert differences(lambda rows: ran(step, pins, loop, rows, operator), loop, inputs, expected) == []


@pytest.mark.parametrize(
    ("constant", "other"),
    [("feed-scale 60", "feed-scale 61"), ("operator_override = 1 ", "operator_override = 2 "),
     ("requested_vel = -1", "requested_vel = 1"), ("* 1e-9", "* 1.1e-9"), ("operator_ < 1.0", "operator_ < 1.3"),
     ("adaptive_feed = 0.6", "adaptive_feed = 0.7"), ("? 1.0 : operator_", "? 1.1 : operator_"),
     ("current_vel = -1", "current_vel = 1"), ("FULL 0.999", "FULL 0.997"), ("FULL 0.999", "FULL 1.001"),
     ("FOLLOWS 0.95 ", "FOLLOWS 0.96 "), ("FOLLOWS 0.95 ", "FOLLOWS 0.94 ")],
)  # fmt: skip
def test_a_changed_constant_of_the_component_is_seen(constant_load_file, loop, constant, other):
    text = rendered(constant_load_file(), "comp")
    assert text.count(constant) == 1
    step, pins = component(text.replace(constant, other))
    inputs = sequence(loop, 4, samples=1500)
    first = (pins.adaptive_feed, pins.requested_vel, pins.current_vel, pins.operator_override) != (loop.low, -1, -1, 1)
    seen = [differences(lambda rows, o=o: ran(step, pins, loop, rows, o), loop, inputs, reference(loop, inputs))
            for o in (1.2, 1.0)]  # fmt: skip
    assert first or any(seen)
    assert component(text)[1].requested_vel == -1


def test_an_operator_below_100_percent_slows_the_feed_and_is_not_compensated(constant_load_file, loop):
    """The load of 0.22 A at half of the feed: it was compensated up to the upper limit, where the feed returned to."""
    step, pins = component(rendered(constant_load_file(), "comp"))
    rows = np.tile([loop.sample_time, 0.2, loop.feed_programmed, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0], (500, 1))
    rows[:, 1] += 1e-3 * (np.arange(500) % 3)
    rows[:, 6] = np.arange(500) // 3 % 2
    before = ran(step, pins, loop, rows[:60])[-1, 0]
    assert loop.low < before < loop.high
    rows[:, 1] -= 0.03
    slow = ran(step, pins, loop, rows[60:], 0.5)[:, 0]
    assert slow.max() <= before
    rows[:, 1] += 0.05
    assert ran(step, pins, loop, rows)[:, 0].max() <= before


def test_a_component_whose_requested_velocity_is_not_connected_goes_to_fault(constant_load_file, loop):
    step, pins = component(rendered(constant_load_file(), "comp"))
    pins.enable = pins.spindle_on = pins.current_vel = 1.0
    for k in range(30):
        pins.load, pins.heartbeat = 0.2 + 1e-3 * (k % 3), k // 3 % 2
        step(pins, round(loop.sample_time * 1e9))
    assert pins.fault
    assert pins.adaptive_feed == loop.low


@pytest.mark.parametrize("scale", [0.0, -60.0, float("nan")])
def test_a_component_whose_feed_scale_is_not_above_zero_goes_to_fault(constant_load_file, loop, scale):
    text = rendered(constant_load_file(), "comp")
    assert "param rw float feed_scale = 0 " in text
    step, pins = component(text)
    pins.feed_scale, pins.requested_vel, pins.enable, pins.spindle_on = scale, loop.feed_programmed / 60, 1.0, 1.0
    pins.current_vel = 10.0
    for k in range(30):
        pins.load, pins.heartbeat = 0.2 + 1e-3 * (k % 3), k // 3 % 2
        step(pins, round(loop.sample_time * 1e9))
    assert (pins.fault, pins.cause, pins.state) == (1, 4, State.FAULT)
    assert (pins.adaptive_feed, pins.requested) == (loop.low, -1.0)


@pytest.mark.parametrize(
    ("unit", "scale", "both"),
    [("mm/min", "60", "60 on a machine in mm, 1524 "), ("mm/s", "1", "1 on a machine in mm, 25.4 "),
     ("in/min", "60", "2.36220472441 on a machine in mm, 60 "), ("ipm", "60", "2.36220472441 on a machine in mm, 60 ")],
)  # fmt: skip
def test_the_hal_lines_state_the_feed_scale_of_both_machine_units(loop, unit, scale, both):
    lines = hal_lines(replace(loop, unit_feed=unit))
    assert f"# >>> setp fm-control.feed-scale {scale}\n" in lines
    assert both in lines


@pytest.mark.parametrize(
    ("velocity", "state"), [(16.0, 3), (0.11, 3), (0.09, 2), (0.0, 2), (-1.0, 2), (float("nan"), 2)]
)
def test_the_component_opens_the_loop_while_the_path_does_not_advance(constant_load_file, loop, velocity, state):
    """In a pause the load falls and a closed loop would raise the feed; 600 mm/min is 10 mm/s, 1 % of it the limit."""
    step, pins = component(rendered(constant_load_file(), "comp"))
    pins.enable = pins.spindle_on = 1.0
    pins.requested_vel = loop.feed_programmed / 60
    feeds = []
    for k in range(100):
        pins.load, pins.heartbeat, pins.current_vel = 0.2 + 1e-3 * (k % 3), k // 3 % 2, 16.0 if k < 80 else velocity
        step(pins, round(loop.sample_time * 1e9))
        feeds.append(pins.adaptive_feed)
    assert (pins.state, pins.fault) == (state, 0)
    assert (feeds[-1] > feeds[79]) == (velocity == 16.0)  # a slower path is no reason to raise the feed


@pytest.mark.consumer
@pytest.mark.parametrize("name", NAMES)
def test_double_precision_is_the_python_controller(consumer, loop, tmp_path, name):
    cc, seed = consumer("cc", INSTALL), NAMES.index(name)
    one = variants(loop)[name]
    inputs = sequence(one, seed, samples=20000)
    assert differences(compiled(cc, c_controller(one), tmp_path, *STRICT), one, inputs, reference(one, inputs)) == []


@pytest.mark.consumer
@pytest.mark.parametrize("name", NAMES)
def test_single_precision_is_double_precision_of_loads_that_are_rounded(consumer, loop, tmp_path, name):
    """Its backward error: a comparison that falls on its edge is decided by the rounding of an input.

    Such a comparison is whether the output of the PI is at its limit, or whether the program requests less. In at most
    two of 30 sequences of 20 000 samples it matters; these are the controller in double precision of loads, or of
    requested feeds, larger or smaller by at most 2e-6 of themselves, by a share for every 20 samples.
    """
    cc, one = consumer("cc", INSTALL), variants(loop)[name]
    double, single = (compiled(cc, c_controller(one), tmp_path, *STRICT, *more) for more in ((), FLOAT))
    sequences = [sequence(one, seed, samples=20000) for seed in range(30)]
    away = [inputs for inputs in sequences if not alike(single(inputs), double(inputs))]
    assert len(away) <= 2
    for inputs in away:
        rng, found = np.random.default_rng(0), single(inputs)
        shares = np.repeat(30 * ROUNDING * rng.uniform(-1, 1, (100, len(inputs) // 20)), 20, axis=1)
        factors = (changed(name, share) for name in ("load", "requested") for share in shares)
        assert any(alike(found, double(inputs * factor)) for factor in factors)


def alike(single, double):
    """Whether the overrides agree within the limit of single precision, and states and alarms are the same."""
    return np.abs(single[:, 0] - double[:, 0]).max() <= SINGLE and (single[:, 2:] == double[:, 2:]).all()


def changed(name, shares):
    """Factors of the inputs that change one of them alone, each sample by its share."""
    return np.where(np.array(INPUTS) == name, 1 + shares[:, None], 1.0)


@pytest.mark.consumer
@pytest.mark.parametrize("name", ["p", "entry_gain", "LOAD_OVERLOAD_SHARE", "LOAD_WORN_MEAN", "lost_after", "load_low"])
def test_the_evaluator_is_the_compiled_c_for_changed_texts_too(consumer, loop, tmp_path, name):
    one = variants(loop)["stop, feed-forward"]
    text, inputs = mutated(c_controller(one), name), sequence(one, 1, samples=4000)
    by_cc = compiled(consumer("cc", INSTALL), text, tmp_path)(inputs)
    assert (by_cc == interpreted(text)(inputs)).all()


@pytest.mark.consumer
@pytest.mark.parametrize(
    "options", [["-std=c90"], ["-std=c99"], ["-std=c11"], ["-std=c90", *FLOAT], ["-x", "c++"], ["-x", "c++", *FLOAT]]
)
def test_the_export_compiles_without_a_warning(consumer, constant_load_file, tmp_path, options):
    cc = consumer("c++" if "c++" in options else "cc", "apt-get install g++" if "c++" in options else INSTALL)
    for average in ({}, {"average": 3, "filter_time": 0.0}):
        (tmp_path / "controller.c").write_text(rendered(constant_load_file(pi=average), "c"))
        (tmp_path / "driver.c").write_text(DRIVER)
        (tmp_path / "other.c").write_text('#define LOAD_CONTROL_DECLARATIONS_ONLY\n#include "controller.c"\n')
        for source in ("driver.c", "other.c"):
            made = [cc, *options, *STRICT, "-c", source, "-o", "out.o"]
            subprocess.run(made, cwd=tmp_path, check=True)


@pytest.mark.consumer
def test_a_compiler_that_assumes_no_nan_is_refused(consumer, loop, tmp_path):
    (tmp_path / "params.c").write_text(c_controller(loop))
    made = [consumer("cc", INSTALL), "-ffast-math", "-c", "params.c", "-o", "params.o"]
    ran = subprocess.run(made, cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode
    assert "compile without -ffast-math" in ran.stderr


@pytest.mark.consumer
def test_the_example_of_the_documentation_compiles(consumer, loop, tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "howto" / "controller-c.md").read_text("utf-8")
    example = re.search(r"```\{code-block\} c\n(.*?)```", page, re.DOTALL)[1]
    kinds = dict.fromkeys(("seconds_since_last_call", "spindle_current", "programmed_feed"), "double")
    kinds |= dict.fromkeys(("stop_feed", "set_feed_override", "show", "begin", "every_sample_time"), "void")
    called = set(re.findall(r"(\w+)\(", example)) - {"load_control_init", "load_control_step", "if"}
    declared = "".join(f"{kinds.get(name, 'int')} {name}();\n" for name in sorted(called))
    (tmp_path / "params.c").write_text(c_controller(loop))
    (tmp_path / "main.c").write_text(declared + example)
    made = [consumer("cc", INSTALL), "-std=c90", "-Wall", "-Wextra", "-Werror", "-c", "main.c", "-o", "main.o"]
    subprocess.run(made, cwd=tmp_path, check=True)


@pytest.mark.consumer
@pytest.mark.parametrize("real", ["double", "float"])
def test_garbage_leaves_every_output_inside_its_limits_under_sanitizers(consumer, loop, tmp_path, real):
    """2e6 steps with NaN, infinite, huge and subnormal inputs and random settings: no finding, no output outside."""
    (tmp_path / "controller.c").write_text(c_controller(replace(loop, average=5)))
    options = [
        "-O1",
        "-fsanitize=address,undefined,float-cast-overflow",
        "-fno-sanitize-recover=all",
        "-Wall",
        "-Wextra",
    ]
    garbage = Path(__file__).with_name("load_control_garbage.c")
    made = [consumer("cc", INSTALL), *options, f"-DLOAD_CONTROL_REAL={real}", f"-I{tmp_path}", garbage, "-o", "garbage"]
    subprocess.run(made, cwd=tmp_path, check=True)
    ran = subprocess.run([tmp_path / "garbage", "2000000", "11"], capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    loops, steps, outside, *seen = map(int, ran.stdout.split())
    assert (steps, outside) == (2000000, 0)
    assert loops > 1000
    assert min(seen) > 1000
