"""Figures of a comparison: families of each grouping, and pairs alone and pooled with their family."""

from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..core.arrays import Array
from ..core.display import plot
from ..core.errors import UsageError
from ..core.figure_style import BLUE, DPI, GREY, LINE, ORANGE, RED, SMALL, TEXT, THICK, THIN, TITLE
from ..core.journal import write_files
from ..core.plotting import NotebookFigure, save_figure, whiskers
from ..fit.many.pooling import WHOLE
from .comparison import Comparison, largest_families
from .result import Batch

MOST_FAMILIES, MOST_PAIRS = 40, 60
STRETCH, FEWEST, MOST = 8, 12, 60  # pairs of a stretch that is drawn at its medians; stretches of a picture
WIDTH, ROW, LEAST, ABOVE, BELOW = 11.5, 0.21, 3.2, 1.25, 0.6  # inches: rows and panels, and what stands around them
FAR = 1.5  # times what eight tenths span: farther out nothing is shown but an arrow
POOLED = ("pooled_low", "pooled_high")
LETTER = 0.068  # inches of a letter in the name of a row
NAME = 32  # letters of a name


def write_figures(comparison: Comparison, folder: Path, banner: str = "", former: Iterable[str] = ()) -> list[Path]:
    """Write a PNG for each response and factor that has a family, all of them or none; return their paths.

    ``banner`` stands in red on every picture: that some pairs are simulated. Files of ``former`` that are not drawn any
    more are removed at once.

    Examples
    --------
    >>> import tempfile
    >>> from fitmodels.batch.comparison import compare
    >>> write_figures(compare(pd.DataFrame()), Path(tempfile.mkdtemp()))
    []
    """
    made: dict[str, bytes | None] = {}
    for (response, factor), families in comparison.families.groupby(["response", "factor"], sort=False):
        pairs = comparison.pairs
        pairs = pairs[(pairs["response"] == response) & (pairs["factor"] == factor)]
        taken = {Path(name).stem.casefold() for name in made}
        name = _free(f"exponents_{_plain(response)}_{_plain(factor)}", taken)
        figure = _figure(families, pairs, f"{response}", f"{factor}", comparison.level)
        figure.text(0.988, 1 - 0.1 / figure.get_figheight(), banner, fontsize=TITLE, color=RED, ha="right", va="top")
        held = BytesIO()
        save_figure(figure, held, format="png", dpi=DPI, metadata={"Software": None})
        made[name] = held.getvalue()
    if made:
        write_files(folder, made | dict.fromkeys(sorted({*former} - {*made})))
    return [folder / name for name in made]


def _figure(families: pd.DataFrame, pairs: pd.DataFrame, response: str, factor: str, level: float) -> Figure:
    grouping, alone = _best_grouping(families, pairs)
    few = len(alone) <= MOST_PAIRS
    rows = list(_rows(families))
    names = [[name for name, _ in rows], _pair_names(alone) if few else ["pairs"]]
    tall = [ROW * max(len(names[0]), 4), ROW * max(len(names[1]), 4) if few else LEAST]
    figure = NotebookFigure(figsize=(WIDTH, max(tall) + ABOVE + BELOW))
    FigureCanvasAgg(figure)
    _head(figure, f"Exponent of {factor} in the law of {response}: {len(alone)} pairs", level)
    left, right = _panels(figure, [LETTER * max(map(len, some)) + 0.25 for some in names], tall)
    _families(left, rows, len(families) - sum(row is not None for _, row in rows))
    (_few_pairs if few else _many_pairs)(right, alone, _with(grouping))
    for ax in (left, right):
        ax.set_xlabel(f"exponent of {factor} (no unit)", fontsize=TEXT)
        ax.xaxis.set_major_locator(MaxNLocator(6))
        ax.tick_params(axis="x", labelsize=SMALL)
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(axis="x", color="0.92", lw=THIN)
        ax.set_axisbelow(True)
        _zero(ax)
        _legend(ax)
    return figure


def _head(figure: Figure, title: str, level: float) -> None:
    high, ends = figure.get_figheight(), f"{100 * level:g} %"
    figure.text(0.012, 1 - 0.1 / high, title, fontsize=TITLE + 2, va="top")
    legend = (
        f"Lines and bands are {ends} intervals: of a pair alone the t interval of its own fit, of families and pooled"
        " pairs the posterior interval of partial pooling. An arrow stands for a value outside its panel."
    )
    figure.text(0.012, 1 - 0.37 / high, legend, fontsize=SMALL, color=GREY, va="top")


