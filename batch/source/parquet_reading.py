"""Rows of a block of a Parquet source: of its pairs alone, in the units of the field, at once or in chunks."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from ...core.arrays import Array, Ints
from ...core.errors import DataError
from ...datasets.columns import ColumnUse
from ...datasets.derived.rules import apply, known_of
from ...datasets.design import decode_levels
from ...datasets.runs import Source
from ...datasets.units import convert
from ...datasets.vocabulary import ROLES
from ..plan import Block, Piece, Plan
from ..rows import NO_LINES, PairRows
from .parquet_arrow import UNREADABLE, Labels, joined, numbered, why
from .parquet_blocks import SORTED
from .parquet_index import BATCH, is_measured, of_rows, parts
from .parquet_schema import footer, group_column, needed_columns, stamp_of
from .sorted_copies import COPIED

CHUNK = 500_000  # rows


def parquet_rows(block: Block, plan: Plan) -> tuple[list[PairRows], dict[str, str]]:
    """Rows of the pairs of a block.

    Parameters
    ----------
    block : Block
        Not streamed.
    plan : Plan
        By `parquet_plan`.

    Returns
    -------
    list of Rows
        One, or none where nothing could be read.
    dict of str to str
        Pieces that could not be read, with the reason in a sentence.

    Examples
    --------
    >>> import pandas as pd, tempfile
    >>> from fitmodels.batch.plan import Reading
    >>> from fitmodels.batch.source.parquet_blocks import parquet_plan
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "tests.parquet")
    ...     pd.DataFrame({"tool": "A", "work": "steel", "vc [m/s]": [1.0, 2.0], "AW": [0.1, 0.2]}).to_parquet(path)
    ...     plan = parquet_plan(path, Reading(), most_rows=100, most_pairs=10, work=Path(folder), report=print)
    ...     rows, unreadable = parquet_rows(plan.blocks[0], plan)
    >>> rows[0].frame["V"].tolist(), unreadable
    ([60.0, 120.0], {})
    """
    read: list[_Read] = []
    unreadable = {}
    place = _places(block)
    for run in _runs(block.pieces):
        try:
            read += list(_rows_of(run, place, plan))
        except DataError:  # which of them?
            for piece in run:
                try:
                    read += list(_rows_of((piece,), place, plan))
                except DataError as error:
                    unreadable[piece.name] = str(error)
    if not read:
        return [], unreadable
    frame, units = _frame(read, block, plan)
    derived = tuple(one for one in plan.derived if one.role in units)
    assumed = tuple(sentence for sentence in plan.assumed if sentence != SORTED)
    source = Source(plan.name, "", len(frame), NO_LINES)
    rows = PairRows(
        frame, None, units, plan.columns, source, assumed, notes=plan.notes, derived=derived,
        process=plan.reading.process, constants=plan.reading.constants,
    )  # fmt: skip
    return [rows], unreadable


def parquet_chunks(block: Block, plan: Plan) -> Iterator[pd.DataFrame]:
    """Rows of a block in chunks of about half a million, with the columns of `parquet_rows`.

    Raises
    ------
    DataError
        A piece cannot be read.
    """
    waiting: list[_Read] = []
    for part in _all_rows(block, plan):
        waiting.append(part)
        if sum(len(some.pair) for some in waiting) >= CHUNK:
            yield _frame(waiting, block, plan)[0]
            waiting = []
    if waiting:
        yield _frame(waiting, block, plan)[0]


@dataclass(frozen=True, slots=True)
class _Read:
    """Rows of the block's pairs in a part of a piece: place of the pair of each row in the block, and columns."""

    pair: Ints
    columns: Mapping[str, Array | Labels]


def _all_rows(block: Block, plan: Plan) -> Iterator[_Read]:
    """Rows of all pieces; DataError, in a sentence that names it, for the first that cannot be read."""
    place = _places(block)
    for run in _runs(block.pieces):
        try:
            yield from _rows_of(run, place, plan)
        except DataError:
            for piece in run:
                for _ in _rows_of((piece,), place, plan):
                    pass
            raise


def _places(block: Block) -> dict[tuple[str, str], int]:
    return {(pair.tool, pair.work): i for i, pair in enumerate(block.pairs)}


def _runs(pieces: tuple[Piece, ...]) -> Iterator[tuple[Piece, ...]]:
    """Pieces that are read together: small row groups of a file that is opened once."""
    run: list[Piece] = []
    rows = 0
    for piece in pieces:
        n = _rows_in(piece)
        if run and (piece.path != run[0].path or piece.row_group is None or rows + n > BATCH):
            yield tuple(run)
            run, rows = [], 0
        run.append(piece)
        rows += n
    if run:
        yield tuple(run)


