"""`--correct` and `--leave-out`: a file with planted mistakes is read as the sound one, and this is recorded."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets
from fitmodels.app.options import applied
from fitmodels.cli import batch, compare, look, main, wear
from fitmodels.cli import next as further
from fitmodels.cli.corrections import corrected
from fitmodels.core.errors import DataError, FitmodelsError, UsageError
from fitmodels.datasets.corrections import parse_correction
from fitmodels.datasets.options import OPTIONS, TAKEN, chosen, merged
from fitmodels.fit.checks.check import Suspect
from hypothesis import given, settings
from hypothesis import strategies as st

FILE = datasets.bundled("gc435_709m40")
FEED, TIME = "f [mm/rev]", "t [min]"


@pytest.fixture(scope="module")
def sound():
    return pd.read_csv(FILE, comment="#").dropna().reset_index(drop=True)


@pytest.fixture
def read(tmp_path):
    def reads(frame, **options):
        path = tmp_path / "tests.csv"
        frame.to_csv(path, index=False)
        return datasets.read_runs(path, tool="GC435", work="709M40", **options)

    return reads


def changed(frame, edges, column, factor=1.0, offset=0.0):
    rows = frame["edge"].isin(edges)
    return frame.assign(**{column: frame[column].where(~rows, frame[column] * factor + offset)})


def test_a_corrected_unit_of_some_edges_is_read_as_the_sound_file(sound, read):
    inch = changed(sound, ["E07", "E11"], FEED, 1 / 25.4)
    runs = read(inch, correct=("E07,E11:f*25.4",))
    truth = read(sound)
    np.testing.assert_allclose(runs.values("f"), truth.values("f"), rtol=1e-9)
    assert runs.doubts == truth.doubts
    assert read(inch).doubts != truth.doubts
    said = next(text for text in runs.assumed if "--correct" in text)
    assert "E07,E11:f*25.4" in said
    assert "was 0.007469 to 0.01328, is 0.1897 to 0.3374 mm/rev" in said


def test_an_offset_is_in_the_unit_of_the_quantity(sound, read):
    """A column of seconds, given by --unit and not by the header, is corrected in min."""
    late = changed(sound, ["E03"], TIME, offset=5.0)
    late[TIME] *= 60
    runs = read(late.rename(columns={TIME: "t"}), units={"t": "s"}, correct=("E03:t-5",))
    np.testing.assert_allclose(runs.values("t"), read(sound).values("t"), atol=1e-9)


def sub_tests(frame):
    return frame.assign(**{TIME: frame.groupby("edge")[TIME].diff().fillna(frame[TIME])})


def test_times_of_sub_tests_are_added_up_within_each_edge(sound, read):
    apart = sub_tests(sound)
    truth = read(sound)
    runs = read(apart, correct=("all:t=cumulative",))
    np.testing.assert_allclose(runs.values("t"), truth.values("t"), atol=1e-9)
    assert runs.doubts == truth.doubts
    assert "t of 239 rows (lines 2, 3, 4, 5, 6 and 234 more) was 2, is 2 to 20 min" in runs.assumed[0]
    some = read(apart, correct=("E07,E11:t=cumulative",))
    here = some.data["edge"].isin(["E07", "E11"])
    np.testing.assert_allclose(some.values("t")[here], truth.values("t")[here], atol=1e-9)
    assert set(some.values("t")[~here]) == {2.0}
    less = read(apart, correct=("all:t=cumulative",), leave_out=("lines 3",))
    np.testing.assert_allclose(less.values("t"), np.delete(truth.values("t"), 1), atol=1e-9)


def test_a_row_without_a_time_leaves_the_sum_unknown_from_there_on(sound, read):
    apart = sub_tests(sound)
    edge = apart["edge"][2]
    apart.loc[2, TIME] = np.nan
    runs = read(apart, correct=("all:t=cumulative",))
    t = runs.values("t")[runs.data["edge"] == edge]
    assert np.isfinite(t[:2]).all()
    assert np.isnan(t[2:]).all()


def test_values_that_are_left_out_as_impossible_can_be_corrected(sound, read):
    wrong = sound.assign(**{FEED: sound[FEED].where(sound.index != 4, sound[FEED] * 1000)})
    assert np.isnan(read(wrong).values("f")[4])
    runs = read(wrong, correct=("lines 6:f/1000",))
    np.testing.assert_allclose(runs.values("f"), read(sound).values("f"))
    assert not any("cannot be" in doubt.sentence for doubt in runs.doubts)


def test_a_file_that_is_refused_as_it_stands_can_be_corrected(sound, read):
    """A third of the edges in m/s times 1000: no unit of the whole column is plausible."""
    edges = sorted(set(sound["edge"]))[:9]
    wrong = changed(sound, edges, "V [m/min]", 1000)
    with pytest.raises(datasets.reading.DataError):
        read(wrong)
    runs = read(wrong, correct=(f"{','.join(edges)}:V/1000",))
    np.testing.assert_allclose(runs.values("V"), read(sound).values("V"))


def test_computed_quantities_follow_from_corrected_ones(read):
    frame = pd.DataFrame(
        [(edge, 500 + 100 * i, 0.2, 1.0, t, 0.05 + 0.02 * t) for i, edge in enumerate("ABCDEF") for t in (2, 4, 6)],
        columns=["edge", "n [1/min]", FEED, "ap [mm]", TIME, "VB [mm]"],
    )
    truth = read(frame, constants={"D": 50})
    wrong = changed(frame, ["B"], "n [1/min]", 1 / 60)
    np.testing.assert_allclose(read(wrong, constants={"D": 50}, correct=("B:n*60",)).values("V"), truth.values("V"))
    doubled = read(frame, constants={"D": 50}, correct=("B:V*2",))
    np.testing.assert_allclose(doubled.values("V") / truth.values("V"), np.where(frame["edge"] == "B", 2, 1))


def test_rows_and_edges_are_left_out(sound, read):
    runs = read(sound, leave_out=("E07", "lines 2-4,6"))
    kept = (sound["edge"] != "E07") & ~sound.index.isin([0, 1, 2, 4])
    np.testing.assert_allclose(runs.values("AW"), sound.loc[kept, "AW [mm]"])
    np.testing.assert_array_equal(runs.lines, sound.index[kept] + 2)
    assert sum("--leave-out" in text for text in runs.assumed) == 2


def test_inferred_edges_keep_their_names_when_others_are_left_out(sound, read):
    """E03 is the same edge after E01 was left out, or a correction would concern another one."""
    bare = sound.drop(columns=["edge", "point"])
    before, after = read(bare), read(bare, leave_out=("E01",), correct=("E03:AW*1.5",))
    kept = before.labels("edge") != "E01"
    np.testing.assert_array_equal(after.labels("edge"), before.labels("edge")[kept])
    ratio = after.values("AW") / before.values("AW")[kept]
    np.testing.assert_allclose(ratio, np.where(after.labels("edge") == "E03", 1.5, 1.0))


def test_lines_of_a_wide_table_need_their_edge(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text("t [min],E1,E2\n2,0.1,0.2\n4,0.15,0.26\n6,0.2,0.33\n# VB in mm\n")
    with pytest.raises(UsageError, match=r"line 3 holds rows of the edges E1, E2; name the edge too.*'lines 3 of E1'"):
        datasets.read_runs(path, leave_out=("lines 3",))
    runs = datasets.read_runs(path, correct=("lines 3 of E2:VB/2",))
    assert sorted(runs.values("VB")) == [0.1, 0.13, 0.15, 0.2, 0.2, 0.33]


def test_edges_of_one_name_in_two_pairs_are_named_by_lines(sound, read):
    two = pd.concat([sound.assign(tool="GC435"), sound.assign(tool="GC4025")])
    with pytest.raises(UsageError, match=r"edge 'E02' is in 2 pairs of tool and work; name lines \(GC435: lines 0-"):
        datasets.runs_from_frame(two, correct=("E02:f*25.4",))


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"correct": ("E7:f*25.4",)}, "no edge 'E7'. Did you mean 'E07'"),
        ({"correct": ("E07:f*25,4",)}, "write TARGET:SYMBOL"),
        ({"correct": ("E07:f*0",)}, "no correction"),
        ({"correct": ("E07:f*1",)}, "no correction"),
        ({"correct": ("E07:F*2",)}, "column 'f [mm/rev]' is f; write f."),
        ({"correct": ("E07:edge*2",)}, "edge holds names, not numbers"),
        ({"correct": ("lines 2:t-5",)}, "t of line 2 would be -3 min, from 2"),
        ({"correct": ("E01:AW*-1",)}, "AW of line 32 would be -0"),
        ({"correct": ("E01:AW*1000",)}, "mm, which cannot be (usual 0.02 to 0.6 mm)"),
        ({"correct": ("lines 3:t+1e6",)}, "t of line 3 would be 1e+06 min, which cannot be"),
        ({"correct": ("lines 9000:t+5",)}, "no row in line 9000; the rows are in lines 2 to"),
        ({"correct": ("E07:f*2", "all:f*2")}, "is corrected twice"),
        ({"correct": ("all:f=cumulative",)}, "t, lc, lf of sub-tests are added up within each edge"),
        ({"correct": ("lines 3-5:t=cumulative",)}, "some rows of an edge cannot be added up; name whole edges"),
        ({"correct": ("all:t=cumulative",), "edge": "none"}, "no column names the cutting edges; name it with --edge"),
        ({"correct": ("E07:f*2",), "leave_out": ("E07",)}, "these rows are left out"),
        ({"leave_out": ("all",)}, "no row is left"),
        ({"leave_out": ("lines 5-2",)}, "is no line"),
        ({"leave_out": "E07"}, "give a list of texts"),
    ],
)
def test_what_cannot_be_corrected_is_refused(sound, read, option, words):
    with pytest.raises(UsageError) as refusal:
        read(sound, **option)
    assert words in str(refusal.value)


@given(
    st.sampled_from(["V", "f", "d", "t", "AW", "P"]),
    st.sampled_from([25.4, 60.0, 3.280839895, 9.80665]),
    st.sets(st.sampled_from([f"E{i:02d}" for i in range(1, 25)]), min_size=1, max_size=4),
)
@settings(max_examples=15, deadline=None)
def test_the_correction_of_a_suspect_undoes_the_mistake(symbol, factor, edges):
    frame = datasets.read_runs(FILE).to_frame()[["edge", "V", "f", "d", "t", "AW", "P"]].dropna(subset="AW")
    rows = frame["edge"].isin(edges)
    wrong = frame.assign(**{symbol: frame[symbol].where(~rows, frame[symbol] / factor)})
    suspect = Suspect(symbol, edges=tuple(sorted(edges)), factor=factor)
    truth = datasets.runs_from_frame(frame)
    runs = datasets.runs_from_frame(wrong, correct=(suspect.correction,))
    np.testing.assert_allclose(runs.values(symbol), truth.values(symbol), rtol=1e-5)


def test_corrections_are_recorded_in_the_parameter_file_and_repeat_the_reading(sound, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    changed(sound, ["E07"], FEED, 1 / 25.4).to_csv("tests.csv", index=False)
    assert main(["tests.csv", "--correct", "E07:f*25.4", "--leave-out", "lines 2", "--full", "--out", "out"]) == 0
    assert "--correct E07:f*25.4: f of" in capsys.readouterr().out
    (file,) = (tmp_path / "out").rglob("params.json")
    written = json.loads(file.read_text())
    assert written["provenance"]["options"]["correct"] == ["E07:f*25.4"]
    assert written["provenance"]["options"]["leave_out"] == ["lines 2"]


def test_a_remedy_is_added_to_the_command_as_typed():
    words = ["data.csv", "--correct", "E07:f*10", "--leave-out", "lines 3"]
    assert corrected(words, '--correct "E07:f*25.4"') == (
        "fitmodels data.csv --leave-out 'lines 3' --correct 'E07:f*25.4'"
    )
    assert corrected(words, "--correct E11:t-5") == (
        "fitmodels data.csv --correct 'E07:f*10' --leave-out 'lines 3' --correct E11:t-5"
    )


@pytest.mark.parametrize(
    ("given", "added", "found"),
    [
        (["--law", "Fc ~ V, ap"], ["--law", "Fc ~ + t - d"], ["--law", "Fc ~ V, t"]),
        (["--law", "Fc ~ + VB"], ["--law", "Fc ~ + d"], ["--law", "Fc ~ + VB + d"]),
        (["--law", "Fc ~ + VB"], ["--law", "Fc ~ + VB + d"], ["--law", "Fc ~ + VB + d"]),
        (["--law", "Fc ~ V", "--law=P ~ V"], ["--law", "Fc ~ f"], ["--law=P ~ V", "--law", "Fc ~ f"]),
        (["--form", "linear", "--form", "P=power"], ["--form", "power"], ["--form", "P=power", "--form", "power"]),
        (["--by", "coolant"], ["--by", "machine"], ["--by", "machine"]),
        (["--map", "edge=Nr"], ["--edge", "none"], ["--edge", "none"]),
        (["--value=D=80", "--hidden"], ["--value", "z=4", "--hidden"], ["--value=D=80", "--value", "z=4", "--hidden"]),
        (["--correct", "E7:f*10"], ["--correct", "E7:f*25.4", "--correct", "E7:t-5"],
         ["--correct", "E7:f*25.4", "--correct", "E7:t-5"]),
    ],
)  # fmt: skip
def test_an_option_takes_the_place_of_those_that_set_the_same(given, added, found):
    assert merged(["a.csv", *given], added) == ["a.csv", *found]
    assert corrected(["a.csv", *given, "--force"], shlex.join(added)) == shlex.join(["fitmodels", "a.csv", *found])
    assert shlex.split(shlex.join(applied(given, shlex.join(added)))) == found


@pytest.mark.parametrize(
    ("parser", "purposes"),
    [(wear.parser, None), (look.parser, TAKEN["look"]), (compare.parser, TAKEN["compare"]),
     (further.parser, TAKEN["next"]), (batch.parser, ())],
)  # fmt: skip
def test_the_table_of_options_is_that_of_the_commands(parser, purposes):
    actions = {name: one for one in parser()._actions for name in one.option_strings}
    ours = {name: one for name, one in actions.items() if name in OPTIONS}
    assert {name: one.nargs == 0 for name, one in ours.items()} == {name: OPTIONS[name].flag for name in ours}
    taken = {name for name, one in OPTIONS.items() if purposes and one.purpose in purposes}
    assert taken <= set(actions)
    if purposes is None:
        assert set(actions) - set(OPTIONS) == {"--help", "--help-all", "-h", "--version", "-V"}
    if parser is batch.parser:
        assert {OPTIONS[name].purpose for name in ours} == {*TAKEN["batch"], "batch", "place", "screen"}


def strings(data):
    """Texts under ``command``, at any depth, but those that have made a card."""
    if isinstance(data, dict):
        own = [data["command"]] if data.get("command") else []
        return own + [text for name, one in data.items() if name != "provenance" for text in strings(one)]
    return [text for one in data for text in strings(one)] if isinstance(data, list) else []


@pytest.fixture(scope="module")
def forces():
    """Conditions and forces of 24 tests."""
    rng = np.random.default_rng(5)
    levels = {"v (m/min)": [120.0, 160, 200, 250], "f (mm/rev)": [0.1, 0.2, 0.3, 0.4], "ap (mm)": [0.5, 1, 2]}
    table = pd.DataFrame({name: rng.choice(values, 24) for name, values in levels.items()})
    force = 1800 * table["f (mm/rev)"] ** 0.75 * table["ap (mm)"] ** 0.95 * np.exp(rng.normal(0, 0.03, 24))
    return table.assign(**{"Fc (N)": force.round(1)})


def a_slow_speed_in_one_coolant(table):
    dry = np.arange(24) % 2 == 1
    factor = np.where(dry, 1.4, 1.0) * np.exp(-0.9 * np.log(table["v (m/min)"] / 160) ** 2)
    return table.assign(coolant=np.where(dry, "dry", "wet"), **{"Fc (N)": table["Fc (N)"] * factor})


@pytest.mark.parametrize(
    ("change", "options", "proposed"),
    [
        (lambda table: table, ["--law", "Fc ~ V, f"], "--law 'Fc ~ V, f, d' --force"),
        (a_slow_speed_in_one_coolant, ["--law", "Fc ~ V, f", "--by", "coolant", "--error", "additive"],
         "fitmodels compare data.csv --law 'Fc ~ V, f' --by coolant --error additive"),
        (lambda table: table.assign(**{"Fc (N)": table["Fc (N)"] * np.where(np.arange(24) == 7, 10, 1)}),
         ["--correct", "line 3:Fc*1.01"], "--correct 'lines 9:Fc/10'"),
        (lambda table: table.rename(columns={"Fc (N)": "Fc"}).eval("Fc = Fc / 10"), ["--map", "Fc=col4"],
         "fitmodels data.csv --map Fc=col4 --unit Fc=daN"),
    ],
)  # fmt: skip
def test_every_command_that_is_proposed_is_accepted(forces, change, options, proposed, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    change(forces).to_csv("data.csv", index=False)
    assert main(["data.csv", *options, "--draws", "1000"]) == 0
    found = [line.partition("  #")[0] for line in re.findall(r"(?m)^ *(fitmodels .*)", capsys.readouterr().out)]
    (card,) = Path("data-fit").rglob("card.json")
    cards = [
        text.replace(" params.json", f" {card.parent}/params.json") for text in strings(json.loads(card.read_text()))
    ]
    assert main(["look", *chosen(["data.csv", *options], TAKEN["look"]), "--json"]) == 0
    found += cards + [one["command"] for one in json.loads(capsys.readouterr().out)["commands"]]
    assert any(proposed in command for command in found), found
    for number, command in enumerate(dict.fromkeys(found)):
        words = shlex.split(command)[1:]
        words = merged(words, ["--out", f"new{number}"]) if words[0] == "data.csv" else words
        assert main(words) == 0, f"{command}: {capsys.readouterr().err}"


def test_a_batch_refuses_corrections(tmp_path, capsys):
    assert main(["batch", str(FILE), "--out", str(tmp_path / "out"), "--leave-out", "E07"]) == 2
    assert "--leave-out: edges and lines are of one file" in capsys.readouterr().err


TARGETS = st.sampled_from(
    ["E07", "E07,E11", "all", "lines 3", "lines 2-9", "lines 1-99999999999999999999", "row 4 of E01", ""]
)
NUMBERS = st.sampled_from(["25.4", "1e300", "1e-300", "1e999", "-1", "0", "1.2.3", ".", "60"])


@given(
    st.lists(
        st.one_of(
            st.text(max_size=20),
            st.builds(
                "{}:{}{}{}".format, TARGETS, st.sampled_from(["f", "t", "AW", "q"]), st.sampled_from("*/+-^"), NUMBERS
            ),
        ),
        max_size=2,
    ),
    st.lists(st.one_of(st.text(max_size=12), TARGETS), max_size=2),
)
@settings(max_examples=60, deadline=None)
def test_any_text_is_a_correction_or_refused_in_a_sentence(correct, leave_out):
    frame = datasets.read_runs(FILE).to_frame()[["edge", "V", "f", "d", "t", "AW"]].dropna()
    try:
        said = " ".join(datasets.runs_from_frame(frame, correct=correct, leave_out=leave_out).assumed)
    except FitmodelsError as error:
        said = str(error)
    assert said.count("as asked") in (0, len(correct) + len(leave_out))


def test_rows_with_unreadable_cells_are_named_at_once_and_can_be_left_out(tmp_path):
    """One cell was named at a time, and the row that was left out stopped the reading as before."""
    text = datasets.bundled("gc435_709m40").read_text("utf-8").splitlines()
    at = [k for k, line in enumerate(text) if line.startswith("E")][3:30:9]
    for k, cell in zip(at, ("120?", "x1", "y"), strict=True):
        words = text[k].split(",")
        words[6 if cell == "120?" else 7] = cell
        text[k] = ",".join(words)
    path = tmp_path / "a.csv"
    path.write_text("\n".join(text), encoding="utf-8")
    lines = ",".join(str(k + 1) for k in at)
    with pytest.raises(DataError, match=f"120[?].*x1.*Or leave these rows out: --leave-out 'lines {lines}'"):
        datasets.read_runs(path)
    with pytest.raises(DataError, match="'x1'"):
        datasets.read_runs(path, leave_out=[f"lines {at[0] + 1}"])
    assert (
        len(datasets.read_runs(path, leave_out=[f"lines {lines}"]))
        == len(datasets.read_runs(datasets.bundled("gc435_709m40"))) - 3
    )


@pytest.mark.parametrize(
    ("change", "value", "right"), [("f/10", 3.0, 0.3), ("f/1000", 345.0, 0.345), ("f*25.4", 0.01, 0.254)]
)
def test_a_correction_gives_the_value_as_it_would_be_typed(change, value, right):
    assert parse_correction(f"all:{change}").apply(np.array([value])).tolist() == [right]
