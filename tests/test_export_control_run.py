"""LinuxCNC runs the component and FMPy the FMU: both are `controllers.ConstantLoad` sample by sample."""

import fcntl
import importlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from fitmodels.controllers.exports import rendered
from fitmodels.parameters.exports.loop import loop_settings

sys.path.insert(0, str(Path(__file__).parent))

from load_control import OUTPUTS, reference, sequence

sys.path.remove(str(Path(__file__).parent))

INSTALL = "apt-get install linuxcnc-uspace linuxcnc-uspace-dev"
PRINTED = 1e-6  # halsampler prints six decimals
MODULES = Path("/usr/lib/linuxcnc/modules")


def described(fmu: bytes) -> ET.Element:
    with zipfile.ZipFile(BytesIO(fmu)) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))  # noqa: S314  our own text


def test_the_model_description_has_the_numbers_of_the_loop_and_of_the_source(constant_load_file):
    fmu, loop = rendered(constant_load_file(), "fmu"), loop_settings(constant_load_file()).loop
    root = described(fmu)
    assert float(root.find("DefaultExperiment").get("stepSize")) == loop.sample_time
    first = {v.get("name"): v[0].get("start") for v in root.iter("ScalarVariable")}
    assert (float(first["requested"]), float(first["load"])) == (loop.feed_programmed, 0.0)
    assert float(first["feed_override"]) == float(first["u"]) == loop.low
    with zipfile.ZipFile(BytesIO(fmu)) as archive:
        source = archive.read("sources/fmi2.c").decode()
        assert archive.read("sources/controller.c").decode() == rendered(constant_load_file(), "c")
    assert f'#define FMU_GUID "{root.get("guid")}"' in source
    for kind in ("Real", "Integer", "Boolean"):
        (listed,) = re.findall(rf"^#define {kind.upper()}S\(INPUT, OUTPUT\) (.*)$", source, re.MULTILINE)
        found = re.findall(r"(INPUT|OUTPUT)\((\d+), (\w+)\)", listed)
        assert {(causality.lower(), int(number), name) for causality, number, name in found} == {
            (v.get("causality"), int(v.get("valueReference")), v.get("name"))
            for v in root.iter("ScalarVariable") if v[0].tag == kind
        }  # fmt: skip


@pytest.mark.parametrize("name", ['"/><x y="', "]]> &xxe; %s", "-- <!--", "\u202egnp"])
def test_a_nasty_name_stays_text_of_the_model_description(constant_load_file, name):
    nasty = described(rendered(constant_load_file(identity={"tool": name, "work": name, "machine": name}), "fmu"))
    usual = described(rendered(constant_load_file(), "fmu"))
    assert [child.tag for child in nasty.iter()] == [child.tag for child in usual.iter()]
    assert set(nasty.attrib) == set(usual.attrib)


def test_another_loop_has_another_guid(constant_load_file):
    one, other = (described(rendered(constant_load_file(pi={"kp": kp}), "fmu")).get("guid") for kp in (300.0, 310.0))
    assert one != other


@pytest.fixture
def fmpy():
    try:
        return importlib.import_module("fmpy")
    except ImportError:
        missing = "FMPy is not installed: pip install FMPy"
        pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)


def started(fmpy, content, folder):
    """The compiled model of an FMU without faults, initialised."""
    (folder / "build").mkdir()
    (folder / "fm.fmu").write_bytes(content)
    assert importlib.import_module("fmpy.validation").validate_fmu(str(folder / "fm.fmu")) == []
    unzipped = fmpy.extract(str(folder / "fm.fmu"), str(folder / "fm"))
    importlib.import_module("fmpy.build").build_platform_binary(unzipped, folder / "build", all_warnings=True)
    model = fmpy.instantiate_fmu(unzipped, fmpy.read_model_description(unzipped), fmi_type="CoSimulation")
    model.setupExperiment()
    model.enterInitializationMode()
    model.exitInitializationMode()
    return model


@pytest.mark.consumer
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_fmpy_validates_compiles_and_runs_the_fmu(consumer, fmpy, constant_load_file, tmp_path):
    consumer("cmake", "apt-get install cmake gcc g++")
    loop = loop_settings(constant_load_file()).loop
    model = started(fmpy, rendered(constant_load_file(), "fmu"), tmp_path)
    inputs = sequence(loop, 6, samples=4000)
    expected, found = reference(loop, inputs), []
    for k, row in enumerate(inputs.tolist()):
        if k == 2000:
            kept = model.getFMUState()
        if k == 3000:  # back to sample 2000, and through it again
            model.setFMUState(kept)
            model.freeFMUState(kept)
            for again, more in enumerate(inputs[2000:3000].tolist(), 2000):
                assert step(model, again, more, loop.sample_time) == found[again]
        found.append(step(model, k, row, loop.sample_time))
    assert np.abs(np.array(found, float) - expected).max() == 0
    with pytest.raises(Exception, match="fmi2DoStep failed"):
        model.doStep(0.0, 1.5 * loop.sample_time)
    model.terminate()
    model.freeInstance()


def step(model, k, row, period):
    """Outputs of the FMU after a step, in the order of OUTPUTS."""
    model.setReal([0, 1], row[1:3])
    model.setBoolean([0, 1, 2, 3, 4, 5], [value > 0 for value in row[3:]])
    model.doStep(k * period, period)
    bits = [bool(bit) for bit in model.getBoolean([10, 11, 12, 13])]
    return [model.getReal([10])[0], model.getReal([12])[0], model.getInteger([0])[0], *bits]


HALRUN = """\
set -e
mount --bind {modules} original
for module in original/*.so; do ln -s "$PWD/$module" modules/; done
mv {name}.so modules/
mount --bind modules {modules}
exec halrun -f test.hal
"""


