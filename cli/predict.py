"""``fitmodels predict``: predictions of the laws of a parameter file, and whether they extrapolate."""

import argparse
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import FitmodelsError, ParameterError, UsageError
from ..datasets.vocabulary import FLANK_WEAR
from .arguments import Parser, parameter_file
from .conditions import VALUE, Value, criterion_of, in_unit, known_level, meant, typed_conditions
from .numbers import pairs
from .output import output_options, print_json, print_lines

if TYPE_CHECKING:
    from ..core.predictions import Prediction
    from ..parameters import LawSection, ParameterFile
    from ..parameters.budget import UncertaintyBudget
    from ..parameters.evaluation import IntervalOptions
    from ..parameters.sections.law_parts import Factor, ToolLifeSection


class _Parser(Parser):
    """Conditions and options in any order."""

    def parse_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        if {"-h", "--help", "--help-all"} & {*(args or ())}:  # intermixed parsing hides arguments from the help
            return super().parse_args(args, namespace)
        return self.parse_intermixed_args(args, namespace)


def parser() -> Parser:
    """Arguments of ``fitmodels predict``."""
    p = _Parser(
        "fitmodels predict",
        "fitmodels predict data-fit/GC435_709M40-En-19/params.json V=120 f=0.2 d=2 t=8",
        "Predict with each law of PARAMS at these conditions, with an interval, and whether they are in the tested\n"
        "region. A law on wear takes AW as given, or from the wear law at these conditions.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument(
        "at", metavar="V=120", nargs="*",
        help="a condition, by symbol or by its header in the fitted file (vc=120), with its unit if it differs: "
        "V=400ft/min; or a response to predict, T for the tool life",
    )  # fmt: skip
    p.add_argument("--law", metavar="AW", help="response to predict (default: all)")
    p.add_argument(
        "--interval", choices=["mean", "prediction", "tolerance"], default="prediction",
        help="of the law, of one new row (default), or of a share of all rows",
    )  # fmt: skip
    p.add_argument(
        "--level", type=float, default=0.95, metavar="LEVEL", help="confidence of the interval (default: 0.95)"
    )
    p.add_argument(
        "--coverage", type=float, default=0.95, metavar="SHARE", help="share of rows in a tolerance interval"
    )
    p.add_argument(
        "--by",
        metavar="LEVEL",
        help="level of the category that shifts the laws (default: none; asked for where a law has one)",
    )
    p.add_argument("--budget", action="store_true", help="print the uncertainty budget of each prediction (GUM)")
    p.add_argument(
        "--u", action="append", metavar="V=1.5",
        help="standard uncertainty of a setting, for the budget: 1.5, 1.5m/min, 1%%, or a tolerance +-3 "
        "(default: exact)",
    )  # fmt: skip
    p.add_argument(
        "--gauge",
        action="append",
        metavar="AW=0.003",
        help="standard uncertainty of a gauge's calibration (default: 0)",
    )
    output_options(p, "print the same facts as JSON (fitmodels.prediction/2)")
    return p


