"""The rows of a long CSV, block by block: text by pyarrow, then numbers and labels; odd rows are taken care of."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import DataError
from ...datasets.tables.dialect import is_comment, split_line
from ...datasets.tables.layout import footer_label
from ...datasets.tables.numerals import MISSING_AS_WRITTEN, is_number

if TYPE_CHECKING:
    from .csv_cells import Cells
    from .csv_head import Head

MOST_ODD = 100_000  # rows of another width that are held


@dataclass(slots=True)
class Met:
    """Rows of another width, comments and blank rows met on the way."""

    head: "Head"
    name: str
    short: list[list[str]] = field(default_factory=list)
    remarks: int = 0
    wide: str = ""
    footers: list[str] = field(default_factory=list)

    def odd(self, row: Any) -> str:  # noqa: ANN401  pyarrow.csv.InvalidRow
        """Take a row whose cells are more or fewer than those of the others."""
        text = row.text
        if is_comment(text, self.head.delimiter):
            self.remarks += 1
            return "skip"
        cells = split_line(text, self.head.delimiter)
        width = len(self.head.columns)
        if any(cell.strip() for cell in cells[width:]):
            self.wide = self.wide or text[:80]
            return "error"
        if label := footer_label(cells):
            self.footers.append(label)
        elif not any(map(is_number, cells)):
            self.remarks += any(cell.strip() for cell in cells)
        else:
            self.short.append([*cells, *[""] * (width - len(cells))][:width])
        return "skip" if len(self.short) <= MOST_ODD else "error"

    def refusal(self) -> DataError | None:
        """What stopped the reading, if a row did."""
        width = len(self.head.columns)
        if self.wide:
            return DataError(
                f"{self.name}: a row has more cells than the {width} of the header: {self.wide!r}. Give the extra "
                "column a name, or remove the extra cell."
            )
        if len(self.short) > MOST_ODD:
            return DataError(
                f"{self.name}: more than {MOST_ODD} rows have fewer or more cells than the others, the first "
                f"{self.head.delimiter.join(self.short[0])!r}: export the file with as many cells in every row."
            )
        return None

    def sentences(self) -> Iterator[str]:
        """Tell what was met."""
        if self.short:
            yield f"{len(self.short)} row(s) have fewer cells than the header; the cells they lack count as missing."
        if self.remarks:
            yield f"{self.remarks} line(s) of remarks among the data are left out."
        if self.footers:
            yield f"Footer rows are left out: {', '.join(map(repr, self.footers))}."


def batches(
    source: Path, head: "Head", met: Met, told: Callable[[str], None], block_size: int, cells: "Cells"
) -> Iterator[list[Any]]:
    """The columns of each block of rows, and at last of the rows that were short."""
    import pyarrow as pa  # type: ignore[import-untyped]

    done, waiting = 0, None
    for texts in _texts(source, head, met, told, block_size):
        if waiting is not None:
            yield _columns(waiting, head, cells, done)
            done += waiting.num_rows
        waiting = _without_blanks(texts)
    if waiting is not None:
        waiting = _without_footers(waiting, met)
        yield _columns(waiting, head, cells, done)
        done += waiting.num_rows
    if met.short:
        names = [column.name for column in head.columns]
        columns = [pa.array([cell if cell not in MISSING_AS_WRITTEN else None for cell in column], pa.string())
                   for column in zip(*met.short, strict=True)]  # fmt: skip
        yield _columns(pa.RecordBatch.from_arrays(columns, names=names), head, cells, done)


def _texts(source: Path, head: "Head", met: Met, told: Callable[[str], None], block_size: int) -> Iterator[Any]:
    """Batches of rows as text, null where a cell is missing."""
    import pyarrow as pa
    from pyarrow import csv

    names = [column.name for column in head.columns]
    padded = [*names, *(f"\0{k}" for k in range(len(names), head.cells))][: max(head.cells, 1)]
    size, percent = source.stat().st_size, -1
    with source.open("rb") as file:
        try:
            reader = csv.open_csv(
                file,
                read_options=csv.ReadOptions(
                    column_names=padded, skip_rows=head.skip, block_size=block_size, encoding=_codec(head.encoding)
                ),
                parse_options=csv.ParseOptions(delimiter=head.delimiter, invalid_row_handler=met.odd),
                convert_options=csv.ConvertOptions(
                    column_types=dict.fromkeys((*names, *padded), pa.string()), include_columns=names,
                    include_missing_columns=True, null_values=sorted(MISSING_AS_WRITTEN), strings_can_be_null=True,
                ),
            )  # fmt: skip
            with reader:
                for k, batch in enumerate(reader, start=1):
                    if (now := min(100 * k * block_size // size, 100)) > percent:
                        percent = now
                        told(f"converting {source.name}: {percent} %")
                    yield batch
        except pa.ArrowInvalid as error:
            raise _refused(source, met, error) from error


def _refused(source: Path, met: Met, error: Exception) -> Exception:
    if refusal := met.refusal():
        return refusal
    if "UTF8" in str(error):
        return UnicodeError(str(error))
    why = str(error).splitlines()[0][:200]
    return DataError(f"{source.name} cannot be read as a table: {why}. Export it again, one row a line.")


def _codec(encoding: str) -> str:
    return "utf8" if encoding in ("utf-8", "utf-8-sig") else encoding


def _columns(batch: Any, head: "Head", cells: "Cells", done: int) -> list[Any]:  # noqa: ANN401
    import pyarrow as pa

    made = []
    for column, texts in zip(head.columns, batch.columns, strict=True):
        if column.kind == "number":
            made.append(cells.numbers(column.name, texts, done + 1))
        elif column.kind == "unused":
            made.append(pa.nulls(len(texts)))
        else:
            made.append(cells.labels(texts, as_numbers=column.kind == "numbered"))
    return made


def _without_blanks(batch: Any) -> Any:  # noqa: ANN401
    """Rows that hold anything: programs pad tables with rows of delimiters."""
    import pyarrow.compute as pc  # type: ignore[import-untyped]

    blank = None
    for column in batch.columns:
        empty = pc.is_null(column)
        blank = empty if blank is None else pc.and_(blank, empty)
        if not pc.any(blank).as_py():
            return batch
    return batch.filter(pc.invert(blank))


def _without_footers(batch: Any, met: Met) -> Any:  # noqa: ANN401
    """The last rows that are sums or means left out."""
    while batch.num_rows:
        last = [value or "" for value in batch.slice(batch.num_rows - 1).to_pylist()[0].values()]
        if not (label := footer_label(last)):
            break
        met.footers.append(label)
        batch = batch.slice(0, batch.num_rows - 1)
    return batch
