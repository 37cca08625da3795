"""Discrete transfer function models, the result of every estimator.

    y(t) = b(q) / a(q) u(t) + noise,    b(q) = b_nk q^-nk + ... + b_(nk+nb-1) q^-(nk+nb-1),    a(q) = 1 + a_1 q^-1 ...

``nk`` counts samples of delay: nk = 1 is the first possible response of a sampled plant (as in MATLAB; Octave's arx
counts one less). Source: Ljung 1999, System Identification, section 4.2.
"""

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import Array
from ..core.display import Plottable
from ..core.errors import IdentError

if TYPE_CHECKING:
    import pandas as pd

INTEGRATOR = 1e-14  # of the sum of |a|: a(1) below it is rounding of zero, a pole at exactly 1
Structure = Literal["arx", "sriv", "output_error", "armax", "box_jenkins", "given"]


@dataclass(frozen=True, slots=True, repr=False)
class Model(Plottable):
    """Identified or given discrete transfer function.

    Attributes
    ----------
    b, a : ndarray
        Full polynomials in z^-1: b includes its nk leading zeros, a starts with 1.
    nk : int
        Samples of delay.
    sample_time : float
        Seconds.
    structure : str
        ``arx``, ``sriv``, ``output_error``, ``armax``, ``box_jenkins``, or ``given``.
    cov_params : ndarray, shape (na + nb, na + nb), or None
        Covariance of ``theta`` = a_1 ... a_na, b_nk ... b_(nk+nb-1).
    noise_variance : float or None
        Variance of the innovations (arx, armax, box_jenkins) or of the output error (sriv, output_error), in unit_y
        squared.
    c, d : ndarray
        Noise polynomials: of armax, y = b/a u + c/a e; of box_jenkins, y = b/a u + 1/d e; otherwise 1.
    n : int or None
        Number of samples fitted.
    record : str or None
        SHA-256 of the record.
    input, output, unit_u, unit_y : str
    operating_point : tuple of float or None
        Mean input and output removed before the fit.
    band : tuple of float or None
        Excited band in Hz; outside it the model is an extrapolation.
    alternatives : tuple of (float, Model)
        Other structures that the record supports, each with its weight; the weight of this model is one minus their
        sum. Draws and bands are of the mixture, so that they include the uncertainty of orders and delay.
    notes : tuple of str

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> model.dc_gain, model.stable
    (1.0, True)
    """

    b: Array
    a: Array
    nk: int
    sample_time: float
    structure: Structure = "given"
    cov_params: Array | None = None
    noise_variance: float | None = None
    c: Array = field(default_factory=lambda: np.ones(1))
    d: Array = field(default_factory=lambda: np.ones(1))
    n: int | None = None
    record: str | None = None
    input: str = "u"
    output: str = "y"
    unit_u: str = ""
    unit_y: str = ""
    operating_point: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    alternatives: "tuple[tuple[float, Model], ...]" = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        b, a, c, d = (np.atleast_1d(np.asarray(p, dtype=np.float64)) for p in (self.b, self.a, self.c, self.d))
        for name, p in (("b", b), ("a", a), ("c", c), ("d", d)):
            if p.ndim != 1 or not np.isfinite(p).all():
                raise IdentError(f"{name} of a model is {p.tolist()}: a polynomial is an array of finite numbers.")
            object.__setattr__(self, name, p)
        if a[0] != 1 or c[0] != 1 or d[0] != 1:
            raise IdentError(
                f"a, c and d of a model start with 1, not {a[0]:g}, {c[0]:g} and {d[0]:g}: divide by the first "
                "coefficient."
            )
        if any(not 0 < weight < 1 for weight, _ in self.alternatives) or sum(w for w, _ in self.alternatives) >= 1:
            raise IdentError("weights of alternatives of a model: each above 0, their sum below 1.")
        if self.nk < 0 or len(b) <= self.nk or np.any(b[: self.nk] != 0):
            raise IdentError(f"b {b.tolist()} of a model with nk {self.nk}: {self.nk} zeros, then the coefficients.")
        if not self.sample_time > 0:
            raise IdentError(f"sample_time {self.sample_time!r} s of a model: a number above zero.")

    @property
    def na(self) -> int:
        """Order of a."""
        return len(self.a) - 1

    @property
    def nb(self) -> int:
        """Number of coefficients of b."""
        return len(self.b) - self.nk

    @property
    def theta(self) -> Array:
        """a_1 ... a_na, b_nk ... b_(nk+nb-1)."""
        return np.concatenate([self.a[1:], self.b[self.nk :]])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of ``theta``."""
        return (*(f"a{i}" for i in range(1, self.na + 1)), *(f"b{j}" for j in range(self.nk, len(self.b))))

    @property
    def params(self) -> "pd.Series[float]":
        """``theta`` by name."""
        import pandas as pd

        return pd.Series(self.theta, index=list(self.names))

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``theta``; NaN where there is no covariance."""
        import pandas as pd

        none = np.full(len(self.theta), np.nan)
        se = none if self.cov_params is None else np.sqrt(np.diag(self.cov_params))
        return pd.Series(se, index=list(self.names))

    def in_units(self, unit_u: str, factor: float) -> "Model":
        """The same model with its input in another unit, ``factor`` new units per old unit.

        >>> Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1).in_units("mm/min", 1000.0).dc_gain
        0.001
        """
        by = np.r_[np.ones(self.na), np.full(self.nb, 1 / factor)]
        cov = None if self.cov_params is None else self.cov_params * np.outer(by, by)
        point = self.operating_point and (self.operating_point[0] * factor, self.operating_point[1])
        others = tuple((weight, other.in_units(unit_u, factor)) for weight, other in self.alternatives)
        return replace(
            self, b=self.b / factor, unit_u=unit_u, cov_params=cov, operating_point=point, alternatives=others
        )

    @property
    def transfer_function(self) -> tuple[Array, Array, float]:
        """b, a of equal length in powers of z^-1 and the sample time, as used by scipy and python-control."""
        n = max(len(self.b), len(self.a))
        return np.pad(self.b, (0, n - len(self.b))), np.pad(self.a, (0, n - len(self.a))), self.sample_time

    @property
    def integrating(self) -> bool:
        """Whether one pole lies at exactly 1, but for rounding, and all others inside the unit circle.

        >>> Model(b=[0.0, 0.5], a=[1.0, -1.5, 0.5], nk=1, sample_time=0.1).integrating
        True
        """
        if not self._pole_at_one:
            return False
        return float(np.abs(np.roots(np.cumsum(self.a)[:-1])).max(initial=0.0)) < 1.0

    @property
    def _pole_at_one(self) -> bool:
        return self.na > 0 and abs(float(self.a.sum())) <= INTEGRATOR * float(np.abs(self.a).sum())

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of a, in z; that of an integrator is exactly 1."""
        a = self.transfer_function[1]
        roots = np.r_[1.0, np.roots(np.cumsum(a)[:-1])] if self._pole_at_one else np.roots(a)
        return np.asarray(roots, dtype=np.complex128)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """Roots of b, in z."""
        return np.asarray(np.roots(self.transfer_function[0]), dtype=np.complex128)

    @property
    def radius(self) -> float:
        """Largest modulus of a pole; 0 without poles."""
        return float(np.abs(self.poles).max(initial=0.0))

    @property
    def stable(self) -> bool:
        """Whether every pole lies inside the unit circle."""
        return self.radius < 1.0

    @property
    def noise(self) -> tuple[Array, Array]:
        """Numerator and denominator of the noise model H in y = b/a u + H e.

        >>> num, den = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, structure="arx").noise
        >>> num.tolist(), den.tolist()
        ([1.0], [1.0, -0.5])
        """
        return self.c, self.a if self.structure in ("arx", "armax") else self.d

    @property
    def dc_gain(self) -> float:
        """Response to a constant input of 1, in unit_y per unit_u; infinite for an integrator."""
        below = 0.0 if self._pole_at_one else float(self.a.sum())
        return float(self.b.sum()) / below if below != 0 else float(np.copysign(np.inf, self.b.sum()))

    @property
    def rate_gain(self) -> float:
        """Final slope of the response to a constant input of 1, in unit_y per unit_u and second; 0 without integrator.

        >>> Model(b=[0.0, 0.05], a=[1.0, -1.5, 0.5], nk=1, sample_time=0.1).rate_gain
        1.0
        """
        if not self.integrating:
            return 0.0
        return float(self.b.sum()) / float(np.cumsum(self.a)[:-1].sum()) / self.sample_time

    def with_integrator(self) -> "Model":
        """The model b / (a (1 - q^-1)), which takes the change of the output for its own output.

        >>> lag = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, cov_params=np.eye(2))
        >>> both = lag.with_integrator()
        >>> both.a.tolist(), both.cov_params.shape
        ([1.0, -1.5, 0.5], (3, 3))
        """
        a = np.convolve(self.a, [1.0, -1.0])
        cov = self.cov_params
        if cov is not None:
            by = np.zeros((len(cov) + 1, len(cov)))  # theta with the integrator, by theta
            by[: self.na, : self.na], by[self.na + 1 :, self.na :] = np.eye(self.na), np.eye(self.nb)
            by[1 : self.na + 1, : self.na] -= np.eye(self.na)
            cov = by @ cov @ by.T
        others = tuple((weight, other.with_integrator()) for weight, other in self.alternatives)
        return replace(self, a=a, cov_params=cov, alternatives=others)

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """G at frequencies in Hz, complex, the shape of ``frequency``; infinite at 0 for an integrator."""
        z = np.exp(-2j * np.pi * np.asarray(frequency, dtype=np.float64) * self.sample_time)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.polyval(self.b[::-1], z) / np.polyval(self.a[::-1], z), dtype=np.complex128)

    def simulate(self, u: ArrayLike) -> Array:
        """Simulated output (N,) from rest for an input u (N,)."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.b, self.a, np.asarray(u, dtype=np.float64)), dtype=np.float64)

    def to_control(self) -> Any:  # noqa: ANN401
        """The model as a python-control TransferFunction; IdentError if that library is not installed."""
        try:
            control = import_module("control")
        except ImportError:
            raise IdentError("python-control is not installed: pip install 'fitmodels[control]'.") from None
        num, den, dt = self.transfer_function
        return control.TransferFunction(num, den, dt, inputs=self.input, outputs=self.output)
