"""Is it a power law: rival forms of the field on the same rows, judged by edges they have not seen.

Each form is fitted to ln R and leaves out one edge at a time (one row, where there are no edges); what it then
misses that edge by, in ln R, is its error. A rival replaces the power law only where its error is smaller by
more than one standard error of the difference, taken over the edges.

===========================  ==================================================
power law                    R = c0 prod X_j^b_j
exponential in wear          R = c0 prod X_j^b_j exp(k AW), AW not among the X_j
additive in wear             R = c0 prod X_j^b_j + k AW, AW not among the X_j, k > 0
an exponent of t per edge    R = c0 prod X_j^b_j t^u, u of each edge about 0
second order in logs         ln R = a + sum b_j x_j + sum b_jk x_j x_k, x = ln X
===========================  ==================================================

Sources: Hastie, Tibshirani & Friedman 2009, The Elements of Statistical Learning, section 7.10 (one standard
error); Cook & Weisberg 1982, Residuals and Influence in Regression, section 2.2 (leaving out without refitting).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..datasets.vocabulary import ROLES
from .available import NotAvailable
from .errors import FitError
from .identifiable import identifiable
from .lawfit import LawFit
from .linear import linear
from .slopes import TIME, CommonExponent, common_exponent, slope_spread, whitened
from .structure import nothing_left, units_of

Array = NDArray[np.float64]
Codes = NDArray[np.intp]

ALONE = 1e-10  # eigenvalue of what is left of the design without a unit, below which it alone holds a parameter
SHARES = (0.1, 0.5)  # of the response that wear adds, from which the additive form starts
NOTHING = 1e-6  # share of the response below which wear adds nothing


@dataclass(frozen=True, slots=True)
class RivalForm:
    """One form, fitted.

    Attributes
    ----------
    name, formula : str
    coefficients : mapping of str to float
        As the formula names them, ``ln c0`` for the constant.
    error : float
        Root mean square of what left-out units miss by, in ln R.
    difference, standard_error : float
        Its ``error`` less that of the power law, and the standard error of that over the units.
    """

    name: str
    formula: str
    coefficients: Mapping[str, float]
    error: float
    difference: float
    standard_error: float

    @property
    def better(self) -> bool:
        """Whether it beats the power law by more than one standard error."""
        return self.difference < -self.standard_error


@dataclass(frozen=True, slots=True)
class Forms:
    """Rival forms of one law.

    Attributes
    ----------
    response : str
    power : RivalForm
        The power law itself; its difference is 0.
    rivals : tuple of RivalForm
        Best first.
    not_fitted : tuple of (str, NotAvailable)
        Forms that could not be had, each with its reason.
    common_exponent : CommonExponent or NotAvailable
        Test of one time exponent for all edges.
    unit, units : str, int
        What was left out, ``edge`` or ``row``, and how many there are.
    """

    response: str
    power: RivalForm
    rivals: tuple[RivalForm, ...]
    not_fitted: tuple[tuple[str, NotAvailable], ...]
    common_exponent: CommonExponent | NotAvailable
    unit: str
    units: int

    @property
    def chosen(self) -> RivalForm:
        """The power law, or the best rival where that beats it by more than one standard error."""
        return next((rival for rival in self.rivals if rival.better), self.power)

    @property
    def concern(self) -> int:
        """0 the power law stands, 1 a rival is better. Cause: curvature, or another role of wear."""
        return int(self.chosen is not self.power)

    @property
    def argument(self) -> str:
        """The choice in two sentences."""
        left = f"Leaving out one {self.unit} at a time, the power law misses {self.response} by"
        left += f" {100 * np.expm1(self.power.error):.3g} %"
        if not self.rivals:
            return f"{left}. No rival form can be fitted to these rows, so the power law stands unopposed."
        best = self.chosen if self.concern else self.rivals[0]
        first = f"{left}, the form {best.name} by {100 * np.expm1(best.error):.3g} %."
        gap = f"{abs(best.difference):.2g} +- {best.standard_error:.2g} in ln {self.response}"
        if self.concern:
            return f"{first} That is better by {gap}, more than one standard error, so {best.name} is preferred."
        if best.difference < 0:
            return f"{first} That is better by {gap}, not more than one standard error, so the power law is kept."
        return f"{first} The best rival is worse by {gap}, so the power law is kept."


@dataclass(frozen=True, slots=True)
class _Fit:
    """A form on its rows: ``columns`` and ``rest`` may be weighted, ``Z`` and ``residuals`` are in ln R."""

    name: str
    formula: str
    coefficients: Mapping[str, float]
    Z: Array
    residuals: Array
    columns: Array
    rest: Array


def rival_forms(law: LawFit) -> Forms | NotAvailable:
    """Fit the rival forms to the rows of a power law, and compare them by units left out.

    Parameters
    ----------
    law : LawFit
        A power law with either error structure; all forms are fitted in logarithms.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> rival_forms(fit.power_law(runs, "AW", ["V", "f", "d", "t"])).chosen.name
    'power law'
    """
    if reason := _unfit(law):
        return NotAvailable(reason)
    unit, codes = units_of(law)
    if codes.max() == 0:
        unit, codes = "row", np.arange(law.nobs)
    power = _power(law)
    base = _left_out(power, codes)
    if isinstance(base, NotAvailable):
        return NotAvailable(f"the power law without one {unit} cannot be fitted: {base}")
    fitted: list[RivalForm] = []
    not_fitted: list[tuple[str, NotAvailable]] = []
    for name, make in _rivals(law):
        rival = make(law)
        missed = _left_out(rival, codes) if isinstance(rival, _Fit) else rival
        if isinstance(rival, _Fit) and not isinstance(missed, NotAvailable):
            fitted.append(_compared(rival, missed, base, codes))
        elif isinstance(missed, NotAvailable):
            not_fitted.append((name, missed))
    return Forms(
        response=law.response,
        power=_compared(power, base, base, codes),
        rivals=tuple(sorted(fitted, key=lambda rival: rival.error)),
        not_fitted=tuple(not_fitted),
        common_exponent=common_exponent(law),
        unit=unit,
        units=int(codes.max()) + 1,
    )


def _rivals(law: LawFit) -> list[tuple[str, Callable[[LawFit], _Fit | NotAvailable]]]:
    wear = _wear(law) or "wear"
    return [
        (f"exponential in {wear}", _exponential),
        (f"additive in {wear}", _additive),
        ("an exponent of t per edge", _per_edge),
        ("second order in logs", _second_order),
    ]


def _unfit(law: LawFit) -> str | None:
    if law.form != "power":
        return f"rival forms are those of a power law, and this is of the form {law.form.replace('_', ' ')}"
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: forms are compared in its logarithm"
    return nothing_left(law)


def _wear(law: LawFit) -> str | None:
    """The wear among the factors."""
    return next((name for name in law.factors if name in ROLES and ROLES[name].kind == "wear"), None)


def _straight(name: str, formula: str, names: list[str], Z: Array, y: Array) -> _Fit | NotAvailable:
    """A form that is linear in its coefficients."""
    try:
        theta = linear(Z, y).params
    except FitError as error:
        return NotAvailable(str(error))
    r = y - Z @ theta
    return _Fit(name, formula, dict(zip(names, theta.tolist(), strict=True)), Z, r, Z, r)


def _power(law: LawFit) -> _Fit:
    Z, y = law.law.design(law.X, law.shifts), np.log(law.observed)
    formula = f"{law.response} = c0 {_product(law.factors)}"
    fit = _straight("power law", formula, ["ln c0", *law.names[1:]], Z, y)
    if isinstance(fit, NotAvailable):  # the law itself was fitted to these rows
        raise FitError(f"{law.response}: {fit}")
    return fit


def _exponential(law: LawFit) -> _Fit | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j exp(k AW)``."""
    wear = _wear(law)
    if wear is None:
        return NotAvailable(f"no wear among the factors {', '.join(law.factors)}")
    j = law.factors.index(wear)
    Z = law.law.design(law.X, law.shifts)
    Z[:, 1 + j] = law.X[:, j]
    names = ["ln c0", *law.names[1:]]
    names[1 + j] = "k"
    formula = f"{law.response} = c0 {_product(_less(law.factors, wear))} exp(k {wear})"
    return _straight(f"exponential in {wear}", formula, names, Z, np.log(law.observed))


