"""Tool life from a wear law, against a root of the law itself and against Monte Carlo."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.core.intervals import fieller, t_quantile
from fitmodels.fit.life import life_verdict
from fitmodels.parameters.gather.lives import tool_life_section
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
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
    life = fit.tool_life(law, criterion).values(V=V, f=f, d=d)
    root = brentq(
        lambda ln_t: law.values({"V": V, "f": f, "d": d, "t": np.exp(ln_t)}) - criterion,
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
    C = [V * life.values(V=V) ** life.taylor_n for V in (60, 120, 180)]
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


def test_one_quantile_of_t_serves_a_law_without_degrees_of_freedom_too():
    law = wear_law()
    assert law.t_quantile(0.9) == t_quantile(law.df, 0.9) == pytest.approx(stats.t.ppf(0.95, law.df), rel=1e-12)
    assert t_quantile(0) == pytest.approx(12.7062, abs=5e-5)  # tables of t on one degree of freedom


def test_what_is_reported_beside_the_law():
    law = wear_law()
    life = fit.tool_life(law)
    assert (life.wear, life.criterion, life.unit_of_wear, life.unit) == ("AW", 0.3, "mm", "min")
    assert list(life.coefficients.index) == ["c0", "V", "f", "d"]
    assert life.t_observed == 20
    middle = {"V": 100.0, "f": 0.19, "d": 2.12}  # geometric means of the ranges, to three digits as they are printed
    assert life.typical_at == middle
    assert life.taylor.at == {"f": 0.19, "d": 2.12}
    assert life.typical == pytest.approx(life.values(**middle), rel=1e-12)
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
        (by_material, 0.3, "a law by 'work' has no tool life: fit each level alone"),
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
        ({"V": 100, "f": float("nan"), "d": 2}, "f = nan: give a finite number"),
    ],
)
def test_conditions_without_a_life_are_refused(at, says):
    with pytest.raises(errors.FitError, match=says):
        fit.tool_life(wear_law()).values(**at)


def test_fieller_is_the_set_of_roots_that_a_test_does_not_reject():
    """Each end, by a root search of the t statistic of ``a + b u``; an open interval where b may be zero."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        A = rng.normal(size=(2, 2))
        C = A @ A.T
        a, b = rng.normal(), rng.choice([-1, 1]) * rng.uniform(2.2, 8) * np.sqrt(C[1, 1])
        found = fieller(a, b, (C[0, 0], C[0, 1], C[1, 1]), 2.1)

        def excess(u, a=a, b=b, C=C):
            return (a + b * u) ** 2 - 2.1**2 * (C[0, 0] + 2 * u * C[0, 1] + u * u * C[1, 1])

        assert found.low < found.value < found.high
        assert found.g == pytest.approx(2.1**2 * C[1, 1] / b**2)
        for end in (found.low, found.high):
            assert excess(end) == pytest.approx(0, abs=1e-7 * (1 + end**2) * (b * b + C[1, 1]))
        assert excess(found.value) < 0
    open_above = fieller(-2.0, 1.0, (0.01, 0.0, 0.3), 2.1)
    assert open_above.g > 1
    assert (open_above.high, round(open_above.low, 3)) == (np.inf, 0.921)
    assert fieller(-0.1, 0.1, (1.0, 0.0, 1.0), 2.1).low == -np.inf


def test_the_interval_of_a_life_is_that_of_times_whose_wear_the_law_does_not_exclude():
    """Ends of the interval of the law: there its interval of the wear has the criterion as an end."""
    law = wear_law()
    life = fit.tool_life(law, 0.3)
    at = {"V": 150.0, "f": 0.3, "d": 2.0}
    low, high = life.interval("law", **at)
    assert low < life.values(**at) < high
    for t, end in ((low, "high"), (high, "low")):
        assert law.predict({**at, "t": t}, "mean").to_frame()[end].iloc[0] == pytest.approx(0.3, rel=1e-9)
    edge_low, edge_high = life.interval("edge", **at)
    assert edge_low < low < high < edge_high


def test_taylors_constants_have_the_intervals_of_their_ratios():
    """n = k/a against 100 000 draws of both: the ends are the quantiles of the ratio to 1 %."""
    law = wear_law()
    found = fit.tool_life(law).taylor
    assert found.n == pytest.approx(law.params["t"] / law.params["V"], rel=1e-12)
    rng = np.random.default_rng(11)
    k, a = law.names.index("t"), law.names.index("V")
    draws = rng.multivariate_normal(law.theta, law.covariance(), size=100_000)
    np.testing.assert_allclose(found.n_interval, np.quantile(draws[:, k] / draws[:, a], [0.025, 0.975]), rtol=0.01)
    at = {**found.at, "V": found.C}
    assert fit.tool_life(law).values(**at) == pytest.approx(1.0, rel=1e-9)
    assert found.C_interval[0] < found.C < found.C_interval[1]


