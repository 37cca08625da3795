"""Formulas of laws: link, terms, names of the coefficients and text, shared by fits and by the parameter file.

Every law is a link of a linear predictor ``eta = Z theta``; ``FORMS`` gives the link, the transformation of the
factors, the names of the coefficients and the text of the equation. Centred factors are ``u = ln(X/g)`` or ``X - g``:

=====================  ==========================================  =================================  ========
form                   law                                         Z                                  response
=====================  ==========================================  =================================  ========
power                  R = c0 prod X_j^b_j                         1, ln X_1 ... ln X_k               exp(eta)
exponential            R = a exp(b F), or a exp(sum b_j X_j)       1, X_1 ... X_k                     exp(eta)
power_exponential      R = c0 prod X_j^b_j exp(b_k X_k)            1, ln X_1 ... ln X_(k-1), X_k      exp(eta)
linear                 R = c0 + sum b_j X_j                        1, X_1 ... X_k                     eta
load_line              I = A + B fm + k1 VB  (14)                  1, fm, VB                          eta
feed_line              fm = fm0 - k VB       (15)                  1, VB                              eta
additive_wear          R = c0 prod X_j^b_j + k VB                  1, ln X_1 ... ln X_(k-1), VB       see below
second_order           ln R = polynomial of degree 2 in ln(X/g)    1, u_j, u_j^2, u_i u_j             exp(eta)
second_order_original  R = polynomial of degree 2 in X - g         1, u_j, u_j^2, u_i u_j             eta
=====================  ==========================================  =================================  ========

Additive wear is no link of a linear predictor: its response is exp(eta) of all columns but the last, plus the last
column times its coefficient. A category multiplies the product, not the contribution of wear.

Equations 14 and 15: Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587; power law: Alaskari & Oraby,
doi 10.15242/IIE.E1216006; exponential law: eq. 5 of the constant-roughness paper (SURF); second order: Myers,
Montgomery & Anderson-Cook, Response Surface Methodology, ch. 6.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array
from .display import Displayable
from .rounding import format_plain


@dataclass(frozen=True, slots=True)
class Term:
    """A product of powers of the factors of a formula, which one coefficient multiplies.

    Attributes
    ----------
    name : str
        Name of its coefficient: ``V``, ``V^2`` or ``V*f``.
    degrees : tuple of int, length k
        Power of each factor of the formula.

    Examples
    --------
    >>> [term.name for term in second_order_terms(("V", "f"))]
    ['V', 'f', 'V^2', 'f^2', 'V*f']
    """

    name: str
    degrees: tuple[int, ...]

    @property
    def order(self) -> int:
        """Sum of the powers: 1 of a factor, 2 of a square or a product."""
        return sum(self.degrees)


def first_order_terms(factors: Sequence[str]) -> tuple[Term, ...]:
    """One term for each factor."""
    k = len(factors)
    return tuple(Term(name, tuple(int(i == j) for i in range(k))) for j, name in enumerate(factors))


def second_order_terms(factors: Sequence[str]) -> tuple[Term, ...]:
    """Factors, their squares, and their products in pairs, in this order."""
    first = first_order_terms(factors)
    squares = [Term(f"{term.name}^2", tuple(2 * d for d in term.degrees)) for term in first]
    products = [
        Term(f"{a.name}*{b.name}", tuple(i + j for i, j in zip(a.degrees, b.degrees, strict=True)))
        for a, b in combinations(first, 2)
    ]
    return (*first, *squares, *products)


@dataclass(frozen=True, repr=False)  # without slots: `cached_property` keeps its values in __dict__
class Formula(Displayable):
    """Equation of one law: its form, response, factors and, of second order, its terms and centres.

    Attributes
    ----------
    name : str
        Key of ``FORMS``.
    response : str
        Symbol of what is predicted, e.g. ``AW``.
    factors : tuple of str
        Symbols of the k factors.
    terms : tuple of Term
        Of second order only; otherwise each factor is one term.
    centres : tuple of float, length k
        Of second order only: g of each factor, in its unit.
    fixed : tuple of (str, float)
        Factors whose coefficients are given, not estimated, with their values; of first order only.

    Examples
    --------
    >>> formula = Formula("power", "AW", ("V", "f"))
    >>> formula.names, formula.columns([[1.0, np.e]]).tolist()
    (('c0', 'V', 'f'), [[1.0, 0.0, 1.0]])
    >>> formula.equation(["0.01", "0.5", "0.2"])
    '0.01 V^0.5 f^0.2'
    """

    name: str
    response: str
    factors: tuple[str, ...]
    terms: tuple[Term, ...] = ()
    centres: tuple[float, ...] = ()
    fixed: tuple[tuple[str, float], ...] = ()

    @property
    def form(self) -> "FormulaForm":
        """Row of ``FORMS``."""
        return FORMS[self.name]

    @property
    def first_order(self) -> bool:
        """True where each factor has one coefficient, in the order of the factors."""
        return not self.form.second_order

    @cached_property
    def all_terms(self) -> tuple[Term, ...]:
        """Terms in the order of the coefficients after the constant."""
        return self.terms if self.form.second_order else first_order_terms(self.factors)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, constant first: ``c0, V, f`` or ``a, b`` or ``A, B, k1``."""
        named = self.form.coefficients
        if named and len(named) == 1 + len(self.factors):
            return named
        return (named[0] if named else "c0", *(term.name for term in self.all_terms))

    @property
    def logarithmic(self) -> bool:
        """True where the constant is held as its logarithm and errors may multiply the response."""
        return self.form.log_response

    @property
    def linearisable(self) -> bool:
        """True where the response, or its logarithm, is linear in the coefficients."""
        return not self.form.last_added

    @property
    def estimated(self) -> tuple[bool, ...]:
        """For each coefficient, constant first, whether it is estimated."""
        given = {name for name, _ in self.fixed}
        return (True, *(term.name not in given for term in self.all_terms))

    @cached_property
    def logs(self) -> tuple[bool, ...]:
        """For each factor, whether it enters by its logarithm and is therefore above zero."""
        k = len(self.factors)
        return tuple(self.form.log_factors and not (self.form.last_unlogged and j == k - 1) for j in range(k))

    @property
    def log_factors(self) -> bool:
        """True where every factor enters by its logarithm."""
        return all(self.logs)

    @property
    def fault(self) -> str:
        """Contradiction of the form by factors, terms or centres, in words; empty where nothing does."""
        form, k = self.form, len(self.factors)
        strange = [name for name, _ in self.fixed if name not in self.factors]
        if strange or (self.fixed and not (form.log_response and self.first_order and self.linearisable)):
            return (
                f"fixed coefficients are those of factors of a power or exponential law ({self.name} of {self.factors})"
            )
        if form.n_factors is not None and k != form.n_factors:
            return f"a {self.name} law has {form.n_factors} factors, not {k}"
        if not form.second_order:
            return f"a {self.name} law has no terms and centres of its own" if self.terms or self.centres else ""
        if not self.terms or any(
            len(t.degrees) != k or not 1 <= t.order <= 2 or min(t.degrees) < 0 for t in self.terms
        ):
            return f"a {self.name} law has terms of degree 1 or 2 with a power of each of its {k} factors"
        if len({term.degrees for term in self.terms}) < len(self.terms):
            return f"a {self.name} law has each term once"
        if len(self.centres) != k or (form.log_factors and min(self.centres) <= 0):
            return f"a {self.name} law has a centre of each factor, above zero where it enters by its logarithm"
        return ""

    def transformed(self, X: ArrayLike) -> Array:
        """Factors as they enter the terms, shape (..., k): logarithms or values, less the centre."""
        X = np.asarray(X, dtype=float)
        if all(self.logs) and not self.centres:
            return np.asarray(np.log(X), dtype=float)
        g = np.array(self.centres or [1.0 if log else 0.0 for log in self.logs])
        if all(self.logs):
            return np.asarray(np.log(X / g), dtype=float)
        if not any(self.logs):
            return X - g if self.centres else X
        columns = [np.log(X[..., j] / g[j]) if log else X[..., j] - g[j] for j, log in enumerate(self.logs)]
        return np.stack(columns, axis=-1)

    def columns(self, X: ArrayLike) -> Array:
        """Columns of the linear predictor, shape (..., 1 + number of terms), for factors X (..., k)."""
        U = self.transformed(X)
        ones = np.ones((*U.shape[:-1], 1))
        if self.first_order:
            return np.concatenate([ones, U], axis=-1)  # keeps the order of U in memory, on which last digits depend
        places = [[j for j, d in enumerate(term.degrees) for _ in range(d)] for term in self.terms]
        terms = [U[..., at[0]] if len(at) == 1 else U[..., at[0]] * U[..., at[1]] for at in places]
        return np.concatenate([ones, np.stack(terms, axis=-1)], axis=-1)

    def apart(self, X: Array, values: Array, place: int) -> tuple[Array, Array]:
        """One factor transformed, in the shape of its values, and the columns where it counts 1, for factors X (n, k).

        A column is that of the other factors times the transformed one to its degree in the term.
        """
        log = self.logs[place]
        g = self.centres[place] if self.centres else 1.0 if log else 0.0
        others = X.copy()
        others[:, place] = g * math.e if log else g + 1.0
        return (np.log(values / g) if log else values - g), self.columns(others)

    def predictor(self, theta: ArrayLike, Z: Array) -> Array:
        """Linear predictor Z theta, shape (...,), without the contribution that additive wear has."""
        theta = np.asarray(theta, dtype=float)
        if self.linearisable:
            return np.asarray(Z @ theta)
        product = theta.copy()
        product[self._last] = 0.0
        return np.asarray(Z @ product)

    def response_of(self, theta: ArrayLike, Z: Array) -> Array:
        """The response, shape (...,), for columns Z (..., p); infinite where it overflows."""
        eta = self.predictor(theta, Z)
        with np.errstate(over="ignore", under="ignore"):
            value = np.exp(eta) if self.logarithmic else eta
        return value if self.linearisable else value + Z[..., self._last] * np.asarray(theta)[self._last]

    def derivative(self, theta: ArrayLike, Z: Array) -> Array:
        """Derivative of the response by theta, shape (..., p)."""
        if not self.logarithmic:
            return Z
        with np.errstate(over="ignore", under="ignore"):
            G = np.exp(self.predictor(theta, Z))[..., None] * Z
        if not self.linearisable:
            G[..., self._last] = Z[..., self._last]
        return np.asarray(G)

    @property
    def _last(self) -> int:
        """Position of the coefficient of the last factor."""
        return len(self.factors)

    def equation(self, coefficients: Sequence[str]) -> str:
        """Right-hand side of the equation with these coefficients, given as text."""
        return self.form.equation(self, coefficients)

    def printed(self, text: str) -> dict[str, float]:
        """Coefficients on the right of the text of an equation, by name; empty where the text is not this equation.

        A power may be written as the symbol alone (exponent 1) or be absent (exponent 0).

        Examples
        --------
        >>> Formula("power", "AW", ("V", "f", "t")).printed("AW = 0.01 V^-0.5 t")
        {'c0': 0.01, 'V': -0.5, 'f': 0.0, 't': 1.0}
        """
        mine = text.startswith(f"{self.response} = ")
        right = text[len(self.response) + 3 :] if mine else text.partition(" = ")[2]
        found = re.match(_pattern(self), right)
        held = {} if found is None else found.groupdict()
        return {name: _printed(held, i) for i, name in enumerate(self.names)} if held else {}


