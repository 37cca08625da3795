"""Figures and axes that a notebook shows: ``result.plot()`` as the last line of a cell is its figure.

Nothing here uses pyplot, so nothing is shown twice, kept open or shown by a script. A notebook shows what has a
``_repr_png_``; matplotlib's own figures have none until pyplot gives them one, and its axes never do.
"""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

BLUE, ORANGE, GREY = "#1f5fa8", "#c8551b", "#8a8a8a"
SHARP = 2  # pixels drawn for each that is laid out: screens of notebooks are fine
MOST = 60  # estimates in one picture


def png(figure: Any) -> tuple[bytes, dict[str, int]]:  # noqa: ANN401  Figure or SubFigure
    """A figure as a PNG and the size it is shown at, as notebooks take it."""
    held = BytesIO()
    whole = figure.get_figure(root=True) or figure
    whole.savefig(held, format="png", dpi=SHARP * whole.dpi)
    width, height = (round(side * whole.dpi) for side in whole.get_size_inches())
    return held.getvalue(), {"width": width, "height": height}


class NotebookFigure(Figure):
    """A figure that a notebook shows."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        return png(self)


class NotebookAxes(Axes):
    """Axes that a notebook shows, with all of their figure."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        return png(self.figure)


class NotebookAxesArray(np.ndarray[Any, Any]):
    """Axes of one figure in an array, which a notebook shows as that figure."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]] | None:
        first = self.ravel()[0] if self.size else None
        return png(first.figure) if isinstance(first, Axes) else None


def new_axes(ax: Axes | None, width: float = 4.8, height: float = 4.2) -> Axes:
    """The axes that were given, or axes of their own on a figure of so many inches."""
    if ax is not None:
        return ax
    figure = NotebookFigure(figsize=(width, height), layout="constrained")
    return figure.add_subplot(axes_class=NotebookAxes)


def axes_array(panels: Sequence[Axes]) -> NDArray[np.object_]:
    """Axes of one figure, shown together."""
    held = np.empty(len(panels), dtype=object)
    held[:] = panels
    return held.view(NotebookAxesArray)


def whiskers(
    rows: Mapping[str, tuple[float, float, float]], ax: Axes | None = None, *, label: str = "", title: str = ""
) -> Axes:
    """Estimates as dots on their intervals, from the top down: names of (value, low, high), ends NaN where unknown."""
    shown = dict(list(rows.items())[:MOST])
    ax = new_axes(ax, 4.8, 1.1 + 0.34 * max(len(shown), 3))
    for at, (value, low, high) in enumerate(shown.values()):
        if np.isfinite([low, high]).all():
            ax.plot([low, high], [at, at], color=BLUE, lw=1.4, solid_capstyle="butt")
        ax.plot([value], [at], "o", ms=5, color=BLUE)
    ax.set_yticks(range(len(shown)), list(shown))
    ax.set_ylim(len(shown) - 0.5, -0.5)
    if any(value * low <= 0 or value * high <= 0 for value, low, high in shown.values()):
        ax.axvline(0, color=GREY, lw=0.8, zorder=0)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.set_xlabel(label)
    ax.set_title(title, fontsize=9)
    return ax
