"""Description of how a data file was read, one sentence an item: kept in the parameter file, printed by the command."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..sections.law import LawSection

if TYPE_CHECKING:
    from ...datasets import Runs
    from ...datasets.columns import ColumnUse

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
        count = f"{len(names)} value{'' if len(names) == 1 else 's'}"
        return role.symbol, role.quantity, f"{head}: {count} ({shown})"
    values = runs.values(role.symbol)
    lacking = int(np.count_nonzero(np.isnan(values)))
    known = lacking < len(values)
    span = f"{np.fmin.reduce(values):.4g} to {np.fmax.reduce(values):.4g} {role.unit}" if known else "empty"
    missing = f", {lacking} missing" if lacking and known else ""
    unit = f", converted from {use.unit}" if use.converted else ""
    return role.symbol, role.quantity, f"{head}: {span}{unit}{missing}"


def unused_conditions(runs: "Runs", laws: Mapping[str, LawSection]) -> list[str]:
    """Conditions that vary in the file and are in none of its laws, one sentence each."""
    from ...datasets.vocabulary import ROLES
    from ...fit.defaults import CONDITIONS

    taken = {law.response for law in laws.values()}.union(
        *({f.symbol for f in law.factors} | {item.factor for item in law.left_out} for law in laws.values())
    )
    out = []
    for use in runs.columns:
        role = ROLES.get(use.role or "")
        if role is None or role.kind != "condition" or role.symbol in taken:
            continue
        values = runs.values(role.symbol)
        if len(values) and np.fmin.reduce(values) < np.fmax.reduce(values):
            remedy = f' To use it as the feed f, give --map "f={use.name}" --unit f=mm/rev.'
            remedy = remedy if role.symbol == "fz" or (role.symbol == "fm" and not use.unit) else ""
            out.append(
                f"{role.symbol}, {role.quantity}, varies but is in no law: laws are fitted on "
                f"{', '.join(CONDITIONS)}.{remedy}"
            )
    return out


def _different(runs: "Runs") -> Labels:
    return lambda symbol: [str(v) for v in dict.fromkeys(runs.labels(symbol)) if v]
