"""Times of edges that are offset, in another unit or begin anew: found, named, and seldom reported of sound tests.

The wear law is that of Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006, eq. 4; scatter as it reports, .05 of edges and
.08 of rows.
"""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.fit.checks.check import Check
from fitmodels.fit.checks.time_exponent import common_exponent
from fitmodels.fit.checks.time_offsets import time_between, time_restarts, time_tests, time_within
from fitmodels.fit.checks.time_search import search

TIMES = np.arange(2.0, 13.0, 2.0)
CORNERS = np.array(np.meshgrid((80, 120, 180), (0.1, 0.2, 0.4), (1, 1.5, 2.5))).reshape(3, -1).T


def wear(seed, edges=24, times=TIMES, heavy=False, edge_sd=0.05, row_sd=0.08):
    """A wear test of known law, its times as they were."""
    rng = np.random.default_rng([seed, 19])
    grid = CORNERS[rng.permutation(len(CORNERS))[:edges]]
    names = np.repeat([f"E{k + 1:02d}" for k in range(edges)], len(times))
    V, f, d = np.repeat(grid, len(times), axis=0).T
    t = np.tile(times, edges)

    def error(size):
        return rng.standard_t(4, size) / np.sqrt(2) if heavy else rng.standard_normal(size)

    scatter = np.exp(np.repeat(edge_sd * error(edges), len(times)) + row_sd * error(len(t)))
    AW = 7.62e-3 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * scatter
    return pd.DataFrame({"edge": names, "V": V, "f": f, "d": d, "t": t, "AW": AW})


def law_of(frame, response="AW", factors=("V", "f", "d", "t")):
    return fit.power_law(datasets.runs_from_frame(frame, judge=False), response, list(factors))


def moved(frame, edges, offset=0.0, factor=1.0):
    at = frame["edge"].isin(edges)
    return frame.assign(t=np.where(at, frame["t"] * factor + offset, frame["t"]))


def found(law):
    """Sentences and corrections of the tests of times that reject at .01."""
    tests = [one for one in time_tests(law, law.edges.icc).values() if isinstance(one, Check) and one.pvalue < 0.01]
    return [one.verdict for one in tests], [suspect.correction for one in tests for suspect in one.suspects]


HALF = [f"E{k:02d}" for k in range(2, 25, 2)]


@pytest.mark.parametrize(
    ("edges", "change", "correction"),
    [
        (HALF, {"offset": 5.0}, ":t-"),
        (HALF, {"offset": -1.5}, ":t+"),
        (["E04", "E11", "E17"], {"factor": 60.0}, ":t/60"),
        (["E09"], {"offset": 40.0}, ":t-"),
    ],
)
def test_edges_with_wrong_times_are_named_with_their_correction(edges, change, correction):
    for seed in range(2):
        sentences, corrections = found(law_of(moved(wear(seed), edges, **change)))
        assert len(corrections) == 1
        assert corrections[0].startswith(",".join(edges) + correction) or correction == ":t+", corrections
        assert any("compare with the records" in text for text in sentences)


def test_the_size_of_an_offset_is_estimated():
    sizes = [float(found(law_of(moved(wear(seed), HALF, offset=5.0)))[1][0].rpartition("-")[2]) for seed in range(4)]
    assert abs(np.mean(sizes) - 5) < 0.6


@pytest.mark.parametrize(("edges", "change"), [(HALF, {"offset": 5.0}), (["E04", "E11", "E17"], {"factor": 60.0})])
def test_the_correction_as_an_option_mends_the_law(edges, change):
    sound, faulty = wear(3), moved(wear(3), edges, **change)
    (correction,) = found(law_of(faulty))[1]
    mended = fit.power_law(datasets.runs_from_frame(faulty, correct=(correction,)), "AW", ["V", "f", "d", "t"])
    assert not found(mended)[0]
    assert mended.params["t"] == pytest.approx(law_of(sound).params["t"], abs=0.02)


def test_few_sound_edges_are_called_offset_where_schedules_differ():
    """Edges at times of their own, half of them 5 min late: those named are late, if not all of them are named."""
    named = late = 0
    for seed in range(4):
        w = wear(seed)
        stretch = np.exp(np.random.default_rng(seed).uniform(-np.log(2), np.log(2), 24))[
            w["edge"].str[1:].astype(int) - 1
        ]
        w = w.assign(t=w["t"] * stretch, AW=w["AW"] * stretch**0.245)
        for correction in found(law_of(moved(w, HALF, offset=5.0)))[1]:
            edges = set(correction.partition(":")[0].split(","))
            named, late = named + len(edges), late + len(edges & set(HALF))
    assert named > 25
    assert late > 0.95 * named


def test_half_of_the_edges_are_taken_as_late_rather_than_the_others_as_early():
    early = [edge for edge in wear(0)["edge"].unique() if edge not in HALF]
    assert found(law_of(moved(wear(1), HALF, offset=5.0)))[1][0].startswith(",".join(HALF))
    assert not set(early) & set(found(law_of(moved(wear(1), HALF, offset=5.0)))[1][0].split(":")[0].split(","))


def test_an_offset_of_all_edges_is_seen_within_them():
    law = law_of(wear(2, times=TIMES).assign(t=lambda w: w["t"] + 20))
    assert time_within(law).pvalue < 0.01
    assert any("all edges" in text or "have an offset" in text for text in found(law)[0])


def test_one_schedule_identifies_no_exponent_between_edges():
    assert "one schedule" in time_between(law_of(wear(0)), 0.3).reason


