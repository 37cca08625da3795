"""Tables of other shapes and with faults of export: read as what they are, refused, or doubted; never shifted."""

from pathlib import Path

import numpy as np
import openpyxl
import pytest
from fitmodels import fit
from fitmodels.batch.source.lab_files import pairs_of
from fitmodels.cards.terminal import nothing_fitted
from fitmodels.core.errors import DataError
from fitmodels.datasets import Runs, read_runs
from hypothesis import given, settings
from hypothesis import strategies as st

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


# Wide tables

LONG = table()
PIVOT = {(edge, t): VB for edge, _, _, _, t, VB in ROWS}
CONDITIONS = {edge: (V, f, d) for edge, V, f, d, _, _ in ROWS}
TIMES = (2, 5, 9)


def by_time(header="VB {} min", first=NAMES[:4]) -> list[list[object]]:
    rows = [[edge, *of_edge, *(PIVOT[edge, t] for t in TIMES)] for edge, of_edge in CONDITIONS.items()]
    return [[*first, *(header.format(t) for t in TIMES)], *rows]


def by_edge(header="{}") -> list[list[object]]:
    wear = [[t, *(PIVOT[edge, t] for edge in CONDITIONS)] for t in TIMES]
    return [["t [min]", *(header.format(edge) for edge in CONDITIONS)], *wear]


def lines(rows, above="") -> str:
    return above + "".join(",".join(map(str, row)) + "\n" for row in rows)


@pytest.mark.parametrize(
    "text",
    [
        lines(by_time()),
        lines(by_time("VB after {} min [mm]")),
        lines(by_time("VB_{}min")),
        lines(by_time("t = {} min"), "Flank wear VB in mm\n"),
        lines(by_time("{}"), "VB [mm] after t [min]\n"),
        lines([[*NAMES[:4], "VB [mm]"], ["", "", "", "", *TIMES], *by_time()[1:]]),
        lines(by_time("VB after t min {}")),
    ],
)
def test_a_column_for_each_time_becomes_rows(tmp_path, text):
    runs = read(tmp_path, text)
    assert same(runs, read(tmp_path, LONG, "b.csv"))
    assert runs.labels("edge").tolist() == [row[0] for row in ROWS]
    assert "the table is wide, 4 rows with a column for each time" in said(runs)
    assert not runs.doubts


@pytest.mark.parametrize("header", ["{}", "VB {}", "VB {} [mm]", "VB_{}"])
def test_a_column_for_each_edge_becomes_rows(tmp_path, header):
    runs = read(tmp_path, lines(by_edge(header), "Flank wear VB\n"))
    assert same(runs, read(tmp_path, LONG, "b.csv"), ("t", "VB"))
    assert runs.labels("edge").tolist() == [row[0] for row in ROWS]
    assert "a column for each edge" in said(runs)


def test_conditions_above_a_wide_table_are_those_of_its_columns(tmp_path):
    above = [[name, *(of_edge[i] for of_edge in CONDITIONS.values())] for i, name in enumerate(NAMES[1:4])]
    for head, rows in (
        ([], by_edge("VB {}")),
        ([["edge", *CONDITIONS]], [["t [min]", *["VB [mm]"] * 4], *by_edge()[1:]]),
    ):
        runs = read(tmp_path, lines([*head, *above, *rows]))
        assert same(runs, read(tmp_path, LONG, "b.csv"))
        assert runs.labels("edge").tolist() == [row[0] for row in ROWS]


def test_cells_of_unnamed_wide_columns_are_doubted(tmp_path):
    assert "nothing names what its columns 'E1' to 'E4' hold" in str(read(tmp_path, lines(by_edge())).doubts[0])


def test_marks_of_a_wide_table_stay_with_their_rows(tmp_path):
    runs = read(tmp_path, lines(by_edge("VB {}")).replace(str(PIVOT["E3", 9]), "<0.05"))
    place = runs.labels("VB mark").tolist().index("<0.05")
    assert (runs.labels("edge")[place], runs.values("t")[place]) == ("E3", 9)


