"""Design region of a law: the points inside every factor's range with no more leverage than the design.

The corner of the box about a central composite design was never cut, nor anything near it; its leverage is high.
Leverage is computed in the space of the law's columns: among *edge settings* for what changes only between edges
(an edge counts once, however long it lasted), and among rows for the whole law.

Source: Myers, Montgomery & Anderson-Cook 2016, Response Surface Methodology, section 8.2 (scaled prediction
variance); Belsley, Kuh & Welsch 1980, Regression Diagnostics, section 2.1 (leverage).
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..core.arrays import Array, Flags, Ints, Texts
from ..core.display import Displayable, Plottable
from ..core.errors import FitError
from ..datasets import region
from ..datasets.vocabulary import ROLES
from .edges import changes_within
from .laws import LawForm
from .least_squares import linear
from .rows import By, Points, as_table, level_names

ONE_VALUE = 1e-6  # half range of a fixed factor that does not change
MOST_ROWS = 20_000  # of more rows than this a choice draws the region
SETTABLE = ("V", "n", "f", "fz", "fm", "d", "ae")  # what a machine sets from test to test: speeds, then the chip
CHIP = SETTABLE[2:]
EXACT = 1e-9  # share of a column that others do not explain, below which it follows them exactly


@dataclass(frozen=True, slots=True, repr=False)
class ColumnSpace(Displayable):
    """Columns in which leverage is computed, and its largest value in the design.

    Attributes
    ----------
    of : {"edge settings", "rows"}
        What counts as one point of the design.
    columns : tuple of int
        Positions in ``(1, coded factors, indicators)``.
    matrix : tuple of tuples of float, shape (c, c)
        ``(Z'Z)^-1`` of those columns, one row of Z an edge or a row.
    largest : tuple of float
        Largest leverage in the design, at each level of the category (one number without a category).
    """

    of: str
    columns: tuple[int, ...]
    matrix: tuple[tuple[float, ...], ...]
    largest: tuple[float, ...]


@dataclass(frozen=True, slots=True, repr=False)
class DesignRegion(Plottable):
    """The region of a design.

    Attributes
    ----------
    response : str
    factors, units : tuple of str
        Symbols and units, in the order of the law.
    logs : bool or tuple of bool
        Whether factors are coded in logarithms, all of them or each.
    centre, half_range : tuple of float
        Middle and half width of each factor's range, in logarithms where ``logs``.
    largest_radius : float
        Largest coded radius of the design.
    by : str or None
        Category of the law.
    levels : tuple of str
        Its levels, the reference first; empty without one.
    spaces : tuple of ColumnSpace
        Edge settings first, where the law has factors that change only between edges.
    """

    response: str
    factors: tuple[str, ...]
    units: tuple[str, ...]
    logs: bool | tuple[bool, ...]
    centre: tuple[float, ...]
    half_range: tuple[float, ...]
    largest_radius: float
    by: str | None
    levels: tuple[str, ...]
    spaces: tuple[ColumnSpace, ...]

    @property
    def largest_leverage(self) -> float:
        """Largest leverage of the design in the first space, over all levels."""
        return max(self.spaces[0].largest)

    def facts(self) -> dict[str, object]:
        """The region as plain numbers and texts, which ``region.inside`` needs and a file can hold."""
        return asdict(self)

    def leverage(self, points: Points) -> Array:
        """Leverage of points, shape (n,), in the first space: edge settings where there are any, else rows.

        Points hold a value or column for each factor, as in ``LawFit.predict``, and the category if there is one.
        """
        return region.leverages(self.facts(), *self._values(points))[..., 0]

    def coded_radius(self, points: Points) -> Array:
        """Distance of points from the centre, shape (n,), each factor coded -1 to +1 over its range."""
        return region.radius(self.facts(), self._values(points)[0])

    def inside(self, points: Points) -> Flags:
        """Whether points lie in the region, shape (n,): in every range, and no further out than the design."""
        return region.inside(self.facts(), *self._values(points))

    def words(self, point: Points) -> str:
        """Inside or outside, and by what, for one point."""
        facts, (X, level) = self.facts(), self._values(point)
        if len(X) != 1:
            raise FitError(f"{self.response}: {len(X)} points are given; words are of one point at a time.")
        at = region.level_numbers(facts, level, (1,))[0]
        h = region.leverages(facts, X, level)[0]
        r = float(region.radius(facts, X)[0])
        if region.inside(facts, X, level)[0]:
            return (
                f"inside: leverage {h[0]:.2g} (the design's largest {self.spaces[0].largest[at]:.2g}), "
                f"coded radius {r:.3g} ({self.largest_radius:.3g})"
            )
        why = self._beyond(X[0])
        for value, space in zip(h, self.spaces, strict=True):
            if value > space.largest[at] * (1 + region.SLACK):
                times = f"{value / space.largest[at]:.3g} times the design's largest"
                why.append(f"leverage {value:.2g} among {space.of}, {times}")
        if r**2 > self.largest_radius**2 * (1 + region.SLACK):
            why.append(f"coded radius {r:.3g}, the design's largest {self.largest_radius:.3g}")
        return f"outside: {'; '.join(why)}"

    def logs_of(self, names: Sequence[str]) -> tuple[bool, ...]:
        """For each of these factors, whether it is coded in logarithms."""
        each = dict(zip(self.factors, np.broadcast_to(self.logs, len(self.factors)).tolist(), strict=True))
        return tuple(each[name] for name in names)

    def coded(self, names: Sequence[str], X: Array) -> Array:
        """Values X (n, k) of some factors coded -1 to +1 over their ranges."""
        return region.coded(self._part(names), X)

    def grid(self, names: Sequence[str], steps: int) -> Array:
        """Grid over the ranges of some factors, ``steps`` values of each, shape (steps^k, k)."""
        part = self._part(names)
        U = np.array(list(product(np.linspace(-1, 1, steps), repeat=len(names))))
        terms = part["centre"] + U * part["half_range"]
        with np.errstate(over="ignore"):
            return np.asarray(np.where(part["logs"], np.exp(terms), terms), dtype=float)

    def _part(self, names: Sequence[str]) -> dict[str, Any]:
        at = [self.factors.index(name) for name in names]
        ends = {"centre": np.array(self.centre)[at], "half_range": np.array(self.half_range)[at]}
        return {"logs": self.logs_of(names), **ends}

    def with_factors(self, values: Mapping[str, Array]) -> "DesignRegion":
        """The region with further factors in the ranges of their values, coded in logarithms where others are."""
        added = self
        for name, x in values.items():
            log = bool(np.any(self.logs) and (x > 0).all())
            low, high = (float(np.log(end) if log else end) for end in (x.min(), x.max()))
            added = replace(
                added,
                factors=(*added.factors, name),
                units=(*added.units, ROLES[name].unit),
                logs=(*added.logs_of(added.factors), log),
                centre=(*added.centre, (low + high) / 2),
                half_range=(*added.half_range, (high - low) / 2),
            )
        return added

    def _beyond(self, x: Array) -> list[str]:
        """Factors outside their own range."""
        u, ends = region.coded(self.facts(), x), np.add.outer([-1.0, 1.0], np.zeros(len(x))) * self.half_range
        low, high = np.where(self.logs, np.exp(ends + self.centre), ends + self.centre)
        return [
            f"{name} {x[j]:.4g} {self.units[j]} {'above' if u[j] > 0 else 'below'} the {low[j]:.4g} to "
            f"{high[j]:.4g} that was cut"
            for j, name in enumerate(self.factors)
            if abs(u[j]) > 1 + region.ROUNDING
        ]

    def _values(self, points: Points) -> tuple[Array, ArrayLike | None]:
        """Factors, shape (n, k), and levels of the category."""
        table = as_table(self.response, points)
        needed = (*self.factors, *([self.by] if self.by else []))
        missing = [name for name in needed if name not in table]
        if missing:
            have = ", ".join(map(str, table)) or "nothing"
            raise FitError(f"the domain of {self.response} needs {', '.join(missing)}; given: {have}.")
        X = table[list(self.factors)].to_numpy(dtype=float)
        logs = np.broadcast_to(self.logs, len(self.factors))
        bad = ~np.isfinite(X) | ((X <= 0) & logs)
        if bad.any():
            j = int(np.argmax(bad.any(axis=0)))
            wanted = "above zero" if logs[j] else "that are finite"
            raise FitError(
                f"{self.factors[j]} {X[bad[:, j], j][0]:g}: the domain of {self.response} needs numbers {wanted}."
            )
        if self.by is None:
            return X, None
        return X, level_names(table[self.by], self.levels, self.by)


def _on_own_scale(formula: LawForm, X: Array) -> Array:
    """Factors X (n, k), those that the law takes the logarithm of as logarithms."""
    return np.column_stack([np.log(x) if log else x for x, log in zip(X.T, formula.logs, strict=True)])


def design_region(
    formula: LawForm,
    X: Array,
    shifts: Array,
    edge: Texts | None,
    by: By | None,
    units: Mapping[str, str],
) -> DesignRegion:
    """The region of the rows that a law was fitted to, factors X (n, k) and indicator columns ``shifts`` (n, s).

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> law.region.inside({"V": [100, 200], "f": [0.2, 0.6], "d": [2, 3], "t": 8}).tolist()
    [True, False]
    """
    T = _on_own_scale(formula, X)
    low, high = T.min(axis=0), T.max(axis=0)
    free = np.array(formula.estimated)[1:] if formula.first_order else np.full(len(low), True)
    # a fixed factor may be constant: then it was tested at that value alone
    centre, half = (low + high) / 2, np.where(high > low, (high - low) / 2, np.where(free, 1.0, ONE_VALUE))
    keep = _selected_rows(T, edge)
    U, shifts = (T[keep] - centre) / half, shifts[keep]
    columns = np.hstack([np.ones((len(U), 1)), U, shifts])
    level = (shifts @ np.arange(1, 1 + shifts.shape[1])).astype(np.intp)
    return DesignRegion(
        response=formula.response,
        factors=formula.factors,
        units=tuple(units.get(name, "") for name in formula.factors),
        logs=formula.logs if len(set(formula.logs)) > 1 else formula.log_factors,
        centre=tuple(centre.tolist()),
        half_range=tuple(half.tolist()),
        largest_radius=float(np.linalg.norm(U, axis=1).max()),
        by=None if by is None else by.column,
        levels=() if by is None else (by.reference, *by.levels),
        spaces=_spaces(columns, level, None if edge is None else edge[keep], np.append(True, free)),
    )


def _selected_rows(T: Array, edge: Texts | None) -> Ints:
    """Positions of all rows; of very many an even selection with a row of every edge and the ends of every factor.

    The region compares leverage with the largest of the design, so that an even choice draws the same region.
    """
    n = len(T)
    if n <= MOST_ROWS:
        return np.arange(n)
    none = np.empty(0, dtype=np.intp)
    first = none if edge is None else np.unique(pd.factorize(edge)[0], return_index=True)[1]
    ends = [*T.argmin(axis=0), *T.argmax(axis=0)]
    return np.unique(np.concatenate([np.arange(0, n, -(-n // MOST_ROWS)), first, ends]).astype(np.intp))


def _spaces(columns: Array, level: Ints, edge: Texts | None, free: Flags) -> tuple[ColumnSpace, ...]:
    """Edge settings where columns change between edges only, and rows where columns change within edges.

    Fixed factors have no leverage; ``free`` has the columns of the constant and of the factors.
    """
    every = np.flatnonzero(np.append(free, np.ones(columns.shape[1] - len(free), dtype=bool)))
    if edge is None:
        return (_space("rows", columns, every, level),)
    _, first, number = np.unique(edge, return_index=True, return_inverse=True)
    between = every[~changes_within(columns[:, every], number)]
    spaces = [_space("edge settings", columns[first], between, level[first])] if len(between) > 1 else []
    if len(between) < len(every):
        spaces.append(_space("rows", columns, every, level))
    return tuple(spaces)


def _space(of: str, columns: Array, which: Ints, level: Ints) -> ColumnSpace:
    Z = columns[:, which]
    M = linear(Z, np.zeros(len(Z))).cov_unscaled
    h = np.einsum("ij,jk,ik->i", Z, M, Z)
    largest = [float(h[level == j].max(initial=0.0)) or float(h.max()) for j in range(int(level.max()) + 1)]
    return ColumnSpace(of, tuple(int(j) for j in which), tuple(map(tuple, M.tolist())), tuple(largest))


def inflation(U: Array) -> Array:
    """Variance inflation of each column of coded settings U (n, k), shape (k,): ``1 / (1 - R2)`` on the others.

    Examples
    --------
    >>> inflation(np.array([[-1.0, -1], [1, 1], [-1, 1], [1, -1]])).round(6).tolist()
    [1.0, 1.0]
    """
    if U.shape[1] < 2:
        return np.ones(U.shape[1])
    R = np.asarray(np.corrcoef(U, rowvar=False), dtype=float)
    return np.asarray(np.diag(np.linalg.inv(R + EXACT * np.eye(U.shape[1]))), dtype=float)


def in_box(names: Sequence[str], cut: Array, X: Array) -> Flags:
    """Whether settings X (n, k) lie within the range of each column of the cut ones, and load the tool no more.

    Neither the cross-section of the chip (the product of feed, depth and width) nor its product with the speed may be
    larger than in the settings cut.

    Examples
    --------
    >>> in_box(["V", "f"], np.array([[100, 0.4], [250, 0.1]]), np.array([[100, 0.1], [250, 0.4]])).tolist()
    [True, False]
    """
    low, high = cut.min(axis=0), cut.max(axis=0)
    slack = region.ROUNDING * np.maximum(np.abs(low), np.abs(high))
    held = ((low - slack <= X) & (high + slack >= X)).all(axis=1)
    for load in (CHIP, SETTABLE):
        of_load = [j for j, name in enumerate(names) if name in load]
        held &= X[:, of_load].prod(axis=1) <= cut[:, of_load].prod(axis=1).max() * (1 + region.SLACK)
    return np.asarray(held)
