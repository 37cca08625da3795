"""The laws themselves: formula, gradient and first guess of each, side by side.

All of them are a link of a linear form ``eta = Z theta``, and differ in Z and in the link:

=============  ==============================  =========================  ========
form           law                             Z                          response
=============  ==============================  =========================  ========
power          R = c0 prod X_j^b_j             1, ln X_1 ... ln X_k       exp(eta)
exponential    R = a exp(b F)                  1, F                       exp(eta)
load_line      I = A + B fm + k1 VB  (14)      1, fm, VB                  eta
feed_line      fm = fm0 - k VB       (15)      1, VB                      eta
=============  ==============================  =========================  ========

Equations 14 and 15: Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587; power law: Alaskari & Oraby,
doi 10.15242/IIE.E1216006; exponential law: eq. 5 of the constant-roughness paper (SURF).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.display import Displayable
from .linear import linear

Array = NDArray[np.float64]
Form = Literal["power", "exponential", "load_line", "feed_line"]
Error = Literal["multiplicative", "additive"]

# Of the logarithm of a constant: beyond it the square of a standard error is no number (doubles end at 709).
LARGEST_LOG = 300.0


@dataclass(frozen=True, slots=True, repr=False)
class Law(Displayable):
    """One law: what it is of, in what, and how its parameters are called.

    Attributes
    ----------
    form : str
        ``power``, ``exponential``, ``load_line`` or ``feed_line``.
    response : str
        Symbol of what is predicted, e.g. ``AW``.
    factors : tuple of str
        Symbols of the k factors.
    names : tuple of str
        Names of the coefficients, constant first: ``c0, V, f`` or ``a, b`` or ``A, B, k1``.

    Examples
    --------
    >>> law = Law("power", "AW", ("V",), ("c0", "V"))
    >>> law.response_at(np.array([0.0, 2.0]), law.design(np.array([[3.0]]))).round(6).tolist()
    [9.0]
    """

    form: Form
    response: str
    factors: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def logarithmic(self) -> bool:
        """True where the law is a straight line for the logarithm of the response."""
        return self.form in ("power", "exponential")

    def design(self, X: Array, shifts: Array | None = None) -> Array:
        """Z of the law, shape (n, 1 + k + s), for factors X (n, k) and indicator columns (n, s)."""
        terms = np.log(X) if self.form == "power" else X
        columns = [np.ones((len(X), 1)), terms]
        return np.hstack(columns if shifts is None or not shifts.shape[1] else [*columns, shifts])

    def response_at(self, theta: Array, Z: Array) -> Array:
        """The response, shape (n,), in its own unit."""
        eta = Z @ theta
        if not self.logarithmic:
            return eta
        with np.errstate(over="ignore"):  # a wild trial step of the solver: it is turned down there
            return np.exp(eta)

    def gradient(self, theta: Array, Z: Array) -> Array:
        """Derivative of the response by theta, shape (n, p)."""
        return self.response_at(theta, Z)[:, None] * Z if self.logarithmic else Z

    def guess(self, Z: Array, y: Array) -> Array:
        """First guess of theta: the straight-line fit, to ln y where the law is logarithmic."""
        return linear(Z, np.log(y) if self.logarithmic else y).params

    def coefficients(self, theta: Array) -> Array:
        """Coefficients as they are printed: exp of the first where theta holds its logarithm."""
        out = theta.copy()
        if self.logarithmic:
            with np.errstate(over="ignore"):  # the end of an interval that says nothing
                out[0] = np.exp(out[0])
        return out


def power(response: str, factors: tuple[str, ...]) -> Law:
    """``R = c0 prod X_j^b_j``; each exponent carries its factor's symbol."""
    return Law("power", response, factors, ("c0", *factors))


def exponential(response: str, factor: str) -> Law:
    """``R = a exp(b F)``."""
    return Law("exponential", response, (factor,), ("a", "b"))


def load_line(response: str, feed: str, wear: str) -> Law:
    """``I = A + B fm + k1 VB``, CLM-2023 eq. 14."""
    return Law("load_line", response, (feed, wear), ("A", "B", "k1"))


def feed_line(feed: str, wear: str) -> Law:
    """``fm = fm0 + slope VB`` at constant current, CLM-2023 eq. 15: fm0 = (I - A)/B, slope = -k1/B."""
    return Law("feed_line", feed, (wear,), ("fm0", "slope"))