def test_repeated_readings_are_refused_with_a_long_table_as_example(tmp_path):
    with pytest.raises(DataError, match=r"whether these are edges, times or repeated readings") as refusal:
        read(tmp_path, "V,f,d,VB 1,VB 2,VB 3\n100,.1,1,.1,.2,.3\n150,.1,1,.1,.2,.3\n")
    assert str(refusal.value).count("\n") == 4
    with pytest.raises(DataError, match="--map VB=col4"):
        read(tmp_path, "V,f,d,VB 1,VB 2,VB 3\n100,.1,1,.1,.2,.3\n150,.1,1,.1,.2,.3\n")


def test_a_parameter_file_in_place_of_the_measurements_is_named(tmp_path):
    with pytest.raises(DataError, match="is a parameter file, no table of tests"):
        read(tmp_path, '{\n  "schema_version": "fitmodels.parameters/10",\n  "laws": {"a": 1,5}\n}\n')


@pytest.mark.parametrize("unit", ["", " (µm)"])
def test_three_readings_of_the_roughness_are_averaged_as_two_are(tmp_path, unit):
    header = ",".join(f"Ra {i}{unit}" for i in (1, 2, 3))
    runs = read(tmp_path, f"V,f,d,{header}\n100,.1,1,1.1,1.2,1.3\n150,.1,1,2.1,2.2,2.3\n")
    np.testing.assert_allclose(runs.values("Ra"), [1.2, 2.2])


@settings(max_examples=60, deadline=None)
@given(
    wear=st.lists(
        st.lists(st.none() | st.floats(0.01, 0.9).map(lambda v: round(v, 4)), min_size=3, max_size=3),
        min_size=2, max_size=8,
    ).filter(lambda rows: all(any(row[j] is not None for row in rows) for j in range(3))),
    edges_down=st.booleans(),
)  # fmt: skip
def test_what_is_made_wide_is_read_long(tmp_path_factory, wear, edges_down):
    long = [
        (f"E{i}", 100.5 + i, 0.1, 1.5, t, v) for i, row in enumerate(wear) for t, v in zip(TIMES, row, strict=True) if v
    ]
    if edges_down:
        rows = [[*NAMES[:4], *(f"VB {t} min" for t in TIMES)]]
        rows += [[f"E{i}", 100.5 + i, 0.1, 1.5, *("" if v is None else v for v in row)] for i, row in enumerate(wear)]
    else:
        heads = [(f"E{k}", 100.5 + k, 0.1, 1.5) for k in range(len(wear))]
        rows = [[NAMES[i], *(head[i] for head in heads)] for i in range(4)]
        rows += [["t [min]", *["VB [mm]"] * len(wear)]]
        rows += [[t, *("" if row[j] is None else row[j] for row in wear)] for j, t in enumerate(TIMES)]
    runs = read(tmp_path_factory.mktemp("wide"), lines(rows))
    frame = runs.data[["edge", "V", "f", "d", "t", "VB"]]
    assert [tuple(row) for row in frame.itertuples(index=False)] == long


def test_a_table_of_tool_lives_is_read_and_named(tmp_path):
    text = "V [m/min],f [mm/rev],d [mm],T [min]\n" + "".join(f"{100 + 20 * i},0.2,1,{60 - 9 * i}\n" for i in range(6))
    runs = read(tmp_path, text.replace(",60\n", ",>60\n"))
    assert runs.labels("T mark")[0] == ">60"
    said_of = nothing_fitted(runs, ())
    assert said_of.endswith("Seen: responses T; conditions that vary V; constant f, d.")


def test_times_without_a_name_below_conditions_are_times(tmp_path):
    above = [[name, *(of_edge[i] for of_edge in CONDITIONS.values())] for i, name in enumerate(NAMES[1:4])]
    runs = read(tmp_path, lines([["edge", *CONDITIONS], *above, *by_edge()[1:]], "Flank wear VB\n"))
    assert same(runs, read(tmp_path, LONG, "b.csv"))


# Blocks below headings


def blocks(heading, header="t [min],VB [mm]", gap="", repeat=True) -> str:
    text = header + "\n" if not repeat else ""
    for i, (edge, (V, f, d)) in enumerate(CONDITIONS.items(), start=1):
        text += heading.format(i=i, V=V, f=f, d=d) + "\n" + (header + "\n") * repeat
        text += "".join(f"{t},{PIVOT[edge, t]}\n" for t in TIMES) + gap
    return text


