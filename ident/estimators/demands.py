"""What the iterative estimators ask of a record and of the orders, refused in words at the door."""

from collections.abc import Sequence
from operator import index

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError
from ...datasets.records.record import Record, join_records
from .refusals import check_moves

Array = NDArray[np.float64]
PER_COEFFICIENT = 3  # samples; below it the noise variance means nothing
SINGULAR = 1e10  # condition number of columns of length 1: the published plant without noise has 2e4


def demand(rec: Record | Sequence[Record], orders: dict[str, int], nk: int) -> Record:
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
            f"{len(rec)} samples, the longest stretch with {longest}: {in_words(orders)}, nk {nk} need {needed} "
            f"samples and a stretch of {reach + 1}. Lower the orders or record longer."
        )


def check_tellable(J: Array, orders: dict[str, int]) -> None:
    """Coefficients that the record tells apart; J (N, p) is the sensitivity of the prediction to them."""
    length = np.linalg.norm(J, axis=0)
    if not (np.isfinite(length) & (length > 0)).all():
        raise IdentError(
            f"{in_words(orders)}: some coefficients do not change the prediction (b is zero: nothing of the "
            "input shows in the output). Look at nk, and whether both columns are of one run."
        )
    condition = float(np.linalg.cond(np.linalg.qr(J / length, mode="r")))
    if condition > SINGULAR:
        raise IdentError(
            f"{in_words(orders)}: the record does not tell these coefficients apart (condition number {condition:.0e}, "
            f"limit {SINGULAR:.0e}): orders higher than the data allow, or an input of few frequencies. Lower the "
            "orders, or excite more frequencies."
        )


def in_words(orders: dict[str, int]) -> str:
    """Orders in words: "na 3, nb 3"."""
    return ", ".join(f"{name} {order}" for name, order in orders.items())
