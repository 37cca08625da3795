"""Nonlinear least squares of a law on the scale of its errors, on a condensed Jacobian.

A step of least squares needs J'J, J'r and r'r alone. The triangle of a QR of ``[J r]`` holds all three in
p + 1 rows, so that the singular values of a trust region are cheap whatever the number of rows; computed block
by block it also needs no memory of the size of J.

Source: Demmel, Grigori, Hoemmen & Langou 2012, SIAM J. Sci. Comput. 34, A206 (tall-skinny QR).
"""

from dataclasses import dataclass, field

import numpy as np

from ..core.arrays import Array
from ..core.errors import FitError
from .laws import Error, LawForm
from .least_squares import linear

# Tolerances of the solver: near machine precision, since certified sets ask for 8 to 11 digits.
TIGHT = 1e-15
BLOCK = 8192  # rows at a time: the block and its triangle stay in the processor's cache


@dataclass(slots=True)
class Condensed:
    """Residuals and Jacobian of a law, both in units of ``size``, for ``scipy.optimize.least_squares``.

    Attributes
    ----------
    law : LawForm
    Z : ndarray, shape (n, p)
        Columns of the linear form.
    y : ndarray, shape (n,)
        Response on the scale of the errors.
    size : float
        What residuals and Jacobian are divided by.
    error : {"additive", "multiplicative"}

    Examples
    --------
    >>> Z, y = np.column_stack([np.ones(4), np.arange(4.0)]), np.array([1.0, 2.0, 4.0, 9.0])
    >>> line = Condensed(LawForm("power", "R", ("x",)), Z, y, 1.0)
    >>> theta = np.array([0.0, 0.7])
    >>> J, r = line.jacobian(theta), line.residuals(theta)
    >>> J.shape, bool(np.isclose(r @ r, np.sum((np.exp(Z @ theta) - y) ** 2)))
    ((3, 2), True)
    """

    law: LawForm
    Z: Array
    y: Array
    size: float
    error: Error = "additive"
    _at: Array | None = field(default=None, init=False)
    _triangle: Array = field(default_factory=lambda: np.empty((0, 0)), init=False)

    def residuals(self, theta: Array) -> Array:
        """Rotated residuals, shape (p + 1,): their length is that of the n residuals."""
        return self._of(theta)[:, -1]

    def jacobian(self, theta: Array) -> Array:
        """Jacobian in the same rotation, shape (p + 1, p)."""
        return self._of(theta)[:, :-1]

    def _of(self, theta: Array) -> Array:
        """Triangle of ``[J r]``; both must come of one rotation, so the last one is kept."""
        if self._at is None or not np.array_equal(theta, self._at):
            blocks = [self._block(theta, slice(i, i + BLOCK)) for i in range(0, len(self.y), BLOCK)]
            self._triangle = blocks[0] if len(blocks) == 1 else _triangle(np.vstack(blocks))
            self._at = theta.copy()
        return self._triangle

    def _block(self, theta: Array, rows: slice) -> Array:
        Z = self.Z[rows]
        with np.errstate(over="ignore", invalid="ignore"):  # a trial step that the solver rejects
            value, G = self.law.scaled(theta, Z, self.error)
            return _triangle(np.column_stack([G, value - self.y[rows]]) / self.size)


def _triangle(A: Array) -> Array:
    if not np.isfinite(A).all():  # the solver rejects a step at infinity
        return np.full((min(A.shape), A.shape[1]), np.inf)
    return np.asarray(np.linalg.qr(A, mode="r"))


def _centre(law: LawForm, Z: Array) -> Array:
    """Means of the columns that stand within the product, zero of the others."""
    centre = np.zeros(Z.shape[1])
    centre[1:] = Z[:, 1:].mean(axis=0)
    if not law.linearisable:
        centre[len(law.factors)] = 0.0  # it is added to the product, not within it
    return centre


def minimise(law: LawForm, Z: Array, y: Array, start: Array, error: Error = "additive") -> tuple[Array, Array | None]:
    """Parameters (p,) of least squares on the scale of the errors, and their covariance (p, p), None without df.

    Trust region with the analytic gradient, then one exact step. Centring the columns of Z makes the constant nearly
    independent of the exponents, which speeds up the solver.
    """
    from scipy.optimize import least_squares

    centre = _centre(law, Z)
    logs = error == "multiplicative"
    C = Z - centre
    back = np.eye(Z.shape[1])
    back[0, 1:] = -centre[1:]
    condensed = Condensed(law, C, np.log(y) if logs else y, 1.0 if logs else float(np.max(np.abs(y))), error)
    begin: Array = np.asarray(np.linalg.solve(back, start), dtype=np.float64)
    if not np.isfinite(condensed.residuals(begin)).all():
        raise FitError(
            f"{law.response}: the log-linear start overflows on the original scale. Fit with error='multiplicative', "
            "or correct values of extreme magnitude."
        )
    found = least_squares(
        condensed.residuals, begin, jac=condensed.jacobian, method="trf", x_scale="jac",
        ftol=TIGHT, xtol=TIGHT, gtol=TIGHT,
    )  # fmt: skip
    if not np.isfinite(found.x).all() or found.status == 0:
        other = "another form" if logs else "with error='multiplicative'"
        raise FitError(
            f"{law.response}: least squares with {error} errors did not converge from the log-linear start. "
            f"Fit {other}."
        )
    step = linear(condensed.jacobian(found.x), -condensed.residuals(found.x))
    theta = back @ (found.x + step.params)
    r = condensed.y - law.scaled(theta, Z, error)[0]
    df = len(y) - len(theta)
    scaled = r / condensed.size  # before squaring: 1e300 has no square
    variance = float(scaled @ scaled) / max(df, 1)  # the step is fitted in units of size
    return theta, variance * back @ step.cov_unscaled @ back.T if df else None
