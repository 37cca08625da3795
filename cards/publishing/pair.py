"""A folder of a pair: found, read, checked, and written as the folder of a card."""

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from ...core.bounded import read_bounded, sha256_of
from ...core.errors import DataError, FitmodelsError, UsageError
from ...core.journal import FORMER, recover, recover_below
from ...core.version import __version__
from ...parameters import ParameterFile, read
from ..content.card import Card, compose
from ..content.figure_texts import FOLDER as FIGURES
from ..folder import PAGE, PARAMETERS, PROGRAM, README, card_files
from .card_toml import read_toml
from .entries import CardEntry, card_entry
from .pages import mark_page, mark_readme
from .requirements import QUESTIONS, PublicationCheck, card_toml_template, check_publication
from .site_folder import intact_files

Made = TypeVar("Made")
TOML = "card.toml"
READINGS = 5  # of a pair whose files another command replaces
WRITERS = ("cards", "controllers", "parameters", "fit", "ident", "datasets", "core")  # packages that `cards` may import
CODE = (".py", ".md", ".html", ".css", ".js")


@dataclass(frozen=True, slots=True)
class PublicationProblem:
    """A problem with publishing a pair: its folder within FOLDER, and a sentence.

    ``kind`` is ``unreadable``, ``field``, ``check`` or ``twice``; ``fields`` are those that are empty.
    """

    folder: str
    kind: str
    words: str
    fields: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PairTask:
    """A pair to be reviewed.

    Attributes
    ----------
    folder : Path
    name : str
        Its name in the report.
    to : Path or None
        Folder of its card, if it is to be written.
    above : Path or None
        The ``card.toml`` for all pairs, if there is one.
    draft : bool
        Whether a card with problems is written too, with a list of them on it.
    made_from : str
        `source_digest` of the pair; empty where its card is not to be kept.
    """

    folder: Path
    name: str
    to: Path | None = None
    above: Path | None = None
    draft: bool = False
    made_from: str = ""


@dataclass(frozen=True, slots=True)
class PairReview:
    """Result of one pair: its entry, or its problems and a template of ``card.toml``; of a draft, both."""

    task: PairTask
    entry: CardEntry | None
    problems: tuple[PublicationProblem, ...] = ()
    template: str = ""


def pair_folders(folder: Path, site: Path | None = None) -> tuple[Path, ...]:
    """Folders with a ``params.json``, sorted by path, without hidden ones and the site itself.

    Raises
    ------
    UsageError
        There is no such folder.
    DataError
        It holds no ``params.json``.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as place:
    ...     (Path(place) / "a").mkdir()
    ...     _ = (Path(place) / "a" / "params.json").write_text("{}")
    ...     [path.name for path in pair_folders(Path(place))]
    ['a']
    """
    recover(folder)
    if not folder.is_dir():
        raise UsageError(
            f"{folder}: is no folder; give the one with the folders of the pairs, each with its {PARAMETERS}."
        )
    found = list(_holding_parameters(folder, None if site is None else Path(os.path.realpath(site))))
    if not found:
        raise DataError(f"{folder}: holds no {PARAMETERS}; fit first: fitmodels data.csv --out {folder}.")
    return tuple(sorted(found, key=lambda path: path.relative_to(folder).parts))


def _holding_parameters(folder: Path, site: Path | None) -> Iterator[Path]:
    """Folders in and below this one that hold a parameter file, without hidden ones and the site."""
    for place, below, names in os.walk(folder):
        if any(FORMER.fullmatch(name) for name in below):
            recover_below(place)
            below[:] = [path.name for path in Path(place).iterdir() if path.is_dir() and not path.is_symlink()]
        below[:] = sorted(n for n in below if not n.startswith(".") and (site is None or _real(place, n) != site))
        if PARAMETERS in names:
            yield Path(place)


def shared_toml(folder: Path, pairs: Sequence[Path]) -> Path | None:
    """The ``card.toml`` of a folder of pairs that adds to the card of each; None without one."""
    return folder / TOML if folder not in pairs and os.path.lexists(folder / TOML) else None


def _real(place: str, name: str) -> Path:
    return Path(os.path.realpath(Path(place, name)))


def unreplaced(folder: Path, make: Callable[[], Made]) -> Made:
    """Contents that ``make`` reads from the folder of a pair, again where another command replaced files meanwhile.

    Raises
    ------
    DataError
        Files were replaced each time.
    """
    for _ in range(READINGS):
        before = _stamp(folder)
        made = make()
        if _stamp(folder) == before:
            return made
    raise DataError(f"{folder}: another command keeps replacing its files; try again when it has ended.")


def _stamp(folder: Path) -> list[tuple[int, int] | None]:
    """Number and time of change of the folder, its figures and parameters: other ones after they were replaced."""
    found: list[tuple[int, int] | None] = []
    for path in (folder, folder / FIGURES, folder / PARAMETERS, folder / TOML):
        try:
            seen = path.stat()
        except OSError:
            found.append(None)
        else:
            found.append((seen.st_ino, seen.st_mtime_ns))
    return found


def review(task: PairTask) -> PairReview:
    """Read and check a pair; write its card if there are no problems."""
    try:
        found, made = unreplaced(task.folder, lambda: _reviewed(task))
    except FitmodelsError as error:
        return PairReview(
            task, None, (PublicationProblem(task.name, "unreadable", str(error).replace(f"{task.folder}/", "")),)
        )
    if task.to is not None:
        _write_files(task.to, made)
    return found


