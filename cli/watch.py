"""``fitmodels watch``: wear and remaining life of the edge in use, beside a running machine or from a recorded run."""

import argparse
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from time import sleep
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import UsageError
from ..core.files import locked_folder, make_folder
from . import keep_running
from .arguments import Parser, parameter_file, typed
from .numbers import constants, measured
from .output import Printer, line_writer, output_options, print_json, print_lines
from .watch_options import (
    check_options,
    conditions_of,
    control_of,
    control_options,
    criterion_of,
    edge_options,
    requests_of,
    source_options,
    source_options_of,
)

if TYPE_CHECKING:
    from ..live.monitor import Monitor
    from ..live.watching import Outlet, Watch
    from ..parameters import ParameterFile

BUSY: Final = "{folder}: another fitmodels watch keeps its journal there; give another folder with --journal."
LEFT: Final = "Left for the process that watches with this journal; it takes it in within a second."


def parser() -> Parser:
    """Arguments of ``fitmodels watch``."""
    p = Parser(
        "fitmodels watch",
        "fitmodels watch params.json --from run.csv --replay 100x",
        "Estimate wear and remaining life of the edge in use from its loads, beside a running machine or in a\n"
        "recorded run, and the moment to change it at a stated risk. Nothing is written without --write.\n\n"
        "  run.csv, run.jsonl           a file that grows; a recorded run with --replay\n"
        "  opc.tcp://127.0.0.1:4840     an OPC UA server; --node P=NODE names values\n"
        "  linuxcnc; -                  LinuxCNC on this machine; lines from standard input\n\n"
        "With --journal and without --from: print the state of the journal, or pass --gauge, --new-edge or\n"
        "--acknowledge on to the process that watches with it.",
        main="--from --criterion --risk --journal --gauge --new-edge --measured --page --serve --replay --json",
    )
    p.add_argument(
        "params", metavar="PARAMS", help="params.json with a law of wear and laws of loads that depend on it"
    )
    p.add_argument("--from", dest="source", metavar="SOURCE", help="where readings come from (default: none)")
    p.add_argument(
        "--replay",
        metavar="100x",
        help="play a recorded run at this speed, or max (default: it grows)",
    )
    output_options(p, "print the last state as JSON (fitmodels.live/1)")
    group = p.add_argument_group("decision")
    group.add_argument("--criterion", metavar="VB=0.3mm", help="wear at the end of life (default: of the file)")
    group.add_argument("--risk", type=float, default=0.05, metavar="P", help="risk of being past it (default: 0.05)")
    group.add_argument("--least-cost", action="store_true", help="change at least cost, with the costs of the file")
    group.add_argument("--next-cut", metavar="2.5min", help="time of the next cut (default: median of the cuts)")
    group.add_argument("--level", type=float, default=0.90, metavar="P", help="of the intervals (default: 0.90)")
    edge_options(p)
    source_options(p)
    control_options(p)
    group = p.add_argument_group("output")
    group.add_argument(
        "--page", nargs="?", type=int, const=0, metavar="PORT", help="a page for this machine alone (default: none)"
    )
    group.add_argument(
        "--serve", metavar="ADDRESS", help="to be read by OPC UA: opc.tcp://127.0.0.1:4841 (default: none)"
    )
    group.add_argument("--stream", metavar="FILE", help="lines of JSON; - is standard output (default: none)")
    return p


def run(args: argparse.Namespace) -> int:
    """Watch, or act on a journal, and return the exit code."""
    pf = parameter_file(args.params)
    check_options(args)
    if args.drift is not None:
        return _drift(args, pf)
    monitor = _monitor(args, pf)
    asked = requests_of(args, pf)
    if args.measured is not None:
        return _learn(args, pf, monitor)
    if args.source is None:
        return _without_source(args, monitor, asked)
    with ExitStack() as stack:
        return _watch(args, pf, monitor, asked, stack)


