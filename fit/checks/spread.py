"""Is the scatter even over the conditions: Breusch and Pagan's test, studentised.

Sources: Breusch & Pagan 1979, Econometrica 47, 1287, in the form of Koenker 1981, J. Econometrics 17, 107.
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import concern_of, p_in_words
from .columns import Array, orthonormal, sums_by
from .residuals import HELD, Residuals


@dataclass(frozen=True, slots=True, repr=False)
class Spread(Displayable):
    """Breusch-Pagan test, studentised by Koenker, of scatter that changes with the conditions.

    Attributes
    ----------
    of : str
        Which residuals, as in :class:`Residuals`.
    statistic : float
        ``n R2`` of the squared residuals on the terms of the law, chi-squared on ``df``.
    df : int
    pvalue : float
    term : str
        Term with which the scatter changes most.
    rises : bool
        Whether it rises with it.
    additive : bool
        Whether the law was fitted in natural units.
    """

    of: str
    statistic: float
    df: int
    pvalue: float
    term: str
    rises: bool
    additive: bool

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return f"residuals of {self.of} scatter alike at all conditions"

    @property
    def concern(self) -> int:
        """0 fine, 1 below .05, 2 below .001. Cause: a scatter in per cent fitted in units, or a noisy corner."""
        return concern_of(self.pvalue)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"even scatter of {self.of} {p_in_words(self.pvalue)}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        found = f"Breusch-Pagan {self.statistic:.1f} on {self.df} df, {p_in_words(self.pvalue)}"
        if not self.concern:
            return f"Scatter of {self.of} is even over the conditions ({found})."
        how = "rises" if self.rises else "falls"
        rescaled = self.additive and self.rises  # in logs, scatter that grows with the response is even
        cure = "fit it with multiplicative errors" if rescaled else "one interval for all conditions misleads there"
        return f"Scatter of {self.of} {how} with {self.term} ({found}): {cure}."


def spread(law: LawFit, residuals: Residuals) -> Spread | NotAvailable:
    """Breusch-Pagan test of a set of residuals on the terms of the law.

    Independent residuals give Koenker's ``n R2``. Residuals about a common level are correlated, and so are their
    squares: two of an edge's two are equal. The covariance of the scores allows for it.
    """
    from scipy.special import chdtrc

    names, scaled = _centred(residuals)
    Q = orthonormal(scaled)
    n, k = Q.shape
    if k == 0:
        return NotAvailable(f"no factor changes among the residuals of {residuals.of}")
    if residuals.free < k + 3:
        return NotAvailable(
            f"residuals of {residuals.of} have {residuals.free} degrees of freedom for {k} factors: too few to see "
            "where the scatter changes"
        )
    squares = residuals.values**2
    size = float(squares @ squares)
    squares = squares - squares.mean()
    if float(squares @ squares) <= HELD * size:
        return NotAvailable(f"residuals of {residuals.of} are all of one size: nothing to compare")
    s2, axes = np.linalg.eigh(_covariance_of_squares(Q, residuals))
    free = s2 > HELD  # of two rows an edge nothing shows how scatter changes within it
    told = (axes.T @ (Q.T @ squares))[free]
    statistic = n * float((told**2 / s2[free]).sum()) / float(squares @ squares)
    pull = scaled.T @ squares
    j = int(np.argmax(np.abs(pull)))
    p = float(chdtrc(len(told), statistic))
    return Spread(residuals.of, statistic, len(told), p, names[j], bool(pull[j] > 0), law.error == "additive")


def _centred(residuals: Residuals) -> tuple[list[str], Array]:
    """Terms that change among the residuals: names, and columns centred and of length one."""
    terms = residuals.terms - residuals.terms.mean(axis=0)
    length = np.sqrt(np.einsum("ij,ij->j", terms, terms))
    seen = length > HELD * np.abs(residuals.terms).max(axis=0, initial=0.0)
    return [name for name, there in zip(residuals.names, seen, strict=True) if there], terms[:, seen] / length[seen]


def _covariance_of_squares(Q: Array, residuals: Residuals) -> Array:
    """Covariance of ``Q' e^2`` for e of unit variance, but for a factor; unity where residuals are independent."""
    if residuals.group is None or residuals.tied is None:
        return np.eye(Q.shape[1])
    of_edges = sums_by(residuals.group, residuals.tied[:, None] * Q, int(residuals.group.max()) + 1)
    return np.asarray((Q * (1 - residuals.tied**2)[:, None]).T @ Q + of_edges.T @ of_edges)
