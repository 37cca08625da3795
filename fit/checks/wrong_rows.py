"""Rows whose response is probably wrong, found by a bisquare fit, and rows or blocks of rows that are copies.

Wrong rows are tested by a gap: given the next largest residual, the m largest of a sample are all beyond x with
probability (S(x) / S(next))^m, S the survival function of Student's t with the tails that the other rows have. So one
row far out in a sample with heavy tails is no finding, and three rows wrong by the same ratio are.

Sources: Yohai 1987, Ann. Stat. 15, 642 (MM estimation); Renyi 1953, Acta Math. Acad. Sci. Hung. 4, 191 (spacings of
the largest values); Weissman 1978, J. Am. Stat. Assoc. 73, 812 (tails); Cook & Weisberg 1982, Residuals and Influence
in Regression, section 2.2.2 (deleted residuals).
"""

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pandas as pd

from ...core.arrays import Array, Ints, Texts
from ...core.rounding import format_plain, listed
from ...datasets import Runs
from ...datasets.draft import CORRECTS
from ...datasets.plausibility.unit_shifts import TIME_RATIOS, explained, ratios_of
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, Check, Suspect, format_p, lines_of
from .robust_fit import NORMAL, bisquare_residuals, gap_pvalue, standing_apart, working_response
from .strata import LIFE, NO_ROWS, has_repeated_edges, is_computed, no_scatter, units_of

FEWEST, SPARE = 12, 6  # rows, and rows beyond the parameters
MOST = 1 / 6  # of the rows
FLOOR = 2.5  # robust standard deviations below which no residual is large
FAR = 4.8  # robust standard deviations beyond which a row is wrong where several are
SMALL = 0.4  # of the logarithm of the response: rows closer to the law are no mistakes that no unit explains
HARM = 0.2  # of the logarithm of a prediction: rows that move one by more forbid the use of the law
NEAR = 3.0  # standard deviations between a deviation and the ratio of two units that explains it
COMPUTED = "computed from other columns"
FEW_ROWS = 40  # independent rows, up to which one is tested by its deleted residual
NORMAL_LEVEL = 0.01  # of the level of other tests, as lives and heavy-tailed readings are no normal ones


def robust_deviations(law: LawFit) -> tuple[Array, Array, bool]:
    """Residuals of a bisquare fit, without and with the level of each edge, and whether they are of logarithms.

    The level of an edge is the median of its residuals and zero, which a wrong row does not move.
    """
    logs = law.formula.logarithmic and bool((law.observed > 0).all())
    if law.formula.linearisable:
        r = bisquare_residuals(law.design, np.log(law.observed) if logs else law.observed)
    else:
        r, logs = bisquare_residuals(*working_response(law)), law.error == "multiplicative"
    if not has_repeated_edges(law):
        return r, r, logs
    edge = units_of(law)[1]
    G = int(edge.max()) + 1
    level = pd.Series(np.append(r, np.zeros(G))).groupby(np.append(edge, np.arange(G))).median().to_numpy()
    return r - level[edge], r, logs


def _about_edges(law: LawFit, r: Array, rows: Ints) -> Array:
    """Residuals about the mean of their edge's other rows, of equal variance, where ``rows`` count for no mean."""
    if not has_repeated_edges(law):
        return r
    edge = units_of(law)[1]
    counted = np.ones(len(r))
    counted[rows] = 0.0
    size = np.bincount(edge, counted)
    mean = np.bincount(edge, counted * r) / np.maximum(size, 1.0)
    others = size[edge] - counted
    about = (r - mean[edge]) * np.sqrt(np.where(counted > 0, size[edge] / np.maximum(others, 1.0), 1.0))
    about /= np.where(counted > 0, 1.0, np.sqrt(1 + 1 / np.maximum(size[edge], 1.0)))
    return np.asarray(np.where(others > 0, about, 0.0))


