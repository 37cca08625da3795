"""The edge bootstrap is a refit of drawn edges, and agrees with the jackknife."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit


def law(error="multiplicative", factors=("V", "f", "d", "t")):
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", list(factors), error=error)


def test_a_draw_is_the_refit_of_its_edges():
    """The same multinomial draw, refitted row by row."""
    whole = law()
    boot = fit.edge_bootstrap(whole, 5, seed=9)
    weights = np.random.default_rng(9).multinomial(24, np.full(24, 1 / 24), size=5)
    names = whole.edges.edges
    for drawn, theta in zip(weights, boot.draws, strict=True):
        rows = np.concatenate(
            [np.flatnonzero(whole.edge == e) for e, k in zip(names, drawn, strict=True) for _ in range(k)]
        )
        Z, y = whole.formula.design(whole.X[rows]), np.log(whole.observed[rows])
        np.testing.assert_allclose(theta, fit.linear(Z, y).params, rtol=1e-7)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_its_spread_is_near_the_jackknifes(error):
    """CR3 is known to be larger than the bootstrap by a few to thirty per cent with two dozen edges."""
    whole = law(error)
    ratio = fit.edge_bootstrap(whole, 2000).bse / np.sqrt(np.diag(whole.covariance()))
    assert ratio.between(0.6, 1.05).all()


def test_the_same_seed_gives_the_same_draws():
    one, again, other = (fit.edge_bootstrap(law(), 50, seed=s).draws for s in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_intervals_widen_with_the_level():
    boot = fit.edge_bootstrap(law(), 500)
    narrow, wide = boot.interval(0.5), boot.interval(0.95)
    assert (wide["low"] < narrow["low"]).all()
    assert (wide["high"] > narrow["high"]).all()


def test_without_edges_it_says_why():
    runs = datasets.runs_from_frame(pd.DataFrame({"V": [50.0, 80, 120, 200], "AW": [0.1, 0.12, 0.16, 0.2]}))
    assert "no edge column" in str(fit.edge_bootstrap(fit.power_law(runs, "AW", ["V"])))
