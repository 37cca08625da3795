"""A part to be turned, and its plan as moves: passes, diameters, lengths, depths, S and F."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from ...core.arrays import Array
from ...core.errors import UsageError
from ..recursion.interval_optimum import Grid, choose
from ..recursion.laws import LifeLaws, Rules, wear_after

Speed = Literal["G96", "G97"]
Feed = Literal["G95", "G94"]
Dialect = Literal["linuxcnc", "fanuc"]
INCH: Final = 25.4  # mm
FOOT: Final = 0.3048  # m
MOST_PARTS: Final = 1000
CLOSE: Final = 1e-9  # min, mm: rounding
NEAR: Final = 0.01  # mm: diameters and lengths are typed
CLEAR: Final = 2.0  # mm off the work


@dataclass(frozen=True, slots=True)
class Stretch:
    """A length of a pass with one diameter before the cut; depth None is that of the plan. All in mm."""

    diameter: float
    length: float
    depth: float | None = None


@dataclass(frozen=True, slots=True)
class TurningJob:
    """The part and the control: passes in the order of the cut, each from Z 0 towards the chuck.

    Attributes
    ----------
    passes : tuple of tuple of Stretch
        Of one part.
    max_rpm : float
        Highest spindle speed, 1/min; 0 for the limit of the file.
    parts : int or None
        None: as many as the first edge cuts, at least one.
    start : float
        Minutes that the first edge has cut already, by this plan.
    speed, feed, dialect
        Constant surface speed or spindle speed; feed per revolution or per minute; control.
    inch : bool
        Program in inches and ft/min.
    tool : int or None
        None: no tool is called.
    retract : tuple of float or None
        Diameter and Z, mm, where the tool stands at each stop and at the end; None: where the last pass leaves it.

    Raises
    ------
    UsageError
        A number that is not above zero, or a choice that does not exist.

    Examples
    --------
    >>> TurningJob(((Stretch(80.0, 200.0),),), max_rpm=2500.0).speed
    'G96'
    """

    passes: tuple[tuple[Stretch, ...], ...]
    max_rpm: float = 0.0
    parts: int | None = None
    start: float = 0.0
    speed: Speed = "G96"
    feed: Feed = "G95"
    dialect: Dialect = "linuxcnc"
    inch: bool = False
    tool: int | None = None
    retract: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, value, known in (
            ("--speed", self.speed, get_args(Speed)),
            ("--feed-mode", self.feed, get_args(Feed)),
            ("--dialect", self.dialect, get_args(Dialect)),
        ):
            if value not in known:
                raise UsageError(f"{name} {value}: give {' or '.join(known)}.")
        if self.max_rpm and not 1.0 <= self.max_rpm < math.inf:
            raise UsageError(f"a highest spindle speed of {self.max_rpm:g} 1/min: give at least 1 1/min.")
        if self.parts is not None and not 1 <= self.parts <= MOST_PARTS:
            raise UsageError(f"--parts {self.parts}: give 1 to {MOST_PARTS}.")
        if not 0 <= self.start < math.inf:
            raise UsageError(f"--from {self.start:g} min: give the minutes that the edge has cut, 0 or more.")
        if self.tool is not None and not 1 <= self.tool <= 99:
            raise UsageError(f"--tool {self.tool}: give 1 to 99.")
        if not self.passes or not all(self.passes):
            raise UsageError("the part has no pass; give --diameter and --length, or --pass.")
        largest = max(one.diameter for passed in self.passes for one in passed) + 2 * CLEAR
        if self.retract is not None and not (
            largest <= self.retract[0] < math.inf and CLEAR <= self.retract[1] < math.inf
        ):
            raise UsageError(
                f"--retract {self.retract[0]:g}:{self.retract[1]:g} (mm) is not clear of the work: give a diameter "
                f"of at least {largest:g} mm and a Z of at least {CLEAR:g} mm."
            )

    def coordinate(self, value: float) -> str:
        """A coordinate in the unit of the program, with its point, which Fanuc needs."""
        return f"{value:.4f}" if self.inch else f"{value:.3f}"

    @property
    def place(self) -> str:
        """Position of the tool while parts and edges are changed."""
        k = INCH if self.inch else 1.0
        if self.retract is not None:
            return f"at X {self.retract[0] / k:.6g}, Z {self.retract[1] / k:.6g}"
        far = "8:6" if self.inch else "200:150"
        return f"{CLEAR / k:.2g} {self.length_unit} off the work, too near for hands: --retract {far} takes it away"

    def away(self) -> list[str]:
        """Blocks that take the tool to the place of ``retract``, first along Z; none without one."""
        if self.retract is None:
            return []
        X, Z = (self.coordinate(value / (INCH if self.inch else 1.0)) for value in self.retract)
        return [f"G0 Z{Z}", f"G0 X{X}"]

    @property
    def length_unit(self) -> str:
        """Unit of X, Z and of the feed's length."""
        return "in" if self.inch else "mm"

    @property
    def S_unit(self) -> str:
        """Unit of S."""
        return "1/min" if self.speed == "G97" else "ft/min" if self.inch else "m/min"

    @property
    def F_unit(self) -> str:
        """Unit of F."""
        return f"{self.length_unit}/{'rev' if self.feed == 'G95' else 'min'}"