def worn(exponent=0.6, scatter=0.02, seed=2, speeds=(100, 140, 180), until=80, bend=0.0):
    """Runs of wear curves of known lives: four edges at each of three speeds."""
    rng = np.random.default_rng(seed)
    rows = []
    for V in speeds:
        for copy in range(4):
            life = 40 * (V / 140) ** -2.5 * np.exp(rng.normal(0, 0.03))
            t = np.linspace(4, until, 12)
            ln = exponent * np.log(t / life) + bend * np.maximum(t / life - 0.8, 0) + rng.normal(0, scatter, 12)
            rows += [{"edge": f"{V}-{copy}", "V": V, "t": x, "VB": y} for x, y in zip(t, 0.3 * np.exp(ln), strict=True)]
    return datasets.runs_from_frame(pd.DataFrame(rows), judge=False)


def test_lives_of_wear_curves_are_those_of_the_simulated_edges():
    law = fit.power_law(worn(scatter=1e-4), "VB", ["V", "t"])
    found = fit.wear_curve_lives(law, 0.3)
    lives = found.to_frame().set_index("edge")
    crossed = lives[lives["reached"] == "interpolated"]
    assert (found.count("interpolated"), found.count("extrapolated")) == (8, 4)
    np.testing.assert_allclose(crossed["curve"], crossed["law"], rtol=0.02)
    assert (lives.loc[lives["reached"] == "extrapolated", "curve"] == 80).all()
    assert found.law.life.run_outs == 4
    assert found.law.params["V"] == pytest.approx(-2.5, abs=0.2)


def test_wear_curves_that_agree_and_that_bend():
    agree = fit.wear_curve_lives(fit.power_law(worn(until=160), "VB", ["V", "t"]), 0.3)
    assert agree.ratio_interval[0] < 1 < agree.ratio_interval[1]
    assert agree.sentences[1].endswith("they agree.")
    bent = fit.wear_curve_lives(fit.power_law(worn(bend=1.5), "VB", ["V", "t"]), 0.45)
    assert "trust the interpolated lives" in bent.sentences[1]


def test_scatter_that_crosses_early_is_distinguished_from_a_bend():
    """Flat wear: exponent .25 with 8 % of scatter, as in table 3.2 of Meeker-like studies; here by simulation."""
    law = fit.power_law(worn(exponent=0.2, scatter=0.12, until=160), "VB", ["V", "t"])
    found = fit.wear_curve_lives(law, 0.3)
    assert found.expected < 0.95
    assert found.ratio == pytest.approx(found.expected, abs=0.15)
    assert "the lives of the wear law are the better ones" in found.sentences[1]


def test_wear_curves_need_edges():
    with pytest.raises(errors.FitError, match="name the edges with --edge"):
        fit.wear_curve_lives(wear_law())


def test_a_file_gives_the_life_of_the_fit_with_its_interval(tmp_path, capsys):
    from fitmodels import parameters
    from fitmodels.cli import main
    from fitmodels.parameters.evaluation import IntervalOptions
    from fitmodels.parameters.prediction import predict_life

    law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    life = fit.tool_life(law, 0.3)
    pf = parameters.read(parameters.write(parameters.collect(laws=[law], tool_life=life), tmp_path / "params.json"))
    at = {"V": 150.0, "f": 0.3, "d": 2.0}
    for kind, of in (("mean", "law"), ("prediction", "edge")):
        one = predict_life(pf.laws["AW"], pf.tool_life, IntervalOptions(kind), at)
        np.testing.assert_allclose(
            [one.value, one.low, one.high], [life.values(**at), *life.interval(of, **at)], rtol=1e-9
        )
    assert pf.tool_life.taylor.n == life.taylor.n
    assert len(pf.tool_life.curves.lives) == 24
    assert main(["predict", str(tmp_path / "params.json"), "T", "V=150", "f=0.3", "d=2"]) == 0
    assert "95 % interval of one new edge, by Fieller's theorem" in " ".join(capsys.readouterr().out.split())


