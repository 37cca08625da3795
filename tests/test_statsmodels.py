"""A law as a results object of statsmodels 0.15, and the comparison of both.

Reference: statsmodels' OLS with ``cov_type="cluster-crv3"`` and its mixed linear model, computed in the test.
"""

import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import FitError
from fitmodels.fit.statsmodels_ols import TOLERANCE, compare_statsmodels

pytestmark = pytest.mark.slow

FACTORS = ["V", "f", "d", "t"]


@pytest.fixture(scope="module")
def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@pytest.fixture(scope="module")
def law(runs):
    return fit.power_law(runs, "AW", FACTORS)


def test_a_law_by_edge_is_ols_with_crv3_and_t_quantiles(law):
    results = law.to_statsmodels()
    assert results.model.formula == "np.log(AW) ~ np.log(V) + np.log(f) + np.log(d) + np.log(t)"
    assert (results.cov_type, results.use_t) == ("cluster-crv3", True)
    np.testing.assert_allclose(results.params, law.theta, rtol=1e-10)
    np.testing.assert_allclose(results.bse, np.sqrt(np.diag(law.covariance())), rtol=1e-8)
    ours = law.conf_int().loc[["V", "f", "d", "t"]].to_numpy()
    np.testing.assert_allclose(results.conf_int().to_numpy()[1:], ours, rtol=1e-8)
    np.testing.assert_allclose(results.pvalues.iloc[1:], law.pvalues.iloc[1:], rtol=1e-6)
    np.testing.assert_allclose(results.rsquared, law.rsquared, rtol=1e-12)


def test_anova_lm_and_prediction_of_statsmodels_apply(law):
    from statsmodels.stats.anova import anova_lm

    results = law.to_statsmodels()
    table = anova_lm(results, typ=2)
    np.testing.assert_allclose(table.loc["np.log(V)", "F"], law.tvalues["V"] ** 2, rtol=1e-7)
    new = pd.DataFrame({"V": [120.0], "f": [0.2], "d": [2.0], "t": [8.0]})
    np.testing.assert_allclose(np.exp(results.predict(new)), law.values(new), rtol=1e-10)


def test_without_edges_the_covariance_is_that_of_independent_rows(runs):
    law = fit.power_law(runs, "AW", FACTORS, edge=None)
    results = law.to_statsmodels()
    assert results.cov_type == "nonrobust"
    np.testing.assert_allclose(results.bse, np.sqrt(np.diag(law.covariance())), rtol=1e-9)
    np.testing.assert_allclose(results.fvalue, law.fvalue, rtol=1e-9)


def test_a_category_shifts_the_same_way(runs):
    frame = runs.data.assign(maker=np.where(np.arange(len(runs)) % 3 == 0, "A b", "C"))
    law = fit.power_law(datasets.runs_from_frame(frame), "AW", FACTORS, by="maker")
    results = law.to_statsmodels()
    np.testing.assert_allclose(np.sort(results.params), np.sort(law.theta), rtol=1e-9)
    assert compare_statsmodels(law).agrees


def test_lines_and_exponentials_are_ols_too():
    roughness = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    assert roughness.to_statsmodels().model.formula == "np.log(Ra) ~ F"
    assert compare_statsmodels(roughness).agrees
    line = fit.load_law(datasets.read_runs(datasets.bundled("clm2023_slot_milling")))
    assert line.to_statsmodels().model.formula == "fm ~ VB"
    assert compare_statsmodels(line).agrees


def test_a_nonlinear_law_is_refused_by_name(runs):
    law = fit.power_law(runs, "AW", FACTORS, error="additive")
    with pytest.raises(
        FitError, match=r"AW: the power law with error='additive' is nonlinear .* error='multiplicative'"
    ):
        law.to_statsmodels()
    compared = compare_statsmodels(law)
    assert not compared.differences
    assert "not compared: AW: the power law with error='additive'" in compared.sentence


@pytest.mark.parametrize("response", ["AW", "P", "Fxz"])
def test_coefficients_standard_errors_and_variance_components_agree(runs, response):
    laws, _ = fit.default_laws(runs)
    compared = compare_statsmodels(next(law for law in laws if law.response == response))
    assert set(compared.differences) == {"coefficients", "standard errors by edge", "variance components"}
    assert compared.largest < 1e-7
    assert compared.agrees


