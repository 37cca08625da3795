"""Confirmation of a law by new runs: rows against prediction intervals, and joint tests by strata.

Rows of one edge deviate from the law together, so that counting them is no test. With e the new residuals, A their
columns, C the covariance of the law and D the variance of the mean of an edge, or of a row within its edge,

    T = e' (A C A' + D)^-1 e / K  ~  F(K, df)

in each stratum; the p values are combined by Bonferroni. For independent rows this is Chow's test of new observations,
which is exact.

Sources: Chow 1960, Econometrica 28, 591; Harville 1977, J. Am. Stat. Assoc. 72, 320 (strata of a random level).
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.calls import check_share
from ..core.display import Displayable, Plottable
from ..core.errors import FitError, UsageError
from ..core.rounding import count
from ..datasets.runs import Readable, Runs, as_runs
from .available import NotAvailable
from .edges import EdgeInference
from .lawfit import LawFit
from .least_squares import sums_by
from .prediction import new_edge, no_edge_interval
from .rows import Dropped, select


@dataclass(frozen=True, slots=True, repr=False)
class OutsideRegion(Displayable):
    """A new row outside the region of the design: its line in the file, and by what it is outside."""

    line: int
    reason: str


@dataclass(frozen=True, slots=True, repr=False)
class JointTest(Displayable):
    """F test of one stratum of the new residuals.

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


@dataclass(frozen=True, slots=True, repr=False)
class Confirmation(Plottable):
    """New runs compared with the predictions of a law.

    Attributes
    ----------
    response : str
    level : float
        Of the prediction intervals; significance of the tests: one less it.
    rows : DataFrame
        A row for each new row that was compared: line, edge, observed, predicted, low, high (in the unit of the
        response), inside, and z, its deviation over the standard deviation of its prediction.
    edges : DataFrame
        A row for each new edge: rows, ratio of observed to predicted (of their geometric means where errors
        multiply, else of their means), z of its level, and inside. Empty where the new rows name no edges or the
        law has no inference by edge.
    tests : tuple of JointTest, or NotAvailable
    not_compared : tuple of OutsideRegion
    dropped : tuple of Dropped
        Rows without a usable response or factor.
    """

    response: str
    level: float
    rows: pd.DataFrame
    edges: pd.DataFrame
    tests: tuple[JointTest, ...] | NotAvailable
    not_compared: tuple[OutsideRegion, ...]
    dropped: tuple[Dropped, ...]

    @property
    def outside(self) -> int:
        """Rows outside their prediction interval."""
        return int((~self.rows["inside"]).sum())

    @property
    def expected(self) -> float:
        """Rows that would fall outside by chance if the law held."""
        return (1 - self.level) * len(self.rows)

    @property
    def pvalue(self) -> float | None:
        """P of all parts together (Bonferroni); None where there is no test."""
        if isinstance(self.tests, NotAvailable):
            return None
        return min(1.0, len(self.tests) * min(test.pvalue for test in self.tests))

    @property
    def holds(self) -> bool | None:
        """Whether the law holds for the new runs; None where that cannot be tested.

        False has three causes: another material or tool, a form that is wrong here, or edges that differ more
        than those of the fit did. Remedy: fit both together and test lack of fit.
        """
        return None if self.pvalue is None else self.pvalue >= 1 - self.level

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        n, k = len(self.rows), self.outside
        head = (
            f"{self.response}: {k} of {n} rows {'falls' if k == 1 else 'fall'} outside the "
            f"{100 * self.level:.4g} % prediction intervals, {self.expected:.2g} expected by chance"
        )
        return f"{head}: {self._conclusion()}{self._not_compared()}."

    def _conclusion(self) -> str:
        if isinstance(self.tests, NotAvailable):
            return f"no joint test: {self.tests.reason}{self._deviation() if self.outside else ''}"
        p = f"p {self.pvalue:.2g}" if self.pvalue is not None and self.pvalue >= 1e-4 else "p < 0.0001"
        if self.holds:
            return f"the law holds for these runs ({p}{self._weak()})"
        worst = min(self.tests, key=lambda test: test.pvalue)
        if worst.of == "rows within edges":
            return (
                f"the law does not hold: rows deviate from it within their edges ({p}): time or wear acts differently"
            )
        off = self.edges[~self.edges["inside"]] if len(self.edges) else self.edges
        if len(off):
            which = ", ".join(f"{name} ({_off(row['ratio'])})" for name, row in off.head(6).iterrows())
            more, s = ", ..." if len(off) > 6 else "", "s" if len(off) > 1 else ""
            return f"the law does not hold for edge{s} {which}{more} ({p})"
        return f"the law does not hold for these runs taken together ({p}){self._deviation()}"

    def _weak(self) -> str:
        """Remark on a single new edge, which may deviate by its own level as far as the law allows; else empty."""
        if len(self.edges) == 1:
            return "; weak evidence: one new edge, test two or more"
        return "; weak evidence: one new row, test two or more" if len(self.rows) == 1 else ""

    def _deviation(self) -> str:
        """Ratio of the observed values to the predicted ones: its geometric mean, and the least and the largest."""
        ratio = (self.rows["observed"] / self.rows["predicted"]).to_numpy(dtype=float)
        if not (ratio > 0).all():
            return ""
        mean, low, high = (_off(float(r)) for r in (np.exp(np.log(ratio).mean()), ratio.min(), ratio.max()))
        return f": {mean} the predictions on average" + (f" ({low} to {high})" if len(ratio) > 1 else "")

    def _not_compared(self) -> str:
        if not self.not_compared:
            return ""
        lines = ", ".join(str(row.line) for row in self.not_compared[:6]) + (
            ", ..." if len(self.not_compared) > 6 else ""
        )
        first = self.not_compared[0]
        n = len(self.not_compared)
        return (
            f"; {count(n, 'row')} outside the region of the design {'are' if n > 1 else 'is'} not compared "
            f"(line{'s' if n > 1 else ''} {lines}; line {first.line} is {first.reason.split('; ')[0]})"
        )


