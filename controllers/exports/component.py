"""LinuxCNC component: the controller in C with the pins of HAL, compiled by ``halcompile --install fm_control.comp``.

Unlike the HAL export it reads the requested feed, so that the limits hold in the unit of the feed whatever the
program's F and the operator's override are. Its HAL lines stand in its head, marked ``//|``.
"""

from typing import Final

import numpy as np

from ...core.errors import GateError
from ...datasets.units import canonical, convert, is_unit, same_dimension
from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.names import c_text
from ..gate import GatedControl
from .c_source import TITLES, c_controller, c_head
from .fmu import MODEL, ControlSource, Variable
from .hal import SERVO_PERIOD, load_origin

NOT_IN_COMPONENT = (
    "the wiring of the load, the spindle, the heartbeat and the switches: they belong to the machine",
    "the laws and their covariance, the posterior and the dynamics",
    "rapids: with M52 P1 they are slowed too; write M52 P0 before them and M52 P1 after",
)

_HAL = """\
loadrt {component}
{made}# >>> net fm-load <= YOUR-LOAD-PIN            float, {load}: {origin}
# >>> net fm-spindle-on <= spindle.0.on       bit: the spindle turns; where that pin has a signal, use its name below
{beat}# >>> net fm-operator <= halui.feed-override.value   [HAL] HALUI = halui in the ini file
net fm-load => {pins}.load
net fm-spindle-on => {pins}.spindle-on
net fm-idle => {pins}.idle
net fm-heartbeat => {pins}.heartbeat
# Where one of these two pins of motion has a signal, write its name for fm-requested or fm-velocity.
net fm-requested motion.requested-vel => {pins}.requested-vel
net fm-velocity motion.current-vel => {pins}.current-vel
net fm-operator => {pins}.operator-override
# {feed} per machine unit and s: {mm} on a machine in mm, {inch} on a machine in inches (LINEAR_UNITS in the ini file).
# Without a value above 0 the component goes to fault when armed; with that of the other unit the feed is 25 times off.
# >>> setp {pins}.feed-scale {scale}
newsig fm-enable bit
sets fm-enable FALSE
net fm-enable => {pins}.enable
newsig fm-reset bit
sets fm-reset FALSE
net fm-reset => {pins}.reset
net fm-feed {pins}.adaptive-feed => motion.adaptive-feed
net fm-inhibit {pins}.feed-inhibit => motion.feed-inhibit
net fm-fault {pins}.fault
net fm-worn {pins}.worn
net fm-overload {pins}.overload
addf {pins} {thread}
"""

_BEAT = "# >>> net fm-heartbeat <= YOUR-HEARTBEAT-PIN  bit: changes with every new reading, at least every {:.6g} s\n"

_PINS = """\
component fm_control "{title}: the controller of one tool.";
description "See the head of the source file for nets, states and limits.";
pin in float load "{load}";
pin in bit enable;
pin in bit spindle_on "The spindle turns.";
pin in float current_vel = -1 "motion.current-vel, machine units per s. Not connected: the loop stays open.";
pin in bit idle "The path does not advance, besides a current-vel near 0.";
pin in bit heartbeat "Changes with every new reading of the load.";
pin in bit reset "A rising edge clears fault, overload and worn unless their cause is present.";
pin in float requested_vel = -1 "motion.requested-vel, machine units per s. Not connected it is negative: a fault.";
pin in float operator_override = 1 "halui.feed-override.value.";
pin out float adaptive_feed = {low!r} "To motion.adaptive-feed.";
pin out bit feed_inhibit "To motion.feed-inhibit.";
pin out bit fault "Latched: see cause.";
pin out bit worn "Latched: change the tool.";
pin out bit overload "Latched: mean load above what a worn tool withstands.";
pin out signed state "0 off, 1 air, 2 entry, 3 control, 4 worn, 5 fault.";
pin out signed cause "Of the fault: 1 load lost, 2 stuck, 3 no heartbeat, 4 requested-vel or feed-scale, 5 period.";
pin out float measured "Filtered load, {load}.";
pin out float requested "Requested feed as the component has it, {feed}: compare it with F of the program.";
pin out float override "Feed over programmed feed.";
param rw float feed_scale = 0 "{feed} per machine unit and s: see the HAL lines. Not above 0: a fault.";
option singleton yes;
option extra_setup yes;
option no_convenience_defines yes;
function _ fp;
license "BSD-3-Clause";
;;
"""

