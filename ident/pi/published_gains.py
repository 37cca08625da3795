"""Interpretations of published PI gains: where each is stable, and where it meets a specification.

Kp 160 and Ki 0.006 are undefined without form, units, sample time and scaling: each interpretation is another
controller.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, Flags
from ...core.display import Displayable, Plottable
from ...core.errors import IdentError, UsageError
from ...core.threads import one_thread
from ..model import Model
from .feasible_region import horizon
from .figures_of_merit import specified_figures
from .gains import Form, PiGains
from .loops import loops_of, stable_columns
from .specification import Specification

if TYPE_CHECKING:
    import pandas as pd

Interval = tuple[float, float]
SCALES = 600  # logarithmically spaced scalings
BISECTIONS = 16  # of a step of that grid: to 1e-6
DECADES = 4.0  # of scalings to each side of max |kp G| = 1


@dataclass(frozen=True, slots=True, repr=False)
class Interpretation(Displayable):
    """One interpretation of two published numbers.

    Attributes
    ----------
    words : str
        Form, unit of kp and unit of ki.
    gains : PiGains
        In units of the command.
    scaled : bool
        Whether the command has another unit than the model's input, with an unknown scaling.
    stable, meets : tuple of (low, high)
        Intervals of the scaling, units of the command per unit of the model's input, in which the loop is stable, and
        meets the specification; without scaling ((1, 1),) or empty.
    """

    words: str
    gains: PiGains
    scaled: bool
    stable: tuple[Interval, ...]
    meets: tuple[Interval, ...]


@dataclass(frozen=True, slots=True, repr=False)
class PiCheck(Plottable):
    """Interpretations of two published gains.

    Attributes
    ----------
    kp, ki : float
        As published.
    specification : Specification
    interpretations : tuple of Interpretation
    command_unit : str
        Command unit of the scaled interpretations.
    input_unit : str
    duration : float
        Of the simulated steps, s.
    """

    kp: float
    ki: float
    specification: Specification
    interpretations: tuple[Interpretation, ...]
    command_unit: str
    input_unit: str
    duration: float

    @property
    def table(self) -> "pd.DataFrame":
        """One row per interpretation: where it is stable, and where it meets the specification."""
        import pandas as pd

        rows = [
            (r.words, intervals_text(r.stable, r.scaled), intervals_text(r.meets, r.scaled))
            for r in self.interpretations
        ]
        unit = f"{self.command_unit} per {self.input_unit}"
        return pd.DataFrame(rows, columns=["interpretation", f"stable ({unit})", f"meets the specification ({unit})"])

    @property
    def verdict(self) -> str:
        """The verdict: the interpretations that can meet the specification."""
        good = [r for r in self.interpretations if r.meets]
        head = f"Kp {self.kp:g}, Ki {self.ki:g}, {len(self.interpretations)} interpretations"
        if not good:
            return f"{head}: none meets the specification ({self.specification})."
        scaling = f" {self.command_unit} per {self.input_unit}"
        ways = "; ".join(
            f"{r.words}" + (f" at {intervals_text(r.meets, True)}{scaling}" if r.scaled else "") for r in good
        )
        return f"{head}: {len(good)} can meet the specification ({self.specification}): {ways}."


def intervals_text(intervals: Sequence[Interval], scaled: bool) -> str:
    """Text of the intervals of a scaling."""
    if not intervals:
        return "none" if scaled else "no"
    if not scaled:
        return "yes"
    return ", ".join(
        f"{low:.4g} and above" if np.isinf(high) else f"{low:.4g} to {high:.4g}" for low, high in intervals
    )


@one_thread
def check_pi(
    model: Model,
    kp: float,
    ki: float,
    rise_time: float | None = None,
    settling_time: float | None = None,
    *,
    specification: Specification | None = None,
    controller: PiGains | None = None,
    command_unit: str = "mm/min",
) -> PiCheck:
    """Interpretations of a published Kp and Ki, with the scalings at which each is stable and meets a specification.

    Parameters
    ----------
    model : Model
        From input (V, say) to output (A).
    kp, ki : float
        As published; ``ki`` is taken per second, per sample, and as an integral time in seconds and in minutes.
    rise_time, settling_time : float, optional
        s; or give a ``specification``.
    controller : PiGains, optional
        Integration, delay, filter; by default backward at the sample time of the model.
    command_unit : str
        Unit of the command where it is not that of the model's input: its scaling is searched.

    Raises
    ------
    IdentError
        No specification, or gains not above zero.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.2], a=[1.0, -0.8], nk=1, sample_time=0.1, unit_u="V", unit_y="A")
    >>> check = check_pi(model, 100.0, 20.0, rise_time=2.0, settling_time=4.0)
    >>> check.interpretations[6].words
    'position form, Kp in mm/min per A, Ki per second'
    """
    if specification is not None and (rise_time is not None or settling_time is not None):
        raise UsageError("rise_time and settling_time in addition to a specification: include them in it.")
    limits = Specification(rise_time, settling_time) if specification is None else specification
    if not any(True for _ in limits.active()):
        raise IdentError("no limits: give rise_time, settling_time or a specification.")
    if not (np.isfinite([kp, ki]).all() and kp > 0 and ki > 0):
        raise IdentError(f"Kp {kp!r}, Ki {ki!r}: two numbers above zero.")
    base = PiGains(0.0, 0.0, model.sample_time) if controller is None else controller
    time = horizon(model, limits)
    u, y = model.unit_u or "input", model.unit_y or "output"
    interpretations = []
    for unit, scaled in ((u, False), (command_unit, True)):
        for words, gains in interpretations_of(kp, ki, base, f"{unit} per {y}"):
            interpretations.append(interpretation(model, limits, words, gains, scaled, time))
    return PiCheck(kp, ki, limits, tuple(interpretations), command_unit, u, time)


def interpretations_of(kp: float, ki: float, base: PiGains, unit: str) -> list[tuple[str, PiGains]]:
    """Forms and units of two published numbers."""
    T = base.sample_time
    of_ki = {"per second": ki, "per sample": ki / T}
    of_ti = {f"integral time {ki:g} s": kp / ki, f"integral time {ki:g} min": kp / (60 * ki)}
    forms: tuple[tuple[str, Form, dict[str, float]], ...] = (
        ("position form", "position", {f"Ki {k}": v for k, v in of_ki.items()}),
        ("incremental, u(k) = u(k-1) + Kp e + Ki sum e", "incremental_sum", {f"Ki {k}": v for k, v in of_ki.items()}),
        ("position form", "position", of_ti),
    )
    return [
        (f"{words}, Kp in {unit}, {how}", replace(base, form=form, kp=kp, ki=value))
        for words, form, meanings in forms
        for how, value in meanings.items()
    ]


def interpretation(
    model: Model, limits: Specification, words: str, gains: PiGains, scaled: bool, duration: float
) -> Interpretation:
    """One interpretation, and where it is stable and meets the specification."""

    def stable(scale: Array) -> Flags:
        kp, ki = gains.kp / scale, gains.ki / scale
        return stable_columns(loops_of(model, kp, ki, gains).characteristic)

    def meets(scale: Array) -> Flags:
        kp, ki = gains.kp / scale, gains.ki / scale
        return limits.worst(specified_figures(model, kp, ki, gains, duration, limits)) <= 0

    if not scaled:
        one = np.ones(1)
        found = [((1.0, 1.0),) if good(one)[0] else () for good in (stable, meets)]
        return Interpretation(words, gains, scaled, *found)
    heights = np.abs(model.response(np.geomspace(1e-3, 1, 200) / (2 * model.sample_time)))
    scale = gains.kp * float(heights.max()) * np.logspace(-DECADES, DECADES, SCALES)
    return Interpretation(words, gains, scaled, intervals(stable, scale), intervals(meets, scale))


def intervals(good: Callable[[Array], Flags], scale: Array) -> tuple[Interval, ...]:
    """Intervals of admissible scalings, their ends by bisection between two scalings of the grid."""
    first = good(scale)
    change = np.flatnonzero(np.diff(first))
    inside, outside = (np.where(first[change] == side, scale[change], scale[change + 1]) for side in (True, False))
    for _ in range(BISECTIONS if len(change) else 0):
        middle = np.sqrt(inside * outside)
        fine = good(middle)
        inside, outside = np.where(fine, middle, inside), np.where(fine, outside, middle)
    ends = [*([0.0] if first[0] else []), *inside.tolist(), *([np.inf] if first[-1] else [])]
    return tuple((float(a), float(b)) for a, b in zip(ends[::2], ends[1::2], strict=True))
