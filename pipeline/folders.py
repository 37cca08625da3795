"""One folder for each pair of an analysis: an unchanged result stays, a former reading of the same file is replaced."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import cards, parameters
from ..cards.folder import folder_names
from ..core.bounded import has_content
from ..core.errors import ParameterError, UsageError
from ..core.files import cause
from ..core.folders import FolderState, folder_state
from ..core.journal import recover_below
from ..core.version import __version__
from ..datasets import Runs
from ..parameters.file import seal_fault
from .options import OF_READING, FitOptions
from .pair import PairAnalysis

# Sections that the main job does not write: what added them would be lost.
LATER = ("dynamics", "drive", "pi", "load_line", "limits", "costs", "roughness", "adaptive_force")


@dataclass(frozen=True, slots=True)
class Folder:
    """Folder of a pair, and what it already contains.

    Attributes
    ----------
    path : Path
    unchanged : bool
        Whether it already contains this result.
    former : bool
        Whether it holds a former reading of the same file, which is replaced as a whole.
    state : FolderState
        Its files when it was checked.
    """

    path: Path
    unchanged: bool
    former: bool = False
    state: FolderState = field(default_factory=dict)

    def write(self, pair: PairAnalysis, options: FitOptions, *, force: bool = False) -> Path:
        """Write parameter file, cards, figures and draws, all of them or none.

        Raises
        ------
        UsageError
            Another process has written to the folder since it was checked.
        """
        if pair.parameters is not None and not self.unchanged:
            cards.write(
                pair.parameters, self.path, laws=pair.laws, posteriors=pair.posteriors, former=self.state,
                posterior_figures=options.posterior_figures, force=force or self.former, whole=self.former,
            )  # fmt: skip
        return self.path


def pair_folders(
    pairs: Sequence[Runs], root: str | os.PathLike[str], options: FitOptions, *, force: bool = False
) -> tuple[Folder, ...]:
    """Folders of pairs below ``root``; nothing is written.

    The folder of a former reading of the same file, with other options of reading and the same of fitting, is
    replaced; everything in it must be as fitmodels wrote it.

    Raises
    ------
    UsageError
        A folder contains a different result, and ``force`` is not given.
    """
    root = Path(root)
    if root.exists() and not root.is_dir():
        raise UsageError(f"{root} is a file; choose a folder with --out.")
    recover_below(root)
    found = []
    recorded = options.recorded()
    names = folder_names((runs.tool, runs.work) for runs in pairs)
    for runs, path in zip(pairs, (root / name for name in names), strict=True):
        state = _state(path)
        same = not force and _holds(path, runs, recorded)
        former = not (same or force) and path.is_dir() and any(path.iterdir())
        if former and (why := _not_replaceable(path, runs, recorded)):
            raise UsageError(
                f"{path} exists and contains a different result or other files ({why}); replace what fitmodels "
                "wrote there with --force, or write elsewhere with --out."
            )
        found.append(Folder(path, same, former, state))
    return tuple(found)


def _state(path: Path) -> FolderState:
    try:
        return folder_state(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {cause(error)}; choose another place with --out.") from None


def left_folders(root: str | os.PathLike[str], runs: Runs, written: Iterable[Path]) -> tuple[Path, ...]:
    """Folders below ``root`` with results of the same file that this analysis did not write: of a former reading."""
    root, kept = Path(root), set(written)
    if not (runs.source.sha256 and root.is_dir()):
        return ()
    others = (path for path in sorted(root.iterdir()) if path not in kept and (path / "params.json").is_file())
    return tuple(path for path in others if _source(path) == (runs.source.sha256, runs.source.name))


def _source(folder: Path) -> tuple[str | None, str | None]:
    try:
        p = parameters.read(folder / "params.json").provenance
    except ParameterError:
        return None, None
    return p.data_sha256, p.data_file


def _holds(folder: Path, runs: Runs, recorded: Mapping[str, Any]) -> bool:
    """Whether a folder holds the fit of these data by this version with these options, its checksums valid."""
    try:
        pf = parameters.read(folder / "params.json")
        parameters.read_draws(pf, folder)
    except ParameterError:
        return False
    if seal_fault(pf) or not all((folder / name).is_file() for name in cards.files(pf)):
        return False
    p = pf.provenance
    made = (p.data_sha256, p.fitmodels, p.options, p.data_file)
    return made == (runs.source.sha256, __version__, dict(recorded), runs.source.name)


def _not_replaceable(folder: Path, runs: Runs, recorded: Mapping[str, Any]) -> str:
    """Reason why a folder is not the untouched result of a former reading of the same file; empty where it is."""
    try:
        pf = parameters.read(folder / "params.json")
    except ParameterError:
        return "it has no parameter file that can be read"
    if fault := _fault(pf, folder):
        return fault
    p = pf.provenance
    if not runs.source.sha256 or (p.data_sha256, p.data_file) != (runs.source.sha256, runs.source.name):
        return f"it was made from {p.data_file or 'another file'}{_changed_file(p.data_file, runs)}"
    then, now = ({k: v for k, v in of.items() if k not in OF_READING} for of in (p.options, recorded))
    if then != now or dict(p.options) == dict(recorded):
        return f"by fitmodels {p.fitmodels}" if then == now else "fitted with other options"
    if p.then or pf.model_extra or any(getattr(pf, name) is not None for name in LATER):
        return "sections were added to its parameter file later"
    return _edited(folder, pf)


def _fault(pf: "parameters.ParameterFile", folder: Path) -> str:
    """The checksum of a result that is not valid; empty where all are."""
    if fault := seal_fault(pf):
        return f"params.json: {fault}"
    try:
        parameters.read_draws(pf, folder)
    except ParameterError as refused:
        return str(refused).rstrip(".")
    return ""


def _changed_file(name: str | None, runs: Runs) -> str:
    return " before that file was changed" if name == runs.source.name else ""


def _edited(folder: Path, pf: "parameters.ParameterFile") -> str:
    """The file of a result that is not as fitmodels writes it; empty where all are."""
    from ..cards.content.card import compose
    from ..cards.folder import card_files
    from ..parameters.file import as_bytes

    ours = set(cards.files(pf))
    drawn = "figures/posterior_" if pf.provenance.options.get("posterior_figures") else None
    for name in folder_state(folder):
        if name not in ours and not (drawn and name.startswith(drawn) and name.endswith(".png")):
            return f"{name} is not a file of fitmodels"
    texts = card_files(compose(pf, folder=folder), pf)
    if not has_content(folder / "params.json", as_bytes(pf)):
        return "params.json was edited, or written by another version"
    edited = [name for name, text in texts.items() if not has_content(folder / name, text)]
    return f"{edited[0]} was edited, or written by another version" if edited else ""
