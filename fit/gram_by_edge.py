"""Triangles of rows by edge: what a law that is linear in its parameters needs of rows, to be fitted with more edges.

The Gram matrix ``W'W`` of the rows of an edge, W the columns of the law and its response, is kept as the number of
rows, the means, and a triangle R with ``R'R = W'W`` about the means. The triangle is found by a QR of the rows about
their means (`grams_by`), which squares nothing, so that no digits are lost. `law_of_triangles` fits the law to rows
made from them, as many as there were and with the same sums of products in every edge: coefficients, the jackknife by
edge, variance components and the posterior depend on rows by these sums alone, and are those of all rows. What depends
on single rows (outliers, normality) is not.

Source: Golub & Van Loan, Matrix Computations, section 5.3 (QR of the augmented matrix); Chan, Golub & LeVeque 1983, The
American Statistician 37, 242 (sums of products about means).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.arrays import Array, Ints
from ..core.errors import FitError
from ..core.threads import one_thread
from .available import NotAvailable
from .fitted_rows import FittedRows
from .lawfit import LawFit
from .laws import Error, LawForm
from .least_squares import grams_by
from .regression import law_of, linear_stage
from .rows import check_constant

MOST_HELMERT = 64  # rows up to which the n x n contrasts take no time
MOST_EDGES = 2000  # edges of which triangles are kept
MOST_ROWS = 1_000_000  # rows that are made from triangles


@dataclass(frozen=True, slots=True)
class EdgeTriangle:
    """Rows of one edge as their number, means and triangle.

    Attributes
    ----------
    edge : str
        Its name; empty for all rows together, where the data name no edges.
    rows : int
    mean : ndarray, shape (q,)
        Of the columns of the law but the constant, and of the response on the scale of the errors.
    moves : tuple of int
        Numbers of the columns that change within the edge.
    root : ndarray, shape (min(rows - 1, m), m)
        Upper triangle: ``root.T @ root`` are the sums of products of these columns about their means.
    batch : str
        Name of the delivery of tools or work that the edge belongs to; empty for the tests of the first fit.
    """

    edge: str
    rows: int
    mean: Array
    moves: tuple[int, ...]
    root: Array
    batch: str = ""


def edge_triangle(edge: str, W: Array, batch: str = "") -> EdgeTriangle:
    """Triangle of the rows W, shape (n, q), of one edge.

    Examples
    --------
    >>> W = np.array([[4.0, 0.7, -2.0], [4.0, 1.4, -1.8], [4.0, 2.1, -1.5]])
    >>> made = edge_triangle("E1", W)
    >>> made.moves, made.root.shape, bool(np.allclose(made.root.T @ made.root, 2 * np.cov(W[:, 1:].T)))
    ((1, 2), (2, 2), True)
    """
    return _triangles([edge], W, np.array([0]), batch)[0]


def _triangles(edges: Sequence[str], W: Array, starts: Ints, batch: str = "") -> tuple[EdgeTriangle, ...]:
    """Triangles of the edges whose rows in W begin at ``starts``."""
    from scipy.linalg import helmert

    found, made = grams_by(W.T, starts), []
    for g, about in enumerate(np.split(found.about, starts[1:], axis=1)):
        moves = np.flatnonzero(about.any(axis=1))
        n = about.shape[1]
        rows = helmert(n) @ about[moves].T if 1 < n <= MOST_HELMERT else about[moves].T
        root = np.linalg.qr(rows, mode="r")[: n - 1] if len(moves) else np.zeros((0, 0))
        made.append(EdgeTriangle(edges[g], n, found.mean[:, g], tuple(moves.tolist()), np.asarray(root), batch))
    return tuple(made)


def edge_triangles(law: LawFit) -> tuple[EdgeTriangle, ...] | NotAvailable:
    """Triangles of the rows of a law by edge, sorted by name, or the reason why they do not determine the law.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> of = edge_triangles(law)
    >>> len(of), of[0].edge, of[0].moves
    (24, 'E01', (3, 4))
    """
    if why := _not_linear(law):
        return NotAvailable(why)
    y = np.log(law.observed) if law.error == "multiplicative" else law.observed
    W = np.column_stack([law.design[:, 1:], y])
    if law.edge is None:
        return (edge_triangle("", W),)
    known, number = np.unique(law.edge.astype(str), return_inverse=True)
    if len(known) > MOST_EDGES:
        return NotAvailable(f"{len(known)} edges; sums by edge are kept of at most {MOST_EDGES}")
    order = np.argsort(number, kind="stable")
    return _triangles(known.tolist(), W[order], np.searchsorted(number[order], np.arange(len(known))))


def _not_linear(law: LawFit) -> str:
    """Reason why sums of products do not determine a law; empty where they do."""
    if law.rows is None:
        return "a law of a stream keeps no rows"
    if law.life is not None:
        return "a law of tool lives is not one of sums of products"
    if law.formula.fixed:
        return "some of its exponents are given, not estimated"
    if not law.formula.first_order:
        return "a law of second order is fitted again from all rows"
    if not law.formula.linearisable or (law.formula.logarithmic and law.error == "additive"):
        return "it is not linear in its parameters on the scale of its errors"
    return ""


def rows_of(triangle: EdgeTriangle) -> Array:
    """Rows, shape (rows, q), with the number, means and sums of products of those that the triangle is of.

    Examples
    --------
    >>> W = np.random.default_rng(1).normal(size=(5, 3))
    >>> again = rows_of(edge_triangle("E1", W))
    >>> bool(np.allclose(again.T @ again, W.T @ W)), again.shape
    (True, (5, 3))
    """
    W = np.repeat(triangle.mean[None], triangle.rows, axis=0)
    for i, row in enumerate(triangle.root):  # Helmert's contrasts: i + 1 ones and one -(i + 1), scaled to length one
        scale = 1 / np.sqrt((i + 1) * (i + 2))
        W[: i + 1, triangle.moves] += scale * row
        W[i + 1, triangle.moves] -= (i + 1) * scale * row
    return W


@one_thread
def law_of_triangles(
    formula: LawForm,
    error: Error,
    triangles: Sequence[EdgeTriangle],
    *,
    factors: int,
    **facts: Any,  # noqa: ANN401
) -> LawFit:
    """The law fitted to the rows of all triangles.

    Parameters
    ----------
    formula, error
        As of the law that the triangles were made from.
    triangles : sequence of EdgeTriangle
        At most one of each edge.
    factors : int
        Number of factors; columns between them and the response are indicators of the levels of a category.
    **facts
        Further fields of the law: ``units``, ``by``, ``source``, ``domain`` ...

    Raises
    ------
    FitError
        Two triangles of one edge, or more rows than can be made.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> again = law_of_triangles(law.formula, law.error, edge_triangles(law), factors=4, units=law.units)
    >>> bool(np.allclose(again.theta, law.theta, rtol=1e-12)), bool(np.allclose(again.bse, law.bse, rtol=1e-12))
    (True, True)
    """
    _check(formula.response, triangles)
    W = np.vstack([rows_of(one) for one in triangles])
    X = np.column_stack([np.exp(W[:, j]) if log else W[:, j] for j, log in enumerate(formula.logs)])
    shifts, y = W[:, factors:-1], W[:, -1]
    Z = formula.design(X, shifts)
    theta, cov, eta, residuals, tss = linear_stage(Z, y)
    check_constant(formula, theta, Z)
    observed, fitted = (np.exp(y), np.exp(eta)) if error == "multiplicative" else (y, eta)
    named = [one.edge for one in triangles for _ in range(one.rows)]
    edge = None if triangles[0].edge == "" else np.array(named, dtype=object)
    rows = FittedRows(X, shifts, observed, fitted, residuals, np.arange(len(y), dtype=np.intp), edge)
    domain = facts.pop("domain", None)
    law = law_of(formula, error, (theta, cov, fitted, residuals, tss), rows, **facts)
    return replace(law, response_range=None, domain=domain or law.domain)


def _check(response: str, triangles: Sequence[EdgeTriangle]) -> None:
    names = [one.edge for one in triangles]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise FitError(f"{response}: the sums of edge {twice!r} are there twice; leave one out.")
    if (n := sum(one.rows for one in triangles)) > MOST_ROWS:
        raise FitError(f"{response}: {n} rows; at most {MOST_ROWS} are made from sums. Fit all rows again.")
