"""LYAP: adaptive force control in milling, the plant it acts on, and its proof followed along a run.

    settings         what the controller takes from the file, checked
    reference_model  F_d from a set point, with F_d' and F_d''
    revolution       force and F_d averaged over a revolution of the spindle
    control          the controller: control law and adaptation (5)
    fixed_pi         the PI of the file, to hold it against
    process          drive and milling process (2.1, 2.2), depth in steps, ripple of the teeth
    recorded         the simulated run that the published estimates come from
    lyapunov         V and its matrix P along a run
    step_size        how long a step the law stands
    runs             the runs that a replay tells
    judged           settling, overshoot, steady error
    draw             figures

Source: adaptive cutting force control for CNC milling machines by Lyapunov's method (the copy used names no authors).
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .control import AdaptiveForceControl
    from .fixed_pi import FixedForcePi
    from .judged import Held, held
    from .lyapunov import Energy, energy
    from .process import DriveAndCut
    from .recorded import identification_run
    from .runs import ForceRun, depth_step_run, steady_run
    from .step_size import StepSize, step_study

_HOME = {
    "AdaptiveForceControl": "control",
    "DriveAndCut": "process",
    "Energy": "lyapunov",
    "FixedForcePi": "fixed_pi",
    "ForceRun": "runs",
    "Held": "judged",
    "StepSize": "step_size",
    "depth_step_run": "runs",
    "energy": "lyapunov",
    "held": "judged",
    "identification_run": "recorded",
    "steady_run": "runs",
    "step_study": "step_size",
}

__all__ = [
    "AdaptiveForceControl",
    "DriveAndCut",
    "Energy",
    "FixedForcePi",
    "ForceRun",
    "Held",
    "StepSize",
    "depth_step_run",
    "energy",
    "held",
    "identification_run",
    "steady_run",
    "step_study",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value
