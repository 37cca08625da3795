from .adaptive_force.controller import AdaptiveForceControl as AdaptiveForceControl
from .constant_load_milling.controller import ConstantLoad as ConstantLoad
from .constant_load_milling.plant import MillingCut as MillingCut
from .constant_load_milling.runs import constant_load_run as constant_load_run
from .economics.optimum import economic_settings as economic_settings
from .exports import export as export
from .gate import check_control as check_control
from .loop import replay as replay
from .recursion.controller import TurningRecursion as TurningRecursion
from .recursion.distribution import life_draws as life_draws
from .recursion.from_file import life_laws as life_laws
from .recursion.life import whole_life as whole_life
from .region.probability import best_point as best_point
from .region.probability import feasibility as feasibility
from .region.visible import visible_region as visible_region
from .roughness.controller import ConstantRoughness as ConstantRoughness

__all__ = [
    "AdaptiveForceControl",
    "ConstantLoad",
    "ConstantRoughness",
    "MillingCut",
    "TurningRecursion",
    "best_point",
    "check_control",
    "constant_load_run",
    "economic_settings",
    "export",
    "feasibility",
    "life_draws",
    "life_laws",
    "replay",
    "visible_region",
    "whole_life",
]
