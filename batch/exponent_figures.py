"""Figures of a comparison as SVG: families of each grouping, and pairs alone and pooled with their family."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.figure_style import BLUE, FILL, GREY, INK, LIGHT, LINE, ORANGE, RED, SMALL, TEXT, THICK, THIN, TITLE
from ..core.journal import write_files
from ..core.text import printable
from ..fit.many.pooling import WHOLE
from .comparison import Comparison, largest_families

MOST_FAMILIES, MOST_PAIRS = 40, 60
STRETCH, FEWEST, MOST = 8, 12, 60  # pairs of a stretch that is drawn at its medians; stretches of a picture
WIDTH, ROW, LEAST, ABOVE, BELOW = 828.0, 15.0, 230.0, 90.0, 44.0  # pt: rows and panels, and what stands around them
GAP = 0.16  # rows, between a pair alone and pooled
FAR = 1.5  # times what eight tenths span: farther out nothing is shown but an arrow
POOLED = ("pooled_low", "pooled_high")
LETTER = 4.9  # pt of a letter in the name of a row
NAME = 32  # letters of a name
TICKS = 6  # steps of an axis at most
DASHED = ' stroke-dasharray="6 3"'
FONT = "DejaVu Sans, Verdana, Arial, sans-serif"


def write_figures(comparison: Comparison, folder: Path, banner: str = "", former: Iterable[str] = ()) -> list[Path]:
    """Write an SVG for each response and factor that has a family, all of them or none; return their paths.

    ``banner`` stands in red on every picture: that some pairs are simulated. Files of ``former`` that are not drawn any
    more are removed at once.

    Examples
    --------
    >>> import tempfile
    >>> from fitmodels.batch.comparison import compare
    >>> write_figures(compare(pd.DataFrame()), Path(tempfile.mkdtemp()))
    []
    """
    made: dict[str, bytes | None] = {}
    for (response, factor), families in comparison.families.groupby(["response", "factor"], sort=False):
        pairs = comparison.pairs
        pairs = pairs[(pairs["response"] == response) & (pairs["factor"] == factor)]
        taken = {Path(name).stem.casefold() for name in made}
        name = _free(f"exponents_{_plain(response)}_{_plain(factor)}", taken)
        made[name] = _figure(families, pairs, f"{response}", f"{factor}", comparison.level, banner).encode()
    if made:
        write_files(folder, made | dict.fromkeys(sorted({*former} - {*made})))
    return [folder / name for name in made]


def _figure(families: pd.DataFrame, pairs: pd.DataFrame, response: str, factor: str, level: float, banner: str) -> str:
    grouping, alone = _best_grouping(pairs)
    alone = alone.sort_values(["estimate", "tool", "work"])
    few = len(alone) <= MOST_PAIRS
    rows = list(_rows(families))
    names = [[name for name, _ in rows], pair_names(alone) if few else ["pairs"]]
    tall = [ROW * max(len(names[0]), 4), ROW * max(len(names[1]), 4) if few else LEAST]
    margins = [LETTER * max(map(len, some)) + 18 for some in names]
    wide = (WIDTH - sum(margins) - 43) / 2
    left = _Panel(margins[0] + 7, ABOVE, wide, tall[0], *_ends_of_families(rows))
    right = _Panel(margins[0] + wide + margins[1] + 25, ABOVE, wide, tall[1], *_ends_of_pairs(alone, few))
    high = ABOVE + max(tall) + BELOW
    words = f"Exponent of {factor} in the law of {response}: {len(alone)} pairs"
    marks = [
        *_head(words, level, banner),
        *_axes(left, f"exponent of {factor} (no unit)"),
        *_families(left, rows, len(families) - sum(row is not None for _, row in rows)),
        *_axes(right, f"exponent of {factor} (no unit)"),
        *(_few_pairs if few else _many_pairs)(right, alone, _with(grouping)),
    ]
    size = f'viewBox="0 0 {WIDTH:g} {high:.1f}" width="{WIDTH:g}pt" height="{high:.1f}pt"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" font-family="{FONT}">\n'
        f'<title>{_escaped(words)}</title>\n<rect width="100%" height="100%" fill="{LIGHT.paper}"/>\n'
        + "\n".join(filter(None, marks))
        + "\n</svg>\n"
    )


@dataclass(frozen=True, slots=True)
class _Panel:
    """A panel: its left, top, width and height in pt, and the values at its left and right, top and bottom."""

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    @property
    def base(self) -> float:
        """Its bottom in pt."""
        return self.top + self.height

    def across(self, values: object) -> Array:
        """Values of x in pt, those outside at the edge."""
        share = (np.asarray(values, dtype=float) - self.x[0]) / (self.x[1] - self.x[0])
        return np.asarray(self.left + self.width * np.clip(share, 0, 1))

    def down(self, values: object) -> Array:
        """Values of y in pt."""
        share = (np.asarray(values, dtype=float) - self.y[0]) / (self.y[1] - self.y[0])
        return np.asarray(self.top + self.height * share)


def _text(
    x: float, y: float, words: str, size: float = SMALL, colour: str = INK, anchor: str = "start", more: str = ""
) -> str:
    """Words with the end of their base line at x, y in pt."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" fill="{colour}" text-anchor="{anchor}"{more}>'
        f"{_escaped(words)}</text>"
    )


