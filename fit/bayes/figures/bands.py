"""Bands of the law and of its rows, and the axes on which they are drawn.

Bands of rows are those of rows of a new edge: scatter between edges and within them.
"""

from math import exp, log
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from ...draw import round_numbers

if TYPE_CHECKING:
    from ...lawfit import LawFit
    from ..posterior import Posterior

Array = NDArray[np.float64]

WHOLE, HALF = (0.025, 0.975), (0.25, 0.75)


def conditions(law: "LawFit", X: Array, level: NDArray[np.intp]) -> pd.DataFrame:
    """Factors (n, k), and the level of the category, as the law is asked."""
    new = pd.DataFrame(X, columns=list(law.factors))
    return new if law.by is None else new.assign(**{law.by.column: np.array(levels_of(law))[level]})


def levels_of(law: "LawFit") -> tuple[str, ...]:
    """Levels of the category, the reference first; one empty name where there is none."""
    return ("",) if law.by is None else (law.by.reference, *law.by.levels)


def level_of_rows(law: "LawFit") -> NDArray[np.intp]:
    """Number of each row's level, 0 the reference."""
    return np.asarray(law.shifts @ np.arange(1, law.shifts.shape[1] + 1), dtype=np.intp)


def bands_at(posterior: "Posterior", new: pd.DataFrame) -> tuple[Array, Array]:
    """Quantiles of the law (5, m) and of a row of a new edge (2, m); one scatter a draw, so that bands are smooth."""
    law, one = posterior.responses(new), new.iloc[:1]
    centre, row = posterior.responses(one), posterior.responses(one, "prediction")
    rows = law + (row - centre) if posterior.density.natural else law * (row / centre)
    return np.quantile(law, (WHOLE[0], HALF[0], 0.5, HALF[1], WHOLE[1]), axis=0), np.quantile(rows, WHOLE, axis=0)


def a_row(posterior: "Posterior") -> str:
    """Of what the band of rows is, in words."""
    return "a row of a new edge" if posterior.density.edges else "a row"


def scaled(ax: Axes, which: str, values: Array, *, logs: bool) -> None:
    """Limits about the values and few ticks, at round numbers where the axis is logarithmic."""
    low, high = float(values.min()), float(values.max())
    reach = 0.06 * (log(high / low) if logs else high - low) or 0.06
    ends = (low * exp(-reach), high * exp(reach)) if logs else (low - reach, high + reach)
    axis = ax.xaxis if which == "x" else ax.yaxis
    if logs:
        ax.set(**{f"{which}scale": "log"})
        axis.set_major_locator(FixedLocator(round_numbers(low, high, 3, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter("{x:.7g}")
    ax.set(**{f"{which}lim": ends})


def evenly(of: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most ``most`` of the positions (n,), evenly chosen, the first and the last among them."""
    return of[np.linspace(0, len(of) - 1, min(len(of), most)).round().astype(np.intp)]
