"""Standard errors where residuals hang together and no law of their correlation is known: leave out block by block.

The estimate is made again without each block of samples; what it moves by is its covariance (Kunsch 1989,
doi 10.1214/aos/1176347265, section 2; blocks do not overlap here). For least squares the estimate without block i is

    theta_i = theta - (J'J - Ji'Ji)^-1 Ji' e_i

so that nothing is fitted twice. Blocks as long as the residuals hang together make this honest, also where the error is
a fault of the model (friction that is not quite Coulomb's) and not noise. A machine that repeats its movement is the
trap: blocks in step with it all hold the same error, and the standard error comes out several times too small. So
several lengths of block are taken, and the widest answer.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
COUNTS = (12, 16, 20, 24)  # of blocks: no movement is in step with all of them


def jackknife(J: Array, e: Array, blocks: Sequence[NDArray[np.intp]]) -> Array:
    """Covariance (p, p) of a least-squares estimate with regressors J (N, p) and residuals e (N,).

    Examples
    --------
    >>> e = np.array([1.0, -1.0, 0.5, -0.5])
    >>> jackknife(np.ones((4, 1)), e, [np.array([k]) for k in range(4)]).round(6).item()  # s^2 / n
    0.208333
    """
    scale = np.linalg.norm(J, axis=0)
    J = J / scale
    G = J.T @ J
    moved = np.array([np.linalg.solve(G - J[i].T @ J[i], J[i].T @ e[i]) for i in blocks])
    moved -= moved.mean(axis=0)
    m = len(blocks)
    return np.asarray((m - 1) / m * (moved.T @ moved) / np.outer(scale, scale), dtype=np.float64)


def widest(J: Array, e: Array, time: Array, counts: Sequence[int] = COUNTS) -> Array:
    """Covariance (p, p) with each coefficient's largest standard error over several numbers of blocks.

    Parameters
    ----------
    J, e : ndarray, shape (N, p) and (N,)
    time : ndarray, shape (N,)
        Rising; blocks are equal parts of it.
    counts : sequence of int
        Correlations are those of the last.
    """
    place = (time - time[0]) / ((time[-1] - time[0]) * (1 + 1e-9))
    covs = []
    for count in counts:
        block = np.floor(count * place).astype(int)
        covs.append(jackknife(J, e, [np.flatnonzero(block == b) for b in np.unique(block)]))
    variance = np.array([np.diag(cov) for cov in covs])
    up = np.sqrt(variance.max(axis=0) / np.maximum(variance[-1], np.finfo(float).tiny))
    return covs[-1] * np.outer(up, up)
