"""The eight simulations of Table 1 of SURF, told."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...controllers.roughness import Simulated
    from ...parameters import RoughnessSection


def table_lines(
    section: "RoughnessSection", seed: int, facts: dict[str, object], figures: "dict[str, Figure]"
) -> list[str]:
    """Mean roughness with and without control, and how far the feed ripples; facts and the figure are put in."""
    from ...controllers.roughness import simulated_table
    from ...controllers.roughness.draw import table_picture

    found = simulated_table(section.force_from, feed=section.feed, seed=seed)
    white = simulated_table(section.force_from, feed=section.feed, seed=seed, hold=0.0)
    figures["roughness_table"] = table_picture(found, f"; reference force by {section.force_from}")
    facts["table"] = [_fact(run) for run in found]
    worst = max(found, key=lambda run: abs(run.error))
    mean, without = (float(np.mean([abs(e) for e in errors])) for errors in
                     ([run.error for run in found], [run.error_without for run in found]))  # fmt: skip
    rests = [f"{run.row.number} ({100 * run.controlled.at_high:.0f} % of the time)" for run in found
             if run.controlled.at_high > 0.05]  # fmt: skip
    limited = f" Simulations {' and '.join(rests)} rest on the upper limit of the feed." if rests else ""
    ripple, of_white = (max(run.controlled.ripple for run in runs) for runs in (found, white))
    facts |= {"table_mean_error": mean, "table_mean_error_without": without, "table_ripple_mm_per_rev": ripple,
              "table_ripple_drawn_each_sample_mm_per_rev": of_white}  # fmt: skip
    return [
        f"The eight simulations of Table 1: mean Ra within {100 * abs(worst.error):.1f} % of each reference with "
        f"control, {100 * mean:.1f} % off on average, {100 * without:.1f} % at the table's constant feeds.{limited}",
        f"Largest ripple of the feed among them {ripple:.3f} mm/rev peak-to-peak with the force drawn anew each "
        f"revolution, {of_white:.3f} drawn every 10 ms.",
    ]


def _fact(run: "Simulated") -> dict[str, float]:
    on, off = run.controlled, run.without
    return {
        "simulation": run.row.number, "Ra_ref_um": run.row.Ra_ref, "F_ref_N": run.force, "Ra_um": on.Ra, "F_N": on.F,
        "f_mm_per_rev": on.f, "f_peak_to_peak_mm_per_rev": on.ripple, "share_at_high": on.at_high,
        "Ra_without_um": off.Ra, "F_without_N": off.F,
    }  # fmt: skip
