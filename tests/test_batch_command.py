"""``fitmodels batch`` as an engineer meets it: what it prints and where, exit codes, Ctrl-C, sentences for errors."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import fitmodels
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fitmodels import batch, datasets, parameters
from fitmodels.batch import run_batch, terminal
from fitmodels.batch.plan import Block, Pair, Plan, Reading
from fitmodels.cards.content.card import compose
from fitmodels.cards.publishing.entries import card_entry
from fitmodels.cards.publishing.pages import index_page
from fitmodels.cli import main
from rich.console import Console

pytestmark = pytest.mark.slow  # processes and clusters

WEAR = datasets.SimulatedLaw("VB", "mm", 0.009, {"V": 0.52, "f": 0.15, "t": 0.25}, 0.08, 0.07)
PLAN = datasets.central_composite({"V": (72, 117), "f": (0.1, 0.3)}, seed=1)
CARD = """license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "none, simulated"
setup = "none, simulated"
no_sensors = "simulated"
iso513 = "P20"
"""
FAST = ("--draws", "1000", "--jobs", "1")
progress_module = sys.modules["fitmodels.core.progress"]
needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")


def simulated(i):
    frame = datasets.simulate(PLAN, [WEAR], seed=i, criterion=None)
    return frame.assign(tool=f"T{i}", work="C45", edge=frame["edge"].astype(str)).drop(columns="point")


def lab_files(folder, pairs=2):
    folder.mkdir(parents=True)
    for i in range(pairs):
        simulated(i).to_csv(folder / f"t{i}.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """A folder of two lab files."""
    return lab_files(tmp_path_factory.mktemp("shop") / "lab")


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A folder of its own, with an error that nobody expected raised rather than reported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FITMODELS_TRACEBACK", "1")
    return tmp_path


def strict(text):
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(constant):
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def numbers(out):
    """Bytes of all tables and parameter files, these without the command, which names engine and folder."""
    found = {path.name: path.read_bytes() for path in out.glob("*.csv")}
    files = sorted(out.glob("pairs/*/params.json"))
    return found | {str(path.relative_to(out)): without_command(path) for path in files}


def without_command(path):
    command = json.loads(path.read_bytes())["provenance"]["command"]
    kept = (line for line in path.read_text("utf-8").splitlines() if json.dumps(command) not in line)
    return [line for line in kept if '"content_sha256"' not in line]


def program(code, *words, **more):
    """Start a process of its own."""
    where = str(Path(fitmodels.__file__).absolute().parent.parent)
    environment = {k: v for k, v in os.environ.items() if k != "FITMODELS_TRACEBACK"} | {"PYTHONPATH": where}
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment, **more,
    )  # fmt: skip


# --- what is printed, and where


def test_the_first_run_reports_everything_and_the_second_that_nothing_is_new(shop, capsys):
    assert main(["batch", str(shop), *FAST]) == 0
    said = capsys.readouterr().out
    for words in (
        "lab: 2 lab files; 320 rows, 2 pairs", "of at most 320 rows in memory at a time", "Laws of 2 of 2 pairs",
        "VB  flank wear, mm: power, 2 pairs", "V exponent", "Fitted 2 pairs in", "peak memory of a process",
        "Written: lab-batch/ (",
        "No site was written: 2 of 2 pairs cannot be published yet.", "fill in lab-batch/pairs/card.toml",
        "the ISO 513 group of the material of ", "; give it with --pairs TABLE, with the names as they are in the data",
    ):  # fmt: skip
        assert words in said.replace("\n  ", " "), words
    assert max(map(len, said.splitlines())) <= 120
    assert "nan" not in said
    assert main(["batch", str(shop), *FAST]) == 0
    again = capsys.readouterr().out
    assert "Kept 2 pairs from before: their rows and the options are the same." in again
    assert "Unchanged: lab-batch/ (" in again
    assert "Fitted" not in again


def test_results_go_to_standard_output_and_progress_elsewhere(shop, capsys, monkeypatch):
    monkeypatch.setattr(progress_module, "PATIENCE", 0.01)
    monkeypatch.setattr(progress_module, "BETWEEN_LINES", 0.01)
    assert main(["batch", str(shop), "--table-only", "--jobs", "1"]) == 0
    said = capsys.readouterr()
    assert "of 2 pairs" in said.err
    assert "fitting" in said.err
    assert "fitting: " not in said.out
    assert said.out.startswith("Input")


def test_json_is_json_and_nothing_else(shop, here, capsys):
    (here / "lab").mkdir()
    for path in (*shop.iterdir(),):
        (here / "lab" / path.name).write_bytes(path.read_bytes())
    (here / "lab" / "odd.csv").write_text("no table\n")
    one = simulated(1).head(1).assign(tool="FEW")
    one.to_csv(here / "lab" / "few.csv", index=False)
    assert main(["batch", "lab", "--json", "--table-only", "--jobs", "1"]) == 3
    report = strict(capsys.readouterr().out)
    assert report["schema"] == "fitmodels.batch-report/1"
    assert (report["pairs"], report["pairs_with_a_law"], report["fitted"], report["kept"]) == (3, 2, 3, 0)
    assert list(report["unreadable"]) == ["odd.csv"]
    assert report["attention"][0]["kind"] == "no law"
    assert report["attention"][0]["examples"] == ["FEW on C45"]
    assert report["memory_bytes"] > 10e6
    assert report["site"] is None
    assert report["written"][0] == "results.csv"
    assert main(["batch", "lab", "--table-only", "--jobs", "1"]) == 3
    said = capsys.readouterr().out
    assert "not read" in said
    assert "odd.csv" in said
    assert "FEW on C45" in said


def test_families_are_reported_in_json_without_nan(here, capsys):
    shop = lab_files(here / "lab", 4)
    assert main(["batch", str(shop), "--json", "--table-only", "--jobs", "1"]) == 0
    families = strict(capsys.readouterr().out)["families"]
    assert [(one["factor"], one["pairs"]) for one in families] == [("V", 4), ("f", 4), ("t", 4)]


def printed(what):
    console = Console(width=100)
    with console.capture() as captured:
        console.print(what)
    return captured.get()


def test_files_that_cannot_be_read_are_named_though_their_reasons_do_not(here):
    unreadable = {f"sub/{i}.csv": "no table at all." for i in range(11)} | {"b.csv": "b.csv: x."}
    plan = Plan("lab", "files", (), 0, (), unreadable, (), Reading())
    said = printed(terminal.source_block(plan))
    assert said.count("no table at all.") == 8
    assert "sub/0.csv: no table at all." in said
    assert "and 4 more: sub/8.csv, sub/9.csv, sub/10.csv, b.csv" in said


def test_blocks_that_are_held_are_distinguished_from_pairs_that_are_streamed():
    rows = {"a": 9, "b": 8, "c": 5000, "d": 2000}
    blocks = [Block((Pair(tool, "x"),), (), n, streamed=n > 999) for tool, n in rows.items()]
    plan = Plan("lab", "parquet", tuple(blocks), 7017, (), {}, (), Reading())
    reported = " ".join(printed(terminal.source_block(plan)).split())
    assert "in blocks 2, of at most 9 rows in memory at a time; 2 pairs of up to 5000 rows" in reported
    assert "of up to 5000 rows, streamed chunk by" in reported
    reported = printed(terminal.source_block(replace(plan, blocks=plan.blocks[2:3])))
    assert "1 pair of 5000 rows, streamed chunk by chunk" in reported


def test_a_single_pair_is_reported_by_its_values_and_intervals(tmp_path):
    """Quarters of one pair would say nothing; the interval is that of the table."""
    made = batch.run(datasets.bundled("gc435_709m40"), tmp_path / "out", files=False)
    reported = printed(terminal.laws_block(made))
    assert "95 % by edge" in reported
    assert "quarter" not in reported
    law = made.results.iloc[0]
    row = next(line.split() for line in reported.splitlines() if line.split()[:2] == ["V", "exponent"])
    assert [float(row[i]) for i in (2, 3, 5)] == pytest.approx(
        [law[f"{n}_V"] for n in ("params", "low", "high")], rel=1e-3
    )


# --- the same numbers, whatever it runs on


@pytest.fixture
def small(monkeypatch):
    """A pair of a block."""
    monkeypatch.setattr(run_batch, "MOST_PAIRS", {False: 2000, True: 1})


OPTIONS = ("--draws", "1000", "--no-site", "--unit", "V=m/min")


@pytest.fixture(scope="module")
def one(shop):
    """The numbers of the shop, from this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_batch, "MOST_PAIRS", {False: 2000, True: 1})
        assert main(["batch", str(shop), *OPTIONS, "--jobs", "1", "--out", str(shop.parent / "one")]) == 0
    return numbers(shop.parent / "one")


