"""Response surfaces: tests of terms by stratum, selection of terms, canonical analysis.

References: R 4.2.2 with MASS (data oats), lme4 1.1-31, pbkrtest 0.5.2 (KRmodcomp) and car 3.1-1 (Anova), whose numbers
stand below; the trebuchet data of R package daewr as printed for rsm 2.10 (Lawson 2015, Design and Analysis of
Experiments with R, chapter 10); the blocked central composite design `cement` of the same.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import FitError, UsageError
from fitmodels.core.figure_style import Limit
from fitmodels.fit.available import NotAvailable
from fitmodels.fit.law_figures import contours_inside, observed_against_predicted, residuals, residuals_by_edge
from fitmodels.fit.surface.canonical import ridge_point, stationary_point
from fitmodels.fit.surface.display import reservations, verdict_of
from fitmodels.fit.surface.split_plot import edge_model, frame_of_tests, means_regression, term_tests
from fitmodels.fit.surface.surfaces import surface_of
from fitmodels.fit.surface.term_selection import select_terms

OPTIMISER = 1e-6  # relative: the variances of both programs come from a search
DIGITS = 1e-9  # relative: closed forms

OATS = """111 130 157 174 117 114 161 141 105 140 118 156  61  91  97 100  70 108 126 149  96 124 121 144
 68  64 112  86  60 102  89  96  89 129 132 124  74  89  81 122  64 103 132 133  70  89 104 117
 62  90 100 116  80  82  94 126  63  70 109  99  53  74 118 113  89  82  86 104  97  99 119 121"""


def sum_coded(labels):
    """Columns of a category that sum to zero."""
    columns = pd.get_dummies(pd.Series(labels)).to_numpy(dtype=float)
    return columns[:, 1:] - columns[:, :1]


@pytest.fixture(scope="module")
def oats():
    """Model of MASS::oats, 6 blocks of 3 varieties (whole plots) with 4 levels of nitrogen, and columns of terms."""
    y = np.array(OATS.split(), dtype=float)
    block, variety, nitrogen = np.repeat(range(6), 12), np.tile(np.repeat(range(3), 4), 6), np.tile(range(4), 18)
    B, V, N = sum_coded(block), sum_coded(variety), sum_coded(nitrogen)
    both = np.einsum("ni,nj->nij", N, V).reshape(72, 6)
    X = np.hstack([np.ones((72, 1)), B, V, N, both])
    return edge_model(X, y, 3 * block + variety), {"B": range(1, 6), "V": (6, 7), "N": (8, 9, 10), "N:V": range(11, 17)}


def test_split_plot_of_oats_has_the_table_of_r(oats):
    """Venables & Ripley 2002, Modern Applied Statistics with S, section 10.2: aov(Y ~ N * V + Error(B / V))."""
    table = frame_of_tests(term_tests(*oats))
    assert table["error"].to_dict() == dict.fromkeys("BV", "edges") | dict.fromkeys(["N", "N:V"], "rows within edges")
    np.testing.assert_allclose(table["df_error"], [10, 10, 45, 45], rtol=1e-9)
    np.testing.assert_allclose(table["sum_sq"], [15875.28, 1786.361, 20020.5, 321.75], rtol=1e-6)
    np.testing.assert_allclose(table["F"][1:], [1.485340, 37.685647, 0.3028236], rtol=1e-6)
    np.testing.assert_allclose(table["p"][1:], [0.2723869, 2.457710e-12, 0.9321988], rtol=1e-6)


def test_variances_of_oats_are_those_of_r(oats):
    """lmer(Y ~ B + V * N + (1 | B:V)): standard deviations 10.29863374 and 13.30726571."""
    np.testing.assert_allclose(oats[0].edge_variance ** 0.5, 10.29863374, rtol=OPTIMISER)
    np.testing.assert_allclose(oats[0].row_variance ** 0.5, 13.30726571, rtol=OPTIMISER)


def test_the_error_of_rows_gives_the_wrong_f_of_a_whole_plot_term(oats):
    V = frame_of_tests(term_tests(*oats)).loc["V"]
    assert round(V["sum_sq"] / 2 / oats[0].row_variance, 3) == 5.044
    assert V["F"] < 1.5


# KRmodcomp of lmer(y ~ full second order + (1 | edge)) on the bundled file without the rows of the edges E01 to E12
# beyond t = 9.027 exp(.3): F, denominator degrees of freedom, p
KENWARD_ROGER = {
    "V": (234.599274228, 13.6895748039, 5.27118808007e-10),
    "f": (62.6581934202, 13.6897962169, 1.79397550467e-06),
    "d": (21.8019611487, 13.6898505552, 0.000383367771927),
    "t": (549.747373291, 166.865995063, 1.09830103084e-54),
    "V^2": (9.63115644606, 14.2448481121, 0.00764567482025),
    "f^2": (2.98641977268, 14.2448633728, 0.105571540456),
    "d^2": (4.07063198982, 14.2448714087, 0.0628821896712),
    "t^2": (0.88293227122, 164.916451343, 0.348774032599),
    "V*f": (0.0424405296889, 15.078046889, 0.839538126518),
    "V*d": (0.0666190773605, 15.0780462547, 0.79981432609),
    "V*t": (0.651357116652, 166.295848549, 0.420780692311),
    "f*d": (7.82651130754, 15.0780462351, 0.0134735411896),
    "f*t": (2.26716672489, 166.296372314, 0.134038368769),
    "d*t": (1.14344180078, 166.296655205, 0.28647590181),
    "squares (edges)": (3.28179412552, 13.5534600237, 0.0537454313298),
    "products (edges)": (2.64519043637, 15.0780464596, 0.0867873088537),
    "products (within)": (1.35398853624, 166.296292023, 0.258759892201),
}


@pytest.fixture(scope="module")
def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@pytest.fixture(scope="module")
def surface(runs):
    return fit.response_surface(runs, "AW", ["V", "f", "d", "t"])


def test_unequal_times_give_the_kenward_roger_tests_of_r(surface):
    law = surface.full
    law = law.with_rows(formula=law.formula.__class__(
        "second_order", "AW", law.factors, law.formula.terms, (99.85, 0.1893, 2.123, 9.027)
    ))  # fmt: skip
    late = np.isin(law.edge, [f"E{i:02d}" for i in range(1, 13)]) & (np.log(law.X[:, 3] / 9.027) > 0.3)
    found = surface_of(law.with_rows(~late))
    assert found.full.nobs == 192
    for test in found.tests():
        np.testing.assert_allclose(
            (test.fvalue, test.df_error, test.pvalue), KENWARD_ROGER[test.name], rtol=OPTIMISER, err_msg=test.name
        )
    np.testing.assert_allclose(found.model.edge_variance**0.5, 0.0545513719896, rtol=OPTIMISER)


def equal_times(seed=1, edges=24, times=6, b=(0.5, 0.2, 0.3), icc=0.5):
    """Rows of a central composite design with equal times of every edge, in coded units."""
    rng = np.random.default_rng(seed)
    cube = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 2
    S = np.vstack([cube, np.zeros((edges - 20, 3)), np.eye(3), -np.eye(3), np.eye(3), -np.eye(3)])
    edge = np.repeat(np.arange(len(S)), times)
    t = np.tile(np.log(np.arange(1, times + 1)), len(S))
    U = np.column_stack([S[edge], t - t.mean()])
    y = U @ [*b, 0.25] + 0.1 * (
        np.sqrt(icc) * rng.standard_normal(len(S))[edge] + np.sqrt(1 - icc) * rng.standard_normal(len(edge))
    )
    return U, y, edge


def full_columns(U):
    k = U.shape[1]
    names = ["V", "f", "d", "t"][:k]
    columns = {name: U[:, j] for j, name in enumerate(names)}
    columns |= {f"{name}^2": U[:, j] ** 2 for j, name in enumerate(names)}
    columns |= {f"{names[i]}*{names[j]}": U[:, i] * U[:, j] for i in range(k) for j in range(i + 1, k)}
    return np.column_stack([np.ones(len(U)), *columns.values()]), {name: [1 + j] for j, name in enumerate(columns)}


@pytest.mark.slow
def test_equal_times_give_the_two_anova_tables_of_statsmodels():
    """Between edges anova_lm of the means of edges, within them anova_lm with edges as a category."""
    import statsmodels.formula.api as smf
    from statsmodels.stats.anova import anova_lm

    U, y, edge = equal_times()
    X, terms = full_columns(U)
    table = frame_of_tests(term_tests(edge_model(X, y, edge), terms))
    rows = pd.DataFrame(U, columns=["V", "f", "d", "t"]).assign(y=y, edge=edge)
    means = rows.groupby("edge").mean()
    between = anova_lm(smf.ols("y ~ V + f + d + I(V**2) + I(f**2) + I(d**2) + V:f + V:d + f:d", means).fit(), typ=3)
    names = ["V", "f", "d", "V^2", "f^2", "d^2", "V*f", "V*d", "f*d"]
    np.testing.assert_allclose(table.loc[names, "F"], between["F"].iloc[1:-1], rtol=OPTIMISER)
    np.testing.assert_allclose(table.loc[names, "df_error"], between.loc["Residual", "df"], rtol=OPTIMISER)
    np.testing.assert_allclose(table.loc[names, "sum_sq"], 6 * between["sum_sq"].iloc[1:-1], rtol=OPTIMISER)
    inside = anova_lm(smf.ols("y ~ C(edge, Sum) + t + I(t**2) + t:V + t:f + t:d", rows).fit(), typ=3)
    names = ["t", "t^2", "V*t", "f*t", "d*t"]
    np.testing.assert_allclose(table.loc[names, "F"], inside["F"].iloc[2:-1], rtol=OPTIMISER)


@pytest.mark.slow
def test_the_mixed_model_of_statsmodels_has_the_same_coefficients(surface):
    np.testing.assert_allclose(surface.mixedlm().fe_params, surface.model.beta, rtol=1e-4)
    assert surface.formula.startswith("y ~ V + f + d + t + I(V ** 2)")
    np.testing.assert_allclose(surface.ols().params, surface.law.theta, rtol=1e-7)


@pytest.mark.slow
def test_the_tests_stand_beside_those_of_statsmodels(surface):
    """Edges carry 40 % of the variance: rows find V^2 far too significant, as t their p-values agree."""
    table = surface.beside_statsmodels()
    assert table.columns.tolist() == ["error", "p", "p by edge", "p rows", "p mixed"]
    assert table.loc["V^2", "p rows"] < 1e-9 < 0.001 < table.loc["V^2", "p mixed"] < table.loc["V^2", "p"]
    plain = edge_model(surface.full.design, np.log(surface.full.observed))
    each = [plain.tested(row[None, :])[1] for row in np.eye(15)[1:]]
    np.testing.assert_allclose(table["p rows"], each, rtol=1e-6)


@pytest.mark.slow
def test_type_two_is_the_comparison_of_nested_models(surface):
    """anova_lm(small, large, full): the error of the full model."""
    import statsmodels.formula.api as smf
    from statsmodels.stats.anova import anova_lm

    law = surface.full.with_rows(edge=None)
    plain = surface_of(law)
    small = smf.ols("y ~ f + d + t + I(f**2) + I(d**2) + I(t**2) + f:d + f:t + d:t", plain.frame).fit()
    large = smf.ols("y ~ V + f + d + t + I(f**2) + I(d**2) + I(t**2) + f:d + f:t + d:t", plain.frame).fit()
    compared = anova_lm(small, large, plain.ols())
    np.testing.assert_allclose(plain.anova(2).loc["V", "F"], compared["F"].iloc[1], rtol=1e-8)
    products = tuple(term for term in law.formula.terms if max(term.degrees) == 1)
    form = law.formula.__class__("second_order", "AW", law.factors, products, law.formula.centres)
    factorial = surface_of(law.with_rows(formula=form))
    np.testing.assert_allclose(factorial.anova(2)["F"].iloc[:10], factorial.anova_lm(2)["F"].iloc[:10], rtol=1e-7)


def test_type_two_does_not_depend_on_the_origin_and_type_three_does():
    U, y, edge = equal_times(b=(0.5, 0.2, 0.3))
    y = y + 0.2 * U[:, 0] ** 2
    found = {}
    for shift in (0.0, 5.0):
        X, terms = full_columns(U + shift * np.array([1, 1, 1, 0]))
        containing = {name: [other for other in terms if other != name and name[0] in other] for name in "Vfdt"}
        for typ in (2, 3):
            tests = term_tests(edge_model(X, y, edge), terms, typ=typ, containing=containing)
            found[shift, typ] = frame_of_tests(tests)["F"]
    np.testing.assert_allclose(found[0.0, 2][["V", "f", "d", "t"]], found[5.0, 2][["V", "f", "d", "t"]], rtol=1e-6)
    assert found[5.0, 3]["V"] < 0.1 * found[0.0, 3]["V"]


TREBUCHET = {
    "V": [4, 8, 4, 8, 4, 8, 4, 8, 6, 6, 6, 6, 6, 6, 6],
    "f": [10, 10, 20, 20, 15, 15, 15, 15, 10, 20, 10, 20, 15, 15, 15],
    "d": [2.5, 2.5, 2.5, 2.5, 2, 2, 3, 3, 2, 2, 3, 3, 2.5, 2.5, 2.5],
    "Ra": [33, 85, 86, 113, 75, 105, 40, 89, 83, 108, 49, 101, 88, 91, 91],
}  # fmt: skip


@pytest.fixture(scope="module")
def trebuchet():
    """The Box-Behnken design of three factors, renamed V, f, d and Ra."""
    frame = pd.DataFrame(TREBUCHET, dtype=float)
    return fit.response_surface(
        datasets.runs_from_frame(frame, judge=False), "Ra", ["V", "f", "d"], scale="original", edge=None
    )


def test_trebuchet_has_the_tests_of_rsm(trebuchet):
    table = trebuchet.anova()
    squares = {"V^2": 79.15103, "f^2": 1.70263, "d^2": 10.25797, "V*f": 38.10976, "V*d": 22.01220, "f*d": 44.45122}
    np.testing.assert_allclose(table.loc[list(squares), "F"], list(squares.values()), atol=6e-6)
    np.testing.assert_allclose(table.loc[["V", "f", "d"], "F"], [761.09756, 761.09756, 258.04878], rtol=1e-7)
    np.testing.assert_allclose(table.loc[["squares", "products"], "F"], [28.5759, 34.8577], rtol=2e-6)
    assert (table["error"] == "rows").all()
    assert (round(trebuchet.lack_of_fit.statistic, 4), trebuchet.lack_of_fit.df) == (1.6111, (3, 2))


def test_trebuchet_has_the_canonical_analysis_of_rsm(trebuchet):
    found = trebuchet.canonical()
    np.testing.assert_allclose(found.coded, [0.9236846, -1.7161183, -2.7698217], rtol=1e-6)
    np.testing.assert_allclose(list(found.stationary.values()), [7.847369, 6.419409, 1.115089], rtol=1e-6)
    np.testing.assert_allclose(found.eigenvalues, [1.280298, -3.551452, -11.853845], rtol=1e-6)
    np.testing.assert_allclose(np.abs(found.directions[:, 0]), [0.1236692, 0.8323200, 0.5403233], rtol=1e-6)
    assert not found.inside
    assert "no optimum" in found.verdict


@pytest.mark.parametrize(
    ("radius", "point", "value"),
    [
        (0.5, (0.277, 0.385, -0.158), 102.599),
        (1.0, (0.393, 0.905, -0.161), 111.318),
        (1.4, (0.390, 1.344, -0.034), 117.077),
    ],
)
def test_ridge_path_of_the_trebuchet_is_that_of_rsm(radius, point, value):
    """`steepest` rounds the coordinates to three decimals and then predicts."""
    b, B = (
        np.array([19.75, 19.75, -11.5]),
        np.array([[-9.375, -3.125, 2.375], [-3.125, -1.375, 3.375], [2.375, 3.375, -3.375]]),
    )
    u = ridge_point(b, B, radius, "highest")
    np.testing.assert_allclose(u, point, atol=5.1e-4)
    np.testing.assert_allclose(90 + b @ np.round(u, 3) + np.round(u, 3) @ B @ np.round(u, 3), value, atol=1e-3)


def test_the_chemical_process_of_montgomery_has_its_maximum():
    """Montgomery, Design and Analysis of Experiments, section 11.3: central composite design in time and temperature.

    He prints the stationary point .389, .306 (87 min, 176.5 degrees), 80.21 % yield, the curvatures -.9634, -1.4143.
    """
    a = 1.414
    S = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], *[[0, 0]] * 5, [a, 0], [-a, 0], [0, a], [0, -a]])
    y = [76.5, 77.0, 78.0, 79.5, 79.9, 80.3, 80.0, 79.7, 79.8, 78.4, 75.6, 78.5, 77.0]
    frame = pd.DataFrame({"V": 85 + 5 * S[:, 0], "f": 175 + 5 * S[:, 1], "Ra": y})
    found = fit.response_surface(
        datasets.runs_from_frame(frame, judge=False), "Ra", ["V", "f"], scale="original", edge=None
    ).canonical()
    np.testing.assert_allclose(found.coded * a, [0.389, 0.306], atol=5e-4)
    np.testing.assert_allclose(list(found.stationary.values()), [86.95, 176.53], atol=5e-3)
    np.testing.assert_allclose(found.eigenvalues / a**2, [-0.9634, -1.4143], atol=2e-4)
    assert round(found.value, 2) == 80.21
    assert found.shape == "maximum"
    assert found.optimum
    assert found.verdict.startswith("Maximum of Ra, 80.2 um, at V 86.9, f 177, inside the tested region")


CEMENT = [109.5, 117, 110.5, 121, 120, 130, 124, 132, 117, 117, 115, 109.5, 132, 120, 121, 115, 127, 116, 117, 117]


def cement():
    """The blocked central composite design, its coded factors moved by 10 to be conditions above zero."""
    cube = [[i, j, k] for k in (-1, 1) for j in (-1, 1) for i in (-1, 1)]
    axial = [[s * 1.681793 * (i == j) for i in range(3)] for j in range(3) for s in (-1, 1)]
    S = np.array([*cube, *[[0, 0, 0]] * 3, *axial, *[[0, 0, 0]] * 3], dtype=float) + 10
    frame = pd.DataFrame(S, columns=["V", "f", "d"]).assign(Ra=CEMENT, day=["1"] * 11 + ["2"] * 9)
    return datasets.runs_from_frame(frame, judge=False)


def test_blocks_have_a_test_of_their_own_and_adjust_the_others():
    """drop1(lm(y ~ Block + second order), test = "F"); Anova(lm(y ~ Block + x1 * x2 + x1 * x3 + x2 * x3), type = 2)."""
    found = fit.response_surface(cement(), "Ra", ["V", "f", "d"], scale="original", blocks="day", edge=None)
    table = found.anova()
    names = ["day", "V", "f", "d", "V^2", "f^2", "d^2", "V*f", "f*d"]
    expected = [0.18930, 78.41700, 2.31305, 66.85842, 5.62796, 4.94611, 6.35382, 0.02455, 0.02455]
    np.testing.assert_allclose(table.loc[names, "F"], expected, rtol=3e-4)
    np.testing.assert_allclose(table.loc[["V", "V^2"], "p"], [9.7464e-06, 0.041749], rtol=1e-4)
    two = fit.response_surface(
        cement(), "Ra", ["V", "f", "d"], model="factorial", scale="original", blocks="day", edge=None
    ).anova(2)
    np.testing.assert_allclose(two.loc[["V", "f", "d"], "F"], [40.85331, 1.20504, 34.83158], rtol=1e-5)


L9 = np.array([(0, 0, 0), (0, 1, 1), (0, 2, 2), (1, 0, 1), (1, 1, 2), (1, 2, 0), (2, 0, 2), (2, 1, 0), (2, 2, 1)])
TWO_LEVELS = np.array([[i, j, k] for i in (0, 2) for j in (0, 2) for k in (0, 2)] + [[1, 1, 1]] * 3)


def rows_of(S, times=(2.0, 4.0, 8.0, 16.0), seed=0, blocks=False):
    """Runs of a power law at settings S (levels 0, 1, 2 of V, f, d) with every edge at these times."""
    rng = np.random.default_rng(seed)
    edge, t = np.repeat(np.arange(len(S)), len(times)), np.tile(times, len(S))
    levels = np.array([[80, 0.1, 0.5], [120, 0.2, 1.0], [180, 0.3, 2.0]])
    X = np.take_along_axis(levels, S, axis=0)
    ln = np.log(X[edge]) @ [0.7, 0.3, 0.2] + 0.4 * np.log(t) - 5.5
    ln = ln + 0.05 * rng.standard_normal(len(S))[edge] + 0.08 * rng.standard_normal(len(t))
    frame = pd.DataFrame(X[edge], columns=["V [m/min]", "f [mm/rev]", "d [mm]"])
    frame = frame.assign(**{"edge": [f"E{g}" for g in edge], "t [min]": t, "AW [mm]": np.exp(ln)})
    if blocks:
        frame["day"] = np.where(edge < len(S) / 2, "1", "2")
    return datasets.runs_from_frame(frame, judge=False)


def test_blocks_of_edges_are_tested_against_edges():
    runs = rows_of(np.vstack([L9, L9]), blocks=True)
    found = fit.response_surface(runs, "AW", ["V", "f", "d", "t"], model="first", blocks="day")
    table = found.anova()
    assert table.loc["day", "error"] == "edges"
    np.testing.assert_allclose(table.loc[["day", "V", "t"], "df_error"], [13, 13, 53])
    assert "block" in found.frame
    assert found.formula.endswith("+ C(block, Sum)")
    assert isinstance(found.law.values({"V": 100, "f": 0.2, "d": 1, "t": 8, "day": "2"}), float)


def test_selection_is_the_smallest_aicc_of_all_sets_with_heredity():
    rng = np.random.default_rng(3)
    U = rng.uniform(-1, 1, (30, 2))
    y = 1 + U[:, 0] + U[:, 0] ** 2 + 0.3 * rng.standard_normal(30)
    X, terms = full_columns(U)
    degrees = {"V": (1, 0), "f": (0, 1), "V^2": (2, 0), "f^2": (0, 2), "V*f": (1, 1)}
    found = select_terms(edge_model(X, y), terms, degrees)

    def aicc(names):
        Z = X[:, [0, *(terms[name][0] for name in names)]]
        rss = np.sum((y - Z @ np.linalg.lstsq(Z, y)[0]) ** 2)
        k = Z.shape[1] + 1
        return 30 * np.log(rss / 30) + 2 * k + 2 * k * (k + 1) / (30 - k - 1)

    both = [("V", "f", *more) for n in range(4) for more in combinations(("V^2", "f^2", "V*f"), n)]
    sets = [("V",), ("f",), ("V", "V^2"), ("f", "f^2"), *both]
    values = np.array([aicc(names) for names in sets])
    assert found.kept == sets[int(values.argmin())] == ("V", "V^2")
    np.testing.assert_allclose((found.aicc, found.aicc_full), (values.min(), values[-1]), rtol=DIGITS)
    weight = np.exp(-(values - values.min()) / 2)
    with_square = [("V^2" in names) for names in sets]
    np.testing.assert_allclose(found.weights["V^2"], weight[with_square].sum() / weight.sum(), rtol=1e-6)


def test_terms_between_edges_are_selected_by_the_number_of_edges():
    """Six copies of each edge's row add no information on V^2."""
    U, y, edge = equal_times(times=6, icc=0.999)
    X, terms = full_columns(U)
    degrees = {name: tuple(name.count(x) * (2 if "^" in name else 1) for x in "Vfdt") for name in terms}
    by_edge = select_terms(edge_model(X, y, edge), terms, degrees)
    by_row = select_terms(edge_model(X, y), terms, degrees)
    second = [name for name in by_row.kept if len(name) > 1]
    assert len(second) > len([name for name in by_edge.kept if len(name) > 1])


