"""Dynamics: from a recorded run of a machine to a model that simulates it, and to gains that hold on it.

Names load on first use; each lives in the file that ``_HOME`` names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bands import response_band
    from .bias import warn_of_bias
    from .causality import causality
    from .continuous import ContinuousModel, to_continuous
    from .drive import DriveFit, drive_fit
    from .errors import IdentError
    from .excitation import chirp, multisine, prbs, steps
    from .excitation_file import write_excitation
    from .excited import excited_band
    from .force_process import ForceProcess, force_process_fit
    from .frequency import FrequencyResponse, frequency_response
    from .identification import Identification, identify
    from .instrumental import sriv
    from .least_squares import arx
    from .model import Model
    from .orders import OrderSearch, choose_order
    from .pi.check import PiCheck, check_pi
    from .pi.designs import pi_by_margin
    from .pi.feasible import FeasibleMap, feasible_map
    from .pi.gains import PiGains
    from .pi.loop import loop_of
    from .pi.simulation import simulate_loop
    from .pi.specification import Specification
    from .pi.tuned import TunedPi
    from .pi.tuning import tune_pi
    from .pole_bands import pole_band
    from .predicted_precision import predicted_errors
    from .prediction_error import armax, output_error
    from .step_bands import step_band
    from .steps import StepFit, step_response_fit
    from .validation import Validation, validate
    from .zero_order_hold import sampled

_HOME = {
    "ContinuousModel": "continuous",
    "DriveFit": "drive",
    "FeasibleMap": "pi.feasible",
    "ForceProcess": "force_process",
    "FrequencyResponse": "frequency",
    "IdentError": "errors",
    "Identification": "identification",
    "Model": "model",
    "OrderSearch": "orders",
    "PiCheck": "pi.check",
    "PiGains": "pi.gains",
    "Specification": "pi.specification",
    "StepFit": "steps",
    "TunedPi": "pi.tuned",
    "Validation": "validation",
    "armax": "prediction_error",
    "arx": "least_squares",
    "causality": "causality",
    "check_pi": "pi.check",
    "chirp": "excitation",
    "choose_order": "orders",
    "drive_fit": "drive",
    "excited_band": "excited",
    "feasible_map": "pi.feasible",
    "force_process_fit": "force_process",
    "frequency_response": "frequency",
    "identify": "identification",
    "loop_of": "pi.loop",
    "multisine": "excitation",
    "output_error": "prediction_error",
    "pi_by_margin": "pi.designs",
    "pole_band": "pole_bands",
    "prbs": "excitation",
    "predicted_errors": "predicted_precision",
    "response_band": "bands",
    "sampled": "zero_order_hold",
    "simulate_loop": "pi.simulation",
    "sriv": "instrumental",
    "step_band": "step_bands",
    "step_response_fit": "steps",
    "steps": "excitation",
    "to_continuous": "continuous",
    "tune_pi": "pi.tuning",
    "validate": "validation",
    "warn_of_bias": "bias",
    "write_excitation": "excitation_file",
}

__all__ = [
    "ContinuousModel",
    "DriveFit",
    "FeasibleMap",
    "ForceProcess",
    "FrequencyResponse",
    "IdentError",
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
