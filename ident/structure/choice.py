"""Criterion of candidate structures, guard against structure beyond the excited band, and weights.

Each candidate is judged with its own noise model: with V the variance of its innovations over n samples, p parameters
of the plant and m of the noise model, Schwarz's criterion is

    BIC = n ln V + (p + m) ln n.

A record without power above its excited band cannot reject poles there, and noise in the band can call for them. A
candidate pays where its gain beyond the band exceeds the largest in the band, and for each lightly damped pole there.
It also pays for a resonance narrower than 1 / duration, which the record cannot resolve: a pole of this kind, with a
zero near it, fits a spectral line of the noise or an initial state. A real pole with a time constant above the
duration, an integrator included, counts for one coefficient more: it fits drift. A pair of poles with a natural period
above the duration counts for two, one for each pole.
Weights of candidates are exp(-BIC difference / TEMPER): with TEMPER 2 they would be posterior probabilities of the
orders, which are too sure where every candidate is an approximation.

Sources: Schwarz 1978, Ann. Stat. 6, 461; Buckland, Burnham & Augustin 1997, doi 10.2307/2533961 (weights).
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array

BEYOND = 1.5  # frequency relative to the upper end of the excited band
RINGING = 0.9  # radius of a lightly damped pole
TEMPER = 4.0  # chosen by the coverage of bands in benchmarks/structure_bank.py: .93 with 2, .97 with 8
LEAST, MOST = 0.01, 8  # smallest weight and largest number of candidates that are kept
LIGHT = 0.3  # damping ratio below which a pair of poles is a resonance
UNRESOLVED = 4  # coefficients that a resonance below the resolution of the record counts for, and two for each factor e
LINE = 50  # the same beyond the band: nothing there responds to the input, it is a spectral line of the noise
GRID = 60  # frequencies of the guard, in and beyond the band


def criterion(n: int, variance: float, parameters: int, noise_order: int = 0) -> float:
    """Schwarz's criterion of a candidate.

    >>> round(criterion(100, 1.0, 2, 1), 3)
    13.816
    """
    return n * math.log(max(variance, np.finfo(float).tiny)) + (parameters + noise_order) * math.log(n)


def guard(b: Array, a: Array, sample_time: float, band: tuple[float, float], n: int) -> float:
    """Penalty of structure that the record cannot support, in units of the criterion; usually 0.

    Parameters
    ----------
    b, a : ndarray
        Polynomials in z^-1, b with its leading zeros.
    sample_time : float
        Seconds.
    band : (low, high)
        Excited band, Hz.
    n : int
        Number of samples of the record.

    Notes
    -----
    A pair of poles at radius r is a resonance with a width of -ln r / (pi T) in Hz at -3 dB.

    Examples
    --------
    >>> guard(np.array([0.0, 0.1]), np.array([1.0, -0.9]), 0.02, (0.1, 2.0), 750)
    0.0
    >>> guard(np.array([0.0, 0.1]), np.array([1.0, 0.95]), 0.02, (0.1, 2.0), 750) > 10  # rings at 25 Hz
    True
    """
    poles = np.asarray(np.roots(a), dtype=np.complex128)
    nyquist, start = 0.5 / sample_time, BEYOND * band[1]
    paid = _unresolved(poles, sample_time, n, start) + _slow(poles, n)
    if start < nyquist:
        paid += _beyond(b, a, *_grids(sample_time, band))
        paid += int(((np.abs(poles) > RINGING) & (np.abs(np.angle(poles)) > 2 * math.pi * start * sample_time)).sum())
    return float(paid * math.log(n))


@lru_cache(maxsize=8)  # the same for all candidates of a record
def _grids(sample_time: float, band: tuple[float, float]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """z^-1 at frequencies of the band and at those above it."""
    above = np.linspace(BEYOND * band[1], 0.5 / sample_time, GRID)
    inside, outside = (np.exp(-2j * np.pi * (f * sample_time)) for f in (np.geomspace(*band, GRID), above))
    return inside, outside


def _beyond(b: Array, a: Array, band: NDArray[np.complex128], above: NDArray[np.complex128]) -> float:
    """Twice the logarithm of the largest gain above the band over that in the band, both at z^-1; 0 if smaller."""
    inside, outside = float(np.max(_gain(b, a, band))), float(np.max(_gain(b, a, above)))
    return 2 * max(math.log(outside / inside), 0.0) if inside > 0 and outside > 0 else 0.0


def _unresolved(poles: NDArray[np.complex128], sample_time: float, n: int, start: float) -> float:
    """Coefficients that resonances narrower than the resolution of the record count for; more above ``start`` Hz."""
    log = np.log(poles[poles.imag > 0])
    light = log[-log.real < LIGHT * np.abs(log)]
    width = np.maximum(-light.real, 1e-9) / (math.pi * sample_time)
    narrow = np.log(1 / (n * sample_time * width))
    least = np.where(light.imag > 2 * math.pi * start * sample_time, LINE, UNRESOLVED)
    return float(np.sum((least + 2 * narrow)[narrow > 0]))


def _slow(poles: NDArray[np.complex128], n: int) -> int:
    """Number of real poles with a time constant above the duration of the record, and of pairs with such a period."""
    is_real = np.abs(poles.imag) < 1e-9
    pairs = np.log(poles[~is_real])
    return int((poles.real[is_real] > math.exp(-1 / n)).sum() + (np.abs(pairs) < 2 * math.pi / n).sum())


def _gain(b: Array, a: Array, z: NDArray[np.complex128]) -> Array:
    """|b / a| at z^-1 = z."""
    return np.asarray(np.abs(np.polyval(b[::-1], z)) / np.maximum(np.abs(np.polyval(a[::-1], z)), 1e-12))


def weights(criteria: ArrayLike, direct: ArrayLike | None = None) -> Array:
    """Weights of candidates, sum 1; zero for those of little weight.

    Parameters
    ----------
    criteria : array_like, shape (C,)
        Criterion plus guard.
    direct : array_like of bool, shape (C,), optional
        Whether a candidate responds in the same sample (nk = 0): such a one has no weight where the best one does
        not, because behind a zero-order hold it is an artefact, and no digital PI without delay can be tuned on it.

    Examples
    --------
    >>> weights([0.0, 4 * np.log(3.0), 1000.0]).round(6).tolist()
    [0.75, 0.25, 0.0]
    """
    bic = np.asarray(criteria, dtype=np.float64)
    w = np.exp(-(bic - bic.min()) / TEMPER)
    if direct is not None:
        at_once = np.asarray(direct, dtype=bool)
        w[at_once & ~at_once[np.argmin(bic)]] = 0.0
    w[np.argsort(-w, kind="stable")[MOST:]] = 0.0
    w[w < LEAST * w.sum()] = 0.0
    return np.asarray(w / w.sum())