def test_an_interval_that_is_not_bounded_is_said_to_be_so(tmp_path):
    """Two readings of each of six edges, of wear that hardly grows against its scatter."""
    from fitmodels import parameters
    from fitmodels.parameters.evaluation import IntervalOptions
    from fitmodels.parameters.prediction import predict_life

    rng = np.random.default_rng(1)
    rows = [{"edge": str(e), "V": 100.0 + 20 * (e % 3), "t": t, "VB": 0.1 * t**0.1 * np.exp(rng.normal(0, 0.2))}
            for e in range(6) for t in (5.0, 8.0)]  # fmt: skip
    law = fit.power_law(datasets.runs_from_frame(pd.DataFrame(rows), judge=False), "VB", ["V", "t"])
    life = fit.tool_life(law, 0.2)
    assert life.interval("law", V=120.0)[1] == np.inf
    pf = parameters.collect(laws=[law], tool_life=life)
    one = predict_life(pf.laws["VB"], pf.tool_life, IntervalOptions("mean"), {"V": 120.0})
    assert "not bounded" in one.words
    assert one.facts()["high"] is None
    parameters.write(pf, tmp_path / "params.json")


def test_curves_that_contradict_the_law_qualify_the_tool_life():
    from fitmodels import parameters

    for bend, level in ((1.5, 1), (0.0, 0)):
        runs = worn(bend=bend, until=100)
        law = fit.power_law(runs, "VB", ["V", "t"])
        section = parameters.collect(laws=[law], tool_life=fit.tool_life(law, 0.45 if bend else 0.3)).tool_life
        assert any("trust the interpolated lives" in reason for reason in section.verdict.reasons) == bool(level)
        assert section.verdict.concern >= level


def law_of_edges(edges, *, between=0.15, seed=3, factors=("V", "t")):
    """A wear law of edges at these speeds, read seven times each; edges deviate, and readings scatter by 4 %."""
    rng, times = np.random.default_rng(seed), (1, 2, 4, 7, 10, 14, 18)
    levels = [(V, np.exp(rng.normal(0, between))) for V in edges]
    rows = [{"edge": str(i), "V": V, "f": 0.2, "t": t, "VB": 0.3 * (V / 180) * (t / 15) ** 0.6 * u * np.exp(e)}
            for i, (V, u) in enumerate(levels) for t, e in zip(times, rng.normal(0, 0.04, 7), strict=True)]  # fmt: skip
    return fit.power_law(datasets.runs_from_frame(pd.DataFrame(rows), judge=False), "VB", list(factors))


UNKNOWN_SCATTER = {"one edge": ([180.0], ("t",)), "two edges at two speeds": ([150.0, 200.0], ("V", "t"))}


@pytest.mark.parametrize(("edges", "factors"), UNKNOWN_SCATTER.values(), ids=UNKNOWN_SCATTER)
def test_rows_of_one_edge_give_no_interval_of_the_next(edges, factors):
    """Readings scatter by 4 %, edges by 15 %: the former say nothing of the latter."""
    from fitmodels import parameters
    from fitmodels.cards.content.tool_life import tool_life_part
    from fitmodels.fit.decisions import life_decision
    from fitmodels.fit.next_tests import next_runs
    from fitmodels.fit.optimal_tests import narrowing
    from fitmodels.parameters.evaluation import IntervalOptions
    from fitmodels.parameters.prediction import predict_life

    law = law_of_edges(edges, factors=factors)
    life, at = fit.tool_life(law, 0.3), {"V": 170.0} if "V" in factors else {}
    assert life.interval("edge", **at) == (0.0, np.inf)
    assert np.isfinite(life.interval("law", **at)).all()
    pf = parameters.collect(laws=[law], tool_life=life)
    one = predict_life(pf.laws["VB"], pf.tool_life, IntervalOptions("prediction"), at)
    assert (one.low, one.high) == (0.0, np.inf)
    assert "the scatter between edges is not known" in one.words
    part = tool_life_part(pf)
    assert (part.edge_low.text, part.edge_high.text) == ("", "")
    assert "none for one new edge: the scatter between edges is not known" in " ".join(part.words)
    decision = life_decision(law, 0.3, at)
    words = " ".join(narrowing(law, decision, next_runs(law, 2).attrs["readings"], within=0.5).words)
    assert "No interval of one new edge" in words
    assert "Stop" not in words


def test_rows_of_one_edge_each_scatter_as_edges_do():
    rows = pd.DataFrame(law_of_edges([150.0, 165, 180, 200, 220], seed=5).rows.X, columns=["V", "t"]).iloc[::4]
    y = 0.3 * (rows["V"] / 180) * (rows["t"] / 15) ** 0.6 * np.exp(np.random.default_rng(1).normal(0, 0.1, len(rows)))
    frame = rows.assign(VB=y, edge=[f"E{i}" for i in range(len(rows))])
    laws = [fit.power_law(datasets.runs_from_frame(one, judge=False), "VB", ["V", "t"])
            for one in (frame, frame.drop(columns="edge"))]  # fmt: skip
    named, unnamed = (fit.tool_life(law, 0.3) for law in laws)
    assert named.interval("edge", V=180.0) == unnamed.interval("edge", V=180.0)
    assert "of one new edge," in named.predict({"V": 180.0}).of
    assert "of one row," in unnamed.predict({"V": 180.0}).of


