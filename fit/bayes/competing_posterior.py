"""Posteriors of forms that compete with a power law, compared by leave-one-edge-out cross-validation.

The expected log predictive density of left-out edges is on the same rows and scale for all forms, that of the errors of
the law. Edges with k-hat above 0.7 are left out exactly: the form is sampled again without them. Priors of parameters
that the law lacks: ``k`` of exp(k AW), an exponent of 2 at the mean wear; squares and products of logarithms, sd 1;
additive wear and time exponents of edges in ``competing_densities``.

Source: Vehtari, Gelman & Gabry 2017, Stat. Comput. 27, 1413, sections 2.1 and 5.2 (refits, differences and their
standard error); Sivula, Magnusson & Vehtari 2020, arXiv 2008.10296 (differences below 4 are small).
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.display import Plottable
from ...core.errors import UsageError
from ...core.threads import one_thread
from ..available import NotAvailable
from ..checks.competing_forms import FittedForm, form_makers
from ..checks.strata import no_scatter
from ..checks.time_exponent import TIME
from .competing_densities import EdgeSlopes, additive_wear, edge_slopes
from .convergence import Gate, gate
from .density import LawDensity, Sample, law_density
from .diagnostics import Diagnostics
from .priors import EXPONENT_SD, Normal, Prior, Priors, weak
from .psis_loo import LeaveOut, leave_one_out
from .sampling import Drawn, Progress, drawn, judged

if TYPE_CHECKING:
    from ..lawfit import LawFit

Array = NDArray[np.float64]
RivalName = Literal[
    "exponential in wear", "additive in wear", "an exponent of t per edge", "second order in logs"
]  # in the order of ``form_makers``

SMALL = 4.0  # nats: differences below are small, and their standard error is then too small
CURVATURE = Normal(0.0, 1.0)


@dataclass(frozen=True, slots=True, repr=False)
class RivalPosterior(Plottable):
    """Draws of a rival form, and how it foretells edges beside the power law.

    Attributes
    ----------
    form, formula : str
    law : LawFit
        The power law it stands beside.
    density : LawDensity
    sample : Sample
    draws : ndarray, shape (S, q)
        Draws of ``names``.
    diagnostics : Diagnostics
    leave_out, power : LeaveOut
        Expected log density of left-out edges (rows), of this form and of the power law.
    difference, standard_error : float
        Of the two, positive where the rival foretells better, in nats.
    notes : tuple of str
    """

    form: str
    formula: str
    law: "LawFit"
    density: LawDensity
    sample: Sample
    draws: Array
    diagnostics: Diagnostics
    leave_out: LeaveOut
    power: LeaveOut
    difference: float
    standard_error: float
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters as the formula names them, then ``sd`` and ``icc``."""
        return self.density.told_names

    @property
    def gate(self) -> Gate:
        """Whether the draws may be used."""
        return gate(self.diagnostics, None, self.sample.interrupted)

    @property
    def better(self) -> bool:
        """Whether it beats the power law by 4 nats and by more than one standard error."""
        return self.difference > max(SMALL, self.standard_error)

    @property
    def words(self) -> str:
        """The comparison in one sentence."""
        unit = "edges" if self.density.edges else "rows"
        how = "better" if self.difference > 0 else "worse"
        told = f"{self.law.response}: the form {self.form} foretells left-out {unit} {how} than the power law by"
        told += f" {abs(self.difference):.1f} +- {self.standard_error:.1f} nats"
        return f"{told}, so it is preferred." if self.better else f"{told}, so the power law is kept."

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Mean, sd and equal-tailed interval of each parameter, with its diagnostics."""
        low, high = np.quantile(self.draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
        told = self.diagnostics
        columns = {"mean": self.draws.mean(axis=0), "sd": self.draws.std(axis=0, ddof=1), "low": low, "high": high}
        columns |= {"r_hat": told.r_hat, "ess_bulk": told.ess_bulk, "ess_tail": told.ess_tail}
        return pd.DataFrame(columns, index=list(self.names))

    def to_frame(self) -> pd.DataFrame:
        """The draws, a column a parameter."""
        return pd.DataFrame(self.draws, columns=list(self.names))


@one_thread
def rival_posterior(
    law: "LawFit",
    form: RivalName = "additive in wear",
    *,
    seed: int = 1,
    draws: int = 4000,
    progress: Progress | None = None,
) -> RivalPosterior | NotAvailable:
    """Draw a rival form of a power law, and compare the two by left-out edges.

    Parameters
    ----------
    law : LawFit
        A power law; the rival has its errors, and edges levels where they have in ``posterior``.
    form : str
        ``exponential in wear``, ``additive in wear``, ``an exponent of t per edge`` or ``second order in logs``.
    seed, draws : int
    progress : callable, optional
        Called by chains with the steps done and the effective draws so far.

    Returns
    -------
    RivalPosterior, or NotAvailable where these rows do not allow the form.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d", "t", "AW"])
    >>> rival = rival_posterior(law, "exponential in wear")
    >>> rival.gate.open, rival.better
    (True, False)
    """
    if form not in get_args(RivalName):
        raise UsageError(f"form={form!r}: it is one of {', '.join(get_args(RivalName))}.")
    if reason := _unfit(law):
        return NotAvailable(reason)
    edges = law.n_edges is not None and 1 < law.n_edges < law.nobs
    made = _density(law, form, edges)
    if isinstance(made, NotAvailable):
        return made
    density, formula = made
    base = law_density(law, weak(law, edges))
    found = drawn_law(density, seed, draws, progress)
    left, again = foretold(density, found.sample, seed, draws)
    left_power, _ = foretold(base, drawn_law(base, seed, draws, progress).sample, seed, draws)
    apart, notes = left.pointwise - left_power.pointwise, found.notes
    if again:
        notes = (*notes, f"drawn again without {', '.join(again)}, on which the draws leaned too much to reweight")
    error = float(np.sqrt(len(apart) * apart.var(ddof=1)))
    return RivalPosterior(
        form, formula, law, density, found.sample, found.told, found.diagnostics, left, left_power,
        float(apart.sum()), error, notes,
    )  # fmt: skip


def _unfit(law: "LawFit") -> str | None:
    if law.form != "power":
        return f"rival forms are those of a power law, and this is of the form {law.form.replace('_', ' ')}"
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: the forms have no logarithm of it"
    return no_scatter(law)


def _density(law: "LawFit", form: RivalName, edges: bool) -> tuple[LawDensity, str] | NotAvailable:
    """The density of a form, and its formula."""
    if form == "an exponent of t per edge":
        if TIME not in law.factors or not edges or law.error == "additive":
            return NotAvailable(
                "exponents of edges need time among the factors, several rows an edge, and errors in ln"
            )
        return edge_slopes(
            law
        ), f"{law.response} = c0 {' '.join(f'{x}^b_{x}' for x in law.factors)} {TIME}^u, u of each edge"
    _, make = form_makers(law)[get_args(RivalName).index(form)]
    fitted = make(law)
    if isinstance(fitted, NotAvailable):
        return fitted
    density = additive_wear(law, fitted, edges) if form == "additive in wear" else _linear(law, fitted, edges)
    return density, fitted.formula


def _linear(law: "LawFit", fitted: FittedForm, edges: bool) -> LawDensity:
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
    """Those of the law where it has the coefficient, and weak ones of what it has not."""
    of: dict[str, Prior] = {name: prior for name, prior in priors.of.items() if name in ("level", "sd", "icc")}
    for j, name in enumerate(names[1:], start=1):
        new = Normal(0.0, EXPONENT_SD / float(Z[:, j].mean())) if name == "k" else CURVATURE
        of[name] = priors.of.get(name, new)
    return replace(priors, of=of)


def drawn_law(density: LawDensity, seed: int, draws: int, progress: Progress | None = None) -> Drawn:
    """Exact where the form is linear in logarithms with errors there, else importance sampling or chains."""
    from .exact_draws import exact

    if type(density) is LawDensity and not density.natural:
        return judged(density, exact(density, np.random.default_rng(seed), draws))
    return drawn(density, seed, draws, progress)


def foretold(density: LawDensity, sample: Sample, seed: int, draws: int) -> tuple[LeaveOut, tuple[str, ...]]:
    """Expected log density of left-out units, and the units that were left out in earnest."""
    found = leave_one_out(density.by_unit(sample.phi), density.units)
    again = found.doubtful
    pointwise, k_hat = found.pointwise.copy(), found.k_hat.copy()
    for name in again:
        g = density.units.index(name)
        other = drawn_law(_without(density, g), seed, draws).sample
        seen = density.by_unit(other.phi)[:, g]
        pointwise[g], k_hat[g] = np.logaddexp.reduce(seen) - np.log(len(seen)), 0.0
    lost = float((found.pointwise - pointwise).sum())
    se = float(np.sqrt(len(pointwise) * pointwise.var(ddof=1)))
    return replace(
        found, elpd=found.elpd - lost, se=se, p_eff=found.p_eff + lost, pointwise=pointwise, k_hat=k_hat
    ), again


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
    return (
        replace(out, time=density.time[keep])
        if isinstance(density, EdgeSlopes) and isinstance(out, EdgeSlopes)
        else out
    )
