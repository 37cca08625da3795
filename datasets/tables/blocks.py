"""Tables in blocks, one per test below a heading such as "Test 3: V = 150 m/min", as one table."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

from ...core.errors import DataError
from .dialect import TextSource, split_line
from .layout import find_layout, footer_label
from .numerals import Cell, is_missing, is_number
from .worksheet import WorkbookSheet

Rows = list[tuple[int, list[Cell]]]
_Found = tuple[dict[str, tuple[str, str]], tuple[str, str] | None]  # name -> number, unit; word and number of a label

ASSIGNMENT = re.compile(
    r"(?<![^\W\d_])(?P<name>[^\W\d_][\w.']{0,40}+(?:[ ]{1,4}[^\W\d_][\w.']{0,40}+){0,2}"
    r"(?:\s{0,4}[\[(][^\])=]{0,60}[\])])?)\s{0,20}+[=:]\s*+(?P<number>[+-]?\d++(?:[.,]\d++)?+(?:[eE][+-]?\d++)?+)(?![\d:.,/-]*\d)\s*+"
    r"(?P<unit>(?![^\s,;=|)]++\s*+=)[^\W\d_%][^\s,;=|)]*|%|°C)?"
)
_LABEL = re.compile(
    r"(?P<word>[^\W\d_]+(?:\s++(?:no|nr|number|n°)\b\.?)?)(?:\s*+[.#])?\s*+"
    r"(?P<id>[A-Za-z]{0,2}[-_]?\d+[A-Za-z]?|[A-Z])\s*+[:.,;-]?"
)
_KEY_LINES = re.compile(rb"^[^\W\d_][^,;\t|\d:\n]*:[ \t]*\d", re.MULTILINE)
_SNIFFED = 1 << 18  # bytes in which a heading or a second header is looked for
_HEAD = 60  # first lines, of which one is the header
_PAIR = 3  # cells of a row with name, number and unit
_SAMPLE = 2000  # rows in which a second block must begin


@dataclass(slots=True)
class _Heading:
    """Label and conditions of a block, as its heading lines give them."""

    line: int
    label: tuple[str, str] | None = None
    values: dict[str, tuple[str, str]] = field(default_factory=dict)  # name -> number, unit


def without_blocks(source: TextSource, is_unit: Callable[[str], bool]) -> tuple[TextSource, list[str]]:
    r"""The source with the blocks of a text file joined, and a sentence on it; any other source unchanged.

    Heading lines and repeated headers become blank lines, what a heading says becomes cells of its rows: lines keep
    their numbers.

    Raises
    ------
    DataError
        Blocks give a condition in different units.

    >>> text = b"Test 1: V = 100 m/min\nt,VB\n2,0.1\nTest 2: V = 150 m/min\nt,VB\n2,0.2\n"
    >>> joined, said = without_blocks(TextSource("a.csv", text, "utf-8", ",", False), lambda text: False)
    >>> joined.data.decode().split()
    ['Test,V', '[m/min],t,VB', '1,100,2,0.1', '2,150,2,0.2']
    """
    if not _may_be_blocks(source):
        return source, []
    noted = _noted_rows(source, is_unit)
    sample: Rows = [(line, noted.get(line) or list(cells)) for line, cells in islice(source, _SAMPLE)]
    if _joined(sample, source.name, is_unit) is None:
        return source, []
    rows: Rows = [(line, noted.get(line) or list(cells)) for line, cells in source]
    found = _joined(rows, source.name, is_unit)
    if found is None:
        return source, []
    made, said = found
    comments = dict(source.comments())
    delimiter = source.delimiter if source.delimiter not in ("", " ") else "\t"
    out = io.StringIO(newline="")
    writer = csv.writer(out, delimiter=delimiter, lineterminator="\n")
    for line in range(1, max(made) + 1):
        if cells := made.get(line):
            writer.writerow([" ".join(str(cell).split("\n")) for cell in cells])
        else:
            out.write(comments.get(line, "") + "\n")
    return replace(
        source, data=out.getvalue().encode(), encoding="utf-8", delimiter=delimiter, has_sep_line=False
    ), said


def sheet_without_blocks(sheet: WorkbookSheet, is_unit: Callable[[str], bool]) -> tuple[WorkbookSheet, list[str]]:
    """The sheet with its blocks joined, and a sentence on it; any other sheet unchanged.

    Raises
    ------
    DataError
        See `without_blocks`.

    >>> sheet = WorkbookSheet("a.xlsx", "Data", (("V = 100",), ("t",), (2.0,), ("V = 150",), (2.0,)))
    >>> sheet_without_blocks(sheet, lambda text: False)[0].rows
    ((), ('V', 't'), ('100', 2.0), (), ('150', 2.0))
    """
    rows: Rows = [(line, list(cells)) for line, cells in sheet]
    texts = [cell for _, row in rows[:_SAMPLE] for cell in row if isinstance(cell, str) and cell]
    if not any("=" in text or ":" in text for text in texts) and not _repeats(rows[:_SAMPLE]):
        return sheet, []
    if _joined(rows[:_SAMPLE], sheet.name, is_unit) is None:
        return sheet, []
    found = _joined(rows, f"{sheet.name}, sheet {sheet.title!r}", is_unit)
    if found is None:
        return sheet, []
    made, said = found
    return replace(sheet, rows=tuple(tuple(made.get(line, ())) for line, _ in rows), merged={}), said


def _noted_rows(source: TextSource, is_unit: Callable[[str], bool]) -> dict[int, list[Cell]]:
    """Comments that give conditions, and a header repeated in comments where the rows have none, as rows."""
    cut = source.data.rfind(b"\n", 0, _SNIFFED) + 1 if not source.encoding.startswith("utf-16") else 0
    head = replace(source, data=source.data[:cut]) if 0 < cut < len(source.data) else source
    first = next((line for line, text in enumerate(head.lines(), start=1) if text.strip()), 0)
    if not any(line > first and _assignments([text.lstrip("#% \t")], is_unit) for line, text in head.comments()):
        return {}  # comments above the table only
    comments = [(line, text.lstrip("#% \t")) for line, text in source.comments()]
    rows: dict[int, list[Cell]] = {line: [text] for line, text in comments if _assignments([text], is_unit)}
    try:
        bare = find_layout(islice(source, _SAMPLE), is_unit, source.name)
    except DataError:
        return {}
    if not bare.header_line:
        for line, text in comments:
            cells = [cell.strip() for cell in split_line(text, source.delimiter)]
            if line not in rows and len(cells) == bare.width and not any(map(is_number, cells)):
                rows[line] = list(cells)
    return rows


def _may_be_blocks(source: TextSource) -> bool:
    """A quick look: an equals sign, lines such as "vc: 150", or a line of text that is written twice."""
    head = source.data[:_SNIFFED]
    if b"=" in head or (b":" in head and len(_KEY_LINES.findall(head)) > 1):
        return True
    lines = head.split(b"\n", _HEAD)
    texts = [line for line in lines[:_HEAD] if line[:1].isalpha() and not re.search(rb"[,;\t ]-?[\d.]", line)]
    return any(head.count(b"\n" + line) > (line != lines[0]) for line in texts)


def _repeats(rows: Rows) -> bool:
    seen = Counter(tuple(row) for _, row in rows if row and all(isinstance(cell, str) for cell in row) and any(row))
    return any(count > 1 for count in seen.values())


def _joined(rows: Rows, name: str, is_unit: Callable[[str], bool]) -> tuple[dict[int, list[Cell]], list[str]] | None:
    """Rows by line with the headings taken in, and the sentence; None for a table that is not in blocks."""
    headings = {line for line, row in rows if _assignments(row, is_unit) is not None}
    plain = [(line, row) for line, row in rows if line not in headings]
    try:
        layout = find_layout(plain, is_unit, name)
    except DataError:
        return None
    header = next((_texts(row) for line, row in plain if line == layout.header_line), None)
    if header is None or not any(header):
        return None
    units = next((_texts(row) for line, row in plain if line == layout.above > layout.header_line), None)
    blocks, made, order = _walk(rows, headings, (header, units), layout.above, is_unit)
    given = [block for block in blocks if block.label or block.values]
    if len(blocks) < 2 or len(given) not in (0, len(blocks)):
        return None
    if any(block.values for block in blocks) and not set.intersection(*(set(block.values) for block in blocks)):
        return None
    _drop_of_first(blocks)
    return _filled(made, order, blocks, name, layout.header_line)


def _walk(
    rows: Rows,
    headings: set[int],
    head: tuple[list[str], list[str] | None],
    above: int,
    is_unit: Callable[[str], bool],
) -> tuple[list[_Heading], dict[int, list[Cell]], dict[int, int]]:
    """Blocks, the rows that stay by line, and the block of each row of data."""
    blocks: list[_Heading] = []
    made: dict[int, list[Cell]] = {}
    order: dict[int, int] = {}
    pending: _Heading | None = None
    for line, row in rows:
        texts = _texts(row)
        repeated = line > above and texts in head
        label = _label(row) if line not in headings and not repeated else None
        if line in headings or repeated or label:
            if line in headings or label:
                pending = pending or _Heading(line)
                _add(pending, label, _assignments(row, is_unit) if line in headings else None)
            elif pending is None:
                pending = _Heading(line)
            continue
        made[line] = row
        if line > above and any(texts):
            if pending is not None or not blocks:
                blocks.append(pending or _Heading(line))
                pending = None
            order[line] = len(blocks) - 1
    return blocks, made, order


def _filled(
    made: dict[int, list[Cell]], order: dict[int, int], blocks: list[_Heading], name: str, first: int
) -> tuple[dict[int, list[Cell]], list[str]]:
    """The rows with the cells of their headings in front."""
    units: dict[str, tuple[str, int]] = {}
    for block in blocks:
        for key, (_, unit) in block.values.items():
            known, line = units.setdefault(key, (unit, block.line))
            if unit != known:
                raise DataError(
                    f"{name}: {key} is in {known or 'no unit'} in line {line} and in {unit or 'no unit'} in line "
                    f"{block.line}. Use one unit in all headings."
                )
    if not units and not any(block.label for block in blocks):
        return made, [f"The header is repeated {len(blocks) - 1} time{'s' * (len(blocks) > 2)}: read as one table."]
    words = Counter(block.label[0] for block in blocks if block.label)
    keys = [f"{key} [{unit}]" if unit else key for key, (unit, _) in units.items()]
    label = [words.most_common(1)[0][0]] if words else []
    out: dict[int, list[Cell]] = {}
    footers: list[int] = []
    for line, row in made.items():
        if line == first:
            out[line] = [*label, *keys, *row]
        elif line in order and footer_label(row):
            footers.append(line)
        elif line in order:
            block = blocks[order[line]]
            given = [block.values.get(key, ("", ""))[0] for key in units]
            out[line] = [*([block.label[1] if block.label else ""] if label else []), *given, *row]
        else:
            out[line] = [*[""] * (len(label) + len(keys)), *row] if any(_texts(row)) and line > first else row
    what = ", ".join([*label, *units])
    said = [f"The table has {len(blocks)} blocks below headings: read as one, with {what} from the headings."]
    if footers:
        listed = ", ".join(map(str, footers[:6])) + (", ..." if len(footers) > 6 else "")
        said.append(f"Rows of means or sums below the blocks are left out: lines {listed}.")
    return out, said


def _drop_of_first(blocks: list[_Heading]) -> None:
    """Drop what only the first heading gives: it stands above the whole table and stays a note."""
    later = {key for block in blocks[1:] for key in block.values}
    blocks[0].values = {key: value for key, value in blocks[0].values.items() if key in later}


def _add(heading: _Heading, label: tuple[str, str] | None, found: _Found | None) -> None:
    if found is not None:
        heading.values.update(found[0])
        label = found[1]
    heading.label = heading.label or label


def _assignments(row: Sequence[Cell], is_unit: Callable[[str], bool]) -> _Found | None:
    """Conditions of a heading row and its label; None for any other row."""
    filled = [str(cell).strip() for cell in row if str(cell).strip()]
    if len(filled) == _PAIR and is_number(filled[1]) and is_unit(filled[2]) and not is_number(filled[0]):
        return {filled[0]: (filled[1], filled[2])}, None  # three cells: name, number, unit
    if not filled or not any("=" in cell or ":" in cell for cell in filled):
        return None
    text = (" " if any(cell.endswith(("=", ":")) for cell in filled) else ", ").join(filled)
    label = _LABEL.match(text)
    rest = text[label.end() :] if label and "=" not in label[0] and not re.match(r"\s*=", text[label.end() :]) else text
    found = {match["name"].strip(): (match["number"], match["unit"] or "") for match in ASSIGNMENT.finditer(rest)}
    if not found or ("=" not in text and len(filled) > _PAIR):
        return None
    if sum(map(is_number, filled)) > len(found):
        return None
    return found, _named(label) if label and rest is not text else None


def _label(row: Sequence[Cell]) -> tuple[str, str] | None:
    """Word and number of a row that holds only a label, such as "Test 3"."""
    filled = [str(cell).strip() for cell in row if str(cell).strip()]
    if not 1 <= len(filled) <= 2 or is_number(filled[0]) or is_missing(filled[0]) or footer_label(row):
        return None
    match = _LABEL.fullmatch(" ".join(filled)) if len(row) > 1 or len(filled) == 1 else None
    return _named(match) if match and len(match["word"]) > 2 and (len(filled) == 1 or len(row) > 3) else None


def _named(match: re.Match[str]) -> tuple[str, str]:
    return match["word"], match["id"]


def _texts(row: Sequence[Cell]) -> list[str]:
    """Cells as text up to the last filled one."""
    cells = [str(cell).strip() for cell in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells
