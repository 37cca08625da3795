"""Which factors a design can tell apart; the others are named with the reason."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.fit.rows import EXACT, identifiable


def wear(n=30, seed=0, **more):
    rng = np.random.default_rng(seed)
    V, f, d = rng.uniform(50, 200, n), rng.uniform(0.1, 0.6, n), rng.uniform(1.5, 3, n)
    AW = 7.62e-3 * V**0.577 * f**0.168 * d**0.248 * np.exp(0.05 * rng.normal(size=n))
    return pd.DataFrame({"V": V, "f": f, "d": d, "AW": AW, **more})


def fitted(frame, factors, **options):
    return fit.power_law(datasets.runs_from_frame(frame), "AW", factors, **options)


def test_a_removal_rate_beside_its_factors_is_left_out_by_name():
    """MRR = 1000 V f d (Alaskari & Oraby, doi 10.15242/IIE.E1216006) adds nothing to V, f and d."""
    frame = wear().assign(MRR=lambda x: 1000 * x.V * x.f * x.d)
    law = fitted(frame, ["V", "f", "d", "MRR"])
    assert law.factors == ("V", "f", "d")
    (out,) = law.left_out
    assert out.factor == "MRR"
    assert "exact product of others (V^1 f^1 d^1)" in out.reason
    pd.testing.assert_series_equal(law.params, fitted(frame, ["V", "f", "d"]).params)


def test_of_two_that_say_the_same_the_later_goes():
    frame = wear().assign(MRR=lambda x: 1000 * x.V * x.f * x.d)
    law = fitted(frame, ["MRR", "V", "f", "d"])
    assert law.factors == ("MRR", "V", "f")
    assert law.left_out[0].factor == "d"
    assert "MRR^1 V^-1 f^-1" in law.left_out[0].reason


def test_a_constant_factor_is_left_out_by_name():
    law = fitted(wear().assign(d=2.5), ["V", "f", "d"])
    assert law.factors == ("V", "f")
    assert [(item.factor, item.reason) for item in law.left_out] == [("d", "constant (2.5 in all 30 rows)")]
    assert "Left out: d, constant (2.5" in law.summary()


def test_nothing_left_is_a_sentence():
    frame = wear().assign(V=100.0, d=2.5)
    with pytest.raises(errors.FitError, match=r"no factor to fit it on; V is left out: constant \(100 in all"):
        fitted(frame, ["V", "d"])


def test_a_factor_that_changes_only_with_the_category_is_said():
    frame = wear().assign(work=np.repeat(["C45", "42CrMo4", "316L"], 10))
    frame["d"] = np.repeat([1.0, 2.0, 3.0], 10)
    law = fitted(frame, ["V", "f", "d"], by="work")
    assert law.names == ("c0", "V", "f", "work[42CrMo4]", "work[C45]")
    assert [(item.factor, item.reason) for item in law.left_out] == [("d", "it changes only with the category")]


def test_a_column_computed_to_six_decimals_is_exact_but_of_full_rank():
    """Table 1 of Alaskari & Oraby (Kuwait J. Sci., accepted June 2017): AW is computed from V and f there."""
    runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    law = fit.power_law(runs, "P", ["V", "f", "t", "AW"])
    assert law.factors == ("V", "f")
    reasons = {item.factor: item.reason for item in law.left_out}
    assert reasons["t"] == "constant (1 in all 16 rows)"
    assert "exact product of others (V^0.577 f^0.168)" in reasons["AW"]
    logs = np.log(np.column_stack([runs.values(name) for name in ("V", "f", "AW")]))
    assert np.linalg.matrix_rank(np.column_stack([np.ones(16), logs])) == 4  # a rank test sees nothing


@pytest.mark.parametrize(("noise", "kept"), [(1e-6, False), (1e-2, True)])
def test_the_border_lies_between_a_computed_and_a_measured_column(noise, kept):
    """EXACT is a share of variance: noise of 1e-6 leaves far less, of 1 % far more."""
    rng = np.random.default_rng(2)
    V = np.log(rng.uniform(50, 200, 200))
    column = 0.5 * V + noise * rng.normal(size=200)
    share = noise**2 / np.var(column)
    assert bool(share > EXACT) is kept
    keep, _ = identifiable(["V", "AW"], np.column_stack([V, column]), np.empty((200, 0)), logs=True)
    assert keep == ([0, 1] if kept else [0])


def test_lines_name_sums():
    rng = np.random.default_rng(3)
    fm = rng.uniform(500, 1000, 12)
    _, out = identifiable(["fm", "VB"], np.column_stack([fm, 1 - 1e-3 * fm]), np.empty((12, 0)), logs=False)
    assert "an exact sum of others (-0.001 fm)" in out[0].reason


def test_too_few_rows_to_tell_are_left_to_the_count():
    """Any three points lie on a plane: that is no dependence, and fit_rows counts them."""
    X = np.log([[50, 0.1, 1.0], [80, 0.3, 2.0], [90, 0.2, 1.5]])
    keep, out = identifiable(["V", "f", "d"], X, np.empty((3, 0)), logs=True)
    assert keep == [0, 1, 2]
    assert out == ()


def test_no_rows_at_all_are_no_constant():
    keep, out = identifiable(["V"], np.empty((0, 1)), np.empty((0, 0)), logs=True)
    assert (keep, out) == ([0], ())
