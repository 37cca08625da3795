"""Box-Jenkins models with autoregressive noise: output error whitened by a noise model that is fitted jointly.

    y = b/f u + 1/d e,      e(t) = d (y - b/f u - x0)

x0 is the response to the initial state of each segment, with a constant for an unknown operating point; both enter
linearly and are projected out of the errors and their sensitivities (variable projection, Kaufman 1975). The first
max(nb + nk - 1 - nf, 0) samples of a segment depend on unknown earlier inputs alone and are left out, with them the
first nd errors; then nf numbers describe the initial state.

The noise model and the plant have no common coefficients, so the estimate of b/f is consistent in open loop whatever
the noise, efficient if the noise is autoregressive, and consistent in closed loop if it is and the loop has a delay.
Sources: Ljung 1999, System Identification, sections 4.2, 10.2 and 13.4; Soderstrom & Stoica 1989, section 7.5.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array
from ...core.threads import one_thread
from ...datasets.records.record import Record
from ..model import Model
from .build_model import record_facts, slow_pole
from .filters import EDGE, ROUNDING, burg, filtered, inverse_of_squares, is_stable, recursive, squares
from .free_responses import FreeSpace, free_space
from .input_checks import check_identifiable, checked_record, not_centred
from .instrumental import Initial
from .prediction_error import Minimum, minimise, search_note
from .starting_values import by_length, high_order_arx, shifted_rows, stacked, steiglitz_mcbride

DAMPING = 1e-8  # of the first step: starting values are near the minimum
ONE = np.ones(1)
START_STEPS = 8  # of the iteration for starting values, of which the best is taken


@dataclass(frozen=True, slots=True)
class WhitenedRun:
    """Data and orders of a Box-Jenkins estimation.

    Attributes
    ----------
    u, y : ndarray, shape (N,)
    stretches : tuple of slice
        Segments with at least one error.
    nf, nb, nk, nd : int
    skipped : int
        Samples at the start of each segment that are left out.
    states, constant : bool
        Whether the initial state and a constant of each segment are estimated.
    additional : ndarray, shape (N, k), or None
        Additional regressors of the output, with coefficients for each segment: lines, drift.
    """

    u: Array
    y: Array
    stretches: tuple[slice, ...]
    nf: int
    nb: int
    nk: int
    nd: int
    skipped: int
    states: bool = True
    constant: bool = True
    additional: Array | None = None

    @property
    def hidden(self) -> int:
        """Number of initial states, constants and coefficients of additional regressors."""
        signals = 0 if self.additional is None else self.additional.shape[1]
        return len(self.stretches) * (self.nf * self.states + self.constant + signals)

    def polynomials(self, theta: Array) -> tuple[Array, Array, Array]:
        """Of theta: f with its leading 1, the coefficients b_nk ..., and d with its leading 1."""
        p = self.nf + self.nb
        return np.concatenate([ONE, theta[: self.nf]]), theta[self.nf : p], np.concatenate([ONE, theta[p:]])


def whitened_run(rec: Record, orders: tuple[int, int, int, int], initial: Initial = "offset") -> WhitenedRun:
    """The record as data of an estimation with orders nf, nb, nk, nd."""
    nf, nb, nk, nd = orders
    states = initial != "zero"
    skipped = max(nb + nk - 1 - nf, 0) if states else 0
    fewest = skipped + nd + nf * states + 2
    kept = tuple(s for s in rec.stretches if s.stop - s.start >= fewest)
    return WhitenedRun(rec.u, rec.y, kept, nf, nb, nk, nd, skipped, states, initial in ("auto", "offset"))


def whitened_errors(run: WhitenedRun, theta: Array) -> tuple[Array, Array]:
    """Errors e (n,) and -de / d theta (n, nf + nb + nd), initial states and constants projected out of both."""
    parts = [group_errors(run, theta, group) for group in groups(run)]
    if len(parts) == 1:
        return parts[0][0], parts[0][1].T
    return np.concatenate([e for e, _ in parts]), np.hstack([J for _, J in parts]).T


def noise_of(run: WhitenedRun, theta: Array) -> list[Array]:
    """Measured less simulated output of each segment, initial state and constant included in the simulation."""
    return [v for group in groups(run) for v in simulated_group(run, theta, group).v]


def constants_of(run: WhitenedRun, theta: Array) -> Array:
    """Constant of each segment, shape (segments,)."""
    found = {s.start: c for g in groups(run) for s, c in zip(g, simulated_group(run, theta, g).level, strict=True)}
    return np.array([found[s.start] for s in run.stretches])


def groups(run: WhitenedRun) -> list[tuple[slice, ...]]:
    """Segments of one length together: they share the responses to initial states, not the additional regressors."""
    return [(s,) for s in run.stretches] if run.additional is not None else by_length(run.stretches, 0)


@dataclass(frozen=True, slots=True)
class SimulatedGroup:
    """Simulation of S segments of one length n.

    Attributes
    ----------
    uf, x : ndarray, shape (S, n)
        Input filtered by 1/f, and simulated output with the initial states.
    v : ndarray, shape (S, n - skipped)
        Measured less simulated output, 1/d e.
    level : ndarray, shape (S,)
        Constant of each segment.
    free : FreeSpace
    """

    uf: Array
    x: Array
    v: Array
    level: Array
    free: FreeSpace


def simulated_group(run: WhitenedRun, theta: Array, group: tuple[slice, ...]) -> SimulatedGroup:
    """Simulation of segments of one length, initial states and constants estimated."""
    (f, b, d), (nf, nb, nd) = run.polynomials(theta), (run.nf, run.nb, run.nd)
    u, y = stacked(run.u, group), stacked(run.y, group)
    n, start = u.shape[1], run.skipped
    uf = recursive([1.0], f, u, axis=-1)
    x = np.zeros(u.shape)
    for k in range(nb):
        x[:, run.nk + k :] += b[k] * uf[:, : n - run.nk - k]
    additional = None if run.additional is None else run.additional[group[0].start + start : group[0].stop]
    free = free_space(f, d, n - start, nf if run.states else 0, run.constant, additional)
    v = y[:, start:] - x[:, start:]
    c, level = free.coefficients(fir(d, v)[:, nd:])
    free.response(c, level, x[:, start:])
    return SimulatedGroup(uf, x, y[:, start:] - x[:, start:], level, free)


def group_errors(run: WhitenedRun, theta: Array, group: tuple[slice, ...]) -> tuple[Array, Array]:
    """Errors (n,) and sensitivities (p, n) of segments of one length."""
    (f, _, d), (nf, nb, nd) = run.polynomials(theta), (run.nf, run.nb, run.nd)
    at, first = simulated_group(run, theta, group), run.skipped + nd
    J = np.empty((nf + nb + nd, len(group), at.x.shape[1] - first))
    shifted_rows(J[:nf], -fir(d, recursive([1.0], f, at.x, axis=-1)), 1, first)
    shifted_rows(J[nf : nf + nb], fir(d, at.uf), run.nk, first)
    shifted_rows(J[nf + nb :], -at.v, 1, nd)
    at.free.project_out(J.reshape(-1, J.shape[2]))
    return fir(d, at.v)[:, nd:].ravel(), J.reshape(len(J), -1)


def fir(d: Array, x: Array) -> Array:
    """Signals x (S, n) filtered by the polynomial d, from rest."""
    if len(d) == 1:
        return x
    if len(x) == 1:
        return np.convolve(x[0], d)[None, : x.shape[1]]
    out = x.copy()
    for k in range(1, len(d)):
        out[:, k:] += d[k] * x[:, :-k]
    return out


@one_thread
def box_jenkins(
    rec: Record | Sequence[Record],
    nb: int,
    nf: int,
    nd: int,
    nk: int = 1,
    *,
    initial: Initial = "offset",
    additional: Array | None = None,
    max_steps: int = 100,
    tol: float = 1e-10,
) -> Model:
    """Transfer function with autoregressive noise, y = b/f u + 1/d e, with the least one-step prediction error.

    Parameters
    ----------
    rec : Record or sequence of Record
        With its operating point removed (``rec.centred()``).
    nb, nf, nd, nk : int
        Number of coefficients of b, order of f (``Model.a``), order of d, samples of delay. ``nd`` 0 is output error.
        In closed loop ``nk`` is 1 or more.
    initial : {"offset", "estimate", "zero"}
        Initial state of each segment: estimated with a constant, estimated, or at rest. ``auto`` is ``offset``.
    additional : ndarray, shape (N, k), optional
        Additional regressors of the output, each with a coefficient of its own in each segment: the sine and cosine of
        a spectral line, the powers of time of a drift.
    max_steps, tol : int, float
        Largest number of trials; converged when the predicted reduction is below ``tol`` of the loss.

    Returns
    -------
    Model
        Stable, with a stable noise model; ``cov_params`` is the covariance of f and b, allowing for the estimation
        of d. ``noise_variance`` is that of the innovations e.

    Raises
    ------
    IdentError
        Invalid orders, or larger than the record allows; too short a record; constant u or y.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> rng = np.random.default_rng(1)
    >>> u, e = rng.standard_normal((2, 2000))
    >>> y = Model(b=[0.0, 0.5], a=[1.0, -0.8], nk=1, sample_time=0.02).simulate(u)
    >>> y += Model(b=[1.0], a=[1.0, -0.9], nk=0, sample_time=0.02).simulate(0.1 * e)
    >>> model = box_jenkins(datasets.Record(u=u, y=y, sample_time=0.02).centred(), nb=1, nf=1, nd=1)
    >>> model.theta.round(2).tolist(), model.d.round(2).tolist()
    ([-0.8, 0.5], [1.0, -0.9])
    """
    rec = checked_record(rec, {"nb": nb, "nf": nf, "nd": nd}, nk)
    run = replace(whitened_run(rec, (nf, nb, nk, nd), initial), additional=additional)
    end = whitened_minimum(run, starting_theta(run), max_steps, tol)
    return box_jenkins_model(rec, run, end)


def starting_theta(run: WhitenedRun) -> Array:
    """Starting values of f, b and d: of several sequences that with the least one-step error.

    The simulation error alone does not serve: in closed loop it is least for the inverse of the controller.
    """
    high = high_order_arx(run.u, run.y, run.stretches, min(run.nk, 1), delay=run.nk)
    plain = replace(run, nd=0)
    white = prewhitened(plain, high.a)
    x_white = filtered(high.a, [1.0], high.x, run.stretches)
    found = []
    for plant, x in ((plain, high.x), (plain, run.y), (white, x_white), (white, white.y)):
        theta = with_noise(run, _iterated(plant, x))
        found.append((squares(whitened_errors(run, theta)[0]), theta))
    return min(found, key=lambda pair: pair[0])[1]


def with_noise(run: WhitenedRun, theta: Array) -> Array:
    """Theta of f and b, followed by the coefficients d of an autoregression of its simulation error."""
    if not run.nd:
        return theta
    d = burg(noise_of(replace(run, nd=0), theta), run.nd)[0][1:]
    return np.concatenate([theta, d, np.zeros(run.nd - len(d))])


def _iterated(run: WhitenedRun, x: Array) -> Array:
    """The best of a few steps of the iteration for starting values on an output x (N,)."""
    f, found = ONE, []
    for _ in range(START_STEPS):
        theta, _ = steiglitz_mcbride(run.u, x, run.stretches, (run.nf, run.nb, run.nk), run.skipped, f)
        f = np.concatenate([ONE, theta[: run.nf]])
        found.append((squares(whitened_errors(run, theta)[0]), theta))
    return min(found, key=lambda pair: pair[0])[1]


def prewhitened(run: WhitenedRun, d: Array) -> WhitenedRun:
    """The run with both signals filtered by d, whose first samples of each segment are left out where it can be."""
    shortest = min(s.stop - s.start for s in run.stretches) - run.nf - run.nb - 2
    skipped = max(run.skipped, min(run.skipped + len(d) - 1, shortest))
    u, y = (filtered(d, [1.0], x, run.stretches) for x in (run.u, run.y))
    return replace(run, u=u, y=y, skipped=skipped)


def whitened_minimum(run: WhitenedRun, theta: Array, max_steps: int, tol: float) -> Minimum:
    """Levenberg-Marquardt on the one-step error, restricted to stable models of plant and noise."""

    def stable(theta: Array) -> bool:
        f, _, d = run.polynomials(theta)
        return is_stable(f, EDGE) and is_stable(d, EDGE)

    return minimise(theta, lambda th: whitened_errors(run, th), stable, squares(run.y), tol, max_steps, DAMPING)


def box_jenkins_model(rec: Record, run: WhitenedRun, end: Minimum) -> Model:
    """The model of a minimum with its covariance."""
    f, b, d = run.polynomials(end.theta)
    p = run.nf + run.nb
    check_identifiable(end.J[:, :p], {"nf": run.nf, "nb": run.nb})
    exact = squares(end.e) <= 1e4 * ROUNDING * squares(run.y)  # the noise model is that of rounding
    variance = squares(end.e) / max(len(end.e) - len(end.theta) - run.hidden, 1)
    used = end.J[:, :p] if exact else end.J
    facts = record_facts(rec)
    notes = (
        search_note(end),
        *rec.notes,
        *not_centred(rec),
        *slow_pole(f, max(s.stop - s.start for s in run.stretches)),
    )
    if run.constant:
        u0, y0 = facts["operating_point"]
        weights = [s.stop - s.start for s in run.stretches]
        facts["operating_point"] = (u0, y0 + float(np.average(constants_of(run, end.theta), weights=weights)))
    return Model(
        b=np.concatenate([np.zeros(run.nk), b]), a=f, d=d, nk=run.nk, structure="box_jenkins",
        cov_params=variance * inverse_of_squares(used)[:p, :p], noise_variance=variance, notes=notes, **facts,
    )  # fmt: skip
