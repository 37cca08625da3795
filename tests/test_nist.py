"""Certified values of NIST's Statistical Reference Datasets (StRD), https://www.itl.nist.gov/div898/strd/.

Digits are the log relative error of McCullough (1998), The American Statistician 52(4), 358-366:
``-log10(|x - c| / |c|)``, of the worst coefficient of a set.
"""

import re

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from statsmodels.regression.linear_model import OLS

# set, degree of the polynomial (None: the columns as they stand), digits of coefficients and standard errors
LINEAR = [
    ("Norris", 1, 11, 12),
    ("Longley", None, 10, 11),
    ("Wampler5", 5, 5, 12),
    ("Filip", 10, 7, 7),
]


def read(folder, name):
    """Rows (y first), certified estimates and their standard deviations."""
    lines = (folder / "nist_strd" / f"{name}.dat").read_text("ascii").splitlines()
    head = "\n".join(lines[:60])
    first, last = map(int, re.search(r"Data\s+\(lines (\d+) to (\d+)\)", head).groups())
    rows = np.array([[float(cell) for cell in line.split()] for line in lines[first - 1 : last]])
    certified = [line.split()[-2:] for line in lines[:60] if re.match(r"\s*b\d+\s+[=\d-]", line, re.I)]
    return rows, *np.array(certified, dtype=float).T


def design(rows, degree):
    x = rows[:, 1:]
    return np.column_stack([np.ones(len(x)), x if degree is None else x ** np.arange(1, degree + 1)])


def digits(found, certified):
    with np.errstate(divide="ignore"):
        return float(np.min(-np.log10(np.abs(found - certified) / np.abs(certified))))


@pytest.mark.parametrize(("name", "degree", "of_params", "of_errors"), LINEAR)
def test_linear_sets_keep_their_certified_digits(measurements, name, degree, of_params, of_errors):
    rows, estimates, deviations = read(measurements, name)
    X = design(rows, degree)
    assert len(estimates) == X.shape[1]
    found = fit.linear(X, rows[:, 0])
    assert digits(found.params, estimates) >= of_params
    assert digits(found.bse, deviations) >= of_errors


@pytest.mark.parametrize(
    ("name", "degree", "rsquared", "F", "rss"),
    [
        ("Norris", 1, 0.999993745883712, 5436385.54079785, 26.6173985294224),
        ("Longley", None, 0.995479004577296, 330.285339234588, 836424.055505915),
        ("Wampler5", 5, 0.224668921574940e-02, 6.7552445824012241e-03, 0.835542680000000e16),
        ("Filip", 10, 0.996727416185620, 2162.43954511489, 0.795851382172941e-03),
    ],
)
def test_linear_sets_keep_the_analysis_of_variance(measurements, name, degree, rsquared, F, rss):
    rows, *_ = read(measurements, name)
    found = fit.linear(design(rows, degree), rows[:, 0])
    assert found.rsquared == pytest.approx(rsquared, rel=1e-9)
    assert found.fvalue == pytest.approx(F, rel=1e-7)  # Filip keeps seven digits of everything
    assert found.rss == pytest.approx(rss, rel=1e-7)


def test_filips_standard_errors_are_lost_without_scaling(measurements):
    """statsmodels' QR of the raw powers keeps the coefficients and loses the errors; ours keeps both."""
    rows, _, deviations = read(measurements, "Filip")
    X = design(rows, 10)
    with np.errstate(invalid="ignore"):  # square roots of variances that come out negative
        raw = OLS(rows[:, 0], X).fit(method="qr").bse
    theirs = digits(np.nan_to_num(raw), deviations)
    assert theirs < 4
    assert digits(fit.linear(X, rows[:, 0]).bse, deviations) > theirs + 3


def danwood(measurements, error):
    """DanWood is a power law, y = b1 x^b2; the energy takes the role of a power to be a response."""
    rows, estimates, deviations = read(measurements, "DanWood")
    runs = datasets.runs_from_frame(pd.DataFrame(rows, columns=["y", "x"]), map={"P": "y"})
    return fit.power_law(runs, "P", ["x"], error=error), estimates, deviations


@pytest.mark.parametrize("error", ["additive", "multiplicative"])
def test_danwood_through_the_second_stage(measurements, error):
    law, estimates, deviations = danwood(measurements, error)
    second = law if error == "additive" else law.alternative
    assert digits(second.params.to_numpy(), estimates) >= 8
    assert digits(second.bse.to_numpy(), deviations) >= 8
    assert second.rss == pytest.approx(4.3173084083e-03, rel=1e-9)
    assert second.scale_se == pytest.approx(3.2853114039e-02, rel=1e-9)
    assert second.df_resid == 4


def test_danwood_multiplicative_is_another_answer(measurements):
    law, estimates, _ = danwood(measurements, "multiplicative")
    assert digits(law.params.to_numpy(), estimates) < 3
