"""Words of the command as a source of samples and notices."""

import re
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Final, Self

from ...core.errors import UsageError
from ..samples import Notice, Sample
from .files import check_file, growing, replayed
from .opcua import OpcUa
from .options import SourceOptions
from .streams import from_socket, standard_input

LIMITED: Final = ("connected", "gap", "bad", "refused")  # notices that change no cut
WAIT: Final = 3.0  # s for the first word of a machine
MOST_SAID: Final = 20  # of them a minute: quality may change at every reading


class Source:
    """Samples and notices of a machine or a recorded run, one after another.

    It waits for the next one, and gives a notice ``"idle"`` at least every 0.5 s. What happens to the connection
    is a notice; only what is wrong from the beginning is an error: a file that is not there, a header without a load.

    Attributes
    ----------
    name : str
        For people.
    recorded : bool
        Whether it ends, and its times are those of a recorded run.
    """

    def __init__(self, name: str, items: Iterator[Sample | Notice], *, recorded: bool = False) -> None:
        self.name, self.recorded = name, recorded
        self._items = items
        self._said: deque[float] = deque(maxlen=MOST_SAID)  # when notices were given, s
        self._silent = False
        self._first: deque[Sample | Notice] = deque()

    def begin(self, seconds: float) -> Self:
        """Wait for the first item, up to some seconds for one that is not idle: errors of the beginning come here."""
        end = monotonic() + seconds
        try:
            while not self._first or (monotonic() < end and getattr(self._first[-1], "kind", "") == "idle"):
                self._first.append(next(self._items))
        except StopIteration:
            pass
        except BaseException:
            self.close()
            raise
        return self

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Sample | Notice:
        while True:
            item = self._first.popleft() if self._first else next(self._items)
            if isinstance(item, Sample) or item.kind not in LIMITED or (said := self._limited(item)) is None:
                return item
            if said:
                return Notice(item.time, item.kind, f"{item.text}; more such notices are left out for a minute")

    def _limited(self, notice: Notice) -> bool | None:
        """None for a notice that is given; otherwise whether it is the first of those that are left out."""
        now = monotonic()
        if len(self._said) < MOST_SAID or now - self._said[0] > 60.0:
            self._said.append(now)
            self._silent = False
            return None
        first, self._silent = not self._silent, True
        return first

    def close(self) -> None:
        """End the connection."""
        close = getattr(self._items, "close", None)
        if close is not None:
            close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_source(words: str, options: SourceOptions) -> Source:
    r"""Source that words name.

    Parameters
    ----------
    words : str
        A file of CSV or JSON lines, which grows or, with ``options.replay``, is a recorded run; or the address
        ``opc.tcp://host:port/path`` of an OPC UA server; or ``linuxcnc``, the LinuxCNC of this machine; or lines of
        CSV or JSON from ``-``, standard input, or a socket, ``tcp://127.0.0.1:port`` or ``unix:/path``.
    options : SourceOptions

    Raises
    ------
    UsageError
        The words name no source.
    DataError
        The source cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "run.csv")
    >>> _ = path.write_text("time [s],P [kW]\n0.00,1.80\n0.02,1.81\n")
    >>> with open_source(str(path), SourceOptions(loads={"P": "kW"}, replay=100)) as source:
    ...     [item.loads["P"] for item in source if hasattr(item, "loads")]
    [1.8, 1.81]
    """
    if words in ("-", "linuxcnc") or words.startswith(("opc.tcp://", "tcp://", "unix:")):
        if options.replay is not None:
            raise UsageError("--replay goes with a recorded run, not with a machine.")
        return _live(words, replace(options, after=None)).begin(WAIT)  # a machine gives nothing twice
    if match := re.match(r"([a-z][a-z.]+)://", words):
        raise UsageError(
            f"--from {words}: no source {match[1]}://; give a file, -, linuxcnc, opc.tcp://host:port, "
            "tcp://127.0.0.1:port or unix:/path."
        )
    path = Path(words)
    check_file(path)
    if options.replay is not None:
        return Source(f"recorded run {path.name}", replayed(path, options), recorded=True).begin(0.0)
    if options.rate is not None:
        raise UsageError("--rate goes with a recorded run: the rows of a growing file need times. Add --replay 1x.")
    return Source(path.name, growing(path, options)).begin(0.0)


def _live(words: str, options: SourceOptions) -> Source:
    """Source that is a machine or a stream."""
    if words.startswith("opc.tcp://"):
        return Source(words, OpcUa(words, options).items())
    if words == "linuxcnc":
        from .linuxcnc import LinuxCnc

        return Source("LinuxCNC", LinuxCnc(options))
    if words == "-":
        return Source("standard input", standard_input(options))
    return Source(words, from_socket(words, options))
