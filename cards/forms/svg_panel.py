"""One small panel as SVG for a page: shapes of `PanelAxes`, words as text of the page.

Colours become classes, so that a figure follows the font of the page and its light or dark scheme, and a name can never
be read as markup.
"""

from collections.abc import Callable, Sequence
from html import escape
from typing import NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.figure_style import tick_values
from ...core.panels import PanelAxes
from ...core.panels import PanelAxis as DataAxis
from ...core.pens import Dashes, Point, Words

# colours of shapes are the classes of the style sheet
INK, SOFT, LINE, BAND, TESTED, SECOND, LIMIT = "ink", "soft", "line", "band", "tested", "second", "limit"
WIDTH = 340.0  # px, about that of a phone: text keeps its size there
SIZE = 11.0  # px of text
TICK = 4.0  # px
NEAR = 0.13  # of an axis: tick labels closer than that would touch
MINUS = "\u2212"
ROUND = (1.0, 2.0, 5.0, 10.0)  # steps of ticks


class PanelAxis(NamedTuple):
    """Ends of an axis, its ticks with their labels, and its name."""

    low: float
    high: float
    ticks: Sequence[float] = ()
    labels: Sequence[str] = ()
    name: str = ""


class Margins(NamedTuple):
    """Height of a panel and its margins for words, px."""

    height: float = 210.0
    left: float = 44.0
    right: float = 10.0
    top: float = 24.0
    bottom: float = 40.0


MARGINS = Margins()


