"""Two-level fractions, blocks of a factorial, Taguchi's orthogonal arrays, and the aliases of a design.

In a fraction some effects have the same column: they are aliased, and only their sum can be estimated. A block (a day,
a bar, a machine) is a column too; it costs the interaction that has this column.

Sources: Montgomery 2017, Design and Analysis of Experiments, chapters 7 (blocks) and 8 (fractions); Taguchi & Konishi
1987, Orthogonal Arrays and Linear Graphs (L4 to L27); Plackett & Burman 1946, Biometrika 33, 305 (L12); Box, Hunter &
Hunter 2005, Statistics for Experimenters, section 6 (resolution).
"""

from collections.abc import Mapping, Sequence
from itertools import combinations, product
from types import MappingProxyType

import numpy as np

from ..core.arrays import Array, Ints
from ..core.errors import UsageError

Levels = tuple[float, float] | Sequence[float] | Sequence[str]

SAME = 1 - 1e-9  # absolute correlation of two columns that are one
PART = 1e-6  # absolute correlation below which two columns are orthogonal
# The first row of each three of L18 (Taguchi & Konishi 1987); the others add 1 and 2, modulo 3, to columns 3 to 8.
_L18 = ("00000000", "01001122", "02010212", "10022110", "11012021", "12021201")
_PALEY = (1, 1, 0, 1, 1, 1, 0, 0, 0, 1, 0)  # quadratic residues modulo 11: the first row of L12
_LEVELS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {
        "L4": (2,) * 3,
        "L8": (2,) * 7,
        "L9": (3,) * 4,
        "L12": (2,) * 11,
        "L16": (2,) * 15,
        "L18": (2, *(3,) * 7),
        "L27": (3,) * 13,
    }
)
ARRAYS = tuple(_LEVELS)
# Columns in the order in which factors take them, so that few of them are aliased with products of two others.
_TWO_LEVELS = {4: (1, 2, 3), 8: (1, 2, 4, 7, 3, 5, 6), 16: (1, 2, 4, 8, 7, 11, 13, 14, 3, 5, 6, 9, 10, 12, 15)}
_FIVE_OF_16 = (1, 2, 4, 8, 15)  # of resolution V
_L27_ORDER = (1, 2, 5, 9, 3, 4, 6, 7, 8, 10, 11, 12, 13)


def orthogonal_array(name: str) -> Ints:
    """One of Taguchi's orthogonal arrays: in any two columns every pair of levels occurs equally often.

    Parameters
    ----------
    name : {"L4", "L8", "L9", "L12", "L16", "L18", "L27"}
        The number is that of the rows. L4, L8, L12 and L16 have two levels, L9 and L27 three, L18 one column of two
        levels and seven of three.

    Returns
    -------
    ndarray of int, shape (rows, columns)
        Levels 0, 1 (and 2), in the order of Taguchi's tables, where columns of L8 and L16 have the product of columns
        i and j in column i XOR j.

    Raises
    ------
    UsageError
        for any other name

    Examples
    --------
    >>> orthogonal_array("L9").tolist()[:3]
    [[0, 0, 0, 0], [0, 1, 1, 1], [0, 2, 2, 2]]
    """
    if name not in _LEVELS:
        raise UsageError(f"design {name!r}: the orthogonal arrays are {', '.join(ARRAYS)}.")
    rows = int(name[1:])
    if name == "L12":
        wheel = np.array([np.roll(_PALEY, shift) for shift in range(11)])
        return np.vstack([np.zeros((1, 11), dtype=np.intp), wheel])
    if name == "L18":
        return _l18()
    base = 2 if rows in _TWO_LEVELS else 3
    digits = np.array(list(product(range(base), repeat=round(np.log(rows) / np.log(base)))), dtype=np.intp)
    return np.asarray(digits @ _generators(base, digits.shape[1]).T % base, dtype=np.intp)


def _l18() -> Ints:
    first = np.array([[int(digit) for digit in row] for row in _L18], dtype=np.intp)
    step = np.array([0, 0, *(1,) * 6])
    added = [first + shift * step for shift in range(3)]
    return np.asarray(np.stack(added, axis=1).reshape(18, 8) % np.array(_LEVELS["L18"]), dtype=np.intp)


def _generators(base: int, k: int) -> Ints:
    """Coefficients of each column of a regular array, shape (columns, k), in Taguchi's order.

    Each basic column is followed by its sums with all combinations of the basic columns before it.
    """
    rows = [
        [*combination[::-1], 1, *(0,) * (k - j - 1)] for j in range(k) for combination in product(range(base), repeat=j)
    ]
    return np.array(rows, dtype=np.intp)


