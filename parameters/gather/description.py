"""Description of how a data file was read, one sentence an item: kept in the parameter file, printed by the command."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.rounding import count
from ..sections.law import LawSection

if TYPE_CHECKING:
    from ...datasets import Runs
    from ...datasets.columns import ColumnUse

ROUNDED = 0.005  # in the logarithm: by which a setting differs from the product that it is rounded from
NAMED = 4  # labels of a column that are named
Labels = Callable[[str], list[str]]


def reading_notes(runs: "Runs", laws: Mapping[str, LawSection], labels: Labels | None = None) -> list[str]:
    """Columns, units, assumptions, corrections and notes of a file, and conditions that no law contains.

    Parameters
    ----------
    runs : Runs
    laws : mapping of LawSection
        By response.
    labels : callable, optional
        Different names of a column of labels, in their order, where they are known already.
    """
    columns = [column_words(runs, use, labels) for use in runs.columns if use.role is not None]
    lines = [f"{symbol}: {quantity}, {rest}" for symbol, quantity, rest in columns]
    unused = ", ".join(repr(use.header) for use in runs.columns if use.role is None)
    lines += [f"{symbol}: {quantity}, {rest}" for symbol, quantity, rest in derived_words(runs)]
    lines += [f"not used: {unused}"] if unused else []
    lines += unused_conditions(runs, laws)
    lines += [f"assumed: {sentence}" for sentence in runs.assumed]
    return [*lines, *runs.warnings, *(f"from the file: {note.lstrip('#% ')}" for note in runs.notes)]


def column_words(runs: "Runs", use: "ColumnUse", labels: Labels | None = None) -> tuple[str, str, str]:
    """Symbol and quantity of a column that has a role, and its range, or the number of its different names."""
    from ...datasets.vocabulary import ROLES

    role = ROLES[str(use.role)]
    head = f"column {use.number} {use.header!r}"
    if role.kind == "label" or role.symbol not in runs.data:
        names = (labels or _different(runs))(role.symbol) if runs.has(role.symbol) else []
        shown = ", ".join(names[:NAMED]) + (", ..." if len(names) > NAMED else "")
        values = count(len(names), "value")
        return role.symbol, role.quantity, f"{head}: {values} ({shown})"
    unit = f", converted from {use.unit}" if use.converted else ""
    return role.symbol, role.quantity, f"{head}: {_range(runs, role.symbol, unit)}"


def _range(runs: "Runs", symbol: str, converted: str = "") -> str:
    """Least and greatest value of a role, and how many rows lack one."""
    from ...datasets.vocabulary import ROLES

    values, unit = runs.values(symbol), ROLES[symbol].unit
    lacking = int(np.count_nonzero(np.isnan(values)))
    if lacking == len(values):
        return f"empty{converted}"
    span = f"{np.fmin.reduce(values):.4g} to {np.fmax.reduce(values):.4g}{'' if unit == '1' else ' ' + unit}"
    more = _bounds(runs, symbol)
    lacking -= sum(more.values())
    parts = [span + converted, *(f"{n} {words}" for words, n in more.items() if n)]
    return ", ".join([*parts, *([f"{lacking} missing"] if lacking else [])])


def _bounds(runs: "Runs", symbol: str) -> dict[str, int]:
    """Number of tool lives that are known by a bound alone, by the kind of the bound; empty for other quantities."""
    from ...datasets.draft import mark_column

    column = mark_column(symbol)
    if symbol != "T" or column not in runs.data:
        return {}
    marks = [str(mark) for mark in runs.data[column]]
    found: dict[str, int] = {}
    for sign in "><":
        times = [float(mark[1:]) for mark in marks if mark[:1] == sign]
        if times:
            words = "shorter than" if sign == "<" else f"run-out{'s' if len(times) > 1 else ''} of at least"
            low, high = min(times), max(times)
            span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            found[f"{words} {span} {runs.units.get(symbol, '')}".rstrip()] = len(times)
    return found


def derived_words(runs: "Runs") -> list[tuple[str, str, str]]:
    """Symbol, quantity and range of each quantity that was computed from columns, as of `column_words`."""
    from ...datasets.vocabulary import ROLES

    roles = dict.fromkeys(one.role for one in runs.derived if one.role in runs.data)
    return [(role, ROLES[role].quantity, f"computed: {_range(runs, role)}") for role in roles]


def unused_conditions(runs: "Runs", laws: Mapping[str, LawSection]) -> list[str]:
    """Conditions that vary in the file and are in none of its laws, directly or through others, one sentence each."""
    from ...datasets.vocabulary import ROLES

    taken = {law.response for law in laws.values()}.union(
        *({f.symbol for f in law.factors} | {item.factor for item in law.left_out} for law in laws.values())
    )
    contained = _contained(runs, taken)
    out = []
    for use in runs.columns:
        role = ROLES.get(use.role or "")
        if role is None or role.kind != "condition" or role.symbol in contained:
            continue
        values = runs.values(role.symbol)
        if len(values) and np.fmin.reduce(values) < np.fmax.reduce(values) and not _is_product(runs, values, taken):
            one = next(iter(laws), "R")
            out.append(
                f'{role.symbol}, {role.quantity}, varies but is in no law: --law "{one} ~ + {role.symbol}" adds it.'
            )
    return out


def _is_product(runs: "Runs", values: Array, taken: set[str]) -> bool:
    """Whether values are a product of powers of settings in the laws, as n is of V at one diameter."""
    from ...datasets.vocabulary import ROLES

    settings = [role for role in taken if role in ROLES and ROLES[role].kind == "condition" and runs.has(role)]
    table = np.column_stack([values, *(runs.values(role) for role in settings)])
    table = np.unique(table[(table > 0).all(axis=1)], axis=0)
    if len(table) < len(settings) + 3:
        return False
    y, X = np.log(table[:, 0]), np.column_stack([np.ones(len(table)), np.log(table[:, 1:])])
    return bool(np.abs(y - X @ np.linalg.lstsq(X, y, rcond=None)[0]).max() < ROUNDED)


def _contained(runs: "Runs", taken: set[str]) -> set[str]:
    """Symbols in the laws, and those that follow from these: n from V and D, fm from f and n."""
    from ...datasets.derived.rules import RULES
    from ...datasets.vocabulary import ROLES

    seen = [frozenset((one.role, *one.inputs)) for one in runs.derived]
    seen += [frozenset((rule.role, *rule.inputs)) for rule in RULES if all(map(runs.has, (rule.role, *rule.inputs)))]
    found, before = set(taken), -1
    while len(found) > before:
        before = len(found)
        for members in seen:
            conditions = {symbol for symbol in members if ROLES[symbol].kind == "condition"}
            if len(conditions - found) == 1:
                found |= conditions
    return found


def _different(runs: "Runs") -> Labels:
    return lambda symbol: [str(v) for v in dict.fromkeys(runs.labels(symbol)) if v]
