"""Power laws of many small pairs by batched linear algebra, equal to a loop of ``power_law``.

Decisions (a factor that does not vary, copies of rows, an edge that alone identifies a parameter) are made for all
pairs at once; a pair near any of their thresholds is fitted singly by ``power_law``.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints, Texts
from ...core.threads import one_thread
from ..edges import NO_EDGES, too_few_edges
from ..laws import LARGEST_LOG
from .batched_sums import LARGEST_VIF, blocks_of, fitted
from .many_laws import Estimates, ManyLaws, enter, no_estimates, single_law
from .pair_rows import MARGIN, PairRows, Screening, screen, sorted_rows

# Residuals of a block come from columns about their means, those of power_law from y - Z theta: below this share of
# |ln y| they differ.
NEARLY_EXACT = 1e-5


def many_power_laws(
    frame: pd.DataFrame | Mapping[str, object],
    response: str,
    factors: Sequence[str],
    *,
    pair: str | Sequence[str],
    edge: str | None = None,
) -> ManyLaws:
    """Fit ``R = c0 prod X_j^b_j`` to each pair in a table of many, as ``power_law`` would one after the other.

    Parameters
    ----------
    frame : DataFrame or mapping of str to array
        Rows of all pairs: columns under the symbols of the laws, in the same units for all pairs.
    response : str
    factors : sequence of str
        Symbols, most important first; a pair whose rows do not identify one leaves it out.
    pair : str or sequence of str
        Column or columns that name the pair, for instance ``["tool", "work"]``.
    edge : str, optional
        Column with the cutting edge of each row; standard errors, t and p are then by edge.
        None: rows are taken as independent.

    Returns
    -------
    ManyLaws
        A row a pair, in the order in which the rows name them; a pair without a law has its reason.

    Raises
    ------
    UsageError
        A column is not there or holds text. No pair raises: it has a reason instead.

    Notes
    -----
    Errors multiply (least squares of ln R). Standard errors by edge are those of ``edge_inference`` (CR3); its model
    with a random level of each edge is not fitted here.

    Examples
    --------
    >>> import numpy as np
    >>> from fitmodels import fit
    >>> V = np.array([50.0, 80, 125, 200, 50, 80, 125, 200])
    >>> rows = {"tool": ["A"] * 4 + ["B"] * 4, "V": V, "AW": V**0.5 * [1, 1.1, 1, 1.1, 1.2, 1, 1, 1.2]}
    >>> fit.many_power_laws(rows, "AW", ["V"], pair="tool").params["V"].round(3).to_dict()
    {'A': 0.542, 'B': 0.5}
    """
    rows = sorted_rows(frame, response, factors, pair, edge)
    laws = ManyLaws(response, tuple(factors), rows.names, no_estimates(len(rows.names), 1 + len(factors)), rows)
    _fill(laws, rows)
    return laws


@one_thread
def _fill(laws: ManyLaws, rows: PairRows) -> None:
    into = laws.estimates
    into.least[:], into.most[:] = rows.ends()
    if len(laws):
        found = screen(rows)
        for pattern, pairs in _by_pattern(found):
            for block in blocks_of(rows.counts[pairs]):
                _fit_block(into, rows, found, pairs[block], pattern)
        into.dropped[:] = np.bincount(rows.number, minlength=len(laws)) - rows.counts
    order = np.argsort(rows.number, kind="stable")
    bounds = np.searchsorted(rows.number[order], np.arange(len(laws) + 1))
    for i in np.flatnonzero(~into.stacked):
        law = single_law(rows, order[bounds[i] : bounds[i + 1]], laws.response, laws.factors)
        if isinstance(law, str):
            into.reason[i] = law
        else:
            enter(into, int(i), law, laws.names)


def _by_pattern(found: Screening) -> Iterator[tuple[Flags, Ints]]:
    """Pairs that a batched fit takes, by the factors that vary in them."""
    pairs = np.flatnonzero(found.plain)
    patterns, which = np.unique(~found.constant[pairs], axis=0, return_inverse=True)
    for i, pattern in enumerate(patterns):
        yield pattern, pairs[which.ravel() == i]


def _fit_block(into: Estimates, rows: PairRows, found: Screening, pairs: Ints, pattern: Flags) -> None:
    """Fit pairs of one pattern and enter those that are clear of every threshold; the others are fitted singly."""
    counts = rows.counts[pairs]
    W, edge_starts, pair_starts = _part(rows, pairs, pattern)
    fits = fitted(W, edge_starts, pair_starts)
    row_se = np.sqrt((fits.rss / (counts - len(W)))[:, None] * fits.row_variance)
    sure = (fits.vif < LARGEST_VIF) & (fits.rss > counts * (NEARLY_EXACT * found.largest[pairs]) ** 2)
    sure &= np.abs(fits.theta[:, 0]) < LARGEST_LOG / MARGIN
    n_edges, reason = _edge_reasons(rows, found, pairs, pattern)
    can = sure & (reason == "")
    sure &= fits.safe | ~can
    se = np.where(can[:, None], np.sqrt(fits.edge_variance), row_se)
    done, at = pairs[sure], np.append(True, pattern)
    for array, values in ((into.theta, fits.theta), (into.se, se), (into.row_se, row_se)):
        array[np.ix_(done, at)] = values[sure]
    into.rss[done], into.tss[done] = fits.rss[sure], fits.tss[sure]
    into.nobs[done], into.n_edges[done], into.stacked[done] = counts[sure], n_edges[sure], True
    into.by_edge[done], into.edge_reason[done] = can[sure], reason[sure]
    _name_left_out(into, found, done, pattern, list(rows.raw))


def _part(rows: PairRows, pairs: Ints, pattern: Flags) -> tuple[Array, Ints, Ints]:
    """Columns of some pairs, shape (q, N), where each edge begins in them, and each pair among the edges."""
    begin, counts = rows.bounds[pairs], rows.counts[pairs]
    names, here = np.flatnonzero(np.append(pattern, True)), _ranges(begin, counts)
    whole = here[-1] - here[0] == len(here) - 1
    part = slice(here[0], here[-1] + 1) if whole else here
    W = rows.logs[:, part] if whole and len(names) == len(rows.logs) else np.stack([rows.logs[j, part] for j in names])
    first = np.cumsum(counts) - counts
    if rows.edge_starts is None:
        return W, first, np.arange(len(pairs))
    bounds = rows.edge_bounds
    n_edges = np.diff(bounds)[pairs]
    number = _ranges(bounds[pairs], n_edges)
    return W, rows.edge_starts[number] + np.repeat(first - begin, n_edges), np.cumsum(n_edges) - n_edges


def _ranges(begin: Ints, lengths: Ints) -> Ints:
    """``begin[i], begin[i] + 1 ...`` for each i, ``lengths[i]`` of them.

    >>> _ranges(np.array([5, 0]), np.array([2, 3])).tolist()
    [5, 6, 0, 1, 2]
    """
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(lengths.sum()) + np.repeat(begin - before, lengths))


def _edge_reasons(rows: PairRows, found: Screening, pairs: Ints, pattern: Flags) -> tuple[Ints, Texts]:
    """Edges of each pair, and why there is no inference by edge, as in ``edge_inference``."""
    reason = np.full(len(pairs), "", dtype=object)
    if rows.edge_starts is None:
        reason[:] = NO_EDGES.reason
        return np.zeros(len(pairs), dtype=np.intp), reason
    G, counts = np.diff(rows.edge_bounds)[pairs], rows.counts[pairs]
    between = 1 + (~found.within[pairs][:, pattern]).sum(axis=1)
    for i in np.flatnonzero((between + 1 > G) | (counts == G)):
        reason[i] = too_few_edges(int(counts[i]), int(G[i]), int(between[i]))
    return G, reason


def _name_left_out(into: Estimates, found: Screening, pairs: Ints, pattern: Flags, names: list[str]) -> None:
    """Enter the constant factors that the laws of these pairs leave out, as ``identifiable`` does."""
    if pattern.all():
        return
    out = np.flatnonzero(~pattern)
    for i in pairs:
        values = np.exp(found.level[i, out])
        texts = (f"{names[j]} constant ({v:.6g} in all {into.nobs[i]} rows)" for j, v in zip(out, values, strict=True))
        into.left_out[i] = "; ".join(texts)
