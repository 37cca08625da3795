"""Nonparametric frequency response: gain and phase with error bars, coherence, and the excited band."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array, Flags
from ...core.calls import check_share
from ...core.display import Plottable, as_columns
from ...core.errors import IdentError
from ...core.threads import one_thread
from ...datasets.records.record import Record
from ..estimators.input_checks import check_varies
from .impulse_response import ImpulseResponse, block_means, regularised_impulse
from .local_polynomials import LocalEstimate, local_polynomial
from .spectra import checked_frequencies, excited_band, input_power, welch_estimate

if TYPE_CHECKING:
    from pandas import DataFrame


Method = Literal["auto", "impulse", "local", "welch"]
METHODS = ("auto", "impulse", "local", "welch")
MOST = 150  # frequencies by default
LONGEST = 150  # coefficients of the impulse response; at the reduced rate, ten periods of the highest frequency
KEPT = 12  # samples per period of the highest excited frequency: faster records are averaged in blocks
SHORTEST = 30  # samples of the longest segment
DECAYED = 1e-3  # variance of the last coefficient over that of the first
LONG = 2_000  # samples at the reduced rate: beyond, the local polynomial method is nearly as precise, with safer bars
CHECKED = 30  # frequencies of the band at which the two methods are compared
CONSISTENT = 2.0  # mean squared difference over the variance; below 1.3 where the prior fits, above 2 where it does not


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
        Hz; narrower features are smoothed. Of ``local``, the median width of the windows in the excited band.
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
    outside: Flags
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


@one_thread
def frequency_response(
    rec: Record,
    frequency: ArrayLike | None = None,
    *,
    method: Method = "auto",
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
    method : {"auto", "impulse", "local", "welch"}
        ``impulse`` transforms a regularised impulse response of up to 150 coefficients: the most precise for short
        records of well damped plants, and wrong where the response has not decayed by then. ``local`` fits polynomials
        in windows of the transforms whose widths follow from the data: for long records and narrow resonances or
        notches; its error bars include the smoothing error. ``auto`` takes ``impulse`` for up to 2000 samples (after
        averaging of a needlessly high rate) if the response decays and ``local`` agrees with it, or that of the change
        of the output decays (an integrating plant), otherwise ``local``.
        ``welch`` averages half-overlapping windows of a long random input; its error bars are not valid for a sweep.
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
    In closed loop the estimate is biased towards minus the inverse of the controller: see `closed_loop.feedback`.

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
    check_share("level", level, IdentError)
    if method not in METHODS:
        raise IdentError(f"method {method!r}: {', '.join(METHODS[:-1])} or {METHODS[-1]}.")
    band = excited_band(rec)
    f = _frequencies(rec, frequency)
    if method == "welch":
        g, error, coherence, dof, width = welch_estimate(rec, f, resolution)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(np.abs(g) > 0, error / np.sqrt(2) / np.abs(g), np.inf)
        return _with_bars(f, g, share, share, coherence, dof, band, width, level, method, ())
    if resolution is not None:
        raise IdentError('resolution is an option of method="welch"; that of the other methods follows from the data.')
    local = local_polynomial(rec, f) if method in ("auto", "local") else None
    if method == "local" and local is None:
        raise IdentError(
            f"the longest segment has {max(s.stop - s.start for s in rec.stretches)} samples: local polynomials need "
            '120. Record longer, or use method="impulse".'
        )
    estimate, reason = None, ""
    if local is None or method != "local":
        slower = max(int(rec.rate / max(KEPT * band[1], 2.5 * f.max())), 1)
        if local is not None and len(rec) // slower > LONG and np.isfinite(local.variance).mean() > 0.5:
            reason = f"more than {LONG} samples"
        else:
            estimate = _impulse(rec, slower)
            reason = _unsuited(rec, estimate, band) if method == "auto" and local is not None else ""
    if estimate is None or (reason and local is not None):
        assert local is not None  # noqa: S101  the impulse response is estimated otherwise
        return _by_windows(f, local, band, level, reason)
    return _by_impulse(estimate, f, band, level)


@dataclass(frozen=True, slots=True)
class _Impulse:
    """Impulse response of a record averaged in blocks; of the change of its output, where only that decays."""

    rec: Record
    found: ImpulseResponse
    notes: tuple[str, ...]
    integrating: bool = False

    @property
    def length(self) -> float:
        """Length of the impulse response, s."""
        return len(self.found.g) * self.rec.sample_time

    def response(self, f: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """G (F,) and the root of the covariance of ln G, shape (F, p)."""
        turn = np.exp(-2j * np.pi * np.outer(f, np.arange(len(self.found.g))) * self.rec.sample_time)
        g = np.asarray(turn @ self.found.g, dtype=np.complex128)
        g[g == 0] = np.finfo(float).tiny
        return g / self.change(f), (turn @ self.found.root) / g[:, None]

    def change(self, f: Array) -> NDArray[np.complex128]:
        """1 - exp(-j w T), shape (F,), by which the response of the change of the output is divided; otherwise 1."""
        if not self.integrating:
            return np.ones(len(f), dtype=np.complex128)
        return np.asarray(1 - np.exp(-2j * np.pi * f * self.rec.sample_time))


def _impulse(rec: Record, slower: int) -> _Impulse:
    longest = max(s.stop - s.start for s in rec.stretches)
    if longest < SHORTEST:
        raise IdentError(
            f"the longest segment has {longest} samples: a frequency response needs {SHORTEST}. Record longer."
        )
    slow = block_means(rec.centred(), slower if longest // slower >= SHORTEST else 1)
    n = min(LONGEST, max(s.stop - s.start for s in slow.stretches) // 3)
    found = regularised_impulse(slow, n)
    if found.tail >= DECAYED and (integrating := _of_change(slow, n)):
        return integrating
    notes = () if found.tail < DECAYED else (
        f"the impulse response has not decayed within {n * slow.sample_time:.3g} s: peaks narrower than "
        f"{1 / (n * slow.sample_time):.2g} Hz are smoothed, which their error bars do not include",
    )  # fmt: skip
    return _Impulse(slow, found, notes)


def _of_change(slow: Record, n: int) -> _Impulse | None:
    """The same from the change of the output, where that decays: the plant integrates or is slow."""
    rows = np.ones(len(slow), dtype=bool)
    rows[list(slow.starts)] = False
    starts = tuple(s - k for k, s in enumerate(slow.starts))
    if min(np.diff([*starts, rows.sum()])) < 1:
        return None
    y = np.diff(slow.y, prepend=0.0)[rows]
    change = replace(slow, u=slow.u[rows], y=y, starts=starts, reference=None, sha256=None).centred()
    found = regularised_impulse(change, n)
    note = (
        f"the output does not settle within {n * slow.sample_time:.3g} s (integrating or slow): estimated from "
        "its change from sample to sample"
    )
    return _Impulse(change, found, (note,), True) if found.tail < DECAYED else None


def _unsuited(rec: Record, impulse: _Impulse, band: tuple[float, float]) -> str:
    """The reason why the impulse response is not used; empty where it is suited, or cannot be compared."""
    checked = np.geomspace(*band, CHECKED)
    if impulse.integrating:
        return ""
    local = local_polynomial(rec, checked)
    if local is None or np.isinf(local.variance).mean() > 0.5:
        return ""
    if impulse.notes:
        return impulse.notes[0].split(":")[0]
    usable = np.isfinite(local.variance)
    apart = np.abs(impulse.response(checked)[0] - local.response)[usable] ** 2 / local.variance[usable]
    rms = float(np.sqrt(apart.mean()))
    return "" if rms**2 <= CONSISTENT else f"the impulse response differs from it by {rms:.2g} standard errors (rms)"


def _by_impulse(impulse: _Impulse, f: Array, band: tuple[float, float], level: float) -> FrequencyResponse:
    """The response by the regularised impulse response."""
    g, slope = impulse.response(f)
    by_gain, by_phase = np.sqrt((slope.real**2).sum(axis=1)), np.sqrt((slope.imag**2).sum(axis=1))
    coherence = _coherence(impulse.rec, impulse.found, f, g * impulse.change(f))
    dof, width = np.full(len(f), impulse.found.dof), 1 / impulse.length
    return _with_bars(f, g, by_gain, by_phase, coherence, dof, band, width, level, "impulse", impulse.notes)


def _by_windows(
    f: Array, local: LocalEstimate, band: tuple[float, float], level: float, reason: str
) -> FrequencyResponse:
    """The local estimate with its error bars, its resolution, and where that does not suffice."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.abs(local.response) > 0, np.sqrt(local.variance / 2) / np.abs(local.response), np.inf)
    inside = (f >= band[0]) & (f <= band[1])
    inside = inside if inside.any() else np.ones_like(inside)
    widths = local.width[inside]
    notes = [
        f"local polynomial method{f' ({reason})' if reason else ''}: windows of {widths.min():.3g} to "
        f"{widths.max():.3g} Hz in the excited band"
    ]
    if (sharp := inside & local.unresolved).any():
        notes.append(
            f"the response varies within the narrowest window ({local.width[sharp].min():.2g} Hz) at "
            f"{f[sharp].min():.3g}{f' to {f[sharp].max():.3g}' if sharp.sum() > 1 else ''} Hz: record longer"
        )
    return _with_bars(
        f, local.response, share, share, local.coherence, local.dof, band, float(np.median(widths)), level, "local",
        tuple(notes),
    )  # fmt: skip


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
        low, high = gain * np.exp(-spread), np.maximum(gain, np.finfo(float).tiny) * np.exp(spread)
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
