"""What a batch leaves: records that go on exactly where it stopped, a folder that is its own, tables, attention."""

import csv
import io
import json
import math
import os
import pickle
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from decimal import Decimal
from functools import partial

import numpy as np
import pandas as pd
import pytest
from fitmodels.batch import output_folder as place
from fitmodels.batch import records
from fitmodels.batch.attention import COPIED, SCATTERS, UNLIKE, attention_frame, attention_summary, with_families
from fitmodels.batch.law_rows import LAW, law_table
from fitmodels.batch.outcomes import DOUBT, NO_LAW, NOT_CONVERGED, REFUSED, BlockOutcome, Concern, PairOutcome
from fitmodels.batch.output_folder import claim, folder_names, prepare, put, sweep
from fitmodels.batch.plan import BatchOptions as Options
from fitmodels.batch.plan import Block, Pair, Piece, Plan, Reading
from fitmodels.batch.records import key_of, record, recorded, written
from fitmodels.batch.tables import csv_bytes, group_column, laws_of, results_csv, results_frame
from fitmodels.core.errors import UsageError
from fitmodels.core.text import printable
from fitmodels.datasets.columns import ColumnUse
from hypothesis import given, settings
from hypothesis import strategies as st

A, B, C = Pair("GC435", "709M40"), Pair("GC4325", "42CrMo4"), Pair("H13A", "Härte 45")
KEY = "0" * 64


def outcome(*pairs, content=b"{}", **more):
    law = {"response": "AW", "form": "power", "unit": "mm", "reason": "", "nobs": 144, "params_V": 0.1 + 0.2}
    each = (PairOutcome(p.tool, p.work, 144, files={"params.json": content, **more}) for p in pairs)
    return BlockOutcome(tuple(each), law_table((i, law) for i in range(len(pairs))), {}, {"AW": "mm"}, 0.5, 10**9)


def the_same(block, other):
    """Whether two outcomes of a block are the same, but for the bytes of files, which no record holds."""
    frames = block.laws, other.laws
    pd.testing.assert_frame_equal(*frames, check_exact=True)
    numbers = [frame.select_dtypes(float).to_numpy().tobytes() for frame in frames]  # -0.0 and 0.0 are equal
    rest = [repr(replace(bare(one), laws=None)) for one in (block, other)]  # 1 and 1.0 and True are equal
    return numbers[0] == numbers[1] and rest[0] == rest[1]


def bare(block):
    return replace(block, pairs=tuple(replace(pair, files={}) for pair in block.pairs))


@pytest.fixture
def out(tmp_path):
    folder = tmp_path / "lab-batch"
    with prepare(folder, "lab", Options()):
        pass
    return folder


# Keys

BLOCK = Block((A, B), (Piece("/lab/a.csv", "a.csv", "7f31"), Piece("/lab/b.csv", "b.csv", "09ab")), 288)
PLAN = Plan("lab", "files", (BLOCK,), 288, (), {}, (), Reading())
USE = ColumnUse(1, "Vc", "Vc", "V", "m/min", False, None)


def test_a_moved_folder_and_another_command_keep_their_keys():
    pieces = tuple(replace(piece, path=f"/elsewhere/{piece.name}") for piece in BLOCK.pieces)
    moved = replace(BLOCK, pieces=pieces)
    assert key_of(moved, replace(PLAN, name="copy of lab"), Options(command="fitmodels batch x")) == key_of(
        BLOCK, PLAN, Options()
    )


OTHERS = {
    "a stamp": (replace(BLOCK, pieces=(replace(BLOCK.pieces[0], stamp="1"), BLOCK.pieces[1])), PLAN, Options()),
    "a piece more": (replace(BLOCK, pieces=(*BLOCK.pieces, Piece("/lab/c", "c", "1"))), PLAN, Options()),
    "a row group": (replace(BLOCK, pieces=(replace(BLOCK.pieces[0], row_group=0), BLOCK.pieces[1])), PLAN,
        Options()),
    "a partition": (
        replace(BLOCK, pieces=(replace(BLOCK.pieces[0], partition=(("tool", "x"),)), BLOCK.pieces[1])), PLAN,
        Options()),
    "the pairs": (replace(BLOCK, pairs=(A,)), PLAN, Options()),
    "the order of the pairs": (replace(BLOCK, pairs=(B, A)), PLAN, Options()),
    "which piece is whose": (replace(BLOCK, of_pair=((0,), (1,))), PLAN, Options()),
    "the route": (replace(BLOCK, streamed=True), PLAN, Options()),
    "an option": (BLOCK, PLAN, Options(error="additive")),
    "the seed": (BLOCK, PLAN, Options(seed=2)),
    "draws that are kept": (BLOCK, PLAN, Options(keep_draws=True)),
    "how it is read": (BLOCK, replace(PLAN, reading=Reading(units={"V": "m/s"})), Options()),
    "how columns are understood": (BLOCK, replace(PLAN, columns=(USE,)), Options()),
    "priors of its own": (
        BLOCK, PLAN, Options(priors={"AW": {"V": {"distribution": "normal", "mean": 0.0, "sd": 1.0}}})),
}  # fmt: skip


@pytest.mark.parametrize("what", OTHERS)
def test_another_key_follows_from(what):
    keys = [key_of(*OTHERS[what]), key_of(BLOCK, PLAN, Options())]
    assert len(set(keys)) == 2
    assert all(len(key) == 64 for key in keys)


def test_another_key_follows_from_another_version(monkeypatch):
    before = key_of(BLOCK, PLAN, Options())
    monkeypatch.setattr(records, "__version__", "9.9.9")
    assert key_of(BLOCK, PLAN, Options()) != before


WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
ONE = st.builds(
    PairOutcome, tool=WORDS, work=WORDS, nobs=st.integers(0, 10**9),
    reason=WORDS,
    concerns=st.lists(st.builds(Concern, kind=WORDS, words=WORDS), max_size=2).map(tuple),
    groups=st.dictionaries(WORDS, WORDS, max_size=2),
    files=st.dictionaries(st.sampled_from(["params.json", "draws.npz"]), st.binary(max_size=20)),
)  # fmt: skip
LAWS = st.fixed_dictionaries({"response": WORDS, "reason": WORDS}, optional={
    "nobs": st.none() | st.integers(-(2**62), 2**62), "by_edge": st.none() | st.booleans(), "no_posterior": WORDS,
    "params_V": st.none() | st.floats(), "odd": st.floats(allow_nan=False, allow_infinity=False),
})  # fmt: skip


def with_laws(pairs):
    return st.lists(st.tuples(st.integers(0, max(len(pairs) - 1, 0)), LAWS), max_size=5 * len(pairs)).map(law_table)


@st.composite
def blocks(draw):
    pairs = draw(st.lists(ONE, max_size=4, unique_by=lambda one: (one.tool, one.work)).map(tuple))
    return draw(st.builds(BlockOutcome, st.just(pairs), with_laws(pairs), **REST))


REST = {
    "unreadable": st.dictionaries(WORDS, WORDS, max_size=2), "units": st.dictionaries(WORDS, WORDS, max_size=2),
    "seconds": st.floats(0, 1e6), "memory": st.integers(0, 2**40),
}  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(block=blocks())
def test_an_outcome_comes_back_exactly(tmp_path_factory, block):
    folder = tmp_path_factory.mktemp("out")
    folders = folder_names(Pair(one.tool, one.work) for one in block.pairs)
    record(folder, KEY, block, folders)
    back = recorded(folder, KEY, folders)
    assert the_same(back, block)
    for one in block.pairs:
        for name, content in one.files.items():
            assert (folder / "pairs" / folders[Pair(one.tool, one.work)] / name).read_bytes() == content


def test_numbers_of_numpy_come_back_as_plain_ones_and_nan_as_none(out):
    law = {"a": np.float64(0.1), "nobs": np.int64(7), "by_edge": np.bool_(True), "d": np.nan, "e": np.float64("inf")}
    block = BlockOutcome((PairOutcome("x", "y", np.int64(3)),), law_table([(0, law)]), {}, {}, 0.0, 0)
    record(out, KEY, block, folder_names([Pair("x", "y")]))
    back = recorded(out, KEY, folder_names([Pair("x", "y")])).laws.drop(columns=[*LAW])
    assert repr(back.to_dict("list")) == (
        "{'pair': [0], 'a': [0.1], 'nobs': [7], 'by_edge': [True], 'd': [nan], 'e': [nan]}"
    )


def at(out):
    return out / records.RECORDS / f"{KEY}.json"


def tear(out):
    at(out).write_bytes(at(out).read_bytes()[:-20])


def swap(out, name, value):
    data = json.loads(at(out).read_text()) | {name: value}
    data.pop("sha256")
    text = json.dumps(data.pop("outcome"), separators=(",", ":"))
    at(out).write_bytes(records._sealed(data, text))


def alter(out, change):
    swap(out, "outcome", change(json.loads(at(out).read_text())["outcome"]))


def spoil(outcome, name, values):
    return outcome | {"laws": outcome["laws"] | {name: values}}


