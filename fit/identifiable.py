"""Which factors the rows can tell apart: constants and exact products of others are left out by name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.display import Displayable
from ..core.errors import FitError
from .linear import linear

Array = NDArray[np.float64]

# R2 of a factor on the others above 1 - 1e-8 is a computed column, not a measured one: a wear printed to
# six decimals from a power law of V and f still leaves a condition number of 3e5, so a rank test misses it.
EXACT = 1e-8
# Rows that are looked at first where there are more.
SOME = 10_000
# Relative spread below which a column is the same number written down n times.
CONSTANT = 1e-9


@dataclass(frozen=True, slots=True, repr=False)
class LeftOut(Displayable):
    """A factor that the law does without, and why."""

    factor: str
    reason: str


def identifiable(
    names: Sequence[str], terms: Array, shifts: Array, *, logs: bool
) -> tuple[list[int], tuple[LeftOut, ...]]:
    """Positions of the factors that can be fitted, in their order, and the others with the reason.

    Parameters
    ----------
    names : the k factors, most important first: of two that say the same the later is left out
    terms : ndarray, shape (n, k), the factors as they enter the law (their logarithms in a power law)
    shifts : ndarray, shape (n, s), indicator columns of a category
    logs : whether ``terms`` are logarithms; it only words the reason

    Examples
    --------
    >>> keep, out = identifiable(["V", "d"], np.log([[50, 2], [80, 2], [99, 2.0]]), np.empty((3, 0)), logs=True)
    >>> keep, out[0].reason
    ([0], 'constant (2 in all 3 rows)')
    """
    keep: list[int] = []
    out: list[LeftOut] = []
    for j, name in enumerate(names):
        column = terms[:, j]
        level = float(column[0]) if len(column) else 0.0
        if len(column) > 1 and np.all(np.abs(column - level) <= CONSTANT * max(1.0, abs(level))):
            value = np.exp(level) if logs else level
            out.append(LeftOut(name, f"constant ({value:.6g} in all {len(column)} rows)"))
        elif reason := _dependence(column, terms[:, keep], shifts, [names[i] for i in keep], logs):
            out.append(LeftOut(name, reason))
        else:
            keep.append(j)
    return keep, tuple(out)


def _dependence(column: Array, others: Array, shifts: Array, names: list[str], logs: bool) -> str | None:
    """Why ``column`` adds nothing to ``others``, or None where it does."""
    n = len(column)
    p = 1 + others.shape[1] + shifts.shape[1]
    if p < 2 or n <= p:  # too few rows to tell: the fit itself counts them
        return None
    if n > SOME and _told_by_some(column, others, shifts):
        return None
    fit = linear(np.hstack([np.ones((n, 1)), shifts, others]), column)
    if fit.rss > EXACT * fit.tss:
        return None
    slopes = fit.params[1 + shifts.shape[1] :]
    used = [(name, b) for name, b in zip(names, slopes, strict=True) if abs(b) > 1e-6]
    if not used:
        return "it changes only with the category"
    if logs:
        law = " ".join(f"{name}^{b:.4g}" for name, b in used)
        return f"an exact product of others ({law}): these rows cannot tell its effect from theirs"
    law = " + ".join(f"{b:.4g} {name}" for name, b in used)
    return f"an exact sum of others ({law}): these rows cannot tell its effect from theirs"


def _told_by_some(column: Array, others: Array, shifts: Array) -> bool:
    """Whether an even choice of rows already shows that ``column`` is no function of the others.

    What these rows leave unexplained, all rows leave too, so a yes is as sure as from all of them.
    """
    few = slice(None, None, -(-len(column) // SOME))
    ones = np.ones((len(column[few]), 1))
    try:
        fit = linear(np.hstack([ones, shifts[few], others[few]]), column[few])
    except FitError:  # a term that does not change within these rows
        return False
    return bool(fit.rss > EXACT * np.sum((column - column.mean()) ** 2))
