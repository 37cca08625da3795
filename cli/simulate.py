"""``fitmodels simulate``: a data set as a laboratory would write it, from the laws of a parameter file."""

import argparse
from collections.abc import Mapping
from math import e, sqrt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import DataError, UsageError
from ..core.version import __version__
from ..datasets.vocabulary import FLANK_WEAR
from .arguments import Parser, parameter_file, seed
from .numbers import criterion
from .output import output_options
from .plan import write_table

if TYPE_CHECKING:
    import pandas as pd

    from ..core.arrays import Array
    from ..datasets.simulation import SimulatedResponse
    from ..parameters import LawSection, ParameterFile

ICC = 0.5  # where the file does not separate the scatter of edges from that of rows


def parser() -> Parser:
    """Arguments of ``fitmodels simulate``."""
    p = Parser(
        "fitmodels simulate",
        "fitmodels simulate data-fit/GC435_709M40-En-19/params.json --out simulated.csv",
        "Simulate wear tests from the laws of a parameter file, of whatever form: every edge of the plan is cut in\n"
        "sub-tests to the wear criterion or the longest time; one row an edge where no law is on time. Without\n"
        "--plan: a central composite design over the laws' ranges. What was assumed is in the notes of the data.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument(
        "--plan", metavar="FILE", help="plan of edges, as `fitmodels plan` writes it (default: central composite)"
    )
    p.add_argument("--interval", type=float, default=2.0, metavar="MIN", help="length of a sub-test (default: 2)")
    p.add_argument("--t-max", type=float, default=20.0, metavar="MIN", help="longest time on an edge (default: 20)")
    p.add_argument(
        "--criterion", type=criterion, default=0.3, metavar="MM", help="wear that ends an edge (default: 0.3)"
    )
    icc = "intraclass correlation: share of the variance between edges (default: as in the file, 0.5 where it has none)"
    p.add_argument("--icc", type=float, metavar="SHARE", help=icc)
    p.add_argument("--by", metavar="LEVEL", help="level of the laws that have levels (default: the reference)")
    p.add_argument("--seed", type=seed, default=1, metavar="N", help="seed of everything drawn (default: 1)")
    p.add_argument("--out", metavar="FILE", help="file to write (default: none, the data are printed)")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the data and its notes as JSON (fitmodels.simulation/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the simulated data, and return the exit code."""
    from ..datasets import simulate

    if args.icc is not None and not 0 <= args.icc <= 1:
        raise UsageError(f"--icc {args.icc:g}: a share is between 0 and 1.")
    pf = parameter_file(args.file)
    chosen, notes = _chosen(pf)
    laws = [_simulated(law, args, notes) for law in chosen]
    timed = any("t" in law.factors for law in laws)
    wear = next((law for law in laws if law.response in FLANK_WEAR and timed), None)
    design, planned = _design(pf, chosen, args)
    timed = timed or planned is not None
    frame = simulate(
        design, laws, interval=args.interval if timed else 1.0, t_max=args.t_max if timed else 1.0,
        times=None if planned is None else np.unique(planned["t"]),
        criterion=None if wear is None else _criterion(args.criterion, wear.unit),
        wear="AW" if wear is None else wear.response, seed=args.seed,
    )  # fmt: skip
    if planned is not None:
        kept = frame.set_index(["edge", "t"]).index.isin(planned.set_index(["edge", "t"]).index)
        frame = frame[kept].reset_index(drop=True)
        notes.append("times of the plan, not of --interval and --t-max")
    units = {f.symbol: f.unit for law in chosen for f in law.factors if f.unit}
    frame.attrs["units"] = {**frame.attrs["units"], **units, **{law.response: law.unit for law in chosen}}
    if not timed:
        frame = frame.drop(columns="t")
        notes.append("no law is on the cutting time: one row an edge")
    notes += [*_not_positive(frame, chosen), *_extrapolated(frame, chosen, args.by)]
    source = "/".join(Path(args.file).parts[-2:])  # not the whole path: the file may be passed on
    head = [
        f"no real measurement; drawn by fitmodels {__version__} from the laws of {source}",
        f"seed {args.seed}",
        *notes,
    ]
    who = [f"tool: {pf.identity.tool}", f"work: {pf.identity.work}"]
    write_table(frame, args, [*(f"simulated: {line}" for line in head), *who], schema="simulation")
    return 0


def _chosen(pf: "ParameterFile") -> "tuple[list[LawSection], list[str]]":
    """Laws in the order in which they depend on each other, and notes on what is left out."""
    if not pf.laws:
        raise UsageError("the parameter file has no law to simulate from.")
    laws, notes = dict(pf.laws), list[str]()
    if "T" in laws and any(f.symbol == "t" for law in laws.values() for f in law.factors):
        del laws["T"]
        notes.append("T is left out: it is one life of an edge, and the other laws give a row for each sub-test")
    ordered: list[LawSection] = []
    while laws:
        free = [name for name, law in laws.items() if not _on(law) & (set(laws) - {name})]
        if not free:
            raise UsageError(
                f"the laws of {', '.join(laws)} depend on each other, so none of them can be simulated first; fit one "
                "of them without the other's response among its factors."
            )
        first = next((name for name in free if name in FLANK_WEAR), free[0])
        ordered.append(laws.pop(first))
    return ordered, notes


def _on(law: "LawSection") -> set[str]:
    return {factor.symbol for factor in law.factors}


def _simulated(law: "LawSection", args: argparse.Namespace, notes: list[str]) -> "SimulatedResponse":
    """A law of the file with the deviations that it states."""
    from ..datasets.simulation import SimulatedResponse
    from ..parameters.evaluation import equation_of

    level = _level(law, args.by, notes)
    equation, symbols = equation_of(law, level), tuple(f.symbol for f in law.factors)

    def response(known: Mapping[str, "Array"]) -> "Array":
        X = np.stack(np.broadcast_arrays(*(known[name] for name in symbols)), axis=-1)
        values = equation.values(X)
        if not np.isfinite(values).all():
            bad = X[~np.isfinite(values)][0]
            at = ", ".join(f"{f.symbol} {x:.4g} {f.unit}".rstrip() for f, x in zip(law.factors, bad, strict=True))
            raise DataError(f"the {law.form.replace('_', ' ')} law of {law.response} has no value at {at}.")
        return values

    between, within = _deviations(law, args.icc, notes)
    weibull = law.life is not None and law.life.distribution == "weibull"
    return SimulatedResponse(
        law.response, law.unit, symbols, response, between, within, adds=law.error == "additive", weibull=weibull
    )


def _level(law: "LawSection", given: str | None, notes: list[str]) -> str | None:
    if law.by is None:
        return None
    known = (law.by.reference, *law.by.shifts)
    if given is not None and given not in known:
        raise UsageError(
            f"--by {given}: the law of {law.response} has no such {law.by.column}; it has {', '.join(known)}."
        )
    level = law.by.reference if given is None else given
    notes.append(
        f"{law.response} is that of {law.by.column} {level}{'' if given else ', the reference level (assumed)'}"
    )
    return level


def _deviations(law: "LawSection", icc: float | None, notes: list[str]) -> tuple[float, float]:
    """Standard deviations between and within edges, in logarithms or in the unit of the response."""
    if law.life is not None:
        name = "Weibull" if law.life.distribution == "weibull" else law.life.distribution
        notes.append(f"{law.response} scatters as {name} lives of scale {law.life.scale:.3g} in ln")
        return 0.0, law.life.scale
    unit = "ln" if law.error == "multiplicative" else law.unit
    if law.deviations and icc is None:
        return law.deviations
    if law.residual_se is None:
        notes.append(f"{law.response} is without scatter: the file has no residual standard error")
        return 0.0, 0.0
    share, why = (ICC, " (assumed)") if icc is None else (icc, "")
    notes.append(
        f"{law.response} scatters by {law.residual_se:.3g} {unit}, intraclass correlation of the edges {share:g}{why}"
    )
    return law.residual_se * sqrt(share), law.residual_se * sqrt(1 - share)


def _criterion(given: float, unit: str) -> float:
    """The wear criterion, mm, in the unit of the wear law."""
    from ..datasets.units import convert, same_dimension

    return float(convert(np.array([given]), "mm", unit)[0]) if same_dimension("mm", unit) else given


def _not_positive(frame: "pd.DataFrame", laws: "list[LawSection]") -> list[str]:
    """A note on each response whose added errors take it to zero or below."""
    counts = {law.response: int((frame[law.response] <= 0).sum()) for law in laws}
    return [f"{name} is zero or negative in {n} of {len(frame)} rows: errors are added to its law"
            for name, n in counts.items() if n]  # fmt: skip


def _extrapolated(frame: "pd.DataFrame", laws: "list[LawSection]", by: str | None) -> list[str]:
    """A note on each law that was used outside its tested region."""
    notes = []
    for law in laws:
        given = {f.symbol: frame[f.symbol].to_numpy(dtype=np.float64) for f in law.factors}
        usable = np.logical_and.reduce([
            values > 0 if log else np.isfinite(values)
            for values, log in zip(given.values(), law.formula.logs, strict=True)
        ])  # fmt: skip
        inside = law.inside(by if law.by else None, **{name: values[usable] for name, values in given.items()})
        outside = len(frame) - int(np.count_nonzero(inside))
        if outside:
            notes.append(f"{law.response} is extrapolated in {outside} of {len(frame)} rows, outside its tests")
    return notes


def _design(
    pf: "ParameterFile", laws: "list[LawSection]", args: argparse.Namespace
) -> "tuple[pd.DataFrame, pd.DataFrame | None]":
    """A row for each edge; edge and time of each reading where a plan states them, else None."""
    import pandas as pd

    from ..datasets import read_runs

    made = {law.response for law in laws} | {"t"}
    ranges: dict[str, tuple[float, float]] = {}
    for law in laws:
        for f in law.factors:
            if f.symbol not in made:
                low, high = ranges.get(f.symbol, (f.low, f.high))
                both = max(low, f.low), min(high, f.high)  # where every law was tested, if there is such a range
                ranges[f.symbol] = both if both[0] <= both[1] else (min(low, f.low), max(high, f.high))
    if args.plan is None:
        return _composite(ranges, args.seed), None
    runs = read_runs(args.plan)
    if lacking := [name for name in ranges if not runs.has(name)]:
        raise UsageError(f"{args.plan} has no column {', '.join(lacking)}, which the laws of {pf.identity.tool} need.")
    columns = {name: runs.values(name) for name in ranges}
    edges = runs.labels("edge") if runs.has("edge") else [f"E{i + 1:02d}" for i in range(len(runs))]
    plan = pd.DataFrame({"edge": edges, **columns})
    if not runs.has("t"):
        return plan, None
    planned = plan[["edge"]].assign(t=runs.values("t"))
    if not (planned["t"] > 0).all():
        raise UsageError(f"{args.plan} has rows without a time t above zero; complete them, or leave the column out.")
    return plan.drop_duplicates("edge").reset_index(drop=True), planned


def _composite(ranges: Mapping[str, tuple[float, float]], seed: int) -> "pd.DataFrame":
    """A central composite design; a factor from zero on has evenly spaced levels, one of a single value stays."""
    from ..datasets import central_composite

    varied = {name: ends for name, ends in ranges.items() if ends[0] < ends[1]}
    if not varied:
        raise UsageError("no factor of the laws varies in the tests; give --plan with the settings to simulate.")
    logged = {name: ends if ends[0] > 0 else (1.0, e) for name, ends in varied.items()}
    plan = central_composite(logged, seed=seed)
    for name, (low, high) in varied.items():
        if low <= 0:
            plan[name] = low + (high - low) * np.log(plan[name])
    return plan.assign(**{name: low for name, (low, high) in ranges.items() if low == high})
