"""Chips and forces of milling and turning: mechanistic force of an end mill with B of the load line, and table values.

Chip thickness and force of a disc element at the angle alpha, ft the feed per tooth (eq. 6 and 7):

    tc = ft sin alpha,    dF = Kf ft sin alpha dz,    alpha = phi - z tan(helix) / r

Mean tangential force over a revolution, and the current of the spindle that it takes (eq. 5 and 10 to 13):

    Fc = Kf ft da Nt (cos st - cos ex) / (2 pi) = Kf ft da Nt ae / (2 pi r)
    Kt I = Cs + r Fc,    I = A + B_ft ft = A + B fm,    B = B_ft / (n Nt) = Kf ae da / (2 pi n Kt)

The mean does not depend on the helix angle, which only spreads the force of a flute over the rotation. Eq. 10 is
evaluated as the mean over one revolution of the sum over the flutes: as printed it divides the sum over Nt flutes by
the pitch 2 pi / Nt, which is Nt times the mean, has ft inside and outside the integral, and integrates over the angle
between limits of the depth. Fc is the tangential component, so that r Fc is the torque (eq. 3).

Sources: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587, eq. 1 to 13; Tabellenbuch Zerspantechnik,
5th ed. 2022, as in the material cards of FreeCAD (kc1.1 and mc by work material).
"""

import re
from dataclasses import dataclass
from math import acos, asin, ceil, cos, degrees, inf, isfinite, pi, radians, sin, tan
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Array
from ..core.display import Displayable
from ..core.errors import FitError, UsageError
from ..core.rounding import format_decimal, format_plain
from .lawfit import LawFit

