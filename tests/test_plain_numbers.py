"""Blocks of nothing but numbers, or of full rows, read as the reader of cells reads them; the others are left to it."""

import csv

import numpy as np
import pytest
from fitmodels.core.errors import DataError
from fitmodels.datasets.tables import gather, plain, read_table
from fitmodels.datasets.tables.numerals import to_floats
from fitmodels.datasets.tables.plain import plain_cells, plain_numbers
from hypothesis import given
from hypothesis import strategies as st

ROWS = 4_500  # two blocks of 2000, and a tail

values = st.floats(allow_nan=False, allow_infinity=False).map(repr) | st.integers().map(str)
odd = st.text("0123456789+-.,eE \t;|", max_size=6)


def cells_of(lines, delimiter, decimal):
    """Python's csv module and float(), or None where a cell is missing or no number, or widths differ."""
    rows = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    if len({len(row) for row in rows}) != 1 or len(rows) != len(lines):
        return None
    columns = [to_floats(column, decimal) for column in zip(*rows, strict=True)]
    if any(bad or np.isnan(floats).any() for floats, bad in columns):
        return None
    return np.column_stack([floats for floats, _ in columns])


@given(st.lists(st.lists(values, min_size=3, max_size=3), min_size=1, max_size=5), st.sampled_from(",;\t|"))
def test_numbers_are_pythons_to_the_last_bit(rows, delimiter):
    lines = [delimiter.join(row) + "\n" for row in rows]
    expected = np.array([[float(cell) for cell in row] for row in rows])
    found = plain_numbers(lines, 3, delimiter, "point")
    if np.isinf(expected).any():
        assert found is None
    else:
        assert found.tobytes() == expected.tobytes()


