"""One small matplotlib panel, drawn again and again, and its SVG prepared for a page.

Matplotlib draws the shapes; words are placed as text of the page. Colours become classes, so that a figure
follows the font of the page and its light or dark scheme, and a name can never be read as markup.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from html import escape
from io import StringIO
from threading import get_ident
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# colours that represent classes of the style sheet, written the way matplotlib writes them
INK, SOFT, LINE, BAND, TESTED, SECOND, LIMIT = (f"#{k:02d}{k:02d}{k:02d}" for k in range(1, 8))
CLASSES = {INK: "ink", SOFT: "soft", LINE: "line", BAND: "band", TESTED: "tested", SECOND: "second", LIMIT: "limit"}
WIDTH = 340.0  # px, about that of a phone: text keeps its size there
SIZE = 11.0  # px of text
TICK = 4.0  # px
NEAR = 0.13  # of an axis: tick labels closer than that would touch
MINUS = "\u2212"
SETTINGS: Any = {"svg.fonttype": "none", "svg.hashsalt": "fitmodels", "path.simplify": False}
NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))

GROUP = re.compile(r'<g id="[^"]*">')
STYLE = re.compile(r' style="([^"]*)"')
LONG = re.compile(r"(\d\.\d)\d+")
REFERENCE = re.compile(r'( id="|url\(#|xlink:href="#)')
BLANK = re.compile(r"(?<!\s)[^\S\n]*\n\s*")


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
    ax : Axes
        With limits, and empty: neither frame nor ticks.
    words : list of str
        ``text`` elements.
    """

    def __init__(self, ax: "Axes", x: PanelAxis, y: PanelAxis, margins: Margins) -> None:
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


@contextmanager
def settings() -> Iterator[None]:
    """Matplotlib as `svg` needs it: text as text, ids by content alone."""
    from matplotlib import rc_context

    with rc_context(SETTINGS):
        yield


def svg(number: int, drawing: PanelDrawing) -> str:
    """Draw a panel and return it as an ``svg`` element with its text alternative.

    ``number`` sets its ids apart from those of other figures in the page. Called within `settings`.
    """
    title, alternative, x, y, draw, margins = drawing
    figure, ax = _paper(get_ident())
    for artist in (*ax.lines, *ax.collections, *ax.patches):
        artist.remove()
    figure.set_size_inches(WIDTH / 72, margins.height / 72)
    across, down = WIDTH - margins.left - margins.right, margins.height - margins.top - margins.bottom
    place = (margins.left / WIDTH, margins.bottom / margins.height, across / WIDTH, down / margins.height)
    ax.set_position(place)
    ax.set_xlim(x.low, x.high)
    ax.set_ylim(y.low, y.high)
    panel = PanelCanvas(ax, x, y, margins)
    draw(panel)
    _frame(panel)
    buffer: Any = StringIO()
    figure.canvas.print_svg(buffer, metadata=NO_METADATA)  # type: ignore[attr-defined]  # of the SVG canvas
    body = cleaned(buffer.getvalue(), f"f{number}-") + "".join(f"{word}\n" for word in panel.words)
    head = f'<svg class="panel" viewBox="0 0 {WIDTH:g} {margins.height:g}" role="img"'
    return (
        f'{head} aria-labelledby="f{number}-t f{number}-d" font-size="{SIZE:g}">\n<title id="f{number}-t">'
        f'{escape(title)}</title>\n<desc id="f{number}-d">{escape(alternative)}</desc>\n{body}</svg>'
    )


def cleaned(drawn: str, prefix: str) -> str:
    """Shapes of matplotlib's file: no style attributes, no idle groups and ids, no needless digits."""
    body = drawn[drawn.index("</defs>") + len("</defs>") : drawn.rindex("</svg>")]
    body = STYLE.sub(_attributes, GROUP.sub("<g>", body))
    body = LONG.sub(r"\1", body)
    body = REFERENCE.sub(lambda m: m[1].replace("xlink:", "") + prefix, body)
    return BLANK.sub("\n", body).lstrip()


def even(low: float, high: float, name: str = "", steps: int = 4) -> PanelAxis:
    """An axis with a few round ticks."""
    from matplotlib.ticker import MaxNLocator

    round_ones = MaxNLocator(steps, steps=[1, 2, 5, 10]).tick_values(low, high)
    ticks = [float(t) for t in round_ones if low <= t <= high]
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


@lru_cache(maxsize=4)
def _paper(thread: int) -> tuple["Figure", "Axes"]:
    """Figure and axes of a thread: matplotlib draws one thing at a time on them."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(dpi=72)
    FigureCanvasSVG(figure)
    ax = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    figure.patch.set_visible(False)
    ax.set_axis_off()
    ax.set_autoscale_on(False)
    return figure, ax


def _attributes(style: "re.Match[str]") -> str:
    """A style attribute as classes and attributes: the page's policy allows no inline style."""
    classes, rest = [], []
    for part in style[1].split(";"):
        name, _, value = (word.strip() for word in part.partition(":"))
        if value in CLASSES:
            classes.append(f"{name[0]}-{CLASSES[value]}")
        elif name:
            rest.append(f'{name}="{value}"')
    named = [f'class="{" ".join(classes)}"'] if classes else []
    return "".join(f" {item}" for item in (*named, *rest))
