"""Candidate structures of a record: orders and delays of b/a, each fitted with a noise model of its own.

Delays and orders are screened on the simulated output of a high-order ARX model, which holds little of the noise, by
the iteration of Steiglitz & McBride; the structures that remain are fitted to the measured output by
Levenberg-Marquardt, both signals filtered by an autoregressive noise model.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.filters import burg, filtered, lagged, squares
from ..estimators.plant_and_noise import (
    WhitenedRun,
    noise_of,
    prewhitened,
    whitened_minimum,
    whitened_run,
)
from ..estimators.starting_values import high_order_arx, steiglitz_mcbride
from ..model import Model
from .choice import criterion, guard
from .continuous_forms import fit_forms
from .fitted_form import FittedForm

ONE = np.ones(1)
FIRST_STEPS, STEPS = 5, 2  # of the iteration: at the first delay of an order, and at each further one
REFINED = 3e-5  # predicted reduction of the loss, as a share, at which a candidate has converged: .02 of the criterion
MOST_STEPS, REFINED_STEPS = 7, 12  # of Levenberg-Marquardt for a candidate, and for one of the best
EXACT = 1e-18  # of the variance: a loss below it is rounding
NO_DELAY = (
    20.0  # of the criterion, for nk = 0: behind a zero-order hold a plant responds one sample later at the earliest
)
SLOW = 10.0  # a pole with a time constant above a tenth of the longest segment is slow
SLOW_TRIED = 12  # candidates of which those with a slow pole are tried with an integrator
CANCELLED = 1e-6  # share of |b| below which b(1) cancels the integrator
HOPELESS = 100.0  # of the criterion above the best: the penalty makes no difference
MEMORY = (0, 1, 2, 4, 7, 11, 16, 22, 30, 40, 55)  # lags of u with which drift and lines are estimated first


@dataclass(frozen=True, slots=True)
class Candidate:
    """A fitted structure.

    Attributes
    ----------
    structure : str
        ``box_jenkins``, or ``arx`` with noise through the poles of the plant.
    na, nb, nk : int
    theta : ndarray, shape (na + nb,)
        a_1 ..., b_nk ...
    d : ndarray
        Noise polynomial, 1 for arx.
    loss : float
        Mean square simulation error.
    variance : float
        Of the innovations.
    criterion, guard : float
        Schwarz's criterion, and the penalty of structure that the record cannot support.
    weight : float
        Share in the mixture of structures.
    parameters : int
        Of the plant, counted by the criterion.
    form : FittedForm or None
        The continuous form that the coefficients are computed from.
    integrating : bool
        Whether a pole lies at exactly 1.
    """

    structure: str
    na: int
    nb: int
    nk: int
    theta: Array
    d: Array
    loss: float
    variance: float
    criterion: float
    guard: float = 0.0
    weight: float = 0.0
    parameters: int = 0
    form: FittedForm | None = None
    integrating: bool = False

    @property
    def name(self) -> tuple[str, int, int, int, bool]:
        """Form or structure, orders, and whether a pole lies at 1: no two candidates of a search have the same."""
        return self.form.name if self.form else self.structure, self.na, self.nb, self.nk, self.integrating

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of a, in z."""
        return np.asarray(np.roots(self.a), dtype=np.complex128)

    @property
    def slowest(self) -> float:
        """Largest modulus of a pole; 0 without poles."""
        return float(np.abs(self.poles).max(initial=0.0))

    @property
    def total(self) -> float:
        """Criterion and penalty: the smallest is chosen."""
        return self.criterion + self.guard

    @property
    def a(self) -> Array:
        """Denominator, starting with 1."""
        return np.concatenate([ONE, self.theta[: self.na]])

    @property
    def b(self) -> Array:
        """Numerator with its nk leading zeros."""
        return np.concatenate([np.zeros(self.nk), self.theta[self.na :]])


@dataclass(frozen=True, slots=True)
class Screen:
    """Data on which candidates are compared.

    Attributes
    ----------
    rec : Record
        Centred.
    band : tuple of float
        Excited band, Hz.
    d : ndarray
        Noise polynomial of the residual of the high-order model.
    u, x, y : ndarray, shape (N,)
        Input, simulated output of the high-order model, and output, filtered by ``d``.
    additional : ndarray, shape (N, k), or None
        Additional regressors of the output.
    """

    rec: Record
    band: tuple[float, float]
    d: Array
    u: Array
    x: Array
    y: Array
    additional: Array | None = None

    def skipped(self, na: int, nb: int, nk: int) -> int:
        """Samples at the start of each segment that are left out."""
        return max(nb + nk - 1 - na, 0) + len(self.d) - 1


