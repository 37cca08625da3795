"""Chains find known moments, repeat themselves, and keep what they have when they are stopped."""

from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np
import pytest
from fitmodels.core.errors import FitError
from fitmodels.fit.bayes.diagnostics import diagnose, ess_mean
from fitmodels.fit.bayes.ensemble_sampler import HalfByHalf, along_differences, chains, towards_others

pytestmark = pytest.mark.slow

SURE = 4.5  # Monte Carlo errors that a mean may be off: one in 150 000
CORRELATED = np.array([[4.0, 1.8, 0.0], [1.8, 1.0, 0.02], [0.0, 0.02, 0.01]])


@dataclass
class Target:
    """A density that is known."""

    log_density: Any
    start: Any
    spread: Any
    units: tuple[str, ...] = ("all",)

    @property
    def names(self):
        return tuple(f"x{j}" for j in range(len(self.start)))

    parameter_names = names

    def parameters(self, phi):
        return phi

    def log_prior(self, phi):
        return np.zeros(len(phi))

    def log_likelihood(self, phi):
        return self.log_density(phi)

    def by_unit(self, phi):
        return self.log_likelihood(phi)[:, None]


def normal():
    P = np.linalg.inv(CORRELATED)
    return Target(lambda x: -0.5 * np.einsum("ij,jk,ik->i", x, P, x), np.array([1.0, 1.0, 0.0]), CORRELATED)


def banana(b=1.0):
    """Haario, Saksman & Tamminen 1999, Comput. Stat. 14, 375: a normal twisted; the second has variance 1 + 2 b^2."""
    return Target(lambda x: -0.5 * x[:, 0] ** 2 - 0.5 * (x[:, 1] - b * (x[:, 0] ** 2 - 1)) ** 2, np.zeros(2), np.eye(2))


def half_normal():
    """ln of the size of a standard normal: on its own scale the mode is at zero, where the logarithm ends."""
    return Target(lambda u: u[:, 0] - 0.5 * np.exp(2 * u[:, 0]), np.array([-2.0]), np.eye(1))


def student(df=5.0):
    return Target(lambda x: -(df + 1) / 2 * np.log1p(x[:, 0] ** 2 / df), np.zeros(1), np.eye(1))


def cut_normal():
    """A standard normal above zero only, next to the edge of which it starts: mean sqrt(2/pi)."""
    return Target(lambda x: np.where(x[:, 0] > 0, -0.5 * x[:, 0] ** 2, -np.inf), np.array([0.01]), np.eye(1))


def funnel():
    """Neal 2003, Ann. Stat. 31, 705, section 8, of two: the logarithm of the variance of the second has sd 3."""
    return Target(
        lambda x: -(x[:, 0] ** 2) / 18 - 0.5 * x[:, 0] - 0.5 * np.exp(-x[:, 0]) * x[:, 1] ** 2, np.zeros(2), np.eye(2)
    )


def off(sample, value, mean, sd):
    """How many Monte Carlo errors the mean is off."""
    x = value(sample.phi)
    x = x.reshape(len(x), -1)
    effective = ess_mean(x.reshape(sample.chains, -1, x.shape[1]))
    return float(np.abs((x.mean(axis=0) - mean) / (sd / np.sqrt(effective))).max())


@pytest.mark.parametrize(
    ("target", "value", "mean", "sd"),
    [
        (normal(), lambda x: x, np.zeros(3), np.sqrt(np.diag(CORRELATED))),
        (normal(), lambda x: x**2, np.diag(CORRELATED), np.sqrt(2) * np.diag(CORRELATED)),
        (banana(), lambda x: x, np.zeros(2), np.sqrt([1, 3.0])),
        (half_normal(), lambda u: np.exp(u[:, 0]), np.sqrt(2 / np.pi), np.sqrt(1 - 2 / np.pi)),
        (student(), lambda x: x, 0.0, np.sqrt(5 / 3)),
        (cut_normal(), lambda x: x, np.sqrt(2 / np.pi), np.sqrt(1 - 2 / np.pi)),
    ],
    ids=[
        "means of a correlated normal",
        "its variances",
        "a banana",
        "a scale whose mode is zero",
        "Student's t",
        "a normal cut off at zero",
    ],
)
def test_known_moments_are_found_and_the_gate_would_open(target, value, mean, sd):
    sample = chains(target, seed=3, ess=2000)
    reported = diagnose(target.names, sample.phi, sample)
    assert reported.r_hat.max() <= 1.01
    assert min(reported.ess_bulk.min(), reported.ess_tail.min()) >= 2000
    assert off(sample, value, mean, sd) < SURE
    assert "before the convergence" not in sample.words


