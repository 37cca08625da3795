"""The journal of a watch: JSON lines that survive the end of the process at any moment and replay to the same state.

A folder holds ``watch-000001.jsonl``, ``watch-000002.jsonl`` and so on. The first line of each file is a snapshot of
the state, the others are what was applied to it since, in order and numbered; so the newest file alone gives the
state. Each line is written by one ``os.write`` to a file opened for appending and is with the system at once: the end
of the process loses none. It is on the disk within a second: a loss of power costs that second.
"""

import errno
import json
import os
import re
import secrets
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..core.arrays import is_positive
from ..core.bounded import AS_BYTES, LIMITS, open_regular, parse_json, read_bounded
from ..core.errors import DataError, FitmodelsError
from ..core.files import cause, make_folder, synchronised_folder, write_whole
from ..core.rounding import count
from ..core.text import json_text

if TYPE_CHECKING:
    from .monitor import Monitor

Record = dict[str, Any]

SCHEMA: Final = "fitmodels.watch/1"
NAME: Final = re.compile(r"watch-(\d{6})\.jsonl")
REQUEST: Final = re.compile(r"request-[0-9a-f]{16}\.json")
ROTATE_AT: Final = 4_000_000  # bytes of a file
KEPT: Final = 8  # files; older ones are removed
SYNCHRONISED: Final = 1.0  # s
RETRY: Final = 5.0  # s between attempts to write to a disk that refuses
WAITING: Final = 10_000  # records held while the disk refuses
OF_EDGE: Final = ("window", "cutend", "contact", "gap", "gauge", "used")  # records that depend on the laws
MISSING: Final = "{} of the journal cannot be read: contact may be missing. Gauge the edge."
_synchronise = getattr(os, "fdatasync", os.fsync)


