"""``fitmodels check``: whether a parameter file may be handed to a controller."""

import argparse
import json
from pathlib import Path

from .arguments import Parser
from .output import Printer

MARKS = {True: "ok   ", False: "FAIL ", None: "note "}


def parser() -> Parser:
    """Arguments of ``fitmodels check``."""
    p = Parser(
        "fitmodels check",
        "fitmodels check data-fit/GC435_709M40/params.json",
        "Check a parameter file before a controller gets it: checksum, units, covariances, draws, stability, gains\n"
        "against their specification, feed limits, windows. Exit code 0, or 5 where something stands against it.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json; the draws are looked for beside it")
    p.add_argument("--json", action="store_true", help="print the findings as JSON (fitmodels.check/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Print a line for each finding, and return the exit code."""
    from rich.text import Text

    from .. import parameters

    pf = parameters.read(args.file)
    report = parameters.check(pf, Path(args.file).parent)
    if args.json:
        facts = {"schema": "fitmodels.check/1", "file": Path(args.file).name, **report.facts()}
        print(json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False))  # noqa: T201
        return 0 if report.ok else 5
    out = Printer()
    for finding in report.findings:
        out.show(Text(MARKS[finding.passed] + finding.words))
    last = "nothing stands against this file" if report.ok else f"{len(report.failed)} of them against this file"
    out.show(Text(f"{len(report.findings)} findings, {last}."))
    return 0 if report.ok else 5
