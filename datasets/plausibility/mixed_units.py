"""Edges whose speed, feed or depth is in another unit than that of the others, found by their wear or force."""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.rounding import format_decimal, listed
from ..doubts import Doubt
from ..draft import Draft, correction, numbers_of
from ..vocabulary import ROLES
from .unit_shifts import (
    CLOSE,
    EVIDENCE,
    MINORITY,
    RATIOS,
    isolated,
    minorities,
    planned,
    single_evidence,
    split_evidence,
)

RESPONSES = {
    ("AW", "VB"): ("V", "f", "d"),
    ("Fc", "P", "Fxz", "F", "Fz", "Fx", "Fy", "Ff", "Fp"): ("f", "d"),  # forces hardly depend on V
}
CHIP = {"f": 0.75, "d": 1.0}  # usual exponents of a force: Kienzle's 1 - mc and 1
DIAMETER = {"d": {2.0: "on the diameter and on the radius"}}  # no gap shows it: found by the force alone
NEAR_RATIO = 0.3  # of the logarithm of a force
FEWEST = 8  # edges
SPARE = 3  # edges beyond the coefficients
EXACT = 1e-10  # of the total sum of squares: residuals without scatter decide nothing
MOST_ROWS = 20_000
LISTED = 8


@dataclass(frozen=True, slots=True)
class _Shift:
    """Some edges moved by the ratio of two units in one condition."""

    role: str
    edges: Flags
    factor: float


@dataclass(frozen=True, slots=True)
class _Tests:
    """Rows with conditions, and the logarithms of the conditions of each edge, shape (edges,)."""

    good: Flags
    code: Ints
    count: Array
    first: Ints
    settings: dict[str, Array]
    others: Array  # one, and indicators of tool and work, shape (edges, k)


def check_mixed_units(draft: Draft) -> None:
    """Doubt a condition of some edges that another unit brings to agree with the response of all others.

    Edges beyond a gap in one condition are moved by the ratio of two units; the doubt is raised where the
    regression of the edges' mean response then leaves much less. Residuals alone do not show such edges: by their
    leverage the exponent follows them.
    """
    measured = {use.role for use in draft.uses}
    doubted = {role for doubt in draft.doubts for role in doubt.columns}
    asked = [(next((role for role in group if role in measured), ""), roles) for group, roles in RESPONSES.items()]
    if not any(response for response, _ in asked):
        return
    if len(draft.lines) > MOST_ROWS:
        draft.assumed.append(
            f"not checked, since the table has more than {MOST_ROWS} rows: edges in another unit than the others, by "
            "their wear or force"
        )
        return
    numbers = draft.numbers()
    tests = _tests(draft, numbers)
    if tests is None:
        return
    best: tuple[float, str, list[_Shift]] = (EVIDENCE, "", [])
    shifts = [
        _Shift(role, *one)
        for role, x in tests.settings.items()
        if role not in doubted
        for one in minorities(x, RATIOS[role])
    ]
    for response, roles in asked:
        if not response:
            continue
        tried = [one for one in shifts if one.role in roles]
        level = _at_one_time(tests, numbers[response], numbers.get("t"))
        if ROLES[response].kind == "load" and response != "P":
            tried += [one for one in _by_force(tests, level) if one.role not in doubted]
        if tried:
            evidence = _evidence(tests, tried, level)
            if (most := float(evidence.max())) > best[0]:
                first = tried[int(evidence.argmax())]
                near = np.flatnonzero(evidence > max(EVIDENCE, most - CLOSE))
                order = near[np.argsort(-evidence[near])]
                best = most, response, [tried[k] for k in order if np.array_equal(tried[k].edges, first.edges)]
    if best[2]:
        draft.doubts.append(_doubt(draft, tests, best[1], best[2]))


def _tests(draft: Draft, numbers: dict[str, Array]) -> _Tests | None:
    """The edges, or rows of the same conditions where there are none; None where they are too few."""
    settings = {role: numbers[role] for role in RATIOS if role in numbers}
    good = np.ones(len(draft.lines), dtype=bool)
    for x in settings.values():
        good &= x > 0
    labels = [draft.codes(role)[0][good] for role in ("edge", "tool", "work") if role in draft.data]
    kinds = labels[1:] if "edge" in draft.data else labels
    if "edge" not in draft.data:
        labels = [*labels, *(np.unique(x[good], return_inverse=True)[1] for x in settings.values())]
    code = np.zeros(np.count_nonzero(good), dtype=np.intp)
    for one in labels:
        if one.size and one.any():
            code = code * (int(one.max()) + 2) + one + 1
    _, first, code, count = np.unique(code, return_index=True, return_inverse=True, return_counts=True)
    if len(count) < FEWEST:
        return None
    means = {role: np.bincount(code, np.log(x[good])) / count for role, x in settings.items()}
    varying = {role: x for role, x in means.items() if x.max() - x.min() > 1e-9}
    columns = [np.ones(len(count))]
    for kind in kinds:
        levels = np.unique(kind[first])
        if 1 < len(levels) <= len(count) // 4:
            columns += [(kind[first] == level).astype(float) for level in levels[1:]]
    if not varying or len(count) < len(columns) + len(varying) + SPARE:
        return None
    return _Tests(good, code, count.astype(float), first, varying, np.column_stack(columns))


