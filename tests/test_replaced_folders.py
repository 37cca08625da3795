"""A corrected reading replaces the folder of the former one, and nothing that somebody else put there."""

import errno
import json
import os
import shutil
from pathlib import Path

import pytest
from fitmodels import analyse, datasets, parameters
from fitmodels.cli import main
from fitmodels.core.errors import UsageError
from fitmodels.core.files import synchronised, write_whole
from fitmodels.core.folders import folder_state, put_folder, staged
from fitmodels.core.journal import only_writer, recover, write_together
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published

ROWS = [
    f"{grade},E{i},{V},{f},{t},{scale * 0.01 * V**0.5 * f**0.2 * t**0.3 * (1 + 0.01 * ((7 * i + 3 * t) % 5 - 2)):.5g}"
    for grade, scale in (("A", 1.0), ("B", 1.4))
    for i, (V, f) in enumerate([(80, 0.1), (80, 0.2), (160, 0.1), (160, 0.2), (120, 0.15)])
    for t in (2, 5, 9, 14)
]
WORDS = ("--tool", "T", "--work", "W", "--draws", "1000")


CORRECTED = (*WORDS, "--map", "f=feed", "--unit", "f=mm/rev", "--posterior-figures")


def data(folder):
    (folder / "a.csv").write_text("\n".join(["batch,edge,V [m/min],feed,t [min],VB [mm]", *ROWS]) + "\n")
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return data(tmp_path)


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A reading without the feed, to be corrected with ``--map f=feed --unit f=mm/rev``."""
    root = data(tmp_path_factory.mktemp("once"))
    words = [str(root / "a.csv"), *WORDS, "--map", "f=none", "--posterior-figures", "--out", str(root / "a-fit")]
    assert main(words) == 0
    return root


@pytest.fixture
def fitted(once, tmp_path, monkeypatch):
    """The folder of that reading, in a place of its own."""
    shutil.copytree(once, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "a-fit" / "T_W"


def files(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_corrected_reading_replaces_the_former_one(fitted, capsys):
    before = parameters.read(fitted / "params.json")
    capsys.readouterr()
    assert main(["a.csv", *CORRECTED]) == 0
    after = parameters.read(fitted / "params.json")
    assert "f" not in before.laws["VB"].coefficients
    assert "f" in after.laws["VB"].coefficients
    assert "in place of the former reading" in " ".join(capsys.readouterr().out.split())
    fresh = analyse("a.csv", tool="T", work="W", draws=1000, map={"f": "feed"}, units={"f": "mm/rev"},
                    posterior_figures=True)  # fmt: skip
    fresh.write("fresh")
    assert files(fitted).keys() == files(fitted.parents[1] / "fresh" / "T_W").keys()
    assert not [path for path in fitted.parent.iterdir() if path != fitted]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda folder: (folder / "notes.txt").write_text("mine"), "notes.txt is not a file of fitmodels"),
        (lambda folder: (folder / "figures" / "mine.png").write_bytes(b""), "mine.png is not a file of fitmodels"),
        (lambda folder: (folder / "README.md").write_text("# Mine"), "README.md was edited"),
        (lambda folder: (folder / "card.html").unlink(), "card.html was edited"),
        (lambda folder: main(["limits", str(folder / "params.json"), "VB=0.3mm"]), "sections were added"),
        (
            lambda folder: parameters.write(
                sealed(parameters.read(folder / "params.json"), later={"mine": 1}), folder / "params.json", force=True
            ),
            "sections were added",
        ),
        (lambda folder: (folder / "params.json").write_text("{"), "no parameter file that can be read"),
        (
            lambda folder: (folder.parents[1] / "a.csv").write_text(
                (folder.parents[1] / "a.csv").read_text().replace("A,E0,80,0.1,2", "A,E0,80,0.1,3")
            ),
            "before that file was changed",
        ),
    ],
)
def test_what_is_not_the_untouched_former_reading_needs_force(fitted, capsys, change, reason):
    change(fitted)
    before = files(fitted)
    capsys.readouterr()
    assert main(["a.csv", *CORRECTED]) == 2
    said = capsys.readouterr().err
    assert "exists and contains a different result or other files" in said
    assert reason in said
    assert "--force" in said
    assert files(fitted) == before


def test_another_fit_of_the_same_reading_needs_force(fitted, capsys):
    before = files(fitted)
    assert main(["a.csv", *CORRECTED, "--error", "additive"]) == 2
    assert "fitted with other options" in capsys.readouterr().err
    assert files(fitted) == before


def test_an_interrupted_replacement_leaves_the_former_result(fitted, monkeypatch):
    before = files(fitted)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("fitmodels.cards.figures.draw_posteriors", interrupted)
    assert main(["a.csv", *CORRECTED]) == 130
    assert files(fitted) == before
    monkeypatch.undo()
    monkeypatch.chdir(fitted.parents[1])
    rename = os.rename

    def fails(path, target):
        if path.name == "made":
            raise OSError(5, "input/output error")
        return rename(path, target)

    monkeypatch.setattr(os, "rename", fails)
    assert main(["a.csv", *CORRECTED]) == 2
    assert files(fitted) == before
    assert [path.name for path in fitted.parent.iterdir()] == ["T_W"]


def test_a_file_that_arrives_during_the_fit_is_kept(fitted):
    given = {"tool": "T", "work": "W", "draws": 1000, "map": {"f": "feed"}, "units": {"f": "mm/rev"}}
    analysis = analyse("a.csv", posterior_figures=True, **given)
    from fitmodels.pipeline.folders import pair_folders

    (folder,) = pair_folders([pair.runs for pair in analysis.pairs], "a-fit", analysis.options)
    (fitted / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"T_W: mine.txt was written by another process since this command began"):
        folder.write(analysis.pair, analysis.options)
    assert (fitted / "mine.txt").read_text() == "mine"


def test_pairs_of_a_former_reading_are_named_and_kept(here, capsys):
    assert main(["a.csv", "--map", "tool=batch", "--work", "W", "--draws", "1000"]) == 0
    capsys.readouterr()
    (here / "a-fit" / "other").mkdir()
    assert main(["a.csv", *WORDS]) == 0
    out = capsys.readouterr().out
    assert "Left in a-fit from a former reading of a.csv: 2 folders (A_W, B_W)." in out
    assert sorted(path.name for path in (here / "a-fit").iterdir()) == ["A_W", "B_W", "T_W", "other"]
    shutil.rmtree(here / "a-fit" / "A_W")
    shutil.rmtree(here / "a-fit" / "B_W")
    assert main(["a.csv", *WORDS]) == 0
    assert "Left in" not in capsys.readouterr().out


def test_a_result_of_another_file_of_this_name_is_not_left(here, capsys):
    assert main(["a.csv", *WORDS]) == 0
    assert main([str(datasets.bundled("ac2017_table1")), "--out", "a-fit", "--draws", "1000"]) == 0
    assert "Left in" not in capsys.readouterr().out


# --- every call that changes files fails, and every state that a killed process may leave --------------


def tree(folder, *, hidden):
    """Everything below a folder: contents, targets of links, None for folders; or the names of what is hidden."""
    each = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*"))}
    if hidden:
        return [name for name, path in each.items() if path.name.startswith(".")]
    shown = {name: path for name, path in each.items() if not any(part[0] == "." for part in Path(name).parts)}
    return {
        name: path.readlink() if path.is_symlink() else path.read_bytes() if path.is_file() else None
        for name, path in shown.items()
    }


def pictures(number):
    return {"params.json": b"%d" % number, "figures/a.png": b"picture %d" % number, f"only-{number}": b""}


def put(folder, number, *, current=False):
    """Write a folder whole."""
    if current:
        os.chdir(folder)
    former = folder_state(folder)
    with staged(folder) as made:
        (made / "figures").mkdir()
        for name, content in pictures(number).items():
            synchronised(made / name, content)
        put_folder(made, folder, expected=former, ours=lambda name: name in {**pictures(1), **pictures(2)})


def change(folder, number):
    """Write a file with its pictures, one of them new, one removed."""
    derived = {folder / "figures" / "a.png": b"%d" % number, folder / "figures" / f"{3 - number}.png": None}
    derived[folder / "new" / f"{number}.png"] = b""
    with only_writer(folder):
        write_together(folder / "params.json", b"%d" % number, derived, error=UsageError)


def first(folder):
    folder.mkdir()
    put(folder, 1)
    (folder / "mine").mkdir()
    (folder / "mine" / "notes.txt").write_text("mine")
    (folder / "mine" / "link").symlink_to("notes.txt")


WRITES = {
    "folder": (first, lambda folder: put(folder, 2)),
    "new folder": (lambda folder: None, lambda folder: put(folder, 2)),
    "current folder": (first, lambda folder: put(folder, 2, current=True)),
    "file with pictures": (first, lambda folder: change(folder, 2)),
    "file": (first, lambda folder: write_whole(folder / "params.json", "2")),
}


class Calls:
    """Counts the calls that change files; fails at one of them, or copies the folder after each."""

    def __init__(self, monkeypatch, fail_at=-1, code=0, after=lambda: None):
        self.count, self.fail_at, self.code, self.after = 0, fail_at, code, after
        self.inside = False
        for name in ("rename", "replace", "link", "mkdir", "unlink", "rmdir", "chmod", "fsync"):
            monkeypatch.setattr(os, name, self.hooked(getattr(os, name), skip=name == "fsync"))
        monkeypatch.setattr("fitmodels.core.files.synchronised", self.synchronised)
        monkeypatch.setattr("fitmodels.core.journal.synchronised", self.synchronised)

    def hooked(self, real, *, skip=False):
        def call(*words, **options):
            if self.inside:
                return real(*words, **options)
            self.step()
            found = None if skip else real(*words, **options)
            self.done()
            return found

        return call

    def synchronised(self, path, data):
        """A new file that is opened, half written, written, synchronised: each a call of its own."""
        self.step()
        path.touch(exist_ok=False)
        self.done()
        for part in (data[: len(data) // 2], data):
            self.step()
            path.write_bytes(part)
            self.done()

    def step(self):
        self.count += 1
        if self.count == self.fail_at:
            raise OSError(self.code, os.strerror(self.code))

    def done(self):
        self.inside = True
        self.after()
        self.inside = False


def end_process(folder):
    """Give what this process left hidden in a folder the number of a process that has ended."""
    ours, ended = f"-{os.getpid()}-", "-4194399-"  # beyond the largest number of Linux
    for path in sorted(folder.rglob(".*"), reverse=True):
        path.rename(path.with_name(path.name.replace(ours, ended)))
    if (journal := folder / "T_W" / ".fitmodels.journal").exists():
        data = json.loads(journal.read_text().replace(ours, ended))
        stage = journal.with_name(data["stage"])
        journal.write_text(json.dumps({**data, "inode": stage.stat().st_ino}))  # of the copy that a test made


def completed(folder, write, old, new):
    """The next reader finds the old state or the new one; the next writer leaves the new one and nothing else."""
    end_process(folder.parent)
    recover(folder / "params.json")
    assert tree(folder.parent, hidden=False) in (old, new)
    write(folder)
    assert tree(folder.parent, hidden=False) == new
    assert tree(folder.parent, hidden=True) == []


@pytest.fixture(params=WRITES)
def writing(request, tmp_path, monkeypatch):
    """A write, its folder in the old state, and both states; the folder is made again by ``again``."""
    make, write = WRITES[request.param]
    folder = tmp_path / "work" / "T_W"
    home = tmp_path / "old"

    def again():
        monkeypatch.chdir(tmp_path)
        shutil.rmtree(folder.parent, ignore_errors=True)
        shutil.copytree(home, folder.parent, symlinks=True)

    home.mkdir()
    make(home / "T_W")
    again()
    old = tree(folder.parent, hidden=False)
    write(folder)
    new = tree(folder.parent, hidden=False)
    assert old != new
    again()
    return folder, write, old, new, again


def test_a_write_of_which_any_call_fails_leaves_the_old_state_or_the_new_one(writing, monkeypatch):
    folder, write, old, new, again = writing
    at = 0
    while True:
        at += 1
        with monkeypatch.context() as patch:
            calls = Calls(patch, at, (errno.ENOSPC, errno.EIO, errno.EACCES)[at % 3])
            failed = False
            try:
                write(folder)
            except (OSError, UsageError):
                failed = True
        found = tree(folder.parent, hidden=False)
        assert found in (old, new) or (folder / ".fitmodels.journal").exists(), at
        assert failed or found == new, at
        completed(folder, write, old, new)
        if calls.count < at:
            break
        again()
    assert at > 5


def test_a_process_killed_after_any_call_leaves_what_the_next_command_restores(writing, tmp_path, monkeypatch):
    folder, write, old, new, _ = writing
    copies = []

    def copy():
        copies.append(tmp_path / f"{len(copies)}" / "T_W")
        shutil.copytree(folder.parent, copies[-1].parent, symlinks=True)

    with monkeypatch.context() as patch:
        Calls(patch, after=copy)
        write(folder)
    assert len(copies) > 4
    for each in copies:
        completed(each, write, old, new)


# --- what stood there when a command decided, and files of others -------------------------------------


def test_a_foreign_file_stays_the_same_file_also_in_subfolders_and_a_link_a_link(tmp_path):
    folder = tmp_path / "T_W"
    first(folder)
    (folder / "empty").mkdir()
    (folder / "mine").chmod(0o750)
    (folder / "dangling").symlink_to("nowhere")
    notes = folder / "mine" / "notes.txt"
    before = notes.stat()
    with notes.open("a") as held:
        put(folder, 2)
        held.write(" and more")
    assert os.path.samestat(before, notes.stat())
    assert notes.read_text() == "mine and more"
    assert (folder / "mine").stat().st_mode & 0o777 == 0o750
    assert (folder / "mine" / "link").readlink() == Path("notes.txt")
    assert (folder / "dangling").is_symlink()
    assert (folder / "empty").is_dir()
    assert not (folder / "only-1").exists()


def test_a_foreign_file_is_copied_where_there_are_no_hard_links(tmp_path, monkeypatch):
    def no_links(*_, **__):
        raise OSError(errno.EPERM, "operation not permitted")

    folder = tmp_path / "T_W"
    first(folder)
    before = tree(folder, hidden=False)
    monkeypatch.setattr(os, "link", no_links)
    put(folder, 2)
    assert {name: of for name, of in tree(folder, hidden=False).items() if name.startswith("mine")} == {
        name: of for name, of in before.items() if name.startswith("mine")
    }
    put(folder, 1)
    assert tree(folder, hidden=False) == before


@pytest.mark.parametrize("name", ["params.json", "mine/notes.txt", "mine/new.txt"])
def test_a_file_that_changes_between_the_renames_is_not_lost(name, tmp_path, monkeypatch):
    """An editor saves it while the folder stands aside."""
    folder, rename = tmp_path / "T_W", os.rename
    first(folder)

    def saves(source, target):
        rename(source, target)
        if Path(target).suffix == ".former":
            (Path(target) / "saved").write_text("edited")
            (Path(target) / "saved").replace(Path(target) / name)

    monkeypatch.setattr(os, "rename", saves)
    with pytest.raises(UsageError, match=f"{name} was (changed|written).*nothing was written. Run again"):
        put(folder, 2)
    assert (folder / name).read_text() == "edited"
    assert (folder / "only-1").exists()
    assert tree(tmp_path, hidden=True) == []


@pytest.mark.parametrize("there", ["nothing", "a folder"])
def test_of_two_writers_the_second_is_refused_and_nothing_is_lost(there, tmp_path):
    """Both decided on the same state: that of the folder, or that there is none."""
    folder = tmp_path / "T_W"
    if there == "a folder":
        first(folder)
    former = folder_state(folder)
    with staged(folder) as made:
        (made / "params.json").write_text("late")
        put(folder, 2)
        with pytest.raises(UsageError, match=r"T_W: .* was (written|removed|changed) by another process"):
            put_folder(made, folder, expected=former, ours=lambda name: not name.startswith("mine"))
    assert (folder / "params.json").read_bytes() == b"2"
    assert tree(tmp_path, hidden=True) == []


def test_a_folder_that_somebody_put_in_place_of_an_interrupted_one_does_not_cost_the_former_content(tmp_path, caplog):
    folder = tmp_path / "T_W"
    first(folder)
    stage = ".fitmodels-00000000-1-0123456789abcdef"
    (tmp_path / f"{stage}.tmp" / "made").mkdir(parents=True)
    former = folder.rename(tmp_path / f".T_W{stage}.former")
    folder.mkdir()
    put(folder, 2)
    assert (former / "params.json").read_bytes() == b"1"
    assert "Move one of the two elsewhere" in caplog.text
    shutil.rmtree(folder)
    caplog.clear()
    recover(folder / "params.json")
    assert "the former folder was restored" in caplog.text
    assert (folder / "params.json").read_bytes() == b"1"


def test_a_link_to_a_folder_stays_and_a_name_in_the_way_is_named(tmp_path):
    folder, link = tmp_path / "lab" / "T_W", tmp_path / "link"
    folder.parent.mkdir()
    first(folder)
    link.symlink_to(folder)
    put(link, 2)
    assert link.is_symlink()
    assert (folder / "params.json").read_bytes() == b"2"
    shutil.rmtree(folder / "figures")
    (folder / "figures").write_text("mine")
    with pytest.raises(UsageError, match="figures has the name of something that fitmodels writes"):
        put(folder, 1)
    assert (folder / "figures").read_text() == "mine"


@pytest.mark.parametrize(
    "journal",
    [
        {"moves": [[".fitmodels-0123456789abcdef.tmp/0", "../params.json"]], "removed": []},
        {"moves": [["../secret", "params.json"]], "removed": []},
        {"moves": [], "removed": ["out/secret"]},
        {"moves": [], "removed": ["/etc/hostname"]},
        {"moves": [[".fitmodels-0123456789abcdef.tmp/0"]], "removed": []},
        {"moves": [[".fitmodels-0123456789abcdef.tmp/0", "mine/notes.txt"]], "removed": [], "inode": 1},
        {"moves": [], "removed": ["mine/notes.txt"], "inode": 1},
        {"moves": 3},
        [],
    ],
)
def test_a_journal_in_a_received_folder_reaches_nothing_outside_of_it(journal, tmp_path):
    folder = tmp_path / "T_W"
    first(folder)
    (tmp_path / "secret").write_text("mine")
    (folder / "out").symlink_to(tmp_path)
    stage = folder / ".fitmodels-0123456789abcdef.tmp"
    stage.mkdir()
    (stage / "0").write_text("theirs")
    schema = {"schema": "fitmodels.journal/1", "stage": stage.name, "inode": stage.stat().st_ino}
    text = json.dumps({**schema, **journal} if isinstance(journal, dict) else journal)
    (folder / ".fitmodels.journal").write_text(text)
    before = tree(tmp_path, hidden=False)
    recover(folder / "params.json")
    with pytest.raises(UsageError, match=r"journal: is damaged, or was copied with its folder"):
        change(folder, 2)
    assert tree(tmp_path, hidden=False) == before


def test_reading_needs_no_recovery_that_cannot_be_written(tmp_path, monkeypatch):
    """A folder without write access and with a journal: what stands there is read."""

    def no_writing(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system")

    folder = tmp_path / "T_W"
    first(folder)
    parameters.write(parameters.read(parameters.write(published("AC-2016"), tmp_path / "a.json")), folder / "a.json")
    stage = folder / ".fitmodels-0123456789abcdef.tmp"
    stage.mkdir()
    made = {"schema": "fitmodels.journal/1", "stage": stage.name, "inode": stage.stat().st_ino}
    (folder / ".fitmodels.journal").write_text(json.dumps({**made, "moves": [], "removed": ["only-1"]}))
    for name in ("unlink", "replace", "rename", "mkdir"):
        monkeypatch.setattr(os, name, no_writing)
    assert parameters.read(folder / "a.json").laws
    monkeypatch.undo()
    assert parameters.read(folder / "a.json").laws
    assert not (folder / "only-1").exists()


def test_of_two_fits_into_one_new_folder_one_wins_and_the_other_says_so(here):
    """Both have checked that nothing is there before either has written."""
    from fitmodels.pipeline.folders import pair_folders

    analysis = analyse("a.csv", tool="T", work="W", draws=1000)
    both = [pair_folders([pair.runs for pair in analysis.pairs], "new", analysis.options)[0] for _ in range(2)]
    both[0].write(analysis.pair, analysis.options)
    before = files(here / "new")
    with pytest.raises(UsageError, match=r"new/T_W: README.md was written by another process since this command began"):
        both[1].write(analysis.pair, analysis.options)
    assert files(here / "new") == before
    assert tree(here / "new", hidden=True) == []
