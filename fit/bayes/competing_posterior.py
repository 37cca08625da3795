"""Posteriors of forms that compete with a power law, compared by leave-one-edge-out cross-validation.

The expected log predictive density of left-out edges is on the same rows and scale for all forms, that of the errors of
the law. Edges with k-hat above 0.7 are left out exactly: the form is sampled again without them. Priors of parameters
that the law lacks: ``k`` of exp(k AW), an exponent of 2 at the mean wear; squares and products of logarithms, sd 1;
contributions of wear and time exponents of edges in ``competing_densities``.

Source: Vehtari, Gelman & Gabry 2017, Stat. Comput. 27, 1413, sections 2.1 and 5.2 (refits, differences and their
standard error); Sivula, Magnusson & Vehtari 2020, arXiv 2008.10296 (differences below 4 are small).
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from ...core.arrays import Array
from ...core.errors import UsageError
from ...core.threads import one_thread
from ..available import NotAvailable
from ..checks.competing_forms import FittedForm, alternative_forms, rows_of
from ..checks.competing_models import not_comparable
from ..checks.time_exponent import TIME
from ..lawfit import LawFit
from .competing_densities import EdgeSlopes, edge_slopes, wear_contribution
from .density import LawDensity, Sample, law_density
from .priors import EXPONENT_SD, Normal, Prior, Priors, weak
from .psis_loo import LeaveOut, leave_one_out
from .sampling import PosteriorDraws, Progress, draw_law

FormName = Literal[
    "exponential in wear",
    "additive in wear",
    "straight line in wear",
    "an exponent of t per edge",
    "second order in logs",
]  # kinds of `alternative_forms`

SMALL = 4.0  # nats: differences below are small, and their standard error is then too small
CURVATURE = Normal(0.0, 1.0)


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class CompetingPosterior(PosteriorDraws):
    """Draws of a form that competes with a power law, and its predictive comparison with the power law.

    Attributes
    ----------
    form, formula : str
    law : LawFit
        The power law that it is compared with.
    leave_out, power : LeaveOut
        Expected log predictive density of left-out edges (rows), of this form and of the power law.
    difference, standard_error : float
        Of the two, positive where this form predicts better, in nats.
    """

    form: str
    formula: str
    law: LawFit
    density: LawDensity
    leave_out: LeaveOut
    power: LeaveOut
    difference: float
    standard_error: float

    @property
    def better(self) -> bool:
        """Whether it is better than the power law by 4 nats and by more than one standard error."""
        return self.difference > max(SMALL, self.standard_error)

    @property
    def words(self) -> str:
        """The comparison in one sentence."""
        unit = "edges" if self.density.edges else "rows"
        how = "better" if self.difference > 0 else "worse"
        found = f"{self.law.response}: the form {self.form} predicts left-out {unit} {how} than the power law by"
        found += f" {abs(self.difference):.1f} ± {self.standard_error:.1f} nats"
        return f"{found}: it is preferred." if self.better else f"{found}: the power law is kept."


@one_thread
def posterior_of_form(
    law: LawFit,
    form: FormName = "additive in wear",
    *,
    seed: int = 1,
    draws: int = 4000,
    progress: Progress | None = None,
) -> CompetingPosterior | NotAvailable:
    """Draws of a form that competes with a power law, compared with it by left-out edges.

    Parameters
    ----------
    law : LawFit
        A power law; the form has the same errors, and edges have random levels as in ``posterior``.
    form : str
        ``exponential in wear``, ``additive in wear``, ``straight line in wear``, ``an exponent of t per edge`` or
        ``second order in logs``.
    seed, draws : int
    progress : callable, optional
        Called by MCMC with the steps done and the effective draws so far.

    Returns
    -------
    CompetingPosterior, or NotAvailable where these rows do not allow the form.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t", "AW"])
    >>> found = posterior_of_form(law, "exponential in wear")
    >>> found.convergence.passed, found.better
    (True, False)
    """
    if form not in get_args(FormName):
        raise UsageError(f"form={form!r}: it is one of {', '.join(get_args(FormName))}.")
    if reason := not_comparable(law):
        return NotAvailable(reason)
    edges = law.n_edges is not None and 1 < law.n_edges < law.nobs
    made = _density(law, form, edges)
    if isinstance(made, NotAvailable):
        return made
    density, formula = made
    base = law_density(law, weak(law, edges))
    found = draw_law(density, seed, draws, progress)
    left, again = _left_out(density, found.sample, seed, draws)
    left_power, _ = _left_out(base, draw_law(base, seed, draws, progress).sample, seed, draws)
    apart, notes = left.pointwise - left_power.pointwise, found.notes
    if again:
        notes = (*notes, f"drawn again without {', '.join(again)}, as k-hat of their weights exceeded 0.7")
    error = float(np.sqrt(len(apart) * apart.var(ddof=1)))
    return CompetingPosterior(
        form=form,
        formula=formula,
        law=law,
        density=density,
        sample=found.sample,
        draws=found.draws,
        diagnostics=found.diagnostics,
        leave_out=left,
        power=left_power,
        difference=float(apart.sum()),
        standard_error=error,
        notes=notes,
    )


def _density(law: LawFit, form: FormName, edges: bool) -> tuple[LawDensity, str] | NotAvailable:
    """The density of a form, and its formula."""
    if form == "an exponent of t per edge":
        if TIME not in law.factors or not edges or law.error == "additive":
            return NotAvailable(
                "time exponents of edges need time among the factors, several rows per edge, and multiplicative errors"
            )
        product = " ".join(f"{x}^b_{x}" for x in law.factors)
        return edge_slopes(law), f"{law.response} = c0 {product} {TIME}^u, u of each edge"
    fitted = next(one for one in alternative_forms(law) if one.kind == form).fitted(rows_of(law))
    if isinstance(fitted, NotAvailable):
        return fitted
    make = wear_contribution if form in ("additive in wear", "straight line in wear") else _linear
    return make(law, fitted, edges), fitted.formula


def _linear(law: LawFit, fitted: FittedForm, edges: bool) -> LawDensity:
    """A form that is linear in ln R: the density of the law with other columns and names."""
    base, priors = law_density(law, weak(law, edges)), weak(law, edges)
    names = tuple(fitted.coefficients)
    order = np.argsort(law.edge.astype(str), kind="stable") if edges and law.edge is not None else np.arange(law.nobs)
    centre = np.r_[0.0, fitted.Z[:, 1:].mean(axis=0)]
    Z = fitted.Z - centre
    theta = np.array(list(fitted.coefficients.values()))
    theta[0] += centre[1:] @ theta[1:]
    p, more = len(names), len(base.start) - base.p
    spread = np.zeros((p + more, p + more))
    spread[:p, :p] = np.linalg.inv(Z.T @ Z) * float(fitted.residuals @ fitted.residuals) / max(law.nobs - p, 1)
    spread[p:, p:] = base.spread[base.p :, base.p :]
    return replace(
        base, Z=Z[order], centre=centre, theta_names=names, priors=_priors(priors, names, fitted.Z),
        start=np.r_[theta, base.start[base.p :]], spread=spread,
    )  # fmt: skip


def _priors(priors: Priors, names: tuple[str, ...], Z: Array) -> Priors:
    """Priors of the law for its coefficients, and weak ones for the others."""
    of: dict[str, Prior] = {name: prior for name, prior in priors.of.items() if name in ("level", "sd", "icc")}
    for j, name in enumerate(names[1:], start=1):
        new = Normal(0.0, EXPONENT_SD / float(Z[:, j].mean())) if name == "k" else CURVATURE
        of[name] = priors.of.get(name, new)
    return replace(priors, of=of)


def _left_out(density: LawDensity, sample: Sample, seed: int, draws: int) -> tuple[LeaveOut, tuple[str, ...]]:
    """Expected log predictive density of left-out units, and the units that were left out exactly."""
    found = leave_one_out(density.by_unit(sample.phi), density.units)
    again = found.doubtful
    pointwise, k_hat = found.pointwise.copy(), found.k_hat.copy()
    for name in again:
        g = density.units.index(name)
        other = draw_law(_without(density, g), seed, draws).sample
        seen = density.by_unit(other.phi)[:, g]
        pointwise[g], k_hat[g] = np.logaddexp.reduce(seen) - np.log(len(seen)), 0.0
    lost = float((found.pointwise - pointwise).sum())
    se = float(np.sqrt(len(pointwise) * pointwise.var(ddof=1)))
    exact = replace(found, elpd=found.elpd - lost, se=se, p_eff=found.p_eff + lost, pointwise=pointwise, k_hat=k_hat)
    return exact, again


def _without(density: LawDensity, g: int) -> LawDensity:
    """The density on all units but one."""
    start, size = int(density.starts[g]), int(density.sizes[g])
    keep = np.r_[0:start, start + size : len(density.y)]
    rest = np.delete(np.arange(len(density.units)), g)
    starts = np.r_[0, np.cumsum(density.sizes[rest])[:-1]].astype(np.intp)
    out = replace(
        density, Z=density.Z[keep], y=density.y[keep], starts=starts, sizes=density.sizes[rest],
        labels=density.labels[rest],
    )  # fmt: skip
    if isinstance(density, EdgeSlopes) and isinstance(out, EdgeSlopes):
        return replace(out, time=density.time[keep])
    return out
