from .available import NotAvailable as NotAvailable
from .bayes.competing_posterior import posterior_of_form as posterior_of_form
from .bayes.draw_posterior import posterior as posterior
from .bayes.joint_posterior import latent_wear as latent_wear
from .bayes.priors import Priors as Priors
from .bootstrap import edge_bootstrap as edge_bootstrap
from .censored_lives import life_law as life_law
from .checks.competing_models import compare_forms as compare_forms
from .checks.gauge_error import gauge_corrected as gauge_corrected
from .checks.judgement import judge as judge
from .checks.robust_fit import robust as robust
from .composite_law import composite as composite
from .confirmation import confirm as confirm
from .defaults import default_laws as default_laws
from .defaults import fit_law as fit_law
from .kienzle import kienzle_law as kienzle_law
from .lawfit import LawFit as LawFit
from .least_squares import linear as linear
from .left_out_edges import compare_laws as compare_laws
from .life import tool_life as tool_life
from .many.batched import many_power_laws as many_power_laws
from .many.pooling import pooled_exponents as pooled_exponents
from .mechanistic import end_mill_force as end_mill_force
from .next_tests import next_runs as next_runs
from .prediction import interval as interval
from .regression import exponential_law as exponential_law
from .regression import load_law as load_law
from .regression import power_law as power_law
from .streaming import streamed_power_law as streamed_power_law
from .surface.surfaces import response_surface as response_surface
from .wear_curves import wear_curve_lives as wear_curve_lives

__all__ = [
    "LawFit",
    "NotAvailable",
    "Priors",
    "compare_forms",
    "compare_laws",
    "composite",
    "confirm",
    "default_laws",
    "edge_bootstrap",
    "end_mill_force",
    "exponential_law",
    "fit_law",
    "gauge_corrected",
    "interval",
    "judge",
    "kienzle_law",
    "latent_wear",
    "life_law",
    "linear",
    "load_law",
    "many_power_laws",
    "next_runs",
    "pooled_exponents",
    "posterior",
    "posterior_of_form",
    "power_law",
    "response_surface",
    "robust",
    "streamed_power_law",
    "tool_life",
    "wear_curve_lives",
]
