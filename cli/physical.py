"""``fitmodels ident --as``: a step response, a feed drive, or drive and cut of adaptive force from a recorded run."""

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ..core.errors import IdentError, UsageError
from ..datasets.units import canonical
from .arguments import Parser, joined, now_simulated, traced, typed
from .numbers import NUMBER, values
from .output import Printer, print_json

if TYPE_CHECKING:
    from ..core.verdict import Verdict
    from ..datasets import Record
    from ..ident.physical_models.drive import DriveFit
    from ..ident.physical_models.force_process import ForceProcess
    from ..ident.physical_models.step_response import StepFit
    from ..parameters import ParameterFile
    from ..parameters.sections.origin import IdentitySection

STEP, DRIVE, FORCE = "step", "drive", "force-process"
SECTION: Final = {STEP: "dynamics", DRIVE: "drive", FORCE: "adaptive_force"}
OPTIONS: Final = {  # of each model; an option of another one would have no effect
    STEP: ("order", "delay", "held_out"),
    DRIVE: ("force_per_unit", "timing", "cutoff", "held_out"),
    FORCE: ("given", "drive_pole", "depth", "spindle", "teeth"),
}
OF_IDENTIFICATION: Final = ("orders", "trend", "deviations", "handover", "amplitudes", "reference")
GOOD, POOR = 80.0, 50.0  # % of fit, as of `validate`
MOST_TEETH: Final = 1000  # a larger number is none of a cutter
TURNING = re.compile(rf"((?![+-]){NUMBER})\s*+([^\d\s.,+-].*)?")


class Found(NamedTuple):
    """A fit, its section of the parameter file, its verdict with that of other samples, and the fit to these."""

    fit: "StepFit | DriveFit | ForceProcess"
    section: dict[str, Any]
    verdict: "Verdict"
    held_out: str = ""


def physical_options(p: Parser) -> None:
    """Add ``--as`` and the options of its models."""
    group = p.add_argument_group(
        "physical models",
        "Instead of a transfer function of free order. step: first or second order with delay, written as dynamics;\n"
        "drive: inertia and friction from force and motion; force-process: the estimates of adaptive force\n"
        "control from feed command and cutting force.",
    )
    group.add_argument(
        "--as",
        dest="model",
        choices=[STEP, DRIVE, FORCE],
        help="the model that is fitted (default: a transfer function)",
    )
    group.add_argument("--order", type=int, choices=[1, 2], help="step: the order (default: chosen by the record)")
    group.add_argument("--delay", type=float, metavar="S", help="step: the delay (default: estimated)")
    group.add_argument(
        "--force-per-unit",
        type=float,
        metavar="N",
        help="drive: N (or N m) for one unit of the input, as 35.2 for V (default: 1)",
    )
    timing = "drive: the force is held until the next sample, or measured at the sample"
    group.add_argument("--timing", choices=["held", "measured"], help=f"{timing} (default: chosen by the record)")
    group.add_argument("--cutoff", type=float, metavar="HZ", help="drive: low-pass (default: 0.04 of the sample rate)")
    group.add_argument(
        "--depth", type=float, metavar="MM", help="force-process: depth of cut of the run (default: not stated)"
    )
    group.add_argument(
        "--spindle",
        type=spindle_speed,
        metavar="RPM",
        help="force-process: spindle speed of the run, 1/min; the force is averaged over a revolution (default: not "
        "stated)",
    )
    why = "force-process: number of teeth of the cutter, whose mean force the samples must give (default: not known)"
    group.add_argument("--teeth", type=teeth, metavar="N", help=why)
    group.add_argument(
        "--given", action="append", metavar="m=2.0", help="force-process: one of m, k and d (default: none is known)"
    )
    pole = "force-process: which pole is that of the drive (default: by --given)"
    group.add_argument("--drive-pole", choices=["faster", "slower"], help=pole)


def spindle_speed(text: str) -> float:
    """A spindle speed, 1/min, with or without its unit.

    >>> spindle_speed("3000"), spindle_speed("3000rpm"), spindle_speed("50 rev/s")
    (3000.0, 3000.0, 3000.0)
    """
    found = TURNING.fullmatch(text.strip())
    unit = "1/min" if found is None else canonical(found[2] or "rpm")
    if found is None or unit not in ("1/min", "rev/s") or not 0 < float(found[1]) < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a spindle speed; give it in 1/min, for instance 3000rpm")
    return float(found[1]) * (60 if unit == "rev/s" else 1)


def teeth(text: str) -> int:
    """A number of teeth.

    >>> teeth("4")
    4
    """
    if not text.strip().isdecimal() or not 0 < int(text) < MOST_TEETH:
        raise argparse.ArgumentTypeError(f"{text} is not a number of teeth; give a whole number above zero")
    return int(text)


