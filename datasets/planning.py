"""Plans of tests for a machine: a design of any kind, test durations, settings of the process, and what it costs.

A plan has a row for each reading, with empty columns for what will be measured: filled in, it is the data file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from ..core.arrays import Array, Ints
from ..core.arrays import is_positive as _is_positive
from ..core.errors import UsageError
from .derived.rules import check_settings, machine_settings, removal_rate
from .design import (
    RESERVED,
    DesignPoints,
    block_sentences,
    central_composite,
    planned_edges,
    round_significant,
)
from .factorial_designs import (
    ARRAYS,
    Levels,
    alias_sentences,
    array_columns,
    factorial_blocks,
    orthogonal_array,
    products_of_blocks,
    repeat_sentences,
    two_ends,
    two_level,
)
from .headers import setting_named
from .plausibility.quantities import planned_doubts
from .vocabulary import ROLES

_T = TypeVar("_T")

DESIGNS = ("composite", "factorial", *ARRAYS)
MOST_READINGS = 100
STEEL = 2000.0  # N/mm2, an assumed specific cutting force, for the power of the heaviest edge
KW = STEEL / 6e7  # power of a removal rate in mm3/min
DIGITS = 4


@dataclass(frozen=True, slots=True)
class Process:
    """Settings of a process: factors that can be varied, of which the first are usual."""

    usual: tuple[str, ...]
    factors: tuple[str, ...]
    constants: tuple[str, ...]


PROCESSES: Mapping[str, Process] = MappingProxyType(
    {
        "turning": Process(("V", "f", "d"), ("V", "n", "f", "d", "t"), ("V", "n", "f", "d", "D")),
        "milling": Process(
            ("V", "fz", "d", "ae"),
            ("V", "n", "fz", "fm", "d", "ae", "Dc", "D", "t"),
            ("V", "n", "fz", "fm", "d", "ae", "Dc", "D", "z"),
        ),
        "drilling": Process(("V", "f"), ("V", "n", "f", "Dc", "D", "t"), ("V", "n", "f", "Dc", "D", "z")),
    }
)


def plan_tests(
    ranges: Mapping[str, Levels],
    *,
    design: str = "composite",
    alpha: float | str = 2.0,
    centre: int | None = None,
    axial_repeats: int = 2,
    half: bool = False,
    repeats: int = 1,
    blocks: int = 1,
    duration: tuple[float, ...] | None = None,
    readings: int = 1,
    measure: Sequence[str] = (),
    process: str | None = None,
    constants: Mapping[str, float] | None = None,
    seed: int = 1,
) -> pd.DataFrame:
    """Plan of tests in run order, a row for each reading of an edge.

    Parameters
    ----------
    ranges : mapping of factor to (low, high), or to its levels
        in the factor's unit; three numbers or more, and words, are levels of an orthogonal array
    design : {"composite", "factorial", "L4", "L8", "L9", "L12", "L16", "L18", "L27"}
        central composite; all combinations of two levels; or one of Taguchi's orthogonal arrays
    alpha, axial_repeats, half, blocks
        as for :func:`central_composite`; a factorial has 1, 2 or 4 blocks, an array as many as a free column has levels
    centre : int, optional
        edges at the centre; 4 unless given, none of an array
    repeats : int
        edges at each point of a factorial or an array
    duration : (minutes,) or (shortest, longest), optional
        time in cut of each edge; two numbers make it a factor of the design, t
    readings : int
        readings of an edge, at equal steps to the end of its duration; more than one needs a duration
    measure : sequence of str
        symbols of empty columns to fill in, such as VB and Fc
    process : {"turning", "milling", "drilling"}, optional
        checks the names of the factors, and adds the settings of the machine (n, fm) where they follow
    constants : mapping, optional
        what is the same in all tests: ``{"Dc": 20, "z": 4}``
    seed : int
        of the run order

    Returns
    -------
    DataFrame: run, edge, block (if several), point, ``<factor>_coded``, the factors, the settings of the machine, t and
    the empty columns. ``attrs``: units, and notes: sentences on aliases, blocks, repeats, time and power.

    Raises
    ------
    UsageError
        for anything that cannot be planned

    Examples
    --------
    >>> plan = plan_tests({"V": (100, 200), "f": (0.1, 0.4)}, design="factorial", duration=(12,), readings=3)
    >>> len(plan), plan["edge"].nunique(), sorted(plan["t"].unique().tolist())
    (24, 8, [4.0, 8.0, 12.0])
    """
    assumed = _assumed((*ranges, *(constants or ())))
    ranges, fixed = _by_symbol(ranges), _by_symbol(constants or {})
    _check(ranges, design, process, fixed, measure)
    _check_times(ranges, duration, readings)
    varied = {**ranges, **({"t": duration} if duration is not None and len(duration) > 1 else {})}
    if design == "composite":
        if repeats != 1:
            raise UsageError(f"repeats {repeats}: a composite design repeats its centre and axial points; set those.")
        ends = {name: two_ends(name, levels) for name, levels in varied.items()}
        plan = central_composite(
            ends, alpha=alpha, centre=4 if centre is None else centre, axial_repeats=axial_repeats, half=half,
            blocks=blocks, seed=seed, digits=DIGITS,
        )  # fmt: skip
    elif design == "factorial":
        plan = _factorial(varied, 4 if centre is None else centre, half, repeats, blocks, seed)
    else:
        plan = _array(varied, design, centre or 0, half, repeats, blocks, seed)
    notes, plan = plan.attrs["notes"], plan.assign(**{name: x for name, x in fixed.items() if name not in plan})
    if process is not None or fixed:
        plan = plan.assign(**machine_settings(plan, process))
    if duration is not None and len(duration) == 1:
        plan["t"] = float(duration[0])
    loads = (ROLES[name] for name in varied if name in ROLES and ROLES[name].kind in ("load", "surface"))
    measured = (f"{role.symbol} is the {role.quantity}, which tests measure and do not set." for role in loads)
    doubts = _doubts(plan, process, (*varied, *fixed, "t"))
    notes = (*assumed, *doubts, *notes, *_effort(plan, process), *measured)
    plan = _with_readings(plan, readings).assign(**dict.fromkeys(measure, np.nan))
    plan.attrs = {"notes": notes, "units": _units(plan)}
    return plan


def _by_symbol(given: Mapping[str, _T]) -> dict[str, _T]:
    """What is given for settings, by their symbols."""
    named = [setting_named(name) for name in given]
    if twice := [symbol for symbol in named if named.count(symbol) > 1]:
        both = " and ".join(name for name in given if setting_named(name) == twice[0])
        raise UsageError(f"{both} are one quantity, {ROLES[twice[0]].quantity}: give one of them.")
    return dict(zip(named, given.values(), strict=True))


def _assumed(names: Sequence[str]) -> list[str]:
    """Sentences on names that are other names of a setting."""
    read = {name: ROLES[setting_named(name)] for name in names if setting_named(name) != name}
    return [f"{name} is read as {role.symbol} ({role.quantity}, {role.unit})." for name, role in read.items()]


def _factorial(
    ranges: Mapping[str, Levels], middle: int, half: bool, repeats: int, blocks: int, seed: int
) -> pd.DataFrame:
    """Edges of a two-level factorial with centre points."""
    ends, names = {name: two_ends(name, levels) for name, levels in ranges.items()}, list(ranges)
    corners = two_level(len(ends), half=half)
    number, confounded = factorial_blocks(corners, blocks)
    of_centre = np.arange(middle) * blocks // max(middle, 1)
    coded = np.vstack([np.repeat(corners, repeats, axis=0), np.zeros((middle, len(ends)))])
    kind = np.repeat(["factorial", "centre"], [len(corners) * repeats, middle])
    points = DesignPoints(coded, kind, np.concatenate([np.repeat(number, repeats), of_centre]), confounded)
    notes = [f"Half of the {2 ** len(ends)} points: {names[-1]} = {'·'.join(names[:-1])}."] if half else []
    notes += [*alias_sentences(corners, names), *block_sentences(points, names), *repeat_sentences(coded)]
    if middle:
        notes.append("The centre edges show whether there is curvature, but not of which factor.")
    return planned_edges(points, ends, span=1.0, seed=seed, digits=DIGITS, notes=notes)


def _array(
    ranges: Mapping[str, Levels], design: str, middle: int, half: bool, repeats: int, blocks: int, seed: int
) -> pd.DataFrame:
    """Edges of an orthogonal array; numbers of two ends get the geometric middle where the column has three levels."""
    if half:
        raise UsageError(f"design {design}: half is of a factorial or a composite design; leave it out.")
    table = orthogonal_array(design)
    given = {name: _levels_of(name, levels, int(table[:, -1].max()) + 1) for name, levels in ranges.items()}
    columns, of_block = array_columns(design, [len(levels) for levels in given.values()], blocks)
    chosen, names = np.repeat(table[:, columns], repeats, axis=0), list(given)
    block = np.zeros(len(chosen), dtype=np.intp) if of_block is None else np.repeat(table[:, of_block], repeats)
    points = _array_points(chosen, block, [len(levels) for levels in given.values()], middle, repeats)
    where = ", ".join(f"{name} in column {c + 1}" for name, c in zip(names, columns, strict=True))
    notes = [f"{design}: {where}{'' if of_block is None else f', blocks in column {of_block + 1}'}."]
    notes += [*alias_sentences(points.coded[: len(chosen)], names), *block_sentences(points, names)]
    words = _words(given, middle)
    ends = {name: (1.0, 2.0) if name in words else _numbers(levels) for name, levels in given.items()}
    plan = planned_edges(points, ends, span=1.0, seed=seed, digits=None)
    order = np.array([int(label[1:]) - 1 for label in plan["edge"]], dtype=np.intp)
    for j, (name, levels) in enumerate(given.items()):
        plan = _with_levels(plan, name, levels, chosen[:, j], order)
    plan.attrs["notes"] = (*notes, *repeat_sentences(points.coded))
    return plan


def _array_points(chosen: Ints, block: Ints, levels: Sequence[int], middle: int, repeats: int) -> DesignPoints:
    """The rows of an array coded from -1 to 1, and centre points divided among its blocks."""
    scores = 2.0 * chosen / (np.array(levels) - 1) - 1
    kind = [*(f"row {i // repeats + 1}" for i in range(len(chosen))), *["centre"] * middle]
    of_centre = np.arange(middle) * (int(block.max()) + 1) // max(middle, 1)
    coded = np.vstack([scores, np.zeros((middle, len(levels)))])
    number = np.concatenate([block, of_centre]).astype(np.intp)
    return DesignPoints(coded, np.array(kind), number, products_of_blocks(scores, block))


def _words(given: Mapping[str, Sequence[float] | Sequence[str]], middle: int) -> list[str]:
    """Factors whose levels are words, which have no middle."""
    words = [name for name, levels in given.items() if isinstance(levels[0], str)]
    if middle and words:
        between = " and ".join(map(str, given[words[0]]))
        raise UsageError(f"centre {middle}: {words[0]} has no middle between {between}.")
    return words


def _with_levels(
    plan: pd.DataFrame,
    name: str,
    levels: Sequence[float] | Sequence[str],
    at: Ints,
    order: Ints,
) -> pd.DataFrame:
    """The plan with the levels of one factor; words have no coded column."""
    if isinstance(levels[0], str):
        taken = np.array(levels, dtype=object)[at[order]]
        return plan.drop(columns=f"{name}_coded").assign(**{name: taken})
    low, high = _numbers(levels)
    values = np.append(np.array(levels, dtype=float), round_significant(np.sqrt(low * high), DIGITS))
    here = values[np.where(order < len(at), at[np.minimum(order, len(at) - 1)], len(levels))]
    coded = np.log(here * here / (low * high)) / np.log(high / low)
    return plan.assign(**{name: here, f"{name}_coded": coded})


def _numbers(levels: Sequence[float] | Sequence[str]) -> tuple[float, float]:
    numbers = [float(x) for x in levels]
    return min(numbers), max(numbers)


def _levels_of(name: str, levels: Levels, most: int) -> Sequence[float] | Sequence[str]:
    """Levels of a factor of an array: as given, or two ends and their geometric middle."""
    if len(levels) == 2 and not isinstance(levels[0], str) and most == 3 and isinstance(levels, tuple):
        low, high = two_ends(name, levels)
        return (low, float(round_significant(np.sqrt(low * high), DIGITS)), high)
    if len(set(levels)) < len(levels) or len(levels) not in (2, 3):
        raise UsageError(f"{name}: {', '.join(map(str, levels))}; an array takes two or three different levels.")
    if not isinstance(levels[0], str) and not all(map(_is_positive, map(float, levels))):
        raise UsageError(f"{name}: {', '.join(map(str, levels))}; levels are numbers above zero, or words.")
    return levels


def _check(
    ranges: Mapping[str, Levels], design: str, process: str | None, constants: Mapping[str, float],
    measure: Sequence[str],
) -> None:  # fmt: skip
    if design not in DESIGNS:
        raise UsageError(f"design {design!r}: it is one of {', '.join(DESIGNS)}.")
    if process is not None:
        _check_process(ranges, process, constants)
    if not ranges or not all(hasattr(levels, "__len__") for levels in ranges.values()):
        raise UsageError('no range: name each factor with its range, such as {"V": (50, 200)}.')
    twice = [name for name in (*constants, *measure) if name in ranges or name in RESERVED]
    if twice:
        raise UsageError(f"{twice[0]} is a factor or a column of the plan already; leave it out.")
    for name, value in constants.items():
        if not _is_positive(value) or (name == "z" and value != round(value)):
            what = "a number of teeth is whole and" if name == "z" else "a constant of the process is"
            raise UsageError(f"{name} {value:g}: {what} above zero.")
    given = numbers_of({**ranges, **{name: (value,) for name, value in constants.items()}})
    check_settings(given, process)


def numbers_of(ranges: Mapping[str, Levels]) -> dict[str, Array]:
    """Levels of the factors that have numbers, in the order of the factors.

    >>> numbers_of({"V": (80, 200), "coolant": ["dry", "flood"]})
    {'V': array([ 80., 200.])}
    """
    words = [name for name, levels in ranges.items() if any(isinstance(level, str) for level in levels)]
    return {name: np.array(levels, dtype=float) for name, levels in ranges.items() if name not in words}


def _check_times(ranges: Mapping[str, Levels], duration: tuple[float, ...] | None, readings: int) -> None:
    if "t" in ranges:
        raise UsageError("t is the time in cut: give its range as the duration.")
    if duration is not None and not all(map(_is_positive, duration)):
        raise UsageError(f"duration {', '.join(f'{x:g}' for x in duration)}: minutes in cut are above zero.")
    if not 1 <= readings <= MOST_READINGS:
        raise UsageError(f"readings {readings}: give 1 to {MOST_READINGS} of an edge.")
    if readings > 1 and duration is None:
        raise UsageError(f"readings {readings}: several readings need the duration of an edge, such as 12 min.")


def _check_process(ranges: Mapping[str, Levels], process: str, constants: Mapping[str, float]) -> None:
    known = PROCESSES.get(process)
    if known is None:
        raise UsageError(f"process {process!r}: plans are made for {', '.join(PROCESSES)}.")
    quantities = ", ".join(f"{name} ({ROLES[name].quantity}, {ROLES[name].unit})" for name in known.usual)
    if not ranges or not all(hasattr(levels, "__len__") for levels in ranges.values()):
        example = " ".join(f"--range {name}=low:high" for name in known.usual)
        raise UsageError(f"a plan of {process} varies {quantities}: give {example}.")
    strange = [name for name in ranges if name in ROLES and ROLES[name].kind != "label" and name not in known.factors]
    strange += [name for name in constants if name in ROLES and name not in known.constants]
    if strange:
        raise UsageError(
            f"{strange[0]} ({ROLES[strange[0]].quantity}) is not set in {process}; its factors are "
            f"{', '.join(known.factors)}, its constants {', '.join(known.constants)}."
        )


def _with_readings(plan: pd.DataFrame, readings: int) -> pd.DataFrame:
    """A row for each reading, at equal steps of the duration."""
    if readings == 1:
        return plan
    rows = plan.loc[plan.index.repeat(readings)].reset_index(drop=True)
    share = np.tile(np.arange(1, readings + 1) / readings, len(plan))
    rows["t"] = round_significant(rows["t"].to_numpy(dtype=float) * share, DIGITS)
    return rows.drop(columns="t_coded", errors="ignore")


def _effort(plan: pd.DataFrame, process: str | None) -> list[str]:
    """Edges, minutes and chips of the plan, and the power at its heaviest edge."""
    out = []
    time = plan["t"].to_numpy(dtype=float) if "t" in plan else None
    if time is not None:
        each = f"{time.min():.3g}" if np.ptp(time) == 0 else f"{time.min():.3g} to {time.max():.3g}"
        out.append(f"{len(plan)} edges, {time.sum():.4g} min in cut, {each} min each.")
        if np.ptp(time) > 0:
            out.append("Stop an edge that reaches the wear criterion before its time, and write the time reached.")
    rate = removal_rate(plan, process)
    if rate is None:
        return out
    if time is not None:
        litres = float(rate @ time) / 1e6
        out.append(f"Chips: {_two(litres)} dm3 ({_two(7.85 * litres)} kg if the work is steel).")
    at = int(np.argmax(rate))
    power = _two(float(rate[at]) * KW)
    out.append(
        f"The heaviest edge, {plan['edge'].iloc[at]}, removes {rate[at] / 1000:.3g} cm3/min: about {power} kW, "
        f"if the specific cutting force is {STEEL:g} N/mm2 (assumed). Check machine and tool there first."
    )
    return out


def _doubts(plan: pd.DataFrame, process: str | None, given: Sequence[str]) -> list[str]:
    """Sentences on settings, and a power, that are unusual."""
    set_at = [name for name in map(str, plan) if name in ROLES and ROLES[name].kind in ("condition", "time", "other")]
    numbers = {name: plan[name].to_numpy(dtype=float) for name in set_at if is_numeric_dtype(plan[name])}
    rate = removal_rate(plan, process)
    if rate is not None and rate.max() * KW > 1:  # less is that of a small tool
        numbers["P"] = np.array([float(_two(float(rate.max()) * KW))])
    known: Any = process
    return [f"Doubt: {words}." for words in planned_doubts(numbers, known, given)]


def _two(value: float) -> str:
    """Two digits, without a power of ten."""
    return f"{float(f'{value:.2g}'):.15g}"


def _units(plan: pd.DataFrame) -> dict[str, str]:
    return {
        name: ROLES[name].unit
        for name in map(str, plan.columns)
        if name in ROLES and ROLES[name].unit not in ("", "1") and ROLES[name].kind != "label"
    }
