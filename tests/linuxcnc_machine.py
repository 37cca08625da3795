"""The whole LinuxCNC without display: a machine that runs a G-code program through an exported file, in real time.

The program runs in namespaces of its own, as the clean-up of LinuxCNC ends every ``milltask`` and its shared memory is
global. The plant, with wear and faults, is ``linuxcnc_plant.comp``, compiled by halcompile; `halsampler` records each
period of the servo thread from the first.
"""

import math
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
PERIOD = 0.002  # s, of the servo thread
MODULES = Path("/usr/lib/linuxcnc/modules")
PROGRAMS = {
    "linuxcnc": "apt-get install linuxcnc-uspace",
    "halcompile": "apt-get install linuxcnc-uspace-dev",
    "cc": "apt-get install gcc libc6-dev",
    "unshare": "apt-get install util-linux",
}
EVENTS = {"value": 1, "hold": 2, "dead": 3, "spindle": 4, "enable": 5, "reset": 6, "load": 7, "beat": 8}
RECORDED = (
    ("load", "f", "fm-load"), ("u", "f", "fm-feed"), ("feed", "f", "plant-feed"), ("current", "f", "plant-current"),
    ("wear", "f", "plant-wear"), ("seconds", "f", "plant-seconds"), ("request", "f", "plant-request"),
    ("cutting", "b", "plant-cutting"), ("enable", "b", "fm-enable"), ("spindle", "b", "fm-spindle-on"),
    ("idle", "b", "fm-idle"), ("beat", "b", "fm-heartbeat"), ("reset", "b", "fm-reset"), ("fault", "b", "fm-fault"),
    ("worn", "b", "fm-worn"), ("overload", "b", "fm-overload"), ("inhibit", "b", "fm-inhibit"),
    ("active", "s", "plant-active"),
)  # fmt: skip
_TO_PLANT = {
    "motion.requested-vel": "requested", "halui.feed-override.value": "override", "spindle.0.on": "spindle-on",
    "motion.current-vel": "velocity",
}  # fmt: skip
_OPEN = {"override": "fm-operator", "velocity": "fm-velocity"}  # signals that an export leaves to the machine
_FROM_PLANT = {
    "fm-load": "load", "plant-feed": "feed", "plant-current": "current", "plant-wear": "wear",
    "plant-seconds": "seconds", "plant-request": "request", "plant-cutting": "cutting", "plant-active": "active",
    "fm-enable": "enable", "fm-spindle-on": "spindle", "fm-idle": "idle", "fm-heartbeat": "beat", "fm-reset": "reset",
}  # fmt: skip


@dataclass(frozen=True)
class Event:
    """A fault, or a reset, from ``at`` to ``until``, in s after the first contact; ``at`` below 0: from the start."""

    kind: str
    at: float
    until: float = math.inf
    value: float = 0.0


@dataclass(frozen=True)
class Cut:
    """The plant: load line, drive with gain 1 at ``divide`` periods, wear in um, noise in A."""

    A: float
    B: float
    k1: float
    b: Sequence[float]
    a: Sequence[float]
    divide: int = 10
    wear: float = 0.0
    wear_rate: float = 0.0
    noise: float = 0.001
    end: float = 1e9  # mm: where the workpiece ends


@dataclass(frozen=True)
class Run:
    """One run: HAL text of the export, plant, events, program."""

    export: str
    cut: Cut
    feed: float  # mm/min: F of the program
    events: Sequence[Event] = ()
    duration: float = 3.2  # s after the first contact
    override: float = 1.0  # of the operator
    length: float = 1000.0  # mm of the programmed cut
    passes: int = 1
    dwell: float = 1.1  # s from the start of the spindle to the feed
    adaptive: bool = True  # M52 P1
    period: float = PERIOD  # s, of the loop; longer than `PERIOD`: the thread that the export makes
    operator: Sequence[tuple[float, str]] = ()  # s after contact, and "pause", "resume" or an override such as "1.2"
    modules: Mapping[str, Path] = field(default_factory=dict)  # further realtime components


