"""The visible region: all pairs of V and f within the limits of power, force, wear and machine, with its corners.

Power laws are linear in ln V and ln f, so the region is a polygon there, and the pair with the greatest metal removal
rate, ``ln MRR = ln(1000 d) + ln V + ln f``, is one of its corners: a linear programme in two unknowns. Within laws of
other forms the sides are curves (`curved`).

Source: Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006, section III, whose corners are read off contour charts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array, is_positive
from ...core.display import Plottable, as_columns
from ...core.errors import DataError, UsageError
from .curved import Limit, curved_conflict, least_costs, vertices
from .half_planes import SAME, TOUCH, HalfPlane, clip, conflict_sentence, intersect, rectangle
from .limits import (
    MachineRange,
    box,
    check_fixed_factors,
    limited,
    merged,
    of_spindle,
    required_wear_law,
    unlimited_responses,
    within_tests,
)
from .log_planes import CutSetting, LogPlane, outside_tested_ranges, ratio, within_tested_ranges
from .operating_point import (
    Corner,
    OperatingPoint,
    best_corner,
    label_corners,
    limit_names,
    ln,
    plain,
    sensitivities,
    start_at_best,
)
from .surfaces import Surface, law_surfaces, limits_on, tested_limits

if TYPE_CHECKING:
    from pandas import DataFrame

    from ...core.display import Frame
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.load_line import LimitsSection


@dataclass(frozen=True, slots=True, repr=False)
class VisibleRegion(Plottable):
    """Pairs of V and f within all limits at one depth and time.

    Attributes
    ----------
    corners : tuple of Corner
        Clockwise on a chart of f over V; the corner of the greatest MRR is B, as in AC-2016. Empty where no pair
        is feasible.
    limits : tuple of HalfPlane, CurvedLimit or RegionLimit
        Those of the responses and of the spindle, then the four sides of the machine's ranges.
    planes : dict of LogPlane or LawSurface
        Limited responses, and the wear, over ln V and ln f.
    polygon : ndarray, shape (n, 2)
        Corners as (ln V, ln f); within curves the best pair is among them, and the sides are no straight lines.
    box : MachineRange
        The machine's ranges.
    setting : CutSetting
        Depth, time, level, further factors.
    laws : dict of LawSection
    wear : str or None
        Symbol of the wear, where the file has a law of it.
    notes : tuple of str
        Origin of the ranges, limits not applied, factors outside the tested ranges.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> region = visible_region(published("AC-2016"), d=2.5, t=10.0)
    >>> [(corner.letter, round(corner.V, 1), round(corner.f, 3)) for corner in region.corners][:2]
    [('A', 104.7, 0.6), ('B', 147.9, 0.53)]
    """

    corners: tuple[Corner, ...]
    limits: tuple[Limit, ...]
    planes: Mapping[str, Surface]
    polygon: Array
    box: MachineRange
    setting: CutSetting
    laws: Mapping[str, "LawSection"]
    wear: str | None
    notes: tuple[str, ...]

    @property
    def empty(self) -> bool:
        """Whether no pair is feasible: the limits exclude each other, see `conflict`."""
        return not self.corners

    @property
    def conflict(self) -> str:
        """The limits that exclude each other, and by how much; empty where the region is not."""
        if not self.empty:
            return ""
        planes = [each for each in self.limits if isinstance(each, HalfPlane)]
        if len(planes) == len(self.limits):
            return conflict_sentence(planes[:-4], planes[-4:], self.planes)
        return curved_conflict(self.limits[:-4], self.box.low, self.box.high, self.planes)

    @property
    def curved(self) -> bool:
        """Whether a limit is a curve in ln V and ln f, so that corners and best pair are found numerically."""
        return not all(isinstance(each, HalfPlane) for each in self.limits)

    @property
    def best(self) -> OperatingPoint:
        """The pair with the greatest metal removal rate: corner B.

        Of corners with equal MRR, the one of least wear.

        Raises
        ------
        DataError
            The region is empty.
        """
        return self._at(self.polygon[self._best()])

    @property
    def at_words(self) -> str:
        """The fixed depth, the time where a law has it, and the level: ``d 2.5 mm, t 10 min``."""
        timed = any(factor.symbol == "t" for law in self.laws.values() for factor in law.factors)
        level = "" if self.setting.by is None else f", {self.setting.by}"
        return f"d {self.setting.d:g} mm{f', t {self.setting.t:g} min' if timed else ''}{level}"

    @property
    def sensitivities(self) -> dict[str, float]:
        """Gain in MRR, %, per 1 % of each limit active at the best pair: ``{"P 7 kW": 0.83}``."""
        return sensitivities(self.polygon[self._best()], self.limits)

    @property
    def rate_of_wear(self) -> float | None:
        """Factor from the wear to its rate in um/min: ``h/t`` times the unit conversion; None without a law over t.

        The derivative of eq. 6 of AC-2016, whose eq. 7 and 13 leave out h = 0.245.
        """
        law = None if self.wear is None else self.laws[self.wear]
        if law is None or law.form != "power" or "t" not in law.coefficients:
            return None
        return law.coefficients["t"] / self.setting.t * ratio(law.unit, "um")

    def contains(self, V: Any, f: Any) -> Any:  # noqa: ANN401
        """Whether pairs keep every limit, to a part in 10^9: arrays broadcast, bool or ndarray of bool."""
        x = np.stack(np.broadcast_arrays(np.log(V), np.log(f)), axis=-1)
        within = np.logical_and.reduce([each.beyond(x) <= SAME for each in self.limits])
        return within if np.ndim(within) else bool(within)

    def at(self, V: float, f: float) -> OperatingPoint:
        """Responses at a pair, inside or outside the region."""
        for name, value in (("V", V), ("f", f)):
            if not is_positive(value):
                raise UsageError(f"{name} = {value:g}: a power law needs a positive value.")
        return self._at(ln(V, f))

    def least_wear(self, loss: float = 0.05) -> OperatingPoint:
        """The pair of least wear among those with at most this loss of MRR, as a share of the greatest.

        The least wear after t and the least wear rate at t are at the same pair: the rate is h/t of the wear.

        Raises
        ------
        UsageError
            The file has no law of wear, or the share is not between 0 and 1.
        DataError
            The region is empty.
        """
        if self.wear is None:
            raise UsageError("the file has no law of wear (AW or VB); fit one to compare wear and removal rate.")
        if not 0 <= loss < 1:
            raise UsageError(f"loss = {loss:g} of the greatest MRR: give a share from 0 to below 1, such as 0.05.")
        most = self.polygon[self._best()].sum() + np.log1p(-loss)
        wear = self.planes[self.wear]
        if self.curved or not isinstance(wear, LogPlane):
            return self.least_wears([loss])[0]
        left = clip(self.polygon, HalfPlane("MRR", "mm3/min", "least", 0.0, (-1.0, -1.0), -float(most)))
        worn = left @ wear.slopes
        least = np.flatnonzero(worn <= worn.min() + TOUCH)
        return self._at(left[least[np.argmax(left[least].sum(axis=1))]])

    def least_wears(self, losses: Sequence[float]) -> tuple[OperatingPoint, ...]:
        """The pair of least wear for each loss of MRR; errors as for `least_wear`."""
        wear = self.planes.get(self.wear or "")
        if wear is None or not (self.curved or not isinstance(wear, LogPlane)):
            return tuple(self.least_wear(loss) for loss in losses)
        best, box = self.polygon[self._best()], (self.box.low, self.box.high)
        return tuple(self._at(x) for x in least_costs(wear.value, self.limits, box, best, losses))

    def _best(self) -> int:
        if self.empty:
            raise DataError(self.conflict)
        return best_corner(self.polygon, self.planes.get(self.wear or ""))

    def _at(self, x: Array) -> OperatingPoint:
        V, f = plain(x[0]), plain(x[1])
        values = {name: float(each.value(x)) for name, each in self.planes.items()}
        over = [(each, float(each.beyond(x))) for each in self.limits]
        return OperatingPoint(
            V=V,
            f=f,
            MRR=1000 * V * f * self.setting.d,
            values=values,
            units={name: each.unit for name, each in self.planes.items()},
            wear_rate=None if self.rate_of_wear is None else values[self.wear or ""] * self.rate_of_wear,
            held_by=limit_names([each for each, by in over if abs(by) <= SAME]),
            exceeds=limit_names([each for each, by in over if by > SAME]),
            tested=within_tested_ranges(self.laws, self.setting, self.wear, {**values, "V": V, "f": f}),
        )

    def to_frame(self) -> "DataFrame":
        """One row per corner."""
        from pandas import DataFrame

        return DataFrame([(c.letter, c.V, c.f, c.limits) for c in self.corners], columns=["corner", "V", "f", "limits"])


def visible_region(
    pf: "ParameterFile",
    *,
    limits: "LimitsSection | Mapping[str, Any] | None" = None,
    d: float = 2.5,
    t: float = 10.0,
    by: str | None = None,
    at: Mapping[str, float] | None = None,
) -> VisibleRegion:
    """Find all pairs of V and f within the limits at a depth and a time.

    A law with wear among its factors takes it from the file's law of wear: after ``t`` min at that V, f and d.

    Parameters
    ----------
    pf : ParameterFile
        With laws of the limited responses. Where all are power laws the result is exact; other forms are evaluated
        numerically, inside their tested regions alone.
    limits : Limits or mapping, optional
        In place of the file's limits of the same name; a bare number is in kW, N or mm, a pair in m/min or mm/rev;
        None drops one. Without ranges of speed and feed the tested ranges are used, with a note.
    d, t : float
        Depth of cut, mm, and cutting time, min; the defaults are AC-2016's.
    by : str, optional
        Level of laws that have levels.
    at : mapping, optional
        Further factors of the laws in their units; a measured wear, in place of its law; the diameter ``D`` in mm, for
        limits of spindle speed and feed rate.

    Returns
    -------
    VisibleRegion
        Empty where the limits exclude each other, see its ``conflict``.

    Raises
    ------
    UsageError
        A limited response without a law, an unknown factor, an invalid limit.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> region = visible_region(published("AC-2016"), limits={"power": 0.01})
    >>> print(region.conflict)
    V at least 50 m/min, f at least 0.06 mm/rev and P at most 0.01 kW exclude each other: P is 0.5227 kW there at best.
    """
    setting = CutSetting(float(d), float(t), by, dict(at or {}))
    check_fixed_factors(pf, setting)
    asked = merged(pf, limits)
    bounds, machine = limited(pf, asked), box(pf, asked)
    worn = None if asked.wear is None else asked.wear.of
    wear = required_wear_law(pf, setting, worn)
    over = law_surfaces(pf, (*(b.symbol for b in bounds), *unlimited_responses(pf, setting, wear)), setting, wear)
    spindle, notes = of_spindle(asked, setting)
    tested = tested_limits(bounds, over)
    machine = within_tests(machine, tested)
    held = (*limits_on(bounds, over), *spindle, *tested)
    straight = [each for each in held if isinstance(each, HalfPlane)]
    if len(straight) == len(held):
        polygon = intersect(straight, rectangle(machine.low, machine.high))
    else:
        polygon = vertices((*held, *machine.sides), machine.low, machine.high)
    symbol = None if wear is None else wear.response
    polygon = start_at_best(polygon, over.get(symbol or ""))
    laws = {name: pf.laws[name] for name in over}
    return VisibleRegion(
        corners=label_corners(polygon, (*held, *machine.sides)),
        limits=(*held, *machine.sides),
        planes={name: over[name] for name in sorted(over, key=lambda name: name == symbol)},
        polygon=polygon,
        box=machine,
        setting=setting,
        laws=laws,
        wear=symbol,
        notes=(*machine.notes, *notes, *outside_tested_ranges(laws, setting)),
    )


LOSSES = tuple(np.linspace(0.0, 0.5, 101).tolist())


@dataclass(frozen=True, slots=True, repr=False)
class WearFront(Plottable):
    """Pareto front of wear and metal removal rate: the least wear for each loss of MRR.

    At a given time wear and wear rate are least at the same pair, so the front holds for both.

    Attributes
    ----------
    loss : ndarray, shape (n,)
        Loss of MRR as a share of the greatest.
    V, f, MRR, wear : ndarray, shape (n,)
        m/min, mm/rev, mm3/min, and the unit of the wear.
    wear_rate : ndarray, shape (n,), or None
        um/min; None where the wear law has no t.
    points : tuple of OperatingPoint
    symbol, unit : str
        Of the wear.
    """

    loss: Array
    V: Array
    f: Array
    MRR: Array
    wear: Array
    wear_rate: Array | None
    points: tuple[OperatingPoint, ...]
    symbol: str
    unit: str

    def to_frame(self) -> "Frame":
        """One row per loss of MRR."""
        return as_columns(self, "loss", "V", "f", "MRR", "wear")


def wear_front(region: VisibleRegion, losses: Sequence[float] | None = None) -> WearFront:
    """The least wear for each loss of MRR, as a share of the greatest, exact at every point.

    Parameters
    ----------
    region : VisibleRegion
        Of a file with a law of wear.
    losses : sequence of float
        From 0 to below 1; by default 101 of them to 0.5, within curves 21.

    Raises
    ------
    UsageError, DataError
        As ``VisibleRegion.least_wear``.

    Examples
    --------
    >>> from fitmodels.controllers import visible_region
    >>> from fitmodels.parameters.published import published
    >>> front = wear_front(visible_region(published("AC-2016")), [0.0, 0.05])
    >>> front.V.round(1).tolist(), front.wear.round(4).tolist()
    ([147.9, 136.5], [0.27, 0.2591])
    """
    losses = (LOSSES[::5] if region.curved else LOSSES) if losses is None else losses
    points = region.least_wears([float(loss) for loss in losses])
    symbol = region.wear or ""

    def column(name: str) -> Array:
        return np.array([getattr(point, name) for point in points], dtype=np.float64)

    return WearFront(
        loss=np.asarray(losses, dtype=np.float64),
        V=column("V"),
        f=column("f"),
        MRR=column("MRR"),
        wear=np.array([point.values[symbol] for point in points]),  # noqa: PD011  a mapping
        wear_rate=None if any(point.wear_rate is None for point in points) else column("wear_rate"),
        points=points,
        symbol=symbol,
        unit=region.planes[symbol].unit,
    )
