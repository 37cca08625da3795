"""A power law fitted in one pass: processor time, peak memory, deviation from a QR of all rows, equality of bits.

    python benchmarks/streamed.py                         1.5e6 and 1e7 rows
    python benchmarks/streamed.py 100000000               these as well
    python benchmarks/streamed.py --against OLD/bin/python

``--against`` runs the same with the Python of another version in alternation, and prints the ratios of processor time
(aims: 0.2 up to 1.5e6 rows, 0.35 above) and of peak memory (aim 1).

Two sets of rows: ordinary ones, and hard ones, in which V and f lie in a narrow range and d follows them within 0.02 %,
so that the condition number of the design is 6e6. The difference from QR is the largest relative one of the
coefficients, against numpy's QR of the columns about their means, 1e6 rows (aims 1e-12 and 1e-9). Bits: a hash of
coefficients, both covariances, R2 and F, which must be that of other chunks and of two threads.

Rows are generated chunk by chunk, each fit in a separate process, so that the peak memory is that of its size. The
processor time of generation is subtracted. `benchmarks/speed.py` compares the law with numpy's QR and statsmodels.
"""

import argparse
import hashlib
import json
import os
import resource
import subprocess
import sys
import time

import numpy as np
from fitmodels.fit.streaming import streamed_power_law

CHUNK, OTHER = 500_000, 123_457
EDGES = 240
TRUTH = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
CONSTANT, BETWEEN, WITHIN = -4.9, 0.05, 0.1  # ln c0, scatter of the edges, scatter of rows
IN_MEMORY = 1_000_000  # rows of the comparison with QR
AIMS = {"ordinary": 1e-12, "hard": 1e-9}


def chunks(n, seconds=None, kind="ordinary", size=CHUNK, seed=1):
    """Rows of 240 edges, each edge at one setting and in every chunk; the generator makes 500 000 at a time."""
    rng = np.random.default_rng(seed)
    low, high = np.log([50, 0.06, 1.5]), np.log([200, 0.6, 3])
    if kind == "hard":
        low[:2], high[:2] = np.log([100, 0.2]), np.log([102, 0.204])
    setting, level = rng.uniform(low, high, (EDGES, 3)), CONSTANT + BETWEEN * rng.standard_normal(EDGES)
    for start in range(0, n, CHUNK):
        began = time.process_time()
        m = min(CHUNK, n - start)
        edge = rng.integers(0, EDGES, m)
        logs = {**dict(zip("Vfd", setting[edge].T, strict=True)), "t": rng.uniform(0, 3, m)}
        if kind == "hard":
            logs["d"] = 0.5 * logs["V"] + 0.3 * logs["f"] + 9e-7 * rng.standard_normal(m)
        y = level[edge] + sum(TRUTH[name] * x for name, x in logs.items()) + WITHIN * rng.standard_normal(m)
        chunk = {"edge": edge, "AW": np.exp(y), **{name: np.exp(x) for name, x in logs.items()}}
        if seconds is not None:
            seconds.append(time.process_time() - began)
        for at in range(0, m, size):
            yield {name: values[at : at + size] for name, values in chunk.items()}


def fitted(n, kind, size):
    """The law of n rows; processor seconds of the fit, peak memory in MB above that before, hash of the results."""
    streamed_power_law(chunks(2000), "AW", list(TRUTH))  # imports
    before, making, began = peak(), [], time.process_time()
    law = streamed_power_law(chunks(n, making, kind, size), "AW", list(TRUTH))
    seconds = time.process_time() - began - sum(making)
    parts = [law.theta, law.covariance(), law.cov_theta, [law.rsquared, law.fvalue]]
    bits = hashlib.sha256(b"".join(np.asarray(part).tobytes() for part in parts)).hexdigest()
    off = np.abs(law.theta - [CONSTANT, *TRUTH.values()]) / np.sqrt(np.diag(law.covariance()))
    return {"seconds": seconds, "MB": peak() - before, "bits": bits, "theta": law.theta.tolist(), "off": off.max()}


def peak():
    """Peak memory of this process, MB."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1024**2 if sys.platform == "darwin" else 1024)


def of_qr(n, kind):
    """Coefficients by numpy's QR of the columns about their means, and the condition number of the design."""
    names = [*TRUTH, "AW"]
    W = np.log(np.concatenate([np.column_stack([c[name] for name in names]) for c in chunks(n, kind=kind)]))
    design = np.column_stack([np.ones(n), W[:, :-1]])
    condition = np.linalg.cond(np.linalg.qr(design, mode="r"))
    mean = W.mean(axis=0)
    mean += (W - mean).mean(axis=0)
    R = np.linalg.qr(W - mean, mode="r")
    slopes = np.linalg.solve(R[:-1, :-1], R[:-1, -1])
    return np.append(mean[-1] - mean[:-1] @ slopes, slopes), condition


def apart(python, n, kind="ordinary", size=CHUNK, threads=1):
    """``fitted`` in a process of its own."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads)}
    command = [python, __file__, "--fit", str(n), kind, str(size)]
    return json.loads(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)


def speed(n, against):
    """Best processor time and peak memory of some runs, alternating with the other version."""
    runs = [
        {python: apart(python, n) for python in (sys.executable, against) if python}
        for _ in range(5 if n <= 2_000_000 else 2)
    ]
    seconds, MB = ({p: min(run[p][what] for run in runs) for p in runs[0]} for what in ("seconds", "MB"))
    here = runs[0][sys.executable]
    print(f"{n:10.1e}  {seconds[sys.executable]:8.3f}  {1e9 * seconds[sys.executable] / n:10.1f}"
          f"  {MB[sys.executable]:7.0f}  {here['off']:.2f} (aim < 3)", end="")  # fmt: skip
    if against:
        aim = 0.2 if n <= 1_500_000 else 0.35
        ratio, memory = (of[sys.executable] / of[against] for of in (seconds, MB))
        print(f"{'':9}{ratio:.3f} (aim {aim})  {memory:10.2f} (aim 1)", end="")
    print(flush=True)


def digits(kind):
    """Difference from QR, and whether other chunks and threads give the same bits."""
    theta, condition = of_qr(IN_MEMORY, kind)
    found = apart(sys.executable, IN_MEMORY, kind)
    same = {
        apart(sys.executable, IN_MEMORY, kind, size, threads)["bits"] == found["bits"]
        for size, threads in ((OTHER, 1), (CHUNK, 2))
    }
    largest = np.max(np.abs(np.array(found["theta"]) / theta - 1))
    print(f"{kind:9} condition {condition:.1e}  difference from QR {largest:.1e} (aim {AIMS[kind]:.0e})"
          f"  same bits: {'yes' if same == {True} else 'NO'}", flush=True)  # fmt: skip


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("rows", nargs="*", type=float)
    parser.add_argument("--against", metavar="PYTHON")
    parser.add_argument("--fit", nargs=3, metavar=("ROWS", "KIND", "CHUNK"))
    given = parser.parse_args()
    if given.fit:
        n, kind, size = given.fit
        print(json.dumps(fitted(int(n), kind, int(size))))
        return
    print("      rows     CPU s  ns per row  peak MB  deviation, SE by edge  ratio of CPU       ratio of peak memory")
    for n in (1_500_000, 10_000_000, *map(int, given.rows)):
        speed(n, given.against)
    for kind in AIMS:
        digits(kind)


if __name__ == "__main__":
    main()