def with_teeth(identity: "IdentitySection", number: int | None) -> "IdentitySection":
    """The identity with the number of teeth of the tool, where it is given."""
    return identity.model_copy(update={"iso13399": {**identity.iso13399, **_geometry(number)}})


def _geometry(number: int | None) -> dict[str, float]:
    """The number of teeth by its symbol of ISO 13399, where it is given."""
    return {} if number is None else {"ZEFP": float(number)}


def check_options(args: argparse.Namespace) -> None:
    """Raise UsageError for an option that the chosen model does not have."""
    allowed = OPTIONS.get(args.model or "", ("held_out", *OF_IDENTIFICATION))
    every = {name for names in (*OPTIONS.values(), OF_IDENTIFICATION) for name in names}
    for name in sorted(every - set(allowed)):
        if getattr(args, name) is not None:
            option = f"--{name.replace('_', '-')}"
            owners = [f"--as {model}" for model, names in OPTIONS.items() if name in names]
            where = "without --as" if name in OF_IDENTIFICATION else f"with {' and '.join(owners)}"
            raise UsageError(f"{option} has an effect only {where}; leave it out, or choose another model.")


def fitted(records: "Sequence[Record]", held_out: "Record | None", args: argparse.Namespace, pf: Any) -> Found:  # noqa: ANN401
    """The model of ``--as``; ``pf`` is the parameter file that it will be added to, or None."""
    from ..datasets.records.record import join_records

    rec = records[0] if len(records) == 1 else join_records(records)
    if args.model == STEP:
        return _step(rec, held_out, args)
    if args.model == DRIVE:
        return _drive(rec, held_out, args)
    return _force(rec, args, pf)


def _step(rec: "Record", held_out: "Record | None", args: argparse.Namespace) -> Found:
    from ..ident import step_response_fit, validate
    from ..parameters.gather.control import step_section

    fit = step_response_fit(rec, args.order, delay=args.delay)
    model, verdict, other, words = fit.model(rec.sample_time), fit.verdict, None, ""
    if held_out is not None:
        percent = validate(model, held_out).fit
        other = (percent, held_out.sha256)
        verdict, words = _with_held_out(verdict, percent, f"the {fit.output} of {len(held_out)} samples not fitted")
    return Found(fit, step_section(fit, rec.centred(), verdict, other), verdict, words)


def _drive(rec: "Record", held_out: "Record | None", args: argparse.Namespace) -> Found:
    from ..ident import drive_fit
    from ..parameters.gather.control import drive_section

    held = None if args.timing is None else args.timing == "held"
    fit = drive_fit(rec, args.force_per_unit, held=held, cutoff=args.cutoff)
    verdict, other, words = fit.verdict, None, ""
    if held_out is not None and fit.possible:
        percent = fit.free_run(held_out)[2]
        other = (percent, held_out.sha256)
        verdict, words = _with_held_out(verdict, percent, f"the speed of {len(held_out)} samples not fitted")
    return Found(fit, drive_section(fit, rec, verdict, other), verdict, words)


def _force(rec: "Record", args: argparse.Namespace, pf: "ParameterFile | None") -> Found:
    from ..controllers.adaptive_force.settings import teeth_of
    from ..ident import force_process_fit
    from ..parameters.gather.control import force_process_section

    given = values(args.given, "--given")
    if unknown := sorted(set(given) - {"m", "k", "d"}):
        raise UsageError(f"--given {unknown[0]}: one of m, k and d, as m=2.0.")
    if args.depth is not None and not args.depth > 0:
        raise UsageError(f"--depth {args.depth:g} mm: a depth of cut lies above zero.")
    if rec.unit_y not in ("N", "kN", ""):
        raise UsageError(
            f"output {rec.output} is in {rec.unit_y}, but a force process needs the cutting force: name that column "
            "with --output, or identify a transfer function without --as."
        )
    turn = None if args.spindle is None else 60 / args.spindle
    number = args.teeth or (None if pf is None else teeth_of(pf))
    known = {name: given.get(name) for name in ("m", "k", "d")}
    fit = force_process_fit(
        rec.centred(), m=known["m"], k=known["k"], d=known["d"], drive=args.drive_pole, revolution=turn, teeth=number
    )
    if not fit.ratios[0] > 0 and fit.fit < POOR:
        raise IdentError(
            f"{rec.output} does not follow {rec.input}: the model explains {max(fit.fit, 0):.0f} % of it, less than "
            f"{POOR:.0f} %. Check that the tool cuts, at one depth, in the whole record, and the columns (--input, "
            "--output)."
        )
    if not fit.ratios[0] > 0:
        raise IdentError(
            f"the force falls when the feed rises (m/k is {fit.ratios[0]:.3g}): check the sign of {rec.output} and the "
            "columns (--input, --output)."
        )
    former = None if pf is None else pf.adaptive_force
    return Found(fit, force_process_section(fit, former, args.depth, args.spindle, rec), fit.verdict)


