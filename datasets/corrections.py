"""Corrections of a file of tests that the user asks for: values of some rows or edges, and rows that are left out."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from ..core.arrays import Array, Flags, Ints
from ..core.errors import DataError, UsageError
from ..core.rounding import format_decimal, format_plain
from ..core.suggestions import did_you_mean
from .columns import Values
from .derived.derivation import SUMMED, derive
from .derived.rules import apply, known_of
from .draft import Draft
from .edges.assignment import settle_edges
from .edges.merged_cells import lines_text
from .edges.rows import by_edge
from .named_rows import RowsOf
from .options import ReadOptions
from .plausibility.judgement import settle_units
from .plausibility.quantities import table_process
from .plausibility.ranges import plausible
from .tables import Column
from .vocabulary import ROLES

_CHANGE = re.compile(
    r"\s*(?P<symbol>[A-Za-z]\w*)\s*(?:(?P<sign>[*/+-])\s*(?P<number>-?[\d.]+(?:[eE][+-]?\d+)?)|=\s*(?P<sum>cumulative))\s*"
)
ADDED_UP = ("t", "lc", "lf")  # quantities of which rows may hold the part of their sub-test or pass
INVERSE = {"*": "/", "/": "*", "+": "-", "-": "+"}  # signs that take a correction back
Step: TypeAlias = Literal["as written", "in its unit", "computed"]


@dataclass(frozen=True, slots=True)
class Correction:
    """One operation on a quantity of some rows: ``E07,E11:f*25.4``, ``lines 12,14-16:t-5``, ``all:VB/1000``.

    ``all:t=cumulative`` has the sign ``=`` and no number: the values of the rows of an edge are added up.

    >>> parse_correction("E07: f * 25.4")
    Correction(text='E07: f * 25.4', target='E07', symbol='f', sign='*', number=25.4)
    """

    text: str
    target: str
    symbol: str
    sign: str
    number: float

    @property
    def scales(self) -> bool:
        """Whether the values are multiplied or divided."""
        return self.sign in "*/"

    @property
    def cumulative(self) -> bool:
        """Whether the values of each edge are added up, in the order of the file."""
        return self.sign == "="

    def apply(self, values: Array) -> Array:
        """The corrected values; for a cumulative correction those of one edge, none known after an empty cell."""
        if self.cumulative:
            return np.cumsum(values)
        if self.scales:
            return values * self.number if self.sign == "*" else values / self.number
        return values + (self.number if self.sign == "+" else -self.number)


def parse_correction(text: str) -> Correction:
    """The correction that a text of ``--correct`` states.

    Raises
    ------
    UsageError
        It is not of the form ``TARGET:SYMBOL*NUMBER``, or would change nothing, or set values to zero.
    """
    target, _, change = text.rpartition(":")
    target = target.strip()
    match = _CHANGE.fullmatch(change) if target else None
    if match and match["sum"] and match["symbol"] in ADDED_UP:
        return Correction(text.strip(), target, match["symbol"], "=", 0.0)
    number = _number(match["number"] or "") if match else None
    if match is None or number is None:
        raise UsageError(
            f"--correct {text}: write TARGET:SYMBOL*NUMBER, or with / + -; the target is names of edges, lines or "
            f"all: 'E07,E11:f*25.4', 'lines 12,14-16:t-5', 'all:VB/1000'. {', '.join(ADDED_UP)} of sub-tests are added "
            "up within each edge by 'all:t=cumulative'."
        )
    reverses = number == -1 and match["sign"] == "*"
    if not (math.isfinite(number) and (number > 0 or reverses)) or (match["sign"] in "*/" and number == 1):
        raise UsageError(f"--correct {text}: {match['sign']}{match['number']} is no correction; give another number.")
    return Correction(text.strip(), target, match["symbol"], match["sign"], number)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


class Corrections:
    """Corrections and rows left out of one reading, with the rows that each of them concerns.

    Rows are found by the edges of the file as it stands, so that an edge keeps its name whatever is corrected or left
    out. A factor is applied before the units of the columns are settled, an offset in the unit of its quantity.
    """

    def __init__(self, draft: Draft, options: ReadOptions, *, judge: bool) -> None:
        self._options = options
        self._given: list[tuple[Correction, Flags]] = []
        self._words: list[str] = []
        self._out: Flags = np.zeros(len(draft.lines), dtype=bool)
        self._edges: Values | None = None
        self._groups: list[Ints] = []  # rows of each edge that a column names
        self._was: dict[str, Array] = {}  # values before they were added up
        self._rows_are_summed = False
        if options.correct or options.leave_out:
            self._find(_as_it_stands(draft, options, judge=judge))
        self._steps = {one.text: self._step(one, draft) for one, _ in self._given}

    def _find(self, trial: Draft) -> None:
        """Find the rows of each option in the file as it stands, and refuse what cannot be corrected."""
        self._edges = trial.data.get("edge")
        rows = RowsOf(trial)
        self._given = [(one, rows.of(one.target, f"--correct {one.text}"))
                       for one in map(parse_correction, self._options.correct)]  # fmt: skip
        self._rows_are_summed = any(one.equation.endswith(SUMMED) for one in trial.derived) or any(
            one.cumulative for one, _ in self._given
        )
        if any(use.role == "edge" for use in trial.uses) and "edge" in trial.data:
            edges = by_edge(trial)
            self._groups = np.split(edges.order, edges.first[1:])
        self._check(trial)
        self._find_left_out(trial, rows)

    def _find_left_out(self, trial: Draft, rows: RowsOf) -> None:
        """Find the rows that are left out, and refuse where none is left, or none of a correction."""
        for target in self._options.leave_out:
            found = rows.of(target, f"--leave-out {target}")
            self._words.append(_left_out(trial, target, found))
            self._out |= found
        if len(self._out) and self._out.all():
            raise UsageError(f"--leave-out {' '.join(self._options.leave_out)}: no row is left.")
        for one, found in self._given:
            if not (found & ~self._out).any():
                raise UsageError(f"--correct {one.text}: these rows are left out; give one of the two options.")

    def apply(self, draft: Draft, step: Step) -> None:
        """Apply the corrections of a step; the last one also computes what follows anew, and states all of them."""
        for one, rows in self._given:
            if self._steps[one.text] == step and one.cumulative:
                self._was[one.text] = np.array(draft.data[one.symbol], dtype=float)
                draft.data[one.symbol] = _added_up(one, self._was[one.text], rows, self._groups)
            elif self._steps[one.text] == step:
                _apply(draft, one, rows, as_written=step == "as written" and one.symbol not in self._options.ranges)
        if step == "computed":
            _compute_anew(draft, self._options, {one.symbol for one, _ in self._given if self._steps[one.text] == step})
            self._state(draft)
        self._leave_out(draft, step)

    def _state(self, draft: Draft) -> None:
        """State all corrections, and refuse those whose result cannot be."""
        for one, rows in self._given:
            _refuse_impossible(draft, self._options, one, rows)
        sentences = (_sentence(draft, one, rows, self._was.get(one.text)) for one, rows in self._given)
        draft.assumed[:0] = [*sentences, *self._words]

    def _leave_out(self, draft: Draft, step: Step) -> None:
        """Remove the rows: before units are settled, or after sums along an edge are made."""
        if self._out.any() and step == ("computed" if self._rows_are_summed else "as written"):
            keep = ~self._out
            draft.keep(keep)
            self._given = [(one, rows[keep]) for one, rows in self._given]
            if self._edges is not None:
                self._edges = self._edges[keep]

    def name_edges(self, draft: Draft) -> None:
        """Give the edges the names that they have in the file as it stands."""
        if self._edges is not None:
            draft.data["edge"] = self._edges

    def _check(self, trial: Draft) -> None:
        """Refuse a quantity that is not there, and a value that is corrected twice."""
        known = [role for role in trial.data if role in ROLES and ROLES[role].unit]
        taken: dict[str, Flags] = {}
        for one, rows in self._given:
            if one.symbol not in known:
                raise UsageError(f"--correct {one.text}: {_no_such(trial, one.symbol, known)}")
            if one.cumulative:
                _refuse_sums(trial, one, rows, self._groups)
            twice = rows & taken.get(one.symbol, False)
            if twice.any():
                raise UsageError(
                    f"--correct {one.text}: {one.symbol} of {lines_text(trial.lines[twice])} is corrected twice; give "
                    "one correction of a value."
                )
            taken[one.symbol] = rows | taken.get(one.symbol, False)

    def _step(self, one: Correction, draft: Draft) -> Step:
        if one.symbol not in draft.data:
            return "computed"
        return "as written" if one.scales else "in its unit"


def _as_it_stands(draft: Draft, options: ReadOptions, *, judge: bool) -> Draft:
    """The draft with units and edges settled, without any correction."""
    trial = _copied(draft)
    if judge:
        try:
            settle_units(trial, options)
        except DataError:  # refused as it stands; the corrections may mend that
            trial = _copied(draft)
    settled = _copied(trial)
    try:
        derive(trial, options)
    except DataError:  # a computed value is refused: P of a force of reversed sign; the corrections may mend that too
        trial = settled
    if judge:
        settle_edges(trial, options)
    return trial


def _copied(draft: Draft) -> Draft:
    return Draft(
        draft.columns, draft.uses, {role: values.copy() for role, values in draft.data.items()}, dict(draft.units),
        draft.lines, draft.notes, list(draft.assumed), list(draft.warnings), list(draft.doubts), list(draft.derived),
    )  # fmt: skip


def _no_such(trial: Draft, symbol: str, known: Sequence[str]) -> str:
    """Reason why a symbol cannot be corrected, and a suggestion."""
    for use in trial.uses:
        if symbol.casefold() in (use.name.casefold(), use.header.casefold()) and use.role in known:
            return f"column {use.header!r} is {use.role}; write {use.role}."
    label = f"{symbol} holds names, not numbers. " if symbol in trial.data else f"no column has the role {symbol}. "
    return label + did_you_mean(symbol, known, names="Columns with numbers: ")


def _apply(draft: Draft, one: Correction, rows: Flags, *, as_written: bool) -> None:
    """Correct the values of a role, and with ``as_written`` the column of the file and its marked numbers."""
    old = np.asarray(draft.data[one.symbol], dtype=float)
    new = np.where(rows, one.apply(old), old)
    _refuse_negative(draft, one, rows, old, new)
    if not np.isfinite(old[rows]).any() and not as_written:
        raise UsageError(f"--correct {one.text}: {one.symbol} has no value in these rows.")
    draft.data[one.symbol] = new
    if as_written and one.scales:
        draft.columns = tuple(
            _scaled(column, rows, one) if use.role == one.symbol and column.is_numeric else column
            for column, use in zip(draft.columns, draft.uses, strict=True)
        )


def _added_up(one: Correction, values: Array, rows: Flags, groups: Sequence[Ints]) -> Array:
    """Values of the edges of some rows added up within each, in the order of the file."""
    new = values.copy()
    for group in groups:
        if rows[group].all():
            new[group] = one.apply(values[group])
    return new


def _refuse_sums(trial: Draft, one: Correction, rows: Flags, groups: Sequence[Ints]) -> None:
    """Refuse to add up what is a sum already, or rows that are not whole edges of a column of the file."""
    head = f"--correct {one.text}: "
    if any(found.role == one.symbol and found.equation.endswith(SUMMED) for found in trial.derived):
        raise UsageError(f"{head}{one.symbol} is a sum along the edge already; leave the correction out.")
    if not groups:
        raise UsageError(f"{head}no column names the cutting edges; name it with --edge COLUMN.")
    if any(rows[group].any() and not rows[group].all() for group in groups):
        raise UsageError(f"{head}some rows of an edge cannot be added up; name whole edges, or all.")


def _refuse_negative(draft: Draft, one: Correction, rows: Flags, old: Array, new: Array) -> None:
    """Refuse a result below zero, unless most of the values were."""
    wrong = np.flatnonzero((new < 0) & (old >= 0))
    reversed_sign = one.number < 0 and np.count_nonzero(old[rows] < 0) > wrong.size
    if wrong.size and not reversed_sign:
        i = int(wrong[0])
        unit = ROLES[one.symbol].unit
        raise UsageError(
            f"--correct {one.text}: {one.symbol} of line {draft.lines[i]} would be {format_plain(new[i])} {unit}, from "
            f"{format_plain(old[i])}; correct the number, or the rows."
        )


def _scaled(column: Column, rows: Flags, one: Correction) -> Column:
    """The column of the file with the numbers of some rows multiplied or divided, marked ones too."""
    values = np.asarray(column.values, dtype=float)
    marks = tuple(
        (row, replace(mark, value=float(one.apply(np.array(mark.value)))) if rows[row] else mark)
        for row, mark in column.marks
    )
    return replace(column, values=np.where(rows, one.apply(values), values), marks=marks)


def _refuse_impossible(draft: Draft, options: ReadOptions, one: Correction, rows: Flags) -> None:
    """Refuse a correction whose result no machine reaches; such cells of the file were left out before."""
    ranges = plausible(one.symbol, table_process(draft, options))
    if ranges is None or one.symbol in options.ranges:
        return
    new = np.asarray(draft.data[one.symbol], dtype=float)
    unit = ROLES[one.symbol].unit
    beyond = rows & (np.abs(new) > ranges.hard[1])
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role == one.symbol and column.is_numeric and not (beyond.any() or one.cumulative):
            new = np.where(np.isfinite(new), new, np.asarray(column.values, dtype=float))  # as written: left out
            beyond = rows & np.isnan(np.asarray(draft.data[one.symbol], dtype=float)) & np.isfinite(new)
            unit = use.unit
    if beyond.any():
        i = int(np.flatnonzero(beyond)[0])
        low, high = map(format_decimal, ranges.usual)
        value = f"{format_plain(new[i])} {unit}".rstrip()
        raise UsageError(
            f"--correct {one.text}: {one.symbol} of line {draft.lines[i]} would be {value}, which cannot be "
            f"(usual {low} to {high} {ROLES[one.symbol].unit}); correct the number, or the rows."
        )


def _compute_anew(draft: Draft, options: ReadOptions, corrected: set[str]) -> None:
    """Compute the quantities that follow from corrected ones, which were computed before them, once more."""
    if not corrected:
        return
    affected = []
    changed = set(corrected)
    for one in draft.derived:
        if changed & set(one.inputs) and one.role not in corrected and one.role in draft.data:
            changed.add(one.role)
            affected.append(one)
    for one in affected:
        if one.equation.endswith(SUMMED):
            raise UsageError(
                f"--correct: {one.role} is a sum along the edge; correct {' or '.join(one.inputs)} instead."
            )
        del draft.data[one.role]
    known = known_of(draft.data, draft.notes, options)
    apply(known, {}, [one.equation for one in affected])


def _sentence(draft: Draft, one: Correction, rows: Flags, was: Array | None) -> str:
    """Changes by a correction, with old and new values; ``was`` are the values that were added up."""
    new = np.asarray(draft.data[one.symbol], dtype=float)[rows]
    old = replace(one, sign=INVERSE[one.sign]).apply(new) if was is None else was[rows]
    n, unit = int(rows.sum()), ROLES[one.symbol].unit
    return (
        f"corrected as asked, --correct {one.text}: {one.symbol} of {n} row{'s' * (n != 1)} "
        f"({lines_text(draft.lines[rows])}) was {_span(old)}, is {_span(new)}{'' if unit == '1' else f' {unit}'}"
    )


def _span(values: Array) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return "no value"
    low, high = (f"{v:.4g}" for v in (known.min(), known.max()))
    return low if low == high else f"{low} to {high}"


def _left_out(trial: Draft, target: str, rows: Flags) -> str:
    """Rows that a target leaves out, with the values of a single one."""
    n = int(rows.sum())
    words = (
        f"left out as asked, --leave-out {target.strip()}: {n} row{'s' * (n != 1)} ({lines_text(trial.lines[rows])})"
    )
    if n > 1:
        return words
    i = int(np.flatnonzero(rows)[0])
    held = [f"{role} {format_plain(float(values[i]))}" for role, values in trial.numbers().items()
            if np.isfinite(values[i])]  # fmt: skip
    return f"{words}, which holds {', '.join(held)}" if held else words
