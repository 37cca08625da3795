"""Competing models of a power law, compared by cross-validation over edges.

Each form is fitted to ln R and leaves out one edge at a time (one row, where there are no edges); its prediction error
of that edge, in ln R, is compared. An alternative replaces the power law only where its error is smaller by more than
one standard error of the difference, over the edges.

Sources: Hastie, Tibshirani & Friedman 2009, The Elements of Statistical Learning, section 7.10 (one standard error
rule); Cook & Weisberg 1982, Residuals and Influence in Regression, section 2.2 (deletion without refitting).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable, Plottable
from ...core.errors import FitError
from ..available import NotAvailable
from ..lawfit import LawFit
from ..least_squares import linear
from .check import Check
from .competing_forms import FittedForm, form_makers, power_form
from .deletion_diagnostics import ALONE
from .strata import NO_ROWS, Codes, no_scatter, units_of
from .time_exponent import CommonExponent, common_exponent


@dataclass(frozen=True, slots=True, repr=False)
class CompetingModel(Displayable):
    """One form, fitted.

    Attributes
    ----------
    name, formula : str
    coefficients : mapping of str to float
        As the formula names them, ``ln c0`` for the constant.
    error : float
        Root mean squared prediction error of left-out units, in ln R.
    difference, standard_error : float
        Its ``error`` less that of the power law, and the standard error of the difference over the units.
    """

    name: str
    formula: str
    coefficients: Mapping[str, float]
    error: float
    difference: float
    standard_error: float

    @property
    def better(self) -> bool:
        """Whether its error is smaller than that of the power law by more than one standard error."""
        return self.difference < -self.standard_error


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class CompetingModels(Check, Plottable):
    """Competing models of one law; the statistic is the ``difference`` of the chosen one.

    Attributes
    ----------
    response : str
    power : CompetingModel
        The power law itself; its difference is 0.
    alternatives : tuple of CompetingModel
        Best first.
    not_fitted : tuple of (str, NotAvailable)
        Forms that could not be fitted, each with its reason.
    common_exponent : CommonExponent or NotAvailable
        Test of one time exponent of all edges.
    unit, units : str, int
        What was left out, ``edge`` or ``row``, and how many there are.
    """

    response: str
    power: CompetingModel
    alternatives: tuple[CompetingModel, ...]
    not_fitted: tuple[tuple[str, NotAvailable], ...]
    common_exponent: CommonExponent | NotAvailable
    unit: str
    units: int

    @property
    def chosen(self) -> CompetingModel:
        """The power law, or the best alternative where it is better by more than one standard error."""
        return _chosen(self.power, self.alternatives)


def compare_forms(law: LawFit) -> CompetingModels | NotAvailable:
    """Fit competing models to the rows of a power law, and compare them by cross-validation over units.

    Parameters
    ----------
    law : LawFit
        A power law with either error structure; all forms are fitted in logarithms.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> fit.compare_forms(fit.power_law(runs, "AW", ["V", "f", "d", "t"])).chosen.name
    'power law'
    """
    if reason := not_comparable(law):
        return NotAvailable(reason)
    unit, codes = units_of(law)
    if codes.max() == 0:
        unit, codes = "row", np.arange(law.nobs)
    form = power_form(law)
    base = _prediction_errors(form, codes)
    if isinstance(base, NotAvailable):
        return NotAvailable(f"the power law without one {unit} cannot be fitted: {base}")
    fitted: list[CompetingModel] = []
    not_fitted: list[tuple[str, NotAvailable]] = []
    for name, make in form_makers(law):
        other = make(law)
        errors = _prediction_errors(other, codes) if isinstance(other, FittedForm) else other
        if isinstance(other, FittedForm) and not isinstance(errors, NotAvailable):
            fitted.append(_compared(other, errors, base, codes))
        elif isinstance(errors, NotAvailable):
            not_fitted.append((name, errors))
    power = _compared(form, base, base, codes)
    alternatives = tuple(sorted(fitted, key=lambda model: model.error))
    chosen = _chosen(power, alternatives)
    return CompetingModels(
        null="no competing model predicts left-out units better than the power law",
        statistic=chosen.difference,
        symbol="difference of RMS error",
        concern=int(chosen is not power),
        verdict=_verdict(law.response, unit, power, alternatives),
        response=law.response,
        power=power,
        alternatives=alternatives,
        not_fitted=tuple(not_fitted),
        common_exponent=common_exponent(law),
        unit=unit,
        units=int(codes.max()) + 1,
    )


def _chosen(power: CompetingModel, alternatives: tuple[CompetingModel, ...]) -> CompetingModel:
    return next((model for model in alternatives if model.better), power)


def _verdict(response: str, unit: str, power: CompetingModel, alternatives: tuple[CompetingModel, ...]) -> str:
    left = f"Leave-one-{unit}-out error of {response}: power law {100 * np.expm1(power.error):.3g} %"
    if not alternatives:
        return f"{left}; no competing model can be fitted to these rows."
    chosen = _chosen(power, alternatives)
    best = alternatives[0] if chosen is power else chosen
    difference = f"difference {best.difference:.2g} ± {best.standard_error:.2g} in ln {response}"
    kept = "the power law is kept" if chosen is power else f"{best.name} is preferred"
    return f"{left}, {best.name} {100 * np.expm1(best.error):.3g} % ({difference}): {kept}."


def not_comparable(law: LawFit) -> str | None:
    """Reason why a law has no competing models, or None."""
    if law.form != "power":
        return f"competing models are those of a power law, and this is of the form {law.form.replace('_', ' ')}"
    if law.rows is None:
        return NO_ROWS
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: models are compared in its logarithm"
    return no_scatter(law)


def _prediction_errors(fit: FittedForm, codes: Codes) -> Array | NotAvailable:
    """Prediction error of each row when its unit is left out, shape (n,), in ln R.

    With Q = columns L orthonormal, leaving unit g out moves theta by ``-L (I - Q_g'Q_g)^-1 Q_g' rest_g``.
    """
    try:
        L = np.linalg.cholesky(linear(fit.columns, fit.rest).cov_unscaled)
    except (FitError, np.linalg.LinAlgError):
        return NotAvailable("its columns are nearly linearly dependent in these rows, which rounding does not resolve")
    Q = fit.columns @ L
    if int(codes.max()) + 1 == len(codes):
        left = 1.0 - np.einsum("ij,ij->i", Q, Q)
        if left.min() < ALONE:
            return NotAvailable("one row alone determines one of its parameters: measure near it again")
        return np.asarray(fit.residuals + np.einsum("ij,ij->i", fit.Z @ L, Q) * fit.rest / left)
    missed = fit.residuals.copy()
    order = np.argsort(codes, kind="stable")
    bounds = np.searchsorted(codes[order], np.arange(int(codes.max()) + 2))
    for g in range(int(codes.max()) + 1):
        rows = order[bounds[g] : bounds[g + 1]]
        left = np.eye(Q.shape[1]) - Q[rows].T @ Q[rows]
        if np.linalg.eigvalsh(left)[0] < ALONE:
            return NotAvailable(
                "one edge alone determines one of its parameters: test another edge near its conditions"
            )
        missed[rows] += fit.Z[rows] @ (L @ np.linalg.solve(left, Q[rows].T @ fit.rest[rows]))
    return missed


def _compared(fit: FittedForm, missed: Array, base: Array, codes: Codes) -> CompetingModel:
    """Errors as root mean squares; the standard error of their difference from its scatter over the units."""
    n, G = len(codes), int(codes.max()) + 1
    error, power = float(np.sqrt(np.mean(missed**2))), float(np.sqrt(np.mean(base**2)))
    by_unit = np.bincount(codes, weights=missed**2 - base**2)
    about = by_unit - np.bincount(codes) * by_unit.sum() / n
    scatter = float(np.sqrt(G / (G - 1) * np.sum(about**2))) / n
    return CompetingModel(fit.name, fit.formula, fit.coefficients, error, error - power, scatter / (error + power))
