"""Forms of the laws: formula, gradient, first guess and text, all from one table.

Every form is a link of a linear predictor ``eta = Z theta``; ``FORMS`` gives the link, the columns of Z, the names of
the coefficients and the text of the equation:

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..core.arrays import Array
from ..core.display import Displayable
from .least_squares import linear

Error = Literal["multiplicative", "additive"]
# right-hand side of the equation from the factors and the coefficients, both as text
Equation = Callable[[Sequence[str], Sequence[str]], str]

# Largest logarithm of a constant: beyond it the square of a standard error overflows (doubles end at 709).
LARGEST_LOG = 300.0


def _products(factors: Sequence[str], c: Sequence[str]) -> str:
    return " ".join([c[0], *(f"{x}^{b}" for x, b in zip(factors, c[1:], strict=True))])


def _exponential(factors: Sequence[str], c: Sequence[str]) -> str:
    return f"{c[0]} exp({c[1]} {factors[0]})"


def _sum(factors: Sequence[str], c: Sequence[str]) -> str:
    terms = (f"{'-' if b[0] == '-' else '+'} {b.lstrip('-')} {x}" for x, b in zip(factors, c[1:], strict=True))
    return " ".join([c[0], *terms])


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Link, transformation of the factors, names of the coefficients and text of one form.

    ``coefficients`` None: ``c0`` and the symbols of the factors, which are then the names of their exponents.
    """

    log_response: bool
    log_factors: bool
    coefficients: tuple[str, ...] | None
    equation: Equation


FORMS: dict[str, Linearisation] = {
    "power": Linearisation(True, True, None, _products),
    "exponential": Linearisation(True, False, ("a", "b"), _exponential),
    "load_line": Linearisation(False, False, ("A", "B", "k1"), _sum),
    "feed_line": Linearisation(False, False, ("fm0", "slope"), _sum),
}


@dataclass(frozen=True, slots=True, repr=False)
class LawForm(Displayable):
    """The form of one law with its response and factors.

    Attributes
    ----------
    name : str
        ``power``, ``exponential``, ``load_line`` or ``feed_line``.
    response : str
        Symbol of what is predicted, e.g. ``AW``.
    factors : tuple of str
        Symbols of the k factors.

    Examples
    --------
    >>> law = LawForm("power", "AW", ("V",))
    >>> law.response_at(np.array([0.0, 2.0]), law.design(np.array([[3.0]]))).round(6).tolist()
    [9.0]
    """

    name: str
    response: str
    factors: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, constant first: ``c0, V, f`` or ``a, b`` or ``A, B, k1``."""
        return FORMS[self.name].coefficients or ("c0", *self.factors)

    def other_factors(self, name: str) -> tuple[str, ...]:
        """Symbols of the factors without this one."""
        return tuple(other for other in self.factors if other != name)

    @property
    def logarithmic(self) -> bool:
        """True where the law is linear for the logarithm of the response."""
        return FORMS[self.name].log_response

    @property
    def log_factors(self) -> bool:
        """True where the factors enter by their logarithms, and are therefore above zero."""
        return FORMS[self.name].log_factors

    def equation(self, coefficients: Sequence[str]) -> str:
        """Right-hand side of the equation with these coefficients, given as text."""
        return FORMS[self.name].equation(self.factors, coefficients)

    def design(self, X: Array, shifts: Array | None = None) -> Array:
        """Z of the law, shape (n, 1 + k + s), for factors X (n, k) and indicator columns (n, s)."""
        columns = [np.ones((len(X), 1)), np.log(X) if self.log_factors else X]
        return np.hstack(columns if shifts is None or not shifts.shape[1] else [*columns, shifts])

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
