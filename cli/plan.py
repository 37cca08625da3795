"""``fitmodels plan``: a design for a user's own ranges, in run order, as a CSV to fill in."""

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np

from .arguments import Parser, seed
from .numbers import constants, in_units, pairs, ranges
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    import pandas as pd

    from ..core.arrays import Array
    from ..datasets import Runs

MOST = 12  # edges beyond a limit that are named
SET = (("V", "n"), ("f", "fz", "fm"), ("d",), ("ae",))  # settings of a machine; of each group one is enough
DIGITS = 4  # of a setting
HARDLY = 0.01  # range over the median of a setting that counts as the same in all tests


def parser() -> Parser:
    """Arguments of ``fitmodels plan``."""
    p = Parser(
        "fitmodels plan",
        "fitmodels plan --range V=50:200 --range f=0.06:0.6 --range d=1.5:3 --out plan.csv",
        "Plan tests in the logarithms of the conditions, one edge per row (or a row per reading), with the run order\n"
        "drawn at random. Filled in, the file is read by 'fitmodels plan.csv'. Without --out the plan is printed.",
    )
    p.add_argument(
        "--range",
        action="append",
        metavar="V=50:200",
        help="a condition and its range, V=160:650sfm in another unit; up to six (default: none)",
    )
    p.add_argument(
        "--levels",
        action="append",
        metavar="f=0.1,0.2,0.4",
        help="levels of an array: numbers, or words, dry,flood (default: none)",
    )
    p.add_argument(
        "--process", choices=["turning", "milling", "drilling"], help="checks names, adds n and fm (default: none)"
    )
    p.add_argument("--value", action="append", metavar="Dc=20", help="what is the same in all tests (default: none)")
    p.add_argument(
        "--limit", action="append", metavar="n=8000",
        help="limit of the machine, also P=7kW, n=50:8000: edges beyond it are named (default: none)",
    )  # fmt: skip
    p.add_argument(
        "--design", default="composite", metavar="NAME",
        help="composite (default), factorial, or an orthogonal array: L4, L8, L9, L12, L16, L18, L27",
    )  # fmt: skip
    p.add_argument(
        "--alpha", default="2", metavar="A",
        help="distance of the axial points, coded: a number, rotatable, face-centred or orthogonal (default: 2)",
    )  # fmt: skip
    p.add_argument("--half", action="store_true", help="half of the factorial; its aliases are printed")
    p.add_argument("--blocks", type=int, default=1, metavar="N", help="blocks, such as days or bars (default: 1)")
    p.add_argument("--centre", type=int, metavar="N", help="edges at the centre (default: 4; of an array: 0)")
    p.add_argument("--axial", type=int, default=2, metavar="N", help="edges at each axial point (default: 2)")
    p.add_argument("--repeats", type=int, default=1, metavar="N", help="edges at each point of a factorial or array")
    p.add_argument(
        "--duration", metavar="5:20", help="minutes in cut of an edge: a number, or a range to vary (default: none)"
    )
    p.add_argument(
        "--readings", type=int, default=1, metavar="N", help="readings of an edge up to its duration (default: 1)"
    )
    p.add_argument("--measure", metavar="VB,Fc", help="empty columns to fill in (default: none)")
    p.add_argument("--seed", type=seed, default=1, metavar="N", help="seed of the run order (default: 1)")
    p.add_argument("--out", metavar="FILE", help="file to write (default: none, the plan is printed)")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the plan and its notes as JSON (fitmodels.plan/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the plan, and return the exit code."""
    from ..datasets import plan_tests

    plan = plan_tests(
        _factors(args),
        design=args.design, alpha=_alpha(args.alpha), centre=args.centre, axial_repeats=args.axial, half=args.half,
        repeats=args.repeats, blocks=args.blocks, duration=_duration(args.duration), readings=args.readings,
        measure=[name.strip() for name in args.measure.split(",")] if args.measure else (), process=args.process,
        constants=constants(args.value), seed=args.seed,
    )  # fmt: skip
    coded = [name for name in map(str, plan) if name.endswith("_coded")]
    plan[coded] = plan[coded].round(3) + 0.0  # no minus before a zero
    what = {"composite": f"central composite design in logarithms, alpha {args.alpha}"}.get(
        args.design, f"{args.design} design in logarithms"
    )
    notes = [
        f"plan: {what}, {plan['edge'].nunique()} edges, seed {args.seed}",
        *_beyond_limits(plan, args),
        *plan.attrs["notes"],
        "Cut the edges in the order of run; measure wear, forces and power after each sub-test, a row each.",
    ]
    write_table(plan, args, notes)
    return 0


def _beyond_limits(plan: "pd.DataFrame", args: argparse.Namespace) -> list[str]:
    """A sentence on each limit of the machine, with the edges beyond it."""
    from ..core.errors import UsageError
    from ..core.rounding import format_decimal, listed
    from ..datasets.headers import setting_named
    from ..datasets.vocabulary import ROLES

    found, edges = [], plan.drop_duplicates("edge")
    for name, text in pairs(args.limit, "--limit", "n=8000").items():
        ends, symbol = in_units(name, text.split(":")) or (), setting_named(name)
        if len(ends) not in (1, 2) or not 0 < ends[0] <= ends[-1]:
            raise UsageError(f"--limit {name}={text}: give one number above zero, or low:high, as n=8000 or P=7kW.")
        values = _set_values(edges, symbol, args.process)
        beyond = (values > ends[-1]) | (values < ends[0] if len(ends) > 1 else False)
        which = [f"{edge} ({format_decimal(x)})" for edge, x in zip(edges["edge"][beyond], values[beyond], strict=True)]
        head = f"Limit: {symbol} {'at most' if len(ends) == 1 else 'from'} {' to '.join(map(format_decimal, ends))}"
        said = (
            f"{len(which)} of {len(edges)} edges are beyond it: {listed(which, MOST)}" if which else "all edges keep it"
        )
        found.append(f"{head} {ROLES[symbol].unit}; {said}.")
    return found


def _set_values(edges: "pd.DataFrame", symbol: str, process: str | None) -> "Array":
    """Values of a setting, or the power, of each edge of a plan."""
    from ..core.errors import UsageError
    from ..datasets.derived.rules import removal_rate
    from ..datasets.planning import KW
    from ..datasets.vocabulary import ROLES

    rate = removal_rate(edges, process) if symbol == "P" else None
    if rate is not None:
        return rate * KW
    if symbol not in edges or symbol not in ROLES or edges[symbol].dtype == object:
        what = f"{symbol} ({ROLES[symbol].quantity})" if symbol in ROLES else symbol
        raise UsageError(
            f"--limit {symbol}: the plan has no {what}. Spindle speed, feed rate and power follow with --process and "
            "--value of what is the same in all tests, such as D=80, or Dc=20, z=4 and ae=8."
        )
    return edges[symbol].to_numpy(dtype=float)


def _ends(texts: list[str] | None) -> dict[str, tuple[float, float]]:
    """Low and high end of each range."""
    from ..core.errors import UsageError

    found = ranges(texts)
    for name, ends in found.items():
        if len(ends) != 2:
            raise UsageError(f"--range {name}: a plan needs low:high, two numbers.")
    return {name: (ends[0], ends[1]) for name, ends in found.items()}


def _factors(args: argparse.Namespace) -> dict[str, tuple[float, float] | list[float] | list[str]]:
    """Factors in the order given: ranges, then levels."""
    from ..core.errors import UsageError

    out: dict[str, tuple[float, float] | list[float] | list[str]] = {}
    out.update(_ends(args.range))
    for name, text in pairs(args.levels, "--levels", "f=0.1,0.2,0.4").items():
        if name in out:
            raise UsageError(f"--levels {name}: its range is given too; leave one out.")
        words = [word.strip() for word in text.split(",")]
        found = in_units(name, words)
        out[name] = words if found is None else list(found)
    if not out and args.process is None:
        raise UsageError("no range: give at least one, for instance --range V=50:200.")
    return out


def _numbers(words: list[str]) -> list[float]:
    """The words as numbers; none where one of them is not."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


def _alpha(text: str) -> "float | str":
    return _numbers([text])[0] if _numbers([text]) else text


def _duration(text: str | None) -> tuple[float, ...] | None:
    from ..core.errors import UsageError

    if text is None:
        return None
    numbers = in_units("t", text.split(":")) or ()
    if len(numbers) not in (1, 2):
        raise UsageError(f"--duration {text}: give minutes in cut as 12, or a range as 5:20.")
    if not 0 < numbers[0] <= numbers[-1] or (len(numbers) == 2 and numbers[0] == numbers[1]):
        raise UsageError(f"--duration {text}: minutes lie above zero, and the first of a range below the second.")
    return numbers


def write_table(frame: "pd.DataFrame", args: argparse.Namespace, notes: list[str], schema: str = "plan") -> None:
    """Write a table with its notes to standard output, or to the file of --out and then print the notes."""
    from ..datasets import write_csv

    inputs = [name for option in ("file", "plan") if (name := getattr(args, option, None)) is not None]
    place = target(args.out, args.force, *inputs)
    if args.out is not None or not args.json:
        write_csv(frame, place, notes, force=args.force)
    if args.json:
        rows = json.loads(frame.to_json(orient="records", double_precision=15))
        facts = {"file": args.out, "simulated": schema == "simulation", "units": frame.attrs.get("units", {})}
        print_json(schema, {**facts, "notes": notes, "rows": rows})
    elif args.out is not None:
        out = Printer(quiet=args.quiet)
        for line in notes:
            out.show(line)
        out.wrote(f"Written: {args.out}", args.out)


def target(out: str | None, force: bool, *inputs: str) -> Path | TextIO:
    """Standard output, or a text file that may be written and is none of the inputs."""
    from ..core.errors import UsageError
    from ..core.files import refuse_input
    from ..core.journal import recover
    from ..datasets.tables.workbook import SUFFIXES

    if out is None:
        return sys.stdout
    path = Path(out)
    if path.is_dir() or not path.parent.is_dir():
        raise UsageError(f"{out}: give the name of a file in a folder that exists.")
    if path.suffix.lower() in SUFFIXES:
        raise UsageError(f"--out {out}: the table is text, not a workbook; give a name that ends in .csv.")
    refuse_input(path, *inputs)
    recover(path)
    if path.exists() and not force:
        raise UsageError(f"{out} exists; replace it with --force, or choose another name.")
    return path


def same_in_all(runs: "Runs", names: Iterable[str]) -> dict[str, float]:
    """Values of those of these settings that were the same in all tests, within 1 %, or given for the file."""
    from ..datasets.design import round_significant

    out = {}
    for name in names:
        x = runs.values(name) if runs.has(name) else np.array([])
        x = x[np.isfinite(x)]
        if name in runs.constants:
            out[name] = runs.constants[name]
        elif len(x) and np.ptp(x) <= HARDLY * abs(np.median(x)):
            out[name] = float(round_significant(np.median(x), DIGITS))
    return out


def _constants(plan: "pd.DataFrame", runs: "Runs", cutter: bool) -> dict[str, float]:
    """Settings that a plan lacks and that were the same in all tests; of a cutter with its diameter and teeth."""
    from ..datasets.planning import PROCESSES

    process = PROCESSES.get(runs.process or "")
    of_tool = [name for name in ("Dc", "D", "z") if process is None or name in process.constants] if cutter else []
    groups = (*SET, *((name,) for name in of_tool))
    found = (same_in_all(runs, group) for group in groups if not set(group) & set(plan))
    return dict(next(iter(same.items())) for same in found if same)


def for_machine(plan: "pd.DataFrame", runs: "Runs") -> "pd.DataFrame":
    """The plan with settings and words (coolant) that were the same in all tests; of a cutter with fz, n and fm."""
    from ..datasets.derived.rules import machine_settings
    from ..datasets.design import round_significant
    from ..datasets.vocabulary import ROLES

    units = dict(plan.attrs["units"])
    cutter = runs.process != "turning" and bool({"Dc", "D"} & (runs.constants.keys() | set(runs.data)))
    for name, value in _constants(plan, runs, cutter).items():
        plan[name], units[name] = value, runs.units.get(name, "") or ROLES[name].unit
    words = {str(name): runs.data[name].unique() for name in runs.data if name not in (*ROLES, *plan)}
    plan = plan.assign(**{name: x[0] for name, x in words.items() if len(x) == 1 and isinstance(x[0], str)})
    settings = [name for group in SET for name in group if name in plan]
    plan = plan[[*plan.columns[:3], *settings, *(name for name in plan.columns[3:] if name not in settings)]]
    if cutter and all(units.get(name) == ROLES[name].unit for name in ("V", "n", "f", "fz", "fm") if name in plan):
        if {"f", "z"} <= set(plan):
            feed = round_significant(plan["f"].to_numpy(dtype=float) / plan["z"].to_numpy(dtype=float), DIGITS)
            plan.insert(list(plan).index("f"), "fz", feed)
            plan = plan.drop(columns="f")
        plan = plan.assign(**machine_settings(plan, runs.process))
        units |= {name: ROLES[name].unit for name in ("V", "n", "fz", "fm") if name in plan}
    plan.attrs = {"units": {name: unit for name, unit in units.items() if unit not in ("", "1")}}
    return plan
