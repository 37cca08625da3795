"""Forms of the laws in a fit: design, response, gradient and first guess of a formula of ``core.formula``."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..core.arrays import Array
from ..core.formula import Formula
from .least_squares import linear

Error = Literal["multiplicative", "additive"]

# Largest logarithm of a constant: beyond it the square of a standard error overflows (doubles end at 709).
LARGEST_LOG = 300.0


@dataclass(frozen=True, slots=True, repr=False)
class LawForm(Formula):
    """The formula of one law, and what a fit computes from it.

    Attributes
    ----------
    name, response, factors, terms, centres
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
        eta = Z @ theta
        if not self.logarithmic:
            return eta
        with np.errstate(over="ignore"):  # a trial step of the solver, which rejects it
            return np.exp(eta)

    def gradient(self, theta: Array, Z: Array) -> Array:
        """Derivative of the response by theta, shape (n, p)."""
        return self.response_at(theta, Z)[:, None] * Z if self.logarithmic else Z

    def guess(self, Z: Array, y: Array) -> Array:
        """First guess of theta: the linear fit, to ln y where the law is logarithmic."""
        return linear(Z, np.log(y) if self.logarithmic else y).params

    def coefficients(self, theta: Array) -> Array:
        """Coefficients as they are printed: exp of the first where theta holds its logarithm."""
        out = theta.copy()
        if self.logarithmic:
            with np.errstate(over="ignore"):  # the end of a very wide interval
                out[0] = np.exp(out[0])
        return out