_FUNCTIONS = """
#define FEED_LOW (load_settings.low * load_settings.feed_programmed)
#define STILL 0.01 /* of the lower feed limit: a path that is slower does not advance */
#define FULL 0.999 /* an override of the operator below slows the feed; 1 after steps of it is not exact */
#define FOLLOWS 0.95 /* of the commanded feed: a slower path is in a corner, accelerates or is at its own limit */

static LoadState fm_state;

static int extra_setup(struct __comp_state *__comp_inst, char *prefix, long extra_arg)
{
    const int wrong = load_control_init(&load_settings, &fm_state);
    (void)__comp_inst; (void)extra_arg;
    if (wrong == 0) return 0;
    rtapi_print_msg(RTAPI_MSG_ERR, "%s: setting %d of load_settings is out of range; export the file again\\n",
                    prefix, wrong);
    return -EINVAL;
}

/* FUNCTION(_): an override of the operator below 1 slows the feed further, and the loop does not compensate it: while
 * the feed is slowed, by the operator or the path, it does not rise. NaN: slowed. */
static void _(struct __comp_state *__comp_inst, long period)
{
    const double operator_ = *__comp_inst->operator_override;
    const double scale = __comp_inst->feed_scale;
    LoadInput in;
    LoadOutput out;
    in.period = (double)period * 1e-9;
    in.load = *__comp_inst->load;
    in.requested = scale > 0.0 ? *__comp_inst->requested_vel * scale * (operator_ < 1.0 ? 1.0 : operator_) : -1.0;
    in.enable = *__comp_inst->enable;
    in.spindle_on = *__comp_inst->spindle_on;
    in.idle = *__comp_inst->idle || !(*__comp_inst->current_vel * scale >= STILL * FEED_LOW);
    in.slowed = !(operator_ >= FULL)
        || !(*__comp_inst->current_vel * scale >= FOLLOWS * in.requested * *__comp_inst->adaptive_feed);
    in.beat = *__comp_inst->heartbeat;
    in.reset = *__comp_inst->reset;
    load_control_step(&load_settings, &fm_state, &in, &out);
    *__comp_inst->adaptive_feed = out.feed_override;
    *__comp_inst->feed_inhibit = out.feed_inhibit != 0;
    *__comp_inst->fault = out.fault != 0;
    *__comp_inst->worn = out.worn != 0;
    *__comp_inst->overload = out.overload != 0;
    *__comp_inst->state = (int)out.state;
    *__comp_inst->cause = (int)out.cause;
    *__comp_inst->measured = out.measured;
    *__comp_inst->requested = in.requested;
    *__comp_inst->override = out.u;
}
"""


def component_file(control: GatedControl) -> str:
    """Content of ``fm_control.comp``.

    Raises
    ------
    GateError
        The feed is not a velocity, so that it cannot be compared with the requested one.
    """
    loop = control.loop
    head = (
        *c_head(control, NOT_IN_COMPONENT),
        "The program commands M52 P1 before cuts and M52 P0 before rapids; an F below the upper limit is not raised.",
        *_installation(MODEL),
    )
    names = {"load": c_text(loop.unit_load), "feed": c_text(loop.unit_feed), "low": loop.low}
    names["title"] = TITLES[loop.law].capitalize()
    lines = "".join(f"//| {line}\n" for line in hal_lines(loop).splitlines())
    title = "".join(f"// {c_text(line)}\n" for line in head)
    return f"{title}{lines}{_PINS.format(**names)}{c_controller(loop)}{_FUNCTIONS}"


def _installation(component: str) -> tuple[str, ...]:
    return (
        f"Compile with halcompile --install {component}.comp; the file has the name of the component.",
        "Load the HAL lines that follow after the HAL files of the machine, without their first 4 characters.",
    )