@pytest.fixture
def machine(consumer):
    """Compile a component and run HAL text with it, in namespaces where it lies among the modules of LinuxCNC."""
    compiler = consumer("halcompile", INSTALL)
    consumer("halrun", INSTALL)
    root = os.geteuid() == 0
    unshare = [
        "unshare",
        "--mount",
        "--ipc",
        "--pid",
        "--fork",
        "--kill-child",
        "--mount-proc",
        "--propagation",
        "private",
    ]
    unshare += [] if root else ["--user", "--map-root-user"]
    if subprocess.run([*unshare, "true"], capture_output=True).returncode:
        missing = "mount namespaces are switched off here, so a module cannot be shown to LinuxCNC"
        pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-comp-"))
    folder.chmod(0o777)

    def run(component: str, hal: str) -> subprocess.CompletedProcess[str]:
        name = re.search(r"^component (\w+)", component, re.MULTILINE)[1]
        (folder / f"{name}.comp").write_text(component)
        made = subprocess.run([compiler, "--compile", f"{name}.comp"], cwd=folder, capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        assert "warning" not in made.stderr
        (folder / "test.hal").write_text(hal)
        (folder / "run.sh").write_text(HALRUN.format(modules=MODULES, name=name))
        for part in ("original", "modules"):
            (folder / part).mkdir()
        env = {**os.environ, "RTAPI_UID": "65534", "RTAPI_FIFO_PATH": str(folder / "fifo")}
        with (Path(tempfile.gettempdir()) / "fitmodels-halrun.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return subprocess.run(
                [*unshare, "bash", "run.sh"], cwd=folder, env=env, capture_output=True, text=True, timeout=120
            )

    run.folder = folder
    yield run
    shutil.rmtree(folder, ignore_errors=True)


def streamed(machine, component, lines, inputs, requested, operator=1.0):
    """Outputs of a component, from streamer to sampler: a row a period; inputs as in `INPUTS`, requested per s.

    A feed that is slowed is that of the path, at 3 % of the requested one.
    """
    thread = "servo-thread" if "addf fm-control servo-thread" in lines else "fm-thread"
    motion = [("addf motion-command-handler servo-thread",), ("addf motion-controller servo-thread",)]
    before, after = motion if thread == "servo-thread" else ((), ())
    speeds = np.where(inputs[:, 8] > 0, 0.03, 2.0) * requested * operator
    rows = "".join(
        f"{r[1]!r} {speed!r} {' '.join(str(int(v)) for v in r[3:8])}\n"
        for r, speed in zip(inputs.tolist(), speeds.tolist(), strict=True)
    )
    (machine.folder / "inputs").write_text(rows)
    signals = ("fm-load", "fm-velocity", "fm-enable", "fm-spindle-on", "fm-idle", "fm-heartbeat", "fm-reset")
    sampled = ("feed", "measured", "state", "fault", "worn", "overload", "inhibit")
    hal = (
        "loadrt trivkins", "loadrt tpmod", "loadrt homemod",
        "loadrt motmod servo_period_nsec=1000000 num_joints=3",
        "loadrt streamer depth=4000 cfg=ffbbbbb", "loadrt sampler depth=4000 cfg=ffsbbbb",
        lines.replace("# >>> setp ", "setp ").replace(f"addf fm-control {thread}", ""),
        f"sets fm-operator {operator!r}", f"sets fm-requested {requested!r}",
        *(f"net {name} streamer.0.pin.{k}" for k, name in enumerate(signals)),
        "net fm-measured fm-control.measured", "net fm-state fm-control.state",
        *(f"net fm-{name} sampler.0.pin.{k}" for k, name in enumerate(sampled)),
        *before, f"addf streamer.0 {thread}", f"addf fm-control {thread}", *after, f"addf sampler.0 {thread}",
        f"loadusr -w halstreamer {machine.folder}/inputs", "start",
        f"loadusr -w halsampler -t -n {len(inputs)} {machine.folder}/trace", "",
    )  # fmt: skip
    made = machine(component, "\n".join(hal))
    assert (machine.folder / "trace").exists(), made.stdout + made.stderr
    trace = (machine.folder / "trace").read_text().splitlines()
    assert len(trace) == len(inputs), made.stderr
    return np.array([line.split()[1:] for line in trace], float)


@pytest.mark.consumer
def test_linuxcnc_runs_the_component(machine, constant_load_file):
    """Its head's HAL lines connect it to motmod's pins; streamer gives the inputs, sampler takes the outputs."""
    pf, samples = constant_load_file(0.001), 2500
    loop, text = loop_settings(pf).loop, rendered(pf, "comp")
    inputs = sequence(loop, 9, samples)
    inputs[:, 2] = loop.feed_programmed
    inputs[~np.isfinite(inputs[:, 1]) | (np.abs(inputs[:, 1]) > 100), 1] = 0.0  # streamer reads plain numbers
    lines = "\n".join(line[4:] for line in text.splitlines() if line.startswith("//| "))
    assert "net fm-requested motion.requested-vel => fm-control.requested-vel" in lines
    lines = lines.replace("net fm-requested motion.requested-vel =>", "net fm-requested =>")  # motmod is at rest here
    assert "# >>> setp fm-control.feed-scale 60" in lines
    lines = lines.replace("net fm-velocity motion.current-vel =>", "net fm-velocity =>")
    found = streamed(machine, text, lines, inputs, loop.feed_programmed / 60 / 1.25, operator=1.25)
    expected = reference(loop, inputs)
    assert np.abs(found[:, :2] - expected[:, :2]).max() <= PRINTED
    assert [name for k, name in enumerate(OUTPUTS) if k > 1 and (found[:, k] != expected[:, k]).any()] == []
