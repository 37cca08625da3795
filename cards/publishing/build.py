"""A site of many cards: all judged first, then written whole or not at all."""

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...core.errors import UsageError
from ...core.files import staged, write_whole
from .entries import CardEntry, with_slugs
from .feeds import atom_feed, card_list
from .pages import compare_page, index_page
from .pair import TOML, PairReview, PairTask, PublicationProblem, look, pair_folders
from .pool import each
from .requirements import QUESTIONS, shared_template
from .site_folder import NAMES, put, refuse, same

TITLE = "Model cards of tools and work materials"
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class PublicationReport:
    """What was found, and what was written.

    Attributes
    ----------
    cards : tuple of Entry
        Of the site, in its order; empty where something stands against it.
    problems : tuple of Problem
        All of them, in the order of the folders.
    templates : tuple of Path
        ``card.toml`` written to be filled in.
    site : Path or None
        Where the site stands; None where none was written.
    unchanged : bool
        The very same site was there already.
    found : int
        Pairs in the folder.
    """

    cards: tuple[CardEntry, ...] = ()
    problems: tuple[PublicationProblem, ...] = ()
    templates: tuple[Path, ...] = ()
    site: Path | None = None
    unchanged: bool = False
    found: int = 0

    @property
    def ok(self) -> bool:
        """Whether nothing stands against publishing."""
        return not self.problems

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "found": self.found,
            "site": None if self.site is None else str(self.site),
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
    told: Progress = lambda words: None,
) -> PublicationReport:
    """Write the static site of all pairs in a folder: index, comparison, a folder a card, feed and list.

    Everything is made in a hidden folder beside the site first: a failure or an interrupt leaves the old site as it
    was. Of what stands in ``site`` only the names of a site are replaced, its folder ``cards`` as a whole.

    Parameters
    ----------
    folder : path
        Holds folders with ``params.json``, at any depth; ``card.toml`` beside it adds to the card, one in ``folder``
        itself to the cards of all.
    site : path
        Where the site goes.
    title : str
        Of the site; its feed is known by it.
    jobs : int
        Processes; the bytes do not depend on it.
    force : bool
        Replace another site of ours.
    told : callable
        Hears how far it is.

    Returns
    -------
    Report
        With ``problems`` where something stands against publishing: nothing is written then but a ``card.toml`` to be
        filled in: one in ``folder`` for what none of several pairs tells, or one beside each file that needs it.

    Raises
    ------
    UsageError
        The folder is missing, the site stands already and ``force`` is not given, or it cannot be written.
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
    refuse(site, folder)
    try:
        with staged(site.absolute().parent) as hidden:
            made = hidden / "made"
            made.mkdir()
            looked = _look(folder, pairs, jobs, told, made / "cards")
            problems = _against(looked)
            if problems:
                return PublicationReport(problems=problems, templates=_templates(folder, looked), found=len(pairs))
            entries = _fill(made, looked, title)
            unchanged = _put(made, site, hidden, force)
    except OSError as error:
        raise UsageError(
            f"{site}: the site cannot be written: {error.strerror or error}; choose another place with --site."
        ) from None
    return PublicationReport(cards=tuple(entries), site=site, unchanged=unchanged, found=len(pairs))


def check(
    folder: str | os.PathLike[str],
    site: str | os.PathLike[str] | None = None,
    *,
    jobs: int = 1,
    told: Progress = lambda words: None,
) -> PublicationReport:
    """Judge all pairs in a folder as ``publish`` does, and write no site."""
    folder, site = Path(folder), None if site is None else Path(site)
    pairs = pair_folders(folder, site)
    looked = _look(folder, pairs, jobs, told)
    problems = _against(looked)
    entries = () if problems else tuple(_ordered(looked))
    return PublicationReport(entries, problems, _templates(folder, looked), found=len(pairs))


def _look(folder: Path, pairs: Sequence[Path], jobs: int, told: Progress, to: Path | None = None) -> list[PairReview]:
    shared = folder / TOML
    above = shared if os.path.lexists(shared) and folder not in pairs else None
    tasks = [
        PairTask(pair, pair.relative_to(folder).as_posix(), None if to is None else to / f".{number}", above)
        for number, pair in enumerate(pairs)
    ]
    return each(look, tasks, jobs, lambda done: told(f"{done} of {len(tasks)} cards"))


def _against(looked: Sequence[PairReview]) -> tuple[PublicationProblem, ...]:
    """Everything that stands against them, pair by pair."""
    found: list[PublicationProblem] = []
    first: dict[str, str] = {}
    for one in looked:
        found += one.problems
        if one.entry is None:
            continue
        other = first.setdefault(one.entry.content_sha256, one.task.name)
        if other != one.task.name:
            words = f"Its content is that of {other}: publish one of the two."
            found.append(PublicationProblem(one.task.name, "twice", words))
    return tuple(found)


def _templates(folder: Path, looked: Sequence[PairReview]) -> tuple[Path, ...]:
    """Write what is to be filled in, where nothing stands yet; a folder that cannot be written to goes without.

    What none of several pairs tells is asked for once, above them; only then is each asked for the rest.
    """
    asking = [one for one in looked if one.template]
    alike = _asked_of_all(asking) if len(asking) > 1 and all(one.task.folder != folder for one in looked) else []
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
    """Fields that none of these tells; the ISO group is asked beside each pair, since it is that of its material."""
    each = [{name for problem in one.problems for name in problem.fields} for one in asking]
    return [name for name in QUESTIONS if name != "iso513" and all(name in fields for fields in each)]


def _ordered(looked: Sequence[PairReview]) -> list[CardEntry]:
    named = with_slugs([one.entry for one in looked if one.entry is not None])
    return sorted(named, key=lambda e: (e.title.casefold(), e.slug))


def _fill(made: Path, looked: Sequence[PairReview], title: str) -> list[CardEntry]:
    """Give every card the folder of its slug, and write what stands around them."""
    entries = _ordered(looked)
    slugs = {e.content_sha256: e.slug for e in entries}
    for one in looked:
        if one.entry is not None and one.task.to is not None:
            one.task.to.rename(made / "cards" / slugs[one.entry.content_sha256])
    pages = {
        "index.html": index_page(entries, title).encode(),
        "compare.html": compare_page(entries, title).encode(),
        "atom.xml": atom_feed(entries, title),
        "cards.json": card_list(entries, title),
    }
    for name, content in pages.items():
        (made / name).write_bytes(content)
    return entries


def _put(made: Path, site: Path, hidden: Path, force: bool) -> bool:
    """Put the site in its place; whether the very same was there already."""
    held = [name for name in NAMES if (site / name).exists()]
    if held and same(made, site):
        return True
    if held and not force:
        raise UsageError(f"{site}: holds another site; replace it with --force, or choose another --site.")
    aside = hidden / "aside"
    aside.mkdir()
    put(made, site, aside)
    return False
