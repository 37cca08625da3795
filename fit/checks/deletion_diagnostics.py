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

from ...core.arrays import Array
from ..available import NotAvailable
from ..group_sums import products_by, sums_by
from ..lawfit import LawFit
from .check import Check
from .strata import Strata, covariance, has_repeated_edges, linear_columns, no_scatter

ALONE = 1e-10  # smallest share of the information on a parameter that the other units must have


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
    blocks = products_by(strata.edge, Q, G)
    others = np.eye(p) - blocks
    alone = np.flatnonzero(np.linalg.eigvalsh(others)[:, 0] < ALONE)
    if alone.size:
        return NotAvailable(
            _determines_alone(f"edge {strata.names[alone[0]]}", "test another edge near its conditions")
        )
    pull = sums_by(strata.edge, Q * law.residuals[:, None], G)
    moved = -np.linalg.solve(others, pull[:, :, None])[:, :, 0]
    predicted = law.residuals - np.einsum("ij,ij->i", Q, moved[strata.edge])
    leverage = np.trace(blocks, axis1=1, axis2=2)
    return Deletion("edges", strata.names, leverage, moved @ to_theta.T, predicted)


def _rows_out(law: LawFit, Q: Array, to_theta: Array) -> Deletion | NotAvailable:
    leverage = np.einsum("ij,ij->i", Q, Q)
    alone = np.flatnonzero(1 - leverage < ALONE)
    if alone.size:
        return NotAvailable(_determines_alone(f"line {law.lines[alone[0]]}", "measure another row near its conditions"))
    predicted = law.residuals / (1 - leverage)
    moved = -(Q * predicted[:, None]) @ to_theta.T
    return Deletion("rows", tuple(f"line {i}" for i in law.lines), leverage, moved, predicted)


def _determines_alone(unit: str, remedy: str) -> str:
    return f"{unit} alone determines a parameter of the law: {remedy}"


LOOK, ACT = 0.2, 0.5  # quantiles of F that limit Cook's distance (Kutner et al. 2005, section 10.4)
MOST_SHOWN = 99  # larger distances are not printed


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Influence(Check):
    """Influence of single edges or rows: leverage, Cook's distance (its largest is the statistic) and DFBETAS.

    ``df`` are those of the F distribution that Cook's distance is compared with: p, and units less p.

    Attributes
    ----------
    units, names, leverage
        As in :class:`Deletion`.
    parameters : tuple of str, length p
    cook : ndarray, shape (u,)
        Cook's distance; by edge against the covariance with a random level of each edge.
    dfbetas : ndarray, shape (u, p)
        Standard errors by which the unit moves each parameter; rows have the error without the row.
    """

    units: str
    names: tuple[str, ...]
    parameters: tuple[str, ...]
    leverage: Array
    cook: Array
    dfbetas: Array


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


def _cook_df(parameters: tuple[str, ...], units: tuple[str, ...]) -> tuple[int, int]:
    """Degrees of freedom of the F distribution that Cook's distance is compared with."""
    return len(parameters), max(len(units) - len(parameters), 1)


def _influence(law: LawFit, left: Deletion, cook: Array, dfbetas: Array) -> Influence:
    """Limits of Cook's distance: the .2 quantile of F, and its median."""
    from scipy.special import fdtr

    unit, largest, df = left.units[:-1], float(cook.max()), _cook_df(law.theta_names, left.names)
    share = float(fdtr(*df, largest))
    concern = int(share > LOOK) + int(share > ACT)
    g = int(np.argmax(cook))
    j = 1 + int(np.argmax(np.abs(dfbetas[g, 1:])))  # the constant, far outside the conditions, follows them
    name = f"Edge {left.names[g]}" if left.units == "edges" else left.names[g].capitalize()
    size = f"Cook's distance {f'{largest:.2g}' if largest < MOST_SHOWN else f'above {MOST_SHOWN}'}"
    strong = (
        f"{name} has a {'dominating' if concern == 2 else 'large'} influence ({size}): without it {law.theta_names[j]} "
        f"moves by {abs(dfbetas[g, j]):.2g} standard errors; check its record, or repeat it."
    )
    return Influence(
        null=f"no single one of the {left.units} determines the law",
        statistic=largest,
        symbol=f"max. D by {unit}",
        df=df,
        concern=concern,
        verdict=strong if concern else f"No {unit} has a large influence (Cook's distance at most {largest:.2f}).",
        units=left.units,
        names=left.names,
        parameters=law.theta_names,
        leverage=left.leverage,
        cook=cook,
        dfbetas=dfbetas,
    )


GAP = 0.2  # between R2 and predicted R2


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
    """PRESS and predicted R2 from the deletion diagnostics: a warning where the gap to R2 exceeds 0.2."""
    total = float(left.predicted @ left.predicted)
    share = 1 - total / law.tss if law.tss > 0 else 0.0
    typical = (total / law.nobs) ** 0.5
    error = f"{100 * np.expm1(typical):.3g} %" if law.scale_unit == "ln" else f"{typical:.3g} {law.scale_unit}"
    result = f"predicted R2 {share:.2f}, R2 of the fit {law.rsquared:.2f}"
    concern = 2 if share <= 0 else int(law.rsquared - share > GAP)
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
