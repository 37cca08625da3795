"""``fitmodels next``: further tests for the design of a file, as CSV with a run order, and what they narrow."""

import argparse
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.arrays import Array
from ..datasets.vocabulary import FLANK_WEAR, USUAL_CRITERION
from .arguments import Parser, seed
from .numbers import criterion, values
from .options import one_pair, reading_options
from .output import output_options
from .plan import for_machine, same_in_all, write_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import pandas as pd

    from ..datasets import Runs
    from ..fit import LawFit
    from ..fit.decisions import Decision

ROUNDED = 5e-3  # relative: conditions of a decision, in three digits, are those of a test
TIMES_LONGER = 3.0  # longest of further tests over the longest so far, unless given
WRONG = ("collinearity", "longest lives", "copies", "sensor limit", "reading", "time restarts")  # no advice to stop
DELTA = (
    "These intervals are by the delta method, in which tests add up; those of the first screen and of predict are by "
    "the theorem of Fieller and reach higher where the exponent of time is uncertain: decide by those."
)


def parser() -> Parser:
    """Arguments of ``fitmodels next``."""
    p = Parser(
        "fitmodels next",
        "fitmodels next data.csv --runs 4 --out next.csv",
        "Plan further tests: repeats where no setting was repeated, else the settings that are most informative for\n"
        "the law (D-optimal); longer tests where tool life is extrapolated; or those that narrow the interval of a\n"
        "decision most. States what they are expected to narrow and when to stop. Without --out the plan is printed.",
        main="--runs --law --decision --at --cost --criterion --within --longest --out --force --quiet --json "
        "--map --unit",
    )
    p.add_argument("file", metavar="FILE", help="table of the tests so far")
    p.add_argument("--runs", type=int, default=4, metavar="N", help="number of edges to add (default: 4)")
    p.add_argument("--law", metavar="AW", help="response of the law to improve (default: the wear law)")
    p.add_argument(
        "--decision", metavar="life",
        help="what is decided: life, cost, or a limit such as P=7kW (default: life, of a law of wear or of T)",
    )  # fmt: skip
    p.add_argument("--at", action="append", metavar="V=120", help="condition of the decision (default: the middle)")
    p.add_argument("--vary", metavar="V", help="factor of which a limit is found (default: f, or the first of the law)")
    p.add_argument(
        "--cost",
        metavar="Cm=0.5,Ct=3,tc=2",
        help="cost per minute, of an edge, and minutes of its change (default: none)",
    )
    p.add_argument("--criterion", type=criterion, metavar="MM", help="wear at the end of tool life (default: 0.3)")
    p.add_argument(
        "--within", type=float, metavar="15", help="half width of the interval asked for, per cent (default: none)"
    )
    p.add_argument(
        "--longest", type=float, metavar="MIN",
        help="longest test (default: the longest so far; 3 times that where life is extrapolated)",
    )  # fmt: skip
    p.add_argument("--seed", type=seed, default=1, metavar="N", help="seed of the run order (default: 1)")
    p.add_argument("--out", metavar="PLAN", help="file to write (default: none, the plan is printed)")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the plan and its notes as JSON (fitmodels.plan/1)")
    reading_options(p)
    return p


def run(args: argparse.Namespace) -> int:
    """Write the plan, and return the exit code."""
    from ..fit import next_runs
    from ..fit.next_tests import trials, varying_together
    from ..fit.optimal_tests import narrowing

    _check(args)
    runs = one_pair(args)
    law, wear, laws = _law(runs, args)
    decision, why = _decision(law, args)
    left_out = _left_out(law, runs)
    cut = trials(law, left_out)
    together = varying_together(cut)
    separating = bool(together) and args.decision is None
    extrapolated = decision is not None and args.decision in (None, "life") and "times the longest" in decision.beyond
    extrapolated &= not separating
    longest = _longest(law, args, extrapolated)
    candidates = _reaching(law, args, decision, longest) if cut.names and decision and extrapolated else None
    direct = decision if cut.names and (args.decision is not None or extrapolated) else None
    ends = partial(_minutes, wear, args, longest=longest, least=_least(law, wear, args, longest, separating))
    plan = next_runs(
        law, args.runs, candidates=candidates, decision=direct, durations=ends, longest=args.longest,
        left_out=left_out if separating else None, seed=args.seed,
    )  # fmt: skip
    units, readings = dict(plan.attrs["units"]), plan.attrs["readings"]
    statistics = plan.attrs["words"]
    if "t" in law.factors:
        plan["t"], units["t"] = [test["t"][-1] for test in readings], law.units.get("t", "")
    of = f" of {runs.tool} on {runs.work}" if {"tool", "work"} & set(runs.data) else ""
    minutes = f", {plan['t'].sum():.4g} min in cut" if "t" in plan else ""
    what = f"{len(plan)} more {'edges' if law.edge is not None else 'tests'}{minutes}"
    notes = [f"plan: {what}, for the law of {law.response}{of}; cut in the order of run."]
    of_law, unsound = _rests_on(law, runs, laws)
    notes += of_law
    notes += _together(together, left_out, plan if separating else None) + _constant(law, runs, bool(cut.names))
    if decision is not None:
        within = None if args.within is None else args.within / 100
        notes += narrowing(law, decision, readings, within, unsound).words
    notes += [f"No interval of a decision: {why}"] if why else []
    notes += _how_long(wear, args, longest, extrapolated, plan, readings) if "t" in law.factors else []
    notes.append(f"Statistics: {statistics}")
    notes += [DELTA] if decision is not None and decision.name.startswith("tool life to") else []
    plan.attrs = {"units": {name: unit for name, unit in units.items() if unit}}
    write_table(for_machine(plan, runs), args, notes)
    return 0


