"""The whole LinuxCNC with a program of fitmodels beside it: started, killed and reset by the user interface.

It is the machine of `linuxcnc_machine`, but for the heartbeat of the controller, which is that of the program: the
plant's own becomes ``fm-source-heartbeat``. The operator clears a fault once, a second after it began.
"""

import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import linuxcnc_machine
import numpy as np
from linuxcnc_machine import PERIOD, Run


@dataclass(frozen=True)
class Beside:
    """A program beside the machine.

    Attributes
    ----------
    command : sequence of str
        Its words; the working folder holds the ``files``.
    files : dict
        Name -> text.
    kill_at : float
        s after the first contact at which SIGKILL (``"kill"``) or SIGSTOP (``"stop"``) is sent to it.
    resets : int
        Faults that the operator clears.
    ready : str
        What the program prints before the cut begins: the machine waits for it, half a minute at most.
    """

    command: Sequence[str]
    files: dict[str, str]
    kill_at: float = 1e9
    signal: str = "KILL"
    resets: int = 1
    ready: str = ""


def run_beside(run: Run, beside: Beside, plant: Path) -> tuple[dict[str, np.ndarray], str]:
    """Trace of the machine, and what the program printed.

    ``signal`` of the trace has one value: s after the first contact, read when the signal had been sent.

    Raises
    ------
    RuntimeError
        LinuxCNC did not end as it should.
    """
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-watch-"))
    try:
        folder.chmod(0o777)
        linuxcnc_machine._write(run, folder, plant)
        wires = (folder / "wires.hal").read_text()
        wires = wires.replace("net fm-heartbeat fmplant", "net fm-source-heartbeat fmplant")
        (folder / "wires.hal").write_text(wires.replace("net fm-reset fmplant.0.reset\n", ""))
        (folder / "driver.py").write_text(_DRIVER)
        program = (folder / "program.ngc").read_text()
        (folder / "program.ngc").write_text(program.replace(f"G4 P{run.dwell:g}\n", f"G4 P{run.dwell:g}\nM0\n"))
        settings = [*beside.command, "", repr(beside.kill_at), beside.signal, str(beside.resets), beside.ready]
        for name, text in {**beside.files, "beside.txt": "\n".join(settings)}.items():
            (folder / name).write_text(text)
            (folder / name).chmod(0o666)
        inside = ["bash", "-c", _INSIDE, str(folder), str(int(run.duration + 90)), *_hidden()]
        said = subprocess.run(
            [*linuxcnc_machine._namespaces(), *inside],
            capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=run.duration + 120,
        )  # fmt: skip
        printed = folder / "printed.txt"
        words = printed.read_text() if printed.exists() else ""
        trace = linuxcnc_machine._trace(folder, run.duration, said.stdout + said.stderr + words)
        sent = folder / "sent.txt"
        return {**trace, "signal": np.loadtxt(sent, ndmin=1) if sent.exists() else np.array([math.inf])}, words
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _hidden() -> list[str]:
    """Folders of this Python below /tmp, which the machine hides behind one of its own."""
    import fitmodels

    used = [sys.executable, sys.prefix, sys.base_prefix, *sys.path, *fitmodels.__path__]
    resolved = [path for each in used for path in (each, os.path.realpath(each))]
    parts = [Path(path).parts for path in resolved]
    return sorted({str(Path(*of[:3])) for of in parts if of[:2] == ("/", "tmp") and len(of) > 2})


_INSIDE = """
ip link set lo up 2>/dev/null || true
folder=$0; limit=$1; shift
mount --bind "$folder/modules" /usr/lib/linuxcnc/modules || exit 90
mount --bind "$folder" /mnt || exit 91
mkdir -p /mnt/tmp && mount --bind /tmp /mnt/tmp && mount -t tmpfs -o mode=1777 none /tmp || exit 92
for hidden in "$@"; do
    [ -d "/mnt/$hidden" ] && mkdir -p "$hidden" && { mount --bind "/mnt/$hidden" "$hidden" || exit 93; }
done
chmod 777 /mnt; cd /mnt
[ "$(id -u)" = 0 ] && export RTAPI_UID=65534
exec env -u DISPLAY HOME=/mnt/home RTAPI_FIFO_PATH=/tmp/fifo timeout -k 5 "$limit" linuxcnc -r machine.ini </dev/null
"""

