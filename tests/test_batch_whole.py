"""A whole batch: the same numbers wherever it runs, nothing fitted twice, all results written."""

import dataclasses
import re
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fitmodels import batch, datasets, parameters
from fitmodels.batch import exponent_figures as draw
from fitmodels.batch import run_batch
from fitmodels.batch.engine import Run
from fitmodels.batch.engine.joblib_processes import Processes
from fitmodels.batch.tables import csv_bytes
from fitmodels.batch.terminal import laws_block
from fitmodels.core.errors import DataError, UsageError
from fitmodels.core.progress import Meter
from fitmodels.pipeline import FitOptions
from rich.console import Group

WEAR = datasets.SimulatedLaw("VB", "mm", 0.009, {"V": 0.52, "f": 0.15, "t": 0.25}, 0.08, 0.07)
PLAN = datasets.central_composite({"V": (72, 117), "f": (0.1, 0.3)}, seed=1)
FILES = FitOptions(draws=1000)
PAIRS = 3
CARD = """license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "none, simulated"
setup = "none, simulated"
no_sensors = "simulated"
"""


def simulated(i):
    frame = datasets.simulate(PLAN, [WEAR], seed=i, criterion=None)
    about = {"tool": f"T{i}", "work": "C45" if i % 2 else "GG25", "grade": "coarse" if i % 2 else "fine", "form": "bar"}
    return frame.assign(**about, edge=frame["edge"].astype(str))


def parquet(path, pairs=PAIRS, rows=1000, change=lambda frame: frame):
    """A Parquet file of simulated pairs, with so many rows in a group."""
    path.parent.mkdir(parents=True, exist_ok=True)
    frame = pd.concat([change(simulated(i)) for i in range(pairs)], ignore_index=True)
    pq.write_table(pa.Table.from_pandas(frame, preserve_index=False), path, row_group_size=rows)
    return path


def lab_files(folder, pairs=3):
    """A folder with a file a pair."""
    folder.mkdir(parents=True)
    for i in range(pairs):
        simulated(i).drop(columns=["grade", "form"]).to_csv(folder / f"t{i}.csv", index=False)
    return folder


def numbers(out):
    """All that must not depend on where and how it ran: the tables and the parameter files, to the byte."""
    found = {path.name: path.read_bytes() for path in out.glob("*.csv")}
    return found | {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.glob("pairs/*/params.json"))}


@pytest.fixture
def pictures():
    """Draw them: elsewhere most of the time would go there."""


@pytest.fixture(autouse=True)
def small_and_quick(request, monkeypatch):
    """Two pairs of a block, so that few pairs make several, and no pictures."""
    monkeypatch.setattr(run_batch, "MOST_PAIRS", {False: 2, True: 2})
    if "pictures" not in request.fixturenames:
        monkeypatch.setattr(draw, "write_figures", lambda *given: [])


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    return parquet(tmp_path_factory.mktemp("shop") / "shop.parquet")


