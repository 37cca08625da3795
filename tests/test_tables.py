"""A table written in any way a laboratory writes one reads back the same; what cannot be read is refused."""

import itertools
import zipfile
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets.tables import Table, read_table
from fitmodels.datasets.tables.decode import encoding_of
from hypothesis import given, settings
from hypothesis import strategies as st

UNITS = {"m/min", "mm", "mm/rev", "min", "µm", "N"}


def read(folder: Path, text: str | bytes, name: str = "t.csv", **options) -> Table:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_table(path, is_unit=UNITS.__contains__, **options)


def numbers(table: Table) -> dict[str, list[float]]:
    return {column.name: column.values.tolist() for column in table.columns if column.is_numeric}


# Property: write then read

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252")
FOOTERS = ("Mean", "Mittelwert", "Moyenne", "Desviación estándar", "Summe:", "Écart-type")
PREAMBLE = ("Wear test of tool GC435", "Operator: Müller", "")


def write_number(value: float, decimal: str, thousands: str, grouped: bool) -> str:
    text = repr(value)
    if grouped and abs(value) < 1e15 and "e" not in text:
        whole, fraction = text.split(".")
        text = f"{int(whole):,}".replace(",", "_") + "." + fraction if int(whole) else text
    return text.replace(".", decimal).replace("_", thousands)


@st.composite
def dialects(draw: st.DrawFn) -> dict[str, str]:
    delimiter = draw(st.sampled_from([",", ";", "\t", "|", " "]))
    decimal = draw(st.sampled_from([".", ","] if delimiter != "," else ["."]))
    marks = {"", "'", "\u00a0", " ", "," if decimal == "." else "."} - {delimiter}
    return {
        "delimiter": delimiter,
        "decimal": decimal,
        "thousands": draw(st.sampled_from(sorted(marks))),
        "encoding": draw(st.sampled_from(ENCODINGS)),
        "end": draw(st.sampled_from(["\n", "\r\n", "\r"])),
    }


# 0.5 in the first row is decisive whatever else is drawn; whole floats keep their ".0", decisive too.
finite = st.floats(allow_nan=False, allow_infinity=False)
values = st.one_of(finite, st.floats(-1e6, 1e6), st.integers(-(10**6), 10**6).map(float))
rows = st.lists(
    st.tuples(st.sampled_from(["E1", "E2", "x y", "µ"]), st.none() | values, values), min_size=1, max_size=12
)


