"""The search over orders: every loss equals its own regression, and simulated orders come back."""

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident.estimators.order_losses import left_out
from fitmodels.ident.estimators.order_selection import choose_order
from fitmodels.ident.estimators.regressors import Lags, LagTriangle, r_of
from matplotlib.axes import Axes
from scipy.signal import lfilter

B, A = np.array([0, 0.0611, -0.1338, 0.0752]), np.array([1, -2.0311, 1.2104, -0.1655])  # CLM-2023 eq. 18


def simulated(n=2000, b=B, a=A, noise=0.01, seed=1, starts=(0,)):
    rng = np.random.default_rng(seed)
    u = np.sign(rng.standard_normal(n))
    y = lfilter(b, a, u) + lfilter([1], a, noise * rng.standard_normal(n))
    return Record(u=u, y=y, sample_time=0.02, starts=starts)


def regression(rec, na, nb, nk, span):
    """Regressors and output of one order on the rows t >= span of each stretch."""
    t = np.concatenate([np.arange(s.start + span, s.stop) for s in rec.stretches])
    columns = [rec.y[t - i] for i in range(1, na + 1)] + [rec.u[t - nk - j] for j in range(nb)]
    return np.column_stack(columns), rec.y[t], t


def row(search, na, nb, nk):
    t = search.table
    return t[(t.na == na) & (t.nb == nb) & (t.nk == nk)].iloc[0]


ORDERS = [(0, 1, 0), (3, 3, 1), (5, 2, 0), (2, 6, 4), (5, 6, 7), (0, 6, 7)]


@pytest.mark.parametrize("noise", [0.01, 1e-9], ids=["from products", "from a triangle"])
def test_each_loss_is_that_of_its_own_regression_on_the_shared_rows(noise):
    rec = simulated(600, noise=noise, starts=(0, 250))
    search = choose_order(rec, range(6), range(1, 7), range(8))
    assert len(search.table) == 6 * 6 * 8
    for orders in ORDERS:
        phi, y, _ = regression(rec, *orders, span=12)
        expected = np.mean((y - phi @ np.linalg.lstsq(phi, y)[0]) ** 2)
        assert row(search, *orders).loss == pytest.approx(expected, rel=1e-6), orders


@pytest.mark.parametrize("noise", [0.01, 1e-9], ids=["from products", "from a triangle"])
def test_left_out_is_the_error_on_each_run_under_the_fit_to_the_others(noise):
    rec = simulated(600, noise=noise, starts=(0, 150, 420))
    search = choose_order(rec, range(6), range(1, 7), range(8), criterion="left_out")
    for orders in ORDERS:
        phi, y, t = regression(rec, *orders, span=12)
        run = np.searchsorted([150, 420], t, side="right")
        squares = 0.0
        for k in range(3):
            theta = np.linalg.lstsq(phi[run != k], y[run != k])[0]
            squares += np.sum((y[run == k] - phi[run == k] @ theta) ** 2)
        assert row(search, *orders).left_out == pytest.approx(squares / len(y), rel=1e-6), orders


def test_criteria_agree_with_statsmodels_up_to_what_all_orders_share():
    from statsmodels.regression.linear_model import OLS

    rec = simulated(400)
    search = choose_order(rec, range(4), range(1, 5), range(3))
    fits = {o: OLS(*regression(rec, *o, span=5)[1::-1]).fit() for o in [(3, 3, 1), (1, 4, 2)]}
    (a, one), (b, two) = fits.items()
    for name in ("aic", "bic"):
        apart = getattr(one, name) - getattr(two, name)
        assert row(search, *a)[name] - row(search, *b)[name] == pytest.approx(apart, rel=1e-9)


def test_fpe_aicc_and_mdl_by_hand():
    r = row(choose_order(simulated(105), range(4), range(1, 5), range(3)), 3, 3, 1)
    n, k = 100, 6
    assert r.fpe == pytest.approx(r.loss * (1 + k / n) / (1 - k / n))
    assert r.aicc - r.aic == pytest.approx(2 * k * (k + 1) / (n - k - 1))
    assert r.mdl == pytest.approx(r.loss * (1 + k * np.log(n) / n))


