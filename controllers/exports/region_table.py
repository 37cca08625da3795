"""The region of AC-2016 as a running control: limits that are linear in the logarithms of the pair and of its state.

``region_check.c`` and ``region_check.st`` evaluate them; the LinuxCNC component and the FMU contain that C. The limits
are those of `fitmodels.controllers.visible_region`, with depth, time, wear and diameter left open.
"""

from dataclasses import dataclass
from math import log, pi
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from ...core.arrays import Array
from ...core.errors import GateError, UsageError
from ...parameters.exports.names import c_text
from ...parameters.exports.view import ExportView, require_check, view_of_laws
from ..recursion.laws import machine_range
from ..region.limits import NO_RESPONSE_LIMIT, box, limited, merged, required_wear_law
from ..region.log_planes import USUAL, CutSetting, plane, ratio
from .c_source import c_comment, head_lines, with_settings
from .component import component_of
from .fmu import ControlSource, Variable, fmu_archive
from .plan_table import DIAMETER_RATE, ExportJob, period_of
from .st import function_block, real, st_list

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.load_line import LimitsSection

ANY: Final = (1e-6, 1e6)  # range of a factor that no law has
FACTORS: Final = ("V", "f", "d", "t", "D")
NOT_IN_REGION: Final = (
    "the choice of a better pair: it states how far this one must be lowered, and never raises it",
    "the time in the cut: the machine counts it for this edge, and gives 0 for a new one",
    "the wiring: speed, feed before the override, depth, time and diameter belong to the machine",
    "the uncertainty of the laws: leave a margin to the limits, see the probabilities of fitmodels replay",
)
NOT_IN_REGION_ST: Final = ("the period of the task: set it to SAMPLE_TIME", *NOT_IN_REGION)
CAUSES: Final = (
    "0 none, 1 V or f, 2 time, 3 depth, 4 diameter out of its range or jumped, 5 measured wear (negative, no number, "
    "above ten times the criterion, below 0.6 of its law), 6 period"
)
_WEAR: Final = (
    "a measured wear counts beside its law and can only tighten the limits; 0 is none. No number, a negative one, one "
    "above ten times the criterion and, in the tested ranges, one below 0.6 of the wear that the law expects after the "
    "pairs cut so far are a fault, latched",
)


@dataclass(frozen=True, slots=True)
class RegionRow:
    """A limit: ``constant + by . ln(V, f, d, t, D) + by_wear ln(wear)`` is above 0 where it is exceeded."""

    name: str
    constant: float
    by: tuple[float, ...]
    by_wear: float = 0.0


@dataclass(frozen=True, slots=True)
class RegionControl:
    """Limits that may be exported: the rows of ``region_check.c``, with what the file says of them.

    Attributes
    ----------
    view : ExportView
    rows : tuple of RegionRow
        In the order of ``VisibleRegion.limits``.
    wear : RegionRow
        Logarithm of the wear by its law; zero without one.
    wear_unit, wear_most
        A measured wear above ten times this is a fault.
    tested : dict
        Range of each factor: tested, of the diameter that of the work.
    sample_time : float
        s.
    words : tuple of str
        Lines on limits, ranges and assumptions.
    """

    view: ExportView
    rows: tuple[RegionRow, ...]
    wear: RegionRow
    wear_unit: str
    wear_most: float
    tested: dict[str, tuple[float, float]]
    sample_time: float
    words: tuple[str, ...]

    @property
    def diameter_read(self) -> bool:
        """Whether a limit has the diameter."""
        return any(row.by[4] for row in self.rows)

    @property
    def wear_read(self) -> bool:
        """Whether a limit has the wear."""
        return any(row.by_wear for row in self.rows)

    @property
    def listed(self) -> tuple[str, ...]:
        """The limits with their numbers."""
        return tuple(f"limit {k}: {row.name}" for k, row in enumerate(self.rows, 1))


