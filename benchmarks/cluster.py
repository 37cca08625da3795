"""Costs of ``fitmodels batch`` per pair and per row, and from them those of 1e6 pairs and 1e9 rows on a Dask cluster.

    python benchmarks/cluster.py                  10 000 pairs of 24 and 264 rows, in order or not; calculation
    python benchmarks/cluster.py --only 1000000   one table of so many pairs of 24 rows, its steps alone

Each table is a process of its own. Its steps (planning, fitting, results) are timed by processor time: tasks, which
the workers of a cluster do, and the rest, which the process that was started does; results of tasks are pickled. Both
cost so much for each pair and so much for each row; two tables of the same pairs with few and with many rows give both.
The calculation divides tasks by the workers. It leaves out disks and network. All pairs are simulated; tables only.
"""

import argparse
import gc
import json
import pickle
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from fitmodels.batch import run_batch
from fitmodels.batch.engine.base import SerialRun, largest_memory
from fitmodels.core.progress import Meter
from many_laws import ENDS, FAMILY, SPREAD

EDGES, FEW, MANY = 12, 2, 22  # edges of a pair; rows of an edge in the table of few rows and of many
PAIRS, PART = 10_000, 5000  # pairs of each table; those that are generated together
LARGE, ROWS, WORKERS = 1_000_000, 1_000_000_000, (1, 16, 64, 256)


def write(path, pairs, subtests, order):
    """A Parquet file of pairs of 12 edges, in row groups of at most 100 000 rows, its labels as a dictionary."""
    rng, writer = np.random.default_rng(1), None
    parts = (some_pairs(first, min(PART, pairs - first), subtests, rng) for first in range(0, pairs, PART))
    if order == "scattered":
        table = pa.concat_tables(parts).unify_dictionaries()
        parts = [table.take(rng.permutation(table.num_rows))]
    for table in parts:
        writer = writer or pq.ParquetWriter(path, table.schema)
        writer.write_table(table, row_group_size=100_000)
    writer.close()


def some_pairs(first, n, subtests, rng):
    """Rows of n pairs as an Arrow table."""
    shape = (n, EDGES, subtests)
    logs = [np.broadcast_to(rng.uniform(*np.log(ends), (n, EDGES, 1)), shape) for ends in ENDS.values()]
    logs.append(np.broadcast_to(np.log(2.0 * np.arange(1, subtests + 1)), shape))
    truth = FAMILY + SPREAD * rng.standard_normal((n, 4))
    noise = 0.07 * (rng.standard_normal((n, EDGES, 1)) + rng.standard_normal(shape))
    y = sum(b[:, None, None] * x for b, x in zip(truth.T, logs, strict=True)) - 4.9 + noise
    labels = {
        "tool": labelled(np.repeat(np.arange(n), EDGES * subtests), [f"T{first + i:07d}" for i in range(n)]),
        "work": labelled(np.zeros(n * EDGES * subtests), ["steel"]),
        "edge": labelled(np.tile(np.repeat(np.arange(EDGES), subtests), n), [f"E{i:02d}" for i in range(EDGES)]),
    }
    numbers = dict(zip((*ENDS, "t", "AW"), (*logs, y), strict=True))
    return pa.table({**labels, **{name: np.exp(x).ravel() for name, x in numbers.items()}})


def labelled(numbers, names):
    return pa.DictionaryArray.from_arrays(numbers.astype(np.int32), names)


class Tasks(SerialRun):
    """Tasks in this process, with results as a cluster sends them."""

    seconds = 0.0

    def __call__(self, work, tasks):
        """Position and result of each task."""
        for position, task in enumerate(tasks):
            began = time.process_time()
            sent = pickle.dumps(work(task))
            self.seconds += time.process_time() - began
            yield position, pickle.loads(sent)  # noqa: S301  of this process


class Steps(Meter):
    """Processor seconds of the process and of tasks, and peak memory, at the beginning of each step."""

    def say(self, words):
        name = {"fitting": "fitting", "comparing": "results"}.get(words, "planning")
        self.began.setdefault(name, self.now())

    def now(self):
        return np.array([time.process_time() - self.tasks.seconds, self.tasks.seconds, largest_memory() / 1e9])


