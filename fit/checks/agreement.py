"""Agreement of several estimates of one exponent: by edge, with a random level of edges, within edges, posterior.

Where a law is right they estimate the same number and differ by less than their errors. They answer different
questions where it is not: the pooled estimate uses differences between edges as well, the estimate within edges none of
them, and a random level and a posterior lie between the two. Estimates of the same rows are positively correlated, so
that the error of a difference is at most that of independent estimates, which is used here.

Sources: Hausman 1978, Econometrica 46, 1251; Mundlak 1978, Econometrica 46, 69.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import FitError
from ...core.rounding import with_error
from ..available import NotAvailable
from ..composite_law import without_fixed
from ..edges import EdgeInference, left_out_moves
from ..lawfit import LawFit
from ..least_squares import sums_by
from ..regression import refitted
from .check import SIGNIFICANT, Check, format_p
from .strata import no_scatter

if TYPE_CHECKING:
    from ..bayes.posterior import Posterior

MATTERS = 0.1  # of the logarithm of the response, over the tested range, by which a fixed exponent may be wrong
APART = 0.005  # of each tail: probability of so large a difference of two estimates of one exponent
CONTRADICTS = 3.0  # standard deviations between a prior and an estimate, from which on they contradict each other
CAUSES = (
    "usual causes: times of some edges that start later or have another unit, edges that were stopped by their wear, "
    "a factor that is missing, or rows of an edge that follow each other"
)


@dataclass(frozen=True, slots=True)
class Estimate:
    """One estimate of an exponent.

    Attributes
    ----------
    method : str
        ``within edges``, ``posterior`` and so on, as it stands in a sentence.
    value, se : float
        Estimate and its standard error.
    """

    method: str
    value: float
    se: float

    def __str__(self) -> str:
        """Estimate with its standard error and method."""
        return f"{self.value:.3f} ± {self.se:.3f} ({self.method})"


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Agreement(Check):
    """The two estimates of one exponent that differ most, in standard errors of their difference (the statistic).

    Attributes
    ----------
    exponent : str
    estimates : tuple of Estimate
    """

    exponent: str
    estimates: tuple[Estimate, Estimate]


def compare_estimates(law: LawFit, others: Mapping[str, Sequence[Estimate]] | None = None) -> Agreement | NotAvailable:
    """Compare the estimates of each exponent of a law, and further estimates of ``others`` by exponent.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> compare_estimates(law).concern
    0
    >>> compare_estimates(law, {"t": [Estimate("another program", 0.6, 0.01)]}).exponent
    't'
    """
    from scipy.special import stdtrit

    law = without_fixed(law)
    if reason := no_scatter(law):
        return NotAvailable(reason)
    if not isinstance(law.edges, EdgeInference):
        return law.edges
    found = estimates_of(law)
    for name, more in (others or {}).items():
        found.setdefault(name, []).extend(more)
    pairs = [
        (abs(a.value - b.value) / np.hypot(a.se, b.se), name, (a, b))
        for name, estimates in found.items()
        for a, b in combinations(estimates, 2)
        if np.hypot(a.se, b.se) > 0
    ]
    if not pairs:
        return NotAvailable("each exponent has one estimate only")
    apart, name, pair = max(pairs, key=lambda item: item[0])
    limit = float(stdtrit(law.edges.df, 1 - APART))
    kept = f"Estimates of each exponent agree within their errors: at most, {name} is {pair[0]} and {pair[1]}."
    what = "exponent" if law.form == "power" else "coefficient"
    disagree = f"Two estimates of the {what} of {name} disagree: {pair[0]} and {pair[1]}; {CAUSES}."
    return Agreement(
        null="all estimates of an exponent are of the same number",
        statistic=float(apart),
        symbol="largest difference in SE",
        concern=int(apart > limit),
        verdict=disagree if apart > limit else kept,
        exponent=name,
        estimates=pair,
    )


def posterior_agreement(law: LawFit, posterior: "Posterior") -> Agreement | NotAvailable:
    """Compare the posterior of each exponent of a law with its other estimates.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> posterior_agreement(law, fit.posterior(law, seed=1)).concern
    0
    """
    return compare_estimates(law, of_draws(law, "posterior", posterior.names, posterior.draws))


def contradicting_prior(law: LawFit, posterior: "Posterior") -> Check | None:
    """The normal prior of the user that lies furthest from the estimate of these tests; None where none contradicts it.

    The draws are then a compromise of two different numbers, or repeat the prior, and are no estimate of these tests.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> given = {"AW": {"V": {"distribution": "normal", "mean": 3.0, "sd": 0.1}}}
    >>> contradicting_prior(law, fit.posterior(law, priors=given)).concern
    1
    """
    from ..bayes.priors import Normal, weak

    usual = weak(law, "icc" in posterior.priors.of).of
    priors = {j: posterior.priors.of[name] for j, name in enumerate(("level", *law.theta_names[1:]))}
    given = {j: one for j, one in priors.items() if isinstance(one, Normal) and one not in usual.values()}
    to_level = np.eye(len(law.theta))
    to_level[0, 1:] = posterior.density.centre[1:]
    value, se = to_level @ law.theta, np.sqrt(np.diag(to_level @ law.covariance() @ to_level.T))
    apart = {j: abs(one.mean - float(value[j])) / float(np.hypot(one.sd, se[j])) for j, one in given.items()}
    j = max(apart, key=apart.__getitem__, default=0)
    if apart.get(j, 0.0) <= CONTRADICTS:
        return None
    drawn = posterior.draws[:, : len(law.theta)] @ to_level[j]
    return Check(
        null="priors that were given agree with the tests",
        statistic=apart[j],
        symbol="largest difference in SD",
        concern=1,
        verdict=_contradiction(
            law, j, (given[j].mean, given[j].sd), (float(value[j]), float(se[j])), (drawn.mean(), drawn.std())
        ),
    )


def _contradiction(law: LawFit, j: int, *three: tuple[float, float]) -> str:
    """The sentence on a prior, an estimate and a posterior, each with its standard deviation."""
    if j == 0 and law.formula.logarithmic:
        three = tuple((float(np.exp(value)), float(np.exp(value) * np.expm1(sd))) for value, sd in three)
    unit = law.units[law.response] if j == 0 else ""
    prior, estimate, drawn = (with_error(value, sd, unit) for value, sd in three)
    what = law.theta_names[j] if j else f"the level ({law.response} at the middle of the tests)"
    return (
        f"The prior of {what}, {prior}, contradicts the tests, {estimate}: the posterior, {drawn}, and limits and "
        "replay from its draws are no result of these tests."
    )


def fixed_exponents(law: LawFit) -> Check | NotAvailable | None:
    """Test of exponents that were given, not estimated, against the estimates of these rows; None without any.

    It is a concern where an estimate differs by more than chance and changes the response by more than 10 % over the
    tested range. The p-value is the smallest one times the number of exponents (Bonferroni).

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.regression.fit_form(runs, "power", "P", ["V", "f", "d", "t"], fixed={"V": 1.0, "d": 0.2})
    >>> fixed_exponents(law).concern
    1
    """
    from scipy.special import stdtr

    if not law.formula.fixed:
        return None
    if reason := no_scatter(law):
        return NotAvailable(reason)
    at = {name: law.factors.index(name) for name, _ in law.formula.fixed}
    constant = tuple(one for one in law.formula.fixed if np.ptp(law.X[:, at[one[0]]]) == 0)
    tested = [one for one in law.formula.fixed if one not in constant]
    if not tested:
        return NotAvailable(f"{', '.join(at)} did not change: the exponent is not tested by these rows")
    try:
        free = refitted(replace(law, formula=replace(law.formula, fixed=constant)), "multiplicative")
    except FitError as error:
        return NotAvailable(f"with an exponent estimated: {str(error).rstrip('.')}")
    if free.no_interval:
        return NotAvailable(f"with an exponent estimated there is {free.no_interval}")
    found = []
    for name, value in tested:
        b, se, (low, high) = float(free.params[name]), float(free.bse[name]), law.domain[name]
        p = min(1.0, len(tested) * 2 * float(stdtr(free.df, -abs(b - value) / se))) if se > 0 else 1.0
        found.append((p, abs(b - value) * float(np.log(high / low)), name, value, b, free.conf_int().loc[name]))
    p, change, name, value, b, ends = min(found, key=lambda one: one[0])
    result = f"these rows give {b:.3g} (95 % CI {ends['low']:.3g} to {ends['high']:.3g}), {format_p(p)}"
    differs = (
        f"The exponent of {name} is fixed at {value:g}, but {result}: that changes {law.response} by "
        f"{100 * np.expm1(change):.0f} % over the tested {name}. Estimate it, or keep to one {name}."
    )
    kept = f"The fixed exponent of {name}, {value:g}, agrees with these rows ({result})."
    near = f"The fixed exponent of {name} is {value:g}; {result}, which hardly changes {law.response} in the tests."
    concern = int(p < SIGNIFICANT and change > MATTERS)
    return Check(
        null="exponents that were given are those of these rows",
        statistic=float((b - value) / free.bse[name]) if free.bse[name] > 0 else 0.0,
        symbol="t",
        df=free.df,
        pvalue=p if change > MATTERS else None,
        concern=concern,
        verdict=differs if concern else near if p < SIGNIFICANT else kept,
        kept=kept,
    )


def of_draws(law: LawFit, method: str, names: Sequence[str], draws: np.ndarray) -> dict[str, list[Estimate]]:
    """Mean and standard deviation of draws, shape (S, q), of the exponents of a law."""
    return {
        name: [Estimate(method, float(draws[:, j].mean()), float(draws[:, j].std(ddof=1)))]
        for j, name in enumerate(names)
        if name in law.factors
    }


def estimates_of(law: LawFit) -> dict[str, list[Estimate]]:
    """Estimates by edge, with a random level and within edges, of each factor of a law with inference by edge."""
    if not isinstance(law.edges, EdgeInference):
        return {}
    mixed, pooled = law.edges.mixed, np.sqrt(np.diag(law.edges.cov_theta))
    found = {
        name: [
            Estimate("rows, errors by edge", float(law.theta[j]), float(pooled[j])),
            Estimate("random level of edges", float(mixed.theta[j]), float(mixed.bse[j])),
        ]
        for j, name in enumerate(law.theta_names)
        if name in law.factors
    }
    for name, estimate in _within(law).items():
        found[name].append(estimate)
    return found


def _within(law: LawFit) -> dict[str, Estimate]:
    """Estimates from differences within edges alone, with errors by edge; none where an edge alone determines one."""
    if not isinstance(law.edges, EdgeInference) or law.error != "multiplicative" or law.edge is None:
        return {}
    inside = [j for j, within in enumerate(law.edges.within) if within and law.theta_names[j] in law.factors]
    if not inside:
        return {}
    edge = np.unique(law.edge, return_inverse=True)[1]
    rows = np.column_stack([law.gradient[:, inside], law.residuals])
    rows = rows - (sums_by(edge, rows, law.edges.n_edges) / np.bincount(edge)[:, None])[edge]
    W, r = rows[:, :-1], rows[:, -1]
    if np.linalg.matrix_rank(W) < len(inside):
        return {}
    unscaled = np.linalg.inv(W.T @ W)
    step = unscaled @ (W.T @ r)
    moved = left_out_moves(W, r - W @ step, unscaled, edge, law.edges.n_edges)
    if isinstance(moved, int):
        return {}
    G = law.edges.n_edges
    se = np.sqrt((G - 1) / G * (moved**2).sum(axis=0))
    return {
        law.theta_names[j]: Estimate("within edges", float(law.theta[j] + step[i]), float(se[i]))
        for i, j in enumerate(inside)
    }
