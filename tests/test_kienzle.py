"""Kienzle's law, fixed exponents and additive wear.

References: the constants that made the data; formulas of turning, drilling and milling with the figures of
sandvik.coromant.com's formulas (kc1.1 1780 N/mm2, mc .26); statsmodels' OLS with an offset and its GLM; scipy's
curve_fit; the NASA Ames milling set (A. Agogino and K. Goebel, BEST lab, 2007), computed with two solvers.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import fit, parameters
from fitmodels.core.errors import FitError, UsageError
from fitmodels.datasets import runs_from_frame
from fitmodels.fit.available import NotAvailable
from fitmodels.fit.composite_law import without_fixed
from fitmodels.fit.law_requests import ALL
from fitmodels.fit.mechanistic import mean_chip_thickness, table_value, turning_chip
from fitmodels.fit.regression import fit_form
from scipy.optimize import curve_fit
from statsmodels.regression.linear_model import OLS

KC, MC = 1780.0, 0.26
EXACT = 1e-9


def turning(angle=90.0, noise=0.0, edges=0, n=24, seed=1, **changes):
    rng = np.random.default_rng(seed)
    frame = pd.DataFrame({"d": rng.choice([1.0, 1.5, 2.5], n), "f": rng.choice([0.1, 0.2, 0.3, 0.4], n)})
    s = np.sin(np.radians(angle))
    frame["Fc"] = KC * frame.d * frame.f ** (1 - MC) * s**-MC
    if edges:
        g = np.repeat(np.arange(edges), n // edges)
        frame["edge"] = [f"E{i}" for i in g]
        frame["Fc"] *= np.exp(0.05 * rng.normal(size=edges)[g])
    frame["Fc"] *= np.exp(noise * rng.normal(size=n))
    return runs_from_frame(frame.assign(**changes))


@pytest.mark.parametrize("kappa", [90.0, 75.0, 45.0])
def test_the_constants_of_exact_forces_whatever_the_entering_angle(kappa):
    found = fit.kienzle_law(turning(kappa), entering_angle=kappa)
    assert (found.kc11, found.mc) == pytest.approx((KC, MC), rel=EXACT)
    assert found.specific_force(0.2)[0] == pytest.approx(KC * 0.2**-MC, rel=EXACT)


def test_chips_of_turning_and_milling():
    """kc 1825.70, 1842.23, 1997.85 N at d 2.5, f .3 and kappa 90, 75, 45; hm by quadrature .0477465, .1250686 mm."""
    for kappa, force in ((90, 1825.70), (75, 1842.23), (45, 1997.85)):
        b, h = turning_chip(2.5, 0.3, kappa)
        assert KC * b * h ** (1 - MC) == pytest.approx(force, abs=0.005)
    assert mean_chip_thickness(0.1, 5, 20) == pytest.approx(0.0477465, abs=5e-8)
    assert mean_chip_thickness(0.1, 20, 20) == pytest.approx(0.0636620, abs=5e-8)
    assert mean_chip_thickness(0.2, 60, 80, 45, centred=True) == pytest.approx(0.1250686, abs=1e-7)


def test_drilling_by_torque_and_power():
    """D 12, f .25, kappa 59, V 80: M 14.316566 N m, P 3.181459 kW; D changes here, V follows from n."""
    D, f = np.meshgrid([8.0, 12.0, 16.0], [0.1, 0.25, 0.4])
    s, V = np.sin(np.radians(59)), 80.0
    M = KC * D / (2 * s) * (f / 2 * s) ** (1 - MC) * 2 * D / 4000
    P = M * 1000 * V / (np.pi * D) / 9549.2966
    frame = pd.DataFrame({"Dc": D.ravel(), "f": f.ravel(), "V": V, "M": M.ravel(), "P": P.ravel()})
    assert frame.query("Dc == 12 and f == 0.25")[["M", "P"]].to_numpy()[0] == pytest.approx(
        [14.316566, 3.181459], rel=1e-6
    )
    for response in ("M", "P"):
        found = fit.kienzle_law(runs_from_frame(frame), response, process="drilling")
        assert (found.kc11, found.mc) == pytest.approx((KC, MC), rel=1e-7)
        assert (found.entering_angle, found.assumed) == (59.0, True)
        assert any("half of a point angle of 118" in note for note in found.law.notes)
    assert "idle power" in found.law.notes[-1]


def test_milling_by_torque_and_power_needs_one_engagement():
    """P 2.61700 kW at D 20, ae 5, ap 10, fz .1, z 4, n 2000 (mean chip thickness)."""
    fz, d = (a.ravel() for a in np.meshgrid([0.05, 0.1, 0.15], [5.0, 10.0]))
    Q = 5 * d * fz * 4 * 2000 / 1000
    P = Q * KC * np.array([mean_chip_thickness(x, 5, 20) for x in fz]) ** -MC / 60_000
    assert P[4] == pytest.approx(2.61700, abs=5e-6)
    frame = pd.DataFrame({"fz": fz, "d": d, "ae": 5.0, "Dc": 20.0, "z": 4, "n": 2000.0, "P": P})
    frame["M"] = frame.P * 9549.2966 / 2000
    for response in ("P", "M"):
        found = fit.kienzle_law(runs_from_frame(frame), response, process="milling")
        assert (found.kc11, found.mc) == pytest.approx((KC, MC), rel=1e-7)
    with pytest.raises(FitError, match=r"ae/D changes from 0.25 to 0.5"):
        fit.kienzle_law(runs_from_frame(frame.assign(ae=[5.0, 5, 5, 10, 10, 10])), "P", process="milling")
    with pytest.raises(FitError, match="needs z, and there is neither a column nor a value"):
        fit.kienzle_law(runs_from_frame(frame.drop(columns="z")), "P", process="milling")


def test_intervals_are_those_of_regression_with_an_offset():
    """statsmodels: OLS of ln(Fc/d) on ln f; ln kc1.1 is its prediction at f 1, kappa 90."""
    runs = turning(noise=0.05)
    found = fit.kienzle_law(runs)
    d, f, Fc = (runs.values(name) for name in ("d", "f", "Fc"))
    oracle = OLS(np.log(Fc / d), np.column_stack([np.ones(len(d)), np.log(f)])).fit()
    low, high = oracle.conf_int().T
    ends = found.conf_int()
    assert ends["kc11"] == pytest.approx(tuple(np.exp([low[0], high[0]])), rel=1e-9)
    assert ends["mc"] == pytest.approx((1 - high[1], 1 - low[1]), rel=1e-9)
    assert (found.law.df_resid, found.law.rss) == (22, pytest.approx(oracle.ssr, rel=1e-10))
    assert found.law.bse["d"] == 0
    assert found.law.conf_int().loc["d"].tolist() == [1.0, 1.0]
    at = found.law.predict({"d": 2.0, "f": 0.25}, "prediction").to_frame()
    band = oracle.get_prediction(np.array([[1.0, np.log(0.25)]])).summary_frame()
    assert at[["low", "high"]].to_numpy()[0] == pytest.approx(
        2 * np.exp(band[["obs_ci_lower", "obs_ci_upper"]].to_numpy()[0]), rel=1e-8
    )


def test_a_constant_depth_keeps_its_exponent_and_its_range():
    runs = turning(noise=0.02, d=2.0)
    frame = runs.to_frame().assign(Fc=KC * 2 * runs.values("f") ** (1 - MC))
    found = fit.kienzle_law(runs_from_frame(frame.assign(Fc=frame.Fc * np.exp(0.01 * np.sin(np.arange(24.0))))))
    assert found.kc11 == pytest.approx(KC, rel=0.05)
    inside = found.law.predict({"d": [2.0, 2.1, 2.0], "f": [0.2, 0.2, 0.5]}, "mean").to_frame()["inside"]
    assert inside.tolist() == [True, False, False]


def test_an_assumed_angle_is_said_and_given_ones_are_used():
    assumed = fit.kienzle_law(turning(noise=0.02))
    assert "kappa 90 degrees is ASSUMED" in assumed.law.notes[-1]
    by_lead = fit.kienzle_law(turning(75.0, lead=15.0))
    assert by_lead.entering_angle == 75.0
    assert by_lead.kc11 == pytest.approx(KC, rel=EXACT)
    small = fit.kienzle_law(turning(noise=0.02), entering_angle=15)
    assert small.law.notes[-1].endswith("Below 30 degrees it is rather a lead angle, but for tools of high feed.")
    with pytest.raises(FitError, match=r"kappa changes from 45 to 90"):
        fit.kienzle_law(turning(kappa=[45.0] * 12 + [90.0] * 12))
    with pytest.raises(UsageError, match="entering angle 0 degrees"):
        fit.kienzle_law(turning(), entering_angle=0)


def test_what_a_person_who_cuts_sees_at_once():
    steel = table_value("42CrMo4")
    assert (steel.kc11, steel.mc, table_value("Ti6Al4V")) == (2200, 0.24, None)
    runs = turning(noise=0.02)
    known = fit.kienzle_law(replace(runs, work="42CrMo4"))
    assert "Table value of low-alloy steel: kc1.1 2200, mc 0.24" in known.sentence
    inch = fit.kienzle_law(replace(runs, work="42CrMo4", data=runs.data.assign(f=runs.data["f"] / 25.4)))
    assert "Check units and entering angle." in inch.sentence
    with pytest.raises(FitError, match=r"f is 0\.2 in all 24 rows, so that mc is not determined"):
        fit.kienzle_law(turning(f=0.2))
    with pytest.raises(UsageError, match="no Kienzle law of Ra in turning"):
        fit.kienzle_law(turning(Ra=1.0), "Ra")


def test_checks_of_a_law_with_fixed_exponents():
    """Truth d^.6: the fixed exponent is rejected; truth d^1: kept. Suspects are of Fc, not of Fc/d."""
    good = turning(noise=0.02, edges=12, n=72)
    judged = fit.judge(fit.kienzle_law(good).law, runs=good)
    assert judged.checks["fixed exponents"].concern == 0
    assert not [name for name, check in judged.checks.items() if isinstance(check, NotAvailable) and check.failed]
    wrong = good.to_frame()
    wrong["Fc"] *= wrong["d"] ** -0.4
    judged = fit.judge(fit.kienzle_law(runs_from_frame(wrong)).law)
    assert judged.checks["fixed exponents"].concern == 1
    assert "The exponent of d is fixed at 1, but these rows give 0.59" in judged.checks["fixed exponents"].verdict
    spoilt = good.to_frame()
    spoilt.loc[5, "Fc"] /= 4.448
    judged = fit.judge(fit.kienzle_law(runs_from_frame(spoilt)).law)
    assert [one.column for one in judged.suspects] == ["Fc"]


def test_the_law_over_its_fixed_powers_has_the_same_inference():
    law = fit.kienzle_law(turning(noise=0.02, edges=12, n=72)).law
    short = without_fixed(law)
    assert (short.response, short.factors, short.df_resid) == ("Fc/d", ("f",), law.df_resid)
    assert short.bse.to_numpy() == pytest.approx(law.bse[["c0", "f"]].to_numpy(), rel=1e-12)
    assert law.edges.names == ("ln c0", "f")
    assert without_fixed(short) is short


def test_a_kienzle_law_is_written_read_and_predicts_alike(tmp_path):
    law = fit.kienzle_law(turning(noise=0.02, edges=12, n=72)).law
    parameters.write(parameters.collect(tool="a", work="b", laws=[law]), tmp_path / "params.json")
    section = parameters.read(tmp_path / "params.json").laws["Fc"]
    assert section.fixed == {"d": 1.0}
    assert any(note.startswith("kc1.1 = ") for note in section.notes)
    new = section.interval(d=2.0, f=0.25, kind="prediction")
    band = law.predict({"d": 2.0, "f": 0.25}, "prediction").to_frame()
    assert new == pytest.approx((band["low"][0], band["high"][0]), rel=1e-9)


def test_fixed_exponents_are_of_factors_and_of_multiplicative_errors():
    runs = turning(noise=0.02)
    with pytest.raises(UsageError, match="multiplicative errors"):
        fit_form(runs, "power", "Fc", ["d", "f"], fixed={"d": 1.0}, error="additive")
    with pytest.raises(UsageError, match="fixed coefficients are those of factors"):
        fit_form(runs, "power", "Fc", ["d", "f"], fixed={"V": 1.0})
    with pytest.raises(UsageError, match="fixed coefficients"):
        fit_form(runs, "linear", "Fc", ["d", "f"], fixed={"d": 1.0})


def worn(seed=1, edges=18, rows=6, noise=0.02):
    """Forces 720 d f^.75 + 900 VB; the first row of each edge has no wear."""
    rng = np.random.default_rng(seed)
    g, t = np.repeat(np.arange(edges), rows), np.tile(np.arange(rows) * 2.0, edges)
    f, d = rng.choice([0.1, 0.2, 0.3, 0.4], edges)[g], rng.choice([1.0, 2.0, 3.0], edges)[g]
    VB = np.where(t == 0, 0, 0.05 * np.exp(0.2 * rng.normal(size=edges))[g] * t**0.6)
    F = (720 * d * f**0.75 + 900 * VB) * np.exp(noise * (rng.normal(size=edges)[g] + rng.normal(size=len(g))))
    return pd.DataFrame({"edge": [f"E{i}" for i in g], "f": f, "d": d, "VB": VB, "Fc": F})


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_additive_wear_is_scipys_fit_and_uses_rows_of_new_edges(error):
    frame = worn()
    law = fit_form(runs_from_frame(frame), "additive_wear", "Fc", ["f", "d", "VB"], error=error)
    assert law.nobs == len(frame)
    scale = np.log if error == "multiplicative" else np.asarray
    columns = frame[["f", "d", "VB"]].to_numpy().T
    oracle, _ = curve_fit(
        lambda x, c, a, b, k: scale(np.exp(c) * x[0] ** a * x[1] ** b + k * x[2]),
        columns, scale(frame.Fc), p0=[7, 1, 1, 500], xtol=1e-14, ftol=1e-14,
    )  # fmt: skip
    assert law.theta == pytest.approx(oracle, rel=1e-6)
    low, high = law.conf_int(0.99).to_numpy().T
    assert (low < [720, 0.75, 1, 900]).all()
    assert (high > [720, 0.75, 1, 900]).all()
    at = law.values({"f": 0.2, "d": 2.0, "VB": [0.0, 0.3]})
    assert at[1] - at[0] == pytest.approx(0.3 * law.params["VB"], rel=1e-12)


def test_additive_wear_of_nasas_unclipped_current(measurements):
    """97 rows, 13 edges: AICc -459.71, -441.38 (RSS .8968), -424.18, and -429.68 with additive error, on one scale."""
    frame = pd.read_csv(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    frame = frame[frame["smcDC_rail_ratio"] < 0.01].rename(columns={"case": "edge", "feed": "f", "DOC": "d"})
    frame = frame.rename(columns={"smcDC_mid_mean": "current"})
    found = {}
    for form, error in (
        ("power", "multiplicative"), ("additive_wear", "multiplicative"), ("power_exponential", "multiplicative"),
        ("additive_wear", "additive"),
    ):  # fmt: skip
        runs = runs_from_frame(frame[frame.VB > 0])
        law = fit_form(runs, form, "current", ["f", "d", "VB"], by="material", error=error)
        assert (law.nobs, law.n_edges) == (97, 13)
        n, k = law.nobs, len(law.theta) + 1
        jacobian = 0.0 if error == "multiplicative" else 2 * np.log(law.observed).sum()
        found[form, error] = n * np.log(law.rss / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1) - jacobian
    assert list(found.values()) == pytest.approx([-459.71, -441.38, -424.18, -429.68], abs=0.005)
    assert fit_form(runs_from_frame(frame), "additive_wear", "current", ["f", "d", "VB"], by="material").nobs == 106


def test_additive_wear_is_written_read_and_predicts_alike(tmp_path):
    law = fit_form(runs_from_frame(worn()), "additive_wear", "Fc", ["f", "d", "VB"])
    parameters.write(parameters.collect(tool="a", work="b", laws=[law]), tmp_path / "params.json")
    section = parameters.read(tmp_path / "params.json").laws["Fc"]
    at = {"f": 0.2, "d": 2.0, "VB": 0.1}
    assert section.values(**at) == pytest.approx(law.values(at), rel=1e-12)
    for kind in ("mean", "prediction", "tolerance"):
        new, band = section.interval(**at, kind=kind), law.predict(at, kind).to_frame()
        assert new == pytest.approx((band["low"][0], band["high"][0]), rel=1e-9)


FORMS = {
    "power": ("Fc", ["f", "d"]),
    "exponential": ("Fc", ["f", "d"]),
    "power_exponential": ("Fc", ["f", "d", "VB"]),
    "linear": ("Fc", ["f", "d", "VB"]),
    "additive_wear": ("Fc", ["f", "d", "VB"]),
    "second_order": ("Fc", ["f", "d"]),
    "second_order_original": ("Fc", ["f", "d"]),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_passes_through_every_check(form):
    """No check fails, and statsmodels has the same numbers where the law is linear."""
    runs = runs_from_frame(worn())
    law = fit_form(runs, form, *FORMS[form])
    judged = fit.judge(law, gauge_sd=0.005, runs=runs)
    assert not [str(check) for check in judged.checks.values() if isinstance(check, NotAvailable) and check.failed]
    assert not isinstance(fit.robust(law), NotAvailable)
    assert len(fit.edge_bootstrap(law, 200).draws) > 100
    if form == "additive_wear":
        with pytest.raises(FitError, match="nonlinear in its parameters and no OLS"):
            law.to_statsmodels()
    else:
        theirs = np.sort(np.abs(law.to_statsmodels().params.to_numpy()))
        assert theirs == pytest.approx(np.sort(np.abs(law.theta)), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_has_a_posterior_or_the_reason_why_not(form):
    """Weak priors: medians within one standard error of least squares; units of every coefficient."""
    law = fit_form(runs_from_frame(worn()), form, *FORMS[form])
    if form == "additive_wear":
        with pytest.raises(FitError, match="additive wear is not; see the intervals"):
            fit.posterior(law)
        return
    found = fit.posterior(law, draws=2000)
    off = (np.median(found.draws[:, : len(law.theta)], axis=0) - law.theta) / np.sqrt(np.diag(law.covariance()))
    assert np.abs(off[1:]).max() < 1
    assert set(law.theta_names[1:]) <= set(found.priors.units)


def test_a_law_with_fixed_exponents_has_no_posterior():
    with pytest.raises(FitError, match="d has a fixed one; see the intervals"):
        fit.posterior(fit.kienzle_law(turning(noise=0.02)).law)


def test_time_is_left_out_of_additive_wear_where_it_would_cost_the_rows_of_new_edges():
    from fitmodels.fit.form_choice import fit_in_form

    frame = worn().assign(t=np.tile(np.arange(6) * 2.0, 18))
    law = fit_in_form(runs_from_frame(frame), "additive", "Fc", ("f", "d", "t", "VB"))
    assert (law.nobs, law.factors) == (108, ("f", "d", "VB"))
    assert "18 rows at t = 0" in law.notes[-1]
    later = fit_in_form(runs_from_frame(frame[frame.t > 0]), "additive", "Fc", ("f", "d", "t", "VB"))
    assert later.factors == ("f", "d", "t", "VB")


def test_a_form_for_all_laws_that_the_process_does_not_have_keeps_the_usual_one():
    """A torque without a process is read as turning, which has no Kienzle law of it; asked by name it is refused."""
    f, D = np.repeat([0.1, 0.2, 0.3, 0.4], 3), np.tile([6.0, 8.0, 10.0], 4)
    frame = pd.DataFrame({"V": 80.0, "f": f, "D": D, "M": 0.03 * D**2 * f**0.74})
    runs = runs_from_frame(frame, judge=False)
    (law,), _ = fit.default_laws(runs, laws=["M ~ f, D"], forms={ALL: "kienzle"})
    assert law.form == "power"
    assert any("not in the form kienzle" in note for note in law.notes)
    with pytest.raises(UsageError, match="--process drilling"):
        fit.fit_law(runs, "M ~ f, D", form="kienzle")
