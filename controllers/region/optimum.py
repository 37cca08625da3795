"""The best pair of V and f: the greatest metal removal rate that the limits allow."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...core.errors import UsageError
from .points import Point
from .visible import visible_region

if TYPE_CHECKING:
    from ...parameters import Draws, LimitsSection, ParameterFile
    from .probability import Kind


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
) -> Point:
    """Find the pair of V and f that removes most metal within the limits.

    Without a ``probability`` the laws are taken as they stand, and the answer is exact: a corner of the region. A
    point on a limit then exceeds it about every second time; with one, the pair keeps all limits that often.

    Parameters
    ----------
    pf, limits, d, t, by, at
        As in `visible_region`.
    probability : float, optional
        Demanded of keeping every limit of power, force and wear at once, between 0 and 1.
    draws, kind, seed
        As in `feasibility`.

    Returns
    -------
    Point

    Raises
    ------
    UsageError
        As `visible_region`; or draws without a probability.
    DataError
        The limits exclude each other, or no pair reaches the probability: the sentence says how near one comes.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> best = best_point(published("AC-2016"))
    >>> round(best.V, 1), round(best.f, 3), best.held_by
    (147.9, 0.53, ('P 7 kW', 'Fxz 1300 N'))
    """
    if probability is None:
        if draws is not None:
            raise UsageError("draws were given without a probability to keep the limits with: give probability=0.95.")
        return visible_region(pf, limits=limits, d=d, t=t, by=by, at=at).best
    from .probability import feasibility

    found = feasibility(pf, draws=draws, limits=limits, d=d, t=t, by=by, at=at, kind=kind, seed=seed)
    return found.best(probability)
