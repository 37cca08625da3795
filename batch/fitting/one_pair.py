"""How a pair is fitted and handed over: the same for one by itself and for one among thousands."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...core.errors import FitError

if TYPE_CHECKING:
    from ...datasets import Runs
    from ...fit import LawFit, NotAvailable
    from ...fit.bayes.posterior import Posterior
    from ...fit.defaults import Refused
    from ...fit.laws import Error
    from ...fit.life import ToolLife
    from ...parameters import ParameterFile

MOST_ROWS = 200_000  # of a law that is drawn unasked
USUAL_CRITERION = 0.3  # mm, average flank wear of ISO 3685

Drawn = tuple[tuple["Posterior", ...], dict[str, "NotAvailable"]]


@dataclass(frozen=True, slots=True)
class PairFit:
    """What was fitted to the runs of a pair.

    Attributes
    ----------
    laws : tuple of LawFit
    refused : tuple of Refused
        Laws that the columns ask for and the rows do not allow.
    life : ToolLife or None
    no_life : str
        Why there is none although a criterion was given; empty otherwise.
    posteriors : tuple of Posterior
    no_posterior : mapping of str to NotAvailable
        By response.
    shut : str
        Why nothing may be written, the gate of a posterior being shut; empty otherwise.
    """

    laws: "tuple[LawFit, ...]"
    refused: "tuple[Refused, ...]"
    life: "ToolLife | None"
    no_life: str
    posteriors: "tuple[Posterior, ...]"
    no_posterior: "Mapping[str, NotAvailable]"
    shut: str


def fit_pair(
    runs: "Runs",
    *,
    error: "Error" = "multiplicative",
    by: str | None = None,
    criterion: float | None = None,
    needs_life: bool = True,
    seed: int = 1,
    draws: int = 4000,
    priors: str | Mapping[str, object] = "weak",
    student: bool = False,
    verify: bool = False,
    step: Callable[[str], None] = lambda words: None,
) -> PairFit:
    """Fit every law that the columns of a pair ask for, solve the wear law for tool life, draw the posteriors.

    Parameters
    ----------
    runs : Runs
        Of one pair.
    error, by
        As in `fit.default_laws`.
    criterion : float, optional
        Wear at which an edge is worn out, in mm; the usual 0.3 mm unless given.
    needs_life : bool
        With a criterion and no tool life for it, raise; otherwise ``no_life`` says why.
    seed, draws, priors, student, verify
        As in `fit.posterior`.
    step : callable
        Hears what is being done.

    Raises
    ------
    FitError
        A criterion is given and there is no tool life.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> fitted = fit_pair(datasets.read_runs(datasets.bundled("ac2017_table1")), draws=1000)
    >>> [law.response for law in fitted.laws], fitted.life, fitted.shut
    (['AW', 'Fxz', 'P'], None, '')
    """
    from ...core.errors import FitError
    from ...fit import default_laws

    laws, refused = default_laws(runs, error=error, by=by)
    life, no_life = _life(laws, criterion)
    if no_life and needs_life:
        raise FitError(no_life)
    posteriors, none = _draw(
        laws, step, seed=seed, draws=draws, priors=priors, errors="student" if student else "normal", verify=verify
    )
    return PairFit(laws, refused, life, no_life, posteriors, none, _gate(posteriors) if laws else "")


def parameter_file(
    runs: "Runs",
    fitted: PairFit,
    *,
    gauge_sd: float | None = None,
    command: str | None = None,
    options: Mapping[str, Any] | None = None,
    seed: int = 1,
    keep_draws: bool = True,
    **identity: str,
) -> "ParameterFile":
    """The parameter file of a pair.

    Parameters
    ----------
    runs : Runs
    fitted : PairFit
        With a law, and no gate shut.
    gauge_sd : float, optional
        Standard deviation of the wear gauge, in mm.
    command, options, seed
        Provenance.
    keep_draws : bool
        Whether the draws will stand beside the file.
    **identity
        ``machine``, ``setup``, ``iso513``, as in `Identity`.

    Raises
    ------
    GateError, ParameterError
        As `parameters.collect`.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> parameter_file(runs, fit_pair(runs, draws=1000), keep_draws=False).posterior.draws_file is None
    True
    """
    from ... import parameters

    return parameters.collect(
        tool=runs.tool,
        work=runs.work,
        design=runs,
        laws=fitted.laws,
        tool_life=fitted.life,
        posteriors=fitted.posteriors,
        no_posterior=fitted.no_posterior,
        draws_kept=keep_draws,
        gauge_sd=gauge_sd,
        simulated=runs.simulated,
        note=". ".join(runs.disclaimers) or None,
        data_file=runs.source.name,
        data_sha256=runs.source.sha256,
        n_rows=len(runs),
        command=command,
        options=dict(options or {}),
        seed=seed,
        machine=identity.get("machine"),
        setup=identity.get("setup"),
        iso513=identity.get("iso513"),
    )


def _life(laws: "Sequence[LawFit]", criterion: float | None) -> "tuple[ToolLife | None, str]":
    """Tool life from the wear law on time; missing or impossible only matters where a criterion was asked for."""
    from ...core.errors import FitError
    from ...fit import tool_life

    wear = next((law for law in laws if law.response in ("AW", "VB") and "t" in law.factors), None)
    if wear is None:
        why = "--criterion asks for tool life, but there is no wear law on time in this file."
        return None, "" if criterion is None else why
    try:
        return tool_life(wear, USUAL_CRITERION if criterion is None else criterion), ""
    except FitError as error:
        return None, "" if criterion is None else str(error)


def _draw(laws: "Sequence[LawFit]", step: Callable[[str], None], **how: Any) -> Drawn:  # noqa: ANN401
    """Posteriors of laws, and why others have none."""
    from ... import fit

    posteriors: list[Posterior] = []
    none: dict[str, NotAvailable] = {}
    for law in laws:
        if law.nobs > MOST_ROWS:
            why = f"{law.nobs} rows: of so many, draws say what the intervals say; fit.posterior(law) makes them"
            none[law.response] = fit.NotAvailable(why)
            continue

        def tell(steps: int, effective: float, response: str = law.response) -> None:
            step(f"chains for {response}: {steps} steps, {effective:.0f} effective draws so far (Ctrl-C keeps them)")

        try:
            post = fit.posterior(law, progress=tell, **how)
        except FitError as error:
            none[law.response] = fit.NotAvailable(str(error).removeprefix(f"{law.response}: ").rstrip("."))
            continue
        posteriors.append(post)
        if not post.gate.open:
            break  # nothing will be written: no use in drawing on
    return tuple(posteriors), none


def _gate(posteriors: "Sequence[Posterior]") -> str:
    """Why nothing may be written, or nothing."""
    shut = [post for post in posteriors if not post.gate.open]
    said = [f"the draws of {post.response} may not be used: {' '.join(post.gate.reasons)}" for post in shut]
    return " ".join(said) + " Nothing was written." if said else ""
