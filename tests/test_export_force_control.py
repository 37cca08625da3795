"""Constant load, roughness and adaptive force as running controls: each export is the controller of the replay.

Plain tests evaluate the text of the exports, the consumer tests compile it (cc, FMPy, halcompile).
"""

import math
import re
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from fitmodels.controllers.adaptive_force.controller import AdaptiveForceControl
from fitmodels.controllers.adaptive_force.plant import DriveAndCut
from fitmodels.controllers.adaptive_force.runs import steady_run
from fitmodels.controllers.constant_load_milling.control_laws import loop_of
from fitmodels.controllers.constant_load_milling.plant import MillingCut
from fitmodels.controllers.constant_load_milling.runs import constant_load_run
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.exports.c_source import c_controller, c_settings
from fitmodels.controllers.exports.st import structured_text
from fitmodels.controllers.gate.adaptive_force import check_adaptive_force, gated_adaptive_force
from fitmodels.controllers.gate.roughness import check_roughness, gated_roughness
from fitmodels.controllers.loop import replay
from fitmodels.controllers.roughness.controller import ConstantRoughness
from fitmodels.controllers.roughness.plant import TurningForce
from fitmodels.controllers.roughness.plausible import contradictions
from fitmodels.controllers.roughness.simulations import turn
from fitmodels.core.errors import GateError
from fitmodels.parameters.exports.quantities import file_quantities
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.published.roughness import surf

sys.path.insert(0, str(Path(__file__).parent))

from c_evaluator import evaluated
from load_control import INPUTS, OUTPUTS, STRICT, compiled, interpreted, reference, sequence
from st_evaluator import FunctionBlock
from test_export_control_run import PRINTED, fmpy, machine, started, step, streamed  # noqa: F401  fixtures

sys.path.remove(str(Path(__file__).parent))

INSTALL = "apt-get install gcc libc6-dev"
SINGLE = 1e-4  # of an override, measured 4e-6
ROUNDING = 1e-12  # of an override
SYSTEMS = {"roughness": "SURF", "adaptive-force": "LYAP"}


@pytest.fixture(params=SYSTEMS)
def system(request):
    return request.param


@pytest.fixture
def pf(system):
    return of_paper(system)


def of_paper(system):
    file = published(SYSTEMS[system])
    if system == "adaptive-force":
        return file
    return changed(file, spindle_speed=610.0)


def changed(file, **fields):
    name = "roughness" if file.roughness is not None else "adaptive_force"
    return sealed(file, **{name: {**getattr(file, name).model_dump(), **fields}})


def gated(file):
    return (gated_adaptive_force if file.roughness is None else gated_roughness)(file, accept_verdict=True)


@pytest.fixture
def loop(pf):
    return gated(pf).loop


def inputs_of(loop, seed=0, samples=1500):
    rows = sequence(loop, seed, samples)
    rows[:, 1] *= loop.reference / 0.22  # the levels of the sequence, about the reference
    half, lossy = samples // 2, 7 * loop.samples(loop.lost_after)
    rows[half - loop.samples(loop.arm_after) : half + lossy, 3:5] = 1.0
    rows[half : half + lossy : 2, 1] = np.nan  # every second reading
    return rows


