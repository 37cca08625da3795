"""Options shared by the commands that read or fit tests, and the analysis options made of them."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import UsageError
from .arguments import Parser, seed
from .numbers import constants, criterion, measured, pairs, ranges
from .output import complain

if TYPE_CHECKING:
    from ..controllers.recursion.plan import PlanOptions
    from ..datasets import Runs
    from ..parameters import ParameterFile
    from ..pipeline import FitOptions

MOST = 12  # pairs that are listed


def reading_options(parser: Parser) -> None:
    """Add the options of reading a file."""
    group = parser.add_argument_group("reading")
    group.add_argument(
        "--map",
        action="append",
        metavar="VB=COLUMN",
        help="column of a role, by name or as col7 (default: by the headers)",
    )
    group.add_argument(
        "--unit",
        action="append",
        metavar="t=s",
        help="unit of a column where it is missing, wrong or doubted (default: the header)",
    )
    group.add_argument(
        "--range",
        action="append",
        metavar="V=50:200",
        help="values of coded levels -1 and 1, or of each of numbered levels 1, 2, 3 (default: none)",
    )
    group.add_argument(
        "--value", action="append", metavar="D=80", help="a constant that the file does not contain (default: none)"
    )
    group.add_argument(
        "--correct", action="append", metavar="E07:f*25.4",
        help="correct a quantity of edges (E07,E11), of 'lines 12,14-16' or of all, by * / + or -; all:t=cumulative "
        "adds the times of sub-tests up (default: none)",
    )  # fmt: skip
    group.add_argument(
        "--leave-out", action="append", metavar="TARGET", help="edges or lines that are not used (default: none)"
    )
    group.add_argument(
        "--edge", metavar="COLUMN", help="column of the cutting edges; none: do not infer edges (default: found)"
    )
    processes = ["turning", "milling", "drilling", "grinding"]
    group.add_argument(
        "--process", choices=processes, help="process whose plausible ranges apply (default: by the columns)"
    )
    group.add_argument("--tool", metavar="NAME", help="name of the tool (default: from the file)")
    group.add_argument("--work", metavar="NAME", help="name of the work material (default: from the file)")
    group.add_argument("--decimal", choices=["point", "comma"], help="decimal mark (default: found in the file)")
    group.add_argument("--delimiter", metavar="MARK", help="delimiter of cells (default: found in the file)")
    group.add_argument("--sheet", metavar="NAME", help="sheet of a workbook (default: the one that holds tests)")
    group.add_argument("--hidden", action="store_true", help="read hidden rows and columns of a workbook too")


def fitting_options(parser: Parser) -> None:
    """Add the options of fitting laws and drawing posteriors."""
    group = parser.add_argument_group("fitting")
    law_option(group)
    group.add_argument(
        "--error", choices=["multiplicative", "additive"], default="multiplicative",
        help="multiplicative error (log scale; default), or additive error (original scale)",
    )  # fmt: skip
    group.add_argument("--criterion", type=criterion, metavar="MM", help="wear at the end of tool life (default: 0.3)")
    group.add_argument(
        "--gauge-sd", type=float, metavar="MM", help="standard deviation of the wear gauge (default: not known)"
    )
    group = parser.add_argument_group("posterior")
    group.add_argument("--seed", type=seed, default=1, metavar="N", help="seed of the draws (default: 1)")
    group.add_argument("--draws", type=int, default=4000, metavar="N", help="number of draws (default: 4000)")
    group.add_argument(
        "--priors", metavar="FILE", default="weak", help='TOML file, or "reference": flat (default: weak, proper)'
    )
    group.add_argument("--student", action="store_true", help="Student-t errors, for outlying rows or edges")


def law_option(group: argparse._ArgumentGroup) -> None:
    """Add the option of laws in place of the default ones."""
    words = (
        'law in place of the default one of this response; "Ra ~ + VB" and "Ra ~ - t" change its factors (default: all '
        "usual ones)"
    )
    group.add_argument("--law", action="append", dest="laws", metavar='"Ra ~ V, f, d"', help=words)


def form_option(parser: Parser | argparse._ArgumentGroup) -> None:
    """Add the option of the forms that laws are kept in."""
    words = (
        'form of the laws, or of one law ("Ra=linear"): power, linear, second-order, ...; see compare (default: the '
        "usual one)"
    )
    parser.add_argument("--form", action="append", metavar="FORM", help=words)


def forms(words: list[str] | None) -> str | dict[str, str]:
    """``["linear", "Ra=power"]`` as the option ``form`` of an analysis.

    >>> forms(["linear"]), forms(["linear", "Ra=power"]), forms(None)
    ('linear', {'*': 'linear', 'Ra': 'power'}, '')
    """
    words = words or []
    _one_for_all([word for word in words if "=" not in word])
    named = [word if "=" in word else f"*={word}" for word in words]
    found = pairs(named, "--form", "Ra=linear")
    return found["*"] if list(found) == ["*"] else found or ""


def _one_for_all(words: list[str]) -> None:
    if len(words) > 1:
        first, second = words[:2]
        remedy = f"keep one, or name the law, as Ra={second}"
        raise UsageError(f"a form for all laws is given twice, {first} and {second}: {remedy}.")


def read_keywords(args: argparse.Namespace) -> dict[str, Any]:
    """Reading options under the names of `datasets.read_runs`."""
    return {
        "map": pairs(args.map, "--map", "VB=col7"),
        "units": pairs(args.unit, "--unit", "t=s"),
        "ranges": ranges(args.range, most=7),
        "constants": constants(args.value),
        "correct": tuple(args.correct or ()),
        "leave_out": tuple(args.leave_out or ()),
        "tool": args.tool,
        "work": args.work,
        "edge": args.edge,
        "process": args.process,
        "decimal": args.decimal,
        "delimiter": args.delimiter,
        "sheet": args.sheet,
        "hidden": args.hidden,
    }


def fit_options(args: argparse.Namespace, *more: str) -> "FitOptions":
    """Analysis options from the command line; ``more`` are options that not every command has."""
    from ..pipeline import FitOptions

    laws = tuple(args.laws or ())
    names = ("error", "criterion", "gauge_sd", "seed", "draws", "priors", "student", *more)
    given = {name: getattr(args, name) for name in names}
    return FitOptions(**read_keywords(args), laws=laws, form=forms(getattr(args, "form", None)), **given)


def read(file: str | Path, args: argparse.Namespace) -> "Runs":
    """Read a file of tests with the options of the command; doubts about it are printed on standard error."""
    from ..datasets import read_runs

    runs = read_runs(file, **read_keywords(args))
    for doubt in () if args.quiet else runs.doubts:
        complain(f"doubt about {runs.source.name}: {doubt}")
    return runs


PLAN_NAMES = ("depth", "time", "interval", "grid", "wear_state", "factors", "objective", "removal", "by", "at")


def plan_options(parser: Parser | argparse._ArgumentGroup) -> None:
    """Add the settings and objective of a region and of a plan."""
    group = parser.add_argument_group("settings") if isinstance(parser, Parser) else parser
    group.add_argument(
        "--depth", metavar="1.5mm", help="depth of cut (default: 2.5 mm, or the middle of the tested depths)"
    )
    group.add_argument(
        "--time", metavar="15min",
        help="time in the cut: of the region (default: 10 min, or the middle of the tests); of the plan at most "
        "(default: to the end of the edge)",
    )  # fmt: skip
    group.add_argument(
        "--objective", choices=["removal", "life", "cost", "time"],
        help="of the plan: removal, the largest removal rate of each interval (default); life, the longest life at "
        "--removal; cost, the least cost by `fitmodels costs`; time, most metal in --time",
    )  # fmt: skip
    group.add_argument(
        "--removal",
        metavar="60cm3/min",
        help="least removal rate of every interval, with --objective life (default: none)",
    )
    group.add_argument("--interval", metavar="2min", help="between changes of V and f (default: 1 min)")
    group.add_argument(
        "--grid", action="append", metavar="V=5m/min", help="steps of V and of f (default: 10 m/min and 0.005 mm/rev)"
    )
    group.add_argument(
        "--wear-state", action=argparse.BooleanOptionalAction,
        help="wear adds up from the wear reached, or by the time as in AC-2017 (default: from the wear reached for "
        "objectives cost and time)",
    )  # fmt: skip
    group.add_argument(
        "--factors", choices=["published", "full"],
        help="whether power and force have their factors of time; published, as in AC-2017, leaves them out (default: "
        "full, except for the file of that paper)",
    )  # fmt: skip
    group.add_argument("--by", metavar="LEVEL", help="level of laws that have levels (default: their reference)")
    group.add_argument(
        "--at",
        action="append",
        metavar="D=80mm",
        help="a further factor of the laws, or the diameter (default: none)",
    )


def plan_asked(args: argparse.Namespace) -> list[str]:
    """The options of `plan_options` that were given, as they are typed."""
    return [f"--{name.replace('_', '-')}" for name in PLAN_NAMES if getattr(args, name) is not None]


def plan_options_of(args: argparse.Namespace, pf: "ParameterFile") -> "PlanOptions":
    """Settings and objective from the command line; values with a unit are converted.

    Raises
    ------
    UsageError
        A value that is no number, is not above zero, is in another unit, or an objective without what it needs.
    """
    from ..controllers.recursion.from_file import need_level
    from ..controllers.recursion.plan import PlanOptions

    need_level(pf, args.by)
    asked = {
        name: None if text is None else measured(text, unit, f"--{name}", example) * times
        for name, text, unit, example, times in (
            ("depth", args.depth, "mm", "1.5mm", 1.0), ("time", args.time, "min", "15min", 1.0),
            ("interval", args.interval, "min", "2min", 1.0), ("removal", args.removal, "cm3/min", "60cm3/min", 1000.0),
        )
    }  # fmt: skip
    return PlanOptions(
        **asked,
        grid=_grid(args.grid),
        wear_state=args.wear_state,
        factors=args.factors,
        objective=args.objective or "removal",
        by=args.by,
        at=further(args.at, pf),
    )


def _grid(words: list[str] | None) -> tuple[float, float] | None:
    """Steps of V and f; one that is not named stays as in the paper."""
    from ..controllers.recursion.interval_optimum import FEED_STEP, SPEED_STEP

    given = pairs(words, "--grid", "V=5m/min")
    if unknown := [name for name in given if name not in ("V", "f")]:
        raise UsageError(f"--grid {unknown[0]}: the grid is of V and f; write --grid V=5m/min --grid f=0.002mm/rev.")
    units = {"V": ("m/min", SPEED_STEP), "f": ("mm/rev", FEED_STEP)}
    steps = {
        name: measured(given[name], unit, f"--grid {name}", f"{name}={usual:g}{unit}") if name in given else usual
        for name, (unit, usual) in units.items()
    }
    return (steps["V"], steps["f"]) if given else None


def further(words: list[str] | None, pf: "ParameterFile") -> dict[str, float]:
    """Further factors in the units of the laws; the diameter D in mm."""
    units = {"D": "mm", **{factor.symbol: factor.unit for law in pf.laws.values() for factor in law.factors}}
    found = {}
    for name, text in pairs(words, "--at", "D=80mm").items():
        if name not in units:
            raise UsageError(f"--at {name}: no law has this factor; they have {', '.join(sorted(units))}.")
        found[name] = measured(text, units[name], f"--at {name}", f"{name}=80")
    return found


def one_pair(args: argparse.Namespace) -> "Runs":
    """The tests of the pair that ``--tool`` and ``--work`` name; in a file of one pair these are names as elsewhere.

    Raises
    ------
    UsageError
        The file holds several pairs, and not exactly one of them is named: a law of all would be of none of them.
    """
    several = tuple(read(args.file, argparse.Namespace(**{**vars(args), "tool": None, "work": None})).pairs())
    if len(several) == 1 and (args.tool or args.work):
        return read(args.file, argparse.Namespace(**{**vars(args), "quiet": True}))
    found = [one for one in several if (args.tool or one.tool, args.work or one.work) == (one.tool, one.work)]
    if len(found) == 1:
        return found[0]
    raise UsageError(_to_choose(args, several, found))


def _options_of(runs: "Runs", several: "Sequence[Runs]") -> str:
    """The options that name a pair of several."""
    roles = [role for role in ("tool", "work") if len({getattr(one, role) for one in several}) > 1]
    return " ".join(f"--{role} {shlex.quote(getattr(runs, role))}" for role in roles)


def _to_choose(args: argparse.Namespace, several: "Sequence[Runs]", found: "Sequence[Runs]") -> str:
    """The message on a file of several pairs, of which not exactly one is named."""
    pairs = [_options_of(one, several) for one in found or several]
    shown = "; ".join(pairs[:MOST]) + (f"; and {len(pairs) - MOST} more" if len(pairs) > MOST else "")
    named = [f"{word} {name}" for word, name in (("tool", args.tool), ("work material", args.work)) if name]
    asked = "" if found else f", none of them with {' and '.join(named)}"
    return (
        f"{args.file} has tests of {len(several)} pairs of tool and work material{asked}, and each has laws of its "
        f"own: name the one to plan for. {shown}."
    )
