"""Workbooks as laboratories keep them: cover sheets, several header rows, hidden parts, formulas, other formats.

Every book is written by a library nobody here wrote (openpyxl, xlwt, odfpy) and holds the same table of known laws.
"""

import datetime
import io
import re
import sys
import zipfile
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import xlwt
from fitmodels import datasets
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets import read_runs, read_table
from odf.opendocument import OpenDocumentSpreadsheet
from odf.table import Table as OdfTable
from odf.table import TableCell, TableColumn, TableRow
from odf.text import P

sys.path.insert(0, str(Path(__file__).parent))
from laboratory_workbooks import xlsb

sys.path.remove(str(Path(__file__).parent))

RNG = np.random.default_rng(5)
HEADER = ["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "VB [mm]"]
DESIGN = [(V, f, d) for V in (100.0, 160.0, 220.0) for f in (0.1, 0.25) for d in (1.0, 2.0)]
ROWS = [
    [f"E{e}", V, f, d, t, round(4e-4 * V**0.8 * f**0.4 * d**0.2 * t**0.5 * float(np.exp(RNG.normal(0, 0.02))), 5)]
    for e, (V, f, d) in enumerate(DESIGN, start=1)
    for t in (2.0, 5.0, 9.0)
]
ROLES = ("V", "f", "d", "t", "VB")


def fill(page, lines):
    for line in lines:
        page.append(line)


def book(tmp_path, name="a.xlsx", **sheets):
    """A book of sheets, each a list of rows or a function that fills the page."""
    made = openpyxl.Workbook()
    made.remove(made.active)
    for title, content in sheets.items():
        page = made.create_sheet(title)
        content(page) if callable(content) else fill(page, content)
    made.save(tmp_path / name)
    return tmp_path / name


def check(runs, rows=ROWS):
    """The runs are the rows of the table, in the units of their roles."""
    for i, role in enumerate(ROLES, start=1):
        np.testing.assert_allclose(runs.values(role), [row[i] for row in rows], rtol=1e-12, err_msg=role)
    assert list(runs.data["edge"]) == [row[0] for row in rows]


def said(runs):
    return " | ".join((*runs.warnings, *runs.notes, *runs.assumed))


# Sheets


COVER = [["Test report"], [], ["Tool", "GC4325"], ["Material", "C45"], ["Diameter", 80], ["Operator", "N.N."]]


def first_own_file(page):
    """Title, group names over merged cells, symbols, units, and remarks beside the table."""
    fill(page, [["Versuchsreihe 3"], []])
    page.append(["Schneide", "Schnittbedingungen", None, None, None, "Verschleiß", "Bemerkung"])
    page.append([None, "vc", "f", "ap", "t", "VB"])
    page.append([None, "[m/min]", "[mm/U]", "[mm]", "[min]", "[mm]"])
    page.merge_cells("A3:A4")
    page.merge_cells("B3:E3")
    fill(page, [[*row, "Ausbruch" if i % 7 == 3 else None] for i, row in enumerate(ROWS)])
    fill(page, [[], ["Gemessen von N.N."]])


def test_the_first_own_file_needs_no_flag(tmp_path):
    runs = read_runs(book(tmp_path, Deckblatt=COVER, Messwerte=first_own_file))
    check(runs)
    assert (runs.tool, runs.work) == ("GC4325", "C45")
    assert "Sheet 'Messwerte' is read; not read: 'Deckblatt'." in runs.notes
    assert [use.header for use in runs.columns] == ["Schneide", "vc", "f", "ap", "t", "Verschleiß VB", "Bemerkung"]


def test_a_remark_column_without_a_name(tmp_path):
    rows = [[*row, "chipping"] if i % 9 == 4 else row for i, row in enumerate(ROWS)]
    check(read_runs(book(tmp_path, Data=[HEADER, *rows])))


def test_a_table_between_blank_columns_and_rows(tmp_path):
    lines = [[], [None, None, "Lab book 7"], [], *([None, None, line[0], None, *line[1:]] for line in [HEADER, *ROWS])]
    lines[10:10] = [[], []]
    check(read_runs(book(tmp_path, Data=lines)))


def test_sheets_equally_good_are_listed(tmp_path):
    other = [[*row[:5], 2 * row[5]] for row in ROWS]
    path = book(tmp_path, Info=COVER, Dry=[HEADER, *ROWS], Wet=[[*HEADER[:5], "Ra [um]"], *other])
    with pytest.raises(DataError, match=r"--sheet Dry \(36 rows\), --sheet Wet \(36 rows\)"):
        read_runs(path)
    check(read_runs(path, sheet="Dry"))
    with pytest.raises(UsageError, match=r"no sheet 'Dri'\. Did you mean 'Dry'"):
        read_runs(path, sheet="Dri")


def test_a_summary_before_the_table_is_not_read(tmp_path):
    summary = [["edge", "mean VB [mm]"], *([f"E{e}", 0.01 * e] for e in range(1, 13))]
    runs = read_runs(book(tmp_path, Summary=summary, Data=[HEADER, *ROWS], Lists=[["steel"], ["C45"]]))
    check(runs)
    assert "not read: 'Summary', 'Lists'" in said(runs)


# Header rows


NAMES = ["Schneide", "Schnittgeschwindigkeit", "Vorschub", "Schnitttiefe", "Zeit", "Freiflächenverschleiß"]
SYMBOLS = [None, "vc", "f", "ap", "t", "VB"]
UNITS = [None, "m/min", "mm", "mm", "min", "mm"]
GROUPED = [
    [["edge", "Cutting conditions", None, None, "Test", None], [None, *HEADER[1:]]],
    [NAMES, SYMBOLS, UNITS],
    [NAMES, ["-", *UNITS[1:]]],
    [["Schneide", *SYMBOLS[1:]], ["", "[m/min]", "[mm/U]", "[mm]", "[min]", "[mm]"]],
    [[None, "Cutting conditions", None, None, None, "Wear [mm]"], ["edge", "V", "f", "d", "t", "VB"]],
    [["edge", "Conditions", None, None, "Time", "Wear"], [None, "V", "f", "d", None, "VB"], ["-", *UNITS[1:]]],
    [HEADER, [1, 2, 3, 4, 5, 6]],
    [HEADER, ["(1)", "(2)", "(3)", "(4)", "(5)", "(6)"]],
    [["Tool:", "K10"], ["Lab", "A"], HEADER],
]


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("head", GROUPED)
def test_header_rows(tmp_path, head, text):
    path = tmp_path / "a.csv"
    if text:
        lines = [";".join("" if cell is None else str(cell) for cell in row) for row in [*head, *ROWS]]
        path.write_text("\n".join(lines), encoding="utf-8")
    else:
        path = book(tmp_path, Data=[*head, *ROWS])
    check(read_runs(path))


def test_the_unit_of_a_group_is_kept(tmp_path):
    head = [["edge", "V", "f", "d", "t", "Flank wear [µm]", None], [None, None, None, None, None, "VB", "other"]]
    rows = [[*row[:5], 1000 * row[5], 0.1] for row in ROWS]
    runs = read_runs(book(tmp_path, Data=[*head, *rows]))
    np.testing.assert_allclose(runs.values("VB"), [row[5] for row in ROWS])


def test_names_of_a_group_stay_apart(tmp_path):
    head = [["edge", "VB", None, "AW", None], [None, "mean", "max", "mean", "max"]]
    rows = [[f"E{i}", 0.1, 0.2, 0.3, 0.4 + i] for i in range(5)]
    table = read_table(book(tmp_path, Data=[*head, *rows]), is_name=lambda text: text in ("edge", "VB", "AW"))
    assert [column.name for column in table.columns] == ["edge", "VB mean", "VB max", "AW mean", "AW max"]


# Hidden, merged, uncomputed


def test_hidden_rows_and_columns_are_left_out_by_name(tmp_path):
    def page(page):
        fill(page, [[*HEADER[:5], "raw", HEADER[5]], *([*row[:5], 9.0, row[5]] for row in ROWS)])
        fill(page, [["E1", 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]])
        for line in (5, 6, 7, 38):
            page.row_dimensions[line].hidden = True
        page.column_dimensions["F"].hidden = True
        page.column_dimensions.group("I", "XFD", hidden=True)  # the empty rest of the sheet, as many hide it

    path = book(tmp_path, Data=page)
    runs = read_runs(path)
    check(runs, ROWS[:3] + ROWS[6:])
    assert "Hidden columns are left out: F 'raw'; --hidden reads them." in runs.warnings
    assert "Hidden rows are left out: 5 to 7, 38; --hidden reads them." in runs.warnings
    whole = read_runs(path, hidden=True)
    assert len(whole) == len(ROWS) + 1
    assert "raw" in whole.data
    assert not whole.warnings


def test_a_hidden_sheet_is_read_only_if_asked(tmp_path):
    def page(page):
        fill(page, [HEADER, *ROWS])
        page.sheet_state = "hidden"

    path = book(tmp_path, Old=page, New=[HEADER, *ROWS[:12]])
    assert len(read_runs(path)) == 12
    assert len(read_runs(path, sheet="Old")) == 36


def test_merged_cells_of_the_data_are_read_in_each_row(tmp_path):
    def page(page):
        fill(page, [HEADER, *ROWS])
        for top in range(2, 38, 3):
            for letter in "ABCD":
                page.merge_cells(f"{letter}{top}:{letter}{top + 2}")

    runs = read_runs(book(tmp_path, Data=page))
    check(runs)
    assert "The value of merged cells is read in each of their rows: A2:A4, B2:B4" in said(runs)


def test_texts_stay_names_beside_whole_numbers(tmp_path):
    rows = [["tool", "edge", "V", "VB"], ["007", 1, 100, 0.1], [7, 2, 150, 0.2], ["5E2", 3, 200, 0.3]]
    runs = datasets.read_runs(book(tmp_path, Tests=rows))
    assert [(pair.tool, *pair.labels("edge")) for pair in runs.pairs()] == [("007", "1"), ("7", "2"), ("5E2", "3")]


def test_formulas_without_values_are_named(tmp_path):
    rows = [[*row, "=2*B2"] for row in ROWS]
    rows[3][5] = "=A1/1000"
    runs = read_runs(book(tmp_path, Data=[[*HEADER, "check"], *rows]))
    assert "37 cells are formulas without a stored value (G2, G3, G4, F5, G5, G6 and 31 more)" in said(runs)
    assert "open the file in Excel or LibreOffice and save it" in said(runs)
    only = [[row[0], *["=1+1"] * 5] for row in ROWS]
    with pytest.raises(DataError, match=r"180 cells are formulas without a stored value \(B2, C2"):
        read_runs(book(tmp_path, Data=[HEADER, *only]))


# Formats


def with_sheet(tmp_path, change):
    """A workbook with the XML of its sheet changed."""
    path, out = book(tmp_path, Data=lambda page: fill(page, [HEADER, *ROWS])), tmp_path / "changed.xlsx"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for one in old.infolist():
            data = old.read(one)
            new.writestr(one, change(data.decode()).encode() if one.filename.endswith("sheet1.xml") else data)
    return out


def shuffled(tag, xml):
    """All but the first of the elements of a row, or of the cells of each row, in another order."""
    if tag == "c":
        return re.sub(r"(<row [^>]*>)(.*?)</row>", lambda row: row[1] + shuffled("cells", row[2]) + "</row>", xml)
    found = re.findall(r"<row .*?</row>" if tag == "row" else r"<c .*?</c>", xml)
    return xml.replace("".join(found), "".join([found[-1], *found[:1], *reversed(found[1:-1])]))


@pytest.mark.parametrize("tag", ["row", "c"])
def test_rows_and_cells_in_another_order_stand_at_their_places(tmp_path, tag):
    """ISO/IEC 29500 numbers rows and cells; some writers do not write them in ascending order."""
    check(read_runs(with_sheet(tmp_path, lambda xml: shuffled(tag, xml))))


def test_a_row_that_is_there_twice_is_refused(tmp_path):
    path = with_sheet(tmp_path, lambda xml: xml.replace('<row r="4"', '<row r="3"'))
    with pytest.raises(DataError, match=r"row 3 of sheet 'Data' is there twice"):
        read_runs(path)


def as_xls(path):
    made = xlwt.Workbook()
    cover, page = made.add_sheet("Cover"), made.add_sheet("Data")
    cover.write(0, 0, "Tool"), cover.write(0, 1, "GC4325")
    for i, row in enumerate([[], [], HEADER, *ROWS]):
        for j, cell in enumerate(row, start=1):
            page.write(i, j, cell)
    made.save(path)


def as_ods(path):
    made = OpenDocumentSpreadsheet()
    for title, rows in (("Cover", [["Tool", "GC4325"]]), ("Data", [[], [], HEADER, *ROWS])):
        page = OdfTable(name=title)
        for row in rows:
            line = TableRow()
            for cell in row:
                text = isinstance(cell, str)
                made_cell = TableCell(valuetype="string") if text else TableCell(valuetype="float", value=cell)
                made_cell.addElement(P(text=str(cell)))
                line.addElement(made_cell)
            page.addElement(line)
        made.spreadsheet.addElement(page)
    made.save(path)


def as_xlsb(path):
    """By hand: no library writes this format (see laboratory_workbooks)."""
    Path(path).write_bytes(xlsb([["Tool", "GC4325"], [], HEADER, *ROWS]))


@pytest.mark.parametrize(("make", "suffix", "kind"), [
    (as_xls, "xls", "Excel workbook (.xls)"), (as_ods, "ods", "OpenDocument spreadsheet"),
    (as_xlsb, "xlsb", "Excel workbook (.xlsb)"),
])  # fmt: skip
def test_other_formats(tmp_path, make, suffix, kind):
    path = tmp_path / f"a.{suffix}"
    make(str(path))
    runs = read_runs(path)
    check(runs)
    assert runs.tool == "GC4325"
    assert runs.source.dialect == kind
    renamed = tmp_path / "a.dat"
    renamed.write_bytes(path.read_bytes())
    check(read_runs(renamed))


def test_an_ods_hides_rows_and_columns(tmp_path):
    made, page = OpenDocumentSpreadsheet(), OdfTable(name="Data")
    page.addElement(TableColumn(numbercolumnsrepeated=6))
    page.addElement(TableColumn(visibility="collapse"))
    for i, row in enumerate([[*HEADER, "old"], *([*row, 9.0] for row in ROWS)]):
        line = TableRow(visibility="filter") if 3 <= i < 9 else TableRow()
        for cell in row:
            line.addElement(one := TableCell(**ods_value(cell)))
            one.addElement(P(text=str(cell)))
        page.addElement(line)
    made.spreadsheet.addElement(page)
    made.save(str(tmp_path / "a.ods"))
    runs = read_runs(tmp_path / "a.ods")
    check(runs, ROWS[:2] + ROWS[8:])
    assert "Hidden columns are left out: G 'old'" in said(runs)
    assert "Hidden rows are left out: 4 to 9" in said(runs)
    assert len(read_runs(tmp_path / "a.ods", hidden=True)) == 36


def ods_value(cell):
    return {"valuetype": "string"} if isinstance(cell, str) else {"valuetype": "float", "value": cell}


@pytest.mark.parametrize("make", [as_xls, as_xlsb])
def test_hidden_cells_that_cannot_be_determined_are_mentioned(tmp_path, make):
    make(str(tmp_path / "a.xls"))
    assert (
        "Hidden rows and columns of this format cannot be recognized and are read."
        in read_runs(tmp_path / "a.xls").notes
    )


@pytest.mark.parametrize("make", [as_xls, as_ods, as_xlsb, None])
def test_damaged_books_give_one_sentence(tmp_path, make):
    path = tmp_path / "a.bin"
    if make is None:
        book(tmp_path, "a.bin", Data=[HEADER, *ROWS])
    else:
        make(str(path))
    whole = path.read_bytes()
    for place in np.linspace(0.05, 0.95, 12):
        cut = int(place * len(whole))
        for data in (whole[:cut], whole[:cut] + bytes(64) + whole[cut + 64 :]):
            path.write_bytes(data)
            try:
                read_runs(path)
            except DataError as refusal:
                assert "\n" not in str(refusal)  # noqa: PT017


def test_a_password_is_named(tmp_path):
    path = tmp_path / "a.xlsx"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(2000) + "EncryptedPackage".encode("utf-16-le"))
    with pytest.raises(DataError, match="protected by a password"):
        read_runs(path)


