"""Pairs that need attention, with reasons from their fits and from comparison with their families."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags
from ..core.verdict import DO_NOT_USE, LEVELS, RESERVATIONS
from ..datasets.plausibility.unit_shifts import DECIMAL, isolated, minorities, ratios_of
from ..datasets.tables.numerals import is_missing
from ..datasets.vocabulary import ROLES
from .outcomes import DOUBT, GROUPS_DIFFER, NO_LAW, NOT_CONVERGED, REFUSED, Concern, PairOutcome
from .plan import Pair

SCATTERS, NAMES, COPIED = "large scatter", "doubtful name", "same measurements"
UNLIKE = "unlike its family"
SEVERITY = (  # unusable; a law that may mislead; what it lacks; notes on the pair
    NO_LAW, NOT_CONVERGED, "no parameter file", REFUSED,
    LEVELS[DO_NOT_USE], COPIED, "wear falls with time", "fits badly", SCATTERS, UNLIKE, "draws too certain",
    "condition not known", NAMES,
    LEVELS[RESERVATIONS], "few degrees of freedom", "no errors by edge", "factor left out", "rows left out",
    DOUBT, "no tool life",
    GROUPS_DIFFER, "group differs within the pair", "no group of ISO 513",
)  # fmt: skip
DEPTHS = ("d", "ae")
SURE = 20.0  # ratios of units: smaller ones, as of lbf and N, are also those of tools and materials
NEAR = 2.0  # in the right unit, the middle of a pair is among those of the others, or within this ratio
TIMES = 3.0  # the median scatter of a response
FEWEST = 5  # pairs for a usual scatter
BY_CHANCE = 1e-4  # a scatter with few degrees of freedom may be so much larger than the median
LEVEL = 0.99
EXACT = 1e-9  # of ln y: a smaller scatter is rounding, of a table computed from a law


@dataclass(frozen=True, slots=True)
class Attention:
    """A kind of concern, and the pairs affected.

    Attributes
    ----------
    kind : str
    pairs : int
    examples, words : tuple of str
        Some of the pairs, and their concerns, in the order of the pairs.
    """

    kind: str
    pairs: int
    examples: tuple[str, ...]
    words: tuple[str, ...]


def attention_frame(outcomes: Sequence[PairOutcome]) -> pd.DataFrame:
    """Give a row for each pair and concern, in the order of the pairs: ``tool, work, kind, words``."""
    rows = [(one.tool, one.work, concern.kind, concern.words) for one in outcomes for concern in _concerns(one)]
    return pd.DataFrame(rows, columns=["tool", "work", "kind", "words"], dtype=object)


def attention_summary(outcomes: Sequence[PairOutcome], most: int = 3) -> list[Attention]:
    """Kinds of concern, the most severe first and unknown ones last, with at most ``most`` examples of each.

    Examples
    --------
    >>> few = PairOutcome("GC435", "brass", 9, concerns=(Concern("few degrees of freedom", "1 degree"),))
    >>> none = PairOutcome("GC435", "bronze", 2, reason="2 rows are too few")
    >>> [(item.kind, item.pairs, item.examples, item.words) for item in attention_summary([few, none])]
    ... # doctest: +NORMALIZE_WHITESPACE
    [('no law', 1, ('GC435 on bronze',), ('2 rows are too few',)),
     ('few degrees of freedom', 1, ('GC435 on brass',), ('1 degree',))]
    """
    found: dict[str, dict[str, str]] = defaultdict(dict)
    for one in outcomes:
        for concern in _concerns(one):
            found[concern.kind].setdefault(str(Pair(one.tool, one.work)), concern.words)
    kinds = sorted(found, key=lambda kind: (_severity(kind), kind))
    return [
        Attention(kind, len(found[kind]), tuple(found[kind])[:most], tuple(found[kind].values())[:most])
        for kind in kinds
    ]


def with_families(
    outcomes: Sequence[PairOutcome], results: pd.DataFrame, pooled: pd.DataFrame | None = None
) -> list[PairOutcome]:
    """Outcomes with concerns from the other pairs: names, units, large scatter, exponents unlike those of the family.

    Parameters
    ----------
    outcomes : sequence of PairOutcome
    results : DataFrame
        As `tables.results_frame`.
    pooled : DataFrame, optional
        The pairs of `comparison.compare`, with intervals at 95 %: ``tool, work, response, factor, family, estimate,
        se, df, new_low, new_high`` are looked at.
    """
    more: dict[tuple[str, str], list[Concern]] = defaultdict(list)
    of_names = *_alike(outcomes), *_unnamed(outcomes), *_copied(results)
    for pair, concern in (*of_names, *_in_other_units(results), *_scattering(results)):
        more[pair].append(concern)
    for pair, concern in _unlike(pooled) if pooled is not None and len(pooled) else ():
        more[pair].append(concern)
    return [
        replace(one, concerns=(*one.concerns, *extra)) if (extra := more.get((one.tool, one.work))) else one
        for one in outcomes
    ]


def _concerns(one: PairOutcome) -> tuple[Concern, ...]:
    """The concerns of a pair; a missing law is always one."""
    if not one.reason or any(concern.kind == NO_LAW for concern in one.concerns):
        return one.concerns
    return (Concern(NO_LAW, one.reason), *one.concerns)


def _severity(kind: str) -> int:
    return SEVERITY.index(kind) if kind in SEVERITY else len(SEVERITY)


def _alike(outcomes: Sequence[PairOutcome]) -> Iterator[tuple[tuple[str, str], Concern]]:
    """Pairs whose names differ in blanks and case alone."""
    spellings: dict[tuple[str, str], list[PairOutcome]] = defaultdict(list)
    for one in outcomes:
        spellings[_spelling(one.tool), _spelling(one.work)].append(one)
    alike = [(one, group) for group in spellings.values() if len(group) > 1 for one in group]
    for one, group in alike:
        other = next(Pair(each.tool, each.work) for each in group if each is not one)
        words = f"{str(other)!r} is another pair: the names differ in blanks or case only. If they are one pair, "
        yield (one.tool, one.work), Concern(NAMES, f"{words}spell them alike in the source.")


def _unnamed(outcomes: Sequence[PairOutcome]) -> Iterator[tuple[tuple[str, str], Concern]]:
    """Pairs with a name that stands for a missing one."""
    for role in ("tool", "work"):
        missing = set(filter(is_missing, {getattr(one, role) for one in outcomes}))
        for one in (one for one in outcomes if getattr(one, role) in missing):
            words = f"stands for a missing name: rows of several {role}s may be in this pair."
            yield (one.tool, one.work), Concern(NAMES, f"{role} {getattr(one, role)!r} {words}")


def _copied(results: pd.DataFrame) -> Iterator[tuple[tuple[str, str], Concern]]:
    """Pairs whose law of a response has the scatter and R2 of another pair's, with all digits."""
    if not {"scale_se", "rsquared"} <= set(results):
        return
    laws = results[(results["reason"] == "") & (results["scale_se"] > EXACT) & results["rsquared"].notna()]
    scatter, r2 = (laws[name].to_numpy(dtype=float) for name in ("scale_se", "rsquared"))
    laws = laws.assign(_scatter=np.log(scatter).round(11), _r2=r2.round(11))
    same = ["response", "form", "nobs", "_scatter", "_r2"]
    for (response, _, n, *_), each in laws[laws.duplicated(same, keep=False)].groupby(same, sort=False):
        pairs = [Pair(str(tool), str(work)) for tool, work in zip(each["tool"], each["work"], strict=True)]
        for pair in pairs:
            other = next(one for one in pairs if one != pair)
            words = (
                f"{response}: its {n} rows have the law of {other}, with all digits: the same measurements under two "
                "names. Leave one of them out of the source, or correct the name."
            )
            yield (pair.tool, pair.work), Concern(COPIED, words)


