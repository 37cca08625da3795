"""Tool life from a wear law: the time at which the law reaches a wear criterion (Taylor).

From ``AW = c0 V^a f^b d^g t^k`` and a criterion W follows ``T = (W/c0)^(1/k) V^(-a/k) f^(-b/k) d^(-g/k)``, Taylor's
``V T^n = C`` with ``n = k/a``. Source: ISO 3685:1993, annex on tool-life equations.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.calls import Conditions, Takes, check_share, conditions
from ..core.display import Plottable
from ..core.errors import FitError, UsageError
from ..core.intervals import Kind, Root, edge_words, fieller, solved_for
from ..core.predictions import EXTRAPOLATED, LifePrediction, compared_time, single, unreached_words, within_tests
from ..core.predicts import Predicts
from ..core.rounding import middle_of
from ..core.verdict import Verdict, verdict_from
from ..datasets import Runs
from .checks.exponent_ranges import usual_taylor_n
from .lawfit import LawFit
from .laws import LARGEST_LOG
from .prediction import edge_sd, inside_of, no_edge_interval, of_band
from .rows import as_table

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True, repr=False)
class ToolLife(Predicts, Plottable):
    """Tool life T, in the unit of t, at a wear criterion.

    Attributes
    ----------
    criterion : float
        Wear at which the edge is worn out, in ``unit_of_wear``.
    coefficients, bse : Series
        Constant ``c0`` and exponents of T by factor, with standard errors by the delta method (None: none).
    taylor_n : float or None
        n of ``V T^n = C``; None where the wear law has no V.
    t_observed : float
        Longest time in the data: a life beyond it is an extrapolation.
    typical, typical_at : float, mapping
        Life at the middle of every factor, and that middle: the geometric mean of its range to three digits.
    """

    wear: str
    criterion: float
    unit_of_wear: str
    unit: str
    coefficients: "pd.Series[float]"
    bse: "pd.Series[float] | None"
    taylor_n: float | None
    t_observed: float
    typical: float
    typical_at: dict[str, float]
    law: LawFit | None = field(default=None, repr=False, compare=False)

    def interval(self, of: Literal["law", "edge"] = "edge", level: float = 0.95, **factors: float) -> Interval | None:
        """Interval of the life by Fieller's theorem: of the law, or of one new edge; None without a covariance.

        An end is 0 or infinite where it is not bounded: the interval of the time exponent reaches zero, or the scatter
        between edges is not known.

        Examples
        --------
        >>> from fitmodels import datasets, fit
        >>> life = fit.tool_life(fit.power_law(datasets.bundled("gc435_709m40"), "AW", ["V", "f", "d", "t"]))
        >>> [round(end, 1) for end in life.interval("law", V=100, f=0.19, d=2)]
        [86.8, 133.2]
        """
        if of not in ("law", "edge"):
            raise UsageError(f"of={of!r}: an interval of the 'law' or of one new 'edge'.")
        check_share("level", level)
        self._values(conditions(self._takes, None, None, factors))  # refuses what is missing or no number
        if self.law is None or self.law.cov_theta is None:
            return None
        return _exponentials(
            _root(self.law, self.criterion, factors, level, edge_variance(self.law, self.criterion, of))
        )

    @property
    def taylor(self) -> "TaylorConstants | None":
        """Constants n and C of ``V T^n = C`` with 95 % intervals; None where the wear law has no V."""
        return None if self.law is None else taylor_constants(self.law, self.criterion)

    @property
    def _takes(self) -> Takes:
        units = {} if self.law is None else self.law.units
        factors = {str(name): units.get(str(name), "") for name in self.coefficients.index[1:]}
        return Takes(f"the life at {self.wear} {self.criterion:g} {self.unit_of_wear}", factors, None, FitError)

    def _predicted(self, given: Conditions, *, kind: Kind, level: float, **other: Any) -> LifePrediction:  # noqa: ANN401
        """Life of one new edge, or of the law; by Fieller's theorem at each point."""
        check_share("level", level)
        if kind not in ("mean", "prediction") or (other["edge"], other["centre"]) != ("new", "median"):
            raise UsageError("a life has the kinds 'mean' (of the law) and 'prediction' (of one new edge), no others.")
        if self.law is None or self.law.cov_theta is None:
            raise FitError("the wear law has no interval, so its life has none; values(...) gives the life alone.")
        at = {**given, "t": self._values(given)}
        table, of = as_table("T", at), "law" if kind == "mean" else "edge"
        rows = table.drop(columns="t").to_dict("records")
        ends = np.array([self.interval(of, level, **row) for row in rows])  # type: ignore[arg-type]
        band = pd.DataFrame({"value": table["t"], "low": ends[:, 0], "high": ends[:, 1]})
        band["inside"] = inside_of(self.law, table.assign(t=compared_time(table["t"], self.t_observed)))[0]
        edge = edge_words(no_edge_interval(self.law), known=self.law.n_edges is not None)
        whose = f"{100 * level:g} % interval of {'the law' if kind == 'mean' else edge}, by Fieller's theorem,"
        words = f"time at which {self.wear} reaches {self.criterion:g} {self.unit_of_wear}, {whose}"
        band.attrs = {"kind": kind, "level": level, "coverage": None, "edge": "new", "centre": "median", "words": words}
        found = of_band(self.law, at, table, band)
        held = {one.name: getattr(found, one.name) for one in fields(found)}
        life = LifePrediction(**{**held, "response": "T", "unit": self.unit, "error": "multiplicative"})
        most = float(self.law.observed.max()) if self.law.rows is not None else None
        return within_tests(life, self.t_observed, unreached_words(self.criterion, most, self.unit_of_wear))

    def _values(self, given: Conditions) -> Any:  # noqa: ANN401
        names = [str(name) for name in self.coefficients.index[1:]]
        if missing := [name for name in names if name not in given]:
            raise FitError(f"tool life needs {', '.join(missing)}; give {missing[0]}=...")
        if bad := next((name for name in names if not np.all(given[name] > 0)), None):
            raise FitError(f"{bad} {np.min(given[bad]):g}: a power law needs values above zero.")
        return _life(self.coefficients, given)