def _reviewed(task: PairTask) -> tuple[PairReview, dict[str, bytes]]:
    """Result of a pair, and the files of its card."""
    pf, whole, card = read_pair(task.folder, above=task.above)
    problems = tuple(_problems(task, check_publication(card, pf, task.folder)))
    asks = "field" in {p.kind for p in problems} and not os.path.lexists(task.folder / TOML)
    template = card_toml_template(card) if asks else ""
    if problems and not task.draft:
        return PairReview(task, None, problems, template), {}
    gaps = tuple(one.words for one in problems)
    made = {} if task.to is None else _made(task, whole, card, gaps)
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(made.items())}
    entry = card_entry(card, whole, hashes, gaps).model_copy(update={"made_from": task.made_from})
    return PairReview(task, entry, problems, template), made


def kept(task: PairTask, entry: CardEntry, folder: Path) -> PairReview | None:
    """The pair with its card copied from ``folder`` of the former site; None where files there are not as listed."""
    made = intact_files(folder, entry.files)
    if made is None or task.to is None:
        return None
    _write_files(task.to, made)
    return PairReview(task, entry)


@lru_cache(maxsize=1)
def writer_digest() -> str:
    """SHA-256 of version and code that write a card: all packages that `cards` imports, and templates."""
    digest, top = hashlib.sha256(__version__.encode()), Path(__file__).parents[2]
    for package in WRITERS:
        for path in sorted((top / package).rglob("*")):
            if path.suffix in CODE:
                digest.update(f"{path.relative_to(top).as_posix()}\0{sha256_of(path)}\0".encode())
    return digest.hexdigest()


def source_digest(folder: Path, above: Path | None) -> str:
    """SHA-256 of all that the card of a pair is made from: code, parameters, both card.toml, pictures, draws.

    Empty where a file cannot be read.
    """
    recover(folder / PARAMETERS)
    digest = hashlib.sha256(writer_digest().encode())
    named = [("above", above), *((path.name, path) for path in (folder / PARAMETERS, folder / TOML))]
    named += [(f"{path.parent.name}/{path.name}", path) for path in sorted((folder / FIGURES).glob("*.png"))]
    named += [(path.name, path) for path in sorted(folder.glob("*.npz"))]
    try:
        for name, path in named:
            if path is not None and os.path.lexists(path):
                digest.update(f"{name}\0{sha256_of(path)}\0".encode())
    except (OSError, DataError):
        return ""
    return digest.hexdigest()


def read_pair(
    folder: Path, name: str = PARAMETERS, toml: Path | None = None, above: Path | None = None
) -> tuple[ParameterFile, ParameterFile, Card]:
    """The parameter file on disk, the same with the metadata of ``card.toml``, and their card.

    Parameters
    ----------
    folder : Path
        Folder of the parameter file with its pictures and draws.
    name : str
        Of the parameter file.
    toml : Path, optional
        By default the one in ``folder``, if there is one.
    above : Path, optional
        A ``card.toml`` for many pairs; ``toml`` has precedence.

    Raises
    ------
    FitmodelsError
        One of the two cannot be read, or they contradict each other.
    """
    pf = read(folder / name)
    if toml is None and os.path.lexists(folder / TOML):
        toml = folder / TOML
    if toml is None and above is None:
        return pf, pf, compose(pf, folder=folder)
    metadata = read_toml(toml or above or TOML, above if toml else None)
    whole = metadata.applied(pf)
    return pf, whole, compose(whole, publication=metadata.publication, folder=folder)


def _problems(task: PairTask, report: PublicationCheck) -> Iterator[PublicationProblem]:
    """Missing fields in one sentence, those that need a new fit, failed checks."""
    asked = tuple(m.field for m in report.missing if m.field in QUESTIONS)
    if asked:
        yield PublicationProblem(task.name, "field", f"missing: {', '.join(asked)}; add them in {TOML}.", asked)
    for m in report.missing:
        if m.field not in QUESTIONS:
            yield PublicationProblem(task.name, "field", f"missing: {m.field}; {m.why}. {m.ask}", (m.field,))
    for words in report.refusals:
        yield PublicationProblem(task.name, "check", words)


def contents(folder: Path, pf: ParameterFile, card: Card) -> dict[str, bytes]:
    """Files of the folder of a published card, by their names: parameter file, pictures, draws, the card's forms."""
    copied = [PARAMETERS, *(f.file for f in card.figures if f.file)]
    if pf.posterior is not None and pf.posterior.draws_file is not None:
        copied.append(pf.posterior.draws_file)  # without them the file that is published fails its own check
    made = {name: _copied(folder / name) for name in copied}
    named = sorted(name for name in (*made, README, PROGRAM) if "/" not in name)
    for name, content in card_files(card, pf, named).items():
        made["index.html" if name == PAGE else name] = content
    return made


def _copied(path: Path) -> bytes:
    kinds = {PARAMETERS: "parameters", ".npz": "draws"}
    return read_bounded(path, kinds.get(path.name) or kinds.get(path.suffix, "figure"))


def _made(task: PairTask, pf: ParameterFile, card: Card, gaps: tuple[str, ...]) -> dict[str, bytes]:
    """Files of the folder of a card, by their names."""
    made = contents(task.folder, pf, card)
    if task.draft:
        made["index.html"] = mark_page(made["index.html"], gaps)
        made[README] = mark_readme(made[README], gaps)
    return made


def _write_files(to: Path, made: dict[str, bytes]) -> None:
    for name, content in made.items():
        (to / name).parent.mkdir(parents=True, exist_ok=True)
        (to / name).write_bytes(content)