class WatchJournal:
    """The open journal of one watch, its only writer.

    Parameters
    ----------
    folder : Path
        Exists; the caller holds its lock (see `fitmodels.core.files.locked_folder`).
    rotate_at : int
        Bytes of a file, after which the next one begins with a snapshot.
    kept : int
        Newest files that are kept.

    Attributes
    ----------
    fault : str
        Why the last attempt to write failed; empty where the disk takes records.
    lost : int
        Records that were not written since the disk last refused them.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> journal = WatchJournal(folder)
    >>> journal.rotate({"minutes": 0.0})
    >>> journal.append({"kind": "cut", "minutes": 1.5})
    >>> journal.close()
    >>> [record["kind"] for record in read_newest(folder).records]
    ['snapshot', 'cut']
    """

    def __init__(self, folder: Path, *, rotate_at: int = ROTATE_AT, kept: int = KEPT) -> None:
        self.folder, self.rotate_at, self.kept = folder, rotate_at, kept
        self.fault, self.lost = "", 0
        found = journal_files(folder)
        self.path = found[-1] if found else folder / "watch-000000.jsonl"
        self.records = 0
        self._number = 0
        self._waiting: deque[bytes] = deque()
        self._file: int | None = None
        self._size, self._synchronised, self._refused = 0, time.monotonic(), -RETRY
        self._dirty = False

    def resume(self, newest: "Newest") -> None:
        """Go on in the newest file after the records that it holds; a torn last line is ended."""
        self._number = newest.records[-1]["n"] if newest.records else 0
        self.records = len(newest.records)
        with suppress(OSError):
            self._open(newest.path)
        if newest.torn:
            self._waiting.append(b"\n")
            self.write_waiting()

    def append(self, record: Mapping[str, Any]) -> None:
        """Write one record with its number; where the disk refuses, it waits in memory and `fault` says why."""
        self._number += 1
        line = json_text({"n": self._number, **record}, separators=(",", ":")) + "\n"
        if len(self._waiting) >= WAITING:
            del self._waiting[self._waiting[0] == b"\n"]  # the oldest record; the end of a torn line stays
            self.lost += 1
        self._waiting.append(line.encode())
        self.write_waiting()

    def write_waiting(self) -> None:
        """Write what waits, as far as the disk takes it, and synchronise what was written a second ago."""
        now = time.monotonic()
        if self._waiting and now - self._refused >= RETRY:
            try:
                while self._waiting:
                    self._put(self._waiting[0])
                    self.records += self._waiting.popleft() != b"\n"
                self.fault = ""
            except OSError as failure:
                self.fault, self._refused = cause(failure), now
        if self._dirty and now - self._synchronised >= SYNCHRONISED:
            self.synchronise()

    def synchronise(self) -> None:
        """Wait until all that was written is on the disk."""
        self._synchronised = time.monotonic()
        if self._file is None:
            return
        try:
            _synchronise(self._file)
            self._dirty = False
        except OSError as failure:
            self.fault = cause(failure)

    @property
    def full(self) -> bool:
        """Whether the file has reached its size, so that the next one is to begin with a snapshot."""
        return self._size >= self.rotate_at and not self.fault

    def rotate(self, state: Mapping[str, Any]) -> None:
        """Begin a new file with a snapshot of the state, and remove the oldest files.

        What the former file still refuses is dropped: the snapshot holds its effect. Where the disk refuses the
        snapshot, the former file is continued and `fault` says why.
        """
        self._refused = -RETRY
        self.write_waiting()
        snapshot = {"n": self._number + 1, "kind": "snapshot", "schema": SCHEMA, "state": dict(state)}
        name = f"watch-{_number_of(self.path) + 1:06d}.jsonl"
        try:
            self.synchronise()
            write_whole(self.folder / name, json_text(snapshot, separators=(",", ":")) + "\n")
            self._open(self.folder / name)
        except (OSError, FitmodelsError) as failure:
            self.fault = cause(failure) if isinstance(failure, OSError) else str(failure)
            self._refused = time.monotonic()
            with suppress(OSError):
                (self.folder / name).unlink()  # it would hide what follows in the former file
            return
        self.lost += len(self._waiting)
        self._waiting.clear()
        self._number, self.records, self.fault = self._number + 1, 1, ""
        for old in journal_files(self.folder)[: -self.kept]:
            with suppress(OSError):
                old.unlink()

    def close(self) -> None:
        """Write what waits, wait until it is on the disk, and close the file."""
        self._refused = -RETRY
        self.write_waiting()
        if self._file is not None:
            self.synchronise()
            os.close(self._file)
            self._file = None

    def _open(self, path: Path) -> int:
        file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | AS_BYTES, 0o644)
        if self._file is not None:
            os.close(self._file)
        self._file, self.path, self._size = file, path, os.fstat(file).st_size
        return file

    def _put(self, line: bytes) -> None:
        """Write a line whole, or leave the file as it was."""
        file = self._open(self.path) if self._file is None else self._file
        written = os.write(file, line)
        if written < len(line):  # the disk is full: half a line would damage the next one
            with suppress(OSError):
                os.ftruncate(file, self._size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._size += written
        self._dirty = True


@dataclass(frozen=True, slots=True)
class Newest:
    """The newest part of a journal.

    Attributes
    ----------
    path : Path
        Of the newest file.
    records : list of dict
        The snapshot and what followed it.
    torn : bool
        Whether its last line is not ended: the process or the machine ended while it was written.
    missing : int
        Records whose numbers are missing or do not rise.
    """

    path: Path
    records: list[Record]
    torn: bool
    missing: int


def read_newest(folder: Path) -> Newest | None:
    """The records of a journal from its last snapshot on; None where the folder holds no journal.

    Where the first line of the newest file is damaged, they begin with the snapshot of the file before.

    Raises
    ------
    DataError
        There are files of a journal, but none begins with a snapshot that this version can read. It names the contact
        of the edge that they show.
    """
    found = journal_files(folder)
    later: list[Record] = []
    empty, torn = 0, False
    for path in reversed(found):
        one = _read(path)
        torn = one.torn if path == found[-1] else torn
        records = [*one.records, *later]
        if not one.records or one.records[0].get("kind") != "snapshot":
            later, empty = records, empty + (not one.records)
            continue
        if (schema := one.records[0].get("schema")) != SCHEMA:
            raise DataError(f"{path}: has schema {schema!r}, and this version reads {SCHEMA!r}. {_anew(records)}")
        kept = _in_order(records)
        return Newest(found[-1], kept, torn, _gaps(kept) + len(records) - len(kept) + empty)
    if found:
        raise DataError(f"{found[-1]}: begins with no snapshot of a watch: it is damaged. {_anew(later)}")
    return None


def _anew(records: Sequence[Record]) -> str:
    """What to do without a state: the contact of the edge in use, as far as records show it, and the options."""
    minutes = still_open = 0.0
    for record in records:
        kind = record.get("kind")
        if kind == "edge":
            minutes = still_open = 0.0
        elif kind == "contact":
            still_open = _minutes(record)
        elif kind in OF_EDGE:
            minutes, still_open = minutes + _minutes(record), 0.0
        elif kind == "snapshot":
            with suppress(KeyError, TypeError, AttributeError):  # of another version
                minutes, still_open = _minutes(record["state"]["edge"]["summary"]), 0.0
    minutes += still_open
    if not minutes > 0:
        return (
            "The contact of the edge in use is not known: give another folder with --journal, and put in a new edge or "
            "state what this one has cut with --used and gauge it with --gauge."
        )
    return (
        f"What can be read of it shows {minutes:.3g} min of contact of the edge in use or more: give another folder "
        f"with --journal and --used {minutes:.3g}min, and gauge the edge with --gauge."
    )


def _minutes(record: Record) -> float:
    """Minutes of contact of a record; 0 where it states none."""
    value = record.get("contact", record.get("minutes", 0.0))
    return float(value) if isinstance(value, int | float) and is_positive(value) else 0.0


def restore(newest: "Newest", monitor: "Monitor") -> None:
    """Bring a monitor to the state of a journal, as `replay`, and say where records of it are missing."""
    replay(newest.records, monitor)
    if newest.missing:
        monitor.edge.summary.missed()
        text = MISSING.format(count(newest.missing, "record"))
        monitor.apply({"kind": "alarm", "time": monitor.time, "kind_of_alarm": "journal", "text": text})


def read_journal(folder: Path) -> Iterator[Record]:
    """All records of a journal in order, of all its files.

    Examples
    --------
    >>> list(read_journal(Path("nowhere")))
    []
    """
    for path in journal_files(folder):
        yield from _read(path).records


def replay(records: Sequence[Mapping[str, Any]], monitor: "Monitor") -> None:
    """Bring a monitor to the state that the records of a journal give, the first a snapshot.

    Raises
    ------
    UsageError
        They are of another tool, work material or parameter file.
    DataError
        A record does not hold what its kind has: it was changed by hand or damaged.
    """
    first, *others = records
    record = first
    try:
        monitor.restore(first["state"], cut=any(each.get("kind") in OF_EDGE for each in others))
        for record in others:
            monitor.apply(record)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as fault:
        raise DataError(
            f"record {record['n']} of the journal ({record.get('kind')}) is damaged or was changed by hand "
            f"({fault!r}): restore the file, or give another folder with --journal."
        ) from None
    monitor.take_messages()
    monitor.refused.clear()


def journal_files(folder: Path) -> list[Path]:
    """Files of a journal, the newest last."""
    with suppress(OSError):
        return sorted(path for path in folder.iterdir() if NAME.fullmatch(path.name))
    return []


def _number_of(path: Path) -> int:
    found = NAME.fullmatch(path.name)
    return int(found[1]) if found else 0


def _read(path: Path) -> Newest:
    """The records of a file as far as they are whole; another process may be writing it."""
    with open_regular(path, "state") as file:
        lines = file.read(LIMITS["state"].size).split(b"\n")
    records = [record for line in lines if line and (record := _parsed(line)) is not None]
    return Newest(path, records, torn=bool(lines[-1]), missing=_gaps(records))


def _in_order(records: Sequence[Record]) -> list[Record]:
    """Records whose numbers rise; one with a lower number is counted in what stands before it."""
    highest = accumulate((record["n"] for record in records), max, initial=0)
    return [record for record, before in zip(records, highest, strict=False) if record["n"] > before]


def _gaps(records: Sequence[Record]) -> int:
    """Numbers that are missing between records."""
    return sum(max(later["n"] - earlier["n"] - 1, 0) for earlier, later in pairwise(records))


def _parsed(line: bytes) -> Record | None:
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) and isinstance(record.get("n"), int) else None


