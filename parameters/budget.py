"""Uncertainty budget of a prediction: contributions of the coefficients, the edge, the row, the gauge and the settings.

A law is linear in its coefficients on the scale of its errors, ``eta = z theta``, and its variance is

    u^2 = z C z' + s_between^2 + s_within^2 + sum_i (d eta/d x_i)^2 u(x_i)^2 + u(gauge)^2.

The coefficients of a law in logarithms are nearly collinear with its constant, so that single contributions
``z_j^2 C_jj`` exceed their sum many times. They are therefore taken about the centre g of the tests at which constant
and exponents are uncorrelated, ``z_j - g_j`` with ``g = -C_bb^-1 C_b0``, and what correlations remain is a line of its
own, so that the lines add up to u^2.

Components estimated from the same deviations have one group of degrees of freedom: coefficients and scatter between
edges, or of independent rows. Source: JCGM 100:2008 (GUM), 5.1.2, 5.2.2, 6.2, G.4.1 and H.3 (a line about its centre).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from ..core.arrays import Array
from ..core.calls import check_share
from ..core.display import Displayable, TextTable
from ..core.errors import ParameterError
from ..core.rounding import format_plain as plain
from ..core.rounding import format_rounded
from .evaluation import error_gradient, point_values, region_contains, terms
from .messages import short
from .sections.base import Covariance, NoCovariance
from .sections.law_fields import LawFields

STEP = 1e-6  # of a setting, for its sensitivity: the error of a central difference is then about 1e-10
NEGLIGIBLE = 1e-12  # share of the variance below which a line is left out


@dataclass(frozen=True, slots=True, repr=False)
class BudgetLine(Displayable):
    """One contribution to the uncertainty of a prediction.

    Attributes
    ----------
    name : str
        Such as "exponent of V", "between edges" or "setting V".
    evaluation : {"A", "B"}
        From the scatter of the tests, or from other knowledge (GUM 3.3.5).
    u, unit : float or None, str
        Standard uncertainty of the quantity (None of the correlations) and its unit, ``ln`` on the logarithmic scale.
    sensitivity : float or None
        Change of the response by the quantity, in the unit of the response per ``unit``.
    contribution : float
        Standard deviation of the response from this source, in its unit; negative where correlations lower the sum.
    share : float
        Of the combined variance; the shares add up to 1.
    df : float
        Degrees of freedom; inf of an evaluation of type B.
    """

    name: str
    evaluation: Literal["A", "B"]
    u: float | None
    unit: str
    sensitivity: float | None
    contribution: float
    share: float
    df: float


@dataclass(frozen=True, slots=True, repr=False)
class UncertaintyBudget(Displayable):
    """Combined and expanded uncertainty of one prediction, and what contributes to it.

    Attributes
    ----------
    response, unit, of : str
        ``of``: "the law", or "one row of a new edge".
    at : mapping
        Value of each factor, in the unit of the law.
    value, u, U : float
        In ``unit``: of the law; combined standard uncertainty; expanded uncertainty ``k u``, first order where errors
        are multiplicative.
    low, high : float
        The expanded interval: ``value exp(-+ k u / value)`` where errors are multiplicative.
    k, df, level : float
        Coverage factor, effective degrees of freedom (Welch-Satterthwaite) and level of confidence.
    lines : tuple of BudgetLine
    multiplies, inside : bool
        Whether the errors of the law are multiplicative; whether the point lies in the tested region.
    notes : tuple of str
        What the budget does not contain.
    sensitivities : mapping
        Change of the response by each factor, in its unit per that of the factor.
    """

    response: str
    unit: str
    at: Mapping[str, float]
    of: str
    value: float
    u: float
    U: float
    low: float
    high: float
    k: float
    df: float
    level: float
    lines: tuple[BudgetLine, ...]
    multiplies: bool
    inside: bool
    notes: tuple[str, ...]
    sensitivities: Mapping[str, float]

    @property
    def words(self) -> str:
        """The result as GUM 7.2.3 asks for it, in one sentence."""
        value, expanded = format_rounded(self.value, self.U)
        standard = format_rounded(self.value, self.u)[1]
        unit, df = f" {self.unit}".rstrip(), "infinite" if math.isinf(self.df) else plain(self.df, 3)
        out = (
            f"{self.response} = ({value} ± {expanded}){unit} for {self.of}: U = k u with u = {standard}{unit} and "
            f"k = {self.k:.2f} (Student's t, {df} effective degrees of freedom), level {100 * self.level:.4g} %."
        )
        if self.multiplies:
            half = min(self.U, self.low)
            low, high = (format_rounded(end, half)[0] for end in (self.low, self.high))
            out += f" With multiplicative errors use the interval, which is asymmetric: {low} to {high}{unit}."
        return out

    def table(self) -> TextTable:
        """Source, type, standard uncertainty, sensitivity, contribution and share of the variance of each line."""
        unit = f" {self.unit}".rstrip()
        header = ("source", "type", "u", "sensitivity", f"contribution,{unit}".rstrip(","), "share", "df")
        return TextTable(header, tuple(_row(line) for line in self.lines))

    def facts(self) -> dict[str, Any]:
        """Plain numbers and texts for JSON."""
        out = {name: value for name, value in asdict(self).items() if name not in ("sensitivities", "multiplies")}
        lines = [{**line, "df": None if math.isinf(line["df"]) else line["df"]} for line in out["lines"]]
        return {**out, "df": None if math.isinf(self.df) else self.df, "lines": lines, "words": self.words}


def _row(line: BudgetLine) -> tuple[str, ...]:
    return (
        line.name,
        line.evaluation,
        "" if line.u is None else f"{plain(line.u, 3)} {line.unit}".rstrip(),
        "" if line.sensitivity is None else plain(line.sensitivity, 3),
        plain(line.contribution, 3),
        f"{100 * line.share:.1f} %",
        "∞" if math.isinf(line.df) else plain(line.df, 3),
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """A line before its share is known: variance on the scale of the errors, and its group of degrees of freedom."""

    name: str
    evaluation: Literal["A", "B"]
    u: float | None
    unit: str
    sensitivity: float | None
    variance: float
    group: str
    df: float


def uncertainty_budget(
    law: LawFields,
    at: Mapping[str, float],
    *,
    kind: Literal["mean", "prediction"] = "prediction",
    level: float = 0.95,
    by: str | None = None,
    u: Mapping[str, float] | None = None,
    gauge: float = 0.0,
    sources: Mapping[str, UncertaintyBudget] | None = None,
) -> UncertaintyBudget:
    """Uncertainty budget of a law at one point; parameters and errors as of ``LawSection.budget``.

    Examples
    --------
    >>> from fitmodels.parameters.sections.law import EXAMPLE, LawSection
    >>> found = uncertainty_budget(LawSection.model_validate(EXAMPLE), {"V": 100.0}, u={"V": 2.0})
    >>> [(line.name, round(line.share, 2)) for line in found.lines]
    [('constant at the centre', 0.45), ('exponent of V', 0.02), ('rows', 0.53), ('setting V', 0.01)]
    """
    taken, given = dict(sources or {}), dict(u or {})
    at = {**{name: source.value for name, source in taken.items()}, **at}
    _check(law, given, gauge, level, kind)
    value = float(point_values(law, by, at))
    G = error_gradient(law, terms(law, by, at), np.array(value))
    unit_scale = value if law.error == "multiplicative" else 1.0  # of the scale of the errors to that of the response
    through, total = _slopes(law, by, at, taken)
    parts = [
        *_of_coefficients(law, G / G[0], float(G[0]), float(G[0]) * unit_scale),
        *(_of_scatter(law, unit_scale) if kind == "prediction" else ()),
        *_of_sources(taken, through, unit_scale),
        *_of_settings(law, given, total, taken, unit_scale),
    ]
    if gauge > 0:
        parts.append(_Part("gauge", "B", gauge, law.unit, 1.0, (gauge / unit_scale) ** 2, "gauge", math.inf))
    inside = bool(region_contains(law, by, at)) and all(source.inside for source in taken.values())
    of = "the law" if kind == "mean" else _one_row(law)
    return _combined(law, parts, at, of, value, level, unit_scale, inside, total, tuple(_notes(kind, given, gauge)))


def _combined(
    law: LawFields, parts: Sequence[_Part], at: Mapping[str, float], of: str, value: float, level: float,
    unit_scale: float, inside: bool, total: Mapping[str, float], notes: tuple[str, ...],
) -> UncertaintyBudget:  # fmt: skip
    from scipy.special import stdtrit

    variance = sum(part.variance for part in parts)
    df = effective_df([*((part.variance, part.df, part.group) for part in parts), *_mean_squares(law, parts)])
    k = float(stdtrit(min(df, 1e9), (1 + level) / 2))
    root, multiplies = math.sqrt(variance), law.error == "multiplicative"
    lines = tuple(
        BudgetLine(
            part.name, part.evaluation, part.u, part.unit,
            part.sensitivity,
            math.copysign(math.sqrt(abs(part.variance)) * unit_scale, part.variance),
            part.variance / variance if variance > 0 else 0.0, part.df,
        )
        for part in parts
        if abs(part.variance) > NEGLIGIBLE * variance or part.evaluation == "B"
    )  # fmt: skip
    low, high = (value * math.exp(side * k * root) if multiplies else value + side * k * root for side in (-1, 1))
    u = root * unit_scale
    return UncertaintyBudget(
        law.response, law.unit, dict(at), of, value, u, k * u, low, high, k, df, level, lines, multiplies, inside,
        notes, dict(total),
    )  # fmt: skip


def effective_df(parts: Sequence[tuple[float, float, str]]) -> float:
    """Effective degrees of freedom of (variance, df, group)s: Welch-Satterthwaite, GUM G.4.1.

    Variances of one group are estimated from the same deviations: they are added first, with the smallest df of them.

    Examples
    --------
    >>> round(effective_df([(0.0130490**2, 76, "fit"), (0.0100085**2, math.inf, "settings")]), 2)  # GTC 1.5.1
    191.72
    """
    total, below = sum(variance for variance, _, _ in parts), 0.0
    for group in {group: None for _, _, group in parts}:
        members = [(variance, df) for variance, df, of in parts if of == group and variance]
        df = min((df for _, df in members), default=math.inf)
        below += sum(variance for variance, _ in members) ** 2 / df
    return total**2 / below if below > 0 else math.inf


def _check(law: LawFields, given: Mapping[str, float], gauge: float, level: float, kind: str) -> None:
    if kind not in ("mean", "prediction"):
        raise ParameterError(f"kind = {short(kind)}: a budget is of the mean or of a prediction.")
    check_share("level", level, ParameterError)
    _covariance(law)
    if kind == "prediction":
        _check_scatter(law)
    for name, value in {**given, "the gauge": gauge}.items():
        if not (math.isfinite(value) and value >= 0):
            raise ParameterError(f"standard uncertainty of {name}: {value:g}; it is zero or more.")


def _check_scatter(law: LawFields) -> None:
    if law.residual_se is None and not law.deviations:
        raise ParameterError(f"the law of {law.response} has no scatter of rows: ask for the budget of the mean.")
    if law.life is not None and law.life.distribution == "weibull":
        raise ParameterError(
            f"the lives of {law.response} have a Weibull distribution: the interval of one life is not k u; ask for "
            "the budget of the mean."
        )


def _covariance(law: LawFields) -> Covariance:
    if isinstance(law.uncertainty, NoCovariance):
        raise ParameterError(f"the law of {law.response} has no budget: {law.uncertainty.reason.rstrip('.')}.")
    return law.uncertainty


def _one_row(law: LawFields) -> str:
    row = "row" if law.life is None else "life"
    return f"one {row} of a new edge" if law.deviations else f"one {row}"


def _of_coefficients(law: LawFields, Z: Array, scale: float, response: float) -> list[_Part]:
    """Constant at the centre, each coefficient about it, and the correlations that remain."""
    held, names = _covariance(law), law.parameter_names
    order = [held.of.index(name) for name in names]
    C = np.array(held.matrix, dtype=float)[np.ix_(order, order)]
    se = np.sqrt(np.maximum(np.diag(C)[1:], 0.0))
    by_se = np.divide(1.0, se, out=np.zeros_like(se), where=se > 0)  # a fixed coefficient has none
    centre = -by_se * (np.linalg.pinv(C[1:, 1:] * np.outer(by_se, by_se), hermitian=True) @ (by_se * C[1:, 0]))
    constant = max(float(C[0, 0] + 2 * C[0, 1:] @ centre + centre @ C[1:, 1:] @ centre), 0.0)
    away = Z[1:] - centre
    group, square = "edges" if law.deviations else "rows", scale * scale
    head, unit = "constant at the centre", "ln" if law.logarithmic else law.unit
    parts = [_Part(head, "A", math.sqrt(constant), unit, response, constant * square, group, held.df)]
    known = {f.symbol for f in law.factors} if law.log_factors and not law.terms else set()
    for name, a, s in zip(names[1:], away, se, strict=True):
        label = f"exponent of {name}" if name in known else f"coefficient of {name}"
        variance = float((a * s) ** 2) * square
        parts.append(_Part(label, "A", float(s), "", float(a) * response, variance, group, held.df))
    rest = float(Z @ C @ Z) * square - sum(part.variance for part in parts)
    if len(parts) > 2 and abs(rest) > NEGLIGIBLE * float(Z @ C @ Z) * square:
        parts.append(_Part("correlations of the coefficients", "A", None, "", None, rest, group, held.df))
    return parts


def _of_scatter(law: LawFields, unit_scale: float) -> list[_Part]:
    """Scatter between and within edges, or of independent rows."""
    e, unit, df = law.edges, "ln" if law.error == "multiplicative" else law.unit, float(_covariance(law).df)
    if e is None or law.deviations is None:
        s = law.residual_se or 0.0
        name = "rows" if law.life is None else "lives"
        return [_Part(name, "A", s, unit, unit_scale, s * s, "rows", df)]
    between, within = law.deviations
    return [
        _Part("between edges", "A", between, unit, unit_scale, between**2, "edges", float(e.df_between or df)),
        _Part("rows of one edge", "A", within, unit, unit_scale, within**2, "within", float(e.df_within or law.df)),
    ]


def _mean_squares(law: LawFields, parts: Sequence[_Part]) -> list[tuple[float, float, str]]:
    """Part of the scatter within edges that belongs to the mean square between edges, ``s_within^2 / m``.

    ``s_between^2`` is a difference of mean squares and has fewer degrees of freedom than either; ``s_between^2 +
    s_within^2 / m`` is the mean square between edges over m, the rows of an edge.
    """
    e = law.edges
    within = next((part for part in parts if part.group == "within"), None)
    if e is None or within is None or not e.rows_per_edge or not e.df_between:
        return []
    moved = within.variance / e.rows_per_edge
    return [(moved, float(e.df_between), "edges"), (-moved, within.df, "within")]


def _of_sources(taken: Mapping[str, UncertaintyBudget], through: Mapping[str, float], unit_scale: float) -> list[_Part]:
    """Factors from their own laws, without the part of the settings, which enters once with all of its effects."""
    parts = []
    for name, source in taken.items():
        own = [line for line in source.lines if not line.name.startswith("setting ")]
        variance = sum(math.copysign(line.contribution**2, line.contribution) for line in own)
        contribution = variance * (through[name] / unit_scale) ** 2
        label, slope = f"{name} from its own law", through[name]
        parts.append(
            _Part(label, "A", math.sqrt(max(variance, 0.0)), source.unit, slope, contribution, name, source.df)
        )
    return parts


def _of_settings(
    law: LawFields, given: Mapping[str, float], total: Mapping[str, float], taken: Mapping[str, UncertaintyBudget],
    unit_scale: float,
) -> list[_Part]:  # fmt: skip
    """Settings of the machine, each with its whole effect: direct, and through factors of other laws."""
    units = {f.symbol: f.unit for f in law.factors}
    parts = []
    for name, u in given.items():
        if name in taken:
            raise ParameterError(f"{name} is taken from its own law: its uncertainty follows; do not give another.")
        if name not in total:
            raise ParameterError(f"the law of {law.response} has no setting {short(name)}; it has {', '.join(total)}.")
        variance = (total[name] * u / unit_scale) ** 2
        parts.append(_Part(f"setting {name}", "B", u, units.get(name, ""), total[name], variance, name, math.inf))
    return parts


def _slopes(
    law: LawFields, by: str | None, at: Mapping[str, float], taken: Mapping[str, UncertaintyBudget]
) -> tuple[dict[str, float], dict[str, float]]:
    """Change of the response by each factor of another law; by each setting, through those factors too."""
    each: dict[str, float] = {}
    for name in (f.symbol for f in law.factors):
        step = STEP * (abs(float(at[name])) or 1.0)
        up, down = (float(point_values(law, by, {**at, name: at[name] + side * step})) for side in (1, -1))
        each[name] = (up - down) / (2 * step)
    through = {name: each.pop(name) for name in taken}
    for name, source in taken.items():
        for setting, slope in source.sensitivities.items():
            each[setting] = each.get(setting, 0.0) + through[name] * slope
    return through, each


def _notes(kind: str, given: Mapping[str, float], gauge: float) -> list[str]:
    exact = "The settings are taken as exact; give their standard uncertainties to include them."
    out = [] if given else [exact]
    if not gauge:
        out.append("The calibration of the gauge is not included; its repeatability is part of the scatter of rows.")
    scatter = ["The scatter of edges and rows is not included: it is of the law itself."] if kind == "mean" else []
    return [*out, *scatter, "The form of the law is taken as true."]
