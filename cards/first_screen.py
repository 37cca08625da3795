"""First screen of the main job: in at most 25 lines what was read, each law, a prediction, tool life, next commands.

Each section has forms from the fullest to the shortest; where the lines do not suffice, the sections that matter least
are shortened first. Colours are the base colours of a terminal, legible on light and dark; each stands next to an icon
and words.
"""

import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Group, RenderableType
from rich.text import Text

from ..core.rounding import count, format_plain
from ..core.verdict import DO_NOT_USE, MARKS, RESERVATIONS, USABLE
from ..datasets import Runs
from ..fit.defaults import Refused
from ..parameters import LawSection, ParameterFile
from ..parameters.gather.description import unused_conditions
from .content.guidance import next_commands
from .content.numbers import quantity
from .content.parts import ToolLifePart, VerdictPart, WorkedPart
from .content.tool_life import edge_or_row, life_doubt, tool_life_part
from .content.verdicts import main_reason, measured_first, remedy_command, short_reasons, verdicts_of, with_reasons
from .content.worked import FILE, scatter_words, short_equation, worked_predictions
from .reading_terminal import (
    Form,
    Section,
    assumed_lines,
    assumed_units,
    command_lines,
    constant_conditions,
    edges_words,
    first_doubt_lines,
    first_line,
    fitted,
    line_of,
    lives_words,
    pair_name,
    shortened,
    unused_edges,
    unused_rows,
    wrapped,
)

HEIGHT = 25  # lines of the screen, with the line on what was written
MOST_BLOCKS = 3  # pairs with a block of their own; more are a table
STATISTICS = re.compile(r" \((?=[^()]*(?:\bp\b|\bF\(|\bt\(|chi2|R2|score))(?:[^()]|\([^()]*\))*\)")
WEAR = ("AW", "VB", "T")  # predicted before other responses
OUTSIDE = "outside the tested region: do not rely on it"
RED, YELLOW, BOLD = "bold red", "yellow", "bold"