def designed(curve, seed=2, row_sd=0.02, edge_sd=0.02):
    """Runs of a central composite design in V and f, four centre points, with ln Ra = curve(u, v)."""
    rng = np.random.default_rng(seed)
    S = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], *[[0, 0]] * 4, [-1.414, 0], [1.414, 0], [0, -1.414], [0, 1.414]])
    edge = np.repeat(np.arange(12), 4)
    u, v = S[edge].T
    ln = curve(u, v) + edge_sd * rng.standard_normal(12)[edge] + row_sd * rng.standard_normal(48)
    frame = pd.DataFrame({
        "edge": [f"E{g:02d}" for g in edge], "V [m/min]": 100 * 1.3**u, "f [mm/rev]": 0.2 * 1.4**v,
        "t [min]": np.tile([1.0, 2.0, 4.0, 8.0], 12), "Ra [um]": np.exp(ln),
    })  # fmt: skip
    return fit.response_surface(datasets.runs_from_frame(frame, judge=False), "Ra", ["V", "f", "t"])


@pytest.mark.parametrize(
    ("curve", "shape", "inside"),
    [
        (lambda u, v: 0.4 * (u - 0.2) ** 2 + 0.3 * (v + 0.1) ** 2, "minimum", True),
        (lambda u, v: -0.4 * (u - 0.2) ** 2 - 0.3 * (v + 0.1) ** 2, "maximum", True),
        (lambda u, v: 0.4 * u**2 - 0.3 * v**2, "saddle", True),
        (lambda u, v: 0.4 * (u + v) ** 2, "ridge", True),
        (lambda u, v: 0.3 * (u - 4) ** 2 + 0.3 * v**2, "minimum", False),
    ],
)
def test_canonical_analysis_recovers_the_kind_of_surface(curve, shape, inside):
    found = designed(curve).canonical()
    assert found.held == {"t": pytest.approx(8**0.5)}
    assert found.shape == shape
    if shape != "ridge":
        assert found.inside is inside
    assert found.optimum is (shape in ("minimum", "maximum") and inside)
    if found.optimum:
        at = (100 * 1.3**0.2, 0.2 * 1.4**-0.1)
        np.testing.assert_allclose(list(found.stationary.values()), at, rtol=0.02)


