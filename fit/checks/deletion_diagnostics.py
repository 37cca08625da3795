"""Deletion diagnostics: leverage, Cook's distance, DFBETAS, PRESS and predicted R2, in closed form; adequate precision.

A row left out while its neighbours on the same edge remain is predicted by them: that flatters a law and hides an
influential edge. So the unit left out is the edge; where rows are independent it is the row, and the figures are the
textbook's. A law with additive errors is linearised along its gradient (one step, no refit).

Sources: Cook & Weisberg 1982, Residuals and Influence in Regression; Belsley, Kuh & Welsch 1980, Regression
Diagnostics; Allen 1974, Technometrics 16, 125 (PRESS); Myers, Montgomery & Anderson-Cook, Response Surface
Methodology (predicted R2 and its gap to R2, adequate precision).
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import products_by, sums_by
from .check import Check
from .strata import Strata, covariance, has_repeated_edges, linear_columns, no_scatter

ALONE = 1e-10  # smallest share of the information on a parameter that the other units must have


class DeterminesAlone(NotAvailable):
    """The reason that one edge or row alone determines a parameter, so that nothing predicts it without that one."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Deletion:
    """Effect of leaving out each unit on a law.

    Attributes
    ----------
    units : {"edges", "rows"}
    names : tuple of str, length u
        Edges, or ``line 12`` of the file.
    leverage : ndarray, shape (u,)
        Trace of the unit's block of the hat matrix; they sum to the number of parameters.
    moved : ndarray, shape (u, p)
        Change of ``theta`` when the unit is left out.
    predicted : ndarray, shape (n,)
        Residual of each row from the law fitted without its unit, on the scale of the fit.
    information : ndarray, shape (u, p)
        Share of the information on each of ``theta`` that the unit alone carries: one less the ratio of its variance
        with the unit to that without it.
    """

    units: str
    names: tuple[str, ...]
    leverage: Array
    moved: Array
    predicted: Array
    information: Array


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
    blocks = products_by(strata.edge, Q, G)
    others = np.eye(p) - blocks
    alone = np.flatnonzero(np.linalg.eigvalsh(others)[:, 0] < ALONE)
    if alone.size:
        return _determines_alone(f"edge {strata.names[alone[0]]}", "test another edge near its conditions")
    pull = sums_by(strata.edge, Q * law.residuals[:, None], G)
    moved = -np.linalg.solve(others, pull[:, :, None])[:, :, 0]
    predicted = law.residuals - np.einsum("ij,ij->i", Q, moved[strata.edge])
    leverage = np.trace(blocks, axis1=1, axis2=2)
    without = np.einsum("jk,gkj->gj", to_theta, np.linalg.solve(others, to_theta.T[None]))
    information = 1 - (to_theta**2).sum(axis=1) / without
    return Deletion("edges", strata.names, leverage, moved @ to_theta.T, predicted, information)


def _rows_out(law: LawFit, Q: Array, to_theta: Array) -> Deletion | NotAvailable:
    leverage = np.einsum("ij,ij->i", Q, Q)
    alone = np.flatnonzero(1 - leverage < ALONE)
    if alone.size:
        return _determines_alone(f"line {law.lines[alone[0]]}", "measure another row near its conditions")
    predicted = law.residuals / (1 - leverage)
    moved = -(Q * predicted[:, None]) @ to_theta.T
    gain = (Q @ to_theta.T) ** 2 / (1 - leverage)[:, None]
    information = gain / ((to_theta**2).sum(axis=1) + gain)
    return Deletion("rows", tuple(f"line {i}" for i in law.lines), leverage, moved, predicted, information)


def _determines_alone(unit: str, remedy: str) -> DeterminesAlone:
    return DeterminesAlone(f"{unit} alone determines a parameter of the law: {remedy}")


def sole_unit(reason: DeterminesAlone) -> Check:
    """The reservation of a law of which one edge or row alone determines a parameter."""
    return Check(
        null="no edge or row alone determines a parameter",
        concern=1,
        verdict=f"{reason.reason[0].upper()}{reason.reason[1:]}.",
    )


MOST_INFORMATION = 0.8  # share of the information on a parameter that one edge or row may carry


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Influence(Check):
    """Influence of single edges or rows: leverage, Cook's distance (its largest is the statistic) and DFBETAS.

    With few edges the largest distance is large in most sound files, so that it is no reservation; one is an edge that
    carries more than 80 % of the information on a parameter. An edge that deviates from the others is found by the
    test of wrong edges.

    Attributes
    ----------
    units, names, leverage
        As in :class:`Deletion`.
    parameters : tuple of str, length p
    cook : ndarray, shape (u,)
        Cook's distance; by edge against the covariance with a random level of each edge.
    dfbetas : ndarray, shape (u, p)
        Standard errors by which the unit moves each parameter; rows have the error without the row.
    information : ndarray, shape (u, p)
        As in :class:`Deletion`.
    """

    units: str
    names: tuple[str, ...]
    parameters: tuple[str, ...]
    leverage: Array
    cook: Array
    dfbetas: Array
    information: Array


