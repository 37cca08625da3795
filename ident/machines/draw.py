"""Pictures of steps, drives and force processes on given axes: measured below, simulated above."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ...core.plotting import new_axes

if TYPE_CHECKING:
    from .drive import DriveFit
    from .force_process import ForceProcess
    from .step_response import StepFit

Array = NDArray[np.float64]
BLUE, ORANGE = "#1f5fa8", "#c8551b"


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def _both(ax: Axes, time: Array, measured: Array, model: Array, label: str) -> None:
    ax.plot(time, measured, color=BLUE, lw=1.2, label="measured" if label else None)
    ax.plot(time, model, color=ORANGE, lw=1.2, ls="--", label=label or None)


def step_picture(fit: "StepFit", ax: Axes | None = None) -> Axes:
    """Every stretch from its own start."""
    ax = new_axes(ax, 6.4, 3.6)
    for k, (run, fitted) in enumerate(zip(fit.runs, fit.fitted, strict=True)):
        _both(ax, run.time, run.y, fitted, f"order {fit.order} with delay" if k == 0 else "")
    ax.set(xlabel="time (s)", ylabel=_with_unit(fit.output, fit.unit_y))
    ax.set_title(f"gain {fit.gain:.4g}, 63.2 % after {fit.time_to_63:.4g} s, fit {fit.fit:.1f} %", fontsize=9)
    ax.legend(frameon=False, fontsize=8)
    return ax


def drive_picture(fit: "DriveFit", ax: Axes | None = None) -> Axes:
    """Velocity measured, and simulated from the force alone."""
    ax = new_axes(ax, 6.4, 3.6)
    simulated, percent = fit.own_run
    time = fit.motion.sample_time * np.arange(len(simulated), dtype=np.float64)
    _both(ax, time, fit.motion.v, simulated, "from the force alone")
    ax.set(xlabel="time (s)", ylabel=f"velocity ({fit.motion.speed_unit})")
    ax.set_title(
        f"M {fit.M:.4g}, Fv {fit.Fv:.4g}, Fc {fit.Fc:.3g}, offset {fit.offset:.3g}, fit {percent:.1f} %", fontsize=9
    )
    ax.legend(frameon=False, fontsize=8)
    return ax


def force_picture(fit: "ForceProcess", ax: Axes | None = None) -> Axes:
    """Force measured, and simulated from the command alone."""
    ax = new_axes(ax, 6.4, 3.6)
    _both(ax, fit.time, fit.measured, fit.simulated, "from the command alone")
    ax.set(xlabel="time (s)", ylabel=_with_unit(fit.output, fit.unit_y))
    poles = " and ".join(f"{p.real:.4g}" if p.imag == 0 else f"{p:.4g}" for p in fit.poles)
    ax.set_title(f"poles {poles} rad/s, fit {fit.fit:.1f} %", fontsize=9)
    ax.legend(frameon=False, fontsize=8)
    return ax
