"""Published tables and real measurements give the laws that are known of them.

Bundled: tables of Alaskari & Oraby (Kuwait J. Sci., accepted June 2017) and of the constant-roughness paper.
Measured elsewhere, under FITMODELS_DATA: NASA Ames / UC Berkeley milling (A. Agogino and K. Goebel, BEST lab,
2007) and turning of H13 (Canal and Borille, ITA, 2022); their README files hold the figures tested here.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.published import compare_published
from statsmodels.regression.linear_model import OLS


def table(name):
    return datasets.read_runs(datasets.bundled(name))


def test_wear_exponents_of_table_1():
    """Eq. 5: AW = 9.5641e-3 V^0.577 f^0.168 at d 2.5 and t 1; 9.5640e-3 is 7.62e-3 x 2.5^0.248 cut short."""
    law = fit.power_law(table("ac2017_table1"), "AW", ["V", "f", "t"])
    assert law.params["V"] == pytest.approx(0.577, abs=5e-5)
    assert law.params["f"] == pytest.approx(0.168, abs=5e-5)
    assert law.params["c0"] == pytest.approx(7.62e-3 * 2.5**0.248, abs=5e-7)
    assert [item.factor for item in law.left_out] == ["t"]
    assert law.rsquared > 1 - 1e-9


@pytest.mark.parametrize(
    ("response", "within", "exponents"),
    [
        ("P", 3e-4, {"V": 0.82, "f": 0.627, "t": 0, "AW": 0.342}),
        ("Fxz", 1e-4, {"V": -0.484, "f": 0.236, "t": 0, "AW": 1.1}),
    ],
)
def test_power_and_force_need_both_tables(response, within, exponents):
    """Table 1 alone cannot part AW from V and f; the second minute, after another first one, can.

    Both tables leave out the factors t^-0.049 and t^-0.173 of eq. 2 and 3, so the exponent of t is zero.
    Table 2 prints three digits of the power and four of the force.
    """
    one, two = table("ac2017_table1"), table("ac2017_table2")
    alone = fit.power_law(one, response, list(exponents))
    assert alone.factors == ("V", "f")
    assert [item.factor for item in alone.left_out] == ["t", "AW"]
    law = fit.power_law(one.join(two), response, list(exponents))
    assert (law.nobs, law.left_out) == (32, ())
    np.testing.assert_allclose(law.params[1:], list(exponents.values()), atol=within)


def test_the_constants_of_power_and_force_hold_the_depth():
    """At d 2.5: 0.14 x 2.5^0.844 and 55354 x 2.5^0.715, with the exponents' rounding in ln c0."""
    both = table("ac2017_table1").join(table("ac2017_table2"))
    for response, c0 in (("P", 0.14 * 2.5**0.844), ("Fxz", 55354 * 2.5**0.715)):
        law = fit.power_law(both, response, ["V", "f", "AW"])
        assert law.params["c0"] == pytest.approx(c0, rel=2e-3)


def test_the_removal_rate_is_a_product_of_speed_and_feed():
    law = fit.power_law(table("ac2017_table1"), "P", ["V", "f", "MRR"])
    assert [item.factor for item in law.left_out] == ["MRR"]
    assert "V^1 f^1" in law.left_out[0].reason


def test_default_laws_of_table_1_take_what_it_can_tell():
    laws, refused = fit.default_laws(table("ac2017_table1"))
    assert {law.response: law.factors for law in laws} == dict.fromkeys(("AW", "Fxz", "P"), ("V", "f"))
    assert refused == ()


def test_roughness_beside_the_printed_law():
    """Eq. 5, Ra = 0.2401 exp(0.0034 F), at the controlled forces is 16 % high at Ra_ref 1.0, 0.2 % at 2.2.

    ``worst_percent`` counts from the printed law to the observed value, so 16 % high reads -13.8 %.
    """
    runs = table("surf_table1")
    law = fit.exponential_law(runs)
    ols = OLS(np.log(runs.values("Ra")), np.column_stack([np.ones(8), runs.values("F")])).fit()
    assert law.params["a"] == pytest.approx(np.exp(ols.params[0]), rel=1e-9)
    assert law.params["b"] == pytest.approx(ols.params[1], rel=1e-9)
    assert law.params.to_numpy() == pytest.approx([0.1725, 0.003844], rel=5e-4)

    beside = compare_published(law, runs.tool, runs.work)
    assert dict(beside.coefficients) == {"a": 0.2401, "b": 0.0034}
    assert beside.standard_error is None
    printed = 0.2401 * np.exp(0.0034 * law.X[:, 0])
    assert 100 * (printed / law.observed - 1)[[0, 4]] == pytest.approx([16.0, 0.2], abs=0.05)
    observed = 100 * (law.observed / printed - 1)
    assert beside.worst_percent == pytest.approx(observed[0], rel=1e-12)
    assert 100 / (1 + beside.worst_percent / 100) - 100 == pytest.approx(16.0, abs=0.05)
    assert beside.rms_percent == pytest.approx(np.sqrt(np.mean(observed**2)), rel=1e-12)
    assert beside.worst_line == law.lines[0]


