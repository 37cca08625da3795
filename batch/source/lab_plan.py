"""Plan of lab files: every file is read once, to find the pairs that it holds."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from ...core.errors import DataError, FitmodelsError, UsageError
from ...core.rounding import count
from ...core.suggestions import did_you_mean
from ...datasets.vocabulary import ROLES, roles_named
from ..engine import SERIAL, Run
from ..engine.base import no_report
from ..outcomes import defect_sentence
from ..plan import Block, Pair, Piece, Plan, Reading
from .common import STREAMED, is_large, packed, some_names
from .lab_files import group_column, is_named_by_file, read_lab_file


@dataclass(frozen=True, slots=True)
class FileScan:
    """Pairs and columns of a file, or why it cannot be read; ``usage``: because of an option."""

    pairs: tuple[tuple[Pair, int], ...] = ()
    sha256: str = ""
    named_by_file: bool = False
    headers: tuple[str, ...] = ()
    groups: frozenset[str] = frozenset()
    unused: tuple[str, ...] = ()
    inserts: str = ""  # header of a column of tools that numbers edges
    reason: str = ""
    usage: bool = False


def files_plan(
    source: Path,
    paths: tuple[Path, ...],
    reading: Reading,
    *,
    most_rows: int,
    most_pairs: int,
    report: Callable[[str], None] = no_report,
    workers: Run = SERIAL,
    assumed: tuple[str, ...] = (),
) -> Plan:
    """Plan the pairs of lab files, in the order of the files and, within each, of its rows.

    Parameters
    ----------
    source : Path
        Folder that holds the files, or the one file.
    paths : tuple of Path
    reading, most_rows, most_pairs, report, workers : see `open_source`
    assumed : tuple of str
        Assumptions so far.

    Raises
    ------
    UsageError
        No file has a column that groups the pairs, or the options fit no file.
    DataError
        No file can be read.
    """
    names = [path.name if path == source else path.relative_to(source).as_posix() for path in paths]
    _no_numbers(reading.groups)
    alone = len(paths) == 1 and paths[0] == source
    tasks = [(str(path), reading, alone) for path in paths]
    found: list[FileScan] = []
    for one in workers.where(len(tasks) > 1).in_order(scan_file, tasks):
        found.append(one)
        report(f"read {len(found)} of {len(paths)} files")
    unreadable = {name: one.reason for name, one in zip(names, found, strict=True) if one.reason}
    if len(unreadable) == len(paths):
        raise _none_can_be_read(source, unreadable, found, alone)
    _known_groups(reading.groups, found)
    pieces, copies = _pieces(paths, names, found)
    holders = _holders(pieces)
    assumed = (*assumed, *_assumptions(names, found, copies, holders, reading))
    blocks = _blocks(holders, most_rows, most_pairs)
    rows = sum(block.rows for block in blocks)
    return Plan(source.name, "files", blocks, rows, (), unreadable, assumed, reading)


def scan_file(task: tuple[str, Reading, bool]) -> FileScan:
    """Read a file and keep what a plan needs of it: a task for another process."""
    path, reading, alone = Path(task[0]), task[1], task[2]
    try:
        if not alone and is_large(path):
            raise DataError(
                f"{path.name} has {path.stat().st_size / 1e6:.0f} MB, too many to be read whole: "
                "fit it by itself, with fitmodels batch and its name."
            )
        runs = read_lab_file(path, reading)
        return FileScan(
            pairs=tuple((Pair(part.tool, part.work), len(part)) for part in runs.pairs()),
            sha256=runs.source.sha256,
            named_by_file=is_named_by_file(runs, path),
            headers=tuple(use.header for use in runs.columns),
            unused=tuple(use.header for use in runs.columns if use.role is None and use.header.strip()),
            inserts=next((u.header for u in runs.columns if u.role == "edge" and "tool" in roles_named(u.name)), ""),
            groups=frozenset(name for name in reading.groups if group_column(runs, name) is not None),
        )
    except FitmodelsError as error:
        return FileScan(reason=str(error), usage=isinstance(error, UsageError))
    except MemoryError:
        raise
    except Exception as error:  # one odd file does not stop a thousand
        return FileScan(reason=defect_sentence(error))


def _none_can_be_read(
    source: Path, unreadable: Mapping[str, str], found: list[FileScan], alone: bool
) -> FitmodelsError:
    kind = UsageError if all(one.usage for one in found) else DataError
    name, reason = next(iter(unreadable.items()))
    return kind(
        reason if alone else f"none of the {len(found)} files in {source} can be read; the first, {name}: {reason}"
    )


def _no_numbers(groups: tuple[str, ...]) -> None:
    for name in groups:
        if name in ROLES and ROLES[name].unit:
            raise UsageError(
                f"pairs cannot be grouped by {name!r}, which is the {ROLES[name].quantity}, a number of the laws: "
                "name a column of labels."
            )


def _known_groups(groups: tuple[str, ...], found: list[FileScan]) -> None:
    headers = list(dict.fromkeys(header for one in found for header in one.headers))
    for name in groups:
        if not any(name in one.groups for one in found):
            hint = did_you_mean(name, headers, names="There are ")
            raise UsageError(f"no file has a column {name!r} to group the pairs by. {hint}")


Held = tuple[Piece, tuple[tuple[Pair, int], ...]]


def _pieces(paths: Iterable[Path], names: Iterable[str], found: list[FileScan]) -> tuple[list[Held], list[str]]:
    """The files that are read, with their pairs; and those that are copies of another, to the byte."""
    pieces: list[Held] = []
    first: dict[tuple[str, tuple[tuple[Pair, int], ...]], str] = {}
    copies: list[str] = []
    for path, name, one in zip(paths, names, found, strict=True):
        if one.reason:
            continue
        # a copy that names no tool counts as another tool by its file name, and is still reported as a copy
        key = (one.sha256, () if one.named_by_file else one.pairs)
        if key in first:
            copies.append(f"{name} ({first[key]})")
            continue
        first[key] = name
        pieces.append((Piece(str(path), name, one.sha256), one.pairs))
    return pieces, copies


def _holders(pieces: list[Held]) -> dict[Pair, list[tuple[Piece, int]]]:
    """The files that hold each pair, with its rows in each."""
    holders: dict[Pair, list[tuple[Piece, int]]] = {}
    for piece, pairs in pieces:
        for pair, rows in pairs:
            holders.setdefault(pair, []).append((piece, rows))
    return holders


def _blocks(holders: dict[Pair, list[tuple[Piece, int]]], most_rows: int, most_pairs: int) -> tuple[Block, ...]:
    """Pairs in their order, as many in a block as its limits allow."""
    pairs, rows = tuple(holders), [sum(count for _, count in held) for held in holders.values()]
    return tuple(
        _block(pairs[at.start : at.stop], sum(rows[at.start : at.stop]), holders, STREAMED * most_rows)
        for at in packed(rows, most_rows, most_pairs)
    )


def _block(
    pairs: tuple[Pair, ...], rows: int, holders: dict[Pair, list[tuple[Piece, int]]], most_in_memory: int
) -> Block:
    pieces = {piece.path: piece for pair in pairs for piece, _ in holders[pair]}
    ordered = sorted(pieces.values(), key=lambda piece: Path(piece.path))
    place = {piece.path: i for i, piece in enumerate(ordered)}
    of_pair = tuple(tuple(place[piece.path] for piece, _ in holders[pair]) for pair in pairs)
    return Block(pairs, tuple(ordered), rows, rows > most_in_memory, of_pair)


def _assumptions(
    names: list[str], found: list[FileScan], copies: list[str], holders: dict[Pair, list[tuple[Piece, int]]],
    reading: Reading,
) -> Iterator[str]:  # fmt: skip
    """Assumptions, in full sentences."""
    if nameless := [name for name, one in zip(names, found, strict=True) if one.named_by_file]:
        yield (
            f"{count(len(nameless), 'file names', 'files name')} no tool; each counts as a tool named after its file: "
            f"{some_names(nameless)}. Name one tool for all with --tool."
        )
    for header in dict.fromkeys(one.inserts for one in found if one.inserts):
        these = [name for name, one in zip(names, found, strict=True) if one.inserts == header]
        yield (
            f"{header!r} numbers cutting edges of one tool, not types of tools, in {count(len(these), 'file')}: "
            f"{some_names(these)}. If each value is a tool of its own: --map {quote(f'tool={header}')}."
        )
    if copies:
        files = count(len(copies), "file is a byte-identical copy", "files are byte-identical copies")
        yield f"{files} of another and skipped: {some_names(copies)}."
    if several := [str(pair) for pair, held in holders.items() if len(held) > 1]:
        yield (
            f"{count(len(several), 'pair is', 'pairs are')} in more than one file; files with measurements are joined, "
            f"with edges distinguished by file: {some_names(several)}."
        )
    unused = Counter(name for one in found for name in dict.fromkeys(one.unused) if name not in reading.groups)
    if unused:
        columns = [f"{name!r} ({count(n, 'file')})" for name, n in unused.most_common()]
        yield f"Columns that no law uses: {some_names(columns)}; assign them with --map."
    for name in reading.groups:
        if lacking := [
            file for file, one in zip(names, found, strict=True) if not one.reason and name not in one.groups
        ]:
            files = count(len(lacking), "file has", "files have")
            yield f"{files} no column {name!r}; their pairs are in no group: {some_names(lacking)}."
