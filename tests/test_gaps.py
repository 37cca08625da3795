"""Gaps of a record: short ones are filled as the data allow, the others end a segment, no remainder stops a fit."""

from itertools import pairwise

import numpy as np
import pytest
from fitmodels import ident
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record, read_record
from fitmodels.datasets.records.gaps import BUDGET, MOST_FILLED, SHORTEST, fill_gaps, without_short
from fitmodels.ident.excitation.signals import chirp, prbs
from fitmodels.ident.model import Model
from hypothesis import given, settings
from hypothesis import strategies as st

STEP = 0.02
PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=STEP)
F = np.array([0.1, 0.5, 1.0, 2.0])


def gapped(signals, drop):
    """Rows that are left of columns (n, k), with the number of samples lost before each."""
    rows = np.delete(np.arange(len(signals)), drop)
    lost = np.diff(rows, prepend=-1) - 1
    lost[0] = -1
    return fill_gaps(signals[rows], lost, rows + 2, STEP, ("input", "output")[: signals.shape[1]])


def measured(u, snr, seed):
    x = PLANT.simulate(u)
    return x + np.std(x) * 10 ** (-snr / 20) * np.random.default_rng(seed).standard_normal(len(x))


def random_gaps(n, count, seed):
    """Rows in ``count`` gaps of 1 to 3 samples."""
    rng = np.random.default_rng(seed)
    return np.unique([s + k for s in rng.integers(3, n - 8, count) for k in range(rng.integers(1, 4))])


def test_a_smooth_signal_is_filled_to_its_stated_error():
    t = np.arange(500) * STEP
    waves = np.column_stack([np.sin(6 * t), np.cos(5 * t)])
    even = gapped(waves, [100, 104, 200, 201, 300, 301, 302])
    assert even.starts == (0,)
    assert even.values == pytest.approx(waves, abs=5e-4)
    assert "7 samples in 4 gaps of at most 3 are filled (line 103, 107, 204, ...)" in even.notes[0]
    assert "a cubic through 2 samples on each side" in even.notes[0]


def test_a_signal_in_steps_is_filled_on_its_levels_only():
    steps = np.repeat(np.array([0.0, 1.0, -1.0, 2.0, 0.0]), 40)[:, None]
    on, at = gapped(steps, [50, 51]), gapped(steps, [50, 79, 80])
    assert on.starts == (0,)
    assert np.array_equal(on.values, steps)
    assert at.starts == (0, 79)  # whether the step came one or two samples late cannot be known
    assert "1 gap of 2 samples, the longest 0.04 s, is not filled (line 83)" in at.notes[-1]


def test_what_would_be_guessed_is_not_filled():
    noise = np.random.default_rng(1).standard_normal((400, 2))
    even = gapped(noise, [100, 200])
    assert even.starts == (0, 100, 199)
    assert "are not filled" in even.notes[0]


def test_a_long_gap_ends_a_segment():
    t = np.arange(500) * STEP
    even = gapped(np.sin(t)[:, None], [*range(100, 101 + MOST_FILLED), 300])
    assert even.starts == (0, 100)
    assert len(even.values) == 500 - MOST_FILLED - 1


@given(
    n=st.integers(20, 120), seed=st.integers(0, 99), drop=st.sets(st.integers(1, 118), max_size=40),
    empty=st.sets(st.tuples(st.integers(0, 119), st.integers(0, 1)), max_size=30),
    noise=st.sampled_from([0.0, 0.01, 1.0]),
)  # fmt: skip
@settings(max_examples=100, deadline=None)
def test_known_samples_stay_and_nothing_else_than_numbers_comes_out(n, seed, drop, empty, noise):
    rng = np.random.default_rng(seed)
    signals = np.sin(np.arange(n)[:, None] / [7, 9]) + noise * rng.standard_normal((n, 2))
    for row, column in empty:
        if row < n:
            signals[row, column] = np.nan
    rows = [k for k in range(n) if k not in drop]
    even = gapped(signals, [k for k in drop if k < n])
    assert np.isfinite(even.values).all()
    starts = np.array([*even.starts, len(even.values)])
    assert starts[0] == 0
    assert (np.diff(starts) > 0).all() or not len(even.values)
    full = signals[rows][np.isfinite(signals[rows]).all(axis=1)]
    kept = iter(map(tuple, even.values))
    assert all(tuple(row) in kept for row in full)  # in their order
    for begin, end in pairwise(starts.tolist()):  # no sample is skipped inside a segment
        known = [np.flatnonzero((signals == row).all(axis=1)) for row in even.values[begin:end]]
        at = [(k, int(found[0])) for k, found in enumerate(known) if found.size]
        assert len({row - k for k, row in at}) <= 1


