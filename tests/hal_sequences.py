"""Inputs of the constant-load controller, and its answers: by the Python reference, the HAL text, and halrun."""

import fcntl
import os
import random
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from fitmodels.controllers import ConstantLoad
from fitmodels.parameters.exports.loop import LoadLoop
from hal_evaluator import Hal

INPUTS = {
    "load": "fm-load", "enabled": "fm-enable", "spindle_on": "fm-spindle-on", "idle": "fm-velocity",
    "beat": "fm-heartbeat", "reset": "fm-reset",
}  # fmt: skip
VELOCITY = {True: 0.99 / 60, False: 1.01 / 60}  # idle -> mm/s: the path advances above 1 mm/min
OUTPUTS = ("fm-feed", "fm-armed", "fm-engaged", "fm-cut", "fm-fault", "fm-overload", "fm-worn", "fm-inhibit")
MACHINE = """\
loadrt trivkins
loadrt tpmod
loadrt homemod
loadrt motmod servo_period_nsec={period} num_joints=3
"""
Row = dict[str, float | bool]
Answer = tuple[float, ...]


def random_inputs(loop: LoadLoop, seed: int, samples: int, *, impatient: bool = False) -> Iterator[Row]:
    """Loads about every threshold and limit, faults of the sensor and its source, switches and resets.

    An impatient operator begins switched on, without a heartbeat, and resets every other sample.
    """
    rng = random.Random(seed)  # noqa: S311  inputs of a test
    at, half, worn = loop.engage_at, loop.hysteresis / 2, loop.overload_at
    levels = [at + share * half for share in (-2, -1.05, -0.95, 0, 0.95, 1.05)]
    levels += [loop.reference, 0.97 * loop.reference, 1.1 * loop.reference, 0.99 * worn, 1.01 * worn, 1.2 * worn]
    low, high = loop.load_low, loop.load_high
    invalid = [float("nan"), float("inf"), -float("inf"), 0.0, -0.1, low, high, 1.03 * high, 0.97 * low]
    valid = [1.01 * low, 1.03 * low, 0.97 * high, 0.99 * high]
    row: Row = {"load": at / 2, **dict.fromkeys(list(INPUTS)[1:], impatient), "idle": False}
    level, mode, until, lives = at, "noise", 0, not impatient
    for k in range(samples):
        for name, chance, share in (("enabled", 0.01, 0.9), ("spindle_on", 0.01, 0.9), ("idle", 0.02, 0.5),
                                    ("reset", 0.04, 0.5)):  # fmt: skip
            if rng.random() < chance:
                row[name] = rng.random() < share
        row["reset"] = k % 2 == 1 if impatient else row["reset"]
        lives = rng.random() < 0.85 if rng.random() < 0.005 else lives
        row["beat"] = row["beat"] != (lives and rng.random() < 0.3)
        level = rng.choice(levels) if rng.random() < 0.015 else level
        if k >= until:
            mode = rng.choice(["noise"] * 6 + ["equal", "invalid", "valid"])
            until = k + rng.randrange(1, 8 if mode in ("invalid", "valid") else 160)
            extreme = rng.choice(invalid if mode == "invalid" else valid)
        if mode == "noise":
            row["load"] = level + rng.gauss(0.0, 0.1 * half)
        elif mode != "equal":
            row["load"] = extreme
        yield dict(row)


def worn_inputs(loop: LoadLoop) -> Iterator[Row]:
    """A tool that rests on the lower limit for longer and longer, with a reset in the middle; then a cut that ends."""
    row: Row = {"load": 0.0, "enabled": True, "spindle_on": True, "idle": False, "beat": False, "reset": False}
    rests = [(length, 1.15 * loop.reference, {}) for length in range(20, 120, 8)]
    cut = [part for rest in rests for part in (rest, (40, 0.9 * loop.reference, {}))]
    off = {"enabled": False, "idle": True}
    least, below = loop.engage_at - 0.48 * loop.hysteresis, 0.9 * loop.engage_at
    ends = [(5, float("nan"), off), (5, least, off), (5, below, {"idle": False}), (5, below, {}), (5, below, off)]
    resets = [(60, 1.15 * loop.reference, {}), (1, 1.15 * loop.reference, {"reset": True}), *rests[-1:]]
    for length, load, changes in [
        (30, loop.engage_at / 2, {}),
        *cut,
        *resets,
        *ends,
        *cut[:4],
        *ends[:2],
        (5, -float("inf"), off),
    ]:
        for k in range(length):
            yield {**row, "load": load + (k % 3 - 1) * 1e-4, "beat": k % 2 == 1, **changes}


# Valid (g) and invalid (b) readings with a lost_after of 3 samples: each b counts 4, each g -1, lost at 24, at most 30.
JUST, NOT_YET, SLOWLY = "bgbgbbgbbgb", "bgbgbbgbgbgb", "bggg" * 40  # 24, 23, and 1 in each turn
SCATTERED = [
    *(f"{part}{'g' * 40}r{'g' * 40}" for part in (JUST, NOT_YET, SLOWLY)),
    *(f"{'bg' * 20}{'g' * more}r{'g' * 40}r{'g' * 60}" for more in (3, 4, 5, 6, 7, 8)),
    *(
        f"{before}{part}{'g' * 40}r{'g' * 40}"
        for before in ("bgggggggo", "bg" * 20 + "ooo")
        for part in (JUST, NOT_YET)
    ),
]


