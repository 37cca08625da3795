"""The parameter file of a pair among thousands, its draws if they are kept, and what the posterior adds to its rows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..failures import Failed, tried
from ..how import How
from ..law_table import PAIR, column, fitted
from ..outcome import Cell, Concern
from ..plan import Reading
from .concerns import concerns_of_file
from .groups import identity_of
from .laws_of_pairs import infinite
from .one_pair import PairFit, fit_pair, parameter_file
from .pairs_of_rows import only_held

if TYPE_CHECKING:
    from ...datasets import Runs
    from ...parameters import ParameterFile

PARAMETERS, DRAWS = "params.json", "draws.npz"


@dataclass(frozen=True, slots=True)
class PairFiles:
    """Files of a pair by name, concerns that came up on the way, and cells for its laws by response."""

    files: Mapping[str, bytes]
    concerns: tuple[Concern, ...]
    cells: Mapping[str, Mapping[str, Cell]]


def files_of_pair(runs: "Runs", how: How, reading: Reading, groups: Mapping[str, str]) -> PairFiles:
    """Fit a pair as ``fitmodels FILE`` does, and make its files; whatever fails is a concern.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> made = files_of_pair(datasets.read_runs(datasets.bundled("ac2017_table1")), How(draws=1000), Reading(), {})
    >>> sorted(made.files), sorted(made.cells["AW"])[:3]
    (['params.json'], ['no_posterior', 'posterior_V', 'posterior_f'])
    """
    made = tried(lambda: _made(runs, how, reading, groups))
    return no_file(made.reason) if isinstance(made, Failed) else made


def no_file(why: str) -> PairFiles:
    """No file, and why."""
    return PairFiles({}, (Concern("no parameter file", why),), {})


def _made(runs: "Runs", how: How, reading: Reading, groups: Mapping[str, str]) -> PairFiles:
    runs = only_held(runs)
    if why := infinite(runs):
        return no_file(why)
    fitted = fit_pair(
        runs, error=how.error, criterion=how.criterion, needs_life=False, seed=how.seed, draws=how.draws,
        priors=how.priors, student=how.student,
    )  # fmt: skip
    if not fitted.laws:
        return PairFiles({}, (), {})  # its rows say why
    no_life = (Concern("no tool life", fitted.no_life),) if fitted.no_life else ()
    if fitted.shut:
        return PairFiles({}, (*no_life, Concern("gate shut", fitted.shut)), _behind_shut_gate(fitted))
    identity, odd = identity_of(groups)
    pf = parameter_file(
        runs, fitted, gauge_sd=how.gauge_sd, command=how.command or None, options=options_of(how, reading),
        seed=how.seed, keep_draws=how.draws_kept, **identity,
    )  # fmt: skip
    return PairFiles(_bytes(pf, fitted, how), (*no_life, *odd, *concerns_of_file(pf)), posterior_cells(pf))


def _bytes(pf: "ParameterFile", fitted: PairFit, how: How) -> dict[str, bytes]:
    from ...parameters import draws_of
    from ...parameters.file import as_bytes

    files = {PARAMETERS: as_bytes(pf)}
    if how.draws_kept and fitted.posteriors:
        files[DRAWS] = draws_of(fitted.posteriors)
    return files


def posterior_cells(pf: "ParameterFile") -> dict[str, dict[str, Cell]]:
    """Mean and standard deviation of the draws of each slope and shift, or why there are none, by response.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> posterior_cells(parameters.collect(tool="GC435", work="709M40"))
    {}
    """
    cells: dict[str, dict[str, Cell]] = {}
    for response, of in (pf.posterior.laws if pf.posterior is not None else {}).items():
        law = pf.laws[response]
        names = [name for name in law.coefficients if name in of.parameters]
        cells[response] = {"no_posterior": of.reason or ""}
        for name in names:
            cells[response] |= {
                f"posterior_{name}": of.parameters[name].mean,
                f"posterior_sd_{name}": of.parameters[name].sd,
            }
    return cells


def _behind_shut_gate(fitted: PairFit) -> dict[str, dict[str, Cell]]:
    shut = {p.response: " ".join(p.gate.reasons) for p in fitted.posteriors if not p.gate.open}
    others = f"the gate of {', '.join(shut)} is shut: nothing is kept of this pair's draws"
    return {law.response: {"no_posterior": shut.get(law.response, others)} for law in fitted.laws}


def options_of(how: How, reading: Reading) -> dict[str, Any]:
    """Options that the numbers depend on, as the command names them and writes them down.

    Examples
    --------
    >>> options_of(How(criterion=0.2), Reading(map={"VB": "col7"}))
    {'map': ['VB=col7'], 'error': 'multiplicative', 'criterion': 0.2}
    """
    usual = How()
    ranges = {symbol: ":".join(f"{end:g}" for end in ends) for symbol, ends in reading.ranges.items()}
    given: dict[str, Any] = {"map": _pairs(reading.map), "unit": _pairs(reading.units), "range": _pairs(ranges)}
    given |= {"tool": reading.tool, "work": reading.work, "error": how.error}
    given |= {"criterion": how.criterion, "gauge_sd": how.gauge_sd}
    drawn = {"seed": how.seed, "draws": how.draws, "priors": how.priors, "student": how.student}
    for name, value in drawn.items():  # of a priors file the content, not the name
        given[name] = value if value != getattr(usual, name) else None
    given |= {"decimal": reading.decimal, "delimiter": reading.delimiter, "sheet": reading.sheet}
    return {name: value for name, value in given.items() if value not in (None, [])}


def _pairs(of: Mapping[str, str]) -> list[str]:
    return [f"{symbol}={value}" for symbol, value in of.items()]


def with_cells(table: pd.DataFrame, cells: Mapping[int, Mapping[str, Mapping[str, Cell]]]) -> pd.DataFrame:
    """The table with what the posterior adds to the laws of a pair, by its number and by response.

    >>> from fitmodels.batch.law_table import law_table
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