def test_the_unit_of_all_times_does_not_matter():
    tests = [time_tests(law_of(moved(wear(1), HALF, 5.0).assign(t=lambda w, k=k: w["t"] * k)), 0.3) for k in (1, 60)]
    for name in tests[0]:
        assert tests[0][name].pvalue == pytest.approx(tests[1][name].pvalue, rel=1e-6)


def test_edges_stopped_at_a_criterion_do_not_look_like_offset_times():
    """The times of a stopped edge depend on its wear: their mean is no measure of its schedule."""
    p = []
    for seed in range(12):
        w = wear(seed, times=np.arange(2.0, 41.0, 2.0), edge_sd=0.16)
        reached = (w["AW"] > 0.25).groupby(w["edge"]).cumsum() - (w["AW"] > 0.25)
        w = w[reached == 0]
        starts = w.groupby("edge")["t"].transform("min") + np.random.default_rng(seed).uniform(-0.5, 0.5, 24)[
            w["edge"].str[1:].astype(int) - 1
        ] * (w["t"] == 2.0)
        one = time_between(law_of(w.assign(t=np.where(w["t"] == 2.0, starts, w["t"]))), 0.8)
        p.append(one.pvalue)
    assert np.median(p) > 0.15
    assert min(p) > 0.002


def test_heavy_tails_do_not_reject_a_common_exponent():
    p = np.array([common_exponent(law_of(wear(seed, heavy=True)), 2.5).pvalue for seed in range(40)])
    assert (p < 0.01).sum() <= 3


def test_sound_times_are_left_alone():
    rejected = sum(bool(found(law_of(wear(seed + 100)))[0]) for seed in range(20))
    assert rejected <= 2


def test_a_law_with_wear_among_its_factors_is_not_tested():
    w = wear(0).assign(P=lambda w: w["V"] * w["AW"] ** 0.3 * 0.01)
    law = law_of(w, "P", ("V", "f", "d", "t", "AW"))
    assert time_between(law, 0.3) is None
    assert time_within(law) is None


def test_exact_rows_and_two_times_are_handled():
    two = law_of(wear(0, times=np.array([2.0, 8.0])))
    assert "three times" in time_within(two).reason
    assert search(_rows(two)) == ()


def _rows(law):
    from fitmodels.fit.checks.time_offsets import rows_of

    return rows_of(law)


def test_a_restart_in_all_edges_is_mended_by_its_correction():
    w = wear(4)
    faulty = w.assign(t=np.where(w["t"] > 6, w["t"] - 6, w["t"]))
    (suspect,) = time_restarts(law_of(faulty)).suspects
    assert suspect.correction.startswith("lines 3-5,9-11,")
    assert datasets.runs_from_frame(faulty, correct=(suspect.correction,)).values("t").tolist() == w["t"].tolist()


@pytest.mark.parametrize("edges", [["E03", "E07"], list(wear(0)["edge"].unique())])
def test_times_that_begin_anew_are_counted_on(edges):
    w = wear(4)
    at = w["edge"].isin(edges) & (w["t"] > 6)
    seen = time_restarts(law_of(w.assign(t=np.where(at, w["t"] - 6, w["t"]))))
    assert seen.concern == 1
    assert [suspect.offset for suspect in seen.suspects] == [6.0]
    assert list(seen.suspects[0].lines) == np.flatnonzero(at).tolist()


def test_the_time_of_each_subtest_is_counted_on():
    w = wear(5).assign(t=lambda w: np.where(w["t"] <= 4, w["t"], 2.0))
    assert {suspect.offset for suspect in time_restarts(law_of(w)).suspects} == {4.0, 6.0, 8.0, 10.0}


@pytest.mark.parametrize("parts", [[2.0, 2, 3, 4, 5, 5], [1.0, 2, 3, 5, 5, 5], [5.0, 4, 3, 2, 2, 1], [3.0] * 6])
def test_times_of_subtests_are_to_be_added_up_and_not_shifted_in_part(parts):
    w = wear(5, times=np.cumsum(parts))
    apart = w.assign(t=np.tile(parts, len(w) // 6))
    runs = datasets.runs_from_frame(apart)
    (doubt,) = (one for one in runs.doubts if "the time of each sub-test" in one.sentence)
    assert doubt.unsettled
    assert doubt.remedy == '--correct "all:t=cumulative"'
    mended = datasets.runs_from_frame(apart, correct=("all:t=cumulative",))
    assert mended.values("t").tolist() == w["t"].tolist()
    assert mended.doubts == datasets.runs_from_frame(w).doubts
    if len(set(parts)) > 1:
        seen = time_restarts(law_of(apart))
        assert seen.suspects == ()
        assert ":t=cumulative')" in seen.verdict


def test_times_of_subtests_in_some_edges_are_added_up_there():
    parts = [2.0, 2, 3, 2, 3, 2]
    w = wear(5, times=np.cumsum(parts))
    at = w["edge"].isin(["E03", "E07"])
    seen = time_restarts(law_of(w.assign(t=np.where(at, np.tile(parts, len(w) // 6), w["t"]))))
    assert "--correct 'E03,E07:t=cumulative'" in seen.verdict


def test_rows_in_another_order_and_repeated_readings_are_no_restart():
    w = wear(6)
    assert time_restarts(law_of(w)) is None
    assert time_restarts(law_of(w.sample(frac=1.0, random_state=1))) is None
    assert time_restarts(law_of(w.sort_values("AW", ascending=False))) is None
    again = w.assign(AW=w["AW"] * np.exp(np.random.default_rng(6).normal(0, 0.08, len(w))))
    assert time_restarts(law_of(pd.concat([w, again]).sort_values(["edge", "t"], kind="stable"))) is None
