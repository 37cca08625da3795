"""Canonical analysis of a second-order surface: stationary point, curvatures and their directions, ridge paths.

Factors are coded -1 to +1 over their tested ranges (in logarithms where the law takes them),
``eta = b0 + b'u + u'B u``. The stationary point is ``-B^-1 b / 2``; eigenvalues of B are the curvatures along its
eigenvectors, each what the surface changes one half range from the stationary point. Their standard errors are those
of ``q'B q`` at the estimated directions. A curvature whose interval contains zero makes a ridge, along which no
optimum can be given.

Sources: Box & Wilson 1951, J. R. Stat. Soc. B 13, 1; Carter, Chinchilli & Campbell 1990, Technometrics 32, 425
(intervals of the curvatures); Box & Hunter 1954, Biometrika 41, 190 (confidence region of the stationary point);
Draper 1963, Technometrics 5, 469 (ridge paths).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Literal, get_args

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags
from ...core.display import Plottable
from ...core.rounding import format_plain
from ..available import NotAvailable
from ..lawfit import LawFit
from .split_plot import EdgeModel

Shape = Literal["minimum", "maximum", "saddle", "ridge"]
Side = Literal["lowest", "highest"]

SIDES: tuple[Side, ...] = get_args(Side)

SINGULAR = 1e-10  # of the largest curvature: a smaller one leaves the stationary point undefined
LEVEL = 0.95
BORDER_POINTS = 300  # of the tested region, at which the surface is tested to be level
STEPS = 20  # of a ridge path


@dataclass(frozen=True, slots=True, repr=False)
class CanonicalAnalysis(Plottable):
    """Canonical analysis of a surface over some factors, the others held.

    Attributes
    ----------
    response, unit : str
    factors : tuple of str, length k
    held : mapping of str to float
        Values of the other factors, in their units.
    b : ndarray, shape (k,)
    B : ndarray, shape (k, k)
        Slopes at the middle of the ranges, and curvatures, in coded factors, on the scale of the fit.
    stationary : mapping of str to float, or None
        Stationary point in the units of the factors; None where some curvature is zero.
    coded : ndarray, shape (k,)
        The same in coded factors; NaN where it is not defined.
    value : float or None
        Response there.
    eigenvalues : ndarray, shape (k,)
        Curvatures, largest first.
    low, high : ndarray, shape (k,)
        Their 95 % intervals.
    directions : ndarray, shape (k, k)
        Eigenvectors as columns.
    shape : {"minimum", "maximum", "saddle", "ridge"}
        ``ridge`` where the interval of some curvature contains zero.
    inside : bool
        Whether the stationary point lies in the tested region.
    bounded : bool
        Whether the 95 % confidence region of the stationary point ends within the tested ranges.
    paths : DataFrame
        Ridge paths: for each coded radius the lowest and the highest response on that sphere, ``side``, ``radius``,
        the factors, the response and ``inside``.
    log_response : bool
        Whether the scale of the fit is the logarithm of the response.
    """

    response: str
    unit: str
    factors: tuple[str, ...]
    held: Mapping[str, float]
    b: Array
    B: Array
    stationary: Mapping[str, float] | None
    coded: Array
    value: float | None
    eigenvalues: Array
    low: Array
    high: Array
    directions: Array
    shape: Shape
    inside: bool
    bounded: bool
    paths: pd.DataFrame
    log_response: bool

    @property
    def distance(self) -> float:
        """Coded distance of the stationary point from the middle of the ranges; infinite where there is none."""
        return float(np.linalg.norm(self.coded)) if np.isfinite(self.coded).all() else float("inf")

    @property
    def optimum(self) -> bool:
        """Whether the surface has a proven minimum or maximum inside the tested region."""
        return self.shape in ("minimum", "maximum") and self.inside and self.bounded

    def best(self, side: Side) -> "pd.Series[float] | None":
        """Point of lowest or highest response on its path inside the tested region; None where it has none there."""
        path = self.paths[(self.paths["side"] == side) & self.paths["inside"]]
        if path.empty:
            return None
        at = int(path[self.response].argmin() if side == "lowest" else path[self.response].argmax())
        return path[[*self.factors, self.response]].iloc[at].astype(float)

    @property
    def verdict(self) -> str:
        """The kind of surface, and whether an optimum can be given."""
        over = ", ".join(self.factors)
        if self.stationary is None:
            return f"{self.response} has no stationary point over {over}: a plane or an exact ridge, no optimum."
        at = ", ".join(f"{name} {format_plain(value, 3)}" for name, value in self.stationary.items())
        if not self.inside:
            return (
                f"{self.shape.capitalize()} outside the tested region (stationary point at coded distance "
                f"{format_plain(self.distance, 3)} from its middle): {self.response} has no optimum over {over} within "
                "the tests, the best point lies on the border."
            )
        if self.shape == "saddle":
            return f"Saddle at {at}: {self.response} rises in one direction and falls in another, no optimum."
        if self.shape == "ridge":
            along = self.direction_words(int(np.argmin(np.abs(self.eigenvalues))))
            return (
                f"Ridge: along {along} {self.response} changes too little for these tests to place an optimum "
                f"(estimated stationary point {at})."
            )
        value = format_plain(self.value or 0.0, 3)
        found = f"{self.shape.capitalize()} of {self.response}, {value} {self.unit}".rstrip() + f", at {at}"
        return (
            f"{found}, inside the tested region."
            if self.bounded
            else f"{found}; but its 95 % confidence region reaches the ends of the tested ranges: not proven."
        )

    def direction_words(self, j: int) -> str:
        """Direction of curvature j in words: factors that move, with their signs."""
        q = self.directions[:, j] * np.sign(self.directions[np.argmax(np.abs(self.directions[:, j])), j])
        moving = [(name, v) for name, v in zip(self.factors, q, strict=True) if abs(v) > 0.3]
        return " and ".join(f"{name} {'up' if v > 0 else 'down'}" for name, v in moving)


def stationary_point(b: Array, B: Array) -> Array:
    """The point at which ``b'u + u'B u`` is level, shape (k,); NaN where B is singular.

    Examples
    --------
    >>> stationary_point(np.array([2.0, 0.0]), np.array([[-1.0, 0.0], [0.0, -2.0]])).tolist()
    [1.0, 0.0]
    """
    values, Q = np.linalg.eigh(B)
    if np.abs(values).min() <= SINGULAR * max(np.abs(values).max(), 1e-300):
        return np.full(len(b), np.nan)
    return np.asarray(-0.5 * Q @ ((Q.T @ b) / values))


def ridge_point(b: Array, B: Array, radius: float, side: Side) -> Array:
    """The point of lowest or highest ``b'u + u'B u`` at this distance from the origin, shape (k,).

    Examples
    --------
    >>> ridge_point(np.array([1.0, 0.0]), np.zeros((2, 2)), 0.5, "highest").round(9).tolist()
    [0.5, 0.0]
    """
    from scipy.optimize import brentq

    sign = 1.0 if side == "lowest" else -1.0
    values, Q = np.linalg.eigh(sign * B)
    slope = sign * Q.T @ b
    if radius <= 0:
        return np.zeros(len(b))
    scale = max(float(np.abs(values).max()), float(np.abs(slope).max()), 1e-300)
    tiny = 1e-12 * scale

    def point(gap: float) -> Array:
        """Solution with multiplier ``values[0] - gap``, in the eigenvectors."""
        return np.asarray(-0.5 * slope / (values - values[0] + gap))

    if np.linalg.norm(point(tiny)) <= radius:  # the slope has no part along the lowest curvature: either way is as good
        u = point(tiny)
        u[0] = np.sqrt(max(radius**2 - float(u[1:] @ u[1:]), 0.0))
        return np.asarray(Q @ u)
    widest = float(np.linalg.norm(slope)) / radius + tiny
    gap = brentq(lambda g: float(np.linalg.norm(point(g))) - radius, tiny, widest, xtol=1e-15 * scale, rtol=1e-13)
    return np.asarray(Q @ point(float(gap)))


@dataclass(frozen=True, slots=True)
class CodedSurface:
    """A fitted surface in coded factors, linear in its coefficients.

    Attributes
    ----------
    model : EdgeModel
        Of the rows, with ``beta``.
    slopes : ndarray, shape (k, p)
        ``b`` is this times beta.
    curvatures : ndarray, shape (k, k, p)
        ``B`` is this times beta.
    """

    model: EdgeModel
    slopes: Array
    curvatures: Array

    @property
    def b(self) -> Array:
        """Slopes at the middle, shape (k,)."""
        return np.asarray(self.slopes @ self.model.beta)

    @property
    def B(self) -> Array:
        """Curvatures, shape (k, k)."""
        return np.asarray(self.curvatures @ self.model.beta)

    def curvature_interval(self, q: Array) -> tuple[float, float, float]:
        """Curvature along a direction q of length one, and its 95 % interval."""
        from scipy.special import stdtrit

        c = np.einsum("i,ijp,j->p", q, self.curvatures, q)
        if not np.abs(c).max() > 0:
            return 0.0, 0.0, 0.0
        value, se, df = self.model.estimate(c)
        half = float(stdtrit(df, (1 + LEVEL) / 2)) * se
        return value, value - half, value + half

    def may_be_level(self, u: Array) -> bool:
        """Whether the 95 % confidence region of the stationary point contains u."""
        J = self.slopes + 2 * np.einsum("ijp,j->ip", self.curvatures, u)
        return self.model.tested(J)[1] > 1 - LEVEL


def coded_surface(
    model: EdgeModel, degrees: Array, over: list[int], middle: Array, half: Array, held: Array
) -> CodedSurface:
    """The surface over factors ``over``, coded about ``middle`` by ``half``, from terms in centred factors.

    Parameters
    ----------
    model : EdgeModel
        Columns: the constant, one for each term, then blocks.
    degrees : ndarray of int, shape (m, K)
        Power of each of K factors in the m terms.
    middle, half, held : ndarray, shape (K,)
        In centred factors: middle and half width of the ranges, and the values of the factors that are held.
    """
    p, K = len(model.beta), degrees.shape[1]
    slopes, curvatures = np.zeros((K, p)), np.zeros((K, K, p))
    at = np.where(np.isin(np.arange(K), over), middle, held)
    for m, powers in enumerate(degrees):
        moving = [j for j in range(K) for _ in range(int(powers[j]))]
        if len(moving) == 1:
            slopes[moving[0], 1 + m] += half[moving[0]]
        elif len(moving) == 2:
            i, j = moving
            slopes[i, 1 + m] += half[i] * at[j]
            slopes[j, 1 + m] += half[j] * at[i]
            curvatures[i, j, 1 + m] += half[i] * half[j] / 2
            curvatures[j, i, 1 + m] += half[i] * half[j] / 2
    return CodedSurface(model, slopes[over], curvatures[np.ix_(over, over)])


@dataclass(frozen=True, slots=True)
class _Coding:
    """The law over factors ``over`` coded -1 to +1 about ``middle`` by ``half``, the others at ``values``."""

    law: LawFit
    over: list[int]
    values: Array
    middle: Array
    half: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Factors that are coded."""
        return tuple(self.law.factors[j] for j in self.over)

    @property
    def radius(self) -> float:
        """Largest coded distance of the rows."""
        U = (self.law.formula.transformed(self.law.X) - self.middle) / self.half
        return float(np.linalg.norm(U[:, self.over], axis=1).max())

    def whole(self, u: Array) -> Array:
        """All factors in their units, shape (n, K), from coded factors (n, k)."""
        formula, X = self.law.formula, np.tile(self.values, (len(u), 1))
        for i, j in enumerate(self.over):
            x = self.middle[j] + self.half[j] * u[:, i]
            X[:, j] = formula.centres[j] * np.exp(x) if formula.logs[j] else formula.centres[j] + x
        return X

    def points(self, u: Array) -> dict[str, object]:
        """The same as points of the law, at the reference of its blocks."""
        columns: dict[str, object] = dict(zip(self.law.factors, self.whole(u).T, strict=True))
        by = self.law.by
        return columns if by is None else {**columns, by.column: by.reference}

    def predicted(self, u: Array) -> Array:
        """Response, shape (n,)."""
        return np.asarray(self.law.values(self.points(u)))

    def inside(self, u: Array) -> Flags:
        """Whether points lie in the tested region, shape (n,)."""
        return self.law.region.inside(self.points(u))


