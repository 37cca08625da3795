"""Sheets of panels of a posterior: their layout and credible bands, the law along each factor, rows of each edge.

Bands of rows are those of rows of a new edge: variance between edges and within them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, exp, log, sqrt
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from ...core.arrays import Array, Ints, Texts
from ...core.figure_style import BLUE, GREY, LINE, ORANGE, RED, SMALL, natural_key, round_numbers
from ...core.plotting import NotebookAxes, NotebookFigure
from ...core.plotting import axes_array as together
from ..edges import changes_within
from ..law_figures import label, middle, points
from ..lawfit import LawFit
from .posterior import Posterior

Panel = Callable[[Axes], None]

MOST_PANELS = 24
WHOLE, HALF = (0.025, 0.975), (0.25, 0.75)
MOST_LEVELS = 4  # of a category: a row of curves each
OF_A_CURVE, BESIDE_IT = 61, 1000  # points, and rows: more hide the curve
BEYOND = 0.12  # of the range of a factor: how far curves go on beyond it
OF_AN_EDGE, OF_ALL = 25, 600  # rows that are drawn of one edge, and of rows that have no edge in common


@dataclass(frozen=True, slots=True)
class Sheet:
    """Panels in reading order, None for an empty place; ``shared`` panels have axis labels at the border only."""

    title: str
    panels: Sequence[Panel | None]
    across: int
    size: tuple[float, float]  # of a panel, inches
    gaps: tuple[float, float] = (0.34, 0.5)  # horizontal and vertical, in panels
    shared: bool = False


def laid_out(sheet: Sheet, banner: str) -> Texts:
    """The panels on a figure of their own: banner and title over them, legend under them; margins in inches."""
    down = ceil(len(sheet.panels) / sheet.across)
    width, height = max(sheet.across * sheet.size[0] + 0.9, 4.8), down * sheet.size[1] + 1.7
    title, banner = fill(sheet.title, int(width / 0.082)), fill(banner, int(width / 0.066))
    top = 0.1 + 0.13 * (banner.count("\n") + 1)
    figure = NotebookFigure(figsize=(width, height))
    figure.suptitle(title, y=1 - top / height, va="top")
    figure.text(0.995, 0.995, banner, ha="right", va="top", fontsize=SMALL, color=RED)
    grid = figure.add_gridspec(down, sheet.across)
    axes = np.array([None] * len(sheet.panels), dtype=object)
    for i, panel in enumerate(sheet.panels):
        if panel is not None:
            axes[i] = figure.add_subplot(grid[divmod(i, sheet.across)], axes_class=NotebookAxes)
            axes[i].tick_params(labelsize=SMALL)
            panel(axes[i])
            if sheet.shared:
                _border_only(axes[i], i % sheet.across > 0, any(sheet.panels[i + sheet.across :: sheet.across]))
    drawn = together([ax for ax in axes if ax is not None])
    shown = {text: handle for ax in drawn for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    across = 6 if width > 8 else 3
    figure.legend(shown.values(), shown.keys(), loc="lower center", ncols=across)
    figure.subplots_adjust(
        left=0.8 / width, right=1 - 0.2 / width, bottom=(0.58 + 0.18 * ceil(len(shown) / across)) / height,
        top=1 - (top + 0.45 + 0.16 * title.count("\n")) / height, wspace=sheet.gaps[0], hspace=sheet.gaps[1],
    )  # fmt: skip
    return drawn


def alone(sheet: Sheet, banner: str, ax: Axes) -> Texts:
    """The one panel on axes that were given."""
    (panel,) = sheet.panels
    if panel is not None:
        panel(ax)
    ax.set_title("\n".join(filter(None, (fill(sheet.title, 60), ax.get_title()))))
    ax.text(0.99, 0.01, fill(banner, 60), ha="right", fontsize=SMALL, color=RED, transform=ax.transAxes)
    ax.legend()
    return np.array([ax], dtype=object)


def _border_only(ax: Axes, right: bool, above: bool) -> None:
    if right:
        ax.set_ylabel("")
        ax.tick_params(axis="y", which="both", labelleft=False)
    if above:
        ax.set_xlabel("")
        ax.tick_params(axis="x", which="both", labelbottom=False)


def conditions(law: LawFit, X: Array, level: Ints) -> pd.DataFrame:
    """Factors (n, k), and the level of the category, as a table for predictions."""
    new = pd.DataFrame(X, columns=list(law.factors))
    return new if law.by is None else new.assign(**{law.by.column: np.array(levels_of(law))[level]})


def levels_of(law: LawFit) -> tuple[str, ...]:
    """Levels of the category, the reference first; one empty name where there is none."""
    return ("",) if law.by is None else (law.by.reference, *law.by.levels)


def level_of_rows(law: LawFit) -> Ints:
    """Number of each row's level, 0 the reference."""
    return np.asarray(law.shifts @ np.arange(1, law.shifts.shape[1] + 1), dtype=np.intp)


