"""Order of the tests: autocorrelation of residuals within edges, and drift of their levels; columns that are aliases.

The pooled lag-1 correlation is compared with its exact moments; the drift is tested as an added variable. A column that
changes with a factor alone cannot be tested: it is named.

Source: Durbin & Watson 1950, Biometrika 37, 409 (exact moments of a ratio of quadratic forms in residuals).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import exp

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints, Texts
from ...core.rounding import format_plain, join_words, label_of, listed
from ...datasets import Runs
from ...datasets.headers import parse_header
from ..available import NotAvailable
from ..edges import changes_within
from ..lawfit import LawFit
from .check import SIGNIFICANT, STRONG, Check, concern_of, format_p
from .missing_factors import added_between, blocks_of, settings_of
from .residual_tests import HELD
from .strata import Strata, levels_of_edges, no_scatter, rows_in, units_of

FREE = 8  # degrees of freedom that a test of drift needs
SPREAD = 0.5  # of the order that the factors must leave free, as a share of its range
SMALL = 0.05  # drift in ln response over all tests below which it is not reported
SAME_SPEED = 0.02  # variation of V / D, of readings that are rounded, at one spindle speed
T_KNOWN = 2.0  # t of an effect from which on it is asked what it may be of
SIMPLE = 0.05  # distance of an exponent from a multiple of 1/2 below which a column is computed from a factor
CONDITION = re.compile(  # names of columns of words that are conditions of their own
    r".*(?:coolant|cooling|lubric|kühl|schmier|refriger|lubrif|arrosage|(?:edge|tool|insert|surface).?condition|zustand"
    r"|état|estado|grade|coating|beschichtung|regrind|schliff|holder|halter|clamp|spann|material|werkstoff|batch|lot"
    r"|charge|colada|coulée|heat|machine|maschine|máquina|operator|bediener|operario|opérateur).*", flags=re.IGNORECASE
)  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class SerialCorrelation(Check):
    """Test of the pooled lag-1 correlation of residuals within edges, each edge having its own level.

    Removing the level alone gives it an expectation of about ``-1/(m - 1)`` for m rows per edge, so it is compared with
    its exact mean and variance under independence; the p-value is that of a beta variable with these moments, the
    statistic the standardised difference.

    Attributes
    ----------
    correlation, expected, sd : float
        The correlation, and its mean and standard deviation for independent rows.
    nobs, n_edges : int
        Rows and edges with more than one row.
    order : str
        Order of the rows: ``t`` or ``line of the file``.
    """

    correlation: float
    expected: float
    sd: float
    nobs: int
    n_edges: int
    order: str


def serial_correlation(law: LawFit, strata: Strata | NotAvailable) -> SerialCorrelation | NotAvailable:
    """Test the pooled lag-1 correlation within edges, in order of time where the law has it, else of the file."""
    from scipy.special import betainc

    if reason := no_scatter(law):
        return NotAvailable(reason)
    if not isinstance(strata, Strata):
        return strata
    total = float(strata.rest @ strata.rest)
    time = law.X[:, law.factors.index("t")] if "t" in law.factors else None
    by_time = time is not None and bool(changes_within(time[:, None], strata.edge)[0])
    key = time if time is not None and by_time else law.lines
    order = np.lexsort((law.lines, key, strata.edge))
    mean, variance = _moments(strata, order)
    if variance < HELD or total <= HELD**2 * law.rss:
        return NotAvailable("rows of an edge show autocorrelation only where edges have three or more")
    rest, same = strata.rest[order], np.diff(strata.edge[order]) == 0
    found = float((rest[1:] * rest[:-1])[same].sum()) / total
    x, m, v = (found + 1) / 2, (mean + 1) / 2, variance / 4
    size = m * (1 - m) / v - 1
    below = float(betainc(m * size, (1 - m) * size, x))
    rows = np.bincount(strata.edge)
    sd, p = variance**0.5, min(1.0, 2 * min(below, 1 - below))
    return SerialCorrelation(
        null="residuals of an edge are independent about its level",
        statistic=(found - mean) / sd,
        symbol="z of lag-1 correlation",
        pvalue=p,
        concern=concern_of(p) if found < mean else 0,
        verdict=_verdict(found, mean, p),
        kept=_kept(found, mean, p),
        note=found >= mean,
        correlation=found,
        expected=mean,
        sd=sd,
        nobs=int(rows[rows > 1].sum()),
        n_edges=int((rows > 1).sum()),
        order="t" if by_time else "line of the file",
    )


def drift(law: LawFit, runs: Runs | None, icc: float) -> Check | NotAvailable | None:
    """Test whether the levels of edges, or independent rows, drift from test to test; None of few tests.

    The trend is adjusted for the law and the squares of its columns. The order is that of a column of run numbers,
    else that of the rows. Where the factors follow it, a drift cannot be separated from their effect.

    Parameters
    ----------
    law : LawFit
    runs : Runs or None
        With the column of the run numbers.
    icc : float
        Share of the residual variance that lies between edges.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> drift(fit.power_law(runs, "AW", ["V", "f", "d", "t"]), runs, 0.5).concern
    0
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    numbers, unit = _run_numbers(law, runs), units_of(law)[1]
    if len(np.unique(law.lines)) < len(np.unique(np.column_stack([law.lines, unit]), axis=0)):
        return NotAvailable("tests of several files, or of one line, have no common order: a drift cannot be tested")
    at = law.lines.astype(float) if numbers is None else numbers
    place = np.argsort(np.argsort(np.bincount(unit, at) / np.bincount(unit), kind="stable"), kind="stable")
    order = place / max(len(place) - 1, 1)
    moving = changes_within(law.gradient, unit)
    levels, others, _, size = levels_of_edges(law.gradient, law.residuals, order[unit][:, None], unit, moving)
    squares = [np.square(column - column.mean()) for column in others.T if np.ptp(column) > 0]
    adjusted = np.column_stack([np.ones(len(levels)), others, *squares])
    if len(levels) - adjusted.shape[1] < FREE:
        return None
    left = order - adjusted @ np.linalg.lstsq(adjusted, order, rcond=1e-9)[0]
    found = added_between(levels, adjusted, order, 1 / (icc + (1 - icc) / size))
    if found is None or np.ptp(left) < SPREAD:
        return _in_order_of_a_factor(law, runs, place, numbers is not None)
    return _drift(law, found, "the column of run numbers" if numbers is not None else "the order of the rows")


