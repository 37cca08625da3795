"""What a fit of a stream returns: what LawFit has, but for all that looks at rows one by one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.display import Display, Displayable
from ..available import NotAvailable
from ..edges import EdgeInference
from ..identifiable import LeftOut
from ..lawfit import LawFit
from ..laws import Error, Form, Law
from ..rows import By, Dropped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, repr=False)
class StreamedLaw(Displayable):
    """A power law of a stream of rows. Names of results are those of `LawFit`.

    Attributes
    ----------
    law : Law
        Formula and names.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        Parameters (the constant as its logarithm) and their covariance with rows taken as independent, None where
        observations equal parameters.
    nobs : int
        Rows used.
    rss, tss : float
        Residual and total sum of squares of the logarithm of the response.
    domain : mapping
        Lowest and highest value of each factor among the rows used.
    units : mapping
        Unit of the response and of each factor.
    by, left_out, dropped, notes
        As in `LawFit`; the lines in ``dropped`` are rows counted from 0 over all chunks.
    n_edges : int or None
        Cutting edges, None where the stream names none.
    rows_per_edge : float or None
        Harmonic mean of the rows an edge has.
    edges : EdgeInference or NotAvailable
        Inference by edge, or why these data do not allow it.
    """

    law: Law
    theta: Array
    cov_theta: Array | None
    nobs: int
    rss: float
    tss: float
    domain: Mapping[str, tuple[float, float]]
    units: Mapping[str, str]
    by: By | None
    left_out: tuple[LeftOut, ...]
    dropped: tuple[Dropped, ...]
    notes: tuple[str, ...]
    n_edges: int | None
    rows_per_edge: float | None
    edges: EdgeInference | NotAvailable

    def _display(self) -> Display:
        from ..display import of_law

        return of_law(cast(LawFit, self))

    @property
    def _moments(self) -> LawFit:
        """What follows from sums alone, by the formulas of `LawFit`: its rows are so many views of one NaN."""
        n, nan = self.nobs, np.array(np.nan)
        rows = np.broadcast_to(nan, (n,))
        return LawFit(
            self.law, "multiplicative", self.theta, self.cov_theta, np.broadcast_to(nan, (n, len(self.factors))),
            np.empty((0, 0)), rows, rows, rows, np.empty(0, dtype=np.intp), None, self.rss, self.tss, self.units,
            self.by, self.left_out, self.dropped, self.notes, 1, self.edges,
        )  # fmt: skip

    @property
    def error(self) -> Error:
        """``multiplicative``: residuals live in the logarithm of the response."""
        return "multiplicative"

    @property
    def form(self) -> Form:
        """``power``."""
        return self.law.form

    @property
    def response(self) -> str:
        """Symbol of the response."""
        return self.law.response

    @property
    def factors(self) -> tuple[str, ...]:
        """Symbols of the factors in the law."""
        return self.law.factors

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters: constant, factors, then shifts as ``material[2]``."""
        return self._moments.names

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Names of ``theta``: as ``names``, the constant as ``ln c0``."""
        return self._moments.theta_names

    @property
    def df_model(self) -> int:
        """Number of parameters besides the constant."""
        return len(self.theta) - 1

    @property
    def df_resid(self) -> int:
        """Observations less parameters, rows taken as independent."""
        return self.nobs - len(self.theta)

    @property
    def df(self) -> int:
        """Degrees of freedom of t, p and intervals: edges less one, or those of the rows."""
        return self._moments.df

    @property
    def no_interval(self) -> str | None:
        """Why there is no interval, or None where there is one."""
        return self._moments.no_interval

    @property
    def params(self) -> "pd.Series[float]":
        """Coefficients, indexed by ``names``."""
        return self._moments.params

    @property
    def cov_params(self) -> pd.DataFrame:
        """Covariance of ``params``, the constant by the delta method."""
        return self._moments.cov_params

    def covariance(self) -> Array:
        """Covariance of ``theta`` that standard errors and intervals stand on, shape (p, p)."""
        return self._moments.covariance()

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``params``, by edge where the edges allow it."""
        return self._moments.bse

    @property
    def row_bse(self) -> "pd.Series[float]":
        """Standard errors of ``params`` with rows taken as independent."""
        return self._moments.row_bse

    @property
    def tvalues(self) -> "pd.Series[float]":
        """``params / bse``."""
        return self._moments.tvalues

    @property
    def pvalues(self) -> "pd.Series[float]":
        """Two-sided p of each parameter against zero."""
        return self._moments.pvalues

    @property
    def rsquared(self) -> float:
        """Share of the variance of the logarithm that the law explains."""
        return self._moments.rsquared

    @property
    def rsquared_adj(self) -> float | None:
        """R2 adjusted for degrees of freedom; None without any."""
        return self._moments.rsquared_adj

    @property
    def fvalue(self) -> float | None:
        """F of the whole law, rows taken as independent."""
        return self._moments.fvalue

    @property
    def f_pvalue(self) -> float | None:
        """P of ``fvalue``."""
        return self._moments.f_pvalue

    @property
    def scale_se(self) -> float | None:
        """Residual standard error, of the logarithm; None without degrees of freedom."""
        return self._moments.scale_se

    @property
    def scale_unit(self) -> str:
        """``ln``."""
        return "ln"

    def conf_int(self, level: float = 0.95) -> pd.DataFrame:
        """Intervals of ``params`` at ``level``, columns ``low`` and ``high``."""
        return self._moments.conf_int(level)

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Coefficients as a frame: estimate, se, t, p, and the ends of their intervals."""
        return self._moments.table(level)

    def predict(self, new: Mapping[str, object] | pd.DataFrame) -> Array:
        """Tell the median of the response at new factor values, shape (n,), in its own unit."""
        return self._moments.predict(new)

    @property
    def df_between(self) -> int | None:
        """Edges less parameters told between them, 1 or more; None without inference by edge."""
        edges = self.edges
        if isinstance(edges, NotAvailable):
            return None
        return max(edges.n_edges - len(edges.within) + sum(edges.within), 1)

    @property
    def df_within(self) -> int | None:
        """Rows less edges less parameters told within them, 1 or more; None without inference by edge."""
        edges = self.edges
        if isinstance(edges, NotAvailable):
            return None
        return max(self.nobs - edges.n_edges - sum(edges.within), 1)

    @property
    def checks(self) -> NotAvailable:
        """Why a stream is not checked."""
        return NotAvailable("checks look at rows one by one and a stream keeps none: fit a sample of it in memory")

    @property
    def smearing(self) -> NotAvailable:
        """Why there is no mean of exp(residual)."""
        return NotAvailable("residuals need the law first, and a stream passes once: the value of the law is a median")

    @property
    def region(self) -> NotAvailable:
        """Why there is no region by leverage."""
        return NotAvailable("a stream keeps no rows to draw the region from: each factor has its range instead")

    @property
    def alternative(self) -> NotAvailable:
        """Why there is no fit with additive errors."""
        return NotAvailable("least squares in natural units takes several passes, and a stream passes once")

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Each parameter but the constant, within two standard errors."""
        from ..figures import coefficients

        return coefficients(list(self.theta_names[1:]), self.theta[1:], self.bse.to_numpy()[1:], ax)
