"""The output folder: its owner, the files that batch wrote, and the removal of those that are out of date."""

import json
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from shutil import rmtree
from typing import Any

from ..core.bounded import has_content, stored_json
from ..core.errors import UsageError
from ..core.files import locked, make_folder, write_whole
from ..core.journal import recover
from ..core.version import __version__
from .plan import BatchOptions, Pair
from .records import RECORDS, hash_of, read_json, written

SCHEMA = "fitmodels.batch/1"
MANIFEST = Path(".batch", "manifest.json")
MADE = Path(".batch", "made.json")
LOCK = Path(".batch", "lock")


def folder_names(pairs: Iterable[Pair]) -> dict[Pair, str]:
    """Folder of each pair within ``pairs/``.

    Examples
    --------
    >>> list(folder_names([Pair("GC435", "709M40"), Pair("gc435", "709M40")]).values())
    ['GC435_709M40', 'gc435_709M40-2']
    """
    from ..cards.folder import folder_names as names_of

    each = list(dict.fromkeys(pairs))
    return dict(zip(each, names_of((pair.tool, pair.work) for pair in each), strict=True))


@contextmanager
def prepare(out: Path, source: str, options: BatchOptions, force: bool = False) -> Iterator[None]:
    """Prepare the output folder, and lock it against other batches until the end of the ``with``.

    Nothing is written before it is known that the folder is free or ours. What another batch of the same source left
    stays: blocks whose keys are others are fitted anew. A folder that was made here goes again where something is
    raised before anything was recorded in it.

    Parameters
    ----------
    out : Path
    source : str
        Its name, which the manifest records.
    options : BatchOptions
    force : bool
        Remove first whatever batch wrote there; other files stay.

    Raises
    ------
    UsageError
        ``out`` is a file, holds something that batch did not write, or a batch of another source, or a parameter
        file that was changed since; another batch writes there.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder, prepare(Path(folder, "lab-batch"), "lab", BatchOptions()):
    ...     put(Path(folder, "lab-batch"), "results.csv", b"tool,work")
    True
    """
    _free_or_ours(out, source, force)
    new = not out.exists()
    try:
        make_folder(out / RECORDS)
        with locked(out / LOCK, _in_use(out)):
            _free_or_ours(out, source, force)  # another batch may have ended before the lock
            for folder in {(out / name).parent for files in written(out).values() for name in files}:
                recover(folder)
            if not force:
                _unchanged_by_others(out)
            for path in (out / RECORDS).glob(".fitmodels-*.tmp"):  # of a process that was killed
                path.unlink()
            _write_manifest(out, source, options)  # where the disk is full, nothing has been removed yet
            if force:
                _clear(out)
            yield
    except BaseException:
        if new:
            _remove_new(out)
        raise


def _in_use(out: Path) -> str:
    return f"{out}: another batch is writing there; wait until it ends or choose another folder with --out."


def put(out: Path, name: str, content: bytes) -> bool:
    """Write a file that is not of a pair (a table, a figure), whole, and only where its bytes are others.

    It counts as ours from then on: ``prepare`` removes it with ``force``.

    Returns
    -------
    bool
        Whether anything was written.
    """
    if holds(out, name, content):
        return False
    claim(out, [name])
    write_whole(out / name, content, parents=True)
    return True


def holds(out: Path, name: str, content: bytes) -> bool:
    """Whether a file exists with exactly this content."""
    return has_content(out / name, content)


def claim(out: Path, names: Iterable[str]) -> None:
    """Record files within ``out`` as made by batch, whoever writes them."""
    before = _claimed(out)
    now = {*before, *names}
    if now != {*before}:
        _write_claimed(out, now)


def claimed(out: Path, under: str) -> tuple[str, ...]:
    """Files below ``under`` that batch makes, as paths within ``out``."""
    return tuple(name for name in _claimed(out) if name.startswith(under))


def retire(out: Path, under: str, kept: Collection[str]) -> None:
    """Remove files below ``under`` that batch made earlier and does not make any more."""
    made = _claimed(out)
    gone = {name for name in made if name.startswith(under) and name not in kept}
    if gone:
        _remove(out, gone)
        _write_claimed(out, {*made} - gone)


def sweep(out: Path, keys: Collection[str]) -> tuple[str, ...]:
    """Remove results of earlier states of the source or other options, once every block is recorded.

    A record of another key goes, and so do the files that no record of these keys names (pairs that are gone, draws
    that are no longer kept): provided that they are as batch wrote them by their SHA-256.

    Returns
    -------
    tuple of str
        Files that were removed, as paths within ``out``.
    """
    if {path.stem for path in (out / RECORDS).glob("*.json")} <= set(keys):  # by their names, without opening any
        return ()
    records = written(out)
    kept = {name for key, files in records.items() if key in keys for name in files}
    stale = {key: files for key, files in records.items() if key not in keys}
    ours = (item for files in stale.values() for item in files.items())
    gone = {name for name, made in ours if name not in kept and hash_of(out / name) == made}
    _remove(out, gone)
    for key in stale:
        (out / RECORDS / f"{key}.json").unlink(missing_ok=True)
    return tuple(sorted(gone))


