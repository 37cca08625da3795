"""One pair of V and f, and what the laws say of it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable

SAME = 1e-9  # of a logarithm: a point is told to lie on a limit that it meets to a part in 10^9


@dataclass(frozen=True, slots=True, repr=False)
class Point(Displayable):
    """A pair of cutting speed and feed at the depth and time of its region.

    Attributes
    ----------
    V, f : float
        m/min and mm/rev.
    MRR : float
        Metal removal rate ``1000 V f d``, mm3/min.
    values, units : dict
        Each response by its symbol: ``P``, ``Fxz``, ``AW``; the median of a law whose errors multiply.
    wear_rate : float or None
        ``dAW/dt = h AW / t`` with h the exponent of t in the wear law, um/min; None without a law of wear over t.
    held_by, exceeds : tuple of str
        Limits that the point lies on, and over.
    tested : bool
        Whether every law was tested there: ``Law.inside``.
    probability : float or None
        Of keeping within the limits of power, force and wear, where it was asked for.

    Examples
    --------
    >>> Point(150.0, 0.5, 187500.0, {"P": 6.5}, {"P": "kW"}, None, (), (), True).words
    'V 150 m/min, f 0.5 mm/rev: MRR 187500 mm3/min, P 6.50 kW'
    """

    V: float
    f: float
    MRR: float
    values: Mapping[str, float]
    units: Mapping[str, str]
    wear_rate: float | None
    held_by: tuple[str, ...]
    exceeds: tuple[str, ...]
    tested: bool
    probability: float | None = None

    @property
    def words(self) -> str:
        """The point in a clause."""
        told = [f"{name} {three(value)} {self.units[name]}" for name, value in self.values.items()]
        if self.wear_rate is not None:
            told.append(f"wear rate {three(self.wear_rate)} um/min")
        return ", ".join([f"{self.where}: MRR {self.MRR:.0f} mm3/min", *told])

    @property
    def where(self) -> str:
        """The pair alone."""
        return f"V {four(self.V)} m/min, f {four(self.f)} mm/rev"

    @property
    def xy(self) -> tuple[float, float]:
        """(V, f)."""
        return self.V, self.f

    def facts(self) -> dict[str, object]:
        """Plain JSON; each name tells its unit."""
        return {
            "V_m_min": self.V,
            "f_mm_rev": self.f,
            "MRR_mm3_min": self.MRR,
            "responses": {name: {"value": v, "unit": self.units[name]} for name, v in self.values.items()},
            "wear_rate_um_min": self.wear_rate,
            "held_by": list(self.held_by),
            "exceeds": list(self.exceeds),
            "tested": self.tested,
            "probability": self.probability,
        }


def four(value: float) -> str:
    """Four digits at most, whole numbers whole: of what one sets."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def three(value: float) -> str:
    """Three digits, whole numbers whole: of what a law says."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def ln(V: float, f: float) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """(ln V, ln f)."""
    return np.log(np.array([V, f], dtype=np.float64))


def plain(ln_value: float) -> float:
    """The number behind a logarithm, without the noise of its last digits: 200, not 199.99999999999991."""
    return float(f"{np.exp(ln_value):.12g}")
