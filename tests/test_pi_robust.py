"""Probability over the plants that the data allow: calculated, required, stated by other draws; the verdict."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.core.verdict import DO_NOT_USE, RESERVATIONS, USABLE, Verdict
from fitmodels.ident.draws import drawn_models
from fitmodels.ident.model import Model
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.robust_design import STATED, Robustness, reservations, robustness, share_error
from fitmodels.ident.pi.specification import Specification
from fitmodels.ident.pi.tuning import tune_pi
from scipy.stats import binomtest

pytestmark = pytest.mark.slow

# y(t) = 0.9 y(t-1) + b u(t-1) at 0.1 s under an integral alone; b with a standard error of 5 %
FIRST = Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.1, cov_params=np.diag([0.0, 0.005**2]))
LOOSE = Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.1, cov_params=np.diag([1e-4, 1e-4]))


def test_the_share_is_what_calculation_gives():
    """Closed loop z - 0.9 + b kp for P control: the time to rise falls with b, so the share is a normal probability."""
    gains = PiGains(2.0, 0.0, 0.1)

    def rise(b):
        return robustness(
            [Model([0.0, b], [1.0, -0.9], 1, 0.1)], gains, Specification(rise_time=1e3), duration=20.0
        ).worst["rise_time"]

    edge = 0.1 + 0.005 * 0.8416  # 80 % of the draws lie below it: they are slower
    asked = Specification(rise_time=rise(edge))
    assert rise(edge * 0.99) > rise(edge) > rise(edge * 1.01)
    held = robustness(drawn_models(FIRST, 4000, seed=3), gains, asked, duration=20.0)
    assert held.probability == pytest.approx(1 - NormalDist().cdf(0.8416), abs=4 * held.error)
    assert held.missed["rise_time"] == pytest.approx(1 - held.probability)
    assert held.error == pytest.approx(np.sqrt(0.2 * 0.8 / 4000), rel=0.1)


def test_draws_have_the_covariance_of_the_model():
    thetas = np.array([m.theta for m in drawn_models(LOOSE, 4000, seed=1).models])
    assert thetas.std(axis=0) == pytest.approx([0.01, 0.01], rel=0.06)
    assert thetas.mean(axis=0) == pytest.approx(LOOSE.theta, abs=1e-3)


def test_a_demanded_probability_is_had_on_draws_that_were_not_used_to_choose():
    plain = tune_pi(LOOSE, rise_time=1.5, nominal=True, n=40)
    pi = tune_pi(LOOSE, rise_time=1.5, probability=0.9, draws=400, n=40)
    fresh = drawn_models(LOOSE, 1000, seed=77)
    before, after = (robustness(fresh, p.gains, pi.specification, duration=10.0) for p in (plain, pi))
    assert before.probability < 0.75  # the smallest Ms lies on the edge of the limit
    assert after.probability > 0.9 - 3 * after.error
    assert pi.robustness.probability == pytest.approx(after.probability, abs=4 * pi.robustness.error)
    assert pi.feasible
    assert pi.figures.ms > plain.figures.ms


def test_the_default_requires_90_per_cent():
    """Today's behaviour was: rise time exactly on its limit, "meets the specification", 49 % by its own draws."""
    coin = tune_pi(LOOSE, rise_time=1.5, overshoot=0.3, nominal=True, n=40)
    assert coin.figures.rise_time == pytest.approx(1.5, rel=1e-3)
    assert 0.4 < coin.robustness.probability < 0.6
    assert coin.probability is None
    assert coin.verdict.level >= RESERVATIONS
    assert any("below 90 %" in reason for reason in coin.verdict.reasons)
    pi = tune_pi(LOOSE, rise_time=1.5, verdict=Verdict(), n=40)
    assert pi.probability == 0.9
    assert pi.robustness.probability >= 0.9
    assert pi.figures.rise_time < 1.4
    assert pi.verdict.level == USABLE, pi.verdict.reasons


def test_draws_that_choose_gains_do_not_state_their_probability():
    """The stated probability is that of the gains on 5000 other draws, within its binomial error, over five seeds."""
    fresh, difference, error = drawn_models(LOOSE, 5000, seed=99), [], []
    for seed in range(5):
        pi = tune_pi(LOOSE, rise_time=1.5, probability=0.8, draws=60, seed=seed, n=16)
        assert pi.robustness.n + pi.robustness.left_out == STATED
        truth = robustness(fresh, pi.gains, pi.specification, duration=9.0).probability
        difference.append(pi.robustness.probability - truth)
        error.append(np.sqrt(truth * (1 - truth) * (1 / STATED + 1 / 5000)))
    assert abs(sum(difference)) < 3 * np.sqrt(np.sum(np.square(error)))


