"""Figures of a law over its factors: profiles with intervals, interactions of two factors, contours."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from textwrap import fill
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..core.arrays import Array, Texts
from ..core.display import draw_figure
from ..core.errors import UsageError
from ..core.figure_style import BLUE, DOT, FILL, GREY, LINE, ORANGE, RED, SMALL, TEXT, THIN
from ..core.intervals import Kind
from ..core.plotting import axes_array, new_panels, to_pyplot
from ..core.rounding import format_plain, format_rounded
from ..core.suggestions import did_you_mean
from ..datasets.vocabulary import FLANK_WEAR
from .law_figures import contours_inside, label, middle, points, response_surface
from .lawfit import LawFit

OF_A_CURVE = 81  # points
SIDE = (2.7, 2.7)  # of a panel, inches
PER_INCH = 12  # letters of a heading
MOST_ACROSS = 4  # panels
LEVELS = (0.1, 0.5, 0.9)  # quantiles of the tested values of a factor at which curves are drawn
STYLES = ((GREY, ":"), (BLUE, "-"), (ORANGE, "--"))


def profile(
    law: LawFit, ax: Axes | None = None, *, factor: str | None = None, at: Mapping[str, float] | None = None,
    level: float = 0.95,
) -> Axes | Texts:  # fmt: skip
    """Prediction over each factor in its tested range, the others held: the law, its interval, that of one new row.

    Parameters
    ----------
    law : LawFit
    ax : Axes, optional
        Only with ``factor``, or for a law of one factor.
    factor : str, optional
        One factor instead of all.
    at : mapping of str to float, optional
        Values at which factors are held, in their units; the middle of the tested range otherwise.
    level : float
        Of the intervals.

    Returns
    -------
    Axes, or ndarray of Axes, shape (k,), one for each factor. Curves are dashed outside the tested region; dots are
    the rows, moved along the law to the values at which the other factors are held.

    Raises
    ------
    UsageError
        No such factor, or several panels for one ``ax``.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> [panel.get_xlabel() for panel in profile(law, at={"V": 120.0})]
    ['V [m/min]', 'f [mm/rev]', 'd [mm]', 't [min]']
    """
    names = law.factors if factor is None else (known_factor(law, factor),)
    if ax is not None and len(names) > 1:
        raise UsageError(f"profile of {law.response} has {len(names)} panels, and ax is one: name a factor or omit ax.")
    held = held_at(law, at or {})
    panels = [ax] if ax is not None else new_panels(len(names), MOST_ACROSS, SIDE, share_y=True)
    for panel, name in zip(panels, names, strict=True):
        _profile(law, name, held, level, panel)
    panels[0].set_ylabel(label(law, law.response))
    panels[0].legend()
    _headed(panels, _value_at(law, held, level), law, alone=ax is not None)
    return panels[0] if len(panels) == 1 else axes_array(panels)


def profiles(laws: Sequence[LawFit], at: Mapping[str, float] | None = None) -> Texts:
    """Profiles of several laws: a row of panels for each, a column for each of their factors.

    Parameters
    ----------
    laws : sequence of LawFit
    at : mapping of str to float, optional
        Values at which factors are held; those that a law does not have are left out.
    """
    names = list(dict.fromkeys(name for law in laws for name in law.factors))
    panels = np.array(new_panels(len(laws) * len(names), len(names), SIDE), dtype=object).reshape(len(laws), -1)
    for law, row in zip(laws, panels, strict=True):
        held = held_at(law, {name: value for name, value in (at or {}).items() if name in law.factors})
        for panel, name in zip(row, names, strict=True):
            if name in law.factors:
                _profile(law, name, held, 0.95, panel)
                panel.set_ylabel(label(law, law.response))
            else:
                panel.set_axis_off()
        row[0].set_title(_value_at(law, held, 0.95, short=True), fontsize=SMALL, loc="left")
    wear = any(name in FLANK_WEAR for law in laws for name in law.factors)
    marked(
        row[0], laws[0], f"Each factor with the others held at the dotted lines{', wear among them' if wear else ''}"
    )
    return axes_array([panel for panel in panels.ravel() if panel.axison])


def figure_of_laws(laws: Sequence[LawFit], kind: str, ax: Axes | None, options: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """A kind of figure of several laws, known to pyplot: a panel for each, or a row of panels.

    Raises
    ------
    UsageError
        No such kind or option, or a figure of one law alone.
    """
    of_one_law = kind in ("interactions", "profile") or ax is not None
    if kind == "profile" and ax is None and "factor" not in options:
        return to_pyplot(profiles(laws, **options))
    if of_one_law:
        names = ", ".join(law.response for law in laws)
        raise UsageError(f"{kind} of {len(laws)} laws ({names}): name one, for instance law={laws[0].response!r}.")
    panels = new_panels(len(laws), 3, (4.4, 6.4 if kind == "checks" else 3.9))
    for law, panel in zip(laws, panels, strict=True):
        draw_figure(law, kind, panel, **options)
        _with_response(panel, law)
    marked(panels[0], laws[0])
    return to_pyplot(axes_array(panels))


def _with_response(panel: Axes, law: LawFit) -> None:
    """Put the response before the title of a panel, unless it is in it."""
    title = panel.get_title()
    panel.set_title(title if law.response in title else f"{law.response}; {title}", fontsize=TEXT)


def note_below(drawn: Any, words: str) -> None:  # noqa: ANN401  Axes, or an array of them
    """Write a caution below the axes of a figure."""
    if words:
        figure: Any = np.ravel(drawn)[0].figure.figure
        words = fill(words, int(PER_INCH * figure.get_figwidth()))
        figure.supxlabel(words, fontsize=SMALL, color=RED, x=0.01, ha="left")


def _profile(law: LawFit, name: str, held: Mapping[str, float], level: float, ax: Axes) -> None:
    logs = dict(zip(law.factors, law.formula.logs, strict=True))[name]
    x = (np.geomspace if logs else np.linspace)(*law.domain[name], OF_A_CURVE)
    new = {**held_columns(law, held, len(x)), name: x}
    value = np.asarray(law.values(new))
    inside = law.region.inside(new)
    if law.rows is not None:
        _rows(law.rows.side, law.X[:, law.factors.index(name)], _moved(law, name, held), ax)
    if not law.no_interval:
        for kind, alpha, words in (("prediction", FILL, "one new row"), ("mean", 2 * FILL, "the law")):
            band = law.predict(new, cast(Kind, kind), level=level)
            ax.fill_between(x, band.low, band.high, where=inside, color=BLUE, alpha=alpha, lw=0,
                            label=f"{100 * level:g} % of {words}")  # fmt: skip
    ax.plot(x, np.where(inside, value, np.nan), color=ORANGE, lw=LINE)
    if not inside.all():
        ax.plot(x, value, color=GREY, lw=THIN, ls="--", zorder=1, label="outside the tested region")
    ax.axvline(held[name], color=GREY, lw=THIN, ls=":")
    ax.set_xlabel(label(law, name))


def _rows(side: NDArray[np.int8] | None, x: Array, y: Array, ax: Axes) -> None:
    """Rows as dots; a life known by a bound alone as an arrow towards the side on which it lies."""
    if side is None:
        points(ax, x, y)
        return
    points(ax, x[side == 0], y[side == 0])
    for which, marker, words in ((1, "^", "longer (run-out)"), (-1, "v", "shorter")):
        if (side == which).any():
            ax.plot(x[side == which], y[side == which], marker, ms=DOT + 1, color=BLUE, ls="none", label=words)


def _moved(law: LawFit, name: str, held: Mapping[str, float]) -> Array:
    """Observed values (n,) moved along the law to the held values of all factors but ``name``."""
    there = np.asarray(law.values({**held_columns(law, held, law.nobs), name: law.X[:, law.factors.index(name)]}))
    moved = law.observed * there / law.fitted if law.formula.logarithmic else law.observed + there - law.fitted
    return np.asarray(moved)


def interactions(
    law: LawFit, ax: Axes | None = None, *, over: tuple[str, str] | None = None, at: Mapping[str, float] | None = None
) -> Axes | Texts:
    """Prediction over one factor at three tested values of another, for each pair of factors.

    Parameters
    ----------
    law : LawFit
    ax : Axes, optional
        Only with ``over``, or for a law of two factors.
    over : tuple of two str, optional
        The factor of the axis and the factor of the curves.
    at : mapping of str to float, optional
        Values at which the other factors are held; the middle of the tested range otherwise.

    Returns
    -------
    Axes, or ndarray of Axes, one for each pair. Curves end at the border of the tested region.

    Raises
    ------
    UsageError
        A law of one factor, no such factor, or several panels for one ``ax``.
    """
    pairs = list(combinations(law.factors, 2)) if over is None else [pair_of(law, over)]
    if not pairs:
        raise UsageError(f"{law.response}: a law of one factor has no interactions; plot its profile.")
    if ax is not None and len(pairs) > 1:
        raise UsageError(
            f"interactions of {law.response} have {len(pairs)} panels, and ax is one: give over, or omit ax."
        )
    held = held_at(law, at or {})
    panels = [ax] if ax is not None else new_panels(len(pairs), 3, (3.1, 2.8))
    for panel, pair in zip(panels, pairs, strict=True):
        _interaction(law, pair, held, panel)
    none = all(sum(map(bool, term.degrees)) < 2 for term in law.formula.all_terms)
    heading = f"{law.response} over one factor at tested values of another"
    heading += f"; the form {law.form.replace('_', ' ')} has no products of factors" if none else ""
    _headed(panels, heading, law, alone=ax is not None)
    return panels[0] if len(panels) == 1 else axes_array(panels)


def _interaction(law: LawFit, pair: tuple[str, str], held: Mapping[str, float], ax: Axes) -> None:
    logs = dict(zip(law.factors, law.formula.logs, strict=True))[pair[0]]
    x = (np.geomspace if logs else np.linspace)(*law.domain[pair[0]], OF_A_CURVE)
    unit = law.units.get(pair[1], "")
    for value, (colour, style) in zip(_tested(law, pair[1]), STYLES, strict=False):
        new = {**held_columns(law, held, len(x)), pair[0]: x, pair[1]: np.full(len(x), value)}
        y = np.where(law.region.inside(new), np.asarray(law.values(new)), np.nan)
        ax.plot(x, y, color=colour, ls=style, lw=LINE, label=f"{pair[1]} {value:.3g} {unit}".rstrip())
    ax.set(xlabel=label(law, pair[0]), ylabel=label(law, law.response))
    ax.legend()


def _tested(law: LawFit, name: str) -> list[float]:
    """Tested values of a factor, low, middle and high; of a law without rows the ends and middle of its range."""
    if law.rows is None:
        low, high = law.domain[name]
        return [low, middle((low, high), logs=low > 0), high]
    x = law.X[:, law.factors.index(name)]
    return list(map(float, np.unique(np.quantile(x, LEVELS, method="nearest"))))


def contours(law: LawFit, ax: Axes | None = None, *, over: tuple[str, str] | None = None) -> Axes:
    """Contours over two factors inside the tested region, the others at the middle of their ranges.

    ``over`` names the two, by default the first two of the law; a law of one factor is a curve with its interval.
    """
    if over is None and len(law.factors) == 1:
        return response_surface(law, ax)
    return contours_inside(law, pair_of(law, over or law.factors[:2]), ax)


def known_factor(law: LawFit, name: str) -> str:
    """A factor of the law by its name.

    Raises
    ------
    UsageError
        There is none; the message names the factors.
    """
    if name in law.factors:
        return name
    raise UsageError(f"{name!r} is no factor of {law.response}. {did_you_mean(name, law.factors, names='There are ')}")


def pair_of(law: LawFit, over: Sequence[str]) -> tuple[str, str]:
    """Two different factors of the law.

    Raises
    ------
    UsageError
        Not two, or not of the law.
    """
    if isinstance(over, str) or len(over) != 2 or over[0] == over[1]:
        raise UsageError(f"over={over!r}: name two factors of {law.response}, for instance {law.factors[:2]!r}.")
    return known_factor(law, over[0]), known_factor(law, over[1])


def held_at(law: LawFit, at: Mapping[str, float]) -> dict[str, float]:
    """A value for each factor: the given one, or the middle of its tested range.

    Raises
    ------
    UsageError
        A name that is no factor, or no number above zero where the law takes its logarithm.
    """
    if not isinstance(at, Mapping):
        raise UsageError(f"at={at!r:.60}: give a value for each factor to be held, for instance {{'V': 120}}.")
    logs = dict(zip(law.factors, law.formula.logs, strict=True))
    for name, value in at.items():
        known_factor(law, name)
        if not (isinstance(value, int | float) and np.isfinite(value) and (value > 0 or not logs[name])):
            raise UsageError(f"at: {name} {value!r} is no value of this factor; tested {_range(law, name)}.")
    return {name: float(at.get(name, middle(law.domain[name], logs[name]))) for name in law.factors}


def _range(law: LawFit, name: str) -> str:
    low, high = law.domain[name]
    return f"{low:.4g} to {high:.4g} {law.units.get(name, '')}".rstrip()


def held_columns(law: LawFit, held: Mapping[str, float], n: int) -> dict[str, NDArray[np.generic]]:
    """Held values as columns (n,), and the reference level of the category."""
    columns: dict[str, NDArray[np.generic]] = {name: np.full(n, value) for name, value in held.items()}
    return columns if law.by is None else {**columns, law.by.column: np.full(n, law.by.reference)}


def _value_at(law: LawFit, held: Mapping[str, float], level: float, *, short: bool = False) -> str:
    """The prediction at the held values in words, with the interval of one new row."""
    at = pd.DataFrame(held_columns(law, held, 1))
    place = ", ".join(f"{name} {value:.3g} {law.units.get(name, '')}".rstrip() for name, value in held.items())
    place += f", {law.by.column} {law.by.reference}" if law.by else ""
    unit = law.units.get(law.response, "")
    if law.no_interval:
        return f"{law.response} {format_plain(float(law.values(at)[0]), 4)} {unit} at {place}; no interval"
    value, low, high = law.predict(at, level=level).to_frame().to_numpy(dtype=float)[0, :3]
    half = (high - low) / 2
    texts = [format_rounded(x, min(half, low) if low > 0 else half)[0] for x in (value, low, high)]
    words = f"{law.response} {texts[0]} {unit}, {100 * level:g} % {texts[1]} to {texts[2]}".replace(" ,", ",")
    return words if short else f"{words} for one new row, at {place}"


def not_measured(law: LawFit) -> str:
    """The mark of a law whose data were simulated; empty where they were measured or it is not known."""
    return "simulated tests, not measured" if law.source is not None and law.source.simulated else ""


def _headed(panels: Sequence[Axes], heading: str, law: LawFit, *, alone: bool) -> None:
    """A heading over the panels, and the mark of data that were not measured."""
    if alone:
        panels[0].set_title(fill("; ".join(filter(None, (heading, not_measured(law)))), 60), fontsize=SMALL)
    else:
        marked(panels[0], law, heading)


def marked(ax: Axes, law: LawFit, heading: str = "") -> None:
    """Write a heading over the figure of axes, and that the data of the law were simulated."""
    figure: Any = ax.figure.figure
    if text := "; ".join(filter(None, (heading, not_measured(law)))):
        figure.suptitle(fill(text, int(PER_INCH * figure.get_figwidth())), fontsize=TEXT)
