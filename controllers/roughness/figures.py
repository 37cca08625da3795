"""Figures of turning at constant roughness; all are simulated."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.arrays import Flags
from ...core.display import plot
from ...core.figure_style import BLUE, LINE, ORANGE, SMALL, THIN, new_axes
from ...core.plotting import NotebookFigure
from .simulations import TableSimulation, TurningRun

GREY = "0.45"
SIMULATED = "Simulated on a reconstructed plant"


def comparison_figure(
    without: TurningRun, controlled: TurningRun, sections: Sequence[tuple[str, float]] = ()
) -> Figure:
    """Roughness, force and feed of two runs side by side, as in SURF's Fig. 5.

    Parameters
    ----------
    without, controlled : TurningRun
    sections : sequence of (str, float)
        Names of segments of the run, and their starts, s.
    """
    figure = NotebookFigure(figsize=(9.0, 7.0), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    for column, (cut, title) in enumerate(((without, "constant feed"), (controlled, "with control"))):
        _column(axes[:, column], cut, sections)
        axes[0, column].set_title(title, pad=16)
    for ax, label in zip(axes[:, 0], ("Ra [um]", "F [N]", "f [mm/rev]"), strict=True):
        ax.set_ylabel(label)
        ax.set_ylim(bottom=0)
    axes[0, 0].legend(loc="upper right")
    axes[2, 1].legend(loc="lower left", bbox_to_anchor=(0.0, 0.12))
    figure.suptitle(f"{SIMULATED}: force disturbed at random by up to 10 %")
    return figure


def _column(axes: Sequence[Axes], cut: TurningRun, sections: Sequence[tuple[str, float]]) -> None:
    t, recorded = cut.trace.time, cut.trace.recorded
    axes[0].plot(t, cut.Ra, color=BLUE, lw=THIN)
    axes[0].plot(t, cut.required, color="black", lw=LINE, ls="--", label="required")
    axes[1].plot(t, recorded["force"], color=BLUE, lw=THIN)
    axes[1].plot(t, cut.trace.reference, color="black", lw=LINE, ls="--")
    axes[2].plot(t, cut.trace.command, color=ORANGE, lw=THIN, label="command")
    axes[2].plot(t, recorded["feed"], color=BLUE, lw=LINE, label="servo's output")
    axes[2].set_xlabel("time [s]")
    for ax in axes:
        for _, start in sections[1:]:
            ax.axvline(start, color="0.8", lw=THIN, zorder=0)
    axes[2].axhline(cut.high, color="0.7", lw=THIN, ls=":", label="limits")
    axes[2].axhline(cut.low, color="0.7", lw=THIN, ls=":")
    ends = [*(start for _, start in sections[1:]), t[-1]]
    for (name, start), end in zip(sections, ends, strict=False):
        at = (start + end) / 2, 1.02
        axes[0].annotate(name, at, xycoords=("data", "axes fraction"), fontsize=SMALL, ha="center", color=GREY)


def readings_figure(servo: TurningRun, command: TurningRun, title: str = "", until: float = 6.0) -> Figure:
    """Feed and force with f(t-1) read as the servo's output and as the last command."""
    figure = NotebookFigure(figsize=(9.0, 4.8), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    names = "f(t-1) is the servo's output", "f(t-1) is the last command"
    for column, (cut, name) in enumerate(zip((servo, command), names, strict=True)):
        part = cut.trace.time <= until
        t = cut.trace.time[part]
        _feed(axes[0, column], cut, part)
        axes[1, column].plot(t, cut.trace.recorded["force"][part], color=BLUE, lw=THIN)
        axes[1, column].plot(t, cut.trace.reference[part], color="black", lw=LINE, ls="--")
        axes[0, column].set_title(name)
        axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("f [mm/rev]")
    axes[1, 0].set_ylabel("F [N]")
    axes[0, 0].set_ylim(bottom=0)
    axes[1, 0].set_ylim(bottom=0)
    axes[0, 0].legend(loc="lower right")
    figure.suptitle(f"{SIMULATED}. {title}".rstrip())
    return figure


def _feed(ax: Axes, cut: TurningRun, part: Flags) -> None:
    t = cut.trace.time[part]
    ax.plot(t, cut.trace.command[part], color=ORANGE, lw=THIN, label="command")
    ax.plot(t, cut.trace.recorded["feed"][part], color=BLUE, lw=LINE, label="servo's output")
    for limit in (cut.low, cut.high):
        ax.axhline(limit, color="0.7", lw=THIN, ls=":")


def table_figure(found: Sequence[TableSimulation], title: str = "") -> Figure:
    """Mean roughness of the eight simulations against the required one, with control, without, and as printed."""
    figure = NotebookFigure(figsize=(6.4, 4.8), layout="constrained")
    ax = figure.subplots()
    required = np.array([run.row.Ra_ref for run in found])
    ax.fill_between(required, -3, 3, color="0.92", lw=0, label="within 3 %")
    for values, style, name in (
        ([run.error for run in found], {"marker": "o", "color": BLUE}, "with control"),
        ([run.error_without for run in found], {"marker": "s", "color": ORANGE}, "constant feed of Table 1"),
        (
            [run.row.Ra / run.row.Ra_ref - 1 for run in found],
            {"marker": "x", "color": GREY},
            "with control, as printed",
        ),
    ):
        ax.plot(required, 100 * np.array(values), lw=THIN, label=name, **style)  # type: ignore[arg-type]
    ax.set(xlabel="required Ra [um]", ylabel="deviation of mean Ra from the required one [%]")
    ax.legend()
    ax.set_title(f"{SIMULATED}{title}")
    return figure


@plot.register
def plot_roughness(run: TurningRun, ax: Axes | None = None) -> Axes:
    """Roughness over time, with the required one."""
    ax = new_axes(ax, 6.4, 3.6)
    ax.plot(run.trace.time, run.Ra, color=BLUE, lw=THIN)
    ax.plot(run.trace.time, run.required, color=GREY, lw=THIN, ls="--")
    ax.set(xlabel="time [s]", ylabel="Ra [um]; dashed: required", title="Simulated")
    return ax
