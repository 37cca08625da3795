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

from ...core.display import Displayable, Plottable
from ..available import NotAvailable
from ..lawfit import LawFit
from ..linear import linear
from .competing_forms import FittedForm, power_form, rival_makers
from .deletion_diagnostics import ALONE
from .strata import Array, Codes, no_scatter, units_of
from .time_exponent import CommonExponent, common_exponent


@dataclass(frozen=True, slots=True, repr=False)
class RivalForm(Displayable):
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


@dataclass(frozen=True, slots=True, repr=False)
class Forms(Plottable):
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
    power = power_form(law)
    base = _left_out(power, codes)
    if isinstance(base, NotAvailable):
        return NotAvailable(f"the power law without one {unit} cannot be fitted: {base}")
    fitted: list[RivalForm] = []
    not_fitted: list[tuple[str, NotAvailable]] = []
    for name, make in rival_makers(law):
        rival = make(law)
        missed = _left_out(rival, codes) if isinstance(rival, FittedForm) else rival
        if isinstance(rival, FittedForm) and not isinstance(missed, NotAvailable):
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


def _unfit(law: LawFit) -> str | None:
    if law.form != "power":
        return f"rival forms are those of a power law, and this is of the form {law.form.replace('_', ' ')}"
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: forms are compared in its logarithm"
    return no_scatter(law)


def _left_out(fit: FittedForm, codes: Codes) -> Array | NotAvailable:
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


def _compared(fit: FittedForm, missed: Array, base: Array, codes: Codes) -> RivalForm:
    """Errors as root mean squares; the standard error of their difference from its scatter over the units."""
    n, G = len(codes), int(codes.max()) + 1
    error, power = float(np.sqrt(np.mean(missed**2))), float(np.sqrt(np.mean(base**2)))
    by_unit = np.bincount(codes, weights=missed**2 - base**2)
    about = by_unit - np.bincount(codes) * by_unit.sum() / n
    scatter = float(np.sqrt(G / (G - 1) * np.sum(about**2))) / n
    return RivalForm(fit.name, fit.formula, fit.coefficients, error, error - power, scatter / (error + power))
