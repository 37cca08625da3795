"""Importance sampling finds known moments, knows when it does not, and needs few calls of the density."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from fitmodels.core.errors import FitError
from fitmodels.fit.bayes.importance_sampling import find_mode, importance, root_of

pytestmark = pytest.mark.slow

SURE = 4.5  # Monte Carlo errors that a mean may be off: one in 150 000
CORRELATED = np.array([[4.0, 1.8, 0.0], [1.8, 1.0, 0.02], [0.0, 0.02, 0.01]])


@dataclass
class Target:
    """A density that is known; counts how often it is asked."""

    log_density: Any
    start: Any
    spread: Any
    calls: int = 0
    points: int = 0
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
        self.calls, self.points = self.calls + 1, self.points + len(phi)
        return self.log_density(phi)

    def by_unit(self, phi):
        return self.log_likelihood(phi)[:, None]


def normal(start=(0.0, 0.0, 0.0), spread=CORRELATED):
    P = np.linalg.inv(CORRELATED)
    return Target(lambda x: -0.5 * np.einsum("ij,jk,ik->i", x, P, x), np.array(start), np.array(spread))


def banana(b=0.5):
    """Haario, Saksman & Tamminen 1999, Comput. Stat. 14, 375: a normal twisted; the second has variance 1 + 2 b^2."""
    return Target(lambda x: -0.5 * x[:, 0] ** 2 - 0.5 * (x[:, 1] - b * (x[:, 0] ** 2 - 1)) ** 2, np.zeros(2), np.eye(2))


def half_normal():
    """ln of the size of a standard normal: on its own scale the mode is at zero, where the logarithm ends."""
    return Target(lambda u: u[:, 0] - 0.5 * np.exp(2 * u[:, 0]), np.array([-2.0]), np.eye(1))


def gamma(a=3.0):
    """ln of a gamma variable of shape a, mean a, variance a."""
    return Target(lambda u: a * u[:, 0] - np.exp(u[:, 0]), np.array([0.0]), np.eye(1))


def two_hills():
    """Normals at -2 and 2: mean 0, variance 5; between them, where it starts, the density bends the wrong way."""
    return Target(
        lambda x: np.logaddexp(-0.5 * (x[:, 0] - 2) ** 2, -0.5 * (x[:, 0] + 2) ** 2), np.zeros(1), 6 * np.eye(1)
    )


def cut_normal():
    """A standard normal above zero only, next to the edge of which it starts: mean sqrt(2/pi)."""
    return Target(lambda x: np.where(x[:, 0] > 0, -0.5 * x[:, 0] ** 2, -np.inf), np.array([0.01]), np.eye(1))


def heavy(df=0.3):
    """Student-t with tails far heavier than the proposal's: the weights have a Pareto shape of (5 - 0.3) / 5."""
    return Target(lambda x: -(df + 1) / 2 * np.log1p(x[:, 0] ** 2 / df), np.zeros(1), np.eye(1))


def funnel():
    """Neal 2003, Ann. Stat. 31, 705, section 8: the scale of nine is the exponential of the tenth, which has sd 3."""
    return Target(
        lambda x: -(x[:, 0] ** 2) / 18 - 4.5 * x[:, 0] - 0.5 * np.exp(-x[:, 0]) * (x[:, 1:] ** 2).sum(axis=1),
        np.zeros(10),
        np.eye(10),
    )


def off(values, mean, sd, ess):
    """How many Monte Carlo errors the mean is off."""
    return float(np.abs((values.mean(axis=0) - mean) / (sd / np.sqrt(ess))).max())


