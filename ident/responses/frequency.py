"""Nonparametric frequency response: gain and phase with error bars, coherence, and the excited band."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.display import Plottable, as_columns
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.input_checks import check_varies
from .impulse_response import ImpulseResponse, block_means, regularised_impulse
from .spectra import checked_frequencies, excited_band, input_power, welch_estimate

if TYPE_CHECKING:
    from pandas import DataFrame


Array = NDArray[np.float64]
Method = Literal["impulse", "welch"]
MOST = 150  # frequencies by default
LONGEST = 150  # coefficients of the impulse response; at the reduced rate, ten periods of the highest frequency
KEPT = 12  # samples per period of the highest excited frequency: faster records are averaged in blocks
SHORTEST = 30  # samples of the longest segment
DECAYED = 1e-3  # variance of the last coefficient over that of the first


@dataclass(frozen=True, slots=True, repr=False)
class FrequencyResponse(Plottable):
    """Measured frequency response.

    Attributes
    ----------
    frequency : ndarray, shape (F,), Hz
    response : ndarray of complex, shape (F,), unit_y per unit_u
    gain_error, phase_error : ndarray, shape (F,)
        Standard errors: relative error of the gain, and degrees.
    gain_low, gain_high : ndarray, shape (F,), unit_y per unit_u
    phase_low, phase_high : ndarray, shape (F,), degrees
        Pointwise, at ``level``, by Student's t with twice ``dof``.
    coherence : ndarray, shape (F,)
        Share of the output power explained by the input: 1 without noise.
    dof : ndarray, shape (F,)
        Complex degrees of freedom of the noise estimate.
    outside : ndarray of bool, shape (F,)
        Outside the excited band.
    band : tuple of float
        Excited band, Hz.
    resolution : float
        Hz; narrower features are smoothed.
    level : float
    method : str
    notes : tuple of str
    """

    frequency: Array
    response: NDArray[np.complex128]
    gain_error: Array
    phase_error: Array
    gain_low: Array
    gain_high: Array
    phase_low: Array
    phase_high: Array
    coherence: Array
    dof: Array
    outside: NDArray[np.bool_]
    band: tuple[float, float]
    resolution: float
    level: float
    method: str
    notes: tuple[str, ...] = ()

    @property
    def gain(self) -> Array:
        """|G|, shape (F,)."""
        return np.abs(self.response)

    @property
    def phase(self) -> Array:
        """Degrees, unwrapped from the lowest frequency on, shape (F,)."""
        return np.asarray(np.degrees(np.unwrap(np.angle(self.response))))

    def to_frame(self) -> "DataFrame":
        """One row per frequency, in Hz."""
        limits = ("gain", "gain_low", "gain_high", "phase", "phase_low", "phase_high")
        return as_columns(self, "frequency", *limits, "coherence", "outside").set_index("frequency")


def frequency_response(
    rec: Record,
    frequency: ArrayLike | None = None,
    *,
    method: Method = "impulse",
    resolution: float | None = None,
    level: float = 0.95,
) -> FrequencyResponse:
    """Estimate the frequency response of a record without a parametric model.

    Parameters
    ----------
    rec : Record
        The mean of each segment is removed.
    frequency : array_like, shape (F,), optional
        Hz; by default the bins of the longest segment (at most 150, evenly spaced on a logarithmic axis).
    method : {"impulse", "welch"}
        ``impulse`` transforms a regularised impulse response: valid for one sweep as for many runs. ``welch`` averages
        half-overlapping windows: for long random inputs, and for lightly damped plants whose impulse response is longer
        than 150 samples. The windows of a sweep differ, so that the error bars of ``welch`` are not valid for it.
    resolution : float, optional
        Hz, for ``welch``: twice the spacing of its bins.
    level : float
        Pointwise confidence level of the error bars.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    IdentError
        A constant input or output, too short a record, invalid frequencies or resolution.

    Notes
    -----
    In closed loop the estimate is biased towards minus the inverse of the controller: see `feedback_detected`.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> t = np.arange(750) * 0.02
    >>> u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / 30 * t) * t)
    >>> from scipy.signal import lfilter
    >>> found = frequency_response(Record(u=u, y=lfilter([0, 0.1], [1, -0.9], u), sample_time=0.02), [0.5, 1.0])
    >>> found.gain.round(3).tolist()
    [0.859, 0.643]
    """
    check_varies(rec)
    if not 0 < level < 1:
        raise IdentError(f"level {level!r} of error bars: between 0 and 1, for instance 0.95.")
    if method not in ("impulse", "welch"):
        raise IdentError(f"method {method!r}: impulse or welch.")
    band = excited_band(rec)
    f = _frequencies(rec, frequency)
    if method == "welch":
        g, error, coherence, dof, width = welch_estimate(rec, f, resolution)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(np.abs(g) > 0, error / np.sqrt(2) / np.abs(g), np.inf)
        return _with_bars(f, g, share, share, coherence, dof, band, width, level, method, ())
    if resolution is not None:
        raise IdentError(
            'resolution is an option of method="welch"; that of the impulse response follows from the data.'
        )
    g, by_gain, by_phase, coherence, dof, width, notes = _by_impulse(rec, f, band)
    return _with_bars(f, g, by_gain, by_phase, coherence, dof, band, width, level, method, notes)


def _by_impulse(
    rec: Record, f: Array, band: tuple[float, float]
) -> tuple[NDArray[np.complex128], Array, Array, Array, Array, float, tuple[str, ...]]:
    """G, errors of ln |G| and of the phase, coherence, degrees of freedom, resolution, notes."""
    longest = max(s.stop - s.start for s in rec.stretches)
    if longest < SHORTEST:
        raise IdentError(
            f"the longest segment has {longest} samples: a frequency response needs {SHORTEST}. Record longer."
        )
    slower = max(int(rec.rate / max(KEPT * band[1], 2.5 * f.max())), 1)
    slow = block_means(rec.centred(), slower if longest // slower >= SHORTEST else 1)
    n = min(LONGEST, max(s.stop - s.start for s in slow.stretches) // 3)
    found = regularised_impulse(slow, n)
    turn = np.exp(-2j * np.pi * np.outer(f, np.arange(n)) * slow.sample_time)
    g = np.asarray(turn @ found.g, dtype=np.complex128)
    g[g == 0] = np.finfo(float).tiny
    slope = (turn @ found.root) / g[:, None]
    errors = np.sqrt((slope.real**2).sum(axis=1)), np.sqrt((slope.imag**2).sum(axis=1))
    notes = () if found.tail < DECAYED else (
        f"the impulse response has not decayed within {n * slow.sample_time:.3g} s: peaks narrower than "
        f"{1 / (n * slow.sample_time):.2g} Hz are smoothed, which their error bars do not include",
    )  # fmt: skip
    dof, width = np.full(len(f), found.dof), 1 / (n * slow.sample_time)
    return g, errors[0], errors[1], _coherence(slow, found, f, g), dof, width, notes


def _coherence(rec: Record, found: ImpulseResponse, f: Array, g: NDArray[np.complex128]) -> Array:
    """Share of the output power that the input explains: |G|^2 S_uu over |G|^2 S_uu plus noise."""
    at, power = input_power(rec)
    signal = np.abs(g) ** 2 * np.interp(f, at, power)
    h, variance = found.noise
    noise = variance / np.abs(np.polyval(h[::-1], np.exp(-2j * np.pi * f * rec.sample_time))) ** 2
    total = signal + noise
    return np.asarray(np.divide(signal, total, out=np.zeros_like(total), where=total > 0))


def _with_bars(
    f: Array, g: NDArray[np.complex128], by_gain: Array, by_phase: Array, coherence: Array, dof: Array,
    band: tuple[float, float], width: float, level: float, method: str, notes: tuple[str, ...],
) -> FrequencyResponse:  # fmt: skip
    """Error bars from the standard errors of ln |G| and of the phase in radian, by Student's t."""
    from scipy.stats import t

    gain, phase = np.abs(g), np.degrees(np.unwrap(np.angle(g)))
    quantile = t.ppf((1 + level) / 2, 2 * dof)
    spread, turn = quantile * by_gain, np.minimum(np.degrees(quantile * by_phase), 180.0)
    with np.errstate(over="ignore"):
        low, high = gain * np.exp(-spread), gain * np.exp(spread)
    return FrequencyResponse(
        f, g, by_gain, np.minimum(np.degrees(by_phase), 180.0), low, high, phase - turn, phase + turn, coherence, dof,
        (f < band[0] * (1 - 1e-9)) | (f > band[1] * (1 + 1e-9)), band, float(width), level, method, notes,
    )  # fmt: skip


def _frequencies(rec: Record, frequency: ArrayLike | None) -> Array:
    nyquist, n = rec.rate / 2, max(s.stop - s.start for s in rec.stretches)
    if frequency is not None:
        return checked_frequencies(frequency, nyquist)
    bins = np.arange(1, n // 2 + 1)
    if len(bins) > MOST:
        bins = np.unique(np.round(np.geomspace(1, n // 2, MOST)).astype(np.intp))
    return np.asarray(bins * rec.rate / n, dtype=np.float64)
