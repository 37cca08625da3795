"""Forms of a law compared and chosen: known truths, published figures, statsmodels, and the command."""

import json

import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from fitmodels import batch, cli, datasets, fit
from fitmodels.core.errors import FitError, UsageError
from fitmodels.fit.censored_lives import left_out_lives
from fitmodels.fit.form_choice import CHOICES, aicc, fit_in_form, form_named, log_likelihood
from fitmodels.fit.left_out_edges import compare_laws, left_out_predictions
from fitmodels.fit.regression import fit_form, refitted
from fitmodels.pipeline import FitOptions
from scipy.stats import norm
from statsmodels.tools import sm_exceptions

SAME = 1e-6  # two optimisers of one likelihood
ROUNDING = 1e-9


def rows_of(form: str, edges: int = 18, seed: int = 5) -> pd.DataFrame:
    """Rows of edges at V, f and times t, whose true law has this form; level of an edge 4 %, of a row 2 %."""
    rng = np.random.default_rng(seed)
    V, f = (np.resize(np.array(x), edges) for x in ([100, 140, 200], [0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.4, 0.4, 0.4]))
    rows = []
    for edge in range(edges):
        level = 0.04 * rng.standard_normal()
        for t in (2.0, 5.0, 9.0, 14.0):
            truth = {
                "power": 0.02 * V[edge] ** 0.4 * f[edge] ** 0.3 * t**0.5,
                "linear": 0.02 + 0.0004 * V[edge] + 0.2 * f[edge] + 0.03 * t,
                "exponential": 0.05 * np.exp(0.004 * V[edge] + 1.5 * f[edge] + 0.08 * t),
            }[form]
            rows.append((f"E{edge}", V[edge], f[edge], t, truth * np.exp(level + 0.02 * rng.standard_normal())))
    return pd.DataFrame(rows, columns=["edge", "V", "f", "t", "VB"])


@pytest.mark.parametrize("form", ["power", "linear", "exponential"])
def test_the_true_form_is_preferred(form):
    runs = datasets.runs_from_frame(rows_of(form))
    found = compare_laws(runs, fit.power_law(runs, "VB", ["V", "f", "t"]), forms=["linear", "exponential"])
    assert found.preferred.name == form
    assert found.best.name == form
    assert found[form].weight > 0.99
    assert (found.left_out, found.units, found.rows) == ("edge", 18, 72)
    assert form in found.verdict


def test_a_form_without_need_is_not_preferred_and_the_agreement_is_stated():
    runs = datasets.runs_from_frame(rows_of("power"))
    found = compare_laws(runs, fit.power_law(runs, "VB", ["V", "f", "t"]), forms=["second-order"])
    assert found.preferred.name == found.default == "power"
    assert "is kept" in found.verdict
    assert sum(form.weight for form in found.forms) == pytest.approx(1)
    assert any("at most" in words and "mm" in words for words in found.remarks) == (len(found.supported) > 1)


@pytest.mark.parametrize("form", ["power", "linear", "second_order"])
def test_left_out_predictions_are_those_of_refits(form):
    runs = datasets.runs_from_frame(rows_of("power"))
    law = fit_form(runs, form, "VB", ["V", "f", "t"])
    codes = np.unique(law.edge, return_inverse=True)[1]
    found = left_out_predictions(law, codes)
    for g in (0, 7):
        without = refitted(law, law.error, codes != g)
        expected = law.formula.response_at(without.theta, law.design[codes == g])
        assert found[codes == g] == pytest.approx(expected, rel=ROUNDING)


def test_the_likelihood_with_a_level_of_each_edge_is_that_of_statsmodels():
    runs = datasets.runs_from_frame(rows_of("power"))
    law = fit.power_law(runs, "VB", ["V", "f", "t"])
    codes = np.unique(law.edge, return_inverse=True)[1]
    with pytest.warns(sm_exceptions.ConvergenceWarning, match="boundary"):  # it warns of any variance below .01
        theirs = sm.MixedLM(np.log(law.observed), law.design, groups=law.edge).fit(reml=False)
    assert log_likelihood(law.design, np.log(law.observed), codes) == pytest.approx(theirs.llf, rel=SAME)
    assert log_likelihood(law.design, law.residuals, codes) == pytest.approx(theirs.llf, rel=SAME)