def gaps_of(loop, seed, samples=1500):
    """A cut whose force ripples, with gaps of several lengths, the last of them for long."""
    rows, k = inputs_of(loop, seed, samples), np.arange(samples)
    rows[:, 3:5], rows[:, 5], rows[:, 6], rows[:, 7] = 1.0, 0.0, k // 3 % 2, 0.0
    rows[:, 1] = loop.reference * (1 + 0.3 * np.sin(0.7 * k) + 0.02 * np.random.default_rng(seed).normal(size=samples))
    lost = loop.samples(loop.lost_after)
    for missing, of, part in (
        (lost - 1, 6 * lost, k < 800),
        (max(lost // 5, 1), 6 * lost // 5, k < 1200),
        (1, 10, k >= 1200),
    ):
        rows[(k % of < missing) & part & (k > 600), 1] = np.nan
    return rows


def interrupted_of(loop, seed, samples=1500):
    """Cuts whose force is zero between teeth, and air."""
    rows, k = gaps_of(loop, seed, samples), np.arange(samples)
    rng = np.random.default_rng(seed)
    force = np.maximum(np.sin(4 * np.pi * k / loop.average + 0.3), 0.0) * np.pi * loop.reference * (k / samples + 0.5)
    rows[:, 1] = np.where(k // 300 % 2 == 0, force, 0.0) + 0.002 * loop.reference * rng.normal(size=samples)
    rows[1100:1103, 1] = np.nan
    return rows


# the same numbers


def test_the_c_text_is_the_python_controller_in_every_sample(loop):
    for rows in (inputs_of(loop, 0), inputs_of(loop, 3), gaps_of(loop, 1), interrupted_of(loop, 1)):
        np.testing.assert_array_equal(interpreted(c_controller(loop))(rows), reference(loop, rows))


def test_the_sequences_reach_the_states_of_the_table(loop):
    reached = np.concatenate([reference(loop, inputs_of(loop, seed)) for seed in range(4)])
    assert {0, 2, 3, 5} <= set(reached[:, 2])
    assert (reached[:, 2] == 3).mean() > 0.1


@pytest.mark.parametrize("rows_of", [inputs_of, gaps_of, interrupted_of])
def test_the_function_block_is_the_python_controller_in_every_sample(pf, loop, rows_of):
    rows = rows_of(loop, 1)
    rows[:, 2] = loop.feed_programmed
    block, found = FunctionBlock(structured_text(gated(pf))), []
    for row in rows.tolist():
        on = [value > 0 for value in row[3:]]
        block.call(
            LOAD=row[1], ENABLE=on[0], SPINDLE_ON=on[1], MOTION_IDLE=on[2], BEAT=on[3], RESET=on[4], SLOWED=on[5]
        )
        found.append([block[name.upper()] for name in OUTPUTS])
    expected = reference(loop, rows)
    assert np.abs(np.array(found, float) - expected)[:, [0, 2, 3, 4, 5, 6]].max() <= ROUNDING


def test_the_settings_stand_in_the_c_text_in_their_order(loop):
    c = evaluated(c_controller(loop))
    assert [name for name, _ in c["load_settings"]._members] == list(c_settings(loop))
    assert {name: getattr(c["load_settings"], name) for name in c_settings(loop)} == c_settings(loop)


@pytest.mark.parametrize(
    ("name", "value"),
    [("law", 3), ("approach", 2.0), ("servo_time", -1.0), ("m", float("nan")), ("g3", -1.0), ("Kd", 0.0), ("lam", 0.0),
     ("model_time", 0.0), ("model_d", float("inf"))],
)  # fmt: skip
def test_a_setting_of_the_law_out_of_range_is_refused_by_its_number(name, value):
    loop = gated(of_paper("adaptive-force")).loop
    c = evaluated(c_controller(loop))
    setattr(c["load_settings"], name, value)
    assert c["load_control_init"](c["load_settings"], c["new"]("LoadState")) == list(c_settings(loop)).index(name) + 1


class Exported:
    """The evaluated C text as a controller of a replay; an override of 1 commands ``full``."""

    def __init__(self, loop, full) -> None:
        self.full = full
        self.loop, self.c, self.reference = loop, evaluated(c_controller(loop)), loop.reference
        self.state, self.inputs, self.out = (self.c["new"](name) for name in ("LoadState", "LoadInput", "LoadOutput"))
        assert self.c["load_control_init"](self.c["load_settings"], self.state) == 0
        self.command, self.k = loop.low * full, 0

    @property
    def worn(self):
        return self.out.worn

    def step(self, force, dt):
        row = [dt, force, self.loop.feed_programmed, 1, 1, 0, self.k // 3 % 2, 0, self.inputs.slowed]
        self.k += 1
        for name, value in zip(INPUTS, row, strict=True):
            setattr(self.inputs, name, value)
        self.c["load_control_step"](self.c["load_settings"], self.state, self.inputs, self.out)
        self.command = self.out.feed_override * self.full
        return self.command


def armed(loop, full=None):
    """The exported controller with its spindle running for arm_after, as the replay begins."""
    made = Exported(loop, full or loop.feed_high)
    made.state.spindle = made.state.n_arm
    made.state.alive, made.state.begun = made.state.n_beat, 1
    return made


@pytest.mark.parametrize("noise", [0.0, 0.003])  # A
def test_the_closed_loop_of_constant_load_through_the_exported_code_is_the_replay(noise):
    """A tool from sharp to worn, with the passes of the replay: each command, load and wear, and the tool change."""
    pf = published("CLM-2023")
    loop = loop_of(pf)
    run = constant_load_run(pf, plant=MillingCut.from_parameters(pf, noise=noise))
    samples, exported = len(run.trace.time), armed(loop, 1.0)
    found = replay(
        exported, MillingCut.from_parameters(pf, noise=noise), duration=samples * loop.sample_time,
        dt=loop.sample_time, seed=1, record=("wear", "worn"),
    )  # fmt: skip
    assert run.worn
    assert len(run.passes) > 10
    np.testing.assert_allclose(found.command, run.trace.command, rtol=1e-12)
    np.testing.assert_allclose(found.measurement, run.trace.measurement, rtol=1e-12)
    np.testing.assert_allclose(found.recorded["wear"], run.trace.recorded["wear"], rtol=1e-12)
    assert np.flatnonzero(found.recorded["worn"]).tolist() == [samples - 1]


def test_the_closed_loop_of_constant_roughness_through_the_exported_code_is_the_replay():
    pf = of_paper("roughness")
    cut, loop = turn(pf, duration=6.0), gated(pf).loop
    controller = armed(loop)
    approach = ConstantRoughness.from_parameters(pf)
    for _ in range(loop.samples(approach.wait + 2.0) + 2):
        controller.step(0.0, loop.sample_time)
    plant = TurningForce.from_parameters(pf, feed=controller.command)
    found = replay(controller, plant, duration=6.0, dt=loop.sample_time, seed=1)
    np.testing.assert_allclose(found.command, cut.trace.command, rtol=1e-12)
    np.testing.assert_allclose(found.measurement, cut.trace.measurement, rtol=1e-12)


def test_the_closed_loop_of_adaptive_force_through_the_exported_code_is_the_replay():
    pf = of_paper("adaptive-force")
    run = steady_run(pf, 1.0, ripple=0.3, noise=2.0, duration=1.2)
    loop = gated(pf).loop
    again = type(run.plant)(**{name: getattr(run.plant, name) for name in ("depth", "m", "d", "c", "k_per_depth")},
                            ripple=0.3, noise=2.0, tooth_frequency=run.plant.tooth_frequency)  # fmt: skip
    found = replay(armed(loop), again, duration=1.2, dt=loop.sample_time, seed=1)
    np.testing.assert_allclose(found.command, run.trace.command, rtol=1e-9)
    np.testing.assert_allclose(found.measurement, run.trace.measurement, rtol=1e-9, atol=1e-9)


class Slowed:
    """The cut of a file whose path has half of the commanded feed from 3 to 6 s, by the operator's override."""

    def __init__(self, pf, control, feed) -> None:
        self.plant = (
            TurningForce.from_parameters(pf, feed=feed) if pf.roughness else DriveAndCut.from_parameters(pf, 1.0)
        )
        self.control, self.time = control, 0.0

    def step(self, command, dt, noise):
        self.time, slowed = self.time + dt, 3 < self.time < 6
        self.control.inputs.slowed = int(slowed)
        return self.plant.step(command * (0.5 if slowed else 1.0), dt, noise) * (1 + 1e-6 * noise.normal())


def test_a_feed_slowed_from_outside_is_not_compensated(pf, loop):
    """The feed rose to its upper limit, twice what it was, and adaptive force had it at once after the return."""
    control = armed(loop)
    trace = replay(control, Slowed(pf, control, control.command), duration=9.0, dt=loop.sample_time, seed=1)
    before = trace.command[(trace.time > 2) & (trace.time < 3)]
    assert before.max() < 0.95 * loop.feed_high
    assert trace.command[(trace.time > 3) & (trace.time < 6)].max() <= before.max()
    assert trace.command[trace.time > 6].max() < 1.1 * before.max()


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_sensor_that_stands_still_raises_the_feed_at_recover(pf, loop, share):
    """It rose to the upper limit in one sample, and stayed there until the fault, 1 s later."""
    control = armed(loop)
    replay(control, Slowed(pf, control, control.command), duration=2.5, dt=loop.sample_time, seed=1)
    before, feeds = control.out.u, []
    for _ in range(loop.samples(loop.stuck_after) - 1):
        control.step(share * loop.reference, loop.sample_time)
        feeds.append(control.out.u)
    assert control.out.fault == 0
    rise = loop.recover * loop.sample_time * np.arange(1, len(feeds))
    assert (np.array(feeds[1:]) <= before + rise + 1e-12).all()
    assert max(feeds) > before


# what is refused before an export


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"feed": 5.08}, "above 1.5 mm/rev"),  # 0.2 inch per revolution, converted twice
        ({"override_high": 100.0}, "above 1.5 mm/rev"),
        ({"override_high": 100.0, "nose_radius": 0.8}, "above the nose radius of 0.8 mm"),
        ({"override_high": 2.1, "nose_radius": 0.8}, "is too large. Ideal feed marks at"),
        ({"force_per_feed": 2781.0 / 25.4}, "check the units"),
        ({"force_per_feed": 2781.0 * 25.4}, "check the units"),
        ({"depth": 0.001}, "specific cutting force"),
        ({"sample_time": 0.1}, "at most half of the shorter one"),
    ],
)
def test_a_roughness_section_in_a_wrong_unit_or_without_a_bound_is_refused(fields, words):
    file = changed(of_paper("roughness"), **fields)
    assert any(words in finding.words for finding in check_roughness(file) if finding.passed is False)
    with pytest.raises(GateError, match="not exported"):
        rendered(file, "c", system="roughness", accept_verdict=True)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"high": 600000.0}, "more than 5 times as much"),
        ({"low": 0.5, "high": 10.0}, "check the units of feed and force"),  # mm/s
        ({"Kd": 5.0, "lam": 30.0}, "gain margin of"),
        ({"Kd": 4 * 0.05}, "320 N at 4 mm: the loop would have a gain margin of"),
        ({"g1": 1000 * 2e-5 * 0.15**4}, "the rate g1 is"),
        ({"reference_time": 0.015}, "the rate g1 is"),
        ({"spindle_speed": 100.0}, "mm per revolution"),
    ],
)
def test_an_adaptive_force_section_in_a_wrong_unit_or_without_a_bound_is_refused(fields, words):
    file = sealed(changed(of_paper("adaptive-force"), **fields), limits=None)
    assert any(words in finding.words for finding in check_adaptive_force(file) if finding.passed is False)
    with pytest.raises(GateError, match="not exported"):
        rendered(file, "c", system="adaptive-force", accept_verdict=True)


