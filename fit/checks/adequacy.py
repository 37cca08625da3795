"""Is the law good enough to use? Every check in one place, each with its null, its figures and a verdict in words.

Whatever leaves out, resamples or compares does it by edge where edges gave several rows.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...core.display import Plottable
from ...core.threads import one_thread
from ..available import NotAvailable
from ..lawfit import LawFit
from .boxcox import BoxCox, box_cox
from .check import Check, frame_of_checks, worst_first
from .choice import MOST_ROWS, even_choice
from .collinearity import Collinearity, collinearity
from .deletion import Deletion, deletion
from .evidence import has_repeated_edges
from .influence import Influence, influence
from .lack_of_fit import LackOfFit, lack_of_fit
from .normality import Normality, normality
from .precision import Precision, precision
from .press import Press, press
from .residuals import Residuals, residual_sets
from .serial import SerialCorrelation, serial_correlation
from .spread import Spread, spread
from .strata import Strata, split

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, slots=True, repr=False)
class Adequacy(Plottable):
    """All checks of one law; each is there, or is the reason why it cannot be had.

    Attributes
    ----------
    lack_of_fit : LackOfFit or NotAvailable
        Form of the law against replicated edges, or rows where rows are independent.
    press : Press or NotAvailable
        PRESS and predicted R2.
    precision : Precision or NotAvailable
        Range of the predictions over their standard error.
    influence : Influence or NotAvailable
        Leverage, Cook's distance and DFBETAS.
    collinearity : Collinearity
        Variance inflation and condition number.
    boxcox : BoxCox or NotAvailable
        Power of the response.
    serial : SerialCorrelation or NotAvailable
        Whether rows of an edge follow each other.
    spread, spread_of_edges : Spread or NotAvailable
        Breusch-Pagan test of rows (within edges where there are several) and of edges.
    normality, normality_of_edges : Normality or NotAvailable
        Anderson-Darling test of the same.
    rows_are_independent : bool
        Whether no edge gave more than one row, or the file does not say.
    nobs : int
        Rows that were checked: of more than 5000 an even choice, which tells all that is to be told.
    """

    lack_of_fit: LackOfFit | NotAvailable
    press: Press | NotAvailable
    precision: Precision | NotAvailable
    influence: Influence | NotAvailable
    collinearity: Collinearity
    boxcox: BoxCox | NotAvailable
    serial: SerialCorrelation | NotAvailable
    spread: Spread | NotAvailable
    spread_of_edges: Spread | NotAvailable
    normality: Normality | NotAvailable
    normality_of_edges: Normality | NotAvailable
    rows_are_independent: bool
    nobs: int

    @property
    def checks(self) -> dict[str, Check | NotAvailable]:
        """Every check by what it is of, most telling first."""
        return {
            "form": self.lack_of_fit,
            "single edges": self.influence,
            "prediction": self.press,
            "collinearity": self.collinearity,
            "signal to noise": self.precision,
            "scale of the response": self.boxcox,
            "order within edges": self.serial,
            "even scatter": self.spread,
            "even scatter of edges": self.spread_of_edges,
            "normality": self.normality,
            "normality of edges": self.normality_of_edges,
        }

    def verdicts(self, most: int = 6) -> tuple[str, ...]:
        """Plain sentences, worst first, at most ``most``: what is wrong, what cannot be told, what is well.

        Raises
        ------
        UsageError
            ``most`` below 1.
        """
        return worst_first(self.checks, self.rows_are_independent, most)

    def to_frame(self) -> "DataFrame":
        """A row a check: concern, statistic, p, and its verdict."""
        return frame_of_checks(self.checks)


@one_thread
def adequacy(law: LawFit) -> Adequacy:
    """Check a law.

    Parameters
    ----------
    law : LawFit
        With an edge column, everything goes by edge; without one rows are taken as independent.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> adequacy(law).lack_of_fit.df
    (11, 9)
    """
    rows_given, law = law.nobs, even_choice(law)
    strata = split(law)
    left = deletion(law, strata)
    rows, edges = residual_sets(law, strata)
    return Adequacy(
        lack_of_fit=lack_of_fit(law, strata),
        press=press(law, left) if isinstance(left, Deletion) else left,
        precision=precision(law, strata),
        influence=influence(law, strata, left) if isinstance(left, Deletion) else left,
        collinearity=collinearity(law),
        boxcox=box_cox(law, strata),
        serial=_order(law, strata, rows_given),
        spread=spread(law, rows) if isinstance(rows, Residuals) else rows,
        spread_of_edges=spread(law, edges) if isinstance(edges, Residuals) else edges,
        normality=normality(rows) if isinstance(rows, Residuals) else rows,
        normality_of_edges=normality(edges) if isinstance(edges, Residuals) else edges,
        rows_are_independent=not has_repeated_edges(law),
        nobs=law.nobs,
    )


def _order(law: LawFit, strata: Strata | NotAvailable, rows_given: int) -> SerialCorrelation | NotAvailable:
    """The serial test; none of a choice of rows, since those before and after each are not in it."""
    if isinstance(strata, Strata) and law.nobs < rows_given:
        return NotAvailable(
            f"{law.nobs} of {rows_given} rows were checked, evenly chosen, so that neighbours on an edge are missing: "
            f"fit whole edges, {MOST_ROWS} rows at most, to test the order"
        )
    return serial_correlation(law, strata)
