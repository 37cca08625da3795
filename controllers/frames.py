"""A replay as a data frame."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pandas import DataFrame

    from .loop import Trace


def trace_frame(trace: "Trace") -> "DataFrame":
    """A row a sample, time in s; several commands as ``command 1``, ``command 2``."""
    from pandas import DataFrame, Index

    commands = trace.command.reshape(len(trace.time), -1)
    several = commands.shape[1] > 1
    held = {f"command {k + 1}" if several else "command": column for k, column in enumerate(commands.T)}
    held |= {"measurement": trace.measurement, "reference": trace.reference}
    held |= {name: np.asarray(values) for name, values in trace.recorded.items()}
    return DataFrame(held, index=Index(trace.time, name="time"))
