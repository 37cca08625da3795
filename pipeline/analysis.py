"""The main job: every tool/work pair of a source, its laws, checks, posteriors and parameter file."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from ..core.calls import checked
from ..core.display import Display, Displayable, TextTable
from ..core.errors import FitError, UsageError
from ..core.rounding import count
from ..core.suggestions import did_you_mean
from .options import NAMED_PRIORS, FitOptions, fit_options
from .pair import USER_ERRORS, PairAnalysis, Step, fit_laws, no_step, parameter_file, with_posteriors

if TYPE_CHECKING:
    from ..cards.forms.page import Profiler
    from ..datasets.runs import Readable, Runs
    from ..fit import LawFit
    from ..fit.bayes.posterior import Posterior
    from ..parameters import ParameterFile


class OfResponse(Protocol):
    """Anything about one response."""

    @property
    def response(self) -> str: ...  # noqa: D102


T = TypeVar("T", bound=OfResponse)


class ByResponse(tuple[T, ...]):
    """Laws or posteriors, by number or by the symbol of their response.

    Examples
    --------
    >>> from fitmodels import analyse, datasets
    >>> analysis = analyse(datasets.bundled("ac2017_table1"), draws=1000)
    >>> analysis.laws["P"].response, analysis.laws[0].response, len(analysis.laws)
    ('P', 'AW', 3)
    """

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401
        if not isinstance(key, str):
            return tuple.__getitem__(self, key)
        found = next((one for one in self if one.response == key), None)
        if found is None:
            known = [one.response for one in self]
            others = did_you_mean(key, known, names="There are results of ")
            raise UsageError(f"there is no result of {key!r}. {others}")
        return found

    def _ipython_key_completions_(self) -> list[str]:
        return [one.response for one in self]


@dataclass(frozen=True, slots=True, repr=False)
class Analysis(Displayable):
    """Result of `analyse`.

    ``laws``, ``parameters``, ``posteriors`` and ``checks`` are those of the pair where there is one only.

    Attributes
    ----------
    runs : Runs
        All rows, as they were read.
    pairs : tuple of PairAnalysis
        Each with its laws, tool life, posteriors, parameter file, and the reasons for what is missing.
    options : FitOptions
    """

    runs: "Runs"
    pairs: tuple[PairAnalysis, ...]
    options: FitOptions

    @property
    def pair(self) -> PairAnalysis:
        """The pair, where there is one only.

        Raises
        ------
        UsageError
            There are several.
        """
        if len(self.pairs) != 1:
            names = ", ".join(pair.name for pair in self.pairs)
            raise UsageError(f"{len(self.pairs)} pairs ({names}): choose one, for instance analysis.pairs[0].")
        return self.pairs[0]

    @property
    def laws(self) -> "ByResponse[LawFit]":
        """Laws of the only pair, by number or by response: ``analysis.laws["VB"]``."""
        return ByResponse(self.pair.laws)

    @property
    def posteriors(self) -> "ByResponse[Posterior]":
        """Posteriors of the only pair, by number or by response."""
        return ByResponse(self.pair.posteriors)

    @property
    def checks(self) -> dict[str, Mapping[str, Any]]:
        """Checks of each law of the only pair, by response."""
        return self.pair.checks

    @property
    def parameters(self) -> "ParameterFile":
        """Parameter file of the only pair.

        Raises
        ------
        FitError
            It has none; the message gives the reason.
        """
        if self.pair.parameters is None:
            raise FitError(f"{self.pair.name} has no parameter file: {self.pair.reason}")
        return self.pair.parameters

    @checked
    def plot(self, kind: Any = "observed", ax: Any = None, *, law: str | None = None, **options: Any) -> Any:  # noqa: ANN401
        """Draw a figure of every law of the only pair, or of one; see `PairAnalysis.plot`."""
        return self.pair.plot(kind, ax, law=law, **options)

    def profiler(self, at: Mapping[str, float] | None = None) -> "Profiler":
        """The interactive profiler of the laws of the only pair, for a notebook; ``at`` is where its sliders begin.

        Examples
        --------
        >>> from fitmodels import analyse, datasets
        >>> analysis = analyse(datasets.bundled("ac2017_table1"), draws=1000)
        >>> analysis.profiler(at={"V": 120})
        Profiler: GC435 on 709M40 (En 19), simulated, not measured
        """
        return self.pair.profiler(at)

    @checked
    def write(self, folder: str | os.PathLike[str], *, force: bool = False) -> tuple[Path, ...]:
        """Write a folder for each pair below ``folder``: parameter file, model card, figures, draws.

        Each folder is written whole or not at all; one with the same result is left unchanged. Pairs without a
        parameter file have no folder.

        Parameters
        ----------
        folder : path
        force : bool
            Replace what fitmodels wrote there.

        Returns
        -------
        tuple of Path
            Folder of each pair that has one.

        Raises
        ------
        UsageError
            A folder holds something else and ``force`` is not given; then nothing is written.
        FitError
            No pair has a parameter file.
        """
        from .folders import pair_folders

        pairs = [pair for pair in self.pairs if pair.parameters is not None]
        if not pairs:
            raise FitError(" ".join(f"{pair.name} has no parameter file: {pair.reason}" for pair in self.pairs))
        folders = pair_folders([pair.runs for pair in self.pairs], folder, self.options, force=force)
        held = zip(self.pairs, folders, strict=True)
        return tuple(one.write(pair, self.options, force=force) for pair, one in held if pair.parameters is not None)

    def _display(self) -> Display:
        rows = tuple((pair.name, *row) for pair in self.pairs for row in pair.law_rows())
        n = len(self.pairs)
        laws = count(len(rows), "law")
        head = f"{self.runs.source.name}: {laws} of {count(n, 'pair')}, {len(self.runs)} rows"
        head += "; simulated, not measured" if self.runs.simulated else ""
        table = TextTable(("pair", "law", "verdict", "form", "rows", "R2", "equation"), rows) if rows else None
        doubts = [f"Doubt: {doubt.in_python}" for doubt in self.runs.doubts]
        doubts += [f"Assumed: {text}." for text in self.runs.assumed if text.startswith("units")]
        missing = (
            f"{pair.name} has no parameter file: {pair.reason}" for pair in self.pairs if pair.parameters is None
        )
        return Display(head, table=table, sentences=(*doubts, *missing))


def analyse(
    source: "Readable",
    *,
    options: FitOptions | None = None,
    command: str | None = None,
    **given: Any,  # noqa: ANN401  the fields of FitOptions
) -> Analysis:
    """Read tests, fit every law that their columns allow, check them, draw posteriors, gather parameter files.

    Parameters
    ----------
    source : path, list of paths, DataFrame or Runs
        A file of tests, a folder or list of files that are one table, a DataFrame whose column names are read as
        headers of a file are, or `datasets.Runs`.
    options : FitOptions, optional
    command : str, optional
        Recorded in the parameter files as the command that makes them.
    **given
        Options by name instead of ``options``; see `FitOptions`.

    Returns
    -------
    Analysis
        The same numbers as the command ``fitmodels FILE`` with these options.

    Raises
    ------
    UsageError
        An option that does not exist or has an impossible value.
    DataError
        The source cannot be read.
    FitError
        A criterion is given and there is no tool life.

    Examples
    --------
    >>> from fitmodels import analyse, datasets
    >>> analysis = analyse(datasets.bundled("ac2017_table1"), draws=1000)
    >>> [law.response for law in analysis.laws], analysis.parameters.identity.tool
    (['AW', 'Fxz', 'P'], 'GC435')
    """
    from .reading import read_source

    if options is not None and given:
        raise UsageError(f"{', '.join(given)}: give either options or keywords, not both.")
    options = fit_options(given) if options is None else options
    return analyse_runs(read_source(source, options), options, command=command)


def analyse_runs(runs: "Runs", options: FitOptions, *, command: str | None = None) -> Analysis:
    """The analysis of runs that were read with ``options``."""
    stages = analysis_stages(runs, options, command=command, previews=False)
    return Analysis(runs, tuple(pair for pair, _ in stages), options)


def analysis_stages(
    runs: "Runs", options: FitOptions, *, command: str | None = None, step: Step = no_step, previews: bool = True
) -> Iterator[tuple[PairAnalysis, bool]]:
    """Each pair as soon as it is analysed, and whether it is complete.

    With ``previews`` a pair comes before as well, as soon as its laws are judged: with laws, checks and tool life in a
    parameter file without posteriors. These can change a verdict afterwards where they disagree with the law.
    """
    from ..parameters.collection import completed
    from ..parameters.gather.law import disagreement

    for one in pairs_of(runs, options):
        step(f"fitting {one.tool} on {one.work}")
        pair, pf = fit_laws(one, options), None
        if previews and pair.laws:
            _check_priors(pair, options)
            pf = parameter_file(pair, options, command=command, complete=False)
            yield replace(pair, parameters=pf), False
        pair = with_posteriors(pair, options, step=step)
        if pair.laws and not pair.failed:
            laws = {law.response: law for law in pair.laws}
            if pf is None or any(disagreement(laws[post.response], post) for post in pair.posteriors):
                pf = parameter_file(pair, options, command=command, complete=False)
            pair = replace(pair, parameters=completed(pf, pair.posteriors, pair.no_posterior))
        yield pair, True


def _check_priors(pair: PairAnalysis, options: FitOptions) -> None:
    """Refuse priors of the user that do not suit a law, before the laws are shown."""
    from ..fit.available import computed

    given = Path(options.priors) if isinstance(options.priors, os.PathLike) else options.priors
    if given in NAMED_PRIORS:
        return
    from ..fit.bayes.draw_posterior import check_priors

    for law in pair.laws:
        computed(partial(check_priors, law, given), USER_ERRORS)


def pairs_of(runs: "Runs", options: FitOptions) -> "tuple[Runs, ...]":
    """Runs of each pair; all together where the levels of a category are fitted together."""
    return (runs,) if options.by else tuple(runs.pairs())
