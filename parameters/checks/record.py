"""Checks of the parts of a file against each other and against its tests.

Laws against the text of their equations, their posteriors and their regions. The record of the dynamics against the
load tests: ranges of load, static gain and slope, scaling of the command. Limits: possible, usual, and near the tests.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from ...core.arrays import Array
from ...core.text import shortened
from ...core.verdict import DO_NOT_USE
from ...datasets.plausibility.ranges import Plausible, plausible, process_of, widest
from ...datasets.vocabulary import ROLES
from ..evaluation import covariance_of, point_values
from ..file import ParameterFile
from ..messages import in_unit, short
from ..sections.base import Covariance
from ..sections.law import LawSection
from ..sections.law_parts import LevelShifts, Region, ToolLifeSection
from ..sections.load_line import Bound, LimitsSection, Range
from ..sections.posterior import LawPosterior
from ..setting_words import limit_far_beyond_tests, loads_tested, power_limit_words
from .report import FileFinding

AGREE: Final = 1.25  # static gain and slope of a load law are from two experiments
REFUSED: Final = 2.0  # a ratio of the two beyond this, or its inverse, is a wrong scaling or unit
APART: Final = 10.0  # SD of its posterior or SE between a coefficient and its posterior: honest files reach 5 or 6
INFORMATIVE: Final = 3.0  # a prior narrower than so many SD of the posterior moves it away from the estimate
SAME_RANGE: Final = 1e-6  # relative: the region holds logarithms
LIFE_AGREES: Final = 1e-4  # relative: a tool life is solved from its law
CRITERION: Final = "tool_life.criterion"
DIGITS: Final = 6e-6  # of a coefficient: half of the last of six digits, and rounding
SHIFT: Final = re.compile(r"; (times|plus|minus) ([-+.\de]+) for ")  # of a level, in an equation
MARGIN: Final = 0.25  # of the range of loads tested: a mean of the record may lie this far outside


def check_texts(pf: ParameterFile) -> Iterator[FileFinding]:
    """Findings where a number and its text contradict each other: one of them was changed without the other."""
    from ...datasets.runs import disclaimers

    for name, law in pf.laws.items():
        yield from _of_law(pf, name, law)
    if pf.tool_life is not None and (wrong := _off_life(pf.tool_life, pf.laws.get(pf.tool_life.wear))):
        yield FileFinding("tool life", False, f"tool_life: {wrong}; restore the file or fit again.")
    if pf.identity.simulated is False and pf.identity.note and disclaimers([pf.identity.note]):
        words = f"the note, {shortened(pf.identity.note, 80)!r}, but identity.simulated is false; restore the file."
        yield FileFinding("simulated", False, f"The data were simulated according to {words}")


def _of_law(pf: ParameterFile, name: str, law: LawSection) -> Iterator[FileFinding]:
    """Findings where a law contradicts its equation, its posterior or its region."""
    if law.equation and (wrong := _not_in_equation(law)):
        words = f"laws.{shortened(name)}: the equation, {shortened(law.equation, 80)!r}, {wrong}; restore the file."
        yield FileFinding("equation", False, words)
    for wrong in (*_off_posterior(pf, name, law), *_off_region(law)):
        yield FileFinding("law", False, f"laws.{shortened(name)}: {wrong}; restore the file or fit again.")


def _not_in_equation(law: LawSection) -> str:
    """What the equation lacks: its form, a coefficient with its sign, or a level; empty where it is right."""
    held = law.formula.printed(law.equation)
    if not held:
        right = law.formula.equation([f"{law.coefficients[name]:.6g}" for name in law.formula.names])
        return f"is not that of its coefficients, {shortened(f'{law.response} = {right}', 80)!r}"
    for name, value in law.coefficients.items():
        if not abs(held[name] - value) <= DIGITS * abs(value):
            return f"lacks its coefficient {name} = {value:.6g} and has {held[name]:.6g} there"
    return "" if law.by is None else _not_in_levels(law, law.by)


def _not_in_levels(law: LawSection, by: LevelShifts) -> str:
    """The shift of a level that the equation lacks: its factor, or what it adds to a line."""
    found = [*SHIFT.finditer(law.equation)]
    ends = [one.start() for one in found[1:]] + [len(law.equation)]
    printed = {
        law.equation[one.end() : end]: float(one[2]) * (-1.0 if one[1] == "minus" else 1.0)
        for one, end in zip(found, ends, strict=True)
    }
    for level, shift in by.shifts.items():
        value = printed.get(level, math.nan)
        if not abs(value - _value(law, shift)) <= DIGITS * abs(value):
            return f"lacks the shift {shift:.6g} of level {short(level)}"
    return ""


def _off_posterior(pf: ParameterFile, name: str, law: LawSection) -> Iterator[str]:
    """What of a law lies far from its posterior with weak priors: its value at the middle of the tests, an exponent."""
    post, names = None if pf.posterior is None else pf.posterior.laws.get(name), law.parameter_names
    if post is None or not ({*names, "sd"} <= {*post.parameters} and {*names[1:]} <= {*post.level_at}):
        return
    to_level = np.eye(len(names))
    to_level[0, 1:] = [post.level_at[one] for one in names[1:]]
    here, mean = to_level @ law.theta, to_level @ [post.parameters[one].mean for one in names]
    scale = _scale_of_posterior(law, post, to_level)
    far = () if _informative(post, names, scale) else np.flatnonzero(np.abs(here - mean) > APART * scale)
    for j in far:
        if j:
            sd = post.parameters[names[j]].sd
            yield f"its coefficient {names[j]} is {here[j]:.4g}, in its own posterior {mean[j]:.4g} +- {sd:.2g}"
        else:
            own, of = (_value(law, one) for one in (here[0], mean[0]))
            yield f"in the middle of the tests it gives {own:.3g} {law.unit}, its own posterior {of:.3g} {law.unit}"


def _value(law: LawSection, linear: float) -> float:
    """A response, or a factor between levels, from its value in the linear form of the law."""
    return _unlogged(linear) if law.logarithmic else linear


def _unlogged(value: float) -> float:
    return math.exp(min(value, 700.0))  # numbers of a damaged file may be of any size


def _scale_of_posterior(law: LawSection, post: LawPosterior, to_level: Array) -> Array:
    """The larger of posterior SD and SE of level and exponents, shape (p,); the SD of the level is not in the file."""
    held = [post.parameters[one] for one in law.parameter_names]
    sd, per = np.array([one.sd for one in held]), 1.0
    if law.logarithmic and law.error == "additive":  # scatter in the unit of the response, level as a logarithm
        per = _unlogged(float(to_level[0] @ [one.mean for one in held])) or 1.0
    sd[0] = post.parameters["sd"].mean / per / math.sqrt(max(1, law.n_edges or law.n))
    if not isinstance(law.uncertainty, Covariance):
        return sd
    with np.errstate(all="ignore"):
        variances = np.diag(to_level @ covariance_of(law) @ to_level.T)
    return np.asarray(np.fmax(sd, np.sqrt(np.fmax(variances, 0.0))))


def _informative(post: LawPosterior, names: Sequence[str], scale: Array) -> bool:
    """Whether a prior is so narrow that it moves the posterior away from the estimate."""
    priors = [post.priors.get(one) for one in ("level", *names[1:])]
    widths = [prior.numbers["sd"] if prior and prior.distribution == "normal" else math.inf for prior in priors]
    return bool((np.array(widths) < INFORMATIVE * scale).any())


def _off_region(law: LawSection) -> Iterator[str]:
    """Ranges of factors that begin below zero, or are other than those of the tested region."""
    for j, factor in enumerate(law.factors):
        words = f"the tested range of {shortened(factor.symbol)} is {factor.low:.6g} to {factor.high:.6g} {factor.unit}"
        ranges = plausible(factor.symbol, None)
        if factor.low < 0 and (law.formula.logs[j] or (ranges is not None and ranges.hard[0] >= 0)):
            yield f"{words}; it cannot be below zero"
        elif law.region is not None:
            low, high = _range_of_region(law, law.region, j)
            if max(abs(low - factor.low), abs(high - factor.high)) > SAME_RANGE * max(abs(low), abs(high)):
                yield f"{words}, in its own region {low:.6g} to {high:.6g} {factor.unit}"


def _range_of_region(law: LawSection, region: Region, j: int) -> tuple[float, float]:
    """Range of factor j by the region, and by edges that later versions of the file added."""
    half = 0.0 if law.factors[j].low == law.factors[j].high else region.half_range[j]  # of one value it is arbitrary
    added = [one.mean[j] for one in law.sums.edges] if law.sums and law.formula.first_order else []
    low, high = min([region.centre[j] - half, *added]), max([region.centre[j] + half, *added])
    return (_unlogged(low), _unlogged(high)) if law.formula.logs[j] else (low, high)


def _off_life(life: ToolLifeSection, law: LawSection | None) -> str:
    """How a tool life contradicts itself, or the law of wear that it is solved from; empty where it does not."""
    typical = f"typical life, {life.typical:.4g} {life.unit}"
    found = _ln(life.coefficients.get("c0", 1.0))
    found += sum(life.coefficients.get(name, 0.0) * _ln(x) for name, x in life.typical_at.items())
    if not abs(found - _ln(life.typical)) < LIFE_AGREES:
        return f"its coefficients give {_unlogged(found):.4g} {life.unit}, not the {typical}"
    if law is None or law.form != "power" or {factor.symbol for factor in law.factors} != {"t", *life.typical_at}:
        return ""
    worn, criterion = _wear_at_life(life, law), in_unit(life.criterion, life.unit_of_wear, law.unit)
    if worn is None or criterion is None or abs(worn - criterion) <= LIFE_AGREES * criterion:
        return ""
    return f"the law of {shortened(life.wear)} gives {worn:.4g} {law.unit} after the {typical}, not its criterion"


def _wear_at_life(life: ToolLifeSection, law: LawSection) -> float | None:
    """Wear after the typical life by the law, at its reference level; None where it cannot be evaluated."""
    unit = next(factor.unit for factor in law.factors if factor.symbol == "t")
    t = in_unit(life.typical, life.unit, unit)
    if t is None or min([t, *life.typical_at.values()]) <= 0:
        return None
    return float(point_values(law, None if law.by is None else law.by.reference, {**life.typical_at, "t": t}))


def _ln(value: float) -> float:
    return math.log(max(value, 1e-300))


def record_notes(pf: ParameterFile, ends: tuple[float, float] | None = None) -> list[str]:
    """A sentence where the operating point of the record lies outside the loads tested of a load law.

    Parameters
    ----------
    pf : ParameterFile
    ends : tuple of float, optional
        Smallest and largest output of the record, in the unit of the dynamics; a file does not hold them.
    """
    from ...datasets.records.reading import DEVIATIONS  # loads readers of files

    model = pf.dynamics
    if model is None or model.operating_point is None or model.integrating or any(map(DEVIATIONS.search, model.notes)):
        return []
    for law in pf.laws.values():
        if law.form != "load_line" or _is_barred(law):
            continue
        point = in_unit(model.operating_point[1], model.unit_y, law.unit)
        low, high = loads_tested(law)
        slack = MARGIN * (high - low)
        if point is None or low - slack <= point <= high + slack:
            continue
        scaled = [] if ends is None else [in_unit(end, model.unit_y, law.unit) for end in ends]
        over = " to ".join(f"{end:.2g}" for end in scaled if end is not None)
        about = f"{point:.2g} {law.unit}" + (f" ({over} {law.unit})" if over else "")
        return [
            f"The record of the dynamics was made about {about}, the tests of {short(law.response)} lie at {low:.2g} "
            f"to {high:.2g} {law.unit} by their law: if the record holds deviations from a cutting load, state it with "
            "--deviations; otherwise it was not made in a cut."
        ]
    return []


def load_slope(pf: ParameterFile, unit: str | None) -> tuple[str, float] | None:
    """Unit of the command, and change of the output of the dynamics for one unit of it by the load law.

    None where there is no single load law, or where the units cannot be compared.

    Parameters
    ----------
    pf : ParameterFile
        With dynamics.
    unit : str or None
        Of the command; None: that of the feed of the law.
    """
    d, laws = pf.dynamics, _load_laws(pf)
    if d is None or len(laws) != 1:
        return None
    law, feed = laws[0], laws[0].factors[0].unit
    load, command = in_unit(1.0, law.unit, d.unit_y), in_unit(1.0, unit or feed, feed)
    B = law.coefficients["B"]
    return (unit or feed, B * load * command) if B and load and command else None


def against_scaling_by_law(pf: ParameterFile) -> str:
    """Sentence on a scaling that a load law gives which must not be used; empty where it may be used."""
    barred = _barred(pf)
    return f"The scaling is derived from a load law. {barred}" if barred else ""


def against_load_law(pf: ParameterFile, unit: str | None, scaling: float | None) -> str:
    """Sentence on dynamics or a scaling that contradict the load law; empty where none does."""
    d, law = pf.dynamics, load_slope(pf, unit)
    if d is None or law is None or not math.isfinite(d.dc_gain):
        return ""
    feed, B = law
    slope, barred = f"{d.unit_y} per {feed}", _barred(pf)
    scaling = scaling or (1.0 if d.unit_u == feed else None)
    if d.dc_gain * B < 0:
        falls, rises = ("falls", "rises") if d.dc_gain < 0 else ("rises", "falls")
        return (
            f"By the dynamics the load {falls} where the feed rises (static gain {d.dc_gain:.4g} {d.unit_y}/{d.unit_u}"
            f"), by the load law it {rises} ({B:.4g} {slope}): the sign of the load sensor or of the command is "
            "reversed in one of the two records, and the control would be positive feedback. Check the sensor and "
            f"identify again. {barred}".rstrip()
        )
    if scaling is not None and not 1 / REFUSED <= d.dc_gain / scaling / B <= REFUSED:
        return (
            f"By dynamics and scaling the load changes by {d.dc_gain / scaling:.4g} {slope}, by the load law by "
            f"{B:.4g}: {d.dc_gain / scaling / B:.2g} times as much, outside {1 / REFUSED:g} to {REFUSED:g}. The "
            f"given scaling is {scaling:g}; by the load law 1 {d.unit_u} is {d.dc_gain / B:.4g} {feed}: --scaling "
            f"{d.dc_gain / B:.4g}. {barred}".rstrip()
        )
    return ""


def scaling_by_load_law(pf: ParameterFile, unit: str | None, scaling: float | None) -> list[str]:
    """Sentences with the scaling of the input by the load law, where another one or none was given."""
    d, law = pf.dynamics, load_slope(pf, unit)
    if d is None or law is None:
        return []
    feed, B = law
    found = d.dc_gain / B
    given = scaling or (1.0 if d.unit_u == feed else None)
    if found <= 0 or (given and max(given / found, found / given) <= AGREE):
        return []
    by_law = (
        f"By the load law 1 {d.unit_u} is {found:.4g} {feed}: the static gain {d.dc_gain:.4g} {d.unit_y}/{d.unit_u} "
        f"of the model over the slope {B:.4g} {d.unit_y} per {feed} of the law. "
    )
    if given is None:
        said = f"For gains in feed add --unit {feed} --force."
    else:
        said = (
            f"The given scaling is {given:g}, {given / found:.2g} times that: check it; a run under other cutting "
            "conditions than the tests has another gain."
        )
    return [f"{by_law}{said} {_barred(pf)}".rstrip()]


def _load_laws(pf: ParameterFile) -> list[LawSection]:
    return [law for law in pf.laws.values() if law.form == "load_line"]


def _barred(pf: ParameterFile) -> str:
    """Sentence on a load law that must not be used, with the first reason; empty where there is none."""
    for law in _load_laws(pf):
        if law.verdict is not None and _is_barred(law):
            what = f"The law of {short(law.response)} must not be used: {law.verdict.reasons[0]}"
            return f"{what} Correct the tests and fit again, or measure the scaling."
    return ""


def _is_barred(law: LawSection) -> bool:
    """Whether a law must not be used."""
    return law.verdict is not None and law.verdict.concern == DO_NOT_USE


LIMITED: Final[Mapping[str, str]] = {
    "power": "P", "force": "F", "wear": "VB", "feed": "f", "feed_rate": "fm", "speed": "V", "spindle_speed": "n",
}  # fmt: skip
LOADS: Final = ("limits.power", "limits.force")
FAR_WEAR, FAR = 3.0, 10.0  # times the largest wear, or value of a factor, that was tested: a limit beyond is doubted


def check_limits(pf: ParameterFile) -> Iterator[FileFinding]:
    """Findings on limits that are impossible, unusual or far beyond the tests, and on two wear criteria."""
    factors = {factor.symbol for law in pf.laws.values() for factor in law.factors}
    process = process_of(factors, (pf.identity.tool, pf.identity.work, pf.identity.machine or ""))
    for where, symbol, value, unit in (*_upper_ends(pf.limits), *_wears(pf)):
        ranges = widest(symbol) if (symbol, process) == ("f", None) else plausible(symbol, process)
        high = None if symbol not in ROLES else in_unit(value, unit, ROLES[symbol].unit)
        if ranges is not None and high is not None:
            words = f"{where}: {shortened(symbol)} up to {value:g} {unit}"
            tested = None if where == CRITERION else _largest_tested(pf, symbol, ROLES[symbol].unit)
            yield from _size(words, symbol, high, ranges, tested)
        if where in LOADS and symbol in pf.laws and (far := limit_far_beyond_tests(pf.laws[symbol], value, unit)):
            yield FileFinding("doubt", None, f"{where}: {far}")
    yield from _two_criteria(pf)
    yield from (FileFinding("limits", None, words) for words in power_limit_words(pf.limits, pf.laws, pf.costs))


def _size(words: str, symbol: str, high: float, ranges: Plausible, tested: float | None) -> Iterator[FileFinding]:
    """Finding on a limit beyond the ranges of its quantity, or far beyond the largest value tested, in its unit."""
    own, far = ROLES[symbol].unit, FAR_WEAR if ROLES[symbol].kind == "wear" else FAR
    if high > ranges.hard[1]:
        yield FileFinding("limits", False, f"{words} is impossible, beyond {ranges.hard[1]:g} {own}; correct it.")
    elif high > ranges.unusual[1]:
        yield FileFinding("doubt", None, f"{words} is unusual, beyond {ranges.unusual[1]:g} {own}: check its unit.")
    elif tested and high > far * tested:
        beyond = f"{high / tested:.3g} times the largest tested, {tested:g} {own}: check its unit."
        yield FileFinding("doubt", None, f"{words} is {beyond}")


def _two_criteria(pf: ParameterFile) -> Iterator[FileFinding]:
    """Finding on a wear limit that is not the criterion of the tool life."""
    life, worn = pf.tool_life, None if pf.limits is None else pf.limits.wear
    if life is None or worn is None or worn.of not in (None, life.wear):
        return
    limit = in_unit(worn.value, worn.unit, life.unit_of_wear)
    if limit is not None and limit != life.criterion:
        both = f"limits.wear is {limit:g} {life.unit_of_wear}, and the tool life of the file is at {life.criterion:g}"
        words = f"{both}: controls end an edge at the first; fit again with --criterion, or change the limit."
        yield FileFinding("doubt", None, words)


def _upper_ends(limits: LimitsSection | None) -> Iterator[tuple[str, str, float, str]]:
    """Name, symbol, largest value and unit of each limit that has an upper end."""
    for name, usual in LIMITED.items():
        limit = getattr(limits, name, None)
        if isinstance(limit, Bound):
            yield f"limits.{name}", limit.of or usual, limit.value, limit.unit
        elif isinstance(limit, Range):
            yield f"limits.{name}", usual, limit.high, limit.unit
    for symbol, ends in () if limits is None else limits.responses.items():
        if ends.high is not None:
            yield f"limits.responses.{shortened(symbol)}", symbol, ends.high, ends.unit


def _wears(pf: ParameterFile) -> Iterator[tuple[str, str, float, str]]:
    """Name, symbol, value and unit of the wears at which an edge is changed, besides the limits."""
    if (line := pf.load_line) is not None:
        law = pf.laws.get(line.law)
        yield "load_line.window", "VB" if law is None else law.factors[-1].symbol, line.window[1], line.unit_wear
    if (life := pf.tool_life) is not None:  # far beyond the tests it is extrapolated, as its verdict says
        yield CRITERION, life.wear, life.criterion, life.unit_of_wear


def _largest_tested(pf: ParameterFile, symbol: str, unit: str) -> float | None:
    """Largest value of a factor, or largest wear, of the tests behind the laws of a file; None where not known."""
    ends = [(f.high, f.unit) for law in pf.laws.values() for f in law.factors if f.symbol == symbol]
    if pf.tool_life is not None and pf.tool_life.wear == symbol and pf.tool_life.wear_observed:
        ends.append((pf.tool_life.wear_observed, pf.tool_life.unit_of_wear))
    return max((value for end, of in ends if (value := in_unit(end, of, unit)) is not None), default=None)
