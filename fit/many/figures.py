"""Pictures of many pairs: an exponent over all of them, and how far a family draws each towards its mean."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ...core.arrays import Array, Ints, Texts
from ...core.display import plot
from ...core.errors import UsageError
from ...core.figure_style import BLUE, GREY, LINE, ORANGE, SMALL, THIN, new_axes
from .many_laws import ManyLaws
from .pooling import PooledExponents

NAMED = 16  # families whose names fit next to each other
MOST = 60  # pairs drawn one by one; of more, evenly chosen ones in their order


@plot.register
def exponents_figure(laws: ManyLaws, ax: Axes | None = None, factor: str | None = None) -> Axes:
    """One exponent of the pairs in rising order, within 95 % intervals."""
    name = laws.factors[0] if factor is None else factor
    if name not in laws.factors:
        raise UsageError(f"factor={name!r}: the laws are on {', '.join(laws.factors)}.")
    ends, ax = laws.conf_int(), new_axes(ax)
    value, low, high = laws.params[name].to_numpy(), ends[f"low_{name}"].to_numpy(), ends[f"high_{name}"].to_numpy()
    order = _some(value)
    x = np.arange(len(order))
    ax.vlines(x, low[order], high[order], color=BLUE, lw=LINE, alpha=0.6, label="95 % interval")
    ax.plot(x, value[order], "o", ms=3, color=BLUE)
    ax.set(xlabel=_axis(len(order), int(np.isfinite(value).sum())), ylabel=f"exponent of {name} in {laws.response}")
    ax.legend()
    return ax


@plot.register
def shrinkage_figure(found: PooledExponents, ax: Axes | None = None) -> Axes:
    """Each pair alone and with its family, by families, and their means; wide intervals alone run out of the panel."""
    ax, table = new_axes(ax), found.table[found.table["pooled"].notna()]
    table = table.sort_values(["family", "estimate"])
    chosen = np.unique(np.linspace(0, max(len(table) - 1, 0), min(len(table), MOST)).astype(int))
    some, x = table.iloc[chosen], np.arange(len(chosen))
    ax.vlines(x - 0.15, some["low"], some["high"], color=GREY, lw=THIN)
    ax.plot(x - 0.15, some["estimate"], "o", ms=3, color=GREY, label="alone")
    ax.vlines(x + 0.15, some["pooled_low"], some["pooled_high"], color=BLUE, lw=LINE)
    ax.plot(x + 0.15, some["pooled"], "o", ms=3, color=BLUE, label="with its family")
    names = some["family"].to_numpy()
    for name, mean in found.families["mean"].items() if len(found.families) else ():
        at = np.flatnonzero(names == name)
        if at.size:
            ax.hlines(mean, at[0] - 0.5, at[-1] + 0.5, color=ORANGE, lw=LINE)
    _name_families(ax, names)
    ax.set(xlabel=_axis(len(chosen), len(table)), ylabel=f"exponent of {found.factor}", **_reach(some))
    ax.legend()
    return ax


def _name_families(ax: Axes, names: Texts) -> None:
    """Names over the panel, each above its pairs: inside they would hide each other; of very many none is readable."""
    met = list(dict.fromkeys(names))
    for name in met if len(met) <= NAMED else ():
        at = float(np.flatnonzero(names == name).mean())
        ax.annotate(
            str(name), (at, 1), (0, 2), ("data", "axes fraction"), "offset points", fontsize=SMALL, color=ORANGE,
            rotation=0 if len(met) == 1 else 40, ha="center" if len(met) == 1 else "left", va="bottom",
        )  # fmt: skip


def _reach(some: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Limits that hold all estimates and pooled intervals: one pair of three edges would flatten all the rest."""
    if some.empty:
        return {}
    held = some[["estimate", "pooled_low", "pooled_high"]].to_numpy()
    margin = 0.15 * float(np.ptp(held))
    return {"ylim": (float(held.min()) - margin, float(held.max()) + margin)}


def _some(value: Array) -> Ints:
    """Positions of the known values in rising order, evenly thinned where there are many."""
    order = np.argsort(value)[: int(np.isfinite(value).sum())]
    return np.asarray(order[np.unique(np.linspace(0, max(len(order) - 1, 0), min(len(order), MOST)).astype(int))])


def _axis(drawn: int, of: int) -> str:
    return f"{drawn} of {of} pairs, in rising order" if drawn < of else "pair, in rising order"
