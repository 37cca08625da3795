"""D-optimal additions to a design: greedy choice, then exchange until no swap gains.

Adding rows to Z multiplies the determinant of Z'Z by ``det(I + A M A')`` with ``M = (Z'Z)^-1`` and A the added rows;
by the matrix determinant lemma one row z gains ``1 + z'Mz``, and swapping row a for row z, with M of both old and
added rows, ``(1 + z'Mz)(1 - a'Ma) + (z'Ma)^2``.

Source: Fedorov 1972, Theory of Optimal Experiments, section 3.2; Cook & Nachtsheim 1980, Technometrics 22, 315.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Chosen = NDArray[np.intp]

GAIN = 1e-9  # a swap that gains less is rounding, and would go round in circles
STARTS = 8  # the greedy one, and random ones: exchange stops at a local best


def d_optimal(M: Array, candidates: Array, n: int, most: int, rng: np.random.Generator) -> tuple[Chosen, float]:
    """Choose n rows of ``candidates`` that make the determinant of the information largest.

    Parameters
    ----------
    M : ndarray, shape (p, p)
        ``(Z'Z)^-1`` of the design so far.
    candidates : ndarray, shape (c, p)
    n, most : int
        How many to choose, and how often each candidate at most (``n <= most * c``).
    rng : Generator
        Of the random starts.

    Returns
    -------
    chosen : ndarray of int, shape (n,), ascending
    gain : float
        What the determinant of Z'Z is multiplied by.

    Examples
    --------
    >>> points = np.array([[1, -1.0], [1, 0], [1, 1]])
    >>> chosen, gain = d_optimal(np.diag([0.25, 0.5]), points, 2, 2, np.random.default_rng(1))
    >>> chosen.tolist(), round(gain, 3)
    ([0, 2], 3.0)
    """
    starts = [_greedy(M, candidates, n, most)]
    places = np.repeat(np.arange(len(candidates)), min(most, n))
    starts += [rng.choice(places, size=n, replace=False) for _ in range(STARTS - 1)]
    best, largest = starts[0], -1.0
    for start in starts:
        chosen = _exchanged(M, candidates, start, most)
        gain = determinant_gain(M, candidates[chosen])
        if gain > largest * (1 + GAIN):
            best, largest = np.sort(chosen), gain
    return best, largest


def determinant_gain(M: Array, added: Array) -> float:
    """What the determinant of the information is multiplied by when rows (n, p) are added."""
    return float(np.linalg.det(np.eye(len(M)) + M @ added.T @ added))


def _greedy(M: Array, candidates: Array, n: int, most: int) -> Chosen:
    chosen: list[int] = []
    count = np.zeros(len(candidates), dtype=np.intp)
    for _ in range(n):
        d = np.einsum("ij,jk,ik->i", candidates, M, candidates)
        best = int(np.argmax(np.where(count < most, d, -1.0)))
        chosen.append(best)
        count[best] += 1
        M = _with_row(M, candidates[best])
    return np.array(chosen, dtype=np.intp)


def _with_row(M: Array, z: Array) -> Array:
    """(Z'Z + zz')^-1, by Sherman and Morrison."""
    v = M @ z
    return np.asarray(M - np.outer(v, v) / (1 + z @ v))


def _exchanged(M: Array, candidates: Array, start: Chosen, most: int) -> Chosen:
    """Swap one chosen row for one candidate, the best swap of all, until none gains."""
    chosen = start.copy()
    for _ in range(50 * len(chosen)):
        rows = candidates[chosen]
        inverse = np.linalg.inv(np.linalg.inv(M) + rows.T @ rows)
        cross = candidates @ inverse @ rows.T
        d = np.einsum("ij,jk,ik->i", candidates, inverse, candidates)
        ratio = np.outer(1 + d, 1 - d[chosen]) + cross**2
        ratio[np.bincount(chosen, minlength=len(candidates)) >= most] = 0.0
        into, out = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        if ratio[into, out] <= 1 + GAIN:
            break
        chosen[out] = into
    return chosen
