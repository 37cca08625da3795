"""Gauge error of the wear: a textbook example, orthogonal regression, and a known truth recovered.

References: Fuller 1987, Measurement Error Models, example 1.2.1 (corn yields on soil nitrogen, error variance 57); its
moments as in the SAS/STAT sample library, ICALEX1, for which PROC CALIS fits the same model;
the least eigenvector of the weighted moment matrix (orthogonal regression) by scipy.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.fit.checks.gauge_error import gauge_corrected
from scipy.linalg import eigh

EXACT = 1e-8
TRUE = 0.35
SAMPLES = 60
# Standard deviations of the corrected exponent over samples are .055 and .085: three standard errors of the mean.
MONTE_CARLO = {0.05: 3 * 0.055 / SAMPLES**0.5, 0.1: 3 * 0.085 / SAMPLES**0.5}


def cut(gauge=0.0, *, seed=0, edges=24, per_edge=6, named=True, noise=0.06, absolute=False):
    """24 edges, 6 rows each; wear scatters by .1 about its law, power has the exponent .35 of the true wear."""
    rng = np.random.default_rng(seed)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(2.0 * np.arange(1, per_edge + 1), edges)
    V, f = (np.exp(rng.uniform(-0.7, 0.7, edges))[at] * middle for middle in (100, 0.2))
    AW = 7.62e-3 * V**0.577 * f**0.168 * t**0.245 * np.exp(0.1 * rng.normal(size=len(t)))
    P = 0.14 * V**0.82 * f**0.627 * t**-0.049 * AW**TRUE * np.exp(noise * rng.normal(size=len(t)))
    error = gauge * rng.normal(size=len(t))
    AW = AW + error if absolute else AW * np.exp(error)
    frame = pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V, "f": f, "t": t, "AW": AW, "P": P})
    return datasets.runs_from_frame(frame, edge=None if named else "none")


def power(*args, **kwargs):
    return fit.power_law(cut(*args, **kwargs), "P", ["V", "f", "t", "AW"])


def as_many_rows_as_parameters():
    return fit.power_law(datasets.runs_from_frame(cut().data.iloc[::31]), "P", ["V", "f", "t", "AW"])


def corn():
    """Yield as the logarithm of a roughness, nitrogen as its force: an exponential law is a line in them."""
    y = np.array([86, 115, 90, 86, 110, 91, 99, 96, 99, 104, 96.0])
    x = np.array([70, 97, 53, 64, 95, 64, 50, 70, 94, 69, 51.0])
    return fit.exponential_law(datasets.runs_from_frame(pd.DataFrame({"F": x, "Ra": np.exp(y - 97)}), judge=False))


def test_fullers_corn():
    """Printed: 67.56 + 0.4232 x; plain least squares 0.3440. The estimate is one of the moments alone."""
    law = corn()
    x, y = law.X[:, 0], np.log(law.observed) + 97
    S = np.cov(x, y)
    assert (x.mean(), y.mean()) == pytest.approx((70.6364, 97.4545), abs=5e-5)
    assert (S[0, 0], S[0, 1], S[1, 1]) == pytest.approx((304.8545, 104.8818, 87.6727), abs=5e-5)
    assert law.theta[1] == pytest.approx(0.3440, abs=5e-5)
    found = gauge_corrected(law, 57**0.5, wear="F", unit=law.units["F"])
    assert found.theta[1] == pytest.approx(0.4232, abs=5e-5)
    assert found.theta[0] + 97 == pytest.approx(67.56, abs=0.005)
    assert found.theta[1] == pytest.approx(104.8818 / (304.8545 - 57), abs=5e-7)
    assert found.reliability == pytest.approx(247.8545 / 304.8545, abs=1e-6)


def test_orthogonal_regression_at_its_own_ratio_of_errors_is_the_same():
    """Residuals of ln AW and ln P on the other factors; errors of variance s^2 and the response's, found here."""
    law, sd = power(0.05), 0.05
    found = gauge_corrected(law, sd)
    Z, y = law.formula.design(law.X), np.log(law.observed)
    others = Z[:, :4]
    pair = np.column_stack([Z[:, 4], y])
    left = pair - others @ np.linalg.lstsq(others, pair, rcond=None)[0]
    M = left.T @ left / (len(y) - 4)
    variance = M[1, 1] - found.theta[4] * M[0, 1]
    values, vectors = eigh(M, np.diag([sd**2, variance]))
    assert values[0] == pytest.approx(1, abs=1e-8)
    assert -vectors[0, 0] / vectors[1, 0] == pytest.approx(found.theta[4], rel=EXACT)