def _monitor(args: argparse.Namespace, pf: "ParameterFile") -> "Monitor":
    from .. import parameters
    from ..live.live_laws import LiveLaws
    from ..live.monitor import Monitor
    from ..live.watch_edge import WatchSettings
    from ..parameters.file_format import content_sha256

    draws = parameters.read_draws(pf, Path(args.params).parent)
    laws = LiveLaws.of(pf, draws, by=args.by)
    if args.least_cost and pf.costs is None:
        raise UsageError(f"--least-cost: {args.params} has no costs; add them with fitmodels costs {args.params}.")
    settings = WatchSettings(
        criterion=criterion_of(args, laws), risk=args.risk,
        costs=pf.costs if args.least_cost else None, level=args.level,
        next_cut=None if args.next_cut is None else measured(args.next_cut, "min", "--next-cut", "2.5min"),
    )  # fmt: skip
    identity = {
        "tool": pf.identity.tool, "work": pf.identity.work, "simulated": bool(pf.identity.simulated),
        "content": content_sha256(pf.model_dump(exclude_unset=True)),
    }  # fmt: skip
    return Monitor(laws, settings, identity)


def _without_source(args: argparse.Namespace, monitor: "Monitor", asked: list[dict[str, Any]]) -> int:
    """Pass requests on to the journal and print its state; a process that watches takes them in."""
    from ..live.facts import Reading, facts_of
    from ..live.watch_journal import journal_files

    folder = Path(args.journal)
    if not journal_files(folder):
        raise UsageError(f"{folder}: holds no journal of a watch; begin one with --from SOURCE --journal {folder}.")
    if not _pass_on(folder, monitor, asked):
        if asked:
            print_lines([LEFT], quiet=args.quiet)
            return 0
        _restore(folder, monitor)
    if monitor.refused:
        raise UsageError(" ".join(monitor.refused))
    messages = monitor.take_messages()
    source = {"name": monitor.source, "state": "not watched by this command", "text": "", "age": None}
    facts = facts_of(monitor, Reading(time=monitor.time, state="stopped", source=source))
    if not args.json:
        print_lines(messages, quiet=args.quiet)
    _print_state(args, facts)
    return 0


def _pass_on(folder: Path, monitor: "Monitor", asked: list[dict[str, Any]]) -> bool:
    """Leave requests at a journal, and take them in; False where another process watches, which takes them in."""
    from ..live.watch_journal import leave_request
    from ..live.watching import take_requests

    for request in asked:
        leave_request(folder, request)
    busy = BUSY.format(folder=folder)
    try:
        with locked_folder(folder, busy, 0.0):
            take_requests(folder, monitor)
    except UsageError as failure:
        if str(failure) != busy:
            raise
        return False
    return True


def _restore(folder: Path, monitor: "Monitor") -> None:
    """The state of a journal that another process may be writing."""
    from ..live.watch_journal import read_newest, restore

    newest = read_newest(folder)
    if newest is None:
        raise UsageError(f"{folder}: holds no journal of a watch; begin one with --from SOURCE --journal {folder}.")
    restore(newest, monitor)


def _learn(args: argparse.Namespace, pf: "ParameterFile", monitor: "Monitor") -> int:
    """Write the next version of the parameter file from a measured edge, and begin a new edge in the journal."""
    from datetime import UTC, datetime

    from ..live.learning import learn_file, parse_measured
    from ..live.watch_edge import Edge

    folder = Path(args.journal)
    _restore(folder, monitor)
    edges = {edge.number: edge for edge in (*map(Edge.from_json, monitor.finished), monitor.edge) if edge.minutes > 0}
    number = args.edge if args.edge is not None else max(edges, default=0)
    if number not in edges:
        those = f"edge {number} has not cut; choose one that has with --edge: {', '.join(map(str, edges))}."
        raise UsageError(f"{folder}: {those if edges else 'no edge has cut yet, so there is no wear to learn from.'}")
    summary = edges[number].summary
    summary.edge = f"{monitor.label} {number}"
    summary.measured(*parse_measured(pf, args.measured))
    new = learn_file(
        args.params, [summary], batch=args.batch, conditions=constants(args.value), command=typed(args.words),
        created=datetime.now(UTC).date().isoformat(), certain=args.certain,
    )  # fmt: skip
    lines = list(new.lines)
    if number == monitor.edge.number and not _pass_on(folder, monitor, [{"kind": "edge"}]):
        lines.append(LEFT)
    if args.json:
        print_json("watch-learned", {"file": str(new.path), "edge": summary.edge, "lines": lines})
    else:
        out = Printer(quiet=args.quiet)
        out.wrote("\n".join(lines), *([] if new.path is None else [new.path]))
    return 0


