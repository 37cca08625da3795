"""The picture of a replay."""

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from .loop import Trace


def trace_picture(trace: "Trace", ax: Axes | None = None) -> Axes:
    """Measurement with its reference and events; the command on an axis of its own."""
    ax = Figure(figsize=(8.0, 4.0), layout="constrained").subplots() if ax is None else ax
    ax.plot(trace.time, trace.measurement, color="#1f5fa8", lw=1.0, label=trace.labels[1])
    ax.plot(trace.time, trace.reference, color="0.4", lw=0.9, ls="--", label="reference")
    for event in trace.events[:100]:
        ax.axvline(event.time, color="0.8", lw=0.6, zorder=0)
    ax.set(xlabel="time, s", ylabel=trace.labels[1], title="Simulated")
    other = ax.twinx()
    other.plot(trace.time, trace.command, color="#b5541c", lw=1.0)
    other.set_ylabel(trace.labels[0])
    return ax
