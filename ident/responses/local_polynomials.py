"""Local polynomial method: the frequency response and the transient of a record as polynomials in narrow windows.

    Y(k + r) = (g_0 + g_1 r + g_2 r^2) U(k + r) + t_0 + t_1 r + t_2 r^2 + V(k + r),    r = -n ... n

U, Y are discrete Fourier transforms of one segment; t is the transient (leakage) of its initial and final state, which
is smooth in frequency as the response is. g_0 is the estimate and the residuals give its variance; the cost is that of
the transforms, O(N log N). All segments share g, each has its own t.

A wide window averages more noise and a narrow one smooths less, so that windows of several widths are compared at each
frequency. The one with the smallest estimated squared error is taken, variance plus squared smoothing error: the
largest squared difference to a narrower window that exceeds 4 variances of that window (Goldenshluger & Lepski). The
error bars add the squared difference to a window of half the width (for the narrowest ones, to the next wider one).

Sources: Pintelon, Schoukens, Vandersteen & Barbe 2010, doi 10.1016/j.ymssp.2009.08.010; Goldenshluger & Lepski 2011,
doi 10.1214/11-AOS883.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Flags
from ...datasets.records.record import Record

Complex = NDArray[np.complex128]
ORDER = 2  # of both polynomials
NARROWEST, WIDEST = 5, 256  # half widths in bins of the longest segment; 11 bins leave 5 degrees of freedom
GROWTH = 2**0.5  # from one half width to the next
HALF = 2  # steps of that growth to half the width
SHARE = 8  # of the bins of a record, the widest window
AGREE = 4.0  # variances: narrower windows that differ by less give no evidence of smoothing
CERTAIN = 16.0  # variances, beyond which a difference of the two narrowest windows is not by chance
DETERMINED = 1e-9  # smallest eigenvalue of the scaled equations: below, the input has too few lines in the window
ROUNDING = 1e-20  # of the largest power of the input
BLOCK = 256  # frequencies at a time


@dataclass(frozen=True, slots=True)
class LocalEstimate:
    """Estimate at F frequencies.

    Attributes
    ----------
    response : ndarray of complex, shape (F,)
    variance : ndarray, shape (F,)
        Expected squared modulus of its error, smoothing included; infinite where the input does not determine it.
    dof : ndarray, shape (F,)
        Complex degrees of freedom of the residuals.
    width : ndarray, shape (F,)
        Width of the window, Hz.
    coherence : ndarray, shape (F,)
    unresolved : ndarray of bool, shape (F,)
        The narrowest window was taken and the next wider one differs: the response may vary within it.
    """

    response: Complex
    variance: Array
    dof: Array
    width: Array
    coherence: Array
    unresolved: Flags


@dataclass(frozen=True, slots=True)
class _Spectrum:
    """Transforms of a segment over the root of its length L, and its length relative to the longest."""

    U: Complex
    Y: Complex
    samples: int
    share: float


@dataclass(frozen=True, slots=True)
class _Window:
    """Estimates of one window width: response, variance, coherence (F,), and degrees of freedom."""

    response: Complex
    variance: Array
    coherence: Array
    dof: int


def half_widths(longest: int) -> list[int]:
    """Half widths of the windows in bins, of a segment of so many samples; empty for less than about 90.

    >>> half_widths(1000)
    [5, 7, 10, 14, 20, 28, 40, 57]
    """
    most = min(WIDEST, (longest // 2 - 2) // SHARE)
    steps = int(np.floor(np.log(max(most, 1) / NARROWEST) / np.log(GROWTH) + 1e-9))
    return [round(NARROWEST * GROWTH**k) for k in range(steps + 1)]


def local_polynomial(rec: Record, frequency: Array) -> LocalEstimate | None:
    """Frequency response at frequencies, shape (F,), Hz; None for a record too short for two windows."""
    longest = max(s.stop - s.start for s in rec.stretches)
    widths = half_widths(longest)
    if len(widths) < 2:
        return None
    spectra = [_spectrum(rec, s, longest) for s in rec.stretches]
    blocks = [frequency[k : k + BLOCK] for k in range(0, len(frequency), BLOCK)]
    parts = [_chosen([_window(spectra, rec.rate, longest, n, f) for n in widths], widths) for f in blocks]
    response, variance, dof, width, coherence, unresolved = (
        np.concatenate([part[k] for part in parts]) for k in range(6)
    )
    return LocalEstimate(response, variance, dof, (2 * width + 1) * rec.rate / longest, coherence, unresolved)


def _spectrum(rec: Record, s: slice, longest: int) -> _Spectrum:
    n = s.stop - s.start
    U, Y = (np.fft.rfft(values[s] - values[s].mean()) / np.sqrt(n) for values in (rec.u, rec.y))
    return _Spectrum(U, Y, n, n / longest)


def _window(spectra: list[_Spectrum], rate: float, longest: int, half: int, f: Array) -> _Window:
    """Least squares in windows of one width around each frequency, shape (F,)."""
    terms, F = ORDER + 1, len(f)
    A, b = np.zeros((F, terms, terms), dtype=np.complex128), np.zeros((F, terms), dtype=np.complex128)
    yy, power, rows, dof = np.zeros(F), np.zeros(F), 0, -terms
    for part in spectra:
        n = round(half * part.share)
        bins, last = 2 * n + 1, (part.samples - 1) // 2
        if bins <= terms or bins > last:
            continue
        first = np.clip(np.rint(f * part.samples / rate).astype(np.intp) - n, 1, last - bins + 1)
        k = first[:, None] + np.arange(bins)
        r = (k * (rate / part.samples) - f[:, None]) * (longest / (half * rate))
        u, y = part.U[k], part.Y[k]
        Z = u[:, :, None] * r[:, :, None] ** np.arange(terms)
        # orthonormal polynomials of the transient, the same in every window
        Q = np.linalg.qr(np.linspace(-1, 1, bins)[:, None] ** np.arange(terms))[0]
        Z -= np.einsum("ij,fjk->fik", Q, np.einsum("ij,fik->fjk", Q, Z))
        y = y - (y @ Q) @ Q.T
        H = Z.conj().transpose(0, 2, 1)
        A += H @ Z
        b += (H @ y[:, :, None])[:, :, 0]
        yy += (np.abs(y) ** 2).sum(axis=1)
        power += (np.abs(u) ** 2).sum(axis=1)
        rows, dof = rows + bins, dof + bins - terms
    floor = ROUNDING * max(float((np.abs(part.U) ** 2).max()) for part in spectra)
    return _solved(A, b, yy, power / max(rows, 1), dof, floor)


def _solved(A: Complex, b: Complex, yy: Array, power: Array, dof: int, floor: float) -> _Window:
    """Response and variance from the normal equations, scaled to a unit diagonal; ``floor`` is rounding of A."""
    size = np.sqrt(np.maximum(np.einsum("fii->fi", A).real, floor))
    scaled = A / (size[:, :, None] * size[:, None, :])
    values, vectors = np.linalg.eigh(scaled)
    kept, own = values > DETERMINED, np.abs(vectors[:, 0]) ** 2
    determined = ((own * ~kept).sum(axis=1) < DETERMINED) & (dof > 0)
    inverse = kept / np.where(kept, values, 1.0)
    along = np.einsum("fij,fi->fj", vectors.conj(), b / size)
    x = np.einsum("fij,fj->fi", vectors, inverse * along)
    noise = np.maximum(yy - (inverse * np.abs(along) ** 2).sum(axis=1), 1e-26 * yy) / max(dof, 1)
    variance = noise * (inverse * own).sum(axis=1) / size[:, 0] ** 2
    response = x[:, 0] / size[:, 0]
    signal = np.abs(response) ** 2 * power
    coherence = np.divide(signal, signal + noise, out=np.zeros_like(signal), where=signal + noise > 0)
    return _Window(response, np.where(determined, variance, np.inf), coherence, dof)


def _chosen(windows: list[_Window], widths: list[int]) -> tuple[Complex, Array, Array, Array, Array, Flags]:
    """Response, variance, degrees of freedom, half width, coherence and whether the response is not resolved."""
    G, V = np.array([w.response for w in windows]), np.array([w.variance for w in windows])
    coherence, dof = np.array([w.coherence for w in windows]), np.array([float(w.dof) for w in windows])
    smoothing = np.zeros_like(V)
    for j in range(1, len(windows)):
        smoothing[j] = np.maximum(0.0, (np.abs(G[j] - G[:j]) ** 2 - AGREE * V[:j]).max(axis=0))
    best, at = (smoothing + V).argmin(axis=0), np.arange(G.shape[1])
    other = np.where(best >= HALF, best - HALF, best + 1)
    other = np.where(np.isfinite(V[other, at]), other, np.minimum(best + 1, len(windows) - 1))
    variance = V[best, at] + np.abs(G[best, at] - G[other, at]) ** 2
    unresolved = (best == 0) & (np.abs(G[1] - G[0]) ** 2 > CERTAIN * V[0])
    return G[best, at], variance, dof[best], np.array(widths)[best], coherence[best, at], unresolved
