"""Parquet sources of a batch: pairs, blocks and rows are the same however a writer laid the rows out.

The files are written by pyarrow (Apache Arrow), and what is read is compared with pandas' own reading or with the
frame that was written.
"""

import os
import pickle
import shutil
import tempfile
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fitmodels.batch.engine import SerialRun
from fitmodels.batch.plan import Pair, Plan, Reading
from fitmodels.batch.source import parquet_index as indexer
from fitmodels.batch.source import parquet_reading as reader
from fitmodels.batch.source import sorted_copies as copier
from fitmodels.batch.source.common import packed
from fitmodels.batch.source.parquet_arrow import labels, text_of
from fitmodels.batch.source.parquet_blocks import parquet_plan
from fitmodels.batch.source.parquet_reading import parquet_chunks, parquet_rows
from fitmodels.core.errors import DataError, UsageError
from fitmodels.fit import many_power_laws, power_law, streamed_power_law
from hypothesis import given, settings
from hypothesis import strategies as st

NUMBERS = ["V", "f", "t", "AW"]


def silent(_: str) -> None:
    """Say nothing."""


def a_shop(pairs: int = 6, rows: int = 24, seed: int = 1) -> pd.DataFrame:
    """Rows of pairs, one pair after the other."""
    rng = np.random.default_rng(seed)
    n = pairs * rows
    return pd.DataFrame(
        {
            "tool": np.repeat([f"T{i}" for i in range(pairs)], rows),
            "work": np.repeat([f"W{i % 2}" for i in range(pairs)], rows),
            "edge": np.tile(np.repeat(np.arange(rows // 4), 4), pairs),
            "V": rng.uniform(50, 200, n),
            "f": rng.uniform(0.1, 0.4, n),
            "t": rng.uniform(1, 20, n),
            "AW": rng.uniform(0.05, 0.4, n),
        }
    )


def write(table: pd.DataFrame, path: Path, **options: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_pandas(table, preserve_index=False), path, **options)
    return path


def planned(source: Path, reading: Reading | None = None, **limits: object) -> Plan:
    work = source.parent / "work of the batch"
    chosen = {"most_rows": 10_000, "most_pairs": 100, "work": work, "report": silent} | limits
    return parquet_plan(source, reading or Reading(), **chosen)


def everything(plan: Plan) -> pd.DataFrame:
    """All rows of all blocks, streamed or not; none may be unreadable."""
    frames = []
    for block in plan.blocks:
        if block.streamed:
            frames += list(parquet_chunks(block, plan))
            continue
        rows, unreadable = parquet_rows(block, plan)
        assert not unreadable
        frames += [some.frame for some in rows]
        assert [pair for some in rows for pair, _ in some.runs()] != []
    found = pd.concat([frame.astype({"tool": object, "work": object}) for frame in frames], ignore_index=True)
    return found.sort_values(["tool", "work"], kind="stable", ignore_index=True)


def same(found: pd.DataFrame, table: pd.DataFrame, exactly_in_order: bool = True) -> None:
    """Pair by pair the rows of the table, in their order or in any."""
    columns = ["tool", "work", *NUMBERS]
    keys = ["tool", "work"] if exactly_in_order else columns
    a, b = (f.sort_values(keys, kind="stable", ignore_index=True) for f in (found, table))
    assert a[["tool", "work"]].astype(str).to_numpy().tolist() == b[["tool", "work"]].astype(str).to_numpy().tolist()
    np.testing.assert_array_equal(a[NUMBERS].to_numpy(), b[NUMBERS].to_numpy())


# how the rows lie


@pytest.mark.parametrize("row_group", [5, 24, 50, 10_000])
@pytest.mark.parametrize("scattered", [False, True], ids=["pair after pair", "shuffled"])
@pytest.mark.parametrize("most_pairs", [1, 2, 100])
def test_the_rows_of_each_pair_are_those_that_were_written(tmp_path, row_group, scattered, most_pairs):
    table = a_shop()
    table = table.sample(frac=1, random_state=3) if scattered else table
    plan = planned(write(table, tmp_path / "a.parquet", row_group_size=row_group), most_pairs=most_pairs)
    same(everything(plan), table)
    assert plan.rows == len(table)
    assert plan.pairs == tuple(Pair(*key) for key in table[["tool", "work"]].drop_duplicates().to_numpy())
    assert all(len(block.pairs) <= most_pairs for block in plan.blocks)


def hive_of(table: pd.DataFrame, folder: Path) -> Path:
    import pyarrow.dataset as ds

    ds.write_dataset(
        pa.Table.from_pandas(table, preserve_index=False), folder, format="parquet",
        partitioning=ds.partitioning(pa.schema([("tool", pa.string()), ("work", pa.string())]), flavor="hive"),
    )  # fmt: skip
    return folder


def test_folders_that_name_the_pair_are_read_as_columns_and_url_decoded(tmp_path):
    table = a_shop().replace({"T0": "GC 4325/x", "W1": "Stähle=C45"})
    folder = hive_of(table, tmp_path / "shop")
    assert any("%" in path.name for path in folder.rglob("tool=*"))  # Arrow encodes what a folder cannot be called
    plan = planned(folder)
    same(everything(plan), table)
    assert {use.role for use in plan.columns} >= {"tool", "work", "V"}
    assert not any("not named" in said for said in plan.assumed)


def test_a_folder_may_say_a_condition_and_a_group(tmp_path):
    table = a_shop(pairs=2)
    for i, (tool, rows) in enumerate(table.groupby("tool")):
        write(rows.drop(columns="V"), tmp_path / "shop" / f"V={100 + i}" / f"grade=P{i}0" / f"{tool}.parquet")
    plan = planned(tmp_path / "shop", Reading(groups=("grade",)))
    rows = everything(plan)
    assert rows.groupby("tool")["V"].unique().map(list).to_dict() == {"T0": [100.0], "T1": [101.0]}
    assert rows.groupby("tool")["grade"].unique().map(list).to_dict() == {"T0": ["P00"], "T1": ["P10"]}


def test_files_that_name_no_pair_are_each_a_tool(tmp_path):
    table = a_shop()
    for tool, rows in table.groupby("tool"):
        write(rows.drop(columns=["tool", "work"]), tmp_path / "shop" / f"{tool}.parquet")
    plan = planned(tmp_path / "shop")
    assert plan.pairs == tuple(Pair(f"T{i}", "unnamed-work") for i in range(6))
    assert any("each file is one" in said for said in plan.assumed)
    same(everything(plan), table.assign(work="unnamed-work"))
    named = planned(tmp_path / "shop", Reading(tool="GC", work="steel"))
    assert named.pairs == (Pair("GC", "steel"),)


def test_two_files_of_one_name_in_two_folders_stay_two_tools(tmp_path):
    for tool in ("a", "b"):
        write(a_shop(1).drop(columns=["tool", "work"]), tmp_path / "shop" / tool / "rows.parquet")
    assert [pair.tool for pair in planned(tmp_path / "shop").pairs] == ["a/rows", "b/rows"]


def test_rows_that_name_no_tool_are_a_pair_of_their_own_and_that_is_said(tmp_path):
    table = a_shop(2)
    table.loc[:5, "tool"] = None
    table.loc[6:7, "tool"] = ""
    plan = planned(write(table, tmp_path / "a.parquet"))
    assert plan.pairs[0] == Pair("unnamed-tool", "W0")
    assert plan.blocks[0].rows == len(table)
    assert any("8 rows name none" in said for said in plan.assumed)


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_any_partition_into_files_and_row_groups_gives_each_pair_the_same_rows(data):
    table = a_shop(pairs=4, rows=8).sample(frac=1, random_state=data.draw(st.integers(0, 5)))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(table)), max_size=4)))
    folder = Path(tempfile.mkdtemp())
    try:
        for i, (start, stop) in enumerate(zip([0, *cuts], [*cuts, len(table)], strict=True)):
            size = data.draw(st.integers(1, 40))
            write(table.iloc[start:stop], folder / "shop" / f"part-{i}.parquet", row_group_size=size)
        plan = planned(
            folder / "shop",
            most_pairs=data.draw(st.integers(1, 5)),
            most_rows=data.draw(st.sampled_from([7, 8, 20, 100])),
            reads=data.draw(st.sampled_from([0.5, 1.5, 1e9])),
        )
        same(everything(plan), table)
        assert sum(block.rows for block in plan.blocks) == plan.rows == len(table)
    finally:
        shutil.rmtree(folder)


