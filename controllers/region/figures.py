"""Figures of a region: limits and removal rate, wear, wear against removal rate, and probability.

Figures 2 and 4 to 7 of Alaskari & Oraby 2016, drawn from the laws: all of them are calculated, none is measured.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from ...core.arrays import Array
from ...core.display import plot
from ...core.figure_style import (
    AMBER,
    BLUE,
    DIVERGING,
    GREEN,
    GREY,
    LINE,
    ORANGE,
    PURPLE,
    SMALL,
    THICK,
    THIN,
    TITLE,
    new_axes,
)
from ...core.plotting import HALO, NotebookFigure
from .curved import Limit, worst
from .operating_point import OperatingPoint
from .probability import Feasibility
from .visible import VisibleRegion, WearFront

FINE = 241  # points of a contour along each axis
ALONG = 41  # points along a side of the region, which is curved in V and f
COLOURS = (ORANGE, BLUE, PURPLE, GREEN, AMBER)
Values = Callable[[Array], Array]


@plot.register
def plot_region(
    region: VisibleRegion, ax: Axes | None = None, marks: Mapping[str, OperatingPoint] | None = None
) -> Axes:
    """Limits, contours of MRR, lettered corners, the best pair and further ones (Figs 4 and 5)."""
    ax = _axes(ax, region, "Visible region")
    return _region(region, ax, marks or {}, _plane(region))


def plot_region_detail(region: VisibleRegion, marks: Mapping[str, OperatingPoint], ax: Axes | None = None) -> Axes:
    """Detail of the region around its best pair and further ones (Fig. 6b)."""
    ax = _axes(ax, region, "Visible region, close to the best pair")
    pairs = np.array([region.best.xy, *(point.xy for point in marks.values())])
    half = np.maximum((pairs.max(axis=0) - pairs.min(axis=0)) * 0.8, pairs[0] * 0.04)
    middle = (pairs.max(axis=0) + pairs.min(axis=0)) / 2
    low, high = np.maximum(middle - half, 0.5 * np.exp(region.box.low)), middle + half  # a logarithm of them is taken
    _region(region, ax, marks, _grid(low, high, FINE))
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return ax


def _region(
    region: VisibleRegion, ax: Axes, marks: Mapping[str, OperatingPoint], plane: tuple[Array, Array, Array]
) -> Axes:
    V, f, x = plane
    lines = ax.contour(V, f, _mrr(region)(x) / 1000, 9, colors="0.55", linewidths=0.7)
    ax.clabel(lines, fmt="%g", fontsize=SMALL)
    _shade(region, ax)
    _limits(region, ax, V, f, x)
    _letters(region, ax)
    _marks(ax, marks)
    if not region.empty:
        best = region.best
        ax.plot(*best.xy, "*", color="k", ms=11, label=f"best: {best.MRR / 1000:.1f} cm3/min", zorder=5)
    ax.plot([], [], color=GREY, lw=THIN, label="MRR [cm3/min]")
    _key(ax)
    return ax


def plot_wear(
    region: VisibleRegion, ax: Axes | None = None, front: WearFront | None = None, *, rate: bool = False
) -> Axes:
    """Contours of wear, or of its rate, over the region, and the pairs of least wear (Figs 6 and 7)."""
    symbol = region.wear or ""
    what = f"d{symbol}/dt [um/min]" if rate else f"{symbol} [{region.planes[symbol].unit}]"
    ax = _axes(ax, region, f"{'Wear rate' if rate else 'Wear'} over the region")
    V, f, x = _plane(region)
    of = _rate(region) if rate else region.planes[symbol].value
    lines = ax.contour(V, f, of(x), 10, colors=GREEN, linewidths=THIN, linestyles=":")
    for text in ax.clabel(lines, fmt="%.3g", fontsize=SMALL):
        text.set_path_effects(HALO)
    _shade(region, ax)
    _limits(region, ax, V, f, x)
    if front is not None:
        ax.plot(front.V, front.f, color="k", lw=LINE, label=f"least wear, to {100 * front.loss[-1]:.3g} % less MRR")
    if not region.empty:
        ax.plot(*region.best.xy, "*", color="k", ms=11, label="greatest MRR")
    ax.plot([], [], color=GREEN, lw=THIN, ls=":", label=what)
    _key(ax)
    return ax


@plot.register
def plot_front(front: WearFront, ax: Axes | None = None) -> Axes:
    """Least wear over metal removal rate; the wear rate on an axis of its own."""
    ax = new_axes(ax, 6.4, 4.4)
    ax.plot(front.MRR / 1000, front.wear, color=BLUE, lw=LINE)
    ax.set(xlabel="metal removal rate [cm3/min]", ylabel=f"least {front.symbol} [{front.unit}]")
    ax.set_title("Least wear over metal removal rate (calculated)")
    for loss in (0.0, 0.05, 0.1, 0.2, 0.3, 0.5):
        near = int(np.argmin(np.abs(front.loss - loss)))
        if abs(front.loss[near] - loss) < 1e-9:
            at = (float(front.MRR[near] / 1000), float(front.wear[near]))
            ax.plot(*at, "o", color=BLUE, ms=4)
            words = f"{100 * loss:.0f} %: V {front.V[near]:.0f}, f {front.f[near]:.3f}"
            ax.annotate(words, at, xytext=(-6, 3), textcoords="offset points", ha="right", fontsize=SMALL)
    low, high = ax.get_xlim()
    ax.set_xlim(low - 0.25 * (high - low), high)
    if front.wear_rate is not None and np.all(front.wear > 0):
        scale = float(front.wear_rate[0] / front.wear[0])
        other = ax.secondary_yaxis("right", functions=(lambda w: np.multiply(w, scale), lambda r: np.divide(r, scale)))
        other.set_ylabel(f"d{front.symbol}/dt there [um/min]")
    return ax


@plot.register
def plot_probability(
    chance: Feasibility, ax: Axes | None = None, marks: Mapping[str, OperatingPoint] | None = None
) -> Axes:
    """Probability that every limit is kept, and the limits by the point estimates of the laws."""
    region = chance.region
    ax = _axes(ax, region, f"Probability of keeping the limits: {chance.of}")
    levels = [0.0, 0.05, 0.25, 0.5, 0.75, 0.9, 0.95, 1.0]
    filled = ax.contourf(chance.V, chance.f, chance.probability, levels, cmap=DIVERGING, alpha=0.75)
    lines = ax.contour(chance.V, chance.f, chance.probability, [0.5, 0.95], colors="k", linewidths=(0.8, 1.4))
    ax.clabel(lines, fmt="%.2f", fontsize=SMALL)
    V, f, x = _plane(region)
    _limits(region, ax, V, f, x)
    if not region.empty:
        ax.plot(*region.best.xy, "*", color="k", ms=11, label="greatest MRR, point estimates of the laws")
    _marks(ax, marks or {})
    figure = ax.get_figure()
    if figure is not None:
        figure.colorbar(filled, ax=ax, label="probability", ticks=levels)
    _key(ax)
    return ax


def surfaces_figure(region: VisibleRegion) -> Figure:
    """Every response over V and f, with wear rate and removal rate (Fig. 2)."""
    shown: list[tuple[str, Values]] = [(f"{n} [{p.unit}]", p.value) for n, p in region.planes.items()]
    if region.wear is not None and region.rate_of_wear is not None:
        shown.append((f"d{region.wear}/dt [um/min]", _rate(region)))
    shown.append(("MRR [cm3/min]", lambda x: _mrr(region)(x) / 1000))
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure = NotebookFigure(figsize=(4.0 * columns, 3.6 * rows + 0.4), layout="constrained")
    V, f, x = _plane(region, 31)
    for i, (label, of) in enumerate(shown):
        ax: Any = figure.add_subplot(rows, columns, i + 1, projection="3d")
        ax.plot_surface(V, f, of(x), cmap="viridis", linewidth=THIN, edgecolor=GREY, alpha=0.95)
        ax.set_xlabel("V [m/min]", fontsize=SMALL)
        ax.set_ylabel("f [mm/rev]", fontsize=SMALL)
        ax.set_title(label, fontsize=TITLE)
        ax.tick_params(labelsize=SMALL, pad=0)
        ax.xaxis.set_major_locator(MaxNLocator(4))
        ax.yaxis.set_major_locator(MaxNLocator(4))
        ax.view_init(elev=24, azim=-130)
        ax.set_box_aspect(None, zoom=0.92)
    figure.suptitle(f"Calculated from the laws: {region.at_words}")
    return figure


def _key(ax: Axes) -> None:
    """Legend below the axes, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(-0.02, -0.12), ncols=2)