def _path(shape: str, colour: str, width: float, more: str = "") -> str:
    """A line, ``shape`` in pt."""
    return f'<path d="{shape}" fill="none" stroke="{colour}" stroke-width="{width:g}"{more}/>' if shape else ""


def _spans(low: Array, high: Array, at: Array) -> str:
    """Horizontal lines from low to high, all in pt; none where an end is not known."""
    known = np.isfinite(low) & np.isfinite(high)
    return "".join(f"M{x:.1f} {y:.1f}H{end:.1f}" for x, end, y in zip(low[known], high[known], at[known], strict=True))


def _cut(panel: _Panel, some: pd.DataFrame, names: Sequence[str], y: Array, colour: str) -> str:
    """Open arrows at the edge of the panel where an interval goes on; ``names`` of value, low and high end."""
    value, low, high = (some[name].to_numpy(dtype=float) for name in names)
    (left, right), edge = panel.x, panel.left + panel.width
    on_left = "".join(f"M{panel.left + 5:.1f} {up - 3:.1f}l-4 3l4 3" for up in y[(low < left) & (value >= left)])
    on_right = "".join(f"M{edge - 5:.1f} {up - 3:.1f}l4 3l-4 3" for up in y[(high > right) & (value <= right)])
    return _path(on_left + on_right, colour, LINE)


def _curve(x: Array, y: Array) -> str:
    """A line through points in pt, broken where one is not known."""
    known = np.isfinite(x)
    return "".join(f"{'L' if i and known[i - 1] else 'M'}{x[i]:.1f} {y[i]:.1f}" for i in np.flatnonzero(known).tolist())


def _band(low: Array, high: Array, at: Array, colour: str) -> str:
    """The area between two curves over the rows where both are known, in pt."""
    known = np.isfinite(low) & np.isfinite(high)
    x, y = np.append(low[known], high[known][::-1]), np.append(at[known], at[known][::-1])
    return f'<path d="{_curve(x, y)}Z" fill="{colour}" fill-opacity="{2 * FILL:g}"/>' if known.any() else ""


def _dots(x: Array, y: Array, colour: str, size: float, fill: str = "") -> Iterator[str]:
    """Circles of a diameter in pt."""
    for at, up in zip(x, y, strict=True):
        if np.isfinite(at):
            yield f'<circle cx="{at:.1f}" cy="{up:.1f}" r="{size / 2:g}" fill="{fill or colour}" stroke="{colour}"/>'


def _squares(x: Array, y: Array, colour: str, size: float) -> str:
    sides = f"h{size:g}v{size:g}h{-size:g}z"
    corners = (f"M{at - size / 2:.1f} {up - size / 2:.1f}{sides}" for at, up in zip(x, y, strict=True))
    return f'<path d="{"".join(corners)}" fill="{colour}"/>'