@dataclass(frozen=True, slots=True)
class Interval:
    """A row of the plan: minutes in the cut from ``start`` to ``end``, wear at its start, the pair of V and f.

    ``tested`` states whether the pair lies inside the tests.
    """

    row: int
    start: float
    end: float
    before: float
    V: float
    f: float
    tested: bool = True


@dataclass(frozen=True, slots=True)
class Move:
    """A straight cut along Z at one S and one F.

    Attributes
    ----------
    edge, part, number : int
        Edge, part and pass of the part, each from 1.
    row : int
        Row of the plan, from 1.
    start, end : float
        Minutes in the cut of the edge.
    diameter, depth : float
        Diameter before the cut and depth, mm; before a larger depth those of the cut that follows.
    X, Z : float
        Turned diameter, and Z at the end, as the program has them.
    S, F : float
        Words of the program.
    V, f : float
        The plan's speed, m/min at the diameter before the cut, and feed, mm/rev.
    n : float
        Spindle speed that S gives, 1/min.
    wear : float
        At the end, by the laws, in the unit of the wear.
    settling : bool
        Whether F is reduced while the spindle takes a new speed.
    lowered : bool
        Whether speed or feed are below those of the plan for the limits of the machine.
    tested : bool
        Whether speed, feed, depth, time and wear lie inside the tests.
    """

    edge: int
    part: int
    number: int
    row: int
    start: float
    end: float
    diameter: float
    depth: float
    X: float
    Z: float
    S: float
    F: float
    V: float
    f: float
    n: float
    wear: float
    settling: bool = False
    lowered: bool = False
    tested: bool = True

    @property
    def speed(self) -> float:
        """Cutting speed at the diameter before the cut that S gives, m/min."""
        return math.pi * self.diameter * self.n / 1000.0

    def feed(self, job: TurningJob) -> float:
        """Feed that F gives, mm/rev."""
        return self.F * (INCH if job.inch else 1.0) / (1.0 if job.feed == "G95" else self.n)


@dataclass(frozen=True, slots=True)
class PlannedEdge:
    """The life of one edge: the rows of its plan, and the rule that finds the pair at another depth.

    Attributes
    ----------
    rows : tuple of Interval
        At the depth of ``laws``.
    laws : LifeLaws
    others : tuple of LifeLaws
        Laws of the further depths of the part.
    rules : Rules
    grid : Grid
    latest : float
        Minutes beyond which no row is planned, with several depths.
    """

    rows: tuple[Interval, ...]
    laws: LifeLaws
    others: tuple[LifeLaws, ...]
    rules: Rules
    grid: Grid
    latest: float = math.inf

    @property
    def end(self) -> float:
        """Minutes in the cut at which the plan ends."""
        return self.rows[-1].end if self.rows else 0.0

    def laws_at(self, depth: float) -> LifeLaws:
        """The laws at a depth."""
        return next(laws for laws in (self.laws, *self.others) if abs(laws.d - depth) < CLOSE)

    def interval(self, minutes: float, wear: float, depth: float) -> Interval | None:
        """The row that holds from these minutes; None where the edge is worn out.

        With one depth it is that of the plan. With several it is the best pair of the next interval at this depth,
        from the wear that the edge has, as the recursion chooses it.
        """
        if not self.others:
            return next((row for row in self.rows if row.start - CLOSE <= minutes < row.end - CLOSE), None)
        best = choose(self.laws_at(depth), self.rules, self.grid, "grid", wear, minutes)
        if best is None or minutes + self.rules.interval > self.latest + CLOSE:
            return None
        row = int(minutes / self.rules.interval + CLOSE) + 1
        return Interval(row, minutes, minutes + self.rules.interval, wear, best.V, best.f)

    def wear_at(self, row: Interval, minutes: float, depth: float) -> float:
        """Wear by the laws within a row."""
        laws = self.laws_at(depth)
        return float(wear_after(laws, self.rules, row.V, row.f, row.before, row.start, minutes))

    def wear_from(self, minutes: float) -> float:
        """Wear at these minutes of the plan.

        Raises
        ------
        UsageError
            The plan ends before.
        """
        row = next((row for row in self.rows if row.start - CLOSE <= minutes < row.end - CLOSE), None)
        if row is None:
            raise UsageError(
                f"--from {minutes:g} min: by the plan the edge is worn out after {self.end:g} min; change it and "
                "leave --from out."
            )
        return self.wear_at(row, minutes, self.laws.d)


