"""Edges that are probably wrong: a condition in another unit, and a response unlike that of the others.

Both use the regression of the levels of the edges, with what varies within them fitted within them. Edges with a
condition in another unit are found by the split test (``datasets.plausibility.unit_shifts``), for by their leverage
they leave small residuals; single edges by the externally studentized residual of their level, the largest first, each
without those before it.

Sources: Rosner 1983, Technometrics 25, 165 (several outliers, one after the other); Belsley, Kuh & Welsch 1980,
Regression Diagnostics, chapter 2 (externally studentized residuals).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags
from ...core.rounding import format_plain, listed
from ...datasets import Runs
from ...datasets.plausibility.unit_shifts import (
    CLOSE,
    EVIDENCE,
    INSIDE,
    RATIOS,
    TIME_RATIOS,
    explained,
    isolated,
    minorities,
    planned,
    ratios_of,
    single_evidence,
    split_evidence,
)
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, Check, Suspect, format_p, lines_of
from .missing_factors import blocks_of
from .robust_fit import tail_of_rows
from .strata import EdgeLevels, Strata, edge_levels, is_computed, of_one_level, orthonormal
from .wrong_rows import NEAR, measured

FEWEST, SPARE = 8, 4  # edges, and edges beyond the parameters that they determine
MOST = 1 / 6  # of the edges
SMALL = 0.3  # of the logarithm of the response: a smaller deviation of an edge hardly moves a law
ALSO = 0.0025  # p below which a further edge is wrong: the strictest step of Holm's procedure over 20 tests
BLOCK = 4 * EVIDENCE  # of edges whose response is in another unit, which are chosen by their residuals
ALIKE = 0.35  # of the logarithm of the ratio: edges in two groups that far apart deviate less from either
STEPS = 10
LEAST_POWER, LARGEST_WEAR = 0.1, 30.0  # exponent of wear, and its error, that may explain an edge of a force or power
OWN = 0.02  # share of its own level that an edge must not determine alone
TIME_INSIDE = 3.0  # as INSIDE, of times, whose range differs between edges that are stopped at a criterion

CONDITIONS: Mapping[str, Mapping[float, str]] = {"t": TIME_RATIOS, **RATIOS}
Split = tuple[float, str, Flags, float]  # evidence, factor of the law, edges, what it is multiplied by


def mixed_units(law: LawFit, strata: Strata | NotAvailable, runs: Runs | None = None) -> Check | NotAvailable | None:
    """Edges whose speed, feed, depth, time or response is in another unit than that of the others.

    Conditions by the split test, the response by edges that all deviate by the ratio of two units. Quantities that were
    computed in ``runs`` are in no unit of their own.

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
    if len(levels.names) < (least := max(FEWEST, len(law.theta) + SPARE)):
        return NotAvailable(f"fewer than {least} edges or settings")
    asked = [name for name in _conditions_of(law) if not is_computed(name, runs)]
    of_response = [] if is_computed(measured(law), runs) else [law.response]
    tried, by_square = _splits(law, levels, asked, _response_blocks(law, levels) if of_response else [])
    most = max(tried, key=lambda one: one[0], default=None)
    kept = f"No edges agree better with {' or '.join((*asked, *of_response))} in another unit"
    if most is None or most[0] < EVIDENCE:
        statistic = most[0] if most else 0.0
        return Check(null=_NULL, statistic=statistic, symbol=_SYMBOL, verdict=f"{kept}.", kept=f"{kept}.")
    same = [one for one in tried if one[0] > most[0] - CLOSE and np.array_equal(one[2], most[2])]
    same.sort(key=lambda one: -one[0])
    doubt, other = _other_cause(law, levels, most, by_square.get(most[1], 0.0))
    words = _split_words(law, levels, same)
    return Check(
        null=_NULL,
        statistic=most[0],
        symbol=_SYMBOL,
        concern=2 - doubt,
        verdict=(words, f"{words} {other} explains the difference as well.", f"{kept}: {other} explains more.")[doubt],
        kept=f"{kept}.",
        suspects=(_suspect(levels, same[0]),) if doubt == 0 else (),
    )


def _conditions_of(law: LawFit) -> list[str]:
    """Factors whose unit the response shows: forces hardly depend on speed and time."""
    response = measured(law)
    load = response in ROLES and ROLES[response].kind == "load" and response != "P"
    return [name for name in law.factors if name in CONDITIONS and not (load and name in ("V", "t"))]


def _splits(
    law: LawFit, levels: EdgeLevels, asked: list[str], tried: list[Split]
) -> tuple[list[Split], dict[str, float]]:
    """All edges that another unit may concern, those of the response first, and the evidence of squares."""
    by_square = dict[str, float]()
    for name in asked:
        j = law.factors.index(name)
        moves = minorities(levels.x[:, j], CONDITIONS[name], TIME_INSIDE if name == "t" else INSIDE)
        if moves:
            evidence, by_square[name] = _evidence(levels, j, moves)
            tried += [(float(e), name, *move) for e, move in zip(evidence, moves, strict=True)]
    return tried, by_square