@pytest.mark.parametrize("engine", [("--jobs", "2"), ("--jobs=2", "--dask", "local")], ids=["processes", "Dask"])
def test_files_do_not_depend_on_the_engine_nor_on_where_they_are_written(engine, one, shop, small, here, capsys):
    out = here / "deep" / "two"
    assert main(["batch", f"{shop}/", *OPTIONS, *engine, f"--out={out}", "--force"]) == 0
    assert ("Dask" in capsys.readouterr().out) == ("--dask" in engine)
    assert numbers(out) == one
    provenance = parameters.read(out / "pairs" / "T0_C45" / "params.json").provenance
    words = ["fitmodels", "batch", f"{shop}/", *OPTIONS, *engine, f"--out={out}", "--force"]
    assert provenance.command == shlex.join(words)


def test_a_parameter_file_is_the_one_of_the_single_command(here, capsys):
    path = here / "t7.csv"
    simulated(7).to_csv(path, index=False)
    assert main([str(path), "--draws", "1000", "--out", "single"]) == 0
    assert main(["batch", str(path), *FAST, "--no-site"]) == 0
    single = json.loads((here / "single" / "T7_C45" / "params.json").read_bytes())
    made = json.loads((here / "t7-batch" / "pairs" / "T7_C45" / "params.json").read_bytes())
    assert single["posterior"].pop("draws_file") == "draws.npz"
    assert made["posterior"].pop("draws_file", None) is None
    for gone in ("command", "options"):
        single["provenance"].pop(gone), made["provenance"].pop(gone)
    assert single["posterior"].pop("draws_sha256")
    assert made["posterior"].pop("draws_sha256", None) is None
    assert single.pop("content_sha256") != made.pop("content_sha256")
    assert made == single
    assert main(["check", "t7-batch/pairs/T7_C45/params.json"]) == 0


