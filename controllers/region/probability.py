"""Probability that a pair of V and f keeps its limits, and the best pair at a required probability.

The search for the best pair uses ``s = ln V + ln f`` (the removal rate) and ``u = ln f - ln V``: on each ray of equal u
the probability is evaluated over the machine's ranges, and the largest s that reaches the requirement is refined by
bisection. All pairs are evaluated with the same draws, so the result keeps its limits in exactly that share of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ...core.arrays import Array, Flags
from ...core.display import Plottable
from ...core.errors import DataError, UsageError
from .half_planes import TOUCH
from .operating_point import OperatingPoint, ln
from .sampled_laws import Kind, LimitSampling, sampling
from .visible import VisibleRegion, visible_region

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.sections.load_line import LimitsSection
    from .sampled_laws import LimitSampling
    from .visible import VisibleRegion


@dataclass(frozen=True, slots=True, repr=False)
class Feasibility(Plottable):
    """Probability that every limit of power, force and wear is kept, over V and f.

    Attributes
    ----------
    V, f : ndarray, shape (m,) and (n,)
        m/min and mm/rev, evenly over the machine's ranges.
    probability : ndarray, shape (n, m)
        A row for each f.
    kind : {"prediction", "mean"}
        Of one row of a new edge, or of the law itself (its median, where errors are multiplicative).
    region : VisibleRegion
        Of the same laws with their point estimates.
    sampling : LimitSampling
        The draws.
    sources : tuple of str
        Origin of the draws of each law.
    """

    V: Array
    f: Array
    probability: Array
    kind: Kind
    region: VisibleRegion
    sampling: LimitSampling
    sources: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of draws: a share of them is known to within ``sqrt(p (1 - p) / count)``."""
        return self.sampling.count

    @property
    def of(self) -> str:
        """The quantity that the probability refers to."""
        return "one row of a new edge" if self.kind == "prediction" else "the laws without the scatter of rows"

    def at(self, V: float, f: float) -> float:
        """Probability that a pair keeps every limit."""
        return float(self.sampling.keeps(ln(V, f)[None])[0])

    def risks(self, V: float, f: float) -> dict[str, float]:
        """Marginal probability that a pair exceeds each limit, by response."""
        return self.sampling.risks(ln(V, f))

    def best(self, probability: float = 0.95) -> OperatingPoint:
        """The pair of greatest MRR among those that keep every limit with this probability.

        Raises
        ------
        UsageError
            The probability is not between 0 and 1.
        DataError
            No pair reaches it.
        """
        return best_at_probability(self.region, self.sampling, probability)


def feasibility(
    pf: "ParameterFile",
    *,
    draws: "Mapping[str, Draws] | None" = None,
    limits: "LimitsSection | Mapping[str, Any] | None" = None,
    d: float = 2.5,
    t: float = 10.0,
    by: str | None = None,
    at: Mapping[str, float] | None = None,
    kind: Kind = "prediction",
    grid: tuple[int, int] = (60, 60),
    most: int | None = None,
    seed: int = 1,
) -> Feasibility:
    """Compute the probability that each pair of V and f keeps the limits.

    Parameters
    ----------
    pf, limits, d, t, by, at
        As in `visible_region`.
    draws : mapping of str to Draws, optional
        Of each law, as `fitmodels.parameters.read_draws` gives them. A law without draws is drawn from its covariance;
        one without that is taken as exactly known, see ``sources``.
    kind : {"prediction", "mean"}
        Of one row of a new edge, with its scatter, or of the laws themselves.
    grid : tuple of int
        Points along V and f.
    most : int, optional
        Largest number of draws used; by default 2000, where a law is no power law 1000.
    seed : int
        Of the pairing of draws, and of the scatter.

    Raises
    ------
    UsageError
        As `visible_region`; draws of another law; a law without residual standard error.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> chance = feasibility(published("AC-2016"), grid=(12, 12))
    >>> chance.at(154.7, 0.53) < 0.3 < 0.9 < chance.at(100.0, 0.3)
    True
    """
    if kind not in get_args(Kind):
        raise UsageError(f"kind={kind!r}: give 'prediction', of a new edge, or 'mean', of the laws themselves.")
    if min(grid) < 2 or (most is not None and most < 1):
        raise UsageError(f"grid {grid} with {most} draws: give at least 2 points along V and f, and one draw.")
    region = visible_region(pf, limits=limits, d=d, t=t, by=by, at=at)
    drawn = sampling(region, draws or {}, kind, most or (MOST[1] if region.curved else MOST[0]), seed)
    low, high = np.exp(region.box.low), np.exp(region.box.high)
    V, f = (np.linspace(low[i], high[i], grid[i]) for i in (0, 1))
    x = np.log(np.stack(np.meshgrid(V, f), axis=-1).reshape(-1, 2))
    return Feasibility(
        V=V,
        f=f,
        probability=drawn.keeps(x).reshape(len(f), len(V)),
        kind=kind,
        region=region,
        sampling=drawn,
        sources=tuple(each.words for each in drawn.laws.values()),
    )


MOST = (2000, 1000)  # draws: of planes, and of laws that are evaluated at every point
ROUNDS = (
    (161, 41),
    (41, 9),
    (41, 9),
    (41, 9),
)  # rays, and pairs along each: fine first, as the contours by draws are not smooth
HALVINGS = 24  # of a step along a ray: one part in 10^8
NEXT = 1.5  # steps between rays kept on each side of the best


