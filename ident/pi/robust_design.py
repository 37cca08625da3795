"""What holds on every plant that the data leave possible: worst case, and the probability of the whole specification.

Plants are draws of the coefficients, theta ~ N(estimate, covariance), or models that are given. Draws that run away by
themselves are left out where the model does not: the machine stood still while it was recorded.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable
from ...core.errors import IdentError, UsageError
from ..model import Model
from ..responses.confidence_bands import with_theta
from .feasible_region import FeasibleMap
from .figures_of_merit import specified_figures
from .gain_search import Aim, aim_of
from .gains import PiGains
from .specification import LIMITS, Specification, figure_of

Array = NDArray[np.float64]
FEWEST = 0.5  # share of draws that must be stable before the rest can speak for the machine
SCREENED, PLANTS = 144, 60  # gains looked at first, and the plants they are looked at on
FINALISTS = 9
ROUNDS, STEPS = 2, 5  # of the way back to the nominal gains: to 1/16 of it


@dataclass(frozen=True, slots=True)
class Plants:
    """Models that may be the machine.

    Attributes
    ----------
    models : tuple of Model
    left_out : int
        Draws that were unstable by themselves and are not among them.
    """

    models: tuple[Model, ...]
    left_out: int = 0


@dataclass(frozen=True, slots=True, repr=False)
class Robustness(Displayable):
    """One controller on many plants.

    Attributes
    ----------
    probability : float
        Share of plants on which the loop is stable and every limit is met.
    error : float
        Standard error of that share by the number of draws (Wilson's, so never zero).
    n : int
        Plants.
    unstable : int
        Of them, those whose closed loop is unstable.
    left_out : int
        Draws that were unstable without a controller, and were not counted.
    missed : dict of float
        Share of plants that misses each limit, by name.
    worst : dict of float
        Worst value of each limited figure over the plants.
    """

    probability: float
    error: float
    n: int
    unstable: int
    left_out: int
    missed: dict[str, float]
    worst: dict[str, float]

    @property
    def verdict(self) -> str:
        """One sentence."""
        chance = f"{self.probability:.1%} +- {self.error:.1%}"
        told = f"On {self.n} plants that the data allow it holds with probability {chance}"
        if self.unstable:
            told += f"; {self.unstable} of the loops are unstable"
        if self.missed and max(self.missed.values()) > 0:
            name = max(self.missed, key=lambda k: self.missed[k])
            limit = LIMITS[name]
            told += f"; most often missed is the {limit.words} (worst {limit.scale * self.worst[name]:.4g}{limit.unit})"
        if self.left_out:
            told += f"; {self.left_out} draws that run away by themselves are left out"
        return told + "."


def draws_of_models(model: Model, draws: int = 500, seed: int = 1) -> Plants:
    """Draws of the coefficients of a model from their normal distribution.

    Raises
    ------
    IdentError
        No covariance; most draws unstable where the model is stable.
    """
    if model.cov_params is None:
        raise IdentError(
            f"model of structure {model.structure!r} has no covariance: nothing is known of other plants. Identify it "
            "from a record, or give several models."
        )
    if draws < 10:
        raise UsageError(f"draws {draws!r}: 10 or more, usually 500.")
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(model.cov_params)
    scatter = vectors * np.sqrt(np.maximum(values, 0.0))
    thetas = model.theta + rng.standard_normal((draws, len(model.theta))) @ scatter.T
    models = tuple(with_theta(model, theta) for theta in thetas)
    if not model.stable:
        return Plants(models)
    kept = tuple(m for m in models if m.stable)
    if len(kept) < FEWEST * draws:
        raise IdentError(
            f"{1 - len(kept) / draws:.0%} of the models within the covariance are unstable: the record does not tell "
            "the machine well enough to tune on. Record longer, excite lower frequencies, or lower the orders."
        )
    return Plants(kept, draws - len(kept))


def robustness(
    plants: Plants | Sequence[Model], gains: PiGains, specification: Specification, *, duration: float
) -> Robustness:
    """How one controller fares on many plants.

    Parameters
    ----------
    plants : Plants or sequence of Model
    gains : PiGains
    specification : Specification
    duration : float
        Of the simulated steps, s: several times the settling time that is asked for.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02, cov_params=np.diag([1e-8, 1e-8]))
    >>> plants, asked = draws_of_models(model, 200), Specification(rise_time=0.6)
    >>> held = robustness(plants, PiGains(4.0, 4.0, 0.02), asked, duration=4.0)
    >>> held.probability, held.unstable
    (1.0, 0)
    """
    plants = plants if isinstance(plants, Plants) else Plants(tuple(plants))
    table = figures_by_plant(plants, gains, specification, duration)
    holds = specification.worst(table) <= 0
    missed = {name: float((v > 0).mean()) for name, v in specification.violations(table).items()}
    worst = {name: worst_value(table, name) for name in missed}
    n = len(plants.models)
    unstable = int((~table["stable"].astype(bool)).sum())
    return Robustness(
        float(holds.mean()), share_error(float(holds.mean()), n), n, unstable, plants.left_out, missed, worst
    )


def figures_by_plant(plants: Plants, gains: PiGains, specification: Specification, duration: float) -> dict[str, Array]:
    """The judged figures of one controller on each plant, by name, each shape (n,)."""
    table = specified_figures(plants.models, [gains.kp], [gains.ki], gains, duration, specification)
    return {name: values.reshape(len(plants.models)) for name, values in table.items()}


def worst_value(table: dict[str, Array], name: str) -> float:
    """Largest, or smallest where the limit is a least one, over the plants."""
    values = np.asarray(figure_of(table, LIMITS[name].figure), dtype=np.float64)
    return float(values.min() if LIMITS[name].above else values.max())


def share_error(share: float, n: int) -> float:
    """Standard error of a share of n draws, kept off zero as Wilson's interval keeps it (1927)."""
    return float(np.sqrt(share * (1 - share) / n + 1 / (4 * n * n)) / (1 + 1 / n))


