"""Checks of single values: covariances, posterior, dynamics, units, and settings in order."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...core.text import shortened
from ...datasets.units import is_unit, same_dimension, suggest
from ...datasets.vocabulary import ROLES, fits
from ..file import ParameterFile
from ..messages import in_unit, short
from ..sections.base import Covariance, ModelCovariance, covariance_error
from ..sections.force_control import AdaptiveForceSection
from ..sections.law import LawSection
from ..sections.law_parts import ToolLifeSection
from ..sections.load_line import Engagement, FeedLimit, LimitInterval, LoadLineSection
from ..sections.posterior import LawPosterior
from ..setting_words import feeds_far_beyond_tests, no_overload
from .gains import check_dynamics
from .report import FileFinding

# Vehtari et al. 2021, doi 10.1214/20-BA1221, section 4.1; Vehtari et al. 2024, Pareto smoothed importance sampling
R_HAT, ESS, K_HAT = 1.01, 400.0, 0.7
SUMMED = 1e-6  # relative: a scatter is that of the sums of the rows
LIFE_AGREES = 1e-4  # relative: a tool life is solved from its law
EXACT = 1e-6  # scatter of a law of exact data: rounding
SMEARED = 10.0  # times the variance of the scatter: mean factors of exp(residual) reach half of it


def check_estimates(pf: ParameterFile) -> Iterator[FileFinding]:
    """Findings on covariances, on the posterior and on the dynamics."""
    yield from _covariances(pf)
    yield from _scatters(pf)
    if pf.tool_life is not None:
        yield from _taylor(pf, pf.tool_life)
    if pf.posterior is not None:
        for name, law in pf.posterior.laws.items():
            if law.reason is None:
                yield _gate(shortened(name), law)
    if pf.dynamics is not None:
        yield from check_dynamics(pf.dynamics)


def _covariances(pf: ParameterFile) -> Iterator[FileFinding]:
    held = [
        (f"laws.{shortened(name)}", law.uncertainty.matrix)
        for name, law in pf.laws.items()
        if isinstance(law.uncertainty, Covariance)
    ]
    for name, section in (("dynamics", pf.dynamics), ("drive", pf.drive), ("adaptive_force", pf.adaptive_force)):
        if section is not None and isinstance(section.uncertainty, ModelCovariance):
            held.append((name, section.uncertainty.matrix))
    for where, matrix in held:
        size = len(matrix)
        why = covariance_error(np.array(matrix, dtype=np.float64).reshape(size, size))
        words = f"{where}: {why}." if why else f"{where}: the covariance is positive semi-definite."
        yield FileFinding("covariance", why is None, words)


def _scatters(pf: ParameterFile) -> Iterator[FileFinding]:
    """Findings on the scatter of a power law that is not that of its sums, and on a mean factor that is not of it."""
    for name, law in pf.laws.items():
        if law.form != "power" or law.error != "multiplicative" or law.by is not None or not law.residual_se:
            continue
        if wrong := _off_sums(law, law.residual_se) or _off_smearing(law, law.residual_se):
            yield FileFinding("law", False, f"laws.{shortened(name)}: {wrong}; restore the file or fit again.")


def _off_smearing(law: LawSection, scatter: float) -> str:
    if law.smearing is None or 1 - SUMMED <= law.smearing <= np.exp(min(SMEARED * scatter**2, 700.0)) + SUMMED:
        return ""
    return f"its mean is {law.smearing:.4g} times its median, which a scatter of {scatter:.4g} does not give"


def _off_sums(law: LawSection, scatter: float) -> str:
    names = {law.response, *(factor.symbol for factor in law.factors)}
    if law.sums is None or set(law.sums.columns) != names or law.df < 1 or not law.coefficients["c0"] > 0:
        return ""
    c = [-np.log(law.coefficients["c0"]), *(-law.coefficients.get(name, -1.0) for name in law.sums.columns)]
    found = float(np.sqrt(law.sums.squares(np.array(c)) / law.df))
    if abs(found - scatter) <= SUMMED * (found + EXACT):
        return ""
    return f"its coefficients and sums give a scatter of {found:.6g}, not {scatter:.6g}"


def _taylor(pf: ParameterFile, life: ToolLifeSection) -> Iterator[FileFinding]:
    """Findings on Taylor's n against the exponent of V, and on the longest test against the law of the wear."""
    n, b = life.taylor_n, life.coefficients.get("V", 0.0)
    if n is not None and abs(n * b + 1) > LIFE_AGREES:
        words = f"tool_life: its exponent of V, {b:.4g}, is not that of Taylor's n, {n:.4g}; restore the file."
        yield FileFinding("tool life", False, words)
    factors = pf.laws[life.wear].factors if life.wear in pf.laws else ()
    for longest in [in_unit(one.high, one.unit, life.unit) for one in factors if one.symbol == "t"]:
        if longest is not None and life.t_observed > longest * (1 + LIFE_AGREES):
            words = (
                f"tool_life: its longest test, {life.t_observed:.4g} {life.unit}, is longer than those of the law of "
            )
            yield FileFinding("tool life", False, f"{words}{shortened(life.wear)}, {longest:.4g}; restore the file.")


