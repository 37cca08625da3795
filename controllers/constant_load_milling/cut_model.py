"""Load and tool wear of a cut, from the sections of a parameter file.

    I = A + B G(q)/G(1) fm + k1 VB    eq. 14 of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, the feed through
                                      the shape of the identified drive with a gain of 1
    VB = c0 t^n fm^m                  time in the cut; where the feed changes, from the wear that was reached

The paper's G and load line do not agree in gain, so the line gives the gain and G its shape. The scaling that follows,
``G(1)/B`` in feed per unit of the drive's input, is derived and no one's measurement. A wear law in other units than
the settings, mm and um, is converted.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...core.arrays import is_positive
from ...core.display import Displayable
from ...core.errors import ParameterError
from ...datasets.units import convert
from ...parameters.messages import in_unit
from .control_laws import line_of

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.load_line import LoadLineSection
    from ...parameters.sections.origin import DesignSection

FACTORS = ("t", "fm")  # of a wear law: what changes in a cut at constant load


@dataclass(frozen=True, slots=True, repr=False)
class CutModel(Displayable):
    """One kind of cut: end milling, slot milling.

    Attributes
    ----------
    A, B, k1 : float
        Load; load per unit of feed; load per unit of wear.
    b, a : tuple of float
        Drive of gain 1, polynomials in z^-1.
    c0, n, m : float
        Wear after 1 s in the cut at a feed of 1, and the exponents of time and feed.
    sample_time : float
        s, of the drive.
    scaling : float
        G(1)/B, unit_feed per unit_u: derived.
    area : float or None
        Cross-section that the wear tests cut, width times depth, mm2.
    tested_feed : float or None
        The one feed of the wear tests, or the middle of their range.
    unit_load, unit_feed, unit_wear, unit_u : str
    """

    A: float
    B: float
    k1: float
    b: tuple[float, ...]
    a: tuple[float, ...]
    c0: float
    n: float
    m: float
    sample_time: float
    scaling: float
    area: float | None
    tested_feed: float | None
    unit_load: str
    unit_feed: str
    unit_wear: str
    unit_u: str

    @classmethod
    def from_parameters(cls, pf: "ParameterFile") -> Self:
        """Make the model from load law, wear law, dynamics and settings of a file.

        Raises
        ------
        ParameterError
            The file lacks one of them, or they are inconsistent.

        Examples
        --------
        >>> from fitmodels.parameters.published import published
        >>> cut = CutModel.from_parameters(published("CLM-2023"))
        >>> round(cut.scaling), round(cut.k1 / cut.B, 2)
        (1459, 1.99)
        """
        line, model = line_of(pf), pf.dynamics
        if model is None:
            raise ParameterError("the file has no dynamics of the drive; identify them with `fitmodels ident`.")
        gain = model.dc_gain
        if not (model.stable and is_positive(gain)):
            raise ParameterError(
                f"the dynamics have a gain of {gain:.4g} at rest and poles within {abs(model.poles).max():.4g}: a cut "
                "needs a stable drive whose load rises with feed; identify it again."
            )
        law = _load_law(pf, line)
        A, B, k1 = _line(law, line, pf)
        c0, n, m, at = _wear(pf, law.factors[-1].symbol, line)
        return cls(
            A=A, B=B, k1=k1, b=tuple(float(value) / gain for value in model.b), a=model.a, c0=c0, n=n, m=m,
            sample_time=model.sample_time, scaling=gain / B, area=at.get("area"), tested_feed=at.get("fm"),
            unit_load=line.unit_load, unit_feed=line.unit_feed, unit_wear=line.unit_wear, unit_u=model.unit_u,
        )  # fmt: skip


def _load_law(pf: "ParameterFile", line: "LoadLineSection") -> "LawSection":
    law = pf.laws.get(line.law)
    if law is None or law.form not in ("load_line", "feed_line"):
        raise ParameterError(
            f"the file has no load law of {line.law[:40]!r} that its settings name, so no cut can be simulated; fit "
            "runs that have the columns fm, VB and I."
        )
    found = (law.unit, *(factor.unit for factor in law.factors))
    own = (line.unit_load, line.unit_feed) if law.form == "load_line" else (line.unit_feed,)
    if found != (*own, line.unit_wear):
        raise ParameterError(
            f"the load law is in {', '.join(found)} and the settings in {', '.join((*own, line.unit_wear))}; give both "
            "in the same units."
        )
    return law


def _line(law: "LawSection", line: "LoadLineSection", pf: "ParameterFile") -> tuple[float, float, float]:
    shift = law.by.shifts.get(line.by or "", 0.0) if law.by else 0.0
    c = law.coefficients
    if law.form == "load_line":
        A, B, k1 = c["A"] + shift, c["B"], c["k1"]
    else:  # feed on wear at the reference: the load per unit of feed comes from the dynamics
        B = _gain_of_dynamics(pf, line)
        A, k1 = line.reference - B * (c["fm0"] + shift), -c["slope"] * B
    if not (B > 0 and k1 > 0):
        raise ParameterError(f"the load law has B {B:.4g} and k1 {k1:.4g}: load rises with feed and with wear.")
    return A, B, k1


def _gain_of_dynamics(pf: "ParameterFile", line: "LoadLineSection") -> float:
    """Load per unit of feed by the drive's gain and the scaling of the gains."""
    pi, model = pf.pi, pf.dynamics
    if model is not None and model.unit_u == line.unit_feed and model.unit_y == line.unit_load:
        return model.dc_gain
    if pi is None or model is None or (pi.unit_u, pi.unit_y) != (line.unit_feed, line.unit_load):
        raise ParameterError(
            f"the file has feed on wear at {line.reference:g} {line.unit_load} alone and no scaling of its dynamics to "
            f"{line.unit_feed}: what load another feed draws is not known; fit runs at several loads."
        )
    return model.dc_gain * pi.scaling_y / pi.scaling_u


