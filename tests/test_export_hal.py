"""The HAL export, run by LinuxCNC's own components in halrun, does what `controllers.replay` of ConstantLoad does.

Plant: eq. 18 of Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587) with unit gain, behind their load line, from
HAL's biquad, lowpass, sum2 and mux2; the same difference equation as `LinearCut` of conftest.py.
"""

import fcntl
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from fitmodels import controllers
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.loop import Trace
from fitmodels.core.errors import GateError
from fitmodels.parameters.exports.view import export_view

SAMPLES = 2500
TOLERANCE = 1e-5  # halsampler prints six decimals: 5e-7 is what rounding leaves
INSTALL = "apt-get install linuxcnc-uspace"
MACHINE = """\
loadrt trivkins
loadrt tpmod
loadrt homemod
loadrt motmod servo_period_nsec=1000000 num_joints=3
"""
B18, A18 = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
A, B, IDLE, PROGRAMMED = 0.1158, 1.2416e-4, 0.05, 1000.0  # A, A/(mm/min), A, mm/min
GAIN = B * PROGRAMMED / (sum(B18) / sum(A18))


# Sample -> wear's share of the load: sharp, worn until the low limit, fresh until the high one.
def wear(k: int) -> float:
    return float(np.interp(k, [0, 800, 1100, 1400, 1700, 2000, 2200], [0.0, 0.0, 0.06, 0.06, -0.08, -0.08, 0.0]))


def cutting(k: int) -> bool:
    return 100 <= k < 2350


@pytest.fixture
def replayed(linear_cut):
    def run(pf, samples: int = SAMPLES) -> Trace:
        dt = pf.pi.sample_time
        plant = linear_cut(
            b=[GAIN * b for b in B18], a=A18, offset=A, idle=IDLE,
            wear=lambda t: wear(round(t / dt)), cutting=lambda t: cutting(round(t / dt)),
        )  # fmt: skip
        return controllers.replay(controllers.ConstantLoad.from_parameters(pf), plant, duration=samples * dt, dt=dt)

    return run


def plant_in_hal(folder: Path, thread: str, samples: int) -> str:
    """Eq. 18 as a biquad and a lowpass, the load line, the cut; its schedule comes through streamer."""
    pole = min(np.roots(A18), key=abs).real
    pair = np.polydiv(A18, [1.0, -pole])[0]
    n = [float(GAIN * b / (1 - pole)) for b in B18[1:]]
    schedule = "".join(f"{A + wear(k)!r} {int(cutting(k))}\n" for k in range(samples))
    (folder / "schedule").write_text(schedule)
    return f"""
loadrt biquad names=plant.pair
loadrt streamer depth=4000 cfg=fb
loadrt sampler depth=4000 cfg=fffb
setp plant.pair.n0 {n[0]!r}
setp plant.pair.n1 {n[1]!r}
setp plant.pair.n2 {n[2]!r}
setp plant.pair.d1 {float(pair[1])!r}
setp plant.pair.d2 {float(pair[2])!r}
setp plant.pair.enable TRUE
setp plant.pole.gain {1 - float(pole)!r}
setp plant.cut.in0 {IDLE!r}
net fm-feed plant.pair.in
net p1 plant.pair.out plant.pole.in
net p2 plant.pole.out plant.line.in0
net p3 streamer.0.pin.0 plant.line.in1
net p4 streamer.0.pin.1 plant.cut.sel
net p5 plant.line.out plant.cut.in1
net fm-load plant.cut.out
net fm-load sampler.0.pin.0
net fm-filtered sampler.0.pin.1
net fm-feed sampler.0.pin.2
net fm-cut sampler.0.pin.3
addf streamer.0 {thread} 1
addf plant.pair {thread} 2
addf plant.pole {thread} 3
addf plant.line {thread} 4
addf plant.cut {thread} 5
addf motion-controller {thread}
addf sampler.0 {thread}
sets fm-enable TRUE
loadusr -w halstreamer {folder}/schedule
start
loadusr -w halsampler -t -n {samples} {folder}/trace
"""


def hal_of(pf) -> str:
    return rendered(pf, "hal")


@pytest.fixture
def fast(constant_load_file):
    """At the period of a servo thread, 1 ms."""
    return constant_load_file(0.001)


@pytest.fixture
def halrun(consumer):
    """Run HAL text in a folder that LinuxCNC's fallback user can write; one halrun at a time on a machine."""
    program = consumer("halrun", INSTALL)
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-hal-"))  # tmp_path is closed to other users
    folder.chmod(0o777)

    def run(text: str) -> subprocess.CompletedProcess[str]:
        (folder / "test.hal").write_text(text)
        root = {"RTAPI_UID": "65534"} if os.geteuid() == 0 else {}
        env = {**os.environ, **root, "RTAPI_FIFO_PATH": str(folder / "fifo")}
        with (Path(tempfile.gettempdir()) / "fitmodels-halrun.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return subprocess.run(
                [program, "-f", "test.hal"], cwd=folder, env=env, capture_output=True, text=True, timeout=120
            )

    run.folder = folder
    yield run
    shutil.rmtree(folder, ignore_errors=True)


