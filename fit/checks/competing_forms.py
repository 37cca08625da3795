"""Forms that compete with a power law, each fitted to its rows in ln R.

===========================  ==================================================
power law                    R = c0 prod X_j^b_j
exponential in wear          R = c0 prod X_j^b_j exp(k AW), AW not among the X_j
additive in wear             R = c0 prod X_j^b_j + k AW, AW not among the X_j, k > 0
an exponent of t per edge    R = c0 prod X_j^b_j t^u, u of each edge about 0
second order in logs         ln R = a + sum b_j x_j + sum b_jk x_j x_k, x = ln X
===========================  ==================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...core.errors import FitError
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import linear
from ..rows import identifiable
from .strata import units_of
from .time_exponent import TIME, common_exponent, slope_spread, whitened

SHARES = (0.1, 0.5)  # of the response that wear adds, from which the additive form starts
NEGLIGIBLE = 1e-6  # share of the response below which the contribution of wear is zero


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
    fit = _straight("power law", formula, ["ln c0", *law.names[1:]], Z, y)
    if isinstance(fit, NotAvailable):  # the law itself was fitted to these rows
        raise FitError(f"{law.response}: {fit}")
    return fit


def form_makers(law: LawFit) -> list[tuple[str, Callable[[LawFit], FittedForm | NotAvailable]]]:
    """Forms that compete with a power law by name, each with the function that fits it."""
    wear = _wear(law) or "wear"
    return [
        (f"exponential in {wear}", _exponential),
        (f"additive in {wear}", _additive),
        ("an exponent of t per edge", _per_edge),
        ("second order in logs", _second_order),
    ]


def _wear(law: LawFit) -> str | None:
    """The wear among the factors."""
    return next((name for name in law.factors if name in ROLES and ROLES[name].kind == "wear"), None)


def _straight(name: str, formula: str, names: list[str], Z: Array, y: Array) -> FittedForm | NotAvailable:
    """A form that is linear in its coefficients."""
    try:
        theta = linear(Z, y).params
    except FitError as error:
        return NotAvailable(str(error))
    r = y - Z @ theta
    return FittedForm(name, formula, dict(zip(names, theta.tolist(), strict=True)), Z, r, Z, r)


def _exponential(law: LawFit) -> FittedForm | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j exp(k AW)``."""
    wear = _wear(law)
    if wear is None:
        return NotAvailable(f"no wear among the factors {', '.join(law.factors)}")
    j = law.factors.index(wear)
    Z = law.design
    Z[:, 1 + j] = law.X[:, j]
    names = ["ln c0", *law.names[1:]]
    names[1 + j] = "k"
    formula = f"{law.response} = c0 {_product(law.formula.other_factors(wear))} exp(k {wear})"
    return _straight(f"exponential in {wear}", formula, names, Z, np.log(law.observed))


def _additive(law: LawFit) -> FittedForm | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j + k AW``, least squares of ln R; leaving out goes along its gradient."""
    wear = _wear(law)
    if wear is None:
        return NotAvailable(f"no wear among the factors {', '.join(law.factors)}")
    j = law.factors.index(wear)
    Z, y = np.delete(law.design, 1 + j, axis=1), np.log(law.observed)
    centre, level = np.r_[0.0, Z[:, 1:].mean(axis=0)], float(y.mean())
    per_k = float(np.exp(level) / law.X[:, j].mean())
    found = _additive_fit(Z - centre, law.X[:, j] / law.X[:, j].mean(), y - level)
    if found is None:
        return NotAvailable("least squares with additive wear does not converge")
    theta, share, gradient, r = found
    if share < NEGLIGIBLE:
        return NotAvailable(f"{law.response} has no additive contribution of {wear}: the estimate of k is zero")
    theta[0] += level - float(centre @ theta)
    names = ["ln c0", *(name for name in law.names[1:] if name != wear), "k"]
    coefficients = dict(zip(names, [*theta.tolist(), share * per_k], strict=True))
    formula = f"{law.response} = c0 {_product(law.formula.other_factors(wear))} + k {wear}"
    return FittedForm(f"additive in {wear}", formula, coefficients, gradient, r, gradient, r)


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


def _per_edge(law: LawFit) -> FittedForm | NotAvailable:
    """The law with a random level and a random exponent of t for each edge; a new edge has the common ones.

    Its prediction of a new edge differs from the power law only by the weights of the edges, which may be better by
    chance; so it is compared only where a common exponent is rejected.
    """
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


def _second_order(law: LawFit) -> FittedForm | NotAvailable:
    """The power law with squares and products of the logarithms, about their means."""
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
    return _straight(
        "second order in logs", formula, ["a", *(names[j] for j in keep), *shifts], Z, np.log(law.observed)
    )


def _product(factors: tuple[str, ...]) -> str:
    return " ".join(f"{name}^b_{name}" for name in factors)