def test_bytes_of_a_text_named_as_a_book(tmp_path):
    path = tmp_path / "a.ods"
    path.write_text("V,f,d,t,VB\n100,0.1,1,2,0.1\n110,0.1,1,2,0.1\n")
    assert len(datasets.read_runs(path)) == 2
    assert io.BytesIO(path.read_bytes()).read(1) == b"V"


# Averages


def text_of(rows, header=HEADER):
    return "\n".join(";".join("" if cell is None else str(cell) for cell in row) for row in [header, *rows])


def with_averages(label, edge=3, digits=6):
    """The rows with their mean after each edge."""
    rows = []
    for i in range(0, len(ROWS), edge):
        part = ROWS[i : i + edge]
        means = [round(float(np.mean([row[j] for row in part])), digits) for j in range(1, 6)]
        rows += [*part, [part[0][0] if label is None else label.format(part[0][0]), *means]]
    return rows


@pytest.mark.parametrize(
    "label", ["Mean", "Mittelwert {}", "moyenne:", "media", "Ø", "{} average", "Std. dev. {}", None, ""]
)
@pytest.mark.parametrize("name", ["a.csv", "a.xlsx"])
def test_averages_among_the_data_are_left_out_by_line(tmp_path, label, name):
    path = tmp_path / name
    if name == "a.csv":
        path.write_text(text_of(with_averages(label)), encoding="utf-8")
    else:
        book(tmp_path, Data=[HEADER, *with_averages(label, digits=15)])
    runs = read_runs(path)
    check(runs)
    lines = [line for line in range(2, 50) if line not in runs.lines]
    assert lines[:3] == [5, 9, 13]
    words = "Rows of averages are left out: lines 5, 9" if label else "Rows that are the mean of the rows above them"
    assert words in said(runs)


