"""One tool/work pair: its laws, tool life and posteriors, and its parameter file."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import fit
from ..core.display import Display, Displayable, TextTable
from ..core.errors import DataError, FitError, UsageError
from ..core.rounding import count, format_plain
from ..core.suggestions import did_you_mean
from ..core.verdict import LEVELS, MARKS, USABLE
from ..datasets import Runs
from ..datasets.vocabulary import FLANK_WEAR, USUAL_CRITERION
from ..fit.available import computed
from .options import FitOptions
from .reading import pair_of_several

if TYPE_CHECKING:
    from ..cards.forms.page import Profiler
    from ..fit import LawFit, NotAvailable
    from ..fit.bayes.posterior import Posterior
    from ..fit.defaults import Refused
    from ..fit.life import ToolLife
    from ..fit.statsmodels_ols import StatsmodelsComparison
    from ..parameters import ParameterFile

MOST_ROWS = 200_000  # of a law whose posterior is drawn by default

USER_ERRORS = (OSError, UsageError, DataError)  # end the run; other errors cost one result only

Step = Callable[[str], None]


def no_step(words: str) -> None:
    """Receives progress updates and ignores them."""


@dataclass(frozen=True, slots=True, repr=False)
class PairAnalysis(Displayable):
    """Laws of the runs of a pair.

    Attributes
    ----------
    runs : Runs
    laws : tuple of LawFit
    refused : tuple of Refused
        Laws that the columns allow and the rows do not.
    life : ToolLife or None
    no_life : str
        Why there is none although a criterion was given, or that its computation failed; empty otherwise.
    posteriors : tuple of Posterior
    no_posterior : mapping of str to NotAvailable
        By response.
    not_converged : str
        Which posteriors failed their convergence checks, so that there is no parameter file; empty otherwise.
    comparisons : tuple of StatsmodelsComparison
        Of each law with statsmodels, where the options ask for verification.
    parameters : ParameterFile or None
    """

    runs: Runs
    laws: "tuple[LawFit, ...]"
    refused: "tuple[Refused, ...]"
    life: "ToolLife | None"
    no_life: str
    posteriors: "tuple[Posterior, ...]"
    no_posterior: "Mapping[str, NotAvailable]"
    not_converged: str
    comparisons: "tuple[StatsmodelsComparison, ...]" = ()
    parameters: "ParameterFile | None" = None

    @property
    def name(self) -> str:
        """Tool and work material."""
        return f"{self.runs.tool} on {self.runs.work}"

    @property
    def checks(self) -> dict[str, Mapping[str, Any]]:
        """Checks of each law by response, then by name; empty where there is no parameter file."""
        return {} if self.parameters is None else {name: law.checks for name, law in self.parameters.laws.items()}

    @property
    def failed(self) -> str:
        """The verification that failed, so that there is no parameter file; empty otherwise."""
        differing = [one.sentence for one in self.comparisons if not one.agrees]
        disagreement = (
            f"The laws differ from statsmodels: {' '.join(differing)} Nothing was written." if differing else ""
        )
        return " ".join(filter(None, (self.not_converged, disagreement)))

    @property
    def reason(self) -> str:
        """Reason why there is no parameter file; empty where there is one."""
        if self.parameters is not None:
            return ""
        return self.failed or " ".join(item.reason for item in self.refused) or "no law fits these columns."

    def law_rows(self) -> list[tuple[str, ...]]:
        """Response, verdict, form, rows, R2 and equation of each law, for a table."""
        from ..parameters.display import level_of

        sections = {} if self.parameters is None else self.parameters.laws
        words = {name: (level_of(law.verdict), law.equation) for name, law in sections.items()}
        rows: list[tuple[str, ...]] = []
        for law in self.laws:
            verdict, equation = words.get(law.response, ("", ""))
            form = law.form.replace("_", " ")
            rows.append((law.response, verdict, form, str(law.nobs), format_plain(law.rsquared, 3), equation))
        return rows

    def law(self, response: str) -> "LawFit":
        """The law of a response.

        Raises
        ------
        UsageError
            There is none; the message names those that exist.
        """
        laws = {law.response: law for law in self.laws}
        if response not in laws:
            raise UsageError(
                f"{self.name}: no law of {response!r}. {did_you_mean(response, laws, names='There are laws of ')}"
            )
        return laws[response]

    def plot(self, kind: Any = "observed", ax: Any = None, *, law: str | None = None, **options: Any) -> Any:  # noqa: ANN401
        """Draw a figure of every law, or of one.

        Parameters
        ----------
        kind : str
            ``observed``, ``residuals``, ``edges``, ``quantiles``, ``profile``, ``contours``, ``coefficients``,
            ``checks``, ``influence``, ``interactions`` of each law; ``posterior`` (of the parameters of the first law
            that has one, or of the named law) and ``life`` (tool life).
        ax : Axes, optional
            For figures of one panel; without it the figure is new and known to pyplot.
        law : str, optional
            Response of one law, where there are several.
        **options
            Of this kind of figure.

        Raises
        ------
        UsageError
            No such kind, law or option, or a kind that is of one law and none is named.
        FitError
            There is no posterior or no tool life; the message gives the reason.
        """
        if not isinstance(kind, str):  # plot(ax)
            kind, ax = "observed", kind
        if kind == "life":
            return self._tool_life().plot(ax=ax, **options)
        chosen = self.laws if law is None else (self.law(law),)
        if kind == "posterior":
            return self._posterior([one.response for one in chosen]).plot("marginals", ax, **options)
        from ..fit.profile_figures import figure_of_laws, note_below

        drawn = chosen[0].plot(kind, ax, **options) if len(chosen) == 1 else figure_of_laws(chosen, kind, ax, options)
        if ax is None:
            note_below(drawn, self._cautions(chosen))
        return drawn

    def _cautions(self, laws: "Sequence[LawFit]") -> str:
        """The verdicts of laws that are not usable without reservations."""
        sections = {} if self.parameters is None else self.parameters.laws
        levels = {law.response: LEVELS.index(verdict.level) for law in laws
                  if law.response in sections and (verdict := sections[law.response].verdict)}  # fmt: skip
        return "   ".join(f"{name}: {MARKS[i].icon} {LEVELS[i]}" for name, i in levels.items() if i != USABLE)

    def _tool_life(self) -> "ToolLife":
        if self.life is None:
            raise FitError(f"{self.name}: no tool life: {self.no_life or 'no law of wear over time'}")
        return self.life

    def _posterior(self, responses: Sequence[str]) -> "Posterior":
        """The posterior of the first of these laws that has one."""
        for post in self.posteriors:
            if post.response in responses:
                return post
        why = "; ".join(str(self.no_posterior[name]) for name in responses if name in self.no_posterior)
        raise FitError(f"{self.name}: no posterior of {', '.join(responses)}: {why or 'none was drawn'}.")

    def profiler(self, at: Mapping[str, float] | None = None) -> "Profiler":
        """The interactive profiler of the laws, for a notebook; ``at`` is where its sliders begin.

        Raises
        ------
        FitError
            The pair has no parameter file; the message gives the reason.
        UsageError
            ``at`` names no factor, or a value that its slider does not reach.
        """
        from ..cards import profiler

        if self.parameters is None:
            raise FitError(f"{self.name} has no parameter file: {self.reason}")
        return profiler(self.parameters, at)

    def _display(self) -> Display:
        laws = self.law_rows()
        head = f"{self.name}: {count(len(laws), 'law')} of {len(self.runs)} rows"
        table = TextTable(("law", "verdict", "form", "rows", "R2", "equation"), tuple(laws)) if laws else None
        refused = (f"{item.response} is not fitted: {item.reason}" for item in self.refused)
        return Display(head, table=table, sentences=(*refused, *filter(None, (self.failed, self.no_life))))


def fit_pair(runs: Runs, options: FitOptions, *, needs_life: bool = True) -> PairAnalysis:
    """Fit every law that the columns of a pair allow, solve the wear law for tool life, draw the posteriors.

    Parameters
    ----------
    runs : Runs
        Of one pair.
    options : FitOptions
    needs_life : bool
        With a criterion and no tool life for it, raise; otherwise ``no_life`` gives the reason.

    Raises
    ------
    FitError
        A criterion is given and there is no tool life.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> fitted = fit_pair(datasets.read_runs(datasets.bundled("ac2017_table1")), FitOptions(draws=1000))
    >>> [law.response for law in fitted.laws], fitted.life, fitted.not_converged
    (['AW', 'Fxz', 'P'], None, '')
    """
    return with_posteriors(fit_laws(runs, options, needs_life=needs_life), options)


def fit_laws(runs: Runs, options: FitOptions, *, needs_life: bool = True) -> PairAnalysis:
    """The laws and the tool life of a pair, without posteriors; parameters and errors are those of `fit_pair`."""
    laws, refused = fit.default_laws(runs, error=options.error, by=options.by, laws=options.laws, forms=options.forms)
    laws = tuple(map(_with_surface_words, laws))
    life, no_life = _life(laws, options.criterion)
    if no_life and needs_life and options.criterion is not None:
        raise FitError(no_life)
    return PairAnalysis(runs, laws, refused, life, no_life, (), {}, "")


def with_posteriors(pair: PairAnalysis, options: FitOptions, *, step: Step = no_step) -> PairAnalysis:
    """A pair with the posteriors of its laws, and with their comparison where the options ask for verification."""
    posteriors, none = _posteriors(pair.laws, options, step)
    comparisons = _comparisons(pair.laws, step) if options.verify else ()
    failed = _not_converged(posteriors)
    return replace(pair, posteriors=posteriors, no_posterior=none, not_converged=failed, comparisons=comparisons)


def parameter_file(
    pair: PairAnalysis,
    options: FitOptions,
    *,
    command: str | None = None,
    keep_draws: bool = True,
    complete: bool = True,
    **identity: str,
) -> "ParameterFile":
    """The parameter file of a pair.

    Parameters
    ----------
    pair : PairAnalysis
        With a law, and every posterior converged.
    options : FitOptions
    command : str, optional
        For the provenance.
    keep_draws : bool
        Whether the draws are written next to the file.
    complete : bool
        False leaves the section of the posteriors and the checksum to `parameters.collection.completed`.
    **identity
        ``machine``, ``setup``, ``iso513``, as in `parameters.collect`.

    Raises
    ------
    GateError, ParameterError
        As `parameters.collect`.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> runs, options = datasets.read_runs(datasets.bundled("ac2017_table1")), FitOptions(draws=1000)
    >>> parameter_file(fit_pair(runs, options), options, keep_draws=False).posterior.draws_file is None
    True
    """
    from .. import parameters

    source = pair.runs.source
    return parameters.collect(
        design=pair.runs,
        laws=pair.laws,
        tool_life=pair.life,
        posteriors=pair.posteriors,
        no_posterior=pair.no_posterior,
        draws_kept=keep_draws,
        complete=complete,
        gauge_sd=options.gauge_sd,
        data_file=source.name,
        data_sha256=source.sha256,
        command=command,
        options=options.recorded() | pair_of_several(pair.runs),
        seed=options.seed,
        **identity,  # type: ignore[arg-type]
    )


def _with_surface_words(law: "LawFit") -> "LawFit":
    """A law of second order with a note on whether its squares and products are needed, and on its optimum."""
    if law.formula.first_order or law.rows is None:
        return law
    from ..fit.surface.display import verdict_of
    from ..fit.surface.surfaces import surface_of

    def words() -> tuple[str, ...]:
        surface = surface_of(law)
        canonical = surface.canonical()
        return verdict_of(surface), *([] if isinstance(canonical, fit.NotAvailable) else [canonical.verdict])

    found = computed(words)
    return law if isinstance(found, fit.NotAvailable) else replace(law, notes=(*law.notes, *found))


def _life(laws: "Sequence[LawFit]", criterion: float | None) -> "tuple[ToolLife | None, str]":
    """Tool life from the wear law on time, or why there is none: with a criterion, or where the form allows none."""
    wear = next((law for law in laws if law.response in FLANK_WEAR and "t" in law.factors), None)
    if wear is None:
        why = f"criterion {criterion}: there is no wear law on time, so no tool life; leave the criterion out."
        return None, "" if criterion is None else why
    life = computed(partial(fit.tool_life, wear, USUAL_CRITERION if criterion is None else criterion), USER_ERRORS)
    return (None, _why_no_life(life, criterion, wear)) if isinstance(life, fit.NotAvailable) else (life, "")


def _why_no_life(life: "NotAvailable", criterion: float | None, wear: "LawFit") -> str:
    if life.failed:
        return f"No tool life: {life.reason}."
    plain = wear.form == "power" and wear.by is None
    return "" if criterion is None and plain else f"{life.reason.removesuffix('.')}."


def _posteriors(
    laws: "Sequence[LawFit]", options: FitOptions, step: Step
) -> "tuple[tuple[Posterior, ...], dict[str, NotAvailable]]":
    """Posteriors of laws, and why others have none."""
    posteriors: list[Posterior] = []
    none: dict[str, NotAvailable] = {}
    priors = Path(options.priors) if isinstance(options.priors, os.PathLike) else options.priors
    for law in laws:
        if law.nobs > MOST_ROWS:
            why = f"{law.nobs} rows: with so many, draws agree with the intervals; fit.posterior(law) draws them"
            none[law.response] = fit.NotAvailable(why)
            continue

        def report(steps: int, effective: float, response: str = law.response) -> None:
            step(f"chains for {response}: {steps} steps, {effective:.0f} effective draws so far (Ctrl-C keeps them)")

        post = _drawn(law, priors, options, report)
        if isinstance(post, fit.NotAvailable):
            none[law.response] = replace(post, reason=post.reason.removeprefix(f"{law.response}: "))
            continue
        posteriors.append(post)
        if not post.convergence.passed:
            break  # nothing is written: further draws would be of no use
    return tuple(posteriors), none


def _drawn(
    law: "LawFit",
    priors: "str | Path | Mapping[str, object]",
    options: FitOptions,
    report: "Callable[[int, float], None]",
) -> "Posterior | NotAvailable":
    """The posterior of a law, or the reason why there is none; a wrong file of priors ends the run."""
    draw = partial(
        fit.posterior, law, seed=options.seed, draws=options.draws, priors=priors, verify=options.verify,
        errors="student" if options.student else "normal", progress=report,
    )  # fmt: skip
    return computed(draw, USER_ERRORS)


def _comparisons(laws: "Sequence[LawFit]", step: Step) -> "tuple[StatsmodelsComparison, ...]":
    from ..fit.statsmodels_ols import compare_statsmodels

    step("comparing with statsmodels")
    return tuple(map(compare_statsmodels, laws))


def _not_converged(posteriors: "Sequence[Posterior]") -> str:
    failed = [post for post in posteriors if not post.convergence.passed]
    found = [
        f"the draws of {post.response} failed their convergence checks: {' '.join(post.convergence.reasons)}"
        for post in failed
    ]
    return " ".join(found) + " Nothing was written." if found else ""
