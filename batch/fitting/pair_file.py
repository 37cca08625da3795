"""The parameter file of a pair, its draws if they are kept, and its posterior in the table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from ...pipeline.pair import PairAnalysis, fit_pair, parameter_file
from ..law_rows import PAIR, column, fitted
from ..outcomes import NOT_CONVERGED, Cell, Concern, Failure, attempt
from ..pair_table import identity_of
from ..plan import BatchOptions
from .concerns import concerns_of_file
from .pair_laws import infinite, without_empty_columns

if TYPE_CHECKING:
    from ...datasets import Runs
    from ...parameters import ParameterFile

PARAMETERS, DRAWS = "params.json", "draws.npz"


@dataclass(frozen=True, slots=True)
class PairFiles:
    """Files of a pair by name, concerns from making them, and cells for its laws by response."""

    files: Mapping[str, bytes]
    concerns: tuple[Concern, ...]
    cells: Mapping[str, Mapping[str, Cell]]


def files_of_pair(runs: "Runs", options: BatchOptions, groups: Mapping[str, str]) -> PairFiles:
    """Fit a pair as ``fitmodels FILE`` does, and make its files; whatever fails is a concern.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> made = files_of_pair(datasets.read_runs(datasets.bundled("ac2017_table1")), BatchOptions(draws=1000), {})
    >>> sorted(made.files), sorted(made.cells["AW"])[:3]
    (['params.json'], ['no_posterior', 'posterior_V', 'posterior_f'])
    """
    made = attempt(lambda: _made(runs, options, groups))
    return no_file(made.reason) if isinstance(made, Failure) else made


def no_file(why: str) -> PairFiles:
    """No file, and why."""
    return PairFiles({}, (Concern("no parameter file", why),), {})


def _made(runs: "Runs", options: BatchOptions, groups: Mapping[str, str]) -> PairFiles:
    runs = without_empty_columns(runs)
    if why := infinite(runs):
        return no_file(why)
    pair = fit_pair(runs, options, needs_life=False)
    if not pair.laws:
        return PairFiles({}, (), {})  # its rows in the table have the reasons
    no_life = (Concern("no tool life", pair.no_life),) if pair.no_life else ()
    if pair.not_converged:
        return PairFiles({}, (*no_life, Concern(NOT_CONVERGED, pair.not_converged)), _not_converged_cells(pair))
    identity, odd = identity_of(groups)
    pf = parameter_file(
        pair, options, command=options.command, keep_draws=options.keep_draws, complete=True, **identity
    )
    return PairFiles(_bytes(pf, pair, options), (*no_life, *odd, *concerns_of_file(pf)), law_cells(pf))


def _bytes(pf: "ParameterFile", pair: PairAnalysis, options: BatchOptions) -> dict[str, bytes]:
    from ...parameters import draws_of
    from ...parameters.file import as_bytes

    files = {PARAMETERS: as_bytes(pf)}
    if options.keep_draws and pair.posteriors:
        files[DRAWS] = draws_of(pair.posteriors)
    return files


def law_cells(pf: "ParameterFile") -> dict[str, dict[str, Cell]]:
    """The verdict on each law, and mean and standard deviation of the draws of its slopes, or why there are none.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> law_cells(parameters.collect(tool="GC435", work="709M40"))
    {}
    """
    cells: dict[str, dict[str, Cell]] = {
        response: {"verdict": law.verdict.level} for response, law in pf.laws.items() if law.verdict is not None
    }
    for response, of in (pf.posterior.laws if pf.posterior is not None else {}).items():
        law = pf.laws[response]
        names = [name for name in law.coefficients if name in of.parameters]
        cells.setdefault(response, {})["no_posterior"] = of.reason or ""
        for name in names:
            cells[response] |= {
                f"posterior_{name}": of.parameters[name].mean,
                f"posterior_sd_{name}": of.parameters[name].sd,
            }
    return cells


def _not_converged_cells(pair: PairAnalysis) -> dict[str, dict[str, Cell]]:
    failed = {
        post.response: " ".join(post.convergence.reasons) for post in pair.posteriors if not post.convergence.passed
    }
    others = f"the draws of {', '.join(failed)} did not converge: no draws of this pair are kept"
    return {law.response: {"no_posterior": failed.get(law.response, others)} for law in pair.laws}


def with_cells(table: pd.DataFrame, cells: Mapping[int, Mapping[str, Mapping[str, Cell]]]) -> pd.DataFrame:
    """The table with what the parameter file of a pair adds to its laws, by its number and by response.

    >>> from fitmodels.batch.law_rows import law_table
    >>> table = law_table([(0, {"response": "AW", "reason": ""})])
    >>> with_cells(table, {0: {"AW": {"posterior_V": 0.5}}})[["response", "posterior_V"]].to_dict("list")
    {'response': ['AW'], 'posterior_V': [0.5]}
    """
    rows = [
        cells.get(pair, {}).get(response, {}) if there else {}
        for pair, response, there in zip(table[PAIR].tolist(), table["response"], fitted(table), strict=True)
    ]
    names = dict.fromkeys(name for row in rows for name in row)
    return table.assign(**{name: column(name, [row.get(name) for row in rows]) for name in names})
