"""The gate before draws: when it shuts, and what it says then."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from fitmodels.fit.bayes.convergence import check_convergence
from fitmodels.fit.bayes.density import Sample
from fitmodels.fit.bayes.diagnostics import Diagnostics, diagnose

GOOD = Diagnostics(
    names=("V", "f", "sd"),
    chains=4,
    length=1000,
    r_hat=np.array([1.0, 1.002, 1.01]),
    ess_bulk=np.array([3900.0, 400.0, 2000.0]),
    ess_tail=np.array([3900.0, 3000.0, 400.0]),
    mcse=np.array([0.1, 0.1, 0.1]),
    k_hat=0.7,
    tau=np.array([1.0, 20.0, 2.0]),
    ess_route=400.0,
)


def array(*values):
    return np.array(values, dtype=float)


def test_it_opens_at_the_limits_themselves():
    reported = check_convergence(GOOD)
    assert reported.passed
    assert reported.reasons == ()


def test_what_a_route_does_not_know_shuts_nothing():
    assert check_convergence(replace(GOOD, k_hat=None, tau=None, ess_route=None)).passed


def test_equal_weights_are_as_good_as_weights_can_be():
    assert check_convergence(replace(GOOD, k_hat=-np.inf)).passed


SHUT = [
    (
        {"ess_bulk": array(3900, 100, 2000)},
        "f: 100 effective draws in bulk, below 400: run longer: 18000 draws instead of 4000.",
    ),
    (
        {"ess_bulk": array(200, 100, 300)},
        "f (and 2 more): 100 effective draws in bulk, below 400: run longer: 18000 draws instead of 4000.",
    ),
    (
        {"ess_tail": array(3900, 3000, 399)},
        "sd: 399 effective draws in the tails, below 400: run longer: 4500 draws instead of 4000.",
    ),
    (
        {"ess_tail": array(0, 3000, 3000)},
        "V: 0 effective draws in the tails, below 400: run longer, ten times the draws or more.",
    ),
    (
        {"ess_route": 250.0},
        "250 of 4000 draws are effective by their weights, below 400: run longer: 7100 draws instead of 4000.",
    ),
    (
        {"r_hat": array(1.0, 1.02, 1.16)},
        "sd (and 1 more): R-hat 1.160 is above 1.01: the chains differ; run twice the draws or more; if they "
        "still differ, give informative --priors for it, or leave its term out.",
    ),
    (
        {"k_hat": 0.83},
        "k-hat 0.83 of the importance weights is above 0.7: a few draws have most of the weight; use MCMC, "
        'method="emcee".',
    ),
    (
        {"tau": array(1, 48, 2)},
        "chains of 1000 draws hold 21 autocorrelation times of f, fewer than 50: run longer: 2400 draws a chain.",
    ),
    (
        {"tau": array(48, 2)},  # of a density with other parameters than those reported
        "chains of 1000 draws hold 21 autocorrelation times, fewer than 50: run longer: 2400 draws a chain.",
    ),
    (
        {"tau": array(1, 1, np.inf)},
        "the autocorrelation time of sd is infinite: a walker accepted no proposal; run longer, with another seed.",
    ),
]


@pytest.mark.parametrize(("changed", "sentence"), SHUT, ids=[f"{next(iter(c))}-{i}" for i, (c, _) in enumerate(SHUT)])
def test_each_fault_shuts_it_with_one_sentence(changed, sentence):
    reported = check_convergence(replace(GOOD, **changed))
    assert not reported.passed
    assert reported.reasons == (sentence,)


@pytest.mark.parametrize("field", ["r_hat", "ess_bulk", "ess_tail", "tau"])
def test_what_is_not_a_number_is_bad(field):
    reported = check_convergence(
        replace(GOOD, **{field: array(np.nan, 500, 500) if field != "r_hat" else array(1, np.nan, 1)})
    )
    assert not reported.passed


@pytest.mark.parametrize("field", ["k_hat", "ess_route"])
def test_so_it_is_for_the_route(field):
    assert not check_convergence(replace(GOOD, **{field: float("nan")})).passed


def test_one_draw_is_granted_to_what_thinning_cut_off():
    """A run of 50.4 times kept one draw a time is 50 draws or, for where it began, 49."""
    assert check_convergence(replace(GOOD, length=49, tau=array(1, 1, 1))).passed
    assert not check_convergence(replace(GOOD, length=48, tau=array(1, 1, 1))).passed


@dataclass
class Compared:
    agrees: bool
    words: str


def test_routes_that_disagree_shut_it():
    reported = check_convergence(GOOD, Compared(False, "the two routes disagree: the mean of V differs most"))
    assert reported.reasons == ("the two routes disagree: the mean of V differs most.",)
    assert check_convergence(GOOD, Compared(True, "the two routes agree")).passed


def test_a_stopped_run_shuts_it_whatever_the_draws_say():
    reported = check_convergence(GOOD, interrupted=True)
    assert not reported.passed
    assert reported.reasons == ("the run was interrupted: run it again to its end.",)


def test_every_reason_is_reported():
    faults = replace(GOOD, r_hat=array(1.5, 1, 1), ess_bulk=array(9, 900, 900), ess_tail=array(9, 900, 900), k_hat=2.0)
    assert len(check_convergence(faults, Compared(False, "they differ"), interrupted=True).reasons) == 6


def drawn(draws, **facts):
    return check_convergence(diagnose(("V", "f"), draws, Sample(draws, 1, "exact", "drawn for a test", **facts)))


def test_independent_draws_open_it():
    assert drawn(np.random.default_rng(1).normal(size=(4000, 2))).passed


def test_draws_that_never_moved_are_reported_once():
    draws = np.random.default_rng(1).normal(size=(4000, 2))
    draws[:, 0] = 0.25
    assert drawn(draws).reasons == ("V: all draws are 0.25: the chains are constant.",)


def test_a_draw_that_is_no_number_is_reported_once():
    draws = np.random.default_rng(1).normal(size=(4000, 2))
    draws[17, 1] = np.nan
    assert drawn(draws).reasons == ("f: 1 of 4000 draws are not finite numbers.",)


def test_too_few_draws_never_open_it():
    for S in (0, 1, 15, 16, 100, 300):
        assert not drawn(np.random.default_rng(1).normal(size=(S, 2))).passed
