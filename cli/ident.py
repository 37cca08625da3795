"""``fitmodels ident``: a model of the dynamics of a machine from a recorded run."""

import argparse
import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import UsageError
from ..core.journal import recover
from .arguments import Parser, joined, now_simulated, parameter_file, traced, typed
from .numbers import pairs
from .output import Printer, output_options, print_json
from .physical import SECTION, check_options, physical_options, report

if TYPE_CHECKING:
    from ..datasets import Record
    from ..ident.identification import Identification
    from ..ident.validation.amplitudes import AmplitudeTable
    from ..parameters import ParameterFile

READING = ("input", "output", "time", "rate", "sample_time", "resample", "decimal", "delimiter", "sheet", "reference")
RECORDED = (
    "input",
    "output",
    "reference",
    "time",
    "rate",
    "sample_time",
    "resample",
    "unit",
    "orders",
    "amplitudes",
    "trend",
    "deviations",
    "handover",
    "decimal",
    "sheet",
)


def parser() -> Parser:
    """Arguments of ``fitmodels ident``."""
    p = Parser(
        "fitmodels ident",
        "fitmodels ident run.csv --input u --output y",
        "Identify the dynamics of a machine from uniformly sampled input and output, validate the model by simulation\n"
        "of samples that it was not fitted to, and write params.json, a card and figures. Several runs may be given.",
        main="--input --output --rate --unit --held-out --as --params --tool --out --force --quiet --json",
    )
    p.add_argument(
        "file",
        metavar="RUN",
        nargs="+",
        help="table of samples: CSV, TXT, .xlsx, .xls, .xlsb, .ods, .lvm, .tdms or .mat",
    )
    p.add_argument(
        "--input", metavar="COLUMN", help="commanded signal: header, or col2 (default: by its name and unit)"
    )
    p.add_argument(
        "--output", metavar="COLUMN", help="measured signal: header, or col3 (default: by its name and unit)"
    )
    p.add_argument(
        "--reference", metavar="COLUMN", help="set point of the controller, of a run in closed loop (default: none)"
    )
    p.add_argument("--time", metavar="COLUMN", help="column of times (default: by its name)")
    p.add_argument("--rate", type=float, metavar="HZ", help="samples per second (default: from the column of times)")
    p.add_argument(
        "--sample-time",
        type=float,
        metavar="S",
        help="seconds between samples, instead of --rate (default: from the column of times)",
    )
    p.add_argument(
        "--resample", type=float, metavar="HZ", help="resample uneven samples to this rate (default: not resampled)"
    )
    p.add_argument(
        "--unit", action="append", metavar="time=ms", help="unit of a column that has none (default: from the header)"
    )
    p.add_argument("--decimal", choices=["point", "comma"], help="decimal mark (default: found in the file)")
    p.add_argument("--delimiter", metavar="MARK", help="delimiter of cells (default: found in the file)")
    p.add_argument("--sheet", metavar="NAME", help="sheet of a workbook (default: the one that holds a record)")
    p.add_argument("--held-out", metavar="RUN", help="a further run for validation (default: the last part of the run)")
    p.add_argument("--orders", metavar="NA,NB,NK", help="orders and delay (default: chosen by the record)")
    by_choice = (
        "model that is written to the file: the one chosen, or ARX of the same orders as in papers, with its warning"
    )
    p.add_argument("--handover", choices=["chosen", "arx"], help=f"{by_choice} (default: chosen)")
    amplitudes = "compare the gain of several runs of different amplitude: is the plant linear?"
    p.add_argument("--amplitudes", action="store_true", default=None, help=amplitudes)
    p.add_argument("--trend", action="store_true", default=None, help="subtract a straight line, not only the mean")
    p.add_argument("--deviations", action="store_true", default=None, help="record of deviations from a cutting load")
    physical_options(p)
    p.add_argument(
        "--tool", metavar="NAME", default="unnamed", help="name of the tool, or of the axis (default: unnamed)"
    )
    p.add_argument("--work", metavar="NAME", default="unnamed", help="name of the work material (default: unnamed)")
    p.add_argument("--params", metavar="FILE", help="parameter file to add the dynamics to (default: a new one)")
    p.add_argument("--out", metavar="DIR", help="where to write (default: ./<file>-fit)")
    p.add_argument("--force", action="store_true", help="replace what an earlier run wrote there")
    output_options(p, "print the report as JSON; writes nothing unless --out or --params")
    return p


