"""The step of a reading that adds computed quantities, and says what stands for those that do not follow."""

from dataclasses import replace

import numpy as np
import pandas as pd

from ...core.arrays import Array, Ints
from ...core.errors import UsageError
from ..columns import NONE, Values
from ..doubts import Doubt
from ..draft import Draft
from ..options import ReadOptions
from ..plausibility.quantities import table_process
from ..vocabulary import ROLES, role_of_peak
from .comparison import compare, judge
from .rules import Derived, Known, apply, known_of

CONDITIONS = ("V", "n", "f", "fz", "fm", "d", "ae")
SUMMED = ", summed"  # end of an equation whose values are summed over rows
MOST, FEW = 0.9, 0.1  # shares of steps along an edge that rise
EQUAL = 1e-9


def derive(draft: Draft, options: ReadOptions) -> None:
    """Add the quantities that the columns of a draft allow, and compare those that are both measured and computed."""
    _life_as_time(draft)
    _thrust_of_drill(draft, options)
    peaks = frozenset(use.role for use in draft.uses if use.role and role_of_peak(use.name, use.unit) == use.role)
    known = replace(known_of(draft.data, draft.notes, options), peaks=peaks)
    _no_constant_twice(draft, options)
    compare(draft, known)
    words = {use.role: f"{use.name!r}" for use in draft.uses if use.role is not None}
    found = apply(known, words)
    found = [summed(draft, known, one) if one.role == "t" else one for one in found]
    draft.units.update({one.role: ROLES[one.role].unit for one in found if one.role in draft.data})
    draft.derived += found
    judge(draft, known, found)
    draft.assumed[:0] = [one.sentence for one in found]
    _substitutes(draft, known)
    used = {role for one in found for role in one.inputs}
    for role, given in known.given.items():
        if given.source == "--value" and role not in used:
            if ROLES[role].kind == "condition":
                draft.assumed.append(f"{given}: the same in all tests, so that laws hold at this {role} only")
            elif role in ("kappa", "lead", "sigma"):
                draft.assumed.append(f"{given}: used by Kienzle's law of the cutting force (--form kienzle)")
            else:
                draft.warnings.append(f"{given} is not used: no quantity that is not measured follows from it")


def _is_wear(role: str) -> bool:
    return role in ROLES and ROLES[role].kind == "wear"


def _life_as_time(draft: Draft) -> None:
    """Take a column T as the cutting time where it and the wear rise along the edges: a tool has one life only."""
    wear = next(filter(_is_wear, draft.data), None)
    if wear is None or "T" not in draft.data or "t" in draft.data:
        return
    if not _both_rise(draft, "T", wear):
        return
    header = _header(draft, "T")
    draft.data["t"] = draft.data.pop("T")
    draft.units["t"] = draft.units.pop("T")
    draft.uses = tuple(replace(use, role="t") if use.role == "T" else use for use in draft.uses)
    draft.assumed.append(f"{header} rises with {wear} along the edges: it is the cutting time t, not a tool life T")


def _may_be_feed_force(draft: Draft, options: ReadOptions) -> bool:
    """Whether a resultant force may be the feed force of drilling: neither force is named by the user or the file."""
    return "Fxz" not in options.map and "Ff" not in draft.data and table_process(draft, options) == "drilling"


def _thrust_of_drill(draft: Draft, options: ReadOptions) -> None:
    """Take a thrust in drilling as the feed force: Fxz is the resultant of two forces of turning."""
    use = next((use for use in draft.uses if use.role == "Fxz"), None)
    if use is None or use.name == "Fxz" or not _may_be_feed_force(draft, options):
        return
    draft.data["Ff"], draft.units["Ff"] = draft.data.pop("Fxz"), draft.units.pop("Fxz")
    draft.uses = tuple(replace(one, role="Ff") if one is use else one for one in draft.uses)
    draft.assumed.append(f'{use.name!r} in drilling is the feed force Ff; --map "Fxz={use.name}" keeps it as Fxz')


def _both_rise(draft: Draft, *roles: str) -> bool:
    """Whether quantities rise in most steps along the edges, of which most rows are a step."""
    edge = pd.Series(_edges(draft))
    steps = [pd.Series(np.asarray(draft.data[role], dtype=float)).groupby(edge).diff() for role in roles]
    inside = steps[0].notna()
    return bool(inside.sum() >= len(inside) / 2 and all((one[inside] > 0).mean() >= MOST for one in steps))


def _no_constant_twice(draft: Draft, options: ReadOptions) -> None:
    for role, value in options.constants.items():
        if role in draft.data:
            header = next((use.header for use in draft.uses if use.role == role), role)
            raise UsageError(
                f"--value {role}={value:g}: column {header!r} holds {role} already; leave one of the two out "
                f"(--map {role}={NONE} leaves the column out)."
            )