def test_what_the_file_does_not_state_is_assumed_in_the_head(pf, system):
    text = " ".join(rendered(pf, "c", system=system, accept_verdict=True).replace("\n *", " ").split())
    for words in ("lost_after 0.05 s", "stuck_after 1 s", "overload above", "dwell 4 s on the lower limit"):
        assert words in text
    assert "not detected" in text


def test_an_export_in_linuxcnc_needs_the_speed_of_the_spindle():
    file = changed(of_paper("roughness"), spindle_speed=None)
    with pytest.raises(GateError, match="no spindle_speed"):
        rendered(file, "comp", system="roughness")
    text = rendered(of_paper("roughness"), "comp", system="roughness")
    assert "feed in mm/min, override = feed / 183" in text


@pytest.mark.parametrize(
    ("system", "title"),
    [
        ("roughness", "Constant roughness by feed override"),
        ("adaptive-force", "Adaptive force control by feed override"),
    ],
)
def test_the_component_states_what_it_controls_and_where_its_force_is_from(system, title):
    text = rendered(of_paper(system), "comp", system=system, accept_verdict=True)
    assert f'component fm_control "{title}: the controller of one tool.";' in text
    assert "YOUR-LOAD-PIN            float, N: cutting force from its sensor\n" in text
    assert "spindle current" not in text
    assert "onstant load" not in text.split("component fm_control")[1].split(";;")[0]


