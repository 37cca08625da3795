"""Checks of records and orders before an estimation, and notes on records that bias it."""

from collections.abc import Sequence
from operator import index

import numpy as np

from ...core.arrays import Array, Flags
from ...core.errors import IdentError
from ...datasets.records.record import Record, join_records
from .regressors import r_of

# A column whose component orthogonal to the columns before it is shorter than this share is dependent: an exact copy
# leaves about 1e-16, the tenth lag of a slow chirp 1e-10.
DEPENDENT = 1e-13
PER_COEFFICIENT = 3  # samples; below it the noise variance is meaningless
PROPORTIONAL = 1e-5  # of the largest value: the digits of a file; noise of a sensor is larger
SINGULAR = 1e10  # condition number of columns of length 1: the published plant without noise has 2e4


def check_orders(**orders: int) -> None:
    """Raise IdentError unless the named orders are whole: nb at least 1, the others at least 0."""
    for name, order in orders.items():
        least = 1 if name == "nb" else 0
        try:
            low = index(order) < least or isinstance(order, bool)
        except TypeError:
            low = True
        if low:
            raise IdentError(f"{name} {order!r}: a whole number, {least} or more.")


def check_length(rec: Record, na: int, nb: int, nk: int) -> int:
    """Number of equations of an order on a record; IdentError unless it exceeds the number of coefficients."""
    span = max(na, nk + nb - 1)
    lengths = [s.stop - s.start for s in rec.stretches]
    rows = sum(max(int(n) - span, 0) for n in lengths)
    if rows <= na + nb:
        need = span + na + nb + 1
        several = f", the longest of {len(lengths)} segments with {max(lengths)}" if len(lengths) > 1 else ""
        raise IdentError(
            f"{len(rec)} samples{several}: na {na}, nb {nb}, nk {nk} leave {rows} equations for {na + nb} coefficients "
            f"and need a segment of {need} samples. Lower the orders or record longer."
        )
    return rows


def check_varies(rec: Record) -> None:
    """Raise IdentError where input or output is constant."""
    for what, name, values, remedy in (
        ("input", rec.input, rec.u, "Excite the machine (a chirp, steps) and record again"),
        ("output", rec.output, rec.y, "Check the sensor and the column that was read"),
    ):
        if not _varies(rec, values):
            assert rec.offsets is not None  # noqa: S101  set by the record
            level = values[0] + float(rec.offsets[0, 0 if what == "input" else 1])
            raise IdentError(
                f"{what} {name} does not vary ({level:g} throughout): the dynamics are not identifiable. {remedy}."
            )


def check_not_proportional(rec: Record) -> None:
    """Raise IdentError where the output is a multiple of the input in every sample, but for rounding."""
    u, y = (np.concatenate([x[s] - x[s].mean() for s in rec.stretches]) for x in (rec.u, rec.y))
    gain = float(u @ y) / float(u @ u)
    if float(np.abs(y - gain * u).max()) > PROPORTIONAL * float(np.abs(y).max()):
        return
    same = "the same signal" if abs(gain - 1) < PROPORTIONAL else f"one signal, {rec.output} = {gain:.6g} {rec.input},"
    raise IdentError(
        f"input {rec.input} and output {rec.output} are {same} in all {len(rec)} samples: that is no response of a "
        "machine. Check which columns were read (--input, --output), and that the sensor is recorded."
    )


def _varies(rec: Record, values: Array) -> bool:
    """Whether any segment varies; the first samples are checked first, to spare the pass over the rest."""
    return any((v[:1000] != v[0]).any() or (v != v[0]).any() for v in (values[s] for s in rec.stretches))


