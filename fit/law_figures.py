"""Panels of one law on given axes; the figures of other results are in ``figures`` and ``bayes/figures``."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.arrays import Array, Flags, Ints
from ..core.censored import LifeDistribution, standard_quantile
from ..core.figure_style import (
    BLUE,
    DOT,
    FILL,
    GREY,
    INK,
    LINE,
    ORANGE,
    RED,
    SMALL,
    THICK,
    THIN,
    Limit,
    Styles,
    contour_levels,
    draw_limit,
    edge_legend,
    edge_styles,
    natural_key,
    new_axes,
    plain_ticks,
    rim,
    shades,
    short_names,
    titled,
)  # fmt: skip
from .lawfit import LawFit
from .rows import reference_level

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROUNDING = 1e-24  # of the sum of squares: residuals of 1e-12, what is left of an exact law in double precision
MOST = 4000  # points in one panel: more are slow to draw and overlap
AROUND = 0.14  # of a range, about it in a figure of contours
FINE = 121  # points of a surface along each factor
MOST_EDGES, MOST_SETTINGS, MOST_NAMED, MOST_LETTERS = 48, 30, 4, 40  # that are named in a panel


def label(law: LawFit, symbol: str) -> str:
    """A symbol with its unit in brackets, where it has one."""
    unit = law.units.get(symbol, "")
    return f"{symbol} [{unit}]" if unit else symbol


def even(n: int) -> Ints:
    """Positions of an even selection of at most ``MOST`` of n points, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, MOST)).round().astype(np.intp)


def identified(laws: Iterable[LawFit]) -> Styles:
    """Colour and marker of each edge of these laws; empty where an edge has one row, or there are too many edges."""
    names: dict[str, None] = {}
    for law in laws:
        if law.rows is not None and law.edge is not None and law.n_edges and law.n_edges < law.nobs:
            names |= dict.fromkeys(map(str, law.edge))
    return edge_styles(names) if 1 < len(names) <= MOST_EDGES else {}


def _title(ax: "Axes", law: LawFit, text: str) -> None:
    """Title of a panel of points, with a note where they are simulated or not all of them are drawn."""
    notes = ["simulated"] if law.source.simulated else []
    notes += [f"{MOST} of {law.nobs} points shown"] if law.nobs > MOST else []
    titled(ax, text, [", ".join(notes)])


def points(ax: "Axes", x: Array, y: Array) -> None:
    """Open circles at x, y (n,), smaller where they are many, at most ``MOST`` of them."""
    shown = even(len(x))
    size, edge = (DOT, 0.9) if len(shown) <= 500 else (2, 0.4)
    ax.plot(x[shown], y[shown], "o", ms=size, mfc="none", mec=BLUE, mew=edge)


def _points_of(ax: "Axes", law: LawFit, x: Array, y: Array, styles: Styles | None) -> None:
    """Points over x, of each edge in its style; a life known by a bound alone is an arrow towards its side."""
    side = None if law.rows is None else law.rows.side
    if side is not None and side.any():
        _lives(ax, x, y, side)
        return
    styles = identified([law]) if styles is None else styles
    if not styles or law.edge is None:
        points(ax, x, y)
        return
    edge = law.edge.astype(str)
    for name in sorted(set(edge), key=natural_key):
        rows = np.flatnonzero(edge == name)
        ax.plot(x[rows], y[rows], label=name, **styles[name])


def _lives(ax: "Axes", x: Array, y: Array, side: NDArray[np.int8]) -> None:
    points(ax, x[side == 0], y[side == 0])
    for which, marker, words in ((1, "^", "longer (run-out)"), (-1, "v", "shorter")):
        if (side == which).any():
            ax.plot(x[side == which], y[side == which], marker, ms=DOT + 1, color=ORANGE, ls="none", label=words)
    ax.legend()


