"""Do errors multiply or add: the fit in logarithms against the fit in natural units, by their likelihood.

R2 of the two fits lives on different scales and decides nothing. A density does: the log fit gives ``y`` the
density of ``ln y`` divided by ``y``, so its log-likelihood carries the Jacobian ``- sum ln y``. Both fits have
the same number of parameters, hence the difference of AIC is minus twice that of the log-likelihoods.

Sources: Box & Cox 1964, J. R. Stat. Soc. B 26, 211 (the Jacobian); Xiao et al. 2011, Ecology 92, 1887 (power
laws); Vuong 1989, Econometrica 57, 307 (standard error of the difference, here summed by edge).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Plottable
from ..available import NotAvailable
from ..lawfit import LawFit
from ..laws import Error
from .evidence import no_scatter, units_of

Array = NDArray[np.float64]

TELLS = 1.0  # units of log-likelihood (2 of AIC) below which two fits are as good as each other
SURE = 2.0  # standard errors


@dataclass(frozen=True, slots=True, repr=False)
class ErrorStructure(Plottable):
    """Multiplicative against additive errors of one law on the same rows.

    Attributes
    ----------
    response : str
    fitted : {"multiplicative", "additive"}
        What the law was fitted with.
    multiplicative, additive : float
        Log-likelihood of ``y``, rows taken as independent, at the maximum-likelihood variance.
    standard_error : float or None
        Of the difference, from its scatter over ``units``; None where there is only one edge.
    unit, units : str, int
        ``edge`` or ``row``, and how many.
    """

    response: str
    fitted: Error
    multiplicative: float
    additive: float
    standard_error: float | None
    unit: str
    units: int

    @property
    def difference(self) -> float:
        """Log-likelihood of the log fit less that of the natural one; positive where errors multiply."""
        return self.multiplicative - self.additive

    @property
    def aic_difference(self) -> float:
        """AIC of the log fit less that of the natural one; negative where errors multiply."""
        return -2.0 * self.difference

    @property
    def preferred(self) -> Error | None:
        """The better structure; None where the two are as good as each other."""
        if abs(self.difference) < TELLS:
            return None
        return "multiplicative" if self.difference > 0 else "additive"

    @property
    def sure(self) -> bool:
        """Whether the difference is more than two of its standard errors."""
        return self.standard_error is not None and abs(self.difference) > SURE * self.standard_error

    @property
    def concern(self) -> int:
        """0 fine, 1 the other structure is better, 2 surely so. Cure: fit with the other ``error``."""
        return 0 if self.preferred in (None, self.fitted) else 1 + self.sure

    @property
    def verdict(self) -> str:
        """One sentence: which, and by how much."""
        size = abs(self.difference)
        if self.preferred is None:
            return f"These rows do not tell whether errors multiply or add: {size:.1f} units of log-likelihood apart."
        word, better = ("multiply", "log") if self.preferred == "multiplicative" else ("add", "natural")
        found = f"the {better} fit is {size:.{0 if size >= 10 else 1}f} units of log-likelihood better"
        told = f"Errors {word}: {found}"
        if self.standard_error is not None and not self.sure:
            told = f"Errors seem to {word}: {found}, with a standard error of {self.standard_error:.2g}"
            told += f" over {self.units} {self.unit}s"
        return f"{told}; fit with error='{self.preferred}'." if self.concern else f"{told}."


def error_structure(law: LawFit, other: LawFit | None = None) -> ErrorStructure | NotAvailable:
    """Compare the two error structures of a law on its own rows.

    Parameters
    ----------
    law : LawFit
        With either structure.
    other : LawFit, optional
        ``law.alternative``, the other side, where somebody has it already.

    Returns
    -------
    ErrorStructure, or NotAvailable for a line, rows that are not above zero, or a law that meets every row.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> error_structure(law).verdict
    'Errors multiply: the log fit is 33 units of log-likelihood better.'
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    other = law.alternative if other is None else other
    if other is None:
        return NotAvailable(_no_alternative(law))
    if reason := no_scatter(other):
        return NotAvailable(reason)
    log, natural = (law, other) if law.error == "multiplicative" else (other, law)
    by_row = (_loglik(log) - np.log(log.observed), _loglik(natural))
    unit, codes = units_of(law)
    by_unit = np.bincount(codes, weights=by_row[0] - by_row[1])
    return ErrorStructure(
        response=law.response,
        fitted=law.error,
        multiplicative=float(by_row[0].sum()),
        additive=float(by_row[1].sum()),
        standard_error=float(np.sqrt(len(by_unit)) * by_unit.std(ddof=1)) if len(by_unit) > 1 else None,
        unit=unit,
        units=len(by_unit),
    )


def _loglik(law: LawFit) -> Array:
    """Normal log-likelihood of each residual at the maximum-likelihood variance, shape (n,)."""
    variance = law.rss / law.nobs
    return np.asarray(-0.5 * (np.log(2 * np.pi * variance) + law.residuals**2 / variance))


def _no_alternative(law: LawFit) -> str:
    if not law.law.logarithmic:
        return f"a {law.form.replace('_', ' ')} is a straight line: its errors add, and there is no other fit"
    below = int((law.observed <= 0).sum())
    if below:
        return f"{below} of {law.nobs} rows of {law.response} are not above zero and have no logarithm"
    return "least squares in natural units does not converge from the log fit: there is nothing to compare with"
