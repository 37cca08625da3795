"""A model repository in the layout of the Hugging Face hub: made of one pair, written to a folder, uploaded."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from shlex import quote
from types import ModuleType
from typing import Any

from ...core.bounded import has_content, read_bounded
from ...core.errors import DataError, FitmodelsError, GateError, UsageError
from ...core.files import cause
from ...core.folders import folder_state, put_folder, staged
from ...core.journal import recover
from ...core.suggestions import closest
from ...parameters import ParameterFile
from ..content.card import Card
from ..folder import DRAWS, PARAMETERS, PROGRAM, README
from ..forms.front_matter import HUB_LICENSES, hub_metadata, yaml_text
from .pair import contents, pair_folders, read_pair, shared_toml, unreplaced
from .requirements import check_publication

NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,94}[A-Za-z0-9])?")
LICENSE, DATA, ENDINGS = "LICENSE", "data", (".git", ".ipynb")
HUB = "https://huggingface.co"
INSTALL = "pip install 'fitmodels[hub]'"
EXAMPLE = re.compile(r"@example\.(org|com|net)$")  # reserved by RFC 2606
SIMULATED = " (simulated, not measured)"
LIBRARY = "fitmodels"  # library_name of the front matter: marks a repository as ours
USE = """
## Download

    from fitmodels import parameters
    from huggingface_hub import hf_hub_download

    pf = parameters.read(hf_hub_download("{name}", "params.json"))
