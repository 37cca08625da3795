"""What `benchmarks/speed.py` measures in processes of their own: calls of functions, and scripts of a user.

python benchmarks/speed_calls.py --call NAME SIZE SMALL [MORE]    prints seconds and peak memory as JSON
python benchmarks/speed_calls.py NAME [ARGUMENT ...]              a script, measured from outside
"""

import contextlib
import io
import json
import os
import resource
import runpy
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUNDLED = HERE.parent / "datasets/gc435_709m40/data.csv"
LAWS = {"AW": "V f d t", "Fxz": "V f d t AW", "P": "V f d t AW"}  # of the bundled set


# Calls: each function prepares data of a size and returns what is measured


def law_frame(n):
    """Rows of one pair, 6 to an edge."""
    import numpy as np
    import pandas as pd

    rng = np.random.default_rng(1)
    X = {name: np.exp(rng.uniform(*np.log(ends), n)) for name, ends in
         {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3), "t": (1, 20)}.items()}  # fmt: skip
    y = -4.9 + 0.577 * np.log(X["V"]) + 0.168 * np.log(X["f"]) + 0.248 * np.log(X["d"]) + 0.245 * np.log(X["t"])
    return pd.DataFrame({**X, "AW": np.exp(y + 0.1 * rng.standard_normal(n))})


def law_logs(n):
    import numpy as np

    Z = np.log(law_frame(n).to_numpy())
    return np.column_stack([np.ones(n), Z[:, :-1]]), Z[:, -1]


def linear(n):
    from fitmodels import fit

    X, y = law_logs(n)
    return lambda: fit.linear(X, y)


def power_law(n, error="multiplicative"):
    from fitmodels import datasets, fit

    runs = datasets.runs_from_frame(law_frame(n), judge=False)
    return lambda: fit.power_law(runs, "AW", ["V", "f", "d", "t"], error=error)


def qr_of_law(n):
    import numpy as np

    X, _ = law_logs(n)
    return lambda: np.linalg.qr(X)