@pytest.mark.parametrize(("gauge", "plain"), [(0.05, 0.28), (0.1, 0.175)])
def test_a_true_exponent_is_recovered(gauge, plain):
    """.35 fitted as .28 at a gauge error of .05 and as .17 at .1: .01 / (.01 + s^2) of it."""
    laws = [power(gauge, seed=seed) for seed in range(SAMPLES)]
    naive = np.mean([law.theta[-1] for law in laws])
    fits = [gauge_corrected(law, gauge) for law in laws]
    corrected = np.array([found.theta[-1] for found in fits])
    time = np.array([found.theta[3] for found in fits])
    inside = [abs(found.theta[-1] - TRUE) < 2.07 * found.bse.iloc[-1] for found in fits]
    assert naive == pytest.approx(plain, abs=0.02)
    assert np.mean(corrected) == pytest.approx(TRUE, abs=MONTE_CARLO[gauge])
    assert np.mean(time) == pytest.approx(-0.049, abs=0.02)
    assert np.mean(inside) >= 0.88


def test_an_error_in_millimetres_is_recovered():
    laws = [power(0.006, seed=seed, absolute=True) for seed in range(SAMPLES)]
    naive = np.mean([law.theta[-1] for law in laws])
    corrected = np.mean([gauge_corrected(law, 0.006, unit="mm").theta[-1] for law in laws])
    assert naive < 0.31
    assert corrected == pytest.approx(TRUE, abs=MONTE_CARLO[0.05])


def test_no_gauge_error_is_the_plain_fit():
    for law in (power(), power(named=False)):
        found = gauge_corrected(law, 0.0)
        np.testing.assert_allclose(found.theta, law.theta, rtol=1e-10)
        assert (found.reliability, found.concern) == (1, 0)
    by_edge = power()
    np.testing.assert_allclose(gauge_corrected(by_edge, 0.0).cov_theta, by_edge.edges.cov_theta, rtol=1e-7)


def test_standard_errors_are_refits_without_each_edge():
    law = power(0.05)
    found = gauge_corrected(law, 0.05)
    Z, y = law.formula.design(law.X), np.log(law.observed)
    each = 0.05**2 * (len(y) - 4) / len(y) * np.diag([0, 0, 0, 0, 1.0])
    moved = []
    for name in law.edges.edges:
        kept = law.edge != name
        A = Z[kept].T @ Z[kept] - kept.sum() * each
        moved.append(np.linalg.solve(A, Z[kept].T @ y[kept]) - found.theta)
    moved = np.array(moved)
    np.testing.assert_allclose(found.cov_theta, 23 / 24 * moved.T @ moved, rtol=1e-5)


def test_larger_gauge_errors_correct_the_exponent_of_wear_further():
    law = power(0.05)
    params = pd.DataFrame([gauge_corrected(law, sd).params for sd in (0.0, 0.03, 0.05)])
    assert params["AW"].is_monotonic_increasing
    assert params["t"].is_monotonic_decreasing
    assert "as large as the variation of AW" in str(gauge_corrected(law, 0.5))


def test_words():
    weak = gauge_corrected(power(0.12, seed=3), 0.12)
    assert weak.reliability < 0.5
    assert (weak.concern, "weakly identified" in weak.verdict) == (1, True)
    coarse = gauge_corrected(power(), 0.006, unit="mm")
    assert coarse.coarse == int((0.006 / coarse.law.X[:, 3] > 0.3).sum())
    fine = gauge_corrected(power(0.02), 0.02)
    assert fine.verdict.startswith("A gauge error of 0.02 ln changes the coefficient of AW in the law of P from")
    assert list(fine.bse.index) == ["ln c0", "V", "f", "t", "AW"]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: gauge_corrected(power(), 0.2), "its exponent is not identified"),
        (lambda: gauge_corrected(as_many_rows_as_parameters(), 0.01), "5 observations fix 5 parameters"),
        (
            lambda: gauge_corrected(fit.power_law(cut(), "P", ["V", "AW"], error="additive"), 0.01),
            "fit with multiplicative errors",
        ),
        (lambda: gauge_corrected(power(noise=0.0), 0.01), "fits every row exactly"),
    ],
)
def test_what_cannot_be_corrected_says_why(make, words):
    assert words in str(make())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda law: gauge_corrected(law, 0.01, wear="VB"), "VB is no factor of the law of P"),
        (lambda law: gauge_corrected(law, -0.01), "gauge error -0.01"),
        (lambda law: gauge_corrected(law, 0.01, unit="um"), "AW is in mm"),
        (lambda law: gauge_corrected(corn(), 7.5, wear="F"), "give the error in N"),
    ],
)
def test_what_is_asked_wrongly_is_said(make, words):
    with pytest.raises(errors.UsageError, match=words):
        make(power())


def test_one_edge_goes_by_rows():
    law = fit.power_law(cut(0.02, edges=1, per_edge=15), "P", ["AW"])
    assert gauge_corrected(law, 0.02).bse["AW"] > 0


def test_nasa_wear_hardly_minds_its_gauge(measurements):
    """VB stands beside feed and depth that hardly predict it, so .02 mm moves its exponent by a few per cent."""
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    law = fit.power_law(runs, "smcAC_mid_std", ["f", "d", "VB"], by="material")
    found = gauge_corrected(law, 0.02, wear="VB", unit="mm")
    assert law.params["VB"] == pytest.approx(0.313, abs=0.001)
    assert found.params["VB"] == pytest.approx(0.323, abs=0.001)
    assert found.coarse == 3
