"""The folder of a pair: parameter file, card and figures, all of them or none."""

import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ..datasets.errors import UsageError
from ..fit import LawFit
from ..parameters import ParameterFile
from ..parameters import write as write_parameters
from .card import write_card

FILES = (
    "params.json",
    "README.md",
    "figures/response_surfaces.png",
    "figures/observed_predicted.png",
    "figures/residuals.png",
)


def write(
    pf: ParameterFile,
    folder: str | os.PathLike[str],
    *,
    laws: Sequence[LawFit] = (),
    data_lines: Sequence[str] = (),
    force: bool = False,
) -> Path:
    """Write ``params.json``, the card ``README.md`` and, where ``laws`` are given, the figures.

    Everything is made in a hidden folder beside the target first, so that a failure or an interrupt on the
    way leaves the target as it was. Files of other names in the folder stay.

    Parameters
    ----------
    pf : ParameterFile
    folder : path
    laws : sequence of LawFit
        The fits behind ``pf``; without them there are no figures.
    data_lines : sequence of str
        What was understood of the data, for the card.
    force : bool
        Replace files that are there.

    Raises
    ------
    UsageError
        The folder holds a result and ``force`` is not given, or it cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fitmodels import cards, parameters
    >>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
    >>> with TemporaryDirectory() as place:
    ...     sorted(path.name for path in cards.write(pf, Path(place) / "card").iterdir())
    ['README.md', 'params.json']
    """
    folder = Path(folder)
    if not force and any((folder / name).exists() for name in FILES):
        raise UsageError(
            f"{folder} holds an earlier result; replace it with --force, or write elsewhere with --out."
        )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=".fitmodels-", dir=folder.parent))
    except OSError as error:
        raise UsageError(
            f"{folder.parent} cannot be written: {error.strerror}; choose another with --out."
        ) from None
    try:
        _fill(stage, pf, laws, data_lines)
        _move(stage, folder)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    return folder


def _fill(stage: Path, pf: ParameterFile, laws: Sequence[LawFit], data_lines: Sequence[str]) -> None:
    write_parameters(pf, stage / "params.json")
    write_card(pf, stage, figures=bool(laws), data_lines=data_lines)
    if laws:
        from .figures import draw_figures

        draw_figures(laws, stage / "figures", "not measured" if pf.identity.simulated else "")


def _move(stage: Path, folder: Path) -> None:
    for path in sorted(stage.rglob("*")):
        target = folder / path.relative_to(stage)
        if path.is_dir():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        path.replace(target)