# blocks


@settings(max_examples=100)
@given(st.lists(st.integers(1, 50), min_size=1), st.integers(1, 60), st.integers(1, 8))
def test_blocks_cover_all_pairs_in_order_within_the_limits(rows, most_rows, most_pairs):
    blocks = packed(rows, most_rows, most_pairs)
    assert [i for block in blocks for i in block] == list(range(len(rows)))
    for block in blocks:
        assert 1 <= len(block) <= most_pairs
        assert len(block) == 1 or sum(rows[i] for i in block) <= most_rows


def test_a_pair_of_more_rows_than_a_block_is_streamed_by_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "CHUNK", 60)
    monkeypatch.setattr(indexer, "BATCH", 25)
    monkeypatch.setattr(indexer, "ENOUGH", 25)
    small, large = a_shop(2), a_shop(1, rows=400, seed=5).assign(tool="large")
    table = pd.concat([small[:24], large, small[24:]])
    plan = planned(write(table, tmp_path / "a.parquet", row_group_size=100), most_rows=48)
    assert [block.streamed for block in plan.blocks] == [False, True, False]
    chunks = list(parquet_chunks(plan.blocks[1], plan))
    assert len(chunks) > 3
    assert max(len(chunk) for chunk in chunks) < 60 + 25
    law = streamed_power_law(chunks, "AW", ["V", "f", "t"])
    whole = many_power_laws(large, "AW", ["V", "f", "t"], pair="tool", edge="edge")
    np.testing.assert_allclose(law.params.to_numpy(), whole.params.to_numpy()[0], rtol=1e-9)
    assert (law.nobs, law.n_edges) == (400, 100)