def _in_order_of_a_factor(law: LawFit, runs: Runs | None, place: Ints, numbered: bool) -> Check | NotAvailable:
    """A concern where the tests are known to be cut in this order, and a factor rises or falls with nearly each."""
    if (numbered or _turned_down(law, runs)) and (alias := _alias_of_order(law, place)):
        return alias
    what = "were cut" if numbered else "stand in the file"
    return NotAvailable(f"the tests {what} in the order of a factor: a drift cannot be separated from its effect")


def _turned_down(law: LawFit, runs: Runs | None) -> bool:
    """Whether the diameter falls from row to row at one spindle speed: the rows are then passes over one bar."""
    rows = rows_in(law, runs) if runs is not None and runs.has("D") and "V" in law.factors else None
    if runs is None or rows is None:
        return False
    D = runs.values("D")[rows][np.argsort(law.lines, kind="stable")]
    V = law.X[np.argsort(law.lines, kind="stable"), law.factors.index("V")]
    return bool((np.diff(D) <= 0).all() and np.ptp(V / D) < SAME_SPEED * np.mean(V / D))


def _alias_of_order(law: LawFit, place: Ints) -> Check | None:
    """The concern about factors that rise or fall with nearly every test; None where there are none."""
    unit = units_of(law)[1]
    moving = changes_within(law.X, unit)
    first = np.unique(unit, return_index=True)[1][np.argsort(place)]
    steps = {name: np.diff(law.X[first, j]) for j, name in enumerate(law.factors) if not moving[j]}
    found = {name: step.sum() for name, step in steps.items() if _is_one_way(step)}
    if not found:
        return None
    words = join_words([f"{name} {'rises' if change > 0 else 'falls'}" for name, change in found.items()])
    return Check(
        null="the order of the tests is not that of a factor",
        concern=1,
        verdict=f"{words} from test to test: a drift (the machine warms up, the tool wears, a sensor drifts) cannot be "
        f"separated from the effect of {join_words(list(found))} on {law.response}.",
    )