def test_an_optimum_that_scatter_may_move_to_the_border_is_not_proven():
    found = designed(lambda u, v: 0.05 * u**2 + 0.05 * v**2, row_sd=0.1, edge_sd=0.03).canonical()
    assert not found.optimum
    assert not found.bounded


def test_intervals_of_curvatures_cover_the_truth():
    hits = []
    for seed in range(25):
        found = designed(lambda u, v: 0.1 * u**2 - 0.2 * v**2, seed=seed).canonical()
        half = 1.414**2  # coded to the axial points
        hits.append(found.low[0] < 0.1 * half < found.high[0] and found.low[1] < -0.2 * half < found.high[1])
    assert np.mean(hits) > 0.8


@pytest.mark.parametrize("side", ["lowest", "highest"])
def test_ridge_points_are_the_constrained_optima(side):
    rng = np.random.default_rng(5)
    for _ in range(20):
        k = int(rng.integers(2, 5))
        b, A = rng.standard_normal(k), rng.standard_normal((k, k))
        B, radius = A + A.T, float(rng.uniform(0.1, 3))
        u = ridge_point(b, B, radius, side)
        sphere = rng.standard_normal((4000, k))
        sphere *= radius / np.linalg.norm(sphere, axis=1)[:, None]
        values = sphere @ b + np.einsum("ni,ij,nj->n", sphere, B, sphere)
        own = b @ u + u @ B @ u
        assert abs(np.linalg.norm(u) - radius) < 1e-8
        assert own <= values.min() + 1e-12 if side == "lowest" else own >= values.max() - 1e-12


