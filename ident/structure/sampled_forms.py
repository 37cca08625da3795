"""Continuous forms with few parameters, sampled with a zero-order hold, with sensitivities to their parameters.

The response to an input held for one sample is h_j = s(j - lambda) - s(j - 1 - lambda), s the unit step response and
lambda the fraction of a sample in the delay; the numerator is the product of h and a, cut behind its last coefficient
(Cayley-Hamilton). Time is counted in samples. Source: Franklin, Powell & Workman 1998, Digital Control of Dynamic
Systems, section 4.3.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array

# Of the form with parameters p at times t (m,): s, g = ds/dt (m,) and the derivatives of s (parameters, m)
Response = Callable[[Array, Array], tuple[Array, Array, Array]]
# Denominator of the form without its integrator, and its derivatives (parameters, order)
Denominator = Callable[[Array], tuple[Array, Array]]
SMALL = 0.01  # of (nu t / T)^2: below, the difference of nearly equal numbers is replaced by its series


@dataclass(frozen=True, slots=True)
class Form:
    """Structure K N(s) / (s^i D(s)) exp(-L s), i = 1 for an ``integrating`` form.

    Attributes
    ----------
    name, equation : str
    parameters : tuple of str
        Of K, log T, log zeta, Tz; the delay L follows where the form has one. Times in samples.
    order : int
        Degree of D.
    integrating : bool
    delayed : bool
    response, denominator : callable
    """

    name: str
    equation: str
    parameters: tuple[str, ...]
    order: int
    integrating: bool
    response: Response
    denominator: Denominator
    delayed: bool = True

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.parameters) + self.delayed


@dataclass(frozen=True, slots=True)
class Sampled:
    """Discrete model q^-(whole+1) b / a of a form and its derivatives; ``a`` (order,) without the leading 1 and pole 1.

    Attributes
    ----------
    whole : int
        Whole samples of delay.
    b, db : ndarray, shape (nb,), (parameters, nb)
    a, da : ndarray, shape (order,), (parameters, order)
    """

    whole: int
    b: Array
    a: Array
    db: Array
    da: Array


def sample(form: Form, p: Array) -> Sampled:
    """Zero-order-hold model of a form with parameters p (size,)."""
    delay, k = float(p[-1]) if form.delayed else 0.0, len(form.parameters)
    whole = math.floor(delay)
    nb = form.order + form.integrating + form.delayed
    t = np.maximum(np.arange(nb + 1) - (delay - whole), 0.0)
    s, g, ds = form.response(t, p[:k])
    a, da = form.denominator(p[:k])
    rows = np.zeros((1 + form.size, nb + 1))  # s, then its derivatives; nothing before the delay has passed
    rows[0, 1:], rows[1 : 1 + k, 1:] = s[1:], ds[:, 1:]
    full, dfull = np.zeros(len(a) + 1 + form.integrating), np.zeros((form.size, len(a) + 1 + form.integrating))
    full[0], full[1 : len(a) + 1], dfull[:k, 1 : len(a) + 1] = 1.0, a, da
    if form.delayed:
        rows[-1, 1:] = -g[1:]
        da = dfull[:, 1 : len(a) + 1].copy()
    if form.integrating:  # times 1 - q^-1
        full[1:] -= full[:-1].copy()
        dfull[:, 1:] -= dfull[:, :-1].copy()
    h = rows[:, 1:] - rows[:, :-1]
    b = h.copy()
    for i in range(1, min(len(full), nb + 1)):  # products with a, cut behind nb coefficients
        b[:, i:] += full[i] * h[:, : nb - i]
        b[1:, i:] += dfull[:, i : i + 1] * h[0, : nb - i]
    return Sampled(whole, b[0], a, b[1:], da)


def _integrator(t: Array, p: Array) -> tuple[Array, Array, Array]:
    return p[0] * t, np.full(len(t), p[0]), t[None].copy()


def _no_denominator(p: Array) -> tuple[Array, Array]:
    return np.zeros(0), np.zeros((1, 0))


def _lag(t: Array, p: Array) -> tuple[Array, Array, Array]:
    K, T = p[0], math.exp(p[1])
    E = np.exp(-t / T)
    g = K / T * E
    return K * (1 - E), g, np.vstack([1 - E, -t * g])


def _integrator_lag(t: Array, p: Array) -> tuple[Array, Array, Array]:
    K, T = p[0], math.exp(p[1])
    E = np.exp(-t / T)
    unit = t - T * (1 - E)
    return K * unit, K * (1 - E), np.vstack([unit, -K * (T * (1 - E) - t * E)])


def _lag_denominator(p: Array) -> tuple[Array, Array]:
    x = math.exp(-p[1])
    e = math.exp(-x)
    return np.array([-e]), np.array([[0.0], [-x * e]])


def _modes(x: Array, zeta: float) -> tuple[Array, Array, Array]:
    """exp(-zeta x) times C = cos(nu x), S = sin(nu x) / nu, Q = (S - x C) / nu^2; nu^2 = 1 - zeta^2 of either sign."""
    square = 1 - zeta * zeta
    if abs(square) < 1e-12:
        square = 1e-12
    nu, decay = math.sqrt(abs(square)), np.exp(-zeta * x)
    if square > 0:
        c, s = decay * np.cos(nu * x), decay * np.sin(nu * x) / nu
    else:  # of the two exponentials, as cosh overflows
        slow, fast = np.exp((nu - zeta) * x), np.exp((-nu - zeta) * x)
        c, s = (slow + fast) / 2, (slow - fast) / (2 * nu)
    z = square * x * x
    if not (np.abs(z) < SMALL).any():
        return c, s, (s - x * c) / square
    series = x**3 * decay * (1 / 3 - z / 30 + z * z / 840)
    return c, s, np.where(np.abs(z) < SMALL, series, (s - x * c) / square)


def _second_order(t: Array, p: Array) -> tuple[Array, Array, Array]:
    K, T, zeta = p[0], math.exp(p[1]), math.exp(p[2])
    c, s, q = _modes(t / T, zeta)
    unit, g = 1 - c - zeta * s, K / T * s
    return K * unit, g, np.vstack([unit, -t * g, -zeta * K * q])


def _second_order_zero(t: Array, p: Array) -> tuple[Array, Array, Array]:
    K, T, zeta, Tz = p[0], math.exp(p[1]), math.exp(p[2]), p[3]
    c, s, q = _modes(t / T, zeta)
    g, slope = s / T, (c - zeta * s) / T**2  # impulse response for K = 1, and its derivative
    unit = 1 - c - zeta * s + Tz * g
    by_T = -t * g - Tz * (g + t * slope)
    by_zeta = -q + Tz / T * (zeta * q - t / T * s)
    return K * unit, K * (g + Tz * slope), np.vstack([unit, K * by_T, zeta * K * by_zeta, K * g])


def _second_order_denominator(p: Array) -> tuple[Array, Array]:
    x, zeta = math.exp(-p[1]), math.exp(p[2])
    (c,), (s,), _ = _modes(np.array([x]), zeta)
    last = math.exp(-2 * zeta * x)
    by_T = [-2 * x * (zeta * c + (1 - zeta * zeta) * s), 2 * zeta * x * last]
    by_zeta = [-2 * zeta * x * (zeta * s - c), -2 * zeta * x * last]
    rows = [[0.0, 0.0], by_T, by_zeta] + [[0.0, 0.0]] * (len(p) > 3)
    return np.array([-2 * c, last]), np.array(rows)


def _equal_lags(n: int) -> Response:
    """Response of K / (T s + 1)^n."""

    def response(t: Array, p: Array) -> tuple[Array, Array, Array]:
        K, x = p[0], t * math.exp(-p[1])
        decay = np.exp(-x)
        unit = 1 - decay * sum(x**k / math.factorial(k) for k in range(n))
        g = K * math.exp(-p[1]) * decay * x ** (n - 1) / math.factorial(n - 1)
        return K * unit, g, np.vstack([unit, -t * g])

    return response


def _equal_denominator(n: int) -> Denominator:
    """Denominator of K / (T s + 1)^n: the power n of 1 - e q^-1, e = exp(-1/T)."""
    binomial = np.array([math.comb(n, k) for k in range(1, n + 1)], dtype=np.float64)
    power = np.arange(1, n + 1)

    def denominator(p: Array) -> tuple[Array, Array]:
        x = math.exp(-p[1])
        a = binomial * (-math.exp(-x)) ** power
        return a, np.vstack([np.zeros(n), power * x * a])

    return denominator


SECOND = "(T^2 s^2 + 2 zeta T s + 1)"
OSCILLATION = ("K", "T", "zeta")
LAG = Form("lag", "K / (T s + 1)", ("K", "T"), 1, False, _lag, _lag_denominator)
SECOND_ORDER = (
    Form("second order", f"K / {SECOND}", OSCILLATION, 2, False, _second_order, _second_order_denominator),
    Form(
        "second order with zero", f"K (Tz s + 1) / {SECOND}", (*OSCILLATION, "Tz"), 2, False,
        _second_order_zero, _second_order_denominator,
    ),
)  # fmt: skip
INTEGRATORS = (
    Form("integrator", "K / s", ("K",), 0, True, _integrator, _no_denominator),
    Form("integrator with lag", "K / (s (T s + 1))", ("K", "T"), 1, True, _integrator_lag, _lag_denominator),
)
EQUAL_LAGS = tuple(
    Form(f"{word} equal lags", f"K / (T s + 1)^{n}", ("K", "T"), n, False, _equal_lags(n), _equal_denominator(n))
    for n, word in ((3, "three"), (4, "four"), (5, "five"))
)
