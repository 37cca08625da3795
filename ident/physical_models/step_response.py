"""First- or second-order step response with delay, fitted to one or several steps of the input.

    order 1    gain / (T s + 1) exp(-L s)
    order 2    gain wn^2 / (s^2 + 2 zeta wn s + wn^2) exp(-L s)

The time constant of a servo is the time to 63.2 % of the step (SURF, "ts"). The response to edges du_j at t_j is
``gain sum du_j s(t - t_j - L)``, so that the delay may be any fraction of a sample.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import MAD, Array
from ...core.display import Plottable
from ...core.errors import IdentError
from ...core.verdict import DO_NOT_USE, RESERVATIONS, USABLE, Verdict, verdict_from
from ...datasets import Record
from ...datasets.records.reading import clipped
from ..continuous import ContinuousModel
from ..estimators.filters import ROUNDING, covariance, inverse_of_squares, squares
from ..model import Model
from . import NOT_HELD_OUT
from .step_shapes import (
    SHAPES,
    Stretch,
    drift,
    one_step,
    overshoot,
    ramp_rate,
    refuse_integral,
    stretches_of,
    time_constants,
    unit_response,
)  # fmt: skip

if TYPE_CHECKING:
    import pandas as pd

GOOD, POOR = 80.0, 50.0  # % of fit, as of `validate`
FASTEST = 1 / 3  # of the sample time: a faster response is complete, to 5 %, at the next sample
SURE = 2.0  # standard errors between the gain and zero
CHECKED = (
    "Simulation of the record", "Clipped output", "Shape of the residuals", "Overshoot and rate limit",
    "Settling within the record", "Static gain",
)  # fmt: skip
MISFIT = (0.05, 5.0)  # rms of the residuals, of the largest step and of the noise between samples: no lag leaves it


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

        every = dict(zip(("gain", *SHAPES[self.order], "delay"), (self.gain, *self.shape, self.delay), strict=True))
        return pd.Series([every[name] for name in self.names], index=list(self.names))

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
        """The discrete model for an input held between samples, sample time in s, with its covariance.

        The covariance is that of ``names`` by the delta method. Near a whole number of samples of delay the model gets
        the coefficient of the next sample too, which then is zero within its standard error.

        Raises
        ------
        IdentError
            The response takes less than the spacing of the samples: no time of it is known.
        """
        if self.time_to_63 - self.delay < FASTEST * sample_time:
            raise IdentError(
                f"the response reaches 63.2 % {self.time_to_63 - self.delay:.2g} s after its delay, in less than "
                f"{FASTEST:.2g} of the {sample_time:g} s between samples: no time constant is known. Record faster."
            )
        at = self.params.to_numpy(dtype=np.float64)
        moved = []
        for j, name in enumerate(self.names):
            step = 1e-5 * (sample_time if name == "delay" else abs(at[j]))
            # a delay below the first sample would be refused: the difference is then one-sided
            ends = (max(at[j] - step, 0.0) if name == "delay" else at[j] - step), at[j] + step
            pair = [self._with(name, end).continuous.sampled(sample_time) for end in ends]
            moved.append((pair[0], pair[1], ends[1] - ends[0]))
        base = self.continuous.sampled(sample_time)
        every = [base, *(model for low, high, _ in moved for model in (low, high))]
        nk, length = min(m.nk for m in every), max(len(m.b) for m in every)

        def theta(m: Model) -> Array:
            return np.concatenate([m.a[1:], m.b[nk:], np.zeros(length - len(m.b))])

        J = np.column_stack([(theta(high) - theta(low)) / width for low, high, width in moved])
        e = np.concatenate([run.y - fitted for run, fitted in zip(self.runs, self.fitted, strict=True)])
        return replace(
            base, b=np.pad(base.b, (0, length - len(base.b))), nk=nk, cov_params=J @ self.cov_params @ J.T,
            noise_variance=float(np.mean(e**2)), n=len(e),
        )  # fmt: skip

    def _with(self, name: str, value: float) -> "StepFit":
        """The same fit with another value of one parameter."""
        if name == "gain":
            return replace(self, gain=value)
        if name == "delay":
            return replace(self, delay=value)
        place = SHAPES[self.order].index(name)
        return replace(self, shape=tuple(value if k == place else v for k, v in enumerate(self.shape)))

    @property
    def df(self) -> int:
        """Degrees of freedom of the standard errors."""
        return max(sum(map(len, self.fitted)) - len(self.names), 1)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter that can be estimated; empty where it has none."""
        gain = f"{self.unit_y or '1'}/{self.unit_u or '1'}" if self.unit_y or self.unit_u else ""
        return {"gain": gain, "time_constant": "s", "natural_frequency": "rad/s", "damping": "", "delay": "s"}

    @property
    def words(self) -> str:
        """Estimates with their standard errors, then ``remarks``."""
        values = [
            f"{name.replace('_', ' ')} {value:.4g} +- {error:.2g} {self.units[name]}".rstrip()
            for name, value, error in zip(self.names, self.params.to_numpy(), self.bse.to_numpy(), strict=True)
        ]
        return " ".join([f"{', '.join(values)}.", *self.remarks])

    @property
    def remarks(self) -> tuple[str, ...]:
        """Time to 63.2 %, quality of the fit, and findings, a sentence each."""
        kind = (
            f"coloured (autoregression of order {self.colour}), allowed for in the errors" if self.colour else "white"
        )
        fit = f"Order {self.order}: 63.2 % after {self.time_to_63:.4g} s; fit {self.fit:.1f} %; residuals {kind}."
        return (fit, *(words for _, words in _findings(self)))

    @property
    def verdict(self) -> Verdict:
        """The verdict on the model."""
        return verdict_from(_findings(self), CHECKED, (NOT_HELD_OUT,))


