"""The figures of a page, inline: each law with its band, and exponents with intervals; the drive has its own file."""

from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ParameterError
from ...parameters import LawSection, ParameterFile
from ...parameters.checks.loop_figures import closed_loop
from ...parameters.evaluate import LOGARITHMIC
from ..content.middle import middle, reference
from ..content.parts import Card, Coefficient, Figure, Law
from .drive_figures import bode, step
from .svg_panel import (
    BAND,
    INK,
    LINE,
    SIZE,
    SOFT,
    TESTED,
    Axis,
    Drawing,
    Panel,
    Room,
    at_levels,
    even,
    settings,
    svg,
)

Array = NDArray[np.float64]

ROW = 18.0  # px
BEYOND = 0.2  # drawn beyond the tested range, as a share of its ends
POINTS = 41
HIGHEST = 3.0  # times the largest predicted value, at which a band is cut off


def vector_figures(card: Card, pf: ParameterFile | None = None) -> dict[str, tuple[str, ...]]:
    """Draw those of ``card.figures`` that have no file: ``svg`` elements by the name of the figure.

    Parameters
    ----------
    card : Card
    pf : ParameterFile, optional
        Behind the card; without it exponents are all that can be drawn.

    Returns
    -------
    dict of tuple of str
        A panel each, everything in it escaped; a figure that cannot be drawn is left out.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.compose import compose
    >>> model = {"b": [0, 0.5], "a": [1, -0.5], "nk": 1, "sample_time": 0.1,
    ...          "uncertainty": {"kind": "none", "reason": "given"}}
    >>> pf = parameters.collect(tool="GC435", work="709M40", dynamics=model)
    >>> {name: len(panels) for name, panels in vector_figures(compose(pf), pf).items()}
    {'dynamics': 2}
    """
    wanted = {figure.name: list(_drawings(figure, card, pf)) for figure in card.figures if not figure.file}
    if not any(wanted.values()):
        return {}
    number = count(1)
    with settings():
        drawn = {name: tuple(svg(next(number), drawing) for drawing in drawings) for name, drawings in wanted.items()}
    return {name: panels for name, panels in drawn.items() if panels}


def _drawings(figure: Figure, card: Card, pf: ParameterFile | None) -> Iterator[Drawing]:
    if figure.name == "exponents":
        yield from exponents(figure, card.laws)
    elif pf is None:
        return
    elif figure.name == "responses":
        yield from responses(figure, card, pf)
    elif figure.name == "dynamics" and pf.dynamics is not None:
        yield from bode(figure, pf.dynamics)
    elif figure.name == "loop" and pf.dynamics is not None and pf.pi is not None:
        yield from step(figure, closed_loop(pf.dynamics, pf.pi))


def exponents(figure: Figure, laws: Sequence[Law]) -> Iterator[Drawing]:
    """Exponents of all power laws on one axis, with their intervals: point and bar a line, a law under its name."""
    groups = [(law.response, lines) for law in laws if law.form == "power" and (lines := _exponents(law))]
    ends = [n.value for _, lines in groups for c in lines for n in (c.estimate, c.low, c.high) if n.value is not None]
    if not ends:
        return
    rows = sum(len(lines) + 1 for _, lines in groups)
    margin = 0.05 * (max(*ends, 0.0) - min(*ends, 0.0))
    axis = even(min(*ends, 0.0) - margin, max(*ends, 0.0) + margin, "exponent")
    down = Axis(rows - 0.5, -0.7)
    room = Room(height=ROW * rows + 46, left=64.0, right=56.0, top=6.0)
    yield Drawing(figure.caption, figure.alternative, axis, down, lambda panel: _forest(panel, groups), room)


def _exponents(law: Law) -> list[Coefficient]:
    factors = {f.symbol for f in law.domain}
    return [c for c in law.coefficients if c.name in factors and c.estimate.value is not None]