def test_a_second_look_at_the_same_source_gives_an_equal_plan(tmp_path):
    table = a_shop().sample(frac=1, random_state=1)
    for i in range(3):
        write(table[i::3], tmp_path / "shop" / f"{i}.parquet", row_group_size=20)
    for reads in (0.1, 1e9):
        plan = planned(tmp_path / "shop", most_pairs=2, reads=reads)
        assert planned(tmp_path / "shop", most_pairs=2, reads=reads) == plan


# a sorted copy


def scattered(tmp_path: Path, **options: object) -> tuple[pd.DataFrame, Path]:
    table = a_shop(8).sample(frac=1, random_state=2)
    return table, write(table, tmp_path / "a.parquet", row_group_size=30, **options)


def copies(plan: Plan) -> bool:
    return any("copy" in said for said in plan.assumed)


@pytest.mark.parametrize("at_once", [1, 3, 200])
@pytest.mark.parametrize("held", [10, 1_000_000])
def test_a_sorted_copy_holds_the_same_rows_pair_by_pair_in_the_same_order(tmp_path, monkeypatch, at_once, held):
    monkeypatch.setattr(copier, "AT_ONCE", at_once)
    monkeypatch.setattr(copier, "HELD_ROWS", held)
    table, path = scattered(tmp_path)
    reported: list[str] = []
    copied = planned(path, most_pairs=1, report=reported.append)
    direct = planned(path, most_pairs=1, reads=1e9)
    assert copies(copied)
    assert not copies(direct)
    assert "100 %" in reported[-1]
    assert [len(block.pieces) for block in copied.blocks] == [1] * 8
    pd.testing.assert_frame_equal(everything(copied), everything(direct))
    same(everything(copied), table)
    for one, other in zip(copied.blocks, direct.blocks, strict=True):
        assert (one.pairs, one.rows, one.streamed) == (other.pairs, other.rows, other.streamed)


