"""Posteriors of laws as the posterior section, and their draws as bytes, where the convergence checks passed."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import GateError, ParameterError
from ..draws import Draws, packed

if TYPE_CHECKING:
    from ...fit import NotAvailable
    from ...fit.bayes.posterior import Posterior
    from ...fit.bayes.priors import Prior, Priors
    from ..sections.posterior import LawPosterior

DRAWS_FILE = "draws.npz"


def posterior_section(
    posteriors: Sequence["Posterior"], none: Mapping[str, "NotAvailable"], draws_file: str | None = DRAWS_FILE
) -> dict[str, Any]:
    """The section of a parameter file for posteriors, at most one a response, and reasons where there is ``none``.

    ``draws_file`` None: the draws are not kept, and the seed makes them again.

    Raises
    ------
    GateError
        The convergence checks of a posterior failed.
    ParameterError
        Two posteriors of one response, or draws of several seeds.
    """
    seeds = {post.seed for post in posteriors} or {0}
    if len(seeds) > 1:
        raise ParameterError(f"posteriors of the seeds {sorted(seeds)}: a parameter file holds one seed; draw again.")
    laws: dict[str, Any] = {response: {"reason": why.reason} for response, why in none.items()}
    for post in posteriors:
        if not post.convergence.passed:
            raise GateError(
                f"{post.response}: convergence checks of the draws failed, so no parameter file is written: "
                + " ".join(post.convergence.reasons)
            )
        if post.response in laws:
            raise ParameterError(f"there are two posteriors of {post.response}; a parameter file holds one.")
        laws[post.response] = _one(post)
    section: dict[str, Any] = {"seed": seeds.pop(), "laws": laws}
    if posteriors and draws_file is not None:
        digest = hashlib.sha256(draws_of(posteriors)).hexdigest()
        section |= {"draws_file": draws_file, "draws_sha256": digest}
    return section


def draws_of(posteriors: Sequence["Posterior"]) -> bytes:
    """Bytes of the file of draws."""
    return packed({post.response: Draws(post.names, post.draws) for post in posteriors})


def _one(post: "Posterior") -> dict[str, Any]:
    table, centre = post.table(), post.density.centre[1:]
    return {
        "method": post.method,
        "words": post.sample.words,
        "errors": post.errors,
        "draws": len(post.draws),
        "level": 0.95,
        "parameters": {
            name: {key: float(row[key]) for key in ("mean", "sd", "median", "low", "high")}
            for name, row in table.iterrows()
        },
        "priors": {name: _prior(post, name) for name in post.priors.of},
        "prior_set": post.priors.name,
        "level_at": dict(zip(post.law.theta_names[1:], map(float, centre), strict=True)),
        "r_hat": float(table["r_hat"].max()),
        "ess": float(table[["ess_bulk", "ess_tail"]].to_numpy().min()),
        "k_hat": None if post.sample.k_hat is None or not np.isfinite(post.sample.k_hat) else post.sample.k_hat,
        "verified": None if post.agreement is None else post.agreement.words,
        **_by_edge(post),
    }


def _by_edge(post: "Posterior") -> dict[str, Any]:
    """Prior sensitivity and what leaves out edges; each that fails is a note with its reason."""
    from ...fit.available import NotAvailable, computed

    moves, left, se = computed(post.sensitivity), computed(post.leave_out), computed(post.jackknife)
    failed = {"prior sensitivity": moves, "jackknife by edge": se, "leaving out edges": left}
    notes = [
        f"{name} not available: {why}" for name, why in failed.items() if isinstance(why, NotAvailable) and why.failed
    ]
    found: dict[str, Any] = {"sensitivity": {}, "jackknife": {}, "elpd": None, "elpd_se": None}
    if not isinstance(moves, NotAvailable):
        rows = moves.iterrows()
        found["sensitivity"] = {name: {key: float(row[key]) for key in ("halved", "doubled")} for name, row in rows}
    if not isinstance(se, NotAvailable) and se is not None:
        found["jackknife"] = {str(name): float(value) for name, value in se.items()}
    if not isinstance(left, NotAvailable):
        found |= {"elpd": left.elpd, "elpd_se": None if isinstance(left.se, NotAvailable) else left.se}
    return {**found, "notes": (*post.notes, *notes)}


def _prior(post: "Posterior", name: str) -> dict[str, Any]:
    prior = post.priors.of[name]
    return {
        "distribution": prior.name,
        "numbers": {field.name: float(getattr(prior, field.name)) for field in fields(prior)},
        "unit": post.priors.units.get(name, ""),
        "source": post.priors.sources.get(name, ""),
    }


def priors_of(section: "LawPosterior") -> "Priors | None":
    """Priors of a posterior of a file, None where one is of a kind that a fit does not have."""
    from ...fit.bayes.priors import Beta, Flat, HalfT, Normal, Priors

    kinds: dict[str, type[Prior]] = {kind.name: kind for kind in (Normal, HalfT, Beta, Flat)}
    if any(prior.distribution not in kinds for prior in section.priors.values()):
        return None
    of = {name: kinds[prior.distribution](**prior.numbers) for name, prior in section.priors.items()}
    units = {name: prior.unit for name, prior in section.priors.items()}
    sources = {name: prior.source for name, prior in section.priors.items()}
    return Priors(of, section.prior_set or "given", units, sources)
