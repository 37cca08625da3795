"""Time of ARX from one Gram matrix, relative to one pass over the data and to other libraries.

    OMP_NUM_THREADS=1 python benchmarks/arx.py

One pass is ``u @ y``. Every ratio is the median of repeated, alternating runs, so that a drift of the processor speed
affects both sides. Other libraries are timed where they are installed, for sizes that take seconds, not minutes.
"""

import sys
import time
import tracemalloc
import warnings
from statistics import median

import numpy as np
from fitmodels.datasets import Record
from fitmodels.ident.estimators.least_squares import arx
from fitmodels.ident.estimators.order_selection import choose_order
from fitmodels.ident.estimators.regressors import arx_regressors
from scipy.signal import lfilter

B, A = [0, 0.0611, -0.1338, 0.0752], [1, -2.0311, 1.2104, -0.1655]  # CLM-2023 eq. 18
READS_ARX, READS_SEARCH, TIMES_LSTSQ = 12, 120, 25


def record(n):
    """The published plant under a random two-level input, noise in the equation."""
    rng = np.random.default_rng(1)
    u = np.sign(rng.standard_normal(n))
    return Record(u=u, y=lfilter(B, A, u) + lfilter([1], A, 0.01 * rng.standard_normal(n)), sample_time=0.02)


def clocked(call, least=2e-3):
    """Seconds of one call, over as many calls as a clock needs."""
    start = time.perf_counter()
    call()
    once = time.perf_counter() - start
    if once >= least:
        return once
    times = int(least / once) + 1
    start = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - start) / times


def against(first, second, runs):
    """Medians of both, and of their ratio pair by pair, after one warm-up of each."""
    clocked(first), clocked(second)
    pairs = [(clocked(first), clocked(second)) for _ in range(runs)]
    return median(a for a, _ in pairs), median(b for _, b in pairs), median(a / b for a, b in pairs)


def beyond(call):
    """Peak of the additional memory, in MB."""
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def ours(n):
    rec = record(n)
    runs = 15 if n < 10**7 else 7

    def read():
        return rec.u @ rec.y

    def fit():
        return arx(rec, 3, 3, 1)

    def search():
        return choose_order(rec)

    a, one, reads = against(fit, read, runs)
    b, _, reads_search = against(search, read, runs if n < 10**7 else 5)
    phi, y, _ = arx_regressors(rec, 3, 3, 1)
    _, _, times = against(lambda: np.linalg.lstsq(phi, y), fit, 5 if n < 10**7 else 3)
    print(
        f"{n:9.0e} {one * 1e3:9.3f} ms {a * 1e3:9.3f} ms {reads:8.1f} {times:9.1f} {b * 1e3:10.2f} ms "
        f"{reads_search:8.1f} {beyond(fit):9.2f} {beyond(search):9.2f}"
    )
    return rec, a


def peers(rec, ours):
    """Time of the same ARX(3,3,1) in other libraries, relative to ours."""
    for name, call in (("statsmodels ARDL", ardl), ("SysIdentPy FROLS", frols), ("sippy_unipi ARX", sippy)):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                fit = call(rec)
                seconds = median(clocked(fit) for _ in range(3))
            print(f"  {name:<18} {len(rec):9.0e} {seconds * 1e3:10.1f} ms {seconds / ours:10.0f} x ours")
        except ImportError as error:
            print(f"  {name:<18} not timed: {error}")
        except (Exception, SystemExit) as error:  # a library may end the process
            print(f"  {name:<18} {len(rec):9.0e} failed: {type(error).__name__}: {str(error)[:80]}")


def ardl(rec):
    from statsmodels.tsa.ardl import ARDL

    return lambda: ARDL(rec.y, 3, rec.u[:, None], {0: [1, 2, 3]}, trend="n").fit()


def frols(rec):
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    def fit():
        model = FROLS(
            order_selection=False,
            n_terms=6,
            ylag=3,
            xlag=3,
            estimator=LeastSquares(),
            basis_function=Polynomial(degree=1),
        )
        return model.fit(X=rec.u[:, None], y=rec.y[:, None])

    return fit


def sippy(rec):
    from sippy_unipi import system_identification

    return lambda: system_identification(
        rec.y[None, :], rec.u[None, :], "ARX", ARX_orders=[3, 3, 0], tsample=rec.sample_time
    )


if __name__ == "__main__":
    print(f"Python {sys.version.split()[0]}, numpy {np.__version__}; medians of alternating runs")
    print(
        f"aims: arx(3,3,1) within {READS_ARX} passes, {TIMES_LSTSQ} times faster than lstsq on the ready N x 6 matrix; "
    )
    print(f"      search over na 0-10, nb 1-10, nk 0-20 within {READS_SEARCH} passes; memory constant in N")
    print("        N  one pass    arx(3,3,1)    passes  x lstsq        search   passes    arx MB search MB")
    kept = [ours(10**k) for k in (4, 5, 6, 7)][:3]
    print("other libraries, ARX(3,3,1)")
    for rec, seconds in kept:
        peers(rec, seconds)