def test_ridge_point_without_a_slope_goes_along_the_steepest_curvature():
    u = ridge_point(np.zeros(2), np.diag([1.0, -2.0]), 0.5, "lowest")
    np.testing.assert_allclose(np.abs(u), [0, 0.5], atol=1e-9)
    assert np.isnan(stationary_point(np.ones(2), np.diag([1.0, 0.0]))).all()


def test_reduced_surface_predicts_as_its_own_terms(runs):
    found = fit.response_surface(runs, "AW", ["V", "f", "d", "t"], model="reduced")
    assert set(found.law.formula.names) <= set(found.full.formula.names)
    kept = [t for t in found.full.formula.terms if t.name in found.selection.kept]
    mains = {t.name for t in kept if t.order == 1}
    assert all(set(t.name.replace("^2", "").split("*")) <= mains for t in kept)
    assert "heredity" in found.law.notes[-1]
    assert isinstance(found.law.values({"V": 100, "f": 0.2, "d": 2, "t": 8}), float)


def test_two_levels_leave_the_square_out_by_name():
    Ra = np.random.default_rng(1).uniform(1, 2, 12)
    frame = pd.DataFrame({"V": np.tile([50.0, 100, 200], 4), "f": np.repeat([0.1, 0.2], 6), "Ra": Ra})
    found = fit.response_surface(datasets.runs_from_frame(frame, judge=False), "Ra", ["V", "f"], edge=None)
    assert [out.factor for out in found.full.left_out] == ["f^2"]
    assert "two levels" in found.summary()


