"""Distribution of life and metal removed under uncertain laws, in two readings.

plan    the pairs that the laws as fitted choose, run on edges whose laws are drawn; the last pair is held until the
        edge is worn out: how often one plan ends early, and the power and force it then takes.
own     each draw chooses its own pairs, as if its laws were known: the attainable life and its uncertainty.

The recursion runs for all draws at once. Pairs stand in one row, largest MRR first, so that the first allowed is the
best. A limit R <= R_most is compared as ln R, of which all but the wear is computed once: one logarithm an evaluation.
Draws are processed in batches that fit in the cache.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.display import Plottable, as_columns
from ...core.errors import UsageError
from .interval_optimum import Grid, beyond_feed_rate, grid_of, rates
from .laws import LifeLaws, Rules, Terms
from .life import MOST, Life, whole_life

if TYPE_CHECKING:
    from ...core.display import Frame
    from ...parameters.draws import Draws

BATCH = 16  # draws: three tables of 16 x 1744 numbers are 0.7 MB


@dataclass(frozen=True, slots=True)
class DrawnTerms:
    """One law for S draws: the numbers of `Terms`, each an array of shape (S,)."""

    ln_c: Array
    V: Array
    f: Array
    t: Array
    AW: Array
    most: float

    def part(self, rows: slice) -> "DrawnTerms":
        """Some of the draws."""
        return DrawnTerms(self.ln_c[rows], self.V[rows], self.f[rows], self.t[rows], self.AW[rows], self.most)

    def logs(self, x: Array, y: Array) -> Array:
        """Logarithm of C V^a f^b, shape (S, n), at n pairs of ln V and ln f."""
        return np.asarray(self.ln_c[:, None] + self.V[:, None] * x + self.f[:, None] * y)


@dataclass(frozen=True, slots=True)
class DrawnLifeLaws:
    """The laws of an edge's life for S draws; see `LifeLaws`."""

    wear: DrawnTerms
    power: DrawnTerms | None
    force: DrawnTerms | None

    @property
    def limited(self) -> tuple[DrawnTerms, ...]:
        """Power and force, as far as limited."""
        return tuple(terms for terms in (self.power, self.force) if terms is not None)

    def part(self, rows: slice) -> "DrawnLifeLaws":
        """Some of the draws."""
        power, force = (None if one is None else one.part(rows) for one in (self.power, self.force))
        return DrawnLifeLaws(self.wear.part(rows), power, force)


def recursions(laws: LifeLaws, many: DrawnLifeLaws, rules: Rules, grid: Grid, most: int = MOST) -> tuple[Array, Array]:
    """Each draw's own recursion on the grid: number of intervals and metal removed, mm3, each shape (S,).

    A draw with ``most`` intervals was not worn out by then.
    """
    rate = rates(laws, grid).ravel()
    order = np.argsort(-rate, kind="stable")  # of equals the slower first, as in `Surfaces.best`
    order = order[~beyond_feed_rate(laws, grid).ravel()[order]]
    x = np.repeat(np.log(grid.V), len(grid.f))[order]
    y = np.tile(np.log(grid.f), len(grid.V))[order]
    n = np.zeros(len(many.wear.ln_c), dtype=np.float64)
    removed = np.zeros(len(n))
    for first in range(0, len(n), BATCH):
        rows = slice(first, first + BATCH)
        n[rows], removed[rows] = _batch(many.part(rows), rules, x, y, rate[order], most)
    return n, removed * rules.interval