def leave_request(folder: Path, request: Mapping[str, Any]) -> Path:
    """Leave a request, such as a gauge reading, for the process that watches with the journal of this folder.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> path = leave_request(folder, {"kind": "gauge", "wear": 0.21, "sd_ln": 0.02})
    >>> [(each, facts["wear"]) == (path, 0.21) for each, facts in requests(folder)]
    [True]
    """
    make_folder(folder, "--journal")
    key = secrets.token_hex(8)
    path = folder / f"request-{key}.json"
    write_whole(path, json_text({**request, "request": key}))
    return path


def requests(folder: Path) -> Iterator[tuple[Path, Record]]:
    """Requests left in a folder, with their files; the reader removes each file after it is in the journal."""
    found: list[Path] = []
    with suppress(OSError):
        found = sorted(path for path in folder.iterdir() if REQUEST.fullmatch(path.name))
    for path in found:
        try:
            facts = parse_json(read_bounded(path, "state"), str(path))
        except (OSError, FitmodelsError):
            facts = {"kind": "unreadable"}
        yield path, facts if isinstance(facts, dict) else {"kind": "unreadable"}


def remove_request(path: Path) -> None:
    """Remove a request that was taken in."""
    with suppress(OSError):
        path.unlink()
        synchronised_folder(path.parent)
