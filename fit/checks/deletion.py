"""What leaving out one unit at a time does to a law, in closed form.

A row left out while its neighbours on the same edge stay in is predicted by them: that flatters a law and
hides the edge that decides it. So the unit left out is the edge; where rows are independent it is the row and
the figures are the textbook's. A law in natural units is taken along its gradient (one step, no refit).

Sources: Cook & Weisberg 1982, Residuals and Influence in Regression; Belsley, Kuh & Welsch 1980, Regression
Diagnostics.
"""

from dataclasses import dataclass

import numpy as np

from ..available import NotAvailable
from ..lawfit import LawFit
from .columns import Array, linear_columns, sums_by
from .evidence import has_repeated_edges, no_scatter
from .strata import Strata

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
