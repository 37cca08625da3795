"""Pictures of replays and of lives at constant load."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from ..core.plotting import BLUE, new_axes

if TYPE_CHECKING:
    from .constant_load_milling.steady import SteadyLife
    from .loop import Trace
    from .roughness.cuts import Turned


def trace_picture(trace: "Trace", ax: Axes | None = None) -> Axes:
    """Measurement with its reference and events; the command on an axis of its own."""
    ax = new_axes(ax, 8.0, 4.0)
    ax.plot(trace.time, trace.measurement, color="#1f5fa8", lw=1.0, label=trace.labels[1])
    ax.plot(trace.time, trace.reference, color="0.4", lw=0.9, ls="--", label="reference")
    for event in trace.events[:100]:
        ax.axvline(event.time, color="0.8", lw=0.6, zorder=0)
    ax.set(xlabel="time, s", ylabel=trace.labels[1], title="Simulated")
    other = ax.twinx()
    other.plot(trace.time, trace.command, color="#b5541c", lw=1.0)
    other.set_ylabel(trace.labels[0])
    return ax


def roughness_picture(cut: "Turned", ax: Axes | None = None) -> Axes:
    """Roughness over time, with what was asked for."""
    ax = new_axes(ax, 6.4, 3.6)
    ax.plot(cut.trace.time, cut.Ra, color=BLUE, lw=0.9)
    ax.plot(cut.trace.time, cut.asked, color="0.4", lw=0.9, ls="--")
    ax.set(xlabel="time, s", ylabel="Ra, um; dashed: asked for", title="Simulated")
    return ax


def steady_picture(life: "SteadyLife", ax: Axes | None = None) -> Axes:
    """Time to the lower limit over the tools."""
    ax = new_axes(ax, 4.8, 3.6)
    minutes = life.time[np.isfinite(life.time)] / 60
    ax.hist(minutes, bins=min(30, max(1, len(minutes))), color=BLUE)
    ax.set(xlabel="in the cut until the lower limit, min", ylabel="tools", title="Calculated")
    return ax
