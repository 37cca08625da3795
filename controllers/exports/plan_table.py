"""The plan of AC-2017 as a running control: a table of speed and feed over the time in the cut of an edge.

``plan_table.c`` and ``plan_table.st`` evaluate it; the LinuxCNC component and the FMU contain that C. Rows, limits and
wear are those of `fitmodels.controllers.recursion.plan`, which the replay runs.
"""

from dataclasses import dataclass, field
from functools import partial
from math import isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ...core.errors import GateError, UsageError
from ...parameters.exports.view import ExportView, require_check, view_of_laws
from ..recursion.from_file import require_checked, require_near_tests
from ..recursion.laws import feed_within_limits, held_by_moves, machine_range, response_at_end
from ..recursion.life import no_pair
from ..recursion.plan import Plan, diameter_of, plan_of
from .c_source import c_comment, head_lines, with_settings
from .component import component_of
from .fmu import ControlSource, Variable, fmu_archive
from .st import function_block, real, st_list
from .turning_program import TurningRequest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

SAMPLE_TIME: Final = 0.02  # s
WEAR_TOLERANCE: Final = 0.05  # share of the expected wear
DIAMETER_RATE: Final = 1000.0  # mm/s: rapid traverse of 30 m/min in X
SPIN_UP: Final = 2.0  # s from rest to the highest spindle speed
NOT_IN_PLAN: Final = (
    "the optimisation: measured wear above the plan moves to a later row, it does not compute new pairs",
    "the time in the cut through a power cut: keep elapsed_min where it is not negative, and return it by set_elapsed",
    "the wiring: cutting, diameter, spindle and feed belong to the machine",
    "the laws and their covariance, the posterior and the dynamics",
)
NOT_IN_PLAN_ST: Final = ("the period of the task: set it to SAMPLE_TIME, all times scale with it", *NOT_IN_PLAN)
CAUSES: Final = (
    "0 none, 1 elapsed time unknown, 2 period, 3 diameter out of its range or jumped, 4 measured wear (negative, none, "
    "above ten times the criterion, below half of the last or, after row 1, 0.6 of the plan), 5 new edge or elapsed "
    "time set in the cut, or no valid elapsed time"
)
_LIMIT = 1e-9  # of a limit


@dataclass(frozen=True, slots=True)
class ExportJob:
    """Choices of one export besides its format.

    ``accept_verdict`` exports parts that must not be used for control all the same; ``draws`` are those of the file, by
    response; ``seed`` is that of random draws; ``turning`` is the plan, and the part of an NC program. Of a plan as a
    control: the range of diameters of the work, mm, and the highest spindle speed, 1/min, 0 for that of the file.
    ``sample_time`` is the period of the calls, s, 0 for the usual one. ``depth`` is that of the set point of adaptive
    force control, in the unit of its section; None for that of the smallest force.
    """

    accept_verdict: bool = False
    draws: "Mapping[str, Draws]" = field(default_factory=dict)
    seed: int = 1
    turning: TurningRequest = field(default_factory=TurningRequest)
    diameter: tuple[float, float] | None = None
    max_rpm: float = 0.0
    sample_time: float = 0.0
    depth: float | None = None


@dataclass(frozen=True, slots=True)
class PlanControl:
    """A plan that may be exported: rows and settings of ``plan_table.c``, with what the file says of it.

    Attributes
    ----------
    view : ExportView
    plan : Plan
    settings : dict
        Of ``PlanSettings``, in its order.
    rows : tuple of (end s, V m/min, f mm/rev, wear)
    words : tuple of str
        Lines on caps, diameter, rows and assumptions.
    """

    view: ExportView
    plan: Plan
    settings: "dict[str, float | int]"
    rows: tuple[tuple[float, float, float, float], ...]
    words: tuple[str, ...]