def _is_one_way(step: Array) -> bool:
    """Whether a factor never turns back, and moves at half of the steps between tests, eight at least."""
    moves = np.count_nonzero(step)
    return bool(moves >= max(FREE, len(step) / 2) and abs(np.sign(step).sum()) == moves)


def _drift(law: LawFit, found: tuple[float, float, int, float], by: str) -> Check:
    b, t, df, p = found
    change = f"{100 * (exp(b) - 1):+.2g} %" if law.formula.logarithmic else f"{b:+.3g} {law.units[law.response]}"
    small = law.formula.logarithmic and abs(b) < SMALL
    return Check(
        null="the residuals do not drift over the order of the tests",
        statistic=t,
        symbol="t",
        df=df,
        pvalue=p,
        concern=0 if small else concern_of(p),
        verdict=f"Drift over the tests by {by}: {law.response} changes by {change.rstrip()} from the first test to the "
        f"last, adjusted for the law ({format_p(p)}), as when the machine warms up, a sensor drifts or a batch "
        "changes; repeat the first test, and note the order in a column 'run'.",
        kept=f"No drift over the tests by {by} that this test shows ({format_p(p)}).",
    )


def aliased_columns(law: LawFit, runs: Runs | None) -> Check | None:
    """Columns of conditions that change with one factor of the law alone, whose effect may be theirs; None without any.

    Left out are numbers without a unit (coded levels), and numbers that are computed from the factor.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> aliased_columns(fit.power_law(runs, "AW", ["V", "f", "d", "t"]), runs) is None
    True
    """
    if runs is None or law.by is not None or no_scatter(law):
        return None
    factors = _known_factors(law)
    found = {name: (x, _followed(x, factors, name)) for name, x in _conditions(law, runs).items()}
    sentences = [_alias(law, name, x, of, factors) for name, (x, of) in found.items() if of]
    null = "columns of conditions vary beside the factors"
    return Check(null=null, concern=1, verdict=" ".join(sentences[:2])) if sentences else None


def _followed(labels: Texts, factors: Mapping[str, Array], name: str) -> list[str]:
    """Factors with which the labels of a column change, value by value."""
    return [one for one, x in factors.items() if _one_to_one(x, labels) and _is_own(name, labels, x)]


def _known_factors(law: LawFit) -> dict[str, Array]:
    """Values of the factors that are constant within edges and have an effect that the tests show."""
    moving, known = changes_within(law.X, units_of(law)[1]), law.tvalues.abs()
    return {name: law.X[:, j] for j, name in enumerate(law.factors) if not moving[j] and known.get(name, 0) > T_KNOWN}


def _conditions(law: LawFit, runs: Runs) -> dict[str, Texts]:
    """Columns of conditions that the law does not use, at its rows: words by their name, numbers by their unit."""
    words = {name: x for name, x in blocks_of(law, runs).items() if CONDITION.fullmatch(name)}
    numbers = settings_of(law, runs)
    columns = {} if isinstance(numbers, NotAvailable) else numbers
    return words | {name: x.astype(object) for name, x in columns.items() if parse_header(name).unit_text}


def _one_to_one(values: Array, labels: Texts) -> bool:
    """Whether each value of a factor has one label, and each label one value."""
    pairs = set(zip(values.tolist(), labels.tolist(), strict=True))
    return len(pairs) == len({value for value, _ in pairs}) == len({label for _, label in pairs}) > 1


def _is_own(name: str, labels: Texts, values: Array) -> bool:
    """Whether a column is a condition of its own: words, or numbers that are no simple power of the factor."""
    if not parse_header(name).unit_text or isinstance(labels[0], str):
        return True
    x = labels.astype(float)
    if (x <= 0).any() or (values <= 0).any():
        return True
    exponent = float(np.polyfit(np.log(values), np.log(x), 1)[0])
    return abs(2 * exponent - round(2 * exponent)) > 2 * SIMPLE