def _additive(law: LawFit) -> _Fit | NotAvailable:
    """Eq. ``R = c0 prod X_j^b_j + k AW``, least squares of ln R; leaving out goes along its gradient."""
    wear = _wear(law)
    if wear is None:
        return NotAvailable(f"no wear among the factors {', '.join(law.factors)}")
    j = law.factors.index(wear)
    Z, y = np.delete(law.law.design(law.X, law.shifts), 1 + j, axis=1), np.log(law.observed)
    centre, level = np.r_[0.0, Z[:, 1:].mean(axis=0)], float(y.mean())
    per_k = float(np.exp(level) / law.X[:, j].mean())
    found = _additive_fit(Z - centre, law.X[:, j] / law.X[:, j].mean(), y - level)
    if found is None:
        return NotAvailable("least squares with wear added does not converge")
    theta, share, gradient, r = found
    if share < NOTHING:
        return NotAvailable(f"{law.response} does not rise with {wear} by addition: k comes out as zero")
    theta[0] += level - float(centre @ theta)
    names = ["ln c0", *(name for name in law.names[1:] if name != wear), "k"]
    coefficients = dict(zip(names, [*theta.tolist(), share * per_k], strict=True))
    formula = f"{law.response} = c0 {_product(_less(law.factors, wear))} + k {wear}"
    return _Fit(f"additive in {wear}", formula, coefficients, gradient, r, gradient, r)