def screen_of(
    rec: Record, band: tuple[float, float], first: int, delay: int, additional: Array | None = None
) -> Screen:
    """The record with the simulated output of its high-order model, both whitened."""
    high = high_order_arx(rec.u, rec.y, rec.stretches, first, delay=delay, additional=additional)
    y = rec.y if additional is None else without_additional(rec, additional)
    x = high.x if high.stable and squares(y - high.x) < squares(y) else y
    parts = [y[s] - x[s] for s in rec.stretches if s.stop - s.start > 2 * len(high.a)]
    left = [v - v.mean() for v in parts]
    d = burg(left)[0] if left and squares(np.concatenate(left)) > EXACT * squares(rec.y) else ONE
    u, x, y = (filtered(d, [1.0], v, rec.stretches) for v in (rec.u, x, y))
    return Screen(rec, band, d, u, x, y, additional)


def without_additional(rec: Record, additional: Array) -> Array:
    """Output (N,) less the additional regressors, whose coefficients are estimated simultaneously with lags of u."""
    longest = max(s.stop - s.start for s in rec.stretches)
    past = lagged(rec.u, [lag for lag in MEMORY if lag < longest // 6], rec.stretches)
    level = [
        np.where((np.arange(len(rec)) >= s.start) & (np.arange(len(rec)) < s.stop), 1.0, 0.0) for s in rec.stretches
    ]
    columns = np.column_stack([*level, past, additional])
    theta = np.linalg.lstsq(columns, rec.y, rcond=1e-9)[0]
    return np.asarray(rec.y - additional @ theta[-additional.shape[1] :], dtype=np.float64)


def scanned(screen: Screen, na: int, nb: int, delays: Iterable[int], f: Array = ONE) -> dict[int, tuple[float, Array]]:
    """Mean square error and theta of the iteration at each delay, each started from the one before."""
    found: dict[int, tuple[float, Array]] = {}
    steps = FIRST_STEPS if len(f) == 1 else STEPS
    for nk in delays:
        theta, square = equation(screen, (na, nb, nk), f, steps)
        if np.isfinite(square):
            found[nk] = (square, theta)
            f, steps = np.concatenate([ONE, theta[:na]]), STEPS
    return found


def equation(screen: Screen, orders: tuple[int, int, int], f: Array, steps: int) -> tuple[Array, float]:
    """Steps of the iteration on the output of the high-order model."""
    return steiglitz_mcbride(screen.u, screen.x, screen.rec.stretches, orders, screen.skipped(*orders), f, steps)


def fitted(screen: Screen, orders: tuple[int, int, int], theta: Array, lowest: float = math.inf) -> Candidate | None:
    """The candidate from a starting value, by Levenberg-Marquardt; None if the record is too short for it.

    ``lowest`` is the criterion of the best candidate so far.
    """
    plain = replace(whitened_run(screen.rec, (*orders, 0)), additional=screen.additional)
    if not plain.stretches:
        return None
    run = prewhitened(plain, screen.d)
    end = whitened_minimum(run, theta, MOST_STEPS, REFINED)
    return judged(screen, plain, end.theta, lowest)


def judged(screen: Screen, plain: WhitenedRun, theta: Array, lowest: float = math.inf) -> Candidate:
    """A theta of an output-error run with its own noise model and criterion."""
    v = noise_of(plain, theta)
    rows = sum(len(part) for part in v)
    free = rows / max(rows - plain.hidden, 1)
    loss = free * sum(squares(part) for part in v) / rows
    floor = EXACT * float(np.var(screen.rec.y))
    d, variance = burg(v) if loss > floor else (ONE, floor)
    variance = max(free * variance, floor)
    one = Candidate("box_jenkins", plain.nf, plain.nb, plain.nk, theta, d, loss, variance, 0.0)
    return with_criterion(screen, one, lowest)


def with_criterion(screen: Screen, one: Candidate, lowest: float = math.inf) -> Candidate:
    """The candidate with its criterion and the penalty of structure beyond the band, unless it is far from the best."""
    n, rec, p = len(screen.rec), screen.rec, one.parameters or one.na + one.nb
    noise = 0 if one.structure == "arx" else len(one.d) - 1
    own, penalty = criterion(n, one.variance, p, noise), NO_DELAY * (one.nk == 0)
    if own < lowest + HOPELESS:
        penalty += guard(one.b, one.a, rec.sample_time, screen.band, n)
    return replace(one, parameters=p, criterion=own, guard=penalty)


def refined(screen: Screen, one: Candidate) -> Candidate:
    """The candidate with plant and noise model fitted jointly."""
    nd = len(one.d) - 1
    if one.structure != "box_jenkins" or one.form is not None or one.integrating:
        return one
    run = replace(whitened_run(screen.rec, (one.na, one.nb, one.nk, nd)), additional=screen.additional)
    if not run.stretches:
        return one
    end = whitened_minimum(run, np.concatenate([one.theta, one.d[1:]]), REFINED_STEPS, REFINED)
    if not nd and not end.steps:
        return one
    return judged(screen, replace(run, nd=0), end.theta[: one.na + one.nb])


def form_candidates(screen: Screen, delays: Sequence[int] | None) -> list[Candidate]:
    """Continuous forms with few parameters, judged as the other candidates."""
    return [
        _of_form(screen, form)
        for form in fit_forms(screen.rec, delays, additional=screen.additional)
        if usable(form.model)
    ]


def usable(model: Model) -> bool:
    """Whether the model is stable but for a pole at exactly 1."""
    return model.stable or model.integrating


def _of_form(screen: Screen, form: FittedForm) -> Candidate:
    model, stretches = form.model, screen.rec.stretches
    v = [np.trim_zeros(form.e[s], "f") for s in stretches]
    v = [part for part in v if len(part) > 2]
    rows, hidden = sum(map(len, v)), (model.na + 1) * len(stretches)
    free = rows / max(rows - hidden, 1)
    d, variance = burg(v)
    floor = EXACT * float(np.var(screen.rec.y))
    return with_criterion(screen, Candidate(
        "box_jenkins", model.na, model.nb, model.nk, model.theta, d, free * sum(map(squares, v)) / rows,
        max(free * variance, floor), 0.0, parameters=form.k, form=form,
        integrating=form.integrating,
    ))  # fmt: skip


def both_additional(slope: Array, additional: Array | None) -> Array:
    """A slope and the additional regressors, (N, 1 + k)."""
    return slope if additional is None else np.hstack([slope, additional])


def integrating_candidates(screen: Screen, found: Sequence[Candidate]) -> list[Candidate]:
    """The best candidates with a slow pole, fitted anew with that pole at exactly 1."""
    rec = screen.rec
    longest = max(s.stop - s.start for s in rec.stretches)
    slow = [one for one in found[:SLOW_TRIED] if one.form is None and one.na and 1 - one.slowest < SLOW / longest]
    if not slow:
        return []
    total = np.concatenate([np.cumsum(rec.u[s] - rec.u[s].mean()) for s in rec.stretches])
    total -= total.mean()
    time = np.concatenate([np.linspace(-1.0, 1.0, s.stop - s.start) for s in rec.stretches])[:, None]
    summed = replace(
        screen, rec=replace(rec, u=total), u=filtered(screen.d, [1.0], total, rec.stretches),
        additional=both_additional(time, screen.additional),
    )  # fmt: skip
    out = []
    for one in slow:
        a = np.atleast_1d(np.real(np.poly(np.delete(one.poles, np.argmin(np.abs(one.poles - 1))))))
        start = np.concatenate([a[1:], one.theta[one.na :]])
        inner = fitted(summed, (one.na - 1, one.nb, one.nk), start)
        if inner is not None and abs(inner.b.sum()) > CANCELLED * np.abs(inner.b).sum():
            theta = np.concatenate([np.convolve(inner.a, np.array([1.0, -1.0]))[1:], inner.theta[inner.na :]])
            whole = replace(inner, na=one.na, theta=theta, parameters=one.na - 1 + one.nb, integrating=True)
            out.append(with_criterion(screen, whole))
    return out


def no_model() -> IdentError:
    """Error for a record that no candidate fits."""
    return IdentError(
        "no order gives a stable model of this record: input and output may be swapped, or the plant is not stable. "
        "Record it in closed loop, or remove the trend."
    )
