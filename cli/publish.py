"""``fitmodels publish``: the static site of many cards, a model repository of one, or every reason against them."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.progress import progress_bar
from ..core.rounding import count
from ..core.threads import cores
from .arguments import Parser, processes, typed
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ..cards.publishing import PublicationReport
    from ..cards.publishing.hub import HubRepository
    from ..cards.publishing.upload import HubCommit

INCOMPATIBLE = {  # option -> those that it excludes, and why
    "to_hub": (("site", "title", "check", "draft"), "a model repository is no site"),
    "draft": (("check",), "--check writes nothing"),
}
FOR_HUB = ("push", "private", "data", "out")


def parser() -> Parser:
    """Arguments of ``fitmodels publish``."""
    p = Parser(
        "fitmodels publish",
        "fitmodels publish results/ --site site/ --draft",
        "Write a static site of all pairs in a folder: an index to search, a page that compares exponents,\n"
        "their cards, an Atom feed and cards.json; or write and upload one pair as a model repository of the\n"
        "Hugging Face hub. Refused, with exit code 5, all reasons and what to type into card.toml, where a required\n"
        "field is empty, a posterior failed its convergence checks or a parameter file fails its check.",
    )
    p.add_argument("folder", metavar="FOLDER", help="contains folders with params.json, at any depth")
    p.add_argument("--site", metavar="SITE", help="folder of the site (default: none is written)")
    p.add_argument("--draft", action="store_true", help="write the site in spite of gaps, marked on every page")
    p.add_argument("--check", action="store_true", help="check only, and write no site")
    p.add_argument(
        "--title", metavar="WORDS", help="title of the site and of its feed (default: Model cards of tools and ...)"
    )
    p.add_argument(
        "--to-hub",
        metavar="ORG/NAME",
        help="write the model repository, and show what would be uploaded (default: a site)",
    )
    p.add_argument("--push", action="store_true", help="upload the model repository, with the token of huggingface_hub")
    p.add_argument("--private", action="store_true", help="upload it to a private repository (default: public)")
    p.add_argument("--data", metavar="FILE", help="add the data file that was fitted (default: no data)")
    p.add_argument("--out", metavar="DIR", help="folder of the repository (default: NAME-hub)")
    p.add_argument("--force", action="store_true", help="replace another site or repository that fitmodels wrote")
    p.add_argument("--jobs", metavar="N", type=processes, help="processes (default: one for each core)")
    output_options(p, "print the report as JSON (fitmodels.publish/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Check, write, print the report, and return the exit code."""
    _check_options(args)
    return _run_hub(args) if args.to_hub else _run_site(args)


def _check_options(args: argparse.Namespace) -> None:
    for option, (excluded, why) in INCOMPATIBLE.items():
        for other in excluded:
            if getattr(args, option) and getattr(args, other):
                raise UsageError(f"--{other} with --{option.replace('_', '-')}: {why}; leave one of them out.")
    for option in FOR_HUB:
        if getattr(args, option) and not args.to_hub:
            raise UsageError(f"--{option}: belongs to a model repository; give its name with --to-hub ORG/NAME.")


def _check_site(args: argparse.Namespace) -> None:
    if not (args.site or args.check):
        raise UsageError("--site: give the folder of the site, or check only, with --check.")
    if args.title is not None and not args.title.strip():
        raise UsageError("--title: is empty; leave it out, or give a title.")


# --- site


def _run_site(args: argparse.Namespace) -> int:
    from ..cards import publishing

    _check_site(args)
    jobs = args.jobs or cores()
    with progress_bar(lines=False) as step:
        step.say("reading")
        if args.check:
            report = publishing.check(args.folder, args.site, jobs=jobs, progress=step.say)
        else:
            title = args.title or publishing.TITLE
            report = publishing.publish(
                args.folder, args.site, title=title, jobs=jobs, force=args.force, draft=args.draft, progress=step.say
            )
    if args.json:
        print_json("publish", report.facts())
    else:
        _show(report, args)
    return 0 if report.ok or (report.draft and report.site) else 5


def _show(report: "PublicationReport", args: argparse.Namespace) -> None:
    from rich.text import Text

    out = Printer(quiet=args.quiet)
    mark = "gaps in" if report.draft and report.site else "FAIL"
    for one in report.problems:
        words = f"{mark} {one.folder}: {one.words}"
        out.wrote(Text(words), words)
    for path in report.templates:
        out.wrote(Text(f"wrote {path}: fill it in"), path)
    for line in _to_type(report, args.folder):
        out.show(_line(line))
    index = [] if report.site is None or report.unchanged else [Path(report.site, "index.html")]
    for line in _closing(report, args):
        out.wrote(Text(line), *index) if line.startswith("wrote") else out.show(_line(line))


def _line(line: str) -> "RenderableType":
    """A line; one that begins with blanks is to be copied, and is not folded."""
    from rich.console import Group
    from rich.text import Text

    if line.startswith("  "):
        return Group(Text(line, no_wrap=True, overflow="ignore"))  # a bare Text loses these where it is printed
    return Text(line)