def _gate(name: str, law: LawPosterior) -> FileFinding:
    failed = []
    if law.r_hat is not None and law.r_hat > R_HAT:
        failed.append(f"R-hat {law.r_hat:.4g} is above {R_HAT:g}")
    if law.ess is None or law.ess < ESS:
        failed.append(f"{'no' if law.ess is None else format(law.ess, '.4g')} effective draws, fewer than {ESS:g}")
    if law.k_hat is not None and law.k_hat > K_HAT:
        failed.append(f"k-hat {law.k_hat:.3g} is above {K_HAT:g}")
    if failed:
        return FileFinding("posterior", False, f"posterior.{name}: {'; '.join(failed)}; draw again.")
    return FileFinding("posterior", True, f"posterior.{name}: the convergence checks pass.")


KINDS = {  # of each limit: a unit of its dimension
    "power": "kW", "force": "N", "wear": "mm", "feed": "mm/rev", "feed_rate": "mm/min", "speed": "m/min",
    "spindle_speed": "1/min",
}  # fmt: skip
# field of a section -> quantity, and a unit of its dimension where that is known
SECTION_UNITS: Mapping[str, Mapping[str, tuple[str, str | None]]] = {
    "tool_life": {"unit": ("", "min"), "unit_of_wear": ("wear", "mm")},
    "load_line": {"unit_feed": ("feed", "mm/min"), "unit_wear": ("wear", "mm")},
    "roughness": {"unit_roughness": ("", "um"), "unit_force": ("force", "N"), "unit_feed": ("feed", "mm/rev")},
    "adaptive_force": {"unit_force": ("force", "N"), "unit_depth": ("depth", "mm"), "unit_u": ("command", None)},
    "dynamics": {"unit_u": ("input", None), "unit_y": ("output", None)},
    "drive": {"unit_u": ("input", None), "unit_y": ("output", None)},
    "pi": {"unit_u": ("command", None), "unit_y": ("measurement", None)},
}


class Stated(NamedTuple):
    """A unit in the file: its place, the unit, and a unit of the required dimension where that is known."""

    where: str
    unit: str
    kind: str | None


def check_units(pf: ParameterFile) -> Iterator[FileFinding]:
    """A finding for each unit that is wrong, or one that all are right."""
    stated = [*_of_laws(pf), *_of_sections(pf)]
    problems = [words for item in stated if (words := _problem(item))]
    yield from (FileFinding("units", False, words) for words in problems)
    if stated and not problems:
        yield FileFinding("units", True, f"All {len(stated)} units are known and of the right dimension.")
    unstated = [item.where for item in stated if item.kind is None and not item.unit]
    if unstated:
        yield FileFinding("units", None, f"No unit is stated for {', '.join(unstated)}.")


def _of_laws(pf: ParameterFile) -> Iterator[Stated]:
    for key, law in pf.laws.items():
        yield from _of_law(law, f"laws.{shortened(key)}")


def _of_law(law: LawSection, where: str) -> Iterator[Stated]:
    for symbol, unit in ((law.response, law.unit), *((f.symbol, f.unit) for f in law.factors)):
        place = f"{where} ({shortened(symbol)})"
        if symbol in ROLES and ROLES[symbol].unit:
            yield Stated(place, unit, None if is_unit(unit) and fits(symbol, unit) else ROLES[symbol].unit)
        else:
            yield Stated(place, unit, None)