def best_at_probability(region: "VisibleRegion", sampling: "LimitSampling", probability: float) -> OperatingPoint:
    """The pair with the greatest MRR among those that keep every limit with this probability."""
    if not 0 < probability < 1:
        raise UsageError(f"probability = {probability:g}: give a value between 0 and 1, such as 0.95.")
    low, high = region.box.low, region.box.high
    u0, u1 = float(low[1] - high[0]), float(high[1] - low[0])
    best: tuple[float, float] | None = None
    for rays, along in ROUNDS:
        u = np.linspace(u0, u1, rays)
        s = _farthest(region, sampling, u, along, probability)
        if np.isneginf(s).all():
            break
        i = int(np.argmax(s))
        if best is None or s[i] > best[0]:
            best = float(s[i]), float(u[i])
        half = NEXT * (u1 - u0) / (rays - 1)
        u0, u1 = max(best[1] - half, float(low[1] - high[0])), min(best[1] + half, float(high[1] - low[0]))
    if best is None:
        raise DataError(_unreachable(region, sampling, probability))
    x = np.clip(_pairs(np.array(best[0]), np.array(best[1])), low, high)
    return replace(region.at(*np.exp(x).tolist()), probability=float(sampling.keeps(x[None])[0]))


def _farthest(region: "VisibleRegion", sampling: "LimitSampling", u: Array, along: int, probability: float) -> Array:
    """The largest feasible s of each ray, shape of ``u``; minus infinity where none is."""
    low, high = region.box.low, region.box.high
    near = np.maximum(2 * low[0] + u, 2 * low[1] - u)
    far = np.maximum(np.minimum(2 * high[0] + u, 2 * high[1] - u), near)  # a rounding error at the ends
    S = near + np.linspace(0.0, 1.0, along)[:, None] * (far - near)
    allowed = _feasible(region, sampling, S, u, probability)
    last = along - 1 - np.argmax(allowed[::-1], axis=0)
    any_feasible, ray = allowed.any(axis=0), np.arange(len(u))
    inside, outside = S[last, ray], S[np.minimum(last + 1, along - 1), ray]
    for _ in range(HALVINGS):
        middle = (inside + outside) / 2
        kept = _feasible(region, sampling, middle, u, probability)
        inside, outside = np.where(kept, middle, inside), np.where(kept, outside, middle)
    return np.where(any_feasible, inside, -np.inf)


def _feasible(region: "VisibleRegion", sampling: "LimitSampling", s: Array, u: Array, probability: float) -> Flags:
    """Whether pairs are feasible, in the shape of ``s``."""
    x = _pairs(s, np.broadcast_to(u, s.shape)).reshape(-1, 2)
    return np.asarray((_machine(region, x) & (sampling.keeps(x) >= probability)).reshape(s.shape))


def _pairs(s: Array, u: Array) -> Array:
    """(ln V, ln f) from s and u."""
    return np.stack([(s - u) / 2, (s + u) / 2], axis=-1)


def _machine(region: "VisibleRegion", x: Array) -> Flags:
    """Whether the machine can be set to each pair."""
    own = [each for each in region.limits if each.symbol not in region.planes]
    return np.asarray(np.logical_and.reduce([each.beyond(x) <= TOUCH for each in own]))


def _unreachable(region: "VisibleRegion", sampling: "LimitSampling", probability: float) -> str:
    axes = [np.linspace(region.box.low[i], region.box.high[i], 72) for i in (0, 1)]
    x = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    x = x[_machine(region, x)]
    if not len(x):
        return region.conflict or "the machine's own limits leave no pair of V and f."
    keeps = sampling.keeps(x)
    V, f = np.exp(x[int(np.argmax(keeps))])
    return (
        f"no pair of V and f keeps the limits with probability {probability:g}: the most is {keeps.max():.3g}, at V "
        f"{V:.4g} m/min and f {f:.4g} mm/rev; require less, or raise a limit."
    )


def best_point(
    pf: "ParameterFile",
    *,
    limits: "LimitsSection | Mapping[str, Any] | None" = None,
    d: float = 2.5,
    t: float = 10.0,
    by: str | None = None,
    at: Mapping[str, float] | None = None,
    probability: float | None = None,
    draws: "Mapping[str, Draws] | None" = None,
    kind: "Kind" = "prediction",
    seed: int = 1,
) -> OperatingPoint:
    """Find the pair of V and f of greatest metal removal rate within the limits.

    Without a ``probability`` the point estimates of the laws are used, and the result is exact: a corner of the region.
    A point on a limit then exceeds it about every second time; with a probability, it keeps all limits that often.

    Parameters
    ----------
    pf, limits, d, t, by, at
        As in `visible_region`.
    probability : float, optional
        Required probability of keeping all limits of power, force and wear at once, between 0 and 1.
    draws, kind, seed
        As in `feasibility`.

    Returns
    -------
    OperatingPoint

    Raises
    ------
    UsageError
        As `visible_region`; or draws without a probability.
    DataError
        The limits exclude each other, or no pair reaches the probability; the message gives the greatest one.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> best = best_point(published("AC-2016"))
    >>> round(best.V, 1), round(best.f, 3), best.held_by
    (147.9, 0.53, ('P 7 kW', 'Fxz 1300 N'))
    """
    if probability is None:
        if draws is not None:
            raise UsageError("draws given without a probability of keeping the limits: add probability=0.95.")
        return visible_region(pf, limits=limits, d=d, t=t, by=by, at=at).best

    found = feasibility(pf, draws=draws, limits=limits, d=d, t=t, by=by, at=at, kind=kind, seed=seed)
    return found.best(probability)