def plan_control(pf: "ParameterFile", job: ExportJob) -> PlanControl:
    """The plan of a file as a control.

    Raises
    ------
    GateError
        The file fails its check, a law of the plan must not be used for control, the plan does not apply a limit, or a
        row is not reached within the caps of spindle speed or feed rate without breaking a limit.
    UsageError
        The file cannot drive the recursion, or the diameter is not known.
    """
    require_check(pf)
    plan = plan_of(pf, job.draws, job.turning.options, job.seed)
    if not plan.rows:
        raise GateError(f"not exported: {no_pair(plan.life, plan.extrapolated)}")
    laws = plan.laws
    sentences = require_checked(pf, laws, job.accept_verdict)
    sentences = (*sentences, *require_near_tests(pf, [laws], plan.life.path, job.turning.beyond_tests))
    view = view_of_laws(pf, (laws.wear.response, *(terms.response for _, terms in laws.limited)), job.accept_verdict)
    low, high = _diameters(pf, job, plan)
    caps, words = _caps(pf, job, plan, low, high)
    _need_reached(plan, caps, low, high)
    slowest, unknown = _slowest(plan, caps, low, high)
    rows = tuple((60 * row.end, row.V, row.f, row.wear) for row in plan.rows)
    settings: dict[str, float | int] = {
        "sample_time": period_of(job),
        "wear_most": laws.wear.most,
        "wear_exponent": laws.wear.t,
        "wear_tolerance": WEAR_TOLERANCE,
        "diameter_low": low,
        "diameter_high": high,
        "diameter_rate": DIAMETER_RATE,
        "spindle_high": caps[1],
        "feed_rate_high": caps[2],
        "spindle_rise": caps[1] / SPIN_UP,
        "feed_programmed": max(row.f for row in plan.rows),
        "feed_unknown": unknown,
        "overrun": 60 * plan.life.rules.interval,
        "rows": len(rows),
        "slowest": slowest,
        "wear_state": int(plan.life.rules.wear == "wear_state"),
    }
    return PlanControl(view, plan, settings, rows, (*sentences, *_about(plan, settings), *words))


def period_of(job: ExportJob) -> float:
    """Period of the calls, s; UsageError above a second."""
    if job.sample_time > 1:
        raise UsageError(f"a period of {job.sample_time:g} s: give at most 1 s, for instance --period 20ms.")
    return job.sample_time or SAMPLE_TIME


def _diameters(pf: "ParameterFile", job: ExportJob, plan: Plan) -> tuple[float, float]:
    """Range of diameters, mm: of the job, or the one diameter of options or costs."""
    if job.diameter is not None:
        low, high = job.diameter
        if not 0 < low <= high < 1e5:
            raise UsageError(f"diameter {low:g} to {high:g} mm: give a range above zero, the smaller first.")
        return float(low), float(high)
    one = diameter_of(pf, plan.options)
    if one is None:
        raise UsageError(
            "the diameter of the work is not known, so neither is the spindle speed; give the range of a diameter that "
            "is measured, --diameter 40mm:80mm, or one that holds, --diameter 60mm."
        )
    return one, one


def _caps(
    pf: "ParameterFile", job: ExportJob, plan: Plan, low: float, high: float
) -> tuple[tuple[float, float, float], tuple[str, ...]]:
    """Lowest and highest spindle speed, 1/min, and highest feed rate, mm/min, with their origin."""
    limits, speed, feed = pf.limits, plan.laws.V[1], plan.laws.f[1]
    least, most = machine_range(None if limits is None else limits.spindle_speed, "1/min")
    fastest = machine_range(None if limits is None else limits.feed_rate, "mm/min")[1]
    given, words = min(most, job.max_rpm or most), []
    if isfinite(given):
        words.append(f"spindle speed at most {given:.6g} 1/min, of {'the export' if given < most else 'the file'}")
    else:
        given = 1000 * speed / (pi * low)
        words.append(
            f"assumed: spindle speed at most {given:.6g} 1/min, that of {speed:g} m/min at {low:g} mm: the file limits "
            "it not; give the machine's with fitmodels limits params.json n=50:2500rev/min"
        )
    if isfinite(fastest):
        words.append(f"feed rate at most {fastest:.6g} mm/min, of the file")
    else:
        fastest = feed * given
        words.append(f"assumed: feed rate at most {fastest:.6g} mm/min, that of {feed:g} mm/rev at that speed")
    if least > 0:
        slow = 1000 * min(row.V for row in plan.rows) / (pi * high)
        if slow < least * (1 - _LIMIT):
            raise GateError(
                f"not exported: a row of the plan turns at {slow:.4g} 1/min at {high:g} mm, below the machine's "
                f"{least:g} 1/min. Give a smaller largest diameter with --diameter."
            )
    return (least, given, fastest), tuple(words)


