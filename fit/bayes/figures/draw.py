"""Pictures of a posterior: each kind is a sheet of panels, laid out here."""

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ....core.errors import UsageError
from ....datasets.runs import NOT_MEASURED
from ...draw import even
from .curves import curves
from .parameters import marginals, pairs
from .predictive import predictive
from .sheet import Sheet, alone, laid_out

if TYPE_CHECKING:
    from ..posterior import Posterior

SHEETS: dict[str, Callable[["Posterior"], Sheet]] = {
    "marginals": marginals,
    "pairs": pairs,
    "predictive": predictive,
    "curves": curves,
}


def draw(
    posterior: "Posterior", what: str = "marginals", ax: Axes | None = None, *, banner: str = ""
) -> Axes | NDArray[np.object_]:
    """Draw a posterior.

    Parameters
    ----------
    posterior : Posterior
    what : {"marginals", "pairs", "predictive", "curves"}
        Each parameter with its prior; each pair of parameters; rows of each edge in the band of a row of a new edge;
        the law along each factor, the others at the middle of their range and the rows moved there along the law.
    ax : Axes, optional
        To draw on, where there is one panel: curves of one factor, or the predictive of rows without edges.
    banner : str
        Written over the picture, for instance ``not measured``; left out, what the notes say of a simulation.

    Returns
    -------
    Axes, or ndarray of Axes in reading order where there are several; their ``figure`` saves.

    Raises
    ------
    UsageError
        A picture that there is not, or several panels for one ``ax``.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> [ax.get_xlabel() for ax in draw(fit.posterior(law), "curves")]
    ['V [m/min]', 'f [mm/rev]', 'd [mm]', 't [min]']
    """
    if what not in SHEETS:
        near = get_close_matches(str(what), SHEETS, 1, 0.5)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UsageError(f"no picture {what!r} of a posterior: there are {', '.join(SHEETS)}.{hint}")
    sheet = SHEETS[what](replace(posterior, draws=posterior.draws[even(len(posterior.draws))]))
    if ax is not None and len(sheet.panels) > 1:
        n = sum(panel is not None for panel in sheet.panels)
        raise UsageError(f"{what} of {posterior.response} are {n} panels and ax is one: leave ax out, and take theirs.")
    text = banner or _not_measured(posterior)
    axes = laid_out(sheet, text) if ax is None else alone(sheet, text, ax)
    return axes if len(axes) > 1 else axes[0]


def _not_measured(posterior: "Posterior") -> str:
    """What the notes say of data that were not measured, in short."""
    notes = (*posterior.law.notes, *posterior.notes)
    return next((note.split(";")[0] for note in notes if any(word in note.lower() for word in NOT_MEASURED)), "")
