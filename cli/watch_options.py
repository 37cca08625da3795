"""Options of ``fitmodels watch``: of the edge, of the source, and what they give."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import UsageError
from .arguments import Parser, parameter_file
from .numbers import constants, measured, pairs

if TYPE_CHECKING:
    from ..live.control import ControlSession
    from ..live.linuxcnc_control import Runner
    from ..live.live_laws import LiveLaws
    from ..live.monitor import Monitor
    from ..live.sources import SourceOptions
    from ..parameters import ParameterFile

ABSURD: Final = 20.0  # times the largest wear tested, beyond which a criterion is of another unit


def edge_options(p: Parser) -> None:
    """Add the options of the journal and of the edge in use."""
    group = p.add_argument_group("edge")
    group.add_argument(
        "--journal", metavar="FOLDER", help="keep all records there, and go on after an interruption (default: none)"
    )
    group.add_argument("--gauge", metavar="VB=0.21mm", help="a gauge reading of the edge in use (default: none)")
    group.add_argument(
        "--gauge-sd", type=float, default=0.02, metavar="SD", help="of its logarithm (default: 0.02, 2 percent)"
    )
    group.add_argument("--new-edge", action="store_true", help="a new edge is in use")
    group.add_argument(
        "--used", metavar="8min", help="minutes that the edge cut before it was watched (default: none, it is new)"
    )
    group.add_argument("--tool", metavar="NAME", help="tool of the edge, as the source names it (default: the first)")
    words = "wear of the finished edge; the laws learn from it (default: none)"
    group.add_argument("--measured", metavar="VB=0.21mm", help=words)
    group.add_argument(
        "--edge", type=int, metavar="N", help="number of the edge that was measured (default: the last one that cut)"
    )
    group.add_argument("--batch", default="", metavar="NAME", help="delivery that it is of (default: the version)")
    words = "take in a gauge reading, or learn from a wear, although it is doubted"
    group.add_argument("--certain", action="store_true", help=words)
    words = "show the exponents of the laws over the batches they learned from, with a figure where PNG is given"
    group.add_argument("--drift", nargs="?", const="", metavar="PNG", help=f"{words} (default: no)")
    group.add_argument("--acknowledge", action="store_true", help="acknowledge the alarms")


def source_options(p: Parser) -> None:
    """Add the options of reading a source and of finding cuts in it."""
    group = p.add_argument_group("source")
    for option in ("map", "node"):
        words = "column or OPC UA node" if option == "map" else "OPC UA node"
        group.add_argument(
            f"--{option}",
            action="append",
            metavar="P=NAME",
            help=f"{words} of a load, of V, f, d, n, state, tool (default: by name)",
        )
    group.add_argument("--unit", action="append", metavar="P=W", help="unit of a reading (default: of the header)")
    group.add_argument("--scale", action="append", metavar="P=0.11", help="factor of a reading (default: none)")
    group.add_argument(
        "--value", action="append", metavar="d=2mm", help="a condition that the source does not give (default: none)"
    )
    group.add_argument(
        "--rate", type=float, metavar="HZ", help="samples per second of a file without times (default: none)"
    )
    group.add_argument("--silent", type=float, default=5.0, metavar="S", help="without a reading: lost (default: 5)")
    group.add_argument("--from-end", action="store_true", help="pass over what a growing file holds already")
    group.add_argument(
        "--whole",
        action="append",
        metavar="P",
        help="load whose law includes the idle load (default: idle is subtracted)",
    )
    group.add_argument("--rest", choices=["off", "idle"], help="what a drive load near zero is (default: not assumed)")
    group.add_argument("--by", metavar="LEVEL", help="level of the category of the laws (default: none)")
    group.add_argument("--window", type=float, default=10.0, metavar="S", help="length of a window (default: 10)")
    group.add_argument(
        "--certificate", metavar="FILE", help="of this program, for OPC UA off this machine (default: none)"
    )
    group.add_argument("--key", metavar="FILE", help="private key of the certificate (default: none)")
    group.add_argument("--server-certificate", metavar="FILE", help="of the OPC UA server (default: none)")
    group.add_argument("--user", default="", metavar="NAME", help="of the OPC UA server (default: none)")
    group.add_argument("--password-file", metavar="FILE", help="password of the user (default: none)")
    group.add_argument("--python", default="/usr/bin/python3", metavar="PATH", help="Python of LinuxCNC")


def control_options(p: Parser) -> None:
    """Add the options of control by consent."""
    group = p.add_argument_group("control")
    group.add_argument(
        "--write", action="store_true", help="write reference and feed limit of the HAL export of the file to LinuxCNC"
    )
    group.add_argument("--consent", default="", metavar="WORDS", help="consent, in the words that --write prints")
    group.add_argument("--reference", metavar="0.22A", help="load that the controller holds (default: of the file)")
    group.add_argument("--controller", metavar="FILE", help="params.json of the HAL export (default: PARAMS)")


def control_of(args: argparse.Namespace, pf: "ParameterFile") -> "Runner[ControlSession] | None":
    """Connection with the controller, None without ``--write``.

    Raises
    ------
    UsageError
        The source is not LinuxCNC, or the consent is not that of the range.
    GateError
        The file has no controller with a heartbeat that HAL can hold.
    """
    if not args.write:
        for name in ("consent", "reference", "controller"):
            if getattr(args, name):
                raise UsageError(f"--{name} goes with --write; without it nothing is written.")
        return None
    if args.source != "linuxcnc":
        raise UsageError(
            f"--write needs --from linuxcnc and the HAL export of the file: {args.source} has no controller whose "
            "heartbeat can be seen to trip. Nothing is written."
        )
    from ..live.control import open_control
    from ..live.controller import controller_of, require_consent

    of = pf if args.controller is None else parameter_file(args.controller)
    controller = controller_of(of)
    require_consent(controller, args.consent)
    unit = controller.loop.unit_load
    reference = None if args.reference is None else measured(args.reference, unit, "--reference", f"0.22{unit}")
    return open_control(of, args.consent, reference, args.python)


def check_options(args: argparse.Namespace) -> None:
    """Refuse numbers outside their ranges, and options without the one that they belong to."""
    for name in ("risk", "level"):
        value = getattr(args, name)
        if not 0 < value < 1:
            raise UsageError(f"--{name} {value:g}: give a probability between 0 and 1, such as {0.05:g}.")
    if not 1 <= args.window <= 600:
        raise UsageError(f"--window {args.window:g}: give 1 to 600 s.")
    if not 0 < args.gauge_sd <= 1:
        raise UsageError(f"--gauge-sd {args.gauge_sd:g}: give the standard deviation of ln wear, 0.02 for 2 percent.")
    if args.source is None and args.journal is None and args.drift is None:
        raise UsageError("give a source with --from, or the journal of a watch with --journal.")
    if args.source is None and any((args.replay, args.page is not None, args.serve, args.stream)):
        raise UsageError("--replay, --page, --serve and --stream need a source: give one with --from.")
    if args.measured is not None and (args.source is not None or args.journal is None):
        raise UsageError("--measured needs the journal of the edge, --journal FOLDER, and no source.")
    if args.measured is None and (args.edge is not None or args.batch):
        raise UsageError("--edge and --batch belong to --measured.")
    if args.certain and args.measured is None and args.gauge is None:
        raise UsageError("--certain belongs to --gauge or --measured.")
    if args.stream == "-" and args.json:
        raise UsageError("--stream - and --json both write to standard output; leave one of them out.")


def requests_of(args: argparse.Namespace, pf: "ParameterFile") -> list[dict[str, Any]]:
    """Requests of the journal on the edge in use."""
    from ..live.live_laws import LiveLaws

    asked: list[dict[str, Any]] = []
    if args.new_edge:
        asked.append({"kind": "edge"})
    if args.tool:
        asked.append({"kind": "tool", "tool": args.tool})
    if args.acknowledge:
        asked.append({"kind": "acknowledge"})
    if args.used is not None:
        minutes = measured(args.used, "min", "--used", "8min")
        asked.append({"kind": "used", "minutes": minutes, "conditions": constants(args.value)})
    if args.gauge is not None:
        wear = LiveLaws.of(pf, by=args.by).wear
        value = wear_of(args.gauge, wear.symbol, wear.unit, "--gauge")
        asked.append({"kind": "gauge", "wear": value, "sd_ln": args.gauge_sd, "certain": args.certain})
    return asked


def conditions_of(args: argparse.Namespace, laws: "LiveLaws") -> dict[str, float]:
    """Conditions of ``--value`` that a source does not give.

    Raises
    ------
    UsageError
        One that is no condition of a cut, or not above zero.
    """
    from ..core.suggestions import did_you_mean
    from ..live.sources.options import CONDITIONS

    found, known = constants(args.value), tuple(dict.fromkeys((*CONDITIONS, *laws.conditions)))
    for name, value in found.items():
        if name not in known:
            raise UsageError(f"--value {name}={value:g}: no condition {name!r}. {did_you_mean(name, known)}")
        if not 0 < value < float("inf"):
            raise UsageError(f"--value {name}={value:g}: give a value above zero, such as {name}=2.")
    return found


def criterion_of(args: argparse.Namespace, laws: "LiveLaws") -> float:
    """The wear at the end of life, in the unit of the law: as asked, of the journal, or of the file.

    Raises
    ------
    UsageError
        None of them states it.
    """
    from ..live.watch_journal import read_newest

    symbol, unit = laws.wear.symbol, laws.wear.unit
    newest = None if args.journal is None else read_newest(Path(args.journal))
    asked = wear_of(args.criterion, symbol, unit, "--criterion")
    kept = None if newest is None else newest.records[0]["state"].get("estimate", {}).get("criterion")
    if asked is not None and asked > ABSURD * laws.largest_wear:
        raise UsageError(
            f"--criterion {args.criterion}: {asked:g} {unit} is {asked / laws.largest_wear:.3g} times the largest wear "
            f"tested ({laws.largest_wear:.3g} {unit}); give its unit, such as {symbol}=300um."
        )
    for known in (asked, kept, laws.criterion):
        if known is not None:
            return float(known)
    raise UsageError(f"{args.params} states no wear at the end of life: give it, as --criterion {symbol}=0.3{unit}.")


def wear_of(words: str | None, symbol: str, unit: str, option: str) -> float | None:
    """A wear in the unit of its law, named by its symbol or not at all."""
    if words is None:
        return None
    name, equals, value = words.rpartition("=")
    if equals and name.strip() != symbol:
        raise UsageError(f"{option} {words}: the wear law of the file is one of {symbol}; give {symbol}={value}.")
    return measured(value.strip(), unit, option, f"{symbol}=0.3{unit}")


def source_options_of(args: argparse.Namespace, monitor: "Monitor", after: float | None) -> "SourceOptions":
    """Options of the source."""
    from ..live.sources import SourceOptions
    from .numbers import values

    named = {**pairs(args.map, "--map", "P=col3"), **pairs(args.node, "--node", "P=NODE")}
    loads = {name: law.unit for name, law in monitor.laws.loads.items()}
    return SourceOptions(
        loads=loads, needs=monitor.laws.conditions, given=conditions_of(args, monitor.laws), map=named,
        units=pairs(args.unit, "--unit", "P=W"), scales=values(args.scale, "--scale"),
        replay=speed_of(args.replay), rate=args.rate, after=after, from_end=args.from_end, silent=args.silent,
        certificate=args.certificate, key=args.key, server_certificate=args.server_certificate, user=args.user,
        password_file=args.password_file, python=args.python,
    )  # fmt: skip


def speed_of(words: str | None) -> float | None:
    """The speed of a replay.

    >>> speed_of("100x"), speed_of("max"), speed_of(None)
    (100.0, inf, None)
    """
    if words is None:
        return None
    if words == "max":
        return float("inf")
    try:
        speed = float(words.removesuffix("x"))
    except ValueError:
        speed = 0.0
    if not 0 < speed < float("inf"):
        raise UsageError(f"--replay {words}: give a speed such as 1x or 100x, or max.")
    return speed