def test_the_blocks_read_no_more_than_is_allowed_before_a_copy_is_made(tmp_path):
    _, path = scattered(tmp_path)  # every row group holds rows of all 8 pairs
    assert not copies(planned(path, most_pairs=2, reads=4.0))
    assert copies(planned(path, most_pairs=2, reads=3.9))


def test_a_copy_is_used_again_and_when_it_is_made_anew_the_stamps_stay(tmp_path):
    _, path = scattered(tmp_path)
    plan = planned(path, most_pairs=1)
    copy = Path(plan.blocks[0].pieces[0].path)
    before = copy.stat().st_mtime_ns
    assert planned(path, most_pairs=1) == plan
    assert copy.stat().st_mtime_ns == before
    shutil.rmtree(copy.parent)
    assert planned(path, most_pairs=1) == plan
    os.utime(path, ns=(1, 1))
    assert planned(path, most_pairs=1).blocks[0].pieces[0].stamp != plan.blocks[0].pieces[0].stamp


def test_a_copy_that_breaks_off_leaves_nothing_behind(tmp_path):
    _, path = scattered(tmp_path)

    def interrupted(_: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        planned(path, most_pairs=1, report=interrupted)
    assert list((tmp_path / "work of the batch" / "sorted").iterdir()) == []
    assert planned(path, most_pairs=1).rows == 8 * 24


def test_a_damaged_row_group_is_left_out_of_the_copy_and_reported(tmp_path):
    table, path = scattered(tmp_path, write_page_checksum=True, use_dictionary=False, compression="none")
    damage(path, row_group=2, column="AW")
    plan = planned(path, most_pairs=1)
    assert copies(plan)
    assert list(plan.unreadable) == ["a.parquet, row group 2"]
    assert plan.rows == len(table) - 30
    same(everything(plan), pd.concat([table[:60], table[90:]]))
    assert planned(path, most_pairs=1) == plan


# damage


def damage(path: Path, row_group: int, column: str) -> None:
    """Flip the bytes in the middle of the pages of a column of a row group."""
    facts = pq.read_metadata(path)
    chunk = facts.row_group(row_group).column(facts.schema.to_arrow_schema().names.index(column))
    data = bytearray(path.read_bytes())
    middle = chunk.data_page_offset + chunk.total_compressed_size // 2
    for i in range(middle, middle + 16):
        data[i] ^= 0xFF
    path.write_bytes(bytes(data))


def test_a_corrupt_footer_is_named_and_the_other_files_go_on(tmp_path):
    table = a_shop()
    for i in range(3):
        write(table[i * 48 : (i + 1) * 48], tmp_path / "shop" / f"part-{i}.parquet")
    broken = tmp_path / "shop" / "part-0.parquet"
    broken.write_bytes(broken.read_bytes()[:-100] + bytes(100))
    plan = planned(tmp_path / "shop")
    assert list(plan.unreadable) == ["part-0.parquet"]
    assert next(iter(plan.unreadable.values())).startswith("part-0.parquet: cannot be read: ")
    same(everything(plan), table[48:])


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda data: data[: len(data) // 2], id="truncated"),
        pytest.param(lambda data: b"", id="empty"),
        pytest.param(lambda data: b"tool;work;V\nA;B;1\n" * 30, id="a CSV by another name"),
        pytest.param(lambda data: b"PAR1" + bytes(len(data) - 8) + b"PAR1", id="zeros between the marks"),
    ],
)
def test_a_file_that_is_no_parquet_is_named(tmp_path, spoil):
    table = a_shop()
    write(table[:24], tmp_path / "shop" / "a.parquet")
    path = write(table[24:], tmp_path / "shop" / "b.parquet")
    path.write_bytes(spoil(path.read_bytes()))
    plan = planned(tmp_path / "shop")
    assert list(plan.unreadable) == ["b.parquet"]
    assert plan.rows == 24
    with pytest.raises(DataError, match=r"b\.parquet: cannot be read"):
        planned(path)