def lacking() -> str:
    """Reason why the whole LinuxCNC cannot run here; empty where it can."""
    for program, install in PROGRAMS.items():
        if shutil.which(program) is None:
            return f"{program} is not installed: {install}"
    tried = subprocess.run([*_namespaces(), "true"], capture_output=True, text=True)
    return "" if tried.returncode == 0 else f"namespaces are off here: {tried.stderr.strip()}"


def _namespaces() -> list[str]:
    """Command that starts a program in namespaces of its own."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-user=1000", "--map-group=1000", "--keep-caps"]
    return [
        "unshare", *user, "--net", "--ipc", "--pid", "--uts", "--mount", "--mount-proc", "--propagation", "private",
        "--fork", "--kill-child",
    ]  # fmt: skip


def compiled(source: Path) -> Path:
    """Path of a realtime component, compiled beside its source."""
    done = subprocess.run(["halcompile", "--compile", source.name], cwd=source.parent, capture_output=True, text=True)
    module = source.with_suffix(".so")
    if done.returncode or not module.exists():
        raise RuntimeError(f"halcompile of {source.name} failed:\n{done.stdout}{done.stderr}")
    return module


def plant_module(folder: Path) -> Path:
    """Path of the compiled plant."""
    source = folder / "fmplant.comp"
    shutil.copy(HERE / "linuxcnc_plant.comp", source)
    return compiled(source)


def run_machine(run: Run, plant: Path) -> dict[str, np.ndarray]:
    """Trace of a run: each recorded quantity, shape (n,), one value per period of the servo thread.

    Raises
    ------
    RuntimeError
        LinuxCNC did not end as it should; the message holds what it printed.
    """
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-machine-"))
    try:
        folder.chmod(0o777)
        _write(run, folder, plant)
        said = subprocess.run(
            [*_namespaces(), "bash", "-c", _INSIDE, str(folder), str(int(run.duration + 30))],
            capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=run.duration + 60,
        )  # fmt: skip
        return _trace(folder, run.duration, said.stdout + said.stderr)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


TURNED = ("x", "z", "velocity", "commanded", "spindle")  # mm, mm, mm/s, rev/s of the program and of the spindle


def run_lathe(program: str, seconds: float) -> dict[str, np.ndarray]:
    """Trace of a turning program on a lathe whose spindle takes its time: each of `TURNED` by period of the servo.

    Raises
    ------
    RuntimeError
        The program did not end within ``seconds``; the message holds what LinuxCNC printed.
    """
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-lathe-"))
    try:
        folder.chmod(0o777)
        (folder / "home").mkdir()
        shutil.copytree(MODULES, folder / "modules")
        files = {
            "machine.ini": _INI, "machine.hal": _LATHE, "fm.hal": "", "wires.hal": "", "driver.py": _LATHE_DRIVER,
            "program.ngc": program, "run.txt": f"{seconds!r}\n", "tool.tbl": "T1 P1 D0 Z0 X0\n", "sim.var": "",
        }  # fmt: skip
        for name, text in files.items():
            (folder / name).write_text(text)
            (folder / name).chmod(0o777)
        (folder / "home").chmod(0o777)
        said = subprocess.run(
            [*_namespaces(), "bash", "-c", _INSIDE, str(folder), str(int(seconds + 30))],
            capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=seconds + 60,
        )  # fmt: skip
        path = folder / "trace"
        text = path.read_text() if path.exists() else ""
        if "program ended" not in said.stdout:
            logs = "".join(f"\n{log.name}:\n{log.read_text()}" for log in (folder / "home").glob("*.txt"))
            raise RuntimeError(f"the program did not end in {seconds:g} s.\n{said.stdout}{said.stderr[-4000:]}{logs}")
        rows = [line.split() for line in text[: text.rfind("\n") + 1].splitlines()]
        values = np.array([row for row in rows if len(row) == 1 + len(TURNED)], float)
        return {name: values[:, 1 + k] for k, name in enumerate(TURNED)}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


_INSIDE = """
ip link set lo up 2>/dev/null || true
mount --bind "$0/modules" /usr/lib/linuxcnc/modules || exit 90
mount --bind "$0" /mnt && mount -t tmpfs -o mode=1777 none /tmp || exit 91
chmod 777 /mnt; cd /mnt
[ "$(id -u)" = 0 ] && export RTAPI_UID=65534
exec env -u DISPLAY HOME=/mnt/home RTAPI_FIFO_PATH=/tmp/fifo timeout -k 5 "$1" linuxcnc -r machine.ini </dev/null
"""


def _trace(folder: Path, duration: float, said: str) -> dict[str, np.ndarray]:
    path = folder / "trace"
    text = path.read_text() if path.exists() else ""
    rows = [line.split() for line in text[: text.rfind("\n") + 1].splitlines()]
    values = np.array([row for row in rows if len(row) == 1 + len(RECORDED)], float).reshape(-1, 1 + len(RECORDED))
    trace = {name: values[:, 1 + k] for k, (name, _, _) in enumerate(RECORDED)}
    ends = np.flatnonzero(trace["seconds"] >= duration)
    if not ends.size:
        logs = "".join(f"\n{log.name}:\n{log.read_text()}" for log in (folder / "home").glob("*.txt"))
        raise RuntimeError(f"{len(values)} samples were recorded, not {duration:g} s of cut.\n{said[-4000:]}{logs}")
    if not (np.diff(values[:, 0]) == 1).all():
        raise RuntimeError("samples were lost: the queue of halsampler was full.")
    return {name: column[: ends[0] + 1] for name, column in trace.items()}


def _write(run: Run, folder: Path, plant: Path) -> None:
    (folder / "home").mkdir()
    modules = folder / "modules"
    shutil.copytree(MODULES, modules)
    for name, module in {"fmplant": plant, **run.modules}.items():
        shutil.copy(module, modules / f"{name}.so")
    files = {
        "machine.ini": _INI, "machine.hal": _MACHINE + _settings(run), "fm.hal": run.export,
        "wires.hal": _wires(run), "driver.py": _DRIVER, "program.ngc": _program(run),
        "run.txt": f"{run.duration!r} {run.override!r}\n", "tool.tbl": "", "sim.var": "",
        "operator.txt": "".join(f"{at!r} {what}\n" for at, what in run.operator),
    }  # fmt: skip
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "driver.py").chmod(0o755)
    for path in [folder / "home", *(folder / name for name in files)]:
        path.chmod(path.stat().st_mode | 0o666)
    (folder / "home").chmod(0o777)


def _settings(run: Run) -> str:
    cut = run.cut
    b, a = [*cut.b, 0.0, 0.0, 0.0][1:4], [*cut.a, 0.0, 0.0, 0.0][1:4]
    values: dict[str, float | int] = {
        "A": cut.A, "B": cut.B, "k1": cut.k1, "divide": cut.divide, "wear-before": cut.wear,
        "wear-rate": cut.wear_rate, "noise": cut.noise, "end": cut.end,
        **{f"b{k}": value for k, value in enumerate(b, 1)}, **{f"a{k}": value for k, value in enumerate(a, 1)},
    }  # fmt: skip
    lines = [f"setp fmplant.0.{name} {value!r}" for name, value in values.items()]
    for k, event in enumerate(run.events):
        until = min(event.until, 1e6)
        lines += [
            f"setp fmplant.0.event-{k} {EVENTS[event.kind]}", f"setp fmplant.0.at-{k} {event.at!r}",
            f"setp fmplant.0.until-{k} {until!r}", f"setp fmplant.0.value-{k} {event.value!r}",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _wires(run: Run) -> str:
    """Nets between plant, export and sampler; a signal that the export does not have is made here."""
    export, lines = run.export, []
    for source, pin in _TO_PLANT.items():
        found = re.search(rf"^net (\S+) .*{re.escape(source)}\b", export, re.M)
        own = _OPEN.get(pin, "")
        signal = found[1] if found else own if own and own in export else f"plant-{pin}"
        lines.append(f"net {signal} {source} fmplant.0.{pin}")
    made = {"fm-idle"} if re.search(r"^net fm-idle .*\.out\b", export, re.M) else set()
    lines += [f"net {signal} fmplant.0.{pin}" for signal, pin in _FROM_PLANT.items() if signal not in made]
    lines += [f"net {signal} sampler.0.pin.{k}" for k, (_, _, signal) in enumerate(RECORDED)]
    thread = "servo-thread" if run.period == PERIOD else "fm-thread"
    lines += [f"addf fmplant.0 {thread} 1", "addf motion-controller servo-thread", f"addf sampler.0 {thread}"]
    kinds = "".join(kind for _, kind, _ in RECORDED)
    return f"loadrt sampler depth=30000 cfg={kinds}\n" + "\n".join(lines) + "\n"


def _program(run: Run) -> str:
    one = f"""M52 P{int(run.adaptive)}