def _with_held_out(verdict: "Verdict", percent: float, what: str) -> "tuple[Verdict, str]":
    """The verdict with that of a simulation of other samples, and the fit to these in a sentence."""
    from ..core.verdict import DO_NOT_USE, RESERVATIONS, verdict_from

    found = [(verdict.level, words) for words in verdict.reasons]
    if percent < GOOD:
        level, limit = (RESERVATIONS, GOOD) if percent >= POOR else (DO_NOT_USE, POOR)
        found.append((level, f"The simulation explains {percent:.0f} % of {what}, less than {limit:.0f} %."))
    words = f"Simulation of {what}: fit {percent:.1f} %."
    return verdict_from(found, ("Simulation of samples not fitted", *verdict.checked)), words


def report(
    records: "Sequence[Record]",
    held_out: "Record | None",
    former: "ParameterFile | None",
    folder: Path | None,
    args: argparse.Namespace,
) -> int:
    """Fit the model of ``--as``, print it, write its section, and return the exit code."""
    from ..cards import terminal
    from ..parameters.sections.base import VerdictSection

    found = fitted(records, held_out, args, former)
    pf = _collected(found, records, former, args)
    name = SECTION[args.model]
    if args.json:
        fit, verdict = found.fit, VerdictSection.of(found.verdict).model_dump()
        estimates = {
            key: {"estimate": float(value), "se": float(se)}
            for key, value, se in zip(fit.params.index, fit.params, fit.bse, strict=True)
        }
        facts = {"model": args.model, "section": name, "verdict": verdict, "words": fit.words, "estimates": estimates}
        print_json("physical-model", {**facts, "parameters": pf.model_dump(mode="json")})
    else:
        Printer(quiet=args.quiet).show(terminal.physical_block(found.fit, found.verdict, records, found.held_out))
    written = _written(found, records, pf, former, folder, args)
    if written and not args.json:
        Printer(quiet=args.quiet).wrote(written, args.params or str(folder))
    return 0


def _collected(
    found: Found, records: "Sequence[Record]", former: "ParameterFile | None", args: argparse.Namespace
) -> "ParameterFile":
    """A new parameter file, or the given one with its section replaced; gains tuned on other dynamics are removed."""
    from .. import parameters
    from ..datasets.runs import disclaimers
    from ..parameters.file import sealed

    section: dict[str, Any] = {SECTION[args.model]: found.section}
    if former is not None:
        section |= {"pi": None} if args.model == STEP else {}
        identity, provenance = with_teeth(joined(former, records), args.teeth), traced(former, args.words)
        return sealed(former, identity=identity, **section, provenance=provenance)
    options = ("input", "output", "unit", "rate", "model", *OPTIONS[args.model])
    source = records[0].source
    return parameters.collect(
        tool=args.tool,
        work=args.work,
        iso13399=_geometry(args.teeth),
        **section,
        data_file=args.file[0] if source is None else Path(source).name,
        data_sha256=records[0].sha256,
        simulated=bool(disclaimers(note for rec in records for note in rec.notes)) or None,
        n_rows=sum(map(len, records)),
        command=typed(args.words),
        options={name: value for name in options if (value := getattr(args, name)) is not None},
    )


def _written(
    found: Found,
    records: "Sequence[Record]",
    pf: "ParameterFile",
    former: "ParameterFile | None",
    folder: Path | None,
    args: argparse.Namespace,
) -> str:
    from .. import cards
    from ..cards.folder import DYNAMICS_FIGURES, FIT_FIGURES, FORMS, PARAMETERS, PI_FIGURE
    from ..parameters.file import picture_folder, replace

    figure = FIT_FIGURES[args.model]
    if former is not None:
        drawn: dict[str, bytes | None] = {figure: _picture(found, pf)}
        if args.model == STEP and not pf.laws:  # figures of laws have the same names
            drawn |= dict.fromkeys((*DYNAMICS_FIGURES, PI_FIGURE))
        replace(pf, args.params, former, drawn)
        written = f"Written: {SECTION[args.model]} in {args.params}, {picture_folder(args.params) / figure}"
        return written + now_simulated(former, pf)
    if folder is None:
        return ""
    cards.write(pf, folder, physical=found.fit, data_lines=records[0].notes, force=args.force)
    return f"Written: {folder}/ ({', '.join((PARAMETERS, *FORMS, figure))})"


def _picture(found: Found, pf: "ParameterFile") -> bytes:
    """The figure of the fit as a PNG."""
    from tempfile import TemporaryDirectory

    from ..cards.figures import draw_physical

    with TemporaryDirectory() as made:
        return draw_physical(found.fit, Path(made), "not measured" if pf.identity.simulated else "").read_bytes()
