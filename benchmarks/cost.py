"""CPU time and peak memory of each reader over the size of its input, with the fitted power of the size.

    python benchmarks/cost.py [--steps 4] [--only csv,xlsx] [--scale 1]

Each size is a process of its own, which reads a small file to warm up and then the large one; sizes double. CPU is that
of reading alone, memory is the growth of the peak of the process. The slope is that of the logarithm of CPU over the
logarithm of the size, without the constant part that fits best; above 1.15 a line is marked, and the exit code is 1.

Readers: tables as CSV and workbook, a table of many columns, of many edges, of many lines of notes, and of one long
cell; records as CSV.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from reading_speed import tests

LINEAR = 1.15
CHILD = """
import resource, sys, time
from fitmodels import datasets
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
def table(path):
    datasets.read_runs(path)
def record(path):
    datasets.read_record(path, input="u", output="y")
how, small, large = sys.argv[1:]
globals()[how](small)
before, start = peak(), time.process_time()
globals()[how](large)
print(time.process_time() - start, max(peak() - before, 0))
"""


def csv(path, n):
    tests(n, np.random.default_rng(1), 10).to_csv(path, index=False)


def workbook(path, n):
    tests(n, np.random.default_rng(1), 10).to_excel(path, index=False)


def columns(path, n):
    frame = tests(60, np.random.default_rng(1), 10)
    more = np.random.default_rng(2).normal(size=(len(frame), n)).round(3)
    extra = [",".join([f"channel {k}" for k in range(n)]), *(",".join(map(str, row)) for row in more)]
    lines = frame.to_csv(index=False).splitlines()
    path.write_text("\n".join(f"{line},{rest}" for line, rest in zip(lines, extra, strict=True)) + "\n", "utf-8")


def notes(path, n):
    csv(path, 60)
    above = "".join(f"# remark {k}: insert turned, D = 80 mm\n" for k in range(n))
    path.write_text(above + path.read_text("utf-8"), "utf-8")


def cell(path, n):
    frame = tests(60, np.random.default_rng(1), 10).assign(remark="ok")
    frame.loc[7, "remark"] = " 1a" * (n // 3)
    frame.to_csv(path, index=False)


def edges(path, n):
    tests(n, np.random.default_rng(1), 3).to_csv(path, index=False)


def record(path, n):
    rng = np.random.default_rng(1)
    u = np.repeat(rng.choice([0.1, 0.2], -(-n // 20)), 20)[:n]
    y = np.convolve(u, np.exp(-np.arange(40) / 8), mode="full")[:n] + 0.01 * rng.normal(size=n)
    rows = np.column_stack([np.arange(n) / 1000, u, y])
    np.savetxt(path, rows, fmt="%.6g", delimiter=",", header="t [s],u,y", comments="")


READERS = {  # reader -> what the child calls, ending, maker, smallest of the doubled sizes, size of the warm-up
    "csv, rows": ("table", "csv", csv, 25_000, 240),
    "xlsx, rows": ("table", "xlsx", workbook, 2_000, 240),
    "csv, columns": ("table", "csv", columns, 250, 5),
    "csv, edges of 3 rows": ("table", "csv", edges, 6_000, 240),
    "csv, lines of notes": ("table", "csv", notes, 250, 5),
    "csv, characters of a cell": ("table", "csv", cell, 8_000, 30),
    "record csv, rows": ("record", "csv", record, 25_000, 2_000),
}


def measured(how, small, large):
    """CPU time in s and growth of the peak memory in MB of reading one file in a process of its own."""
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CHILD, how, str(small), str(large)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if run.returncode:
        raise SystemExit(f"{large.name}: {(run.stderr or run.stdout).strip().splitlines()[-1]}")
    return [float(text) for text in run.stdout.split()]


def slope(sizes, cpu):
    """Power of the size with which CPU grows, and next to it a constant part that the same times determine."""
    best = (np.inf, 0.0)
    for constant in np.linspace(0, 0.95, 96) * min(cpu):
        net = np.log(np.array(cpu) - constant)
        power, at_one = np.polyfit(np.log(sizes), net, 1)
        best = min(best, (float(np.sum((net - power * np.log(sizes) - at_one) ** 2)), float(power)))
    return best[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=4, help="sizes, each double the one before")
    parser.add_argument("--scale", type=float, default=1.0, help="factor of all sizes")
    parser.add_argument("--only", default="", help="readers whose names contain one of these, by commas")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    wanted, rows = [word for word in args.only.split(",") if word], []
    print(f"{'reader':28}{'sizes':>20}{'CPU, s':>32}{'peak, MB':>12}{'slope':>8}   limit {LINEAR}")
    with tempfile.TemporaryDirectory() as folder:
        for name, (how, ending, make, first, least) in READERS.items():
            if wanted and not any(word in name for word in wanted):
                continue
            small = Path(folder) / f"small.{ending}"
            make(small, least)
            sizes, cpu, memory = [int(first * args.scale * 2**k) for k in range(args.steps)], [], []
            for size in sizes:
                large = Path(folder) / f"large-{size}.{ending}"
                make(large, size)
                one, peak = measured(how, small, large)
                cpu.append(one)
                memory.append(peak)
            power = slope(sizes, cpu)
            rows.append({"reader": name, "sizes": sizes, "cpu": cpu, "memory": memory, "slope": power})
            shown, over = " ".join(f"{one:7.3f}" for one in cpu), " *" if power > LINEAR else ""
            span = f"{sizes[0]} to {sizes[-1]}"
            print(f"{name:28}{span:>20}{shown:>32}{memory[-1]:12.1f}{power:8.2f}{over}", flush=True)
    if args.json:
        print(json.dumps(rows))
    return int(any(row["slope"] > LINEAR for row in rows))


if __name__ == "__main__":
    sys.exit(main())