@pytest.mark.parametrize("compression", ["none", "snappy", "zstd"])
def test_a_corrupt_page_is_named_with_its_row_group_and_the_others_are_read(tmp_path, compression):
    table = a_shop()
    path = write(
        table, tmp_path / "a.parquet", row_group_size=24, write_page_checksum=True, use_dictionary=False,
        compression=compression,
    )  # fmt: skip
    damage(path, row_group=2, column="AW")
    plan = planned(path)
    rows, unreadable = parquet_rows(plan.blocks[0], plan)
    assert list(unreadable) == ["a.parquet, row group 2"]
    assert unreadable["a.parquet, row group 2"].startswith("a.parquet, row group 2: cannot be read: ")
    same(rows[0].frame, table[table["tool"] != "T2"])
    assert [runs.lines.tolist() for _, runs in rows[0].runs()] == [list(range(1, 25))] * 5
    with pytest.raises(DataError, match=r"a\.parquet, row group 2: cannot be read"):
        list(parquet_chunks(plan.blocks[0], plan))


def test_a_corrupt_page_of_names_takes_its_row_group_out_of_the_plan(tmp_path):
    table = a_shop().sample(frac=1, random_state=1)
    path = write(table, tmp_path / "a.parquet", row_group_size=48, write_page_checksum=True, use_dictionary=False)
    damage(path, row_group=1, column="tool")
    plan = planned(path)
    assert list(plan.unreadable) == ["a.parquet, row group 1"]
    same(everything(plan), pd.concat([table[:48], table[96:]]))


@pytest.mark.parametrize(
    ("meddle", "words"),
    [
        pytest.param(lambda path: path.unlink(), "no longer exists", id="vanished"),
        pytest.param(lambda path: write(a_shop(1, seed=9), path), "written again", id="written again"),
    ],
)
def test_a_file_that_is_not_what_was_planned_is_reported(tmp_path, meddle: Callable[[Path], object], words):
    table = a_shop()
    path = write(table[:24], tmp_path / "shop" / "a.parquet")
    write(table[24:], tmp_path / "shop" / "b.parquet")
    plan = planned(tmp_path / "shop")
    meddle(path)
    rows, unreadable = parquet_rows(plan.blocks[0], plan)
    assert words in unreadable["a.parquet"]
    same(rows[0].frame, table[24:])


# columns


@pytest.mark.parametrize(
    ("change", "words"),
    [
        pytest.param(lambda t: t.drop(columns="f"), "has no column 'f'", id="a column less"),
        pytest.param(lambda t: t.assign(f="0.1"), "holds", id="text for numbers"),
        pytest.param(lambda t: t.assign(tool=7), "column 'tool' holds int64", id="numbers for names"),
    ],
)
def test_a_file_of_other_columns_is_unreadable_rather_than_guessed_at(tmp_path, change, words):
    table = a_shop()
    write(table[:24], tmp_path / "shop" / "a.parquet")
    write(change(table[24:]), tmp_path / "shop" / "b.parquet")
    plan = planned(tmp_path / "shop")
    assert list(plan.unreadable) == ["b.parquet"]
    assert words in next(iter(plan.unreadable.values()))
    same(everything(plan), table[:24])


def test_whole_numbers_in_one_file_and_nulls_in_another_are_both_numbers(tmp_path):
    table = a_shop(3).assign(V=100)
    write(table[:24], tmp_path / "shop" / "a.parquet")
    write(table[24:48].astype({"V": "float32"}), tmp_path / "shop" / "b.parquet")
    write(table[48:].assign(V=None), tmp_path / "shop" / "c.parquet")
    plan = planned(tmp_path / "shop")
    assert not plan.unreadable
    assert everything(plan)["V"].fillna(-1).tolist() == [100.0] * 48 + [-1.0] * 24