def scattered_inputs(loop: LoadLoop) -> Iterator[Row]:
    """Readings of which some are invalid, never long enough to be lost at once; r is a reset, o switches off."""
    row: Row = {"load": 0.0, "enabled": True, "spindle_on": True, "idle": False, "beat": False, "reset": False}
    for k, sign in enumerate("g" * 60 + "".join(SCATTERED)):
        load = float("nan") if sign == "b" else 0.95 * loop.reference + (k % 3 - 1) * 1e-4
        yield {**row, "load": load, "beat": k % 2 == 1, "reset": sign == "r", "enabled": sign != "o"}


def reference_answers(controller: ConstantLoad, rows: Sequence[Row]) -> list[Answer]:
    """Outputs of the Python reference in the order of `OUTPUTS`."""
    return [reference_answer(controller, row) for row in rows]


def reference_answer(controller: ConstantLoad, row: Row) -> Answer:
    for name, value in row.items():
        if name != "load":
            setattr(controller, name, value)
    feed = controller.step(row["load"], controller.loop.sample_time)
    of = controller
    return (feed, of._armed, of._engaged, of.cutting, of.fault, of.overload, of.worn, of.feed_inhibit)


def hal_answer(hal: Hal, row: Row) -> Answer:
    """Outputs of HAL text."""
    for name, value in row.items():
        hal[INPUTS[name]] = VELOCITY[value] if name == "idle" else value
    hal.step()
    return tuple(hal[name] for name in OUTPUTS)


def first_difference(ours: Sequence[Answer], theirs: Sequence[Answer], tolerance: float = 0.0) -> int | None:
    """Sample of the first difference: in feed above the tolerance, or in any flag."""
    for k, (one, two) in enumerate(zip(ours, theirs, strict=True)):
        if abs(one[0] - two[0]) > tolerance or one[1:] != two[1:]:
            return k
    return None


class Halrun:
    """LinuxCNC's halrun in a folder that its fallback user can write.

    It runs in namespaces of its own, as its lock, shared memory and clean-up are those of the machine; where there are
    none, one at a time.
    """

    def __init__(self, program: str) -> None:
        self.program = program
        self.folder = Path(tempfile.mkdtemp(prefix="fitmodels-hal-"))  # tmp_path is closed to other users
        self.folder.chmod(0o777)
        self.own = _own_namespaces()

    def close(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def __call__(self, text: str) -> subprocess.CompletedProcess[str]:
        (self.folder / "test.hal").write_text(text)
        root = {"RTAPI_UID": "65534"} if os.geteuid() == 0 else {}
        env = {**os.environ, **root, "RTAPI_FIFO_PATH": str(self.folder / "fifo")}
        with (Path(tempfile.gettempdir()) / "fitmodels-halrun.lock").open("w") as lock:
            if not self.own:
                fcntl.flock(lock, fcntl.LOCK_EX)
            return subprocess.run(
                [*self.own, self.program, "-f", "test.hal"],
                cwd=self.folder, env=env, capture_output=True, text=True, timeout=120,
            )  # fmt: skip

    def answers(self, export: str, rows: Sequence[Row], thread: str, period: float) -> list[Answer]:
        """Outputs of an export for rows of inputs, one a period of the thread."""
        (self.folder / "inputs").write_text("".join(_line(row) for row in rows))
        (self.folder / "fm.hal").write_text(export)
        pins = [f"net {name} streamer.0.pin.{k}\n" for k, name in enumerate(INPUTS.values())]
        pins += [f"net {name} sampler.0.pin.{k}\n" for k, name in enumerate(OUTPUTS)]
        said = self(
            MACHINE.format(period=round(period * 1e9)) + f"loadrt streamer depth={len(rows) + 10} cfg=fbbfbb\n"
            f"loadrt sampler depth={len(rows) + 25000} cfg=fbbbbbbb\nsource {self.folder}/fm.hal\n{''.join(pins)}"
            f"addf streamer.0 {thread} 1\naddf motion-command-handler servo-thread 1\n"
            f"addf motion-controller servo-thread\naddf sampler.0 {thread}\n"
            f"loadusr -w halstreamer {self.folder}/inputs\nstart\n"
            f"loadusr -w halsampler -t -n {len(rows)} {self.folder}/answers\n"
        )
        assert said.returncode == 0, said.stderr
        table = [line.split() for line in (self.folder / "answers").read_text().splitlines()]
        assert [int(row[0]) for row in table] == list(
            range(int(table[0][0]), int(table[0][0]) + len(rows))
        )  # none lost
        return [(float(row[1]), *(word == "1" for word in row[2:])) for row in table]


def _own_namespaces() -> list[str]:
    """Command that gives a program processes and shared memory of its own; empty where that is not allowed."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-user=1000", "--map-group=1000", "--keep-caps"]
    command = ["unshare", *user, "--ipc", "--pid", "--mount-proc", "--fork", "--kill-child"]
    try:
        allowed = subprocess.run([*command, "true"], capture_output=True, timeout=20).returncode == 0
    except OSError:
        allowed = False
    return command if allowed else []


def _line(row: Row) -> str:
    values = (VELOCITY[value] if name == "idle" else value for name, value in row.items())
    return " ".join(str(int(value)) if isinstance(value, bool) else repr(value) for value in values) + "\n"
