"""Whether the rows can tell the factors apart: variance inflation and condition of the centred terms.

Wear predicted by V, f, d and t stands beside them in the laws of power and force: their exponents then trade
against each other, though the law may still predict well where it was measured.

Source: Belsley, Kuh & Welsch 1980, Regression Diagnostics, chapter 3 (condition, variance proportions).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ..lawfit import LawFit
from .check import ByRule

Array = NDArray[np.float64]

VIF_LOOK, VIF_ACT = 5.0, 10.0
CONDITION_ACT = 30.0
INVOLVED = 0.5  # share of a coefficient's variance that the weakest direction holds


@dataclass(frozen=True, slots=True, repr=False)
class Collinearity(Displayable, ByRule):
    """Variance inflation of each term of a law and condition number of all.

    Attributes
    ----------
    names : tuple of str, length k
        Factors and shifts, without the constant.
    vif : ndarray, shape (k,)
        ``1 / (1 - R2)`` of each term on the others.
    condition : float
        Largest over smallest singular value of the terms (logarithms in a power law), centred and of length one.
    entangled : tuple of str
        Terms that the weakest direction joins.
    """

    names: tuple[str, ...]
    vif: Array
    condition: float
    entangled: tuple[str, ...]

    @property
    def null(self) -> str:
        """What is looked for."""
        return "each factor varies by itself, so that its exponent is its own"

    @property
    def statistic(self) -> float:
        """Largest variance inflation factor."""
        return float(self.vif.max())

    @property
    def concern(self) -> int:
        """0 fine, 1 VIF above 5, 2 above 10 or condition above 30. Cause: factors changed together."""
        if self.statistic > VIF_ACT or self.condition > CONDITION_ACT:
            return 2
        return int(self.statistic > VIF_LOOK)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"VIF at most {self.statistic:.2g}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        worst = self.names[int(np.argmax(self.vif))]
        if not self.concern:
            return f"The factors are told apart (VIF at most {self.statistic:.2g}, condition {self.condition:.2g})."
        together = ", ".join(self.entangled)
        return (
            f"{together} change together (VIF {self.statistic:.2g} for {worst}, condition {self.condition:.2g}): their "
            f"exponents trade against each other; read them together, leave {worst} out, or vary it by itself."
        )


def collinearity(law: LawFit) -> Collinearity:
    """Variance inflation and condition number of the law's terms.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> found = collinearity(fit.power_law(runs, "AW", ["V", "f", "d", "t"]))
    >>> round(found.statistic, 1), found.concern
    (1.0, 0)
    """
    terms = law.law.design(law.X, law.shifts)[:, 1:]
    names = law.names[1:]
    terms = terms - terms.mean(axis=0)
    terms = terms / np.sqrt(np.einsum("ij,ij->j", terms, terms))
    _, s, Vt = np.linalg.svd(terms, full_matrices=False)
    parts = (Vt.T / s) ** 2
    vif = parts.sum(axis=1)
    weakest = parts[:, -1] / vif
    entangled = tuple(name for name, share in zip(names, weakest, strict=True) if share > INVOLVED)
    if len(entangled) < 2:
        entangled = tuple(names[j] for j in sorted(np.argsort(-weakest)[:2]))
    return Collinearity(names, vif, float(s[0] / s[-1]), entangled)