def analyse_surface(
    law: LawFit, model: EdgeModel | NotAvailable, held: Mapping[str, float]
) -> CanonicalAnalysis | NotAvailable:
    """Canonical analysis of a law of second order, with the model of its rows, over the factors that are not held."""
    if isinstance(model, NotAvailable):
        return model
    over = [j for j, name in enumerate(law.factors) if name not in held]
    formula = law.formula
    degrees = np.array([term.degrees for term in formula.terms])
    if not over or not (degrees[:, over].sum(axis=1) == 2).any():
        return NotAvailable(
            f"no square or product of {', '.join(law.factors[j] for j in over) or 'factors that are set'}"
        )
    U = formula.transformed(law.X)
    values = np.array([held.get(name, centre) for name, centre in zip(law.factors, formula.centres, strict=True)])
    coding = _Coding(law, over, values, (U.max(axis=0) + U.min(axis=0)) / 2, np.ptp(U, axis=0) / 2)
    at_values = formula.transformed(values[None, :])[0]
    return _analysed(coded_surface(model, degrees, over, coding.middle, coding.half, at_values), coding, held)


def _analysed(surface: CodedSurface, coding: _Coding, held: Mapping[str, float]) -> CanonicalAnalysis:
    b, B, law, names = surface.b, surface.B, coding.law, coding.names
    values, Q = np.linalg.eigh(B)
    order = np.argsort(-values)
    Q = Q[:, order]
    curvature = np.array([surface.curvature_interval(q) for q in Q.T])
    coded = stationary_point(b, B)
    known = bool(np.isfinite(coded).all())
    inside = known and bool(coding.inside(coded[None, :])[0])
    point = coding.whole(coded[None, :])[0, coding.over]
    return CanonicalAnalysis(
        response=law.response, unit=law.units.get(law.response, ""), factors=names, held=held, b=b, B=B,
        stationary=dict(zip(names, point.tolist(), strict=True)) if known else None,
        coded=coded, value=float(coding.predicted(coded[None, :])[0]) if known else None,
        eigenvalues=values[order], low=curvature[:, 1], high=curvature[:, 2], directions=Q,
        shape=_shape(curvature), inside=inside, bounded=inside and not _reaches_border(surface, len(b)),
        paths=_paths(b, B, coding), log_response=law.formula.logarithmic,
    )  # fmt: skip


