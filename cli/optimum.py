"""``fitmodels optimum``: settings of least cost per part and of greatest rate, and when to change an edge."""

import argparse
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from ..core.errors import GateError, UsageError
from ..core.journal import recover
from ..core.verdict import DO_NOT_USE
from .arguments import Parser, parameter_file
from .numbers import measured, values
from .options import further
from .output import output_options, print_json, print_lines

if TYPE_CHECKING:
    from ..controllers.economics.optimum import EconomicSettings, PricedSetting
    from ..parameters import ParameterFile


def parser() -> Parser:
    """Arguments of ``fitmodels optimum``."""
    p = Parser(
        "fitmodels optimum",
        "fitmodels optimum params.json --today V=145 --today f=0.3 --figure cost.png",
        "Print the cutting speed and feed of least cost per part and of greatest rate, within the limits of the\n"
        "file, which must hold for a worn edge; with intervals from the draws of the laws, and after which time to\n"
        "change an edge. The file needs costs (`fitmodels costs`) and a tool life.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json")
    p.add_argument("--depth", metavar="2.5mm", help="depth of cut (default: 2.5 mm, else that of the tests)")
    p.add_argument("--by", metavar="LEVEL", help="level of the category that shifts the laws (default: none)")
    p.add_argument(
        "--at",
        action="append",
        metavar="D=80mm",
        help="a further factor, or the diameter (default: none)",
    )
    p.add_argument(
        "--today", action="append", metavar="V=145", help="V (m/min) and f (mm/rev) to compare (default: none)"
    )
    p.add_argument("--level", type=float, default=0.95, metavar="P", help="of the intervals (default: 0.95)")
    p.add_argument(
        "--factors", choices=["published", "full"],
        help="whether power and force have their factors of time; published, as in AC-2017, leaves them out (default: "
        "full, except for the file of that paper)",
    )  # fmt: skip
    p.add_argument("--figure", metavar="FILE", help="write cost over speed as .png, .svg or .pdf (default: none)")
    p.add_argument("--force", action="store_true", help="replace an existing figure")
    p.add_argument(
        "--accept-verdict", action="store_true", help="calculate from laws that must not be used for control, too"
    )
    output_options(p, "print the result as JSON (fitmodels.optimum/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Print the settings, and return the exit code."""
    from .. import parameters
    from ..controllers.economics.optimum import economic_settings
    from ..parameters.checks.report import cautions

    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level:g}: give a number between 0 and 1, for instance 0.95.")
    target = _target(args.figure, args.force)
    pf = parameter_file(args.file)
    if pf.costs is None:
        raise UsageError(
            f"{args.file} has no costs; write them with fitmodels costs {quote(args.file)} machine=60/h edge=8 "
            "change=1.5min currency=EUR."
        )
    draws = parameters.read_draws(pf, Path(args.file).parent)
    depth = None if args.depth is None else measured(args.depth, "mm", "--depth", "2.5mm")
    found = economic_settings(
        pf, pf.costs, d=depth, by=args.by, at=further(args.at, pf), today=_today(values(args.today, "--today")),
        draws=draws, level=args.level, times=args.factors,
    )  # fmt: skip
    used = {found.source.law.response, *(limit.symbol for limit in found.limits)} & set(pf.laws)
    if not args.accept_verdict:
        _require_usable(pf, sorted(used), args.file)
    verdicts = cautions(pf, *used)
    if target is not None:
        _draw(found, target, force=args.force)
    if args.json:
        print_json("optimum", {"file": Path(args.file).name, **_facts(found), "verdicts": verdicts})
        return 0
    simulated = ["Not measured: the laws were fitted to a simulation."] if pf.identity.simulated else []
    written = [f"Written: {target}"] if target is not None else []
    print_lines([*verdicts, *_lines(found), *simulated, *written], quiet=args.quiet)
    return 0


def _require_usable(pf: "ParameterFile", laws: list[str], file: str) -> None:
    """Refuse laws whose verdict is against their use."""
    for name in laws:
        verdict = pf.laws[name].verdict
        if verdict is not None and verdict.concern == DO_NOT_USE:
            why = verdict.reasons[0] if verdict.reasons else ""
            raise GateError(
                f"{file}: the law of {name} must not be used for control, so no setting is calculated from it. {why} "
                "Correct the cause and fit again, or calculate all the same with --accept-verdict."
            )


def _lines(found: "EconomicSettings") -> list[str]:
    from ..controllers.economics.display import of_economic_settings

    shown = of_economic_settings(found)
    table = [shown.table.text(), ""] if shown.table is not None else []
    return [f"{shown.head[0].upper()}{shown.head[1:]}", "", *table, *shown.sentences]


def _target(figure: str | None, force: bool) -> Path | None:
    if figure is None:
        return None
    path = Path(figure)
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise UsageError(f"--figure {figure}: give a name that ends in .png, .svg or .pdf.")
    recover(path)
    if path.exists() and not force:
        raise UsageError(f"{figure} exists; replace it with --force.")
    return path


def _today(given: dict[str, float]) -> tuple[float, float] | None:
    if not given:
        return None
    if set(given) != {"V", "f"}:
        raise UsageError("--today: give both, as --today V=145 --today f=0.3.")
    return given["V"], given["f"]


def _draw(found: "EconomicSettings", path: Path, *, force: bool) -> None:
    from io import BytesIO

    from ..core.files import write_whole
    from ..core.plotting import save_figure

    held = BytesIO()
    save_figure(found.plot().figure, held, format=path.suffix[1:].lower(), dpi=160)
    write_whole(path, held.getvalue(), force=force)


def _facts(found: "EconomicSettings") -> dict[str, Any]:
    change = found.change
    return {
        "of": found.costs.of,
        "currency": found.costs.currency,
        "d_mm": found.setting.d,
        "life": found.source.words,
        "least_cost": _setting(found.least_cost),
        "greatest_rate": _setting(found.greatest_rate),
        "least_cost_within_tests": None if found.tested is None else _setting(found.tested),
        "today": None if found.today is None else _setting(found.today),
        "saving": None
        if found.saving is None
        else list(found.saving)
        if found.draws
        else [found.saving[0], None, None],
        "not_knowing": found.not_knowing,
        "change_after_min": None if change is None or not change.planned_change else change.time,
        "fail_before": None if change is None else change.failed,
        "level": found.level,
        "draws": found.draws,
        "notes": list(found.notes),
    }


def _setting(of: "PricedSetting") -> dict[str, Any]:
    return {
        "V_m_min": of.V,
        "f_mm_rev": of.f,
        "life_min": of.life,
        "time_min": of.time,
        "cost": of.cost,
        "parts": dict(of.parts),
        "parts_per_edge": of.per_edge,
        "held_by": list(of.held_by),
        "exceeds": list(of.exceeds),
        "outside_tests": list(of.beyond),
        "intervals": {name: list(band) for name, band in of.bands.items()},
    }