def test_a_constant_factor_is_left_out_of_every_model(runs):
    frame = pd.DataFrame({"V": np.linspace(50, 200, 12), "d": 2.0, "Ra": np.linspace(1, 2, 12) ** 1.5})
    made = datasets.runs_from_frame(frame, judge=False)
    for model in ("full", "reduced", "factorial", "first"):
        found = fit.response_surface(made, "Ra", ["V", "d"], model=model, edge=None)
        assert found.law.factors == ("V",)
        assert [out.factor for out in found.law.left_out] == ["d"]


def test_an_array_of_nine_edges_is_reduced_and_tests_the_terms_that_are_kept():
    """All terms need as many coefficients as there are edges."""
    full = fit.response_surface(rows_of(L9), "AW", ["V", "f", "d", "t"])
    assert verdict_of(full).startswith("The terms are not tested: 9 edges for 9 coefficients")
    found = fit.response_surface(rows_of(L9), "AW", ["V", "f", "d", "t"], model="reduced")
    assert {"V", "f", "d", "t"} <= set(found.law.names)
    assert len(found.law.formula.terms) < 8
    assert found.anova().loc["V", "p"] < 0.01
    assert found.law.notes[-1].startswith("all terms together are not tested: 9 edges")
    assert found.full.selected
    assert verdict_of(found) == verdict_of(surface_of(found.law))


