"""Figures of posteriors and priors, registered with `plot`: marginals, pairs, predictive bands, curves."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from math import inf, lgamma, log, sqrt

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, MaxNLocator

from ...core.arrays import Array, Texts
from ...core.display import Drawing, figures_of, plot
from ...core.errors import UsageError
from ...core.figure_style import BLUE, GREY, LINE, ORANGE, SMALL, THIN
from ...core.plotting import whiskers
from ...core.suggestions import did_you_mean
from ...datasets.runs import NOT_MEASURED
from ..edges import EdgeInference
from ..figures import intervals
from ..law_figures import even
from .competing_posterior import CompetingPosterior
from .density import NU
from .joint_posterior import JointPosterior
from .panels import MOST_PANELS, WHOLE, Sheet, alone, curves, laid_out, predictive
from .posterior import Posterior
from .priors import Beta, HalfT, Normal, Priors, units_of_priors

MOST_PAIRED = 9  # parameters: 36 panels
PAIRED = 1000  # draws in a panel of pairs: more overlap
BOUNDS = {"sd": (0.0, inf), "icc": (0.0, 1.0), "nu": (0.0, inf)}
STRONG = 0.7  # correlation that is marked


def marginals(posterior: Posterior) -> Sheet:
    """Each parameter with its prior."""
    names = posterior.names[:MOST_PANELS]
    some = f", the first {len(names)} of {len(posterior.names)}" if len(names) < len(posterior.names) else ""
    title = f"{posterior.response}: parameters{some}; {posterior.method} draws, priors {posterior.priors.name}"
    panels = [partial(_marginal, posterior, name) for name in names]
    return Sheet(title, panels, min(4, len(names)), (2.7, 2.3), (0.42, 0.45))


def _marginal(posterior: Posterior, name: str, ax: Axes) -> None:
    """Draws of one parameter, with the prior density on the same scale."""
    x = posterior.draws[:, posterior.names.index(name)]
    low, high = np.quantile(x, WHOLE)
    shown = x[(x >= low - (high - low)) & (x <= high + (high - low))]
    density, edges = np.histogram(shown, bins=35, density=True)
    ax.stairs(density, edges, fill=True, color=BLUE, alpha=0.35, label="draws")
    for i, end in enumerate((low, high)):
        ax.axvline(end, color=GREY, lw=THIN, ls="--", label="" if i else "95 % interval")
    estimate = _estimates(posterior).get(name)
    if estimate is not None:
        ax.axvline(estimate, color=ORANGE, lw=LINE, label="least squares")
    ends = ax.get_xlim()
    bounds = BOUNDS.get(name, ends)
    grid = np.linspace(max(ends[0], bounds[0]), min(ends[1], bounds[1]), 200)
    prior = _prior(posterior, name, grid)
    if prior is not None:
        ax.plot(grid, prior, color="black", lw=THIN, label="prior")
    unit = _unit(posterior, name)
    highest = 0.0 if prior is None else min(prior.max(), 2 * density.max())
    ax.set(xlim=(grid[0], grid[-1]), ylim=(0, 1.12 * max(density.max(), highest)))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_major_formatter("{x:.7g}")
    ax.set_xlabel(f"{_described(posterior, name)} [{unit}]")
    ax.set_ylabel(f"density [{_inverse(unit)}]")


def _described(posterior: Posterior, name: str) -> str:
    """A parameter's name, with an explanation of symbols."""
    exponent = posterior.law.form == "power" and name in posterior.law.factors
    words = {"sd": "scatter sd", "icc": "intraclass correlation icc", "nu": "degrees of freedom nu"}
    return f"exponent of {name}" if exponent else words.get(name, name)


def _unit(posterior: Posterior, name: str) -> str:
    return units_of_priors(posterior.law).get("level" if name == posterior.names[0] else name, "1") or "1"