def _head(title: str, level: float, banner: str) -> Iterator[str]:
    yield _text(9, 17, title, TITLE + 2)
    yield _text(WIDTH - 9, 17, banner, TITLE, RED, "end") if banner else ""
    note = (
        f"Lines and bands are {100 * level:g} % intervals: of a pair alone the t interval of its own fit, else the"
        " posterior of partial pooling. Arrow: a value outside its panel; open arrow: an interval that goes on."
    )
    yield _text(9, 33, note, SMALL, GREY)


def _axes(panel: _Panel, name: str) -> Iterator[str]:
    """Grid, frame, ticks and the name of x, and a line at zero."""
    ticks, labels = _ticks(*panel.x)
    at = panel.across(ticks)
    yield _path("".join(f"M{x:.1f} {panel.top:.1f}V{panel.base:.1f}" for x in at), LIGHT.rule, THIN)
    if panel.x[0] < 0 < panel.x[1]:
        yield _path(f"M{panel.across(0.0):.1f} {panel.top:.1f}V{panel.base:.1f}", GREY, THIN)
    frame = f"M{panel.left:.1f} {panel.top:.1f}V{panel.base:.1f}h{panel.width:.1f}"
    yield _path(frame + "".join(f"M{x:.1f} {panel.base:.1f}v4" for x in at), GREY, THIN)
    for x, label in zip(at.tolist(), labels, strict=True):
        yield _text(x, panel.base + 13, label, anchor="middle")
    yield _text(panel.left + panel.width / 2, panel.base + 28, name, TEXT, anchor="middle")


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Round values from low to high, at most ``TICKS`` steps, and their labels.

    >>> _ticks(0.12, 0.58)
    ([0.2, 0.3, 0.4, 0.5], ['0.2', '0.3', '0.4', '0.5'])
    """
    least = (high - low) / TICKS
    power = int(np.floor(np.log10(least)))
    step, digits = next((k * 10.0**power, power) for k in (1, 2, 5, 10) if k * 10.0**power >= least)
    digits = max(0, -(digits + (step >= 9.9 * 10.0**power)))
    ticks = [round(k * step, digits) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]
    return ticks, [f"{tick:.{digits}f}" for tick in ticks]


def _legend(panel: _Panel, title: str, keys: Sequence[tuple[str, str]]) -> Iterator[str]:
    """The title of a panel, and beneath it what is drawn and its name, two in a line."""
    yield _text(panel.left, 55, title, TITLE)
    for i, (mark, words) in enumerate(keys):
        x = panel.left + 4 + (LETTER * max(len(words) for _, words in keys[::2]) + 48 if i % 2 else 0)
        y = panel.top - 7 - 12 * ((len(keys) - 1) // 2 - i // 2)
        yield f'<g transform="translate({x:.1f} {y - 3:.1f})">{mark}</g>'
        yield _text(x + 24, y, words)


def _rows(families: pd.DataFrame) -> Iterator[tuple[str, "pd.Series[float] | None"]]:
    """Rows of the panel from the top down: each grouping's name (without numbers), then its families by mean."""
    for grouping, some in largest_families(families, MOST_FAMILIES).groupby("grouping", sort=False):
        if grouping != WHOLE:
            yield str(grouping), None
        for _, row in some.sort_values(["mean", "family"]).iterrows():
            yield f"{_short(str(row['family']))}  ({row['pairs']})", row


def _ends_of_families(rows: Sequence[tuple[str, "pd.Series[float] | None"]]) -> tuple[tuple[float, float], ...]:
    held = pd.DataFrame([row for _, row in rows if row is not None])
    return _reach(held, "mean", ("new_low", "new_high")), _row_ends(len(rows))


