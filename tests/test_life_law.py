"""The law of tool lives with run-outs: reading of lives, maximum likelihood against oracles, intervals, the file."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import analyse, datasets, fit, parameters
from fitmodels.cards.content.verdicts import law_verdict, main_reason
from fitmodels.core.censored import EARLIER, fit_censored, standard_quantile
from fitmodels.core.errors import DataError, FitError
from fitmodels.fit.censored_lives import lives_of
from fitmodels.fit.checks.tool_lives import run_outs
from fitmodels.fit.form_choice import fit_in_form

TABLE = [
    (120, 0.15, 1, "60+"), (120, 0.3, 1, "60+"), (180, 0.15, 1, "44.5"), (180, 0.3, 1, "21.6"),
    (120, 0.15, 2.5, "60+"), (120, 0.3, 2.5, "37.5"), (180, 0.15, 2.5, "24.9"), (180, 0.3, 2.5, "10.6"),
    (147, 0.212, 1.58, "43"), (147, 0.212, 1.58, "36.4"), (147, 0.212, 1.58, "51.5"), (147, 0.212, 1.58, "50.4"),
]  # fmt: skip
# lifelines 0.30.3, WeibullAFTFitter and LogNormalAFTFitter, .fit(df, "T", "E") on ln V, ln f, ln d: params_,
# standard_errors_, log_likelihood_; ln s is -rho_ or sigma_
LIFELINES = {
    "weibull": (
        (19.6126530, -3.4712357, -1.2354767, -0.7803000), (1.4691324, 0.2838629, 0.1416261, 0.1072142),
        (-2.4468405, 0.2688636), -23.545574076998601,
    ),
    "lognormal": (
        (18.3137513, -3.2114925, -1.1776324, -0.7371045), (1.3230078, 0.2667046, 0.1378849, 0.1034634),
        (-2.2984497, 0.2339679), -23.392068101440230,
    ),
}  # fmt: skip
# survreg of R, Freireich's 42 remissions under 6-MP, as printed in its documentation: intercept, control, their
# standard errors, ln s, log-likelihood
SURVREG = {
    "weibull": ((3.51569, -1.26733), (0.25178, 0.31064), -0.31171, -106.57949),
    "lognormal": ((3.17197, -1.34685), (0.24398, 0.31650), -0.07919, -106.70462),
}
CONTROL = [1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23]
TREATED = [6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35]
CENSORED = [0, 0, 0, 1, 0, 1, 0, 1, 1, 0, 0, 1, 1, 1, 0, 0, 1, 1, 1, 1, 1]


def tool_table(rows=TABLE):
    frame = pd.DataFrame(rows, columns=["V", "f", "d", "T"])
    marked = frame["T"].astype(str).str.contains("[^0-9.]").any()
    return frame if marked else frame.astype({"T": float})


def tool_runs(rows=TABLE):
    return datasets.runs_from_frame(tool_table(rows), judge=False)


def freireich():
    x = np.repeat([1.0, 0.0], 21)
    side = np.array([0] * 21 + CENSORED, dtype=np.int8)
    return np.column_stack([np.ones(42), x]), np.log(np.array(CONTROL + TREATED, dtype=float)), side


@pytest.mark.parametrize("distribution", ["weibull", "lognormal"])
def test_the_tool_table_is_that_of_lifelines(distribution):
    runs = tool_runs()
    lives = lives_of(runs)
    Z = np.column_stack([np.ones(12), np.log(runs.data[["V", "f", "d"]].to_numpy(dtype=float))])
    found = fit_censored(Z, np.log(lives.times), lives.side, distribution)
    beta, se, (ln_scale, ln_scale_se), log_likelihood = LIFELINES[distribution]
    np.testing.assert_allclose(found.beta, beta, rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), [*se, ln_scale_se], rtol=1e-5)
    assert np.log(found.scale) == pytest.approx(ln_scale, abs=1e-6)
    assert found.log_likelihood == pytest.approx(log_likelihood, abs=1e-6)


@pytest.mark.parametrize("distribution", ["weibull", "lognormal"])
def test_freireichs_remissions_are_those_of_survreg(distribution):
    found = fit_censored(*freireich(), distribution)
    beta, se, ln_scale, log_likelihood = SURVREG[distribution]
    np.testing.assert_allclose(found.beta, beta, atol=6e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance))[:2], se, atol=6e-6)
    assert np.log(found.scale) == pytest.approx(ln_scale, abs=6e-6)
    assert found.log_likelihood == pytest.approx(log_likelihood, abs=6e-6)


@pytest.mark.parametrize("distribution", ["weibull", "lognormal"])
def test_lives_over_at_the_first_look_have_the_likelihood_of_shorter_ones(distribution):
    """The maximum, and the information, against differences of the log-likelihood written out with scipy.stats."""
    from scipy import stats

    Z, y, side = freireich()
    side[:4] = EARLIER
    found = fit_censored(Z, y, side, distribution)
    W = stats.norm if distribution == "lognormal" else stats.gumbel_l

    def log_likelihood(x):
        s = np.exp(x[2])
        z = (y - Z @ x[:2]) / s
        parts = [W.logpdf(z) - x[2] - y, W.logsf(z), W.logcdf(z)]
        return float(sum(part[side == which].sum() for part, which in zip(parts, (0, 1, -1), strict=True)))

    best = np.array([*found.beta, np.log(found.scale)])
    assert log_likelihood(best) == pytest.approx(found.log_likelihood, abs=1e-9)
    h = 1e-4
    steps = h * np.eye(3)
    slope = [(log_likelihood(best + e) - log_likelihood(best - e)) / (2 * h) for e in steps]
    np.testing.assert_allclose(slope, 0, atol=1e-5)

    def second(a, b):
        return sum(i * j * log_likelihood(best + i * a + j * b) for i in (1, -1) for j in (1, -1)) / (4 * h * h)

    H = [[second(a, b) for a in steps] for b in steps]
    np.testing.assert_allclose(found.covariance, np.linalg.inv(-np.array(H)), rtol=1e-4, atol=1e-7)


def test_intervals_have_the_degrees_of_freedom_of_the_lives_that_ended():
    law = fit.life_law(tool_runs())
    assert (law.nobs, law.life.ended, law.life.run_outs, law.df) == (12, 9, 3, 5)
    _, se, (ln_scale, _), _ = LIFELINES["lognormal"]
    wider = np.sqrt(9 / 5)
    np.testing.assert_allclose(np.sqrt(np.diag(law.covariance())), np.array(se) * wider, rtol=1e-5)
    assert law.scale_se == pytest.approx(np.exp(ln_scale) * wider, rel=1e-6)
    band = law.conf_int().loc["V"]
    assert (band["high"] - band["low"]) / 2 == pytest.approx(2.570582 * se[1] * wider, rel=1e-5)


def test_without_run_outs_lognormal_lives_are_least_squares():
    ended = [row for row in TABLE if not row[3].endswith("+")]
    law, plain = fit.life_law(tool_runs(ended)), fit.power_law(tool_runs(ended), "T", ["V", "f", "d"])
    np.testing.assert_allclose(law.theta, plain.theta, rtol=1e-12)
    np.testing.assert_allclose(law.covariance(), plain.covariance(), rtol=1e-12)
    assert law.life.least_squares
    by_likelihood = fit_censored(law.design, np.log(law.observed), np.zeros(9, dtype=np.int8), "lognormal")
    np.testing.assert_allclose(by_likelihood.beta, law.theta, rtol=1e-7)
    assert by_likelihood.log_likelihood == pytest.approx(law.life.log_likelihood, abs=1e-9)


def test_the_law_of_weibull_lives_is_that_of_their_median():
    law = fit.life_law(tool_runs(), distribution="weibull")
    (location, *exponents), _, (ln_scale, _), _ = LIFELINES["weibull"]
    np.testing.assert_allclose(law.theta[1:], exponents, rtol=1e-6)
    assert law.theta[0] == pytest.approx(location + np.exp(ln_scale) * np.log(np.log(2)), rel=1e-6)
    at = {"V": 147.0, "f": 0.212, "d": 1.58}
    one = law.predict(at, "prediction").to_frame().iloc[0]
    below, above = np.log(one["value"] / one["low"]), np.log(one["high"] / one["value"])
    median = standard_quantile("weibull", 0.5)
    assert below / above > 1.3
    assert below > law.life.scale * (median - standard_quantile("weibull", 0.025))
    assert above > law.life.scale * (standard_quantile("weibull", 0.975) - median)


WAYS = {
    "marks": (tool_table(), {}),
    "bounds": (tool_table([(*r[:3], ">= " + r[3][:-1] if r[3].endswith("+") else r[3]) for r in TABLE]), {}),
    "words": (tool_table([(*r[:3], r[3].replace("+", " (run-out)")) for r in TABLE]), {}),
}


def with_column(name, stopped, ended):
    frame = tool_table([(*row[:3], float(row[3].rstrip("+"))) for row in TABLE])
    return frame.assign(**{name: [stopped if row[3].endswith("+") else ended for row in TABLE]})


WAYS |= {
    f"{name}={stopped!r}": (with_column(name, stopped, ended), {})
    for name, stopped, ended in (
        ("run-out", "x", ""), ("censored", "yes", "no"), ("censored", 1, 0), ("failed", "no", "yes"), ("event", 0, 1),
        ("status", "suspended", "failed"), ("Bemerkung", "abgebrochen", ""), ("remark", "not reached", "chipping"),
        ("Status", 0, 1), ("Status", 1, 0), ("Abbruch", "ja", "nein"), ("interrompu", "oui", "non"),
    )
}  # fmt: skip
WAYS["mapped"] = (with_column("how it went", "C", "F"), {"map": {"censored": "how it went"}})


@pytest.mark.parametrize("way", WAYS)
def test_run_outs_are_read_however_they_are_written(way):
    frame, options = WAYS[way]
    runs = datasets.runs_from_frame(frame, **options)
    lives = lives_of(runs)
    assert np.flatnonzero(lives.side).tolist() == [0, 1, 4]
    assert lives.times[[0, 1, 4]].tolist() == [60, 60, 60]
    assert any("3 of 12 lives" in note for note in runs.assumed)
    assert not [doubt for doubt in runs.doubts if "T" in doubt.columns]


def test_codes_that_may_mean_both_are_a_doubt_with_its_correction():
    lives = [float(row[3].rstrip("+")) + 2 * i * row[3].endswith("+") for i, row in enumerate(TABLE)]
    frame = tool_table().assign(T=lives)
    frame["status"] = [int(not row[3].endswith("+")) for row in TABLE]
    runs = datasets.runs_from_frame(frame)
    assert np.flatnonzero(lives_of(runs).side).tolist() == [0, 1, 4]
    assert any('--map "censored=status"' in doubt.sentence for doubt in runs.doubts)
    other = datasets.runs_from_frame(frame, map={"censored": "status"})
    assert (lives_of(other).side == 1).sum() == 9


def test_a_column_of_run_outs_that_says_something_else_is_refused():
    with pytest.raises(DataError, match=r"'maybe' does not say whether the life ended. Write yes or no"):
        datasets.runs_from_frame(with_column("censored", "maybe", "no"))


@pytest.mark.parametrize(
    ("header", "modes", "broken"),
    [
        ("end of life", ("VB", "VBBmax 0.6", "KT", "VB criterion"), "breakage"),
        ("Standzeitende", ("Freiflächenverschleiß", "Kolkverschleiß", "VB", "Kriterium"), "Bruch"),
    ],
)
def test_a_column_that_names_what_ended_a_life_is_read(header, modes, broken):
    """Tables after ISO 3685 hold such modes: wear ended the life, and a breakage is a doubt as in remarks."""
    cells = np.resize(np.array(modes, dtype=object), len(TABLE))
    cells[3] = broken
    frame = tool_table().assign(T=np.arange(20.0, 44, 2), **{header: cells})
    runs = datasets.runs_from_frame(frame)
    assert not lives_of(runs).side.any()
    (doubt,) = [one.sentence for one in runs.doubts if "T" in one.columns]
    assert doubt.startswith(f"T: 1 life ended by breakage by column '{header}'")
    for word in ("VB < 0.3", "no wear", "ohne Bruch", "maybe"):
        with pytest.raises(DataError, match="does not say whether the life ended"):
            datasets.runs_from_frame(frame.assign(**{header: [word, *cells[1:]]}))


def test_lives_in_another_unit_keep_their_bounds(tmp_path):
    (tmp_path / "t.csv").write_text("V [m/min],T [h],run-out\n100,1,x\n120,0.5,\n140,0.25,\n160,0.2,\n")
    lives = lives_of(datasets.read_runs(tmp_path / "t.csv"))
    assert lives.times.tolist() == [60, 30, 15, 12]
    (tmp_path / "u.csv").write_text("V [m/min],T [s]\n100,3600+\n120,1800\n140,900\n160,720\n")
    assert lives_of(datasets.read_runs(tmp_path / "u.csv")).times.tolist() == [60, 30, 15, 12]


def test_a_footnote_that_says_stopped_marks_run_outs(tmp_path):
    (tmp_path / "t.csv").write_text("# * test stopped\nV,T\n100,60*\n120,30\n140,15\n160,12\n")
    assert lives_of(datasets.read_runs(tmp_path / "t.csv")).side.tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([(V, 0.2, 1, T) for V, T in ((100, "60+"), (100, "60+"), (150, "20"), (150, "25"), (150, "22"), (150, "24"))],
         r"among the 4 lives that ended V is constant \(150 in all 4 rows\); run-outs bound its exponent on one side"),
        ([(V, 0.2, 1, T) for V, T in ((100, "60+"), (110, "60+"), (120, "60+"), (150, "20"), (160, "18"))],
         "2 of 5 lives ended, and 2 parameters"),
    ],
)  # fmt: skip
def test_lives_that_do_not_identify_the_law_are_refused(rows, says):
    with pytest.raises(FitError, match=says):
        fit.life_law(tool_runs(rows), ["V"])


def test_a_life_written_in_every_row_of_its_edge_counts_once():
    frame = tool_table()
    frame["edge"] = [f"E{i}" for i in range(12)]
    thrice = frame.loc[frame.index.repeat([3, 1, 2, *[4] * 9])].reset_index(drop=True)
    runs = datasets.runs_from_frame(thrice, judge=False)
    law, single = fit.life_law(runs), fit.life_law(tool_runs())
    assert law.nobs == 12
    np.testing.assert_allclose(law.theta, single.theta, rtol=1e-9)
    assert any("counts once" in note for note in law.notes)


def test_the_checks_of_least_squares_are_not_made_of_run_outs():
    found = fit.judge(fit.life_law(tool_runs()), runs=tool_runs())
    assert not found.checks["form"]
    assert "3 of 12 lives are known by a bound alone" in str(found.checks["form"])
    assert found.checks["exponents"].level == found.checks["run-outs"].level == "passed"
    assert found.checks["missing conditions"].level == "passed"
    assert [name for name, check in found.checks.items() if getattr(check, "concern", 0)] == ["extrapolated lives"]
    with pytest.raises(FitError, match="draws are of least squares"):
        fit.posterior(fit.life_law(tool_runs()))


def test_run_outs_do_not_hide_conditions_that_the_file_lacks():
    runs = datasets.runs_from_frame(tool_table()[["V", "T"]])
    found = fit.judge(fit.life_law(runs, ["V"]), runs=runs)
    assert "Feed f and depth of cut d are not in this file" in found.checks["missing conditions"].verdict


def test_run_outs_written_as_lives_are_seen():
    rows = [(*row[:3], row[3].rstrip("+")) for row in TABLE]
    found = fit.judge(fit.life_law(tool_runs(rows)))
    assert "3 lives are exactly 60 min" in found.checks["longest lives"].verdict
    assert found.verdict.level == 1


@pytest.mark.parametrize("distribution", ["weibull", "lognormal"])
def test_the_file_predicts_lives_as_the_fit_does(distribution, tmp_path):
    law = fit.life_law(tool_runs(), distribution=distribution)
    pf = parameters.collect(laws=[law])
    again = parameters.read(parameters.write(pf, tmp_path / "params.json")).laws["T"]
    assert (again.life.distribution, again.life.ended, again.life.run_outs) == (distribution, 9, 3)
    at = {"V": 150.0, "f": 0.2, "d": 1.5}
    for kind in ("mean", "prediction", "tolerance"):
        for centre in ("median", "mean"):
            one = law.predict(at, kind, centre=centre).to_frame().iloc[0]
            band = again.predict(kind=kind, centre=centre, **at)
            expected = one[["value", "low", "high"]].to_numpy(dtype=float)
            np.testing.assert_allclose([band.value, band.low, band.high], expected, rtol=1e-9)
    assert "for one life" in again.predict(**at).words


def simulated(seed, n=24, stop=60.0, bend=0.0, scatter=0.15):
    """Lives of a random design whose law has exponents -3.6, -1.2 and -.8, stopped at a time; text with marks."""
    rng = np.random.default_rng(seed)
    V, f, d = rng.uniform(110, 200, n), rng.uniform(0.1, 0.35, n), rng.uniform(0.8, 2.5, n)
    ln = 20.28 - 3.6 * np.log(V) - 1.2 * np.log(f) - 0.8 * np.log(d) - bend * np.log(V / 148) ** 2
    T = np.exp(ln + scatter * rng.standard_normal(n))
    return pd.DataFrame({"V": V, "f": f, "d": d, "T": [f"{t:.4g}" if t < stop else f"{stop:g}+" for t in T]})


def checks_of(frame, factors=("V", "f", "d")):
    law = fit.life_law(datasets.runs_from_frame(frame, judge=False), list(factors))
    return fit.judge(law).checks


def test_a_life_in_another_unit_is_found():
    frame = simulated(1)
    row = int(np.flatnonzero(~frame["T"].str.endswith("+"))[3])
    frame.loc[row, "T"] = f"{60 * float(frame.loc[row, 'T']):.4g}"
    found = checks_of(frame)["wrong rows"]
    assert found.level == "warning"
    assert f"line {row}" in found.verdict


def test_lives_that_bend_are_found():
    assert checks_of(simulated(2, bend=12.0))["curvature"].concern > 0
    assert checks_of(simulated(2))["curvature"].concern == 0


def test_checks_of_sound_lives_seldom_accuse():
    """Of 40 sound tables the curvature, at 5 %, is rejected in 0 to 6 (99 %); no table is called useless."""
    found = [checks_of(simulated(seed)) for seed in range(100, 140)]
    assert sum((one["curvature"].pvalue or 1) < 0.05 for one in found) <= 6
    assert sum(one["wrong rows"].concern for one in found) <= 4
    assert not any(one["predictive use"].concern for one in found)


def test_lives_without_a_law_are_not_to_be_used():
    frame = simulated(3)
    frame["T"] = np.random.default_rng(5).permutation(frame["T"])
    assert checks_of(frame)["predictive use"].concern == 2


def test_mostly_run_outs_are_a_reservation():
    frame = simulated(4, stop=12.0)
    assert checks_of(frame)["run-outs"].level == "warning"


def test_weibull_lives_can_be_asked_for(tmp_path, capsys):
    from fitmodels.cli import main

    tool_table().to_csv(tmp_path / "lives.csv", index=False)
    out = str(tmp_path / "out")
    assert main([str(tmp_path / "lives.csv"), "--form", "T=weibull", "--full", "--out", out]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "maximum likelihood of Weibull lives" in said
    assert "9 lives ended, 3 are run-outs" in said
    (path,) = (tmp_path / "out").glob("*/params.json")
    assert parameters.read(path).laws["T"].life.distribution == "weibull"


def test_run_outs_alone_and_lives_not_reached_are_refused_with_the_remedy(tmp_path):
    for cells in (["60+"] * 4, [">60"] * 4, ["not reached", "50", "21", "17"]):
        (tmp_path / "t.csv").write_text("\n".join(["V,T", *(f"{100 + 10 * i},{c}" for i, c in enumerate(cells))]))
        with pytest.raises(DataError, match=r"with a plus \(60\+\), and at least one life that ended"):
            datasets.read_runs(tmp_path / "t.csv")


def test_codes_that_look_reversed_are_a_doubt():
    frame = pd.DataFrame({"V": [100, 120, 140, 150, 160], "T": [60.0, 50, 21, 17, 12], "cens": [0, 1, 1, 1, 1]})
    runs = datasets.runs_from_frame(frame)
    assert any("all of them shorter than those that ended" in doubt.sentence for doubt in runs.doubts)
    assert any('--map "ended=cens"' in doubt.sentence for doubt in runs.doubts)
    reversed_ = datasets.runs_from_frame(frame, map={"ended": "cens"})
    assert lives_of(reversed_).side.tolist() == [1, 0, 0, 0, 0]
    assert not reversed_.doubts


def test_the_likelihood_has_its_maximum_in_every_table():
    """Of 300 tables of 16 lives, with and without run-outs, none is refused, and the gradient is zero."""
    from scipy.stats import norm

    rng = np.random.default_rng(8)
    for _ in range(300):
        Z = np.column_stack([np.ones(16), rng.normal(size=(16, 2))])
        y = Z @ [3.0, -1.0, 0.5] + rng.choice([0.02, 0.2, 1.0]) * rng.standard_normal(16)
        stop = rng.choice([2.8, 3.5, 9.0])
        side = (y > stop).astype(np.int8)
        if (side == 0).sum() < 5:
            continue
        found = fit_censored(Z, np.minimum(y, stop), side, "lognormal")
        z = (np.minimum(y, stop) - Z @ found.beta) / found.scale
        slope = np.where(side == 0, z, norm.pdf(z) / norm.sf(z))
        np.testing.assert_allclose(Z.T @ slope, 0, atol=1e-6)


def test_run_outs_beyond_all_lives_that_ended_are_a_reservation():
    """All four tests at V 150 ran out: no life is known below V 200, where the law would be used most."""
    ended = {200: (21.6, 25, 23.5, 22), 250: (9.1, 10.2, 9.6, 8.8), 300: (4.9, 4.4, 5, 4.7)}
    rows = [(150.0, "40+")] * 4 + [(float(V), str(T)) for V, lives in ended.items() for T in lives]
    found = run_outs(fit.life_law(datasets.runs_from_frame(pd.DataFrame(rows, columns=["V", "T"])), ["V"]))
    assert found.concern == 1
    assert "No life ended below V 200 m/min, where all 4 tests are run-outs" in found.verdict


def test_a_life_beyond_the_longest_test_is_named_as_extrapolated(tmp_path):
    """Three slow tests ran out at 60 min: at a tested setting the law predicts three times as long as any test."""
    lives = ["60+", "60+", "60+", "41", "38", "22.5", "21", "11.8", "10.9", "7.2", "7.4", "4.1"]
    rows = [
        (V, f, life)
        for (V, f), life in zip([(V, f) for V in range(120, 300, 30) for f in (0.2, 0.4)], lives, strict=True)
    ]
    runs = datasets.runs_from_frame(pd.DataFrame(rows, columns=["V", "f", "T"]).astype({"V": float}))
    law = fit.life_law(runs, ["V", "f"])
    verdict = fit.judge(law, runs=runs).checks["extrapolated lives"].verdict
    assert verdict.startswith(
        "EXTRAPOLATED at tested settings, up to 3.1 times the longest test: 185 min at V 120 m/min"
    )
    path = parameters.write(parameters.collect(tool="T", work="W", laws=[law]), tmp_path / "params.json")
    for predicts in (law, parameters.read(path).laws["T"]):
        found = predicts.predict(V=[120, 165, 200], f=0.2)
        assert found.inside.tolist() == [False, True, True]
        long, upper, short = found.words.splitlines()
        assert "EXTRAPOLATED: 3.1 times the longest test (60 min); do not rely on it" in long
        assert "inside the tested region, but the upper end is EXTRAPOLATED: the longest test lasted 60 min" in upper
        assert short.endswith("; inside the tested region.")


def test_a_life_at_a_criterion_that_no_test_reached_is_not_inside(tmp_path):
    law = fit.power_law(datasets.bundled("gc435_709m40"), "AW", ["V", "f", "d", "t"])
    largest = float(law.observed.max())
    for factor, reached in ((0.99, True), (1.01, False)):
        life = fit.tool_life(law, largest * factor)
        found = life.predict(V=400, f=0.3, d=2.0)
        assert found.value < found.longest
        assert ("EXTRAPOLATED: no test reached the criterion" in found.words) is not reached


def stopped(until=30.0):
    """30 lives at a wear of 0.3 mm, the tests stopped at 30 min and the lives not marked, with the wear at the end."""
    V, f, d = np.array([(V, f, d) for V in (140, 160, 180, 200, 230) for f in (0.12, 0.2, 0.3) for d in (1, 2.0)]).T
    T = 20 * (180 / V) ** 4 * (0.2 / f) ** 1.4 * (1.5 / d) ** 0.5
    T = T * np.exp(np.random.default_rng(4).normal(0, 0.15, 30))
    table = {
        "V": V,
        "f": f,
        "d": d,
        "T": np.minimum(T, until).round(2),
        "VB": (0.3 * np.minimum(1, until / T)).round(3),
    }
    return pd.DataFrame(table)


@pytest.mark.parametrize("columns", [["V", "f", "d", "T"], ["V", "f", "d", "T", "VB"]])
def test_run_outs_that_are_not_marked_come_before_what_follows_from_them(tmp_path, columns):
    """The tests bent the law, so that another form was the remedy; in that form the lives were a sensor at its limit.

    Stopped tests with little wear were to be left out, which makes the law of the others too short.
    """
    table = stopped()[columns]
    n = int((table["T"] == 30).sum())
    runs = datasets.runs_from_frame(table)
    found = fit.judge(fit.life_law(runs, ["V", "f", "d"]), runs=runs)
    assert found.verdict.reasons[0].startswith(f"{n} lives are exactly 30 min, the longest of all")
    assert "--leave-out" not in found.checks["longest lives"].verdict
    second = fit.judge(fit_in_form(runs, "second-order", "T", ("V", "f", "d")), runs=runs)
    assert second.checks["longest lives"].concern == 1
    assert "sensor limit" not in second.checks
    table.to_csv(tmp_path / "lives.csv", index=False)
    verdict = law_verdict(pf := analyse(tmp_path / "lives.csv").parameters, pf.laws["T"])
    ((why, remedy),) = main_reason(verdict)
    assert why.startswith(f"{n} lives are exactly 30 min")
    assert not remedy.command


def test_lives_that_ended_long_before_the_wear_of_the_others_are_named():
    V = np.repeat([100.0, 140, 180, 220], 4)
    T = 4e5 * V**-2 * np.exp(np.random.default_rng(6).normal(0, 0.05, len(V)))
    VB, broken = np.full(len(V), 0.3), [2, 9]
    T[broken], VB[broken] = T[broken] / 3, 0.12
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": 0.2, "T": T, "VB": VB}))
    law = fit.life_law(runs, ["V"])
    check = fit.judge(law, runs=runs).checks["longest lives"]
    assert check.concern == 1
    assert check.verdict.startswith("2 lives ended at VB 0.12 mm, most others at 0.3: not ended by wear")
    assert "--leave-out 'lines " in check.verdict
    whole = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": 0.2, "T": T, "VB": np.linspace(0.27, 0.33, len(V))}))
    assert fit.judge(fit.life_law(whole, ["V"]), runs=whole).checks["longest lives"].concern == 0


@pytest.mark.parametrize(("word", "doubted"), [("Bruch", True), ("chipped", True), ("VB", False)])
def test_a_life_that_a_breakage_ended_is_doubted(word, doubted):
    frame = pd.DataFrame({"V": [100, 100, 150, 150, 200, 200, 250, 250] * 2, "f": [0.1, 0.2] * 8})
    frame["T"] = 60.0 * (frame["V"] / 100) ** -2.5
    frame["end"] = ["not reached"] * 2 + [word] + ["VB"] * 13
    found = [one for one in datasets.runs_from_frame(frame).doubts if "ended by breakage" in one.sentence]
    assert len(found) == doubted


def test_few_lives_that_all_ended_are_no_run_outs():
    """Their few degrees of freedom are named by the explained variance; with a run-out, by the check of these."""
    table = pd.DataFrame({"V": [140.0, 160, 180, 200], "T": [48.8, 30.1, 20, 13.6]})
    assert run_outs(fit.life_law(datasets.runs_from_frame(table), ["V"])).level == "passed"
    found = run_outs(fit.life_law(datasets.runs_from_frame(table.assign(T=["48.8+", "30.1", "20", "13.6"])), ["V"]))
    assert found.level == "warning"
    assert found.verdict.startswith("Only 3 of 4 lives ended")