def run(args: argparse.Namespace) -> int:
    """Print a sentence for each law, and return the exit code."""
    from ..parameters.checks.report import cautions
    from ..parameters.evaluation import IntervalOptions

    for option in ("level", "coverage"):
        if not 0 < getattr(args, option) < 1:
            raise UsageError(f"--{option} {getattr(args, option):g}: give a number between 0 and 1, for instance 0.95.")
    _budget_asked(args)
    pf = parameter_file(args.file)
    responses = [word for word in args.at if word in (*pf.laws, "T")]
    names = [*([] if args.law is None else [args.law]), *responses]
    given, remarks, beyond = typed_conditions(pf, [word for word in args.at if word not in responses])
    laws, life = _chosen(pf, names, given)
    _no_criterion(pf, laws if life and names else None, given)
    known_level(pf, args.by)
    asked = IntervalOptions(args.interval, args.level, "new", args.coverage)
    predictions: list[Prediction] = []
    failed: dict[str, FitmodelsError] = {}
    for law in laws:
        try:
            predictions.append(_predicted(pf, law, given, args.by, asked))
        except FitmodelsError as error:
            failed[law.response] = error
    if life:
        try:
            predictions.append(_life(pf, given, asked))
        except FitmodelsError as error:
            failed["T by the wear law"] = error
    if not predictions:
        raise next(iter(failed.values()))
    reasons = {name: str(reason) for name, reason in failed.items()}
    wears = [given.symbol for one in predictions for given in one.given if given.source is not None]
    solved = [pf.tool_life] if life and pf.tool_life is not None else []
    verdicts = cautions(pf, *(one.response for one in predictions), *wears, *(one.wear for one in solved))
    verdicts += [_life_caution(one) for one in solved if one.verdict is not None and one.verdict.reasons]
    budgets, without = _budgets(pf, predictions[: len(predictions) - life], args)
    if beyond:
        predictions = [replace(one, inside=False, given=(*one.given, *beyond)) for one in predictions]
    of_cut = _of_cut(laws, failed)
    if args.json:
        more = {"budgets": [budget.facts() for budget in budgets], "no_budget": without} if args.budget else {}
        report = {
            **_report(pf, args.file, predictions, reasons),
            **more,
            "verdicts": verdicts,
            "remarks": [*remarks, *of_cut],
        }
        print_json("prediction", report, version=2)
        return 0
    lines = [*remarks, *(prediction.words for prediction in predictions), *of_cut]
    lines += [line for budget in budgets for line in _budget_lines(budget)]
    lines += [f"{name} is not predicted: {reason}" for name, reason in reasons.items()]
    lines += [f"{name} has no uncertainty budget: {reason}" for name, reason in without.items()]
    simulated = ["Not measured: the laws were fitted to a simulation."] if pf.identity.simulated else []
    doubts = [] if pf.reading is None else [f"Doubt about the data: {one.sentence}" for one in pf.reading.doubts]
    print_lines(verdicts + lines + simulated + doubts, quiet=args.quiet)
    return 0


def _of_cut(laws: "Sequence[LawSection]", failed: Collection[str]) -> list[str]:
    """A sentence on a predicted power that is that of the cut."""
    return [f"{law.of_cut}." for law in laws if law.of_cut and law.response not in failed]


def _no_criterion(pf: "ParameterFile", laws: "Sequence[LawSection] | None", given: Mapping[str, Value]) -> None:
    """Refuse the wear of a tool life that was asked for as a condition, unless a law next to it depends on it."""
    wear = "" if pf.tool_life is None else pf.tool_life.wear
    if laws is not None and wear in given and not any(f.symbol == wear for law in laws for f in law.factors):
        raise UsageError(f"{given[wear].text}: {wear} is no condition of the tool life. {criterion_of(pf, wear)}")


def _life_caution(life: "ToolLifeSection") -> str:
    """The verdict on a tool life with its reasons but that on its wear law, which is printed before it."""
    level, reasons = (life.verdict.level, life.verdict.reasons) if life.verdict is not None else ("", ())
    own = [reason for reason in reasons if not reason.startswith(f"Verdict on the law of {life.wear}:")]
    return " ".join([f"Verdict on the tool life to {life.wear} {life.criterion:g} {life.unit_of_wear}: {level}.", *own])


def _report(
    pf: "ParameterFile", file: str, predictions: "Sequence[Prediction]", reasons: Mapping[str, str]
) -> dict[str, object]:
    return {
        "file": Path(file).name,
        "tool": pf.identity.tool,
        "work": pf.identity.work,
        "simulated": pf.identity.simulated,
        "predictions": [prediction.facts() for prediction in predictions],
        "not_predicted": [{"response": name, "reason": reason} for name, reason in reasons.items()],
    }


def _budget_asked(args: argparse.Namespace) -> None:
    """Refuse options of a budget without it, and a budget of a tolerance interval."""
    if not args.budget and (args.u or args.gauge):
        raise UsageError("--u and --gauge belong to an uncertainty budget: add --budget.")
    if args.budget and args.interval == "tolerance":
        raise UsageError("--budget: a budget is of --interval mean or prediction; a tolerance interval has none.")


def _budgets(
    pf: "ParameterFile", predictions: "Sequence[Prediction]", args: argparse.Namespace
) -> "tuple[list[UncertaintyBudget], dict[str, str]]":
    """Budgets of predictions, and the reasons of those that have none, by response; nothing unless asked for."""
    budgets: list[UncertaintyBudget] = []
    without: dict[str, str] = {}
    for one in predictions if args.budget else ():
        try:
            budgets.append(_budget(pf, one, args))
        except ParameterError as error:
            without[one.response] = str(error)
    return budgets, without


