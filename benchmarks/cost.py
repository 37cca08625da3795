"""CPU time and peak memory of readers and writers over the size of their input, with the fitted power of the size.

    python benchmarks/cost.py [--steps 4] [--only csv,xlsx] [--scale 1]

Each size is a process of its own, which does the same with a small input, twice, and then with the large one; sizes
double. CPU is that of the large one, memory is the growth of the peak of the process. The slope is of the logarithm of
CPU without that of the small input, over the logarithm of the size; each size that gives more than 1.15 is measured
again and the least counts. Where less than 0.2 s depend on the size, the row says so. A slope above 1.15 is marked,
its reason follows where one is known, and without one the exit code is 1.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from fitmodels import parameters
from fitmodels.parameters.file import as_bytes, sealed
from fitmodels.parameters.published import published
from fuzz_forms import good, reduced, said, write_table
from reading_speed import tests

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

EXAMPLES = Path(__file__).resolve().parent.parent / "docs" / "examples"
LINEAR = 1.15
SEEN = 0.2  # s of CPU that must depend on the size for a slope
CACHE = "arrays outgrow the cache of the processor: 1.14 from 1.6e6 samples on"
REASONS = {"read record mat, rows": CACHE, "read record tdms, rows": CACHE}  # why a row grows faster than its input
CHILD = """
import contextlib, io, os, resource, sys, time
import fitmodels
from fitmodels import datasets, parameters
from fitmodels.cli import main
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
def cpu(folder):
    os.chdir(folder)
    before = time.process_time()
    if how == "table":
        datasets.read_runs(*given)
    elif how == "record":
        datasets.read_record(*given, input="u", output="y")
    elif how == "params":
        parameters.read(*given)
    else:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
            code = main([how, *given])
        if code not in (0, 3, 4):
            sys.exit(f"exit code {code}: {said.getvalue()[-300:]}")
    return time.process_time() - before
small, again, large, how, *given = sys.argv[1:]
cpu(small)
constant, before = cpu(again), peak()
print(cpu(large), constant, max(peak() - before, 0))
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


def old_workbook(path, n):
    from laboratory_workbooks import xls

    frame = tests(n, np.random.default_rng(1), 10)
    path.write_bytes(xls([list(frame.columns), *frame.to_numpy().tolist()]))


def channels(path, n):
    """A record as MATLAB or TDMS file."""
    frame = np.random.default_rng(1).normal(size=(2, n)).round(4)
    if path.suffix == ".mat":
        from scipy.io import savemat

        savemat(path, {"u": frame[0], "y": frame[1], "Ts": 0.001})
        return
    import nptdms

    with nptdms.TdmsWriter(path) as writer:
        step = {"wf_increment": 0.001}
        writer.write_segment([nptdms.ChannelObject("run", "uy"[k], frame[k], step) for k in (0, 1)])


def labview(path, n):
    from force_records import write_lvm

    write_lvm(path, 1000, {f"{name} [V]": np.random.default_rng(1).normal(size=n).round(4) for name in "uy"})


def sections(path, n):
    """A parameter file with n lines on how its table was read."""
    pf = parameters.read(good("fitted") / "params.json")
    path.with_name("draws.npz").write_bytes((good("fitted") / "draws.npz").read_bytes())
    design = pf.design.model_copy(update={"understood": tuple(f"remark {k} of the table" for k in range(n))})
    path.write_bytes(as_bytes(sealed(pf, design=design)))


def fitted(path, n):
    """A fitted parameter file with n posterior draws."""
    write_table(path.parent / "data.csv")
    said("data.csv", "--out", "out", "--draws", str(n), at=path.parent)
    next((path.parent / "out").rglob("params.json")).parent.rename(path.parent / "fit")


def few(path, n):
    write_table(path, 6)


def priors(path, n):
    write_table(path.parent / "data.csv", 4)
    path.write_text("# a remark\n" * n + '[AW]\nV = { distribution = "normal", mean = 0.5, sd = 0.5 }\n', "utf-8")


def metadata(path, n):
    path.with_name("params.json").write_bytes((good("turning") / "params.json").read_bytes())
    path.write_text("authors = [" + ", ".join(f'"Doe {k}, Jane"' for k in range(n)) + "]\n", "utf-8")


def pairs(path, n):
    (path.parent / "src").mkdir()
    for k in range(n):
        write_table(path.parent / "src" / f"G{k}_S.csv", 4, k)
    lines = [f"G{k}_S,,P20" for k in range(n)]
    path.write_text("\n".join(["tool,work,iso513", *lines]) + "\n", "utf-8")


