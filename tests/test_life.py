"""Tool life from a wear law, against a root of the law itself and against Monte Carlo."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq


def wear_law(factors=("V", "f", "d", "t"), **options):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    return fit.power_law(runs, "AW", list(factors), edge=None, **options)


def exact(V=0.8, t=0.4, c0=1e-4, n=12):
    rng = np.random.default_rng(0)
    speed, time = rng.uniform(50, 200, n), rng.uniform(1, 20, n)
    frame = pd.DataFrame({"V": speed, "t": time, "AW": c0 * speed**V * time**t})
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V", "t"])


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.floats(50, 200), st.floats(0.06, 0.6), st.floats(1.5, 3), st.floats(0.15, 0.4))
def test_life_is_the_root_of_the_wear_law(V, f, d, criterion):
    law = wear_law()
    life = fit.tool_life(law, criterion).predict(V=V, f=f, d=d)
    root = brentq(
        lambda ln_t: law.predict({"V": V, "f": f, "d": d, "t": np.exp(ln_t)})[0] - criterion,
        -40,
        40,
        xtol=1e-12,
    )
    assert life == pytest.approx(np.exp(root), rel=1e-9)


def test_taylors_exponent_and_constant():
    """V T^n = C: with AW = c0 V^a t^k, n = k/a, and V T^n is the same at every speed."""
    life = fit.tool_life(exact(V=0.8, t=0.4), criterion=0.3)
    assert life.taylor_n == pytest.approx(0.5, rel=1e-9)
    assert life.coefficients["V"] == pytest.approx(-2, rel=1e-9)
    C = [V * life.predict(V=V) ** life.taylor_n for V in (60, 120, 180)]
    np.testing.assert_allclose(C, C[0], rtol=1e-9)
    assert C[0] == pytest.approx((0.3 / 1e-4) ** (1 / 0.8), rel=1e-7)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_standard_errors_are_those_of_a_monte_carlo(error):
    """40 000 draws of theta: each standard deviation is known to 0.4 %, the delta method to some per cent.

    k is 0.2465 +- 0.009 here, so ratios by k are nearly linear over its spread.
    """
    law = wear_law(error=error)
    life = fit.tool_life(law, 0.3)
    rng = np.random.default_rng(7)
    theta = rng.multivariate_normal(law.theta, law.cov_theta, size=40_000)
    k = theta[:, 4]
    for j, name in ((1, "V"), (2, "f"), (3, "d")):
        assert life.bse[name] == pytest.approx(np.std(-theta[:, j] / k), rel=0.03)
    ln_constant = (np.log(0.3) - theta[:, 0]) / k
    assert life.bse["c0"] / life.coefficients["c0"] == pytest.approx(np.std(ln_constant), rel=0.03)


def test_what_is_told_beside_the_law():
    law = wear_law()
    life = fit.tool_life(law)
    assert (life.wear, life.criterion, life.unit_of_wear, life.unit) == ("AW", 0.3, "mm", "min")
    assert list(life.coefficients.index) == ["c0", "V", "f", "d"]
    assert life.t_observed == 20
    middle = {"V": np.sqrt(50 * 200), "f": np.sqrt(0.06 * 0.6), "d": np.sqrt(1.5 * 3)}
    assert life.typical_at == pytest.approx(middle, rel=1e-9)
    assert life.typical == pytest.approx(life.predict(**middle), rel=1e-12)
    assert life.taylor_n == pytest.approx(law.params["t"] / law.params["V"], rel=1e-12)


def test_without_speed_there_is_no_taylor_exponent():
    life = fit.tool_life(wear_law(["f", "t"]))
    assert life.taylor_n is None
    assert list(life.coefficients.index) == ["c0", "f"]


def test_an_exactly_determined_law_has_a_life_without_errors():
    life = fit.tool_life(exact(n=3))
    assert life.bse is None
    assert life.taylor_n == pytest.approx(0.5, rel=1e-6)


def by_material():
    frame = pd.DataFrame({"t": [1.0, 2, 3, 4, 5, 6], "AW": [1, 1.5, 1.7, 2.2, 2.4, 3.1], "work": list("ababab")})
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["t"], by="work")


@pytest.mark.parametrize(
    ("law", "criterion", "says"),
    [
        (lambda: wear_law(["V", "f"]), 0.3, "AW is fitted without t"),
        (wear_law, 0.0, "wear criterion 0.0: it needs a value above zero"),
        (wear_law, -0.3, "wear criterion -0.3"),
        (wear_law, float("nan"), "wear criterion nan"),
        (wear_law, float("inf"), "wear criterion inf"),
        (lambda: exact(t=-0.2), 0.3, r"AW falls with time \(t exponent -0.2\)"),
        (lambda: exact(t=1e-4), 0.3, r"AW hardly grows with time \(t exponent 0.0001\)"),
        (by_material, 0.3, "law with a category is not offered"),
    ],
)
def test_laws_that_tell_no_life_are_refused(law, criterion, says):
    with pytest.raises(errors.FitError, match=says):
        fit.tool_life(law(), criterion)


@pytest.mark.parametrize(
    ("at", "says"),
    [
        ({"V": 100, "f": 0.2}, "tool life needs d"),
        ({}, "tool life needs V, f, d"),
        ({"V": 0, "f": 0.2, "d": 2}, "V 0: a power law needs values above zero"),
        ({"V": -50.0, "f": 0.2, "d": 2}, "V -50"),
        ({"V": 100, "f": float("nan"), "d": 2}, "f nan"),
    ],
)
def test_conditions_without_a_life_are_refused(at, says):
    with pytest.raises(errors.FitError, match=says):
        fit.tool_life(wear_law()).predict(**at)
