"""The folder of a pair: its name; parameter file, card and figures, all of them or none."""

import os
import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from unicodedata import normalize

from ..core.errors import UsageError
from ..core.files import cause
from ..core.folders import FolderState, folder_state, put_folder, staged
from ..core.journal import recover
from ..parameters import ParameterFile, draws_of
from ..parameters import write as write_parameters

if TYPE_CHECKING:
    from ..fit import LawFit
    from ..fit.bayes.posterior import Posterior
    from ..ident.identification import Identification
    from ..ident.physical_models.drive import DriveFit
    from ..ident.physical_models.force_process import ForceProcess
    from ..ident.physical_models.step_response import StepFit
    from .content.card import Card
    from .content.parts import PublicationPart

    PhysicalFit = StepFit | DriveFit | ForceProcess

PARAMETERS, DRAWS = "params.json", "draws.npz"
FORMS = README, PROGRAM, PAGE = "README.md", "card.json", "card.html"
FIGURES = ("figures/response_surfaces.png", "figures/observed_predicted.png", "figures/residuals.png")
DYNAMICS_FIGURES = (
    "figures/simulated.png",
    "figures/bode.png",
    "figures/step.png",
    "figures/poles_zeros.png",
    "figures/residuals.png",
    "figures/structure.png",
)
LEFT_FIGURES = ("figures/orders.png", "figures/step_response.png")  # of former dynamics: redrawn under other names
FIT_FIGURES = {  # of physical models, by their names on the command line
    "step": "figures/step_response.png",
    "drive": "figures/drive.png",
    "force-process": "figures/force_process.png",
}
PI_FIGURE = "figures/pi.png"  # of `fitmodels tune`
FILES = (PARAMETERS, *FORMS, *FIGURES)
OURS = {*FILES, DRAWS, *DYNAMICS_FIGURES, *LEFT_FIGURES, *FIT_FIGURES.values(), PI_FIGURE}
POSTERIOR_FIGURE = re.compile(r"figures/posterior_[^/]+\.png")
LONGEST_NAME = 80  # bytes of tool and of work in a folder's name; most file systems end at 255 for both
_ODD = re.compile(r"[^\w.-]+")
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])\.", re.IGNORECASE)


def files(pf: ParameterFile) -> tuple[str, ...]:
    """Names of the files of a folder: draws only where there are any, and the figures of laws or of dynamics."""
    if not pf.laws and pf.dynamics is not None:
        return (PARAMETERS, *FORMS, *DYNAMICS_FIGURES)
    drawn = pf.posterior is not None and pf.posterior.draws_file is not None
    return (PARAMETERS, DRAWS, *FORMS, *FIGURES) if drawn else FILES


def markdown(pf: ParameterFile, *, folder: Path | None = None, publication: "PublicationPart | None" = None) -> str:
    """The card of a parameter file as README.md, schema ``fitmodels.card/8``: Markdown with YAML front matter.

    Parameters
    ----------
    pf : ParameterFile
    folder : path, optional
        Folder of the card, for the pictures in its ``figures``.
    publication : PublicationPart, optional
        Licence, authors and so on, as in ``card.toml``.

    Examples
    --------
    >>> from fitmodels import cards, parameters
    >>> "# GC435 on 709M40" in markdown(parameters.collect(tool="GC435", work="709M40"))
    True
    """
    from .content.card import compose
    from .forms.markdown import card_markdown

    return card_markdown(compose(pf, publication=publication, folder=folder))


def card_files(card: "Card", pf: ParameterFile, neighbours: Sequence[str] = ()) -> dict[str, bytes]:
    """The card in its three forms: name of each file -> its bytes.

    Parameters
    ----------
    card, pf
        The card, and the parameter file that it was composed from, for figures.
    neighbours : sequence of str
        Files in the folder of the page, in a site: the page then links to them and back to the site.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> pf = parameters.collect(tool="GC435", work="709M40", limits={"power": 7})
    >>> list(card_files(compose(pf), pf))
    ['README.md', 'card.json', 'card.html']
    """
    from .forms.card_json import as_json
    from .forms.linked_data import json_ld
    from .forms.markdown import card_markdown
    from .forms.page import page_html

    page = page_html(card, pf, json_ld=json_ld(card), neighbours=neighbours)
    return {README: card_markdown(card).encode(), PROGRAM: as_json(card).encode(), PAGE: page.encode()}


