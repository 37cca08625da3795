"""Pictures of gains on given axes; the only file here that imports matplotlib."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from ...core.plotting import new_axes
from .specification import LIMITS

if TYPE_CHECKING:
    from .feasible import FeasibleMap
    from .simulation import LoopTrace

BLUE, ORANGE, GREY = "#1f5fa8", "#c8551b", "#8a8a8a"
STYLES = ("-", "--", "-.", ":")


def feasible_map(found: "FeasibleMap", ax: Axes | None = None, chosen: tuple[float, float] | None = None) -> Axes:
    """The feasible region shaded, the line of each limit, Ms as thin grey lines, the chosen gains as a point."""
    ax = new_axes(ax, 5.2, 4.4)
    ax.contourf(found.kp, found.ki, found.feasible.T.astype(float), levels=[0.5, 1.5], colors=[BLUE], alpha=0.18)
    ms = np.where(np.isfinite(found.figures["ms"]), found.figures["ms"], np.nan).T
    if np.nanmin(ms) < 2.5:
        thin = ax.contour(
            found.kp, found.ki, ms, levels=[1.1, 1.2, 1.3, 1.4, 1.6, 1.8, 2, 2.5], colors=GREY, linewidths=0.5
        )
        ax.clabel(thin, fmt="Ms %g", fontsize=6)
    for k, (name, limit, value) in enumerate(found.specification.asked()):
        figure = found.figures[limit.figure].T
        figure = np.where(np.isfinite(figure), figure, np.nan)
        told = f"{LIMITS[name].words} {limit.scale * value:g}{limit.unit}"
        if np.nanmin(figure) < value < np.nanmax(figure):
            ax.contour(
                found.kp, found.ki, figure, levels=[value], colors=[BLUE], linestyles=STYLES[k % 4], linewidths=1.2
            )
            ax.plot([], [], color=BLUE, ls=STYLES[k % 4], lw=1.2, label=told)
    if chosen is not None:
        ax.plot(*chosen, "o", color=ORANGE, label=f"Kp {chosen[0]:.4g}, Ki {chosen[1]:.4g} per second")
    ax.set(xlabel="Kp", ylabel="Ki, per second")
    ax.legend(fontsize=7, loc="best")
    return ax


def loop_trace(trace: "LoopTrace", ax: Axes | None = None) -> Axes:
    """Reference, measurement and output; the command on a second axis; limits marked, time out of the cut shaded."""
    ax = new_axes(ax, 6.4, 3.6)
    t, right = trace.time, ax.twinx()
    if (trace.measurement != trace.output).any():
        ax.plot(t, trace.measurement, color=BLUE, lw=0.4, alpha=0.5, label="measurement")
    ax.plot(t, trace.reference, color=GREY, ls="--", lw=1, label="reference")
    ax.plot(t, trace.output, color=BLUE, lw=1.4, label="output")
    right.step(t, trace.command, where="post", color=ORANGE, lw=1, label="command")
    if trace.saturated.any():
        right.plot(t[trace.saturated], trace.command[trace.saturated], ".", color=ORANGE, ms=4, label="held by a limit")
    if not trace.engaged.all():
        ax.fill_between(
            t, 0, 1, where=~trace.engaged, step="post", transform=ax.get_xaxis_transform(), color=GREY, alpha=0.15, lw=0
        )
    ax.set(xlabel="time, s", ylabel=f"output, {trace.unit_y}" if trace.unit_y else "output")
    right.set_ylabel(f"command, {trace.unit_u}" if trace.unit_u else "command")
    (one, first), (two, second) = ax.get_legend_handles_labels(), right.get_legend_handles_labels()
    ax.legend(one + two, first + second, fontsize=7, loc="best")
    return ax
