"""Picture of a record: every channel with its cuts, the windows of the means, and the line of the zero."""

from collections.abc import Mapping, Sequence
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes

from ...core.arrays import Array
from ...core.figure_style import BLUE, GREEN, GREY, LINE, ORANGE, SMALL, THIN
from ...core.plotting import NotebookFigure, save_figure
from ...core.rounding import count
from ..vocabulary import ROLES
from .cuts import CutsFound
from .recording import Recording
from .statistics import ChannelFigures

COLUMNS = 1500  # of a picture; a longer record is drawn as the band of its extremes
MOST = 6  # channels drawn


def record_picture(
    recording: Recording, found: CutsFound | None, figures: Sequence[Mapping[str, ChannelFigures]]
) -> bytes:
    """PNG of a record: grey air, orange entry and exit, green window with its mean, dashed zero."""
    names = list(recording.channels)[:MOST]
    figure = NotebookFigure(figsize=(9.6, 0.8 + 1.9 * len(names)))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for ax, name in zip(panels, names, strict=True):
        _signal(ax, recording.channels[name], recording.sample_time)
        ax.set_ylabel(f"{name} [{ROLES[name].unit}]", fontsize=SMALL)
        ax.tick_params(labelsize=SMALL)
        ax.margins(x=0)
        for k, cut in enumerate(found.cuts if found else ()):
            _marks(ax, cut.span, cut.window, (cut.before, cut.after), recording.sample_time)
            _lines(ax, figures[k][name], cut.window, cut.before, cut.after, recording.sample_time)
    for k, cut in enumerate(found.cuts if found else ()):
        middle = (cut.span[0] + cut.span[1]) / 2 * recording.sample_time
        panels[0].annotate(
            str(k + 1), (middle, 1), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=SMALL
        )
    panels[-1].set_xlabel("time [s]", fontsize=SMALL)
    panels[0].set_title(_title(recording, found), fontsize=SMALL)
    figure.subplots_adjust(left=0.08, right=0.99, bottom=min(0.25, 0.5 / figure.get_figheight()), hspace=0.12,
                           top=1 - 0.3 / figure.get_figheight())  # fmt: skip
    held = BytesIO()
    save_figure(figure, held, format="png", dpi=100)
    return held.getvalue()


def _title(recording: Recording, found: CutsFound | None) -> str:
    rate = f"{recording.name}, {1 / recording.sample_time:.6g} Hz"
    if found is None:
        return f"{rate}: no cut"
    levels = ", ".join(f"{state} {level:.3g}" for state, level in found.levels.items())
    return (
        f"{rate}: {count(len(found.cuts), 'cut')}, found on {found.signal} ({levels}). Green: window of the mean; "
        "orange: entry and exit; grey: air; dashed: zero"
    )


def _signal(ax: Axes, values: Array, step: float) -> None:
    """The signal, or the band between the extremes of each picture column."""
    size = len(values) // COLUMNS
    if size < 4:
        ax.plot(step * np.arange(len(values)), values, color=BLUE, lw=THIN)
        return
    blocks = values[: len(values) // size * size].reshape(-1, size)
    low, high = np.fmin.reduce(blocks, axis=1), np.fmax.reduce(blocks, axis=1)
    time = step * size * (np.arange(len(blocks)) + 0.5)
    ax.fill_between(time, low, high, color=BLUE, lw=THIN, alpha=0.6)


def _marks(
    ax: Axes, span: tuple[int, int], window: tuple[int, int], airs: Sequence[tuple[int, int]], step: float
) -> None:
    for first, end in ((span[0], window[0]), (window[1], span[1])):
        ax.axvspan(first * step, end * step, color=ORANGE, alpha=0.35, lw=0)
    ax.axvspan(window[0] * step, window[1] * step, color=GREEN, alpha=0.15, lw=0)
    for first, end in airs:
        if end > first:
            ax.axvspan(first * step, end * step, color=GREY, alpha=0.25, lw=0)


def _lines(
    ax: Axes,
    figures: ChannelFigures,
    window: tuple[int, int],
    before: tuple[int, int],
    after: tuple[int, int],
    step: float,
) -> None:
    """The zero from the air before to the air after, and the mean above it."""
    ends = np.array([before[0] if before[1] > before[0] else window[0], after[1] if after[1] > after[0] else window[1]])
    ax.plot(ends * step, [figures.line.at(x) for x in ends], color="black", lw=THIN, ls="--")
    if np.isfinite(figures.mean):
        ax.plot(np.array(window) * step, [figures.line.at(x) + figures.mean for x in window], color="black", lw=LINE)