@pytest.mark.parametrize(
    "heading",
    [
        "Test {i}: V = {V} m/min, f = {f} mm/rev, d = {d} mm",
        "Test {i}: V = {V} m/min; f = {f} mm/rev; ap = {d} mm",
        "Test {i} (vc={V} m/min f={f} mm/rev ap={d} mm)",
        '"Test no. {i}, vc = {V} m/min, f = {f} mm/rev, ap = {d} mm"',
        "Test {i}\nvc: {V} m/min\nf: {f} mm/rev\nap: {d} mm",
    ],
)
@pytest.mark.parametrize("gap", ["", "\n", "Mean,0.02\n\n"])
@pytest.mark.parametrize("repeat", [True, False])
def test_blocks_below_headings_become_rows(tmp_path, heading, gap, repeat):
    runs = read(tmp_path, blocks(heading, gap=gap, repeat=repeat))
    kept = ~np.isnan(runs.values("t"))
    reference = read(tmp_path, LONG, "b.csv")
    assert all(np.array_equal(runs.values(role)[kept], reference.values(role)) for role in ("V", "f", "d", "t", "VB"))
    assert runs.labels("edge")[kept].tolist() == [row[0][1:] for row in ROWS]
    assert "4 blocks below headings" in said(runs)


def test_units_of_headings_count(tmp_path):
    runs = read(tmp_path, blocks("Test {i}: V = {V} m/s, f = {f} mm/rev, d = {d} mm"))
    assert runs.values("V")[0] == 6000


def test_headings_of_two_units_are_refused(tmp_path):
    text = blocks("Test {i}: V = {V} m/min, f = {f} mm/rev, d = {d} mm").replace("V = 200 m/min", "V = 3.33 m/s")
    with pytest.raises(DataError, match=r"V is in m/min in line 1 and in m/s in line 11"):
        read(tmp_path, text)


def test_a_repeated_header_is_left_out(tmp_path):
    header, *rows = LONG.splitlines()
    runs = read(tmp_path, "\n".join([header, *rows[:6], header, *rows[6:]]))
    assert same(runs, read(tmp_path, LONG, "b.csv"))
    assert "The header is repeated 1 time" in said(runs)
    assert runs.lines.tolist() == [2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14]


def test_blocks_of_a_sheet_become_rows(tmp_path):
    book = openpyxl.Workbook()
    for line in blocks("Test {i}: V = {V} m/min; f = {f} mm/rev; d = {d} mm", gap="\n").splitlines():
        cells = [line] if line.startswith("Test") else line.split(",")
        book.active.append([float(cell) if cell.replace(".", "").isdecimal() else cell for cell in cells])
    book.save(tmp_path / "a.xlsx")
    assert same(read_runs(tmp_path / "a.xlsx"), read(tmp_path, LONG, "b.csv"))


def test_a_remark_with_an_equals_sign_makes_no_blocks(tmp_path):
    header, *rows = table([(*row, "") for row in ROWS], (*NAMES, "remark")).splitlines()
    rows[5] += "stopped at VB = 0.3"
    runs = read(tmp_path, "\n".join(["# coolant = dry", header, *rows]))
    assert same(runs, read(tmp_path, LONG, "b.csv"))


# Several files as one table


def folder_of(tmp_path, names=NAMES, drop=(), above="", name="{edge}.csv", change=None) -> Path:
    folder = tmp_path / "lab"
    folder.mkdir()
    kept = [i for i, header in enumerate(names) if header not in drop]
    for edge, (V, f, d) in CONDITIONS.items():
        rows = [[row[i] for i in kept] for row in ROWS if row[0] == edge]
        text = above.format(V=V, f=f, d=d) + table(rows, [names[i] for i in kept])
        (folder / name.format(edge=edge, V=V, f=f, d=d)).write_text(change(edge, text) if change else text, "utf-8")
    return folder


def test_a_folder_of_files_is_one_table(tmp_path):
    folder = folder_of(tmp_path, drop=("edge",))
    (folder / "photo.jpg").write_bytes(b"\xff\xd8\xff")
    runs = read_runs(folder)
    assert same(runs, read(tmp_path, LONG))
    assert runs.labels("edge").tolist() == [row[0] for row in ROWS]
    assert runs.source.name == "lab"
    assert "4 files are read as one table: E1.csv, E2.csv, E3.csv, E4.csv" in said(runs)
    assert "Not read in lab: photo.jpg" in said(runs)
    assert same(read_runs(sorted(folder.glob("*.csv"))), runs)
    assert read_runs(folder).source.sha256 == runs.source.sha256
    (folder / "E4.csv").write_text(LONG, "utf-8")
    assert read_runs(folder).source.sha256 != runs.source.sha256