def _left_out(law: "LawFit", runs: "Runs") -> dict[str, Array]:
    """Settings of the machine that the law left out since they follow others, in its rows; none that changes in a test.

    Those of a file whose lines do not name its rows, and of a law of second order, are not known.
    """
    from ..fit.checks.strata import rows_in
    from ..fit.edges import changes_within
    from ..fit.region import SETTABLE

    names = [one.factor for one in law.left_out if one.confounded and one.factor in SETTABLE]
    rows = rows_in(law, runs) if names and law.formula.first_order else None
    if rows is None:
        return {}
    found = {name: runs.values(name)[rows] for name in names}
    edge = np.arange(law.nobs) if law.edge is None else np.unique(law.edge, return_inverse=True)[1]
    return {name: x for name, x in found.items() if not changes_within(x[:, None], edge)[0]}


def _together(together: "Sequence[str]", left_out: "Iterable[str]", plan: "pd.DataFrame | None") -> list[str]:
    """What a plan does about factors that varied together, and which of its tests are of a new combination.

    ``plan`` is None where another decision was asked for.
    """
    if not together:
        return []
    head = f"{', '.join(together)} varied together in the tests so far, so that their exponents cannot be separated"
    if plan is None:
        missing = ", ".join(left_out)
        followed = (
            f" It does not set {missing}: set it as in the tests, where it followed the others." if missing else ""
        )
        return [f"{head}, nor by this plan: without --decision the tests separate them.{followed}"]
    new = plan.loc[plan["point"] == "new", "edge"]
    outside = (
        f"Outside of the tested combinations: {', '.join(new)}. Each value lies in its tested range, and chip section "
        "and removal rate are no larger than in a test; but begin with one short cut there."
    )
    return [f"{head}: these tests vary them independently.", *([outside] if len(new) else [])]


def _rests_on(law: "LawFit", runs: "Runs", laws: int) -> tuple[list[str], str]:
    """The verdict on the law that a plan rests on; and why it gives no advice to stop, empty where it may.

    A law that must not be used gives none, nor one of factors that vary together or of rows that may be wrong.
    """
    from ..core.verdict import DO_NOT_USE
    from ..fit import judge
    from ..fit.checks.check import Check

    judged = judge(law, runs=runs, laws=laws)
    verdict = judged.verdict
    found = {name: check for name, check in judged.checks.items() if isinstance(check, Check) and check.concern}
    if not verdict.level:
        return [], ""
    from ..cards.content.verdicts import SHORT  # half of the time of this command

    order = sorted(found, key=lambda name: -found[name].concern)
    short = ("few edges" if found[name].verdict.startswith("Only") else SHORT.get(name, name) for name in order)
    findings = ", ".join(dict.fromkeys(short))
    notes = [f"This plan rests on the law of {law.response}: {verdict.words}{f' ({findings})' if findings else ''}."]
    if "unused columns" in found:
        notes.append(f"A column that the plan does not set: {found['unused columns'].verdict}")
    wrong = [check.verdict for name, check in found.items() if check.suspects or name in WRONG]
    why = verdict.reasons[0] if verdict.level == DO_NOT_USE else wrong[0] if wrong else ""
    return notes, f"No advice on when to stop, since the law is in doubt. {why}" if why else ""


def _constant(law: "LawFit", runs: "Runs", varied: bool) -> list[str]:
    """Settings of the law that were the same in all tests; what to do where ``varied`` is False, since all were."""
    from ..fit.region import SETTABLE

    names = [one.factor for one in law.left_out if not one.confounded and one.factor in SETTABLE]
    known = same_in_all(runs, names)
    if not known:
        return []
    at = ", ".join(f"{name} {value:g} {runs.units.get(name, '')}".rstrip() for name, value in known.items())
    if varied:
        return [f"The same in all tests so far and in this plan, so that the law has no effect of it: {at}."]
    ranges = " ".join(f"--range {name}=LOW:HIGH" for name in known)
    return [
        f"All tests so far are at one setting ({at}), which this plan repeats: it narrows the law at this setting "
        f"alone. For a law of {', '.join(known)} give ranges: fitmodels plan {ranges}"
    ]


