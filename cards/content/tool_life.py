"""Tool life as text: at a criterion, from the wear curves, Taylor's constants, and the plan of an edge's life."""

import math
from collections.abc import Mapping

from ...core.errors import ParameterError
from ...core.intervals import Kind
from ...core.predictions import EXTRAPOLATED, Prediction, beyond_scatter
from ...core.rounding import format_plain
from ...datasets.vocabulary import FLANK_WEAR
from ...parameters import LawSection, ParameterFile
from ...parameters.evaluation import IntervalOptions
from ...parameters.prediction import no_edge_interval, predict_life
from ...parameters.sections.law_parts import LifeSection, TaylorSection, ToolLifeSection
from .design import at_words
from .numbers import LEVEL, NONE, UNBOUNDED, count, figure, number, percent, sentence
from .parts import NumberPart, Part, ToolLifePart
from .verdicts import TOOL_LIFE, verdict_part, with_remedies
from .worked import predict_command

PLANNED = 60  # rows of a plan in the card
DISTRIBUTIONS = {"lognormal": "lognormal", "weibull": "Weibull"}
Ends = tuple[float | None, float | None]


def tool_life_part(pf: ParameterFile) -> ToolLifePart | None:
    """Tool life at the criterion: equation, definition of T, T at the middle of the tests, Taylor's n, wear curves."""
    life = pf.tool_life
    if life is None:
        return None
    law = pf.laws.get(life.wear)
    where = settings(life)
    found = _predictions(life, law, where)
    c0, *exponents = life.coefficients.items()
    definition = (
        f"T is the time, in {life.unit}, at which {life.wear} reaches {life.criterion:g} {life.unit_of_wear}, solved "
        "from the wear law."
    )
    at = ", ".join(f"{name} {value:.3g}" for name, value in where.items())
    place = f"At the middle of the ranges ({at})" if at else "At these conditions"
    longest = f"the longest test lasted {format_plain(life.t_observed, 3)} {life.unit}"
    value = float(found[0].value) if found else life.typical
    beyond = life.typical > EXTRAPOLATED * life.t_observed
    end = f", but {longest}: this T is an extrapolation." if beyond else f"; {longest}."
    unknown = _no_interval(law, life)
    typical = f"{place}, T = {format_plain(value, 3)} {life.unit}{_interval_words(found, unknown)}{end}"
    return ToolLifePart(
        verdict=with_remedies(pf, verdict_part(TOOL_LIFE, life.verdict)),
        criterion=f"{life.wear} {life.criterion:g} {life.unit_of_wear}",
        at="" if law is None else at_words(law, where, digits=3),
        typical=figure(value, 3, life.unit),
        **_bounds(found, life.unit, unknown),
        longest=figure(life.t_observed, 3, life.unit),
        extrapolated=beyond,
        command=predict_command("T", where),
        equation=" ".join([f"T = {c0[1]:.6g}", *(f"{name}^{value:.6g}" for name, value in exponents)]),
        words=(definition, *_taylor(life), typical, *_curves(life)),
    )


def _taylor(life: ToolLifeSection) -> tuple[str, ...]:
    if life.taylor is not None:
        return (taylor_words(life.taylor),)
    return (f"Taylor's n = {life.taylor_n:.3g} in V T^n = C.",) if life.taylor_n is not None else ()


def taylor_words(taylor: TaylorSection) -> str:
    """Taylor's constants with intervals, in one sentence.

    >>> taylor_words(TaylorSection(n=0.3, n_interval=(0.23, 0.42), C=410.0, C_interval=(341.0, None), unit="m/min"))
    "Taylor's V T^n = C: n = 0.3 (95 % interval 0.23 to 0.42), C = 410 m/min (at least 341, not bounded above)."
    """
    at = ", ".join(f"{name} {value:.3g}" for name, value in taylor.at.items())
    level = f"{100 * taylor.level:g} % interval "
    n = f"n = {taylor.n:.3g}{_ends(taylor.n_interval, level)}"
    C = f"C = {_plain(taylor.C)} {taylor.unit}{_ends(taylor.C_interval)}"
    return f"Taylor's V T^n = C: {n}, {C}{f' at {at}' if at else ''}."


def _ends(ends: Ends | None, words: str = "") -> str:
    """An interval in brackets; an end that is not bounded is said to be so."""
    if ends is None:
        return ""
    low, high = ends
    if low is not None and high is not None:
        return f" ({words}{_plain(low)} to {_plain(high)})"
    if low is None and high is None:
        return f" ({words}not bounded)"
    if high is None:
        return f" ({words}at least {_plain(low or 0.0)}, not bounded above)"
    return f" ({words}at most {_plain(high)}, not bounded below)"


def _plain(value: float) -> str:
    """Three digits, without an exponent for thousands."""
    return f"{value:.0f}" if 1000 <= value < 1e6 else format_plain(value, 3)