def hal_lines(loop: LoadLoop) -> str:
    """HAL lines that load the component, connect it and add it to a thread.

    What the user writes or confirms is marked ``>>>``: pins, and the unit of the feed per machine unit and s.
    """
    period = round(loop.sample_time * 1e9)
    servo = loop.sample_time <= SERVO_PERIOD
    mm, inch = _feed_scales(loop)
    made = f"# SERVO_PERIOD of the machine's ini file: {period}\n"
    return _HAL.format(
        component=MODEL, pins=MODEL.replace("_", "-"), load=c_text(loop.unit_load), origin=load_origin(loop.unit_load),
        beat=_BEAT.format(loop.heartbeat) if loop.heartbeat else "",
        made=made if servo else f"loadrt threads name1=fm-thread period1={period} fp1=1\n",
        thread="servo-thread" if servo else "fm-thread", feed=c_text(loop.unit_feed), mm=mm, inch=inch,
        scale=inch if (canonical(loop.unit_feed) or "").startswith("in") else mm,
    )  # fmt: skip


def _feed_scales(loop: LoadLoop) -> tuple[str, str]:
    """Units of the feed in one mm/s and in one inch/s, for a machine in mm and one in inches."""
    unit = loop.unit_feed
    if not (is_unit(unit) and same_dimension(unit, "mm/s")):
        raise GateError(
            f"the feed limits are in {unit}, but LinuxCNC's requested velocity is in machine units per s; give the "
            "feed limits in mm/min, or use the hal export."
        )
    mm, inch = convert(np.array([1.0, 25.4]), "mm/s", unit).tolist()
    return f"{mm:.12g}", f"{inch:.12g}"


_STEP = """
static {prefix}State fm_state;

static int extra_setup(struct __comp_state *__comp_inst, char *prefix, long extra_arg)
{{
    {prefix}State *x = &fm_state;
    const int wrong = {init};
    (void)__comp_inst; (void)extra_arg;
    if (wrong == 0) return 0;
    rtapi_print_msg(RTAPI_MSG_ERR, "%s: setting %d is out of range; export the file again\\n", prefix, wrong);
    return -EINVAL;
}}

/* FUNCTION(_) */
static void _(struct __comp_state *__comp_inst, long period)
{{
    {prefix}State *x = &fm_state;
    {prefix}Input input, *in = &input;
    {prefix}Output output, *out = &output;
    in->period = (double)period * 1e-9;
{inputs}    {step};
{outputs}}}
"""
_TYPES: Final = {"Real": "float", "Boolean": "bit", "Integer": "signed"}


def component_of(
    source: ControlSource, variables: tuple[Variable, ...], head: tuple[str, ...], hal: str, title: str
) -> str:
    """A component whose pins are the inputs and outputs of a controller in C; ``hal`` are its HAL lines."""
    pins, inputs, outputs = "", "", ""
    for v in variables:
        side = "in" if v.causality == "input" else "out"
        start = {"false": "0", "true": "1"}.get(v.start, v.start)
        unit = f", {v.unit}" if v.unit else ""
        pins += f'pin {side} {_TYPES[v.kind]} {v.name} = {start} "{c_text(v.words + unit)}.";\n'
        if side == "in":
            inputs += f"    in->{v.name} = *__comp_inst->{v.name};\n"
        else:
            outputs += f"    *__comp_inst->{v.name} = out->{v.name}{' != 0' if v.kind == 'Boolean' else ''};\n"
    lines = "".join(f"//| {line}\n" for line in hal.splitlines())
    options = "".join(f"option {name} yes;\n" for name in ("singleton", "extra_setup", "no_convenience_defines"))
    code = _STEP.format(prefix=source.prefix, init=source.init, step=source.step, inputs=inputs, outputs=outputs)
    return (
        "".join(f"// {c_text(line)}\n" for line in (*head, *_installation(source.model)))
        + lines
        + f'component {source.model} "{title}";\n'
        'description "See the head of the source file for pins, causes and limits.";\n'
        f'{pins}{options}function _ fp;\nlicense "BSD-3-Clause";\n;;\n{source.text}{code}'
    )
