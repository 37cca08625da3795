"""Figures of the results of this package, registered with `plot`; panels of one law in ``law_figures``."""

from collections.abc import Iterable, Mapping, Sequence
from functools import wraps
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ..core.display import Drawing, figures_of, plot
from ..core.errors import FitError
from ..core.figure_style import BLUE, GREY, LINE, ORANGE, RED, SERIES, SMALL, THICK, THIN, new_axes
from ..core.plotting import whiskers
from .available import NotAvailable
from .bootstrap import EdgeBootstrap
from .checks.check import LEVELS, TITLES, Check
from .checks.competing_models import CompetingModels
from .checks.gauge_error import GaugeFit
from .checks.judgement import Judgement, judge
from .checks.response_scale import ErrorStructure
from .checks.robust_fit import RobustFit
from .checks.time_exponent import CommonExponent
from .composite_law import Composite
from .confirmation import Confirmation
from .edges import EdgeInference
from .form_comparison import FormComparison, predictions_over
from .law_figures import normal_quantiles, observed_against_predicted, residuals, residuals_by_edge
from .lawfit import LawFit
from .least_squares import LinearFit
from .life import ToolLife
from .profile_figures import contours, interactions, profile
from .published import PublishedComparison
from .region import DesignRegion
from .surface.canonical import CanonicalAnalysis
from .surface.surfaces import ResponseSurface

TWO = 2.0  # standard errors to each side, without a better interval


def coefficients(
    names: Sequence[str], values: Iterable[float], errors: Iterable[float], ax: Axes | None = None, title: str = ""
) -> Axes:
    """Each coefficient with two standard errors."""
    rows = {n: (v, v - TWO * s, v + TWO * s) for n, v, s in zip(names, values, errors, strict=True)}
    return whiskers(_without_constant(rows), ax, label="estimate ± 2 standard errors", title=title)


def intervals(table: pd.DataFrame, value: str, ax: Axes | None = None, title: str = "") -> Axes:
    """Rows of a table with ``low`` and ``high`` about one of its columns."""
    rows = {str(name): (row[value], row["low"], row["high"]) for name, row in table.iterrows()}
    return whiskers(_without_constant(rows), ax, label="95 % interval", title=title)


def _without_constant(rows: dict[str, tuple[float, float, float]]) -> dict[str, tuple[float, float, float]]:
    """Rows without the logarithm of the constant, whose range would hide those of the exponents."""
    return {name: row for name, row in rows.items() if "ln " not in name} or rows


@plot.register
def checks_figure(found: Judgement, ax: Axes | None = None) -> Axes:
    """Each check at its level; checks that are not available are hollow."""
    checks = found.checks
    ax = new_axes(ax, 4.8, 1.1 + 0.3 * len(checks))
    for at, check in enumerate(checks.values()):
        known, level = isinstance(check, Check), check.concern if isinstance(check, Check) else 0
        ax.plot([level], [at], "o", ms=7, color=(BLUE, ORANGE, RED)[min(level, 2)] if known else GREY,
                mfc=None if known else "none")  # fmt: skip
    ax.set_yticks(range(len(checks)), [TITLES[name] for name in checks])
    ax.set_xticks([0, 1, 2], LEVELS)
    ax.set(xlim=(-0.4, 2.4), ylim=(len(checks) - 0.5, -0.5))
    ax.grid(axis="y", color="0.9", lw=THIN)
    ax.set_title("hollow: not testable with these data", fontsize=SMALL)
    return ax


