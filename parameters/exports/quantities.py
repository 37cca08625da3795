"""All exported numbers of the file, each under a safe name, with unit and description."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from ...core.formula import Term
from ..file import ParameterFile
from ..sections.base import Section
from ..sections.law_fields import LawFields
from .loop import LoadLoop
from .names import plain, plain_unit, safe_name


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number of the file under a name that is valid in every format.

    Attributes
    ----------
    name : str
        Lower-case letters, digits and underscores; begins with a letter; unlike every other name of the view.
    value : float
        Finite.
    unit : str
        ASCII as ``mm/min``, ``um``, ``A``; ``1`` for a pure number.
    words : str
        What it is: ASCII letters, digits, spaces and ``. _ + -``, one line.
    """

    name: str
    value: float
    unit: str
    words: str


Found = Iterator[tuple[str, float, str, str]]
_OF_LOOP = {
    "kp": ("({f})/{l}", "proportional gain, form {form}"),
    "ki": ("({f})/{l}/s", "integral gain, form {form}"),
    "sample_time": ("s", "period of the loop"),
    "reference": ("{l}", "load that the loop holds"),
    "feed_low": ("{f}", "lower feed limit"),
    "feed_high": ("{f}", "upper feed limit"),
    "feed_programmed": ("{f}", "programmed feed, override 1"),
    "filter_time": ("s", "time constant of the load filter, 0 none"),
    "average": ("1", "samples of the moving average, 1 none"),
    "engage_at": ("{l}", "load at which a cut is known"),
    "hysteresis": ("{l}", "width of the threshold"),
    "engage_after": ("s", "time above the threshold before the loop takes over"),
    "entry_gain": ("1/{l}", "change of the first override per load below the reference at entry"),
    "back_off": ("1/s", "fastest fall of the override"),
    "recover": ("1/s", "fastest rise of the override"),
    "load_low": ("{l}", "a load at or below is no reading"),
    "load_high": ("{l}", "a load at or above is no reading"),
    "arm_after": ("s", "time that the spindle runs before the load is monitored"),
    "lost_after": ("s", "time with invalid readings before a fault"),
    "stuck_after": ("s", "time of equal readings in the cut before a fault, 0 not monitored"),
    "heartbeat": ("s", "time without a change of the heartbeat before a fault, 0 not monitored"),
    "overload_at": ("{l}", "mean load that inhibits the feed"),
    "overload_after": ("s", "time above it before the feed is inhibited"),
    "dwell": ("s", "time on the lower limit that means a worn tool"),
}
_SECTIONS = ("drive", "limits", "roughness", "adaptive_force")
_UNIT_OF = {
    **dict.fromkeys(("sample_time", "servo_time", "reference_time"), "s"),
    **dict.fromkeys(("average_time", "threshold_time", "process_time"), "s"),
    **dict.fromkeys(("force", "threshold", "force_low", "force_high"), "unit_force"),
    **dict.fromkeys(("feed", "chip_thickness"), "unit_feed"),
    **dict.fromkeys(("low", "high"), "unit_u"),
    "roughness": "unit_roughness",
    "force_per_feed": "unit_force/(unit_feed)",
    "lam": "1/s",
    "m": "s^2 (unit_u)/unit_force",
    "alpha": "s (unit_u)/unit_force",
    "beta": "(unit_u)/unit_force",
    "Kd": "s (unit_u)/unit_force",
    "g3": "(unit_u)/unit_force^3",
    "g2": "s^2 (unit_u)/unit_force^3",
    "g1": "s^4 (unit_u)/unit_force^3",
    "spindle_speed": "1/min",
    "M": "unit_inertia",
    "Fv": "unit_viscous",
    **dict.fromkeys(("Fc", "offset"), "unit_force"),
    "cutoff": "Hz",
    **dict.fromkeys(("simulated_fit", "held_out_fit"), "%"),
    **dict.fromkeys(("depth", "nose_radius"), "unit_depth"),
}