def _spelling(name: str) -> str:
    return "".join(name.split()).casefold()


def _in_other_units(results: pd.DataFrame) -> Iterator[tuple[tuple[str, str], Concern]]:
    """Pairs far from all others in a quantity that a ratio of units brings among them, as of inch and mm.

    Depths are not compared: those of roughing and finishing differ by as much.
    """
    laws = results[results["reason"] == ""]
    for response, each in laws.groupby("response", sort=False) if "response_from" in laws else ():
        yield from _shifted(each, str(response), "response_from", "response_to")
    for factor in (name.removeprefix("from_") for name in map(str, laws) if name.startswith("from_")):
        if factor not in DEPTHS:
            of_pairs = laws[laws[f"from_{factor}"].notna()].drop_duplicates(["tool", "work"])
            yield from _shifted(of_pairs, factor, f"from_{factor}", f"to_{factor}")


def _shifted(laws: pd.DataFrame, symbol: str, low: str, high: str) -> Iterator[tuple[tuple[str, str], Concern]]:
    laws = laws[laws[low] > 0]
    if len(laws) < FEWEST:
        return
    x = np.log(laws[[low, high]].to_numpy(dtype=float)).mean(axis=1)
    ratios = {ratio: units for ratio, units in ratios_of(symbol).items() if ratio >= SURE and ratio not in DECIMAL}
    found = [one for one in minorities(x, ratios, NEAR) if isolated(x, one[0])]
    unit = ROLES[symbol].unit if symbol in ROLES else ""
    shifted = np.logical_or.reduce([np.zeros(len(x), dtype=bool), *(pairs for pairs, _ in found)])
    for i in np.flatnonzero(shifted).tolist():
        others, factor = _nearest(x, i, found)
        ratio, row = max(factor, 1 / factor), laws.iloc[i]
        units = next(units for known, units in ratios.items() if np.isclose(known, ratio))
        words = (
            f"{symbol} {row[low]:.4g} to {row[high]:.4g} {unit}: {'multiplied' if factor > 1 else 'divided'} by "
            f"{ratio:g} ({units}) it is among the other pairs, whose middles are {np.exp(others.min()):.3g} to "
            f"{np.exp(others.max()):.3g} {unit}; check its unit."
        )
        yield (str(row["tool"]), str(row["work"])), Concern(DOUBT, words)


