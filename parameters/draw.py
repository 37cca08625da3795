"""Pictures from a parameter file alone; the only file of the room that imports matplotlib."""

from typing import TYPE_CHECKING

import numpy as np

from ..core.display import with_unit
from ..core.plotting import BLUE, new_axes, whiskers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .draws import Draws
    from .file import ParameterFile
    from .prediction import Prediction
    from .sections.dynamics import DynamicsSection
    from .sections.law import LawSection

STEP = 200  # samples
Rows = dict[str, tuple[float, float, float]]


def _slopes(law: "LawSection", name: str = "") -> Rows:
    """Coefficients but the constant, within two standard errors."""
    rows: Rows = {}
    for symbol, value in list(law.coefficients.items())[1:]:
        half = 2 * law.standard_errors.get(symbol, np.nan)
        rows[f"{name}{symbol}"] = (value, value - half, value + half)
    return rows


def law_picture(law: "LawSection", ax: "Axes | None" = None) -> "Axes":
    """What each factor does."""
    return whiskers(_slopes(law), ax, label="coefficient ± 2 standard errors", title=law.equation)


def file_picture(pf: "ParameterFile", ax: "Axes | None" = None) -> "Axes":
    """What each factor does in each law."""
    rows: Rows = {}
    for response, law in pf.laws.items():
        rows |= _slopes(law, f"{response}: ")
    return whiskers(
        rows, ax, label="coefficient ± 2 standard errors", title=f"{pf.identity.tool} on {pf.identity.work}"
    )


def prediction_picture(found: "Prediction", ax: "Axes | None" = None) -> "Axes":
    """Each point within its interval."""
    ends = zip(*(np.ravel(np.asarray(v, dtype=float)) for v in (found.value, found.low, found.high)), strict=True)
    rows = {str(k + 1): (float(v), float(low), float(high)) for k, (v, low, high) in enumerate(ends)}
    return whiskers(rows, ax, label=with_unit(found.response, found.unit), title=found.of)


def draws_picture(draws: "Draws", ax: "Axes | None" = None) -> "Axes":
    """The middle 95 % of each parameter."""
    low, middle, high = np.quantile(draws.values, [0.025, 0.5, 0.975], axis=0)
    rows = {n: (float(m), float(a), float(b)) for n, m, a, b in zip(draws.names, middle, low, high, strict=True)}
    return whiskers(rows, ax, label="middle 95 % of the draws")


def dynamics_picture(model: "DynamicsSection", ax: "Axes | None" = None) -> "Axes":
    """Response to a unit step of the input, from rest."""
    ax = new_axes(ax)
    time = model.sample_time * np.arange(STEP)
    ax.plot(time, model.simulate(np.ones(STEP)), color=BLUE, drawstyle="steps-post")
    ax.set(xlabel="time [s]", ylabel=with_unit(model.output, model.unit_y), title=f"unit step of {model.input}")
    return ax