_DRIVER = (
    linuxcnc_machine._SWITCHED_ON
    + """\
def get(name):
    return subprocess.run(["halcmd", name[0], name[1]], capture_output=True, text=True).stdout.strip()


duration, override = map(float, open("run.txt").read().split())
*words, _, kill_at, name, resets, ready = open("beside.txt").read().split("\\n")
printed = open("printed.txt", "w")
program = subprocess.Popen(words, stdout=printed, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
do(command.feedrate, override)
do(command.mode, linuxcnc.MODE_AUTO)
do(command.program_open, "/mnt/program.ngc")
command.auto(linuxcnc.AUTO_RUN, 0)
errors = linuxcnc.error_channel()
kill_at, resets, fault_since = float(kill_at), int(resets), None
begun, waiting = time.time(), True
while True:
    state.poll()
    if waiting and state.paused:
        if ready in " ".join(open("printed.txt").read().split()) or time.time() - begun > 30:
            waiting = False
            command.auto(linuxcnc.AUTO_RESUME)
    now = float(get(("getp", "fmplant.0.seconds")) or 0)
    if now >= kill_at:
        kill_at = 1e9
        program.send_signal(getattr(signal, "SIG" + name))
        open("sent.txt", "w").write(get(("getp", "fmplant.0.seconds")))
    if now > duration + 0.1:
        break
    if resets and now == 0 and get(("gets", "fm-fault")) == "TRUE":
        fault_since = fault_since or time.time()
        if time.time() - fault_since > 1.0 and get(("gets", "fm-dead")) == "FALSE":
            resets, fault_since = resets - 1, None
            subprocess.run(["halcmd", "sets", "fm-reset", "TRUE"])
            time.sleep(0.1)
            subprocess.run(["halcmd", "sets", "fm-reset", "FALSE"])
    else:
        fault_since = None
    said = errors.poll()
    if said:
        print("LinuxCNC:", said, flush=True)
    time.sleep(0.05)
program.kill()
program.wait()
sampler.send_signal(signal.SIGINT)
sampler.wait()
sys.exit(0)
"""
)


KILLED = 3.5  # s after contact
REFERENCE = 0.22  # A, below the 0.24 A of the file


def control_run(folder: Path, signal: str) -> "tuple[Run, Beside]":
    """A machine under the HAL export, and `fitmodels watch --write` that gets a signal in mid-cut."""
    from fitmodels import parameters
    from fitmodels.live.controller import consent_words, controller_of
    from linuxcnc_faults import Scenario, exported, machine_file, run_of

    pf = machine_file()
    control = Path(tempfile.mkdtemp(dir=folder)) / "control.json"
    parameters.write(pf, control)
    files = {"worn.json": worn_file(folder), "control.json": control.read_text()}
    command = [
        sys.executable, "-m", "fitmodels", "watch", "worn.json", "--from", "linuxcnc", "--map", "I=fm-load",
        "--value", "D=2mm", "--criterion", "VB=0.22mm", "--journal", "journal", "--write", "--reference",
        f"{REFERENCE:g}A", "--controller", "control.json", "--consent", consent_words(controller_of(pf)),
    ]  # fmt: skip
    scenario = Scenario("watch", "control", wear=60.0, wear_rate=2.0, duration=5.5)
    beside = Beside(command, files, KILLED, signal, 2, "written: reference")
    return run_of(scenario, pf, exported(pf, "hal", folder)[0]), beside


