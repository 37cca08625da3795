"""Axes without matplotlib: shapes and words in the coordinates of data, drawn by a pen as SVG or as a PNG picture.

`PanelAxes` has the part of the interface of matplotlib's axes that the figures of laws use, so that the same functions
draw in notebooks, in the folder of a card and in a page. Importing matplotlib and drawing the figures of a folder with
it took a third of the whole main job.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from .arrays import Array
from .figure_style import (
    GREY,
    INK,
    LEGEND_GAP,
    LIGHT,
    LINE,
    NEAR_END,
    SMALL,
    TEXT,
    THIN,
    TITLE,
    number_labels,
    round_numbers,
    tick_values,
)
from .pens import LEADING, Dashes, Pen, Point, Words

Box = tuple[float, float, float, float]
DASHED: Dashes = (3.7, 1.6)  # times the width of the line
MARGIN = 0.05  # of the range of the data, to each side of it
TICK = 3.0  # pt
BEYOND = 1e250  # stands for infinity in the levels of filled contours


class ContourLines(NamedTuple):
    """Levels of contours, and the points of each, (n, 2), in the coordinates of the data."""

    levels: tuple[float, ...]
    points: tuple[Array, ...]


@dataclass(slots=True)
class PanelAxis:
    """One axis: its ends, None where they follow from the data seen, its ticks and its name."""

    ends: tuple[float, float] | None = None
    log: bool = False
    ticks: Sequence[float] | None = None
    labels: Sequence[str] | None = None
    name: str = ""
    turned: bool = False
    grid: bool = True
    seen: list[float] = field(default_factory=lambda: [np.inf, -np.inf])

    def see(self, values: Any) -> None:  # noqa: ANN401  number or array
        """Extend the range of the data, which counts where no ends were set."""
        if self.ends is not None:
            return
        values = np.asarray(values, dtype=np.float64)
        finite = values[np.isfinite(values) & ((values > 0) | (not self.log))]
        if finite.size:
            self.seen[:] = min(self.seen[0], finite.min()), max(self.seen[1], finite.max())

    def limits(self) -> tuple[float, float]:
        """Ends of the axis: those that were set, or the range of the data with a margin."""
        if self.ends is not None:
            return self.ends
        low, high = map(float, self.seen if self.seen[0] <= self.seen[1] else (0.0, 1.0))
        if low == high:
            reach = MARGIN * abs(low) or MARGIN
            return low - reach, high + reach
        if self.log and low > 0:
            reach = (high / low) ** MARGIN
            return low / reach, high * reach
        reach = MARGIN * (high - low)
        return low - reach, high + reach

    def share(self, values: Any) -> Any:  # noqa: ANN401
        """Places along the axis: 0 at its lower end, 1 at its upper one."""
        low, high = self.limits()
        if not self.log:
            return (np.asarray(values, dtype=np.float64) - low) / (high - low)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(np.asarray(values, dtype=np.float64) / low) / np.log(high / low)

    def set_ticks(self, ticks: Sequence[float], labels: Sequence[str] | None = None, *, minor: bool = False) -> None:
        """Set the ticks and their labels; there are no minor ones."""
        if not minor:
            self.ticks, self.labels = list(ticks), labels

    def marks(self) -> Iterator[tuple[float, str]]:
        """Share of the axis and label of each tick on it."""
        low, high = self.limits()
        ticks = self.ticks
        if ticks is None:
            ticks = round_numbers(low, high) if self.log else tick_values(low, high, 5)
        inside = [-share <= NEAR_END and share <= 1 + NEAR_END for share in map(float, self.share(ticks))]
        labels = number_labels([t for t, here in zip(ticks, inside, strict=True) if here])
        if self.labels is not None:
            labels = [words for words, here in zip(self.labels, inside, strict=True) if here]
        shown = (float(share) for share, here in zip(self.share(ticks), inside, strict=True) if here)
        yield from zip(shown, labels, strict=True)


class PanelAxes:
    """Axes in a box of pt; what is drawn on them is kept until `draw`, when their ends are known.

    Parameters
    ----------
    box : tuple of four floats
        Left, top, width and height of the frame, pt.
    x, y : PanelAxis, optional
        With ends, or those of the data.

    Examples
    --------
    >>> ax = PanelAxes((40.0, 20.0, 200.0, 100.0))
    >>> ax.plot([1.0, 2.0], [0.0, 1.0], color="#0072b2")
    >>> [round(end, 9) for end in ax.get_xlim()]
    [0.95, 2.05]
    """

    transAxes = "axes fraction"

    def __init__(self, box: Box, x: PanelAxis | None = None, y: PanelAxis | None = None) -> None:
        self.box, self._first = box, (x, y)
        self.clear()

    def clear(self) -> None:
        """Remove everything."""
        self.xaxis, self.yaxis = (axis or PanelAxis() for axis in self._first)
        self._shapes: list[tuple[float, Callable[[Pen], None]]] = []
        self._texts: list[tuple[Callable[[], Point], Words]] = []
        self._legend: list[tuple[str, Mapping[str, Any]]] = []
        self._keys = False
        self._title = ("", 0.0)
        self._framed = True

    def at(self, x: Any, y: Any) -> Array:  # noqa: ANN401
        """Data as pt from the left and from the top, shape (n, 2)."""
        left, top, width, height = self.box
        across, up = self.xaxis.share(x), self.yaxis.share(y)
        if np.shape(across) != np.shape(up):
            across, up = np.broadcast_arrays(across, up)
        points = np.empty((np.size(across), 2))
        points[:, 0], points[:, 1] = left + width * np.ravel(across), top + height * (1 - np.ravel(up))
        return points

    def _add(self, draw: Callable[[Pen], None], zorder: float) -> None:
        self._shapes.append((zorder, draw))

    def plot(self, x: Any, y: Any, marker: str = "", **style: Any) -> None:  # noqa: ANN401
        """A line, or markers where one is named: ``color, lw, ls, ms, mfc, mec, mew, label, zorder``."""
        self.xaxis.see(x)
        self.yaxis.see(y)
        marker = style.get("marker", marker)
        if style.get("label"):
            self._legend.append((style["label"], {**style, "marker": marker}))
        self._add(lambda pen: _stroke(pen, self.at(x, y), {**style, "marker": marker}), style.get("zorder", 2))

    def hlines(self, y: Sequence[float], low: Sequence[float], high: Sequence[float], *, color: str, lw: float) -> None:
        """Horizontal lines from ``low`` to ``high``."""
        for each, start, end in zip(y, low, high, strict=True):
            self.plot([start, end], [each, each], color=color, lw=lw)

    def axhline(self, y: float, **style: Any) -> None:  # noqa: ANN401
        """A line across the panel."""
        self.yaxis.see(y)
        self._add(lambda pen: _stroke(pen, self.at(self.get_xlim(), y), style), style.get("zorder", 2))

    def axvline(self, x: float, **style: Any) -> None:  # noqa: ANN401
        """A line from the foot of the panel to its top."""
        self.xaxis.see(x)
        self._add(lambda pen: _stroke(pen, self.at(x, self.get_ylim()), style), style.get("zorder", 2))

    def axhspan(self, low: float, high: float, *, color: str, lw: float = 0) -> None:
        """A band across the panel."""
        ends = np.array([low, low, high, high])
        self._add(lambda pen: pen.area([self.at([*self.get_xlim(), *self.get_xlim()[::-1]], ends)], color), 1)

    def axvspan(self, low: float, high: float, *, color: str, lw: float = 0) -> None:
        """A band from the foot of the panel to its top."""
        ends = np.array([low, low, high, high])
        self._add(lambda pen: pen.area([self.at(ends, [*self.get_ylim(), *self.get_ylim()[::-1]])], color), 1)

    def fill_between(self, x: Array, low: Array, high: Array, *, color: str, lw: float = 0, **style: Any) -> None:  # noqa: ANN401
        """The area between two curves; ``alpha`` and ``label``."""
        self.xaxis.see(x)
        self.yaxis.see([low, high])
        if style.get("label"):
            self._legend.append((style["label"], {"fill": color, **style}))
        ring = np.r_[x, x[::-1]], np.r_[low, high[::-1]]
        self._add(lambda pen: pen.area([self.at(*ring)], color, style.get("alpha", 1.0)), 1)

    def contour(
        self, x: Array, y: Array, z: Array, levels: Iterable[float], *, colors: str, linewidths: float,
        linestyles: str = "-",
    ) -> ContourLines:  # fmt: skip
        """Draw contours of z at levels and return their points."""
        from contourpy import LineType, contour_generator

        made = contour_generator(x, y, z, name="serial", corner_mask=True, line_type=LineType.Separate)
        style = {"color": colors, "lw": linewidths, "ls": linestyles}
        drawn = [[np.asarray(line) for line in made.lines(float(level))] for level in levels]
        for line in (line for lines in drawn for line in lines):
            self._add(lambda pen, line=line: _stroke(pen, self.at(*line.T), style), 2)  # type: ignore[misc]
        whole = (np.concatenate(lines) if lines else np.empty((0, 2)) for lines in drawn)
        return ContourLines(tuple(map(float, levels)), tuple(whole))

    def contourf(
        self, x: Array, y: Array, z: Array, levels: Iterable[float], *, colors: Sequence[str], extend: str = "neither"
    ) -> None:
        """Fill between levels; ``extend="both"`` also below the first and above the last."""
        from contourpy import FillType, contour_generator

        made = contour_generator(x, y, z, name="serial", corner_mask=True, fill_type=FillType.OuterOffset)
        ends = [-BEYOND, *levels, BEYOND] if extend == "both" else list(levels)
        for color, low, high in zip(colors, ends[:-1], ends[1:], strict=True):
            for points, offsets in zip(*made.filled(float(low), float(high)), strict=True):
                rings = [points[a:b] for a, b in pairwise(offsets)]
                self._add(lambda pen, rings=rings, color=color: pen.area([self.at(*r.T) for r in rings], color), 1)  # type: ignore[misc]

    def clabel(self, lines: ContourLines, *, fontsize: float, fmt: Callable[[float], str]) -> list[Words]:
        """Put words on each contour, beside its middle, where settings are."""
        drawn = [(level, points[len(points) // 3]) for level, points in zip(*lines, strict=True) if len(points)]
        return [self.text(x, y, fmt(level), ha="center", va="center", fontsize=fontsize) for level, (x, y) in drawn]

    def text(self, x: float, y: float, words: str, *, transform: str = "data", **style: Any) -> Words:  # noqa: ANN401
        """Words at data, or at shares of the panel with ``transform=ax.transAxes``."""
        return self.annotate(words, (x, y), xycoords=transform, **style)

    def annotate(
        self, words: str, xy: Point, xytext: Point = (0.0, 0.0), xycoords: Any = "data",  # noqa: ANN401
        textcoords: str = "offset points", *, fontsize: float = TEXT, **style: Any,  # noqa: ANN401
    ) -> Words:  # fmt: skip
        """Words beside a point, ``xytext`` pt to the right and up of it."""
        kinds = (xycoords, xycoords) if isinstance(xycoords, str) else xycoords
        left, top, width, height = self.box

        def place() -> Point:
            across = xy[0] if kinds[0] == "axes fraction" else float(self.xaxis.share(xy[0]))
            up = xy[1] if kinds[1] == "axes fraction" else float(self.yaxis.share(xy[1]))
            return left + width * across + xytext[0], top + height * (1 - up) - xytext[1]

        held = {name: value for name, value in style.items() if name in ("color", "ha", "va", "angle")}
        self._texts.append((place, made := Words(words, fontsize, **held)))
        return made

    def set(self, **properties: Any) -> None:  # noqa: ANN401
        """Set properties by name: ``xlabel``, ``xscale``, ``xlim``, ``xticks``, ``title`` and those of y."""
        for name, value in properties.items():
            getattr(self, f"set_{name}")(value)

    def set_title(self, title: str, *, pad: float = 4.0) -> None:
        """A title at the left over the panel, ``pad`` pt above it."""
        self._title = (title, pad)

    def set_xlabel(self, name: str) -> None:
        """Name the axis."""
        self.xaxis.name = name

    def set_ylabel(self, name: str) -> None:
        """Name the axis."""
        self.yaxis.name = name

    def set_xscale(self, scale: str) -> None:
        """Take logarithms with ``log``."""
        self.xaxis.log = scale == "log"

    def set_yscale(self, scale: str) -> None:
        """Take logarithms with ``log``."""
        self.yaxis.log = scale == "log"

    def set_xlim(self, low: float | Point, high: float | None = None) -> None:
        """Set the ends of the axis."""
        self.xaxis.ends = low if isinstance(low, tuple) else (low, low if high is None else high)

    def set_ylim(self, low: float | Point, high: float | None = None) -> None:
        """Set the ends of the axis."""
        self.yaxis.ends = low if isinstance(low, tuple) else (low, low if high is None else high)

    def set_xticks(self, ticks: Iterable[float], labels: Sequence[str] | None = None, *, rotation: float = 0) -> None:
        """Set the ticks; labels are turned where ``rotation`` is not 0."""
        self.xaxis.set_ticks(list(ticks), labels)
        self.xaxis.turned = bool(rotation)

    def set_yticks(self, ticks: Iterable[float], labels: Sequence[str] | None = None) -> None:
        """Set the ticks."""
        self.yaxis.set_ticks(list(ticks), labels)

    def set_axis_off(self) -> None:
        """Draw neither frame nor ticks."""
        self._framed = False

    def get_xlim(self) -> tuple[float, float]:
        """Ends of the axis."""
        return self.xaxis.limits()

    def get_ylim(self) -> tuple[float, float]:
        """Ends of the axis."""
        return self.yaxis.limits()

    def grid(self, *, visible: bool, axis: str = "both") -> None:
        """Show or hide the grid of both axes or of one."""
        for name, each in (("x", self.xaxis), ("y", self.yaxis)):
            if axis in (name, "both"):
                each.grid = visible

    def legend(self) -> None:
        """Show what has a label."""
        self._keys = True

    def draw(self, pen: Pen) -> None:
        """Draw everything, the frame below the shapes, words above them."""
        if self._framed:
            self._frame(pen)
        self.draw_shapes(pen)
        if self._keys:
            left, top, _, _ = self.box
            draw_keys(pen, self._legend, (left + 6, top + 8))
        for place, words in self._texts:
            pen.words(place(), words)
        title, pad = self._title
        pen.words((self.box[0], self.box[1] - pad), Words(title, TITLE))

    def draw_shapes(self, pen: Pen) -> None:
        """Draw lines, areas and markers, those of higher order above others."""
        for _, draw in sorted(self._shapes, key=lambda item: item[0]):
            draw(pen)

    def _frame(self, pen: Pen) -> None:
        """Grid, the two lines of the axes, ticks with their labels, and the names of the axes."""
        left, top, width, height = self.box
        base, label = top + height, TICK + 2
        for share, words in self.xaxis.marks():
            x = left + width * share
            if self.xaxis.grid:
                pen.line(np.array([[x, top], [x, base]]), LIGHT.rule, THIN)
            pen.line(np.array([[x, base], [x, base + TICK]]), GREY, THIN)
            angle = 90.0 if self.xaxis.turned else 0.0
            pen.words((x, base + label), Words(words, SMALL, ha="center", va="top", angle=angle))
        for share, words in self.yaxis.marks():
            y = base - height * share
            if self.yaxis.grid:
                pen.line(np.array([[left, y], [left + width, y]]), LIGHT.rule, THIN)
            pen.line(np.array([[left, y], [left - TICK, y]]), GREY, THIN)
            pen.words((left - label, y), Words(words, SMALL, ha="right", va="center"))
        pen.line(np.array([[left, top], [left, base], [left + width, base]]), GREY, THIN)
        below = label + SMALL * (2.4 if self.xaxis.turned else LEADING) + 3
        pen.words((left + width / 2, base + below), Words(self.xaxis.name, ha="center", va="top"))
        pen.words((left - 38, top + height / 2), Words(self.yaxis.name, ha="center", va="bottom", angle=90.0))


def _stroke(pen: Pen, points: Array, style: Mapping[str, Any]) -> None:
    """A line, or markers without one, in a style by matplotlib's names."""
    color = style.get("color", INK)
    if style.get("marker"):
        face, edge = (style.get(name, color) for name in ("mfc", "mec"))
        pen.markers(points, style["marker"], style.get("ms", 4.0), face, edge, style.get("mew", THIN))
        return
    kind = style.get("ls", "-")
    dashes = DASHED if kind == "--" else () if isinstance(kind, str) else kind[1]
    pen.line(points, color, style.get("lw", LINE), dashes)


def draw_keys(
    pen: Pen, keys: Sequence[tuple[str, Mapping[str, Any]]], at: Point, across: int = 1, step: float = 0.0
) -> None:
    """A legend: the marker, line or area of each key with its words, ``across`` in a row of ``step`` pt each."""
    for k, (words, style) in enumerate(keys):
        row, column = divmod(k, across)
        x, y = at[0] + step * column, at[1] + LEGEND_GAP * row
        if "fill" in style:
            box = np.array([[x, y - 3], [x + 12, y - 3], [x + 12, y + 3], [x, y + 3]])
            pen.area([box], style["fill"], style.get("alpha", 1.0))
        else:
            marked = bool(style.get("marker"))
            _stroke(pen, np.array([[x + 6, y]]) if marked else np.array([[x, y], [x + 12, y]]), style)
        pen.words((x + (14 if not style.get("marker") else 12), y), Words(words, SMALL, va="center"))