def _batch(many: DrawnLifeLaws, rules: Rules, x: Array, y: Array, rate: Array, most: int) -> tuple[Array, Array]:
    h, steps = many.wear.t, rules.wear == "wear_state"  # in u = AW, or AW^(1/h), wear adds up
    scale = h if steps else np.ones_like(h)
    first = np.exp(many.wear.logs(x, y) / scale[:, None])
    tables = [terms.logs(x, y) - np.log(terms.most) for terms in many.limited]
    n, removed, u = np.zeros(len(h), dtype=np.float64), np.zeros(len(h)), np.zeros(len(h))
    alive = np.arange(len(h))
    for k in range(most):
        start, end = k * rules.interval, (k + 1) * rules.interval
        gain = np.full(len(alive), rules.interval) if steps else end ** h[alive] - start ** h[alive]
        reached = u[alive, None] + gain[:, None] * first
        allowed = _allowed(many, alive, tables, np.log(reached) * scale[alive, None], rules, end)
        best = allowed.argmax(axis=1)
        found = allowed[np.arange(len(alive)), best]
        if not found.all():
            alive, best, reached = alive[found], best[found], reached[found]
            first, tables = first[found], [table[found] for table in tables]
        if not len(alive):
            break
        u[alive] = reached[np.arange(len(alive)), best]
        removed[alive] += rate[best]
        n[alive] += 1
    return n, removed


def _allowed(many: DrawnLifeLaws, alive: Ints, tables: list[Array], ln_AW: Array, rules: Rules, end: float) -> Flags:
    """Whether wear, power and force keep their limits, shape (draws alive, pairs)."""
    allowed = ln_AW <= np.log(many.wear.most)
    for terms, table in zip(many.limited, tables, strict=True):
        over = terms.AW[alive, None] * ln_AW
        over += table
        if rules.times == "full":
            over += terms.t[alive, None] * np.log(end)
        allowed &= over <= 0
    return np.asarray(allowed)


def plan_on(plan: Life, many: DrawnLifeLaws, most: int) -> tuple[Array, Array, Array | None, Array | None]:
    """Intervals, metal removed and largest power and force of a plan on every drawn edge, the last pair held."""
    rules, wear = plan.rules, many.wear
    S = len(wear.ln_c)
    n, removed = np.zeros(S), np.zeros(S)
    peaks = [None if terms is None else np.zeros(S) for terms in (many.power, many.force)]
    if not len(plan.time):
        return n, removed, peaks[0], peaks[1]
    scale = wear.t if rules.wear == "wear_state" else np.ones(S)
    u, alive = np.zeros(S), np.ones(S, dtype=bool)
    for k in range(most):
        start, end = k * rules.interval, (k + 1) * rules.interval
        j = min(k, len(plan.V) - 1)
        x, y = np.log(plan.V[j : j + 1]), np.log(plan.f[j : j + 1])
        gain = rules.interval if rules.wear == "wear_state" else end**wear.t - start**wear.t
        u = u + gain * np.exp(wear.logs(x, y)[:, 0] / scale)
        ln_AW = np.log(u) * scale
        alive &= ln_AW <= np.log(wear.most)
        if not alive.any():
            break
        n += alive
        removed += alive * (plan.MRR[j] * rules.interval)
        for peak, terms in zip(peaks, (many.power, many.force), strict=True):
            if peak is not None and terms is not None:
                late = np.log(end) if rules.times == "full" else 0.0
                value = np.exp(terms.logs(x, y)[:, 0] + terms.t * late + terms.AW * ln_AW)
                np.maximum(peak, value, out=peak, where=alive)
    return n, removed, peaks[0], peaks[1]


SHOWN: Final = 0.005  # share of draws that is rounded to 1 %
Of = Literal["plan", "own"]
Edge = Literal["law", "new"]