def _least(law: "LawFit", wear: "LawFit | None", args: argparse.Namespace, longest: float, separating: bool) -> float:
    """Least minutes of a test: a law that cannot separate its factors gives no life where they do not follow others.

    The life there is no shorter than at the settings tested, of which one loads the edge at least as much.
    """
    from ..fit.next_tests import candidate_settings

    return float(_minutes(wear, args, candidate_settings(law), longest).min()) if separating else 0.0


def _how_long(
    wear: "LawFit | None", args: argparse.Namespace, longest: float, extrapolated: bool, plan: "pd.DataFrame",
    readings: "Sequence[Mapping[str, list[Any]]]",
) -> list[str]:  # fmt: skip
    """When the edges end and are measured; ``longest`` test in min."""
    notes = []
    if wear is not None and extrapolated:
        notes.append(f"Tool life is extrapolated: {_until(wear, args, longest, plan)}")
    elif wear is not None and any(test["t"][-1] < longest for test in readings):
        notes.append(f"Tests last until the wear criterion by the law of {wear.response}, at most {longest:.3g} min.")
    notes.append("Stop an edge that reaches the wear criterion before its time.")
    if len(readings[0]["t"]) > 1:
        notes.append(f"{len(readings[0]['t'])} readings of each edge, as so far, at equal steps of its time t.")
    return notes


def _until(wear: "LawFit", args: argparse.Namespace, longest: float, plan: "pd.DataFrame") -> str:
    """How many tests of a plan for an extrapolated life reach the criterion by the law, and what lets more reach it."""
    from ..fit.next_tests import candidate_settings

    count = int((_minutes(wear, args, plan, np.inf) <= longest).sum())
    if count:
        return (
            f"these tests last until the criterion, at most {longest:.3g} min ({count} of {len(plan)} reach it by the "
            "law); they are at the conditions of the decision, or where the law expects the criterion to be reached in "
            "this time."
        )
    least = float(_minutes(wear, args, candidate_settings(wear), np.inf).min())
    harder = "at higher speeds" if "V" in wear.factors else "at conditions of a shorter life"
    return (
        f"by the law none of these tests reaches the criterion in the longest time, {longest:.3g} min; the shortest "
        f"life in the tested region is {least:g} min. Test {harder}, or run edges longer: --longest {least:g}."
    )


def _law(runs: "Runs", args: argparse.Namespace) -> "tuple[LawFit, LawFit | None, int]":
    """The law asked for by its response, text or limit, else the first; that of wear for lives; the number of all."""
    from ..core.errors import FitError, UsageError
    from ..fit import default_laws

    laws, refused = default_laws(runs, laws=[args.law] if "~" in (args.law or "") else [])
    name = (args.law or "").partition("~")[0].strip() or _limited(args.decision)[0]
    chosen = [law for law in laws if name in ("", law.response)]
    if chosen:
        of_wear = (law for law in (chosen[0], *laws) if law.response in FLANK_WEAR and "t" in law.factors)
        return chosen[0], next(of_wear, None), len(laws)
    known = ", ".join(law.response for law in laws)
    if known:
        asked = f"--law {name}" if args.law else f"--decision {args.decision}"
        raise UsageError(f"{asked}: there are laws of {known}.")
    raise FitError("; ".join(item.reason for item in refused) or f"{args.file} contains no law to add runs to.")


def _check(args: argparse.Namespace) -> None:
    from ..core.arrays import is_positive
    from ..core.errors import UsageError
    from ..fit.next_tests import MOST

    for name in ("criterion", "within", "longest"):
        value = getattr(args, name)
        if not is_positive(1.0 if value is None else value):
            raise UsageError(f"--{name} {value:g}: give a number above zero.")
    if not 1 <= args.runs <= MOST:
        raise UsageError(f"--runs {args.runs}: give a number of tests from 1 to {MOST}.")
    _check_decision(args)


def _check_decision(args: argparse.Namespace) -> None:
    from ..core.errors import UsageError

    if args.decision == "cost" and args.cost is None:
        raise UsageError("--decision cost: give the costs, for instance --cost Cm=0.5,Ct=3,tc=2.")
    if args.decision is not None and args.decision not in ("life", "cost") and "=" not in args.decision:
        raise UsageError(f"--decision {args.decision}: it is life, cost, or a limit such as P=7kW.")