def test_the_fmu_names_every_cause_of_the_c(system):
    made = rendered(of_paper(system), "fmu", system=system, accept_verdict=True)
    with ZipFile(BytesIO(made)) as archive:
        causes = re.search('of the fault: [^"]*', archive.read("modelDescription.xml").decode())[0]
        c = archive.read("sources/controller.c").decode()
    names = re.search(r"LOAD_NO_CAUSE,(.*?)} LoadCause", c, re.DOTALL)[1]
    assert [int(k) for k in re.findall(r"\d", causes)] == list(range(1, 1 + len(re.findall("LOAD_[A-Z_]+", names))))


# compiled


@pytest.mark.consumer
@pytest.mark.parametrize(("real", "within"), [("double", 0.0), ("float", SINGLE)])
def test_the_compiled_c_is_the_python_controller(consumer, loop, tmp_path, real, within):
    text = c_controller(loop)
    options = [*STRICT, f"-DLOAD_CONTROL_REAL={real}"]
    run = compiled(consumer("cc", INSTALL), text, tmp_path, "-std=c90", *options)
    for seed in range(3):
        rows = inputs_of(loop, seed, 4000)
        found, expected = run(rows), reference(loop, rows)
        assert np.abs(found[:, 0] - expected[:, 0]).max() <= within
        if real == "double":
            np.testing.assert_array_equal(found, expected)


