"""Figures of the results of this package, registered per class."""

import numpy as np
from matplotlib.axes import Axes

from ..core.display import plot
from ..core.errors import UsageError
from ..core.figure_style import BLUE, SERIES, new_axes
from ..core.plotting import LEGEND, whiskers
from ..core.rounding import with_unit
from .draws import Draws
from .file import ParameterFile
from .gather.learned import Drift
from .sections.dynamics import DynamicsSection
from .sections.law import LawSection

STEP = 200  # samples
Rows = dict[str, tuple[float, float, float]]


def _slopes(law: LawSection, name: str = "") -> Rows:
    """Coefficients but the constant, with two standard errors."""
    rows: Rows = {}
    for symbol, value in list(law.coefficients.items())[1:]:
        half = 2 * law.standard_errors.get(symbol, np.nan)
        rows[f"{name}{symbol}"] = (value, value - half, value + half)
    return rows


@plot.register
def law_figure(law: LawSection, ax: Axes | None = None) -> Axes:
    """Coefficients of the factors with two standard errors."""
    return whiskers(_slopes(law), ax, label="coefficient ± 2 standard errors", title=law.equation)


@plot.register
def file_figure(pf: ParameterFile, ax: Axes | None = None) -> Axes:
    """Coefficients of the factors in each law with two standard errors."""
    rows: Rows = {}
    for response, law in pf.laws.items():
        rows |= _slopes(law, f"{response}: ")
    return whiskers(
        rows, ax, label="coefficient ± 2 standard errors", title=f"{pf.identity.tool} on {pf.identity.work}"
    )


@plot.register
def draws_figure(draws: Draws, ax: Axes | None = None) -> Axes:
    """Median and central 95 % interval of each parameter."""
    low, middle, high = np.quantile(draws.values, [0.025, 0.5, 0.975], axis=0)
    rows = {n: (float(m), float(a), float(b)) for n, m, a, b in zip(draws.names, middle, low, high, strict=True)}
    return whiskers(rows, ax, label="median and 95 % interval of the draws")


@plot.register
def dynamics_figure(model: DynamicsSection, ax: Axes | None = None) -> Axes:
    """Response to a unit step of the input, from rest."""
    ax = new_axes(ax)
    time = model.sample_time * np.arange(STEP)
    ax.plot(time, model.simulate(np.ones(STEP)), color=BLUE, drawstyle="steps-post")
    ax.set(xlabel="time [s]", ylabel=with_unit(model.output, model.unit_y), title=f"unit step of {model.input}")
    return ax


@plot.register
def drift_figure(found: Drift, ax: Axes | None = None, *, law: str | None = None) -> Axes:
    """Exponents of one law after each batch of edges, with two standard errors; ``law`` by default the first."""
    known = list(dict.fromkeys(row.response for row in found.rows))
    law = known[0] if law is None else law
    rows = [row for row in found.rows if row.response == law]
    if not rows:
        raise UsageError(f"law={law!r}: there are {', '.join(known)}.")
    ax = new_axes(ax)
    names = list(rows[0].estimates)
    for j, name in enumerate(names):
        value, se = np.array([row.estimates[name] for row in rows]).T
        at = np.arange(len(rows)) + 0.3 * ((j + 0.5) / len(names) - 0.5)
        ax.errorbar(at, value, 2 * se, fmt="o-", ms=4, lw=1, color=SERIES[j % len(SERIES)], label=name)
    ax.set_xticks(range(len(rows)), [f"{row.batch}\n{row.edges} edges" for row in rows])
    ax.set(ylabel="exponent ± 2 standard errors", title=f"law of {law} over batches")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.12 * (high - low))  # room for the legend
    ax.legend(loc="upper center", ncols=len(names), **LEGEND)
    return ax
