"""Continuous form fitted to a record: name, parameters in physical units with their covariance, discrete model."""

import math
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...datasets.records.record import Record
from ..estimators.build_model import record_facts
from ..model import Model
from .form_estimation import FormData, FormFit
from .sampled_forms import Form, Sampled, sample

SURE = 2.0  # standard errors above 1: a damping ratio that is written as two time constants
QUANTITIES = {"K": "gain", "T": "time constant", "zeta": "damping ratio", "Tz": "time constant of the zero",
              "L": "delay", "T1": "time constant", "T2": "second time constant"}  # fmt: skip
EQUATIONS = {
    "two lags": "K / ((T1 s + 1)(T2 s + 1))",
    "two lags with zero": "K (Tz s + 1) / ((T1 s + 1)(T2 s + 1))",
}


@dataclass(frozen=True, slots=True)
class FittedForm:
    """Continuous form fitted to a record.

    Attributes
    ----------
    name, equation : str
        ``lag with delay``, ``K / (T s + 1) exp(-L s)``.
    symbols, units : tuple of str
        K in unit_y per unit_u (per second for an integrating form), times in s.
    values : ndarray, shape (k,)
    cov : ndarray, shape (k, k)
        Covariance of ``values``, coloured noise allowed for.
    model : Model
        Zero-order-hold model, its covariance of rank k by linear propagation.
    e : ndarray, shape (N,)
        Measured less simulated output with the estimated initial state and offset; zero where left out.
    noise : ndarray
        Autoregression that whitens ``e``; starts with 1.
    form : Form
    p : ndarray
        Parameters of ``form``, time in samples; of an integrating form, then the slope.
    """

    name: str
    equation: str
    symbols: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    cov: Array
    model: Model
    e: Array
    noise: Array
    form: Form
    p: Array

    @property
    def integrating(self) -> bool:
        """Whether the plant has a pole at s = 0."""
        return self.form.integrating

    @property
    def k(self) -> int:
        """Number of parameters."""
        return len(self.values)

    @property
    def bse(self) -> Array:
        """Standard errors of ``values``."""
        return np.sqrt(np.diag(self.cov))

    @property
    def words(self) -> str:
        """Name, equation, and the parameters with their standard errors, one sentence."""
        parts = [
            f"{QUANTITIES.get(symbol, symbol)} {symbol} = {value:.4g} +- {error:.2g} {unit}".rstrip()
            for symbol, value, error, unit in zip(self.symbols, self.values, self.bse, self.units, strict=True)
        ]
        return f"{self.name[0].upper()}{self.name[1:]}, {self.equation}: {', '.join(parts)}."


def described(rec: Record, data: FormData, fit: FormFit) -> FittedForm:
    """The fit in physical units, with its discrete model and its residual."""
    form, k = fit.form, fit.form.size
    sampled, cov = sample(form, fit.p[:k]), fit.cov[:k, :k]
    residual = fit.plain.copy()
    for s, skipped in zip(data.stretches, data.skipped, strict=True):
        residual[s.start : s.start + skipped] = 0.0
    name, symbols, values, J = _physical(form, fit.p[:k], np.sqrt(np.diag(cov)), rec.sample_time)
    delay = " exp(-L s)" if form.delayed else ""
    equation = EQUATIONS.get(name, form.equation) + delay
    over = f"({rec.unit_u or 'input'} s)" if form.integrating else rec.unit_u or "input"
    gain = f"{rec.unit_y or 'output'}/{over}"
    units = tuple(gain if s == "K" else "" if s == "zeta" else "s" for s in symbols)
    return FittedForm(
        name=name + (" with delay" if form.delayed and " with " not in name else " and delay" if form.delayed else ""),
        equation=equation,
        symbols=symbols,
        units=units,
        values=values,
        cov=J @ cov @ J.T,
        model=_model(rec, data, fit, sampled, cov),
        e=residual,
        noise=fit.h,
        form=form,
        p=fit.p,
    )


def _model(rec: Record, data: FormData, fit: FormFit, sampled: Sampled, cov: Array) -> Model:
    """The zero-order-hold model of a fit; the covariance of its coefficients has the rank of the parameters."""
    a, da = np.r_[1.0, sampled.a], sampled.da
    if fit.form.integrating:
        zero = np.zeros((len(da), 1))
        a, da = np.convolve(a, [1.0, -1.0]), np.hstack([da, zero]) - np.hstack([zero, da])
    by = np.hstack([da, sampled.db])
    nk = sampled.whole + 1
    n, k = fit.J.shape
    variance = fit.loss / max(n - k - len(fit.h) + 1, 1)
    facts = record_facts(rec)
    facts["operating_point"] = _rest(rec, data, fit, facts["operating_point"])
    return Model(
        b=np.r_[np.zeros(nk), sampled.b], a=a, nk=nk, structure="box_jenkins", d=fit.h, cov_params=by.T @ cov @ by,
        noise_variance=variance, **facts,
    )  # fmt: skip


def _rest(rec: Record, data: FormData, fit: FormFit, mean: tuple[float, float]) -> tuple[float, float]:
    """Input and output at rest: of an integrating form the input at which the output does not move."""
    u0, y0 = mean
    if fit.form.integrating:
        return u0 + float(rec.u.mean() - fit.p[-1] / fit.p[0]), y0
    length = [s.stop - s.start for s in data.stretches]
    first = np.array([rec.u[s.start] for s in data.stretches])
    return u0, y0 + float(np.average(fit.offsets - fit.p[0] * first, weights=length))


def _physical(form: Form, p: Array, se: Array, dt: float) -> tuple[str, tuple[str, ...], Array, Array]:
    """Name, symbols, values in seconds, and their derivatives with respect to p."""
    symbols = [*form.parameters, *["L"] * form.delayed]
    values, J = p.copy(), np.eye(len(p))
    for i, symbol in enumerate(symbols):
        if symbol == "K":
            factor = 1 / dt if form.integrating else 1.0
        elif symbol in ("T", "zeta"):
            values[i] = math.exp(p[i])
            factor = values[i] * (dt if symbol == "T" else 1.0)
            values[i] = factor
        else:
            factor = dt
        values[i] = values[i] if symbol in ("T", "zeta") else p[i] * factor
        J[i, i] = factor
    if "zeta" not in symbols or values[2] - 1 <= SURE * se[2] * values[2]:
        return form.name, tuple(symbols), values, J
    T, zeta = values[1], values[2]
    root = math.sqrt(zeta**2 - 1)
    by = np.array([[zeta + root, T * (1 + zeta / root)], [zeta - root, T * (1 - zeta / root)]])
    values[1:3] = T * (zeta + root), T * (zeta - root)
    J[1:3] = by @ J[1:3]
    symbols[1:3] = ["T1", "T2"]
    return form.name.replace("second order", "two lags"), tuple(symbols), values, J