def _axes(ax: Axes | None, region: VisibleRegion, title: str) -> Axes:
    ax = new_axes(ax, 6.8, 5.4)
    low, high = _ends(region)
    wide = high - low
    ax.set_xlim(low[0] - 0.02 * wide[0], high[0] + 0.02 * wide[0])
    ax.set_ylim(low[1] - 0.02 * wide[1], high[1] + 0.06 * wide[1])
    ax.set(xlabel="cutting speed V [m/min]", ylabel="feed f [mm/rev]")
    ax.set_title(f"{title}\ncalculated, {region.at_words}")
    return ax


def _ends(region: VisibleRegion) -> tuple[Array, Array]:
    """The machine's ranges, widened where one is a single value."""
    low, high = np.exp(region.box.low), np.exp(region.box.high)
    return np.where(high > low, low, low * 0.98), np.where(high > low, high, high * 1.02)


def _plane(region: VisibleRegion, points: int = FINE) -> tuple[Array, Array, Array]:
    """V and f as a grid over the machine's ranges, and the same as (ln V, ln f)."""
    low, high = _ends(region)
    return _grid(low, high, points)


def _grid(low: Array, high: Array, points: int) -> tuple[Array, Array, Array]:
    V, f = np.meshgrid(np.linspace(low[0], high[0], points), np.linspace(low[1], high[1], points))
    return V, f, np.log(np.stack([V, f], axis=-1))


