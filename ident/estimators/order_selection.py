"""Selection of orders and delay: every (na, nb, nk) of a range by least squares, compared by information criteria.

``loss`` is rss / n in unit_y squared, n the number of rows common to all orders, k = na + nb. AIC, AICc and BIC are
-2 ln likelihood of normal residuals up to a constant; FPE and MDL have the unit of the loss.
Sources: Akaike 1969, 1974; Schwarz 1978; Hurvich & Tsai 1989; Rissanen 1978 in the form of Ljung 1999, section 16.4.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.display import Plottable
from ...core.errors import IdentError
from ...datasets.records.record import Record, join_records
from .bias_checks import causality_of
from .input_checks import check_length, check_orders, check_varies, not_centred, short_stretches
from .order_losses import left_out, losses, losses_of_triangle
from .regressors import Gram, Lags, LagTriangle, grams, r_of, triangle

if TYPE_CHECKING:
    import pandas as pd

Criterion = Literal["aic", "aicc", "bic", "fpe", "mdl", "left_out"]

# Largest number of cross-validation folds; more runs are combined, neighbour by neighbour.
PARTS = 10
# Differences of BIC above this are very strong evidence (Kass & Raftery 1995, doi 10.1080/01621459.1995.10476572).
DECISIVE = 10


@dataclass(frozen=True, slots=True, repr=False)
class OrderSearch(Plottable):
    """Losses and criteria of every order, and the selected order.

    Attributes
    ----------
    table : DataFrame
        One row per order: ``na``, ``nb``, ``nk``, ``loss`` (mean square one-step error, unit_y squared), ``aic``,
        ``aicc``, ``bic``, ``fpe``, ``mdl``, and with several runs ``left_out``: the leave-one-run-out mean square
        one-step error. All orders use the same rows.
    chosen : tuple of int
        na, nb, nk with the smallest ``criterion``.
    argument : str
        Reason for the selection, in two sentences.
    criterion : str
    n : int
        Rows.
    notes : tuple of str
        Reservations about the record.
    """

    table: "pd.DataFrame"
    chosen: tuple[int, int, int]
    argument: str
    criterion: str
    n: int
    notes: tuple[str, ...] = ()


def choose_order(
    rec: Record | Sequence[Record],
    na: Iterable[int] = range(11),
    nb: Iterable[int] = range(1, 11),
    nk: Iterable[int] = range(21),
    criterion: Criterion = "bic",
) -> OrderSearch:
    """Fit every order of a range by least squares and select the one with the smallest criterion.

    Parameters
    ----------
    rec : Record or sequence of Record
        Centred.
    na, nb, nk : iterable of int
        Candidate orders; all use the rows that the largest lag leaves, so that losses are comparable.
    criterion : str
        ``bic``, ``aic``, ``aicc``, ``fpe``, ``mdl``, or with several runs ``left_out``.

    Returns
    -------
    OrderSearch

    Raises
    ------
    IdentError
        An invalid range, too short a record, a constant input or output.

    Notes
    -----
    One-step errors are optimistic: confirm the order by simulating a record that was not fitted.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> u, e = rng.standard_normal((2, 400))
    >>> from scipy.signal import lfilter
    >>> y = lfilter([0, 0, 0.5], [1, -0.8], u) + lfilter([1], [1, -0.8], 0.1 * e)
    >>> choose_order(Record(u=u, y=y, sample_time=0.02), range(4), range(1, 4), range(4)).chosen
    (1, 1, 2)
    """
    import pandas as pd

    rec = rec if isinstance(rec, Record) else join_records(rec)
    ranges = _ranges(na, nb, nk)
    lags = Lags(max(ranges[0]), 0, max(ranges[2]) + max(ranges[1]) - 1)
    _check(rec, ranges, lags, criterion)
    parts = _parts(list(grams(rec, lags)))
    total = sum(parts[1:], parts[0])
    rss, held = _searched(rec, lags, total, parts, ranges)
    if criterion == "left_out" and held is None:
        raise IdentError(
            f"left_out needs two or more sufficiently long runs; {rec.source or 'this record'} has {len(parts)}. "
            "Select by 'bic'."
        )
    columns = _columns(rss, held, ranges, total.rows)
    swapped = causality_of(total, rec.input, rec.output)
    notes = [*not_centred(rec), *short_stretches(rec, lags.span), *([swapped] if swapped else [])]
    if len(columns["loss"]) < rss[:, :, [k - 1 for k in ranges[1]]].size:
        notes.append("orders whose coefficients are not identifiable are omitted from the table.")
    best = int(np.argmin(columns[criterion]))
    chosen = (int(columns["na"][best]), int(columns["nb"][best]), int(columns["nk"][best]))
    notes += _at_the_edge(chosen, ranges)
    return OrderSearch(
        table=pd.DataFrame(columns),
        chosen=chosen,
        argument=_argument(columns, best, criterion),
        criterion=criterion,
        n=total.rows,
        notes=tuple(notes),
    )


Ranges = tuple[list[int], list[int], list[int]]
CRITERIA = ("aic", "aicc", "bic", "fpe", "mdl")
Columns = dict[str, NDArray[Any]]


def _ranges(na: Iterable[int], nb: Iterable[int], nk: Iterable[int]) -> Ranges:
    ranges = (sorted(set(na)), sorted(set(nb)), sorted(set(nk)))
    for name, values in zip(("na", "nb", "nk"), ranges, strict=True):
        if not values:
            raise IdentError(f"{name} is empty: give at least one value to try.")
    check_orders(na=ranges[0][0], nb=ranges[1][0], nk=ranges[2][0])
    return ranges


def _check(rec: Record, ranges: Ranges, lags: Lags, criterion: str) -> None:
    if criterion not in (*CRITERIA, "left_out"):
        raise IdentError(f"criterion {criterion!r}: one of {', '.join([*CRITERIA, 'left_out'])}.")
    check_length(rec, lags.y, max(ranges[1]), max(ranges[2]))
    check_varies(rec)


def _parts(found: list[Gram]) -> list[Gram]:
    """Runs, combined to at most ``PARTS`` folds."""
    size = -(-len(found) // PARTS)
    return [sum(found[k + 1 : k + size], found[k]) for k in range(0, len(found), size)]


def _searched(rec: Record, lags: Lags, total: Gram, parts: list[Gram], ranges: Ranges) -> tuple[Array, Array | None]:
    """Sums of squares of every order and mean square errors of left-out runs, (nk, na, nb from 1)."""
    na, nb, nk = ranges[0], max(ranges[1]), ranges[2]
    spare = min((total.rows - part.rows for part in parts), default=0)
    several = len(parts) > 1 and spare > max(na) + nb
    rss = losses(total, na, nb, nk)
    if rss is not None:
        return rss, left_out(parts, na, nb, nk) if several else None
    if not several:
        return losses_of_triangle(triangle(rec, lags), na, nb, nk), None
    triangles = _part_triangles(rec, lags)
    whole = LagTriangle(r_of(np.concatenate([part.matrix for part in triangles])), total.rows, lags)
    return losses_of_triangle(whole, na, nb, nk), left_out(triangles, na, nb, nk)


def _part_triangles(rec: Record, lags: Lags) -> list[LagTriangle]:
    """QR triangles of the folds of `_parts`."""
    long = [s for s in rec.stretches if s.stop - s.start > lags.span]
    size = -(-len(long) // PARTS)
    return [triangle(rec, lags, long[k : k + size]) for k in range(0, len(long), size)]


def _columns(rss: Array, held: Array | None, ranges: Ranges, n: int) -> Columns:
    """Columns of the table, without orders that are not identifiable."""
    kept = [k - 1 for k in ranges[1]]
    na, nb, nk = (a.transpose(2, 0, 1).ravel() for a in np.meshgrid(*ranges, indexing="ij"))
    loss = (rss[:, :, kept] / n).ravel()
    k = (na + nb).astype(np.float64)
    finite = np.isfinite(loss)
    columns = {"na": na[finite], "nb": nb[finite], "nk": nk[finite], "loss": loss[finite]}
    columns |= criteria(loss[finite], k[finite], n)
    if held is not None:
        columns["left_out"] = held[:, :, kept].ravel()[finite]
    return columns


def _at_the_edge(chosen: tuple[int, int, int], ranges: Ranges) -> list[str]:
    """A note if the largest candidate is selected: least squares then models the noise rather than the plant."""
    edge = [
        f"{name} {value}"
        for name, value, tried in zip(("na", "nb", "nk"), chosen, ranges, strict=True)
        if len(tried) > 1 and value == tried[-1]
    ]
    if not edge:
        return []
    return [
        f"{', '.join(edge)} is the largest candidate. Sensor noise leads least squares to high orders and long delays: "
        "compare low orders by output error and simulation."
    ]


def _argument(columns: Columns, best: int, criterion: str) -> str:
    """Two sentences: reason for this order, and the limitation of the search."""
    label = {"left_out": "leave-one-run-out error"}.get(criterion, criterion.upper())
    values = columns[criterion]
    order = np.argsort(values, kind="stable")
    first = f"{_words(columns, best)} has the smallest {label} of {len(values)} orders"
    if len(order) > 1:
        gap = values[order[1]] - values[best]
        apart = f"{gap:.3g}" if criterion in ("aic", "aicc", "bic") else f"{100 * gap / values[best]:.2g} %"
        first += f", {apart} below {_words(columns, int(order[1]))}"
    if criterion in ("aic", "aicc", "bic"):
        near = int((values < values[best] + DECISIVE).sum()) - 1
        first += f" ({near} other{'s lie' if near != 1 else ' lies'} within {DECISIVE})"
    others = [name for name in (*CRITERIA, "left_out") if name in columns and name != criterion]
    choices = {name: int(np.argmin(columns[name])) for name in others}
    same = [name for name, at in choices.items() if at == best]
    differ = [f"{name} {_words(columns, at)}" for name, at in choices.items() if at != best]
    rest = f"; {', '.join(same)} agree{'s' * (len(same) == 1)}" if same else ""
    rest += f"; other criteria select {'; '.join(differ)}" if differ else ""
    return (
        f"{first}{rest}. One-step errors are optimistic: confirm the order by simulating a record that was not fitted."
    )


def _words(columns: Columns, at: int) -> str:
    return ", ".join(f"{name} {columns[name][at]}" for name in ("na", "nb", "nk"))


def criteria(loss: Array, k: Array, n: int) -> dict[str, Array]:
    """AIC, AICc, BIC, FPE (loss to expect on new data) and MDL by name, of losses with k coefficients and n rows."""
    aic = n * np.log(loss) + 2 * k
    return {
        "aic": aic,
        "aicc": aic + 2 * k * (k + 1) / np.maximum(n - k - 1, 0.5),
        "bic": n * np.log(loss) + k * np.log(n),
        "fpe": loss * (n + k) / (n - k),
        "mdl": loss * (1 + k * np.log(n) / n),
    }
