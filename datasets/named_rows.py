"""Rows of a file of tests by name, as the options of corrections state them: edges, lines, or all of them."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Flags
from ..core.errors import UsageError
from ..core.suggestions import did_you_mean
from ..core.text import line_spans
from .draft import Draft
from .tables import Column
from .vocabulary import UNNAMED

_LINES = re.compile(r"(?:lines?|rows?)\s++(?P<lines>[\d\s,-]++)(?:(?<=\s)of\s++(?P<edges>.+))?", re.IGNORECASE)
_LINE_OR_SPAN = re.compile(r"(\d{1,9})(?:\s*+-\s*+(\d{1,9}))?")
_EVERY = "all"
MOST_NAMED = 40  # edges in a refusal
_SHOWN = 4  # cells in a sentence


@dataclass(frozen=True, slots=True)
class RowsOf:
    """The rows of a draft that a target names: ``E07,E11``, ``lines 12,14-16``, ``lines 3 of E2`` or ``all``."""

    draft: Draft

    def of(self, target: str, option: str) -> Flags:
        """Rows of edges, of lines, or all of them; ``option`` begins the refusal of a target that does not exist."""
        target = target.strip()
        if target.lower() == _EVERY:
            return np.ones(len(self.draft.lines), dtype=bool)
        match = _LINES.fullmatch(target)
        if match is None:
            return self._of_edges(target, option)
        within = self._of_edges(match["edges"], option) if match["edges"] else None
        return self._of_lines(match["lines"], within, option)

    def _of_edges(self, target: str, option: str) -> Flags:
        if "edge" not in self.draft.data:
            raise UsageError(
                f"{option}: the file has no edges; name lines, as in 'lines 12,14-16', or the column of the edges with "
                "--edge."
            )
        labels = self.draft.data["edge"]
        names = [str(name) for name in dict.fromkeys(labels.tolist()) if name]
        rows = np.zeros(len(labels), dtype=bool)
        for name in _names_in(target, set(names)):
            if name not in names:
                raise UsageError(f"{option}: there is no edge {name!r}. {_like(name, names)}")
            found = labels == name
            self._refuse_several_pairs(name, found, option)
            rows |= found
        return rows

    def _refuse_several_pairs(self, name: str, rows: Flags, option: str) -> None:
        """Edges of one name on two tools or materials are different edges."""
        labels = [self.draft.data[role][rows] for role in UNNAMED if role in self.draft.data]
        pairs = list(zip(*(label.tolist() for label in labels), strict=True))
        kinds = list(dict.fromkeys(pairs))
        if len(kinds) > 1:
            lines = self.draft.lines[rows]
            each = "; ".join(
                f"{' on '.join(map(str, kind))}: lines "
                + ",".join(line_spans([int(n) for n, pair in zip(lines, pairs, strict=True) if pair == kind]))
                for kind in kinds[:_SHOWN]
            )
            raise UsageError(f"{option}: edge {name!r} is in {len(kinds)} pairs of tool and work; name lines ({each}).")

    def _of_lines(self, text: str, within: Flags | None, option: str) -> Flags:
        lines = self.draft.lines
        rows = np.zeros(len(lines), dtype=bool)
        for first, last in _ranges(text, option):
            found = (lines >= first) & (lines <= last) & (True if within is None else within)
            if not found.any():
                span = f"line {first}" if first == last else f"lines {first} to {last}"
                of = "" if within is None else " of that edge"
                raise UsageError(
                    f"{option}: there is no row{of} in {span}; the rows are in lines {lines.min()} to {lines.max()}."
                    if len(lines)
                    else f"{option}: the file has no rows."
                )
            rows |= found
        if within is None:
            self._refuse_several_rows(rows, option)
        return rows

    def _refuse_several_rows(self, rows: Flags, option: str) -> None:
        """A line may hold rows of several edges, in a wide table or in a folder of files."""
        lines = self.draft.lines[rows]
        if len(set(lines.tolist())) == len(lines) or "edge" not in self.draft.data:
            return
        line = next(n for n in lines.tolist() if np.count_nonzero(lines == n) > 1)
        edges = list(dict.fromkeys(map(str, self.draft.data["edge"][self.draft.lines == line])))
        if len(edges) > 1:
            raise UsageError(
                f"{option}: line {line} holds rows of the edges {', '.join(edges[:_SHOWN])}"
                f"{', ...' if len(edges) > _SHOWN else ''}; name the edge too, as in 'lines {line} of {edges[0]}'."
            )


def readable_but_for(columns: tuple[Column, ...], left_out: Sequence[str]) -> tuple[Column, ...]:
    """The columns without the unreadable cells of the lines that are left out, as they are not used.

    >>> column = Column(1, "VB", "mm", np.array([0.1, np.nan]), True, ((3, "120?"),), 1)
    >>> readable_but_for((column,), ["lines 3-5"])[0].bad_count
    0
    """
    named = [(text, match) for text in left_out if (match := _LINES.fullmatch(text.strip())) and not match["edges"]]
    spans = [span for text, match in named for span in _ranges(match["lines"], f"--leave-out {text}")]

    def without(column: Column) -> Column:
        bad = tuple(cell for cell in column.bad if not any(first <= cell[0] <= last for first, last in spans))
        unseen = column.bad_count - len(column.bad)
        return column if unseen and not bad else replace(column, bad=bad, bad_count=unseen + len(bad))

    return tuple(without(column) if spans and column.bad else column for column in columns)


def _like(name: str, names: Sequence[str]) -> str:
    """The edge that a name may mean: the one of the same number, else the most similar.

    >>> _like("E7", ["E07", "E17"])
    "Did you mean 'E07'?"
    """
    plain, *others = (re.sub(r"0*(\d+)", r"\1", one).casefold() for one in (name, *names))
    same = [one for one, other in zip(names, others, strict=True) if other == plain]
    return f"Did you mean {same[0]!r}?" if same else did_you_mean(name, names[:MOST_NAMED], names="Edges: ")


def _names_in(text: str, known: set[str]) -> Iterator[str]:
    """Names of a list with commas; a known name may hold commas itself.

    >>> list(_names_in("E1, 2,5,E3", {"E1", "2,5", "E3"}))
    ['E1', '2,5', 'E3']
    """
    parts = text.split(",")
    while parts:
        count = next((k for k in range(len(parts), 0, -1) if ",".join(parts[:k]).strip() in known), 1)
        yield ",".join(parts[:count]).strip()
        del parts[:count]


def _ranges(text: str, option: str) -> Iterator[tuple[int, int]]:
    """First and last line of each part of a list such as ``12,14-16``."""
    for part in text.split(","):
        match = _LINE_OR_SPAN.fullmatch(part.strip())
        if match is None or int(match[2] or match[1]) < int(match[1]):
            raise UsageError(f"{option}: {part.strip()!r} is no line; write lines as in 'lines 12,14-16'.")
        yield int(match[1]), int(match[2] or match[1])
