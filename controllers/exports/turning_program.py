"""The recursive plan as an NC program for turning, and as CSV.

LinuxCNC: G7 G18, G96 D.. S.. with the highest spindle speed in D, G95 or G94. Fanuc, lathe system A: G50 S.. for the
highest spindle speed, G99 or G98 in place of G95 and G94. F follows each change of the feed mode, which resets it.

Sources: LinuxCNC 2.9 documentation, G-codes (G4, G7, G94, G95, G96, G97); Fanuc Series 0i-TF operator's manual
B-64604EN-1, G-code system A.
"""

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby
from textwrap import wrap
from typing import TYPE_CHECKING, Final

from ...core.errors import GateError, UsageError
from ...core.version import __version__
from ...parameters.checks.report import require_verdicts
from ...parameters.exports.names import gcode_text, plain, plain_lines, plain_unit
from ...parameters.exports.view import NO_SAFETY, require_check
from ...parameters.file_format import content_sha256
from ...parameters.setting_words import power_limit_words
from ..recursion.from_file import require_checked, require_near_tests
from ..recursion.laws import held_by_moves
from ..recursion.life import no_pair
from ..recursion.plan import Plan, PlanOptions, plan_of
from .turning_job import CLEAR, FOOT, INCH, Move, TurningJob, TurningPlan
from .turning_plan import SETTLE, part_plan

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws

NOT_IN_NC: Final = (
    "the offsets of work and tool: Z 0 is the end face, X is a diameter",
    "the way from the tool change to the work, a tailstock, coolant: try the program in single block, off the work",
    "the wear itself: the plan follows the minutes in the cut, so inspect the edge",
)
NOT_IN_CSV: Final = ("the laws and their uncertainty",)
WIDTH: Final = 100
RISK: Final = 0.05  # of new edges: more that are worn out within the plan are worth a shorter one


@dataclass(frozen=True, slots=True)
class TurningRequest:
    """Plan and part of an export: options of the plan, and the job; None for the plan of an edge alone."""

    options: PlanOptions = field(default_factory=PlanOptions)
    job: TurningJob | None = None
    inch: bool = False
    beyond_tests: str = ""  # reason that accepts a plan far beyond the tests


