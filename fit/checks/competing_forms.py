"""Forms that compete with a power law, each fitted to its rows in ln R; AW is the wear among the factors.

===========================  ==================================================
power law                    R = c0 prod X_j^b_j
exponential in wear          R = c0 prod X_j^b_j exp(k AW), AW not among the X_j
additive in wear             R = c0 prod X_j^b_j + k AW, AW not among the X_j, k > 0
an exponent of t per edge    R = c0 prod X_j^b_j t^u, u of each edge about 0
second order in logs         ln R = a + sum b_j x_j + sum b_jk x_j x_k, x = ln X
straight line in wear        R = c0 prod X_j^b_j (1 + k AW), AW not among the X_j, k > 0
offset in wear               R = c0 prod X_j^b_j (AW + a)^b, AW not among the X_j
offset in t                  R = c0 prod X_j^b_j (t + t0)^b, t not among the X_j; of forces and power
===========================  ==================================================

A power of wear is zero at no wear. The forms whose value there is positive are fitted to rows at zero wear as well.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Texts
from ...core.errors import FitError
from ...datasets import Runs
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import linear
from ..rows import identifiable
from .strata import MOST_ROWS, orthonormal, units_of
from .time_exponent import TIME, common_exponent, slope_spread, whitened

SHARES = (0.1, 0.5)  # of the response that wear adds, from which the additive form starts
NEGLIGIBLE = 1e-6  # share of the response below which the contribution of wear is zero
RATES = np.geomspace(1e-3, 1e3, 61)  # k times the mean wear, where the least sum of squares is looked for
OFFSETS = np.geomspace(1e-2, 1e2, 41)  # offset over the mean of its factor
CLOSE = np.linspace(0.98, 0.02, 33)  # negative offset over the least value of its factor
NO_OFFSET = 0.01  # offset over the least value of its factor: below it the form is the power law


@dataclass(frozen=True, slots=True)
class FormRows:
    """Rows to which forms are fitted.

    Attributes
    ----------
    law : LawFit
        The power law of which they are alternatives.
    X, shifts : ndarray, shape (n, k) and (n, s)
    y : ndarray, shape (n,)
        ln R.
    edge : ndarray of object, shape (n,), or None
    zero : ndarray of bool, shape (n,)
        Rows at zero wear, which the power law cannot have.
    """

    law: LawFit
    X: Array
    shifts: Array
    y: Array
    edge: Texts | None
    zero: Flags

    def column(self, name: str) -> Array:
        """Values of a factor, shape (n,)."""
        return self.X[:, self.law.factors.index(name)]

    def others(self, name: str) -> tuple[list[str], Array]:
        """Names and columns of the power law without one factor: constant, logarithms, shifts."""
        keep = [j for j, factor in enumerate(self.law.factors) if factor != name]
        names = ["ln c0", *(self.law.factors[j] for j in keep), *self.law.names[1 + len(self.law.factors) :]]
        return names, np.hstack([np.ones((len(self.y), 1)), np.log(self.X[:, keep]), self.shifts])


def rows_of(law: LawFit) -> FormRows:
    """The rows of a law."""
    return FormRows(law, law.X, law.shifts, np.log(law.observed), law.edge, np.zeros(law.nobs, dtype=bool))


def with_zero_wear(law: LawFit, runs: Runs) -> FormRows | NotAvailable | None:
    """The rows of a law and those of the runs at zero wear; None where there are none.

    Rows whose other factors are zero or missing are left out; where no other row is at zero wear, the reason is
    returned.
    """
    wear = wear_of(law)
    if wear is None or not all(runs.has(name) for name in (*law.factors, law.response)):
        return None
    X, R = np.column_stack([runs.values(name) for name in law.factors]), runs.values(law.response)
    fresh = (runs.values(wear) == 0) & (R > 0)
    known, shifts = _shifts(law, runs)
    others = law.formula.other_factors(wear)
    allowed = fresh & known & np.all([runs.values(name) > 0 for name in others], axis=0)
    if not allowed.any():
        zero = ", ".join(name for name in others if np.any(fresh & (runs.values(name) == 0)))
        return NotAvailable(f"{zero} is zero in these rows as well") if zero else None
    rows = np.flatnonzero(allowed)
    if law.repeats > 1:
        rows = rows[~pd.DataFrame(np.column_stack([X, R])[rows]).duplicated().to_numpy()]
    rows = rows[:: -(-len(rows) // MOST_ROWS)]
    edge = None if law.edge is None else np.concatenate([law.edge, runs.labels("edge")[rows]])
    return FormRows(
        law, np.vstack([law.X, X[rows]]), np.vstack([law.shifts, shifts[rows]]),
        np.log(np.concatenate([law.observed, R[rows]])), edge, np.arange(law.nobs + len(rows)) >= law.nobs,
    )  # fmt: skip


def _shifts(law: LawFit, runs: Runs) -> tuple[Flags, Array]:
    """Rows of the runs whose level is one of the law, and their indicator columns."""
    if law.by is None:
        return np.ones(len(runs), dtype=bool), np.empty((len(runs), 0))
    level = runs.labels(law.by.column)
    columns = np.column_stack([(level == name).astype(float) for name in law.by.levels])
    return np.isin(level, (law.by.reference, *law.by.levels)), columns


@dataclass(frozen=True, slots=True)
class FittedForm:
    """A form on its rows: ``columns`` and ``rest`` may be weighted, ``Z`` and ``residuals`` are in ln R."""

    name: str
    formula: str
    coefficients: Mapping[str, float]
    Z: Array
    residuals: Array
    columns: Array
    rest: Array


def power_form(law: LawFit) -> FittedForm:
    """The power law itself, in ln R."""
    Z, y = law.design, np.log(law.observed)
    formula = f"{law.response} = c0 {_product(law.factors)}"
    fit = _linear_form("power law", formula, ["ln c0", *law.names[1:]], Z, y)
    if isinstance(fit, NotAvailable):  # the law itself was fitted to these rows
        raise FitError(f"{law.response}: {fit}")
    return fit


Maker = Callable[[FormRows], FittedForm | NotAvailable]


@dataclass(frozen=True, slots=True)
class Form:
    """A form that competes with a power law; ``fitted`` fits it to rows.

    Attributes
    ----------
    kind, name : str
        Without and with the symbol of the wear.
    zero_wear : bool
        Whether it is positive at zero wear, so that such rows take part.
    choice : str
        Its name in `form_choice.CHOICES`, or empty.
    """

    kind: str
    name: str
    fitted: Maker
    zero_wear: bool = False
    choice: str = ""


def alternative_forms(law: LawFit) -> tuple[Form, ...]:
    """Forms that compete with a power law."""
    wear = wear_of(law) or "wear"
    forms = (
        Form("exponential in wear", f"exponential in {wear}", _exponential, zero_wear=True, choice="power-exponential"),
        Form("additive in wear", f"additive in {wear}", _additive, zero_wear=True, choice="additive"),
        Form("an exponent of t per edge", "an exponent of t per edge", _per_edge),
        Form("second order in logs", "second order in logs", _second_order, choice="second-order"),
        Form("straight line in wear", f"straight line in {wear}", _straight_line, zero_wear=True),
        Form("offset in wear", f"offset in {wear}", partial(_offset, factor=None), zero_wear=True),
    )
    load = law.response in ROLES and ROLES[law.response].kind == "load"
    if load and TIME in law.factors:
        return (*forms, Form("offset in t", "offset in t", partial(_offset, factor=TIME)))
    return forms


def wear_of(law: LawFit) -> str | None:
    """The wear among the factors."""
    return next((name for name in law.factors if name in ROLES and ROLES[name].kind == "wear"), None)


def _no_wear(law: LawFit) -> NotAvailable:
    return NotAvailable(f"no wear among the factors {', '.join(law.factors)}")


def _linear_form(name: str, formula: str, names: list[str], Z: Array, y: Array) -> FittedForm | NotAvailable:
    """A form that is linear in its coefficients."""
    try:
        theta = linear(Z, y).params
    except FitError as error:
        return NotAvailable(str(error))
    r = y - Z @ theta
    return FittedForm(name, formula, dict(zip(names, theta.tolist(), strict=True)), Z, r, Z, r)


def _exponential(rows: FormRows) -> FittedForm | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j exp(k AW)``."""
    wear = wear_of(rows.law)
    if wear is None:
        return _no_wear(rows.law)
    names, Z = rows.others(wear)
    formula = f"{rows.law.response} = c0 {_product(rows.law.formula.other_factors(wear))} exp(k {wear})"
    columns = np.column_stack([Z, rows.column(wear)])
    return _linear_form(f"exponential in {wear}", formula, [*names, "k"], columns, rows.y)