def _budget(pf: "ParameterFile", found: "Prediction", args: argparse.Namespace) -> "UncertaintyBudget":
    """The budget of a prediction; a factor from its own law comes with the budget of that."""
    from ..parameters.budget import uncertainty_budget

    law = pf.laws[found.response]
    sources = {given.symbol: _budget(pf, given.source, args) for given in found.given if given.source is not None}
    values = {given.symbol: float(given.value) for given in found.given}
    factors = {f.symbol: f for one in (*(pf.laws[name] for name in sources), law) for f in one.factors}
    reached = {**values, **{name: value for source in sources.values() for name, value in source.at.items()}}
    u = {
        name: _standard_uncertainty(text, factors[name], reached[name])
        for name, text in _settings_asked(pf, args).items()
        if name in factors and name not in sources
    }
    gauge = pairs(args.gauge, "--gauge", "AW=0.003").get(law.response)
    return uncertainty_budget(
        law, values, kind="mean" if args.interval == "mean" else "prediction", level=args.level,
        by=None if law.by is None else args.by, u=u, sources=sources,
        gauge=0.0 if gauge is None else _of_unit(gauge, law.response, law.unit, "--gauge"),
    )  # fmt: skip


def _settings_asked(pf: "ParameterFile", args: argparse.Namespace) -> dict[str, str]:
    """Uncertainties of settings as written; the names of settings and gauges are those of the file."""
    asked = pairs(args.u, "--u", "V=1.5")
    used = {f.symbol for one in pf.laws.values() for f in one.factors}
    for name in asked:
        if name not in used:
            raise UsageError(f"--u {name}: no law of the file has this factor; they have {', '.join(sorted(used))}.")
    for name in pairs(args.gauge, "--gauge", "AW=0.003"):
        if name not in pf.laws:
            raise UsageError(f"--gauge {name}: the file has laws of {', '.join(pf.laws)}.")
    return asked


def _budget_lines(budget: "UncertaintyBudget") -> list[str]:
    return ["", f"Uncertainty budget of {budget.response}", budget.table().text(), budget.words, *budget.notes]


def _standard_uncertainty(text: str, factor: "Factor", value: float) -> float:
    """Standard uncertainty of a setting: as given, of its value in per cent, or of a tolerance (rectangular)."""
    plain = text.removeprefix("±").removeprefix("+-")
    if plain.rstrip().endswith("%"):
        size = _of_unit(plain.rstrip()[:-1], factor.symbol, "", "--u") * value / 100
    else:
        size = _of_unit(plain, factor.symbol, factor.unit, "--u")
    return size / float(np.sqrt(3)) if plain != text else size


def _of_unit(text: str, name: str, unit: str, option: str) -> float:
    """A number of the command line in a unit."""
    from ..parameters.sections.law_parts import Factor

    found = VALUE.fullmatch(text.strip())
    if found is None or found[2].startswith(",") or float(found[1]) < 0:
        raise UsageError(
            f"{option} {name}={text}: give a number of zero or more, and a unit if it differs from {unit}."
        )
    value = Value(float(found[1]), found[2], f"{option} {name}={text}")
    return in_unit(value, Factor(symbol=name, quantity="", unit=unit, low=0.0, high=0.0))


def _chosen(pf: "ParameterFile", names: Sequence[str], given: Mapping[str, Value]) -> "tuple[list[LawSection], bool]":
    """Laws to predict with, and whether the tool life is solved from the wear law.

    Without names it is where no time is given; the tool life is T, as the response of a law of lives is.
    """
    from ..cards.content.tool_life import no_tool_life

    life = pf.tool_life is not None and pf.tool_life.wear in pf.laws
    known = {**dict.fromkeys(pf.laws), **({"T": None} if life else {})}
    for name in names:
        if name not in known:
            why = f" {no_tool_life(pf)}" if name == "T" else ""
            raise UsageError(f"--law {name}: the file has laws of {', '.join(known)}{meant(name, known)}.{why}")
    if not names:
        return list(pf.laws.values()), life and "t" not in given
    return [pf.laws[name] for name in dict.fromkeys(names) if name in pf.laws], life and "T" in names


