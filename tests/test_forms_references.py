"""Each form of law against a certified or published case, and against statsmodels, to 1e-6.

References: NIST's Statistical Reference Datasets (https://www.itl.nist.gov/div898/strd/: Longley, Norris, DanWood),
with responses and factors transformed so that the certified regression is a law; the trebuchet data of package
daewr as printed for rsm 2.10 (Lawson 2015, Design and Analysis of Experiments with R); statsmodels' OLS and formulas,
computed here. Kienzle's law against OLS with an offset is in test_kienzle.py, lives against lifelines and survreg in
test_life_law.py, surfaces of split plots against R in test_surface.py, load lines of CLM-2023 in test_load_line.py, and
the mechanistic force in test_mechanistic.py.
"""

import re

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf
from fitmodels import fit
from fitmodels.core.formula import FORMS
from fitmodels.datasets import runs_from_frame
from fitmodels.fit.life import taylor_constants
from fitmodels.fit.regression import fit_form
from statsmodels.regression.linear_model import OLS

TO = 1e-6
TREBUCHET = {
    "V": [4, 8, 4, 8, 4, 8, 4, 8, 6, 6, 6, 6, 6, 6, 6],
    "f": [10, 10, 20, 20, 15, 15, 15, 15, 10, 20, 10, 20, 15, 15, 15],
    "d": [2.5, 2.5, 2.5, 2.5, 2, 2, 3, 3, 2, 2, 3, 3, 2.5, 2.5, 2.5],
    "Ra": [33, 85, 86, 113, 75, 105, 40, 89, 83, 108, 49, 101, 88, 91, 91],
}  # fmt: skip
SCALES = np.array([10.0, 1e5, 1e3, 1e3, 1e5, 100.0])  # of Longley's columns: their exponentials are finite


def read(folder, name):
    """Rows (y first), certified estimates and their standard deviations."""
    lines = (folder / "nist_strd" / f"{name}.dat").read_text("ascii").splitlines()
    first, last = map(int, re.search(r"Data\s+\(lines (\d+) to (\d+)\)", "\n".join(lines[:60])).groups())
    rows = np.array([[float(cell) for cell in line.split()] for line in lines[first - 1 : last]])
    certified = [line.split()[-2:] for line in lines[:60] if re.match(r"\s*b\d+\s+[=\d-]", line, re.I)]
    return rows, *np.array(certified, dtype=float).T


def runs_of(**columns):
    return runs_from_frame(pd.DataFrame(columns), judge=False)


# --- certified cases


@pytest.mark.parametrize("form", ["linear", "exponential", "power", "power_exponential"])
def test_longley_is_certified_in_each_form_of_first_order(measurements, form):
    """y on x1 .. x6 is the predictor; a link makes exp(y) the response, a logarithm exp(x) the factor."""
    rows, estimates, deviations = read(measurements, "Longley")
    y, x = rows[:, 0] / 1e5, rows[:, 1:] / SCALES
    logs = {"power": 6, "power_exponential": 5}.get(form, 0)
    factors = {
        name: np.exp(x[:, j]) if j < logs else x[:, j] for j, name in enumerate(["V", "f", "d", "ae", "t", "VB"])
    }
    response = np.exp(y) if FORMS[form].log_response else y
    error = "multiplicative" if FORMS[form].log_response else "additive"
    law = fit_form(runs_of(R=response, **factors), form, "R", list(factors), error=error)
    scale = np.concatenate([[1.0], SCALES]) / 1e5
    np.testing.assert_allclose(law.theta, estimates * scale, rtol=TO)
    np.testing.assert_allclose(np.sqrt(np.diag(law.covariance())), deviations * scale, rtol=TO)
    assert law.rss == pytest.approx(836424.055505915e-10, rel=TO)


def test_norris_is_certified_as_a_feed_line_and_as_kienzles_law(measurements):
    """Feed that falls over wear, 2000 - y; specific force exp(7 + .75 y/1000) at a thickness of exp(x/1000)."""
    rows, (b0, b1), (se0, se1) = read(measurements, "Norris")
    y, x = rows.T
    line = fit_form(runs_of(fm=2000 - y, VB=x), "feed_line", "fm", ["VB"], error="additive")
    np.testing.assert_allclose(line.theta, [2000 - b0, -b1], rtol=TO)
    np.testing.assert_allclose(np.sqrt(np.diag(line.covariance())), [se0, se1], rtol=TO)

    d = np.resize([1.0, 1.5, 2.5], len(x))
    found = fit.kienzle_law(runs_of(d=d, f=np.exp(x / 1e3), Fc=d * np.exp(7 + 0.75e-3 * y)))
    assert np.log(found.kc11) == pytest.approx(7 + 0.75e-3 * b0, rel=TO)
    assert found.mc == pytest.approx(1 - 0.75 * b1, abs=TO)
    assert found.law.bse["f"] == pytest.approx(0.75 * se1, rel=TO)
    assert np.sqrt(found.law.covariance()[0, 0]) == pytest.approx(0.75e-3 * se0, rel=TO)


