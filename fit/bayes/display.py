"""Display of posteriors and priors: one registered function per class."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ...core.display import Display, TextTable, display_of, estimates
from ...core.rounding import with_error
from .competing_posterior import CompetingPosterior
from .convergence import ConvergenceChecks
from .joint_posterior import JointPosterior
from .posterior import Posterior
from .priors import Priors


def of_draws(head: str, table: pd.DataFrame, sentences: Sequence[str] = ()) -> Display:
    """Mean, standard deviation, interval, R-hat and effective sample size of each parameter."""
    least = np.minimum(table["ess_bulk"], table["ess_tail"])
    more = {"R-hat": [f"{v:.3f}" for v in table["r_hat"]], "ESS": [f"{v:.0f}" for v in least]}
    grid = estimates(list(table.index), table["mean"], table["sd"], list(table["low"]), list(table["high"]), more=more)
    return Display(head, (), TextTable(("", "mean", "sd", *grid.header[3:]), grid.rows), tuple(sentences))


@display_of.register
def of_posterior(post: Posterior) -> Display:
    """Draws, sampling method and convergence checks; the parameters."""
    names = ", ".join(
        f"{name} {with_error(float(m), float(s))}"
        for name, m, s in zip(post.names, post.draws.mean(axis=0), post.draws.std(axis=0, ddof=1), strict=True)
    )
    head = f"{post.response}, {len(post.draws)} {post.method} draws, {state(post.convergence)}: {names}"
    return of_draws(head, post.table(), (*post.convergence.reasons, post.sample.words, *post.notes))


@display_of.register
def of_joint_posterior(post: JointPosterior) -> Display:
    """Exponents of the true wear; the parameters of all laws."""
    return of_draws(post.words, post.table(), (*post.convergence.reasons, post.sample.words, *post.notes))


@display_of.register
def of_competing_posterior(post: CompetingPosterior) -> Display:
    """Comparison with the power law; the parameters."""
    return of_draws(post.words, post.table(), (*post.convergence.reasons, *post.notes))


@display_of.register
def of_convergence(checks: ConvergenceChecks) -> Display:
    """Whether the convergence checks passed, with the reasons where they failed."""
    return Display(state(checks), sentences=checks.reasons)


@display_of.register
def of_priors(priors: Priors) -> Display:
    """Distribution, unit and source of each prior."""
    rows = tuple(
        (
            name,
            f"{prior.name} {prior._display().head}".strip(),
            priors.units.get(name, ""),
            priors.sources.get(name, ""),
        )
        for name, prior in priors.of.items()
    )
    proper = "proper" if priors.proper else "improper"
    return Display(
        f"{priors.name}, {proper}, of {', '.join(priors.of)}", (), TextTable(("", "prior", "unit", "source"), rows)
    )


def state(checks: ConvergenceChecks) -> str:
    """``convergence checks passed`` or ``convergence checks failed``."""
    return f"convergence checks {'passed' if checks.passed else 'failed'}"
