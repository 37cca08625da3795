"""Simulated records of the 24 bundled edges, reduced and fitted: error of the means, and laws beside those of the set.

    python benchmarks/reduce.py [RATE]

Every sub-test of the set GC435 on 709M40 is a cut of a record at RATE (1000 Hz): a drifting zero, feeding in the air,
ramps and a burst at the entry, 50 Hz ripple, noise of 2 % and an idle power, in one file an edge. Then the same at 10
Hz with noise of 1 % and cuts of 30 s, and three edges at 50 kHz (.tdms) and 1 kHz (.lvm, .mat of versions 5 and 7.3).
Aims: means within 1 % of the truth; exponents within two standard errors of those of the set.
"""

import sys
import tempfile
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.cli import main

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
records = import_module("force_records")

IDLE = 0.8  # kW
LAWS = {"P": ("V", "f", "d", "t", "AW"), "Fxz": ("V", "f", "d", "t", "AW")}
VARIANTS = (("csv", 10.0), ("tdms", 50_000.0), ("lvm", 1000.0), ("mat", 1000.0), ("mat 7.3", 1000.0))


def write(path, kind, rate, t, channels):
    """One record in a format."""
    if kind == "csv":
        records.write_table(path.with_suffix(".csv"), t, channels)
    elif kind == "tdms":
        records.write_tdms(path.with_suffix(".tdms"), rate, channels)
    elif kind == "lvm":
        records.write_lvm(path.with_suffix(".lvm"), rate, channels)
    else:
        records.write_mat(path.with_suffix(".mat"), rate, channels, hdf=kind == "mat 7.3")


def simulate(folder, rows, rate, kind):
    """A record an edge, and the plan with the measured wear."""
    (folder / "records").mkdir(parents=True)
    rng = np.random.default_rng(435)
    for edge, own in rows.groupby("edge", sort=False):
        how = {"seconds": 30.0, "noise": 0.01} if rate < 50 else {"seconds": 6.0}
        t, thrust, *_ = records.cut_signal(own["Fxz"].to_numpy(), rate, rng, **how)
        _, power, *_ = records.cut_signal(own["P"].to_numpy(), rate, rng, drift=0.02, **how)
        write(folder / "records" / str(edge), kind, rate, t, {"Fxz [N]": thrust, "P [kW]": power + IDLE})
    units = {"V": "V [m/min]", "f": "f [mm/rev]", "d": "d [mm]", "t": "t [min]", "AW": "AW [mm]"}
    rows[["edge", *units]].rename(columns=units).to_csv(folder / "tests.csv", index=False)


def reduced(folder):
    """Rows as the main job reads them, and the seconds that reducing took."""
    paths = [str(folder / name) for name in ("records", "tests.csv", "data.csv")]
    begin = perf_counter()
    with redirect_stdout(StringIO()):
        code = main(["reduce", paths[0], "--plan", paths[1], "--out", paths[2], "--value", "n=600"])
    if code:
        raise SystemExit(code)
    return datasets.read_runs(paths[2]), perf_counter() - begin


def worst(runs, rows):
    """Largest relative error of the means of each channel."""
    return {name: float(np.abs(runs.values(name) / rows[name].to_numpy() - 1).max()) for name in LAWS}


def print_laws(runs, truth):
    """Exponents from the records beside those of the set, and their distance in standard errors."""
    print(f"{'law':5}{'factor':8}{'records':>10}{'set':>10}{'SE':>9}{'distance':>10}")
    for response, factors in LAWS.items():
        one, other = (fit.power_law(data, response, list(factors)) for data in (runs, truth))
        for name in factors:
            a, b = one.params[name], other.params[name]
            se = other.bse[name]
            print(f"{response:5}{name:8}{a:10.4f}{b:10.4f}{se:9.4f}{abs(a - b) / se:10.2f}")


def study(rate):
    """All of it."""
    truth = datasets.read_runs(datasets.bundled("gc435_709m40"))
    rows: pd.DataFrame = truth.data
    three = rows[rows["edge"].isin(list(dict.fromkeys(rows["edge"]))[:3])]
    few = three.groupby("edge", sort=False).head(4)
    print(f"{'format':9}{'Hz':>7}{'edges':>7}{'cuts':>6}{'error of P':>12}{'of Fxz':>9}{'s':>7}{'remarks':>9}")
    with tempfile.TemporaryDirectory() as name:
        for k, (kind, hertz) in enumerate((("csv", rate), *VARIANTS)):
            own = rows if k < 2 else few
            folder = Path(name, str(k))
            simulate(folder, own, hertz, kind)
            runs, seconds = reduced(folder)
            error = worst(runs, own)
            remarks = int(np.count_nonzero(runs.data["remarks"])) if "remarks" in runs.data else 0
            print(f"{kind:9}{hertz:7g}{own['edge'].nunique():7}{len(own):6}{100 * error['P']:11.2f}%"
                  f"{100 * error['Fxz']:8.2f}%{seconds:7.1f}{remarks:9}", flush=True)  # fmt: skip
            if k == 0:
                first = runs
    print_laws(first, truth)


if __name__ == "__main__":
    study(float(sys.argv[1]) if len(sys.argv) > 1 else 1000.0)
