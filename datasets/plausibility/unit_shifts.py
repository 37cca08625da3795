"""Ratios of units that are mistaken for each other, and the split test of a condition that has them both.

Some edges whose feed stands in inches among edges in mm leave small residuals: their leverage bends the exponent
towards them. So minorities beyond a gap of the condition are moved by each ratio, and the regressions are compared.
"""

import math
from collections.abc import Mapping

import numpy as np

from ...core.arrays import Array, Flags
from ..vocabulary import ROLES

RATIOS: Mapping[str, Mapping[float, str]] = {
    "V": {3.280839895: "sfm and m/min", 60.0: "m/s and m/min", 10.0: "a decimal mark"},
    "f": {25.4: "inch and mm", 10.0: "a decimal mark"},
    "d": {25.4: "inch and mm", 10.0: "cm and mm, or a decimal mark"},
}
TIME_RATIOS: Mapping[float, str] = {60.0: "seconds and minutes", 3600.0: "seconds and hours"}
DECIMAL: Mapping[float, str] = {10.0: "a decimal mark", 100.0: "a decimal mark"}
OF_KIND: Mapping[str, Mapping[float, str]] = {
    "wear": {25.4: "inch and mm", 1000.0: "um and mm", **DECIMAL},
    "load": {4.4482216: "lbf and N", 9.80665: "kgf and N", 1000.0: "N and kN", **DECIMAL},
    "surface": {39.3700787: "uin and um", 1000.0: "um and mm", **DECIMAL},
    "time": TIME_RATIOS,
}
OF_RESPONSE: Mapping[str, Mapping[float, str]] = {
    "P": {1.3410221: "hp and kW", 1000.0: "W and kW", **DECIMAL},
    "M": {1.3558179: "lbf ft and N m", 8.8507458: "lbf in and N m", 1000.0: "N m and kN m", **DECIMAL},
    "I": {1000.0: "mA and A", **DECIMAL},
}
GAP = 1.3  # ratio between the shifted edges and the others
INSIDE = 1.5  # shifted edges land among the others, or this ratio beside them
MINORITY = 1 / 3  # of the edges
EVIDENCE = 6.6  # n ln(RSS0/RSS1): 0 of 300 sound tests reach it, with 24 edges of 6 rows
ISOLATED = 1.0
ALONE, TINY = 0.02, 1e-9  # share of its own value that a row must not determine; of a column that others contain
SEVERAL, MISSING = 2, 0.25  # edges of a planned level at least, and the share of its settings that may be missing
PLACES = 6  # of the logarithm, to which levels are equal
KGF = 9.80665  # N
CLOSE = 4.6  # with less than this, 2 ln(10), between two ratios the data do not decide


def ratios_of(symbol: str) -> Mapping[float, str]:
    """Ratios of units of a quantity, each with its cause.

    >>> ratios_of("AW")[25.4], ratios_of("t")[60.0], ratios_of("P")[1000.0]
    ('inch and mm', 'seconds and minutes', 'W and kW')
    """
    known = RATIOS.get(symbol) or OF_RESPONSE.get(symbol)
    return known or OF_KIND.get(ROLES[symbol].kind if symbol in ROLES else "", DECIMAL)


def minorities(x: Array, ratios: Mapping[float, str], inside: float = INSIDE) -> list[tuple[Flags, float]]:
    """Minorities beyond a gap of a condition, in logarithms, that a ratio brings among the others, with the factor.

    >>> found = minorities(np.log([0.004, 0.1, 0.1, 0.12, 0.11, 0.1]), {25.4: "inch and mm"})
    >>> [(edges.tolist().index(True), factor) for edges, factor in found]
    [(0, 25.4)]
    """
    levels = np.sort(x)
    found = []
    for cut in np.flatnonzero(levels[1:] - levels[:-1] > np.log(GAP)):
        share = (cut + 1) / len(x)
        if min(share, 1 - share) > MINORITY:
            continue
        lower = share < 0.5
        side, rest = (levels[: cut + 1], levels[cut + 1 :]) if lower else (levels[cut + 1 :], levels[: cut + 1])
        for ratio in ratios:
            factor = ratio if lower else 1 / ratio
            move, near = np.log(factor), np.log(inside)
            if side[0] + move >= rest[0] - near and side[-1] + move <= rest[-1] + near:
                found.append((x <= levels[cut] if lower else x > levels[cut], factor))
    return found


def isolated(x: Array, edges: Flags) -> bool:
    """Whether edges lie further from the others than the range of these: designs have no such gap.

    >>> isolated(np.log([0.004, 0.1, 0.2, 0.4]), np.array([True, False, False, False]))
    True
    """
    side, rest = x[edges], x[~edges]
    return bool(max(rest.min() - side.max(), side.min() - rest.max()) > ISOLATED * (rest.max() - rest.min()))


