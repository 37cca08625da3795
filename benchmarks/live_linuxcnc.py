"""The whole LinuxCNC with a hidden wear, and `fitmodels watch` beside it: is the tool change called within the window?

    python benchmarks/live_linuxcnc.py                     # 50 runs, two at once, about 25 minutes
    python benchmarks/live_linuxcnc.py --runs 4 --at-once 1

Each run has an edge of its own: levels of wear and load and a time exponent from another generator than that of the
tests that the laws are fitted to, and a load that wanders. Wear is some 60 times as fast as on a machine, so that an
edge lasts half a minute of cutting; passes alternate between two feeds. After a third of the life one gauge reading is
handed in. The call of the change is within the window where the true wear is 180 to 220 um; the criterion is 220 um.
"""

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from linuxcnc_machine import lacking
from linuxcnc_watch import WINDOW, run_worn, wear_module, worn_file, worn_run


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--at-once", type=int, default=2)
    parser.add_argument("--first", type=int, default=1, help="seed of the first run")
    args = parser.parse_args()
    if lacking():
        print(f"cannot run: {lacking()}")
        return 2
    with tempfile.TemporaryDirectory(prefix="fitmodels-worn-") as folder:
        plant, params = wear_module(Path(folder)), worn_file(Path(folder))
        seeds = range(args.first, args.first + args.runs)
        print("run   level   load  exponent   gauged    wear  seconds of cut   within", flush=True)
        with ThreadPoolExecutor(args.at_once) as pool:
            called = list(pool.map(lambda seed: _one(seed, plant, params), seeds))
    wear = np.array(called)
    inside = (wear >= WINDOW[0]) & (wear <= WINDOW[1])
    print(f"called within {WINDOW[0]:g} to {WINDOW[1]:g} um: {inside.sum()} of {len(wear)} runs")
    print(f"called late {np.sum(wear > WINDOW[1])}, early {np.sum(wear < WINDOW[0])}, never {np.isnan(wear).sum()}")
    print(f"wear at the call: median {np.nanmedian(wear):.0f} um, {np.nanmin(wear):.0f} to {np.nanmax(wear):.0f} um")
    return int(inside.sum() < 0.9 * len(wear))


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
