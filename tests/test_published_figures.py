"""Checks of laws against figures that R and SAS printed, on data that anyone can get, to the last digit printed.

References, by data set:

- Motor Trend's 32 cars (``mtcars`` of R): outputs of R's package olsrr, kept in its own tests (GitHub
  rsquaredacademy/olsrr, tests/testthat/_snaps: regress-output.md, loftest-output.md, norm-output.md, collindiag.md).
- American quarters 1959 to 2009 (``statsmodels.datasets.macrodata``): R's ``influence.measures``, ``lmtest::bptest``
  and ``nortest::ad.test``, kept in statsmodels (statsmodels/stats/tests/results/influence_measures_R.csv and
  statsmodels/stats/tests/test_diagnostic.py).
- Grunfeld's investments of 11 firms (``statsmodels.datasets.grunfeld``): ``pbnftest`` of R's package plm on the model
  with effects of firms and of years (GitHub tilburgsciencehub/website, page "Testing for Serial Correlation").
- Brownlee's stack losses (``statsmodels.datasets.stackloss``): ``rlm`` of R's package MASS, kept in statsmodels
  (statsmodels/robust/tests/results/results_rlm.py, class Huber).

A law is a straight line in logarithms, so every data set is given as the exponentials of its columns. Scales of
columns, chosen to keep these small, move none of the figures but PRESS.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from statsmodels.datasets import grunfeld, macrodata, stackloss
from statsmodels.stats.stattools import durbin_watson

SYMBOLS = ["V", "f", "d", "VB"]
CARS = pd.DataFrame(
    {
        "mpg": [
            21.0, 21.0, 22.8, 21.4, 18.7, 18.1, 14.3, 24.4, 22.8, 19.2, 17.8, 16.4, 17.3, 15.2, 10.4, 10.4,
            14.7, 32.4, 30.4, 33.9, 21.5, 15.5, 15.2, 13.3, 19.2, 27.3, 26.0, 30.4, 15.8, 19.7, 15.0, 21.4,
        ],
        "disp": [
            160, 160, 108, 258, 360, 225, 360, 146.7, 140.8, 167.6, 167.6, 275.8, 275.8, 275.8, 472, 460,
            440, 78.7, 75.7, 71.1, 120.1, 318, 304, 350, 400, 79, 120.3, 95.1, 351, 145, 301, 121,
        ],
        "hp": [
            110, 110, 93, 110, 175, 105, 245, 62, 95, 123, 123, 180, 180, 180, 205, 215,
            230, 66, 52, 65, 97, 150, 150, 245, 175, 66, 91, 113, 264, 175, 335, 109,
        ],
        "drat": [
            3.90, 3.90, 3.85, 3.08, 3.15, 2.76, 3.21, 3.69, 3.92, 3.92, 3.92, 3.07, 3.07, 3.07, 2.93, 3.00,
            3.23, 4.08, 4.93, 4.22, 3.70, 2.76, 3.15, 3.73, 3.08, 4.08, 4.43, 3.77, 4.22, 3.62, 3.54, 4.11,
        ],
        "wt": [
            2.620, 2.875, 2.320, 3.215, 3.440, 3.460, 3.570, 3.190, 3.150, 3.440, 3.440, 4.070, 3.730, 3.780, 5.250,
            5.424, 5.345, 2.200, 1.615, 1.835, 2.465, 3.520, 3.435, 3.840, 3.845, 1.935, 2.140, 1.513, 3.170, 2.770,
            3.570, 2.780,
        ],
        "qsec": [
            16.46, 17.02, 18.61, 19.44, 17.02, 20.22, 15.84, 20.00, 22.90, 18.30, 18.90, 17.40, 17.60, 18.00, 17.98,
            17.82, 17.42, 19.47, 18.52, 19.90, 20.01, 16.87, 17.30, 15.41, 17.05, 18.90, 16.70, 16.90, 14.50, 15.50,
            14.60, 18.60,
        ],
    }
)  # fmt: skip


def line(y, *columns, edge=None):
    """A power law that is the linear regression of y on the columns."""
    frame = pd.DataFrame({name: np.exp(np.asarray(x)) for name, x in zip(SYMBOLS, columns, strict=False)})
    frame["AW"] = np.exp(np.asarray(y))
    if edge is not None:
        frame["edge"] = np.asarray(edge)
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", SYMBOLS[: len(columns)])


def cars(*names):
    return line(CARS["mpg"], *(CARS[name] / CARS[name].max() for name in names))


def quarters():
    """Growth of investment on growth of product and the real interest of the quarter before, per cent a year."""
    data = macrodata.load_pandas().data
    growth = 400 * np.log(data[["realinv", "realgdp"]]).diff().iloc[1:]
    return line(growth["realinv"] / 100, growth["realgdp"] / 10, data["realint"].iloc[:-1] / 10)


def printed(digits, decimals):
    return pytest.approx(digits, abs=0.5000001 * 10.0**-decimals)


def test_the_analysis_of_variance_of_three_columns():
    law = cars("disp", "hp", "wt")
    assert law.rss == printed(194.991, 3)
    assert law.tss == printed(1126.047, 3)
    assert law.fvalue == printed(44.566, 3)
    assert law.rsquared == printed(0.827, 3)
    assert fit.judge(law).checks["prediction"].predicted_rsquared == printed(0.768, 3)


def test_lack_of_fit_against_pure_error():
    law = cars("disp")
    found = fit.judge(law).checks["form"]
    assert law.rss == printed(317.1587, 4)
    assert found.df == (25, 5)
    assert (found.ss_lack, found.ss_pure) == (printed(304.2787, 4), printed(12.88, 4))
    assert found.statistic == printed(4.724824, 6)
    assert found.pvalue / 2 == printed(0.04563623, 8)  # of one tail


def test_variance_inflation():
    found = fit.judge(cars("disp", "hp", "wt", "drat")).checks["collinearity"]
    np.testing.assert_allclose(found.vif, [8.209402, 2.894373, 5.096601, 2.279547], atol=5.1e-7)


def test_anderson_and_darling_of_cars():
    """olsrr takes the residuals as they are, without their leverage."""
    found = fit.judge(cars("disp", "hp", "wt", "qsec")).checks["normality"]
    assert (found.statistic, found.pvalue) == (printed(0.5859, 4), printed(0.1188, 4))


# Row of the file, counted from 1: dfbetas of constant, product and interest, Cook's distance, leverage.
INFLUENCE = {
    1: [0.00441265074628045, -0.0276220080672388, 0.00820003383763133, 0.000338059505147097, 0.0256401118204194],
    2: [-0.157853502778310, 0.113535527733652, 0.0220165237589744, 0.00865723178904938, 0.0102912791219414],
    7: [-0.337905835616791, 0.333935348901952, 0.0793904495268091, 0.0461267376014711, 0.0339213507663737],
    64: [-0.934439788188261, 0.776299026187541, 0.561797543736656, 0.321602649997368, 0.0433947127055191],
    77: [0.258374140134625, -0.829664337768013, 0.260277672696777, 0.253427268586742, 0.072184775316909],
    200: [-0.27412328503003, 0.552251251650036, -0.566037344031052, 0.207159157926247, 0.0864330668425508],
}


@pytest.mark.parametrize("row", INFLUENCE)
def test_influence_of_a_quarter(row):
    found, i = fit.judge(quarters()).checks["single edges"], row - 1
    ours = [*found.dfbetas[i], found.cook[i], found.leverage[i]]
    np.testing.assert_allclose(ours, INFLUENCE[row], rtol=1e-9)


def test_the_quarter_that_counts_most_is_rs():
    found = fit.judge(quarters()).checks["single edges"]
    assert (np.argmax(found.cook) + 1, np.argmax(found.leverage) + 1) == (64, 200)


def test_breusch_and_pagan_as_koenker_has_it():
    found = fit.judge(quarters()).checks["even scatter"]
    assert found.df == 2
    assert found.statistic == pytest.approx(0.709924388395087, rel=1e-10)
    assert found.pvalue == pytest.approx(0.701199952134347, rel=1e-10)


def test_anderson_and_darling_of_quarters():
    found = fit.judge(quarters()).checks["normality"]
    assert found.statistic == pytest.approx(1.602209621518313, rel=1e-10)
    assert found.pvalue == pytest.approx(0.0003937979149362316, rel=1e-8)


def test_durbin_and_watson_within_firms():
    """Effects of years are taken out first: in a balanced panel that leaves plm's residuals.

    The statistic is 2 - 2 r less the share of the first and last squares, r our lag-1 correlation.
    """
    data = grunfeld.load_pandas().data.sort_values(["firm", "year"])
    columns = data[["invest", "value", "capital"]].astype(float) / 1000
    y, value, capital = (columns - columns.groupby(data["year"]).transform("mean")).to_numpy().T
    law = line(y, value, capital, edge=data["firm"].astype(str))
    dummies = np.column_stack([np.log(law.X), pd.get_dummies(law.edge).to_numpy(dtype=float)])
    log_y = np.log(law.observed)
    rest = (log_y - dummies @ np.linalg.lstsq(dummies, log_y)[0]).reshape(11, 20)
    ends = (rest[:, [0, -1]] ** 2).sum() / (rest**2).sum()
    found = fit.judge(law).checks["order within edges"]
    assert (found.nobs, found.n_edges) == (220, 11)
    assert 2 - 2 * found.correlation - ends == printed(0.68497, 5)
    by_firm = durbin_watson(rest, axis=1) * (rest**2).sum(axis=1)
    assert 2 - 2 * found.correlation - ends == pytest.approx(by_firm.sum() / (rest**2).sum(), rel=1e-9)


# Coefficients of air flow, water temperature and acid, the constant, the scale and the weights below one.
STACKS = {"theta": [0.82937387, 0.92610818, -0.12784916, -41.02653105], "scale": 2.4407137948148447}
WEIGHTS = {3: 0.7858871, 4: 0.50494094, 21: 0.36814106}


def test_hubers_refit_of_stack_losses():
    """``rlm`` stops once the residuals move by less than 1e-4 of their length, so its last digits are open."""
    data = stackloss.load_pandas().data
    columns = [data[name] / 10 for name in ("AIRFLOW", "WATERTEMP", "ACIDCONC")]
    found = fit.robust(line(data["STACKLOSS"] / 10, *columns))
    ours = [*found.theta[1:], 10 * found.theta[0]]
    np.testing.assert_allclose(ours, STACKS["theta"], rtol=2e-4)
    assert 10 * found.scale == pytest.approx(STACKS["scale"], rel=2e-4)
    reported = {int(i) + 1: found.weights[i] for i in np.flatnonzero(found.weights < 1)}
    assert reported == pytest.approx(WEIGHTS, rel=1e-3)
