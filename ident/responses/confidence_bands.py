"""Confidence bands of frequency and step responses from the covariance of a model and of its alternatives.

Quantiles of the mixture of all structures that the record supports: of normal distributions by the delta method where
errors are small, of draws where they are large. The band of the gain is computed for its logarithm, so that it stays
positive.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array, Flags
from ...core.calls import check_share
from ...core.display import Plottable, as_columns
from ...core.errors import IdentError
from ..draws import bounded, components, drawn_models, mixture_quantile
from ..estimators.filters import filtered
from ..estimators.free_simulation import FreeRun, regressor_columns
from ..model import Model
from .spectra import checked_frequencies

if TYPE_CHECKING:
    from pandas import DataFrame

Method = Literal["auto", "delta", "draws"]
LARGE = 0.25  # standard error of ln G above which linearisation is inaccurate
DRAWS = 2000


@dataclass(frozen=True, slots=True, repr=False)
class ResponseBand(Plottable):
    """Gain and phase over frequency with pointwise confidence bands.

    Attributes
    ----------
    frequency : ndarray, shape (F,), Hz
    gain, gain_low, gain_high : ndarray, shape (F,), unit_y per unit_u
    phase, phase_low, phase_high : ndarray, shape (F,), degrees
        Unwrapped from the lowest frequency on.
    gain_error, phase_error : ndarray, shape (F,)
        Standard errors, of the mixture of structures: relative error of the gain, and degrees.
    outside : ndarray of bool, shape (F,)
        Outside the excited band, where the response is an extrapolation.
    level : float
    method : str
        ``delta`` or ``draws``.
    concern : str or None
        Reservation about the band.
    """

    frequency: Array
    gain: Array
    gain_low: Array
    gain_high: Array
    phase: Array
    phase_low: Array
    phase_high: Array
    gain_error: Array
    phase_error: Array
    outside: Flags
    level: float
    method: str
    concern: str | None = None

    def to_frame(self) -> "DataFrame":
        """One row per frequency, in Hz."""
        return as_columns(
            self, "frequency", "gain", "gain_low", "gain_high", "phase", "phase_low", "phase_high", "outside"
        ).set_index("frequency")


def response_band(
    model: Model, frequency: ArrayLike, level: float = 0.95, *, method: Method = "auto", seed: int = 1
) -> ResponseBand:
    """Gain and phase with confidence bands from the covariance of the coefficients.

    Parameters
    ----------
    model : Model
        With ``cov_params``; the band includes the uncertainty of its orders by its ``alternatives``.
    frequency : array_like, shape (F,)
        Hz, above zero to half the sample rate.
    level : float
        Pointwise confidence level.
    method : {"auto", "delta", "draws"}
        ``auto`` uses draws where a standard error of ln G exceeds 25 %.
    seed : int

    Raises
    ------
    IdentError
        No covariance, an invalid level or frequency.

    Notes
    -----
    d ln G / d a_i = -z^-i / A and d ln G / d b_j = z^-j / B: the real part is of ln |G|, the imaginary part of the
    phase. Source: Ljung 1999, section 9.4.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, cov_params=np.diag([1e-4, 1e-4]))
    >>> band = response_band(model, [0.1])
    >>> [round(float(x[0]), 3) for x in (band.gain_low, band.gain, band.gain_high)]
    [0.943, 0.996, 1.053]
    """
    f = checked_frequencies(frequency, 0.5 / model.sample_time)
    check_band(model, level)
    g, parts = model.response(f), components(model)
    weights = np.array([weight for weight, _ in parts])
    means = np.stack([_relative(one.response(f), g) for _, one in parts])
    errors = np.stack([_log_errors(one, f) for _, one in parts])
    gain, phase = np.abs(g), np.degrees(np.unwrap(np.angle(g)))
    drawn = method == "draws" or (method == "auto" and errors.max() > LARGE)
    if drawn:
        models = drawn_models(model, DRAWS, seed, least=0.0).models
        low, high = np.quantile(np.stack([_relative(one.response(f), g) for one in models]), tails(level), axis=0)
    else:
        low, high = (mixture_quantile(share, weights, means, errors) for share in tails(level))
    error = spread_of(weights, means, errors)
    outside = np.zeros(len(f), dtype=bool) if model.band is None else (f < model.band[0]) | (f > model.band[1])
    return ResponseBand(
        f, gain, gain * np.exp(low[0]), gain * np.exp(high[0]), phase, phase + np.degrees(low[1]),
        phase + np.degrees(high[1]), error[0], np.degrees(error[1]), outside, level, "draws" if drawn else "delta",
        _unexcited(model, outside),
    )  # fmt: skip


def _relative(response: NDArray[np.complex128], reference: NDArray[np.complex128]) -> Array:
    """Logarithm of the relative gain, and the difference of phase within +- pi, shape (2, F)."""
    ratio = response / reference
    return np.stack([np.log(np.abs(ratio)), np.angle(ratio)])


def _log_errors(model: Model, f: Array) -> Array:
    """Standard errors of ln |G| and of the phase by the delta method, shape (2, F); 0 without a covariance."""
    if model.cov_params is None:
        return np.zeros((2, len(f)))
    slope = response_slope(model, f)
    variance = np.stack([np.einsum("fi,ij,fj->f", d, model.cov_params, d) for d in (slope.real, slope.imag)])
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def spread_of(weights: Array, means: Array, errors: Array) -> Array:
    """Standard deviation of mixtures: within their parts (k, ...) and between them."""
    centre = np.tensordot(weights, means, axes=1)
    return np.asarray(np.sqrt(np.tensordot(weights, errors**2 + (means - centre) ** 2, axes=1)), dtype=np.float64)


def response_slope(model: Model, frequency: Array) -> NDArray[np.complex128]:
    """Derivatives d ln G / d theta at frequencies in Hz, shape (F, na + nb)."""
    z = np.exp(-2j * np.pi * frequency * model.sample_time)[:, None]
    a, b = (np.polyval(p[::-1], z) for p in (model.a, model.b))
    by_b = z ** np.arange(model.nk, model.nk + model.nb) / b
    return np.hstack([-(z ** np.arange(1, model.na + 1)) / a, by_b]).astype(np.complex128)


def check_band(model: Model, level: float) -> None:
    """Raise IdentError for a model without covariance, or for an invalid level."""
    if model.cov_params is None:
        raise IdentError(
            f"a model of structure {model.structure} has no covariance, hence no bands: identify it from a record."
        )
    check_share("level", level, IdentError)


def tails(level: float) -> tuple[float, float]:
    """Shares below the two ends of a band.

    >>> [round(share, 4) for share in tails(0.95)]
    [0.025, 0.975]
    """
    return (1 - level) / 2, (1 + level) / 2


def _unexcited(model: Model, outside: Flags) -> str | None:
    if model.band is None or not outside.any():
        return None
    return (
        f"outside {model.band[0]:.3g} to {model.band[1]:.3g} Hz the input has little power: the response there is an "
        "extrapolation of the model."
    )


FEWEST = 0.9  # share of draws that must be stable


@dataclass(frozen=True, slots=True, repr=False)
class StepBand(Plottable):
    """Response to a unit step of the input with its pointwise confidence band.

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
        """One row per sample, time in s."""
        return as_columns(self, "time", "step", "low", "high", "error").set_index("time")


