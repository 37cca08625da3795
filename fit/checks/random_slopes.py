"""Levels and time exponents of edges, drawn about common ones: how far they spread, and rows freed of them.

In ``ln R = Z theta + (1, ln t) u_edge + e`` with ``u ~ N(0, s^2 D)``, D is found by restricted maximum likelihood;
rows whitened by it give theta by least squares.

Source: Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2.
"""

import numpy as np

from .columns import Array, Codes


def slope_spread(Z: Array, y: Array, edge: Codes, time: Array) -> Array:
    """D of edge levels and edge slopes in units of the residual variance, shape (2, 2), by REML.

    Parameters
    ----------
    Z : ndarray, shape (n, p)
    y, time : ndarray, shape (n,), ln R and ln t, the latter best centred
    edge : ndarray of int, shape (n,), edges numbered 0 to G - 1

    Examples
    --------
    >>> rng = np.random.default_rng(2)
    >>> edge, time = np.repeat(np.arange(60), 6), np.tile(np.linspace(-1, 1, 6), 60)
    >>> y = (1 + rng.normal(0, 0.3, 60)[edge]) * time + rng.normal(0, 0.1, 360)
    >>> bool(2 < np.sqrt(slope_spread(np.column_stack([np.ones(360), time]), y, edge, time)[1, 1]) < 4)
    True
    """
    from scipy.optimize import minimize

    n, p = Z.shape
    Q = np.linalg.qr(Z)[0]
    rows = np.column_stack([Q, y - Q @ (Q.T @ y)])
    W = np.column_stack([np.ones(n), time])
    WW = _by_edge(W, W, edge)
    WR = _by_edge(W, rows, edge)
    RR = rows.T @ rows

    def criterion(x: Array) -> float:
        """Minus twice the restricted log-likelihood, but for a constant."""
        L = np.array([[x[0], 0.0], [x[1], x[2]]])
        inner = np.eye(2) + L.T @ WW @ L
        LW = L.T @ WR
        M = RR - np.einsum("gik,gil->kl", LW, np.linalg.solve(inner, LW))
        schur = float(M[p, p] - M[p, :p] @ np.linalg.solve(M[:p, :p], M[:p, p]))
        logs = np.log(np.linalg.det(inner)).sum() + np.linalg.slogdet(M[:p, :p])[1]
        return float(logs + (n - p) * np.log(max(schur, 1e-300)))

    found = minimize(criterion, np.array([1.0, 0.0, 1.0]), method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-7})
    L = np.array([[found.x[0], 0.0], [found.x[1], found.x[2]]])
    return np.asarray(L @ L.T)


def whitened(A: Array, edge: Codes, time: Array, D: Array) -> Array:
    """Rows of A, shape (n, k), turned so that rows of an edge are independent under D, each of variance 1.

    Examples
    --------
    >>> whitened(np.array([[2.0], [4.0]]), np.array([0, 0]), np.zeros(2), np.zeros((2, 2))).ravel().tolist()
    [2.0, 4.0]
    """
    out = np.empty_like(A)
    for g in range(int(edge.max()) + 1):
        rows = np.flatnonzero(edge == g)
        W = np.column_stack([np.ones(len(rows)), time[rows]])
        out[rows] = np.linalg.solve(np.linalg.cholesky(np.eye(len(rows)) + W @ D @ W.T), A[rows])
    return out


def _by_edge(A: Array, B: Array, edge: Codes) -> Array:
    """A_g' B_g of each edge, shape (G, a, b)."""
    out = np.zeros((int(edge.max()) + 1, A.shape[1], B.shape[1]))
    np.add.at(out, edge, A[:, :, None] * B[:, None, :])
    return out
