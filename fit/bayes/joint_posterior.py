"""Joint posterior of wear and load laws with an unknown true wear, read with a gauge error.

One model of the wear and all loads (``latent_model``), on the rows they share. Where wear is read in mm, its error
``sd / w`` in ln is evaluated at the fitted wear of each row: a first-order approximation, poor where it exceeds 0.3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from ...core.arrays import Ints
from ...core.errors import FitError, UsageError
from ...core.threads import one_thread
from ..available import NotAvailable
from ..checks.gauge_error import COARSE, GaugeFit, gauge_corrected
from ..checks.strata import no_scatter
from ..lawfit import LawFit
from .density import Errors, law_density
from .latent_model import LatentDensity, latent_density
from .priors import Priors, weak
from .sampling import PosteriorDraws, Progress, Route, draw


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class JointPosterior(PosteriorDraws):
    """Draws of the parameters of a law of wear and of load laws on the true wear.

    Names are ``AW: V`` .. ``P: AW``, ``P: sd``, ``P: icc``, and ``gauge sd`` where that is unknown.

    Attributes
    ----------
    wear_law, load_laws : LawFit, tuple of LawFit
        As fitted, treating the wear as exact.
    closed_form : tuple of GaugeFit or NotAvailable
        The correction of each load law by itself, without priors, or the reason why there is none.
    unit : str
        Of the gauge error: ``ln`` or the unit of the wear.
    left_out, coarse : int
        Rows that some law lacks; rows in which the gauge error is more than 0.3 of the wear.
    seed : int
    """

    wear_law: LawFit
    load_laws: tuple[LawFit, ...]
    density: LatentDensity
    closed_form: tuple[GaugeFit | NotAvailable, ...]
    unit: str
    left_out: int
    coarse: int
    seed: int

    @property
    def gauge_sd(self) -> float:
        """Standard deviation of a reading as it was given."""
        return self.density.gauge_sd

    @property
    def priors(self) -> dict[str, Priors]:
        """Priors of the parameters by response."""
        return {law.law.response: law.priors for law in self.density.laws}

    def for_law(self, response: str, level: float = 0.95) -> pd.DataFrame:
        """The rows of ``table`` of one law, named as that law names its parameters."""
        known = [law.law.response for law in self.density.laws]
        if response not in known:
            raise UsageError(f"no law of {response} here: there are {', '.join(known)}.")
        table = self.table(level)
        return table[table.index.str.startswith(f"{response}: ")].rename(lambda name: name.split(": ", 1)[1])

    @property
    def words(self) -> str:
        """One sentence: the exponents of the true wear, and of the measured wear."""
        wear, table = self.wear_law.response, self.table()
        found = []
        for law in self.load_laws:
            true, plain = table.loc[f"{law.response}: {wear}"], law.conf_int().loc[wear]
            found.append(
                f"exponent of {wear} in {law.response} {true['mean']:.2f} ({true['low']:.2f} to {true['high']:.2f}) "
                f"for true wear, {law.params[wear]:.2f} ({plain['low']:.2f} to {plain['high']:.2f}) as measured"
            )
        return f"With a gauge error of {self.gauge_sd:g} {self.unit}, {'; '.join(found)}."


FEWEST, MOST = 400, 1_000_000  # draws
SAME = 1e-9  # relative difference below which two readings are equal


@one_thread
def latent_wear(
    wear_law: LawFit,
    load_laws: Sequence[LawFit],
    gauge_sd: float,
    unit: str = "ln",
    *,
    seed: int = 1,
    draws: int = 4000,
    priors: Literal["weak"] | Mapping[str, Priors] = "weak",
    progress: Progress | None = None,
    errors: Errors = "normal",
    gauge_df: float | None = None,
    method: Route | None = None,
) -> JointPosterior:
    """Draws of a wear law and load laws jointly, the loads depending on the true wear.

    Parameters
    ----------
    wear_law : LawFit
        Power law of the measured wear, errors multiplicative.
    load_laws : sequence of LawFit
        Power laws of force, power, .. with that wear among their factors, errors multiplicative, of the same runs.
    gauge_sd : float
        Standard deviation of one reading, 0 or more.
    unit : str
        ``ln`` (a share of the reading), or the unit of the wear.
    seed, draws : int
    priors : "weak" or a mapping of response to Priors
        Responses that the mapping lacks have their weak ones. ``sd`` of the wear is that of the true wear.
    progress : callable, optional
        Called by MCMC with the steps done and the effective draws so far.
    errors : {"normal", "student"}
        Student's: all readings of an edge share one heavy tail.
    gauge_df : float, optional
        Degrees of freedom ``gauge_sd`` is known from (repeated readings less one): the chi-square of its variance is
        then its prior. Taken as known otherwise.
    method : {"importance", "emcee"}, optional
        By default importance sampling, and MCMC where that fails the convergence checks.

    Raises
    ------
    UsageError
        Laws that do not belong together, or an impossible gauge error.
    FitError
        A law that fits its rows exactly, or no rows in common.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> wear = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    >>> power = fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"])
    >>> joint = latent_wear(wear, [power], 0.03)
    >>> bool(joint.for_law("P").loc["AW", "mean"] > power.params["AW"]), joint.convergence.passed
    (True, True)
    """
    laws = (wear_law, *load_laws)
    _check(laws, draws, errors, gauge_sd, gauge_df)
    wear = wear_law.response
    closed_form = tuple(gauge_corrected(law, gauge_sd, wear, unit) for law in load_laws)
    shared, left_out = _shared(laws)
    edges = _edges(shared[0])
    of = [law_density(law, _priors(whole, priors, edges)) for law, whole in zip(shared, laws, strict=True)]
    tau = np.array([gauge_sd]) if unit == "ln" else gauge_sd / shared[0].fitted
    density = latent_density(of, tau, gauge_sd, gauge_df, errors)
    found = draw(density, seed, draws, progress, method)
    coarse = int((np.broadcast_to(tau, shared[0].nobs) > COARSE).sum())
    notes = (*_notes(laws, closed_form, left_out, coarse), *found.notes)
    return JointPosterior(
        wear_law=wear_law,
        load_laws=tuple(load_laws),
        density=density,
        sample=found.sample,
        draws=found.draws,
        diagnostics=found.diagnostics,
        closed_form=closed_form,
        unit=unit,
        left_out=left_out,
        coarse=coarse,
        seed=seed,
        notes=notes,
    )


def _check(laws: tuple[LawFit, ...], draws: int, errors: str, gauge_sd: float, gauge_df: float | None) -> None:
    wear, names = laws[0].response, [law.response for law in laws]
    if len(laws) == 1 or len(set(names)) < len(names):
        raise UsageError(f"laws of {', '.join(names)}: one law of the wear and one of each load are needed.")
    for law in laws:
        if law.form != "power" or law.error != "multiplicative":
            raise UsageError(
                f"the law of {law.response} is of the form {law.form}, errors {law.error}: true wear can be estimated "
                "for power laws fitted with error='multiplicative' only."
            )
        if reason := no_scatter(law):
            raise FitError(f"{law.response}: {reason}")
    for law in laws[1:]:
        if wear not in law.factors:
            raise UsageError(
                f"{wear} is no factor of the law of {law.response} ({', '.join(law.factors)}): omit this law."
            )
    if errors not in ("normal", "student"):
        raise UsageError(f"errors={errors!r}: they are 'normal' or 'student'.")
    if not FEWEST <= draws <= MOST:
        raise UsageError(
            f"{draws} draws: at least {FEWEST} (fewer cannot pass the convergence checks) and at most {MOST}."
        )
    if gauge_df is not None and not (gauge_df > 0 and gauge_sd > 0):
        raise UsageError(f"gauge error {gauge_sd:g} from {gauge_df:g} degrees of freedom: both must be above 0.")


def _shared(laws: tuple[LawFit, ...]) -> tuple[list[LawFit], int]:
    """Each law on the lines that all of them have, sorted by edge, and the number of lines that some law lacks."""
    lines = [set(law.lines.tolist()) for law in laws]
    common = np.array(sorted(set.intersection(*lines)), dtype=np.intp)
    if not len(common):
        raise FitError(f"laws of {', '.join(law.response for law in laws)}: no line of the file is in all of them.")
    shared = [_on(law, common) for law in laws]
    first, wear = shared[0], laws[0].response
    for law in shared[1:]:
        read = law.X[:, law.factors.index(wear)]
        if not np.allclose(read, first.observed, rtol=SAME, atol=0):
            raise UsageError(
                f"the law of {law.response} has other values of {wear} on the same lines: fit all to the same runs."
            )
    return shared, len(set.union(*lines)) - len(common)


def _on(law: LawFit, lines: Ints) -> LawFit:
    rows = np.argsort(law.lines)
    rows = rows[np.searchsorted(law.lines[rows], lines)]
    if law.edge is not None:
        rows = rows[np.argsort(law.edge[rows].astype(str), kind="stable")]
    return law.with_rows(rows)


def _edges(law: LawFit) -> bool:
    """Whether edges have random levels: several edges, and several rows of some."""
    return law.n_edges is not None and 1 < law.n_edges < law.nobs


def _priors(law: LawFit, given: Literal["weak"] | Mapping[str, Priors], edges: bool) -> Priors:
    if isinstance(given, str):
        if given != "weak":
            raise UsageError(
                f"priors={given!r}: 'weak', or Priors of each response (flat ones do not identify the true wear)."
            )
        return weak(law, edges)
    chosen, usual = given.get(law.response), weak(law, edges)
    if chosen is None:
        return usual
    if set(chosen.of) != set(usual.of) or not chosen.proper:
        raise UsageError(f"{law.response}: {chosen.name} must have a proper prior for each of {', '.join(usual.of)}.")
    return chosen


def _notes(
    laws: tuple[LawFit, ...], closed_form: tuple[GaugeFit | NotAvailable, ...], left_out: int, coarse: int
) -> tuple[str, ...]:
    notes = []
    if left_out:
        notes.append(f"{left_out} lines left out that are not in all of the laws")
    if coarse:
        notes.append(
            f"in {coarse} rows the gauge error is over {COARSE:g} of the wear, where the approximation is poor"
        )
    if laws[0].edge is None:
        notes.append("rows are assumed independent: the data name no edges")
    for law, found in zip(laws[1:], closed_form, strict=True):
        if isinstance(found, NotAvailable):
            notes.append(f"{law.response}: the priors are influential: {found.reason}")
    return tuple(notes)