def test_danwood_is_certified_with_wear_that_is_orthogonal_to_its_residuals(measurements):
    """b1 x^b2 + k w at w orthogonal to the certified residuals: b1, b2 and the residual sum of squares remain."""
    rows, estimates, _ = read(measurements, "DanWood")
    y, x = rows.T
    off = y - estimates[0] * x ** estimates[1]
    w = np.array([0.1, 0.3, 0.2, 0.05, 0.25, 0.15])
    w = w - off * (w @ off) / (off @ off)
    law = fit_form(runs_of(Fc=y + 2 * w, f=x, VB=w), "additive_wear", "Fc", ["f", "VB"], error="additive")
    np.testing.assert_allclose(law.params, [*estimates, 2.0], rtol=TO)
    assert law.rss == pytest.approx(4.3173084083e-03, rel=TO)


@pytest.mark.parametrize("form", ["second_order", "second_order_original"])
def test_the_trebuchet_is_that_of_rsm_in_both_forms_of_second_order(form):
    """rsm's coded coefficients; standard errors from the F values that it prints. Logarithms: exp(u), exp(y/100)."""
    coded = {"V": (6.0, 2.0), "f": (15.0, 5.0), "d": (2.5, 0.5)}
    columns = {name: np.array(TREBUCHET[name], dtype=float) for name in ("V", "f", "d", "Ra")}
    error, by, scale = "additive", {name: s for name, (_, s) in coded.items()}, 1.0
    if form == "second_order":
        columns = {name: np.exp((columns[name] - m) / s) for name, (m, s) in coded.items()} | {
            "Ra": np.exp(columns["Ra"] / 100)
        }
        error, by, scale = "multiplicative", dict.fromkeys(coded, 1.0), 0.01
    law = fit_form(runs_of(**columns), form, "Ra", ["V", "f", "d"], error=error)
    expected = {
        "V": (19.75, 761.09756), "f": (19.75, 761.09756), "d": (-11.5, 258.04878), "V^2": (-9.375, 79.15103),
        "f^2": (-1.375, 1.70263), "d^2": (-3.375, 10.25797), "V*f": (-6.25, 38.10976), "V*d": (4.75, 22.01220),
        "f*d": (6.75, 44.45122),
    }  # fmt: skip
    found = dict(zip(law.theta_names[1:], zip(law.theta[1:], law.tvalues[1:], strict=True), strict=True))
    assert set(found) == set(expected)
    for term, (value, F) in expected.items():
        a, b = term.split("*") if "*" in term else (term[0], term[0] if "^" in term else None)
        unit = scale / by[a] / (by[b] if b else 1.0)
        assert found[term][0] == pytest.approx(value * unit, rel=TO), term
        assert found[term][1] ** 2 == pytest.approx(F, abs=6e-6), term


# --- statsmodels

FORMULAS = {
    "power": ("np.log(R) ~ np.log(V) + np.log(f) + np.log(VB)", "log"),
    "exponential": ("np.log(R) ~ V + f + VB", "log"),
    "power_exponential": ("np.log(R) ~ np.log(V) + np.log(f) + VB", "log"),
    "linear": ("R ~ V + f + VB", ""),
    "load_line": ("R ~ V + VB", ""),
    "feed_line": ("R ~ VB", ""),
    "second_order": ("np.log(R) ~ v + g + w + I(v**2) + I(g**2) + I(w**2) + v:g + v:w + g:w", "log"),
    "second_order_original": ("R ~ a + b + c + I(a**2) + I(b**2) + I(c**2) + a:b + a:c + b:c", ""),
}
FACTORS = {"load_line": ["V", "VB"], "feed_line": ["VB"]}


def table(seed=6, n=30):
    """Tests with wear."""
    rng = np.random.default_rng(seed)
    frame = pd.DataFrame({name: rng.uniform(low, 3 * low, n) for name, low in (("V", 80), ("f", 0.1), ("VB", 0.1))})
    frame["R"] = 900 * frame.V**0.2 * frame.f**0.7 * np.exp(0.5 * frame.VB + 0.05 * rng.standard_normal(n))
    return frame