def _families(panel: _Panel, rows: Sequence[tuple[str, "pd.Series[float] | None"]], rest: int) -> Iterator[str]:
    held = pd.DataFrame([row for _, row in rows if row is not None])
    y = panel.down([place for place, (_, row) in enumerate(rows) if row is not None])
    ends = ("mean_low", "mean_high", "new_low", "new_high")
    low, high, new_low, new_high = (panel.across(held[name]) for name in ends)
    yield _path(_spans(new_low, new_high, y), ORANGE, LINE)
    yield _path(_spans(low, high, y), BLUE, THICK)
    yield _cut(panel, held, ("mean", "new_low", "new_high"), y, ORANGE)
    yield from _marked(panel, held["mean"], y, BLUE, lambda x, at: _dots(x, at, BLUE, 5.5, LIGHT.paper))
    yield from _row_names(panel, [name for name, _ in rows], [row is None for _, row in rows])
    new, mean = _path("M0 0h18", ORANGE, LINE), _path("M0 0h18", BLUE, THICK)
    keys = [(new, "a new pair of the family"), (mean, "mean of the family")]
    yield from _legend(panel, "Families (number of pairs), by their mean", keys)
    if rest:
        yield _text(panel.left, panel.base + 42, f"the {len(held)} largest; {rest} more in comparison.csv")


def _ends_of_pairs(alone: pd.DataFrame, few: bool) -> tuple[tuple[float, float], tuple[float, float]]:
    return _reach(alone, "estimate", POOLED), _row_ends(len(alone)) if few else (len(alone) + 0.5, 0.5)


def _row_ends(rows: int) -> tuple[float, float]:
    return -0.6, max(rows, 3) - 0.4


def _few_pairs(panel: _Panel, some: pd.DataFrame, with_words: str) -> Iterator[str]:
    """Each pair alone (grey) and with its family (blue), in rising order."""
    rows = np.arange(len(some), dtype=np.float64)
    upper, lower = panel.down(rows - GAP), panel.down(rows + GAP)
    low, high, pooled_low, pooled_high = (panel.across(some[name]) for name in ("low", "high", *POOLED))
    yield _path(_spans(low, high, upper), GREY, LINE)
    yield _path(_spans(pooled_low, pooled_high, lower), BLUE, LINE)
    yield _cut(panel, some, ("estimate", "low", "high"), upper, GREY)
    yield _cut(panel, some, ("pooled", *POOLED), lower, BLUE)
    yield from _marked(panel, some["estimate"], upper, GREY, lambda x, y: [_squares(x, y, GREY, 4.4)])
    yield from _marked(panel, some["pooled"], lower, BLUE, lambda x, y: _dots(x, y, BLUE, 4.2))
    yield from _row_names(panel, pair_names(some), [False] * len(some))
    nine, naught = np.array([9.0]), np.zeros(1)
    keys = [(_squares(nine, naught, GREY, 4.4), "alone"), ("".join(_dots(nine, naught, BLUE, 4.2)), with_words)]
    yield from _legend(panel, f"Pairs by their own exponents{_not_pooled(some)}", keys)


