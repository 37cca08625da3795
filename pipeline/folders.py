"""One folder for each pair of an analysis; a folder with the same result is left unchanged."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import cards, parameters
from ..cards.names import folder_names
from ..core.errors import ParameterError, UsageError
from ..core.version import __version__
from ..datasets import Runs
from .options import FitOptions
from .pair import PairAnalysis


@dataclass(frozen=True, slots=True)
class Folder:
    """Folder of a pair, and whether it already contains this result."""

    path: Path
    unchanged: bool

    def write(self, pair: PairAnalysis, options: FitOptions, *, force: bool = False) -> Path:
        """Write parameter file, cards, figures and draws, all of them or none."""
        if pair.parameters is not None and not self.unchanged:
            cards.write(
                pair.parameters, self.path, laws=pair.laws, posteriors=pair.posteriors,
                posterior_figures=options.posterior_figures, force=force,
            )  # fmt: skip
        return self.path


def pair_folders(
    pairs: Sequence[Runs], root: str | os.PathLike[str], options: FitOptions, *, force: bool = False
) -> tuple[Folder, ...]:
    """Folders of pairs below ``root``; nothing is written.

    Raises
    ------
    UsageError
        A folder contains a different result, and ``force`` is not given.
    """
    root = Path(root)
    if root.exists() and not root.is_dir():
        raise UsageError(f"{root} is a file; choose a folder with --out.")
    found = []
    recorded = options.recorded()
    names = folder_names((runs.tool, runs.work) for runs in pairs)
    for runs, path in zip(pairs, (root / name for name in names), strict=True):
        same = not force and _holds(path, runs, recorded)
        if not (same or force) and path.is_dir() and any(path.iterdir()):
            raise UsageError(
                f"{path} exists and contains a different result or other files; replace what fitmodels wrote there "
                "with --force, or write elsewhere with --out."
            )
        found.append(Folder(path, same))
    return tuple(found)


def _holds(folder: Path, runs: Runs, recorded: Mapping[str, Any]) -> bool:
    """Whether a folder holds the fit of these data by this version with these options."""
    try:
        pf = parameters.read(folder / "params.json")
    except ParameterError:
        return False
    if not all((folder / name).is_file() for name in cards.files(pf)):
        return False
    p = pf.provenance
    made = (p.data_sha256, p.fitmodels, p.options, p.data_file)
    return made == (runs.source.sha256, __version__, dict(recorded), runs.source.name)