@pytest.mark.parametrize(
    ("target", "value", "mean", "sd"),
    [
        (normal(), lambda x: x, np.zeros(3), np.sqrt(np.diag(CORRELATED))),
        (normal(), lambda x: x**2, np.diag(CORRELATED), np.sqrt(2) * np.diag(CORRELATED)),
        (normal(), lambda x: x[:, 0] * x[:, 1], 1.8, np.sqrt(4 + 1.8**2)),
        (normal((9.0, -5.0, 1.0), 1e4 * np.eye(3)), lambda x: x, np.zeros(3), np.sqrt(np.diag(CORRELATED))),
        (normal((1.0, 1.0, 1.0), 1e-6 * np.eye(3)), lambda x: x, np.zeros(3), np.sqrt(np.diag(CORRELATED))),
        (normal(spread=np.ones((3, 3))), lambda x: x, np.zeros(3), np.sqrt(np.diag(CORRELATED))),
        (banana(), lambda x: x, np.zeros(2), np.sqrt([1, 1.5])),
        (half_normal(), lambda u: np.exp(u[:, 0]), np.sqrt(2 / np.pi), np.sqrt(1 - 2 / np.pi)),
        (gamma(), lambda u: np.exp(u[:, 0]), 3.0, np.sqrt(3.0)),
        (two_hills(), lambda x: x, 0.0, np.sqrt(5)),
        (two_hills(), lambda x: x**2, 5.0, np.sqrt(18.0)),
        (cut_normal(), lambda x: x, np.sqrt(2 / np.pi), np.sqrt(1 - 2 / np.pi)),
    ],
    ids=[
        "means of a correlated normal",
        "its variances",
        "its covariance",
        "started far off with a spread far too wide",
        "started off with a spread far too narrow",
        "a spread of rank one",
        "a banana",
        "a scale whose mode is zero",
        "ln of a gamma variable",
        "two hills, started between them",
        "their spread",
        "a normal cut off at zero",
    ],
)
def test_known_moments_are_found(target, value, mean, sd):
    sample = importance(target, np.random.default_rng(7))
    assert sample.k_hat < 0.7
    assert off(value(sample.phi), mean, sd, sample.ess) < SURE


@pytest.mark.parametrize("target", [heavy(), funnel()], ids=["heavy tails", "Neal's funnel"])
def test_what_it_cannot_do_it_says(target):
    sample = importance(target, np.random.default_rng(7))
    assert sample.k_hat > 0.7
    assert "unreliable" in sample.words
    assert len(sample.phi) == 4000


def test_as_many_are_effective_as_were_asked_for():
    for draws in (400, 4000):
        sample = importance(normal(), np.random.default_rng(1), draws)
        assert sample.ess >= draws
        assert sample.phi.shape == (draws, 3)
        assert (sample.chains, sample.method) == (1, "importance")
        assert sample.ess == pytest.approx(float(sample.words.split(", ")[1].split()[0]), abs=1)


def test_a_second_proposal_helps_where_the_mass_lies_far_from_the_mode():
    """ln of a gamma variable of shape 0.15, whose mode and curvature there tell little of its long left tail."""
    target = Target(lambda u: 0.15 * u[:, 0] - np.exp(u[:, 0]), np.array([0.0]), np.eye(1))
    sample = importance(target, np.random.default_rng(3))
    assert "weighted mean" in sample.words
    assert sample.k_hat < 0.7
    assert off(np.exp(sample.phi[:, 0]), 0.15, np.sqrt(0.15), sample.ess) < SURE


def test_the_same_seed_gives_the_same_draws():
    one, again, other = (importance(banana(), np.random.default_rng(seed)).phi for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_the_mode_of_a_normal_takes_two_rounds_and_is_exact():
    target = normal((3.0, -2.0, 0.5), np.eye(3))
    mode = find_mode(target)
    np.testing.assert_allclose(mode.at, 0.0, atol=1e-6)
    np.testing.assert_allclose(mode.root @ mode.root.T, CORRELATED, rtol=1e-4, atol=1e-6)
    assert target.calls <= 5  # the start, two stencils, lengths between them


def test_the_mode_agrees_with_scipys():
    from scipy.optimize import minimize

    target = gamma()
    reference = minimize(lambda u: -target.log_density(u[None])[0], [0.5], tol=1e-10).x
    np.testing.assert_allclose(find_mode(target).at, reference, atol=1e-3)


def test_where_the_density_bends_the_wrong_way_the_given_spread_serves():
    mode = find_mode(two_hills())
    assert not mode.curved
    np.testing.assert_allclose(mode.root @ mode.root.T, 6 * np.eye(1))


def test_a_covariance_of_lower_rank_has_a_root_all_the_same():
    root = root_of(np.array([[1.0, 2.0], [2.0, 4.0]]))
    assert np.linalg.matrix_rank(root) == 2
    np.testing.assert_allclose(root_of(CORRELATED) @ root_of(CORRELATED).T, CORRELATED, rtol=1e-9, atol=1e-12)


def test_a_start_without_density_is_refused():
    nowhere = Target(lambda x: np.full(len(x), -np.inf), np.zeros(2), np.eye(2))
    with pytest.raises(FitError, match="the posterior density is zero at its start"):
        importance(nowhere, np.random.default_rng(1))
