"""Sheets of panels, their layout, and the credible bands drawn in them.

Bands of rows are those of rows of a new edge: variance between edges and within them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, exp, log
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from ...core.plotting import NotebookAxes, NotebookFigure
from ...core.plotting import axes_array as together
from ..law_figures import round_numbers
from ..lawfit import LawFit
from .posterior import Posterior

Panel = Callable[[Axes], None]

MOST_PANELS = 24


@dataclass(frozen=True, slots=True)
class Sheet:
    """Panels in reading order, None for an empty place; ``shared`` panels have axis labels at the border only."""

    title: str
    panels: Sequence[Panel | None]
    across: int
    size: tuple[float, float]  # of a panel, inches
    gaps: tuple[float, float] = (0.34, 0.5)  # horizontal and vertical, in panels
    shared: bool = False


def laid_out(sheet: Sheet, banner: str) -> NDArray[np.object_]:
    """The panels on a figure of their own: banner and title over them, legend under them; margins in inches."""
    down = ceil(len(sheet.panels) / sheet.across)
    width, height = max(sheet.across * sheet.size[0] + 0.9, 4.8), down * sheet.size[1] + 1.7
    title, banner = fill(sheet.title, int(width / 0.082)), fill(banner, int(width / 0.066))
    top = 0.1 + 0.13 * (banner.count("\n") + 1)
    figure = NotebookFigure(figsize=(width, height))
    figure.suptitle(title, fontsize=10, y=1 - top / height, va="top")
    figure.text(0.995, 0.995, banner, ha="right", va="top", fontsize=8, color="#a33")
    grid = figure.add_gridspec(down, sheet.across)
    axes = np.array([None] * len(sheet.panels), dtype=object)
    for i, panel in enumerate(sheet.panels):
        if panel is not None:
            axes[i] = figure.add_subplot(grid[divmod(i, sheet.across)], axes_class=NotebookAxes)
            axes[i].tick_params(labelsize=8)
            panel(axes[i])
            if sheet.shared:
                _border_only(axes[i], i % sheet.across > 0, any(sheet.panels[i + sheet.across :: sheet.across]))
    drawn = together([ax for ax in axes if ax is not None])
    shown = {text: handle for ax in drawn for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    across = 6 if width > 8 else 3
    figure.legend(shown.values(), shown.keys(), loc="lower center", ncols=across, frameon=False, fontsize=8)
    figure.subplots_adjust(
        left=0.8 / width, right=1 - 0.2 / width, bottom=(0.58 + 0.18 * ceil(len(shown) / across)) / height,
        top=1 - (top + 0.45 + 0.16 * title.count("\n")) / height, wspace=sheet.gaps[0], hspace=sheet.gaps[1],
    )  # fmt: skip
    return drawn


def alone(sheet: Sheet, banner: str, ax: Axes) -> NDArray[np.object_]:
    """The one panel on axes that were given."""
    (panel,) = sheet.panels
    if panel is not None:
        panel(ax)
    ax.set_title("\n".join(filter(None, (fill(sheet.title, 60), ax.get_title()))), fontsize=9)
    ax.text(0.99, 0.01, fill(banner, 60), ha="right", fontsize=8, color="#a33", transform=ax.transAxes)
    ax.legend(frameon=False, fontsize=8)
    return np.array([ax], dtype=object)


def _border_only(ax: Axes, right: bool, above: bool) -> None:
    if right:
        ax.set_ylabel("")
        ax.tick_params(axis="y", which="both", labelleft=False)
    if above:
        ax.set_xlabel("")
        ax.tick_params(axis="x", which="both", labelbottom=False)


Array = NDArray[np.float64]

WHOLE, HALF = (0.025, 0.975), (0.25, 0.75)


def conditions(law: LawFit, X: Array, level: NDArray[np.intp]) -> pd.DataFrame:
    """Factors (n, k), and the level of the category, as a table for predictions."""
    new = pd.DataFrame(X, columns=list(law.factors))
    return new if law.by is None else new.assign(**{law.by.column: np.array(levels_of(law))[level]})


def levels_of(law: LawFit) -> tuple[str, ...]:
    """Levels of the category, the reference first; one empty name where there is none."""
    return ("",) if law.by is None else (law.by.reference, *law.by.levels)


def level_of_rows(law: LawFit) -> NDArray[np.intp]:
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


def evenly(of: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most ``most`` of the positions (n,), evenly chosen, the first and the last among them."""
    return of[np.linspace(0, len(of) - 1, min(len(of), most)).round().astype(np.intp)]