def test_a_blank_within_one_number_does_not_outvote_the_commas_of_every_row(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("\n".join([*PREAMBLE, "edge,V,AW", "E0,0.5,0.5", "E1,n/a,0.0", "E1,n/a,1 000.0"]), "utf-8")
    assert [column.name for column in read_table(path).columns] == ["edge", "V", "AW"]


@settings(max_examples=300, deadline=None)
@given(
    dialect=dialects(), body=rows, units=st.booleans(), preamble=st.booleans(),
    footer=st.none() | st.sampled_from(FOOTERS), sep=st.booleans(), grouped=st.booleans(),
)  # fmt: skip
def test_what_is_written_is_read(tmp_path_factory, dialect, body, units, preamble, footer, sep, grouped):
    body = [("E0", 0.5, 0.5), *body]
    mark = dialect["delimiter"]

    def cell(value: str | float | None) -> str:
        if value is None:
            return "n/a"
        if isinstance(value, float):
            return write_number(value, dialect["decimal"], dialect["thousands"], grouped)
        return f'"{value}"' if " " in value and mark == " " else value

    table = [["edge", "V", "AW"]]
    if units:
        table.append(["-", "m/min", "mm"])
    table += [[cell(value) for value in row] for row in body]
    if footer:
        table.append([cell(footer), cell(1.5), cell(2.5)])
    lines = [mark.join(row) for row in table]
    if preamble and mark != " ":  # among blanks, words of a preamble are cells
        lines = [*PREAMBLE, *lines]
    if sep and mark != " ":
        lines = [f"sep={mark}", *lines]
    text = dialect["end"].join(["# made for the test", *lines] if not (sep and mark != " ") else lines)
    path = tmp_path_factory.mktemp("written") / "t.csv"
    path.write_bytes((text + dialect["end"]).encode(dialect["encoding"]))

    got = read_table(path, is_unit=UNITS.__contains__)

    assert [column.name for column in got.columns] == ["edge", "V", "AW"]
    assert got.column("edge").values.tolist() == [row[0] for row in body]
    for name, place in (("V", 1), ("AW", 2)):
        wanted = [np.nan if row[place] is None else row[place] for row in body]
        np.testing.assert_array_equal(got.column(name).values, wanted)
        assert got.column(name).unit_cell == ({"V": "m/min", "AW": "mm"}[name] if units else "")
        assert got.column(name).bad_count == 0
    assert got.dialect.decimal == ("comma" if dialect["decimal"] == "," else "point")
    assert got.lines.tolist() == list(range(got.lines[0], got.lines[0] + len(body)))
    assert any(footer in warning for warning in got.warnings) if footer else got.warnings == ()


# Files that must be read


def test_a_workbench_export_with_everything(tmp_path):
    text = (
        "Wear test 12;;;\nTool no;5;;\n\n# coolant: none\nedge;V\u00a0;f;AW\n;[m/min];mm/rev;mm\n"
        "E1;1.200,0;0,2;0,31\n\nE2;180;0,25;#NV\n2b;\N{MINUS SIGN}5;1,5E-03;worn\n;;;\nE3;90;,1;0,4;;\n"
        "Mittelwert;100;0,2;0,3\nMeasured by N.N.\n"
    )
    table = read(tmp_path, text)
    assert numbers(table) == {
        "V": [1200, 180, -5, 90],
        "f": [0.2, 0.25, 0.0015, 0.1],
        "AW": [0.31, pytest.approx(np.nan, nan_ok=True), pytest.approx(np.nan, nan_ok=True), 0.4],
    }
    assert table.column("edge").values.tolist() == ["E1", "E2", "2b", "E3"]
    assert [column.unit_cell for column in table.columns] == ["", "[m/min]", "mm/rev", "mm"]
    assert table.column("AW").bad == ((10, "worn"),)
    assert table.lines.tolist() == [7, 9, 10, 12]
    assert table.notes == ("Wear test 12", "Tool no;5", "# coolant: none", "Measured by N.N.")
    assert table.dialect.describe() == "UTF-8, semicolons, decimal comma, thousands point"
    assert "line 13 'Mittelwert'" in table.warnings[0]
    assert "line 14" in table.warnings[1]


@pytest.mark.parametrize(
    ("cell", "decimal", "value"),
    [
        ("0.234", "point", 0.234), ("1.23", "point", 1.23), ("1.2345", "point", 1.2345),
        ("1.234e3", "point", 1234),
        ("1.234.567", "comma", 1234567), ("0,234", "comma", 0.234), ("1,234,567", "point", 1234567),
        ("1 234,5", "comma", 1234.5), ("1'234.5", "point", 1234.5), ("1\u2009234,567", "comma", 1234.567),
        ("+.5", "point", 0.5), ("1,5E-03", "comma", 0.0015),
    ],
)  # fmt: skip
def test_one_decisive_cell_decides(tmp_path, cell, decimal, value):
    table = read(tmp_path, f"V;f\n{cell};7\n")
    assert numbers(table) == {"V": [value], "f": [7.0]}
    assert table.dialect.decimal == decimal


def test_majority_decides_and_the_others_are_bad_cells(tmp_path):
    table = read(tmp_path, "V;f\n0,1;1\n0,2;1\n0,3;1\n1.25;1\n")
    assert table.column("V").bad == ((5, "1.25"),)
    assert "line 5, column 1 'V': '1.25'" in table.warnings[0]


@pytest.mark.parametrize("text", ["inf", "Infinity", "1_000", "0x10", "True", "1e999", "٣", "1.2.3", "12-5"])
def test_no_number(tmp_path, text):
    table = read(tmp_path, f"V;f\n1.5;1\n2.5;2\n{text};3\n")
    assert table.column("V").bad == ((4, text),)
    assert np.isnan(table.column("V").values[2])


@pytest.mark.parametrize(
    "mark", ["", "n/a", "NA", "-", "--", "–", "?", "#DIV/0!", "#N/A", "#NV", "#WERT!", "NaN", "null", "-nan"]
)
def test_missing_marks(tmp_path, mark):
    table = read(tmp_path, f"V;f\n{mark};1\n2.5;2\n")
    np.testing.assert_array_equal(table.column("V").values, [np.nan, 2.5])
    assert table.column("V").bad_count == 0


@pytest.mark.parametrize("mark", ["n.b.", "k.A.", "n.d.", "n.m.", "x", "/", "missing", "TBD"])
def test_abbreviations_of_no_measurement_are_missing_in_a_column_of_numbers(tmp_path, mark):
    table = read(tmp_path, f"V;f;coolant\n{mark};1;{mark}\n2.5;2;\n3;2;{mark}\n")
    np.testing.assert_array_equal(table.column("V").values, [np.nan, 2.5, 3])
    assert table.column("V").bad_count == 0
    assert f"Cells without a measurement count as missing: 'V' line 2 {mark!r}." in table.warnings
    assert table.column("coolant").values.tolist() == [mark, "", mark]  # a column of words
    broken = read(tmp_path, "V;f\nBruch;1\n2.5;2\n3;2\n")
    assert broken.column("V").bad == ((2, "Bruch"),)


@pytest.mark.parametrize("note", ["new bar from here,,,", ",--- new bar ---,,", "--- 2nd day ---,,,"])
def test_notes_between_the_rows_are_left_out(tmp_path, note):
    table = read(tmp_path, f"edge,V,f,VB\n1,100,0.2,0.1\n1,100,0.2,0.2\n{note}\n2,150,0.2,0.1\n2,150,0.2,0.3\n")
    assert table.lines.tolist() == [2, 3, 5, 6]
    assert table.warnings == (f"Notes between the rows are left out: line 4 {note.strip(',')!r}.",)


@pytest.mark.parametrize("label", ["E 7", "E7", "tool 3"])
def test_a_row_with_the_name_of_an_edge_alone_is_no_note(tmp_path, label):
    table = read(tmp_path, f"edge,V,f,VB\nE 1,100,0.2,0.1\n{label},,,\nE 2,150,0.2,0.1\n")
    assert table.n_rows == 3


def test_reported_decimal_mark_settles_the_ambiguous(tmp_path):
    text = "V;f\n1.234;5\n"
    assert numbers(read(tmp_path, text, decimal="point"))["V"] == [1.234]
    assert numbers(read(tmp_path, text, decimal="comma"))["V"] == [1234.0]


def test_header_cells_with_a_newline_in_quotes(tmp_path):
    table = read(tmp_path, '"V\n[m/min]","AW, mm"\n100,"1,234.5"\n')
    assert [column.name for column in table.columns] == ["V\n[m/min]", "AW, mm"]
    assert table.column("AW, mm").values.tolist() == [1234.5]
    assert table.lines.tolist() == [3]


def test_blanks_as_delimiter(tmp_path):
    table = read(tmp_path, "  V    f   AW\n  100  0,2  0,31\n   90 0,25  0,4\n")
    assert numbers(table) == {"V": [100, 90], "f": [0.2, 0.25], "AW": [0.31, 0.4]}
    assert table.dialect.describe() == "UTF-8, blanks, decimal comma"


def test_no_header_is_said(tmp_path):
    table = read(tmp_path, "1.5\t2\n3.5\t4\n")
    assert numbers(table) == {"col1": [1.5, 3.5], "col2": [2, 4]}
    assert "no header row" in table.warnings[0]
    assert not table.dialect.has_header


def test_a_comment_serves_as_header_when_there_is_none(tmp_path):
    table = read(tmp_path, "# steel\n# V f\n1.5 2\n")
    assert numbers(table) == {"V": [1.5], "f": [2]}
    assert "comment in line 2" in table.warnings[0]


def test_a_column_named_hash_is_no_comment(tmp_path):
    assert numbers(read(tmp_path, "#;V\n1;1.5\n#N/A;2.5\n"))["V"] == [1.5, 2.5]


def test_short_rows_are_filled_and_said(tmp_path):
    table = read(tmp_path, "V;f;AW\n1.5;2;3\n1.5;2\n1.5\n")
    assert numbers(table)["f"][:2] == [2, 2]
    assert np.isnan(table.column("AW").values).tolist() == [False, True, True]
    assert table.warnings[0].startswith("2 rows have fewer cells than the header, the first in line 3;")


def test_key_value_preamble_longer_than_the_data(tmp_path):
    preamble = "".join(f"setting {i};{i}\n" for i in range(6))
    table = read(tmp_path, preamble + "Date;12.03.2024\nV;f;AW\n100;0,2;0,3\n90;0,2;0,4\n")
    assert numbers(table) == {"V": [100, 90], "f": [0.2, 0.2], "AW": [0.3, 0.4]}
    assert len(table.notes) == 7


def test_first_data_row_without_values_is_no_header(tmp_path):
    table = read(tmp_path, "edge;tool;V\nE1;sharp;\nE2;worn;1.5\n")
    assert table.column("edge").values.tolist() == ["E1", "E2"]


def test_a_footer_word_amid_the_data_is_kept(tmp_path):
    assert read(tmp_path, "edge;V\nMean;1.5\nE2;2.5\n").n_rows == 2


def test_empty_unnamed_columns_are_left_out_and_numbers_stay(tmp_path):
    table = read(tmp_path, "V;;f;\n1.5;;2;\n")
    assert [(column.number, column.name) for column in table.columns] == [(1, "V"), (3, "f")]


def test_last_row_with_a_remark_in_a_cell_is_data(tmp_path):
    table = read(tmp_path, "edge;V;f\nE1;1.5;2\nE2;2.5;3\nE3;broken;\n")
    assert table.n_rows == 3
    assert table.column("V").bad == ((4, "broken"),)


def test_blanks_keep_no_break_blanks_inside_numbers(tmp_path):
    table = read(tmp_path, 'edge V\n"x y" 1\u00a0000.5\n')
    assert numbers(table) == {"V": [1000.5]}


def test_labels_of_a_numeric_column(tmp_path):
    table = read(tmp_path, "edge;V\n1;2.5\n02;3.5\n;4.5\n")
    assert table.column("edge").labels().tolist() == ["1", "2", ""]
    assert table.column("V").labels().tolist() == ["2.5", "3.5", "4.5"]


def test_finding_a_column(tmp_path):
    table = read(tmp_path, "Speed;AW;AW\n1.5;2;3\n")
    assert table.column("col3").values.tolist() == [3]
    with pytest.raises(UsageError, match=r"no column 'speeed'\. Did you mean 'Speed'"):
        table.column("speeed")
    with pytest.raises(UsageError, match=r"2 columns named 'AW'\. Give one of col2 or col3"):
        table.column("AW")


def test_more_than_one_block(tmp_path):
    rng = np.random.default_rng(4)
    first, second = rng.normal(size=60_000), rng.integers(0, 9, 60_000)
    third = [str(i) if i < 25_000 else f"E{i}" for i in range(60_000)]  # turns out to be text in a later block
    lines = [f"{a!r};{b};{c}" for a, b, c in zip(first.tolist(), second, third, strict=True)]
    lines[55_000] = ";;"
    lines[59_000] = "worn;1;E"
    table = read(tmp_path, "a;b;c\n" + "\n".join(lines) + "\nMean;4;E\n")
    keep = np.arange(60_000) != 55_000
    first[59_000] = np.nan
    np.testing.assert_array_equal(table.column("a").values, first[keep])
    assert table.column("a").bad == ((59_002, "worn"),)
    assert table.column("c").values[[0, 24_999, 25_000]].tolist() == ["0", "24999", "E25000"]
    assert table.lines[[0, -1]].tolist() == [2, 60_001]
    assert "'Mean'" in table.warnings[0]


# Workbooks


def book(path: Path, **sheets: list[list[object]]) -> Path:
    workbook = openpyxl.Workbook()
    workbook.remove(workbook.active)
    for title, lines in sheets.items():
        sheet = workbook.create_sheet(title)
        for line in lines:
            sheet.append(line)
    workbook.save(path)
    return path


def test_workbook(tmp_path):
    data = [
        ["Wear test"],
        [],
        ["edge", "V", "AW"],
        [None, "m/min", "mm"],
        ["E1", 1.234, "0,5"],
        [2, 180, None],
    ]
    path = book(tmp_path / "t.xlsx", Read=[["nothing here"]], Data=data, More=[["a", "b"], [1, 2]])
    table = read_table(path, is_unit=UNITS.__contains__)
    np.testing.assert_array_equal(table.column("V").values, [1.234, 180])
    np.testing.assert_array_equal(table.column("AW").values, [0.5, np.nan])
    assert table.column("edge").values.tolist() == ["E1", "2"]
    assert table.lines.tolist() == [5, 6]
    assert table.notes == ("Sheet 'Data' is read; not read: 'Read', 'More'.", "Wear test")
    assert numbers(read_table(path, sheet="More")) == {"a": [1], "b": [2]}
    with pytest.raises(UsageError, match=r"no sheet 'Dat'\. Did you mean 'Data'"):
        read_table(path, sheet="Dat")


def zipped(path: Path, *members: str) -> bytes:
    with zipfile.ZipFile(path / "z", "w") as archive:
        for member in members:
            archive.writestr(member, "x")
    return (path / "z").read_bytes()


# Files that must be refused, each with its sentence

REFUSED = {
    "empty": (b"", "is empty", "0 bytes"),
    "blank": (b" \n\r\n\t", "only blanks"),
    "png": (b"\x89PNG\r\n\x1a\n\x00", "looks like a PNG image", "Export the table"),
    "pdf": (b"%PDF-1.7 ...", "looks like a PDF document"),
    "gzip": (b"\x1f\x8b\x08\x00", "looks like a gzip archive"),
    "binary": (b"V;f\n\x00\x01\x02;3\n", "not text", "0x00 at byte 5"),
    "odd bytes": (b"V;\x81\n1;2\n", "unknown encoding", "Save it as CSV UTF-8"),
    "xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "damaged Excel workbook (.xls)", "save it again as .xlsx or .csv"),
    "header only": (b"V;f\nm/min;mm\n", "header only", "lines: 1 and 2"),
    "no numbers": (b"a;b\nc;d\ne;f\ng;h\n", "no numeric column", "from line 1"),
    "mostly text": (b"a;b\nc;1\ne;x\ng;y\n", "no numeric column", "'a', 'b'"),
    "ambiguous point": (b"V;f\n7;1\n8;1.234\n", "line 3, column 2 'f': '1.234'", "1234 with",
                        "--decimal point or --decimal comma"),
    "ambiguous comma": (b"V;f\n7;1,234\n", "'1,234'", "1234 with a decimal point",
                        "1.234 with a decimal comma"),
    "tie": (b"V;f\n0.5;0,5\n", "mixes decimal marks", "'0.5' in line 2", "'0,5' in line 2", "--decimal"),
    "unquoted decimal commas": (b"V,f,AW\n1,5,0,2,0,3\n", "line 2 has 6 cells, twice the 3", "semicolons"),
    "extra cell": (b"V;f\n1.5;2\n1.5;2;3\n", "line 3 has 3 cells", "header in line 1 has 2"),
    "extra cell, comma": (b"V,f,d\n1.5,2,3\n1,5,2,3\n", "line 3 has 4 cells",
                          "a decimal comma makes two cells of one"),
    "open quote": (b'V;f\n1.5;2\n"1.5;2\n1.5;2\n', "line 3", "quote"),
    "web page": (b"<!DOCTYPE html><p>1;2", "a web page"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused(tmp_path, case):
    data, *parts = REFUSED[case]
    with pytest.raises(DataError) as refusal:
        read(tmp_path, data, "run7.csv")
    sentence = str(refusal.value)
    assert [part for part in ("run7.csv", *parts) if part not in sentence] == []
    assert "\n" not in sentence


def test_missing_file_and_folder(tmp_path):
    (tmp_path / "wear.csv").write_text("V\n1\n")
    with pytest.raises(DataError, match=r"does not exist\. Did you mean wear\.csv\?"):
        read_table(tmp_path / "waer.csv")
    with pytest.raises(DataError, match="there is no folder"):
        read_table(tmp_path / "nowhere" / "wear.csv")
    with pytest.raises(DataError, match="is a folder"):
        read_table(tmp_path)


@pytest.mark.parametrize(
    ("name", "members", "part"),
    [
        ("t.ods", ("content.xml", "mimetype"), "damaged OpenDocument spreadsheet"),
        ("t.xlsb", ("xl/workbook.bin",), "(.xlsb)"),
        ("t.xlsx", ("xl/other.xml",), "damaged Excel workbook"),
        ("t.zip", ("a.csv",), "looks like a zip archive"),
    ],
)
def test_other_archives(tmp_path, name, members, part):
    with pytest.raises(DataError) as refusal:
        read(tmp_path, zipped(tmp_path, *members), name)
    assert part in str(refusal.value)


def test_damaged_workbooks(tmp_path):
    whole = book(tmp_path / "t.xlsx", Data=[["V", "f"], *([i, i / 7] for i in range(300))]).read_bytes()
    for cut, hole in itertools.product((0.3, 0.7), (False, True)):
        place = int(cut * len(whole))
        data = whole[:place] + (b"\xff" * 40 + whole[place + 40 :] if hole else b"")
        try:
            table = read(tmp_path, data, "cut.xlsx")
        except DataError as refusal:
            assert "cut.xlsx is a damaged Excel workbook" in str(refusal)  # noqa: PT017
        else:
            assert hole  # a hole may hit a part that holds no cells
            assert table.n_rows == 300


def test_options_that_do_not_exist(tmp_path):
    with pytest.raises(UsageError, match="'point-ish' is not a decimal mark"):
        read(tmp_path, "V\n1\n", decimal="point-ish")
    with pytest.raises(UsageError, match="'semi' is not a delimiter"):
        read(tmp_path, "V\n1\n", delimiter="semi")
    with pytest.raises(UsageError, match="has no sheets"):
        read(tmp_path, "V\n1\n", sheet="Data")


CENTRAL = {
    "Czech": "Břit;Řezná rychlost vc;Posuv f;Hloubka řezu ap;Čas;Opotřebení VB",
    "Slovak": "Hrana;Rezná rýchlosť;Posuv;Hĺbka rezu;Čas;Opotrebenie",
    "Polish": "Ostrze;Prędkość skrawania [m/min];Posuw;Głębokość skrawania [mm];Czas;Zużycie VB",
    "Romanian": "Tăiş;Viteza de aşchiere;Avans;Adâncime;Timp;Uzură",
}
WESTERN = {
    "German": "Schneide;Schnittgeschwindigkeit vc;Vorschub;Ø Werkstück;Øa;Fräserø 10;V̇ in cm³/min;cm³min;Größe",
    "French": "arête;vitesse;avance;pièce à 45°;mise en œuvre;usure moyenne (½ arête);Škoda;débit m³h",
    "Spanish": "filo;velocidad;avance;tamaño;¿desgaste?;Nº;1ª prueba;observación;cm³min",
    "Italian": "tagliente;velocità;profondità;è usurato;più;così;può",
    "Portuguese": "aresta;padrões;condições;não",
    "Danish": "skær;skærehastighed;fremføring;spåndybde;tid",
    "Norwegian": "egg;kjølt;kjøring;tid;kuttedybde ø12",
    "English": "tool;5 µm;100 °C;± 2;cm³min;²",
}


@pytest.mark.parametrize("language", CENTRAL)
def test_languages_of_central_europe_are_read_in_their_code_page(tmp_path, language):
    path = tmp_path / "a.csv"
    path.write_bytes((CENTRAL[language] + "\n1;100;0,1;1;2;0,08\n").encode("cp1250"))
    table = read_table(path)
    assert [column.name for column in table.columns] == CENTRAL[language].split(";")
    assert table.dialect.describe().startswith("Windows-1250")


@pytest.mark.parametrize("language", WESTERN)
def test_languages_of_western_europe_keep_theirs(language):
    text = WESTERN[language].replace("\u0307", "")
    assert encoding_of(text.encode("cp1252"), "a.csv") == "cp1252"
