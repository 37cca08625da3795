"""Is the law good enough to use? Every check in one place, each with its null, its figures and a verdict in words.

Whatever leaves out, resamples or compares does it by edge where edges gave several rows.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from ..datasets.errors import UsageError
from .available import NotAvailable
from .boxcox import BoxCox, box_cox
from .collinearity import Collinearity, collinearity
from .influence import Deletion, Influence, Precision, Press, deletion, influence, precision, press
from .lack_of_fit import LackOfFit, has_repeated_edges, lack_of_fit, split
from .lawfit import LawFit
from .regression import even_choice
from .residual_tests import (
    Normality,
    Residuals,
    SerialCorrelation,
    Spread,
    normality,
    residual_sets,
    serial_correlation,
    spread,
)

MOST_ROWS = 5_000


class Check(Protocol):
    """What every check of a law says of itself."""

    @property
    def null(self) -> str:
        """What it takes for granted."""

    @property
    def statistic(self) -> float:
        """Its figure."""

    @property
    def df(self) -> int | tuple[int, int] | None:
        """Degrees of freedom, None where it has none."""

    @property
    def pvalue(self) -> float | None:
        """P-value, None where a rule decides."""

    @property
    def concern(self) -> int:
        """0 fine, 1 look at it, 2 act on it."""

    @property
    def brief(self) -> str:
        """The finding in a few words."""

    @property
    def verdict(self) -> str:
        """One sentence: what was found and what to do."""


@dataclass(frozen=True, slots=True)
class Adequacy:
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


def worst_first(checks: Mapping[str, Check | NotAvailable], rows_are_independent: bool, most: int) -> tuple[str, ...]:
    """At most ``most`` sentences of checks: what is wrong, what cannot be told, and in one sentence what is well."""
    if most < 1:
        raise UsageError(f"most={most}: at least one sentence is needed to say anything.")
    there: list[Check] = [check for check in checks.values() if not isinstance(check, NotAvailable)]
    wrong = sorted((check for check in there if check.concern), key=lambda check: -check.concern)
    fine = [check.brief for check in there if not check.concern]
    well = [f"{'In order' if wrong else 'Nothing speaks against the law'}: {', '.join(fine)}."] if fine else []
    told = [*(check.verdict for check in wrong), *_unknown(checks, rows_are_independent)]
    kept = told[: most - len(well)] if most > 1 else (told or well)[:1]
    return (*kept, *(well if most > 1 else ()))


def _unknown(checks: Mapping[str, Check | NotAvailable], rows_are_independent: bool) -> list[str]:
    """One sentence for each reason, with all that it keeps from being known."""
    reasons: dict[str, list[str]] = {}
    by_edge = {"order within edges", "even scatter of edges", "normality of edges"}
    for name, check in checks.items():
        # of independent rows these are no loss
        if isinstance(check, NotAvailable) and not (rows_are_independent and name in by_edge):
            reasons.setdefault(check.reason, []).append(name)
    return [f"Not known ({', '.join(names)}): {reason}." for reason, names in reasons.items()]


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
    law = even_choice(law, MOST_ROWS)
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
        serial=serial_correlation(law, strata),
        spread=spread(law, rows) if isinstance(rows, Residuals) else rows,
        spread_of_edges=spread(law, edges) if isinstance(edges, Residuals) else edges,
        normality=normality(rows) if isinstance(rows, Residuals) else rows,
        normality_of_edges=normality(edges) if isinstance(edges, Residuals) else edges,
        rows_are_independent=not has_repeated_edges(law),
        nobs=law.nobs,
    )
