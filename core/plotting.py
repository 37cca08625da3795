"""Figures and axes that a notebook shows: ``result.plot()`` as the last line of a cell is its figure.

Functions that draw make figures without pyplot, so that the command and the card keep none open. ``result.plot()``
without ``ax`` then hands its figure to pyplot (`to_pyplot`). A notebook shows what has a ``_repr_png_``; matplotlib's
own figures have none until pyplot gives them one, and its axes never do.
"""

import sys
import threading
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter, MaxNLocator

from .arrays import Texts
from .errors import UsageError
from .figure_style import BLUE, DOT, GREY, LIGHT, LINE, RED, SERIES, SMALL, TEXT, THIN, TITLE, new_axes
from .text import printable

SHARP = 2  # pixels drawn for each that is laid out: screens of notebooks are fine
LEGEND: dict[str, Any] = {"fontsize": SMALL, "frameon": False}
MOST = 60  # estimates in one picture
LONGEST_TEXT = (
    500  # characters of a text in a figure: each takes a third of a millisecond, of a cell of 32 kB ten seconds
)


def png(figure: Any) -> tuple[bytes, dict[str, int]]:  # noqa: ANN401  Figure or SubFigure
    """A figure as a PNG and the size it is shown at, as notebooks take it."""
    held, whole = BytesIO(), figure.figure
    save_figure(whole, held, format="png", dpi=SHARP * whole.dpi)
    width, height = (round(side * whole.dpi) for side in whole.get_size_inches())
    return held.getvalue(), {"width": width, "height": height}