@pytest.mark.consumer
@pytest.mark.parametrize("real", ["double", "float"])
def test_garbage_leaves_every_output_inside_its_limits(consumer, loop, tmp_path, real):
    (tmp_path / "controller.c").write_text(c_controller(loop))
    options = ["-O1", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
    garbage = Path(__file__).with_name("load_control_garbage.c")
    made = [consumer("cc", INSTALL), *options, f"-DLOAD_CONTROL_REAL={real}", f"-I{tmp_path}", garbage, "-o", "garbage"]
    subprocess.run(made, cwd=tmp_path, check=True)
    ran = subprocess.run([tmp_path / "garbage", "500000", "7"], capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    loops, steps, outside, fault, *_ = map(int, ran.stdout.split())
    assert (steps, outside) == (500000, 0)
    assert loops > 100
    assert fault > 1000


@pytest.mark.consumer
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_fmpy_runs_the_fmu_as_the_python_controller(consumer, fmpy, pf, system, loop, tmp_path):  # noqa: F811
    consumer("cmake", "apt-get install cmake gcc g++")
    model = started(fmpy, rendered(pf, "fmu", system=system, accept_verdict=True), tmp_path)
    rows = inputs_of(loop, 6, 1500)
    found = [step(model, k, row, loop.sample_time) for k, row in enumerate(rows.tolist())]
    assert np.abs(np.array(found, float) - reference(loop, rows)).max() == 0
    model.terminate()
    model.freeInstance()


@pytest.mark.consumer
def test_linuxcnc_runs_the_component(machine, pf, system):  # noqa: F811
    """Inputs by streamer, outputs by sampler, in a thread of the controller's own period."""
    text, samples = rendered(pf, "comp", system=system, accept_verdict=True), 1500
    loop = gated_roughness(pf, per_minute=True).loop if system == "roughness" else gated(pf).loop
    rows = inputs_of(loop, 9, samples)
    rows[:, 2] = loop.feed_programmed
    rows[~np.isfinite(rows[:, 1]) | (np.abs(rows[:, 1]) > 1e5), 1] = -9000.0  # streamer reads plain numbers
    lines = "\n".join(line[4:] for line in text.splitlines() if line.startswith("//| "))
    for pin in ("requested motion.requested-vel", "velocity motion.current-vel"):
        lines = lines.replace(f"net fm-{pin} =>", f"net fm-{pin.split()[0]} =>")
    found = streamed(machine, text, lines, rows, loop.feed_programmed / 60)
    expected = reference(loop, rows)
    assert np.abs(found[:, 0] - expected[:, 0]).max() <= PRINTED
    assert np.abs(found[:, 1] - expected[:, 1]).max() <= 1e-5
    assert [name for k, name in enumerate(OUTPUTS) if k > 1 and (found[:, k] != expected[:, k]).any()] == []


def test_the_python_names_still_make_the_controllers():
    control = AdaptiveForceControl.from_parameters(of_paper("adaptive-force"), 1.0)
    assert control.control.loop == gated(of_paper("adaptive-force")).loop
    pf = of_paper("roughness")
    assert ConstantRoughness.from_parameters(pf).loop == gated(pf).loop


def limited(**limits):
    return sealed(of_paper("adaptive-force"), limits=limits)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"feed_rate": {"low": 10.0, "high": 300.0, "unit": "mm/min"}}, "set points need 200 to 375.1 mm/min"),
        ({"feed": {"low": 0.001, "high": 0.005, "unit": "mm/rev"}}, "an empty range"),
        (
            {"spindle_speed": {"low": 100.0, "high": 200.0, "unit": "1/min"}},
            "100 to 200 1/min, but adaptive_force is of",
        ),
        ({"spindle_speed": {"low": 70.0, "high": 100.0, "unit": "rev/s"}}, "4200 to 6000 1/min"),
    ],
)
def test_limits_of_feed_and_spindle_speed_that_exclude_the_control_are_refused(limits, words):
    """They were not read: limits of 10 to 300 mm/min, and the export commanded up to 500."""
    file = limited(**limits)
    assert any(words in f.words for f in check_adaptive_force(file) if f.passed is False)
    with pytest.raises(GateError, match="not exported"):
        gated_adaptive_force(file, accept_verdict=True)
    with pytest.raises(GateError):
        AdaptiveForceControl.from_parameters(file, 1.0)


