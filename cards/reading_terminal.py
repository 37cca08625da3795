"""Terminal output of the reading of a file: columns, doubts with the commands that correct them, pairs and edges."""

import re
import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.cells import cell_len
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..core.rounding import count, format_plain
from ..datasets import Runs
from ..datasets.columns import ColumnUse, recognised
from ..datasets.doubts import Doubt
from ..datasets.draft import mark_column
from ..datasets.edges.checks import COPIED
from ..datasets.plausibility.quantities import AGAINST
from ..datasets.runs import edges_of
from ..datasets.vocabulary import ROLES
from ..fit.checks.usefulness import tools_of_rows
from ..fit.defaults import SETTINGS, Held
from ..parameters import ParameterFile
from ..parameters.gather.description import column_words, derived_words

if TYPE_CHECKING:
    from ..datasets.tables import Table as FileTable

LONGEST = 8  # sentences of a kind that are shown
MOST_EDGES = 24  # edges of the table
MOST_PAIRS = 12
WIDEST_LINE = 80  # letters of a command
OTHER_ASSUMED = ("units that the file does not name", "tool:", "work:")  # on the first lines already
IN_FULL = (AGAINST, COPIED)
RUN_OUTS = re.compile(r"^T: .* (?:is a run-out|are run-outs): longer")  # on the first line already
SHOWN_VALUES = 4  # of a column of a refused file
Command = Callable[[str], str]
Form = tuple[Text, ...]  # lines of a section of the first screen
BLANK = 2.5  # cost of leaving out the blank lines between its sections


