"""Rival forms by edges left out, and the test of a common time exponent.

References: refits without each edge by statsmodels and scipy, statsmodels' F of nested models and its MixedLM; the
figures of the README of the NASA milling data (A. Agogino and K. Goebel, BEST lab, 2007).
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import analyse, datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.fit.checks import competing_models
from fitmodels.fit.checks.competing_forms import FittedForm, Form, alternative_forms, rows_of
from fitmodels.fit.checks.competing_models import compare_forms
from fitmodels.fit.checks.time_exponent import common_exponent, slope_spread
from fitmodels.fit.left_out_edges import compare_laws
from scipy.optimize import curve_fit
from statsmodels.regression.linear_model import OLS
from statsmodels.regression.mixed_linear_model import MixedLM

EXACT = 1e-8
ALONG_THE_GRADIENT = 0.02  # leaving out to first order against a nonlinear refit
POWELL = 5e-3  # of a variance, with a flat optimum


def bundled(response="P", factors=("V", "f", "d", "t", "AW")):
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), response, list(factors))


def cut(force, *, edges=20, per_edge=6, noise=0.03, seed=1, named=True):
    """Edges with a wear of their own rate, and a force that ``force(V, AW)`` gives."""
    rng = np.random.default_rng(seed)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(np.arange(1.0, per_edge + 1), edges)
    V = np.exp(rng.uniform(np.log(50), np.log(200), edges))[at]
    AW = 0.05 * np.exp(rng.normal(0, 0.4, edges))[at] * t**0.7
    F = force(V, AW) * np.exp(noise * rng.normal(size=len(t)))
    frame = pd.DataFrame({"edge": [f"E{g}" for g in at], "V": V, "t": t, "AW": AW, "F": F})
    return (
        datasets.runs_from_frame(frame) if named else datasets.runs_from_frame(frame.drop(columns="edge"), edge="none")
    )


def test_left_out_errors_are_those_of_refits():
    law = bundled()
    forms = compare_forms(law)
    Z, y = law.formula.design(law.X), np.log(law.observed)
    columns = {"power law": Z, "exponential in AW": np.column_stack([Z[:, :5], law.X[:, 4]])}
    for form in (forms.power, *forms.alternatives):
        if form.name not in columns:
            continue
        X, missed = columns[form.name], np.empty(len(y))
        for name in set(law.edge):
            out = law.edge == name
            missed[out] = y[out] - X[out] @ OLS(y[~out], X[~out]).fit().params
        assert form.error == pytest.approx(np.sqrt(np.mean(missed**2)), rel=EXACT)


def test_the_additive_form_against_scipys_refits():
    law = fit.power_law(cut(lambda V, AW: 20 * V**0.5 + 900 * AW), "F", ["V", "AW"])
    form = next(form for form in compare_forms(law).alternatives if form.name == "additive in AW")

    def ln_force(x, a, b, k):
        return np.log(np.exp(a) * x[0] ** b + k * x[1])

    X, y = law.X.T, np.log(law.observed)
    whole = curve_fit(ln_force, X, y, p0=[3, 0.5, 800])[0]
    np.testing.assert_allclose([form.coefficients[name] for name in ("ln c0", "V", "k")], whole, rtol=1e-4)
    missed = np.empty(len(y))
    for name in set(law.edge):
        out = law.edge == name
        missed[out] = y[out] - ln_force(X[:, out], *curve_fit(ln_force, X[:, ~out], y[~out], p0=whole)[0])
    assert form.error == pytest.approx(np.sqrt(np.mean(missed**2)), rel=ALONG_THE_GRADIENT)


@pytest.mark.parametrize(
    ("force", "chosen"),
    [
        (lambda V, AW: 20 * V**0.5 * AW**0.3, "power law"),
        (lambda V, AW: 20 * V**0.5 * np.exp(3 * AW), "exponential in AW"),
        (lambda V, AW: 20 * V**0.5 + 900 * AW, "additive in AW"),
        (lambda V, AW: 20 * V**0.5 * (1 + 6 * AW), "straight line in AW"),
        (lambda V, AW: 20 * V**0.5 * AW**0.3 * np.exp(0.5 * np.log(V / 100) ** 2), "second order in logs"),
    ],
)
def test_the_true_form_is_chosen(force, chosen):
    forms = compare_forms(fit.power_law(cut(force), "F", ["V", "AW"]))
    assert forms.chosen.name == chosen
    assert forms.concern == int(chosen != "power law")
    assert ("the power law is kept" if chosen == "power law" else f"{chosen} is preferred") in forms.verdict


def test_the_standard_error_of_equal_edges_is_that_of_their_means():
    forms = compare_forms(fit.power_law(cut(lambda V, AW: 20 * V**0.5 * np.exp(3 * AW)), "F", ["V", "AW"]))
    law = fit.power_law(cut(lambda V, AW: 20 * V**0.5 * np.exp(3 * AW)), "F", ["V", "AW"])
    y, Z = np.log(law.observed), law.formula.design(law.X)
    X = np.column_stack([Z[:, :2], law.X[:, 1]])
    squares, c = np.empty((2, len(y))), law.edges.icc
    for name in set(law.edge):
        out = law.edge == name
        m = out.sum()
        covariance = np.eye(m) + c / (1 - c) * np.ones((m, m))  # of the rows of an edge with a level of its own
        values, vectors = np.linalg.eigh(np.linalg.inv(covariance))
        root = vectors @ np.diag(np.sqrt(values)) @ vectors.T
        for i, A in enumerate((Z, X)):
            squares[i, out] = (root @ (y[out] - A[out] @ OLS(y[~out], A[~out]).fit().params)) ** 2
    by_edge = pd.Series(squares[1] - squares[0]).groupby(law.edge).mean()
    form = next(form for form in forms.alternatives if form.name == "exponential in AW")
    own, power = np.sqrt(squares[1].mean()), np.sqrt(squares[0].mean())
    assert form.difference == pytest.approx(own - power, rel=1e-6)
    assert form.standard_error * (own + power) == pytest.approx(by_edge.sem(), rel=1e-6)


def test_forms_differ_within_edges_whose_levels_scatter():
    """Additive wear, edges with levels of sd .1 and rows of sd .03: the levels hide the form from unweighted errors."""
    rng = np.random.default_rng(7)
    chosen = []
    for seed in range(6):
        frame = cut(lambda V, AW: 20 * V**0.5 + 900 * AW, edges=24, seed=seed).data
        frame["F"] *= np.exp(0.1 * rng.normal(size=24))[frame["edge"].str[1:].astype(int)]
        chosen.append(compare_forms(fit.power_law(datasets.runs_from_frame(frame), "F", ["V", "AW"])).chosen.name)
    assert chosen.count("power law") <= 1
    assert chosen.count("additive in AW") >= 4


def test_rows_are_left_out_where_there_are_no_edges_or_one():
    nameless = compare_forms(fit.power_law(cut(lambda V, AW: V * AW**0.2, named=False), "F", ["V", "AW"]))
    assert (nameless.unit, nameless.units) == ("row", 120)
    lone = compare_forms(fit.power_law(cut(lambda V, AW: V * AW**0.2, edges=1, per_edge=12), "F", ["AW"]))
    assert (lone.unit, lone.units) == ("row", 12)
    law = fit.power_law(cut(lambda V, AW: V * AW**0.2, named=False), "F", ["V", "AW"])
    reference = OLS(np.log(law.observed), law.formula.design(law.X)).fit().get_influence().resid_press
    assert nameless.power.error == pytest.approx(np.sqrt(np.mean(reference**2)), rel=EXACT)


def test_what_cannot_be_fitted_says_why():
    reasons = dict(compare_forms(bundled("AW", ("V", "f", "d", "t"))).not_fitted)
    assert "no wear among the factors V, f, d, t" in str(reasons["exponential in wear"])
    assert "no wear" in str(reasons["additive in wear"])
    assert "a common time exponent of 24 edges is kept" in str(reasons["an exponent of t per edge"])
    falling = compare_forms(fit.power_law(cut(lambda V, AW: V * AW**-0.3), "F", ["V", "AW"]))
    assert "has no additive contribution of AW" in str(dict(falling.not_fitted)["additive in AW"])
    assert "no time t" in str(falling.common_exponent)


def three_stages(last=0.8):
    """18 edges whose wear runs in, grows steadily and accelerates, read every 3 min up to a wear in mm."""
    rng, rows = np.random.default_rng(2), []
    for edge, (V, f, d) in enumerate((V, f, d) for V in (140, 180, 230) for f in (0.12, 0.2, 0.3) for d in (1, 2)):
        level = rng.normal(0, 0.08)
        for t in range(2, 40, 3):
            s = (V / 180) ** 2 * (f / 0.2) ** 0.5 * (d / 1.5) ** 0.2 * t / 15
            wear = 0.08 * (1 - np.exp(-s / 0.08)) + 0.16 * s + 1.2 * max(0, s - 0.75) ** 2
            rows.append((edge + 1, V, f, d, t, wear := round(wear * np.exp(level + rng.normal(0, 0.05)), 3)))
            if wear >= last:
                break
    return datasets.runs_from_frame(pd.DataFrame(rows, columns=["edge", "V", "f", "d", "t", "VB"]))


def test_no_form_is_proposed_whose_law_may_not_be_used():
    """The remedy was a law of 0.07 to 16 mm of wear, which the program then refused."""
    runs = three_stages()
    law = fit.power_law(runs, "VB", ["V", "f", "d", "t"])
    assert "--form VB=second-order" in compare_forms(law, runs).verdict
    check = fit.judge(law, runs=runs).checks["competing forms"]
    assert check.concern == 1
    assert "in that form the law predicts VB of" in check.verdict
    assert "neither form holds over all of these tests" in check.verdict
    assert "--form" not in check.verdict
    found = compare_laws(runs, law, forms=["second-order"])
    assert (found.best.name, found.preferred.name) == ("second-order", "power")
    assert "power is kept" in found.verdict
    assert "this law is not to be used: The law predicts VB" in found.verdict


def test_readings_far_beyond_the_criterion_are_the_cause_where_wear_grows_faster_there():
    law = fit.power_law(three_stages(), "VB", ["V", "f", "d", "t"])
    words = fit.judge(law).checks["time within edges"].verdict
    assert "VB grows faster beyond the usual criterion of 0.3 mm, and 16 of 18 edges are read up to 1.4 mm" in words
    early = fit.power_law(three_stages(0.35), "VB", ["V", "f", "d", "t"])
    assert "grows faster beyond" not in str(fit.judge(early).checks["time within edges"])


def test_a_wear_law_without_a_tool_life_says_why(tmp_path, capsys):
    runs = three_stages().to_frame()
    runs.to_csv(tmp_path / "wear.csv", index=False)
    found = analyse(tmp_path / "wear.csv", form={"VB": "second-order"})
    reason = "needs a power law of wear on time"
    assert f"tool life {reason} t; VB is fitted in the form second-order" in found.pair.no_life
    parameters.write(found.parameters, tmp_path / "params.json")
    assert main(["predict", str(tmp_path / "params.json"), "T", "V=180"]) == 2
    assert reason in capsys.readouterr().err


def test_a_form_of_nearly_dependent_columns_costs_itself_only(monkeypatch):
    """Rounding leaves the inverse of some of these normal matrices without a Cholesky factor."""
    made = competing_models.alternative_forms

    def near(rows, seed):
        law = rows.law
        Z, y = law.formula.design(law.X), np.log(law.observed)
        apart = 1e-9 * np.random.default_rng(seed).normal(size=len(y)) if seed else 0.0
        columns = np.column_stack([Z, Z[:, 1] + apart])
        return FittedForm("near", "F", {}, columns, y - y.mean(), columns, y - y.mean())

    more = [Form("near", f"near {seed}", lambda rows, seed=seed: near(rows, seed)) for seed in range(12)]
    monkeypatch.setattr(competing_models, "alternative_forms", lambda law: (*made(law), *more))
    law = fit.power_law(cut(lambda V, AW: V * AW**0.2), "F", ["V", "AW"])
    found = fit.judge(law).checks["competing forms"]
    dependent = [name for name, reason in found.not_fitted if "nearly linearly dependent" in str(reason)]
    assert dependent[0] == "near 0"
    assert len(dependent) > 1
    assert {form.name for form in found.alternatives} >= {"exponential in AW"}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1"))),
            "this is of the form exponential",
        ),
        (lambda: fit.power_law(cut(lambda V, AW: V * AW, noise=0.0), "F", ["V", "AW"]), "fits every row exactly"),
        (
            lambda: fit.power_law(cut(lambda V, AW: V * AW, edges=3, per_edge=1, named=False), "F", ["V", "AW"]),
            "3 observations fix 3 parameters",
        ),
    ],
)
def test_reason_where_no_form_competes(make, words):
    assert words in str(compare_forms(make()))


def test_an_edge_that_alone_holds_a_parameter_is_said():
    runs = cut(lambda V, AW: V * AW**0.2, edges=8)
    frame = runs.data.copy()
    frame["V"] = np.where(frame["edge"] == "E5", 160.0, 80.0)
    law = fit.power_law(datasets.runs_from_frame(frame), "F", ["V", "AW"])
    assert "one edge alone determines" in str(compare_forms(law))


def test_the_common_exponent_is_the_f_of_nested_models():
    law = bundled()
    found = common_exponent(law)
    names, edge = np.unique(law.edge, return_inverse=True)
    y, D = np.log(law.observed), np.eye(len(names))[edge]
    t, AW = np.log(law.X[:, 3:4]), np.log(law.X[:, 4:5])
    full = OLS(y, np.hstack([D, D * t, AW])).fit()
    F, p, df = full.compare_f_test(OLS(y, np.hstack([D, t, AW])).fit())
    assert (found.statistic, found.pvalue) == pytest.approx((F, p), rel=1e-7)
    assert found.df == (int(df), int(full.df_resid))
    np.testing.assert_allclose(found.exponents, full.params[24:48], rtol=1e-6)
    assert found.concern == 0


@pytest.mark.filterwarnings("ignore::statsmodels.tools.sm_exceptions.ConvergenceWarning")
def test_the_spread_of_exponents_is_statsmodels_mixedlm():
    rng = np.random.default_rng(5)
    edge, time = np.repeat(np.arange(30), 6), np.tile(np.linspace(-1, 1, 6), 30)
    levels, slopes = rng.normal(0, 0.2, 30), rng.normal(0, 0.3, 30)
    y = 1 + levels[edge] + (0.5 + slopes[edge]) * time + rng.normal(0, 0.1, 180)
    Z = np.column_stack([np.ones(180), time])
    ours = slope_spread(Z, y, edge, time)
    reference = MixedLM(y, Z, edge, exog_re=Z).fit(reml=True, method="powell")
    np.testing.assert_allclose(np.diag(ours), np.diag(reference.cov_re) / reference.scale, rtol=POWELL)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda: fit.power_law(cut(lambda V, AW: V, named=False), "F", ["V", "t"]), "no edge column"),
        (lambda: fit.power_law(cut(lambda V, AW: V, edges=1, per_edge=9), "F", ["t"]), "come from one edge"),
        (lambda: fit.power_law(cut(lambda V, AW: V, per_edge=2), "F", ["V", "t"]), "at three times or more"),
        (lambda: fit.power_law(cut(lambda V, AW: V * AW, noise=0), "F", ["V", "t"]), "lie on its own line exactly"),
    ],
)
def test_no_exponent_test_says_why(law, words):
    assert words in str(common_exponent(law()))


def test_nasa_rejects_a_common_time_exponent(measurements):
    """README: case slopes F 9.9, p 1e-13; exponents .40 to 1.19."""
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    forms = compare_forms(fit.power_law(runs, "VB", ["t", "f", "d"], by="material"))
    test = forms.common_exponent
    assert test.statistic == pytest.approx(9.9, abs=0.05)
    assert test.df == (14, 107)
    assert test.pvalue == pytest.approx(1e-13, rel=0.1)
    assert (test.exponents.min(), test.exponents.max()) == pytest.approx((0.40, 1.19), abs=0.005)
    assert "A common time exponent is rejected (F(14, 107) = 9.85" in test.verdict
    assert forms.chosen.name == "power law"  # exponents of their own do not help an edge nobody has seen
    own = next(form for form in forms.alternatives if form.name == "an exponent of t per edge")
    assert own.coefficients["sd of u"] == pytest.approx(0.198, abs=0.001)
    second = next(form for form in forms.alternatives if form.name == "second order in logs")
    assert "f f" not in second.coefficients  # two feeds tell no square


def test_nasa_current_is_a_power_law_of_wear(measurements):
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    forms = compare_forms(fit.power_law(runs, "smcAC_mid_std", ["f", "d", "VB"], by="material"))
    for other in forms.alternatives:
        assert other.difference > -2 * other.standard_error
        if other.name in ("exponential in VB", "additive in VB"):
            assert other.difference > other.standard_error


def test_sums_of_squares_of_the_forms_of_nasas_unclipped_current(measurements):
    """Computed with two solvers: 97 rows of 13 edges, power law .7424, additive .8968, exponential 1.0708."""
    frame = pd.read_csv(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    frame = frame[frame["smcDC_rail_ratio"] < 0.01].rename(columns={"case": "edge", "time": "t", "DOC": "d"})
    runs = datasets.runs_from_frame(frame.rename(columns={"feed": "f", "smcDC_mid_mean": "current"}))
    law = fit.power_law(runs, "current", ["f", "d", "VB"], by="material")
    assert (law.nobs, law.n_edges, round(law.rss, 4)) == (97, 13, 0.7424)
    fitted = {form.name: form.fitted(rows_of(law)) for form in alternative_forms(law)}
    squares = {name: float(form.residuals @ form.residuals) for name, form in fitted.items() if hasattr(form, "Z")}
    assert squares["additive in VB"] == pytest.approx(0.8968, abs=5e-5)
    assert squares["exponential in VB"] == pytest.approx(1.0708, abs=5e-5)
    assert squares["offset in VB"] < 0.7424  # the power law is the offset 0
    found = compare_forms(law, runs)
    assert "9 rows at VB = 0, where a power of VB is zero, are predicted by the form" in found.verdict
    additive = next(model for model in found.alternatives if model.name == "additive in VB")
    assert additive.zero_wear.rows == 9
    assert additive.zero_wear.error < 0.1  # a new edge, from worn ones


def fresh(force, *, zero=True, **kwargs):
    """Edges whose first row is at zero wear."""
    frame = cut(force, **kwargs).data.copy()
    first = ~frame["edge"].duplicated()
    frame.loc[first, "AW"] = 0.0
    rng = np.random.default_rng(5)
    frame["F"] = force(frame["V"], frame["AW"]) * np.exp(0.03 * rng.normal(size=len(frame)))
    return datasets.runs_from_frame(frame if zero else frame[~first])


def test_rows_at_zero_wear_take_part_where_the_form_allows_it():
    """Truth 20 V^0.5 (1 + 6 AW): the comparison uses the rows of all forms, the rows at AW = 0 are predicted."""
    force = lambda V, AW: 20 * V**0.5 * (1 + 6 * AW)  # noqa: E731
    runs = fresh(force)
    law = fit.power_law(runs, "F", ["V", "AW"])
    assert law.nobs == 100
    found, worn = compare_forms(law, runs), compare_forms(fit.power_law(fresh(force, zero=False), "F", ["V", "AW"]))
    assert [model.error for model in found.alternatives] == pytest.approx([model.error for model in worn.alternatives])
    line = next(model for model in found.alternatives if model.name == "straight line in AW")
    assert line.zero_wear.rows == 20
    assert line.zero_wear.error < 0.05
    assert line.zero_wear.coefficients["k"] == pytest.approx(6, rel=0.1)
    assert line.coefficients["k"] == pytest.approx(6, rel=0.2)
    assert "20 rows at AW = 0" in found.verdict
    assert "by the form straight line in AW with an error of" in found.verdict
    second = next(model for model in found.alternatives if model.name == "second order in logs")
    assert second.zero_wear is None


def test_rows_at_zero_wear_and_zero_time_have_no_form():
    runs = fresh(lambda V, AW: 20 * V**0.5 * (1 + 6 * AW))
    frame = runs.data.copy()
    frame.loc[frame["AW"] == 0, "t"] = 0.0
    runs = datasets.runs_from_frame(frame)
    found = compare_forms(fit.power_law(runs, "F", ["V", "t", "AW"]), runs)
    assert "No form has the rows at AW = 0: t is zero in these rows as well." in found.verdict


def test_the_straight_line_and_the_offset_against_scipy():
    law = fit.power_law(cut(lambda V, AW: 20 * V**0.5 * (AW + 0.08) ** 0.8, noise=0.02), "F", ["V", "AW"])
    forms = {form.name: form.fitted(rows_of(law)).coefficients for form in alternative_forms(law) if form.zero_wear}
    X, y = law.X.T, np.log(law.observed)
    line = curve_fit(lambda x, a, b, k: a + b * np.log(x[0]) + np.log1p(k * x[1]), X, y, p0=[3, 0.5, 5])[0]
    np.testing.assert_allclose([forms["straight line in AW"][name] for name in ("ln c0", "V", "k")], line, rtol=1e-4)
    offset = curve_fit(
        lambda x, c0, b, e, a: c0 + b * np.log(x[0]) + e * np.log(x[1] + a), X, y, p0=[3, 0.5, 0.8, 0.1], xtol=1e-12
    )[0]
    np.testing.assert_allclose(
        [forms["offset in AW"][name] for name in ("ln c0", "V", "AW", "a")], offset, rtol=1e-3
    )  # flat optimum


def test_an_offset_of_wear_is_better_than_the_power_law():
    forms = compare_forms(fit.power_law(cut(lambda V, AW: 20 * V**0.5 * (AW + 0.08) ** 0.8), "F", ["V", "AW"]))
    assert next(form for form in forms.alternatives if form.name == "offset in AW").pvalue < 0.01


def test_an_offset_of_time_is_a_form_of_forces_only():
    frame = cut(lambda V, AW: 20 * V**0.5).data.copy()
    frame["Fc"] = frame["F"] * (frame["t"] + 2.5) ** 0.6
    law = fit.power_law(datasets.runs_from_frame(frame), "Fc", ["V", "t"])
    form = next(form for form in compare_forms(law).alternatives if form.name == "offset in t")
    assert form.difference < -form.standard_error
    assert form.coefficients["t0"] == pytest.approx(2.5, abs=0.8)
    assert "offset in t" not in [form.name for form in alternative_forms(bundled("AW", ("V", "f", "d", "t")))]


def test_limits_of_offsets_and_slopes_say_why():
    """No wear in the force: no slope; force proportional to wear: a slope without bound; a power law: no offset."""
    flat = dict(compare_forms(fit.power_law(cut(lambda V, AW: V * AW**-0.3), "F", ["V", "AW"])).not_fitted)
    assert "k is estimated as zero or without bound" in str(flat["straight line in AW"])
    steep = dict(compare_forms(fit.power_law(cut(lambda V, AW: V * AW**1.5), "F", ["V", "AW"])).not_fitted)
    assert "k is estimated as zero or without bound" in str(steep["straight line in AW"])
    curved = cut(lambda V, AW: V * np.exp(4 * AW))
    assert "at a limit" in str(dict(compare_forms(fit.power_law(curved, "F", ["V", "AW"])).not_fitted)["offset in AW"])