def control_figures(trace: dict[str, np.ndarray]) -> dict[str, float]:
    """Mean load over the reference before the signal; s from the signal to the fault and to the lower limit; the end.

    ``still`` is the longest time without a change of the heartbeat, s, from half a second before the first contact to
    `KILLED`, ``beat`` the time from its last change to the fault after the signal, s.
    """
    seconds, sent = trace["seconds"], float(trace["signal"][0])
    held = (seconds > 2.5) & (seconds < KILLED)
    begin, end = np.searchsorted(seconds, [0.0, KILLED], side="right") - [round(0.5 / PERIOD), 0]
    changes = np.flatnonzero(np.diff(trace["beat"]))
    before = changes[(changes >= begin) & (changes < end)]
    after = seconds > KILLED
    fault, low = after & (trace["fault"] > 0), after & (trace["u"] <= trace["u"][-1] + 1e-9)
    first = int(np.argmax(fault)) if fault.any() else -1
    return {
        "load": float(trace["load"][held].mean() / REFERENCE), "early": float(trace["fault"][held].max()),
        "still": PERIOD * float(np.diff(before, prepend=begin, append=end).max()),
        "beat": PERIOD * float(first - changes[changes < first].max(initial=0)) if fault.any() else math.inf,
        "fault": float(seconds[first] - sent) if fault.any() else math.inf,
        "low": float(seconds[np.argmax(low)] - sent), "latched": float(trace["fault"][first:].min()),
        "u": float(trace["u"][-1]), "feed": float(trace["feed"][-1]),
    }  # fmt: skip


WINDOW = (180.0, 220.0)  # um: the change is to be called there; the upper end is the criterion
RISK = 0.05
LAW = {"c0": 12.0, "aV": 1.0, "af": 0.5, "m": 0.6, "k": 0.25, "bV": 0.3, "bf": 0.6, "bw": 0.35}  # um, A; t in min
LEVEL, LOAD_LEVEL, EXPONENT = 0.15, 0.05, 0.05  # sd between edges: of ln wear, of ln load, and of m relative
MIDDLE = 0.25  # min: the level of an edge is that at this time
WORN_PINS = {"I": "fmwear.0.load"}  # speed and feed are LinuxCNC's own


def wear_module(folder: Path) -> Path:
    """Path of the compiled plant with a hidden wear."""
    source = folder / "fmwear.comp"
    shutil.copy(linuxcnc_machine.HERE / "linuxcnc_wear.comp", source)
    return linuxcnc_machine.compiled(source)


def worn_file(folder: Path) -> str:
    """Parameter file of wear VB and current I from 24 simulated edges, half a minute long."""
    from fitmodels import datasets, fit, parameters

    rng = np.random.default_rng(7)
    rows = ["edge,V (m/min),f (mm/rev),t (min),VB (um),I (A)"]
    for edge in range(24):
        V, f = rng.choice([70.0, 90.0, 110.0, 130.0]), rng.choice([0.06, 0.09, 0.13])
        m = LAW["m"] * (1 + EXPONENT * rng.standard_normal())
        level, load = LEVEL * rng.standard_normal(), LOAD_LEVEL * rng.standard_normal()
        for t in (0.08, 0.15, 0.25, 0.4, 0.6):
            wear = LAW["c0"] * V ** LAW["aV"] * f ** LAW["af"] * MIDDLE ** LAW["m"] * (t / MIDDLE) ** m
            wear *= np.exp(level + 0.03 * rng.standard_normal())
            current = LAW["k"] * V ** LAW["bV"] * f ** LAW["bf"] * wear ** LAW["bw"]
            current *= np.exp(load + 0.02 * rng.standard_normal())
            rows.append(f"{edge + 1},{V:g},{f:g},{t:g},{wear:.5g},{current:.5g}")
    path = folder / "tests.csv"
    path.write_text("\n".join(rows) + "\n")
    runs = datasets.read_runs(path)
    laws = [fit.power_law(runs, "VB", ["V", "f", "t"]), fit.power_law(runs, "I", ["V", "f", "VB"])]
    pf = parameters.collect(laws=laws, tool="end mill", work="S45C", simulated=True)
    written = Path(tempfile.mkdtemp(dir=folder)) / "worn.json"
    parameters.write(pf, written)
    return written.read_text()