def test_the_interval_is_that_of_wilson():
    held = tune_pi(LOOSE, rise_time=1.5, nominal=True, n=24).robustness
    expected = binomtest(round(held.probability * held.n), held.n).proportion_ci(method="wilson")
    assert held.interval == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_without_a_covariance_the_probability_is_named_as_not_known():
    pi = tune_pi(replace(LOOSE, cov_params=None), rise_time=1.5, verdict=Verdict(), n=24)
    assert pi.feasible
    assert pi.robustness is None
    assert pi.verdict.level == RESERVATIONS
    assert "cannot be stated: the model has no covariance" in pi.words
    assert any("Probability" in name for name in pi.verdict.not_checked)


@pytest.mark.parametrize(
    ("options", "level", "words"),
    [
        ({"verdict": Verdict(RESERVATIONS, ("In closed loop.",))}, RESERVATIONS, "Model: In closed loop."),
        ({"verdict": Verdict(DO_NOT_USE, ("Not stable.",))}, DO_NOT_USE, "Model: Not stable."),
        ({}, RESERVATIONS, "There is no verdict on the model"),
        ({"peak_u": 0.01}, DO_NOT_USE, "The gains miss their specification: "),
    ],
    ids=["reservations", "not to be used", "not validated", "specification missed"],
)
def test_what_is_known_of_the_model_lowers_the_verdict_on_the_gains(options, level, words):
    pi = tune_pi(LOOSE, rise_time=1.5, n=24, **options)
    assert pi.verdict.level == level
    assert any(reason.startswith(words) for reason in pi.verdict.reasons)


def test_a_loop_faster_than_the_record_is_a_reservation():
    pi = tune_pi(replace(LOOSE, band=(0.001, 0.02)), rise_time=1.5, verdict=Verdict(), n=24)
    assert any("excited the drive only up to 0.02 Hz" in reason for reason in pi.verdict.reasons)


def test_gains_that_rather_fail_than_hold_must_not_be_used():
    wild = replace(LOOSE, cov_params=np.diag([1e-3, 1e-3]))
    pi = tune_pi(wild, rise_time=1.5, settling_time=2.2, overshoot=0.02, nominal=True, verdict=Verdict(), n=40)
    assert pi.robustness.interval[1] < 0.5
    assert pi.verdict.level == DO_NOT_USE
    assert "below 50 %" in pi.verdict.reasons[0]


def test_an_interval_that_reaches_below_the_required_probability_is_a_reservation():
    pi = tune_pi(LOOSE, rise_time=5.0, probability=0.999, verdict=Verdict(), n=24)
    assert pi.feasible
    assert pi.robustness.interval[0] < 0.999 <= pi.robustness.probability
    assert pi.verdict.level == RESERVATIONS
    assert "below the required 99.9 %" in pi.verdict.reasons[0]


@pytest.mark.parametrize(("probability", "required", "level"), [(0.93, 0.95, 1), (0.955, 0.95, 1), (0.97, 0.95, 0)])
def test_the_required_probability_limits_the_verdict(probability, required, level):
    held = Robustness(probability, 0.01, 2000, 0, 0, {}, {})
    assert max((found for found, _ in reservations(held, "", required)), default=0) == level


def test_a_share_near_one_is_printed_with_its_digits():
    words = Robustness(0.9995, 0.0005, 2000, 0, 0, {}, {}).words
    assert "probability 99.95 % (95 % Monte Carlo interval 99.72 to 99.9912 %)" in words


def test_the_margin_to_each_limit_is_a_number():
    pi = tune_pi(LOOSE, rise_time=1.5, settling_time=4.0, n=40)
    by_name = {margin.name: margin for margin in pi.margins}
    rise = by_name["rise_time"]
    assert (rise.value, rise.limit) == (pi.figures.rise_time, 1.5)
    assert rise.left == pytest.approx(1 - rise.value / 1.5)
    assert rise.missed == pi.robustness.missed["rise_time"]
    assert by_name["overshoot"].limit == pytest.approx(2.0)  # per cent
    assert by_name["steady_error"].row[1:4] == ("none", "none", "")
    bound = 1 - sum(margin.missed for margin in pi.margins)  # Bonferroni
    assert bound - 1e-12 <= pi.robustness.probability <= 1 - max(margin.missed for margin in pi.margins)