def test_the_simulated_test_beside_its_own_laws():
    runs = table("gc435_709m40")
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    beside = compare_published(law, runs.tool, runs.work)
    assert beside.coefficients["V"] == 0.577
    assert beside.standard_error == 0.1
    assert beside.rms_percent == pytest.approx(10, abs=2)  # the standard error it was drawn with
    assert compare_published(law, runs.tool, "C45") is None
    short = compare_published(fit.power_law(runs, "AW", ["V", "f", "t"]), runs.tool, runs.work)
    assert (short.rms_percent, short.worst_percent, short.worst_line) == (None, None, None)


@pytest.fixture(scope="module")
def nasa(measurements):
    return datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")


def test_milling_wear_of_both_materials(nasa):
    """ln VB = -3.65 + .789 ln t + .316 ln f + .632 ln DOC + 1.145[steel]; R2 .869, F(4,132) 219.8, s .269."""
    law = fit.power_law(nasa, "VB", ["t", "f", "d"], by="material")
    assert law.params.round(3).to_dict() == {
        "c0": round(np.exp(-3.6475), 3), "t": 0.789, "f": 0.316, "d": 0.632, "material[2]": 1.145,
    }  # fmt: skip
    assert law.theta[0] == pytest.approx(-3.65, abs=0.005)
    assert (law.nobs, law.df_model, law.df_resid, law.repeats) == (137, 4, 132, 1)
    assert law.rsquared == pytest.approx(0.869, abs=5e-4)
    assert law.fvalue == pytest.approx(219.8, abs=0.05)
    assert law.scale_se == pytest.approx(0.269, abs=5e-4)
    assert [(d.reason, d.count) for d in law.dropped] == [("VB missing", 21), ("VB zero or negative", 9)]
    assert law.n_edges == 15  # of 16 cases, one has no usable row
    assert sum(d.count for d in law.dropped) + law.nobs == len(nasa) == 167


@pytest.mark.parametrize(
    ("material", "n", "exponents"), [("1", 93, [0.735, 0.229, 0.635]), ("2", 44, [0.989, 0.640, 0.662])]
)
def test_milling_wear_of_each_material(nasa, material, n, exponents):
    (runs,) = (part for part in nasa.pairs() if part.work == material)
    law = fit.power_law(runs, "VB", ["t", "f", "d"])
    assert law.nobs == n
    np.testing.assert_allclose(law.params[1:], exponents, atol=5e-4)


def test_additive_errors_use_the_rows_whose_wear_reads_zero(nasa):
    law = fit.power_law(nasa, "VB", ["t", "f", "d"], by="material", error="additive")
    assert [d.reason for d in law.dropped] == ["VB missing", "t zero or negative"]
    assert law.nobs > 137
    assert (law.observed == 0).any()