def _to_type(report: "PublicationReport", folder: str) -> "Iterator[str]":
    """The lines of card.toml that fill the gaps, with example values."""
    from ..cards.publishing.pair import TOML
    from ..cards.publishing.requirements import QUESTIONS

    lacking = {one.folder: one.fields for one in report.problems if one.fields}
    asked = [name for name in QUESTIONS if any(name in fields for fields in lacking.values())]
    if not asked:
        return
    shared = len(lacking) > 1 and report.templates == (Path(folder, TOML),)
    own = Path(folder, next(iter(lacking)), TOML) if len(lacking) == 1 else None
    where = str(own or report.templates[0]) if own or shared else f"the {TOML} of each"
    yield f"Type into {where}, with your values in place of these examples:"
    yield from (f"  {QUESTIONS[name].example}" for name in asked if not (shared and name == "iso513"))
    if shared and "iso513" in asked:  # belongs to the material of each pair
        yield f"Type into the {TOML} of each pair:"
        yield f"  {QUESTIONS['iso513'].example}"


def _closing(report: "PublicationReport", args: argparse.Namespace) -> "Iterator[str]":
    pairs = count(report.found, "pair")
    wrong = len({one.folder for one in report.problems})
    kind = "draft, " if report.draft else ""
    if report.problems and report.site is None:
        yield f"{wrong} of {pairs} cannot be published; no site was written."
        if not report.draft:
            yield "With the gaps marked:"
            yield f"  {typed(['publish', args.folder, '--site', args.site or 'site', '--draft'])}"
    elif report.site is None:
        from ..core.verdict import DO_NOT_USE, LEVELS

        barred = [f"{e.title} ({e.judged})" for e in report.cards if e.verdict == LEVELS[DO_NOT_USE]]
        yield f"{pairs}, ready to publish{'; not for control: ' if barred else ''}{', '.join(barred)}."
    elif report.unchanged:
        yield f"{report.site}: unchanged, {kind}{pairs}"
    else:
        yield f"wrote {report.site}/index.html, {kind}{pairs}{f', {wrong} with gaps' if wrong else ''}"


# --- model repository


def _run_hub(args: argparse.Namespace) -> int:
    from ..cards import publishing
    from ..cards.publishing import hub, upload

    hub.check_name(args.to_hub)
    report = publishing.check(args.folder)
    if not report.ok:
        print_json("publish", report.facts()) if args.json else _show(report, args)
        return 5
    repository = hub.hub_repository(Path(args.folder), args.to_hub, Path(args.data) if args.data else None)
    version = hub.validated(repository)
    out = Path(args.out or f"{args.to_hub.split('/')[1]}-hub")
    written = hub.write_repository(repository, out)
    if not args.json:
        _show_repository(repository, args, f"{'wrote' if written else 'unchanged:'} {out}", out, version)
    commit = upload.push(repository, private=args.private, force=args.force) if args.push else None
    if args.json:
        made = None if commit is None else commit.facts()
        place = {"endpoint": hub.endpoint(), "folder": str(out), "validated_by": version}
        print_json("hub", {**repository.facts(), **place, "commit": made})
    else:
        _show_commit(repository, commit, args)
    return 0


def _show_repository(
    repository: "HubRepository", args: argparse.Namespace, wrote: str, out: Path, version: str
) -> None:
    from rich.text import Text

    from ..cards.publishing.hub import INSTALL, endpoint

    printer = Printer(quiet=args.quiet)
    kind = "private" if args.private else "public"
    printer.show(Text(f"{repository.title}: {kind} model repository {args.to_hub} on {endpoint()}"))
    for path, size in repository.sizes.items():
        printer.show(Text(f"  {_size(size):>9}  {path}"))
    printer.show(Text(f"  {_size(sum(repository.sizes.values())):>9}  in {count(len(repository.files), 'file')}"))
    checked = f"valid for huggingface_hub {version}" if version else f"not checked; for a check: {INSTALL}"
    for line in (f"front matter: {checked}", *repository.remarks):
        printer.show(Text(line))
    for line in repository.obstacles:
        printer.show(Text(f"not to be uploaded: {line}"))
    printer.wrote(Text(wrote), out)


def _show_commit(repository: "HubRepository", commit: "HubCommit | None", args: argparse.Namespace) -> None:
    from rich.text import Text

    printer = Printer(quiet=args.quiet)
    if commit is None:
        for line in _not_uploaded(repository, args):
            printer.show(_line(line))
        return
    for line in (*(f"the hub remarks: {words}" for words in commit.remarks), *(f"removed {p}" for p in commit.removed)):
        printer.show(Text(line))
    done = "unchanged on the hub:" if commit.unchanged else "uploaded:"
    printer.wrote(Text(f"{done} {commit.url}"), commit.url)


def _not_uploaded(repository: "HubRepository", args: argparse.Namespace) -> "Iterator[str]":
    """Command of the upload, unless there are obstacles."""
    if repository.obstacles:
        yield "Nothing was uploaded."
        return
    flags = [f"--{name}" for name in ("private", "force") if getattr(args, name)]
    data = ["--data", args.data] if args.data else []
    yield "Nothing was uploaded. To upload:"
    yield f"  {typed(['publish', args.folder, '--to-hub', args.to_hub, *data, *flags, '--push'])}"


def _size(bytes_: int) -> str:
    """Size in kB.

    >>> _size(312_345)
    '312.3 kB'
    """
    return f"{bytes_ / 1000:.1f} kB"
