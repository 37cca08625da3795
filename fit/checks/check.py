"""The result of one check of a law, and the list of several: null hypothesis, statistic, p, level and verdict."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from pandas import DataFrame

from ...core.display import Displayable, TextTable
from ...core.errors import UsageError
from ...core.rounding import format_plain, listed, p_value
from ...core.text import line_spans
from ...core.verdict import MARKS
from ..available import NotAvailable

SIGNIFICANT, STRONG = 0.05, 0.001  # p-values below which a test gives a warning, or fails
LEVELS = ("passed", "warning", "failed")  # by ``Check.concern``
LARGE = 1e7  # from here on a statistic is shown with its power of ten
FAMILY_LEVEL = 0.1  # of all tests of the laws of a file together, by Holm's procedure
# Weights of tests in the family, 1 of those not named: that of curvature is of three squares or so, and tests of the
# errors have half a weight, because what they find changes intervals, not the law.
WEIGHTS: Mapping[str, float] = MappingProxyType({
    "curvature": 3.0,
    "scale of the response": 0.5,
    "order within edges": 0.5,
    "even scatter": 0.5,
    "even scatter of edges": 0.5,
    "error structure": 0.5,
})  # fmt: skip

# Title of each check by its key in `Judgement.checks` and in parameter files.
TITLES: Mapping[str, str] = MappingProxyType({
    "exponents": "Signs and usual ranges of exponents",
    "fixed exponents": "Fixed exponents",
    "possible values": "Possible values in the tested region",
    "predictive use": "Explained variance and predictive error",
    "number of edges": "Inference by edge",
    "reading": "Doubts of the reading",
    "form": "Lack of fit",
    "form within edges": "Lack of fit within edges",
    "curvature": "Curvature (squares of factors)",
    "single edges": "Influence",
    "prediction": "Cross-validation (PRESS)",
    "collinearity": "Multicollinearity",
    "signal to noise": "Signal to noise (adequate precision)",
    "scale of the response": "Box-Cox transformation",
    "order within edges": "Autocorrelation within edges (lag 1)",
    "order of tests": "Drift over the order of the tests",
    "even scatter": "Homoscedasticity, rows (Breusch-Pagan)",
    "even scatter of edges": "Homoscedasticity, edges (Breusch-Pagan)",
    "normality": "Normality, rows (Anderson-Darling)",
    "normality of edges": "Normality, edges (Anderson-Darling)",
    "error structure": "Error structure",
    "competing forms": "Competing forms (cross-validation)",
    "time exponent": "Equal time exponents of edges",
    "time between edges": "Time exponent between and within edges (Mundlak)",
    "time within edges": "Offset of time (term in 1/t)",
    "time restarts": "Restarts of the time",
    "missing conditions": "Missing conditions",
    "unused columns": "Columns that are not in the law (added variables)",
    "aliased columns": "Columns that change with a factor (aliases)",
    "wrong rows": "Outlying rows (robust fit)",
    "mixed units": "Mixed units of a condition (split test)",
    "wrong edges": "Outlying edges (studentized residuals)",
    "copies": "Duplicated rows and readings",
    "limited readings": "Steps and floor of the readings",
    "sensor limit": "Readings at the limit of a sensor",
    "gauge error": "Error of the wear gauge",
    "priors": "Agreement of priors and tests",
    "agreement": "Agreement of estimates",
    "run-outs": "Share of lives that ended",
    "longest lives": "Run-outs written as lives",
    "extrapolated lives": "Lives within the tests",
    "distribution of lives": "Distribution of the lives",
    "single lives": "Influence of single lives",
})  # fmt: skip
SYMBOLS: Mapping[str, str] = MappingProxyType({  # of statistics, as tables show them; others are shown as they are
    "A2": "A²",
    "Breusch-Pagan chi2": "χ²",
    "LR chi2": "χ²",
    "R2": "R²",
    "difference of RMS error": "difference",
    "log-likelihood difference": "difference in log L",
    "largest difference in SE": "difference / SE",
    "max. D by edge": "largest Cook's D",
    "max. D by row": "largest Cook's D",
    "max. F": "largest F",
    "max. VIF": "largest VIF",
    "n ln(RSS0/RSS1)": "n ln(RSS₀/RSS₁)",
    "predicted R2": "predicted R²",
    "score t": "t",
    "z of lag-1 correlation": "z",
})  # fmt: skip
UNTESTABLE = "not testable"
BY_EDGE = ("order within edges", "even scatter of edges", "normality of edges")  # not applicable to independent rows


@dataclass(frozen=True, slots=True)
class Suspect:
    """Rows or whole edges whose values of one column are probably wrong, and what would correct them.

    Attributes
    ----------
    column : str
        Symbol of the column.
    edges : tuple of str
        Whole edges; empty where single rows are suspected.
    lines : tuple of int
        Lines of the file of the suspected rows.
    factor, offset : float or None
        What the values are multiplied by, or what is added to them, to agree with the others; None where no known
        mistake explains them.
    cause : str
        The mistake in words, ``inch for mm``.
    """

    column: str
    edges: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    factor: float | None = None
    offset: float | None = None
    cause: str = ""

    @property
    def correction(self) -> str:
        """The argument of ``--correct`` that corrects it, empty where none is known.

        >>> Suspect("f", edges=("E07", "E11"), factor=25.4).correction
        'E07,E11:f*25.4'
        >>> Suspect("t", lines=(8, 12, 13, 14), offset=-5.0).correction
        'lines 8,12-14:t-5'
        """
        target = ",".join(self.edges) if self.edges else f"lines {','.join(line_spans(self.lines))}"
        if self.factor is not None:
            sign, size = ("*", self.factor) if self.factor >= 1 else ("/", 1 / self.factor)
            return f"{target}:{self.column}{sign}{size:.6g}"
        return "" if self.offset is None else f"{target}:{self.column}{self.offset:+.6g}"


def lines_of(lines: Sequence[int]) -> str:
    """``line 5``, or ``lines 5, 7 and 9``.

    >>> lines_of((5,)), lines_of((5, 7))
    ('line 5', 'lines 5, 7')
    """
    return f"line{'' if len(lines) == 1 else 's'} {listed(list(map(str, lines)))}"


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Check(Displayable):
    """One test or diagnostic of a law.

    Attributes
    ----------
    null : str
        Null hypothesis of a test, or the requirement that a rule of thumb checks.
    statistic : float
    symbol : str
        Name of the statistic: ``F``, ``max. VIF``; empty where the check has none (its ``statistic`` is then 0).
    df : int, tuple of int, or None
        Degrees of freedom, None where there are none.
    pvalue : float or None
        None where a rule of thumb decides.
    concern : int
        0 passed; 1 a reservation; 2 the law must not be used for control.
    verdict : str
        One sentence: the finding, and the remedy where there is one to take.
    kept : str
        The sentence of a test whose null hypothesis is retained once all tests of the file are counted together.
    note : bool
        Whether a rejection describes the errors and is no reservation: it is not counted with the other tests.
    suspects : tuple of Suspect
        Rows and edges that the check finds wrong.
    """

    null: str
    statistic: float = 0.0
    symbol: str = ""
    df: int | tuple[int, int] | None = None
    pvalue: float | None = None
    concern: int = 0
    verdict: str
    kept: str = ""
    note: bool = False
    suspects: tuple[Suspect, ...] = ()

    @property
    def noted(self) -> bool:
        """Whether it is a note whose null hypothesis is rejected."""
        return self.note and self.verdict != self.kept

    @property
    def counted(self) -> bool:
        """Whether it is a test that shares the level of its file."""
        return self.pvalue is not None and not self.note

    @property
    def level(self) -> str:
        """``passed``, ``warning`` or ``failed``."""
        return LEVELS[min(self.concern, 2)]

    @property
    def result(self) -> str:
        """Statistic and p.

        >>> Check(null="", statistic=1.318, symbol="F", df=(11, 9), pvalue=0.336, verdict="").result
        'F(11, 9) = 1.32, p = .34'
        """
        return ", ".join(
            part for part in (self.statistic_text, "" if self.pvalue is None else format_p(self.pvalue)) if part
        )

    @property
    def statistic_text(self) -> str:
        """The statistic with its symbol, and degrees of freedom where it has a p-value; empty without a statistic."""
        if not self.symbol:
            return ""
        if self.df is None or self.pvalue is None:
            df = ""
        else:
            df = f"({self.df})" if isinstance(self.df, int) else f"({self.df[0]}, {self.df[1]})"
        return f"{self.symbol}{df} = {format_plain(self.statistic, 3)}"


def statistic_name(symbol: str, df: int | tuple[int, int] | None, p: float | None) -> str:
    """The symbol of a statistic as tables show it, with degrees of freedom where it has a p-value.

    >>> statistic_name("Breusch-Pagan chi2", 4, 0.8), statistic_name("max. VIF", None, None)
    ('χ²(4)', 'largest VIF')
    """
    freedom = "" if df is None or p is None else f"({', '.join(map(str, df if isinstance(df, tuple) else [df]))})"
    return f"{SYMBOLS.get(symbol, symbol)}{freedom}"


def check_table(lines: Iterable[tuple[str, str, str, str]]) -> TextTable:
    """Checks as a table, the same in terminal, card and notebook.

    Parameters
    ----------
    lines : iterable of (title, statistic, p, verdict)
        As text; the verdict is ``passed``, ``warning``, ``failed`` or ``not testable``, and gets its icon.

    Examples
    --------
    >>> print(check_table([("Lack of fit", "F(11, 9) = 1.47", "0.571", "passed")]).text())
    check              statistic      p   verdict
    Lack of fit  F(11, 9) = 1.47  0.571  ✓ passed
    """
    rows, tones = [], []
    for title, statistic, p, verdict in lines:
        mark = MARKS[LEVELS.index(verdict) if verdict in LEVELS else None]
        rows.append((title, statistic, p, f"{mark.icon} {verdict}"))
        tones.append(mark.tone)
    return TextTable(("check", "statistic", "p", "verdict"), tuple(rows), tuple(tones))


def line_of_check(name: str, check: "Check | NotAvailable") -> tuple[str, str, str, str]:
    """Title, statistic, p and verdict of a check as text, for `check_table`."""
    if not isinstance(check, Check):
        return TITLES[name], "", "", UNTESTABLE
    p = "" if check.pvalue is None else p_value(check.pvalue)
    statistic = f"{statistic_name(check.symbol, check.df, check.pvalue)} = {format_statistic(check.statistic)}"
    return TITLES[name], statistic if check.symbol else "", p, check.level


def format_statistic(value: float) -> str:
    """Three digits, from 1000 to 10 million without a power of ten.

    >>> format_statistic(1.4712), format_statistic(12345.6)
    ('1.47', '12300')
    """
    text = format_plain(value, 3)
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LARGE else text


def family_wise(checks: Mapping[str, Check | NotAvailable], level: float = FAMILY_LEVEL) -> dict[str, Any]:
    """The checks with the rejections that hold when all their tests are counted together, weighted (Holm 1979).

    A test is a check with a p-value; of those not rejected ``concern`` is 0 and the verdict is ``kept``. A check
    without a p-value, and a note, stay as they are.

    Examples
    --------
    >>> one = Check(null="", pvalue=0.04, concern=1, verdict="Rejected.", kept="Retained.")
    >>> [check.verdict for check in family_wise({"a": one, "b": one, "c": one}).values()]
    ['Retained.', 'Retained.', 'Retained.']
    """
    tests = [
        ((check.pvalue or 0.0) / WEIGHTS.get(name, 1.0), name)
        for name, check in checks.items()
        if isinstance(check, Check) and check.counted
    ]
    rejected: set[str] = set()
    left = sum(WEIGHTS.get(name, 1.0) for _, name in tests)
    for p, name in sorted(tests):
        if p * left >= level:
            break
        rejected.add(name)
        left -= WEIGHTS.get(name, 1.0)
    return {
        name: replace(check, concern=0, verdict=check.kept or check.verdict)
        if isinstance(check, Check) and check.counted and name not in rejected
        else check
        for name, check in checks.items()
    }


def concern_of(p: float) -> int:
    """1, a reservation, below .05; 0 otherwise."""
    return int(p < SIGNIFICANT)


def format_p(p: float) -> str:
    """A p-value in the usual notation.

    >>> format_p(0.0153), format_p(0.5), format_p(1e-9)
    ('p = .015', 'p = .50', 'p < .001')
    """
    if p < STRONG:
        return "p < .001"
    return f"p = {p:.{3 if p < 0.1 else 2}f}".replace(" 0.", " .")


def sentences(checks: Mapping[str, Check | NotAvailable], rows_are_independent: bool, most: int) -> tuple[str, ...]:
    """At most ``most`` sentences: failed checks and warnings, what is not testable, notes, what passed."""
    if most < 1:
        raise UsageError(f"most={most}: at least one sentence is needed.")
    there = {name: check for name, check in checks.items() if isinstance(check, Check)}
    wrong = sorted((check for check in there.values() if check.concern), key=lambda check: -check.concern)
    fine = [
        ", ".join(filter(None, (TITLES[name], check.result)))
        for name, check in there.items()
        if not check.concern and not check.noted
    ]
    passed = [f"Passed: {'; '.join(fine)}."] if fine else []
    notes = [check.verdict for check in there.values() if check.noted and not check.concern]
    first = [*(check.verdict for check in wrong), *_not_testable(checks, rows_are_independent), *notes]
    if most == 1:
        return tuple((first or passed)[:1])
    return (*first[: most - len(passed)], *passed)


def _not_testable(checks: Mapping[str, Check | NotAvailable], rows_are_independent: bool) -> list[str]:
    """One sentence for each reason, with all checks that are not available for it."""
    reasons: dict[str, list[str]] = {}
    for name, check in checks.items():
        if isinstance(check, NotAvailable) and not (rows_are_independent and name in BY_EDGE):
            reasons.setdefault(check.reason, []).append(TITLES[name])
    return [f"Not testable ({'; '.join(names)}): {reason}." for reason, names in reasons.items()]


def frame_of_checks(checks: Mapping[str, Check | NotAvailable]) -> DataFrame:
    """A row for each check; of one that is not available, the reason as its verdict."""
    rows = {
        name: (check.concern, check.statistic, check.pvalue, check.verdict)
        if isinstance(check, Check)
        else (None, None, None, check.reason)
        for name, check in checks.items()
    }
    return DataFrame.from_dict(rows, orient="index", columns=["concern", "statistic", "pvalue", "verdict"])
