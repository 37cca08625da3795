"""Sampling of any posterior density: exact, by importance sampling, or by MCMC where that fails the checks."""

from dataclasses import dataclass
from time import monotonic
from typing import Literal

import numpy as np

from ...core.errors import UsageError
from ...core.progress import status_line
from .convergence import gate
from .density import Array, Density, Sample
from .diagnostics import Diagnostics, diagnose
from .ensemble_sampler import Progress
from .psis_loo import K_HAT

Route = Literal["importance", "emcee"]

MORE = 4  # times the draws, tried before chains where weights can be trusted: a tenth of what chains cost


@dataclass(frozen=True, slots=True)
class Drawn:
    """A sample, its parameters as they are told (S, q), what is known of them, and a word where chains took over."""

    sample: Sample
    told: Array
    diagnostics: Diagnostics
    notes: tuple[str, ...] = ()


def drawn(
    density: Density, seed: int, draws: int, progress: Progress | None = None, method: Route | None = None
) -> Drawn:
    """Draw from a density.

    Parameters
    ----------
    density : Density
    seed : int
    draws : int
        Of importance sampling, or four times as many where these do not open the gate; effective draws of chains.
    progress : callable, optional
        Called by chains with the steps done and the effective draws so far.
    method : {"importance", "emcee"}, optional
        This route and no other.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.density import law_density
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> drawn(law_density(law, weak(law, edges=False)), 1, 1000).sample.method
    'importance'
    """
    from .ensemble_sampler import chains
    from .importance_sampling import importance

    if method not in (None, "importance", "emcee"):
        raise UsageError(f"method={method!r}: it is 'importance' or 'emcee'.")
    if method == "emcee":
        return judged(density, chains(density, seed, ess=draws, progress=progress))
    for n in (draws, MORE * draws):
        first = judged(density, importance(density, np.random.default_rng(seed), n))
        verdict = gate(first.diagnostics)
        if method == "importance" or verdict.open:
            return first
        if not (first.sample.k_hat or 0.0) <= K_HAT:
            break
    word = f"chains took over from importance sampling: {verdict.reasons[0]}"
    return judged(density, chains(density, seed, ess=draws, progress=progress), (word,))


def judged(density: Density, sample: Sample, notes: tuple[str, ...] = ()) -> Drawn:
    """A sample with its parameters told and judged."""
    told = density.told(sample.phi)
    return Drawn(sample, told, diagnose(density.told_names, told, sample), notes)


PATIENCE = 2.0  # s: what takes less says nothing
EVERY = 0.2  # s between two looks


def watch(what: str = "drawing", patience: float = PATIENCE) -> Progress:
    """A ``progress`` for ``posterior``, ``latent_wear`` and ``rival_posterior``: steps, effective draws and seconds.

    In a notebook the line stands under the cell and is renewed there; at a terminal on standard error; into a pipe
    nothing is written.

    Parameters
    ----------
    what : str
        What the line begins with.
    patience : float
        Seconds before anything is shown.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> fit.posterior(law, seed=1, progress=fit.watch()).method
    'exact'
    """
    began = last = monotonic()
    line = status_line()

    def tell(steps: int, effective: float) -> None:
        nonlocal last
        now = monotonic()
        if now - began >= patience and now - last >= min(EVERY, patience):
            last = now
            line(f"{what}: {steps} steps, {effective:.0f} effective draws, {now - began:.0f} s")

    return tell