def step_band(
    model: Model, duration: float, level: float = 0.95, *, method: Method = "auto", seed: int = 1
) -> StepBand:
    """Response to a unit step with its confidence band, from 0 to ``duration`` seconds.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, cov_params=np.diag([1e-4, 1e-4]))
    >>> band = step_band(model, 0.2)
    >>> band.step.tolist(), band.error.round(4).tolist()
    ([0.0, 0.5, 0.75], [0.0, 0.01, 0.0158])
    """
    if not (np.isfinite(duration) and duration >= model.sample_time):
        raise IdentError(f"duration {duration:g} s of a step response: at least one sample, {model.sample_time:g} s.")
    if not bounded(model):
        raise IdentError(f"step response of a model with a pole at radius {model.radius:.4g}: it grows without bound.")
    check_band(model, level)
    n = int(duration / model.sample_time * (1 + 1e-9)) + 1
    parts = [(weight, *_step_and_error(one, n)) for weight, one in components(model)]
    weights, steps, errors = (np.stack(values) for values in zip(*parts, strict=True))
    # a slow pole makes the end of the response nonlinear first, so that the largest error decides
    settled = max(float(np.abs(steps[0]).max()), np.finfo(float).tiny)
    drawn = method == "draws" or (method == "auto" and errors.max() > LARGE * settled)
    if drawn:
        plants = drawn_models(model, DRAWS, seed, least=0.0)
        if plants.left_out > (1 - FEWEST) * DRAWS:
            raise IdentError(
                f"{plants.left_out / DRAWS:.0%} of the draws of the model are unstable: the step response has "
                "no band. Record longer, excite lower frequencies, or lower the orders."
            )
        low, high = np.quantile(np.stack([one.simulate(np.ones(n)) for one in plants.models]), tails(level), axis=0)
    else:
        low, high = (mixture_quantile(share, weights, steps, errors) for share in tails(level))
    return StepBand(
        model.sample_time * np.arange(n, dtype=np.float64), steps[0], low, high, spread_of(weights, steps, errors),
        level, "draws" if drawn else "delta",
    )  # fmt: skip


def _step_and_error(model: Model, n: int) -> tuple[Array, Array]:
    """Step response and its standard error by the delta method, each (n,)."""
    step, slope = step_and_slope(model, n)
    if model.cov_params is None:
        return step, np.zeros(n)
    return step, np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", slope, model.cov_params, slope), 0.0))


def step_and_slope(model: Model, n: int) -> tuple[Array, Array]:
    """Step response (n,) and its sensitivities d step / d theta (n, na + nb)."""
    ones, whole = np.ones(n), (slice(0, n),)
    step = model.simulate(ones)
    run = FreeRun(ones, step, whole, model.na, model.nb, model.nk)
    return step, regressor_columns(run, filtered([1.0], model.a, step, whole), filtered([1.0], model.a, ones, whole))
