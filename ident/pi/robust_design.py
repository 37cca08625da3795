"""Robustness to the uncertainty of the model: probability of the specification, and the worst case over plants.

Plants are draws of the structures and coefficients that the record supports (`ident.draws`), or given models. The draws
that choose gains do not state their probability, which would be too high: these gains suit these draws best.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable, Plottable
from ...core.errors import IdentError, UsageError
from ...core.verdict import DO_NOT_USE, EVEN, PROBABILITY, RESERVATIONS, level_of_probability
from ..draws import Plants, drawn_models
from ..model import Model
from .feasible_region import FeasibleMap
from .figures_of_merit import specified_figures
from .gain_search import Aim, aim_of
from .gains import PiGains
from .loop import FiguresOfMerit
from .specification import LIMITS, Specification, figure_of

SCREENED, PLANTS = 144, 60  # gains screened, and the number of plants used for it
FINALISTS = 9
ROUNDS, STEPS = 2, 5  # of the line search towards the nominal gains: to 1/16 of it
UNSTABLE = 0.01  # share of unstable loops above which gains must not be used
STATED = 2000  # draws that state the probability: a Monte Carlo standard error of 0.7 points at 90 %
PICTURED = 100  # draws of the trade-off
SURE = 2.0  # standard errors by which a chosen share exceeds the required probability
CHOOSING, STATING, SHOWING = 0, 1, 2  # independent draws of one seed
LARGEST_MS, LEAST_GAIN_MARGIN = 2.0, 2.0  # usual bounds, Astrom & Hagglund 2006: 1.4 to 2, and 2 to 5
NORMAL = 1.959964  # two-sided 95 %
SHOWN = 1.6  # times the limit on speed, shown in the trade-off
STEEPEST = 2.5  # largest Ms shown


@dataclass(frozen=True, slots=True, repr=False)
class Robustness(Displayable):
    """Robustness of one controller over many plants.

    Attributes
    ----------
    probability : float
        Share of plants with a stable loop that meets every limit.
    error : float
        Monte Carlo standard error of that share (Wilson's, never zero).
    n : int
        Plants.
    unstable : int
        Number of unstable closed loops.
    left_out : int
        Unstable draws of the plant, not counted.
    missed : dict of float
        Share of plants that violate each limit, by name.
    worst : dict of float
        Worst value of each limited figure.
    given : bool
        Over models given by the caller, not over draws.
    structures : int
        Number of structures (orders and delay) among the draws.
    """

    probability: float
    error: float
    n: int
    unstable: int
    left_out: int
    missed: dict[str, float]
    worst: dict[str, float]
    given: bool = False
    structures: int = 1

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Monte Carlo interval of the probability (Wilson 1927); the share itself over given models."""
        if self.given:
            return self.probability, self.probability
        n, p, z = self.n, self.probability, NORMAL
        centre, half = (p + z * z / (2 * n)) / (1 + z * z / n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        low, high = centre - half / (1 + z * z / n), centre + half / (1 + z * z / n)
        return float(min(max(low, 0.0), p)), float(max(min(high, 1.0), p))

    @property
    def words(self) -> str:
        """One sentence."""
        if self.given:
            text = f"The specification holds on {100 * self.probability:.3g} % of the {self.n} given models"
        else:
            held, low, high = map(share_words, (self.probability, *self.interval))
            orders = f", {self.structures} structures included," if self.structures > 1 else ""
            text = (
                f"The specification holds with probability {held} % (95 % Monte Carlo interval {low} to {high} %) "
                f"over {self.n} draws of the model uncertainty{orders} that did not choose the gains"
            )
        if self.unstable:
            text += f"; {self.unstable} of the loops are unstable"
        text += self.most_missed
        if self.left_out:
            text += f"; {self.left_out} unstable draws of the plant are omitted"
        return text + "."

    @property
    def most_missed(self) -> str:
        """The limit that is violated most often and its worst value, in words; empty where none is."""
        if not self.missed or max(self.missed.values()) == 0:
            return ""
        name = max(self.missed, key=lambda k: self.missed[k])
        limit, worst = LIMITS[name], LIMITS[name].scale * self.worst[name]
        found = f"{worst:.4g}{limit.unit}" if np.isfinite(worst) else "infinite"
        return f"; most often violated: {limit.words} (worst {found})"


def plants_of(
    model: Model, models: Sequence[Model] | None, draws: int, seed: int, *, strict: bool
) -> tuple[Plants | None, Plants | None, Plants | None, str]:
    """Plants that choose gains, state their probability and show the trade-off; or the reason why there are none."""
    if models is not None:
        given = Plants(tuple(models), given=True)
        return given, given, given, ""
    if model.cov_params is None and not strict:
        return None, None, None, "the model has no covariance, because it was given and not identified from a record"
    sizes = {CHOOSING: draws, STATING: max(draws, STATED), SHOWING: PICTURED}
    try:
        choosing, stating, showing = (drawn_models(model, n, (seed, kind)) for kind, n in sizes.items())
    except IdentError as error:
        if strict:
            raise
        return None, None, None, str(error).rstrip(".")
    return choosing, stating, showing, ""


def reservations(held: Robustness | None, unknown: str, required: float | None = None) -> list[tuple[int, str]]:
    """Reservations about the probability, also against the required one, and about unstable loops."""
    if held is None:
        return [(RESERVATIONS, f"The probability that the specification holds cannot be stated: {unknown}.")]
    found = []
    least, upper = held.interval
    if level := level_of_probability(held.probability, upper, required):
        below = EVEN if level == DO_NOT_USE else PROBABILITY if held.probability < PROBABILITY else required or 0.0
        found.append(
            (level, f"The specification holds with probability {share_words(held.probability)} %, below "
                    f"{100 * below:g} %{held.most_missed}.")
        )  # fmt: skip
    elif required is not None and least < required:
        words = (
            f"The 95 % Monte Carlo interval of the probability that the specification holds reaches down to "
            f"{share_words(least)} %, below the required {100 * required:g} %."
        )
        found.append((RESERVATIONS, words))
    if held.unstable:
        level = DO_NOT_USE if held.unstable > UNSTABLE * held.n else RESERVATIONS
        found.append((level, f"{held.unstable} of {held.n} loops over the model uncertainty are unstable."))
    if held.left_out:
        words = f"{held.left_out} draws of the model are unstable and were left out of the probability."
        found.append((RESERVATIONS, words))
    return found


def beyond_band(figures: FiguresOfMerit, model: Model) -> list[tuple[int, str]]:
    """Reservation where the loop works beyond the excited band."""
    band, crossover = model.band, figures.crossover_hz
    if band is None or not crossover > band[1]:
        return []
    words = (
        f"The loop works up to {crossover:.3g} Hz, but the record excited the drive only up to {band[1]:.3g} Hz: "
        "margins rest on an extrapolation of the model."
    )
    return [(RESERVATIONS, words)]


def poor_margins(figures: FiguresOfMerit, specification: Specification) -> list[tuple[int, str]]:
    """Reservation about small margins where the specification has no limit on them."""
    given = any(getattr(specification, name) is not None for name in ("ms", "phase_margin", "gain_margin"))
    if given or not figures.stable or (figures.ms <= LARGEST_MS and figures.gain_margin >= LEAST_GAIN_MARGIN):
        return []
    words = (
        f"The margins of the loop are small: maximum sensitivity {figures.ms:.3g} (usual: at most {LARGEST_MS:g}), "
        f"gain margin {figures.gain_margin:.3g} (usual: at least {LEAST_GAIN_MARGIN:g}). The gain of a cut varies in "
        "proportion to its depth; add a limit, --ms or --gain-margin."
    )
    return [(RESERVATIONS, words)]


def robustness(
    plants: Plants | Sequence[Model], gains: PiGains, specification: Specification, *, duration: float
) -> Robustness:
    """Robustness of one controller over many plants.

    Parameters
    ----------
    plants : Plants or sequence of Model
    gains : PiGains
    specification : Specification
    duration : float
        Of the simulated steps, s: several times the specified settling time.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02, cov_params=np.diag([1e-8, 1e-8]))
    >>> plants, limits = drawn_models(model, 200), Specification(rise_time=0.6)
    >>> held = robustness(plants, PiGains(4.0, 4.0, 0.02), limits, duration=4.0)
    >>> held.probability, held.unstable
    (1.0, 0)
    """
    plants = plants if isinstance(plants, Plants) else Plants(tuple(plants), given=True)
    table = figures_by_plant(plants, gains, specification, duration)
    holds = specification.worst(table) <= 0
    missed = {name: float((v > 0).mean()) for name, v in specification.violations(table).items()}
    worst = {name: worst_value(table, name) for name in missed}
    n = len(plants.models)
    unstable = int((~table["stable"].astype(bool)).sum())
    return Robustness(
        float(holds.mean()), share_error(float(holds.mean()), n), n, unstable, plants.left_out, missed, worst,
        plants.given, plants.structures,
    )  # fmt: skip


def figures_by_plant(plants: Plants, gains: PiGains, specification: Specification, duration: float) -> dict[str, Array]:
    """Figures of merit of one controller on each plant, by name, each shape (n,)."""
    table = specified_figures(plants.models, [gains.kp], [gains.ki], gains, duration, specification)
    return {name: values.reshape(len(plants.models)) for name, values in table.items()}


def worst_value(table: dict[str, Array], name: str) -> float:
    """Worst value of a limited figure over the plants."""
    values = np.asarray(figure_of(table, LIMITS[name].figure), dtype=np.float64)
    return float(values.min() if LIMITS[name].above else values.max())


def share_words(share: float) -> str:
    """A share in per cent, with two digits of its distance from 0 or 100 %.

    >>> [share_words(share) for share in (0.9, 0.927, 0.9987, 0.9995, 1.0)]
    ['90.0', '92.7', '99.87', '99.95', '100.0']
    """
    nearest = 100 * min(share, 1 - share)
    places = min(2 - math.ceil(math.log10(nearest)), 4) if 0 < nearest < 1 else 1
    return f"{100 * share:.1f}" if places < 2 else str(round(100 * share, places))


def share_error(share: float, n: int) -> float:
    """Standard error of a share of n draws by Wilson's interval (1927), which is never zero."""
    return float(np.sqrt(share * (1 - share) / n + 1 / (4 * n * n)) / (1 + 1 / n))


def robust_gains(
    plants: Plants | Sequence[Model],
    found: FeasibleMap,
    nominal: PiGains,
    aim: Aim,
    probability: float,
    template: PiGains,
) -> PiGains:
    """Gains of the best objective among those that hold with the required probability; otherwise the most probable.

    A selection of the feasible gains is screened on some of the plants, the finalists on all of them; the selected
    gains are then moved towards the nominal optimum as far as the probability allows. Over draws the share of the
    chosen gains exceeds the required probability by two standard errors, as the best of a sample flatters.
    """
    if not 0 < probability < 1:
        raise UsageError(f"probability {probability!r}: between 0 and 1, for instance 0.9.")
    if not found.any:
        return nominal
    plants = plants if isinstance(plants, Plants) else Plants(tuple(plants), given=True)
    if not plants.given:
        probability = min(probability + SURE * share_error(probability, len(plants.models)), (1 + probability) / 2)
    kp, ki, aims = spread(found, aim)
    finalists = screened(shares_met(plants.models[:PLANTS], kp, ki, found, template), aims, probability)
    share = shares_met(plants.models, kp[finalists], ki[finalists], found, template)
    good = share >= probability
    pick = finalists[np.argmin(np.where(good, aims[finalists], np.inf)) if good.any() else np.argmax(share)]
    end = float(kp[pick]), float(ki[pick])
    if good.any():
        end = towards_nominal(plants, found, nominal, end, probability, template)
    return replace(template, kp=end[0], ki=end[1])


def screened(first: Array, aims: Array, probability: float) -> Ints:
    """Finalists: a selection of probable candidates by objective, and those of the highest shares."""
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
    """The gains nearest to the nominal ones, on the line to ``end``, that hold with the probability."""
    low, high = 0.0, 1.0
    for _ in range(ROUNDS):
        t = np.linspace(low, high, STEPS)
        kp, ki = (a + (b - a) * t for a, b in ((nominal.kp, end[0]), (nominal.ki, end[1])))
        held = shares_met(plants.models, kp[:-1], ki[:-1], found, template) >= probability
        first = int(np.flatnonzero(~held).max(initial=-1)) + 1  # the end holds
        low, high = float(t[max(first - 1, 0)]), float(t[first])
    return float(nominal.kp + (end[0] - nominal.kp) * high), float(nominal.ki + (end[1] - nominal.ki) * high)


def spread(found: FeasibleMap, aim: Aim) -> tuple[Array, Array, Array]:
    """Evenly spaced selection of the feasible gains of a map: kp, ki and their objectives, each shape (m,)."""
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


@dataclass(frozen=True, slots=True, repr=False)
class TradeOff(Plottable):
    """Speed, maximum sensitivity and probability of m pairs of gains, spread over a map.

    Attributes
    ----------
    kp, ki : ndarray, shape (m,)
    speed : ndarray, shape (m,)
        Rise or settling time on the model, s; ``speed_name`` is which.
    ms : ndarray, shape (m,)
        Maximum sensitivity on the model.
    probability : ndarray, shape (m,), or None
        Share of the draws on which the whole specification holds; None without draws.
    least : ndarray, shape (2, c)
        Speed and smallest Ms of the map in each of c classes of speed.
    speed_name : str
    specification : Specification
    """

    kp: Array
    ki: Array
    speed: Array
    ms: Array
    probability: Array | None
    least: Array
    speed_name: str
    specification: Specification


def trade_off(found: FeasibleMap, template: PiGains, plants: Plants | None) -> TradeOff:
    """Speed, maximum sensitivity and probability of gains spread evenly over both axes of their picture."""
    asked = found.specification
    name = "settling_time" if asked.rise_time is None and asked.settling_time is not None else "rise_time"
    speed, ms = found.figures[name], found.figures["ms"]
    limit = getattr(asked, name) or float(np.min(speed))
    rows, columns = np.nonzero((speed <= SHOWN * limit) & (ms <= STEEPEST))
    if not rows.size:
        none = np.empty(0)
        return TradeOff(none, none, none, none, None, np.empty((2, 0)), name, asked)
    x, y = speed[rows, columns], ms[rows, columns]
    side = int(np.sqrt(SCREENED))
    column, row = (np.minimum((side * (v - v.min()) / (np.ptp(v) or 1.0)).astype(int), side - 1) for v in (x, y))
    mixed = np.random.default_rng(0).permutation(len(x))  # any point of a box, not the first row of the map
    first = mixed[np.unique((side * column + row)[mixed], return_index=True)[1]]
    by_ms = np.argsort(y, kind="stable")
    lowest = by_ms[np.unique((2 * side * (x - x.min()) / (np.ptp(x) or 1.0)).astype(int)[by_ms], return_index=True)[1]]
    first = np.unique(np.r_[first, lowest])
    kp, ki = found.kp[rows[first]], found.ki[columns[first]]
    share = None if plants is None else shares_met(plants.models, kp, ki, found, template)
    return TradeOff(kp, ki, x[first], y[first], share, np.stack([x[lowest], y[lowest]]), name, asked)
