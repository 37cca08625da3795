"""Posterior of a law: options are validated, priors completed, the sampling method chosen."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np

from ...core.errors import FitError, UsageError
from ...core.threads import one_thread
from ..edges import EdgeInference
from .convergence import Agreement, agree
from .density import Errors, LawDensity, Method, Sample, law_density
from .posterior import Posterior
from .priors import Flat, Priors, reference, weak
from .priors_file import read_priors, replaced
from .sampling import Drawn, Progress, drawn, judged

if TYPE_CHECKING:
    from ..lawfit import LawFit

FEWEST, MOST = 1000, 1_000_000  # draws: below the first no gate opens, but by chance
MOST_ROWS = 100_000  # of a law that is not linear: every draw looks at every row
APART = 7919  # between the seed of the draws and that of the chains that verify them


@one_thread
def posterior(
    law: "LawFit",
    *,
    seed: int = 1,
    draws: int = 4000,
    priors: str | Path | Priors | Mapping[str, object] = "weak",
    errors: Errors = "normal",
    method: Method | None = None,
    verify: bool = False,
    progress: Progress | None = None,
) -> Posterior:
    """Draws of the parameters of a law.

    Parameters
    ----------
    law : LawFit
        Edges have a random level where the law names several edges and some of them gave several rows.
    seed : int
        The same seed gives the same draws, bit for bit.
    draws : int
    priors : "weak", "reference", Priors, a mapping as read from a priors file, or the path of such a file
        Proper and weak unless given; ``reference`` is flat.
    errors : {"normal", "student"}
        Student-t errors, of unknown degrees of freedom, make little of rows (edges) that lie far off.
    method : {"exact", "importance", "emcee"}, optional
        Chosen by the model: exact where the law is linear on the scale of its normal errors, else importance
        sampling, and chains where its k-hat exceeds 0.7.
    verify : bool
        Run chains beside, and compare.
    progress : callable, optional
        Called with the steps done and the effective draws so far.

    Raises
    ------
    UsageError
        An option that there is not, or priors that cannot be.
    FitError
        Observations that fix the parameters exactly, or a law that meets them exactly.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> post = fit.posterior(law)
    >>> bool(abs(post.draws[:, 1].mean() - law.params["V"]) < law.bse["V"])
    True
    """
    _check(law, draws, seed, errors, method)
    edges, notes = _edges(law)
    density = law_density(law, _priors(law, priors, edges), errors)
    linear = errors == "normal" and not (density.natural and law.law.logarithmic)
    if method == "exact" and not linear:
        raise UsageError(f"{law.response}: no exact draws of {errors} errors in its own unit; leave method out.")
    if not linear and law.nobs > MOST_ROWS:
        raise FitError(
            f"{law.response}: {law.nobs} rows; of a law that is not linear in its parameters at most {MOST_ROWS} can "
            "be looked at in every draw. With so many rows the interval of the fit says the same."
        )
    found = _route(density, "exact" if linear and method is None else method, seed, draws, progress)
    post = Posterior(law, density, found.sample, found.told, found.diagnostics, seed, notes=(*notes, *found.notes))
    return replace(post, agreement=_verified(post, draws, progress)) if verify else post


def _route(density: LawDensity, method: Method | None, seed: int, draws: int, progress: Progress | None) -> Drawn:
    """Draws by one route; without a method importance sampling first, then chains."""
    from .exact_draws import exact

    if method == "exact":
        return judged(density, exact(density, np.random.default_rng(seed), draws))
    return drawn(density, seed, draws, progress, method)


def draw_again(density: LawDensity, like: Sample, seed: int) -> Sample:
    """Another sample of the same size by the same route, of a density that differs a little."""
    return _route(density, "exact" if like.method == "exact" else None, seed, len(like.phi), None).sample


def _verified(post: Posterior, draws: int, progress: Progress | None) -> Agreement:
    """Chains on the same density, from another seed, beside the draws."""
    from .ensemble_sampler import chains

    other = chains(post.density, post.seed + APART, ess=draws, progress=progress)
    return agree(
        (post.draws, post.sample.chains), (post.density.told(other.phi), other.chains), post.names, other.interrupted
    )


def _check(law: "LawFit", draws: int, seed: int, errors: str, method: str | None) -> None:
    if not 0 <= seed < 2**32:
        raise UsageError(f"seed {seed}: it lies between 0 and {2**32 - 1}.")
    if errors not in get_args(Errors):
        raise UsageError(f"errors={errors!r}: they are 'normal' or 'student'.")
    if method is not None and method not in get_args(Method):
        raise UsageError(f"method={method!r}: it is one of {', '.join(get_args(Method))}.")
    if not FEWEST <= draws <= MOST:
        raise UsageError(f"{draws} draws: at least {FEWEST}, below which no gate opens, and at most {MOST}.")
    if law.no_interval:
        raise FitError(
            f"{law.response}: no posterior: {law.no_interval.removeprefix('no interval: ')}. Add observations."
        )
    if law.exact:
        raise FitError(
            f"{law.response}: the law fits every row exactly, so there is no residual variance; are these rows "
            "computed from a law? A posterior needs measured ones."
        )


def _edges(law: "LawFit") -> tuple[bool, tuple[str, ...]]:
    """Whether edges have levels of their own, and what follows where they do not."""
    if law.edge is None:
        return False, ("rows are taken as independent: the data name no edges",)
    G = len(set(law.edge))
    if law.nobs == G:
        return False, ()
    if G == 1:
        return False, ("one edge only: its draws say nothing of how edges differ",)
    if not isinstance(law.edges, EdgeInference):
        return True, (f"few edges, so that the priors speak with them: {law.edges.reason}",)
    return True, ()


def _priors(law: "LawFit", given: str | Path | Priors | Mapping[str, object], edges: bool) -> Priors:
    if isinstance(given, Priors):
        _complete(law, given, edges)
        return given
    if given == "reference":
        _enough_for_flat(law, edges)
        return reference(law, edges)
    if given == "weak":
        return weak(law, edges)
    if isinstance(given, Mapping):
        return replaced(weak(law, edges), law, given, "given")
    return replaced(weak(law, edges), law, read_priors(given), Path(given).name)


def _complete(law: "LawFit", priors: Priors, edges: bool) -> None:
    """A set given as a whole has a prior for each parameter, and is proper or the reference."""
    wanted = set(weak(law, edges).of)
    missing, strange = sorted(wanted - set(priors.of)), sorted(set(priors.of) - wanted)
    if missing or strange:
        what = f"no prior for {missing[0]}" if missing else f"a prior for {strange[0]}, which it has not"
        raise UsageError(f"{law.response}: {priors.name} has {what}; its parameters are {', '.join(sorted(wanted))}.")
    if priors.name != "reference" and any(isinstance(prior, Flat) for prior in priors.of.values()):
        raise UsageError(f"{law.response}: {priors.name} is improper; only the set called 'reference' may be flat.")


def _enough_for_flat(law: "LawFit", edges: bool) -> None:
    p = len(law.theta)
    if law.nobs < p + 2:
        raise FitError(
            f"{law.response}: flat priors need {p + 2} rows or more, and there are {law.nobs}; take weak ones."
        )
    if edges and isinstance(law.edges, EdgeInference) is False:
        raise FitError(f"{law.response}: flat priors give no posterior here ({law.edges}); take weak ones.")
