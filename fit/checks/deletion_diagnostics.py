"""Deletion diagnostics: leverage, Cook's distance, DFBETAS, PRESS and predicted R2, in closed form.

A row left out while its neighbours on the same edge remain is predicted by them: that flatters a law and hides an
influential edge. So the unit left out is the edge; where rows are independent it is the row, and the figures are the
textbook's. A law with additive errors is linearised along its gradient (one step, no refit).

Sources: Cook & Weisberg 1982, Residuals and Influence in Regression; Belsley, Kuh & Welsch 1980, Regression
Diagnostics; Allen 1974, Technometrics 16, 125 (PRESS); Myers, Montgomery & Anderson-Cook, Response Surface
Methodology (predicted R2 and its gap to R2).
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import ByRule
from .strata import Array, Strata, covariance, has_repeated_edges, linear_columns, no_scatter, sums_by

ALONE = 1e-10  # smallest share of a parameter that the other units must hold


@dataclass(frozen=True, slots=True)
class Deletion:
    """What each unit left out does to a law.

    Attributes
    ----------
    units : {"edges", "rows"}
    names : tuple of str, length u
        Edges, or ``line 12`` of the file.
    leverage : ndarray, shape (u,)
        Trace of the unit's block of the hat matrix; they sum to the number of parameters.
    moved : ndarray, shape (u, p)
        What ``theta`` moves by when the unit is left out.
    predicted : ndarray, shape (n,)
        Residual of each row from the law fitted without its unit, on the scale of the fit.
    """

    units: str
    names: tuple[str, ...]
    leverage: Array
    moved: Array
    predicted: Array


def deletion(law: LawFit, strata: Strata | NotAvailable) -> Deletion | NotAvailable:
    """Leave out each edge (each row where rows are independent), in closed form.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> left = deletion(law, split(law))
    >>> left.units, left.moved.shape
    ('edges', (24, 5))
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    columns, back = linear_columns(law)
    Q, R = np.linalg.qr(columns)
    to_theta = back @ np.linalg.inv(R)
    if not has_repeated_edges(law):
        return _rows_out(law, Q, to_theta)
    return _edges_out(law, strata, Q, to_theta) if isinstance(strata, Strata) else strata


def _edges_out(law: LawFit, strata: Strata, Q: Array, to_theta: Array) -> Deletion | NotAvailable:
    """With Q orthonormal, leaving edge g out moves its coefficients by ``-(I - Q_g'Q_g)^-1 Q_g' r_g``."""
    G, p = len(strata.names), Q.shape[1]
    blocks = np.empty((G, p, p))
    for i in range(p):
        for j in range(i, p):
            blocks[:, i, j] = blocks[:, j, i] = np.bincount(strata.edge, weights=Q[:, i] * Q[:, j], minlength=G)
    others = np.eye(p) - blocks
    alone = np.flatnonzero(np.linalg.eigvalsh(others)[:, 0] < ALONE)
    if alone.size:
        return NotAvailable(_holds_alone(f"edge {strata.names[alone[0]]}", "cut another near its conditions"))
    pull = sums_by(strata.edge, Q * law.residuals[:, None], G)
    moved = -np.linalg.solve(others, pull[:, :, None])[:, :, 0]
    predicted = law.residuals - np.einsum("ij,ij->i", Q, moved[strata.edge])
    leverage = np.trace(blocks, axis1=1, axis2=2)
    return Deletion("edges", strata.names, leverage, moved @ to_theta.T, predicted)


def _rows_out(law: LawFit, Q: Array, to_theta: Array) -> Deletion | NotAvailable:
    leverage = np.einsum("ij,ij->i", Q, Q)
    alone = np.flatnonzero(1 - leverage < ALONE)
    if alone.size:
        return NotAvailable(_holds_alone(f"line {law.lines[alone[0]]}", "measure another near its conditions"))
    predicted = law.residuals / (1 - leverage)
    moved = -(Q * predicted[:, None]) @ to_theta.T
    return Deletion("rows", tuple(f"line {i}" for i in law.lines), leverage, moved, predicted)


def _holds_alone(who: str, cure: str) -> str:
    return f"{who} alone holds a parameter of the law, which nothing checks: {cure}"


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
    >>> from fitmodels.fit.checks.deletion_diagnostics import deletion
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


GAP = 0.2  # between R2 and predicted R2


@dataclass(frozen=True, slots=True, repr=False)
class Press(Displayable, ByRule):
    """How well the law predicts what it has not seen.

    Attributes
    ----------
    units : {"edges", "rows"}
        What was left out, one at a time.
    press : float
        Sum of squared residuals of what was left out, on the scale of the fit.
    rsquared, predicted_rsquared : float
        Of the fit, and ``1 - press / tss``.
    typical : float
        Root mean square of the same residuals.
    unit : str
        Of ``typical``: ``ln`` or the unit of the response.
    """

    units: str
    press: float
    rsquared: float
    predicted_rsquared: float
    typical: float
    unit: str

    @property
    def null(self) -> str:
        """What is looked for."""
        return f"the law predicts {self.units} it has not seen about as well as those it was fitted to"

    @property
    def statistic(self) -> float:
        """Predicted R2."""
        return self.predicted_rsquared

    @property
    def concern(self) -> int:
        """0 fine; 1 a gap above 0.2: few units or one that decides; 2 worse than the plain mean."""
        if self.predicted_rsquared <= 0:
            return 2
        return int(self.rsquared - self.predicted_rsquared > GAP)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"predicted R2 {self.predicted_rsquared:.3f}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        error = f"{100 * np.expm1(self.typical):.3g} %" if self.unit == "ln" else f"{self.typical:.3g} {self.unit}"
        found = f"predicted R2 {self.predicted_rsquared:.2f} against {self.rsquared:.2f} of the fit"
        if self.concern == 2:
            return f"The law predicts {self.units} left out no better than their mean would ({found}): do not use it."
        if self.concern:
            return (
                f"The law fits better than it predicts ({found}, typical error {error}): add {self.units}, or drop "
                "the factor that one of them decides."
            )
        return f"{self.units.capitalize()} left out are predicted to {error} ({found})."


def press(law: LawFit, left: Deletion) -> Press:
    """PRESS and predicted R2 from what leaving out does."""
    total = float(left.predicted @ left.predicted)
    share = 1 - total / law.tss if law.tss > 0 else 0.0
    return Press(left.units, total, law.rsquared, share, (total / law.nobs) ** 0.5, law.scale_unit)
