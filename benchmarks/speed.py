"""Processor time of each wait of a user as ratios to its limit, to what one would use instead and to an older version.

    python benchmarks/speed.py                               the table, about ten minutes
    python benchmarks/speed.py --only "main job" --runs 9    the waits whose names contain a word
    python benchmarks/speed.py --against OLD/bin/python      beside a version that another Python has installed
    python benchmarks/speed.py --site 1000                   and a site of 1000 cards, which is long
    python benchmarks/speed.py --sizes speed.svg             processor time and memory over sizes, slopes, a figure

Run it with the Python that fitmodels is installed in. Everything is measured in a process of its own: its processor
time with that of its children (commands), or that of one call after a smaller one (calls). What a row compares runs in
alternation, so that a drift of the processor speed affects both sides; times are medians, ratios are medians of the
ratios of each round. NumPy has one thread. The limit is what no program of this kind can avoid: the import of its
libraries, one read of its data, one QR of its numbers. Libraries that are compared where they are installed:
statsmodels and emcee (always), process-improve, sippy_unipi. All data are simulated.

The slope of `--sizes` is that of the logarithm of the processor time without that of the least size, over the logarithm
of the size, where it is a fifth above the least: 1 is linear. `--only` and `--against` hold for it, too.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
CALLS = str(HERE / "speed_calls.py")
BUNDLED = HERE.parent / "datasets/gc435_709m40/data.csv"
MAC = sys.platform == "darwin"
FIRST = "numpy, pandas, scipy.linalg, scipy.optimize, scipy.special"  # imports that the first law cannot do without
# imports of the main job: frozen, so that ratios of different versions are comparable
LIBRARIES = (
    "numpy, pandas, scipy.linalg, scipy.optimize, scipy.special, matplotlib.figure, "
    "matplotlib.backends.backend_agg, pint, pydantic, jinja2, rich.console, rich.table"
)
PAIRS, LOOPED = 10_000, 200  # pairs, and how many of them a loop fits that is extrapolated
ROWS, MILLION = 1_500_000, 1_000_000  # rows of one law, streamed and in memory
# the command, ended when the verdict of a law is written to standard output
UNTIL_VERDICT = """
import os, sys
from fitmodels.cli import entry
class Screen:
    def __init__(self, screen):
        self.screen = screen
    def __getattr__(self, name):
        return getattr(self.screen, name)
    def write(self, text):
        if "usable" in text:
            os._exit(0)
        return self.screen.write(text)
