"""ARX by least squares: one linear regression of y(t) on past outputs and inputs.

    y(t) + a_1 y(t-1) + ... + a_na y(t-na) = b_nk u(t-nk) + ... + b_(nk+nb-1) u(t-nk-nb+1) + e(t)

Unbiased only where e is white, that is where noise enters through the poles of the machine; noise of a sensor bends it
towards models that are too fast and too weak. Source: Ljung 1999, System Identification, sections 4.2 and 7.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...datasets.records.record import Record, join_records
from ..model import Model
from .input_checks import (
    check_length,
    check_moves,
    check_orders,
    collinear_error,
    dependent,
    identifiable_orders,
    not_centred,
    short_stretches,
)
from .regressors import Lags, gram, r_of, triangle

Array = NDArray[np.float64]
Solver = Literal["auto", "gram", "qr"]

# Largest relative error that products of columns may bring into coefficients or residual variance; QR above it.
# It is reached at a condition number of about 2000: nine digits are beyond every sensor, and only what has no noise
# at all wants more.
SHORT = 1e-9
EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class _Solved:
    """theta and rss of y = phi theta, the inverse of the triangle of phi, and the error products would bring."""

    theta: Array
    inverse: Array
    rss: float
    condition: float
    error: float
    notes: tuple[str, ...] = ()


def arx(rec: Record | Sequence[Record], na: int, nb: int, nk: int = 1, *, solver: Solver = "auto") -> Model:
    """ARX model of one order by least squares, from one pass over the data.

    Parameters
    ----------
    rec : Record or sequence of Record
        Centred (``rec.centred()``): the model has no constant. Several records are joined, and no regressor crosses a
        join.
    na : int
        Order of a, 0 or more.
    nb : int
        Coefficients of b, 1 or more.
    nk : int
        Samples of delay; 1 is the first possible response, 0 an answer within the sample.
    solver : str
        ``gram`` products of the columns, ``qr`` of the regressors in blocks, ``auto`` the first unless its digits
        would fall short.

    Returns
    -------
    Model
        With classical covariance ``s^2 (phi' phi)^-1`` and s^2 = rss / (rows - na - nb).

    Raises
    ------
    IdentError
        Orders that do not exist, a record too short for them, input or output that does not vary, collinear regressors.

    Examples
    --------
    >>> from scipy.signal import lfilter
    >>> u = np.sign(np.random.default_rng(1).standard_normal(200))
    >>> model = arx(Record(u=u, y=lfilter([0, 0.5], [1, -0.8], u), sample_time=0.02), na=1, nb=1)
    >>> model.params.round(12).to_dict()
    {'a1': -0.8, 'b1': 0.5}
    """
    check_orders(na, nb, nk)
    rec = rec if isinstance(rec, Record) else join_records(rec)
    rows = check_length(rec, na, nb, nk)
    check_moves(rec)
    solved = _solve(rec, na, nb, nk, solver)
    a, b = np.concatenate([[1.0], -solved.theta[:na]]), np.concatenate([np.zeros(nk), solved.theta[na:]])
    variance = solved.rss / (rows - na - nb)
    signed = np.repeat([-1.0, 1.0], [na, nb])[:, None] * solved.inverse
    return Model(
        b=b,
        a=a,
        nk=nk,
        sample_time=rec.sample_time,
        structure="arx",
        cov_params=variance * (signed @ signed.T),
        noise_variance=variance,
        n=rows,
        record=rec.sha256,
        input=rec.input,
        output=rec.output,
        unit_u=rec.unit_u,
        unit_y=rec.unit_y,
        operating_point=_operating_point(rec),
        notes=(
            *rec.notes,
            *not_centred(rec),
            *short_stretches(rec, max(na, nk + nb - 1)),
            *solved.notes,
            *_unstable(a),
        ),
    )


def _solve(rec: Record, na: int, nb: int, nk: int, solver: Solver) -> _Solved:
    lags = Lags(na, nk, nk + nb - 1)
    if solver != "qr":
        solved = _from_gram(gram(rec, lags).block(na, nb, nk))
        if solved is not None and (solver == "gram" or solved.error <= SHORT):
            return solved
    r = r_of(triangle(rec, lags).matrix[:, lags.columns(na, nb, nk)])
    if dependent(r[:-1, :-1]).any():
        raise collinear_error(na, nb, nk, identifiable_orders(r[:, :-1], na, nb))
    solved = _from_triangle(r)
    note = (
        f"regressors nearly collinear or residuals small (condition number {solved.condition:.1e}, residual "
        f"{np.sqrt(solved.rss) / np.linalg.norm(r[:, -1]):.1e} of the output): solved by QR, which keeps the digits."
    )
    return replace(solved, notes=() if solver == "qr" else (note,))


def _from_gram(g: Array) -> _Solved | None:
    """From products of the columns, y last; None where they are not positive definite to rounding."""
    length = np.sqrt(np.diag(g))
    if not length.all():
        return None
    try:
        lower = np.linalg.cholesky(g / np.outer(length, length))
    except np.linalg.LinAlgError:
        return None
    return _from_triangle(lower.T * length)


def _from_triangle(r: Array) -> _Solved:
    """From the triangle of [phi y]; the condition number is that of columns scaled to one length."""
    length = np.sqrt((r * r).sum(axis=0))
    scaled = r / length
    inverse = np.linalg.solve(scaled[:-1, :-1], np.eye(len(r) - 1))
    theta = inverse @ scaled[:-1, -1]
    condition = float(np.sqrt((inverse * inverse).sum() * len(inverse)))
    left = float(scaled[-1, -1]) ** 2
    # of theta, and of rss, a small difference of products of y with itself
    error = EPS * max(condition**2, float(1 + theta @ theta) / max(left, EPS**2))
    over = length[:-1]
    return _Solved(theta * length[-1] / over, inverse / over[:, None], left * length[-1] ** 2, condition, error)


def _unstable(a: Array) -> tuple[str, ...]:
    if _inside(a.tolist()):
        return ()
    radius = np.abs(np.roots(a)).max()
    return (
        f"unstable: a pole at radius {radius:.4g}, so a free run grows without bound however well it fits one step "
        "ahead. Try nk = 0 or lower orders, or output error.",
    )


def _inside(a: list[float]) -> bool:
    """Whether every root lies inside the unit circle, by reflection coefficients (Schur and Cohn): no eigenvalues."""
    while len(a) > 1:
        last = a[-1]
        if not abs(last) < 1:
            return False
        a = [(p - last * q) / (1 - last * last) for p, q in zip(a[:-1], a[:0:-1], strict=True)]
    return True


def _operating_point(rec: Record) -> tuple[float, float]:
    """Mean of what was taken off, by samples of each stretch."""
    assert rec.offsets is not None  # noqa: S101  set by the record
    weights = np.array([s.stop - s.start for s in rec.stretches], dtype=np.float64)
    u, y = weights @ rec.offsets / weights.sum()
    return float(u), float(y)
