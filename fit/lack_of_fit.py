"""Lack of fit against pure error, and the two strata it rests on: levels of edges, and rows about them.

Rows of one edge share that edge's level, so their scatter says nothing of how two edges cut alike differ.
Where a law has several rows an edge, pure error is therefore how far *edges* at one setting differ, and lack
of fit how far the settings stand off the law. Everything that varies within edges (time, wear) stays in both
models. Edges of unequal length are weighted by the variance split, estimated from the law itself.

Sources: Draper & Smith 1998, Applied Regression Analysis, section 2.1 (pure error); Henderson 1953, Biometrics
9, 226, method 3 (variance split); Hurlbert 1984, Ecological Monographs 54, 187 (why rows will not do).
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .available import NotAvailable
from .lawfit import LawFit

Array = NDArray[np.float64]
Codes = NDArray[np.intp]

# Of columns scaled to length one: what is left of a column below this is rounding.
ROUNDING = 1e-9
# Mean square of residuals below which a law meets its rows exactly, relative to the size of the response.
EXACT = 1e-11
# Intraclass correlation that stands for one: above it rows of an edge are copies of each other.
NEARLY_ONE = 1 - 1e-6
SIGNIFICANT = 0.05


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """Test of the law's form against the scatter of what was cut twice at the same conditions.

    Attributes
    ----------
    units : {"edges", "rows"}
        What was replicated.
    ss_lack, ss_pure : float
        Sums of squares of lack of fit and of pure error, on the scale of the fit.
    df : tuple of int
        Degrees of freedom of both.
    settings, replicated : int
        Distinct settings, and how many of them hold more than one unit.
    pvalue : float
    """

    units: str
    ss_lack: float
    ss_pure: float
    df: tuple[int, int]
    settings: int
    replicated: int
    pvalue: float

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return f"the law has the right form: settings stand off it no more than replicated {self.units} differ"

    @property
    def statistic(self) -> float:
        """F, mean square of lack of fit over that of pure error."""
        return self.ss_lack / self.df[0] / (self.ss_pure / self.df[1])

    @property
    def concern(self) -> int:
        """0 fine, 2 the form is in doubt. Cause: curvature or a product of factors. Cure: another form."""
        return 2 if self.pvalue < SIGNIFICANT else 0

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"no lack of fit {p_in_words(self.pvalue)}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        found = f"F({self.df[0]},{self.df[1]}) {self.statistic:.2f}, {p_in_words(self.pvalue)}"
        if self.concern:
            return (
                f"Lack of fit ({found}): the law misses more than {self.units} cut alike differ, so its form is not "
                "quite right; try a second-order or rival form, or keep to a narrower range."
            )
        return f"No lack of fit against {self.replicated} replicated settings ({found})."


@dataclass(frozen=True, slots=True)
class Strata:
    """A law's columns and residuals, parted into levels of edges and rows about them.

    The columns are those along which the fit is linear, each freed of the constant and of length one
    (``theta`` moves by ``back`` times what their coefficients move).

    Attributes
    ----------
    names : tuple of str, length G
    edge : ndarray of int, shape (n,)
    level : ndarray, shape (n,)
        Column of the constant: an edge's own level is a multiple of it.
    weight : ndarray, shape (G,)
        Sum of squares of ``level`` in each edge: the number of its rows where errors multiply.
    within : ndarray of bool, shape (p,)
        Which columns change within edges.
    back : ndarray, shape (p, p)
    levels : ndarray, shape (G, p + 1)
        Level of each column, and of the residual, in each edge.
    basis : ndarray, shape (n, w)
        Orthonormal basis of what changes within edges.
    inner : ndarray, shape (w, p + 1)
        Columns, and the residual, in that basis.
    rest : ndarray, shape (n,)
        Residuals once edges have levels of their own.
    icc : float
        Share of the variance between edges (Henderson's method 3, never below zero).
    """

    names: tuple[str, ...]
    edge: Codes
    level: Array
    weight: Array
    within: NDArray[np.bool_]
    back: Array
    levels: Array
    basis: Array
    inner: Array
    rest: Array
    icc: float = 0.0

    @property
    def df_within(self) -> int:
        """Rows less edges less what changes within them."""
        return len(self.rest) - len(self.names) - int(self.basis.shape[1])

    @property
    def df_between(self) -> int:
        """Edge levels less the parameters that only they tell."""
        return int(self.basis.shape[1]) + len(self.names) - len(self.within)

    @property
    def weights(self) -> Array:
        """Weight of each edge level against a row's part within, shape (G,)."""
        return np.asarray(self.weight * (1 - self.icc) / (1 - self.icc + self.icc * self.weight))

    def stacked(self) -> Array:
        """Columns and residual as w + G rows that hold all but ``rest``, whitened; shape (w + G, p + 1)."""
        return np.vstack([self.inner, np.sqrt(self.weights)[:, None] * self.levels])


def lack_of_fit(law: LawFit, strata: Strata | NotAvailable) -> LackOfFit | NotAvailable:
    """Lack of fit against replicated edges, or replicated rows where rows are independent.

    Parameters
    ----------
    law : LawFit
    strata : Strata or NotAvailable
        What :func:`split` gives for the law.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> lack_of_fit(law, split(law)).df
    (11, 9)
    """
    if law.df_resid <= 0 or meets_exactly(law):
        return NotAvailable(no_scatter(law))
    if not has_repeated_edges(law):
        return _of_rows(law)
    return _of_edges(law, strata) if isinstance(strata, Strata) else strata


def split(law: LawFit) -> Strata | NotAvailable:
    """Part a law into edges and rows within them, or say why that cannot be done.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> strata = split(law)
    >>> strata.df_between, strata.df_within
    (20, 214)
    """
    if law.edge is None:
        return NotAvailable("no edge column: rows are taken as independent")
    if not has_repeated_edges(law):
        return NotAvailable("every row is an edge of its own")
    if law.df_resid <= 0 or meets_exactly(law):
        return NotAvailable(no_scatter(law))
    found = _parted(law, law.edge)
    if found.df_between > 0:
        return _with_icc(found)
    G, told = len(found.names), len(found.within) - found.basis.shape[1]
    if G == 1:
        return NotAvailable("all rows are from one edge, so nothing tells how edges differ: cut at least one more")
    return NotAvailable(f"{G} edges for {told} parameters that only edges can tell: cut more edges than that")


def linear_columns(law: LawFit) -> tuple[Array, Array]:
    """Columns along which the fit is linear, shape (n, p), that of the constant first, and ``back``.

    All but the first are freed of it and scaled to length one, which keeps the digits that logarithms of
    narrow ranges lose; ``theta`` moves by ``back`` times what the coefficients of these columns move.
    """
    Z = law.law.design(law.X, law.shifts)
    if law.error == "additive":
        Z = law.law.gradient(law.theta, Z)
    level = Z[:, 0]
    share = level @ Z[:, 1:] / (level @ level)
    rest = Z[:, 1:] - np.outer(level, share)
    length = np.sqrt(np.einsum("ij,ij->j", rest, rest))
    size = np.linalg.norm(level)
    back = np.diag(np.concatenate([[1 / size], 1 / length]))
    back[0, 1:] = -share / length
    return np.column_stack([level / size, rest / length]), back


def meets_exactly(law: LawFit) -> bool:
    """Whether residuals are rounding alone."""
    size = 1.0 if law.error == "multiplicative" else float(np.abs(law.observed).max())
    return bool(np.sqrt(law.rss / law.nobs) <= EXACT * size)


def no_scatter(law: LawFit) -> str:
    """Why a law without scatter cannot be tested."""
    if law.df_resid <= 0:
        return f"{law.nobs} observations fix {len(law.theta)} parameters exactly: nothing is left to judge the law by"
    return "the law meets every row exactly: there is no scatter to judge it by"


def has_repeated_edges(law: LawFit) -> bool:
    """Whether some edge gave more than one row."""
    return law.n_edges is not None and law.n_edges < law.nobs


def p_in_words(p: float) -> str:
    """A p-value as the papers print it: ``p .015``."""
    if p < 0.001:
        return "p < .001"
    return f"p {p:.{3 if p < 0.1 else 2}f}".replace(" 0.", " .")


def without_levels(A: Array, level: Array, edge: Codes, G: int) -> tuple[Array, Array]:
    """Levels of the columns of A in each edge, shape (G, k), and A without them, shape (n, k)."""
    weight = np.bincount(edge, weights=level**2, minlength=G)
    sums = np.column_stack([np.bincount(edge, weights=level * column, minlength=G) for column in A.T])
    levels = sums / weight[:, None]
    return levels, A - level[:, None] * levels[edge]


def orthonormal(A: Array) -> Array:
    """Orthonormal basis of columns of length about one, shape (n, rank)."""
    if not A.shape[1]:
        return A
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, s > ROUNDING])