sys.stdout = Screen(sys.stdout)
sys.exit("no verdict" if entry() == 0 else 1)
"""


@dataclass(frozen=True)
class Other:
    """What a wait is compared with; ``times`` where a part of the work is extrapolated, ``aim`` the largest ratio."""

    name: str
    words: list[str]
    aim: float | None = None
    times: float = 1.0


@dataclass(frozen=True)
class Wait:
    """A wait of a user: its command, what it is compared with, aims in seconds and to the older version."""

    name: str
    words: list[str]
    others: tuple[Other, ...] = ()
    seconds: float | None = None
    before: float | None = None
    runs: int = 7
    prepare: Callable[[], None] | None = None


def call(name, size, small, *more):
    """Words of a call after one of a smaller size."""
    return ["{python}", CALLS, "--call", name, str(size), str(small), *map(str, more)]


def waits_of_commands():
    """Waits of the commands on one file."""
    command, run = ["{python}", "-m", "fitmodels"], ["{python}", "-c"]
    job, scripts = [str(BUNDLED), "--out", "{new}"], ["{python}", CALLS]
    python = Other("bare Python", [*run, ""])
    return [
        Wait("fitmodels --version", [*command, "--version"], (python,), seconds=0.1),
        Wait("fitmodels -h", [*command, "-h"], (python,), seconds=0.1),
        Wait("first law with its verdict on the screen", [*run, UNTIL_VERDICT, *job], (
            Other("import numpy, pandas and scipy", [*run, f"import {FIRST}"], 1.5),
            Other("statsmodels: script with this law", [*scripts, "script", "first"]),
            *optional("process_improve", Other("process-improve: this law by lm", [*scripts, "process_improve"])),
        )),
        Wait("main job, fitmodels data.csv", [*command, *job], (
            Other("import of its libraries", [*run, f"import {libraries()}"], 1.4),
            Other("statsmodels: script with its laws", [*scripts, "script", "all"]),
            Other("emcee: 4000 effective draws of its laws", call("emcee_of_laws", 1500, 100)),
        ), runs=5),
    ]  # fmt: skip


def waits_of_batch(folder):
    """``fitmodels batch`` on a Parquet file of many pairs."""
    path = folder / "pairs.parquet"
    loop = call("loop_over_file", LOOPED, 5, path)
    return [
        Wait(f"batch, {PAIRS} pairs from Parquet", batch(path), (
            Other("read of the file by pyarrow", call("read_parquet", 0, 0, path)),
            Other(f"statsmodels: loop, from {LOOPED} pairs", loop, 1 / 35, PAIRS / LOOPED),
        ), before=0.55, runs=3, prepare=partial(prepared, "write_pairs", path, PAIRS)),
    ]  # fmt: skip


def batch(path):
    """Words of ``fitmodels batch`` for the table only."""
    return ["{python}", "-m", "fitmodels", "batch", str(path), "--out", "{new}", "--table-only", "--jobs", "1"]


def waits_of_calls():
    """Waits of functions."""
    loop = call("statsmodels_of_pairs", LOOPED, 5)
    qr = Other("QR by numpy", call("qr_of_law", MILLION, 2000))
    return [
        Wait("fit.streamed_power_law, 1.5e6 rows", call("streamed_law", ROWS, 2000), (
            Other("QR of the rows by numpy", call("qr_of_rows", ROWS, 2000)),
            Other("statsmodels: OLS by edge (CR1)", call("statsmodels_of_rows", ROWS, 2000)),
        ), before=0.2, runs=5),
        Wait(f"fit.many_power_laws, {PAIRS} pairs", call("many_power_laws", PAIRS, 100), (
            Other("QR of each pair by numpy", call("qr_of_pairs", PAIRS, 100)),
            Other(f"statsmodels: loop, from {LOOPED} pairs", loop, 1 / 20, PAIRS / LOOPED),
        ), runs=5),
        Wait("ident.identify, 750 samples", call("identify", 750, 600), beside_identify(750), seconds=0.2),
        Wait("ident.identify, 1e5 samples", call("identify", 100_000, 750), beside_identify(100_000), 1.0, runs=3),
        Wait("fit.linear, 1e6 rows", call("linear", MILLION, 2000), (replace(qr, aim=2.0),), runs=5),
        Wait("fit.power_law, 1e6 rows", call("power_law", MILLION, 2000), (qr,), runs=3),
        Wait("the same, additive error", call("power_law", MILLION, 2000, "additive"), (qr,), runs=3),
        Wait("fit.judge, every check, 144 rows", call("judge", 0, 0), seconds=0.1),
        Wait("fit.edge_bootstrap, 2000 refits, 144 rows", call("edge_bootstrap", 2000, 1000), seconds=0.05),
    ]  # fmt: skip


def beside_identify(n):
    """The limit of an identification, and SIPPY, extrapolated from 10 000 samples where there are more."""
    part = min(n, 10_000)
    theirs = Other("SIPPY: ARMAX, orders by BIC", call("sippy", part, 300), times=n / part)
    limit = Other("QR of its ARX regression, order 10", call("qr_of_record", n, 600))
    return limit, *optional("sippy_unipi", theirs)


def waits_of_site(cards, folder):
    """``fitmodels publish`` of many cards."""
    pairs = folder / "pairs"
    read = f"import json, pathlib\nfor p in pathlib.Path({str(pairs)!r}).rglob('*.json'): json.loads(p.read_bytes())"
    limit = Other("read of its parameter files as JSON", ["{python}", "-c", read])
    prepare = partial(prepared, "write_site_pairs", pairs, cards)
    return [Wait(f"publish, site of {cards} cards", publish(pairs), (limit,), before=0.5, runs=1, prepare=prepare)]


def publish(pairs):
    """Words of ``fitmodels publish``."""
    return ["{python}", "-m", "fitmodels", "publish", str(pairs), "--site", "{new}", "--jobs", "1"]


def prepared(name, path, count):
    """Run a function that writes input, in a process of its own: memory of this one would count for its children."""
    subprocess.run([sys.executable, CALLS, name, str(path), str(count)], check=True)


def optional(module, other):
    """The comparison where its library is installed."""
    return (other,) if find_spec(module) else ()


def libraries():
    """The frozen list without what is not installed."""
    return ", ".join(name for name in LIBRARIES.split(", ") if find_spec(name.split(".")[0]))


def measured(words, python=sys.executable):
    """Processor seconds and peak memory in MB of a process with its children, or those that it prints of its call."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
        words = [{"{python}": python, "{new}": f"{folder}/new"}.get(word, word) for word in words]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # the warm-up compiles modules and templates, as a first run
        process = subprocess.Popen(words, stdout=said, stderr=subprocess.STDOUT, env=environment)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode(errors="replace")
    if process.returncode:
        raise SystemExit(f"{' '.join(words)[:200]}: exit code {process.returncode}\n{text[-500:]}")
    if "--call" in words:
        return json.loads(text)
    return {"seconds": used.ru_utime + used.ru_stime, "MB": used.ru_maxrss / (1024**2 if MAC else 1024)}


