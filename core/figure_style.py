"""Style of all figures: colours on light and on dark paper, sizes and line widths, for matplotlib and SVG.

The hues are those of Okabe & Ito 2008 (Color Universal Design), which readers with any colour vision distinguish; two
are darkened to a contrast of 3 on white. No figure depends on colour alone: limits are dashed and labelled, edges have
markers. Pictures are on light paper; the SVG figures of a page take the colours of its scheme from `css_colours`.
"""

from dataclasses import dataclass
from typing import Final


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


def css_colours(palette: Palette) -> dict[str, str]:
    """Colours by the names of the variables in the style sheet of a page.

    Examples
    --------
    >>> css_colours(DARK)["line"]
    '#56b4e9'
    """
    names = ("ink", "line", "second", "third", "limit")
    return {**{name: getattr(palette, name) for name in names}, "band": f"{palette.line}33"}
