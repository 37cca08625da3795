"""Figures in the folder of a card: laws as panels, posteriors, and an identification."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..core.display import draw_figure
from ..core.figure_style import DPI, SMALL
from ..core.plotting import Limit, NotebookFigure, Styles, edge_legend, mark_simulated, save_figure
from ..fit import LawFit, NotAvailable
from ..fit.available import computed
from ..fit.bayes.posterior import Posterior
from ..fit.figures import form_curves
from ..fit.form_comparison import FormComparison
from ..fit.law_figures import (
    identified,
    normal_quantiles,
    observed_against_predicted,
    residuals,
    residuals_by_edge,
    response_surface,
)

if TYPE_CHECKING:
    from matplotlib.gridspec import SubplotSpec

    from ..ident.identification import Identification
    from ..ident.physical_models.drive import DriveFit
    from ..ident.physical_models.force_process import ForceProcess
    from ..ident.physical_models.step_response import StepFit

NAMES = ("response_surfaces.png", "observed_predicted.png", "residuals.png")
WIDE, TALL = 3.5, 3.3  # inches of a panel; two side by side are read on a phone
Panel = Callable[[LawFit, Axes], object]


def draw_figures(
    laws: Sequence[LawFit], folder: Path, banner: str = "", limits: Mapping[str, Limit] | None = None
) -> tuple[str, ...]:
    """Write the three figures to ``folder`` and return their names.

    ``banner`` is drawn over each of them; ``limits`` of responses are drawn in surfaces and observed values.
    """
    folder.mkdir(parents=True, exist_ok=True)
    limits, styles = limits or {}, identified(laws)
    surfaces = [[partial(_surface, limits=limits)]]
    observed = [[partial(_observed, styles=styles, limits=limits)]]
    _save(_compose(laws, surfaces, banner, {}), folder / NAMES[0])
    _save(_compose(laws, observed, banner, styles), folder / NAMES[1])
    pair: list[list[Panel]] = [[partial(residuals, styles=styles), normal_quantiles]]
    by_edge: list[list[Panel]] = [[partial(residuals_by_edge, styles=styles)]] if styles else []
    _save(_compose(laws, [*by_edge, *pair], banner, {}), folder / NAMES[2])
    return NAMES


def _surface(law: LawFit, ax: Axes, limits: Mapping[str, Limit]) -> object:
    return response_surface(law, ax, limit=limits.get(law.response))


def _observed(law: LawFit, ax: Axes, styles: Styles, limits: Mapping[str, Limit]) -> object:
    return observed_against_predicted(law, ax, styles=styles, limit=limits.get(law.response))


def form_panels(comparisons: Sequence[FormComparison]) -> Figure:
    """Forms of each law over each of its factors: a row of panels for each law."""
    across = max(len(found.preferred.law.factors) for found in comparisons)
    figure = NotebookFigure(figsize=(4.6 * across, 3.9 * len(comparisons)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(comparisons), across, squeeze=False)
    for found, row in zip(comparisons, axes, strict=True):
        names = found.preferred.law.factors
        for j, ax in enumerate(row):
            if j < len(names):
                legend = form_curves(found, names[j], ax).get_legend()
                if j and legend is not None:  # one for each row
                    legend.remove()
            else:
                ax.set_axis_off()
    return figure


def draw_posteriors(posteriors: Sequence[Posterior], folder: Path, banner: str = "") -> None:
    """Write four pictures of each posterior: marginals with priors, pairs, predictive by edge, curves with bands."""
    for post in posteriors:
        name = "".join(letter if letter.isalnum() else "-" for letter in post.response)
        for what in ("marginals", "pairs", "predictive", "curves"):
            path = folder / f"posterior_{name}_{what}.png"
            drawn = computed(partial(draw_figure, post, what, banner=banner))
            if isinstance(drawn, NotAvailable):
                _save_note(f"{what} of {post.response}: not drawn, as {drawn}", path)
                continue
            first: Any = drawn if isinstance(drawn, Axes) else drawn.flat[0]
            figure = first.get_figure()
            if isinstance(figure, Figure):
                _save(figure, path)


def _compose(laws: Sequence[LawFit], rows: Sequence[Sequence[Panel]], banner: str, styles: Styles) -> Figure:
    """Panels of each law: a single one two in a row, others as a block of rows over the whole width; legend below."""
    single = [len(row) for row in rows] == [1]
    across = min(len(laws), 2) if single else 2
    down = -(-len(laws) // across) if single else len(laws) * len(rows)
    names_across = max(int(across * WIDE / (0.42 + 0.075 * max(map(len, styles), default=1))), 1)
    below = 0.22 * -(-len(styles) // names_across) + 0.25 if styles else 0.0
    width, height = WIDE * across + 0.2, TALL * down + 0.25 + below
    figure = NotebookFigure(figsize=(width, height))
    FigureCanvasAgg(figure)
    figure.subplots_adjust(
        left=0.72 / width, right=1 - 0.2 / width, bottom=(0.55 + below) / height, top=1 - 0.75 / height, wspace=0.33,
        hspace=0.52,
    )  # fmt: skip
    grid = figure.add_gridspec(down, across)
    for i, law in enumerate(laws):
        for k, row in enumerate(rows):
            for j, panel in enumerate(row):
                place = grid[divmod(i, across)] if single else grid[i * len(rows) + k, j if len(row) > 1 else slice(2)]
                _drawn(panel, law, _panel(figure, place))
    if styles:
        edge_legend(figure, styles, names_across, loc="lower center")
    if banner:
        mark_simulated(figure, banner)
    return figure


def _panel(figure: Figure, place: "SubplotSpec") -> Axes:
    """Axes at a place of the grid with few ticks."""
    ax: Axes = figure.add_subplot(place)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.yaxis.set_major_locator(MaxNLocator(5))
    return ax


def _drawn(panel: Panel, law: LawFit, ax: Axes) -> None:
    """Draw a panel; on one that fails, the reason."""
    found = computed(partial(panel, law, ax))
    if isinstance(found, NotAvailable):
        ax.clear()
        _note(ax, f"{law.response}: not drawn, as {found}")


def _note(ax: Axes, words: str) -> None:
    ax.text(0.5, 0.5, "\n".join(wrap(words, 40)), ha="center", va="center", fontsize=SMALL, transform=ax.transAxes)
    ax.set_axis_off()


def _save(figure: Figure, path: Path) -> None:
    """Write a figure; where it cannot be rendered, a figure with the reason."""
    found = computed(partial(save_figure, figure, path, dpi=DPI, metadata={"Software": None}))
    if isinstance(found, NotAvailable):
        _save_note(f"{path.stem}: not drawn, as {found}", path)


def _save_note(words: str, path: Path) -> None:
    instead = NotebookFigure(figsize=(5.0, 2.0))
    FigureCanvasAgg(instead)
    _note(instead.add_subplot(), words)
    save_figure(instead, path, dpi=DPI, metadata={"Software": None})


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
    _draw_one(partial(draw_figure, fit), path, caption)
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
        mark_simulated(figure, caption)
    _save(figure, path)