def tool_life(law: LawFit, criterion: float = 0.3) -> ToolLife:
    """Tool life by a wear law: its time at a criterion.

    Parameters
    ----------
    law : LawFit
        A power law of wear that holds ``t``.
    criterion : float
        In the unit of the wear; 0.3 mm is ISO 3685's average flank wear.

    Raises
    ------
    FitError
        The law has no t, or its wear does not grow with time.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> life = fit.tool_life(fit.power_law(datasets.bundled("gc435_709m40"), "AW", ["V", "f", "d", "t"]))
    >>> bool(0.2 < life.taylor_n < 0.7)
    True
    """
    if law.form != "power" or "t" not in law.factors:
        how = f"in the form {law.form.replace('_', '-')}" if "t" in law.factors else "without t"
        raise FitError(f"tool life needs a power law of wear on time t; {law.response} is fitted {how}.")
    if not (criterion > 0 and np.isfinite(criterion)):
        raise FitError(f"wear criterion {criterion}: it needs a value above zero, for instance 0.3 mm.")
    if law.by is not None:
        raise FitError(f"a law by {law.by.column!r} has no tool life: fit each level alone, in a file of its own.")
    k = float(law.params["t"])
    if k <= 0:
        raise FitError(f"{law.response} falls with time (t exponent {k:.3g}): it has no tool life.")
    at = law.names.index("t")
    others = [j for j in range(len(law.theta)) if j != at]
    eta = -law.theta[others] / k
    eta[0] += np.log(criterion) / k
    middle = {name: middle_of(*ends, logs=True) for name, ends in law.domain.items() if name != "t"}
    values = eta.copy()
    if abs(eta[0]) > LARGEST_LOG:
        raise FitError(
            f"{law.response} hardly grows with time (t exponent {k:.3g}): it reaches {criterion:g} "
            f"{law.units[law.response]} in no finite time."
        )
    values[0] = np.exp(eta[0])
    coefficients = pd.Series(values, index=[law.names[j] for j in others])
    return ToolLife(
        wear=law.response,
        criterion=criterion,
        unit_of_wear=law.units[law.response],
        unit=law.units["t"],
        coefficients=coefficients,
        bse=_standard_errors(law, eta, values, others, at),
        taylor_n=k / float(law.params["V"]) if "V" in law.factors else None,
        t_observed=law.domain["t"][1],
        typical=_life(coefficients, middle),
        typical_at=middle,
        law=law,
    )


@dataclass(frozen=True, slots=True)
class TaylorConstants:
    """Constants of Taylor's ``V T^n = C`` with intervals.

    Attributes
    ----------
    n, n_interval : float, and (low, high) or None
    C, C_interval : float, and (low, high) or None
        Speed of a life of one unit of time, in the unit of V, with the other factors at ``at``; an end is 0 or infinite
        where it is not bounded. None: no covariance.
    at : mapping
        Middle of the other factors.
    level : float
    """

    n: float
    n_interval: Interval | None
    C: float
    C_interval: Interval | None
    at: dict[str, float]
    level: float


