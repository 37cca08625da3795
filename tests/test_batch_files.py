"""Lab files, folders of them and long CSVs as sources of `batch`: plan, blocks, rows."""

import json
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.batch.engine import engine
from fitmodels.batch.plan import Pair, Reading
from fitmodels.batch.source import chunks_of, open_source, rows_of
from fitmodels.batch.source.csv_copy import converted, csv_stream
from fitmodels.batch.source.csv_rows import Cells
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets.tables.numerals import MISSING_AS_WRITTEN, to_floats
from hypothesis import given
from hypothesis import strategies as st

POINT = "edge,V,f,t,AW,tool,work\n"


def table(tool, n=12, seed=1, work="steel", first=1):
    """Rows of a wear test, four to an edge."""
    rng = np.random.default_rng(seed)
    lines = []
    for k in range(n):
        V, f, t = (100, 150, 200)[k // 4 % 3], (0.2, 0.4)[k // 4 % 2], 2 + 3 * (k % 4)
        AW = 0.01 * t**0.6 * (V / 100) * np.exp(0.05 * rng.normal())
        lines.append(f"{first + k // 4},{V},{f},{t},{AW:.4f},{tool},{work}\n")
    return "".join(lines)


def german(text):
    """The same table with semicolons and decimal commas, headers in German with units."""
    body = text.splitlines()[1:]
    head = "Schneide;vc [m/min];Vorschub [mm/U];Zeit [min];VB [mm];Werkzeug;Werkstoff\n"
    return head + "".join(line.replace(",", ";").replace(".", ",") + "\n" for line in body)


@pytest.fixture
def lab(tmp_path):
    """A folder as laboratories have them."""
    folder = tmp_path / "lab"
    (folder / "old" / "deep").mkdir(parents=True)
    (folder / "a.csv").write_text("# simulated by a student\n" + POINT + table("T1") + table("T2", 8, 2))
    (folder / "b.CSV").write_text(german(POINT + table("T1", 8, 3)), encoding="cp1252")
    inches = "edge,vc [sfm],f [ipr],t [min],VB [in]\n1,300,0.01,2,0.004\n1,300,0.01,4,0.006\n2,400,0.01,2,0.007\n"
    (folder / "old" / "inches.txt").write_text(inches)
    frame = pd.DataFrame({"vc [m/min]": [100.0, 200], "t [min]": [2.0, 3], "VB [mm]": [0.1, 0.2], "Tool": ["X1", "X1"]})
    frame.to_excel(folder / "old" / "deep" / "book.xlsx", index=False)
    (folder / "broken.csv").write_text("V;f\n")
    record = "t [s],u,y\n" + "".join(f"{k / 50},{k % 3},{k % 5}\n" for k in range(60))
    (folder / "run.csv").write_text(record)
    (folder / "photo.jpg").write_bytes(b"\xff\xd8\xff")
    (folder / ".hidden.csv").write_text("V;f\n1;2\n")
    (folder / "~$book.xlsx").write_bytes(b"lock")
    done = folder / "a-fit" / "T1_steel"
    done.mkdir(parents=True)
    (done / "params.json").write_text("{}")
    (done / "rows.csv").write_text(POINT + table("T9"))
    return folder


def opened(source, tmp_path, reading=None, **options):
    return open_source(source, reading or Reading(), work=tmp_path / "work", **options)


def all_runs(plan):
    found = {}
    for block in plan.blocks:
        rows, unreadable = rows_of(block, plan)
        assert not unreadable
        for one in rows:
            found |= dict(one.runs())
    return found


def same(ours, theirs):
    """The roles of two runs hold the same, to the bit."""
    roles = [name for name in theirs.data if name in datasets.reading.ROLES]
    for name in roles:
        if name in theirs.units:
            np.testing.assert_array_equal(ours.values(name), theirs.values(name))
        else:
            assert ours.labels(name).tolist() == theirs.labels(name).tolist()
    assert ours.lines.tolist() == theirs.lines.tolist()
    for fact in ("source", "columns", "warnings", "notes", "simulated", "tool", "work", "units"):
        assert getattr(ours, fact) == getattr(theirs, fact), fact


def test_a_messy_folder_gives_its_pairs_in_the_order_of_the_files(lab, tmp_path):
    plan = opened(lab, tmp_path)
    assert plan.kind == "files"
    assert plan.name == "lab"
    pairs = ["T1 on steel", "T2 on steel", "X1 on unnamed-work", "inches on unnamed-work"]
    assert [str(pair) for pair in plan.pairs] == pairs
    assert plan.rows == 12 + 8 + 8 + 2 + 3
    assert [piece.name for piece in plan.blocks[0].pieces] == ["a.csv", "b.CSV", "old/deep/book.xlsx", "old/inches.txt"]


def test_what_is_not_read_is_said(lab, tmp_path):
    plan = opened(lab, tmp_path)
    reasons = plan.unreadable
    assert set(reasons) == {"broken.csv", "run.csv"}
    assert "header only" in reasons["broken.csv"]
    assert "fitmodels ident" in reasons["run.csv"]
    said = " ".join(plan.assumed)
    for words in ("skipped: photo.jpg", "skipped: a-fit/T1_steel", "names no tool", "old/inches.txt",
                  "joined, with edges distinguished by file: T1 on steel"):  # fmt: skip
        assert words in said


def test_a_column_of_tools_that_numbers_edges_is_named(tmp_path):
    """Nine inserts with two edges each may as well be nine tools: the report names the other reading."""
    rows = [f"T{tool},{edge},C45,{V + 10 * tool},{t},{0.01 * (V + 10 * tool) ** 0.5 * t**0.3:.4f}\n"
            for tool in range(9) for edge, V in enumerate((90, 160)) for t in (2, 4, 8)]  # fmt: skip
    path = tmp_path / "inserts.csv"
    path.write_text("tool,edge,work,V [m/min],t [min],VB [mm]\n" + "".join(rows))
    plan = opened(path, tmp_path)
    assert [str(pair) for pair in plan.pairs] == ["inserts on C45"]
    assert plan.assumed[1:] == (
        "'tool' numbers cutting edges of one tool, not types of tools, in 1 file: inserts.csv. If each value is a tool "
        "of its own: --map tool=tool.",
    )
    assert len(opened(path, tmp_path, Reading(map={"tool": "tool"})).pairs) == 9
    uses = {use.header: use.role for use in datasets.read_runs(path).columns}
    assert uses["tool"] == uses["edge"] == "edge"


def test_each_pair_is_as_its_file_alone_gives_it(lab, tmp_path):
    found = all_runs(opened(lab, tmp_path))
    (_, second) = datasets.read_runs(lab / "a.csv").pairs()
    same(found[Pair("T2", "steel")], second)
    assert found[Pair("T2", "steel")].simulated
    same(found[Pair("inches", "unnamed-work")], datasets.read_runs(lab / "old" / "inches.txt", tool="inches"))
    assert not found[Pair("inches", "unnamed-work")].simulated
    (book,) = datasets.read_runs(lab / "old" / "deep" / "book.xlsx").pairs()
    same(found[Pair("X1", "unnamed-work")], book)


def test_a_pair_of_two_files_is_joined_with_edges_distinguished(lab, tmp_path):
    runs = all_runs(opened(lab, tmp_path))[Pair("T1", "steel")]
    parts = [next(iter(datasets.read_runs(lab / name).pairs())) for name in ("a.csv", "b.CSV")]
    renamed = [replace(p, data=p.data.assign(edge=[f"{p.source.name}: {e}" for e in p.data["edge"]])) for p in parts]
    joined = renamed[0].join(renamed[1])
    assert runs.labels("edge").tolist() == joined.labels("edge").tolist()
    assert len(set(runs.labels("edge"))) == 3 + 2
    assert runs.source == joined.source
    assert runs.simulated
    assert any("distinguished by file" in words for words in runs.assumed)


def test_wear_under_two_names_is_left_out_of_a_joined_pair_and_that_is_said(lab, tmp_path):
    runs = all_runs(opened(lab, tmp_path))[Pair("T1", "steel")]  # AW in one file, VB in the other
    assert not runs.has("AW")
    assert any("AW, VB" in words for words in runs.warnings)


def test_a_file_that_measures_nothing_costs_a_pair_no_column(tmp_path):
    """A plan of the tests, or a list of what was cut, beside the file with what was measured."""
    text = "V,t,AW,tool,work,edge\n" + "".join(f"{100 + 20 * (k % 3)},{k},0.{k},T,W,{k % 3}\n" for k in range(1, 9))
    (tmp_path / "measured.csv").write_text(text)
    (tmp_path / "plan.csv").write_text("V,f,tool,work\n100,0.2,T,W\n120,0.2,T,W\n")
    runs = all_runs(opened(tmp_path, tmp_path / "elsewhere"))[Pair("T", "W")]
    same(replace(runs, warnings=()), datasets.read_runs(tmp_path / "measured.csv"))
    assert runs.warnings == ("Of T on W plan.csv contains no wear, force, power or roughness: its rows are left out.",)


def test_a_file_without_edges_is_one_edge_of_a_joined_pair(tmp_path):
    for name, k in (("p.csv", 1), ("q.csv", 2)):
        (tmp_path / name).write_text(f"V,t,AW,tool,work\n100,{k},0.1,T,W\n120,{k + 1},0.2,T,W\n")
    runs = all_runs(opened(tmp_path, tmp_path / "elsewhere"))[Pair("T", "W")]
    assert runs.labels("edge").tolist() == ["p.csv", "p.csv", "q.csv", "q.csv"]


@pytest.mark.parametrize("n", [3, 4, 5, 7])
def test_a_pair_of_many_files_keeps_all_rows_in_the_order_of_the_files(n, tmp_path):
    for k in range(n):
        (tmp_path / f"{k}.csv").write_text(f"edge,V,t,AW,tool,work\n1,{100 + k},1,0.1,T,W\n2,{100 + k},2,0.2,T,W\n")
    runs = all_runs(opened(tmp_path, tmp_path / "elsewhere"))[Pair("T", "W")]
    assert runs.values("V").tolist() == [100 + k // 2 for k in range(2 * n)]
    assert len(set(runs.labels("edge"))) == 2 * n


def test_parameter_files_are_those_of_the_file_alone(tmp_path):
    (tmp_path / "a.csv").write_text(POINT + table("T1", 24))
    (tmp_path / "b.csv").write_text("# simulated\n" + POINT + table("T2", 24, 2))

    def made(runs):
        laws, _ = fit.default_laws(runs)
        pf = parameters.collect(
            tool=runs.tool, work=runs.work, design=runs, laws=laws, simulated=runs.simulated,
            data_file=runs.source.name, data_sha256=runs.source.sha256, n_rows=len(runs),
        )  # fmt: skip
        return {k: v for k, v in pf.model_dump(mode="json").items() if k != "provenance"}, pf.provenance.data_sha256

    found = all_runs(opened(tmp_path, tmp_path / "elsewhere"))
    for name, tool in (("a.csv", "T1"), ("b.csv", "T2")):
        assert made(found[Pair(tool, "steel")]) == made(next(iter(datasets.read_runs(tmp_path / name).pairs())))


def test_many_pairs_of_the_same_columns_stand_in_one_frame(tmp_path):
    for k in range(5):
        (tmp_path / f"{k}.csv").write_text(POINT + table(f"T{k}"))
    plan = opened(tmp_path, tmp_path / "elsewhere")
    (rows,), _ = rows_of(plan.blocks[0], plan)
    assert len(rows.frame) == 60
    assert [runs.source.name for _, runs in rows.runs()] == [f"{k}.csv" for k in range(5)]


@pytest.mark.parametrize(("limits", "sizes"), [
    ({"most_pairs": 2}, [2, 2, 1]),
    ({"most_rows": 30}, [2, 2, 1]),
    ({"most_rows": 5}, [1] * 5),
    ({"most_rows": 1}, [1] * 5),
    ({}, [5]),
])  # fmt: skip
def test_blocks_keep_their_limits(limits, sizes, tmp_path):
    for k in range(5):
        (tmp_path / f"{k}.csv").write_text(POINT + table(f"T{k}"))
    plan = opened(tmp_path, tmp_path / "elsewhere", **limits)
    assert [len(block.pairs) for block in plan.blocks] == sizes
    assert [block.streamed for block in plan.blocks] == [limits.get("most_rows") == 1] * len(sizes)
    assert len(all_runs(plan)) == 5


def test_the_chunks_of_a_large_pair_are_its_rows(tmp_path):
    for k in range(3):
        extra = ",P" if k else ""
        body = table("T", seed=5 + k).replace("\n", ",1\n") if k else table("T", seed=2)
        (tmp_path / f"{k}.csv").write_text(POINT.strip() + extra + "\n" + body)
    (tmp_path / "3.csv").write_text(POINT + table("U"))
    plan = opened(tmp_path, tmp_path / "elsewhere")
    whole = all_runs(plan)[Pair("T", "steel")].data
    small = opened(tmp_path, tmp_path / "elsewhere", most_rows=2)
    chunks = list(chunks_of(small.blocks[0], small))
    assert small.blocks[0].streamed
    assert len(chunks) == 3
    joined = pd.concat(chunks, ignore_index=True)[list(whole)].astype(object)
    pd.testing.assert_frame_equal(joined, whole.reset_index(drop=True).astype(object))


def test_files_may_be_read_by_others_at_the_same_time(lab, tmp_path):
    with engine(jobs=2) as workers:
        assert opened(lab, tmp_path, workers=workers) == opened(lab, tmp_path)
        assert workers.started()


def test_a_copy_is_counted_once(tmp_path):
    for name in ("a.csv", "copy of a.csv"):
        (tmp_path / name).write_text(POINT + table("T"))
    plan = opened(tmp_path, tmp_path / "elsewhere")
    assert plan.rows == 12
    assert "byte-identical copy" in " ".join(plan.assumed)


@pytest.mark.parametrize("happened", ["changed", "vanished"])
def test_a_file_that_changes_after_the_plan_is_named(happened, lab, tmp_path):
    plan = opened(lab, tmp_path)
    if happened == "changed":
        (lab / "b.CSV").write_text(POINT + table("T1"))
    else:
        (lab / "b.CSV").unlink()
    rows, unreadable = rows_of(plan.blocks[0], plan)
    assert set(unreadable) == {"b.CSV"}
    (lost,) = (k for k, piece in enumerate(plan.blocks[0].pieces) if piece.name == "b.CSV")
    needs = [str(pair) for pair, at in zip(plan.blocks[0].pairs, plan.blocks[0].of_pair, strict=True) if lost in at]
    assert needs == ["T1 on steel"]
    assert sum(len(one.frame) for one in rows) == 25


def test_groups_are_kept_under_their_header(tmp_path):
    (tmp_path / "a.csv").write_text(POINT.strip() + ",Grade\n" + table("T1").replace("\n", ",P25\n"))
    (tmp_path / "b.csv").write_text(POINT + table("T2"))
    plan = opened(tmp_path, tmp_path / "elsewhere", Reading(groups=("Grade",)))
    found = all_runs(plan)
    assert set(found[Pair("T1", "steel")].data["Grade"]) == {"P25"}
    assert set(found[Pair("T2", "steel")].data["Grade"]) == {""}
    assert any("Grade" in words and "b.csv" in words for words in plan.assumed)


@pytest.mark.parametrize(("group", "words"), [("Grad", "Did you mean 'Grade'"), ("V", "cutting speed")])
def test_a_group_that_cannot_be_is_refused(group, words, tmp_path):
    (tmp_path / "a.csv").write_text(POINT.strip() + ",Grade\n" + table("T1").replace("\n", ",P25\n"))
    with pytest.raises(UsageError, match=words):
        opened(tmp_path, tmp_path / "elsewhere", Reading(groups=(group,)))


def test_a_map_that_fits_some_files_only(tmp_path):
    (tmp_path / "a.csv").write_text("speed1,t,AW\n100,1,0.1\n120,2,0.2\n")
    (tmp_path / "b.csv").write_text(POINT + table("T2"))
    plan = opened(tmp_path, tmp_path / "elsewhere", Reading(map={"V": "speed1"}))
    assert [str(pair) for pair in plan.pairs] == ["a on unnamed-work"]
    assert "--map names a column 'speed1'" in next(iter(plan.unreadable.values()))
    with pytest.raises(UsageError, match="none of the 2 files"):
        opened(tmp_path, tmp_path / "elsewhere", Reading(map={"V": "speed7"}))


def test_sources_that_are_none(tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(DataError, match="holds no lab file"):
        opened(empty, tmp_path)
    (empty / "a.csv").write_text("V;f\n")
    with pytest.raises(DataError, match="none of the 1 files"):
        opened(empty, tmp_path)
    with pytest.raises(DataError, match="header only"):
        opened(empty / "a.csv", tmp_path)
    with pytest.raises(DataError, match=r"b\.csv does not exist"):
        opened(empty / "b.csv", tmp_path)
    (empty / "a.parquet").touch()
    with pytest.raises(UsageError, match="holds both Parquet"):
        opened(empty, tmp_path)


def test_a_large_file_among_others_is_to_be_given_alone(lab, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["fitmodels.batch.source.common"], "LARGE", 600)
    plan = opened(lab, tmp_path)
    reasons = plan.unreadable
    assert "by itself" in reasons["a.csv"]


# A long CSV


def long(n=4000, tool="T1 T2", odd=()):
    """A table whose rows come in blocks of tools; ``odd`` are (row, cell of AW)."""
    rng = np.random.default_rng(5)
    tools = tool.split()
    lines = []
    for k in range(n):
        AW = dict(odd).get(k, f"{0.01 * (1 + k % 7) ** 0.6 * np.exp(0.05 * rng.normal()):.5f}")
        lines.append(
            f"{k // 8},{100 + 10 * (k % 5)},{0.1 * (1 + k % 3):.1f},{1 + k % 7},{AW},{tools[k * len(tools) // n]},W\n"
        )
    return POINT + "".join(lines)


def streamed(path, tmp_path, reading=None, **options):
    limits = {"most_rows": 100_000, "most_pairs": 100, "head": 20_000, "block_size": 1 << 14}
    return csv_stream(path, reading or Reading(), work=tmp_path / "work", **(limits | options))


def as_read(path, tmp_path, reading=None):
    """Rows through the stream are those of the reader of lab files."""
    plan = streamed(path, tmp_path, reading)
    found = all_runs(plan)
    for theirs in datasets.read_runs(path, decimal=(reading or Reading()).decimal).pairs():
        ours = found.pop(Pair(theirs.tool, theirs.work))
        for name in theirs.data:
            if name in theirs.units:
                np.testing.assert_array_equal(ours.values(name), theirs.values(name))
            elif name == "edge":
                assert list(map(str, ours.data[name])) == theirs.labels(name).tolist()
    assert not found
    return plan


def test_a_stream_is_read_as_a_lab_file_is(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text(long())
    plan = as_read(path, tmp_path)
    assert plan.name == "long.csv"
    assert plan.rows == 4000


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_a_german_stream(encoding, tmp_path):
    path = tmp_path / "lang.csv"
    path.write_bytes(("# Prüfstand: µ-Maschine\n\n" + german(long())).encode(encoding))
    plan = as_read(path, tmp_path)
    assert plan.notes == ("Prüfstand: µ-Maschine",)


def test_units_below_the_header_are_understood(tmp_path):
    path = tmp_path / "units.csv"
    units = "-,[m/s],mm/rev,s,[um],-,-\n"
    path.write_text(POINT.replace("V,", "vc,") + units + long().split("\n", 1)[1])
    plan = as_read(path, tmp_path)
    assert {use.role: use.unit for use in plan.columns}["V"] == "m/s"


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_line_ends(ending, tmp_path):
    path = tmp_path / "ends.csv"
    path.write_bytes(long().replace("\n", ending).encode())
    as_read(path, tmp_path)


def test_cells_that_are_no_numbers_are_counted(tmp_path):
    path = tmp_path / "odd.csv"
    path.write_text(long(odd=[(10, "n/a"), (3500, "worn"), (3600, "> 0.3"), (3700, "NaN"), (3800, " - ")]))
    plan = streamed(path, tmp_path)
    said = [words for words in plan.assumed if "no numbers" in words]
    assert said == [
        "column 'AW': 2 cells are no numbers and count as missing, the first in row 3501 of the data: 'worn'."
    ]
    assert sum(np.isnan(runs.values("AW")).sum() for runs in all_runs(plan).values()) == 5


def test_thousands_signs_and_a_unicode_minus(tmp_path):
    path = tmp_path / "marks.csv"
    signs = ("\N{MINUS SIGN}", "", "+")
    rows = "".join(f"{k};1.{k % 900 + 100:03d},5;+{1 + k % 7};{signs[k % 3]}0,{1 + k % 9};T;W\n" for k in range(900))
    path.write_text("edge;V [m/min];t [min];AW [mm];tool;work\n" + rows, encoding="utf-8")
    as_read(path, tmp_path)


def test_short_rows_blank_rows_footers_and_remarks(tmp_path):
    path = tmp_path / "rough.csv"
    lines = long().splitlines()
    lines[3000] = "7,100,0.2,3"
    lines.insert(2000, "# the machine was stopped")
    lines.insert(2500, ",,,,,,")
    path.write_text("\n".join([*lines, "Mean,120,0.2,4,0.02,,", ""]))
    plan = streamed(path, tmp_path)
    assert plan.rows == 4000
    said = " ".join(plan.assumed)
    assert "1 row has fewer cells" in said
    assert "1 line of remarks" in said
    assert "Footer rows are left out: 'Mean'" in said


def test_rows_that_end_with_a_delimiter(tmp_path):
    path = tmp_path / "tail.csv"
    header, body = long().split("\n", 1)
    path.write_text(header + "\n" + body.replace("\n", ",\n"))
    as_read(path, tmp_path)


def test_a_wide_row_is_refused(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text(long() + "1,100,0.1,1,0.1,T,W,8\n")
    with pytest.raises(DataError, match="more cells than the 7 of the header"):
        streamed(path, tmp_path)
    assert not list((tmp_path / "work").rglob("*.parquet"))


def test_a_letter_of_windows_far_below(tmp_path):
    path = tmp_path / "late.csv"
    path.write_bytes(long(tool="T1 T2 Süd").encode("cp1252"))
    plan = streamed(path, tmp_path)
    assert str(plan.pairs[-1]) == "Süd on W"


def test_names_from_a_note_or_the_file(tmp_path):
    path = tmp_path / "K10.csv"
    rows = "".join(f"{k // 4},{100 + k % 3},{k % 4 + 1},0.{k % 9 + 1}\n" for k in range(200))
    path.write_text("# work: Ck45\n# simulated\nedge,V,t,AW\n" + rows)
    plan = streamed(path, tmp_path)
    assert [str(pair) for pair in plan.pairs] == ["K10 on Ck45"]
    assert "simulated" in plan.notes


@pytest.mark.parametrize("names", [("1E1", "10", "007", "1.7220"), ("1.0", "2", "3", "4")])
@pytest.mark.parametrize("first", [0, 3_000])  # in the head of the file, and far below it
def test_a_long_file_keeps_names_that_look_like_numbers(names, first, tmp_path):
    path = tmp_path / "long.csv"
    rows = [f"{100 + k % 9},{k % 50 / 10 + 1},0.{k % 7 + 1},5,{'20' if k < first else names[k % 4]},{k // 800}\n"
            for k in range(first + 2_000)]  # fmt: skip
    path.write_text("V,t,AW,tool,work,edge\n" + "".join(rows))
    as_read(path, tmp_path)
    plan = streamed(path, tmp_path)
    expected = {"1", "2", "3", "4"} if names[0] == "1.0" else set(names)
    assert {pair.work for block in plan.blocks for pair in block.pairs} - {"20"} == expected


def test_a_copy_is_used_again_until_the_source_changes(tmp_path):
    path, reported = tmp_path / "long.csv", []
    path.write_text(long())
    first = converted(path, Reading(), tmp_path / "work", reported.append, 20_000, 1 << 14)
    assert reported[-1].endswith(" %")
    reported.clear()
    assert converted(path, Reading(), tmp_path / "work", reported.append, 20_000, 1 << 14) == first
    assert not reported
    facts = first.path.with_name("copy.json")
    for damaged in (
        b"",
        b"[" * 100_000,
        facts.read_bytes()[:20],
        b'{"tool": 1, "work": null, "assumed": [], "notes": []}',
    ):
        facts.write_bytes(damaged)
        assert converted(path, Reading(), tmp_path / "work", reported.append, 20_000, 1 << 14) == first
    path.write_text(long(3000))
    second = converted(path, Reading(), tmp_path / "work", reported.append, 20_000, 1 << 14)
    assert second.path != first.path
    assert not first.path.exists()
    assert not list((tmp_path / "work").rglob("*.part"))


@pytest.mark.parametrize(("text", "words"), [
    ("t [s],u,y\n" + "".join(f"{k / 50},{k % 3},{k % 5}\n" for k in range(600)), "record of one run"),
    ("V t AW\n" + "100 1 0.1\n" * 600, "by blanks"),
    ("V,vc,AW\n" + "100,1,0.1\n" * 600, "both read as cutting speed"),
    ("a,b,c\n" + "100,1,0.1\n" * 600, "no column is recognised"),
])  # fmt: skip
def test_long_files_that_cannot_be_used(text, words, tmp_path):
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=words):
        streamed(path, tmp_path)


def test_a_large_file_alone_is_streamed(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["fitmodels.batch.source.common"], "LARGE", 1000)
    path = tmp_path / "long.csv"
    path.write_text(long())
    plan = opened(path, tmp_path)
    assert plan.kind == "parquet"
    assert plan.rows == 4000


@given(
    st.lists(st.one_of(
        st.text("0123456789.,+-eE ' _\N{MINUS SIGN}na/?", max_size=8),
        st.floats().map(str),
        st.sampled_from(["1.234", "1,234.5", "1.234,5", "1e999", "inf", "#N/A", "worn", "٣", "+5", "--", "12"]),
        st.just("-\N{MINUS SIGN}"),
    )),
    st.sampled_from(["point", "comma"]),
)  # fmt: skip
def test_cells_of_a_stream_are_read_as_those_of_a_lab_file(texts, decimal):
    cells = Cells(decimal)
    known = pa.array([None if text in MISSING_AS_WRITTEN else text for text in texts], pa.string())
    values, bad = to_floats(texts, decimal)
    np.testing.assert_array_equal(cells.numbers("x", known, 1).to_numpy(zero_copy_only=False).astype(float), values)
    odd = cells.odd.get("x")
    assert (odd.count if odd else 0) == len(bad)
    if odd:
        assert odd.row == bad[0] + 1


def test_names_of_tools_keep_their_zeros(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text(long(tool="GC4 0045 45"))
    assert [pair.tool for pair in streamed(path, tmp_path).pairs] == ["GC4", "0045", "45"]


def test_groups_of_a_stream(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text("\n".join(line + (",Grade" if k == 0 else ",10") for k, line in enumerate(long().splitlines())))
    plan = streamed(path, tmp_path, Reading(groups=("Grade",)))
    assert {str(v) for runs in all_runs(plan).values() for v in runs.data["Grade"]} == {"10"}


def test_real_files(measurements, tmp_path):
    plan = opened(measurements / "turning_forces", tmp_path)
    found = all_runs(plan)
    (theirs,) = datasets.read_runs(measurements / "turning_forces" / "exp1_runs.csv", tool="exp1_runs").pairs()
    same(found[Pair("exp1_runs", "unnamed-work")], theirs)
    whole = opened(measurements, tmp_path)
    assert {name.split("/")[0] for name in whole.unreadable} == {"daisy", "emps", "nist_strd", "servo_sweep"}
    assert json.dumps(whole.assumed)