def _pattern(formula: Formula) -> str:
    """Regular expression of the right of an equation: ``value<i>`` is coefficient i, ``power<i>`` a power."""
    marks = [f"\0{i}\0" for i in range(len(formula.names))]  # stand for the coefficients
    pattern = re.escape(formula.equation(marks))
    for i, symbol in enumerate(formula.factors if formula.first_order else (), 1):
        power = rf"(?P<power{i}>\ {re.escape(symbol)}(?:\^{marks[i]})?)?"
        pattern = pattern.replace(re.escape(f" {symbol}^{marks[i]}"), power)
    number = r"\\s*\\d+(?:\\.\\d*)?(?:[eE][-+]?\\d+)?)"
    pattern = re.sub(r"\\\+\\ \0(\d+)\0", rf"(?P<value\1>[-+]{number}", pattern)  # a term of a sum
    pattern = re.sub(r"\0(\d+)\0", rf"(?P<value\1>[-+]?{number}", pattern)
    return rf"{pattern}(?= for |$)".replace("\\ ", r"\s*")


def _printed(held: Mapping[str, str | None], i: int) -> float:
    """Value of coefficient i in the groups of an equation: that of a power without a number is 1, of no power 0."""
    if value := held[f"value{i}"]:
        return float("".join(value.split()))
    return 1.0 if held[f"power{i}"] else 0.0


