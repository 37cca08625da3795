"""Figures of merit of many loops at once: over a grid of (kp, ki), and over several models."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.errors import UsageError
from ..model import Model
from .gains import PiGains
from .loops import loops_of, noise_size, split, stable_columns
from .margins import margin_figures
from .specification import LIMITS, Specification, table_of
from .step_metrics import step_figures

# Values of an unstable loop: infinite errors, no margins.
UNSTABLE = {
    "stable": False, "rise_time": np.inf, "settling_time": np.inf, "overshoot": np.inf, "undershoot": np.inf,
    "steady_error": np.inf, "ms": np.inf, "mt": np.inf, "phase_margin": 0.0, "gain_margin": 1.0, "crossover": 0.0,
    "delay_margin": 0.0, "travel": np.inf, "peak_u": np.inf, "noise_gain": np.inf, "disturbance_peak": np.inf,
    "disturbance_iae": np.inf, "iae": np.inf,
}  # fmt: skip
MARGINS = frozenset({"ms", "mt", "phase_margin", "gain_margin", "crossover", "delay_margin"})
LARGEST = 10_000_000  # samples of one step


def figures_on_grid(
    model: Model | Sequence[Model],
    kp: ArrayLike,
    ki: ArrayLike,
    template: PiGains,
    duration: float,
    *,
    margins: bool = True,
) -> dict[str, Array]:
    """Figures of merit (see `FiguresOfMerit`) for every pair of gains, by name.

    Parameters
    ----------
    model : Model or sequence of Model
    kp, ki : array-like, shape (m,)
        Pairs, in the units of ``template``; for a map give the flattened grid.
    template : PiGains
        Everything else of the controller; its own gains do not matter.
    duration : float
        Of the steps, s. What does not happen within it is infinite.
    margins : bool
        Include sensitivity peaks and margins: over hundreds of plants they take most of the time.

    Returns
    -------
    dict of ndarray, shape (m,), or (number of models, m) for a sequence
        ``stable`` is boolean. Unstable loops have infinite errors and no margin.

    Raises
    ------
    UsageError, IdentError
        Pairs that do not match, a duration below one sample; another sample time, a loop without delay.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.2], a=[1.0, -0.8], nk=1, sample_time=0.1)
    >>> table = figures_on_grid(model, [0.5, 20.0], [0.5, 0.5], PiGains(1.0, 1.0, 0.1), duration=20.0)
    >>> table["stable"].tolist(), table["settling_time"].round(2).tolist()
    ([True, False], [9.5, inf])
    """
    loops = loops_of(model, kp, ki, template)
    n = _samples(duration, template.sample_time)
    table = {name: np.full(len(loops), value) for name, value in UNSTABLE.items() if margins or name not in MARGINS}
    for where, part in split(loops):
        characteristic = part.characteristic
        good = stable_columns(characteristic)
        if not good.any():
            continue
        kept = part[good]
        found = {"stable": np.ones(len(kept), dtype=bool), **step_figures(kept, n)}
        found["noise_gain"] = noise_size(kept.noise_numerator, characteristic[:, good])
        if margins:
            found |= margin_figures(kept)
        for name, values in found.items():
            table[name][where[good]] = values
    if isinstance(model, Model):
        return table
    return {name: values.reshape(len(model), -1) for name, values in table.items()}


def _samples(duration: float, T: float) -> int:
    n = duration / T
    if not 1 <= n <= LARGEST:
        raise UsageError(f"duration {duration!r} s at {T:g} s a sample: between one and {LARGEST} samples.")
    return round(n) + 1


def specified_figures(
    model: Model | Sequence[Model],
    kp: ArrayLike,
    ki: ArrayLike,
    template: PiGains,
    duration: float,
    specification: Specification,
    *more: str,
) -> dict[str, Array]:
    """FiguresOfMerit that a specification limits, and the integral time; margins only where it or ``more`` names one.

    Shapes as of `figures_on_grid`: (m,), or (number of models, m) for a sequence.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.2], a=[1.0, -0.8], nk=1, sample_time=0.1)
    >>> limits = Specification(rise_time=2.0)
    >>> table = specified_figures(model, [0.5, 20.0], [0.5, 0.5], PiGains(1.0, 1.0, 0.1), 20.0, limits)
    >>> table["stable"].tolist(), "ms" in table
    ([True, False], False)
    """
    wanted = {LIMITS[name].figure for name, _, _ in specification.active()} | set(more)
    table = figures_on_grid(model, kp, ki, template, duration, margins=bool(wanted & MARGINS))
    return table_of(table, kp, ki)
