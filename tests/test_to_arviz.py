"""Posteriors in ArviZ, of whichever line is installed: it tells of them what is reported here."""

import json
import sys
import warnings

import numpy as np
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import UsageError
from fitmodels.core.version import __version__

pytestmark = pytest.mark.slow

SAME = 1e-10
DRAWS = 2500  # a whole tail, 3 sqrt(2500), so that both lines of ArviZ smooth as many weights
MODELS = {
    "levels of edges": ({}, {}),
    "independent rows": ({"edge": None}, {}),
    "chains": ({}, {"method": "emcee"}),
    "Student errors": ({}, {"errors": "student"}),
}


@pytest.fixture(scope="module")
def az():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # once a day 0.23 announces the next line
        return pytest.importorskip("arviz", reason="no ArviZ here: pip install 'fitmodels[arviz]'")


@pytest.fixture(scope="module", params=list(MODELS))
def post(request):
    of_law, of_posterior = MODELS[request.param]
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"], **of_law)
    return fit.posterior(law, draws=DRAWS, **of_posterior)


def tolerance(post, exactly, with_copies):
    """Of draws of which none is a copy, and of others.

    ArviZ leaves copies of the last weight out of the tail that it smooths, and 0.23 a copy that is the quantile out of
    those below it, by rounding.
    """
    return with_copies if len(np.unique(post.draws[:, 0])) < len(post.draws) else exactly


def by_name(data, names):
    return [float(data[name]) for name in names]


def test_draws_stay_in_their_chains(az, post):
    draws = post.to_arviz()["posterior"]
    assert draws["V"].dims == ("chain", "draw")
    assert draws["V"].shape == (post.diagnostics.chains, post.diagnostics.length)
    assert post.sample.chains in (1, post.diagnostics.chains)
    for j, name in enumerate(post.names):
        assert np.array_equal(draws[name].values.ravel(), post.draws[: draws[name].size, j])


def test_arviz_finds_the_same_diagnostics(az, post):
    data = post.to_arviz()
    table = post.table()
    assert by_name(az.rhat(data), post.names) == pytest.approx(table["r_hat"].to_list(), rel=SAME)
    assert by_name(az.ess(data, method="bulk"), post.names) == pytest.approx(table["ess_bulk"].to_list(), rel=SAME)
    tail = az.ess(data, method="tail", prob=(0.05, 0.95))
    assert by_name(tail, post.names) == pytest.approx(table["ess_tail"].to_list(), rel=tolerance(post, SAME, 0.02))


def test_its_summary_is_the_same(az, post):
    reported, table = az.summary(post.to_arviz()), post.table()
    assert list(reported.index) == list(post.names)
    assert np.abs(reported["mean"].astype(float) - table["mean"]).max() <= 0.05 * table["sd"].max()
    assert reported["sd"].astype(float).to_numpy() == pytest.approx(table["sd"].to_numpy(), rel=0.05, abs=6e-4)


def test_it_leaves_the_same_edges_out(az, post):
    """The standard error of 0.23 divides by the number of edges, that of the paper and of 1 by one less."""
    ours = post.leave_out()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it warns of k-hats above 0.7
        loo = az.loo(post.to_arviz(), pointwise=True, reff=1.0)
    G, old = len(ours.units), az.__version__.startswith("0.")
    elpd, p, pointwise = (loo.elpd_loo, loo.p_loo, loo.loo_i) if old else (loo.elpd, loo.p, loo.elpd_i)
    near = tolerance(post, 1e-8, 2e-3)  # nats
    assert float(elpd) == pytest.approx(ours.elpd, abs=near)
    assert float(p) == pytest.approx(ours.p_eff, abs=near)
    assert float(loo.se) == pytest.approx(ours.se * (np.sqrt((G - 1) / G) if old else 1), abs=near)
    assert np.abs(np.asarray(pointwise) - ours.pointwise).max() < near
    assert np.abs(np.asarray(loo.pareto_k) - ours.k_hat).max() < tolerance(post, 1e-8, 0.02)


def test_likelihoods_are_of_edges_and_rows_of_rows(az, post):
    data = post.to_arviz()
    unit = "edge" if post.density.edges else "row"
    likelihood = data["log_likelihood"]["AW"]
    assert likelihood.dims == ("chain", "draw", unit)
    assert tuple(likelihood[unit].values) == post.density.units
    seen = data["observed_data"]
    assert seen["AW"].values.tolist() == post.law.observed.tolist()
    assert np.array_equal(np.column_stack([seen[name] for name in post.law.factors]), post.law.X)
    assert seen["V"].attrs["units"] == "m/min"
    assert seen["row"].values[0] == f"line {post.law.lines[0]}"
    if post.law.edge is not None:
        assert seen["edge"].values.tolist() == post.law.edge.tolist()
        assert set(seen["edge"].values) == set(likelihood["edge"].values)


def test_it_says_where_it_comes_from(az, post):
    attrs = post.to_arviz()["posterior"].attrs
    assert (attrs["inference_library"], attrs["inference_library_version"]) == ("fitmodels", __version__)
    assert (attrs["method"], attrs["seed"], attrs["errors"]) == (post.method, 1, post.errors)
    assert all(isinstance(value, str | int) for value in attrs.values())  # what a file can hold
    priors = json.loads(attrs["priors"])
    assert priors["name"] == "weak"
    assert priors["V"] == {"distribution": "normal", "mean": 0.0, "sd": 2.0, "unit": "1"}


def test_it_is_what_this_line_of_arviz_works_with(az, post):
    import xarray

    kind = az.InferenceData if az.__version__.startswith("0.") else xarray.DataTree
    assert isinstance(post.to_arviz(), kind)


def test_likelihoods_too_many_to_keep_are_left_out(az, post, monkeypatch):
    monkeypatch.setattr("fitmodels.fit.bayes.arviz_export.MOST", 1000)
    data = post.to_arviz()
    groups = data.groups() if callable(data.groups) else data.groups
    assert {name.strip("/") for name in groups} - {""} == {"posterior", "observed_data"}


def test_without_arviz_the_way_to_get_it_is_reported(monkeypatch):
    law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(UsageError, match=r"install it by pip install 'fitmodels\[arviz\]'\.$"):
        fit.posterior(law, draws=1000).to_arviz()
