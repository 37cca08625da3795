"""Rows -> the places of a table in its file: notes above, header, units row, data, footer."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice

from ...core.errors import DataError
from .header_rows import SampleRow, Words, is_units_row, no_units, read_head
from .numerals import SPREAD, Cell, is_missing, is_number, number_and_rest

SAMPLE = 500  # rows looked at to find header and data
_TOP = 30  # rows among which one may count the columns
_COUNTED = 4  # columns that are counted
_BLANK, _NUMBER, _MARK, _TEXT = range(4)  # kinds of a cell
FOOTERS = frozenset(
    """
    mean/mean value/average/avg/sum/total/grand total/subtotal/std/sd/std dev/stdev/stddev/standard deviation/
    variance/min/minimum/max/maximum/count/median/range/rsd/cv/
    mittelwert/mittel/durchschnitt/mw/ø/summe/gesamt/anzahl/standardabweichung/stabw/stdabw/varianz/
    moyenne/moy/somme/nombre/écart-type/écart type/ecart-type/ecart type/médiane/mediane/
    media/promedio/suma/recuento/cuenta/mediana/desviación/desviacion/desviación estándar/desviacion estandar/
    desviación típica/desviacion tipica/desvest/desv est/desv estándar/desv típica/mín/máx/mínimo/máximo/
    maximalwert/minimalwert/höchstwert/kleinstwert/grösstwert/grösster/kleinster/grösster wert/kleinster wert/
    spannweite/maxi/mini/étendue/dev std/dev st/deviazione standard/scarto tipo/massimo/minimo/somma/conteggio/
    x̄/x̅/x quer/xquer
    """.replace("\n    ", "").split("/")
)
WEAK_FOOTERS = frozenset(("n", "s", "x", "σ", "μ"))  # counts and deviations, below a row of another label only


@dataclass(frozen=True, slots=True)
class Layout:
    """Position of the parts of a table.

    Parameters
    ----------
    header_line : int
        Line of the header row, 0 when there is none.
    names, unit_cells : tuple of str, one per column
        Text as written; ``unit_cells`` holds "" where a cell is empty.
    above : int
        Last line that belongs to the head: rows below it are data.
    note_lines : tuple of int
        Lines of the preamble.
    numeric : tuple of bool
        Which cells of the first full data row are numbers.

    """

    header_line: int
    names: tuple[str, ...]
    unit_cells: tuple[str, ...]
    above: int
    note_lines: tuple[int, ...]
    numeric: tuple[bool, ...]

    @property
    def width(self) -> int:
        """The number of columns."""
        return len(self.names)


def find_layout(
    rows: Iterable[tuple[int, Sequence[Cell]]],
    is_unit: Callable[[str], bool],
    name: str,
    is_name: Callable[[str], bool] = no_units,
    spans: Mapping[tuple[int, int], int] | None = None,
) -> Layout:
    """Find header, units row and first data row among the first rows of a file.

    The width of the table is that of the rows holding most numbers. The header is, of the rows without a
    number above the first row of that width, the one nearest in width, then the fullest, then the lowest.
    Rows of text between it and the data, and rows of group names above it, complete its names: ``is_name``
    says which texts name a quantity, ``spans`` how many columns of a sheet a merged cell of (line, column) covers.

    Raises
    ------
    DataError
        There is a header only, or no row holds a number.

    >>> layout = find_layout([(1, ["Test 5"]), (2, ["V", "f"]), (3, ["1", "2"])], lambda text: False, "a.csv")
    >>> layout.header_line, layout.names, layout.note_lines
    (2, ('V', 'f'), (1,))

    """
    sample = list(islice((row for row in map(_look, rows) if row is not None), SAMPLE))
    if not any(row.numbers for row in sample):
        sample = [row._replace(numbers=sum(_has_unit(cell, is_unit) for cell in row.cells)) for row in sample]
    numbering = next((i for i in range(1, min(len(sample), _TOP)) if _numbers_columns(sample[i - 1], sample[i])), None)
    counts = 0 if numbering is None else sample.pop(numbering).line
    weights: Counter[int] = Counter()
    for row in sample:
        weights[len(row.cells)] += row.numbers**2
    width = max(weights, key=lambda w: (weights[w], w), default=0)
    if not weights[width]:
        raise _no_numbers(sample, name)
    first = next(i for i, row in enumerate(sample) if row.numbers and len(row.cells) == width)
    numeric = tuple(is_number(cell) for cell in sample[first].cells)
    head = _find_head(sample[: first + 1], width, is_unit)
    if head is None:
        while first and _matches(sample[first - 1], numeric):
            first -= 1
        notes = tuple(row.line for row in sample[:first])
        names = tuple(f"col{i + 1}" for i in range(width))
        return Layout(0, names, ("",) * width, sample[first].line - 1, notes, numeric)
    found = read_head(sample, head, first, Words(is_unit, is_name), spans)
    notes = tuple(row.line for row in sample[:head] if row.line < found.first)
    return Layout(sample[head].line, found.names, found.unit_cells, max(found.above, counts), notes, numeric)


def footer_label(cells: Sequence[Cell], labels: frozenset[str] = FOOTERS) -> str:
    """Label of a row of sums or means as written, or "" for any other row.

    >>> footer_label(["", "Mittelwert:", "3,5"]), footer_label(["E1", "3,5"])
    ('Mittelwert:', '')
    """
    label = next((str(cell).strip() for cell in cells if str(cell).strip()), "")
    plain = " ".join(label.casefold().replace(".", " ").split()).strip(" :=")
    return label if plain in labels else ""


def is_text_line(cells: Sequence[Cell], layout: Layout) -> bool:
    """Whether a row at the end of a file is a remark: it has no value where the data rows have numbers.

    A row written to the table's width is a remark only if it fills one cell, and that in a column of numbers;
    else it is a data row without values.

    >>> layout = Layout(1, ("edge", "V"), ("", ""), 1, (), (False, True))
    >>> is_text_line(["Measured by N.N."], layout), is_text_line(["E7", ""], layout)
    (True, False)
    """
    filled = [i for i, cell in enumerate(cells) if str(cell).strip()]
    in_numbers = [i for i in filled if i < len(layout.numeric) and layout.numeric[i]]
    if any(is_number(cells[i]) or is_missing(str(cells[i])) for i in in_numbers):
        return False
    return len(cells) != layout.width or (len(filled) == 1 and filled == in_numbers)


def _numbers_columns(above: SampleRow, row: SampleRow) -> bool:
    """Whether a row below text counts the columns: 1, 2, 3, ... or (1), (2), (3), ..."""
    if not above.is_text or row.filled != len(row.cells) or row.filled < max(_COUNTED, above.filled):
        return False
    texts = [str(int(cell)) if isinstance(cell, float) else cell.strip(" ()[].") for cell in row.cells]
    return texts == list(map(str, range(1, len(texts) + 1)))


def _look(numbered: tuple[int, Sequence[Cell]]) -> SampleRow | None:
    line, written = numbered
    kinds = list(map(_kind, written))
    end = len(kinds)
    while end and kinds[end - 1] == _BLANK:
        end -= 1
    if not end:
        return None
    filled = end - kinds[:end].count(_BLANK)
    return SampleRow(line, tuple(written[:end]), len(written), filled, kinds.count(_NUMBER), kinds.count(_MARK))


@lru_cache(maxsize=2**14)
def _kind(cell: Cell) -> int:
    """Whether a cell is blank, a number, a mark of a missing value, or another text."""
    if isinstance(cell, str) and not cell.strip():
        return _BLANK
    if is_number(cell):
        return _NUMBER
    return _MARK if isinstance(cell, str) and is_missing(cell) else _TEXT


def _has_unit(cell: Cell, is_unit: Callable[[str], bool]) -> bool:
    """Whether a cell holds a number and its unit or spread."""
    rest = number_and_rest(str(cell))[1]
    return rest == SPREAD or (bool(rest) and is_unit(rest))


def _no_numbers(sample: Sequence[SampleRow], name: str) -> DataError:
    if not sample:
        return DataError(f"{name} holds no filled cell. Export the table again.")
    if len(sample) <= 2:
        lines = " and ".join(str(row.line) for row in sample)
        return DataError(
            f"{name} holds a header only (filled lines: {lines}): no row of numbers follows. Export the data rows too."
        )
    return DataError(
        f"{name}: none of its first {len(sample)} filled rows (from line {sample[0].line}) holds a number, "
        "so there is no numeric column. Name the file that holds the measured table."
    )


def _find_head(rows: Sequence[SampleRow], width: int, is_unit: Callable[[str], bool]) -> int | None:
    """Position of the header among the rows up to the first full data row, or None."""
    places = [i for i, row in enumerate(rows[:-1]) if row.is_text and row.filled >= min(2, width)]
    if not places:
        return None
    best = max(places, key=lambda i: (-abs(len(rows[i].cells) - width), rows[i].filled, i))
    if is_units_row(rows[best + 1], rows[best], is_unit):
        return best
    for above in (best - 1, best - 2):
        if above in places and is_units_row(rows[best], rows[above], is_unit):
            return above
    return best


def _matches(row: SampleRow, numeric: Sequence[bool]) -> bool:
    """Whether a row above the first full one is data: no text where that row has numbers."""
    if len(row.cells) > len(numeric) or not row.numbers:
        return False
    pairs = zip(row.cells, numeric, strict=False)
    return all(not number or is_number(cell) or is_missing(str(cell)) for cell, number in pairs)