def worn_run(seed: int, params: str) -> "tuple[WornRun, dict[str, float]]":
    """Run of an edge whose truth is drawn from a seed, and that truth."""
    draw = random.Random(1000 + seed)  # noqa: S311  a simulation
    truth = {
        "level": draw.gauss(0, LEVEL), "load": draw.gauss(0, LOAD_LEVEL), "m": LAW["m"] * (1 + draw.gauss(0, EXPONENT)),
    }  # fmt: skip
    plant = {**LAW, "m": truth["m"], "seed": seed}
    plant["c0"] = LAW["c0"] * MIDDLE ** (LAW["m"] - truth["m"]) * math.exp(truth["level"])
    plant["k"] = LAW["k"] * math.exp(truth["load"])
    watch = [sys.executable, "-m", "fitmodels", "watch", "worn.json"]
    criterion = f"VB={WINDOW[1] / 1000:g}mm"
    command = [
        *watch, "--from", "linuxcnc", *(word for pin in WORN_PINS.items() for word in ("--map", "=".join(pin))),
        "--value", "D=10mm", "--window", "1", "--rest", "idle", "--criterion", criterion, "--risk", f"{RISK:g}",
        "--next-cut", "2.5s", "--journal", "journal",
    ]  # fmt: skip
    gauge = [*watch, "--journal", "journal", "--gauge", "VB={}mm", "--quiet"]
    files = {"worn.json": params}
    return WornRun(plant, command, files, gauge, gauge_at=120.0, gauge_error=draw.gauss(0, 0.02)), truth


@dataclass(frozen=True)
class WornRun:
    """A program that cuts until a program beside it calls the tool change.

    Attributes
    ----------
    plant : dict
        Parameters of ``linuxcnc_wear.comp``.
    command, files : as of `Beside`
    gauge : sequence of str
        Words of the command that hands in a gauge reading; ``{}`` is the reading in mm.
    gauge_at : float
        um of true wear: the reading is taken after the pass in which it is passed.
    gauge_error : float
        Of ln wear.
    feeds : sequence of float
        mm/min, of the passes in turn.
    called : str
        What the program prints when it calls the change.
    """

    plant: dict[str, float]
    command: Sequence[str]
    files: dict[str, str]
    gauge: Sequence[str]
    gauge_at: float
    gauge_error: float = 0.0
    feeds: Sequence[float] = (300.0, 380.0)
    rpm: float = 3000.0
    pass_seconds: float = 2.5
    passes: int = 40
    called: str = "Change the edge"
    worn: float = 400.0  # um, at which the run ends without a call
    seconds: float = 120.0


