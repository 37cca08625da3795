"""Figures of PI control: feasible region, loops, interpretations of published gains."""

import numpy as np
from matplotlib.axes import Axes

from ...core.display import plot
from ...core.plotting import BLUE, GREY, ORANGE, new_axes, whiskers
from ..figures import gain_axes, settling_samples
from .controller import LoopTrace
from .feasible_region import FeasibleMap
from .gains import PiGains
from .loop import Loop
from .published_gains import PiCheck
from .specification import LIMITS
from .tuning import TunedPi

STYLES = ("-", "--", "-.", ":")


@plot.register
def feasible_map_figure(found: FeasibleMap, ax: Axes | None = None, chosen: tuple[float, float] | None = None) -> Axes:
    """The feasible region shaded, the line of each limit, Ms as thin grey lines, the chosen gains as a point."""
    ax = new_axes(ax, 5.2, 4.4)
    ax.contourf(found.kp, found.ki, found.feasible.T.astype(float), levels=[0.5, 1.5], colors=[BLUE], alpha=0.18)
    ms = np.where(np.isfinite(found.figures["ms"]), found.figures["ms"], np.nan).T
    if np.nanmin(ms) < 2.5:
        thin = ax.contour(
            found.kp, found.ki, ms, levels=[1.1, 1.2, 1.3, 1.4, 1.6, 1.8, 2, 2.5], colors=GREY, linewidths=0.5
        )
        ax.clabel(thin, fmt="Ms %g", fontsize=6)
    for k, (name, limit, value) in enumerate(found.specification.active()):
        figure = found.figures[limit.figure].T
        figure = np.where(np.isfinite(figure), figure, np.nan)
        label = f"{LIMITS[name].words} {limit.scale * value:g}{limit.unit}"
        if np.nanmin(figure) < value < np.nanmax(figure):
            ax.contour(
                found.kp, found.ki, figure, levels=[value], colors=[BLUE], linestyles=STYLES[k % 4], linewidths=1.2
            )
            ax.plot([], [], color=BLUE, ls=STYLES[k % 4], lw=1.2, label=label)
    if chosen is not None:
        ax.plot(*chosen, "o", color=ORANGE, label=f"Kp {chosen[0]:.4g}, Ki {chosen[1]:.4g} per second")
    ax.set(xlabel="Kp", ylabel="Ki, per second")
    ax.legend(fontsize=7, loc="best")
    return ax


@plot.register
def tuned_figure(tuned: TunedPi, ax: Axes | None = None) -> Axes:
    """The feasible region with the tuned gains marked."""
    return feasible_map_figure(tuned.map, ax, (tuned.kp, tuned.ki))


@plot.register
def loop_trace_figure(trace: LoopTrace, ax: Axes | None = None) -> Axes:
    """Reference, measurement, output and command; active limits marked, time out of the cut shaded."""
    ax = new_axes(ax, 6.4, 3.6)
    t, right = trace.time, ax.twinx()
    if (trace.measurement != trace.output).any():
        ax.plot(t, trace.measurement, color=BLUE, lw=0.4, alpha=0.5, label="measurement")
    ax.plot(t, trace.reference, color=GREY, ls="--", lw=1, label="reference")
    ax.plot(t, trace.output, color=BLUE, lw=1.4, label="output")
    right.step(t, trace.command, where="post", color=ORANGE, lw=1, label="command")
    if trace.saturated.any():
        right.plot(t[trace.saturated], trace.command[trace.saturated], ".", color=ORANGE, ms=4, label="at a limit")
    if not trace.engaged.all():
        ax.fill_between(
            t, 0, 1, where=~trace.engaged, step="post", transform=ax.get_xaxis_transform(), color=GREY, alpha=0.15, lw=0
        )
    ax.set(xlabel="time, s", ylabel=f"output, {trace.unit_y}" if trace.unit_y else "output")
    right.set_ylabel(f"command, {trace.unit_u}" if trace.unit_u else "command")
    (one, first), (two, second) = ax.get_legend_handles_labels(), right.get_legend_handles_labels()
    ax.legend(one + two, first + second, fontsize=7, loc="best")
    return ax


@plot.register
def gains_figure(gains: PiGains, ax: Axes | None = None) -> Axes:
    """Gain of the controller over frequency."""
    (num, den), dt = gains.transfer_function, gains.sample_time
    f = np.geomspace(0.5e-4 / dt, 0.499 / dt, 300)
    z = np.exp(-2j * np.pi * f * dt)
    gain = np.abs(np.polyval(np.asarray(num)[::-1], z) / np.polyval(np.asarray(den)[::-1], z))
    return gain_axes(new_axes(ax), f, gain, gains.unit_u, gains.unit_y)


@plot.register
def loop_figure(loop: Loop, ax: Axes | None = None) -> Axes:
    """Output after a unit step of the reference."""
    ax = new_axes(ax)
    n = settling_samples(loop.radius)
    time = loop.model.sample_time * np.arange(n)
    ax.plot(time, loop.step(n), color=BLUE, drawstyle="steps-post")
    ax.axhline(1, color=GREY, lw=0.8, ls="--")
    ax.set(xlabel="time [s]", ylabel=f"{loop.model.output}, unit step of the reference")
    return ax


@plot.register
def check_figure(found: PiCheck, ax: Axes | None = None) -> Axes:
    """Scalings of the command in which each interpretation is stable, and meets the specification."""
    ax = whiskers({reading.words: (1.0, np.nan, np.nan) for reading in found.interpretations}, ax)
    for line in ax.get_lines():
        line.set_visible(False)
    for at, reading in enumerate(found.interpretations):
        for intervals, colour, width in ((reading.stable, BLUE, 3.0), (reading.meets, ORANGE, 6.0)):
            for low, high in intervals:
                ax.plot([low, high], [at, at], "|-", color=colour, lw=width, solid_capstyle="butt")
    ax.set(xscale="log", xlabel=f"scaling, {found.command_unit or '1'} per {found.input_unit or '1'}")
    ax.set_title("blue: stable, orange: meets the specification", fontsize=9)
    return ax