SPOILT = {
    "its record is gone": lambda out: at(out).unlink(),
    "its record is torn": tear,
    "its record is empty": lambda out: at(out).write_bytes(b""),
    "its record is of another schema": lambda out: swap(out, "schema", "fitmodels.batch-block/1"),
    "its record is no object": lambda out: at(out).write_text("[]"),
    "its record holds something else": lambda out: swap(out, "outcome", {"pairs": 7}),
    "its laws are no table": lambda out: alter(out, lambda outcome: outcome | {"laws": [1]}),
    "a law is of no pair": lambda out: alter(out, lambda outcome: spoil(outcome, "pair", [0, 2])),
    "a column is short": lambda out: alter(out, lambda outcome: spoil(outcome, "reason", [""])),
    "the number of a pair is none": lambda out: alter(out, lambda outcome: spoil(outcome, "pair", [0, "1"])),
    "the number of a pair is a part": lambda out: alter(out, lambda outcome: spoil(outcome, "pair", [0, 1.5])),
    "numbers of pairs are packed": lambda out: alter(out, lambda outcome: spoil(outcome, "pair", "AAAAAAAAAAA=")),
    "a whole number is too large": lambda out: alter(out, lambda outcome: spoil(outcome, "nobs", [1, 2**70])),
    "a whole number is text": lambda out: alter(out, lambda outcome: spoil(outcome, "nobs", [1, "x"])),
    "a pair has no number of rows": lambda out: alter(
        out, lambda outcome: outcome | {"pairs": outcome["pairs"] | {"nobs": [1, "x"]}}
    ),
    "a pair has no tool": lambda out: alter(
        out, lambda outcome: outcome | {"pairs": outcome["pairs"] | {"tool": ["a"]}}
    ),
    "a concern is of no pair": lambda out: alter(
        out, lambda outcome: outcome | {"pairs": outcome["pairs"] | {"concerns": [[-1, "few edges", "4 edges"]]}}
    ),
    "reasons are missing": lambda out: alter(
        out, lambda outcome: outcome | {"laws": {k: v for k, v in outcome["laws"].items() if k != "reason"}}
    ),
    "numbers are damaged": lambda out: alter(out, lambda outcome: spoil(outcome, "params_V", "AAAAAAA=")),
    "a file is missing": lambda out: (out / "pairs/GC435_709M40/params.json").unlink(),
    "a file has other bytes, as many": lambda out: (out / "pairs/GC435_709M40/params.json").write_bytes(b"[]"),
    "a folder stands for a file": lambda out: (
        (out / "pairs/GC435_709M40/params.json").unlink(),
        (out / "pairs/GC435_709M40/params.json").mkdir(),
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", SPOILT)
def test_a_block_is_fitted_again_where(what, out):
    folders = folder_names([A, B])
    record(out, KEY, outcome(A, B), folders)
    assert recorded(out, KEY, folders) is not None
    SPOILT[what](out)
    assert recorded(out, KEY, folders) is None


def test_a_block_is_fitted_again_where_its_pair_has_another_folder_now(out):
    """A pair that comes to the source later may take the name that this one had."""
    low, new = Pair("gc435", "709M40"), Pair("GC435", "709M40")
    record(out, KEY, outcome(low), folder_names([low]))
    assert recorded(out, KEY, folder_names([low])) is not None
    assert recorded(out, KEY, folder_names([new, low])) is None


ELSEWHERE = ["../../x", "pairs/../x", "pairs/a/..", "/etc/passwd", "x", "pairs/a/b/c", "pairs\\a\\b"]


@pytest.mark.parametrize("name", ELSEWHERE)
def test_a_record_that_names_files_elsewhere_is_none_of_ours(name, out):
    record(out, KEY, outcome(A), folder_names([A]))
    swap(out, "files", {name: "0"})
    assert written(out) == {}
    assert recorded(out, KEY, folder_names([A])) is None


@pytest.mark.parametrize("at_which", [1, 2, 3, 4])
def test_a_kill_at_any_write_leaves_what_can_be_gone_on_from(at_which, out, monkeypatch):
    """The writes of a block of two pairs: that it is begun, files of a pair, of the other, its outcome."""
    folders = folder_names([A, B, C])
    record(out, "1" * 64, outcome(C), folders)
    monkeypatch.setattr(records, "WRITERS", 1)
    calls = []

    def interrupted(real, path, content, **more):
        calls.append(path)
        if len(calls) >= at_which:
            raise KeyboardInterrupt
        real(path, content, **more)

    with monkeypatch.context() as patched:
        for name in ("write_whole", "write_files"):
            patched.setattr(records, name, partial(interrupted, getattr(records, name)))
        with pytest.raises(KeyboardInterrupt):
            record(out, KEY, outcome(A, B), folders)
    assert recorded(out, KEY, folders) is None
    assert the_same(recorded(out, "1" * 64, folders), outcome(C))
    there = {path.relative_to(out).as_posix() for path in (out / "pairs").rglob("params.json")}
    assert there <= {name for files in written(out).values() for name in files}  # each is known to be ours
    with prepare(out, "lab", Options()):
        record(out, KEY, outcome(A, B), folders)
    assert the_same(recorded(out, KEY, folders), outcome(A, B))


def test_a_process_killed_while_it_writes_loses_one_block_at_most(tmp_path):
    """It ends itself as kill -9 would, between the files of the second block."""
    out = tmp_path / "lab-batch"
    code = f"""
import os, signal
from functools import partial
from pathlib import Path
from fitmodels.batch import output_folder, records
from fitmodels.batch.law_rows import law_table
from fitmodels.batch.outcomes import BlockOutcome, PairOutcome
from fitmodels.batch.plan import BatchOptions as Options, Pair
out, calls = Path({str(out)!r}), []
def killed(real, path, content, **more):
    calls.append(path)
    if len(calls) == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    real(path, content, **more)
for name in ("write_whole", "write_files"):
    setattr(records, name, partial(killed, getattr(records, name)))
folders = output_folder.folder_names([Pair("a", "x"), Pair("b", "x")])
with output_folder.prepare(out, "lab", Options()):
    for tool in "ab":
        pair = PairOutcome(tool, "x", 1, files={{"params.json": b"{{}}"}})
        records.record(out, tool * 64, BlockOutcome((pair,), law_table(()), {{}}, {{}}, 0.0, 0), folders)
"""
    ended = subprocess.run([sys.executable, "-c", code], check=False, cwd=tmp_path)
    assert ended.returncode == -9
    assert (out / place.LOCK).exists()
    folders = folder_names([Pair("a", "x"), Pair("b", "x")])
    with prepare(out, "lab", Options()):  # its lock is taken over
        assert recorded(out, "a" * 64, folders) is not None
        assert recorded(out, "b" * 64, folders) is None


# Names of folders


def test_folders_have_names_that_stay_inside_and_differ():
    pairs = [
        Pair("GC435", "709M40"), Pair("gc435", "709m40"), Pair("GC435", "709M40 "), Pair("Härte", "Stahl 1.4301"),
        Pair("Ha\u0308rte", "STAHL 1.4301"), Pair("../../etc", "a/b\\c"), Pair("..", ""), Pair("CON", "x"),
        Pair("con.1", "x"), Pair("刀具", "钢"), Pair("x" * 300, "ü" * 300), Pair("a\0b", "c:d*?"),
    ]  # fmt: skip
    assert list(folder_names(pairs).values()) == [
        "GC435_709M40", "gc435_709m40-2", "GC435_709M40-3", "Härte_Stahl-1.4301", "Härte_STAHL-1.4301-2",
        "etc_a-b-c", "unnamed_unnamed", "CON_x", "con-1_x", "刀具_钢", "x" * 80 + "_" + "ü" * 40, "a-b_c-d",
    ]  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.text(max_size=90), st.text(max_size=90)), max_size=12, unique=True))
