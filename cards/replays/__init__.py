"""Reports on replays of controllers, as sentences, numbers and figures; one module per system of the papers."""

from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

# name of the system -> module of this package, with ``lacks(pf)`` and ``replayed(pf, draws, seed)``
SYSTEMS = {
    "region": "region",
    "recursion": "recursion",
    "constant-load": "constant_load",
    "roughness": "roughness",
    "adaptive-force": "adaptive_force",
}


@dataclass(frozen=True, slots=True)
class Replayed:
    """Report on the replay of one system.

    Attributes
    ----------
    system : str
        A name of `SYSTEMS`.
    title : str
        The system in a line, with its paper.
    lines : tuple of str
        Sentences, the main result first.
    assumed : tuple of str
        Assumptions where the file leaves something open, and reconstructions.
    facts : dict
        The same numbers for a program: plain JSON, each name with its unit (``life_min``, ``removed_mm3``).
    figures : dict of Figure
        By file name without extension; each is labelled as simulated.
    """

    system: str
    title: str
    lines: tuple[str, ...]
    assumed: tuple[str, ...] = ()
    facts: dict[str, object] = field(default_factory=dict)
    figures: "dict[str, Figure]" = field(default_factory=dict)


def lacks(system: str, pf: "ParameterFile") -> str:
    """Reason why a file cannot drive a system; empty where it can."""
    found: str = import_module(f".{SYSTEMS[system]}", __name__).lacks(pf)
    return found


def replayed(system: str, pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int) -> Replayed:
    """Replay a system from a file with all that it needs."""
    found: Replayed = import_module(f".{SYSTEMS[system]}", __name__).replayed(pf, draws, seed)
    return found
