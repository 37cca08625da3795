"""Pictures of identification on given axes; the only file of the room that imports matplotlib."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from .orders import OrderSearch

BLUE, ORANGE, GREY = "#1f5fa8", "#c8551b", "#8a8a8a"


def _axes(ax: Axes | None) -> Axes:
    return Figure(figsize=(4.8, 4.2), layout="constrained").subplots() if ax is None else ax


def order_map(search: "OrderSearch", ax: Axes | None = None) -> Axes:
    """A criterion over na and nb, above its smallest value; each cell at its best delay, which is written in it."""
    ax = _axes(ax)
    name = search.criterion
    best = search.table.loc[search.table.groupby(["na", "nb"])[name].idxmin()]
    values = best.pivot_table(index="na", columns="nb", values=name)
    relative = name not in ("aic", "aicc", "bic")
    low = float(best[name].min())
    above = (values.to_numpy() - low) / (low if relative else 1.0)
    positive = above[above > 0]
    floor = float(positive.min()) if positive.size else 1.0
    norm = LogNorm(floor, max(float(np.nanmax(above)), 2 * floor))
    image = ax.imshow(np.maximum(above, floor), norm=norm, cmap="Blues_r", origin="lower", aspect="auto")
    unit = "times the smallest, less 1" if relative else "above the smallest"
    ax.figure.colorbar(image, ax=ax, label=f"{name} {unit}")
    ax.set_xticks(range(values.shape[1]), [str(v) for v in values.columns])
    ax.set_yticks(range(values.shape[0]), [str(v) for v in values.index])
    na, nb, nk = search.chosen
    across, up = ({int(v): k for k, v in enumerate(index)} for index in (values.columns, values.index))
    for row in best[["na", "nb", "nk"]].to_numpy(dtype=int):
        at = (across[row[1]], up[row[0]])
        dark = norm(max(above[at[1], at[0]], floor)) < 0.55
        ax.text(*at, str(row[2]), ha="center", va="center", fontsize=7, color="white" if dark else "black")
    ax.plot(across[nb], up[na], "s", ms=15, mfc="none", mec=ORANGE, mew=2)
    ax.set(xlabel="nb", ylabel="na")
    ax.set_title(f"chosen na {na}, nb {nb}, nk {nk}; number in a cell: best nk", fontsize=9)
    return ax
