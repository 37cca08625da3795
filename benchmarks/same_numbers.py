"""Comparison of all numbers that two installed versions compute from the bundled and the real sets.

    python benchmarks/same_numbers.py OLD/bin/fitmodels NEW/bin/fitmodels

Both run each command below. Numbers are compared leaf by leaf in what it prints as JSON and in the JSON files that it
writes; texts, times, versions and hashes are not. Coefficients are compared in units of their standard error where
there is one, every other number relative to the larger of both. Real sets are read from FITMODELS_DATA. A number
that one version alone has is listed.
"""

import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
IGNORED = re.compile(r"sha256|fitmodels$|version|seconds|elapsed|created|date|columns\[|understood\.columns|\.line$")
SMALL = 1e-300


def tables(real):
    """Files of tests: bundled, of the documentation, and real ones."""
    yield from sorted((ROOT / "datasets").glob("*/data.csv"))
    yield from sorted(path for path in (ROOT / "docs/examples").glob("*.csv") if "drive" not in path.name)
    if real:
        yield from sorted(path for path in (real / "nasa_milling").glob("*.csv"))
        yield from sorted(path for path in (real / "turning_forces").glob("*.csv"))
        yield from sorted(path for path in (real / "cnc_mill_current").glob("*.csv"))[:3]


def records(real):
    """Records of runs, with the options that each needs."""
    yield ROOT / "docs/examples/drive.csv", []
    yield ROOT / "docs/examples/drive.csv", ["--held-out", str(ROOT / "docs/examples/drive-again.csv")]
    if real:
        yield real / "emps/data_emps.csv", ["--input", "vir", "--output", "qm", "--unit", "output=m"]
        servo = ["--input", "col3", "--output", "col4", "--time", "col1", "--unit", "time=ms"]
        yield from ((path, servo) for path in sorted((real / "servo_sweep").glob("*.txt")))
        for name, sample_time in (("dryer", "0.08"), ("robot_arm", "0.01")):
            yield real / f"daisy/{name}.dat", ["--input", "col1", "--output", "col2", "--sample-time", sample_time]


def jobs(real):
    """Name and words of each command; ``{out}`` is a new folder."""
    for path in tables(real):
        name = f"{path.parent.name}/{path.name}"
        yield name, [str(path), "--json", "--out", "{out}"]
        if path.parent.parent.name == "datasets":
            yield f"{name} additive", [str(path), "--json", "--error", "additive", "--out", "{out}"]
    for number, (path, options) in enumerate(records(real)):
        yield f"ident {number} {path.name}", ["ident", str(path), "--json", "--out", "{out}", *options]
    yield "milling to a constant-load loop", [
        str(ROOT / "docs/examples/fraesen.csv"), "--out", "{out}",
        *("&&", "settings", "{out}/AA238M_S45C/params.json", "--worn", "0.28"),
        *("&&", "ident", str(ROOT / "docs/examples/drive.csv"), "--params", "{out}/AA238M_S45C/params.json"),
        *("&&", "tune", "{out}/AA238M_S45C/params.json", "--rise", "2", "--settle", "4", "--probability", "0.9"),
        *("&&", "check", "{out}/AA238M_S45C/params.json", "--json"),
    ]  # fmt: skip
    yield "wear to limits and a replay", [
        str(ROOT / "docs/examples/verschleiss.csv"), "--out", "{out}",
        *("&&", "limits", "{out}/GC435_709M40/params.json", "P=7kW", "VB=0.3mm", "V=50:200m/min", "f=0.06:0.6mm/rev"),
        *("&&", "replay", "{out}/GC435_709M40/params.json", "--json"),
    ]  # fmt: skip
    for paper in ("AC-2016", "AC-2017", "CLM-2023", "SURF", "LYAP"):
        yield f"replay {paper}", ["replay", paper, "--json"]


def numbers(value, path=""):
    """Every number of a JSON value with its path."""
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, int | float):
        yield path, float(value)
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from numbers(item, f"{path}.{key}")
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from numbers(item, f"{path}[{number}]")


def standard_errors(value, path=""):
    """Standard error of each coefficient that a law or a model of a JSON value has, by the coefficient's path."""
    if isinstance(value, dict):
        errors = value.get("standard_errors")
        if isinstance(errors, dict):
            for name, error in errors.items():
                if isinstance(error, int | float) and error > 0:
                    yield f"{path}.coefficients.{name}", float(error)
        for key, item in value.items():
            yield from standard_errors(item, f"{path}.{key}")
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from standard_errors(item, f"{path}[{number}]")


def run(command, words):
    """Exit code, and every JSON value of a command: of standard output and of the files it writes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        for step in " ".join(words).replace("{out}", str(out)).split(" && "):
            done = subprocess.run([command, *step.split()], capture_output=True, text=True, cwd=folder, check=False)
        values = {}
        if done.stdout.lstrip().startswith(("{", "[")):
            values["stdout"] = json.loads(done.stdout)
        for path in sorted(Path(folder).rglob("*.json")):
            values[path.relative_to(folder).as_posix()] = json.loads(path.read_text("utf-8"))
        return done.returncode, values, done.stderr.strip().splitlines()[-1:]


def compare(old, new):
    """Count, largest relative difference and that in standard errors with their places, and paths of one side alone."""
    scale = dict(standard_errors(old))
    a, b = ({place: n for place, n in numbers(side) if not IGNORED.search(place)} for side in (old, new))
    worst, worst_se = (0.0, ""), (0.0, "")
    for place in a.keys() & b.keys():
        x, y = a[place], b[place]
        if x == y or (math.isnan(x) and math.isnan(y)):
            continue
        if place in scale:
            worst_se = max(worst_se, (abs(x - y) / scale[place], place))
        else:
            worst = max(worst, (abs(x - y) / max(abs(x), abs(y), SMALL), place))
    return len(a.keys() & b.keys()), worst, worst_se, sorted(a.keys() ^ b.keys())


def main():
    """Print a line a command, and the largest differences of all."""
    old_command, new_command = (str(Path(word).absolute()) for word in sys.argv[1:3])
    real = Path(os.environ["FITMODELS_DATA"]) if os.environ.get("FITMODELS_DATA") else None
    total, largest, largest_se = 0, (0.0, ""), (0.0, "")
    print(f"{'command':44}{'exit':>8}{'numbers':>9}{'relative':>11}{'in SE':>11}  alone")
    for name, words in jobs(real):
        (code_a, old, said_a), (code_b, new, said_b) = run(old_command, words), run(new_command, words)
        count, worst, worst_se, alone = compare(old, new)
        total += count
        largest, largest_se = (
            max(one, (two[0], f"{name} {two[1]}")) for one, two in ((largest, worst), (largest_se, worst_se))
        )
        codes = str(code_a) if code_a == code_b else f"{code_a}/{code_b}"
        print(f"{name:44}{codes:>8}{count:>9}{worst[0]:>11.1e}{worst_se[0]:>11.1e}  {len(alone)} {' '.join(alone[:3])}")
        if worst[0] > 1e-8:
            print(f"    largest at {worst[1]}")
        if code_a != code_b:
            print(
                *(f"    {side}: {text}" for side, texts in (("old", said_a), ("new", said_b)) for text in texts),
                sep="\n",
            )
    print(f"\n{total} numbers; largest relative difference {largest[0]:.1e} ({largest[1]});")
    print(f"largest difference of an estimate {largest_se[0]:.1e} standard errors ({largest_se[1]})")


if __name__ == "__main__":
    main()