def test_the_mean_of_all_rows_is_left_out(tmp_path):
    rows = [*ROWS, *([f"F{row[0][1:]}", *row[1:5], round(1.1 * row[5], 5)] for row in ROWS)]
    means = [sum(row[j] for row in rows) / len(rows) for j in (4, 5)]
    runs = read_runs(book(tmp_path, Data=[HEADER, *rows, [None, None, None, None, *means]]))
    check(runs, rows)
    assert "The mean of the rows above it is left out: line 74." in runs.warnings


@pytest.mark.parametrize("seed", range(20))
def test_a_sound_table_loses_no_row(tmp_path, seed):
    """Replicates, centre points and rounded forces: means occur among the conditions, never in all columns."""
    rng = np.random.default_rng(seed)
    corners = [(V, f) for V in (100, 200) for f in (0.1, 0.3)]
    design = [(150, 0.2) if i % 5 == 4 else corners[i % 5] for i in range(20)]
    rows = [
        [V, f, 1, 5, round(100 + 3 * V * f + rng.normal(0, 2)), round(0.1 + rng.normal(0, 0.01), 3)] for V, f in design
    ]
    path = tmp_path / "a.csv"
    path.write_text(text_of(rows, ["V", "f", "d", "t", "Fc", "VB"]))
    assert len(read_runs(path)) == 20
    path.write_text(text_of([[V, f] for V, f in design], ["V", "f"]))
    assert len(read_runs(path)) == 20