def _drift(args: argparse.Namespace, pf: "ParameterFile") -> int:
    """Print the exponents of the laws over batches, and draw them where a file is named."""
    from io import BytesIO

    from rich.table import Table

    from ..core.files import write_whole
    from ..core.plotting import save_figure
    from ..parameters.gather.learned import drift

    found = drift(pf)
    if args.json:
        print_json("watch-drift", {"rows": [asdict(row) for row in found.rows]})
        return 0
    out, table = Printer(quiet=args.quiet), Table(box=None, header_style="bold")
    for head in ("law", "batch", "edges", "level against the first fit", "exponents of all edges so far"):
        table.add_column(head)
    for row in found.rows:
        level = "" if row.shift is None or row.se is None else f"{row.shift:+.3f} ± {row.se:.3f}"
        exponents = ", ".join(f"{name} {value:.3f} ± {se:.3f}" for name, (value, se) in row.estimates.items())
        table.add_row(row.response, row.batch, str(row.edges), level, exponents)
    out.show(table)
    if args.drift:
        with BytesIO() as held:
            save_figure(found.plot().figure, held, format="png", dpi=110, metadata={"Software": None})
            write_whole(args.drift, held.getvalue())
        out.wrote(f"Figure: {args.drift}", args.drift)
    return 0


def _watch(
    args: argparse.Namespace, pf: "ParameterFile", monitor: "Monitor", asked: list[dict[str, Any]], stack: ExitStack
) -> int:
    """Watch a source until it ends or the user ends it."""
    from ..live.advice import Bounds
    from ..live.control import ControlOutlet
    from ..live.cuts import Cuts
    from ..live.facts import facts_of
    from ..live.sources import open_source
    from ..live.watching import Watch, open_journal

    control = control_of(args, pf)
    if control is not None:
        stack.callback(control.close)
    journal, after = None, None
    if args.journal is not None:
        folder = Path(args.journal)
        make_folder(folder, "--journal")
        stack.enter_context(locked_folder(folder, BUSY.format(folder=folder), 0.0))
        journal, after = open_journal(folder, monitor, args.source)
    source = open_source(args.source, source_options_of(args, monitor, after))
    stack.callback(source.close)
    given = conditions_of(args, monitor.laws)
    cuts = Cuts(constants=given, whole=tuple(args.whole or ()), rest=args.rest, seconds=args.window)
    if monitor.air is not None:
        cuts.resume(monitor.air)
    out = Printer(quiet=args.quiet or args.json or args.stream == "-")
    outlets, lines = _outlets(args, out, stack)
    watch = Watch(
        monitor,
        cuts,
        source.name,
        journal=journal,
        outlets=outlets,
        params=Path(args.params),
    )
    watch.bounds = Bounds.of(pf, monitor.laws)
    if control is not None:
        outlets.append(ControlOutlet(control, watch))
        watch.now.control = control.session.facts()
        watch.outlets = outlets
    for line in (*_first_lines(args, monitor), *lines):
        out.show(line)
    if out.is_terminal:
        outlets.append(_screen(out, stack))
        watch.outlets = outlets
    for request in asked:
        watch.record(**{"time": monitor.time, **request})
    keep_running()
    with _stopped() as stopped:
        watch.run(source, stopped)
        if out.is_terminal and (args.page is not None or args.serve):
            _stay(watch, stopped)
    if control is not None:
        control.close()
        watch.now.control = control.session.facts()
    facts = facts_of(monitor, watch.now)
    stack.close()
    if args.json or (args.stream != "-" and not out.is_terminal):
        _print_state(args, facts)
    return 0