Milling = Literal["down", "up"]
ANGLES = 7200  # of one revolution, at which the largest force is sought
UNITS = ("A", "mm/min")  # of the load line whose B is compared


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class EndMillForce(Displayable):
    """Tangential force of an end mill of constant specific force.

    Attributes
    ----------
    specific_force : float
        Kf, N/mm2.
    feed_per_tooth, axial_depth, radial_depth, diameter : float
        ft, da, ae and 2 r, mm.
    teeth : int
        Nt.
    helix : float
        Degrees.
    milling : {"down", "up"}
    """

    specific_force: float
    feed_per_tooth: float
    axial_depth: float
    radial_depth: float
    diameter: float
    teeth: int
    helix: float
    milling: Milling

    @property
    def engagement(self) -> tuple[float, float]:
        """Angles of entry and exit of a tooth, degrees; 0 is where a tooth of an up mill enters."""
        arc = degrees(acos(1 - 2 * self.radial_depth / self.diameter))
        return (0.0, arc) if self.milling == "up" else (180.0 - arc, 180.0)

    @property
    def lag(self) -> float:
        """Angle by which the end of the axial depth follows the tip of a flute (eq. 8), degrees."""
        return degrees(2 * self.axial_depth * tan(radians(self.helix)) / self.diameter)

    @property
    def mean_force(self) -> float:
        """Mean tangential force over a revolution (eq. 10), N."""
        return self.specific_force * self.axial_depth * self._per_feed * self.feed_per_tooth

    @property
    def peak_force(self) -> float:
        """Largest tangential force within a revolution, N."""
        return float(self.force_at(np.linspace(0.0, 360.0, ANGLES, endpoint=False)).max())

    @property
    def mean_chip_thickness(self) -> float:
        """Mean chip thickness over the engagement, ft (cos st - cos ex) / (ex - st), mm."""
        start, end = map(radians, self.engagement)
        return self.feed_per_tooth * (cos(start) - cos(end)) / (end - start)

    @property
    def torque(self) -> float:
        """Mean torque r Fc (eq. 3), N m."""
        return self.mean_force * self.diameter / 2000

    @property
    def sentence(self) -> str:
        """The force in words."""
        return (
            f"mean tangential force {format_plain(self.mean_force, 4)} N (peak {format_plain(self.peak_force, 4)} N), "
            f"mean torque {format_plain(self.torque, 4)} N m, mean chip thickness "
            f"{format_plain(self.mean_chip_thickness, 3)} mm, at Kf {_three(self.specific_force)} N/mm2"
        )

    @property
    def _per_feed(self) -> float:
        """Nt ae / (2 pi r): mean chip thickness of all teeth over a revolution per feed."""
        return self.teeth * self.radial_depth / (pi * self.diameter)

    def force_at(self, rotation: ArrayLike) -> Array:
        """Tangential force of all flutes (eq. 9) at angles of the first flute's tip, degrees, (n,) -> (n,), N.

        Examples
        --------
        >>> cut = end_mill_force(2500, feed_per_tooth=0.035, axial_depth=0.2, radial_depth=2, diameter=2, teeth=2)
        >>> cut.force_at([0.0, 90.0]).round(6).tolist()
        [0.0, 17.5]
        """
        start, end = map(radians, self.engagement)
        lag, phi = radians(self.lag), np.radians(np.asarray(rotation, dtype=float)) % (2 * pi)
        total = np.zeros_like(phi)
        for pitch in range(self.teeth):
            for turn in range(1 + ceil((lag + end) / (2 * pi))):  # a long flute may still cut from earlier turns
                tip = (phi + 2 * pi * pitch / self.teeth) % (2 * pi) + 2 * pi * turn
                total += self._flute(tip, start, end, lag)
        return np.asarray(self.specific_force * self.feed_per_tooth * self.axial_depth * total)

    @staticmethod
    def _flute(tip: Array, start: float, end: float, lag: float) -> Array:
        """Mean of sin alpha over the axial depth of one flute, 0 outside the engagement."""
        if lag < 1e-9:
            return np.where((tip >= start) & (tip <= end), np.sin(tip), 0.0)
        low, high = np.maximum(tip - lag, start), np.minimum(tip, end)
        return np.where(high > low, np.cos(low) - np.cos(high), 0.0) / lag

    def removal_rate(self, speed: float) -> float:
        """Material removal rate ae da fm, mm3/min, at a spindle speed in 1/min."""
        return self.radial_depth * self.axial_depth * self.feed_per_tooth * self.teeth * _above(speed, "speed", "1/min")

    def power(self, speed: float) -> float:
        """Mean cutting power, W, at a spindle speed in 1/min: torque times angular speed, which is Kf times the MRR."""
        return self.torque * 2 * pi * _above(speed, "speed", "1/min") / 60

    def load_slope(self, torque_constant: float, speed: float) -> float:
        """B of the load line I = A + B fm (eq. 13), A/(mm/min), for Kt in N m/A and a spindle speed in 1/min.

        Kt relates the torque at the tool to the current that is measured: a gear ratio, the efficiency of the spindle
        and the kind of current (one phase, effective value) are part of it.

        Examples
        --------
        >>> cut = end_mill_force(2500, feed_per_tooth=0.035, axial_depth=0.2, radial_depth=1.4, diameter=2, teeth=2)
        >>> round(cut.load_slope(0.5, 10_000) * 1e5, 5)
        2.22817
        """
        Kt = _above(torque_constant, "torque_constant", "N m/A")
        area = self.radial_depth * self.axial_depth
        return self.specific_force * area / (2000 * pi * Kt * _above(speed, "speed", "1/min"))

    def compare_load_line(
        self, law: LawFit, torque_constant: float, speed: float, level: float = 0.95
    ) -> "LoadSlopeComparison":
        """Compare B of a fitted load line with the B that specific force and geometry give.

        Parameters
        ----------
        law : LawFit
            Of the form ``load_line``, current in A on feed rate in mm/min.
        torque_constant, speed : float
            As in `load_slope`.
        level : float
            Of the interval of the fitted B.

        Raises
        ------
        FitError
            Another form of law, or other units.
        """
        if law.form != "load_line":
            raise FitError(
                f"B is compared with a load line I = A + B fm + k1 VB, and this law of {law.response} is a "
                f"{law.form.replace('_', ' ')}; fit runs in which current and feed change with fit.load_law."
            )
        units = (law.units.get(law.response, ""), law.units.get(law.factors[0], ""))
        if units != UNITS:
            raise FitError(f"the load line is in {units[0]} on {units[1]}; B is computed in A/(mm/min): convert them.")
        low, high = law.conf_int(level).loc[["B"]].to_numpy(dtype=float)[0]
        return LoadSlopeComparison(
            predicted=self.load_slope(torque_constant, speed), fitted=float(law.params["B"]), low=float(low),
            high=float(high), level=level, specific_force=self.specific_force, torque_constant=torque_constant,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class LoadSlopeComparison(Displayable):
    """B of a fitted load line beside that of the mechanistic model.

    Attributes
    ----------
    predicted, fitted : float
        A/(mm/min).
    low, high, level : float
        Interval of the fitted B; NaN where it has none.
    specific_force, torque_constant : float
        Kf in N/mm2 and Kt in N m/A that were assumed.
    """

    predicted: float
    fitted: float
    low: float
    high: float
    level: float
    specific_force: float
    torque_constant: float

    @property
    def needed_ratio(self) -> float:
        """Kf/Kt, N/mm2 per N m/A, with which the model gives the fitted B."""
        return self.specific_force / self.torque_constant * self.fitted / self.predicted

    @property
    def fitted_specific_force(self) -> tuple[float, float, float]:
        """Kf, N/mm2, that the fitted B stands for at the assumed Kt: estimate and the ends of its interval."""
        per_slope = self.specific_force / self.predicted
        return self.fitted * per_slope, self.low * per_slope, self.high * per_slope

    @property
    def sentence(self) -> str:
        """The comparison in words."""
        has = isfinite(self.low) and isfinite(self.high)
        ends = f" ({100 * self.level:g} % CI {self.low:.3g} to {self.high:.3g})" if has else " (no interval)"
        head = (
            f"B fitted {self.fitted:.4g} A/(mm/min){ends}, predicted {self.predicted:.4g} from Kf "
            f"{_three(self.specific_force)} N/mm2 and Kt {format_plain(self.torque_constant, 3)} N m/A"
        )
        if has and self.low <= self.predicted <= self.high:
            return f"{head}: they agree within the interval."
        Kf, low, high = (_three(value) for value in self.fitted_specific_force)
        between = f" ({low} to {high})" if has else ""
        return (
            f"{head}: the fitted B is {self.fitted / self.predicted:.3g} times the predicted one. It needs Kf/Kt "
            f"{_three(self.needed_ratio)}: at this Kt, Kf {Kf} N/mm2{between}. Check whether Kt refers to the "
            "torque at the tool and to the current that was measured."
        )


def end_mill_force(
    specific_force: float,
    *,
    feed_per_tooth: float,
    axial_depth: float,
    radial_depth: float,
    diameter: float,
    teeth: int,
    helix: float = 0.0,
    milling: Milling = "down",
) -> EndMillForce:
    """Mechanistic force of an end mill with a constant specific force (Tai, Tsai & Li 2023, eq. 1 to 11).

    Parameters
    ----------
    specific_force : float
        Kf, N/mm2, at the mean chip thickness of this cut (see `fit.kienzle_law` for kc as a function of it).
    feed_per_tooth, axial_depth, radial_depth, diameter : float
        mm; a slot has a radial depth equal to the diameter.
    teeth : int
    helix : float
        Degrees, 0 or more and below 90; it does not change the mean force.
    milling : {"down", "up"}
        Which arc of the circumference cuts; the mean force is the same.

    Raises
    ------
    UsageError
        A value that is not above zero, a radial depth above the diameter, or an option that does not exist.

    Examples
    --------
    The slot of CLM-2023 with Kf 2500 N/mm2:

    >>> slot = end_mill_force(
    ...     2500, feed_per_tooth=0.035, axial_depth=0.2, radial_depth=2, diameter=2, teeth=2, helix=38
    ... )
    >>> round(slot.mean_force, 6), round(slot.lag, 3), round(slot.power(10_000), 5)
    (11.140846, 8.953, 11.66667)
    """
    given = {
        "specific_force": (specific_force, "N/mm2"), "feed_per_tooth": (feed_per_tooth, "mm"),
        "axial_depth": (axial_depth, "mm"), "radial_depth": (radial_depth, "mm"), "diameter": (diameter, "mm"),
    }  # fmt: skip
    for name, (value, unit) in given.items():
        _above(value, name, unit)
    if radial_depth > diameter:
        raise UsageError(
            f"radial_depth {radial_depth:g} mm is above the diameter {diameter:g} mm: a slot has the diameter itself."
        )
    if teeth < 1 or teeth != int(teeth):
        raise UsageError(f"teeth {teeth}: a whole number, 1 or more.")
    if not 0 <= helix < 90:
        raise UsageError(f"helix {helix:g} degrees: it must be 0 or more and below 90.")
    if milling not in get_args(Milling):
        raise UsageError(f"milling={milling!r}: it is 'down' or 'up'.")
    return EndMillForce(
        specific_force=float(specific_force), feed_per_tooth=float(feed_per_tooth), axial_depth=float(axial_depth),
        radial_depth=float(radial_depth), diameter=float(diameter), teeth=int(teeth), helix=float(helix),
        milling=milling,
    )  # fmt: skip


def _three(value: float) -> str:
    """Three digits without an exponent."""
    return format_decimal(float(f"{value:.3g}"))


def _above(value: float, name: str, unit: str) -> float:
    if not 0 < value < inf:
        raise UsageError(f"{name} {value:g} {unit}: it must be a number above zero.")
    return float(value)


@dataclass(frozen=True, slots=True)
class TableValue:
    """kc1.1, N/mm2, and mc of a group of work materials in turning, and how its names are recognised."""

    group: str
    kc11: float
    mc: float
    names: str


# Table values for turning; the first group whose names occur in the name of the work material counts.
TABLE = (
    TableValue("austenitic stainless steel", 2000, 0.20, r"stainless|austenit|1\.4[35]\d\d|\b3(?:04|16)l?\b|x\d+cr"),
    TableValue("grey cast iron", 1050, 0.23, r"gr[ae]y iron|cast iron|grauguss|\bgjl|\ben-gjl|\bgg-?\d\d"),
    TableValue("wrought aluminium", 470, 0.27, r"alumin|\bal\b|\balmg|\balzn|\bal-|\b[267]0\d\d\b"),
    TableValue("low-alloy steel", 2200, 0.24, r"\d\dcrmo|\d\dnicr|\d\dmncr|\b41[34]0\b|\b709m40|\ben ?19\b|low.alloy"),
)


def turning_chip(d: float, f: float, entering_angle: float = 90.0) -> tuple[float, float]:
    """Width b = d/sin kappa and thickness h = f sin kappa of a chip, mm, for depth and feed in mm.

    Examples
    --------
    >>> b, h = turning_chip(2.5, 0.3, 75)
    >>> round(1780 * b * h**0.74, 2)
    1842.23
    """
    s = sin(radians(checked_angle(entering_angle)))
    return d / s, f * s


def mean_chip_thickness(
    fz: float, ae: float, D: float, entering_angle: float = 90.0, *, centred: bool = False
) -> float:
    """Mean chip thickness of milling over the arc of engagement, mm.

    Parameters
    ----------
    fz, ae, D : float
        Feed per tooth, width of cut and diameter of the mill, mm.
    entering_angle : float
        Degrees.
    centred : bool
        Face milling with the mill above the middle of the work; otherwise the work is cut from its side.

    Examples
    --------
    >>> round(mean_chip_thickness(0.1, 5, 20), 7), round(mean_chip_thickness(0.2, 60, 80, 45, centred=True), 6)
    (0.0477465, 0.125069)
    """
    if not 0 < ae <= D:
        raise UsageError(
            f"width of cut {ae:g} mm, mill of {D:g} mm: the width must be above zero and at most the diameter."
        )
    arc = 2 * asin(ae / D) if centred else acos(1 - 2 * ae / D)
    return fz * sin(radians(checked_angle(entering_angle))) * 2 * ae / (D * arc)


def table_value(work: str) -> TableValue | None:
    """Table value of kc1.1 and mc in turning by the name of a work material; None where it is not recognised.

    Examples
    --------
    >>> table_value("42CrMo4").kc11, table_value("EN-GJL-250").mc, table_value("unnamed-work")
    (2200, 0.23, None)
    """
    name = work.lower()
    return next((one for one in TABLE if re.search(one.names, name)), None)


def checked_angle(value: float) -> float:
    """An entering angle (KAPR) above 0 and below 180 degrees; UsageError otherwise."""
    if not 0 < value < 180:
        raise UsageError(
            f"entering angle {value:g} degrees: it must be above 0 and below 180; it is 90 less the lead angle (PSIR)."
        )
    return float(value)