def outlying_rows(law: LawFit, runs: Runs | None = None) -> Check | NotAvailable:
    """Rows whose response disagrees with the law of the others, with the ratio of units that explains them.

    Quantities that were computed in ``runs`` are in no unit of their own, and no ratio explains them.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> outlying_rows(law).concern
    0
    """
    if reason := no_scatter(law):
        return NotAvailable(reason)
    n, p = law.nobs, len(law.theta)
    if n < max(FEWEST, p + SPARE):
        return NotAvailable(f"{n} rows for {p} parameters are too few to find a wrong one")
    r, whole, logs = robust_deviations(law)
    size = np.abs(r)
    scale = float(np.median(size)) / NORMAL
    if scale <= 1e-9 * float(size.max()):
        return NotAvailable("at least half of the rows lie on the law exactly: the robust scale is zero")
    count = standing_apart(size, max(1, int(MOST * n)), FLOOR * scale)
    rows = np.sort(np.argsort(-size, kind="stable")[:count])
    pvalue = gap_pvalue(_about_edges(law, whole, rows), rows, FLOOR)
    if count == 1 and n <= FEW_ROWS and law.formula.linearisable and not has_repeated_edges(law):
        pvalue = min(pvalue, _deleted_pvalue(law, logs) / NORMAL_LEVEL)
    kept = (
        f"No row stands apart from the others: the largest deviation is {size.max() / scale:.1f} standard deviations, "
        f"that of line {law.lines[int(np.argmax(size))]} ({format_p(pvalue)})."
    )
    suspects: tuple[Suspect, ...] = ()
    words = kept
    if pvalue < SIGNIFICANT and float(size[rows].min()) > FAR * scale:
        power = _power_of_time(law, np.log(law.observed) - whole) if logs and not is_computed("t", runs) else 0.0
        ratios = {} if is_computed(measured(law), runs) else ratios_of(measured(law))
        suspects = _suspects(law, rows, r, scale, ratios if logs else None, power)
        words = " ".join(_sentence(law, one, r, logs) for one in suspects)
        kept = f"{words} Among all tests of the laws together this is not significant ({format_p(pvalue)} alone)."
    if suspects and _conditions_doubted(law, rows, runs):
        suspects = ()
        words = f"{lines_of(law.lines[rows].tolist()).capitalize()}: the reading doubts a condition there."
    if logs and float(size[rows].min()) < SMALL and any(one.factor is None for one in suspects):
        suspects = ()
        words = f"{count} rows deviate together by up to {np.expm1(size.max()):.0%}: the form does not fit them."
    return Check(
        null="no row deviates further than the tails of the other rows explain",
        statistic=float(size.max()) / scale,
        symbol="largest |r| / s",
        pvalue=pvalue,
        concern=_harm(law, whole, logs) if suspects else 0,
        verdict=words,
        kept=kept,
        suspects=suspects,
    )


def _conditions_doubted(law: LawFit, rows: Ints, runs: Runs | None) -> bool:
    """Whether a doubt of the reading corrects a factor of the law in all of these rows: their response is not wrong."""
    doubts = () if runs is None else runs.doubts
    known = [one for one in doubts if CORRECTS in one.remedy and set(law.factors).intersection(one.columns)]
    return {line for one in known for line in one.lines}.issuperset(law.lines[rows].tolist())


def _deleted_pvalue(law: LawFit, logs: bool) -> float:
    """Bonferroni probability of the largest deleted residual of least squares, under normal errors."""
    from scipy.special import stdtr

    Q, y = np.linalg.qr(law.design)[0], np.log(law.observed) if logs else law.observed
    r = y - Q @ (Q.T @ y)
    df = len(y) - Q.shape[1]
    z = r**2 / np.maximum(1.0 - (Q**2).sum(axis=1), 1e-12) / (r @ r / df)
    t = float(np.sqrt(z * (df - 1) / np.maximum(df - z, 1e-12)).max())
    return min(1.0, len(y) * 2 * float(stdtr(df - 1, -t)))


