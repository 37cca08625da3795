"""Why a pair needs attention: few kinds, each of which somebody can do something about."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from ..outcome import Cell, Concern
from .table_rows import reason_of, refusals

if TYPE_CHECKING:
    from ...parameters import ParameterFile

MUCH = 0.1  # share of rows left out
FEW = 3  # degrees of freedom: below it an interval is wider than most answers
POOR = 0.5  # R2
ACT = 2  # concern of a check at which one should act
EACH_ITS_EDGE = "is an edge of its own"  # rows are independent: nothing is lacking


def concerns_of_rows(rows: Sequence[Mapping[str, Cell]]) -> tuple[Concern, ...]:
    """What the rows of a pair in the results table say; the same words of several laws are said once.

    Examples
    --------
    >>> row = {"response": "AW", "reason": "", "rsquared": 0.3, "df": 9, "nobs": 12, "dropped": 4}
    >>> [concern.words for concern in concerns_of_rows([row])]
    ['AW: 4 of 16 rows are left out.', 'AW: R2 0.30, less than half of the scatter.']
    """
    if why := reason_of(rows):
        return (Concern("no law", why),)
    refused = [Concern("law refused", words) for words in refusals(rows)]
    told: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if not row["reason"]:
            for kind, words in _of_row(row):
                told.setdefault((kind, words), []).append(str(row["response"]))
    return (*refused, *(Concern(kind, f"{', '.join(of)}: {words}") for (kind, words), of in told.items()))


def _of_row(row: Mapping[str, Cell]) -> Iterable[tuple[str, str]]:
    edge_reason, left_out = row.get("edge_reason"), row.get("left_out")
    if edge_reason and EACH_ITS_EDGE not in str(edge_reason):
        yield "no errors by edge", f"{edge_reason}."
    dropped, nobs = _number(row, "dropped", 0), _number(row, "nobs", 0)
    if dropped > MUCH * (nobs + dropped):
        yield "rows left out", f"{dropped:.0f} of {nobs + dropped:.0f} rows are left out."
    if left_out:
        yield "factor left out", f"the law does without {left_out}."
    df = _number(row, "df", FEW)
    if df < FEW:
        yield "few degrees of freedom", f"{df:.0f} degree{'' if df == 1 else 's'} of freedom; measure more edges."
    if row["response"] in ("AW", "VB") and (t := _number(row, "params_t", 0)) < 0:
        yield "wear falls with time", f"exponent of t {t:.3g}, but no wear falls; look at the gauge and at the edges."
    R2 = _number(row, "rsquared", 1)
    if R2 < POOR:
        yield "fits badly", f"R2 {R2:.2f}, less than half of the scatter."


def _number(row: Mapping[str, Cell], name: str, otherwise: float) -> float:
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else otherwise


def concerns_of_file(pf: "ParameterFile") -> tuple[Concern, ...]:
    """Verdicts of checks on which one should act, those of a law together.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> concerns_of_file(parameters.collect(tool="GC435", work="709M40"))
    ()
    """
    from ...cards.posterior_facts import wider

    found = []
    for response, law in pf.laws.items():
        words = [check.verdict for check in law.checks.values() if check.concern >= ACT and check.verdict]
        if words:
            found.append(Concern("verdict", f"{response}: {' '.join(words)}"))
        drawn = None if pf.posterior is None else pf.posterior.laws.get(response)
        if drawn is not None:
            found += [Concern("draws too sure", f"{response}: {words}") for words in wider(law, drawn)]
    return tuple(found)