def confirm(law: LawFit, runs: Readable, level: float = 0.95) -> Confirmation:
    """Test a law with new runs.

    Parameters
    ----------
    law : LawFit
    runs : Runs, DataFrame or path
        With the response, every factor and, where the law has inference by edge, the column ``edge``.
    level : float
        Level of the prediction intervals for a row of a new edge, between 0 and 1.

    Raises
    ------
    UsageError
        A column is missing, in another unit, or ``level`` is not between 0 and 1.
    FitError
        No row can be compared, the rows are those of the fit, or the law has no interval.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.confirmation import confirm
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> late = runs.data["edge"].isin(["E01", "E12"])
    >>> law, new = (datasets.runs_from_frame(runs.data[part].drop(columns="point")) for part in (~late, late))
    >>> confirm(fit.power_law(law, "AW", ["V", "f", "d", "t"]), new).holds
    True
    """
    runs = as_runs(runs)
    check_share("level", level)
    if law.no_interval:
        raise FitError(f"{law.response}: {law.no_interval}. Add observations.")
    _columns_there(law, runs)
    new, frame, dropped = _usable(law, runs)
    place = law.region
    comparable = place.inside(frame[list(_needed(law))])
    not_compared = tuple(
        OutsideRegion(int(line), place.words(frame[list(_needed(law))].iloc[[i]]))
        for i, line in enumerate(frame["line"])
        if not comparable[i]
    )
    if not comparable.any():
        raise FitError(
            f"{law.response}: none of the {len(frame)} new rows lies in the region of the design (line "
            f"{not_compared[0].line} is {not_compared[0].reason}). Measure inside it, or fit them together with the "
            "earlier runs."
        )
    frame = frame[comparable].reset_index(drop=True)
    return _compare(law, frame, level, named=new, not_compared=not_compared, dropped=dropped)


def _needed(law: LawFit) -> tuple[str, ...]:
    return (*law.factors, *((law.by.column,) if law.by else ()))


def _columns_there(law: LawFit, runs: Runs) -> None:
    missing = [name for name in (law.response, *_needed(law)) if not runs.has(name)]
    if missing:
        raise UsageError(
            f"{runs.source.name} has no {', '.join(missing)}: the law of {law.response} needs "
            f"{', '.join((law.response, *_needed(law)))}. Measure it, or name its column with --map."
        )
    for name in (law.response, *law.factors):
        old, now = law.units.get(name, ""), runs.units.get(name, "")
        if old and now and old != now:
            raise UsageError(f"{name} is in {now} in {runs.source.name} and in {old} in the law: give it in {old}.")


def _usable(law: LawFit, runs: Runs) -> tuple[bool, pd.DataFrame, tuple[Dropped, ...]]:
    """Whether edges are named, and the new rows that can be compared, in the units of the law."""
    places = replace(runs, lines=np.arange(len(runs)))  # a row's line may not be its own in joined files
    rows = select(places, law.response, law.factors, positive=law.formula.positive(law.error))
    dropped = tuple(replace(item, lines=tuple(int(runs.lines[i]) for i in item.lines)) for item in rows.dropped)
    if not len(rows.y):
        why = "; ".join(f"{item.count} with {item.reason}" for item in dropped)
        raise FitError(f"{law.response}: {runs.source.name} has no usable row ({why}). Check the columns.")
    _unseen(law, rows.X, rows.y)
    frame = pd.DataFrame(rows.X, columns=list(law.factors))
    frame["line"], frame["observed"] = runs.lines[rows.lines], rows.y
    if law.by is not None:
        frame[law.by.column] = runs.labels(law.by.column)[rows.lines]
    named = rows.edge is not None and bool((rows.edge != "").all())
    frame["edge"] = rows.edge if rows.edge is not None else ""
    return named, frame, dropped


