"""One Gram matrix holds every order: equal to phi' phi, whatever the lags, the length and the joins."""

import tracemalloc

import numpy as np
import pytest
from fitmodels.datasets import Record
from fitmodels.ident.estimators.regressors import PIECE, Lags, arx_regressors, gram, grams, triangle
from hypothesis import given, settings
from hypothesis import strategies as st

# Sums of n products of numbers about 1 differ in their last digits by the order of adding.
ROUNDING = 1e-11


def record(n, starts=(0,), seed=1):
    u, y = np.random.default_rng(seed).standard_normal((2, n))
    return Record(u=u, y=y, sample_time=0.02, starts=starts)


def explicit(rec, lags):
    """phi' phi row by row, as a reader would write it."""
    rows = [
        [*(rec.y[t - i] for i in range(lags.y + 1)), *(rec.u[t - j] for j in range(lags.first, lags.last + 1))]
        for s in rec.stretches
        for t in range(s.start + lags.span, s.stop)
    ]
    phi = np.array(rows).reshape(len(rows), lags.y + 1 + lags.last - lags.first + 1)
    return phi.T @ phi, len(rows)


@given(
    n=st.integers(2, 400),
    y=st.integers(0, 11),
    first=st.integers(0, 12),
    more=st.integers(0, 20),
    cuts=st.sets(st.integers(1, 399), max_size=4),
)
@settings(max_examples=80, deadline=None)
def test_equals_the_explicit_product_for_any_lags_length_and_joins(n, y, first, more, cuts):
    rec = record(n, (0, *sorted(c for c in cuts if c < n)))
    lags = Lags(y, first, first + more)
    expected, rows = explicit(rec, lags)
    found = gram(rec, lags)
    assert found.rows == rows
    np.testing.assert_allclose(found.matrix, expected, atol=ROUNDING * n)


@pytest.mark.parametrize("n", [PIECE - 1, PIECE + 40, 2 * PIECE + 13])
def test_pieces_of_a_long_record_leave_no_seam(n):
    rec = record(n)
    lags = Lags(3, 1, 4)
    t = np.arange(lags.span, n)
    phi = np.column_stack([rec.y[t - i] for i in range(4)] + [rec.u[t - j] for j in range(1, 5)])
    np.testing.assert_allclose(gram(rec, lags).matrix, phi.T @ phi, atol=ROUNDING * n)


def test_a_large_transient_at_either_end_costs_the_others_no_digits():
    u, y = np.random.default_rng(2).standard_normal((2, 300))
    y[:4] = y[-3:] = 1e9
    lags = Lags(2, 1, 4)
    rec = Record(u=u, y=y, sample_time=0.02)
    expected, _ = explicit(rec, lags)
    np.testing.assert_allclose(gram(rec, lags).matrix, expected, rtol=1e-9, atol=1e-9)


def test_runs_add_up_and_one_can_be_taken_off():
    rec = record(500, (0, 130, 310))
    lags = Lags(2, 0, 3)
    parts = list(grams(rec, lags))
    rest = gram(rec, lags) - parts[1]
    others, rows = explicit(record(500, (0, 130, 310)), lags)
    alone, _ = explicit(rec.part(130, 310), lags)
    assert rest.rows == rows - parts[1].rows
    np.testing.assert_allclose(rest.matrix, others - alone, atol=ROUNDING * 500)


def test_every_order_is_a_block_of_it():
    rec = record(200)
    found = gram(rec, Lags(4, 0, 9)).block(na=2, nb=3, nk=1)
    t = np.arange(9, 200)
    phi = np.column_stack([rec.y[t - 1], rec.y[t - 2], rec.u[t - 1], rec.u[t - 2], rec.u[t - 3], rec.y[t]])
    np.testing.assert_allclose(found, phi.T @ phi, atol=ROUNDING * 200)


def test_the_triangle_is_a_root_of_the_gram_matrix():
    rec = record(20_000, (0, 9_000))
    lags = Lags(3, 1, 4)
    r, g = triangle(rec, lags), gram(rec, lags)
    assert r.rows == g.rows
    np.testing.assert_allclose(r.matrix.T @ r.matrix, g.matrix, atol=ROUNDING * 20_000)


def test_regressors_stop_at_joins():
    rec = record(12, (0, 5, 7))
    phi, y, t = arx_regressors(rec, 2, 2, 1)
    assert t.tolist() == [2, 3, 4, 9, 10, 11]
    np.testing.assert_array_equal(y, rec.y[t])
    np.testing.assert_array_equal(phi, np.column_stack([-rec.y[t - 1], -rec.y[t - 2], rec.u[t - 1], rec.u[t - 2]]))


@pytest.mark.parametrize("compute", [gram, triangle])
def test_memory_does_not_grow_with_the_record(compute):
    peaks = []
    for n in (100_000, 400_000):
        rec = record(n)
        compute(rec, Lags(3, 1, 3))
        tracemalloc.start()
        compute(rec, Lags(3, 1, 3))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
