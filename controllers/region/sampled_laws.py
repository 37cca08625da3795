"""Laws sampled from their draws over ln V and ln f, with the deviation of a new edge for each draw.

A row of a new edge deviates from the law with standard deviation ``sd / sqrt(1 - icc)``, between and within edges
together. The deviation of its wear propagates into power and force. Assumed: given the data, the laws are independent,
so their draws are paired at random (draws of one seed share their random numbers and would appear correlated); and the
deviations of wear, power and force of a row are independent.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Flags
from ...core.display import Displayable
from ...core.errors import UsageError
from ...datasets.simulation import weibull_deviation
from ...parameters.sections.base import Covariance
from .log_planes import LogPlane, plane, ratio, with_wear
from .surfaces import LawSurface, RegionLimit

if TYPE_CHECKING:
    from ...parameters import LawSection
    from ...parameters.draws import Draws
    from .visible import VisibleRegion

Kind = Literal["prediction", "mean"]
TINY = 1e-300  # replaces a response that an additive error makes negative: far below any limit
AT_ONCE = 1_000_000  # evaluations at a time, draws times points: 8 MB


@dataclass(frozen=True, slots=True, repr=False)
class SampledLaw(Displayable):
    """A law by S draws.

    Attributes
    ----------
    plane : LogPlane
        Its numbers of shape (S,).
    deviation : ndarray, shape (S,)
        Deviation of a row of a new edge from the law: in logarithms, or in the response's unit where it
        ``adds``.
    adds : bool
    words : str
        Origin of the draws.
    """

    plane: LogPlane
    deviation: Array
    adds: bool
    words: str

    @property
    def takes_wear(self) -> bool:
        """Whether the wear of its own law is a factor that is not substituted."""
        return bool(self.plane.wear_power.any())

    def ln(self, x: Array, ln_wear: Array | None, rows: slice) -> Array:
        """Logarithm of the response of some draws at points (G, 2), shape (s, G)."""
        p = self.plane
        constant = p.intercept if self.adds else p.intercept + self.deviation
        # one product: draws times pairs are millions, and each pass over them costs as much as the rest
        eta = np.column_stack([constant, p.slopes])[rows] @ np.vstack([np.ones(len(x)), x.T])
        if ln_wear is not None:
            eta += p.wear_power[rows, None] * ln_wear
        return np.log(np.maximum(np.exp(eta) + self.deviation[rows, None], TINY)) if self.adds else eta


@dataclass(frozen=True, slots=True, repr=False)
class SampledSurface(Displayable):
    """A law that is no plane in ln V and ln f by S draws: as `SampledLaw`, evaluated at every point.

    Attributes
    ----------
    surface : LawSurface
    theta : ndarray, shape (S, p)
    deviation, adds, words
        As in `SampledLaw`.
    """

    surface: LawSurface
    theta: Array
    deviation: Array
    adds: bool
    words: str

    @property
    def takes_wear(self) -> bool:
        """Whether the wear of its own law is a factor."""
        return self.surface.wear is not None

    def ln(self, x: Array, ln_wear: Array | None, rows: slice) -> Array:
        """Logarithm of the response of some draws at points (G, 2), shape (s, G)."""
        surface, place = self.surface, self.surface.wear_place
        drawn = None
        if surface.wear is not None and ln_wear is not None and place is not None:
            drawn = np.exp(ln_wear) * ratio(surface.wear.unit, surface.law.factors[place].unit)
        values = surface.equation.sampled(surface.points(x), self.theta[rows], drawn, place or 0)
        off = self.deviation[rows, None]
        return np.log(np.maximum(values + off if self.adds else values * np.exp(off), TINY))


@dataclass(frozen=True, slots=True, repr=False)
class LimitSampling(Displayable):
    """Laws by draws, and the limits on them: symbol, side and logarithm of the value in the unit of the law.

    ``wear`` is set where the wear must be evaluated at every point, because its errors are additive or a law is no
    power law.
    """

    laws: Mapping[str, SampledLaw | SampledSurface]
    limits: tuple[tuple[str, str, float], ...]
    wear: SampledLaw | SampledSurface | None
    count: int

    def keeps(self, x: Array) -> Array:
        """Share of draws that keep every limit at points (G, 2), shape (G,)."""
        total = np.zeros(len(x))
        for rows in self._blocks(len(x)):
            over = list(self._over(x, rows).values())
            total += np.logical_or.reduce(over).sum(axis=0) if over else 0
        return np.asarray((self.count - total) / self.count)

    def risks(self, x: Array) -> dict[str, float]:
        """Share of draws over each limit at one point (2,)."""
        over = self._over(x[None], slice(0, self.count))
        return {name: float(each.mean()) for name, each in over.items()}

    def _over(self, x: Array, rows: slice) -> dict[str, Flags]:
        ln_wear = None if self.wear is None else self.wear.ln(x, None, rows)
        over: dict[str, Flags] = {}
        for name, side, limit in self.limits:
            ln = self.laws[name].ln(x, ln_wear if self.laws[name].takes_wear else None, rows)
            beyond = ln > limit if side == "most" else ln < limit
            over[name] = beyond | over[name] if name in over else beyond
        return over

    def _blocks(self, points: int) -> list[slice]:
        step = max(1, AT_ONCE // max(points, 1))
        return [slice(start, min(start + step, self.count)) for start in range(0, self.count, step)]


def sampling(region: "VisibleRegion", draws: "Mapping[str, Draws]", kind: Kind, most: int, seed: int) -> LimitSampling:
    """Sample the laws of a region's limits: ``most`` draws, or as many as every law has.

    Raises
    ------
    UsageError
        Draws of other parameters than the law's, or no residual standard error for a new edge.
    """
    count = min([most, *(len(draws[name].values) for name in region.laws if name in draws)])
    rng = np.random.default_rng(seed)
    wear_law = None if region.wear is None else region.laws[region.wear]
    laws: dict[str, SampledLaw | SampledSurface] = {}
    for name in sorted(region.laws):  # independent of the order in the file
        wear = None if name == region.wear else wear_law
        laws[name] = _sampled(region, region.laws[name], wear, draws.get(name), kind, count, rng)
    wear_drawn = None if region.wear is None else laws[region.wear]
    everywhere = wear_drawn is not None and (
        any(isinstance(law, SampledSurface) for law in laws.values())
        or (wear_drawn.adds and wear_drawn.deviation.any())
    )
    if isinstance(wear_drawn, SampledLaw) and not everywhere:
        laws = _substituted(laws, wear_drawn)
    limits = tuple(
        (each.symbol, each.side, log(each.value * ratio(each.unit, region.planes[each.symbol].unit)))
        for each in region.limits
        if not isinstance(each, RegionLimit) and each.symbol in region.planes
    )
    return LimitSampling(laws, limits, wear_drawn if everywhere else None, count)


def _substituted(
    laws: Mapping[str, SampledLaw | SampledSurface], wear: SampledLaw
) -> dict[str, SampledLaw | SampledSurface]:
    """Planes with the wear of each draw put in."""
    off = replace(wear.plane, intercept=wear.plane.intercept + (0 if wear.adds else wear.deviation))
    return {
        name: replace(law, plane=with_wear(law.plane, off)) if isinstance(law, SampledLaw) and law is not wear else law
        for name, law in laws.items()
    }


def _sampled(
    region: "VisibleRegion",
    law: "LawSection",
    wear: "LawSection | None",
    draws: "Draws | None",
    kind: Kind,
    count: int,
    rng: np.random.Generator,
) -> SampledLaw | SampledSurface:
    if draws is not None:
        of, sd, heavy = _from_draws(law, draws, rng.permutation(len(draws.values))[:count])
        words = f"{law.response} by {count} of {len(draws.values)} draws"
    else:
        of, words = _from_covariance(law, count, rng)
        sd, heavy = (_scatter(law) if kind == "prediction" else np.zeros(1)), None
    z = rng.standard_normal(count)
    weibull = law.life is not None and law.life.distribution == "weibull"
    z = weibull_deviation(z) * law.life.scale if weibull and law.life is not None else z * sd
    if heavy is not None:
        z *= np.sqrt(heavy / rng.chisquare(heavy))
    off, adds, surface = (
        z if kind == "prediction" else np.zeros(count),
        law.error == "additive",
        region.planes[law.response],
    )
    if law.form != "power":
        assert isinstance(surface, LawSurface)  # noqa: S101  only power laws are planes
        return SampledSurface(surface, of, off, adds, words)
    return SampledLaw(plane(law, region.setting, wear, of), off, adds, words)


def sampled_parameters(law: "LawSection", draws: "Draws | None", count: int, rng: np.random.Generator) -> Array:
    """Parameters of a law, shape (count, p): from its draws, or from its covariance where it has none."""
    if draws is None:
        return _from_covariance(law, count, rng)[0]
    return _from_draws(law, draws, rng.permutation(len(draws.values))[:count])[0]


def _from_draws(law: "LawSection", draws: "Draws", rows: NDArray[np.int64]) -> tuple[Array, Array, Array | None]:
    """Parameters (S, p), sd of a row of a new edge (S,), degrees of freedom of heavy tails (S,) or None."""
    column = dict(zip(draws.names, draws.values[rows].T, strict=True))
    if lacking := [name for name in (*law.parameter_names, "sd") if name not in column]:
        raise UsageError(
            f"the draws of {law.response} are of {', '.join(draws.names)} and lack {lacking[0]}: they belong to "
            "another fit; draw again."
        )
    within = 1 - np.minimum(column["icc"], 1 - 1e-12) if "icc" in column else 1.0
    return (
        np.stack([column[name] for name in law.parameter_names], axis=-1),
        column["sd"] / np.sqrt(within),
        column.get("nu"),
    )


def _from_covariance(law: "LawSection", count: int, rng: np.random.Generator) -> tuple[Array, str]:
    """Parameters (S, p) from the file's covariance as a multivariate t; the estimates where it has none."""
    centre, held = law.theta, law.uncertainty
    if not isinstance(held, Covariance):
        return np.broadcast_to(centre, (count, len(centre))), f"{law.response} as if exactly known ({held.reason})"
    order = [held.of.index(name) for name in law.parameter_names]
    C = np.array(held.matrix)[np.ix_(order, order)]
    z = rng.multivariate_normal(np.zeros(len(centre)), C, size=count, method="eigh", check_valid="ignore")
    heavy = np.sqrt(held.df / rng.chisquare(held.df, count))
    return centre + z * heavy[:, None], f"{law.response} by its covariance (no draws of it)"


def _scatter(law: "LawSection") -> Array:
    """Standard deviation of a row of a new edge about the law, shape (1,)."""
    if law.deviations:
        return np.array([np.hypot(*law.deviations)])
    if law.residual_se is None:
        raise UsageError(
            f"the law of {law.response} has no residual standard error, so the scatter of a new edge is unknown; use "
            "kind='mean' for the law itself."
        )
    return np.array([law.residual_se])
