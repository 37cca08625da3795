"""Why a pair needs attention: few kinds, each of which somebody can do something about."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...fit.defaults import WEAR
from ..law_table import PAIR, fitted
from ..outcome import NO_LAW, REFUSED, Concern
from .table_rows import refusals

if TYPE_CHECKING:
    from ...parameters import ParameterFile

NOTED = ("edge_reason", "left_out")
MUCH = 0.1  # share of rows left out
FEW = 3  # degrees of freedom: below it an interval is wider than most answers
POOR = 0.5  # R2
ACT = 2  # concern of a check at which one should act
EACH_ITS_EDGE = "is an edge of its own"  # rows are independent: nothing is lacking


def concerns_of_laws(table: pd.DataFrame, none: Mapping[int, str], pairs: int) -> list[tuple[Concern, ...]]:
    """What the laws of each pair say; the same words of several laws of a pair are said once.

    Parameters
    ----------
    table : DataFrame
        As `law_table`.
    none : mapping of int to str
        Why pairs have no law at all, as `reasons` gives it.
    pairs : int
        How many there are.

    Examples
    --------
    >>> from fitmodels.batch.law_table import law_table
    >>> row = {"response": "AW", "reason": "", "rsquared": 0.3, "df": 9, "nobs": 12, "dropped": 4}
    >>> [concern.words for concern in concerns_of_laws(law_table([(0, row)]), {}, 1)[0]]
    ['AW: 4 of 16 rows are left out.', 'AW: R2 0.30, less than half of the scatter.']
    """
    found: list[list[Concern]] = [[] for _ in range(pairs)]
    for pair, refused in refusals(table).items():
        found[pair] = [Concern(NO_LAW, none[pair])] if pair in none else [Concern(REFUSED, why) for why in refused]
    laws = table[fitted(table)]
    of, response = laws[PAIR].tolist(), laws["response"].tolist()
    told: dict[tuple[int, str, str], list[str]] = {}
    for row, kind, words in sorted(_of_laws(laws), key=lambda each: each[0]):
        told.setdefault((of[row], kind, words), []).append(response[row])
    for (pair, kind, words), responses in told.items():
        found[pair].append(Concern(kind, f"{', '.join(responses)}: {words}"))
    return [tuple(each) for each in found]


def _of_laws(laws: pd.DataFrame) -> Iterator[tuple[int, str, str]]:
    """Row, kind and words, kind by kind."""
    n = len(laws)
    edge_reason, left_out = (laws[name].to_numpy() if name in laws else np.full(n, "") for name in NOTED)
    for i in _where(edge_reason != ""):
        if EACH_ITS_EDGE not in edge_reason[i]:
            yield i, "no errors by edge", f"{edge_reason[i]}."
    dropped, nobs = _numbers(laws, "dropped", 0), _numbers(laws, "nobs", 0)
    for i in _where(dropped > MUCH * (nobs + dropped)):
        yield i, "rows left out", f"{dropped[i]:.0f} of {nobs[i] + dropped[i]:.0f} rows are left out."
    for i in _where(left_out != ""):
        yield i, "factor left out", f"the law does without {left_out[i]}."
    df = _numbers(laws, "df", FEW)
    for i in _where(df < FEW):
        plural = "" if df[i] == 1 else "s"
        yield i, "few degrees of freedom", f"{df[i]:.0f} degree{plural} of freedom; measure more edges."
    t = np.where(laws["response"].isin(WEAR), _numbers(laws, "params_t", 0), 0)
    for i in _where(t < 0):
        words = f"exponent of t {t[i]:.3g}, but no wear falls; look at the gauge and at the edges."
        yield i, "wear falls with time", words
    R2 = _numbers(laws, "rsquared", 1)
    for i in _where(R2 < POOR):
        yield i, "fits badly", f"R2 {R2[i]:.2f}, less than half of the scatter."


def _where(flags: NDArray[np.bool_]) -> list[int]:
    return np.flatnonzero(flags).tolist()


def _numbers(laws: pd.DataFrame, name: str, otherwise: float) -> NDArray[np.float64]:
    """A column of numbers, with something else where one is missing."""
    if name not in laws:
        return np.full(len(laws), float(otherwise))
    values = laws[name].to_numpy(dtype=float, na_value=np.nan)
    return np.where(np.isnan(values), otherwise, values)


def concerns_of_file(pf: "ParameterFile") -> tuple[Concern, ...]:
    """Verdicts of checks on which one should act, those of a law together.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> concerns_of_file(parameters.collect(tool="GC435", work="709M40"))
    ()
    """
    from ...cards.content.posterior import wider

    found = []
    for response, law in pf.laws.items():
        words = [check.verdict for check in law.checks.values() if check.concern >= ACT and check.verdict]
        if words:
            found.append(Concern("verdict", f"{response}: {' '.join(words)}"))
        drawn = None if pf.posterior is None else pf.posterior.laws.get(response)
        if drawn is not None:
            found += [Concern("draws too sure", f"{response}: {words}") for words in wider(law, drawn)]
    return tuple(found)
