"""``fitmodels simulate``: a data set as a laboratory would write it, from the laws of a parameter file."""

import argparse
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.version import __version__
from .arguments import Parser, seed
from .plan import target

if TYPE_CHECKING:
    import pandas as pd

    from ..datasets import SimulatedLaw
    from ..parameters import ParameterFile


def parser() -> Parser:
    """Arguments of ``fitmodels simulate``."""
    p = Parser(
        "fitmodels simulate",
        "fitmodels simulate data-fit/GC435_709M40/params.json --out simulated.csv",
        "Simulate wear tests from the power laws of a parameter file: every edge of the plan is cut in\n"
        "sub-tests to the wear criterion or the longest time. Without --plan: a central composite design\n"
        "over the laws' ranges.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("--plan", metavar="FILE", help="plan of edges, as `fitmodels plan` writes it")
    p.add_argument("--interval", type=float, default=2.0, metavar="MIN", help="length of a sub-test (default: 2)")
    p.add_argument("--t-max", type=float, default=20.0, metavar="MIN", help="longest time on an edge (default: 20)")
    p.add_argument("--criterion", type=float, default=0.3, metavar="MM", help="wear that ends an edge (default: 0.3)")
    icc = "intraclass correlation: share of the variance between edges (default: 0.5)"
    p.add_argument("--icc", type=float, default=0.5, help=icc)
    p.add_argument("--seed", type=seed, default=1, help="seed of everything drawn (default: 1)")
    p.add_argument("--out", metavar="FILE", help="file to write; without it the data are printed")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the simulated data, and return the exit code."""
    from .. import parameters
    from ..datasets import simulate, write_csv

    if not 0 <= args.icc <= 1:
        raise UsageError(f"--icc {args.icc:g}: a share is between 0 and 1.")
    pf = parameters.read(args.file)
    laws = _laws(pf, args.icc)
    wear = next((law.response for law in laws if law.response in ("AW", "VB")), None)
    frame = simulate(
        _design(pf, laws, args), laws, interval=args.interval, t_max=args.t_max,
        criterion=args.criterion if wear is not None else None, wear=wear or "AW", seed=args.seed,
    )  # fmt: skip
    source = "/".join(Path(args.file).parts[-2:])  # not the whole path: the file may be passed on
    notes = [
        f"simulated: no real measurement; drawn by fitmodels {__version__} from the laws of {source}",
        f"simulated: seed {args.seed}, intraclass correlation of the edges {args.icc:g} (assumed)",
        f"tool: {pf.identity.tool}",
        f"work: {pf.identity.work}",
    ]
    write_csv(frame, target(args.out, args.force), notes)
    return 0


def _laws(pf: "ParameterFile", icc: float) -> "list[SimulatedLaw]":
    """The power laws of the file, wear first, since force and power depend on it."""
    from ..datasets import SimulatedLaw

    chosen = [law for law in pf.laws.values() if law.form == "power" and law.by is None]
    either = [fit for law in chosen for fit in (law, law.alternative)]
    powers = [law for law in either if law is not None and law.error == "multiplicative"]
    if not powers:
        raise UsageError("the parameter file has no power law with multiplicative errors to simulate from.")
    powers.sort(key=lambda law: law.response not in ("AW", "VB"))
    out = []
    for law in powers:
        exponents = {name: value for name, value in law.coefficients.items() if name != "c0"}
        sd = law.residual_se or 0.0
        errors = (sd * sqrt(icc), sd * sqrt(1 - icc))
        out.append(SimulatedLaw(law.response, law.unit, law.coefficients["c0"], exponents, *errors, digits=4))
    return out


def _design(pf: "ParameterFile", laws: "list[SimulatedLaw]", args: argparse.Namespace) -> "pd.DataFrame":
    import pandas as pd

    from ..datasets import central_composite, read_runs

    made = {law.response for law in laws} | {"t"}
    ranges = {f.symbol: (f.low, f.high) for law in pf.laws.values() for f in law.factors if f.symbol not in made}
    if args.plan is None:
        return central_composite(ranges, seed=args.seed)
    runs = read_runs(args.plan)
    columns = {name: runs.values(name) for name in ranges if runs.has(name)}
    edges = runs.labels("edge") if runs.has("edge") else [f"E{i + 1:02d}" for i in range(len(runs))]
    return pd.DataFrame({"edge": edges, **columns})