def _inverse(unit: str) -> str:
    if unit.startswith("1/"):
        return unit.removeprefix("1/").strip("()")
    return "1" if unit == "1" else f"1/({unit})" if "/" in unit else f"1/{unit}"


def _estimates(posterior: Posterior) -> dict[str, float]:
    """Estimates of the same parameters by least squares, and by the mixed model by edge."""
    law = posterior.law
    known = dict(zip(law.theta_names, map(float, law.theta), strict=True))
    if posterior.errors == "student":  # its sd is another parameter
        return known
    if not posterior.density.edges:
        return known | ({} if law.scale_se is None else {"sd": law.scale_se})
    if isinstance(law.edges, EdgeInference):
        known |= {"sd": law.edges.mixed.sd_within, "icc": law.edges.icc}
    return known


def _prior(posterior: Posterior, name: str, x: Array) -> Array | None:
    """Prior density of a parameter; None where it is flat, or has no density in closed form."""
    if name == "nu":
        a, b = NU
        at = np.maximum(x, 1e-300)
        return np.where(x > 0, np.exp(a * log(b) - lgamma(a) + (a - 1) * np.log(at) - b * at), 0.0)
    prior = _of_constant(posterior) if name == posterior.names[0] else posterior.priors.of.get(name)
    match prior:
        case Normal():
            return np.exp(prior.log_density(x))
        case HalfT():
            return np.where(x > 0, np.exp(prior.log_density(x)), 0.0)
        case Beta():
            inside = (x > 0) & (x < 1)
            return np.where(inside, np.exp(prior.log_density(np.where(inside, x, 0.5))), 0.0)
    return None


def _of_constant(posterior: Posterior) -> Normal | None:
    """Prior of the constant, which follows from those of the level at the middle of the tests and of the slopes."""
    of, names = posterior.priors.of, ("level", *posterior.law.theta_names[1:])
    step = np.concatenate([[1.0], -posterior.density.centre[1:]])
    normal = [prior for prior in (of[name] for name in names) if isinstance(prior, Normal)]
    if len(normal) < len(names):
        return None
    return Normal(
        float(step @ [prior.mean for prior in normal]), sqrt(sum((step * [prior.sd for prior in normal]) ** 2))
    )


def pairs(posterior: Posterior) -> Sheet:
    """Each pair of parameters with its correlation; of many parameters the most correlated ones."""
    r: Array = np.asarray(np.corrcoef(posterior.draws.T))
    q = len(r)
    strongest = np.argsort(-np.sort(np.abs(np.nan_to_num(r)), axis=1)[:, -2], kind="stable")[:MOST_PAIRED]
    kept = np.sort(strongest)
    some = f", the {len(kept)} of {q} most correlated" if len(kept) < q else ""
    title = f"{posterior.response}: pairs of parameters{some}, with their correlation; {posterior.method} draws"
    panels = [partial(_pair, posterior, j, i, r[i, j]) if j < i else None for i in kept[1:] for j in kept[:-1]]
    across = len(kept) - 1
    side = min(2.0, max(1.15, 7.5 / across))
    return Sheet(title, panels, across, (side, side), (0.08, 0.08), shared=True)


