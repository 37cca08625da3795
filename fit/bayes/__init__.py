"""Bayesian uncertainty of laws: priors, densities, routes to draws, their diagnostics and the gate before them."""
