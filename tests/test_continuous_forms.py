"""Continuous forms: sampling, sensitivities, estimates, integrators."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.datasets import Record
from fitmodels.datasets.records.record import join_records
from fitmodels.ident.continuous import sampled
from fitmodels.ident.structure.continuous_forms import FittedForm, fit_forms
from fitmodels.ident.structure.sampled_forms import EQUAL_LAGS, INTEGRATORS, LAG, SECOND_ORDER, Form, sample
from fitmodels.ident.validation.model_validation import validate
from fitmodels.parameters.checks.values import check_estimates
from fitmodels.parameters.sections.dynamics import DynamicsSection
from scipy.signal import lfilter

DT, N = 0.02, 750
# Numerator and denominator in s, delay in s, and name, symbols, and values expected
PLANTS = {
    "lag with delay": ([2.0], [0.3, 1.0], 0.05, [2.0, 0.3, 0.05]),
    "two lags with delay": ([1.0], [0.05, 0.6, 1.0], 0.03, [1.0, 0.5, 0.1, 0.03]),
    "second order": ([1.0], [0.01, 0.02, 1.0], 0.0, [1.0, 0.1, 0.1]),
    "two lags with zero": ([-0.1, 1.0], [0.04, 0.5, 1.0], 0.0, [1.0, 0.4, 0.1, -0.1]),
    "integrator with delay": ([1.0], [1.0, 0.0], 0.13, [1.0, 0.13]),
    "integrator with lag": ([1.0], [0.5, 1.0, 0.0], 0.0, [1.0, 0.5]),
}


def chirp(n: int = N) -> np.ndarray:
    """The input of the published plant: 0.1 to 2 Hz in 15 s."""
    t = DT * np.arange(n)
    return 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / 30 * t) * t)


def recorded(name: str, seed: int, coloured: bool = False, u: np.ndarray | None = None) -> Record:
    """Record of a plant with sensor noise of 30 dB, an offset of input and output."""
    num, den, delay, _ = PLANTS[name]
    u = chirp() if u is None else u
    y = sampled(num, den, DT, delay).simulate(u)
    e = np.random.default_rng(seed).standard_normal(len(u) + 200)
    e = (lfilter([1.0], [1.0, -0.8], e) if coloured else e)[200:]
    return Record(u=u + 1.0, y=y + 5.0 + 0.032 * y.std() / e.std() * e, sample_time=DT).centred()


def named(forms: tuple[FittedForm, ...], name: str) -> FittedForm:
    """The form of this name."""
    return next(form for form in forms if form.name == name)


FORMS = (LAG, *SECOND_ORDER, *INTEGRATORS, *EQUAL_LAGS)
INNER = {"lag": [1.9], "second order": [1.6, -1.2], "second order with zero": [1.6, 0.5, -3.0], "integrator": [],
         "integrator with lag": [1.8]}  # fmt: skip


def point_of(form: Form, delay: float | None) -> np.ndarray:
    """K, log T, log zeta, Tz, L in samples."""
    return np.array([2.0, *INNER.get(form.name, [1.9]), *([] if delay is None else [delay])])


def continuous(form: Form, p: np.ndarray) -> tuple[list[float], np.ndarray]:
    """Numerator and denominator in s, time in samples."""
    if form in EQUAL_LAGS:
        return [p[0]], (np.poly1d([np.exp(p[1]), 1.0]) ** form.order).coeffs
    if form in SECOND_ORDER:
        T, zeta = np.exp(p[1:3])
        return [*([p[0] * p[3]] if "Tz" in form.parameters else []), p[0]], np.array([T * T, 2 * zeta * T, 1.0])
    den = np.array([np.exp(p[1]), 1.0]) if "T" in form.parameters else np.ones(1)
    return [p[0]], np.r_[den, 0.0] if form.integrating else den


@pytest.mark.parametrize("delay", [None, 0.0, 2.3, 4.0])
@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_sampled_forms_agree_with_the_matrix_exponential(form: Form, delay: float | None) -> None:
    p = point_of(form, delay)
    found, model = sample(replace(form, delayed=delay is not None), p), sampled(*continuous(form, p), 1.0, delay or 0.0)
    a = np.r_[1.0, found.a]
    np.testing.assert_allclose(np.convolve(a, [1.0, -1.0]) if form.integrating else a, model.a, atol=1e-12)
    b = np.r_[np.zeros(found.whole + 1), found.b]
    size = max(len(b), len(model.b))
    np.testing.assert_allclose(np.pad(b, (0, size - len(b))), np.pad(model.b, (0, size - len(model.b))), atol=1e-13)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_sensitivities_agree_with_differences(form: Form) -> None:
    p = point_of(form, 2.3)
    found = sample(form, p)
    for i in range(len(p)):
        step = 1e-6 * np.eye(len(p))[i]
        high, low = sample(form, p + step), sample(form, p - step)
        np.testing.assert_allclose(found.db[i], (high.b - low.b) / 2e-6, atol=1e-7)
        np.testing.assert_allclose(found.da[i], (high.a - low.a) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize("name", list(PLANTS))
def test_parameters_are_recovered_within_their_standard_errors(name: str, coloured: bool) -> None:
    form = named(fit_forms(recorded(name, 5, coloured)), name)
    z = (form.values - PLANTS[name][-1]) / form.bse
    assert np.abs(z).max() < 3.5
    assert np.all(form.bse < 0.2 * np.abs(form.values))
    num, den, delay, _ = PLANTS[name]
    f = np.geomspace(0.1, 2.0, 20)
    truth = sampled(num, den, DT, delay).response(f)
    assert np.abs(form.model.response(f) / truth - 1).max() < 0.05


def test_model_and_covariance_follow_the_parameters() -> None:
    form = named(fit_forms(recorded("lag with delay", 2)), "lag with delay")
    K, T, L = form.values
    exact = sampled([K], [T, 1.0], DT, L)
    np.testing.assert_allclose(form.model.theta, exact.theta, rtol=1e-9)
    assert form.model.cov_params is not None
    assert np.linalg.matrix_rank(form.model.cov_params, tol=1e-9 * np.trace(form.model.cov_params)) == 3


def test_input_before_the_record_is_unknown() -> None:
    """A record cut out of a running experiment: the first samples answer to the input before it."""
    u = np.tile(np.sign(np.sin(0.9 * np.arange(60) ** 1.3)), 15)
    rec = recorded("lag with delay", 3, u=u).part(137, 887).centred()
    form = named(fit_forms(rec), "lag with delay")
    assert np.abs((form.values - PLANTS["lag with delay"][-1]) / form.bse).max() < 3.5
    assert np.any(form.e[:3] == 0)


def test_additional_regressors_are_estimated_simultaneously_with_the_plant() -> None:
    rec = recorded("lag with delay", 4)
    t = np.arange(N)
    additional = np.column_stack([np.cos(0.9 * t), np.sin(0.9 * t), t / N])
    disturbed = replace(rec, y=rec.y + additional @ [1.0, 0.5, 2.0], sha256=None)
    plain, found = (named(fit_forms(r, additional=additional), "lag with delay") for r in (rec, disturbed))
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-4)


def test_runs_of_an_integrator_share_their_rest_input() -> None:
    runs = [recorded("integrator with lag", seed, u=chirp(400) + seed) for seed in (1, 2)]
    forms = fit_forms(join_records(runs))
    form = named(forms, "integrator with lag")
    assert np.abs((form.values - PLANTS["integrator with lag"][-1]) / form.bse).max() < 3.5
    assert form.integrating
    assert form.units == ("output/(input s)", "s")


def test_integrating_model_is_validated_with_a_free_slope() -> None:
    model = named(fit_forms(recorded("integrator with lag", 1)), "integrator with lag").model
    other = replace(recorded("integrator with lag", 2), sha256="2")
    drifting = replace(other, y=other.y + 0.01 * np.arange(N))
    found, drift = validate(model, other), validate(model, drifting)
    assert found.concern == 0
    assert found.fit > 90
    assert drift.fit == pytest.approx(found.fit, abs=1e-6)


def test_integrating_model_in_the_parameter_file() -> None:
    given = {"kind": "none", "reason": "given"}
    model = sampled([2.0], [0.5, 1.0, 0.0], DT)
    section = DynamicsSection(b=model.b.tolist(), a=model.a.tolist(), nk=1, sample_time=DT, uncertainty=given)
    assert section.integrating
    assert not section.stable
    assert section.poles[0] == 1
    assert np.isinf(section.dc_gain)
    assert model.rate_gain == pytest.approx(2.0, rel=1e-9)


def test_check_of_a_file_states_the_rate_of_an_integrator() -> None:
    model = named(fit_forms(recorded("integrator with lag", 1)), "integrator with lag").model
    for one, passed in ((model, True), (replace(model, cov_params=1e6 * model.cov_params), False)):
        pf = parameters.collect(tool="clamp", work="axis", laws=[], dynamics=one)
        *_, first, rate = [finding for finding in check_estimates(pf) if finding.name == "dynamics"]
        assert "one pole at 1 and every other within radius 0.96" in first.words
        assert rate.passed is passed
        assert "rises by 1.00" in rate.words


def test_five_slow_lags_are_not_an_integrator() -> None:
    model = sampled([1.0], np.poly([-1.0] * 5), DT)
    assert model.stable
    assert not model.integrating
    assert model.dc_gain == pytest.approx(1.0, rel=1e-3)
