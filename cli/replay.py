"""``fitmodels replay``: the papers' controllers, made from a parameter file alone and run on simulated machines."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..cards.replays import SYSTEMS
from ..core.errors import ParameterError, UsageError
from ..core.journal import write_files
from ..core.suggestions import closest, did_you_mean
from .arguments import Parser, parameter_file, seed
from .options import plan_asked, plan_options, plan_options_of
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import RenderableType

    from ..cards.replays import Replayed
    from ..controllers.recursion.plan import PlanOptions
    from ..parameters import ParameterFile
    from ..parameters.draws import Draws

CALCULATED = ("region", "recursion")  # from the laws, without a simulated machine


def parser() -> Parser:
    """Arguments of ``fitmodels replay``."""
    p = Parser(
        "fitmodels replay",
        "fitmodels replay AC-2017 --system recursion",
        "Run the controllers of the papers from a parameter file alone, on simulated machines, and draw the results:\n"
        "region and optimum, recursion to the end of tool life, constant load, constant roughness, adaptive force.\n"
        "Instead of a file: AC-2016, AC-2017, CLM-2023, CLM-2023-slot, SURF or LYAP, the published values.\n"
        "A depth, time or factor outside the tested ranges is marked EXTRAPOLATED.",
        main="--system --depth --time --objective --removal --out --json",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json, or the short name of a paper")
    p.add_argument("--system", metavar="NAME", help=f"{', '.join(SYSTEMS)}; default: all that the file supports")
    p.add_argument("--seed", type=seed, default=1, metavar="N", help="random seed (default: 1)")
    p.add_argument("--out", metavar="FOLDER", help="folder of the figures (default: figures/ next to the file)")
    plan_options(p)
    output_options(p, "print the same facts as JSON (fitmodels.replay/3); draws figures only with --out")
    return p


def run(args: argparse.Namespace) -> int:
    """Replay, print and draw, and return the exit code."""
    from rich.text import Text

    from ..cards import replays
    from ..core.progress import progress_bar
    from ..parameters.checks.report import cautions

    pf, draws, home = _given(args.file)
    options = plan_options_of(args, pf)
    systems = _chosen(pf, args.system, args.file, options)
    _need_used(systems, plan_asked(args))
    results: list[Replayed] = []
    with progress_bar(lines=False) as step:
        for system in systems:
            step.say(f"replaying {system}")
            results.append(replays.replayed(system, pf, draws, args.seed, options))
    written = [] if args.json and not args.out else _drawn(results, Path(args.out) if args.out else home)
    verdicts = cautions(pf)
    if args.json:
        facts = {one.system: {"lines": one.lines, "assumed": one.assumed, **one.facts} for one in results}
        report = {"file": Path(args.file).name, "simulated": pf.identity.simulated, "seed": args.seed, "systems": facts}
        print_json("replay", {**report, "verdicts": verdicts}, version=3)
        return 0
    out = Printer(quiet=args.quiet)
    for line in verdicts:
        out.show(Text(line))
    for one in results:
        out.show(_block(one))
    for line in _not_replayed(pf, args.system, systems, options):
        out.show(line)
    if written:
        folder = written[0].parent
        out.wrote(f"Figures: {folder}/ ({', '.join(path.name for path in written)})", *written)
    return 0


def _given(file: str) -> "tuple[ParameterFile, Mapping[str, Draws], Path]":
    """The parameter file, its draws, and the folder of its figures."""
    from .. import parameters
    from ..parameters.published import PAPERS, published

    if file in PAPERS and not Path(file).exists():
        return published(file), {}, Path(f"{file}-replay")
    if not Path(file).exists() and (near := closest(file, PAPERS, 0.7)):
        raise UsageError(f"{file}: there is no such file, nor a paper of this name; did you mean {near}?")
    pf = parameter_file(file)
    return pf, parameters.read_draws(pf, Path(file).parent), Path(file).parent / "figures"


def _chosen(pf: "ParameterFile", name: str | None, file: str, options: "PlanOptions") -> list[str]:
    from ..cards import replays

    if name is not None and name not in SYSTEMS:
        raise UsageError(f"--system {name}: there is no such system. {did_you_mean(name, SYSTEMS, 0.6)}")
    lacking = {system: replays.lacks(system, pf, options) for system in SYSTEMS if name in (None, system)}
    able = [system for system, why in lacking.items() if not why]
    if not able:
        reasons = " ".join(f"{system}: {why.rstrip('.')}." for system, why in lacking.items())
        what = "supports no controller" if name is None else "does not support this controller"
        raise ParameterError(f"{file} {what}. {reasons}")
    return able


def _need_used(systems: list[str], asked: list[str]) -> None:
    """Raise UsageError for settings that no replayed system has."""
    from ..cards.replays import PLANNED

    for option in asked:
        able = [name for name, has in PLANNED.items() if option in has]
        if not {*able} & {*systems}:
            raise UsageError(
                f"{option} belongs to {' and '.join(able)}, and {', '.join(systems)} is replayed; leave it out, or "
                f"choose --system {able[-1]}."
            )


def _not_replayed(pf: "ParameterFile", asked: str | None, done: list[str], options: "PlanOptions") -> list[str]:
    """Reason why the recursion is not replayed of a file with a region and a wear criterion, where it is expected."""
    from ..cards import replays

    if asked is not None or "recursion" in done or "region" not in done or pf.limits is None or pf.limits.wear is None:
        return []
    return [f"Not replayed: recursion: {replays.lacks('recursion', pf, options)}"]


def _block(one: "Replayed") -> "RenderableType":
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    head = Text(one.title, style="bold")
    head.append(f"   {'calculated' if one.system in CALCULATED else 'simulated'}", style="not bold")
    lines = [*one.lines, *(_marked(line) for line in one.assumed)]
    return Group(head, Padding(Group(*(Text(line) for line in lines)), (0, 0, 1, 2)))


def _marked(line: str) -> str:
    """An assumption with its label; a reconstruction has its own."""
    return (
        line
        if line.startswith(("Reconstruction: ", "EXTRAPOLATED: "))
        else f"Assumed: {line.removeprefix('Assumption: ')}"
    )


def _drawn(results: "list[Replayed]", folder: Path) -> list[Path]:
    """Figures as files, all of them or none, over those of their names."""
    import io

    from ..core.plotting import save_figure

    contents = {}
    for one in results:
        for name, figure in one.figures.items():
            with io.BytesIO() as content:
                save_figure(figure, content, format="png", dpi=110, metadata={"Software": None})
                contents[f"{name}.png"] = content.getvalue()
    write_files(folder, contents)
    return [folder / name for name in contents]
