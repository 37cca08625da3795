"""Checks of a law against the physics of cutting: signs and usual ranges of its exponents, and possible predictions.

The 95 % interval of an exponent is compared with the range, never the estimate alone: an interval that reaches the
range is no evidence against the law. Ranges are wide, since work, tool and wear criterion move the exponents.
A law
of another form is judged by its exponents at the middle of the rows. Ranges and their sources: ``exponent_ranges``.
"""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from ...core.arrays import Array
from ...core.errors import FitError
from ...core.rounding import format_decimal
from ...datasets import Runs
from ...datasets.options import Process
from ...datasets.plausibility.ranges import KC, Plausible, plausible
from ...datasets.vocabulary import ROLES, WEAR
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import Check, lines_of
from .exponent_ranges import (
    ROUGHNESS,
    SAME,
    Exponent,
    Range,
    constant_in_force,
    local_exponents,
    power_in_air,
    usual_exponents,
)
from .strata import NO_ROWS, is_computed
from .usefulness import measured_of

IN_AIR = 0.05  # of the median of the cuts, from which on a load in air is in the law
LOADS = tuple(name for name, role in ROLES.items() if role.kind == "load" and name != "theta")
EVEN = 0.2  # relative range of loads in air that are subtracted as one number
Found = tuple[int, str]  # contribution to the verdict, and the sentence


def exponents(law: LawFit, runs: Runs | None = None) -> Check | NotAvailable | None:
    """Signs and ranges of the exponents of a law, at the middle of its rows where it is no power law.

    Of a feed line, and of roughness as an exponential of the force, the sign of the slope.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> exponents(law).concern
    0
    """
    if law.no_interval:
        return NotAvailable(law.no_interval)
    if law.form in SLOPES and len(law.factors) == 1 and law.factors[0] not in SAME:
        return _slope(law)
    return _slope(law) if law.form == "feed_line" else _exponents(law, runs)


def _exponents(law: LawFit, runs: Runs | None) -> Check | NotAvailable:
    process, tool = (None, law.source.tool) if runs is None else (runs.process, runs.tool)
    where = process or "cutting"
    ranges = usual_exponents(law.response, law.factors, process, tool)
    if not ranges:
        return NotAvailable(f"no usual exponents of {law.response} in {where} are listed")
    intervals = _intervals(law)
    if isinstance(intervals, NotAvailable):
        return intervals
    ranges = {name: one for name, one in ranges.items() if name in intervals}
    said = [_judged(law, name, one, intervals[name]) for name, one in ranges.items()]
    null = f"the interval of each exponent reaches the range that occurs in {where}"
    found = list(filter(None, [*said, _reversed_order(law, ranges), _air(law, runs)]))
    return _check(null, found, _passed(ranges, intervals, where))


def _intervals(law: LawFit) -> dict[str, tuple[float, float, float]] | NotAvailable:
    """Exponent of each factor and the ends of its interval."""
    if law.form == "power":
        ends = law.conf_int()
        params = law.params
        return {name: (float(params[name]), float(ends.low[name]), float(ends.high[name])) for name in law.factors}
    return NotAvailable(NO_ROWS) if law.rows is None else local_exponents(law)


def _air(law: LawFit, runs: Runs | None) -> Found | None:
    """A load that contains that in air: by rows without a cut, of power and main force also by the exponents."""
    if law.rows is None:
        return None
    source, values = measured_of(law, runs) if is_computed(law.response, runs) else (law.response, law.observed)
    words = _measured_in_air(law, runs) if source == law.response else ""
    if not words and source in ("P", "Fc"):
        words = power_in_air(law) if source == "P" else constant_in_force(law, source, values)
    return (1, words) if words else None


def _measured_in_air(law: LawFit, runs: Runs | None) -> str:
    """The sentence on rows of a load without feed, depth or width of cut; "" without any, or where it is near zero."""
    names = {"f", "fz", "fm", "d", "ae"}.intersection(law.factors)
    if runs is None or law.response not in LOADS or not names:
        return ""
    load = runs.values(law.response)
    at = np.isfinite(load) & np.any([runs.values(name) == 0 for name in names], axis=0)
    if not at.any() or np.median(load[at]) < IN_AIR * np.median(law.observed):
        return ""
    low, high, middle = float(load[at].min()), float(load[at].max()), float(np.median(load[at]))
    size = " to ".join(dict.fromkeys(map(format_decimal, (low, high))))
    remedy = f"Subtract it: --correct 'all:{law.response}-{middle:.3g}'."
    return (
        f"{law.response} was measured without a cut too, {size} {law.units.get(law.response, '')} "
        f"({lines_of(list(map(int, runs.lines[at])))}), which is in every reading. "
        f"{remedy if high - low <= EVEN * middle else 'Subtract that of each speed.'}"
    )