def _shape(curvature: Array) -> Shape:
    """From curvatures with their ends, shape (k, 3)."""
    if (curvature[:, 1] > 0).all():
        return "minimum"
    if (curvature[:, 2] < 0).all():
        return "maximum"
    proven_up, proven_down = (curvature[:, 1] > 0).any(), (curvature[:, 2] < 0).any()
    return "saddle" if proven_up and proven_down else "ridge"


def _reaches_border(surface: CodedSurface, k: int) -> bool:
    """Whether the confidence region of the stationary point contains points of the border of the ranges."""
    across = max(2, int((BORDER_POINTS / (2 * k)) ** (1 / max(k - 1, 1))))
    grid = np.linspace(-1, 1, across)
    for j in range(k):
        for end in (-1.0, 1.0):
            for rest in product(grid, repeat=k - 1):
                if surface.may_be_level(np.insert(np.array(rest), j, end)):
                    return True
    return False


def _paths(b: Array, B: Array, coding: _Coding) -> pd.DataFrame:
    radii, parts, names = np.linspace(0.0, coding.radius, STEPS + 1), [], list(coding.names)
    for side in SIDES:
        u = np.array([ridge_point(b, B, float(r), side) for r in radii])
        factors = pd.DataFrame(coding.whole(u)[:, coding.over], columns=names)
        table = pd.DataFrame({"side": side, "radius": radii}).join(factors)
        parts.append(table.assign(**{coding.law.response: coding.predicted(u), "inside": coding.inside(u)}))
    return pd.concat(parts, ignore_index=True)
