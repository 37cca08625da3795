"""Style of all figures: colours on light and on dark paper, sizes, ticks, levels and limits, for any kind of axes.

The hues are those of Okabe & Ito 2008 (Color Universal Design), which readers with any colour vision distinguish; two
are darkened to a contrast of 3 on white. No figure depends on colour alone: limits are dashed and labelled, edges have
markers. Pictures are on light paper; the SVG figures of a page take the colours of its scheme from `css_colours`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from re import findall, split
from typing import Any, Final, NamedTuple

import numpy as np

from .arrays import Array


@dataclass(frozen=True, slots=True)
class Palette:
    """Colours of a figure, as ``#rrggbb``.

    Attributes
    ----------
    paper, ink, soft, rule : str
        Background; text; frames, ticks and secondary lines; grid.
    line, second, third : str
        Of curves and points: the law or model; what it is compared with; a further one.
    limit : str
        Limits and criteria, what lies outside them, and the mark of simulated data.
    """

    paper: str
    ink: str
    soft: str
    rule: str
    line: str
    second: str
    third: str
    limit: str


LIGHT: Final = Palette("#ffffff", "#1b2327", "#6b767d", "#e6eaeb", "#0072b2", "#d55e00", "#00805d", "#9c2317")
DARK: Final = Palette("#14191c", "#e3e8ea", "#a3b0b7", "#343e44", "#56b4e9", "#f0a33e", "#35c99a", "#ff9d8c")
BLUE, ORANGE, GREEN, RED, GREY, INK = LIGHT.line, LIGHT.second, LIGHT.third, LIGHT.limit, LIGHT.soft, LIGHT.ink
PURPLE, AMBER = "#a8508a", "#a07800"
SERIES: Final = (BLUE, ORANGE, GREEN, PURPLE, AMBER, "#3a8fc4", "#333b40", RED)  # curves, edges and limits in order
MARKERS: Final = "osD^vP"  # as many edges as colours times markers are distinguished
SEQUENTIAL, DIVERGING = "Blues", "RdYlBu"  # colour maps, both safe for colour-blind readers
SMALL, TEXT, TITLE = 8.0, 9.0, 10.0  # pt: ticks, legends and notes; names of axes; titles
THIN, LINE, THICK = 0.8, 1.6, 2.4  # pt: frames, grids and bounds; curves; what a figure is about
DOT = 4.0  # pt, of a point
FILL = 0.16  # opacity of a band
DPI = 110  # of the pictures that are written
NEAR_END = 1e-9  # of the largest tick: a difference that is rounding
DIGITS = 6  # after the point in labels of ticks; smaller steps are written with a power of ten
LEGEND_GAP = 13.0  # pt, from line to line of a legend
CONSTANT = 1e-9  # relative spread of a surface below which there are no contours
# Steps within a decade, coarse to fine
STEPS = (
    (1.0,),
    (1.0, 3.0),
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
)
TICK_STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # within a decade
BLUES: Final = [
    "f7fbff",
    "deebf7",
    "c6dbef",
    "9ecae1",
    "6baed6",
    "4292c6",
    "2171b5",
    "08519c",
    "08306b",
]  # ColorBrewer 2.0, light to dark
Styles = Mapping[str, Mapping[str, Any]]


def css_colours(palette: Palette) -> dict[str, str]:
    """Colours by the names of the variables in the style sheet of a page.

    Examples
    --------
    >>> css_colours(DARK)["line"]
    '#56b4e9'
    """
    names = ("ink", "line", "second", "third", "limit")
    return {**{name: getattr(palette, name) for name in names}, "band": f"{palette.line}33"}


class Limit(NamedTuple):
    """A limit of a response, with its words: ``wear criterion 0.3 mm``."""

    value: float
    words: str


def new_axes(ax: Any, width: float = 4.8, height: float = 4.2) -> Any:  # noqa: ANN401  Axes or PanelAxes
    """The axes that were given, or axes of matplotlib on a figure of their own of so many inches."""
    if ax is not None:
        return ax
    from .plotting import NotebookFigure

    return NotebookFigure(figsize=(width, height), layout="constrained").add_subplot()


def natural_key(name: str) -> list[str | int]:
    """Sort key by the numbers in a name.

    Examples
    --------
    >>> sorted(["E10", "E2"], key=natural_key)
    ['E2', 'E10']
    """
    return [int(part) if part.isdecimal() else part for part in split(r"(\d+)", name)]


def edge_styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Colour and marker of each cutting edge in the order of their numbers; beyond 48 edges they repeat.

    Examples
    --------
    >>> styles = edge_styles(f"E{k}" for k in range(1, 25))
    >>> len({(style["color"], style["marker"]) for style in styles.values()})
    24
    """
    ordered = sorted(dict.fromkeys(names), key=natural_key)
    n = len(SERIES)
    return {
        name: {"color": SERIES[k % n], "marker": MARKERS[k // n % len(MARKERS)], "mec": SERIES[k % n], "mew": THIN,
               "mfc": "none" if k // n % 2 else SERIES[k % n], "ls": "none", "ms": DOT}
        for k, name in enumerate(ordered)
    }  # fmt: skip


def titled(ax: Any, title: str, notes: Iterable[str] = ()) -> None:  # noqa: ANN401
    """A title, and below it a line for each note, small and grey."""
    held = [note for note in notes if note]
    ax.set_title(title, pad=4 + 1.35 * SMALL * len(held))
    if held:
        ax.annotate("\n".join(held), (0, 1), (0, 3), "axes fraction", "offset points", fontsize=SMALL, color=GREY,
                    va="bottom", linespacing=1.15)  # fmt: skip


def edge_legend(owner: Any, styles: Styles, across: int = 1, **place: Any) -> None:  # noqa: ANN401
    """Legend of edges with so many names in a row."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=name, **style) for name, style in styles.items()]
    gaps = {"columnspacing": 1.0, "handletextpad": 0.1, "labelspacing": 0.3}
    owner.legend(handles=handles, title="edge", title_fontsize=SMALL, ncols=across, **gaps, **place)


def draw_limit(ax: Any, limit: Limit | None, which: str = "y") -> None:  # noqa: ANN401
    """A limit as a dashed line with its words, where it lies on the axis."""
    low, high = sorted(ax.get_ylim() if which == "y" else ax.get_xlim())
    if limit is None or not low <= limit.value <= high:
        return
    (ax.axhline if which == "y" else ax.axvline)(limit.value, color=RED, lw=LINE, ls=(0, (5, 2)), zorder=1.5)
    place: Any = (0.01, limit.value), (0, 3), ("axes fraction", "data"), "offset points"
    rim(ax.annotate(limit.words, *place, fontsize=SMALL, color=RED, va="bottom"))


def _are_successive(names: Sequence[str]) -> bool:
    """Whether the names have the same first letters and successive numbers after them."""
    parts = [findall(r"^(\D*)(\d+)", name) for name in names]
    if not all(parts):
        return False
    numbers = [int(number) for ((_, number),) in parts]
    return len({letters for ((letters, _),) in parts}) == 1 and all(b - a == 1 for a, b in pairwise(numbers))


def short_names(names: Iterable[str], most: int = 3) -> str:
    """Names in a few letters: successive numbers as a range, many names as their number.

    Examples
    --------
    >>> short_names(["E15", "E16", "E17"]), short_names(["E1", "E5"]), short_names(f"E{2 * k}" for k in range(9))
    ('E15–E17', 'E1, E5', '9 edges')
    """
    ordered = sorted(dict.fromkeys(names), key=natural_key)
    if len(ordered) > 2 and _are_successive(ordered):
        return f"{ordered[0]}–{ordered[-1]}"
    return ", ".join(ordered) if len(ordered) <= most else f"{len(ordered)} edges"


def plain_ticks(ax: Any, which: str, x: list[float], y: list[float]) -> None:  # noqa: ANN401
    """Ticks of a logarithmic axis at round numbers, without exponents."""
    for name, axis, ends in (("x", ax.xaxis, x), ("y", ax.yaxis, y)):
        if name in which:
            ticks = round_numbers(ends[0], ends[1])
            axis.set_ticks(ticks, [f"{v:g}" for v in ticks])
            axis.set_ticks([], minor=True)


def round_numbers(low: float, high: float, fewest: int = 3, most: int = 9) -> list[float]:
    """Round numbers between two ends of a logarithmic axis, at least ``fewest`` where possible."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks: list[float] = []
    for steps in STEPS:
        ticks = [float(f"{d * s:.6g}") for d in decades for s in steps if low * 0.999 <= d * s <= high * 1.001]
        if fewest <= len(ticks) <= most:
            return ticks
    return ticks if 2 <= len(ticks) <= most else [float(f"{v:.2g}") for v in np.geomspace(low, high, 4)]


def contour_levels(z: Array) -> Array:
    """About seven contour levels at round numbers; none of a surface that is constant or not finite."""
    low, high = float(z.min()), float(z.max())
    if not (np.isfinite(z).all() and high - low > CONSTANT * max(abs(low), abs(high))):
        return np.empty(0)
    if low > 0 and high / low > 8:
        inside = [v for v in round_numbers(low, high, fewest=5) if low < v < high]
        return np.array(inside) if len(inside) > 2 else np.geomspace(low, high, 8)[1:-1]
    return np.array([v for v in tick_values(low, high, 8) if low < v < high])


def shades(n: int) -> list[str]:
    """Light to medium blues, on which dark words are read.

    Examples
    --------
    >>> shades(2)
    ['#ebf3fb', '#5ba3d0']
    """
    sources = np.array([[int(color[i : i + 2], 16) for i in (0, 2, 4)] for color in BLUES])
    at = np.linspace(0.06, 0.55, n) * (len(BLUES) - 1)
    mixed = (np.interp(at, np.arange(len(BLUES)), channel) for channel in sources.T)
    return [f"#{round(r):02x}{round(g):02x}{round(b):02x}" for r, g, b in zip(*mixed, strict=True)]


def tick_values(low: float, high: float, intervals: int, steps: Sequence[float] = TICK_STEPS) -> list[float]:
    """Round numbers from at most ``low`` to at least ``high``, about ``intervals`` apart, as matplotlib places them.

    ``steps`` are the distances of one decade, from 1 to 10.

    Examples
    --------
    >>> tick_values(0.0, 1.0, 5)
    [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]
    """
    if high - low <= max(abs(low), abs(high)) * 1e-14:
        low, high = (low - 1e-13 * abs(low), high + 1e-13 * abs(high)) if low or high else (-1e-13, 1e-13)
    span, centre = high - low, (low + high) / 2
    offset = 0.0 if abs(centre) < 100 * span else float(np.copysign(10.0 ** np.floor(np.log10(abs(centre))), centre))
    scale = 10.0 ** np.floor(np.log10(span / intervals))
    sizes = scale * np.array([*(0.1 * step for step in steps[:-1]), *steps, 10 * steps[1]])
    first, last = low - offset, high - offset
    widest = int(np.flatnonzero(sizes >= span / intervals)[0])
    values = np.empty(0)
    for size in sizes[widest::-1]:
        start = first // size * size
        values = np.arange(_whole(first - start, size, offset, -1), _whole(last - start, size, offset, 1) + 1)
        values = values * size + start
        if ((first <= values) & (values <= last)).sum() >= 2:
            break
    return [float(value) for value in values + offset]


def _whole(distance: float, size: float, offset: float, side: int) -> float:
    """Steps that reach a distance, downwards or upwards; one that is whole but for rounding counts as whole."""
    whole, rest = divmod(distance, size)
    near = 1e-10 if not offset else min(0.4999, max(1e-10, 10.0 ** (np.log10(abs(offset) / size) - 12)))
    if side < 0:
        return whole + 1 if abs(rest / size - 1) < near else whole
    return whole if abs(rest / size) < near else whole + 1


def number_labels(ticks: Sequence[float]) -> list[str]:
    """Labels of ticks, all with the decimals that they need.

    Examples
    --------
    >>> number_labels([-0.5, 0.0, 0.25])
    ['−0.50', '0.00', '0.25']
    """
    if not any(ticks):
        return [f"{t:g}" for t in ticks]
    largest = max(map(abs, ticks))
    decimals = next((d for d in range(DIGITS) if all(abs(round(t, d) - t) <= NEAR_END * largest for t in ticks)), -1)
    labels = [f"{t:g}" if decimals < 0 or largest >= 10**DIGITS else f"{t:.{decimals}f}" for t in ticks]
    return [words.replace("-", "−") for words in labels]


def rim(words: Any) -> None:  # noqa: ANN401  a text of matplotlib or of panels
    """Give words that stand on shapes a bright rim."""
    if hasattr(words, "set_rim"):
        words.set_rim()
        return
    from .plotting import HALO

    words.set_path_effects(HALO)