def planned(x: Array, others: Array, edges: Flags) -> bool:
    """Whether edges are whole levels of a plan that is crossed: other levels have the same settings of the others.

    ``others``, shape (n, k), are the other conditions. The response then shows that the effect of x changes between
    levels, and nothing else: a bent law explains whole levels as well as another unit.

    >>> x, f = np.repeat(np.log([15.0, 30, 45, 70]), 3), np.tile([[0.1], [0.2], [0.3]], (4, 1))
    >>> planned(x, f, x < 3), planned(x[1:], np.flip(f[1:] + x[1:, None]), x[1:] < 3)
    (True, False)
    """
    settings = np.unique(others.round(PLACES), axis=0, return_inverse=True)[1].ravel()
    level = np.unique(x.round(PLACES), return_inverse=True)[1].ravel()
    count = np.zeros((level.max() + 1, settings.max() + 1), dtype=int)
    np.add.at(count, (level, settings), 1)
    moved, rest = np.unique(level[edges]), np.unique(level[~edges])
    several = bool((count[moved].sum(axis=1) >= SEVERAL).all())
    other = np.abs(count[rest] - count[moved][:, None]).sum(axis=2) <= MISSING * count[rest].sum(axis=1)
    return several and bool(other.any(axis=1).all())


def split_evidence(y: Array, others: Array, x: Array, moves: Array, count: int, square: Array) -> tuple[Array, float]:
    """The statistic n ln(RSS0/RSS1) of moving column x, shape (n,), by each column of ``moves``, shape (n, k).

    ``others`` are the further columns of the regression of y; ``count`` is the n of the statistic. The second figure is
    the statistic of a further column, ``square``, that of the squares of x: a curved law resembles edges in another
    unit.
    """
    q = np.linalg.qr(others)[0]
    curved = np.linalg.qr(np.column_stack([x, others, square]))[0]
    bent = y - curved @ (curved.T @ y)
    moved = np.column_stack([x, x[:, None] + moves])
    moved -= q @ (q.T @ moved)
    left = y - q @ (q.T @ y)
    size = np.einsum("ij,ij->j", moved, moved)
    explained = np.where(size > 1e-12, (left @ moved) ** 2 / np.maximum(size, 1e-300), 0.0)
    rss = np.maximum(float(left @ left) - explained, 0.0)
    first = np.log(max(rss[0], 1e-300))
    by_square = float(count * (first - np.log(max(float(bent @ bent), 1e-300))))
    return np.asarray(count * (first - np.log(np.maximum(rss[1:], 1e-300)))), by_square


def single_evidence(y: Array, columns: Array, among: slice) -> tuple[float, int]:
    """The largest n ln(RSS0/RSS1) of leaving out one row among some of the regression of y, and which; n are those.

    >>> columns = np.column_stack([np.ones(6), np.arange(6.0)])
    >>> single_evidence(np.array([0, 1, 2, 9, 4, 5.1]), columns, slice(None))[1]
    3
    """
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    q = u[:, s > TINY * s[0]]
    left = y - q @ (q.T @ y)
    own = (1 - np.einsum("ij,ij->i", q, q))[among]
    rss = float(left @ left)
    without = np.where(own > ALONE, rss - left[among] ** 2 / np.maximum(own, ALONE), rss)
    row = int(np.argmin(without))
    return len(own) * float(np.log(max(rss, 1e-300) / max(float(without[row]), 1e-300))), row


def explained(deviation: float, ratios: Mapping[float, str], within: float) -> tuple[float, str]:
    """Factor that corrects a deviation of a logarithm, with its cause; 0 where no ratio of units is within reach.

    A force in kgf among those in N is too low by 9.8, so one that is too high by about 10 has a slipped decimal mark.

    >>> explained(-3.2, {25.4: "inch and mm"}, 0.2)
    (25.4, 'inch and mm')
    >>> forces = {9.80665: "kgf and N", 10.0: "a decimal mark"}
    >>> explained(2.25, forces, 0.2), explained(-2.3, forces, 0.2)
    ((0.1, 'a decimal mark'), (9.80665, 'kgf and N'))
    """
    if {10.0, KGF} <= set(ratios):
        ratios = {ratio: cause for ratio, cause in ratios.items() if ratio != (KGF if deviation > 0 else 10.0)}
    known: list[tuple[float, float, str]] = [
        (abs(deviation + sign * math.log(ratio)), ratio**sign, cause)
        for ratio, cause in ratios.items()
        for sign in (1, -1)
    ]
    best = min(known, default=(math.inf, 0.0, ""))
    return (best[1], best[2]) if best[0] <= within else (0.0, "")
