"""What a record must allow before orders are fitted to it, and what is told where it does not.

What the iterative estimators ask of a record and of the orders, refused in words at the door.
"""

from collections.abc import Sequence
from operator import index

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError
from ...datasets.records.record import Record, join_records
from .regressors import r_of

Array = NDArray[np.float64]

# A column whose part outside the columns before it is shorter than this share of it is none of its own: an exact copy
# keeps about 1e-16, the tenth lag of a slow chirp 1e-10.
DEPENDENT = 1e-13


def check_orders(na: int, nb: int, nk: int) -> None:
    """Orders that an ARX model can have: na >= 0, nb >= 1, nk >= 0, whole."""
    for name, value, least in (("na", na, 0), ("nb", nb, 1), ("nk", nk, 0)):
        try:
            low = index(value) < least or isinstance(value, bool)
        except TypeError:
            low = True
        if low:
            raise IdentError(f"{name} {value!r}: a whole number, {least} or more.")


def check_length(rec: Record, na: int, nb: int, nk: int) -> int:
    """Rows that an order has in a record; more than it has coefficients, or IdentError."""
    span = max(na, nk + nb - 1)
    lengths = [s.stop - s.start for s in rec.stretches]
    rows = sum(max(int(n) - span, 0) for n in lengths)
    if rows <= na + nb:
        need = span + na + nb + 1
        several = f", the longest stretch of {len(lengths)} with {max(lengths)}" if len(lengths) > 1 else ""
        raise IdentError(
            f"{len(rec)} samples{several}: na {na}, nb {nb}, nk {nk} leave {rows} equations for {na + nb} coefficients "
            f"and need a stretch of {need} samples. Lower the orders or record longer."
        )
    return rows


def check_moves(rec: Record) -> None:
    """Input and output that vary; a constant one tells nothing of the dynamics."""
    for what, name, values, cure in (
        ("input", rec.input, rec.u, "Excite the machine (a chirp, steps) and record again"),
        ("output", rec.output, rec.y, "Look at the sensor and at the column that was read"),
    ):
        if not _moves(rec, values):
            raise IdentError(
                f"{what} {name} does not vary ({values[0]:g} throughout): nothing of the dynamics shows. {cure}."
            )


def _moves(rec: Record, values: Array) -> bool:
    """Whether any stretch varies; most show it in their first samples, which spares the pass over the rest."""
    return any((v[:1000] != v[0]).any() or (v != v[0]).any() for v in (values[s] for s in rec.stretches))


def not_centred(rec: Record) -> tuple[str, ...]:
    """A note where nothing was taken off and a mean stands out: an even choice of samples first, then all of them."""
    assert rec.offsets is not None  # noqa: S101  set by the record
    if rec.offsets.any():
        return ()
    notes = []
    for name, values, unit in ((rec.input, rec.u, rec.unit_u), (rec.output, rec.y, rec.unit_y)):
        if all(_stands_out(v) for v in (values[:: max(1, len(values) // 512)], values)):
            notes.append(
                f"mean of {name} is {values.mean():.4g} {unit}".rstrip()
                + ", which a model without a constant bends to meet: fit rec.centred()."
            )
    return tuple(notes)


def _stands_out(values: Array) -> bool:
    squared_mean = (values.sum() / len(values)) ** 2
    return bool(squared_mean > 0.1 * (values @ values / len(values) - squared_mean))


def short_stretches(rec: Record, span: int) -> tuple[str, ...]:
    """A note where stretches are too short to give a row."""
    lengths = [s.stop - s.start for s in rec.stretches]
    short = [n for n in lengths if n <= span]
    if not short:
        return ()
    return (
        f"{len(short)} of {len(lengths)} stretches are no longer than the largest lag, {span}, and take no part "
        f"({sum(short)} of {len(rec)} samples).",
    )


def dependent(r: Array) -> NDArray[np.bool_]:
    """Which columns of a triangle (p, p) add nothing to those before them."""
    length = np.sqrt((r * r).sum(axis=0))
    return np.asarray(np.abs(np.diag(r)) <= DEPENDENT * length)


def identifiable_orders(r: Array, na: int, nb: int) -> tuple[int, int]:
    """Orders up to na, nb with most coefficients whose regressors (columns of r: na, then nb) are independent."""
    orders = [(i, j) for i in range(na + 1) for j in range(1, nb + 1)]
    for i, j in sorted(orders, key=lambda o: (-sum(o), abs(o[0] - o[1]))):
        columns = [*range(i), *range(na, na + j)]
        if not dependent(r_of(r[:, columns])).any():
            return i, j
    return 0, 0


def collinear_error(na: int, nb: int, nk: int, told: tuple[int, int]) -> IdentError:
    """What is said where the data do not tell the coefficients of an order apart."""
    i, j = told
    return IdentError(
        f"na {na}, nb {nb}, nk {nk}: the data do not tell these coefficients apart (regressors are collinear to "
        f"rounding: an input of few frequencies, or a record without noise and an order too high). na {i}, nb {j} can "
        "still be told; or excite more frequencies."
    )


PER_COEFFICIENT = 3  # samples; below it the noise variance means nothing
SINGULAR = 1e10  # condition number of columns of length 1: the published plant without noise has 2e4


def checked_record(rec: Record | Sequence[Record], orders: dict[str, int], nk: int) -> Record:
    """The record (several joined), or IdentError: no orders, too few samples, an input or output that stands still."""
    for name, order in {**orders, "nk": nk}.items():
        least = 1 if name == "nb" else 0
        try:
            low = index(order) < least or isinstance(order, bool)
        except TypeError:
            low = True
        if low:
            raise IdentError(f"{name} {order!r}: a whole number, {least} or more.")
    rec = rec if isinstance(rec, Record) else join_records(rec)
    check_moves(rec)
    check_samples(rec, orders, nk)
    return rec


def check_samples(rec: Record, orders: dict[str, int], nk: int) -> None:
    """Enough samples for the coefficients, one stretch at least longer than the reach of the model."""
    reach = nk + max(orders.values())
    needed = PER_COEFFICIENT * sum(orders.values()) + reach
    longest = max(s.stop - s.start for s in rec.stretches)
    if len(rec) < needed or longest <= reach:
        raise IdentError(
            f"{len(rec)} samples, the longest stretch with {longest}: {orders_text(orders)}, nk {nk} need {needed} "
            f"samples and a stretch of {reach + 1}. Lower the orders or record longer."
        )


def check_identifiable(J: Array, orders: dict[str, int]) -> None:
    """Coefficients that the record tells apart; J (N, p) is the sensitivity of the prediction to them."""
    length = np.linalg.norm(J, axis=0)
    if not (np.isfinite(length) & (length > 0)).all():
        raise IdentError(
            f"{orders_text(orders)}: some coefficients do not change the prediction (b is zero: nothing of the "
            "input shows in the output). Look at nk, and whether both columns are of one run."
        )
    condition = float(np.linalg.cond(np.linalg.qr(J / length, mode="r")))
    if condition > SINGULAR:
        raise IdentError(
            f"{orders_text(orders)}: coefficients not identifiable from this record (condition number {condition:.0e}, "
            f"limit {SINGULAR:.0e}): the orders are too high, or the input excites too few frequencies. Lower the "
            "orders, or excite more frequencies."
        )


def orders_text(orders: dict[str, int]) -> str:
    """Orders in words: "na 3, nb 3"."""
    return ", ".join(f"{name} {order}" for name, order in orders.items())
