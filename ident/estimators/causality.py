"""Which way a record runs: whether the past of u tells of y, or the past of y of u."""

import numpy as np
from numpy.typing import NDArray

from ...datasets.records.record import Record
from .gram import Gram, Lags, gram

# Lags of each signal, and a share of a signal below which nothing is left to tell: six digits are more than a sensor's.
DEPTH = 6
FLOOR = 1e-6


def causality(rec: Record) -> str | None:
    """A note where input and output seem swapped; None where they do not.

    The variance of y one step ahead from its own past is compared with that from the past of both, and the same the
    other way about (Granger 1969, doi 10.2307/1912791). A loop closed through the machine tells both ways.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> y = 0.5 * np.concatenate([[0.0], u[:-1]])
    >>> causality(Record(u=u, y=y, sample_time=0.02)) is None
    True
    >>> str(causality(Record(u=y, y=u, sample_time=0.02)))[:32]
    'input and output may be swapped:'
    """
    depth = min(DEPTH, min(s.stop - s.start for s in rec.stretches) // 4)
    return causality_of(gram(rec, Lags(depth, 0, depth)), rec.input, rec.output) if depth else None


def causality_of(total: Gram, name_u: str, name_y: str) -> str | None:
    """The same from products that hold lags 0 to 1 or more of both."""
    lags = total.lags
    depth = min(DEPTH, lags.y, lags.last)
    y, u = np.arange(depth + 1), lags.y + 1 + np.arange(depth + 1)
    forward = _told(total, y, u)
    backward = _told(total, u, y)
    # twice the logarithm of a likelihood ratio is chi-squared with ``depth`` degrees of freedom where nothing is told
    if total.rows * backward < 10 * depth or backward < 2 * forward:
        return None
    return (
        f"input and output may be swapped: the past of {name_y} takes {1 - np.exp(-backward):.0%} off the one-step "
        f"variance of {name_u}, the past of {name_u} {1 - np.exp(-forward):.0%} off that of {name_y}. Look at the "
        "columns; a loop closed through the machine shows so too."
    )


def _told(total: Gram, own: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    """Logarithm of the variance of own[0] from its own lags over that from lags of both."""
    alone = _left(total, [*own[1:]], own[0])
    both = _left(total, [*own[1:], *other[1:]], own[0])
    return float(np.log(max(alone, FLOOR) / max(both, FLOOR)))


def _left(total: Gram, columns: list[np.intp], target: np.intp) -> float:
    """Share of the sum of squares of one column that others leave; the ridge stands for rounding in the products."""
    chosen = np.array([*columns, target])
    g = total.matrix[chosen[:, None], chosen]
    length = np.sqrt(np.maximum(np.diag(g), np.finfo(np.float64).tiny))
    g = g / np.outer(length, length)
    theta = np.linalg.solve(g[:-1, :-1] + 1e-11 * np.eye(len(g) - 1), g[:-1, -1])
    return float(1 - g[:-1, -1] @ theta)