def influence(law: LawFit, strata: Strata | NotAvailable, left: Deletion) -> Influence:
    """Leverage, Cook's distance and DFBETAS from the deletion diagnostics.

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
        return _influence(law, left, cook, -left.moved / se)
    gram = columns.T @ columns
    cook = np.einsum("ju,jk,ku->u", moved, gram, moved) / (p * law.rss / law.df_resid)
    unscaled = np.sqrt(np.diag(back @ np.linalg.inv(gram) @ back.T))
    without = (law.rss - law.residuals * left.predicted) / max(n - p - 1, 1)
    # with one degree of freedom each row left out leaves an exact fit; its own scatter stands in
    without = np.where(without > ALONE * law.rss / law.df_resid, without, law.rss / law.df_resid)
    dfbetas = -left.moved / (np.sqrt(without)[:, None] * unscaled)
    return _influence(law, left, cook, dfbetas)


def _influence(law: LawFit, left: Deletion, cook: Array, dfbetas: Array) -> Influence:
    unit, largest = left.units[:-1], float(cook.max())
    g = int(np.argmax(cook))
    j = 1 + int(np.argmax(np.abs(dfbetas[g, 1:])))  # the constant, far outside the conditions, follows them
    own, k, share = _most_information(law, left)
    moves = f"without it {law.theta_names[j]} moves by {abs(dfbetas[g, j]):.2g} standard errors"
    verdict = f"The largest influence is that of {_unit(left, g)} (Cook's distance {largest:.2g}): {moves}."
    if share > MOST_INFORMATION:
        alone = _unit(left, own)
        verdict = (
            f"{alone[0].upper()}{alone[1:]} alone carries {min(100 * share, 99):.0f} % of the information on "
            f"{law.theta_names[k]}: repeat its conditions, or test others near them."
        )
    return Influence(
        null=f"none of the {left.units} carries more than 80 % of the information on a parameter",
        statistic=largest,
        symbol=f"max. D by {unit}",
        concern=int(share > MOST_INFORMATION),
        verdict=verdict,
        units=left.units,
        names=left.names,
        parameters=law.theta_names,
        leverage=left.leverage,
        cook=cook,
        dfbetas=dfbetas,
        information=left.information,
    )


def _most_information(law: LawFit, left: Deletion) -> tuple[int, int, float]:
    """Unit and parameter with the largest share of information; that on wear, which nobody sets, is left to chance."""
    kinds = [ROLES[name].kind if name in ROLES else "" for name in law.theta_names]
    share = np.where([kind == "wear" for kind in kinds], 0.0, left.information)
    share[:, 0] = 0.0
    g, k = divmod(int(np.argmax(share)), share.shape[1])
    return g, k, float(share[g, k])


def _unit(left: Deletion, g: int) -> str:
    return f"edge {left.names[g]}" if left.units == "edges" else left.names[g]


GAP = 0.2  # between R2 and predicted R2
POOR = 0.3  # predicted R2 below which such a gap matters: with few edges a useful law has one as well


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Press(Check):
    """Prediction of left-out units: PRESS, and predicted R2, which is the statistic.

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


def press(law: LawFit, left: Deletion) -> Press:
    """PRESS and predicted R2 from the deletion diagnostics: a warning where it is low and far below R2."""
    total = float(left.predicted @ left.predicted)
    share = 1 - total / law.tss if law.tss > 0 else 0.0
    typical = (total / law.nobs) ** 0.5
    error = f"{100 * np.expm1(typical):.3g} %" if law.scale_unit == "ln" else f"{typical:.3g} {law.scale_unit}"
    result = f"predicted R2 {share:.2f}, R2 of the fit {law.rsquared:.2f}"
    concern = 2 if share <= 0 else int(law.rsquared - share > GAP and share < POOR)
    verdict = (
        f"{left.units.capitalize()} left out are predicted with an error of {error} ({result}).",
        f"The law fits better than it predicts ({result}, rms error {error}): add {left.units}, or drop the factor "
        "that one of them determines.",
        f"Left-out {left.units} are predicted no better than by their mean ({result}): do not use the law.",
    )[concern]
    return Press(
        null=f"{left.units} that were left out are predicted about as well as those of the fit",
        statistic=share,
        symbol="predicted R2",
        concern=concern,
        verdict=verdict,
        units=left.units,
        press=total,
        rsquared=law.rsquared,
        predicted_rsquared=share,
        typical=typical,
        unit=law.scale_unit,
    )


LEAST_PRECISION = 4.0  # range over standard error below which a law is useless for control


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Precision(Check):
    """Adequate precision: range of the predictions over their mean standard error.

    Attributes
    ----------
    by_edge : bool
        Whether the standard error is by edge (a random level of each) or of independent rows.
    """

    by_edge: bool


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
    ratio = float(np.ptp(eta)) / variance**0.5
    low = (
        f"Adequate precision {ratio:.2g} is below {LEAST_PRECISION:g}: the effect of the conditions is too small "
        "against its standard error for control; widen their ranges or repeat."
    )
    return Precision(
        null=f"the range of the predictions is at least {LEAST_PRECISION:g} of their standard errors",
        statistic=ratio,
        symbol="signal to noise",
        concern=2 * int(ratio < LEAST_PRECISION),
        verdict=low if ratio < LEAST_PRECISION else f"Adequate precision {ratio:.3g}, above {LEAST_PRECISION:g}.",
        by_edge=isinstance(strata, Strata),
    )
