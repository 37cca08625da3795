"""ARX by least squares: one linear regression of y(t) on past outputs and inputs.

    y(t) + a_1 y(t-1) + ... + a_na y(t-na) = b_nk u(t-nk) + ... + b_(nk+nb-1) u(t-nk-nb+1) + e(t)

Unbiased only for white e, that is for noise that enters through the poles of the plant; sensor noise biases the
estimate towards models that are too fast and have too low a gain. Source: Ljung 1999, System Identification, sections
4.2 and 7.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...core.arrays import Array
from ...datasets.records.record import Record, join_records
from ..model import Model
from .build_model import record_facts
from .filters import is_stable
from .input_checks import (
    check_length,
    check_orders,
    check_varies,
    collinear_error,
    dependent,
    identifiable_orders,
    not_centred,
    short_stretches,
)
from .regressors import Lags, gram, r_of, triangle

Solver = Literal["auto", "gram", "qr"]

# Largest relative error of coefficients or residual variance by the normal equations; QR is used above it.
# It is reached at a condition number of about 2000: more than nine digits matter for noise-free records only.
INACCURATE = 1e-9
EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class _Solved:
    """theta and rss of y = phi theta, the inverse of the triangle of phi, and the error of the normal equations."""

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
        Centred (``rec.centred()``): the model has no constant. Several records are joined; no regressor crosses a
        boundary.
    na : int
        Order of a, 0 or more.
    nb : int
        Coefficients of b, 1 or more.
    nk : int
        Samples of delay; 1 is the first possible response, 0 a response within the sample.
    solver : str
        ``gram`` (normal equations), ``qr`` of the regressors in blocks, or ``auto``: the first unless it is inaccurate.

    Returns
    -------
    Model
        With classical covariance ``s^2 (phi' phi)^-1`` and s^2 = rss / (rows - na - nb).

    Raises
    ------
    IdentError
        Invalid orders, too short a record, a constant input or output, collinear regressors.

    Examples
    --------
    >>> from scipy.signal import lfilter
    >>> u = np.sign(np.random.default_rng(1).standard_normal(200))
    >>> model = arx(Record(u=u, y=lfilter([0, 0.5], [1, -0.8], u), sample_time=0.02), na=1, nb=1)
    >>> model.params.round(12).to_dict()
    {'a1': -0.8, 'b1': 0.5}
    """
    check_orders(na=na, nb=nb, nk=nk)
    rec = rec if isinstance(rec, Record) else join_records(rec)
    rows = check_length(rec, na, nb, nk)
    check_varies(rec)
    solved = _solve(rec, na, nb, nk, solver)
    a, b = np.concatenate([[1.0], -solved.theta[:na]]), np.concatenate([np.zeros(nk), solved.theta[na:]])
    variance = solved.rss / (rows - na - nb)
    signed = np.repeat([-1.0, 1.0], [na, nb])[:, None] * solved.inverse
    return Model(
        b=b, a=a, nk=nk, structure="arx", cov_params=variance * (signed @ signed.T), noise_variance=variance,
        notes=(*rec.notes, *not_centred(rec), *short_stretches(rec, max(na, nk + nb - 1)), *solved.notes,
               *_unstable(a)),
        **{**record_facts(rec), "n": rows},
    )  # fmt: skip


def _solve(rec: Record, na: int, nb: int, nk: int, solver: Solver) -> _Solved:
    lags = Lags(na, nk, nk + nb - 1)
    if solver != "qr":
        solved = _from_gram(gram(rec, lags).block(na, nb, nk))
        if solved is not None and (solver == "gram" or solved.error <= INACCURATE):
            return solved
    r = r_of(triangle(rec, lags).matrix[:, lags.columns(na, nb, nk)])
    if dependent(r[:-1, :-1]).any():
        raise collinear_error(na, nb, nk, identifiable_orders(r[:, :-1], na, nb))
    solved = _from_triangle(r)
    note = (
        f"regressors nearly collinear or residuals small (condition number {solved.condition:.1e}, residual "
        f"{np.sqrt(solved.rss) / np.linalg.norm(r[:, -1]):.1e} of the output): solved by QR, which is more accurate."
    )
    return replace(solved, notes=() if solver == "qr" else (note,))


def _from_gram(g: Array) -> _Solved | None:
    """Solution from a Gram matrix, y last; None where it is not positive definite to rounding."""
    length = np.sqrt(np.diag(g))
    if not length.all():
        return None
    try:
        lower = np.linalg.cholesky(g / np.outer(length, length))
    except np.linalg.LinAlgError:
        return None
    return _from_triangle(lower.T * length)


def _from_triangle(r: Array) -> _Solved:
    """Solution from the triangle of [phi y]; the condition number is that of columns scaled to length 1."""
    length = np.sqrt((r * r).sum(axis=0))
    scaled = r / length
    inverse = np.linalg.solve(scaled[:-1, :-1], np.eye(len(r) - 1))
    theta = inverse @ scaled[:-1, -1]
    condition = float(np.sqrt((inverse * inverse).sum() * len(inverse)))
    left = float(scaled[-1, -1]) ** 2
    # of theta, and of rss, a small difference of large products
    error = EPS * max(condition**2, float(1 + theta @ theta) / max(left, EPS**2))
    over = length[:-1]
    return _Solved(theta * length[-1] / over, inverse / over[:, None], left * length[-1] ** 2, condition, error)


def _unstable(a: Array) -> tuple[str, ...]:
    if is_stable(a):
        return ()
    radius = np.abs(np.roots(a)).max()
    return (
        f"unstable: a pole at radius {radius:.4g}, so the simulation grows without bound despite the one-step fit. "
        "Try nk = 0 or lower orders, or output error.",
    )
