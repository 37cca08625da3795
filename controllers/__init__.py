"""Who uses it: controllers made from a parameter file alone, the plants they act on, and one loop that runs both.

    loop                     the protocols of controller and plant, replay, Trace
    sensing                  whether a reading can be believed
    faults                   plants whose sensor, sign or stiffness fails
    plants                   a cut under a feed override
    region/                  AC-2016: the visible region of V and f, its best point, its chance
    recursion/               AC-2017: the best pair minute by minute, to the end of tool life
    constant_load_milling/   CLM-2023: PI on spindle load, feed limits, tool change
    roughness/               SURF: constant roughness through constant force
    adaptive_force/          LYAP: adaptive force control, and a fixed PI beside it
    draw                     the picture of a trace

>>> from fitmodels import controllers
>>> controllers.replay.__name__
'replay'
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .adaptive_force import AdaptiveForceControl, DriveAndCut, FixedForcePi, step_study
    from .constant_load_milling import (
        ConstantLoad,
        CutModel,
        MillingCut,
        ToolRun,
        constant_feed_run,
        constant_load_run,
        drawn_life,
        mixed_run,
    )
    from .faults import FAULTS, Faulty
    from .loop import Controller, Event, Plant, Trace, replay
    from .plants import Cut
    from .recursion import (
        Life,
        LifeDraws,
        LifeLaws,
        Rules,
        TurningRecursion,
        WearingEdge,
        best_exact,
        best_fixed,
        carried_out,
        fixed_life,
        life_draws,
        life_laws,
        whole_life,
    )
    from .region import (
        Chance,
        Corner,
        Point,
        VisibleRegion,
        WearFront,
        best_point,
        feasibility,
        visible_region,
        wear_front,
    )
    from .roughness import ConstantRoughness, TurningForce, reference_force, turn
    from .sensing import Sensing

_HOME = {
    "AdaptiveForceControl": "adaptive_force",
    "Chance": "region",
    "ConstantLoad": "constant_load_milling",
    "ConstantRoughness": "roughness",
    "Controller": "loop",
    "Corner": "region",
    "Cut": "plants",
    "CutModel": "constant_load_milling",
    "DriveAndCut": "adaptive_force",
    "Event": "loop",
    "FAULTS": "faults",
    "Faulty": "faults",
    "FixedForcePi": "adaptive_force",
    "Life": "recursion",
    "LifeDraws": "recursion",
    "LifeLaws": "recursion",
    "MillingCut": "constant_load_milling",
    "Plant": "loop",
    "Point": "region",
    "Rules": "recursion",
    "Sensing": "sensing",
    "ToolRun": "constant_load_milling",
    "Trace": "loop",
    "TurningForce": "roughness",
    "TurningRecursion": "recursion",
    "VisibleRegion": "region",
    "WearFront": "region",
    "WearingEdge": "recursion",
    "best_exact": "recursion",
    "best_fixed": "recursion",
    "best_point": "region",
    "carried_out": "recursion",
    "constant_feed_run": "constant_load_milling",
    "constant_load_run": "constant_load_milling",
    "drawn_life": "constant_load_milling",
    "feasibility": "region",
    "fixed_life": "recursion",
    "life_draws": "recursion",
    "life_laws": "recursion",
    "mixed_run": "constant_load_milling",
    "reference_force": "roughness",
    "replay": "loop",
    "step_study": "adaptive_force",
    "turn": "roughness",
    "visible_region": "region",
    "wear_front": "region",
    "whole_life": "recursion",
}

__all__ = [
    "FAULTS",
    "AdaptiveForceControl",
    "Chance",
    "ConstantLoad",
    "ConstantRoughness",
    "Controller",
    "Corner",
    "Cut",
    "CutModel",
    "DriveAndCut",
    "Event",
    "Faulty",
    "FixedForcePi",
    "Life",
    "LifeDraws",
    "LifeLaws",
    "MillingCut",
    "Plant",
    "Point",
    "Rules",
    "Sensing",
    "ToolRun",
    "Trace",
    "TurningForce",
    "TurningRecursion",
    "VisibleRegion",
    "WearFront",
    "WearingEdge",
    "best_exact",
    "best_fixed",
    "best_point",
    "carried_out",
    "constant_feed_run",
    "constant_load_run",
    "drawn_life",
    "feasibility",
    "fixed_life",
    "life_draws",
    "life_laws",
    "mixed_run",
    "reference_force",
    "replay",
    "step_study",
    "turn",
    "visible_region",
    "wear_front",
    "whole_life",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value
