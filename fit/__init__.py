"""Static laws: power, exponential and load laws, fitted in two stages and judged row by row."""

from .adequacy import Adequacy, adequacy
from .available import NotAvailable
from .beside import Beside, beside_published
from .defaults import Refused, default_laws
from .edges import EdgeInference, edge_inference
from .errors import FitError
from .identifiable import LeftOut
from .lawfit import LawFit
from .life import ToolLife, tool_life
from .linear import LinearFit, linear
from .load_line import load_law
from .regression import exponential_law, power_law
from .rows import By, Dropped

__all__ = [
    "Adequacy",
    "Beside",
    "By",
    "Dropped",
    "EdgeInference",
    "FitError",
    "LawFit",
    "LeftOut",
    "LinearFit",
    "NotAvailable",
    "Refused",
    "ToolLife",
    "adequacy",
    "beside_published",
    "default_laws",
    "edge_inference",
    "exponential_law",
    "linear",
    "load_law",
    "power_law",
    "tool_life",
]
