"""What a fit returns: facts only. Rounding, words and pictures are made elsewhere, from these."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import get_args, overload

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.display import Plottable
from ..core.errors import FitError, UsageError
from ..core.intervals import Centre, Edge, Kind
from .available import NotAvailable
from .edges import EdgeInference
from .identifiable import LeftOut
from .laws import Error, Form, Law
from .rows import By, Dropped

Array = NDArray[np.float64]


def as_table(response: str, new: Mapping[str, object] | pd.DataFrame) -> pd.DataFrame:
    """Single values and columns of one length as a table."""
    columns = {str(name): np.atleast_1d(np.asarray(values)) for name, values in new.items()}
    n = max((len(values) for values in columns.values() if len(values) != 1), default=1)
    odd = [name for name, values in columns.items() if values.shape not in ((1,), (n,))]
    if odd:
        raise FitError(
            f"{response}: {odd[0]} has shape {columns[odd[0]].shape}; each factor is one value or a column of {n}."
        )
    return pd.DataFrame({name: np.broadcast_to(values, n) for name, values in columns.items()})


@dataclass(frozen=True, slots=True, repr=False)
class LawFit(Plottable):
    """A fitted law. Names of results follow statsmodels, letters the papers.

    Attributes
    ----------
    law : Law
        Formula and names.
    error : {"multiplicative", "additive"}
        Where the residuals live: in the logarithm of the response, or in its own unit.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        Parameters as they were fitted (the constant of a power or exponential law as its logarithm) and
        their covariance with rows taken as independent, None where observations equal parameters.
    X, observed, fitted, residuals : ndarray
        Factors (n, k), response, prediction (n,) in their units, and residuals on the scale of ``error``.
    lines : ndarray of int, shape (n,)
        Line of each row in the data file.
    edge : ndarray of str, shape (n,), or None
        Cutting edge of each row.
    rss, tss : float
        Residual and total sum of squares on the scale of ``error``.
    units : mapping
        Unit of the response and of each factor.
    by : By or None
        Category whose levels multiply the law by exp(shift), or move a line by the shift.
    left_out, dropped, notes
        Factors and rows that were left out, each with its reason, and what else should be known.
    repeats : int
        How often the file repeats each measurement; only one of each was used.
    edges : EdgeInference or NotAvailable
        Inference by edge, or why these data do not allow it. Where it is there, standard errors, t, p and
        intervals are by edge; R2, F and the residual standard error are always the papers', of rows.
    """

    law: Law
    error: Error
    theta: Array
    cov_theta: Array | None
    X: Array
    shifts: Array
    observed: Array
    fitted: Array
    residuals: Array
    lines: NDArray[np.intp]
    edge: NDArray[np.object_] | None
    rss: float
    tss: float
    units: Mapping[str, str]
    by: By | None
    left_out: tuple[LeftOut, ...]
    dropped: tuple[Dropped, ...]
    notes: tuple[str, ...]
    repeats: int
    edges: EdgeInference | NotAvailable = field(default=NotAvailable("not asked for"))

    @property
    def form(self) -> Form:
        """``power``, ``exponential``, ``load_line`` or ``feed_line``."""
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
        levels = () if self.by is None else tuple(f"{self.by.column}[{level}]" for level in self.by.levels)
        return (*self.law.names, *levels)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Names of ``theta``: as ``names``, with ``ln`` before a constant that is held as a logarithm."""
        first, *rest = self.names
        return (f"ln {first}" if self.law.logarithmic else first, *rest)

    @property
    def nobs(self) -> int:
        """Number of observations used."""
        return len(self.observed)

    @property
    def n_edges(self) -> int | None:
        """Number of cutting edges among them, None where the file names none."""
        return None if self.edge is None else len(set(self.edge))

    @property
    def df_model(self) -> int:
        """Number of parameters besides the constant."""
        return len(self.theta) - 1

    @property
    def df_resid(self) -> int:
        """Observations less parameters, rows taken as independent."""
        return self.nobs - len(self.theta)

    @property
    def no_interval(self) -> str | None:
        """Why there is no interval, or None where there is one."""
        if self.df_resid > 0:
            return None
        return f"no interval: {self.nobs} observations fix {len(self.theta)} parameters exactly"

    @property
    def params(self) -> "pd.Series[float]":
        """Coefficients, indexed by ``names``."""
        return pd.Series(self.law.coefficients(self.theta), index=list(self.names), name=self.response)

    @property
    def cov_params(self) -> pd.DataFrame:
        """Covariance of ``params``, the constant of a logarithmic law by the delta method; NaN if none."""
        slope = np.ones(len(self.theta))
        if self.law.logarithmic:
            slope[0] = np.exp(self.theta[0])
        cov = self.covariance() * np.outer(slope, slope)
        return pd.DataFrame(cov, index=list(self.names), columns=list(self.names))

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``params``, by edge where the edges allow it."""
        return pd.Series(np.sqrt(np.diag(self.cov_params)), index=list(self.names), name="bse")

    @property
    def row_bse(self) -> "pd.Series[float]":
        """Standard errors of ``params`` as the papers print them, rows taken as independent."""
        return replace(self, edges=NotAvailable("rows were asked for")).bse

    @property
    def df(self) -> int:
        """Degrees of freedom of t, p and intervals: edges less one, or those of the rows."""
        return self.edges.df if isinstance(self.edges, EdgeInference) else self.df_resid

    @property
    def tvalues(self) -> "pd.Series[float]":
        """``params / bse``; infinite where the fit is exact."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = self.params.to_numpy() / self.bse.to_numpy()
        return pd.Series(t, index=list(self.names), name="t")

    @property
    def pvalues(self) -> "pd.Series[float]":
        """Two-sided p of each parameter against zero."""
        from scipy.special import stdtr

        p = 2 * stdtr(max(self.df, 1), -np.abs(self.tvalues.to_numpy()))
        return pd.Series(p, index=list(self.names), name="p")

    @property
    def alternative(self) -> "LawFit | None":
        """The same law with the other error structure, fitted when it is asked for; None if it has none."""
        from .regression import other_structure

        return other_structure(self)

    @property
    def rsquared(self) -> float:
        """Share of the variance explained, on the scale of ``error``."""
        return 1.0 - self.rss / self.tss if self.tss > 0 else 1.0

    @property
    def rsquared_adj(self) -> float | None:
        """R2 adjusted for degrees of freedom; None without any."""
        if self.df_resid <= 0:
            return None
        return 1.0 - (1.0 - self.rsquared) * (self.nobs - 1) / self.df_resid

    @property
    def fvalue(self) -> float | None:
        """F of the whole law, as the papers print it; None without residual or without factors."""
        if self.df_resid <= 0 or self.df_model == 0 or self.rss <= 0:
            return None
        return (self.tss - self.rss) / self.df_model / (self.rss / self.df_resid)

    @property
    def f_pvalue(self) -> float | None:
        """P of ``fvalue``."""
        from scipy.special import fdtrc

        F = self.fvalue
        return None if F is None else float(fdtrc(self.df_model, self.df_resid, max(F, 0.0)))

    @property
    def scale_se(self) -> float | None:
        """Residual standard error (the papers' SE), in ``scale_unit``; None without degrees of freedom."""
        return float(np.sqrt(self.rss / self.df_resid)) if self.df_resid > 0 else None

    @property
    def scale_unit(self) -> str:
        """``ln`` for multiplicative errors, else the unit of the response."""
        return "ln" if self.error == "multiplicative" else self.units.get(self.response, "")

    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of each factor among the rows used."""
        low, high = self.X.min(axis=0), self.X.max(axis=0)
        return {name: (float(low[j]), float(high[j])) for j, name in enumerate(self.factors)}

    def conf_int(self, level: float = 0.95) -> pd.DataFrame:
        """Intervals of ``params`` at ``level``, columns ``low`` and ``high``; NaN where there are none.

        The constant of a logarithmic law gets the interval of its logarithm, so its low end stays positive.
        """
        half = self._quantile(level) * np.sqrt(np.diag(self.covariance()))
        low = self.law.coefficients(self.theta - half)
        high = self.law.coefficients(self.theta + half)
        return pd.DataFrame({"low": low, "high": high}, index=list(self.names))

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Coefficients as a frame: estimate, se, t, p, and the ends of their intervals, ``low`` and ``high``."""
        held = {"estimate": self.params, "se": self.bse, "t": self.tvalues, "p": self.pvalues}
        return pd.DataFrame(held).join(self.conf_int(level))

    @overload
    def predict(self, new: Mapping[str, object] | pd.DataFrame, interval: None = None) -> Array: ...
    @overload
    def predict(
        self,
        new: Mapping[str, object] | pd.DataFrame,
        interval: Kind,
        level: float = 0.95,
        *,
        edge: Edge = "new",
        coverage: float = 0.95,
        centre: Centre = "median",
    ) -> pd.DataFrame: ...
    def predict(
        self,
        new: Mapping[str, object] | pd.DataFrame,
        interval: Kind | None = None,
        level: float = 0.95,
        *,
        edge: Edge = "new",
        coverage: float = 0.95,
        centre: Centre = "median",
    ) -> Array | pd.DataFrame:
        """The law at new factor values, in the unit of the response.

        Parameters
        ----------
        new : mapping or DataFrame
            A value or column for each factor, and the category of ``by`` under its name; for ``edge="same"``
            a column ``edge`` that names edges of the fit.
        interval : None, "mean", "prediction" or "tolerance"
            None gives an array, shape (n,): with multiplicative errors it is the median. Otherwise a
            DataFrame ``value, low, high, inside`` whose ``attrs["words"]`` say what these are: "mean" is about
            the law itself, "prediction" about one new row, "tolerance" holds a share of all rows there.
        level, edge, coverage, centre
            As in ``fit.interval``, which makes the DataFrame.

        Raises
        ------
        FitError
            A factor is missing, not positive where the law takes its logarithm, columns differ in length, or
            there is no interval.
        UsageError
            An option that does not exist, or a level or coverage that is not between 0 and 1.
        """
        if interval is None:
            return self.law.response_at(self.theta, self.design_of(as_table(self.response, new)))
        if interval not in get_args(Kind):
            raise UsageError(f"interval={interval!r}: it is None, {', '.join(map(repr, get_args(Kind)))}.")
        from .intervals import interval as of_law

        return of_law(self, new, interval, edge=edge, level=level, coverage=coverage, centre=centre)

    def covariance(self) -> Array:
        """Covariance of ``theta`` that standard errors and intervals stand on, shape (p, p); NaN if there is none."""
        p = len(self.theta)
        if isinstance(self.edges, EdgeInference):
            return self.edges.cov_theta
        return np.full((p, p), np.nan) if self.cov_theta is None else self.cov_theta

    def _quantile(self, level: float) -> float:
        from scipy.special import stdtrit

        if not 0 < level < 1:
            raise FitError(f"level {level} of an interval: it lies between 0 and 1, for instance 0.95.")
        return float(stdtrit(max(self.df, 1), (1 + level) / 2))

    def design_of(self, new: pd.DataFrame) -> Array:
        """Columns of the linear form at new factor values, shape (n, p); FitError names what they lack."""
        missing = [name for name in self.factors if name not in new]
        if missing:
            raise FitError(
                f"{self.response} needs {', '.join(missing)}; given: {', '.join(map(str, new)) or 'nothing'}."
            )
        X = new[list(self.factors)].to_numpy(dtype=float)
        if self.form == "power" and (X <= 0).any():
            j = int(np.argmax((X <= 0).any(axis=0)))
            raise FitError(f"{self.factors[j]} {X[:, j].min():g}: a power law needs values above zero.")
        return self.law.design(X, self._shifts_of(new))

    def _shifts_of(self, new: pd.DataFrame) -> Array:
        if self.by is None:
            return np.empty((len(new), 0))
        known = (self.by.reference, *self.by.levels)
        if self.by.column not in new:
            raise FitError(f"the law was fitted by {self.by.column}: say which ({', '.join(known)}).")
        level = new[self.by.column].map(lambda v: f"{v:.15g}" if isinstance(v, float) else str(v))
        strange = sorted(set(level) - set(known))
        if strange:
            raise FitError(f"{self.by.column} {strange[0]!r} is not among the fitted: {', '.join(known)}.")
        return np.column_stack([(level == name).to_numpy(dtype=float) for name in self.by.levels])