def _products(formula: Formula, c: Sequence[str]) -> str:
    return " ".join([c[0], *(f"{x}^{b}" for x, b in zip(formula.factors, c[1:], strict=True))])


def _exponential(formula: Formula, c: Sequence[str]) -> str:
    inside = " ".join(_signed(c[1:], formula.factors)).removeprefix("+ ")
    return f"{c[0]} exp({'-' + inside.removeprefix('- ') if inside.startswith('- ') else inside})"


def _power_exponential(formula: Formula, c: Sequence[str]) -> str:
    *logged, last = formula.factors
    return " ".join([c[0], *(f"{x}^{b}" for x, b in zip(logged, c[1:-1], strict=True)), f"exp({c[-1]} {last})"])


def _additive(formula: Formula, c: Sequence[str]) -> str:
    *logged, last = formula.factors
    product = [c[0], *(f"{x}^{b}" for x, b in zip(logged, c[1:-1], strict=True))]
    return " ".join([*product, *_signed(c[-1:], [last])])


def _sum(formula: Formula, c: Sequence[str]) -> str:
    return " ".join([c[0], *_signed(c[1:], formula.factors)])


def _second_order(formula: Formula, c: Sequence[str]) -> str:
    """Powers of ratios for the terms of degree 1, and the exponential of the others."""
    ratios = [f"{x}/{format_plain(g, 6)}" for x, g in zip(formula.factors, formula.centres, strict=True)]
    coefficients = list(zip(formula.terms, c[1:], strict=True))
    powers = [f"({_product(term, ratios)})^{b}" for term, b in coefficients if term.order == 1]
    higher = [(_product(term, [f"ln({ratio})" for ratio in ratios]), b) for term, b in coefficients if term.order > 1]
    inside = " ".join(_signed([b for _, b in higher], [text for text, _ in higher])).removeprefix("+ ")
    return " ".join([c[0], *powers, *([f"exp({inside})"] if inside else [])])


