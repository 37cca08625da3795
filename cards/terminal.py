"""Terminal output of the main job and of an identification, from the same parts as the card."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..core.display import TextTable, display_of
from ..core.intervals import t_quantile
from ..core.rounding import count
from ..core.verdict import MARKS, RESERVATIONS, USABLE, Verdict
from ..datasets import Runs
from ..fit import LawFit
from ..fit.available import computed
from ..fit.defaults import Refused
from ..fit.display import forms_table, predictions_table
from ..fit.form_comparison import FormComparison
from ..fit.statsmodels_ols import TOLERANCE
from ..parameters import ParameterFile
from ..parameters.gather.description import unused_conditions
from .content.dynamics import dynamics_part
from .content.laws import about_intervals, law_part
from .content.numbers import fact_line, sentence
from .content.parts import LawPart, SuspectPart, VerdictPart
from .content.posterior import EXPLANATIONS
from .content.tables import check_table, coefficient_table, holds_words
from .content.tool_life import tool_life_part
from .content.verdicts import sorted_by_level, verdicts_of
from .reading_terminal import Command, lines_of

if TYPE_CHECKING:
    from ..datasets import Record
    from ..fit.statsmodels_ols import StatsmodelsComparison
    from ..ident.identification import Identification
    from ..ident.physical_models.drive import DriveFit
    from ..ident.physical_models.force_process import ForceProcess
    from ..ident.physical_models.step_response import StepFit

NOTHING = (
    "no law can be fitted to these columns. A law needs a response (wear AW or VB, tool life T, a force, P, M, I, Ra, "
    "Rz or theta) and at least one condition that varies: V or n, f or fz or fm, d, ae, t. Assign columns with --map, "
    'for instance --map "VB=col7".'
)
WRAPPED = {
    "coefficient": "",
    "SE, rows independent": "SE, rows\nindependent",
    "published value": "published\nvalue",
    "without the suspects": "without the\nsuspects",
}
DISPENSABLE = ("published value", "SE, rows independent", "without the suspects")  # columns, in the order they go
KIENZLE = ("kc1.1 ", "kf1.1 ", "kp1.1 ", "Entering angle kappa")  # notes that stand below the equation
MOST_WRAPPED = 15  # columns by which the names of checks are wrapped, before statistics stand below them


def pair_head(runs: Runs) -> RenderableType:
    """Title of a pair, with its rows."""
    title = Text(f"{runs.tool} on {runs.work}", style="bold underline")
    simulated = ", not measured: " + runs.disclaimers[0] if runs.simulated else ""
    title.append(f"   {count(len(runs), 'row')}{simulated}", "not bold")
    return Padding(title, (0, 0, 1, 0))


def pair_blocks(runs: Runs, pf: ParameterFile, refused: Sequence[Refused], command: Command) -> list[RenderableType]:
    """The verdicts, every law of a pair, tool life, inference, laws that were not fitted, and conditions in no law.

    ``command`` makes the whole command of an option that corrects values.
    """
    laws = [law_part(pf, law) for law in pf.laws.values()]
    life = tool_life_part(pf)
    blocks = [verdicts_block(verdicts_of(pf)), *(_law_block(law, command) for law in laws)]
    if life is not None:
        head = Text.assemble(("T  tool life", "bold"), "   ", _verdict_text(life.verdict))
        blocks.append(_block(head, *_reasons(life.verdict), *_texts([life.equation, *life.words])))
    blocks.append(Padding(Text(about_intervals(pf)), (0, 0, 1, 0)))
    others = [*map(_refusal, refused), *unused_conditions(runs, pf.laws)]
    return [*blocks, Text("\n".join(others) + "\n")] if others else blocks


def verdicts_block(verdicts: Sequence[VerdictPart]) -> RenderableType:
    """The verdict on each result, with its first reason."""
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column()
    for verdict in verdicts:
        words = _verdict_text(verdict)
        words.append(f": {verdict.first}" if verdict.first else "", "not bold default")
        table.add_row(verdict.of, words)
    return Group(Text("Verdicts", style="bold"), Padding(table, (0, 0, 1, 2)))


def verdicts_reminder(pf: ParameterFile) -> str:
    """One line on the verdicts, for the end of the output; empty where every result is usable."""
    verdicts = [verdict for verdict in verdicts_of(pf) if verdict.level != USABLE]
    named = [f"{', '.join(of)} {words}" for words, of in sorted_by_level(verdicts)]
    return f"Verdicts: {'; '.join(named)}: see the reasons above." if named else ""


def comparison_block(comparisons: "Sequence[StatsmodelsComparison]") -> RenderableType:
    """Largest relative differences of the laws from statsmodels, and what was not compared."""
    rows = tuple((one.response, name, f"{value:.1e}") for one in comparisons for name, value in one.differences.items())
    missing = (
        f"{one.response}: {name} not compared: {reason}."
        for one in comparisons for name, reason in one.not_compared.items()
    )  # fmt: skip
    head = comparison_line(comparisons)
    table = [_table(TextTable(("law", "compared", "relative difference"), rows))] if rows else []
    return _block(head, *table, *_texts(missing))


def comparison_line(comparisons: "Sequence[StatsmodelsComparison]") -> Text:
    """The largest relative difference of the laws from statsmodels."""
    line = Text(f"Comparison with statsmodels {comparisons[0].version}", style="bold")
    largest = max(one.largest for one in comparisons)
    compared = any(one.differences for one in comparisons)
    return line.append(
        f"   largest relative difference {largest:.1e}, limit {TOLERANCE:.0e}" if compared else "", "not bold"
    )


def surface_blocks(laws: Sequence[LawFit]) -> list[RenderableType]:
    """Terms of each law of second order with their own error terms and tests, and its canonical analysis."""
    from ..fit.surface import display, surfaces  # noqa: F401  registers the display

    blocks = []
    for law in laws:
        if law.formula.first_order or law.rows is None:
            continue
        found = computed(partial(surfaces.surface_of, law))
        if isinstance(found, surfaces.ResponseSurface):
            shown = display_of(found)
            table = [] if shown.table is None else [_table(shown.table)]
            facts = [Text(f"{name}: {value}", style="dim") for name, value in shown.facts]
            sentences = [words for words in shown.sentences if words not in law.notes]
            head = Text(f"{law.response}  tests of its terms", "bold")
            blocks.append(_block(head, *table, *facts, *_texts(sentences)))
    return blocks


def forms_block(found: FormComparison) -> RenderableType:
    """The preferred form of a law; each form with its errors and weight; what forms predict at tested settings."""
    head = Text(f"{found.response} of {', '.join(found.factors)}", style="bold")
    edges = f" of {found.units} edges" if found.left_out == "edge" else ", no edges"
    head.append(f"   {found.rows} rows{edges}", style="not bold")
    style = MARKS[USABLE if found.preferred.name == found.default else RESERVATIONS].colour
    missing = tuple(f"{name} cannot be fitted: {sentence(why.reason)}" for name, why in found.not_fitted.items())
    unit = f", {found.unit}" if found.unit else ""
    return _block(
        head, Text(found.verdict.removeprefix(f"{found.response}: "), style=style), _table(forms_table(found)),
        Text(f"error: of left-out {found.left_out}s, root mean square; weight: from AICc; middle: prediction there",
             style="dim"), *_texts(found.remarks),
        Text(f"Predictions at the middle of the ranges and at tested settings where the forms differ most{unit}:"),
        _table(_folded(predictions_table(found))), *_texts(missing),
    )  # fmt: skip


def _folded(table: TextTable) -> TextTable:
    """The table with the words of a heading below each other."""
    return TextTable(tuple(head.replace("-", "-\n") for head in table.header), table.rows)


def keep_block(preferred: Mapping[str, str], command: Command) -> RenderableType:
    """The command that keeps the preferred forms, or any other."""
    if preferred:
        chosen = " ".join(f"--form {name}={form}" for name, form in preferred.items())
        words = "Keep the preferred form" + ("s:" if len(preferred) > 1 else ":")
    else:
        words = "The command without --form keeps the usual forms. To keep another, of all laws or of one (Ra=FORM):"
        chosen = "--form FORM"
    return Group(Text(words), Text(f"  {command(chosen)}", no_wrap=True, overflow="ignore"), Text())


def nothing_fitted(runs: Runs, refused: Sequence[Refused]) -> str:
    """The reasons why a pair has no law at all, or which responses and conditions were seen."""
    reasons = " ".join(map(_refusal, refused)) or f"{NOTHING} {_seen(runs)}"
    return f"{runs.tool} on {runs.work}: {reasons}"


def _seen(runs: Runs) -> str:
    """Responses, conditions that vary and conditions that are constant in a file."""
    from ..fit.defaults import RESPONSES, SETTINGS, Held

    held = Held.of_runs(runs)
    conditions = list(filter(held.has, SETTINGS))
    found = {
        "responses": list(filter(held.has, RESPONSES)),
        "conditions that vary": list(filter(held.varies, conditions)),
        "constant": [name for name in conditions if not held.varies(name)],
    }
    each = (f"{what} {', '.join(names) or 'none'}" for what, names in found.items())
    left = [use.header for use in runs.columns if use.role is None and use.header in runs.data]
    unused = [repr(name) for name in left if runs.data[name].dtype.kind == "f"]
    more = f"; not used {', '.join(unused[:6])}{', ...' * (len(unused) > 6)}" if unused else ""
    return f"Seen: {'; '.join(each)}{more}."


def identification_block(found: "Identification", pf: ParameterFile) -> RenderableType:
    """The model of an identification, its facts, the choice of its orders, and the verdicts of its validation."""
    model, rec = dynamics_part(pf.dynamics), found.record
    assert model is not None  # noqa: S101  collected from a model
    runs = f", {len(rec.starts)} segments" if len(rec.starts) > 1 else ""
    head = Text(model.title, style="bold")
    head.append(f"   {len(rec)} samples at {rec.rate:g} Hz{runs}   ", style="not bold")
    head.append_text(_verdict_text(model.verdict))
    facts = [item for item in model.facts if not item.name.startswith("SHA-256")]
    sentences = [
        line
        for line in found.verdicts
        if sentence(line) not in model.verdict.reasons and not line.startswith("Converged after")
    ]
    form = "" if found.form is None or found.by_choice else found.form.words
    kept = [line for line in model.sentences if line != form and not line.startswith("Converged after")]
    if found.amplitudes is not None and not found.amplitudes.level:
        sentences.append(sentence(found.amplitudes.sentence))
    checked = f"Checked: {', '.join(model.verdict.checked)}" if model.verdict.checked else ""
    left = f"Not checked: {'; '.join(model.verdict.not_checked)}" if model.verdict.not_checked else ""
    lines = [found.argument, *kept, fact_line(facts), *sentences, *filter(None, (checked, left))]
    words = _texts(line if line.endswith(".") else f"{line}." for line in dict.fromkeys(lines))
    table = _table(coefficient_table(model.coefficients))
    sizes = [] if found.amplitudes is None else [_table(found.amplitudes.table)]
    details = (Text("Details", style="bold"), Text(model.equation), table, *sizes, *words)
    return _block(head, *_reasons(model.verdict), *_texts([form, _summary(found)]), *details)


def _summary(found: "Identification") -> str:
    """Summary of a model for an engineer: fit to samples not fitted, settling, delay, noise and band."""
    from ..ident.validation.model_validation import settling_time

    model, rec, fit = found.model, found.record, found.validation.fit
    settled = settling_time(model)
    ends = f"settles in {settled:.3g} s" if math.isfinite(settled) else "does not settle"
    noise = math.sqrt(model.noise_variance or 0.0)
    low, high = model.band or (math.nan, math.nan)
    parts = (
        f"simulation fit {fit:.0f} % ({found.validated_on})" if math.isfinite(fit) else "",
        f"{rec.output} {ends} after a step of {rec.input}",
        f"delay {found.dead_time:.3g} s" if found.dead_time else "no delay",
        f"noise {noise:.2g} {model.unit_y}".rstrip() if noise else "",
        f"valid from {low:.2g} to {high:.2g} Hz" if model.band else "",
    )
    return sentence("; ".join(filter(None, parts)))


def physical_block(
    fit: "StepFit | DriveFit | ForceProcess", verdict: Verdict, records: "Sequence[Record]", held_out: str = ""
) -> RenderableType:
    """A physical model: its verdict with the reasons, its estimates, what was checked, and how the record was read.

    ``held_out`` is a sentence on its simulation of other samples.
    """
    from ..core.display import estimates

    rec = records[0]
    runs = f", {len(records)} runs" if len(records) > 1 else ""
    head = Text(f"{rec.output} from {rec.input}", style="bold")
    head.append(f"   {sum(map(len, records))} samples at {rec.rate:g} Hz{runs}   ", style="not bold")
    head.append(f"{verdict.mark.icon} {verdict.words}", style=verdict.mark.colour)
    names = [str(name).replace("_", " ") for name in fit.params.index]
    half = t_quantile(fit.df) * fit.bse
    low, high = ((fit.params + sign * half).tolist() for sign in (-1, 1))
    table = estimates(names, fit.params, fit.bse, low, high, units=[fit.units[str(n)] for n in fit.params.index])
    sentences = [words for words in (*fit.remarks, held_out) if words not in verdict.reasons]
    checked = [f"Checked: {', '.join(verdict.checked)}."]
    left = [f"Not checked: {'; '.join(verdict.not_checked)}."] if verdict.not_checked else []
    notes = [sentence(note) for note in fit.notes]
    return _block(head, *map(_item, verdict.reasons), _table(table), *_texts([*sentences, *checked, *left, *notes]))


def _law_block(law: LawPart, command: Command) -> RenderableType:
    unit = f", {law.unit}" if law.unit else ""
    head = Text.assemble((f"{law.response}  {law.quantity}{unit}", "bold"), "   ", _verdict_text(law.verdict))
    edges = f"By edge: {fact_line(law.by_edge)}." if len(law.by_edge) > 1 else fact_line(law.by_edge)
    posterior = [] if law.posterior is None else [s for s in law.posterior.sentences if s not in EXPLANATIONS]
    constants = [words for words in law.cautions if words.startswith(KIENZLE)]
    cautions = [words for words in law.cautions if words not in constants]
    return _block(
        head,
        *_reasons(law.verdict),
        *(line for suspect in law.suspects for line in _suspect_lines(suspect, command)),
        Text(law.equation),
        *_texts(constants),
        Text(f"{law.form}; {law.structure}", style="dim"),
        _table(coefficient_table(law.coefficients, law), (*DISPENSABLE[:1], law.other_heading, *DISPENSABLE[1:])),
        *_texts([law.without_words, f"{fact_line(law.statistics)}.", edges, law.edge_words]),
        *_texts([law.composite_words, law.printed_words]),
        *([_table(check_table(law.checks))] if law.checks else []),
        *_texts([*law.check_words, *posterior, *cautions]),
    )


def _verdict_text(verdict: VerdictPart) -> Text:
    return Text(f"{verdict.mark.icon} {verdict.words}", style=verdict.mark.colour)


def _reasons(verdict: VerdictPart) -> list[RenderableType]:
    """The reasons of a verdict, each as an item of a list."""
    return [_item(reason) for reason in verdict.reasons]


def _item(sentence: str) -> RenderableType:
    line = Table.grid(padding=(0, 1))
    line.add_column(no_wrap=True)
    line.add_column()
    line.add_row("-", Text(sentence))
    return line


def _suspect_lines(suspect: SuspectPart, command: Command) -> list[RenderableType]:
    """The suspects, and on a line of its own the command that corrects it or leaves it out."""
    lines = lines_of(command(suspect.remedy)).split("\n")
    shown = Text("\n".join(f"{'':6}{line}" for line in lines), style="bold", no_wrap=True, overflow="ignore")
    return [_item(f"{suspect.words}:"), shown]


@dataclass(frozen=True, slots=True)
class _Fitted:
    """A table that is made for the width at which it is printed.

    Where the width does not suffice, dispensable columns go, the first ones first; then the statistic of a check stands
    below its name, and intervals and words are wrapped. No digit is cut off.
    """

    table: TextTable
    dispensable: tuple[str, ...] = ()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        table = _narrow(self.table, self.dispensable, options.max_width)
        if _width(table) - options.max_width > MOST_WRAPPED and table.header[:2] == ("check", "statistic"):
            rows = ((f"{name}\n  {value}" if value else name, *rest) for name, value, *rest in table.rows)
            table = TextTable((table.header[0], *table.header[2:]), tuple(rows))
        yield _grid(table, fits=_width(table) <= options.max_width)


def _table(table: TextTable, dispensable: Sequence[str] = ()) -> _Fitted:
    """The table at the width of the output, without dispensable columns where that is narrow."""
    return _Fitted(table, tuple(dispensable))


def _grid(table: TextTable, *, fits: bool) -> Table:
    """Names and words aligned left, numbers right; the first column without a heading where it names coefficients."""
    shown = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for j, heading in enumerate(table.header):
        left = holds_words(table, j)
        whole = fits or table.header[0] == "check" or not any(" " in row[j].strip() for row in table.rows)
        words = _wrapped(heading)
        shown.add_column(
            words, justify="left" if left else "right", no_wrap=whole and heading != "check", overflow="fold"
        )
    for row in table.rows:
        shown.add_row(*map(Text, row))
    return shown


def _wrapped(heading: str) -> str:
    """A heading on its lines; none above the names of coefficients."""
    return WRAPPED.get(heading, heading.replace(" (", "\n("))


def _narrow(table: TextTable, dispensable: Sequence[str], width: int) -> TextTable:
    """The table without those dispensable columns, first ones first, that the width has no space for."""
    for name in dispensable:
        if _width(table) > width and name in table.header:
            j = table.header.index(name)
            header, *rows = (row[:j] + row[j + 1 :] for row in (table.header, *table.rows))
            table = TextTable(header, tuple(rows))
    return table


def _width(table: TextTable) -> int:
    """Columns of the terminal that a table needs."""
    columns = zip(*table.rows, strict=True)
    heads = (max(map(len, _wrapped(heading).split("\n"))) for heading in table.header)
    cells = ((head, *(len(line) for cell in column for line in cell.split("\n")))
             for head, column in zip(heads, columns, strict=True))  # fmt: skip
    return sum(2 + max(lengths) for lengths in cells) - 2


def _block(head: Text, *lines: RenderableType) -> RenderableType:
    """A heading and its indented lines; commands stay in one piece, however long they are."""
    parts = [line if isinstance(line, Text) and line.no_wrap else Padding(line, (0, 0, 0, 2)) for line in lines]
    return Group(head, *parts, Text())


def _texts(sentences: Iterable[str]) -> list[RenderableType]:
    return [Text(sentence) for sentence in sentences if sentence]


def _refusal(item: Refused) -> str:
    return f"{item.response} is not fitted: {item.reason.removeprefix(f'{item.response}: ')}"