def file_quantities(pf: ParameterFile, loop: LoadLoop | None) -> tuple[Quantity, ...]:
    """The numbers of a file in a fixed order: the loop, the load line, dynamics, laws, limits, the rest."""
    found = [*_of_loop(loop), *_of_load_line(pf), *_of_dynamics(pf), *_of_pi(pf), *_of_laws(pf), *_of_sections(pf)]
    taken: set[str] = set()
    out = []
    for name, value, unit, words in found:
        safe = _unlike(safe_name(name), taken)
        out.append(Quantity(safe, float(value), plain_unit(unit), plain(words)))
    return tuple(out)


def _unlike(name: str, taken: set[str]) -> str:
    """The name, with a number appended where it is taken."""
    number, free = 2, name
    while free in taken:
        free, number = f"{name}_{number}", number + 1
    taken.add(free)
    return free


def _of_loop(loop: LoadLoop | None) -> Found:
    if loop is None:
        return
    units = {"f": loop.unit_feed, "l": loop.unit_load}
    for name, (unit, words) in _OF_LOOP.items():
        yield name, getattr(loop, name), unit.format(**units), words.format(form=loop.form)


def _of_load_line(pf: ParameterFile) -> Found:
    line = pf.load_line
    if line is None:
        return
    yield "worn_load", line.worn, line.unit_load, "largest load that a worn tool withstands without chipping"
    yield "safety_factor", line.safety_factor, "1", "reference over worn load, before rounding"
    yield "wear_low", line.window[0], line.unit_wear, "wear from which the tool may be changed"
    yield "wear_high", line.window[1], line.unit_wear, "wear by which the tool must be changed"


def _of_dynamics(pf: ParameterFile) -> Found:
    model = pf.dynamics
    if model is None:
        return
    yield "dynamics_sample_time", model.sample_time, "s", "sample time of the model"
    gain = f"{model.unit_y or '1'}/({model.unit_u})" if model.unit_u else model.unit_y
    for j, value in enumerate(model.b):
        yield f"dynamics_b{j}", value, gain, f"numerator, coefficient of z-{j}"
    for j, value in enumerate(model.a):
        yield f"dynamics_a{j}", value, "1", f"denominator, coefficient of z-{j}"


def _of_pi(pf: ParameterFile) -> Found:
    pi = pf.pi
    if pi is None:
        return
    gain = f"({pi.unit_u or '1'})/({pi.unit_y or '1'})"
    yield "pi_kp", pi.kp, gain, f"kp as tuned, form {pi.form}"
    yield "pi_ki", pi.ki, f"{gain}/s", f"ki as tuned, form {pi.form}, {pi.integration} sum"
    yield "pi_sample_time", pi.sample_time, "s", "sample time the gains were tuned for"
    yield "pi_delay", pi.delay, "1", "samples from measurement to command in force"
    yield "pi_filter_time", pi.filter_time, "s", "low-pass of the measurement, 0 for none"
    yield "pi_average", pi.average, "1", f"samples of the moving average of the {pi.average_of}, 1 for none"
    yield "pi_setpoint_weight", pi.setpoint_weight, "1", "share of the reference in the proportional part"
    unit, windup = pi.unit_u or "1", f"anti-windup {pi.anti_windup}"
    limits = (
        ("low", pi.low, unit, f"lowest command, {windup}"),
        ("high", pi.high, unit, f"highest command, {windup}"),
        ("rate", pi.rate, f"{unit}/s", f"largest change of the command, {windup}"),
        ("tracking_time", pi.tracking_time, "s", f"of the {windup}"),
    )
    yield from ((f"pi_{name}", value, unit, words) for name, value, unit, words in limits if value is not None)