def _second_order_original(formula: Formula, c: Sequence[str]) -> str:
    differences = [
        f"({x} {'-' if g >= 0 else '+'} {format_plain(abs(g), 6)})"
        for x, g in zip(formula.factors, formula.centres, strict=True)
    ]
    return " ".join([c[0], *_signed(c[1:], [_product(term, differences) for term in formula.terms])])


def _product(term: Term, factors: Sequence[str]) -> str:
    found = [f"{x}^{d}" if d > 1 else x for x, d in zip(factors, term.degrees, strict=True) if d]
    return " ".join(found)


def _signed(coefficients: Sequence[str], factors: Sequence[str]) -> list[str]:
    pairs = zip(coefficients, factors, strict=True)
    return [f"{'-' if b[0] == '-' else '+'} {b.lstrip('-')} {x}" for b, x in pairs]


@dataclass(frozen=True, slots=True)
class FormulaForm:
    """Link, transformation of the factors, names of the coefficients and text of one form.

    Attributes
    ----------
    log_response : bool
        Whether the linear predictor is that of the logarithm of the response.
    log_factors : bool
        Whether the factors enter by their logarithms.
    coefficients : tuple of str, or None
        Names, the constant first, where there are as many; the terms have the names of their factors otherwise. None:
        the constant is ``c0``.
    equation : callable
        Right-hand side of the equation from the formula and the coefficients as text.
    n_factors : int or None
        Number of factors where it is fixed.
    last_unlogged : bool
        Whether the last factor enters as it is, though the others enter by their logarithms.
    last_added : bool
        Whether the last factor times its coefficient is added to the product of the others.
    second_order : bool
        Whether there are squares and products of the factors, which are centred.
    """

    log_response: bool
    log_factors: bool
    coefficients: tuple[str, ...] | None
    equation: Callable[[Formula, Sequence[str]], str]
    n_factors: int | None = None
    last_unlogged: bool = False
    last_added: bool = False
    second_order: bool = False


FORMS: dict[str, FormulaForm] = {
    "power": FormulaForm(True, True, None, _products),
    "exponential": FormulaForm(True, False, ("a", "b"), _exponential),
    "load_line": FormulaForm(False, False, ("A", "B", "k1"), _sum, n_factors=2),
    "feed_line": FormulaForm(False, False, ("fm0", "slope"), _sum, n_factors=1),
    "linear": FormulaForm(False, False, None, _sum),
    "power_exponential": FormulaForm(True, True, None, _power_exponential, last_unlogged=True),
    "additive_wear": FormulaForm(True, True, None, _additive, last_unlogged=True, last_added=True),
    "second_order": FormulaForm(True, True, None, _second_order, second_order=True),
    "second_order_original": FormulaForm(False, False, None, _second_order_original, second_order=True),
}