def test_units_and_languages_of_headers_are_understood_and_the_command_may_say_more(tmp_path):
    german = {"tool": "Werkzeug", "work": "Werkstoff", "edge": "Schneide", "V": "Schnittgeschwindigkeit vc [m/s]",
              "f": "Vorschub (mm/U)", "t": "Eingriffszeit [s]", "AW": "Verschleiß"}  # fmt: skip
    table = a_shop()
    path = write(table.rename(columns=german), tmp_path / "a.parquet")
    plan = planned(path, Reading(units={"AW": "um"}))
    rows, _ = parquet_rows(plan.blocks[0], plan)
    found = rows[0].frame
    np.testing.assert_allclose(found["V"], table["V"] * 60, rtol=1e-15)
    np.testing.assert_allclose(found["t"], table["t"] / 60, rtol=1e-15)
    np.testing.assert_allclose(found["AW"], table["AW"] / 1000, rtol=1e-15)
    np.testing.assert_array_equal(found["f"], table["f"])
    assert rows[0].units == {"V": "m/min", "f": "mm/rev", "t": "min", "AW": "mm"}
    mapped = planned(path, Reading(map={"VB": "Verschleiß"}))
    assert "VB" in everything(mapped)


def test_the_law_of_a_pair_is_that_of_its_rows_in_memory(tmp_path):
    table = a_shop(3, rows=48)
    plan = planned(write(table, tmp_path / "a.parquet"))
    rows, _ = parquet_rows(plan.blocks[0], plan)
    for pair, runs in rows[0].runs():
        own = table[table["tool"] == pair.tool]
        law = power_law(runs, "AW", ["V", "f", "t"])
        whole = many_power_laws(own, "AW", ["V", "f", "t"], pair=["tool", "work"], edge="edge")
        np.testing.assert_allclose(law.params.to_numpy(), whole.params.to_numpy()[0], rtol=1e-9)
        assert law.edges.n_edges == 12
    stacked = many_power_laws(rows[0].frame, "AW", ["V", "f", "t"], pair=["tool", "work"], edge="edge")
    assert [tuple(pair) for pair in stacked.pairs.astype(str).to_numpy()] == [("T0", "W0"), ("T1", "W1"), ("T2", "W0")]


