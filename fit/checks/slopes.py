"""Does every edge wear by the same exponent of time: analysis of covariance.

The test compares, with a level of its own for each edge in both, one common slope of ln t against a slope for
each edge. It takes rows of an edge as independent about its own line; serial correlation of cumulated wear makes
it reject more readily than its level says.

Source: Draper & Smith 1998, Applied Regression Analysis, section 14.4.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ...core.display import Plottable
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT
from .columns import Array, Codes, sums_by

TIME = "t"
FLAT = 1e-9  # spread of ln t within an edge below which the edge tells no exponent
ROUNDING = 1e-20  # of the within-edge sum of squares: below it rows lie on their edges' lines exactly


@dataclass(frozen=True, slots=True, repr=False)
class CommonExponent(Plottable):
    """Test of one time exponent for all edges.

    Attributes
    ----------
    response : str
    exponents : Series, indexed by edge
        Exponent of time of each edge that tells one, other factors that change within edges held alike.
    common : float
        The one exponent, from within edges alone.
    fvalue, df, pvalue : float, tuple of int, float
        F of the exponents against each other.
    """

    response: str
    exponents: "pd.Series[float]"
    common: float
    fvalue: float
    df: tuple[int, int]
    pvalue: float

    @property
    def null(self) -> str:
        """What the test takes for granted until it rejects it."""
        return "every edge has the same exponent of time"

    @property
    def concern(self) -> int:
        """0 fine, 2 exponents differ. Cause: another wear regime on some edges. Cure: name its factor, or split."""
        return 2 if self.pvalue < SIGNIFICANT else 0

    @property
    def verdict(self) -> str:
        """One sentence: what was found."""
        found = f"F({self.df[0]},{self.df[1]}) {self.fvalue:.3g}, p {self.pvalue:.1g}"
        if not self.concern:
            return f"One time exponent serves all {len(self.exponents)} edges ({found})."
        low, high = self.exponents.min(), self.exponents.max()
        return f"A common time exponent is rejected ({found}): edges range from {low:.2f} to {high:.2f}."


def common_exponent(law: LawFit) -> CommonExponent | NotAvailable:
    """Test one exponent of time for all edges of a power law, in logarithms.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> common_exponent(law).df
    (23, 191)
    """
    from scipy.special import fdtrc

    if reason := _untold(law):
        return NotAvailable(reason)
    names, edge = np.unique(np.asarray(law.edge), return_inverse=True)
    y, time, others = _inside(law, edge)
    tells = np.bincount(edge, weights=time**2) > FLAT
    df = int(tells.sum()) - 1
    slopes = _slopes(edge, time, np.column_stack([y, others]))
    own = np.column_stack([y, others]) - time[:, None] * slopes[edge]
    own[:, np.abs(own).max(axis=0) <= FLAT] = 0.0  # a factor that is an exact power of time on every edge
    b, left, rank = _least(own[:, 1:], own[:, 0])
    df_left = len(y) - len(names) - df - 1 - rank
    exact = left <= ROUNDING * float(y @ y)
    if reason := _untestable(len(y), len(names), df, df_left, exact):
        return NotAvailable(reason)
    together, all_left, _ = _least(np.column_stack([time, others]), y)
    F = max(all_left - left, 0.0) / df / (left / df_left)
    exponents = (slopes[:, 0] - slopes[:, 1:] @ b)[tells]
    return CommonExponent(
        response=law.response,
        exponents=pd.Series(exponents, index=[str(name) for name in names[tells]], name=TIME),
        common=float(together[0]),
        fvalue=float(F),
        df=(df, df_left),
        pvalue=float(fdtrc(df, df_left, F)),
    )


def _untold(law: LawFit) -> str | None:
    if law.form != "power" or TIME not in law.factors:
        return f"no time {TIME} among the factors of {law.response}: there is no time exponent"
    if law.edge is None:
        return "no edge column: whose time exponent a row tells is unknown"
    if len(set(law.edge)) < 2:
        return f"all {law.nobs} rows come from one edge: there is no other exponent to compare with"
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: exponents of edges are told in logarithms"
    return None


def _untestable(n: int, edges: int, df: int, df_left: int, exact: bool) -> str | None:
    if df < 1:
        return f"{df + 1} of {edges} edges were measured at more than one time: two are needed"
    if df_left < 1:
        return (
            f"{n} rows of {edges} edges leave nothing over once each edge has its own level and exponent: "
            "measure each edge at three times or more"
        )
    return "the rows of each edge lie on its own line exactly: no scatter to test exponents by" if exact else None


def _inside(law: LawFit, edge: Codes) -> tuple[Array, Array, Array]:
    """Logarithms of R and t, and the other columns that change within edges, each less its edge's mean."""
    logs = np.log(law.X)
    rows = np.column_stack([np.log(law.observed), logs, law.shifts])
    size = np.bincount(edge)
    means = sums_by(edge, rows, len(size)) / size[:, None]
    rows = rows - means[edge]
    j = law.factors.index(TIME)
    others = np.delete(rows[:, 1:], j, axis=1)
    return rows[:, 0], rows[:, 1 + j], others[:, np.abs(others).max(axis=0, initial=0.0) > FLAT]


def _slopes(edge: Codes, time: Array, columns: Array) -> Array:
    """Slope of each column on time within each edge, shape (G, k); 0 where time does not change."""
    size = np.bincount(edge, weights=time**2)
    size = np.where(size > FLAT, size, np.inf)
    return np.asarray(sums_by(edge, time[:, None] * columns, len(size)) / size[:, None])


def _least(X: Array, y: Array) -> tuple[Array, float, int]:
    """Coefficients, residual sum of squares and rank; columns that add nothing are no harm."""
    if not X.shape[1]:
        return np.empty(0), float(y @ y), 0
    b, _, rank, _ = np.linalg.lstsq(X, y, rcond=1e-9)
    r = y - X @ b
    return np.asarray(b, dtype=float), float(r @ r), int(rank)
