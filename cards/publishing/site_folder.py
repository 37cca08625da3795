"""The folder of a site: which of its files are ours, what it lists, whether it is a draft."""

import filecmp
import os
from pathlib import Path
from typing import Any

from ...core.bounded import stored_json
from ...core.errors import UsageError

SCHEMA = "fitmodels.site/3"
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