def test_a_kept_law_is_tested_with_all_terms_again(runs):
    """Tests of the terms that AICc chose, on the rows that chose them, would find f*d significant."""
    found = fit.response_surface(runs, "AW", ["V", "f", "d", "t"], model="reduced")
    again = surface_of(found.law)
    assert again.selection.kept == found.selection.kept
    assert verdict_of(again) == verdict_of(found)
    pd.testing.assert_frame_equal(again.anova(), found.anova())
    pd.testing.assert_frame_equal(surface_of(replace(found.law, notes=())).anova(), found.anova())


def test_two_levels_and_a_centre_do_not_say_which_factor_is_curved():
    found = fit.response_surface(rows_of(TWO_LEVELS), "AW", ["V", "f", "d", "t"])
    assert [out.factor for out in found.law.left_out] == ["f^2", "d^2"]
    assert any(text.startswith("V^2 stands for V^2, f^2, d^2 together") for text in reservations(found))
    assert any(text.startswith("11 edges leave 3 degrees of freedom") for text in reservations(found))
    assert str(found.canonical()) == "these tests do not identify f^2, d^2"


def test_too_few_rows_name_the_models_that_they_allow():
    with pytest.raises(FitError, match=r"9 usable rows for the 10 coefficients .* model='factorial' \(7\)"):
        fit.response_surface(rows_of(L9, times=(8.0,)), "AW", ["V", "f", "d"])
    assert fit.response_surface(rows_of(L9, times=(8.0,)), "AW", ["V", "f", "d"], model="first").model.df_within == 5