def _panels(figure: Figure, names: Sequence[float], tall: Sequence[float]) -> tuple[Axes, Axes]:
    """Two panels of equal width, each right of the names of its rows, in inches: rows keep their height."""
    wide = (WIDTH - sum(names) - 0.6) / 2
    high = figure.get_figheight()
    starts = names[0] + 0.1, names[0] + wide + names[1] + 0.35
    left, right = (
        figure.add_axes((x / WIDTH, 1 - (ABOVE + own) / high, wide / WIDTH, own / high))
        for x, own in zip(starts, tall, strict=True)
    )
    return left, right


def _rows(families: pd.DataFrame) -> Iterator[tuple[str, "pd.Series[float] | None"]]:
    """Rows of the panel from the top down: each grouping's name (without numbers), then its families by mean."""
    for grouping, some in largest_families(families, MOST_FAMILIES).groupby("grouping", sort=False):
        if grouping != WHOLE:
            yield str(grouping), None
        for _, row in some.sort_values(["mean", "family"]).iterrows():
            yield f"{_short(str(row['family']))}  ({row['pairs']})", row


def _families(ax: Axes, rows: Sequence[tuple[str, "pd.Series[float] | None"]], rest: int) -> None:
    at = np.array([place for place, (_, row) in enumerate(rows) if row is not None])
    held = pd.DataFrame([row for _, row in rows if row is not None])
    value = {
        name: held[name].to_numpy(dtype=float) for name in ("mean", "mean_low", "mean_high", "new_low", "new_high")
    }
    ax.hlines(at, value["new_low"], value["new_high"], color=ORANGE, lw=LINE, label="a new pair of the family")
    ax.hlines(at, value["mean_low"], value["mean_high"], color=BLUE, lw=THICK, label="mean of the family")
    ax.plot(value["mean"], at, "o", ms=5.5, mfc="white", mec=BLUE, mew=1.4, zorder=4)
    ax.set_xlim(*_reach(held, "mean", ("new_low", "new_high")))
    _beyond(ax, held["mean"].astype(float), at, BLUE)
    _name_rows(ax, [name for name, _ in rows])
    for label, (_, row) in zip(ax.get_yticklabels(), rows, strict=True):
        if row is None:
            label.set_fontweight("bold")
    _title(ax, "Families (number of pairs), by their mean")
    if rest:
        note = f"the {len(held)} largest; {rest} more in comparison.csv"
        ax.annotate(note, (0, 0), (0, -34), "axes fraction", "offset points", fontsize=SMALL, va="top")


def _few_pairs(ax: Axes, pairs: pd.DataFrame, with_words: str) -> None:
    """Each pair alone (grey) and with its family (blue), in rising order."""
    some = pairs.sort_values(["estimate", "tool", "work"])
    at = np.arange(len(some), dtype=np.float64)
    ax.hlines(at - 0.16, some["low"], some["high"], color=GREY, lw=LINE)
    ax.plot(some["estimate"], at - 0.16, "s", ms=3.8, color=GREY, label="alone", ls="none")
    ax.hlines(at + 0.16, some["pooled_low"], some["pooled_high"], color=BLUE, lw=LINE)
    ax.plot(some["pooled"], at + 0.16, "o", ms=4.2, color=BLUE, label=with_words, ls="none")
    ax.set_xlim(*_reach(some, "estimate", POOLED))
    _beyond(ax, some["estimate"], at - 0.16, GREY)
    _beyond(ax, some["pooled"], at + 0.16, BLUE)
    _name_rows(ax, _pair_names(some))
    _title(ax, f"Pairs by their own exponents{_not_pooled(some)}")


