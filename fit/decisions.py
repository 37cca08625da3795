"""Decisions that a law is fitted for: tool life, the speed of least cost, the value of a factor at a limit.

A decision is a number computed from the parameters of a law. With g the gradient of its logarithm by theta its
variance is ``g C g'``; for one new edge the scatter between edges is added. `optimal_tests.narrowing` states how much
further tests are expected to narrow it.

Sources: Chaloner & Larntz 1989, J. Stat. Planning and Inference 21, 191 (designs for a function of the parameters);
Taylor 1907, Trans. ASME 28, 31 (economic tool life).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import exp, inf, log

import numpy as np

from ..core.arrays import Array
from ..core.display import Displayable
from ..core.errors import FitError, UsageError
from ..core.predictions import EXTRAPOLATED
from ..core.rounding import middle_of
from .edges import EdgeInference
from .lawfit import LawFit
from .prediction import edge_sd, no_edge_interval
from .wear_curves import doubt

STEP = 1e-6  # of a parameter in units of its standard error, for the gradient of a decision
FAR = 2.0  # times the tested range: further away no law is to be extrapolated
COSTS = ("Cm", "Ct", "tc")


@dataclass(frozen=True, slots=True, repr=False)
class Decision(Displayable):
    """A number that is decided by a law.

    Attributes
    ----------
    name, unit : str
        Such as "tool life at V 100 m/min, f 0.2 mm/rev" and "min".
    value : float
        In ``unit``, above zero.
    gradient : ndarray, shape (p,)
        Of ln value, by the parameters ``theta`` of the law.
    edge_sd : float
        Standard deviation of ln value from one new edge, given the law; infinite where it is not known.
    at : mapping
        Conditions of the decision.
    beyond : str
        What it extrapolates, in words; empty where nothing.
    no_edge : str
        Reason why there is no interval of one new edge; empty where there is one.
    """

    name: str
    unit: str
    value: float
    gradient: Array
    edge_sd: float
    at: Mapping[str, float]
    beyond: str = ""
    no_edge: str = ""


def life_decision(law: LawFit, criterion: float = 0.3, at: Mapping[str, float] | None = None) -> Decision:
    """Tool life at conditions: of a law of lives, or the time at which a wear law reaches a criterion.

    Parameters
    ----------
    law : LawFit
        A power law of wear with t, or a law of T.
    criterion : float
        Wear at the end of life, in the unit of the wear.
    at : mapping of float, optional
        Conditions; the geometric middle of each factor's range, to three digits, unless given.

    Raises
    ------
    FitError
        The law has no tool life.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> found = life_decision(law)
    >>> round(found.value, 1), found.unit
    (99.1, 'min')
    """
    where = _conditions(law, at, without=("t",))
    if law.response == "T":
        _power_without_levels(law)
        z = law.formula.design(np.array([[where[name] for name in law.factors]]))[0]
        name, value = _named("tool life", law, where), _exp(float(z @ law.theta), "the tool life")
        beyond, sd = " ".join(_outside(law, where)), _edge_scatter(law)
        return Decision(name, law.units["T"], value, z, sd, where, beyond, no_edge_interval(law))
    k = _life_exponent(law)
    value = _exp(_log_life(law.theta, law, criterion, where), f"the tool life to {law.response} {criterion:g}")
    gradient = _gradient(lambda theta: _log_life(theta, law, criterion, where), law)
    beyond = " ".join([*_of_range(value, law), *_outside(law, where)])
    sd, no_edge = _edge_scatter(law, value=criterion) / k, no_edge_interval(law)
    if not no_edge:
        no_edge = doubt(law, criterion, log(value), float(gradient @ law.covariance() @ gradient) + sd * sd)
        sd = inf if no_edge else sd
    name = _named(f"tool life to {law.response} {criterion:g} {law.units[law.response]}", law, where)
    return Decision(name, law.units["t"], value, gradient, sd, where, beyond, no_edge)


def cost_decision(
    law: LawFit, costs: Mapping[str, float], criterion: float = 0.3, at: Mapping[str, float] | None = None
) -> Decision:
    """Cutting speed of least cost at the other conditions.

    With ``T = K V^-p`` the cost of a minute of cutting over the speed is least at ``T = (p - 1)(tc + Ct / Cm)``.

    Parameters
    ----------
    law, criterion, at
        As for :func:`life_decision`; the law has V.
    costs : mapping
        Cm cost of the machine per minute, Ct cost of an edge, tc minutes to change it.

    Raises
    ------
    FitError
        The law has no tool life or no V, or life hardly falls with speed (p <= 1): there is no least cost within.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> cost_decision(law, {"Cm": 0.5, "Ct": 3.0, "tc": 2.0}).name
    'speed of least cost at f 0.19 mm/rev, d 2.12 mm'
    """
    lacking = [name for name in COSTS if name not in costs]
    if lacking or set(costs) - set(COSTS) or not all(np.isfinite(c) and c >= 0 for c in costs.values()):
        raise UsageError(f"costs {dict(costs)}: give Cm per minute, Ct per edge and tc minutes of a change, 0 or more.")
    if "V" not in law.factors or costs["Cm"] <= 0:
        raise FitError(f"the speed of least cost needs a law with V and Cm above zero; {law.response} has no V.")
    where = _conditions(law, at, without=("t", "V"))
    wear = law.response != "T"
    k = _life_exponent(law) if wear else 1.0
    j = 1 + law.factors.index("V")
    _power_without_levels(law)

    def log_speed(theta: Array) -> float:
        at_one = {**where, "V": 1.0}
        p = theta[j] / theta[1 + law.factors.index("t")] if wear else -theta[j]
        if p <= 1:
            return inf
        life = (p - 1) * (costs["tc"] + costs["Ct"] / costs["Cm"])
        known = _log_life(theta, law, criterion, at_one) if wear else _log_response(theta, law, at_one)
        return float((known - log(life)) / p)

    best = log_speed(law.theta)
    if not np.isfinite(best):
        raise FitError(
            f"{law.response}: life falls with V to the power {law.theta[j] / k:.2g}; at 1 or less cost is least at the "
            "highest speed that the machine allows."
        )
    value = _exp(best, "the speed of least cost")
    beyond = " ".join(_outside(law, {**where, "V": value}))
    slope = abs(float(law.theta[j])) / k if wear else abs(float(law.theta[j]))
    sd = _edge_scatter(law, value=criterion) / k / slope
    name, gradient = _named("speed of least cost", law, where), _gradient(log_speed, law)
    return Decision(name, law.units["V"], value, gradient, sd, where, beyond, no_edge_interval(law))


def limit_decision(law: LawFit, limit: float, factor: str, at: Mapping[str, float] | None = None) -> Decision:
    """Value of a factor at which a law reaches a limit, at the other conditions.

    Raises
    ------
    FitError
        The law has no single such value, as of second order, or the factor has no effect.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d"])
    >>> limit_decision(law, 3.0, "f").name
    'f at which P reaches 3 kW, at V 100 m/min, d 2.12 mm'
    """
    if not (law.formula.first_order and law.formula.linearisable):
        raise FitError(
            f"{law.response}: a limit of a law of the form {law.form} has no closed form in {factor}; fit a power "
            "law, or use fitmodels limits."
        )
    if factor not in law.factors or law.by is not None:
        why = f"it has no {factor}" if factor not in law.factors else f"it has levels of {law.by and law.by.column}"
        raise FitError(f"the law of {law.response} has no limit of {factor}: {why}.")
    if law.formula.logarithmic and limit <= 0:
        raise UsageError(f"limit {limit:g} of {law.response}: it is above zero.")
    where, j = _conditions(law, at, without=(factor,)), 1 + law.factors.index(factor)
    logged = law.formula.logs[j - 1]
    target = log(limit) if law.formula.logarithmic else limit
    origin = {**where, factor: 1.0 if logged else 0.0}

    def log_value(theta: Array) -> float:
        x = (target - _log_response(theta, law, origin)) / theta[j]
        return float(x) if logged else log(x) if x > 0 else inf

    found = log_value(law.theta)
    if not np.isfinite(found) or abs(found) > 50:
        raise FitError(
            f"{law.response} reaches {limit:g} {law.units[law.response]} at no value of {factor} above zero."
        )
    value = exp(found)
    per = abs(float(law.theta[j])) * (1.0 if logged else value)
    name = f"{factor} at which {law.response} reaches {limit:g} {law.units[law.response]}"
    beyond = " ".join(_outside(law, {**where, factor: value}))
    sd = _edge_scatter(law, value=limit) / per
    name, gradient = _named(f"{name},", law, where), _gradient(log_value, law)
    return Decision(name, law.units[factor], value, gradient, sd, where, beyond, no_edge_interval(law))


def variances_of(law: LawFit) -> tuple[float, float]:
    """Variance between edges, and of rows within an edge (or of independent rows)."""
    if isinstance(law.edges, EdgeInference):
        return law.edges.mixed.sd_between**2, max(law.edges.mixed.sd_within**2, 1e-300)
    if not law.scale_se:
        raise FitError(f"{law.response}: the law meets every row exactly: there is no scatter to plan for.")
    return 0.0, law.scale_se**2


def _edge_scatter(law: LawFit, *, value: float | None = None) -> float:
    """Standard deviation of a new edge in ln of the response, infinite where it is not known."""
    variances_of(law)  # refuses a law without scatter
    sd = edge_sd(law)
    return sd if law.error == "multiplicative" or not law.formula.logarithmic or value is None else sd / value


def _gradient(of: Callable[[Array], float], law: LawFit) -> Array:
    """Gradient by theta, by central differences of steps in units of the standard errors."""
    steps = STEP * np.sqrt(np.maximum(np.diag(law.covariance()), 1e-300))
    shifts = np.diag(steps)
    return np.array([
        (of(law.theta + d) - of(law.theta - d)) / (2 * step) for d, step in zip(shifts, steps, strict=True)
    ])  # fmt: skip


def _log_response(theta: Array, law: LawFit, at: Mapping[str, float]) -> float:
    return float(law.formula.columns(np.array([[at[name] for name in law.factors]]))[0] @ theta)


def _log_life(theta: Array, law: LawFit, criterion: float, at: Mapping[str, float]) -> float:
    """Logarithm of the life by a wear law: of the time at which it reaches the criterion."""
    k = theta[1 + law.factors.index("t")]
    return float((log(criterion) - _log_response(theta, law, {**at, "t": 1.0})) / k)


def _life_exponent(law: LawFit) -> float:
    """Exponent of time of a wear law that has a tool life."""
    _power_without_levels(law)
    if "t" not in law.factors:
        raise FitError(f"{law.response} is fitted without t: it has no tool life.")
    k = float(law.params["t"])
    if k <= 0:
        raise FitError(f"{law.response} falls with time (t exponent {k:.3g}): it has no tool life.")
    return k


def _of_range(value: float, law: LawFit) -> list[str]:
    """Sentences on a life beyond the times of the tests; whether its exponent of time can be zero."""
    (first, longest), unit = law.domain["t"], law.units["t"]
    out = []
    if value > EXTRAPOLATED * longest:
        out.append(
            f"This life is {value / longest:.2g} times the longest test ({longest:.3g} {unit}): the intervals hold if "
            "the law holds until then, which only longer tests can show."
        )
    elif value < first:
        out.append(f"This life ends before the first reading ({first:.3g} {unit}): read wear earlier.")
    if law.conf_int().loc[["t"]].to_numpy(dtype=float)[0, 0] <= 0:
        out.append("The interval of the exponent of time reaches zero: the life has no upper end.")
    return out


def _outside(law: LawFit, at: Mapping[str, float]) -> list[str]:
    """Conditions outside the range of the tests."""
    out = []
    for name, (low, high) in law.domain.items():
        if name in at and not low * (1 - 1e-9) <= at[name] <= high * (1 + 1e-9):
            tested = f"{low:g} to {high:g} {law.units.get(name, '')}".rstrip()
            near = low / FAR <= at[name] <= high * FAR
            remedy = "test there first" if near else "the law does not hold so far from the tests; check the decision"
            out.append(f"{name} {at[name]:.3g} lies outside the tested range ({tested}): {remedy}.")
    return out


def _power_without_levels(law: LawFit) -> None:
    if law.form != "power" or law.by is not None:
        kind = f"levels of {law.by.column}" if law.by is not None else f"the form {law.form}"
        raise FitError(f"tool life needs a power law without levels; the law of {law.response} has {kind}.")


def _conditions(law: LawFit, at: Mapping[str, float] | None, without: tuple[str, ...]) -> dict[str, float]:
    """Values of the factors: as given, or the middle of their ranges to three digits."""
    out = {}
    for name, log_scale in zip(law.factors, law.formula.logs, strict=True):
        low, high = law.domain[name]
        out[name] = middle_of(low, high, logs=log_scale)
    for name, value in (at or {}).items():
        if name not in out or name in without:
            others = ", ".join(other for other in out if other not in without)
            raise UsageError(f"{name} is no condition of this decision on {law.response}; its conditions are {others}.")
        if not (np.isfinite(value) and value > 0):
            raise UsageError(f"{name} {value:g}: a condition is above zero.")
        out[name] = float(value)
    return {name: value for name, value in out.items() if name not in without}


def _named(what: str, law: LawFit, at: Mapping[str, float]) -> str:
    where = ", ".join(f"{name} {value:.3g} {law.units.get(name, '')}".rstrip() for name, value in at.items())
    return f"{what} at {where}" if where else what.rstrip(",")


def _exp(logarithm: float, name: str) -> float:
    """Exponential of a logarithm; FitError where it is larger than the largest float."""
    try:
        return exp(logarithm)
    except OverflowError:
        raise FitError(f"{name} is e^{logarithm:.4g}, too large a number: check the criterion and the law.") from None
