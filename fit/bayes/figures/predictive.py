"""Rows as they were measured, in the band in which the law expects them."""

import re
from dataclasses import dataclass
from functools import partial
from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ...domain import changes_within
from ...draw import BLUE, ORANGE, label
from .bands import a_row, bands_at, conditions, evenly, level_of_rows, scaled
from .sheet import MOST_PANELS, Sheet

if TYPE_CHECKING:
    from ...lawfit import LawFit
    from ..posterior import Posterior

Array = NDArray[np.float64]

OF_AN_EDGE, OF_ALL = 25, 600  # rows that are drawn of one edge, and of rows that have no edge in common


@dataclass(frozen=True, slots=True)
class Seen:
    """Rows x, y (m,) of one edge, and the median (m,) and band (2, m) of a row at their conditions."""

    edge: str
    x: Array
    y: Array
    median: Array
    band: Array


def predictive(posterior: "Posterior") -> Sheet:
    """Rows of each edge in the band of a row of a new edge; rows that have no edge in common, in one panel."""
    law = posterior.law
    names, groups, clock = _groups(law)
    rows, cuts = np.concatenate(groups), np.cumsum([len(i) for i in groups])[:-1]
    middle, band = bands_at(posterior, conditions(law, law.X[rows], level_of_rows(law)[rows]))
    of_all = (
        law.X[rows, law.factors.index(clock)] if clock else np.concatenate([np.arange(1.0, len(i) + 1) for i in groups])
    )
    x, y, median = (np.split(of_row, cuts) for of_row in (of_all, law.observed[rows], middle[2]))
    seen = [Seen(*parts) for parts in zip(names, x, y, median, np.split(band, cuts, axis=1), strict=True)]
    place = "row of the edge" if names[0] else "row, in the order of the prediction"
    along = label(law, clock) if clock else f"{place} [1]"
    limits = of_all, np.concatenate([law.observed[rows], *band])
    panels = [partial(_rows, posterior, s, limits, along, law.form == "power" and clock is not None) for s in seen]
    title = f"{law.response}: {_which(law, names, len(rows))} in the 95 % band of {a_row(posterior)}"
    if len(panels) == 1:
        return Sheet(title, panels, 1, (3.9, 3.0))
    return Sheet(title, panels, max(3, ceil(sqrt(1.5 * len(panels)))), (1.7, 1.5), (0.08, 0.24), shared=True)


def _groups(law: "LawFit") -> tuple[list[str], list[NDArray[np.intp]], str | None]:
    """Rows of each edge along the factor that changes within edges, t if it does, and the name of that factor.

    Rows that have no edge in common are one group, in the order of the prediction.
    """
    if law.edge is None or law.n_edges == law.nobs:
        return [""], [evenly(np.argsort(law.fitted, kind="stable"), OF_ALL)], None
    names, number = np.unique(law.edge.astype(str), return_inverse=True)
    within = [law.factors[j] for j in np.flatnonzero(changes_within(law.X, number))]
    clock = "t" if "t" in within else next(iter(within), None)
    order = np.argsort(law.X[:, law.factors.index(clock)], kind="stable") if clock else np.arange(law.nobs)
    in_order = sorted(range(len(names)), key=lambda g: _counted(str(names[g])))
    chosen = evenly(np.array(in_order), MOST_PANELS)
    return [str(names[g]) for g in chosen], [evenly(order[number[order] == g], OF_AN_EDGE) for g in chosen], clock


def _counted(name: str) -> list[str | int]:
    """A key that puts edge 2 before edge 10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def _which(law: "LawFit", names: list[str], n: int) -> str:
    """Which rows are drawn, in words."""
    G = law.n_edges if names[0] else None
    rows = f"{n} rows" if n == law.nobs else f"{n} of {law.nobs} rows"
    edges = "" if G is None else f" of edge {names[0]}" if G == 1 else f" of {G} edges"
    if G is not None and len(names) < G:
        edges = f" of {len(names)} of {G} edges"
    return rows + edges + ("" if n == law.nobs else ", evenly chosen,")


def _rows(posterior: "Posterior", s: Seen, limits: tuple[Array, Array], along: str, logs: bool, ax: Axes) -> None:
    scaled(ax, "x", limits[0], logs=logs)
    scaled(ax, "y", limits[1], logs=posterior.law.form == "power" and bool(limits[1].min() > 0))
    x = s.x if np.ptp(s.x) > 0 else _stretched(ax, s.x, logs=logs)
    low, high = np.broadcast_to(s.band, (2, len(x)))
    ax.fill_between(x, low, high, color=BLUE, alpha=0.15, lw=0, label=f"95 % of {a_row(posterior)}")
    ax.plot(x, np.broadcast_to(s.median, x.shape), color=ORANGE, lw=1.2, label="median")
    outside = (s.y < s.band[0]) | (s.y > s.band[1])
    ax.plot(s.x[~outside], s.y[~outside], "o", ms=3.5, mfc="none", mec=BLUE, mew=0.8, label="rows")
    title, colour = s.edge, "black"
    if outside.any():
        ax.plot(s.x[outside], s.y[outside], "o", ms=3.5, color=ORANGE, label="rows outside")
        title, colour = f"{s.edge}: {outside.sum()} of {len(s.y)} outside".removeprefix(": "), ORANGE
    ax.set_title(title, fontsize=8, pad=3, color=colour)
    ax.set_xlabel(along)
    ax.set_ylabel(label(posterior.law, posterior.response))


def _stretched(ax: Axes, x: Array, *, logs: bool) -> Array:
    """Points at one place (m,), as far apart as lets a band be seen."""
    low, high = ax.get_xlim()
    to = np.linspace(-0.04, 0.04, len(x)) if len(x) > 1 else np.array([-0.04, 0.04])
    return x * (high / low) ** to if logs else x + (high - low) * to