def as_dictionary(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return column.dictionary_encode()


@pytest.mark.parametrize(
    ("name", "wrap"),
    [
        pytest.param("tool", as_dictionary, id="names in a dictionary"),
        pytest.param("tool", lambda c: c.cast(pa.large_string()), id="large strings"),
        pytest.param("V", lambda c: c.cast(pa.float32()), id="float32"),
        pytest.param("V", lambda c: c.cast(pa.int16()), id="int16"),
        pytest.param("V", lambda c: c.cast(pa.decimal128(12, 3)), id="decimal"),
        pytest.param("V", as_dictionary, id="numbers in a dictionary"),
    ],
)
@pytest.mark.parametrize("reads", [0.5, 4.0], ids=["copied", "direct"])
def test_any_arrow_type_of_a_column_gives_the_same_rows(tmp_path, name, wrap, reads):
    table = a_shop().assign(V=lambda t: t["V"].round())
    arrow = pa.Table.from_pandas(table, preserve_index=False)
    at = arrow.schema.get_field_index(name)
    arrow = arrow.set_column(at, name, wrap(arrow.column(name)))
    pq.write_table(arrow, tmp_path / "a.parquet", row_group_size=50)
    same(everything(planned(tmp_path / "a.parquet", most_pairs=2, reads=reads)), table)


def test_views_of_strings_are_read_as_strings(tmp_path):
    table = a_shop()
    arrow = pa.table({**table, "tool": pa.array(table["tool"].tolist(), pa.string_view())})
    try:
        pq.write_table(arrow, tmp_path / "a.parquet", row_group_size=50)
    except pa.ArrowNotImplementedError:
        pytest.skip(f"pyarrow {pa.__version__} writes none")
    same(everything(planned(tmp_path / "a.parquet", most_pairs=2)), table)


@pytest.mark.parametrize("numbers", [np.int64, np.float64])
@pytest.mark.parametrize("reads", [0.5, 4.0], ids=["copied", "direct"])
def test_pairs_and_edges_that_are_numbers_read_1_and_not_1_0(tmp_path, numbers, reads):
    table = a_shop().assign(tool=lambda t: t["tool"].str[1:].astype(numbers), edge=lambda t: t["edge"].astype(numbers))
    plan = planned(write(table, tmp_path / "a.parquet", row_group_size=24), reads=reads)
    assert [pair.tool for pair in plan.pairs] == ["0", "1", "2", "3", "4", "5"]
    rows, _ = parquet_rows(plan.blocks[0], plan)
    assert sorted(set(rows[0].frame["edge"])) == ["0", "1", "2", "3", "4", "5"]
    assert next(rows[0].runs())[1].labels("edge")[0] == "0"


def test_nulls_are_missing_and_absurd_numbers_stay_for_the_fit_to_tell(tmp_path):
    table = a_shop(2)
    table["edge"] = table["edge"].astype("Int64")
    table.loc[0, ["V", "edge"]] = [np.nan, pd.NA]
    table.loc[1, "V"], table.loc[2, "V"] = np.inf, 1e300
    found = everything(planned(write(table, tmp_path / "a.parquet")))
    assert np.isnan(found.loc[0, "V"])
    assert found.loc[0, "edge"] == ""
    assert found.loc[1:2, "V"].tolist() == [np.inf, 1e300]


def test_the_thrust_force_is_computed_from_its_parts_unless_it_is_not_wanted(tmp_path):
    table = a_shop(2).assign(**{"Fx [kN]": 0.3, "Fz [N]": 400.0})
    path = write(table, tmp_path / "a.parquet")
    plan = planned(path)
    rows, _ = parquet_rows(plan.blocks[0], plan)
    np.testing.assert_allclose(rows[0].frame["Fxz"], 500.0)
    assert rows[0].units["Fxz"] == "N"
    assert "Fxz" not in everything(planned(path, Reading(map={"Fxz": "none"})))


def test_coded_levels_become_conditions_and_need_their_range(tmp_path):
    table = a_shop(2).assign(V=np.tile([-1.0, 0.0, 1.0], 16))
    path = write(table, tmp_path / "a.parquet")
    with pytest.raises(DataError, match="coded levels"):
        planned(path)
    found = everything(planned(path, Reading(ranges={"V": (50.0, 200.0)})))
    np.testing.assert_allclose(np.unique(found["V"].round(9)), [50, 100, 200])
    evenly = everything(planned(path, Reading(ranges={"V": (50.0, 150.0, 250.0)})))
    np.testing.assert_allclose(np.unique(evenly["V"].round(9)), [50, 150, 250])
    with pytest.raises(UsageError, match="no coded levels"):
        planned(path, Reading(ranges={"f": (0.1, 0.2), "t": (1, 2)}))


def test_a_label_that_is_the_same_in_a_row_group_is_not_read(tmp_path, monkeypatch):
    table = a_shop(pairs=4).assign(work=["steel"] * 24 + [None] * 24 + ["brass", "steel"] * 24)
    path = write(table, tmp_path / "shop.parquet", row_group_size=24)
    read = []
    labelled = indexer.labels
    monkeypatch.setattr(indexer, "labels", lambda array: read.append(array) or labelled(array))
    plan = planned(path)
    assert {str(pair) for pair in plan.pairs} == {
        "T0 on steel", "T1 on unnamed-work", "T2 on brass", "T2 on steel", "T3 on brass", "T3 on steel"
    }  # fmt: skip
    assert len(read) == 3  # work alone, where it differs or is missing: tool is the same in each row group
    assert len(everything(plan)) == len(table)


def test_groups_come_under_their_headers_and_an_unknown_one_is_refused(tmp_path):
    table = a_shop().assign(grade=lambda t: "P" + t["tool"].str[1:], batch=7)
    path = write(table, tmp_path / "a.parquet")
    found = everything(planned(path, Reading(groups=("grade", "batch"))))
    assert (found["grade"].astype(str) == "P" + found["tool"].astype(str).str[1:]).all()
    assert set(found["batch"]) == {"7"}
    with pytest.raises(UsageError, match="Did you mean 'grade'"):
        planned(path, Reading(groups=("grad",)))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        pytest.param(lambda folder: None, "holds no Parquet file", id="an empty folder"),
        pytest.param(lambda folder: write(a_shop()[:0], folder / "a.parquet"), "holds no rows", id="no rows"),
        pytest.param(lambda folder: write(pd.DataFrame({"q": [1.0]}), folder / "a.parquet"), "no column", id="no role"),
        pytest.param(
            lambda folder: write(a_shop().rename(columns={"AW": "AW [N]"}), folder / "a.parquet"), "unit", id="a unit"
        ),
    ],
)
def test_a_source_of_nothing_is_refused_in_a_sentence(tmp_path, make, words):
    folder = tmp_path / "shop"
    folder.mkdir()
    make(folder)
    with pytest.raises(DataError, match=words):
        planned(folder)


