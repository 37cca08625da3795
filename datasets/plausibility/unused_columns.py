"""Columns that vary between tests and are not used, and columns whose names are exchanged, seen from the edges."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ...core.arrays import Array, Ints
from ..design import looks_numbered
from ..doubts import Doubt
from ..draft import Draft, numbers_of, target_of
from ..headers import parse_header
from ..options import Process, ReadOptions
from ..tables import Column
from ..units import canonical, is_unit, same_dimension
from ..vocabulary import MEASURED, ROLES, role_of, role_within, understood_unit
from .quantities import table_process, unit_factor
from .ranges import plausible
from .stray_values import numbers

SAMPLE = 20000  # rows looked at
FEWEST, FEWEST_TESTS = 6, 12
MOST_DISTINCT = 0.8  # share of rows with a value of their own beyond which a condition was not set in levels
REMARKS, REDUCED = "remarks", "reduced by fitmodels"  # column and first note of a table that fitmodels reduce writes
SHOWN_REMARKS = 3
MOST_REMARKED = 1 / 3  # of the rows
MOST_LEVELS = 7
ALIKE = 0.9999  # correlation of a column with the same one in another unit
MOST_STEPS = 0.6  # share of the steps within edges in which measured wear rises, with scatter
MOST_EDGES = 0.8  # share of the edges that decides

_EQUAL = (("V", "n"), ("f", "fz", "fm"), ("d", "ae"), ("AW", "VB"), ("t", "T"))  # roles that stand for each other
_ANONYMOUS = re.compile(
    r"(?:(?:col|column|spalte|x|y|par|param|parameter|var|variable|value|wert|ch|channel|kanal)?[ _]?\d+)?",
    re.IGNORECASE,
)  # names that say nothing
_REMARKS = re.compile(
    r"remarks?|notes?|comments?|kommentare?|bemerkung(?:en)?|anmerkung(?:en)?|hinweise?|notiz(?:en)?|remarques?|"
    r"commentaires?|observations?|observaci(?:ón|on|ones)|comentarios?|notas?",
    re.IGNORECASE,
)
_NOT_VALID = re.compile(  # words of tests that are not to be used
    r"not? (?:valid|use|usable|ok)|invalid|discard|reject|exclude|ignore|wrong|mistake|error|fail|abort|crash|broke|"
    r"breakage|fractur|ung(?:ü|ue)ltig|nicht (?:verwenden|verwertbar|brauchbar|g(?:ü|ue)ltig|i\. ?o)|unbrauchbar|"
    r"verworfen|abgebrochen|abbruch|ausbruch|bruch\b|gebrochen|falsch|fehler|defekt|n\.? ?i\.? ?o\b|invalide|"
    r"non valable|ne pas|rejet|erron|erreur|cass[ée]|interrompu|no v[áa]lid|no usar|descart|inv[áa]lid|err[óo]neo|"
    r"roto\b|rotura|interrumpido",
    re.IGNORECASE,
)
_OTHER_WORDS = re.compile(
    r"temp|hard|härte|dur(?:eté|eza)|press|druck|angle|winkel|radi|cool|kühl|noise|vib|date|datum|day|no\.?$|nr\.?$|"
    r"^l(?:n|g|og(?:10)?)[\s_(]|nose|corner|^r$|^r_?eps|^re(?![^\W_])|id$|num|count|anzahl|index|repl|pass(?:es)?(?![^\W_])|hole|width|height|length|länge|humid|sd$|std|mean|time|zeit|cost|sample",
    re.IGNORECASE,
)

_LEVELS = re.compile(r"(?<![^\W_])(?:levels?|stufen?|niveaux?|nivel(?:es)?|coded?|codiert)(?![^\W_])", re.IGNORECASE)
_FACTOR = re.compile(r"[A-HJ-K]")  # letter of a factor in Taguchi's arrays
_CALCULATED = re.compile(
    r"(?<![^\W_])(?:pred\w*|calc\w*|model\w*|fem|fea|simul\w*|theor\w*|soll|nominal|target|berechnet\w*)(?![^\W_])",
    re.I,
)
_IDLE = re.compile(r"idle|leer|air|no.?load|zero|offset|vide|vac[ií]o|tare", re.IGNORECASE)
_SHARE = re.compile(r"load|power|torque|current|last|leistung|charge|puissance|carga|potencia", re.IGNORECASE)
COUNTS = re.compile(
    r"(?<![^\W_])(?:parts?|pieces?|pcs|workpieces?|components?|holes?|pass(?:es)?|cycles?|teile|st(?:ü|ue)ck(?:zahl)?|"
    r"werkst(?:ü|ue)cke|bohrungen|durchg(?:ä|ae)nge|(?:ü|ue)berl(?:ä|ae)ufe|pi(?:è|e)ces?|trous|piezas?|pasadas?|"
    r"agujeros)(?![^\W_])",
    re.IGNORECASE,
)  # words of numbers of parts, holes or passes, which are no minutes


@dataclass(frozen=True, slots=True)
class _Edges:
    """Rows of the edges of three rows and more: the row numbers, edge by edge, and where each edge starts."""

    rows: Ints
    starts: Ints

    def varying(self, values: Array) -> float:
        """Share of the edges within which a column varies."""
        ordered = values[self.rows]
        low, high = np.fmin.reduceat(ordered, self.starts), np.fmax.reduceat(ordered, self.starts)
        return float(np.mean(high - low > 1e-9 * np.abs(high)))

    def rising(self, values: Array) -> bool:
        """Whether measured values rise from row to row within nearly every edge, without a common schedule."""
        ordered = values[self.rows]
        ends = np.append(self.starts[1:], len(ordered)) - 1
        steps = np.delete(np.diff(ordered), ends[:-1])
        if not (np.mean(ordered[ends] > ordered[self.starts] * 1.02) > MOST_EDGES and np.mean(steps >= 0) > MOST_STEPS):
            return False
        return len(np.unique(ordered)) > max(len(self.starts), len(ordered) // len(self.starts) + 1)


def _edges_of(draft: Draft) -> _Edges | None:
    """Edges among the first rows; None where fewer than three of three rows are known."""
    if "edge" not in draft.data:
        return None
    code, names = pd.factorize(draft.data["edge"][:SAMPLE])
    sizes = np.bincount(code[code >= 0], minlength=len(names))
    enough = (sizes >= 3) & (names != "")
    if enough.sum() < 3:
        return None
    rows = np.argsort(code, kind="stable")
    rows = rows[(code[rows] >= 0) & enough[code[rows]]]
    ends = np.cumsum(sizes[enough])
    return _Edges(rows, ends - sizes[enough])


def check_uses(draft: Draft, options: ReadOptions) -> None:
    """Doubt columns that are not used, or whose names are exchanged, and rows that the reduction of records remarks."""
    _doubt_remarks(draft)
    _doubt_written_remarks(draft)
    if len(draft.lines) >= FEWEST:
        edges = _edges_of(draft)
        if edges is not None:
            _doubt_exchanged(draft, options, edges)
        elif len(draft.lines) >= FEWEST_TESTS:
            _doubt_set_result(draft, options)
        if any(use.role is None for use in draft.uses):
            _doubt_unused(draft, options, edges)


def _doubt_remarks(draft: Draft) -> None:
    """The remarks that ``fitmodels reduce`` writes beside the rows whose records are at fault."""
    remarks = _remarks(draft)
    if not remarks:
        return
    loads = tuple(use.role for use in draft.uses if use.role and ROLES[use.role].kind == "load")
    shown = "; ".join(f"line {draft.lines[i]}: {text}" for i, text in remarks[:SHOWN_REMARKS])
    more = f"; and {len(remarks) - SHOWN_REMARKS} more" if len(remarks) > SHOWN_REMARKS else ""
    sentence = f"the reduction of the records has remarks on {len(remarks)} of {len(draft.lines)} rows: {shown}{more}"
    draft.doubts.append(Doubt(loads, sentence, lines=numbers_of(draft, np.array([i for i, _ in remarks]))))


def _doubt_written_remarks(draft: Draft) -> None:
    """Remarks that somebody wrote beside some of the rows: a doubt where they say that a test is not valid."""
    reduced = _remarks(draft)
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role is not None or column.is_numeric or reduced or not _REMARKS.fullmatch(use.name):
            continue
        texts = [" ".join(text.split()) for text in column.labels().tolist()]
        written = np.array([i for i, text in enumerate(texts) if text], dtype=np.intp)
        rows = np.array([i for i in written if _NOT_VALID.search(texts[i])], dtype=np.intp)
        if not 0 < len(written) <= MOST_REMARKED * len(texts):
            continue
        if not rows.size:
            shown = ", ".join(dict.fromkeys(repr(texts[i]) for i in written[:SHOWN_REMARKS]))
            draft.assumed.append(f"column {use.header!r}: remarks on {len(written)} rows are not read ({shown})")
            continue
        shown = ", ".join(f"line {draft.lines[i]} {texts[i]!r}" for i in rows[:SHOWN_REMARKS])
        more = f" and {len(rows) - SHOWN_REMARKS} more" if len(rows) > SHOWN_REMARKS else ""
        carry = "1 row carries a remark" if len(rows) == 1 else f"{len(rows)} rows carry remarks"
        sentence = f"{carry} in column {use.header!r} that the test is not valid: {shown}{more}"
        target = target_of(draft, rows)
        results = (one for one in draft.data if one in ROLES and (ROLES[one].kind in MEASURED or one == "T"))
        remedy = f'--leave-out "{target}"' if target else ""
        draft.doubts.append(Doubt(tuple(results), sentence, remedy, lines=numbers_of(draft, rows)))


def _remarks(draft: Draft) -> list[tuple[int, str]]:
    """Row and text of each remark of a table that ``fitmodels reduce`` wrote."""
    column = next((one for one in draft.columns if one.name == REMARKS and not one.is_numeric), None)
    if column is None or not any(note.lstrip("#% ").startswith(REDUCED) for note in draft.notes):
        return []
    return [(i, text.strip()) for i, text in enumerate(column.labels().tolist()) if text.strip()]


def _doubt_unused(draft: Draft, options: ReadOptions, edges: _Edges | None) -> None:
    """Doubt columns that resemble a condition or a result of the tests and have no role."""
    process = table_process(draft, options)
    taken: set[str] = set()
    doubted = {name for doubt in draft.doubts for name in doubt.columns}
    pairs = zip(draft.columns, draft.uses, strict=True)
    for column, use in sorted(pairs, key=lambda pair: _CALCULATED.search(pair[1].name) is not None):
        if use.role is not None or not column.is_numeric or column.bad or use.header in doubted:
            continue
        if role_of(use.name, canonical(_unit_text(column))) in options.map:  # its role was given to another, or to none
            continue
        values = np.asarray(column.values, dtype=float)[:SAMPLE]
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) < 2 or np.isfinite(values).sum() < FEWEST or np.all(np.diff(values) == 1):  # or row numbers
            continue
        if (special := _counted(draft, column, use.suggestion, options, values)) is not None:
            draft.doubts += special
            continue
        role = _named_like(draft, column, use.suggestion, options)
        role = role or _measured_like(draft, column, values, options, edges)
        if role is None and _is_set(draft, values, levels, edges) and not _OTHER_WORDS.search(use.name):
            role = _valued_like(draft, column, levels, process, options)
        if role is None and (_ANONYMOUS.fullmatch(use.name) or is_unit(use.name)):
            sentence = f"column {column.number} {column.name!r} is not used; it varies ({numbers(values)})"
            draft.doubts.append(Doubt((column.name or f"col{column.number}",), sentence))
        elif role is not None and role not in taken:
            taken.add(role)
            sentence = f"column {column.name!r} varies between the tests ({numbers(levels)}) and is not used"
            sentence += f"; it may be the {ROLES[role].quantity} {role}"
            draft.doubts.append(Doubt((column.name,), sentence, f'--map "{role}=col{column.number}"'))


_TIMES = tuple(symbol for symbol, role in ROLES.items() if role.kind == "time")
_LOADS = {"F": ("N", "kN", "lbf"), "P": ("kW", "W", "hp"), "M": ("Nm", "Ncm", "Nmm"), "I": ("A",)}
_OF_RATED = "is a share of a rated value and is not used: multiply it by that, and add it as P [kW] or I [A]"


def _in_counts(column: Column, role: str, *, free: bool) -> list[Doubt]:
    words = f"column {column.name!r} is a number of parts, holes or passes and is not used: {of_counts(role)}"
    return [Doubt((column.name,), words)] if free and role in ("T", "t") else []


def _counted(
    draft: Draft, column: Column, suggestion: str | None, options: ReadOptions, values: Array
) -> list[Doubt] | None:
    """Doubt of a column of numbers of parts or of levels that is no quantity in its unit; None for other columns."""
    if COUNTS.search(column.name):
        role = role_within(COUNTS.sub(" ", column.name)) or suggestion
        return _in_counts(column, role, free=_free(draft, role, options)) if role in _TIMES else None
    if canonical(_unit_text(column) or "-") == "%" and _SHARE.search(column.name):
        known = any(role in ROLES and ROLES[role].kind == "load" for role in draft.data)
        return [] if known else [Doubt((column.name,), f"column {column.name!r} {_OF_RATED}")]
    return _numbered(column, suggestion, values) if looks_numbered(values) else None


def _numbered(column: Column, suggestion: str | None, values: Array) -> list[Doubt] | None:
    """Doubt of a column of whole numbers from 1 on that may be levels; None for other columns."""
    role = role_within(_LEVELS.sub(" ", column.name)) or suggestion
    named = role is not None and ROLES[role].kind == "condition"
    if not (_FACTOR.fullmatch(column.name) or (named and _LEVELS.search(column.name))):
        return None
    n = int(np.nanmax(values))
    shown, form = ", ".join(map(str, range(1, n + 1))), ":".join(("LOW", *["MIDDLE"] * (n - 2), "HIGH"))
    what, symbol = (f"levels of {role}", role) if named else ("levels of a factor, for instance of V", "V")
    sentence = (
        f"column {column.name!r} holds the numbers {shown} and is not used; if they are {what}: "
        f"--map {symbol}=col{column.number} --range {symbol}={form}"
    )
    return [Doubt((column.name,), sentence)]


def of_counts(role: str) -> str:
    """The sentence on how a time follows from a number of parts or passes.

    >>> of_counts("T")
    'T is this number times the minutes in cut of one; add it as a column'
    """
    return f"{role} is this number times the minutes in cut of one; add it as a column"


def _free(draft: Draft, role: str, options: ReadOptions) -> bool:
    """Whether a role stands open: no column has it, none stands for it, and the user did not refuse it."""
    equal = next((those for those in _EQUAL if role in those), (role,))
    return not any(one in draft.data or one in options.map or one in options.constants for one in equal)


def _unit_text(column: Column) -> str:
    return column.unit_cell or parse_header(column.name).unit_text or (column.name if is_unit(column.name) else "")


def _named_like(draft: Draft, column: Column, suggestion: str | None, options: ReadOptions) -> str | None:
    """The condition, time or wear that the name, a word of it, or the unit of a column resembles."""
    unit = canonical(_unit_text(column)) if _unit_text(column) else None
    partly = role_within(parse_header(column.name).name) if not _OTHER_WORDS.search(column.name) else None
    for role in (suggestion, partly):
        if role is None or ROLES[role].kind not in ("condition", "time", "wear") or not _free(draft, role, options):
            continue
        if unit is None or same_dimension(unit, ROLES[role].unit):
            return role
    first = re.split(r"[\s_,]+", parse_header(column.name).name.strip())[0]
    other = _IDLE.search(column.name) or _CALCULATED.search(column.name)
    load = role_of(first, unit) if unit is not None and not other else None
    if load is not None and ROLES[load].kind == "load" and _free(draft, load, options):
        return load
    for role in ("V", "f", "fz", "fm", "n", "t"):
        if unit is not None and _free(draft, role, options) and same_dimension(unit, ROLES[role].unit):
            return role
    return None


def _measured_like(
    draft: Draft, column: Column, values: Array, options: ReadOptions, edges: _Edges | None
) -> str | None:
    """Wear where a length in mm or um rises within the edges and the file has none; a load by its unit alone."""
    text = _unit_text(column)
    unit = canonical(text) if text else None
    if (unit is None or same_dimension(unit, "mm")) and _free(draft, "AW", options) and edges and edges.rising(values):
        ranges = plausible("AW", None)
        known = values[values > 0] * (unit_factor(unit, "AW") if unit else 1)
        if ranges and known.size and (unit or ranges.unusual[0] <= np.median(known)) and known.max() <= ranges.hard[1]:
            return "AW"
    for role, units in {} if _CALCULATED.search(column.name) else _LOADS.items():
        if unit not in units or any(one.role and ROLES[one.role].unit == ROLES[role].unit for one in draft.uses):
            continue
        alike = [one for one in draft.columns if one.is_numeric and canonical(_unit_text(one) or "-") in units]
        if len(alike) == 1 and _free(draft, role, options):
            return role
    return None


def _is_set(draft: Draft, values: Array, levels: Array, edges: _Edges | None) -> bool:
    """Whether values were set by the plan of tests: few repeated levels, or constant in each edge; no numbering."""
    known = values[np.isfinite(values)]
    whole = np.all(levels == np.round(levels))
    if whole and len(levels) > 1 and np.all(np.diff(levels) == 1) and levels[0] in (0, 1):
        return False
    if len(levels) <= MOST_LEVELS and np.unique(known, return_counts=True)[1].min() >= 2:
        return not _repeats_another(draft, values, levels)
    return edges is not None and edges.varying(values) == 0 and not _repeats_another(draft, values, levels)


def _repeats_another(draft: Draft, values: Array, levels: Array) -> bool:
    """Whether a column holds the levels of a used one in another unit or under other numbers."""
    own = np.searchsorted(levels, np.where(np.isfinite(values), values, levels[0]))
    for use in draft.uses:
        if use.role is None or not ROLES[use.role].unit:
            continue
        other = np.asarray(draft.data[use.role], dtype=float)[:SAMPLE]
        both = np.isfinite(values) & np.isfinite(other)
        if len(levels) > MOST_LEVELS:
            if both.sum() > 2 and np.ptp(other[both]) > 0 and abs(np.corrcoef(values[both], other[both])[0, 1]) > ALIKE:
                return True
            continue
        code = np.unique(other[both], return_inverse=True)[1]
        pairs = len(np.unique(own[both] * (len(code) + 1) + code))
        if pairs == len(np.unique(own[both])) == len(np.unique(code)):
            return True
    return False


def _valued_like(
    draft: Draft, column: Column, levels: Array, process: Process | None, options: ReadOptions
) -> str | None:
    """The missing condition in whose usual range all levels lie; a column in a unit of another kind is none."""
    text = column.unit_cell or parse_header(column.name).unit_text
    for role in ("V", "f", "d"):
        unit = understood_unit(role, text) if text else None
        named = unit if unit is not None and unit != "1" else ROLES[role].unit
        if not same_dimension(named, ROLES[role].unit):
            continue
        factor = unit_factor(named, role)
        ranges = plausible(role, process)
        if ranges is None or not _free(draft, role, options):
            continue
        if ranges.usual[0] <= levels[0] * factor and levels[-1] * factor <= ranges.usual[1]:
            return role
    return None


def _uses(draft: Draft, options: ReadOptions) -> dict[str, int]:
    """Number of the column of each role whose range the user did not give."""
    return {use.role: use.number for use in draft.uses if use.role and use.role not in options.ranges}


def _level_counts(draft: Draft, role: str) -> Ints:
    """Number of rows of each value of a column."""
    values = np.asarray(draft.data[role], dtype=float)[:SAMPLE]
    return np.unique(values[np.isfinite(values)], return_counts=True)[1]


def _of_kinds(roles: Iterable[str], *kinds: str) -> list[str]:
    return [role for role in roles if ROLES[role].kind in kinds]


def _doubt_set_result(draft: Draft, options: ReadOptions) -> None:
    """Doubt a load, life or roughness of few repeated levels next to a condition that differs in nearly every test.

    Another condition has few repeated levels too, so that the tests were planned in levels; edges are not known.
    """
    uses = _uses(draft, options)
    counts = {role: _level_counts(draft, role) for role in uses if ROLES[role].unit}
    in_levels = {role for role, n in counts.items() if 2 <= len(n) <= MOST_LEVELS and n.min() >= 3}
    distinct = {role for role, n in counts.items() if len(n) > MOST_DISTINCT * n.sum()}
    free = _of_kinds(distinct, "condition")
    results = [*_of_kinds(in_levels, "load", "surface"), *({"T"} & in_levels)]
    if len(free) == len(results) == 1 and _of_kinds(in_levels, "condition"):
        (role,), (result,) = free, results
        sentence = (
            f"{role} has {len(counts[role])} values in {counts[role].sum()} rows and {result} only "
            f"{len(counts[result])} levels, as if it were set: the two columns may be exchanged"
        )
        remedy = f'--map "{role}=col{uses[result]}" --map "{result}=col{uses[role]}"'
        draft.doubts.append(Doubt((role, result), sentence, remedy))


def _doubt_exchanged(draft: Draft, options: ReadOptions, edges: _Edges) -> None:
    """Doubt a condition that varies within the edges while a result is constant in each: exchanged names."""
    uses = _uses(draft, options)

    def share(role: str) -> float:
        return edges.varying(np.asarray(draft.data[role], dtype=float))

    moving = [role for role in uses if ROLES[role].kind == "condition" and share(role) > MOST_EDGES]
    results = [role for role in uses if ROLES[role].kind in ("time", "wear", "load", "surface")] if moving else []
    still = [role for role in results if share(role) < 1 - MOST_EDGES]
    for role in moving:
        for result in still:
            remedy = f'--map "{role}=col{uses[result]}" --map "{result}=col{uses[role]}"'
            sentence = f"{role} varies within the edges and {result} is constant in each: they may be exchanged"
            draft.doubts.append(Doubt((role, result), sentence, remedy))