def _nearest(x: Array, i: int, found: Sequence[tuple[Flags, float]]) -> tuple[Array, float]:
    """The other pairs of the minority of pair i that its factor brings nearest to their median, and the factor."""
    with_pair = ((x[~pairs], factor) for pairs, factor in found if pairs[i])
    return min(with_pair, key=lambda one: abs(x[i] + np.log(one[1]) - np.median(one[0])))


def _scattering(results: pd.DataFrame) -> Iterator[tuple[tuple[str, str], Concern]]:
    """Pairs whose scale_se is above `TIMES` the median of the laws of the same response and form."""
    from scipy.special import chdtri

    if "scale_se" not in results:
        return
    laws = results[(results["reason"] == "") & (results["scale_se"] > 0)]
    for (response, _), each in laws.groupby(["response", "form"], sort=False):
        scale = each["scale_se"].to_numpy(dtype=float)
        df = each["df_resid"].to_numpy(dtype=float, na_value=0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            chance = np.where(df > 0, np.sqrt(chdtri(df, BY_CHANCE) / df), 0.0)
        middle = float(np.median(scale))
        for i in np.flatnonzero(scale > np.maximum(TIMES, chance) * middle) if len(each) >= FEWEST else ():
            words = f"{response} has a scatter of {scale[i] / middle:.2g} times the median of the pairs"
            pair = str(each["tool"].iloc[i]), str(each["work"].iloc[i])
            yield pair, Concern(SCATTERS, f"{words} ({scale[i]:.3g} against {middle:.3g})")


def _unlike(pooled: pd.DataFrame) -> Iterator[tuple[tuple[str, str], Concern]]:
    """Pairs whose exponent is outside the interval of a new pair of the family, given its own error.

    Where a pair belongs to several families, that of a grouping counts before all pairs together.
    """
    from ..fit.many.pooling import WHOLE

    low, high = (pooled[name].to_numpy(dtype=float) for name in ("new_low", "new_high"))
    level = max(LEVEL, 1 - 1 / len(pooled))  # of many thousand exponents one is expected outside by chance
    middle, half = (low + high) / 2, np.hypot(_half_of_family(high - low, level), _half_of_pair(pooled, level))
    with np.errstate(invalid="ignore"):
        outside = np.abs(pooled["estimate"].to_numpy(dtype=float) - middle) > half
    outlying = pooled.assign(_from=middle - half, _to=middle + half)[outside]
    outlying = outlying.iloc[np.argsort((outlying["family"] == WHOLE).to_numpy(), kind="stable")]
    for row in outlying.drop_duplicates(["tool", "work", "response", "factor"]).to_dict("records"):
        of = "" if row["family"] == WHOLE else f"of {row['family']} "
        words = (
            f"{row['response']}: exponent of {row['factor']} {row['estimate']:.3g} +- {row['se']:.2g}; "
            f"another pair {of}with this standard error is expected between {row['_from']:.3g} and "
            f"{row['_to']:.3g} ({100 * level:.4g} %)"
        )
        yield (str(row["tool"]), str(row["work"])), Concern(UNLIKE, words)


def _half_of_family(width: Array, level: float) -> Array:
    """Half the interval of a new pair of the family, from the width of the 95 % one."""
    from scipy.special import ndtri

    return np.asarray(width / 2 * ndtri((1 + level) / 2) / ndtri(0.975))


def _half_of_pair(pooled: pd.DataFrame, level: float) -> Array:
    """Half the t interval of a pair's own estimate."""
    from scipy.special import ndtri, stdtrit

    df = pooled["df"].to_numpy(dtype=float)
    known = np.isfinite(df)
    p = (1 + level) / 2
    times = np.where(known, stdtrit(np.where(known, np.maximum(df, 1), 1), p), ndtri(p))
    return np.asarray(times * pooled["se"].to_numpy(dtype=float))
