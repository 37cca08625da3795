"""Specifications: limits on the figures of merit of a loop, each of them optional."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.display import Display, Displayable, facts_of
from ...core.errors import IdentError

T = TypeVar("T", float, Array)
PER_OUTPUT, PER_COMMAND = ("travel", "peak_u", "noise_gain"), ("disturbance_peak", "disturbance_iae")  # units
STEADY = 1e-6  # of the step: the steady-state error with integral action is rounding
ROUNDING = 1e-9  # of a limit: smaller violations are rounding


@dataclass(frozen=True, slots=True, repr=False)
class FigureLimit(Displayable):
    """One kind of limit: ``figure`` must not exceed it, or not fall below it where ``above``."""

    figure: str
    words: str
    unit: str = ""
    above: bool = False
    least: float = 0.0  # the limit itself must exceed this
    zero_allowed: bool = False
    scale: float = 1.0  # printed as figure times scale


LIMITS = {
    "rise_time": FigureLimit("rise_time", "rise time (10-90 %)", " s"),
    "settling_time": FigureLimit("settling_time", "settling time (2 %)", " s"),
    "overshoot": FigureLimit("overshoot", "overshoot", " %", zero_allowed=True, scale=100),
    "undershoot": FigureLimit("undershoot", "undershoot", " %", zero_allowed=True, scale=100),
    "ms": FigureLimit("ms", "maximum sensitivity Ms", least=1.0),
    "phase_margin": FigureLimit("phase_margin", "phase margin", " degrees", above=True),
    "gain_margin": FigureLimit("gain_margin", "gain margin (factor)", above=True, least=1.0),
    "disturbance": FigureLimit("disturbance_peak", "peak output after a unit load step"),
    "travel": FigureLimit("travel", "total variation of the command (unit reference step)"),
    "peak_u": FigureLimit("peak_u", "peak command (unit reference step)"),
    "noise_gain": FigureLimit("noise_gain", "noise gain (rms command per rms sensor noise)"),
    "integral_time": FigureLimit("integral_time", "integral time Ti", " s"),
    "steady_error": FigureLimit("steady_error", "steady-state error", " %", zero_allowed=True, scale=100),
}


@dataclass(frozen=True, slots=True, repr=False)
class LimitMargin(Displayable):
    """Margin of one loop to one limit, in the unit that is printed.

    Attributes
    ----------
    name : str
        As in `Specification`.
    value, limit : float
        Figure of the loop and its limit, in ``unit``.
    left : float or None
        Share of the limit that is left, negative where it is violated; None for a limit of zero.
    missed : float or None
        Share of the draws that violate the limit; None without draws.
    words, unit, side : str
        Name and unit in words; ``<=``, or ``>=`` for a lower limit.
    """

    name: str
    value: float
    limit: float
    left: float | None
    missed: float | None
    words: str
    unit: str = ""
    side: str = "<="

    @property
    def row(self) -> tuple[str, str, str, str, str]:
        """Cells of a table: words, value, limit, share left, share of draws that violate it."""
        if self.name == "steady_error" and self.limit <= 100 * STEADY:
            value, limit = ("none" if abs(self.value) <= self.limit else f"{self.value:.3g}{self.unit}"), "none"
        else:
            value, limit = f"{self.value:.4g}{self.unit}", f"{self.side} {self.limit:.4g}{self.unit}"
        left = "" if self.left is None or self.name == "steady_error" else _percent(self.left)
        return self.words, value, limit, left, "" if self.missed is None else _percent(self.missed)


def _percent(share: float) -> str:
    """A share in per cent with two digits, at least hundredths."""
    return "infinite" if np.isinf(share) else f"{100 * share:.0f} %" if abs(share) >= 0.1 else f"{100 * share:.2g} %"


@dataclass(frozen=True, slots=True, repr=False)
class Specification(Displayable):
    """Limits on the unit step of the reference and on the loop; ``None`` for no limit.

    Attributes
    ----------
    rise_time : float, optional
        s at most, 10-90 %.
    settling_time : float, optional
        s at most, until the output stays within 2 %.
    overshoot, undershoot : float, optional
        At most, as fractions of the step: 0.02 is 2 %. Undershoot is the excursion below zero.
    ms : float, optional
        Maximum sensitivity at most, above 1; 1.3 is conservative, 2 is the usual upper bound.
    phase_margin : float, optional
        Degrees at least.
    gain_margin : float, optional
        Factor, at least, above 1.
    disturbance : float, optional
        Largest deviation of the output after a unit step of load, in units of the output per unit of input, at most.
    travel, peak_u : float, optional
        Total variation and peak of the command on a unit step of the reference, in units of input per unit of output,
        at most.
    noise_gain : float, optional
        rms of the command over rms of white sensor noise, at most, in units of input per unit of output.
    integral_time : float, optional
        s at most, Kp over Ki: errors decay with this time constant.
    steady_error : float, optional
        Absolute steady-state error of the unit step, at most.

    Examples
    --------
    >>> print(Specification(rise_time=2.0, settling_time=4.0, overshoot=0.02))
    rise time (10-90 %) <= 2 s, settling time (2 %) <= 4 s, overshoot <= 2 %
    """

    rise_time: float | None = None
    settling_time: float | None = None
    overshoot: float | None = None
    undershoot: float | None = None
    ms: float | None = None
    phase_margin: float | None = None
    gain_margin: float | None = None
    disturbance: float | None = None
    travel: float | None = None
    peak_u: float | None = None
    noise_gain: float | None = None
    integral_time: float | None = None
    steady_error: float | None = None

    def __post_init__(self) -> None:
        for name, limit, value in self.active():
            least = limit.least * limit.scale
            if not (np.isfinite(value) and (value > limit.least or (limit.zero_allowed and value == 0))):
                from_ = f"{least:g} or more" if limit.zero_allowed else f"above {least:g}"
                hint = " (a fraction: 0.02 is 2 %)" if limit.scale == 100 else ""
                raise IdentError(f"{name} {value!r} of a specification: a number {from_}{hint}, or omit it.")
            if limit.scale == 100 and value > 1:
                raise IdentError(f"{name} {value:g} of a specification: a fraction of at most 1, as 0.05 for 5 %.")
        if self.rise_time is not None and self.settling_time is not None and self.settling_time < 0.8 * self.rise_time:
            raise IdentError(
                f"settling_time {self.settling_time:g} s is shorter than 0.8 times the rise_time {self.rise_time:g} s: "
                "settling includes the rise. Were they interchanged?"
            )

    def active(self) -> Iterator[tuple[str, FigureLimit, float]]:
        """Name, kind and value of each active limit."""
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None:
                yield f.name, LIMITS[f.name], float(value)

    def violations(self, figures: Any) -> dict[str, Array]:  # noqa: ANN401  figures of one loop or of a grid
        """Relative violation of each limit, by name; 0 where it is met, infinite for an unstable loop.

        ``figures`` are those of one loop or of a grid of loops; each array has their shape.
        """
        return {name: missed(limit, value, figures) for name, limit, value in self.active()}

    def worst(self, figures: Any) -> Array:  # noqa: ANN401
        """Largest violation over the limits, in the shape of the figures."""
        unstable = np.where(np.asarray(figure_of(figures, "stable")), 0.0, np.inf)
        return np.asarray(np.maximum.reduce([unstable, *self.violations(figures).values()]), dtype=np.float64)

    def in_units(self, factor: float) -> "Specification":
        """The same limits with the command in another unit, ``factor`` new units per old unit."""
        values = {LIMITS[name].figure: value for name, _, value in self.active()}
        scaled = in_units(values, factor)
        return replace(self, **{name: scaled[LIMITS[name].figure] for name, _, _ in self.active()})

    def misses(self, figures: Any) -> list[str]:  # noqa: ANN401
        """A sentence for each limit that one loop violates, worst first."""
        if not bool(figure_of(figures, "stable")):
            return ["the closed loop is unstable"]
        found = [(float(v), name) for name, v in self.violations(figures).items() if v > 0]
        return [self.sentence(name, figures) for _, name in sorted(found, reverse=True)]

    def margins(self, figures: Any, missed: Mapping[str, float] | None = None) -> tuple[LimitMargin, ...]:  # noqa: ANN401
        """Margin of one loop to each limit; ``missed`` are shares of draws that violate it, by name.

        >>> figures = {"stable": True, "rise_time": 1.5}
        >>> [margin.row for margin in Specification(rise_time=2.0).margins(figures, {"rise_time": 0.04})]
        [('rise time (10-90 %)', '1.5 s', '<= 2 s', '25 %', '4 %')]
        """
        found = []
        for name, limit, value in self.active():
            figure = float(figure_of(figures, limit.figure))
            left = (figure - value if limit.above else value - figure) / abs(value) if value else None
            share = None if missed is None else missed.get(name)
            side = ">=" if limit.above else "<="
            scaled = limit.scale * figure, limit.scale * value
            found.append(LimitMargin(name, *scaled, left, share, limit.words, limit.unit, side))
        return tuple(found)

    def sentence(self, name: str, figures: Any) -> str:  # noqa: ANN401
        """Sentence on one violated limit."""
        limit = LIMITS[name]
        value, required = (limit.scale * float(v) for v in (figure_of(figures, limit.figure), getattr(self, name)))
        side = "below" if limit.above else "above"
        found = f"{value:.4g}{limit.unit}" if np.isfinite(value) else "infinite"
        return f"{limit.words} {found}, {side} the required {required:g}{limit.unit}"

    def _display(self) -> Display:
        return Display(str(self), tuple(facts_of(self)))

    def __str__(self) -> str:
        return ", ".join(limit_text(limit, value) for _, limit, value in self.active())


def in_units(figures: Mapping[str, T], factor: float) -> dict[str, T]:
    """Figures of merit by name with the command in another unit, ``factor`` new units per old unit.

    >>> in_units({"travel": 5.0, "disturbance_peak": 0.2, "ms": 1.3}, 100.0)
    {'travel': 500.0, 'disturbance_peak': 0.002, 'ms': 1.3}
    """
    powers = {**dict.fromkeys(PER_OUTPUT, factor), **dict.fromkeys(PER_COMMAND, 1 / factor)}
    return {name: value * powers[name] if name in powers else value for name, value in figures.items()}


def limit_text(limit: FigureLimit, value: float) -> str:
    """Text of one limit: rise time <= 2 s."""
    if limit.figure == "steady_error" and value <= STEADY:
        return "no steady-state error"
    return f"{limit.words} {'>=' if limit.above else '<='} {limit.scale * value:g}{limit.unit}"


def table_of(figures: Any, kp: ArrayLike, ki: ArrayLike) -> dict[str, Array]:  # noqa: ANN401  of one loop or of a grid
    """Figures by name, with the integral time of their gains."""
    table = figures if isinstance(figures, Mapping) else {f.name: getattr(figures, f.name) for f in fields(figures)}
    kp, ki = np.asarray(kp, dtype=np.float64), np.asarray(ki, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        ti = np.where(kp == 0, 0.0, np.abs(kp / ki))
    shape = np.shape(table["stable"])
    return {**{name: np.asarray(v) for name, v in table.items()}, "integral_time": np.broadcast_to(ti, shape)}


def figure_of(figures: Any, name: str) -> Any:  # noqa: ANN401
    """One figure of a loop, or one array of a table of loops."""
    return figures[name] if isinstance(figures, Mapping) else getattr(figures, name)


def missed(limit: FigureLimit, value: float, figures: Any) -> Array:  # noqa: ANN401
    """Relative violation of one limit; for a limit of zero, in hundredths of the step."""
    figure = np.asarray(figure_of(figures, limit.figure), dtype=np.float64)
    figure = np.abs(figure) if limit.figure == "steady_error" else figure
    over = (value - figure if limit.above else figure - value) / (abs(value) or 0.01)
    over = np.where(np.isnan(over), np.inf, over)
    return np.where(over <= ROUNDING, 0.0, over)