def run(args: argparse.Namespace) -> int:
    """Identify, print and write, and return the exit code."""
    from ..cards import terminal
    from ..core.progress import progress_bar
    from ..ident import identify
    from ..ident.validation.amplitudes import with_amplitudes
    from ..parameters.checks.record import record_notes

    check_options(args)
    if args.amplitudes and len(args.file) < 2:
        raise UsageError("--amplitudes compares several runs of different amplitude: give two files or more.")
    orders = _orders(args.orders)
    target = _target(args)
    former = None if args.params is None else _former(args)
    with progress_bar(lines=False) as step:
        step.say("reading")
        records = [_read(name, args) for name in args.file]
        held_out = None if args.held_out is None else _read(args.held_out, args)
        step.say(f"identifying {records[0].output} from {records[0].input}")
        if args.model is not None:
            return report(records, held_out, former, target, args)
        found = identify(
            records, held_out=held_out, orders=orders, trend=bool(args.trend), handover=args.handover or "chosen"
        )
        if args.amplitudes:
            found = with_amplitudes(found, records)
        pf = _collected(found, records, former, args)
    if args.json:
        print_json("report", {"dynamics": _facts(found), "parameters": pf.model_dump(mode="json")}, version=5)
    else:
        out = Printer(quiet=args.quiet)
        out.show(terminal.identification_block(found, pf))
        for words in record_notes(pf, _ends(found)):
            out.show(f"! {words}")
    written = _written(found, pf, former, target, args)
    if written and not args.json:
        Printer(quiet=args.quiet).wrote(written, args.params or str(target))
    return 0


def _ends(found: "Identification") -> tuple[float, float] | None:
    """Smallest and largest output of the record, with its operating point."""
    at, y = found.model.operating_point, found.record.y
    return None if at is None else (float(y.min()) + at[1], float(y.max()) + at[1])


def _orders(text: str | None) -> tuple[int, int, int] | None:
    if text is None:
        return None
    parts = text.replace(" ", "").split(",")
    if len(parts) != 3 or not all(part.isdecimal() for part in parts):
        raise UsageError(f"--orders {text}: give three whole numbers na,nb,nk, for instance 3,3,1.")
    na, nb, nk = (int(part) for part in parts)
    if nb < 1:
        raise UsageError(f"--orders {text}: nb is 1 or more, the number of coefficients of the input.")
    return na, nb, nk


def _read(name: str, args: argparse.Namespace) -> "Record":
    from ..datasets import read_record

    given = {option: getattr(args, option) for option in READING}
    record = read_record(name, units=pairs(args.unit, "--unit", "time=ms"), **given)
    stated = ("stated: the record holds deviations from a cutting load",) if args.deviations else ()
    return dataclasses.replace(record, notes=(*stated, *record.notes))


def _target(args: argparse.Namespace) -> Path | None:
    """The folder that will be written, checked before anything is computed."""
    if args.params is not None or (args.json and not args.out):
        return None
    folder = Path(args.out or f"{Path(args.file[0]).stem}-fit")
    recover(folder)
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; choose a folder with --out.")
    if not args.force and folder.is_dir() and any(folder.iterdir()):
        raise UsageError(f"{folder} exists; replace what fitmodels wrote there with --force, or use --out.")
    return folder


def _former(args: argparse.Namespace) -> "ParameterFile":
    """The file of ``--params``, before anything is computed."""
    pf = parameter_file(args.params, writes=True)
    name = SECTION.get(args.model or "", "dynamics")
    replaced = name if name != "adaptive_force" else ""  # of which only the estimates are replaced
    if replaced and getattr(pf, name) is not None and not args.force:
        raise UsageError(f"{args.params} has a section {name}; replace it with --force.")
    return pf


