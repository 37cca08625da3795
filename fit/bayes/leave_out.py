"""How well a law foretells an edge it has not seen, from draws that have seen it.

Draws are reweighted by one over the likelihood of the edge, with smoothed weights, as if the edge had been left out:
Vehtari, Gelman & Gabry 2017, Statistics and Computing 27, 1413, doi:10.1007/s11222-016-9696-4. An edge is left out
whole: its rows are not independent.
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ...core.errors import FitError, UsageError
from ..available import NotAvailable
from .density import Array
from .psis import K_HAT, smoothed_columns

NAMED = 5  # edges, in words


@dataclass(frozen=True, slots=True, repr=False)
class LeaveOut(Displayable):
    """Expected log density of left-out edges; larger is better, and only differences between laws mean something.

    Attributes
    ----------
    units : tuple of str
        The G edges (rows, where there are no edges).
    elpd : float
        Sum over edges of the log density of an edge under draws that have not seen it; nats, and that of the same
        rows on the same scale where laws are compared.
    se : float or NotAvailable
        Standard error of ``elpd`` over edges.
    p_eff : float
        Effective number of parameters: what seeing the edges adds.
    pointwise : ndarray, shape (G,)
        Of each edge.
    k_hat : ndarray, shape (G,)
        Pareto shape of its weights.
    """

    units: tuple[str, ...]
    elpd: float
    se: float | NotAvailable
    p_eff: float
    pointwise: Array
    k_hat: Array

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Edges whose k-hat is above 0.7: their figure is a guess; fit again without them to know it."""
        return tuple(name for name, k in zip(self.units, self.k_hat, strict=True) if not k <= K_HAT)

    @property
    def words(self) -> str:
        """All of it in a sentence or two."""
        G, doubtful = len(self.units), self.doubtful
        error = f" +- {self.se:.1f}" if isinstance(self.se, float) else ""
        told = (
            f"Expected log density of {G} left-out edges {self.elpd:.1f}{error}, effective parameters {self.p_eff:.1f}."
        )
        if not doubtful:
            return told
        named = ", ".join(doubtful[:NAMED]) + (f" and {len(doubtful) - NAMED} more" if len(doubtful) > NAMED else "")
        return (
            f"{told} For {named} it is a guess (k-hat up to {np.nanmax(self.k_hat):.2f}, above {K_HAT:g}): "
            f"the draws lean on {'it' if len(doubtful) == 1 else 'them'} too much; fit again without to know."
        )


def leave_one_out(by_unit: Array, units: tuple[str, ...]) -> LeaveOut:
    """Expected log density of each edge when it is left out.

    Parameters
    ----------
    by_unit : ndarray, shape (S, G)
        Log likelihood of each edge at each draw; what edges share at random integrated out.
    units : tuple of str
        Names of the G edges.

    Raises
    ------
    UsageError
        Names that do not fit the columns.
    FitError
        A log likelihood that is not a finite number.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> y = rng.normal(size=8)
    >>> mean = rng.normal(y.mean(), 8**-0.5, size=(4000, 1))  # draws of a mean, sd 1 known
    >>> told = leave_one_out(-((y - mean) ** 2) / 2 - np.log(2 * np.pi) / 2, tuple("abcdefgh"))
    >>> told.doubtful, bool(0.2 < told.p_eff < 1.2)
    ((), True)
    """
    S, G = by_unit.shape
    if len(units) != G:
        raise UsageError(f"log likelihoods of {G} edges and {len(units)} names: each edge has one.")
    _finite(by_unit, units)
    log_weights, k_hat = smoothed_columns(-by_unit)
    pointwise = _log_sum(log_weights + by_unit)
    seen = _log_sum(by_unit) - np.log(S)
    se = float(np.sqrt(G * pointwise.var(ddof=1))) if G > 1 else NotAvailable("one edge only: no scatter over edges")
    return LeaveOut(tuple(units), float(pointwise.sum()), se, float((seen - pointwise).sum()), pointwise, k_hat)


def _log_sum(a: Array) -> Array:
    """Log of the sum of exponentials of each column."""
    top = a.max(axis=0)
    return np.asarray(top + np.log(np.exp(a - top).sum(axis=0)))


def _finite(by_unit: Array, units: tuple[str, ...]) -> None:
    bad = ~np.isfinite(by_unit)
    if bad.any():
        g = int(bad.any(axis=0).argmax())
        seen = float(by_unit[bad[:, g].argmax(), g])
        raise FitError(
            f"edge {units[g]}: log likelihood {seen:g} at {bad[:, g].sum()} of {len(by_unit)} draws; a posterior puts "
            "no draw where an edge is impossible: draw again, by chains."
        )