@pytest.mark.parametrize("form", FORMULAS)
def test_a_form_without_edges_is_statsmodels_ols_by_formula(form):
    """Coefficients, standard errors, intervals, and the prediction interval of a new row."""
    frame = table()
    formula, link = FORMULAS[form]
    error = "multiplicative" if link else "additive"
    runs = runs_from_frame(frame, judge=False)
    law = fit_form(runs, form, "R", FACTORS.get(form, ["V", "f", "VB"]), error=error)
    middles = law.formula.centres or (1.0, 1.0, 1.0)
    for name, log, plain, middle in zip(["V", "f", "VB"], "vgw", "abc", middles, strict=True):
        frame[log], frame[plain] = np.log(frame[name] / middle), frame[name] - middle
    ols = smf.ols(formula, frame).fit()
    same_order = _columns(law.design, ols.model.exog)
    np.testing.assert_allclose(law.theta, ols.params.to_numpy()[same_order], rtol=TO)
    np.testing.assert_allclose(np.sqrt(np.diag(law.covariance())), ols.bse.to_numpy()[same_order], rtol=TO)
    assert law.rss == pytest.approx(ols.ssr, rel=TO)
    at = frame.iloc[[3]]
    theirs = ols.get_prediction(at).summary_frame()[["mean", "obs_ci_lower", "obs_ci_upper"]].to_numpy()[0]
    ours = law.predict({name: float(at[name].iloc[0]) for name in law.factors}, "prediction").to_frame()
    np.testing.assert_allclose(
        ours[["value", "low", "high"]].to_numpy()[0], np.exp(theirs) if link else theirs, rtol=TO
    )


def _columns(ours, theirs):
    """Position in the one design of each column of the other."""
    return [int(np.argmin(np.abs(theirs - column[:, None]).sum(axis=0))) for column in ours.T]


@pytest.mark.parametrize("error", ["additive", "multiplicative"])
def test_additive_wear_is_a_fixed_point_of_statsmodels_ols(error):
    """At the least squares, OLS of the residuals on the derivatives gives zero; its covariance is that of the law."""
    frame = table()
    frame["R"] = 900 * frame.V**0.2 * frame.f**0.7 + 700 * frame.VB + 20 * np.random.default_rng(1).normal(size=30)
    runs = runs_from_frame(frame[["V", "f", "VB", "R"]], judge=False)
    law = fit_form(runs, "additive_wear", "R", ["V", "f", "VB"], error=error)
    ln_c, a, b, k = law.theta
    product = np.exp(ln_c) * frame.V**a * frame.f**b
    fitted = product + k * frame.VB
    J = np.column_stack([product, product * np.log(frame.V), product * np.log(frame.f), frame.VB])
    off = frame.R - fitted
    if error == "multiplicative":
        J, off = J / fitted.to_numpy()[:, None], np.log(frame.R / fitted)
    ols = OLS(off.to_numpy(), J).fit()
    assert np.abs(ols.params / ols.bse).max() < TO
    np.testing.assert_allclose(np.sqrt(np.diag(law.covariance())), ols.bse, rtol=TO)


def test_taylors_constants_are_those_of_statsmodels():
    """n = -1/a with the ends of the interval of a; C is the speed of one minute of life."""
    rng = np.random.default_rng(8)
    V, f = rng.uniform(100, 250, 16), rng.uniform(0.1, 0.4, 16)
    T = 4e8 * V**-3.6 * f**-1.1 * np.exp(0.1 * rng.standard_normal(16))
    law = fit.life_law(runs_of(V=V, f=f, T=T), ["V", "f"])
    ols = smf.ols("np.log(T) ~ np.log(V) + np.log(f)", pd.DataFrame({"V": V, "f": f, "T": T})).fit()
    np.testing.assert_allclose(law.theta, ols.params, rtol=TO)
    np.testing.assert_allclose(np.sqrt(np.diag(law.covariance())), ols.bse, rtol=TO)
    found = taylor_constants(law)
    a, (low, high) = ols.params["np.log(V)"], ols.conf_int().loc["np.log(V)"]
    assert found.n == pytest.approx(-1 / a, rel=TO)
    assert found.n_interval == pytest.approx((-1 / low, -1 / high), rel=TO)
    middle = dict(found.at)["f"]
    speeds = pd.DataFrame({"V": [found.C_interval[0], found.C, found.C_interval[1]], "f": middle})
    band = ols.get_prediction(speeds).summary_frame()
    found_zeros = [band["mean_ci_lower"].iloc[0], band["mean"].iloc[1], band["mean_ci_upper"].iloc[2]]
    np.testing.assert_allclose(found_zeros, 0, atol=TO)


def test_every_form_has_its_references():
    """A new form needs a case here."""
    certified = {"linear", "exponential", "power", "power_exponential", "feed_line", "additive_wear",
                 "second_order", "second_order_original"}  # fmt: skip
    elsewhere = {"load_line"}  # test_load_line.py: three points of CLM-2023, section III.A.1
    assert certified | elsewhere == set(FORMS)
    assert set(FORMULAS) | {"additive_wear"} == set(FORMS)
