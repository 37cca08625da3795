"""Latent wear: the density against a dense multivariate normal (scipy), and a true exponent recovered.

References: scipy.stats.multivariate_normal and multivariate_t; Fuller 1987, Measurement Error Models, example 1.2.1.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import UsageError
from fitmodels.fit.bayes.convergence import compare_draws
from fitmodels.fit.bayes.density import law_density
from fitmodels.fit.bayes.joint_posterior import latent_wear
from fitmodels.fit.bayes.latent_model import latent_density
from fitmodels.fit.bayes.priors import Normal, reference, weak
from scipy.optimize import minimize
from scipy.stats import multivariate_normal, multivariate_t

pytestmark = pytest.mark.slow

TRUE = 0.35


def cut(gauge, *, seed=0, edges=24, per_edge=6, noise=0.06, levels=0.05, unit="ln", named=True):
    """Wear scatters by .1 within edges about its law; loads follow the true wear, and the gauge reads it."""
    rng = np.random.default_rng(seed)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(2.0 * np.arange(1, per_edge + 1), edges)
    V, f = (np.exp(rng.uniform(-0.7, 0.7, edges))[at] * middle for middle in (100, 0.2))
    u, v = (levels * rng.normal(size=edges)[at] for _ in range(2))
    w = 7.62e-3 * V**0.577 * f**0.168 * t**0.245 * np.exp(u + 0.1 * rng.normal(size=len(t)))
    P = 0.14 * V**0.82 * f**0.627 * t**-0.049 * w**TRUE * np.exp(v + noise * rng.normal(size=len(t)))
    F = 4000 * f**0.7 * w**0.2 * np.exp(noise * rng.normal(size=len(t)))
    error = gauge * rng.normal(size=len(t))
    AW = w * np.exp(error) if unit == "ln" else w + error
    frame = pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V, "f": f, "t": t, "AW": AW, "P": P, "Fxz": F})
    return datasets.runs_from_frame(frame, edge=None if named else "none")


def laws(runs, loads=("P",)):
    wear = fit.power_law(runs, "AW", ["V", "f", "t"])
    return wear, [fit.power_law(runs, load, ["V", "f", "t", "AW"]) for load in loads]


def dense(density, phi, rows, tau):
    """Covariance of the readings of some rows of one edge, (n (1 + K), n (1 + K)), written out."""
    sd = np.array([np.exp(phi[at.start + law.p]) for law, at in zip(density.laws, density.place, strict=True)])
    k = [
        np.exp(phi[at.start + law.p + 1]) if density.edges else 0.0
        for law, at in zip(density.laws, density.place, strict=True)
    ]
    c = np.array([1.0, *(phi[at.start + j] for at, j in zip(density.place[1:], density.wear, strict=True))])
    level = sd**2 * k
    shared = level[0] * np.outer(c, c) + np.diag([0.0, *level[1:]])
    whole = np.kron(np.ones((len(rows), len(rows))), shared)
    D = len(c)
    for i, row in enumerate(rows):
        own = sd[0] ** 2 * np.outer(c, c) + np.diag([tau[row] ** 2, *sd[1:] ** 2])
        whole[i * D : (i + 1) * D, i * D : (i + 1) * D] += own
    return whole


@pytest.mark.parametrize("errors", ["normal", "student"])
@pytest.mark.parametrize("loads", [("P",), ("P", "Fxz")], ids=["one load", "two loads"])
@pytest.mark.parametrize("known", ["one gauge error", "one for each row", "no gauge error"])
@pytest.mark.parametrize("named", [True, False], ids=["edges", "rows"])
def test_the_density_is_that_of_a_dense_covariance(errors, loads, known, named):
    rng = np.random.default_rng(3)
    wear, others = laws(cut(0.05, edges=5, per_edge=4, named=named), loads)
    of = [law_density(law, weak(law, edges=named)) for law in (wear, *others)]
    tau = {
        "one gauge error": np.array([0.07]),
        "one for each row": rng.uniform(0.02, 0.2, 20),
        "no gauge error": np.zeros(1),
    }[known]
    density = latent_density(of, tau, 1.0, gauge_df=9.0 if known == "one gauge error" else None, errors=errors)
    phi = density.start + 0.3 * rng.normal(size=(3, len(density.start)))
    got = density.by_unit(phi)
    assert got.shape == (3, 5 if named else 20)
    assert len(density.names) == len(density.parameter_names) == phi.shape[1] == density.parameters(phi).shape[1]
    phi = density.model(phi)
    for m in range(3):
        factor = np.exp(phi[m, density.place[-1].stop]) if density.gauge_df else 1.0
        sds = np.broadcast_to(tau * factor, 20)
        r = np.stack([part[m] for part in density.residuals(phi)], axis=1)
        for g, (start, size) in enumerate(zip(of[0].starts, of[0].sizes.astype(int), strict=True)):
            rows = range(start, start + size)
            cov, x = dense(density, phi[m], rows, sds), r[rows].ravel()
            if errors == "normal":
                expected = multivariate_normal(np.zeros(len(x)), cov).logpdf(x)
            else:
                expected = multivariate_t(np.zeros(len(x)), cov, df=np.exp(phi[m, -1])).logpdf(x)
            assert got[m, g] == pytest.approx(expected, rel=1e-9)


def test_without_gauge_error_the_laws_do_not_know_of_each_other():
    """At tau 0 the wear is its reading, and the joint density is the product of the plain ones."""
    wear, others = laws(cut(0.0, edges=6, levels=0.0), ("P", "Fxz"))
    of = [law_density(law, weak(law, edges=False)) for law in (wear, *others)]
    density = latent_density(of, np.zeros(1), 0.0)
    phi = density.start + 0.1 * np.random.default_rng(1).normal(size=(4, len(density.start)))
    plain = sum(law.log_likelihood(phi[:, at]) for law, at in zip(of, density.place, strict=True))
    assert density.log_likelihood(phi) == pytest.approx(plain, rel=1e-10)


@pytest.mark.parametrize("gauge_df", [None, 9.0])
def test_the_prior_carries_the_derivative_of_its_coordinates(gauge_df):
    """What ``phi`` has over the parameters of the model is ln |det| of differences of ``model``."""
    wear, others = laws(cut(0.05, edges=6), ("P", "Fxz"))
    of = [law_density(law, weak(law, edges=True)) for law in (wear, *others)]
    density = latent_density(of, np.array([0.07]), 0.07, gauge_df)
    phi = density.start + 0.2 * np.random.default_rng(2).normal(size=len(density.start))
    p, step = len(phi), 1e-5
    slope = (density.model(phi + step * np.eye(p)) - density.model(phi - step * np.eye(p))) / (2 * step)
    model = density.model(phi[None])
    plain = sum(law.log_prior(model[:, at]) for law, at in zip(of, density.place, strict=True))
    if gauge_df:  # sd^2 / given^2 is df over chi-square: its density, and that of its logarithm, but for a constant
        x = model[:, -1]
        plain = plain - gauge_df * (x + 0.5 * np.exp(-2 * x))
    assert density.log_prior(phi[None]) == pytest.approx(plain + np.linalg.slogdet(slope)[1], abs=1e-6)


def test_fullers_corn_is_where_the_likelihood_is_highest():
    """Fuller 1987, example 1.2.1, over 100: printed are 0.3440 as read and, with the divisor n - 1, 0.4232."""
    y = np.array([86, 115, 90, 86, 110, 91, 99, 96, 99, 104, 96.0]) / 100
    x = np.array([70, 97, 53, 64, 95, 64, 50, 70, 94, 69, 51.0]) / 100
    frame = pd.DataFrame({"V": np.exp(x[::-1]), "AW": np.exp(x), "P": np.exp(y)})
    runs = datasets.runs_from_frame(frame, judge=False)
    wear, load = fit.power_law(runs, "AW", ["V"]), fit.power_law(runs, "P", ["AW"])
    of = [law_density(law, weak(law, edges=False)) for law in (wear, load)]
    of[0] = replace(of[0], Z=of[0].Z * [1, 0])  # a wear law without factors
    density = latent_density(of, np.array([(57 * 10 / 11) ** 0.5 / 100]), 1.0)
    free = [0, 2, 3, 4, 5]

    def miss(z):
        phi = density.start.copy()
        phi[free] = z
        return -density.log_likelihood(phi[None])[0]

    top = minimize(miss, density.start[free], method="BFGS", options={"gtol": 1e-6})
    assert top.x[3] == pytest.approx(0.3440, abs=5e-5)
    phi = density.start.copy()
    phi[free] = top.x
    assert density.model(phi[None])[0, 4] == pytest.approx(0.4232, abs=5e-5)


@pytest.mark.parametrize(("gauge", "plain"), [(0.05, 0.29), (0.1, 0.19)])
def test_the_exponent_of_the_true_wear_is_found_where_the_plain_fit_misses_it(gauge, plain):
    """Twelve data sets; the plain exponents scatter by .06 each, so their mean by .02.

    At the larger gauge error the draws of one data set are skew, so that means lie above .35 by a part of their error.
    """
    read, rows = [], []
    for seed in range(12):
        wear, others = laws(cut(gauge, seed=seed))
        joint = latent_wear(wear, others, gauge, seed=seed, draws=2000)
        assert joint.convergence.passed
        assert f"{others[0].params['AW']:.2f}" in joint.words
        read.append(others[0].params["AW"])
        rows.append(joint.for_law("P").loc["AW"])
    found = pd.DataFrame(rows)
    assert np.mean(read) == pytest.approx(plain, abs=0.05)
    assert np.mean(read) < TRUE < found["high"].mean()
    assert np.mean(read) < found["mean"].mean() - 0.03
    assert abs(found["mean"].mean() - TRUE) < found["sd"].mean()
    assert ((found["low"] < TRUE) & (found["high"] > TRUE)).sum() >= 10


@pytest.mark.parametrize("gauge", [0.05, 0.1])
def test_latent_wear_and_the_closed_form_agree_where_there_are_many_rows(gauge):
    """Rows are independent, so that both weigh them alike; the priors are weak."""
    wear, others = laws(cut(gauge, seed=3, edges=150, levels=0.0, named=False))
    joint = latent_wear(wear, others, gauge)
    row = joint.for_law("P").loc["AW"]
    assert abs(joint.closed_form[0].params["AW"] - row["mean"]) < 0.25 * row["sd"]
    assert abs(row["mean"] - TRUE) < 2.5 * row["sd"]


def test_chains_and_importance_sampling_agree():
    wear, others = laws(cut(0.05, seed=5))
    one, two = (latent_wear(wear, others, 0.05, method=method) for method in ("importance", "emcee"))
    found = compare_draws((one.draws, one.sample.chains), (two.draws, two.sample.chains), one.names)
    assert found.agrees, found.words
    assert (one.method, two.method) == ("importance", "emcee")


def test_same_seed_same_draws():
    wear, others = laws(cut(0.05, edges=8))
    one, two, other = (latent_wear(wear, others, 0.05, seed=seed, draws=1000).draws for seed in (1, 1, 2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


def test_an_error_in_mm_is_a_larger_share_of_little_wear():
    runs = cut(0.008, seed=2, unit="mm")
    wear, others = laws(runs)
    joint = latent_wear(wear, others, 0.008, unit="mm")
    rows = np.sort(0.008 / wear.fitted)
    assert np.sort(joint.density.tau) == pytest.approx(rows)
    row = joint.for_law("P").loc["AW"]
    assert row["low"] < TRUE < row["high"]
    assert others[0].params["AW"] < row["mean"]
    rough = latent_wear(wear, others, 0.06, unit="mm", method="importance")
    assert rough.coarse == (0.06 / wear.fitted > 0.3).sum() > 0
    assert any("the approximation is poor" in note for note in rough.notes)


def test_a_gauge_error_known_from_few_readings_leaves_more_open():
    wear, others = laws(cut(0.05, seed=4))
    few, known = latent_wear(wear, others, 0.05, gauge_df=40), latent_wear(wear, others, 0.05)
    assert few.names[-1] == "gauge sd"
    assert few.table().loc["P: AW", "sd"] > known.table().loc["P: AW", "sd"]
    many = latent_wear(wear, others, 0.05, gauge_df=1e5)
    assert many.table().loc["gauge sd", ["low", "high"]].tolist() == pytest.approx([0.05, 0.05], rel=0.01)
    assert many.table().loc["P: AW", "mean"] == pytest.approx(known.table().loc["P: AW", "mean"], abs=0.01)


def test_laws_of_two_loads_share_the_wear_and_the_rows_they_all_have():
    runs = cut(0.05)
    data = runs.data.copy()
    data.loc[[3, 30], "P"] = np.nan
    wear, others = laws(replace(runs, data=data), ("P", "Fxz"))
    joint = latent_wear(wear, others, 0.05, draws=1000)
    assert joint.left_out == 2
    assert len(joint.density.laws[0].y) == 142
    assert list(joint.for_law("Fxz").index) == ["ln c0", "V", "f", "t", "AW", "sd", "icc"]
    assert joint.names[:6] == ("AW: ln c0", "AW: V", "AW: f", "AW: t", "AW: sd", "AW: icc")
    assert "2 lines left out" in joint.notes[0]
    assert joint.sample.words in " ".join(joint.summary().split())


def test_a_gauge_error_as_large_as_all_scatter_is_reported():
    wear, others = laws(cut(0.05))
    joint = latent_wear(wear, others, 0.2, method="importance", draws=400)
    assert not joint.closed_form[0]
    assert any("the priors are influential" in note for note in joint.notes)


def additive(wear, others):
    return latent_wear(wear, [others[0].alternative], 0.05)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda w, o: latent_wear(w, [], 0.05), "one law of the wear and one of each load"),
        (lambda w, o: latent_wear(w, [o[0], o[0]], 0.05), "one law of the wear and one of each load"),
        (lambda w, o: latent_wear(o[0], [w], 0.05), "P is no factor of the law of AW"),
        (lambda w, o: latent_wear(w, o, -0.05), "a standard deviation is 0 or more"),
        (lambda w, o: latent_wear(w, o, 0.05, unit="inch"), "give it in that, or in 'ln'"),
        (lambda w, o: latent_wear(w, o, 0.05, gauge_df=0.0), "both must be above 0"),
        (lambda w, o: latent_wear(w, o, 0.05, draws=10), "at least 400"),
        (lambda w, o: latent_wear(w, o, 0.05, errors="cauchy"), "'normal' or 'student'"),
        (lambda w, o: latent_wear(w, o, 0.05, priors="reference"), "'weak', or Priors of each response"),
        (lambda w, o: latent_wear(w, o, 0.05, priors={"P": reference(o[0], edges=True)}), "must have a proper prior"),
        (lambda w, o: latent_wear(w, o, 0.05, method="nuts"), "'importance' or 'emcee'"),
        (lambda w, o: latent_wear(w, laws(cut(0.05, seed=9))[1], 0.05), "fit all to the same runs"),
        (additive, "fitted with error='multiplicative'"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(call, words):
    wear, others = laws(cut(0.05))
    with pytest.raises(UsageError, match=words):
        call(wear, others)


def test_a_prior_of_ones_own_replaces_the_weak_one():
    wear, others = laws(cut(0.1, seed=1))
    tight = weak(others[0], edges=True).with_("tight", AW=Normal(0.35, 0.01))
    joint = latent_wear(wear, others, 0.1, priors={"P": tight})
    assert joint.table().loc["P: AW", "sd"] < 0.011
    assert joint.priors["P"].name == "tight"
