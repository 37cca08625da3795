"""Terminal output of the reading of a file: columns, doubts with the commands that correct them, pairs and edges."""

import re
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..core.rounding import format_plain
from ..datasets import Runs
from ..datasets.columns import ColumnUse, recognised
from ..datasets.doubts import Doubt
from ..datasets.vocabulary import ROLES
from ..parameters.gather.description import column_words, derived_words

if TYPE_CHECKING:
    from ..datasets.tables import Table as FileTable

LONGEST = 8  # sentences of a kind that are shown
MOST_EDGES = 24  # edges of the table
MOST_PAIRS = 12
WIDEST_LINE = 80  # letters of a command
SHOWN_VALUES = 4  # of a column of a refused file
Command = Callable[[str], str]


def reading_notes(runs: Runs, command: Command) -> RenderableType:
    """How the file was read, before anything is fitted; ``command`` makes the whole command of a remedy."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    s = runs.source
    table.add_row("file", Text(f"{s.name}: {s.dialect}; {count_rows(s.rows)}"))
    if runs.doubts:
        table.add_row(Text("doubts", style="bold red"), doubt_lines(runs.doubts, command))
    table.add_row("tool, work", Text(f"{runs.tool}, {runs.work}"))
    columns = [column_words(runs, use) for use in runs.columns if use.role is not None] + derived_words(runs)
    table.add_row("columns", Text("\n".join(f"{f'{symbol:<4} {name}':<28} {rest}" for symbol, name, rest in columns)))
    unused = [_unused_words(use) for use in runs.columns if use.role is None]
    if unused:
        table.add_row("not used", Text(", ".join(unused)))
    for label, sentences in (("assumed", runs.assumed), ("corrected", runs.warnings), ("notes", runs.notes)):
        if sentences:
            table.add_row(label, Text("\n".join(_first(sentences))))
    return Group(Text("Input", style="bold"), Padding(table, (0, 0, 1, 2)))


def doubt_lines(doubts: Sequence[Doubt], command: Command) -> RenderableType:
    """Each doubt with its number, and on a line of its own the command that reads the file corrected."""
    lines = Table.grid(padding=(0, 1))
    lines.add_column(no_wrap=True)
    lines.add_column()
    for number, doubt in enumerate(doubts[:LONGEST], start=1):
        lines.add_row(
            f"{number}.", Text(doubt.sentence if doubt.sentence.endswith("?") else f"{doubt.sentence.rstrip('.')}.")
        )
        if doubt.remedy:
            lines.add_row("", Text(lines_of(command(doubt.remedy)), style="bold"))
    if len(doubts) > LONGEST:
        lines.add_row("", f"... and {len(doubts) - LONGEST} more")
    return lines


def doubts_reminder(runs: Runs) -> str:
    """One line on the doubts, for the end of the output; empty where there are none."""
    n, names = len(runs.doubts), dict.fromkeys(name for doubt in runs.doubts for name in doubt.columns)
    of = f" ({', '.join(names)})" if names else ""
    return f"{n} doubt{'s' if n > 1 else ''} about the data{of}: see the beginning of this output." if n else ""


def pairs_block(pairs: Sequence[Runs], laws: Callable[[Runs], str]) -> RenderableType:
    """Rows and edges of each tool/work pair, and the laws that its columns ask for."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for heading, justify in (("pair", "left"), ("rows", "right"), ("edges", "right"), ("laws", "left")):
        table.add_column(heading, justify=justify)  # type: ignore[arg-type]
    for runs in pairs[:MOST_PAIRS]:
        edges = str(len(set(runs.labels("edge")) - {""})) if runs.has("edge") else "none"
        table.add_row(Text(f"{runs.tool} on {runs.work}"), str(len(runs)), edges, laws(runs) or "none")
    more = [Text(f"... and {len(pairs) - MOST_PAIRS} more")] if len(pairs) > MOST_PAIRS else []
    return Group(Text("Pairs", style="bold"), Padding(Group(table, *more), (0, 0, 1, 2)))


