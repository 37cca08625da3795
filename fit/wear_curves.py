"""Life of each edge at a wear criterion, read from its wear curve, beside the inversion of the wear law.

ISO 3685 reads the life where the curve of an edge crosses the criterion; an edge that was stopped before is a run-out.
The wear law, inverted at the edge's own level, uses all readings of all edges, and reaches beyond the last one. Where
wear is flat, the scatter of single readings crosses the criterion early; where the law bends in time, it is the law
that is wrong. So both are computed, and their difference is stated with its interval.

Sources: ISO 3685:1993, annex on tool-life equations; Henderson 1975, Biometrics 31, 423 (level of an edge).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.display import Display, Displayable, TextTable
from ..core.errors import FitError
from ..core.intervals import Root
from ..core.predictions import beyond_scatter, doubt_of_curves
from ..core.rounding import format_plain
from ..datasets import runs_from_frame
from .available import NotAvailable, computed
from .censored_lives import life_law
from .edges import SAME, EdgeInference
from .lawfit import LawFit

Reached = Literal["interpolated", "extrapolated", "before the first reading"]
DRAWS, SEED = 400, 1  # of simulated wear curves of each edge
LEAST_EDGES = 3  # whose lives are compared


@dataclass(frozen=True, slots=True)
class EdgeLife:
    """Life of one edge.

    Attributes
    ----------
    edge : str
    reached : {"interpolated", "extrapolated", "before the first reading"}
        How the criterion was reached: between two readings, after the last, or before the first.
    curve : float
        Time of the crossing; of the last or the first reading where the curve does not cross the criterion.
    law : float
        Time at which the wear law at the level of this edge reaches the criterion.
    """

    edge: str
    reached: Reached
    curve: float
    law: float


@dataclass(frozen=True, slots=True, repr=False)
class WearCurveLives(Displayable):
    """Lives of the edges at a wear criterion, from their curves and from the wear law.

    Attributes
    ----------
    wear, criterion, unit_of_wear, unit
        Symbol and criterion, and the units of wear and time.
    lives : tuple of EdgeLife
    ratio, ratio_interval : float, and (low, high), or None
        Median life by the curve over that by the law, of the edges whose curve crosses the criterion; 95 %.
    expected : float or None
        The same ratio where the law holds and readings scatter as they do: by simulation of the curves.
    law : LawFit or NotAvailable
        Law of these lives, edges that did not reach the criterion as run-outs.
    """

    wear: str
    criterion: float
    unit_of_wear: str
    unit: str
    lives: tuple[EdgeLife, ...]
    ratio: float | None
    ratio_interval: tuple[float, float] | None
    expected: float | None
    law: LawFit | NotAvailable

    def count(self, reached: Reached) -> int:
        """Number of edges that reached the criterion in this way."""
        return sum(one.reached == reached for one in self.lives)

    @property
    def contradicts(self) -> bool:
        """Whether the lives by the curves differ from those by the law by more than scatter makes."""
        return beyond_scatter(self.ratio_interval, self.expected)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Counts, and what the difference between the two lives means."""
        n, inside = len(self.lives), self.count("interpolated")
        goal = f"{self.wear} {self.criterion:g} {self.unit_of_wear}"
        cross = "curve of 1" if inside == 1 else f"curves of {inside}"
        verb = "crosses" if inside == 1 else "cross"
        parts = [f"The wear {cross} of {n} edges {verb} {goal}" if inside else f"No wear curve crosses {goal}"]
        if beyond := self.count("extrapolated"):
            parts.append(f"those of {beyond} edges end before it (run-outs: a life by the law is extrapolated)")
        if before := self.count("before the first reading"):
            parts.append(f"those of {before} are beyond it at the first reading")
        return (f"{'; '.join(parts)}.", *self._meaning())

    def _meaning(self) -> tuple[str, ...]:
        if self.ratio is None or self.ratio_interval is None or self.expected is None:
            return ()
        low, high = self.ratio_interval
        size, more = 100 * abs(self.ratio - 1), "longer" if self.ratio > 1 else "shorter"
        ends = f"95 % interval {100 * (low - 1):+.2g} to {100 * (high - 1):+.2g} %"
        head = f"Interpolated lives are {size:.2g} % {more} than those of the wear law at the level of the same edge"
        alone = f"the scatter of the readings alone makes {100 * (self.expected - 1):+.2g} % (simulated)"
        if low <= 1 <= high:
            return (f"{head} ({ends}): they agree.",)
        if not self.contradicts:
            return (f"{head} ({ends}); {alone}, which explains it: the lives of the wear law are the better ones.",)
        bend = "faster" if self.ratio < 1 else "slower"
        return (
            f"{head} ({ends}); {alone}, which does not explain it: near the criterion wear grows {bend} than the law, "
            "so trust the interpolated lives there.",
        )

    def to_frame(self) -> pd.DataFrame:
        """A row for each edge."""
        return pd.DataFrame([(x.edge, x.reached, x.curve, x.law) for x in self.lives],
                            columns=["edge", "reached", "curve", "law"])  # fmt: skip

    def _display(self) -> Display:
        rows = tuple((x.edge, x.reached, format_plain(x.curve, 3), format_plain(x.law, 3)) for x in self.lives)
        head = f"lives at {self.wear} {self.criterion:g} {self.unit_of_wear}, in {self.unit}"
        return Display(head, table=TextTable(("edge", "reached", "curve", "law"), rows), sentences=self.sentences)