def _additive(rows: FormRows) -> FittedForm | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j + k AW``, least squares of ln R; leaving out goes along its gradient."""
    law, y = rows.law, rows.y
    wear = wear_of(law)
    if wear is None:
        return _no_wear(law)
    names, Z = rows.others(wear)
    AW = rows.column(wear)
    centre, level = np.r_[0.0, Z[:, 1:].mean(axis=0)], float(y.mean())
    per_k = float(np.exp(level) / AW.mean())
    found = _additive_fit(Z - centre, AW / AW.mean(), y - level)
    if found is None:
        return NotAvailable("least squares with additive wear does not converge")
    theta, share, gradient, r = found
    if share < NEGLIGIBLE:
        return NotAvailable(f"{law.response} has no additive contribution of {wear}: the estimate of k is zero")
    theta[0] += level - float(centre @ theta)
    coefficients = dict(zip([*names, "k"], [*theta.tolist(), share * per_k], strict=True))
    formula = f"{law.response} = c0 {_product(law.formula.other_factors(wear))} + k {wear}"
    return FittedForm(f"additive in {wear}", formula, coefficients, gradient, r, gradient, r)


def _straight_line(rows: FormRows) -> FittedForm | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j (1 + k AW)``: given k, ln R less ln(1 + k AW) is linear in the rest."""
    law, wear = rows.law, wear_of(rows.law)
    if wear is None:
        return _no_wear(law)
    names, Z = rows.others(wear)
    AW = rows.column(wear)
    mean = float(AW.mean())

    def added(rate: Array) -> Array:
        return np.asarray(np.log1p(np.multiply.outer(AW / mean, rate)))

    basis = orthonormal(Z / np.linalg.norm(Z, axis=0))
    rate = _least_at(lambda rates: _unexplained(rows.y[:, None] - added(rates), basis), RATES)
    if rate is None:
        return NotAvailable(
            f"the slope of {law.response} on {wear} is not determined: k is estimated as zero or without bound"
        )
    k = rate / mean
    y = rows.y - np.log1p(k * AW)
    theta = linear(Z, y).params
    r = y - Z @ theta
    gradient = np.column_stack([Z, AW / (1 + k * AW)])
    coefficients = dict(zip([*names, "k"], [*theta.tolist(), k], strict=True))
    formula = f"{law.response} = c0 {_product(law.formula.other_factors(wear))} (1 + k {wear})"
    return FittedForm(f"straight line in {wear}", formula, coefficients, gradient, r, gradient, r)


