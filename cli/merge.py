"""``fitmodels merge``: parameter files of one tool and work material joined into one, conflicts named."""

import argparse
import glob
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.bounded import contains
from ..core.errors import ParameterError, UsageError
from ..core.files import refuse_input
from ..core.folders import file_state
from ..core.journal import only_writer, recover, write_together
from ..core.rounding import count
from .arguments import Parser, inputs_of, parameter_file, traced
from .numbers import pairs
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.conflicts import MergeInput
    from ..parameters.merging import Merged

NAME = re.compile(r"[A-Za-z0-9][\w.-]{0,60}")  # of a file of draws


def parser() -> Parser:
    """Arguments of ``fitmodels merge``."""
    p = Parser(
        "fitmodels merge",
        "fitmodels merge load-fit/params.json wear-fit/params.json --out both.json",
        "Join parameter files of one tool and work material: laws, dynamics, gains, settings, limits and costs, each\n"
        "section whole from the file that holds it, posterior draws with their laws. Where files hold one section\n"
        "with other contents nothing is written and all conflicts are named; --take and --prefer decide them.\n"
        "Identity and provenance are those of the first file, the others are named in it (provenance.merged).",
    )
    p.add_argument("files", nargs="+", metavar="PARAMS", help="params.json, two or more; draws next to each")
    p.add_argument("--out", metavar="FILE", required=True, help="the merged file, none of those that are read")
    p.add_argument(
        "--take", action="append", metavar="SECTION=FILE",
        help="a section from one of the files, where they differ: laws.VB=b.json, limits=a.json (default: none)",
    )  # fmt: skip
    p.add_argument("--prefer", metavar="FILE", help="file that decides all other conflicts (default: none)")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print sections and notes as JSON (fitmodels.merge/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Merge, write and print, and return the exit code."""
    from ..parameters.checks import check
    from ..parameters.checks.report import cautions
    from ..parameters.file import sealed
    from ..parameters.merging import merge

    inputs, target = _inputs(args.files), Path(args.out)
    real = Path(os.path.realpath(target))
    recover(real)
    former = file_state(real)
    _check_target(target, inputs, force=args.force)
    take = {section: _number(file, args.files, "--take") for section, file in _asked(args.take).items()}
    prefer = None if args.prefer is None else _number(args.prefer, args.files, "--prefer")
    stem = target.stem if NAME.fullmatch(target.stem) else "merged"
    merged = merge(inputs, take=take, prefer=prefer, stem=stem)
    pf = sealed(merged.pf, provenance=traced(merged.pf, args.words))
    _write(target, stem, pf, merged, former)
    failed, verdicts = [finding.words for finding in check(pf).inconsistent], cautions(pf)
    if args.json:
        facts = {"file": target.name, "sections": dict(merged.taken), "notes": list(merged.notes)}
        print_json("merge", {**facts, "failed": failed, "verdicts": verdicts})
        return 0
    _show(args, target, pf, merged, [*(f"Fails its check: {words}" for words in failed), *verdicts])
    return 0


def _show(args: argparse.Namespace, target: Path, pf: "ParameterFile", merged: "Merged", last: list[str]) -> None:
    out = Printer(quiet=args.quiet)
    for line in (*_sections(merged), *merged.notes, *last):
        out.show(line)
    draws = [] if merged.draws is None or pf.posterior is None else [target.parent / str(pf.posterior.draws_file)]
    out.wrote(f"Written: {', '.join(map(str, (target, *draws)))}", target, *draws)


def _inputs(files: Sequence[str]) -> "list[MergeInput]":
    """The files with their draws, each read once and unchanged since it was written."""
    from .. import parameters
    from ..parameters.conflicts import MergeInput

    if len(files) < 2:
        raise UsageError(f"{files[0]}: one file has nothing to be merged with; give two or more.")
    found = []
    for number, name in enumerate(files):
        pf = parameter_file(name, writes=True)
        for other in files[:number]:
            if os.path.realpath(other) == os.path.realpath(name):
                raise UsageError(f"{name} is given twice; give each file once.")
        found.append(MergeInput(name, pf, parameters.read_draws(pf, Path(name).parent)))
    return found


def _check_target(target: Path, inputs: "Sequence[MergeInput]", *, force: bool) -> None:
    for each in inputs:
        refuse_input(target, *inputs_of(each.name, each.pf))
    if target.is_dir():
        raise UsageError(f"--out {target}: is a folder; give the name of the file.")
    if not target.parent.is_dir():
        raise UsageError(f"--out {target}: its folder does not exist; make it first.")
    if os.path.lexists(target) and not force:
        raise ParameterError(f"{target}: the file exists; choose another path, or replace it with --force.")


def _asked(words: list[str] | None) -> dict[str, str]:
    return pairs(words, "--take", "laws.VB=b.json")


def _number(file: str, files: Sequence[str], option: str) -> int:
    """Place of a file among those given, by the path that was typed or by another path of it."""
    for number, name in enumerate(files):
        if file == name or os.path.realpath(file) == os.path.realpath(name):
            return number
    raise UsageError(f"{option} {file}: is none of the files to be merged: {', '.join(files)}.")


def _write(target: Path, stem: str, pf: "ParameterFile", merged: "Merged", former: tuple[int, int, int] | None) -> None:
    """Write draws and file together, and remove the draws of a former file of this name."""
    from ..parameters.file import as_bytes

    folder = Path(os.path.realpath(target)).parent
    own = None if merged.draws is None or pf.posterior is None else pf.posterior.draws_file
    real = folder / Path(os.path.realpath(target)).name
    with only_writer(folder, f"{target}: another process has kept its folder locked for 10 s; nothing was written."):
        if file_state(real) != former:
            raise ParameterError(
                f"{target}: another program wrote it since this command began; nothing was written. Run again."
            )
        derived: dict[Path, bytes | None] = dict.fromkeys(_former_draws(real, stem), None)
        if own is not None:
            derived[folder / own] = merged.draws
        write_together(real, as_bytes(pf, str(target)), derived, error=ParameterError)


def _former_draws(target: Path, stem: str) -> list[Path]:
    """Draws of former files of this name, which no other parameter file of the folder names."""
    name = re.compile(rf"{re.escape(stem)}-draws-[0-9a-f]{{12}}\.npz")
    return [
        path
        for path in sorted(target.parent.glob(f"{glob.escape(stem)}-draws-*.npz"))
        if name.fullmatch(path.name) and not _used(path, target)
    ]


def _used(draws: Path, target: Path) -> bool:
    """Whether a parameter file of the folder other than the target names these draws."""
    return any(contains(path, draws.name.encode()) for path in target.parent.glob("*.json") if path != target)


def _sections(merged: "Merged") -> list[str]:
    """A line for each file with the sections that it gave."""
    files = dict.fromkeys(merged.taken.values())
    by_file = {file: [name for name, of in merged.taken.items() if of == file] for file in files}
    return [f"From {file}, {count(len(names), 'section')}: {', '.join(names)}." for file, names in by_file.items()]
