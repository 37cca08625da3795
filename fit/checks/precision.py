"""Signal to noise of a law: the range of its predictions over their standard error.

Source: Myers, Montgomery & Anderson-Cook, Response Surface Methodology (adequate precision).
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import ByRule
from .columns import linear_columns
from .evidence import has_repeated_edges, no_scatter
from .strata import Strata, covariance

LEAST_PRECISION = 4.0  # signal to noise below which a law cannot steer


@dataclass(frozen=True, slots=True, repr=False)
class Precision(Displayable, ByRule):
    """Adequate precision: range of the predictions over their mean standard error.

    Attributes
    ----------
    statistic : float
    by_edge : bool
        Whether the standard error counts edges (a random level of each) or independent rows.
    """

    statistic: float
    by_edge: bool

    @property
    def null(self) -> str:
        """What is looked for."""
        return f"the law's signal is at least {LEAST_PRECISION:g} times its noise over the rows"

    @property
    def concern(self) -> int:
        """0 fine, 2 below 4. Cause: narrow ranges or few edges. Cure: widen them."""
        return 2 * int(self.statistic < LEAST_PRECISION)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"signal to noise {self.statistic:.3g}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        if self.concern:
            return (
                f"Signal to noise is {self.statistic:.2g}, below {LEAST_PRECISION:g}: the conditions move the response "
                "too little to steer by; widen their ranges or repeat."
            )
        return (
            f"Signal to noise is {self.statistic:.3g}, above {LEAST_PRECISION:g}: the law can steer within its range."
        )


def precision(law: LawFit, strata: Strata | NotAvailable) -> Precision | NotAvailable:
    """Adequate precision on the scale of the fit.

    With independent rows the mean variance of prediction is ``p s^2 / n``, as in the books; with edges it is
    that of the law with a random level of each.
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    eta = np.log(law.fitted) if law.error == "multiplicative" else law.fitted
    if not isinstance(strata, Strata):
        if has_repeated_edges(law):
            return strata
        variance = law.rss / law.df_resid * len(law.theta) / law.nobs
    else:
        columns, _ = linear_columns(law)
        variance = float(np.einsum("ij,ij->", columns @ covariance(columns, law, strata), columns)) / law.nobs
    return Precision(float(np.ptp(eta)) / variance**0.5, isinstance(strata, Strata))
