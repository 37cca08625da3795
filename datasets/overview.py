"""First picture of a table of tests: levels of each factor, and wear over time by edge."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from ..core.arrays import Array, Ints, Texts
from ..core.figure_style import BLUE, GREY, ORANGE, SERIES, SMALL, THICK, THIN
from ..core.plotting import NotebookFigure, dress
from ..core.rounding import count, with_unit
from .figures import RESPONSES
from .runs import Runs, edges_of
from .vocabulary import MEASURED, ROLES

MOST_FACTORS = 6  # small panels in a row
NAMED_LEVELS = 4  # written below their marks
FEW_LEVELS = 25  # drawn one by one; more are a histogram
NAMED_EDGES = 40  # edges whose names stand beside their lines
MOST_EDGES = 200  # drawn as lines
MOST_POINTS = 20_000
LOG_SPAN = 3.0  # times and responses that span more are drawn on logarithmic axes, where a power law is straight
PAIR_COLOURS = SERIES


def overview_figure(runs: Runs) -> Figure:
    """Levels of the factors above, and the measured quantities against time, a line for each edge.

    Parameters
    ----------
    runs : Runs

    Returns
    -------
    Figure
        Not shown anywhere: save it.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> len(overview_figure(datasets.read_runs(datasets.bundled("gc435_709m40"))).axes)
    5
    """
    factors, measured = _factors(runs), _measured(runs)
    figure = NotebookFigure(
        figsize=(10.5, 6.8 if factors and measured else 4.6 if measured else 2.6), layout="constrained"
    )
    parts: Any = figure.subfigures(2, 1, height_ratios=(1, 2.6)) if factors and measured else (figure, figure)
    above, below = parts
    doubted = {name for doubt in runs.doubts for name in doubt.columns}
    if factors:
        for symbol, ax in zip(factors, np.atleast_1d(above.subplots(1, len(factors))), strict=True):
            dress(ax)
            _levels(runs, symbol, ax)
            _mark(ax, doubted.intersection([symbol]))
    if measured:
        colours, legend = _colours(runs)
        for symbol, ax in zip(measured, np.atleast_1d(below.subplots(1, len(measured))), strict=True):
            dress(ax)
            _curves(runs, symbol, ax, colours)
            _mark(ax, doubted.intersection([symbol, "t"]))
        handles = [Line2D([], [], color=colour, marker="o", ms=3, label=text) for text, colour in legend]
        figure.legend(
            handles=handles, loc="outside lower center", ncols=max(len(handles), 1), fontsize=SMALL, frameon=False
        )
    figure.suptitle(_title(runs))
    return figure


def _title(runs: Runs) -> str:
    edges = f", {len(edges_of(runs)[1])} edges" if runs.has("edge") else ", no edges"
    n = len(runs.doubts)
    doubts = f", {count(n, 'doubt')} (orange)" if n else ""
    note = ", simulated" if runs.simulated else ""
    return f"{runs.source.name}: {runs.tool} on {runs.work}, {len(runs)} rows{edges}{note}{doubts}"


def _mark(ax: Axes, doubted: set[str]) -> None:
    """An orange frame and title where the panel shows columns that are doubted."""
    if doubted:
        ax.set_title(f"{', '.join(sorted(doubted))} doubted", color=ORANGE, loc="left")
        for spine in ax.spines.values():
            spine.set_color(ORANGE)


def _factors(runs: Runs) -> list[str]:
    """Conditions that vary, those of the laws first."""
    names = [name for name in runs.units if name in runs.data and ROLES[name].kind == "condition"]
    spread = {name: runs.values(name) for name in names}
    varying = [name for name, x in spread.items() if len(x) and np.fmin.reduce(x) < np.fmax.reduce(x)]
    return sorted(varying, key=list(ROLES).index)[:MOST_FACTORS]


def _measured(runs: Runs) -> list[str]:
    """The first two measured quantities, wear before load."""
    named = [name for name in runs.units if name in runs.data and ROLES[name].kind in MEASURED]
    order = [name for name in RESPONSES if name in named] + [name for name in named if name not in RESPONSES]
    computed = set(order) - {use.role for use in runs.columns}
    known = [name for name in order if np.isfinite(runs.values(name)).any()]
    known.sort(key=computed.__contains__)  # what was measured comes first
    wear = [name for name in known if ROLES[name].kind == "wear"][:1]
    return [*wear, *(name for name in known if name not in wear)][: 2 if len(known) > 1 else 1]


def _levels(runs: Runs, symbol: str, ax: Axes) -> None:
    """Rows at each level of a factor, or their histogram where there are many levels."""
    values = runs.values(symbol)
    values = values[np.isfinite(values)]
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) <= FEW_LEVELS:
        ax.vlines(levels, 0, counts, color=BLUE, lw=THICK)
        ax.plot(levels, counts, "o", ms=4, color=BLUE)
    else:
        ax.hist(values, bins=30, color=BLUE)
    ax.set_ylim(0, None)
    ax.margins(x=0.12)
    ax.set_xlabel(with_unit(f"{symbol}, {ROLES[symbol].quantity}", runs.units.get(symbol, "")), fontsize=SMALL)
    ax.set_ylabel("rows", fontsize=SMALL)
    ax.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    if len(levels) <= NAMED_LEVELS:
        ax.set_xticks(levels, [f"{level:.4g}" for level in levels])
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.tick_params(labelsize=SMALL)


def _curves(runs: Runs, symbol: str, ax: Axes, colours: Texts) -> None:
    """A quantity against time, or against the factor that it follows most where there is no time."""
    x_name = next((name for name in ("t", "T") if name in runs.units and name in runs.data), None)
    x_name = x_name or max(_factors(runs), key=lambda name: _correlation(runs, name, symbol), default=None)
    x = runs.values(x_name) if x_name else np.arange(1.0, len(runs) + 1)
    y = runs.values(symbol)
    of_row, names = edges_of(runs) if runs.has("edge") and x_name == "t" else (np.full(len(runs), -1), [])
    seen = np.isfinite(x) & np.isfinite(y)
    if _log(x[seen]) and _log(y[seen]):
        ax.set(xscale="log", yscale="log")
    drawn = np.flatnonzero(seen & (of_row >= 0))
    codes, edges = pd.factorize(of_row[drawn])
    if len(edges) > 1:
        _lines(ax, x, y, drawn, codes, [names[i][-1] for i in edges], colours)
    else:
        some = _some(np.flatnonzero(seen), MOST_POINTS)
        ax.scatter(x[some], y[some], s=16, c=colours[some].tolist(), alpha=0.7, linewidths=0)
    label = with_unit(f"{x_name}, {ROLES[x_name].quantity}", runs.units.get(x_name, "")) if x_name else "row"
    ax.set_xlabel(label)
    ax.set_ylabel(with_unit(f"{symbol}, {ROLES[symbol].quantity}", runs.units.get(symbol, "")))
    _plain_ticks(ax)
    ax.grid(color=GREY, alpha=0.2, which="both")


def _lines(ax: Axes, x: Array, y: Array, drawn: Ints, codes: Ints, names: list[str], colours: Texts) -> None:
    """A line for each edge, of many edges for some of them; few edges are named."""
    drawn = drawn[np.lexsort((x[drawn], codes))]
    rows = np.split(drawn, np.cumsum(np.bincount(codes))[:-1])
    if len(names) > MOST_EDGES:
        rows = [rows[i] for i in _some(np.arange(len(names)), MOST_EDGES)]
        ax.set_title(f"{MOST_EDGES} of {len(names)} edges, drawn at random", fontsize=SMALL, loc="right")
    step = max(1, sum(map(len, rows)) // MOST_POINTS)
    for at in rows:
        few = np.append(at[:-1:step], at[-1])
        ax.plot(x[few], y[few], "o-", ms=3, lw=THIN, color=colours[at[0]], alpha=0.85)
    if len(names) <= NAMED_EDGES:
        last = [at[-1] for at in rows]
        _names_beside(ax, names, x[last], y[last], colours[last])


def _some(places: Ints, most: int) -> Ints:
    """All places where they are few, otherwise so many of them, chosen at random and always the same."""
    return places if len(places) <= most else np.sort(np.random.default_rng(0).choice(places, most, replace=False))


def _correlation(runs: Runs, x: str, y: str) -> float:
    """Absolute correlation of two columns over the rows that have both; 0 where it is not defined."""
    both = np.column_stack([runs.values(x), runs.values(y)])
    both = both[np.isfinite(both).all(axis=1)]
    if len(both) < 2 or (both == both[0]).all(axis=0).any():
        return 0.0
    return float(np.abs(np.corrcoef(both[:, 0], both[:, 1])).min())


def _names_beside(ax: Axes, names: list[str], x: Array, y: Array, colours: Texts) -> None:
    """Names of edges in a column to the right of the panel, each joined to the end of its line."""
    ax.autoscale_view()  # the limits place the names
    ends = (ax.transScale + ax.transLimits).transform(np.column_stack([x, y]))
    order = np.argsort(ends[:, 1], kind="stable")
    heights = _spread(ends[order, 1].tolist(), 1.0 / max(len(names) - 1, 24))
    size = 7 if len(names) <= 26 else 5
    for height, i in zip(heights, order, strict=True):
        ax.annotate(
            names[i][:14], xy=tuple(ends[i]), xytext=(1.03, height), xycoords="axes fraction",
            textcoords="axes fraction", fontsize=size, color=colours[i], va="center", annotation_clip=False,
            arrowprops={"arrowstyle": "-", "lw": THIN, "color": colours[i], "alpha": 0.5, "shrinkA": 0, "shrinkB": 1},
        )  # fmt: skip


def _spread(heights: list[float], gap: float) -> list[float]:
    """Rising heights moved apart to at least ``gap``, as little as possible, inside 0 and 1 where there is room.

    >>> _spread([0.5, 0.5], 0.1), _spread([0.99, 1.0], 0.1)
    ([0.45, 0.55], [0.9, 1.0])
    """
    blocks: list[tuple[float, int]] = []  # mean of the targets of neighbours that touch, and their number
    for i, height in enumerate(heights):
        mean, count = height - i * gap, 1
        while blocks and blocks[-1][0] >= mean:
            other, many = blocks.pop()
            mean, count = (mean * count + other * many) / (count + many), count + many
        blocks.append((mean, count))
    most = 1.0 - (len(heights) - 1) * gap
    bases = [min(max(mean, 0.0), most) for mean, count in blocks for _ in range(count)]
    return [round(base + i * gap, 9) for i, base in enumerate(bases)]


def _colours(runs: Runs) -> tuple[Texts, list[tuple[str, str]]]:
    """Colour of each row, and a legend: by pair where there are several, otherwise by the level of the first factor."""
    keys = [role for role in ("tool", "work") if role in runs.data]
    if keys:
        texts = pd.Series(list(zip(*(runs.labels(role) for role in keys), strict=True)), dtype=object)
        codes, names = pd.factorize(texts)
        if 1 < len(names) <= len(PAIR_COLOURS):
            legend = [", ".join(f"{role} {x}" for role, x in zip(keys, name, strict=True)) for name in names]
            return np.array(PAIR_COLOURS, dtype=object)[codes], list(zip(legend, PAIR_COLOURS, strict=False))
    factor = next(iter(_factors(runs)), None)
    if factor is None:
        return np.full(len(runs), BLUE, dtype=object), []
    values = runs.values(factor)
    levels = np.unique(values[np.isfinite(values)])
    shades = np.array([to_hex(shade) for shade in colormaps["viridis"](np.linspace(0.0, 0.85, 256))], dtype=object)

    def shade(x: Array) -> Texts:
        rank = np.searchsorted(levels, np.where(np.isfinite(x), x, levels[0])) / max(len(levels) - 1, 1)
        return np.asarray(shades[np.rint(255 * rank).astype(int)])

    shown = levels if len(levels) <= NAMED_LEVELS + 2 else levels[[0, len(levels) // 2, -1]]
    unit = runs.units.get(factor, "")
    words = [f"{factor} {x:.4g} {unit}".rstrip() for x in shown]
    return shade(values), list(zip(words, shade(shown), strict=True))


def _log(values: Array) -> bool:
    """Whether values are all above zero and span more than `LOG_SPAN`."""
    return bool(len(values) > 1 and values.min() > 0 and values.max() > LOG_SPAN * values.min())


def _plain_ticks(ax: Axes) -> None:
    """Numbers as 0.2 and 10 on logarithmic axes too, with those between where the axis is short."""
    for axis, scale in ((ax.xaxis, ax.get_xscale()), (ax.yaxis, ax.get_yscale())):
        if scale != "log":
            continue
        low, high = sorted(axis.get_view_interval())
        plain = FuncFormatter(lambda value, _: f"{value:g}")
        axis.set_major_formatter(plain)
        short = high < 30 * low
        axis.set_minor_formatter(
            FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "235" else "") if short
            else NullFormatter()
        )  # fmt: skip
        axis.set_tick_params(which="both", labelsize=SMALL)
