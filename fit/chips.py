"""Chip width and thickness of turning and milling, and table values of the specific cutting force.

The entering angle kappa (KAPR) lies between the edge and the feed; it is 90 degrees less the lead angle (PSIR).

Source: Tabellenbuch Zerspantechnik, 5th ed. 2022, as in the material cards of FreeCAD (kc1.1 and mc by work material).
"""

import re
from dataclasses import dataclass
from math import acos, asin, radians, sin

from ..core.errors import UsageError


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
    """An entering angle above 0 and below 180 degrees; UsageError otherwise."""
    if not 0 < value < 180:
        raise UsageError(
            f"entering angle {value:g} degrees: it must be above 0 and below 180; it is 90 less the lead angle (PSIR)."
        )
    return float(value)
