"""The posterior of a law: routes agree, truth is found, draws repeat, and what cannot be is said in a sentence."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.core.errors import UsageError
from fitmodels.fit.bayes.convergence import compare_draws
from fitmodels.fit.bayes.priors import Beta, HalfT, Normal, Priors

pytestmark = pytest.mark.slow

CONDITIONS = ["V", "f", "d", "t"]


def bundled_law(response="AW", **options):
    factors = CONDITIONS if response == "AW" else [*CONDITIONS, "AW"]
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), response, factors, **options)


def nasa(measurements, **options):
    runs = datasets.read_runs(
        measurements / "nasa_milling" / "nasa_mill_runs.csv", map={"edge": "case", "t": "time", "d": "DOC"}
    )
    return fit.power_law(runs, "VB", ["f", "d", "t"], by="material", **options)


def turning(measurements):
    runs = datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv")
    return fit.power_law(runs, "Fx", ["d", "V", "f"], edge=None)


def together(law, one, other, **options):
    a, b = (fit.posterior(law, method=method, seed=seed, **options) for method, seed in ((one, 1), (other, 2)))
    assert a.convergence.passed, a.convergence.reasons
    assert b.convergence.passed, b.convergence.reasons
    reported = compare_draws((a.draws, a.sample.chains), (b.draws, b.sample.chains), a.names)
    assert reported.agrees, reported.words


@pytest.mark.parametrize("other", ["importance", "emcee"])
@pytest.mark.parametrize("priors", ["weak", "reference"])
@pytest.mark.parametrize("edge", ["edge", None], ids=["levels of edges", "independent rows"])
def test_routes_agree_on_the_bundled_set(edge, priors, other):
    together(bundled_law(edge=edge), "exact", other, priors=priors)


@pytest.mark.parametrize("other", ["importance", "emcee"])
def test_routes_agree_on_wear_of_a_real_mill(measurements, other):
    together(nasa(measurements), "exact", other)


@pytest.mark.parametrize("other", ["importance", "emcee"])
def test_routes_agree_on_forces_of_a_real_lathe(measurements, other):
    together(turning(measurements), "exact", other)


@pytest.mark.parametrize(
    "options",
    [{"error": "additive"}, {"error": "additive", "edge": None}, {"errors": "student"}],
    ids=["natural units", "natural units, independent rows", "Student errors"],
)
def test_importance_and_chains_agree_where_nothing_is_exact(options):
    errors = options.pop("errors", "normal")
    together(bundled_law(**options), "importance", "emcee", errors=errors)


def test_the_route_is_chosen_by_the_model():
    assert fit.posterior(bundled_law()).method == "exact"
    assert fit.posterior(bundled_law(), errors="student").method == "importance"
    assert fit.posterior(bundled_law(error="additive")).method == "importance"


@pytest.mark.parametrize("method", ["exact", "importance", "emcee"])
def test_same_seed_same_draws_bit_for_bit(method):
    law = bundled_law()
    a, b, c = (fit.posterior(law, method=method, seed=seed, draws=1000) for seed in (3, 3, 4))
    assert np.array_equal(a.draws, b.draws)
    assert not np.array_equal(a.draws[: len(c.draws)], c.draws[: len(a.draws)])


def test_importance_that_fails_hands_over_to_chains(monkeypatch):
    monkeypatch.setattr("fitmodels.fit.bayes.convergence.K_HAT", -10.0)
    monkeypatch.setattr("fitmodels.fit.bayes.sampling.K_HAT", -10.0)
    post = fit.posterior(bundled_law(error="additive"), draws=1000)
    assert post.method == "emcee"
    assert any("MCMC replaced" in note for note in post.notes)


def test_an_outlying_edge_counts_for_less_with_student_errors():
    rng = np.random.default_rng(1)
    V = np.repeat(np.exp(rng.uniform(4, 5.3, 20)), 4)
    ln = 1.5 * np.log(V) - 9 + rng.normal(0, 0.05, 80)
    ln[V.max() == V] += 3.0
    runs = datasets.runs_from_frame(
        pd.DataFrame({"V": V, "AW": np.exp(ln), "edge": np.repeat([f"e{i}" for i in range(20)], 4)}), judge=False
    )
    law = fit.power_law(runs, "AW", ["V"])
    normal, student = (fit.posterior(law, errors=errors).draws[:, 1].mean() for errors in ("normal", "student"))
    assert abs(student - 1.5) < 0.2 < abs(normal - 1.5)


# Prediction


def test_bands_of_draws_and_of_the_fit_tell_alike():
    """With weak priors and 24 edges a credible band is close to the interval of least squares."""
    law = bundled_law()
    at = {"V": [80.0, 150.0], "f": 0.2, "d": 2.0, "t": 8.0}
    drawn, fitted = fit.posterior(law).predict(at), law.predict(at)
    assert drawn.value == pytest.approx(fitted.value, rel=0.02)
    assert np.log(drawn.high / drawn.low) == pytest.approx(np.log(fitted.high / fitted.low), rel=0.1)
    assert drawn.of == "95 % credible interval for one row of a new edge, equal tails"


def test_a_new_edge_is_less_certain_than_the_same_and_both_than_the_law():
    post = fit.posterior(bundled_law())
    at = {"V": 100.0, "f": 0.2, "d": 2.0, "t": 8.0}
    bands = [
        post.predict(at, "mean").to_frame(),
        post.predict(at, "prediction", edge="same").to_frame(),
        post.predict(at, "prediction").to_frame(),
    ]
    widths = [float((band["high"] - band["low"]).iloc[0]) for band in bands]
    assert widths == sorted(widths)


def test_the_chance_of_exceeding_a_limit_is_that_of_the_draws():
    post = fit.posterior(bundled_law())
    at = {"V": 150.0, "f": 0.3, "d": 2.0, "t": 10.0}
    assert post.exceeds(at, 0.0)[0] == 1.0
    median = post.predict(at, "prediction").to_frame()["value"].iloc[0]
    assert post.exceeds(at, median)[0] == pytest.approx(0.5, abs=0.01)


def test_priors_that_speak_are_found_out():
    law = bundled_law()
    assert fit.posterior(law).sensitivity().abs().to_numpy().max() < 0.1
    tight = {"AW": {"V": {"distribution": "normal", "mean": 3.0, "sd": 0.02}}}
    post = fit.posterior(law, priors=tight)
    moved = post.sensitivity()
    wider = fit.posterior(law, priors=post.priors.scaled(2.0))
    expected = (wider.draws.mean(axis=0) - post.draws.mean(axis=0)) / post.draws.std(axis=0)
    assert moved["doubled"].to_numpy() == pytest.approx(expected, abs=0.1)  # by weights, and by drawing again
    assert moved["doubled"].abs().max() > 0.5


# Rows correlated beyond a random intercept


def test_draws_that_are_too_sure_are_found_out():
    rng = np.random.default_rng(4)
    edges, rows = 30, 6
    t = np.tile([2.0, 4.0, 7.0, 11.0, 16.0, 20.0], edges)
    pace = np.repeat(rng.normal(0.5, 0.15, edges), rows)
    V = np.repeat(np.exp(rng.uniform(4, 5.3, edges)), rows)
    ln = np.log(V) - 8 + pace * np.log(t) + rng.normal(0, 0.03, edges * rows)
    names = np.repeat([f"e{i}" for i in range(edges)], rows)
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "t": t, "AW": np.exp(ln), "edge": names}))
    post = fit.posterior(fit.power_law(runs, "AW", ["V", "t"]))
    ratio = post.jackknife() / pd.Series(post.draws.std(axis=0), index=list(post.names))
    assert ratio["t"] > 2
    calm = fit.posterior(bundled_law())
    ratio = calm.jackknife() / pd.Series(calm.draws.std(axis=0), index=list(calm.names))
    assert ratio[CONDITIONS].between(0.6, 1.5).all()


# What cannot be


@pytest.mark.parametrize(
    ("rows", "edges", "words"),
    [(3, None, "fix 3 parameters exactly"), (12, None, "fits every row exactly")],
    ids=["as many rows as parameters", "a perfect fit"],
)
def test_what_has_no_posterior_is_said(rows, edges, words):
    V, f = np.linspace(50, 200, rows), 0.1 + 0.3 * np.linspace(0, 1, rows) ** 2
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": f, "AW": 0.001 * V * f**0.5}))
    with pytest.raises(errors.FitError, match=words) as error:
        fit.posterior(fit.power_law(runs, "AW", ["V", "f"]))
    assert "\n" not in str(error.value)


def small(rows, edges, seed=2):
    rng = np.random.default_rng(seed)
    V, t = np.exp(rng.uniform(4, 5, rows)), rng.uniform(2, 20, rows)
    label = [f"e{i * edges // rows}" for i in range(rows)]
    V = np.array([V[label.index(name)] for name in label]) if edges > 1 else V
    AW = 0.001 * V * t**0.3 * np.exp(rng.normal(0, 0.1, rows))
    return fit.power_law(
        datasets.runs_from_frame(pd.DataFrame({"V": V, "t": t, "AW": AW, "edge": label})), "AW", ["V", "t"]
    )


@pytest.mark.parametrize(("rows", "edges"), [(8, 8), (8, 2), (8, 4), (12, 1), (4, 4)])
def test_few_rows_and_few_edges_still_have_an_honest_posterior(rows, edges):
    post = fit.posterior(small(rows, edges))
    assert post.convergence.passed, post.convergence.reasons
    table = post.table()
    assert np.isfinite(table.to_numpy()).all()
    assert table.loc["V", "sd"] < 2.1  # never wider than the prior
    if edges == 1:
        assert any("one edge only" in note for note in post.notes)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"draws": 10}, "10 draws: at least 1000"),
        ({"draws": 10**9}, "at most 1000000"),
        ({"errors": "cauchy"}, "'normal' or 'student'"),
        ({"method": "gibbs"}, "give 'exact', 'importance' or 'emcee', or None"),
        ({"method": "exact", "errors": "student"}, "no exact draws"),
        ({"seed": -1}, "seed -1"),
    ],
)
def test_options_that_there_are_not(options, words):
    with pytest.raises(UsageError, match=words):
        fit.posterior(bundled_law(), **options)


# Calibration: a short form of benchmarks/calibration.py (Talts et al. 2018, arXiv 1804.06788)


def test_ranks_of_the_truth_among_exact_draws_are_uniform():
    from scipy.stats import chi2

    rng = np.random.default_rng(11)
    priors = Priors(
        {"level": Normal(-1.6, 0.3), "V": Normal(0.6, 0.4), "sd": HalfT(8.0, 0.15), "icc": Beta(2.0, 2.0)}, "p"
    )
    sets, bins, ranks = 200, 10, []
    names = np.repeat([f"e{i}" for i in range(8)], 4)
    for seed in range(sets):
        true = {name: float(prior.draw(rng, 1)[0]) for name, prior in priors.of.items()}
        V = np.repeat(np.exp(rng.uniform(4, 5, 8)), 4)
        between = true["sd"] * np.sqrt(true["icc"] / (1 - true["icc"]))
        ln = true["level"] + true["V"] * (np.log(V) - np.log(V).mean()) + np.repeat(rng.normal(0, between, 8), 4)
        frame = pd.DataFrame({"V": V, "AW": np.exp(ln + rng.normal(0, true["sd"], 32)), "edge": names})
        post = fit.posterior(
            fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V"]),
            seed=seed,
            priors=priors,
            draws=1000,
        )
        ranks.append([(post.draws[:99, j] < true[name]).sum() for j, name in ((1, "V"), (2, "sd"), (3, "icc"))])
    counts = np.apply_along_axis(lambda r: np.bincount(r * bins // 100, minlength=bins), 0, np.array(ranks))
    p = chi2(bins - 1).sf(((counts - sets / bins) ** 2 / (sets / bins)).sum(axis=0))
    assert (p > 0.003).all(), p
