"""Terminal output of the main job and of an identification, from the same parts as the card."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..core.rounding import format_plain
from ..datasets import Runs
from ..datasets.columns import ColumnUse
from ..datasets.vocabulary import ROLES
from ..fit import Refused
from ..parameters import LawSection, ParameterFile
from ..parameters.gather.understood import column_words, idle
from ..parameters.gather.understood import understood as sayings
from ..parameters.sections.posterior import LawPosterior
from .content.coefficients import between, law_coefficients, model_coefficients
from .content.dynamics import model_words, transfer_function_words
from .content.laws import (
    about_intervals,
    cautions,
    composite_words,
    edge_words,
    life_equation,
    life_words,
    other_words,
    published_words,
    statistics_line,
    structure_words,
)
from .content.posterior import posterior_of, posterior_words

if TYPE_CHECKING:
    from ..ident.identification import Identification

NOTHING = (
    "no law can be fitted to these columns. A wear law needs AW or VB beside V, f, d or t; a force or power "
    "law a force or P beside them; a load line I, fm and VB; a roughness law Ra and F. Say which column is "
    'which with --map, for instance --map "VB=col7".'
)


def understood(runs: Runs) -> RenderableType:
    """What was understood of the file, before anything is fitted."""
    table = _grid()
    s = runs.source
    table.add_row("file", Text(f"{s.name}: {s.dialect}; {_rows(s.rows)}"))
    table.add_row("tool, work", Text(f"{runs.tool}, {runs.work}"))
    columns = [column_words(runs, use) for use in runs.columns if use.role is not None]
    table.add_row("columns", Text("\n".join(f"{f'{s:<4} {quantity}':<28} {rest}" for s, quantity, rest in columns)))
    unused = [_unused_words(use) for use in runs.columns if use.role is None]
    if unused:
        table.add_row("not used", Text(", ".join(unused)))
    for label, sentences in (("assumed", runs.assumed), ("mended", runs.warnings), ("notes", runs.notes)):
        if sentences:
            table.add_row(label, Text("\n".join(_short(sentences))))
    return Group(Text("What was understood", style="bold"), Padding(table, (0, 0, 1, 2)))


def law_block(law: LawSection, posterior: LawPosterior | None = None) -> RenderableType:
    """One law: equation, coefficients, statistics, and what to beware of."""
    head = Text.assemble(
        (f"{law.response}  {law.quantity}" + (f", {law.unit}" if law.unit else ""), "bold"),
        f"   {law.form.replace('_', ' ')}; {structure_words(law)}",
    )
    words = [statistics_line(law), edge_words(law), *law.verdicts, *posterior_words(law, posterior)]
    words += [composite_words(law), *cautions(law)]
    lines = [Text(sentence) for sentence in words if sentence]
    if law.published is not None:
        lines.append(Text(published_words(law)))
    return Group(head, Padding(Group(Text(law.equation), _coefficients(law), *lines), (0, 0, 1, 2)))


def tool_life_block(pf: ParameterFile) -> RenderableType | None:
    """Tool life at the wear criterion, where there is a wear law on time."""
    life = pf.tool_life
    if life is None:
        return None
    lines = [Text(life_equation(pf))]
    if life.taylor_n is not None:
        lines.append(Text(f"Taylor's n {format_plain(life.taylor_n, 3)} in V T^n = C"))
    lines.append(Text(life_words(pf)))
    head = Text(f"T  tool life, {life.unit}", style="bold")
    head.append(f"   at {life.wear} {life.criterion:g} {life.unit_of_wear}, from the wear law", style="not bold")
    return Group(head, Padding(Group(*lines), (0, 0, 1, 2)))


def pair_head(runs: Runs) -> RenderableType:
    """Title of a pair, with its rows."""
    title = Text(f"{runs.tool} on {runs.work}", style="bold underline")
    title.append(
        f"   {_rows(len(runs))}" + (", not measured: " + runs.disclaimers[0] if runs.simulated else ""),
        "not bold",
    )
    return Padding(title, (0, 0, 1, 0))


def pair_blocks(runs: Runs, pf: ParameterFile, refused: Sequence[Refused]) -> list[RenderableType]:
    """Every law of a pair, the tool life, what could not be fitted, and what no law takes in."""
    blocks: list[RenderableType] = [law_block(law, posterior_of(pf, law)) for law in pf.laws.values()]
    life = tool_life_block(pf)
    if life is not None:
        blocks.append(life)
    blocks.append(Padding(Text(about_intervals(pf)), (0, 0, 1, 0)))
    beside = [*map(_refusal, refused), *idle(runs, pf.laws)]
    if beside:
        blocks.append(Text("\n".join(beside) + "\n"))
    return blocks


def nothing_fitted(runs: Runs, refused: Sequence[Refused]) -> str:
    """Why a pair has no law at all."""
    return f"{runs.tool} on {runs.work}: " + (" ".join(map(_refusal, refused)) or NOTHING)


def data_lines(runs: Runs, pf: ParameterFile) -> list[str]:
    """What was understood, as lines for the card."""
    return sayings(runs, pf.laws)


def _refusal(item: Refused) -> str:
    return f"{item.response} is not fitted: {item.reason.removeprefix(f'{item.response}: ')}"


def _rows(n: int) -> str:
    return f"{n} row{'s' if n != 1 else ''}"


def _grid() -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    return table


def _unused_words(use: ColumnUse) -> str:
    if use.suggestion is None:
        return repr(use.header)
    role = ROLES[use.suggestion]
    return f'{use.header!r} (near {role.quantity}: say --map "{role.symbol}={use.name}" if it is)'


def _short(sentences: Iterable[str], most: int = 8) -> list[str]:
    lines = list(sentences)
    return lines if len(lines) <= most else [*lines[:most], f"... and {len(lines) - most} more"]


def _coefficients(law: LawSection) -> Table:
    lines = law_coefficients(law)
    columns = {
        "": [c.name for c in lines],
        "estimate": [c.estimate.text for c in lines],
        "SE": [c.se.text for c in lines],
        "t": [c.t.text for c in lines],
        "p": [c.p.text for c in lines],
        "95 % interval": [between(c.low, c.high) for c in lines],
        "row SE": [c.row_se.text for c in lines],
        other_words(law) or "other": [c.other.text for c in lines],
        "as printed": [c.printed.text for c in lines],
    }
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    shown = {name: cells for name, cells in columns.items() if any(cells)}
    for name in shown:
        table.add_column(name, justify="left" if not name else "right", no_wrap=True)
    for cells in zip(*shown.values(), strict=True):
        table.add_row(*(Text(cell) for cell in cells))
    return table


def identification_block(found: "Identification", pf: ParameterFile) -> RenderableType:
    """Everything about one identification."""
    d = pf.dynamics
    assert d is not None  # noqa: S101  collected from a model
    rec = found.record
    runs = f", {len(rec.starts)} stretches" if len(rec.starts) > 1 else ""
    head = Text(f"{d.output} from {d.input}", style="bold")
    head.append(f"   {len(rec)} samples at {rec.rate:g} Hz{runs}", style="not bold")
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for name in ("", "estimate", "SE", "95 % interval"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    for c in model_coefficients(d):
        table.add_row(c.name, c.estimate.text, c.se.text, between(c.low, c.high))
    lines = [*model_words(d), found.argument, *found.verdicts]
    words = [Text(line if line.endswith(".") else f"{line}.") for line in lines]
    return Group(head, Padding(Group(Text(transfer_function_words(d)), table, *words), (0, 0, 1, 2)))
