"""Figures of PI control: feasible region, trade-off, simulated steps, loops, interpretations of published gains."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.display import plot
from ...core.figure_style import BLUE, GREY, LINE, ORANGE, SMALL, THIN, new_axes
from ...core.plotting import NotebookFigure, whiskers
from ..figures import gain_axes, settling_samples
from ..model import Model
from .controller import LoopTrace
from .feasible_region import FeasibleMap
from .gains import PiGains
from .loop import Loop, load_step, loop_of
from .published_gains import PiCheck
from .robust_design import TradeOff
from .specification import LIMITS
from .tuning import TunedPi

STYLES = ("-", "--", "-.", ":")
DRAWN = 20  # draws of the model shown with a step


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
        ax.clabel(thin, fmt="Ms %g", fontsize=SMALL)
    for k, (name, limit, value) in enumerate(found.specification.active()):
        figure = found.figures[limit.figure].T
        figure = np.where(np.isfinite(figure), figure, np.nan)
        label = f"{LIMITS[name].words} {limit.scale * value:g}{limit.unit}"
        if np.nanmin(figure) < value < np.nanmax(figure):
            ax.contour(
                found.kp, found.ki, figure, levels=[value], colors=[BLUE], linestyles=STYLES[k % 4], linewidths=1.2
            )
            ax.plot([], [], color=BLUE, ls=STYLES[k % 4], lw=LINE, label=label)
    if chosen is not None:
        ax.plot(*chosen, "o", color=ORANGE, label=f"Kp {chosen[0]:.4g}, Ki {chosen[1]:.4g} per second")
    ax.set(xlabel="Kp", ylabel="Ki [per second]")
    ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.legend(loc="best", frameon=True, framealpha=0.8, edgecolor="none")
    return ax


@plot.register
def tuned_figure(tuned: TunedPi, ax: Axes | None = None) -> Axes:
    """The feasible region with the tuned gains marked."""
    ax = feasible_map_figure(tuned.map, ax, (tuned.kp, tuned.ki))
    if tuned.gains.unit_u and tuned.gains.unit_y:
        per = f"{tuned.gains.unit_u}/{tuned.gains.unit_y}"
        ax.set(xlabel=f"Kp [{per}]", ylabel=f"Ki [{per} per second]")
    return ax


@plot.register
def trade_off_figure(found: TradeOff, ax: Axes | None = None, chosen: tuple[float, float] | None = None) -> Axes:
    """Speed against Ms, coloured by the probability of the specification; its limits, and the chosen gains."""
    ax = new_axes(ax, 5.2, 4.4)
    asked, name = found.specification, LIMITS[found.speed_name].words
    if found.probability is None:
        ax.plot(found.speed, found.ms, ".", color=BLUE, alpha=0.5, label="gains of the map")
    else:
        shown = ax.scatter(
            found.speed, found.ms, c=100 * found.probability, cmap="viridis_r", vmin=0, vmax=100, s=22, lw=0
        )
        bar = ax.figure.colorbar(shown, ax=ax)
        bar.set_label("probability of the specification [%]", fontsize=SMALL)
    ax.plot(*found.least, "-", color=GREY, lw=THIN, label="smallest Ms at each speed")
    if (limit := getattr(asked, found.speed_name)) is not None:
        ax.axvline(limit, color=BLUE, lw=LINE, ls="--", label=f"{name} <= {limit:g} s")
    if asked.ms is not None:
        ax.axhline(asked.ms, color=BLUE, lw=LINE, ls=":", label=f"Ms <= {asked.ms:g}")
    if chosen is not None:
        ax.plot(*chosen, "o", color=ORANGE, ms=8, mec="white", label="chosen gains")
    ax.set(xlabel=f"{name} [s]", ylabel="maximum sensitivity Ms")
    ax.legend(loc="upper right")
    return ax


def tuning_figure(tuned: TunedPi, step: float = 1.0) -> Figure:
    """Gains, trade-off and simulated steps of the reference and of the load, with the command, in six panels.

    Parameters
    ----------
    tuned : TunedPi
    step : float
        Of the reference, unit_y; the step of load would change the output by as much without control.
    """
    figure = NotebookFigure(figsize=(13.0, 7.6), layout="constrained")
    axes = figure.subplots(2, 3)
    tuned.plot(axes[0, 0])
    found = tuned.trade_off()
    trade_off_figure(found, axes[1, 0], (getattr(tuned.figures, found.speed_name), tuned.figures.ms))
    drawn = () if tuned.plants is None else tuned.plants.models[:DRAWN]
    _steps(tuned, drawn, step, axes[:, 1], axes[:, 2])
    u, y = tuned.gains.unit_u or "1", tuned.gains.unit_y or "1"
    size = step * load_step(loop_of(tuned.model, tuned.gains), tuned.map.duration).size
    of = f"{tuned.model.output} [{y}]"
    axes[0, 1].set(title=f"simulated step of the reference by {step:.3g} {y}", ylabel=f"change of {of}")
    axes[0, 2].set(title=f"simulated step of load\n({size:.3g} {u} at the input)", ylabel=f"deviation of {of}")
    settled = tuned.figures.settling_time
    end = min(2 * settled, tuned.map.duration) if np.isfinite(settled) and settled else tuned.map.duration
    for ax in axes[:, 1:].flat:
        ax.set_xlim(-0.02 * end, end)
    for ax in axes[1, 1:]:
        ax.set(xlabel="time [s]", ylabel=f"change of the command [{u}]")
    axes[0, 0].set_title("gains")
    axes[1, 0].set_title("speed, robustness and probability")
    if drawn:
        axes[1, 1].set_title(f"thin grey lines: {len(drawn)} draws of the model uncertainty")
    for ax in axes.flat:
        ax.title.set_fontsize(9)
    return figure


def _steps(tuned: TunedPi, drawn: Sequence[Model], step: float, left: Sequence[Axes], right: Sequence[Axes]) -> None:
    """Output above and command below, after steps of the reference and of the load, on the model and on draws."""
    duration = tuned.map.duration
    size = load_step(loop_of(tuned.model, tuned.gains), duration).size
    for k, model in enumerate((*drawn, tuned.model)):
        loop = loop_of(model, tuned.gains)
        if not loop.stable:
            continue
        load = load_step(loop, duration)
        n, last = len(load.time), k == len(drawn)
        color, width, alpha = (BLUE, 1.4, 1.0) if last else (GREY, 0.4, 0.5)
        same = size / load.size  # one step of load for all models
        rows = (loop.step(n), loop.command_step(n), same * load.output, same * load.command)
        for ax, row in zip((*left, *right), rows, strict=True):
            ax.step(load.time, step * row, where="post", color=color, lw=width, alpha=alpha)
    left[0].axhline(step, color=GREY, lw=THIN, ls="--")
    right[0].axhline(0.0, color=GREY, lw=THIN, ls="--")
    asked = tuned.specification
    for name, style in (("overshoot", "--"), ("undershoot", ":")):
        if limit := getattr(asked, name):
            level = 1 + limit if name == "overshoot" else -limit
            left[0].axhline(step * level, color=ORANGE, lw=THIN, ls=style, label=f"{name} {100 * limit:g} %")
    if asked.settling_time is not None:
        left[0].axvline(asked.settling_time, color=ORANGE, lw=THIN, label=f"settled after {asked.settling_time:g} s")
    if left[0].get_legend_handles_labels()[0]:
        left[0].legend(loc="lower right")


@plot.register
def loop_trace_figure(trace: LoopTrace, ax: Axes | None = None) -> Axes:
    """Reference, measurement, output and command; active limits marked, time out of the cut shaded."""
    ax = new_axes(ax, 6.4, 3.6)
    t, right = trace.time, ax.twinx()
    if (trace.measurement != trace.output).any():
        ax.plot(t, trace.measurement, color=BLUE, lw=THIN, alpha=0.5, label="measurement")
    ax.plot(t, trace.reference, color=GREY, ls="--", lw=THIN, label="reference")
    ax.plot(t, trace.output, color=BLUE, lw=LINE, label="output")
    right.step(t, trace.command, where="post", color=ORANGE, lw=THIN, label="command")
    if trace.saturated.any():
        right.plot(t[trace.saturated], trace.command[trace.saturated], ".", color=ORANGE, ms=4, label="at a limit")
    if not trace.engaged.all():
        ax.fill_between(
            t, 0, 1, where=~trace.engaged, step="post", transform=ax.get_xaxis_transform(), color=GREY, alpha=0.15, lw=0
        )
    ax.set(xlabel="time [s]", ylabel=f"output [{trace.unit_y}]" if trace.unit_y else "output")
    right.set_ylabel(f"command [{trace.unit_u}]" if trace.unit_u else "command")
    (one, first), (two, second) = ax.get_legend_handles_labels(), right.get_legend_handles_labels()
    ax.legend(one + two, first + second, loc="best")
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
    ax.axhline(1, color=GREY, lw=THIN, ls="--")
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
    ax.set_title("blue: stable, orange: meets the specification")
    return ax
