"""Faults in the whole LinuxCNC: every scenario of ``tests/linuxcnc_faults.py`` with an export, as a table.

    python benchmarks/linuxcnc_faults.py                       # HAL export and component, about five minutes
    python benchmarks/linuxcnc_faults.py --kind hal --traces FOLDER --only NaN

Detection and lower limit in s after the fault, feeds in mm/min. A/worn is the largest mean current over 0.2 s, from
0.5 s after detection, as a share of what a worn tool withstands; differ is the largest difference between the
recorded override and that of ConstantLoad on the recorded inputs.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from linuxcnc_faults import SCENARIOS, loops_and_runs, run_all
from linuxcnc_machine import lacking, plant_module
from linuxcnc_outcomes import faults_of, figures, unequal

HEAD = (
    f"{'kind':5}{'fault':52}{'detect':>8}{'low':>7}{'u before':>9}{'most':>7}{'bound':>7}{'feed max':>9}{'end':>7}"
    f"{'A/worn':>8}{'differ':>9}  failed"
)


def _number(value: float | None, width: int, digits: int = 3) -> str:
    return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kind", choices=("hal", "comp"), action="append", help="export, by default both")
    parser.add_argument("--only", action="append", help="scenarios whose name contains this")
    parser.add_argument("--traces", type=Path, help="folder for one .npz per run")
    args = parser.parse_args()
    if lacking():
        print(f"cannot run: {lacking()}")
        return 2
    chosen = [scenario for scenario in SCENARIOS if not args.only or any(words in scenario.name for words in args.only)]
    failed = 0
    print(HEAD, flush=True)
    with tempfile.TemporaryDirectory(prefix="fitmodels-plant-") as folder:
        plant = plant_module(Path(folder))
        for kind in args.kind or ("hal", "comp"):
            loops, runs = loops_and_runs(chosen, kind, Path(folder))
            for scenario, loop, trace in zip(chosen, loops, run_all(runs, plant), strict=True):
                f = figures(trace, loop)
                wrong = faults_of(scenario, kind, trace, loop)
                failed += bool(wrong)
                print(
                    f"{kind:5}{scenario.name:52}{_number(f.detected, 8)}{_number(f.low, 7)}{f.before:9.3f}{f.most:7.3f}"
                    f"{f.bound:7.3f}{f.most_feed:9.1f}{f.feed:7.0f}{f.load / f.worn:8.3f}"
                    f"{unequal(scenario, kind, trace, loop):9.1e}  {'; '.join(wrong)}",
                    flush=True,
                )
                if args.traces:
                    args.traces.mkdir(parents=True, exist_ok=True)
                    name = "".join(c if c.isalnum() else "-" for c in f"{kind} {scenario.name}")
                    np.savez_compressed(args.traces / f"{name}.npz", **trace)
    print(f"{failed} of the runs failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