def test_draws_that_are_kept_stand_the_check(here, capsys):
    simulated(7).to_csv(here / "t7.csv", index=False)
    assert main(["batch", "t7.csv", *FAST, "--keep-draws", "--no-site"]) == 0
    assert (here / "t7-batch" / "pairs" / "T7_C45" / "draws.npz").is_file()
    assert main(["check", "t7-batch/pairs/T7_C45/params.json"]) == 0


# --- exit codes and errors


def test_a_card_with_something_missing_is_five_and_a_whole_one_makes_the_site(shop, here, capsys):
    card = here / "card.toml"
    card.write_text(CARD.replace('license = "CC-BY-4.0"\n', ""))
    assert main(["batch", str(shop), *FAST, "--card", "card.toml"]) == 5
    said = capsys.readouterr().out
    assert "missing: license; fill in lab-batch/pairs/card.toml" in said
    assert "no pair is refitted." in said
    assert "ISO" not in said
    card.write_text(CARD)
    assert main(["batch", str(shop), *FAST, "--card", "card.toml", "--title", "Our shop"]) == 0
    said = capsys.readouterr().out
    assert "site/)" in said.replace("\n", " ")
    assert "Kept 2 pairs" in said
    assert "No site" not in said
    assert "Our shop" in (here / "lab-batch" / "site" / "index.html").read_text("utf-8")


def test_no_pair_with_a_law_is_four(here, capsys):
    simulated(1).head(1).to_csv(here / "few.csv", index=False)
    assert main(["batch", "few.csv", "--jobs", "1"]) == 4
    said = capsys.readouterr().out
    assert "Laws of 0 of 1 pair\n\n" in said
    assert "1 of 1 pair needs attention" in said
    assert "no law" in said


def written(name, content=b""):
    def make(folder):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)

    return make


def no_rows(folder):
    pq.write_table(pa.Table.from_pandas(simulated(1).head(0), preserve_index=False), folder / "zero.parquet")


