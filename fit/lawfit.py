"""The fitted law: parameters, their covariance, statistics, source and, where they are in memory, its rows."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.arrays import Array, Flags
from ..core.calls import Conditions, Takes, check_share
from ..core.censored import LifeDistribution
from ..core.errors import FitError
from ..core.intervals import Kind, t_quantile
from ..core.predictions import Prediction
from ..core.predicts import Predicts
from .available import NotAvailable
from .edges import EdgeInference
from .fitted_rows import FittedRows, LawFigures, LawSource, RowAccess
from .laws import Error, LawForm
from .prediction import predicted
from .region import DesignRegion, design_region
from .rows import By, Dropped, LeftOut, as_table, level_names

if TYPE_CHECKING:
    from .edge_sums import EdgeSums

NOT_ASKED, NO_SOURCE = NotAvailable("not asked for"), LawSource()
ROUNDING = 1e-11  # relative residual below which a law meets its rows exactly


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class LawFit(Predicts, RowAccess, LawFigures):
    """A fitted law. Names of results follow statsmodels, letters the papers.

    Attributes
    ----------
    formula : LawForm
        Form, response and factors.
    error : {"multiplicative", "additive"}
        Scale of the residuals: the logarithm of the response, or its own unit.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        Parameters as they were fitted (the constant of a power or exponential law as its logarithm) and
        their covariance with rows taken as independent, None where observations equal parameters.
    nobs : int
        Number of observations used.
    rss, tss : float
        Residual and total sum of squares on the scale of ``error``.
    domain : mapping
        Lowest and highest value of each factor among the rows used.
    response_range : (float, float) or None
        Lowest and highest response among the rows used, None where they are known by their sums alone.
    units : mapping
        Unit of the response and of each factor.
    n_edges : int or None
        Number of cutting edges, None where the file names none.
    edges : EdgeInference or NotAvailable
        Inference by edge, or why these data do not allow it. Where it is there, standard errors, t, p and
        intervals are by edge; R2, F and the residual standard error are always the papers', of rows.
    by : By or None
        Category whose levels multiply the law by exp(shift), or move a line by the shift.
    left_out, dropped, notes
        Factors and rows that were left out, each with its reason, and what else should be known. Of a stream the
        lines in ``dropped`` are rows counted from 0.
    repeats : int
        How often the file repeats each measurement; only one of each was used.
    source : LawSource
        Data file, tool, work, and whether the rows are simulated.
    selected : bool
        Whether AICc chose its terms on its own rows: its intervals and p-values are somewhat too small.
    life : LifeDistribution or None
        Of a law of tool lives: their distribution about the law, and how many are known by a bound alone.
    sums : EdgeSums or None
        Sums of products by edge that a law of a stream was fitted from; None for rows in memory.
    rows : FittedRows or None
        The rows, None for a law of a stream; also as ``X``, ``shifts``, ``observed``, ``fitted``, ``residuals``,
        ``lines`` and ``edge``.
    """

    formula: LawForm
    error: Error
    theta: Array
    cov_theta: Array | None
    nobs: int
    rss: float
    tss: float
    domain: Mapping[str, tuple[float, float]]
    units: Mapping[str, str]
    response_range: tuple[float, float] | None = None
    n_edges: int | None = None
    edges: EdgeInference | NotAvailable = NOT_ASKED
    by: By | None = None
    left_out: tuple[LeftOut, ...] = ()
    dropped: tuple[Dropped, ...] = ()
    notes: tuple[str, ...] = ()
    repeats: int = 1
    source: LawSource = NO_SOURCE
    selected: bool = False
    life: LifeDistribution | None = None
    sums: "EdgeSums | None" = field(default=None, compare=False)
    rows: FittedRows | None = None

    @classmethod
    def of_rows(cls, rows: FittedRows, formula: LawForm, **facts: Any) -> Self:  # noqa: ANN401
        """A law of rows in memory; their number, edges and ranges are taken from the rows."""
        return cls(formula=formula, rows=rows, **rows.extent(formula.factors), **facts)

    def with_rows(self, part: NDArray[Any] | slice = slice(None), **changes: Any) -> Self:  # noqa: ANN401
        """The law on part of its rows with changed fields, those of ``rows`` among them; ``edges`` stay as they are.

        Examples
        --------
        >>> from fitmodels import datasets, fit
        >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
        >>> law.with_rows(edge=None).n_edges is None
        True
        """
        own = {name: changes.pop(name) for name in FittedRows.__slots__ if name in changes}
        rows, formula = replace(self._in_memory.part(part), **own), changes.get("formula", self.formula)
        return replace(self, rows=rows, **rows.extent(formula.factors), **changes)

    @property
    def design(self) -> Array:
        """Columns of the linear form, shape (n, p)."""
        return self.formula.design(self.X, self.shifts)

    @property
    def gradient(self) -> Array:
        """Columns along which the fit is linear, shape (n, p): ``design``, or the gradient of an additive law."""
        return self.gradient_at(self.design)

    def gradient_at(self, Z: Array) -> Array:
        """Derivative by theta of the prediction on the scale of the errors, shape (m, p), for design Z."""
        return self.formula.scaled(self.theta, Z, self.error)[1]

    @property
    def free(self) -> Flags:
        """Mask of the elements of ``theta`` that were estimated, shape (p,); the others are fixed."""
        return self.formula.free(len(self.theta) - len(self.formula.names))

    @property
    def exact(self) -> bool:
        """Whether residuals are rounding alone."""
        size = 1.0 if self.error == "multiplicative" else float(np.abs(self.observed).max())
        return bool(np.sqrt(self.rss / self.nobs) <= ROUNDING * size)

    @property
    def region(self) -> DesignRegion:
        """The region of the design; FitError where its settings are too few to span one."""
        rows = self._in_memory
        return design_region(self.formula, rows.X, rows.shifts, rows.edge, self.by, self.units)

    @property
    def form(self) -> str:
        """``power``, ``exponential``, ``load_line`` or ``feed_line``."""
        return self.formula.name

    @property
    def response(self) -> str:
        """Symbol of the response."""
        return self.formula.response

    @property
    def factors(self) -> tuple[str, ...]:
        """Symbols of the factors in the law."""
        return self.formula.factors

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters: constant, factors, then shifts as ``material[2]``."""
        levels = () if self.by is None else tuple(f"{self.by.column}[{level}]" for level in self.by.levels)
        return (*self.formula.names, *levels)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Names of ``theta``: as ``names``, with ``ln`` before a constant that is held as a logarithm."""
        first, *rest = self.names
        return (f"ln {first}" if self.formula.logarithmic else first, *rest)

    @property
    def df_model(self) -> int:
        """Number of estimated parameters besides the constant."""
        return int(self.free.sum()) - 1

    @property
    def df_resid(self) -> int:
        """Observations, of tool lives those that ended, less estimated parameters; rows taken as independent."""
        return (self.nobs if self.life is None else self.life.ended) - int(self.free.sum())

    @property
    def no_interval(self) -> str | None:
        """Reason why there is no interval, or None."""
        if self.df_resid > 0:
            return None
        return f"no interval: {self.nobs} observations fix {self.df_model + 1} parameters exactly"

    @property
    def not_least_squares(self) -> str:
        """Reason why the law is not that of least squares of its rows, which then do not check it, or empty."""
        if self.life is None or self.life.least_squares:
            return ""
        known = f"{self.life.run_outs + self.life.earlier} of {self.nobs} lives are known by a bound alone"
        return known if self.life.censored else "the lives are Weibull and not lognormal"

    @property
    def params(self) -> "pd.Series[float]":
        """Coefficients, indexed by ``names``."""
        return pd.Series(self.formula.coefficients(self.theta), index=list(self.names), name=self.response)

    @property
    def cov_params(self) -> pd.DataFrame:
        """Covariance of ``params``, the constant of a logarithmic law by the delta method; NaN if none."""
        return pd.DataFrame(self._cov_params(), index=list(self.names), columns=list(self.names))

    def _cov_params(self) -> Array:
        slope = np.ones(len(self.theta))
        if self.formula.logarithmic:
            slope[0] = np.exp(self.theta[0])
        return self.covariance() * np.outer(slope, slope)

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``params``, by edge where the edges allow it."""
        return pd.Series(np.sqrt(np.diag(self._cov_params())), index=list(self.names), name="bse")

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
        with np.errstate(divide="ignore", invalid="ignore"):  # fixed ones have no error: NaN below
            t = self.params.to_numpy() / self.bse.to_numpy()
        return pd.Series(np.where(self.free, t, np.nan), index=list(self.names), name="t")

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
        """Share of the variance explained, on the scale of ``error``.

        Of lives known by a bound alone: ``1 - exp(2 (log L0 - log L) / n)`` (Cox & Snell), L0 without factors.
        """
        return 1.0 - self.rss / self.tss if self.tss > 0 else 1.0

    @property
    def rsquared_adj(self) -> float | None:
        """R2 adjusted for degrees of freedom; None without any."""
        if self.df_resid <= 0 or self.not_least_squares:
            return None
        return 1.0 - (1.0 - self.rsquared) * (self.nobs - 1) / self.df_resid

    @property
    def fvalue(self) -> float | None:
        """F of the whole law, as the papers print it; None without residual or factors, or with fixed exponents."""
        if self.df_resid <= 0 or self.df_model == 0 or self.rss <= 0 or self.formula.fixed or self.not_least_squares:
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

    def conf_int(self, level: float = 0.95) -> pd.DataFrame:
        """Intervals of ``params`` at ``level``, columns ``low`` and ``high``; NaN where there are none.

        The constant of a logarithmic law gets the interval of its logarithm, so its low end stays positive.
        """
        half = self.t_quantile(level) * np.sqrt(np.diag(self.covariance()))
        low = self.formula.coefficients(self.theta - half)
        high = self.formula.coefficients(self.theta + half)
        return pd.DataFrame({"low": low, "high": high}, index=list(self.names))

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Coefficients as a frame: estimate, se, t, p, and the ends of their intervals, ``low`` and ``high``."""
        held = {"estimate": self.params, "se": self.bse, "t": self.tvalues, "p": self.pvalues}
        return pd.DataFrame(held).join(self.conf_int(level))

    @property
    def _takes(self) -> Takes:
        units = {name: self.units.get(name, "") for name in self.factors}
        return Takes(f"the law of {self.response}", units, self.by.column if self.by else None, FitError)

    def _predicted(self, given: Conditions, *, kind: Kind, level: float, **other: Any) -> Prediction:  # noqa: ANN401
        return predicted(self, given, kind=kind, level=level, **other)

    def _values(self, given: Conditions) -> Any:  # noqa: ANN401
        table = as_table(self.response, given)
        found = self.formula.response_at(self.theta, self.design_of(table))
        return found if any(np.ndim(value) for value in given.values()) else found.item()

    def to_statsmodels(self) -> Any:  # noqa: ANN401  statsmodels has no types
        """The law as an OLS result of statsmodels, cluster-robust by edge; see ``statsmodels_ols.ols_results``."""
        from .statsmodels_ols import ols_results

        return ols_results(self)

    def covariance(self) -> Array:
        """Covariance of ``theta`` behind standard errors and intervals, shape (p, p); NaN if there is none."""
        p = len(self.theta)
        if isinstance(self.edges, EdgeInference):
            if not self.formula.fixed:
                return self.edges.cov_theta
            cov, free = np.zeros((p, p)), self.free
            cov[np.ix_(free, free)] = self.edges.cov_theta
            return cov
        return np.full((p, p), np.nan) if self.cov_theta is None else self.cov_theta

    def t_quantile(self, level: float) -> float:
        """Quantile of t on ``df`` degrees of freedom for a two-sided interval at ``level``."""
        check_share("level", level)
        return t_quantile(self.df, level)

    def design_of(self, new: pd.DataFrame) -> Array:
        """Columns of the linear form at new factor values, shape (n, p); FitError names what they lack."""
        missing = [name for name in self.factors if name not in new]
        if missing:
            raise FitError(
                f"{self.response} needs {', '.join(missing)}; given: {', '.join(map(str, new)) or 'nothing'}."
            )
        X = new[list(self.factors)].to_numpy(dtype=float)
        if self.formula.log_factors and (X <= 0).any():
            j = int(np.argmax((X <= 0).any(axis=0)))
            raise FitError(f"{self.factors[j]} {X[:, j].min():g}: a power law needs values above zero.")
        return self.formula.design(X, self._shifts_of(new))

    def _shifts_of(self, new: pd.DataFrame) -> Array:
        if self.by is None:
            return np.empty((len(new), 0))
        known = (self.by.reference, *self.by.levels)
        if self.by.column not in new:
            raise FitError(f"the law was fitted by {self.by.column}: give its level ({', '.join(known)}).")
        level = level_names(new[self.by.column], known, self.by.column)
        return np.column_stack([(level == name).astype(float) for name in self.by.levels])