def _other_cause(law: LawFit, levels: EdgeLevels, one: Split, by_square: float) -> tuple[int, str]:
    """0 where other causes explain edges clearly worse than another unit, 1 as well, 2 better; and the best other one.

    They are a curved law and a single edge whose response is wrong; a single edge never shows which of its values is.
    """
    evidence, name, edges, _ = one
    if name == law.response:
        squares = {other: _evidence(levels, j, [])[1] for j, other in enumerate(law.factors)}
        bent = max(squares, key=lambda other: squares[other])
        best = squares[bent]
        return (0 if best < evidence - CLOSE else 1 if best < evidence else 2), f"The square of ln {bent}"
    j = law.factors.index(name)
    if isolated(levels.x[:, j], edges):
        return 0, ""
    fixed = [k for k, other in enumerate(law.factors) if k != j and other in ROLES and ROLES[other].kind == "condition"]
    if planned(levels.x[:, j], levels.x[:, fixed], edges):
        return 2, f"An effect of {name} that changes between its levels"
    by_edge, g = single_evidence(levels.b, levels.A, slice(levels.within, None))
    unit = "edge" if levels.by_edge else "line"
    others = [
        (by_square, f"The square of ln {name}", 2),
        (by_edge, f"A wrong {law.response} of {unit} {levels.names[g]}", 2 if np.count_nonzero(edges) > 1 else 1),
    ]
    best, words, most = max(others)
    return (0 if best < evidence - CLOSE else 1 if best < evidence else most), words


_NULL = "no edges have a value in another unit than the others"
_SYMBOL = "n ln(RSS0/RSS1)"


def _evidence(levels: EdgeLevels, j: int, moves: list[tuple[Flags, float]]) -> tuple[Array, float]:
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
    G, p = len(levels.names), levels.A.shape[1]
    Q = orthonormal(levels.A)
    first = levels.b - Q @ (Q.T @ levels.b)
    found: list[Split] = []
    for move in (sign * np.log(ratio) for ratio in ratios_of(measured(law)) for sign in (1, -1)):
        edges, deviation, rss = _moved_block(levels, Q, first, move)
        evidence = (G - p) * float(np.log(float(first @ first) / max(rss, 1e-300)))
        alike = np.abs(deviation).max() < ALIKE * abs(move)
        if alike and 2 <= np.count_nonzero(edges) <= G / 2 and evidence > BLOCK:
            found.append((evidence, law.response, edges, float(np.exp(move))))
    return found


def _moved_block(levels: EdgeLevels, Q: Array, first: Array, move: float) -> tuple[Flags, Array, float]:
    """Edges nearer to the law once they are moved, what all deviate by then, and the sum of squares."""
    w = levels.within
    start = first[w:] / levels.root
    edges = start * np.sign(move) < np.sign(move) * (start.max() + start.min()) / 2
    for _ in range(STEPS):
        shift = np.append(np.zeros(w), edges * move * levels.root)
        left = first + shift - Q @ (Q.T @ shift)
        own = left[w:] / levels.root - edges * move
        own = own - (np.median(own[~edges]) if not edges.all() else 0.0)
        again = own * np.sign(move) < -abs(move) / 2
        if np.array_equal(again, edges):
            break
        edges = again
    return edges, own + edges * move, float(left @ left)


def _suspect(levels: EdgeLevels, one: Split) -> Suspect:
    _, name, edges, factor = one
    named = tuple(levels.names[g] for g in np.flatnonzero(edges))
    cause = cause_of(CONDITIONS.get(name) or ratios_of(name.split("/")[0]), factor)
    if levels.by_edge:
        return Suspect(name, edges=named, factor=factor, cause=cause)
    return Suspect(name, lines=tuple(map(int, named)), factor=factor, cause=cause)


def cause_of(ratios: Mapping[float, str], factor: float) -> str:
    """The cause of a ratio of units, or of its inverse."""
    return next(cause for ratio, cause in ratios.items() if np.isclose(ratio, max(factor, 1 / factor)))


def _split_words(law: LawFit, levels: EdgeLevels, same: list[Split]) -> str:
    named = [levels.names[g] for g in np.flatnonzero(same[0][2])]
    parts = ", or ".join(_moved_values(law, levels, one) for one in same)
    these, s = ("this", "") if len(named) == 1 else ("these", "s")
    unit = f"Edge{s} {listed(named)}" if levels.by_edge else lines_of([*map(int, named)]).capitalize()
    return f"{unit}: with {parts} the {law.response} agrees with that of the others; check the unit of {these}."


def _moved_values(law: LawFit, levels: EdgeLevels, one: Split) -> str:
    """The values, what they are multiplied by, and the cause."""
    _, name, edges, factor = one
    level = levels.b[levels.within :] / levels.root
    x = np.exp((level if name == law.response else levels.x[:, law.factors.index(name)])[edges])
    ends = dict.fromkeys(format_plain(float(v), 3) for v in (x.min(), x.max()))
    mean = "a mean " if name in ("t", law.response) else ""
    cause = cause_of(CONDITIONS.get(name) or ratios_of(name.split("/")[0]), factor)
    return f"{mean}{name} of {' to '.join(ends)} {law.units.get(name, '')} {_moved(factor)} ({cause})"


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


