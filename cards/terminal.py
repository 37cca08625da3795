"""What the command prints: what was understood, each law, and where things were written."""

from collections.abc import Iterable, Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..datasets import ColumnUse, Runs
from ..datasets.vocabulary import ROLES
from ..fit import Refused
from ..parameters import Law, ParameterFile
from .facts import (
    about_intervals,
    cautions,
    coefficient_rows,
    life_equation,
    life_words,
    other_words,
    published_words,
    statistics_line,
    structure_words,
)
from .rounding import plain


NOTHING = (
    "No law to fit: a wear law needs AW or VB and one of V, f, d, t; force and power laws a force or P; "
    "a load line I, fm and VB; a roughness law Ra and F."
)


def understood(runs: Runs) -> RenderableType:
    """What was understood of the file, before anything is fitted."""
    table = _grid()
    s = runs.source
    table.add_row("file", Text(f"{s.name}: {s.dialect}; {s.rows} rows"))
    table.add_row("tool, work", Text(f"{runs.tool}, {runs.work}"))
    columns = [_column_words(runs, use) for use in runs.columns if use.role is not None]
    table.add_row("columns", Text("\n".join(columns)))
    unused = [_unused_words(use) for use in runs.columns if use.role is None]
    if unused:
        table.add_row("not used", Text(", ".join(unused)))
    for label, sentences in (("assumed", runs.assumed), ("mended", runs.warnings), ("notes", runs.notes)):
        if sentences:
            table.add_row(label, Text("\n".join(_short(sentences))))
    return Group(Text("What was understood", style="bold"), Padding(table, (0, 0, 1, 2)))


def law_block(law: Law) -> RenderableType:
    """One law: equation, coefficients, statistics, and what to beware of."""
    head = Text.assemble(
        (f"{law.response}  {law.quantity}" + (f", {law.unit}" if law.unit else ""), "bold"),
        f"   {law.form.replace('_', ' ')}; {structure_words(law)}",
    )
    lines = [Text(statistics_line(law)), *(Text(s) for s in cautions(law))]
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
        lines.append(Text(f"Taylor's n {plain(life.taylor_n, 3)} in V T^n = C"))
    lines.append(Text(life_words(pf)))
    head = Text(f"T  tool life, {life.unit}", style="bold")
    head.append(
        f"   at {life.wear} {life.criterion:g} {life.unit_of_wear}, from the wear law", style="not bold"
    )
    return Group(head, Padding(Group(*lines), (0, 0, 1, 2)))


def pair_head(runs: Runs) -> RenderableType:
    """Title of a pair, with its rows."""
    title = Text(f"{runs.tool} on {runs.work}", style="bold underline")
    title.append(
        f"   {len(runs)} rows" + (", not measured: " + runs.notes[0] if runs.simulated else ""), "not bold"
    )
    return Padding(title, (0, 0, 1, 0))


def pair_blocks(pf: ParameterFile | None, refused: Sequence[Refused]) -> list[RenderableType]:
    """Every law of a pair, the tool life, and what could not be fitted."""
    blocks: list[RenderableType] = [law_block(law) for law in pf.laws.values()] if pf is not None else []
    life = tool_life_block(pf) if pf is not None else None
    if life is not None:
        blocks.append(life)
    if pf is not None and pf.laws:
        blocks.append(Padding(Text(about_intervals(pf)), (0, 0, 1, 0)))
    if refused:
        blocks.append(
            Text("\n".join(f"{item.response} is not fitted: {item.reason}" for item in refused) + "\n")
        )
    if pf is None and not refused:
        blocks.append(Text(NOTHING))
    return blocks


def data_lines(runs: Runs) -> list[str]:
    """What was understood, as lines for the card."""
    columns = [_column_words(runs, use) for use in runs.columns if use.role is not None]
    unused = ", ".join(repr(use.header) for use in runs.columns if use.role is None)
    lines = [" ".join(line.split()) for line in columns]
    lines += [f"not used: {unused}"] if unused else []
    lines += [f"assumed: {sentence}" for sentence in runs.assumed]
    return [*lines, *runs.warnings, *(f"from the file: {note.lstrip('#% ')}" for note in runs.notes)]


def _grid() -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    return table


def _column_words(runs: Runs, use: ColumnUse) -> str:
    role = ROLES[str(use.role)]
    head = f"{role.symbol:<4} {role.quantity}"
    if role.kind == "label" or role.symbol not in runs.data:
        names = (
            [str(v) for v in dict.fromkeys(runs.labels(role.symbol)) if v] if runs.has(role.symbol) else []
        )
        shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
        return f"{head:<28} column {use.number} {use.header!r}: {len(names)} different ({shown})"
    values = runs.values(role.symbol)
    known = values[~np.isnan(values)]
    span = f"{known.min():.4g} to {known.max():.4g} {role.unit}" if known.size else "empty"
    missing = f", {len(values) - known.size} missing" if known.size < len(values) else ""
    unit = f", converted from {use.unit}" if use.converted else ""
    return f"{head:<28} column {use.number} {use.header!r}: {span}{unit}{missing}"


def _unused_words(use: ColumnUse) -> str:
    if use.suggestion is None:
        return repr(use.header)
    role = ROLES[use.suggestion]
    return f'{use.header!r} (near {role.quantity}: say --map "{role.symbol}={use.name}" if it is)'


def _short(sentences: Iterable[str], most: int = 8) -> list[str]:
    lines = list(sentences)
    return lines if len(lines) <= most else [*lines[:most], f"... and {len(lines) - most} more"]


def _coefficients(law: Law) -> Table:
    rows = coefficient_rows(law)
    columns = {
        "": [r.name for r in rows],
        "estimate": [r.estimate for r in rows],
        "SE": [r.se for r in rows],
        "t": [r.t for r in rows],
        "p": [r.p for r in rows],
        "95 % interval": [r.interval for r in rows],
        other_words(law) or "other": [r.other for r in rows],
        "as printed": [r.published for r in rows],
    }
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    shown = {name: cells for name, cells in columns.items() if any(cells)}
    for name in shown:
        table.add_column(name, justify="left" if not name else "right", no_wrap=True)
    for cells in zip(*shown.values(), strict=True):
        table.add_row(*(Text(cell) for cell in cells))
    return table