def _limited(decision: str | None) -> tuple[str, str]:
    """Response and number of a limit; empty of another decision."""
    name, equals, text = (decision or "").partition("=")
    return (name.strip(), text.strip()) if equals else ("", "")


def _decision(law: "LawFit", args: argparse.Namespace) -> "tuple[Decision | None, str]":
    """The decision asked for; that of tool life, or none with the reason, where none is asked for."""
    from ..fit.decisions import cost_decision, life_decision, limit_decision

    at = values(args.at, "--at")
    criterion = USUAL_CRITERION if args.criterion is None else args.criterion
    if args.decision == "cost":
        return cost_decision(law, values(args.cost.split(","), "--cost"), criterion, at), ""
    if args.decision == "life":
        return life_decision(law, criterion, at), ""
    response, text = _limited(args.decision)
    if response:
        factor = args.vary or ("f" if "f" in law.factors else law.factors[0])
        return limit_decision(law, _in_unit(text, response, law.units[response]), factor, at), ""
    return _decision_on_life(law, criterion, at)


def _decision_on_life(law: "LawFit", criterion: float, at: dict[str, float]) -> "tuple[Decision | None, str]":
    """The decision on tool life, or none with the reason."""
    from ..core.errors import FitError
    from ..fit.decisions import life_decision

    if law.response not in ("T", *FLANK_WEAR):
        return None, f"give --decision {law.response}=LIMIT for that of a limit."
    try:
        return life_decision(law, criterion, at), ""
    except FitError as error:
        return None, str(error)


def _in_unit(text: str, name: str, unit: str) -> float:
    """A limit in the unit of the law."""
    from ..core.errors import UsageError
    from ..datasets.units import canonical, convert, same_dimension
    from .conditions import VALUE

    found = VALUE.fullmatch(text)
    given = canonical(found[2]) if found and found[2] else unit
    if found is None or given is None or (given != unit and not same_dimension(given, unit)):
        raise UsageError(f"--decision {name}={text}: give a number in {unit or 'its unit'}, or with its unit.")
    return float(convert(np.array(float(found[1])), given, unit)) if given != unit else float(found[1])


def _longest(law: "LawFit", args: argparse.Namespace, extrapolated: bool) -> float:
    if args.longest is not None:
        return float(args.longest)
    return law.domain["t"][1] * (TIMES_LONGER if extrapolated else 1.0) if "t" in law.factors else 0.0


def _reaching(law: "LawFit", args: argparse.Namespace, decision: "Decision", longest: float) -> "pd.DataFrame | None":
    """Settings at which the criterion is reached within the longest test, or next to it, and of the decision."""
    import pandas as pd

    from ..datasets.design import round_significant
    from ..fit.next_tests import TWICE, candidate_settings

    table = candidate_settings(law).drop_duplicates()
    lives = _minutes(law, args, table, np.inf)
    needed = max(-(-args.runs // TWICE) - bool((lives <= longest).any()), 1)  # besides that of the decision
    shortest: pd.DataFrame = table.loc[lives <= max(longest, np.sort(lives)[min(needed, len(lives)) - 1])]
    conditions = dict(decision.at)
    if not set(table.columns.astype(str)) <= set(conditions):  # rows without edges, each with a time of its own
        return None
    rounded = {name: round_significant(conditions[name], 4) for name in table.columns.astype(str)}
    own = pd.DataFrame([rounded], dtype=float)
    alike = (np.abs(table.to_numpy() / own.to_numpy() - 1) < ROUNDED).all(axis=1)
    near: pd.DataFrame = table.loc[alike].head(1)  # tested settings come first
    return pd.concat([near if len(near) else own, shortest], ignore_index=True)


def _minutes(
    wear: "LawFit | None", args: argparse.Namespace, table: "pd.DataFrame", longest: float, least: float = 0.0
) -> Array:
    """Minutes in cut of each setting: its life by the law of wear, to two digits, from the least to the longest.

    Factors that the table lacks are at the middle of the tests; without a life it is the longest.
    """
    from ..core.errors import FitError
    from ..datasets.design import round_significant
    from ..fit import tool_life

    try:
        if wear is None:
            return np.full(len(table), longest)
        life = tool_life(wear, USUAL_CRITERION if args.criterion is None else args.criterion)
    except FitError:  # of levels, or of wear that falls with time
        return np.full(len(table), longest)
    names = [str(name) for name in life.coefficients.index[1:]]
    given = table.assign(**{name: life.typical_at[name] for name in names if name not in table})
    lives = [life.values(dict(zip(names, row, strict=True))) for row in given[names].to_numpy(dtype=float).tolist()]
    return np.minimum(np.maximum(round_significant(np.array(lives), 2), least), longest)