def reading_notes(runs: Runs, command: Command) -> RenderableType:
    """Notes on the reading of the file, before anything is fitted; ``command`` makes the whole command of a remedy."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    s = runs.source
    table.add_row("file", Text(f"{s.name}: {s.dialect}; {count(s.rows, 'row')}"))
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


def assumed_units(runs: Runs) -> str:
    """Units that the file does not name, by the columns that are read."""
    named = [use.role for use in runs.columns if use.role is not None and not use.unit and runs.units.get(use.role)]
    return ", ".join(f"{name} {unit}" for name in named if any(map(str.isalpha, unit := runs.units[name])))


def pair_name(runs: Runs) -> str:
    """``GC435 on 709M40``; names that are numbers follow what they number: ``tool 3 on material 1``."""
    numbered = (("tool", runs.tool), ("material", runs.work))
    return " on ".join(f"{kind} {name}" if name.isdigit() else name for kind, name in numbered)


def lives_words(runs: Runs) -> str:
    """``12 lives: 9 ended (4.1 to 41 min), 3 run-outs (>60)`` of a file of tool lives; empty of others."""
    marks = _marks(runs, "T")
    if not marks:
        return ""
    ended, unit = runs.values("T"), runs.units.get("T", "")
    ended = ended[np.isfinite(ended)]
    span = f" ({_span(ended)} {unit})" if len(ended) else ""
    parts = [f"{len(ended)} ended{span}"]
    for sign, word in ((">", "run-out"), ("<", "shorter than")):
        bounds = np.array([float(mark[1:]) for mark in marks if mark[:1] == sign])
        if len(bounds):
            parts.append(f"{len(bounds)} {word}{'s' if word == 'run-out' and len(bounds) > 1 else ''} "
                         f"({sign}{_span(bounds)})")  # fmt: skip
    return f"{len(runs)} lives: {', '.join(parts)}"


def _marks(runs: Runs, symbol: str) -> list[str]:
    """Bounds such as ``>60`` of the rows whose value is known by a bound alone."""
    column = mark_column(symbol)
    return (
        [mark for value in runs.data[column] if (mark := str(value))[:1] in "<>" and mark]
        if column in runs.data
        else []
    )


def edges_words(runs: Runs) -> str:
    """`` of 24 edges``; that none is named only where no column of the file numbers them."""
    edges = sum(len(set(one.labels("edge")) - {""}) for one in runs.pairs()) if runs.has("edge") else 0
    if edges:
        return f" of {count(edges, 'edge')}"
    return "" if unused_edges(runs) else ", no edges named"


def unused_edges(runs: Runs) -> str:
    """A column that numbers edges or tools and is not used, with its option; empty where there is none."""
    name = "" if runs.has("edge") else tools_of_rows(runs)
    option = shlex.quote(name)
    return f"column {name} ({runs.data[name].nunique()} values) is not used: --edge {option}" if name else ""


def unused_rows(runs: Runs) -> str:
    """Rows whose wear no law can take: ``30 rows not used: VB empty 21, VB 0 9``; empty where there are none."""
    found = []
    for name in (name for name in runs.units if name in runs.data and ROLES[name].kind == "wear"):
        values = runs.values(name)
        empty, zero = int(np.isnan(values).sum()) - len(_marks(runs, name)), int((values <= 0).sum())
        why = ", ".join(f"{name} {words} {n}" for words, n in (("empty", empty), ("0", zero)) if n > 0)
        found += [f"{count(empty + zero, 'row')} not used: {why}"] if why else []
    return "; ".join(found)


def first_line(what: str, sentences: Sequence[str], width: int) -> list[Text]:
    """The first sentence, and how many more there are."""
    more = f" ({len(sentences) - 1} more: --full)" if len(sentences) > 1 else ""
    return wrapped(f"! {what}{more}: {sentences[0]}", width, "yellow", most=1) if sentences else []


def assumed_lines(assumed: Sequence[str], width: int) -> list[Text]:
    """Assumptions: units given against headers, copies and computed quantities, and the first of the others."""
    computed = [words for words in assumed if ", computed from " in words]
    stated = [words for words in assumed if words.startswith(IN_FULL)]
    others = [words for words in assumed if words not in (*computed, *stated) and not words.startswith(OTHER_ASSUMED)]
    others = [words for words in others if not RUN_OUTS.search(words)]
    lines = [line for words in (*stated, *computed[:2]) for line in wrapped(f"! {words}", width, "yellow", most=4)]
    return lines + first_line("assumed", others, width)


def constant_conditions(runs: Runs, pf: ParameterFile) -> str:
    """Conditions that were the same in all tests, so that no law has them: predictions hold for these alone."""
    held = Held.of_runs(runs)
    used = {factor.symbol for law in pf.laws.values() for factor in law.factors}
    same = [name for name in SETTINGS if held.has(name) and not held.varies(name) and name not in used]
    values = {name: runs.values(name) for name in same}
    units = {name: unit if any(map(str.isalpha, unit := runs.units.get(name, ""))) else "" for name in same}
    return ", ".join(f"{name} {np.nanmean(values[name]):.4g} {units[name]}".rstrip() for name in same)


def first_doubt_lines(doubts: Sequence[Doubt], width: int, remedy: Sequence[str]) -> list[Text]:
    """The first doubt with its remedy, and the number of the others; nothing where there is none."""
    if not doubts:
        return []
    first = sorted(doubts, key=lambda doubt: not doubt.unsettled)[0]
    more = " (all with --full)" if len(doubts) > 1 else ""
    lines = wrapped(
        f"! {count(len(doubts), 'doubt')} about the data{more}: {first.sentence}", width, "bold red", most=2
    )
    return [*lines, *command_lines(remedy, width)]


def doubts_reminder(runs: Runs) -> str:
    """One line on the doubts, for the end of the output; empty where there are none."""
    n, names = len(runs.doubts), dict.fromkeys(name for doubt in runs.doubts for name in doubt.columns)
    of = f" ({', '.join(names)})" if names else ""
    return f"{count(n, 'doubt')} about the data{of}: see the beginning of this output." if n else ""


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
    """Rows of each edge, its conditions, its time and its wear from first to last; None where there are no edges.

    Tool and work are named where edges of several pairs have one name.
    """
    if not runs.has("edge"):
        return None
    codes, names = edges_of(runs)
    again = len({edge for *_, edge in names}) < len(names)
    parts = [k for k in (0, 1) if again and len({name[k] for name in names}) > 1] + [2]
    shown = [name for name in runs.units if name in runs.data and ROLES[name].kind in ("condition", "time", "wear")]
    shown = sorted(shown, key=list(ROLES).index)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for k in parts:
        table.add_column(("tool", "work", "edge")[k], no_wrap=True)
    table.add_column("rows", justify="right")
    for name in shown:
        table.add_column(f"{name} {runs.units.get(name, '')}".strip(), justify="right", no_wrap=True)
    order = np.argsort(codes, kind="stable")
    rows = np.split(order, np.cumsum(np.bincount(codes + 1, minlength=len(names) + 1))[:-1])[1:]
    columns = {name: runs.values(name) for name in shown}
    for edge, of_edge in zip(names[:MOST_EDGES], rows, strict=False):
        cells = (_span(columns[name][of_edge]) for name in shown)
        table.add_row(*(Text(edge[k]) for k in parts), str(len(of_edge)), *cells)
    more = [Text(f"... and {len(names) - MOST_EDGES} more")] if len(names) > MOST_EDGES else []
    return Group(Text(f"Edges: {len(names)}", style="bold"), Padding(Group(table, *more), (0, 0, 1, 2)))


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
        cells = column.values[:SHOWN_VALUES]
        texts = (f"{value:.6g}" if isinstance(value, float) else str(value)[:20] for value in cells)
        values = ", ".join("-" if text in ("nan", "") else text for text in texts)
        grid.add_row(f"col{column.number}", Text(column.name), Text(unit), name, Text(values))
    head = Text(f"Columns as found: {table.dialect.describe()}; {count(table.n_rows, 'row')}", style="bold")
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


def command_lines(words: Sequence[str], width: int, purpose: str = "") -> list[Text]:
    """A command on lines that fit the screen, each but the last ended by a backslash; its purpose where it fits."""
    lines: list[str] = []
    for word in map(shlex.quote, words):
        if lines and cell_len(lines[-1]) + cell_len(word) + 3 <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(f"  {word}" if not lines else f"    {word}")
    text = [Text(f"{line} \\" if i < len(lines) - 1 else line, "bold") for i, line in enumerate(lines)]
    if purpose and text and cell_len(text[-1].plain) + len(purpose) + 4 <= width:
        text[-1].append(f"  # {purpose}", "not bold dim")
    return text


def wrapped(text: str, width: int, style: str = "", most: int = 9, indent: int = 2, first: int = 0) -> list[Text]:
    """A text on at most so many lines no wider than the screen; dots stand for what is left out."""
    words = text.split()
    lines = [f"{' ' * first}{words[0]}" if words else ""]
    for word in words[1:]:
        if cell_len(lines[-1]) + 1 + cell_len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(f"{' ' * indent}{word}")
    if len(lines) > most:
        lines = [*lines[: most - 1], " ".join([lines[most - 1], *(line.strip() for line in lines[most:])])]
    return [line_of(line, width, style) for line in lines]


def shortened(text: str, width: int) -> str:
    """The text, or as many of its words as are no wider, with dots."""
    if cell_len(text) <= width:
        return text
    kept = text[: 4 * width]  # the loop takes the square of the length: of a header of 32 kB minutes
    while kept and cell_len(kept) > width - 4:
        kept = kept[:-1]
    if not text[len(kept) :].startswith(" "):  # not within a word or a number, but for the only one
        kept = kept.rpartition(" ")[0].rstrip() or kept
    return f"{kept.rstrip()} ..."


def line_of(text: str, width: int, style: str = "") -> Text:
    """One line of a text, no wider than the screen."""
    return Text(shortened(text, width), style)


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the screen in several forms, the fullest first.

    Attributes
    ----------
    forms : tuple of tuple of Text
        Lines of each form.
    costs : tuple of float
        Of each step to the next form: the cheapest step of all sections is taken first.
    apart : bool
        Whether a blank line stands before it.
    """

    forms: tuple[Form, ...]
    costs: tuple[float, ...] = ()
    apart: bool = True


def fitted(sections: Sequence[Section], height: int, width: int) -> list[Text]:
    """The sections in their fullest forms that fit: the cheapest steps are taken first, and blank lines go."""
    chosen = [0] * len(sections)

    def lines(blanks: bool) -> int:
        forms = (section.forms[k] for section, k in zip(sections, chosen, strict=True))
        used = sum(1 + max(0, cell_len(line.plain) - 1) // width for form in forms for line in form)
        return used + (sum(section.apart for section in sections[1:]) if blanks else 0)

    def steps(most: float) -> list[tuple[float, int]]:
        found = ((sections[i].costs[k], i) for i, k in enumerate(chosen) if k < len(sections[i].forms) - 1)
        return [step for step in found if step[0] <= most]

    for blanks, most in ((True, BLANK), (False, float("inf"))):
        chosen = [0] * len(sections)
        while lines(blanks) > height and (found := steps(most)):
            chosen[min(found)[1]] += 1
        if lines(blanks) <= height:
            break
    blanks, out = lines(blanks=True) <= height, list[Text]()
    for section, k in zip(sections, chosen, strict=True):
        if blanks and section.apart and out and section.forms[k]:
            out.append(Text())
        out += section.forms[k]
    return out


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