G1 X{run.length:g} F{run.feed:g}
M52 P0
G0 Z20
G0 X0
G0 Z0
"""
    return f"G21 G90 G17 G64\nS6000 M3\nG4 P{run.dwell:g}\n{one * run.passes}G0 Z20\nM2\n"


_INI = f"""\
[EMC]
MACHINE = fitmodels
DEBUG = 0
VERSION = 1.1
[DISPLAY]
DISPLAY = ./driver.py
MAX_FEED_OVERRIDE = 1.5
[TASK]
TASK = milltask
CYCLE_TIME = 0.010
[RS274NGC]
PARAMETER_FILE = sim.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
SERVO_PERIOD = {round(PERIOD * 1e9)}
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.100
TOOL_TABLE = tool.tbl
[HAL]
HALUI = halui
HALFILE = machine.hal
HALFILE = fm.hal
HALFILE = wires.hal
POSTGUI_HALFILE =
[TRAJ]
COORDINATES = X Y Z
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
DEFAULT_LINEAR_VELOCITY = 50
MAX_LINEAR_VELOCITY = 50
DEFAULT_LINEAR_ACCELERATION = 2000
MAX_LINEAR_ACCELERATION = 2000
NO_FORCE_HOMING = 1
[KINS]
KINEMATICS = trivkins coordinates=XYZ
JOINTS = 3
""" + "".join(
    f"""\
