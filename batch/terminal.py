"""Terminal output of a batch: source, laws, comparison of families, pairs that need attention, written files."""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..core.progress import grouped
from ..core.rounding import count, decimals, format_plain, format_rounded
from ..core.verdict import DO_NOT_USE, LEVELS, NOT_JUDGED, RESERVATIONS, USABLE
from ..datasets.columns import ColumnUse
from ..datasets.vocabulary import ROLES
from ..fit.many.pooling import WHOLE
from .comparison import LAW, Comparison, largest_families
from .plan import Plan
from .result import Batch, Effort
from .source.common import LAB, some_names

if TYPE_CHECKING:
    from ..cards.publishing.pair import PublicationProblem

MOST_LISTED = 8  # kinds of attention, sentences on the source
NAMED = 20  # unreadable parts that are named without their reason
QUARTERS = (0.25, 0.5, 0.75)


def source_block(plan: Plan, most: int = MOST_LISTED) -> RenderableType:
    """Contents of the source, with at most so many sentences of a kind."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    table.add_row("source", f"{plan.name}: {_kind(plan)}; {grouped(plan.rows)} rows, {_pairs(len(plan.pairs))}")
    table.add_row("in blocks", _blocks(plan))
    used = [use for use in plan.columns if use.role is not None]
    if used:
        table.add_row("columns", Text("\n".join(map(_column, used))))
    if plan.reading.groups:
        table.add_row("grouped by", Text(", ".join(map(repr, plan.reading.groups))))
    unused = [use.header for use in plan.columns if use.role is None and use.header not in plan.reading.groups]
    if unused:
        table.add_row("not used", Text(", ".join(map(repr, unused))))
    if plan.assumed:
        table.add_row("assumed", Text("\n".join(_shortened(plan.assumed, most))))
    if plan.unreadable:
        table.add_row("not read", Text("\n".join(_not_read(plan.unreadable, most))))
    return _section(Text("Input", style="bold"), table)


def batch_blocks(made: Batch, most: int = MOST_LISTED) -> Iterator[RenderableType]:
    """Results of a batch: laws, comparison, attention, files; at most so many kinds of attention."""
    yield laws_block(made)
    if len(made.comparison.families):
        yield comparison_block(made.comparison)
    if made.concerns:
        yield attention_block(made, most)
    late = {name: why for name, why in made.unreadable.items() if name not in made.plan.unreadable}
    if late:
        yield _section(Text("Not readable during the fit", style="bold"), Text("\n".join(_not_read(late, most))))
    verb = "Written" if made.changed else "Unchanged"
    yield Text("\n".join([*made.warnings, *_effort(made.effort), f"{verb}: {made.out}/ ({', '.join(made.written)})"]))
    yield from _site(made)


def laws_block(made: Batch) -> RenderableType:
    """For each law the number of pairs, R2 and the quartiles of each parameter."""
    laws = made.results[made.results["reason"] == ""]
    title = Text(f"Laws of {grouped(made.with_law)} of {_pairs(made.pairs)}", style="bold")
    if made.simulated:
        title.append(f"   {grouped(made.simulated)} of them simulated, not measured", style="not bold red")
    blocks: list[RenderableType] = [title]
    for key, rows in laws.groupby(["response", "form"], sort=False):
        response, form = map(str, key)
        role = ROLES.get(response)
        quantity = "" if role is None else f"  {role.quantity}, {role.unit}" if role.unit else f"  {role.quantity}"
        head = f"{response}{quantity}: {form.replace('_', ' ')}, {_pairs(len(rows))}"
        blocks += [
            Text(head),
            Padding(Text(_verdict_words(rows)), (0, 0, 0, 2)),
            Padding((_values if len(rows) == 1 else _quarters)(rows, form), (0, 0, 1, 2)),
        ]
    return Group(*blocks) if len(laws) else Padding(Group(*blocks), (0, 0, 1, 0))


def _verdict_words(rows: pd.DataFrame) -> str:
    """The number of laws of each verdict, the worst first."""
    counts = rows["verdict"].value_counts()
    order = (LEVELS[DO_NOT_USE], NOT_JUDGED, LEVELS[RESERVATIONS], LEVELS[USABLE])
    named = "; ".join(f"{grouped(int(counts[words]))} {words}" for words in order if words in counts)
    return f"verdicts: {named}"


def _quarters(rows: pd.DataFrame, form: str) -> Table:
    """Quartiles of each parameter over the pairs."""
    table = _right_aligned("first quartile", "median", "third quartile")
    for label, column in _quantities(rows, form):
        table.add_row(label, *(format_plain(float(v), 3) for v in rows[column].astype(float).quantile(list(QUARTERS))))
    return table


def _values(rows: pd.DataFrame, form: str) -> Table:
    """Each parameter of a single pair, with its interval where it has one."""
    law = rows.iloc[0]
    columns = dict(_quantities(rows, form))
    intervals = {}
    for label, column in columns.items():
        low, high = (float(law.get(column.replace("params_", end, 1), nan)) for end in ("low_", "high_"))
        if column.startswith("params_") and isfinite(low) and isfinite(high):
            intervals[label] = f"{format_plain(low, 4)} to {format_plain(high, 4)}"
    table = _right_aligned("", f"95 % by {'edge' if law['by_edge'] else 'row'}" if intervals else "")
    for label, column in columns.items():
        table.add_row(label, format_plain(float(law[column]), 4), intervals.get(label, ""))
    return table


def _right_aligned(*heads: str) -> Table:
    table = _table()
    table.add_column("")
    for words in heads:
        table.add_column(words, justify="right")
    return table


def attention_block(made: Batch, most: int = MOST_LISTED) -> RenderableType:
    """Kinds of concern, the number of pairs with each, and one example."""
    needing = made.attention[["tool", "work"]].drop_duplicates()
    table = _table()
    table.add_column("why", no_wrap=True)
    table.add_column("pairs", justify="right", no_wrap=True)
    table.add_column("example")
    for item in made.concerns[:most]:
        table.add_row(item.kind, grouped(item.pairs), Text(f"{item.examples[0]}: {item.words[0]}"))
    rest = len(made.concerns) - most
    more = [Text(f"{count(rest, 'more kind')} in attention.csv")] if rest > 0 else []
    verb = "needs" if len(needing) == 1 else "need"
    head = Text(f"{grouped(len(needing))} of {_pairs(made.pairs)} {verb} attention", style="bold")
    return _section(head, table, *more)


def facts(made: Batch) -> dict[str, object]:
    """The same for programs, schema ``fitmodels.batch-report/1`` but for its name."""
    return {
        "source": made.plan.name,
        "out": str(made.out),
        "pairs": made.pairs,
        "pairs_with_a_law": made.with_law,
        "pairs_simulated": made.simulated,
        "rows": made.plan.rows,
        "assumed": list(made.plan.assumed),
        "unreadable": dict(made.unreadable),
        "warnings": list(made.warnings),
        "attention": [
            {"kind": item.kind, "pairs": item.pairs, "examples": list(item.examples), "words": list(item.words)}
            for item in made.concerns
        ],
        "families": _families(made.comparison),
        "engine": made.effort.where,
        "fitted": made.effort.fitted,
        "kept": made.effort.kept,
        "seconds": round(made.effort.seconds, 3),
        "memory_bytes": made.effort.memory,
        "written": list(made.written),
        "changed": made.changed,
        "site": None if made.site is None else made.site.facts(),
    }


def _families(comparison: Comparison) -> list[dict[str, object]]:
    rows = comparison.families.astype(object).where(comparison.families.notna(), None)
    return [{str(name): value for name, value in row.items()} for row in rows.to_dict("records")]


def _quantities(rows: pd.DataFrame, form: str) -> Iterator[tuple[str, str]]:
    """Label and column of each quantity of a law."""
    yield "R2", "rsquared"
    for name in rows:
        parameter = str(name).removeprefix("params_")
        if str(name).startswith("params_") and rows[name].notna().any():
            yield (f"{parameter} exponent" if form == "power" and parameter != "c0" else parameter), str(name)


def _effort(e: Effort) -> Iterator[str]:
    if e.fitted:
        rate = f", {_rate(e.fitted / e.seconds)} a second" if e.seconds > 0 and e.fitted > 1 else ""
        size = max(e.memory, e.memory_here)
        memory = f"; peak memory of a process {size / 1e6:.0f} MB" if size else ""
        yield f"Fitted {_pairs(e.fitted)} in {_seconds(e.seconds)} by {e.where}{rate}{memory}."
    if e.kept:
        yield f"Kept {_pairs(e.kept)} from before: their rows and the options are the same."


def _rate(rate: float) -> str:
    return grouped(round(rate)) if rate >= 99.5 else format_plain(rate, 2)


def _site(made: Batch) -> Iterator[RenderableType]:
    if made.site is None or made.site.ok:
        return
    problems = made.site.problems
    wrong = len({problem.folder for problem in problems})
    yield Text(f"No site was written: {grouped(wrong)} of {_pairs(made.site.found)} cannot be published yet.")
    yield Padding(Text("\n".join([*_missing_fields(problems, made.out), *_other_problems(problems)])), (0, 0, 0, 2))


def _missing_fields(problems: "Sequence[PublicationProblem]", out: Path) -> Iterator[str]:
    """Fields that are still missing, and their files."""
    fields = {name for problem in problems for name in problem.fields}
    shared = sorted(fields - {"iso513"})
    if shared:
        yield f"missing: {', '.join(shared)}; fill in {out}/pairs/card.toml, which holds for all pairs."
    if "iso513" in fields:
        lacking = some_names(problem.folder for problem in problems if "iso513" in problem.fields)
        yield (
            f"missing: the ISO 513 group of the material of {lacking}; give it with --pairs TABLE, with the names as "
            "they are in the data. It is written into the parameter files, so these pairs are fitted again."
        )
    if fields:
        yield f"Then run the same command again{'' if 'iso513' in fields else '; no pair is refitted'}."


def _other_problems(problems: "Sequence[PublicationProblem]") -> list[str]:
    """Other reasons against publication; equal reasons of several pairs once."""
    folders: dict[str, list[str]] = {}
    for problem in problems:
        if not problem.fields:
            folders.setdefault(problem.words, []).append(problem.folder)
    return _shortened([
        f"{of[0]}{f' and {grouped(len(of) - 1)} more' if len(of) > 1 else ''}: {words}"
        for words, of in folders.items()
    ])  # fmt: skip


def _seconds(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 100 else f"{seconds / 60:.1f} min"


def _pairs(n: int) -> str:
    return f"{grouped(n)} pair{'' if n == 1 else 's'}"


def _column(use: ColumnUse) -> str:
    role = ROLES[use.role or ""]
    unit = f"{use.unit} converted to {role.unit}" if use.converted else use.unit or role.unit
    return f"{role.symbol:<4} {role.quantity} <- {use.header!r}{f', {unit}' if unit else ''}"


def _blocks(plan: Plan) -> str:
    whole = [block.rows for block in plan.blocks if not block.streamed]
    streamed = [block.rows for block in plan.blocks if block.streamed]
    lines = [f"{grouped(len(whole))}, of at most {grouped(max(whole))} rows in memory at a time"] if whole else []
    if streamed:
        of = "of" if len(streamed) == 1 else "of up to"
        lines.append(f"{_pairs(len(streamed))} {of} {grouped(max(streamed))} rows, streamed chunk by chunk")
    return "; ".join(lines) or "none"


def _kind(plan: Plan) -> str:
    if plan.kind != "files":
        return "Parquet" if Path(plan.name).suffix.lower() not in LAB else "a text file, read through a Parquet copy"
    n = len({piece.path for block in plan.blocks for piece in block.pieces}) + len(plan.unreadable)
    return f"{grouped(n)} lab file{'' if n == 1 else 's'}"


def _not_read(reasons: Mapping[str, str], most: int) -> list[str]:
    """Each unreadable part of a source with its reason; of many the rest by name only."""
    lines = [why if name.split("/")[-1] in why else f"{name}: {why}" for name, why in reasons.items()]
    rest = list(reasons)[most:]
    others = f" and {grouped(len(rest) - NAMED)} others" if len(rest) > NAMED else ""
    return [*lines[:most], f"and {grouped(len(rest))} more: {', '.join(rest[:NAMED])}{others}"] if rest else lines


def _shortened(sentences: Sequence[str], most: int = MOST_LISTED) -> list[str]:
    rest = len(sentences) - most
    return list(sentences) if rest <= 0 else [*sentences[:most], f"and {grouped(rest)} more"]


def _table(between: int = 2) -> Table:
    """An empty table with blanks between its columns."""
    return Table(box=None, pad_edge=False, padding=(0, between, 0, 0), header_style="dim")


def _section(head: Text, *lines: RenderableType) -> RenderableType:
    return Group(head, Padding(Group(*lines), (0, 0, 1, 2)))


MOST_FAMILIES = 12  # rows of a response
FAMILY_WIDTH = 24  # letters of a family
NONE = "No exponents are compared: a family needs at least three pairs with a power law of the same response."


def comparison_block(comparison: Comparison) -> RenderableType:
    """A small table for each response; at most twelve rows of it, the largest families first to stay."""
    families = comparison.families
    if not len(families):
        return Text(NONE)
    drawn = comparison.pairs.groupby(list(LAW), sort=False)["shrinkage"].median()
    blocks: list[RenderableType] = []
    for response, rows in families.groupby("response", sort=False):
        blocks.append(_response(str(response), rows, drawn, comparison.level))
    return Group(*blocks, Padding(Text(_legend_text(comparison.level)), (0, 0, 1, 0)))


def _response(response: str, rows: pd.DataFrame, drawn: "pd.Series[float]", level: float) -> RenderableType:
    shown, ends = _chosen(rows), f"{100 * level:g} %"
    table = _table(between=1)
    table.add_column("", no_wrap=True)
    table.add_column("family", no_wrap=True, overflow="ellipsis", max_width=FAMILY_WIDTH)
    for name in ("pairs", f"mean, {ends}", f"SD, {ends}", f"new pair, {ends}", "shrinkage"):
        table.add_column(name, justify="right", no_wrap=True)
    last = None
    for row in shown.to_dict("records"):
        pull = drawn.get(tuple(row[name] for name in LAW), float("nan"))
        table.add_row(row["factor"] if row["factor"] != last else "", *_cells(row, pull))
        last = row["factor"]
    head = Text.assemble((response, "bold"), "   exponents over families of pairs")
    rest = len(rows) - len(shown)
    more = [Text(f"{rest} more {'family' if rest == 1 else 'families'} in comparison.csv")] if rest else []
    return _section(head, table, *more)


def _chosen(rows: pd.DataFrame) -> pd.DataFrame:
    """All pairs for every factor first, then the largest families, in the order of the table."""
    chosen = largest_families(rows, MOST_FAMILIES)
    turn = {name: place for place, name in enumerate(dict.fromkeys(rows["factor"]))}
    return chosen.sort_values("factor", key=lambda names: names.map(turn), kind="stable")


def _cells(row: Mapping[Any, Any], pull: float) -> list[str | Text]:
    number = {name: float(value) for name, value in row.items() if not isinstance(value, str)}
    mean, _ = format_rounded(number["mean"], number["mean_se"])
    about, spread, new = (_ends(number[f"{of}_low"], number[f"{of}_high"]) for of in ("mean", "tau", "new"))
    name = WHOLE if row["grouping"] == WHOLE else f"{row['family']} ({row['grouping']})"
    tau = f"{number['tau']:.{_places(number['tau_low'], number['tau_high'])}f}"
    return [Text(name), grouped(int(number["pairs"])), f"{mean} ({about})", f"{tau} ({spread})", new, _share(pull)]


def _ends(low: float, high: float) -> str:
    """An interval, rounded by its width."""
    places = _places(low, high)
    return f"{low:z.{places}f} to {high:z.{places}f}"


def _places(low: float, high: float) -> int:
    return max(decimals(high - low), 0)


def _share(pull: float) -> str:
    return "" if pd.isna(pull) else f"{pull:.0%}".replace("%", " %")


def _legend_text(level: float) -> str:
    return (
        f"Partial pooling with {100 * level:g} % credible intervals. SD is the standard deviation of the exponents in "
        "a family. Shrinkage is the median over its pairs of the shift of the pooled exponent from the separate "
        "estimate towards the mean, relative to their distance: small where pairs differ by more than their "
        "standard errors."
    )