def _outlets(args: argparse.Namespace, out: Printer, stack: ExitStack) -> "tuple[list[Outlet], list[str]]":
    """Outlets that show and pass on the state, and lines that name their places."""
    from ..live.stream import JsonLines, file_writer
    from ..live.view import PlainLines

    outlets: list[Outlet] = []
    lines = []
    if args.stream is not None:
        outlets.append(JsonLines(line_writer() if args.stream == "-" else file_writer(Path(args.stream))))
    if args.page is not None:
        from ..live.page import Page

        page = Page(args.page)
        outlets.append(page)
        lines.append(f"Page, for this machine alone: {page.address}")
    if args.serve is not None:
        from ..live.server import OpcUaServer, address_of

        server = OpcUaServer(address_of(args.serve))
        outlets.append(server)
        lines.append(f"OPC UA server, read-only: {server.address}, object fitmodels")
    if not out.is_terminal:
        outlets.append(PlainLines(out.show))
    for outlet in outlets:
        stack.callback(outlet.close)
    return outlets, lines


def _screen(out: Printer, stack: ExitStack) -> "Outlet":
    """The view of a terminal."""
    from ..live.view import ScreenView

    view = ScreenView(out.renewed())
    stack.callback(view.close)
    return view


def _first_lines(args: argparse.Namespace, monitor: "Monitor") -> Iterator[str]:
    """First lines: the watched source and the assumptions."""
    from ..live.facts import SHADOW

    laws, identity = monitor.laws, monitor.identity
    loads = ", ".join(n for n, law in laws.loads.items() if law.shows_wear) or "none: by the time of contact alone"
    simulated = "; the laws are from simulated tests" if identity["simulated"] else ""
    yield f"{identity['tool']} on {identity['work']}: wear {laws.wear.symbol}, loads {loads}{simulated}"
    unit, limit = laws.wear.unit, monitor.estimate.criterion
    yield f"criterion {laws.wear.symbol} {limit:g} {unit}, risk {monitor.settings.risk:g}"
    if monitor.settings.costs is not None and monitor.settings.costs.failure is None:
        yield "The file states no cost of a failed edge (failure=40 of fitmodels costs): it is changed at the risk."
    yield from laws.notes
    if args.write:
        yield "Writing reference and feed limit, once the controller was seen to trip by its heartbeat."
    else:
        yield f"{SHADOW[0].upper()}{SHADOW[1:]}."
    if args.journal is None:
        yield "No journal: nothing is kept after the end; --journal FOLDER keeps it."


def _stay(watch: "Watch", stopped: Callable[[], bool]) -> None:
    """Keep page and server of a run that has ended until the user ends the command."""
    watch.monitor.note(watch.now.time, "the run has ended; page and server stay until Ctrl-C.")
    watch.show()
    while not stopped():
        sleep(0.2)


@contextmanager
def _stopped() -> Iterator[Callable[[], bool]]:
    """Whether the user has ended the command, by Ctrl-C or a signal of the system; a second one ends it at once."""
    asked: list[int] = []

    def note(number: int, _: object) -> None:
        if asked:
            raise KeyboardInterrupt("ended at once; the journal holds all records so far.")
        asked.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _print_state(args: argparse.Namespace, facts: dict[str, Any]) -> None:
    """The state as JSON or as the view of a terminal."""
    from ..live.view import screen

    if args.json:
        print_json("live", {name: value for name, value in facts.items() if name != "schema"})
    else:
        Printer(quiet=args.quiet).show(screen(facts))