def robust_gains(
    plants: Plants | Sequence[Model],
    found: FeasibleMap,
    nominal: PiGains,
    aim: Aim,
    probability: float,
    template: PiGains,
) -> PiGains:
    """Among gains that hold with a demanded probability those of the best aim on the model; else the most probable.

    A spread of the feasible gains is screened on some of the plants, the finalists on all of them; the chosen one is
    then led back towards the best gains of the model as far as the probability allows.
    """
    if not 0 < probability < 1:
        raise UsageError(f"probability {probability!r}: between 0 and 1, for instance 0.9.")
    if not found.any:
        return nominal
    plants = plants if isinstance(plants, Plants) else Plants(tuple(plants))
    kp, ki, aims = spread(found, aim)
    finalists = screened(shares_met(plants.models[:PLANTS], kp, ki, found, template), aims, probability)
    share = shares_met(plants.models, kp[finalists], ki[finalists], found, template)
    good = share >= probability
    pick = finalists[np.argmin(np.where(good, aims[finalists], np.inf)) if good.any() else np.argmax(share)]
    end = float(kp[pick]), float(ki[pick])
    if good.any():
        end = towards_nominal(plants, found, nominal, end, probability, template)
    return replace(template, kp=end[0], ki=end[1])


def screened(first: Array, aims: Array, probability: float) -> NDArray[np.intp]:
    """Candidates worth all plants: of those that may hold, from the best aim to the worst; and the highest shares."""
    highest = np.argsort(-first, kind="stable")
    likely = np.flatnonzero(first >= probability - share_error(probability, PLANTS))
    if not likely.size:
        return highest[:FINALISTS]
    order = likely[np.argsort(aims[likely], kind="stable")]
    even = np.linspace(0, len(order) - 1, min(FINALISTS // 2, len(order))).astype(int)
    return np.unique(np.r_[order[even], order[: FINALISTS // 3], highest[:2]])


def towards_nominal(
    plants: Plants,
    found: FeasibleMap,
    nominal: PiGains,
    end: tuple[float, float],
    probability: float,
    template: PiGains,
) -> tuple[float, float]:
    """The gains nearest to the nominal ones, on the line from them to ``end``, that hold with the probability."""
    low, high = 0.0, 1.0
    for _ in range(ROUNDS):
        t = np.linspace(low, high, STEPS)
        kp, ki = (a + (b - a) * t for a, b in ((nominal.kp, end[0]), (nominal.ki, end[1])))
        held = shares_met(plants.models, kp[:-1], ki[:-1], found, template) >= probability
        first = int(np.flatnonzero(~held).max(initial=-1)) + 1  # the end holds
        low, high = float(t[max(first - 1, 0)]), float(t[first])
    return float(nominal.kp + (end[0] - nominal.kp) * high), float(nominal.ki + (end[1] - nominal.ki) * high)


def spread(found: FeasibleMap, aim: Aim) -> tuple[Array, Array, Array]:
    """An even choice of the feasible gains of a map: kp, ki and their aims, each shape (m,)."""
    rows, columns = np.nonzero(found.feasible)
    side = int(np.sqrt(SCREENED))
    box = [np.minimum(side * (v - v.min()) // max(int(np.ptp(v)) + 1, 1), side - 1) for v in (rows, columns)]
    _, first = np.unique(side * box[0] + box[1], return_index=True)
    aims = aim_of(found.figures, found.ki[None, :], aim)
    return found.kp[rows[first]], found.ki[columns[first]], aims[rows[first], columns[first]]


def shares_met(models: Sequence[Model], kp: Array, ki: Array, found: FeasibleMap, template: PiGains) -> Array:
    """Share of models on which each pair of gains meets the specification, shape (m,)."""
    table = specified_figures(models, kp, ki, template, found.duration, found.specification)
    return np.asarray((found.specification.worst(table) <= 0).mean(axis=0))
