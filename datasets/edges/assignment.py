"""Cutting edge of each row: from the column that numbers edges by its content, or from the order of the tests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ...core.arrays import Ints, Texts
from ..columns import NONE, ColumnUse
from ..doubts import Doubt
from ..draft import Draft
from ..options import ReadOptions
from ..vocabulary import MEASURED, ROLES, roles_named
from .checks import SHIFTED
from .columns import Tests, differs, holds_edges, is_numbering, may_be_edge, meant_by, names_edge, numbered
from .merged_cells import lines_text
from .names import join_types, name_by_columns, tidy_names
from .order import edges_by_design, settings_of
from .times import sub_tests_in_order

SAMPLE = 20_000  # rows by which the content of columns is decided
FEW_EDGES = 4  # an insert has no more edges of its own than a type of tools, which is tested on more
NEARLY = 0.8  # share of the rows with a number of their own in a column that numbers rows
FEWEST_LIVES = 4  # tools of one row each
SURE = 6  # values from which labels that are no numbering can be edges too

GENERAL = ("tool", "cutting tool", "werkzeug", "outil", "outil de coupe", "herramienta")  # of types too

Kind = Literal["edge", "tool", "run", "other"]


@dataclass(frozen=True, slots=True)
class _Labels:
    """A column that may number edges."""

    place: int
    use: ColumnUse
    kind: Kind
    codes: Ints
    names: tuple[str, ...]

    @property
    def title(self) -> str:
        return f"column {self.use.header!r}"

    @property
    def several(self) -> bool:
        return 1 < len(self.names) < int((self.codes >= 0).sum())

    def covers(self, draft: Draft) -> bool:
        """Whether every row of the draft has a name."""
        return len(self.codes) == len(draft.lines) and bool((self.codes >= 0).all())


def settle_edges(draft: Draft, options: ReadOptions) -> None:
    """Give the role of the edge to the column that has it by content, or infer edges from the order of the tests."""
    given = options.columns
    if given.get("edge", "").strip().lower() == NONE or not len(draft.lines):
        return
    join_types(draft)
    tests = _tests(draft)
    if "edge" not in given and tests is not None:
        _decide(draft, tests, given)
    if "edge" in draft.data:
        tidy_names(draft, tests)
    elif tests is not None:
        (_infer_readings if tests.time is None else _infer)(draft, tests)


def _tests(draft: Draft) -> Tests | None:
    """Time, wear and settings, where there are any."""
    rows = slice(SAMPLE)
    numbers = {role: values[rows] for role, values in draft.numbers().items()}
    wear = next((numbers[role] for role in numbers if ROLES[role].kind == "wear"), None)
    settings = settings_of({role: values for role, values in numbers.items() if ROLES[role].kind == "condition"})
    time = numbers.get("t")
    return Tests(time, wear, settings) if time is not None or wear is not None or settings else None


def _decide(draft: Draft, tests: Tests, given: dict[str, str]) -> None:
    """Choose the column of the edges, or the two that name an edge together, and correct the roles of the others."""
    labels = [found for found in _candidates(draft, given) if found is not None]
    if not labels:
        return
    by_name = next((one for one in labels if one.use.role == "edge"), None)
    tool = next((one for one in labels if one.use.role == "tool"), None)
    chosen = _chosen(labels, tests, draft.codes("work")[0][:SAMPLE] if "work" in draft.data else None)
    if chosen:
        _edges_are(draft, chosen, by_name)
    elif by_name is not None and (codes := _numbered_anew(draft, by_name)) is not None:
        width = len(str(int(codes.max()) + 1))
        names = [f"E{k + 1:0{width}d}" for k in range(int(codes.max()) + 1)]
        draft.data["edge"] = np.array(names, dtype=object)[codes]
        draft.assumed.append(
            f"{by_name.title} numbers edges anew in each block of tests: {len(names)} edges of {len(by_name.names)} "
            "names, by the order of the tests"
        )
    elif by_name is not None and _types_of_tools(by_name, tests) and "tool" not in draft.data:
        _give(draft, by_name, "tool")
        draft.assumed.append(
            f"{by_name.title}: {_listed(by_name.names)} name types of tools, not edges; --edge {_typed(by_name)} reads "
            "it as edges"
        )
    elif by_name is not None and _numbers_rows(by_name, draft):
        if names_edge(by_name.use.name):
            draft.doubts.append(
                Doubt(
                    ("edge",),
                    f"{by_name.title} gives every row an edge of its own, while time rises in rows of equal conditions;"
                    " if it numbers measurements, edges can be inferred from the order of the tests",
                    f"--map run={_typed(by_name)}",
                )
            )
            return
        _give(draft, by_name, "run" if "run" not in draft.data else None)
        draft.assumed.append(
            f"{by_name.title} numbers every row, while time rises in rows of equal conditions: measurements, "
            f"not edges; --edge {_typed(by_name)} reads it as edges"
        )
    if tool is not None and tool not in chosen:
        _number_of_inserts(draft, tool, tests)
    if "tool" not in draft.data and "tool" not in given:
        others = [one for one in labels if "tool" in roles_named(one.use.name) and one not in (*chosen, tool)]
        for one in others[:1]:
            if not is_numbering(one.names):
                _give(draft, one, "tool")


def _candidates(draft: Draft, given: dict[str, str]) -> list[_Labels | None]:
    return [
        _labels(draft, place, use) for place, use in enumerate(draft.uses) if may_be_edge(use) and use.role not in given
    ]


def _labels(draft: Draft, place: int, use: ColumnUse) -> _Labels | None:
    if use.role is not None:
        codes, names = draft.codes(use.role)
        codes = codes[:SAMPLE]
        names = names[: int(codes.max(initial=-1)) + 1]
    else:
        column = draft.columns[place]
        codes, names = numbered(replace(column, values=column.values[:SAMPLE]).labels())
    if "" in names:
        empty = names.index("")
        codes = np.where(codes == empty, -1, codes - (codes > empty))
        names = names[:empty] + names[empty + 1 :]
    kind: Any = meant_by(use.name) or "other"
    return _Labels(place, use, kind, codes, tuple(names)) if names else None


def _chosen(labels: list[_Labels], tests: Tests, work: Ints | None) -> tuple[_Labels, ...]:
    """The column of the edges, or two whose values name an edge together; none where the content does not say so.

    Names may begin again with each type of tool or work material (``work``, shape (n,)), since pairs are fitted apart.
    """
    types = [one for one in labels if one.use.role == "tool" and not _numbers_inserts(one)]
    named = [one for one in labels if one.kind == "edge" and one.several]
    for one in sorted(named, key=lambda one: not names_edge(one.use.name)):
        if holds_edges(_by_work(_crossed([one, *types[:1]]), work), tests):
            return (one,)
    if tests.time is None and named:
        return ()
    rest = [one for one in labels if one.kind != "edge" and one.several]
    for one in sorted(rest, key=lambda one: one.kind == "run"):
        of_types = [other for other in types[:1] if other is not one]
        if _could_be_edges(one, tests) and holds_edges(_by_work(_crossed([one, *of_types]), work), tests):
            return (one,)
    several = [one for one in labels if one.several or len(one.names) > 1]
    for first in several:
        for second in several:
            small = len(second.names) <= 8 and is_numbering(second.names) and second.kind in ("edge", "other")
            inserts = first.kind in ("tool", "other") and _numbers_inserts(first)
            if first is not second and small and inserts and holds_edges(_crossed([first, second]), tests):
                return (first, second)
    if tests.time is None and not named:
        return tuple(one for one in (*rest, *labels) if one.use.role == "tool" and _many_inserts(one))[:1]
    return ()


def _crossed(parts: Sequence[_Labels]) -> Ints:
    """Codes of the combinations of labels; -1 where one is blank."""
    codes = parts[0].codes
    for part in parts[1:]:
        both = np.where((codes < 0) | (part.codes < 0), -1, codes * len(part.names) + part.codes)
        codes = np.unique(both, return_inverse=True)[1] - int((both < 0).any())
    return np.asarray(codes)


def _by_work(codes: Ints, work: Ints | None) -> Ints:
    """Codes of labels within each work material; -1 where the label is blank."""
    if work is None or not work.any():
        return codes
    found = np.unique(codes * (int(work.max()) + 1) + work, return_inverse=True)[1]
    return np.where(codes < 0, -1, found)


def _could_be_edges(one: _Labels, tests: Tests) -> bool:
    """Whether the names may be those of edges: a numbering, or many names that are not a comparison of types."""
    if is_numbering(one.names):
        return True
    if one.use.role != "tool" and one.kind != "tool":
        return len(one.names) > 2
    settings = _crossed_settings(one, tests)
    return len(one.names) >= SURE and settings > len(one.names) / 4


def _crossed_settings(one: _Labels, tests: Tests) -> int:
    """Number of different settings at the first rows of the labels."""
    first = np.unique(one.codes, return_index=True)[1]
    columns = [x[first] for x in tests.settings.values()]
    return len(np.unique(np.column_stack(columns), axis=0)) if columns else 1


def _numbers_inserts(one: _Labels) -> bool:
    """Whether values count inserts; few values under the name of a tool in general are types."""
    return is_numbering(one.names) and (one.use.name.casefold() not in GENERAL or len(one.names) >= SURE)


def _many_inserts(one: _Labels) -> bool:
    """Whether a column numbers inserts: many of several rows, or one for each row, as in a table of tool lives."""
    least = SURE if one.several else max(FEWEST_LIVES, NEARLY * len(one.codes))
    return len(one.names) >= least and is_numbering(one.names)


def _edges_are(draft: Draft, chosen: tuple[_Labels, ...], by_name: _Labels | None) -> None:
    """Give the role to the chosen columns; said where the name alone would not have."""
    if chosen == (by_name,):
        return
    if by_name is not None and by_name not in chosen:
        of_run = names_edge(chosen[0].use.name) and is_numbering(by_name.names) and "run" not in draft.data
        _give(draft, by_name, "run" if of_run else None)
    texts = [_texts(draft, one) for one in chosen]
    for one in chosen:
        _give(draft, one, "edge" if len(chosen) == 1 else None)
    if len(chosen) == 2:
        blank, places = (texts[0] == "") | (texts[1] == ""), [one.place for one in chosen]
        draft.data["edge"] = np.where(blank, "", texts[0] + "/" + texts[1]).astype(object)
        draft.uses = tuple(replace(use, role="edge") if i in places else use for i, use in enumerate(draft.uses))
        draft.assumed.append(
            f"edges are the combinations of columns {chosen[0].use.header!r} and {chosen[1].use.header!r}: a value of "
            "one alone is of several edges"
        )
        return
    one, why = chosen[0], "with rising time in each" if "t" in draft.data else "that number inserts"
    other = f", not tool types; --map tool={_typed(one)} reads it as tool types" if one.kind == "tool" else ""
    draft.assumed.append(f"{one.title} has {len(set(texts[0]) - {''})} values {why}: cutting edges{other}")


def _texts(draft: Draft, one: _Labels) -> Texts:
    """Labels of a column, those of its role where it has one."""
    role = draft.uses[one.place].role
    if role is not None and role in draft.data:
        return np.asarray(draft.data[role], dtype=object)
    return draft.columns[one.place].labels()


def _give(draft: Draft, one: _Labels, role: str | None) -> None:
    """Change the role of a column."""
    old, texts = draft.uses[one.place].role, _texts(draft, one)
    if old is not None:
        draft.data.pop(old, None)
    if role is not None:
        draft.data[role] = texts
    uses = list(draft.uses)
    uses[one.place] = replace(uses[one.place], role=role)
    if role is not None:
        for i, use in enumerate(uses):
            if i != one.place and use.role == role:
                uses[i] = replace(use, role=None)
    draft.uses = tuple(uses)


def _types_of_tools(one: _Labels, tests: Tests) -> bool:
    """Whether values under a name of edges are makers or grades: words that number nothing, each of several edges."""
    words = all(any(map(str.isalpha, name)) for name in one.names)
    return (
        words and len(one.names) < SURE and not is_numbering(one.names) and one.several
        and tests.time is not None and not holds_edges(one.codes, tests)
    )  # fmt: skip


def _numbered_anew(draft: Draft, one: _Labels) -> Ints | None:
    """Codes of edges by the order of the tests, where the names of a column start again in each block of tests."""
    if "t" not in draft.data or not one.several or not one.covers(draft):
        return None
    found = edges_by_design(draft)
    codes = found.codes if found is not None and found.in_order else None
    return codes if codes is not None and _begin_anew(draft, one, codes) else None


def _begin_anew(draft: Draft, one: _Labels, edges: Ints) -> bool:
    """Whether names change where edges do, with more edges than names, whose rows are no copies of earlier rows."""
    begins, renamed = edges[1:] != edges[:-1], one.codes[1:] != one.codes[:-1]
    if edges.max() < len(one.names) or not (begins == renamed).all():
        return False
    return _copied(draft, one) <= _again(one.codes, edges) / 2


def _again(names: Ints, edges: Ints) -> int:
    """Number of rows of edges whose name an earlier edge has."""
    edge_of_name = edges[np.unique(names, return_index=True)[1]]
    return int((edges != edge_of_name[names]).sum())


def _copied(draft: Draft, one: _Labels) -> int:
    """Number of rows that repeat the name and every number of an earlier row; 0 where nothing is measured."""
    numbers = draft.numbers()
    if not any(ROLES[role].kind in MEASURED for role in numbers):
        return 0
    rows = np.column_stack([one.codes, *(np.nan_to_num(values, nan=-1.0) for values in numbers.values())])
    return len(rows) - len(np.unique(rows, axis=0))


def _numbers_rows(one: _Labels, draft: Draft) -> bool:
    """Whether every row has a number of its own under a name such as ``test no`` although rows share edges."""
    if "t" not in draft.data or len(one.names) < NEARLY * len(one.codes) or len(one.codes) != len(draft.lines):
        return False
    found = edges_by_design(draft)
    return found is not None and found.codes is not None and found.in_order


def _number_of_inserts(draft: Draft, tool: _Labels, tests: Tests) -> None:
    """Take the role of the tool from a column that numbers inserts, each with few edges of its own."""
    if len(tool.names) < 3 or not tool.several or (len(tool.names) < SURE and not _numbers_inserts(tool)):
        return
    if "edge" in draft.data:
        edge = draft.codes("edge")[0][:SAMPLE]
        edge = np.unique(edge * (len(tool.names) + 1) + tool.codes, return_index=True)[1]
        of_edge = tool.codes[edge]
    else:
        rows = np.column_stack([tool.codes, *tests.settings.values()])
        of_edge = np.unique(rows, axis=0)[:, 0].astype(np.intp)
    most = float(np.median(np.bincount(of_edge[of_edge >= 0], minlength=len(tool.names))))
    if most > (FEW_EDGES if is_numbering(tool.names) and tool.use.name.casefold() not in GENERAL else 1):
        return
    _give(draft, tool, None)
    draft.assumed.append(
        f"{tool.title} has {len(tool.names)} values with {most:.3g} edge{'s' if most != 1 else ''} in most: numbers of "
        f"inserts, not tool types; --map tool={_typed(tool)} reads it as tool types"
    )


def _typed(one: _Labels) -> str:
    """The name of a column as typed in a command."""
    header = one.use.header
    return f'"{header}"' if any(not (c.isalnum() or c in "_.-") for c in header) else header


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (" ..." if len(names) > 4 else "")


def _infer_readings(draft: Draft, tests: Tests) -> None:
    """Tests without a time whose rows are several readings, as where a mean force is repeated with each roughness."""
    measured = {role: x for role, x in draft.numbers().items() if ROLES[role].kind in ("load", "wear", "surface")}
    for place, use in enumerate(draft.uses):
        if use.role is not None or meant_by(use.name) not in ("run", "edge") or len(measured) < 2:
            continue
        codes, names = numbered(draft.columns[place].labels())
        if "" in names or 2 * len(names) > len(codes) or len(names) < 3 or len(codes) > SAMPLE:
            continue
        order = np.argsort(codes, kind="stable")
        same = codes[order][1:] == codes[order][:-1]
        if any((differs(x[order][1:], x[order][:-1]) & same).any() for x in tests.settings.values()):
            continue
        copied = [role for role, x in measured.items() if (x[order][1:] == x[order][:-1])[same].all()]
        if 0 < len(copied) < len(measured):
            draft.data["edge"] = draft.columns[place].labels()
            draft.assumed.append(
                f"column {use.header!r} has {len(names)} values, in each of which {', '.join(copied)} and the settings "
                "are constant: its rows are readings of one test, and are taken as one edge; --edge none takes them as "
                "independent"
            )
            return


def _infer(draft: Draft, tests: Tests) -> None:
    """Edges from the order of the tests, where it settles them."""
    found = edges_by_design(draft)
    if found is None or found.codes is not None:
        draft.doubts += sub_tests_in_order(draft, tests.settings, tests.time, tests.wear, inferred=found is not None)
    if found is None:
        return
    if found.codes is None:
        draft.doubts.append(Doubt(("edge",), found.sentence, f"--edge {NONE}"))
        return
    if found.shifted:
        roles = " and ".join(found.shifted)
        lines = lines_text(np.unique(np.concatenate(list(found.shifted.values()))))
        what = f"{roles} {'changes' if len(found.shifted) == 1 else 'change'} one row before or after time begins anew"
        end = f"({lines}): {roles if len(found.shifted) == 1 else 'time'} is {SHIFTED}; correct it in the file"
        draft.doubts.append(Doubt((*found.shifted, "t"), f"{what} {end}"))
    if name_by_columns(draft, found.codes):
        return
    count = int(found.codes.max()) + 1
    width = max(2, len(str(count)))
    names = np.array([f"E{i + 1:0{width}d}" for i in range(count)], dtype=object)
    draft.data["edge"] = names[found.codes]
    draft.assumed.append(found.sentence)
