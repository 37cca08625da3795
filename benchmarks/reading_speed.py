"""CPU time of reading, as ratios of this version to another installed one.

    python benchmarks/reading_speed.py --base OTHER/bin/python [--runs 5]

Run it with the Python that this version is installed in. Each run is a process that imports the package, reads the
file once to warm up where the file is small, and prints the CPU time of reading it alone; runs of both versions
alternate, and the ratio is that of the medians. Files: CSVs of 240, 200 000 and 1 000 000 rows and a workbook of
20 000 rows, each with edge, V, f, d, t, AW and Fc; ten rows to an edge, six in the CSV of 200 000 rows.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd

AIM = 1.1
CHILD = """
import sys, time
from fitmodels import datasets
path, repeats = sys.argv[1], int(sys.argv[2])
times = []
for _ in range(repeats):
    start = time.process_time()
    runs = datasets.read_runs(path)
    times.append(time.process_time() - start)
print(len(runs), min(times))
"""


def tests(rows, rng, each):
    """A wear test of this many rows, ``each`` to an edge."""
    edges = -(-rows // each)
    levels = {"V": (80, 120, 180), "f": (0.1, 0.2, 0.4), "d": (1, 1.5, 2.5)}
    frame = {"edge": np.repeat([f"E{i + 1}" for i in range(edges)], each)[:rows]}
    frame |= {name: np.repeat(rng.choice(of, edges), each)[:rows] for name, of in levels.items()}
    frame["t"] = np.tile(np.arange(1, each + 1) * 2.0, edges)[:rows]
    scatter = np.exp(rng.normal(0, 0.08, rows))
    wear = 0.00762 * frame["V"] ** 0.577 * frame["f"] ** 0.168 * frame["d"] ** 0.248 * frame["t"] ** 0.245 * scatter
    frame["AW"] = wear.round(4)
    frame["Fc"] = (2200 * frame["d"] * frame["f"] ** 0.75 * scatter).round(1)
    units = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm", "Fc": "N"}
    return pd.DataFrame(frame).rename(columns={name: f"{name} [{unit}]" for name, unit in units.items()})


def seconds(python, path, repeats):
    """Rows read, and least CPU time of reading in one process."""
    out = subprocess.run([python, "-c", CHILD, str(path), str(repeats)], capture_output=True, text=True, check=False)
    if out.returncode:
        raise SystemExit(f"{python} cannot read {path.name}: {out.stderr.strip().splitlines()[-1]}")
    rows, time = out.stdout.split()
    return int(rows), float(time)


def compare(base, path, repeats, runs):
    """Median CPU times of this version and of the other, from alternating processes."""
    here, there = [], []
    for _ in range(runs):
        here.append(seconds(sys.executable, path, repeats))
        there.append(seconds(base, path, repeats))
    if len({rows for rows, _ in (*here, *there)}) != 1:
        raise SystemExit(f"{path.name}: the versions read different numbers of rows")
    return median(t for _, t in here), median(t for _, t in there)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--base", required=True, metavar="PYTHON", help="interpreter of the version to compare with")
    parser.add_argument("--runs", type=int, default=5)
    args = parser.parse_args()
    rng = np.random.default_rng(1)
    print(f"{'':22}{'this':>10}{'base':>10}{'ratio':>8}   aim <= {AIM}")
    slow = False
    with tempfile.TemporaryDirectory() as folder:
        for name, rows, each, repeats in (
            ("small.csv", 240, 10, 40),
            ("edges.csv", 200_000, 6, 1),
            ("large.csv", 1_000_000, 10, 1),
            ("book.xlsx", 20_000, 10, 1),
        ):
            path, frame = Path(folder) / name, tests(rows, rng, each)
            if name.endswith("xlsx"):
                frame.to_excel(path, index=False)
            else:
                frame.to_csv(path, index=False)
            here, there = compare(args.base, path, repeats, args.runs)
            slow |= here / there > AIM
            title = f"{rows:,} rows {path.suffix}".replace(",", " ")
            print(f"{title:22}{here:9.4f}s{there:9.4f}s{here / there:8.3f}", flush=True)
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
