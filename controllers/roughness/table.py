"""The eight simulations of SURF's Table 1, each from its own parameter file, with control and without."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...parameters.published.roughness import FEED, TableRow, surf, table1
from .cuts import Steady, steady, turn

if TYPE_CHECKING:
    from .reference import Reading


@dataclass(frozen=True, slots=True)
class Simulated:
    """A row of Table 1 as printed, the reference force of its file, and both simulated cuts in steady cut.

    Without control the feed is the one that the table prints; with control the programmed one, from which the override
    goes to 150 %.
    """

    row: TableRow
    force: float
    controlled: Steady
    without: Steady

    @property
    def error(self) -> float:
        """Mean roughness with control, as a share above the one asked for."""
        return self.controlled.Ra / self.row.Ra_ref - 1

    @property
    def error_without(self) -> float:
        """The same without control."""
        return self.without.Ra / self.row.Ra_ref - 1


def simulated_table(
    force_from: "Reading" = "inverse",
    *,
    feed: float | None = FEED,
    seed: int = 1,
    **more: Any,  # noqa: ANN401
) -> tuple[Simulated, ...]:
    """Simulate all eight rows.

    Parameters
    ----------
    force_from : {"inverse", "regression"}
        Reading of the reference force, each with its law; see `fitmodels.parameters.published.roughness.surf`.
    feed : float or None
        Programmed feed, mm/rev; None takes each row's feed without control, the one recommended for it.
    seed, **more
        As of `turn`.

    Examples
    --------
    >>> found = simulated_table(duration=6.0)
    >>> max(abs(run.error) for run in found) < 0.03
    True
    """
    found = []
    for row in table1():
        pf = surf(row.number, force_from=force_from, feed=row.f_without if feed is None else feed)
        without = turn(pf, control=False, constant_feed=row.f_without, seed=seed, **more)
        controlled = steady(turn(pf, seed=seed, **more))
        section = pf.roughness
        found.append(Simulated(row, np.nan if section is None else section.force, controlled, steady(without)))
    return tuple(found)
