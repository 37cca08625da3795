"""Power law of a stream of rows, fitted in one pass with memory for one chunk and the sums of the edges."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.arrays import Array, Ints
from ..core.errors import FitError, UsageError
from ..core.threads import one_thread
from ..datasets.vocabulary import ROLES
from .available import NotAvailable
from .chunks import Chunk, ChunkReader, RowFilter, UsableRows
from .edge_sums import EdgeSums, EquivalentRows, equivalent_rows, infer_from_sums
from .edges import NO_EDGES, EdgeInference
from .fitted_rows import LawSource
from .lawfit import LawFit
from .laws import LawForm
from .least_squares import LinearFit
from .rows import By, LeftOut, Rows, check_constant, check_enough, constant_reason, identifiable
from .triangle import Summary, equivalent_columns, least_squares


@one_thread
def streamed_power_law(
    chunks: Iterable[Chunk],
    response: str,
    factors: Sequence[str],
    *,
    edge: str | None = "edge",
    by: str | None = None,
    units: Mapping[str, str] | None = None,
    source: LawSource | None = None,
) -> LawFit:
    """Fit ``R = c0 prod X_j^b_j`` to rows that pass once, as ``power_law`` fits them in memory.

    Errors multiply: it is least squares of ln R. Coefficients, standard errors by edge and of rows, R2 and F are
    those of the fit in memory to about twelve digits, and the same to the last bit however the rows are cut into
    chunks. Memory holds one chunk, and for each edge about ``(number of factors + 1)^2`` numbers.

    Parameters
    ----------
    chunks : iterable of mapping or DataFrame
        Columns under their symbols (``V``, ``AW`` ...), any number of rows in each, every column in one unit
        throughout: headers and units are not read here. The first chunk decides whether there is an edge column.
    response : str
    factors : sequence of str
        Symbols, most important first. A constant, or an exact product of earlier ones, is left out by name.
    edge : str or None
        Column with the cutting edge of each row; rows of an edge may stand in any chunk.
        None: rows are taken as independent.
    by : str, optional
        Category whose level multiplies the law by exp(shift).
    units : mapping, optional
        Units of the columns where they are not the usual ones (m/min, mm/rev, mm, min, N, kW ...).
    source : LawSource, optional
        Data file, tool and work of the rows; their number is counted.

    Returns
    -------
    LawFit
        A law without ``rows``, with its sums by edge in ``sums``. Rows that miss a value or are not above zero are
        left out and counted; their ``lines`` are rows counted from 0, as those of ``runs_from_frame``. A table that
        repeats every measurement is fitted as it stands: one pass does not detect copies.

    Raises
    ------
    UsageError
        A chunk lacks a column, or holds text where a number must be.
    DataError
        Columns of a chunk differ in length, or a value is infinite.
    FitError
        Too few usable rows, or no factor left.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> table = datasets.read_runs(datasets.bundled("gc435_709m40")).data
    >>> law = streamed_power_law((table[i : i + 50] for i in range(0, len(table), 50)), "AW", ["V", "f", "d", "t"])
    >>> law.params.round(3).to_dict(), law.nobs, law.n_edges
    ({'c0': 0.009, 'V': 0.533, 'f': 0.167, 'd': 0.316, 't': 0.246}, 239, 24)
    """
    _check(chunks, response, factors)
    columns = [response, *factors]
    found = _Pass(ChunkReader(columns, edge, by), RowFilter(columns, by), EdgeSums(1 + len(factors)))
    for block in found.reader.blocks(chunks):
        found.add(found.filter.usable(block, found.reader.levels))
    return _fitted(found, response, tuple(factors), by, units or {}, source or LawSource())


def _check(chunks: object, response: str, factors: Sequence[str]) -> None:
    if isinstance(chunks, Mapping) or hasattr(chunks, "columns"):
        raise UsageError("chunks is one table; it is an iterable of tables: give [table], or fit it in memory.")
    if not factors:
        raise UsageError(f"{response}: no factor is named; a law needs at least one, for instance V.")
    if response in factors:
        raise UsageError(f"{response} is the response and cannot be its own factor; leave it out of the factors.")


@dataclass(slots=True)
class _Pass:
    """Sums and ranges of the rows so far."""

    reader: ChunkReader
    filter: RowFilter
    sums: EdgeSums
    n: int = 0
    low: Array = field(default_factory=lambda: np.zeros(0))
    high: Array = field(default_factory=lambda: np.zeros(0))
    first: Array = field(default_factory=lambda: np.zeros(0))

    def add(self, rows: UsableRows) -> None:
        """Add the usable rows of a block."""
        if not len(rows):
            return
        if not self.n:
            self.low, self.high, self.first = rows.low, rows.high, np.array([column[0] for column in rows.columns])
        self.low, self.high = np.minimum(self.low, rows.low), np.maximum(self.high, rows.high)
        self.n += len(rows)
        self.sums.add((*rows.columns[1:], rows.columns[0]), rows.edge, rows.level, logarithms=True)


def _fitted(
    found: _Pass,
    response: str,
    factors: tuple[str, ...],
    by: str | None,
    units: Mapping[str, str],
    source: LawSource,
) -> LawFit:
    levels, category = _levels(found, by)
    rows = found.sums.summary(levels) if found.n else None
    keep, left_out = ([*range(len(factors))], ()) if rows is None else _identifiable(found, factors, rows)
    law = LawForm("power", response, tuple(factors[j] for j in keep))
    check_enough(law, _ends_of_rows(found, category, len(law.names)), left_out)
    assert rows is not None  # noqa: S101  no rows are never enough
    rows = rows.of(keep)
    fit = least_squares(rows)
    check_constant(law, fit.params, np.append(1.0, rows.mean[:-1])[None])
    by_edge = None if found.reader.edge is None else _equivalent(found, keep, levels)
    unedged = LawFit(
        formula=law, error="multiplicative", theta=fit.params, cov_theta=fit.cov_params if fit.df_resid else None,
        nobs=fit.nobs, rss=fit.rss, tss=fit.tss,
        domain={factors[j]: (float(found.low[j + 1]), float(found.high[j + 1])) for j in keep},
        response_range=(float(found.low[0]), float(found.high[0])),
        units={name: units.get(name, _usual_unit(name)) for name in (response, *law.factors)},
        by=category, left_out=left_out, dropped=found.filter.dropped(),
        n_edges=None if by_edge is None else len(by_edge.names),
        source=replace(source, n_rows=found.reader.rows), sums=None if by_edge is None else found.sums,
    )  # fmt: skip
    return replace(unedged, edges=_by_edge(found, fit, by_edge, keep, unedged.theta_names))


def _equivalent(found: _Pass, keep: Sequence[int], levels: Ints) -> EquivalentRows:
    sums = found.sums.trimmed()
    names, order = found.reader.edges.in_order(np.unique(sums.groups()[0]))
    return equivalent_rows(sums, keep, names, order, levels)


def _by_edge(
    found: _Pass, fit: LinearFit, rows: EquivalentRows | None, keep: Sequence[int], names: tuple[str, ...]
) -> EdgeInference | NotAvailable:
    if rows is None:
        return NO_EDGES
    largest = np.ones(len(fit.params))
    logs = np.abs(np.log([found.low, found.high])).max(axis=0)
    largest[1 : 1 + len(keep)] = logs[1:][list(keep)]
    return infer_from_sums(fit, rows, largest, names)


def _levels(found: _Pass, by: str | None) -> tuple[Ints, By | None]:
    """Numbers of the levels, the reference first, and the category; one level where there is none."""
    if by is None or not found.n:
        return np.array([0]), None
    names, order = found.reader.levels.in_order(np.unique(found.sums.groups()[1]))
    if len(names) < 2:
        raise FitError(
            f"by={by!r}: the usable rows hold one level only ({', '.join(names)}); a shift needs two. Fit without by."
        )
    return order, By(by, names[0], names[1:])


def _identifiable(found: _Pass, factors: tuple[str, ...], rows: Summary) -> tuple[list[int], tuple[LeftOut, ...]]:
    """Positions of the factors that can be fitted and the others with the reason, as `identifiable` does for rows."""
    low, high, first = np.log(found.low[1:]), np.log(found.high[1:]), np.log(found.first[1:])
    still = {
        j: reason
        for j in range(len(factors))
        if found.n > 1 and (reason := constant_reason(first[j], low[j], high[j], found.n, log=True))
    }
    moving = [j for j in range(len(factors)) if j not in still]
    few = equivalent_columns(rows.of(moving))
    k = len(moving)
    keep, others = identifiable([factors[j] for j in moving], few[:, :k], few[:, k:-1], logs=True)
    why = {item.factor: item for item in others}
    why |= {factors[j]: LeftOut(factors[j], reason) for j, reason in still.items()}
    return [moving[i] for i in keep], tuple(why[name] for name in factors if name in why)


def _ends_of_rows(found: _Pass, category: By | None, names: int) -> Rows:
    """Rows as ``check_enough`` needs them: their number, and the ends of the response."""
    n = found.n
    if n and found.low[0] < found.high[0]:
        enough = names + (len(category.levels) if category else 0) + 1
        y = np.linspace(found.low[0], found.high[0], min(n, enough))
    else:
        y = np.broadcast_to(found.low[0] if n else np.nan, (n,))
    shifts = np.empty((0, len(category.levels) if category else 0))
    none = np.empty(0, dtype=np.intp)
    return Rows(np.empty((0, 0)), y, shifts, none, None, category, found.filter.dropped(), 1)


def _usual_unit(name: str) -> str:
    return ROLES[name].unit if name in ROLES else ""
