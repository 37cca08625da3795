"""What the command prints of a comparison: families, how their exponents spread, how far pairs are drawn."""

from collections.abc import Mapping
from typing import Any

import pandas as pd
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ...core.progress import grouped
from ...core.rounding import decimals, format_rounded
from ...fit.many.families import WHOLE
from .comparison import LAW, Comparison

MOST = 12  # rows of a response
NAME = 24  # letters of a family
NONE = "No exponents are compared: a family needs at least three pairs with a power law of the same response."


def comparison_block(comparison: Comparison) -> RenderableType:
    """A small table for each response; at most twelve rows of it, the largest families first to stay."""
    families = comparison.families
    if not len(families):
        return Text(NONE)
    drawn = comparison.pairs.groupby(list(LAW), sort=False)["shrinkage"].median()
    blocks: list[RenderableType] = []
    for response, rows in families.groupby("response", sort=False):
        blocks += _response(str(response), rows, drawn, comparison.level)
    return Group(*blocks, Padding(Text(_meaning(comparison.level)), (0, 0, 1, 0)))


def _response(response: str, rows: pd.DataFrame, drawn: "pd.Series[float]", level: float) -> list[RenderableType]:
    shown, ends = _chosen(rows), f"{100 * level:g} %"
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("", no_wrap=True)
    table.add_column("family", no_wrap=True, overflow="ellipsis", max_width=NAME)
    for name in ("pairs", f"mean, {ends}", f"spread, {ends}", f"a new pair, {ends}", "drawn"):
        table.add_column(name, justify="right", no_wrap=True)
    last = None
    for row in shown.to_dict("records"):
        pull = drawn.get(tuple(row[name] for name in LAW), float("nan"))
        table.add_row(row["factor"] if row["factor"] != last else "", *_cells(row, pull))
        last = row["factor"]
    head = Text.assemble((response, "bold"), "   exponents over families of pairs")
    rest = len(rows) - len(shown)
    said = [Text(f"{rest} more {'family' if rest == 1 else 'families'} in comparison.csv")] if rest else []
    return [head, Padding(Group(table, *said), (0, 0, 1, 2))]


def _chosen(rows: pd.DataFrame) -> pd.DataFrame:
    """All pairs for every factor first, then the largest families, told in the order of the table."""
    order = rows.assign(whole=rows["grouping"] == WHOLE).sort_values(["whole", "pairs"], ascending=False, kind="stable")
    chosen = rows.loc[order.index[:MOST]]
    turn = {name: place for place, name in enumerate(dict.fromkeys(rows["factor"]))}
    return chosen.sort_index().sort_values("factor", key=lambda names: names.map(turn), kind="stable")


def _cells(row: Mapping[Any, Any], pull: float) -> list[str | Text]:
    number = {name: float(value) for name, value in row.items() if not isinstance(value, str)}
    mean, _ = format_rounded(number["mean"], number["mean_se"])
    about, spread, new = (_ends(number[f"{of}_low"], number[f"{of}_high"]) for of in ("mean", "tau", "new"))
    name = WHOLE if row["grouping"] == WHOLE else f"{row['family']} ({row['grouping']})"
    tau = f"{number['tau']:.{_places(number['tau_low'], number['tau_high'])}f}"
    return [Text(name), grouped(int(number["pairs"])), f"{mean} ({about})", f"{tau} ({spread})", new, _share(pull)]


def _ends(low: float, high: float) -> str:
    """An interval, its ends to the decimals that its width deserves."""
    places = _places(low, high)
    return f"{low:z.{places}f} to {high:z.{places}f}"


def _places(low: float, high: float) -> int:
    return max(decimals(high - low), 0)


def _share(pull: float) -> str:
    return "" if pd.isna(pull) else f"{pull:.0%}".replace("%", " %")


def _meaning(level: float) -> str:
    return (
        f"Partial pooling; intervals are posterior ones of {100 * level:g} %. Spread is the standard deviation of the "
        "exponents in a family. Drawn is how far the middle pair of a family is moved from its own exponent towards "
        "the mean: little where pairs differ by more than their errors."
    )