ODD = {
    "nothing there": (["nowhere"], 3, "nowhere does not exist", None),
    "no name": ([""], 2, "name of the source is empty", None),
    "an empty folder": (["empty"], 3, "holds no lab file", lambda folder: (folder / "empty").mkdir()),
    "papers": (["papers"], 3, "there are a.pdf: name the folder", written("papers/a.pdf")),
    "no rows": (["zero.parquet"], 3, "zero.parquet holds no rows", no_rows),
    "no Parquet": (["junk.parquet"], 3, "junk.parquet: cannot be read", written("junk.parquet", b"junk")),
    "no process": (["SHOP", "--jobs", "0"], 2, "0 is not a number of processes", None),
    "no scheduler": (["SHOP", "--dask", "127.0.0.1:1"], 2, "no Dask scheduler answers at 127.0.0.1:1", None),
    "no address": (["SHOP", "--dask", "nonsense"], 2, "not an address of a Dask scheduler", None),
    "no pairs": (["SHOP", "--pairs", "p.csv"], 3, "neither tool nor work is a column", written("p.csv", b"a,b\n1,2\n")),
    "other pairs": (
        ["SHOP", "--pairs", "p.csv"], 2, "none of which the source holds", written("p.csv", b"tool,iso513\nzz,P20\n"),
    ),
    "no table": (["SHOP", "--pairs", "none.csv"], 3, "none.csv does not exist", None),
    "out is a file": (["SHOP", "--out", "file"], 2, "file is a file", written("file")),
    "out is another's": (["SHOP", "--out", "out"], 2, "which batch did not write", written("out/thesis.docx")),
    "out cannot be made": (["SHOP", "--out", "file/out"], 2, "cannot be made", written("file")),
    "no TOML": (["SHOP", "--priors", "p.toml"], 3, "p.toml: is not TOML", written("p.toml", b"not [ toml")),
    "no card": (["SHOP", "--card", "c.toml"], 3, "c.toml: is not TOML", written("c.toml", b"not [ toml")),
    "card without files": (["SHOP", "--card", "c", "--table-only"], 2, "--card has no effect", None),
    "few draws": (["SHOP", "--draws", "3"], 2, "draws 3: give a whole number from 1000", None),
    "no criterion": (["SHOP", "--criterion", "0"], 2, "criterion 0", None),
    "no such group": (["SHOP", "--group", "colour"], 2, "no file has a column 'colour'", None),
    "a factor as a group": (["SHOP", "--group", "V"], 2, "which is the cutting speed", None),
    "no source": ([], 2, "SOURCE", None),
}  # fmt: skip


@pytest.mark.parametrize("case", ODD)
def test_an_error_is_one_sentence_and_leaves_nothing(case, shop, here, capsys):
    words, code, said, make = ODD[case]
    if make is not None:
        make(here)
    before = sorted(here.rglob("*"))
    alone = [] if {"--jobs", "--dask"} & set(words) else ["--jobs", "1"]
    assert main(["batch", *(str(shop) if word == "SHOP" else word for word in words), *alone]) == code
    reported = capsys.readouterr()
    assert said in reported.err
    assert len([line for line in reported.err.splitlines() if line.startswith("fitmodels")]) == 1
    assert "Traceback" not in reported.err
    assert reported.out == ""
    assert sorted(here.rglob("*")) == before


def test_another_source_in_the_same_folder_is_refused(shop, here, capsys):
    simulated(3).to_csv(here / "t3.csv", index=False)
    table = ("--table-only", "--jobs", "1", "--out", "out")
    assert main(["batch", str(shop), *table]) == 0
    assert main(["batch", "t3.csv", *table]) == 2
    assert "holds a batch of lab, not of t3.csv; replace it with --force" in capsys.readouterr().err
    assert main(["batch", "t3.csv", *table, "--force"]) == 0
    assert "1 pair" in capsys.readouterr().out


def test_a_package_that_is_missing_is_one_sentence(shop, here):
    pq.write_table(pa.Table.from_pandas(simulated(1), preserve_index=False), here / "one.parquet")
    code = (
        "import sys\n"
        "from fitmodels.cli import main\n"
        "for gone, words in (('pyarrow', ['one.parquet']), ('joblib', [sys.argv[1], '--jobs', '2']),"
        " ('distributed', [sys.argv[1], '--dask', 'local'])):\n"
        "    sys.modules[gone] = None\n"
        "    if gone == 'joblib': sys.modules['joblib.externals.loky'] = None\n"
        "    print(gone, main(['batch', *words, '--table-only']), flush=True)\n"
        "print(main(['batch', sys.argv[1], '--table-only', '--jobs', '1', '--json']))\n"
    )
    run = program(code, shop)
    out, err = run.communicate(timeout=120)
    assert out.splitlines()[:3] == ["pyarrow 2", "joblib 2", "distributed 2"]
    assert out.splitlines()[-1] == "0"  # lab files in one process need none of them
    said = [line for line in err.splitlines() if line.startswith("fitmodels: ")]
    assert [line.split()[1] for line in said] == ["pyarrow", "joblib", "dask"]
    assert ["'fitmodels[batch]'" in line for line in said] == [True, True, False]
    assert "Traceback" not in err


# --- Ctrl-C


PAIRS = 8
SLOW = (  # a third of a second a block
    "import signal, sys, time\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # whoever runs tests in the background ignores it
    "from fitmodels.batch import run_batch\n"
    "from fitmodels.cli import entry\n"
    "real = run_batch.record\n"
    "run_batch.record = lambda *given: (real(*given), time.sleep(0.3))\n"
    "run_batch.MOST_PAIRS[True] = 1\n"
    "sys.argv[0] = 'fitmodels'\n"
    "sys.exit(entry())\n"
)