def test_milling_current(measurements):
    """ln I_eq = 2.840 + .402 ln f + .511 ln DOC + .312 ln VB + .034[steel], n 137, R2 .943.

    I_eq stands for the DC current where its sensor saturates: (smcAC_mid_std + 0.00419)/0.25309.
    """
    frame = pd.read_csv(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    frame["I_eq"] = (frame["smcAC_mid_std"] + 0.00419) / 0.25309
    runs = datasets.runs_from_frame(frame, map={"I": "I_eq"})
    law = fit.power_law(runs, "I", ["f", "d", "VB"], by="material")
    np.testing.assert_allclose(law.theta, [2.840, 0.402, 0.511, 0.312, 0.034], atol=5e-4)
    assert law.rsquared == pytest.approx(0.943, abs=5e-4)
    assert law.nobs == 137


@pytest.fixture(scope="module", params=["exp1_runs.csv", "Exp1.csv"])
def forces(request, measurements):
    """54 run means, and the file they were made from, which repeats the force of a run on its six rows."""
    return datasets.read_runs(measurements / "turning_forces" / request.param)


def test_turning_force(forces):
    """ln Fx = 7.660 + 1.037 ln ap - .040 ln vc + .765 ln f, R2 .9951, F(3,50) 3395: 54 runs, not 324 rows."""
    law = fit.power_law(forces, "Fx", ["d", "f", "V"])
    np.testing.assert_allclose(law.theta, [7.660, 1.037, 0.765, -0.040], atol=5e-4)
    assert law.rsquared == pytest.approx(0.9951, abs=5e-5)
    assert law.fvalue == pytest.approx(3395, abs=0.5)
    assert (law.nobs, law.df_resid) == (54, 50)
    assert law.pvalues["V"] > 0.05
    copies = len(forces) == 324
    assert law.repeats == (6 if copies else 1)
    said = "the file contains each of 54 measurements 6 times (324 rows)"
    assert [said in note for note in law.notes] == ([True] if copies else [])


def test_turning_resultant_force(forces):
    law = fit.power_law(forces, "F", ["d", "f", "V"])
    assert law.rsquared == pytest.approx(0.991, abs=5e-4)
    assert law.nobs == 54


def test_taking_the_copies_for_measurements_would_inflate_f(measurements):
    """The 324 rows as they stand: F grows by (324 - 4)/(54 - 4), and nothing else is known better."""
    runs = datasets.read_runs(measurements / "turning_forces" / "Exp1.csv")
    logs = np.log(np.column_stack([runs.values(name) for name in ("d", "f", "V")]))
    naive = fit.linear(np.column_stack([np.ones(324), logs]), np.log(runs.values("Fx")))
    law = fit.power_law(runs, "Fx", ["d", "f", "V"])
    np.testing.assert_allclose(naive.params, law.theta, rtol=1e-8)
    assert naive.fvalue == pytest.approx(law.fvalue * 320 / 50, rel=1e-8)


def test_turning_roughness_of_run_means(measurements):
    """ln Ra: f^1.47, vc^-.44 (n.s.), ap^-.05 (n.s.), R2 .659, F 32.2."""
    path = measurements / "turning_forces" / "exp1_runs.csv"
    law = fit.power_law(datasets.read_runs(path, map={"Ra": "Ra_mean"}), "Ra", ["f", "V", "d"])
    np.testing.assert_allclose(law.params[1:], [1.47, -0.44, -0.05], atol=5e-3)
    assert law.rsquared == pytest.approx(0.659, abs=5e-4)
    assert law.fvalue == pytest.approx(32.2, abs=0.05)
    assert (law.pvalues[["V", "d"]] > 0.05).all()


def test_six_readings_of_roughness_are_six_readings(measurements):
    """Ra differs on the six rows of a run, so none is a copy; taken as independent they give F 193."""
    runs = datasets.read_runs(measurements / "turning_forces" / "Exp1.csv")
    law = fit.power_law(runs, "Ra", ["f", "V", "d"])
    assert (law.nobs, law.repeats) == (324, 1)
    assert law.fvalue == pytest.approx(193, abs=0.5)


def test_default_laws_of_the_turning_of_h13(measurements):
    """The file says Ra_mean; facts computed elsewhere: Fx ~ d^1.037 f^.765 V^-.040, Ra ~ f^1.47 V^-.44."""
    laws, refused = fit.default_laws(datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv"))
    found = {law.response: law.params for law in laws}
    assert refused == ()
    assert list(found) == ["Fxz", "Fx", "Fy", "Fz", "F", "Ra", "Rz"]
    assert found["Fx"][["V", "f", "d"]].tolist() == pytest.approx([-0.040, 0.765, 1.037], abs=6e-4)
    assert found["Ra"][["V", "f"]].tolist() == pytest.approx([-0.444, 1.471], abs=6e-4)


@pytest.mark.parametrize(("header", "feed", "teeth"), [("feed", "f", 1), ("fz (mm/tooth)", "fz", 6)])
def test_the_load_law_of_the_milling_of_nasa_is_on_feed_per_revolution_or_tooth(measurements, header, feed, teeth):
    """ln I = 2.840 + .402 ln f + .511 ln d + .312 ln VB + .034 (material 2), n 137, R2 .943; I from its AC part.

    The face mill has six inserts: the feed per tooth is a sixth, and its exponent is the same.
    """
    frame = pd.read_csv(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    frame["current [A]"] = (frame["smcAC_mid_std"] + 0.00419) / 0.25309
    frame = frame[(frame["VB"] > 0) & (frame["time"] > 0)]
    frame = frame.assign(feed=frame["feed"] / teeth).rename(columns={"feed": header})
    runs = datasets.runs_from_frame(frame, process="milling")
    law = next(law for law in fit.default_laws(runs, by="work")[0] if law.response == "I")
    assert (law.factors, law.nobs) == ((feed, "d", "VB"), 137)
    assert law.params[[feed, "d", "VB"]].tolist() == pytest.approx([0.402, 0.511, 0.312], abs=6e-4)
    assert law.rsquared == pytest.approx(0.943, abs=6e-4)
    assert law.notes[-1].endswith(f'--law "I ~ {feed}, VB"')


def test_the_current_of_a_drive_on_feed_alone_is_a_straight_line(measurements):
    path = measurements / "cnc_mill_current" / "per_experiment_means.csv"
    (law,), _ = fit.default_laws(datasets.read_runs(path, map={"I": "X1_absCurrent_A"}))
    frame = pd.read_csv(path)
    line = OLS(frame["X1_absCurrent_A"], np.column_stack([np.ones(18), 60 * frame["feed_mm_s"]])).fit()
    assert (law.form, law.factors) == ("linear", ("fm",))
    np.testing.assert_allclose(law.params, line.params, rtol=1e-9)
    np.testing.assert_allclose(law.bse, line.bse, rtol=1e-9)
