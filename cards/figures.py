"""Figures in the folder of a card: laws as panels, posteriors, and an identification."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..fit import LawFit
from ..fit.bayes.posterior import Posterior
from ..fit.law_figures import normal_quantiles, observed_against_predicted, residuals, response_surface

if TYPE_CHECKING:
    from ..ident.identification import Identification

NAMES = ("response_surfaces.png", "observed_predicted.png", "residuals.png")
Panel = Callable[[LawFit, Axes], Axes]


def draw_figures(laws: Sequence[LawFit], folder: Path, banner: str = "") -> tuple[str, ...]:
    """Write the three figures to ``folder`` and return their names; ``banner`` is drawn over each of them."""
    folder.mkdir(parents=True, exist_ok=True)
    rows: dict[str, tuple[Panel, ...]] = {
        NAMES[0]: (response_surface,),
        NAMES[1]: (observed_against_predicted,),
        NAMES[2]: (residuals, normal_quantiles),
    }
    for name, panels in rows.items():
        _save(_compose(laws, panels, banner), folder / name)
    return NAMES


def draw_posteriors(posteriors: Sequence[Posterior], folder: Path, banner: str = "") -> None:
    """Write four pictures of each posterior: marginals with priors, pairs, predictive by edge, curves with bands."""
    for post in posteriors:
        name = "".join(letter if letter.isalnum() else "-" for letter in post.response)
        for what in ("marginals", "pairs", "predictive", "curves"):
            drawn = post.plot(what, banner=banner)
            first: Any = drawn if isinstance(drawn, Axes) else drawn.flat[0]
            figure = first.get_figure()
            if isinstance(figure, Figure):
                _save(figure, folder / f"posterior_{name}_{what}.png")


def _compose(laws: Sequence[LawFit], panels: Sequence[Panel], banner: str) -> Figure:
    """One column for each law, at most four in a row; the kinds of panel below each other."""
    blocks = -(-len(laws) // 4)
    across = -(-len(laws) // blocks)
    down = blocks * len(panels)
    width, height = 3.7 * across, 3.4 * down
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    figure.subplots_adjust(
        left=0.75 / width, right=1 - 0.25 / width, bottom=0.6 / height, top=1 - 0.65 / height, wspace=0.36,
        hspace=0.42,
    )  # fmt: skip
    grid = figure.add_gridspec(down, across)
    for i, law in enumerate(laws):
        for k, panel in enumerate(panels):
            ax = figure.add_subplot(grid[i // across * len(panels) + k, i % across])
            ax.tick_params(labelsize=8)
            ax.xaxis.set_major_locator(MaxNLocator(5))
            ax.yaxis.set_major_locator(MaxNLocator(5))
            panel(law, ax)
    if banner:
        figure.text(0.995, 0.995, banner, ha="right", va="top", fontsize=8, color="#a33", wrap=True)
    return figure


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=110, metadata={"Software": None})


def draw_dynamics(found: "Identification", folder: Path, caption: str = "") -> None:
    """Write them into ``folder``; ``caption`` is printed on each."""
    from ..ident import frequency_response
    from ..ident.figures import bode, order_map, residual_correlations, simulated_fit

    folder.mkdir(parents=True, exist_ok=True)
    axes = {
        "simulated": simulated_fit(found.validation),
        "bode": bode(found.model, frequency_response(found.record))[0],
        "residuals": residual_correlations(found.validation)[0],
        "orders": order_map(found.one_step),
    }
    for name, ax in axes.items():
        figure = ax.get_figure()
        if figure is None:
            continue
        if caption:
            figure.text(0.99, 0.005, caption, ha="right", va="bottom", fontsize=7, color="0.4")
        figure.savefig(folder / f"{name}.png", dpi=110)  # type: ignore[union-attr]
