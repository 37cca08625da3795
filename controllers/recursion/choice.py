"""One interval's pair: from the grid as published, or the exact optimum."""

from dataclasses import dataclass
from typing import Literal, get_args

from ...core.display import Displayable
from ...core.errors import UsageError
from .grid import Grid, surfaces
from .laws import LifeLaws
from .rules import Rules, told

How = Literal["grid", "exact"]


@dataclass(frozen=True, slots=True, repr=False)
class Choice(Displayable):
    """A pair of speed and feed and what it does in its interval.

    Attributes
    ----------
    V, f : float
        m/min, mm/rev.
    AW, P, Fxz : float
        Wear, power and force at the end of the interval, in the units of their laws; NaN where a law is missing.
    MRR : float
        mm3/min.
    stops : tuple of str
        What forbids more: ``power``, ``force``, ``wear``, ``most speed``, ``most feed``.
    """

    V: float
    f: float
    AW: float
    P: float
    Fxz: float
    MRR: float
    stops: tuple[str, ...] = ()


def choose(laws: LifeLaws, rules: Rules, grid: Grid, how: How, before: float, start: float) -> Choice | None:
    """The pair of the largest MRR in the interval that begins at ``start`` min with wear ``before``, or None.

    Raises
    ------
    UsageError
        ``exact`` of laws that do not allow it; see `best_exact`.
    """
    if how not in get_args(How):
        raise UsageError(f"choose={how!r}: it is 'grid' or 'exact'.")
    if how == "exact":
        from .optimum import best_exact

        return best_exact(laws, rules, before, start)
    tried = surfaces(laws, rules, grid, before, start)
    if (at := tried.best()) is None:
        return None
    AW = float(tried.AW[at])
    return outcome(
        laws, rules, float(grid.V[at[0]]), float(grid.f[at[1]]), AW, start + rules.interval, tried.stops(*at)
    )


def outcome(
    laws: LifeLaws, rules: Rules, V: float, f: float, AW: float, end: float, stops: tuple[str, ...] = ()
) -> Choice:
    """A pair with the power and force that it draws at the end of its interval."""
    values = {name: float(told(terms, rules, V, f, end, AW)) for name, terms in laws.limited}
    none = float("nan")
    return Choice(V, f, AW, values.get("power", none), values.get("force", none), float(laws.mrr(V, f)), stops)