def test_names_that_resemble_labels_are_kept(tmp_path):
    rows = [[("mean", "max")[i % 2], 100 + i, i / 8 + 0.1] for i in range(8)]
    path = tmp_path / "a.csv"
    path.write_text(text_of(rows, ["value", "V", "VB"]))
    assert len(read_runs(path)) == 8
    rows = [[("K10", "dureza media")[i % 2], 100 + i, i / 8 + 0.1] for i in range(8)]
    path.write_text(text_of(rows, ["work", "V", "VB"]))
    assert len(read_runs(path)) == 8


# Times


def timed(tmp_path, times, header="t", **options):
    """The times of a file of one speed, and its runs."""
    path = tmp_path / "a.csv"
    path.write_text(
        text_of([[100, 0.2, 1, t, 0.1 + 0.01 * i] for i, t in enumerate(times)], ["V", "f", "d", header, "VB"])
    )
    return read_runs(path, **options)


@pytest.mark.parametrize(("times", "header", "options", "minutes"), [
    (["2:30", "5:00", "14:30"], "t", {}, [2.5, 5, 14.5]),
    (["0:02:30", "0:05:00", "0:14:30"], "Zeit", {}, [2.5, 5, 14.5]),
    (["0:15", "0:45", "1:30"], "t", {"units": {"t": "h:mm"}}, [15, 45, 90]),
    (["0:15", "0:45", "1:30"], "t", {"units": {"t": "mm:ss"}}, [0.25, 0.75, 1.5]),
    (["0:15", "0:45", "1:30"], "t [mm:ss]", {}, [0.25, 0.75, 1.5]),
    (["0:15", "0:45", "1:30"], "cutting time (hh:mm)", {}, [15, 45, 90]),
    (["0:15", "0:45", "1:30"], "cutting time in min", {}, [0.25, 0.75, 1.5]),
    (["2 min 30 s", "5 min", "1 h 20 min"], "t", {}, [2.5, 5, 80]),
    (["45:10", "1:02:30", "1:15:00"], "t", {"units": {"t": "mm:ss"}}, [45 + 1 / 6, 62.5, 75]),
    (["0", "1:30", "13:00"], "t", {}, [0, 1.5, 13]),
])  # fmt: skip
def test_clock_times(tmp_path, times, header, options, minutes):
    runs = timed(tmp_path, times, header, **options)
    np.testing.assert_allclose(runs.values("t"), minutes)
    assert " is read as " in said(runs)


