"""Figures of tool runs: over the cutting length as the paper's Figs 11 and 14, one pass as Fig 9."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.arrays import Array
from ...core.display import plot
from ...core.figure_style import BLUE, GREEN, GREY, LINE, ORANGE, SMALL, THIN, new_axes
from ...core.plotting import NotebookFigure
from ...core.rounding import format_decimal
from .cut_model import unit_factor
from .runs import ToolRun
from .steady import SteadyLife

if TYPE_CHECKING:
    from ...parameters.sections.load_line import LoadLineSection

LOAD, FEED, OTHER = BLUE, ORANGE, GREEN
MOST = 6000  # points of a line
LABEL = {"I": "spindle current"}


def run_figure(
    run: ToolRun, line: "LoadLineSection", fixed: ToolRun | None = None, work: str = "", wear: str = "VB"
) -> Figure:
    """Load and feed over cutting length, with the mean of each pass, the limits, and a run at constant feed."""
    figure = NotebookFigure(figsize=(8.0, 6.2), layout="constrained")
    load, feed = figure.subplots(2, 1, sharex=True)
    name = LABEL.get(line.load, "load")
    load.axhline(
        line.reference, color=GREY, lw=THIN, ls="--", zorder=4, label=f"reference {line.reference:g} {line.unit_load}"
    )
    _along(load, run, run.trace.measurement, LOAD, "constant load")
    held = [p for p in run.passes if p.mean_load is not None]
    middles = [p.start + p.length / 2 for p in held]
    means = [p.mean_load for p in held]
    load.plot(middles, means, "o", ms=4.5, mfc="white", mec="black", zorder=5, label="mean of a pass, settled")
    _along(feed, run, run.trace.recorded["feed"], FEED, "constant load")
    if fixed is not None:
        _along(
            load,
            fixed,
            fixed.trace.measurement,
            OTHER,
            f"constant feed, {format_decimal(feed_of(fixed, line))} {line.unit_feed}",
        )
        _along(feed, fixed, fixed.trace.recorded["feed"], OTHER, "constant feed")
    for value in (line.lower.value, line.upper.value):
        feed.axhline(value, color=GREY, lw=THIN, ls="--")
    feed.annotate(
        "feed limits", (0.0, line.lower.value), (4, 4), textcoords="offset points", color=GREY, fontsize=SMALL
    )
    if run.worn:
        for ax in (load, feed):
            ax.axvline(run.length, color="0.6", lw=THIN, ls=":")
        end, over = (run.length, 0.04), ("data", "axes fraction")
        words = f"tool change, {wear} {run.wear:.3g} {line.unit_wear}"
        load.annotate(words, end, (-6, 0), xycoords=over, textcoords="offset points", ha="right", fontsize=SMALL)
    load.set(ylabel=f"{name} [{line.unit_load}]", title=f"Simulated: constant load{', ' + work if work else ''}")
    feed.set(ylabel=f"feed [{line.unit_feed}]", xlabel="cutting length [mm]", xlim=(0, None))
    feed.margins(y=0.12)
    load.legend(loc="lower left")
    return figure


def pass_figure(run: ToolRun, line: "LoadLineSection", number: int = 2, settle: float = 4.0) -> Figure:
    """One pass in time: load with the band of 1 % about the reference, and feed; the settling time shaded."""
    figure = NotebookFigure(figsize=(8.0, 5.2), layout="constrained")
    load, feed = figure.subplots(2, 1, sharex=True)
    r = run.trace.recorded
    rows = np.flatnonzero((r["number"] == number) & (r["in_cut"] > 0))
    time = run.trace.time[rows] - run.trace.time[rows[0]]
    one = next(p for p in run.passes if p.number == number)
    ref = line.reference
    load.axhspan(0.99 * ref, 1.01 * ref, color=LOAD, alpha=0.12, lw=0, label="reference +- 1 %")
    load.axhline(ref, color=GREY, lw=THIN, ls="--")
    load.plot(time, run.trace.measurement[rows], color=LOAD, lw=LINE)
    low, high = load.get_ylim()
    load.set_ylim(min(low, 0.98 * ref), max(high, 1.02 * ref))
    feed.plot(time, r["feed"][rows], color=FEED, lw=LINE)
    feed.margins(y=0.15)
    for ax in (load, feed):
        ax.axvspan(0.0, settle, color="0.9", lw=0, zorder=0)
    load.annotate("settling, excluded", (0.0, 1.0), (4, -4), xycoords=("data", "axes fraction"),
                  textcoords="offset points", va="top", fontsize=SMALL, color=GREY)  # fmt: skip
    at = f"{one.start:.0f} to {one.start + one.length:.0f} mm"
    load.set(ylabel=f"{LABEL.get(line.load, 'load')} [{line.unit_load}]", title=f"Simulated: pass {number}, {at}")
    feed.set(ylabel=f"feed [{line.unit_feed}]", xlabel="time in the pass [s]", xlim=(0, None))
    load.legend(loc="upper right")
    return figure


def feed_of(run: ToolRun, line: "LoadLineSection") -> float:
    """Mean feed of a run in the unit of the settings."""
    return run.mean_feed * unit_factor("mm/min", line.unit_feed)


def _along(ax: Axes, run: ToolRun, values: Array, color: str, label: str) -> None:
    """Values in the cut over cutting length, broken between passes."""
    r = run.trace.recorded
    step = max(len(values) // MOST, 1)
    y = np.where(r["in_cut"] > 0, values, np.nan)[::step]
    ax.plot(r["length"][::step], y, color=color, lw=THIN, label=label)


@plot.register
def plot_tool_run(run: ToolRun, ax: Axes | None = None) -> Axes:
    """Load with its reference, and the feed command."""
    axes: Axes = plot(run.trace, ax)
    return axes


@plot.register
def plot_steady_life(life: SteadyLife, ax: Axes | None = None) -> Axes:
    """Histogram over the tools of the time to the lower feed limit."""
    ax = new_axes(ax, 4.8, 3.6)
    minutes = life.time[np.isfinite(life.time)] / 60
    ax.hist(minutes, bins=min(30, max(1, len(minutes))), color=BLUE)
    ax.set(xlabel="in the cut until the lower limit [min]", ylabel="tools", title="Calculated")
    return ax
