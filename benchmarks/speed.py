"""Speed as ratios from one run: the command relative to the import of its libraries, a large fit to one QR.

    python benchmarks/speed.py

Run it with the Python that fitmodels is installed in. Every figure is the median of repeated, alternating
runs, so that a drift of the processor speed affects both sides of a ratio.
"""

import subprocess
import sys
import tempfile
import time
from statistics import median

import numpy as np
import pandas as pd
from fitmodels import datasets, fit

RUNS = 9
LIBRARIES = (
    "numpy, pandas, scipy.linalg, scipy.optimize, scipy.special, matplotlib.figure, "
    "matplotlib.backends.backend_agg, pint, pydantic, jinja2, rich.console, rich.table"
)


def seconds(command):
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def against(first, second, runs=RUNS):
    """Medians of both, and of their ratio pair by pair, after one warm-up of each."""
    first(), second()
    pairs = [(first(), second()) for _ in range(runs)]
    return median(a for a, _ in pairs), median(b for _, b in pairs), median(a / b for a, b in pairs)


def command_against_imports():
    data = str(datasets.bundled("gc435_709m40"))
    with tempfile.TemporaryDirectory() as folder:
        whole = [sys.executable, "-m", "fitmodels", data, "--out", folder, "--force"]
        bare = [sys.executable, "-c", f"import {LIBRARIES}"]
        a, b, ratio = against(lambda: seconds(whole), lambda: seconds(bare))
    print(f"fitmodels data.csv / bare import of its libraries   {ratio:5.2f}   ({a:.2f} s / {b:.2f} s)   aim < 1.8")


def version():
    command = [sys.executable, "-m", "fitmodels", "--version"]
    seconds(command)
    print(f"fitmodels --version                                 {median(seconds(command) for _ in range(RUNS)):5.3f} s"
          "                      aim < 0.1 s")  # fmt: skip


def clocked(call):
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def large_fits(n=1_000_000):
    rng = np.random.default_rng(1)
    factors = {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3), "t": (1, 20)}
    X = {name: np.exp(rng.uniform(*np.log(ends), n)) for name, ends in factors.items()}
    log = np.column_stack([np.ones(n), *(np.log(x) for x in X.values())])
    y = log @ np.array([-4.9, 0.577, 0.168, 0.248, 0.245]) + 0.1 * rng.standard_normal(n)
    a, b, ratio = against(lambda: clocked(lambda: fit.linear(log, y)), lambda: clocked(lambda: np.linalg.qr(log)))
    print(f"fit.linear, 1e6 rows / numpy QR of the same matrix  {ratio:5.2f}   ({a:.2f} s / {b:.2f} s)   aim < 2")
    runs = datasets.runs_from_frame(pd.DataFrame({**X, "AW": np.exp(y)}), judge=False)
    for label, law in (
        ("fit.power_law", lambda: fit.power_law(runs, "AW", list(X))),
        ("fit.power_law, additive error", lambda: fit.power_law(runs, "AW", list(X), error="additive")),
    ):
        a, b, ratio = against(lambda law=law: clocked(law), lambda: clocked(lambda: np.linalg.qr(log)), 5)
        print(f"{label + ', 1e6 rows / the same QR':<51} {ratio:5.2f}   ({a:.2f} s / {b:.2f} s)")


def small_checks():
    """The checks and the bootstrap on a design of 24 edges x 6 rows, in one process."""
    plan = datasets.central_composite({"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}, seed=1)
    wear = datasets.SimulatedLaw("AW", "mm", 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}, 0.07, 0.07)
    rows = datasets.simulate(plan, [wear], t_max=12.0, criterion=None, seed=1)
    law = fit.power_law(datasets.runs_from_frame(rows), "AW", ["V", "f", "d", "t"])
    for label, call, aim in (
        ("fit.judge, every check, 144 rows", lambda: fit.judge(law), 100),
        ("fit.edge_bootstrap, 2000 refits, 144 rows", lambda: fit.edge_bootstrap(law, 2000), 50),
    ):
        call()
        print(f"{label:<51} {1e3 * median(clocked(call) for _ in range(RUNS)):5.1f} ms    aim < {aim} ms")


if __name__ == "__main__":
    print(f"Python {sys.version.split()[0]}, numpy {np.__version__}; medians of {RUNS} alternating runs")
    version()
    command_against_imports()
    small_checks()
    large_fits()