@dataclass(frozen=True, slots=True)
class TurningPlan:
    """The moves of all parts, with what they were made from."""

    job: TurningJob
    edge: PlannedEdge
    moves: tuple[Move, ...]

    @property
    def edges(self) -> int:
        """Edges used."""
        return self.moves[-1].edge

    @property
    def path(self) -> dict[str, Array]:
        """V, f, t and the wear at the end of each move, by their symbols in the laws."""
        wear, names = self.edge.laws.wear.response, ("V", "f", "end", "wear")
        values = np.array([[getattr(move, name) for name in names] for move in self.moves]).T
        return dict(zip(("V", "f", "t", wear), values, strict=True))

    @property
    def minutes(self) -> float:
        """Minutes in the cut."""
        return sum(move.end - move.start for move in self.moves)

    @property
    def left(self) -> float:
        """Minutes of the plan that the last edge has left."""
        return max(self.edge.end - self.moves[-1].end, 0.0)


def require_geometry(passed: Sequence[Stretch], depth: float) -> None:
    """Refuse a pass that cannot be turned at its depths, ``depth`` where a stretch has none.

    Raises
    ------
    UsageError
        A size that is not above zero, a depth that leaves nothing, or a turned diameter that falls along the pass.
    """
    turned = math.inf
    for k, one in enumerate(passed):
        d = one.depth or depth
        if not (one.diameter > 0 and one.length > 0 and d > 0) or not math.isfinite(one.diameter + one.length):
            raise UsageError(
                f"a pass of diameter {one.diameter:g}, length {one.length:g} and depth {d:g} mm: give all above 0."
            )
        final = one.diameter - 2 * d
        if final <= 0:
            raise UsageError(
                f"a depth of {d:g} mm leaves nothing of a diameter of {one.diameter:g} mm; use fewer passes."
            )
        if k and final < turned - CLOSE:
            raise UsageError(
                f"the turned diameter falls from {turned:g} to {final:g} mm along a pass: the tool would plunge into "
                "the work. Cut the smaller diameter nearer to the end face, or in a pass of its own."
            )
        turned = final


def require_passes(passes: Sequence[Sequence[Stretch]], depth: float) -> None:
    """Refuse passes that cannot be turned, and one whose diameter is not the one that an earlier pass leaves there.

    Raises
    ------
    UsageError
        As `require_geometry`; or a pass would be deeper, or shallower, than its depth.
    """
    left: list[tuple[float, float, float]] = []  # from, to, diameter: the latest first
    for number, passed in enumerate(passes, 1):
        require_geometry(passed, depth)
        begins, cut = 0.0, []
        for one in passed:
            ends = begins + one.length
            found = next((each for each in left if each[0] < ends - NEAR and begins < each[1] - NEAR), None)
            if found is not None and abs(found[2] - one.diameter) > NEAR:
                raise UsageError(
                    f"pass {number} begins at a diameter of {one.diameter:g} mm where an earlier pass leaves "
                    f"{found[2]:g} mm: its depth would not be {one.depth or depth:g} mm. Give the diameter left."
                )
            cut.append((begins, ends, one.diameter - 2 * (one.depth or depth)))
            begins = ends
        left = [*cut, *left]