def _passed(ranges: Mapping[str, Exponent], intervals: Mapping[str, tuple[float, float, float]], where: str) -> str:
    """The sentence where no exponent is doubted: those outside the usual range, and those that are uncertain."""
    wide, beyond = [], []
    for name, one in ranges.items():
        b, low, high = intervals[name]
        words = f"{name} {b:.2g}, {low:.2g} to {high:.2g} (usual {_range(one.usual)}"
        if not one.limits[0] <= b <= one.limits[1]:
            wide.append(f"{words})")
        elif max(one.usual[0], low) > min(one.usual[1], high):
            beyond.append(f"{words}, doubted beyond {_range(one.limits)})")
    outside = f"Exponents outside the range usual in {where}, and not so far that they are doubted"
    said = [f"Exponents that are unusual but too uncertain to be judged: {'; '.join(wide)}."] if wide else []
    said += [f"{outside}: {'; '.join(beyond)}."] if beyond else []
    reaches = f"The 95 % interval of each exponent ({', '.join(ranges)}) reaches the range usual in {where}."
    return " ".join(said) or reaches


def _check(null: str, found: list[Found], passed: str) -> Check:
    """The check of several findings, the most serious first."""
    found.sort(key=lambda one: -one[0])
    return Check(
        null=null,
        concern=max((one[0] for one in found), default=0),
        verdict=" ".join(one[1] for one in found) or passed,
    )


def _judged(law: LawFit, name: str, one: Exponent, interval: tuple[float, float, float]) -> Found | None:
    """The sentence on an exponent with its interval (estimate, low, high) that contradicts physics."""
    response, (b, low, high) = law.response, interval
    where = "" if law.form == "power" else " at the middle of the tests"
    numbers = f"{b:.2g}, 95 % interval {low:.2g} to {high:.2g}"
    if one.sign and (high < 0 if one.sign > 0 else low > 0):
        moves, should = ("falls", "rise") if one.sign > 0 else ("rises", "fall")
        why = _WRONG_SIGN.get((response in WEAR, SAME.get(name, name)), "the columns, their units and signs")
        return 2, f"{response} {moves} with {name}{where} (exponent {numbers}) where it must {should}: check {why}."
    if one.limits[0] <= high and low <= one.limits[1]:
        return None
    return 1, (
        f"The exponent of {name} in {response}{where} is unusual ({numbers}; usual {_range(one.usual)}): check the "
        "columns and units, and whether other conditions varied together with it."
    )


_WRONG_SIGN = {
    (True, "t"): "the time column, the order of the rows and the names of the edges",
    (True, "V"): "whether columns are exchanged; only a built-up edge at low speed wears less at higher speed",
}


def _range(ends: Range) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}"


_SPEED, _FEED = ("V", "n"), ("f", "fz")
# of responses: the condition on which they depend more, the other one, and by how much the exponents may be reversed
_ORDER: tuple[tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], float], ...] = (
    ((*WEAR, "T"), _SPEED, _FEED, 0.0),
    (("Fc", "P", "M"), ("d",), _FEED, 0.1),
    (ROUGHNESS, _FEED, ("d",), 0.3),
)


def _depends_more(law: LawFit, one: str, other: str, least: float) -> bool:
    """Whether a response depends more on one condition than on another, at 95 % and by more than ``least``."""
    at = [law.names.index(name) for name in (one, other)]
    cov = law.covariance()[np.ix_(at, at)]
    error = float(np.sqrt(max(cov[0, 0] + cov[1, 1] - 2 * cov[0, 1], 0.0)))
    difference = float(law.params[one]) - float(law.params[other])
    sign = -1 if law.response == "T" else 1
    return bool(sign * difference > max(law.t_quantile(0.95) * error, least))


def _reversed_order(law: LawFit, ranges: Mapping[str, Exponent]) -> Found | None:
    """A response that depends more on one condition than on another, where in cutting it is the other way round."""
    if law.form != "power":
        return None
    for responses, larger, smaller, least in _ORDER:
        more, less = (next(filter(ranges.__contains__, names), "") for names in (larger, smaller))
        if law.response not in responses or "" in (more, less) or not _depends_more(law, less, more, least):
            continue
        in_cutting = "speed" if more in _SPEED else {"d": "depth"}.get(more, "feed")
        return 1, (
            f"{law.response} depends more on {less} (exponent {float(law.params[less]):.2g}) than on {more} "
            f"({float(law.params[more]):.2g}), in cutting it depends more on {in_cutting}: check whether {more} and "
            f"{less} are exchanged or varied together."
        )
    return None


