"""A CSV too large for memory -> a Parquet file in the output folder, block by block, and its plan."""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import DataError, UsageError
from ..engine import SERIAL, Run
from ..engine.base import no_report
from ..plan import Plan, Reading
from ..records import read_json

if TYPE_CHECKING:
    from .csv_head import Head

FACTS = "copy.json"
HEAD = 1_000_000  # bytes from which the dialect is found
BLOCK = 2 << 20  # bytes of text converted at once; pyarrow reads up to 32 of them ahead
GROUP = 100_000  # rows of a row group, at least


@dataclass(frozen=True, slots=True)
class Converted:
    """A Parquet file made from a CSV: its path, how it is read, and assumptions, also on irregular rows."""

    path: Path
    reading: Reading
    assumed: tuple[str, ...]
    notes: tuple[str, ...]


def csv_stream(
    source: Path,
    reading: Reading,
    *,
    most_rows: int,
    most_pairs: int,
    work: Path,
    report: Callable[[str], None] = no_report,
    reads: float = 4.0,
    head: int = HEAD,
    block_size: int = BLOCK,
    workers: Run = SERIAL,
) -> Plan:
    """Plan a CSV of any size through a Parquet copy of it.

    Parameters
    ----------
    source : Path
    reading, most_rows, most_pairs, report, reads, workers : see `open_source`
    work : Path
        The copy goes to ``parquet`` in this folder, whole or not at all, and is used again for the same source.
    head, block_size : int
        Bytes from which the dialect is found, and that are converted at once.

    Raises
    ------
    UsageError
        pyarrow is not installed, or the options do not fit the file.
    DataError
        The file cannot be read as a table, or holds rows wider than its header.
    """
    from .parquet_blocks import parquet_plan

    made = converted(source, reading, work, report, head, block_size)
    plan = parquet_plan(
        made.path, made.reading, most_rows=most_rows, most_pairs=most_pairs, work=work, report=report, name=source.name,
        reads=reads, notes=made.notes, workers=workers,
    )  # fmt: skip
    return replace(plan, assumed=(*made.assumed, *plan.assumed))


def converted(
    source: Path, reading: Reading, work: Path, report: Callable[[str], None] = no_report,
    head: int = HEAD, block_size: int = BLOCK,
) -> Converted:  # fmt: skip
    """The Parquet copy of a CSV, made now or found.

    Raises
    ------
    UsageError, DataError
        As `csv_stream`.
    """
    _pyarrow(source)
    status = source.stat()
    facts = [str(source), status.st_size, status.st_mtime_ns, asdict(reading)]
    key = sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]
    folder = work / "parquet" / f"{source.stem}-{key}"
    if (kept := _facts(folder)) is None:
        part = folder.with_name(f"{folder.name}.part")
        _cleared(source.stem, folder.parent)
        part.mkdir(parents=True)
        try:
            _convert(source, reading, part, report, head, block_size)
            if source.stat().st_mtime_ns != status.st_mtime_ns:
                raise DataError(f"{source.name} changed while it was read: start again when it is complete.")
            part.rename(folder)
        except OSError as error:
            raise DataError(
                f"{source.name} cannot be copied to {folder.parent} as Parquet: {error.strerror or error}; "
                "that takes about half of its size. Free some space, or choose another folder."
            ) from error
        finally:
            shutil.rmtree(part, ignore_errors=True)
        kept = _facts(folder) or {}
    reading = replace(reading, tool=kept["tool"], work=kept["work"], decimal=None, delimiter=None, sheet=None)
    return Converted(folder / f"{source.stem}.parquet", reading, tuple(kept["assumed"]), tuple(kept["notes"]))


def _facts(folder: Path) -> dict[str, Any] | None:
    """Facts of a copy; None where there is none, or they are damaged."""
    found = read_json(folder / FACTS)
    names = all(isinstance(found.get(name, 0), str | None) for name in ("tool", "work"))
    return found if names and all(isinstance(found.get(name), list) for name in ("assumed", "notes")) else None


def _pyarrow(source: Path) -> None:
    try:
        import pyarrow.csv  # type: ignore[import-untyped]  # noqa: F401
    except ImportError as error:
        raise UsageError(
            f"{source.name} is too large to be read whole, and pyarrow, which reads it in parts, is not installed: "
            "pip install 'fitmodels[batch]'."
        ) from error


def _cleared(stem: str, folder: Path) -> None:
    """Remove copies of earlier states of the source."""
    for old in folder.glob("*") if folder.is_dir() else ():
        if old.name.rpartition("-")[0] == stem:
            shutil.rmtree(old, ignore_errors=True)


def _convert(
    source: Path, reading: Reading, part: Path, report: Callable[[str], None], size: int, block_size: int
) -> None:
    """Write the Parquet file and, last, its facts."""
    from .csv_head import read_head

    head = read_head(source, reading, part, size)
    # no letter of an ASCII head distinguishes UTF-8 from Windows-1252
    for encoding in (head.encoding, "cp1252") if head.ascii else (head.encoding,):
        try:
            assumed = _written(source, replace(head, encoding=encoding), part, report, block_size)
            break
        except UnicodeError:
            continue
    else:
        raise DataError(f"{source.name} holds bytes that are not {encoding}: save it as CSV UTF-8.")
    names = {"tool": head.reading.tool, "work": head.reading.work}
    facts = names | {"assumed": [*head.assumed, *assumed], "notes": head.notes}
    (part / FACTS).write_text(json.dumps(facts, ensure_ascii=False), "utf-8")


def _written(
    source: Path, head: "Head", part: Path, report: Callable[[str], None], block_size: int
) -> tuple[str, ...]:  # fmt: skip
    """Write the rows; sentences on irregular rows and cells.

    Raises
    ------
    UnicodeError
        The text is not in the encoding of the head.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq  # type: ignore[import-untyped]

    from .csv_rows import Cells, IrregularRows, batches

    cells, met = Cells(head.decimal), IrregularRows(head, source.name)
    types = {"number": pa.float64(), "unused": pa.null()}
    schema = pa.schema([(column.name, types.get(column.kind, pa.string())) for column in head.columns])
    with pq.ParquetWriter(part / f"{source.stem}.parquet", schema) as writer:
        held: list[Any] = []
        for batch in batches(source, head, met, report, block_size, cells):
            held.append(pa.RecordBatch.from_arrays(batch, schema=schema))
            if sum(map(len, held)) >= GROUP:
                writer.write_table(pa.Table.from_batches(held))
                held.clear()
        if held:
            writer.write_table(pa.Table.from_batches(held))
    odd = (odd.sentence(name) for name, odd in cells.odd.items())
    return (*met.sentences(), *odd)
