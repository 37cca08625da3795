"""All figures of many loops at once: the map of (kp, ki), and of several models."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import UsageError
from ..model import Model
from .gains import PiGains
from .loops import Loops, loops_of, split
from .margins import margin_figures
from .norms import noise_size, stable_columns
from .steps import step_figures

# What an unstable loop is given: every error infinite, every margin used up.
UNSTABLE = {
    "stable": False, "rise_time": np.inf, "settling_time": np.inf, "overshoot": np.inf, "undershoot": np.inf,
    "steady_error": np.inf, "ms": np.inf, "mt": np.inf, "phase_margin": 0.0, "gain_margin": 1.0, "crossover": 0.0,
    "delay_margin": 0.0, "travel": np.inf, "peak_u": np.inf, "noise_gain": np.inf, "disturbance_peak": np.inf,
    "disturbance_iae": np.inf, "iae": np.inf,
}  # fmt: skip
LARGEST = 10_000_000  # samples of one step


def figures_on_grid(
    model: Model | Sequence[Model], kp: ArrayLike, ki: ArrayLike, template: PiGains, duration: float
) -> dict[str, NDArray[np.float64]]:
    """Every figure of ``Figures`` for every pair of gains, by name.

    Parameters
    ----------
    model : Model or sequence of Model
    kp, ki : array-like, shape (m,)
        Pairs, in the units of ``template``; for a map give the flattened grid.
    template : PiGains
        Everything else of the controller; its own gains do not matter.
    duration : float
        Of the steps, s. What does not happen within it is infinite.

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
    table = {name: np.full(len(loops), value) for name, value in UNSTABLE.items()}
    for where, part in split(loops):
        good = stable_columns(part.characteristic)
        if good.any():
            for name, values in _stable_figures(part[good], n).items():
                table[name][where[good]] = values
    if isinstance(model, Model):
        return table
    return {name: values.reshape(len(model), -1) for name, values in table.items()}


def _stable_figures(loops: Loops, n: int) -> dict[str, NDArray[np.float64]]:
    noise = {"noise_gain": noise_size(loops.noise_numerator, loops.characteristic)}
    yes = {"stable": np.ones(len(loops), dtype=bool)}
    return yes | noise | margin_figures(loops) | step_figures(loops, n)


def _samples(duration: float, T: float) -> int:
    n = duration / T
    if not 1 <= n <= LARGEST:
        raise UsageError(f"duration {duration!r} s at {T:g} s a sample: between one and {LARGEST} samples.")
    return round(n) + 1
