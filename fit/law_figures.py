"""Panels of one law on given axes; the figures of other results are in ``figures`` and ``bayes/figures``."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ..core.censored import LifeDistribution, standard_quantile
from ..core.errors import FitError
from ..core.plotting import new_axes
from .available import NotAvailable, computed
from .form_comparison import FormComparison
from .lawfit import LawFit

# Steps within a decade, coarse to fine
STEPS = (
    (1.0,),
    (1.0, 3.0),
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
)
BLUE, ORANGE, GREY = "#1f5fa8", "#c8551b", "#8a8a8a"
ROUNDING = 1e-24  # of the sum of squares: residuals of 1e-12, what is left of an exact law in double precision
BEYOND = 0.3  # of the tested range, by which curves of forms go beyond it
CONSTANT = 1e-9  # relative spread of a surface below which there are no contours
MOST = 4000  # points in one panel: more are slow to draw and overlap


def label(law: LawFit, symbol: str) -> str:
    """A symbol with its unit in brackets, where it has one."""
    unit = law.units.get(symbol, "")
    return f"{symbol} [{unit}]" if unit else symbol


def even(n: int) -> NDArray[np.intp]:
    """Positions of an even selection of at most ``MOST`` of n points, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, MOST)).round().astype(np.intp)


def _title(ax: Axes, text: str, n: int) -> None:
    """Title of a panel of points, with a note where not all of them are drawn."""
    ax.set_title(text + (f"\n{MOST} of {n} points shown" if n > MOST else ""), fontsize=10)


