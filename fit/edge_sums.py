"""Sums of products by edge: what least squares, the jackknife by edge and the variance components need of rows.

`EdgeSums` holds, for each edge, the number of rows, the means and the sums of products about the means of the
logarithms of the factors and of the response. Rows are added in blocks of any order; sums of two parts are merged.
An edge that was cut in two levels of a category has a group for each, so that the indicator columns are constant in
every group and need no sums. The sums of a group are written as a few equivalent rows, from which the functions of
``edges`` give the same inference as from all rows.

Coefficients come from the triangle of all rows about the means of their groups, and from these means. The triangle of a
block of rows is a root of its sums of products where their condition number is at most `LARGEST`; otherwise it is
found by a QR of the rows, which squares nothing, so that ill-conditioned columns keep their digits.

Typical use: ``sums.add(...)`` for each block, ``sums.merge(other)``, then ``least_squares(sums.summary(levels))`` and
``infer_from_sums(fit, equivalent_rows(sums, ...), ...)``.

Sources: Chan, Golub & LeVeque 1983, The American Statistician 37, 242 (merging about the means); Demmel, Grigori,
Hoemmen & Langou 2012, SIAM J. Sci. Comput. 34, A206 (triangles of blocks of rows).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Array, Flags, Ints
from .available import NotAvailable
from .edges import (
    EXACT_FIT,
    SAME,
    EdgeInference,
    RandomLevel,
    indispensable,
    left_out_moves,
    of_moves,
    random_level,
    too_few_edges,
)
from .least_squares import LinearFit, grams_about, sums_by
from .triangle import Summary, in_rows, square_roots

LARGEST = 70.0  # condition number of scaled columns up to which sums of products keep the digits of an estimate
EXACT = 1e-11  # relative residual below which a law meets its rows exactly
MOST_LEVELS = 1 << 31  # edge and level of a group in one number


@dataclass(frozen=True, slots=True)
class BaseLaw:
    """A law through one row: what sums are about.

    Attributes
    ----------
    origin : ndarray, shape (q,)
        That row: logarithms of the factors and of the response.
    exponents : ndarray, shape (q - 1,)
    """

    origin: Array
    exponents: Array

    @property
    def params(self) -> Array:
        """Logarithm of its constant, then the exponents, shape (q,)."""
        return np.append(self.origin[-1] - self.origin[:-1] @ self.exponents, self.exponents)

    def same(self, other: "BaseLaw") -> bool:
        """Whether the other is the same law through the same row."""
        return np.array_equal(self.origin, other.origin) and np.array_equal(self.exponents, other.exponents)


@dataclass(slots=True)
class EdgeSums:
    """Sums of q columns, the logarithms of the k factors and of the response, by edge and level of a category.

    Sums of squares of the response would lose the digits of small residuals, and means those of small changes. All
    columns are therefore taken about the first row, and the response about a law of the first rows through it; which
    row and law these are affects rounding only.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> W = rng.normal(size=(60, 3))
    >>> edge = np.repeat(np.arange(6), 10)
    >>> sums = EdgeSums(3)
    >>> for part in (slice(0, 25), slice(25, 60)):
    ...     sums.add(W[part].T, edge[part])
    >>> other = EdgeSums(3, sums.base)
    >>> other.add(W.T, edge)
    >>> bool(np.allclose(sums.square, other.square)), sums.n_groups
    (True, 6)

    Attributes
    ----------
    q : int
    base : BaseLaw or None
        That row and law; None before the first rows.
    number : dict
        Number of each group by its key, edge and level in one number.
    size : ndarray, shape (G,)
    mean, first : ndarray, shape (G, q)
        Means and first row, both about ``base``.
    far : ndarray, shape (q,)
        Bound of the distances of rows from the first of their group; zero where a column is constant in every group.
    square : ndarray, shape (G, q, q)
        Sums of products about the means.
    inside : ndarray, shape (at most q, q)
        Triangle of all rows about the means of their groups.
    """

    q: int
    base: BaseLaw | None = None
    number: dict[int, int] = field(default_factory=dict)
    size: Array = field(init=False)
    mean: Array = field(init=False)
    first: Array = field(init=False)
    far: Array = field(init=False)
    square: Array = field(init=False)
    inside: Array = field(init=False)

    def __post_init__(self) -> None:
        self.size = np.zeros(0)
        self.mean, self.first, self.inside = (np.zeros((0, self.q)) for _ in range(3))
        self.far = np.zeros(self.q)
        self.square = np.zeros((0, self.q, self.q))

    @property
    def n_groups(self) -> int:
        """Number of groups so far."""
        return len(self.number)

    def add(
        self, columns: Sequence[Array], edge: Ints | None, level: Ints | None = None, *, logarithms: bool = False
    ) -> None:
        """Add rows: columns of the factors and, last, of the response, and the numbers of the rows' edges and levels.

        With ``logarithms`` the columns are values above zero, and their logarithms are added.
        """
        if self.base is None:
            W = np.column_stack(columns)
            self.base = _first_law(np.log(W) if logarithms else W)
        order, starts, keys = _grouped(np.zeros(len(columns[0]), dtype=np.intp) if edge is None else edge, level)
        first, about, moves = _about_first(columns, order, starts, logarithms)
        first -= self.base.origin[:, None]
        first[-1] -= self.base.exponents @ first[:-1]
        of_factors = [j for j in moves if j < self.q - 1]
        for j in of_factors:
            about[-1] -= self.base.exponents[j] * about[j]
        moves = [*of_factors, self.q - 1]  # the law moves a response that is constant itself
        at = self._numbers(keys, first.T)
        far = np.abs(first - self.first[at].T).max(axis=1)
        far[moves] += [max(about[j].max(), -about[j].min()) for j in moves]
        self.far = np.maximum(self.far, far)
        found = grams_about(first, about, starts, moves)
        root = _root(found.square.sum(axis=2))
        apart = self._combine(at, found.size, found.mean.T, found.square.transpose(2, 0, 1))
        self._extend(found.about.T if root is None else root, apart)

    def merge(self, other: "EdgeSums") -> None:
        """Add the sums of further rows; both need the same ``base``."""
        if other.base is None:
            return
        if self.base is None:
            self.base = other.base
        if not self.base.same(other.base):
            raise ValueError("sums are about different laws; create them with the same base")
        keys, G = list(other.number), other.n_groups
        at = self._numbers(np.array(keys, dtype=np.int64), other.first[:G])
        self.far = np.maximum(self.far, np.abs(other.first[:G] - self.first[at]).max(axis=0) + other.far)
        self._extend(other.inside, self._combine(at, other.size[:G], other.mean[:G], other.square[:G]))

    def _combine(self, at: Ints, n: Array, mean: Array, square: Array) -> Array:
        """Add the sums of groups; returns rows (groups, q) with what the means moved add to the sums of products."""
        total, apart = self.size[at] + n, mean - self.mean[at]
        rows: Array = np.sqrt(self.size[at] * n / total)[:, None] * apart
        self.square[at] += square + rows[:, :, None] * rows[:, None, :]
        self.mean[at] += (n / total)[:, None] * apart
        self.size[at] = total
        return rows

    def _extend(self, *rows: Array) -> None:
        self.inside = np.asarray(np.linalg.qr(np.vstack([self.inside, *rows]), mode="r"))

    def summary(self, levels: Ints) -> Summary:
        """Summary of all rows, which are of these levels of the category, the reference first."""
        if self.base is None:
            raise ValueError("no rows were added")
        G, k = self.n_groups, self.q - 1
        shifts = (self.groups()[1][:, None] == levels[1:]).astype(float)
        means = np.hstack([self.mean[:G, :k], shifts, self.mean[:G, k:]])
        n = float(self.size.sum())
        mean = self.size[:G] @ means / n
        level = np.concatenate([self.base.origin[:k], np.zeros(shifts.shape[1] + 1)])
        inside = np.hstack([self.inside[:, :k], np.zeros((len(self.inside), shifts.shape[1])), self.inside[:, k:]])
        R = in_rows(np.vstack([np.sqrt(self.size[:G])[:, None] * (means - mean), inside]), int(n) - 1)
        return Summary(int(n), k, mean + level, R, self.base.params)

    def groups(self) -> tuple[Ints, Ints]:
        """Edge and level of each group, both shape (G,)."""
        keys = np.fromiter(self.number, dtype=np.int64, count=len(self.number))
        return (keys // MOST_LEVELS).astype(np.intp), (keys % MOST_LEVELS).astype(np.intp)

    def trimmed(self) -> "EdgeSums":
        """The sums without the memory reserved for further groups."""
        G = len(self.number)
        for name in ("size", "mean", "first", "square"):
            setattr(self, name, getattr(self, name)[:G])
        return self

    def _numbers(self, keys: NDArray[np.int64], opening: Array) -> Ints:
        """Numbers of the groups with these keys; new groups get one, and their first row."""
        old = len(self.number)
        at = np.array([self.number.setdefault(key, len(self.number)) for key in keys.tolist()], dtype=np.intp)
        if len(self.number) > old:
            self._reserve(len(self.number))
            new = at >= old
            self.first[at[new]] = opening[new]
        return at

    def _reserve(self, groups: int) -> None:
        if groups <= len(self.size):
            return
        more = max(groups, 2 * len(self.size)) - len(self.size)
        for name in ("size", "mean", "first", "square"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((more, *old.shape[1:]))]))


def _grouped(edge: Ints, level: Ints | None) -> tuple[Ints | None, Ints, NDArray[np.int64]]:
    """Order of rows by group, otherwise as they stand, None where they are; where each group begins, and its key."""
    key = edge if level is None else edge * (level.max() + 1) + level
    order = None if np.all(key[1:] >= key[:-1]) else _sorted(key)
    if order is not None:
        key = key.take(order)
    starts = np.append(0, np.flatnonzero(key[1:] != key[:-1]) + 1)
    first = starts if order is None else order[starts]
    return order, starts, edge[first].astype(np.int64) * MOST_LEVELS + (0 if level is None else level[first])


def _about_first(
    columns: Sequence[Array], order: Ints | None, starts: Ints, logarithms: bool
) -> tuple[Array, Array, list[int]]:
    """First row of each group, all rows about it, shapes (q, G) and (q, m), and the columns that change in a group.

    The logarithm of a column that is constant in its groups is taken once in each.
    """
    about, moves = np.zeros((len(columns), len(columns[0]))), []
    count = np.diff(np.append(starts, len(columns[0])))
    opening = np.array([column[starts if order is None else order[starts]] for column in columns])
    first = np.log(opening) if logarithms else opening
    for j, column in enumerate(columns):
        grouped = column if order is None else column.take(order)
        if not np.array_equal(grouped, np.repeat(opening[j], count)):
            moves.append(j)
            np.subtract(np.log(grouped) if logarithms else grouped, np.repeat(first[j], count), out=about[j])
    return first, about, moves


def _sorted(key: Ints) -> Ints:
    """Order of keys that are not negative; equal ones stay in theirs."""
    order: Ints = np.argsort(key.astype(np.uint16), kind="stable")  # of 16 bits, which numpy sorts by radix
    for bits in range(16, int(key.max()).bit_length(), 16):
        order = order.take(np.argsort((key >> bits).astype(np.uint16).take(order), kind="stable"))
    return order


def _root(square: Array) -> Array | None:
    """Rows, shape (r, q), whose sums of products are ``square``; None above the condition number `LARGEST`."""
    values, rows = square_roots(square[None])
    ends = values[0, [0, -1]] if values.size else (1.0, 1.0)
    return rows[0] if ends[0] * LARGEST**2 >= ends[1] else None


def _first_law(W: Array) -> BaseLaw:
    """Law of the last column on the others through the first row, its exponents the least where not identified."""
    D = W - W.mean(axis=0)
    return BaseLaw(W[0].copy(), np.asarray(np.linalg.lstsq(D[:, :-1], D[:, -1], rcond=1e-6)[0]))


@dataclass(frozen=True, slots=True)
class EquivalentRows:
    """Rows equivalent to those of each group, an edge in one level of the category.

    Attributes
    ----------
    names : tuple of str, the E edges, sorted
    edge : ndarray of int, shape (G,), number of each group's edge
    size : ndarray, shape (G,)
    centre : ndarray, shape (G, p + 1), means of the law's columns and of the logarithm of the response less ``base``
    roots : ndarray, shape (G, r, p + 1), rows with the sums of products about the means
    moves : ndarray, shape (p,), largest change of a column within an edge
    base : ndarray, shape (p,), parameters of the law subtracted from the response
    """

    names: tuple[str, ...]
    edge: Ints
    size: Array
    centre: Array
    roots: Array
    moves: Array
    base: Array

    @property
    def edge_size(self) -> Array:
        """Rows of each edge, shape (E,)."""
        return np.bincount(self.edge, weights=self.size).astype(float)

    def rows(self) -> tuple[Array, Ints]:
        """Design and response side by side, shape (m, p + 1), and the edge of each of these rows."""
        all_of = np.concatenate([(np.sqrt(self.size)[:, None] * self.centre)[:, None], self.roots], axis=1)
        return all_of.reshape(-1, all_of.shape[2]), np.repeat(self.edge, all_of.shape[1])


def equivalent_rows(
    sums: EdgeSums, keep: Sequence[int], names: tuple[str, ...], order: Ints, levels: Ints
) -> EquivalentRows:
    """Rows equivalent to the sums, for a law of the factors ``keep``.

    Parameters
    ----------
    names, order : tuple of str and ndarray of int, shape (E,)
        Sorted names of the edges, and their numbers in the sums.
    levels : ndarray of int
        Numbers of the levels of the category, the reference first.
    """
    if sums.base is None:
        raise ValueError("no rows were added")
    edge, level = sums.groups()
    place = np.empty(int(order.max()) + 1, dtype=np.intp)
    place[order] = np.arange(len(order))
    number = place[edge]
    shifts = (level[:, None] == levels[1:]).astype(float)
    gone = [j for j in range(sums.q - 1) if j not in keep]
    base, means = sums.base.params, sums.mean + np.append(sums.base.origin[:-1], 0.0)
    back = np.append(base[1:][gone], 1.0)  # a factor that is left out takes nothing from the response
    columns = [*gone, sums.q - 1]
    one, k = np.ones((len(edge), 1)), len(keep)
    _, about = square_roots(sums.square)
    roots = np.zeros((*about.shape[:2], k + 2 + shifts.shape[1]))
    roots[:, :, 1 : k + 1], roots[:, :, -1] = about[:, :, keep], about[:, :, columns] @ back
    return EquivalentRows(
        names=names,
        edge=number,
        size=sums.size,
        centre=np.hstack([one, means[:, keep], shifts, (means[:, columns] @ back)[:, None]]),
        roots=roots,
        moves=_moves(np.hstack([one, sums.first[:, keep], shifts]), sums.far[keep], number),
        base=np.concatenate([base[:1], base[1:][list(keep)], np.zeros(shifts.shape[1])]),
    )


def _moves(first: Array, far: Array, edge: Ints) -> Array:
    """Bound of the change of each column of the law within an edge, from the first rows of groups and ``far``."""
    opening = first[np.unique(edge, return_index=True)[1]][edge]  # one group of each edge
    moves: Array = np.abs(first - opening).max(axis=0)
    factors = slice(1, 1 + len(far))
    moves[factors] = np.maximum(moves[factors], far)
    return moves


def infer_from_sums(
    fit: LinearFit, rows: EquivalentRows, largest: Array, theta_names: tuple[str, ...]
) -> EdgeInference | NotAvailable:
    """Inference by edge from equivalent rows, or why these data do not allow it.

    Parameters
    ----------
    fit : LinearFit
    rows : EquivalentRows
    largest : ndarray, shape (p,)
        Largest absolute value of each column.
    theta_names : tuple of str
    """
    E, p = len(rows.names), len(fit.params)
    within = tuple(bool(w) for w in rows.moves > SAME * largest)
    if fit.df_resid == 0 or np.sqrt(fit.rss / fit.nobs) <= EXACT:
        return EXACT_FIT
    if why := too_few_edges(fit.nobs, E, p - sum(within)):
        return NotAvailable(why)
    A, edge = rows.rows()
    moved = left_out_moves(A[:, :p], A[:, p] - A[:, :p] @ (fit.params - rows.base), fit.cov_unscaled, edge, E)
    if isinstance(moved, int):
        return NotAvailable(indispensable(rows.names[moved]))
    levels = _levels(rows, np.array(within))
    return of_moves(moved, fit.params, fit.cov_params, theta_names, rows.names, rows.edge_size, within, levels)


def _levels(rows: EquivalentRows, within: Flags) -> RandomLevel:
    """The fit with a random level of each edge; the law of the sums is about ``base``."""
    p = rows.centre.shape[1] - 1
    means = sums_by(rows.edge, rows.size[:, None] * rows.centre, len(rows.names)) / rows.edge_size[:, None]
    apart = np.sqrt(rows.size)[:, None] * (rows.centre - means[rows.edge])
    inside = np.asarray(np.linalg.qr(np.vstack([rows.roots.reshape(-1, p + 1), apart]), mode="r"))
    about = random_level(inside, means, rows.edge_size, within)
    return replace(about, theta=rows.base + about.theta)