def _mrr(region: VisibleRegion) -> Values:
    return lambda x: 1000 * region.setting.d * np.exp(x.sum(axis=-1))


def _rate(region: VisibleRegion) -> Values:
    rate = region.rate_of_wear or 0.0
    return lambda x: region.planes[region.wear or ""].value(x) * rate


def _shade(region: VisibleRegion, ax: Axes) -> None:
    if region.curved:
        V, f, x = _plane(region)
        over = worst(region.limits, x)
        ax.contourf(V, f, over, [over.min() - 1.0, 0.0], colors=[BLUE], alpha=0.12)
        ax.add_patch(Polygon(np.empty((0, 2)), facecolor=BLUE, alpha=0.12, edgecolor=GREY, lw=THIN, label="feasible"))
    elif len(region.polygon) > 2:
        outline = np.exp(_sides(region.polygon))
        ax.add_patch(Polygon(outline, facecolor=BLUE, alpha=0.12, edgecolor=GREY, lw=THIN, label="feasible"))


def _sides(polygon: Array) -> Array:
    """Points along the sides, which are straight in logarithms alone."""
    share = np.linspace(0.0, 1.0, ALONG)[:, None]
    ahead = np.roll(polygon, -1, axis=0)
    return np.concatenate([a + share * (b - a) for a, b in zip(polygon, ahead, strict=True)])


def _limits(region: VisibleRegion, ax: Axes, V: Array, f: Array, x: Array) -> None:
    shown: tuple[Limit, ...] = region.limits[:-4]
    for each, colour in zip(shown, COLOURS * len(shown), strict=False):
        over = each.beyond(x)
        note = " (not active here)" if over.max() <= 0 else " (exceeded everywhere)" if over.min() >= 0 else ""
        if not note:
            ax.contour(V, f, over, [0.0], colors=colour, linewidths=1.8)
        ax.plot([], [], color=colour, lw=LINE, label=each.words + note)


def _letters(region: VisibleRegion, ax: Axes) -> None:
    right = np.exp(region.box.high[0])
    for corner in region.corners:
        aside = -12 if 0.98 * right < corner.V else 5
        ax.plot(corner.V, corner.f, "o", color=GREY, ms=3.5)
        ax.annotate(
            corner.letter,
            (corner.V, corner.f),
            xytext=(aside, 5),
            textcoords="offset points",
            weight="bold",
            annotation_clip=True,
            path_effects=[withStroke(linewidth=THICK, foreground="w")],  # over the numbers of the contours
            zorder=6,
        )


def _marks(ax: Axes, marks: Mapping[str, OperatingPoint]) -> None:
    for (name, point), sign, colour in zip(marks.items(), "sD^vP" * len(marks), COLOURS * len(marks), strict=False):
        ax.plot(*point.xy, sign, color=colour, mec="k", ms=6, label=name, zorder=5)
