"""A power law fitted in one pass: time and peak memory by number of rows, and deviation from the true values.

    python benchmarks/streamed.py              1e6 and 1e7 rows
    python benchmarks/streamed.py 100000000    these as well

Each size is fitted twice, with chunks of two lengths, and the results are compared; 1e6 rows are compared with the fit
in memory too (coefficients, standard errors by edge and of rows, R2, F: largest relative difference, aim 1e-10).

Run it with the Python that fitmodels is installed in. Rows are generated chunk by chunk, each size in a
separate process, so that the peak memory is that of this size. The wall time includes the generation of the rows;
the processor times of generation and fit are separate, and depend little on other processes.
"""

import multiprocessing
import resource
import sys
import time

import numpy as np
import pandas as pd
from fitmodels.datasets import runs_from_frame
from fitmodels.fit import power_law
from fitmodels.fit.streaming import streamed_power_law

CHUNK, OTHER = 500_000, 123_457
EDGES = 240
TRUTH = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
CONSTANT, BETWEEN, WITHIN = -4.9, 0.05, 0.1  # ln c0, scatter of the edges, scatter of rows


def chunks(n, seconds, seed=1):
    """Rows of 240 edges, each edge at one setting and in every chunk."""
    rng = np.random.default_rng(seed)
    low, high = np.log([50, 0.06, 1.5]), np.log([200, 0.6, 3])
    setting, level = rng.uniform(low, high, (EDGES, 3)), CONSTANT + BETWEEN * rng.standard_normal(EDGES)
    level += setting @ list(TRUTH.values())[:3]
    columns = np.exp(setting).T
    for start in range(0, n, CHUNK):
        began = time.process_time()
        m = min(CHUNK, n - start)
        edge = rng.integers(0, EDGES, m)
        lnt = rng.uniform(0, 3, m)
        y = level[edge] + TRUTH["t"] * lnt + WITHIN * rng.standard_normal(m)
        chunk = {"edge": edge, "t": np.exp(lnt), "AW": np.exp(y)} | {
            name: column[edge] for name, column in zip("Vfd", columns, strict=True)
        }
        seconds.append(time.process_time() - began)
        yield chunk


def cut_anew(stream, rows):
    """The same rows in chunks of another length."""
    held = {}
    for chunk in stream:
        held = {name: np.concatenate([held[name], values]) if held else values for name, values in chunk.items()}
        while len(held["V"]) >= rows:
            yield {name: values[:rows] for name, values in held.items()}
            held = {name: values[rows:] for name, values in held.items()}
    if len(held["V"]):
        yield held


def statistics(law):
    rows = np.sqrt(np.diag(law.cov_theta))
    by_edge = np.sqrt(np.diag(law.covariance()))
    return np.concatenate([law.theta, by_edge, rows, [law.rsquared, law.fvalue]])


def apart(one, other):
    return float(np.max(np.abs(statistics(one) / statistics(other) - 1)))


def in_memory(n):
    """The fit of the same rows in memory."""
    table = pd.DataFrame({name: np.concatenate(parts) for name, parts in _columns(n).items()})
    return power_law(runs_from_frame(table, judge=False), "AW", list(TRUTH))


def _columns(n):
    parts = {}
    for chunk in chunks(n, []):
        for name, values in chunk.items():
            parts.setdefault(name, []).append(values)
    return parts


def fitted(n, queue):
    streamed_power_law(chunks(2000, []), "AW", list(TRUTH))  # imports
    making, before, wall, began = [], peak(), time.perf_counter(), time.process_time()
    law = streamed_power_law(chunks(n, making), "AW", list(TRUTH))
    took, wall = time.process_time() - began, time.perf_counter() - wall
    theta, se = law.theta, np.sqrt(np.diag(law.covariance()))
    off = float(np.max(np.abs(theta - [CONSTANT, *TRUTH.values()]) / se))
    most = peak()
    again = streamed_power_law(cut_anew(chunks(n, []), OTHER), "AW", list(TRUTH))
    memory = apart(law, in_memory(n)) if n <= 10**6 else None
    queue.put((law.nobs, wall, took, sum(making), before, most, off, apart(law, again), memory))


def peak():
    """Peak memory of this process, MB."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1024**2 if sys.platform == "darwin" else 1024)


def main(sizes):
    process = multiprocessing.get_context("spawn")
    print(
        "      rows   wall s  CPU s fitting  making us per row  peak MB  (at start)  largest deviation, SE by edge"
        "  two chunkings  in memory"
    )
    for n in sizes:
        queue = process.Queue()
        run = process.Process(target=fitted, args=(n, queue))
        run.start()
        n, wall, took, making, before, most, off, chunked, memory = queue.get()
        run.join()
        print(f"{n:10.0e}  {wall:7.2f}  {took - making:13.2f}  {making:6.2f}  {1e6 * (took - making) / n:8.3f}"
              f"  {most:7.0f}  {before:10.0f}  {off:.2f} (aim < 3){'':29}{chunked:.1e}"
              + (f"        {memory:.1e}" if memory is not None else ""))  # fmt: skip


if __name__ == "__main__":
    main([10**6, 10**7, *(int(float(size)) for size in sys.argv[1:])])