def test_limits_of_feed_narrow_the_command_of_adaptive_force():
    file = limited(feed={"low": 0.05, "high": 0.14, "unit": "mm/rev"})  # 150 to 420 mm/min at 3000 1/min
    loop = gated_adaptive_force(file, accept_verdict=True).loop
    assert (loop.feed_low, loop.feed_high) == pytest.approx((150.0, 420.0))
    assert not [f for f in check_adaptive_force(file) if f.passed is False]


@pytest.mark.parametrize("kind", ["ini", "h", "ngc", "ssv", "mat"])
@pytest.mark.parametrize(("name", "fields"), [("roughness", {"feed": 5.08}), ("adaptive-force", {"beta": -1.25})])
def test_values_of_a_force_control_that_fails_its_gate_are_not_exported(kind, name, fields):
    """They were written without a word, where those of constant load were refused."""
    file = changed(of_paper(name), **fields)
    with pytest.raises(GateError, match="not exported: "):
        rendered(file, kind, accept_verdict=True)
    assert rendered(of_paper(name), kind, accept_verdict=True)


def test_the_nose_radius_is_exported_in_its_unit():
    file = changed(of_paper("roughness"), nose_radius=0.8)
    (found,) = (q for q in file_quantities(file, None) if q.name == "roughness_nose_radius")
    assert (found.value, found.unit) == (0.8, "mm")


TESTED = {"tested": "command 150 to 550 mm/min, force 32 to 400 N: smallest and largest values of run.csv"}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"beta": -1.25}, "the force falls when the feed rises; check the sensor's sign"),
        ({"beta": -1.25, "low": 0.0}, "the force falls when the feed rises; check the sensor's sign"),
        ({"low": 0.0}, "0 < low < high"),
        ({"alpha": 0.0125}, "complex or unstable poles"),
        ({"unit_u": "mm/s", "sources": TESTED}, "is in mm/s and N, its record in mm/min and N"),
        ({"unit_force": "kN", "sources": TESTED}, "is in mm/min and kN, its record in mm/min and N"),
        ({"unit_u": "mm/s"}, "12 mm per revolution at 3000 1/min"),
        ({"unit_force": "kN"}, "320 kN is above the 20000 N of milling"),
        ({"spindle_speed": 3e5}, "average_time 0.02 s is 100 revolutions at 300000 1/min"),
        ({"high": 900.0, "sources": TESTED}, "the command up to 900 mm/min, tested up to 550 mm/min"),
        ({"force_high": 1e300}, "so that none is invalid"),
        ({"force_low": -1e5}, "so that none is invalid"),
        ({"reference_damping": 1e300}, r"reference_damping 1e+300: give 0.1 to 10"),
        ({"reference_time": 1e300}, "at most 10000 s"),
        ({"m": 1e-300}, "unstable poles|too large or too small"),
    ],
)
def test_an_adaptive_force_section_that_contradicts_itself_fails_the_check(fields, words):
    """A reversed sensor was a note, the others passed or ended in an internal error."""
    found = check_adaptive_force(sealed(changed(of_paper("adaptive-force"), **fields), limits=None))
    failed = " ".join(f.words for f in found if f.passed is False)
    assert any(each in failed for each in words.split("|")), failed


