"""A sheet of panels, and how it is laid out: on a figure of its own, or its one panel on axes that were given."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ....core.plotting import NotebookAxes, NotebookFigure
from ....core.plotting import axes_array as together

Panel = Callable[[Axes], None]

MOST_PANELS = 24


@dataclass(frozen=True, slots=True)
class Sheet:
    """Panels in reading order, None for an empty place; ``shared`` ones tell their scales at the border only."""

    title: str
    panels: Sequence[Panel | None]
    across: int
    size: tuple[float, float]  # of a panel, inches
    gaps: tuple[float, float] = (0.34, 0.5)  # beside and under it, in panels
    shared: bool = False


def laid_out(sheet: Sheet, banner: str) -> NDArray[np.object_]:
    """The panels on a figure of their own: banner and title over them, legend under them; margins in inches."""
    down = ceil(len(sheet.panels) / sheet.across)
    width, height = max(sheet.across * sheet.size[0] + 0.9, 4.8), down * sheet.size[1] + 1.7
    title, banner = fill(sheet.title, int(width / 0.082)), fill(banner, int(width / 0.066))
    top = 0.1 + 0.13 * (banner.count("\n") + 1)
    figure = NotebookFigure(figsize=(width, height))
    figure.suptitle(title, fontsize=10, y=1 - top / height, va="top")
    figure.text(0.995, 0.995, banner, ha="right", va="top", fontsize=8, color="#a33")
    grid = figure.add_gridspec(down, sheet.across)
    axes = np.array([None] * len(sheet.panels), dtype=object)
    for i, panel in enumerate(sheet.panels):
        if panel is not None:
            axes[i] = figure.add_subplot(grid[divmod(i, sheet.across)], axes_class=NotebookAxes)
            axes[i].tick_params(labelsize=8)
            panel(axes[i])
            if sheet.shared:
                _border_only(axes[i], i % sheet.across > 0, any(sheet.panels[i + sheet.across :: sheet.across]))
    drawn = together([ax for ax in axes if ax is not None])
    shown = {text: handle for ax in drawn for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    across = 6 if width > 8 else 3
    figure.legend(shown.values(), shown.keys(), loc="lower center", ncols=across, frameon=False, fontsize=8)
    figure.subplots_adjust(
        left=0.8 / width, right=1 - 0.2 / width, bottom=(0.58 + 0.18 * ceil(len(shown) / across)) / height,
        top=1 - (top + 0.45 + 0.16 * title.count("\n")) / height, wspace=sheet.gaps[0], hspace=sheet.gaps[1],
    )  # fmt: skip
    return drawn


def alone(sheet: Sheet, banner: str, ax: Axes) -> NDArray[np.object_]:
    """The one panel on axes that were given."""
    (panel,) = sheet.panels
    if panel is not None:
        panel(ax)
    ax.set_title("\n".join(filter(None, (fill(sheet.title, 60), ax.get_title()))), fontsize=9)
    ax.text(0.99, 0.01, fill(banner, 60), ha="right", fontsize=8, color="#a33", transform=ax.transAxes)
    ax.legend(frameon=False, fontsize=8)
    return np.array([ax], dtype=object)


def _border_only(ax: Axes, beside: bool, above: bool) -> None:
    if beside:
        ax.set_ylabel("")
        ax.tick_params(axis="y", which="both", labelleft=False)
    if above:
        ax.set_xlabel("")
        ax.tick_params(axis="x", which="both", labelbottom=False)