def _parted(law: LawFit, labels: NDArray[np.object_]) -> Strata:
    edge, names = pd.factorize(labels, sort=True)
    columns, back = linear_columns(law)
    level = columns[:, 0] * np.sqrt(len(columns))  # ones, or the gradient of the constant scaled to their size
    weight: Array = np.asarray(np.bincount(edge, weights=level**2), dtype=float)
    levels, inside = without_levels(np.column_stack([columns, law.residuals]), level, edge, len(names))
    within = np.linalg.norm(inside[:, :-1], axis=0) > ROUNDING
    inside[:, :-1][:, ~within] = 0.0
    basis = orthonormal(inside[:, :-1][:, within])
    inner = basis.T @ inside
    rest = inside[:, -1] - basis @ inner[:, -1]
    return Strata(tuple(map(str, names)), edge, level, weight, within, back, levels, basis, inner, rest)


def _with_icc(strata: Strata) -> Strata:
    """Variance split by equating the sums of squares between and within edges to their expectations."""
    if strata.df_within <= 0:
        return strata
    stacked = strata.stacked()
    Q = orthonormal(stacked[:, :-1])
    left = stacked[:, -1] - Q @ (Q.T @ stacked[:, -1])
    inside = float(strata.rest @ strata.rest) / strata.df_within
    of_edges = Q[strata.basis.shape[1] :]
    spread = float(strata.weight @ (1 - np.einsum("ij,ij->i", of_edges, of_edges)))
    between = max(0.0, (float(left @ left) - inside * strata.df_between) / spread)
    return replace(strata, icc=min(between / (between + inside), NEARLY_ONE))


