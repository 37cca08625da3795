"""Laws as printed in the papers, for comparison with a fit to the same tool and work."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Array

ALASKARI_2016 = "Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006"


@dataclass(frozen=True, slots=True)
class PublishedLaw:
    """One printed law.

    Attributes
    ----------
    tool, work : str
        Pair it was published for; an empty tool: the source names none.
    form : str
        ``power``, ``exponential``, ``load_line`` or ``feed_line``.
    response : str
        Symbol; ``factor`` of an exponential law in ``factor``.
    coefficients : mapping
        By the names of this project: c0 and exponents, a and b, or A, B and k1.
    standard_error : float or None
        Residual standard error as printed.
    source : str
    """

    tool: str
    work: str
    form: str
    response: str
    coefficients: Mapping[str, float]
    source: str
    standard_error: float | None = None
    factor: str = field(default="")

    def predict(self, factors: Mapping[str, ArrayLike]) -> Array | None:
        """Values of the printed law at these factors; None for another form or a missing factor.

        >>> law = published_law("", "Ck 45", "Ra", "exponential")
        >>> law.predict({"F": [448.06]}).round(3).tolist()
        [1.102]
        """
        c = self.coefficients
        if self.form == "exponential" and self.factor in factors:
            return np.asarray(c["a"] * np.exp(c["b"] * np.asarray(factors[self.factor], dtype=float)))
        needed = [name for name in c if name != "c0"]
        if self.form != "power" or any(name not in factors for name in needed):
            return None
        logs = [c[name] * np.log(np.asarray(factors[name], dtype=float)) for name in needed]
        return np.asarray(c["c0"] * np.exp(sum(logs)), dtype=float)


PUBLISHED = (
    PublishedLaw(
        "GC435", "709M40", "power", "AW", {"c0": 7.62e-3, "V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245},
        ALASKARI_2016, 0.1,
    ),
    PublishedLaw(
        "GC435", "709M40", "power", "P",
        {"c0": 0.140, "V": 0.82, "f": 0.627, "d": 0.844, "t": -0.049, "AW": 0.342}, ALASKARI_2016, 0.062,
    ),
    PublishedLaw(
        "GC435", "709M40", "power", "Fxz",
        {"c0": 55354.0, "V": -0.484, "f": 0.236, "d": 0.715, "t": -0.173, "AW": 1.1}, ALASKARI_2016, 0.12,
    ),
    PublishedLaw(
        "", "Ck 45", "exponential", "Ra", {"a": 0.2401, "b": 0.0034}, "constant-roughness paper (SURF), eq. 5",
        factor="F",
    ),
)  # fmt: skip


def published_law(tool: str, work: str, response: str, form: str) -> PublishedLaw | None:
    """The printed law of this tool, work, response and form, or None.

    Examples
    --------
    >>> published_law("GC435", "709M40 (En 19)", "AW", "power").coefficients["V"]
    0.577
    """
    for law in PUBLISHED:
        pair = law.tool.lower() in tool.lower() and work.lower().startswith(law.work.lower())
        if pair and (law.response, law.form) == (response, form):
            return law
    return None
