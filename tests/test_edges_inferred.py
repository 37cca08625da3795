"""Cutting edges of a file: the column that names them by its content, the order of the tests, and checks within edges.

The NASA figures are those of the published milling set (16 cases): K. Goebel and A. Agogino, Mill data set, NASA.
"""

import itertools

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import UsageError
from fitmodels.datasets.options import ReadOptions
from fitmodels.fit.checks import usefulness
from hypothesis import given, settings
from hypothesis import strategies as st

SETTINGS = list(itertools.product((100.0, 150.0, 220.0), (0.1, 0.2), (1.0, 2.0)))
TIMES = (2.0, 4.0, 6.0, 8.0, 10.0)
ROWS = len(SETTINGS) * len(TIMES)
PER_EDGE = len(TIMES)


def designed(edges=SETTINGS, seed=1):
    """Rows of edges in the order of their tests."""
    rng = np.random.default_rng(seed)
    rows = []
    for k, (V, f, d) in enumerate(edges):
        level = rng.normal(0, 0.05)
        for t in TIMES:
            wear = 0.02 * (V / 100) ** 0.6 * f**0.17 * d**0.25 * t**0.4 * np.exp(level + rng.normal(0, 0.03))
            rows.append((f"E{k + 1:02d}", V, f, d, t, round(float(wear), 4)))
    return pd.DataFrame(rows, columns=["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "VB [mm]"])


TABLE = designed()
NUMBER = pd.factorize(TABLE["edge"])[0]
V, F, T, VB = (next(c for c in TABLE if c.startswith(role + " [")) for role in ("V", "f", "t", "VB"))


def read(frame, **options):
    return datasets.runs_from_frame(frame.reset_index(drop=True), **{"tool": "GC435", "work": "Ck 45"} | options)


def without(**columns):
    return TABLE.drop(columns="edge").assign(**columns)


def partition(runs):
    return pd.factorize(runs.labels("edge"))[0].tolist()


def doubted(runs):
    return " | ".join(map(str, runs.doubts))


def changed(line, column, value, frame=TABLE):
    frame = frame.copy()
    frame.loc[line, column] = value
    return frame


@pytest.mark.parametrize(
    "name",
    ["Insert", "Platte", "Schneide", "Schneidplatte", "plaquette", "filo", "arête", "tool no.", "tool #", "Tool",
     "Werkzeug Nr.", "outil no", "n° outil", "plaquita", "inserto", "corner", "Ecke", "tip", "No.", "Run", "Test no.",
     "file"],
)  # fmt: skip
@pytest.mark.parametrize("labels", [NUMBER + 1.0, [f"A{k + 1}" for k in NUMBER]], ids=["numbers", "texts"])
def test_a_column_with_rising_time_in_each_value_is_that_of_the_edges(name, labels):
    runs = datasets.runs_from_frame(without(**{name: labels}))
    assert partition(runs) == NUMBER.tolist()
    assert len(list(runs.pairs())) == 1
    assert runs.doubts == ()


def test_the_decision_is_printed_with_the_option_that_reverses_it():
    runs = read(without(Insert=NUMBER + 1.0), tool=None)
    said = "column 'Insert' has 12 values with rising time in each: cutting edges, not tool types; --map tool=Insert"
    assert any(note.startswith(said) for note in runs.assumed)
    assert len(list(read(without(Insert=NUMBER + 1.0), tool=None, map={"tool": "Insert"}).pairs())) == 12


def two_types(**columns):
    first, second = ({name: values[k] for name, values in columns.items()} for k in (0, 1))
    return pd.concat([TABLE.assign(**first), TABLE.assign(**second)], ignore_index=True)


@pytest.mark.parametrize("name", ["Tool", "Insert", "Platte", "Schneide", "plaquette"])
@pytest.mark.parametrize("types", [("GC435", "GC4025"), ("Sandvik CNMG 120408", "Kennametal")])
def test_two_makers_or_grades_are_types_of_tools(name, types):
    runs = read(two_types(**{name: types}).drop(columns="edge"), tool=None)
    assert sorted(pair.tool for pair in runs.pairs()) == sorted(types)
    assert len(set(partition(runs))) == 24
    assert all(len(set(partition(pair))) == 12 for pair in runs.pairs())


def test_a_grade_stays_the_tool_beside_numbered_inserts():
    runs = read(without(Insert=NUMBER + 1.0).assign(**{"Tool material": "GC435"}), tool=None)
    assert (runs.tool, partition(runs)) == ("GC435", NUMBER.tolist())


@pytest.mark.parametrize("inserts", [NUMBER // 4 + 1, [f"P{k // 4 + 1}" for k in NUMBER]], ids=["numbers", "texts"])
@pytest.mark.parametrize("corner", ["corner", "edge", "Ecke", "Schneide"])
def test_corner_and_insert_name_an_edge_together(inserts, corner):
    runs = read(without(Insert=inserts).assign(**{corner: NUMBER % 4 + 1}), tool=None)
    assert partition(runs) == NUMBER.tolist()
    assert len(list(runs.pairs())) == 1
    assert any("combinations of columns 'Insert' and" in note for note in runs.assumed)


def test_numbers_of_inserts_with_several_edges_are_no_types_of_tools():
    runs = read(without(Insert=NUMBER // 4 + 1.0), tool=None)
    assert len(list(runs.pairs())) == 1
    assert partition(runs) == NUMBER.tolist()


def test_numbers_of_rows_are_no_edges():
    runs = read(without(**{"Test no": np.arange(ROWS) + 1.0}))
    assert partition(runs) == NUMBER.tolist()
    assert any("'Test no' numbers every row" in note for note in runs.assumed)
    runs = read(TABLE.assign(edge=np.arange(ROWS) + 1.0))
    assert "--map run=edge" in doubted(runs)
    assert partition(read(TABLE.assign(edge=np.arange(ROWS) + 1.0), map={"run": "edge"})) == NUMBER.tolist()


def test_unused_columns_that_tell_repeats_of_a_setting_apart_name_edges():
    twice = designed([one for one in SETTINGS[:6] for _ in range(2)]).drop(columns="edge")
    setting, replicate = np.arange(len(twice)) // (2 * PER_EDGE) + 1, np.arange(len(twice)) // PER_EDGE % 2 + 1
    runs = read(twice.assign(Setting=setting, Replicate=replicate))
    assert runs.labels("edge")[:: 2 * PER_EDGE].tolist() == [f"{k}/1" for k in range(1, 7)]
    assert partition(runs) == partition(read(twice))
    assert any("columns 'Setting' and 'Replicate' together number the edges" in note for note in runs.assumed)
    law = fit.power_law(runs, "VB", ["V", "f", "d", "t"])
    assert usefulness.number_of_edges(law, runs).concern == 0


def test_a_number_of_each_setting_names_no_edge():
    runs = read(without(Setting=NUMBER + 1))
    assert runs.labels("edge")[-1] == "E12"
    assert next(use.role for use in runs.columns if use.name == "Setting") is None


def test_a_row_of_a_wide_table_is_an_edge_under_any_number(tmp_path):
    wide = TABLE.pivot_table(index=["edge", "V [m/min]", "f [mm/rev]", "d [mm]"], columns=T, values=VB).reset_index()
    wide.columns = [name if isinstance(name, str) else f"VB [mm] {name:g} min" for name in wide.columns]
    wide.insert(0, "Cutting data No.", range(1, len(wide) + 1))
    wide.drop(columns="edge").to_csv(tmp_path / "a.csv", index=False)
    runs = datasets.read_runs(tmp_path / "a.csv")
    assert runs.labels("edge")[::PER_EDGE].tolist() == [str(k) for k in range(1, 13)]
    assert next(use.role for use in runs.columns if use.header == "Cutting data No.") == "edge"


def test_one_row_a_test_stays_as_it_is():
    once = TABLE[TABLE[T] == 6]
    assert len(set(partition(read(once)))) == len(once)
    runs = read(once.drop(columns="edge"))
    assert not runs.has("edge")
    assert runs.doubts == ()
    randomised = TABLE.drop(columns="edge").sample(frac=1, random_state=3).assign(Run=np.arange(ROWS) + 1.0)
    assert not read(randomised).has("edge")


def test_edges_are_inferred_from_the_order_of_the_tests():
    runs = read(without())
    assert partition(runs) == NUMBER.tolist()
    assert runs.labels("edge")[-1] == "E12"
    assert any("edges inferred from the order of the tests" in note and "12 edges of 5 rows" in note
               for note in runs.assumed)  # fmt: skip
    assert runs.doubts == ()
    assert not read(without(), edge="none").has("edge")


def test_inferred_edges_give_the_inference_of_named_ones():
    named, found = (fit.power_law(read(frame), "VB", ["V", "f", "d", "t"]) for frame in (TABLE, without()))
    np.testing.assert_allclose(found.bse, named.bse, rtol=1e-12)
    assert found.edges.df == named.edges.df == 11


@settings(max_examples=40)
@given(
    st.lists(st.sampled_from(SETTINGS), min_size=4, max_size=14),
    st.randoms(use_true_random=False),
)
def test_any_order_of_blocks_keeps_the_partition(edges, random):
    frame = designed(edges)
    blocks = [block for _, block in frame.groupby("edge", sort=False)]
    random.shuffle(blocks)
    frame = pd.concat(blocks, ignore_index=True)
    truth = pd.factorize(frame["edge"])[0].tolist()
    assert partition(read(frame.drop(columns="edge"))) == truth
    assert partition(read(frame.rename(columns={"edge": "Insert"}), tool=None)) == truth


def test_shuffled_rows_of_one_edge_a_setting_are_inferred_and_others_doubted():
    mixed = TABLE.sample(frac=1, random_state=1)
    runs = read(mixed.drop(columns="edge"))
    assert partition(runs) == pd.factorize(mixed["edge"])[0].tolist()
    twice = designed(SETTINGS * 2).sample(frac=1, random_state=1)
    runs = read(twice.drop(columns="edge"))
    assert not runs.has("edge")
    assert "Standard errors cannot be defended" in doubted(runs)
    assert runs.doubts[0].remedy == "--edge none"
    assert read(twice.drop(columns="edge"), edge="none").doubts == ()


def test_merged_cells_are_filled_down():
    inner = TABLE[T] > 2
    merged = TABLE.copy()
    merged.loc[inner, "edge"] = ""
    merged.loc[inner, [V, F]] = np.nan
    runs = read(merged)
    assert partition(runs) == NUMBER.tolist()
    np.testing.assert_array_equal(runs.values("V"), TABLE[V])
    assert [note.split(":")[0] for note in runs.warnings] == ["column 'edge'", f"column {V!r}", f"column {F!r}"]
    assert "48 blank cells" in runs.warnings[0]
    law, truth = (fit.power_law(read(frame), "VB", ["V", "f", "d", "t"]) for frame in (merged, TABLE))
    np.testing.assert_allclose(law.bse, truth.bse, rtol=1e-12)  # not those of one edge named ""


def test_isolated_blanks_are_not_filled_with_other_edges():
    runs = read(changed([7, 33], "edge", ""))
    assert partition(runs) == NUMBER.tolist()
    runs = read(changed([9, 10], "edge", ""))  # the last row of one edge and the first of the next
    assert "lines 9 and 10 name no edge" in doubted(runs)
    assert "" not in set(runs.labels("edge"))
    assert np.isnan(read(changed([7, 12, 33], V, np.nan)).values("V")).sum() == 3


def test_spellings_of_one_edge_are_joined_and_others_doubted():
    runs = read(changed([6, 7], "edge", ["e02", "E 2"]))
    assert partition(runs) == NUMBER.tolist()
    assert sum("another spelling" in note for note in runs.warnings) == 2
    assert "is the name misspelled" in doubted(read(changed(7, "edge", "E20")))


@pytest.mark.parametrize("line", [5, 7, 9], ids=["first", "middle", "last"])
@pytest.mark.parametrize("frame", [TABLE, without()], ids=["named", "inferred"])
def test_a_single_setting_that_differs_in_an_edge_is_named(frame, line):
    runs = read(changed(line, F, 5.08, frame))
    assert f"line {line} has 5.08 where the other rows of edge E02 have 0.1" in doubted(runs)
    assert partition(runs) == NUMBER.tolist()


@pytest.mark.parametrize(("line", "time"), [(7, 0.6), (7, 60.0), (9, 100.0), (5, 20.0), (5, 0.2)])
@pytest.mark.parametrize("frame", [TABLE, without()], ids=["named", "inferred"])
def test_a_time_that_is_out_of_order_is_named(frame, line, time):
    runs = read(changed(line, T, time, frame))
    assert partition(runs) == NUMBER.tolist()
    assert any("t" in doubt.columns and ("line" in doubt.sentence) for doubt in runs.doubts)


@pytest.mark.parametrize("line", range(5, 10))
@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_digit_slipped_in_a_wear_is_named(line, factor):
    value = float(TABLE[VB][line]) * factor
    assert f"VB jumps within an edge: line {line} has" in doubted(read(changed(line, VB, value)))


def test_falling_wear_repeated_rows_and_repeated_times_are_named():
    fallen = changed(8, VB, 0.6 * float(TABLE[VB][7]))
    assert "at line 8; wear does not heal" in doubted(read(fallen))
    copied = pd.concat([TABLE, TABLE.iloc[[59]]], ignore_index=True)
    assert "line 60 repeats an earlier row" in doubted(read(copied))
    assert "4 min at lines 6 and 7 of edge E02" in doubted(read(changed(7, T, 4.0)))


def indexed(changes, seed=1, scatter=0.04):
    """Wear of eight edges; after ``changes`` rows of the ten of some edges a new insert was cut on under their name."""
    rng, frames = np.random.default_rng(seed), []
    for e, (V, f) in enumerate((V, f) for V in (120, 160, 200, 240) for f in (0.15, 0.25)):
        t = np.arange(2.0, 30.0, 3.0)
        of_insert = t - np.where(np.arange(10) >= changes.get(e, 10), t[changes.get(e, 0)] - 2, 0)
        VB = 0.0008 * V**0.7 * f**0.2 * of_insert**0.45 * np.exp(rng.normal(0, scatter, 10))
        frames.append(pd.DataFrame({"edge": f"E{e + 1}", "vc": V, "f": f, "t [min]": t, "VB [mm]": VB.round(3)}))
    return pd.concat(frames, ignore_index=True)


def test_inserts_indexed_under_one_name_are_named():
    """More falls than one in ten steps were taken as a property of the tests, and nothing was said."""
    said = doubted(read(indexed(dict.fromkeys(range(8), 5))))
    assert "VB falls to its first values and rises again in 8 of 8 edges: E1 from" in said
    assert "at line 5" in said
    assert "give each insert a name of its own" in said
    assert "in 5 of 8 edges" in doubted(read(indexed({0: 5, 1: 4, 3: 6, 6: 5, 7: 3})))
    for seed in range(5):
        assert "VB falls" not in doubted(read(indexed({}, seed, 0.2)))


def test_time_that_runs_on_or_is_counted_by_sub_test_is_doubted():
    assert "t runs on from edge to edge" in doubted(read(TABLE.assign(**{T: np.arange(ROWS) * 2.0 + 2})))
    for frame in (TABLE, without()):
        runs = read(frame.assign(**{T: 2.0}))
        assert "the time of each sub-test" in doubted(runs)
        (doubt,) = (one for one in runs.doubts if "sub-test" in one.sentence)
        assert doubt.columns == ("t", "VB")  # t is constant, and in no law
        assert doubt.unsettled


def test_edges_inferred_from_times_of_sub_tests_are_doubted():
    """Each sub-test whose time is not longer began an edge of its own, with more wear than the edge before."""
    runs = read(without().assign(**{T: np.tile([2.0, 2, 3, 4, 5], ROWS // 5)}))
    (doubt,) = (one for one in runs.doubts if "is it the time of each sub-test" in one.sentence)
    assert doubt.unsettled
    assert read(without()).doubts == ()


@pytest.mark.parametrize("role", ["V", "f", "d", "t"])
@pytest.mark.parametrize("by", [-1, 1])
@pytest.mark.parametrize("frame", [TABLE, without()], ids=["named", "inferred"])
def test_a_column_shifted_by_one_row_is_doubted(frame, role, by):
    column = next(c for c in frame if c.startswith(role + " ["))
    runs = read(frame.assign(**{column: np.roll(frame[column], by)}))
    assert any(role in doubt.columns for doubt in runs.doubts)


def test_edges_of_another_unit_are_named():
    wrong = TABLE.copy()
    wrong.loc[NUMBER == 4, VB] *= 25.4
    assert "VB is of another order than in the other edges: edge E05" in doubted(read(wrong))


def test_a_load_of_another_column_or_unit_in_one_edge_is_named():
    """The loads of the edges differ by their feeds and depths: 1/300 of one of them is seen over the section f d."""
    rng = np.random.default_rng(3)
    noise = np.exp(rng.normal(0, 0.1, ROWS))
    force = (1800 * TABLE[F] ** 0.75 * TABLE["d [mm]"] ** 0.95 * (1 + 2 * TABLE[VB]) * noise).round()
    sound = TABLE.assign(**{"Fc [N]": force})
    assert read(sound).doubts == ()
    other = sound.assign(**{"Fc [N]": np.where(NUMBER == 4, (force / 120).round(2), force)})
    assert "Fc is of another order than in the other edges: edge E05" in doubted(read(other))


@pytest.mark.parametrize("by", [-1, 1])
def test_a_load_with_scatter_shifted_by_one_row_is_doubted(by):
    """Each last (first) value is of the next edge (of the one before); a rise at the end of each edge is sound."""
    rng = np.random.default_rng(3)
    scatter, end = np.exp(rng.normal(0, 0.1, ROWS)), np.where(TABLE[T] == TIMES[-1], 1.4, 1.0)
    force = 1800 * TABLE[F] ** 0.75 * TABLE["d [mm]"] ** 0.95 * scatter
    edges = rng.permutation(len(SETTINGS))
    rows = np.concatenate([np.arange(PER_EDGE) + PER_EDGE * k for k in edges])
    for load in (force, force * end):
        assert read(TABLE.assign(**{"Fc [N]": load.round()}).loc[rows]).doubts == ()
    moved = TABLE.loc[rows].assign(**{"Fc [N]": force[rows].shift(by).round()})
    assert f"Fc jumps at the {'last' if by < 0 else 'first'} row of most edges" in doubted(read(moved))


def test_tests_with_changing_conditions_and_several_readings_are_sound():
    assert read(TABLE.assign(**{F: np.tile([0.1, 0.15, 0.2, 0.25, 0.3], 12)})).doubts == ()
    rng = np.random.default_rng(5)
    twice = TABLE.loc[np.repeat(np.arange(ROWS), 2)].assign(**{VB: lambda x: x[VB] + rng.normal(0, 0.001, 2 * ROWS)})
    assert read(twice).doubts == ()


@pytest.mark.parametrize("seed", range(12))
def test_a_sound_file_is_not_doubted(seed):
    assert read(designed(seed=seed)).doubts == ()


def test_the_edge_is_named_once():
    assert ReadOptions(edge="Insert").columns == {"edge": "Insert"}
    assert partition(read(TABLE.rename(columns={"edge": "point"}), edge="point")) == NUMBER.tolist()
    with pytest.raises(UsageError, match=r"edge 'a' and map edge='b' name different columns"):
        ReadOptions(edge="a", map={"edge": "b"})


def test_readings_of_one_test_are_one_edge(measurements):
    """Six roughness readings of each turned surface, with its mean forces repeated on each row."""
    path = measurements / "turning_forces" / "Exp1.csv"
    runs, rows = datasets.read_runs(path), datasets.read_runs(path, edge="none")
    assert len(set(runs.labels("edge"))) == 54
    assert any("'Run_ID' has 54 values" in note for note in runs.assumed)
    by_test, by_row = (fit.power_law(some, "Ra", ["V", "f", "d"]) for some in (runs, rows))
    np.testing.assert_allclose(by_test.theta, by_row.theta, rtol=1e-12)
    assert (by_test.bse / by_row.bse).min() > 2  # they differ by their readings, which are not repeated tests
    forces = [fit.power_law(some, "Fx", ["V", "f", "d"]) for some in (runs, rows)]
    np.testing.assert_allclose(forces[0].bse, forces[1].bse, rtol=1e-12)


@pytest.mark.parametrize("by", [-1, 1])
def test_a_measured_column_shifted_by_one_row_is_doubted(by):
    for frame in (TABLE, without()):
        assert "VB jumps" in doubted(read(frame.assign(**{VB: np.roll(frame[VB], by)})))
    force = 1800 * TABLE[F] ** 0.75 * TABLE["d [mm]"] ** 0.95 * (1 + 2 * TABLE[VB])
    found = doubted(read(TABLE.assign(**{"Fc [N]": np.roll(force, by)})))
    assert "Fc jumps at the" in found
    assert "moved by one row" in found
    assert read(TABLE.assign(**{"Fc [N]": force.round()})).doubts == ()


def test_wear_along_edges_without_a_time_is_doubted():
    runs = read(TABLE.rename(columns={T: "stamp"}))
    assert "no column is the cutting time" in doubted(runs)
    assert runs.doubts[0].remedy == '--map "t=stamp"'


def test_names_that_start_again_are_distinguished_by_the_order():
    runs = read(TABLE.assign(edge=[str(k % 4 + 1) for k in NUMBER]))
    assert partition(runs) == NUMBER.tolist()
    assert any("numbers edges anew" in note for note in runs.assumed)


def test_rows_pasted_again_are_copies_and_no_edges_anew():
    """Taken as new edges, three copies of a test would make its standard errors too small by the root of 3."""
    runs = read(pd.concat([TABLE] * 3, ignore_index=True))
    assert partition(runs) == NUMBER.tolist() * 3
    assert not any("anew" in note for note in runs.assumed)


def test_a_table_pasted_again_is_stated_and_its_check_says_what_is_counted():
    runs = read(pd.concat([TABLE] * 2, ignore_index=True))
    stated = "60 rows (lines 60-119) repeat the 60 others in every cell, and each measurement is counted once"
    assert f"rows that stand twice: {stated}" in runs.assumed
    assert runs.doubts == ()
    check = fit.judge(fit.power_law(runs, "VB", ["V", "f", "d", "t"])).checks["copies"]
    assert (check.symbol, check.statistic, check.concern) == ("copies counted", 0, 0)
    assert "contains each measurement 2 times, and each is counted once" in check.verdict


def test_half_a_table_pasted_again_is_doubted_with_the_rows_to_leave_out():
    runs = read(pd.concat([TABLE, TABLE.iloc[:30]], ignore_index=True))
    (doubt,) = (doubt for doubt in runs.doubts if "would count twice" in doubt.sentence)
    assert (doubt.remedy, doubt.lines) == ('--leave-out "lines 60-89"', tuple(range(60, 90)))
    assert not any("stand twice" in text for text in runs.assumed)
    left = read(pd.concat([TABLE, TABLE.iloc[:30]], ignore_index=True), leave_out=["lines 60-89"])
    assert (len(left), left.doubts) == (60, ())


def test_one_material_pasted_again_is_stated_for_its_rows():
    both = [TABLE.assign(Material=name) for name in ("C45", "C45", "42CrMo4")]
    runs = read(pd.concat(both, ignore_index=True), work=None)
    assert any("60 rows (lines 60-119) repeat the 60 others" in text for text in runs.assumed)
    assert runs.doubts == ()
    laws = [fit.power_law(pair, "VB", ["V", "f", "d", "t"]) for pair in runs.pairs()]
    assert [(law.repeats, law.nobs) for law in laws] == [(2, 60), (1, 60)]


def test_names_that_start_again_with_each_material_are_kept():
    both = pd.concat([TABLE.assign(Material=name) for name in ("C45", "42CrMo4")], ignore_index=True)
    runs = read(both, work=None)
    assert runs.labels("edge").tolist() == both["edge"].tolist()
    assert [len(set(pair.labels("edge"))) for pair in runs.pairs()] == [12, 12]
    assert runs.doubts == ()


def test_spellings_of_a_work_material_are_one_pair():
    runs = read(TABLE.assign(Material=["c45 " if k % 7 else "C45" for k in range(ROWS)]), work=None)
    assert (runs.work, len(list(runs.pairs()))) == ("c45 ", 1)


@pytest.mark.parametrize("drop", [["case"], ["case", "run"]], ids=["case", "case and run"])
@pytest.mark.parametrize("measured", [False, True], ids=["all rows", "rows with wear"])
def test_nasa_milling_has_its_16_edges_without_the_column(measurements, drop, measured):
    frame = pd.read_csv(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    frame = frame.dropna(subset=["VB"]) if measured else frame
    named, found = (datasets.runs_from_frame(x.reset_index(drop=True)) for x in (frame, frame.drop(columns=drop)))
    assert partition(found) == partition(named)
    assert len(set(partition(found))) == 16
    laws = [fit.power_law(runs, "VB", ["d", "f", "t"]) for runs in (named, found)]
    np.testing.assert_allclose(laws[1].bse, laws[0].bse, rtol=1e-9)
    np.testing.assert_allclose(laws[1].theta, laws[0].theta, rtol=1e-12)


def test_a_long_table_says_what_is_not_checked():
    n = 100_001
    frame = pd.DataFrame({"edge": np.arange(n) // 5, "V": 100.0, "t": np.arange(n) % 5 + 1.0, "VB": 0.1})
    said = [text for text in datasets.runs_from_frame(frame).assumed if "not checked" in text]
    assert any("more than 100000 rows: cells, times and settings within edges" in text for text in said)


def test_equal_readings_of_one_cut_are_no_copies():
    """Three readings of each cut to 1 N: by their scatter of 1 to 3 N some are equal; a reading alone is a copy."""
    cuts = [(100, 0.1, (320, 321, 320)), (100, 0.3, (1460, 1458, 1461)), (200, 0.1, (640, 641, 641)),
            (200, 0.3, (725, 724, 726)), (150, 0.2, (830, 832, 831)), (150, 0.3, (1105, 1106, 1105))]  # fmt: skip
    rows = [(i, V, f, Fc) for i, (V, f, forces) in enumerate(cuts, 1) for Fc in forces]
    head = ["Test", "vc [m/min]", "f [mm/rev]", "Fc [N]"]
    assert "repeat" not in doubted(read(pd.DataFrame(rows, columns=head)))
    copied = pd.DataFrame([*rows, (7, 120, 0.2, 800), (7, 120, 0.2, 800)], columns=head)
    assert "repeats an earlier row" in doubted(read(copied))


@pytest.mark.parametrize(
    ("header", "factor", "remedy"),
    [
        ("l [m]", 120.0, '--map "lc=l [m]"'),
        ("s [mm]", 90.0, '--map "lf=s [mm]"'),
        ("clock [s]", 60.0, '--map "t=clock [s]"'),
        ("clock", 1.0, '--map "t=clock"'),
        ("heat [N]", 1.0, ""),
    ],
)
def test_a_column_that_rises_along_the_edges_is_named_by_the_role_that_its_unit_allows(header, factor, remedy):
    frame = TABLE.assign(**{T: TABLE[T] * factor}).rename(columns={T: header})
    (doubt,) = (one for one in read(frame).doubts if "no column is the cutting time" in one.sentence)
    assert doubt.remedy == remedy
    if remedy:
        role = remedy.split('"')[1].split("=")[0]
        assert "no column is the cutting time" not in doubted(read(frame, map={role: header}))


@pytest.mark.parametrize(("test", "edge"), [("Versuch", "Schneide"), ("Test no", "cutting edge"), ("Ensayo", "Filo")])
def test_a_column_of_edges_counts_before_one_of_tests_which_is_the_run(test, edge):
    names = np.random.default_rng(1).permutation(NUMBER.max() + 1)[NUMBER]
    runs = read(without().assign(**{test: NUMBER + 1, edge: [f"S{k + 1:02d}" for k in names]}))
    assert runs.labels("edge").tolist() == [f"S{k + 1:02d}" for k in names]
    assert runs.labels("run").tolist() == [str(k + 1) for k in NUMBER]
    corners = read(without().assign(**{edge: NUMBER % 4 + 1, test: NUMBER + 1}))  # an edge of an insert, not of all
    assert partition(corners) == NUMBER.tolist()