def _life(pf: "ParameterFile", given: Mapping[str, Value], asked: "IntervalOptions") -> "Prediction":
    """The tool life by inverting the wear law."""
    from ..parameters.prediction import predict_life

    life = pf.tool_life
    if life is None:
        raise UsageError("the file has no tool life; fit a wear law on t with --criterion.")
    law = pf.laws[life.wear]
    missing = [f for f in law.factors if f.symbol != "t" and f.symbol not in given]
    if missing:
        raise UsageError(f"the tool life needs {_needed(pf, missing, given)}.")
    factors = {f.symbol: in_unit(given[f.symbol], f) for f in law.factors if f.symbol != "t"}
    try:
        return predict_life(law, life, asked, factors)
    except ParameterError as reason:  # the request is wrong, not the file
        raise UsageError(str(reason)) from None


def _predicted(
    pf: "ParameterFile", law: "LawSection", given: Mapping[str, Value], by: str | None, asked: "IntervalOptions"
) -> "Prediction":
    """The prediction of one law, its wear from the file's wear law where it is not given."""
    from ..parameters.prediction import predict_with_interval

    level = by if law.by is not None else None
    if law.by is not None and by is None:
        levels = ", ".join([law.by.reference, *law.by.shifts])
        raise UsageError(f"the law of {law.response} is by {law.by.column}: give the level ({levels}) with --by.")
    lacking = {f.symbol: f for f in law.factors if f.symbol not in given}
    sources = {
        name: _predicted(pf, pf.laws[name], given, by, asked)
        for name in FLANK_WEAR
        if name in lacking and _gives(pf, lacking[name], given)
    }
    missing = [f for name, f in lacking.items() if name not in sources]
    if missing:
        needed = _needed(pf, missing, given)
        raise UsageError(f"the law of {law.response} needs {needed}.{_without_time(pf, law, missing)}")
    factors = {f.symbol: in_unit(given[f.symbol], f) for f in law.factors if f.symbol in given}
    try:
        law.values({**factors, **{name: source.value for name, source in sources.items()}}, by=level)
    except ParameterError as reason:  # the request is wrong, not the file
        raise UsageError(str(reason)) from None
    return predict_with_interval(law, asked, level, factors, sources)


def _without_time(pf: "ParameterFile", law: "LawSection", missing: "Sequence[Factor]") -> str:
    """Why no tool life is predicted where no time is given, after a space; empty where there is one."""
    from ..cards.content.tool_life import no_tool_life

    asked = law.response in FLANK_WEAR and "t" in {factor.symbol for factor in missing}
    return f" {no_tool_life(pf)}" if asked and pf.tool_life is None else ""


def _gives(pf: "ParameterFile", wear: "Factor", given: Mapping[str, Value]) -> bool:
    """Whether the file's law of this wear predicts it, in the same unit, from the given factors."""
    law = pf.laws.get(wear.symbol)
    return law is not None and law.unit == wear.unit and not _lacks(law, given)


def _lacks(law: "LawSection", given: Mapping[str, Value]) -> list[str]:
    return [f.symbol for f in law.factors if f.symbol not in given]


def _needed(pf: "ParameterFile", missing: "Sequence[Factor]", given: Mapping[str, Value]) -> str:
    """Factors that are missing, and those of the law that would predict wear."""
    symbols = [f.symbol for f in missing]
    from_law = {name: _lacks(pf.laws[name], given) for name in symbols if name in FLANK_WEAR and name in pf.laws}
    plain = [f for f in missing if f.symbol not in from_law]
    words = [_quantity(f) for f in plain]
    for f in missing:
        others = [name for name in from_law.get(f.symbol, ()) if name not in {g.symbol for g in plain}]
        if others:
            words.append(f"{_quantity(f)}, or {', '.join(others)} for its own law")
    return f"{', '.join(words)}; add for instance {' '.join(f'{f.symbol}={_middle(f):g}' for f in plain or missing)}"


def _quantity(factor: "Factor") -> str:
    return f"{factor.symbol} ({factor.quantity}{f', {factor.unit}' if factor.unit else ''})"


def _middle(factor: "Factor") -> float:
    """Centre of the tested range, in logarithms where possible, to two digits."""
    low, high = factor.low, factor.high
    return float(f"{np.sqrt(low * high) if low > 0 else (low + high) / 2:.2g}")