@plot.register
def confirmation_figure(found: Confirmation, ax: Axes | None = None) -> Axes:
    """New rows and their prediction intervals, in the order of the prediction."""
    ax, rows = new_axes(ax), found.rows
    order = np.argsort(rows["predicted"].to_numpy())
    value, low, high, seen = (rows[name].to_numpy()[order] for name in ("predicted", "low", "high", "observed"))
    inside = rows["inside"].to_numpy()[order]
    x = np.arange(len(rows))
    ax.vlines(x, low, high, color=BLUE, lw=LINE, alpha=0.6, label=f"{100 * found.level:g} % prediction")
    ax.plot(x, value, "_", color=BLUE, ms=5)
    ax.plot(x[inside], seen[inside], "o", ms=4, color=BLUE, label="measured")
    ax.plot(x[~inside], seen[~inside], "o", ms=4, color=ORANGE, label="outside")
    ax.set(xlabel="new row, in the order of its prediction", ylabel=found.response)
    ax.legend()
    return ax


@plot.register
def influence_of_edges_figure(edges: EdgeInference, ax: Axes | None = None) -> Axes:
    """Change of each parameter without one edge, in its standard errors."""
    ax = new_axes(ax, 4.8, 3.6)
    share = edges.moved / edges.bse.to_numpy()
    for j in range(share.shape[1]):
        ax.plot(np.full(len(share), j), share[:, j], "o", ms=4, mfc="none", color=BLUE)
    ax.axhline(0, color=GREY, lw=THIN)
    ax.set_xticks(range(len(edges.names)), list(edges.names))
    ax.set(ylabel="change without one edge [standard errors]", title=f"{edges.n_edges} edges")
    return ax


@plot.register
def time_exponents_figure(found: CommonExponent, ax: Axes | None = None) -> Axes:
    """The time exponent of each edge, and the common one."""
    ax = whiskers({str(edge): (float(v), np.nan, np.nan) for edge, v in found.exponents.items()}, ax)
    ax.axvline(found.common, color=ORANGE, lw=LINE)
    ax.set(xlabel=f"exponent of t in {found.response}; line: common to all", ylabel="edge")
    return ax


@plot.register
def error_structure_figure(found: ErrorStructure, ax: Axes | None = None) -> Axes:
    """Log-likelihood with multiplicative errors less that with additive errors."""
    half = TWO * (found.standard_error or np.nan)
    rows = {"multiplicative - additive": (found.statistic, found.statistic - half, found.statistic + half)}
    return whiskers(rows, ax, label="log-likelihood, ± 2 standard errors", title=f"{found.response}: {found.preferred}")


@plot.register
def competing_models_figure(found: CompetingModels, ax: Axes | None = None) -> Axes:
    """Prediction error of each competing model on left-out units, less that of the power law."""
    rows = {form.name: (form.difference, form.difference - form.standard_error, form.difference + form.standard_error)
            for form in found.alternatives}  # fmt: skip
    ax = whiskers(rows, ax, label="error less that of the power law, ± 1 standard error", title=found.response)
    ax.axvline(0, color=GREY, lw=THIN)
    return ax


@plot.register
def form_comparison_figure(found: FormComparison, ax: Axes | None = None, *, factor: str | None = None) -> Axes:
    """Prediction of each form over a factor, the others at the middle, inside and somewhat beyond the tested range."""
    return form_curves(found, factor, ax)


@plot.register
def domain_figure(domain: DesignRegion, ax: Axes | None = None) -> Axes:
    """Tested range of each factor, as multiples of its middle."""
    rows = {}
    logs = np.broadcast_to(domain.logs, len(domain.factors))
    for name, unit, centre, half, log in zip(
        domain.factors, domain.units, domain.centre, domain.half_range, logs, strict=True
    ):
        middle = float(np.exp(centre)) if log else centre
        ends = np.exp([-half, half]) if log else 1 + np.array([-half, half]) / (centre or 1.0)
        rows[f"{name}, {middle:.3g} {unit}"] = (1.0, float(ends[0]), float(ends[1]))
    label = "times the middle of the tests"
    return whiskers(rows, ax, label=label, title=domain.response)