def _of_sections(pf: ParameterFile) -> Iterator[Stated]:
    yield from _of_limits(pf)
    for name, units in SECTION_UNITS.items():
        if (section := getattr(pf, name)) is not None:
            for field, (quantity, kind) in units.items():
                where = f"{name} ({quantity})" if quantity else name
                yield Stated(where, getattr(section, field), kind)
    if (line := pf.load_line) is not None:
        yield Stated("load_line (load)", line.unit_load, ROLES[line.load].unit if line.load in ROLES else None)
    for sensor in pf.identity.sensors:
        yield Stated(f"identity.sensors ({shortened(sensor.symbol)})", sensor.unit, None)


def _of_limits(pf: ParameterFile) -> Iterator[Stated]:
    if pf.limits is None:
        return
    for name, unit in KINDS.items():
        if (bound := getattr(pf.limits, name)) is not None:
            yield Stated(f"limits.{name}", bound.unit, unit)
    for symbol, ends in pf.limits.responses.items():
        known = ROLES[symbol].unit if symbol in ROLES else getattr(pf.laws.get(symbol), "unit", None)
        yield Stated(f"limits.responses.{shortened(symbol)}", ends.unit, known or None)


def _problem(item: Stated) -> str:
    if not item.unit and item.kind is None:
        return ""
    if not is_unit(item.unit):
        return f"{item.where}: the unit {short(item.unit)} is not known; {suggest(item.unit[:40])}"
    if item.kind is not None and not same_dimension(item.unit, item.kind):
        return f"{item.where}: the unit is {short(item.unit)}, which does not have the dimension of {item.kind}."
    return ""


EXCEEDS = 1 + 1e-9


def check_settings(pf: ParameterFile) -> Iterator[FileFinding]:
    """A finding for each setting that is not in order, and one for each section that is."""
    if (line := pf.load_line) is not None:
        yield from _findings(
            "feed limits", "load_line", [*_feed(line), *_feed_of_machine(pf, line), *_feed_of_tests(pf, line)]
        )
        yield from _findings("window", "load_line", [*_window(line), *_criterion(pf, line)])
        yield from _findings(
            "reference", "load_line", [*_reference(pf, line), *_limit_of_load(pf, line), *_source(pf, line)]
        )
        if line.engagement is not None:
            yield from _findings("engagement", "load_line.engagement", list(_engagement(line.engagement, line)))
    if (rough := pf.roughness) is not None and pf.laws:
        held, words = rough.law in pf.laws, f"roughness: its law, of {shortened(rough.law)}, is"
        yield FileFinding("roughness", held, f"{words} {'' if held else 'not '}in the file.")
    if (force := pf.adaptive_force) is not None:
        yield from _findings("set points", "adaptive_force", list(_set_points(force)))


def _findings(name: str, where: str, problems: list[str]) -> Iterator[FileFinding]:
    yield from (FileFinding(name, False, f"{where}: {words}.") for words in problems)
    if not problems:
        yield FileFinding(name, True, f"{where}: {name} in order.")


def _feed(line: LoadLineSection) -> Iterator[str]:
    low, high = line.lower.value, line.upper.value
    if not low > 0:
        yield f"the lower feed limit is {low:g} {line.unit_feed}; a feed lies above zero"
    if not low < high:
        yield f"the lower feed limit {low:g} is not below the upper, {high:g} {line.unit_feed}"
    for name, limit in (("lower", line.lower), ("upper", line.upper)):
        if not _inside(limit):
            yield f"the {name} feed limit {limit.value:g} lies outside its own interval"


def _inside(limit: FeedLimit) -> bool:
    held = limit.interval
    return not isinstance(held, LimitInterval) or held.low <= limit.value <= held.high


def _feed_of_machine(pf: ParameterFile, line: LoadLineSection) -> Iterator[str]:
    allowed, pi = None if pf.limits is None else pf.limits.feed_rate, pf.pi
    per = None if allowed is None else in_unit(1.0, allowed.unit, line.unit_feed)
    if allowed is not None and per is not None:
        low, high = allowed.low * per, allowed.high * per
        for name, value in (("lower", line.lower.value), ("upper", line.upper.value)):
            if not low <= value <= high:
                yield f"the {name} feed limit {value:g} is outside the machine's {low:g} to {high:g}"
    if pi is not None and pi.unit_u == line.unit_feed and pi.low is not None and pi.low <= 0:
        yield f"the gains may command a feed of {pi.low:g} {line.unit_feed}; a feed lies above zero"