def _offset(rows: FormRows, factor: str | None) -> FittedForm | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j (x + a)^b``, x the wear or time: given a, it is linear in ln R."""
    law, symbol = rows.law, "a" if factor is None else "t0"
    factor = wear_of(law) if factor is None else factor
    if factor is None:
        return _no_wear(law)
    names, Z = rows.others(factor)
    x = rows.column(factor)
    basis = orthonormal(Z / np.linalg.norm(Z, axis=0))
    y = rows.y - basis @ (basis.T @ rows.y)

    def left(offsets: Array) -> Array:
        columns = np.log(np.add.outer(x, offsets))
        columns -= basis @ (basis.T @ columns)
        size = np.einsum("ij,ij->j", columns, columns)
        return np.asarray(y @ y - (y @ columns) ** 2 / np.maximum(size, 1e-300))

    negative = np.empty(0) if rows.zero.any() else -CLOSE * float(x.min())
    a = _least_at(left, np.concatenate([negative, OFFSETS * float(x.mean())]))
    if a is None:
        return NotAvailable(f"these rows do not determine an offset of {factor}: its estimate is at a limit")
    if abs(a) < NO_OFFSET * float(x[~rows.zero].min()):
        return NotAvailable(f"the estimate of the offset of {factor} is zero, which is the power law")
    columns = np.column_stack([Z, np.log(x + a)])
    try:
        theta = linear(columns, rows.y).params
    except FitError as error:
        return NotAvailable(str(error))
    r = rows.y - columns @ theta
    gradient = np.column_stack([columns, theta[-1] / (x + a)])
    coefficients = dict(zip([*names, factor, symbol], [*theta.tolist(), a], strict=True))
    formula = f"{law.response} = c0 {_product(law.formula.other_factors(factor))} ({factor} + {symbol})^b_{factor}"
    return FittedForm(f"offset in {factor}", formula, coefficients, gradient, r, gradient, r)


def _unexplained(y: Array, basis: Array) -> Array:
    """Sums of squares of columns y (n, m) outside the span of orthonormal columns, shape (m,)."""
    inside = basis.T @ y
    return np.asarray(np.einsum("ij,ij->j", y, y) - np.einsum("ij,ij->j", inside, inside))


def _least_at(left: Callable[[Array], Array], grid: Array) -> float | None:
    """The place of the least sum of squares, refined between its neighbours; None at an end of the grid."""
    from scipy.optimize import minimize_scalar

    values = left(grid)
    i = int(np.argmin(values))
    if i in (0, len(grid) - 1):
        return None
    low, high = float(grid[i - 1]), float(grid[i + 1])
    found = minimize_scalar(
        lambda at: float(left(np.array([at]))[0]), bounds=(low, high), method="bounded",
        options={"xatol": 1e-8 * (high - low)},
    )  # fmt: skip
    return float(found.x) if found.fun <= values[i] else float(grid[i])


def _additive_fit(Z: Array, w: Array, y: Array) -> tuple[Array, float, Array, Array] | None:
    """Parameters, share of wear, gradient (n, p + 1) and residuals of ``y = ln(exp(Z theta) + share w)``."""
    from scipy.optimize import least_squares

    def parts(x: Array) -> tuple[Array, Array]:
        with np.errstate(over="ignore"):  # a trial step that the solver rejects
            product = np.exp(np.minimum(Z @ x[:-1], 300.0))
        return product, product + x[-1] * w

    def residuals(x: Array) -> Array:
        return np.log(parts(x)[1]) - y

    def gradient(x: Array) -> Array:
        product, whole = parts(x)
        return np.column_stack([product[:, None] * Z, w]) / whole[:, None]

    bounds = (np.r_[np.full(Z.shape[1], -np.inf), 0.0], np.inf)
    best = None
    for share in SHARES:
        start = linear(Z, np.log(np.maximum(np.exp(y) - share * w, 0.1 * np.exp(y)))).params
        found = least_squares(residuals, np.r_[start, share], jac=gradient, bounds=bounds, x_scale="jac")
        if found.status > 0 and (best is None or found.cost < best.cost):
            best = found
    if best is None:
        return None
    return best.x[:-1].copy(), float(best.x[-1]), gradient(best.x), -residuals(best.x)


def _per_edge(rows: FormRows) -> FittedForm | NotAvailable:
    """The law with a random level and a random exponent of t for each edge; a new edge has the common ones.

    Its prediction of a new edge differs from the power law only by the weights of the edges, which may be better by
    chance; so it is compared only where a common exponent is rejected.
    """
    law = rows.law
    test = common_exponent(law)
    if isinstance(test, NotAvailable):
        return test
    if not test.concern:
        return NotAvailable(f"not needed: {test.verdict[0].lower()}{test.verdict[1:].rstrip('.')}")
    Z, y = law.design, np.log(law.observed)
    edge = units_of(law)[1]
    time = np.log(law.X[:, law.factors.index(TIME)])
    time = time - time.mean()
    try:
        D = slope_spread(Z, y, edge, time)
    except np.linalg.LinAlgError:
        return NotAvailable("the variances of levels and exponents of the edges are not identified by these rows")
    turned = whitened(np.column_stack([Z, y]), edge, time, D)
    fit = linear(turned[:, :-1], turned[:, -1])
    rest = turned[:, -1] - turned[:, :-1] @ fit.params
    coefficients = dict(zip(["ln c0", *law.names[1:]], fit.params.tolist(), strict=True))
    coefficients["sd of u"] = float(np.sqrt(fit.scale * D[1, 1]))
    formula = f"{law.response} = c0 {_product(law.factors)} {TIME}^u, u of each edge"
    return FittedForm("an exponent of t per edge", formula, coefficients, Z, y - Z @ fit.params, turned[:, :-1], rest)


def _second_order(rows: FormRows) -> FittedForm | NotAvailable:
    """The power law with squares and products of the logarithms, about their means."""
    law = rows.law
    logs = np.log(law.X)
    x = logs - logs.mean(axis=0)
    pairs = [(i, j) for i in range(x.shape[1]) for j in range(i, x.shape[1])]
    names = [*law.factors, *(f"{law.factors[i]} {law.factors[j]}" for i, j in pairs)]
    terms = np.column_stack([x, *(x[:, i] * x[:, j] for i, j in pairs)])
    keep, _ = identifiable(names, terms, law.shifts, logs=False)
    if len(keep) == x.shape[1]:
        return NotAvailable("all squares and products of the factors are aliased with the factors in these rows")
    Z = np.hstack([np.ones((len(x), 1)), terms[:, keep], law.shifts])
    if Z.shape[1] >= len(Z):
        return NotAvailable(f"{len(Z)} rows for {Z.shape[1]} coefficients leave no degrees of freedom")
    shifts = law.names[1 + x.shape[1] :]
    formula = f"ln {law.response} = a + sum b_j x_j + sum b_jk x_j x_k, x about its mean"
    return _linear_form(
        "second order in logs", formula, ["a", *(names[j] for j in keep), *shifts], Z, np.log(law.observed)
    )


def _product(factors: tuple[str, ...]) -> str:
    return " ".join(f"{name}^b_{name}" for name in factors)
