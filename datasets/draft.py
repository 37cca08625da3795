"""A table of tests while it is being read, completed or judged by each step, and its marked numbers (<0.05, 0.24*)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.arrays import Array, Flags, Ints, Texts
from ..core.errors import DataError
from ..core.rounding import listed
from ..core.text import line_spans
from .columns import ColumnUse, Values
from .derived.rules import Derived
from .doubts import Doubt
from .edges.columns import numbered
from .tables import Column
from .tables.numerals import Mark
from .units import canonical, convert, same_dimension
from .vocabulary import MARK, MEASURED, ROLES, UNNAMED

CORRECTS = "--correct"
LONGEST_TARGET = 300  # letters of an option that names rows
_WORDS = {"<": "at most", ">": "at least", "~": "approximate", "*": "footnote"}


@dataclass(slots=True)
class Draft:
    """Columns, values by role in the role's unit, and what was assumed, corrected or doubted so far.

    Attributes
    ----------
    columns : tuple of Column
        Columns of the file as written.
    uses : tuple of ColumnUse
        Use of each column, in the same order.
    data : dict
        Role symbol -> values, shape (n,); a step adds, replaces or converts them.
    units : dict
        Unit of each role in ``data`` that has one.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    notes : tuple of str
        Free text of the file.
    assumed, warnings : list of str
        Assumptions made; what was left out or corrected.
    doubts : list of Doubt
    derived : list of Derived
        Quantities computed from others.
    """

    columns: tuple[Column, ...]
    uses: tuple[ColumnUse, ...]
    data: dict[str, Values]
    units: dict[str, str]
    lines: Ints
    notes: tuple[str, ...] = ()
    assumed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)
    derived: list[Derived] = field(default_factory=list)
    coded: dict[str, tuple[Values, Ints, list[str]]] = field(default_factory=dict, repr=False)

    def numbers(self) -> dict[str, Array]:
        """Values of the roles that have a unit, as floats."""
        with_unit = [role for role in self.data if role in ROLES and ROLES[role].unit]
        return {role: np.asarray(self.data[role], dtype=float) for role in with_unit}

    def keep(self, rows: Flags) -> None:
        """Leave out the other rows; ``rows`` has shape (n,)."""
        place = np.cumsum(rows) - 1
        self.columns = tuple(
            replace(
                column, values=column.values[rows],
                marks=tuple((int(place[row]), mark) for row, mark in column.marks if rows[row]),
            )
            for column in self.columns
        )  # fmt: skip
        self.data = {role: values[rows] for role, values in self.data.items()}
        self.lines = self.lines[rows]

    def codes(self, role: str) -> tuple[Ints, list[str]]:
        """Codes of the rows of a label, and its names; computed once for each array."""
        labels = self.data[role]
        known = self.coded.get(role)
        if known is None or known[0] is not labels:
            known = (labels, *numbered(np.asarray(labels, dtype=object)))
            self.coded[role] = known
        return known[1], known[2]


def target_of(draft: Draft, rows: Ints) -> str:
    """Rows as ``--correct`` names them: ``E05,E11`` where they are whole edges, else ``lines 2-4,9``.

    Empty where lines hold rows of several edges, where two pairs of tool and work have edges of one name, or where the
    text would be too long to type.
    """
    named = whole_edges(draft, rows)
    pairs = [draft.codes(role)[0][rows] for role in UNNAMED if role in draft.data]
    if named and not any(len(np.unique(codes)) > 1 for codes in pairs):
        text = ",".join(named)
        return text if len(text) <= LONGEST_TARGET and '"' not in text else ""
    lines = draft.lines[rows]
    if len(np.unique(draft.lines)) < len(draft.lines):
        return ""
    text = f"lines {','.join(line_spans(np.sort(lines).tolist()))}"
    return text if len(text) <= LONGEST_TARGET else ""


def whole_edges(draft: Draft, rows: Ints) -> list[str]:
    """Names of the edges whose rows these are; empty where an edge is among them with some of its rows only."""
    if "edge" not in draft.data:
        return []
    codes, names = draft.codes("edge")
    inside = np.zeros(len(codes), dtype=bool)
    inside[rows] = True
    found = np.unique(codes[rows])
    if (found < 0).any() or not inside[np.isin(codes, found)].all():
        return []
    edges = [str(names[code]) for code in found]
    return sorted(edges, key=lambda name: (len(name), name)) if all(edges) else []


def correction(draft: Draft, rows: Ints, symbol: str, factor: float) -> str:
    """The option that multiplies a quantity of some rows, empty where they have no short name."""
    target = target_of(draft, rows)
    sign, size = ("*", factor) if abs(factor) >= 1 else ("/", 1 / factor)
    return f'{CORRECTS} "{target}:{symbol}{sign}{size:.10g}"' if target else ""


def mark_column(role: str) -> str:
    """Name of the column that holds the marks of a role.

    >>> mark_column("VB")
    'VB mark'
    """
    return role + MARK


# Cells of a column of run-outs
_YES = frozenset(
    ("1", "yes", "y", "true", "x", "✓", "✔", "+", "ja", "j", "wahr", "oui", "o", "vrai", "si", "sí", "s", "verdadero")
)
_NO = frozenset(("", "0", "no", "n", "false", "-", "–", "—", "nein", "falsch", "non", "faux", "falso"))
_RUN_OUT = re.compile(
    r"(run[ -]?out|censored|cens|suspended|susp|stopped|survived|running|still running|alive|abgebrochen|abbruch|"
    r"zensiert|durchläufer|unterbrochen|interrompu|arrêté|censuré|interrumpido|suspendido|censurado|c|r/o|ro)\b|"
    r".*\b(no failure|not failed|not worn|not reached|no end of life|nicht erreicht|nicht ausgefallen|"
    r"nicht verschlissen|non atteint|pas usé|no alcanzado|sin fallo|run[ -]?out)\b"
)
_FOOTNOTE = re.compile(
    r"\s*\*.*\b(stopped|run[ -]?outs?|censored|suspended|not reached|no failure|abgebrochen|abbruch|nicht erreicht|"
    r"zensiert|interrompu|non atteint|interrumpido|no alcanzado)\b", re.IGNORECASE
)  # fmt: skip
_ENDED = re.compile(
    r"(failed|failure|fail|worn|worn out|ended|end|event|dead|broken|exact|end of life|reached|f|ausgefallen|"
    r"verschlissen|standzeitende|ende|erreicht|usé|défaillant|atteint|fallo|falla|desgastado|alcanzado)\b"
)
_BROKEN = re.compile(r"bruch\b|gebrochen|broken?\b|breakage|fractur|chipp|cass[ée]|rotura\b", re.IGNORECASE)
_WORN = re.compile(  # the wear, or its criterion, that ended a life
    r"\b(vb[bcn]?[ _.]*(max)?|aw|kt)(?![a-z])(?!.*<)|wear|verschlei|kriteri|criteri|crit[èe]re|usure|desgaste",
    re.IGNORECASE,
)
_NOT = re.compile(
    r"\b(no|not|non|none|without|before|kein\w*|nicht|ohne|vor|pas|sans|avant|sin|antes)\b", re.IGNORECASE
)
_STATUS = re.compile(
    r"(status|state|outcome|result|event|zustand|ergebnis|statut|état|résultat|estado|resultado)\b", re.I
)


def mark_run_outs(draft: Draft) -> None:
    """Mark the lives that a column of the file calls run-outs as greater than their time: 60 becomes ``>60``.

    The column has the role ``censored`` or ``ended``, or holds words of stopped tests (run-out, abgebrochen ...).
    """
    if "T" not in draft.data:
        return
    given = _stated_run_outs(draft)
    if given is None:
        return
    name, run_out = given
    lives = np.asarray(draft.data["T"], dtype=float)
    _doubt_broken(draft, name, ~run_out & np.isfinite(lives))
    rows = np.flatnonzero(run_out & np.isfinite(lives))
    if not rows.size:
        return
    texts = np.full(len(lives), "", dtype=object)
    texts[rows] = [f">{lives[row]:.12g}" for row in rows]
    draft.data["T"] = np.where(run_out, np.nan, lives)
    draft.data[mark_column("T")] = texts
    if "censored" not in draft.data and "ended" not in draft.data:
        draft.uses = tuple(
            replace(use, role="censored") if column.name == name else use
            for column, use in zip(draft.columns, draft.uses, strict=True)
        )
        draft.data["censored"] = np.where(run_out, "run-out", "").astype(object)
    n = int(np.isfinite(lives).sum())
    draft.assumed.append(
        f"T: {len(rows)} of {n} lives {_are(len(rows))} by column {name!r} ({lines_of(draft.lines[rows])}): longer "
        "than the time stated"
    )
    ended = lives[~run_out & np.isfinite(lives)]
    if 2 * len(rows) > n and ended.size and ended.min() >= lives[rows].max():
        other = "ended" if "ended" not in draft.data else "censored"
        draft.doubts.append(
            Doubt(
                ("T",),
                f"T: by column {name!r} {len(rows)} of {n} lives are run-outs and all of them shorter than those that "
                f'ended; if it is the reverse, give --map "{other}={name}"',
            )
        )


def _doubt_broken(draft: Draft, name: str, ended: Flags) -> None:
    """Doubt lives that a column says ended by breakage: they are no lives to a wear criterion."""
    cells = next(column.labels() for column in draft.columns if column.name == name)
    rows = np.flatnonzero(ended & np.array([bool(_BROKEN.search(str(cell))) for cell in cells]))
    if 0 < rows.size < np.count_nonzero(ended) / 2:  # more: breakage is the end that was waited for
        lives = "1 life" if rows.size == 1 else f"{rows.size} lives"
        sentence = (
            f"T: {lives} ended by breakage by column {name!r} ({lines_of(draft.lines[rows])}), and a breakage counts "
            "as the end of life; if T is the life to a wear criterion, it is a run-out"
        )
        draft.doubts.append(Doubt(("T",), sentence, lines=numbers_of(draft, rows)))


def _stated_run_outs(draft: Draft) -> tuple[str, Flags] | None:
    """Column that states the run-outs, and whether each row is one; None where there is no such column."""
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role in ("censored", "ended"):
            return column.name, _by_role(column, use.role)
    lives = np.asarray(draft.data["T"], dtype=float)
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role is not None:
            continue
        cells = [str(cell).strip().casefold() for cell in column.labels()]
        if column.is_numeric:
            if _STATUS.match(column.name) and set(cells) == {"0", "1"}:
                return column.name, _by_codes(draft, column.name, np.array(cells, dtype=object), lives)
        elif any(_RUN_OUT.match(cell) for cell in cells):
            return column.name, np.array([bool(_RUN_OUT.match(cell)) for cell in cells], dtype=bool)
    return None


def _by_role(column: Column, role: str) -> Flags:
    """Run-outs by a column that says yes or no, or in words, whether a life was cut off or ended, or what ended it."""
    cells = [str(cell).strip().casefold() for cell in column.labels()]
    out = [_is_run_out(cell, role) for cell in cells]
    if None in out:
        row = out.index(None)
        raise DataError(
            f"column {column.name!r}, row {row + 1} of the data: {cells[row]!r} does not say whether the life ended. "
            "Write yes or no, or what ended it (wear, breakage), or give the column no role with --map "
            f"{role}=none."
        )
    return np.array(out, dtype=bool)


def _is_run_out(cell: str, role: str) -> bool | None:
    """Whether a cell says that a life was cut off; None where it says neither."""
    if cell in _YES or cell in _NO:
        return (cell in _YES) == (role == "censored")
    if _RUN_OUT.match(cell) or _ENDED.match(cell):
        return bool(_RUN_OUT.match(cell))
    names_end = (_WORN.search(cell) or _BROKEN.search(cell)) and not _NOT.search(cell)
    return False if names_end else None


def _by_codes(draft: Draft, name: str, cells: Texts, lives: Array) -> Flags:
    """Run-outs by codes 0 and 1: those of the longest lives if all are equal, otherwise 0, with a doubt."""
    longest = np.isfinite(lives) & (lives >= np.nanmax(lives))
    for code in ("0", "1"):
        if np.array_equal(cells == code, longest) and longest.sum() > 1:
            return np.asarray(longest, dtype=bool)
    draft.doubts.append(
        Doubt(
            ("T",),
            f"T: 1 in column {name!r} is taken as a life that ended and 0 as a run-out; if it is the reverse, give "
            f'--map "censored={name}"',
        )
    )
    return np.asarray(cells == "0", dtype=bool)


def numbers_of(draft: Draft, rows: Ints | Flags) -> tuple[int, ...]:
    """Lines of some rows of a draft, for a doubt about them."""
    return tuple(draft.lines[rows].tolist())


def lines_of(lines: Ints) -> str:
    """Lines in words.

    >>> lines_of(np.array([2, 3, 6]))
    'lines 2-3, 6'
    """
    spans = line_spans(np.sort(lines).tolist())
    shown = ", ".join(spans[:6]) + (", ..." if len(spans) > 6 else "")
    return f"{'lines' if len(lines) > 1 else 'line'} {shown}"


def keep_marks(draft: Draft) -> None:
    """Add a column of marks for each role with marked numbers, in the role's unit, and a doubt that names them.

    The numbers themselves are nan: a plain fit leaves these rows out. Bounds of tool lives are no doubt: their law uses
    them.
    """
    mark_run_outs(draft)
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if not column.marks or use.role is None or ROLES[use.role].kind == "label" or use.role not in draft.data:
            continue
        role = use.role
        texts = draft.data.get(mark_column(role), np.full(len(draft.lines), "", dtype=object))
        factor = _factor(column, np.asarray(draft.data[role], dtype=float))
        stopped = role == "T" and any(map(_FOOTNOTE.match, draft.notes))
        marks = [(row, replace(mark, sign=">") if stopped and mark.sign == "*" else mark) for row, mark in column.marks]
        for row, mark in marks:
            texts[row] = _converted(mark, role, factor)
        draft.data[mark_column(role)] = texts
        if role == "T":
            _note_bounds(draft, marks)
            marks = [(row, mark) for row, mark in marks if mark.sign not in "<>"]
        if marks:
            lines = numbers_of(draft, np.array([row for row, _ in marks], dtype=np.intp))
            draft.doubts.append(Doubt((role,), _left_out(draft, role, marks), lines=lines))


def _are(n: int) -> str:
    return "is a run-out" if n == 1 else "are run-outs"


def _note_bounds(draft: Draft, marks: Sequence[tuple[int, Mark]]) -> None:
    for sign in "><":
        rows = np.array([row for row, mark in marks if mark.sign == sign], dtype=np.intp)
        if rows.size:
            n, k = len(draft.lines), len(rows)
            shorter = "is shorter than the time stated" if k == 1 else "are shorter than the time stated"
            words = f"{_are(k)}: longer than the time stated" if sign == ">" else shorter
            draft.assumed.append(f"T: {len(rows)} of {n} lives ({lines_of(draft.lines[rows])}) {words}")


def _left_out(draft: Draft, role: str, marks: Sequence[tuple[int, Mark]]) -> str:
    """Sentence on marked numbers that no fit uses."""
    cells = [f"line {draft.lines[row]} {mark.text!r}" for row, mark in marks]
    kinds = ", ".join(dict.fromkeys(_WORDS[mark.sign] for _, mark in marks))
    n = len(cells)
    values = f"{n} marked value{'s' * (n > 1)} ({kinds}) {'are' if n > 1 else 'is'}"
    signs = "".join({mark.sign for _, mark in marks}) if ROLES[role].kind in MEASURED else ""
    bias = {"<": "overstates", ">": "understates"}.get(signs)
    what = f": a law without them {bias} {role}" if bias else ""
    return f"{role}: {values} left out of the fit and kept as {mark_column(role)!r}{what} ({listed(cells, 4)})"


def _factor(column: Column, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Factor by which the numbers of the column were converted."""
    written = np.asarray(column.values, dtype=float)
    both = np.isfinite(written) & np.isfinite(values) & (written != 0) & (values != 0)
    return float(np.median(values[both] / written[both])) if both.any() else 1.0


def _converted(mark: Mark, role: str, factor: float) -> str:
    """The mark in the role's unit; a unit beside the number counts before that of the column."""
    unit = canonical(mark.unit) if mark.unit else None
    if unit is not None and same_dimension(unit, ROLES[role].unit):
        factor = float(convert(np.array([1.0]), unit, ROLES[role].unit)[0])
    return mark.describe(factor)