def _alias(law: LawFit, name: str, labels: Texts, factors: list[str], values: Mapping[str, Array]) -> str:
    """The sentence on a column that changes with factors."""
    first = factors[0]
    level = {value: label_of(label) for value, label in zip(values[first].tolist(), labels.tolist(), strict=True)}
    shown = [f"{level[value]} at {first} {format_plain(value)}" for value in sorted(level)]
    effect = f"effect{'s' if len(factors) > 1 else ''} of {join_words(factors)} on {law.response}"
    return (
        f"The {effect} may be that of column {name!r}: {listed(shown, 3)}, never varied separately. Only tests that "
        "vary them separately distinguish them."
    )


def _run_numbers(law: LawFit, runs: Runs | None) -> Array | None:
    """Numbers of the runs at the rows of the law, None where a row has none."""
    rows = rows_in(law, runs) if runs is not None and runs.has("run") else None
    if runs is None or rows is None:
        return None
    found = pd.to_numeric(pd.Series(runs.labels("run")[rows], dtype=object), errors="coerce").to_numpy(dtype=float)
    return found if np.isfinite(found).all() and np.ptp(found) > 0 else None


def _kept(found: float, expected: float, p: float) -> str:
    return f"No autocorrelation of residuals within edges ({_result(found, expected, p)})."


def _result(found: float, expected: float, p: float) -> str:
    return f"lag-1 correlation {found:.2f}, expected {expected:.2f} under independence, {format_p(p)}"


def _verdict(found: float, expected: float, p: float) -> str:
    if p >= (SIGNIFICANT if found < expected else STRONG):
        return _kept(found, expected, p)
    result = _result(found, expected, p)
    if found < expected:
        return (
            f"Negative autocorrelation of residuals within edges ({result}): rows lie above and below the law in turn, "
            "as where rows of two edges or of two measurements have one name; check the edge column."
        )
    return (
        f"Positive autocorrelation of residuals within edges ({result}), as with cumulative wear or edges "
        "with different wear curves: intervals by edge allow for it, those of independent rows do not."
    )


def _moments(strata: Strata, order: Ints) -> tuple[float, float]:
    """Mean and variance of the lag-1 ratio for independent normal rows.

    With ``M`` the projection that makes the residuals and ``A`` the matrix of neighbours, ``r = e'Ae / e'e``
    has mean ``tr(MA) / v`` and variance ``2 (v tr(MAMA) - tr(MA)^2) / (v^2 (v + 2))``, v the rank of M.
    """
    edge, level, basis = strata.edge[order], strata.level[order], strata.basis[order]
    same = np.diff(edge) == 0
    by_edge = np.bincount
    neighbours = _neighbours(level, same)
    one = by_edge(edge, weights=level * neighbours) / strata.weight
    two = by_edge(edge, weights=neighbours**2) / strata.weight
    of_basis = np.column_stack([_neighbours(q, same) for q in basis.T]) if basis.shape[1] else basis
    inner = basis.T @ of_basis
    shared = sum(float((by_edge(edge, weights=level * q) ** 2 / strata.weight).sum()) for q in of_basis.T)
    first = -float(one.sum()) - float(np.trace(inner))
    second = 0.5 * float(same.sum()) - 2 * float(two.sum()) + float((one**2).sum())
    second += -2 * (float((of_basis**2).sum()) - shared) + float((inner**2).sum())
    v = strata.df_within
    if v <= 0:
        return 0.0, 0.0
    return first / v, 2 * (v * second - first**2) / (v**2 * (v + 2))


def _neighbours(x: Array, same: Flags) -> Array:
    """Half the sum of the neighbours of each row on its edge."""
    out = np.zeros_like(x)
    out[1:] += np.where(same, x[:-1], 0.0)
    out[:-1] += np.where(same, x[1:], 0.0)
    return out / 2