def test_clock_times_of_two_readings_are_refused_with_both_options(tmp_path):
    with pytest.raises(DataError, match=r"0:30 may be .*--unit t=h:mm or --unit t=mm:ss"):
        timed(tmp_path, ["0:30", "1:00", "1:30"])


def test_times_of_day_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"times of day \(10:02.*since the start of each edge"):
        timed(tmp_path, ["10:02", "10:04", "10:09"])
    assert timed(tmp_path, ["10:02", "10:04", "10:09"], units={"t": "mm:ss"}).values("t")[0] == pytest.approx(
        10 + 2 / 60
    )


def test_times_of_day_that_begin_anew_with_each_edge(tmp_path):
    clock = ["10:02", "10:04", "10:09"] * 3
    with pytest.raises(DataError, match="times of day"):
        timed(tmp_path, clock)
    with pytest.raises(DataError, match="times of day"):
        timed(tmp_path, clock, "stamp", map={"t": "stamp"})
    (doubt,) = (doubt for doubt in timed(tmp_path, clock, "stamp").doubts if "stamp" in doubt.columns)
    assert "'stamp' (10:02) holds times of day and is not used" in doubt.sentence


def test_stamps_with_date_and_time_are_pointed_out(tmp_path):
    stamps = [f"2024-03-0{day} {hour}:15" for day in (1, 2) for hour in (9, 10, 11)]
    assert [doubt.columns for doubt in timed(tmp_path, stamps, "measured at").doubts] == [("measured at",)]
    assert not timed(tmp_path, ["2024-03-01 9:15"] * 3 + ["2024-03-02 9:15"] * 3, "measured at").doubts