@dataclass(frozen=True, slots=True, repr=False)
class LifeDraws(Plottable):
    """Life and metal removed, draw by draw: calculated from draws of the laws.

    Attributes
    ----------
    of : {"plan", "own"}
        The reading, see the module.
    edge : {"law", "new"}
        Draws of the law, that of an average edge, or of a new edge with its own level.
    minutes, removed : ndarray, shape (S,)
        Life, min, in whole intervals, and metal removed, mm3.
    peak_power, peak_force : ndarray, shape (S,), or None
        Largest value in the life of each edge under the plan; None for ``own``, which keeps the limits.
    plan : Life
        The life of the laws as fitted.
    drawn : tuple of str
        Responses that were drawn; the others are fixed at their estimates.
    left_out : int
        Number of draws whose wear does not grow with time: without end of life.
    unended : int
        Number of draws not worn out after the greatest number of intervals, which is taken as their life.
    """

    of: Of
    edge: Edge
    minutes: Array
    removed: Array
    peak_power: Array | None
    peak_force: Array | None
    plan: Life
    drawn: tuple[str, ...]
    left_out: int = 0
    unended: int = 0

    @property
    def ends_early(self) -> float:
        """Share of draws that are worn out before the plan's last interval has been cut."""
        return float((self.minutes < self.plan.minutes - 1e-9).mean())

    @property
    def exceeding(self) -> tuple[str, ...]:
        """Words on the share of draws that exceed a limit of power or force in their life; empty where few do."""
        pairs = ((self.peak_power, self.plan.laws.power), (self.peak_force, self.plan.laws.force))
        shares = [(t, float((peak > t.most).mean())) for peak, t in pairs if peak is not None and t is not None]
        return tuple(
            f"of new edges drawn from the laws {100 * share:.0f} % exceed {t.response} {t.most:g} {t.unit} before they "
            "are worn out, the last pair held"
            for t, share in shares
            if share >= SHOWN
        )

    def band(self, what: str = "removed", level: float = 0.95) -> tuple[float, float, float]:
        """Lower end, median and upper end of the equal-tailed interval of ``removed``, ``minutes``, ``peak_power`` ...

        Raises
        ------
        UsageError
            An unknown quantity, or a level outside 0 to 1.
        """
        values = getattr(self, what, None) if what in ("removed", "minutes", "peak_power", "peak_force") else None
        if values is None:
            raise UsageError(f"band of {what!r}: give removed or minutes, for a plan also peak_power or peak_force.")
        if not 0 < level < 1:
            raise UsageError(f"level={level!r}: give a value between 0 and 1.")
        low, middle, high = np.quantile(values, [(1 - level) / 2, 0.5, (1 + level) / 2])
        return float(low), float(middle), float(high)

    def to_frame(self) -> "Frame":
        """One row per draw: minutes, and mm3 removed."""
        return as_columns(self, "minutes", "removed")


def life_draws(
    laws: LifeLaws,
    draws: "Mapping[str, Draws]",
    *,
    of: Of = "plan",
    edge: Edge = "law",
    rules: Rules | None = None,
    grid: Grid | None = None,
    seed: int = 1,
    count: int | None = None,
    most: int = MOST,
    life: Life | None = None,
) -> LifeDraws:
    """The distribution of life and of metal removed.

    Parameters
    ----------
    laws : LifeLaws
        As fitted: the plan is theirs.
    draws : mapping of Draws
        By response, as `read_draws` gives them; independent of each other, and paired row by row.
    of : {"plan", "own"}
        ``plan``: the pairs chosen by ``laws``, run on edges drawn from the posterior, the last held to the end.
        ``own``: each draw its own recursion.
    edge : {"law", "new"}
        Whether a new edge's own level is added, normal with the sd and icc of the draw.
    rules, grid, most
        As in `whole_life`.
    seed : int
        Of the levels of new edges.
    count : int, optional
        Number of evenly spaced draws to use; by default all.
    life : Life, optional
        The plan, by the same rules; by default that of `whole_life`.

    Raises
    ------
    UsageError
        No draws of a law in use, or an invalid option.

    Examples
    --------
    >>> import numpy as np
    >>> from fitmodels.controllers import life_laws
    >>> from fitmodels.parameters.draws import Draws
    >>> from fitmodels.parameters.published import published
    >>> laws = life_laws(published("AC-2017"))
    >>> spread = np.array([[np.log(7.62e-3) + e, 0.577, 0.168, 0.248, 0.245] for e in (-0.05, 0.0, 0.05)])
    >>> found = life_draws(laws, {"AW": Draws(("ln c0", "V", "f", "d", "t"), spread)})
    >>> found.minutes.tolist(), found.plan.minutes
    ([17.0, 14.0, 11.0], 14.0)
    """
    for name, value, known in (("of", of, get_args(Of)), ("edge", edge, get_args(Edge))):
        if value not in known:
            raise UsageError(f"{name}={value!r}: give {' or '.join(map(repr, known))}.")
    rules, grid = rules or Rules(laws.times), grid or grid_of(laws)
    used = tuple(name for name in responses(laws) if name in draws)
    if not used:
        held = ", ".join(draws) or "none"
        raise UsageError(f"draws of {held}; the life needs those of {', '.join(responses(laws))}. Fit with draws.")
    _check(laws, draws, used)
    chosen, left_out = _rows(laws, draws, used, count)
    many = _many(laws, draws, chosen, np.random.default_rng(seed) if edge == "new" else None)
    plan = whole_life(laws, rules, grid, most=most) if life is None else life
    if of == "own":
        n, removed = recursions(laws, many, rules, grid, most)
        power = force = None
    else:
        n, removed, power, force = plan_on(plan, many, most)
    unended = int((n >= most).sum())
    return LifeDraws(of, edge, n * rules.interval, removed, power, force, plan, used, left_out, unended)