def _harm(law: LawFit, robust: Array, logs: bool) -> int:
    """2 where wrong rows move a prediction by more than the limit, otherwise 1."""
    return 1 + int(logs and float(np.abs(np.log(law.observed / law.fitted) - robust).max()) > HARM)


def _power_of_time(law: LawFit, fitted: Array) -> float:
    """Exponent of the time in the bisquare fit, 0 where the law has none."""
    if "t" not in law.factors or not law.formula.log_factors:
        return 0.0
    Z = law.design
    return float(np.linalg.lstsq(Z, fitted, rcond=None)[0][1 + law.factors.index("t")])


def _by_time(deviation: float, power: float, within: float) -> tuple[float, str]:
    """Factor of the time that corrects a deviation of the response, with its cause; 0 where there is none."""
    for ratio, cause in TIME_RATIOS.items():
        effect = power * math.log(ratio)
        if abs(effect) > 2 * within and abs(abs(deviation) - abs(effect)) <= within:
            return (ratio if deviation * effect > 0 else 1 / ratio), cause
    return 0.0, ""


def _suspects(
    law: LawFit, rows: Ints, r: Array, scale: float, ratios: Mapping[float, str] | None, power: float
) -> tuple[Suspect, ...]:
    """The rows, those that the same ratio of units explains together: of the response, else of the time."""
    groups: dict[tuple[str, float, str], list[int]] = {}
    for i in rows:
        column, (factor, cause) = law.response, (0.0, COMPUTED if ratios == {} else "")
        if ratios:
            factor, cause = explained(float(r[i]), ratios, NEAR * scale)
            if not factor and power:
                factor, cause = _by_time(float(r[i]), power, NEAR * scale)
                column = "t" if factor else column
        groups.setdefault((column, factor, cause), []).append(int(law.lines[i]))
    return tuple(
        Suspect(column, lines=tuple(lines), factor=factor or None, cause=cause)
        for (column, factor, cause), lines in groups.items()
    )


def measured(law: LawFit) -> str:
    """The measured quantity of a response, which may be given over fixed powers of factors: Fc of ``Fc/d``."""
    return law.response.split("/")[0]


def _sentence(law: LawFit, suspect: Suspect, r: Array, logs: bool) -> str:
    at = np.flatnonzero(np.isin(law.lines, suspect.lines))
    unit = law.units.get(law.response, "")
    values = listed([format_plain(float(v), 4 if abs(v) >= 1000 else 3) for v in law.observed[at]])
    head = f"{law.response} in {lines_of(suspect.lines)} ({values} {unit}".rstrip() + ")"
    if not logs:
        size = format_plain(float(np.median(r[at])), 3)
        return f"{head} deviates by {size} {unit} from the law of the other rows: check the record, or leave it out."
    return head + (_one_row if len(at) == 1 else _several_rows)(law, suspect, at, r)


def _one_row(law: LawFit, suspect: Suspect, at: Ints, r: Array) -> str:
    if suspect.factor is None:
        return (
            f" is {np.exp(r[at[0]]):.2g} times what the law of the other rows gives, and "
            f"{f'it is {COMPUTED}' if suspect.cause else 'no ratio of units explains it'}: check the record, or leave "
            "the row out."
        )
    if suspect.column == "t":
        return (
            f" agrees with the law of the other rows with {_times(law, at)} of this line in another unit{_of(suspect)}."
        )
    return f" is too {_low(suspect)} against the law of the other rows{_of(suspect)}: correct it."


def _several_rows(law: LawFit, suspect: Suspect, at: Ints, r: Array) -> str:
    if suspect.factor is None:
        times = listed([f"{v:.2g}" for v in np.exp(r[at])])
        return (
            f" are {times} times what the law of the other rows gives, and "
            f"{f'they are {COMPUTED}' if suspect.cause else 'no ratio of units explains them'}: check the records, or "
            "leave the rows out."
        )
    if suspect.column == "t":
        return f" agree with the law of the other rows with {_times(law, at)} in another unit{_of(suspect)}."
    return f" are too {_low(suspect)} against the law of the other rows{_of(suspect)}: correct them."


