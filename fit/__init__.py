"""Static laws: power, exponential and load laws, fitted in two stages and judged row by row.

``PowerLawRegressor`` needs scikit-learn and is imported on first use; it is not in ``__all__``.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from ..core.errors import UsageError
from .available import NotAvailable
from .bayes.competing_posterior import RivalPosterior, rival_posterior
from .bayes.draw_posterior import posterior
from .bayes.joint_posterior import JointPosterior, latent_wear
from .bayes.posterior import Posterior
from .bayes.priors import Priors
from .bayes.sampling import watch
from .beside import Beside, beside_published
from .bootstrap import EdgeBootstrap, edge_bootstrap
from .checks.competing_models import CompetingModels, compare_forms
from .checks.gauge_error import GaugeFit, gauge_corrected, sensitivity
from .checks.judgement import Judgement, judge
from .checks.response_scale import error_structure
from .checks.robust_fit import RobustFit, dominant_edge, robust
from .checks.time_exponent import common_exponent
from .composite import Composite, composite
from .confirm import Confirmation, confirm
from .defaults import Refused, default_laws
from .domain import Domain, domain
from .edges import EdgeInference
from .identifiable import LeftOut
from .intervals import interval
from .jackknife import edge_inference
from .lawfit import LawFit
from .life import ToolLife, tool_life
from .linear import LinearFit, linear
from .load_line import load_law
from .next_runs import next_runs
from .regression import exponential_law, power_law
from .rows import By, Dropped

if TYPE_CHECKING:
    from .estimator import PowerLawRegressor as PowerLawRegressor
    from .many.families import PooledExponents, pooled_exponents
    from .many.in_stacks import many_power_laws
    from .many.laws_of_pairs import ManyLaws
    from .streamed.one_pass import streamed_power_law
    from .streamed.streamed_law import StreamedLaw

__all__ = [
    "Beside",
    "By",
    "CompetingModels",
    "Composite",
    "Confirmation",
    "Domain",
    "Dropped",
    "EdgeBootstrap",
    "EdgeInference",
    "GaugeFit",
    "JointPosterior",
    "Judgement",
    "LawFit",
    "LeftOut",
    "LinearFit",
    "ManyLaws",
    "NotAvailable",
    "PooledExponents",
    "Posterior",
    "Priors",
    "Refused",
    "RivalPosterior",
    "RobustFit",
    "StreamedLaw",
    "ToolLife",
    "beside_published",
    "common_exponent",
    "compare_forms",
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
    "latent_wear",
    "linear",
    "load_law",
    "many_power_laws",
    "next_runs",
    "pooled_exponents",
    "posterior",
    "power_law",
    "rival_posterior",
    "robust",
    "sensitivity",
    "streamed_power_law",
    "tool_life",
    "watch",
]


_HOME = {  # imported on first use
    "ManyLaws": "many.laws_of_pairs",
    "PooledExponents": "many.families",
    "StreamedLaw": "streamed.streamed_law",
    "many_power_laws": "many.in_stacks",
    "pooled_exponents": "many.families",
    "streamed_power_law": "streamed.one_pass",
}


def __getattr__(name: str) -> object:
    if name in _HOME:
        globals()[name] = getattr(import_module(f".{_HOME[name]}", __name__), name)
        return globals()[name]
    if name != "PowerLawRegressor":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from .estimator import PowerLawRegressor
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("sklearn"):
            raise
        raise UsageError("scikit-learn is not installed: pip install 'fitmodels[sklearn]'.") from None
    return PowerLawRegressor
