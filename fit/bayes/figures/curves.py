"""The law along each factor, the others at the middle of their range and the rows moved there along the law."""

from dataclasses import dataclass
from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ...draw import BLUE, GREY, ORANGE, label, middle, points
from .bands import a_row, bands_at, conditions, evenly, level_of_rows, levels_of, scaled
from .sheet import Sheet

if TYPE_CHECKING:
    from ..posterior import Posterior

Array = NDArray[np.float64]

MOST_LEVELS = 4  # of a category: a row of curves each
OF_A_CURVE, BESIDE_IT = 61, 1000  # points, and rows: more hide the curve
BEYOND = 0.12  # of the range of a factor: how far curves go on beyond it


@dataclass(frozen=True, slots=True)
class Curve:
    """The law (5, m) and a row of it (2, m) along a factor, and rows x, y (n,) moved to these conditions."""

    factor: str
    held: str
    tested: tuple[float, float]
    grid: Array
    law: Array
    rows: Array
    x: Array
    y: Array


def curves(posterior: "Posterior") -> Sheet:
    """The law along each factor, a row of panels for each level of the category."""
    law, k = posterior.law, len(posterior.law.factors)
    levels = levels_of(law)[:MOST_LEVELS]
    drawn = [_curve(posterior, j, i) for i in range(len(levels)) for j in range(k)]
    title = f"{law.response} on {law.factors[0] if k == 1 else 'each factor'}"
    if len(levels) < len(levels_of(law)):
        title += f", the first {len(levels)} of {len(levels_of(law))} levels of {law.by.column if law.by else ''}"
    if law.nobs > BESIDE_IT:
        title += f", at most {BESIDE_IT} rows in a panel"
    if k > 1:
        title += "; rows moved along the law to the values over each panel"
    values = np.concatenate([np.concatenate([c.y, *c.rows]) for c in drawn])
    panels = [partial(_along, posterior, c, values) for c in drawn]
    return Sheet(title, panels, k, (2.8, 2.6) if len(panels) > 1 else (3.9, 3.0), (0.08, 0.2), shared=True)


def _curve(posterior: "Posterior", j: int, level: int) -> Curve:
    law, logs = posterior.law, posterior.law.form == "power"
    every = np.flatnonzero(level_of_rows(law) == level)
    tested = float(law.X[every, j].min()), float(law.X[every, j].max())
    mine = evenly(every, BESIDE_IT)
    x, y = law.X[mine], law.observed[mine]
    grid = _beyond(*law.domain[law.factors[j]], logs=logs)
    centre = np.array([middle(ends, logs) for ends in law.domain.values()])
    there, here = (np.repeat(centre[None], n, axis=0) for n in (len(x), len(grid)))
    there[:, j], here[:, j] = x[:, j], grid
    theta = np.median(posterior.draws[:, : len(law.theta)], axis=0)
    moved, was = (law.law.response_at(theta, law.law.design(at, law.shifts[mine])) for at in (there, x))
    held = [f"{law.by.column} {levels_of(law)[level]}"] if law.by else []
    held += [
        f"{name} {value:.3g} {law.units.get(name, '')}".rstrip()
        for name, value in zip(law.factors, centre, strict=True)
        if name != law.factors[j]
    ]
    bands = bands_at(posterior, conditions(law, here, np.full(len(grid), level)))
    y = y + (moved - was) if posterior.density.natural else y * (moved / was)
    return Curve(law.factors[j], ", ".join(held), tested, grid, *bands, x[:, j], y)


def _beyond(low: float, high: float, *, logs: bool) -> Array:
    """Points of a factor from a little below its range, but not below zero, to a little above."""
    if logs:
        reach = (high / low) ** BEYOND
        return np.geomspace(low / reach, high * reach, OF_A_CURVE)
    reach = (high - low) * BEYOND
    return np.linspace(low - reach if low < 0 else max(low - reach, 0.0), high + reach, OF_A_CURVE)


def _along(posterior: "Posterior", c: Curve, values: Array, ax: Axes) -> None:
    law, logs = posterior.law, posterior.law.form == "power"
    ax.fill_between(c.grid, *c.rows, color=BLUE, alpha=0.13, lw=0, label=f"95 % of {a_row(posterior)}")
    ax.fill_between(c.grid, c.law[0], c.law[4], color=BLUE, alpha=0.3, lw=0, label="95 % of the law")
    ax.fill_between(c.grid, c.law[1], c.law[3], color=BLUE, alpha=0.45, lw=0, label="50 % of the law")
    ax.plot(c.grid, c.law[2], color=ORANGE, lw=1.2, zorder=3, label="median")
    points(ax, c.x, c.y)
    ax.lines[-1].set_label("rows")
    scaled(ax, "x", c.grid, logs=logs)
    scaled(ax, "y", values, logs=logs and bool(values.min() > 0))
    low, high = ax.get_xlim()
    ax.axvspan(low, c.tested[0], color=GREY, alpha=0.2, lw=0, label="not tested")
    ax.axvspan(c.tested[1], high, color=GREY, alpha=0.2, lw=0)
    ax.set(xlim=(low, high))
    ax.set_title(fill(c.held, 44), fontsize=8, pad=3)
    ax.set_xlabel(label(law, c.factor))
    ax.set_ylabel(label(law, posterior.response))
