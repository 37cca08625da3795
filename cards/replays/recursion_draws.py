"""What draws of the laws say of a recursion: bands of life, metal removed, power and force, in sentences."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...controllers.recursion import LifeDraws, LifeLaws, Rules, life_draws

if TYPE_CHECKING:
    from ...parameters import Draws

LEVEL = 0.95
OWN = 1000  # draws that each run a recursion
Three = tuple[LifeDraws, LifeDraws, LifeDraws]  # plan on the law, plan on new edges, each draw its own


def drawn(laws: LifeLaws, draws: "Mapping[str, Draws]", rules: Rules, seed: int) -> Three | None:
    """Plan on the law's draws, plan on new edges, and each draw's own; None without draws of the laws used."""
    used = {laws.wear.response, *(terms.response for _, terms in laws.limited)} & set(draws)
    if not used:
        return None
    return (
        life_draws(laws, draws, rules=rules, seed=seed),
        life_draws(laws, draws, rules=rules, seed=seed, edge="new"),
        life_draws(laws, draws, rules=rules, seed=seed, of="own", count=OWN),
    )


def draw_lines(found: Three | None, draws: "Mapping[str, Draws]") -> list[str]:
    """What the draws say of the life, or why they say nothing."""
    if found is None:
        had = f"of {', '.join(draws)} only" if draws else "none"
        told = f"Draws: {had}, so no band of life or metal removed can be told"
        return [f"{told}; `fitmodels data.csv` makes them as it fits a table of tests."]
    plan, new, own = found
    band = f"{100 * LEVEL:g} % band"
    lines = [
        f"This plan on edges of {len(plan.minutes)} drawn laws, the last pair held until they are worn out: "
        f"{_bands(plan)} ({band} of the law, equal-tailed); {_share(plan.ends_early)} are worn out before the plan "
        "ends.",
        f"On single new edges, whose own levels scatter: {_bands(new)} ({band} of edges); {_share(new.ends_early)} are "
        "worn out before the plan ends.",
        f"If each of {len(own.minutes)} drawn laws chose its own pairs: {_bands(own)} ({band} of the law).",
        *_peak_lines(plan, band),
    ]
    if plan.left_out or plan.unended:
        lines.append(f"{plan.left_out} draws without growing wear are left out; {plan.unended} lives were cut short.")
    return lines


def _peak_lines(plan: LifeDraws, band: str) -> list[str]:
    """Power and force of the plan, draw by draw."""
    lines = []
    for what, terms in (("peak_power", plan.plan.laws.power), ("peak_force", plan.plan.laws.force)):
        values = getattr(plan, what)
        if terms is None or values is None:
            continue
        low, middle, high = (rounded(end) for end in plan.band(what, LEVEL))
        passes = _share(float((values > terms.most).mean()))
        lines.append(
            f"The plan's peak {what[5:]} is {low} to {high} {terms.unit}, middle {middle} ({band} of the law), and "
            f"passes {terms.most:g} {terms.unit} in {passes} of the draws."
        )
    return lines


def _bands(found: LifeDraws) -> str:
    low, middle, high = found.band("minutes", LEVEL)
    least, half, most = (end / 1000 for end in found.band("removed", LEVEL))
    return (
        f"life {low:.3g} to {high:.3g} min, middle {middle:.3g}, and {least:.0f} to {most:.0f} cm3 removed, "
        f"middle {half:.0f}"
    )


def _share(share: float) -> str:
    return f"{100 * share:.0f} %"


def rounded(value: float) -> str:
    """A force to the newton, a power to three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
