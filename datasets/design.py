"""Designs of experiments: central composite plans with levels spaced geometrically, and coded levels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import Array, Ints, Texts
from ..core.errors import DataError, UsageError
from .factorial_designs import alias_sentences, factorial_blocks, two_level

RESERVED = ("run", "edge", "point", "block")
BLOCKS = (1, 2, 3, 5)
ORTHOGONAL = 1e-6  # correlation below which columns are orthogonal
MOST_FACTORS = 6
MOST_EDGES = 1000  # at one point


def central_composite(
    ranges: Mapping[str, tuple[float, float]],
    *,
    alpha: float | str = 2.0,
    centre: int = 4,
    axial_repeats: int = 2,
    half: bool = False,
    blocks: int = 1,
    seed: int,
    digits: int | None = 4,
) -> pd.DataFrame:
    """Plan one edge a row: a factorial, repeated centre points and repeated axial points.

    Levels are spaced geometrically, so that a power law is a plane in the coded columns; the axial points
    lie on the ends of the ranges (coded -alpha and +alpha). Three factors with the defaults give the 24 edges of
    Alaskari & Oraby (ICAESAM'2016, doi 10.15242/IIE.E1216006): 8 factorial, 4 centre, 6 axial twice.

    Parameters
    ----------
    ranges : mapping of 1 to 6 factors to (low, high)
        in the factor's unit (V m/min, f mm/rev, d mm)
    alpha : float, "rotatable", "face-centred" or "orthogonal"
        coded distance of the axial points, 1 or more; the factorial points lie at -1 and +1. "rotatable" gives a
        second-order law the same variance in all directions; "face-centred" is 1, so that each factor has three
        levels; "orthogonal" makes squares uncorrelated with each other, and with blocks of more than one makes
        block differences uncorrelated with the squares
    centre, axial_repeats : int
        edges at the centre (0 or more; with blocks at least one in each) and at each axial point (1 or more)
    half : bool
        half of the factorial of 3 factors or more, the last factor being the product of the others
    blocks : {1, 2, 3, 5}
        blocks of the factorial, and one more of the axial points; centre points are divided among them
    seed : int
        seed of the run order, which is drawn within blocks
    digits : int or None
        significant digits of a level; the range ends stay as given, None keeps full precision

    Returns
    -------
    DataFrame, one row an edge, in run order: run (1..n), edge (E01.. in the order factorial, centre, axial), block
    (where there are several), point ("factorial", "centre" or "axial"), `<factor>_coded` (of the rounded level) and
    the factors. ``attrs["notes"]``: the distance, the aliases and what the blocks cost, in sentences.

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
    _check_counts(centre, axial_repeats, digits)
    factorial = two_level(len(ranges), half=half)
    distance = _axial_distance(alpha, factorial, centre, axial_repeats, blocks)
    points = _composite_points(factorial, distance, centre, axial_repeats, blocks)
    notes = _composite_notes(points, factorial, list(ranges), distance, half)
    return planned_edges(points, ranges, span=distance, seed=seed, digits=digits, notes=notes)


@dataclass(frozen=True, slots=True)
class DesignPoints:
    """Points of a design in standard order.

    Attributes
    ----------
    coded : ndarray, shape (n, k)
    kind : ndarray of str, shape (n,)
        "factorial", "centre", "axial", or the row of an array.
    block : ndarray of int, shape (n,)
        Number of each point's block, 0 upwards.
    confounded : tuple of tuples of int
        Interactions that equal a difference of blocks, as positions of factors.
    """

    coded: Array
    kind: NDArray[np.str_]
    block: Ints
    confounded: tuple[tuple[int, ...], ...] = ()


def planned_edges(
    points: DesignPoints,
    ranges: Mapping[str, tuple[float, float]],
    *,
    span: float,
    seed: int,
    digits: int | None,
    notes: Sequence[str] = (),
) -> pd.DataFrame:
    """Edges in run order, drawn within blocks, with the levels of coded points; coded ``span`` is a range's end."""
    rng, n = np.random.default_rng(seed), len(points.kind)
    parts = [np.flatnonzero(points.block == number) for number in np.unique(points.block)]
    order = np.concatenate([part[rng.permutation(len(part))] for part in parts])
    columns: dict[str, object] = {"run": np.arange(1, n + 1), "edge": _labels(n)[order]}
    if len(parts) > 1:
        columns["block"] = points.block[order] + 1
    columns["point"] = points.kind[order]
    levels = {}
    for j, (factor, (low, high)) in enumerate(ranges.items()):
        levels[factor] = _levels(points.coded[order, j] / span, float(low), float(high), digits)
        columns[f"{factor}_coded"] = span * _position(levels[factor], low, high)
    plan = pd.DataFrame({**columns, **levels})
    plan.attrs["notes"] = tuple(notes)
    return plan


def round_significant(values: ArrayLike, digits: int) -> Array:
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


def _axial_distance(alpha: float | str, factorial: Array, centre: int, axial_repeats: int, blocks: int) -> float:
    """Coded distance of the axial points.

    Rotatable: ``alpha^4 = F / r`` of F factorial points and r edges at each axial point. Orthogonal squares:
    ``(F + 2 r alpha^2)^2 = F N``. Orthogonal blocks: the factorial and the axial part have sums of squares in the ratio
    of their sizes. (Myers, Montgomery & Anderson-Cook 2016, sections 8.2 and 8.3.)
    """
    if blocks not in BLOCKS:
        raise UsageError(f"blocks {blocks}: a central composite design is cut in 1, 2, 3 or 5 blocks.")
    if blocks > 1 and centre < blocks:
        raise UsageError(f"centre {centre}: {blocks} blocks need {blocks} or more, one edge at the centre of each.")
    (F, k), r = factorial.shape, axial_repeats
    names = {
        "rotatable": (F / r) ** 0.25,
        "face-centred": 1.0,
        "orthogonal": float(np.sqrt((np.sqrt(F * (F + 2 * k * r + centre)) - F) / (2 * r))),
    }
    if blocks > 1:
        in_factorial = (blocks - 1) * (centre // blocks)
        names["orthogonal"] = float(np.sqrt(F * (2 * k * r + centre - in_factorial) / (2 * r * (F + in_factorial))))
    if isinstance(alpha, str) and alpha not in names:
        raise UsageError(f"alpha {alpha!r}: give a number of 1 or more, or {', '.join(names)}.")
    distance = names[alpha] if isinstance(alpha, str) else float(alpha)
    if not (np.isfinite(distance) and distance >= 1):
        word = f"{alpha} alpha is {distance:.3g}" if isinstance(alpha, str) else f"alpha {distance:g}"
        fewer = "repeat the axial points less" if isinstance(alpha, str) else "give 1 or more (2 is usual)"
        raise UsageError(f"{word}: below 1 the factorial points leave the ranges; {fewer}.")
    return distance


def _composite_points(factorial: Array, alpha: float, centre: int, axial_repeats: int, blocks: int) -> DesignPoints:
    """The points in the order factorial, centre, axial."""
    k = factorial.shape[1]
    axial = np.repeat(np.kron(np.eye(k), np.array([[-alpha], [alpha]])), axial_repeats, axis=0)
    parts = {"factorial": factorial, "centre": np.zeros((centre, k)), "axial": axial}
    kind = np.repeat(list(parts), [len(part) for part in parts.values()])
    of_factorial, confounded = factorial_blocks(factorial, max(blocks - 1, 1))
    of_centre = np.minimum(np.arange(centre) // max(centre // blocks, 1), blocks - 1)
    block = np.concatenate([of_factorial, of_centre, np.full(len(axial), blocks - 1)])
    return DesignPoints(np.vstack(list(parts.values())), kind, block.astype(np.intp), confounded)


def _composite_notes(
    points: DesignPoints, factorial: Array, names: Sequence[str], alpha: float, half: bool
) -> tuple[str, ...]:
    out = [f"Axial points at {alpha:.4g} times the distance of the factorial points, at the ends of the ranges."]
    if half:
        rest = "·".join(names[:-1])
        out.append(f"Half of the {2 ** len(names)} factorial points: {names[-1]} = {rest}.")
    aliases = alias_sentences(points.coded, names)
    if half:
        alone = [words for words in alias_sentences(factorial, names) if words not in aliases]
        out += [f"Of the factorial points alone: {words[0].lower()}{words[1:]}" for words in alone]
    return (*out, *aliases, *block_sentences(points, names))


def block_sentences(points: DesignPoints, names: Sequence[str]) -> tuple[str, ...]:
    """Cost of the blocks of a design, and the confounding of their differences with squares."""
    number = np.unique(points.block)
    if len(number) == 1:
        return ()
    sizes = ", ".join(str(int((points.block == b).sum())) for b in number)
    out = [f"{len(number)} blocks of {sizes} edges: cut one block after the other, each under the same circumstances."]
    if points.confounded:
        lost = ", ".join("·".join(names[j] for j in word) for word in points.confounded)
        out.append(f"A difference of blocks cannot be separated from {lost}.")
    indicator = (points.block[:, None] == number[1:]).astype(float)
    terms = np.column_stack([points.coded, np.square(points.coded)])
    terms, indicator = terms - terms.mean(axis=0), indicator - indicator.mean(axis=0)
    size = np.sqrt(np.square(terms).sum(axis=0))
    q = np.linalg.qr(indicator)[0]
    r = np.sqrt(np.square(q.T @ terms).sum(axis=0))[size > ORTHOGONAL] / size[size > ORTHOGONAL]
    largest = float(r.max(initial=0.0))
    out.append(
        "Blocks are orthogonal to factors and squares."
        if largest < ORTHOGONAL
        else f"Blocks are not orthogonal to factors and squares (correlation up to {largest:.2f})."
    )
    return tuple(out)


def _levels(position: Array, low: float, high: float, digits: int | None) -> Array:
    """Natural levels of positions -1 (low) to +1 (high) on a geometric scale; the ends exactly as given."""
    middle, half = np.log(low * high) / 2, np.log(high / low) / 2
    levels = np.exp(middle + half * position)
    if digits is not None:
        levels = np.clip(round_significant(levels, digits), low, high)
    return np.where(position == -1, low, np.where(position == 1, high, levels))


def _position(levels: Array, low: float, high: float) -> Array:
    """Positions of levels on the geometric scale from -1 (low) to +1 (high)."""
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


def _check_counts(centre: int, axial_repeats: int, digits: int | None) -> None:
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


Values = Array | Texts


def looks_coded(values: Array) -> bool:
    """Whether these are coded levels of a design: few, symmetric about zero, with -1 and 1 among them.

    Examples
    --------
    >>> looks_coded(np.array([-1, 1, 0, 0, -1, 1.0])), looks_coded(np.array([50, 100, 200.0]))
    (True, False)
    """
    known = values[~np.isnan(values)]
    if not known.size or not (-3 <= known.min() <= -1 and 1 <= known.max() <= 3):  # decided without sorting
        return False
    levels = np.unique(known)
    if not 2 <= len(levels) <= 7 or not {-1.0, 1.0} <= set(levels):
        return False
    return bool(np.allclose(levels, -levels[::-1]))


def looks_numbered(values: Array) -> bool:
    """Whether these are numbers of levels, as in Taguchi's arrays: 1, 2 or 1, 2, 3 and so on, each in several rows.

    Examples
    --------
    >>> looks_numbered(np.array([1, 2, 3, 1, 2, 3.0])), looks_numbered(np.array([1, 2, 3.0]))
    (True, False)
    """
    levels, rows = np.unique(values[~np.isnan(values)], return_counts=True)
    return bool(2 <= len(levels) <= 7 and rows.min() >= 2 and np.array_equal(levels, np.arange(1, len(levels) + 1)))


def decode_levels(role: str, values: Values, given: tuple[float, ...] | None) -> tuple[Values, tuple[str, ...]]:
    """Conditions from coded levels, and the assumption made; any other values are returned unchanged.

    Parameters
    ----------
    role : symbol, for the messages
    values : shape (n,)
    given : (low, high) at the levels -1 and 1, spaced evenly in the logarithm, or (low, centre, high);
        the value of each level where the levels are numbered 1, 2, 3

    Raises
    ------
    DataError
        The levels are coded and no range is given.
    UsageError
        The range is not in order, or given for a column that is not coded.

    Examples
    --------
    >>> decode_levels("V", np.array([-1, 0, 1.0]), (50.0, 200.0))[0].round(6).tolist()
    [50.0, 100.0, 200.0]
    """
    if values.dtype == object:
        return values, ()
    levels = np.asarray(values, dtype=float)
    if not looks_coded(levels):
        if given is None:
            return values, ()
        if not looks_numbered(levels):
            raise UsageError(f"--range {role}: the column holds no coded levels (-1, 0, 1); leave the range out.")
        return _of_numbers(role, levels, given)
    if given is None:
        raise DataError(
            f"{role} holds coded levels ({', '.join(f'{v:g}' for v in np.unique(levels[~np.isnan(levels)]))}): "
            f"give the values of -1 and 1, for instance --range {role}=50:200 (or low:centre:high)."
        )
    low, centre, high = _checked_range(role, given)
    if np.isclose(centre**2, low * high, rtol=0.02):
        how = f"{role}: coded levels, even in the logarithm: -1 is {low:g}, 0 is {centre:g}, 1 is {high:g}"
        return centre * (high / low) ** (levels / 2), (how,)
    how = f"{role}: coded levels, even in {role} itself: -1 is {low:g}, 0 is {centre:g}, 1 is {high:g}"
    return centre + levels * (high - low) / 2, (how,)


def _of_numbers(role: str, levels: Array, given: tuple[float, ...]) -> tuple[Values, tuple[str, ...]]:
    """Conditions from levels numbered 1, 2, 3: the value given for each, and the assumption made."""
    n = int(np.nanmax(levels))
    steps = np.diff(given)
    if len(given) != n or not (given[0] > 0 and given[-1] < np.inf and np.all(steps > 0)):
        numbers, form = ", ".join(map(str, range(1, n + 1))), ":".join(("low", *["middle"] * (n - 2), "high"))
        raise UsageError(
            f"--range {role}={':'.join(f'{v:g}' for v in given)}: the column holds the levels {numbers}; "
            f"give the value of each, {form}, rising and above zero."
        )
    known = ~np.isnan(levels)
    values = np.full(len(levels), np.nan)
    values[known] = np.array(given)[levels[known].astype(int) - 1]
    return values, (f"{role}: numbered levels: {', '.join(f'{k + 1} is {v:g}' for k, v in enumerate(given))}",)


def _checked_range(role: str, given: tuple[float, ...]) -> tuple[float, float, float]:
    if len(given) not in (2, 3) or not (0 < given[0] < given[-1] < np.inf):
        raise UsageError(f"--range {role}={':'.join(f'{v:g}' for v in given)}: it is low:high, both above zero.")
    low, high = given[0], given[-1]
    centre = given[1] if len(given) == 3 else float(np.sqrt(low * high))
    geometric = np.isclose(centre**2, low * high, rtol=0.02)
    arithmetic = np.isclose(2 * centre, low + high, rtol=0.02)
    if not (geometric or arithmetic):
        raise UsageError(
            f"--range {role}: centre {centre:g} is neither the geometric ({np.sqrt(low * high):.4g}) nor the "
            f"arithmetic ({(low + high) / 2:.4g}) middle of {low:g} and {high:g}; correct one of the three."
        )
    return low, centre, high