def _own_legend(ax: "Axes", law: LawFit, *, own: bool) -> None:
    """Legend of the edges to the right of axes of their own figure."""
    if own and (styles := identified([law])):
        edge_legend(ax, styles, -(-len(styles) // 16), loc="center left", bbox_to_anchor=(1.0, 0.5))


def _without_residuals(law: LawFit, ax: "Axes") -> bool:
    """Write on the panel why there are no residuals, where they are rounding errors only."""
    if law.no_interval is None and law.rss > ROUNDING * law.tss:
        return False
    why = f"{law.nobs} rows fix\n{len(law.theta)} parameters" if law.no_interval else "the law fits every row"
    ax.text(0.5, 0.5, f"no residuals:\n{why}", ha="center", va="center", transform=ax.transAxes, color=GREY)
    ax.set(xticks=[], yticks=[], title=law.response)
    return True


def observed_against_predicted(
    law: LawFit, ax: "Axes | None" = None, *, styles: Styles | None = None, limit: Limit | None = None
) -> "Axes":
    """Measured values against the law's with the line of equality, of each edge in a colour and a marker.

    ``styles`` are those of `identified`, where several panels share a legend; ``limit`` is drawn where it is in range.
    """
    own, ax = ax is None, new_axes(ax, 5.4)
    _points_of(ax, law, law.fitted, law.observed, styles)
    ends = [min(law.fitted.min(), law.observed.min()), max(law.fitted.max(), law.observed.max())]
    ax.plot(ends, ends, color=INK, lw=THIN, zorder=1.5)
    if law.error == "multiplicative" and ends[0] > 0 and ends[1] / ends[0] > 3:
        ax.set(xscale="log", yscale="log")
        plain_ticks(ax, "xy", ends, ends)
    ax.set_xlabel(f"predicted {label(law, law.response)}")
    ax.set_ylabel(f"observed {label(law, law.response)}")
    _title(ax, law, f"{law.response}: R² {law.rsquared:.3f}, n {law.nobs}")
    draw_limit(ax, limit)
    _own_legend(ax, law, own=own)
    return ax


def residuals(law: LawFit, ax: "Axes | None" = None, *, styles: Styles | None = None) -> "Axes":
    """Residuals against the prediction, on the scale of the fit; those beyond two standard errors with their edge."""
    own, ax = ax is None, new_axes(ax, 5.4)
    if _without_residuals(law, ax):
        return ax
    _zero_and_two(ax, law)
    _points_of(ax, law, law.fitted, law.residuals, styles)
    _name_far(ax, law, law.fitted)
    se = law.scale_se
    low, high = law.fitted.min(), law.fitted.max()
    if law.error == "multiplicative" and low > 0 and high / low > 3:
        ax.set_xscale("log")
        plain_ticks(ax, "x", [low, high], [low, high])
    ax.set_xlabel(f"predicted {label(law, law.response)}")
    ax.set_ylabel(_of_residuals(law))
    _title(ax, law, f"{law.response}: dashed ±2 SE" if se else law.response)
    _own_legend(ax, law, own=own)
    return ax


def _of_residuals(law: LawFit) -> str:
    """Name of an axis of residuals with their unit."""
    unit = "ln" if law.error == "multiplicative" else law.units.get(law.response, "")
    return f"residual of {law.response} [{unit}]"


def _zero_and_two(ax: "Axes", law: LawFit) -> None:
    """Lines at zero and at two standard errors to each side."""
    ax.axhline(0, color=INK, lw=THIN)
    for side in (-2, 2) if law.scale_se else ():
        ax.axhline(side * float(law.scale_se or 0), color=GREY, lw=THIN, ls="--")


def _name_far(ax: "Axes", law: LawFit, x: Array) -> None:
    """Names of the edges, or lines of the file, of the farthest residuals beyond two standard errors."""
    size = np.abs(law.residuals)
    far = [int(i) for i in np.argsort(-size)[:MOST_NAMED] if law.scale_se and size[i] > 2 * law.scale_se]
    for i in far if law.rows is not None else ():
        name = str(law.edge[i]) if law.edge is not None else f"line {law.lines[i]}"
        rim(ax.annotate(name, (x[i], law.residuals[i]), (4, 0), textcoords="offset points", fontsize=SMALL - 1,
                        va="center", color=INK))  # fmt: skip


def residuals_by_edge(law: LawFit, ax: "Axes | None" = None, *, styles: Styles | None = None) -> "Axes":
    """Residuals of each edge in a column with their mean, on the scale of the fit: an edge that stands off is seen."""
    ax, styles = new_axes(ax, 7.0, 3.2), identified([law]) if styles is None else styles
    if _without_residuals(law, ax):
        return ax
    if law.edge is None or not styles:
        return residuals(law, ax, styles=styles)
    edge = law.edge.astype(str)
    names = sorted(set(edge), key=natural_key)
    _zero_and_two(ax, law)
    for at, name in enumerate(names):
        own = law.residuals[edge == name]
        ax.plot(np.full(len(own), at), own, label=name, **styles[name])
        ax.plot([at - 0.35, at + 0.35], [own.mean()] * 2, color=INK, lw=LINE, zorder=3)
    turned = sum(map(len, names)) > MOST_LETTERS
    ax.set_xticks(range(len(names)), names, rotation=90 if turned else 0)
    ax.set(xlabel="edge", ylabel=_of_residuals(law), xlim=(-0.7, len(names) - 0.3))
    ax.grid(visible=False, axis="x")
    _title(ax, law, f"{law.response}: residuals by edge, bar: mean of the edge")
    return ax


def normal_quantiles(law: LawFit, ax: "Axes | None" = None) -> "Axes":
    """Ordered residuals over normal quantiles: on the line where residuals are normal."""
    from scipy.special import ndtri

    ax = new_axes(ax)
    if _without_residuals(law, ax):
        return ax
    if law.life is not None and law.not_least_squares:
        return _life_quantiles(law, law.life, ax)
    n = law.nobs
    scale = law.scale_se or 1.0
    quantiles = ndtri((np.arange(1, n + 1) - 0.375) / (n + 0.25))  # Blom 1958
    ends = [quantiles[0], quantiles[-1]]
    ax.plot(ends, ends, color=INK, lw=THIN)
    points(ax, quantiles, np.sort(law.residuals) / scale)
    ax.set_xlabel("normal quantile")
    ax.set_ylabel(f"ordered residual of {law.response} / SE")
    return ax


def _life_quantiles(law: LawFit, life: LifeDistribution, ax: "Axes") -> "Axes":
    """Residuals of the lives that ended over quantiles of their distribution, at Kaplan-Meier's probabilities."""
    order = np.argsort(law.residuals, kind="stable")
    side = np.zeros(law.nobs, dtype=np.int8) if law.rows is None or law.rows.side is None else law.rows.side
    ended = side[order] == 0
    survival = np.cumprod(np.where(ended, 1 - 1 / np.arange(law.nobs, 0, -1), 1.0))
    share = 1 - (np.concatenate([[1.0], survival[:-1]]) + survival) / 2  # in the middle of each step
    median = standard_quantile(life.name, 0.5)
    quantiles = np.array([standard_quantile(life.name, p) - median for p in share[ended]])
    points(ax, quantiles, law.residuals[order][ended] / life.scale)
    ends = [quantiles.min(), quantiles.max()]
    ax.plot(ends, ends, color=INK, lw=THIN)
    ax.set_xlabel(f"quantile of {'Weibull' if life.name == 'weibull' else 'lognormal'} lives")
    ax.set_ylabel(f"ordered residual of {law.response} / s, lives that ended")
    return ax


def response_surface(law: LawFit, ax: "Axes | None" = None, *, limit: Limit | None = None) -> "Axes":
    """The law over its first two factors inside the tested region, the others at the middle of their ranges.

    Settings are dots with their edges. A law of one factor is a line through its points. ``limit`` is drawn.
    """
    ax = new_axes(ax)
    if len(law.factors) == 1:
        return _line(law, ax, limit)
    return contours_inside(law, (law.factors[0], law.factors[1]), ax, limit=limit)


def _line(law: LawFit, ax: "Axes", limit: Limit | None) -> "Axes":
    (name,) = law.factors
    low, high = law.domain[name]
    grid = np.linspace(low, high, 120)
    at: dict[str, object] = {name: grid, **reference_level(law.by, len(grid))}
    if law.no_interval:
        ax.plot(grid, law.values(at), color=BLUE, lw=LINE)
    else:
        band = law.predict(at)
        ax.fill_between(grid, band.low, band.high, color=BLUE, alpha=FILL, lw=0, label="95 % prediction")
        ax.plot(grid, band.value, color=BLUE, lw=LINE)
        ax.legend()
    _points_of(ax, law, law.X[:, 0], law.observed, None)
    ax.set_xlabel(label(law, name))
    ax.set_ylabel(label(law, law.response))
    _title(ax, law, f"{law.response} on {name}")
    draw_limit(ax, limit)
    return ax


def contours_inside(
    law: LawFit, pair: tuple[str, str], ax: "Axes | None" = None, *, limit: Limit | None = None
) -> "Axes":
    """Contours over two factors inside the tested region alone, the others at the middle of their ranges.

    Outside it, where ``LawFit.region`` and every prediction state that the law is not supported, the panel is white.
    """
    ax, logs = new_axes(ax), dict(zip(law.factors, law.formula.logs, strict=True))
    gx, gy = np.meshgrid(*((np.geomspace if logs[name] else np.linspace)(*law.domain[name], FINE) for name in pair))
    held = {name: middle(law.domain[name], logs[name]) for name in law.factors if name not in pair}
    at: dict[str, object] = {pair[0]: gx.ravel(), pair[1]: gy.ravel(), **reference_level(law.by, gx.size), **held}
    inside = law.region.inside(at).reshape(gx.shape)
    z = np.ma.masked_array(np.asarray(law.values(at)).reshape(gx.shape), ~inside)
    if inside.any() and len(levels := contour_levels(z.compressed())):
        ax.contourf(gx, gy, z, levels, colors=shades(len(levels) + 1), extend="both")
        lines = ax.contour(gx, gy, z, levels, colors=INK, linewidths=THIN)
        for text in ax.clabel(lines, fontsize=SMALL, fmt=lambda v: f"{v:.4g}"):
            rim(text)
    else:
        _without_contours(law, z.compressed(), ax)
    ax.grid(visible=False)
    _outline(ax, gx, gy, inside)
    beyond = _limit_contour(ax, (gx, gy, z), limit)
    _axes_of_factors(law, pair, ax)
    _settings_named(law, pair, ax)
    words = ", ".join(f"{name} {value:.3g} {law.units.get(name, '')}".rstrip() for name, value in held.items())
    notes = [words, ", ".join(filter(None, (beyond, "simulated" if law.source.simulated else "")))]
    titled(ax, label(law, law.response), notes)
    return ax


def _outline(ax: "Axes", gx: Array, gy: Array, inside: Flags) -> None:
    """Border of the tested region, where it is not all of the panel."""
    if inside.any() and not inside.all():
        padded = np.where(inside, 1.0, 0.0)
        ax.contour(gx, gy, padded, [0.5], colors=GREY, linewidths=THIN, linestyles="--")


def _limit_contour(ax: "Axes", surface: tuple[Array, Array, Any], limit: Limit | None) -> str:
    """Draw the contour of a limit; return a note where the limit is not reached in the region."""
    z = surface[2]
    if limit is None or not z.count():
        return ""
    low, high = float(z.min()), float(z.max())
    if not low < limit.value < high:
        return f"{limit.words} not reached" if limit.value >= high else f"all above {limit.words}"
    line = ax.contour(*surface, [limit.value], colors=RED, linewidths=THICK, linestyles="--")
    for text in ax.clabel(line, fontsize=SMALL, fmt=lambda _: limit.words):
        text.set_color(RED)
        rim(text)
    return ""


def _settings_named(law: LawFit, pair: tuple[str, str], ax: "Axes") -> None:
    """Distinct settings of two factors as dots, with their edges where they are few."""
    if law.rows is None:
        return
    X = law.X[:, [law.factors.index(name) for name in pair]]
    settings = _settings(X)
    thinned = settings[:: -(-len(settings) // 400)]
    ax.plot(thinned[:, 0], thinned[:, 1], "o", ms=DOT, color=ORANGE, mec="white", mew=0.5, clip_on=False, zorder=3)
    if law.edge is None or len(settings) > MOST_SETTINGS:
        return
    for point in settings:
        names = short_names(map(str, law.edge[np.equal(X, point).all(axis=1)]))
        right, up = (int(np.sign(round(float(share) - 0.5, 2))) for share in _shares(law, pair, point))
        right = right if up else 0
        rim(ax.annotate(names, tuple(point), (4 * right, 5 * (up or 1)), textcoords="offset points",
                        ha=("center", "left", "right")[right], va="top" if up < 0 else "bottom",
                        fontsize=SMALL - 1, color=INK, zorder=4))  # fmt: skip


def _shares(law: LawFit, pair: tuple[str, str], point: Iterable[float]) -> Iterator[float]:
    """Shares of the tested ranges of two factors at which a point lies."""
    for name, value in zip(pair, point, strict=True):
        take: Any = np.log if law.formula.logs[law.factors.index(name)] else float
        at, low, high = map(take, (value, *law.domain[name]))
        yield float((at - low) / (high - low)) if high > low else 0.5


def _axes_of_factors(law: LawFit, pair: tuple[str, str], ax: "Axes") -> None:
    """Labels of two factors as axes, logarithmic where the law takes their logarithms."""
    logs = dict(zip(law.factors, law.formula.logs, strict=True))
    for name, which in zip(pair, "xy", strict=True):
        if logs[name]:
            getattr(ax, f"set_{which}scale")("log")
            plain_ticks(ax, which, list(law.domain[name]), list(law.domain[name]))
        low, high = law.domain[name]
        reach = (high / low) ** AROUND if logs[name] else AROUND * (high - low)
        ends = (low / reach, high * reach) if logs[name] else (low - reach, high + reach)
        getattr(ax, f"set_{which}lim")(*ends)
    ax.set(xlabel=label(law, pair[0]), ylabel=label(law, pair[1]))


def _without_contours(law: LawFit, z: Array, ax: "Axes") -> None:
    if not z.size:
        why = "no contours: the middle of the other factors\nlies outside the tested region"
    else:
        ends = f"{z.min():.5g}" if np.isfinite(z).all() else "not finite"
        why = f"no contours: {law.response} is {ends} over the whole surface"
    ax.text(0.5, 0.93, why, ha="center", fontsize=SMALL, color=GREY, transform=ax.transAxes)


def _settings(X: Array) -> Array:
    """Distinct rows of two columns, in their order."""
    pairs = (
        np.ascontiguousarray(X, dtype=np.float64).view(np.complex128).ravel()
    )  # a pair as one number is found in half the time
    return np.asarray(pd.unique(pairs)).view(np.float64).reshape(-1, 2)


def middle(ends: tuple[float, float], logs: bool) -> float:
    """Middle of a range, the geometric one where ``logs``."""
    return float(np.sqrt(ends[0] * ends[1])) if logs else (ends[0] + ends[1]) / 2
