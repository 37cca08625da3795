"""Frequency response by local polynomials: the one estimator with honest error bars for a single sweep.

About each frequency the response and the transient are smooth, the input of a sweep is not. So within a window of bins

    Y(k) = G(k) U(k) + T(k) + V(k),    G and T polynomials of degree 2 in frequency, T of each stretch its own

is a linear regression; what it leaves is the noise, and the error of G follows from it. Nothing is averaged, so one
record will do, and no window leaks. Source: Pintelon & Schoukens 2012, System Identification, section 7.2.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..datasets.record import Record
from .errors import IdentError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
DEGREE = 2
BINS = 13  # in a window: 6 coefficients and 7 to tell the noise by
SHORTEST = 2 * BINS  # samples of a stretch


@dataclass(frozen=True, slots=True)
class LocalFit:
    """G at one frequency, its standard error (complex), coherence, and the complex degrees of freedom."""

    g: complex
    error: float
    coherence: float
    dof: int


@dataclass(frozen=True, slots=True)
class Spectra:
    """Transforms of each stretch: frequencies in Hz, U and Y, scaled by the root of the number of samples."""

    f: tuple[Array, ...]
    U: tuple[Complex, ...]
    Y: tuple[Complex, ...]

    @property
    def step(self) -> float:
        """Distance of the bins of the longest stretch, Hz."""
        return float(min(f[0] for f in self.f))


def spectra(rec: Record) -> Spectra:
    """Transforms of the stretches that are long enough, without the mean."""
    out: tuple[list[Array], list[Complex], list[Complex]] = ([], [], [])
    for s in rec.stretches:
        n = s.stop - s.start
        if n < SHORTEST:
            continue
        out[0].append(np.fft.rfftfreq(n, rec.sample_time)[1:])
        for values, to in ((rec.u, out[1]), (rec.y, out[2])):
            to.append(np.fft.rfft(values[s] - values[s].mean())[1:] / sqrt(n))
    if not out[0]:
        longest = max(s.stop - s.start for s in rec.stretches)
        raise IdentError(f"the longest stretch has {longest} samples: a frequency response needs {SHORTEST}. Record longer.")
    return Spectra(*map(tuple, out))


def bins_of_window(band_bins: float) -> int:
    """Bins in a window: 13, more where the excited band has so many that the response stays smooth across them."""
    return max(BINS, round(sqrt(band_bins)))


def local_fit(found: Spectra, at: float, width: float) -> LocalFit:
    """The regression in a window of ``width`` Hz about ``at``, moved inward at the ends of the axis."""
    low, high = found.step, float(max(f[-1] for f in found.f))
    centre = min(max(at, low + width / 2 - found.step / 2), max(high - width / 2, low))
    K, y = rows(found, at, centre, width)
    length = np.linalg.norm(K, axis=0)
    length[length == 0] = 1.0
    dof = len(y) - K.shape[1]
    if dof < 3:
        raise IdentError(f"{len(y)} bins about {at:.3g} Hz for {K.shape[1]} coefficients: widen the resolution.")
    theta, _, rank, _ = np.linalg.lstsq(K / length, y, rcond=None)
    left = y - K / length @ theta
    noise = float(np.vdot(left, left).real) / dof
    inverse = np.linalg.pinv(K / length)
    explained = K[:, : DEGREE + 1] @ (theta / length)[: DEGREE + 1]
    signal = float(np.vdot(explained, explained).real) / len(y)
    error = sqrt(noise) * float(np.linalg.norm(inverse[0])) / float(length[0])
    return LocalFit(complex(theta[0] / length[0]), error if rank == K.shape[1] else np.inf, share(signal, noise), dof)


def rows(found: Spectra, at: float, centre: float, width: float) -> tuple[Complex, Complex]:
    """Regressors G_0 ... G_R, then T_0 ... T_R of each stretch, and Y."""
    blocks, ys = [], []
    for f, U, Y in zip(found.f, found.U, found.Y, strict=True):
        inside = np.flatnonzero(np.abs(f - centre) <= width / 2 * (1 + 1e-9))
        if len(inside) > DEGREE + 1:
            powers = ((f[inside] - at) / (width / 2))[:, None] ** np.arange(DEGREE + 1)
            blocks.append((powers * U[inside, None], powers.astype(np.complex128)))
            ys.append(Y[inside])
    if not ys:
        raise IdentError(f"no stretch has {DEGREE + 2} bins within {width:.3g} Hz of {at:.3g} Hz: widen the resolution.")
    K = np.zeros((sum(map(len, ys)), (DEGREE + 1) * (1 + len(ys))), dtype=np.complex128)
    begin = 0
    for k, (of_g, of_t) in enumerate(blocks):
        end = begin + len(of_g)
        K[begin:end, : DEGREE + 1] = of_g
        K[begin:end, (DEGREE + 1) * (k + 1) : (DEGREE + 1) * (k + 2)] = of_t
        begin = end
    return K, np.concatenate(ys)


def share(signal: float, noise: float) -> float:
    """Coherence: the part of the output's power that the input tells of."""
    return signal / (signal + noise) if signal + noise > 0 else 0.0