def save_figure(figure: Figure, file: Any, **options: Any) -> None:  # noqa: ANN401  path or stream
    """Write a figure by `Figure.savefig`; names in it are drawn as `plain_texts` does."""
    plain_texts(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # drawn as an empty box
        figure.savefig(file, **options)


def plain_texts(figure: Any) -> None:  # noqa: ANN401  Figure or SubFigure
    """Have the names in a figure drawn as they are: ``$`` begins no mathematics, and what is not shown gets a mark."""
    powers = {
        label
        for ax in figure.axes
        for axis in (ax.xaxis, ax.yaxis)
        if isinstance(axis.get_major_formatter(), LogFormatter)
        for label in axis.get_ticklabels(which="both")
    }
    for text in figure.findobj(Text):
        words = text.get_text()
        if text not in powers and "$" in words:
            text.set_parse_math(False)
        cut = words if len(words) <= LONGEST_TEXT else words[: LONGEST_TEXT - 3] + "..."
        if (shown := printable(cut)) != words:
            text.set_text(shown)


def with_plain_texts(drawn: Any) -> Any:  # noqa: ANN401  Axes, or an array of them
    """The same axes, the names in their figure drawn as they are."""
    plain_texts((drawn.ravel()[0] if isinstance(drawn, np.ndarray) else drawn).figure)
    return drawn


HALO: Any = [withStroke(linewidth=2.0, foreground="white", alpha=0.8)]


def dress(ax: Any) -> None:  # noqa: ANN401  Axes of any projection
    """Give axes the style of the package: frame on two sides, a light grid, colours and sizes of text."""
    ax.tick_params(which="both", labelsize=SMALL, color=GREY, labelcolor=LIGHT.ink, width=THIN, length=3)
    for axis in (ax.xaxis, ax.yaxis):
        axis.label.set(fontsize=TEXT, color=LIGHT.ink)
    if ax.name != "rectilinear":
        return
    for name, spine in ax.spines.items():
        spine.set(color=GREY, linewidth=THIN, visible=name in ("left", "bottom"))
    ax.set_prop_cycle(color=SERIES)
    ax.grid(visible=True, which="major", color=LIGHT.rule, linewidth=THIN, linestyle="-")
    ax.set_axisbelow(True)


def to_pyplot(drawn: Any) -> Any:  # noqa: ANN401  Axes, or an array of them
    """The same axes, their figure known to pyplot as its current one.

    Only in the main thread, outside of which pyplot is not safe, and where its backend works: without a screen the
    figure can still be saved by its own method.
    """
    first = drawn.ravel()[0] if isinstance(drawn, np.ndarray) else drawn
    if isinstance(first, Axes) and threading.current_thread() is threading.main_thread():
        from matplotlib import pyplot

        figure: Any = first.figure.figure
        if not _is_open(figure):
            existing: Any = lambda *_, **__: figure  # noqa: E731  in place of a class that makes a new one
            with suppress(ImportError):
                pyplot.figure(FigureClass=existing)
    return drawn


def checked_axes(ax: Any) -> Axes | None:  # noqa: ANN401
    """Axes to draw on, or None.

    Raises
    ------
    UsageError
        It is something else.
    """
    if ax is None or isinstance(ax, Axes):
        return ax
    raise UsageError(f"ax={ax!r:.60}: it is no Axes of matplotlib; give one of plt.subplots(), or omit ax.")


def _is_open(figure: Any) -> bool:  # noqa: ANN401
    """Whether pyplot manages a figure, which becomes its current one."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    number = getattr(figure, "number", None)
    return pyplot is not None and number in pyplot.get_fignums() and pyplot.figure(number) is figure


def _shown(axes: Axes) -> tuple[bytes, dict[str, int]] | None:
    """PNG of the figure of axes, unless pyplot's backend shows it.

    The inline backend of notebooks shows open figures at the end of a cell. One that is shown here is therefore
    closed, after those that were drawn before it are shown.
    """
    figure: Any = axes.figure.figure
    if not _is_open(figure):
        return png(figure)
    from matplotlib import get_backend, pyplot

    backend = get_backend().lower()
    if "inline" not in backend:
        return png(figure) if backend == "agg" else None
    pyplot.close(figure)
    pyplot.show()
    return png(figure)


class NotebookFigure(Figure):
    """A figure that a notebook shows, its axes in the style of the package."""

    def add_subplot(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        """Axes in the style of the package."""
        dress(ax := super().add_subplot(*args, **_own_class(kwargs)))
        return ax

    def add_axes(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        """Axes in the style of the package at a place of the figure."""
        dress(ax := super().add_axes(*args, **_own_class(kwargs)))
        return ax

    def suptitle(self, t: str, **kwargs: Any) -> Any:  # noqa: ANN401
        """A title over all axes, by default of the size of their own titles."""
        return super().suptitle(t, **{"fontsize": TITLE, "color": LIGHT.ink, **kwargs})

    def legend(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        """A legend, by default small and without a frame."""
        return super().legend(*args, **{**LEGEND, **kwargs})

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        return png(self)


class NotebookAxes(Axes):
    """Axes that a notebook shows, with all of their figure; titles and legends have the style of the package."""

    def set_title(self, label: str, fontdict: dict[str, Any] | None = None, **kwargs: Any) -> Any:  # type: ignore[override]  # noqa: ANN401
        """A title, by default at the left."""
        left = {} if "loc" in kwargs else {"x": 0, "ha": "left"}
        return super().set_title(label, fontdict, **{"fontsize": TITLE, "color": LIGHT.ink, **left, **kwargs})

    def twinx(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        """Axes on the same x, without a second grid."""
        other = super().twinx(*args, **kwargs)
        other.grid(visible=False)
        return other

    def legend(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        """A legend, by default small and without a frame."""
        return super().legend(*args, **{**LEGEND, **kwargs})

    def _repr_png_(self) -> tuple[bytes, dict[str, int]] | None:
        return _shown(self)


class NotebookAxesArray(np.ndarray[Any, Any]):
    """Axes of one figure in an array, which a notebook shows as that figure."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]] | None:
        first = self.ravel()[0] if self.size else None
        return _shown(first) if isinstance(first, Axes) else None


def _own_class(kwargs: dict[str, Any]) -> dict[str, Any]:
    """Options of new axes with `NotebookAxes` as their class, where no other projection is asked for."""
    given = {name: value for name, value in kwargs.items() if value is not None}
    return given if {"projection", "polar", "axes_class"} & set(given) else {**given, "axes_class": NotebookAxes}


def new_panels(n: int, across: int, side: tuple[float, float], *, share_y: bool = False) -> list[Axes]:
    """Axes of one figure, ``across`` in a row, each of ``side`` inches."""
    across = min(n, across)
    down = -(-n // across)
    figure = NotebookFigure(figsize=(max(across * side[0], 4.8), down * side[1] + 0.5), layout="constrained")
    grid = figure.add_gridspec(down, across)
    panels: list[Axes] = []
    for i in range(n):
        first = panels[0] if panels and share_y else None
        panels.append(figure.add_subplot(grid[divmod(i, across)], sharey=first))
        if share_y and i % across:
            panels[i].tick_params(labelleft=False)
    return panels


def axes_array(panels: Sequence[Axes]) -> Texts:
    """Axes of one figure, shown together."""
    held = np.empty(len(panels), dtype=object)
    held[:] = panels
    return held.view(NotebookAxesArray)


def mark_simulated(figure: Any, words: str = "not measured") -> None:  # noqa: ANN401  Figure
    """Mark a figure of simulated data at its top, or at its foot below a title; a computed layout keeps its place."""
    style: dict[str, Any] = {"ha": "right", "fontsize": SMALL, "color": RED, "weight": "bold"}
    if figure.get_layout_engine() is None:
        figure.text(0.995, 0.998, f"SIMULATED DATA, {words}", va="top", **style)
    elif figure.get_suptitle():
        figure.supxlabel(f"SIMULATED DATA, {words}", x=0.995, **style)
    else:
        figure.suptitle(f"SIMULATED DATA, {words}", x=0.995, va="top", **style)


def whiskers(
    rows: Mapping[str, tuple[float, float, float]], ax: Axes | None = None, *, label: str = "", title: str = ""
) -> Axes:
    """Estimates as dots on their intervals, from the top down: names of (value, low, high), ends NaN where unknown."""
    shown = dict(list(rows.items())[:MOST])
    ax = new_axes(ax, 4.8, 1.1 + 0.34 * max(len(shown), 3))
    for at, (value, low, high) in enumerate(shown.values()):
        if np.isfinite([low, high]).all():
            ax.plot([low, high], [at, at], color=BLUE, lw=LINE, solid_capstyle="butt")
        ax.plot([value], [at], "o", ms=DOT + 1, color=BLUE)
    ax.set_yticks(range(len(shown)), list(shown))
    ax.set_ylim(len(shown) - 0.5, -0.5)
    if any(value * low <= 0 or value * high <= 0 for value, low, high in shown.values()):
        ax.axvline(0, color=GREY, lw=THIN, zorder=0)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.set_xlabel(label)
    ax.set_title(title)
    ax.grid(visible=False, axis="y")
    return ax
