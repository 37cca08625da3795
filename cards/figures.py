"""Figures in the folder of a card: laws as panels, posteriors, and an identification."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from ..core.figure_style import (
    DPI,
    LEGEND_GAP,
    RED,
    SMALL,
    Limit,
    Styles,
)
from ..core.panels import Box, PanelAxes, draw_keys
from ..core.pens import PngPen, Words
from ..fit import LawFit, NotAvailable
from ..fit.available import computed
from ..fit.law_figures import (
    identified,
    normal_quantiles,
    observed_against_predicted,
    residuals,
    residuals_by_edge,
    response_surface,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..fit.bayes.posterior import Posterior
    from ..fit.form_comparison import FormComparison
    from ..ident.identification import Identification
    from ..ident.physical_models.drive import DriveFit
    from ..ident.physical_models.force_process import ForceProcess
    from ..ident.physical_models.step_response import StepFit

NAMES = ("response_surfaces.png", "observed_predicted.png", "residuals.png")
WIDE, TALL = 252.0, 238.0  # pt of a panel; two side by side are read on a phone
LEFT, RIGHT, TOP, BOTTOM = 52.0, 14.0, 54.0, 40.0  # pt, margins of all panels
BETWEEN, BELOW = 0.33, 0.52  # of a panel, from one to the next and to that below
Panel = Callable[[LawFit, Any], object]


def draw_figures(
    laws: Sequence[LawFit], folder: Path, banner: str = "", limits: Mapping[str, Limit] | None = None
) -> tuple[str, ...]:
    """Write the three figures to ``folder`` and return their names.

    ``banner`` is drawn over each of them; ``limits`` of responses are drawn in surfaces and observed values.
    """
    folder.mkdir(parents=True, exist_ok=True)
    limits, styles = limits or {}, identified(laws)
    surfaces: list[list[Panel]] = [[partial(_surface, limits=limits)]]
    observed: list[list[Panel]] = [[partial(_observed, styles=styles, limits=limits)]]
    pair: list[list[Panel]] = [[partial(residuals, styles=styles), normal_quantiles]]
    by_edge: list[list[Panel]] = [[partial(residuals_by_edge, styles=styles)]] if styles else []
    for name, rows, keys in zip(NAMES, (surfaces, observed, [*by_edge, *pair]), ({}, styles, {}), strict=True):
        _compose(laws, rows, banner, keys).save(folder / name)
    return NAMES


def _surface(law: LawFit, ax: Any, limits: Mapping[str, Limit]) -> object:  # noqa: ANN401  PanelAxes
    return response_surface(law, ax, limit=limits.get(law.response))


def _observed(law: LawFit, ax: Any, styles: Styles, limits: Mapping[str, Limit]) -> object:  # noqa: ANN401  PanelAxes
    return observed_against_predicted(law, ax, styles=styles, limit=limits.get(law.response))


def form_panels(comparisons: "Sequence[FormComparison]") -> "Figure":
    """Forms of each law over each of its factors: a row of panels for each law."""
    from ..core.plotting import NotebookFigure
    from ..fit.figures import form_curves

    across = max(len(found.preferred.law.factors) for found in comparisons)
    figure = NotebookFigure(figsize=(4.6 * across, 3.9 * len(comparisons)), layout="constrained")
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


def draw_posteriors(posteriors: "Sequence[Posterior]", folder: Path, banner: str = "") -> None:
    """Write four pictures of each posterior: marginals with priors, pairs, predictive by edge, curves with bands."""
    from ..core.display import draw_figure

    for post in posteriors:
        name = "".join(letter if letter.isalnum() else "-" for letter in post.response)
        for what in ("marginals", "pairs", "predictive", "curves"):
            path = folder / f"posterior_{name}_{what}.png"
            drawn = computed(partial(draw_figure, post, what, banner=banner))
            if isinstance(drawn, NotAvailable):
                _save_note(f"{what} of {post.response}: not drawn, as {drawn}", path)
                continue
            first: Any = getattr(drawn, "flat", [drawn])[0]
            _save(first.get_figure(), path)


def _compose(laws: Sequence[LawFit], rows: Sequence[Sequence[Panel]], banner: str, styles: Styles) -> PngPen:
    """Panels of each law: a single one two in a row, others as a block of rows over the whole width; legend below."""
    single = [len(row) for row in rows] == [1]
    across = min(len(laws), 2) if single else 2
    down = -(-len(laws) // across) if single else len(laws) * len(rows)
    name = 30 + 5.4 * max(map(len, styles), default=1)  # pt of one in the legend
    names_across = max(int(across * WIDE / name), 1)
    below = LEGEND_GAP * (-(-len(styles) // names_across) + 1) + 12 if styles else 0.0
    width, height = WIDE * across + 14, TALL * down + 18 + below
    pen = PngPen(width, height)
    for i, law in enumerate(laws):
        for k, row in enumerate(rows):
            for j, panel in enumerate(row):
                place = divmod(i, across) if single else (i * len(rows) + k, j)
                ax = PanelAxes(_box(width, height - below, (down, across), place, whole=not single and len(row) == 1))
                _drawn(panel, law, ax)
                ax.draw(pen)
    if styles:
        left = (width - name * min(names_across, len(styles))) / 2
        pen.words((width / 2, height - below + 4), Words("edge", SMALL, ha="center", va="center"))
        draw_keys(pen, list(styles.items()), (left, height - below + 4 + LEGEND_GAP), names_across, name)
    if banner:
        words = f"SIMULATED DATA, {banner}"
        pen.words((width - 3, 2.0), Words(words, SMALL, RED, ha="right", va="top", bold=True))
    return pen


def _box(width: float, height: float, grid: tuple[int, int], place: tuple[int, int], *, whole: bool) -> Box:
    """Left, top, width and height of a panel at a place of a grid of rows and columns, or of one of a whole row."""
    (down, across), (row, column) = grid, place
    wide = (width - LEFT - RIGHT) / (across + BETWEEN * (across - 1))
    tall = (height - TOP - BOTTOM) / (down + BELOW * (down - 1))
    left, top = LEFT + column * wide * (1 + BETWEEN), TOP + row * tall * (1 + BELOW)
    return left, top, width - LEFT - RIGHT if whole else wide, tall


def _drawn(panel: Panel, law: LawFit, ax: PanelAxes) -> None:
    """Draw a panel; on one that fails, the reason."""
    found = computed(partial(panel, law, ax))
    if isinstance(found, NotAvailable):
        ax.clear()
        _note(ax, f"{law.response}: not drawn, as {found}")


def _note(ax: PanelAxes, words: str) -> None:
    ax.text(0.5, 0.5, "\n".join(wrap(words, 40)), ha="center", va="center", fontsize=SMALL, transform=ax.transAxes)
    ax.set_axis_off()


def _save(figure: "Figure", path: Path) -> None:
    """Write a figure of matplotlib; where it cannot be rendered, one with the reason."""
    from ..core.plotting import save_figure

    found = computed(partial(save_figure, figure, path, dpi=DPI, metadata={"Software": None}))
    if isinstance(found, NotAvailable):
        _save_note(f"{path.stem}: not drawn, as {found}", path)


def _save_note(words: str, path: Path) -> None:
    pen = PngPen(360.0, 144.0)
    _note(ax := PanelAxes((45.0, 17.0, 279.0, 111.0)), words)
    ax.draw(pen)
    pen.save(path)


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
    from ..core.display import draw_figure

    names = {"StepFit": "step_response", "DriveFit": "drive", "ForceProcess": "force_process"}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{names[type(fit).__name__]}.png"
    _draw_one(partial(draw_figure, fit), path, caption)
    return path


def _draw_one(draw: "Callable[[], Axes]", path: Path, caption: str) -> None:
    """Draw and write one figure; where that fails, one with the reason."""
    from ..core.plotting import mark_simulated

    ax = computed(draw)
    if isinstance(ax, NotAvailable):
        _save_note(f"{path.stem}: not drawn, as {ax}", path)
        return
    figure: Any = ax.get_figure()
    if caption:
        mark_simulated(figure, caption)
    _save(figure, path)
