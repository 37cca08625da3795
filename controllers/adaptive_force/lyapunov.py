"""The energy of LYAP's proof along a run, which the plant's true numbers are needed for: a study, no controller has it.

    V = e' P e + phi~' Gamma^-1 phi~,    e = (F~, F~'),    phi~ = (m^ - m, alpha^ - alpha, beta^ - beta) / k
    P = [[beta + Kd lambda + lambda (alpha + Kd), lambda m], [lambda m, m]] / k,    Gamma = diag(g1, g2, g3)

The paper prints V (9) without P. With this one

    V' = -2 (alpha + Kd - lambda m) F~'^2 - 2 lambda (beta + Kd lambda) F~^2

so that V falls where alpha + Kd > lambda m (all of alpha, beta, m over k). Averaged over a revolution the two equations
hold as they stand, with the averages of force, F_d and command; so V is taken with the error that the law is fed.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import UsageError

if TYPE_CHECKING:
    from ..loop import Trace
    from .process import DriveAndCut
    from .settings import Settings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
RECORDED = (
    "m", "alpha", "beta", "error", "error_rate", "limited", "closed", "adapting", "k", "force", "speed",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Energy:
    """V along a run.

    Attributes
    ----------
    V : ndarray, shape (n,)
    free : ndarray of bool, shape (n,)
        Where the proof speaks: nothing limited and the depth the same, for a revolution.
    rise : float
        The largest rise of V above what it had fallen to, within a stretch where the proof speaks, as a share of V
        at the beginning of that stretch.
    largest : float
        The largest such rise as it is, in the unit of V: where a stretch begins near zero, its share says little.
    starts : tuple of int
        First samples of the stretches.
    """

    V: Array
    free: Bools
    rise: float
    largest: float
    starts: tuple[int, ...]


def P(m: Array, alpha: Array, beta: Array, Kd: float, lam: float) -> Array:
    """The matrix of the proof, shape (n, 2, 2); m, alpha, beta over k, shape (n,).

    Raises
    ------
    UsageError
        alpha + Kd is not above lambda m: V need not fall.

    Examples
    --------
    >>> P(np.array([2e-3]), np.array([0.125]), np.array([1.25]), Kd=0.05, lam=30.0).round(3).tolist()
    [[[8.0, 0.06], [0.06, 0.002]]]
    """
    if not (alpha + Kd > lam * m).all():
        raise UsageError("alpha + Kd is not above lambda m, so V need not fall: lower lambda or raise Kd.")
    return np.array([[beta + Kd * lam + lam * (alpha + Kd), lam * m], [lam * m, m]]).transpose(2, 0, 1)


def energy(trace: "Trace", settings: "Settings", plant: "DriveAndCut") -> Energy:
    """V along a replay that recorded `RECORDED`.

    Parameters
    ----------
    trace : Trace
    settings : Settings
        Of the controller.
    plant : DriveAndCut
        Of the run: its m, d, c; k is in the trace.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from .control import AdaptiveForceControl
    >>> from ..loop import replay
    >>> from .process import DriveAndCut
    >>> control = AdaptiveForceControl.from_parameters(published("LYAP"), depth=4.0)
    >>> plant = DriveAndCut(depth=4.0)
    >>> trace = replay(control, plant, duration=1.0, dt=0.001, record=RECORDED)
    >>> energy(trace, control.settings, plant).rise < 1e-12
    True
    """
    r = trace.recorded
    e, estimates = (np.column_stack([r[name] for name in names]) for names in (RECORDED[3:5], RECORDED[:3]))
    V = values_of_V(e, estimates, settings, plant, r["k"])
    free = _free(r["adapting"] > 0, r["k"], settings.samples)
    return Energy(V, free, *rise_of(V, free))


def values_of_V(e: Array, estimates: Array, settings: "Settings", plant: "DriveAndCut", k: Array) -> Array:
    """V (n,) of errors (n, 2), of estimates of m, alpha, beta over k (n, 3) and of the plant's k (n,)."""
    s = settings
    true = np.column_stack([plant.m / k, (plant.m * plant.c + plant.d) / k, plant.d * plant.c / k])
    matrix = P(true[:, 0], true[:, 1], true[:, 2], s.Kd, s.lam)
    V = np.einsum("ni,nij,nj->n", e, matrix, e)
    rates = np.array([s.g1, s.g2, s.g3])
    taught = rates > 0  # a rate of 0 leaves its estimate, and its part of V, as it is
    return np.asarray(V + ((estimates - true)[:, taught] ** 2 / rates[taught]).sum(axis=1), dtype=np.float64)


def _free(adapting: Bools, k: Array, samples: int) -> Bools:
    """Where nothing was limited and the depth the same for a revolution: the error is an average of it."""
    free = adapting.copy()
    for change in np.r_[np.flatnonzero(np.diff(k)), np.flatnonzero(~adapting)] + 1:
        free[change : change + samples + 1] = False
    return free


def rise_of(V: Array, free: Bools) -> tuple[float, float, tuple[int, ...]]:
    """The largest rise of a row (n,) within stretches marked free: as a share of the first value there, and as it is.

    >>> rise_of(np.array([4.0, 2.0, 3.0, 9.0]), np.array([True, True, True, False]))
    (0.25, 1.0, (0,))
    """
    edges = np.flatnonzero(np.diff(np.r_[False, free, False].astype(int)))
    share, largest, starts = 0.0, 0.0, edges[::2]
    for start, end in zip(starts, edges[1::2], strict=True):
        part = V[start:end]
        above = float((part - np.minimum.accumulate(part)).max())
        largest = max(largest, above)
        share = max(share, above / float(part[0])) if part[0] > 0 else share
    return share, largest, tuple(int(start) for start in starts)
