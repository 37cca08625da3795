"""Laws of many pairs: a table with one row for each pair, the reasons of pairs without a law, and each law itself."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.arrays import Array, Flags, Ints, Texts
from ...core.calls import check_share
from ...core.display import Display, Plottable, TextTable
from ...core.errors import FitmodelsError, UsageError
from ...datasets.runs import Runs, Source
from ..available import NotAvailable
from ..edges import EdgeInference
from ..lawfit import LawFit
from ..regression import power_law
from .pair_rows import PairRows

EDGE = "edge of the row"


@dataclass(frozen=True, slots=True)
class Estimates:
    """Results of K fits with up to p parameters; NaN, a count of 0 or an empty reason where a pair has none.

    Attributes
    ----------
    theta, se, row_se : ndarray, shape (K, p)
        ln c0 and exponents, their standard errors (by edge where ``by_edge``) and those of rows.
    least, most : ndarray, shape (K, p)
        Ends of the factors and, last, of the response among the usable rows.
    rss, tss : ndarray, shape (K,)
    nobs, n_edges, dropped : ndarray of int, shape (K,)
        Rows used, edges among them, rows left out.
    by_edge, stacked : ndarray of bool, shape (K,)
        Whether standard errors are by edge; whether the fit was batched.
    reason, edge_reason, left_out : ndarray of str, shape (K,)
        Why there is no law, why no standard errors by edge, which factors the law leaves out and why.
    """

    theta: Array
    se: Array
    row_se: Array
    least: Array
    most: Array
    rss: Array
    tss: Array
    nobs: Ints
    n_edges: Ints
    dropped: Ints
    by_edge: Flags
    stacked: Flags
    reason: Texts
    edge_reason: Texts
    left_out: Texts

    @property
    def df_model(self) -> Ints:
        """Exponents of each law, shape (K,); -1 where there is none."""
        return np.asarray(np.isfinite(self.theta).sum(axis=1) - 1)

    @property
    def df_resid(self) -> Ints:
        """Rows less parameters, shape (K,)."""
        return self.nobs - self.df_model - 1

    @property
    def df(self) -> Ints:
        """Degrees of freedom of t, p and intervals: edges less one, or those of the rows; shape (K,)."""
        return np.where(self.by_edge, self.n_edges - 1, self.df_resid)


def no_estimates(K: int, p: int) -> Estimates:
    """Arrays for K pairs and p parameters, not yet filled."""
    numbers = [np.full((K, p), np.nan) for _ in range(5)] + [np.full(K, np.nan) for _ in range(2)]
    counts = [np.zeros(K, dtype=np.intp) for _ in range(3)]
    flags = [np.zeros(K, dtype=bool) for _ in range(2)]
    return Estimates(*numbers, *counts, *flags, *(np.full(K, "", dtype=object) for _ in range(3)))


def enter(into: Estimates, i: int, law: LawFit, names: tuple[str, ...]) -> None:
    """Enter the law of pair i."""
    at = [names.index(name) for name in law.names]
    into.theta[i, at] = law.theta
    into.se[i, at] = np.sqrt(np.diag(law.covariance()))
    into.row_se[i, at] = np.nan if law.cov_theta is None else np.sqrt(np.diag(law.cov_theta))
    into.rss[i], into.tss[i], into.nobs[i] = law.rss, law.tss, law.nobs
    into.n_edges[i] = law.n_edges or 0
    into.dropped[i] = sum(item.count for item in law.dropped)
    into.by_edge[i] = isinstance(law.edges, EdgeInference)
    into.edge_reason[i] = "" if isinstance(law.edges, EdgeInference) else law.edges.reason
    into.left_out[i] = "; ".join(f"{item.factor} {item.reason}" for item in law.left_out)


def single_law(rows: PairRows, mine: Ints, response: str, factors: tuple[str, ...]) -> LawFit | str:
    """The law of the rows ``mine`` (positions among all), or the reason why there is none."""
    infinite = [(name, i) for name, values in rows.raw.items() for i in mine[np.isinf(values[mine])][:1]]
    if infinite:
        name, i = infinite[0]
        return f"column {name!r} row {i}: {rows.raw[name][i]} is not a measurement; leave the row out."
    data = pd.DataFrame({name: values[mine] for name, values in rows.raw.items()})
    if rows.edge is not None:
        data[EDGE] = rows.edge[mine].astype(object)
    source = Source("rows of one pair", "", len(mine), "in memory")
    pair = rows.names.iloc[rows.number[mine[:1]]]
    tool, work = ("".join(map(str, pair[role])) if role in pair else "" for role in ("tool", "work"))
    runs = Runs(data, {}, (), mine, source, tool, work)
    try:
        return power_law(runs, response, factors, edge=None if rows.edge is None else EDGE)
    except FitmodelsError as error:
        return str(error)
    except np.linalg.LinAlgError as error:
        return f"{response}: no law, since {error}. Fit the pair with fewer factors."


@dataclass(frozen=True, slots=True, repr=False)
class ManyLaws(Plottable):
    """Power laws of many pairs, fitted to ln response.

    Attributes
    ----------
    response : str
    factors : tuple of str
    pairs : DataFrame, K rows
        The columns that name the pairs, in the order in which the rows name them.
    estimates : Estimates
        The numbers as arrays, one row for each pair.
    rows : PairRows
        Rows of all pairs, from which ``laws[i]`` fits the law of one pair in full.
    """

    response: str
    factors: tuple[str, ...]
    pairs: pd.DataFrame
    estimates: Estimates
    rows: PairRows = field(compare=False)

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, i: int) -> LawFit | NotAvailable:
        """The law of pair i with its rows, as ``power_law`` fits it, or the reason why there is none."""
        if not -len(self) <= i < len(self):
            raise IndexError(f"pair {i} of {len(self)}")
        mine = np.flatnonzero(self.rows.number == i % len(self))
        found = single_law(self.rows, mine, self.response, self.factors)
        return found if isinstance(found, LawFit) else NotAvailable(found)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters: ``c0`` and the factors."""
        return ("c0", *self.factors)

    @property
    def fitted(self) -> Flags:
        """Whether each pair has a law, shape (K,)."""
        return np.asarray(self.estimates.reason == "", dtype=bool)

    @property
    def one_by_one(self) -> int:
        """Number of pairs that were fitted singly, with a law or without."""
        return int((~self.estimates.stacked).sum())

    @property
    def reasons(self) -> "pd.Series[str]":
        """Reasons of the pairs without a law, indexed by the columns that name them."""
        no = ~self.fitted
        return pd.Series(self.estimates.reason[no], index=self._index()[no], name="reason", dtype=object)

    @property
    def params(self) -> pd.DataFrame:
        """Coefficients, a row a pair, a column a parameter; NaN where a law leaves it out."""
        return self._frame(self._of_parameters()["params"])

    @property
    def bse(self) -> pd.DataFrame:
        """Standard errors of ``params``, by edge where the edges of a pair allow it."""
        return self._frame(self._of_parameters()["bse"])

    @property
    def row_bse(self) -> pd.DataFrame:
        """Standard errors with rows taken as independent, as the papers print them."""
        return self._frame(self._of_parameters()["row_bse"])

    @property
    def tvalues(self) -> pd.DataFrame:
        """``params / bse``."""
        return self._frame(self._of_parameters()["tvalues"])

    @property
    def pvalues(self) -> pd.DataFrame:
        """Two-sided p of each parameter against zero."""
        return self._frame(self._of_parameters()["pvalues"])

    @property
    def table(self) -> pd.DataFrame:
        """One row a pair: its names, the fit as a whole, then each parameter with its error, t and p.

        Columns: those of the pair; ``nobs, n_edges, df, df_resid, rsquared, rsquared_adj, fvalue, f_pvalue,
        scale_se, response_from, response_to``; ``params_V, bse_V, row_bse_V, tvalues_V, pvalues_V`` and so on;
        ``from_V, to_V`` and so on, the ends of each factor of the law among its rows; ``by_edge, dropped, left_out,
        edge_reason, reason``. A pair without a law keeps its row, with NaN and its reason.
        """
        found = pd.DataFrame(self.columns())
        twice = [name for name in self.pairs if name in found]
        if twice:
            raise UsageError(f"the column {twice[0]!r} that names the pairs is also one of the table; rename it.")
        return pd.concat([self.pairs, found], axis=1)

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of ``table`` but those of the pair, as arrays of shape (K,)."""
        parts, made = self._of_parameters(), self.estimates
        found = {f"{part}_{name}": parts[part][:, j] for j, name in enumerate(self.names) for part in parts}
        notes = {name: getattr(made, name) for name in ("by_edge", "dropped", "left_out", "edge_reason", "reason")}
        return {**self._whole(), **found, **self._domain(), **notes}

    def conf_int(self, level: float = 0.95) -> pd.DataFrame:
        """Intervals at ``level``: the pair's columns, then ``low_V, high_V`` and so on; NaN where there are none."""
        return pd.concat([self.pairs, pd.DataFrame(self.ends(level))], axis=1)

    def ends(self, level: float = 0.95) -> dict[str, Array]:
        """The columns of ``conf_int`` but those of the pair, as arrays of shape (K,)."""
        from scipy.special import stdtrit

        check_share("level", level)
        made = self.estimates
        half = stdtrit(np.maximum(made.df, 1), (1 + level) / 2)[:, None] * made.se
        ends = {"low": made.theta - half, "high": made.theta + half}
        with np.errstate(over="ignore"):
            for end in ends.values():
                end[:, 0] = np.exp(end[:, 0])
        return {f"{at}_{name}": ends[at][:, j] for j, name in enumerate(self.names) for at in ends}

    def to_frame(self) -> pd.DataFrame:
        """``table``."""
        return self.table

    def _whole(self) -> dict[str, Array]:
        """Statistics of each law as a whole; NaN where ``LawFit`` gives None."""
        from scipy.special import fdtrc

        made = self.estimates
        n, df, k = (v.astype(float) for v in (made.nobs, made.df_resid, made.df_model))
        with np.errstate(divide="ignore", invalid="ignore"):
            R2 = np.where(np.isnan(made.tss), np.nan, np.where(made.tss > 0, 1 - made.rss / made.tss, 1.0))
            free = (df > 0) & self.fitted
            adjusted = np.where(free, 1 - (1 - R2) * (n - 1) / df, np.nan)
            found = free & (k > 0) & (made.rss > 0)
            F = np.where(found, (made.tss - made.rss) / k / (made.rss / df), np.nan)
            scale = np.where(free, np.sqrt(made.rss / df), np.nan)
        p = np.full(len(F), np.nan)
        p[found] = fdtrc(k[found], df[found], np.maximum(F[found], 0.0))
        ends = [np.where(self.fitted, of[:, -1], np.nan) for of in (made.least, made.most)]
        return {"nobs": made.nobs, "n_edges": made.n_edges, "df": made.df, "df_resid": made.df_resid, "rsquared": R2,
                "rsquared_adj": adjusted, "fvalue": F, "f_pvalue": p, "scale_se": scale,
                "response_from": ends[0], "response_to": ends[1]}  # fmt: skip

    def _domain(self) -> dict[str, Array]:
        """Ends of the factors of each law, as ``LawFit.domain``; NaN where a law leaves one out."""
        made, without = self.estimates, np.isnan(self.estimates.theta[:, 1:])
        of = {"from": np.where(without, np.nan, made.least[:, :-1]), "to": np.where(without, np.nan, made.most[:, :-1])}
        return {f"{end}_{name}": of[end][:, j] for j, name in enumerate(self.factors) for end in of}

    def _of_parameters(self) -> dict[str, Array]:
        """Coefficients, their errors, t and p, each of shape (K, p)."""
        from scipy.special import stdtr

        made = self.estimates
        params, slope = made.theta.copy(), np.ones_like(made.theta)  # slope: derivative of a coefficient by theta
        params[:, 0] = slope[:, 0] = np.exp(made.theta[:, 0])
        bse = made.se * slope
        with np.errstate(divide="ignore", invalid="ignore"):
            t = params / bse
        p = 2 * stdtr(np.maximum(made.df, 1)[:, None], -np.abs(t))
        return {"params": params, "bse": bse, "row_bse": made.row_se * slope, "tvalues": t, "pvalues": p}

    def _index(self) -> "pd.Index[str]":
        one = len(self.pairs.columns) == 1
        return pd.Index(self.pairs.iloc[:, 0]) if one else pd.MultiIndex.from_frame(self.pairs)

    def _frame(self, values: Array) -> pd.DataFrame:
        return pd.DataFrame(values, index=self._index(), columns=list(self.names))

    def _display(self) -> Display:
        params, ok = self.params[self.fitted], int(self.fitted.sum())
        head = f"{self.response} on {', '.join(self.factors)}: laws of {ok} of {len(self)} pairs"
        single = f", {self.one_by_one} of them fitted singly" if self.one_by_one else ""
        quarters = params.quantile([0.25, 0.5, 0.75]) if ok else params
        rows = tuple((name, *(f"{v:.3g}" for v in quarters[name])) for name in self.names) if ok else ()
        grid = TextTable(("", "first quartile", "median", "third quartile"), rows) if rows else None
        words = [f"{pair}: {reason}" for pair, reason in self.reasons.head(3).items()]
        return Display(head + single, (), grid, tuple(words))
