"""Statements of uncertainty: value, expanded uncertainty U = k u, coverage factor and level of confidence.

Source: JCGM 100:2008 (GUM), 5.1.2 (first order), 6.2 and 6.3.3 (U = k u, k of t), 7.2.3 and 7.2.4 (reporting),
7.2.6 (two digits of u), G.3 (k from Student's t).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...core.errors import ParameterError
from ...core.intervals import Kind, t_quantile
from ...core.predictions import EXTRAPOLATED, Prediction
from ...core.rounding import format_rounded
from ...core.verdict import DO_NOT_USE
from ...parameters import LawSection, ParameterFile
from ...parameters.evaluation import IntervalOptions
from ...parameters.prediction import predict_life
from ...parameters.sections.law_parts import ToolLifeSection
from .design import at_words, middle, reference
from .laws import degrees
from .numbers import INFINITE, LEVEL, count, figure, percent, places
from .parts import NumberPart, Part
from .profiler import ON_NEW_EDGE, ROW
from .tool_life import settings

UNBOUNDED = 20.0  # half width of ln T above which the interval of a tool life says nothing: a factor of 5e8
OF = {
    "mean": "the fitted law",
    "new": ON_NEW_EDGE,
    "independent rows": ROW,
    "life": "the fitted law",
    "edge": "one new edge",
}


class BudgetLinePart(Part):
    """A contribution to the uncertainty of a prediction."""

    name: str  # ``exponent of V``, ``between edges``, ``rows of one edge`` ...
    evaluation: str  # type A or B of the GUM
    standard: NumberPart  # standard uncertainty of the source; empty of correlations
    sensitivity: NumberPart  # change of the response by the source
    contribution: NumberPart  # in the unit of the response; negative where correlations lower the sum
    share: NumberPart  # of the combined variance, per cent
    df: NumberPart


class UncertaintyPart(Part):
    """One statement according to the GUM: value, u, expanded uncertainty U = k u, coverage factor and level.

    ``low`` and ``high`` are the same interval where it is asymmetric (multiplicative errors).
    """

    quantity: str
    symbol: str
    at: str  # where: ``V 100 m/min, f 0.19 mm/rev, t 10 min``
    of: str  # the fitted law, or one new observation on a new edge
    value: NumberPart
    standard: NumberPart  # u, and U of it: first order for multiplicative errors
    expanded: NumberPart
    k: NumberPart
    df: NumberPart  # of the t that k is a quantile of
    level: NumberPart
    low: NumberPart
    high: NumberPart
    words: str  # the whole statement
    budget: tuple[BudgetLinePart, ...] = ()  # of one new observation; the shares add up to 100 %
    budget_words: str = ""  # effective degrees of freedom and k, and what the budget does not contain


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
        kinds = [law.predict(at, kind, level=LEVEL, by=by) for kind in ("mean", "prediction")]
    except ParameterError:
        return ()
    df, remarks = degrees(law), _remarks(law, kinds[0])
    out = []
    for p in kinds:
        found = _from_ends(float(p.value), float(p.low), float(p.high), df, multiplies=law.error == "multiplicative")
        of = OF["mean"] if p.kind == "mean" else OF.get(p.edge, p.edge)
        statement = _statement(law.quantity, law.response, law.unit, where, of, found, remarks)
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
    at = settings(life)  # as in the text on tool life
    where = at_words(law, at, digits=3)
    beyond = "" if life.typical <= EXTRAPOLATED * life.t_observed else (
        f" No test lasted longer than {life.t_observed:.3g} {life.unit}: this is an extrapolation, and the interval "
        "does not include its error."
    )  # fmt: skip
    name = f"tool life to {life.wear} {life.criterion:g} {life.unit_of_wear}"
    out = []
    kinds: tuple[Kind, ...] = ("mean", "prediction")
    for kind in kinds:
        try:
            p = predict_life(law, life, IntervalOptions(kind, LEVEL), at)
        except ParameterError:
            return ()
        of = OF["life"] if kind == "mean" else OF["independent rows" if law.n_edges is None else "edge"]
        if p.low > 0 and math.log(p.high / p.low) < 2 * UNBOUNDED:
            found = _from_ends(float(p.value), float(p.low), float(p.high), degrees(law), multiplies=True)
            out.append(_statement(name, "T", life.unit, where, of, found, beyond))
    return tuple(out)


def _from_ends(value: float, low: float, high: float, df: int, *, multiplies: bool) -> _Found:
    k = t_quantile(df)
    half = value * math.log(high / low) / 2 if multiplies else (high - low) / 2
    return _Found(value, half / k, k, df, low, high, multiplies)


def _remarks(law: LawSection, predicted: Prediction) -> str:
    """That the middle of the ranges was not tested, and that the law is not to be used."""
    outside = "" if predicted.inside else " The middle of the ranges lies outside the tested region."
    if law.verdict is None or law.verdict.concern != DO_NOT_USE:
        return outside
    return f"{outside} The verdict on the law is: {law.verdict.level}."


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