def _unseen(law: LawFit, X: Array, y: Array) -> None:
    """Refuse the rows of the fit: a law always agrees with them."""
    old = set(map(tuple, np.column_stack([law.X, law.observed]).tolist()))
    if all(row in old for row in map(tuple, np.column_stack([X, y]).tolist())):
        raise FitError(
            f"{law.response}: all {len(y)} rows are among those the law was fitted to, so they cannot confirm it. "
            "Give runs that it has not seen."
        )


def _compare(
    law: LawFit,
    frame: pd.DataFrame,
    level: float,
    *,
    named: bool,
    not_compared: tuple[OutsideRegion, ...],
    dropped: tuple[Dropped, ...],
) -> Confirmation:
    from scipy.special import stdtrit

    Z = law.design_of(frame)
    at = new_edge(law, Z)
    predicted, observed = law.formula.response_at(law.theta, Z), frame["observed"].to_numpy(dtype=float)
    multiplies = law.error == "multiplicative"
    expected, A = law.formula.scaled(law.theta, Z, law.error)
    e = (np.log(observed) if multiplies else observed) - expected
    sd = np.sqrt(at.variance + at.sd**2)
    half = float(stdtrit(at.df, (1 + level) / 2)) * sd
    ends = (predicted * np.exp(-half), predicted * np.exp(half)) if multiplies else (predicted - half, predicted + half)
    rows = frame[["line", "edge", "observed"]].assign(
        predicted=predicted, low=ends[0], high=ends[1], inside=np.abs(e) <= half, z=_over(e, sd)
    )
    if unknown := no_edge_interval(law):
        tests: tuple[JointTest, ...] | NotAvailable = NotAvailable(f"{unknown}, and each new edge may deviate by it")
        edges = _no_edges()
    elif not isinstance(law.edges, EdgeInference):
        tests = (_of_rows(law, A, e),)
        edges = _no_edges()
    elif not named:
        tests, edges = NotAvailable("the new rows have no edge column"), _no_edges()
    else:
        tests, edges = _by_edge(law, law.edges, A[:, law.free], e, rows, level)
    return Confirmation(law.response, level, rows, edges, tests, not_compared, dropped)


def _off(ratio: float) -> str:
    percent = 100 * abs(ratio - 1)
    return f"{percent:.{0 if percent >= 10 else 1}f} % {'above' if ratio > 1 else 'below'}"


def _of_rows(law: LawFit, A: Array, e: Array) -> JointTest:
    """Chow's test of residuals e (n,) with columns A (n, p): new rows against the law, all independent."""
    T = quadratic(e, A, law.covariance(), np.full(len(e), (law.scale_se or 0.0) ** 2))
    return _test("rows", "new rows scatter about the law as those of the fit do", T, len(e), float(law.df_resid))


def _by_edge(
    law: LawFit, edges: EdgeInference, A: Array, e: Array, rows: pd.DataFrame, level: float
) -> tuple[tuple[JointTest, ...], pd.DataFrame]:
    """Tests of levels and of rows within edges, and a table of the edges; ``rows`` holds edge and predicted."""
    from scipy.special import stdtrit

    names, number = np.unique(rows["edge"].astype(str), return_inverse=True)
    fitted = rows["predicted"].to_numpy()
    size = np.bincount(number).astype(float)
    means = sums_by(number, np.column_stack([A, e]), len(size)) / size[:, None]
    B, level_of = means[:, :-1], means[:, -1]
    own = edges.mixed.sd_between**2 + edges.mixed.sd_within**2 / size
    df, inner = float(edges.df_between), float(edges.df_within)
    null = "levels of new edges scatter about the law as those of the fit do"
    tests = [_test("levels of edges", null, quadratic(level_of, B, edges.cov_theta, own), len(names), df)]
    if len(e) > len(names):
        about, columns = e - level_of[number], A - B[number]
        T = quadratic(about, columns, edges.cov_theta, np.full(len(e), edges.mixed.sd_within**2))
        null = "rows scatter about the level of their edge as those of the fit do"
        tests.append(_test("rows within edges", null, T, len(e) - len(names), inner))
    sd = np.sqrt(own + np.einsum("ij,jk,ik->i", B, edges.cov_theta, B))
    z = _over(level_of, sd)
    ratio = (
        np.exp(level_of) if law.error == "multiplicative" else 1 + np.bincount(number, e) / np.bincount(number, fitted)
    )
    inside = np.abs(z) <= float(stdtrit(df, (1 + level) / 2))
    table = pd.DataFrame({"rows": size.astype(int), "ratio": ratio, "z": z, "inside": inside}, index=list(names))
    return tuple(tests), table


def _no_edges() -> pd.DataFrame:
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


def _over(e: Array, sd: Array) -> Array:
    """Deviation over its standard deviation; of an exact law 0 or infinite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sd > 0, e / sd, np.where(e == 0, 0.0, np.copysign(np.inf, e)))