def _many_pairs(panel: _Panel, some: pd.DataFrame, with_words: str) -> Iterator[str]:
    """Curves over all pairs in rising order: medians over stretches of neighbours."""
    each = np.array_split(np.arange(len(some)), min(max(len(some) // STRETCH, FEWEST), MOST))
    stretch = np.repeat(np.arange(len(each)), [len(at) for at in each])
    names = ["estimate", "low", "high", "pooled", *POOLED]
    middle = some[names].astype(float).replace([np.inf, -np.inf], np.nan).groupby(stretch).median()
    x = {name: panel.across(middle[name]) for name in names}
    y = panel.down([at.mean() + 1 for at in each])
    yield _band(x["low"], x["high"], y, GREY)
    yield _path(_curve(x["estimate"], y), GREY, LINE, DASHED)
    yield _band(x["pooled_low"], x["pooled_high"], y, BLUE)
    yield _path(_curve(x["pooled"], y), BLUE, LINE)
    ticks, labels = _ticks(0.5, len(some) + 0.5)
    for at, label in zip(panel.down(ticks).tolist(), labels, strict=True):
        yield _text(panel.left - 6, at + 3, label, anchor="end")
        yield _path(f"M{panel.left:.1f} {at:.1f}h-4", GREY, THIN)
    words = "pairs, in rising order of their own exponents"
    at, middle_of = panel.left - 40, panel.top + panel.height / 2
    yield _text(at, middle_of, words, TEXT, anchor="middle", more=f' transform="rotate(-90 {at:.1f} {middle_of:.1f})"')
    box = '<rect y="-4" width="18" height="8" fill="{}" fill-opacity="{:g}"/>'.format
    keys = [
        (box(GREY, 2 * FILL), "interval alone"),
        (box(BLUE, 2 * FILL), "interval pooled"),
        (_path("M0 0h18", GREY, LINE, DASHED), "alone"),
        (_path("M0 0h18", BLUE, LINE), with_words),
    ]
    yield from _legend(panel, f"Pairs, medians of {len(each[-1])} neighbours{_not_pooled(some)}", keys)


def _marked(
    panel: _Panel, values: "pd.Series[float]", y: Array, colour: str, drawn: Callable[[Array, Array], Iterable[str]]
) -> Iterator[str]:
    """Marks at the values inside the panel, and arrows at its edge for those outside."""
    at, (low, high) = values.to_numpy(dtype=float), panel.x
    inside = (at >= low) & (at <= high)
    yield from drawn(panel.across(at[inside]), y[inside])
    for outside, edge, point in ((at < low, panel.left + 2, 6), (at > high, panel.left + panel.width - 2, -6)):
        arrows = "".join(f"M{edge:.1f} {up:.1f}l{point} -3v6z" for up in y[outside])
        if arrows:
            yield f'<path d="{arrows}" fill="{colour}"/>'


def _row_names(panel: _Panel, names: Sequence[str], bold: Sequence[bool]) -> Iterator[str]:
    for y, name, heavy in zip(panel.down(np.arange(len(names))).tolist(), names, bold, strict=True):
        more = ' font-weight="bold"' if heavy else ""
        yield _text(panel.left - 5, y + 3, name, anchor="end", more=more)


def pair_names(pairs: pd.DataFrame) -> list[str]:
    """Names of pairs, long ones without their middle."""
    return [_short(f"{tool} on {work}") for tool, work in zip(pairs["tool"], pairs["work"], strict=True)]


def _best_grouping(pairs: pd.DataFrame) -> tuple[str, pd.DataFrame]:
    """The first grouping besides all pairs that pools most of them, and its rows; else all pairs."""
    pooled = pairs["pooled"].notna().groupby(pairs["grouping"], sort=False).mean()
    good = [name for name in pooled.index if name != WHOLE and pooled[name] > 0.5]
    grouping = str(good[0]) if good else WHOLE
    return grouping, pairs[pairs["grouping"] == grouping]


def _with(grouping: str) -> str:
    return "pooled over all pairs" if grouping == WHOLE else f"pooled with its family ({grouping})"


def _reach(some: pd.DataFrame, centres: str, names: Sequence[str]) -> tuple[float, float]:
    """Limits that hold centres and named ends, but for what lies far out: one extreme pair would compress the rest."""
    middle = some[centres].to_numpy(dtype=float)
    ends = some[list(names)].to_numpy(dtype=float)
    held = np.concatenate([middle, ends[np.isfinite(ends)]])
    low, high = np.quantile(held, [0.1, 0.9])
    span = max(float(high - low), 1e-3)
    near = held[(held >= low - FAR * span) & (held <= high + FAR * span)]
    return float(near.min() - 0.05 * span), float(near.max() + 0.05 * span)


def _not_pooled(pairs: pd.DataFrame) -> str:
    without = int(pairs["pooled"].isna().sum())
    return f"; {without} not pooled" if without else ""


def _escaped(words: str) -> str:
    return escape(printable(words))


def _short(name: str) -> str:
    """A long name without its middle: its end distinguishes grades and inserts."""
    return name if len(name) <= NAME else f"{name[: NAME // 2 - 2]}...{name[1 - NAME // 2 :]}"


def _plain(name: object) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in str(name))


def _free(stem: str, taken: set[str]) -> str:
    """A file name that differs from the others without regard to case."""
    number, free = 1, stem
    while free.casefold() in taken:
        number += 1
        free = f"{stem}-{number}"
    return f"{free}.svg"
