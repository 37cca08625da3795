"""Dynamics: from a recorded run of a machine to a model that simulates it, and to gains that hold on it.

Names load on first use; each lives in the file that ``_HOME`` names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .estimators.bias import warn_of_bias
    from .estimators.causality import causality
    from .estimators.instrumental import sriv
    from .estimators.least_squares import arx
    from .estimators.orders import OrderSearch, choose_order
    from .estimators.prediction_error import armax, output_error
    from .excite.files import write_excitation
    from .excite.predicted_precision import predicted_errors
    from .excite.signals import chirp, multisine, prbs, steps
    from .identification import Identification, identify
    from .judging.bands import response_band
    from .judging.excited import excited_band
    from .judging.frequency import FrequencyResponse, frequency_response
    from .judging.pole_bands import pole_band
    from .judging.step_bands import step_band
    from .judging.validation import Validation, validate
    from .machines.continuous import ContinuousModel, to_continuous
    from .machines.drive import DriveFit, drive_fit
    from .machines.force_process import ForceProcess, force_process_fit
    from .machines.step_response import StepFit, step_response_fit
    from .machines.zero_order_hold import sampled
    from .model import Model
    from .pi.check import PiCheck, check_pi
    from .pi.designs import pi_by_margin
    from .pi.feasible import FeasibleMap, feasible_map
    from .pi.gains import PiGains
    from .pi.loop import loop_of
    from .pi.simulation import simulate_loop
    from .pi.specification import Specification
    from .pi.tuned import TunedPi
    from .pi.tuning import tune_pi

_HOME = {
    "ContinuousModel": "machines.continuous",
    "DriveFit": "machines.drive",
    "FeasibleMap": "pi.feasible",
    "ForceProcess": "machines.force_process",
    "FrequencyResponse": "judging.frequency",
    "Identification": "identification",
    "Model": "model",
    "OrderSearch": "estimators.orders",
    "PiCheck": "pi.check",
    "PiGains": "pi.gains",
    "Specification": "pi.specification",
    "StepFit": "machines.step_response",
    "TunedPi": "pi.tuned",
    "Validation": "judging.validation",
    "armax": "estimators.prediction_error",
    "arx": "estimators.least_squares",
    "causality": "estimators.causality",
    "check_pi": "pi.check",
    "chirp": "excite.signals",
    "choose_order": "estimators.orders",
    "drive_fit": "machines.drive",
    "excited_band": "judging.excited",
    "feasible_map": "pi.feasible",
    "force_process_fit": "machines.force_process",
    "frequency_response": "judging.frequency",
    "identify": "identification",
    "loop_of": "pi.loop",
    "multisine": "excite.signals",
    "output_error": "estimators.prediction_error",
    "pi_by_margin": "pi.designs",
    "pole_band": "judging.pole_bands",
    "prbs": "excite.signals",
    "predicted_errors": "excite.predicted_precision",
    "response_band": "judging.bands",
    "sampled": "machines.zero_order_hold",
    "simulate_loop": "pi.simulation",
    "sriv": "estimators.instrumental",
    "step_band": "judging.step_bands",
    "step_response_fit": "machines.step_response",
    "steps": "excite.signals",
    "to_continuous": "machines.continuous",
    "tune_pi": "pi.tuning",
    "validate": "judging.validation",
    "warn_of_bias": "estimators.bias",
    "write_excitation": "excite.files",
}

__all__ = [
    "ContinuousModel",
    "DriveFit",
    "FeasibleMap",
    "ForceProcess",
    "FrequencyResponse",
    "Identification",
    "Model",
    "OrderSearch",
    "PiCheck",
    "PiGains",
    "Specification",
    "StepFit",
    "TunedPi",
    "Validation",
    "armax",
    "arx",
    "causality",
    "check_pi",
    "chirp",
    "choose_order",
    "drive_fit",
    "excited_band",
    "feasible_map",
    "force_process_fit",
    "frequency_response",
    "identify",
    "loop_of",
    "multisine",
    "output_error",
    "pi_by_margin",
    "pole_band",
    "prbs",
    "predicted_errors",
    "response_band",
    "sampled",
    "simulate_loop",
    "sriv",
    "step_band",
    "step_response_fit",
    "steps",
    "to_continuous",
    "tune_pi",
    "validate",
    "warn_of_bias",
    "write_excitation",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value
