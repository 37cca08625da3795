"""What fitting many pairs returns: a table with a row a pair, and the reasons of those that have no law."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.display import Display, Plottable, TextTable
from ...core.errors import UsageError
from .estimates import Estimates

Array = NDArray[np.float64]


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
        The numbers as arrays, a row a pair.
    """

    response: str
    factors: tuple[str, ...]
    pairs: pd.DataFrame
    estimates: Estimates

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters: ``c0`` and the factors."""
        return ("c0", *self.factors)

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Which pairs have a law, shape (K,)."""
        return np.asarray(self.estimates.reason == "", dtype=bool)

    @property
    def one_by_one(self) -> int:
        """How many pairs went the careful way, with a law or without."""
        return int((~self.estimates.stacked).sum())

    @property
    def reasons(self) -> "pd.Series[str]":
        """Why a pair has no law, indexed by the columns that name it; empty where all have one."""
        no = ~self.fitted
        return pd.Series(self.estimates.reason[no], index=self._index()[no], name="reason", dtype=object)

    @property
    def params(self) -> pd.DataFrame:
        """Coefficients, a row a pair, a column a parameter; NaN where a law does without it."""
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
        scale_se``; ``params_V, bse_V, row_bse_V, tvalues_V, pvalues_V`` and so on; ``by_edge, dropped, left_out,
        edge_reason, reason``. A pair without a law keeps its row, with NaN and its reason.
        """
        told = pd.DataFrame(self.columns())
        twice = [name for name in self.pairs if name in told]
        if twice:
            raise UsageError(f"the column {twice[0]!r} that names the pairs is also one of the table; rename it.")
        return pd.concat([self.pairs, told], axis=1)

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of ``table`` but those of the pair, as arrays of shape (K,)."""
        parts, made = self._of_parameters(), self.estimates
        told = {f"{part}_{name}": parts[part][:, j] for j, name in enumerate(self.names) for part in parts}
        notes = {name: getattr(made, name) for name in ("by_edge", "dropped", "left_out", "edge_reason", "reason")}
        return {**self._whole(), **told, **notes}

    def conf_int(self, level: float = 0.95) -> pd.DataFrame:
        """Intervals at ``level``: the pair's columns, then ``low_V, high_V`` and so on; NaN where there are none."""
        return pd.concat([self.pairs, pd.DataFrame(self.ends(level))], axis=1)

    def ends(self, level: float = 0.95) -> dict[str, Array]:
        """The columns of ``conf_int`` but those of the pair, as arrays of shape (K,)."""
        from scipy.special import stdtrit

        if not 0 < level < 1:
            raise UsageError(f"level={level}: it lies between 0 and 1, for instance 0.95.")
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
            room = (df > 0) & self.fitted
            adjusted = np.where(room, 1 - (1 - R2) * (n - 1) / df, np.nan)
            told = room & (k > 0) & (made.rss > 0)
            F = np.where(told, (made.tss - made.rss) / k / (made.rss / df), np.nan)
            scale = np.where(room, np.sqrt(made.rss / df), np.nan)
        p = np.full(len(F), np.nan)
        p[told] = fdtrc(k[told], df[told], np.maximum(F[told], 0.0))
        return {"nobs": made.nobs, "n_edges": made.n_edges, "df": made.df, "df_resid": made.df_resid, "rsquared": R2,
                "rsquared_adj": adjusted, "fvalue": F, "f_pvalue": p, "scale_se": scale}  # fmt: skip

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
        careful = f", {self.one_by_one} of them fitted one by one" if self.one_by_one else ""
        quarters = params.quantile([0.25, 0.5, 0.75]) if ok else params
        rows = tuple((name, *(f"{v:.3g}" for v in quarters[name])) for name in self.names) if ok else ()
        grid = TextTable(("", "quarter below", "half below", "three quarters below"), rows) if rows else None
        words = [f"{pair}: {reason}" for pair, reason in self.reasons.head(3).items()]
        return Display(head + careful, (), grid, tuple(words))