def test_any_names_give_folders_that_every_file_system_takes(names):
    """Rules: learn.microsoft.com/windows/win32/fileio/naming-a-file; 255 bytes a name on ext4, APFS and NTFS."""
    made = list(folder_names(Pair(*name) for name in names).values())
    assert len({name.casefold() for name in made}) == len(names)
    for name in made:
        assert len(name.encode()) < 200
        assert not set(name) & set('<>:"/\\|?*')
        assert name.isprintable()
        assert name[-1] not in " ."
        assert name.partition(".")[0].upper() not in {"CON", "PRN", "AUX", "NUL", "COM1"}


def test_names_are_numbered_past_those_that_look_numbered():
    made = folder_names([Pair("a", "x"), Pair("A", "x"), Pair("a", "x-2"), Pair("a", "X")])
    assert list(made.values()) == ["a_x", "A_x-2", "a_x-2-2", "a_X-3"]


def test_numbering_is_linear():
    """Ten thousand names that all collide: trying each number anew would take fifty million steps."""
    made = folder_names(Pair("a" + " " * (n // 100), "x" + " " * (n % 100)) for n in range(10_000))
    assert list(made.values())[-1] == "a_x-10000"


# The folder


def test_an_output_folder_is_made_and_taken_up_again(tmp_path):
    out = tmp_path / "deep" / "lab-batch"
    for how in (Options(), Options(), Options(seed=2)):
        with prepare(out, "lab", how):
            assert (out / place.LOCK).exists()
    said = json.loads((out / place.MANIFEST).read_text())
    assert (said["schema"], said["source"], said["options"]["seed"]) == ("fitmodels.batch/1", "lab", 2)


def test_the_same_batch_again_writes_nothing(out):
    folders = folder_names([A])
    record(out, KEY, outcome(A), folders)
    put(out, "results.csv", b"x\n")
    before = stamps(out)
    with prepare(out, "lab", Options()):
        assert recorded(out, KEY, folders) is not None
        assert put(out, "results.csv", b"x\n") is False
        assert sweep(out, {KEY}) == ()
    assert stamps(out) == before


def stamps(out):
    """Times of the files but that of the lock, which some releases of filelock write anew or remove."""
    return {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file() and path.name != "lock"}


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("mine")
    with (
        pytest.raises(UsageError, match="is a file; choose a folder with --out"),
        prepare(tmp_path / "out", "lab", Options()),
    ):
        pass


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_of_somebody_else_is_refused_and_stays_as_it_is(tmp_path, force):
    (tmp_path / "thesis.docx").write_text("mine")
    with (
        pytest.raises(UsageError, match=r"holds 'thesis\.docx', which batch did not write"),
        prepare(tmp_path, "lab", Options(), force),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.docx"]


@pytest.mark.parametrize("content", [b'{"schema": "fitmodels.batch/1", "sou', b"", b"[" * 100_000, b"9" * 5000])
def test_a_damaged_manifest_is_named_and_replaced_by_force(out, content):
    """A folder whose manifest was cut short is not said to hold foreign files."""
    record(out, KEY, outcome(A), folder_names([A]))
    (out / place.MANIFEST).write_bytes(content)
    with pytest.raises(UsageError, match=r"manifest\.json: is damaged"), prepare(out, "lab", Options()):
        pass
    assert (out / "pairs").exists()
    with prepare(out, "lab", Options(), force=True):
        assert not (out / "pairs").exists()


def test_a_record_that_was_changed_is_not_taken(out):
    """Every number of the table of laws is in it, so that one changed digit would be a result."""
    folders = folder_names([A])
    record(out, KEY, outcome(A), folders)
    path = out / place.RECORDS / f"{KEY}.json"
    content = path.read_text()
    for changed in (content.replace('"nobs":[144', '"nobs":[145'), content.replace('"nobs":[144', '"nobs":[NaN')):
        path.write_text(changed)
        assert recorded(out, KEY, folders) is None
    path.write_text(content)
    assert recorded(out, KEY, folders) is not None


def test_a_batch_of_another_source_is_refused_without_force(out):
    record(out, KEY, outcome(A), folder_names([A]))
    with (
        pytest.raises(UsageError, match="holds a batch of lab, not of shop; replace it with --force"),
        prepare(out, "shop", Options()),
    ):
        pass
    with prepare(out, "shop", Options(), force=True):
        assert not (out / "pairs").exists()
    assert json.loads((out / place.MANIFEST).read_text())["source"] == "shop"


def test_force_takes_away_what_batch_wrote_and_nothing_else(out):
    record(out, KEY, outcome(A, B, **{"draws.npz": b"draws"}), folder_names([A, B]))
    put(out, "results.csv", b"tool,work\n")
    put(out, "figures/V.png", b"png")
    claim(out, ["site/index.html"])
    (out / "site").mkdir()
    (out / "site/index.html").write_text("made elsewhere")
    mine = [
        "notes.txt",
        "figures/mine.png",
        "pairs/GC435_709M40/notes.txt",
        "pairs/mine/params.json",
        ".batch/sorted.parquet",
    ]
    for name in mine:
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("mine")
    with prepare(out, "lab", Options(), force=True):
        left = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert left == {*mine, ".batch/lock", ".batch/manifest.json"}
    assert not (out / "site").exists()
    assert not (out / "pairs/GC4325_42CrMo4").exists()


def test_force_on_a_full_disk_removes_nothing(out, monkeypatch):
    """It once removed the former results before the manifest, and then refused its own folder as a foreign one."""
    record(out, KEY, outcome(A), folder_names([A]))
    (out / "pairs/card.toml").write_text("mine")

    def full(*_, **__):
        raise UsageError("manifest.json: cannot be written: no space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(place, "write_whole", full)
        with pytest.raises(UsageError, match="no space"), prepare(out, "lab", replace(Options(), seed=3), force=True):
            pass
    assert recorded(out, KEY, folder_names([A])) is not None
    with prepare(out, "lab", replace(Options(), seed=3), force=True):
        assert [path.name for path in (out / "pairs").iterdir()] == ["card.toml"]


def test_a_list_of_files_that_leads_elsewhere_is_not_followed(out, tmp_path):
    (tmp_path / "mine").write_text("mine")
    (out / place.MADE).write_text(json.dumps(["../mine", str(tmp_path / "mine"), 7]))
    with prepare(out, "lab", Options(), force=True):
        assert (tmp_path / "mine").exists()


def test_a_parameter_file_that_was_changed_is_not_written_over(out):
    """For instance with ``fitmodels tune``, which adds its section to the file."""
    record(out, KEY, outcome(A), folder_names([A]))
    path = out / "pairs/GC435_709M40/params.json"
    path.write_text("tuned")
    with (
        pytest.raises(UsageError, match=r"params\.json was changed since batch wrote it; move it elsewhere"),
        prepare(out, "lab", Options(seed=2)),
    ):
        pass
    assert path.read_text() == "tuned"
    with prepare(out, "lab", Options(), force=True):
        assert not path.exists()


def test_a_copy_of_the_folder_goes_on_from_its_records(out, tmp_path):
    """A copy has new times; what counts is the content."""
    record(out, KEY, outcome(A), folder_names([A]))
    copy = tmp_path / "copy"
    shutil.copytree(out, copy, copy_function=shutil.copyfile)
    os.utime(copy / "pairs/GC435_709M40/params.json", (4e9, 4e9))
    with prepare(copy, "lab", Options()):
        assert recorded(copy, KEY, folder_names([A])) is not None


def test_sweeping_takes_away_pairs_that_are_gone(out):
    folders = folder_names([A, B, C])
    record(out, "1" * 64, outcome(A, B, C, **{"draws.npz": b"draws"}), folders)
    (out / "pairs" / folders[C] / "notes.txt").write_text("mine")
    record(out, KEY, outcome(A, content=b"new"), folders)
    gone = sweep(out, {KEY})
    others = [f"pairs/{folders[pair]}/{name}" for pair in (B, C) for name in ("draws.npz", "params.json")]
    assert sorted(gone) == sorted([f"pairs/{folders[A]}/draws.npz", *others])
    left = {path.relative_to(out / "pairs").as_posix() for path in (out / "pairs").rglob("*")}
    assert left == {folders[A], f"{folders[A]}/params.json", folders[C], f"{folders[C]}/notes.txt"}
    assert list(written(out)) == [KEY]


def test_sweeping_keeps_a_file_that_came_out_the_same(out):
    for key in ("1" * 64, KEY):
        record(out, key, outcome(A), folder_names([A]))
    assert sweep(out, {KEY}) == ()
    assert recorded(out, KEY, folder_names([A])) is not None


def test_sweeping_leaves_what_was_changed_since(out):
    record(out, "1" * 64, outcome(A), folder_names([A]))
    (out / "pairs/GC435_709M40/params.json").write_text("tuned")
    assert sweep(out, set()) == ()
    assert (out / "pairs/GC435_709M40/params.json").read_text() == "tuned"


def test_a_file_where_a_folder_has_to_be_is_named(out):
    (out / "pairs").write_text("mine")
    with pytest.raises(UsageError, match=r"pairs.GC435_709M40: cannot be made: .*; choose another place with --out"):
        record(out, KEY, outcome(A), folder_names([A]))
    (out / "figures").write_text("mine")
    with pytest.raises(UsageError, match=r"figures: cannot be made"):
        put(out, "figures/V.png", b"png")


# The lock


HOLDER = """
import sys
from pathlib import Path
from fitmodels.batch.output_folder import prepare
from fitmodels.batch.plan import BatchOptions
with prepare(Path(sys.argv[1]), "lab", BatchOptions()):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_batch_in_the_same_folder_is_refused(out):
    with prepare(out, "lab", Options()):
        with (
            pytest.raises(UsageError, match=r"another batch is writing there; wait until it ends or choose another"),
            prepare(out, "lab", Options(), force=True),
        ):
            pass
        assert (out / place.LOCK).exists()


def test_a_batch_of_another_process_is_refused_until_that_is_killed(out):
    command = [sys.executable, "-c", HOLDER, str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(UsageError, match="another batch is writing there"), prepare(out, "lab", Options()):
            pass
        holder.kill()
        holder.wait()
        with prepare(out, "lab", Options()):
            pass


def test_a_failure_releases_the_lock(out):
    with pytest.raises(KeyboardInterrupt), prepare(out, "lab", Options()):
        raise KeyboardInterrupt
    with prepare(out, "lab", Options()):
        pass


# Tables


def law(**cells):
    return {"response": "AW", "form": "power", "unit": "mm", "reason": "", **cells}


def test_columns_stand_in_an_order_of_their_own():
    """Whatever law comes first and however its cells are ordered."""
    cells = ("left_out", "posterior_sd_V", "high_V", "params_t", "params_c0", "row_bse_V", "params_material_x",
             "scale_se", "bse_V", "nobs", "params_V", "low_V", "odd", "posterior_route", "n_edges",
             "posterior_sd_c0", "posterior_sd_t", "posterior_t")  # fmt: skip
    rows = [law(**dict.fromkeys(cells[:9])), law(**dict.fromkeys(cells))]
    one = PairOutcome("a", "b", 1, groups={"iso": "P"})
    tables = [law_table((0, row) for row in each) for each in (rows, rows[::-1])]
    made = [list(results_frame([one], table, ["iso", "form"])) for table in tables]
    assert made[0] == made[1] == [
        "tool", "work", "iso", "group form", "response", "form", "unit", "reason", "verdict", "simulated", "nobs",
        "n_edges", "scale_se", "params_c0", "params_V", "bse_V", "row_bse_V", "low_V", "high_V", "params_t",
        "params_material_x", "posterior_sd_c0", "posterior_sd_V", "posterior_t", "posterior_sd_t", "posterior_route",
        "left_out", "odd",
    ]  # fmt: skip
    assert group_column("iso") == "iso"


def test_a_pair_without_a_law_keeps_a_row_with_its_reason():
    one = PairOutcome("a", "b", 2, reason="2 rows are too few.", groups={"iso": "K"})
    laws = law_table([(1, law(nobs=9, params_V=0.5)), (1, law(response="P", reason="P is constant."))])
    made = results_frame([one, PairOutcome("a", "c", 9)], laws, ["iso"])
    assert made["reason"].tolist() == ["2 rows are too few.", "", "P is constant."]
    assert made["nobs"].tolist() == [2, 9, pd.NA]
    assert made["iso"].tolist() == ["K", "", ""]


NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=8) | st.sampled_from(
    ["=2+3", "'=2+3", "-5", "007", "1e5", "True", "nan", "a,b", 'a"b', "a\r\nb", "@x", "+x", "-", " a ", "''"]
)
FLOATS = st.none() | st.floats(allow_nan=False, allow_infinity=False)
ROWS = st.builds(
    lambda text, whole, truth, *floats: law(
        reason=text, nobs=whole, by_edge=truth, params_V=floats[0], low_V=floats[1], left_out=text
    ),
    NAMES, st.none() | st.integers(-(2**62), 2**62), st.none() | st.booleans(), FLOATS, FLOATS,
)  # fmt: skip
PAIRS_OF_ROWS = st.tuples(
    st.builds(
        PairOutcome, NAMES, NAMES, st.integers(0, 99), NAMES,
        groups=st.dictionaries(st.sampled_from(["iso 513", "=grade", "unit"]), NAMES),
    ),
    st.lists(ROWS, max_size=3),
)  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(st.lists(PAIRS_OF_ROWS, max_size=4))
def test_results_lose_no_digit(outcomes):
    laws = law_table((i, row) for i, (_, rows) in enumerate(outcomes) for row in rows)
    made = results_frame([one for one, _ in outcomes], laws, ["iso 513", "=grade", "unit"])
    header, *rows = csv.reader(io.StringIO(csv_bytes(made).decode(), newline=""))
    assert header == ["tool", "work", "iso 513", "'=grade", "group unit", *list(made)[5:]]
    for name, cells in zip(made, zip(*rows, strict=True), strict=False):
        kind = made[name].dtype
        if kind == "float64":
            np.testing.assert_array_equal([float(cell or "nan") for cell in cells], made[name])
        elif kind == "object":  # an apostrophe keeps a spreadsheet from computing it
            computed = re.compile(r"'*[=+\-@\t\r].", re.DOTALL)
            assert list(cells) == ["'" * bool(computed.match(text)) + printable(text) for text in made[name]]
        else:
            assert list(cells) == ["" if value is pd.NA else str(value) for value in made[name].tolist()]


@settings(max_examples=200)
@given(st.lists(st.floats() | st.floats(1e-5, 1e-3) | st.floats(1e15, 1e17)))
def test_numbers_are_written_with_the_fewest_digits_that_read_back_the_same(numbers):
    """Those of Python's ``repr``, whatever power of ten the JSON writer prefers; none for what is not finite."""
    made = csv_bytes(pd.DataFrame({"tool": "a", "V": np.array(numbers, dtype=float)})).decode().split("\n")[1:-1]
    for line, value in zip(made, numbers, strict=True):
        cell = line.removeprefix("a,")
        if math.isfinite(value):
            assert float(cell) == value
            assert Decimal(cell).normalize() == Decimal(repr(value)).normalize()
        else:
            assert cell == ""


def test_outcomes_are_the_same_in_another_process():
    few = (Concern("few edges", "4"),)
    both = PairOutcome("a", "b", 3, "few rows", few, {"grade": "P"}, True, {"params.json": b"{}"}), Pair("a", "b")
    assert pickle.loads(pickle.dumps(both)) == both  # noqa: S301  written here


def test_pandas_reads_the_same_numbers(tmp_path):
    numbers = np.random.default_rng(1).normal(size=200) * 10.0 ** np.arange(-100, 100)
    outcomes = [PairOutcome("a", str(i), 1) for i in range(len(numbers))]
    made = results_frame(outcomes, law_table((i, law(nobs=i, params_V=v)) for i, v in enumerate(numbers)))
    (tmp_path / "results.csv").write_bytes(csv_bytes(made))
    back = pd.read_csv(tmp_path / "results.csv", dtype={"params_V": str})  # its own parser may miss the last digit
    assert back["params_V"].map(float).tolist() == numbers.tolist()
    assert back["nobs"].tolist() == list(range(200))


def test_names_that_a_spreadsheet_would_compute_are_only_text():
    """Characters: OWASP, CSV Injection, owasp.org/www-community/attacks/CSV_Injection."""
    names = ["=cmd|' /C calc'!A0", "+1", "-x", "@SUM(A1)", "\tx", "\rx"]
    lines = csv_bytes(pd.DataFrame({"tool": names, "V": -1.5})).decode().split("\n")
    assert all(line.removeprefix('"').startswith("'") and line.endswith(",-1.5") for line in lines[1:-1])


# Attention


def fitted(tool, *kinds):
    return PairOutcome(tool, "x", 9, concerns=tuple(Concern(kind, f"{kind} of {tool}") for kind in kinds))


def results(outcomes, *rows):
    """The table where each pair has one law."""
    given = rows or [{} for _ in outcomes]
    return results_frame(outcomes, law_table((i, law(**row)) for i, row in enumerate(given)))


def test_the_gravest_comes_first_and_unknown_kinds_last_by_their_names():
    outcomes = [
        fitted("a", "rows left out", "zeal"), fitted("b", "zeal", "awe"), fitted("c", "zeal", UNLIKE),
        PairOutcome("d", "x", 1, reason="1 row."),
        PairOutcome("e", "x", 1, reason="2 rows.", concerns=(Concern(NO_LAW, "two"),)),
    ]  # fmt: skip
    made = attention_summary(outcomes, most=2)
    counts = [(NO_LAW, 2), (UNLIKE, 1), ("rows left out", 1), ("awe", 1), ("zeal", 3)]
    assert [(item.kind, item.pairs) for item in made] == counts
    assert (made[0].examples, made[0].words) == (("d on x", "e on x"), ("1 row.", "two"))
    assert made[-1].examples == ("a on x", "b on x")
    frame = attention_frame(outcomes)
    assert frame.columns.tolist() == ["tool", "work", "kind", "words"]
    assert frame["kind"].tolist() == ["rows left out", "zeal", "zeal", "awe", "zeal", UNLIKE, NO_LAW, NO_LAW]


def test_the_results_are_joined_from_the_parts_of_their_blocks_where_these_have_all_columns():
    cells = [{"params_V": 0.5}, {"params_V": 0.6}, {"params_t": 0.25}]
    pairs = [(PairOutcome(f"T{i}", "C45", 9),) for i in range(len(cells))]
    blocks = [BlockOutcome(of, law_table([(0, law(**one))]), {}, {}) for of, one in zip(pairs, cells, strict=True)]
    blocks = [replace(block, csv=csv_bytes(results_frame(block.pairs, block.laws))) for block in blocks]
    for some in (blocks[:2], blocks, [blocks[0], replace(blocks[1], csv=b"")]):
        whole = results_frame([pair for block in some for pair in block.pairs], laws_of(some))
        assert results_csv(whole, some) == csv_bytes(whole)
    marked = [replace(block, csv=block.csv.replace(b"T", b"U")) for block in blocks[:2]]
    whole = results_frame([pair for block in marked for pair in block.pairs], laws_of(marked))
    assert results_csv(whole, marked) == csv_bytes(whole).replace(b"T", b"U")  # the parts are used


def test_no_concern_gives_empty_tables():
    assert attention_summary([fitted("a")]) == []
    assert csv_bytes(attention_frame([fitted("a")])) == b"tool,work,kind,words\n"


def test_a_pair_that_scatters_is_reported_and_one_with_hardly_any_rows_is_not():
    outcomes = [fitted(name) for name in (*"abcdef", "loud", "near", "small")]
    rows = [{"scale_se": scale, "df_resid": 100} for scale in (*[0.1] * 6, 0.31, 0.29, 0.35)]
    rows[-1]["df_resid"] = 1
    made = with_families(outcomes, results(outcomes, *rows))
    assert [(one.tool, c.kind) for one in made for c in one.concerns] == [("loud", SCATTERS)]
    assert made[6].concerns[0].words == "AW has a scatter of 3.1 times the median of the pairs (0.31 against 0.1)"
    three = outcomes[4:7]
    assert with_families(three, results(three, *rows[4:7])) == three  # they do not tell what is usual


def test_measurements_that_stand_under_two_names_are_named():
    outcomes = [fitted(name) for name in "abcd"]
    scales = (0.05, 0.07, 0.05 * (1 + 1e-13), 0.05 * (1 + 1e-8))
    rows = [{"scale_se": scale, "rsquared": 0.9, "nobs": 45, "df_resid": 40} for scale in scales]
    made = with_families(outcomes, results(outcomes, *rows))
    named = [[concern.words for concern in one.concerns if concern.kind == COPIED] for one in made]
    assert [len(one) for one in named] == [1, 0, 1, 0]
    assert "with all digits: the same measurements under two names" in named[0][0]
    assert str(Pair(made[2].tool, made[2].work)) in named[0][0]


def test_names_that_may_be_of_one_pair_or_of_none_are_doubted():
    names = [("GC435", "C45"), ("gc 435", "C45"), ("GC435", "C 60"), ("NA", "C45"), ("H13A", "C45")]
    outcomes = [PairOutcome(tool, work, 9) for tool, work in names]
    made = with_families(outcomes, results(outcomes))
    advice = "is another pair: the names differ in blanks or case only. If they are one pair, spell them alike in the "
    advice += "source."
    assert [(one.tool, c.kind, c.words) for one in made for c in one.concerns] == [
        ("GC435", "doubtful name", f"'gc 435 on C45' {advice}"),
        ("gc 435", "doubtful name", f"'GC435 on C45' {advice}"),
        ("NA", "doubtful name", "tool 'NA' stands for a missing name: rows of several tools may be in this pair."),
    ]


def ranges(quantity, *ends):
    """A law of each pair, AW from .1 to .3 mm at feeds of .1 to .3 mm/rev, but for one quantity."""
    usual = {"response_from": 0.1, "response_to": 0.3, "from_f": 0.1, "to_f": 0.3}
    names = ("response_from", "response_to") if quantity == "AW" else (f"from_{quantity}", f"to_{quantity}")
    return [usual | dict(zip(names, each, strict=True)) for each in ends]


@pytest.mark.parametrize(
    ("what", "rows", "words"),
    [
        ("wear in inches", ranges("AW", *[(0.1, 0.4)] * 4, (0.08, 0.3), (0.004, 0.016)),
         "AW 0.004 to 0.016 mm: multiplied by 25.4 (inch and mm) it is among the other pairs, whose middles are 0.155 "
         "to 0.2 mm; check its unit."),
        ("wear in micrometres", ranges("AW", *[(0.1, 0.4)] * 5, (60, 280)), "AW 60 to 280 mm: divided by 1000 (um and "
         "mm) it is among the other pairs, whose middles are 0.2 to 0.2 mm; check its unit."),
        ("time in seconds", ranges("t", *[(2, 14)] * 5, (120, 840)), "t 120 to 840 min: divided by 60 (seconds and "
         "minutes) it is among the other pairs, whose middles are 5.29 to 5.29 min; check its unit."),
        ("feeds in inches", ranges("f", *[(0.1, 0.3)] * 5, (0.004, 0.012)), "f 0.004 to 0.012 mm/rev: multiplied by "
         "25.4 (inch and mm) it is among the other pairs, whose middles are 0.173 to 0.173 mm/rev; check its unit."),
        ("a depth of finishing", ranges("d", *[(2, 4)] * 5, (0.1, 0.15)), ""),
        ("a speed of aluminium among titanium", ranges("V", *[(45, 60)] * 5, (500, 700)), ""),
        ("wear of tests that end early", ranges("AW", *[(0.1, 0.4)] * 5, (0.012, 0.03)), ""),
        ("a decimal mark could be the reason, or the tool", ranges("AW", *[(0.1, 0.4)] * 5, (0.01, 0.04)), ""),
        ("feeds over a wide range",
         ranges("f", (0.01, 0.02), (0.03, 0.06), (0.1, 0.2), (0.3, 0.6), (0.004, 0.012)), ""),
        ("too few pairs", ranges("AW", *[(0.1, 0.4)] * 3, (0.004, 0.016)), ""),
        ("no range is known", [{}] * 6, ""),
        ("a factor that a law leaves out", ranges("f", *[(0.1, 0.3)] * 5, (None, None)), ""),
    ],
)  # fmt: skip
def test_a_pair_in_another_unit_than_the_others_is_doubted(what, rows, words):
    outcomes = [fitted(f"T{i}") for i in range(len(rows))]
    made = with_families(outcomes, results(outcomes, *rows))
    assert [(one.tool, c.kind, c.words) for one in made for c in one.concerns] == (
        [(f"T{len(rows) - 1}", DOUBT, words)] if words else []
    )


def pooled(estimate, se=0.02, df=20.0, tool="a", family="P", new=(0.4, 0.6), factor="V"):
    return {
        "tool": tool, "work": "x", "response": "AW", "factor": factor, "grouping": "iso", "family": family,
        "estimate": estimate, "se": se, "df": df, "new_low": new[0], "new_high": new[1],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("what", "row", "reported"),
    [
        ("inside the interval of a new pair", pooled(0.55), False),
        ("outside it", pooled(0.72), True),
        ("below it", pooled(0.28), True),
        ("outside it, by less than its own error", pooled(0.72, se=0.1), False),
        ("outside it, with an error that one degree of freedom gives", pooled(0.95, se=0.02, df=1.0), False),
        ("outside it, its error known", pooled(0.95, se=0.02, df=np.inf), True),
        ("of a family too small to tell", pooled(0.9, new=(np.nan, np.nan)), False),
        ("without a standard error", pooled(0.9, se=np.nan), False),
    ],
)
def test_an_exponent_is_unlike_its_family(what, row, reported):
    """By hand: half a 99 % interval of the family is 0.1 * 2.576 / 1.960 = 0.131, of one with df 1 63.66 se."""
    made = with_families([fitted("a")], results([fitted("a")]), pd.DataFrame([row]))
    assert [c.kind for c in made[0].concerns] == ([UNLIKE] if reported else [])


def test_an_exponent_is_reported_once_by_the_family_of_its_grouping():
    rows = [pooled(0.9, family="all pairs"), pooled(0.9, family="P"), pooled(0.9, factor="f"), pooled(0.5, tool="b")]
    both = [fitted("a"), fitted("b")]
    made = with_families(both, results(both), pd.DataFrame(rows))
    words = [c.words for c in made[0].concerns]
    assert len(words) == 2
    assert not made[1].concerns
    assert words[0].startswith(
        "AW: exponent of V 0.9 +- 0.02; another pair of P with this standard error is expected between 0.3"
    )


def test_what_compare_gives_is_understood():
    from fitmodels.batch.comparison import compare

    rng = np.random.default_rng(5)
    exponents = [*rng.normal(0.5, 0.03, 40), 1.2]
    outcomes = [fitted(f"T{i}") for i in range(len(exponents))]
    same = {"df": 20, "df_resid": 20, "scale_se": 0.1, "bse_V": 0.03, "n_edges": 24}
    table = results(outcomes, *({**same, "params_V": b} for b in exponents))
    made = with_families(outcomes, table, compare(table).pairs)
    assert [one.tool for one in made if one.concerns] == ["T40"]


def test_every_kind_of_concern_of_fitting_has_its_place():
    """A kind that is not in the list would come last, however grave."""
    from pathlib import Path

    import fitmodels.batch.fitting as directory
    from fitmodels.batch.attention import SEVERITY

    texts = [path.read_text("utf-8") for path in Path(directory.__path__[0]).glob("*.py")]
    reported = r"""(?<!>>> )(?:Concern\(|yield i, )(?:"([^"]+)"|([A-Z_]+)\b)"""
    named = {name: word for text in texts for name, word in re.findall(r'^([A-Z_]+) = "([^"]+)"$', text, re.MULTILINE)}
    named |= {"NO_LAW": NO_LAW, "NOT_CONVERGED": NOT_CONVERGED, "REFUSED": REFUSED, "DOUBT": DOUBT}
    kinds = {kind or named[name] for text in texts for kind, name in re.findall(reported, text)}
    assert len(kinds) > 12
    assert {"fits badly", "doubt in reading"} <= kinds
    assert kinds | {"do not use for control", "usable with reservations"} <= set(SEVERITY)
