"""How well a form foretells edges it has not seen; those on which its draws lean too much are left out in earnest.

Source: Vehtari, Gelman & Gabry 2017, Stat. Comput. 27, 1413, section 2.1: where k-hat is above 0.7, fit again without.
"""

from dataclasses import replace

import numpy as np

from .edge_slopes import EdgeSlopes
from .law_density import LawDensity
from .leave_out import LeaveOut, leave_one_out
from .route import Drawn, Progress, drawn, judged
from .sample import Sample


def drawn_law(density: LawDensity, seed: int, draws: int, progress: Progress | None = None) -> Drawn:
    """Exact where the form is linear in logarithms with errors there, else importance sampling or chains."""
    from .exact import exact

    if type(density) is LawDensity and not density.natural:
        return judged(density, exact(density, np.random.default_rng(seed), draws))
    return drawn(density, seed, draws, progress)


def foretold(density: LawDensity, sample: Sample, seed: int, draws: int) -> tuple[LeaveOut, tuple[str, ...]]:
    """Expected log density of left-out units, and the units that were left out in earnest."""
    found = leave_one_out(density.by_unit(sample.phi), density.units)
    again = found.doubtful
    pointwise, k_hat = found.pointwise.copy(), found.k_hat.copy()
    for name in again:
        g = density.units.index(name)
        other = drawn_law(_without(density, g), seed, draws).sample
        seen = density.by_unit(other.phi)[:, g]
        pointwise[g], k_hat[g] = np.logaddexp.reduce(seen) - np.log(len(seen)), 0.0
    lost = float((found.pointwise - pointwise).sum())
    se = float(np.sqrt(len(pointwise) * pointwise.var(ddof=1)))
    return replace(
        found, elpd=found.elpd - lost, se=se, p_eff=found.p_eff + lost, pointwise=pointwise, k_hat=k_hat
    ), again


def _without(density: LawDensity, g: int) -> LawDensity:
    """The density on all units but one."""
    start, size = int(density.starts[g]), int(density.sizes[g])
    keep = np.r_[0:start, start + size : len(density.y)]
    rest = np.delete(np.arange(len(density.units)), g)
    starts = np.r_[0, np.cumsum(density.sizes[rest])[:-1]].astype(np.intp)
    out = replace(
        density, Z=density.Z[keep], y=density.y[keep], starts=starts, sizes=density.sizes[rest],
        labels=density.labels[rest],
    )  # fmt: skip
    return (
        replace(out, time=density.time[keep])
        if isinstance(density, EdgeSlopes) and isinstance(out, EdgeSlopes)
        else out
    )
