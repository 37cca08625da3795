"""Reasons why a pair needs attention, and the groups that it belongs to."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags
from ...core.verdict import DO_NOT_USE, LEVELS
from ...datasets.plausibility.ranges import plausible, process_of
from ...datasets.vocabulary import FLANK_WEAR
from ...fit.checks.missing_factors import NEEDED, absent, is_noted, missing_of
from ..law_rows import PAIR, fitted, refusals
from ..outcomes import DOUBT, NO_LAW, REFUSED, Concern
from .pair_laws import NumberedRows, texts

if TYPE_CHECKING:
    from ...datasets.options import Process
    from ...parameters import ParameterFile

SHOWN = 3


def groups_of_pairs(of: NumberedRows, headers: Sequence[str]) -> tuple[list[dict[str, str]], list[list[Concern]]]:
    """For each pair its groups, empty text where its rows name none, and concerns where they name several.

    Examples
    --------
    >>> from fitmodels.datasets.runs import Source
    >>> from fitmodels.batch.rows import PairRows
    >>> from fitmodels.batch.fitting.pair_laws import numbered_rows
    >>> frame = pd.DataFrame({"tool": ["A", "A"], "work": ["W", "W"], "coolant": ["", "dry"]})
    >>> rows = PairRows(frame, np.arange(2), {}, (), Source("", "", 2, ""))
    >>> groups_of_pairs(numbered_rows(rows, {("A", "W")}), ["coolant"])
    ([{'coolant': 'dry'}], [[]])
    """
    groups: list[dict[str, str]] = [dict.fromkeys(headers, "") for _ in of.pairs]
    concerns: list[list[Concern]] = [[] for _ in of.pairs]
    for header in (h for h in headers if h in of.rows.frame):
        named = pd.DataFrame({"pair": of.number, "name": texts(of.rows.frame[header])})
        named = named[named["name"] != ""].drop_duplicates()
        for i, name in zip(*(named.drop_duplicates("pair")[c] for c in named), strict=True):
            groups[i][header] = name
        counts = np.bincount(named["pair"], minlength=len(of.pairs))
        for i in np.flatnonzero(counts > 1):
            concerns[i].append(differs(header, named["name"][named["pair"] == i].tolist()))
    return groups, concerns


def concerns_of_values(of: NumberedRows, process: "Process | None") -> list[list[Concern]]:
    """For each pair of a stream its quantities that are unusual throughout; pairs of lab files were judged before.

    A unit that the source states wrongly, or not at all, makes every value of a pair unusual. Single values are not
    judged here.

    Examples
    --------
    >>> from fitmodels.datasets.runs import Source
    >>> from fitmodels.batch.rows import PairRows
    >>> from fitmodels.batch.fitting.pair_laws import numbered_rows
    >>> frame = pd.DataFrame({"tool": ["A", "A"], "work": ["W", "W"], "VB": [66.0, 387.0]})
    >>> rows = PairRows(frame, np.arange(2), {"VB": "mm"}, (), Source("", "", 2, ""))
    >>> [[concern.words for concern in of] for of in concerns_of_values(numbered_rows(rows, {("A", "W")}), None)]
    [['VB 66 to 387 mm is unusual throughout this pair (usual 0.02 to 0.6 mm).']]
    """
    concerns: list[list[Concern]] = [[] for _ in of.pairs]
    named = process or process_of(of.held, of.rows.notes)
    about = of.rows.of_pair
    judged = np.array([bool(about) and pair in about for pair in of.pairs], dtype=bool)
    for role, ends in of.ends.items() if not judged.all() else ():
        ranges = plausible(role, named)
        if ranges is None:
            continue
        low, high = ends if not np.any(ends[0] <= 0) else _sizes(of, role)
        odd = ~judged & ((low > ranges.unusual[1]) | (high < ranges.unusual[0]))
        unit, usual = of.rows.units.get(role, ""), " to ".join(f"{end:g}" for end in ranges.usual)
        for i in np.flatnonzero(odd):
            words = (
                f"{role} {low[i]:.4g} to {high[i]:.4g} {unit} is unusual throughout this pair (usual {usual} {unit})."
            )
            concerns[i].append(Concern(DOUBT, words))
    return concerns


NAMED = ("V", "f")  # conditions of `NEEDED` that a table names; depth and width are often the same throughout a table


def concerns_of_conditions(of: NumberedRows, laws: pd.DataFrame) -> list[list[Concern]]:
    """For each pair with a power law, a concern where its rows hold no speed, no feed or, of wear, no time.

    Examples
    --------
    >>> from fitmodels.batch.law_rows import law_table
    >>> from fitmodels.batch.rows import PairRows
    >>> from fitmodels.batch.fitting.pair_laws import numbered_rows
    >>> from fitmodels.datasets.runs import Source
    >>> frame = pd.DataFrame({"tool": ["A", "A"], "work": ["W", "W"], "f": [0.1, 0.2], "P": [1.0, 2.0]})
    >>> of = numbered_rows(PairRows(frame, np.arange(2), {}, (), Source("", "", 2, "")), {("A", "W")})
    >>> laws = law_table([(0, {"response": "P", "form": "power", "reason": ""})])
    >>> [concern.words[:61] for concern in concerns_of_conditions(of, laws)[0]]
    ['Cutting speed V is not in the rows of this pair: exponents of']
    """
    concerns: list[list[Concern]] = [[] for _ in of.pairs]
    if all(name in of.held and of.held[name].all() for name in (*NAMED, "t")):
        return concerns
    responses = responses_of_power_laws(laws)
    for held, pairs in of.patterns():
        columns = {name for name in of.held if held.has(name)}
        alike: dict[tuple[int, tuple[str, ...]], list[Concern]] = {}  # pairs of one source and the same laws
        for i in pairs.tolist():
            about, asked = of.rows.of_pair.get(of.pairs[i], of.rows), tuple(responses.get(i, ()))
            if (id(about), asked) not in alike:
                known = columns.union(about.constants)
                alike[id(about), asked] = unknown_conditions(asked, known, about.notes, held.process)
            concerns[i] = alike[id(about), asked]
    return concerns


def responses_of_power_laws(laws: pd.DataFrame) -> dict[int, list[str]]:
    """Responses of the power laws of each pair that has any."""
    power = laws[fitted(laws) & (laws["form"] == "power").to_numpy(dtype=bool)]
    found: dict[int, list[str]] = {}
    for pair, response in zip(power[PAIR].tolist(), power["response"].tolist(), strict=True):
        found.setdefault(pair, []).append(response)
    return found


def unknown_conditions(
    responses: Sequence[str], known: Collection[str], notes: Sequence[str], process: "Process | None"
) -> list[Concern]:
    """The conditions of laws of these responses that are neither known nor in notes, as a concern.

    >>> [one.kind for one in unknown_conditions(["VB"], {"V", "f"}, (), None)], unknown_conditions([], {}, (), None)
    (['condition not known'], [])
    >>> unknown_conditions(["VB"], {"V", "t"}, (), "grinding")
    []
    """
    needed = [name for name in NEEDED[process] if name in NAMED and responses]
    needed += ["t"] * bool(set(FLANK_WEAR).intersection(responses))
    missing = missing_of(needed, lambda name: name in known or is_noted(notes, name), process)
    return [Concern("condition not known", absent(missing, "the rows of this pair"))] if missing else []


def _sizes(of: NumberedRows, role: str) -> tuple[Array, Array]:
    """Least and largest absolute value of each pair besides zero, shapes (K,), NaN where there is none."""
    sizes = of.rows.frame[role].abs()
    groups = sizes.where(sizes > 0).groupby(of.number)
    low, high = (ends.reindex(range(len(of.pairs))).to_numpy(dtype=float) for ends in (groups.min(), groups.max()))
    return low, high


def differs(header: str, names: Sequence[str], more: bool = False) -> Concern:
    """A pair whose rows name several groups, ``more`` where there may be further ones.

    >>> differs("grade", ["P20", "P30"]).words
    "'grade' names 2 groups in the rows of this pair (P20, P30); it counts as P20."
    """
    shown = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
    number = f"{len(names)} or more" if more else str(len(names))
    words = f"{header!r} names {number} groups in the rows of this pair ({shown}); it counts as {names[0]}."
    return Concern("group differs within the pair", words)


NOTED = ("edge_reason", "left_out")
MUCH = 0.1  # share of rows left out
FEW = 3  # degrees of freedom: below it an interval is wider than most answers
POOR = 0.5  # R2
EACH_ITS_EDGE = "is a separate edge"  # rows are independent: nothing is lacking


def concerns_of_laws(table: pd.DataFrame, none: Mapping[int, str], pairs: int) -> list[tuple[Concern, ...]]:
    """Concerns from the laws of each pair; equal words of several laws are joined.

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
    >>> from fitmodels.batch.law_rows import law_table
    >>> row = {"response": "AW", "reason": "", "rsquared": 0.3, "df": 9, "nobs": 12, "dropped": 4}
    >>> [concern.words for concern in concerns_of_laws(law_table([(0, row)]), {}, 1)[0]]
    ['AW: 4 of 16 rows are left out.', 'AW: R2 0.30, less than half of the scatter.']
    """
    found: list[list[Concern]] = [[] for _ in range(pairs)]
    for pair, refused in refusals(table).items():
        found[pair] = [Concern(NO_LAW, none[pair])] if pair in none else [Concern(REFUSED, why) for why in refused]
    laws = table[fitted(table)]
    of, response = laws[PAIR].tolist(), laws["response"].tolist()
    responses_of: dict[tuple[int, str, str], list[str]] = {}
    for row, kind, words in sorted(_of_laws(laws), key=lambda each: each[0]):
        responses_of.setdefault((of[row], kind, words), []).append(response[row])
    for (pair, kind, words), responses in responses_of.items():
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
        yield i, "factor left out", f"the law omits {left_out[i]}."
    df = _numbers(laws, "df", FEW)
    for i in _where(df < FEW):
        plural = "" if df[i] == 1 else "s"
        yield i, "few degrees of freedom", f"{df[i]:.0f} degree{plural} of freedom; measure more edges."
    t = np.where(laws["response"].isin(FLANK_WEAR), _numbers(laws, "params_t", 0), 0)
    for i in _where(t < 0):
        words = f"exponent of t {t[i]:.3g}, but wear does not decrease; check the gauge and the edges of the rows."
        yield i, "wear falls with time", words
    R2 = _numbers(laws, "rsquared", 1)
    for i in _where(R2 < POOR):
        yield i, "fits badly", f"R2 {R2[i]:.2f}, less than half of the scatter."


def _where(flags: Flags) -> list[int]:
    return np.flatnonzero(flags).tolist()


def _numbers(laws: pd.DataFrame, name: str, otherwise: float) -> Array:
    """A column of numbers, with something else where one is missing."""
    if name not in laws:
        return np.full(len(laws), float(otherwise))
    values = laws[name].to_numpy(dtype=float, na_value=np.nan)
    return np.where(np.isnan(values), otherwise, values)


def concerns_of_file(pf: "ParameterFile") -> tuple[Concern, ...]:
    """Verdicts other than usable, with all their reasons; laws with the same reasons together.

    Of tool life one against its use alone: that it is extrapolated is the case in most files.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> concerns_of_file(parameters.collect(tool="GC435", work="709M40"))
    ()
    """
    from ...cards.content.posterior import wider

    judged: dict[tuple[str, str], list[str]] = {}
    for response, law in pf.laws.items():
        if law.verdict is not None and law.verdict.reasons:
            judged.setdefault((law.verdict.level, " ".join(law.verdict.reasons)), []).append(response)
    life = None if pf.tool_life is None else pf.tool_life.verdict
    if life is not None and life.level == LEVELS[DO_NOT_USE]:
        judged.setdefault((life.level, " ".join(life.reasons)), []).append("T (tool life)")
    found = [Concern(level, f"{', '.join(responses)}: {words}") for (level, words), responses in judged.items()]
    for response, law in pf.laws.items():
        drawn = None if pf.posterior is None else pf.posterior.laws.get(response)
        if drawn is not None:
            found += [Concern("draws too certain", f"{response}: {words}") for words in wider(law, drawn)]
    return tuple(found)
