"""Edges that are probably wrong: a condition in another unit, and a response unlike that of the others.

Both use the regression of the levels of the edges, with what varies within them fitted within them. Edges with a
condition in another unit are found by the split test (``datasets.plausibility.unit_shifts``), for by their leverage
they leave small residuals; single edges by the externally studentized residual of their level, the largest first, each
without those before it.

Sources: Rosner 1983, Technometrics 25, 165 (several outliers, one after the other); Belsley, Kuh & Welsch 1980,
Regression Diagnostics, chapter 2 (externally studentized residuals).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.rounding import format_plain
from ...datasets.plausibility.unit_shifts import (
    CLOSE,
    EVIDENCE,
    INSIDE,
    RATIOS,
    TIME_RATIOS,
    isolated,
    minorities,
    ratios_of,
    split_evidence,
)
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, Check, Suspect, format_p
from .strata import Strata, linear_columns, no_scatter, orthonormal
from .wrong_rows import NEAR, explained, lines_of, listed, tail_of_rows

FEWEST, SPARE = 8, 4  # edges, and edges beyond the parameters that they determine
MOST = 1 / 6  # of the edges
SMALL = 0.3  # of the logarithm of the response: a smaller deviation of an edge hardly moves a law
ALSO = 0.0025  # p below which a further edge is wrong: the strictest step of Holm's procedure over 20 tests
BLOCK = 4 * EVIDENCE  # of edges whose response is in another unit, which are chosen by their residuals
ALIKE = 0.35  # of the logarithm of the ratio: edges in two groups that far apart deviate less from either
STEPS = 10
OWN = 0.02  # share of its own level that an edge must not determine alone
TIME_INSIDE = 3.0  # as INSIDE, of times, whose range differs between edges that are stopped at a criterion

CONDITIONS: Mapping[str, Mapping[float, str]] = {"t": TIME_RATIOS, **RATIOS}
Flags = NDArray[np.bool_]
Split = tuple[float, str, Flags, float]  # evidence, factor of the law, edges, what it is multiplied by


@dataclass(frozen=True, slots=True)
class EdgeLevels:
    """Regression of the levels of edges, what varies within them stacked above; rows where they are independent.

    Attributes
    ----------
    names : tuple of str, length G
        Edges, or lines of the file.
    by_edge : bool
    A, b : ndarray, shape (w + G, p) and (w + G,)
        Columns, and the response, whitened.
    root : ndarray, shape (G,)
        Square root of the weight of each level.
    x : ndarray, shape (G, k)
        Mean of the terms of the law (logarithms of the factors) on each edge.
    back : ndarray, shape (p, p)
        ``theta`` is ``back`` times the coefficients of A.
    """

    names: tuple[str, ...]
    by_edge: bool
    A: Array
    b: Array
    root: Array
    x: Array
    back: Array

    @property
    def within(self) -> int:
        """Rows above the levels."""
        return len(self.b) - len(self.names)


def edge_levels(law: LawFit, strata: Strata | NotAvailable) -> EdgeLevels | NotAvailable:
    """Levels of the edges of a law; of its rows where each is an edge or no edge is known."""
    if isinstance(strata, Strata):
        stacked = strata.stacked()
        count = np.bincount(strata.edge)
        x = np.column_stack([np.bincount(strata.edge, term) / count for term in law.design[:, 1:].T])
        own = np.linalg.solve(strata.back, law.theta)
        A, root = stacked[:, :-1], np.sqrt(strata.weights)
        return EdgeLevels(strata.names, True, A, A @ own + stacked[:, -1], root, x, strata.back)
    if reason := no_scatter(law):
        return NotAvailable(reason)
    if law.n_edges is not None and law.n_edges < law.nobs:
        return strata
    columns, back = linear_columns(law)
    b = columns @ np.linalg.solve(back, law.theta) + law.residuals
    names = law.lines if law.edge is None else law.edge
    one = np.ones(law.nobs)
    return EdgeLevels(tuple(map(str, names)), law.edge is not None, columns, b, one, law.design[:, 1:], back)


def mixed_units(law: LawFit, strata: Strata | NotAvailable) -> Check | NotAvailable | None:
    """Edges whose speed, feed, depth, time or response is in another unit than that of the others.

    Conditions by the split test, the response by edges that all deviate by the ratio of two units.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> mixed_units(law, split(law)).concern
    0
    """
    if law.formula.name != "power" or law.error != "multiplicative":
        return None
    levels = edge_levels(law, strata)
    if isinstance(levels, NotAvailable):
        return levels
    load = law.response in ROLES and ROLES[law.response].kind == "load" and law.response != "P"
    asked = [name for name in law.factors if name in CONDITIONS and not (load and name in ("V", "t"))]
    if len(levels.names) < max(FEWEST, len(law.theta) + SPARE):
        return NotAvailable(f"fewer than {max(FEWEST, len(law.theta) + SPARE)} edges or settings")
    tried, by_square = _response_blocks(law, levels), dict[str, float]()
    for name in asked:
        j = law.factors.index(name)
        moves = minorities(levels.x[:, j], CONDITIONS[name], TIME_INSIDE if name == "t" else INSIDE)
        if moves:
            evidence, by_square[name] = _evidence(law, levels, j, moves)
            tried += [(float(e), name, *move) for e, move in zip(evidence, moves, strict=True)]
    most = max(tried, key=lambda one: one[0], default=None)
    kept = f"No edges agree better with {' or '.join((*asked, law.response))} in another unit."
    if most is None or most[0] < EVIDENCE:
        statistic = most[0] if most else 0.0
        return Check(null=_NULL, statistic=statistic, symbol=_SYMBOL, verdict=kept, kept=kept)
    same = [one for one in tried if one[0] > most[0] - CLOSE and np.array_equal(one[2], most[2])]
    same.sort(key=lambda one: -one[0])
    curved = _resemblance(law, levels, most, by_square.get(most[1], 0.0))
    words = _split_words(law, levels, same)
    if curved == 1:
        words += f" The square of ln {most[1]} explains them as well: a second-order law, if the units are right."
    return Check(
        null=_NULL,
        statistic=most[0],
        symbol=_SYMBOL,
        concern=2 - curved,
        verdict=words if curved < 2 else f"{kept[:-1]} than with the square of ln {most[1]}.",
        kept=kept,
        suspects=(_suspect(levels, same[0]),) if curved == 0 else (),
    )


def _resemblance(law: LawFit, levels: EdgeLevels, one: Split, by_square: float) -> int:
    """0 where a curved law explains edges clearly worse than another unit, 1 where it does as well, 2 better."""
    evidence, name, edges, _ = one
    if name == law.response or isolated(levels.x[:, law.factors.index(name)], edges):
        return 0
    return 0 if by_square < evidence - CLOSE else 1 + int(by_square >= evidence)


_NULL = "no edges have a value in another unit than the others"
_SYMBOL = "n ln(RSS0/RSS1)"


def _evidence(law: LawFit, levels: EdgeLevels, j: int, moves: list[tuple[Flags, float]]) -> tuple[Array, float]:
    """Of each move of factor j, and of its square; a move of a term is one of the levels, in units of the column."""
    column = 1 + j
    shift = np.zeros((len(levels.b), len(moves)))
    for k, (edges, factor) in enumerate(moves):
        shift[levels.within :, k] = edges * np.log(factor) * levels.root * levels.back[column, column]
    others = np.delete(levels.A, column, axis=1)
    square = np.zeros(len(levels.b))
    square[levels.within :] = levels.root * (levels.x[:, j] - levels.x[:, j].mean()) ** 2
    return split_evidence(levels.b, others, levels.A[:, column], shift, len(levels.names), square)


def _response_blocks(law: LawFit, levels: EdgeLevels) -> list[Split]:
    """Edges that deviate from the law of the others by the ratio of two units of the response, all alike."""
    w, G, p = levels.within, len(levels.names), levels.A.shape[1]
    Q = orthonormal(levels.A)

    def left(b: Array) -> Array:
        return np.asarray(b - Q @ (Q.T @ b))

    first = left(levels.b)
    start = first[w:] / levels.root
    rss = float(first @ first)
    middle = (start.max() + start.min()) / 2
    found: list[Split] = []
    for ratio in ratios_of(law.response):
        for move in (np.log(ratio), -np.log(ratio)):
            edges = start < middle if move > 0 else start > middle
            shift = np.zeros(len(levels.b))
            for _ in range(STEPS):
                shift[w:] = edges * move * levels.root
                own = left(levels.b + shift)[w:] / levels.root - edges * move
                own -= np.median(own[~edges]) if not edges.all() else 0.0
                again = own * np.sign(move) < -abs(move) / 2
                if np.array_equal(again, edges):
                    break
                edges = again
            deviation = own + edges * move
            alike = np.abs(deviation).max() < ALIKE * abs(move)
            rest = left(levels.b + shift)
            evidence = (G - p) * float(np.log(rss / max(float(rest @ rest), 1e-300)))
            if 2 <= np.count_nonzero(edges) <= G / 2 and alike and evidence > BLOCK:
                found.append((evidence, law.response, edges, float(np.exp(move))))
    return found


def _suspect(levels: EdgeLevels, one: Split) -> Suspect:
    _, name, edges, factor = one
    named = tuple(levels.names[g] for g in np.flatnonzero(edges))
    cause = cause_of(CONDITIONS.get(name) or ratios_of(name), factor)
    if levels.by_edge:
        return Suspect(name, edges=named, factor=factor, cause=cause)
    return Suspect(name, lines=tuple(map(int, named)), factor=factor, cause=cause)


def cause_of(ratios: Mapping[float, str], factor: float) -> str:
    """The cause of a ratio of units, or of its inverse."""
    return next(cause for ratio, cause in ratios.items() if np.isclose(ratio, max(factor, 1 / factor)))


def _split_words(law: LawFit, levels: EdgeLevels, same: list[Split]) -> str:
    named = [levels.names[g] for g in np.flatnonzero(same[0][2])]
    parts = []
    for _, name, edges, factor in same:
        of_response = name == law.response
        x = levels.b[levels.within :] / levels.root if of_response else levels.x[:, law.factors.index(name)]
        x = np.exp(x[edges])
        ends = list(dict.fromkeys(format_plain(float(v), 3) for v in (x.min(), x.max())))
        mean = "a mean " if name == "t" or of_response else ""
        parts.append(
            f"{mean}{name} of {' to '.join(ends)} {law.units.get(name, '')} {_moved(factor)} "
            f"({cause_of(CONDITIONS.get(name) or ratios_of(name), factor)})"
        )
    one = len(named) == 1
    unit = (
        ("Edge " if one else "Edges ") + listed(named) if levels.by_edge else lines_of([*map(int, named)]).capitalize()
    )
    return (
        f"{unit}: with {', or '.join(parts)} the {law.response} agrees with that of the others; "
        f"check the unit of {'this' if one else 'these'}."
    )


def _moved(factor: float) -> str:
    return f"{'multiplied' if factor > 1 else 'divided'} by {max(factor, 1 / factor):.4g}"


@dataclass(frozen=True, slots=True)
class _Outlying:
    """Edges removed one after the other, and what they deviate by from the law of the rest."""

    edges: list[int]
    pvalue: float
    deviation: Array  # on the scale of the fit, shape (len(edges),)
    error: Array  # standard errors of the deviations
    theta: Array  # of the rest
    largest: float


def wrong_edges(law: LawFit, strata: Strata | NotAvailable) -> Check | NotAvailable | None:
    """Edges whose response disagrees with the law of the others.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> wrong_edges(law, split(law)).concern
    0
    """
    if not isinstance(strata, Strata):
        return strata if law.n_edges is not None and law.n_edges < law.nobs else None
    levels = edge_levels(law, strata)
    if isinstance(levels, NotAvailable):
        return levels
    if len(levels.names) < FEWEST or strata.df_between < SPARE:
        between = len(levels.names) - strata.df_between
        return NotAvailable(f"{len(levels.names)} edges for {between} parameters are too few to find a wrong one")
    found = _one_after_the_other(levels, tail_of_rows(strata.rest))
    largest = f"the largest studentized residual of a level is {found.largest:.1f} ({format_p(found.pvalue)})"
    kept = f"No edge deviates further than chance explains: {largest}."
    rejected = found.pvalue < SIGNIFICANT
    small = law.error == "multiplicative" and float(np.abs(found.deviation).max()) < SMALL
    suspects, words = _explained(law, levels, found) if rejected and not small else ((), kept)
    if rejected and small:
        names = listed([levels.names[g] for g in found.edges])
        words = f"Edge {names} deviates from the law of the others by less than {np.expm1(SMALL):.0%}: {largest}."
    return Check(
        null="no edge deviates from the law of the others further than edges do",
        statistic=found.largest,
        symbol="largest |t|",
        pvalue=found.pvalue,
        concern=int(rejected and not small),
        verdict=words,
        kept=kept,
        suspects=suspects,
    )


def _one_after_the_other(levels: EdgeLevels, tail: float) -> _Outlying:
    """Remove the edge with the largest externally studentized residual, then that of the others, and so on."""
    from scipy.special import stdtr

    G, w, p = len(levels.names), levels.within, levels.A.shape[1]
    left = np.ones(len(levels.b), dtype=bool)
    removed, pvalues, sizes = [], [], []
    for step in range(max(1, int(MOST * G))):
        Q = orthonormal(levels.A[left])
        e = levels.b[left] - Q @ (Q.T @ levels.b[left])
        h = np.einsum("ij,ij->i", Q, Q)
        df = G + w - step - p - 1
        rss = float(e @ e)
        own = np.maximum(1 - h, OWN)
        variance = np.maximum(rss - e**2 / own, 1e-300) / df
        t = np.where(1 - h > OWN, np.abs(e) / np.sqrt(variance * own), 0.0)[w:]
        g = int(np.argmax(t))
        sizes.append(float(t[g]))
        pvalues.append(float(min(1.0, 2 * (G - step) * stdtr(min(df, tail), -sizes[-1]))))
        removed.append(int(np.flatnonzero(left)[w + g]) - w)
        left[w + removed[-1]] = False
        if df - 1 < SPARE - 1:
            break
    also = [k for k, p_value in enumerate(pvalues) if p_value < ALSO]
    last = max(also) if also else int(np.argmin(pvalues))
    edges = removed[: last + 1]
    kept = np.ones(len(levels.b), dtype=bool)
    kept[[w + g for g in edges]] = False
    coefficients = np.linalg.lstsq(levels.A[kept], levels.b[kept], rcond=None)[0]
    rest = levels.b - levels.A @ coefficients
    s2 = float(rest[kept] @ rest[kept]) / max(G + w - len(edges) - p, 1)
    inverse = np.linalg.pinv(levels.A[kept].T @ levels.A[kept])
    at, root = [w + g for g in edges], levels.root[edges]
    error = np.sqrt(s2 * (1 + np.einsum("ij,jk,ik->i", levels.A[at], inverse, levels.A[at]))) / root
    return _Outlying(edges, min(pvalues), rest[at] / root, error, levels.back @ coefficients, max(sizes[: last + 1]))


def _explained(law: LawFit, levels: EdgeLevels, found: _Outlying) -> tuple[tuple[Suspect, ...], str]:
    """Suspects, the edges that one ratio of units explains together, and a sentence on each."""
    groups: dict[tuple[float, str], list[int]] = {}
    logs = law.error == "multiplicative"
    for k in range(len(found.edges)):
        ratios = ratios_of(law.response) if logs else {}
        groups.setdefault(explained(float(found.deviation[k]), ratios, NEAR * float(found.error[k])), []).append(k)
    suspects, words = [], []
    for (factor, cause), members in groups.items():
        names = tuple(levels.names[found.edges[k]] for k in members)
        suspects.append(Suspect(law.response, edges=names, factor=factor or None, cause=cause))
        head = f"Edge{'' if len(names) == 1 else 's'} {listed(names)}: the {law.response} is "
        if not logs:
            size = listed([f"{found.deviation[k]:+.3g}" for k in members])
            words.append(f"{head}{size} {law.units.get(law.response, '')} off the law of the other edges{_AND_NOW}")
            continue
        times = listed([f"{np.exp(found.deviation[k]):.2g}" for k in members])
        unit = f", as with {cause}: {law.response} {_moved(factor)}" if factor else ""
        other = "" if factor else _by_conditions(law, levels, found, members)
        words.append(f"{head}{times} times that of the law of the other edges{unit}{other}{_AND_NOW}")
    return tuple(suspects), " ".join(words)


_AND_NOW = "; check the record, or repeat the edge."


def _by_conditions(law: LawFit, levels: EdgeLevels, found: _Outlying, members: list[int]) -> str:
    """Ratios of units of a condition that would explain the edges as well: a single edge does not show which."""
    known = []
    for j, name in enumerate(law.factors):
        for ratio, cause in CONDITIONS.get(name, {}).items():
            for factor in (ratio, 1 / ratio):
                effect, x = found.theta[1 + j] * np.log(factor), levels.x[:, j]
                others = np.delete(x, found.edges)
                moved = x[[found.edges[k] for k in members]] + np.log(factor)
                inside = (others.min() - np.log(INSIDE) <= moved) & (moved <= others.max() + np.log(INSIDE))
                near = np.abs(found.deviation[members] - effect) <= NEAR * found.error[members]
                if inside.all() and near.all() and abs(effect) > 2 * NEAR * found.error[members].max():
                    known.append(f"{name} {_moved(factor)} ({cause})")
    return f" (it would agree with {', or with '.join(known)})" if known else ""