def run_worn(run: WornRun, plant: Path) -> dict[str, float | str]:
    """Wear (um) and seconds of cutting at the call of the tool change, and what was printed.

    ``wear`` is NaN where the change was not called.
    """
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-worn-"))
    try:
        folder.chmod(0o777)
        _write_worn(run, folder, plant)
        inside = ["bash", "-c", _INSIDE, str(folder), str(int(run.seconds + 60)), *_hidden()]
        said = subprocess.run(
            [*linuxcnc_machine._namespaces(), *inside],
            capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=run.seconds + 90,
        )  # fmt: skip
        printed = (folder / "printed.txt").read_text() if (folder / "printed.txt").exists() else ""
        if not (folder / "result.txt").exists():
            logs = "".join(f"\n{log.name}:\n{log.read_text()}" for log in (folder / "home").glob("*.txt"))
            raise RuntimeError(f"LinuxCNC did not end as it should.\n{said.stdout}{said.stderr[-4000:]}{logs}{printed}")
        wear, seconds, gauged = map(float, (folder / "result.txt").read_text().split())
        return {"wear": wear, "seconds": seconds, "gauged": gauged, "printed": printed, "machine": said.stdout}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _write_worn(run: WornRun, folder: Path, plant: Path) -> None:
    (folder / "home").mkdir()
    shutil.copytree(linuxcnc_machine.MODULES, folder / "modules")
    shutil.copy(plant, folder / "modules" / "fmwear.so")
    passes = "".join(
        f"G1 X{5 + run.feeds[k % len(run.feeds)] / 60 * run.pass_seconds:.4f} F{run.feeds[k % len(run.feeds)]:g}\n"
        "G0 Z5\nG0 X0\nG4 P0.5\nG0 Z0\n"
        for k in range(run.passes)
    )
    hal = linuxcnc_machine._MACHINE.replace("fmplant", "fmwear")
    hal += "".join(f"setp fmwear.0.{name} {value!r}\n" for name, value in run.plant.items())
    wires = (
        "net velocity motion.current-vel fmwear.0.velocity\nnet turns spindle.0.speed-out-rps fmwear.0.turns\n"
        "net on spindle.0.on fmwear.0.spindle-on\naddf fmwear.0 servo-thread\naddf motion-controller servo-thread\n"
    )
    files = {
        "machine.ini": linuxcnc_machine._INI, "machine.hal": hal, "fm.hal": "", "wires.hal": wires,
        "driver.py": _WORN_DRIVER, "tool.tbl": "", "sim.var": "",
        "program.ngc": f"G21 G90 G17 G64\nS{run.rpm:g} M3\nG4 P2\n{passes}M2\n",
        "beside.json": json.dumps({
            "command": list(run.command), "gauge": list(run.gauge), "gauge_at": run.gauge_at, "called": run.called,
            "error": run.gauge_error, "worn": run.worn, "seconds": run.seconds,
        }),
        **run.files,
    }  # fmt: skip
    for name, text in files.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o666 if name != "driver.py" else 0o777)
    (folder / "home").chmod(0o777)


_WORN_DRIVER = (
    linuxcnc_machine._SWITCHED_ON.replace('sampler = subprocess.Popen(["halsampler", "-t", "trace"])\n', "")
    + """\
import json
import math

import hal

component = hal.component("driver")  # hal answers nothing before there is one
component.ready()
settings = json.load(open("beside.json"))
program = subprocess.Popen(
    settings["command"], stdout=open("printed.txt", "w"), stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
)
begun, handed, gauged, wear = time.time(), [], math.nan, math.nan
while "connected" not in open("printed.txt").read() and time.time() - begun < 30 and program.poll() is None:
    time.sleep(0.1)  # it has to see the idle load before the first cut
do(command.mode, linuxcnc.MODE_AUTO)
do(command.program_open, "/mnt/program.ngc")
command.auto(linuxcnc.AUTO_RUN, 0)
errors = linuxcnc.error_channel()
while time.time() - begun < settings["seconds"]:
    now, cutting = hal.get_value("fmwear.0.wear"), hal.get_value("fmwear.0.cutting")
    if settings["called"] in open("printed.txt").read():
        wear = now
        break
    if now > settings["worn"] or program.poll() is not None:
        break
    if math.isnan(gauged) and now > settings["gauge_at"] and not cutting:
        gauged = now * math.exp(settings["error"])
        handed.append(subprocess.Popen([word.replace("{}", "%.6g" % (gauged / 1000)) for word in settings["gauge"]]))
    said = errors.poll()
    if said:
        print("LinuxCNC:", said, flush=True)
    time.sleep(0.05)
open("result.txt", "w").write("%r %r %r" % (wear, hal.get_value("fmwear.0.seconds"), gauged))
program.terminate()
try:
    program.wait(5)
except subprocess.TimeoutExpired:
    program.kill()
sys.exit(0)
"""
)