class PanelCanvas:
    """Canvas of a figure: ``ax`` for shapes in data, `text` for words in px.

    Attributes
    ----------
    ax : PanelAxes
        With limits, and empty: neither frame nor ticks.
    words : list of str
        ``text`` elements.
    """

    def __init__(self, ax: PanelAxes, x: PanelAxis, y: PanelAxis, margins: Margins) -> None:
        self.ax, self.x, self.y, self.margins = ax, x, y, margins
        self.words: list[str] = []
        self.keys = 0

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Data as px from the left and from the top."""
        r = self.margins
        across, down = WIDTH - r.left - r.right, r.height - r.top - r.bottom
        right = (x - self.x.low) / (self.x.high - self.x.low) * across
        up = (y - self.y.low) / (self.y.high - self.y.low) * down
        return r.left + right, r.height - r.bottom - up

    def text(self, x: float, y: float, words: str, anchor: str = "start", style: str = "f-ink") -> None:
        """Put words at px, y that of their base line; ``anchor`` is start, middle or end."""
        said = escape(" ".join(words.split()))
        self.words.append(f'<text class="{style}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{said}</text>')

    def key(self, words: str, style: str, *, dashed: bool = False) -> None:
        """Put a line of this style with its words over the panel, below those put before."""
        y = self.margins.top - 30 + (SIZE + 2) * self.keys
        dashes = ' stroke-dasharray="6 3"' if dashed else ""
        self.words.append(f'<path class="{style}" stroke-width="2"{dashes} d="M{self.margins.left:g} {y - 4:g}h22"/>')
        self.text(self.margins.left + 27, y, words)
        self.keys += 1

    def above(self, x: float, words: str) -> None:
        """Put words over the panel, about x."""
        self.text(self.at(x, 0.0)[0], self.margins.top - 3, words, "middle", "f-soft")


class PanelDrawing(NamedTuple):
    """A panel to be drawn: title, text alternative, axes, drawing function, margins."""

    title: str
    alternative: str
    x: PanelAxis
    y: PanelAxis
    draw: Callable[[PanelCanvas], None]
    margins: Margins = MARGINS


def svg(number: int, drawing: PanelDrawing) -> str:
    """Draw a panel and return it as an ``svg`` element with its text alternative.

    ``number`` sets its ids apart from those of other figures in the page.
    """
    title, alternative, x, y, draw, margins = drawing
    left, top = margins.left, margins.top
    across, down = WIDTH - left - margins.right, margins.height - top - margins.bottom
    ax = PanelAxes((left, top, across, down), DataAxis((x.low, x.high)), DataAxis((y.low, y.high)))
    panel = PanelCanvas(ax, x, y, margins)
    draw(panel)
    _frame(panel)
    ax.draw_shapes(pen := SvgPen())
    shapes = "".join(f"{shape}\n" for shape in pen.shapes)
    words = "".join(f"{word}\n" for word in panel.words)
    clip = (
        f'<clipPath id="f{number}-c"><rect x="{left:g}" y="{top:g}" width="{across:g}" height="{down:g}"/></clipPath>'
    )
    head = f'<svg class="panel" viewBox="0 0 {WIDTH:g} {margins.height:g}" role="img"'
    return (
        f'{head} aria-labelledby="f{number}-t f{number}-d" font-size="{SIZE:g}">\n<title id="f{number}-t">'
        f'{escape(title)}</title>\n<desc id="f{number}-d">{escape(alternative)}</desc>\n{clip}\n'
        f'<g clip-path="url(#f{number}-c)">\n{shapes}</g>\n{words}</svg>'
    )


class SvgPen:
    """A pen that collects ``shapes``: elements with classes for colours, everything in them a number."""

    def __init__(self) -> None:
        self.shapes: list[str] = []

    def line(self, points: Array, color: str, width: float, dashes: Dashes = ()) -> None:
        """A line through points (n, 2); ``dashes`` are multiples of its width."""
        pattern = f' stroke-dasharray="{" ".join(f"{width * dash:g}" for dash in dashes)}"' if dashes else ""
        self.shapes.append(
            f'<path d="{_path(points)}" class="s-{color}" fill="none" stroke-width="{width:g}"{pattern}/>'
        )

    def area(self, rings: Sequence[Array], color: str, opacity: float = 1.0) -> None:
        """The inside of closed rings."""
        inside = "".join(f"{_path(ring)}z" for ring in rings)
        clear = "" if opacity == 1 else f' fill-opacity="{opacity:g}"'
        self.shapes.append(f'<path d="{inside}" class="f-{color}" fill-rule="evenodd"{clear}/>')

    def markers(self, points: Array, marker: str, size: float, face: str, edge: str, width: float) -> None:
        """A dot at each of the points."""
        self.shapes += (f'<circle class="f-{face}" cx="{x:.1f}" cy="{y:.1f}" r="{size / 2:g}"/>' for x, y in points)

    def words(self, at: Point, words: Words) -> None:
        """A text at a place."""
        self.shapes.append(f'<text class="f-ink" x="{at[0]:.1f}" y="{at[1]:.1f}">{escape(words.text)}</text>')


def _path(points: Array) -> str:
    """Data of a path through points, without those that are not finite."""
    finite = np.isfinite(points)
    rounded = np.round(points if finite.all() else points[finite.all(axis=1)], 1)
    return "M" + "L".join(["%g %g"] * len(rounded)) % tuple(rounded.ravel().tolist()) if len(rounded) else ""


def even(low: float, high: float, name: str = "", steps: int = 4) -> PanelAxis:
    """An axis with a few round ticks."""
    ticks = [t for t in tick_values(low, high, steps, ROUND) if low <= t <= high]
    return PanelAxis(low, high, ticks, [f"{t:.4g}".replace("-", MINUS) for t in ticks], name)


def decades(low: float, high: float, name: str = "") -> PanelAxis:
    """An axis of decimal logarithms, its ticks at decades, or at 1, 2 and 5 where it has less than two of them."""
    steps = (0.0,) if high - low >= 2 else (0.0, 0.30103, 0.69897)
    every = max(1, round((high - low) / 4))
    ticks = [k + s for k in range(int(low) - 2, int(high) + 2, every) for s in steps if low <= k + s <= high]
    return PanelAxis(low, high, ticks, [f"{float(f'{10**t:.1g}'):g}" for t in ticks], name)


def at_levels(low: float, high: float, levels: Sequence[tuple[float, str]], name: str = "") -> PanelAxis:
    """An axis with ticks at levels of the tests, the ends first, without those whose labels would touch."""
    kept: list[tuple[float, str]] = []
    for value, label in (levels[0], levels[-1], *levels[1:-1]):
        if all(abs(value - other) > NEAR * (high - low) for other, _ in kept):
            kept.append((value, label))
    return PanelAxis(low, high, [value for value, _ in kept], [label for _, label in kept], name)


def _frame(panel: PanelCanvas) -> None:
    """Two lines with ticks, their labels, and the names of the axes."""
    x, y, r = panel.x, panel.y, panel.margins
    end, base = WIDTH - r.right, r.height - r.bottom
    lines = [f"M{r.left:g} {r.top:g}V{base:g}H{end:g}"] if y.ticks else [f"M{r.left:g} {base:g}H{end:g}"]
    for value, label in zip(x.ticks, x.labels, strict=True):
        at = panel.at(value, y.low)[0]
        lines.append(f"M{at:.1f} {base:g}v{TICK:g}")
        panel.text(at, base + TICK + SIZE, label, "middle")
    for value, label in zip(y.ticks, y.labels, strict=True):
        at = panel.at(x.low, value)[1]
        lines.append(f"M{r.left:g} {at:.1f}h{-TICK:g}")
        panel.text(r.left - TICK - 2, at + 0.35 * SIZE, label, "end")
    panel.words.insert(0, f'<path class="s-soft" fill="none" stroke-width="0.8" d="{"".join(lines)}"/>')
    if x.name:
        panel.text((r.left + end) / 2, r.height - 6, x.name, "middle")
    if y.name:
        panel.text(2, SIZE + 1, y.name)