def _many_pairs(ax: Axes, pairs: pd.DataFrame, with_words: str) -> None:
    """Curves over all pairs in rising order: medians over stretches of neighbours."""
    some = pairs.sort_values(["estimate", "tool", "work"])
    each = np.array_split(np.arange(len(some)), min(max(len(some) // STRETCH, FEWEST), MOST))
    middle = {
        name: np.array([_median(some[name].to_numpy(dtype=float)[at]) for at in each])
        for name in ("estimate", "low", "high", "pooled", "pooled_low", "pooled_high")
    }
    rank = np.array([at.mean() + 1 for at in each])
    ax.fill_betweenx(rank, middle["low"], middle["high"], color=GREY, alpha=0.3, lw=0, label="interval alone")
    ax.plot(middle["estimate"], rank, color=GREY, lw=LINE, ls="--", label="alone")
    ax.fill_betweenx(
        rank, middle["pooled_low"], middle["pooled_high"], color=BLUE, alpha=0.3, lw=0, label="interval pooled"
    )
    ax.plot(middle["pooled"], rank, color=BLUE, lw=LINE, label=with_words)
    ax.set_ylim(0.5, len(some) + 0.5)
    ax.set_xlim(*_reach(some, "estimate", POOLED))
    ax.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.tick_params(axis="y", labelsize=SMALL)
    ax.set_ylabel("pairs, in rising order of their own exponents", fontsize=TEXT)
    _title(ax, f"Pairs, medians of {len(each[-1])} neighbours{_not_pooled(some)}")


def _pair_names(pairs: pd.DataFrame) -> list[str]:
    return [_short(f"{tool} on {work}") for tool, work in zip(pairs["tool"], pairs["work"], strict=True)]


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _best_grouping(families: pd.DataFrame, pairs: pd.DataFrame) -> tuple[str, pd.DataFrame]:
    """The first grouping besides all pairs that pools most of them, and its rows; else all pairs."""
    pooled = pairs["pooled"].notna().groupby(pairs["grouping"], sort=False).mean()
    good = [name for name in pooled.index if name != WHOLE and pooled[name] > 0.5]
    grouping = str(good[0]) if good else WHOLE
    return grouping, pairs[pairs["grouping"] == grouping]


def _with(grouping: str) -> str:
    return "pooled over all pairs" if grouping == WHOLE else f"pooled with its family ({grouping})"


def _reach(some: pd.DataFrame, centres: str, names: Sequence[str]) -> tuple[float, float]:
    """Limits that hold centres and named ends, but for what lies far out: one extreme pair would compress the rest."""
    middle = some[centres].to_numpy(dtype=float)
    ends = some[list(names)].to_numpy(dtype=float)
    held = np.concatenate([middle, ends[np.isfinite(ends)]])
    low, high = np.quantile(held, [0.1, 0.9])
    span = max(float(high - low), 1e-3)
    near = held[(held >= low - FAR * span) & (held <= high + FAR * span)]
    return float(near.min() - 0.05 * span), float(near.max() + 0.05 * span)


def _beyond(ax: Axes, values: "pd.Series[float]", at: Array, colour: str) -> None:
    """Arrows at the edge of the panel for what lies outside it."""
    low, high = ax.get_xlim()
    inside = 0.012 * (high - low)
    for outside, mark, edge in ((values < low, "<", low + inside), (values > high, ">", high - inside)):
        there = outside.to_numpy()
        ax.plot(np.full(there.sum(), edge), at[there], mark, ms=5, color=colour, zorder=5)


def _name_rows(ax: Axes, names: Sequence[str]) -> None:
    ax.set_yticks(range(len(names)), list(names), fontsize=SMALL)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(max(len(names), 3) - 0.4, -0.6)


def _zero(ax: Axes) -> None:
    low, high = ax.get_xlim()
    if low < 0 < high:
        ax.axvline(0, color=GREY, lw=THIN, zorder=0)


def _not_pooled(pairs: pd.DataFrame) -> str:
    without = int(pairs["pooled"].isna().sum())
    return f"; {without} not pooled" if without else ""


def _title(ax: Axes, words: str) -> None:
    ax.set_title(words, loc="left", pad=36)


def _legend(ax: Axes) -> None:
    """Over the panel, beneath its title: inside it would hide rows."""
    ax.legend(ncols=2, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def _short(name: str) -> str:
    """A long name without its middle: its end distinguishes grades and inserts."""
    return name if len(name) <= NAME else f"{name[: NAME // 2 - 2]}...{name[1 - NAME // 2 :]}"


def _plain(name: object) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in str(name))


def _free(stem: str, taken: set[str]) -> str:
    """A file name that differs from the others without regard to case."""
    number, free = 1, stem
    while free.casefold() in taken:
        number += 1
        free = f"{stem}-{number}"
    return f"{free}.png"


@plot.register
def exponents_figure(result: Batch, ax: Axes | None = None) -> Axes:
    """The first exponent of the first power law of the pairs, with 95 % intervals; the first sixty in their order."""
    results = result.results
    laws = results[(results["reason"] == "") & (results["form"] == "power")]
    rows = laws[laws["response"] == laws["response"].iloc[0]] if len(laws) else laws
    exponents = rows.filter(regex="^params_(?!c0$)").dropna(axis="columns", how="all")
    if not len(exponents.columns):
        raise UsageError("no pair has a power law: there is no exponent to draw.")
    response, factor = rows["response"].iloc[0], str(exponents.columns[0]).removeprefix("params_")
    rows = rows[exponents.iloc[:, 0].notna()]
    values = rows[[f"{part}_{factor}" for part in ("params", "low", "high")]].astype(float)
    estimates = dict(zip(_pair_names(rows), values.itertuples(index=False, name=None), strict=True))
    return whiskers(
        estimates, ax, label=f"exponent of {factor} in the law of {response} (no unit), with 95 % intervals"
    )
