"""What every check of a law says of itself, and how it is told: p-values in words, the worst check first."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from ...core.errors import UsageError
from ..available import NotAvailable

if TYPE_CHECKING:
    from pandas import DataFrame

SIGNIFICANT, STRONG = 0.05, 0.001  # p-values below which a test is of concern


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


class ByRule:
    """A check that a limit from the books decides: no distribution is attached to its figure."""

    __slots__ = ()

    @property
    def df(self) -> int | tuple[int, int] | None:
        """None: no distribution is attached to it."""
        return None

    @property
    def pvalue(self) -> None:
        """None: its limit is a rule."""
        return


def concern_of(p: float) -> int:
    """0 fine, 1 below .05, 2 below .001."""
    return int(p < SIGNIFICANT) + int(p < STRONG)


def p_in_words(p: float) -> str:
    """A p-value as the papers print it: ``p .015``.

    Examples
    --------
    >>> p_in_words(0.0153), p_in_words(0.5), p_in_words(1e-9)
    ('p .015', 'p .50', 'p < .001')
    """
    if p < STRONG:
        return "p < .001"
    return f"p {p:.{3 if p < 0.1 else 2}f}".replace(" 0.", " .")


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


def frame_of_checks(checks: Mapping[str, Check | NotAvailable]) -> "DataFrame":
    """A row a check; of one that cannot be had, the reason."""
    import pandas as pd

    rows = {
        name: (None, None, None, check.reason)
        if isinstance(check, NotAvailable)
        else (check.concern, check.statistic, check.pvalue, check.verdict)
        for name, check in checks.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=["concern", "statistic", "pvalue", "verdict"])
