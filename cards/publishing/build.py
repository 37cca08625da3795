"""A site of many cards: all checked first, then written completely or not at all."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from shutil import rmtree
from typing import Any

from ...core.errors import UsageError
from ...core.files import cause, write_whole
from ...core.folders import FolderState, folder_state, put_folder, staged
from .entries import CardEntry, with_slugs
from .pages import atom_feed, card_list, compare_page, index_page
from .pair import TOML, PairReview, PairTask, PublicationProblem, kept, pair_folders, review, shared_toml, source_digest
from .pool import each
from .requirements import QUESTIONS, shared_template
from .site_folder import NAMES, is_draft, is_ours, published_cards, refuse, same

TITLE = "Model cards of tools and work materials"
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class PublicationReport:
    """Result of publishing: cards, problems, files written.

    Attributes
    ----------
    cards : tuple of CardEntry
        Of the site, in its order; empty if there are problems, unless the site is a draft.
    problems : tuple of PublicationProblem
        All of them, in the order of the folders.
    templates : tuple of Path
        Templates of ``card.toml`` that were written.
    site : Path or None
        Folder of the site; None if none was written.
    unchanged : bool
        The site existed already with the same content.
    found : int
        Pairs in the folder.
    draft : bool
        Whether a draft was asked for.
    """

    cards: tuple[CardEntry, ...] = ()
    problems: tuple[PublicationProblem, ...] = ()
    templates: tuple[Path, ...] = ()
    site: Path | None = None
    unchanged: bool = False
    found: int = 0
    draft: bool = False

    @property
    def ok(self) -> bool:
        """Whether there are no problems."""
        return not self.problems

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "found": self.found,
            "site": None if self.site is None else str(self.site),
            "draft": self.draft,
            "unchanged": self.unchanged,
            "cards": [card.slug for card in self.cards],
            "problems": [asdict(problem) for problem in self.problems],
            "templates": [str(path) for path in self.templates],
        }


def publish(
    folder: str | os.PathLike[str],
    site: str | os.PathLike[str],
    *,
    title: str = TITLE,
    jobs: int = 1,
    force: bool = False,
    draft: bool = False,
    progress: Progress = lambda words: None,
) -> PublicationReport:
    """Write the static site of all pairs in a folder: index, comparison, a folder a card, feed and list.

    Everything is written to a hidden folder next to the site, which then takes its place: a failure, an interrupt or a
    killed process leaves the old site or the new one. In ``site`` only the files of a site are replaced, its folder
    ``cards`` as a whole.

    Parameters
    ----------
    folder : path
        Holds folders with ``params.json``, at any depth; a ``card.toml`` there adds to the card, one in ``folder``
        itself to all cards.
    site : path
        Folder of the site.
    title : str
        Of the site; the id of its feed depends on it.
    jobs : int
        Processes; the bytes do not depend on it.
    force : bool
        Replace another site of ours; a draft is replaced without it.
    draft : bool
        Write the site in spite of problems, each page marked as a draft with its gaps. A pair without a readable
        parameter file is listed on the index. A draft never replaces a published site.
    progress : callable
        Receives progress messages.

    Returns
    -------
    PublicationReport
        With ``problems``, if any: then only templates of ``card.toml`` are written, unless the site is a draft: one
        in ``folder`` for fields that all pairs lack, or one in the folder of each pair.

    Raises
    ------
    UsageError
        The folder is missing, the site exists and ``force`` is not given, or it cannot be written.
    DataError
        The folder holds no ``params.json``.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fitmodels import parameters
    >>> with TemporaryDirectory() as place:
    ...     pair = Path(place) / "pairs" / "one"
    ...     pair.mkdir(parents=True)
    ...     pf = parameters.collect(tool="GC435", work="709M40", limits={"power": 7})
    ...     _ = parameters.write(pf, pair / "params.json")
    ...     report = publish(Path(place) / "pairs", Path(place) / "site")
    ...     report.ok, [path.name for path in report.templates]
    (False, ['card.toml'])
    """
    folder, site = Path(folder), Path(site)
    pairs = pair_folders(folder, site)
    try:
        with staged(site) as made:
            refuse(site, folder)
            former = folder_state(site)
            tasks = _tasks(folder, pairs, made / "cards", draft=draft)
            reviews = _reviews(tasks, {} if draft else published_cards(site), jobs, progress)
            problems = _problems(reviews)
            templates = _templates(folder, reviews)
            if problems and not (draft and any(one.entry for one in reviews)):
                return PublicationReport(problems=problems, templates=templates, found=len(pairs), draft=draft)
            entries = _fill(made, reviews, title, draft=draft)
            unchanged = _put(made, site, former, force, draft=draft)
    except OSError as error:
        raise UsageError(
            f"{site}: the site cannot be written: {cause(error)}; choose another place with --site."
        ) from None
    return PublicationReport(tuple(entries), problems, templates, site, unchanged, len(pairs), draft)


def check(
    folder: str | os.PathLike[str],
    site: str | os.PathLike[str] | None = None,
    *,
    jobs: int = 1,
    progress: Progress = lambda words: None,
) -> PublicationReport:
    """Check all pairs in a folder as ``publish`` does, without writing a site."""
    folder, site = Path(folder), None if site is None else Path(site)
    pairs = pair_folders(folder, site)
    reviews = _reviews(_tasks(folder, pairs), {}, jobs, progress)
    problems = _problems(reviews)
    entries = () if problems else tuple(_ordered(reviews))
    return PublicationReport(entries, problems, _templates(folder, reviews), found=len(pairs))


def _tasks(folder: Path, pairs: Sequence[Path], to: Path | None = None, *, draft: bool = False) -> list[PairTask]:
    above = shared_toml(folder, pairs)
    if to is None:
        return [PairTask(pair, pair.relative_to(folder).as_posix(), above=above) for pair in pairs]
    return [
        PairTask(
            pair, pair.relative_to(folder).as_posix(), to / f".{number}", above, draft,
            made_from="" if draft else source_digest(pair, above),
        )
        for number, pair in enumerate(pairs)
    ]  # fmt: skip


def _reviews(
    tasks: Sequence[PairTask], published: Mapping[str, tuple[CardEntry, Path]], jobs: int, progress: Progress
) -> list[PairReview]:
    """Result of each task: cards of the former site that need no change are copied, the others written."""
    same = {task.name: kept(task, *published[task.made_from]) for task in tasks if task.made_from in published}
    found = {name: one for name, one in same.items() if one is not None}
    if found:
        progress(f"{len(found)} of {len(tasks)} cards, unchanged")
    new = [task for task in tasks if task.name not in found]
    written = each(review, new, jobs, lambda done: progress(f"{len(found) + done} of {len(tasks)} cards"))
    found |= {one.task.name: one for one in written}
    return [found[task.name] for task in tasks]


def _problems(reviews: Sequence[PairReview]) -> tuple[PublicationProblem, ...]:
    """All problems, pair by pair."""
    found: list[PublicationProblem] = []
    first: dict[str, str] = {}
    for one in reviews:
        found += one.problems
        if one.entry is None:
            continue
        other = first.setdefault(one.entry.content_sha256, one.task.name)
        if other != one.task.name:
            words = f"same content as {other}: publish one of the two."
            found.append(PublicationProblem(one.task.name, "twice", words))
    return tuple(found)


def _templates(folder: Path, reviews: Sequence[PairReview]) -> tuple[Path, ...]:
    """Write templates of card.toml where there is none; folders without write access are skipped.

    Fields that all of several pairs lack are requested once, in the folder above; then the rest pair by pair.
    """
    asking = [one for one in reviews if one.template]
    alike = _asked_of_all(asking) if len(asking) > 1 and all(one.task.folder != folder for one in reviews) else []
    if alike:
        wanted = {folder / TOML: shared_template(len(asking), alike)}
    else:
        wanted = {one.task.folder / TOML: one.template for one in asking}
    written = []
    for path, text in wanted.items():
        if not os.path.lexists(path):
            with suppress(OSError):
                write_whole(path, text.encode())
                written.append(path)
    return tuple(written)


def _asked_of_all(asking: Sequence[PairReview]) -> list[str]:
    """Fields that all of these lack; the ISO group belongs to the material of each pair."""
    each = [{name for problem in one.problems for name in problem.fields} for one in asking]
    return [name for name in QUESTIONS if name != "iso513" and all(name in fields for fields in each)]


def _shown(reviews: Sequence[PairReview]) -> list[PairReview]:
    """Reviews with a card, the first of each content: a draft may hold two of the same."""
    first: dict[str, PairReview] = {}
    for one in reviews:
        if one.entry is not None:
            first.setdefault(one.entry.content_sha256, one)
    return list(first.values())


def _ordered(reviews: Sequence[PairReview]) -> list[CardEntry]:
    named = with_slugs([one.entry for one in _shown(reviews) if one.entry is not None])
    return sorted(named, key=lambda e: (e.title.casefold(), e.slug))


def _fill(made: Path, reviews: Sequence[PairReview], title: str, *, draft: bool) -> list[CardEntry]:
    """Name the folder of every card by its slug, and write the pages, the feed and the list."""
    entries = _ordered(reviews)
    slugs = {e.content_sha256: e.slug for e in entries}
    shown = _shown(reviews)
    for one in shown:
        if one.entry is not None and one.task.to is not None:
            one.task.to.rename(made / "cards" / slugs[one.entry.content_sha256])
    pages = {
        "index.html": index_page(entries, title, draft=draft, left_out=_left_out(reviews, shown)).encode(),
        "compare.html": compare_page(entries, title, draft=draft).encode(),
        "atom.xml": atom_feed(entries, title, draft=draft),
        "cards.json": card_list(entries, title, draft=draft),
    }
    for name, content in pages.items():
        (made / name).write_bytes(content)
    return entries


def _left_out(reviews: Sequence[PairReview], shown: Sequence[PairReview]) -> list[tuple[str, str]]:
    """Pairs without a card, and the reason; the folder of the second of the same content is removed."""
    named = {one.task.name for one in shown}
    for one in reviews:
        if one.task.name not in named and one.entry is not None and one.task.to is not None:
            rmtree(one.task.to)
    return [(problem.folder, problem.words) for problem in _problems(reviews) if problem.folder not in named]


def _check_replaced(site: Path, *, force: bool, draft: bool) -> None:
    """Refuse to replace a published site by a draft, or without ``force``."""
    if draft:
        raise UsageError(f"{site}: holds a published site, which a draft does not replace; choose another --site.")
    if not force:
        raise UsageError(f"{site}: holds another site; replace it with --force, or choose another --site.")


def _put(made: Path, site: Path, former: FolderState, force: bool, *, draft: bool) -> bool:
    """Put the site into its place; True if the same site existed already."""
    held = [name for name in NAMES if (site / name).exists()]
    if held and same(made, site):
        return True
    if held and not is_draft(site):
        _check_replaced(site, force=force, draft=draft)
    put_folder(made, site, expected=former, ours=is_ours)
    return False