[AXIS_{axis}]
MIN_LIMIT = -2000
MAX_LIMIT = 2000
MAX_VELOCITY = 50
MAX_ACCELERATION = 2000
[JOINT_{k}]
TYPE = LINEAR
HOME = 0
MAX_VELOCITY = 50
MAX_ACCELERATION = 2000
MIN_LIMIT = -2000
MAX_LIMIT = 2000
FERROR = 5
MIN_FERROR = 1
HOME_OFFSET = 0
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
HOME_SEQUENCE = 0
"""
    for k, axis in enumerate("XYZ")
)

_MACHINE = """\
loadrt [KINS]KINEMATICS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS
loadrt fmplant count=1
addf motion-command-handler servo-thread
net x-position joint.0.motor-pos-cmd => joint.0.motor-pos-fb fmplant.0.x
net y-position joint.1.motor-pos-cmd => joint.1.motor-pos-fb
net z-position joint.2.motor-pos-cmd => joint.2.motor-pos-fb fmplant.0.z
net estop-loop iocontrol.0.user-enable-out iocontrol.0.emc-enable-in
net tool-prepare iocontrol.0.tool-prepare iocontrol.0.tool-prepared
net tool-change iocontrol.0.tool-change iocontrol.0.tool-changed
"""

_SWITCHED_ON = """\
#!/usr/bin/python3
# The user interface: switches the machine on, then runs the program and ends with it or with its trace.
import signal
import subprocess
import sys
import time

