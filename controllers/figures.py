"""Figure of a replay."""

from matplotlib.axes import Axes

from ..core.display import plot
from ..core.figure_style import BLUE, GREY, ORANGE, THIN, new_axes
from .loop import Trace


@plot.register
def plot_trace(trace: Trace, ax: Axes | None = None) -> Axes:
    """Measurement with its reference and events; the command on an axis of its own."""
    ax = new_axes(ax, 8.0, 4.0)
    ax.plot(trace.time, trace.measurement, color=BLUE, lw=THIN, label=trace.labels[1])
    ax.plot(trace.time, trace.reference, color=GREY, lw=THIN, ls="--", label="reference")
    for event in trace.events[:100]:
        ax.axvline(event.time, color="0.8", lw=THIN, zorder=0)
    ax.set(xlabel="time [s]", ylabel=trace.labels[1], title="Simulated")
    other = ax.twinx()
    other.plot(trace.time, trace.command, color=ORANGE, lw=THIN)
    other.set_ylabel(trace.labels[0])
    return ax
