"""Posteriors of laws: priors, densities, sampling methods, diagnostics and convergence checks."""

FEWEST_DRAWS, MOST_DRAWS = 1000, 1_000_000  # of a posterior: fewer pass the convergence checks by chance only