@plot.register
def tool_life_figure(life: ToolLife, ax: Axes | None = None) -> Axes:
    """Life over each factor in turn from half to twice its middle, the others held there."""
    ax = new_axes(ax)
    for name, middle in life.typical_at.items():
        x = np.geomspace(0.5, 2.0, 60)
        ax.plot(x, [life.values({**life.typical_at, name: middle * k}) for k in x], label=f"{name}, {middle:.3g}")
    ax.axhline(life.t_observed, color=GREY, ls="--", lw=THIN, label="longest test")
    ax.set(xscale="log", yscale="log", xlabel="times the middle of the tests")
    ax.set_ylabel(f"life to {life.wear} {life.criterion:g} {life.unit_of_wear} [{life.unit}]")
    ax.set_xticks([0.5, 1, 2], ["0.5", "1", "2"])
    ax.set_xticks([], minor=True)
    ax.legend()
    return ax


@plot.register
def published_figure(found: PublishedComparison, ax: Axes | None = None) -> Axes:
    """The published exponents."""
    exponents = {name: (v, np.nan, np.nan) for name, v in list(found.coefficients.items())[1:]}
    return whiskers(exponents, ax, label="published exponent", title=found.source)


@plot.register
def law_figure(law: LawFit, ax: Axes | None = None) -> Axes:
    """Observed values against predicted ones; without rows each parameter with two standard errors."""
    if law.rows is None:
        return coefficients(law.theta_names[1:], law.theta[1:], law.bse.to_numpy()[1:], ax)
    return observed_against_predicted(law, ax)


@plot.register
def linear_figure(fit: LinearFit, ax: Axes | None = None) -> Axes:
    """Each coefficient with two standard errors."""
    return coefficients([f"x{j}" for j in range(len(fit.params))], fit.params, fit.bse, ax)


@plot.register
def composite_figure(found: Composite, ax: Axes | None = None) -> Axes:
    """Each parameter with two standard errors."""
    return coefficients(found.names, found.theta, found.bse, ax)


@plot.register(RobustFit)
@plot.register(GaugeFit)
def refit_figure(found: RobustFit | GaugeFit, ax: Axes | None = None) -> Axes:
    """Each parameter of the refit with two standard errors."""
    return coefficients(found.law.theta_names, found.theta, found.bse, ax)


@plot.register
def bootstrap_figure(found: EdgeBootstrap, ax: Axes | None = None) -> Axes:
    """Mean and 95 % interval of each parameter over the refits."""
    return intervals(found.interval().assign(mean=found.draws.mean(axis=0)), "mean", ax)


@plot.register
def surface_figure(found: ResponseSurface, ax: Axes | None = None, over: tuple[str, str] | None = None) -> Axes:
    """Contours over two factors inside the tested region, the others at the middle of their ranges.

    ``over`` names the two; by default the first two of the canonical analysis, else of the law.
    """
    canonical = found.canonical()
    own = canonical.factors if isinstance(canonical, CanonicalAnalysis) and len(canonical.factors) > 1 else ()
    return contours(found.law, ax, over=over or ((own[0], own[1]) if own else None))


@plot.register
def canonical_figure(found: CanonicalAnalysis, ax: Axes | None = None) -> Axes:
    """Ridge paths: lowest and highest response at each coded distance, points outside the tests hollow."""
    ax = new_axes(ax)
    for side, color in (("lowest", BLUE), ("highest", ORANGE)):
        path = found.paths[found.paths["side"] == side]
        inside = path["inside"].to_numpy(dtype=bool)
        ax.plot(path["radius"], path[found.response], color=color, lw=LINE, label=side)
        ax.plot(path["radius"][inside], path[found.response][inside], "o", ms=4, color=color)
        ax.plot(path["radius"][~inside], path[found.response][~inside], "o", ms=4, mfc="none", color=color)
    ax.set(xlabel="coded distance from the middle of the ranges", ylabel=f"{found.response} [{found.unit}]")
    ax.legend()
    return ax


