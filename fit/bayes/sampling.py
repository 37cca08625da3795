"""Sampling of any posterior density: exact, by importance sampling, or by MCMC where that fails the checks."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Literal

import numpy as np
import pandas as pd

from ...core.arrays import Array
from ...core.calls import check_share
from ...core.display import Plottable
from ...core.errors import UsageError
from ...core.progress import status_line
from .convergence import Agreement, ConvergenceChecks, check_convergence
from .density import Density, LawDensity, Method, Sample
from .diagnostics import Diagnostics, diagnose
from .psis_loo import K_HAT

Progress = Callable[[int, float], None]
Route = Literal["importance", "emcee"]

MORE = 4  # times the draws, tried before MCMC where weights are reliable: a tenth of the cost of MCMC
PATIENCE = 2.0  # s: shorter runs show no progress
EVERY = 0.2  # s between two updates


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class PosteriorDraws(Plottable):
    """Draws from a posterior density, with their diagnostics.

    Attributes
    ----------
    density : Density
        The model: its rows, priors and errors.
    sample : Sample
        Draws on the scale of the density, and their sampling method.
    draws : ndarray, shape (S, q)
        Draws of ``names``.
    diagnostics : Diagnostics
    agreement : Agreement or None
        Comparison with an independent MCMC run, where one was made.
    notes : tuple of str
        Assumptions, and why another sampling method was used.
    """

    density: Density
    sample: Sample
    draws: Array
    diagnostics: Diagnostics
    agreement: Agreement | None = None
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, as the laws call them, then ``sd``, ``icc`` and ``nu`` where the model has them."""
        return self.density.parameter_names

    @property
    def method(self) -> str:
        """``exact``, ``importance`` or ``emcee``."""
        return self.sample.method

    @property
    def r_hat(self) -> "pd.Series[float]":
        """Split R-hat of each parameter."""
        return pd.Series(self.diagnostics.r_hat, index=list(self.names), name="r_hat")

    @property
    def ess(self) -> "pd.Series[float]":
        """Effective number of draws of each parameter, bulk or tail, the smaller."""
        least = np.minimum(self.diagnostics.ess_bulk, self.diagnostics.ess_tail)
        return pd.Series(least, index=list(self.names), name="ess")

    @property
    def convergence(self) -> ConvergenceChecks:
        """Convergence checks; draws that do not pass are not written to a parameter file."""
        return check_convergence(self.diagnostics, self.agreement, self.sample.interrupted)

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Mean, sd, median and equal-tailed interval of each parameter, with its diagnostics."""
        check_share("level", level)
        low, median, high = np.quantile(self.draws, [(1 - level) / 2, 0.5, (1 + level) / 2], axis=0)
        columns = {
            "mean": self.draws.mean(axis=0),
            "sd": self.draws.std(axis=0, ddof=1),
            "median": median,
            "low": low,
            "high": high,
            "r_hat": self.diagnostics.r_hat,
            "ess_bulk": self.diagnostics.ess_bulk,
            "ess_tail": self.diagnostics.ess_tail,
        }
        return pd.DataFrame(columns, index=list(self.names))

    def interval(self, level: float = 0.95) -> pd.DataFrame:
        """Equal-tailed credible interval of each parameter, columns ``low`` and ``high``."""
        return self.table(level)[["low", "high"]]

    def to_frame(self) -> pd.DataFrame:
        """The draws, a column for each parameter."""
        return pd.DataFrame(self.draws, columns=list(self.names))


def draw(
    density: Density, seed: int, draws: int, progress: Progress | None = None, method: Method | None = None
) -> PosteriorDraws:
    """Draw from a density.

    Parameters
    ----------
    density : Density
    seed : int
    draws : int
        Of importance sampling, or four times as many where these fail the convergence checks; effective draws of MCMC.
    progress : callable, optional
        Called by MCMC with the steps done and the effective draws so far.
    method : {"exact", "importance", "emcee"}, optional
        By default importance sampling, and MCMC where that fails the convergence checks.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> draw(law_density(law, weak(law, edges=False)), 1, 1000).sample.method
    'importance'
    """
    if method == "exact" and isinstance(density, LawDensity):
        from .exact_draws import exact

        return _diagnosed(density, exact(density, np.random.default_rng(seed), draws))
    from .ensemble_sampler import chains
    from .importance_sampling import importance

    if method not in (None, "importance", "emcee"):
        raise UsageError(f"method={method!r}: it is 'importance' or 'emcee'.")
    if method == "emcee":
        return _diagnosed(density, chains(density, seed, ess=draws, progress=progress))
    for n in (draws, MORE * draws):
        first = _diagnosed(density, importance(density, np.random.default_rng(seed), n))
        checks = check_convergence(first.diagnostics)
        if method == "importance" or checks.passed:
            return first
        if not (first.sample.k_hat or 0.0) <= K_HAT:
            break
    note = f"MCMC replaced importance sampling: {checks.reasons[0]}"
    return _diagnosed(density, chains(density, seed, ess=draws, progress=progress), (note,))


def draw_law(density: LawDensity, seed: int, draws: int, progress: Progress | None = None) -> PosteriorDraws:
    """Draw exactly where the form is linear in logarithms with errors there, else as `draw`."""
    linear = type(density) is LawDensity and not density.natural
    return draw(density, seed, draws, progress, "exact" if linear else None)


def _diagnosed(density: Density, sample: Sample, notes: tuple[str, ...] = ()) -> PosteriorDraws:
    """A sample with its parameters and their diagnostics."""
    draws = density.parameters(sample.phi)
    diagnostics = diagnose(density.parameter_names, draws, sample)
    return PosteriorDraws(density=density, sample=sample, draws=draws, diagnostics=diagnostics, notes=notes)


def watch(what: str = "drawing", patience: float = PATIENCE) -> Progress:
    """A ``progress`` for the posteriors: one line with steps, effective draws and seconds.

    In a notebook the line is updated under the cell; at a terminal on standard error; into a pipe nothing is written.

    Parameters
    ----------
    what : str
        First word of the line.
    patience : float
        Seconds before anything is shown.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> fit.posterior(law, seed=1, progress=watch()).method
    'exact'
    """
    began = last = monotonic()
    line = status_line()

    def update(steps: int, effective: float) -> None:
        nonlocal last
        now = monotonic()
        if now - began >= patience and now - last >= min(EVERY, patience):
            last = now
            line(f"{what}: {steps} steps, {effective:.0f} effective draws, {now - began:.0f} s")

    return update