def tools(path, n):
    """One table of n pairs of 18 rows."""
    write_table(path, 6)
    one = pd.read_csv(path)
    frame = pd.concat([one.assign(tool=f"T{k}", work="S") for k in range(n)], ignore_index=True)
    frame.to_csv(path, index=False) if path.suffix == ".csv" else frame.to_parquet(path, index=False)


def folders(path, n):
    pf = parameters.read(good("turning") / "params.json")
    for k in range(n):
        (path / f"t{k}").mkdir(parents=True)
        identity = pf.identity.model_copy(update={"tool": f"T{k}"})
        (path / f"t{k}" / "params.json").write_bytes(as_bytes(sealed(pf, identity=identity)))


def cuts(path, n):
    """n records of one cut, and the plan that names them."""
    content = (reduced() / "records" / "E1.csv").read_bytes()
    path.mkdir()
    for k in range(n):
        (path / f"E{k}.csv").write_bytes(content)
    rows = [f"E{k},120,0.2,{t}" for k in range(n) for t in (2, 4)]
    path.with_name("tests.csv").write_text("\n".join(["edge,V [m/min],f [mm/rev],t [min]", *rows]) + "\n", "utf-8")


def plan(path, n):
    path.with_name("params.json").write_bytes((good("turning") / "params.json").read_bytes())
    rng = np.random.default_rng(1)
    rows = [f"E{k},{rng.uniform(100, 200):.0f},{rng.uniform(0.1, 0.4):.2f},{rng.uniform(1, 2):.1f}" for k in range(n)]
    path.write_text("\n".join(["edge,V [m/min],f [mm/rev],d [mm]", *rows]) + "\n", "utf-8")


def controlled(path, n):
    """The parameter file of a controller, with a note of n sentences."""
    pf = published("CLM-2023")
    note = " ".join(f"Remark {k} on the load line." for k in range(n))
    path.write_bytes(as_bytes(sealed(pf, identity=pf.identity.model_copy(update={"note": note}))))


def running(path, n):
    """A recorded run of n readings of power with cuts of 90 s at a steady load, and laws of wear and power."""
    said(str(EXAMPLES / "verschleiss.csv"), "--out", "out", "--draws", "1000", at=path.parent)
    next((path.parent / "out").rglob("params.json")).parent.rename(path.parent / "fit")
    at = np.arange(n)
    cutting = at % 120 >= 30
    power = np.where(cutting, 3, 0.9) + 0.03 * np.random.default_rng(1).normal(size=n)
    frame = pd.DataFrame({"time [s]": at, "P [kW]": power.round(3), "V [m/min]": 200, "f [mm/rev]": 0.3})
    frame.assign(state=np.where(cutting, "cut", "idle")).to_csv(path, index=False)


ROWS = {  # row -> what is done, file or folder, maker, smallest of the doubled sizes, size of the small input
    "read csv, rows": ("table a.csv", csv, 25_000, 240),
    "read xlsx, rows": ("table a.xlsx", workbook, 2_000, 240),
    "read xls, rows": ("table a.xls", old_workbook, 4_000, 240),
    "read ods, rows": ("table a.ods", workbook, 1_000, 240),
    "read csv, columns": ("table a.csv", columns, 250, 5),
    "read csv, edges of 3 rows": ("table a.csv", edges, 12_000, 240),
    "read csv, lines of notes": ("table a.csv", notes, 1000, 5),
    "read csv, characters of a cell": ("table a.csv", cell, 8_000, 30),
    "read record csv, rows": ("record a.csv", record, 100_000, 2_000),
    "read record mat, rows": ("record a.mat", channels, 800_000, 2_000),
    "read record tdms, rows": ("record a.tdms", channels, 800_000, 2_000),
    "read record lvm, rows": ("record a.lvm", labview, 40_000, 1_000),
    "read params.json, lines": ("params params.json", sections, 100_000, 10),
    "read draws, draws": ("check fit/params.json", fitted, 4_000, 1_000),
    "look, rows": ("look a.csv --json", csv, 20_000, 60),
    "next, rows": ("next a.csv --runs 2", csv, 4_000, 60),
    "ident, rows": ("ident a.csv --tool T --work W --out out --orders 1,1,1", record, 30_000, 1_000),
    "watch, readings": ("watch fit/params.json --from a.csv --replay max --value d=2mm --json", running, 4_000, 400),
    "read priors, lines": ("data.csv --json --draws 1000 --priors priors.toml", priors, 5_000, 10),
    "read card.toml, authors": ("card params.json --json --toml card.toml", metadata, 8_000, 2),
    "batch files and pairs.csv, pairs": ("batch src --out out --jobs 1 --table-only --pairs pairs.csv", pairs, 25, 2),
    "batch csv, pairs": ("batch a.csv --out out --jobs 1 --table-only", tools, 25, 2),
    "batch parquet, pairs": ("batch a.parquet --out out --jobs 1 --table-only", tools, 25, 2),
    "publish site, pairs": ("publish in --site site --draft --jobs 1", folders, 2, 1),
    "write params.json with draws": ("data.csv --out out --draws {n}", few, 4_000, 1_000),
    "write report --json, rows": ("a.csv --json", csv, 1_000, 60),
    "write card, lines": ("card params.json --force", sections, 2_000, 10),
    **{
        f"export {kind}, sentences": (
            f"export params.json --to {kind} --out out.{kind} --accept-verdict --force",
            controlled,
            60_000,
            10,
        )
        for kind in ("ini", "h", "c", "comp", "st", "ngc", "mat", "ssv")
    },
    "reduce, records": ("reduce records --plan tests.csv --out data.csv", cuts, 2, 1),
    "simulate, edges": ("simulate params.json --plan plan.csv --out s.csv", plan, 100, 10),
}
PLACES = ("a.csv", "a.xlsx", "a.xls", "a.ods", "a.mat", "a.tdms", "a.lvm", "a.parquet", "priors.toml", "card.toml")
PLACES += ("pairs.csv", "plan.csv", "in", "records", "data.csv", "fit/params.json", "params.json")