def wear_curve_lives(law: LawFit, criterion: float = 0.3) -> WearCurveLives:
    """Lives of the edges of a wear law at a criterion, from their wear curves and from the law.

    Parameters
    ----------
    law : LawFit
        A power law of wear on t whose rows name their edges.
    criterion : float
        In the unit of the wear.

    Raises
    ------
    FitError
        The law has no time, its wear does not grow, or its rows name no edges with several readings.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> found = fit.wear_curve_lives(law, 0.3)
    >>> found.count("interpolated"), found.count("extrapolated")
    (1, 23)
    """
    _check(law, criterion)
    assert law.rows is not None  # noqa: S101  for the type checker: `_check` has seen them
    number = law.rows.edge_numbers
    names = sorted(set(map(str, law.edge if law.edge is not None else ())))
    levels = _levels(law)
    k, t = float(law.params["t"]), law.X[:, law.factors.index("t")]
    by_law = np.exp((np.log(criterion / law.fitted) - levels[number]) / k + np.log(t))
    within = law.edges.mixed.sd_within if isinstance(law.edges, EdgeInference) else law.scale_se or 0.0
    sd = within if law.error == "multiplicative" else within / criterion
    rng = np.random.default_rng(SEED)
    lives, simulated = [], []
    for g, name in enumerate(names):
        rows = np.flatnonzero(number == g)
        rows = rows[np.argsort(t[rows], kind="stable")]
        reached, curve = _crossing(t[rows], law.observed[rows], criterion)
        lives.append(EdgeLife(name, reached, curve, float(by_law[rows[0]])))
        if reached == "interpolated":
            simulated.append(_simulated(t[rows], float(by_law[rows[0]]), k, sd, rng))
    ratio, ends = _ratio(lives)
    expected = float(np.exp(np.nanmean(simulated))) if ratio is not None and np.isfinite(simulated).any() else None
    found = computed(lambda: _law_of_lives(law, lives, number))
    return WearCurveLives(
        law.response, criterion, law.units[law.response], law.units["t"], tuple(lives), ratio, ends, expected, found
    )


def doubt(law: LawFit, criterion: float, ln_life: float, variance: float) -> str:
    """Reason of the wear curves against the 95 % interval of the life of a new edge; empty where there is none."""
    found = computed(lambda: wear_curve_lives(law, criterion))
    if isinstance(found, NotAvailable):
        return ""
    half = law.t_quantile(0.95) * variance**0.5
    of = Root(ln_life, ln_life - half, ln_life + half, 0.0)
    return doubt_of_curves(found.ratio, found.ratio_interval, found.expected, of)


