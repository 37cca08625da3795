"""First- or second-order step response with delay, fitted to one or several steps of the input.

    order 1    gain / (T s + 1) exp(-L s)
    order 2    gain wn^2 / (s^2 + 2 zeta wn s + wn^2) exp(-L s)

The time constant of a servo is the time to 63.2 % of the step (SURF, "ts"). The response to edges du_j at t_j is
``gain sum du_j s(t - t_j - L)``, so that the delay may be any fraction of a sample.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.display import Plottable
from ...core.errors import IdentError
from ...datasets import Record
from ..continuous import ContinuousModel
from ..estimators.filters import ROUNDING, covariance, inverse_of_squares
from ..model import Model
from .step_shapes import SHAPES, Stretch, one_step, overshoot, ramp_rate, stretches_of, time_constants, unit_response

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, repr=False)
class StepFit(Plottable):
    """First- or second-order model of a step response.

    Attributes
    ----------
    order : int
    gain : float
        unit_y per unit_u.
    shape : tuple of float
        (T,) s, or (wn rad/s, zeta).
    delay : float
        s.
    names : tuple of str
        Estimated parameters: gain, shape, and the delay unless given or zero.
    cov_params : ndarray
        Of ``names``; the residuals are modelled as an autoregression of order ``colour`` (0: white).
    colour : int
    fit : float
        100 (1 - |y - fitted| / |y - mean y|), %.
    rate_limit : float or None
        unit_y/s, where ramps of limited rate describe the output clearly better.
    runs, fitted : tuple
        The steps, and the fitted output (n,) of each.
    input, output, unit_u, unit_y : str
    notes : tuple of str
    """

    order: int
    gain: float
    shape: tuple[float, ...]
    delay: float
    names: tuple[str, ...]
    cov_params: Array
    colour: int
    fit: float
    rate_limit: float | None
    runs: tuple[Stretch, ...]
    fitted: tuple[Array, ...]
    input: str = "u"
    output: str = "y"
    unit_u: str = ""
    unit_y: str = ""
    notes: tuple[str, ...] = ()

    @property
    def params(self) -> "pd.Series[float]":
        """Estimated parameters by name."""
        import pandas as pd

        all_of_them = dict(
            zip(("gain", *SHAPES[self.order], "delay"), (self.gain, *self.shape, self.delay), strict=True)
        )
        return pd.Series([all_of_them[name] for name in self.names], index=list(self.names))

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors by name."""
        import pandas as pd

        return pd.Series(np.sqrt(np.diag(self.cov_params)), index=list(self.names))

    @property
    def scatter(self) -> float:
        """Root mean square of the residuals, relative to the response to the largest step."""
        e = np.concatenate([run.y - fitted for run, fitted in zip(self.runs, self.fitted, strict=True)])
        largest = max(float(np.abs(run.size).max()) for run in self.runs)
        return float(np.sqrt(np.mean(e**2))) / (abs(self.gain) * largest)

    @property
    def time_constants(self) -> tuple[float, ...]:
        """(T,), or the slow and the fast one, s; empty for an underdamped response."""
        if self.order == 1:
            return self.shape
        return time_constants(*self.shape) if self.shape[1] >= 1 else ()

    @property
    def time_to_63(self) -> float:
        """Time to 63.2 % of the step, counted from the step, delay included, s."""
        from scipy.optimize import brentq

        if self.order == 1:
            return self.delay + self.shape[0]
        # the crossing precedes the first peak, and before 2 (1 + zeta) / wn whatever the damping
        first = np.pi / (self.shape[0] * np.sqrt(1 - self.shape[1] ** 2)) if self.shape[1] < 1 else np.inf
        end = min(first, 2 * (1 + self.shape[1]) / self.shape[0])
        part = 1 - np.exp(-1.0)
        return self.delay + float(brentq(lambda t: unit_response(2, np.array([t]), self.shape)[0] - part, 0.0, end))

    @property
    def continuous(self) -> ContinuousModel:
        """The model as a continuous transfer function."""
        if self.order == 1:
            num, den = [self.gain], [self.shape[0], 1.0]
        else:
            wn, zeta = self.shape
            num, den = [self.gain * wn**2], [1.0, 2 * zeta * wn, wn**2]
        return ContinuousModel(
            np.array(num), np.array(den), self.delay, self.input, self.output, self.unit_u, self.unit_y
        )

    def model(self, sample_time: float) -> Model:
        """The discrete model for an input held between samples, sample time in s."""
        return self.continuous.sampled(sample_time)

    @property
    def verdict(self) -> str:
        """Estimates, quality of the fit, and reservations."""
        return verdict(self, overshoot(self.runs))