def array_columns(name: str, levels: Sequence[int], block: int = 1) -> tuple[tuple[int, ...], int | None]:
    """Columns of an array for factors with these numbers of levels, and the column of the blocks (None: one block).

    Columns count from 0. Factors take the columns that are aliased with the fewest products of two others.

    Raises
    ------
    UsageError
        The array has too few columns of a number of levels.

    Examples
    --------
    >>> array_columns("L8", (2, 2, 2)), array_columns("L18", (3, 3), block=2)
    (((0, 1, 3), None), ((1, 2), 0))
    """
    known = _LEVELS[name]
    free = _order(name, len(levels))
    out: list[int] = []
    for wanted in (*levels, *((block,) if block > 1 else ())):
        found = next((c for c in free if known[c] == wanted), None)
        if found is None:
            raise _too_few(name, levels, block)
        free.remove(found)
        out.append(found)
    return (tuple(out[:-1]), out[-1]) if block > 1 else (tuple(out), None)


def _too_few(name: str, levels: Sequence[int], block: int) -> UsageError:
    known = _LEVELS[name]
    has = ", ".join(f"{known.count(q)} of {q} levels" for q in sorted(set(known)))
    asked = ", ".join(str(q) for q in levels) + (f", and {block} blocks" if block > 1 else "")
    return UsageError(f"design {name}: it has columns: {has}; the factors have {asked}. Choose another array.")


def _order(name: str, factors: int) -> list[int]:
    rows = int(name[1:])
    if rows in _TWO_LEVELS:
        order = _TWO_LEVELS[rows]
        first = _FIVE_OF_16 if rows == 16 and factors == 5 else order
        return [c - 1 for c in dict.fromkeys((*first, *order))]
    if name == "L27":
        return [c - 1 for c in _L27_ORDER]
    return list(range(len(_LEVELS[name])))


def two_level(factors: int, *, half: bool = False) -> Array:
    """All combinations of -1 and 1, shape (2^k, k), or half of them: the last factor is the product of the others.

    Raises
    ------
    UsageError
        for half of fewer than 3 factors

    Examples
    --------
    >>> two_level(3, half=True).tolist()
    [[-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]
    """
    if not half:
        return np.array(list(product((-1.0, 1.0), repeat=factors)))
    if factors < 3:
        raise UsageError(f"half of a factorial of {factors} factors: it needs 3 or more; leave half out.")
    first = np.array(list(product((-1.0, 1.0), repeat=factors - 1)))
    return np.column_stack([first, first.prod(axis=1)])


def factorial_blocks(points: Array, blocks: int) -> tuple[Ints, tuple[tuple[int, ...], ...]]:
    """Number of each point's block, 0 upwards, shape (n,), and the interactions that equal a block difference.

    Of all interactions those are taken whose products among each other, and whose aliases in a fraction, have the most
    factors.

    Parameters
    ----------
    points : ndarray, shape (2^(k-p), k), of -1 and 1
    blocks : {1, 2, 4}

    Raises
    ------
    UsageError
        for another number of blocks, or one that costs a main effect

    Examples
    --------
    >>> factorial_blocks(two_level(3), 2)
    (array([0, 1, 1, 0, 1, 0, 0, 1]), ((0, 1, 2),))
    """
    if blocks == 1:
        return np.zeros(len(points), dtype=np.intp), ()
    if blocks not in (2, 4):
        raise UsageError(f"{blocks} blocks of a factorial: it is cut in 1, 2 or 4 blocks.")
    k, n = points.shape[1], len(points)
    columns = {word: points[:, word].prod(axis=1) for r in range(1, k + 1) for word in combinations(range(k), r)}
    best: tuple[int, tuple[tuple[int, ...], ...]] = (0, ())
    for chosen in combinations(columns, 1 if blocks == 2 else 2):
        lost = _products([columns[word] for word in chosen])
        alike = tuple(word for word, x in columns.items() if (np.abs(lost @ x) == n).any())
        if np.abs(lost.sum(axis=1)).max() > 0 or not alike:
            continue  # the constant: the blocks would not be equal
        if (min(map(len, alike)), -len(alike)) > (best[0], -len(best[1])):
            best, signs = (min(map(len, alike)), alike), [columns[word] > 0 for word in chosen]
    if best[0] < 2:
        raise UsageError(f"{blocks} blocks of {n} points: a block difference would equal the effect of a "
                         "factor; take fewer blocks, or the whole factorial.")  # fmt: skip
    number = sum((sign.astype(np.intp) << i for i, sign in enumerate(reversed(signs))), np.zeros(n, dtype=np.intp))
    return number ^ number[0], best[1]


def _products(columns: list[Array]) -> Array:
    """One column, or two and their product, as rows."""
    return np.array(columns if len(columns) == 1 else [*columns, columns[0] * columns[1]])


