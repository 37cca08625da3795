"""Draws of the parameters of a law, and inference from them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from ...core.arrays import Array
from ...core.calls import Conditions, Takes, check_share
from ...core.display import Plottable
from ...core.errors import UsageError
from ...core.intervals import Kind as AnyKind
from ...core.predictions import Prediction
from ...core.predicts import Predicts
from ..available import NotAvailable
from ..edges import left_out_moves
from ..lawfit import LawFit
from ..prediction import inside_of, of_band
from ..rows import as_table
from .density import Errors, LawDensity, Method
from .priors import Priors
from .psis_loo import LeaveOut, leave_one_out, pareto_smoothed
from .sampling import PosteriorDraws, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FigureKind = Literal["marginals", "pairs", "predictive", "curves"]


def jackknife_of_level_model(density: LawDensity, phi: Array) -> "pd.Series[float] | None":
    """Jackknife standard errors by edge at the median of ``phi`` (S, p), indexed by the names of the law.

    The model assumes rows of an edge independent but for its level; the jackknife does not. Source: Bell & McCaffrey
    2002, Survey Methodology 28, 169, on rows whitened for the level.

    None where edges have no levels, or where one edge alone determines a coefficient.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> post = fit.posterior(law)
    >>> se = jackknife_of_level_model(post.density, post.sample.phi)
    >>> bool(0.7 < se["V"] / post.draws[:, 1].std() < 1.4)
    True
    """
    if not density.edges:
        return None
    middle = np.median(phi, axis=0)
    slopes = density.gradient(middle)
    k = np.exp(middle[density.p + 1])
    edge = np.repeat(np.arange(len(density.starts)), density.sizes.astype(int))
    rows = np.column_stack([slopes, density.residuals(middle[None])[0]])
    means = np.add.reduceat(rows, density.starts) / density.sizes[:, None]
    white = rows - ((1 - 1 / np.sqrt(1 + density.sizes * k))[:, None] * means)[edge]
    W, r = white[:, :-1], white[:, -1]
    moved = left_out_moves(W, r, np.linalg.inv(W.T @ W), edge, len(density.starts))
    if isinstance(moved, int):
        return None
    to_constant = np.eye(density.p)
    to_constant[0, 1:] = -density.centre[1:]
    G = len(density.starts)
    se = np.sqrt((G - 1) / G * np.sum((moved @ to_constant.T) ** 2, axis=0))
    return pd.Series(se, index=list(density.theta_names))


Kind = Literal["mean", "prediction"]
Edge = Literal["new", "same"]

MOST_EVALUATIONS, FEWEST_DRAWS = 40_000_000, 1000  # draws times rows, and draws that smoothed weights need
FINITE_VARIANCE = 0.5  # k-hat up to which a weighted mean has one


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Posterior(Predicts, PosteriorDraws):
    """Draws of the parameters of one law, with the attributes of ``PosteriorDraws`` and the law.

    Attributes
    ----------
    law : LawFit
    seed : int

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> post = fit.posterior(law, seed=1)
    >>> post.method, post.convergence.passed
    ('exact', True)
    """

    law: LawFit
    density: LawDensity
    seed: int

    @property
    def response(self) -> str:
        """Symbol of the response."""
        return self.law.response

    @property
    def priors(self) -> Priors:
        """Priors of the parameters."""
        return self.density.priors

    @property
    def errors(self) -> Errors:
        """``normal`` or ``student``."""
        return self.density.errors

    @property
    def _takes(self) -> Takes:
        return self.law._takes

    def _predicted(self, given: Conditions, *, kind: AnyKind, level: float, **other: Any) -> Prediction:  # noqa: ANN401
        """Credible interval of the law, or of a new row, at new points; the value is the median of the draws."""
        check_share("level", level)
        if kind == "tolerance" or other["centre"] != "median":
            raise UsageError(
                "draws give no tolerance limits and no other centre than the median; ask the law for them."
            )
        table, edge = as_table(self.response, given), other["edge"]
        draws = self.responses(table, kind, edge=edge)
        low, value, high = np.quantile(draws, [(1 - level) / 2, 0.5, (1 + level) / 2], axis=0)
        band = pd.DataFrame({"value": value, "low": low, "high": high, "inside": inside_of(self.law, table)[0]})
        of = "the law" if kind == "mean" else f"one row of {'a new edge' if edge == 'new' else 'the same edge'}"
        words = f"{100 * level:.4g} % credible interval for {of}, equal tails"
        band.attrs = {"kind": kind, "level": level, "coverage": None, "edge": edge, "centre": "median", "words": words}
        return of_band(self.law, given, table, band)

    def _values(self, given: Conditions) -> Any:  # noqa: ANN401
        return self._predicted(given, kind="mean", edge="new", level=0.95, centre="median").value

    def exceeds(
        self, new: Mapping[str, object] | pd.DataFrame, limit: float, kind: Kind = "prediction", *, edge: Edge = "new"
    ) -> Array:
        """Probability that the response exceeds ``limit`` at each new point, shape (m,)."""
        if not isinstance(limit, Real):
            raise UsageError(f"limit={limit!r}: give a number in the unit of {self.response}.")
        return np.asarray((self.responses(new, kind, edge=edge) > limit).mean(axis=0))

    def responses(self, new: Mapping[str, object] | pd.DataFrame, kind: Kind = "mean", *, edge: Edge = "new") -> Array:
        """The response of every draw at new points, shape (S, m), in its unit."""
        if kind not in ("mean", "prediction") or edge not in ("new", "same"):
            raise UsageError(f"kind={kind!r}, edge={edge!r}: 'mean' or 'prediction', of a 'new' or the 'same' edge.")
        Z = self.law.design_of(as_table(self.response, new))
        eta = self.draws[:, : len(self.law.theta)] @ Z.T
        logarithmic, natural = self.law.formula.logarithmic, self.density.natural
        if kind == "mean":
            return np.exp(eta) if logarithmic else eta
        scatter = self._scatter(eta.shape, edge)
        if natural:
            return (np.exp(eta) if logarithmic else eta) + scatter
        return np.exp(eta + scatter)

    def _scatter(self, shape: tuple[int, ...], edge: Edge) -> Array:
        """Error of one new row for each draw, on the scale of the errors; the same at every call."""
        rng = np.random.default_rng(self.seed)
        column = dict(zip(self.names, self.draws.T, strict=True))
        sd = column["sd"]
        if edge == "new" and "icc" in column:
            sd = sd / np.sqrt(1 - np.minimum(column["icc"], 1 - 1e-12))
        z = rng.standard_normal(shape) * sd[:, None]
        if "nu" in column:
            z *= np.sqrt(column["nu"] / rng.chisquare(column["nu"]))[:, None]
        return np.asarray(z)

    def sensitivity(self) -> pd.DataFrame:
        """Prior sensitivity: change of each parameter with priors of half and of double width.

        The draws are reweighted; where k-hat of the weights exceeds 0.5, they are drawn again.

        Returns
        -------
        DataFrame, columns ``halved`` and ``doubled``: shift of the mean in posterior sd; ``attrs["words"]``.
        """
        mean, sd = self.draws.mean(axis=0), self.draws.std(axis=0, ddof=1)
        shifts = {name: (self._mean_under(by) - mean) / sd for name, by in (("halved", 0.5), ("doubled", 2.0))}
        table = pd.DataFrame(shifts, index=list(self.names))
        most = table.abs().max(axis=1)
        table.attrs["words"] = (
            f"Prior sensitivity (half, double width): {most.idxmax()} shifts most, by {most.max():.2g} posterior sd."
        )
        return table

    def _mean_under(self, by: float) -> Array:
        """Mean of each parameter with ``by`` times the width of every prior."""
        other = replace(self.density, priors=self.priors.scaled(by))
        change = other.log_prior(self.sample.phi) - self.density.log_prior(self.sample.phi)
        weights, k_hat = pareto_smoothed(change)
        if k_hat <= FINITE_VARIANCE:
            return np.asarray(np.exp(weights) @ self.draws)
        method: Method | None = "exact" if self.method == "exact" else None
        again = draw(other, self.seed, len(self.sample.phi), method=method)
        return np.asarray(again.draws.mean(axis=0))

    def jackknife(self) -> "pd.Series[float] | None":
        """Jackknife standard errors by edge of the same estimate; far above the posterior sd, the draws understate it.

        None where edges have no levels, or one edge alone determines a coefficient.
        """
        return jackknife_of_level_model(self.density, self.sample.phi)

    def leave_out(self) -> LeaveOut | NotAvailable:
        """Expected log predictive density of left-out edges (rows); from fewer draws where rows are very many."""
        rows = len(self.density.y)
        draws = min(len(self.draws), MOST_EVALUATIONS // rows)
        if draws < FEWEST_DRAWS:
            return NotAvailable(f"{rows} rows: too many for leave-one-out cross-validation by row and draw")
        phi = self.sample.phi[np.linspace(0, len(self.sample.phi) - 1, draws).astype(int)]
        return leave_one_out(self.density.by_unit(phi), self.density.units)

    def to_arviz(self) -> Any:  # noqa: ANN401
        """The draws, log likelihood by edge and observed data for ArviZ, 0.23 or 1.x, whichever is installed."""
        from .arviz_export import to_arviz

        return to_arviz(self)

    def plot(self, kind: "FigureKind | Axes | None" = None, ax: "Axes | None" = None, **options: Any) -> Any:  # noqa: ANN401
        """Draw a figure of the posterior; the axes are returned, an array of them where there are several.

        Parameters
        ----------
        kind : {"marginals", "pairs", "predictive", "curves"}
            Each parameter with its prior; each pair of parameters; rows of each edge in the band of a row of a new
            edge; the law along each factor with its credible bands.
        ax : Axes, optional
            For figures of one panel; without it the figure is new and known to pyplot.
        **options
            ``banner``: text above the figure, for instance "simulated".

        Raises
        ------
        UsageError
            No such kind or option, or several panels for one ``ax``.
        """
        return Plottable.plot(self, kind, ax, **options)
