"""``fitmodels tune``: PI gains that meet a specification for the dynamics of a parameter file, added to it."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import GateError, UsageError
from .arguments import Parser, parameter_file, seed, traced
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..ident.pi.tuning import TunedPi
    from ..parameters import ParameterFile
    from ..parameters.sections.dynamics import DynamicsSection

SAME = ("overshoot", "undershoot", "ms", "phase_margin", "gain_margin", "travel", "noise_gain")
LIMITS = {"rise": "rise_time", "settle": "settling_time", **{name: name for name in SAME}}
OF_COMMAND = ("low", "high", "rate", "travel", "noise_gain")  # in the unit of the command
CONTROLLER = ("form", "integration", "delay", "filter_time", "average", "low", "high", "rate", "anti_windup",
              "setpoint_weight")  # fmt: skip


def parser() -> Parser:
    """Arguments of ``fitmodels tune``."""
    p = Parser(
        "fitmodels tune",
        "fitmodels tune params.json --rise 2 --settle 4 --overshoot 0.05",
        "Find PI gains that meet a specification for the dynamics of a parameter file, as the controller runs them,\n"
        "and add them to the file, with the probability that the specification holds, given the uncertainty of the\n"
        "dynamics. Times on the unit step of the reference: rise 10-90 %, settling within 2 %.",
        main="--rise --settle --overshoot --ms --probability --nominal --aim --delay --low --high --rate "
        "--scaling --unit --force --quiet --json",
    )
    p.add_argument("file", metavar="PARAMS", help="params.json with dynamics (fitmodels ident)")
    asked = p.add_argument_group("specification")
    asked.add_argument("--rise", type=float, metavar="S", help="rise time at most (default: no limit)")
    asked.add_argument("--settle", type=float, metavar="S", help="settling time at most (default: no limit)")
    asked.add_argument("--overshoot", type=float, metavar="FRACTION", help="at most, as 0.05 or 5%% (default: 0.02)")
    asked.add_argument(
        "--undershoot", type=float, metavar="FRACTION", help="at most, as a fraction (default: no limit)"
    )
    ms = "maximum sensitivity at most; 1.3 is conservative (default: no limit)"
    asked.add_argument("--ms", type=float, metavar="MS", help=ms)
    asked.add_argument("--phase-margin", type=float, metavar="DEG", help="at least (default: no limit)")
    asked.add_argument("--gain-margin", type=float, metavar="FACTOR", help="at least (default: no limit)")
    asked.add_argument(
        "--travel", type=float, metavar="U", help="total variation of the command at most (default: no limit)"
    )
    noise = "rms command per rms sensor noise at most (default: no limit)"
    asked.add_argument("--noise-gain", type=float, metavar="GAIN", help=noise)
    chance = asked.add_mutually_exclusive_group()
    words = "required probability that the specification holds, given the model uncertainty (default: 0.9)"
    chance.add_argument("--probability", type=float, metavar="P", help=words)
    chance.add_argument("--nominal", action="store_true", help="require no probability: gains for the estimate alone")
    asked.add_argument(
        "--aim",
        default="ms",
        metavar="NAME",
        help="criterion minimised among admissible gains (default: ms; iae, travel ...)",
    )
    _controller_options(p)
    p.add_argument("--seed", type=seed, default=1, metavar="N", help="seed of the draws (default: 1)")
    force = "replace existing gains; write gains that miss the specification, marked as such"
    p.add_argument("--force", action="store_true", help=force)
    output_options(p, "print the section as JSON (fitmodels.tune/3)")
    return p


def _controller_options(p: Parser) -> None:
    """Options of the controller that the gains are for."""
    runs = p.add_argument_group("implementation of the controller")
    runs.add_argument("--form", choices=["position", "incremental"], help="of the algorithm (default: position)")
    runs.add_argument(
        "--integration", choices=["backward", "forward", "trapezoidal"], help="of the error (default: backward)"
    )
    runs.add_argument("--delay", type=int, metavar="SAMPLES", help="computational delay (default: 0)")
    runs.add_argument(
        "--filter-time", type=float, metavar="S", help="first-order low-pass of the measurement (default: none)"
    )
    runs.add_argument(
        "--average", type=int, metavar="SAMPLES", help="moving average of the measurement (default: none)"
    )
    runs.add_argument("--low", type=float, metavar="U", help="lowest command (default: none)")
    runs.add_argument("--high", type=float, metavar="U", help="highest command (default: none)")
    runs.add_argument(
        "--rate", type=float, metavar="PER_S", help="largest change of the command per second (default: none)"
    )
    weight = "share of the reference in the proportional part, 0 to 1 (default: 1); less overshoot, the same loop"
    runs.add_argument("--setpoint-weight", type=float, metavar="SHARE", help=weight)
    windup = "of the integral where the command is limited (default: back_calculation)"
    runs.add_argument("--anti-windup", choices=["clamping", "back_calculation", "none"], help=windup)
    scaling = (
        "units of the command per unit of the model's input (default: 1; with --unit, by the load law of the file)"
    )
    runs.add_argument("--scaling", type=float, metavar="U", help=scaling)
    runs.add_argument(
        "--unit",
        metavar="UNIT",
        help="unit of the command, with --scaling or a load law: mm/min (default: of the input)",
    )


def run(args: argparse.Namespace) -> int:
    """Tune, print, write, and return the exit code."""
    from ..cards.folder import PI_FIGURE
    from ..core.progress import progress_bar
    from ..parameters.checks.gains import reference_step
    from ..parameters.checks.record import against_load_law, against_scaling_by_law, record_notes, scaling_by_load_law
    from ..parameters.checks.report import cautions
    from ..parameters.file import picture_folder, replace, sealed
    from ..parameters.gather.control import pi_section

    pf = parameter_file(args.file, writes=True)
    if pf.dynamics is None:
        raise UsageError(
            f"{args.file} has no dynamics; identify them first: fitmodels ident run.csv --params {args.file}."
        )
    if pf.pi is not None and not args.force:
        raise UsageError(f"{args.file} has gains; replace them with --force.")
    derived = _derive_scaling(pf, args)
    if (args.scaling is None) != (args.unit is None):
        raise UsageError("--scaling and --unit: give both; --unit alone needs a load law of the file in that unit.")
    _check_scaling(args)
    _check_limits(pf, args)
    against = against_load_law(pf, args.unit, args.scaling)
    if against and not args.force:
        raise GateError(f"{against} Nothing was written; --force writes gains, marked as not to be used.")
    with progress_bar(lines=False) as step:
        step.say("tuning")
        stops = against or (against_scaling_by_law(pf) if derived else "")
        tuned = _tuned(pf.dynamics, args, stops, reference_step(pf))
    tuned = tuned if args.scaling is None else tuned.in_units(args.unit, args.scaling)
    if tuned.misses and not args.force:
        raise GateError(f"{tuned.words} {_remedy(tuned)}")
    section = pi_section(tuned, scaling_u=args.scaling or 1.0, forced="kept by --force" if tuned.misses else None)
    section["notes"] += derived
    changed = sealed(pf, pi=section, provenance=traced(pf, args.words))
    figure = picture_folder(args.file) / PI_FIGURE
    picture = _picture(tuned, reference_step(pf) or 1.0, simulated=bool(pf.identity.simulated))
    replace(changed, args.file, pf, {PI_FIGURE: picture})
    verdicts = cautions(pf, "dynamics")
    if args.json:
        facts = {"file": Path(args.file).name, "pi": section, "words": tuned.words, "margins": _margins(tuned)}
        print_json("tune", {**facts, "verdicts": verdicts}, version=3)
        return 0
    by_law = scaling_by_load_law(pf, args.unit, args.scaling)
    simulated = [*_simulated(tuned, reference_step(pf) or 1.0), *_beyond_limits(tuned, pf)]
    verdicts += record_notes(pf)
    lines = [*verdicts, *derived, *_sentences(tuned, changed), *simulated, *by_law]
    out = Printer(quiet=args.quiet)
    for line in lines:
        out.show(line)
    out.wrote(f"Figure: {figure}", figure)
    out.wrote(f"Written: pi in {args.file}", args.file)
    return 0


def _tuned(d: "DynamicsSection", args: argparse.Namespace, against: str, step: float | None) -> "TunedPi":
    """Gains for a specification; ``against`` is why they must not be used, or empty; ``step`` that of the reference."""
    from ..core.verdict import DO_NOT_USE, verdict_from
    from ..ident import tune_pi
    from ..parameters.gather.control import model_of

    limits = {name: value for key, name in LIMITS.items() if (value := getattr(args, key)) is not None}
    controller = {name: value for name in CONTROLLER if (value := getattr(args, name)) is not None}
    if args.scaling is not None:
        limits, controller = (
            {name: value / args.scaling if name in OF_COMMAND else value for name, value in options.items()}
            for options in (limits, controller)
        )
    verdict = None if d.verdict is None else d.verdict.verdict
    if against:
        known = () if verdict is None else tuple((verdict.level, words) for words in verdict.reasons)
        verdict = verdict_from([(DO_NOT_USE, against), *known])
    return tune_pi(
        model_of(d), aim=args.aim, probability=args.probability, nominal=args.nominal, seed=args.seed,
        verdict=verdict, step=step, **limits, **controller,
    )  # fmt: skip


def _remedy(tuned: "TunedPi") -> str:
    """The remedy for gains that miss the specification, or its probability."""
    other = (
        "Relax the limit that is violated most often, identify on a longer record or with a larger amplitude, or "
        "accept less: --probability P, or --nominal for gains on the estimate alone. "
    )
    return f"{other if tuned.only_probability else ''}Nothing was written; --force writes these gains, marked as such."


def _sentences(tuned: "TunedPi", pf: "ParameterFile") -> list[str]:
    """Gains, verdict with its reasons, probability, and the table of limits."""
    from ..core.display import TextTable

    pi, verdict = pf.pi, tuned.verdict
    assert pi is not None  # noqa: S101  just written
    per_sample = pi.ki * pi.sample_time
    table = TextTable(
        ("specification", "on the model", "limit", "left", "draws missing it"),
        tuple(margin.row for margin in tuned.margins),
    )
    return [
        f"Gains: Kp {pi.kp:.6g} {_unit(pi)}, Ki {pi.ki:.6g} {_unit(pi)} per second, "
        + (f"{per_sample:.6g} per sample, integral time {pi.kp / pi.ki:.4g} s" if pi.ki else "no integral action")
        + f"; {pi.form} form, {pi.integration} integration, sample time {pi.sample_time:g} s.",
        " ".join([f"Verdict on the gains: {verdict.words}.", *verdict.reasons]),
        tuned.stated,
        *table.text().split("\n"),
        *([f"Assumed: {'; '.join(tuned.assumed)}."] if tuned.assumed else []),
        *([f"Marked in the file: {pi.forced}."] if pi.forced else []),
    ]


def _simulated(tuned: "TunedPi", step: float) -> list[str]:
    """Robustness, and simulated steps of reference and load, in words."""
    from ..ident.pi.loop import load_step, loop_of

    f, gains, model = tuned.figures, tuned.gains, tuned.model
    u, y = gains.unit_u or "units of the command", gains.unit_y or "unit of the measurement"
    load = load_step(loop_of(model, gains))
    size = f"{step * load.size:.3g} {u} at the input of the drive"
    if math.isfinite(model.dc_gain) and model.dc_gain:
        size += f", which would change the {model.output} by {step:.4g} {y} without control"
    return [
        f"Robustness of the loop on the model: maximum sensitivity Ms {f.ms:.3f}, phase margin {f.phase_margin:.1f} "
        f"degrees, gain margin {f.gain_margin:.2f} (factor on the gain of the drive at which the loop oscillates), "
        f"{f.delay_margin:.3g} s of further delay.",
        f"Simulated step of the reference by {step:.4g} {y}, without limits of the command: rise time "
        f"{f.rise_time:.3g} s, settling time {f.settling_time:.3g} s, overshoot {100 * f.overshoot:.2g} %; the command "
        f"peaks at {step * f.peak_u:.4g} {u} and travels {step * f.travel:.4g} {u} in total.",
        f"Simulated step of load ({size}): largest deviation {step * load.peak:.3g} {y}, down to 5 % of it after "
        f"{load.recovery:.3g} s; the command travels {step * load.travel:.4g} {u}.",
    ]


def _beyond_limits(tuned: "TunedPi", pf: "ParameterFile") -> list[str]:
    """Sentences on a step of the reference with the limits of the command, and on the range between the feed limits."""
    gains, line, run = tuned.gains, pf.load_line, tuned.limited
    if run is not None and run.limited:
        f, y = run.figures, gains.unit_y or "unit of the measurement"
        return [
            f"The same step with the limits and the rate of the command: rise time {f['rise_time']:.3g} s, settling "
            f"time {f['settling_time']:.3g} s, overshoot {100 * f['overshoot']:.2g} %."
            if run.reached
            else f"The same step with the limits of the command is not within 2 % of {run.step:.4g} {y} at its end."
        ]
    from ..parameters.checks.gains import reference_step

    low, high = gains.low, gains.high
    if line is not None and line.unit_feed == gains.unit_u:
        low, high = (low or line.lower.value), (high or line.upper.value)
    peak = (reference_step(pf) or 1.0) * tuned.figures.peak_u
    if low is None or high is None or peak <= high - low:
        return []
    return [
        f"The simulated command changes by up to {peak:.4g} {gains.unit_u}, more than the range between its limits, "
        f"{low:.4g} to {high:.4g} {gains.unit_u}: on the machine the response to that step is limited and slower."
    ]


def _margins(tuned: "TunedPi") -> list[dict[str, Any]]:
    """Margins as facts; infinite values are None."""
    from dataclasses import asdict

    return [
        {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in asdict(margin).items()}
        for margin in tuned.margins
    ]


def _derive_scaling(pf: "ParameterFile", args: argparse.Namespace) -> list[str]:
    """Set the scaling where ``--unit`` stands alone: of the two units, or by the load law, which is said."""
    from ..parameters.checks.record import load_slope
    from ..parameters.messages import in_unit

    d, law = pf.dynamics, load_slope(pf, args.unit)
    if d is None or args.scaling is not None or args.unit is None:
        return []
    args.scaling = in_unit(1.0, d.unit_u, args.unit) if d.unit_u else None
    if args.scaling is not None or law is None or not d.dc_gain:
        return []
    args.scaling = float(f"{abs(d.dc_gain / law[1]):.4g}")  # of two experiments; the sign is checked next
    return [
        f"Scaling {args.scaling:g} {law[0]} per {d.unit_u}: the static gain {d.dc_gain:.4g} {d.unit_y}/{d.unit_u} "
        f"of the model over the slope {law[1]:.4g} {d.unit_y} per {law[0]} of the load law (derived, not measured)."
    ]


def _check_scaling(args: argparse.Namespace) -> None:
    """Raise UsageError for a scaling that is not above zero."""
    if args.scaling is not None and not 0 < args.scaling < math.inf:
        raise UsageError(
            f"--scaling {args.scaling:g}: it must be above zero, as the command rises with the input of the model. "
            "Where the drive or the sensor is reversed, correct its wiring or negate its column of the record, and "
            "identify again."
        )


def _check_limits(pf: "ParameterFile", args: argparse.Namespace) -> None:
    """Raise UsageError where the limits of the command leave nothing, alone or of the feed limits of the file."""
    from ..parameters.messages import in_unit
    from ..parameters.sections.load_line import is_feed

    if None not in (args.low, args.high) and args.low >= args.high:
        raise UsageError(f"--low {args.low:g} must lie below --high {args.high:g}; interchange them?")
    line = pf.load_line
    factor = None if line is None or args.unit is None else in_unit(1.0, line.unit_feed, args.unit)
    if line is not None and factor is None and is_feed(line.unit_feed) and is_feed(args.unit or ""):
        raise UsageError(
            f"--unit {args.unit}: the feed limits of the file are in {line.unit_feed}, and the spindle speed between "
            f"both is not part of the control. Give --unit {line.unit_feed}, with --scaling and the limits in it."
        )
    if line is None or factor is None:
        return
    low, high = line.lower.value * factor, line.upper.value * factor
    if (args.low is not None and args.low >= high) or (args.high is not None and args.high <= low):
        given = " and ".join(f"--{name} {getattr(args, name):g}" for name in ("low", "high") if getattr(args, name))
        raise UsageError(
            f"{given} {args.unit}: outside the feed limits of the file, {low:.4g} to {high:.4g} {args.unit} "
            f"({line.lower.value:.4g} to {line.upper.value:.4g} {line.unit_feed}). Check --unit, or leave them out."
        )


def _unit(pi: Any) -> str:  # noqa: ANN401
    return f"{pi.unit_u or 'command'}/{pi.unit_y or 'measurement'}"


def _picture(tuned: "TunedPi", step: float, *, simulated: bool = False) -> bytes:
    """Gains, trade-off and simulated steps as a PNG, marked where the dynamics are of simulated data."""
    from io import BytesIO

    from ..core.figure_style import DPI
    from ..core.plotting import mark_simulated, save_figure
    from ..ident.pi.figures import tuning_figure

    out, figure = BytesIO(), tuning_figure(tuned, step)
    if simulated:
        mark_simulated(figure)
    save_figure(figure, out, format="png", dpi=DPI, metadata={"Software": None})
    return out.getvalue()
