"""Two-stage estimate of a plant in closed loop: first the part of the input that the reference explains.

    u = F r + rest,      y = G F r + noise

F r holds next to none of the noise of y, so that the output is identified from it as in open loop, whatever the noise
and the controller. Source: Van den Hof & Schrama 1993, doi 10.1016/0005-1098(93)90121-G.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..model import Model
from .filters import filtered, squares

POLES, NUMBERS = (0.0, 0.6, 0.8, 0.9, 0.95, 0.98), (10, 20, 40)  # of the Laguerre functions; 0 are single lags
WEAK = 1e-3  # of the largest singular value of the lagged reference
STILL = 1e-8  # of its size: a reference that varies less is constant
EXCITE = (
    "Record while the reference moves: steps of about 10 %, each held for longer than the loop settles, or a chirp; or "
    "excite the plant in open loop."
)


def two_stage(rec: Record, estimate: Callable[[Record], Model]) -> Model:
    """Model of a record in closed loop from the part of its input that the reference explains.

    The output is identified from that part, which holds next to none of the noise, as in open loop; the response of the
    plant to the rest of u counts as noise.

    Parameters
    ----------
    rec : Record
        Centred, with its ``reference``.
    estimate : callable
        Estimates a model without bias from a record in open loop.

    Returns
    -------
    Model
        Consistent whatever the noise and the controller; less accurate than the direct estimate.

    Raises
    ------
    IdentError
        No reference, one that does not vary or is the input itself, or too short a record.

    Examples
    --------
    >>> from fitmodels.ident.estimators.plant_and_noise import box_jenkins
    >>> rng = np.random.default_rng(1)
    >>> e, y, u, r = *(0.01 * rng.standard_normal((1, 900))), *np.zeros((2, 900)), np.sign(rng.standard_normal(900))
    >>> for t in range(1, 900):
    ...     y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + e[t]
    ...     u[t] = 0.3 * (r[t] - y[t])
    >>> rec = Record(u=u, y=y, sample_time=0.02, reference=r).centred()
    >>> two_stage(rec, lambda part: box_jenkins(part, 1, 1, 1)).theta.round(2).tolist()
    [-0.8, 0.5]
    """
    explained = explained_by_reference(rec)
    return estimate(replace(rec, u=explained, reference=None, sha256=None).centred())


def explained_by_reference(rec: Record) -> Array:
    """The part of the input, shape (N,), that a response to the reference in Laguerre functions explains.

    Their pole and number are chosen by Schwarz's criterion; directions in which the reference holds next to no power
    are left out. Source: Wahlberg 1991, doi 10.1109/9.76358.
    """
    r, n = check_reference(rec), len(rec)
    found = []
    for pole in POLES:
        columns = _laguerre(r, pole, max(NUMBERS), rec.stretches)
        for number in NUMBERS:
            Q, scale, _ = np.linalg.svd(columns[:, : number + 1], full_matrices=False)
            Q = Q[:, scale > WEAK * scale[0]]
            part = Q @ (Q.T @ rec.u)
            left = squares(rec.u - part) + 1e-12 * squares(rec.u)
            found.append((n * np.log(left) + Q.shape[1] * np.log(n), part))
    return min(found, key=lambda one: one[0])[1]


def _laguerre(r: Array, pole: float, number: int, stretches: Sequence[slice]) -> Array:
    """The reference, and the reference filtered by Laguerre functions, shape (N, number + 1)."""
    out = np.empty((len(r), number + 1), order="F")
    out[:, 0] = r
    out[:, 1] = filtered([0.0, np.sqrt(1 - pole**2)], [1.0, -pole], r, stretches)
    for k in range(2, number + 1):
        out[:, k] = filtered([-pole, 1.0], [1.0, -pole], out[:, k - 1], stretches)
    return out


def check_reference(rec: Record) -> Array:
    """The reference of a record; IdentError if there is none, if it does not vary, or if it is the input itself."""
    if rec.reference is None:
        raise IdentError("the record has no reference: read it with its column (--reference COLUMN).")
    r = rec.centred().reference
    u = rec.centred().u
    assert r is not None  # noqa: S101  of a record that has one
    power, shared = float(r @ r), float(r @ u)
    if power <= STILL**2 * max(float(np.sum(rec.reference**2)), 1e-300):
        raise IdentError(
            f"the reference does not vary: the data do not separate the plant from its controller. {EXCITE}"
        )
    if shared**2 >= (1 - STILL) * power * float(u @ u):
        raise IdentError(
            f"reference and input {rec.input} are the same signal: the loop is open, or the wrong column was named. "
            "Leave --reference out, or name the set point of the controller."
        )
    return np.asarray(r)
