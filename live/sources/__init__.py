"""Sources of readings: each gives samples and notices, whatever the machine.

opening      words of the command -> a source
options      what a source is asked for: `SourceOptions`
channels     columns, keys or nodes -> the quantities of a `Sample`
clock        time stamps, gaps and jumps of clocks
rows         lines of CSV or JSON -> samples
files        a growing file, and a recorded run at any speed
streams      lines from standard input or a socket
opcua        a client of an OPC UA server; opcua_nodes: its nodes; merging: values of single nodes -> samples
"""

from .opening import Source, open_source
from .options import SourceOptions

__all__ = ["Source", "SourceOptions", "open_source"]