def row_of(wait, against, runs):
    """Lines of the table: the wait, then what it is compared with."""
    sides = [(wait.words, sys.executable, 1.0), *((other.words, sys.executable, other.times) for other in wait.others)]
    if against:
        sides.append((wait.words, against, 1.0))
    rounds = []
    for _ in range(runs + (runs > 1)):  # the first is a warm-up
        found = [measured(words, python) for words, python, _ in sides]
        rounds.append([one["seconds"] * times for one, (*_, times) in zip(found, sides, strict=True)])
    rounds = rounds[-runs:]
    seconds = [median(column) for column in zip(*rounds, strict=True)]
    aim = f"aim {wait.seconds:g} s" if wait.seconds else ""
    lines = [f"{wait.name:46}{seconds[0]:9.3f}{found[0]['MB']:9.0f}   {aim}"]
    names = [(other.name, other.aim) for other in wait.others] + [("the older version", wait.before)] * bool(against)
    for k, (name, aim) in enumerate(names, 1):
        ratio = median(one[0] / one[k] for one in rounds)
        shown = f"{ratio:6.2f}" if ratio > 0.1 else f"1/{1 / ratio:<4.0f}"
        memory = f"{found[0]['MB'] / found[-1]['MB']:17.2f}" if k > len(wait.others) else ""
        goal = "" if aim is None else f"   aim {aim:g}" if aim > 0.1 else f"   aim 1/{1 / aim:.0f}"
        lines.append(f"    {name:42}{seconds[k]:9.3f}{'':10}{shown:>8}{goal}{memory}")
    return lines


# Sizes


def job(path):
    """Words of the main job on a table of one pair."""
    return ["{python}", "-m", "fitmodels", str(path), "--out", "{new}"]


SIZES = {  # name -> its least size and the doubled sizes; what writes the input and the command, or the call
    "main job, rows": ((240, 12_000, 24_000, 48_000, 96_000), "write_rows", "rows-{}.csv", job),
    "batch, pairs": ((10, 5000, 10_000, 20_000, 40_000), "write_pairs", "pairs-{}.parquet", batch),
    "fit.streamed_power_law, rows": ((5000, 750_000, ROWS, 2 * ROWS, 4 * ROWS), "streamed_law"),
    "fit.many_power_laws, pairs": ((10, 2500, 5000, 10_000, 20_000), "many_power_laws"),
    "ident.identify, samples": ((750, 25_000, 50_000, 100_000, 200_000), "identify"),
    "publish, cards": ((2, 20, 40, 80, 160), "write_site_pairs", "pairs-{}", publish),
}


def words_of_size(name, n, folder):
    """Words that do the work of this size; what they read is written first."""
    sizes, what, *command = SIZES[name]
    if not command:
        return call(what, n, sizes[0])
    path = folder / command[0].format(n)
    prepared(what, path, n)
    return command[1](path)


