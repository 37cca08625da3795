"""Estimation of a continuous form by Levenberg-Marquardt on the whitened simulation error.

Initial state and offset of each stretch are projected out of the error and of its sensitivities; of an integrating form
a ramp is estimated with the parameters: the input at which the plant rests is not known.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...datasets.records.record import Record
from ..estimators.filters import filtered, lagged, solved_step, squares
from .sampled_forms import Form, Sampled, sample

STEPS = 25  # of Levenberg-Marquardt
ENOUGH = 0.01  # standard errors: a smaller step ends the iteration
FASTEST = 0.05  # samples, of a lag
INDEPENDENT = 1e-3  # the same of columns whose products are factored: below, rounding matters
DEPENDENT = 1e-10  # of a column orthogonal to those before it: below, it depends on them
LATER = 3.0  # samples by which the delay changes in a step; or half the time constant
EXACT = 1e11  # of T^order in samples: above, coefficients in double precision do not hold the gain at rest
SLOWEST = 50.0  # largest time constant, in lengths of the longest stretch


@dataclass(frozen=True, slots=True)
class FormData:
    """Input less its first value by stretch (N,), its running sum, the output, and the first sample compared."""

    u: Array
    total: Array
    drift: Array  # first value of the stretch less the mean input, times the samples since its start
    ramp: Array  # samples since the start of the stretch
    y: Array
    stretches: tuple[slice, ...]
    skipped: tuple[int, ...]  # samples at the start of each stretch that are not compared
    additional: Array  # further columns of the output, shape (N, k): lines, drift

    def input(self, form: Form) -> Array:
        """Input of the form, of an integrating form its running sum."""
        return self.total if form.integrating else self.u

    def packed(self, x: Array) -> Array:
        """The compared samples of x (N,) or (N, k)."""
        if not any(self.skipped):
            return x
        return np.concatenate([x[s.start + k : s.stop] for s, k in zip(self.stretches, self.skipped, strict=True)])

    def whitened(self, x: Array, h: Array) -> Array:
        """The compared samples of x (N, k) filtered by h."""
        x = self.packed(x)
        return filtered(h, [1.0], x, self.compared) if len(h) > 1 else x

    @property
    def compared(self) -> tuple[slice, ...]:
        """Stretches of the packed samples."""
        length = [s.stop - s.start - k for s, k in zip(self.stretches, self.skipped, strict=True)]
        ends = np.cumsum(length).tolist()
        return tuple(slice(end - n, end) for end, n in zip(ends, length, strict=True))

    @property
    def longest(self) -> int:
        """Samples of the longest stretch."""
        return int(max(s.stop - s.start for s in self.stretches))


@dataclass(frozen=True, slots=True)
class FormFit:
    """Estimate of a form: parameters (of an integrating form, last the slope), whitened error, sensitivities."""

    form: Form
    p: Array
    h: Array
    e: Array
    J: Array
    plain: Array  # not whitened, shape (N,)
    offsets: Array  # of the output of each stretch

    @property
    def loss(self) -> float:
        """Sum of squares of the whitened error."""
        return squares(self.e)

    @property
    def cov(self) -> Array:
        """Covariance of p."""
        n, k = self.J.shape
        products = self.J.T @ self.J
        scale = np.sqrt(np.maximum(np.diag(products), np.finfo(float).tiny))
        inverse = np.linalg.pinv(products / np.outer(scale, scale), rcond=1e-13, hermitian=True)
        return np.asarray(self.loss / max(n - k, 1) * inverse / np.outer(scale, scale))


def form_data(rec: Record, additional: Array | None = None) -> FormData:
    """Record as the fits use it, with further columns (N, k) that are added to the simulated output."""
    length = [s.stop - s.start for s in rec.stretches]
    first = np.repeat([rec.u[s.start] for s in rec.stretches], length)
    u, ramp = rec.u - first, np.concatenate([np.arange(n, dtype=np.float64) for n in length])
    total = np.concatenate([np.cumsum(u[s]) for s in rec.stretches])
    drift = (first - rec.u.mean()) * ramp
    return FormData(
        u,
        total,
        drift,
        ramp,
        rec.y,
        rec.stretches,
        (0,) * len(length),
        np.zeros((len(rec), 0)) if additional is None else additional,
    )


@dataclass(frozen=True, slots=True)
class Residual:
    """Measured less simulated output of a form, and what its sensitivities are made of.

    Attributes
    ----------
    e : ndarray, shape (n,)
        Whitened, initial state and offset projected out.
    level : ndarray, shape (n, m)
        Whitened orthonormal columns of initial state and offset.
    plain : ndarray, shape (N,)
        Not whitened, with the estimated initial state and offset.
    x : ndarray, shape (N,)
        Response to the input and to the initial state.
    offsets : ndarray, shape (stretches,)
        Estimated offset of the output of each stretch.
    model : Sampled
    lags : ndarray, shape (N, nb)
        Lagged input filtered by 1 / a.
    """

    e: Array
    level: Array
    plain: Array
    x: Array
    offsets: Array
    model: Sampled
    lags: Array


def residual_of(data: FormData, form: Form, p: Array, h: Array) -> Residual:
    """Residual of a form with parameters p and the autoregression h of the noise."""
    model = sample(form, p[: form.size])
    u, late, den = data.input(form), model.whole + 1, np.append(1.0, model.a)
    uf = filtered([1.0], den, u, data.stretches) if form.order else u
    U = lagged(uf, range(late, late + len(model.b)), data.stretches)
    x = U @ model.b
    e = data.y - x
    if form.integrating:
        e -= p[0] * data.drift + p[-1] * data.ramp
    free = free_columns(data, den)
    white = data.whitened(np.column_stack([e, free]), h)
    Q, weights = _orthonormal(white[:, 1:], white[:, 0])
    own = np.arange(len(data.stretches)) * (form.order + 1)  # column of the offset of each stretch
    moving = free[:, : len(own) * (form.order + 1)] * weights[: len(own) * (form.order + 1)]
    moving[:, own] = 0.0
    return Residual(
        white[:, 0] - Q @ (Q.T @ white[:, 0]), Q, e - free @ weights, x + moving.sum(axis=1), weights[own], model, U
    )


def _orthonormal(columns: Array, e: Array) -> tuple[Array, Array]:
    """Orthonormal columns (n, m) of the same span, and the weights (f,) of the columns that fit e best.

    By Cholesky of the products, which for long columns takes a tenth of the time of QR; by QR where they are nearly
    dependent.
    """
    scale = np.linalg.norm(columns, axis=0)
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        return _orthonormal_qr(columns, e)
    products = columns.T @ columns / (scale[:, None] * scale)
    try:
        L = np.linalg.cholesky(products)
    except np.linalg.LinAlgError:
        return _orthonormal_qr(columns, e)
    if np.diag(L).min() < INDEPENDENT:
        return _orthonormal_qr(columns, e)
    inverse = np.linalg.inv(L).T / scale[:, None]
    Q = columns @ inverse
    return Q, inverse @ (Q.T @ e)


def _orthonormal_qr(columns: Array, e: Array) -> tuple[Array, Array]:
    """The same by QR; dependent columns have the weight zero."""
    if not np.isfinite(columns).all():
        return np.full((len(columns), 1), np.nan), np.full(columns.shape[1], np.nan)
    Q, R = np.linalg.qr(columns)
    kept = np.abs(np.diag(R)) > DEPENDENT * np.linalg.norm(columns, axis=0)
    weights = np.zeros(columns.shape[1])
    weights[kept] = np.linalg.solve(R[np.ix_(kept, kept)], Q[:, kept].T @ e)
    return np.asarray(Q[:, kept]), weights


def sensitivities_of(data: FormData, form: Form, at: Residual, h: Array) -> Array:
    """Whitened derivatives of the simulated output (n, k), initial state and offset projected out."""
    model, na = at.model, form.order
    J = at.lags @ model.db.T
    if na:
        xf = filtered([1.0], np.append(1.0, model.a), at.x, data.stretches)
        J -= lagged(xf, range(1, na + 1), data.stretches) @ model.da.T
    if form.integrating:
        J[:, 0] += data.drift
        J = np.column_stack([J, data.ramp])
    J = data.whitened(J, h)
    return np.asarray(J - at.level @ (at.level.T @ J))


def free_columns(data: FormData, den: Array) -> Array:
    """Offset and free response of each stretch, then the columns additional, shape (N, stretches (1 + order) + k)."""
    n, na = len(data.y), len(den) - 1
    out = np.zeros((n, len(data.stretches) * (na + 1)), order="F")
    pulse = np.zeros(data.longest)
    pulse[0] = 1.0
    response = filtered([1.0], den, pulse, (slice(0, len(pulse)),))
    for i, s in enumerate(data.stretches):
        own = out[s, i * (na + 1) :]
        own[:, 0] = 1.0
        for j in range(na):
            own[j:, 1 + j] = response[: s.stop - s.start - j]
    return np.column_stack([out, data.additional]) if data.additional.shape[1] else out


def improved(data: FormData, form: Form, p: Array, h: Array, enough: float = ENOUGH) -> FormFit | None:
    """Levenberg-Marquardt from p until a step is below ``enough`` standard errors; None without finite errors."""
    at = residual_of(data, form, p, h)
    if not math.isfinite(squares(at.e)):
        return None
    J, loss = sensitivities_of(data, form, at, h), squares(at.e)
    low, high, most = _bounds(data, form)
    damping = 1e-3
    for _ in range(STEPS):
        step = _step(J, at.e, p, damping, (low, high))
        if form.delayed and "T" in form.parameters:
            most[form.size - 1] = max(LATER, 0.5 * math.exp(p[1]))
        step /= max(1.0, float(np.max(np.abs(step) / most)))
        trial = np.clip(p + step, low, high)
        moved = J @ (trial - p)
        new = residual_of(data, form, trial, h)
        small = moved @ moved / (loss / len(at.e))
        if squares(new.e) <= loss:
            p, at, loss, damping = trial, new, squares(new.e), max(damping / 10, 1e-9)
            J = sensitivities_of(data, form, at, h)
            if small <= enough**2:
                break
        else:
            damping *= 10
            if small <= ENOUGH**2 or damping > 1e6:
                break
    return FormFit(form, p, h, at.e, J, at.plain, at.offsets)


def _step(J: Array, e: Array, p: Array, damping: float, bounds: tuple[Array, Array]) -> Array:
    """Damped Gauss-Newton step (k,); parameters at a bound that would leave it stay."""
    A, g = J.T @ J, J.T @ e
    moving = ~((p <= bounds[0]) & (g < 0) | (p >= bounds[1]) & (g > 0))
    A, g = A[moving][:, moving], g[moving]
    scale = np.sqrt(np.maximum(A.diagonal(), 1e-300))
    A /= scale[:, None] * scale
    A.flat[:: len(g) + 1] += damping
    step = np.zeros(len(p))
    if len(g):
        step[moving] = solved_step(A, g / scale) / scale
    return step


def _bounds(data: FormData, form: Form) -> tuple[Array, Array, Array]:
    """Lower and upper bounds of the parameters, and their largest steps."""
    longest, fastest = data.longest, FASTEST if form.order < 2 else 1 / math.pi  # half the sample rate
    by = {
        "K": (-np.inf, np.inf, np.inf),
        "T": (math.log(fastest), math.log(min(SLOWEST * longest, EXACT ** (1 / max(form.order, 1)))), 1.0),
        "zeta": (math.log(1e-3), math.log(30.0), 1.0),
        "Tz": (-SLOWEST * longest, SLOWEST * longest, np.inf),
        "L": (0.0, longest / 2, LATER),
    }
    names = [*form.parameters, *["L"] * form.delayed]
    low, high, most = (list(x) for x in zip(*(by[name] for name in names), strict=True))
    unbounded = [np.inf] * form.integrating  # the slope
    return np.array([*low, *(-x for x in unbounded)]), np.array([*high, *unbounded]), np.array([*most, *unbounded])


def at_limit(fit: FormFit, data: FormData) -> bool:
    """Whether a time constant or damping ratio lies at its bound: another form, or a static gain, does as well."""
    low, high, _ = _bounds(data, fit.form)
    inner = [i for i, name in enumerate(fit.form.parameters) if name != "K"]
    return bool(np.any(fit.p[inner] <= low[inner]) or np.any(fit.p[inner] >= high[inner]))
