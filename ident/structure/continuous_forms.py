"""Continuous forms with few parameters fitted to a record: lags, oscillation, zero, integrators, with delay.

The parameters minimise the simulation error whitened by an autoregression of the residual, by Levenberg-Marquardt from
the best points of a grid of time constants, damping ratios and delays. Initial state and offset (of an integrating form
also a ramp: the input at which the plant rests is not known) of each stretch are projected out. The input before a
stretch is taken as its first value; where the first samples contradict this, they are left out.

Sources: Ljung 1999, System Identification, sections 10.2 and 4.3; Soderstrom & Stoica 1989, section 7.5.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.filters import filtered, squares, whitening
from ..model import Model
from .fitted_form import FittedForm, described
from .form_estimation import FormData, FormFit, at_limit, form_data, free_columns, improved
from .sampled_forms import EQUAL_LAGS, INTEGRATORS, LAG, SECOND_ORDER, Form, sample

MOST_DELAY = 200  # samples, of the grid
ROUGH = 0.3  # standard errors: a smaller step ends the first iteration
SLOW = 8.0  # a time constant above the length of the record over this may be an integrator
MARGIN = 4  # samples above the delay of a lag in the search of further delays
BEHIND = 100.0  # of N ln V: a form that far behind the best is not refined
DAMPING_RATIOS = {0.1: 16, 0.4: 7, 1.2: 6}  # of the grid, with the number of time constants
COARSE = 10  # time constants of the grid
NEIGHBOUR = 0.75  # samples: a delay further off is another minimum
NOISE_PASSES = 2  # estimates of the noise model, each followed by one of the form
NO_DELAY = 2.0  # standard errors of the delay: below, the form without a delay is fitted too
UNLIKELY = 6.0  # standard deviations of chi-squared: larger first errors come from the input before the stretch
CHI2_MEDIAN = 0.455  # of one degree of freedom


def fit_forms(
    rec: Record, delays: Sequence[int] | None = None, *, additional: Array | None = None
) -> tuple[FittedForm, ...]:
    """Continuous forms fitted to a record, those that can be estimated from it.

    Parameters
    ----------
    rec : Record
        Centred.
    delays : sequence of int, optional
        Whole samples from which the delay is estimated, 0 or more; by default 0 to 200.
    additional : ndarray, shape (N, k), optional
        Additional regressors of the output, estimated simultaneously: lines, drift.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> from fitmodels.ident.continuous import sampled
    >>> u = np.sign(np.sin(0.05 * np.arange(400) ** 1.2))
    >>> y = sampled([2.0], [0.5, 1.0], dt=0.1, delay=0.33).simulate(u)
    >>> y += 0.01 * np.random.default_rng(1).standard_normal(400)
    >>> lag = fit_forms(Record(u=u, y=y, sample_time=0.1))[0]
    >>> lag.name, lag.symbols, lag.values.round(2).tolist()
    ('lag with delay', ('K', 'T', 'L'), [2.0, 0.5, 0.33])
    """
    data = form_data(rec, additional)
    near = range(min(MOST_DELAY, data.longest // 4) + 1) if delays is None else delays
    shifts = np.unique([0, *near])
    with np.errstate(all="ignore"):  # a diverging trial has an infinite loss and is not taken
        found = _fits(data, shifts)
        data, found = _without_unknown_past(data, found, shifts)
        found = _refined(data, found)
    return tuple(described(rec, data, fit) for fit in found)


def refit_form(rec: Record, fitted: FittedForm, *, additional: Array | None = None) -> FittedForm:
    """The same form fitted to another record, starting at the parameters of ``fitted``.

    Raises
    ------
    IdentError
        The search leaves the range of finite errors.
    """
    data = form_data(rec, additional)
    with np.errstate(all="ignore"):
        found = improved(data, fitted.form, fitted.p, fitted.noise)
        if found is not None:
            data = _compared(data, found)
            found = _with_noise(data, found, whitening(data.packed(found.plain), data.compared)[0])
    if found is None:
        raise IdentError(f"{fitted.name} cannot be fitted to this record: its errors are not finite.")
    return described(rec, data, found)


def integrating(rec: Record, estimate: Callable[[Record, Array], Model]) -> Model:
    """Model with a pole at exactly 1: the estimate from the running sum of the input, times 1 / (1 - q^-1).

    Parameters
    ----------
    rec : Record
    estimate : callable
        Estimates a model from the record of the running sum and from a additional regressor (N, 1): a
        slope, because the input at which the output rests is not known.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> from fitmodels.ident import output_error
    >>> u = np.sign(np.sin(0.05 * np.arange(400) ** 1.2))
    >>> y = Model(b=[0.0, 0.05], a=[1.0, -1.5, 0.5], nk=1, sample_time=0.1).simulate(u - u.mean())
    >>> y += 0.01 * np.random.default_rng(1).standard_normal(400)
    >>> model = integrating(Record(u=u, y=y, sample_time=0.1), lambda rec, slope: output_error(rec, 1, 1, 1))
    >>> model.integrating, model.a.round(2).tolist()
    (True, [1.0, -1.5, 0.5])
    """
    data = form_data(rec)
    mean = float(rec.u.mean())
    total = np.concatenate([np.cumsum(rec.u[s] - mean) for s in rec.stretches])
    slope = data.ramp[:, None] / data.longest
    inner = estimate(replace(rec, u=total).centred(), slope)
    left = rec.y - filtered(inner.b, inner.a, total, rec.stretches)
    columns = np.column_stack([slope, free_columns(data, inner.a)])
    rise = float(np.linalg.lstsq(columns, left, rcond=None)[0][0]) / data.longest  # of the output, per sample
    u0, y0 = np.average(np.asarray(rec.offsets), axis=0, weights=[s.stop - s.start for s in rec.stretches])
    return replace(inner.with_integrator(), operating_point=(float(u0) + mean - rise / inner.dc_gain, float(y0)))


def _fits(data: FormData, delays: Array) -> list[FormFit]:
    """All forms that may describe the record, fitted with white errors."""
    scan = _scan(data, delays)
    found = _variants(scan, LAG, [scan.starts(LAG)[0][0].p])
    for fit in found[:1]:  # the delay of a lag holds the further lags too
        scan = _scan(data, delays[delays <= fit.p[2] + MARGIN] if fit.form.delayed else delays[:MARGIN])
    second, zero, _, undelayed = scan.starts(SECOND_ORDER[1])
    split = [_as_two_lags(fit.p) for fit in found if fit.form.delayed]
    twice = _variants(scan, SECOND_ORDER[0], [second[0].p, *split], found)
    no_zero = [np.concatenate([fit.p[:3], [0.0], fit.p[3:]]) for fit in twice if fit.form.delayed]
    found += [*twice, *_variants(scan, SECOND_ORDER[1], [zero[0].p, *no_zero], twice)]
    found += _best(scan, replace(SECOND_ORDER[1], delayed=False), [undelayed[0].p[:-1]])
    if any(_slowest(fit) > data.longest / SLOW for fit in found) or not found:
        for form in INTEGRATORS:
            found += _variants(scan, form, [np.append(scan.starts(form)[0][0].p, 0.0)])
    if any(math.log(0.3) < fit.p[2] < math.log(1.1) for fit in found if fit.form.name == "second order"):
        several = [fits for form in EQUAL_LAGS if (fits := _variants(scan, form, [scan.starts(form)[0][0].p]))]
        several = [fits for fits in several if fits[0].p[1] >= 0]  # T below one sample: the lags stand for a delay
        if several:
            found += sorted(several, key=lambda fits: fits[0].loss)[0]
    return found


def _slowest(fit: FormFit) -> float:
    """Slowest time constant in samples."""
    if "zeta" not in fit.form.parameters:
        return math.exp(fit.p[1])
    zeta = math.exp(fit.p[2])
    return math.exp(fit.p[1]) * (zeta + math.sqrt(max(zeta * zeta - 1, 0.0)))


def _as_two_lags(p: Array) -> Array:
    """K, log T, log zeta, L of two lags that act like the lag and delay p: a tenth of T is the second lag."""
    return np.array(
        [p[0], p[1] + math.log(0.1) / 2, math.log(0.55 / math.sqrt(0.1)), max(p[2] - 0.1 * math.exp(p[1]), 0)]
    )


def _best(scan: "_Scan", form: Form, starts: Sequence[Array], nested: Sequence[FormFit] = ()) -> list[FormFit]:
    """The best fit from several starts, unless a parameter is at its bound.

    A start is the last where the fit is as good as those of the ``nested`` forms, which it contains.
    """
    data, enough, runs = scan.data, min((fit.loss for fit in nested), default=0.0), []
    for p in starts:
        run = improved(data, form, p, np.ones(1), ROUGH)
        if run and not at_limit(run, data):
            runs.append(run)
            if run.loss <= enough:
                break
    if not runs:
        return []
    best = min(runs, key=lambda run: run.loss)
    other = scan.other_delay(best) if form.delayed and "Tz" not in form.parameters else None
    again = improved(data, form, other, np.ones(1), ROUGH) if other is not None else None
    return [again if again and again.loss < best.loss and not at_limit(again, data) else best]


def _variants(scan: "_Scan", form: Form, starts: Sequence[Array], nested: Sequence[FormFit] = ()) -> list[FormFit]:
    """The form with its delay, and without where the delay is not clearly above zero."""
    k = form.size - 1
    for fit in _best(scan, form, starts, nested):
        found = [fit] if fit.p[k] > 0 else []
        if "Tz" not in form.parameters and fit.p[k] <= NO_DELAY * math.sqrt(fit.cov[k, k]):
            found += _best(scan, replace(form, delayed=False), [np.delete(fit.p, k)])
        return found
    return []


def _without_unknown_past(data: FormData, found: list[FormFit], delays: Array) -> tuple[FormData, list[FormFit]]:
    """The data less the first samples of stretches whose response to the input before them is not zero; new fits."""
    if not found:
        return data, found
    shorter = _compared(data, min(found, key=lambda fit: fit.loss))
    return (data, found) if shorter is data else (shorter, _fits(shorter, delays))


def _compared(data: FormData, fit: FormFit) -> FormData:
    """The data less the first samples of stretches that the input before them still moves."""
    late = math.ceil(fit.p[fit.form.size - 1]) + 1 if fit.form.delayed else 0
    usual = float(np.median(np.square(fit.plain))) / CHI2_MEDIAN
    skipped = tuple(late * _differs(fit.plain[s.start : s.start + late], s, usual) for s in data.stretches)
    return replace(data, skipped=skipped) if any(skipped) else data


def _differs(first: Array, s: slice, usual: float) -> bool:
    """Whether the first errors of a stretch are larger than the usual mean square allows."""
    n = len(first)
    return 0 < 2 * n < s.stop - s.start and squares(first) > usual * (n + UNLIKELY * (math.sqrt(2 * n) + UNLIKELY))


def _refined(data: FormData, found: list[FormFit]) -> list[FormFit]:
    """The fits converged with whitened errors, where they are not far behind the best."""
    noise = [whitening(fit.e, data.compared) for fit in found]
    losses = [len(fit.e) * math.log(max(v, 1e-300)) for fit, (_, v) in zip(found, noise, strict=True)]
    limit = min(losses, default=0.0) + BEHIND
    return [
        _with_noise(data, fit, h) if loss < limit else fit
        for fit, (h, _), loss in zip(found, noise, losses, strict=True)
    ]


def _with_noise(data: FormData, fit: FormFit, h: Array) -> FormFit:
    """The fit and its noise model estimated in turn."""
    for k in range(NOISE_PASSES):
        if k:
            h = whitening(data.packed(fit.plain), data.compared)[0]
        fit = improved(data, fit.form, fit.p, h) or fit
        if len(h) == 1:
            break
    return fit


@dataclass(frozen=True, slots=True)
class _Start:
    """Point of the grid with the gain (and zero) of least squares: reduction of the sum of squares, parameters."""

    fall: float
    p: Array


@dataclass(frozen=True, slots=True)
class _Scan:
    """Projection of the output on the responses of forms at many delays at once.

    ``early`` (delays, N) holds the output advanced by each delay.
    """

    data: FormData
    delays: Array
    early: Array

    def falls(self, form: Form, points: Sequence[Array]) -> list[tuple[Array, Array]]:
        """Reduction of the sum of squares (delays,) and weights (delays, k) by the first k = 1 ... of the points."""
        X = np.empty((len(self.data.y), len(points)), order="F")
        den = np.ones(1)
        for k, p in enumerate(points):
            model = sample(form, p)
            num, den = np.append(np.zeros(model.whole + 1), model.b), np.append(1.0, model.a)  # den is that of all
            X[:, k] = filtered(num, den, self.data.input(form), self.data.stretches)
        free = free_columns(self.data, den if len(points) == 1 else np.ones(1))  # of a grid of two, the offset alone
        free = np.column_stack([free, self.data.ramp]) if form.integrating else free
        free /= np.linalg.norm(free, axis=0)
        X -= free @ np.linalg.solve(free.T @ free + 1e-10 * np.eye(free.shape[1]), free.T @ X)
        G, c = X.T @ X, self.early @ X
        out = []
        for k in range(1, len(points) + 1):
            weights = np.linalg.solve(G[:k, :k] + 1e-12 * G[0, 0] * np.eye(k), c[:, :k].T).T
            out.append((np.sum(weights * c[:, :k], axis=1), weights))
        return out

    def starts(self, form: Form) -> list[list[_Start]]:
        """Starts by number of linear parameters (K; K and Tz), best first; then those of ``delays[0]`` alone."""
        plain, linear = replace(form, delayed=False), 1 + (form.parameters[-1] == "Tz")
        found: list[list[_Start]] = [[] for _ in range(2 * linear)]
        for point in _grid(self.data, form):
            points = [np.array([1.0, *point, *[float(k)] * (linear - 1)]) for k in range(linear)]
            for k, (falls, weights) in enumerate(self.falls(plain, points)):
                for at, into in ((int(np.argmax(falls)), found[k]), (0, found[linear + k])):
                    into.append(_Start(float(falls[at]), _parameters(point, weights[at], float(self.delays[at]))))
        return [sorted(starts, key=lambda start: -start.fall) for starts in found]

    def other_delay(self, fit: FormFit) -> Array | None:
        """Parameters of a fit with another delay at which the output is projected better, if there is one."""
        k = fit.form.size - 1
        unit = np.append(1.0, fit.p[1:k])
        parts = [(part, *self.falls(fit.form, [np.append(unit, part)])[0]) for part in (0.0, 0.5)]
        falls = np.concatenate([fall for _, fall, _ in parts])
        at = np.concatenate([self.delays + part for part, _, _ in parts])
        best, near = int(np.argmax(falls)), int(np.argmin(np.abs(at - fit.p[k])))
        if abs(at[best] - fit.p[k]) <= NEIGHBOUR or falls[best] <= falls[near]:
            return None
        gain = np.concatenate([weights[:, 0] for _, _, weights in parts])[best]
        return np.concatenate([[gain], fit.p[1:k], [at[best]], fit.p[k + 1 :]])


def _scan(data: FormData, delays: Array) -> _Scan:
    """The output advanced by the delays."""
    early = np.zeros((len(delays), len(data.y)))
    for row, d in zip(early, delays.tolist(), strict=True):
        for s in data.stretches:
            row[s.start : max(s.stop - d, s.start)] = data.y[s.start + d : s.stop]
    return _Scan(data, delays.astype(np.float64), early)


def _grid(data: FormData, form: Form) -> list[list[float]]:
    """Points (log T, log zeta) of the grid."""
    if "T" not in form.parameters:
        return [[]]
    longest = data.longest / 4
    if "zeta" not in form.parameters:
        return [[t] for t in np.log(np.geomspace(0.7, longest / form.order, COARSE))]
    pairs = ((zeta, np.geomspace(0.7, longest, n)) for zeta, n in DAMPING_RATIOS.items())
    return [[math.log(t), math.log(zeta)] for zeta, T in pairs for t in T]


def _parameters(point: list[float], weights: Array, delay: float) -> Array:
    """K, log T, log zeta, Tz, L of a point of the grid."""
    gain = float(weights.sum())
    return np.array([gain, *point, *(weights[1:] / (gain or 1.0)), delay])