def _check(law: LawFit, criterion: float) -> None:
    if law.form != "power" or "t" not in law.factors or law.params["t"] <= 0:
        raise FitError(f"lives from wear curves need a power law of wear that grows with t; {law.response} has none.")
    if not (criterion > 0 and np.isfinite(criterion)):
        raise FitError(f"wear criterion {criterion}: it needs a value above zero, for instance 0.3 mm.")
    _check_edges(law)


def _check_edges(law: LawFit) -> None:
    if law.rows is None or law.edge is None or law.n_edges == law.nobs:
        raise FitError("lives from wear curves need several readings of each edge: name the edges with --edge.")


def _levels(law: LawFit) -> Array:
    """Level of each edge above the law in ln wear: its mean residual, shrunk by the share of scatter in it."""
    assert law.rows is not None  # noqa: S101
    number = law.rows.edge_numbers
    size = np.bincount(number)
    mean = np.bincount(number, weights=np.log(law.observed / law.fitted)) / size
    if not isinstance(law.edges, EdgeInference):
        return np.asarray(mean, dtype=float)
    between, within = law.edges.mixed.sd_between**2, law.edges.mixed.sd_within**2
    total = between + within / size
    return np.asarray(np.where(total > 0, between / np.where(total > 0, total, 1.0), 0.0) * mean, dtype=float)


def _crossing(t: Array, wear: Array, criterion: float) -> tuple[Reached, float]:
    """First crossing of the criterion between two readings of one edge, in the order of time."""
    if wear[0] >= criterion:
        return "before the first reading", float(t[0])
    above = np.flatnonzero(wear >= criterion)
    if not above.size:
        return "extrapolated", float(t[-1])
    i = int(above[0])
    share = (criterion - wear[i - 1]) / (wear[i] - wear[i - 1])
    return "interpolated", float(t[i - 1] + share * (t[i] - t[i - 1]))


def _simulated(t: Array, life: float, k: float, sd: float, rng: np.random.Generator) -> float:
    """Mean logarithm of the crossing over the life of the law, where the law holds and readings scatter."""
    wear = (t / life) ** k * np.exp(rng.normal(0.0, sd, (DRAWS, len(t))))
    found = [_crossing(t, row, 1.0) for row in wear]
    logs = [np.log(time / life) for reached, time in found if reached == "interpolated"]
    return float(np.mean(logs)) if logs else float("nan")


def _ratio(lives: list[EdgeLife]) -> tuple[float | None, tuple[float, float] | None]:
    """Geometric mean of the ratio of the two lives with its t interval."""
    from scipy.special import stdtrit

    d = np.array([np.log(one.curve / one.law) for one in lives if one.reached == "interpolated"])
    if len(d) < LEAST_EDGES:
        return None, None
    half = float(stdtrit(len(d) - 1, 0.975) * d.std(ddof=1) / np.sqrt(len(d)))
    return float(np.exp(d.mean())), (float(np.exp(d.mean() - half)), float(np.exp(d.mean() + half)))


def _law_of_lives(law: LawFit, lives: list[EdgeLife], number: "np.ndarray[tuple[int], np.dtype[np.intp]]") -> LawFit:
    """Law of the lives by the curves; FitError where conditions change within an edge or too few edges end."""
    factors = [name for name in law.factors if name != "t"]
    first = np.array([int(np.flatnonzero(number == g)[0]) for g in range(len(lives))])
    columns = {name: law.X[:, law.factors.index(name)] for name in factors}
    for name, x in columns.items():
        if np.any(np.abs(x - x[first][number]) > SAME * np.abs(x).max()):
            raise FitError(f"{name} changes within an edge, so its life has no conditions of its own.")
    sign = {"interpolated": "", "extrapolated": ">", "before the first reading": "<"}
    texts = [f"{sign[one.reached]}{one.curve!r}" for one in lives]
    marked = any(one.reached != "interpolated" for one in lives)
    frame = pd.DataFrame({name: x[first] for name, x in columns.items()})
    frame["T"] = texts if marked else [one.curve for one in lives]
    return life_law(runs_from_frame(frame, judge=False), factors, edge=None)
