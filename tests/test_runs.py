"""A lab file becomes Runs: roles, units, pairs, notes; what does not fit is said in a sentence."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets
from fitmodels.core import errors

WEAR = "V [m/min],f [mm/rev],AW [mm]\n100,0.2,0.10\n150,0.2,0.14\n200,0.3,0.19\n"


@pytest.fixture
def read(tmp_path):
    """Read a text as a file."""

    def reader(text, **options):
        path = tmp_path / "wear.csv"
        path.write_text(text, "utf-8")
        return datasets.read_runs(path, **options)

    return reader


def use(runs, number):
    return next(column for column in runs.columns if column.number == number)


def test_headers_become_roles_in_the_units_of_the_field(read):
    runs = read(WEAR)
    assert list(runs.data) == ["V", "f", "AW"]
    assert dict(runs.units) == {"V": "m/min", "f": "mm/rev", "AW": "mm"}
    assert runs.values("AW").tolist() == [0.10, 0.14, 0.19]
    assert runs.lines.tolist() == [2, 3, 4]
    assert len(runs) == runs.source.rows == 3
    assert len(runs.source.sha256) == 64
    assert not any(column.converted for column in runs.columns)


@pytest.mark.parametrize(
    ("header", "role", "cell", "value"),
    [
        ("cutting speed (sfm)", "V", "100", 30.48),  # 1 ft = 0.3048 m exactly
        ("vc [m/s]", "V", "2", 120),
        ("feed (ipr)", "f", "0.01", 0.254),  # 1 in = 25.4 mm exactly
        ("depth of cut, inch", "d", "0.1", 2.54),
        ("VB [um]", "VB", "150", 0.150),
        ("VB (mil)", "VB", "10", 0.254),
        ("time [s]", "t", "90", 1.5),
        ("power [W]", "P", "750", 0.750),
        ("P [hp]", "P", "1", 0.745699871582),  # 550 ft lbf/s, NIST SP 811
        ("Fx [lbf]", "Fx", "1", 4.4482216152605),
        ("Schnittgeschwindigkeit [m/min]", "V", "80", 80),
        ("Vorschub [mm/U]", "f", "0.2", 0.2),
    ],
)
def test_units_are_converted(read, header, role, cell, value):
    other = "AW [mm]" if role != "AW" else "V"
    runs = read(f"{header.replace(',', ' in ')},{other}\n{cell},0.1\n{cell},0.2\n")
    assert runs.values(role) == pytest.approx([value, value], rel=1e-12)
    assert use(runs, 1).converted is (float(cell) != value)


def test_a_unit_of_the_caller_replaces_that_of_the_file(read):
    text = "V,AW\n100,0.1\n200,0.2\n"
    runs = read(text, units={"V": "sfm"})
    assert runs.values("V") == pytest.approx([30.48, 60.96])
    assert "units that the file does not name: AW mm" in runs.assumed


def test_what_the_file_does_not_say_is_assumed_aloud(read):
    runs = read("V,f [mm],AW\n100,0.2,0.1\n200,0.2,0.2\n")
    assert "f: mm is taken as mm/rev" in runs.assumed
    assert "units that the file does not name: V m/min, AW mm" in runs.assumed
    assert any("tool: not named in the file, called unnamed-tool; name it with --tool" in a for a in runs.assumed)
    assert (runs.tool, runs.work) == ("unnamed-tool", "unnamed-work")


@pytest.mark.parametrize("name", ["smooth", "col3", "smooth [mm]"])
def test_map_gives_a_role_by_header_name_or_place(read, name):
    runs = read("V,f,smooth [mm]\n100,0.2,0.1\n200,0.3,0.2\n", map={"VB": name})
    assert runs.values("VB").tolist() == [0.1, 0.2]
    assert use(runs, 3).role == "VB"


def test_map_overrides_a_header(read):
    runs = read("V,V2 [m/s],AW\n100,2,0.1\n200,3,0.2\n", map={"V": "col2"})
    assert runs.values("V").tolist() == [120, 180]
    assert (use(runs, 1).role, use(runs, 2).role) == (None, "V")


def test_map_none_takes_a_role_away(read):
    runs = read("V,P [kW],AW\n100,2,0.1\n200,3,0.2\n", map={"P": "none"})
    assert not runs.has("P")
    assert use(runs, 2).role is None


@pytest.mark.parametrize(
    ("text", "options", "role"),
    [
        ("V,P,AW\n100,2,0.1\n200,3,0.2\n", {"map": {"P": "none"}}, None),
        ("V,T,AW\nm/min,degC,mm\n100,20,0.1\n200,30,0.2\n", {}, "theta"),  # a temperature, not a tool life
    ],
)
def test_a_column_of_another_role_does_not_answer_to_its_symbol(read, text, options, role):
    runs = read(text, **options)
    symbol = use(runs, 2).header
    assert use(runs, 2).role == role
    assert not runs.has(symbol)
    assert symbol not in runs.units


def test_a_range_for_a_missing_column_is_refused(read):
    with pytest.raises(errors.UsageError, match="--range d"):
        read(WEAR, ranges={"d": (1, 3)})


def test_two_columns_for_one_role_are_asked_about(read):
    text = "V,vc [m/s],AW\n100,2,0.1\n200,3,0.2\n"
    says = r"columns 1 \('V'\) and 2 \('vc \[m/s\]'\) both read as cutting speed V: choose one with --map V=col1"
    with pytest.raises(errors.DataError, match=says):
        read(text)
    assert read(text, map={"V": "col1"}).values("V").tolist() == [100, 200]


@pytest.mark.parametrize(
    ("header", "error", "says"),
    [
        (
            "AW [N]",
            errors.DataError,
            "reads as average wear AW .in mm., but its unit is N: correct the unit",
        ),
        ("AW [furlong]", errors.DataError, "unit 'furlong' is not in the table of units;.*--unit AW=mm"),
        ("AW [mmm]", errors.DataError, "'mmm' is not in the table of units; did you mean mm"),
    ],
)
def test_units_that_do_not_fit_are_refused(read, header, error, says):
    with pytest.raises(error, match=says):
        read(f"V,{header}\n100,0.1\n200,0.2\n")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"map": {"Vc": "col1"}}, "'Vc' is no role of a column; did you mean"),
        ({"map": {"jjj": "col1"}}, r"'jjj' is no role of a column; The roles are V, f"),
        ({"map": {"VB": "flank"}}, "--map names a column 'flank' that the file does not have"),
        ({"edge": "Insert"}, "^--edge names a column 'Insert' that the file does not have"),
        ({"map": {"VB": "smoth"}}, "Did you mean 'smooth'"),
        ({"map": {"VB": "col9"}}, "a column 'col9' that the file does not have"),
        ({"map": {"VB": "col3", "AW": "col3"}}, "gives one column to two roles"),
        ({"units": {"P": "kW"}}, "--unit P=kW: no column has the role P"),
        ({"units": {"Pw": "kW"}}, "'Pw' is no role"),
    ],
)
def test_options_that_name_nothing_are_refused(read, options, says):
    with pytest.raises(errors.UsageError, match=says):
        read("V,f,smooth\n100,0.2,0.1\n200,0.3,0.2\n", **options)


def test_a_header_near_a_role_is_suggested_not_taken(read):
    runs = read("Cuting speed,f,AW\n100,0.2,0.1\n200,0.3,0.2\n")
    assert not runs.has("V")
    assert use(runs, 1).suggestion == "V"
    assert runs.values("Cuting speed").tolist() == [100, 200]


def test_a_file_without_any_role_is_refused(read):
    with pytest.raises(errors.DataError, match=r"no column is recognised among 'alpha', 'beta'.*--map"):
        read("alpha,beta\n1,2\n3,4\n")


def test_text_among_numbers_is_named_with_its_line(read):
    with pytest.raises(errors.DataError, match=r"column 'AW \[mm\]'.*line 3: 'broken'"):
        read("V,AW [mm]\n100,0.1\n150,broken\n200,0.2\n250,0.3\n")
    with pytest.raises(errors.DataError, match="'AW' reads as average wear AW but holds text, for instance 'low'"):
        read("V,AW\n100,low\n150,high\n")


def test_missing_cells_stay_missing(read):
    runs = read("V,AW,work\n100,,C45\n150,0.2,\n")
    assert np.isnan(runs.values("AW")[0])
    assert runs.labels("work").tolist() == ["C45", ""]


def test_thrust_is_computed_from_its_components(read):
    """Fxz is the resultant of feed and radial force, as in Alaskari & Oraby."""
    runs = read("V,Fx [N],Fz [N]\n100,300,400\n200,50,120\n")
    assert runs.values("Fxz").tolist() == [500, 130]
    assert runs.units["Fxz"] == "N"
    assert "Fxz = sqrt(Fx^2 + Fz^2), computed from columns 'Fx' and 'Fz'" in runs.assumed
    none = read("V,Fx [N],Fz [N],thrust [N]\n100,3,4,9\n200,5,12,9\n", map={"Fxz": "col4"})
    assert none.values("Fxz").tolist() == [9, 9]
    measured = read("V,Fx [N],Fz [N],Fxz [N]\n100,300,400,510\n200,50,120,131\n")
    assert measured.values("Fxz").tolist() == [510, 131]
    assert not any("computed" in text for text in measured.assumed)


def test_pairs_of_tool_and_work(read):
    runs = read("V,AW,tool,work\n100,0.1,A,C45\n150,0.2,B,C45\n200,0.3,A,C45\n250,0.4,,C45\n")
    assert (runs.tool, runs.work) == ("several", "C45")
    pairs = list(runs.pairs())
    assert [(p.tool, p.work) for p in pairs] == [("A", "C45"), ("B", "C45"), ("unnamed-tool", "C45")]
    assert [p.values("V").tolist() for p in pairs] == [[100, 200], [150], [250]]
    assert [p.lines.tolist() for p in pairs] == [[2, 4], [3], [5]]


def test_one_name_in_the_column_is_the_name(read):
    runs = read("V,AW,insert\n100,0.1,7\n150,0.2,7\n")
    assert runs.tool == "7"
    assert [len(pair) for pair in runs.pairs()] == [2]


@pytest.mark.parametrize(
    ("note", "name"),
    [
        ("# tool: GC435", "GC435"),
        ("# Insert: TNMG 160404", "TNMG 160404"),
        ("Werkzeug; CNMG 120408", "CNMG 120408"),
    ],
)
def test_names_from_the_notes_of_a_file(read, note, name):
    runs = read(f"{note}\n{WEAR}" if note.startswith("#") else f"# {note}\n{WEAR}")
    assert runs.tool == name
    assert next(iter(runs.pairs())) is runs


def test_a_name_keeps_its_semicolon(read):
    assert read(f"# tool: TNMG 160404; grade 4425\n{WEAR}").tool == "TNMG 160404; grade 4425"


def test_names_from_the_caller_rule(read):
    runs = read(f"# tool: X\n{WEAR}", tool="Y", work="C45")
    assert (runs.tool, runs.work) == ("Y", "C45")
    both = read("V,AW,tool\n100,0.1,A\n150,0.2,B\n", tool="Y")
    assert both.tool == "Y"
    assert len(list(both.pairs())) == 1


@pytest.mark.parametrize(("note", "simulated"), [("# simulated with seed 1", True), ("# lathe: Mascot", False)])
def test_a_file_says_that_it_is_simulated(read, note, simulated):
    assert read(f"{note}\n{WEAR}").simulated is simulated


def test_labels_write_whole_numbers_as_such():
    runs = datasets.runs_from_frame(pd.DataFrame({"V": [100.0, 250.5, np.nan], "work": [1.0, 2.0, np.nan]}))
    assert runs.labels("V").tolist() == ["100", "250.5", ""]
    assert runs.labels("work").tolist() == ["1", "2", ""]


NAMES = [("007", "1.7220", "1E01"), ("7", "1.722", "10"), ("5E2", "C45", "2E18"), ("500", "1.2340", "1.05")]


@pytest.mark.parametrize("mark", [".", ","])
def test_names_that_look_like_numbers_stay_as_written(read, mark):
    rows = [f"{t};{w};{e};{100 + 20 * i};0{mark}{i + 1}" for i, (t, w, e) in enumerate(NAMES)]
    runs = read("\n".join(["tool;work;edge;V;VB", *rows, ""]))
    assert list(zip(*(runs.labels(role) for role in ("tool", "work", "edge")), strict=True)) == NAMES
    assert [(pair.tool, pair.work) for pair in runs.pairs()] == [name[:2] for name in NAMES]
    assert runs.values("VB").tolist() == [0.1, 0.2, 0.3, 0.4]
    assert not runs.warnings
    assert not runs.doubts


def test_names_that_a_program_wrote_as_numbers_are_whole_numbers(read):
    assert read("edge,V,VB\n1.0,100,0.1\n2.0,150,0.2\n,200,0.3\n").labels("edge")[:2].tolist() == ["1", "2"]


@pytest.mark.parametrize("header", ["machine", "Charge Nr", "Ecke", "Nr"])
def test_other_names_that_look_like_numbers_stay_as_written(read, header):
    runs = read(f"{header},V,VB\n1E0,100,0.1\n1E1,150,0.2\n10,200,0.3\n")
    assert runs.labels(header).tolist() == ["1E0", "1E1", "10"]


def test_a_name_of_another_role_is_a_number_when_it_is_mapped(read):
    runs = read("Nr,V,VB\n02.50,100,0.1\n05.00,150,0.2\n", map={"t": "Nr"})
    assert runs.values("t").tolist() == [2.5, 5.0]


def test_few_words_among_the_numbers_of_edges_are_asked_about(read):
    rows = [f"{edge},{100 + 10 * int(edge)},{t},{t / 50}" for edge in ("01", "02", "03") for t in (2, 4, 6)]
    runs = read("\n".join(["edge,V,t,VB", *rows, "E9,140,8,0.2", ""]))
    assert runs.labels("edge").tolist() == 3 * ["01"] + 3 * ["02"] + 3 * ["03"] + ["line 11"]
    assert ((11,), '--leave-out "lines 11"') in [(doubt.lines, doubt.remedy) for doubt in runs.doubts]


def test_a_frame_is_read_as_a_file_is():
    frame = pd.DataFrame({"vc [m/s]": [1.0, 2.0], "wear in um": [100.0, 200.0], "who": ["a", None]})
    before = frame.copy(deep=True)
    runs = datasets.runs_from_frame(frame, tool="X")
    assert runs.values("V").tolist() == [60, 120]
    assert runs.values("AW") == pytest.approx([0.1, 0.2])
    assert runs.labels("who").tolist() == ["a", ""]
    assert (runs.tool, runs.source.name, runs.lines.tolist()) == ("X", "DataFrame", [0, 1])
    pd.testing.assert_frame_equal(frame, before)


def test_a_frame_with_an_infinite_cell_is_refused():
    with pytest.raises(errors.DataError, match="column 'AW' row 1: inf is not a measurement"):
        datasets.runs_from_frame(pd.DataFrame({"V": [1.0, 2], "AW": [0.1, np.inf]}))


@pytest.mark.parametrize("kind", ["category", "Int64", "string"])
def test_a_frame_of_other_column_types(kind):
    cells = pd.Series([1, 2, None], dtype="Int64")
    work = cells.astype(kind) if kind != "string" else pd.Series(["1", "2", None], dtype="string")
    runs = datasets.runs_from_frame(pd.DataFrame({"V": [1.0, 2, 3], "work": work}))
    assert runs.labels("work").tolist() == ["1", "2", ""]


def test_join_keeps_the_columns_of_both(read):
    one = read(WEAR + "", tool="T", work="W")
    two = datasets.runs_from_frame(pd.DataFrame({"vc [m/s]": [5.0], "AW": [0.3], "P": [2.0]}))
    both = one.join(two)
    assert list(both.data) == ["V", "AW"]
    assert both.values("V").tolist() == [100, 150, 200, 300]
    assert dict(both.units) == {"V": "m/min", "AW": "mm"}
    assert both.lines.tolist() == [2, 3, 4, 0]
    assert (both.source.rows, both.source.name) == (4, "wear.csv + DataFrame")
    assert len(one) == 3
    with pytest.raises(errors.UsageError, match="have no column in common"):
        one.join(datasets.runs_from_frame(pd.DataFrame({"P": [1.0]})))


def test_join_of_two_tools_is_several(read):
    assert read(WEAR, tool="A", work="W").join(read(WEAR, tool="B", work="W")).tool == "several"


def test_values_of_text_and_of_nothing_are_refused(read):
    runs = read("V,AW,remark\n100,0.1,good\n150,0.2,bad\n")
    with pytest.raises(errors.UsageError, match="column 'remark' holds text; a law needs numbers"):
        runs.values("remark")
    with pytest.raises(errors.UsageError, match="no column 'P'; there are V, AW, remark"):
        runs.labels("P")
    assert runs.has("remark")
    assert not runs.has("P")


def test_a_column_answers_to_its_header_and_to_its_role(read):
    runs = read("cutting speed [m/min],AW,material\n100,0.1,C45\n150,0.2,C45\n")
    assert runs.values("cutting speed").tolist() == runs.values("V").tolist()
    assert runs.labels("material").tolist() == runs.labels("work").tolist() == ["C45", "C45"]
