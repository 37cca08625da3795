"""``fitmodels excite``: an excitation for the machine, and the predicted errors of a plant like the guess."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..core.errors import UsageError
from ..datasets.units import canonical
from .arguments import Parser, parameter_file, seed
from .output import Printer, output_options, print_json

if TYPE_CHECKING:
    from ..core.arrays import Array
    from ..ident import Model

KINDS = ("chirp", "logarithmic", "prbs", "multisine", "steps")
NEAR = 1e-9  # of a period
PRINTED = 6  # frequencies at which the predicted errors are printed


def parser() -> Parser:
    """Arguments of ``fitmodels excite``."""
    p = Parser(
        "fitmodels excite",
        "fitmodels excite --amplitude 2.5 --band 0.1:2 --duration 15 --rate 50 --out excitation.csv",
        "Write an excitation as a table with its sample rate. With a guess of the plant (--like params.json) and the\n"
        "noise of the sensor (--noise), print the predicted standard error of the gain, to choose band and length.",
    )
    p.add_argument("--kind", choices=KINDS, default="chirp", help="chirp: linear sweep (CLM-2023 eq. 17; default)")
    p.add_argument("--amplitude", type=float, default=2.5, metavar="A", help="in the unit of the input (default: 2.5)")
    p.add_argument("--offset", type=float, default=0.0, metavar="A", help="operating point of the input (default: 0)")
    p.add_argument("--band", metavar="LOW:HIGH", default="0.1:2", help="Hz (default: 0.1:2)")
    p.add_argument("--duration", type=float, default=15.0, metavar="S", help="seconds (default: 15)")
    p.add_argument("--rate", type=float, default=50.0, metavar="HZ", help="samples per second (default: 50)")
    p.add_argument("--low", type=float, metavar="A", help="lowest permitted level (default: none)")
    p.add_argument("--high", type=float, metavar="A", help="highest permitted level (default: none)")
    p.add_argument(
        "--max-rate", type=float, metavar="PER_S", help="largest permitted change per second (default: none)"
    )
    p.add_argument("--seed", type=seed, default=1, metavar="N", help="of the two levels of prbs (default: 1)")
    p.add_argument("--unit", metavar="UNIT", help="unit of the input (default: that of --like, otherwise V)")
    p.add_argument(
        "--like", metavar="FILE", help="params.json with dynamics, the guess of the plant (default: no prediction)"
    )
    p.add_argument(
        "--noise",
        type=float,
        metavar="SD",
        help="with --like: standard deviation of the sensor noise, unit of the output (default: must be given)",
    )
    p.add_argument(
        "--for", dest="form", choices=["csv", "octave", "labview", "linuxcnc"], default="csv", help="program"
    )
    p.add_argument("--out", metavar="FILE", help="file to write (default: none, the description is printed)")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    output_options(p, "print the description as JSON (fitmodels.excitation/1)")
    return p


def run(args: argparse.Namespace) -> int:
    """Make the excitation, print its description and predicted errors, and write it."""
    from .. import ident

    guess = None if args.like is None else _guess(args)
    args.unit = args.unit or getattr(guess, "unit_u", "") or "V"
    u = _made(args)
    lines = _described(args, u, guess)
    path = None
    if args.out is not None:
        path = ident.write_excitation(u, args.rate, Path(args.out), args.form, args.unit, force=args.force)
    if args.json:
        print_json("excitation", {"file": None if path is None else str(path), "words": lines, "rate": args.rate,
                                  "samples": len(u), "unit": args.unit})  # fmt: skip
        return 0
    out = Printer(quiet=args.quiet)
    out.show("\n".join(lines))
    if path is not None:
        out.wrote(f"Written: {path}", path)
    return 0


def _described(args: argparse.Namespace, u: "Array", guess: "Model | None") -> list[str]:
    """Sentences on a signal: its size, a period of its band that is longer than itself, and predicted errors."""
    low, high = _band(args.band)
    crest = float(abs(u - args.offset).max() / max(float((u - args.offset).std()), 1e-300))
    lines = [
        f"{args.kind}: {len(u)} samples at {args.rate:g} Hz, {len(u) / args.rate:g} s, {low:g} to {high:g} Hz, "
        f"{u.min():.4g} to {u.max():.4g} {args.unit}, crest factor {crest:.2f}"
    ]
    if low * args.duration < 1 - NEAR:
        lines.append(
            f"A period of {low:g} Hz takes {1 / low:.4g} s, longer than the {args.duration:g} s of the signal: below "
            f"{1 / args.duration:.3g} Hz it determines no response. Give a longer --duration, or a higher --band."
        )
    return lines if guess is None else [*lines, _predicted(args, u - args.offset, guess)]


def _made(args: argparse.Namespace) -> Any:  # noqa: ANN401
    from .. import ident

    limits = {name: value for name in ("low", "high", "max_rate") if (value := getattr(args, name)) is not None}
    low, high = _band(args.band)
    frame = {"duration": args.duration, "rate": args.rate, "offset": args.offset, **limits}
    if args.kind in ("chirp", "logarithmic"):
        sweep: Literal["linear", "logarithmic"] = "linear" if args.kind == "chirp" else "logarithmic"
        return ident.chirp(args.amplitude, low, high, kind=sweep, **frame)
    if args.kind == "prbs":
        hold = max(round(0.44 / high * args.rate), 1) / args.rate  # half power at the upper end of the band
        return ident.prbs(args.amplitude, hold=hold, seed=args.seed, **frame)
    if args.kind == "steps":
        frame.pop("duration")
        hold = max(round(0.5 / low * args.rate), 1) / args.rate
        count = max(round(args.duration / hold), 2)
        return ident.steps([args.amplitude * (k % 2) for k in range(count)], hold=hold, **frame)
    first = 1 / args.duration
    lines = [k * first for k in range(1, int(high / first + 1e-9) + 1) if k * first >= low - 1e-9]
    if not lines:
        raise UsageError(
            f"--band {args.band}: no frequency of it fits a whole number of periods into {args.duration:g} s; give a "
            "wider band, or a longer --duration."
        )
    return ident.multisine(args.amplitude, lines, **frame)


def _band(text: str) -> tuple[float, float]:
    low, colon, high = text.partition(":")
    try:
        ends = float(low), float(high)
    except ValueError:
        ends = (0.0, 0.0)
    if not colon or not 0 < ends[0] < ends[1]:
        raise UsageError(f"--band {text}: two frequencies in Hz, low:high, as 0.1:2.")
    return ends


def _guess(args: argparse.Namespace) -> "Model":
    from ..parameters.gather.control import model_of

    if args.noise is None or not args.noise > 0:
        raise UsageError("--like predicts errors, which needs the noise of the sensor: add for instance --noise 0.005.")
    d = parameter_file(args.like).dynamics
    if d is None:
        raise UsageError(f"{args.like} contains no dynamics; identify them first: fitmodels ident run.csv.")
    if args.unit is not None and d.unit_u and canonical(args.unit) != canonical(d.unit_u):
        raise UsageError(
            f"--unit {args.unit}: the input of the dynamics in {args.like} is in {d.unit_u}; leave --unit out, and "
            f"give the amplitude in {d.unit_u}."
        )
    if abs(d.sample_time * args.rate - 1) > 1e-6:
        raise UsageError(f"the dynamics are sampled at {1 / d.sample_time:g} Hz; give --rate {1 / d.sample_time:g}.")
    return model_of(d)


def _predicted(args: argparse.Namespace, u: Any, guess: "Model") -> str:  # noqa: ANN401
    import numpy as np

    from .. import ident

    found = ident.predicted_errors(guess, u, args.noise, frequency=np.geomspace(*_band(args.band), PRINTED))
    parts = [f"{f:.3g} Hz {row.gain_se:.2g} %" for f, row in found.response.iterrows()]
    return (
        f"For a plant as in {args.like}, with noise {args.noise:g} {guess.unit_y} (signal-to-noise ratio "
        f"{found.snr:.0f} dB), the predicted standard error of the gain is: {', '.join(parts)}"
    )