def settings(life: ToolLifeSection) -> dict[str, float]:
    """The middle of the tests, as it is printed and typed."""
    return dict(life.typical_at)


def _predictions(life: ToolLifeSection, law: LawSection | None, where: Mapping[str, float]) -> tuple[Prediction, ...]:
    """The life at the middle, of the law and of one new edge, with Fieller's intervals; empty where there are none."""
    if law is None:
        return ()
    kinds: tuple[Kind, ...] = ("mean", "prediction")
    try:
        return tuple(predict_life(law, life, IntervalOptions(kind), where) for kind in kinds)
    except ParameterError:
        return ()


def _interval_words(found: tuple[Prediction, ...], unknown: str) -> str:
    """Intervals of the life at the middle, of the law and of one new edge, or why that of an edge is not known."""
    intervals = []
    for one, of in zip(found, ("for the law", "for one new edge"), strict=False):
        high = float(one.high)
        ends = _ends((float(one.low), high if high < float("inf") else None)).strip(" ()")
        intervals.append(f"{ends} {'for one row' if 'one row' in one.of else of}")
    if unknown and found:
        intervals[1:] = [f"none for one new edge: {unknown}"]
    return f" (95 % interval {'; '.join(intervals)})" if intervals else ""


def edge_or_row(pf: ParameterFile) -> str:
    """Whose interval that of the life is: of one row where the tests name no edges."""
    law = pf.laws.get(pf.tool_life.wear) if pf.tool_life else None
    return "one row" if law is not None and law.n_edges is None else "new edge"


def _no_interval(law: LawSection | None, life: ToolLifeSection) -> str:
    return "" if law is None else no_edge_interval(law, life)


def life_doubt(pf: ParameterFile) -> str:
    """Why there is no interval of a new edge, in a few words; empty where there is one."""
    life = pf.tool_life
    law = pf.laws.get(life.wear) if life else None
    if life is None or not _no_interval(law, life):
        return ""
    curves = life.curves
    if curves is not None and curves.ratio and beyond_scatter(curves.ratio_interval, curves.expected):
        return f"trust the wear curves: {_plain(curves.typical or life.typical * curves.ratio)} {life.unit}"
    return "the scatter between edges is not known"


def _bounds(found: tuple[Prediction, ...], unit: str, unknown: str) -> dict[str, NumberPart]:
    """Ends of the intervals of the life, of the law and of one new edge, by field of the part; none if not known."""
    if not found:
        return dict.fromkeys(("level", "low", "high", "edge_low", "edge_high"), NONE)
    (low, high), (edge_low, edge_high) = (_ends_of(float(one.low), float(one.high), unit) for one in found)
    edge_low, edge_high = (NONE, NONE) if unknown else (edge_low, edge_high)
    return {"level": percent(LEVEL), "low": low, "high": high, "edge_low": edge_low, "edge_high": edge_high}


def _ends_of(low: float, high: float, unit: str) -> tuple[NumberPart, NumberPart]:
    """Ends rounded as ``fitmodels predict`` rounds them; unbounded for a wear whose exponent of t may be 0."""
    if not math.isfinite(high):
        return (figure(low, 3, unit) if math.isfinite(low) else UNBOUNDED), UNBOUNDED
    width = min((high - low) / 2, low) if low > 0 else (high - low) / 2
    return number(low, width, unit), number(high, width, unit)


def _curves(life: ToolLifeSection) -> tuple[str, ...]:
    """Lives by the wear curves, and the law of these lives."""
    curves = life.curves
    if curves is None:
        return ()
    if curves.typical is None:
        return curves.words
    ends = _ends(curves.typical_interval, "95 % interval ")
    n = "" if curves.taylor is None else f" and n = {curves.taylor.n:.3g}{_ends(curves.taylor.n_interval)}"
    law = f"A law of the lives by the curves gives T = {format_plain(curves.typical, 3)} {life.unit}{ends} there{n}."
    return (*curves.words, law)


def lives_words(law: LawSection) -> str:
    """Number of lives of a law that ended, Taylor's constants, and the life at the middle of the tests."""
    life = law.life
    if life is None:
        return ""
    parts = [f"{life.ended} lives ended"]
    if life.run_outs:
        parts.append(f"{life.run_outs} {'is a run-out' if life.run_outs == 1 else 'are run-outs'}")
    if life.earlier:
        parts.append(f"{life.earlier} {'is' if life.earlier == 1 else 'are'} shorter than the time stated")
    taylor = "" if life.taylor is None else taylor_words(life.taylor)
    return " ".join(filter(None, [f"{', '.join(parts)}.", _distribution_words(life), taylor, _at_middle(law)]))


def _distribution_words(life: LifeSection) -> str:
    shape = f" of shape {1 / life.scale:.3g}" if life.distribution == "weibull" and life.scale > 0 else ""
    name = DISTRIBUTIONS[life.distribution]
    return f"{name[0].upper()}{name[1:]} lives{shape}."


