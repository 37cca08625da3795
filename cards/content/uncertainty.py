"""Statements of uncertainty: value, expanded uncertainty U = k u, coverage factor and level of confidence.

Source: JCGM 100:2008 (GUM), 5.1.2 (first order), 6.2 and 6.3.3 (U = k u, k of t), 7.2.3 and 7.2.4 (reporting),
7.2.6 (two digits of u), G.3 (k from Student's t).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...core.errors import ParameterError
from ...core.intervals import Kind
from ...core.rounding import format_rounded
from ...core.verdict import DO_NOT_USE
from ...parameters import LawSection, ParameterFile
from ...parameters.evaluation import IntervalOptions
from ...parameters.prediction import predict_life
from ...parameters.sections.law_parts import ToolLifeSection
from .design import at_words, middle, reference
from .laws import degrees
from .numbers import INFINITE, LEVEL, count, figure, percent, places, t_quantile
from .parts import BudgetLinePart, NumberPart, UncertaintyPart
from .profiler import ON_NEW_EDGE, ROW

UNBOUNDED = 20.0  # half width of ln T above which the interval of a tool life says nothing: a factor of 5e8
OF = {
    "mean": "the fitted law",
    "new": ON_NEW_EDGE,
    "independent rows": ROW,
    "life": "the fitted law",
    "edge": "one new edge",
}


@dataclass(frozen=True, slots=True)
class _Found:
    """An estimate with its interval: ``u`` in its unit, first order where ``multiplies``."""

    value: float
    u: float
    k: float
    df: int
    low: float
    high: float
    multiplies: bool


def statements(pf: ParameterFile) -> tuple[UncertaintyPart, ...]:
    """Two statements for each law and two for the tool life; none without a covariance."""
    found = [item for law in pf.laws.values() for item in of_law(law)]
    return (*found, *(of_life(pf.tool_life, pf.laws.get(pf.tool_life.wear)) if pf.tool_life else ()))


def of_law(law: LawSection) -> tuple[UncertaintyPart, ...]:
    """The law, and one new observation, at the middle of the tests."""
    at: dict[str, Any] = dict(middle(law))
    by = reference(law)
    where = at_words(law, at, by)
    try:
        kinds = [law.get_prediction("mean", LEVEL, by, **at), law.get_prediction("prediction", LEVEL, by, **at)]
    except ParameterError:
        return ()
    df, outside = degrees(law), "" if kinds[0].inside else " The middle of the ranges lies outside the tested region."
    if law.verdict is not None and law.verdict.concern == DO_NOT_USE:
        outside += f" The verdict on the law is: {law.verdict.level}."
    out = []
    for p in kinds:
        found = _from_ends(float(p.value), float(p.low), float(p.high), df, multiplies=law.error == "multiplicative")
        of = OF["mean"] if p.kind == "mean" else OF.get(p.edge, p.edge)
        statement = _statement(law.quantity, law.response, law.unit, where, of, found, outside)
        out.append(_with_budget(statement, law, at, by) if p.kind == "prediction" else statement)
    return tuple(out)


def _with_budget(
    statement: UncertaintyPart, law: LawSection, at: Mapping[str, float], by: str | None
) -> UncertaintyPart:
    """The statement of one new observation with its contributions; as it is where the law has no budget."""
    try:
        found = law.budget(at, "prediction", LEVEL, by)
    except ParameterError:
        return statement
    lines = tuple(
        BudgetLinePart(
            name=line.name,
            evaluation=line.evaluation,
            standard=figure(line.u, 3, line.unit),
            sensitivity=figure(line.sensitivity, 3),
            contribution=figure(line.contribution, 3, law.unit),
            share=places(100 * line.share, 1, "%"),
            df=INFINITE if math.isinf(line.df) else figure(line.df, 3),
        )
        for line in found.lines
    )
    words = (
        f"The budget of {law.response} has {found.df:.3g} effective degrees of freedom (Welch-Satterthwaite), which "
        f"give k = {found.k:.2f}; the statement above takes {statement.df.text}."
    )
    return statement.model_copy(update={"budget": lines, "budget_words": " ".join([words, *found.notes])})


def of_life(life: ToolLifeSection, law: LawSection | None) -> tuple[UncertaintyPart, ...]:
    """Tool life at the middle of the tests: ln T = (ln W - z'theta) / h, with Fieller's interval.

    For a new edge, whose level deviates by b from the law, ln T deviates by a further b / h. There is no statement
    where the interval is not bounded.
    """
    if law is None or not life.typical > 0:
        return ()
    where = at_words(law, life.typical_at, digits=3)  # as in the text on tool life
    beyond = "" if life.typical <= life.t_observed else (
        f" No test lasted longer than {life.t_observed:.3g} {life.unit}: this is an extrapolation, and the interval "
        "does not include its error."
    )  # fmt: skip
    name = f"tool life to {life.wear} {life.criterion:g} {life.unit_of_wear}"
    out = []
    kinds: tuple[Kind, ...] = ("mean", "prediction")
    for kind in kinds:
        try:
            p = predict_life(law, life, IntervalOptions(kind, LEVEL), life.typical_at)
        except ParameterError:
            return ()
        known = law.edges is not None and law.edges.sd_between is not None
        of = OF["life"] if kind == "mean" else OF["edge" if known else "independent rows"]
        if p.low > 0 and math.log(p.high / p.low) < 2 * UNBOUNDED:
            found = _from_ends(float(p.value), float(p.low), float(p.high), degrees(law), multiplies=True)
            out.append(_statement(name, "T", life.unit, where, of, found, beyond))
    return tuple(out)


def _from_ends(value: float, low: float, high: float, df: int, *, multiplies: bool) -> _Found:
    k = t_quantile(df)
    half = value * math.log(high / low) / 2 if multiplies else (high - low) / 2
    return _Found(value, half / k, k, df, low, high, multiplies)


def _statement(quantity: str, symbol: str, unit: str, where: str, of: str, f: _Found, more: str) -> UncertaintyPart:
    U = f.k * f.u
    value, expanded = format_rounded(f.value, U)
    standard = format_rounded(f.value, f.u)[1]
    half = min(U, f.low) if f.low > 0 else U
    low, high = (format_rounded(end, half)[0] for end in (f.low, f.high))
    k, level, in_unit = f"{f.k:.2f}", percent(LEVEL), f" {unit}".rstrip()
    at = f" at {where}" if where else ""
    words = (
        f"{symbol} = ({value} ± {expanded}){in_unit}{at}, for {of}: U = k u with u = {standard}{in_unit} and k = {k} "
        f"(Student's t, {f.df} degrees of freedom), level {level.text} %."
    )
    if f.multiplies:
        words += f" With multiplicative errors use the interval, which is asymmetric: {low} to {high}{in_unit}."
    return UncertaintyPart(
        quantity=quantity,
        symbol=symbol,
        at=where,
        of=of,
        value=NumberPart(value=f.value, text=value, unit=unit),
        standard=NumberPart(value=f.u, text=standard, unit=unit),
        expanded=NumberPart(value=U, text=expanded, unit=unit),
        k=NumberPart(value=f.k, text=k),
        df=count(f.df),
        level=level,
        low=NumberPart(value=f.low, text=low, unit=unit),
        high=NumberPart(value=f.high, text=high, unit=unit),
        words=words + more,
    )