def alias_sentences(coded: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Sentences on aliases of a design: factors, products of two and, of three levels or more, squares.

    Parameters
    ----------
    coded : ndarray, shape (n, k)
        Exact coded levels, before they are rounded.
    names : k symbols

    Examples
    --------
    >>> alias_sentences(two_level(3, half=True), ["V", "f", "d"])[0]
    'Aliased, only the sum can be estimated: V = f·d; f = V·d; d = V·f.'
    """
    kinds, labels, columns = _effects(coded, names)
    if len(labels) == 1:
        return ()
    centred = columns - columns.mean(axis=0)
    size = np.sqrt(np.square(centred).sum(axis=0))
    kept = size > PART
    r = np.zeros((len(labels), len(labels)))
    r[np.ix_(kept, kept)] = (centred[:, kept] / size[kept]).T @ (centred[:, kept] / size[kept])
    groups = _groups(r, labels)
    out = [] if not groups else [f"Aliased, only the sum can be estimated: {'; '.join(groups)}."]
    main = np.array([kind == "factor" for kind in kinds])
    of_main, r = r[np.ix_(main, ~main)], np.where(np.abs(r) > SAME, 0.0, np.abs(r))
    partly = float(r[np.ix_(main, ~main)].max(initial=0.0))
    if partly > PART:
        out.append(
            f"Factors are partly aliased with products of two others (correlation up to {partly:.2f}): their effects "
            "are unbiased only where these products are negligible."
        )
    rank = int(np.linalg.matrix_rank(centred[:, kept] / size[kept]))
    if rank < len(labels) and not groups:
        out.append(f"Of {len(labels)} factors, squares and products of two, {rank} can be estimated together.")
    if not out and of_main.size:
        others = "products of two" + (" and squares" if "square" in kinds else "")
        out.append(f"No factor is aliased with another; {others} can be estimated too.")
    return tuple(out)


def _effects(coded: Array, names: Sequence[str]) -> tuple[list[str], list[str], Array]:
    """Kind, name and column of each effect: factors, squares of those with three levels or more, products of two."""
    k = coded.shape[1]
    kinds, labels = ["factor"] * k, list(names)
    columns = [coded[:, j] for j in range(k)]
    for j in range(k):
        if len(np.unique(np.abs(coded[:, j]).round(9))) > 1:
            kinds, labels = [*kinds, "square"], [*labels, f"{names[j]}²"]
            columns.append(np.square(coded[:, j]))
    for i, j in combinations(range(k), 2):
        kinds, labels = [*kinds, "product"], [*labels, f"{names[i]}·{names[j]}"]
        columns.append(coded[:, i] * coded[:, j])
    return kinds, labels, np.column_stack(columns)


def _groups(r: Array, labels: Sequence[str]) -> list[str]:
    """Effects with one column, such as ``V = f·d`` or ``V = -f·d``."""
    out, done = [], set()
    for i, label in enumerate(labels):
        if i in done:
            continue
        alike = [j for j in range(i + 1, len(labels)) if abs(r[i, j]) > SAME]
        done.update(alike)
        if alike:
            out.append(" = ".join([label, *(f"{'-' if r[i, j] < 0 else ''}{labels[j]}" for j in alike)]))
    return out


def two_ends(name: str, levels: Levels) -> tuple[float, float]:
    """The ends of the range of a factor.

    Raises
    ------
    UsageError
        for words, other than two numbers, and ends that have no geometric spacing

    >>> two_ends("V", (80, 200))
    (80.0, 200.0)
    """
    if len(levels) != 2 or isinstance(levels[0], str):
        raise UsageError(
            f"{name}: {', '.join(map(str, levels))}; this design takes low:high. Levels of your own need an array, "
            "such as --design L9."
        )
    low, high = (float(x) for x in levels)
    if not 0 < low < high < np.inf:
        raise UsageError(
            f"range of {name}: {low:g} to {high:g}; geometric spacing needs finite ends above 0, and the lower end "
            "must be below the upper."
        )
    return low, high


def products_of_blocks(scores: Array, block: Ints) -> tuple[tuple[int, ...], ...]:
    """Products of two factors that equal a difference of blocks, as the places of these factors.

    >>> products_of_blocks(two_level(2), np.array([0, 1, 1, 0]))
    ((0, 1),)
    """
    pairs = list(combinations(range(scores.shape[1]), 2))
    within = [scores[:, i] * scores[:, j] for i, j in pairs]
    means = [np.bincount(block, x) / np.bincount(block) for x in within]
    return tuple(p for p, x, m in zip(pairs, within, means, strict=True) if np.ptp(m) > 0 and np.allclose(x, m[block]))


def repeat_sentences(coded: Array) -> tuple[str, ...]:
    """The remark that no setting is cut twice; none where one is.

    >>> len(repeat_sentences(two_level(2)))
    1
    """
    once = len(np.unique(coded, axis=0)) == len(coded)
    return ("No setting is cut twice: lack of fit cannot be tested. Repeat the design, or its centre.",) * once
