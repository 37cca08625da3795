"""Posterior of a law: options are validated, priors completed, the sampling method chosen."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import get_args

from ...core.errors import FitError, UsageError
from ...core.threads import one_thread
from ..available import NotAvailable, computed
from ..edges import EdgeInference
from ..lawfit import LawFit
from . import FEWEST_DRAWS, MOST_DRAWS
from .convergence import Agreement, compare_draws
from .density import Errors, Method, law_density
from .posterior import Posterior
from .priors import Flat, Priors, reference, weak
from .priors_file import read_priors, replaced
from .sampling import Progress, draw

MOST_ROWS = 100_000  # of a law that is not linear: every draw evaluates every row
OFFSET = 7919  # between the seed of the draws and that of the chains that verify them


@one_thread
def posterior(
    law: LawFit,
    *,
    seed: int = 1,
    draws: int = 4000,
    priors: str | Path | Priors | Mapping[str, object] = "weak",
    errors: Errors = "normal",
    method: Method | None = None,
    verify: bool = False,
    progress: Progress | None = None,
) -> Posterior:
    """Draws from the posterior of the parameters of a law.

    Parameters
    ----------
    law : LawFit
        Edges have a random level where there are several and some of them have several rows.
    seed : int
        The same seed gives the same draws, bit for bit.
    draws : int
    priors : "weak", "reference", Priors, a mapping as read from a priors file, or the path of such a file
        Proper and weak unless given; ``reference`` is flat.
    errors : {"normal", "student"}
        Student-t errors, of unknown degrees of freedom, downweight outlying rows (edges).
    method : {"exact", "importance", "emcee"}, optional
        By default exact where the law is linear on the scale of its normal errors, else importance sampling, and MCMC
        (emcee) where its k-hat exceeds 0.7.
    verify : bool
        Run MCMC as well, and compare.
    progress : callable, optional
        Called with the steps done and the effective draws so far.

    Raises
    ------
    UsageError
        An unknown option, or invalid priors.
    FitError
        No residual degrees of freedom, or a law that fits every row exactly.

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
    linear = errors == "normal" and not (density.natural and law.formula.logarithmic)
    if method == "exact" and not linear:
        raise UsageError(
            f"{law.response}: there are no exact draws of a law that is not linear in its parameters; omit method."
        )
    if not linear and law.nobs > MOST_ROWS:
        raise FitError(
            f"{law.response}: {law.nobs} rows; of a law not linear in its parameters at most {MOST_ROWS} can be used; "
            "with so many rows the confidence interval is equivalent."
        )
    found = draw(density, seed, draws, progress, "exact" if linear and method is None else method)
    post = Posterior(
        law=law,
        density=density,
        sample=found.sample,
        draws=found.draws,
        diagnostics=found.diagnostics,
        seed=seed,
        notes=(*notes, *found.notes),
    )
    if not verify:
        return post
    agreement = computed(partial(_verified, post, draws, progress))
    if isinstance(agreement, NotAvailable):
        return replace(post, notes=(*post.notes, f"not verified by MCMC: {agreement}"))
    return replace(post, agreement=agreement)


def _verified(post: Posterior, draws: int, progress: Progress | None) -> Agreement:
    """Comparison with MCMC draws of the same density from another seed."""
    from .ensemble_sampler import chains

    other = chains(post.density, post.seed + OFFSET, ess=draws, progress=progress)
    return compare_draws(
        (post.draws, post.sample.chains),
        (post.density.parameters(other.phi), other.chains),
        post.names,
        other.interrupted,
    )


def check_priors(law: LawFit, given: str | Path | Mapping[str, object]) -> None:
    """Raise where priors do not suit a law; errors as of `posterior`, which draws from them."""
    _priors(law, given, _edges(law)[0])


def _check(law: LawFit, draws: int, seed: int, errors: str, method: str | None) -> None:
    if not 0 <= seed < 2**32:
        raise UsageError(f"seed {seed}: it must be between 0 and {2**32 - 1}.")
    if errors not in get_args(Errors):
        raise UsageError(f"errors={errors!r}: they are 'normal' or 'student'.")
    if method is not None and method not in get_args(Method):
        raise UsageError(f"method={method!r}: it is one of {', '.join(get_args(Method))}.")
    if not FEWEST_DRAWS <= draws <= MOST_DRAWS:
        raise UsageError(
            f"{draws} draws: at least {FEWEST_DRAWS} (fewer cannot pass the convergence checks) and at most "
            f"{MOST_DRAWS}."
        )
    _check_law(law)


def _check_law(law: LawFit) -> None:
    if law.not_least_squares:
        raise FitError(f"{law.response}: {law.not_least_squares}; draws are of least squares, so see the intervals.")
    if law.no_interval:
        raise FitError(
            f"{law.response}: no posterior: {law.no_interval.removeprefix('no interval: ')}. Add observations."
        )
    if law.exact:
        raise FitError(
            f"{law.response}: the law fits every row exactly, so there is no residual variance; are these rows "
            "computed from a law? A posterior needs measured ones."
        )


def _edges(law: LawFit) -> tuple[bool, tuple[str, ...]]:
    """Whether edges have random levels, with a note where they do not."""
    if law.life is not None:  # each life is that of an edge of its own
        return False, ()
    if law.edge is None:
        return False, ("rows are assumed independent: the data name no edges",)
    G = len(set(law.edge))
    if law.nobs == G:
        return False, ()
    if G == 1:
        return False, ("one edge only: the variance between edges is not identified",)
    if not isinstance(law.edges, EdgeInference):
        return True, (f"few edges, so that the priors are influential: {law.edges.reason}",)
    return True, ()


def _priors(law: LawFit, given: str | Path | Priors | Mapping[str, object], edges: bool) -> Priors:
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


def _complete(law: LawFit, priors: Priors, edges: bool) -> None:
    """Validate that a given set has a prior for each parameter, and is proper or the reference."""
    wanted = set(weak(law, edges).of)
    missing, strange = sorted(wanted - set(priors.of)), sorted(set(priors.of) - wanted)
    if missing or strange:
        what = f"no prior for {missing[0]}" if missing else f"a prior for {strange[0]}, which is no parameter"
        raise UsageError(f"{law.response}: {priors.name} has {what}; its parameters are {', '.join(sorted(wanted))}.")
    if priors.name != "reference" and any(isinstance(prior, Flat) for prior in priors.of.values()):
        raise UsageError(f"{law.response}: {priors.name} is improper; only the set 'reference' may be flat.")


def _enough_for_flat(law: LawFit, edges: bool) -> None:
    p = len(law.theta)
    if law.nobs < p + 2:
        raise FitError(
            f"{law.response}: flat priors need {p + 2} rows or more, and there are {law.nobs}; use weak ones."
        )
    if edges and isinstance(law.edges, EdgeInference) is False:
        raise FitError(f"{law.response}: flat priors give an improper posterior here ({law.edges}); use weak ones.")
