"""The law of tool lives, ``T = c0 V^a f^b d^c`` (extended Taylor), from lives of which some are known by a bound alone.

A test that was stopped before the edge failed is a run-out: its life is longer than the time in the file. Least
squares can neither take that time as the life nor leave the row out, since the long lives are those that are cut off.
The law is therefore fitted by maximum likelihood, with lognormal or Weibull lives. Intervals use Student's t with the
lives that ended less the parameters as degrees of freedom, and the scale corrected by them: normal quantiles and the
plain scale cover about 80 % instead of 95 % in simulated tables of 12 lives (benchmarks/life_intervals.py). Without
run-outs a lognormal law is that of least squares.

Sources: Taylor 1907, Trans. ASME 28, 31; Meeker & Escobar 1998, Statistical Methods for Reliability Data, chapter 17.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from ..core.arrays import Array, Ints
from ..core.censored import (
    EARLIER,
    ENDED,
    RUN_OUT,
    CensoredFit,
    Distribution,
    LifeDistribution,
    Side,
    fit_censored,
    log_likelihoods,
    standard_deviation,
    standard_quantile,
)
from ..core.display import TextTable
from ..core.errors import FitError, UsageError
from ..core.threads import one_thread
from ..datasets.draft import mark_column
from ..datasets.runs import Readable, Runs, as_runs
from .available import NotAvailable
from .fitted_rows import FittedRows, LawSource
from .lawfit import LawFit
from .laws import LawForm
from .regression import power_law
from .rows import LeftOut, Rows, check_constant, check_enough, identifiable, select

SIDE = "side of the life"  # a column for the selection of rows: 1 shorter, 2 ended, 3 longer
EXACT_LIVES = 1e-7  # residual of ln T below which lives were computed, not measured


@dataclass(frozen=True, slots=True)
class Lives:
    """Tool lives of runs.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Life, or the time that bounds it, in the unit of the runs; NaN where missing.
    side : ndarray of int, shape (n,)
        0 the life ended, 1 it is longer (run-out), -1 it is shorter.
    """

    times: Array
    side: Side


def lives_of(runs: Runs, response: str = "T") -> Lives:
    """Lives of runs and the bounds that their marks state (``>60``, ``<5``).

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import datasets
    >>> table = pd.DataFrame({"V": [90.0, 60], "T": [12.0, 60], "run-out": ["", "x"]})
    >>> lives = lives_of(datasets.runs_from_frame(table))
    >>> lives.times.tolist(), lives.side.tolist()
    ([12.0, 60.0], [0, 1])
    """
    values = runs.values(response).copy()
    side = np.zeros(len(values), dtype=np.int8)
    column = mark_column(response)
    if column in runs.data:
        for row, mark in enumerate(runs.data[column]):
            if isinstance(mark, str) and mark[:1] in "<>" and mark[1:] and np.isnan(values[row]):
                values[row] = float(mark[1:])
                side[row] = RUN_OUT if mark[0] == ">" else EARLIER
    return Lives(values, side)


@one_thread
def life_law(
    runs: Readable,
    factors: Sequence[str] = ("V", "f", "d"),
    distribution: Distribution = "lognormal",
    *,
    response: str = "T",
    edge: str | None = "edge",
    by: str | None = None,
) -> LawFit:
    """Fit ``T = c0 prod X_j^b_j`` to tool lives by maximum likelihood; run-outs count as lives of at least their time.

    Parameters
    ----------
    runs : Runs, DataFrame or path
        With the lives in the column ``response``; marks (``>60``, ``60+``) or a column of run-outs say which of them
        did not end.
    factors : sequence of str
        Symbols, most important first. A constant, or an exact product of earlier ones, is left out by name.
    distribution : {"lognormal", "weibull"}
        Of the lives about the law. The law is that of the median life for both.
    response, edge, by
        As for :func:`fitmodels.fit.power_law`. One life of an edge that is written in several rows counts once.

    Raises
    ------
    FitError
        Too few lives ended, or those that ended do not identify an exponent.

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import datasets, fit
    >>> table = pd.DataFrame({"V": [120, 120, 150, 150, 180, 180.0], "T": ["60+", "55", "31", "26", "17", "14"]})
    >>> law = fit.life_law(datasets.runs_from_frame(table), ["V"])
    >>> law.life.run_outs, round(float(law.params["V"]), 2)
    (1, -3.33)
    """
    if distribution not in get_args(Distribution):
        raise UsageError(f"distribution={distribution!r}: it is 'lognormal' or 'weibull'.")
    runs = as_runs(runs)
    response, *factors = map(runs.symbol, (response, *factors))
    lives = lives_of(runs, response)
    rows, side = _selected(runs, lives, response, factors, edge, by)
    keep, left_out = identifiable(factors, np.log(rows.X), rows.shifts, logs=True)
    law = LawForm("power", response, tuple(factors[j] for j in keep))
    rows = replace(rows, X=rows.factors(keep))
    if factors and not keep:
        check_enough(law, rows, left_out)  # refuses a law without factors
    rows, side, notes = _one_life_per_edge(rows, side, response)
    if not side.any() and distribution == "lognormal":
        return _of_least_squares(runs, law, notes, left_out, edge, by)
    _check_ended(law, rows, side, left_out)
    return _fitted(runs, law, rows, side, distribution, left_out, notes)


def _selected(
    runs: Runs, lives: Lives, response: str, factors: Sequence[str], edge: str | None, by: str | None
) -> tuple[Rows, Side]:
    """Rows with a life or a bound of it, and the side of each."""
    data = runs.data.assign(**{response: lives.times, SIDE: lives.side + 2.0})
    rows = select(replace(runs, data=data), response, [*factors, SIDE], by=by, edge=edge)
    return replace(rows, X=rows.X[:, :-1]), np.asarray(rows.X[:, -1] - 2, dtype=np.int8)


def _one_life_per_edge(rows: Rows, side: Side, response: str) -> tuple[Rows, Side, tuple[str, ...]]:
    """Rows without the copies of the life of an edge, and what else is assumed of several lives of one edge."""
    if rows.edge is None or len(set(rows.edge)) == len(rows.edge):
        return rows, side, ()
    keys = [(name, y, s, *x) for name, y, s, x in zip(rows.edge, rows.y, side, rows.X.tolist(), strict=True)]
    first = {key: row for row, key in reversed(list(enumerate(keys)))}
    kept = np.array(sorted(first.values()), dtype=np.intp)
    notes: tuple[str, ...] = ()
    if len(kept) < len(keys):
        notes = (f"the life {response} of an edge is written in several rows: each of {len(kept)} lives counts once",)
    rows = replace(
        rows, X=rows.X[kept], y=rows.y[kept], shifts=rows.shifts[kept], lines=rows.lines[kept], edge=rows.edge[kept]
    )
    return rows, side[kept], notes


def _of_least_squares(
    runs: Runs, law: LawForm, notes: tuple[str, ...], left_out: tuple[LeftOut, ...], edge: str | None, by: str | None
) -> LawFit:
    """Every life ended and lives are lognormal: least squares of ln T, with all its checks."""
    fitted = power_law(_without_copies(runs, notes, law, edge), law.response, law.factors, edge=edge, by=by)
    n, p, s = fitted.nobs, len(fitted.theta), fitted.scale_se or 0.0
    log_likelihood = float("-inf")
    if s > 0:
        ml = fitted.rss / n
        log_likelihood = float(-0.5 * n * (np.log(2 * np.pi * ml) + 1) - np.log(fitted.observed).sum())
    sd = float(np.sqrt(0.5 / (n - p))) if n > p else 0.0
    life = LifeDistribution("lognormal", s, sd, (0.0,) * p, n, 0, 0, log_likelihood)
    return replace(fitted, life=life, left_out=left_out or fitted.left_out, notes=(*notes, *fitted.notes))


def _without_copies(runs: Runs, notes: tuple[str, ...], law: LawForm, edge: str | None) -> Runs:
    """The runs with one row for each life of an edge, where lives are repeated."""
    if not notes or edge is None:
        return runs
    columns = [edge, law.response, *law.factors]
    rows = np.flatnonzero(~runs.data.duplicated(subset=columns).to_numpy())
    return replace(runs, data=runs.data.iloc[rows], lines=runs.lines[rows])


def _check_ended(law: LawForm, rows: Rows, side: Side, left_out: tuple[LeftOut, ...]) -> None:
    """Refuse lives of which too few ended, or whose ends do not identify each factor."""
    check_enough(law, rows, left_out)
    ended, p = side == ENDED, 1 + rows.X.shape[1] + rows.shifts.shape[1]
    n = int(ended.sum())
    if n <= p:
        raise FitError(
            f"{law.response}: {n} of {len(side)} lives ended, and {p} parameters ({', '.join(law.names)}) need at "
            f"least {p + 1}. Run tests to the end of the life, or leave a factor out (--map {law.factors[-1]}=none)."
        )
    _, lacking = identifiable(law.factors, np.log(rows.X[ended]), rows.shifts[ended], logs=True)
    if lacking:
        name, why = lacking[0].factor, lacking[0].reason
        raise FitError(
            f"{law.response}: among the {n} lives that ended {name} is {why}; run-outs bound its exponent on one side "
            f"alone. Run tests at other {name} to the end of the life."
        )


def _fitted(
    runs: Runs,
    law: LawForm,
    rows: Rows,
    side: Side,
    distribution: Distribution,
    left_out: tuple[LeftOut, ...],
    notes: tuple[str, ...],
) -> LawFit:
    """The maximum-likelihood law of the median life."""
    Z, ln_life = law.design(rows.X, rows.shifts), np.log(rows.y)
    found = fit_censored(Z, ln_life, side, distribution)
    if found.scale < EXACT_LIVES:
        raise FitError(
            f"{law.response}: the lives that ended meet the law exactly, so they were computed and have no scatter to "
            "weigh run-outs by. Leave the run-outs out."
        )
    p, n = Z.shape[1], int((side == ENDED).sum())
    C = found.covariance * n / (n - p)
    scale = float(found.scale * np.sqrt(n / (n - p)))
    theta, C = _of_median(found, C, distribution, found.scale)
    check_constant(law, theta, Z)
    fitted = law.response_at(theta, Z)
    sd = standard_deviation(distribution, scale)
    rss = sd**2 * (n - p)
    level = fit_censored(np.ones((len(Z), 1)), ln_life, side, distribution).log_likelihood
    ratio = float(np.exp(min(2 * (found.log_likelihood - level) / len(side), 700.0)))  # 1 / (1 - R2), Cox & Snell
    life = LifeDistribution(
        distribution, scale, float(np.sqrt(C[p, p])), tuple(C[p, :p].tolist()), n, int((side == RUN_OUT).sum()),
        int((side == EARLIER).sum()), found.log_likelihood,
    )  # fmt: skip
    kept = FittedRows(rows.X, rows.shifts, rows.y, fitted, ln_life - np.log(fitted), rows.lines, rows.edge, side)
    return LawFit.of_rows(
        kept, law, error="multiplicative", theta=theta, cov_theta=C[:p, :p], rss=rss, tss=rss * max(ratio, 1.0),
        units={name: runs.units.get(name, "") for name in (law.response, *law.factors)}, edges=_inference(rows),
        by=rows.by, left_out=left_out, dropped=rows.dropped, notes=notes, repeats=rows.repeats,
        source=LawSource.of_runs(runs), life=life,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class LeftOutLives:
    """Predictive scores of laws of tool lives on lives left out of the fit, of which some are run-outs.

    Attributes
    ----------
    response : str
    left_out : str
        What was left out, ``edge`` or ``row``.
    names : tuple of str
        ``power`` (lognormal lives), ``weibull``, and ``exponential``: ln T linear in the factors themselves.
    scores : ndarray, shape (units, forms)
        Log likelihood of the lives of each unit by the law of the others.
    """

    response: str
    left_out: str
    names: tuple[str, ...]
    scores: Array

    def against_first(self, j: int) -> tuple[float, float]:
        """Mean score of form j less that of the first, and its standard error over units."""
        difference = self.scores[:, j] - self.scores[:, 0]
        return float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(len(difference)))

    @property
    def better(self) -> tuple[str, ...]:
        """Forms that are better than the first by more than chance: two standard errors."""
        found = ((name, *self.against_first(j)) for j, name in enumerate(self.names) if j)
        return tuple(name for name, mean, error in found if mean > 2 * error)

    @property
    def table(self) -> TextTable:
        """Mean score of each form, and its difference from that of the first."""
        rows = [
            (name, f"{self.scores[:, j].mean():.3f}", *((f"{mean:+.3f}", f"{error:.3f}") if j else ("", "")))
            for j, name in enumerate(self.names)
            for mean, error in [self.against_first(j)]
        ]
        return TextTable(("form", "score", "difference", "SE"), tuple(rows))

    @property
    def verdict(self) -> str:
        """The sentence on which law to keep."""
        if not self.better:
            return f"{self.response}: power with lognormal lives is kept: no other form is better by more than chance."
        best = max(self.better, key=lambda name: self.scores[:, self.names.index(name)].mean())
        keep = (
            f"keep it with --form {best}" if best == "weibull" else "it takes no run-outs, so test the power law more"
        )
        return f"{self.response}: {best} foresees left-out lives better than power by more than chance: {keep}."


def left_out_lives(law: LawFit) -> LeftOutLives:
    """Score laws of tool lives, of which some are bounds, on edges (or rows) that each fit has not seen.

    Raises
    ------
    FitError
        The law has no rows of lives, or a form cannot be fitted without one unit.

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import datasets, fit
    >>> table = pd.DataFrame({"V": [120, 120, 150, 150, 180, 180.0], "T": ["60+", "55", "31", "26", "17", "14"]})
    >>> found = left_out_lives(fit.life_law(datasets.runs_from_frame(table), ["V"]))
    >>> found.names, found.scores.shape
    (('power', 'weibull', 'exponential'), (6, 3))
    """
    rows = law.rows
    if rows is None or law.life is None:
        raise FitError(f"{law.response}: forms of lives need a law of lives that keeps its rows.")
    side = np.zeros(len(rows), dtype=np.int8) if rows.side is None else rows.side
    units = np.arange(len(rows)) if rows.edge is None else rows.edge_numbers
    one = np.ones((len(rows), 1))
    powers, plain = (np.hstack([one, X, rows.shifts]) for X in (np.log(rows.X), rows.X / rows.X.mean(axis=0)))
    forms: dict[str, tuple[Array, Distribution]] = {
        "power": (powers, "lognormal"), "weibull": (powers, "weibull"), "exponential": (plain, "lognormal")
    }  # fmt: skip
    scores = [_left_out_scores(Z, np.log(rows.observed), side, kind, units) for Z, kind in forms.values()]
    return LeftOutLives(law.response, "row" if rows.edge is None else "edge", tuple(forms), np.column_stack(scores))


def _left_out_scores(Z: Array, ln_life: Array, side: Side, kind: Distribution, units: Ints) -> Array:
    """Log likelihood of the lives of each unit by the fit to the others, shape (units,)."""
    out = np.empty(int(units.max()) + 1)
    for g in range(len(out)):
        kept, gone = units != g, units == g
        found = fit_censored(Z[kept], ln_life[kept], side[kept], kind)
        ended = int((side[kept] == ENDED).sum())
        if ended <= Z.shape[1]:
            raise FitError(f"{ended} lives that ended are too few to leave one out")
        scale = found.scale * float(np.sqrt(ended / (ended - Z.shape[1])))
        z = (ln_life[gone] - Z[gone] @ found.beta) / scale
        out[g] = float(log_likelihoods(z, side[gone], kind, scale).sum())
    return out


def _of_median(found: CensoredFit, C: Array, distribution: Distribution, scale: float) -> tuple[Array, Array]:
    """Parameters of the median life and their covariance with ln s, from those of the location."""
    step = scale * standard_quantile(distribution, 0.5)
    theta = found.beta.copy()
    theta[0] += step
    J = np.eye(len(C))
    J[0, -1] = step
    return theta, J @ C @ J.T


def _inference(rows: Rows) -> NotAvailable:
    if rows.edge is None:
        return NotAvailable("each life is a separate edge: lives are independent")
    n, m = len(rows.edge), len(set(rows.edge))
    if m == n:
        return NotAvailable(f"each of the {n} lives is a separate edge: lives are independent")
    return NotAvailable(f"the column of edges names {m} for {n} different lives: each life is a separate edge")