def _additive_fit(Z: Array, w: Array, y: Array) -> tuple[Array, float, Array, Array] | None:
    """Parameters, share of wear, gradient (n, p + 1) and residuals of ``y = ln(exp(Z theta) + share w)``."""
    from scipy.optimize import least_squares

    def parts(x: Array) -> tuple[Array, Array]:
        with np.errstate(over="ignore"):  # a wild trial step: it is turned down
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


def _per_edge(law: LawFit) -> _Fit | NotAvailable:
    """The law with a random level and a random exponent of t for each edge; a new edge has the common ones.

    For a new edge it differs from the power law by the weight of each edge alone, and that may win by luck:
    so it stands as a rival only where a common exponent is rejected.
    """
    test = common_exponent(law)
    if isinstance(test, NotAvailable):
        return test
    if not test.concern:
        return NotAvailable(f"not called for: {test.verdict[0].lower()}{test.verdict[1:].rstrip('.')}")
    Z, y = law.law.design(law.X, law.shifts), np.log(law.observed)
    edge = units_of(law)[1]
    time = np.log(law.X[:, law.factors.index(TIME)])
    time = time - time.mean()
    try:
        D = slope_spread(Z, y, edge, time)
    except np.linalg.LinAlgError:
        return NotAvailable("the spread of levels and exponents of the edges cannot be told from these rows")
    turned = whitened(np.column_stack([Z, y]), edge, time, D)
    fit = linear(turned[:, :-1], turned[:, -1])
    rest = turned[:, -1] - turned[:, :-1] @ fit.params
    coefficients = dict(zip(["ln c0", *law.names[1:]], fit.params.tolist(), strict=True))
    coefficients["sd of u"] = float(np.sqrt(fit.scale * D[1, 1]))
    formula = f"{law.response} = c0 {_product(law.factors)} {TIME}^u, u of each edge"
    return _Fit("an exponent of t per edge", formula, coefficients, Z, y - Z @ fit.params, turned[:, :-1], rest)