@pytest.mark.parametrize(
    ("above", "name"),
    [
        ("# V = {V} m/min\n# f = {f} mm/rev\n# ap = {d} mm\n", "{edge}.csv"),
        ("", "{edge}_V{V}_f{f}_ap{d}.csv"),
        ("", "V{V} f{f} d{d} {edge}.csv"),
        ("vc: {V} m/min, f: {f} mm/rev\n", "{edge}_d{d}.csv"),
    ],
)
def test_conditions_stand_in_the_notes_or_the_name_of_each_file(tmp_path, above, name):
    folder = folder_of(tmp_path, drop=NAMES[:4], above=above, name=name)
    runs = read_runs(folder)
    frame = runs.data.sort_values(["V", "f", "d", "t"])
    reference = read(tmp_path, LONG).data.sort_values(["V", "f", "d", "t"])
    for role in ("V", "f", "d", "t", "VB"):
        assert frame[role].tolist() == reference[role].tolist()
    assert len(set(runs.labels("edge"))) == 4
    assert "of the files: V 100 to 200" in said(runs)


def test_columns_in_another_order_or_unit_are_matched_by_role(tmp_path):
    def change(edge: str, text: str) -> str:
        if edge == "E2":
            header, *rows = (line.split(",")[::-1] for line in text.splitlines())
            return lines([header, *rows])
        return text.replace("VB [mm]", "VB [um]").replace("0.0", "") if edge == "E3" else text

    wear = {"E3": 1000}
    folder = folder_of(tmp_path, change=change)
    (folder / "E3.csv").write_text(
        table([(*row[:5], f"{row[5] * wear['E3']:g}") for row in ROWS if row[0] == "E3"], (*NAMES[:5], "VB [um]"))
    )
    runs = read_runs(folder)
    assert np.allclose(runs.values("VB"), read(tmp_path, LONG).values("VB"), rtol=1e-12)
    assert runs.labels("edge").tolist() == [row[0] for row in ROWS]