def _need_reached(plan: Plan, caps: tuple[float, float, float], low: float, high: float) -> None:
    """Raise where the cap of the spindle holds V so low at a small diameter that a limit breaks."""
    laws, life = plan.laws, plan.life
    for row in plan.rows:
        n = min(1000 * row.V / (pi * low), caps[1])
        V, f = pi * low * n / 1000, min(row.f, caps[2] / n)
        for name, terms in laws.limited:
            found = float(response_at_end(terms, life.rules, V, f, row.end, row.wear))
            if found > terms.most * (1 + 1e-6):
                raise GateError(
                    f"not exported: at {low:g} mm the spindle reaches {caps[1]:.6g} 1/min, {V:.4g} m/min instead of "
                    f"{row.V:g}, and {name} becomes {found:.4g} {terms.unit}, above {terms.most:g}. Give a larger "
                    f"smallest diameter with --diameter, up to {high:g} mm."
                )


def _slowest(plan: Plan, caps: tuple[float, float, float], low: float, high: float) -> tuple[int, float]:
    """Row of the least removal rate that keeps power and force at the end of the plan, from 1, at every diameter.

    With it its feed while the diameter is not known, so that the speed may be that of the smallest at the spindle speed
    of the largest; 0 where no tested feed keeps the limits there.
    """
    laws, rules, last = plan.laws, plan.life.rules, plan.rows[-1]
    feed = partial(feed_within_limits, laws, rules, end=last.end, AW=last.wear)
    reached = pi * low * caps[1] / 1000  # m/min
    kept = [
        (row.V * row.f, k)
        for k, row in enumerate(plan.rows, 1)
        if all(feed(V, row.f) >= row.f for V in (row.V, min(row.V, reached)))
    ]
    k = min(kept)[1] if kept else len(plan.rows)
    found = feed(min(plan.rows[k - 1].V * low / high, reached), plan.rows[k - 1].f)
    return k, found if found >= laws.f[0] * (1 - _LIMIT) else 0.0


def _about(plan: Plan, settings: "Mapping[str, float | int]") -> tuple[str, ...]:
    laws, low, high = plan.laws, settings["diameter_low"], settings["diameter_high"]
    wear, slow = laws.wear, plan.rows[int(settings["slowest"]) - 1]
    diameter = f"diameter {low:g} mm, constant: the input is not read" if low == high else (
        f"diameter {low:g} to {high:g} mm, measured at the edge; outside it, or with a jump, a fault"
    )  # fmt: skip
    return (
        f"{len(plan.rows)} rows to {plan.minutes:g} min in the cut, {plan.removed / 1000:.4g} cm3, depth {laws.d:g} "
        f"mm, {wear.response} at most {wear.most:g} {wear.unit}",
        *(f"EXTRAPOLATED: {words.removeprefix('EXTRAPOLATED: ')}" for words in plan.extrapolated),
        *_ends_early(plan),
        "row 1 holds from the start of a new edge; after the last row worn is latched until new_edge",
        f"after power on, in a fault and when worn: {slow.V:g} m/min and {slow.f:g} mm/rev, the slowest row that keeps "
        f"the limits at the end of the plan; after {settings['overrun']:g} s in the cut with a worn or unknown edge "
        "feed_inhibit",
        *_of_unknown(settings, slow.V),
        f"feed_override is 1 at {settings['feed_programmed']:g} mm/rev: the program runs G95 with that F",
        diameter,
        "not detected - a cut that is reported as none, a diameter in its range that is wrong or stands still",
        f"assumed: the spindle accelerates by {settings['spindle_rise']:.6g} 1/min in 1 s; feed_rate waits for it",
        f"assumed: measured wear up to {100 * WEAR_TOLERANCE:g} % above the plan has no effect",
        *(f"assumed: {words}" for words in held_by_moves(plan.assumed)),
    )


def _of_unknown(settings: "Mapping[str, float | int]", V: float) -> tuple[str, ...]:
    low, high, f = (settings[name] for name in ("diameter_low", "diameter_high", "feed_unknown"))
    if low == high:
        return ()
    held = f"with {f:.4g} mm/rev at most" if f else "where no tested feed keeps the limits: the feed stops"
    return (f"fault of the diameter: spindle speed of {high:g} mm, {V * low / high:.4g} m/min at {low:g} mm, {held}",)