def _free_or_ours(out: Path, source: str, force: bool) -> None:
    if out.is_symlink() and not out.exists():
        raise UsageError(f"{out} is a link that leads nowhere; choose a folder with --out.")
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out} is a file; choose a folder with --out.")
    if not out.exists():
        return
    manifest = _manifest(out)
    if manifest is None and os.path.lexists(out / MANIFEST):
        if not force:
            raise UsageError(
                f"{out / MANIFEST}: is damaged, or of another version of fitmodels, so it is not known which batch "
                f"{out} holds. Replace what batch wrote there with --force, or choose another folder with --out."
            )
    elif manifest is None:
        foreign = sorted(name for name in _names(out) if name != MANIFEST.parent.name)
        if foreign:
            raise UsageError(
                f"{out} holds {foreign[0]!r}, which batch did not write; choose another folder with --out."
            )
    elif manifest["source"] != source and not force:
        raise UsageError(
            f"{out} holds a batch of {manifest['source']}, not of {source}; replace it with --force, or write "
            "elsewhere with --out."
        )


def _names(out: Path) -> list[str]:
    try:
        return [path.name for path in out.iterdir()]
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise UsageError(f"{out}: cannot be read: {why}; choose another place with --out.") from None


def _manifest(out: Path) -> dict[str, Any] | None:
    """None where there is none, or none that this version understands."""
    data = read_json(out / MANIFEST)
    return data if data.get("schema") == SCHEMA and "source" in data else None


def _write_manifest(out: Path, source: str, options: BatchOptions) -> None:
    """Write the manifest; one of the same content stays, with its time."""
    plain = json.loads(json.dumps(asdict(options), default=str))  # as JSON reads them back
    manifest = {"schema": SCHEMA, "source": source, "fitmodels": __version__, "options": plain}
    before = _manifest(out)
    if before is None or {**before, "started": None} != {**manifest, "started": None}:
        manifest["started"] = datetime.now(UTC).isoformat(timespec="seconds")
        write_whole(out / MANIFEST, (json.dumps(manifest, indent=1, sort_keys=True) + "\n").encode(), parents=True)


def _unchanged_by_others(out: Path) -> None:
    """Refuse to go on over a parameter file that somebody changed, for instance with ``fitmodels tune``."""
    ours: dict[str, set[str]] = {}
    newest: dict[str, int] = {}
    for key, files in written(out).items():
        at = (out / RECORDS / f"{key}.json").stat().st_mtime_ns
        for name, digest in files.items():
            ours.setdefault(name, set()).add(digest)
            newest[name] = max(newest.get(name, 0), at)
    for name, made in ours.items():
        path = out / name
        # a record is written after its files: what is older than its record was not touched since
        if path.is_file() and path.stat().st_mtime_ns >= newest[name] and hash_of(path) not in made:
            raise UsageError(
                f"{path} was changed since batch wrote it; move it elsewhere to keep it, or replace all that batch "
                "wrote there with --force."
            )


def _remove_new(out: Path) -> None:
    """Remove a folder that holds the manifest and the lock only."""
    with suppress(OSError):
        if all(path.relative_to(out) in (MANIFEST, LOCK) for path in out.rglob("*") if not path.is_dir()):
            rmtree(out)


def _clear(out: Path) -> None:
    """Remove what the records and the list of other files name; nothing else."""
    _remove(out, {name for files in written(out).values() for name in files} | set(_claimed(out)))
    for path in (out / RECORDS).glob("*.json"):
        path.unlink()
    (out / MADE).unlink(missing_ok=True)


def _claimed(out: Path) -> list[str]:
    data = stored_json(out / MADE)
    names = data if isinstance(data, list) else []
    return [name for name in names if isinstance(name, str) and _leads_inside(name)]


def _leads_inside(name: str) -> bool:
    return "\\" not in name and not {"", ".", ".."} & set(name.split("/"))


def _write_claimed(out: Path, names: Collection[str]) -> None:
    write_whole(out / MADE, (json.dumps(sorted(names), indent=1) + "\n").encode(), parents=True)


def _remove(out: Path, names: Iterable[str]) -> None:
    """Remove files, then the folders that they leave empty."""
    folders = set()
    for name in names:
        path = out / name
        with suppress(OSError):  # a folder now: not ours
            path.unlink(missing_ok=True)
        folders |= {parent for parent in path.parents if parent != out and parent.is_relative_to(out)}
    for folder in sorted(folders, key=lambda path: len(path.parts), reverse=True):
        _remove_empty(folder)


def _remove_empty(folder: Path) -> None:
    """Remove a folder that holds nothing, or only what a process that was killed left half written."""
    with suppress(OSError):
        there = list(folder.iterdir())
        if all(path.match(".fitmodels-*.tmp") for path in there):
            for path in there:
                path.unlink()
            folder.rmdir()
