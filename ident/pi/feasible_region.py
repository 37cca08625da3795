"""Map over Kp and Ki: where a specification holds, and how much it is violated elsewhere."""

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.display import Plottable
from ..model import Model
from .figures_of_merit import MARGINS, specified_figures
from .gains import PiGains
from .specification import Specification, in_units
from .stability_region import DECADES_KI, GainRange, decades, gain_range, grid

COARSE = 24  # gains per side while the region is located
ROUNDS = 4
NEAR = 0.15  # of a limit: settling time is discontinuous, so that a coarse grid may miss the best point
LAGS, DELAYS, SAMPLES = 12.0, 20.0, (100, 4000)  # duration of steps where no time is specified
MOST = 6e7  # samples simulated for one map, weighted by the order of the loop: above it the map is coarser


@dataclass(frozen=True, slots=True, repr=False)
class FeasibleMap(Plottable):
    """Figures of merit over a grid of gains.

    Attributes
    ----------
    kp : ndarray, shape (P,)
    ki : ndarray, shape (I,), per second
    figures : dict of ndarray, each shape (P, I)
        As in `FiguresOfMerit`, by name.
    feasible : ndarray of bool, shape (P, I)
        Stable, and every limit met.
    worst : ndarray, shape (P, I)
        Largest relative violation; 0 where feasible, infinite where unstable.
    specification : Specification
    range : GainRange
        Largest stabilising gains of the model; the map covers the relevant part.
    duration : float
        Of the simulated steps, s.
    """

    kp: Array
    ki: Array
    figures: dict[str, Array]
    feasible: Flags
    worst: Array
    specification: Specification
    range: GainRange
    duration: float

    @property
    def any(self) -> bool:
        """Whether any gains on the map meet the specification."""
        return bool(self.feasible.any())


def map_in_units(found: FeasibleMap, factor: float) -> FeasibleMap:
    """The same map with the command in another unit, ``factor`` new units per old unit."""
    widest = GainRange(*(value * factor for value in (found.range.kp, found.range.ki)))
    return replace(
        found, kp=found.kp * factor, ki=found.ki * factor, figures=in_units(found.figures, factor),
        specification=found.specification.in_units(factor), range=widest,
    )  # fmt: skip


def feasible_map(
    model: Model,
    specification: Specification,
    template: PiGains | None = None,
    n: int = 200,
    *,
    duration: float | None = None,
    range_: GainRange | None = None,
) -> FeasibleMap:
    """Figures of merit of n x n loops over the gains where a specification holds, or is least violated.

    Parameters
    ----------
    model : Model
    specification : Specification
    template : PiGains, optional
        Controller apart from its gains; by default position form, backward rule, sample time of the model.
    n : int
        Gains per side, fewer for very long simulations.
    duration : float, optional
        Of the simulated steps, s; by default several times the specified times.
    range_ : GainRange, optional
        By default from the model.

    Returns
    -------
    FeasibleMap
        It contains the whole feasible region, or the surroundings of the best point.

    Raises
    ------
    IdentError
        No PI stabilises the model.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02)
    >>> found = feasible_map(model, Specification(rise_time=0.5, overshoot=0.02), n=50)
    >>> found.any, found.feasible.shape
    (True, (50, 50))
    """
    template = PiGains(0.0, 0.0, model.sample_time) if template is None else template
    widest = gain_range(model, template) if range_ is None else range_
    time = horizon(model, specification) if duration is None else duration
    kp, ki = region_limits(model, specification, template, widest, time)
    order = max(len(model.a), len(model.b)) + template.delay + template.average
    n = max(2, min(n, int(np.sqrt(MOST / (time / model.sample_time * (1 + order / 4))))))
    across, up = np.linspace(*kp, n), np.linspace(*ki, n)
    figures, worst = evaluate(model, specification, template, across, up, time, *MARGINS)
    return FeasibleMap(across, up, figures, worst <= 0, worst, specification, widest, time)


def evaluate(
    model: Model, specification: Specification, template: PiGains, kp: Array, ki: Array, duration: float, *more: str
) -> tuple[dict[str, Array], Array]:
    """FiguresOfMerit and largest violations of every pair, each shape (len(kp), len(ki)); see `specified_figures`."""
    table = specified_figures(model, *grid(kp, ki), template, duration, specification, *more)
    figures = {name: values.reshape(len(kp), len(ki)) for name, values in table.items()}
    return figures, specification.worst(figures)


def horizon(model: Model, specification: Specification) -> float:
    """Duration of simulated steps, s: several times the specified times, or lags and delay of the model."""
    times = [3 * (specification.settling_time or 0.0), 6 * (specification.rise_time or 0.0)]
    if max(times) > 0:
        return max(*times, 50 * model.sample_time)
    radii = np.abs([p for p in [*model.poles, 0.5] if abs(p) < 1])
    lags = float(np.sum(-1 / np.log(np.clip(radii, 1e-3, 1 - 1e-3))))
    delay = int(np.flatnonzero(model.b)[0])
    return float(np.clip(LAGS * lags + DELAYS * delay, *SAMPLES)) * model.sample_time


def region_limits(
    model: Model, specification: Specification, template: PiGains, widest: GainRange, duration: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of kp and ki that contain the feasible or best gains: a logarithmic grid, then finer linear ones."""
    p = np.r_[0.0, decades(widest.kp)] if widest.kp else np.zeros(1)
    i = decades(widest.ki, DECADES_KI)
    for _ in range(ROUNDS):
        worst = evaluate(model, specification, template, p, i, duration)[1]
        (p_low, p_high), (i_low, i_high) = limits_of(p, i, worst)
        if (worst <= 0).sum() >= 4:
            break
        p, i = np.linspace(p_low, p_high, COARSE), np.linspace(i_low, i_high, COARSE)
    return (p_low, p_high), (i_low, i_high)


def limits_of(p: Array, i: Array, worst: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of the feasible pairs, or of those close to the best, extended by one grid step."""
    least = float(worst.min())
    rows, columns = np.nonzero(worst <= (1.4 * least + NEAR if least > 0 else 0.0))
    return one_step_out(p, rows), one_step_out(i, columns)


def one_step_out(values: Array, found: Ints) -> tuple[float, float]:
    """The values at the first and last index found, extended by one index."""
    low, high = max(found.min() - 1, 0), min(found.max() + 1, len(values) - 1)
    return float(values[low]), float(values[high])
