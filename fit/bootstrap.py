"""Bootstrap by edge: refits to edges resampled with replacement (cluster bootstrap).

A refit needs each edge's cross products alone, so that thousands of them are one product of matrices.

Source: Davison & Hinkley 1997, Bootstrap Methods and their Application, section 3.8 (clustered data).
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.calls import check_share
from ..core.display import Plottable
from ..core.threads import one_thread
from .available import NotAvailable, computed
from .checks.agreement import compare_estimates, of_draws
from .checks.check import Check
from .composite_law import without_fixed
from .edges import EdgeInference
from .lawfit import LawFit


@dataclass(frozen=True, slots=True, repr=False)
class EdgeBootstrap(Plottable):
    """Refits of a law to edges drawn with replacement.

    Attributes
    ----------
    names : tuple of str
        Parameters, as ``LawFit.theta_names``.
    draws : ndarray, shape (r, p)
        ``theta`` of each refit; for a law in natural units after one Gauss-Newton step.
    impossible : int
        Draws that lacked an edge which some parameter needs; they are not among ``draws``.
    agreement : Check or NotAvailable
        Comparison of the mean of each exponent with its other estimates.
    """

    names: tuple[str, ...]
    draws: Array
    impossible: int
    agreement: Check | NotAvailable

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard deviation of the draws."""
        return pd.Series(self.draws.std(axis=0, ddof=1), index=list(self.names))

    def interval(self, level: float = 0.95) -> pd.DataFrame:
        """Percentile intervals of ``theta`` at ``level``."""
        check_share("level", level)
        tails = np.quantile(self.draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
        return pd.DataFrame({"low": tails[0], "high": tails[1]}, index=list(self.names))

    def to_frame(self) -> pd.DataFrame:
        """The draws, a column a parameter."""
        return pd.DataFrame(self.draws, columns=list(self.names))


@one_thread
def edge_bootstrap(law: LawFit, repetitions: int = 2000, seed: int = 1) -> EdgeBootstrap | NotAvailable:
    """Refit a law to its edges drawn with replacement; fixed exponents stay, and have no draws.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> boot = fit.edge_bootstrap(law, 500)
    >>> bool(0.5 < boot.bse["V"] / law.bse["V"] < 1.1)
    True
    """
    if not isinstance(law.edges, EdgeInference):
        return law.edges
    law = without_fixed(law)
    assert isinstance(law.edges, EdgeInference)  # noqa: S101  of the same rows
    edge = np.searchsorted(law.edges.edges, law.edge.astype(str)) if law.edge is not None else np.empty(0, int)
    root = np.linalg.cholesky(law.covariance())
    root /= np.linalg.norm(root, axis=0)
    Q = law.gradient @ root  # columns of like size, nearly uncorrelated
    G, p = law.edges.n_edges, Q.shape[1]
    order = np.argsort(edge, kind="stable")
    starts = np.searchsorted(edge[order], np.arange(G))
    Q, r = Q[order], law.residuals[order]
    gram = np.add.reduceat(Q[:, :, None] * Q[:, None, :], starts).reshape(G, p * p)
    score = np.add.reduceat(Q * r[:, None], starts)
    weights = np.random.default_rng(seed).multinomial(G, np.full(G, 1 / G), size=repetitions).astype(float)
    A = (weights @ gram).reshape(-1, p, p)
    possible = np.linalg.cond(A) < 1e10
    step = np.linalg.solve(A[possible], (weights @ score)[possible][:, :, None])[:, :, 0]
    draws = law.theta + step @ root.T
    own = of_draws(law, "bootstrap by edge", law.theta_names, draws)
    agreement = computed(partial(compare_estimates, law, own))
    return EdgeBootstrap(law.theta_names, draws, int((~possible).sum()), agreement)
