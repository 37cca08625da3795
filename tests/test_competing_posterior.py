"""Rival forms drawn: densities against a dense multivariate normal (scipy), and the true form preferred."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import UsageError
from fitmodels.fit.bayes.competing_densities import edge_slopes, wear_contribution
from fitmodels.fit.bayes.competing_posterior import posterior_of_form
from fitmodels.fit.bayes.convergence import compare_draws
from fitmodels.fit.bayes.ensemble_sampler import chains
from fitmodels.fit.bayes.exact_draws import exact
from fitmodels.fit.checks.competing_forms import alternative_forms, rows_of
from scipy.stats import multivariate_normal

pytestmark = pytest.mark.slow

FORMS = [
    "exponential in wear",
    "additive in wear",
    "an exponent of t per edge",
    "second order in logs",
    "straight line in wear",
]


def cut(form="power law", *, seed=0, edges=24, per_edge=6, level=0.03, noise=0.04, named=True):
    """24 edges, 6 rows each; wear of its own law, power by one of the forms."""
    rng = np.random.default_rng(seed)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(2.0 * np.arange(1, per_edge + 1), edges)
    V, f = (np.exp(rng.uniform(-0.7, 0.7, edges))[at] * middle for middle in (100, 0.2))
    AW = 7.62e-3 * V**0.577 * f**0.168 * t**0.445 * np.exp(0.25 * rng.normal(size=len(t)))
    P = 0.14 * V**0.82 * f**0.627
    u = 0.3 * rng.normal(size=edges)[at] if form == FORMS[2] else 0.0
    P = {
        "power law": P * AW**0.35,
        FORMS[0]: P * np.exp(3 * AW),
        FORMS[1]: P + 12 * AW,
        FORMS[4]: P * (1 + 8 * AW),
        FORMS[2]: P * AW**0.2 * t**u,
        FORMS[3]: P * np.exp(0.3 * np.log(V / 100) ** 2 + 0.4 * np.log(V / 100) * np.log(f / 0.2)),
    }[form]
    P = P * np.exp(level * rng.normal(size=edges)[at] + noise * rng.normal(size=len(t)))
    frame = pd.DataFrame({"edge": [f"E{g:02}" for g in at], "V": V, "f": f, "t": t, "AW": AW, "P": P})
    return datasets.runs_from_frame(frame, edge=None if named else "none")


def law_of(*args, error="multiplicative", **kwargs):
    return fit.power_law(cut(*args, **kwargs), "P", ["V", "f", "t", "AW"], error=error)


def added(law, edges=True, kind=FORMS[1]):
    form = next(form for form in alternative_forms(law) if form.kind == kind)
    return wear_contribution(law, form.fitted(rows_of(law)), edges)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
@pytest.mark.parametrize("named", [True, False], ids=["edges", "rows"])
@pytest.mark.parametrize("kind", [FORMS[1], FORMS[4]])
def test_a_contribution_of_wear_has_the_density_of_its_formula(error, named, kind):
    law = law_of(kind, edges=6, named=named, error=error)
    density = added(law, named, kind)
    phi = density.start + 0.1 * np.random.default_rng(1).normal(size=(2, len(density.start)))
    got = density.by_unit(phi)
    reported = pd.DataFrame(density.parameters(phi), columns=density.parameter_names)
    names = law.edge if named else np.arange(law.nobs).astype(str)
    V, f, t, AW = law.X.T
    for m, of in reported.iterrows():
        mean = np.exp(of["ln c0"]) * V ** of["V"] * f ** of["f"] * t ** of["t"]
        mean = mean + of["k"] * AW if kind == FORMS[1] else mean * (1 + of["k"] * AW)
        r = law.observed - mean if error == "additive" else np.log(law.observed / mean)
        between = of["sd"] ** 2 * of["icc"] / (1 - of["icc"]) if named else 0.0
        for g, name in enumerate(np.unique(names) if named else names):
            rows = names == name
            cov = np.full((rows.sum(),) * 2, between) + of["sd"] ** 2 * np.eye(rows.sum())
            assert got[m, g] == pytest.approx(multivariate_normal(np.zeros(rows.sum()), cov).logpdf(r[rows]), rel=1e-8)


def test_edges_with_exponents_of_their_own_have_the_density_of_random_slopes():
    law = law_of(FORMS[2], edges=5)
    density = edge_slopes(law)
    phi = density.start + 0.3 * np.random.default_rng(1).normal(size=(2, len(density.start)))
    got = density.by_unit(phi)
    Z = law.formula.design(law.X)
    x = Z[:, 3] - Z[:, 3].mean()
    for m, of in pd.DataFrame(density.parameters(phi), columns=density.parameter_names).iterrows():
        r = np.log(law.observed) - Z @ of.iloc[:5].to_numpy()
        sds = np.array([of["sd"] * np.sqrt(of["icc"] / (1 - of["icc"])), of["sd of u"]])
        D = np.outer(sds, sds) * np.array([[1, of["correlation"]], [of["correlation"], 1]])
        for g, name in enumerate(np.unique(law.edge)):
            rows = law.edge == name
            W = np.column_stack([np.ones(rows.sum()), x[rows]])
            cov = W @ D @ W.T + of["sd"] ** 2 * np.eye(rows.sum())
            assert got[m, g] == pytest.approx(multivariate_normal(np.zeros(rows.sum()), cov).logpdf(r[rows]), rel=1e-8)


@pytest.mark.parametrize("form", FORMS)
def test_the_true_form_is_preferred_and_its_draws_pass_the_gate(form):
    other_form = posterior_of_form(law_of(form, seed=1), form, draws=2000)
    assert other_form.convergence.passed, other_form.convergence.reasons
    assert other_form.better, other_form.words
    assert "it is preferred" in other_form.words
    assert other_form.difference == pytest.approx(other_form.leave_out.elpd - other_form.power.elpd, abs=1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_where_the_power_law_is_true_no_other_form_is_preferred(form):
    other_form = posterior_of_form(law_of(seed=2), form, draws=2000)
    assert not other_form.better, other_form.words
    assert "the power law is kept" in other_form.words


def test_the_truth_of_added_wear_is_recovered():
    """Made with k 12, V .82, f .627; one interval in twenty may miss."""
    table = posterior_of_form(law_of(FORMS[1], seed=3)).table(0.99)
    truth = {"ln c0": np.log(0.14), "V": 0.82, "f": 0.627, "t": 0.0, "k": 12.0, "sd": 0.04}
    for name, value in truth.items():
        assert table.loc[name, "low"] < value < table.loc[name, "high"], name


def test_in_natural_units_both_forms_have_errors_that_add():
    other_form = posterior_of_form(law_of(FORMS[1], seed=4, error="additive"), draws=1000)
    assert other_form.density.natural
    assert other_form.sample.method == "importance"
    assert other_form.better


def test_forms_linear_in_logarithms_are_drawn_exactly_as_chains_would():
    other_form = posterior_of_form(law_of(seed=5), FORMS[0])
    assert other_form.sample.method == "exact"
    chain = chains(other_form.density, 3)
    parameters = other_form.density.parameters(chain.phi)
    found = compare_draws((other_form.draws, 1), (parameters, chain.chains), other_form.names)
    assert found.agrees, found.words


def test_left_out_edges_are_predicted_as_if_never_seen():
    """Against drawing the form again without each edge in turn, rows of the law fitted anew to the others."""
    law = law_of(seed=6, edges=10)
    other_form = posterior_of_form(law, FORMS[0], draws=4000)
    for g, name in enumerate(other_form.density.units):
        rows = law.edge != name
        order = np.argsort(law.edge.astype(str), kind="stable")
        keep = rows[order]
        sizes = other_form.density.sizes[:-1]
        without = replace(
            other_form.density,
            Z=other_form.density.Z[keep],
            y=other_form.density.y[keep],
            starts=np.arange(9) * 6,
            sizes=sizes,
            labels=other_form.density.labels[:-1],
        )
        phi = exact(without, np.random.default_rng(g), 20000).phi
        seen = other_form.density.by_unit(phi)[:, g]
        expected = np.logaddexp.reduce(seen) - np.log(len(seen))
        assert other_form.leave_out.pointwise[g] == pytest.approx(expected, abs=0.25)


def test_same_seed_same_draws():
    law = law_of(FORMS[1], edges=10)
    one, two = (posterior_of_form(law, draws=800) for _ in range(2))
    assert np.array_equal(one.draws, two.draws)
    assert one.difference == two.difference


def test_what_cannot_be_had_says_why():
    wear = fit.power_law(cut(), "AW", ["V", "f", "t"])
    assert "no wear among the factors" in str(posterior_of_form(wear, FORMS[1]))
    rows = law_of(named=False)
    assert "several rows per edge" in str(posterior_of_form(rows, FORMS[2]))
    assert "of the form exponential" in str(posterior_of_form(fit.exponential_law(cut(), "P", "AW")))
    with pytest.raises(UsageError, match="it is one of exponential in wear"):
        posterior_of_form(wear, "cubic")
