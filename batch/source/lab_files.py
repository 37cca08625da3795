"""Lab files: each as ``fitmodels FILE`` reads it; a block of pairs -> Rows, pairs of several files joined."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from ...core.arrays import Texts
from ...core.errors import DataError, FitmodelsError
from ...datasets import Runs, read_runs
from ...datasets.runs import Source
from ...datasets.vocabulary import MARK, MEASURED, ROLES, UNNAMED
from ...pipeline.reading import tests_table
from ..plan import Block, Pair, Piece, Plan, Reading
from ..rows import PairRows, PairSource
from .common import some_names

NAMED_BY_FILE = "tool: not named in the file, called {name} after it; name it with --tool"


def read_lab_file(path: Path, reading: Reading) -> Runs:
    """The tests of a file.

    Raises
    ------
    DataError
        The file cannot be read, or is a record of one run.
    UsageError
        The options name a column or sheet that the file does not have.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> read_lab_file(datasets.bundled("gc435_709m40"), Reading()).tool
    'GC435'
    """
    table, doubt = tests_table(path, reading)
    runs = read_runs(table, **reading.reading())
    if runs.tool == UNNAMED["tool"]:
        runs = read_runs(table, **reading.reading() | {"tool": path.stem})
        runs = replace(runs, assumed=(*runs.assumed, NAMED_BY_FILE.format(name=path.stem)))
    return replace(runs, assumed=(*runs.assumed, *doubt))


def is_named_by_file(runs: Runs, path: Path) -> bool:
    """Whether the tool has the name of the file."""
    return NAMED_BY_FILE.format(name=path.stem) in runs.assumed


def pairs_of(runs: Runs, groups: tuple[str, ...]) -> Iterator[tuple[Pair, Runs]]:
    """The runs of each pair, of roles and groups only, with tool and work as columns, all in one order."""
    roles = [name for name in map(str, runs.data) if name in ROLES and name not in UNNAMED]
    roles += [name for name in map(str, runs.data) if name.endswith(MARK) and name.removesuffix(MARK) in roles]
    headers = [name for name in groups if name not in ROLES]
    columns = runs.data[[*roles, *(name for name in UNNAMED if name in runs.data)]]
    columns = columns.assign(**{name: group_texts(runs, name) for name in headers})
    for part in replace(runs, data=columns).pairs():
        data = part.data.assign(tool=part.tool, work=part.work)[[*roles, *UNNAMED, *headers]]
        yield Pair(part.tool, part.work), replace(part, data=data.reset_index(drop=True))


def group_texts(runs: Runs, header: str) -> Texts:
    """Texts of the column under a header, shape (n,); empty where the file has no such column."""
    column = group_column(runs, header)
    return runs.labels(column) if column is not None else np.full(len(runs), "", dtype=object)


def group_column(runs: Runs, header: str) -> str | None:
    """Name in the data of the column of a header, with its unit or without."""
    for use in sorted(runs.columns, key=lambda use: use.header != header):
        if header in (use.header, use.name):
            names = (use.role,) if use.role else (f"col{use.number}", use.header)
            return next((name for name in names if name in runs.data), None)
    return None


LISTED = 3  # files named by a pair that is joined from them


def files_rows(block: Block, plan: Plan) -> tuple[list[PairRows], dict[str, str]]:
    """Rows of the pairs of a block, one `Rows` for each set of columns, and the files that can no longer be read.

    Every pair keeps its own source, columns, assumptions, warnings and notes (``Rows.of_pair``).
    """
    held: dict[Pair, list[tuple[str, Runs]]] = {pair: [] for pair in block.pairs}
    unreadable: dict[str, str] = {}
    for piece in block.pieces:
        try:
            for pair, runs in _parts(piece, plan.reading):
                if pair in held:
                    held[pair].append((piece.name, runs))
        except FitmodelsError as error:
            unreadable[piece.name] = str(error)
    return _alike({pair: joined(pair, parts) for pair, parts in held.items() if parts}), unreadable


def files_chunks(block: Block, plan: Plan) -> Iterator[pd.DataFrame]:
    """Rows of the one pair of a block, file by file, of the columns that all of its files hold.

    Raises
    ------
    DataError
        A file can no longer be read.
    """
    pair, several = block.pairs[0], len(block.pieces) > 1

    def frames() -> Iterator[pd.DataFrame]:
        for piece in block.pieces:
            runs = dict(_parts(piece, plan.reading))[pair]
            yield (_by_file(piece.name, runs) if several else runs).data

    shared: list[str] = []
    for k, frame in enumerate(frames() if several else ()):
        shared = [name for name in map(str, frame) if k == 0 or name in shared]
    for frame in frames():
        yield frame[shared] if several else frame


def joined(pair: Pair, parts: list[tuple[str, Runs]]) -> Runs:
    """Runs of a pair from its files, as if they stood in one; laboratories number the edges anew in each file.

    A file of the pair without measurements, such as a plan of tests, is left out: otherwise the columns that it lacks
    would be lost. Neighbours are joined first, then the results: joining one by one would copy the first file's rows
    as often as there are files.
    """
    measured = [(name, runs) for name, runs in parts if measures(runs)]
    if measured and len(measured) < len(parts):
        others = [name for name, runs in parts if not measures(runs)]
        sentence = f"Of {pair} {some_names(others)} contains no wear, force, power or roughness: its rows are left out."
        runs = joined(pair, measured)
        return replace(runs, warnings=(*runs.warnings, sentence))
    if len(parts) == 1:
        return parts[0][1]
    files = [name for name, _ in parts]
    level = [_by_file(name, runs) for name, runs in parts]
    lost = dict.fromkeys(
        str(name)
        for runs in level
        for name in runs.data
        if any(str(name).removesuffix(MARK) not in one.data for one in level)
    )
    while len(level) > 1:
        couples = zip(level[::2], level[1::2], strict=False)
        level = [one.join(other) for one, other in couples] + level[len(level) & ~1 :]
    runs = level[0]
    sentence = f"{pair} is joined from {len(files)} files ({some_names(files)}); its edges are distinguished by file"
    warned = (f"Columns that not all files of {pair} hold are left out: {', '.join(lost)}.",) if lost else ()
    name = runs.source.name if len(files) <= LISTED else f"{parts[0][1].source.name} and {len(files) - 1} other files"
    return replace(
        runs, source=replace(runs.source, name=name), assumed=(*runs.assumed, sentence),
        warnings=(*runs.warnings, *warned),
    )  # fmt: skip


def measures(runs: Runs) -> bool:
    """Whether a column holds measurements to which a law could be fitted.

    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> measures(runs), measures(replace(runs, data=runs.data[["V", "f"]]))
    (True, False)
    """
    return any(
        ROLES[str(name)].kind in MEASURED and runs.data[name].notna().any() for name in runs.data if name in ROLES
    )


def _by_file(name: str, runs: Runs) -> Runs:
    """Edges named by their file as well; without a column of edges the file is one edge."""
    if "edge" in runs.data:
        edges = [f"{name}: {edge}" if edge else "" for edge in runs.data["edge"]]
    else:
        edges = [name] * len(runs)
    return replace(runs, data=runs.data.assign(edge=pd.Series(edges, index=runs.data.index, dtype=object)))


def _parts(piece: Piece, reading: Reading) -> Iterator[tuple[Pair, Runs]]:
    path = Path(piece.path)
    if not path.is_file():
        raise DataError(
            f"{piece.name} no longer exists: it was removed after the batch was planned. Run the command again."
        )
    runs = read_lab_file(path, reading)
    if runs.source.sha256 != piece.stamp:
        raise DataError(f"{piece.name} has changed since the batch was planned. Run the command again.")
    yield from pairs_of(runs, reading.groups)


def _alike(tests: dict[Pair, Runs]) -> list[PairRows]:
    """Pairs of the same columns in one frame."""
    by_columns: dict[tuple[str, ...], dict[Pair, Runs]] = {}
    for pair, runs in tests.items():
        by_columns.setdefault(tuple(map(str, runs.data)), {})[pair] = runs
    return [_rows(alike) for alike in by_columns.values()]


def _rows(tests: dict[Pair, Runs]) -> PairRows:
    parts = list(tests.values())
    frame = pd.concat([runs.data for runs in parts], ignore_index=True)
    texts = [name for name in frame if not pd.api.types.is_numeric_dtype(frame[name])]
    frame = frame.astype(dict.fromkeys(texts, "category"))  # texts of a thousand files would be taken apart slowly
    sources = dict.fromkeys(runs.source for runs in parts)
    first, one_file = parts[0], len(sources) == 1
    return PairRows(
        frame=frame,
        lines=np.concatenate([runs.lines for runs in parts]),
        units=first.units,
        columns=first.columns,
        source=first.source if one_file else Source(f"{len(sources)} files", "", len(frame), ""),
        assumed=first.assumed if one_file else (),
        warnings=first.warnings if one_file else (),
        notes=first.notes if one_file else (),
        of_pair={pair: PairSource.of(runs) for pair, runs in tests.items()},
    )