def small_law():
    """A law of 24 edges x 6 rows."""
    from fitmodels import datasets, fit

    plan = datasets.central_composite({"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}, seed=1)
    wear = datasets.SimulatedLaw("AW", "mm", 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}, 0.07, 0.07)
    rows = datasets.simulate(plan, [wear], t_max=12.0, criterion=None, seed=1)
    return fit.power_law(datasets.runs_from_frame(rows), "AW", ["V", "f", "d", "t"])


def judge(_):
    from fitmodels import fit

    law = small_law()
    return lambda: fit.judge(law)


def edge_bootstrap(n):
    from fitmodels import fit

    law = small_law()
    return lambda: fit.edge_bootstrap(law, n)


def streamed_law(n):
    from fitmodels.fit.streaming import streamed_power_law
    from streamed import TRUTH, chunks

    parts = list(chunks(n))
    return lambda: streamed_power_law(parts, "AW", list(TRUTH))


def streamed_logs(n):
    """A function that takes logarithms of the rows of a streamed law, and the edges of the rows."""
    import numpy as np
    from streamed import TRUTH, chunks

    parts = list(chunks(n))
    table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return lambda: np.log(np.column_stack([table[name] for name in (*TRUTH, "AW")])), table["edge"]


def qr_of_rows(n):
    import numpy as np

    logs, _ = streamed_logs(n)
    return lambda: np.linalg.qr(logs(), mode="r")


def statsmodels_of_rows(n):
    """The same law with standard errors by edge (CR1)."""
    from statsmodels.regression.linear_model import OLS

    logs, edge = streamed_logs(n)

    def law():
        W = logs()
        y, W[:, -1] = W[:, -1].copy(), 1.0
        OLS(y, W).fit(cov_type="cluster", cov_kwds={"groups": edge})

    return law


def many_power_laws(pairs):
    from many_laws import ours, simulated

    frame, _ = simulated(pairs)
    return lambda: ours(frame)


def qr_of_pairs(pairs):
    import numpy as np
    from many_laws import FACTORS, simulated

    rows = simulated(pairs)[0][[*FACTORS, "AW"]].to_numpy().reshape(pairs, -1, 5)
    return lambda: np.linalg.qr(np.log(rows), mode="r")


def statsmodels_of_pairs(pairs):
    from many_laws import by_statsmodels, simulated

    frame, _ = simulated(pairs)
    return lambda: by_statsmodels(frame)


def identify(n):
    from estimators import record
    from fitmodels import ident

    rec = record(n, 0)
    return lambda: ident.identify(rec)


def qr_of_record(n):
    """QR of the regression of an ARX model of order 10."""
    import numpy as np
    from estimators import record

    rec = record(n, 0)
    X = np.column_stack([np.roll(signal, k) for signal in (rec.y, rec.u) for k in range(11)])
    return lambda: np.linalg.qr(X, mode="r")


def sippy(n):
    """ARMAX models of 54 orders and delays, chosen by BIC, without disturbances and validation."""
    from estimators import record
    from sippy_unipi import system_identification

    rec, orders = record(n, 0), {"na_ord": [1, 3], "nb_ord": [1, 3], "nc_ord": [1, 2], "delays": [0, 2]}
    return lambda: system_identification(rec.y, rec.u, "ARMAX", IC="BIC", tsample=0.02, max_iterations=50, **orders)


def loop_over_file(pairs, path):
    """Fit the first pairs of a Parquet file one by one, write a CSV; its reading, once for all, is not counted."""
    import pandas as pd
    from many_laws import by_statsmodels

    frame = pd.read_parquet(path)
    some = frame[frame["tool"].isin(frame["tool"].drop_duplicates().head(pairs))]
    some = some.assign(tool=some["tool"].astype(str))
    return lambda: pd.DataFrame(by_statsmodels(some)).to_csv(os.devnull)


def read_parquet(_, path):
    import pyarrow.parquet as pq

    return lambda: pq.read_table(path)


def emcee_of_laws(steps):
    """4000 effective draws of each law of the bundled set by plain emcee, one call of the density per walker."""
    from fitmodels import datasets, fit
    from fitmodels.fit.bayes.density import law_density
    from fitmodels.fit.bayes.priors import weak
    from posterior import of_emcee

    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws = [fit.power_law(runs, name, factors.split()) for name, factors in LAWS.items()]
    densities = [law_density(law, weak(law, True)) for law in laws]
    return lambda: sum(of_emcee(density, None, steps, vectorize=False) for density in densities)


# Scripts


def script(which):
    """A user's script: read the bundled file, fit laws, print their summaries; ``all`` with checks and figures."""
    import numpy as np
    import pandas as pd
    import statsmodels.api as sm

    frame = pd.read_csv(BUNDLED, comment="#").rename(columns=lambda name: name.split(" ")[0])
    for name, factors in list(LAWS.items())[: None if which == "all" else 1]:
        y, Z = np.log(frame[name]), sm.add_constant(np.log(frame[factors.split()]))
        law = sm.OLS(y, Z).fit()
        edge = pd.factorize(frame["edge"])[0]
        print(law.summary(), law.get_robustcov_results("cluster-crv3", groups=edge, use_t=True).summary())
        if which == "all":
            checks_and_figure(name, law, y, Z, frame["edge"])


def checks_and_figure(name, law, y, Z, edge):
    """Mixed model, the usual checks and a figure of residuals, as PNG."""
    import statsmodels.api as sm
    from matplotlib.figure import Figure
    from statsmodels.stats.diagnostic import het_breuschpagan
    from statsmodels.stats.outliers_influence import variance_inflation_factor
    from statsmodels.stats.stattools import durbin_watson, jarque_bera

    print(sm.MixedLM(y, Z, groups=edge).fit().summary(), law.get_influence().cooks_distance[0].max())
    print(het_breuschpagan(law.resid, Z), jarque_bera(law.resid), durbin_watson(law.resid))
    print([variance_inflation_factor(Z.to_numpy(), k) for k in range(Z.shape[1])])
    figure = Figure(figsize=(8, 4))
    left, right = figure.subplots(1, 2)
    left.plot(law.fittedvalues, law.resid, "o")
    sm.qqplot(law.resid, line="s", ax=right)
    figure.savefig(Path(tempfile.gettempdir()) / f"{name}.png")


def process_improve():
    """The first law by ``lm`` of process-improve."""
    import pandas as pd
    from process_improve.experiments import lm, summary

    frame = pd.read_csv(BUNDLED, comment="#").rename(columns=lambda name: name.split(" ")[0])
    summary(lm("np.log(AW) ~ np.log(V) + np.log(f) + np.log(d) + np.log(t)", frame))


def write_pairs(path, count):
    from batch import write

    write(int(count), path)


def write_rows(path, count):
    import numpy as np
    from reading_speed import tests

    tests(int(count), np.random.default_rng(1), 10).to_csv(path, index=False)


def write_site_pairs(path, count):
    module = runpy.run_path(str(HERE / "site.py"))  # `import site` is the module of Python
    Path(path).mkdir()
    module["write_pairs"](Path(path), int(count), module["fitted"]())


def peak():
    """Peak memory of this process, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024**2 if sys.platform == "darwin" else 1024)


def called(name, size, small, *more):
    """Processor seconds of a call, after one of a smaller size, or those that it returns; peak memory in MB."""
    make = globals()[name]
    with contextlib.redirect_stdout(io.StringIO()):
        make(int(small), *more)()
        call = make(int(size), *more)
        began = time.process_time()
        seconds = call()
    if not isinstance(seconds, float):
        seconds = time.process_time() - began
    return {"seconds": seconds, "MB": peak()}


if __name__ == "__main__":
    if sys.argv[1] == "--call":
        print(json.dumps(called(*sys.argv[2:])))
    else:
        globals()[sys.argv[1]](*sys.argv[2:])