@given(
    st.lists(st.lists(values | odd, min_size=1, max_size=3), min_size=1, max_size=4),
    st.sampled_from(",;\t|"),
    st.sampled_from(["point", "comma"]),
    st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_it_never_reads_what_the_reader_of_cells_reads_otherwise(rows, delimiter, decimal, end):
    lines = [delimiter.join(row) + end for row in rows]
    found = plain_numbers(lines, len(rows[0]), delimiter, decimal)
    if found is not None:
        assert found.tobytes() == cells_of(lines, delimiter, decimal).tobytes()


@pytest.mark.parametrize(
    "line", ["1,\n", "1,nan\n", "1,inf\n", "1,1e999\n", "1,-\n", "1,2,3\n", "1\n", "\n", '"1",2\n', "1,٣\n", "1,1_0\n"]
)
def test_what_is_no_plain_number_is_left_to_the_reader_of_cells(line):
    assert plain_numbers(["1,2\n", line], 2, ",", "point") is None
    assert plain_numbers([line, "1,2\n"], 2, ",", "point") is None


def numbers(n=ROWS, delimiter=",", mark=".", end="\n"):
    rng = np.random.default_rng(1)
    body = [delimiter.join(f"{x:.5g}".replace(".", mark) for x in row) + end for row in rng.uniform(1.1, 300, (n, 3))]
    return [delimiter.join(["V", "f", "AW"]) + end, *body]


def replaced(line, text, **how):
    lines = numbers(**how)
    lines[line] = text
    return lines


FILES = {
    "numbers alone": numbers(),
    "one block and exactly its tail": numbers(2_200),
    "one row less than that": numbers(2_199),
    "carriage returns": numbers(end="\r\n"),
    "old line ends": numbers(end="\r"),
    "decimal commas": numbers(delimiter=";", mark=","),
    "blanks after delimiters": numbers(delimiter=", "),
    "a sep= line": ["sep=;\n", *numbers(delimiter=";")],
    "a preamble and a units row": ["Test 5,,\n", numbers()[0], "m/min,mm,mm\n", *numbers()[1:]],
    "no header": numbers()[1:],
    "a comment in the second block": replaced(3_000, "# stopped\n"),
    "a missing cell in the second block": replaced(3_000, "100,,0.2\n"),
    "a word in the second block": replaced(3_000, "100,0.1,worn\n"),
    "a row that is short": replaced(3_000, "100,0.1\n"),
    "a row that is too wide": replaced(3_000, "100,0.1,0.2,7\n"),
    "a number too large": replaced(3_000, "100,0.1,1e999\n"),
    "a blank line in the first block": replaced(7, "\n"),
    "blank lines for a whole block": [*numbers(2_000), *2_300 * ["\n"], *numbers(100)[1:]],
    "a footer and a remark": [*numbers(), "Mean,100,0.2\n", "Measured by N.N.\n"],
    "padding below": [*numbers(), *300 * [",,\n"]],
    "a quoted cell": replaced(3_000, '"100","0.1",0.2\n'),
    "a name over two lines": ['"V\n(m/min)",f,AW\n', *numbers()[1:]],
    "a quote never closed": replaced(3_000, '"100,0.1,0.2\n'),
    "a column that turns into text": [*numbers(2_500), *3_000 * ["100,0.1,worn\n"]],
    "a very long cell": replaced(3_000, f"100,0.{'1' * 140_000},0.2\n"),
}


def reported(path):
    """All that is read of a file, or the sentence that refuses it."""
    try:
        table = read_table(path)
    except DataError as refusal:
        return str(refusal)
    columns = [
        (c.number, c.name, c.unit_cell, c.is_numeric, c.bad, c.bad_count, c.values.tolist() if c.is_numeric else None)
        for c in table.columns
    ]
    texts = [c.values.tolist() for c in table.columns if not c.is_numeric]
    return repr((columns, texts, table.lines.tolist(), table.notes, table.warnings, table.dialect))


@pytest.mark.parametrize(
    ("what", "encoding"),
    [*((what, "utf-8") for what in FILES), ("numbers alone", "utf-8-sig"), ("numbers alone", "utf-16")],
)
def test_a_table_is_the_same_as_read_cell_by_cell(what, encoding, tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_bytes("".join(FILES[what]).encode(encoding))
    found = reported(path)
    monkeypatch.setattr(gather, "stretches", lambda body, findings, decimal: body.blocks(findings))
    assert found == reported(path)


def test_names_that_look_like_numbers_are_kept_from_every_block(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    names = ["1"] * 2_500 + ["1E1"] * 500 + ["10"] * 1_500
    path.write_text("VB,edge\n" + "".join(f"0.{k % 7 + 1},{name}\n" for k, name in enumerate(names)))
    known = {"is_label": lambda number, header, unit: header == "edge"}
    assert read_table(path, **known).column("edge").values.tolist() == names
    monkeypatch.setattr(gather, "stretches", lambda body, findings, decimal: body.blocks(findings))
    assert read_table(path, **known).column("edge").values.tolist() == names


def test_blocks_of_numbers_are_read_as_such(tmp_path, monkeypatch):
    taken = []

    def noting(*given_):
        taken.append(plain_numbers(*given_))
        return taken[-1]

    monkeypatch.setattr(plain, "plain_numbers", noting)
    path = tmp_path / "a.csv"
    path.write_text("".join(replaced(3_000, "100,,0.2\n")))
    read_table(path)
    assert [None if block is None else block.shape for block in taken] == [(2_000, 3), None]


@given(
    st.lists(st.lists(st.text("E1.5 \t-;", max_size=3), min_size=1, max_size=4), min_size=1, max_size=5),
    st.sampled_from(",;\t|"),
    st.sampled_from(("\n", "\r\n", "\r")),
)
def test_full_rows_are_split_as_by_the_csv_module(rows, delimiter, end):
    lines = [delimiter.join(row) + end for row in rows]
    found = plain_cells(lines, len(rows[0]), delimiter)
    if found is not None:
        expected = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
        assert list(zip(*found, strict=True)) == [tuple(row) for row in expected]


def test_full_rows_are_found_whatever_ends_their_lines():
    for end in ("\n", "\r\n", "\r"):
        assert plain_cells([f"E 1;2{end}", f"E2;{end}"], 2, ";") == [("E 1", "E2"), ("2", "")]
    assert plain_cells([";2\n"], 2, ";") is None  # may be a blank row


def test_rows_below_full_ones_are_read_on(tmp_path):
    rows = [f"E{i // 6},{i % 7},{i}.5" for i in range(ROWS)]
    rows[2_500] = " E416, 1,2500.5"  # blanks: left to the reader of cells
    file = tmp_path / "a.csv"
    file.write_text("edge,V,t\n" + "\n".join(rows) + "\nMean,3,2250\n")
    table = read_table(file)
    edge, v, t = (column.values for column in table.columns)
    assert edge.tolist() == [f"E{i // 6}" for i in range(ROWS)]
    assert np.array_equal(v, np.arange(ROWS) % 7)
    assert np.array_equal(t, np.arange(ROWS) + 0.5)
    assert table.lines.tolist() == list(range(2, ROWS + 2))
