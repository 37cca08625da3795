"""``fitmodels check``: whether a parameter file is consistent, and its control safe in simulation."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.rounding import count
from .arguments import Parser
from .output import output_options, print_json, print_lines

if TYPE_CHECKING:
    from ..parameters.checks.report import FileFinding

MARKS = {True: "ok    ", False: "FAIL  ", None: "note  "}
DOUBT = "doubt "


def parser() -> Parser:
    """Arguments of ``fitmodels check``."""
    p = Parser(
        "fitmodels check",
        "fitmodels check data-fit/GC435_709M40-En-19/params.json",
        "Check a parameter file before a controller uses it: checksum, verdicts of laws and dynamics, doubts about\n"
        "the data, units, covariances, draws, stability, gains against their specification, feed limits, windows.\n"
        "Where the file has gains and settings of constant load, the control that an export would write is simulated\n"
        "on its load law and dynamics, from a sharp to a worn tool and under faults of the sensor; so are constant\n"
        "roughness and adaptive force control on the cut of their sections.\n"
        "Exit code 0, or 5 where a check fails; a doubt or a reservation is shown and does not fail the file.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json; the draws are expected in the same folder")
    output_options(p, "print the findings as JSON (fitmodels.check/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Print a line for each finding, and return the exit code."""
    from .. import controllers, parameters
    from ..controllers.gate.adaptive_force import check_adaptive_force
    from ..controllers.gate.roughness import check_roughness
    from ..parameters.checks.report import CheckReport

    pf = parameters.read(args.file)
    of_file, of_control = parameters.check(pf, Path(args.file).parent), controllers.check_control(pf)
    of_force = () if of_file.inconsistent else (*check_roughness(pf), *check_adaptive_force(pf))
    report = CheckReport((*of_file.findings, *of_control.findings, *of_force))
    if args.json:
        print_json("check", {"file": Path(args.file).name, **report.facts()})
    else:
        last = "all checks passed" if report.ok else f"{len(report.failed)} failed"
        shown = report.failed if args.quiet else report.findings
        lines = [_mark(finding) + finding.words for finding in shown]
        print_lines([*lines, *([] if args.quiet else [f"{count(len(report.findings), 'finding')}, {last}."])])
    return 0 if report.ok else 5


def _mark(finding: "FileFinding") -> str:
    """Word before a finding: ok, FAIL, note or doubt."""
    return DOUBT if finding.name == "doubt" else MARKS[finding.passed]