def test_curvature_is_tested_by_f_and_not_by_left_out_rows_alone():
    """20 runs of a central composite design cannot tell errors of left-out rows apart; their squares are plain."""
    rng = np.random.default_rng(2)
    corners = [(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    stars = [tuple(1.68 * sign * (i == j) for j in range(3)) for i in range(3) for sign in (-1, 1)]
    x = np.array([*corners, *stars, *[(0, 0, 0)] * 6])
    V, f, d = 120 * 1.4 ** x[:, 0], 0.2 * 1.5 ** x[:, 1], 1.0 * 1.5 ** x[:, 2]
    Ra = np.exp(0.3 + 0.5 * x[:, 1] + 0.15 * x[:, 1] ** 2 - 0.1 * x[:, 0] + 0.03 * rng.standard_normal(20))
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": f, "d": d, "Ra": Ra}))
    found = fit.compare_laws(runs, "Ra ~ V, f, d")
    assert found.preferred.name == "second-order-reduced"
    form = found["second-order"]
    assert form.verdict == fit.judge(form.law, runs=runs).verdict
    assert form.verdict != fit.judge(form.law).verdict
    assert found["second-order"].pvalue < 1e-4


def test_rows_that_differ_in_a_factor_without_terms_are_runs_of_their_own():
    """The selection leaves d out; settings of V and f alone repeat, those of the tests do not."""
    levels = [(V, f, d) for V in (100.0, 150.0, 220.0) for f in (0.1, 0.2, 0.4) for d in (0.5, 1.0, 2.0)]
    V, f, d = np.array(levels).T
    scatter = 0.03 * np.random.default_rng(4).standard_normal(27)
    Ra = 2 * f * np.exp(-0.2 * np.log(V / 150) + 0.4 * np.log(f / 0.2) ** 2 + scatter)
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": f, "d": d, "Ra": Ra}))
    law = fit_in_form(runs, "second-order-reduced", "Ra", ("V", "f", "d"))
    assert law.factors == ("V", "f")
    assert fit.judge(law, runs=runs).checks["number of edges"].concern == 0


def test_aicc_of_forms_on_one_scale(measurements):
    """statsmodels 0.14 OLS with ``llf - sum(ln y)``: power law 332.333, second order in original units 343.616."""
    runs = datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv")
    power = fit_form(runs, "power", "Fx", ["V", "f", "d"], edge=None)
    original = fit_form(runs, "second_order_original", "Fx", ["V", "f", "d"], edge=None)
    assert aicc(power) == pytest.approx(332.333, abs=5e-4)
    assert aicc(original) == pytest.approx(343.616, abs=5e-4)
    llf = sm.OLS(np.log(power.observed), power.design).fit().llf - np.log(power.observed).sum()
    assert aicc(power) == pytest.approx(-2 * llf + 10 + 60 / 48, rel=ROUNDING)


def test_the_curved_force_is_seen(measurements):
    """The lack of fit of the power law of this force is known: F(23, 27) 2.41, p .015."""
    runs = datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv")
    found = fit.compare_laws(runs, "Fx ~ V, f, d")
    assert found.best.name == "second-order"
    assert found["second-order"].weight > 0.99
    assert found.preferred.name == "second-order"
    assert "second-order is preferred: error of left-out rows 3.32 %, against 4.11 % of power" in found.verdict
    assert fit.fit_law(runs, "Fx ~ V, f, d", form="second-order").theta == pytest.approx(found.best.law.theta)


def test_points_are_tested_settings_with_what_was_measured():
    runs = datasets.runs_from_frame(rows_of("power"))
    found = compare_laws(runs, fit.power_law(runs, "VB", ["V", "f", "t"]), forms=["linear"])
    corners = found.points.iloc[1:]
    assert {tuple(row) for row in corners[["V", "f", "t"]].to_numpy()} == {
        (V, f, t) for V in (100.0, 200.0) for f in (0.1, 0.4) for t in (2.0, 14.0)
    }
    data = runs.data
    for _, place in corners.iterrows():
        here = data[(data.V == place.V) & (data.f == place.f) & (data.t == place.t)]
        assert place.measured == pytest.approx(here.VB.mean())
        assert place.rows == len(here)
    assert (found.points["low"] < found.points["power"]).all()


def test_a_form_that_predicts_less_than_nothing_is_named():
    rows = rows_of("exponential")
    rows["VB"] = 0.001 * np.exp(8 * rows.f + 0.3 * rows.t)
    rows["VB"] *= np.exp(0.05 * np.random.default_rng(1).standard_normal(len(rows)))
    runs = datasets.runs_from_frame(rows)
    found = compare_laws(runs, fit.power_law(runs, "VB", ["f", "t"]), forms=["linear", "exponential"])
    assert found["linear"].not_positive > 0
    assert np.isinf(found["linear"].percent)
    assert found.preferred.name == "exponential"
    assert any("linear predicts VB of zero or less" in words for words in found.remarks)


def test_terms_are_selected_anew_without_each_edge():
    """Terms that were selected with all edges look better than they predict a new edge."""
    runs = datasets.runs_from_frame(rows_of("linear", seed=11))
    found = compare_laws(runs, "VB ~ V, f, t", forms=["second-order", "second-order-reduced"])
    reduced = found["second-order-reduced"]
    codes = np.unique(reduced.law.edge, return_inverse=True)[1]
    given = left_out_predictions(reduced.law, codes)
    assert reduced.error > np.sqrt(np.mean(np.log(reduced.law.observed / given) ** 2))
    assert reduced.weight == 0
    assert any("terms were selected by AICc" in words for words in found.remarks)
    assert compare_laws(runs, "VB ~ V, f, t", forms=["second-order-reduced"]).best.name == "second-order-reduced"


def test_forms_of_wear_and_rows_at_zero_wear():
    """A force to which wear adds: the additive form is found, and only it and its like can have rows at VB = 0."""
    rng = np.random.default_rng(4)
    rows = []
    for edge in range(14):
        f, level = [0.1, 0.2, 0.4][edge % 3], 0.02 * rng.standard_normal()
        for VB in (0.0, 0.05, 0.1, 0.2, 0.3):
            force = (1800 * f**0.75 + 1500 * VB) * np.exp(level + 0.01 * rng.standard_normal())
            rows.append((f"E{edge}", f, VB, force))
    runs = datasets.runs_from_frame(pd.DataFrame(rows, columns=["edge", "f", "VB", "Fc"]))
    found = fit.compare_laws(runs, "Fc ~ f, VB")
    assert found.preferred.name == "additive"
    additive = found["additive"]
    assert additive.law.params.to_numpy() == pytest.approx([1800, 0.75, 1500], rel=0.06)
    assert additive.more_rows == 14
    assert additive.more_error < 40
    assert any(
        "14 further rows have values of zero, which second-order, power cannot" in words for words in found.remarks
    )
    judged = fit.compare_forms(fit.fit_law(runs, "Fc ~ f, VB"), runs)
    assert "Keep it with --form Fc=additive" in judged.verdict


def test_kienzle_is_a_form_of_forces():
    rng = np.random.default_rng(0)
    rows = [(V, f, d) for V in (100.0, 200.0) for f in (0.1, 0.2, 0.4) for d in (1.0, 2.0)]
    frame = pd.DataFrame(rows, columns=["V", "f", "d"])
    frame["Fc"] = 1780 * frame.d * frame.f**0.74 * np.exp(0.02 * rng.standard_normal(len(frame)))
    runs = datasets.runs_from_frame(frame)
    found = fit.compare_laws(runs, "Fc ~ V, f, d")
    assert found["kienzle"].parameters == 2
    assert found["kienzle"].weight > found["power"].weight
    law = fit.fit_law(runs, "Fc ~ V, f, d", form="kienzle")
    assert law.params["d"] == 1
    assert any("has no V" in note for note in law.notes)
    frame["Ra"] = frame.Fc / 1000
    with pytest.raises(FitError, match="a form of cutting forces"):
        fit.fit_law(datasets.runs_from_frame(frame.drop(columns="Fc")), "Ra ~ V, f, d", form="kienzle")


def test_names_of_forms():
    assert form_named("Second_Order").name == "second-order"
    with pytest.raises(UsageError, match="Did you mean 'exponential'"):
        form_named("exponentiell")
    assert CHOICES["taylor"].unsuited("Ra", ("V", "f"))
    assert CHOICES["power-exponential"].unsuited("Fc", ("V", "f"))
    assert not CHOICES["power-exponential"].unsuited("Fc", ("V", "f", "VB"))
    with pytest.raises(UsageError, match="no such response"):
        FitOptions(form={"Rx": "linear"})
    assert FitOptions(form={"Ra": "linear", "*": "power"}).recorded()["form"] == ["Ra=linear", "*=power"]


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "data.csv"
    rows_of("linear").to_csv(path, index=False)
    return path


def test_the_command_prints_and_writes_the_form(table, tmp_path, capsys):
    assert cli.main(["compare", str(table)]) == 0
    said = capsys.readouterr().out
    assert "linear is preferred" in said
    assert f"fitmodels {table} --form VB=linear" in said
    assert "error, %" in said
    out = tmp_path / "out"
    assert cli.main(["compare", str(table), "--write", "VB=linear", "--out", str(out)]) == 0
    (params,) = out.rglob("params.json")
    held = json.loads(params.read_text())
    assert held["laws"]["VB"]["form"] == "linear"
    assert held["provenance"]["options"]["form"] == ["VB=linear"]
    assert "--form VB=linear" in held["provenance"]["command"]


def test_the_comparison_as_json(table, capsys):
    assert cli.main(["compare", str(table), "--json"]) == 0
    held = json.loads(capsys.readouterr().out)
    assert held["schema"] == "fitmodels.compare/1"
    (law,) = held["pairs"][0]["laws"]
    assert law["preferred"] == "linear"
    assert {form["form"] for form in law["forms"]} >= {"power", "linear", "exponential"}


def test_refusals_of_the_command(table, capsys):
    assert cli.main(["compare", str(table), "--out", "x"]) == 2
    assert "only --write writes" in capsys.readouterr().err
    assert cli.main([str(table), "--form", "linaer", "--json"]) == 2
    assert "Did you mean 'linear'" in capsys.readouterr().err
    assert cli.main([str(table), "--form", "VB=taylor", "--json"]) == 4
    assert "it is the form of tool lives T" in capsys.readouterr().err


def test_lives_with_run_outs_are_lives_of_the_power_law_alone():
    lives = [60, 60, 44.5, 21.6, 60, 37.5, 24.9, 10.6, 43.0, 36.4, 51.5, 50.4]
    V = [120, 120, 180, 180, 120, 120, 180, 180, 147, 147, 147, 147]
    f = [0.15, 0.3, 0.15, 0.3, 0.15, 0.3, 0.15, 0.3, 0.212, 0.212, 0.212, 0.212]
    marks = [f">{life}" if life == 60 else f"{life}" for life in lives]
    runs = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": f, "T": marks}))
    taylor = fit.fit_law(runs, "T ~ V, f", form="taylor")
    assert taylor.life.run_outs == 3
    with pytest.raises(FitError, match="3 of 12 lives are run-outs or bounds"):
        fit.fit_law(runs, "T ~ V, f", form="linear")
    with pytest.raises(FitError, match="fitmodels compare scores such laws by the likelihood of left-out lives"):
        fit.compare_laws(runs, "T ~ V, f")


def censored_lives(rng, deviation, longest=60.0, copies=12):
    """Lives about a Taylor law at four speeds, run-outs at the longest test."""
    V = np.repeat([100.0, 140, 190, 250], copies)
    T = 6 * (250 / V) ** 3 * np.exp(deviation(rng, len(V)))
    return pd.DataFrame({"V": V, "T": [f">{longest:g}" if one > longest else f"{one:.6g}" for one in T]})


def test_scores_of_left_out_lives_are_densities_of_the_lives_and_probabilities_of_lasting_longer():
    table = censored_lives(np.random.default_rng(3), lambda rng, n: rng.normal(0, 0.2, n), copies=4)
    runs = datasets.runs_from_frame(table)
    found = left_out_lives(fit.life_law(runs, ["V"]))
    bound = table["T"].str.startswith(">").to_numpy()
    y = np.log(table["T"].str.lstrip(">").astype(float))
    for row in (int(np.flatnonzero(bound)[0]), int(np.flatnonzero(~bound)[-1])):
        law = fit.life_law(datasets.runs_from_frame(table.drop(index=row)), ["V"])
        z = (y[row] - np.log(law.values({"V": table["V"][row]}))) / law.life.scale
        score = norm.logsf(z) if bound[row] else norm.logpdf(z) - np.log(law.life.scale)
        assert found.scores[row, 0] == pytest.approx(float(np.ravel(score)[0]), abs=1e-8)


def test_the_distribution_of_the_lives_is_found_among_run_outs(tmp_path, capsys):
    """Simulated: Weibull lives of shape 2 and lognormal ones, a quarter of them run-outs."""
    weibull = censored_lives(np.random.default_rng(5), lambda rng, n: np.log(rng.weibull(2.0, n)), copies=60)
    found = left_out_lives(fit.life_law(datasets.runs_from_frame(weibull), ["V"]))
    assert found.better == ("weibull",)
    assert found.verdict.endswith("keep it with --form weibull.")
    lognormal = censored_lives(np.random.default_rng(6), lambda rng, n: rng.normal(0, 0.4, n))
    table = tmp_path / "lives.csv"
    lognormal.to_csv(table, index=False)
    assert cli.main(["compare", str(table)]) == 0
    out = capsys.readouterr().out
    assert "power with lognormal lives is kept" in out
    assert "laws of lives with run-outs, scored on 48 left-out rows" in out
    assert cli.main(["compare", str(table), "--json"]) == 0
    (lives,) = json.loads(capsys.readouterr().out)["pairs"][0]["lives"]
    assert lives["better"] == []


def test_a_batch_keeps_the_form_of_each_pair(tmp_path):
    frames = [rows_of("linear", seed=seed).assign(tool=f"T{seed}", work="W") for seed in (1, 2)]
    source = tmp_path / "pairs.csv"
    pd.concat(frames).to_csv(source, index=False)
    found = batch.run(source, tmp_path / "out", options=FitOptions(form={"VB": "linear"}), files=False)
    assert found.results["form"].tolist() == ["linear", "linear"]
    one = fit.fit_law(next(datasets.read_runs(source).pairs()), "VB ~ V, f, t", form="linear")
    assert found.results["params_t"].iloc[0] == pytest.approx(one.params["t"])