def left(group):
    """Processes of a group that are still there."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@needs_signals
@pytest.mark.parametrize("jobs", [1, 2])
def test_after_ctrl_c_the_same_command_goes_on(jobs, here, capsys, small):
    frame = pd.concat([simulated(i) for i in range(PAIRS)], ignore_index=True)
    pq.write_table(pa.Table.from_pandas(frame, preserve_index=False), here / "shop.parquet")
    words = ["batch", "shop.parquet", "--draws", "1000", "--no-site"]
    run = program(SLOW, *words, "--jobs", jobs, start_new_session=True)
    records = here / "shop-batch" / ".batch" / "blocks"
    until = time.monotonic() + 60
    while len(list(records.glob("*.json"))) < 2 and run.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does
    out, err = run.communicate(timeout=60)
    said = "fitmodels: interrupted; finished pairs are kept, and the same command continues from there."
    assert (run.returncode, out) == (130, "")
    assert [line for line in err.splitlines() if not line.startswith(("fitting", "reading"))] == [said]
    until = time.monotonic() + 10
    while left(run.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left(run.pid)
    whole = len([path for path in records.glob("*.json") if json.loads(path.read_bytes())["outcome"] is not None])
    assert main([*words, "--json", "--jobs", "1"]) == 0
    report = strict(capsys.readouterr().out)
    assert (report["kept"], report["fitted"], report["pairs_with_a_law"]) == (whole, PAIRS - whole, PAIRS)
    assert 1 <= whole < PAIRS


@needs_signals
def test_with_force_the_same_command_would_begin_again(shop, capsys, monkeypatch):
    def interrupted(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(run_batch, "fit_blocks", interrupted)
    assert main(["batch", str(shop), "--force", "--jobs", "1"]) == 130
    assert "the same command without --force continues from there." in capsys.readouterr().err


# --- words


def test_only_powers_have_exponents(here, capsys):
    assert main(["batch", str(datasets.bundled("surf_table1")), "--table-only", "--jobs", "1"]) == 0
    said = capsys.readouterr().out
    assert "exponential, " in said
    labels = [line.split()[0:2] for line in said.splitlines() if line.startswith("  ")]
    assert [label[0] for label in labels if label[0] in ("a", "b")] == ["a", "b"]
    assert "a exponent" not in said


def test_a_part_that_breaks_while_it_is_fitted_is_reported_by_its_name(here, capsys):
    for i in range(2):
        written(f"set/{i}.parquet")(here)
        frame = pa.Table.from_pandas(simulated(i), preserve_index=False)
        pq.write_table(frame, here / "set" / f"{i}.parquet", compression="zstd")
    path = here / "set" / "1.parquet"
    of = pq.read_metadata(path).row_group(0).column(frame.column_names.index("VB"))
    data = bytearray(path.read_bytes())
    data[of.data_page_offset : of.data_page_offset + 100] = b"\x5a" * 100
    path.write_bytes(data)
    assert main(["batch", "set", "--table-only", "--jobs", "1"]) == 3
    said = capsys.readouterr().out
    assert "Not readable during the fit\n  1.parquet: cannot be read" in said
    assert "T1 on C45" in said
    assert main(["batch", "set", "--table-only", "--jobs", "1", "--json"]) == 3
    assert list(strict(capsys.readouterr().out)["unreadable"]) == ["1.parquet"]


def test_a_tool_life_that_must_not_be_used_needs_attention(tmp_path):
    """Its law has reservations only; attention.csv, the index of the site and the check name the life."""
    shop = Path(__file__).parents[1] / "docs" / "examples" / "shop"
    (tmp_path / "shop").mkdir()
    shutil.copy(shop / "GC2025.csv", tmp_path / "shop")
    out = tmp_path / "out"
    assert main(["batch", str(tmp_path / "shop"), "--out", str(out), "--jobs", "1", "-q"]) in (0, 5)
    found = pd.read_csv(out / "attention.csv")
    barred = found[found["kind"] == "do not use for control"]
    assert barred["work"].tolist() == ["X5CrNi18-10"]
    assert barred["words"].iloc[0].startswith("T (tool life): ")
    pf = parameters.read(out / "pairs" / "GC2025_X5CrNi18-10" / "params.json")
    entry = card_entry(compose(pf), pf, {})
    assert (entry.verdict, entry.judged) == ("do not use for control", "T (tool life)")
    assert '<span class="fine">T (tool life)</span>' in index_page([entry], "Cards")