def test_files_that_number_their_edges_alike_have_edges_of_their_own(tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    for tool, rows in (("K10", ROWS[:6]), ("P25", ROWS[6:])):
        numbered = [(1 + i // 3, *row[1:]) for i, row in enumerate(rows)]
        (folder / f"{tool}.csv").write_text(f"# tool: {tool}\n" + table(numbered))
    runs = read_runs(folder)
    assert sorted(set(runs.labels("edge"))) == ["K10: 1", "K10: 2", "P25: 1", "P25: 2"]
    assert [pair.tool for pair in runs.pairs()] == ["K10", "P25"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("V [m/min],f [mm/rev],t [min],VB [mm]\n100,0.1,2,0.1\n", "x.csv has no depth of cut d, which E1.csv has"),
        ("V [m/min],f [mm/rev],d [mm]\n100,0.1,2\n", "x.csv holds no wear, force, power or roughness"),
        ("edge,V,f,d,t,VB [N]\nE9,100,0.1,2,3,0.1\n", "is in N, in the other files in mm"),
        ("nothing\n", "x.csv"),
    ],
)
def test_a_file_that_does_not_fit_is_named_and_refused(tmp_path, text, words):
    folder = folder_of(tmp_path)
    (folder / "x.csv").write_text(text)
    with pytest.raises(DataError, match=words):
        read_runs(folder)


def test_marks_of_several_files_stay_with_their_rows(tmp_path):
    folder = folder_of(tmp_path, drop=("edge",), change=lambda e, t: t.replace(str(PIVOT["E3", 9]), "<0.05"))
    runs = read_runs(folder)
    assert runs.labels("VB mark").tolist().index("<0.05") == 8


# Letters of other scripts


@pytest.mark.parametrize(
    ("header", "written"),
    [
        ("V [m/min]", "\N{GREEK SMALL LETTER NU} [m/min]"),
        ("d [mm]", "\N{CYRILLIC SMALL LETTER A}\N{CYRILLIC SMALL LETTER ER} [mm]"),
        ("V [m/min]", "v\N{CYRILLIC SMALL LETTER ES} [m/min]"),
        ("VB [mm]", "V\N{CYRILLIC CAPITAL LETTER VE} [mm]"),
    ],
)
def test_letters_that_look_latin_are_read_so_in_headers(tmp_path, header, written):
    runs = read(tmp_path, LONG.replace(header, written))
    assert same(runs, read(tmp_path, LONG, "b.csv"))
    assert "letters of another script" in said(runs)


def test_greek_letters_of_units_stay(tmp_path):
    runs = read(
        tmp_path, table([(*row[:5], 1000 * row[5]) for row in ROWS], (*NAMES[:5], "VB [\N{GREEK SMALL LETTER MU}m]"))
    )
    assert runs.values("VB")[0] == pytest.approx(ROWS[0][5], rel=1e-12)
    assert "another script" not in said(runs)


# A sheet for each test


def book_of(tmp_path, rows_of) -> Path:
    book = openpyxl.Workbook()
    book.remove(book.active)
    for edge, (V, f, d) in CONDITIONS.items():
        sheet = book.create_sheet(f"{edge}_V{V}_f{f}_d{d}")
        for row in rows_of(edge):
            sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    return tmp_path / "a.xlsx"


def test_sheets_of_one_test_each_are_one_table(tmp_path):
    runs = read_runs(book_of(tmp_path, lambda edge: [NAMES[4:], *(row[4:] for row in ROWS if row[0] == edge)]))
    assert same(runs, read(tmp_path, LONG))
    assert len(set(runs.labels("edge"))) == 4
    assert "4 sheets are read as one table" in said(runs)
    assert "from the names of the sheets: V 100 to 200" in said(runs)


def test_sheets_of_several_tests_are_listed(tmp_path):
    with pytest.raises(DataError, match=r"several sheets with a table of tests: give one of --sheet"):
        read_runs(book_of(tmp_path, lambda edge: [NAMES, *ROWS]))


def test_a_column_of_repeated_readings_is_taken_with_the_option_of_the_refusal(tmp_path):
    text = "edge,V,f,d,t,VB1,VB2,VB3\n" + "".join(f"E1,100,.1,1,{t},{t / 99},{t / 98},{t / 97}\n" for t in (1, 2, 4))
    with pytest.raises(DataError, match=r"Take one of them, as with --map VB=col6"):
        read(tmp_path, text)
    assert read(tmp_path, text, map={"VB": "col6"}).values("VB")[0] == 1 / 99


def test_a_title_gives_response_and_unit_of_a_wide_table(tmp_path):
    title = "Flank wear VB in µm after t [min]\n"
    rows = [[*row[:4], *(f"{1000 * v:g}" for v in row[4:])] for row in by_time()[1:]]
    runs = read(tmp_path, lines([[*NAMES[:4], *TIMES], *rows], title))
    assert np.allclose(runs.values("VB"), [row[5] for row in ROWS])
    assert not runs.doubts


@pytest.mark.parametrize("head", [("edge",), ("Quantity",), None])
def test_a_table_with_a_column_for_each_test_is_turned(tmp_path, head):
    last = [row for row in ROWS if row[4] == TIMES[-1]]
    turned = [[name, *(row[i] for row in last)] for i, name in enumerate(NAMES) if i]
    top = [[*head, *(row[0] for row in last)]] if head else []
    runs = read(tmp_path, lines([*top, *turned]))
    assert runs.values("VB").tolist() == [row[5] for row in last]
    assert runs.values("V").tolist() == [row[1] for row in last]
    assert "rows and columns are exchanged, 4 tests" in said(runs)
    assert not head or runs.labels("edge").tolist() == [row[0] for row in last]


@pytest.mark.parametrize(
    "heading",
    [
        "# Test {i}: V = {V} m/min, f = {f} mm/rev, d = {d} mm",
        "V,{V},m/min\nf,{f},mm/rev\nd,{d},mm",
        "# V = {V} m/min\n# f = {f} mm/rev\n# d = {d} mm",
    ],
)
def test_headings_in_comments_or_in_cells_of_their_own_count(tmp_path, heading):
    runs = read(tmp_path, blocks(heading, gap="\n"))
    assert same(runs, read(tmp_path, LONG, "b.csv"))


def test_blocks_of_gnuplot_are_read(tmp_path):
    text = blocks("# V = {V}\n# f = {f}\n# d = {d}\n# t VB", gap="\n\n", repeat=False)
    rows = [line.replace(",", " ") for line in text.splitlines()[1:]]
    assert same(read(tmp_path, "\n".join(rows), "a.dat"), read(tmp_path, LONG, "b.csv"))


def test_marks_reach_the_pairs_of_a_batch(tmp_path):
    runs = read(tmp_path, LONG.replace(f",{ROWS[3][5]}\n", ",<0.05\n"))
    (_, pair), *_ = pairs_of(runs, ())
    assert pair.labels("VB mark")[3] == "<0.05"


def test_a_copy_among_the_files_is_doubted(tmp_path):
    folder = folder_of(tmp_path)
    assert not read_runs(folder).doubts
    (folder / "E9.csv").write_text((folder / "E2.csv").read_text())
    (doubt,) = (one for one in read_runs(folder).doubts if "remove the copy" in one.sentence)
    assert "E9.csv: 3 of its 3 rows stand in a file before it too" in doubt.sentence


@pytest.mark.parametrize("title", ["VB [mm], f = 0.2 mm/rev", "VB [mm]"], ids=["in a note", "above the levels"])
@pytest.mark.parametrize("header", ["vc {} m/min", "vc={} m/min", "Vc_{}"])
def test_columns_of_levels_of_a_condition_are_edges_at_these_levels(tmp_path, header, title):
    speeds, times = (120, 150, 190, 240), (1, 2, 4, 7, 11)
    rows = [",".join(map(str, (t, *(round(0.0035 * V**0.665 * t**0.39, 3) for V in speeds)))) for t in times]
    text = "\n".join([title, "t [min]," + ",".join(map(header.format, speeds)), *rows])
    (tmp_path / "t.csv").write_text(text)
    runs = read_runs(tmp_path / "t.csv")
    law = fit.power_law(runs, "VB", ["V", "t"])
    assert (law.nobs, law.n_edges) == (20, 4)
    np.testing.assert_allclose(law.params, [0.0035, 0.665, 0.39], rtol=0.02)


def test_columns_of_levels_of_which_no_note_names_the_response_are_no_edges(tmp_path):
    (tmp_path / "t.csv").write_text("t [min],vc 120 m/min,vc 150 m/min\n1,0.084,0.1\n2,0.11,0.131\n4,0.146,0.172\n")
    assert read_runs(tmp_path / "t.csv").data.columns.tolist() == ["t", "vc 120 m/min", "vc 150 m/min"]


def test_blocks_of_edges_side_by_side_are_refused_with_the_table_to_write(tmp_path):
    text = "t [min],VB [mm],,t [min],VB [mm],,t [min],VB [mm]\n2,0.109,,1,0.107,,0.5,0.088\n4,0.144,,2,0.141,,1,0.113\n"
    (tmp_path / "t.csv").write_text(text + "8,0.186,,4,0.182,,2,0.159\n")
    with pytest.raises(DataError, match=r"'t \[min\]', 'VB \[mm\]' stand 3 times side by side.*\n *edge, V \[m/min\]"):
        read_runs(tmp_path / "t.csv")


def test_columns_of_equal_levels_are_edges_of_their_own(tmp_path):
    speeds, times = (120, 120, 150, 190), (1, 2, 4, 7, 11)
    rows = [
        ",".join(map(str, (t, *(round((0.0035 + 1e-4 * k) * V**0.665 * t**0.39, 3) for k, V in enumerate(speeds)))))
        for t in times
    ]
    names = ",".join(f"vc {V} m/min" for V in speeds)
    (tmp_path / "t.csv").write_text("\n".join(["VB [mm], f = 0.2 mm/rev", f"t [min],{names}", *rows]))
    runs = read_runs(tmp_path / "t.csv")
    edges = dict(zip(runs.labels("edge"), runs.values("V"), strict=True))
    assert edges == {"vc 120 m/min": 120, "vc 120 m/min (2)": 120, "vc 150 m/min": 150, "vc 190 m/min": 190}