def taylor_constants(law: LawFit, criterion: float | None = None, level: float = 0.95) -> TaylorConstants | None:
    """Taylor's constants of a law of tool life, or of a wear law at a criterion; None without V.

    Both are ratios of coefficients, so their intervals are Fieller's.

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import datasets, fit
    >>> table = pd.DataFrame({"V": [120, 120, 150, 150, 180, 180.0], "T": ["60+", "55", "31", "26", "17", "14"]})
    >>> found = taylor_constants(fit.life_law(datasets.runs_from_frame(table), ["V"]))
    >>> round(found.n, 3), round(found.n_interval[0], 3), round(found.C)
    (0.3, 0.232, 410)
    """
    if law.form != "power" or "V" not in law.factors:
        return None
    at, theta, C = law.names.index("V"), law.theta, law.covariance()
    middle = {name: middle_of(*ends, logs=True) for name, ends in law.domain.items() if name not in ("V", "t")}
    z = _columns(law, {**middle, "V": 1.0, "t": 1.0})
    known = law.cov_theta is not None
    C, t = (C if known else np.zeros_like(C)), law.t_quantile(level)
    speed = solved_for(theta, C, z, at, 0.0 if criterion is None else float(np.log(criterion)), t)
    if "t" in law.factors:
        k = law.names.index("t")
        moments = (float(C[k, k]), -float(C[k, at]), float(C[at, at]))
        n = fieller(float(theta[k]), -float(theta[at]), moments, t)
    else:
        n = fieller(1.0, float(theta[at]), (0.0, 0.0, float(C[at, at])), t)
    return TaylorConstants(
        n.value, (n.low, n.high) if known else None, float(np.exp(min(speed.value, LARGEST_LOG))),
        _exponentials(speed) if known else None, middle, level,
    )  # fmt: skip


def _columns(law: LawFit, factors: Mapping[str, float]) -> Array:
    """Row of the design, shape (p,)."""
    z = np.zeros(len(law.theta))
    z[0] = 1.0
    z[1 : 1 + len(law.factors)] = [np.log(factors[name]) for name in law.factors]
    return z


def _root(law: LawFit, criterion: float, factors: Mapping[str, float], level: float, extra: float) -> Root:
    """Logarithm of the time at which the law reaches the criterion."""
    z, at = _columns(law, {**factors, "t": 1.0}), law.names.index("t")
    return solved_for(law.theta, law.covariance(), z, at, float(np.log(criterion)), law.t_quantile(level), extra)


def edge_variance(law: LawFit, criterion: float, of: str = "edge") -> float:
    """Variance of ln wear of a new edge about its law, infinite where it is not known; 0 for the law itself."""
    if of == "law":
        return 0.0
    sd = edge_sd(law)
    return (sd if law.error == "multiplicative" else sd / criterion) ** 2


def _exponentials(root: Root) -> Interval:
    with np.errstate(over="ignore", under="ignore"):
        return float(np.exp(root.low)), float(np.exp(root.high))


def _life(coefficients: "pd.Series[float]", factors: Mapping[str, Any]) -> Any:  # noqa: ANN401
    c0, *exponents = coefficients
    logs = [b * np.log(factors[str(x)]) for x, b in zip(coefficients.index[1:], exponents, strict=True)]
    with np.errstate(over="ignore"):  # in logarithms, since a single power may be too large for a number
        return single(np.asarray(np.exp(np.log(c0) + sum(logs))))


def _standard_errors(law: LawFit, eta: Array, values: Array, others: list[int], at: int) -> "pd.Series[float] | None":
    """Delta method: each parameter of ln T is a ratio -theta_j / k."""
    if law.cov_theta is None:
        return None
    k = law.theta[at]
    J = np.zeros((len(others), len(law.theta)))
    J[np.arange(len(others)), others] = -1.0 / k
    J[:, at] = -eta / k
    se = np.sqrt(np.einsum("ij,jk,ik->i", J, law.covariance(), J))
    se[0] *= values[0]
    return pd.Series(se, index=[law.names[j] for j in others])


LIFE_USUAL, LIFE_POSSIBLE = (0.5, 600.0), (0.02, 6000.0)  # min
VERY_FAR = 10.0  # times the longest test: too far to be used
WIDE, VERY_WIDE = 10.0, 100.0  # factor within which 95 % of lives lie


