"""Draws of the parameters of a law, and inference from them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from ...core.display import Plottable
from ...core.errors import UsageError
from ..available import NotAvailable
from ..edges import left_out_moves
from ..lawfit import LawFit
from ..rows import as_table
from .convergence import Agreement, Gate, gate
from .density import Array, Errors, LawDensity, Sample
from .diagnostics import Diagnostics
from .priors import Priors
from .psis_loo import LeaveOut, leave_one_out, pareto_smoothed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def jackknife_of_level_model(density: LawDensity, phi: Array) -> "pd.Series[float] | None":
    """Standard errors by edge of the coefficients about which ``phi`` (S, p) is drawn, by the names of the law.

    None where edges have no levels, or where one edge alone holds a coefficient.

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

MOST_LOOKS, FEWEST_DRAWS = 40_000_000, 1000  # looks of a draw at a row, and draws that smoothed weights need
FINITE_VARIANCE = 0.5  # k-hat up to which a weighted mean has one


@dataclass(frozen=True, slots=True, repr=False)
class Posterior(Plottable):
    """Draws of the parameters of one law.

    Attributes
    ----------
    law : LawFit
    density : LawDensity
        The model: its rows, priors and errors.
    sample : Sample
        Draws on the scale of the density, and how they were made.
    draws : ndarray, shape (S, q)
        Draws of ``names``.
    diagnostics : Diagnostics
    seed : int
    agreement : Agreement or None
        What an independent run of chains says of these draws, where it was asked for.
    notes : tuple of str
        What was taken for granted.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> post = fit.posterior(law, seed=1)
    >>> post.method, post.gate.open
    ('exact', True)
    """

    law: LawFit
    density: LawDensity
    sample: Sample
    draws: Array
    diagnostics: Diagnostics
    seed: int
    agreement: Agreement | None = None
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """As ``LawFit.theta_names``, then ``sd``, ``icc`` where edges have levels, ``nu`` of Student errors."""
        return self.density.told_names

    @property
    def response(self) -> str:
        """Symbol of the response."""
        return self.law.response

    @property
    def method(self) -> str:
        """``exact``, ``importance`` or ``emcee``."""
        return self.sample.method

    @property
    def priors(self) -> Priors:
        """What was taken to be likely before the tests."""
        return self.density.priors

    @property
    def errors(self) -> Errors:
        """``normal`` or ``student``."""
        return self.density.errors

    @property
    def r_hat(self) -> "pd.Series[float]":
        """Split R-hat of each parameter."""
        return pd.Series(self.diagnostics.r_hat, index=list(self.names), name="r_hat")

    @property
    def ess(self) -> "pd.Series[float]":
        """Effective number of draws of each parameter, bulk or tail, the smaller."""
        least = np.minimum(self.diagnostics.ess_bulk, self.diagnostics.ess_tail)
        return pd.Series(least, index=list(self.names), name="ess")

    @property
    def gate(self) -> Gate:
        """Whether the draws may be used: nothing is handed on from behind a shut gate."""
        return gate(self.diagnostics, self.agreement, self.sample.interrupted)

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Mean, sd, median and equal-tailed interval of each parameter, with its diagnostics."""
        _between("level", level)
        low, median, high = np.quantile(self.draws, [(1 - level) / 2, 0.5, (1 + level) / 2], axis=0)
        columns = {
            "mean": self.draws.mean(axis=0),
            "sd": self.draws.std(axis=0, ddof=1),
            "median": median,
            "low": low,
            "high": high,
            "r_hat": self.diagnostics.r_hat,
            "ess_bulk": self.diagnostics.ess_bulk,
            "ess_tail": self.diagnostics.ess_tail,
        }
        return pd.DataFrame(columns, index=list(self.names))

    def interval(self, level: float = 0.95) -> pd.DataFrame:
        """Equal-tailed credible interval of each parameter, columns ``low`` and ``high``."""
        return self.table(level)[["low", "high"]]

    def predict(
        self,
        new: Mapping[str, object] | pd.DataFrame,
        kind: Kind = "mean",
        *,
        edge: Edge = "new",
        level: float = 0.95,
    ) -> pd.DataFrame:
        """Credible band of the law, or of a new row, at new points.

        Parameters
        ----------
        new : mapping or DataFrame
            A value or column for each factor.
        kind : {"mean", "prediction"}
            Of the law itself (of errors that multiply: the median of rows), or of one new row.
        edge : {"new", "same"}
            Of a row: on an edge not yet cut, or on one at the level of the law.
        level : float

        Returns
        -------
        DataFrame, columns value (median of the draws), low, high, in the unit of the response; ``attrs["words"]``.
        """
        _between("level", level)
        draws = self.responses(new, kind, edge=edge)
        low, value, high = np.quantile(draws, [(1 - level) / 2, 0.5, (1 + level) / 2], axis=0)
        band = pd.DataFrame({"value": value, "low": low, "high": high})
        of = "the law" if kind == "mean" else f"one row of {'a new edge' if edge == 'new' else 'the same edge'}"
        band.attrs["words"] = f"{100 * level:.4g} % credible interval for {of}, equal tails"
        return band

    def exceeds(
        self, new: Mapping[str, object] | pd.DataFrame, limit: float, kind: Kind = "prediction", *, edge: Edge = "new"
    ) -> Array:
        """Probability that the response exceeds ``limit`` at each new point, shape (m,)."""
        return np.asarray((self.responses(new, kind, edge=edge) > limit).mean(axis=0))

    def responses(self, new: Mapping[str, object] | pd.DataFrame, kind: Kind = "mean", *, edge: Edge = "new") -> Array:
        """The response of every draw at new points, shape (S, m), in its unit."""
        if kind not in ("mean", "prediction") or edge not in ("new", "same"):
            raise UsageError(f"kind={kind!r}, edge={edge!r}: 'mean' or 'prediction', of a 'new' or the 'same' edge.")
        Z = self.law.design_of(as_table(self.response, new))
        eta = self.draws[:, : len(self.law.theta)] @ Z.T
        logarithmic, natural = self.law.law.logarithmic, self.density.natural
        if kind == "mean":
            return np.exp(eta) if logarithmic else eta
        scatter = self._scatter(eta.shape, edge)
        if natural:
            return (np.exp(eta) if logarithmic else eta) + scatter
        return np.exp(eta + scatter)

    def _scatter(self, shape: tuple[int, ...], edge: Edge) -> Array:
        """Of one new row for each draw, on the scale of the errors; the same at every call."""
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
        """What halving and doubling the width of every prior does to each parameter.

        The draws are reweighted; where that cannot be trusted, they are drawn again.

        Returns
        -------
        DataFrame, columns ``halved`` and ``doubled``: move of the mean, in sds of the posterior; ``attrs["words"]``.
        """
        mean, sd = self.draws.mean(axis=0), self.draws.std(axis=0, ddof=1)
        moves = {name: (self._mean_under(by) - mean) / sd for name, by in (("halved", 0.5), ("doubled", 2.0))}
        table = pd.DataFrame(moves, index=list(self.names))
        most = table.abs().max(axis=1)
        table.attrs["words"] = (
            f"Halving or doubling the width of every prior moves {most.idxmax()} most, by {most.max():.2g} of its sd."
        )
        return table

    def _mean_under(self, by: float) -> Array:
        """Mean of each parameter with ``by`` times the width of every prior."""
        other = replace(self.density, priors=self.priors.scaled(by))
        change = other.log_prior(self.sample.phi) - self.density.log_prior(self.sample.phi)
        weights, k_hat = pareto_smoothed(change)
        if k_hat <= FINITE_VARIANCE:
            return np.asarray(np.exp(weights) @ self.draws)
        from .draw_posterior import draw_again

        return np.asarray(other.told(draw_again(other, self.sample, self.seed).phi).mean(axis=0))

    def jackknife(self) -> "pd.Series[float] | None":
        """Standard errors by edge of what the draws stand about: much above their sd, the draws are too sure.

        None where edges have no levels, or one edge alone holds a coefficient.
        """
        return jackknife_of_level_model(self.density, self.sample.phi)

    def leave_out(self) -> LeaveOut | NotAvailable:
        """Expected log density of an edge (a row) left out; of very many rows by fewer draws, or not at all."""
        rows = len(self.density.y)
        draws = min(len(self.draws), MOST_LOOKS // rows)
        if draws < FEWEST_DRAWS:
            return NotAvailable(f"{rows} rows: leaving out one unit after the other says nothing new of so many")
        phi = self.sample.phi[np.linspace(0, len(self.sample.phi) - 1, draws).astype(int)]
        return leave_one_out(self.density.by_unit(phi), self.density.units)

    def to_arviz(self) -> Any:  # noqa: ANN401
        """The draws, log likelihood by edge and observed data for ArviZ, 0.23 or 1.x, whichever is installed."""
        from .arviz_export import to_arviz

        return to_arviz(self)

    def plot(self, what: str = "marginals", ax: "Axes | None" = None, *, banner: str = "") -> Any:  # noqa: ANN401
        """Draw ``marginals``, ``pairs``, ``predictive`` (by edge) or ``curves``; the axes are returned.

        ``banner`` is text above the figure, for instance "simulated".
        """
        return Plottable.plot(self, ax, what=what, banner=banner)

    def to_frame(self) -> pd.DataFrame:
        """The draws, a column a parameter."""
        return pd.DataFrame(self.draws, columns=list(self.names))


def _between(name: str, share: float) -> None:
    if not 0 < share < 1:
        raise UsageError(f"{name} {share:g} of an interval: it lies between 0 and 1, for instance 0.95.")