def write(
    pf: ParameterFile,
    folder: str | os.PathLike[str],
    *,
    laws: "Sequence[LawFit]" = (),
    posteriors: "Sequence[Posterior]" = (),
    posterior_figures: bool = False,
    identification: "Identification | None" = None,
    physical: "PhysicalFit | None" = None,
    data_lines: Sequence[str] = (),
    publication: "PublicationPart | None" = None,
    force: bool = False,
    whole: bool = False,
    former: FolderState | None = None,
) -> Path:
    """Write ``params.json``, its card in three forms, figures of ``laws`` and draws of ``posteriors``.

    The card is ``README.md`` to read, ``card.html`` to browse and ``card.json`` for programs.

    Everything is written to a hidden folder next to the target, which then takes the place of the target: a failure,
    an interrupt or a killed process leaves the former folder or the new one, never files of both. Files of other names
    in the folder stay.

    Parameters
    ----------
    pf : ParameterFile
    folder : path
    laws : sequence of LawFit
        The fits behind ``pf``; without them there are no figures.
    posteriors : sequence of Posterior
        Those that ``pf`` was collected with; ``posterior_figures`` adds four figures of each.
    identification : Identification, optional
        Behind the dynamics of ``pf``, for its figures.
    physical : StepFit, DriveFit or ForceProcess, optional
        Behind the dynamics, drive or adaptive force of ``pf``, for its figure.
    data_lines : sequence of str
        How the data file was read, for the card of a file without a section on its tests.
    publication : PublicationPart, optional
        Licence, authors and so on, for the card.
    force : bool
        Replace files that exist.
    whole : bool
        Replace the folder as a whole: nothing of its former content stays.
    former : FolderState, optional
        Of the folder when it was decided to write there; by default, that of now.

    Raises
    ------
    UsageError
        The folder holds a result and ``force`` is not given, another process has written there since it had the
        state ``former``, or it cannot be written.

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
    recover(folder)
    if former is None:
        former = folder_state(folder)
    if not force and any(is_ours(name) for name in former):
        raise UsageError(f"{folder} holds an earlier result; replace it with --force, or write elsewhere with --out.")
    try:
        with staged(folder) as made:
            write_parameters(pf, made / PARAMETERS)
            if posteriors:
                (made / DRAWS).write_bytes(draws_of(posteriors))
            _draw(made / "figures", pf, laws, posteriors if posterior_figures else (), identification)
            if physical is not None:
                _draw_physical(made / "figures", pf, physical)
            _write_forms(pf, made, publication, data_lines)
            kept = () if whole else _kept(pf, laws, posteriors, identification or physical)
            put_folder(made, folder, expected=former, ours=lambda name: whole or (is_ours(name) and name not in kept))
    except OSError as error:
        raise UsageError(f"{folder} cannot be written: {cause(error)}; choose another place with --out.") from None
    return folder


def _kept(pf: ParameterFile, laws: object, posteriors: object, dynamics: object) -> Collection[str]:
    """Pictures and draws of sections whose fits are not given: they stay beside a file that has these sections."""
    sections = (
        (pf.laws, laws, FIGURES),
        (pf.posterior, posteriors, (DRAWS,)),
        (pf.dynamics, dynamics, DYNAMICS_FIGURES),
        (pf.dynamics or pf.drive or pf.adaptive_force, dynamics, FIT_FIGURES.values()),
        (pf.pi, None, (PI_FIGURE,)),
    )
    return {name for there, given, names in sections if there and not given for name in names}


def is_ours(name: str) -> bool:
    """Whether a file of this name in the folder of a pair is one that fitmodels writes.

    Examples
    --------
    >>> is_ours("figures/residuals.png"), is_ours("card.toml")
    (True, False)
    """
    return name in OURS or POSTERIOR_FIGURE.fullmatch(name) is not None


def _write_forms(
    pf: ParameterFile, folder: Path, publication: "PublicationPart | None", data_lines: Sequence[str]
) -> None:
    from .content.card import compose
    from .content.parts import DesignPart

    card = compose(pf, publication=publication, folder=folder)
    if card.design is None and data_lines:
        empty = {name: why for name, why in card.empty.items() if name != "design"}
        card = card.model_copy(update={"design": DesignPart(understood=tuple(data_lines)), "empty": empty})
    for name, content in card_files(card, pf).items():
        (folder / name).write_bytes(content)


def _draw(
    folder: Path,
    pf: ParameterFile,
    laws: "Sequence[LawFit]",
    posteriors: "Sequence[Posterior]",
    identification: "Identification | None",
) -> None:
    banner = "not measured" if pf.identity.simulated else ""
    if identification is not None:
        from .figures import draw_dynamics

        draw_dynamics(identification, folder, banner)
    if laws:
        from ..core.figure_style import Limit
        from .content.figure_texts import limits_of
        from .figures import draw_figures, draw_posteriors

        draw_figures(laws, folder, banner, {name: Limit(*limit) for name, limit in limits_of(pf).items()})
        draw_posteriors(posteriors, folder, banner)


def _draw_physical(folder: Path, pf: ParameterFile, fit: "PhysicalFit") -> None:
    from .figures import draw_physical

    draw_physical(fit, folder, "not measured" if pf.identity.simulated else "")


def folder_names(pairs: Iterable[tuple[str, str]]) -> list[str]:
    """``<tool>_<work>`` for each pair; names that differ in case alone are numbered in the order of the pairs.

    A name stays inside its folder, is at most 170 bytes long and is none that Windows keeps for a device. Signs
    that letters are composed of are joined first: "Härte" is one name, however its ä is written.

    Parameters
    ----------
    pairs : iterable of (tool, work)

    Examples
    --------
    >>> folder_names([("GC435", "709M40"), ("gc435", "709m40"), ("../Härte 1", "")])
    ['GC435_709M40', 'gc435_709m40-2', 'Härte-1_unnamed']
    """
    taken: set[str] = set()
    following: dict[str, int] = {}  # the number to try next: counting from 2 each time would be quadratic
    names = []
    for tool, work in pairs:
        name = first = _folder_name(tool, work)
        key = same = _alike(first)
        number = following.get(same, 2)
        while key in taken:
            name, number = f"{first}-{number}", number + 1
            key = _alike(name)
        following[same] = number
        taken.add(key)
        names.append(name)
    return names


def _folder_name(tool: str, work: str) -> str:
    words = [_ODD.sub("-", normalize("NFC", name)).strip("-._") for name in (tool, work)]
    short = [word.encode()[:LONGEST_NAME].decode(errors="ignore").rstrip("-._") for word in words]
    name = "_".join(word or "unnamed" for word in short)
    return name.replace(".", "-", 1) if _DEVICE.match(name) else name


def _alike(name: str) -> str:
    """The same for names that a file system may take for one."""
    return normalize("NFC", name.casefold())