def test_clock_times_without_a_known_name_are_pointed_out(tmp_path):
    (doubt,) = (d for d in timed(tmp_path, ["2:30", "5:00", "14:30"], "Lap").doubts if "Lap" in d.columns)
    assert doubt.remedy == "--map t=Lap"
    assert timed(tmp_path, ["2:30", "5:00", "14:30"], "Lap", map={"t": "Lap"}).values("t").tolist() == [2.5, 5, 14.5]


@pytest.mark.parametrize(
    ("code", "doubts"), [("mm:ss", 0), ("[mm]:ss", 0), ("h:mm:ss", 0), ("[h]:mm:ss", 0), ("h:mm", 1)]
)
def test_times_of_a_workbook(tmp_path, code, doubts):
    """Numbers of days, shown by the format; 15:00 shown as h:mm may be 15 hours or 15 minutes."""

    def page(page):
        fill(
            page,
            [
                HEADER,
                *(
                    [*row[:4], datetime.timedelta(minutes=row[4] if code != "h:mm" else 60 * row[4]), row[5]]
                    for row in ROWS
                ),
            ],
        )
        for (cell,) in page.iter_rows(min_row=2, min_col=5, max_col=5):
            cell.number_format = code

    runs = read_runs(book(tmp_path, Data=page))
    check(runs)
    assert len(runs.doubts) == doubts