@dataclass(frozen=True, slots=True)
class TurningExport:
    """A plan with its part, origin and remarks, from which the files are written.

    Attributes
    ----------
    plan : Plan
    part : TurningPlan or None
        None without the geometry of a part.
    origin : tuple of str
        Pair, simulated mark, verdicts, what is extrapolated, and the checksum of the parameter file.
    remarks : tuple of str
        Limits of use, settings and assumptions.
    marks : tuple of str
        What each row of a table states.
    """

    plan: Plan
    part: TurningPlan | None
    origin: tuple[str, ...]
    remarks: tuple[str, ...]
    marks: tuple[str, ...] = ()
    inch: bool = False

    @property
    def summary(self) -> tuple[str, ...]:
        """Parts, edges and minutes."""
        part, rows = self.part, f"{len(self.plan.rows)} rows"
        if part is None:
            return (f"plan of one edge: {rows}, {self.plan.minutes:.4g} min, {self.plan.removed / 1000:.4g} cm3",)
        last = part.moves[-1]
        count = f"{last.part} part{'s' * (last.part > 1)}, {part.edges} edge{'s' * (part.edges > 1)}"
        of, spent = "" if part.edge.others else f" of {part.edge.end:.4g}", math.ceil(100 * last.end) / 100
        after = f"the last edge has then cut {spent:.2f}{of} min: go on with --from {spent:.2f}min"
        return (
            f"{count}, {len(part.moves)} cut{'s' * (len(part.moves) > 1)}, {part.minutes:.4g} min in the cut",
            after,
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines for the person who exports it."""
        return (*self.summary, *self.origin[1:-1], *self.remarks)


def turning_export(
    pf: "ParameterFile",
    request: TurningRequest,
    *,
    draws: Mapping[str, "Draws"] | None = None,
    seed: int = 1,
    accept_verdict: bool = False,
) -> TurningExport:
    """The plan of a file on a part, ready to be written.

    Raises
    ------
    GateError
        The file fails its check, a law of the plan must not be used for control, or the plan does not apply a limit.
    UsageError
        No plan keeps the limits, or the part cannot be cut by it.
    """
    untried = (*require_check(pf), *power_limit_words(pf.limits, pf.laws, pf.costs))
    plan = plan_of(pf, draws, request.options, seed)
    if not plan.rows:
        raise GateError(f"not exported: {no_pair(plan.life, plan.extrapolated)}")
    used = (plan.laws.wear.response, *(terms.response for _, terms in plan.laws.limited))
    verdicts = require_verdicts(pf, accept_verdict, only=used)
    part, outside = (None, plan.extrapolated) if request.job is None else part_plan(pf, plan, request.job)
    depths, path = ((plan.laws,), plan.life.path) if part is None else ((plan.laws, *part.edge.others), part.path)
    left_out = require_checked(pf, plan.laws, accept_verdict)
    said_first = (*left_out, *require_near_tests(pf, depths, path, request.beyond_tests))
    simulated = {True: "SIMULATED data, not measured", None: "not known whether the data were measured or SIMULATED"}
    said, who = simulated.get(pf.identity.simulated, ""), pf.identity
    pair = f"tool {plain(who.tool)}, work {plain(who.work)}, machine {plain(who.machine or 'not named')}"
    checksum = f"parameter file {pf.content_sha256 or content_sha256(pf.model_dump())}"
    doubts, inch = () if pf.reading is None else pf.reading.doubts, request.inch if part is None else part.job.inch
    doubted = (f"the data are right although the reading doubts them: {doubt.sentence}" for doubt in doubts)
    assumed = (*doubted, *untried, *(plan.assumed if part is None else held_by_moves(plan.assumed)))
    return TurningExport(
        plan=plan,
        part=part,
        origin=(pair, *([said] if said else []), *verdicts, *said_first, *outside, checksum),
        remarks=(
            *NO_SAFETY, "calculated from the laws of the file, not measured: watch the first part and inspect the edge",
            *_chance(plan), *_settings(plan, inch), *([] if part is None else _words_of(part)),
            *(f"assumed: {words}" for words in assumed),
        ),
        marks=(
            *([said] if said else []), *(line for line in verdicts if line.startswith("VERDICT ACCEPTED")), *said_first
        ),
        inch=inch,
    )  # fmt: skip


def _chance(plan: Plan) -> tuple[str, ...]:
    """Share of new edges that the plan overtaxes, and the time that it should end after; empty without draws."""
    if plan.chance is None:
        return ()
    early, over = plan.chance.band("minutes", 1 - 2 * RISK)[0], plan.chance.exceeding
    words = f"of new edges drawn from the laws {100 * plan.chance.ends_early:.0f} % are worn out before the plan ends"
    if plan.chance.ends_early <= RISK:
        return (words, *over)
    return (f"{words}, {100 * RISK:.0f} % before {early:.3g} min: --time {early:.3g}min ends the plan there", *over)


def _settings(plan: Plan, inch: bool) -> tuple[str, ...]:
    """Objective, limits and rules of the plan."""
    laws, rules = plan.laws, plan.life.rules
    limits = [(laws.wear.response, laws.wear), *((terms.response, terms) for _, terms in laws.limited)]
    kept = ", ".join(f"{name} {terms.most:g} {plain_unit(terms.unit)}" for name, terms in limits)
    depth = f"{laws.d / INCH:.4g} in" if inch else f"{laws.d:g} mm"
    adds = "by the wear reached" if rules.wear == "wear_state" else "by the minutes of the edge"
    return (
        f"objective {plan.options.objective}, limits {kept}, depth {depth}",
        f"wear adds up {adds}, rows of {rules.interval:g} min, factors of time {rules.times}",
    )


def _words_of(part: TurningPlan) -> tuple[str, ...]:
    """Geometry, units and rules of the moves."""
    job, unit = part.job, part.job.length_unit
    k = INCH if job.inch else 1.0
    passes = "; ".join(
        " then ".join(
            f"diameter {one.diameter / k:.6g} to {(one.diameter - 2 * (one.depth or part.edge.laws.d)) / k:.6g} {unit} "
            f"over {one.length / k:.6g} {unit}" for one in passed
        )
        for passed in job.passes
    )  # fmt: skip
    surface = f"S in {job.S_unit} is the speed at the turned diameter: V holds at the diameter before the cut"
    return (
        f"passes of a part: {passes}; the first edge {f'has cut {job.start:g} min' if job.start else 'is new'}",
        f"X is a diameter in {unit}, Z 0 is the end face, the cut runs towards -Z in {unit}, F in {job.F_unit}",
        surface if job.speed == "G96" else "S in 1/min",
        f"highest spindle speed {math.floor(job.max_rpm)} 1/min; S and F are rounded down",
        *(["feed per revolution needs a spindle encoder"] if job.feed == "G95" else []),
        f"at a change of speed in the cut the smaller feed holds for {SETTLE:g} s, and the spindle has {SETTLE:g} s "
        "before each pass",
        f"at each M0 and at the end the tool stands {job.place}",
        *(["speed or feed is lowered below the plan in some cuts, for the limits of spindle and feed speed"]
          if any(move.lowered for move in part.moves) else []),
    )  # fmt: skip


def nc_program(made: TurningExport) -> str:
    """Content of the NC program.

    Raises
    ------
    UsageError
        The geometry of the part is missing.
    """
    part = made.part
    if part is None:
        raise UsageError(
            "an NC program needs the part: give --diameter 80mm --length 200mm, or --pass 80:200 for each pass, and "
            "--max-rpm; without a part the plan can be written with --to csv."
        )
    writer = _Linuxcnc(part.job) if part.job.dialect == "linuxcnc" else _Fanuc(part.job)
    head = (f"fitmodels {__version__}, recursive plan for turning", *made.origin, *made.remarks, *made.summary)
    head = (*head, *(f"not included: {words}" for words in NOT_IN_NC))
    lines = [*writer.begin(), *(writer.comment(line) for words in head for line in _wrapped(words))]
    lines += [*writer.modes(), *_cuts(part, writer), *writer.end()]
    return "\n".join(["%", *lines, "%", ""])


def _wrapped(words: str) -> list[str]:
    """Lines of a comment; text of the file is plain already, and what is not is replaced when the comment is made."""
    return wrap(words, WIDTH, subsequent_indent="  ") or [""]


class _Linuxcnc:
    """Words of LinuxCNC."""

    def __init__(self, job: TurningJob) -> None:
        self.job = job

    def begin(self) -> list[str]:
        return []

    def comment(self, words: str) -> str:
        return f"(fm - {gcode_text(_unmarked(words).replace('%', 'percent'))})"

    def modes(self) -> list[str]:
        return [f"{'G20' if self.job.inch else 'G21'} G18 G7 G40 G80 G90", *self.tool()]

    def tool(self) -> list[str]:
        return [] if self.job.tool is None else [f"T{self.job.tool} M6", "G43"]

    def start(self, S: str) -> str:
        cap = f" D{math.floor(self.job.max_rpm)}" if self.job.speed == "G96" else ""
        return f"{self.job.speed}{cap} S{S} M3"

    def wait(self) -> str:
        return f"G4 P{SETTLE:g}"

    def feed_mode(self) -> str:
        return self.job.feed

    def end(self) -> list[str]:
        return ["M5", *self.job.away(), "M2"]


class _Fanuc(_Linuxcnc):
    """Words of Fanuc, lathe system A."""

    def begin(self) -> list[str]:
        return ["O0001"]

    def comment(self, words: str) -> str:
        return super().comment(words).upper().replace("_", " ").replace("^", " ")

    def modes(self) -> list[str]:
        return [
            f"{'G20' if self.job.inch else 'G21'} G18 G40 G80",
            *self.tool(),
            f"G50 S{math.floor(self.job.max_rpm)}",
        ]

    def tool(self) -> list[str]:
        return [] if self.job.tool is None else [f"T{self.job.tool:02d}{self.job.tool:02d}"]

    def start(self, S: str) -> str:
        return f"{self.job.speed} S{S} M3"

    def wait(self) -> str:
        return f"G98 G4 U{SETTLE:g}."

    def feed_mode(self) -> str:
        return "G99" if self.job.feed == "G95" else "G98"

    def end(self) -> list[str]:
        return ["M5", *self.job.away(), "M30"]


MARKS: Final = str.maketrans({"(": "[", ")": "]", "'": None, '"': None, ":": " -", ";": ","})


def _unmarked(words: str) -> str:
    """Sentences without the marks that end a comment or are commands in one."""
    return words.translate(MARKS)


def _cuts(part: TurningPlan, writer: _Linuxcnc) -> Iterator[str]:
    """Blocks of all passes, with the changes of edges and parts."""
    job, before = part.job, replace(part.moves[0], edge=1, part=1, end=part.job.start)
    k = INCH if job.inch else 1.0
    clear = CLEAR / k
    for (edge, of, number), group in groupby(part.moves, key=lambda m: (m.edge, m.part, m.number)):
        moves = list(group)
        done = [f"part {before.part} is finished: load the next part"] * (of != before.part)
        done += [f"edge {before.edge} ends after {before.end:.2f} min: change the edge"] * (edge != before.edge)
        if done:
            yield from ("M5", *job.away(), *map(writer.comment, done), "M0")
            yield from writer.tool() if edge != before.edge else ()
        before = moves[-1]
        first = moves[0]
        yield writer.comment(f"edge {edge}, part {of}, pass {number}, minutes {first.start:.2f} to {before.end:.2f}")
        away = max(one.diameter for one in moves) / k + 2 * clear
        yield f"G0 X{job.coordinate(away)} Z{job.coordinate(clear)}"
        yield writer.start(_plain(first.S))
        yield f"G0 X{job.coordinate(first.X)}"
        yield writer.wait()
        yield from _pass_blocks(moves, writer)
        yield f"G0 X{job.coordinate(away)}"
        yield f"G0 Z{job.coordinate(clear)}"


def _pass_blocks(moves: list[Move], writer: _Linuxcnc) -> Iterator[str]:
    job, S, X = writer.job, moves[0].S, moves[0].X
    for k, move in enumerate(moves):
        words = [writer.feed_mode()] if k == 0 else []
        if move.X != X:
            yield " ".join([*words, f"G1 X{job.coordinate(move.X)} F{_plain(move.F)}"])
            words, X = [], move.X
        words += [f"S{_plain(move.S)}"] if move.S != S else []
        S = move.S
        yield " ".join([*words, f"G1 Z{job.coordinate(move.Z)} F{_plain(move.F)}"])


def _plain(value: float) -> str:
    """A word without exponent."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


def csv_table(made: TurningExport) -> str:
    """Content of the CSV: a row for each cut of a part, or for each row of the plan; every row has its marks."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    rows = list(_plan_rows(made) if made.part is None else _move_rows(made.part, made))
    units = _units(made)
    writer.writerow([f"{plain(name)} [{units[name]}]" if name in units else name for name in rows[0]])
    writer.writerows(list(row.values()) for row in rows)
    return out.getvalue()


def _units(made: TurningExport) -> dict[str, str]:
    length = "in" if made.inch else "mm"
    speed, wear = "ft/min" if made.inch else "m/min", plain_unit(made.plan.laws.wear.unit)
    job = None if made.part is None else made.part.job
    words = {} if job is None else {"S": job.S_unit, "F": job.F_unit, "X": length, "Z": length}
    return {
        "start": "min", "end": "min", "diameter": length, "d": length, "V": speed, "f": f"{length}/rev",
        "V set": speed, "n": "1/min", **{terms.response: plain_unit(terms.unit) for _, terms in made.plan.laws.limited},
        made.plan.laws.wear.response: wear, "MRR": "cm3/min", **words,
    }  # fmt: skip


def _digits(value: float) -> float:
    return float(f"{value:.6g}")


def _marks(made: TurningExport, tested: bool) -> str:
    found = [*made.marks, *([] if tested else ["EXTRAPOLATED"])]
    return " - ".join(line for words in found for line in plain_lines(words))


def _plan_rows(made: TurningExport) -> Iterator[dict[str, object]]:
    wear = made.plan.laws.wear.response
    inch, foot = (INCH, FOOT) if made.inch else (1.0, 1.0)
    for k, row in enumerate(made.plan.rows, 1):
        yield {
            "row": k, "start": _digits(row.start), "end": _digits(row.end), "d": _digits(row.d / inch),
            "V": _digits(row.V / foot), "f": _digits(row.f / inch), **({} if row.n is None else {"n": _digits(row.n)}),
            wear: _digits(row.wear), **{name: _digits(value) for name, value in row.responses.items()},
            "MRR": _digits(row.rate / 1000),
            "limited by": plain(" and ".join(row.limits) or "none"), "marks": _marks(made, row.tested),
        }  # fmt: skip


def _move_rows(part: TurningPlan, made: TurningExport) -> Iterator[dict[str, object]]:
    job, wear = part.job, made.plan.laws.wear.response
    k, foot = (INCH, FOOT) if job.inch else (1.0, 1.0)
    for move in part.moves:
        yield {
            "edge": move.edge, "part": move.part, "pass": move.number, "row": move.row, "start": _digits(move.start),
            "end": _digits(move.end), "diameter": _digits(move.diameter / k), "d": _digits(move.depth / k),
            "X": move.X, "Z": move.Z, "V": _digits(move.V / foot), "f": _digits(move.f / k),
            "V set": _digits(move.speed / foot), "n": _digits(move.n), "S": move.S, "F": move.F,
            wear: _digits(move.wear), "MRR": _digits(move.speed * move.feed(job) * move.depth),
            "settling": int(move.settling), "lowered": int(move.lowered), "marks": _marks(made, move.tested),
        }  # fmt: skip
