"""``fitmodels card``: the model card of a parameter file in its three forms."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.bounded import has_content
from ..core.errors import UsageError
from ..core.journal import write_files
from .arguments import Parser
from .output import Printer, complain, output_options

if TYPE_CHECKING:
    from ..cards.content.card import Card

CITATION, ZENODO = "CITATION.cff", ".zenodo.json"


def parser() -> Parser:
    """Arguments of ``fitmodels card``."""
    p = Parser(
        "fitmodels card",
        "fitmodels card data-fit/GC435_709M40-En-19/params.json",
        "Write the card of a parameter file to its folder: README.md for reading, card.html for a browser, card.json\n"
        "for programs. Licence, authors, machine and set-up are read from card.toml.",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json; figures and draws are expected in the same folder")
    p.add_argument("--toml", metavar="FILE", help="card.toml (default: that in the folder of PARAMS, if any)")
    p.add_argument("--citation", action="store_true", help="write CITATION.cff too")
    p.add_argument("--zenodo", action="store_true", help="write .zenodo.json too")
    p.add_argument("--force", action="store_true", help="replace existing files with other content")
    output_options(p, "print card.json (fitmodels.card/8), and write nothing")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the forms of the card, list missing fields, and return the exit code."""
    from ..cards.publishing.pair import read_pair
    from ..cards.publishing.requirements import missing_fields
    from ..parameters.file import seal_fault

    file = Path(args.file)
    original, pf, card = read_pair(file.parent, file.name, None if args.toml is None else Path(args.toml))
    if fault := seal_fault(original):
        complain(f"{args.file}: {fault}. Commands that write from it refuse it.")
    if args.json:
        from ..cards.forms.card_json import as_json

        print(as_json(card), end="")  # noqa: T201
        return 0
    from ..cards.folder import card_files

    made = {**card_files(card, pf), **_cited(card, args)}
    new = {name: content for name, content in made.items() if not has_content(file.parent / name, content)}
    _write(file.parent, new, force=args.force)
    out = Printer(quiet=args.quiet)
    for path in (file.parent / name for name in new):
        out.wrote(f"wrote {path}", path)
    if not new:
        out.show(f"unchanged: {', '.join(made)}")
    if lacking := ", ".join(item.field for item in missing_fields(card)):
        out.show(f"Not stated, and needed to publish the card: {lacking}; state it in card.toml.")
    return 0


def _cited(card: "Card", args: argparse.Namespace) -> dict[str, bytes]:
    from ..cards.forms.citation import citation_cff, zenodo_json

    asked = {CITATION: args.citation and citation_cff, ZENODO: args.zenodo and zenodo_json}
    return {name: made(card).encode() for name, made in asked.items() if made}


def _write(folder: Path, new: dict[str, bytes], *, force: bool) -> None:
    """Write all files, or none where one exists and may not be replaced."""
    held = [name for name in new if os.path.lexists(folder / name)]
    if held and not force:
        raise UsageError(f"{folder}: {', '.join(held)} would be changed; replace with --force.")
    write_files(folder, new)
