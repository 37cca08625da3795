"""Does a law rest on one edge or row: leverage, Cook's distance and DFBETAS.

Sources: Cook & Weisberg 1982, Residuals and Influence in Regression; Belsley, Kuh & Welsch 1980, Regression
Diagnostics.
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import ByRule
from .columns import Array, linear_columns
from .deletion import ALONE, Deletion
from .strata import Strata, covariance

LOOK, ACT = 0.2, 0.5  # quantiles of F beside which Cook's distance is set (Kutner et al. 2005, section 10.4)
MOST_SHOWN = 99  # beyond it, how much is no news


@dataclass(frozen=True, slots=True, repr=False)
class Influence(Displayable, ByRule):
    """How much the law rests on single edges or rows.

    Attributes
    ----------
    units, names, leverage
        As in :class:`Deletion`.
    parameters : tuple of str, length p
    cook : ndarray, shape (u,)
        Cook's distance; by edge against the covariance that a random level of each edge gives.
    dfbetas : ndarray, shape (u, p)
        Standard errors by which the unit pulls each parameter; rows have the error without the row.
    """

    units: str
    names: tuple[str, ...]
    parameters: tuple[str, ...]
    leverage: Array
    cook: Array
    dfbetas: Array

    @property
    def null(self) -> str:
        """What is looked for."""
        return f"no single one of the {self.units} decides the law"

    @property
    def statistic(self) -> float:
        """Largest Cook's distance."""
        return float(self.cook.max())

    @property
    def df(self) -> tuple[int, int]:
        """Degrees of freedom of the F that Cook's distance is set beside: p, and units less p."""
        p = len(self.parameters)
        return p, max(len(self.names) - p, 1)

    @property
    def leverage_limit(self) -> float:
        """Twice the mean leverage."""
        return 2 * len(self.parameters) / len(self.names)

    @property
    def cook_limit(self) -> float:
        """Median of F on ``df``: beyond it the law leaves the middle of its own confidence region."""
        from scipy.special import fdtri

        return float(fdtri(*self.df, ACT))

    @property
    def dfbetas_limit(self) -> float:
        """``2 / sqrt(u)``: worth a look; some always pass it."""
        return float(2 / len(self.names) ** 0.5)

    @property
    def beyond(self) -> dict[str, tuple[str, ...]]:
        """Names of the units beyond each limit, worst first: ``leverage``, ``cook``, ``dfbetas``."""
        most = np.abs(self.dfbetas).max(axis=1)
        limits = {
            "leverage": (self.leverage, self.leverage_limit),
            "cook": (self.cook, self.cook_limit),
            "dfbetas": (most, self.dfbetas_limit),
        }
        return {
            key: tuple(self.names[i] for i in np.argsort(-values) if values[i] > limit)
            for key, (values, limit) in limits.items()
        }

    @property
    def concern(self) -> int:
        """0 fine; 1 above the .2 quantile of F on ``df``, 2 above its median. Cause: an outlier or a lone corner."""
        from scipy.special import fdtr

        share = float(fdtr(*self.df, self.statistic))
        return int(share > LOOK) + int(share > ACT)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"no {self.units[:-1]} decides it (Cook at most {self.statistic:.2f})"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        if not self.concern:
            return f"No {self.units[:-1]} decides the law (Cook at most {self.statistic:.2f})."
        g = int(np.argmax(self.cook))
        slopes = np.abs(self.dfbetas[g, 1:])  # the constant stands far outside the conditions and follows them
        j = 1 + int(np.argmax(slopes))
        who = f"edge {self.names[g]}" if self.units == "edges" else self.names[g]
        decides = "decides the law" if self.concern == 2 else "pulls hard"
        cook = f"{self.cook[g]:.2g}" if self.cook[g] < MOST_SHOWN else f"above {MOST_SHOWN}"
        return (
            f"{who[0].upper() + who[1:]} {decides} (Cook {cook}): without it {self.parameters[j]} moves "
            f"by {abs(self.dfbetas[g, j]):.2g} standard errors; check its record, or cut it again."
        )


def influence(law: LawFit, strata: Strata | NotAvailable, left: Deletion) -> Influence:
    """Leverage, Cook's distance and DFBETAS from what leaving out does.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.deletion import deletion
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> found = influence(law, split(law), deletion(law, split(law)))
    >>> round(float(found.leverage.sum()), 6), found.concern
    (5.0, 0)
    """
    columns, back = linear_columns(law)
    moved = np.linalg.solve(back, left.moved.T)
    n, p = columns.shape
    if isinstance(strata, Strata):
        cov = covariance(columns, law, strata)
        se = np.sqrt(np.diag(back @ cov @ back.T))
        cook = np.einsum("ju,ju->u", moved, np.linalg.solve(cov, moved)) / p
        return Influence(left.units, left.names, law.theta_names, left.leverage, cook, -left.moved / se)
    gram = columns.T @ columns
    cook = np.einsum("ju,jk,ku->u", moved, gram, moved) / (p * law.rss / law.df_resid)
    unscaled = np.sqrt(np.diag(back @ np.linalg.inv(gram) @ back.T))
    without = (law.rss - law.residuals * left.predicted) / max(n - p - 1, 1)
    # with one degree of freedom each row left out leaves an exact fit; its own scatter stands in
    without = np.where(without > ALONE * law.rss / law.df_resid, without, law.rss / law.df_resid)
    dfbetas = -left.moved / (np.sqrt(without)[:, None] * unscaled)
    return Influence(left.units, left.names, law.theta_names, left.leverage, cook, dfbetas)
