"""The covariance of a model carried to its step response."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable, as_columns
from ...core.errors import IdentError
from ..estimators.filters import filtered, is_stable
from ..estimators.free_run import FreeRun, by_a_and_b
from ..model import Model
from .bands import DRAWS, LARGE, Method, covariance_of, draws_of, normal, with_theta

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

Array = NDArray[np.float64]
FEWEST = 0.9  # share of draws that must be stable before a band is told by them


@dataclass(frozen=True, slots=True, repr=False)
class StepBand(Displayable):
    """Response to a unit step of the input within its pointwise band.

    Attributes
    ----------
    time : ndarray, shape (T,), s
    step, low, high, error : ndarray, shape (T,), unit_y per unit_u
    level : float
    method : str
    """

    time: Array
    step: Array
    low: Array
    high: Array
    error: Array
    level: float
    method: str

    def to_frame(self) -> "DataFrame":
        """A row a sample, time in s."""
        return as_columns(self, "time", "step", "low", "high", "error").set_index("time")

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The step in its band."""
        from ..draw_responses import step_band_picture

        return step_band_picture(self, ax)


def step_band(
    model: Model, duration: float, level: float = 0.95, *, method: Method = "auto", seed: int = 1
) -> StepBand:
    """Response to a unit step with its band, from 0 to ``duration`` seconds.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, cov_params=np.diag([1e-4, 1e-4]))
    >>> band = step_band(model, 0.2)
    >>> band.step.tolist(), band.error.round(4).tolist()
    ([0.0, 0.5, 0.75], [0.0, 0.01, 0.0158])
    """
    if not (np.isfinite(duration) and duration >= model.sample_time):
        raise IdentError(f"duration {duration:g} s of a step response: one sample, {model.sample_time:g} s, or more.")
    if not model.stable:
        raise IdentError(f"step response of a model with a pole at radius {model.radius:.4g}: it grows without bound.")
    cov = covariance_of(model, level)
    n = int(duration / model.sample_time * (1 + 1e-9)) + 1
    step, slope = step_and_slope(model, n)
    error = np.sqrt(np.einsum("ti,ij,tj->t", slope, cov, slope))
    # a slow pole makes the far end bend long before the near end does: both are asked
    settled = max(float(np.abs(step).max()), np.finfo(float).tiny)
    drawn = method == "draws" or (method == "auto" and error.max() > LARGE * settled)
    low, high = step - normal(level) * error, step + normal(level) * error
    if drawn:
        draws = [th for th in draws_of(model, cov, seed) if is_stable(np.r_[1.0, th[: model.na]])]
        if len(draws) < FEWEST * DRAWS:
            raise IdentError(
                f"{1 - len(draws) / DRAWS:.0%} of the models within the covariance are unstable: the step response has "
                "no band. Record longer, excite lower frequencies, or lower the orders."
            )
        runs = np.stack([with_theta(model, th).simulate(np.ones(n)) for th in draws])
        low, high = np.quantile(runs, [(1 - level) / 2, (1 + level) / 2], axis=0)
    return StepBand(
        model.sample_time * np.arange(n, dtype=np.float64), step, low, high, error, level, "draws" if drawn else "delta"
    )


def step_and_slope(model: Model, n: int) -> tuple[Array, Array]:
    """Step response (n,) and d step / d theta (n, na + nb)."""
    ones, whole = np.ones(n), (slice(0, n),)
    step = model.simulate(ones)
    run = FreeRun(ones, step, whole, model.na, model.nb, model.nk)
    return step, by_a_and_b(run, filtered([1.0], model.a, step, whole), filtered([1.0], model.a, ones, whole))
