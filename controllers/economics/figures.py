"""Figure of the cost of a part over speed: its parts, the optimum with its interval, today's setting, the limits."""

import numpy as np
from matplotlib.axes import Axes

from ...core.arrays import Array
from ...core.display import plot
from ...core.figure_style import BLUE, GREY, INK, ORANGE, SMALL, new_axes
from ..region.curved import worst
from ..region.half_planes import SAME
from .optimum import EconomicSettings

SPEEDS, FEEDS = 201, 801
SHADES = {  # of the parts of the cost, light enough for the marks above them
    "handling": "#d5d9dc", "machine": "#a9cbe5", "change of edges": "#f3d3a2", "edges": "#e3a878", "energy": "#b9d8bd",
}  # fmt: skip


@plot.register
def plot_economic_settings(found: EconomicSettings, ax: Axes | None = None) -> Axes:
    """Cost per part over V, stacked by its parts, each speed with its best feed within the limits."""
    ax = new_axes(ax, 6.4, 4.4)
    best, costs = found.least_cost, found.costs
    x = _best_feeds(found)
    V = np.exp(x[:, 0])
    known = np.isfinite(x[:, 1])
    terms = found.cost.at(0).terms(x)
    parts = {"handling": np.full(len(V), found.cost.constant), **dict(zip(found.cost.names, terms.T, strict=True))}
    stacked = {name: np.where(known, value, np.nan) for name, value in parts.items() if np.nanmax(value) > 0}
    ax.stackplot(V, *stacked.values(), labels=list(stacked), colors=[SHADES[name] for name in stacked], lw=0)
    ax.plot(V, np.sum(list(stacked.values()), axis=0), color=BLUE, lw=1.6)
    settings = {"least cost": best, "greatest rate": found.greatest_rate, "today": found.today}
    top = 1.7 * max(each.cost for each in settings.values() if each is not None)
    if not known.all():
        words = "no feed within the limits, worn edge"
        ax.fill_between(V, 0, top, where=(~known).tolist(), color=GREY, alpha=0.3, lw=0, label=words)
    if "V" in best.bands:
        low, high = best.bands["V"]
        ax.plot([low, high], [best.cost, best.cost], color=ORANGE, lw=4, alpha=0.5, solid_capstyle="butt",
                label=f"{found.level:.0%} interval of V", zorder=4)  # fmt: skip
    marks = (("least cost", "o", ORANGE), ("greatest rate", "^", BLUE), ("today", "s", INK))
    for name, marker, colour in marks:
        if (each := settings[name]) is not None and (name != "greatest rate" or each.xy != best.xy):
            words = f"{name}: V {each.V:.4g}, f {each.f:.3g}"
            ax.plot(each.V, each.cost, marker, color=colour, ms=7, label=words, zorder=5)
    ax.set(xlim=(V[0], V[-1]), ylim=(0, top))
    ax.set_xlabel(f"cutting speed V, m/min, each at its best feed within the limits; d {found.setting.d:g} mm")
    ax.set_ylabel(f"cost per {costs.of}, {costs.currency}")
    of = " from simulated data" if found.simulated else ""
    ax.set_title(f"Cost per {costs.of} over speed, calculated{of}")
    ax.legend(fontsize=SMALL, loc="upper center", ncols=2)
    return ax


def _best_feeds(found: EconomicSettings) -> Array:
    """Speeds with the feed of least cost within the limits, as (ln V, ln f); ln f is NaN where no feed is."""
    low, high = found.machine.low, found.machine.high
    speeds = np.log(np.linspace(np.exp(low[0]), np.exp(high[0]), SPEEDS))
    x = np.stack(np.broadcast_arrays(speeds[:, None], np.linspace(low[1], high[1], FEEDS)), axis=-1)
    cost = found.cost.at(0).value(x)
    cost = np.where(worst(found.limits, x) <= SAME, cost, np.inf)
    best = np.argmin(cost, axis=1)
    rows = np.arange(SPEEDS)
    feeds = np.where(np.isfinite(cost[rows, best]), x[rows, best, 1], np.nan)
    return np.stack([speeds, feeds], axis=-1)
