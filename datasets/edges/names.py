"""Names of cutting edges put in order: spellings of one edge, rows without a name, names of a single row."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ...core.arrays import Ints
from ...core.text import line_spans
from ..doubts import Doubt
from ..draft import Draft, numbers_of
from ..tables import Column, is_number
from ..vocabulary import ROLES
from .columns import Tests, differs, is_numbering, numbered
from .merged_cells import lines_text

_ZEROS = re.compile(r"(?<!\d)(?<!\d[.,])0+(?=\d)")  # not those of 1.05
MOST_NAMES = 5_000  # that are compared
MOST_COLUMNS = 6  # that may number edges together


def tidy_names(draft: Draft, tests: Tests | None) -> None:
    """Join spellings of one edge, give rows without a name an edge of their own, and doubt names of a single row."""
    codes, names = draft.codes("edge")
    if len(names) <= MOST_NAMES:
        _join_spellings(draft, tests, codes, names)
    _name_the_unnamed(draft)
    if tests is not None and tests.n == len(codes):
        _doubt_single_rows(draft, tests)


def join_types(draft: Draft) -> None:
    """Join names of a tool or work material that differ in blanks and case only: they would be two pairs."""
    for role in ("tool", "work"):
        if role in draft.data:
            _join_types_of(draft, role)


def _join_types_of(draft: Draft, role: str) -> None:
    codes, names = draft.codes(role)
    if not 1 < len(names) <= MOST_NAMES:
        return
    first: dict[str, int] = {}
    usual = np.argsort(-np.bincount(codes), kind="stable").tolist()
    for code in usual:
        first.setdefault("".join(names[code].split()).casefold(), code)
    same = [first["".join(name.split()).casefold()] for name in names]
    for code, other in enumerate(same):
        if code != other:
            draft.warnings.append(
                f"{role} {names[code]!r} is read as {names[other]!r}: the same name in another spelling"
            )
    if len(first) < len(names):
        draft.data[role] = np.array(names, dtype=object)[np.array(same)[codes]]


def spelling(name: str) -> str:
    """Form of a name without blanks, underscores, case and leading zeros.

    >>> spelling("E 04"), spelling("e4"), spelling("Platte_010")
    ('e4', 'e4', 'platte10')
    >>> spelling("007"), spelling("1.05")
    ('7', '1.05')
    """
    plain = "".join(name.split()).replace("_", "").casefold()
    return _ZEROS.sub("", plain) if "0" in plain else plain


def _join_spellings(draft: Draft, tests: Tests | None, codes: Ints, names: list[str]) -> None:
    """Rows of one edge whose name is spelled in two ways, where their settings agree."""
    first: dict[str, int] = {}
    for code, name in enumerate(names):
        other = first.setdefault(spelling(name), code)
        if other == code or not name or not _alike(tests, codes, code, other):
            continue
        mostly, rarely = sorted((other, code), key=lambda c: -int((codes == c).sum()))
        rows = codes == rarely
        edge = draft.data["edge"].copy()
        edge[rows] = names[mostly]
        draft.data["edge"] = edge
        draft.warnings.append(
            f"edge {names[rarely]!r} is read as {names[mostly]!r} ({lines_text(draft.lines[rows])}): the same name in "
            "another spelling"
        )


def _alike(tests: Tests | None, codes: Ints, one: int, other: int) -> bool:
    """Whether the settings of two edges agree."""
    if tests is None:
        return True
    known = codes[: tests.n]
    a, b = np.flatnonzero(known == one), np.flatnonzero(known == other)
    return not len(a) or not len(b) or not any(differs(x[a[:1]], x[b[:1]])[0] for x in tests.settings.values())


def _texts_in(draft: Draft, lines: set[int]) -> list[str]:
    """Texts of the column of edges in these lines; none unless each of them holds one, and no other line does."""
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role == "edge" and column.bad_count == len(column.bad) == len(lines):
            texts = [text for line, text in column.bad if line in lines]
            return texts if len(texts) == len(lines) else []
    return []


def _blank_words(draft: Draft) -> None:
    """Take the few words in a column of edge numbers for no names of edges: they stand in rows of a summary, too."""
    for column, use in zip(draft.columns, draft.uses, strict=True):
        if use.role == "edge" and column.bad and column.bad_count == len(column.bad):
            words = {cell for cell in column.bad if not is_number(cell[1])}
            cells = zip(draft.lines.tolist(), draft.data["edge"].tolist(), strict=True)
            draft.data["edge"] = np.array(["" if cell in words else cell[1] for cell in cells], dtype=object)


def _name_the_unnamed(draft: Draft) -> None:
    """Rows without an edge become edges of their own: as one edge named "" they would be rows of many edges."""
    _blank_words(draft)
    edge = draft.data["edge"]
    if "" not in draft.codes("edge")[1]:
        return
    blank = np.asarray(edge == "", dtype=bool)
    if blank.all():
        return
    edge = edge.copy()
    edge[blank] = [f"line {line}" for line in draft.lines[blank]]
    draft.data["edge"] = edge
    lines = set(draft.lines[blank].tolist())
    if texts := _texts_in(draft, lines):
        shown = ", ".join(map(repr, texts))
        target = f"lines {','.join(line_spans(sorted(lines)))}"
        where = lines_text(draft.lines[blank])
        sentence = f"{where}: {shown} in the column of edge numbers: tests, or rows of a summary?"
        draft.doubts.append(Doubt(("edge",), sentence, f'--leave-out "{target}"', lines=numbers_of(draft, blank)))
        return
    what = "names no edge: it is read as an edge" if blank.sum() == 1 else "name no edge: each is read as an edge"
    sentence = f"{lines_text(draft.lines[blank])} {what} of its own; name the edge in the file"
    draft.doubts.append(Doubt(("edge",), sentence, lines=numbers_of(draft, blank)))


def _doubt_single_rows(draft: Draft, tests: Tests) -> None:
    """A name of one row only beside rows of an edge that it continues: misspelled."""
    codes, names = draft.codes("edge")
    counts = np.bincount(codes)
    single = np.flatnonzero(counts[codes] == 1)
    if tests.time is None or not 0 < len(single) <= max(2, 0.1 * len(counts)):
        return
    t, n = tests.time, len(codes)
    for i in single.tolist():
        above = i > 0 and counts[codes[i - 1]] > 1 and t[i] > t[i - 1] and _same_setting(tests, i, i - 1)
        below = i + 1 < n and counts[codes[i + 1]] > 1 and t[i] < t[i + 1] and _same_setting(tests, i, i + 1)
        if above or below:
            beside = names[codes[i - 1 if above else i + 1]]
            draft.doubts.append(
                Doubt(
                    ("edge",),
                    f"line {draft.lines[i]} alone is of edge {names[codes[i]]}, and its settings and time continue edge"
                    f" {beside}: is the name misspelled? Correct it in the file",
                    lines=(int(draft.lines[i]),),
                )
            )


def _same_setting(tests: Tests, i: int, j: int) -> bool:
    return not any(differs(x[i : i + 1], x[j : j + 1])[0] for x in tests.settings.values())


def name_by_columns(draft: Draft, edges: Ints) -> bool:
    """Name edges that the order of the tests has by the one or two unused columns that number the same edges.

    ``edges`` are the codes by the order, shape (n,). Returns whether there are such columns. A number of each setting
    is no name: they must distinguish repeats of a setting, or number the rows of a wide table.
    """
    if not (_repeats_settings(draft, edges) or len(np.unique(draft.lines)) == edges.max() + 1 < len(edges)):
        return False
    numbers = {
        place: found[0]
        for place, use in enumerate(draft.uses)
        if use.role is None
        and _is_whole(draft.columns[place])
        and is_numbering((found := numbered(draft.columns[place].labels()))[1])
    }
    places = list(numbers)[:MOST_COLUMNS]
    for chosen in (*combinations(places, 1), *combinations(places, 2)):
        codes = np.column_stack([edges, *(numbers[place] for place in chosen)])
        n_named, n_both = (len(np.unique(rows, axis=0)) for rows in (codes[:, 1:], codes))
        if n_named == n_both == edges.max() + 1:
            _take(draft, chosen)
            return True
    return False


def _repeats_settings(draft: Draft, edges: Ints) -> bool:
    """Whether several edges have the same settings."""
    columns = [x for role, x in draft.numbers().items() if ROLES[role].kind == "condition"]
    return bool(columns) and len(np.unique(np.column_stack(columns), axis=0)) <= edges.max()


def _is_whole(column: Column) -> bool:
    """Whether a column holds texts, or numbers without a fraction."""
    return not column.is_numeric or bool((np.asarray(column.values, dtype=float) % 1 == 0).all())


def _take(draft: Draft, places: Sequence[int]) -> None:
    """Give the role of the edge to columns, of two to the combination of their values."""
    texts = [draft.columns[place].labels() for place in places]
    draft.data["edge"] = np.array(["/".join(map(str, row)) for row in zip(*texts, strict=True)], dtype=object)
    draft.uses = tuple(replace(use, role="edge") if i in places else use for i, use in enumerate(draft.uses))
    headers = " and ".join(repr(draft.uses[place].header) for place in places)
    words = f"column {headers} numbers the edges" if len(texts) == 1 else f"columns {headers} together number the edges"
    draft.assumed.append(f"{words} as the order of the tests has them; --edge none takes the rows as independent")
