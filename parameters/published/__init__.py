"""Parameter files of what the five papers print, so that their controllers can be replayed: one paper a file.

A number here is the paper's own unless its section's notes call it a reconstruction or an assumption.

>>> from fitmodels.parameters.published import PAPERS
>>> sorted(PAPERS)
['AC-2016', 'AC-2017', 'CLM-2023', 'CLM-2023-slot', 'LYAP', 'SURF']
"""

from importlib import import_module
from typing import TYPE_CHECKING

from ...core.errors import UsageError
from ...core.verdict import LEVELS, RESERVATIONS

if TYPE_CHECKING:
    from ..file import ParameterFile

# name -> (module of this package, its function)
PAPERS = {
    "AC-2016": ("turning", "ac2016"),
    "AC-2017": ("turning", "ac2017"),
    "CLM-2023": ("milling", "end_milling"),
    "CLM-2023-slot": ("milling", "slot_milling"),
    "SURF": ("roughness", "surf"),
    "LYAP": ("force", "lyap"),
}


def unchecked(lacking: str, *reasons: str, level: int = RESERVATIONS) -> dict[str, object]:
    """Verdict of what a paper prints or what was worked out from it; ``lacking`` is why nothing could be checked."""
    found = (*reasons, f"It was not checked: {lacking}.")
    return {"level": LEVELS[level], "reasons": found, "not_checked": (f"All checks: {lacking}",)}


def published(name: str) -> "ParameterFile":
    """The parameter file of a paper.

    Parameters
    ----------
    name : str
        ``AC-2016``, ``AC-2017``, ``CLM-2023`` (end milling), ``CLM-2023-slot``, ``SURF`` or ``LYAP``.

    Raises
    ------
    UsageError
        There is no such paper.
    """
    if name not in PAPERS:
        raise UsageError(f"published {name!r}: there are {', '.join(PAPERS)}.")
    module, function = PAPERS[name]
    made: ParameterFile = getattr(import_module(f".{module}", __name__), function)()
    return made
