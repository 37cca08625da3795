"""Formula, gradient and first guess of each law agree with each other."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import fit, parameters
from fitmodels.core.errors import ParameterError
from fitmodels.core.formula import FORMS, FormulaForm, second_order_terms
from fitmodels.datasets import runs_from_frame
from fitmodels.fit.laws import LawForm
from fitmodels.fit.regression import fit_form
from fitmodels.parameters.exports.quantities import file_quantities
from hypothesis import given, settings
from hypothesis import strategies as st

LAWS = {
    "power": (LawForm("power", "AW", ("V", "f")), [-4.0, 0.5, 0.2]),
    "exponential": (LawForm("exponential", "Ra", ("F",)), [-1.4, 0.0034]),
    "load_line": (LawForm("load_line", "I", ("fm", "VB")), [0.12, 1.2e-4, 0.22]),
    "feed_line": (LawForm("feed_line", "fm", ("VB",)), [996.0, -1970.0]),
    "linear": (LawForm("linear", "Ra", ("V", "f")), [0.4, -2e-3, 4.0]),
    "power_exponential": (LawForm("power_exponential", "P", ("V", "f", "VB")), [-3.0, 0.8, 0.6, 1.1]),
    "additive_wear": (LawForm("additive_wear", "Fc", ("f", "V", "VB")), [7.5, 0.76, -0.04, 900.0]),
    "second_order": (
        LawForm("second_order", "AW", ("V", "f"), second_order_terms(("V", "f")), (100.0, 0.2)),
        [-1.5, 0.5, 0.2, 0.1, -0.05, 0.07],
    ),
    "second_order_original": (
        LawForm("second_order_original", "Ra", ("V", "f"), second_order_terms(("V", "f")), (100.0, 0.2)),
        [1.5, -2e-3, 4.0, 1e-5, 9.0, -0.01],
    ),
}
RANGES = {"V": (50, 200), "f": (0.06, 0.6), "F": (400, 800), "fm": (500, 1000), "VB": (0, 0.3)}


def case(form, seed=0):
    law, theta = LAWS[form]
    low, high = np.array([RANGES[name] for name in law.factors]).T
    X = np.random.default_rng(seed).uniform(low, high, size=(20, len(law.factors)))
    return law, np.array(theta), X


@pytest.mark.parametrize("form", LAWS)
def test_gradient_is_the_derivative(form):
    """Central differences with steps of 1e-6 of each parameter are good to 1e-7."""
    law, theta, X = case(form)
    Z = law.design(X)
    for j in range(len(theta)):
        step = np.zeros_like(theta)
        step[j] = 1e-6 * abs(theta[j])
        numeric = (law.response_at(theta + step, Z) - law.response_at(theta - step, Z)) / (2 * step[j])
        np.testing.assert_allclose(law.gradient(theta, Z)[:, j], numeric, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("form", [name for name, (law, _) in LAWS.items() if law.linearisable])
def test_the_guess_is_exact_on_exact_data(form):
    law, theta, X = case(form)
    Z = law.design(X)
    np.testing.assert_allclose(law.guess(Z, law.response_at(theta, Z)), theta, rtol=1e-10)


@pytest.mark.parametrize(
    ("form", "value"),
    [
        ("power", lambda c, X: c[0] * X[:, 0] ** c[1] * X[:, 1] ** c[2]),
        ("exponential", lambda c, X: c[0] * np.exp(c[1] * X[:, 0])),
        ("load_line", lambda c, X: c[0] + c[1] * X[:, 0] + c[2] * X[:, 1]),
        ("feed_line", lambda c, X: c[0] + c[1] * X[:, 0]),
        ("additive_wear", lambda c, X: c[0] * X[:, 0] ** c[1] * X[:, 1] ** c[2] + c[3] * X[:, 2]),
    ],
)
def test_the_coefficients_are_those_of_the_printed_formula(form, value):
    law, theta, X = case(form)
    c = law.coefficients(theta)
    assert len(c) == len(law.names)
    np.testing.assert_allclose(law.response_at(theta, law.design(X)), value(c, X), rtol=1e-13)


def test_names_carry_the_papers_letters():
    assert LawForm("power", "AW", ("V", "f")).names == ("c0", "V", "f")
    assert LawForm("exponential", "Ra", ("F",)).names == ("a", "b")
    assert LawForm("load_line", "I", ("fm", "VB")).names == ("A", "B", "k1")
    assert LawForm("feed_line", "fm", ("VB",)).names == ("fm0", "slope")
    assert [LAWS[name][0].logarithmic for name in ("power", "exponential", "load_line")] == [True, True, False]
    assert list(LAWS) == list(FORMS)


def test_the_equation_is_the_formula_in_text():
    texts = [law.equation([f"{c:g}" for c in theta]) for law, theta in LAWS.values()]
    assert texts[6] == "7.5 f^0.76 V^-0.04 + 900 VB"
    assert texts[:4] == ["-4 V^0.5 f^0.2", "-1.4 exp(0.0034 F)", "0.12 + 0.00012 fm + 0.22 VB", "996 - 1970 VB"]


def test_a_category_adds_columns_after_the_factors():
    law, theta, X = case("power")
    shifts = np.repeat([[1.0], [0.0]], 10, axis=0)
    Z = law.design(X, shifts)
    assert Z.shape == (20, 4)
    moved = law.response_at(np.append(theta, np.log(3)), Z) / law.response_at(theta, law.design(X))
    np.testing.assert_allclose(moved, np.repeat([3.0, 1.0], 10), rtol=1e-13)


def test_coefficients_leave_theta_as_it_was():
    law, theta, _ = case("power")
    before = theta.copy()
    law.coefficients(theta)[0] = 99
    np.testing.assert_array_equal(theta, before)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.01, 100))
def test_a_power_law_turns_scales_into_its_constant(a, b, scale):
    law, theta = LawForm("power", "P", ("V", "f")), np.array([0.3, a, b])
    X = np.random.default_rng(5).uniform(0.1, 10, size=(6, 2))
    moved = theta - np.array([a * np.log(scale), 0, 0])
    np.testing.assert_allclose(
        law.response_at(moved, law.design(X * [scale, 1])), law.response_at(theta, law.design(X)), rtol=1e-11
    )


def test_a_wild_trial_overflows_without_a_warning():
    law, _, X = case("power")
    assert np.isinf(law.response_at(np.array([2000.0, 1, 1]), law.design(X))).all()


def test_a_form_added_to_the_table_is_fitted_shown_written_read_and_predicts(monkeypatch, tmp_path):
    """``R = A + B ln x``: link none, logarithm of the factor."""
    semilog = FormulaForm(False, True, ("A", "B"), FORMS["load_line"].equation)
    monkeypatch.setitem(FORMS, "semilog", semilog)
    V = np.linspace(50, 200, 12)
    runs = runs_from_frame(pd.DataFrame({"V": V, "AW": 0.1 + 0.3 * np.log(V) + 1e-3 * np.sin(V)}), judge=False)
    law = fit_form(runs, "semilog", "AW", ["V"])
    assert (law.error, law.form) == ("additive", "semilog")
    np.testing.assert_allclose(law.params, [0.1, 0.3], atol=4e-3)
    assert "AW [mm] = 0.1" in law.summary()
    band = law.predict({"V": 100.0}, "prediction").to_frame()
    assert band["low"][0] < 0.1 + 0.3 * np.log(100) < band["high"][0]

    parameters.write(parameters.collect(tool="a", work="b", laws=[law]), tmp_path / "params.json")
    section = parameters.read(tmp_path / "params.json").laws["AW"]
    assert (section.form, section.equation[:8]) == ("semilog", "AW = 0.1")
    assert section.values(V=100.0) == pytest.approx(law.values({"V": 100.0}), rel=1e-14)
    for kind in ("mean", "prediction", "tolerance"):
        low, high = law.predict({"V": V}, kind).to_frame()[["low", "high"]].to_numpy().T
        np.testing.assert_allclose(section.interval(kind=kind, V=V), [low, high], rtol=1e-12)
    with pytest.raises(ParameterError, match="semilog law of AW needs positive values"):
        section.values(V=0.0)
    units = {entry.name: entry.unit for entry in file_quantities(parameters.read(tmp_path / "params.json"), None)}
    assert (units["law_aw_a"], units["law_aw_b"]) == ("mm", "mm")


def surface(seed=3):
    """30 rows of a known second-order law in logarithms, errors 1e-3."""
    rng = np.random.default_rng(seed)
    V, f = rng.uniform(60, 200, 30), rng.uniform(0.1, 0.5, 30)
    u, v = np.log(V / 100), np.log(f / 0.2)
    AW = 0.2 * np.exp(0.5 * u + 0.2 * v + 0.3 * u**2 + 0.1 * u * v + 1e-3 * rng.normal(size=30))
    return pd.DataFrame({"V": V, "f": f, "AW": AW, "Ra": 2 + 1e-2 * (V - 100) + 8 * (f - 0.2) ** 2})


@pytest.mark.parametrize(
    "form", ["second_order", "second_order_original", "linear", "exponential", "power_exponential"]
)
def test_the_file_of_each_form_predicts_as_the_fit(form, tmp_path):
    runs = runs_from_frame(surface(), judge=False)
    law = fit_form(runs, form, "AW", ["V", "f"])
    parameters.write(parameters.collect(tool="a", work="b", laws=[law]), tmp_path / "params.json")
    section = parameters.read(tmp_path / "params.json").laws["AW"]
    at = {"V": np.array([70.0, 120.0]), "f": np.array([0.2, 0.4])}
    np.testing.assert_allclose(section.values(**at), law.values(at), rtol=1e-13)
    low, high = law.predict(at, "prediction").to_frame()[["low", "high"]].to_numpy().T
    np.testing.assert_allclose(section.interval(kind="prediction", **at), [low, high], rtol=1e-11)


def test_a_law_of_second_order_recovers_its_terms():
    law = fit_form(runs_from_frame(surface(), judge=False), "second_order", "AW", ["V", "f"])
    assert law.names == ("c0", "V", "f", "V^2", "f^2", "V*f")
    np.testing.assert_allclose(law.params[["V^2", "f^2", "V*f"]], [0.3, 0, 0.1], atol=0.02)


def test_an_equation_of_second_order_shows_its_centres():
    formula, _ = LAWS["second_order"]
    text = "0.2 (V/100)^0.5 (f/0.2)^0.1 exp(0.3 ln(V/100)^2 - 0.05 ln(f/0.2)^2 + 0.07 ln(V/100) ln(f/0.2))"
    assert formula.equation(["0.2", "0.5", "0.1", "0.3", "-0.05", "0.07"]) == text
    natural, _ = LAWS["second_order_original"]
    text = "2 - 0.5 (V - 100) + 0.1 (f - 0.2) + 0.3 (V - 100)^2 + 4 (f - 0.2)^2 - 7 (V - 100) (f - 0.2)"
    assert natural.equation(["2", "-0.5", "0.1", "0.3", "4", "-7"]) == text


def test_a_square_of_two_levels_is_left_out_by_name():
    table = surface()
    table["V"] = np.where(table["V"] > 120, 150.0, 75.0)
    law = fit_form(runs_from_frame(table, judge=False), "second_order", "AW", ["V", "f"])
    out = {item.factor: item.reason for item in law.left_out}
    assert list(out) == ["V^2"]
    assert out["V^2"].startswith("V has two levels only")
    assert fit.judge(law).checks["collinearity"].verdict.startswith("Term V^2 was left out: V has two levels only")
