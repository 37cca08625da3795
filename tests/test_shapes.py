"""Tables of other shapes and with faults of export: read as what they are, refused, or doubted; never shifted."""

from pathlib import Path

import numpy as np
import openpyxl
import pytest
from fitmodels.core.errors import DataError
from fitmodels.datasets import Runs, read_runs

ROWS = [
    (f"E{i + 1}", V, f, d, t, round(0.01 * (V / 100) ** 0.6 * f**0.2 * t**0.5, 4))
    for i, (V, f, d) in enumerate(((100, 0.1, 1), (150, 0.2, 2), (200, 0.3, 1), (150, 0.1, 2)))
    for t in (2, 5, 9)
]
NAMES = ("edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "VB [mm]")


def table(rows=ROWS, names=NAMES, mark=",") -> str:
    return "".join(mark.join(map(str, row)) + "\n" for row in (names, *rows))


def read(folder: Path, text: str, name: str = "a.csv", **options) -> Runs:
    path = folder / name
    path.write_text(text, "utf-8")
    return read_runs(path, **options)


def same(runs: Runs, reference: Runs, roles=("V", "f", "d", "t", "VB")) -> bool:
    return all(np.array_equal(runs.values(role), reference.values(role), equal_nan=True) for role in roles)


def said(runs: Runs) -> str:
    return "\n".join((*runs.assumed, *runs.warnings, *map(str, runs.doubts)))


# Width of the rows


def test_a_header_with_one_name_more_than_every_row_is_refused_beside_its_first_row(tmp_path):
    with pytest.raises(DataError) as refusal:
        read(tmp_path, table([row[1:] for row in ROWS]))
    sentence, header, first = str(refusal.value).split("\n")
    assert "has 6 names, and every row has 5 cells" in sentence
    assert "Remove the extra name" in sentence
    assert header.split("  ")[1].strip() == "edge"
    assert first.split()[0] == "100"
    assert first.endswith("(none)")


def test_a_header_with_one_name_fewer_than_every_row_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"has 5 names, and every row has 6 cells.* Add the missing name"):
        read(tmp_path, table(names=NAMES[1:]))


def test_row_names_of_r_are_left_out(tmp_path):
    runs = read(tmp_path, table([(i, *row) for i, row in enumerate(ROWS, start=1)]))
    assert same(runs, read(tmp_path, table(), "b.csv"))
    assert "Every row begins with its number" in said(runs)


def test_the_index_column_of_pandas_is_left_out(tmp_path):
    runs = read(tmp_path, table([(i, *row) for i, row in enumerate(ROWS)], ("", *NAMES)))
    assert same(runs, read(tmp_path, table(), "b.csv"))


def test_an_empty_name_before_the_others_is_left_out(tmp_path):
    runs = read(tmp_path, table(names=("", *NAMES)))
    assert same(runs, read(tmp_path, table(), "b.csv"))
    assert "first name of the header is empty" in said(runs)


@pytest.mark.parametrize("end", [",", ",,,"])
def test_delimiters_at_the_end_of_rows_are_no_shift(tmp_path, end):
    header, *rows = table().splitlines()
    runs = read(tmp_path, "\n".join([header, *(row + end for row in rows)]))
    assert same(runs, read(tmp_path, table(), "b.csv"))
    assert not runs.doubts


def test_a_remark_column_without_a_remark_is_no_shift(tmp_path):
    assert same(read(tmp_path, table(names=(*NAMES, "Remarks"))), read(tmp_path, table(), "b.csv"))


def test_a_single_short_row_is_doubted_where_another_cell_may_be_missing(tmp_path):
    rows = [row[1:] for row in ROWS]
    rows[4] = (*rows[4][:2], *rows[4][3:])  # the depth of line 6 is missing
    runs = read(tmp_path, table(rows, NAMES[1:]))
    assert "line 6 of the file: the row is short, and 'VB [mm]' counts as missing" in str(runs.doubts[0])
    assert np.isnan(runs.values("VB")[4])


# Characters that cannot be seen