def points(ax: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    """Open circles at x, y (n,), smaller where they are many, at most ``MOST`` of them."""
    shown = even(len(x))
    size, edge = (4, 0.9) if len(shown) <= 500 else (2, 0.4)
    ax.plot(x[shown], y[shown], "o", ms=size, mfc="none", mec=BLUE, mew=edge)


def _points_of(ax: Axes, law: LawFit, y: NDArray[np.float64]) -> None:
    """Points over the prediction; a life known by a bound alone is an arrow towards the side on which it lies."""
    side = None if law.rows is None else law.rows.side
    if side is None or not side.any():
        points(ax, law.fitted, y)
        return
    points(ax, law.fitted[side == 0], y[side == 0])
    for which, marker, words in ((1, "^", "longer (run-out)"), (-1, "v", "shorter")):
        if (side == which).any():
            ax.plot(law.fitted[side == which], y[side == which], marker, ms=5, color=BLUE, ls="none", label=words)
    ax.legend(fontsize=7, frameon=False)


def _without_residuals(law: LawFit, ax: Axes) -> bool:
    """Write on the panel why there are no residuals, where they are rounding errors only."""
    if law.no_interval is None and law.rss > ROUNDING * law.tss:
        return False
    why = f"{law.nobs} rows fix\n{len(law.theta)} parameters" if law.no_interval else "the law fits every row"
    ax.text(0.5, 0.5, f"no residuals:\n{why}", ha="center", va="center", transform=ax.transAxes, color=GREY)
    ax.set(xticks=[], yticks=[], title=law.response)
    return True


def observed_against_predicted(law: LawFit, ax: Axes | None = None) -> Axes:
    """Measured values against the law's, with the line of equality."""
    ax = new_axes(ax)
    _points_of(ax, law, law.observed)
    ends = [min(law.fitted.min(), law.observed.min()), max(law.fitted.max(), law.observed.max())]
    ax.plot(ends, ends, color=ORANGE, lw=1.2)
    if law.error == "multiplicative" and ends[0] > 0 and ends[1] / ends[0] > 3:
        ax.set(xscale="log", yscale="log")
        _plain_ticks(ax, "xy", ends, ends)
    ax.set_xlabel(f"predicted {label(law, law.response)}")
    ax.set_ylabel(f"observed {label(law, law.response)}")
    _title(ax, f"{law.response}: R² {law.rsquared:.3f}, n {law.nobs}", law.nobs)
    return ax


def residuals(law: LawFit, ax: Axes | None = None) -> Axes:
    """Residuals against the prediction, on the scale of the fit."""
    ax = new_axes(ax)
    if _without_residuals(law, ax):
        return ax
    ax.axhline(0, color=ORANGE, lw=1.2)
    _points_of(ax, law, law.residuals)
    se = law.scale_se
    if se:
        for side in (-2, 2):
            ax.axhline(side * se, color=GREY, lw=0.8, ls="--")
    low, high = law.fitted.min(), law.fitted.max()
    if law.error == "multiplicative" and low > 0 and high / low > 3:
        ax.set_xscale("log")
        _plain_ticks(ax, "x", [low, high], [low, high])
    unit = "ln" if law.error == "multiplicative" else law.units.get(law.response, "")
    ax.set_xlabel(f"predicted {label(law, law.response)}")
    ax.set_ylabel(f"residual of {law.response} [{unit}]")
    _title(ax, f"{law.response}: dashed ±2 SE" if se else law.response, law.nobs)
    return ax


def normal_quantiles(law: LawFit, ax: Axes | None = None) -> Axes:
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
    points(ax, quantiles, np.sort(law.residuals) / scale)
    ends = [quantiles[0], quantiles[-1]]
    ax.plot(ends, ends, color=ORANGE, lw=1.2)
    ax.set_xlabel("normal quantile")
    ax.set_ylabel(f"ordered residual of {law.response} / SE")
    return ax


def _life_quantiles(law: LawFit, life: LifeDistribution, ax: Axes) -> Axes:
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
    ax.plot(ends, ends, color=ORANGE, lw=1.2)
    ax.set_xlabel(f"quantile of {'Weibull' if life.name == 'weibull' else 'lognormal'} lives")
    ax.set_ylabel(f"ordered residual of {law.response} / s, lives that ended")
    return ax


def response_surface(law: LawFit, ax: Axes | None = None) -> Axes:
    """The law over its first two factors, the others at the middle of their range; settings as dots.

    A law of one factor is a line through its points; a law of second order is drawn inside the tested region alone,
    beyond which its squares dominate.
    """
    ax = new_axes(ax)
    if not law.formula.first_order and len(law.factors) > 1:
        return contours_inside(law, (law.factors[0], law.factors[1]), ax)
    return _line(law, ax) if len(law.factors) == 1 else _contours(law, ax)


def _line(law: LawFit, ax: Axes) -> Axes:
    (name,) = law.factors
    low, high = law.domain[name]
    grid = np.linspace(low, high, 120)
    at: dict[str, object] = {name: grid, **_category(law, len(grid))}
    if law.no_interval:
        ax.plot(grid, law.predict(at), color=ORANGE)
    else:
        band = law.predict(at, "prediction")
        ax.fill_between(grid, band["low"], band["high"], color=BLUE, alpha=0.15, lw=0, label="95 % prediction")
        ax.plot(grid, band["value"], color=ORANGE)
        ax.legend(frameon=False, fontsize=8)
    points(ax, law.X[:, 0], law.observed)
    ax.set_xlabel(label(law, name))
    ax.set_ylabel(label(law, law.response))
    _title(ax, f"{law.response} on {name}", law.nobs)
    return ax


def _contours(law: LawFit, ax: Axes) -> Axes:
    x, y, *others = law.factors
    (x0, x1), (y0, y1) = law.domain[x], law.domain[y]
    logs = law.formula.log_factors
    space = np.geomspace if logs else np.linspace
    gx, gy = np.meshgrid(space(x0, x1, 50), space(y0, y1, 50))
    logged = dict(zip(law.factors, law.formula.logs, strict=True))
    at_middle = {name: middle(law.domain[name], logged[name]) for name in others}
    at = {x: gx.ravel(), y: gy.ravel(), **{name: np.full(gx.size, v) for name, v in at_middle.items()}}
    z = np.asarray(law.predict({**at, **_category(law, gx.size)})).reshape(gx.shape)
    if len(levels := _levels(z)):
        ax.contourf(gx, gy, z, levels, cmap="Blues", alpha=0.6, extend="both")
        lines = ax.contour(gx, gy, z, levels, colors="black", linewidths=0.7)
        ax.clabel(lines, fontsize=7, fmt=lambda v: f"{v:.4g}")
    else:
        _without_contours(law, z, ax)
        ax.set(xlim=(x0, x1), ylim=(y0, y1))
    settings = _settings(law.X[:, :2])
    settings = settings[:: -(-len(settings) // 400)]
    ax.plot(settings[:, 0], settings[:, 1], "o", ms=4, color=ORANGE, mec="white", mew=0.5, clip_on=False)
    if logs:
        ax.set(xscale="log", yscale="log")
        _plain_ticks(ax, "xy", [x0, x1], [y0, y1])
    ax.set_xlabel(label(law, x))
    ax.set_ylabel(label(law, y))
    held = ", ".join(f"{name} {value:.3g} {law.units.get(name, '')}".rstrip() for name, value in at_middle.items())
    ax.set_title(label(law, law.response) + (f"\n{held}" if held else ""), fontsize=9)
    return ax


def contours_inside(law: LawFit, pair: tuple[str, str], ax: Axes | None = None) -> Axes:
    """Contours over two factors inside the tested region alone, the others at the middle of their ranges."""
    ax, logs = new_axes(ax), dict(zip(law.factors, law.formula.logs, strict=True))
    gx, gy = np.meshgrid(*((np.geomspace if logs[name] else np.linspace)(*law.domain[name], 60) for name in pair))
    held = {name: middle(law.domain[name], logs[name]) for name in law.factors if name not in pair}
    at: dict[str, object] = {pair[0]: gx.ravel(), pair[1]: gy.ravel(), **_category(law, gx.size), **held}
    inside = law.region.inside(at).reshape(gx.shape)
    z = np.ma.masked_array(np.asarray(law.predict(at)).reshape(gx.shape), ~inside)
    if inside.any() and len(levels := _levels(z.compressed())):
        ax.contourf(gx, gy, z, levels, cmap="Blues", alpha=0.6, extend="both")
        ax.clabel(ax.contour(gx, gy, z, levels, colors="black", linewidths=0.7), fontsize=7, fmt=lambda v: f"{v:.4g}")
    settings = _settings(law.X[:, [law.factors.index(name) for name in pair]])
    ax.plot(settings[:, 0], settings[:, 1], "o", ms=4, color=ORANGE, mec="white", mew=0.5, clip_on=False)
    _axes_of_factors(law, pair, ax)
    words = ", ".join(f"{name} {value:.3g} {law.units.get(name, '')}".rstrip() for name, value in held.items())
    ax.set_title(f"{label(law, law.response)}, inside the tested region" + (f"\n{words}" if words else ""), fontsize=9)
    return ax


def _axes_of_factors(law: LawFit, pair: tuple[str, str], ax: Axes) -> None:
    """Labels of two factors as axes, logarithmic where the law takes their logarithms."""
    logs = dict(zip(law.factors, law.formula.logs, strict=True))
    for name, which in zip(pair, "xy", strict=True):
        if logs[name]:
            getattr(ax, f"set_{which}scale")("log")
            _plain_ticks(ax, which, list(law.domain[name]), list(law.domain[name]))
    ax.set(xlabel=label(law, pair[0]), ylabel=label(law, pair[1]))


def _without_contours(law: LawFit, z: NDArray[np.float64], ax: Axes) -> None:
    ends = f"{z.min():.5g}" if np.isfinite(z).all() else "not finite"
    why = f"no contours: {law.response} is {ends} over the whole surface"
    ax.text(0.5, 0.93, why, ha="center", fontsize=8, color=GREY, transform=ax.transAxes)


def _settings(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distinct rows of two columns, in their order."""
    pairs = np.ascontiguousarray(X).view(np.complex128).ravel()  # a pair as one number is found in half the time
    return np.asarray(pd.unique(pairs)).view(np.float64).reshape(-1, 2)


def _category(law: LawFit, n: int) -> Mapping[str, object]:
    return {} if law.by is None else {law.by.column: np.full(n, law.by.reference)}


def middle(ends: tuple[float, float], logs: bool) -> float:
    """Middle of a range, the geometric one where ``logs``."""
    return float(np.sqrt(ends[0] * ends[1])) if logs else (ends[0] + ends[1]) / 2


def _levels(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """About seven contour levels at round numbers; none of a surface that is constant or not finite."""
    low, high = float(z.min()), float(z.max())
    if not (np.isfinite(z).all() and high - low > CONSTANT * max(abs(low), abs(high))):
        return np.empty(0)
    if low > 0 and high / low > 8:
        inside = [v for v in round_numbers(low, high, fewest=5) if low < v < high]
        return np.array(inside) if len(inside) > 2 else np.geomspace(low, high, 8)[1:-1]
    return np.array([v for v in MaxNLocator(8).tick_values(low, high) if low < v < high])


def _plain_ticks(ax: Axes, which: str, x: list[float], y: list[float]) -> None:
    """Ticks of a logarithmic axis at round numbers, without exponents."""
    for name, axis, ends in (("x", ax.xaxis, x), ("y", ax.yaxis, y)):
        if name in which:
            ticks = round_numbers(ends[0], ends[1])
            axis.set_ticks(ticks, [f"{v:g}" for v in ticks])
            axis.set_ticks([], minor=True)


def round_numbers(low: float, high: float, fewest: int = 3, most: int = 9) -> list[float]:
    """Round numbers between two ends of a logarithmic axis, at least ``fewest`` where possible."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks: list[float] = []
    for steps in STEPS:
        ticks = [float(f"{d * s:.6g}") for d in decades for s in steps if low * 0.999 <= d * s <= high * 1.001]
        if fewest <= len(ticks) <= most:
            return ticks
    return ticks if 2 <= len(ticks) <= most else [float(f"{v:.2g}") for v in np.geomspace(low, high, 4)]


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
    for i, (name, values) in enumerate(drawn.predicted.items()):
        first = name == found.preferred.name
        ax.plot(drawn.x, values, color=ORANGE if first else None, lw=2.2 if first else 1.2,
                ls="-" if first else ("--", "-.", ":")[i % 3], label=name, zorder=3 if first else 2)  # fmt: skip
    seen = np.concatenate([drawn.rows_y, *drawn.predicted.values()])
    limit = 2.5 * float(np.nanmax(drawn.rows_y)) if len(drawn.rows_y) else np.inf
    ax.set_ylim(min(0.0, float(np.nanmin(seen))), min(1.05 * float(np.nanmax(seen)), limit))
    ax.set(xlabel=drawn.label, ylabel=f"{found.response} [{found.unit}]" if found.unit else found.response)
    ax.set_title(f"{drawn.others}\nshaded: tested range", fontsize=8)
    ax.legend(frameon=False, fontsize=7)
    return ax


@dataclass(frozen=True, slots=True)
class FormCurves:
    """Predictions of forms over one factor, the others at the middle.

    Attributes
    ----------
    label, others : str
        The factor with its unit; the values of the others.
    tested : tuple of float
        Range of the factor among the rows.
    x : ndarray, shape (m,)
    predicted : mapping of str to ndarray, shape (m,)
        By form; NaN where it has no value.
    rows_x, rows_y : ndarray, shape (n,)
        Rows moved to the middle of the other factors along the preferred form.
    """

    label: str
    others: str
    tested: tuple[float, float]
    x: NDArray[np.float64]
    predicted: Mapping[str, NDArray[np.float64]]
    rows_x: NDArray[np.float64]
    rows_y: NDArray[np.float64]


def predictions_over(found: FormComparison, factor: str | None = None) -> FormCurves:
    """Predictions of the compared forms over a factor, by default the one over which they differ most.

    Raises
    ------
    FitError
        The factor is none of the preferred form.
    """
    law = found.preferred.law
    if factor is None:
        drawn = [predictions_over(found, name) for name in law.factors]
        return max(drawn, key=_spread)
    if factor not in law.factors:
        raise FitError(f"{factor}: it is no factor of {law.response}; its factors are {', '.join(law.factors)}.")
    low, high = law.domain[factor]
    x = np.linspace(max(low - BEYOND * (high - low), low / 2 if low > 0 else 0.0), high + BEYOND * (high - low), 121)
    middle_of = {name: float(found.points[name].iloc[0]) for name in found.factors}
    at = {**{name: np.full(len(x), v) for name, v in middle_of.items()}, factor: x, **_category(law, len(x))}
    values = {}
    for form in found.forms:
        made = computed(partial(form.law.predict, at))
        values[form.name] = np.full(len(x), np.nan) if isinstance(made, NotAvailable) else made
    others = {**dict(zip(law.factors, law.X.T, strict=True)), **_category(law, law.nobs)}
    here = {**others, **{name: np.full(law.nobs, v) for name, v in middle_of.items() if name in law.factors}}
    there = law.predict({**here, factor: others[factor]})
    moved = law.observed * there / law.fitted if law.formula.logarithmic else law.observed + there - law.fitted
    unit = law.units.get(factor, "")
    said = (f"{k} {v:.3g} {law.units.get(k, '')}".rstrip() for k, v in middle_of.items() if k != factor)
    label = f"{factor} [{unit}]" if unit else factor
    return FormCurves(label, ", ".join(said), (low, high), x, values, law.X[:, law.factors.index(factor)], moved)


def _spread(drawn: FormCurves) -> float:
    """Largest difference of the forms inside the tested range, relative to the least prediction."""
    inside = (drawn.x >= drawn.tested[0]) & (drawn.x <= drawn.tested[1])
    values = np.array([v[inside] for v in drawn.predicted.values()])
    return float(np.nanmax((np.nanmax(values, axis=0) - np.nanmin(values, axis=0)) / np.nanmedian(np.abs(values))))
