"""Columns that vary between tests and are not used, and columns whose names are exchanged, seen from the edges."""

import re

import numpy as np
from numpy.typing import NDArray

from .doubts import Doubt
from .draft import Draft
from .headers import parse_header
from .options import Process, ReadOptions
from .quantities import table_process
from .ranges import plausible
from .stray_values import listed
from .tables import Column
from .units import canonical, same_dimension
from .vocabulary import ROLES, understood_unit

SAMPLE = 20000  # rows looked at
FEWEST = 6
MOST_LEVELS = 7
MOST_EDGES = 0.8  # share of the edges that decides

Array = NDArray[np.float64]
_FACTORS = (("V", ("V", "n")), ("f", ("f", "fz", "fm")), ("d", ("d", "ae")))  # a factor, and what stands for it
_OTHER_WORDS = re.compile(
    r"temp|hard|härte|dur(?:eté|eza)|press|druck|angle|winkel|radi|cool|kühl|noise|vib|date|datum|day|no\.?$|nr\.?$|"
    r"id$|num|count|anzahl|index|repl|pass|hole|width|height|length|länge|humid|sd$|std|mean|time|zeit|cost|sample",
    re.IGNORECASE,
)


def check_unused(draft: Draft, options: ReadOptions) -> None:
    """Doubt columns that resemble a condition of the tests and have no role."""
    process = table_process(draft, options)
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role is not None or not column.is_numeric or column.bad or len(draft.lines) < FEWEST:
            continue
        values = np.asarray(column.values, dtype=float)[:SAMPLE]
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) < 2 or np.isfinite(values).sum() < FEWEST:
            continue
        role = _named_like(draft, column, use.suggestion, options)
        if role is None and _is_set(draft, values, levels) and not _OTHER_WORDS.search(use.name):
            role = _valued_like(draft, column, levels, process, options)
        if role is not None:
            sentence = (
                f"column {column.name!r} varies between the tests ({listed(levels)}) and is not used; "
                f"it may be the {ROLES[role].quantity} {role}"
            )
            draft.doubts.append(Doubt((column.name,), sentence, f'--map "{role}=col{column.number}"'))


def _free(draft: Draft, role: str, options: ReadOptions) -> bool:
    """Whether a role stands open: no column has it, none stands for it, and the user did not refuse it."""
    equal = next((those for factor, those in _FACTORS if factor == role), (role,))
    return not any(one in draft.data or one in options.map or one in options.constants for one in equal)


def _named_like(draft: Draft, column: Column, suggestion: str | None, options: ReadOptions) -> str | None:
    """The condition that the name or the unit of a column resembles."""
    if suggestion is not None and ROLES[suggestion].kind in ("condition", "time") and _free(draft, suggestion, options):
        return suggestion
    text = column.unit_cell or parse_header(column.name).unit_text
    for role in ("V", "f", "fz", "fm", "n", "t"):
        unit = canonical(text) if text else None
        if unit is not None and _free(draft, role, options) and same_dimension(unit, ROLES[role].unit):
            return role
    return None


def _is_set(draft: Draft, values: Array, levels: Array) -> bool:
    """Whether values were set by the plan of tests: few repeated levels, or constant in each edge; no numbering."""
    known = values[np.isfinite(values)]
    whole = np.all(levels == np.round(levels))
    if whole and len(levels) > 1 and np.all(np.diff(levels) == 1) and levels[0] in (0, 1):
        return False
    if len(levels) <= MOST_LEVELS and np.unique(known, return_counts=True)[1].min() >= 2:
        return not _repeats_another(draft, values)
    varies = _varying_edges(draft, values)
    return varies is not None and varies == 0 and not _repeats_another(draft, values)


def _repeats_another(draft: Draft, values: Array) -> bool:
    """Whether a column holds the levels of a used one under other numbers."""
    for use in draft.uses:
        if use.role is None or use.role not in draft.data:
            continue
        other = draft.data[use.role][:SAMPLE]
        code = np.unique(other.astype(str) if other.dtype == object else other, return_inverse=True)[1]
        own = np.unique(values, return_inverse=True)[1]
        pairs = len(np.unique(own.astype(np.int64) * (len(code) + 1) + code))
        if pairs == len(np.unique(own)) == len(np.unique(code)) and ROLES[use.role].kind != "label":
            return True
    return False


def _valued_like(
    draft: Draft, column: Column, levels: Array, process: Process | None, options: ReadOptions
) -> str | None:
    """The missing condition in whose usual range all levels lie; a column in a unit of another kind is none."""
    text = column.unit_cell or parse_header(column.name).unit_text
    for role, _ in _FACTORS:
        unit = understood_unit(role, text) if text else None
        if unit is not None and unit != "1" and not same_dimension(unit, ROLES[role].unit):
            continue
        ranges = plausible(role, process)
        if ranges and _free(draft, role, options) and ranges.usual[0] <= levels[0] and levels[-1] <= ranges.usual[1]:
            return role
    return None


def check_order(draft: Draft, options: ReadOptions) -> None:
    """Doubt a condition that varies within the edges while a result is constant in each: exchanged names."""
    shares = {}
    for use in draft.uses:
        if use.role and use.role not in options.ranges and ROLES[use.role].unit:
            share = _varying_edges(draft, np.asarray(draft.data[use.role], dtype=float)[:SAMPLE])
            if share is None:
                return
            shares[use.role] = (share, use.number)
    moving = [role for role, (share, _) in shares.items() if ROLES[role].kind == "condition" and share > MOST_EDGES]
    still = [role for role, (share, _) in shares.items() if ROLES[role].kind != "condition" and share < 1 - MOST_EDGES]
    for role in moving:
        for result in (one for one in still if ROLES[one].kind in ("time", "wear", "load", "surface")):
            remedy = f'--map "{role}=col{shares[result][1]}" --map "{result}=col{shares[role][1]}"'
            sentence = (
                f"{role} varies within the edges and {result} is constant in each: the two columns may be exchanged"
            )
            draft.doubts.append(Doubt((role, result), sentence, remedy))


def _varying_edges(draft: Draft, values: Array) -> float | None:
    """Share of the edges of three rows and more within which a column varies; None where fewer than three are known."""
    if "edge" not in draft.data:
        return None
    labels = draft.data["edge"][:SAMPLE]
    known = np.isfinite(values) & np.array([str(label) != "" for label in labels])
    code = np.unique(labels[known].astype(str), return_inverse=True)[1]
    if not code.size:
        return None
    order = np.lexsort((values[known], code))
    sizes = np.bincount(code)
    ends = np.cumsum(sizes)
    ordered = values[known][order]
    enough = sizes >= 3
    if enough.sum() < 3:
        return None
    spread = ordered[ends - 1] - ordered[ends - sizes]
    return float(np.mean(spread[enough] > 1e-9 * np.abs(ordered[ends - 1][enough])))
