"""The site of all cards of a batch; fields that all cards lack are requested in one card.toml."""

import json
import os
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.bounded import read_bounded, sha256_of
from ..core.errors import DataError, UsageError
from ..core.files import write_whole
from ..core.progress import Meter
from .records import PAIRS, read_json

if TYPE_CHECKING:
    from ..cards.publishing import PublicationReport

SITE = "site"
TOML = "card.toml"
STAMP = Path(".batch", "site.json")


def check_card(card: str | os.PathLike[str]) -> None:
    """Reject an invalid card.toml before anything is fitted.

    Raises
    ------
    UsageError, DataError
        There is no such file; it is no TOML, or a key of it is not known.
    """
    from ..cards.publishing.card_toml import read_toml

    if not Path(card).is_file():
        raise UsageError(f"{card}: there is no such file; --card names a card.toml that holds for all pairs.")
    read_toml(card)


def site_of(
    out: Path, card: str | os.PathLike[str] | None, title: str | None, jobs: int, meter: Meter, keys: Sequence[str]
) -> "PublicationReport | None":
    """Publish the cards in ``out``, unless the site of these very blocks exists already.

    None where no pair has a parameter file. A ``card.toml`` template belongs to the user from then on: no batch
    removes it.
    """
    from ..cards.publishing import TITLE, PublicationReport, publish

    pairs, title = out / PAIRS, TITLE if title is None else title
    if not any(pairs.glob("*/params.json")):
        return None
    before = read_json(out / STAMP)
    stamp = {"card": before.get("card")}
    if card is not None:
        stamp["card"] = _copied(Path(card), pairs / TOML, stamp["card"])
    stamp["of"] = _digest(pairs, title, keys)
    if before.get("of") == stamp["of"] and (out / SITE / "cards.json").is_file():
        return PublicationReport(site=out / SITE, unchanged=True, found=sum(1 for _ in pairs.glob("*/params.json")))
    report = publish(pairs, out / SITE, title=title, jobs=jobs, force=True, progress=meter.say)
    published = report.ok and report.site is not None
    write_whole(out / STAMP, json.dumps(stamp if published else {**stamp, "of": None}).encode(), parents=True)
    return report


def _copied(card: Path, to: Path, before: str | None) -> str:
    """Copy ``--card`` into the folder of the pairs, unless another is filled in there; its SHA-256."""
    content = read_bounded(card, "card")
    new = sha256(content).hexdigest()
    if to.is_file() and sha256_of(to) not in (new, before) and _is_filled(to):
        raise UsageError(f"{to} differs from --card {card}; leave --card out to use it, or remove it.")
    write_whole(to, content, parents=True)
    return new


def _is_filled(path: Path) -> bool:
    """Whether a card.toml has any value, unlike a template; also a file that cannot be read."""
    from ..cards.publishing.card_toml import PublicationMetadata, read_toml

    try:
        return read_toml(path) != PublicationMetadata(name=str(path))
    except DataError:
        return True


def _digest(pairs: Path, title: str, keys: Sequence[str]) -> str:
    """SHA-256 of what the site depends on: the blocks, every card.toml, the title."""
    made = sha256("\n".join([title, *keys]).encode())
    for path in sorted([pairs / TOML, *pairs.glob(f"*/{TOML}")]):
        if path.is_file():
            made.update(path.relative_to(pairs).as_posix().encode() + read_bounded(path, "card"))
    return made.hexdigest()
