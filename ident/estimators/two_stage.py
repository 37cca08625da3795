"""Two-stage estimate of a plant in closed loop: first the part of the input that the reference explains.

    u = F r + rest,      y = G F r + noise

F r holds next to none of the noise of y, so that the output is identified from it as in open loop, whatever the noise
and the controller. Source: Van den Hof & Schrama 1993, doi 10.1016/0005-1098(93)90121-G.
"""

from dataclasses import replace

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..model import Model
from .box_jenkins import box_jenkins
from .filters import lagged, squares

LENGTHS = (20, 40, 80, 160, 240)  # samples of the response from reference to input
WEAK = 1e-3  # of the largest singular value of the lagged reference
NOISE = 6  # order of the noise model
STILL = 1e-8  # of its size: a reference that varies less is constant
EXCITE = (
    "Record while the reference moves: steps of about 10 %, each held for longer than the loop settles, or a chirp; or "
    "excite the plant in open loop."
)


def two_stage(rec: Record, orders: tuple[int, int, int], nd: int = NOISE) -> Model:
    """Model of a record in closed loop from the part of its input that the reference explains.

    The output is identified from that part, which holds next to none of the noise, as in open loop; the response of the
    plant to the rest of u counts as noise.

    Parameters
    ----------
    rec : Record
        Centred, with its ``reference``.
    orders : (na, nb, nk)
    nd : int
        Order of the autoregressive noise model.

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
    >>> rng = np.random.default_rng(1)
    >>> e, y, u, r = *(0.01 * rng.standard_normal((1, 900))), *np.zeros((2, 900)), np.sign(rng.standard_normal(900))
    >>> for t in range(1, 900):
    ...     y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + e[t]
    ...     u[t] = 0.3 * (r[t] - y[t])
    >>> rec = Record(u=u, y=y, sample_time=0.02, reference=r).centred()
    >>> two_stage(rec, (1, 1, 1)).theta.round(2).tolist()
    [-0.8, 0.5]
    """
    explained = explained_by_reference(rec)
    na, nb, nk = orders
    free = replace(rec, u=explained, reference=None).centred()
    return box_jenkins(free, nb, na, nd, nk)


def explained_by_reference(rec: Record) -> Array:
    """The part of the input, shape (N,), that a finite impulse response from the reference explains.

    Its length is chosen by Schwarz's criterion; directions in which the reference holds next to no power are left out.
    """
    r = check_reference(rec)
    longest = max(s.stop - s.start for s in rec.stretches)
    found = []
    for length in LENGTHS:
        if length > longest // 3 and found:
            break
        columns = lagged(r, range(length), rec.stretches)
        Q, scale, _ = np.linalg.svd(columns, full_matrices=False)
        Q = Q[:, scale > WEAK * scale[0]]
        part = Q @ (Q.T @ rec.u)
        left = squares(rec.u - part) + 1e-12 * squares(rec.u)
        found.append((len(rec) * np.log(left) + Q.shape[1] * np.log(len(rec)), length, part))
    return min(found, key=lambda one: one[:2])[2]


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
            f"the reference does not vary ({rec.reference[0]:g} throughout): the data do not separate the plant from "
            f"its controller. {EXCITE}"
        )
    if shared**2 >= (1 - STILL) * power * float(u @ u):
        raise IdentError(
            f"reference and input {rec.input} are the same signal: the loop is open, or the wrong column was named. "
            "Leave --reference out, or name the set point of the controller."
        )
    return np.asarray(r)
