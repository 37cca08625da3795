"""Expected log density of left-out edges, against ArviZ and against a model where it is known."""

import warnings

import numpy as np
import pytest
from fitmodels.core.errors import FitError, UsageError
from fitmodels.fit.available import NotAvailable
from fitmodels.fit.bayes.psis_loo import leave_one_out
from scipy.stats import multivariate_normal

SAME = 1e-10
EDGES, ROWS = 12, 3


@pytest.fixture(scope="module")
def loo():
    """Pointwise elpd and k-hat, elpd, se and p_loo of log likelihoods (S, G), by the ArviZ that is installed."""
    try:
        from arviz_stats.base import array_stats as stats
    except ImportError:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # once a day 0.23 announces the next line
            az = pytest.importorskip("arviz")
        return lambda by_unit: _loo_of_0_23(az, by_unit)
    return lambda by_unit: _loo_of_1(stats, by_unit)


def _loo_of_0_23(az, by_unit):
    S, G = by_unit.shape
    data = az.from_dict(posterior={"x": np.zeros((1, S))}, log_likelihood={"y": by_unit[None]})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it warns of k-hats above 0.7
        result = az.loo(data, pointwise=True, reff=1.0)
    # its standard error divides by G, that of the paper (eq. 23) by G - 1
    return (
        result.loo_i.values,
        result.pareto_k.values,
        result.elpd_loo,
        result.se * np.sqrt(G / (G - 1)),
        result.p_loo,
    )


def _loo_of_1(stats, by_unit):
    import arviz_stats

    elpd, k, p = stats.loo(by_unit.T[:, None, :])
    whole, se, p_loo, _ = stats.loo_summary(elpd, p)
    if arviz_stats.__version__.startswith("0."):  # these, for Python 3.11, divide as 0.23 does
        se *= np.sqrt(len(elpd) / (len(elpd) - 1))
    return elpd, k, whole, se, p_loo


def edges_about_a_mean(S, seed=1, far=0.0):
    """Log likelihood (S, G) of edges of three rows about an unknown mean, sd 1 known, flat prior; and the rows."""
    rng = np.random.default_rng(seed)
    y = rng.normal(size=(EDGES, ROWS))
    y[0] += far
    mean = rng.normal(y.mean(), (EDGES * ROWS) ** -0.5, size=S)
    return (-((y - mean[:, None, None]) ** 2) / 2 - np.log(2 * np.pi) / 2).sum(axis=2), y


NAMES = tuple(f"E{i + 1}" for i in range(EDGES))


@pytest.mark.parametrize("far", [0.0, 6.0])
@pytest.mark.parametrize("S", [400, 2500, 10_000])  # whole tails, which both lines of ArviZ take alike
def test_equals_arviz(loo, S, far):
    by_unit, _ = edges_about_a_mean(S, far=far)
    result = leave_one_out(by_unit, NAMES)
    pointwise, k_hat, elpd, se, p_eff = loo(by_unit)
    assert np.abs(result.pointwise - pointwise).max() < SAME
    assert np.abs(result.k_hat - k_hat).max() < SAME
    assert result.elpd == pytest.approx(float(elpd), rel=SAME)
    assert result.se == pytest.approx(float(se), rel=SAME)
    assert result.p_eff == pytest.approx(float(p_eff), abs=1e-8)


def test_recovers_the_density_of_whole_edges_never_seen():
    """Without edge g the mean has a normal posterior, and the three rows of g are jointly normal."""
    by_unit, y = edges_about_a_mean(40_000)
    result = leave_one_out(by_unit, NAMES)
    rest = (EDGES - 1) * ROWS
    spread = np.eye(ROWS) + 1 / rest
    known = [
        multivariate_normal.logpdf(y[g], np.full(ROWS, np.delete(y, g, axis=0).mean()), spread) for g in range(EDGES)
    ]
    assert result.doubtful == ()
    assert np.abs(result.pointwise - known).max() < 0.01  # ten Monte Carlo standard errors
    assert result.elpd == pytest.approx(sum(known), abs=0.02)
    assert result.p_eff == pytest.approx(1, abs=0.4)
    assert result.words == f"LOO by edge: elpd {result.elpd:.1f} ± {result.se:.1f} over 12 edges, " + (
        f"effective parameters {result.p_eff:.1f}."
    )


def test_rows_taken_one_by_one_foretell_too_well_where_edges_have_levels():
    """An edge has a level: the row beside it tells it, a left-out edge does not."""
    rng = np.random.default_rng(1)
    level = rng.normal(size=(EDGES, 1))
    y = level + 0.1 * rng.normal(size=(EDGES, ROWS))
    draws = y.mean(axis=1) + 0.1 * ROWS**-0.5 * rng.normal(size=(4000, EDGES))  # of levels, each as its rows fix it
    by_row = -(((y - draws[:, :, None]) / 0.1) ** 2) / 2 - np.log(0.1 * np.sqrt(2 * np.pi))
    rows = leave_one_out(by_row.reshape(4000, -1), tuple(map(str, range(EDGES * ROWS))))
    edges = leave_one_out(by_row.sum(axis=2), NAMES)
    assert np.median(rows.k_hat) < 0.5  # a third, and of edges one, with draws without end
    assert len(edges.doubtful) > EDGES / 2


def test_an_edge_on_which_the_draws_lean_is_named():
    by_unit, _ = edges_about_a_mean(20_000, far=12.0)
    result = leave_one_out(by_unit, NAMES)
    assert result.doubtful == ("E1",)
    assert "Unreliable for E1 (k-hat up to" in result.words
    assert result.words.endswith("refit without it.")


def test_no_more_than_five_edges_are_named():
    rng = np.random.default_rng(1)
    result = leave_one_out(-(rng.standard_cauchy((1000, 8)) ** 2), tuple("abcdefgh"))
    assert len(result.doubtful) == 8
    assert "Unreliable for a, b, c, d, e and 3 more" in result.words


def test_one_edge_has_no_scatter_over_edges():
    result = leave_one_out(np.random.default_rng(1).normal(size=(400, 1)), ("E1",))
    assert isinstance(result.se, NotAvailable)
    assert "+-" not in result.words


def test_an_edge_without_information_is_left_out_without_doubt():
    by_unit, _ = edges_about_a_mean(400)
    by_unit[:, 4] = -2.5
    result = leave_one_out(by_unit, NAMES)
    assert result.k_hat[4] == -np.inf
    assert result.pointwise[4] == pytest.approx(-2.5)
    assert "E5" not in result.doubtful


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_log_likelihood_that_is_no_number_is_reported_with_its_edge(value):
    by_unit, _ = edges_about_a_mean(400)
    by_unit[5:8, 2] = value
    with pytest.raises(FitError, match=f"edge E3: log likelihood {value:g} at 3 of 400 draws"):
        leave_one_out(by_unit, NAMES)


def test_names_that_do_not_fit_are_refused():
    with pytest.raises(UsageError, match="12 edges and 11 names"):
        leave_one_out(edges_about_a_mean(400)[0], NAMES[1:])