def test_the_trade_off_holds_the_chosen_gains_at_its_lower_edge():
    pi = tune_pi(LOOSE, rise_time=1.5, nominal=True, n=60)
    found = pi.trade_off()
    speed, ms = found.least
    near = np.abs(speed - pi.figures.rise_time) < 0.05
    assert pi.figures.ms <= ms[near].min() * 1.01
    within = (found.speed > 0.9) & (found.speed < 1.2)
    slow = found.probability[found.speed > 1.7]
    assert found.probability[within].max() > 0.8
    assert not slow.size or slow.max() < 0.6  # some draws are faster than the estimate
    assert ms[0] > ms[-1]  # speed costs robustness


def test_a_probability_out_of_reach_is_reported():
    wild = Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.1, cov_params=np.diag([0.0, 0.05**2]))
    pi = tune_pi(wild, rise_time=0.5, settling_time=0.8, overshoot=0.02, probability=0.99, draws=200, n=40)
    assert not pi.feasible
    assert any("probability" in reported for reported in pi.misses)


def test_several_models_are_held_at_their_worst():
    models = [Model([0.0, b], [1.0, -0.9], 1, 0.1) for b in (0.07, 0.1, 0.14)]
    pi = tune_pi(models[1], rise_time=1.5, models=models, probability=0.99, n=60)
    assert pi.robustness.probability == 1.0
    assert pi.robustness.worst["rise_time"] <= 1.5
    assert pi.robustness.n == 3


def test_draws_that_run_away_are_left_out_and_reported():
    slow = Model(b=[0.0, 0.1], a=[1.0, -0.98], nk=1, sample_time=0.1, cov_params=np.diag([0.02**2, 1e-6]))
    plants = drawn_models(slow, 1000, seed=1)
    assert plants.left_out / 1000 == pytest.approx(1 - NormalDist().cdf(1.0), abs=0.04)
    held = robustness(plants, PiGains(2.0, 1.0, 0.1), Specification(rise_time=3.0), duration=20.0)
    assert f"{plants.left_out} unstable draws" in held.words
    assert held.n + held.left_out == 1000


def test_unstable_loops_count_as_misses():
    held = robustness(
        [FIRST, Model([0.0, 2.0], [1.0, -0.9], 1, 0.1)],
        PiGains(2.0, 1.0, 0.1),
        Specification(rise_time=3.0),
        duration=20.0,
    )
    assert (held.unstable, held.probability) == (1, 0.5)


def test_the_same_seed_gives_the_same_gains():
    one, two = (tune_pi(LOOSE, rise_time=1.5, probability=0.8, draws=100, seed=5, n=30) for _ in range(2))
    assert one.gains == two.gains
    assert one.robustness == two.robustness


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: drawn_models(Model([0.0, 1.0], [1.0], 1, 0.1)), IdentError, "no covariance"),
        (lambda: drawn_models(LOOSE, 3), UsageError, "10 or more"),
        (
            lambda: drawn_models(Model([0.0, 0.1], [1.0, -0.999], 1, 0.1, cov_params=np.diag([1.0, 0.0]))),
            IdentError,
            "are unstable",
        ),
        (lambda: tune_pi(LOOSE, 1.5, probability=90, n=30), UsageError, "between 0 and 1"),
        (lambda: tune_pi(LOOSE, 1.5, probability=0.9, nominal=True, n=30), UsageError, "give one of them"),
    ],
)
def test_what_cannot_be_drawn_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_the_error_of_a_share_is_never_zero():
    assert share_error(1.0, 500) > 0
    assert share_error(0.5, 500) == pytest.approx(np.sqrt(0.25 / 500), rel=0.01)


def test_the_probability_includes_the_uncertainty_of_the_orders():
    """A fifth of the weight on a plant of half the gain, which is too slow for any of the gains of the other."""
    slow = replace(LOOSE, b=np.array([0.0, 0.05]))
    gains = PiGains(0.9, 1.2, 0.1)
    asked = Specification(rise_time=3.0, overshoot=1.0)
    alone, other, both = (
        robustness(drawn_models(m, 1000, seed=1), gains, asked, duration=20.0).probability
        for m in (LOOSE, slow, replace(LOOSE, alternatives=((0.2, slow),)))
    )
    assert both == pytest.approx(0.8 * alone + 0.2 * other, abs=0.03)
    pi = tune_pi(replace(LOOSE, alternatives=((0.2, slow),)), rise_time=1.5, n=24)
    assert pi.robustness.n > 1500
    assert "of the model uncertainty, 2 structures included, that did not choose the gains" in pi.robustness.words