def made(folder, name, n):
    """Folder with the input of this size, and the words of what is done with it."""
    words, make, *_ = ROWS[name]
    folder.mkdir()
    given = [word for word in words.split() if word in PLACES]
    place = next(one for one in (*PLACES[8:12], *PLACES) if one in given)
    make(folder / Path(place).name, n)
    return folder


def measured(name, folders, n):
    """CPU time in s of the large and the small input, and growth of the peak memory in MB, in a process of its own."""
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CHILD, *map(str, folders), *ROWS[name][0].format(n=n).split()],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if run.returncode:
        raise SystemExit(f"{name}, {n}: {(run.stderr or run.stdout).strip().splitlines()[-1]}")
    return [float(text) for text in run.stdout.split()]


def slope(sizes, net):
    """Power of the size with which CPU without its constant part grows; None where too little depends on the size."""
    if net[-1] < SEEN:
        return None
    use = [k for k, one in enumerate(net) if one > SEEN / 10]
    if len(use) < 2:
        return None
    return float(np.polyfit(np.log(np.array(sizes)[use]), np.log(np.array(net)[use]), 1)[0])


def row_of(name, steps, scale, home):
    """One row of the table: sizes, CPU, memory and slope."""
    *_, first, least = ROWS[name]
    sizes = [int(first * scale * 2**k) for k in range(steps)]
    found = []
    for turn in range(2):
        for k, size in enumerate(sizes):
            at = home / f"{turn}-{size}"
            at.mkdir(parents=True)
            inputs = [made(at / label, name, n) for label, n in (("s", least), ("t", least), ("large", size))]
            cpu, constant, memory = measured(name, inputs, size)
            one = (max(cpu - constant, 1e-3), cpu, memory)
            if turn:
                found[k] = min(found[k], one)
            else:
                found.append(one)
        power = slope(np.array(sizes) - least, [one[0] for one in found])
        if power is None or power <= LINEAR:
            break
    return {"row": name, "sizes": sizes, "cpu": [one[1] for one in found], "memory": found[-1][2], "slope": power}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=4, help="sizes, each double the one before")
    parser.add_argument("--scale", type=float, default=1.0, help="factor of all sizes")
    parser.add_argument("--only", default="", help="rows whose names contain one of these, by commas")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    wanted, rows = [word for word in args.only.split(",") if word], []
    print(f"{'':32}{'sizes':>18}{'CPU, s':>36}{'peak, MB':>10}   slope (limit {LINEAR})")
    for name in ROWS:
        if wanted and not any(word in name for word in wanted):
            continue
        with tempfile.TemporaryDirectory() as folder:
            row = row_of(name, args.steps, args.scale, Path(folder))
        rows.append(row)
        power, shown = row["slope"], " ".join(f"{one:8.3f}" for one in row["cpu"])
        text = "not measurable above the constant" if power is None else f"{power:.2f}"
        if power is not None and power > LINEAR:
            text += f" *  {REASONS.get(name, '')}"
        span = f"{row['sizes'][0]} to {row['sizes'][-1]}"
        print(f"{name:32}{span:>18}{shown:>36}{row['memory']:10.1f}   {text}", flush=True)
    if args.json:
        print(json.dumps(rows))
    return int(any((row["slope"] or 0) > LINEAR and row["row"] not in REASONS for row in rows))


if __name__ == "__main__":
    sys.exit(main())