def life_verdict(life: ToolLife, law: LawFit, runs: Runs | None = None, of_law: Verdict | None = None) -> Verdict:
    """The verdict on a tool life: Taylor's n, extrapolation, plausible lives, its scatter, and the verdict on its law.

    Parameters
    ----------
    life : ToolLife
    law : LawFit
        The wear law that it was solved from.
    runs : Runs, optional
        Whose tool names the material; otherwise that of the law.
    of_law : Verdict, optional
        Of the wear law: a life is no better than its law.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> life_verdict(fit.tool_life(law, 0.3), law).words
    'usable with reservations'
    """
    found = [*_of_taylor(life, law, law.source.tool if runs is None else runs.tool), *_of_size(life)]
    refused = any(level > 1 for level, _ in found)
    if not refused:
        found += _of_range(life, law, runs)
    found += _of_scatter(law)
    if of_law is not None and of_law.level:
        found.append((of_law.level, f"Verdict on the law of {life.wear}: {of_law.words}."))
    reasons = {
        "Taylor's n": "the law has no V" if life.taylor_n is None else "",
        "Life against plausible lives": "",
        "Extrapolation": "the reasons above forbid the use already" if refused else "",
        "Predictive error of the life": "" if _is_factor(law) else "the law has no error as a factor",
    }
    missing = [f"{name}: {why}" for name, why in reasons.items() if why]
    return verdict_from(found, [name for name, why in reasons.items() if not why], missing)


def _is_factor(law: LawFit) -> bool:
    """Whether the error of a law is known and is a factor."""
    return law.error == "multiplicative" and law.scale_se is not None


def _of_taylor(life: ToolLife, law: LawFit, tool: str) -> Iterator[tuple[int, str]]:
    """Taylor's n by the interval of its reciprocal, the exponent of V in the life."""
    if life.taylor_n is None:
        return
    n = usual_taylor_n(tool)
    half = 0.0 if life.bse is None else law.t_quantile(0.95) * float(life.bse["V"])
    b = float(life.coefficients["V"])
    if b - half > 0:
        yield 2, f"Life rises with cutting speed (Taylor's n {life.taylor_n:.2g}), where it must fall."
    elif -b - half > 1 / n.limits[0] or -b + half < 1 / n.limits[1]:
        range_of = f"{n.usual[0]:g} to {n.usual[1]:g} of {n.material}"
        yield 1, f"Taylor's n {life.taylor_n:.2g} is unusual (usual {range_of}): check speed and time."


def _of_size(life: ToolLife) -> Iterator[tuple[int, str]]:
    """Life at the middle of the tests against lives in use."""
    usual = f"usual {LIFE_USUAL[0]:g} to {LIFE_USUAL[1]:g} min"
    at = f"{life.typical:.3g} {life.unit} at the middle of the tests"
    if life.unit != "min":
        return
    if not LIFE_POSSIBLE[0] <= life.typical <= LIFE_POSSIBLE[1]:
        yield 2, f"A life of {at} cannot be ({usual}): check the units of time and wear."
    elif not LIFE_USUAL[0] <= life.typical <= LIFE_USUAL[1]:
        yield 1, f"A life of {at} is unusual ({usual})."


def _of_range(life: ToolLife, law: LawFit, runs: Runs | None) -> Iterator[tuple[int, str]]:
    """Extrapolation in time and in wear."""
    ratio, first = life.typical / life.t_observed, law.domain["t"][0]
    head = f"The life of {life.typical:.3g} {life.unit} at the middle of the tests is"
    if ratio > EXTRAPOLATED:
        beyond = f"{ratio:.2g} times the longest test ({life.t_observed:.3g} {life.unit})"
        yield 1 + int(ratio > VERY_FAR), f"{head} {beyond}: extrapolated."
    elif life.typical < first:
        before = f"shorter than the first reading ({first:.3g} {life.unit})"
        yield 1 + int(life.typical < first / VERY_FAR), f"{head} {before}: extrapolated."
    above = 0 if runs is None else runs.marked(life.wear, ">")  # they are in no law
    if law.rows is not None and not above and life.criterion > (largest := float(law.observed.max())):
        wear = f"{life.criterion:g} {life.unit_of_wear} (largest wear {largest:.3g})"
        yield 1, f"No test reached the criterion {wear}: the life is extrapolated."


def _of_scatter(law: LawFit) -> Iterator[tuple[int, str]]:
    """Factor within which lives lie: the scatter of the wear over the exponent of time."""
    if law.error != "multiplicative" or law.scale_se is None:
        return
    k = float(law.params["t"])
    low, high = law.conf_int().loc[["t"]].to_numpy(dtype=float)[0].tolist()
    if low <= 0 < high:
        found = f"The 95 % interval of the time exponent, {low:.2g} to {high:.2g}, reaches zero"
        yield 2, f"{found}: the life has no upper limit. Read each edge at several times."
    factor = float(np.exp(min(1.96 * law.scale_se / k, 50.0)))
    if factor > WIDE:
        why = f"wear hardly grows with time (exponent {k:.2g}): run tests to the criterion."
        yield 1 + int(factor > VERY_WIDE), f"95 % of lives lie within a factor of {factor:.2g} of the law, since {why}"