def _of_edges(law: LawFit, strata: Strata) -> LackOfFit | NotAvailable:
    told = np.flatnonzero(~strata.within)
    if len(told) < 2:
        return NotAvailable("every factor changes within the edges, so no two edges are cut at one setting")
    first = np.unique(strata.edge, return_index=True)[1]
    setting = settings_of(law.law.design(law.X[first], law.shifts[first])[:, told])
    S, G, p = int(setting.max()) + 1, len(strata.names), len(strata.within)
    if S == G:
        return NotAvailable(
            "no two edges were cut at the same conditions, so pure error is unknown and the form of the law cannot be "
            "tested: repeat one setting, the middle one say, on three or four new edges"
        )
    stacked, w = strata.stacked(), strata.basis.shape[1]
    law_ss = _left(stacked[:, :-1], stacked[:, -1])[0]
    others = np.append(strata.within, True)
    outer = stacked[w:, others]
    _, outer = without_levels(outer, np.sqrt(strata.weights), setting, S)
    rows = np.vstack([stacked[:w, others], outer])
    pure, rank = _left(rows[:, :-1], rows[:, -1])
    return _test("edges", law_ss, pure, (S + rank - p, w + G - S - rank), setting, law_ss)


def _of_rows(law: LawFit) -> LackOfFit | NotAvailable:
    setting = settings_of(law.law.design(law.X, law.shifts))
    S = int(setting.max()) + 1
    if law.nobs == S:
        return NotAvailable(
            "no two rows were measured at the same conditions, so pure error is unknown and the form of the law cannot "
            "be tested: repeat one setting, the middle one say, three or four times"
        )
    one = np.ones(law.nobs)
    about = without_levels(law.residuals[:, None], one, setting, S)[1][:, 0]
    df = (S - len(law.theta), law.nobs - S)
    return _test("rows", law.rss, float(about @ about), df, setting, law.rss)


def _left(A: Array, b: Array) -> tuple[float, int]:
    """Sum of squares of b outside the columns of A, and their rank."""
    Q = orthonormal(A)
    left = b - Q @ (Q.T @ b)
    return float(left @ left), Q.shape[1]


def settings_of(Z: Array) -> Codes:
    """Number of the setting of each row of Z, alike to nine digits; shape (n,)."""
    size = np.abs(Z).max(axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.unique(np.round(Z / size, 9), axis=0, return_inverse=True)[1].ravel(), dtype=np.intp)


def _test(
    units: str, ss_law: float, pure: float, df: tuple[int, int], setting: Codes, size: float
) -> LackOfFit | NotAvailable:
    from scipy.special import fdtrc

    counts = np.bincount(setting)
    if df[0] <= 0:
        return NotAvailable(
            f"{len(counts)} settings leave nothing over once the law is fitted: cut at further ones to test its form"
        )
    if pure <= EXACT * size:
        return NotAvailable(
            f"replicated {units} agree to every digit, so they are copies and no pure error: replicate by cutting again"
        )
    lack = max(ss_law - pure, 0.0)
    p = float(fdtrc(df[0], df[1], lack / df[0] / (pure / df[1])))
    return LackOfFit(units, lack, pure, df, len(counts), int((counts > 1).sum()), p)
