"""The gate before draws: shut, and why, where they cannot be relied on."""

from dataclasses import dataclass
from math import ceil
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from .diagnostics import Diagnostics
from .psis import K_HAT

ESS = 400.0  # Vehtari et al. 2021, doi:10.1214/20-BA1221, sec. 4.1: 100 for each of four chains
R_HAT = 1.01  # the same section
TIMES = 50.0  # autocorrelation times in a chain: documentation of emcee, "Autocorrelation analysis & convergence"


class Verdict(Protocol):
    """What is said of two runs of the same model, side by side."""

    @property
    def agrees(self) -> bool:
        """Whether they differ by no more than their Monte Carlo error."""

    @property
    def words(self) -> str:
        """One sentence: where they differ, by how much, how much is allowed, what to do."""


@dataclass(frozen=True, slots=True, repr=False)
class Gate(Displayable):
    """Whether draws may be used.

    Attributes
    ----------
    open : bool
        Nothing is written to a parameter file while it is shut.
    reasons : tuple of str
        Why it is shut, a sentence each: what was found, the limit, what to do. Empty where it is open.
    """

    open: bool
    reasons: tuple[str, ...] = ()


def gate(diagnostics: Diagnostics, agreement: Verdict | None = None, interrupted: bool = False) -> Gate:
    """The gate for draws.

    It is shut below 400 effective draws in bulk, in the tails or as the route counts them, above R-hat 1.01, above
    k-hat 0.7, by chains of fewer than 50 autocorrelation times, by routes that disagree, and where the run was stopped.
    What is not a number is bad.

    Parameters
    ----------
    diagnostics : Diagnostics
    agreement : Verdict, optional
        Of an independent run, where there was one.
    interrupted : bool

    Examples
    --------
    >>> from fitmodels.fit.bayes.diagnostics import diagnose
    >>> from fitmodels.fit.bayes.sample import Sample
    >>> draws = np.random.default_rng(1).normal(size=(4000, 2))
    >>> gate(diagnose(("V", "f"), draws, Sample(draws, 1, "exact", "drawn independently")))
    Gate: convergence checks passed
    >>> gate(diagnose(("V", "f"), draws, Sample(draws, 1, "importance", "reweighted", k_hat=0.83))).reasons[0][:46]
    'k-hat 0.83 of the importance weights is above '
    """
    reasons = (
        *diagnostics.notes,
        *_effective(diagnostics),
        *_alike(diagnostics),
        *_weights(diagnostics.k_hat),
        *_long_enough(diagnostics),
        *(() if agreement is None or agreement.agrees else (agreement.words.rstrip(".") + ".",)),
        *(("the run was stopped before its end: run it again and let it finish.",) if interrupted else ()),
    )
    return Gate(not reasons, reasons)


def _effective(told: Diagnostics) -> list[str]:
    """Effective draws of parameters in bulk and tails, and as the route counts them."""
    S, reasons = told.chains * told.length, []
    for where, ess in (("in bulk", told.ess_bulk), ("in the tails", told.ess_tail)):
        low = ~(ess >= ESS) & _judged(told)
        if low.any():
            j = int(np.argmin(np.where(low, np.nan_to_num(ess, nan=-1.0), np.inf)))
            of = _with_others(told.names[j], low)
            reasons.append(f"{of}: {ess[j]:.0f} effective draws {where}, below {ESS:.0f}: {_longer(S, ess[j])}.")
    route = told.ess_route
    if route is not None and not route >= ESS:
        reasons.append(f"{route:.0f} of {S} draws count as effective, below {ESS:.0f}: {_longer(S, route)}.")
    return reasons


def _alike(told: Diagnostics) -> list[str]:
    """R-hat."""
    high = ~(told.r_hat <= R_HAT) & _judged(told)
    if not high.any():
        return []
    j = int(np.argmax(np.where(high, np.nan_to_num(told.r_hat, nan=np.inf, posinf=np.inf), -np.inf)))
    return [
        f"{_with_others(told.names[j], high)}: R-hat {told.r_hat[j]:.3f} is above {R_HAT:g}: the chains differ; run "
        "longer, twice the draws or more, and if they still differ give --priors that hold it, or leave its term out."
    ]


def _weights(k_hat: float | None) -> list[str]:
    if k_hat is None or k_hat <= K_HAT:
        return []
    return [
        f"k-hat {k_hat:.2f} of the importance weights is above {K_HAT:g}: a few draws weigh more than all others, "
        'so take chains instead, method="emcee".'
    ]


def _long_enough(told: Diagnostics) -> list[str]:
    """Chains against their autocorrelation time; one draw is granted to what thinning cut off."""
    if told.tau is None or (told.length + 1 >= TIMES * told.tau).all():
        return []
    j = int(np.argmax(np.nan_to_num(told.tau, nan=np.inf, posinf=np.inf)))
    slowest = f" of {told.names[j]}" if len(told.tau) == len(told.names) else ""
    if not np.isfinite(told.tau[j]):
        return [f"the autocorrelation time{slowest} cannot be told: a walker never moved; run longer, from elsewhere."]
    return [
        f"chains of {told.length} draws hold {told.length / told.tau[j]:.0f} autocorrelation times{slowest}, fewer "
        f"than {TIMES:.0f}: run longer: {ceil(TIMES * told.tau[j])} draws a chain."
    ]


def _judged(told: Diagnostics) -> NDArray[np.bool_]:
    """Parameters of which the notes do not say already that nothing can be said."""
    return np.isfinite(told.r_hat) if told.notes else np.ones(len(told.names), bool)


def _with_others(name: str, bad: NDArray[np.bool_]) -> str:
    more = int(bad.sum()) - 1
    return name + (f" (and {more} more)" if more else "")


def _longer(S: int, ess: float) -> str:
    """What to do about too few effective draws, with a tenth to spare."""
    if not ess >= 1:
        return "run longer, ten times the draws or more"
    need = 1.1 * S * ESS / ess
    unit = 10 ** max(len(str(int(need))) - 2, 0)
    return f"run longer: {ceil(need / unit) * unit} draws instead of {S}"
