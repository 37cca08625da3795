"""Figures of rows of cutting tests and of a record, registered per class."""

import numpy as np
from matplotlib.axes import Axes

from ..core.display import plot
from ..core.figure_style import BLUE, GREY, ORANGE, SMALL, THIN, new_axes
from ..core.rounding import with_unit
from .records.record import Record
from .runs import Runs, edges_of

RESPONSES = ("AW", "VB", "P", "Fxz", "Fc", "F", "Fx", "I", "Ra")  # the first of these that the file has is drawn
MOST_EDGES = 60  # drawn as lines; more edges are drawn as points


@plot.register
def runs_figure(runs: Runs, ax: Axes | None = None) -> Axes:
    """A response against time, one line per edge; without a time column against the first factor."""
    ax = new_axes(ax)
    numbers = [name for name in runs.units if name in runs.data]
    y = next((name for name in RESPONSES if name in numbers), numbers[-1])
    x = "t" if "t" in numbers and y != "t" else numbers[0]
    edges = edges_of(runs)[0] if runs.has("edge") and x == "t" else np.full(len(runs), -1)
    numbered = np.unique(edges)
    joined = 1 < len(numbered) <= MOST_EDGES
    for one in numbered if joined else [None]:
        rows = edges == one if joined else np.ones(len(runs), dtype=bool)
        order = np.argsort(runs.values(x)[rows], kind="stable")
        ax.plot(runs.values(x)[rows][order], runs.values(y)[rows][order], "o-" if joined else "o", ms=3, lw=THIN,
                color=BLUE, alpha=0.7)  # fmt: skip
    ax.set_xlabel(with_unit(x, runs.units.get(x, "")))
    ax.set_ylabel(with_unit(y, runs.units.get(y, "")))
    lines = f", {len(numbered)} edges" if joined else ""
    ax.set_title(f"{runs.tool} on {runs.work}: {len(runs)} rows{lines}" + (", simulated" if runs.simulated else ""),
                 fontsize=SMALL)  # fmt: skip
    return ax


@plot.register
def record_figure(rec: Record, ax: Axes | None = None) -> Axes:
    """Output and input against time on two axes; the stretches are separated by lines."""
    ax = new_axes(ax, 7.2, 3.6)
    time = rec.sample_time * np.arange(len(rec))
    ax.plot(time, rec.y, color=BLUE, lw=THIN)
    for start in rec.starts[1:]:
        ax.axvline(time[start], color="black", lw=THIN, ls=":")
    ax.set(xlabel="time [s]")
    ax.set_ylabel(with_unit(rec.output, rec.unit_y), color=BLUE)
    ax.margins(x=0)
    other = ax.twinx()
    other.plot(time, rec.u, color=ORANGE, lw=THIN, alpha=0.7)
    other.set_ylabel(with_unit(rec.input, rec.unit_u), color=ORANGE)
    ax.set_zorder(other.get_zorder() + 1)
    ax.patch.set_visible(False)
    ax.grid(color=GREY, alpha=0.2)
    return ax