def test_saturated_edges_have_no_tests_and_say_why():
    U, y, edge = equal_times(edges=24)
    few = edge < 10
    X, _ = full_columns(U)
    found = edge_model(X[few], y[few], edge[few])
    assert isinstance(found, NotAvailable)
    assert "fewer terms" in str(found)


def test_the_summary_states_verdict_and_reservations(surface):
    text = surface.summary()
    assert verdict_of(surface).startswith("Second order is not needed: of 10 squares and products, counted together")
    assert max(map(len, text.splitlines())) <= 110
    assert "no optimum" in text
    assert any(sentence.startswith("Over the tests the exponent of d runs from") for sentence in reservations(surface))


def test_a_true_square_is_found_and_named():
    found = designed(lambda u, v: 0.3 * u + 0.4 * u**2)
    assert verdict_of(found).startswith("Second order is needed: of 6 squares and products, counted together, V^2 (F(")


def test_a_surface_below_zero_is_said():
    x = np.linspace(50, 200, 16)
    frame = pd.DataFrame({"V": x, "Ra": 0.01 + np.maximum(x / 100 - 1, 0.0)})
    found = fit.response_surface(datasets.runs_from_frame(frame, judge=False), "Ra", ["V"], scale="original", edge=None)
    assert found.law.fitted.min() < 0
    assert any("scale='log'" in sentence for sentence in reservations(found))