def _second_order(law: LawFit) -> _Fit | NotAvailable:
    """The power law with squares and products of the logarithms, about their means."""
    logs = np.log(law.X)
    x = logs - logs.mean(axis=0)
    pairs = [(i, j) for i in range(x.shape[1]) for j in range(i, x.shape[1])]
    names = [*law.factors, *(f"{law.factors[i]} {law.factors[j]}" for i, j in pairs)]
    terms = np.column_stack([x, *(x[:, i] * x[:, j] for i, j in pairs)])
    keep, _ = identifiable(names, terms, law.shifts, logs=False)
    if len(keep) == x.shape[1]:
        return NotAvailable("no square or product of the factors can be told from the factors in these rows")
    Z = np.hstack([np.ones((len(x), 1)), terms[:, keep], law.shifts])
    if Z.shape[1] >= len(Z):
        return NotAvailable(f"{len(Z)} rows for {Z.shape[1]} coefficients leave nothing over")
    shifts = law.names[1 + x.shape[1] :]
    formula = f"ln {law.response} = a + sum b_j x_j + sum b_jk x_j x_k, x about its mean"
    return _straight(
        "second order in logs", formula, ["a", *(names[j] for j in keep), *shifts], Z, np.log(law.observed)
    )


def _left_out(fit: _Fit, codes: Codes) -> Array | NotAvailable:
    """What each row misses by when its unit is left out, shape (n,), in ln R.

    With Q = columns L orthonormal, leaving unit g out moves theta by ``-L (I - Q_g'Q_g)^-1 Q_g' rest_g``.
    """
    L = np.linalg.cholesky(linear(fit.columns, fit.rest).cov_unscaled)
    Q = fit.columns @ L
    if int(codes.max()) + 1 == len(codes):
        left = 1.0 - np.einsum("ij,ij->i", Q, Q)
        if left.min() < ALONE:
            return NotAvailable("one row alone holds one of its parameters: measure near it again")
        return np.asarray(fit.residuals + np.einsum("ij,ij->i", fit.Z @ L, Q) * fit.rest / left)
    missed = fit.residuals.copy()
    order = np.argsort(codes, kind="stable")
    bounds = np.searchsorted(codes[order], np.arange(int(codes.max()) + 2))
    for g in range(int(codes.max()) + 1):
        rows = order[bounds[g] : bounds[g + 1]]
        left = np.eye(Q.shape[1]) - Q[rows].T @ Q[rows]
        if np.linalg.eigvalsh(left)[0] < ALONE:
            return NotAvailable("one edge alone holds one of its parameters: cut another edge near its conditions")
        missed[rows] += fit.Z[rows] @ (L @ np.linalg.solve(left, Q[rows].T @ fit.rest[rows]))
    return missed


def _compared(fit: _Fit, missed: Array, base: Array, codes: Codes) -> RivalForm:
    """Errors as root mean squares; the standard error of their difference from its scatter over the units."""
    n, G = len(codes), int(codes.max()) + 1
    error, power = float(np.sqrt(np.mean(missed**2))), float(np.sqrt(np.mean(base**2)))
    by_unit = np.bincount(codes, weights=missed**2 - base**2)
    about = by_unit - np.bincount(codes) * by_unit.sum() / n
    scatter = float(np.sqrt(G / (G - 1) * np.sum(about**2))) / n
    return RivalForm(fit.name, fit.formula, fit.coefficients, error, error - power, scatter / (error + power))


def _less(names: tuple[str, ...], name: str) -> tuple[str, ...]:
    return tuple(other for other in names if other != name)


def _product(factors: tuple[str, ...]) -> str:
    return " ".join(f"{name}^b_{name}" for name in factors)