@pytest.mark.parametrize(
    ("b", "a", "order"),
    [
        (B, A, (3, 3, 1)),
        (np.r_[np.zeros(7), 0.5, 0.3], [1, -0.7], (1, 2, 7)),
        ([0.4, 0.2], [1, -1.5, 0.7], (2, 2, 0)),
        ([0, 0, 0, 1, 0.5, 0.25], [1], (0, 3, 3)),
    ],
)
def test_the_order_and_delay_of_a_simulated_machine_come_back(b, a, order):
    search = choose_order(simulated(4000, b, a, noise=0.1))
    assert search.chosen == order
    assert len(search.table) == 11 * 10 * 21


def test_the_order_comes_back_without_noise_from_a_chirp():
    t = np.arange(750) / 50
    u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / 30 * t) * t)
    search = choose_order(Record(u=u, y=lfilter(B, A, u), sample_time=0.02))
    assert search.chosen == (3, 3, 1)
    assert any("not identifiable" in note for note in search.notes)


def test_delays_can_be_any_set():
    search = choose_order(simulated(), [3], [2, 3], [4, 1])
    assert search.chosen == (3, 3, 1)
    assert sorted(set(zip(search.table.nb, search.table.nk, strict=True))) == [(2, 1), (2, 4), (3, 1), (3, 4)]


def test_the_argument_is_two_sentences_that_name_the_choice_and_the_next():
    search = choose_order(simulated(2000, seed=3), range(5), range(1, 5), range(3))
    first, second = search.argument.split(". ")
    assert first.startswith("na 3, nb 3, nk 1 has the smallest BIC of 60 orders, ")
    assert "below na" in first
    assert second == "One-step errors are optimistic: confirm the order by simulating a record that was not fitted."


def test_the_largest_order_tried_is_a_warning():
    notes = choose_order(simulated(), range(3), range(1, 3), [1]).notes
    assert notes[0].startswith("na 2, nb 2 is the largest candidate.")


def test_many_runs_are_left_out_in_groups():
    rec = simulated(3000, starts=range(0, 3000, 60))
    search = choose_order(rec, range(4), range(1, 4), range(3), criterion="left_out")
    assert search.chosen[2] == 1
    assert row(search, 3, 3, 1).left_out == pytest.approx(1e-4, rel=0.1)


def test_swapped_columns_are_noted():
    rec = simulated()
    notes = choose_order(Record(u=rec.y, y=rec.u, sample_time=0.02), range(3), range(1, 3), range(3)).notes
    assert any("may be swapped" in note for note in notes)


@pytest.mark.parametrize("criterion", ["bic", "fpe"])
def test_the_order_map_draws(criterion):
    search = choose_order(simulated(500), range(5), range(1, 5), range(3), criterion=criterion)
    ax = search.plot()
    na, nb, nk = search.chosen
    assert isinstance(ax, Axes)
    assert ax.get_title().startswith(f"chosen na {na}, nb {nb}, nk {nk}")
    assert len(ax.texts) == 5 * 4


@pytest.mark.parametrize(
    ("rec", "asked", "sentence"),
    [
        (simulated(40), {}, "na 10, nb 10, nk 20 leave 11 equations for 20 coefficients"),
        (simulated(), {"criterion": "r2"}, "criterion 'r2': one of aic, aicc, bic, fpe, mdl, left_out"),
        (simulated(), {"criterion": "left_out"}, "left_out needs two or more sufficiently long runs"),
        (simulated(), {"nb": range(3)}, "nb 0: a whole number, 1 or more"),
        (simulated(), {"nk": []}, "nk is empty"),
        (Record(u=np.ones(200), y=np.arange(200.0), sample_time=1.0), {}, "input u does not vary"),
    ],
)
def test_refuses_in_words(rec, asked, sentence):
    with pytest.raises(IdentError, match=sentence):
        choose_order(rec, **asked)


def test_parts_with_fewer_samples_than_lags_decide_no_order():
    """Runs of a few samples, without their rest, had fewer rows than columns, which ended with an internal error."""
    lags, rng = Lags(3, 1, 4), np.random.default_rng(4)
    parts = [LagTriangle(r_of(rng.standard_normal((3, 8))), 3, lags) for _ in range(2)]
    error = left_out(parts, [1, 3], 3, [1, 2])
    assert error.shape == (2, 2, 3)
    assert np.isinf(error[:, 1]).all()
    assert np.isfinite(error[:, 0, 0]).all()