@pytest.mark.slow
def test_influence_is_that_of_the_regression_of_edge_levels(surface):
    table = surface.influence()
    np.testing.assert_allclose(table["leverage"].sum(), 10, rtol=1e-8)
    rows = means_regression(surface.model)
    assert rows.shape == (24, 11)
    assert list(table.index[:2]) == ["E01", "E02"]


def test_figures_are_drawn(surface):
    assert surface.plot().get_xlabel() == "V [m/min]"
    assert surface.plot(over=("f", "d")).get_ylabel() == "d [mm]"
    assert "coded distance" in surface.canonical().plot().get_xlabel()


def test_models_scales_and_forms_that_do_not_exist_are_refused(runs):
    with pytest.raises(UsageError, match="model='cubic'"):
        fit.response_surface(runs, "AW", ["V"], model="cubic")
    with pytest.raises(UsageError, match="scale='ln'"):
        fit.response_surface(runs, "AW", ["V"], scale="ln")
    with pytest.raises(UsageError, match="of the form power"):
        surface_of(fit.power_law(runs, "AW", ["V"]))


# Figures of a surface


def test_contours_stay_inside_the_tested_region_and_show_the_limit():
    """Of an L-shaped design the fourth corner of the box was never cut: nothing is drawn there."""
    rng = np.random.default_rng(2)
    settings = [(50, 0.1), (50, 0.2), (50, 0.4), (100, 0.1), (200, 0.1), (70, 0.2)]
    V, f = np.repeat(np.array(settings), 4, axis=0).T
    t = np.tile([2.0, 5.0, 10.0, 20.0], len(settings))
    frame = pd.DataFrame({"V": V, "f": f, "t": t, "edge": np.repeat([f"E{k}" for k in range(1, 7)], 4)})
    frame["AW"] = 0.01 * V**0.5 * f**0.3 * t**0.4 * np.exp(rng.normal(0, 0.02, len(V)))
    law = fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V", "f", "t"])
    limit = Limit(float(np.exp(np.log(law.fitted).mean())), "criterion")
    ax = contours_inside(law, ("V", "f"), limit=limit)
    drawn = np.concatenate([path.vertices for part in ax.collections for path in part.get_paths() if len(path)])
    x, y = np.log(drawn / [50, 0.1]).T / np.log(4)  # from 0 to 1 over both ranges
    assert 1.0 < (x + y).max() < 1.4  # the corner that was not cut is at 2
    assert "criterion" in {text.get_text() for text in ax.texts}
    assert {"E1", "E3", "E5"} <= {text.get_text() for text in ax.texts}
    above = contours_inside(law, ("V", "f"), limit=Limit(1e3, "criterion 1000 mm"))
    assert any("criterion 1000 mm not reached" in text.get_text() for text in above.texts)


def test_each_of_24_edges_has_a_look_of_its_own_in_every_panel():
    law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    looks = []
    for panel in (observed_against_predicted, residuals, residuals_by_edge):
        lines = {line.get_label(): line for line in panel(law).lines if line.get_label().startswith("E")}
        looks.append({name: (line.get_color(), line.get_marker()) for name, line in lines.items()})
    assert len(set(looks[0].values())) == 24
    assert looks[0] == looks[1] == looks[2]