def outlying_edges(law: LawFit, strata: Strata | NotAvailable, runs: Runs | None = None) -> Check | NotAvailable | None:
    """Edges whose response disagrees with the law of the others.

    Quantities that were computed in ``runs`` are in no unit of their own, and no ratio explains them.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.checks.strata import split
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> outlying_edges(law, split(law)).concern
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
    suspects, words = _explained(law, levels, found, kept, runs)
    unknown = [edge for one in suspects if not one.factor for edge in one.edges]
    if len(suspects) == 1 and (level := of_one_level(law, blocks_of(law, runs), unknown)):
        suspects, words = (), words.replace(_AND_NOW, f"; {level}.")
    return Check(
        null="no edge deviates from the law of the others further than edges do",
        statistic=found.largest,
        symbol="largest |t|",
        pvalue=found.pvalue,
        concern=int(bool(suspects or unknown)),
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
    at, root = [w + g for g in edges], levels.root[edges]
    kept = ~np.isin(np.arange(len(levels.b)), at)
    coefficients = np.linalg.lstsq(levels.A[kept], levels.b[kept], rcond=None)[0]
    rest = levels.b - levels.A @ coefficients
    s2 = float(rest[kept] @ rest[kept]) / max(G + w - len(edges) - p, 1)
    inverse = np.linalg.pinv(levels.A[kept].T @ levels.A[kept])
    error = np.sqrt(s2 * (1 + np.einsum("ij,jk,ik->i", levels.A[at], inverse, levels.A[at]))) / root
    return _Outlying(edges, min(pvalues), rest[at] / root, error, levels.back @ coefficients, max(sizes[: last + 1]))


def _explained(
    law: LawFit, levels: EdgeLevels, found: _Outlying, kept: str, runs: Runs | None
) -> tuple[tuple[Suspect, ...], str]:
    """Suspects, the edges that one ratio of units explains together, and a sentence on each."""
    if found.pvalue >= SIGNIFICANT:
        return (), kept
    logs = law.error == "multiplicative"
    if logs and float(np.abs(found.deviation).max()) < SMALL:
        return (), (
            f"{_edges_of(levels, found, range(len(found.edges)))}: off the law of the others by less than "
            f"{np.expm1(SMALL):.0%}, which hardly moves it ({format_p(found.pvalue)})."
        )
    groups: dict[tuple[float, str], list[int]] = {}
    for k in range(len(found.edges)):
        ratios = ratios_of(measured(law)) if logs and not is_computed(measured(law), runs) else {}
        groups.setdefault(explained(float(found.deviation[k]), ratios, NEAR * float(found.error[k])), []).append(k)
    suspects = tuple(
        Suspect(law.response, tuple(levels.names[found.edges[k]] for k in members), factor=factor or None, cause=cause)
        for (factor, cause), members in groups.items()
    )
    words = [_edge_words(law, levels, found, *one, members) for one, members in groups.items()]
    return suspects, " ".join(words)


def _edges_of(levels: EdgeLevels, found: _Outlying, members: Sequence[int]) -> str:
    names = [levels.names[found.edges[k]] for k in members]
    return f"Edge{'' if len(names) == 1 else 's'} {listed(names)}"


def _edge_words(
    law: LawFit, levels: EdgeLevels, found: _Outlying, factor: float, cause: str, members: list[int]
) -> str:
    head = f"{_edges_of(levels, found, members)}: the {law.response} is "
    if law.error != "multiplicative":
        size = listed([f"{found.deviation[k]:+.3g}" for k in members])
        return f"{head}{size} {law.units.get(law.response, '')} off the law of the other edges{_AND_NOW}"
    times = listed([f"{np.exp(found.deviation[k]):.2g}" for k in members])
    if factor:
        other = f", as with {cause}: {law.response} {_moved(factor)}"
    else:
        other = _by_conditions(law, levels, found, members)
    return f"{head}{times} times that of the law of the other edges{other}{_AND_NOW}"


_AND_NOW = "; check the record, or repeat the edge."


def _by_conditions(law: LawFit, levels: EdgeLevels, found: _Outlying, members: list[int]) -> str:
    """Ratios of units of a condition that would explain the edges as well: a single edge does not show which."""
    if law.form != "power":
        return ""
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
    known += _by_wear(law, found, members)
    return f" (it would agree with {', or with '.join(known)})" if known else ""


def _by_wear(law: LawFit, found: _Outlying, members: list[int]) -> list[str]:
    """The number that would correct the wear of the edges, where it is a factor of the law."""
    wear = [j for j, name in enumerate(law.factors) if name in ROLES and ROLES[name].kind == "wear"]
    known = []
    for j in wear:
        power = float(found.theta[1 + j])
        factors = np.exp(found.deviation[members] / power) if abs(power) > LEAST_POWER else np.array([np.inf])
        if (np.abs(np.log(factors)) < np.log(LARGEST_WEAR)).all():
            known.append(f"{law.factors[j]} times {listed([f'{v:.2g}' for v in factors])}")
    return known
