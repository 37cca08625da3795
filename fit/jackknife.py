"""Standard errors by edge: the jackknife that leaves out one cutting edge at a time (CR3).

It assumes nothing about how rows of an edge depend on each other, holds its level for what changes between
edges (V, f, d) and within them (t), and gives one covariance for the whole law.

Sources: Bell & McCaffrey 2002, Survey Methodology 28, 169; Cameron & Miller 2015, J. Human Resources 50, 317.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .available import NotAvailable
from .edges import EdgeInference
from .lawfit import LawFit
from .mixed import Mixed, mixed

Array = NDArray[np.float64]

ROUNDING = 1e-11  # relative residual below which a law meets its rows exactly


def edge_inference(law: LawFit) -> EdgeInference | NotAvailable:
    """Standard errors by edge, or why these data do not allow them.

    Parameters
    ----------
    law : LawFit
        Of runs with an edge column; an additive power law is taken along its gradient.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> edges = fit.power_law(runs, "AW", ["V", "f", "d", "t"]).edges
    >>> edges.df, edges.within
    (23, (False, False, False, False, True))
    """
    if law.edge is None:
        return NotAvailable(
            "no edge column: rows are taken as independent; if several come from one edge, intervals are too narrow"
        )
    edge, names = pd.factorize(law.edge, sort=True)
    Z, G, p = gradient(law), len(names), len(law.theta)
    if law.cov_theta is None or meets_exactly(law):
        return NotAvailable("the law meets every row exactly: there is no scatter to tell edges by")
    within = tuple(_within(law.law.design(law.X, law.shifts), edge))
    if why := too_few_edges(law.nobs, G, p - sum(within)):
        return NotAvailable(why)
    moved = left_out_moves(Z, law.residuals, law.cov_theta * (law.df_resid / law.rss), edge, G)
    if isinstance(moved, int):
        return NotAvailable(indispensable(str(names[moved])))
    levels = mixed(Z, law.residuals + Z @ law.theta, edge, np.array(within))
    return of_moves(moved, law.theta, law.cov_theta, law.theta_names, tuple(str(n) for n in names), within, levels)


def too_few_edges(nobs: int, G: int, between: int) -> str:
    """Why so many edges of so many rows tell nothing by edge; empty where they do.

    ``between`` counts the parameters that only edges tell.
    """
    if nobs == G:
        return f"each of the {G} rows is an edge of its own: rows are independent"
    if between + 1 > G:
        return (
            f"{G} edge{'s' if G > 1 else ''} for {between} parameter{'s' if between > 1 else ''} that only edges can "
            f"tell: cut at least {between + 1 - G} more, at other conditions"
        )
    return ""


def indispensable(edge: str) -> str:
    """Why there is no inference by edge where one edge cannot be left out."""
    return (
        f"edge {edge} alone holds a parameter of the law: without it the others cannot tell it. Cut "
        "another edge near its conditions"
    )


def of_moves(
    moved: Array,
    theta: Array,
    row_cov: Array,
    theta_names: tuple[str, ...],
    edges: tuple[str, ...],
    within: tuple[bool, ...],
    levels: Mixed,
) -> EdgeInference:
    """Inference by edge from how theta moves when each edge is left out.

    Parameters
    ----------
    moved : ndarray, shape (G, p)
    theta, row_cov : ndarray, shape (p,) and (p, p)
        The fit, and its covariance with rows taken as independent.
    theta_names, edges, within
        As in `EdgeInference`.
    levels : Mixed
        The random level of each edge, the cross-check.
    """
    G = len(edges)
    cov = (G - 1) / G * moved.T @ moved
    told_between = [j for j in range(1, len(theta)) if not within[j]]
    return EdgeInference(
        names=theta_names,
        cov_theta=cov,
        df=G - 1,
        n_edges=G,
        within=within,
        moved=moved,
        edges=edges,
        mixed=levels,
        fvalue=_wald(theta, cov, told_between),
        row_fvalue=_wald(theta, row_cov, told_between),
    )


def meets_exactly(law: LawFit) -> bool:
    """Whether residuals are rounding alone."""
    size = 1.0 if law.error == "multiplicative" else float(np.abs(law.observed).max())
    return bool(np.sqrt(law.rss / law.nobs) <= ROUNDING * size)


def gradient(law: LawFit) -> Array:
    """Columns along which the fit is linear: Z itself, or the gradient of a law in natural units."""
    Z = law.law.design(law.X, law.shifts)
    return law.law.gradient(law.theta, Z) if law.error == "additive" else Z


def _within(Z: Array, edge: NDArray[np.intp]) -> list[bool]:
    """Which columns change within an edge."""
    first = np.zeros(edge.max() + 1, dtype=np.intp)
    first[edge[::-1]] = np.arange(len(edge))[::-1]
    return [bool(np.any(np.abs(z - z[first][edge]) > 1e-9 * np.abs(z).max())) for z in Z.T]


def left_out_moves(Z: Array, residuals: Array, cov_unscaled: Array, edge: NDArray[np.intp], G: int) -> Array | int:
    """How theta moves when each edge is left out, shape (G, p); or the number of an edge that cannot be.

    With Q = Z L orthonormal, leaving edge g out moves L^-1 theta by ``-(I - Q_g'Q_g)^-1 Q_g' r_g``.
    """
    L = np.linalg.cholesky(cov_unscaled)
    order = np.argsort(edge, kind="stable")
    bounds = np.searchsorted(edge[order], np.arange(G + 1))
    moved = np.empty((G, Z.shape[1]))
    for g in range(G):
        rows = order[bounds[g] : bounds[g + 1]]
        Q = Z[rows] @ L
        left = np.eye(Z.shape[1]) - Q.T @ Q
        if np.linalg.eigvalsh(left)[0] < 1e-10:
            return g
        moved[g] = -L @ np.linalg.solve(left, Q.T @ residuals[rows])
    return moved


def _wald(theta: Array, cov: Array, which: list[int]) -> float | None:
    """F of some parameters together; None of none."""
    if not which:
        return None
    b = theta[which]
    return float(b @ np.linalg.solve(cov[np.ix_(which, which)], b)) / len(which)