def region_lacks(pf: "ParameterFile") -> str:
    """Reason why a file has no region to export; empty where it has one."""
    limits = pf.limits
    if limits is None or not limits.on_responses:
        return NO_RESPONSE_LIMIT
    try:
        _limits(pf, limits, None, {})
    except (UsageError, GateError) as error:
        return str(error)
    return ""


def region_control(pf: "ParameterFile", job: ExportJob) -> RegionControl:
    """The limits of a file as a control.

    Raises
    ------
    GateError
        The file fails its check, or a law must not be used for control.
    UsageError
        There is no limit of a response, a law is no power law, or a factor or the diameter is not known.
    """
    require_check(pf)
    limits, options = merged(pf, None), job.turning.options
    at = {name: value for name, value in options.at.items() if name != "D"}
    if not limits.on_responses:
        raise GateError(f"not exported: {NO_RESPONSE_LIMIT}")
    diameter = _diameter(limits, job)
    rows, wear, used = _limits(pf, limits, options.by, at)
    machine = box(pf, limits)
    tested = _tested([pf.laws[name] for name in used], diameter)
    unit = "" if wear is None else wear.unit
    return RegionControl(
        view=view_of_laws(pf, used, job.accept_verdict),
        rows=(*rows, *(RegionRow(side.words, -side.b, (*side.a, 0.0, 0.0, 0.0)) for side in machine.sides)),
        wear=_wear_row(wear, options.by, at),
        wear_unit=unit,
        wear_most=_wear_most(limits, wear),
        tested=tested,
        sample_time=period_of(job),
        words=(*_about(rows, tested, diameter, machine.notes), *(f"{name} fixed at {v:g}" for name, v in at.items())),
    )  # fmt: skip


def _wear_most(limits: "LimitsSection", wear: "LawSection | None") -> float:
    """The criterion, or else a millimetre, in the unit of the law of wear."""
    value, unit = (1.0, "mm") if limits.wear is None else (limits.wear.value, limits.wear.unit)
    return value * (1.0 if wear is None else ratio(unit, wear.unit))


def _diameter(limits: "LimitsSection", job: ExportJob) -> tuple[float, float]:
    """Range of diameters, mm; needed where spindle speed or feed rate is limited."""
    at = job.turning.options.at.get("D")
    if job.diameter is None and at is None:
        if limits.spindle_speed is None and limits.feed_rate is None:
            return 1.0, 1.0
        raise UsageError(
            "the file limits the spindle speed or the feed rate, which needs the diameter of the work: give the range "
            "of a diameter that is measured, --diameter 40mm:80mm, or one that holds, --diameter 60mm."
        )
    low, high = job.diameter or (float(at or 0), float(at or 0))
    if not 0 < low <= high < 1e5:
        raise UsageError(f"diameter {low:g} to {high:g} mm: give a range above zero, the smaller first.")
    return low, high


def _limits(
    pf: "ParameterFile",
    limits: "LimitsSection",
    by: str | None,
    at: dict[str, float],
) -> "tuple[list[RegionRow], LawSection | None, tuple[str, ...]]":
    """Rows of the responses and of the spindle, the law of wear, and the responses of the laws in use."""
    named = None if limits.wear is None else limits.wear.of
    setting, bounds = CutSetting(1.0, 1.0, by, at), limited(pf, limits)
    wear = required_wear_law(pf, setting, named)
    rows, used = [], dict[str, None]()
    for bound in bounds:
        law, sign = pf.laws[bound.symbol], 1.0 if bound.side == "most" else -1.0
        used[bound.symbol] = None
        allowed = log(bound.value * ratio(bound.unit, law.unit))
        name = f"{bound.symbol} at {bound.side} {bound.value:g} {bound.unit}"
        if wear is not None and bound.symbol == wear.response:
            rows.append(RegionRow(name, -sign * allowed, (0.0,) * 5, sign))
            continue
        made = _row(law, setting, wear)
        if made.by_wear and wear is not None:
            used[wear.response] = None
        scaled = tuple(sign * value for value in made.by)
        rows.append(RegionRow(name, sign * (made.constant - allowed), scaled, sign * made.by_wear))
    return [*rows, *_of_spindle(limits)], wear if wear is not None and wear.response in used else None, tuple(used)


