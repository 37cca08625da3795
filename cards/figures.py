"""Figures in the folder of a card: laws as panels, posteriors, and an identification."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..fit import LawFit, NotAvailable
from ..fit.available import computed
from ..fit.bayes.posterior import Posterior
from ..fit.form_comparison import FormComparison
from ..fit.law_figures import form_curves, normal_quantiles, observed_against_predicted, residuals, response_surface

if TYPE_CHECKING:
    from ..ident.identification import Identification
    from ..ident.physical_models.drive import DriveFit
    from ..ident.physical_models.force_process import ForceProcess
    from ..ident.physical_models.step_response import StepFit

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


def form_panels(comparisons: Sequence[FormComparison]) -> Figure:
    """Forms of each law over each of its factors: a row of panels for each law."""
    across = max(len(found.preferred.law.factors) for found in comparisons)
    figure = Figure(figsize=(4.6 * across, 3.9 * len(comparisons)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(comparisons), across, squeeze=False)
    for found, row in zip(comparisons, axes, strict=True):
        names = found.preferred.law.factors
        for j, ax in enumerate(row):
            if j < len(names):
                form_curves(found, names[j], ax)
            else:
                ax.set_axis_off()
    return figure


def draw_posteriors(posteriors: Sequence[Posterior], folder: Path, banner: str = "") -> None:
    """Write four pictures of each posterior: marginals with priors, pairs, predictive by edge, curves with bands."""
    for post in posteriors:
        name = "".join(letter if letter.isalnum() else "-" for letter in post.response)
        for what in ("marginals", "pairs", "predictive", "curves"):
            path = folder / f"posterior_{name}_{what}.png"
            drawn = computed(partial(post.plot, what, banner=banner))
            if isinstance(drawn, NotAvailable):
                _save_note(f"{what} of {post.response}: not drawn, as {drawn}", path)
                continue
            first: Any = drawn if isinstance(drawn, Axes) else drawn.flat[0]
            figure = first.get_figure()
            if isinstance(figure, Figure):
                _save(figure, path)


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
            _drawn(panel, law, ax)
    if banner:
        figure.text(0.995, 0.995, banner, ha="right", va="top", fontsize=8, color="#a33", wrap=True)
    return figure


def _drawn(panel: Panel, law: LawFit, ax: Axes) -> None:
    """Draw a panel; on one that fails, the reason."""
    found = computed(partial(panel, law, ax))
    if isinstance(found, NotAvailable):
        ax.clear()
        _note(ax, f"{law.response}: not drawn, as {found}")


def _note(ax: Axes, words: str) -> None:
    ax.text(0.5, 0.5, "\n".join(wrap(words, 40)), ha="center", va="center", fontsize=8, transform=ax.transAxes)
    ax.set_axis_off()


def _save(figure: Figure, path: Path) -> None:
    """Write a figure; where it cannot be rendered, a figure with the reason."""
    found = computed(partial(figure.savefig, path, dpi=110, metadata={"Software": None}))
    if isinstance(found, NotAvailable):
        _save_note(f"{path.stem}: not drawn, as {found}", path)


def _save_note(words: str, path: Path) -> None:
    instead = Figure(figsize=(5.0, 2.0))
    FigureCanvasAgg(instead)
    _note(instead.add_subplot(), words)
    instead.savefig(path, dpi=110, metadata={"Software": None})


def draw_dynamics(found: "Identification", folder: Path, caption: str = "") -> None:
    """Write them into ``folder``; ``caption`` is printed on each."""
    from ..ident import frequency_response
    from ..ident.figures import (
        bode,
        poles_and_zeros,
        residual_correlations,
        simulation_and_residuals,
        step_figure,
        structure_chart,
    )

    folder.mkdir(parents=True, exist_ok=True)
    panels: dict[str, Callable[[], Axes]] = {
        "simulated": lambda: simulation_and_residuals(found.validation, found.validated_on.split(",")[0])[0],
        "bode": lambda: bode(found.model, frequency_response(found.record))[0],
        "residuals": lambda: residual_correlations(found.validation)[0],
        "step": lambda: step_figure(found.model),
        "poles_zeros": lambda: poles_and_zeros(found.model),
        "structure": lambda: structure_chart(found)[0],
    }
    for name, draw in panels.items():
        _draw_one(draw, folder / f"{name}.png", caption)


def draw_physical(fit: "StepFit | DriveFit | ForceProcess", folder: Path, caption: str = "") -> Path:
    """Write the figure of a physical model into ``folder`` and return its path; ``caption`` is printed on it."""
    names = {"StepFit": "step_response", "DriveFit": "drive", "ForceProcess": "force_process"}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{names[type(fit).__name__]}.png"
    _draw_one(fit.plot, path, caption)
    return path


def _draw_one(draw: Callable[[], Axes], path: Path, caption: str) -> None:
    """Draw and write one figure; where that fails, one with the reason."""
    ax = computed(draw)
    if isinstance(ax, NotAvailable):
        _save_note(f"{path.stem}: not drawn, as {ax}", path)
        return
    figure = ax.get_figure()
    if not isinstance(figure, Figure):
        return
    if caption:
        figure.text(0.99, 0.005, caption, ha="right", va="bottom", fontsize=7, color="0.4")
    _save(figure, path)
