"""A record keeps its stretches apart, and changes its rate without changing what it says."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets import Record, join_records
from fitmodels.datasets.records.resampling import aliased_teeth
from hypothesis import given, settings
from hypothesis import strategies as st

BAND = 2e-3  # share by which a tone below 80 % of the new half rate may change: the filter ripples by 70 dB, edges more
ALIAS = 1e-3  # share of a tone above the new half rate that may be left: 70 dB is 3e-4, and the ends let in a little


def sines(frequency, n=4000, rate=1000.0, starts=(0,)):
    t = np.arange(n) / rate
    return Record(np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t), 1 / rate, starts)


@pytest.mark.parametrize("k", [2, 3, 5, 10])
def test_a_tone_that_the_new_rate_holds_is_the_tone_sampled_slower(k):
    frequency = 0.75 * 500 / k
    slow = sines(frequency).decimated(k)
    assert slow.sample_time == pytest.approx(k / 1000)
    assert len(slow) == -(-4000 // k)
    inner = slice(60, -60)
    t = np.arange(len(slow)) * k / 1000
    assert slow.u[inner] == pytest.approx(np.sin(2 * np.pi * frequency * t)[inner], abs=BAND)
    assert slow.y[inner] == pytest.approx(np.cos(2 * np.pi * frequency * t)[inner], abs=BAND)


@pytest.mark.parametrize("k", [2, 4, 10])
def test_a_tone_above_the_new_half_rate_does_not_fold_back(k):
    tone = sines(1.05 * 500 / k)
    folded = tone.u[::k]
    assert np.abs(folded).max() > 0.9  # what a mere choice of every k-th sample would give
    assert np.abs(tone.decimated(k).u[60:-60]).max() < ALIAS


@given(level=st.floats(-1e3, 1e3), slope=st.floats(-10, 10), n=st.integers(20, 400), k=st.integers(1, 7))
@settings(max_examples=50, deadline=None)
def test_a_straight_line_stays_one_up_to_both_ends(level, slope, n, k):
    line = level + slope * np.arange(n)
    slow = Record(line, -line, 0.01).decimated(k)
    assert slow.u == pytest.approx(line[::k], abs=1e-8 * (1 + abs(level) + abs(slope) * n))
    assert slow.y == pytest.approx(-slow.u, abs=1e-8 * (1 + abs(level) + abs(slope) * n))


def test_no_filter_looks_across_a_join():
    rng = np.random.default_rng(1)
    a, b = (Record(rng.normal(size=n), rng.normal(size=n), 0.01) for n in (203, 310))
    both = join_records([a, b]).decimated(4)
    assert both.starts == (0, 51)
    assert np.array_equal(both.u, np.concatenate([a.decimated(4).u, b.decimated(4).u]))


def test_decimation_passes_the_same_filter_over_input_and_output():
    """A delay-free gain between them is the same gain afterwards."""
    u = np.random.default_rng(2).normal(size=500)
    slow = Record(u, 3 * u, 0.01).decimated(5)
    assert slow.y == pytest.approx(3 * slow.u)


def test_resampling_up_and_down_again_gives_the_tone_back():
    tone = sines(40.0)
    there = tone.resampled(2500.0)
    assert there.rate == pytest.approx(2500)
    t = np.arange(len(there)) / 2500
    assert there.u[200:-200] == pytest.approx(np.sin(2 * np.pi * 40 * t)[200:-200], abs=BAND)
    back = there.resampled(1000.0)
    assert len(back) == len(tone) - 1  # the last sample lies beyond the last one at 2500 Hz
    assert back.u[100:-100] == pytest.approx(tone.u[100:-101], abs=BAND)


def test_stretches_too_short_for_the_new_rate_are_left_out_and_that_is_reported():
    rec = sines(5.0, n=205, starts=(0, 5)).centred()
    slow = rec.decimated(10)
    assert slow.starts == (0,)
    assert slow.offsets.tolist() == [rec.offsets[1].tolist()]
    assert "1 segment too short" in slow.notes[-1]


def test_the_operating_point_is_kept_through_centring_rate_and_shift():
    rng = np.random.default_rng(3)
    rec = Record(5 + rng.normal(size=400), -2 + rng.normal(size=400), 0.01, (0, 150))
    moved = rec.less(1.0, 2.0).centred().decimated(2)
    assert moved.offsets == pytest.approx(np.array([[x[s].mean() for x in (rec.u, rec.y)] for s in rec.stretches]))


def test_runs_of_two_clocks_are_joined_and_the_files_named():
    a = Record([0.0, 1.0], [0.0, 1.0], 0.01, source="a.csv", sha256="1")
    b = Record([0.0, 1.0], [0.0, 1.0], 0.01 * (1 + 1e-5), source="b.csv", sha256="2")
    both = join_records([a, b])
    assert both.source == "a.csv + b.csv"
    assert both.sha256 not in (a.sha256, b.sha256, join_records([b, a]).sha256)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        pytest.param(lambda r: r.decimated(0), DataError, "1 or more", id="a decimation by nothing"),
        pytest.param(lambda r: r.decimated(2.5), DataError, "whole number", id="a decimation by a fraction"),
        pytest.param(lambda r: r.decimated(90), DataError, "3 samples left", id="nothing left"),
        pytest.param(lambda r: r.resampled(-1.0), UsageError, "above zero", id="a rate below zero"),
        pytest.param(lambda r: r.resampled(31.41592), UsageError, "not a simple ratio", id="a rate that is no ratio"),
        pytest.param(lambda r: r.less(np.nan, 0.0), DataError, "finite", id="an operating point that is none"),
        pytest.param(
            lambda r: join_records([r, r.decimated(2)]), DataError, "cannot be joined", id="two rates in one record"
        ),
    ],
)
def test_what_cannot_be_is_said(call, error, words):
    with pytest.raises(error, match=words):
        call(sines(5.0, n=100))


def test_a_reference_follows_its_record():
    """Through parts, centring, decimation and joining; one of another length is refused."""
    rec = Record(u=np.arange(200.0), y=np.ones(200), sample_time=0.01, starts=(0, 100), reference=np.arange(200.0))
    assert rec.part(50, 150).reference.tolist() == rec.u[50:150].tolist()
    assert rec.centred().reference.tolist() == rec.centred().u.tolist()
    assert rec.decimated(5).reference.tolist() == rec.decimated(5).u.tolist()
    assert join_records([rec, rec]).reference.tolist() == [*rec.u, *rec.u]
    with pytest.raises(DataError, match=r"reference has shape \(3,\), input \(200,\)"):
        replace(rec, reference=np.ones(3))
    with pytest.raises(DataError, match="1 of 2 records have a reference"):
        join_records([rec, replace(rec, reference=None)])


def test_samples_that_are_not_aliased_give_the_mean_force_of_interrupted_cuts():
    """Half sines of 2/5 to 4/5 of the pitch of the teeth, from every angle of the spindle."""
    phase = np.linspace(0, 1, 200, endpoint=False)[:, None]

    def error(samples, teeth, share):
        at = (teeth * (np.arange(samples) / samples + phase)) % 1.0
        force = np.where(at < share, np.pi / 2 / share * np.sin(np.pi * at / share), 0.0)
        return np.abs(force.mean(axis=1) - 1).max()

    for samples in range(1, 41):
        aliased = aliased_teeth(1.0, 1.0 / samples)
        for teeth in range(1, 9):
            worst = max(error(samples, teeth, share) for share in (0.4, 0.5, 0.65, 0.8))
            assert (teeth in aliased) == (worst > 0.25), (samples, teeth, worst)