def _collected(
    found: "Identification", records: "list[Record]", former: "ParameterFile | None", args: argparse.Namespace
) -> "ParameterFile":
    """A new parameter file, or the given one with its dynamics replaced."""
    from .. import parameters
    from ..datasets.runs import disclaimers
    from ..parameters.file import sealed
    from ..parameters.gather.control import dynamics_section

    if former is not None:  # its gains were tuned on other dynamics
        identity, provenance = joined(former, records), traced(former, args.words)
        return sealed(former, identity=identity, dynamics=dynamics_section(found), pi=None, provenance=provenance)
    source = records[0].source
    return parameters.collect(
        tool=args.tool,
        work=args.work,
        dynamics=found,
        data_file=args.file[0] if source is None else Path(source).name,
        data_sha256=records[0].sha256,
        simulated=True if disclaimers(note for rec in records for note in rec.notes) else None,
        n_rows=len(found.record),
        command=typed([word for word in args.words if word != "--force"]),
        options={name: value for name in RECORDED if (value := getattr(args, name)) is not None},
    )


def _written(
    found: "Identification",
    pf: "ParameterFile",
    former: "ParameterFile | None",
    folder: Path | None,
    args: argparse.Namespace,
) -> str:
    from .. import cards
    from ..parameters.file import picture_folder, replace

    if former is not None:
        replace(pf, args.params, former, _redrawn(found, pf, picture_folder(args.params)))
        return f"Dynamics added to {args.params}{now_simulated(former, pf)}"
    if folder is None:
        return ""
    cards.write(pf, folder, identification=found, data_lines=found.notes, force=args.force)
    return f"Written: {folder}/ ({', '.join(cards.files(pf))})"


def _redrawn(found: "Identification", pf: "ParameterFile", folder: Path) -> dict[str, bytes | None]:
    """Figures of former dynamics in the folder, drawn again; that of gains tuned on them is removed."""
    from tempfile import TemporaryDirectory

    from ..cards.figures import draw_dynamics
    from ..cards.folder import DYNAMICS_FIGURES, LEFT_FIGURES, PI_FIGURE

    derived: dict[str, bytes | None] = {PI_FIGURE: None}
    former = (*DYNAMICS_FIGURES, *LEFT_FIGURES)
    old = [name for name in former if (folder / name).exists()]
    derived |= dict.fromkeys((name for name in LEFT_FIGURES if (folder / name).exists()), None)
    if not old or pf.laws:  # figures of laws have the same names
        return derived
    with TemporaryDirectory() as made:
        draw_dynamics(found, Path(made) / "figures", "not measured" if pf.identity.simulated else "")
        return derived | {name: (Path(made) / name).read_bytes() for name in DYNAMICS_FIGURES}


def _facts(found: "Identification") -> dict[str, Any]:
    from ..parameters.sections.base import VerdictSection

    return {
        "verdict": VerdictSection.of(found.verdict).model_dump(),
        "verdicts": list(found.verdicts),
        "concern": found.concern,
        "judged_on": found.validated_on,
        "fit": found.validation.fit,
        "rsquared": found.validation.rsquared,
        "one_step_fit": found.validation.k_step_fit.get(1),
        "disturbances": [
            {name: _finite(getattr(one, name)) for name in ("kind", "size", "unit", "place", "sentence", "level")}
            for one in found.disturbances.found
        ],
        "amplitudes": None if found.amplitudes is None else _rows(found.amplitudes),
        "argument": found.argument,
        "form": None if found.form is None else found.form.words,
        "tried": found.tried.to_dict(orient="records"),
        "arx": {"b": found.arx.b.tolist(), "a": found.arx.a.tolist()},
    }


def _finite(value: Any) -> Any:  # noqa: ANN401
    """A value as JSON has it: None for a size that is not known."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _rows(found: "AmplitudeTable") -> dict[str, Any]:
    names = ("amplitude", "gain", "gain_error", "difference", "difference_error")
    columns = [getattr(found, name) for name in names]
    rows = [dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True)]
    return {"frequency": found.frequency, "band": list(found.band), "sentence": found.sentence, "runs": rows}