def over_sizes(name, pythons, runs):
    """Least processor seconds and peak memory, shape (versions, sizes, 2), versions in alternation."""
    found = []
    for n in SIZES[name][0]:
        with tempfile.TemporaryDirectory() as folder:
            words = words_of_size(name, n, Path(folder))
            rounds = [[measured(words, python) for python in pythons] for _ in range(runs)]
        found.append(
            [[min(one[what] for one in side) for what in ("seconds", "MB")] for side in zip(*rounds, strict=True)]
        )
    return list(zip(*found, strict=True))


def slope(sizes, values):
    """Power of the size with which the values grow beyond that of the least size; None where they hardly do."""
    import numpy as np

    net, size = np.array(values[1:]) - values[0], np.array(sizes[1:]) - sizes[0]
    clear = net > 0.2 * values[0]  # below, the noise of what does not depend on the size decides
    return float(np.polyfit(np.log(size[clear]), np.log(net[clear]), 1)[0]) if clear.sum() > 1 else None


def print_sizes(names, against, runs, figure):
    """Print processor time, memory and slopes of each over its sizes, and draw them."""
    pythons = [sys.executable, *([against] if against else [])]
    found = {}
    for name in names:
        found[name] = over_sizes(name, pythons, runs)
        sizes = SIZES[name][0]
        print(f"{name:32}" + "".join(f"{n:>10}" for n in sizes) + "     slope")
        for version, points in zip(("", ", older version"), found[name], strict=False):
            for k, (what, form) in enumerate((("CPU, s", "10.3f"), ("peak, MB", "10.0f"))):
                values = [point[k] for point in points]
                power = slope(sizes, values)
                shown = "-" if power is None else f"{power:.2f}"
                print(
                    f"    {what + version:28}" + "".join(f"{value:{form}}" for value in values) + f"{shown:>10}",
                    flush=True,
                )
    draw(found, figure)


def draw(found, path):
    """Both figures over the size, logarithmic; the older version is dashed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.5), layout="constrained")
    for k, (axes, label) in enumerate(zip(figure.subplots(1, 2), ("CPU, s", "peak memory, MB"), strict=True)):
        for color, (name, versions) in enumerate(found.items()):
            for line, points in zip(("o-", "s--"), versions, strict=False):
                values = [point[k] for point in points[1:]]
                axes.loglog(SIZES[name][0][1:], values, line, color=f"C{color}", label=name if line == "o-" else None)
        axes.set(xlabel="size", ylabel=label)
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8, title="dashed: older version" if len(versions) > 1 else None)
    figure.savefig(path)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--against", metavar="PYTHON", help="interpreter of the version to compare with")
    parser.add_argument("--only", default="", help="rows whose names contain one of these, by commas")
    parser.add_argument("--runs", type=int, help="rounds of every row")
    parser.add_argument("--site", type=int, metavar="CARDS", help="a site of so many cards, too")
    parser.add_argument("--sizes", metavar="FIGURE", help="processor time and memory over sizes instead of the table")
    given = parser.parse_args()

    def wanted(name):
        return any(word in name for word in given.only.split(","))

    absent = ", ".join(name for name in ("pint", "process_improve", "sippy_unipi") if not find_spec(name))
    print(f"Python {sys.version.split()[0]}, load {os.getloadavg()[0]:.1f}; not installed: {absent or '-'}")
    if given.sizes:
        print_sizes([name for name in SIZES if wanted(name)], given.against, given.runs or 2, given.sizes)
        return
    print(f"{'':46}{'CPU, s':>9}{'peak, MB':>10}{'ratio':>7}{'peak, ratio':>20}")
    with tempfile.TemporaryDirectory() as folder:
        waits = [*waits_of_commands(), *waits_of_calls(), *waits_of_batch(Path(folder))]
        waits += waits_of_site(given.site, Path(folder)) if given.site else []
        for wait in waits:
            if wanted(wait.name):
                if wait.prepare:
                    wait.prepare()
                print(*row_of(wait, given.against, given.runs or wait.runs), sep="\n", flush=True)


if __name__ == "__main__":
    main()