# Cells


def test_errors_of_formulas_are_named(tmp_path):
    rows = [list(row) for row in ROWS]
    rows[4][5], rows[6][3] = "#DIV/0!", "#REF!"
    for path in (book(tmp_path, Data=[HEADER, *rows]), tmp_path / "a.csv"):
        if path.suffix == ".csv":
            path.write_text(text_of(rows))
        runs = read_runs(path)
        assert "an error of a formula count as missing: 'd [mm]' line 8 #REF!, 'VB [mm]' line 6 #DIV/0!." in said(runs)
        assert np.flatnonzero(np.isnan(runs.values("VB"))).tolist() == [4]


def test_numbers_as_text_with_an_apostrophe(tmp_path):
    rows = [[row[0], *(f"'{cell}" for cell in row[1:])] for row in ROWS]
    check(read_runs(book(tmp_path, Data=[HEADER, *rows])))


def test_a_number_turned_into_a_date_is_explained(tmp_path):
    rows = [list(row) for row in ROWS]
    rows[5][3] = datetime.date(2024, 2, 1)
    with pytest.raises(DataError, match=r"line 7: '2024-02-01'.* a date \(1.2 into 1 February\): type the number"):
        read_runs(book(tmp_path, Data=[HEADER, *rows]))


@pytest.mark.parametrize("text", ["01. Mai", "May-01", "01.05.2026", "1-Feb", "5/1/2026"])
def test_a_text_that_a_spreadsheet_made_of_a_number_is_explained(tmp_path, text):
    rows = [list(row) for row in ROWS]
    rows[5][3] = text
    with pytest.raises(DataError, match="A spreadsheet has turned a number into a date"):
        read_runs(book(tmp_path, Data=[HEADER, *rows]))


# A sheet for each test


def by_sheet(head=HEADER, keep=slice(None), notes=lambda row: []):
    """A sheet for each edge, with lines above the table."""
    groups = [ROWS[i : i + 3] for i in range(0, len(ROWS), 3)]
    return {part[0][0]: [*notes(part[0]), head[keep], *(row[keep] for row in part)] for part in groups}


@pytest.mark.parametrize("notes", ["columns", "equations", "cells"])
def test_a_sheet_for_each_test_is_one_table(tmp_path, notes):
    if notes == "cells":
        lines = lambda row: [["vc", row[1], "m/min"], ["f", row[2], "mm/U"], ["ap", row[3], "mm"], []]  # noqa: E731
        sheets = by_sheet(keep=slice(4, None), notes=lines)
    elif notes == "equations":
        lines = lambda row: [["V = %g m/min" % row[1]], ["f = %g mm/rev" % row[2]], ["ap = %g mm" % row[3]], []]  # noqa: E731, UP031
        sheets = by_sheet(keep=slice(4, None), notes=lines)
    else:
        sheets = by_sheet(keep=slice(1, None))
    runs = read_runs(book(tmp_path, Cover=COVER, **sheets))
    check(runs)
    assert runs.tool == "GC4325"
    assert "12 sheets are read as one table: E1, E2" in said(runs)
    assert "each sheet is one cutting edge, named as the sheet" in said(runs)


@pytest.mark.parametrize("place", ["notes", "columns"])
def test_sheets_of_several_tests_with_a_tool_of_their_own_are_one_table(tmp_path, place):
    """The edges E1 of the two tools stay two; with the same tool in both the sheets are not joined."""

    def sheet(tool):
        if place == "notes":
            return [["Tool", tool], ["Work material", "42CrMo4"], [], HEADER, *ROWS]
        return [[*HEADER, "tool"], *([*row, tool] for row in ROWS)]

    runs = read_runs(book(tmp_path, A=sheet("GC4325"), B=sheet("TP2501")))
    assert [part.tool for part in runs.pairs()] == ["GC4325", "TP2501"]
    for part in runs.pairs():
        np.testing.assert_allclose(part.values("VB"), [row[5] for row in ROWS], rtol=1e-12)
        assert len(set(part.labels("edge"))) == 12
    with pytest.raises(DataError, match="give one of --sheet A"):
        read_runs(book(tmp_path, A=sheet("GC4325"), B=sheet("GC4325")))