def _pair(posterior: Posterior, i: int, j: int, r: float, ax: Axes) -> None:
    shown = posterior.draws[:: -(-len(posterior.draws) // PAIRED)]
    ax.plot(shown[:, i], shown[:, j], "o", ms=1.6, color=BLUE, alpha=0.3, mew=0)
    ax.text(
        0.04, 0.96, f"{r:z.2f}".replace("-", "−"), va="top", fontsize=SMALL,
        color=ORANGE if abs(r) > STRONG else "black",
        bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.5}, transform=ax.transAxes,
    )  # fmt: skip
    for axis, column in ((ax.xaxis, i), (ax.yaxis, j)):
        axis.set_major_locator(FixedLocator(_inner_ticks(*axis.get_view_interval())))
        axis.set_major_formatter("{x:.7g}")
        axis.set_label_text(f"{posterior.names[column]} [{_unit(posterior, posterior.names[column])}]", fontsize=SMALL)
    ax.tick_params(labelsize=SMALL)


def _inner_ticks(low: float, high: float) -> list[float]:
    """Two or three round numbers well inside, so that those of the next panel do not meet them."""
    low, high = low + 0.14 * (high - low), high - 0.14 * (high - low)
    for n in (2, 3, 4, 5):
        ticks = [float(v) for v in MaxNLocator(n).tick_values(low, high) if low <= v <= high]
        if len(ticks) > 1:
            break
    return ticks


SHEETS: dict[str, Callable[[Posterior], Sheet]] = {
    "marginals": marginals,
    "pairs": pairs,
    "predictive": predictive,
    "curves": curves,
}


@plot.register
def posterior_figure(
    posterior: Posterior, ax: Axes | None = None, *, kind: str = "marginals", banner: str = ""
) -> Axes | Texts:
    """Marginals, pairs of parameters, predictive bands by edge, or curves along the factors.

    Parameters
    ----------
    posterior : Posterior
    ax : Axes, optional
        Axes to draw on; only for figures of one panel: curves of one factor, or the predictive of rows without edges.
    kind : {"marginals", "pairs", "predictive", "curves"}
        Each parameter with its prior; each pair of parameters; rows of each edge in the band of a row of a new edge;
        the law along each factor, the others at the middle of their range and the rows moved there along the law.
    banner : str
        Text above the figure, for instance ``not measured``; by default the note that the data are simulated.

    Returns
    -------
    Axes, or ndarray of Axes in reading order where there are several panels.

    Raises
    ------
    UsageError
        An unknown figure, or several panels for one ``ax``.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> [ax.get_xlabel() for ax in posterior_figure(fit.posterior(law), kind="curves")]
    ['V [m/min]', 'f [mm/rev]', 'd [mm]', 't [min]']
    """
    if kind not in SHEETS:
        raise UsageError(f"Posterior: no figure of kind {kind!r}. {did_you_mean(kind, SHEETS, names='There are ')}")
    sheet = SHEETS[kind](replace(posterior, draws=posterior.draws[even(len(posterior.draws))]))
    if ax is not None and len(sheet.panels) > 1:
        n = sum(panel is not None for panel in sheet.panels)
        raise UsageError(f"{kind} of {posterior.response} has {n} panels, and ax is one: omit ax.")
    text = banner or _not_measured(posterior)
    axes = laid_out(sheet, text) if ax is None else alone(sheet, text, ax)
    return axes if len(axes) > 1 else axes[0]


@figures_of.register
def kinds_of_posterior(posterior: Posterior) -> Mapping[str, Drawing]:
    """Figures of a posterior by kind."""
    return {kind: partial(posterior_figure, kind=kind) for kind in SHEETS}


def _not_measured(posterior: Posterior) -> str:
    """The note of law or posterior that the data were not measured; empty where they were."""
    notes = (*posterior.law.notes, *posterior.notes)
    return next((note.split(";")[0] for note in notes if any(word in note.lower() for word in NOT_MEASURED)), "")


@plot.register(JointPosterior)
@plot.register(CompetingPosterior)
def intervals_figure(posterior: JointPosterior | CompetingPosterior, ax: Axes | None = None) -> Axes:
    """Mean and 95 % interval of each parameter."""
    return intervals(posterior.table(), "mean", ax)


@plot.register
def priors_figure(priors: Priors, ax: Axes | None = None) -> Axes:
    """Central 95 % of each proper prior, from draws, as that serves every distribution."""
    rows = {}
    for name, prior in priors.of.items():
        if prior.name != "flat":
            low, middle, high = np.quantile(prior.draw(np.random.default_rng(1), 20_000), [0.025, 0.5, 0.975])
            rows[name] = (float(middle), float(low), float(high))
    return whiskers(rows, ax, label="central 95 % of the prior")
