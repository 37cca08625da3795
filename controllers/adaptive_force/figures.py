"""Figures of the adaptive force loop, all of simulated runs."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.arrays import Array
from ...core.figure_style import BLUE, GREEN, GREY, LINE, ORANGE, SMALL, THIN
from ...core.plotting import NotebookFigure

if TYPE_CHECKING:
    from .runs import ForceRun
    from .stability import StepSize

COLOURS = {"adaptive": BLUE, "pi": ORANGE}
NAMES = {"adaptive": "adaptive law", "pi": "fixed PI"}
FLOOR = 1e-16  # of V: below it a rise is rounding


def depths_figure(runs: Sequence["ForceRun"], others: Sequence["ForceRun"] = (), unit_depth: str = "mm") -> Figure:
    """Force against set point, its error, and the feed at each depth: Figs 7-9 of the paper, with the feed added."""
    figure = NotebookFigure(figsize=(11.0, 7.0), layout="constrained")
    grid = figure.subplots(3, len(runs), sharex=True, squeeze=False)
    unit_u, unit_force = _units(runs[0])
    for column, run in enumerate(runs):
        force, error, feed = grid[:, column]
        point, depth = run.settings.set_point, run.depths[0][1]
        force.plot(run.trace.time, run.trace.measurement, color="0.82", lw=THIN, label="reading")
        force.plot(run.trace.time, run.trace.reference, color=GREY, lw=THIN, ls="--", label="F_d")
        for one in (run, *others[column : column + 1]):
            _line(force, one, one.force)
            _line(error, one, 100 * (one.force - point) / point)
            _line(feed, one, one.trace.command)
        error.axhspan(-2, 2, color="0.9", zorder=0)
        error.set_ylim(-15, 15)
        force.set_title(f"depth {depth:g} {unit_depth}, set point {point:g} {unit_force}")
        feed.set_xlabel("time [s]")
    labels = (f"force [{unit_force}]", "error of the mean [%]", f"feed command [{unit_u}]")
    for ax, words in zip(grid[:, 0], labels, strict=True):
        ax.set_ylabel(words)
    grid[0, 0].legend(loc="lower right")
    figure.suptitle("Simulated: force averaged over a revolution, at each depth (grey band: 2 %)")
    return figure


def steps_figure(run: "ForceRun", other: "ForceRun | None" = None, unit_depth: str = "mm") -> Figure:
    """Depth, force and feed of a cut whose depth steps."""
    figure = NotebookFigure(figsize=(9.0, 6.5), layout="constrained")
    depth, force, feed = figure.subplots(3, 1, sharex=True, height_ratios=(1, 2, 2))
    times, values = zip(*run.depths, (run.trace.time[-1], run.depths[-1][1]), strict=True)
    depth.step(times, values, where="post", color=GREY, lw=LINE)
    unit_u, unit_force = _units(run)
    depth.set(ylabel=f"depth [{unit_depth}]", ylim=(0, 1.15 * max(values)))
    point = run.settings.set_point
    force.axhspan(0.98 * point, 1.02 * point, color="0.9", zorder=0)
    for one in (run, *(() if other is None else (other,))):
        _line(force, one, one.force)
        _line(feed, one, one.trace.command)
    force.set_ylabel(f"force, mean of a\nrevolution [{unit_force}]")
    force.legend(loc="upper left")
    feed.axhline(run.settings.low, color=GREY, lw=THIN, ls=":")
    feed.axhline(run.settings.high, color=GREY, lw=THIN, ls=":")
    feed.set(xlabel="time [s]", ylabel=f"feed command [{unit_u}]\n(dotted: limits)")
    figure.suptitle(f"Simulated: steps of depth at a set point of {point:g} {unit_force} (grey band: 2 %)")
    return figure


def lyapunov_figure(run: "ForceRun") -> Figure:
    """V along a run, and the estimates over their true values."""
    figure = NotebookFigure(figsize=(9.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    found, time = run.energy(), run.trace.time
    drawn = np.maximum(found.V, 1e-12 * found.V.max())
    upper.semilogy(time, drawn, color="0.75", lw=THIN, label="V where the depth or a limit just changed")
    upper.semilogy(time, np.where(found.free, drawn, np.nan), color=BLUE, lw=LINE, label="V where the proof applies")
    upper.set(ylabel=f"V [{' '.join(reversed(_units(run)))}]", ylim=(1e-7 * float(found.V[found.free].max()), None))
    upper.legend(loc="lower right")
    recorded, plant = run.trace.recorded, run.plant
    true = {"m": plant.m, "alpha": plant.m * plant.c + plant.d, "beta": plant.d * plant.c}
    for (name, value), colour, word in zip(true.items(), (GREEN, ORANGE, BLUE), "mαβ", strict=True):
        lower.plot(time, recorded[name] * recorded["k"] / value, color=colour, lw=LINE, label=word)
    lower.axhline(1.0, color=GREY, lw=THIN, ls="--")
    lower.set(xlabel="time [s]", ylabel="estimate over its true value")
    lower.legend(ncols=3, loc="upper right")
    figure.suptitle(
        "Simulated: V and the estimates; a step of depth changes the true values, a constant F_d excites beta only",
    )
    return figure


def step_size_figure(rows: Sequence["StepSize"]) -> Figure:
    """The largest rise of V over the step; at the top the runs that diverge, or oscillate between the limits."""
    figure = NotebookFigure(figsize=(8.0, 4.8), layout="constrained")
    ax = figure.subplots()
    looks = {("as built", True): (BLUE, "o"), ("as printed", True): (ORANGE, "s"), ("as built", False): (GREEN, "^")}
    for i, (way, times) in enumerate(dict.fromkeys((row.way, row.times) for row in rows)):
        some = [row for row in rows if (row.way, row.times) == (way, times)]
        colour, marker = looks.get((way, times == 1), (GREY, "v"))
        kept = [row for row in some if row.settled]
        label = way if times == 1 else f"{way}, {times:g} Kd"
        ax.loglog([1e3 * r.step for r in kept], [max(r.rise, FLOOR) for r in kept], color=colour, marker=marker, ms=5,
                  lw=LINE, label=label)  # fmt: skip
        for sign, those in (("x", [r for r in some if r.diverged]), (marker, _swinging(some))):
            ax.plot([1e3 * r.step for r in those], [10.0 ** (2 * i)] * len(those), sign, color=colour, ms=7, mew=1.5,
                    mfc="none")  # fmt: skip
    ax.set_yticks(10.0 ** np.arange(-16, 0, 2))
    ax.minorticks_off()
    ax.axhspan(FLOOR / 10, 1e-12, color="0.92", zorder=0)
    ax.axhline(0.1, color="0.7", lw=THIN)
    ax.text(0.11, 2e-13, "rounding: V does not rise", fontsize=SMALL, color=GREY, va="top")
    ax.text(
        0.09,
        0.2,
        "does not settle: diverges (cross), or oscillates between the limits (open)",
        fontsize=SMALL,
        color=GREY,
    )
    ax.set(
        xlabel="step of the law [ms]", ylabel="largest rise of V, share of V at the start", ylim=(FLOOR / 10, 1e8),
        title="Simulated: deepest cut, no ripple",
    )  # fmt: skip
    ax.legend(loc=(0.62, 0.25))
    return figure


def _units(run: "ForceRun") -> list[str]:
    """Units of command and force, from the labels ``feed command, mm/min`` and ``force, N``."""
    return [label.rpartition(", ")[2] for label in run.settings.labels]


def _swinging(rows: Sequence["StepSize"]) -> list["StepSize"]:
    return [row for row in rows if not row.diverged and not row.settled]


def _line(ax: Axes, run: "ForceRun", values: Array) -> None:
    ax.plot(run.trace.time, values, color=COLOURS[run.by], lw=LINE, label=NAMES[run.by])
