"""Readings of wear and loads of one row, the true wear integrated out; then of an edge, its levels integrated out.

Given its reading, a row's wear is known but for ``rho = s_w^2 tau^2 / S``, with ``S = s_w^2 + tau^2`` and reliability
``l = s_w^2 / S``. With residuals r_w, r_k of the means, exponents b_k of the wear, ``g_k = b_k / s_k`` and
``d_k = (r_k - l b_k r_w) / s_k``, whose covariance is ``I + rho g g'``, a row has

    q = r_w^2 / S + sum d_k^2 - rho (g'd)^2 / (1 + rho g'g),    ln det = ln S + sum ln s_k^2 + ln(1 + rho g'g),

which holds at tau = 0 as well. The levels (u, v_1 .. v_K) that rows of an edge share come in by Woodbury's identity.

Sources: Fuller 1987, Measurement Error Models, section 2.2; Golub & Van Loan, Matrix Computations, section 2.1
(Woodbury's identity).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rows_alone(
    r: list[Array], wear: Array, gauge: Array, sds: list[Array], slopes: list[Array]
) -> tuple[Array, Array, list[Array], list[list[Array]]]:
    """Of each row: q, ln det, and score and information of the levels (u, v_1 .. v_K), information (m, 1 or n)."""
    S = wear + gauge
    told, rho = wear / S, wear * gauge / S
    g = [b / s for b, s in zip(slopes, sds, strict=True)]
    norm = sum((x * x for x in g), np.zeros_like(wear))
    d = [(y - told * b * r[0]) / s for y, b, s in zip(r[1:], slopes, sds, strict=True)]
    p = sum((x * z for x, z in zip(g, d, strict=True)), np.zeros(1))
    left = 1 + rho * norm
    kappa = rho / left
    q = sum((z * z for z in d), r[0] * r[0] / S - kappa * p * p)
    log_det = np.log(S * left) + 2 * sum((np.log(s) for s in sds), np.zeros(1))
    share = (1 - told) / left
    scores = [r[0] / S + share * p, *((z - kappa * x * p) / s for z, x, s in zip(d, g, sds, strict=True))]
    K = len(g)
    info = [[1 / S + (1 - told) * share * norm, *(share * x / s for x, s in zip(g, sds, strict=True))]]
    info += [[(float(k == j) - kappa * g[k] * g[j]) / (sds[k] * sds[j]) for j in range(k, K)] for k in range(K)]
    return q, log_det, scores, info


def by_edge(part: Array, starts: NDArray[np.intp], sizes: Array) -> Array:
    """Sum over the rows of each edge, (m, n) -> (m, G), or (m, 1) times the number of its rows."""
    return np.asarray(part * sizes if part.shape[1] == 1 else np.add.reduceat(part, starts, axis=1))


def with_levels(
    q: Array, log_det: Array, scores: list[Array], info: list[list[Array]], sds: list[Array]
) -> tuple[Array, Array]:
    """Woodbury: q less h'F (I + F I F)^-1 F h, ln det of that added, F the diagonal of ``sds``; by elimination."""
    D = len(sds)
    h = [s * x for s, x in zip(sds, scores, strict=True)]
    M = [[sds[i] * sds[i + j] * x + (1.0 if j == 0 else 0.0) for j, x in enumerate(info[i])] for i in range(D)]
    for i in range(D):  # M[i][j] is the element (i, i + j) of what is left of a positive definite matrix
        q = q - h[i] ** 2 / M[i][0]
        log_det = log_det + np.log(M[i][0])
        for j in range(1, D - i):
            f = M[i][j] / M[i][0]
            h[i + j] = h[i + j] - f * h[i]
            for k in range(j, D - i):
                M[i + j][k - j] = M[i + j][k - j] - f * M[i][k]
    return q, log_det