@pytest.mark.parametrize("u", [chirp(), prbs(2.5, hold=0.2)[:750]], ids=["chirp", "prbs"])
def test_random_gaps_hardly_raise_the_error_of_a_model(tmp_path, u):
    whole, partly = [], []
    for seed in range(4):
        y, drop = measured(u, 30, seed), random_gaps(750, 8, seed)
        lines = [f"{k * STEP:.2f},{float(u[k])!r},{float(y[k])!r}" for k in range(750)]
        for k in drop[::3]:
            lines[k] = f"{k * STEP:.2f},{float(u[k])!r},"
        path = tmp_path / f"run{seed}.csv"
        gone = {k for k in drop if k not in drop[::3]}
        path.write_text("\n".join(["t [s],u,y", *(line for k, line in enumerate(lines) if k not in gone)]))
        rec = read_record(path, "u", "y")
        assert any("are filled" in note for note in rec.notes)
        for record, errors in ((Record(u, y, STEP), whole), (rec, partly)):
            model = ident.output_error(record.centred(), 3, 3, initial="offset")
            errors.append(np.abs(model.response(F) / PLANT.response(F) - 1).max())
    assert np.median(partly) < 1.5 * np.median(whole)


def test_the_errors_of_filled_samples_stay_within_their_budget():
    u = chirp()
    signals = np.column_stack([u, measured(u, 30, 1)])
    drop = [k + i for k in range(10, 740, 20) for i in range(k // 20 % 3 + 1)]
    even = gapped(signals, drop)
    assert len(even.starts) == 1
    wrong = np.mean((even.values - signals) ** 2, axis=0) / np.var(signals, axis=0)
    assert (wrong < 2 * BUDGET).all()  # of one set of gaps, where the budget is that of the mean


def test_segments_too_short_are_left_out_with_count_and_place():
    starts = (0, 300, 303, 310, 400)
    rec = without_short(Record(chirp(), measured(chirp(), 30, 1), STEP, starts))
    assert rec.starts == (0, 300, 390)
    assert rec.notes[-1] == (
        f"2 of 5 segments have fewer than {SHORTEST} samples and are left out: 10 samples, from 6, 6.06 s on"
    )
    short = Record(np.arange(40.0), np.arange(40.0), STEP, (0, 20))
    assert without_short(short) is short


@pytest.mark.parametrize("count", [8, 40])
def test_no_length_of_segment_stops_an_estimation(count):
    rng = np.random.default_rng(count)
    u = chirp(duration=6.0)
    starts = sorted({0, 3, 120, 121, 123, 126, 130, len(u) - 1, *rng.choice(len(u) - 1, count, replace=False).tolist()})
    rec = Record(u, measured(u, 30, 1), STEP, tuple(starts)).centred()
    refused = []
    for estimate in (
        lambda: ident.arx(rec, 3, 3),
        lambda: ident.output_error(rec, 3, 3, initial="offset"),
        lambda: ident.box_jenkins(rec, 3, 3, 4), lambda: ident.armax(rec, 3, 3, 3),
        lambda: ident.validate(PLANT, rec), lambda: ident.identify(rec, orders=(3, 3, 1)),
        lambda: ident.frequency_response(rec), lambda: ident.choose_order(rec),
    ):  # fmt: skip
        try:
            estimate()
        except IdentError as refusal:
            refused.append(str(refusal))
    assert all("segment" in text for text in refused)


@pytest.mark.parametrize("lost", [[200, 204], [100, 103, 500], list(range(60, 120, 3)), [*range(400, 440), 441]])
def test_lost_samples_and_empty_cells_do_not_stop_the_identification(tmp_path, lost):
    u = chirp()
    y = measured(u, 30, 3)
    rows = [f"{k * STEP:.2f},{float(u[k])!r},{float(y[k])!r}" for k in range(750)]
    empty = [f"{k * STEP:.2f},{float(u[k])!r}," if k in lost else row for k, row in enumerate(rows)]
    for kept in (np.delete(rows, lost).tolist(), empty):
        path = tmp_path / "run.csv"
        path.write_text("\n".join(["t [s],u,y", *kept]))
        found = ident.identify(read_record(path, "u", "y"), orders=(3, 3, 1))
        assert np.abs(found.model.response(F) / PLANT.response(F) - 1).max() < 0.03
        assert found.validation.fit > 90  # of blocks of the sweep, not of what follows the gap