def test_a_funnel_is_either_found_or_refused():
    """Nothing that shows its neck and mouth too rarely may pass for the whole of it."""
    sample = chains(funnel(), seed=3, ess=1000, most=3000)
    reported = diagnose(("ln variance", "x"), sample.phi, sample)
    passed = reported.r_hat.max() <= 1.01 and min(reported.ess_bulk.min(), reported.ess_tail.min()) >= 1000
    assert passed != ("before the convergence checks passed" in sample.words)
    if passed:
        assert off(sample, lambda x: x[:, 0], 0.0, 3.0) < SURE


@pytest.mark.parametrize("propose_from", [towards_others, along_differences])
def test_each_move_alone_leaves_a_skewed_density_as_it_is(propose_from):
    """Beside emcee's own stretch move, on ln of gamma variables of shape 2: mean of the variables 2, variance 2."""

    def height(u):
        return (2 * u - np.exp(u)).sum(axis=1)

    means = []
    for moves in (HalfByHalf(propose_from), emcee.moves.StretchMove()):
        sampler = emcee.EnsembleSampler(40, 2, height, vectorize=True, moves=moves)
        sampler.random_state = np.random.RandomState(5).get_state()
        sampler.run_mcmc(np.random.RandomState(6).randn(40, 2) * 0.5 + 0.5, 1500)
        x = np.exp(sampler.get_chain()[300:]).swapaxes(0, 1)
        means.append((x.mean(axis=(0, 1)), np.sqrt(2 / ess_mean(x)), (x.var(axis=(0, 1)))))
    (ours, error, variance), (theirs, other_error, _) = means
    assert (np.abs(ours - 2) < SURE * error).all()
    assert (np.abs(ours - theirs) < SURE * np.hypot(error, other_error)).all()
    np.testing.assert_allclose(variance, 2.0, rtol=0.15)


def test_the_same_seed_gives_the_same_draws_and_no_other_state_is_touched():
    np.random.seed(1)  # noqa: NPY002 the global state is what this is about
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    one = chains(normal(), seed=1, ess=400)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.random.seed(99)  # noqa: NPY002
    again, other = chains(normal(), seed=1, ess=400), chains(normal(), seed=2, ess=400)
    np.testing.assert_array_equal(one.phi, again.phi)
    assert one.words == again.words
    assert one.phi.shape != other.phi.shape or not np.array_equal(one.phi, other.phi)


def test_draws_stand_walker_after_walker():
    """Within a walker one draw follows from the one before it; between walkers nothing does."""
    sample = chains(normal(), seed=1, ess=400)
    assert sample.phi.shape[0] % sample.chains == 0
    assert sample.tau.shape == (3,)
    assert sample.method == "emcee"
    assert sample.k_hat is None
    assert 400 <= sample.ess <= len(sample.phi)


def stop_at(step):
    def progress(steps, ess):
        if steps >= step:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_run_keeps_what_it_has():
    sample = chains(normal(), seed=1, progress=stop_at(60))
    assert sample.interrupted
    assert "interrupted before the convergence checks passed" in sample.words
    assert "60 steps" in sample.words
    assert len(sample.phi) >= 8 * sample.chains
    assert np.isfinite(sample.phi).all()


def test_an_interrupt_before_there_is_anything_ends_it():
    with pytest.raises(KeyboardInterrupt):
        chains(normal(), seed=1, progress=stop_at(10))


def test_progress_hears_of_steps_and_effective_draws():
    heard = []
    chains(normal(), seed=1, ess=1000, progress=lambda steps, ess: heard.append((steps, ess)))
    steps, ess = np.array(heard).T
    np.testing.assert_array_equal(np.diff(steps), 10)
    assert ess[0] == 0
    assert ess[-1] >= 1000


@pytest.mark.parametrize("most", [1, 60, 250])
def test_at_the_most_steps_it_returns_what_there_is(most):
    sample = chains(normal(), seed=1, ess=100_000, most=most)
    assert "before the convergence checks passed" in sample.words
    assert not sample.interrupted
    assert len(sample.phi) >= sample.chains


def test_a_start_without_density_is_refused():
    nowhere = Target(lambda x: np.full(len(x), -np.inf), np.zeros(2), np.eye(2))
    with pytest.raises(FitError, match="the posterior density is zero at its start"):
        chains(nowhere, seed=1)
