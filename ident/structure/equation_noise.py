"""Candidates with equation noise, a y = b u + e, by least squares on all orders; with a pole at 1 where one is slow.

An integrating plant is fitted to the change of its output, y(t) - y(t - 1): the same errors, and a pole at exactly 1.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Array
from ...datasets.records.record import Record
from ..estimators.filters import EDGE, is_stable, squares
from ..estimators.least_squares import arx
from ..estimators.order_losses import losses, losses_of_triangle
from ..estimators.plant_and_noise import noise_of, whitened_run
from ..estimators.regressors import Lags, arx_regressors, gram, triangle
from ..model import Model
from .candidates import CANCELLED, EXACT, ONE, SLOW, Candidate, Screen, with_criterion

EQUATIONS = 6  # candidates with equation noise, and as many with a pole at 1


def equation_candidates(screen: Screen, most_order: int, delays: Sequence[int]) -> list[Candidate]:
    """The best orders by least squares; also those with a pole at exactly 1 where one of them is slow."""
    rec = partialled(screen.rec, screen.additional)
    longest = max(s.stop - s.start for s in rec.stretches)
    found, slow = [], False
    for na, nb, nk in _best_orders(rec, range(1, most_order + 1), delays):
        theta, variance = _least_squares(rec, na, nb, nk)
        a = np.concatenate([ONE, theta[:na]])
        slow = slow or bool((np.abs(np.roots(a) - 1) < SLOW / longest).any())
        if is_stable(a, EDGE):
            found.append(_candidate(screen, (na, nb, nk), theta, variance, False))
    return found + _integrating_candidates(screen, rec, most_order, delays) if slow else found


def _integrating_candidates(screen: Screen, rec: Record, most_order: int, delays: Sequence[int]) -> list[Candidate]:
    """The best orders with a pole at exactly 1, by least squares of the differences."""
    found = []
    change = differenced(rec)
    for na, nb, nk in _best_orders(change, range(most_order), delays):
        theta, variance = _least_squares(change, na, nb, nk)
        a, b = np.concatenate([ONE, theta[:na]]), theta[na:]
        if is_stable(a, EDGE) and abs(b.sum()) > CANCELLED * np.abs(b).sum():
            theta = np.concatenate([np.convolve(a, np.array([1.0, -1.0]))[1:], b])
            found.append(_candidate(screen, (na + 1, nb, nk), theta, variance, True))
    return found


def partialled(rec: Record, additional: Array | None) -> Record:
    """The record with input and output orthogonal to the additional regressors.

    Least squares on lags of such signals equals least squares with the signals among the regressors, because lags of
    sines and polynomials are combinations of them (Frisch & Waugh 1933).
    """
    if additional is None or not additional.shape[1]:
        return rec
    level = np.zeros((len(rec), len(rec.stretches)))
    for k, s in enumerate(rec.stretches):
        level[s, k] = 1.0
    both = np.hstack([level, additional])
    signals = np.column_stack([rec.u, rec.y])
    left = signals - both @ np.linalg.lstsq(both, signals, rcond=None)[0]
    return replace(rec, u=left[:, 0], y=left[:, 1])


def _best_orders(rec: Record, na: range, delays: Sequence[int]) -> list[tuple[int, int, int]]:
    """Orders na, nb, nk with the smallest criterion of one-step errors."""
    most = na[-1] + 2
    lags = Lags(na[-1], 0, max(delays) + most - 1)
    if max(s.stop - s.start for s in rec.stretches) <= 3 * lags.span:
        return []
    total = gram(rec, lags)
    rss = losses(total, na, most, delays)
    if rss is None:  # the innovations are rounding of the products
        rss = losses_of_triangle(triangle(rec, lags), na, most, delays)
    n = len(rec)
    p = np.arange(1, most + 1) + np.array(na)[:, None]
    bic = n * np.log(np.maximum(rss / total.rows, EXACT * float(np.var(rec.y)))) + p * np.log(n)
    best = np.unravel_index(np.argsort(bic, axis=None)[:EQUATIONS], bic.shape)
    return [(na[i], int(j) + 1, delays[k]) for k, i, j in zip(*best, strict=True)]


def _least_squares(rec: Record, na: int, nb: int, nk: int) -> tuple[Array, float]:
    """Coefficients of one order by least squares with a constant, and the variance of the errors."""
    Phi, y, _ = arx_regressors(rec, na, nb, nk)
    theta = np.asarray(np.linalg.lstsq(np.column_stack([np.ones(len(y)), Phi]), y, rcond=None)[0][1:], dtype=np.float64)
    return theta, float(np.var(y - Phi @ theta))


def _candidate(
    screen: Screen, orders: tuple[int, int, int], theta: Array, variance: float, integrating: bool
) -> Candidate:
    """The candidate of coefficients by least squares."""
    na, nb, nk = orders
    variance = max(variance, EXACT * float(np.var(screen.rec.y)))
    plain = replace(whitened_run(screen.rec, (na, nb, nk, 0)), additional=screen.additional)
    e = np.concatenate(noise_of(plain, theta))
    return with_criterion(screen, Candidate(
        "arx", na, nb, nk, theta, ONE, squares(e) / len(e), variance, 0.0, parameters=na + nb - integrating,
        integrating=integrating,
    ))  # fmt: skip


def differenced(rec: Record) -> Record:
    """The record with the change of the output since the sample before; each segment loses its first sample."""
    kept = [s for s in rec.stretches if s.stop - s.start > 2]
    y = np.concatenate([np.diff(rec.y[s]) for s in kept])
    u = np.concatenate([rec.u[s.start + 1 : s.stop] for s in kept])
    starts = np.cumsum([0, *(s.stop - s.start - 1 for s in kept)])[:-1]
    return replace(rec, u=u, y=y, starts=tuple(int(k) for k in starts), offsets=None, sha256=None)


def equation_estimate(rec: Record, one: Candidate, additional: Array | None) -> Model:
    """ARX model of a candidate; an integrating one from the change of the output."""
    clean = partialled(rec, additional)
    if not one.integrating:
        return arx(clean, one.na, one.nb, one.nk)
    change = differenced(clean)
    inner = arx(change.centred(), one.na - 1, one.nb, one.nk)
    u0, y0 = np.average(np.asarray(rec.offsets), axis=0, weights=[s.stop - s.start for s in rec.stretches])
    rest = float(u0 + change.u.mean() - change.y.mean() / inner.dc_gain)
    return replace(inner.with_integrator(), operating_point=(rest, float(y0)), record=rec.sha256)
