"""Forms of the laws in a fit: design, response, gradient and first guess of a formula of ``core.formula``."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..core.arrays import Array, Flags
from ..core.formula import Formula
from .least_squares import linear

Error = Literal["multiplicative", "additive"]

# Largest logarithm of a constant: beyond it the square of a standard error overflows (doubles end at 709).
LARGEST_LOG = 300.0
SHARES = (0.02, 0.1, 0.3, 0.6)  # of the response that wear adds, from which the fit of additive wear starts


@dataclass(frozen=True, slots=True, repr=False)
class LawForm(Formula):
    """The formula of one law, and what a fit computes from it.

    Attributes
    ----------
    name, response, factors, terms, centres, fixed
        As in `core.formula.Formula`.

    Examples
    --------
    >>> law = LawForm("power", "AW", ("V",))
    >>> law.response_at(np.array([0.0, 2.0]), law.design(np.array([[3.0]]))).round(6).tolist()
    [9.0]
    """

    def other_factors(self, name: str) -> tuple[str, ...]:
        """Symbols of the factors without this one."""
        return tuple(other for other in self.factors if other != name)

    def positive(self, error: Error) -> tuple[str, ...]:
        """Columns that need values above zero: factors that enter by logarithms, and y of multiplicative errors."""
        logged = tuple(name for name, log in zip(self.factors, self.logs, strict=True) if log)
        return (self.response, *logged) if self.logarithmic and error == "multiplicative" else logged

    def design(self, X: Array, shifts: Array | None = None) -> Array:
        """Z of the law, shape (n, p), for factors X (n, k) and indicator columns (n, s)."""
        Z = self.columns(X)
        return Z if shifts is None or not shifts.shape[1] else np.hstack([Z, shifts])

    def response_at(self, theta: Array, Z: Array) -> Array:
        """The response, shape (n,), in its own unit."""
        return self.response_of(theta, Z)

    def gradient(self, theta: Array, Z: Array) -> Array:
        """Derivative of the response by theta, shape (n, p)."""
        return self.derivative(theta, Z)

    def scaled(self, theta: Array, Z: Array, error: Error) -> tuple[Array, Array]:
        """Prediction (n,) and its derivative by theta (n, p) on the scale of the errors; NaN without a logarithm."""
        if error == "multiplicative" and self.linearisable:
            return Z @ theta, Z
        value, G = self.response_at(theta, Z), self.gradient(theta, Z)
        if error == "additive" or not self.logarithmic:
            return value, G
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            return np.log(value), G / value[:, None]

    def free(self, shifts: int) -> Flags:
        """Mask of the elements of theta that are estimated, shape (p,), with that number of shifts at the end."""
        return np.array([*self.estimated, *([True] * shifts)])

    def start(self, shifts: int) -> Array:
        """Theta with the fixed coefficients in their places and zeros elsewhere, shape (p,)."""
        given = dict(self.fixed)
        return np.array([0.0, *(given.get(term.name, 0.0) for term in self.all_terms), *([0.0] * shifts)])

    def guess(self, Z: Array, y: Array) -> Array:
        """First guess of theta: the linear fit, to ln y where the law is logarithmic."""
        if not self.linearisable:
            return additive_start(Z, y, self._last)
        theta = self.start(Z.shape[1] - len(self.estimated))
        free = self.free(Z.shape[1] - len(self.estimated))
        theta[free] = linear(Z[:, free], (np.log(y) if self.logarithmic else y) - Z @ theta).params
        return theta

    def coefficients(self, theta: Array) -> Array:
        """Coefficients as they are printed: exp of the first where theta holds its logarithm."""
        out = theta.copy()
        if self.logarithmic:
            with np.errstate(over="ignore"):  # the end of a very wide interval
                out[0] = np.exp(out[0])
        return out


def additive_start(Z: Array, y: Array, last: int) -> Array:
    """Start of additive wear: of some shares of the response that wear may add, that of the least sum of squares."""
    others, wear = np.delete(Z, last, axis=1), Z[:, last]
    best: tuple[float, Array] | None = None
    for share in SHARES:
        k = share * float(y.mean()) / max(float(np.abs(wear).mean()), 1e-300)
        product = np.maximum(y - k * wear, 0.1 * y)
        theta = np.insert(linear(others, np.log(product)).params, last, k)
        whole = np.exp(others @ np.delete(theta, last)) + k * wear
        left = float(np.sum(np.log(y / np.maximum(whole, 1e-300)) ** 2))
        if best is None or left < best[0]:
            best = (left, theta)
    assert best is not None  # noqa: S101  SHARES is not empty
    return best[1]