"""


@dataclass(frozen=True, slots=True)
class HubRepository:
    """Content of a model repository.

    Attributes
    ----------
    name : str
        ``ORG/NAME``.
    title : str
        Title of the card.
    simulated : bool
        Whether its numbers come from a simulation.
    files : dict
        Path in the repository -> content.
    metadata : dict
        Front matter of README.md.
    remarks : tuple of str
        What to know before the files are public.
    obstacles : tuple of str
        Why the repository must not be uploaded.
    """

    name: str
    title: str
    simulated: bool
    files: Mapping[str, bytes]
    metadata: Mapping[str, Any]
    remarks: tuple[str, ...] = ()
    obstacles: tuple[str, ...] = ()

    @property
    def sizes(self) -> dict[str, int]:
        """Path -> size in bytes."""
        return {name: len(content) for name, content in self.files.items()}

    @property
    def message(self) -> str:
        """Message of the commit."""
        return f"{'Simulated: ' if self.simulated else ''}Parameters and model card of {self.title}"

    def facts(self) -> dict[str, Any]:
        """The repository for programs, without its contents."""
        said = {"remarks": self.remarks, "obstacles": self.obstacles}
        return {"repository": self.name, "simulated": self.simulated, "files": self.sizes, **said}


def hub_repository(folder: Path, name: str, data: Path | None = None) -> HubRepository:
    """The model repository of the only pair in a folder.

    Parameters
    ----------
    folder : Path
        Holds one ``params.json``, with ``card.toml`` and ``LICENSE``, if any, next to it.
    name : str
        ``ORG/NAME`` on the hub.
    data : Path, optional
        The data file that was fitted; without it no data file is in the repository.

    Raises
    ------
    UsageError
        The name is not valid on the hub, or the folder holds several pairs.
    GateError
        The card must not be published.
    DataError
        ``data`` is not the file that was fitted.
    """
    check_name(name)
    pairs = pair_folders(folder)
    if len(pairs) > 1:
        names = ", ".join(str(pair) for pair in pairs[:3]) + (", ..." if len(pairs) > 3 else "")
        raise UsageError(f"{folder}: holds {len(pairs)} pairs, a repository holds one; give one of {names}.")
    return unreplaced(pairs[0], lambda: _repository(folder, pairs[0], name, data))


def _repository(folder: Path, pair: Path, name: str, data: Path | None) -> HubRepository:
    pf, whole, card = read_pair(pair, above=shared_toml(folder, [pair]))
    if not check_publication(card, pf, pair).ok:
        raise GateError(f"{pair}: cannot be published; the reasons: fitmodels publish {quote(str(folder))} --check.")
    metadata = _metadata(card)
    files = {path: content for path, content in contents(pair, whole, card).items() if path != "index.html"}
    files[README] = _readme(files[README], metadata, name)
    files[LICENSE] = _license(card, pair)
    if data is not None:
        files[f"{DATA}/{data.name}"] = _data(data, card)
    order = [README, LICENSE, PARAMETERS, PROGRAM]
    ordered = {path: files[path] for path in [*order, *sorted(set(files) - set(order))]}
    simulated = bool(card.identity.simulated)
    remarks, obstacles = tuple(_remarks(whole, data)), tuple(_obstacles(card, pair))
    return HubRepository(name, card.title, simulated, ordered, metadata, remarks, obstacles)


def check_name(name: str) -> None:
    """Reject a name that the hub does not accept.

    Raises
    ------
    UsageError

    Examples
    --------
    >>> check_name("my-lab/gc435-709m40")
    """
    parts = name.split("/")
    odd = "--" in name or ".." in name or name.endswith(ENDINGS)
    if len(parts) != 2 or odd or not all(NAME.fullmatch(part) for part in parts):
        raise UsageError(
            f"--to-hub {name}: should be ORG/NAME, each at most 96 letters without accents, digits, '-', '_' and '.', "
            "for example my-lab/gc435-709m40."
        )


def _metadata(card: Card) -> dict[str, Any]:
    """Front matter for the hub: a data file is not a dataset there, and another licence is linked."""
    head = {key: value for key, value in hub_metadata(card).items() if key != "datasets" and value not in ([], "")}
    more: dict[str, Any] = {"license_link": LICENSE} if head["license"] == "other" else {}
    if card.laws:
        more["pipeline_tag"] = "tabular-regression"
    if card.identity.simulated:  # the hub shows these names next to the figures
        for one in head.get("model-index", []):
            one["name"] += SIMULATED
            for result in one["results"]:
                result["dataset"]["name"] += SIMULATED
    return {**head, **more, "library_name": LIBRARY}


def _readme(readme: bytes, metadata: Mapping[str, Any], name: str) -> bytes:
    _, _, body = readme.decode().split("---\n", 2)
    return f"---\n{yaml_text(metadata)}---\n{body.rstrip()}\n{USE.format(name=name)}".encode()


def _license(card: Card, pair: Path) -> bytes:
    """The file LICENSE of the pair, or a notice that names the licence."""
    given = _license_file(pair)
    if given is not None:
        return read_bounded(given, "text")
    spdx, year = card.publication.license, card.provenance.created[:4]
    holders = "; ".join(card.publication.authors)
    return (
        f"SPDX-License-Identifier: {spdx}\n\nCopyright (c) {f'{year} ' if year else ''}{holders}\n\n"
        f"The parameter file, the model card and its figures are licensed under {spdx}.\n"
        f"Text of the licence: https://spdx.org/licenses/{spdx}.html\n"
    ).encode()


def _license_file(pair: Path) -> Path | None:
    return next((pair / name for name in (LICENSE, "LICENSE.txt", "LICENSE.md") if (pair / name).is_file()), None)


def _obstacles(card: Card, pair: Path) -> Iterator[str]:
    """A licence without a text, and the contact of the template."""
    spdx, contact = card.publication.license, card.publication.contact
    if hub_metadata(card)["license"] not in HUB_LICENSES and _license_file(pair) is None:
        near = closest(spdx.lower(), sorted(HUB_LICENSES))
        hint = f" (did you mean {near}?)" if near else ""
        yield f"the hub does not know license {spdx}{hint}; correct card.toml, or put its text into {pair / LICENSE}."
    if EXAMPLE.search(contact):
        yield f"contact {contact} is the address of an example; put yours into card.toml."


def _data(path: Path, card: Card) -> bytes:
    try:
        content = read_bounded(path, "measurements")
    except OSError as error:
        raise DataError(f"--data {path}: cannot be read: {cause(error)}.") from None
    if sha256(content).hexdigest() != card.provenance.data_sha256:
        raise DataError(
            f"--data {path}: is not the file that was fitted, {card.provenance.data_file or 'unnamed'} (their SHA-256 "
            "differ); give that one, or leave --data out."
        )
    return content


def _remarks(pf: ParameterFile, data: Path | None) -> Iterator[str]:
    if data is None:
        yield f"The data file {pf.provenance.data_file or ''} is not among them; --data FILE adds it."
    if pf.identity.simulated:
        yield "Simulated, not measured: README.md, its tags and the commit say so."
    typed = (pf.provenance.command or "", *pf.provenance.then)
    if any(re.search(r"(^|[\s'\"=])(/|~|[A-Za-z]:\\)", command) for command in typed):
        yield f"{PARAMETERS} holds the command as typed, with a path of this computer: {typed[0]}"


def validated(repository: HubRepository) -> str:
    """Version of huggingface_hub after its check of the front matter; empty where it is not installed.

    Raises
    ------
    FitmodelsError
        It rejects the front matter, or reads other values than were written.
    """
    hub = _library()
    if hub is None:
        return ""
    try:
        read = hub.ModelCard(repository.files[README].decode()).data.to_dict()
    except ValueError as error:
        raise FitmodelsError(f"README.md: huggingface_hub rejects its front matter: {first_line(error)}.") from None
    wrong = [key for key, value in repository.metadata.items() if value is not None and read.get(key) != value]
    if wrong:
        names = ", ".join(wrong)
        raise FitmodelsError(f"README.md: huggingface_hub reads other values of {names} than written; edit card.toml.")
    return str(hub.__version__)


def endpoint() -> str:
    """Address of the hub, from ``HF_ENDPOINT`` as huggingface_hub reads it."""
    hub = _library()
    return HUB if hub is None else str(hub.constants.ENDPOINT)


def has_library() -> bool:
    """Whether huggingface_hub is installed."""
    return _library() is not None


def _library() -> ModuleType | None:
    try:
        return import_module("huggingface_hub")
    except ImportError:
        return None


def write_repository(repository: HubRepository, out: Path) -> bool:
    """Write the repository to a folder, over a former one of ours; False where the same files are there already.

    Raises
    ------
    UsageError
        The folder holds other files, or cannot be written.
    """
    recover(out)
    former = folder_state(out)
    there = _files(out)
    if there == sorted(repository.files) and all(has_content(out / name, repository.files[name]) for name in there):
        return False
    foreign = sorted(path for path in there if not is_ours(path) and path not in repository.files)
    if foreign:
        raise UsageError(f"{out}: holds {foreign[0]}, which is no file of a model repository; choose another --out.")
    try:
        with staged(out) as made:
            for path, content in repository.files.items():
                (made / path).parent.mkdir(parents=True, exist_ok=True)
                (made / path).write_bytes(content)
            put_folder(made, out, expected=former, ours=lambda name: True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written: {cause(error)}; choose another --out.") from None
    return True


def _files(out: Path) -> list[str]:
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; choose a folder with --out.")
    return sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())


def is_ours(path: str) -> bool:
    """Whether a repository of ours may hold a file of this name."""
    return path in (README, LICENSE, PARAMETERS, PROGRAM, DRAWS) or path.startswith(("figures/", f"{DATA}/"))


def first_line(error: object) -> str:
    """The first line of a message, without its full stop."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[0].rstrip(".")
