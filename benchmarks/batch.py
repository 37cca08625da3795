"""Time of ``fitmodels batch``: 10 000 simulated pairs of 144 rows from Parquet to results, with joblib and Dask.

    OMP_NUM_THREADS=1 python benchmarks/batch.py [PAIRS] [PAIRS_OF_THE_LOOP] [PAIRS_WITH_FILES]

Compared with a loop of statsmodels OLS with the same statistics, which reads the same Parquet file and writes a CSV;
it runs over some pairs and is extrapolated, both in seconds of the processor: on arrays, the fastest that can be
written with statsmodels, and with a formula for each pair. Then the same batch on 1 and 2
processes, through joblib and on a local Dask cluster, for the table only and with parameter files (checks and
posterior), in seconds of the clock: on an idle machine alone do they show what two processes save. Aims: 35 times the
loop on one core, 1.6 times as fast on two. Engines are timed after a warm-up run, when their processes have imported
the libraries. All pairs are simulated.
"""

import gc
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from fitmodels.batch.engine import engine
from fitmodels.batch.output_folder import folder_names, prepare, put
from fitmodels.batch.plan import BatchOptions, Reading
from fitmodels.batch.run_batch import MOST_PAIRS, fit_blocks
from fitmodels.batch.source import open_source
from fitmodels.batch.tables import laws_of, results_csv, results_frame
from fitmodels.core.progress import Meter
from many_laws import FACTORS, by_formulas, by_statsmodels, simulated

AIM_LOOP, AIM_TWO = 35, 1.6


def write(pairs, path):
    frame, _ = simulated(pairs)
    table = pa.Table.from_pandas(frame.assign(work="steel"), preserve_index=False)
    for name in ("tool", "work", "edge"):
        at = table.column_names.index(name)
        table = table.set_column(at, name, table.column(at).dictionary_encode())
    pq.write_table(table, path, row_group_size=100_000)


def to_results(source, out, workers, files, most_pairs, clock=time.perf_counter):
    """From Parquet to results.csv and the parameter files; seconds of the whole and of fitting, and the results."""
    options = BatchOptions(files=files)
    shutil.rmtree(out, ignore_errors=True)  # what an earlier run recorded would be read
    begun = clock()
    with prepare(out, source.name, options):
        work = out / ".batch" / "source"
        plan = open_source(source, Reading(), most_pairs=most_pairs, reads=100.0, work=work, workers=workers)
        done = fit_blocks(plan, options, out, folder_names(plan.pairs) if files else {}, workers, Meter(0, "pairs"))
        results = results_frame([pair for block in done.outcomes for pair in block.pairs], laws_of(done.outcomes))
        put(out, "results.csv", results_csv(results, done.outcomes))
    return clock() - begun, done.effort.seconds, results


def the_loop(source, out, pairs, by=by_statsmodels):
    """Read the same file, fit some of its pairs sequentially, write their statistics; seconds of the processor."""
    begun = time.process_time()
    frame = pd.read_parquet(source)
    read = time.process_time() - begun
    some = frame[frame["tool"].isin(frame["tool"].drop_duplicates().head(pairs))].copy()
    some["tool"] = some["tool"].astype(str)
    begun = time.process_time()
    found = by(some)
    pd.DataFrame(found).to_csv(out / "loop.csv")
    return read, time.process_time() - begun, found


def against_the_loop(source, folder, pairs, looped):
    with engine() as workers:
        options = {"files": False, "most_pairs": MOST_PAIRS[False], "clock": time.process_time}
        to_results(source, folder / "warm", workers, **options)
        runs = [to_results(source, folder / "one", workers, **options) for _ in range(3)]
    whole, _, results = sorted(runs, key=lambda run: run[0])[1]
    read, looping, theirs = the_loop(source, folder, looped)
    loop = read + looping * pairs / looped
    print(f"batch, one process: Parquet to results.csv {whole:7.2f} s of the processor (median of 3)")
    print(f"loop of statsmodels OLS: Parquet to CSV    {loop:7.2f} s (from {looped} pairs)")
    print(f"ratio {loop / whole:.1f}, aim {AIM_LOOP}")
    few = max(1, looped // 5)
    _, looping, _ = the_loop(source, folder, few, by_formulas)
    loop = read + looping * pairs / few
    print(f"loop with a formula for each pair          {loop:7.2f} s (from {few} pairs); ratio {loop / whole:.1f}")
    names = [f"{part}_{name}" for part in ("row_bse", "params", "bse", "tvalues", "pvalues") for name in FACTORS]
    names += ["rsquared", "rsquared_adj", "fvalue", "f_pvalue", "scale_se"]
    ours = results[names].to_numpy(dtype=float)[:looped]
    print(f"largest relative difference of a statistic: {np.max(np.abs(ours / theirs - 1)):.1e}")


def on_engines(source, folder, files, most_pairs):
    what = "with parameter files" if files else "the table only"
    seconds = {}
    for label, given in {
        "1 process": {},
        "2, joblib": {"jobs": 2},
        "2, Dask local": {"jobs": 2, "dask": "local"},
    }.items():
        with engine(**given) as workers:
            workers.map(abs, range(8))  # the processes start, which they would not for so few pairs of a table
            to_results(source, folder / "warm", workers, files, most_pairs)
            whole, fitting, results = to_results(source, folder / label, workers, files, most_pairs)
        seconds[label] = whole
        n = len(results)
        print(f"{what}, {label:<14} {whole:7.2f} s, {n / whole:7.1f} pairs/s; blocks {fitting:.2f} s")
    one, two, dask = seconds.values()
    print(f"{what}: two processes {one / two:.2f} times as fast as one (aim {AIM_TWO}), by Dask {one / dask:.2f} times")


def main(pairs, looped, with_files):
    cores = len(os.sched_getaffinity(0))
    print(
        f"{pairs} simulated pairs of 144 rows; {cores} cores, Python {sys.version.split()[0]}, numpy {np.__version__}"
    )
    gc.disable()  # as the command does
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        source, few = folder / "pairs.parquet", folder / "few.parquet"
        write(pairs, source)
        write(with_files, few)
        against_the_loop(source, folder, pairs, looped)
        on_engines(source, folder, files=False, most_pairs=MOST_PAIRS[False])
        print(f"{with_files} pairs with parameter files")
        on_engines(few, folder, files=True, most_pairs=MOST_PAIRS[True])


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*(given + [10_000, 500, 200][len(given) :]))
