"""Posteriors of laws: priors, densities, sampling methods, diagnostics and convergence checks."""
