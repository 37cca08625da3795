"""One test of many new rows against a law, by strata: levels of new edges, and rows about them.

Rows of one edge stand off a law together, so that counting them proves little. With e the new residuals, A their
columns, C the law's covariance and D the variance of an edge's mean, or of a row within its edge,

    T = e' (A C A' + D)^-1 e / K  ~  F(K, df)

in each stratum. For independent rows this is Chow's test of new observations, which is exact.

Sources: Chow 1960, Econometrica 28, 591; Harville 1977, J. Am. Stat. Assoc. 72, 320 (strata of a random level).
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.display import Displayable
from .about import df_between, df_within
from .edges import EdgeInference
from .lawfit import LawFit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, repr=False)
class JointTest(Displayable):
    """F of one part of the new residuals.

    Attributes
    ----------
    of : {"levels of edges", "rows within edges", "rows"}
    null : str
    statistic, pvalue : float
    df : tuple of float
    """

    of: str
    null: str
    statistic: float
    df: tuple[float, float]
    pvalue: float


def of_rows(law: LawFit, A: Array, e: Array) -> JointTest:
    """Chow's test of residuals e (n,) with columns A (n, p): new rows against the law, all independent."""
    T = quadratic(e, A, law.covariance(), np.full(len(e), (law.scale_se or 0.0) ** 2))
    return _test("rows", "new rows scatter about the law as those of the fit do", T, len(e), float(law.df_resid))


def by_edge(
    law: LawFit, edges: EdgeInference, A: Array, e: Array, rows: pd.DataFrame, level: float
) -> tuple[tuple[JointTest, ...], pd.DataFrame]:
    """Tests of levels and of rows within edges, and a table of the edges; ``rows`` tells edge and predicted."""
    from scipy.special import stdtrit

    names, number = np.unique(rows["edge"].astype(str), return_inverse=True)
    fitted = rows["predicted"].to_numpy()
    size = np.bincount(number).astype(float)
    means = np.column_stack([np.bincount(number, weights=a) for a in (*A.T, e)]) / size[:, None]
    B, level_of = means[:, :-1], means[:, -1]
    own = edges.mixed.sd_between**2 + edges.mixed.sd_within**2 / size
    df, inner = df_between(law), df_within(law)
    null = "levels of new edges scatter about the law as those of the fit do"
    tests = [_test("levels of edges", null, quadratic(level_of, B, edges.cov_theta, own), len(names), df)]
    if len(e) > len(names):
        about, columns = e - level_of[number], A - B[number]
        T = quadratic(about, columns, edges.cov_theta, np.full(len(e), edges.mixed.sd_within**2))
        null = "rows scatter about the level of their edge as those of the fit do"
        tests.append(_test("rows within edges", null, T, len(e) - len(names), inner))
    sd = np.sqrt(own + np.einsum("ij,jk,ik->i", B, edges.cov_theta, B))
    z = over(level_of, sd)
    ratio = (
        np.exp(level_of) if law.error == "multiplicative" else 1 + np.bincount(number, e) / np.bincount(number, fitted)
    )
    inside = np.abs(z) <= float(stdtrit(df, (1 + level) / 2))
    table = pd.DataFrame({"rows": size.astype(int), "ratio": ratio, "z": z, "inside": inside}, index=list(names))
    return tuple(tests), table


def no_edges() -> pd.DataFrame:
    """The table of the edges where there are none."""
    return pd.DataFrame({"rows": [], "ratio": [], "z": [], "inside": np.empty(0, dtype=bool)})


def quadratic(e: Array, A: Array, C: Array, d: Array) -> float:
    """``e' (A C A' + diag(d))^-1 e`` without the n x n matrix (Woodbury).

    Examples
    --------
    >>> round(quadratic(np.array([1.0, 1.0]), np.ones((2, 1)), np.array([[0.5]]), np.ones(2)), 12)
    1.0
    """
    if not (d > 0).all():
        return float("inf") if np.any(e != 0) else 0.0
    values, vectors = np.linalg.eigh(C)
    B = A @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    u = B.T @ (e / d)
    inner = np.eye(len(C)) + B.T @ (B / d[:, None])
    return float(e @ (e / d) - u @ np.linalg.solve(inner, u))


def _test(of: str, null: str, T: float, K: int, df: float) -> JointTest:
    from scipy.special import fdtrc

    F = max(T, 0.0) / K
    return JointTest(of, null, F, (float(K), df), float(fdtrc(K, df, F)) if np.isfinite(F) else 0.0)


def over(e: Array, sd: Array) -> Array:
    """Deviation over its standard deviation; of an exact law 0 or infinite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sd > 0, e / sd, np.where(e == 0, 0.0, np.copysign(np.inf, e)))
