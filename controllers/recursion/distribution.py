"""Life and metal removed when the laws are uncertain: two readings, kept apart.

plan    the pairs that the laws as fitted choose, cut on edges whose laws are drawn; the last pair is held until the
        edge is worn out. What one plan does on the edges that may come: how often it ends early, what power and force
        it then takes.
own     each draw chooses its own pairs, as if its laws were known. What could be had, and how far that is known.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ...core.display import Displayable, as_columns
from ...core.errors import UsageError
from .grid import Grid, grid_of
from .laws import Array, LifeLaws, Terms
from .life import MOST, Life, whole_life
from .many import DrawnTerms, ManyLaws, plan_on, recursions
from .rules import Rules

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...core.display import Frame
    from ...parameters import Draws

Of = Literal["plan", "own"]
Edge = Literal["law", "new"]


@dataclass(frozen=True, slots=True, repr=False)
class LifeDraws(Displayable):
    """Life and metal removed, draw by draw: calculated from draws of the laws.

    Attributes
    ----------
    of : {"plan", "own"}
        Which reading; see the module.
    edge : {"law", "new"}
        Draws of the law, which is that of a middling edge, or of a new edge with a level of its own.
    minutes, removed : ndarray, shape (S,)
        Life, min, in whole intervals, and metal removed, mm3.
    peak_power, peak_force : ndarray, shape (S,), or None
        Of the plan on each edge: the largest of its life; None of ``own``, which keeps to its limits.
    plan : Life
        What the laws as fitted choose.
    drawn : tuple of str
        Responses that were drawn; the others stand as they were fitted.
    left_out : int
        Draws whose wear does not grow with time: they have no end.
    unended : int
        Draws not worn out after the most intervals that are computed: their life is that many.
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

    def band(self, what: str = "removed", level: float = 0.95) -> tuple[float, float, float]:
        """Low end, median and high end of an equal-tailed band of ``removed``, ``minutes``, ``peak_power`` ...

        Raises
        ------
        UsageError
            There is no such quantity, or the level is no share.
        """
        values = getattr(self, what, None) if what in ("removed", "minutes", "peak_power", "peak_force") else None
        if values is None:
            raise UsageError(f"band of {what!r}: this has removed and minutes, a plan peak_power and peak_force too.")
        if not 0 < level < 1:
            raise UsageError(f"level={level!r}: it lies between 0 and 1.")
        low, middle, high = np.quantile(values, [(1 - level) / 2, 0.5, (1 + level) / 2])
        return float(low), float(middle), float(high)

    def to_frame(self) -> "Frame":
        """A row a draw: minutes, and mm3 removed."""
        return as_columns(self, "minutes", "removed")

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Life over the draws."""
        from .draw import draws_picture

        return draws_picture(self, ax)


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
) -> LifeDraws:
    """The distribution of life and of metal removed.

    Parameters
    ----------
    laws : LifeLaws
        As fitted: they choose the plan.
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
        An even choice of so many draws; all unless given.

    Raises
    ------
    UsageError
        There are no draws of a law that is used, or an option is none.

    Examples
    --------
    >>> import numpy as np
    >>> from fitmodels.controllers.recursion import life_laws
    >>> from fitmodels.parameters import Draws
    >>> from fitmodels.parameters.published import published
    >>> laws = life_laws(published("AC-2017"))
    >>> spread = np.array([[np.log(7.62e-3) + e, 0.577, 0.168, 0.248, 0.245] for e in (-0.05, 0.0, 0.05)])
    >>> found = life_draws(laws, {"AW": Draws(("ln c0", "V", "f", "d", "t"), spread)})
    >>> found.minutes.tolist(), found.plan.minutes
    ([17.0, 14.0, 11.0], 14.0)
    """
    for name, value, known in (("of", of, get_args(Of)), ("edge", edge, get_args(Edge))):
        if value not in known:
            raise UsageError(f"{name}={value!r}: it is {' or '.join(map(repr, known))}.")
    rules, grid = rules or Rules(laws.times), grid or grid_of(laws)
    used = tuple(name for name in responses(laws) if name in draws)
    if not used:
        held = ", ".join(draws) or "none"
        raise UsageError(f"draws of {held}; the life needs those of {', '.join(responses(laws))}. Fit with draws.")
    _check(laws, draws, used)
    chosen, left_out = _rows(laws, draws, used, count)
    many = _many(laws, draws, chosen, np.random.default_rng(seed) if edge == "new" else None)
    plan = whole_life(laws, rules, grid, most=most)
    if of == "own":
        n, removed = recursions(laws, many, rules, grid, most)
        power = force = None
    else:
        n, removed, power, force = plan_on(plan, many, most)
    unended = int((n >= most).sum())
    return LifeDraws(of, edge, n * rules.interval, removed, power, force, plan, used, left_out, unended)


def responses(laws: LifeLaws) -> tuple[str, ...]:
    """Symbols of wear and of what is limited."""
    return (laws.wear.response, *(terms.response for _, terms in laws.limited))


def drawn_laws(laws: LifeLaws, draws: "Mapping[str, Draws]", k: int) -> LifeLaws:
    """The laws of draw k, for an edge to be cut: `WearingEdge(drawn_laws(laws, draws, 0))`."""

    def one(terms: Terms) -> Terms:
        if terms.response not in draws:
            return terms
        found = _drawn(terms, laws.wear.response, draws[terms.response], np.array([k]), None)
        ln_c, V, f, t, AW = (float(getattr(found, name)[0]) for name in ("ln_c", "V", "f", "t", "AW"))
        return replace(terms, ln_c=ln_c, V=V, f=f, t=t, AW=AW)

    power, force = (None if terms is None else one(terms) for terms in (laws.power, laws.force))
    return replace(laws, wear=one(laws.wear), power=power, force=force)


def _check(laws: LifeLaws, draws: "Mapping[str, Draws]", used: tuple[str, ...]) -> None:
    """Refuse draws that are not those of the laws."""
    for terms in (laws.wear, *(terms for _, terms in laws.limited)):
        moving = (("V", terms.V), ("f", terms.f), ("t", terms.t), (laws.wear.response, terms.AW))
        names = ("ln c0", *(name for name, _ in terms.put_in), *(name for name, exponent in moving if exponent))
        missing = [name for name in names if terms.response in used and name not in draws[terms.response].names]
        if missing:
            raise UsageError(
                f"the draws of {terms.response} are without {', '.join(missing)}: they are of another law."
            )


def _rows(
    laws: LifeLaws, draws: "Mapping[str, Draws]", used: tuple[str, ...], count: int | None
) -> tuple[np.ndarray[tuple[int], np.dtype[np.intp]], int]:
    """Rows that are used, an even choice, and how many of them are left out as their wear does not grow."""
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


def _many(
    laws: LifeLaws, draws: "Mapping[str, Draws]", rows: np.ndarray[tuple[int], np.dtype[np.intp]],
    rng: np.random.Generator | None,
) -> ManyLaws:  # fmt: skip
    def one(terms: Terms) -> DrawnTerms:
        return _drawn(terms, laws.wear.response, draws.get(terms.response), rows, rng)

    power, force = (None if terms is None else one(terms) for terms in (laws.power, laws.force))
    return ManyLaws(one(laws.wear), power, force)


def _drawn(
    terms: Terms, wear: str, draws: "Draws | None", rows: np.ndarray[tuple[int], np.dtype[np.intp]],
    rng: np.random.Generator | None,
) -> DrawnTerms:  # fmt: skip
    """One law's numbers for these rows; a law without draws stands as it was fitted."""
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