def test_sheets_of_several_tests_each_are_not_joined(tmp_path):
    path = book(tmp_path, Dry=[HEADER, *ROWS], Wet=[HEADER, *ROWS])
    with pytest.raises(DataError, match=r"give one of --sheet Dry \(36 rows\), --sheet Wet \(36 rows\)\."):
        read_runs(path)


def beside(n_blank=1):
    """Two tables of other tests, side by side under the same names."""
    head, gap = HEADER[1:4], [None] * n_blank
    left = [[V, f, d, 900.0 * f**0.7 * d] for V, f, d in DESIGN]
    right = [[V + 20, f, d, 20.0 * f**1.4] for V, f, d in DESIGN]
    return [[*head, "Fc [N]", *gap, *head, "Ra [um]"], *([*a, *gap, *b] for a, b in zip(left, right, strict=True))]


def test_tables_side_by_side_are_not_mixed(tmp_path):
    path = book(tmp_path, Data=beside())
    one = {"V": "col1", "f": "col2", "d": "col3"}
    for given in ({}, one):
        with pytest.raises(DataError, match="columns 1 to 4 and columns 6 to 9 are two tables side by side"):
            read_runs(path, map=given)
    assert "Ra" not in read_runs(path, map={**one, "Ra": "none"}).data
    other = read_runs(path, map={"V": "col6", "f": "col7", "d": "col8", "Fc": "none"})
    assert other.values("V").min() == 120
    assert not other.doubts


def test_a_second_table_below_is_named_and_left_out(tmp_path):
    head = HEADER[1:4]
    lines = [[*head, "Fc [N]"], *([V, f, d, 900.0 * f**0.7 * d] for V, f, d in DESIGN), [], ["Table 2: roughness"]]
    below = [[*head[:2], "Ra [um]"], *([V, f, 20.0 * f**1.4] for V, f, _ in DESIGN)]
    path = book(tmp_path, Data=[*lines, *below])
    start, end = len(lines) + 1, len(lines) + len(below)
    with pytest.raises(DataError, match=f'second table begins there.*--leave-out "lines {start}-{end}"'):
        read_runs(path)
    assert len(read_runs(path, leave_out=[f"lines {start - 1}-{end + 20}"])) == len(DESIGN)


def test_a_remark_beside_the_units_is_no_unit(tmp_path):
    names, units = zip(*(cell.rstrip("]").split(" [") for cell in HEADER[1:]), strict=True)
    rows = [["edge", *names], ["", *units, None, None, "vc max = 300 says the maker"], *ROWS]
    check(read_runs(book(tmp_path, Data=rows)))


@pytest.mark.parametrize("labels", [("x̄", "σ", "n"), ("Media", "Dev. std", "Massimo", "Minimo"), ("Maxi", "Mini")])
def test_rows_of_a_summary_are_no_tests(tmp_path, labels):
    numbers = [[i, *row[1:]] for i, row in enumerate(ROWS, start=1)]
    runs = read_runs(book(tmp_path, Data=[HEADER, *numbers, *([label, 50.0, 0.1, 1.5, 4.0, 0.1] for label in labels)]))
    assert len(runs) == len(ROWS)


def test_a_label_among_the_numbers_of_edges_is_shown(tmp_path):
    numbers = [[i, *row[1:]] for i, row in enumerate(ROWS, start=1)]
    runs = read_runs(book(tmp_path, Data=[HEADER, *numbers, ["Charge", *ROWS[0][1:]]]))
    (doubt,) = (doubt for doubt in runs.doubts if "edge numbers" in doubt.sentence)
    assert "'Charge'" in doubt.sentence
    assert doubt.remedy == f'--leave-out "lines {len(ROWS) + 2}"'
