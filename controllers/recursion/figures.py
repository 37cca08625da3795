"""Figures of a recursion, as Figures 2, 3, 11 and 12 of AC-2017, and of its distribution; all are calculated."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...core.arrays import Array
from ...core.display import plot
from ...core.figure_style import BLUE, FILL, GREEN, LINE, ORANGE, RED, SMALL, THICK, THIN, new_axes
from ...core.plotting import NotebookFigure
from .distribution import LifeDraws
from .interval_optimum import best_exact, not_convex
from .laws import response_at_end, wear_after
from .life import Life, by_speed

FINE = 160  # points along a side of a contour figure
CALCULATED = "Calculated from the laws"


def speeds_figure(life: Life, k: int = 0) -> Figure:
    """Force, power and wear of the best pair at each speed in interval k, with its metal removal rate (Fig. 2)."""
    table, laws = by_speed(life, k), life.laws
    rows: list[tuple[str, Array, float]] = []
    for terms, values in ((laws.force, table.Fxz), (laws.power, table.P), (laws.wear, table.AW)):
        if terms is not None and values is not None:
            rows.append((f"{terms.response} [{terms.unit}]", values, terms.most))
    figure = NotebookFigure(figsize=(7.2, 1.0 + 2.0 * len(rows)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(rows), 1, sharex=True))
    best = int(table.MRR.argmax()) if len(table.V) else None
    for ax, (name, values, most) in zip(axes, rows, strict=True):
        _with_rate(ax, table.V, table.MRR, values, name, most)
        if best is not None:
            ax.plot(table.V[best], values[best], "o", ms=10, mfc="none", mec="k", mew=1.4)
    axes[-1].set_xlabel("V [m/min], at each speed the best feed")
    figure.suptitle(f"{CALCULATED}: {_interval(life, k)}\nCircle: the selected pair.")
    return figure


def plane_figure(life: Life, k: int = 0) -> Figure:
    """The plane of speed and feed in interval k: feasible pairs, MRR and wear, the best pairs (Fig. 3)."""
    figure = NotebookFigure(figsize=(7.2, 5.4), layout="constrained")
    ax = figure.subplots()
    laws, rules, before, start = life.laws, life.rules, life.before(k), k * life.rules.interval
    V, f = np.linspace(*laws.V, FINE)[None, :], np.linspace(*laws.f, FINE)[:, None]
    end = start + rules.interval
    AW = wear_after(laws, rules, V, f, before, start, end)
    shares = [("wear", AW / laws.wear.most, GREEN)]
    for (name, terms), colour in zip(laws.limited, (BLUE, ORANGE), strict=False):
        shares.append((name, response_at_end(terms, rules, V, f, end, AW) / terms.most, colour))
    worst = np.maximum.reduce([share for _, share, _ in shares])
    x, y = V.ravel(), f.ravel()
    ax.contourf(x, y, worst, levels=[0.0, 1.0], colors=[GREEN], alpha=FILL)
    _labelled(ax, x, y, laws.mrr(V, f) / 1000, "0.6", "-", "%g")
    _labelled(ax, x, y, AW, GREEN, ":", "%.4g")
    wear = f"{laws.wear.response} [{laws.wear.unit}]"
    lines = [Line2D([], [], color="0.6", lw=THIN, label="MRR [cm3/min]"),
             Line2D([], [], color=GREEN, ls=":", lw=THIN, label=wear)]  # fmt: skip
    for name, share, colour in shares:
        if share.min() < 1 < share.max():
            ax.contour(x, y, share, levels=[1.0], colors=[colour], linewidths=2.0)
            lines.append(Line2D([], [], color=colour, lw=THICK, label=f"limit of {name}"))
    _best_pairs(ax, life, k, lines)
    ax.set(xlabel="V [m/min]", ylabel="f [mm/rev]", xlim=laws.V, ylim=laws.f)
    figure.suptitle(f"{CALCULATED}: {_interval(life, k)}\nShaded: within every limit.")
    figure.legend(handles=lines, loc="outside lower center", ncols=4)
    return figure


def life_figure(life: Life, exact: Life | None = None) -> Figure:
    """Metal removal rate over the life with force, power and wear and their limits (Fig. 11)."""
    laws = life.laws
    rows = [(laws.force, life.Fxz), (laws.power, life.P), (laws.wear, life.AW)]
    shown = [(terms, values) for terms, values in rows if terms is not None]
    figure = NotebookFigure(figsize=(7.2, 1.0 + 2.0 * len(shown)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True))
    for ax, (terms, values) in zip(axes, shown, strict=True):
        _with_rate(ax, life.time, life.MRR, values, f"{terms.response} [{terms.unit}]", terms.most, exact)
    axes[-1].set_xlabel("end of the interval [min]")
    note = "\nDashed: MRR of the exact optimum." if exact is not None else ""
    figure.suptitle(f"{CALCULATED}: {_how(life)}{note}")
    return figure


def pairs_figure(life: Life, exact: Life | None = None) -> Figure:
    """Speed and feed of each interval (Fig. 12)."""
    figure = NotebookFigure(figsize=(7.2, 4.4), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    for ax, name, unit in ((top, "V", "m/min"), (bottom, "f", "mm/rev")):
        for one, colour, style, label in _lives(life, exact):
            ax.stairs(getattr(one, name), np.arange(len(one.time) + 1) * one.rules.interval, baseline=None,
                      color=colour, ls=style, lw=LINE, label=label)  # fmt: skip
        ax.set(ylabel=f"{name} [{unit}]")
        ax.set_axisbelow(True)  # stairs are patches, which lie below a grid
        ax.grid(color="0.92")
    top.legend()
    bottom.set_xlabel("time of cut [min]")
    figure.suptitle(f"{CALCULATED}: {_how(life)}")
    return figure


def draws_figure(plan: LifeDraws, own: LifeDraws | None, level: float = 0.95) -> Figure:
    """Life and metal removed over the draws, of one plan and of own recursions, with their bands."""
    figure = NotebookFigure(figsize=(7.2, 5.0 if own is not None else 3.2), layout="constrained")
    held = [(plan, "one plan on edges drawn from the posterior")]
    held += [] if own is None else [(own, "each draw its own recursion")]
    rows = figure.subplots(len(held), 2, sharex="col", squeeze=False)
    for row, (found, title) in zip(rows, held, strict=True):
        for ax, what, name, scale in zip(
            row, ("minutes", "removed"), ("life, min", "metal removed, 1000 cm3"), (1.0, 1e-6), strict=True
        ):
            _histogram(ax, found, what, scale, level)
            ax.set_title(title)
            if found is held[-1][0]:
                ax.set_xlabel(name)
        row[0].set_ylabel("draws")
    words = f"shaded: {100 * level:g} % band, equal-tailed; line: the laws as fitted"
    figure.suptitle(f"{CALCULATED} with {len(plan.minutes)} draws; {words}")
    return figure


def _histogram(ax: Axes, found: LifeDraws, what: str, scale: float, level: float) -> None:
    values = getattr(found, what) * scale
    low, _, high = (end * scale for end in found.band(what, level))
    step = found.plan.rules.interval
    even = np.arange(values.min() - step / 2, values.max() + step, step).tolist()
    bins = even if what == "minutes" else 18
    ax.axvspan(low, high, color=BLUE, alpha=FILL, lw=0, zorder=0)
    ax.hist(values, bins=bins, color=BLUE, alpha=0.85)
    ax.axvline(getattr(found.plan, what) * scale, color=ORANGE, lw=LINE)


def _with_rate(
    ax: Axes, x: Array, rate: Array, values: Array, name: str, most: float, exact: Life | None = None
) -> None:
    ax.plot(x, values, "o-", color=BLUE, ms=4, lw=LINE)
    ax.axhline(most, color=RED, lw=LINE, ls="--")
    ax.set_ylim(0, 1.12 * most)
    ax.text(
        0.995, most, "limit", color=RED, fontsize=SMALL, ha="right", va="bottom", transform=ax.get_yaxis_transform()
    )
    ax.set_ylabel(name, color=BLUE)
    other = ax.twinx()
    other.plot(x, rate / 1000, "s-", color=ORANGE, ms=3.5, lw=LINE)
    if exact is not None:
        other.plot(exact.time, exact.MRR / 1000, "--", color=ORANGE, lw=THIN)
    other.set_ylim(bottom=0)
    other.set_ylabel("MRR [cm3/min]", color=ORANGE)


def _labelled(ax: Axes, x: Array, y: Array, z: Array, colour: str, style: str, digits: str) -> None:
    lines = ax.contour(x, y, z, levels=8, colors=colour, linestyles=style, linewidths=0.8)
    ax.clabel(lines, fontsize=SMALL, fmt=digits)


def _best_pairs(ax: Axes, life: Life, k: int, lines: list[Line2D]) -> None:
    if k < len(life.time):
        lines += ax.plot(life.V[k], life.f[k], "o", color="k", ms=7, label=f"grid: {life.V[k]:g}, {life.f[k]:g}")
    if not not_convex(life.laws):
        best = best_exact(life.laws, life.rules, life.before(k), k * life.rules.interval)
        if best is not None:
            label = f"exact: {best.V:.1f}, {best.f:.3f}"
            lines += ax.plot(best.V, best.f, "x", color="k", ms=9, mew=1.8, label=label, clip_on=False)


def _lives(life: Life, exact: Life | None) -> Sequence[tuple[Life, str, str, str]]:
    first = (life, BLUE, "-", "plan" if exact is None else "best pair of the grid")
    return (first,) if exact is None else (first, (exact, ORANGE, "--", "exact optimum"))


def _interval(life: Life, k: int) -> str:
    step = life.rules.interval
    if step == 1:
        return f"minute {k + 1}, {_how(life)}"
    return f"{k * step:g} to {(k + 1) * step:g} min, {_how(life)}"


def _how(life: Life) -> str:
    wear = "wear by the clock" if life.rules.wear == "clock" else "wear by the wear state"
    return f"d {life.laws.d:g} mm, {life.rules.times} times, {wear}"


@plot.register
def plot_life(life: Life, ax: Axes | None = None) -> Axes:
    """Wear up to its criterion over the life, the metal removal rate on an axis of its own."""
    ax, wear = new_axes(ax, 6.4, 3.8), life.laws.wear
    if len(life.time):
        _with_rate(ax, life.time, life.MRR, life.AW, f"{wear.response}, {wear.unit}", wear.most)
    ax.set_xlabel("end of the interval [min]")
    ax.set_title(f"{CALCULATED}: {life.minutes:g} min, {life.removed / 1000:.4g} cm3")
    return ax


@plot.register
def plot_draws(found: LifeDraws, ax: Axes | None = None) -> Axes:
    """Life over the draws, with its band and that of the laws as fitted."""
    ax = new_axes(ax, 4.8, 3.6)
    _histogram(ax, found, "minutes", 1.0, 0.95)
    ax.set(xlabel="life [min]", ylabel="draws", title=f"{CALCULATED}; shaded: 95 %")
    return ax