def edges_block(runs: Runs) -> RenderableType | None:
    """Rows of each edge, its conditions, its time and its wear from first to last; None where there are no edges."""
    if not runs.has("edge"):
        return None
    codes, names = pd.factorize(runs.labels("edge"))
    known = [i for i, name in enumerate(names) if name]
    shown = [name for name in runs.units if name in runs.data and ROLES[name].kind in ("condition", "time", "wear")]
    shown = sorted(shown, key=list(ROLES).index)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("edge", no_wrap=True)
    table.add_column("rows", justify="right")
    for name in shown:
        table.add_column(f"{name} {runs.units.get(name, '')}".strip(), justify="right", no_wrap=True)
    order = np.argsort(codes, kind="stable")
    rows = np.split(order, np.cumsum(np.bincount(codes, minlength=len(names)))[:-1])
    columns = {name: runs.values(name) for name in shown}
    for i in known[:MOST_EDGES]:
        cells = (_span(columns[name][rows[i]]) for name in shown)
        table.add_row(Text(str(names[i])), str(len(rows[i])), *cells)
    more = [Text(f"... and {len(known) - MOST_EDGES} more")] if len(known) > MOST_EDGES else []
    return Group(Text(f"Edges: {len(known)}", style="bold"), Padding(Group(table, *more), (0, 0, 1, 2)))


def commands_block(commands: Sequence[tuple[str, str]]) -> RenderableType:
    """Whole commands to copy, each below what it is for."""
    lines: list[RenderableType] = []
    for purpose, command in commands:
        lines += [Text(purpose), Padding(Text(lines_of(command), style="bold"), (0, 0, 0, 2))]
    return Group(Text("Next", style="bold"), Padding(Group(*lines), (0, 0, 1, 2)))


def raw_columns(table: "FileTable") -> RenderableType:
    """Columns of a refused file as found: number, header, unit, role by name, first values."""
    grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for heading in ("column", "header", "unit", "role by name", "first values"):
        grid.add_column(heading)
    for column, (role, unit) in zip(table.columns, recognised(table.columns), strict=True):
        name = f"{role} {ROLES[role].quantity}" if role else ""
        cells = column.values[:SHOWN_VALUES]  # noqa: PD011  a Column, not a Series
        texts = (f"{value:.6g}" if isinstance(value, float) else str(value)[:20] for value in cells)
        values = ", ".join("-" if text in ("nan", "") else text for text in texts)
        grid.add_row(f"col{column.number}", Text(column.name), Text(unit), name, Text(values))
    head = Text(f"Columns as found: {table.dialect.describe()}; {count_rows(table.n_rows)}", style="bold")
    return Group(head, Padding(grid, (0, 0, 1, 2)))


def lines_of(command: str) -> str:
    r"""A command on lines that a terminal does not wrap, each but the last ended by a backslash.

    >>> print(lines_of("fitmodels data.csv" + " --unit VB=um" * 7))
    fitmodels data.csv --unit VB=um --unit VB=um --unit VB=um --unit VB=um \
      --unit VB=um --unit VB=um --unit VB=um
    """
    lines = [""]
    program, _, rest = command.partition(" ")
    for part in (program, *re.split(r" (?=--)", rest)):
        if lines[-1] and len(lines[-1]) + len(part) > WIDEST_LINE:
            lines.append("  ")
        lines[-1] += part if not lines[-1].strip() else f" {part}"
    return " \\\n".join(lines)


def count_rows(n: int) -> str:
    """``1 row``, ``12 rows``."""
    return f"{n} row{'s' if n != 1 else ''}"


def _span(values: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return ""
    low, high = format_plain(known.min()), format_plain(known.max())
    return low if low == high else f"{low} to {high}"


def _unused_words(use: ColumnUse) -> str:
    if use.suggestion is None:
        return repr(use.header)
    role = ROLES[use.suggestion]
    return f'{use.header!r} (similar to {role.quantity}: assign it with --map "{role.symbol}={use.name}")'


def _first(sentences: Iterable[str]) -> list[str]:
    lines = list(sentences)
    return lines if len(lines) <= LONGEST else [*lines[:LONGEST], f"... and {len(lines) - LONGEST} more"]