@dataclass(slots=True)
class FirstScreen:
    """The first screen of a file: what was read, then a block for each pair as soon as it is analysed.

    A single pair has all of the lines, two or three share them, and more pairs are a line each.

    Attributes
    ----------
    width : int
        Columns.
    pairs : int
        Number of pairs of the file.
    ascii : bool
        Whether the output has no other signs.
    used : int
        Lines that were given out.
    height : int
        Lines that there are, without the one on what was written.
    """

    width: int
    pairs: int = 1
    ascii: bool = False
    used: int = 0
    height: int = HEIGHT - 2

    def icon(self, level: int | None) -> str:
        """The icon of a level of a verdict."""
        return MARKS[level].ascii if self.ascii else MARKS[level].icon

    def input_lines(self, runs: Runs, remedy: Sequence[str] = ()) -> list[Text]:
        """Lines on the input: columns, assumed units, and the doubts in red with the command that removes the first.

        ``remedy`` is that command as words of a shell.
        """
        what = pair_name(runs) if self.pairs == 1 else f"{self.pairs} pairs of tool and work"
        read = lives_words(runs) or f"{count(len(runs), 'row')}{edges_words(runs)}"
        lines = wrapped(f"{runs.source.name}: {read}; {what}", self.width, BOLD, most=3)
        lines += wrapped(f"! {unused}", self.width, YELLOW, most=2) if (unused := unused_edges(runs)) else []
        if self.pairs > 1 and (rows := unused_rows(runs)):
            lines += wrapped(f"! {rows}", self.width, YELLOW, most=2)
        if units := assumed_units(runs):
            lines += wrapped(f"! units assumed, not in the file: {units}", self.width, YELLOW, most=1)
        lines += assumed_lines(runs.assumed, self.width) + first_line("corrected", runs.warnings, self.width)
        lines += first_doubt_lines(runs.doubts, self.width, remedy)
        if self.pairs > MOST_BLOCKS:
            lines.append(self._legend())
        self.used += len(lines)
        return lines

    def pair_lines(
        self, pf: ParameterFile, runs: Runs, refused: Sequence[Refused], path: str, no_life: str = ""
    ) -> list[Text]:
        """The laws of a pair, tool life, a prediction, the largest reservation with its remedy, the next commands.

        ``path`` is that of the parameter file, as it will be written.
        """
        name = pair_name(runs)
        if self.pairs > MOST_BLOCKS:
            return self._table_line(pf, name)
        computed = {one.role for one in runs.derived}
        pf = measured_first(pf, computed)
        verdicts = verdicts_of(pf)
        by_name = {verdict.of: verdict for verdict in verdicts}
        one = self.pairs == 1
        sections = [
            _simulated(pf, self) if one else _head(pf, name, self),
            _laws(
                pf, by_name, (*_not_fitted(refused, self), *(_unused(runs, pf, self) if one else ())), self, apart=one
            ),
            _life(pf, path, self, no_life, apart=one),
            _prediction(pf, by_name, path, self, apart=one),
            _reservation(pf, verdicts, self, apart=one),
            _next(pf, verdicts, path, self) if one else None,
        ]
        height = (self.height - self.used) if one else (self.height - self.used) // self.pairs
        return fitted([section for section in sections if section is not None], height, self.width)

    def _table_line(self, pf: ParameterFile, name: str) -> list[Text]:
        """One of many pairs on one line: its name, and its results by their verdicts; none where the screen is full."""
        self.used += 1
        if self.used > self.height:
            return []
        space = max(12, self.width // 3)
        head = shortened(name, space)
        line = Text(f"  {head}{' ' * (space - cell_len(head))}", no_wrap=True)
        for verdict in verdicts_of(pf):
            part = f" {self.icon(verdict.level)} {verdict.of}"
            if cell_len(line.plain) + cell_len(part) <= self.width:
                line.append(part, MARKS[verdict.level].colour)
        return [line]

    def _legend(self) -> Text:
        """Legend of the icons of a table."""
        line = Text()
        for level in (USABLE, RESERVATIONS, DO_NOT_USE):
            words = MARKS[level].words.removesuffix(" inside the tested region").removesuffix(" for control")
            line.append(f"{'   ' if line.plain else '  '}{self.icon(level)} {words}", MARKS[level].colour)
        return line


def rendered(lines: Iterable[Text]) -> RenderableType:
    """Lines as one block that is not wrapped again."""
    block = Text("\n").join(lines)
    block.no_wrap, block.overflow = True, "ignore"
    return Group(block)  # the console joins bare texts to one that it wraps


def _head(pf: ParameterFile, name: str, screen: FirstScreen) -> Section:
    """The name of one of several pairs, and whether it was measured."""
    simulated = "; NOT MEASURED" if pf.identity.simulated else ""
    return Section(((line_of(f"{name}{simulated}", screen.width, RED if simulated else BOLD),),))


def _simulated(pf: ParameterFile, screen: FirstScreen) -> Section | None:
    if not pf.identity.simulated:
        return None
    words = f"{screen.icon(DO_NOT_USE)} NOT MEASURED (simulated): not for use on a machine."
    return Section((tuple(wrapped(words, screen.width, RED, most=2)),))


def _not_fitted(refused: Sequence[Refused], screen: FirstScreen) -> Form:
    icon = screen.icon(DO_NOT_USE)
    return tuple(line_of(f"{icon} {one.response} is not fitted: {one.reason}", screen.width, RED) for one in refused)


def _unused(runs: Runs, pf: ParameterFile, screen: FirstScreen) -> Form:
    dropped = "; ".join(_dropped(law) for law in pf.laws.values() if law.dropped_rows)
    lines = wrapped(f"! rows not used: {dropped}", screen.width, YELLOW, most=2) if dropped else []
    same = constant_conditions(runs, pf)
    lines += [line_of(f"  all tests: {same}", screen.width)] if same else []
    return (*lines, *(line_of(f"! {words}", screen.width, YELLOW) for words in unused_conditions(runs, pf.laws)))


def _dropped(law: LawSection) -> str:
    """Number of rows that a law leaves out, with reasons: ``VB 30 (VB empty 21, lines 3, 4, ...; VB 0 9)``."""
    reasons = []
    for rows in law.dropped_rows:
        why = rows.reason.replace("missing", "empty").replace("zero or negative", "0 or less")
        lines = f", line{'s' if rows.count > 1 else ''} {', '.join(map(str, rows.lines[:3]))}" if rows.lines else ""
        reasons.append(f"{why}: {rows.count}{lines}{', ...' if rows.count > min(len(rows.lines), 3) else ''}")
    return f"{law.response} {sum(rows.count for rows in law.dropped_rows)} ({'; '.join(reasons)})"


def _laws(
    pf: ParameterFile, verdicts: dict[str, VerdictPart], others: Form, screen: FirstScreen, *, apart: bool = True
) -> Section:
    """Each law on a line with its verdict and why, and its equation; shorter: with that of the first that may be used.

    ``others`` are lines on laws that were not fitted, and on conditions in no law.
    """
    heads = {law.response: _law_head(law, verdicts[law.response], screen) for law in pf.laws.values()}
    full = [
        line
        for name, law in pf.laws.items()
        for line in (heads[name], *wrapped(short_equation(law), screen.width, most=2, indent=9, first=7))
    ]
    first = next((name for name, one in verdicts.items() if one.level != DO_NOT_USE and name in pf.laws), "")
    one = [line for name in heads for line in (heads[name], *_equation(pf, name if name == first else "", screen))]
    all_of = [line for name in heads for line in (heads[name], *_equation(pf, name, screen))]
    forms = [(*lines, *others) for lines in (full, all_of, one)]
    least = (*_grouped(pf, verdicts, screen), *_equation(pf, first, screen), *others[:2])
    return Section((*forms, least), (4, 9, 12 if len(heads) > MOST_BLOCKS else 13), apart)


def plain(reason: str) -> str:
    """A reason without the statistics in its brackets, which all tables have.

    >>> plain("Lack of fit (F(23, 27) = 3.68, p = .001): another form.")
    'Lack of fit: another form.'
    """
    return STATISTICS.sub("", reason)


def _equation(pf: ParameterFile, name: str, screen: FirstScreen) -> list[Text]:
    return [line_of(f"       {short_equation(pf.laws[name])}", screen.width)] if name else []


def _law_head(law: LawSection, verdict: VerdictPart, screen: FirstScreen) -> Text:
    """Icon, response, verdict and scatter, and rows and edges where the width allows."""
    mark = MARKS[verdict.level]
    what = f"; {law.quantity}{f', {law.unit}' if law.unit else ''}"
    edges = f" of {law.n_edges} edges" if law.n_edges else ""
    line = Text(f"{screen.icon(verdict.level)} {law.response:<4} {mark.words}", mark.colour)
    long = scatter_words(law)
    short = long.replace(" of one row", "").replace(" of one life", "")
    spread = long if cell_len(f"{line.plain}; {long}{what}") <= screen.width else short
    for part in (
        "; computed, not measured" if law.computed else "",
        *(f"{'; ' if i == 0 else ', '}{why}" for i, why in enumerate(short_reasons(law, verdict))),
        f"; {spread}" if spread else "",
        what,
        f"; {count(law.n, 'row')}{edges}",
    ):
        if cell_len(line.plain) + cell_len(part) <= screen.width:
            line.append(part, "not bold default")
    return line


def _grouped(pf: ParameterFile, verdicts: dict[str, VerdictPart], screen: FirstScreen) -> list[Text]:
    """The laws by their verdicts, the worst first, one line for each."""
    out = []
    for level in (DO_NOT_USE, None, RESERVATIONS, USABLE):
        names = [name for name in pf.laws if verdicts[name].level == level]
        if names:
            words = f"{screen.icon(level)} {', '.join(names)}: {MARKS[level].words}"
            out.append(line_of(words, screen.width, MARKS[level].colour))
    return out


def _life(pf: ParameterFile, path: str, screen: FirstScreen, no_life: str, *, apart: bool = True) -> Section | None:
    """Tool life with its interval and whether it is extrapolated, or why there is none."""
    part = tool_life_part(pf)
    if part is None:
        words = wrapped(f"Tool life: {no_life.removeprefix('tool life ')}", screen.width, most=2) if no_life else []
        return Section((tuple(words),), (), apart) if words else None
    mark = MARKS[part.verdict.level]
    head = Text(f"{screen.icon(part.verdict.level)} T    {mark.words}", mark.colour)
    options = pf.provenance.options
    assumed = " (assumed; --criterion)" if options and options.get("criterion") is None else ""
    what = f"; tool life to {part.criterion}{assumed}"
    if cell_len(head.plain + what) > screen.width:
        what = f"; to {part.criterion}{' (assumed)' if assumed else ''}"
    head.append(shortened(what, max(0, screen.width - cell_len(head.plain))), "not bold default")
    if part.verdict.level == DO_NOT_USE:
        unknown = f"unknown: {plain(' '.join(part.verdict.reasons[:2]))}"
        two, one = (wrapped(unknown, screen.width, RED, most=k, indent=7, first=7) for k in (2, 1))
        return Section(((head, *two), (head, *one)), (4.5,), apart)
    value = _life_value(part, edge_or_row(pf), life_doubt(pf))
    values = wrapped(value, screen.width, most=2, indent=7, first=7)
    longest = f"the longest test ({quantity(part.longest)})"
    if part.extrapolated:
        where = wrapped(f"EXTRAPOLATED: {_ratio(part)} {longest}", screen.width, YELLOW, most=1, first=7)
    else:
        where = wrapped(f"{_ratio(part)} {longest}", screen.width, most=1, first=7)
    taylor = pf.tool_life.taylor if pf.tool_life else None
    C = format_plain(taylor.C, 4 if taylor.C >= 1000 else 3) if taylor else ""
    constants = f"; Taylor n {taylor.n:.2g}, C {C} {taylor.unit}" if taylor else ""
    if cell_len(where[-1].plain + constants) <= screen.width:
        where[-1].append(constants, "not bold default")
    kept = where if part.extrapolated else []
    command = command_lines(_with_path(part.command, path), screen.width)
    forms = (
        (head, *values, *where, *command),
        (head, *values, *where),
        (head, *values, *kept),
        (head, line_of(f"       {value}", screen.width), *kept),
    )
    return Section(forms, (1.5, 4.5, 14), apart)


def _with_path(command: str, path: str) -> list[str]:
    """Words of a command on the parameter file of this path."""
    return [path if word == FILE else word for word in shlex.split(command)]


def _ratio(part: ToolLifePart) -> str:
    """``5.2 times`` the longest test, with the decimals of a ratio that is little above 1; or ``within`` it."""
    ratio = (part.typical.value or 0.0) / (part.longest.value or 1.0)
    return f"{ratio:.{2 if part.extrapolated else 3}g} times" if ratio >= 1.005 else "within"


def _life_value(part: ToolLifePart, of: str, doubt: str) -> str:
    """``99 min, new edge 51 to 195 min (95 % interval), at V 100 m/min, f 0.19 mm/rev``; ``doubt``: why not."""
    at = f", at {part.at}" if part.at else ""
    if not part.edge_low.text:
        return f"{quantity(part.typical)}, no interval{f' of a new edge ({doubt})' if doubt else ''}{at}"
    unit = part.typical.unit if part.edge_high.value is not None else ""
    ends = f"{part.edge_low.text} to {part.edge_high.text} {unit}".rstrip()
    return f"{quantity(part.typical)}, {of} {ends} (95 % interval){at}"


def worked_prediction(pf: ParameterFile, verdicts: dict[str, VerdictPart]) -> WorkedPart | None:
    """The prediction of the first law that may be used, that of wear or of lives before others; None without one."""
    laws = [law for law in pf.laws.values() if verdicts[law.response].level != DO_NOT_USE]
    for law in sorted(laws, key=lambda law: law.response not in WEAR):
        if found := worked_predictions(pf, law):
            return found[0]
    return None


def _prediction(
    pf: ParameterFile, verdicts: dict[str, VerdictPart], path: str, screen: FirstScreen, *, apart: bool = True
) -> Section | None:
    """A prediction at the middle of the tests, and the command that makes it."""
    found = worked_prediction(pf, verdicts)
    if found is None:
        if not any(verdict.level == DO_NOT_USE for verdict in verdicts.values()):
            return None
        none = line_of(f"{screen.icon(DO_NOT_USE)} No prediction: no law of this file may be used.", screen.width, RED)
        return Section(((none,),), (), apart)
    words = _with_path(found.command, path)
    command = command_lines(words, screen.width)
    value = f"{words[3]} {quantity(found.value)}"
    ends = f"{quantity(found.level)} prediction interval {found.low.text} to {quantity(found.high)}"
    where = found.at or "these conditions"
    low_high = f"{quantity(found.level)} prediction interval {found.low.text} to {found.high.text}"
    text = f"At {where}: {value}; {ends} ({found.of})"
    outside = [] if found.inside else wrapped(OUTSIDE, screen.width, YELLOW, first=2)
    texts = (wrapped(text, screen.width, most=3), wrapped(text.removesuffix(f" ({found.of})"), screen.width, most=2),
             wrapped(f"{value} ({low_high}) at {where}", screen.width, most=3))  # fmt: skip
    forms = [(*lines, *outside, *command) for lines in texts]
    return Section((*forms, (*texts[-1], *outside)), (4.05, 7, 12.5), apart)


def _reservation(
    pf: ParameterFile, verdicts: Sequence[VerdictPart], screen: FirstScreen, *, apart: bool = True
) -> Section | None:
    """The first reason of the worst verdict, with its remedy and the command that does it."""
    held = with_reasons(verdicts)
    if not held:
        return None
    worst = held[0]
    ((why, remedy),) = main_reason(worst)
    style = MARKS[worst.level].colour
    n = sum(len(one.reasons) for one in held) - 1
    more = f"; {n} more: --full" if n else ""
    head = "Do not use" if worst.level == DO_NOT_USE else "Largest reservation"
    reason = f"{screen.icon(worst.level)} {head} ({worst.of}{more}): {plain(why)}"
    text = f"Remedy: {remedy.words}" if remedy else ""
    words = [wrapped(text, screen.width, most=k, indent=4, first=2) if text else [] for k in (1, 2)]
    command = command_lines(shlex.split(remedy.command), screen.width) if remedy and remedy.command else []
    law = pf.laws.get(worst.of)
    short = ", ".join(short_reasons(law, worst)) if law else ""
    reasons = [wrapped(reason, screen.width, style, most=k) for k in (1, 2, 3)]
    if short:
        reasons[0] = wrapped(reason.replace(plain(why), short), screen.width, style, most=1)
    forms = [(*reasons[k], *words[j], *command) for k, j in ((2, 1), (1, 1), (1, 0))]
    least = tuple(reasons[0])
    return Section((*forms, (*least, *command), least, ()), (2, 4, 8, 9.5, 12), apart)


def _next(pf: ParameterFile, verdicts: Sequence[VerdictPart], path: str, screen: FirstScreen) -> Section | None:
    """The next commands as they are typed, the most useful first."""
    done = remedy_command(verdicts)
    found = [(words, why) for words, why in next_commands(pf, verdicts, path) if list(words) != done]
    commands = [command_lines(words, screen.width, why) for words, why in found]
    if not commands:
        return None
    head = Text("Next", BOLD)
    forms = tuple((head, *(line for one in commands[:k] for line in one)) for k in range(len(commands), 0, -1))
    return Section(forms, (1, 2, 6)[-(len(forms) - 1) :] if len(forms) > 1 else ())