def _ends_early(plan: Plan) -> tuple[str, ...]:
    if plan.chance is None:
        return ()
    early = f"of new edges drawn from the laws {100 * plan.chance.ends_early:.0f} % are worn out before the plan ends"
    return (early, *plan.chance.exceeding)


def plan_notes(pf: "ParameterFile", control: PlanControl) -> tuple[str, ...]:
    """Lines on the control for the person who exports it."""
    view = control.view
    return (*view.origin[1:-1], *control.words, *(f"assumed: {words}" for words in view.assumed))


def _head(control: PlanControl, what: str, not_carried: tuple[str, ...], cycle: str) -> tuple[str, ...]:
    view = control.view
    words = (cycle, *control.words, f"causes of a fault: {CAUSES}", *view.remarks(not_carried))
    return head_lines(view, f"plan of speed and feed over the life of an edge, {what}", words)


def plan_c(control: PlanControl) -> str:
    """The C source with rows and settings as ``plan_settings``."""
    cycle = f"one call each {control.settings['sample_time']:g} s, with the measured period"
    return c_comment(_head(control, "in C", NOT_IN_PLAN, cycle)) + plan_source(control)


def plan_source(control: PlanControl) -> str:
    """``plan_table.c`` with rows and settings."""
    rows = "".join(f"    {{{', '.join(f'(PlanReal){v!r}' for v in row)}}},\n" for row in control.rows)
    values = {k: v for k, v in control.settings.items() if k != "rows"}
    lines = [f"    {f'(PlanReal){v!r}' if isinstance(v, float) else v}, /* {name} */\n" for name, v in values.items()]
    table = f"    plan_rows, {control.settings['rows']},\n"
    lines.insert(list(values).index("slowest"), table)
    return with_settings(
        "plan_table.c",
        "extern const PlanSettings plan_settings;\n",
        "/* 0, or the number of the first setting",
        f"static const PlanRow plan_rows[] = {{ /* end s, V m/min, f mm/rev, wear */\n{rows}}};\n\n"
        f"const PlanSettings plan_settings = {{\n{''.join(lines)}}};\n",
    )


def _variables(control: PlanControl) -> tuple[Variable, ...]:
    """Inputs and outputs by the names of ``PlanInput`` and ``PlanOutput``."""
    s, unit, out = control.settings, control.plan.laws.wear.unit, "output"
    fixed = s["diameter_low"] == s["diameter_high"]
    return (
        Variable("diameter", "input", "Real", 0, "diameter at the edge" + (", not read" if fixed else ""),
                 repr(float(s["diameter_high"])) if fixed else "0.0", "mm"),
        Variable("wear", "input", "Real", 1, "measured wear, 0 none or not new", "0.0", unit),
        Variable("elapsed", "input", "Real", 2, "time in the cut of this edge, read when set_elapsed rises", "0.0",
                 "min"),
        Variable("cutting", "input", "Boolean", 0, "the tool is in the cut: not connected the time counts", "true"),
        Variable("new_edge", "input", "Boolean", 1, "its rising edge out of the cut: time 0", "false"),
        Variable("set_elapsed", "input", "Boolean", 2, "its rising edge out of the cut: the time is elapsed", "false"),
        Variable("reset", "input", "Boolean", 3, "its rising edge clears a fault whose cause is gone", "false"),
        Variable("spindle_speed", out, "Real", 10, "spindle speed", "0.0", "rev/min"),
        Variable("cutting_speed", out, "Real", 11, "cutting speed of that spindle speed", "0.0", "m/min"),
        Variable("feed", out, "Real", 12, "feed per revolution", "0.0", "mm/rev"),
        Variable("feed_rate", out, "Real", 13, "feed rate", "0.0", "mm/min"),
        Variable("feed_override", out, "Real", 14, "feed over programmed feed", "0.0", "1"),
        Variable("elapsed_min", out, "Real", 15, "time in the cut, negative where not known", "-1.0", "min"),
        Variable("wear_expected", out, "Real", 16, "wear that the plan expects now", "0.0", unit),
        Variable("row", out, "Integer", 0, "row in force, 1 the first", "0"),
        Variable("cause", out, "Integer", 1, CAUSES, "0"),
        Variable("worn", out, "Boolean", 10, "latched: change the edge", "false"),
        Variable("fault", out, "Boolean", 11, "latched: see cause", "false"),
        Variable("limited", out, "Boolean", 12, "spindle speed or feed at its cap", "false"),
        Variable("feed_inhibit", out, "Boolean", 13, "stop the feed", "false"),
    )  # fmt: skip