def step_response_fit(
    rec: Record | tuple[ArrayLike, ArrayLike],
    order: Literal[1, 2] | None = 1,
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
    order : 1, 2 or None
        None: 2 where the record distinguishes it from 1, by Schwarz's criterion with the effective number of samples.
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

    if order is None:
        return _of_chosen_order(*(step_response_fit(rec, n, delay=delay, step=step, at=at) for n in (1, 2)))
    if order not in (1, 2):
        raise IdentError(f"order {order!r}: 1 or 2; for more, identify a record with arx or output_error.")
    if delay is not None and not (np.isfinite(delay) and delay >= 0):
        raise IdentError(f"delay {delay!r} s: zero or more, or None to estimate it.")
    runs = (
        stretches_of(rec) if isinstance(rec, Record) else [one_step(np.asarray(rec[0]), np.asarray(rec[1]), step, at)]
    )
    found = search(order, runs, delay)
    refuse_integral(runs, found.loss, found.size)
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


def _of_chosen_order(first: StepFit, second: StepFit) -> StepFit:
    """The fit of the order that Schwarz's criterion prefers; order 1 where the damping of order 2 is not known."""
    e1, e2 = (np.concatenate([run.y - y for run, y in zip(f.runs, f.fitted, strict=True)]) for f in (first, second))
    whole = ROUNDING * squares(np.concatenate([run.y - run.y.mean() for run in second.runs]))
    r = float(e2[1:] @ e2[:-1]) / max(squares(e2), whole)
    size = len(e2) * (1 - max(r, 0.0)) / (1 + max(r, 0.0))
    gain = size * float(np.log(max(squares(e1), whole) / max(squares(e2), whole)))
    better = gain > np.log(size) and float(second.bse["damping"]) <= second.shape[1] / 2
    other, chosen = (first, second) if better else (second, first)
    fits = f"fit {chosen.fit:.1f} %, order {other.order} {other.fit:.1f} %"
    return replace(chosen, notes=(*chosen.notes, f"order {chosen.order} was chosen by the record: {fits}"))


def _names(rec: Record | tuple[ArrayLike, ArrayLike]) -> tuple[str, str, str, str, tuple[str, ...]]:
    """Input, output, their units and notes."""
    if isinstance(rec, Record):
        return rec.input, rec.output, rec.unit_u, rec.unit_y, rec.notes
    return "u", "y", "", "", ()


def _findings(fit: "StepFit") -> list[tuple[int, str]]:
    """Remarks (level 0) and reservations, each a sentence."""
    window = max(float(np.max(np.diff([*run.at, run.time[-1]]))) for run in fit.runs)
    settled = fit.time_to_63 - fit.delay <= (window - fit.delay) / 3
    own = (*_of_range(fit), *_of_output(fit, settled), *_of_order(fit))
    return [*own, *_of_window(fit, window, settled), *_of_fit(fit), *_of_shape(fit)]


def _of_range(fit: "StepFit") -> Iterator[tuple[int, str]]:
    if fit.rate_limit is not None:
        return
    y = np.concatenate([run.y for run in fit.runs])
    for extreme in (float(y.max()), float(y.min())):
        if samples := clipped(y, extreme)[1]:
            words = (
                f"The output runs into {extreme:.4g}{f' {fit.unit_y}' if fit.unit_y else ''} and stays there, in "
                f"{samples} samples, as at the end of the range of a sensor: gain, overshoot and times are not known. "
            )
            yield DO_NOT_USE, f"{words}Use another range or smaller steps."


def _of_shape(fit: "StepFit") -> Iterator[tuple[int, str]]:
    e = [run.y - fitted for run, fitted in zip(fit.runs, fit.fitted, strict=True)]
    between = MAD * float(np.median(np.abs(np.concatenate([np.diff(part) for part in e])))) / np.sqrt(2)
    rms = float(np.sqrt(np.mean(np.concatenate(e) ** 2)))
    if fit.fit >= GOOD and fit.rate_limit is None and fit.scatter > MISFIT[0] and rms > MISFIT[1] * between:
        yield (
            RESERVATIONS,
            f"The residuals are {100 * fit.scatter:.0f} % of the largest step, and more than {MISFIT[1]:.0f} times the "
            f"noise between samples: the response is not that of order {fit.order}. It may differ between up and down, "
            "begin in the other direction, drift or be nonlinear: look at the figure.",
        )


def _of_output(fit: "StepFit", settled: bool) -> Iterator[tuple[int, str]]:
    over = overshoot(fit.runs) if settled else 0.0  # of an end that is reached
    if fit.rate_limit is not None:
        unit = f"{fit.unit_y}/s" if fit.unit_y else "1/s"
        yield (
            RESERVATIONS,
            f"The output is rate-limited at {fit.rate_limit:.4g} {unit}: the rise time grows with the step size. "
            "Use smaller steps to identify the lag.",
        )
    if fit.order == 1 and over > max(0.05, 4 * fit.scatter):
        yield RESERVATIONS, f"The output overshoots by {100 * over:.0f} %: fit order 2."


def _of_order(fit: "StepFit") -> Iterator[tuple[int, str]]:
    if fit.order == 1:
        return
    if len(fit.time_constants) == 2:
        slow, fast = fit.time_constants
        yield USABLE, f"Overdamped: time constants {slow:.4g} and {fast:.4g} s."
    damping, error = fit.shape[1], float(fit.bse["damping"])
    if error > damping / 2:
        yield RESERVATIONS, "The second order is not distinguishable from a delay: fit order 1."
    elif error > 1e-6 and abs(damping - 1) < 2 * error:
        yield USABLE, "A damping ratio of 1 lies within two standard errors: over- or underdamped is not decided."


def _of_window(fit: "StepFit", window: float, settled: bool) -> Iterator[tuple[int, str]]:
    if not settled:
        yield (
            RESERVATIONS,
            f"The response has not settled within {window:.3g} s: gain and time are extrapolated. Record longer.",
        )
    if "delay" not in fit.names and fit.delay < 1e-6 * window:
        yield USABLE, "No significant delay."


def _other_order(fit: "StepFit") -> str:
    chosen = any("chosen by the record" in note for note in fit.notes)
    return f"look at the figure{'' if chosen else f', and try order {3 - fit.order}'}"


def _of_fit(fit: "StepFit") -> Iterator[tuple[int, str]]:
    error = float(fit.bse["gain"])
    if abs(fit.gain) < SURE * error:
        yield (
            DO_NOT_USE,
            f"The gain is {fit.gain:.3g} with a standard error of {error:.2g}: its sign is not known. Use larger steps "
            "or record more of them.",
        )
    if fit.fit < GOOD and (fit.rate_limit is None or fit.fit < POOR):
        level, limit = (RESERVATIONS, GOOD) if fit.fit >= POOR else (DO_NOT_USE, POOR)
        advice = drift(fit.runs, fit.fitted, fit.unit_y) or _other_order(fit)
        yield level, f"The fit of order {fit.order} is {fit.fit:.0f} %, less than {limit:.0f} %: {advice}."
