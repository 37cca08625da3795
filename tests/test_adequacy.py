"""All checks together: degenerate designs, and the order of their sentences."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.core.errors import UsageError
from fitmodels.fit.checks.autocorrelation import drift
from fitmodels.fit.checks.strata import MOST_ROWS, split
from fitmodels.fit.checks.usefulness import number_of_edges
from hypothesis import example, given, settings
from hypothesis import strategies as st

FACTORS = ["V", "f", "d", "t"]


def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def wear(edges=6, per_edge=4, noise=0.05, between=0.05, seed=1, **columns):
    """A small wear test; ``columns`` stand in for what is drawn."""
    rng = np.random.default_rng(seed)
    at = np.repeat(np.arange(edges), per_edge)
    frame = pd.DataFrame({"V": rng.uniform(50, 200, edges)[at], "f": rng.uniform(0.1, 0.5, edges)[at]})
    frame["t"] = np.tile(np.arange(1.0, per_edge + 1), edges)
    frame = frame.assign(**columns)
    level = between * rng.normal(size=edges)[at] + noise * rng.normal(size=len(at))
    frame["AW"] = 0.01 * frame["V"] ** 0.5 * frame["f"] ** 0.2 * frame["t"] ** 0.3 * np.exp(level)
    frame["edge"] = [f"E{g}" for g in at]
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V", "f", "t"])


def without_edges(n, noise=0.05, **columns):
    law = wear(n, 1, noise, t=np.linspace(1, 9, n) ** 1.3, **columns)
    return law.with_rows(edge=None)


def figures(found):
    for check in found.checks.values():
        if isinstance(check, fit.NotAvailable):
            assert len(str(check)) > 15
        else:
            yield check


def assert_in_words(found):
    """No NaN, no infinity, a null and a verdict to everything."""
    for check in figures(found):
        assert math.isfinite(check.statistic)
        assert check.pvalue is None or 0 <= check.pvalue <= 1
        assert check.concern in (0, 1, 2)
        assert check.null
        assert check.result or not check.symbol
        assert check.verdict.endswith(".")
        assert not {"nan", "inf"} & set(check.verdict.replace("(", " ").replace(",", " ").split())
    said = found.verdicts()
    assert 1 <= len(said) <= 6
    assert all(sentence.endswith(".") and sentence[0].isupper() for sentence in said)


def alike(edges, *settings):
    """Values of edges in turn, four rows each."""
    return np.repeat(np.resize(settings, edges), 4)


DEGENERATE = {
    "one edge": (lambda: wear(1, 12, V=np.geomspace(50, 200, 12), f=np.tile([0.1, 0.2, 0.3], 4)), "from one edge"),
    "as many edges as parameters": (lambda: wear(3), "3 edges for 3 parameters that vary between edges only"),
    "no replicated edges": (lambda: wear(8), "no two edges were tested at the same conditions"),
    "a factor within edges": (
        lambda: wear(4, 6, V=np.tile([50.0, 80, 120, 150, 180, 200], 4), f=np.tile([0.1, 0.3, 0.2], 8)),
        "every factor changes within the edges",
    ),
    "a perfect law": (lambda: wear(6, noise=0.0, between=0.0), "fits every row exactly"),
    "rows exact within edges": (lambda: wear(8, noise=0.0, between=0.1), "no variance within edges"),
    "an edge alone": (
        lambda: wear(6, V=alike(6, 80.0, 80, 80, 80, 80, 160), f=alike(6, *np.linspace(0.1, 0.5, 6))),
        "edge E5 alone determines a parameter",
    ),
    "rows equal parameters": (lambda: without_edges(4), "4 observations fix 4 parameters exactly"),
    "one row left over": (lambda: without_edges(5), "no two rows were measured at the same conditions"),
    "two rows an edge": (lambda: wear(10, 2), "three or more"),
    "a row an edge": (lambda: wear(10, 1, t=np.linspace(1, 9, 10) ** 1.3), "no two rows were measured"),
    "settings equal parameters": (
        lambda: wear(6, V=alike(6, 60.0, 120, 180), f=alike(6, 0.1, 0.3, 0.15)),
        "3 settings leave no degrees of freedom",
    ),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_designs_answer_in_words(name):
    make, words = DEGENERATE[name]
    law = make()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fit.judge(law)
        assert_in_words(found)
        reported = " ".join(found.verdicts(20))
        reasons = " ".join(str(c) for c in found.checks.values() if isinstance(c, fit.NotAvailable))
    assert words in reported + reasons


def test_edges_without_a_variance_between_them_are_tested():
    V, f = alike(10, 60.0, 80, 120, 150, 180), alike(10, 0.1, 0.3, 0.2, 0.4, 0.15)
    law = wear(10, noise=0.1, between=0.0, V=V, f=f)
    level = np.repeat(np.log(law.observed).reshape(10, 4).mean(axis=1), 4)
    Z = law.formula.design(law.X, law.shifts)
    # edges stand nearer to the law than their rows' scatter would let them: the variance between is put at zero
    y = np.log(law.observed) - level + (Z @ law.theta).reshape(10, 4).mean(axis=1).repeat(4)
    y += np.repeat(np.resize([1e-3, -1e-3, 2e-3], 10), 4)
    fitted = fit.linear(Z, y)
    r = y - Z @ fitted.params
    law = law.with_rows(theta=fitted.params, observed=np.exp(y), residuals=r, rss=float(r @ r), tss=fitted.tss)
    assert split(law).icc == 0.0
    found = fit.judge(law)
    assert_in_words(found)
    assert found.checks["form"].df == (2, 5)
    assert found.checks["single edges"].units == "edges"


def test_replicates_that_are_copies_are_no_pure_error():
    """Only three of the four settings are repeated, so that the file is not one written twice."""
    V = np.array([60.0, 60, 90, 90, 120, 120, 180])
    frame = pd.DataFrame({"V": V, "AW": 0.1 * V**0.5 * np.array([1.0, 1.0, 1.1, 1.1, 0.9, 0.9, 1.05])})
    law = fit.power_law(datasets.runs_from_frame(frame), "AW", ["V"])
    assert (law.repeats, law.nobs) == (1, 7)
    assert "they are copies without pure error" in str(fit.judge(law).checks["form"])


@pytest.mark.parametrize("response", ["AW", "P", "Fxz"])
@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_every_check_answers_on_ordinary_data(response, error):
    factors = FACTORS if response == "AW" else [*FACTORS, "AW"]
    found = fit.judge(fit.power_law(bundled(), response, factors, error=error))
    assert_in_words(found)
    missing = [name for name, check in found.checks.items() if isinstance(check, fit.NotAvailable)]
    schedule = ["time between edges"] if response == "AW" else []  # all edges were measured at the same times
    assert sorted(missing) == sorted((["scale of the response"] if error == "additive" else []) + schedule)
    assert not found.rows_are_independent


def test_lines_and_exponentials_are_checked_too():
    line = fit.load_law(datasets.read_runs(datasets.bundled("clm2023_end_milling")))
    roughness = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    for law in (line, roughness):
        found = fit.judge(law)
        assert_in_words(found)
        assert found.rows_are_independent
    assert fit.judge(line).checks["scale of the response"].of_law == 1


def test_the_worst_comes_first_and_the_good_in_one_sentence(measurements):
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    found = fit.judge(fit.power_law(runs, "VB", ["t", "f", "d"], by="material"))
    said = found.verdicts()
    concern = {check.verdict: check.concern for check in figures(found)}
    order = [concern[sentence] for sentence in said if sentence in concern]
    assert order == sorted(order, reverse=True)
    assert order[0] == 1
    assert "Positive autocorrelation of residuals within edges" in " ".join(said)
    assert said[-1].startswith("Passed: ")
    assert found.verdicts(1) == said[:1]
    assert len(found.verdicts(3)) == 3
    assert found.verdicts(3)[-1] == said[-1]


def test_the_forces_are_curved(measurements):
    """Depth adds to the force: in logarithms its effect falls. Beside 8 other tests, the lack of fit does not count."""
    law = fit.power_law(datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv"), "Fx", ["d", "V", "f"])
    curved = fit.judge(law).checks["curvature"]
    assert curved.concern == 1
    assert curved.verdict.startswith(
        "Curvature: the square of d improves the law (F(1, 49) = 16.01, the largest of 3, p < .001)"
    )


def test_one_sentence_at_least():
    with pytest.raises(UsageError, match="most=0"):
        fit.judge(wear()).verdicts(0)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 9), st.integers(1, 5), st.floats(0.001, 1.0), st.integers(0, 10**6), st.booleans())
@example(4, 1, 0.15625, 4, False)  # a likelihood of powers that is flat but for rounding
def test_small_designs_never_give_a_nan(edges, per_edge, noise, seed, named):
    try:
        law = wear(edges, per_edge, noise, between=noise, seed=seed)
    except errors.FitError:
        return
    assert_in_words(fit.judge(law if named else law.with_rows(edge=None)))


def swinging(edges, per_edge):
    """Rows that lie above and below the law in turn: every second one alone would look alike."""
    rng = np.random.default_rng(3)
    at, t = np.repeat(np.arange(edges), per_edge), np.tile(np.linspace(1, 9, per_edge), edges)
    V = rng.uniform(50, 200, edges)[at]
    swing = 0.05 * (-1.0) ** np.arange(len(t)) + 0.05 * rng.normal(size=edges)[at] + 0.02 * rng.normal(size=len(t))
    frame = pd.DataFrame({"V": V, "t": t, "AW": 0.01 * V**0.5 * t**0.3 * np.exp(swing), "edge": at.astype(str)})
    return fit.power_law(datasets.runs_from_frame(frame), "AW", ["V", "t"])


def test_the_order_of_rows_is_reported_up_to_the_limit():
    found = fit.judge(swinging(20, MOST_ROWS // 20))
    assert found.nobs == MOST_ROWS
    assert found.checks["order within edges"].verdict.startswith(
        "Negative autocorrelation of residuals within edges (lag-1 correlation -0.86"
    )


def test_the_order_of_rows_is_not_reported_of_a_choice_of_them():
    """Every second row alone: they would seem to follow each other no more than chance lets them."""
    law = swinging(20, 300)
    found = fit.judge(law)
    assert found.nobs == 3000
    assert str(found.checks["order within edges"]).startswith(
        "3000 of 6000 rows were checked, evenly spaced: neighbours on an edge"
    )
    assert any(
        said.startswith("Not testable (Autocorrelation within edges (lag 1)): 3000 of 6000")
        for said in found.verdicts(20)
    )
    assert any(
        said.startswith("Not testable (Autocorrelation within edges (lag 1)): 3000 of 6000")
        for said in fit.judge(law).verdicts(20)
    )
    assert "no edge column" in str(fit.judge(law.with_rows(edge=None)).checks["order within edges"])


def test_rows_of_numbered_tools_are_no_runs_of_their_own():
    """Six tools with four rows each and no time: an unused column Tool_ID shows that rows share edges."""
    rng = np.random.default_rng(2)
    V, f = rng.uniform(100, 200, 24), rng.uniform(0.1, 0.4, 24)
    frame = pd.DataFrame({"V": V, "f": f, "Ra": f**1.5 * np.exp(0.05 * rng.normal(size=24))})
    alone = datasets.runs_from_frame(frame, judge=False)
    assert number_of_edges(fit.power_law(alone, "Ra", ["V", "f"]), alone).concern == 0
    several = datasets.runs_from_frame(frame.assign(Tool_ID=np.repeat([21, 31, 41, 51, 61, 71], 4)), judge=False)
    found = number_of_edges(fit.power_law(several, "Ra", ["V", "f"]), several)
    assert found.concern == 1
    assert "Column Tool_ID has 6 values in 24 rows" in found.verdict
    assert "--edge Tool_ID" in found.verdict


def forces(change, order, numbered=False):
    """Forces of a factorial plan, cut in an order, with a drift in ln Fc over all tests."""
    rng = np.random.default_rng(4)
    plan = np.array([(V, f, d) for V in (100, 150, 220) for f in (0.1, 0.2, 0.4) for d in (1, 2, 3)], dtype=float)
    plan = plan[rng.permutation(len(plan))] if order == "random" else plan
    Fc = 1800 * plan[:, 1] ** 0.75 * plan[:, 2] * np.exp(rng.normal(0, 0.03, len(plan)))
    Fc *= np.exp(change * np.linspace(0, 1, len(plan)))
    table = pd.DataFrame({"V": plan[:, 0], "f": plan[:, 1], "d": plan[:, 2], "Fc": Fc})
    if numbered:
        table = table.assign(run=np.arange(1, len(plan) + 1)).sample(frac=1, random_state=1)
    return datasets.runs_from_frame(table)


@pytest.mark.parametrize("numbered", [False, True])
def test_a_drift_over_the_tests_is_found_by_the_order_of_rows_or_run_numbers(numbered):
    runs = forces(0.36, "random", numbered)
    found = fit.judge(fit.power_law(runs, "Fc", ["V", "f", "d"]), runs=runs)
    check = found.checks["order of tests"]
    assert check.concern == 1
    by = "the column of run numbers" if numbered else "the order of the rows"
    assert check.verdict.startswith(f"Drift over the tests by {by}: Fc changes by +4")
    assert found.verdict.words == "usable with reservations"


def test_no_drift_is_found_without_one_or_where_the_factors_follow_the_order():
    runs = forces(0.0, "random")
    check = fit.judge(fit.power_law(runs, "Fc", ["V", "f", "d"]), runs=runs).checks["order of tests"]
    assert check.concern == 0
    assert check.verdict.startswith("No drift over the tests by the order of the rows")
    runs = forces(0.36, "sorted")
    check = fit.judge(fit.power_law(runs, "Fc", ["V", "f", "d"]), runs=runs).checks["order of tests"]
    assert check.reason == (
        "the tests stand in the file in the order of a factor: a drift cannot be separated from its effect"
    )


def passes_over_a_bar(columns, speed=600.0):
    """Forces of 16 passes from D 100 to 40 mm, 2 % more with each; ``columns`` of run, D, V, f and Fc."""
    rng, k = np.random.default_rng(5), np.arange(16)
    D = 100.0 - 4 * k
    V, f = np.round(np.pi * D * speed / 1000, 1), np.tile([0.1, 0.2], 8)
    Fc = 4000 * f**0.75 * V**-0.1 * 1.02**k * np.exp(rng.normal(0, 0.03, 16))
    return datasets.runs_from_frame(pd.DataFrame({"run": k + 1, "D": D, "V": V, "f": f, "d": 2.0, "Fc": Fc})[columns])


@pytest.mark.parametrize("columns", [["run", "V", "f", "Fc"], ["D", "V", "f", "Fc"]])
def test_a_speed_that_falls_with_every_pass_over_a_bar_cannot_be_told_from_a_drift(columns):
    runs = passes_over_a_bar(columns)
    found = drift(fit.power_law(runs, "Fc", ["V", "f"]), runs, 0.0)
    assert found.concern == 1
    assert found.verdict == (
        "V falls from test to test: a drift (the machine warms up, the tool wears, a sensor drifts) cannot be "
        "separated from the effect of V on Fc."
    )


def test_a_table_that_is_sorted_by_a_factor_is_not_accused():
    """Without run numbers or a bar the rows may be sorted; three levels in order are a plan in standard order."""
    runs = passes_over_a_bar(["V", "f", "Fc"])
    assert "in the order of a factor" in drift(fit.power_law(runs, "Fc", ["V", "f"]), runs, 0.0).reason
    plan = forces(0.0, "sorted")
    numbered = datasets.runs_from_frame(plan.data.assign(run=np.arange(1, 28)))
    assert "in the order of a factor" in drift(fit.power_law(numbered, "Fc", ["V", "f", "d"]), numbered, 0.0).reason


def test_a_sound_plan_is_rarely_accused_of_a_drift():
    """At .05 each, before the tests of the law are counted together: 5 of 100, here at most 10."""
    rng, accused = np.random.default_rng(11), 0
    for _ in range(100):
        runs = forces(0.0, "random")
        noise = np.exp(rng.normal(0, 0.1, len(runs)))
        runs = replace(runs, data=runs.data.assign(Fc=runs.data["Fc"] * noise))
        accused += drift(fit.power_law(runs, "Fc", ["V", "f", "d"]), runs, 0.0).pvalue < 0.05
    assert 0 < accused <= 10


def test_readings_in_large_steps_are_named_and_no_exact_law_of_them_is_used():
    """Ra read to 1 um at three feeds: a second-order form meets every row, with intervals of no width."""
    V, f = (x.ravel() for x in np.meshgrid([100.0, 150, 220], [0.1, 0.2, 0.35]))
    rows = pd.DataFrame({"V": V, "f": f, "Ra": np.where(f < 0.3, 1.0, 3.0)})
    runs = datasets.runs_from_frame(rows)
    law = fit.fit_law(runs, "Ra ~ V, f", form="second-order")
    check = fit.judge(law, runs=runs).checks["limited readings"]
    assert check.concern == 2
    assert check.verdict.startswith("Ra has only 2 different values (1, 3 um) in 9 rows, in steps of 2e+02 % of")
    rough = datasets.runs_from_frame(rows.assign(Ra=1.0 + 10 * f + 0.1 * np.random.default_rng(2).normal(size=len(f))))
    assert "limited readings" not in fit.judge(fit.power_law(rough, "Ra", ["V", "f"])).checks


def wear_of(read, times=(2.0, 4, 7, 11, 16), seed=9, size=1.0):
    """The judgement of the wear of 18 edges that was ``read`` from its true values."""
    rng = np.random.default_rng(seed)
    plan = np.array([(V, f, d) for V in (140, 180, 230) for f in (0.12, 0.2, 0.3) for d in (1, 2)], dtype=float)
    (V, f, d), t = np.repeat(plan, len(times), axis=0).T, np.tile(times, len(plan))
    true = 0.3 * size * (V / 180) ** 1.1 * (f / 0.2) ** 0.5 * (d / 1.5) ** 0.2 * (t / 15) ** 0.6
    VB = true * np.exp(np.repeat(rng.normal(0, 0.08, 18), len(times)) + rng.normal(0, 0.05, len(t)))
    edge = np.repeat([f"E{k:02d}" for k in range(1, 19)], len(times))
    table = pd.DataFrame({"edge": edge, "V": V, "f": f, "d": d, "t": t, "VB": read(VB)})
    runs = datasets.runs_from_frame(table, judge=False)
    return fit.judge(fit.power_law(runs, "VB", ["V", "f", "d", "t"]), runs=runs)


EARLY = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0)


@pytest.mark.parametrize(
    ("read", "times", "size", "words"),
    [
        (lambda VB: np.round(np.maximum(VB, 0.05) / 0.05) * 0.05, (2.0, 4, 7, 11, 16), 1.0, "in steps of"),
        (
            lambda VB: np.maximum(np.round(VB, 3), 0.02),
            EARLY,
            0.3,
            "readings of VB are 0.02 mm, the smallest: probably",
        ),
        (lambda VB: np.where(VB < 0.02, 0, np.round(VB, 3)), EARLY, 0.3, "after t = 0 are zero or below a limit"),
    ],
)
def test_wear_in_steps_or_at_a_floor_is_named_and_no_times_are_suspected(read, times, size, words):
    for seed in (8, 9):
        found = wear_of(read, times, seed, size)
        assert words in found.checks["limited readings"].verdict
        assert found.verdict.reasons[0] == found.checks["limited readings"].verdict
        assert not [one for one in found.suspects if one.column == "t"]
        assert not [name for name, one in found.checks.items() if name[:4] == "time" and getattr(one, "concern", 0)]


def test_wear_that_is_read_to_a_hundredth_of_a_millimetre_has_no_floor_and_no_large_steps():
    assert "limited readings" not in wear_of(lambda VB: np.maximum(np.round(VB, 2), 0.01)).checks
    new = wear_of(lambda VB: np.where(np.arange(len(VB)) % 5, VB, 0.0), (0.0, 4, 7, 11, 16))
    assert "limited readings" not in new.checks


def test_a_force_at_the_limit_of_its_sensor_is_named_without_edges_too():
    V, f, d = (x.ravel() for x in np.meshgrid([100.0, 160, 220], [0.1, 0.2, 0.35], [1.0, 2]))
    Fc = np.minimum(np.round(2000 * f**0.75 * d * np.exp(np.random.default_rng(8).normal(0, 0.02, len(V)))), 1000.0)
    clipped = datasets.runs_from_frame(pd.DataFrame({"V": V, "f": f, "d": d, "Fc": Fc}))
    check = fit.judge(fit.power_law(clipped, "Fc", ["V", "f", "d"])).checks["sensor limit"]
    assert check.concern == 1
    assert check.verdict.startswith(
        "6 of 18 readings of Fc are 1000 N, the largest: the sensor is probably at its limit"
    )


def test_a_drift_is_not_tested_over_the_lines_of_several_files():
    """Lines 1, 2 ... of two files are no order of their tests."""
    runs = forces(0.36, "random")
    law = fit.power_law(runs, "Fc", ["V", "f", "d"])
    both = law.with_rows(lines=np.arange(law.nobs) // 2 + 2)
    assert "no common order" in drift(both, None, 0.0).reason
    assert drift(law, None, 0.0).concern == 1