def _of(suspect: Suspect) -> str:
    return f" ({suspect.cause})"


def _low(suspect: Suspect) -> str:
    factor = suspect.factor or 1.0
    return f"{'low' if factor > 1 else 'high'} by a factor of {max(factor, 1 / factor):.4g}"


def _times(law: LawFit, at: Ints) -> str:
    t = listed([format_plain(float(v), 3) for v in law.X[at, law.factors.index("t")]])
    return f"t {t} {law.units.get('t', '')}"


FEWEST_AT_LIMIT, LIMIT_SHARE = 5, 0.04  # equal largest readings, and their share, of a sensor at its limit
FEWEST_COPIED = 3  # equal readings in succession
MOST_ROWS = 20_000  # among which copies are sought


def copies(law: LawFit) -> Check | NotAvailable | None:
    """Rows that stand twice, which needs no test, and edges that have readings of other edges.

    Two edges have equal readings by chance with a probability that follows from the resolution of the readings and the
    scatter of the rows, and from equal readings of further edges, as where a sensor is saturated; the p of a sequence
    is its product times the number of places where it could stand.
    """
    if law.rows is None:
        return NotAvailable(NO_ROWS)
    if law.edge is None or not has_repeated_edges(law) or no_scatter(law):
        return None
    if law.nobs > MOST_ROWS:
        return NotAvailable(f"copies are sought among {MOST_ROWS} rows at most, and the law has {law.nobs}")
    twice = _rows_twice(law, law.edge)
    blocks, pvalue = _equal_sequences(law, law.edge)
    once = f"The file contains each measurement {law.repeats} times, and each is counted once"
    kept = f"{once if law.repeats > 1 else 'No rows stand twice'}, and no two edges have the same readings."
    suspects = [Suspect(law.response, lines=tuple(int(law.lines[i]) for i in twice), cause="copies")] if twice else []
    suspects += [Suspect(law.response, edges=pair, cause="copies") for pair in dict.fromkeys(b[:2] for b in blocks)]
    return Check(
        null="no readings are copies of others",
        statistic=float(len(twice) + len(blocks)),
        symbol="copies" if law.repeats == 1 else "copies counted",
        pvalue=None if twice else pvalue,
        concern=int(bool(suspects)),
        verdict=f"{_twice_words(law, twice)} {_block_words(law, blocks)}".strip() or kept,
        kept=kept,
        suspects=tuple(suspects),
    )


def _rows_twice(law: LawFit, edge: Texts) -> list[int]:
    """Rows that repeat an earlier row of the same edge, unless readings at one setting and time are repeated there."""
    frame = pd.DataFrame(law.X).assign(edge=edge, y=law.observed)
    same = frame.duplicated(keep="first").to_numpy()
    again = frame.drop(columns="y").duplicated(keep="first").to_numpy() if same.any() else same
    return [int(i) for i in np.flatnonzero(same)] if same.sum() > again.sum() / 2 else []


