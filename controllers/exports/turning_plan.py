"""The recursive plan of AC-2017 on a part: the moves that cut its passes.

Minutes in the cut become lengths, speeds become spindle speeds. An edge begins a pass only if its plan lasts to the end
of the pass; a new edge begins the plan anew. Words are rounded down, so that no speed and no feed exceeds the plan.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Final

import numpy as np

from ...core.errors import UsageError
from ...datasets.units import convert, same_dimension
from ..recursion.from_file import life_laws, outside_tests
from ..recursion.laws import response_at_end
from ..recursion.plan import Plan
from .turning_job import (
    CLOSE,
    FOOT,
    INCH,
    MOST_PARTS,
    Interval,
    Move,
    PlannedEdge,
    Stretch,
    TurningJob,
    TurningPlan,
    require_passes,
)

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.load_line import Range

SETTLE: Final = 2.0  # s that a spindle is given to reach a new speed
MOST_MOVES: Final = 20_000
SAME: Final = 1e-9  # of a limit


def part_plan(pf: "ParameterFile", plan: Plan, job: TurningJob) -> tuple[TurningPlan, tuple[str, ...]]:
    """The moves of a job by a plan with the limits of the file, and sentences on what is extrapolated."""
    limits = pf.limits
    spindle = _range(None if limits is None else limits.spindle_speed, "1/min")
    highest = min(job.max_rpm or spindle[1], spindle[1])
    if not highest < float("inf"):
        raise UsageError(
            "the highest spindle speed is not known: give --max-rpm 2500, or `fitmodels limits params.json "
            "n=50:2500rev/min`."
        )
    fastest = _range(None if limits is None else limits.feed_rate, "mm/min")[1]
    edge = planned_edge(pf, plan, job)
    return _judged(pf, plan, moves_of(edge, replace(job, max_rpm=highest), spindle, fastest))


def planned_edge(pf: "ParameterFile", plan: Plan, job: TurningJob) -> PlannedEdge:
    """The rows of a plan, and the laws of the further depths of a job.

    Raises
    ------
    UsageError
        Several depths with an objective other than removal.
    """
    life, options = plan.life, plan.options
    rows = tuple(
        Interval(k + 1, row.start, row.end, life.before(k), row.V, row.f, row.tested) for k, row in enumerate(plan.rows)
    )
    stated = dict.fromkeys(one.depth for passed in job.passes for one in passed if one.depth is not None)
    depths = [d for d in stated if abs(d - life.laws.d) > 1e-9]
    if depths and options.objective != "removal":
        raise UsageError(
            f"depths of {', '.join(f'{d:g}' for d in depths)} mm next to {life.laws.d:g} mm: objective "
            f"{options.objective} plans a whole life at one depth; use --objective removal."
        )
    others = tuple(life_laws(pf, d=d, by=options.by, at=options.at) for d in depths)
    return PlannedEdge(rows, life.laws, others, life.rules, life.grid, latest=options.time or float("inf"))


def _range(given: "Range | None", unit: str) -> tuple[float, float]:
    """A range of the machine in a unit; unlimited without one."""
    if given is None:
        return 0.0, float("inf")
    if not same_dimension(given.unit, unit):
        raise UsageError(f"a limit of the machine is in {given.unit!r}; it must be a unit of the kind of {unit}.")
    low, high = convert(np.array([given.low, given.high]), given.unit, unit)
    return float(low), float(high)


def _judged(pf: "ParameterFile", plan: Plan, part: TurningPlan) -> tuple[TurningPlan, tuple[str, ...]]:
    """The moves with what is outside the tests at another depth or a lowered speed, and sentences on all of it."""
    lines = dict.fromkeys(() if part.edge.others else plan.extrapolated)
    inside = {id(move): move.tested for move in part.moves}
    changed = [move for move in part.moves if move.lowered or part.edge.others]
    for d, group in groupby(sorted(changed, key=lambda move: move.depth), key=lambda move: move.depth):
        moves, laws = list(group), part.edge.laws_at(d)
        path = {
            "V": np.array([move.speed if move.lowered else move.V for move in moves]),
            "f": np.array([move.feed(part.job) if move.lowered else move.f for move in moves]),
            "t": np.array([move.end for move in moves]),
            laws.wear.response: np.array([move.wear for move in moves]),
        }
        tested, words = outside_tests(pf, laws, path, plan.options.at, plan.options.by)
        inside |= {id(move): bool(one) for move, one in zip(moves, tested, strict=True)}
        lines |= dict.fromkeys(words)
    return replace(part, moves=tuple(replace(m, tested=inside[id(m)]) for m in part.moves)), tuple(lines)


def moves_of(
    edge: PlannedEdge, job: TurningJob, spindle: tuple[float, float] = (0.0, math.inf), feed_rate: float = math.inf
) -> TurningPlan:
    """The moves that cut a job by the plan.

    Parameters
    ----------
    edge : PlannedEdge
    job : TurningJob
    spindle : (float, float)
        Range of the spindle speed, 1/min; the job's highest counts where that is lower.
    feed_rate : float
        Highest feed speed, mm/min.

    Raises
    ------
    UsageError
        The geometry cannot be cut, a pass outlasts an edge, or the limits of the machine cannot be kept.
    """
    require_passes(job.passes, edge.laws.d)
    if not edge.rows:
        raise UsageError("the plan is empty: no pair of speed and feed keeps the limits on a new edge.")
    return TurningPlan(job, edge, tuple(_Walk(edge, job, spindle, feed_rate).moves()))


@dataclass(frozen=True, slots=True)
class _Words:
    """S and F of a row on a diameter, with what they give."""

    S: float
    F: float
    n: float  # 1/min
    f: float  # mm/rev
    lowered: bool


@dataclass(slots=True)
class _Walk:
    """The job walked through pass by pass: the edge's number, minutes and wear."""

    edge: PlannedEdge
    job: TurningJob
    spindle: tuple[float, float]
    feed_rate: float
    number: int = 1
    minutes: float = 0.0
    wear: float = 0.0

    def moves(self) -> Iterator[Move]:
        """All moves in the order of the cut."""
        self.minutes, self.wear, count, part = self.job.start, 0.0, 0, 0
        if self.minutes:
            self.wear = self.edge.wear_from(self.minutes)
        while self.job.parts is None or part < self.job.parts:
            part += 1
            made = self._part(part)
            if self.job.parts is None and part > 1 and self.number > 1:
                return  # a part that the first edge does not finish is not begun
            count += len(made)
            if count > MOST_MOVES:
                raise UsageError(
                    f"the program has more than {MOST_MOVES} cuts: give fewer --parts, or a longer --interval."
                )
            yield from made
            if self.job.parts is None and (self.number > 1 or part == MOST_PARTS):
                return

    def _part(self, part: int) -> list[Move]:
        made: list[Move] = []
        for number, passed in enumerate(self.job.passes, 1):
            moves = self._pass(part, number, passed)
            if moves is None:
                fresh = self.minutes <= CLOSE
                if not fresh:
                    self.number, self.minutes, self.wear = self.number + 1, 0.0, 0.0
                    moves = self._pass(part, number, passed)
                if moves is None:
                    raise UsageError(
                        f"pass {number} outlasts a new edge, whose plan ends after {self.edge.end:.4g} min: shorten "
                        "the pass, or choose a longer life, such as --objective life."
                    )
            made += moves
            self.minutes, self.wear = moves[-1].end, moves[-1].wear
        return made

    def _pass(self, part: int, number: int, passed: Sequence[Stretch]) -> list[Move] | None:
        """The moves of a pass with the present edge; None where it is worn out before their end."""
        minutes, wear, z, made = self.minutes, self.wear, 0.0, list[Move]()
        row: Interval | None = None
        last: _Words | None = None
        for one, of in self._ahead(passed):
            d, end = of.depth or self.edge.laws.d, z + one.length
            turned = one.diameter - 2 * (one.depth or self.edge.laws.d)
            if self.edge.others:
                row = None  # the pair depends on the depth
            while end - z > CLOSE:
                if row is None or minutes >= row.end - CLOSE:
                    row = self.edge.interval(minutes, wear, d)
                if row is None:
                    return None
                words = self._words(row, of.diameter, d, turned)
                F, settle = self._settled(last, words)
                rate = self._rate(F, words.n)
                lasts = min(row.end - minutes, settle, (end - z) / rate)
                z = end if lasts * rate >= end - z - CLOSE else z + lasts * rate
                start, minutes = minutes, minutes + lasts
                wear = self.edge.wear_at(row, min(minutes, row.end), d)
                made.append(Move(
                    self.number, part, number, row.row, start, minutes, of.diameter, d, self._length(turned),
                    -self._length(z), words.S, F, row.V, row.f, words.n, wear, F < words.F, words.lowered, row.tested,
                ))  # fmt: skip
                held = F < words.F and lasts < settle - CLOSE  # the spindle has not had its time yet
                last = replace(words, F=F, f=min(words.f, last.f)) if held and last is not None else words
        return _merged(made)

    def _ahead(self, passed: Sequence[Stretch]) -> Iterator[tuple[Stretch, Stretch]]:
        """Stretches, each with the one whose pair it is cut with: the end before a larger depth has that one's.

        So the spindle has the speed of the larger depth when this begins.
        """
        base = self.edge.laws.d
        for one, after in zip(passed, [*passed[1:], passed[-1]], strict=True):
            if (after.depth or base) <= (one.depth or base) + CLOSE:
                yield one, one
                continue
            fastest = 1000.0 * self.edge.laws.V[1] / (math.pi * one.diameter)
            lead = min(2 * SETTLE / 60.0 * min(fastest, self.fastest) * self.edge.laws.f[1], one.length)
            if one.length - lead > CLOSE:
                first = replace(one, length=one.length - lead)
                yield first, first
            yield replace(one, length=lead), after

    @property
    def fastest(self) -> float:
        """Highest spindle speed, a whole number of 1/min."""
        return float(math.floor(min(self.job.max_rpm, self.spindle[1])))

    def _rate(self, F: float, n: float) -> float:
        """mm/min of a word F at a spindle speed."""
        return F * (n if self.job.feed == "G95" else 1.0) * (INCH if self.job.inch else 1.0)

    def _settled(self, last: _Words | None, words: _Words) -> tuple[float, float]:
        """F, and minutes for which it holds: the smaller feed until the spindle has its new speed, then the row's.

        The new speed begins with the smaller of both feeds, and with the smaller of both spindle speeds in feed per
        minute, so that neither chip thickness nor feed at the higher speed exceeds those of both rows.
        """
        if last is None or abs(last.n - words.n) <= SAME * words.n:
            return words.F, math.inf
        if self.job.feed == "G95":
            F, longer = min(last.F, words.F), max(last.n / words.n, 1.0)
        else:
            F, longer = self._F(min(last.f, words.f), min(last.n, words.n)), 1.0
        return (F, SETTLE / 60.0 * longer) if F < words.F else (words.F, math.inf)

    def _F(self, f: float, n: float) -> float:
        """The word F of a feed in mm/rev, rounded down."""
        feed = f / (INCH if self.job.inch else 1.0) * (1.0 if self.job.feed == "G95" else n)
        return down(feed, (4 if self.job.feed == "G95" else 1) + 2 * self.job.inch)

    def _length(self, mm: float) -> float:
        """A word X or Z."""
        return round(mm / INCH, 4) if self.job.inch else round(mm, 3)

    def _words(self, row: Interval, diameter: float, d: float, turned: float) -> _Words:
        """S and F of a row on a diameter, both rounded down and within the limits of the machine.

        G96 holds the speed at the position of the tool, the turned diameter, so S is smaller than the speed at the
        diameter before the cut, for which the laws state it.
        """
        digits = 0 if self.job.dialect == "fanuc" else 1
        if self.job.speed == "G97":
            asked = down(1000.0 * row.V / (math.pi * diameter), digits)
            S = n = min(asked, self.fastest)
        else:
            unit = FOOT if self.job.inch else 1.0
            S = down(row.V * turned / diameter / unit, digits)
            asked = 1000.0 * S * unit / (math.pi * self._length(turned) * (INCH if self.job.inch else 1.0))
            n = min(asked, self.fastest)
        if n < self.spindle[0] or n <= 0:
            raise UsageError(
                f"{row.V:g} m/min on a diameter of {diameter:g} mm is {n:.4g} 1/min, below the lowest spindle "
                f"speed of {self.spindle[0]:g} 1/min; set limits V from a higher speed."
            )
        f = row.f if n == asked else self._within(row, diameter, d, math.pi * diameter * n / 1000.0)
        held = min(f, self.feed_rate / n)
        F = self._F(held, n)
        if F <= 0:
            raise UsageError(f"a feed of {held:.3g} mm/rev is rounded to 0 in {self.job.F_unit}; use --mm or G94.")
        return _Words(S, F, n, held, n < asked or held < row.f)

    def _within(self, row: Interval, diameter: float, d: float, V: float) -> float:
        """The largest feed up to that of the row that keeps power and force at a lower speed, mm/rev.

        Force may rise as the speed falls, so the pair of the row at the highest spindle speed may exceed its limit.
        """
        laws, rules = self.edge.laws_at(d), self.edge.rules

        wear = self.edge.wear_at(row, row.end, d)  # of the row: the lower speed wears less

        def kept(f: float) -> bool:
            ends = (float(response_at_end(terms, rules, V, f, row.end, wear)) / terms.most for _, terms in laws.limited)
            return max(*ends, 0.0, 0.0) <= 1.0 + SAME

        low, high = laws.f[0], row.f
        if kept(high):
            return high
        if not kept(low):
            raise UsageError(
                f"the highest spindle speed allows {V:.4g} m/min on a diameter of {diameter:g} mm, where no feed "
                "keeps the limits of power and force; turn this diameter with a smaller depth."
            )
        for _ in range(60):
            middle = math.sqrt(low * high)
            low, high = (middle, high) if kept(middle) else (low, middle)
        return low


def down(value: float, digits: int) -> float:
    """A number rounded down to so many decimals; one that is already there but for its last bits stays.

    >>> down(2499.7, 0), down(0.58, 4), down(131.29, 1)
    (2499.0, 0.58, 131.2)
    """
    scale = 10.0**digits
    return math.floor(value * scale * (1 + 1e-12)) / scale


def _merged(moves: list[Move]) -> list[Move]:
    """The moves without those that end where the last ended."""
    kept: list[Move] = []
    for move in moves:
        if kept and abs(kept[-1].Z - move.Z) < CLOSE:
            kept[-1] = replace(kept[-1], end=move.end, wear=move.wear)
        else:
            kept.append(move)
    return kept