def test_lives_by_the_curves_outside_the_interval_of_the_law_leave_none():
    """Wear that bends at its end: its misfit in time hides the scatter between edges, whose SD is estimated as 0."""
    from fitmodels import parameters
    from fitmodels.cards.content.tool_life import life_doubt
    from fitmodels.fit.decisions import life_decision
    from fitmodels.parameters.evaluation import IntervalOptions
    from fitmodels.parameters.prediction import edge_scatter, predict_life

    rng, rows = np.random.default_rng(600), []
    for i, V in enumerate([140.0, 160, 180, 200, 220] * 3):
        t = np.arange(2.0, 40, 3)
        s = (V / 180) ** 2 * t / 15
        wear = 0.08 * (1 - np.exp(-s / 0.08)) + 0.16 * s + 1.2 * np.maximum(0, s - 0.75) ** 2
        wear *= np.exp(rng.normal(0, 0.08) + rng.normal(0, 0.05, len(t)))
        last = int(np.argmax(wear >= 0.8)) or len(t)
        rows += [{"edge": str(i), "V": V, "t": a, "VB": b} for a, b in zip(t[:last], wear[:last], strict=True)]
    law = fit.power_law(datasets.runs_from_frame(pd.DataFrame(rows), judge=False), "VB", ["V", "t"])
    pf = parameters.collect(laws=[law], tool_life=fit.tool_life(law, 0.3))
    wear_section, life = pf.laws["VB"], pf.tool_life
    assert edge_scatter(wear_section, life)[0] == np.inf
    assert "trust the wear curves: 1" in life_doubt(pf)
    one = predict_life(wear_section, life, IntervalOptions("prediction"), {"V": 180.0})
    assert (one.low, one.high) == (0.0, np.inf)
    assert "lives read from the wear curves are" in one.words
    assert "outside its interval" in life_decision(law, 0.3).no_edge


def test_a_life_that_rounds_to_the_longest_test_is_not_extrapolated():
    from fitmodels import parameters
    from fitmodels.cards.content.tool_life import tool_life_part
    from fitmodels.fit.life import life_verdict
    from fitmodels.parameters.evaluation import IntervalOptions
    from fitmodels.parameters.prediction import predict_life

    law = law_of_edges([150.0, 165, 180, 200, 220, 240] * 2, between=0.08)
    for ratio, beyond in ((1.02, False), (1.2, True)):
        criterion = 0.3 * (ratio * 18 / float(fit.tool_life(law, 0.3).typical)) ** law.params["t"]
        life = fit.tool_life(law, float(criterion))
        assert life.typical == pytest.approx(ratio * 18)
        said = " ".join(life_verdict(life, law).reasons)
        assert (f"{ratio:.2g} times the longest test" in said) == beyond
        pf = parameters.collect(laws=[law], tool_life=life)
        assert tool_life_part(pf).extrapolated == beyond
        found = predict_life(pf.laws["VB"], pf.tool_life, IntervalOptions("mean"), life.typical_at)
        assert ("times the longest test" in found.words) == beyond
        assert found.inside != beyond
        assert bool(life.predict(life.typical_at, "mean").inside) != beyond


def test_a_life_from_readings_known_as_at_least_the_criterion_is_not_called_unreached(tmp_path):
    rng = np.random.default_rng(2)
    rows = ["edge,V [m/min],f [mm/rev],d [mm],t [min],VB [mm]"]
    for k, (V, f) in enumerate([(100, 0.1), (100, 0.3), (150, 0.2), (200, 0.1), (200, 0.3), (150, 0.1), (150, 0.3)]):
        level = np.exp(rng.normal(0, 0.05))
        for t in (2, 6, 12, 20, 30):
            wear = 0.01 * V**0.5 * f**0.2 * t**0.45 * level * np.exp(rng.normal(0, 0.02))
            rows.append(f"E{k},{V},{f},2,{t},{'>0.3' if wear > 0.3 else round(wear, 3)}")
    (tmp_path / "t.csv").write_text("\n".join(rows))
    runs = datasets.read_runs(tmp_path / "t.csv")
    assert runs.marked("VB", ">") > 3
    assert "a law without them understates VB" in runs.doubts[0].sentence
    law = fit.power_law(runs, "VB", ["V", "f", "t"])
    life = fit.tool_life(law, 0.3)
    assert "No test reached" in str(life_verdict(life, law).reasons)
    assert "No test reached" not in str(life_verdict(life, law, runs).reasons)
    assert tool_life_section(life, [law], None, runs)["curves"] is None
