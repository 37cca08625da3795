"""``fitmodels publish``: the static site of many cards, or every reason why it cannot be published."""

import argparse
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.progress import progress_bar
from ..core.threads import cores
from .arguments import Parser, processes
from .output import print_json, print_lines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..cards.publishing import PublicationReport


def parser() -> Parser:
    """Arguments of ``fitmodels publish``."""
    p = Parser(
        "fitmodels publish",
        "fitmodels publish results/ --site site/",
        "Write a static site of all pairs in a folder: an index to search, a page that compares exponents,\n"
        "their cards, an Atom feed and cards.json. Refused, with exit code 5 and all reasons at once, where a\n"
        "required field is empty, a posterior failed its convergence checks or a parameter file fails its check;\n"
        "templates card.toml then list the missing fields: one in FOLDER for all pairs, one for each file.",
    )
    p.add_argument("folder", metavar="FOLDER", help="contains folders with params.json, at any depth")
    p.add_argument("--site", metavar="SITE", help="folder of the site")
    p.add_argument("--check", action="store_true", help="check only, and write no site")
    p.add_argument("--title", metavar="WORDS", help="title of the site and of its feed")
    p.add_argument("--force", action="store_true", help="replace another site that fitmodels wrote")
    p.add_argument("--json", action="store_true", help="print the report as JSON (fitmodels.publish/1)")
    p.add_argument("--jobs", metavar="N", type=processes, help="processes (default: one for each core)")
    return p


def run(args: argparse.Namespace) -> int:
    """Check, write, print the report, and return the exit code."""
    from ..cards import publishing

    if not (args.site or args.check):
        raise UsageError("--site: give the folder of the site, or check only, with --check.")
    if args.title is not None and not args.title.strip():
        raise UsageError("--title: is empty; leave it out, or give a title.")
    jobs = args.jobs or cores()
    with progress_bar(lines=False) as step:
        step.say("reading")
        if args.check:
            report = publishing.check(args.folder, args.site, jobs=jobs, progress=step.say)
        else:
            title = args.title or publishing.TITLE
            report = publishing.publish(
                args.folder, args.site, title=title, jobs=jobs, force=args.force, progress=step.say
            )
    if args.json:
        print_json("publish", report.facts())
    else:
        print_lines(_lines(report))
    return 0 if report.ok else 5


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
        yield f"{pairs}, ready to publish."
    elif report.unchanged:
        yield f"{report.site}: unchanged, {pairs}"
    else:
        yield f"wrote {report.site}/index.html, {pairs}"
