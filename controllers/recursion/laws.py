"""What an edge's whole life is computed from: the laws of a parameter file at one depth of cut, and its limits.

A law R = c0 V^a f^b d^g t^h AW^k becomes R = C V^a f^b t^h AW^k, with d and whatever else stays put in C.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.display import Displayable

Array = NDArray[np.float64]
Times = Literal["published", "full"]


@dataclass(frozen=True, slots=True, repr=False)
class Terms(Displayable):
    """One law with depth put in, R = exp(ln_c) V^V f^f t^t AW^AW, and the most that is allowed of R.

    Attributes
    ----------
    response, unit : str
    ln_c, V, f, t, AW : float
        Natural logarithm of the constant, and exponents; 0 for a factor that the law lacks.
    most : float
        Limit of R in ``unit``.
    put_in : tuple of (str, float)
        What the constant holds beside ln c0: name of a parameter, and what it is multiplied by, ``("d", ln 2.5)``.
    """

    response: str
    unit: str
    ln_c: float
    V: float
    f: float
    t: float
    AW: float
    most: float
    put_in: tuple[tuple[str, float], ...] = ()

    def __call__(self, V: ArrayLike, f: ArrayLike, t: ArrayLike = 1.0, AW: ArrayLike = 1.0) -> Array:
        """R at these factors, broadcast; a factor left out does not count."""
        logs = np.asarray(self.ln_c + self.V * np.log(V) + self.f * np.log(f), dtype=np.float64)
        if self.t:
            logs = logs + self.t * np.log(t)
        if self.AW:
            logs = logs + self.AW * np.log(AW)
        return np.asarray(np.exp(logs), dtype=np.float64)


@dataclass(frozen=True, slots=True, repr=False)
class LifeLaws(Displayable):
    """The laws and limits of an edge's life.

    Attributes
    ----------
    wear : Terms
        AW = C V^a f^b t^h, with the wear criterion as its limit.
    power, force : Terms or None
        None where the file has no law of it or sets no limit; ``notes`` say which.
    d : float
        Depth of cut, mm.
    V, f : (float, float)
        What the machine can be set to, m/min and mm/rev.
    times : {"published", "full"}
        Which times count unless said otherwise (see `Rules`): all, but in the paper's own file those it counts itself.
    notes : tuple of str
        What was left open by the file, in sentences.
    """

    wear: Terms
    power: Terms | None
    force: Terms | None
    d: float
    V: tuple[float, float]
    f: tuple[float, float]
    times: Times = "full"
    notes: tuple[str, ...] = ()

    def mrr(self, V: ArrayLike, f: ArrayLike) -> Array:
        """MRR = 1000 V f d, mm3/min (eq. 8)."""
        return 1000.0 * self.d * np.asarray(V, dtype=np.float64) * np.asarray(f, dtype=np.float64)

    @property
    def limited(self) -> tuple[tuple[str, Terms], ...]:
        """Power and force, those that are limited, by name."""
        both = (("power", self.power), ("force", self.force))
        return tuple((name, terms) for name, terms in both if terms is not None)
