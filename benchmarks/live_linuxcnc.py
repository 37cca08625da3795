"""The whole LinuxCNC with a hidden wear, and `fitmodels watch` beside it: is the tool change called within the window?

    python benchmarks/live_linuxcnc.py                     # 50 runs, two at once, about 25 minutes
    python benchmarks/live_linuxcnc.py --runs 4 --at-once 1
    python benchmarks/live_linuxcnc.py --runs 0 --control 5    # control with --write, and its end: about two minutes

Each run has an edge of its own: levels of wear and load and a time exponent from another generator than that of the
tests that the laws are fitted to, and a load that wanders. Wear is some 60 times as fast as on a machine, so that an
edge lasts half a minute of cutting; passes alternate between two feeds. After a third of the life one gauge reading is
handed in. The call of the change is within the window where the true wear is 180 to 220 um; the criterion is 220 um.

With --control, `fitmodels watch --write` sets a reference below that of the file and is killed, or stopped as if it
hung, in mid-cut: mean load over the reference, time to the fault and to the lower limit of the feed, whether they last.
"""

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from linuxcnc_machine import lacking, plant_module
from linuxcnc_watch import (
    WINDOW,
    control_figures,
    control_run,
    run_beside,
    run_worn,
    wear_module,
    worn_file,
    worn_run,
)

FEED_LOW = 600.0  # mm/min, of the file


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--at-once", type=int, default=2)
    parser.add_argument("--control", type=int, default=0, help="runs with --write for each of kill and stop")
    parser.add_argument("--first", type=int, default=1, help="seed of the first run")
    args = parser.parse_args()
    if lacking():
        print(f"cannot run: {lacking()}")
        return 2
    with tempfile.TemporaryDirectory(prefix="fitmodels-worn-") as folder, ThreadPoolExecutor(args.at_once) as pool:
        unsafe = _control(args.control, Path(folder), pool) if args.control else 0
        return int(_worn(args, Path(folder), pool) or unsafe) if args.runs else int(unsafe > 0)


def _worn(args: argparse.Namespace, folder: Path, pool: ThreadPoolExecutor) -> bool:
    """Whether fewer than nine of ten changes were called within the window."""
    plant, params = wear_module(folder), worn_file(folder)
    print("run   level   load  exponent   gauged    wear  seconds of cut   within", flush=True)
    wear = np.array(list(pool.map(lambda k: _one(k, plant, params), range(args.first, args.first + args.runs))))
    inside = (wear >= WINDOW[0]) & (wear <= WINDOW[1])
    print(f"called within {WINDOW[0]:g} to {WINDOW[1]:g} um: {inside.sum()} of {len(wear)} runs")
    print(f"called late {np.sum(wear > WINDOW[1])}, early {np.sum(wear < WINDOW[0])}, never {np.isnan(wear).sum()}")
    print(f"wear at the call: median {np.nanmedian(wear):.0f} um, {np.nanmin(wear):.0f} to {np.nanmax(wear):.0f} um")
    return bool(inside.sum() < 0.9 * len(wear))


def _control(runs: int, folder: Path, pool: ThreadPoolExecutor) -> int:
    """Runs that did not end at the lower limit, latched."""
    plant = plant_module(folder)
    print("signal  load/reference  fault after  lower limit after  feed at the end, mm/min  latched", flush=True)
    wanted = [signal for _ in range(runs) for signal in ("KILL", "STOP")]
    made = [control_run(folder, signal) for signal in wanted]
    unsafe = 0
    for signal, (trace, _) in zip(wanted, pool.map(lambda pair: run_beside(*pair, plant), made), strict=True):
        found = control_figures(trace)
        latched = found["latched"] > 0 and found["feed"] <= 1.001 * FEED_LOW
        unsafe += not latched
        print(
            f"{signal:6} {found['load']:15.4f} {found['fault']:10.2f} s {found['low']:16.2f} s {found['feed']:20.1f}"
            f"         {'yes' if latched else 'NO'}",
            flush=True,
        )
    print(f"{unsafe} of {len(wanted)} runs did not end in the safe state")
    return unsafe


def _one(seed: int, plant: Path, params: str) -> float:
    run, truth = worn_run(seed, params)
    found = run_worn(run, plant)
    wear = float(found["wear"])
    print(
        f"{seed:3} {truth['level']:7.3f} {truth['load']:6.3f} {truth['m']:9.3f} {found['gauged']:8.0f} {wear:7.1f} "
        f"{found['seconds']:15.1f}   {'yes' if WINDOW[0] <= wear <= WINDOW[1] else 'NO'}",
        flush=True,
    )
    return wear


if __name__ == "__main__":
    sys.exit(main())