def step_response_fit(
    rec: Record | tuple[ArrayLike, ArrayLike],
    order: Literal[1, 2] = 1,
    *,
    delay: float | None = None,
    step: float = 1.0,
    at: float = 0.0,
) -> StepFit:
    """Fit first or second order with delay to steps by least squares.

    Parameters
    ----------
    rec : Record, or (t, y)
        Steps of the input, up or down, from rest; or times (s, any spacing) and output of one step.
    order : 1 or 2
    delay : float or None
        s; None: estimated.
    step, at : float
        For (t, y) alone: the change of the input, and when, s.

    Raises
    ------
    IdentError
        The input is constant or not made of steps; the output does not respond; too few samples.

    Examples
    --------
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> fit = step_response_fit((t, 2 * unit_response(1, t - 0.053, [0.13])), step=2.0)
    >>> fit.params.round(6).to_dict()
    {'gain': 1.0, 'time_constant': 0.13, 'delay': 0.053}
    """
    from .step_search import search

    if order not in (1, 2):
        raise IdentError(f"order {order!r}: 1 or 2; for more, identify a record with arx or output_error.")
    if delay is not None and not (np.isfinite(delay) and delay >= 0):
        raise IdentError(f"delay {delay!r} s: zero or more, or None to estimate it.")
    runs = (
        stretches_of(rec) if isinstance(rec, Record) else [one_step(np.asarray(rec[0]), np.asarray(rec[1]), step, at)]
    )
    found = search(order, runs, delay)
    stretches = tuple(slice(a, b) for a, b in zip(found.ends[:-1], found.ends[1:], strict=True))
    if found.loss <= 1e4 * ROUNDING * found.size:  # rounding is coloured too
        cov, colour = found.loss / len(found.e) * inverse_of_squares(found.J), 0
    else:
        cov, colour = covariance(found.J, found.e, stretches, len(runs))
    return StepFit(
        order, found.gain, tuple(found.shape), found.delay, found.names, cov, colour,
        100 * (1 - float(np.sqrt(found.loss / found.size))), ramp_rate(runs, found.gain, found.levels, found.loss),
        tuple(runs), tuple(run.y - found.e[s] for run, s in zip(runs, stretches, strict=True)), *_names(rec),
    )  # fmt: skip


def _names(rec: Record | tuple[ArrayLike, ArrayLike]) -> tuple[str, str, str, str, tuple[str, ...]]:
    """Input, output, their units and notes."""
    if isinstance(rec, Record):
        return rec.input, rec.output, rec.unit_u, rec.unit_y, rec.notes
    return "u", "y", "", "", ()


POOR = 80.0  # % fit below which the model structure, not the noise, is inadequate


def verdict(fit: "StepFit", over: float) -> str:
    """Estimates with standard errors, then reservations; ``over`` is the measured overshoot."""
    units = _units(fit)
    values = [
        f"{name.replace('_', ' ')} {value:.4g} +- {error:.2g}{units[name]}"
        for name, value, error in zip(fit.names, fit.params.to_numpy(), fit.bse.to_numpy(), strict=True)
    ]
    kind = "white" if not fit.colour else f"coloured (autoregression of order {fit.colour}), allowed for in the errors"
    text = f"{', '.join(values)}; 63.2 % after {fit.time_to_63:.4g} s; fit {fit.fit:.1f} %; residuals {kind}."
    return " ".join([text, *_reservations(fit, over)])


def _units(fit: "StepFit") -> dict[str, str]:
    gain = f" {fit.unit_y or '1'}/{fit.unit_u or '1'}" if fit.unit_y or fit.unit_u else ""
    return {"gain": gain, "time_constant": " s", "natural_frequency": " rad/s", "damping": "", "delay": " s"}


def _reservations(fit: "StepFit", over: float) -> list[str]:
    out = []
    if fit.rate_limit is not None:
        unit = f"{fit.unit_y}/s" if fit.unit_y else "1/s"
        out.append(
            f"The output is rate-limited at {fit.rate_limit:.4g} {unit}: the rise time grows with the step size. "
            "Use smaller steps to identify the lag."
        )
    if fit.order == 1 and over > max(0.05, 4 * fit.scatter):
        out.append(f"The output overshoots by {100 * over:.0f} %: fit order 2.")
    if fit.order == 2 and len(fit.time_constants) == 2:
        slow, fast = fit.time_constants
        out.append(f"Overdamped: time constants {slow:.4g} and {fast:.4g} s.")
    if fit.order == 2:
        damping, error = fit.shape[1], float(fit.bse["damping"])
        if error > damping / 2:
            out.append("The second order is not distinguishable from a delay: fit order 1.")
        elif error > 1e-6 and abs(damping - 1) < 2 * error:
            out.append("A damping ratio of 1 lies within two standard errors: over- or underdamped is not decided.")
    window = max(float(np.max(np.diff([*run.at, run.time[-1]]))) for run in fit.runs)
    if fit.time_to_63 - fit.delay > (window - fit.delay) / 3:
        out.append(
            f"The response has not settled within {window:.3g} s: gain and time are extrapolated. Record longer."
        )
    if "delay" not in fit.names and fit.delay < 1e-6 * window:
        out.append("No significant delay.")
    if fit.fit < POOR and fit.rate_limit is None:
        out.append(f"Poor fit of order {fit.order}: check the figure, and try order {3 - fit.order}.")
    return out
