"""The folder of a site: which of its files are ours, what it lists, whether it is a draft, which cards are intact."""

import filecmp
import hashlib
import os
from pathlib import Path
from typing import Any

from ...core.bounded import read_bounded, stored_json
from ...core.errors import DataError, UsageError
from .entries import CardEntry

SCHEMA = "fitmodels.site/5"
LIST = "cards.json"
NAMES = ("index.html", "compare.html", "atom.xml", LIST, "cards")


def refuse(site: Path, folder: Path) -> None:
    """UsageError where no site of ours may be put.

    A folder that holds one of our names and no list of ours was written by somebody else: not even ``--force``
    replaces it.
    """
    if site.exists() and not site.is_dir():
        raise UsageError(f"{site}: is a file; choose a folder with --site.")
    here, real = (Path(os.path.realpath(place)) for place in (site, folder))
    if real == here or here / "cards" in (real, *real.parents):
        raise UsageError(f"{site}: the site would be inside the folder of its pairs; choose another --site.")
    held = [name for name in NAMES if (site / name).exists()]
    if held and not is_site(site):
        if LIST in held:
            raise UsageError(
                f"{site / LIST}: is damaged, or is not of fitmodels publish, so {site} is not replaced. Remove the "
                "folder if it is a site of fitmodels, or choose another one with --site."
            )
        raise UsageError(
            f"{site}: holds {held[0]} that fitmodels publish did not write; choose another folder with --site."
        )


def is_site(site: Path) -> bool:
    """Whether the folder holds a site that ``publish`` wrote."""
    return str(_listed(site).get("schema")).startswith(SCHEMA[:-1])


def is_draft(site: Path) -> bool:
    """Whether the folder holds a draft."""
    return is_site(site) and _listed(site).get("draft") is True


def published_cards(site: Path) -> dict[str, tuple[CardEntry, Path]]:
    """Cards of a published site by what they were made from: each with its folder; none of a draft.

    The entry has the slug of its tool and work, as before `with_slugs`.
    """
    listed = _listed(site)
    cards = listed.get("cards") if listed.get("schema") == SCHEMA and listed.get("draft") is False else None
    found = [_published(each, site) for each in cards] if isinstance(cards, list) else []
    return {one[0].made_from: one for one in found if one is not None and one[0].made_from}


def _published(listed: object, site: Path) -> tuple[CardEntry, Path] | None:
    """Entry and folder of a card in the list of a site; None where the list is damaged there."""
    try:
        entry = CardEntry.model_validate({k: v for k, v in dict(listed).items() if k != "href"})  # type: ignore[call-overload]
    except (TypeError, ValueError):
        return None
    if entry.slug in ("", ".", "..") or Path(entry.slug).name != entry.slug:
        return None
    ends = [f"-{entry.content_sha256[:digits]}" for digits in (8, 64)]
    end = next((end for end in ends if entry.slug.endswith(end)), "")
    return entry.model_copy(update={"slug": entry.slug.removesuffix(end)}), site / "cards" / entry.slug


def intact_files(folder: Path, hashes: dict[str, str]) -> dict[str, bytes] | None:
    """Content of the files of a card by their paths; None where one was changed, added or removed."""
    held = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if not path.is_dir()}
    if held.keys() != hashes.keys() or any(path.is_symlink() for path in held.values()):
        return None
    try:
        contents = {name: read_bounded(held[name], "output") for name in hashes}
    except (OSError, DataError):
        return None
    intact = all(hashlib.sha256(contents[name]).hexdigest() == digest for name, digest in hashes.items())
    return contents if intact else None


def _listed(site: Path) -> dict[str, Any]:
    """The list of a site; empty where there is none."""
    listed = stored_json(site / LIST)
    return listed if isinstance(listed, dict) else {}


def same(made: Path, site: Path) -> bool:
    """Whether the site is there already, byte by byte."""
    new, old = _files(made), _files(site)
    return new == old and all(filecmp.cmp(made / name, site / name, shallow=False) for name in new)


def is_ours(name: str) -> bool:
    """Whether a path within the folder of a site is one that ``publish`` writes.

    Examples
    --------
    >>> is_ours("cards/gc435/index.html"), is_ours("CNAME")
    (True, False)
    """
    return name.partition("/")[0] in NAMES


def _files(top: Path) -> list[str]:
    """Files of a site, as paths within it."""
    found = []
    for name in NAMES:
        place = top / name
        inside = sorted(place.rglob("*")) if place.is_dir() else [place]
        found += [path.relative_to(top).as_posix() for path in inside if path.is_file()]
    return found
