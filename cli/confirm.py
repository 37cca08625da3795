"""``fitmodels confirm``: new runs compared with the prediction intervals of the laws of earlier ones."""

import argparse
import re
from collections.abc import Collection
from copy import copy
from typing import TYPE_CHECKING

from .arguments import Parser
from .conditions import AGREE
from .options import form_option, forms, law_option, read, reading_options
from .output import as_options, complain, output_options, print_json, print_lines

if TYPE_CHECKING:
    from ..datasets import Runs
    from ..fit import LawFit
    from ..fit.defaults import Refused

OF_DATA = "data_"  # before the name of a reading option of the earlier tests


def parser() -> Parser:
    """Arguments of ``fitmodels confirm``."""
    p = Parser(
        "fitmodels confirm",
        "fitmodels confirm new.csv --data data.csv",
        "Fit the laws of DATA, and test whether the runs of NEW are inside their prediction intervals. Runs of\n"
        "several tools or work materials are compared with the laws of the same ones. Options of reading are of NEW;\n"
        "with --data- before their names, as --data-unit VB=um, of DATA. Exit code 5: a law does not hold.",
        main="--level --quiet --json --law --form --map --unit",
    )
    p.add_argument("file", metavar="NEW", help="table of new runs")
    p.add_argument("--data", metavar="DATA", required=True, help="table of the runs that the laws are fitted to")
    p.add_argument(
        "--level", type=float, default=0.95, metavar="LEVEL", help="level of the prediction intervals (default: 0.95)"
    )
    output_options(p, "print the verdicts as JSON (fitmodels.confirm/1)")
    group = p.add_argument_group("laws of DATA, as the main command fits them")
    law_option(group)
    form_option(group)
    reading_options(p)
    _options_of_data(p)
    return p


def _options_of_data(p: Parser) -> None:
    """Add the options of reading once more, for DATA: ``--data-unit`` for ``--unit``."""
    of_new = p._action_groups[-1]
    of_new.title, group = "reading of NEW", p.add_argument_group("reading of DATA")
    for option in of_new._group_actions:
        twin = copy(option)
        twin.dest = OF_DATA + option.dest
        twin.option_strings = [_of_data(name) for name in option.option_strings]
        group._add_action(twin)


def _of_data(text: str) -> str:
    """A text with its options of reading as those of DATA.

    >>> _of_data("is unusual: --unit t=s")
    'is unusual: --data-unit t=s'
    """
    return re.sub(rf"(?<![\w-])--(?=({'|'.join(_reading())})(?![\w-]))", "--data-", as_options(text))


def _reading() -> list[str]:
    """Names of the options of reading, without the dashes."""
    p = Parser("", "", "")
    reading_options(p)
    return [one.option_strings[0][2:] for one in p._action_groups[-1]._group_actions]


def _read_data(args: argparse.Namespace) -> "Runs":
    """The earlier tests, read with their own options, which doubts and errors name."""
    from ..core.errors import FitmodelsError

    own = {name.removeprefix(OF_DATA): value for name, value in vars(args).items() if name.startswith(OF_DATA)}
    try:
        runs = read(args.data, argparse.Namespace(**{**vars(args), **own, "quiet": True}))
    except FitmodelsError as error:
        raise type(error)(_of_data(str(error))) from None
    for doubt in () if args.quiet else runs.doubts:
        complain(f"doubt about {runs.source.name}: {_of_data(str(doubt))}")
    return runs


def run(args: argparse.Namespace) -> int:
    """Print a verdict for each law, and return the exit code."""
    from ..core.errors import UsageError

    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level:g}: give a number between 0 and 1, for instance 0.95.")
    old, new = _read_data(args), read(args.file, args)
    known = tuple(old.pairs())
    parts = [(part, _same_pair(part, known, args)) for part in new.pairs()]
    verdicts: dict[str, str] = {}
    untested: dict[str, str] = {}
    holds = True
    for part, law_of in parts:
        if len(parts) + len(known) > 2 and not (args.json or args.quiet):
            print_lines([f"{_name(part)}: {len(part)} new rows, laws of {_name(law_of)} ({len(law_of)} rows)."])
        judged, left, held = _verdicts(part, law_of, args)
        holds = holds and held
        prefix = f"{_name(part)}, " if len(parts) > 1 else ""
        verdicts |= {f"{prefix}{name}": text for name, text in judged.items()}
        untested |= {f"{prefix}{name}": text for name, text in left.items()}
        if not args.json:
            print_lines(judged.values(), quiet=args.quiet)
            print_lines((f"{name} is not tested: {why}" for name, why in left.items()), quiet=args.quiet)
    if args.json:
        print_json("confirm", {"level": args.level, "verdicts": verdicts, "not_tested": untested})
    if not verdicts and args.quiet:
        complain("; ".join(f"{name} is not tested: {why}" for name, why in untested.items()))
    return 4 if not verdicts else 0 if holds else 5