def _substitutes(draft: Draft, known: Known) -> None:
    """Say which quantity stands for the feed or the speed of the laws where f or V is not known."""
    data = draft.data
    if "f" not in data and "fz" in data:
        draft.assumed.append(
            "the feed of the laws is fz, feed per tooth: its exponent is that of f where the number of teeth "
            "is constant; --value z=4 (the number of teeth) gives f"
        )
    elif "f" not in data and "fm" in data and len(data.keys() & {"V", "n", "d", "t"}):
        draft.assumed.append("the feed of the laws is fm, feed rate: neither spindle speed nor diameter is known")
        if "V" in data and _varies(data["V"]) and _varies(data["fm"]):
            draft.doubts.append(
                Doubt(
                    ("V", "fm"),
                    "the feed is known as a feed rate alone and V varies: the exponent of V holds at constant feed "
                    "rate, not at constant feed per revolution; the diameter (--value D=..., in mm) gives f",
                )
            )
    if "V" not in data and "n" in data and "V" not in known.unwanted and _varies(data["n"]):
        draft.doubts.append(
            Doubt(
                ("n",),
                "the speed of the laws is n, spindle speed, since no diameter is known: its exponent is that of V only "
                "if the diameter was constant; --value D=80 (the diameter in mm) or a column D gives V",
            )
        )
    length = next((role for role in ("lc", "lf") if role in data), None)
    if length is not None and not {"t", "T"} & data.keys():
        _length_as_clock(draft, known, length)


def _length_as_clock(draft: Draft, known: Known, role: str) -> None:
    """Say that a length of cut stands for the time of the laws; lengths of single passes are summed over the edge."""
    if "t" not in known.unwanted:
        draft.assumed.append(
            f"the laws are on {role}, {ROLES[role].quantity}, in place of the time in cut, which does not follow: "
            "neither feed rate nor diameter is known; --value D=80 (the diameter in mm) gives t"
        )
    if "edge" not in draft.data or not any(ROLES[one].kind == "wear" for one in draft.data if one in ROLES):
        return
    values = np.asarray(draft.data[role], dtype=np.float64)
    edge = pd.Series(_edges(draft))
    steps = pd.Series(values).groupby(edge).diff().dropna()
    if len(steps) and float((steps > 0).mean()) <= FEW:
        draft.data[role] = np.asarray(pd.Series(values).groupby(edge).cumsum(), dtype=float)
        draft.assumed.append(
            f"{role} ({_header(draft, role)}) does not rise: each row is one pass, and the passes of an edge are summed"
        )


def _varies(values: Values) -> bool:
    known = np.asarray(values, dtype=float)
    return bool(np.nanmin(known, initial=np.inf) < np.nanmax(known, initial=-np.inf))


def summed(draft: Draft, known: Known, made: Derived) -> Derived:
    """The time in cut of an edge up to each row, and how it was made.

    Lengths that rise along an edge count from its start; their increments are divided by the speed of their row where
    the speed changes along an edge. Lengths that do not rise are of one pass each, and are summed over the edge. A
    mixture is taken as the first kind, with a doubt.
    """
    length = np.asarray(known.value(made.inputs[0]), dtype=np.float64)
    t: Array = np.asarray(draft.data["t"], dtype=np.float64)
    edge = _edges(draft)
    place = pd.Series(np.arange(len(edge))).groupby(edge)
    order = np.concatenate([np.asarray(rows) for rows in place.indices.values()])
    same = np.r_[False, edge[order][1:] == edge[order][:-1]]
    steps = np.where(same, np.diff(length[order], prepend=np.nan), np.nan)
    steps = steps[~np.isnan(steps)]
    if not steps.size:
        return made
    rising = float(np.mean(steps > 0))
    name = f"{made.inputs[0]} ({_header(draft, made.inputs[0])})"
    if rising <= FEW:
        draft.data["t"] = np.asarray(pd.Series(t).groupby(edge).cumsum(), dtype=float)
        if "edge" not in draft.data:
            draft.doubts.append(
                Doubt(
                    ("t", made.inputs[0]),
                    f"{name} does not rise: it is taken as the length of one pass, summed over rows of equal "
                    "conditions; a column of the edges is needed where two edges have the same conditions",
                )
            )
        words = "each row is one pass, and the passes of an edge are summed"
        return replace(made, equation=made.equation + SUMMED, sentence=f"{made.sentence}; {words}")
    if rising < MOST:
        draft.doubts.append(
            Doubt(
                ("t", made.inputs[0]),
                f"{name} rises in {100 * rising:.0f} % of the steps along an edge: it is taken as counted from a new "
                "edge; write the time in cut, or the length since the edge was new",
            )
        )
        return made
    with np.errstate(all="ignore"):
        speed = (length / t)[order]
        changes = np.nanmax(np.where(same, np.abs(speed / np.r_[np.nan, speed[:-1]] - 1), 0), initial=0)
    if changes <= EQUAL:
        return made
    increments = np.where(same, np.diff(length[order], prepend=0), length[order]) / speed
    sums = np.asarray(pd.Series(increments).groupby(edge[order]).cumsum(), dtype=float)
    t[order] = sums
    words = "the speed changes along an edge, so increments of the length are divided by the speed of their row"
    return replace(made, equation=made.equation + SUMMED, sentence=f"{made.sentence}; {words}")


def _edges(draft: Draft) -> Ints:
    """Number of the edge of each row: by the column of edges, or else by runs of equal conditions."""
    labels = [draft.data[role] for role in ("tool", "work", "edge") if role in draft.data]
    if "edge" in draft.data:
        return np.asarray(
            pd.DataFrame(dict(enumerate(labels))).groupby(list(range(len(labels)))).ngroup(), dtype=np.intp
        )
    columns = [draft.data[role] for role in CONDITIONS if role in draft.data] + labels
    changed = np.zeros(len(draft.lines), dtype=bool)
    for values in columns:
        changed[1:] |= values[1:] != values[:-1]
    return np.cumsum(changed)


def _header(draft: Draft, role: str) -> str:
    return next((repr(use.name) for use in draft.uses if use.role == role), role)
