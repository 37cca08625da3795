"""How well a law predicts what it has not seen: PRESS and predicted R2, by edge where edges gave several rows.

Sources: Allen 1974, Technometrics 16, 125; Myers, Montgomery & Anderson-Cook, Response Surface Methodology
(predicted R2 and its gap to R2).
"""

from dataclasses import dataclass

import numpy as np

from ...core.display import Displayable
from ..lawfit import LawFit
from .check import ByRule
from .deletion import Deletion

GAP = 0.2  # between R2 and predicted R2


@dataclass(frozen=True, slots=True, repr=False)
class Press(Displayable, ByRule):
    """How well the law predicts what it has not seen.

    Attributes
    ----------
    units : {"edges", "rows"}
        What was left out, one at a time.
    press : float
        Sum of squared residuals of what was left out, on the scale of the fit.
    rsquared, predicted_rsquared : float
        Of the fit, and ``1 - press / tss``.
    typical : float
        Root mean square of the same residuals.
    unit : str
        Of ``typical``: ``ln`` or the unit of the response.
    """

    units: str
    press: float
    rsquared: float
    predicted_rsquared: float
    typical: float
    unit: str

    @property
    def null(self) -> str:
        """What is looked for."""
        return f"the law predicts {self.units} it has not seen about as well as those it was fitted to"

    @property
    def statistic(self) -> float:
        """Predicted R2."""
        return self.predicted_rsquared

    @property
    def concern(self) -> int:
        """0 fine; 1 a gap above 0.2: few units or one that decides; 2 worse than the plain mean."""
        if self.predicted_rsquared <= 0:
            return 2
        return int(self.rsquared - self.predicted_rsquared > GAP)

    @property
    def brief(self) -> str:
        """The finding in a few words."""
        return f"predicted R2 {self.predicted_rsquared:.3f}"

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""
        error = f"{100 * np.expm1(self.typical):.3g} %" if self.unit == "ln" else f"{self.typical:.3g} {self.unit}"
        found = f"predicted R2 {self.predicted_rsquared:.2f} against {self.rsquared:.2f} of the fit"
        if self.concern == 2:
            return f"The law predicts {self.units} left out no better than their mean would ({found}): do not use it."
        if self.concern:
            return (
                f"The law fits better than it predicts ({found}, typical error {error}): add {self.units}, or drop "
                "the factor that one of them decides."
            )
        return f"{self.units.capitalize()} left out are predicted to {error} ({found})."


def press(law: LawFit, left: Deletion) -> Press:
    """PRESS and predicted R2 from what leaving out does."""
    total = float(left.predicted @ left.predicted)
    share = 1 - total / law.tss if law.tss > 0 else 0.0
    return Press(left.units, total, law.rsquared, share, (total / law.nobs) ** 0.5, law.scale_unit)