import linuxcnc

command, state = linuxcnc.command(), linuxcnc.stat()
sampler = subprocess.Popen(["halsampler", "-t", "trace"])


def do(what, *arguments):
    what(*arguments)
    command.wait_complete(5)


do(command.state, linuxcnc.STATE_ESTOP_RESET)
do(command.state, linuxcnc.STATE_ON)
do(command.mode, linuxcnc.MODE_MANUAL)
do(command.home, -1)
for _ in range(200):
    state.poll()
    if all(state.homed[:3]):
        break
    time.sleep(0.01)
"""

_DRIVER = (
    _SWITCHED_ON
    + """\
duration, override = map(float, open("run.txt").read().split())


def seconds():
    return float(subprocess.run(["halcmd", "getp", "fmplant.0.seconds"], capture_output=True, text=True).stdout)


do(command.feedrate, override)
do(command.mode, linuxcnc.MODE_AUTO)
do(command.program_open, "/mnt/program.ngc")
command.auto(linuxcnc.AUTO_RUN, 0)
errors = linuxcnc.error_channel()
actions = [line.split() for line in open("operator.txt")]
while True:
    now = seconds()
    if actions and now >= float(actions[0][0]):
        what = actions.pop(0)[1]
        if what in ("pause", "resume"):
            command.auto(linuxcnc.AUTO_PAUSE if what == "pause" else linuxcnc.AUTO_RESUME)
        else:
            command.feedrate(float(what))
    if now > duration + 0.1:
        break
    said = errors.poll()
    if said:
        print("LinuxCNC:", said, flush=True)
    time.sleep(0.05)
sampler.send_signal(signal.SIGINT)
sampler.wait()
sys.exit(0)
"""
)

_LATHE = """\
loadrt [KINS]KINEMATICS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS
loadrt limit2 names=ramp
loadrt integ names=turns
loadrt near names=reached
loadrt sampler depth=60000 cfg=fffff
addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf ramp servo-thread
addf turns servo-thread
addf reached servo-thread
addf sampler.0 servo-thread
net x-position joint.0.motor-pos-cmd => joint.0.motor-pos-fb sampler.0.pin.0
net y-position joint.1.motor-pos-cmd => joint.1.motor-pos-fb
net z-position joint.2.motor-pos-cmd => joint.2.motor-pos-fb sampler.0.pin.1
net velocity motion.current-vel => sampler.0.pin.2
net commanded spindle.0.speed-out-rps => ramp.in reached.in1 sampler.0.pin.3
net turning ramp.out => turns.in reached.in2 spindle.0.speed-in sampler.0.pin.4
net turns turns.out => spindle.0.revs
net reached reached.out => spindle.0.at-speed
setp ramp.maxv 10
setp reached.scale 1
setp reached.difference 0.001
net estop-loop iocontrol.0.user-enable-out iocontrol.0.emc-enable-in
net tool-prepare iocontrol.0.tool-prepare iocontrol.0.tool-prepared
net tool-change iocontrol.0.tool-change iocontrol.0.tool-changed
"""

_LATHE_DRIVER = (
    _SWITCHED_ON
    + """\
limit = float(open("run.txt").read())
errors = linuxcnc.error_channel()
do(command.mode, linuxcnc.MODE_AUTO)
do(command.program_open, "/mnt/program.ngc")
command.auto(linuxcnc.AUTO_RUN, 0)
time.sleep(0.5)
begun = time.time()
while time.time() - begun < limit:
    state.poll()
    said = errors.poll()
    if said:
        print("LinuxCNC:", said, flush=True)
    if state.interp_state == linuxcnc.INTERP_IDLE:
        print("program ended", flush=True)
        break
    time.sleep(0.05)
sampler.send_signal(signal.SIGINT)
sampler.wait()
sys.exit(0)
"""
)
