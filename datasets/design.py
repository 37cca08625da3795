"""Central composite designs in logs: which edge is cut at which V, f and d, and in which order."""

from collections.abc import Mapping
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ..core.errors import UsageError

RESERVED = ("run", "edge", "point")
MOST_FACTORS = 6
MOST_EDGES = 1000  # at one point

Floats = NDArray[np.float64]


def central_composite(
    ranges: Mapping[str, tuple[float, float]],
    *,
    alpha: float = 2.0,
    centre: int = 4,
    axial_repeats: int = 2,
    seed: int,
    digits: int | None = 4,
) -> pd.DataFrame:
    """Plan one edge a row: a full factorial, repeated centre points and repeated axial points.

    Levels are spaced geometrically, so that a power law is a plane in the coded columns; the axial points
    stand on the range ends (coded -alpha and +alpha). Three factors with the defaults give the 24 edges of
    Alaskari & Oraby (ICAESAM'2016, doi 10.15242/IIE.E1216006): 8 factorial, 4 centre, 6 axial twice.

    Parameters
    ----------
    ranges : mapping of 1 to 6 factors to (low, high)
        in the factor's unit (V m/min, f mm/rev, d mm)
    alpha : float
        coded distance of the axial points, 1 or more; the factorial points stand at -1 and +1
    centre, axial_repeats : int
        edges at the centre (0 or more) and at each axial point (1 or more)
    seed : int
        seed of the run order
    digits : int or None
        significant digits of a level; the range ends stay as given, None keeps full precision

    Returns
    -------
    DataFrame, one row an edge, in run order: run (1..n), edge (E01.. in the order factorial, centre, axial),
    point ("factorial", "centre" or "axial"), `<factor>_coded` (of the rounded level) and the factors.

    Raises
    ------
    UsageError
        for a range that is empty, reversed or not positive, and for counts out of bounds

    Examples
    --------
    >>> plan = central_composite({"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}, seed=1)
    >>> plan["point"].value_counts().to_dict()
    {'axial': 12, 'factorial': 8, 'centre': 4}

    """
    _check_ranges(ranges)
    _check_counts(alpha, centre, axial_repeats, digits)
    coded, point = _standard_order(len(ranges), alpha, centre, axial_repeats)
    order = np.random.default_rng(seed).permutation(len(point))
    columns: dict[str, object] = {
        "run": np.arange(1, len(point) + 1),
        "edge": _labels(len(point))[order],
        "point": point[order],
    }
    levels = {}
    for j, (factor, (low, high)) in enumerate(ranges.items()):
        levels[factor] = _levels(coded[order, j] / alpha, float(low), float(high), digits)
        columns[f"{factor}_coded"] = alpha * _position(levels[factor], low, high)
    return pd.DataFrame({**columns, **levels})


def round_significant(values: ArrayLike, digits: int) -> Floats:
    """Round to significant digits, to the double nearest to the decimal number a person would write.

    Parameters
    ----------
    values : array_like
        any shape and unit
    digits : int
        significant digits, 1 or more

    Returns
    -------
    ndarray, the shape of `values`

    Examples
    --------
    >>> round_significant([70.710678, 0.033333], 3).tolist()
    [70.7, 0.0333]

    """
    array = np.asarray(values, dtype=np.float64)
    # through the decimal text: scaling by a power of ten would leave 0.30340000000000006
    rounded = [float(f"{x:.{digits}g}") for x in array.ravel()]
    return np.array(rounded, dtype=np.float64).reshape(array.shape)


def _standard_order(factors: int, alpha: float, centre: int, axial_repeats: int) -> tuple[Floats, NDArray[np.str_]]:
    """Coded points, shape (n, factors), and the kind of each, shape (n,)."""
    factorial = np.array(list(product((-1.0, 1.0), repeat=factors)))
    axial = np.kron(np.eye(factors), np.array([[-alpha], [alpha]]))
    blocks = {
        "factorial": factorial,
        "centre": np.zeros((centre, factors)),
        "axial": np.repeat(axial, axial_repeats, axis=0),
    }
    point = np.repeat(list(blocks), [len(block) for block in blocks.values()])
    return np.vstack(list(blocks.values())), point


def _levels(position: Floats, low: float, high: float, digits: int | None) -> Floats:
    """Natural levels of positions -1 (low) to +1 (high) on a geometric scale; the ends exactly as given."""
    middle, half = np.log(low * high) / 2, np.log(high / low) / 2
    levels = np.exp(middle + half * position)
    if digits is not None:
        levels = np.clip(round_significant(levels, digits), low, high)
    return np.where(position == -1, low, np.where(position == 1, high, levels))


def _position(levels: Floats, low: float, high: float) -> Floats:
    """Where levels stand on the geometric scale from -1 (low) to +1 (high)."""
    return np.asarray(np.log(levels * levels / (low * high)) / np.log(high / low), dtype=np.float64)


def _labels(n: int) -> NDArray[np.str_]:
    width = max(2, len(str(n)))
    return np.array([f"E{i:0{width}d}" for i in range(1, n + 1)])


def _check_ranges(ranges: Mapping[str, tuple[float, float]]) -> None:
    if not 1 <= len(ranges) <= MOST_FACTORS:
        raise UsageError(
            f"{len(ranges)} factors given; a central composite design takes 1 to {MOST_FACTORS}: "
            'name each with its range, such as {"V": (50, 200)}.'
        )
    for factor, (low, high) in ranges.items():
        if factor in RESERVED:
            raise UsageError(f"factor {factor!r} has the name of a column of the plan; rename the factor.")
        if not (np.isfinite(low) and np.isfinite(high) and low > 0):
            raise UsageError(
                f"range of {factor}: {low:g} to {high:g}; geometric spacing needs finite positive ends: "
                "raise the lower end above 0."
            )
        if low >= high:
            raise UsageError(
                f"range of {factor}: {low:g} to {high:g}; the lower end must be below the upper: "
                "give it as (low, high), or leave a constant factor out of the plan."
            )


def _check_counts(alpha: float, centre: int, axial_repeats: int, digits: int | None) -> None:
    if not (np.isfinite(alpha) and alpha >= 1):
        raise UsageError(
            f"alpha {alpha:g}: below 1 the factorial points leave the ranges; give 1 or more (2 is usual)."
        )
    if max(centre, axial_repeats) > MOST_EDGES:
        raise UsageError(
            f"{max(centre, axial_repeats)} edges at one point; at most {MOST_EDGES} are planned: give fewer."
        )
    if centre < 0:
        raise UsageError(f"centre {centre}: the number of centre points cannot be negative; give 0 or more.")
    if axial_repeats < 1:
        raise UsageError(f"axial_repeats {axial_repeats}: each axial point is cut at least once; give 1 or more.")
    if digits is not None and digits < 1:
        raise UsageError(f"digits {digits}: a level needs at least 1 significant digit; give 1 or more, or None.")