def test_an_upper_limit_beyond_the_tests_that_was_allowed_passes():
    sources = {**TESTED, "high": "given; allowed beyond the tests: the command up to 900 mm/min"}
    file = sealed(changed(of_paper("adaptive-force"), high=900.0, sources=sources), limits=None)
    assert not [f.words for f in check_adaptive_force(file) if f.passed is False]


def test_limits_that_adaptive_force_does_not_apply_are_named():
    file = sealed(of_paper("adaptive-force"), limits={"power": {"value": 7.0, "unit": "kW"}})
    (found,) = (f for f in check_adaptive_force(file) if "does not apply limits.power" in f.words)
    assert found.passed is None


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"roughness": 0.16}, "gives a roughness of 1.6 um, and 0.16 um is required"),
        ({"force": 695.0}, "gives a roughness of 2.551 um, and 1.6 um is required"),
        ({"threshold": 0.11}, "below 1 % of the reference"),
        ({"force_high": 1e300}, "so that none is invalid"),
        ({"force_low": -1e5}, "so that none is invalid"),
        ({"force_low": -1100.0}, "where the feed rises; give a smallest valid reading of at least -100 N"),
        ({"servo_time": 1e300}, "time constant of the servo, 1e+300 s, is not 0.001 to 10 s"),
        ({"process_time": 1e300}, "time constant of the process, 1e+300 s, is not 0.001 to 10 s"),
        ({"spindle_speed": 610e3}, "1.83e+05 mm/min at 6.1e+05 1/min, beyond the 20000 mm/min of turning"),
        (
            {"sources": {"process_time": "one revolution at 610 1/min, assumed"}, "process_time": 0.2},
            "which takes 0.098",
        ),
    ],
)
def test_a_roughness_section_that_contradicts_its_law_or_itself_fails_the_check(fields, words):
    """All passed, or ended in an internal error (times of 1e300 s)."""
    good = of_paper("roughness")
    force = math.log(1.6 / good.laws["Ra"].coefficients["a"]) / good.laws["Ra"].coefficients["b"]
    file = changed(good, **{"roughness": 1.6, "force": force, **fields})
    assert not [f.words for f in check_roughness(changed(good, roughness=1.6, force=force)) if f.passed is False]
    failed = " ".join(f.words for f in check_roughness(file) if f.passed is False)
    assert words in failed, failed
    with pytest.raises(GateError, match="not exported"):
        rendered(file, "ini", accept_verdict=True)


def test_a_reference_far_above_the_tests_of_the_law_needs_a_reason():
    good = of_paper("roughness")
    laws = good.model_dump()["laws"]
    laws["Ra"]["factors"] = [{**laws["Ra"]["factors"][0], "low": 5.0, "high": 9.0}]
    failed = " ".join(f.words for f in check_roughness(sealed(good, laws=laws)) if f.passed is False)
    assert "times the largest of the tests of Ra, 9 N" in failed
    notes = ["EXTRAPOLATED: The reference force lies above the tests of Ra. Accepted: trial cut."]
    assert not [f for f in check_roughness(sealed(changed(good, notes=notes), laws=laws)) if f.passed is False]


def test_a_reversed_sensor_from_power_on_that_reads_air_fails_the_simulation(monkeypatch):
    """With readings valid from -1100 N the feed rose from its lower limit to the programmed one, without a fault."""
    file = changed(of_paper("roughness"), force_low=-1101.0)  # not the file above, whose findings are kept
    monkeypatch.setattr("fitmodels.controllers.gate.roughness.contradictions", lambda pf: iter(()))
    failed = " ".join(f.words for f in check_roughness(file) if f.passed is False)
    assert "a power cycle in the cut with a reversed sensor raises the feed to" in failed


def test_a_reversed_sensor_that_adaptive_force_takes_for_air_is_named():
    file = changed(of_paper("adaptive-force"), force_low=-200.0)
    named = [f.words for f in check_adaptive_force(file) if f.passed is None and f.name == "readings"]
    assert "of reversed sign reads -12 N in a cut" in "".join(named)


@pytest.mark.parametrize("number", range(1, 9))
@pytest.mark.parametrize("force_from", ["inverse", "regression"])
def test_every_published_cut_of_constant_roughness_agrees_with_its_law(number, force_from):
    assert not list(contradictions(surf(number, force_from=force_from)))