def not_centred(rec: Record) -> tuple[str, ...]:
    """Notes on signals whose mean was not removed and is not small; a subset of the samples is checked first."""
    assert rec.offsets is not None  # noqa: S101  set by the record
    if rec.offsets.any():
        return ()
    return tuple(
        f"mean of {name} is {values.mean():.4g} {unit}".rstrip()
        + ", which biases a model without a constant: fit rec.centred()."
        for name, values, unit in ((rec.input, rec.u, rec.unit_u), (rec.output, rec.y, rec.unit_y))
        if all(_large_mean(v) for v in (values[:: max(1, len(values) // 512)], values))
    )


def _large_mean(values: Array) -> bool:
    squared_mean = (values.sum() / len(values)) ** 2
    return bool(squared_mean > 0.1 * (values @ values / len(values) - squared_mean))


def short_stretches(rec: Record, span: int) -> tuple[str, ...]:
    """A note on segments that are too short for a single equation."""
    lengths = [s.stop - s.start for s in rec.stretches]
    short = [n for n in lengths if n <= span]
    if not short:
        return ()
    return (
        f"{len(short)} of {len(lengths)} segments are no longer than the largest lag, {span}, and are not used "
        f"({sum(short)} of {len(rec)} samples).",
    )


def dependent(r: Array) -> Flags:
    """Whether each column of a triangle (p, p) is linearly dependent on those before it."""
    length = np.sqrt((r * r).sum(axis=0))
    return np.asarray(np.abs(np.diag(r)) <= DEPENDENT * length)


def identifiable_orders(r: Array, na: int, nb: int) -> tuple[int, int]:
    """Largest orders up to na, nb whose regressors (columns of r: na, then nb) are linearly independent."""
    orders = [(i, j) for i in range(na + 1) for j in range(1, nb + 1)]
    for i, j in sorted(orders, key=lambda o: (-sum(o), abs(o[0] - o[1]))):
        columns = [*range(i), *range(na, na + j)]
        if not dependent(r_of(r[:, columns])).any():
            return i, j
    return 0, 0


def collinear_error(na: int, nb: int, nk: int, identifiable: tuple[int, int]) -> IdentError:
    """Error for an order whose regressors are collinear, with the largest identifiable orders."""
    i, j = identifiable
    return IdentError(
        f"na {na}, nb {nb}, nk {nk}: coefficients not identifiable (regressors are collinear to rounding: an input of "
        f"few frequencies, or a record without noise and an order too high). Use na {i}, nb {j}, or excite more "
        "frequencies."
    )


def checked_record(rec: Record | Sequence[Record], orders: dict[str, int], nk: int) -> Record:
    """The record (several are joined); IdentError for invalid orders, too few samples, a constant input or output."""
    check_orders(**orders, nk=nk)
    rec = rec if isinstance(rec, Record) else join_records(rec)
    check_varies(rec)
    reach = nk + max(orders.values())
    needed = PER_COEFFICIENT * sum(orders.values()) + reach
    longest = max(s.stop - s.start for s in rec.stretches)
    if len(rec) < needed or longest <= reach:
        raise IdentError(
            f"{len(rec)} samples, the longest segment with {longest}: {orders_text(orders)}, nk {nk} need {needed} "
            f"samples and a segment of {reach + 1}. Lower the orders or record longer."
        )
    return rec


def check_identifiable(J: Array, orders: dict[str, int]) -> None:
    """Raise IdentError unless the sensitivities J (N, p) of the prediction to the coefficients are independent."""
    length = np.linalg.norm(J, axis=0)
    if not (np.isfinite(length) & (length > 0)).all():
        raise IdentError(
            f"{orders_text(orders)}: some coefficients do not affect the prediction (b is zero: the output does not "
            "respond to the input). Check nk, and that both columns are of one run."
        )
    condition = float(np.linalg.cond(np.linalg.qr(J / length, mode="r")))
    if condition > SINGULAR:
        raise IdentError(
            f"{orders_text(orders)}: coefficients not identifiable from this record (condition number {condition:.0e}, "
            f"limit {SINGULAR:.0e}): the orders are too high, or the input excites too few frequencies. Lower the "
            "orders, or excite more frequencies."
        )


def orders_text(orders: dict[str, int]) -> str:
    """Orders as text: "na 3, nb 3"."""
    return ", ".join(f"{name} {order}" for name, order in orders.items())