# of each form: name of its slope, sign, what has it, and why; roughness by force is inverted by force control
SLOPES: Mapping[str, tuple[str, int, str, str]] = {
    "feed_line": ("slope", -1, "the feed at a held load", "wear must reduce it: check the columns and their order"),
    "exponential": ("b", 1, "roughness", "both rise with the feed: check whether speed or tool was changed as well"),
}


def _slope(law: LawFit) -> Check:
    name, sign, what, why = SLOPES[law.form]
    low, high = (float(law.conf_int()[end][name]) for end in ("low", "high"))
    does, factor = ("falls" if sign > 0 else "rises"), law.factors[-1]
    wrong = f"{what[0].upper()}{what[1:]} {does} with {factor} ({name} {low:.3g} to {high:.3g}), where {why}."
    null = f"{what} does not {'fall' if sign > 0 else 'rise'} with {factor}"
    found = [(2, wrong)] if max(sign * low, sign * high) < 0 else []
    return _check(null, found, f"{null[0].upper()}{null[1:]}.")


FAR = 2.0  # times the limit of the unusual that the largest prediction may reach
KC_USUAL, KC_UNUSUAL, KC_HARD = KC.usual, KC.unusual, KC.hard


def possible_values(law: LawFit, runs: Runs | None = None) -> Check | NotAvailable:
    """Predictions over the tested region, the specific cutting force that they imply, and unjudged conditions.

    Conditions that the reading has judged are not judged again, nor values of the response that it has doubted.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t", "AW"])
    >>> possible_values(law).verdict
    'Predicted P 0.73 to 5 kW is possible; kc 1900 to 4400 N/mm2 (usual 500 to 6000).'
    """
    if law.rows is None:
        return NotAvailable(NO_ROWS)
    values = region_values(law)
    span = f"{values.min():.2g} to {values.max():.2g} {law.units.get(law.response, '')}".rstrip()
    kc = _specific_force(law, runs)
    process, doubts, judged = (None, (), False) if runs is None else (runs.process, runs.doubts, runs.judged)
    found = [*_not_positive(law, values, span), *_unusual(law, values, span, process), *_of_kc(law.response, kc)]
    if any(law.response in doubt.columns for doubt in doubts):
        found = [one for one in found if one[0] > 1]
    if not judged:
        found += _of_factors(law, process)
    passed = f"Predicted {law.response} {span} is possible"
    if kc is not None:
        passed += f"; kc {kc[0]:.2g} to {kc[1]:.2g} N/mm2 (usual {KC_USUAL[0]} to {KC_USUAL[1]})"
    return _check("predictions over the tested region are possible", found, f"{_plain(passed)}.")


def _plain(words: str) -> str:
    """Numbers as ``2300``, never ``2.3e+03``."""
    return " ".join(format_decimal(float(w)) if "e+0" in w and w[0].isdigit() else w for w in words.split(" "))


def region_values(law: LawFit) -> Array:
    """Predictions at the rows and at the corners of the box that lie in the tested region, shape (m,)."""
    if law.by is not None or len(law.factors) > 6:
        return law.fitted
    try:
        region = law.region
    except FitError:  # too few settings to span one
        return law.fitted
    corners = np.array(list(product(*(law.domain[name] for name in law.factors))))
    points = {name: corners[:, j] for j, name in enumerate(law.factors)}
    inside = region.inside(points)
    predicted = law.formula.response_at(law.theta, law.formula.design(corners[inside]))
    return np.concatenate([law.fitted, predicted])


def _not_positive(law: LawFit, values: Array, span: str) -> Iterator[Found]:
    """Predictions of zero or less of a quantity that is above zero."""
    role = ROLES.get(law.response)
    if role is None or role.kind in ("label", "other") or values.min() > 0:
        return
    remedy = "fit with multiplicative errors, or restrict the range"
    words = f"The law predicts {law.response} of {span} in the tested region, where it is above zero: {remedy}."
    yield 1 + int((law.fitted <= 0).any()), words


def _unusual(law: LawFit, values: Array, span: str, process: Process | None) -> Iterator[Found]:
    """Predictions that are impossible, or far from the usual."""
    ranges = plausible(law.response, process)
    if ranges is None or law.units.get(law.response) != role_unit(law.response):
        return
    high, middle = float(values.max()), float(np.median(values))
    usual = f"usual {_range(ranges.usual)} {role_unit(law.response)}"
    if high > ranges.hard[1]:
        beyond = not law.formula.first_order and float(law.fitted.max()) <= ranges.hard[1]
        remedy = "the form does not hold between the rows, compare it with others" if beyond else "check the unit"
        yield 2, f"The law predicts {law.response} of {span}, which cannot be ({usual}): {remedy}."
    elif high > FAR * ranges.unusual[1] or middle > ranges.unusual[1] or 0 < high < ranges.unusual[0]:
        yield 1, f"The law predicts {law.response} of {span}, which is unusual ({usual}): check the unit."


