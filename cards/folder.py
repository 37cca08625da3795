"""The folder of a pair: parameter file, card and figures, all of them or none."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from ..core.files import move_folder, staged
from ..parameters import ParameterFile, draws_of
from ..parameters import write as write_parameters
from .dynamics_figures import DYNAMICS_FIGURES, draw_dynamics

if TYPE_CHECKING:
    from ..fit import LawFit, Posterior
    from ..ident.identification import Identification
    from .content.parts import Card, Publication

PARAMETERS = "params.json"
DRAWS = "draws.npz"
FORMS = ("README.md", "card.json", "card.html")
FIGURES = ("figures/response_surfaces.png", "figures/observed_predicted.png", "figures/residuals.png")
FILES = (PARAMETERS, *FORMS, *FIGURES)


def files(pf: ParameterFile) -> tuple[str, ...]:
    """Names of the files of a folder: draws only where there are any, and the figures of laws or of dynamics."""
    if not pf.laws and pf.dynamics is not None:
        return (PARAMETERS, *FORMS, *DYNAMICS_FIGURES)
    drawn = pf.posterior is not None and pf.posterior.draws_file is not None
    return (PARAMETERS, DRAWS, *FORMS, *FIGURES) if drawn else FILES


def write(
    pf: ParameterFile,
    folder: str | os.PathLike[str],
    *,
    laws: "Sequence[LawFit]" = (),
    posteriors: "Sequence[Posterior]" = (),
    posterior_figures: bool = False,
    identification: "Identification | None" = None,
    data_lines: Sequence[str] = (),
    publication: "Publication | None" = None,
    force: bool = False,
) -> Path:
    """Write ``params.json``, its card in three forms, figures of ``laws`` and draws of ``posteriors``.

    The card is ``README.md`` to read, ``card.html`` to browse and ``card.json`` for programs.

    Everything is made in a hidden folder beside the target first, so that a failure or an interrupt on the
    way leaves the target as it was. Files of other names in the folder stay.

    Parameters
    ----------
    pf : ParameterFile
    folder : path
    laws : sequence of LawFit
        The fits behind ``pf``; without them there are no figures.
    posteriors : sequence of Posterior
        Those that ``pf`` was collected with; ``posterior_figures`` asks for four pictures of each.
    identification : Identification, optional
        Behind the dynamics of ``pf``, for its figures.
    data_lines : sequence of str
        What was understood of the data, for the card of a file that does not tell it.
    publication : Publication, optional
        Licence, authors and so on, for the card.
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
    ['README.md', 'card.html', 'card.json', 'params.json']
    """
    folder = Path(folder)
    if not force and any((folder / name).exists() for name in (*FILES, DRAWS, *DYNAMICS_FIGURES)):
        raise UsageError(f"{folder} holds an earlier result; replace it with --force, or write elsewhere with --out.")
    try:
        with staged(folder.parent) as stage:
            made = stage / "made"  # the stage itself is private to its user
            made.mkdir()
            write_parameters(pf, made / PARAMETERS)
            if posteriors:
                (made / DRAWS).write_bytes(draws_of(posteriors))
            _draw(made / "figures", pf, laws, posteriors if posterior_figures else (), identification)
            write_forms(pf, made, publication=publication, data_lines=data_lines)
            move_folder(made, folder)
    except OSError as error:
        raise UsageError(
            f"{folder} cannot be written: {error.strerror or error}; choose another place with --out."
        ) from None
    return folder


def write_forms(
    pf: ParameterFile,
    folder: Path,
    *,
    publication: "Publication | None" = None,
    data_lines: Sequence[str] = (),
) -> "Card":
    """Write the card in its three forms into a folder that holds its figures, over what is there."""
    from .content.compose import compose
    from .forms.together import forms

    card = _with_lines(compose(pf, publication=publication, folder=folder), data_lines)
    for name, content in forms(card, pf).items():
        (folder / name).write_bytes(content)
    return card


def _with_lines(card: "Card", data_lines: Sequence[str]) -> "Card":
    """What was understood of the data, in a card whose file does not tell its tests."""
    if card.design is not None or not data_lines:
        return card
    from .content.parts import Design

    empty = {name: why for name, why in card.empty.items() if name != "design"}
    return card.model_copy(update={"design": Design(understood=tuple(data_lines)), "empty": empty})


def _draw(
    folder: Path,
    pf: ParameterFile,
    laws: "Sequence[LawFit]",
    posteriors: "Sequence[Posterior]",
    identification: "Identification | None",
) -> None:
    banner = "not measured" if pf.identity.simulated else ""
    if identification is not None:
        draw_dynamics(identification, folder, banner)
    if laws:
        from .figures import draw_figures, draw_posteriors

        draw_figures(laws, folder, banner)
        draw_posteriors(posteriors, folder, banner)
