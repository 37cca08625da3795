"""Static laws: power, exponential and load laws, fitted in two stages and judged row by row."""

from .adequacy import Adequacy, adequacy
from .available import NotAvailable
from .beside import Beside, beside_published
from .bootstrap import EdgeBootstrap, edge_bootstrap
from .composite import Composite, composite
from .confirm import Confirmation, confirm
from .defaults import Refused, default_laws
from .domain import Domain, domain
from .edges import EdgeInference, edge_inference
from .errors import FitError
from .forms import Forms, rival_forms
from .gauge import GaugeFit, gauge_corrected, sensitivity
from .identifiable import LeftOut
from .intervals import interval
from .judgement import Judgement, judge
from .lawfit import LawFit
from .life import ToolLife, tool_life
from .linear import LinearFit, linear
from .load_line import load_law
from .next_runs import next_runs
from .regression import exponential_law, power_law
from .robust import RobustFit, dominant_edge, robust
from .rows import By, Dropped
from .slopes import common_exponent
from .structure import error_structure

__all__ = [
    "Adequacy",
    "Beside",
    "By",
    "Composite",
    "Confirmation",
    "Domain",
    "Dropped",
    "EdgeBootstrap",
    "EdgeInference",
    "FitError",
    "Forms",
    "GaugeFit",
    "Judgement",
    "LawFit",
    "LeftOut",
    "LinearFit",
    "NotAvailable",
    "Refused",
    "RobustFit",
    "ToolLife",
    "adequacy",
    "beside_published",
    "common_exponent",
    "composite",
    "confirm",
    "default_laws",
    "domain",
    "dominant_edge",
    "edge_bootstrap",
    "edge_inference",
    "error_structure",
    "exponential_law",
    "gauge_corrected",
    "interval",
    "judge",
    "linear",
    "load_law",
    "next_runs",
    "power_law",
    "rival_forms",
    "robust",
    "sensitivity",
    "tool_life",
]