def _row(law: "LawSection", setting: CutSetting, wear: "LawSection | None") -> RegionRow:
    """Logarithm of a response by V, f, d, t and wear, at d 1 mm and t 1 min in the constant."""
    over = plane(law, setting, wear)
    power = law.coefficients.get("d", 0.0)
    by = (float(over.slopes[0]), float(over.slopes[1]), float(power), float(over.t_power), 0.0)
    return RegionRow(law.response, float(over.intercept), by, float(over.wear_power))


def _wear_row(wear: "LawSection | None", by: str | None, at: dict[str, float]) -> RegionRow:
    return RegionRow("wear", 0.0, (0.0,) * 5) if wear is None else _row(wear, CutSetting(1.0, 1.0, by, at), None)


def _of_spindle(limits: "LimitsSection") -> list[RegionRow]:
    """Limits of n = 1000 V / (pi D) and of fm = f n."""
    rows, ln = [], log(1000 / pi)
    for symbol, given, unit, f in (
        ("n", limits.spindle_speed, "1/min", 0.0), ("fm", limits.feed_rate, "mm/min", 1.0)
    ):  # fmt: skip
        if given is None:
            continue
        low, high = machine_range(given, unit)
        rows.append(RegionRow(f"{symbol} at most {high:g} {unit}", ln - log(high), (1.0, f, 0.0, 0.0, -1.0)))
        if low > 0:
            rows.append(RegionRow(f"{symbol} at least {low:g} {unit}", log(low) - ln, (-1.0, -f, 0.0, 0.0, 1.0)))
    return rows


def _tested(laws: "list[LawSection]", diameter: tuple[float, float]) -> dict[str, tuple[float, float]]:
    """The range of each factor that all laws in use share; any of one that none has."""
    found = {}
    for symbol in ("V", "f", "d", "t"):
        held = [(f, ratio(f.unit, USUAL[symbol])) for law in laws for f in law.factors if f.symbol == symbol]
        if not held:
            found[symbol] = ANY
            continue
        low, high = max(f.low * k for f, k in held), min(f.high * k for f, k in held)
        if low > high:
            low, high = high, low
        found[symbol] = (max(low, 1e-3 * high), high)
    return {**found, "D": diameter}


def _about(
    rows: list[RegionRow], tested: dict[str, tuple[float, float]], diameter: tuple[float, float], notes: tuple[str, ...]
) -> tuple[str, ...]:
    spans = ", ".join(
        f"{name} {low:.4g} to {high:.4g} {USUAL[name]}"
        for name, (low, high) in tested.items()
        if name in USUAL and (low, high) != ANY
    )
    of = (f"diameter {diameter[0]:g} to {diameter[1]:g} mm",) if any(row.by[4] for row in rows) else ()
    return (
        f"tested ranges that all laws share: {spans}; beyond them the laws are extrapolated and tested is 0",
        "tested is of each factor by itself: it does not check whether their combination or the wear lies in the "
        "tested region of the laws, as fitmodels predict and replay do; where it is 1 a pair may be extrapolated",
        *of,
        "feed_override is the largest factor of the feed before it, at most 1, that keeps every limit; 0 where none "
        "does: the feed is then inhibited until the speed is changed",
        "an invalid time, depth or diameter is a fault, latched: it counts as the worse end of its range",
        *(_WEAR if any(row.by_wear for row in rows) else ()),
        "not detected - a speed, feed, depth, time or diameter in its range that is wrong or stands still",
        *notes,
    )


def region_notes(pf: "ParameterFile", control: RegionControl) -> tuple[str, ...]:
    """Lines on the control for the person who exports it."""
    view = control.view
    return (*view.origin[1:-1], *control.listed, *control.words, *(f"assumed: {words}" for words in view.assumed))


