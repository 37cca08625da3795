"""What holds over the plants that the data allow: shares against calculation, gains for a demanded probability."""

from statistics import NormalDist

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.ident.model import Model
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.robust_design import draws_of_models, robustness, share_error
from fitmodels.ident.pi.specification import Specification
from fitmodels.ident.pi.tuning import tune_pi

pytestmark = pytest.mark.slow  # left out where other versions of Python are tried

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
    held = robustness(draws_of_models(FIRST, 4000, seed=3), gains, asked, duration=20.0)
    assert held.probability == pytest.approx(1 - NormalDist().cdf(0.8416), abs=4 * held.error)
    assert held.missed["rise_time"] == pytest.approx(1 - held.probability)
    assert held.error == pytest.approx(np.sqrt(0.2 * 0.8 / 4000), rel=0.1)


def test_draws_have_the_covariance_of_the_model():
    thetas = np.array([m.theta for m in draws_of_models(LOOSE, 4000, seed=1).models])
    assert thetas.std(axis=0) == pytest.approx([0.01, 0.01], rel=0.06)
    assert thetas.mean(axis=0) == pytest.approx(LOOSE.theta, abs=1e-3)


def test_a_demanded_probability_is_had_on_draws_that_were_not_used_to_choose():
    plain = tune_pi(LOOSE, rise_time=1.5, probability=None, models=None, n=40)
    pi = tune_pi(LOOSE, rise_time=1.5, probability=0.9, draws=400, n=40)
    fresh = draws_of_models(LOOSE, 1000, seed=77)
    before, after = (robustness(fresh, p.gains, pi.specification, duration=10.0) for p in (plain, pi))
    assert before.probability < 0.75  # the smallest Ms lies on the edge of the limit
    assert after.probability > 0.9 - 3 * after.error
    assert pi.robustness.probability == pytest.approx(after.probability, abs=4 * pi.robustness.error)
    assert pi.feasible
    assert pi.figures.ms > plain.figures.ms


def test_a_probability_out_of_reach_is_told():
    wild = Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.1, cov_params=np.diag([0.0, 0.05**2]))
    pi = tune_pi(wild, rise_time=0.5, settling_time=0.8, overshoot=0.02, probability=0.99, draws=200, n=40)
    assert not pi.feasible
    assert any("probability" in told for told in pi.misses)


def test_several_models_are_held_at_their_worst():
    models = [Model([0.0, b], [1.0, -0.9], 1, 0.1) for b in (0.07, 0.1, 0.14)]
    pi = tune_pi(models[1], rise_time=1.5, models=models, probability=0.99, n=60)
    assert pi.robustness.probability == 1.0
    assert pi.robustness.worst["rise_time"] <= 1.5
    assert pi.robustness.n == 3


def test_draws_that_run_away_are_left_out_and_told():
    slow = Model(b=[0.0, 0.1], a=[1.0, -0.98], nk=1, sample_time=0.1, cov_params=np.diag([0.02**2, 1e-6]))
    plants = draws_of_models(slow, 1000, seed=1)
    assert plants.left_out / 1000 == pytest.approx(1 - NormalDist().cdf(1.0), abs=0.04)
    held = robustness(plants, PiGains(2.0, 1.0, 0.1), Specification(rise_time=3.0), duration=20.0)
    assert f"{plants.left_out} unstable draws" in held.verdict
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
        (lambda: draws_of_models(Model([0.0, 1.0], [1.0], 1, 0.1)), IdentError, "no covariance"),
        (lambda: draws_of_models(LOOSE, 3), UsageError, "10 or more"),
        (
            lambda: draws_of_models(Model([0.0, 0.1], [1.0, -0.999], 1, 0.1, cov_params=np.diag([1.0, 0.0]))),
            IdentError,
            "are unstable",
        ),
        (lambda: tune_pi(LOOSE, 1.5, probability=90, n=30), UsageError, "between 0 and 1"),
    ],
)
def test_what_cannot_be_drawn_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_the_error_of_a_share_is_never_zero():
    assert share_error(1.0, 500) > 0
    assert share_error(0.5, 500) == pytest.approx(np.sqrt(0.25 / 500), rel=0.01)
