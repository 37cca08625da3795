"""Inline SVG figures of a page: laws with bands, exponents with intervals, Bode diagram and step response."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import ParameterError
from ...core.figure_style import contour_levels
from ...core.panels import PanelAxes
from ...core.rounding import middle_of, with_unit
from ...datasets.vocabulary import FLANK_WEAR
from ...parameters import ParameterFile
from ...parameters.checks.loop_figures import ClosedLoop, closed_loop
from ...parameters.sections.dynamics import DynamicsSection
from ...parameters.sections.law_parts import Factor
from ..content.card import Card
from ..content.design import at_words
from ..content.figure_texts import (
    DrawnLaw,
    drawn_laws,
    response_text,
    surface_text,
)
from ..content.parts import CoefficientPart, FigurePart, LawPart, ProfiledLawPart
from .svg_panel import (
    BAND,
    INK,
    LIMIT,
    LINE,
    SECOND,
    SIZE,
    SOFT,
    TESTED,
    WIDTH,
    Margins,
    PanelAxis,
    PanelCanvas,
    PanelDrawing,
    at_levels,
    decades,
    even,
    svg,
)

ROW = 18.0  # px
BEYOND = 0.2  # drawn beyond the tested range, as a share of its ends
POINTS, FINE = 41, 61  # of a curve, and of a surface along each factor
AROUND = 0.06  # of a range, about it in a figure of contours
LETTER = 7.6  # px, the width of a letter
FAR = 1.6  # times the highest value drawn, up to which a limit is drawn
HIGHEST = 3.0  # times the largest predicted value, at which a band is cut off
FREQUENCIES = 80
BELOW = 10.0  # times below the excited band, or 200 below Nyquist, where a frequency axis begins
STILL = 1e-3  # what the slowest pole has died down to where a step ends
LONGEST = 5000  # samples of a step
DRAWN = 300  # of which are drawn
SETTLED = 0.02


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
    >>> from fitmodels.cards.content.card import compose
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
    marked = {name: [_marked(each, pf) for each in drawings] for name, drawings in wanted.items()}
    drawn = {name: tuple(svg(next(number), each) for each in drawings) for name, drawings in marked.items()}
    return {name: panels for name, panels in drawn.items() if panels}


def _marked(drawing: PanelDrawing, pf: ParameterFile | None) -> PanelDrawing:
    """The drawing, with the word ``simulated`` in it where the data were not measured."""
    if pf is None or not pf.identity.simulated:
        return drawing

    def draw(panel: PanelCanvas) -> None:
        drawing.draw(panel)
        panel.text(WIDTH - 2, panel.margins.height - 6, "simulated", "end", "f-limit strong")

    return drawing._replace(draw=draw)


def _drawings(figure: FigurePart, card: Card, pf: ParameterFile | None) -> Iterator[PanelDrawing]:
    if figure.name == "exponents":
        yield from exponents(figure, card.laws)
    elif pf is None:
        return
    elif figure.name == "responses":
        yield from responses(figure, card, drawn_laws(pf))
    elif figure.name == "surfaces":
        yield from surfaces(figure, card, drawn_laws(pf))
    elif figure.name == "dynamics" and pf.dynamics is not None:
        yield from bode(figure, pf.dynamics)
    elif figure.name == "loop" and pf.dynamics is not None and pf.pi is not None:
        yield from step(figure, closed_loop(pf.dynamics, pf.pi))


def exponents(figure: FigurePart, laws: Sequence[LawPart]) -> Iterator[PanelDrawing]:
    """Exponents of all power laws on one axis, with their intervals: point and bar a line, a law under its name."""
    groups = [(law.response, lines) for law in laws if law.form == "power" and (lines := _exponents(law))]
    ends = [n.value for _, lines in groups for c in lines for n in (c.estimate, c.low, c.high) if n.value is not None]
    if not ends:
        return
    rows = sum(len(lines) + 1 for _, lines in groups)
    margin = 0.05 * (max(*ends, 0.0) - min(*ends, 0.0))
    axis = even(min(*ends, 0.0) - margin, max(*ends, 0.0) + margin, "exponent")
    down = PanelAxis(rows - 0.5, -0.7)
    margins = Margins(height=ROW * rows + 46, left=64.0, right=56.0, top=6.0)
    yield PanelDrawing(figure.caption, figure.alternative, axis, down, lambda panel: _forest(panel, groups), margins)


def _exponents(law: LawPart) -> list[CoefficientPart]:
    factors = {f.symbol for f in law.domain}
    return [c for c in law.coefficients if c.name in factors and c.estimate.value is not None]


def _forest(panel: PanelCanvas, groups: Sequence[tuple[str, Sequence[CoefficientPart]]]) -> None:
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
    across, down = zip(*points, strict=True)
    ax.plot(across, down, "o", color=INK, ms=4.5, mew=0)


def _line(panel: PanelCanvas, row: float) -> float:
    return panel.at(0.0, row)[1] + 0.35 * SIZE


def responses(figure: FigurePart, card: Card, laws: Sequence[DrawnLaw]) -> Iterator[PanelDrawing]:
    """Each law over its first factor, the others at the middle of their ranges, with the tested range marked."""
    levels = {law.response: law.domain[0].levels for law in card.laws if law.domain}
    parts = _profiled(card)
    for of in laws:
        law = of.law
        at_low, at_high = law.factors[0].low, law.factors[0].high
        ticks = [(n.value, n.text) for n in levels.get(law.response, ()) if n.value is not None]
        ends = [(at_low, f"{at_low:.4g}"), (at_high, f"{at_high:.4g}")]
        title = f"{law.response} over {law.factors[0].symbol}"
        text = response_text(of, parts[law.response]) if law.response in parts else figure.alternative
        yield _response(of, title, text, ticks if len(ticks) > 1 else ends)


def _profiled(card: Card) -> dict[str, ProfiledLawPart]:
    """Laws of the profiler of the card by their responses."""
    return {law.response: law for law in (() if card.profiler is None else card.profiler.laws)}


def _response(of: DrawnLaw, title: str, text: str, ticks: Sequence[tuple[float, str]]) -> PanelDrawing:
    law, limit, wear = of.law, of.limit, of.wear
    first = law.factors[0]
    low, high = first.low, first.high
    margin = BEYOND * (high - low) if high > low else BEYOND * abs(high)
    x = np.unique(np.r_[np.linspace(max(low - margin, low / (1 + BEYOND)), high + margin, POINTS), low, high])
    x = x[x > 0] if law.formula.logs[0] else x  # a law of a time from zero
    value, band = _over(of, of.at_first(x))
    held = np.asarray(law.values(of.at_first(x, held=True), by=of.level)) if wear else None
    top = HIGHEST * float(value.max()) if band is None else min(HIGHEST * float(value.max()), float(band[1].max()))
    top = max(top, 0.0 if held is None else float(held.max()), limit[0] if limit and limit[0] < FAR * top else 0.0)
    bottom = 0.0 if band is None else min(float(band[0].min()), 0.0)
    across = at_levels(x[0], x[-1], ticks, with_unit(first.symbol, first.unit))
    up = even(bottom, 1.04 * top, with_unit(law.response, law.unit))
    inside = (x >= low) & (x <= high)

    def draw(panel: PanelCanvas) -> None:
        ax = panel.ax
        ax.axvspan(low, high, color=TESTED, lw=0)
        if band is not None:
            ax.fill_between(x[inside], band[0][inside], band[1][inside], color=BAND, lw=0)
            for end in band:
                ax.plot(x, end, color=SOFT, lw=0.8, ls=(0, (3, 3)))
        ax.plot(x, value, color=LINE, lw=1, ls=(0, (4, 3)))
        ax.plot(x[inside], value[inside], color=LINE, lw=2)
        if held is not None and wear is not None:
            ax.plot(x[inside], held[inside], color=SECOND, lw=1.6, ls=(0, (6, 3)))
            panel.key(wear[0], "s-line")
            panel.key(wear[1], "s-second", dashed=True)
        panel.above((low + high) / 2, "tested")
        _limit(panel, limit)

    margins = Margins(height=240, top=54) if wear else Margins()
    return PanelDrawing(title, text, across, up, draw, margins)


def _limit(panel: PanelCanvas, limit: tuple[float, str] | None) -> None:
    """A limit as a dashed line with its words, where the axis reaches it."""
    if limit is not None and panel.y.low < limit[0] < panel.y.high:
        panel.ax.axhline(limit[0], color=LIMIT, lw=1.6, ls=(0, (6, 3)))
        panel.text(panel.margins.left + 4, panel.at(0, limit[0])[1] - 4, limit[1], style="f-limit halo")


def _over(of: DrawnLaw, at: dict[str, Any]) -> tuple[Array, tuple[Array, Array] | None]:
    """Values at conditions, and the band of one further row on a new edge where there is one."""
    try:
        found = of.law.predict(at, by=of.level)
    except ParameterError:
        return np.asarray(of.law.values(at, by=of.level)), None
    return np.asarray(found.value), (np.asarray(found.low), np.asarray(found.high))


def surfaces(figure: FigurePart, card: Card, laws: Sequence[DrawnLaw]) -> Iterator[PanelDrawing]:
    """Contours of each law over its first two factors inside the tested region, the limit of its response dashed."""
    parts = _profiled(card)
    for of in laws:
        if len(of.over) == 2:
            part = parts.get(of.law.response)
            yield _surface(of, figure.alternative if part is None else surface_text(of, part))


def _surface(of: DrawnLaw, text: str) -> PanelDrawing:
    """Axes are logarithmic where the law takes logarithms; ``u`` and ``v`` are the coordinates that are drawn."""
    law, over, level, wear, limit = of.law, of.over, of.level, of.wear, of.limit
    found = {f.symbol: (f, log) for f, log in zip(law.factors, law.formula.logs, strict=True)}
    axes = [_factor_axis(*found[name]) for name in over]
    u, v = (np.linspace(axis.ticks[0], axis.ticks[-1], FINE) for axis in axes)
    grid = np.meshgrid(u, v)
    shown = {name: np.exp(g) if found[name][1] else g for name, g in zip(over, grid, strict=True)}
    at = of.with_own_wear({**of.middle, **shown})
    inside = np.asarray(law.inside(by=level, **at))
    z = np.ma.masked_array(np.asarray(law.values(at, by=level)), ~inside)
    others = {symbol: value for symbol, value in of.middle.items() if symbol not in over}
    held = {name: value for name, value in others.items() if not (wear and name in FLANK_WEAR)}
    words = ", ".join(filter(None, (at_words(law, held, level, 3), wear[0] if wear else "")))

    name, up_name = with_unit(law.response, law.unit), axes[1].name

    def draw(panel: PanelCanvas) -> None:
        panel.text(2, SIZE + 1, name, style="f-ink strong")
        panel.text(12 + LETTER * len(name), SIZE + 1, f"at {words}" if words else "", style="f-soft")
        panel.text(2, 2.6 * SIZE, up_name)
        if z.count():
            _contours(panel, (u, v, z), limit)
            if limit is not None and not z.min() < limit[0] < z.max():
                side = "not reached" if limit[0] >= z.max() else "exceeded everywhere"
                panel.text(WIDTH - 2, 2.6 * SIZE, f"{limit[1]}: {side}", "end", "f-limit")

    title = f"{law.response} over {over[0]} and {over[1]}"
    return PanelDrawing(title, text, axes[0], axes[1]._replace(name=""), draw, Margins(height=250, top=44))


def _factor_axis(factor: Factor, log: bool) -> PanelAxis:
    """The tested range of a factor and a margin about it, with ticks at its ends and middle."""
    ends = (factor.low, middle_of(factor.low, factor.high, logs=log), factor.high)
    ticks = [math.log(x) if log else x for x in ends]
    margin = AROUND * (ticks[-1] - ticks[0])
    name = with_unit(factor.symbol, factor.unit)
    return PanelAxis(ticks[0] - margin, ticks[-1] + margin, ticks, [f"{x:.4g}" for x in ends], name)


def _contours(panel: PanelCanvas, surface: tuple[Array, Array, Any], limit: tuple[float, str] | None) -> None:
    """The tested region, labelled contours in it, and that of a limit."""
    u, v, z = surface
    panel.ax.contourf(u, v, np.where(np.ma.getmaskarray(z), 0.0, 1.0), [0.5, 1.5], colors=[TESTED])
    levels = contour_levels(z.compressed())
    for level, line in zip(levels, _lines(panel.ax, surface, levels, LINE, 1.2), strict=True):
        _label(panel, line, f"{level:.4g}", "f-ink halo")
    if limit is not None and float(z.min()) < limit[0] < float(z.max()):
        for line in _lines(panel.ax, surface, np.array([limit[0]]), LIMIT, 1.8):
            _label(panel, line, limit[1], "f-limit halo")


def _lines(
    ax: PanelAxes, surface: tuple[Array, Array, Any], levels: Array, color: str, width: float
) -> Sequence[Array]:
    """Draw contours; return the points of each, shape (n, 2)."""
    return ax.contour(*surface, levels, colors=color, linewidths=width).points


def _label(panel: PanelCanvas, line: Array, words: str, style: str) -> None:
    """Put words on the middle of a contour."""
    if len(line):
        x, y = panel.at(*line[len(line) // 2])
        panel.text(x, y + 0.35 * SIZE, words, "middle", style)


def bode(figure: FigurePart, model: DynamicsSection) -> Iterator[PanelDrawing]:
    """Gain and phase of the model up to half the sampling rate, the excited band marked."""
    nyquist = 0.5 / model.sample_time
    least = model.band[0] / BELOW if model.band and model.band[0] > 0 else nyquist / (20 * BELOW)
    f = np.geomspace(min(least, nyquist / BELOW), 0.999 * nyquist, FREQUENCIES)
    with np.errstate(all="ignore"):
        G = model.response(f)
        f, G = f[np.isfinite(G) & (G != 0)], G[np.isfinite(G) & (G != 0)]
    if not len(f):
        return
    gain, phase = np.log10(np.abs(G)), np.degrees(np.unwrap(np.angle(G)))
    across = decades(float(np.log10(f[0])), float(np.log10(nyquist)), "frequency [Hz]")
    unit = f"{model.unit_y or 'output'}/{model.unit_u or 'input'}"
    margin = 0.08 * float(np.ptp(gain)) + 0.05
    for name, values, up in (
        ("gain", gain, decades(float(gain.min()) - margin, float(gain.max()) + margin, f"gain [{unit}]")),
        ("phase", phase, even(float(phase.min()) - 10, float(phase.max()) + 10, "phase [degrees]")),
    ):
        title = f"{name.capitalize()} over frequency"
        yield PanelDrawing(title, figure.alternative, across, up, _over_frequency(np.log10(f), values, model.band))


def _over_frequency(f: Array, values: Array, band: tuple[float, float] | None) -> Callable[[PanelCanvas], None]:
    def draw(panel: PanelCanvas) -> None:
        if band is not None and band[0] > 0:
            low, high = np.log10(band)
            panel.ax.axvspan(low, high, color=TESTED, lw=0)
            panel.above((low + high) / 2, "excited")
        panel.ax.plot(f, values, color=LINE, lw=2)

    return draw


def step(figure: FigurePart, loop: ClosedLoop) -> Iterator[PanelDrawing]:
    """Output of the loop after a unit step of the reference, from rest, with the lines it settles between."""
    radius = loop.radius
    if not radius < 1:
        return
    n = int(np.clip(np.log(STILL) / np.log(max(radius, 1e-3)), 30, LONGEST))
    y = loop.run(np.convolve(np.convolve(loop.b, loop.pn), loop.hd), np.ones(n))
    time = np.arange(n) * loop.sample_time
    every = slice(None, None, -(-n // DRAWN))
    across = even(0.0, float(time[-1]), "time [s]")
    up = even(min(0.0, float(y.min())), 1.06 * max(1.0, float(y.max())), "output per unit of reference")

    def draw(panel: PanelCanvas) -> None:
        panel.ax.axhspan(1 - SETTLED, 1 + SETTLED, color=TESTED, lw=0)
        panel.ax.axhline(1.0, color=SOFT, lw=0.8, ls=(0, (3, 3)))
        panel.ax.plot(time[every], y[every], color=LINE, lw=2)

    yield PanelDrawing("Step of the reference", figure.alternative, across, up, draw)