def test_real_laws_agree(measurements):
    for pair in datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv").pairs():
        for law in fit.default_laws(pair)[0]:
            assert compare_statsmodels(law).largest < 1e-6


@pytest.mark.parametrize("what", ["theta", "edges"])
def test_a_wrong_number_is_found(law, what):
    """A coefficient, or the covariance by edge, off by three parts in a million."""
    if what == "theta":
        wrong = dataclasses.replace(law, theta=law.theta * (1 + 3 * TOLERANCE))
    else:
        edges = dataclasses.replace(law.edges, cov_theta=law.edges.cov_theta * (1 + 6 * TOLERANCE))
        wrong = dataclasses.replace(law, edges=edges)
    compared = compare_statsmodels(wrong)
    assert not compared.agrees
    assert compared.largest > 2 * TOLERANCE


def test_statsmodels_is_not_imported_by_the_main_job(tmp_path):
    code = (
        "import sys; from fitmodels.cli import main; "
        f"code = main([{str(datasets.bundled('ac2017_table1'))!r}, '--json']); "
        "sys.exit(99 if 'statsmodels' in sys.modules else code)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=False).returncode == 0


def test_verify_prints_the_comparison_and_ends_with_0(tmp_path, monkeypatch, capsys):
    from fitmodels.cli import main

    monkeypatch.chdir(tmp_path)
    assert main([str(datasets.bundled("ac2017_table2")), "--verify", "--draws", "1000", "--full"]) == 0
    printed = capsys.readouterr().out
    assert "Comparison with statsmodels" in printed
    assert "limit 1e-06" in printed
    assert re.search(r"AW +coefficients +\d\.\de-1\d", printed)
    assert "AW: variance components not compared: no edge column" in printed


def test_verify_writes_nothing_and_ends_with_5_where_the_programs_differ(tmp_path, monkeypatch, capsys):
    from fitmodels.cli import main
    from fitmodels.fit import statsmodels_ols

    monkeypatch.chdir(tmp_path)
    true = statsmodels_ols.compare_statsmodels

    def shifted(law):
        return true(dataclasses.replace(law, theta=law.theta * (1 + 3 * TOLERANCE)))

    monkeypatch.setattr(statsmodels_ols, "compare_statsmodels", shifted)
    assert main([str(datasets.bundled("ac2017_table2")), "--verify", "--draws", "1000"]) == 5
    assert "differ from statsmodels: AW against statsmodels" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert main([str(datasets.bundled("ac2017_table2")), "--draws", "1000", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["pairs"][0]["statsmodels"] == []


@pytest.mark.parametrize("levels", [("nan", "x"), ("a'b", 'c"d'), ("é [x]", "b\\n")], ids=["nan", "quotes", "brackets"])
def test_any_name_of_a_level_is_compared(runs, levels):
    frame = runs.data.assign(maker=np.where(np.arange(len(runs)) % 3 == 0, *levels))
    compared = compare_statsmodels(fit.power_law(datasets.runs_from_frame(frame), "AW", FACTORS, by="maker"))
    assert compared.agrees
    assert len(compared.differences) == 3


def test_exact_laws_and_two_rows_raise_no_alarm(runs):
    """Residuals of rounding errors have no digits to compare; that is reported, and the coefficients are compared."""
    exact = runs.data.assign(AW=0.01 * runs.data.V**0.5 * runs.data.f**0.2)
    few = runs.data[runs.labels("edge") == "E02"].head(2)
    for frame, factors, reason in ((exact, ["V", "f"], "rounding errors"), (few, ["t"], "fix 2 parameters exactly")):
        compared = compare_statsmodels(fit.power_law(datasets.runs_from_frame(frame), "AW", factors))
        assert compared.agrees
        assert set(compared.differences) == {"coefficients"}
        assert reason in compared.sentence


def test_a_failure_of_statsmodels_is_reported(law, monkeypatch):
    from fitmodels.fit import statsmodels_ols

    def fails(_):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(statsmodels_ols, "ols_results", fails)
    compared = compare_statsmodels(law)
    assert not compared.differences
    assert "statsmodels failed: LinAlgError: SVD did not converge" in compared.sentence
