"""Dynamics: from a recorded run of a machine to a model that simulates it, and to gains that hold on it.

Names load on first use; each lives in the file that ``_HOME`` names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bias import warn_of_bias
    from .causality import causality
    from .errors import IdentError
    from .instrumental import sriv
    from .least_squares import arx
    from .model import Model
    from .orders import OrderSearch, choose_order
    from .prediction_error import armax, output_error

_HOME = {
    "IdentError": "errors",
    "Model": "model",
    "OrderSearch": "orders",
    "armax": "prediction_error",
    "arx": "least_squares",
    "causality": "causality",
    "choose_order": "orders",
    "output_error": "prediction_error",
    "sriv": "instrumental",
    "warn_of_bias": "bias",
}

__all__ = [
    "IdentError",
    "Model",
    "OrderSearch",
    "armax",
    "arx",
    "causality",
    "choose_order",
    "output_error",
    "sriv",
    "warn_of_bias",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value