def _laws(old: "Runs", args: argparse.Namespace) -> "tuple[tuple[LawFit, ...], tuple[Refused, ...]]":
    """The laws of the earlier tests, and those that cannot be fitted."""
    from .. import fit
    from ..core.errors import FitError
    from ..pipeline import FitOptions

    asked = FitOptions(laws=tuple(args.laws or ()), form=forms(args.form))
    laws, refused = fit.default_laws(old, laws=asked.laws, forms=asked.forms)
    if not laws:
        reasons = "; ".join(item.reason for item in refused)
        raise FitError(_of_data(reasons) or f"{args.data} contains no law to confirm.")
    return laws, refused


def _verdicts(new: "Runs", old: "Runs", args: argparse.Namespace) -> tuple[dict[str, str], dict[str, str], bool]:
    """Verdicts by response, reasons why others are not tested, and whether no law was found not to hold."""
    from .. import fit
    from ..core.errors import FitError, UsageError

    laws, refused = _laws(old, args)
    verdicts: dict[str, str] = {}
    untested, holds = {item.response: _of_data(item.reason) for item in refused}, True
    for law in laws:
        try:
            found = fit.confirm(law, new, args.level)
        except (FitError, UsageError) as reason:
            untested[law.response] = str(reason)
        else:
            verdicts[law.response] = found.verdict + _other_conditions(new, old, law.factors)
            holds = holds and found.holds is not False
    return verdicts, untested, holds


def _other_conditions(new: "Runs", old: "Runs", factors: "Collection[str]") -> str:
    """Sentence on conditions that were one value in all earlier tests and another in new ones; else empty."""
    from ..fit.defaults import SETTINGS

    said: list[str] = []
    for role in (*SETTINGS, "kappa"):
        if role != "D" and role not in factors and new.has(role) and old.has(role):
            said += _other_value(role, new, old)
    if not said:
        return ""
    return f" {', and '.join(said)} in all tests of the law, which does not describe this influence."


def _other_value(role: str, new: "Runs", old: "Runs") -> list[str]:
    """Words on a condition that is one value in all earlier tests and another in new ones; none otherwise."""
    import numpy as np

    before, now = old.values(role), new.values(role)
    tested, unit = float(np.nanmean(before)), old.units.get(role, "")
    differ = np.abs(now - tested) > AGREE * abs(tested)
    if np.nanmax(np.abs(before - tested)) > AGREE * abs(tested) or not differ.any():
        return []
    low, high = (f"{end:.4g}" for end in (np.nanmin(now[differ]), np.nanmax(now[differ])))
    shown = low if low == high else f"{low} to {high}"
    return [f"{role} is {shown} here and {tested:.4g} {unit if unit != '1' else ''}".rstrip()]


def _name(runs: "Runs") -> str:
    return f"{runs.tool} on {runs.work}"


def _same_pair(new: "Runs", known: "tuple[Runs, ...]", args: argparse.Namespace) -> "Runs":
    """The earlier runs of the tool and work material of new ones; a name that is not stated agrees with any.

    Raises
    ------
    UsageError
        The earlier runs are of several pairs, and none or more than one of them agrees.
    """
    from ..core.errors import UsageError
    from ..datasets.vocabulary import UNNAMED

    def agree(old: "Runs") -> bool:
        names = ((getattr(new, role), getattr(old, role), unnamed) for role, unnamed in UNNAMED.items())
        return all(a == b or unnamed in (a, b) for a, b, unnamed in names)

    found = [old for old in known if agree(old)]
    exact = [old for old in found if (old.tool, old.work) == (new.tool, new.work)]
    if len(exact) == 1 or len(found) == 1:
        return (exact or found)[0]
    if len(known) == 1:
        complain(
            f"{args.file} is of {_name(new)}, and the laws are of {_name(known[0])} ({args.data}): the result "
            "shows whether the laws of the one hold for the other."
        )
        return known[0]
    names = ", ".join(map(_name, known))
    raise UsageError(
        f"{args.file} is of {_name(new)}, and {args.data} has tests of {names}: each pair has laws of its own. Name "
        "tool and work material of the new runs, in columns or with --tool and --work."
    )