def test_hidden_files_and_the_folder_of_the_work_are_no_part_of_the_source(tmp_path):
    table = a_shop()
    folder = tmp_path / "shop"
    write(table, folder / "a.parquet")
    write(table, folder / "_metadata.parquet")
    write(table, folder / ".trash" / "b.parquet")
    write(table, folder / "out" / "sorted" / "c.parquet")
    assert planned(folder, work=folder / "out").rows == len(table)


class Recorded(SerialRun):
    """This process in the place of others, with the tasks that it was given."""

    def __init__(self, running):
        self.running, self.tasks = running, []

    def __call__(self, work, tasks):
        for position, task in enumerate(tasks):
            self.tasks.append(task)
            yield position, pickle.loads(pickle.dumps(work(task)))  # noqa: S301  written here

    def started(self):
        return self.running


@pytest.mark.parametrize(("running", "many", "taken"), [(False, 2, True), (True, 32, True), (False, 32, False)])
def test_a_large_source_is_indexed_by_several_processes(tmp_path, monkeypatch, running, many, taken):
    """Row groups go to them together, as many as are worth a task, and the plan is the same."""
    source = write(a_shop(), tmp_path / "lab.parquet", row_group_size=16)
    serial = planned(source, workers=Recorded(running=False))
    monkeypatch.setattr(indexer, "BATCH", 40)
    monkeypatch.setattr(indexer, "MANY", many)
    workers = Recorded(running)
    assert planned(source, workers=workers) == serial
    assert [len(task) for task in workers.tasks] == ([2, 1] if taken else [])  # of nine row groups those of two pairs


INDICES = (pa.int8(), pa.uint8(), pa.int16(), pa.uint16(), pa.int32(), pa.uint32(), pa.int64(), pa.uint64())
CONTENTS = (["A", "B", None, "", "A "], [1.0, 2.5, None, float("nan")], [1, 2, 3], [True, False], [Decimal("1.50")])


@settings(max_examples=200)
@given(
    st.sampled_from(INDICES),
    st.sampled_from(CONTENTS),
    st.lists(st.none() | st.integers(0, 9), max_size=12),
    st.integers(0, 3),
)
def test_labels_are_the_texts_of_an_array_whatever_codes_its_writer_chose(index, content, numbers, skipped):
    codes = pa.array([None if number is None else number % len(content) for number in numbers], index)
    array = pa.DictionaryArray.from_arrays(codes, pa.array(content)).slice(skipped)
    found = labels(array)
    assert [found.texts[code] for code in found.codes] == [text_of(value) for value in array.to_pylist()]


@pytest.mark.parametrize("kind", [pa.string(), pa.large_string(), pa.string_view()], ids=str)
def test_labels_of_each_kind_of_text(kind):
    array = pa.array(["b", None, "a", "b"], kind)
    for one in (array, array.dictionary_encode()):
        found = labels(one)
        assert [found.texts[code] for code in found.codes] == ["b", "", "a", "b"]