def _feed_of_tests(pf: ParameterFile, line: LoadLineSection) -> Iterator[str]:
    law = pf.laws.get(line.law)
    if law is None or law.form != "load_line" or law.factors[0].unit != line.unit_feed:
        return
    if far := feeds_far_beyond_tests(law, line.lower.value, line.upper.value):
        yield f"{far}; look at the load of a worn tool, {line.worn:g} {line.unit_load}, and at the units"


def _window(line: LoadLineSection) -> Iterator[str]:
    low, high = line.window
    if not low < high:
        yield f"the tool-change window {low:g} to {high:g} {line.unit_wear} has its ends in the wrong order"
    if not low <= line.lower.wear <= high * EXCEEDS:
        yield f"the lower feed limit is for a wear of {line.lower.wear:g} {line.unit_wear}, outside the window"
    if not line.upper.wear < line.lower.wear:
        yield f"the upper feed limit is for more wear than the lower: {line.upper.wear:g} and {line.lower.wear:g}"


def _criterion(pf: ParameterFile, line: LoadLineSection) -> Iterator[str]:
    worn = None if pf.limits is None else pf.limits.wear
    wear = line.lower.wear
    limit = None if worn is None else in_unit(worn.value, worn.unit, line.unit_wear)
    if limit is not None and wear > limit * EXCEEDS:
        yield f"the wear at the lower feed limit, {wear:g} {line.unit_wear}, is above the criterion, {limit:g}"


def _reference(pf: ParameterFile, line: LoadLineSection) -> Iterator[str]:
    unit = line.unit_load
    if words := no_overload(pf.laws.get(line.law), line.worn, line.safety_factor, unit):
        yield words
    if not 0 < line.reference < line.worn:
        limit = f"the load that a worn tool withstands, {line.worn:g} {unit}"
        yield f"the reference {line.reference:g} is not between 0 and {limit}"
        return
    step = line.rounded_to or 0.0
    if step and abs(line.reference / step - round(line.reference / step)) > SUMMED:
        yield f"the reference {line.reference:g} {unit} is not rounded to {step:g}"
    if abs(line.reference - line.safety_factor * line.worn) > step / 2 + 1e-9 * line.worn:
        product = line.safety_factor * line.worn
        yield f"the reference {line.reference:g} is not {line.safety_factor:g} x {line.worn:g} = {product:g} {unit}"


def _limit_of_load(pf: ParameterFile, line: LoadLineSection) -> Iterator[str]:
    low, high = (0.0, np.inf) if pf.limits is None else pf.limits.response_range(line.load, line.unit_load)
    if not low <= line.reference <= high:
        limit = f"the limit of {shortened(line.load)} in the file, {low:g} to {high:g} {line.unit_load}"
        yield f"the reference {line.reference:g} {line.unit_load} is outside {limit}"


def _source(pf: ParameterFile, line: LoadLineSection) -> Iterator[str]:
    if pf.laws and line.law not in pf.laws:
        yield f"the law of {line.law[:40]!r} that the limits come from is not in the file"


def _engagement(e: Engagement, line: LoadLineSection) -> Iterator[str]:
    if e.load_low is not None and e.load_high is not None and not e.load_low < e.load_high:
        yield f"readings from {e.load_low:g} to {e.load_high:g} leave no range"
    at, half = e.engage_at, (e.hysteresis or 0.0) / 2
    if at is not None and not at + half < line.reference:
        yield f"the loop engages at {at + half:g} {line.unit_load}, not below the reference {line.reference:g}"
    if at is not None and e.load_low is not None and not e.load_low < at - half:
        yield f"the loop disengages at {at - half:g}, not above the smallest reading {e.load_low:g}"
    if e.load_high is not None and not e.load_high > line.worn:
        yield f"the largest reading {e.load_high:g} is not above the load that a worn tool withstands, {line.worn:g}"
    if e.feed_programmed is not None and not e.feed_programmed >= line.lower.value:
        yield f"the programmed feed {e.feed_programmed:g} is below the lower feed limit {line.lower.value:g}"


def _set_points(force: AdaptiveForceSection) -> Iterator[str]:
    depths = [point.depth for point in force.set_points]
    if any(a >= b for a, b in pairwise(depths)):
        yield "the set points are not in order of depth, each once"
    if force.low is not None and force.high is not None and not force.low < force.high:
        yield f"the limits of the command are {force.low:g} to {force.high:g}"
    if force.Kd is not None and force.lam is not None and not force.alpha + force.Kd > force.lam * force.m:
        yield "alpha + Kd is not above lambda m, so its Lyapunov function need not decrease"