def _forest(panel: Panel, groups: Sequence[tuple[str, Sequence[Coefficient]]]) -> None:
    ax, y = panel.ax, 0
    ax.axvline(0.0, color=SOFT, lw=0.8)
    bars, points = [], []
    left, right = panel.at(panel.x.low, 0)[0], panel.at(panel.x.high, 0)[0]
    for response, lines in groups:
        panel.text(2, _line(panel, y), response, style="f-ink strong")
        for c in lines:
            y += 1
            panel.text(left - 8, _line(panel, y), c.name, "end")
            panel.text(right + 8, _line(panel, y), c.estimate.text)
            points.append((c.estimate.value, y))
            if c.low.value is not None and c.high.value is not None:
                bars.append((y, c.low.value, c.high.value))
        y += 1
    if bars:
        at, low, high = zip(*bars, strict=True)
        ax.hlines(at, low, high, color=LINE, lw=2)
    ax.plot(*zip(*points, strict=True), "o", color=INK, ms=4.5, mew=0)


def _line(panel: Panel, row: float) -> float:
    return panel.at(0.0, row)[1] + 0.35 * SIZE


def responses(figure: Figure, card: Card, pf: ParameterFile) -> Iterator[Drawing]:
    """Each law over its first factor, the others at the middle of their ranges, with the tested range marked."""
    laws = [law for law in pf.laws.values() if law.form in LOGARITHMIC and law.factors]
    levels = {law.response: law.domain[0].levels for law in card.laws if law.domain}
    said = _sentences(figure.alternative, [law.response for law in laws])
    for law, alternative in zip(laws, said, strict=True):
        at_low, at_high = law.factors[0].low, law.factors[0].high
        ticks = [(n.value, n.text) for n in levels.get(law.response, ()) if n.value is not None]
        ends = [(at_low, f"{at_low:.4g}"), (at_high, f"{at_high:.4g}")]
        title = f"{law.response} over {law.factors[0].symbol}"
        yield _response(law, title, alternative, ticks if len(ticks) > 1 else ends)


def _sentences(text: str, responses: Sequence[str]) -> list[str]:
    """What a text says of each response, where it has a sentence for each in order; else all of it, each time."""
    starts, after = [], 0
    for name in responses:
        found = [at for turn in ("rises", "falls") if (at := text.find(f"{name} {turn} from", after)) >= 0]
        if not found:
            return [text] * len(responses)
        after = min(found)
        starts.append(after)
    return [text[a:b].strip() for a, b in zip(starts, [*starts[1:], len(text)], strict=True)]


def _response(law: LawSection, title: str, alternative: str, ticks: Sequence[tuple[float, str]]) -> Drawing:
    first = law.factors[0]
    low, high = first.low, first.high
    margin = BEYOND * (high - low) if high > low else BEYOND * abs(high)
    x = np.unique(np.r_[np.linspace(max(low - margin, low / (1 + BEYOND)), high + margin, POINTS), low, high])
    value, band = _over(law, first.symbol, x)
    top = HIGHEST * float(value.max()) if band is None else min(HIGHEST * float(value.max()), float(band[1].max()))
    bottom = 0.0 if band is None else min(float(band[0].min()), 0.0)
    across = at_levels(x[0], x[-1], ticks, f"{first.symbol}, {first.unit}".rstrip(", "))
    up = even(bottom, 1.04 * top, f"{law.response}, {law.unit}".rstrip(", "))
    inside = (x >= low) & (x <= high)

    def draw(panel: Panel) -> None:
        ax = panel.ax
        ax.axvspan(low, high, color=TESTED, lw=0)
        if band is not None:
            ax.fill_between(x[inside], band[0][inside], band[1][inside], color=BAND, lw=0)
            for end in band:
                ax.plot(x, end, color=SOFT, lw=0.8, ls=(0, (3, 3)))
        ax.plot(x, value, color=LINE, lw=1, ls=(0, (4, 3)))
        ax.plot(x[inside], value[inside], color=LINE, lw=2)
        panel.above((low + high) / 2, "tested")

    return Drawing(title, alternative, across, up, draw)


def _over(law: LawSection, symbol: str, x: Array) -> tuple[Array, tuple[Array, Array] | None]:
    """Values over a factor, and the band of one further row on a new edge where there is one."""
    at: dict[str, Any] = {**middle(law), symbol: x}
    level = reference(law)
    try:
        told = law.tell("prediction", by=level, **at)
    except ParameterError:
        return np.asarray(law.predict(by=level, **at)), None
    return np.asarray(told.value), (np.asarray(told.low), np.asarray(told.high))