def _at_middle(law: LawSection) -> str:
    """Median life at the middle of the tests, with its intervals; empty for levels and without a covariance."""
    if law.by is not None:
        return ""
    at = {f.symbol: math.sqrt(f.low * f.high) for f in law.factors}
    try:
        mean, one = law.predict(at, "mean"), law.predict(at)
    except ParameterError:
        return ""
    where = ", ".join(f"{name} {value:.3g}" for name, value in at.items())
    ends = (
        f"{_plain(mean.low)} to {_plain(mean.high)} for the law; {_plain(one.low)} to {_plain(one.high)} for one life"
    )
    return f"At the middle of the ranges ({where}), T = {_plain(mean.value)} {law.unit} (95 % interval {ends})."


def fitted_by(law: LawSection) -> str:
    """Method of the fit of a law of lives, for its structure; empty for least squares."""
    life = law.life
    if life is None or (life.distribution == "lognormal" and not life.censored):
        return ""
    return f"maximum likelihood of {DISTRIBUTIONS[life.distribution]} lives, t intervals with corrected scale"


def no_tool_life(pf: ParameterFile) -> str:
    """Reason why the file has no tool life at a criterion."""
    if "T" in pf.laws:
        return "The tool life has a law of its own, that of T, fitted to measured lives."
    wear = next((law for name, law in pf.laws.items() if name in FLANK_WEAR), None)
    if wear is None:
        return "There is no law of wear, so no tool life; measure AW or VB over time."
    if "t" not in [f.symbol for f in wear.factors]:
        return f"The law of {wear.response} does not depend on time, so no tool life; record the time of each wear."
    if wear.form != "power":
        form = wear.form.replace("_", "-")
        return f"The law of {wear.response} has the form {form}, and tool life needs a power law of wear on time."
    if wear.by is not None:
        alone = "fit each level alone, in a file of its own"
        return f"The law of {wear.response} has levels, and tool life is computed for one: {alone}."
    return f"No tool life was computed from the law of {wear.response}: request it with --criterion."


class PlanRowPart(Part):
    """A row of a plan: minutes in the cut, the pair of speed and feed, and what it gives at its end."""

    start: NumberPart
    end: NumberPart
    V: NumberPart
    f: NumberPart
    wear: NumberPart
    rate: NumberPart  # of removal
    limits: str  # that the pair stands on
    tested: bool  # whether it lies inside the tests


class PlanPart(Part):
    """The plan of speed and feed over the life of an edge, for the limits of the file; calculated, not measured."""

    title: str
    wear: str  # the symbol of the wear
    rows: tuple[PlanRowPart, ...]
    sentences: tuple[str, ...]
    command: str  # that writes the whole plan


def plan_part(pf: ParameterFile) -> PlanPart | None:
    """The plan of largest removal rate, where the file has what it needs."""
    from ...controllers.recursion.plan import plan_of

    if no_plan(pf):
        return None
    plan = plan_of(pf)
    laws, minutes = plan.laws, format_plain(plan.minutes, 4)
    rows = tuple(
        PlanRowPart(
            start=figure(row.start, 6, "min"), end=figure(row.end, 6, "min"), V=figure(row.V, 4, "m/min"),
            f=figure(row.f, 4, "mm/rev"), wear=figure(row.wear, 3, laws.wear.unit),
            rate=figure(row.rate / 1000, 4, "cm3/min"), limits=reason, tested=row.tested,
        )
        for row, reason in zip(plan.rows[:PLANNED], plan.limit_reasons, strict=False)
    )  # fmt: skip
    removed = f"{format_plain(plan.removed / 1000, 4)} cm3"
    life = f"the edge lasts {minutes} min and removes {removed}" if rows else "no pair keeps the limits on a new edge"
    more = len(plan.rows) - len(rows)
    rest = [f"{count(more).text} more rows: the command writes all of them"] if more > 0 else []
    simulated = ["the data are simulated: do not run a machine by this plan"] if pf.identity.simulated else []
    scatter = ["new edges scatter about the law: some are worn out before the plan ends"] if rows else []
    sentences = [
        f"calculated from the laws, not measured: {life}, depth of cut {laws.d:g} mm", *simulated, *plan.extrapolated,
        *scatter, *rest, *(f"assumed: {words[0].lower()}{words[1:]}" for words in plan.assumed),
    ]  # fmt: skip
    return PlanPart(
        title="Plan of the life of an edge, largest removal rate",
        wear=laws.wear.response,
        rows=rows,
        sentences=tuple(sentence(words) for words in sentences),
        command="fitmodels export params.json --to csv",
    )


def no_plan(pf: ParameterFile) -> str:
    """Reason why the file has no plan of an edge's life; empty where it has one."""
    from ...controllers.recursion.from_file import shortfall

    return f"There is no plan of an edge's life: {why}" if (why := shortfall(pf)) else ""