def _at_one_time(tests: _Tests, response: Array, time: Array | None) -> Array:
    """Mean logarithm of the response of each edge at ln t = 0, by the slope within edges; NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        y = np.log(response[tests.good])
        t = np.zeros(len(y)) if time is None else np.log(time[tests.good])
    known = np.isfinite(y) & np.isfinite(t)
    code, y, t = tests.code[known], y[known], t[known]
    with np.errstate(invalid="ignore"):
        count = np.bincount(code, minlength=len(tests.count))
        y_mean = np.bincount(code, y, len(count)) / count
        t_mean = np.bincount(code, t, len(count)) / count
    within = t - t_mean[code]
    spread = float(within @ within)
    slope = float(within @ (y - y_mean[code])) / spread if spread > 0 else 0.0
    return np.asarray(y_mean - slope * t_mean)


def _by_force(tests: _Tests, level: Array) -> list[_Shift]:
    """Minorities whose force is off, for their feed and depth, by what a ratio of units makes of it."""
    if set(CHIP) - set(tests.settings) or not np.isfinite(level).any():
        return []
    off = level - sum(power * tests.settings[role] for role, power in CHIP.items())
    off = off - np.nanmedian(off)
    found = []
    for role, power in CHIP.items():
        for factor in (*RATIOS[role], *DIAMETER.get(role, ())):
            for move in (np.log(factor), -np.log(factor)):
                edges = np.abs(off - power * move) < NEAR_RATIO * power
                if 0 < np.count_nonzero(edges) <= MINORITY * len(off):
                    found.append(_Shift(role, edges, float(np.exp(move))))
    return found


def _evidence(tests: _Tests, shifts: list[_Shift], y: Array) -> Array:
    """The statistic n ln(RSS0/RSS1) of each shift, shape (shifts,)."""
    known = np.isfinite(y)
    y, n = y[known], int(np.count_nonzero(known))
    out = np.zeros(len(shifts))
    if n < tests.others.shape[1] + len(tests.settings) + SPARE or n < FEWEST:
        return out
    for role in dict.fromkeys(one.role for one in shifts):
        these = [k for k, one in enumerate(shifts) if one.role == role]
        others = [tests.others, *(x[:, None] for name, x in tests.settings.items() if name != role)]
        moves = np.column_stack([shifts[k].edges[known] * np.log(shifts[k].factor) for k in these])
        x, rest = tests.settings[role][known], np.column_stack(others)[known]
        everything = np.column_stack([x, rest])
        left = y - everything @ np.linalg.lstsq(everything, y, rcond=None)[0]
        if float(left @ left) > EXACT * float(np.sum((y - y.mean()) ** 2)):
            out[these], by_square = split_evidence(y, rest, x, moves, n, (x - x.mean()) ** 2)
            by_one = single_evidence(y, everything, slice(None))[0]
            for k in these:  # a curved law or a wrong edge, which the checks of the law find
                moved = shifts[k].edges[known]
                one_of_several = by_one > out[k] and np.count_nonzero(moved) > 1
                other_cause = by_square > out[k] + CLOSE or one_of_several or planned(x, rest[:, 1:], moved)
                if other_cause and not isolated(x, moved):
                    out[k] = 0.0
    return out


def _doubt(draft: Draft, tests: _Tests, response: str, shifts: list[_Shift]) -> Doubt:
    places = np.flatnonzero(tests.good)[tests.first[shifts[0].edges]]
    with_edges = "edge" in draft.data
    names = [str(draft.data["edge"][row]) if with_edges else str(draft.lines[row]) for row in places]
    named = listed(names, LISTED)
    ways = []
    for one in shifts:
        x = np.exp(tests.settings[one.role][one.edges])
        low, high = format_decimal(float(x.min())), format_decimal(float(x.max()))
        values = low if low == high else f"{low} to {high}"
        ratio = max(one.factor, 1 / one.factor)
        way = "multiplied" if one.factor > 1 else "divided"
        causes = {**RATIOS[one.role], **DIAMETER.get(one.role, {})}
        units = next(cause for known, cause in causes.items() if np.isclose(known, ratio))
        ways.append(f"{one.role} {values} {ROLES[one.role].unit} {way} by {ratio:.4g} ({units})")
    what, s = "edge" if with_edges else "line", "" if len(names) == 1 else "s"
    sentence = (
        f"{what}{s} {named}: with {', or '.join(ways)} the {response} agrees with that of the other {what}s; "
        f"check the unit of {'these' if s else 'this'} {what}{s}"
    )
    rows = np.flatnonzero(tests.good)[shifts[0].edges[tests.code]]
    remedy = correction(draft, rows, shifts[0].role, shifts[0].factor) if with_edges and _certain(tests, shifts) else ""
    roles = tuple(dict.fromkeys(one.role for one in shifts))
    return Doubt(roles, sentence, remedy, lines=numbers_of(draft, rows))


def _certain(tests: _Tests, shifts: list[_Shift]) -> bool:
    """Whether a correction may be proposed: of a single edge within the design any value may be the wrong one."""
    one = shifts[0]
    alone = np.count_nonzero(one.edges) == 1 and not isolated(tests.settings[one.role], one.edges)
    return len(shifts) == 1 and not alone
