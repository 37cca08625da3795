"""Several programs that change one parameter file: no update is lost, and a picture never shows other gains."""

import errno
import json
import os
import shlex
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from fitmodels import cards, datasets, parameters
from fitmodels.cli import COMMANDS, main
from fitmodels.cli.arguments import traced
from fitmodels.core import errors, journal
from fitmodels.core.errors import ParameterError
from fitmodels.core.files import locked_folder, temporary_name, write_whole
from fitmodels.core.journal import only_writer, write_together
from fitmodels.ident import Model
from fitmodels.parameters import read, write
from fitmodels.parameters.file import replace, sealed
from fitmodels.parameters.published import published
from scipy.signal import lfilter

UsageError = errors.UsageError
unix = pytest.mark.skipif(sys.platform == "win32", reason="no kill -9 there")


def started(program, *words):
    env = {"PYTHONPATH": str(Path(parameters.__file__).parents[2])}
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, words)], env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )


def gains(kp):
    return {"kp": float(kp), "ki": 1.0, "sample_time": 0.02}


@pytest.fixture
def file(tmp_path):
    model = Model(b=[0, 0.1, 0.08], a=[1, -0.8], nk=1, sample_time=0.02, unit_u="V", unit_y="A")
    pf = parameters.collect(tool="end mill", work="S45C", dynamics=model, pi=gains(1), simulated=True)
    return write(pf, tmp_path / "params.json")


# --- two programs -------------------------------------------------------------------------------------

ADDER = """
import sys
from fitmodels.core.errors import ParameterError
from fitmodels.parameters import read, write
from fitmodels.parameters.file import sealed
name, count, path = sys.argv[1], int(sys.argv[2]), sys.argv[3]
print("ready", flush=True)
sys.stdin.readline()  # all begin together
for number in range(count):
    while True:
        pf = read(path)
        try:
            write(sealed(pf, **{f"x-{name}-{number}": number}), path, replaces=pf)
            break
        except ParameterError as refused:
            assert "another program changed" in str(refused)
"""


def test_every_addition_of_three_processes_is_kept(file):
    """Each adds its own sections and begins again where it is refused; without the comparison most would be lost."""
    names, count = ("a", "b", "c"), 12
    with ExitStack() as stack:
        processes = [stack.enter_context(started(ADDER, name, count, file)) for name in names]
        assert {process.stdout.readline() for process in processes} == {b"ready\n"}
        for process in processes:
            process.stdin.close()
    assert [process.returncode for process in processes] == [0, 0, 0]
    held = json.loads(file.read_text())
    assert {name for name in held if name.startswith("x-")} == {f"x-{name}-{i}" for name in names for i in range(count)}
    assert parameters.check(read(file)).findings[0].passed
    assert {path.name for path in file.parent.iterdir()} == {"params.json"}


@pytest.fixture
def meanwhile(monkeypatch):
    """Another program adds a section to each file as soon as a command has read it."""
    real = parameters.read

    def changed(path):
        pf = real(path)
        write(sealed(pf, **{"x-other": "kept"}), path, force=True)
        return pf

    monkeypatch.setattr(parameters, "read", changed)