def _of_laws(pf: ParameterFile) -> Found:
    for symbol, law in pf.laws.items():
        units = (law.unit, *(_unit_of_slope(law, term) for term in law.formula.all_terms))
        of_term = (f"{law.form} law of {symbol}, coefficient of {_term_words(law, t)}" for t in law.formula.terms)
        words = (f"{law.form} law of {symbol}, {law.coefficient_names[0]}", *of_term)
        for k, (name, unit) in enumerate(zip(law.coefficient_names, units, strict=True)):
            text = words[k] if law.terms else f"{law.form} law of {symbol}, {name}"
            yield f"law_{symbol}_{_plain_term(name)}", law.coefficients[name], unit, text
        for level, shift in (law.by.shifts if law.by else {}).items():
            of, unit = (f"ln {symbol}", "1") if law.logarithmic else (symbol, law.unit)
            of_levels = "" if law.by is None else f"{law.by.column} {level} against {law.by.reference}"
            yield f"law_{symbol}_shift_{level}", shift, unit, f"shift of {of} of {of_levels}"
        for factor in law.factors:
            if factor.symbol in law.centres:
                words_of = f"{symbol} law, centre of {factor.symbol} in its terms"
                yield f"law_{symbol}_{factor.symbol}_centre", law.centres[factor.symbol], factor.unit, words_of
        for factor in law.factors:
            yield f"law_{symbol}_{factor.symbol}_low", factor.low, factor.unit, f"{symbol} was tested from here"
            yield f"law_{symbol}_{factor.symbol}_high", factor.high, factor.unit, f"{symbol} was tested to here"


def _plain_term(name: str) -> str:
    """Name of a coefficient without signs: ``V_squared``, ``V_times_f``.

    >>> _plain_term("V^2"), _plain_term("V*f")
    ('V_squared', 'V_times_f')
    """
    return name.replace("^2", "_squared").replace("*", "_times_")


def _term_words(law: LawFields, term: Term) -> str:
    """A term of second order in words, as a program computes it: ``ln(V/120) times ln(f/0.2)``."""
    of_each = zip(law.factors, law.formula.logs, term.degrees, strict=True)
    shown = []
    for factor, log, degree in of_each:
        centre = f"{factor.symbol} centre"
        shown += [f"ln of {factor.symbol} over {centre}" if log else f"{factor.symbol} less {centre}"] * degree
    return " times ".join(shown)


def _unit_of_slope(law: LawFields, term: Term) -> str:
    """Unit of the coefficient of a term: that of the response, or 1, over that of its factors."""
    of_each = zip(law.factors, law.formula.logs, term.degrees, strict=True)
    units = [f"{f.unit}^{d}" if d > 1 else f.unit for f, log, d in of_each if d and f.unit and not log]
    unit = " ".join(units)
    if not unit:
        return "1" if law.logarithmic else law.unit
    return f"1/({unit})" if law.logarithmic else f"({law.unit})/({unit})"


def _of_sections(pf: ParameterFile) -> Found:
    for name in _SECTIONS:
        section = getattr(pf, name, None)
        if section is not None:
            yield from _of_section(name, section)


def _of_section(prefix: str, section: Section, above: Section | None = None) -> Found:
    """Numbers of a section, and of the sections in it, whose units may stand in the one above."""
    for name in type(section).model_fields:
        value = getattr(section, name)
        for key, item in _items(f"{prefix}_{name}", value):
            if isinstance(item, int | float) and not isinstance(item, bool):
                yield key, float(item), _unit(section, name, above), key.replace("_", " ")
            elif isinstance(item, Section):
                yield from _of_section(key, item, section)


def _items(key: str, value: object) -> Iterable[tuple[str, object]]:
    if isinstance(value, Mapping):
        return [(f"{key}_{name}", item) for name, item in value.items()]
    if isinstance(value, tuple):
        return [(f"{key}_{place}", item) for place, item in enumerate(value)]
    return [(key, value)]


def _unit(section: Section, name: str, above: Section | None = None) -> str:
    """Unit of a field: that of its section, or that of the field, which may stand in the section above."""
    unit = str(getattr(section, "unit", None) or _UNIT_OF.get(name, "1"))
    return re.sub(r"unit_\w+", lambda m: str(getattr(section, m[0], getattr(above, m[0], m[0]))), unit)
