"""``fitmodels publish``: the static site of many cards, or all that stands against it."""

import argparse
import json
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.progress import progress
from ..core.threads import cores
from .arguments import Parser, processes
from .output import Printer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..cards.publishing import PublicationReport


def parser() -> Parser:
    """Arguments of ``fitmodels publish``."""
    p = Parser(
        "fitmodels publish",
        "fitmodels publish results/ --site site/",
        "Write a static site of all pairs in a folder: an index to search, a page that compares exponents,\n"
        "a card each, an Atom feed and cards.json. Refused, with exit code 5 and all reasons at once, where a needed\n"
        "field is empty, the gate of a posterior is shut or a parameter file fails its check; what is missing is then\n"
        "asked for in a card.toml: one in FOLDER for what no pair tells, one beside each file for the rest.",
    )
    p.add_argument("folder", metavar="FOLDER", help="holds folders with params.json, at any depth")
    p.add_argument("--site", metavar="SITE", help="folder the site goes to")
    p.add_argument("--check", action="store_true", help="judge only, and write no site")
    p.add_argument("--title", metavar="WORDS", help="title of the site; its feed is known by it")
    p.add_argument("--force", action="store_true", help="replace another site that fitmodels wrote")
    p.add_argument("--json", action="store_true", help="print what came of it as JSON (fitmodels.publish/1)")
    p.add_argument("--jobs", metavar="N", type=processes, help="processes (default: one a core)")
    return p


def run(args: argparse.Namespace) -> int:
    """Judge, write, say what came of it, and return the exit code."""
    from ..cards import publishing

    if not (args.site or args.check):
        raise UsageError("--site: say where the site goes, or judge only, with --check.")
    if args.title is not None and not args.title.strip():
        raise UsageError("--title: is empty; leave it out, or give the site a name.")
    jobs = args.jobs or cores()
    with progress(lines=False) as told:
        told.say("reading")
        if args.check:
            report = publishing.check(args.folder, args.site, jobs=jobs, told=told.say)
        else:
            title = args.title or publishing.TITLE
            report = publishing.publish(args.folder, args.site, title=title, jobs=jobs, force=args.force, told=told.say)
    if args.json:
        print(json.dumps({"schema": "fitmodels.publish/1", **report.facts()}, indent=2, ensure_ascii=False))  # noqa: T201
    else:
        _say(report)
    return 0 if report.ok else 5


def _say(report: "PublicationReport") -> None:
    from rich.text import Text

    Printer().show(Text("\n".join(_lines(report))))


def _lines(report: "PublicationReport") -> "Iterator[str]":
    pairs = f"{report.found} pair{'s' if report.found != 1 else ''}"
    for one in report.problems:
        yield f"FAIL {one.folder}: {one.words}"
    for path in report.templates:
        yield f"wrote {path}: fill it in"
    if report.problems:
        wrong = len({one.folder for one in report.problems})
        yield f"{wrong} of {pairs} cannot be published; no site was written."
    elif report.site is None:
        yield f"{pairs}, and nothing stands against publishing."
    elif report.unchanged:
        yield f"{report.site}: unchanged, {pairs}"
    else:
        yield f"wrote {report.site}/index.html, {pairs}"
