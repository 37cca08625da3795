"""What the recursion of AC-2017 gains over the best fixed pair of speed and feed."""

from collections.abc import Sequence

from ...controllers.recursion import Life, best_fixed, compared
from .recursion_draws import rounded


def fixed_lines(life: Life) -> list[str]:
    """Metal, life, peak power and peak force of the best fixed pair beside the recursion's."""
    fixed = best_fixed(life.laws, life.rules, life.grid) if len(life.time) else None
    if fixed is None:
        return []
    ratio, peaks = compared(life, fixed), {"power": fixed.peak_power, "force": fixed.peak_force}
    own = {"power": life.P, "force": life.Fxz}
    told = [
        f"{name} {rounded(peaks[name])} {terms.unit} against {rounded(float(own[name].max()))}"
        for name, terms in life.laws.limited
    ]
    return [
        f"The best fixed pair that keeps its limits to the end, {fixed.V:g} m/min and {fixed.f:g} mm/rev, lasts "
        f"{fixed.minutes:.1f} min and removes {metal(fixed.removed)}, {metal(fixed.per_minute)} a minute: the "
        f"recursion removes {ratio.per_minute:.2f} times as much a minute and {ratio.removed:.2f} times as much an edge"
        f"{f'; at its peak the fixed pair takes {listed(told)}' if told else ''}."
    ]


def fixed_facts(life: Life) -> dict[str, object] | None:
    """The best fixed pair for a program; power and force where they are limited."""
    fixed = best_fixed(life.laws, life.rules, life.grid) if len(life.time) else None
    if fixed is None:
        return None
    peaks = {"power": fixed.peak_power, "force": fixed.peak_force}
    return {
        "V_m_per_min": fixed.V, "f_mm_per_rev": fixed.f, "life_min": fixed.minutes, "removed_mm3": fixed.removed,
        "removed_mm3_per_min": fixed.per_minute,
        **{f"peak_{name}_{terms.unit}": peaks[name] for name, terms in life.laws.limited},
    }  # fmt: skip


def metal(volume: float) -> str:
    """Metal in cm3; the facts have mm3 in full."""
    return f"{volume / 1000:.4g} cm3"


def listed(names: Sequence[str]) -> str:
    """Names with an ``and`` before the last."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 2 else names)
