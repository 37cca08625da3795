"""Figures of physical models: measured and simulated output of a step response, a drive, a force process."""

import numpy as np
from matplotlib.axes import Axes

from ...core.arrays import Array
from ...core.display import plot
from ...core.figure_style import BLUE, LINE, ORANGE, new_axes
from ...core.rounding import with_unit
from .drive import DriveFit
from .force_process import ForceProcess
from .step_response import StepFit

ANSWER = 10.0  # times to 63.2 %: the response is drawn that long


def _both(ax: Axes, time: Array, measured: Array, model: Array, label: str) -> None:
    ax.plot(time, measured, color=BLUE, lw=LINE, label="measured" if label else None)
    ax.plot(time, model, color=ORANGE, lw=LINE, ls="--", label=label or None)


@plot.register
def step_fit_figure(fit: StepFit, ax: Axes | None = None) -> Axes:
    """Every segment from its own start, from shortly before the first step until the last response has settled."""
    ax = new_axes(ax, 6.4, 3.6)
    for k, (run, fitted) in enumerate(zip(fit.runs, fit.fitted, strict=True)):
        _both(ax, run.time, run.y, fitted, f"order {fit.order} with delay" if k == 0 else "")
    answer = ANSWER * fit.time_to_63
    first = max(min(float(run.at[0]) for run in fit.runs) - answer / 4, min(float(run.time[0]) for run in fit.runs))
    last = min(max(float(run.at[-1]) for run in fit.runs) + answer, max(float(run.time[-1]) for run in fit.runs))
    ax.set(xlabel="time [s]", ylabel=with_unit(fit.output, fit.unit_y), xlim=(first, last))
    gain = f"{fit.gain:.4g} {fit.units['gain']}".rstrip()
    ax.set_title(f"gain {gain}, 63.2 % after {fit.time_to_63:.4g} s, fit {fit.fit:.1f} %")
    ax.legend()
    return ax


@plot.register
def drive_figure(fit: DriveFit, ax: Axes | None = None) -> Axes:
    """Velocity measured, and simulated from the force alone."""
    ax = new_axes(ax, 6.4, 3.6)
    simulated, percent = fit.own_run
    time = fit.motion.sample_time * np.arange(len(simulated), dtype=np.float64)
    _both(ax, time, fit.motion.v, simulated, "from the force alone")
    ax.set(xlabel="time [s]", ylabel=f"velocity [{fit.motion.speed_unit}]")
    values = ", ".join(f"{name} {fit.params[name]:.4g} {unit}" for name, unit in fit.units.items())
    ax.set_title(f"{values}; fit {percent:.1f} %")
    ax.legend(ncols=2, loc="upper left", bbox_to_anchor=(0, -0.13))
    return ax


@plot.register
def force_process_figure(fit: ForceProcess, ax: Axes | None = None) -> Axes:
    """Force measured, and simulated from the command alone."""
    ax = new_axes(ax, 6.4, 3.6)
    _both(ax, fit.time, fit.measured, fit.simulated, "from the command alone")
    ax.set(xlabel="time [s]", ylabel=with_unit(fit.output, fit.unit_y))
    poles = " and ".join(f"{p.real:.4g}" if p.imag == 0 else f"{p:.4g}" for p in fit.poles)
    over = f", averaged over {1e3 * fit.averaged:.4g} ms" if fit.averaged else ""
    ax.set_title(f"poles {poles} rad/s, fit {fit.fit:.1f} %{over}")
    ax.legend(ncols=2, loc="upper left", bbox_to_anchor=(0, -0.13))
    return ax