@pytest.mark.parametrize(
    ("paper", "command"),
    [
        ("CLM-2023", "settings params.json --worn 0.28 --force"),
        ("AC-2016", "limits params.json P=7kW --force"),
        ("CLM-2023", "tune params.json --settle 8 --nominal --force"),
    ],
)
def test_a_command_refuses_a_file_that_was_changed_since_it_read_it(
    paper, command, meanwhile, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    before = read(write(published(paper), "params.json"))
    assert main(command.split()) == 3
    error = capsys.readouterr().err
    assert error.startswith("fitmodels: params.json: another program changed the file since it was read (content ")
    assert error.endswith("so nothing was written. Run the command again: it starts from the changed file.\n")
    assert read("params.json") == sealed(before, **{"x-other": "kept"})


def test_ident_refuses_a_file_that_was_changed_and_keeps_its_picture(meanwhile, file, monkeypatch, capsys):
    monkeypatch.chdir(file.parent)
    picture = file.parent / "figures" / "pi.png"
    picture.parent.mkdir()
    picture.write_bytes(b"old")
    recorded(Path("run.csv"))
    words = ["ident", "run.csv", "--params", "params.json", "--rate", "50", "--orders", "1,1,1", "--force"]
    assert main(words) == 3
    assert "another program changed" in capsys.readouterr().err
    assert picture.exists()
    monkeypatch.undo()
    monkeypatch.chdir(file.parent)
    assert main(words) == 0
    assert read(file).pi is None
    assert not picture.exists()


def recorded(to, n=1500):
    """A record of y = 0.8 y' + 0.1 u' + noise, each of the sample before, under random steps."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.choice([-1.0, 1.0], n // 5), 5)
    y = lfilter([0, 0.1], [1, -0.8], u) + 0.002 * rng.standard_normal(n)
    to.write_text("\n".join(["u [V],y [A]", *(f"{a:g},{b:.6f}" for a, b in zip(u, y, strict=True))]) + "\n")


def test_content_counts_not_layout(file):
    pf = read(file)
    file.write_text(json.dumps(json.loads(file.read_text()), sort_keys=True))
    assert read(write(sealed(pf, pi=gains(2)), file, replaces=pf)).pi.kp == 2


def test_a_file_of_an_older_version_is_replaced(file):
    old = {**json.loads(file.read_text()), "schema_version": "fitmodels.parameters/1"}
    file.write_text(json.dumps(old))
    pf = read(file)
    assert read(write(sealed(pf, pi=gains(2)), file, replaces=pf)).pi.kp == 2


def test_a_file_that_was_removed_is_not_made_again(file):
    pf = read(file)
    file.unlink()
    with pytest.raises(ParameterError, match="removed since it was read; nothing was written"):
        write(pf, file, replaces=pf)
    assert list(file.parent.iterdir()) == []


def test_a_link_is_followed(file, tmp_path):
    """The file that it names is replaced, and the link stays."""
    (tmp_path / "other").mkdir()
    link = tmp_path / "other" / "link.json"
    link.symlink_to(file)
    pf = read(link)
    write(sealed(pf, pi=gains(2)), link, replaces=pf)
    assert link.is_symlink()
    assert read(file).pi.kp == 2


# --- the lock -----------------------------------------------------------------------------------------

HOLDER = """
import sys, time
from pathlib import Path
from fitmodels.core.files import locked_folder
with locked_folder(Path(sys.argv[1]), "in use"):
    print("held", flush=True)
    time.sleep(60)
"""


@unix
def test_a_folder_in_use_is_refused_and_free_when_its_holder_is_killed(tmp_path):
    with started(HOLDER, tmp_path) as process:
        assert process.stdout.readline() == b"held\n"
        begun = time.monotonic()
        with pytest.raises(UsageError, match="in use"), locked_folder(tmp_path, "in use", wait=0.05):
            pass
        assert time.monotonic() - begun < 10
        process.kill()
    with locked_folder(tmp_path, "in use", wait=0.05):
        assert list(tmp_path.iterdir()) == []


@unix
def test_a_folder_that_cannot_be_opened_is_not_locked_in_another_manner(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "open", full)
    with pytest.raises(UsageError, match="cannot be locked: too many open files"), locked_folder(tmp_path, "in use"):
        pass
    assert list(tmp_path.iterdir()) == []


@unix
def test_a_file_system_without_locks_of_folders_has_a_lock_file(tmp_path, monkeypatch):
    import fcntl

    real, folder = fcntl.flock, tmp_path.stat()

    def flock(descriptor, operation):
        if os.path.samestat(os.fstat(descriptor), folder):
            raise OSError(errno.EBADF, "bad file descriptor")
        return real(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", flock)
    with locked_folder(tmp_path, "in use"):
        assert [path.name for path in tmp_path.iterdir()] == [".fitmodels.lock"]
        with pytest.raises(UsageError, match="in use"), locked_folder(tmp_path, "in use", wait=0.05):
            pass
    with locked_folder(tmp_path, "in use", wait=0.05):
        pass


# --- file and picture ---------------------------------------------------------------------------------

DRAWER = """
import os, signal, sys
from pathlib import Path
from fitmodels.parameters import read
from fitmodels.parameters.file import replace, sealed
stage, path = sys.argv[1], Path(sys.argv[2])
def change(kp):
    pf = read(path)
    new = sealed(pf, pi={"kp": float(kp), "ki": 1.0, "sample_time": 0.02})
    replace(new, path, pf, {"figures/pi.png": str(float(kp)).encode()})
if stage == "at random":
    print("ready", flush=True)
    for kp in range(10**6):
        change(kp)
calls = 0
real = os.replace
def hooked(*paths):
    global calls
    calls += 1
    if calls == int(stage):
        os.kill(os.getpid(), signal.SIGKILL)
    real(*paths)
os.replace = hooked
change(2)
"""


def drawn(file):
    """Kp of the file, and that of its picture or None."""
    picture = file.parent / "figures" / "pi.png"
    return read(file).pi.kp, float(picture.read_bytes()) if picture.exists() else None


def with_picture(file):
    pf = read(file)
    replace(pf, file, pf, {"figures/pi.png": b"1.0"})
    assert drawn(file) == (1.0, 1.0)


@unix
@pytest.mark.parametrize(
    ("stage", "left", "then"),
    [
        (1, (1.0, 1.0), (1.0, 1.0)),
        (2, (1.0, None), (2.0, 2.0)),
        (3, (2.0, None), (2.0, 2.0)),
        (4, (2.0, 2.0), (2.0, 2.0)),
    ],
)
def test_kill_9_at_each_renaming_leaves_the_old_state_or_a_journal_that_the_next_reader_completes(
    file, stage, left, then, caplog
):
    """The first renaming is that of the journal; no picture of other gains is ever there."""
    with_picture(file)
    with started(DRAWER, stage, file) as process:
        assert process.wait(60) == (-9 if stage < 4 else 0)
    picture = file.parent / "figures" / "pi.png"
    shown = float(picture.read_bytes()) if picture.exists() else None
    assert (json.loads(file.read_text())["pi"]["kp"], shown) == left
    assert drawn(file) == then
    assert ("was interrupted; it was completed" in caplog.text) == (stage in (2, 3))
    with only_writer(file.parent):
        assert {path.name for path in file.parent.iterdir()} == {"params.json", "figures"}


@unix
def test_kill_9_at_any_moment_leaves_file_and_picture_agreeing(file):
    with_picture(file)
    for wait in (0.003, 0.008, 0.013, 0.021, 0.034):
        with started(DRAWER, "at random", file) as process:
            process.stdout.readline()
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(wait)
            process.kill()
        kp, shown = drawn(file)
        assert shown == kp
        assert parameters.check(read(file)).findings[0].passed


TUNER = """
import os, signal, sys
from fitmodels.cli import COMMANDS, main
calls, real = 0, os.replace
def hooked(*paths):
    global calls
    calls += 1
    if calls == int(sys.argv[1]):
        os.kill(os.getpid(), signal.SIGKILL)
    real(*paths)
os.replace = hooked
sys.exit(main(["tune", sys.argv[2], "--settle", "8", "--nominal", "--force"]))
"""


@unix
@pytest.mark.slow
def test_a_tune_that_is_killed_between_file_and_picture_is_completed_by_the_next_reader(file):
    with_picture(file)
    before = read(file)
    with started(TUNER, 3, file) as process:
        process.stdout.read()
        assert process.wait(60) == -9
    assert list((file.parent / "figures").glob("*.png")) == []
    pf = read(file)
    assert pf.pi != before.pi
    assert parameters.check(pf).findings[0].passed
    assert (file.parent / "figures" / "pi.png").read_bytes().startswith(b"\x89PNG")


def test_what_cannot_be_written_changes_neither(file):
    """The folder of the picture is a file here: both are as they were."""
    (file.parent / "figures").write_text("")
    pf, before = read(file), file.read_bytes()
    with pytest.raises(ParameterError, match=r"pi.png: cannot be written"):
        replace(sealed(pf, pi=gains(2)), file, pf, {"figures/pi.png": b"2.0"})
    assert file.read_bytes() == before
    assert {path.name for path in file.parent.iterdir()} == {"params.json", "figures"}


def test_a_picture_that_cannot_be_replaced_leaves_the_file_as_it_was(tmp_path):
    """A folder has its name."""
    (tmp_path / "a.png").mkdir()
    with pytest.raises(ParameterError, match=r"a.png: cannot be written"):
        write_together(tmp_path / "a.json", b"{}", {tmp_path / "a.png": b"PNG"}, error=ParameterError)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_the_error_states_what_completes_a_change(tmp_path, monkeypatch):
    """The picture fails after the file: the old picture is gone, the file is new, and the next writer goes on."""
    real = os.replace

    def fails(source, target):
        if str(target).endswith(".png"):
            raise OSError(errno.ENOSPC, "No space left on device", source, None, target)
        real(source, target)

    (tmp_path / "a.png").write_bytes(b"old")
    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(ParameterError, match=r"a.png: cannot be written: no space .* The next command that uses"):
        write_together(tmp_path / "a.json", b"{}", {tmp_path / "a.png": b"PNG"}, error=ParameterError)
    assert sorted(path.name for path in tmp_path.iterdir() if path.name[0] != ".") == ["a.json"]
    monkeypatch.undo()
    with only_writer(tmp_path):
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.png"]
        assert (tmp_path / "a.png").read_bytes() == b"PNG"


def test_a_folder_that_is_written_again_without_gains_has_no_picture_of_them(file):
    pf = sealed(read(file), pi=None)
    with_picture(file)
    cards.write(sealed(pf, pi=gains(1)), file.parent, force=True)
    assert drawn(file) == (1.0, 1.0)
    cards.write(pf, file.parent, force=True)
    assert not (file.parent / "figures" / "pi.png").exists()


# --- provenance ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        "tune params.json --scaling 1459 --unit mm/min --force",
        "tune ../shop/params.json --rise 2",
        "limits params.json V=50:200m/min",
        "ident 'run 1.csv' --params params.json",
    ],
)
def test_provenance_records_the_command_as_it_was_typed(command, file):
    """A unit with a stroke was taken for a path: `mm/min` was recorded as `min`."""
    assert traced(read(file), shlex.split(command))["then"] == (f"fitmodels {command}",)


@pytest.fixture(params=["deleted", "kept"])
def edited(request, tmp_path, monkeypatch):
    """A file in which the limit of power was raised by hand, its checksum deleted or left as it was."""
    monkeypatch.chdir(tmp_path)
    write(published("AC-2016"), "params.json")
    data = json.loads(Path("params.json").read_text("utf-8"))
    data["limits"]["power"]["value"] = 70.0
    if request.param == "deleted":
        data.pop("content_sha256")
    Path("params.json").write_text(json.dumps(data), "utf-8")
    return Path("params.json")


@pytest.mark.parametrize(
    "command",
    [
        "limits params.json f=0.1:0.3mm/rev --force",
        "costs params.json machine=60/h edge=8 change=1.5min currency=EUR",
        "export params.json --to ini --accept-verdict",
    ],
)
def test_nothing_is_written_from_a_file_that_was_edited_by_hand(edited, command, capsys):
    before = edited.read_bytes()
    assert main(command.split()) == 3
    error = capsys.readouterr().err
    assert "Nothing was written from it" in error
    assert "content_sha256" in error or "changed after it was written" in error
    assert edited.read_bytes() == before
    assert [path.name for path in edited.parent.iterdir()] == ["params.json"]


def test_a_file_that_was_edited_by_hand_is_read_with_a_warning_and_fails_its_check(edited, capsys):
    assert main(["replay", "params.json", "--system", "region", "--json"]) == 0
    assert "Commands that write from it refuse it" in capsys.readouterr().err
    assert main(["check", "params.json", "--quiet"]) == 5
    assert "FAIL" in capsys.readouterr().out


def test_a_coefficient_that_is_not_that_of_its_equation_is_refused_though_the_checksum_agrees(tmp_path, capsys):
    data = published("AC-2016").model_dump()
    data["laws"]["P"]["coefficients"]["V"] = 0.5
    path = write(parameters.ParameterFile.model_validate(data), tmp_path / "params.json")
    assert main(["limits", str(path), "P=7kW", "--force"]) == 3
    assert "lacks its coefficient V = 0.5" in capsys.readouterr().err
    data["laws"]["P"]["coefficients"]["V"] = 0.82
    data["identity"] |= {"note": "simulated: no measurement", "simulated": False}
    write(parameters.ParameterFile.model_validate(data), path, force=True)
    assert main(["limits", str(path), "P=7kW", "--force"]) == 3
    assert "identity.simulated is false" in capsys.readouterr().err


def test_an_export_does_not_replace_the_file_it_is_made_from(tmp_path, capsys):
    path = write(published("AC-2016"), tmp_path / "params.json")
    (tmp_path / "link.ini").symlink_to(path)
    before = path.read_bytes()
    for out in (path, tmp_path / "." / "params.json", tmp_path / "link.ini"):
        assert main(["export", str(path), "--to", "ini", "--accept-verdict", "--force", "--out", str(out)]) == 2
        assert "that is read; it would be lost" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_temporary_files_of_ended_processes_are_removed_by_the_next_write(tmp_path):
    ended, running, old, foreign = (
        temporary_name().replace(f"-{os.getpid()}-", "-4194399-"), temporary_name(),
        ".fitmodels-0123456789abcdef.tmp", ".fitmodels-notes.tmp",
    )  # fmt: skip
    for name in (ended, running, old, foreign):
        (tmp_path / name).touch()
    os.utime(tmp_path / old, (0, 0))
    write_whole(tmp_path / "a.txt", "1")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([running, foreign, "a.txt"])


@unix
def test_a_device_or_a_pipe_is_not_replaced_by_a_file(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(UsageError, match="it is a device or a pipe, which a file would replace"):
        write_whole(pipe, "1")
    assert pipe.is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


# --- the study of interruptions and races -------------------------------------------------------------

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"


def test_every_command_that_writes_is_in_the_study(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import interruptions

    known, races = interruptions.cases()
    assert {case.words.split()[0] for case in known.values()} & {*COMMANDS} == {*COMMANDS} - {*interruptions.READING}
    assert len(races) >= 25


@unix
@pytest.mark.parametrize(
    ("name", "outcomes"), [("settings", {"kill", "disk"}), ("settings, limits", {"both", "first"})]
)
def test_interrupted_or_racing_commands_leave_the_former_files_or_the_new_ones(name, outcomes):
    """Twelve kills and twelve full disks at random moments, and one race; the benchmark has 200 of each command."""
    words = ["--one", "--only", name, "--moments", "12", "--races", "1"]
    study = [sys.executable, str(BENCHMARKS / "interruptions.py"), *words]
    done = subprocess.run(study, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["wrong"] == []
    assert {count.split()[0] for count in found["counts"]} & outcomes


@pytest.mark.parametrize(
    ("words", "result"),
    [
        ("compare {table} --figure forms.png", "forms.png"),
        ("plan --range V=50:200 --range f=0.06:0.6 --out plan.csv", "plan.csv"),
        ("optimum {params} --figure cost.png", "cost.png"),
        ("ident {record} --tool T --work W --out id", "id"),
        ("ident {chirp} --as force-process --depth 2 --spindle 3000rpm --tool T --work W --out id", "id"),
    ],
    ids=lambda text: text.split()[0],
)
def test_a_refusal_to_replace_removes_what_a_killed_command_left(words, result, tmp_path, monkeypatch):
    write(published("AC-2017"), tmp_path / "params.json")
    (work := tmp_path / "work").mkdir()
    monkeypatch.chdir(work)
    monkeypatch.setattr(journal, "_SEARCHED", {})
    left = work / temporary_name().replace(f"-{os.getpid()}-", "-4194399-")
    if result == "id":  # killed between the two renames of a folder and the removal of the hidden one
        cards.write(published("AC-2017"), work / "id")
        left.mkdir()
    else:  # killed between link and unlink
        left.touch()
        os.link(left, result)
    known = {"table": datasets.bundled("gc435_709m40"), "params": "../params.json"}
    known |= {
        "record": BENCHMARKS.parent / "docs/examples/drive.csv",
        "chirp": BENCHMARKS.parent / "docs/examples/force-chirp.csv",
    }
    assert main(shlex.split(words.format(**known))) == 2
    assert [path.name for path in work.iterdir()] == [result]