def _wear(pf: "ParameterFile", symbol: str, line: "LoadLineSection") -> tuple[float, float, float, dict[str, float]]:
    """c0 for time in s, exponents of time and feed, and fixed test conditions: ``area``, ``fm``."""
    law = pf.laws.get(symbol)
    remedy = f"fit wear tests that have the columns t and {symbol}."
    if law is None or law.form != "power" or "t" not in law.coefficients:
        raise ParameterError(f"the file has no power law of {symbol} in the time t, which wear needs; {remedy}")
    factors = {factor.symbol: factor for factor in law.factors}
    free = [name for name, factor in factors.items() if name not in FACTORS and factor.low != factor.high]
    if free or law.by:
        raise ParameterError(
            f"the law of {symbol} leaves {', '.join(free) or 'its level'} open; at constant load only t and fm may "
            f"change: {remedy}"
        )
    _check_dimensions(law, factors, line)
    held: dict[str, Any] = {name: factor.low for name, factor in factors.items() if name not in FACTORS}
    held |= {name: 1.0 for name in FACTORS if name in factors}
    n, m = law.coefficients["t"], law.coefficients.get("fm", 0.0)
    c0 = float(law.values(**held)) * unit_factor("s", factors["t"].unit) ** n * unit_factor(law.unit, line.unit_wear)
    if "fm" in factors:
        c0 *= unit_factor(line.unit_feed, factors["fm"].unit) ** m
    if not n > 0:
        raise ParameterError(f"the law of {symbol} has t^{n:g}: wear grows with time; {remedy}")
    return c0, n, m, _tested(factors, pf.design, line)


def _check_dimensions(law: "LawSection", factors: dict[str, Any], line: "LoadLineSection") -> None:
    """Refuse units that cannot be converted into those of the settings."""
    pairs = [(law.unit, line.unit_wear), *([(factors["fm"].unit, line.unit_feed)] if "fm" in factors else [])]
    for unit, to in pairs:
        if in_unit(1.0, unit, to) is None:
            raise ParameterError(
                f"the law of {law.response} is in {unit or 'no unit'} where the settings are in {to or 'no unit'}, "
                "which are not of one quantity; fit the wear tests again with their units."
            )


def _tested(factors: dict[str, Any], design: "DesignSection | None", line: "LoadLineSection") -> dict[str, float]:
    """Feed and cross-section of the wear tests: of the factors of the law, or constant in the tests that it is from."""
    known = {**_constants(factors["t"], design), **factors}
    found = {}
    if "fm" in known:
        fm = known["fm"]
        found["fm"] = (fm.low + fm.high) / 2 * unit_factor(fm.unit, line.unit_feed)
    if {"d", "ae"} <= known.keys():
        d, ae = (known[name].low * unit_factor(known[name].unit, "mm") for name in ("d", "ae"))
        found["area"] = d * ae
    return found


def _constants(time: Any, design: "DesignSection | None") -> dict[str, Any]:  # noqa: ANN401
    """Factors that were constant in the tests of a wear law, where the tests of the file are those, by their times."""
    if design is None or (time.low, time.high, time.unit) not in [
        (of.low, of.high, of.unit) for of in design.factors if of.symbol == "t"
    ]:
        return {}
    return {of.symbol: of for of in design.factors if of.low == of.high}


def unit_factor(unit: str, to: str) -> float:
    """Conversion factor between units; exactly 1 where they are the same."""
    if unit == to:
        return 1.0
    return float(convert(np.array(1.0), unit, to))
