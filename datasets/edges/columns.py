"""Columns that may number the cutting edges, and whether their content says so."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd

from ...core.arrays import Array, Flags, Ints, Texts
from ..columns import ColumnUse
from ..headers import parse_header
from ..units import canonical, is_unit
from ..vocabulary import ROLES, role_of, roles_named

TOLERANCE = 0.02  # relative; conditions that differ by less are the same setting measured twice
SHORT = 2_000  # rows below which a dictionary is faster than pandas
MOST = 0.9  # share of the edges in which a rule must hold

# Names of columns without a role that may number edges: numbers of tools, corners, samples, files.
_OTHERS = (
    "corner, corner no, tip, cutting corner, specimen, sample, file, file name, sheet, no, number, serial no",
    "Ecke, Platte, Plattennr, Probe, Prüfling, Datei, Dateiname, Blatt, Nr, Nummer, Kante",
    "coin, bec, pointe, éprouvette, échantillon, fichier, feuille, numéro",
    "esquina, punta, muestra, probeta, archivo, hoja, número",
)
_EDGE_WORDS = ("edge", "schneid", "arête", "filo")  # in names that can mean nothing but the edge
_NUMBER_WORDS = frozenset(
    ("no", "nr", "num", "number", "nummer", "id", "numero", "numéro", "número", "n°", "nº", "n", "#")
)
BLOCK = re.compile(  # names of columns of blocks: nuisance levels that shift all tests cut in them
    r"\s*+(?:test )?(?:block|day|date|shift|batch|lot|heat|operator|machine|lathe|bar|blank|series|session|setup"
    r"|Tag|Datum|Schicht|Charge|Los|Bediener|Maschine|Serie|Stange|jour|équipe|lot|coulée|opérateur|día|turno|lote"
    r"|colada|máquina|operario)\s*+(?:no\.?|nr\.?|number|id|#)?\s*+", flags=re.IGNORECASE
)  # fmt: skip
_NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
_GRID = re.compile(r"(?:[A-Za-z][1-8]|\d+(?:\s*[-/._]\s*|\s+)(?:\d+|[A-Za-z])|\d+[A-Za-z])")


def may_be_edge(use: ColumnUse) -> bool:
    """Whether a column may number edges by its name, also where it has no role."""
    return use.role in ("edge", "tool", "run") or (use.role is None and bool(meant_by(use.name)))


def label_test(mapping: Mapping[str, str], others: Collection[str] = ()) -> Callable[[int, str, str], bool]:
    """Whether a column holds names, by its number, header and unit, as `tables.read_table` asks.

    ``mapping`` gives the column of some roles, ``others`` are headers of further columns of names.

    >>> test = label_test({"t": "Nr"}, ["grade"])
    >>> [test(1, header, "") for header in ("Werkstoff", "No", "machine", "Nr", "grade", "VB [mm]", "drill [mm]")]
    [True, True, True, False, True, False, False]
    """
    roles = {header.strip(): role for role, header in mapping.items()}

    def is_label(number: int, header: str, unit: str) -> bool:
        parts = parse_header(header)
        text = unit or parts.unit_text
        names = (header, parts.name, f"col{number}")
        given = next((roles[name] for name in names if name in roles), None)
        if given is None and not set(names).isdisjoint(others):
            return True
        role = given or role_of(parts.name, canonical(text) if text else None)
        if role is None:
            names_something = bool(meant_by(parts.name)) or BLOCK.fullmatch(parts.name) is not None
            return names_something and not is_unit(text or parts.name)
        return role in ROLES and ROLES[role].kind == "label"

    return is_label


@lru_cache(maxsize=1024)
def meant_by(name: str) -> str:
    """Kind of thing that a name numbers: ``edge``, ``tool``, ``run``, ``other``, or "" for others.

    >>> meant_by("Schneide"), meant_by("tool no."), meant_by("N° outil"), meant_by("Ecke"), meant_by("VB")
    ('edge', 'tool', 'tool', 'other', '')
    """
    words = [word for word in re.split(r"[\s_.,:;()/-]+", name.replace("#", " # ")) if word]
    rest = " ".join(word for word in words if word.casefold() not in _NUMBER_WORDS)
    for text in (name, rest):
        for role in roles_named(text):
            if role in ("edge", "tool", "run"):
                return role
    plain = " ".join(words).casefold()
    return "other" if plain in _other_names() or (words and not rest) else ""


def names_edge(name: str) -> bool:
    """Whether a name of edges can mean nothing else, as that of a test or case can.

    >>> names_edge("Schneide"), names_edge("edge no"), names_edge("Versuch")
    (True, True, False)
    """
    return any(word in name.casefold() for word in _EDGE_WORDS)


@lru_cache(maxsize=1)
def _other_names() -> frozenset[str]:
    return frozenset(name.casefold() for names in _OTHERS for name in names.split(", "))


def is_numbering(names: Sequence[str]) -> bool:
    """Whether labels count something (1 to 13, A1 to A13, E01, 3-2) and do not name makers or grades.

    >>> is_numbering(["1", "2", "3"]), is_numbering(["A1", "A2", "B1"]), is_numbering(["GC435", "GC4025"])
    (True, True, False)
    >>> is_numbering(["P10", "P20", "P30"]), is_numbering(["Platte 1", "Platte 2"])
    (False, True)
    """
    if len(names) < 2:
        return False
    if all(_GRID.fullmatch(name) for name in names) or (all(len(n) == 1 and n.isalpha() for n in names)):
        return True
    parts = [_NUMBERED.fullmatch(name) for name in names]
    found = [part for part in parts if part is not None]
    if len(found) < len(parts) or len({(part[1], part[3]) for part in found}) > 1:
        return False
    numbers = sorted({int(part[2]) for part in found})
    return numbers[-1] - numbers[0] < 2 * len(numbers) + 2


@dataclass(frozen=True, slots=True)
class Tests:
    """Evidence of the rows on edges.

    Attributes
    ----------
    time : ndarray, shape (n,), or None
    wear : ndarray, shape (n,), or None
    settings : mapping of str to ndarray, shape (n,)
        Conditions of the cut.
    """

    time: Array | None
    wear: Array | None
    settings: Mapping[str, Array]

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(next(x for x in (self.time, self.wear, *self.settings.values()) if x is not None))


def numbered(labels: Texts) -> tuple[Ints, list[str]]:
    """Codes of labels and their names, in the order of the rows.

    >>> numbered(np.array(["b", "a", "b"], dtype=object))
    (array([0, 1, 0]), ['b', 'a'])
    """
    if len(labels) > SHORT:
        codes, names = pd.factorize(labels)
        return codes.astype(np.intp, copy=False), list(names)
    known: dict[str, int] = {}
    found = [known.setdefault(label, len(known)) for label in labels.tolist()]
    return np.array(found, dtype=np.intp), list(known)


def differs(a: Array, b: Array) -> Flags:
    """Whether two settings differ by more than the tolerance; a missing one does not."""
    return np.asarray(np.abs(a - b) > TOLERANCE * np.maximum(np.abs(a), np.abs(b)))


def holds_edges(codes: Ints, tests: Tests) -> bool:
    """Whether the rows of each code are of one edge: time rises in each, or settings are constant and no time repeats.

    Without a time, wear must rise and the settings be constant.
    """
    order = np.argsort(codes, kind="stable")
    order = order[np.searchsorted(codes[order], 0) :]
    code = codes[order]
    same = code[1:] == code[:-1]
    several = int((same & np.append(True, ~same[:-1])).sum())
    if same.sum() < len(order) / 2 or several < 2:  # fewer than two rows an edge
        return False

    def share(bad: Flags) -> float:
        """Share of the edges without a bad pair of neighbours."""
        at = code[1:][bad & same]
        return 1 - (1 + int((at[1:] != at[:-1]).sum()) if len(at) else 0) / several

    settings = [x[order] for x in tests.settings.values()]
    moved = np.zeros(len(order) - 1, dtype=bool)
    for x in settings:
        moved |= differs(x[1:], x[:-1])
    constant = share(moved) >= MOST
    if tests.time is not None:
        t = tests.time[order]
        if share(t[1:] <= t[:-1]) >= MOST:
            return constant or share(moved) <= 1 - MOST or not settings or _restarts(t, same)
        t = t[np.lexsort((t, code))]
        return constant and share(t[1:] == t[:-1]) >= MOST
    if tests.wear is not None:
        w = tests.wear[order]
        return constant and share(w[1:] < w[:-1]) >= MOST
    return False


def _restarts(time: Array, same: Flags) -> bool:
    """Whether time falls from one code to the next nearly always, as it does where each begins anew."""
    between = ~same
    return not between.any() or bool((time[1:][between] <= time[:-1][between]).mean() >= MOST)