def coefficients_figure(law: LawFit, ax: Axes | None = None) -> Axes:
    """Each coefficient but the constant with two standard errors."""
    return coefficients(law.theta_names[1:], law.theta[1:], law.bse.to_numpy()[1:], ax, law.response)


def influence_figure(law: LawFit, ax: Axes | None = None) -> Axes:
    """Change of each parameter without one edge, in its standard errors."""
    if isinstance(law.edges, NotAvailable):
        raise FitError(f"{law.response}: no figure of the influence of edges: {law.edges}.")
    return influence_of_edges_figure(law.edges, ax)


def judged_figure(law: LawFit, ax: Axes | None = None) -> Axes:
    """Each check of the law at its level; they are computed for the figure."""
    return checks_figure(judge(law), ax)


KINDS: Mapping[str, Drawing] = {
    "observed": law_figure,
    "residuals": residuals,
    "edges": residuals_by_edge,
    "quantiles": normal_quantiles,
    "profile": profile,
    "contours": contours,
    "interactions": interactions,
    "coefficients": coefficients_figure,
    "influence": influence_figure,
    "checks": judged_figure,
}


@figures_of.register
def kinds_of_law(law: LawFit) -> Mapping[str, Drawing]:
    """Figures of a law by kind."""
    return KINDS


@figures_of.register
def kinds_of_surface(found: ResponseSurface) -> Mapping[str, Drawing]:
    """Figures of a response surface by kind: its own, and those of its law."""
    own = {"contours": surface_figure, "canonical": _canonical}
    return own | {kind: _of_its_law(draw) for kind, draw in KINDS.items() if kind not in own}


def _canonical(found: ResponseSurface, ax: Axes | None = None) -> Axes:
    canonical = found.canonical()
    if isinstance(canonical, NotAvailable):
        raise FitError(f"{found.law.response}: no canonical analysis: {canonical}.")
    return canonical_figure(canonical, ax)


def _of_its_law(draw: Drawing) -> Drawing:
    """A figure of a law, of the law of a surface; its options are those of the figure."""

    @wraps(draw)
    def drawn(found: ResponseSurface, *args: Any, **options: Any) -> Any:  # noqa: ANN401
        return draw(found.law, *args, **options)

    return drawn


def form_curves(found: FormComparison, factor: str | None = None, ax: Axes | None = None) -> Axes:
    """Prediction of each form over a factor, the others at the middle, inside and somewhat beyond the tested range.

    ``factor`` is by default the one over which the forms differ most. Dots are the rows, moved to the middle of the
    other factors along the preferred form.
    """
    ax = new_axes(ax, 5.6, 4.2)
    drawn = predictions_over(found, factor)
    low, high = drawn.tested
    ax.axvspan(low, high, color="0.94", lw=0, zorder=0)
    ax.plot(drawn.rows_x, drawn.rows_y, "o", ms=3.5, color=GREY, mfc="none", label="measured, moved to the middle")
    others = SERIES[1:]
    for i, (name, values) in enumerate(drawn.predicted.items()):
        first = name == found.preferred.name
        ax.plot(drawn.x, values, color=BLUE if first else others[i % len(others)], lw=THICK if first else LINE,
                ls="-" if first else ("--", "-.", ":")[i % 3], label=name, zorder=3 if first else 2)  # fmt: skip
    seen = np.concatenate([drawn.rows_y, *drawn.predicted.values()])
    limit = 2.5 * float(np.nanmax(drawn.rows_y)) if len(drawn.rows_y) else np.inf
    ax.set_ylim(min(0.0, float(np.nanmin(seen))), min(1.05 * float(np.nanmax(seen)), limit))
    ax.set(xlabel=drawn.label, ylabel=f"{found.response} [{found.unit}]" if found.unit else found.response)
    ax.set_title(f"{drawn.others}\nshaded: tested range", fontsize=SMALL)
    ax.legend()
    return ax