def _equal_sequences(law: LawFit, names: Texts) -> tuple[list[tuple[str, str, int, float]], float]:
    """Sequences of equal readings in two edges: the edges, length and p; and the smallest p, for all of them."""
    code = units_of(law)[1]
    order = np.argsort(code, kind="stable")
    y, edge, label = law.observed[order], code[order], names[order]
    sd = _row_sd(law) * _size(law, y)
    chance = np.minimum(_resolution(y) / (2 * math.sqrt(math.pi) * sd), 1.0)
    near = np.searchsorted(np.sort(y), y + 2 * sd, "right") - np.searchsorted(np.sort(y), y - 2 * sd)
    k, n = FEWEST_COPIED, len(y) - FEWEST_COPIED + 1
    if n < 2:
        return [], 1.0
    grams = pd.DataFrame({j: y[j : j + n] for j in range(k)})[edge[:n] == edge[k - 1 :]]
    grams = grams[grams.duplicated(keep=False)]
    if grams.empty:
        return [], 1.0
    pairs = n**2 / 2
    smallest, best = 1.0, dict[tuple[str, str], tuple[str, str, int, float]]()
    for where in grams.groupby(list(grams.columns), sort=False).indices.values():
        for a, b in pairwise(grams.index.to_numpy()[where]):
            if edge[a] == edge[b]:
                continue
            length = _common_length(y, edge, a, b)
            others = ~np.isin(edge, (edge[a], edge[b]))
            equal = np.array([np.count_nonzero(others & (y == v)) for v in y[a : a + length]])
            p = float(min(1.0, pairs * np.prod(np.maximum(chance[a : a + length], equal / near[a : a + length]))))
            smallest = min(smallest, p)
            pair = (str(label[a]), str(label[b]))
            if p < min(SIGNIFICANT, best.get(pair, ("", "", 0, 1.0))[3]):
                best[pair] = (*pair, length, p)
    return list(best.values()), smallest


def sensor_limit(law: LawFit) -> Check | None:
    """A largest reading that repeats, as of a saturated sensor; None where none does, and of lives in any form."""
    if law.rows is None or law.response == LIFE:
        return None
    values, counts = np.unique(law.observed, return_counts=True)
    most, unit = int(counts[-1]), law.units.get(law.response, "")
    if most < max(FEWEST_AT_LIMIT, LIMIT_SHARE * law.nobs) or counts[:-1].max(initial=0) > most / 3:
        return None
    if len(values) < law.nobs / 2:  # readings are coarse, and ties are no sign of a limit
        return None
    readings = f"{most} of {law.nobs} readings of {law.response} are {values[-1]:.6g} {unit}".rstrip()
    words = "the largest: the sensor is probably at its limit, and the true values are higher. Leave these rows out."
    verdict = f"{readings}, {words}"
    return Check(null="no sensor is at its limit", statistic=float(most), symbol="readings", concern=1, verdict=verdict)


def _common_length(y: Array, edge: Ints, a: int, b: int) -> int:
    """Number of equal readings in succession from rows a and b on, each within its edge."""
    most = min(int(np.count_nonzero(edge[a:] == edge[a])), int(np.count_nonzero(edge[b:] == edge[b])))
    equal = y[a : a + most] == y[b : b + most]
    return most if equal.all() else int(np.argmin(equal))


def _resolution(y: Array) -> float:
    """Smallest step between distinct readings."""
    steps = np.diff(np.unique(y))
    return float(steps.min()) if steps.size else math.inf


def _row_sd(law: LawFit) -> float:
    """Standard deviation of the rows of an edge about its level, on the scale of the fit."""
    r = pd.Series(law.residuals)
    code = units_of(law)[1]
    about = (r - r.groupby(code).transform("mean")).to_numpy()
    return float(np.sqrt(about @ about / max(law.nobs - int(code.max()) - 1, 1)))


def _size(law: LawFit, y: Array) -> Array:
    """The size of a unit of the scale of the fit in the unit of the response."""
    return np.abs(y) if law.error == "multiplicative" else np.ones(len(y))


def _twice_words(law: LawFit, rows: list[int]) -> str:
    if not rows:
        return ""
    repeat = "repeats an earlier row" if len(rows) == 1 else "repeat earlier rows"
    return (
        f"{lines_of([int(law.lines[i]) for i in rows]).capitalize()} {repeat} of the same edge in "
        f"{law.response} and all factors: copies count twice and make intervals too narrow; remove them."
    )


def _block_words(law: LawFit, blocks: list[tuple[str, str, int, float]]) -> str:
    if not blocks:
        return ""
    parts = [f"edges {a} and {b} ({length} readings)" for a, b, length, _ in blocks]
    return (
        f"Identical {law.response} in succession: {listed(parts)}. Readings were probably copied from one edge to the "
        "other, and are no independent tests: check the records, and leave the copy out."
    )