def _head(control: RegionControl, what: str, not_carried: tuple[str, ...], cycle: str) -> tuple[str, ...]:
    view = control.view
    words = (cycle, *control.listed, *control.words, f"causes of a fault: {CAUSES}", *view.remarks(not_carried))
    return head_lines(view, f"limits on speed and feed, {what}", words)


def region_c(control: RegionControl) -> str:
    """The C source with the limits as ``region_settings``."""
    cycle = f"one call each {control.sample_time:g} s, with the measured period"
    return c_comment(_head(control, "in C", NOT_IN_REGION, cycle)) + region_source(control)


def _limit_c(row: RegionRow) -> str:
    by = ", ".join(f"(RegionReal){value + 0.0!r}" for value in row.by)
    return f"{{(RegionReal){row.constant!r}, {{{by}}}, (RegionReal){row.by_wear + 0.0!r}}}"


def region_source(control: RegionControl) -> str:
    """``region_check.c`` with the limits."""
    rows = "".join(f"    {_limit_c(row)}, /* {k} {c_text(row.name)} */\n" for k, row in enumerate(control.rows, 1))
    ranges = ", ".join(f"{{(RegionReal){low!r}, (RegionReal){high!r}}}" for low, high in control.tested.values())
    settings = (
        f"    (RegionReal){control.sample_time!r}, (RegionReal){control.wear_most!r}, (RegionReal){DIAMETER_RATE!r},\n"
        f"    {_limit_c(control.wear)}, /* ln of the wear */\n    {{{ranges}}}, /* {', '.join(FACTORS)} */\n"
        f"    region_limits, {len(control.rows)}, {int(control.diameter_read)}, {int(control.wear_read)},\n"
    )
    return with_settings(
        "region_check.c",
        "extern const RegionSettings region_settings;\n",
        "/* 0, or the number of the first setting",
        f"static const RegionLimit region_limits[] = {{\n    /* constant, by ln({', '.join(FACTORS)}), by wear */\n"
        f"{rows}}};\n\nconst RegionSettings region_settings = {{\n{settings}}};\n",
    )


def _variables(control: RegionControl) -> tuple[Variable, ...]:
    """Inputs and outputs by the names of ``RegionInput`` and ``RegionOutput``."""
    unit, out, timed = control.wear_unit, "output", control.tested["t"] != ANY
    of_wear = "can only tighten; 0 by its law alone" if control.wear_read else "not read"
    return (
        Variable("V", "input", "Real", 0, "cutting speed", "0.0", "m/min"),
        Variable("f", "input", "Real", 1, "feed before the override", "0.0", "mm/rev"),
        Variable("d", "input", "Real", 2, "depth of cut", "0.0", "mm"),
        Variable("t", "input", "Real", 3, "time in the cut of this edge" + (", not connected a fault" if timed else ""),
                 "-1.0" if timed else "0.0", "min"),
        Variable("wear", "input", "Real", 4, f"measured wear, {of_wear}", "0.0", unit),
        Variable("diameter", "input", "Real", 5, "diameter at the edge", "0.0", "mm"),
        Variable("reset", "input", "Boolean", 0, "its rising edge clears a fault whose cause is gone", "false"),
        Variable("excess", out, "Real", 10, "of the binding limit, logarithm of response over limit", "0.0", "1"),
        Variable("use", out, "Real", 11, "of the binding limit, response over limit", "0.0", "1"),
        Variable("feed_override", out, "Real", 12, "factor of f that keeps every limit", "0.0", "1"),
        Variable("speed_override", out, "Real", 13, "factor of V that keeps every limit", "0.0", "1"),
        Variable("binding", out, "Integer", 0, "number of the binding limit", "0"),
        Variable("cause", out, "Integer", 1, CAUSES, "0"),
        Variable("within", out, "Boolean", 10, "every limit is kept", "false"),
        Variable("tested", out, "Boolean", 11, "V, f, d, t lie each in its tested range, not all combined", "false"),
        Variable("fault", out, "Boolean", 12, "latched: see cause", "true"),
        Variable("feed_inhibit", out, "Boolean", 13, "stop the feed", "true"),
    )  # fmt: skip


