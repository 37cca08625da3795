"""Kienzle's law of the specific cutting force: kc1.1 and mc with their intervals, from forces, torque or power.

    Fc = kc1.1 b h^(1 - mc),    kc = kc1.1 h^-mc,    b and h in mm

Chip width b and thickness h follow from the settings and the entering angle kappa (KAPR, between edge and feed), which
is 90 degrees less the lead angle (PSIR); with z edges of a tool of diameter D, and the arc phi of a mill that cuts the
width ae, the mean chip thickness of milling being h = (2 ae / (D phi)) fz sin kappa:

=========  ========  =====================================================  ============================
process    response  law                                                    chip thickness h
=========  ========  =====================================================  ============================
turning    Fc        kc d f                                                 f sin kappa
turning    P         kc d f V / 60000                                       f sin kappa
drilling   M         kc D^2 f / 8000                                        f sin kappa / z
drilling   P         kc D V f / 240000                                      f sin kappa / z
milling    M         kc d ae fz z / (2000 pi)                               2 ae fz sin kappa / (D phi)
milling    P         kc d ae fz z n / 60000000                              2 ae fz sin kappa / (D phi)
=========  ========  =====================================================  ============================

Each is a power law whose exponents are fixed but for that of the feed, which is 1 - mc; so ln kc1.1 is a linear
function of the estimates and its interval is exact. The mean chip thickness overstates the mean power of milling by a
few per cent (3.7 % for an arc of 60 degrees). Units: N, N m, kW, mm, mm/rev, m/min, 1/min; kc in N/mm2.

Source: Kienzle & Victor 1957, Werkstattstechnik und Maschinenbau 47, 224.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import exp, log, pi, radians, sin
from numbers import Real

import numpy as np

from ..core.arrays import Array
from ..core.display import Displayable
from ..core.errors import FitError, UsageError
from ..core.predicts import PredictsByLaw
from ..core.rounding import format_decimal, format_plain
from ..datasets.runs import Readable, Runs, as_runs
from .lawfit import LawFit
from .laws import LawForm
from .mechanistic import TableValue, checked_angle, mean_chip_thickness, table_value
from .regression import fit_rows
from .rows import select

FORCES = ("Fc", "Ff", "Fp", "Fx", "Fy", "Fz", "Fxz", "F")
SAME = 1e-3  # relative spread of ae/D, or of an entering angle, up to which it is one value
POINT_ANGLE = 118.0  # degrees, of a drill whose point angle is not known
MILLING_FACTOR = 1.2  # of kc in tables for milling against turning (shape of the chip)
IDLE = "P is taken as cutting power: idle power of the spindle in it raises kc1.1, and mc"
USUAL_MC = (0.1, 0.4)


@dataclass(frozen=True, slots=True)
class _Rule:
    """Fixed exponents, exponent factor (the feed), and the constant of kc times their product."""

    fixed: tuple[tuple[str, float], ...]
    feed: str
    constant: float


RULES: Mapping[tuple[str, str], _Rule] = {
    **{("turning", name): _Rule((("d", 1.0),), "f", 1.0) for name in FORCES},
    ("turning", "P"): _Rule((("d", 1.0), ("V", 1.0)), "f", 1 / 60_000),
    ("drilling", "M"): _Rule((("D", 2.0),), "f", 1 / 8000),
    ("drilling", "P"): _Rule((("D", 1.0), ("V", 1.0)), "f", 1 / 240_000),
    ("milling", "M"): _Rule((("d", 1.0), ("ae", 1.0), ("z", 1.0)), "fz", 1 / (2000 * pi)),
    ("milling", "P"): _Rule((("d", 1.0), ("ae", 1.0), ("z", 1.0), ("n", 1.0)), "fz", 1 / 60e6),
}  # fmt: skip
STAND_INS = {"D": "Dc"}  # the tool's diameter where the file has both


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class KienzleLaw(PredictsByLaw, Displayable):
    """Kienzle's law of one response.

    Attributes
    ----------
    law : LawFit
        The power law with fixed exponents; its notes state kc1.1, mc and what was assumed.
    process : {"turning", "drilling", "milling"}
    entering_angle : float
        kappa, degrees.
    assumed : bool
        Whether the entering angle was not given.
    constants : ndarray, shape (2, p)
        ln kc1.1 and mc are ``offsets + constants @ theta``.
    offsets : ndarray, shape (2,)
    chip_thickness : (float, float)
        Smallest and largest chip thickness of the rows, mm.
    """

    law: LawFit
    process: str
    entering_angle: float
    assumed: bool
    constants: Array
    offsets: Array
    chip_thickness: tuple[float, float]

    @property
    def kc11(self) -> float:
        """kc1.1, N/mm2: specific force at a chip of 1 mm by 1 mm."""
        return exp(self._estimates[0])

    @property
    def mc(self) -> float:
        """Exponent by which the specific force falls with the chip thickness."""
        return float(self._estimates[1])

    @property
    def _estimates(self) -> Array:
        return np.asarray(self.offsets + self.constants @ self.law.theta)

    def conf_int(self, level: float = 0.95) -> "dict[str, tuple[float, float]]":
        """Intervals of kc1.1 and mc, by edge where the law has inference by edge; NaN where there are none."""
        half = self.law.t_quantile(level) * np.sqrt(np.diag(self.constants @ self.law.covariance() @ self.constants.T))
        low, high = self._estimates - half, self._estimates + half
        return {"kc11": (float(np.exp(low[0])), float(np.exp(high[0]))), "mc": (float(low[1]), float(high[1]))}

    def specific_force(self, h: float, level: float = 0.95) -> tuple[float, float, float]:
        """Specific force kc1.1 h^-mc at a chip thickness h in mm, and the ends of its interval, N/mm2."""
        if not (isinstance(h, Real) and h > 0):
            raise UsageError(f"chip thickness {h} mm: it must be above zero.")
        row = np.array([1.0, -log(h)])
        c = row @ self.constants
        half = self.law.t_quantile(level) * float(np.sqrt(c @ self.law.covariance() @ c))
        at = float(row @ self._estimates)
        return exp(at), exp(at - half), exp(at + half)

    @property
    def table_value(self) -> TableValue | None:
        """Table value of the work material of the data, where its name is recognised."""
        return table_value(self.law.source.work)

    @property
    def sentence(self) -> str:
        """kc1.1 and mc with their intervals, and the specific force in the middle of the tests."""
        return " ".join(_sentences(self))


def kienzle_law(
    runs: Readable,
    response: str = "Fc",
    *,
    entering_angle: float | None = None,
    process: str | None = None,
    edge: str | None = "edge",
    by: str | None = None,
) -> KienzleLaw:
    """Fit Kienzle's law: the specific force kc1.1 and its exponent mc, with intervals.

    Parameters
    ----------
    runs : Runs, DataFrame or path
    response : str
        A force in turning (``Fc``, ``Ff``, ``Fp`` ...), torque ``M`` in drilling and milling, or power ``P``.
    entering_angle : float, optional
        kappa in degrees, KAPR: 90 less the lead angle PSIR. By default the column or constant ``kappa`` of the runs, 90
        less ``lead``, half of the point angle ``sigma`` of a drill; otherwise it is assumed, 90 degrees, or 59 of a
        drill, and a note of the law says so.
    process : {"turning", "drilling", "milling"}, optional
        By default that of the runs, or turning.
    edge, by
        As in `power_law`; ``by`` multiplies kc1.1, which is then that of the reference level.

    Raises
    ------
    FitError
        A column that the law needs is missing, the feed does not change, or the engagement of a mill changes.
    UsageError
        No Kienzle law of this response in this process, or an entering angle that is not between 0 and 180 degrees.

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import fit
    >>> from fitmodels.datasets import runs_from_frame
    >>> frame = pd.DataFrame({"d": [1, 2, 2.5, 1.0], "f": [0.1, 0.2, 0.3, 0.4]})
    >>> frame["Fc"] = 1780 * frame["d"] * frame["f"] ** 0.74
    >>> found = fit.kienzle_law(runs_from_frame(frame))
    >>> round(found.kc11), round(found.mc, 2)
    (1780, 0.26)
    """
    runs = as_runs(runs)
    response = runs.symbol(response)
    process = process or _process_of(runs)
    rule = RULES.get((process, response))
    if rule is None:
        known = ", ".join(name for of, name in RULES if of == process)
        others = [of for of, name in RULES if name == response]
        remedy = f" --process {others[0]} reads the file as {others[0]}." if others else ""
        raise UsageError(f"there is no Kienzle law of {response} in {process}, but of {known}.{remedy}")
    angle, assumed, origin = _entering_angle(runs, process, entering_angle)
    columns, constant = _columns(runs, rule, response)
    law, X = _fitted(runs, response, columns, rule.feed, edge, by)
    per_feed = _per_feed(runs, process, angle)
    at = 1 + law.factors.index(rule.feed)
    constants = np.zeros((2, len(law.theta)))
    constants[:, at], constants[0, 0] = (-log(per_feed), -1.0), 1.0
    offsets = np.array([log(per_feed) - log(constant), 1.0])
    h = per_feed * X[:, at - 1]
    found = KienzleLaw(
        law=law, process=process, entering_angle=angle, assumed=assumed, constants=constants, offsets=offsets,
        chip_thickness=(float(h.min()), float(h.max())),
    )  # fmt: skip
    idle = (IDLE,) if response == "P" and "P" not in {one.role for one in runs.derived} else ()
    notes = (*law.notes, *_sentences(found), _angle_note(found, origin), *idle)
    return replace(found, law=replace(law, notes=notes))


def _fitted(
    runs: Runs, response: str, columns: tuple[tuple[str, float], ...], feed: str, edge: str | None, by: str | None
) -> tuple[LawFit, Array]:
    """The power law with fixed exponents, and the factors of its rows."""
    factors = (*(name for name, _ in columns), feed)
    rows = select(runs, response, factors, by=by, edge=edge)
    if len(rows.y) and np.ptp(rows.X[:, -1]) <= 1e-9 * rows.X[0, -1]:
        raise FitError(
            f"{response}: {feed} is {rows.X[0, -1]:g} in all {len(rows.y)} rows, so that mc is not determined. Vary "
            f"{feed}, over a factor of 2 at least."
        )
    law = LawForm("power", response, factors, fixed=columns)
    return fit_rows(runs, law, rows, (), "multiplicative"), rows.X


def _process_of(runs: Runs) -> str:
    return "turning" if runs.process is None else str(runs.process)


def _columns(runs: Runs, rule: _Rule, response: str) -> tuple[tuple[tuple[str, float], ...], float]:
    """Columns with their fixed exponents, and the constant with the quantities that are given once."""
    found, constant = [], rule.constant
    for name, exponent in rule.fixed:
        other = STAND_INS.get(name, name)
        if runs.has(other) or runs.has(name):
            found.append((other if runs.has(other) else name, exponent))
        elif other in runs.constants or name in runs.constants:
            constant *= runs.constants.get(other, runs.constants.get(name, 1.0)) ** exponent
        else:
            raise FitError(
                f"Kienzle's law of {response} needs {name}, and there is neither a column nor a value of it: add the "
                f"column or give --value {name}=..."
            )
    if not runs.has(rule.feed):
        raise FitError(f"Kienzle's law of {response} needs the feed {rule.feed}, and there is no column of it.")
    return tuple(found), constant


def _one_value(runs: Runs, name: str) -> float | None:
    """The value of a quantity that is the same in all rows; None where there is none.

    Raises
    ------
    FitError
        It has several values.
    """
    if name in runs.constants:
        return float(runs.constants[name])
    if not runs.has(name):
        return None
    values = runs.values(name)
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    if np.ptp(values) > SAME * abs(values[0]):
        raise FitError(
            f"{name} changes from {values.min():g} to {values.max():g} between rows: Kienzle's law is fitted at one "
            f"value of it; fit the rows of each value alone."
        )
    return float(values[0])


def _entering_angle(runs: Runs, process: str, given: float | None) -> tuple[float, bool, str]:
    """Entering angle in degrees, whether it is assumed, and where it comes from."""
    if given is not None:
        return checked_angle(given), False, "given"
    if (value := _one_value(runs, "kappa")) is not None:
        return checked_angle(value), False, "kappa of the data"
    if (value := _one_value(runs, "lead")) is not None:
        return checked_angle(90 - value), False, f"90 less the lead angle of {value:g} degrees"
    if process == "drilling":
        point = _one_value(runs, "sigma")
        return (
            checked_angle((point or POINT_ANGLE) / 2),
            point is None,
            f"half of a point angle of {point or POINT_ANGLE:g}",
        )
    return 90.0, True, ""


def _per_feed(runs: Runs, process: str, angle: float) -> float:
    """Chip thickness per unit of the feed."""
    s = sin(radians(angle))
    if process == "drilling":
        teeth = _one_value(runs, "z")
        return s / (2.0 if teeth is None else teeth)
    if process != "milling":
        return s
    ratio = _engagement(runs)
    return mean_chip_thickness(1.0, ratio, 1.0, angle)


def _engagement(runs: Runs) -> float:
    """ae/D of a mill, the same in all rows."""
    values = []
    for name in ("ae", "Dc", "D"):
        there = runs.has(name)
        if there or name in runs.constants:
            values.append(runs.values(name) if there else np.full(len(runs), runs.constants[name]))
    if len(values) < 2 or not (runs.has("ae") or "ae" in runs.constants):
        raise FitError("Kienzle's law of milling needs the width of cut ae and the diameter Dc or D of the mill.")
    ratio = values[0] / values[1]
    ratio = ratio[np.isfinite(ratio)]
    if not len(ratio) or np.ptp(ratio) > SAME * ratio[0]:
        ends = f"{ratio.min():.3g} to {ratio.max():.3g}" if len(ratio) else "nothing"
        raise FitError(
            f"ae/D changes from {ends}, and the chip thickness is no power of it: fit each engagement by itself."
        )
    return float(ratio[0])


def _name(found: KienzleLaw) -> str:
    """kc1.1, kf1.1, kp1.1, or k1.1 of another force."""
    axis = {"Ff": "f", "Fp": "p"}.get(found.law.response, "c")
    return f"k{axis}1.1"


def _sentences(found: KienzleLaw) -> tuple[str, ...]:
    """kc1.1 and mc; what the tests cover; and the comparison with tables."""
    name, mc, ends = _name(found), f"m{_name(found)[1]}", found.conf_int()
    h = float(np.sqrt(np.prod(found.chip_thickness)))
    low, high = (format_plain(value, 3) for value in found.chip_thickness)
    at = found.specific_force(h)
    level = f" at {found.law.by.column} {found.law.by.reference}" if found.law.by else ""
    constants = (_with_ends(found.kc11, *ends["kc11"], 4), _with_ends(found.mc, *ends["mc"], 3))
    return (
        f"{name} = {constants[0]} N/mm2{level}, {mc} = {constants[1]}.",
        f"{name} is at a chip thickness of 1 mm; the tests cover {low} to {high} mm, in the middle of which "
        f"({format_plain(h, 3)} mm) the specific force is {_with_ends(*at, 4)} N/mm2.",
        *_unusual(found, mc),
    )


def _with_ends(value: float, low: float, high: float, digits: int) -> str:
    """Estimate with its 95 % interval."""
    shown = [format_decimal(float(f"{v:.{digits}g}")) for v in (value, low, high)]
    if not np.isfinite([low, high]).all():
        return f"{shown[0]} (no interval)"
    return f"{shown[0]} (95 % CI {shown[1]} to {shown[2]})"


def _unusual(found: KienzleLaw, mc: str) -> tuple[str, ...]:
    """Sentences on an exponent out of its usual range, and on the table value of the work material."""
    words = []
    low, high = found.conf_int()["mc"]
    if high < USUAL_MC[0] or low > USUAL_MC[1]:
        words.append(
            f"{mc} {found.mc:.2f} is unusual: the interval excludes {USUAL_MC[0]:g} to {USUAL_MC[1]:g}; check the unit "
            "of the feed, and whether the force is the cutting force alone."
        )
    table = found.table_value
    if table is None or found.law.response not in ("Fc", "P", "M"):
        return tuple(words)
    factor = MILLING_FACTOR if found.process == "milling" else 1.0
    h = float(np.sqrt(np.prod(found.chip_thickness)))
    kc, least, most = found.specific_force(h)
    usual = factor * table.kc11 * h**-table.mc
    times = f" x {factor:g} for milling" if factor != 1 else ""
    ratio = kc / usual
    agreement = "which the interval contains" if least <= usual <= most else f"the fitted one is {ratio:.2f} times that"
    words.append(
        f"Table value of {table.group}: kc1.1 {table.kc11:g}{times}, mc {table.mc:g}, so kc {usual:.4g} N/mm2 at "
        f"{format_plain(h, 3)} mm, {agreement}"
        + (
            ". Check units and entering angle."
            if not 0.5 < ratio < 2
            else " (rake and wear change it by 20 % and more)."
        )
    )
    return tuple(words)


def _angle_note(found: KienzleLaw, origin: str) -> str:
    angle = f"Entering angle kappa {found.entering_angle:g} degrees"
    if not found.assumed:
        low = (
            " Below 30 degrees it is rather a lead angle, but for tools of high feed."
            if found.entering_angle < 30
            else ""
        )
        return f"{angle} ({origin}); kappa is 90 less the lead angle.{low}"
    by, kappa = f", {origin}" if origin else "", radians(found.entering_angle)
    ratio = sin(kappa / 2) / sin(kappa)
    return (
        f"{angle} is ASSUMED{by}: were it half as large, {_name(found)} would be {100 * (ratio**found.mc - 1):+.0f} %. "
        "Give --value kappa=... (90 less the lead angle)."
    )