def steps(path, out):
    """Seconds of this process and of tasks in each step, and peak memory in GB by its end, of a whole batch."""
    gc.disable()  # as the command does
    meter = Steps(0, "pairs")
    meter.began, meter.tasks = {}, Tasks()
    run_batch.engine = lambda *_: nullcontext(meter.tasks)
    made = run_batch.run(path, out, files=False, meter=meter)
    marks = [*meter.began.values(), meter.now()]
    return {
        "seconds": {name: (marks[k + 1] - marks[k])[:2].tolist() for k, name in enumerate(meter.began)},
        "GB": {name: marks[k + 1][2] for k, name in enumerate(meter.began)},
        "data": path.stat().st_size,
        "tables": sum((out / name).stat().st_size for name in made.written if (out / name).is_file()),
        "rows": made.plan.rows,
        "blocks": len(made.plan.blocks),
    }


def apart(pairs, subtests, order="by pair"):
    """``steps`` of a table in a process of its own, the least of some runs, which is printed."""
    words = [sys.executable, __file__, "--table", str(pairs), str(subtests), order]
    runs = [
        json.loads(subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout)
        for _ in range(1 if pairs > PAIRS else 2)
    ]
    least = {name: np.min([run["seconds"][name] for run in runs], axis=0).tolist() for name in runs[0]["seconds"]}
    found = runs[0] | {"seconds": least}
    sizes = f"Parquet {found['data'] / 1e6:.0f} MB, tables {found['tables'] / 1e6:.0f} MB"
    print(f"{pairs} pairs, {found['rows']} rows {order}, {found['blocks']} blocks; {sizes}")
    for name, (own, tasks) in found["seconds"].items():
        print(f"  {name:9}{own:9.2f} s, tasks {tasks:9.2f} s, peak {found['GB'][name]:.2f} GB", flush=True)
    return found


def calculation(pairs, few, many, scattered):
    """Print the costs for each pair and row, and the time of the large batch."""
    more = many["rows"] - few["rows"]
    total = np.zeros(2)
    print("cost                  a pair, us   a row, us   1e6 pairs and 1e9 rows, s of one core")
    for name in few["seconds"]:
        least, most = (np.array(found["seconds"][name]) for found in (few, many))
        if name == "results":  # of pairs alone
            least = most = (least + most) / 2
        row = np.maximum(most - least, 0.0) / more
        pair = np.maximum(least - row * few["rows"], 0.0) / pairs
        total += pair * LARGE + row * ROWS
        for what, a, b in zip(("", ", tasks"), pair, row, strict=True):
            print(f"{name + what:20}{1e6 * a:12.1f}{1e6 * b:12.3f}{a * LARGE + b * ROWS:12.0f}")
    one, tasks = total
    for workers in WORKERS:
        whole = one + tasks / workers
        print(f"{workers:4} workers: {whole / 60:6.1f} min, of which {one / 60:.1f} in one process ({one / whole:.0%})")
    data, tables = ROWS * (many["data"] - few["data"]) / more, LARGE * few["tables"] / pairs
    print(f"Parquet {data / 1e9:.0f} GB, tables {tables / 1e9:.1f} GB")
    sorting = (scattered["seconds"]["planning"][0] - many["seconds"]["planning"][0]) / many["rows"]
    print(
        f"rows not in the order of pairs: {1e6 * sorting:.2f} us a row more in planning, {sorting * ROWS / 60:.0f} min"
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--only", type=int, metavar="PAIRS")
    parser.add_argument("--table", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--write", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.write:
        path, pairs, subtests, order = given.write
        write(Path(path), int(pairs), int(subtests), order)
    elif given.table:
        with tempfile.TemporaryDirectory() as folder:
            small, path = Path(folder, "small.parquet"), Path(folder, "pairs.parquet")
            write(small, 100, FEW, "by pair")
            run_batch.run(small, Path(folder, "first"), files=False)  # imports
            # written by a process of its own: its memory is not counted
            subprocess.run([sys.executable, __file__, "--write", str(path), *given.table], check=True)
            print(json.dumps(steps(path, Path(folder, "out"))))
    elif given.only:
        apart(given.only, FEW)
    else:
        tables = apart(given.pairs, FEW), apart(given.pairs, MANY), apart(given.pairs, MANY, "scattered")
        calculation(given.pairs, *tables)


if __name__ == "__main__":
    main()