def _source(control: PlanControl, text: str) -> ControlSource:
    return ControlSource(
        "fm_plan", text, "Plan", "plan_table_init(&plan_settings, x)",
        "plan_table_step(&plan_settings, x, in, out)", "plan_settings.sample_time",
        float(control.settings["sample_time"]),
    )  # fmt: skip


def plan_fmu(control: PlanControl) -> bytes:
    """The FMU."""
    cycle = f"one step each {control.settings['sample_time']:g} s"
    about = "; ".join(_head(control, "FMU", NOT_IN_PLAN, cycle))
    return fmu_archive(
        control.view, _source(control, plan_c(control)), _variables(control), about, key=plan_source(control)
    )


_HAL = """\
loadrt fm_plan
# >>> net fm-cutting <= YOUR-CUTTING-PIN      bit: the tool is in the cut, for instance by load or by motion-type
# >>> net fm-diameter <= YOUR-DIAMETER-PIN    float, mm: twice the position of X at the edge; not a programmed value
net fm-cutting => fm-plan.cutting
net fm-diameter => fm-plan.diameter
newsig fm-new-edge bit
sets fm-new-edge FALSE
net fm-new-edge => fm-plan.new-edge
newsig fm-plan-reset bit
sets fm-plan-reset FALSE
net fm-plan-reset => fm-plan.reset
# >>> the drive of the spindle takes fm-speed, in rev/min, in place of spindle.0.speed-out
net fm-speed fm-plan.spindle-speed
net fm-feed fm-plan.feed-override => motion.adaptive-feed
net fm-inhibit fm-plan.feed-inhibit => motion.feed-inhibit
net fm-worn fm-plan.worn
net fm-fault fm-plan.fault
addf fm-plan servo-thread
"""


def plan_component(control: PlanControl) -> str:
    """Content of ``fm_plan.comp``."""
    head = (
        *_head(control, "LinuxCNC component", NOT_IN_PLAN, "in a thread of any period up to 1 s"),
        f"the program runs G95 F{control.settings['feed_programmed']:g} and M52 P1, and M52 P0 before rapids",
    )
    title = "Plan of speed and feed over the life of an edge."
    return component_of(_source(control, plan_source(control)), _variables(control), head, _HAL, title)


def plan_st(control: PlanControl) -> str:
    """Content of the file with the function block."""
    s = control.settings
    powers = (
        [wear ** (1 / s["wear_exponent"]) for *_, wear in control.rows]
        if s["wear_state"]
        else [end ** s["wear_exponent"] for end, *_ in control.rows]
    )
    columns = dict(zip(("ROW_END", "ROW_V", "ROW_F", "ROW_WEAR"), zip(*control.rows, strict=True), strict=True))
    tables = "".join(
        f"  {name} : ARRAY[1..{s['rows']}] OF LREAL := [{st_list(values)}];\n"
        for name, values in {**columns, "ROW_POWER": powers}.items()
    )
    constants = "".join(f"  {k.upper()} : LREAL := {real(v)};\n" for k, v in s.items() if isinstance(v, float))
    constants += f"  LAST_ROW : DINT := {s['rows']};\n  SLOWEST : DINT := {s['slowest']};\n"
    constants += f"  DIAMETER_READ : BOOL := {str(s['diameter_low'] < s['diameter_high']).upper()};\n"
    constants += f"  WEAR_STATE : BOOL := {str(bool(s['wear_state'])).upper()};\n"
    head = _head(control, "structured text", NOT_IN_PLAN_ST, f"call once every {s['sample_time']:g} s")
    first, wear, rest = Path(__file__).with_name("plan_table.st").read_text("ascii").split("(* expected wear *)\n")
    statements = first + wear + rest + wear
    return function_block(f"PLAN_{control.view.name}", head, _variables(control), constants + tables, statements)