@pytest.fixture(scope="module")
def whole(shop):
    """An uninterrupted batch of it, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_batch, "MOST_PAIRS", {False: 2, True: 2})
        return batch.run(shop, shop.parent / "whole", options=FILES, site=False)


@pytest.fixture
def fits(monkeypatch):
    """Pairs that are fitted, as they are."""
    seen = []

    def counted(block, plan, options, fit=run_batch.fit_block):
        seen.extend(pair.tool for pair in block.pairs)
        return fit(block, plan, options)

    monkeypatch.setattr(run_batch, "fit_block", counted)
    return seen


# --- the same numbers


def test_a_batch_reports_its_results(whole, shop):
    assert [len(block.pairs) for block in whole.plan.blocks] == [2, 1]
    assert (whole.pairs, whole.with_law, whole.effort.fitted, whole.effort.kept) == (3, 3, 3, 0)
    assert whole.results["tool"].tolist() == [f"T{i}" for i in range(PAIRS)]
    assert whole.units["VB"] == "mm"
    assert whole.effort.memory > 10e6
    assert whole.effort.memory_here > 10e6
    assert whole.changed
    assert all((whole.out / name).exists() for name in whole.written)
    assert "shop.parquet: laws of 3 of 3 pairs" in repr(whole).replace("\n", " ")


def test_the_table_on_disk_is_the_table_in_memory(whole):
    assert (whole.out / "results.csv").read_bytes() == csv_bytes(whole.results)


def test_the_true_exponents_are_found(whole):
    for factor, true in WEAR.exponents.items():
        off = (whole.results[f"params_{factor}"] - true) / whole.results[f"bse_{factor}"]
        assert off.abs().max() < 4
        assert off.abs().max() > 0


@pytest.mark.parametrize("files", [False, True], ids=["the table alone", "with files"])
def test_what_failed_by_a_defect_is_fitted_anew(shop, tmp_path, fits, monkeypatch, files):
    """It may pass, as a lack of file handles does, or be mended; what the data are to blame for is not tried again."""
    out, arguments = tmp_path / "out", {"options": FILES, "files": files, "site": False}
    monkeypatch.setattr(run_batch, "MOST_PAIRS", {False: 1, True: 1})
    with monkeypatch.context() as patch:
        where = "fitmodels.batch.fitting." + ("pair_file" if files else "pair_laws")
        name = "fit_pair" if files else "table_of_many"
        real, calls = getattr(sys.modules[where], name), iter([1, 0, 1])

        def now_and_then(*given, **more):
            if not next(calls, 1):
                raise OSError(24, "Too many open files")
            return real(*given, **more)

        patch.setattr(sys.modules[where], name, now_and_then)
        made = batch.run(shop, out, **arguments)
    assert made.attention["words"].str.contains("Too many open files").any()
    fits.clear()
    again = batch.run(shop, out, **arguments)
    assert fits == ["T1"]
    assert not again.attention["words"].str.contains("internal error").any()
    assert (again.results["reason"] == "").all()
    fits.clear()
    assert not batch.run(shop, out, **arguments).changed
    assert fits == []


class Backwards(Run):
    """Does the tasks in the other order."""

    def __call__(self, work, tasks):
        for position, task in reversed(list(enumerate(tasks))):
            yield position, work(task)

    def describe(self):
        return "this process, backwards"


def test_numbers_do_not_depend_on_the_order_in_which_blocks_are_done(whole, shop, tmp_path, monkeypatch):
    monkeypatch.setattr(run_batch, "engine", contextmanager(lambda *given: iter([Backwards()])))
    made = batch.run(shop, tmp_path / "out", options=FILES, site=False)
    assert made.effort.fitted == PAIRS
    assert numbers(made.out) == numbers(whole.out)


@pytest.mark.parametrize("rows", [1, 50], ids=["a row", "50 rows"])
def test_numbers_do_not_depend_on_how_the_rows_are_grouped_in_the_file(rows, whole, tmp_path):
    if rows == 1:
        made = batch.run(parquet(tmp_path / "shop.parquet", 1, rows), tmp_path / "out", files=False)
        one = whole.results.head(1)
        shared = [name for name in made.results if name in one and name != "verdict"]
        pd.testing.assert_frame_equal(made.results[shared], one[shared], check_dtype=False)
        return
    made = batch.run(parquet(tmp_path / "shop.parquet", rows=rows), tmp_path / "out", options=FILES, site=False)
    assert numbers(made.out) == numbers(whole.out)


def test_the_table_alone_has_the_laws_of_the_table_with_files(whole, shop, tmp_path):
    made = batch.run(shop, tmp_path / "out", files=False)
    shared = [name for name in whole.results if name in made.results and name != "verdict"]
    pd.testing.assert_frame_equal(made.results[shared], whole.results[shared])
    assert set(made.results["verdict"]) == {"not judged"}  # no checks without files
    assert set(whole.results["verdict"]) <= {"usable inside the tested region", "usable with reservations"}
    assert {name for name in whole.results if name not in shared} > {"posterior_V", "posterior_sd_V"}
    assert not (made.out / "pairs").exists()
    assert made.site is None


# --- interrupted, and on


class Stopped(Meter):
    """Ctrl-C once so many pairs are done."""

    def __init__(self, after):
        super().__init__(0, "pairs")
        self.after = after

    def advance(self, n, words=""):
        Meter.advance(self, n, words)
        if self.done >= self.after:
            raise KeyboardInterrupt


def test_an_interrupted_batch_goes_on_without_fitting_anything_twice(whole, shop, tmp_path, fits):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        batch.run(shop, out, options=FILES, site=False, meter=Stopped(2))
    assert not (out / "results.csv").exists()
    assert fits == ["T0", "T1"]
    fits.clear()
    made = batch.run(shop, out, options=FILES, site=False)
    assert fits == ["T2"]
    assert (made.effort.fitted, made.effort.kept) == (1, 2)
    assert numbers(out) == numbers(whole.out)


def test_what_is_done_is_not_done_again_nor_written_again(shop, tmp_path, fits, pictures):
    out = tmp_path / "out"
    batch.run(shop, out, files=False)
    assert {path.name for path in (out / "figures").iterdir()} == {f"exponents_VB_{of}.svg" for of in "Vft"}
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file() and ".batch" not in path.parts}
    fits.clear()
    again = batch.run(shop, out, files=False)
    assert fits == []
    assert not again.changed
    assert {path: path.stat().st_mtime_ns for path in before} == before
    (out / "figures" / "exponents_VB_V.svg").unlink()
    batch.run(shop, out, files=False)
    assert (out / "figures" / "exponents_VB_V.svg").exists()
    assert batch.run(shop, out, files=False, options=FitOptions(error="additive")).effort.fitted == PAIRS


def test_a_changed_pair_is_fitted_again_with_those_of_its_file(tmp_path, fits):
    folder = lab_files(tmp_path / "lab")
    batch.run(folder, tmp_path / "out", files=False)
    path = folder / "t2.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")
    fits.clear()
    made = batch.run(folder, tmp_path / "out", files=False)
    assert fits == ["T2"]  # alone in its block
    assert made.changed


def test_force_fits_all_again_and_leaves_what_the_user_wrote(tmp_path, fits):
    folder, out = lab_files(tmp_path / "lab", 2), tmp_path / "out"
    batch.run(folder, out, options=FILES)
    asked = out / "pairs" / "card.toml"
    assert 'license = ""' in asked.read_text("utf-8")
    asked.write_text(CARD, "utf-8")
    (out / "notes.txt").write_text("mine")
    fits.clear()
    made = batch.run(folder, out, options=FILES, force=True)
    assert sorted(fits) == ["T0", "T1"]
    assert made.effort.kept == 0
    assert asked.read_text("utf-8") == CARD
    assert (out / "notes.txt").read_text() == "mine"


# --- a batch that comes to nothing


@pytest.mark.parametrize(
    ("more", "error", "words"),
    [
        ({"source": "nowhere"}, DataError, "nowhere does not exist"),
        ({"source": ""}, UsageError, "name of the source is empty"),
        ({"card": "nowhere.toml"}, UsageError, "no such file"),
        ({"jobs": 0}, UsageError, "1 or more"),
        ({"groups": ("colour",)}, UsageError, "'colour'"),
    ],
    ids=str,
)
def test_what_cannot_be_done_is_refused_before_anything_is_there(more, error, words, shop, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=re.escape(words)):
        batch.run(**{"source": shop, "out": tmp_path / "out"} | more)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_before_stays_where_a_batch_is_refused(shop, tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(UsageError):
        batch.run(shop, tmp_path / "out", groups=("colour",))
    assert (tmp_path / "out").is_dir()


def test_a_card_that_is_none_is_refused_before_anything_is_fitted(shop, tmp_path, fits):
    card = tmp_path / "card.toml"
    for text, words in (("not [ toml", "is not TOML"), ('licence = "MIT"', "did you mean license")):
        card.write_text(text)
        with pytest.raises(DataError, match=words):
            batch.run(shop, tmp_path / "out", options=FILES, card=card)
    assert fits == []


def test_the_folder_of_another_source_is_refused(shop, tmp_path):
    batch.run(shop, tmp_path / "out", files=False)
    other = parquet(tmp_path / "other.parquet", 1)
    with pytest.raises(UsageError, match=r"holds a batch of shop\.parquet, not of other\.parquet; replace it with --f"):
        batch.run(other, tmp_path / "out", files=False)
    assert batch.run(other, tmp_path / "out", files=False, force=True).pairs == 1


@pytest.mark.parametrize("out", ["x", "lab-batch", "deep/er"])
def test_output_within_the_source_is_not_read(out, tmp_path, monkeypatch):
    folder = lab_files(tmp_path / "lab", 2)
    monkeypatch.chdir(folder)
    first = batch.run(".", out, options=FILES)
    again = batch.run(".", out, options=FILES)
    assert (first.pairs, again.pairs) == (2, 2)
    assert (again.effort.fitted, again.changed) == (0, False)
    assert any("skipped" in words for words in again.plan.assumed)


# --- what is odd is reported


def test_odd_pairs_and_files_are_reported_and_stop_nothing(tmp_path):
    folder = lab_files(tmp_path / "lab", 2)
    lines = (folder / "t1.csv").read_text().splitlines()
    (folder / "few.csv").write_text("\n".join([lines[0], *(line.replace("T1", "FEW") for line in lines[1:2])]))
    (folder / "junk.csv").write_text("this is no table\nat all\n")
    made = batch.run(folder, tmp_path / "out", options=FILES, site=False)
    assert list(made.unreadable) == ["junk.csv"]
    assert (made.pairs, made.with_law) == (3, 2)
    row = made.results.set_index("tool").loc["FEW"]
    assert "1 usable row" in row["reason"]
    assert np.isnan(row["params_V"])
    reported = made.attention.set_index("tool").loc["FEW"]
    assert reported["kind"] == "no law"
    assert "1 usable row" in reported["words"]
    assert not list(made.out.glob("pairs/FEW*"))
    assert made.warnings
    assert made.warnings[0].startswith("Part of the source")


def test_a_corrupt_partition_costs_the_pairs_that_stand_in_it_and_no_others(tmp_path):
    for i in range(3):
        pq.write_table(
            pa.Table.from_pandas(simulated(i), preserve_index=False), tmp_path / f"part-{i}.parquet", compression="zstd"
        )
    folder = tmp_path / "set"
    folder.mkdir()
    for i in range(3):
        (tmp_path / f"part-{i}.parquet").rename(folder / f"part-{i}.parquet")
    data = bytearray((folder / "part-1.parquet").read_bytes())
    start = pq.read_metadata(folder / "part-1.parquet").row_group(0).column(0).data_page_offset
    data[start : start + 200] = b"\x5a" * 200
    (folder / "part-1.parquet").write_bytes(data)
    (folder / "part-2.parquet").write_bytes(b"PAR1 no more PAR1")
    made = batch.run(folder, tmp_path / "out", files=False)
    assert set(made.unreadable) == {"part-1.parquet", "part-2.parquet"}
    laws = made.results.set_index("tool")
    assert laws.loc["T0", "reason"] == ""
    if "T1" in laws.index:  # the names of its pairs could still be read
        assert "part-1.parquet" in laws.loc["T1", "reason"]
    good = pq.write_table(pa.Table.from_pandas(simulated(1), preserve_index=False), folder / "part-1.parquet")
    assert good is None
    mended = batch.run(folder, tmp_path / "out", files=False)
    assert set(mended.unreadable) == {"part-2.parquet"}
    assert mended.results.set_index("tool").loc["T1", "reason"] == ""


def test_a_defect_in_a_pair_is_its_reason(shop, tmp_path, monkeypatch):
    from fitmodels.batch.fitting import pair_file

    def broken(runs, *given, real=pair_file.fit_pair, **more):
        if runs.tool == "T1":
            raise ZeroDivisionError("never to be met")
        return real(runs, *given, **more)

    monkeypatch.setattr(pair_file, "fit_pair", broken)
    made = batch.run(shop, tmp_path / "out", options=FILES, site=False)
    said = made.attention.set_index("tool").loc["T1"]
    assert said["kind"] == "no parameter file"
    assert said["words"] == "internal error of fitmodels, not of the data: ZeroDivisionError: never to be met."
    assert len(list(made.out.glob("pairs/*/params.json"))) == PAIRS - 1


# --- what pairs belong to


@pytest.fixture
def table(tmp_path):
    """Write a table of pairs."""

    def write(*lines):
        path = tmp_path / "pairs.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def test_a_table_of_pairs_reaches_results_and_files_and_refits_only_for_what_stands_in_them(
    shop, table, tmp_path, fits
):
    out = tmp_path / "out"

    def run(*lines):
        fits.clear()
        return batch.run(shop, out, options=FILES, site=False, pairs=table(*lines))

    made = run("work,iso513,coolant", "C45,P20,dry", "GG25,K20,dry", "brass,N,dry")
    assert len(fits) == PAIRS
    assert made.results["iso513"].tolist() == ["K20", "P20", "K20"]
    assert parameters.read(out / "pairs" / "T1_C45" / "params.json").identity.iso513 == "P20"
    assert made.warnings == ("The table of pairs names what the source does not hold: brass.",)
    assert {"all pairs", "dry"} == set(made.comparison.families["family"])  # the others are too few
    again = run("work,iso513,coolant", "C45,P20,emulsion", "GG25,K20,dry")
    assert fits == []
    assert again.changed
    assert again.results["coolant"].tolist() == ["dry", "emulsion", "dry"]
    assert again.warnings == ()
    run("tool,work,iso513", ",C45,P20", ",GG25,K20", "T2,GG25,K30")
    assert fits == ["T2"]  # alone in its block
    assert parameters.read(out / "pairs" / "T2_GG25" / "params.json").identity.iso513 == "K30"


def test_what_the_table_and_the_rows_say_otherwise_is_a_concern(shop, table, tmp_path):
    made = batch.run(
        shop, tmp_path / "out", groups=("grade", "form"), files=False, pairs=table("work,grade", "C45,fine")
    )
    said = made.attention[made.attention["kind"] == "group differs"]
    assert said["tool"].tolist() == ["T1"]
    assert said["words"].iloc[0].startswith("grade is 'coarse' by its own rows and 'fine' by the table of pairs")
    assert made.results["grade"].tolist() == ["fine", "coarse", "fine"]
    assert set(made.results["group form"]) == {"bar"}  # results have a column form of their own
    assert set(made.results["form"]) == {"power"}
    assert set(made.comparison.families["grouping"]) == {"all pairs", "form"}


def test_a_group_that_is_called_like_a_parameter_is_no_parameter(tmp_path):
    source = parquet(tmp_path / "shop.parquet", change=lambda frame: frame.rename(columns={"grade": "params_V"}))
    made = batch.run(source, tmp_path / "out", groups=("params_V",), files=False)
    assert made.results["group params_V"].tolist() == ["fine", "coarse", "fine"]
    assert isinstance(laws_block(made), Group)
    assert made.plot().get_xlabel()


def test_a_group_that_is_none_of_iso_513_is_reported(shop, table, tmp_path):
    made = batch.run(shop, tmp_path / "out", options=FILES, site=False, pairs=table("work,iso513", "C45,steel"))
    assert made.attention["kind"].tolist().count("no group of ISO 513") == 1
    assert parameters.read(made.out / "pairs" / "T1_C45" / "params.json").identity.iso513 is None


# --- draws, the site, pairs that are gone


def test_draws_are_kept_where_they_are_asked_for(tmp_path):
    source = parquet(tmp_path / "shop.parquet", 1)
    out = tmp_path / "out"
    batch.run(source, out, options=FILES, keep_draws=True, site=False)
    folder = out / "pairs" / "T0_GG25"
    assert {path.name for path in folder.iterdir()} == {"params.json", "draws.npz"}
    report = parameters.check(parameters.read(folder / "params.json"), folder)
    assert report.ok
    assert parameters.read(folder / "params.json").posterior.draws_file == "draws.npz"
    batch.run(source, out, options=FILES, site=False)
    assert {path.name for path in folder.iterdir()} == {"params.json"}


def test_the_site_is_made_once_and_again_after_a_change(tmp_path, table):
    folder, out = lab_files(tmp_path / "lab"), tmp_path / "out"
    pairs = table("work,iso513", "C45,P20", "GG25,K20")

    def run(**more):
        return batch.run(folder, out, options=FILES, pairs=pairs, **more)

    asked = run()
    assert {name for problem in asked.site.problems for name in problem.fields} >= {"license", "authors", "contact"}
    assert not (out / "site").exists()
    card = tmp_path / "card.toml"
    card.write_text(CARD)
    made = run(card=card)
    assert (made.site.ok, made.effort.fitted, made.changed, len(made.site.cards)) == (True, 0, True, 3)
    assert "site/" in made.written
    same = run()
    assert (same.site.unchanged, same.changed) == (True, False)
    (folder / "t1.csv").unlink()
    fewer = run(title="Our shop")
    assert not (out / "pairs" / "T1_C45").exists()
    assert len(fewer.site.cards) == 2
    index = (out / "site" / "index.html").read_text("utf-8")
    assert "Our shop" in index
    assert "T1" not in index
    assert not [path for path in (out / "site" / "cards").iterdir() if "t1" in path.name.casefold()]


def test_a_picture_needs_a_law(tmp_path, shop):
    made = batch.run(shop, tmp_path / "out", files=False)
    assert made.plot().get_xlabel().startswith("exponent of V in the law of VB")
    none = dataclasses.replace(made, results=made.results.assign(reason="none"))
    with pytest.raises(UsageError, match="no pair has a power law"):
        none.plot()


def test_a_picture_shows_a_factor_that_the_law_has(tmp_path, shop):
    made = batch.run(shop, tmp_path / "out", files=False)
    without = made.results.assign(params_V=np.nan, low_V=np.nan, high_V=np.nan)
    assert "exponent of f" in dataclasses.replace(made, results=without).plot().get_xlabel()


def test_nothing_heavy_is_imported_for_a_folder_of_files(tmp_path):
    """A batch of laboratory files in one process needs no engine, and its table no figures and no files."""
    folder = lab_files(tmp_path / "lab")
    code = (
        "import sys; from fitmodels import batch; "
        f"batch.run({str(folder)!r}, {str(tmp_path / 'out')!r}, files=False); "
        "heavy = {'joblib', 'dask', 'matplotlib', 'pydantic', 'jinja2'}; print([*heavy & {*sys.modules}])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_what_is_simulated_says_so_in_the_table_the_words_and_the_pictures(tmp_path, monkeypatch):
    banners = []
    monkeypatch.setattr(draw, "write_figures", lambda comparison, folder, banner, former: banners.append(banner) or [])
    note = "# simulated: no measurement\n"
    rows = "tool,work,edge,V,t,VB\n" + "".join(
        f"{tool},steel,{edge},{V},{t},{0.02 * V**0.5 * t**0.3 * (1 + 0.03 * ((edge * t) % 3)):.4f}\n"
        for tool in ("A", "B")
        for edge, V in enumerate((60, 80, 110, 150, 200, 70, 130))
        for t in (2, 5, 10)
    )
    source = tmp_path / "lab"
    source.mkdir()
    (source / "a.csv").write_text(note + rows.replace("A,", "S,").replace("B,", "S2,"))
    (source / "b.csv").write_text(rows)
    made = batch.run(source, tmp_path / "out", files=False)
    said = made.results.set_index("tool")["simulated"].astype(bool).to_dict()
    assert said == {"S": True, "S2": True, "A": False, "B": False}
    assert made.simulated == 2
    assert "2 simulated" in " ".join(repr(made).split())
    assert banners == ["2 of these pairs simulated, not measured"]


def test_processes_start_for_a_table_that_is_large_enough(tmp_path, monkeypatch):
    """They take longer to start than they save on a small one."""
    monkeypatch.setattr(run_batch, "MOST_PAIRS", {False: 1, True: 1})
    monkeypatch.setattr(Processes, "_submit", lambda *given: pytest.fail("a process was started"))
    source = parquet(tmp_path / "lab.parquet", pairs=2)
    made = batch.run(source, tmp_path / "out", files=False, jobs=2)
    assert len(made.plan.blocks) == 2
    assert len(made.results) == 2
    assert made.effort.where == "this process"
    monkeypatch.setattr(run_batch, "ENOUGH_ROWS", made.plan.rows)
    with pytest.raises(pytest.fail.Exception, match="a process was started"):
        batch.run(source, tmp_path / "other", files=False, jobs=2)


def without_speed(frame):
    return frame.assign(V=np.nan) if frame["tool"].iloc[0] == "T1" else frame


@pytest.mark.parametrize("kind", ["parquet", "csv", "stream"])
def test_a_table_names_pairs_whose_rows_hold_no_cutting_speed(kind, tmp_path, monkeypatch):
    """A column that is empty for one pair alone; a parameter file names it in its verdict."""
    source = parquet(tmp_path / "lab.parquet", change=without_speed)
    if kind == "csv":
        source = tmp_path / "lab.csv"
        pd.read_parquet(tmp_path / "lab.parquet").to_csv(source, index=False)
    if kind == "stream":
        monkeypatch.setattr(run_batch, "MOST_ROWS", 1)
    made = batch.run(source, tmp_path / "out", files=False)
    assert made.plan.blocks[0].streamed == (kind == "stream")
    named = made.attention[made.attention["kind"] == "condition not known"]
    assert named["tool"].tolist() == ["T1"]
    assert named["words"].iloc[0].startswith("Cutting speed V is not in the rows of this pair: exponents of the other")


def test_a_cutting_speed_that_is_given_is_known(tmp_path):
    source = parquet(tmp_path / "lab.parquet", change=lambda frame: frame.drop(columns="V"))
    kinds = [
        set(batch.run(source, tmp_path / name, files=False, options=options).attention["kind"])
        for name, options in (("unknown", None), ("given", FitOptions(constants={"V": 90.0})))
    ]
    assert ["condition not known" in of for of in kinds] == [True, False]


def test_a_unit_that_the_values_decide_is_among_the_assumptions(tmp_path):
    """The report of a Parquet source showed the conversion and named no reason."""
    source = parquet(
        tmp_path / "lab.parquet", change=lambda frame: frame.assign(V=frame["V"] / 60).rename(columns={"V": "vc"})
    )
    plan = batch.run(source, tmp_path / "out", files=False).plan
    assert any("V 1.2 to 1.95 has no unit and is taken as m/s" in sentence for sentence in plan.assumed)
