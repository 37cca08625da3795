"""Reports on replays of controllers, as sentences, numbers and figures; one module per system of the papers."""

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING

from ...parameters.setting_words import power_limit_words

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from ...controllers.recursion.plan import PlanOptions
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

# name of the system -> module of this package, with ``lacks(pf)`` and ``replayed(pf, draws, seed)``; those of `PLANNED`
# take ``options`` too
SYSTEMS = {
    "region": "region",
    "recursion": "recursion",
    "constant-load": "constant_load",
    "roughness": "roughness",
    "adaptive-force": "adaptive_force",
}

# name of the system -> settings of `PlanOptions` that it has, as they are typed
PLANNED = {
    "region": ("--depth", "--time", "--by", "--at"),
    "recursion": (
        "--depth", "--time", "--interval", "--grid", "--wear-state", "--factors", "--objective", "--removal", "--by",
        "--at",
    ),
}  # fmt: skip


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
        By file name without extension; labelled as simulated or calculated, and marked where the tests were simulated.
    """

    system: str
    title: str
    lines: tuple[str, ...]
    assumed: tuple[str, ...] = ()
    facts: dict[str, object] = field(default_factory=dict)
    figures: "dict[str, Figure]" = field(default_factory=dict)


def lacks(system: str, pf: "ParameterFile", options: "PlanOptions | None" = None) -> str:
    """Reason why a file cannot drive a system; empty where it can."""
    module = import_module(f".{SYSTEMS[system]}", __name__)
    found: str = module.lacks(pf, options) if system in PLANNED else module.lacks(pf)
    return found


def replayed(
    system: str, pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int, options: "PlanOptions | None" = None
) -> Replayed:
    """Replay a system from a file with all that it needs; region and recursion with these options."""
    module = import_module(f".{SYSTEMS[system]}", __name__)
    more = (options,) if system in PLANNED else ()
    found: Replayed = module.replayed(pf, draws, seed, *more)
    if system in PLANNED:
        found = replace(found, lines=(*found.lines, *power_limit_words(pf.limits, pf.laws, pf.costs)))
    if pf.identity.simulated:
        from ...core.plotting import mark_simulated

        for figure in found.figures.values():
            mark_simulated(figure, "laws not measured")
    return found