def _rows_in(piece: Piece) -> int:
    """Rows of a row group; many where the file cannot be opened, so that it stays by itself."""
    try:
        facts = footer(piece.path, piece.stamp)
        return BATCH + 1 if piece.row_group is None else int(facts.row_group(piece.row_group).num_rows)
    except UNREADABLE:
        return BATCH + 1


def _rows_of(run: tuple[Piece, ...], place: Mapping[tuple[str, str], int], plan: Plan) -> Iterator[_Read]:
    """Rows of pieces of one file; DataError, in a sentence that names the first, where they cannot be read."""
    _unchanged(run[0])
    together = [int(piece.row_group) for piece in run if piece.row_group is not None]
    try:
        for part in parts(run[0], needed_columns(plan.columns, plan.reading), plan.reading, together or None):
            pair = numbered(part.tool, part.work, lambda key: place.get(key, -1))
            rows = np.flatnonzero(pair >= 0)
            if len(rows):
                at = slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] + 1 == len(rows) else rows
                columns = {header: of_rows(values, at) for header, values in part.columns.items()}
                yield _Read(pair[at], columns)
    except UNREADABLE as error:
        raise DataError(f"{run[0].name}: cannot be read: {why(error)}.") from error


def _unchanged(piece: Piece) -> None:
    try:
        stamp = stamp_of(Path(piece.path))
    except OSError as error:
        raise DataError(f"{piece.name}: cannot be read: it no longer exists.") from error
    if not piece.stamp.startswith(COPIED) and stamp != piece.stamp:
        raise DataError(
            f"{piece.name}: cannot be read: it was written again after the batch was planned; "
            "run the command again when it is complete."
        )


def _frame(read: list[_Read], block: Block, plan: Plan) -> tuple[pd.DataFrame, dict[str, str]]:
    """Columns under their symbols, in the units of the field, and these units."""
    pair = np.concatenate([part.pair for part in read])
    data: dict[str, Array] = {}
    texts: dict[str, pd.Categorical[str]] = _pair_names(pair, block)
    for use in needed_columns(plan.columns, plan.reading):
        values = [part.columns[use.header] for part in read]
        if is_measured(use):
            data[str(use.role)] = _measured(use, np.concatenate([np.asarray(some) for some in values]), plan)
        elif use.role not in texts:
            texts[use.role or _group_name(use, plan)] = joined([some for some in values if isinstance(some, Labels)])
    units = {role: ROLES[role].unit for role in data}
    found = apply(known_of(data, plan.notes, plan.reading), {}, only=[one.equation for one in plan.derived])  # type: ignore[arg-type]
    units.update({one.role: ROLES[one.role].unit for one in found if one.role in data})
    for name in plan.reading.groups:  # a group may be a column that has a role too
        if name not in data and name not in texts and (role := group_column(plan.columns, name).role) in texts:
            texts[name] = texts[str(role)]
    return pd.DataFrame({**data, **texts}, copy=False), units


def _pair_names(pair: Ints, block: Block) -> "dict[str, pd.Categorical[str]]":
    """Tool and work of each row, from the place of its pair in the block."""
    named = {}
    for role in ("tool", "work"):
        codes, names = pd.factorize(np.array([getattr(pair, role) for pair in block.pairs], dtype=object))
        named[role] = pd.Categorical.from_codes(codes[pair], categories=pd.Index(names, dtype=str))
    return named


def _group_name(use: ColumnUse, plan: Plan) -> str:
    """The name by which the reading calls a column without a role."""
    return next(name for name in plan.reading.groups if group_column(plan.columns, name).number == use.number)


def _measured(use: ColumnUse, values: Array, plan: Plan) -> Array:
    """Numbers of a role in its unit, levels of a plan as conditions."""
    role = str(use.role)
    if use.converted:
        values = convert(values, use.unit, ROLES[role].unit)
    given = plan.reading.ranges.get(role)
    if given is None:
        return values
    low, centre, high = (float(level) for level in decode_levels(role, np.array([-1.0, 0.0, 1.0]), given)[0])
    even_in_logarithm = np.isclose(centre**2, low * high, rtol=1e-9)
    return centre * (high / low) ** (values / 2) if even_in_logarithm else centre + values * (high - low) / 2