def role_unit(role: str) -> str:
    """Unit of a role, empty for a column without one."""
    return ROLES[role].unit if role in ROLES else ""


def _of_factors(law: LawFit, process: Process | None) -> Iterator[Found]:
    """Conditions of tests that no reading has judged."""
    for name in law.factors:
        ranges, (low, high) = plausible(name, process), law.domain[name]
        if ranges is None or law.units.get(name) != role_unit(name):
            continue
        level = _outside(ranges, low, high)
        if level:
            span = _plain(f"{low:.3g} to {high:.3g} {law.units[name]}")
            word = "cannot be" if level > 1 else "is unusual"
            yield level, f"{name} {span} {word} (usual {_range(ranges.usual)}): check its column and unit."


def _outside(ranges: Plausible, low: float, high: float) -> int:
    """0 where values reach the range that is not unusual, 2 where they are impossible, 1 otherwise."""
    if high > ranges.hard[1] or low < ranges.hard[0]:
        return 2
    return int(low > ranges.unusual[1] or high < ranges.unusual[0])


def _specific_force(law: LawFit, runs: Runs | None) -> Range | None:
    """Specific cutting force at the fitted rows, N/mm2, of a force, power or torque; None where it does not follow."""
    if any(law.units.get(name) != role_unit(name) for name in (law.response, *law.factors)):
        return None
    for factor, powers in _AREA.get((law.response, _chip_of(runs)), ()):
        area = _product_of(law, runs, powers)
        if area is not None:
            kc = factor * law.fitted / area
            return (float(np.nanmin(kc)), float(np.nanmax(kc))) if np.isfinite(kc).any() else None
    return None


def _product_of(law: LawFit, runs: Runs | None, powers: Mapping[str, float]) -> Array | None:
    """The product of conditions to these powers at the fitted rows; None where one of them is not known."""
    product = np.ones(law.nobs)
    for name, power in powers.items():
        values = _of_rows(law, runs, name)
        if values is None:
            return None
        product = product * values**power
    return product


def _of_rows(law: LawFit, runs: Runs | None, name: str) -> Array | float | None:
    """A condition at the fitted rows: a factor, another column, or a constant; the diameter is that of the tool."""
    names = ("Dc", "D") if name == "D" else (name,)
    for one in names:
        if one in law.factors:
            return law.X[:, law.factors.index(one)]
        known = runs is not None and one in runs.data and runs.units.get(one) == role_unit(one)
        if known and runs is not None and np.isin(law.lines, runs.lines).all():
            order = np.argsort(runs.lines)
            at = order[np.searchsorted(runs.lines, law.lines, sorter=order)]
            return runs.values(one)[at]
        if runs is not None and one in runs.constants:
            return runs.constants[one]
    return None


def _chip_of(runs: Runs | None) -> str:
    """Process by which the area of the chip is computed: turning where none is known, unless columns are of milling."""
    if runs is None:
        return "turning"
    milling = any(map(runs.has, ("ae", "fz", "z")))
    return runs.process or ("milling" if milling else "turning")


# Response and process -> kc in N/mm2 = factor x response / product of powers of conditions
_AREA: Mapping[tuple[str, str], tuple[tuple[float, Mapping[str, int]], ...]] = {
    ("Fc", "turning"): ((1.0, {"f": 1, "d": 1}),),
    ("P", "turning"): ((6e4, {"V": 1, "f": 1, "d": 1}),),
    ("P", "milling"): (
        (6e7, {"d": 1, "ae": 1, "fm": 1}),
        (6e4 * np.pi, {"d": 1, "ae": 1, "f": 1, "V": 1, "D": -1}),
    ),
    ("M", "milling"): ((2e3 * np.pi, {"d": 1, "ae": 1, "f": 1}),),
    ("P", "drilling"): ((2.4e5, {"V": 1, "f": 1, "D": 1}),),
    ("M", "drilling"): ((8e3, {"f": 1, "D": 2}),),
}


def _of_kc(response: str, kc: Range | None) -> Iterator[Found]:
    """A specific cutting force that is unusual or impossible."""
    if kc is None:
        return
    middle = float(np.sqrt(max(kc[0], 0.0) * max(kc[1], 0.0)))
    if KC_UNUSUAL[0] <= middle <= KC_UNUSUAL[1]:
        return
    span = _plain(f"{kc[0]:.2g} to {kc[1]:.2g} N/mm2")
    words = f"{response} of the law is a specific cutting force kc of {span} (usual {KC_USUAL[0]} to {KC_USUAL[1]})"
    possible = KC_HARD[0] <= middle <= KC_HARD[1]
    yield 2 - int(possible), f"{words}: check the units of {response} and of the conditions."