def _source(control: RegionControl, text: str) -> ControlSource:
    return ControlSource(
        "fm_region", text, "Region", "region_check_init(&region_settings, x)",
        "region_check_step(&region_settings, x, in, out)", "region_settings.sample_time", control.sample_time,
    )  # fmt: skip


def region_fmu(control: RegionControl) -> bytes:
    """The FMU."""
    about = "; ".join(_head(control, "FMU", NOT_IN_REGION, f"one step each {control.sample_time:g} s"))
    key = region_source(control)
    return fmu_archive(control.view, _source(control, region_c(control)), _variables(control), about, key=key)


_HAL = """\
loadrt fm_region
# >>> net fm-v <= YOUR-PIN, float: cutting speed, m/min;  net fm-f: feed before the override, mm/rev
# >>> net fm-d: depth of cut, mm;  net fm-t: time in the cut of this edge, min;  net fm-dia: diameter at the edge, mm
net fm-v => fm-region.V
net fm-f => fm-region.f
net fm-d => fm-region.d
net fm-t => fm-region.t
net fm-dia => fm-region.diameter
newsig fm-region-reset bit
sets fm-region-reset FALSE
net fm-region-reset => fm-region.reset
net fm-region-feed fm-region.feed-override => motion.adaptive-feed
net fm-region-inhibit fm-region.feed-inhibit => motion.feed-inhibit
addf fm-region servo-thread
"""


def region_component(control: RegionControl) -> str:
    """Content of ``fm_region.comp``."""
    head = (
        *_head(control, "LinuxCNC component", NOT_IN_REGION, "in a thread of any period up to 1 s"),
        "the program runs M52 P1, and M52 P0 before rapids",
    )
    title = "Limits on cutting speed and feed."
    return component_of(_source(control, region_source(control)), _variables(control), head, _HAL, title)


def region_st(control: RegionControl) -> str:
    """Content of the file with the function block."""
    count, wear = len(control.rows), control.wear
    table: Array = np.array([[row.constant, *row.by, row.by_wear] for row in control.rows]) + 0.0
    names = ("CONSTANT_OF", "BY_V", "BY_F", "BY_D", "BY_T", "BY_DIAMETER", "BY_WEAR")
    lines = [
        f"  {name} : ARRAY[1..{count}] OF LREAL := [{st_list(column)}];\n"
        for name, column in zip(names, table.T.tolist(), strict=True)
    ]
    values = {f"WEAR_{name}": value for name, value in zip(("V", "F", "D", "T"), wear.by, strict=False)}
    values |= {"WEAR_CONSTANT": wear.constant, "WEAR_MOST": control.wear_most, "SAMPLE_TIME": control.sample_time}
    values["DIAMETER_RATE"] = DIAMETER_RATE
    for name, (low, high) in control.tested.items():
        word = "DIAMETER" if name == "D" else name.upper()
        values |= {f"{word}_LOW": low, f"{word}_HIGH": high}
        values |= {} if name in ("V", "f") else {f"LN_{word}_LOW": log(low), f"LN_{word}_HIGH": log(high)}
    lines += [f"  {name} : LREAL := {real(value + 0.0)};\n" for name, value in values.items()]
    lines.append(f"  LIMITS : DINT := {count};\n  DIAMETER_READ : BOOL := {str(control.diameter_read).upper()};\n")
    lines.append(f"  WEAR_READ : BOOL := {str(control.wear_read).upper()};\n")
    head = _head(control, "structured text", NOT_IN_REGION_ST, f"call once every {control.sample_time:g} s")
    statements = Path(__file__).with_name("region_check.st").read_text("ascii")
    return function_block(f"REGION_{control.view.name}", head, _variables(control), "".join(lines), statements)