def responses(laws: LifeLaws) -> tuple[str, ...]:
    """Symbols of the wear and of the limited responses."""
    return (laws.wear.response, *(terms.response for _, terms in laws.limited))


def _check(laws: LifeLaws, draws: "Mapping[str, Draws]", used: tuple[str, ...]) -> None:
    """Raise UsageError for draws of other laws."""
    for terms in (laws.wear, *(terms for _, terms in laws.limited)):
        moving = (("V", terms.V), ("f", terms.f), ("t", terms.t), (laws.wear.response, terms.AW))
        names = ("ln c0", *(name for name, _ in terms.put_in), *(name for name, exponent in moving if exponent))
        missing = [name for name in names if terms.response in used and name not in draws[terms.response].names]
        if missing:
            raise UsageError(f"the draws of {terms.response} lack {', '.join(missing)}: they belong to another law.")


def _rows(laws: LifeLaws, draws: "Mapping[str, Draws]", used: tuple[str, ...], count: int | None) -> tuple[Ints, int]:
    """Rows in use, evenly spaced, and the number of those excluded as their wear does not grow."""
    size = min(len(draws[name].values) for name in used)
    count = size if count is None else min(count, size)
    if count < 1:
        raise UsageError(f"{count} draws: at least one is needed.")
    rows = np.linspace(0, size - 1, count).round().astype(np.intp)
    wear = draws.get(laws.wear.response)
    grows = np.ones(count, dtype=bool) if wear is None else wear.values[rows, wear.names.index("t")] > 0
    if not grows.any():
        raise UsageError(f"no draw of {laws.wear.response} grows with time: there is no end of life. Check the tests.")
    return rows[grows], int((~grows).sum())


def _many(laws: LifeLaws, draws: "Mapping[str, Draws]", rows: Ints, rng: np.random.Generator | None) -> DrawnLifeLaws:
    def one(terms: Terms) -> DrawnTerms:
        return _drawn(terms, laws.wear.response, draws.get(terms.response), rows, rng)

    power, force = (None if terms is None else one(terms) for terms in (laws.power, laws.force))
    return DrawnLifeLaws(one(laws.wear), power, force)


def _drawn(terms: Terms, wear: str, draws: "Draws | None", rows: Ints, rng: np.random.Generator | None) -> DrawnTerms:
    """One law's parameters for these rows; a law without draws is fixed at its estimates."""
    if draws is None:
        ln_c, V, f, t, AW = (np.full(len(rows), value) for value in (terms.ln_c, terms.V, terms.f, terms.t, terms.AW))
        return DrawnTerms(ln_c, V, f, t, AW, terms.most)
    column = dict(zip(draws.names, draws.values[rows].T, strict=True))
    none = np.zeros(len(rows))
    ln_c = column["ln c0"] + sum(times * column[name] for name, times in terms.put_in)
    if rng is not None and "icc" in column:
        edges = column["sd"] * np.sqrt(column["icc"] / (1 - column["icc"]))
        ln_c = ln_c + edges * rng.standard_normal(len(rows))
    V, f, t, AW = (column.get(name, none) for name in ("V", "f", "t", wear))
    return DrawnTerms(ln_c, V, f, t, AW, terms.most)
