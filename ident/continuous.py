"""Conversion between discrete and continuous models, with the input held between samples (zero-order hold).

A plant x' = A x + B u whose input is held over a sample time h has exp([[A, B], [0, 0]] h) = [[Phi, Gamma], [0, 1]];
the matrix logarithm inverts this. A delay of a fraction of a sample splits Gamma in two. Source: Franklin, Powell &
Workman 1998, Digital Control of Dynamic Systems, sections 4.3.3 and 4.3.4.
"""

from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import Array, is_positive
from ..core.display import Displayable, Plottable
from ..core.errors import IdentError
from ..core.rounding import count
from .model import Model

DECAYED = 1e-7  # a pole this close to z = 0 decays within one sample: its continuous pole is not identifiable
ROUNDING = 1e-11  # of the largest coefficient, time counted in samples: a leading coefficient below it is rounding


@dataclass(frozen=True, slots=True, repr=False)
class NoContinuousForm(Displayable):
    """Reason why a discrete model has no continuous form; false in a condition.

    >>> NoContinuousForm("a pole at z = -0.5") or "none"
    'none'
    """

    reason: str

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True, slots=True, repr=False)
class ContinuousModel(Plottable):
    """G(s) = num(s) / den(s) exp(-delay s).

    Attributes
    ----------
    num, den : ndarray
        Highest power of s first; ``den`` starts with 1.
    delay : float
        Seconds.
    input, output, unit_u, unit_y : str

    Examples
    --------
    >>> lag = ContinuousModel(num=[2.0], den=[0.5, 1.0])
    >>> lag.poles.tolist(), lag.dc_gain
    ([(-2+0j)], 2.0)
    """

    num: Array
    den: Array
    delay: float = 0.0
    input: str = "u"
    output: str = "y"
    unit_u: str = ""
    unit_y: str = ""

    def __post_init__(self) -> None:
        num, den = (np.trim_zeros(np.atleast_1d(np.asarray(p, dtype=np.float64)), "f") for p in (self.num, self.den))
        if not den.size or not (np.isfinite(num).all() and np.isfinite(den).all()):
            raise IdentError(
                f"num {self.num}, den {self.den}: finite coefficients, and a denominator that is not zero."
            )
        if len(num) > len(den):
            raise IdentError(
                f"the numerator has degree {len(num) - 1}, the denominator {len(den) - 1}: not causal. "
                "The numerator has at most the degree of the denominator."
            )
        if not (np.isfinite(self.delay) and self.delay >= 0):
            raise IdentError(f"delay {self.delay!r} s: zero or more.")
        object.__setattr__(self, "num", num / den[0] if num.size else np.zeros(1))
        object.__setattr__(self, "den", den / den[0])

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of den, rad/s."""
        return np.asarray(np.roots(self.den), dtype=np.complex128)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """Roots of num, rad/s."""
        return np.asarray(np.roots(self.num), dtype=np.complex128)

    @property
    def dc_gain(self) -> float:
        """Response to a constant input of 1; infinite for an integrator."""
        below = float(self.den[-1])
        return float(self.num[-1]) / below if below != 0 else float(np.copysign(np.inf, self.num[-1]))

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """G at frequencies in Hz, complex, the shape of ``frequency``."""
        s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        return np.asarray(np.polyval(self.num, s) / np.polyval(self.den, s) * np.exp(-self.delay * s))

    def sampled(self, sample_time: float) -> Model:
        """The discrete model of the plant with a zero-order hold."""
        model = sampled(self.num, self.den, sample_time, self.delay)
        return replace(model, input=self.input, output=self.output, unit_u=self.unit_u, unit_y=self.unit_y)

    def to_control(self) -> Any:  # noqa: ANN401
        """A python-control TransferFunction num / den; IdentError with a delay, which that library cannot represent."""
        if self.delay:
            raise IdentError(f"delay {self.delay:g} s has no rational transfer function: use .sampled(dt) instead.")
        try:
            control = import_module("control")
        except ImportError:
            raise IdentError("python-control is not installed: pip install 'fitmodels[control]'.") from None
        return control.TransferFunction(self.num, self.den, inputs=self.input, outputs=self.output)


def to_continuous(model: Model) -> ContinuousModel | NoContinuousForm:
    """The continuous model with zero-order hold that a discrete model samples.

    Parameters
    ----------
    model : Model
        Its nk - 1 samples of pure delay become ``delay``.

    Returns
    -------
    ContinuousModel or NoContinuousForm
        None exists for a pole on the negative real axis (it alternates at each sample, as no single continuous pole
        does) or at zero (b longer than a by more than the delay: a finite impulse response, or a fractional delay).
        Frequencies lie below half the sample rate: aliasing is not detectable.

    Examples
    --------
    >>> from fitmodels.ident.continuous import sampled
    >>> lag = to_continuous(sampled([2.0], [0.5, 1.0], dt=0.1, delay=0.3))
    >>> lag.num.round(9).tolist(), lag.den.round(9).tolist(), round(lag.delay, 9)
    ([4.0], [1.0, 2.0], 0.3)
    >>> print(to_continuous(Model(b=[0.0, 1.0], a=[1.0, 0.5], nk=1, sample_time=0.1)))
    a pole at z = -0.5 alternates at every sample, as no single continuous pole does: lower the order or sample faster
    """
    late = max(model.nk - 1, 0)
    b, a = np.trim_zeros(model.b[late:], "b"), np.trim_zeros(model.a, "b")
    if len(b) > len(a):
        return NoContinuousForm(
            f"b reaches {len(b) - 1} samples back beyond the delay and a only {len(a) - 1}: that is "
            f"{count(len(b) - len(a), 'pole')} at z = 0, a finite impulse response or a fractional delay, which has no "
            "finite continuous order. Take nb <= na"
        )
    n = len(a) - 1
    head = float(b[0]) if model.nk == 0 and b.size else 0.0
    tail = np.r_[b, np.zeros(n + 1 - len(b))][1:] - head * a[1:]
    named = {k: getattr(model, k) for k in ("input", "output", "unit_u", "unit_y")}
    if n == 0:
        return ContinuousModel(np.array([head if model.nk == 0 else 0.0]), np.ones(1), **named)
    if refused := _refused(np.asarray(np.roots(a), dtype=np.complex128)):
        return NoContinuousForm(refused)
    num, den = _logarithm(a, tail, head)
    power = model.sample_time ** -np.arange(n + 1)
    return ContinuousModel(_trimmed(num) * power, den * power, late * model.sample_time, **named)


def _refused(poles: NDArray[np.complex128]) -> str:
    """Reason why these poles in z have no logarithm; empty if they have."""
    for p in poles:
        if abs(p) < DECAYED:
            return f"a pole at z = {p.real:.2g} decays within one sample: lower the order or sample faster"
        if p.real < 0 and abs(p.imag) <= 1e-9 * abs(p):
            return (
                f"a pole at z = {p.real:.4g} alternates at every sample, as no single continuous pole does: "
                "lower the order or sample faster"
            )
    return ""


def _logarithm(a: Array, tail: Array, head: float) -> tuple[Array, Array]:
    """Numerator and denominator in s, time in samples, both of the length of a."""
    from scipy.linalg import companion, logm

    n = len(a) - 1
    block = np.eye(n + 1)
    block[:n, :n] = companion(a)
    block[:n, n] = np.eye(n)[:, 0]
    log = np.real(np.asarray(logm(block)))
    A, B = log[:n, :n], log[:n, n]
    den = np.real(np.poly(np.log(np.roots(a).astype(np.complex128))))
    h, x = np.zeros(n + 1), B  # C A^k B: their product with den is the numerator, as in z
    h[0] = head
    for k in range(1, n + 1):
        h[k] = tail @ x
        x = A @ x
    return np.convolve(h, den)[: n + 1], den


def _trimmed(num: Array) -> Array:
    """Numerator with leading coefficients that are rounding set to zero."""
    out = num.copy()
    small = np.abs(out) <= ROUNDING * np.abs(out).max(initial=0.0)
    out[: int(np.argmin(small))] = 0.0
    return out


def sampled(num: ArrayLike, den: ArrayLike, dt: float, delay: float = 0.0) -> Model:
    """Discrete model of num(s) / den(s) exp(-delay s) with its input held between samples.

    Parameters
    ----------
    num, den : array_like
        Highest power of s first.
    dt : float
        Sample time, s.
    delay : float
        Seconds; a fraction of a sample adds one coefficient to b and none to a.

    Raises
    ------
    IdentError
        dt or delay out of range; a numerator of higher degree than the denominator.

    Examples
    --------
    >>> model = sampled([1.0], [0.13, 1.0], dt=0.01, delay=0.025)  # a servo of 0.13 s
    >>> model.nk, model.dc_gain.__round__(12), model.b.round(4).tolist()
    (3, 1.0, [0.0, 0.0, 0.0, 0.0377, 0.0363])
    """
    from scipy.linalg import companion

    if not is_positive(dt):
        raise IdentError(f"sample time {dt!r} s: above zero, for instance 0.01.")
    plant = ContinuousModel(np.asarray(num, dtype=np.float64), np.asarray(den, dtype=np.float64), float(delay))
    n = len(plant.den) - 1
    full = np.r_[np.zeros(n + 1 - len(plant.num)), plant.num]
    whole = int(np.floor(delay / dt + 1e-9))
    part = min(max(delay / dt - whole, 0.0), 1.0)
    part = 0.0 if part < 1e-9 else part
    if n == 0:
        late = whole + (part > 0)
        return Model(b=np.r_[np.zeros(late), full[0]], a=np.ones(1), nk=late, sample_time=dt)
    power = dt ** np.arange(n + 1)  # time in samples, for coefficients of similar size
    A = np.asarray(companion(plant.den * power), dtype=np.float64)
    B = np.eye(n)[:, 0]
    C = (full * power)[1:] - full[0] * (plant.den * power)[1:]
    late_phi, late_gamma = held(A, B, part)
    rest_phi, rest_gamma = held(A, B, 1 - part)
    a = np.real(np.poly(np.exp(np.roots(plant.den) * dt)))
    phi = rest_phi @ late_phi
    b = numerator(phi, rest_gamma, C, a)
    b = np.r_[b, 0.0] + np.r_[0.0, numerator(phi, rest_phi @ late_gamma, C, a)]
    b += full[0] * (np.r_[a, 0.0] if part == 0 else np.r_[0.0, a])
    b = b if part > 0 else b[:-1]
    nk = whole + (1 if full[0] == 0 or part > 0 else 0)
    return Model(b=np.r_[np.zeros(nk), b[nk - whole :]], a=a, nk=nk, sample_time=dt)


def held(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """Phi and Gamma of x' = A x + B u over a time h with u held."""
    from scipy.linalg import expm

    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A * h, B * h
    whole = np.asarray(expm(block), dtype=np.float64)
    return whole[:n, :n], whole[:n, n]


def numerator(phi: Array, gamma: Array, C: Array, a: Array) -> Array:
    """Numerator b of b / a = C (z - phi)^-1 gamma, in z^-1, of the length of a: impulse response times a."""
    h, x = np.zeros(len(a)), gamma
    for k in range(1, len(a)):
        h[k] = C @ x
        x = phi @ x
    return np.convolve(h, a)[: len(a)]