@pytest.mark.parametrize("mark", ["\u200b", "\u200d", "\ufeff", "\u00ad", "\u200e", "\u2060", "\x7f"])
@pytest.mark.parametrize("place", ["f", "[mm/rev]", "0.2", "E2"])
def test_invisible_characters_are_removed_and_named(tmp_path, mark, place):
    runs = read(tmp_path, table().replace(place, f"{place[0]}{mark}{place[1:]}"))
    assert same(runs, read(tmp_path, table(), "b.csv"))
    assert runs.labels("edge").tolist() == [row[0] for row in ROWS]
    assert "Invisible characters are removed" in said(runs)


@pytest.mark.parametrize("blank", ["\u00a0", "\u2009", "\u202f"])
def test_blanks_of_all_kinds_are_blanks(tmp_path, blank):
    header, *rows = table().splitlines()
    runs = read(tmp_path, "\n".join([header.replace(" ", blank), *(row.replace(",", f"{blank},") for row in rows)]))
    assert same(runs, read(tmp_path, table(), "b.csv"))
    assert sorted(set(runs.labels("edge"))) == ["E1", "E2", "E3", "E4"]


def test_invisible_characters_of_a_workbook_are_removed(tmp_path):
    book = openpyxl.Workbook()
    for row in (("edge\u200b", "V\u200b [m/min]", "f [mm\u200b/rev]", *NAMES[3:]), *ROWS):
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    runs = read_runs(tmp_path / "a.xlsx")
    assert same(runs, read(tmp_path, table(), "b.csv"))
    assert "zero width space in line 1" in said(runs)


# Decimal marks of single cells


@pytest.mark.parametrize(("file", "cell"), [("point", '"1,200"'), ("comma", '"1.200"')])
def test_a_decimal_taken_for_thousands_is_left_out_and_doubted(tmp_path, file, cell):
    text = table(mark=";").replace(";0.2;2;", f";0.2;{cell};", 1)
    if file == "comma":
        text = text.replace("0.", "0,")
    runs = read(tmp_path, text)
    assert np.isnan(runs.values("d")[3])
    assert "d [mm], line 5" in said(runs)
    assert "Left out" in said(runs)


def test_thousands_among_hundreds_are_thousands(tmp_path):
    names = (*NAMES, "Fc [N]")
    forces = [850 + 40 * i for i in range(len(ROWS))]
    runs = read(tmp_path, table([(*row, f'"{F:,}"') for row, F in zip(ROWS, forces, strict=True)], names))
    assert runs.values("Fc").tolist() == forces
    assert not runs.doubts


# Marked numbers


def test_marked_values_are_kept_beside_the_column_and_doubted(tmp_path):
    rows = [list(row) for row in ROWS]
    for place, cell in ((0, "<0.05"), (3, "> 0.3"), (5, "0.24*"), (7, "ca. 0.2"), (8, "~0.2"), (9, ">= 300 um")):
        rows[place][5] = cell
    runs = read(tmp_path, table(rows))
    marks = runs.labels("VB mark")
    assert marks.tolist() == ["<0.05", "", "", ">0.3", "", "0.24*", "", "~0.2", "~0.2", ">0.3", "", ""]
    assert np.flatnonzero(np.isnan(runs.values("VB"))).tolist() == [0, 3, 5, 7, 8, 9]
    assert "VB: 6 marked values" in str(runs.doubts[0])
    assert "line 2 '<0.05'" in str(runs.doubts[0])


def test_marks_are_converted_with_their_column_and_survive_pairs_and_join(tmp_path):
    rows = [[*row[:5], 1000 * row[5]] for row in ROWS]
    rows[2][5] = "<50"
    runs = read(tmp_path, table(rows, (*NAMES[:5], "VB [um]")))
    assert runs.labels("VB mark")[2] == "<0.05"
    assert next(runs.pairs()).labels("VB mark")[2] == "<0.05"
    plain = read(tmp_path, table(), "b.csv")
    assert [runs.join(plain).labels("VB mark")[2], plain.join(runs).labels("VB mark")[len(ROWS) + 2]] == ["<0.05"] * 2


def test_labels_with_a_mark_stay_labels(tmp_path):
    runs = read(tmp_path, table([(f"{i}*" if i % 3 == 0 else str(i), *row[1:]) for i, row in enumerate(ROWS)]))
    assert runs.labels("edge")[:4].tolist() == ["0*", "1", "2", "3*"]