def shared(export: str, component: str, name: str) -> str:
    """A component that the machine needs too: its names go on one line, as the head of the export says."""
    line = f"loadrt {component} names="
    assert line in export
    return export.replace(line, f"{line}{name},")


def traced(halrun, export: str, samples: int = SAMPLES, thread: str = "servo-thread") -> np.ndarray:
    """Sample number, load, filtered load, feed override, cut: what LinuxCNC made of an export."""
    for component, ours in (("lowpass", "plant.pole"), ("sum2", "plant.line"), ("mux2", "plant.cut")):
        export = shared(export, component, ours)
    (halrun.folder / "fm.hal").write_text(export)
    said = halrun(
        f"{MACHINE}source {halrun.folder}/fm.hal\naddf motion-command-handler {thread} 1\n"
        + plant_in_hal(halrun.folder, thread, samples)
    )
    assert said.returncode == 0, said.stderr
    table = np.loadtxt(halrun.folder / "trace")
    assert table.shape == (samples, 5), said.stderr
    assert (np.diff(table[:, 0]) == 1).all()  # none lost
    return table


@pytest.mark.consumer
def test_linuxcnc_runs_the_export_as_the_replay_does(halrun, fast, replayed):
    table, ours = traced(halrun, hal_of(fast)), replayed(fast)
    difference = max(np.abs(table[:, 1] - ours.measurement).max(), np.abs(table[:, 3] - ours.command).max())
    assert difference < TOLERANCE


@pytest.mark.consumer
def test_a_slow_loop_gets_a_thread_of_its_own(halrun, constant_load_file, replayed):
    slow = constant_load_file(0.02)
    table = traced(halrun, hal_of(slow), samples=200, thread="fm-thread")
    assert np.abs(table[:, 3] - replayed(slow, 200).command).max() < TOLERANCE


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("setp fm.pid.Igain 160.0", "setp fm.pid.Igain 320.0"),
     ("addf fm.filter", "# addf fm.filter"),
     ("setp fm.select.in0 1.0", "setp fm.select.in0 0.9")],
)  # fmt: skip
def test_a_broken_setting_is_seen_in_the_trace(halrun, fast, broken, by, replayed):
    export = hal_of(fast)
    assert broken in export
    table = traced(halrun, export.replace(broken, by), samples=600)
    assert np.abs(table[:, 3] - replayed(fast, 600).command).max() > 100 * TOLERANCE


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("loadrt pid names=fm.pid\n", ""), ("net fm-cut fm.cut.out", "net fm-cut fm.cut.nowhere"),
     ("setp fm.pid.Pgain 0.3", "setp fm.pid.Pgain x")],
)  # fmt: skip
def test_a_broken_file_does_not_load(halrun, fast, broken, by):
    export = hal_of(fast)
    assert broken in export
    assert halrun(MACHINE + export).returncode == 0
    assert halrun(MACHINE + export.replace(broken, by)).returncode != 0


@pytest.mark.consumer
def test_without_the_switch_and_the_load_pin_nothing_happens(halrun, fast):
    said = halrun(MACHINE + hal_of(fast) + "start\nloadusr -w sleep 0.5\nshow pin fm.limit.out\nshow pin fm.cut.out")
    assert re.search(r"OUT\s+1\s+fm\.limit\.out", said.stdout)
    assert re.search(r"OUT\s+FALSE\s+fm\.cut\.out", said.stdout)


@pytest.mark.consumer
@pytest.mark.parametrize("load", ["nan", "inf", "99"])
def test_an_unknown_load_lets_go_of_the_feed(halrun, fast, load):
    """0.5 A is above the threshold and the reference: the feed falls to its low limit, until the load is unknown."""
    wait = "loadusr -w sleep 0.6\nshow pin fm.limit.out\n"
    said = halrun(
        MACHINE + shared(hal_of(fast), "mux2", "source")
        + f"setp source.in0 0.5\nsetp source.in1 {load}\nnet fm-load source.out\naddf source servo-thread 1\n"
        + f"sets fm-enable TRUE\nstart\n{wait}setp source.sel TRUE\n{wait}setp source.sel FALSE\n{wait}"
    )  # fmt: skip
    assert re.findall(r"OUT\s+(\S+)\s+fm\.limit\.out", said.stdout) == ["0.6", "1", "0.6"], said.stderr


def test_the_replay_settles_engages_meets_both_limits_and_lets_go(fast, replayed):
    trace, loop = replayed(fast), export_view(fast).needed_loop()
    assert np.abs(trace.measurement[600:800] - loop.reference).max() < 1e-6
    assert trace.command[1350] == pytest.approx(loop.low, abs=1e-15)
    assert trace.command[1950] == pytest.approx(loop.high, abs=1e-15)
    assert trace.command[-1] == 1.0
    happened = [event.what for event in trace.events]
    assert [what for what in happened if what in ("cut", "air")] == ["cut", "air"]
    assert {"at low", "at high", "free"} <= set(happened)


def test_gains_with_a_moving_average_are_refused(constant_load_file):
    with pytest.raises(GateError, match="moving average of 2 samples"):
        hal_of(constant_load_file(pi={"average": 2}))