def bands_at(posterior: Posterior, new: pd.DataFrame) -> tuple[Array, Array]:
    """Quantiles of the law (5, m) and of a row of a new edge (2, m); one error per draw, so that bands are smooth."""
    law, one = posterior.responses(new), new.iloc[:1]
    centre, row = posterior.responses(one), posterior.responses(one, "prediction")
    rows = law + (row - centre) if posterior.density.natural else law * (row / centre)
    return np.quantile(law, (WHOLE[0], HALF[0], 0.5, HALF[1], WHOLE[1]), axis=0), np.quantile(rows, WHOLE, axis=0)


def a_row(posterior: Posterior) -> str:
    """Text on the population of a predictive band."""
    return "a row of a new edge" if posterior.density.edges else "a row"


def scaled(ax: Axes, which: str, values: Array, *, logs: bool) -> None:
    """Limits about the values and few ticks, at round numbers where the axis is logarithmic."""
    low, high = float(values.min()), float(values.max())
    reach = 0.06 * (log(high / low) if logs else high - low) or 0.06
    ends = (low * exp(-reach), high * exp(reach)) if logs else (low - reach, high + reach)
    axis = ax.xaxis if which == "x" else ax.yaxis
    if logs:
        ax.set(**{f"{which}scale": "log"})
        axis.set_major_locator(FixedLocator(round_numbers(low, high, 3, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter("{x:.7g}")
    ax.set(**{f"{which}lim": ends})


def evenly(of: Ints, most: int) -> Ints:
    """At most ``most`` of the positions (n,), evenly chosen, the first and the last among them."""
    return of[np.linspace(0, len(of) - 1, min(len(of), most)).round().astype(np.intp)]


@dataclass(frozen=True, slots=True)
class Curve:
    """The law (5, m) and a row of it (2, m) along a factor, and rows x, y (n,) moved to these conditions."""

    factor: str
    held: str
    tested: tuple[float, float]
    grid: Array
    law: Array
    rows: Array
    x: Array
    y: Array


def curves(posterior: Posterior) -> Sheet:
    """The law along each factor, a row of panels for each level of the category."""
    law, k = posterior.law, len(posterior.law.factors)
    levels = levels_of(law)[:MOST_LEVELS]
    drawn = [_curve(posterior, j, i) for i in range(len(levels)) for j in range(k)]
    title = f"{law.response} on {law.factors[0] if k == 1 else 'each factor'}"
    if len(levels) < len(levels_of(law)):
        title += f", the first {len(levels)} of {len(levels_of(law))} levels of {law.by.column if law.by else ''}"
    if law.nobs > BESIDE_IT:
        title += f", at most {BESIDE_IT} rows in a panel"
    if k > 1:
        title += "; rows moved along the law to the values over each panel"
    values = np.concatenate([np.concatenate([c.y, *c.rows]) for c in drawn])
    panels = [partial(_along, posterior, c, values) for c in drawn]
    return Sheet(title, panels, k, (2.8, 2.6) if len(panels) > 1 else (3.9, 3.0), (0.08, 0.2), shared=True)


def _curve(posterior: Posterior, j: int, level: int) -> Curve:
    law, logs = posterior.law, posterior.law.formula.logs
    every = np.flatnonzero(level_of_rows(law) == level)
    tested = float(law.X[every, j].min()), float(law.X[every, j].max())
    mine = evenly(every, BESIDE_IT)
    x, y = law.X[mine], law.observed[mine]
    grid = _beyond(*law.domain[law.factors[j]], logs=logs[j])
    centre = np.array([middle(ends, log) for ends, log in zip(law.domain.values(), logs, strict=True)])
    there, here = (np.repeat(centre[None], n, axis=0) for n in (len(x), len(grid)))
    there[:, j], here[:, j] = x[:, j], grid
    theta = np.median(posterior.draws[:, : len(law.theta)], axis=0)
    moved, was = (law.formula.response_at(theta, law.formula.design(at, law.shifts[mine])) for at in (there, x))
    held = [f"{law.by.column} {levels_of(law)[level]}"] if law.by else []
    held += [
        f"{name} {value:.3g} {law.units.get(name, '')}".rstrip()
        for name, value in zip(law.factors, centre, strict=True)
        if name != law.factors[j]
    ]
    bands = bands_at(posterior, conditions(law, here, np.full(len(grid), level)))
    y = y + (moved - was) if posterior.density.natural else y * (moved / was)
    return Curve(law.factors[j], ", ".join(held), tested, grid, *bands, x[:, j], y)


def _beyond(low: float, high: float, *, logs: bool) -> Array:
    """Points of a factor from a little below its range, but not below zero, to a little above."""
    if logs:
        reach = (high / low) ** BEYOND
        return np.geomspace(low / reach, high * reach, OF_A_CURVE)
    reach = (high - low) * BEYOND
    return np.linspace(low - reach if low < 0 else max(low - reach, 0.0), high + reach, OF_A_CURVE)


def _along(posterior: Posterior, c: Curve, values: Array, ax: Axes) -> None:
    law = posterior.law
    logs = law.formula.logs[law.factors.index(c.factor)]
    ax.fill_between(c.grid, *c.rows, color=BLUE, alpha=0.13, lw=0, label=f"95 % of {a_row(posterior)}")
    ax.fill_between(c.grid, c.law[0], c.law[4], color=BLUE, alpha=0.3, lw=0, label="95 % of the law")
    ax.fill_between(c.grid, c.law[1], c.law[3], color=BLUE, alpha=0.45, lw=0, label="50 % of the law")
    ax.plot(c.grid, c.law[2], color=ORANGE, lw=LINE, zorder=3, label="median")
    points(ax, c.x, c.y)
    ax.lines[-1].set_label("rows")
    scaled(ax, "x", c.grid, logs=logs)
    scaled(ax, "y", values, logs=logs and bool(values.min() > 0))
    low, high = ax.get_xlim()
    ax.axvspan(low, c.tested[0], color=GREY, alpha=0.2, lw=0, label="not tested")
    ax.axvspan(c.tested[1], high, color=GREY, alpha=0.2, lw=0)
    ax.set(xlim=(low, high))
    ax.set_title(fill(c.held, 44), fontsize=SMALL, pad=3)
    ax.set_xlabel(label(law, c.factor))
    ax.set_ylabel(label(law, posterior.response))


@dataclass(frozen=True, slots=True)
class EdgeCurve:
    """Rows x, y (m,) of one edge, and the median (m,) and band (2, m) of a row at their conditions."""

    edge: str
    x: Array
    y: Array
    median: Array
    band: Array


def predictive(posterior: Posterior) -> Sheet:
    """Rows of each edge in the band of a row of a new edge; rows that have no edge in common, in one panel."""
    law = posterior.law
    names, groups, clock = _groups(law)
    rows, cuts = np.concatenate(groups), np.cumsum([len(i) for i in groups])[:-1]
    middle, band = bands_at(posterior, conditions(law, law.X[rows], level_of_rows(law)[rows]))
    of_all = (
        law.X[rows, law.factors.index(clock)] if clock else np.concatenate([np.arange(1.0, len(i) + 1) for i in groups])
    )
    x, y, median = (np.split(of_row, cuts) for of_row in (of_all, law.observed[rows], middle[2]))
    seen = [EdgeCurve(*parts) for parts in zip(names, x, y, median, np.split(band, cuts, axis=1), strict=True)]
    place = "row of the edge" if names[0] else "row, in the order of the prediction"
    along = label(law, clock) if clock else f"{place} [1]"
    limits = of_all, np.concatenate([law.observed[rows], *band])
    panels = [partial(_rows, posterior, s, limits, along, law.formula.log_factors and clock is not None) for s in seen]
    title = f"{law.response}: {_which(law, names, len(rows))} in the 95 % band of {a_row(posterior)}"
    if len(panels) == 1:
        return Sheet(title, panels, 1, (3.9, 3.0))
    return Sheet(title, panels, max(3, ceil(sqrt(1.5 * len(panels)))), (1.7, 1.5), (0.08, 0.24), shared=True)


def _groups(law: LawFit) -> tuple[list[str], list[Ints], str | None]:
    """Rows of each edge along the factor that changes within edges, t if it does, and the name of that factor.

    Rows that have no edge in common are one group, in the order of the prediction.
    """
    if law.edge is None or law.n_edges == law.nobs:
        return [""], [evenly(np.argsort(law.fitted, kind="stable"), OF_ALL)], None
    names, number = np.unique(law.edge.astype(str), return_inverse=True)
    within = [law.factors[j] for j in np.flatnonzero(changes_within(law.X, number))]
    clock = "t" if "t" in within else next(iter(within), None)
    order = np.argsort(law.X[:, law.factors.index(clock)], kind="stable") if clock else np.arange(law.nobs)
    in_order = sorted(range(len(names)), key=lambda g: natural_key(str(names[g])))
    chosen = evenly(np.array(in_order), MOST_PANELS)
    return [str(names[g]) for g in chosen], [evenly(order[number[order] == g], OF_AN_EDGE) for g in chosen], clock


def _which(law: LawFit, names: list[str], n: int) -> str:
    """Text on the selection of rows."""
    G = law.n_edges if names[0] else None
    rows = f"{n} rows" if n == law.nobs else f"{n} of {law.nobs} rows"
    edges = "" if G is None else f" of edge {names[0]}" if G == 1 else f" of {G} edges"
    if G is not None and len(names) < G:
        edges = f" of {len(names)} of {G} edges"
    return rows + edges + ("" if n == law.nobs else ", evenly chosen,")


def _rows(posterior: Posterior, s: EdgeCurve, limits: tuple[Array, Array], along: str, logs: bool, ax: Axes) -> None:
    scaled(ax, "x", limits[0], logs=logs)
    scaled(ax, "y", limits[1], logs=posterior.law.formula.log_factors and bool(limits[1].min() > 0))
    x = s.x if np.ptp(s.x) > 0 else _stretched(ax, s.x, logs=logs)
    low, high = np.broadcast_to(s.band, (2, len(x)))
    ax.fill_between(x, low, high, color=BLUE, alpha=0.15, lw=0, label=f"95 % of {a_row(posterior)}")
    ax.plot(x, np.broadcast_to(s.median, x.shape), color=ORANGE, lw=LINE, label="median")
    outside = (s.y < s.band[0]) | (s.y > s.band[1])
    ax.plot(s.x[~outside], s.y[~outside], "o", ms=3.5, mfc="none", mec=BLUE, mew=0.8, label="rows")
    title, colour = s.edge, "black"
    if outside.any():
        ax.plot(s.x[outside], s.y[outside], "o", ms=3.5, color=ORANGE, label="rows outside")
        title, colour = f"{s.edge}: {outside.sum()} of {len(s.y)} outside".removeprefix(": "), ORANGE
    ax.set_title(title, fontsize=SMALL, pad=3, color=colour)
    ax.set_xlabel(along)
    ax.set_ylabel(label(posterior.law, posterior.response))


def _stretched(ax: Axes, x: Array, *, logs: bool) -> Array:
    """Coincident points (m,), spread so that a band is visible."""
    low, high = ax.get_xlim()
    to = np.linspace(-0.04, 0.04, len(x)) if len(x) > 1 else np.array([-0.04, 0.04])
    return x * (high / low) ** to if logs else x + (high - low) * to
