"""Pens that draw panels: the interface of a pen, and a pen for PNG pictures by Pillow.

`PngPen` draws shapes three times as fine as they are written, and words at the size of the picture.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .arrays import Array
from .figure_style import DPI, INK, TEXT
from .text import printable

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont

Point = tuple[float, float]
Dashes = tuple[float, ...]
LEADING = 1.2  # times the size of a text, from line to line
FINE = 3  # pixels drawn for each that is written
STRIP = 256  # rows of the picture that are drawn at once
ABOVE = 8  # rows above a strip that are drawn and cut off: more than the joint of two lines of 8 pt
RIM = 2  # pixels about words on shapes
PAPER = "#ffffff"
LONGEST = 500  # letters of a text: a cell of 32 kB is no name
OUTLINES: dict[str, list[Point]] = {  # of markers, with half their size as the unit; a circle has none
    "s": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
    "D": [(0, -1.41), (1.41, 0), (0, 1.41), (-1.41, 0)],
    "^": [(0, -1), (1, 1), (-1, 1)],
    "v": [(0, 1), (1, -1), (-1, -1)],
    "P": [
        (-0.33, -1), (0.33, -1), (0.33, -0.33), (1, -0.33), (1, 0.33), (0.33, 0.33), (0.33, 1), (-0.33, 1),
        (-0.33, 0.33), (-1, 0.33), (-1, -0.33), (-0.33, -0.33),
    ],
}  # fmt: skip


class Pen(Protocol):
    """Interface of a pen: everything in pt from the left and from the top."""

    def line(self, points: Array, color: str, width: float, dashes: Dashes = ()) -> None:
        """A line through points (n, 2); ``dashes`` are multiples of its width."""

    def area(self, rings: Sequence[Array], color: str, opacity: float = 1.0) -> None:
        """The inside of closed rings, (n, 2) each; an inner ring is a hole."""

    def markers(self, points: Array, marker: str, size: float, face: str, edge: str, width: float) -> None:
        """A marker at each of the points (n, 2): one of ``osD^vP``; ``none`` is no face or edge."""

    def words(self, at: Point, words: "Words") -> None:
        """A text at a place."""


@dataclass(slots=True)
class Words:
    """A text: its anchor, size in pt and colour; ``angle`` turns it left by degrees, ``rim`` sets it off."""

    text: str
    size: float = TEXT
    color: str = INK
    ha: str = "left"
    va: str = "baseline"
    angle: float = 0.0
    bold: bool = False
    rim: bool = False

    def set_color(self, color: str) -> None:
        """Change the colour."""
        self.color = color

    def set_rim(self) -> None:
        """Set the text off from shapes."""
        self.rim = True


@dataclass(frozen=True, slots=True)
class _Shape:
    """A shape of a picture: its points (n, 2) in fine pixels, the rows that it covers, and what draws it."""

    points: Array
    top: float
    bottom: float
    draw: Callable[["ImageDraw.ImageDraw", Array], None]


class PngPen:
    """A white picture of so many pt.

    Shapes are kept, and drawn in strips of the height: a tall picture needs no more memory than a strip of it.

    Examples
    --------
    >>> import numpy as np
    >>> pen = PngPen(72.0, 36.0)
    >>> pen.line(np.array([[0.0, 0.0], [72.0, 36.0]]), "#0072b2", 1.6)
    >>> pen.picture().size
    (110, 55)
    """

    def __init__(self, width: float, height: float) -> None:
        self._pixels = DPI / 72
        self._size = round(width * self._pixels), round(height * self._pixels)
        self._shapes: list[_Shape] = []
        self._words: list[tuple[Point, Words]] = []

    def _add(self, points: Array, beyond: float, draw: Callable[["ImageDraw.ImageDraw", Array], None]) -> None:
        """Keep a shape at the finite ones of points (n, 2), pt, that goes so many fine pixels beyond them."""
        fine = points[np.isfinite(points).all(axis=1)] * (FINE * self._pixels)
        if len(fine):
            rows = fine[:, 1]
            self._shapes.append(_Shape(fine, float(rows.min()) - beyond, float(rows.max()) + beyond, draw))

    def _width(self, width: float) -> int:
        return max(1, round(width * FINE * self._pixels))

    def line(self, points: Array, color: str, width: float, dashes: Dashes = ()) -> None:
        """A line through points (n, 2), pt; ``dashes`` are multiples of its width."""
        wide = self._width(width)
        for part in dashed(points, [width * dash for dash in dashes]) if dashes else (points,):
            joint = "curve" if len(part) > 2 else None
            self._add(part, wide, partial(_line, color=color, width=wide, joint=joint))

    def area(self, rings: Sequence[Array], color: str, opacity: float = 1.0) -> None:
        """The inside of the first ring; others are holes, in the colour of the paper."""
        for k, ring in enumerate(rings):
            self._add(ring, 0.0, partial(_area, fill=PAPER if k else _on_paper(color, opacity)))

    def markers(self, points: Array, marker: str, size: float, face: str, edge: str, width: float) -> None:
        """A marker at each of the points (n, 2), pt."""
        half, line = size / 2 * FINE * self._pixels, self._width(width)
        fill = None if face == "none" else face
        draw = partial(_markers, marker=marker, half=half, line=line, fill=fill, edge=edge)
        self._add(points, 2 * half + line, draw)

    def words(self, at: Point, words: Words) -> None:
        """A text at a place, pt; it is drawn above all shapes."""
        if words.text:
            self._words.append((at, words))

    def picture(self) -> Any:  # noqa: ANN401  Image
        """The picture."""
        from PIL import Image, ImageDraw

        made = Image.new("RGB", self._size, PAPER)
        for top in range(0, self._size[1], STRIP):
            made.paste(self._strip(top, min(STRIP, self._size[1] - top)), (0, top))
        draw = ImageDraw.Draw(made)
        for (x, y), words in self._words:
            font = _font(round(words.size * self._pixels), words.bold)
            lines = printable(words.text[:LONGEST]).split("\n")
            if words.angle:
                self._turned(made, (x, y), lines[0], words, font)
            else:
                self._lines(draw, (x, y), lines, words, font)
        return made

    def _strip(self, top: int, rows: int) -> "Image.Image":
        """Rows of the picture from a top, without words."""
        from PIL import Image, ImageDraw

        first, after = FINE * (top - ABOVE), FINE * (top + rows)
        size = FINE * self._size[0], after - first
        draw = ImageDraw.Draw(fine := Image.new("RGB", size, PAPER))
        for shape in self._shapes:
            if shape.bottom >= first and shape.top <= after:
                shape.draw(draw, shape.points - (0, first))
        return fine.reduce(FINE, (0, FINE * ABOVE, *size))

    def _lines(self, draw: Any, at: Point, lines: Sequence[str], words: Words, font: "ImageFont.FreeTypeFont") -> None:  # noqa: ANN401
        """Lines of words one below the other."""
        step = words.size * LEADING * self._pixels
        first = {"top": 0.0, "center": -step * (len(lines) - 1) / 2}.get(words.va, -step * (len(lines) - 1))
        anchor = words.ha[0].replace("c", "m") + {"top": "a", "center": "m", "bottom": "d"}.get(words.va, "s")
        rim: dict[str, Any] = {"stroke_width": RIM, "stroke_fill": PAPER} if words.rim else {}
        x, y = at[0] * self._pixels, at[1] * self._pixels + first
        for k, line in enumerate(lines):
            draw.text((x, y + k * step), line, words.color, font, anchor, **rim)

    def _turned(self, made: Any, at: Point, line: str, words: Words, font: "ImageFont.FreeTypeFont") -> None:  # noqa: ANN401
        """A line that is read from below, its middle at the place; ``va`` is the side of the place that it is on."""
        from PIL import Image, ImageDraw

        width, height = round(font.getlength(line)) + 2, round(1.3 * font.size)
        upright = Image.new("L", (width, height), 0)
        ImageDraw.Draw(upright).text((1, height / 2), line, 255, font, "lm")
        mask = upright.transpose(Image.Transpose.ROTATE_90)
        x, y = round(at[0] * self._pixels - height / 2), round(at[1] * self._pixels)
        y -= 0 if words.va == "top" else width // 2
        made.paste(words.color, (x, y), mask)

    def save(self, path: Path) -> None:
        """Write the picture with a palette: a third of the bytes and half of the time of one without."""
        from PIL import Image

        made = self.picture().quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        made.putpalette([255 if level == 254 else level for level in made.getpalette() or ()])  # white stays white
        made.save(path, format="PNG", dpi=(DPI, DPI), compress_level=4)


def _flat(points: "Array | Sequence[Point]") -> list[float]:
    """Coordinates one after another, rounded down: Pillow rounds towards zero, which depends on the strip."""
    return np.floor(points).ravel().tolist()


def _line(to: "ImageDraw.ImageDraw", at: Array, *, color: str, width: int, joint: str | None) -> None:
    to.line(_flat(at), color, width, joint)


def _area(to: "ImageDraw.ImageDraw", at: Array, *, fill: str | tuple[int, ...]) -> None:
    to.polygon(_flat(at), fill)


def _markers(
    to: "ImageDraw.ImageDraw", at: Array, *, marker: str, half: float, line: int, fill: str | None, edge: str
) -> None:
    """Draw markers at points (n, 2), fine pixels, where they can be seen."""
    beyond, grown = 2 * half + line, half + line / 2
    seen = at[(at[:, 1] > -beyond) & (at[:, 1] < to.im.size[1] + beyond)]
    for x, y in seen.tolist():
        if marker == "o":
            to.ellipse(_flat([(x - grown, y - grown), (x + grown, y + grown)]), fill, edge, line)
            continue
        if fill:  # with an outline Pillow would draw it on a picture of its own
            to.polygon(_flat(_outline(x, y, marker, grown)), edge)
        if fill != edge:
            inner = _flat(_outline(x, y, marker, half - line / 2 if fill else half))
            if fill:
                to.polygon(inner, fill)
            else:
                to.line([*inner, *inner[:4]], edge, line, joint="curve")


def _outline(x: float, y: float, marker: str, half: float) -> list[Point]:
    """Corners of a marker about a place."""
    return [(x + half * dx, y + half * dy) for dx, dy in OUTLINES[marker]]


def dashed(points: Array, lengths: Sequence[float]) -> Iterator[Array]:
    """Parts of a line through points (n, 2): ``lengths`` are those of a dash and of the gap after it.

    Examples
    --------
    >>> import numpy as np
    >>> [part.tolist() for part in dashed(np.array([[0.0, 0.0], [5.0, 0.0]]), (2.0, 1.0))]
    [[[0.0, 0.0], [2.0, 0.0]], [[3.0, 0.0], [5.0, 0.0]]]
    """
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    dash, gap = lengths
    starts = np.arange(0.0, along[-1], dash + gap)
    ends = np.minimum(starts + dash, along[-1])
    heads, tails = (np.column_stack([np.interp(at, along, side) for side in points.T]) for at in (starts, ends))
    corners = np.searchsorted(along, starts, "right"), np.searchsorted(along, ends)
    for head, tail, first, after in zip(heads, tails, *corners, strict=True):
        yield np.vstack([head, points[first:after], tail])


def _on_paper(color: str, opacity: float) -> tuple[int, ...]:
    """A colour as it appears on white paper."""
    return tuple(round(255 + opacity * (int(color[i : i + 2], 16) - 255)) for i in (1, 3, 5))


@lru_cache(maxsize=16)
def _font(size: int, bold: bool) -> "ImageFont.FreeTypeFont":
    """DejaVu Sans, which comes with matplotlib; without it the font of Pillow."""
    from PIL import ImageFont

    found = find_spec("matplotlib")
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    for place in (found.submodule_search_locations or ()) if found else ():
        if (path := Path(place) / "mpl-data" / "fonts" / "ttf" / name).exists():
            return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)
    fallback: ImageFont.FreeTypeFont = ImageFont.load_default(size)  # type: ignore[assignment]
    return fallback
