"""The journal of a watch: nothing is lost by kill -9, a full disk is said and overcome, files stay bounded."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from fitmodels.core.errors import DataError
from fitmodels.live import stream, watch_journal
from fitmodels.live.watch_journal import WatchJournal, journal_files, leave_request, read_journal, read_newest, requests

WRITER = """
import sys
from pathlib import Path
from fitmodels.live.watch_journal import WatchJournal, read_newest
folder = Path(sys.argv[1])
journal, newest = WatchJournal(folder, rotate_at=20_000), read_newest(folder)
journal.rotate({"count": 0}) if newest is None else journal.resume(newest)
while True:
    journal.append({"kind": "window", "text": "x" * 60})
    sys.stdout.write(f"{journal._number}\\n")
    sys.stdout.flush()
    if journal.full:
        journal.rotate({"count": journal._number})
"""


def numbers(folder):
    return [record["n"] for record in read_journal(folder)]


@pytest.mark.slow
def test_kill_9_loses_no_record_that_was_written(tmp_path):
    for _ in range(4):
        child = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        for _ in range(150):
            said = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        rest = child.communicate()[0].split()
        said = int(rest[-1]) if rest and rest[-1].isdigit() else said
        found = numbers(tmp_path)
        assert found[-1] >= said
        assert found == list(range(found[0], found[-1] + 1))
    assert read_newest(tmp_path).missing == 0


def test_a_torn_last_line_is_ended_and_its_number_is_used_again(tmp_path):
    journal = WatchJournal(tmp_path)
    journal.rotate({})
    journal.append({"kind": "window"})
    journal.close()
    with journal.path.open("ab") as file:
        file.write(b'{"n": 3, "kind": "win')
    newest = read_newest(tmp_path)
    assert newest.torn
    assert [record["n"] for record in newest.records] == [1, 2]
    again = WatchJournal(tmp_path)
    again.resume(newest)
    again.append({"kind": "cutend"})
    again.close()
    assert [(r["n"], r["kind"]) for r in read_journal(tmp_path)] == [(1, "snapshot"), (2, "window"), (3, "cutend")]
    assert read_newest(tmp_path).missing == 0


def test_a_torn_last_line_that_the_disk_does_not_let_end_damages_no_later_record(tmp_path, monkeypatch):
    journal = WatchJournal(tmp_path)
    journal.rotate({})
    journal.close()
    with journal.path.open("ab") as file:
        file.write(b'{"n": 2, "kind": "win')

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    again = WatchJournal(tmp_path)
    with monkeypatch.context() as full:
        full.setattr(watch_journal.os, "write", refuse)
        again.resume(read_newest(tmp_path))
    assert "space" in again.fault
    monkeypatch.setattr(watch_journal, "RETRY", 0.0)
    again.append({"kind": "gauge", "wear": 0.2})
    again.close()
    assert [(record["n"], record["kind"]) for record in read_journal(tmp_path)] == [(1, "snapshot"), (2, "gauge")]
    assert (again.records, again.lost, again.fault) == (2, 0, "")


def test_missing_records_are_counted(tmp_path):
    journal = WatchJournal(tmp_path)
    journal.rotate({})
    for _ in range(5):
        journal.append({"kind": "window"})
    journal.close()
    lines = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(b"".join([*lines[:2], b"\x00\x00garbage\n", *lines[4:]]))
    assert read_newest(tmp_path).missing == 2


def test_files_are_bounded_and_each_begins_with_a_snapshot(tmp_path):
    journal = WatchJournal(tmp_path, rotate_at=2000, kept=3)
    journal.rotate({"minutes": 0})
    for k in range(500):
        journal.append({"kind": "window", "minutes": k})
        if journal.full:
            journal.rotate({"minutes": k})
    journal.close()
    files = journal_files(tmp_path)
    assert len(files) == 3
    assert all(path.stat().st_size < 2200 for path in files)
    assert all(json.loads(path.read_bytes().split(b"\n")[0])["kind"] == "snapshot" for path in files)


@pytest.mark.parametrize("half", [0, 10])
def test_a_full_disk_is_said_and_what_waited_is_written_later(tmp_path, monkeypatch, half):
    journal = WatchJournal(tmp_path)
    journal.rotate({})
    write = os.write

    def refuse(file, data):
        if half:
            return write(file, data[:half])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(watch_journal, "RETRY", 0.0)
    monkeypatch.setattr(watch_journal.os, "write", refuse)
    for _ in range(3):
        journal.append({"kind": "window"})
    assert "space" in journal.fault
    assert not journal.full
    monkeypatch.setattr(watch_journal.os, "write", write)
    journal.append({"kind": "cutend"})
    assert journal.fault == ""
    journal.close()
    assert numbers(tmp_path) == [1, 2, 3, 4, 5]


def test_a_new_file_that_the_disk_refuses_uses_up_no_number(tmp_path, monkeypatch):
    journal = WatchJournal(tmp_path)
    journal.rotate({})

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(watch_journal, "write_whole", refuse)
        journal.rotate({})
    assert "space" in journal.fault
    monkeypatch.setattr(watch_journal, "RETRY", 0.0)
    journal.append({"kind": "window"})
    journal.close()
    assert read_newest(tmp_path).missing == 0


def test_what_the_disk_refused_is_not_written_after_the_snapshot_that_holds_it(tmp_path, monkeypatch):
    journal = WatchJournal(tmp_path)
    journal.rotate({})

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(watch_journal.os, "write", refuse)
        journal.append({"kind": "cutend"})
        journal.append({"kind": "edge"})
        journal.rotate({"edge": 2})  # the disk is not full any more
    journal.append({"kind": "window"})
    journal.close()
    newest = read_newest(tmp_path)
    assert [(record["n"], record["kind"]) for record in newest.records] == [(4, "snapshot"), (5, "window")]
    assert (newest.missing, journal.lost, journal.fault) == (0, 2, "")


def test_what_waits_is_written_before_a_new_file_begins(tmp_path, monkeypatch):
    journal = WatchJournal(tmp_path)
    journal.rotate({})
    with monkeypatch.context() as full:
        full.setattr(watch_journal.os, "write", lambda *_: 0)
        journal.append({"kind": "cutend"})
    journal.append({"kind": "edge"})
    journal.rotate({"edge": 2})
    journal.close()
    kinds = ["snapshot", "cutend", "edge", "snapshot"]
    assert [(record["n"], record["kind"]) for record in read_journal(tmp_path)] == list(enumerate(kinds, 1))
    assert journal.lost == 0


def test_a_record_that_stands_after_a_later_one_is_not_applied_and_is_reported_as_missing(tmp_path):
    journal = WatchJournal(tmp_path)
    for k in range(3):
        journal.rotate({"k": k})
    journal.append({"kind": "window"})
    journal.close()
    with journal.path.open("ab") as file:
        file.write(b'{"n":2,"kind":"cutend"}\n{"n":5,"kind":"window"}\n')
    newest = read_newest(tmp_path)
    assert [record["n"] for record in newest.records] == [3, 4, 5]
    assert newest.missing == 1


def test_a_snapshot_that_cannot_be_continued_is_removed(tmp_path, monkeypatch):
    journal = WatchJournal(tmp_path)
    journal.rotate({})

    def refuse(*_):
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as full:
        full.setattr(watch_journal.os, "open", refuse)
        journal.rotate({"edge": 2})
    monkeypatch.setattr(watch_journal, "RETRY", 0.0)
    journal.append({"kind": "window"})
    journal.close()
    assert numbers(tmp_path) == [1, 2]
    assert len(read_newest(tmp_path).records) == 2


def test_what_waits_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(watch_journal, "WAITING", 10)
    journal = WatchJournal(tmp_path)
    journal.rotate({})

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(watch_journal.os, "write", refuse)
    for _ in range(25):
        journal.append({"kind": "window"})
    assert journal.lost == 15


def test_another_schema_and_a_damaged_first_line_are_refused(tmp_path):
    path = tmp_path / "watch-000001.jsonl"
    path.write_text('{"n":1,"kind":"snapshot","schema":"fitmodels.watch/9","state":{}}\n')
    with pytest.raises(DataError, match=r"fitmodels\.watch/9"):
        read_newest(tmp_path)
    path.write_text("[" * 5000 + "\n")
    with pytest.raises(DataError, match="damaged"):
        read_newest(tmp_path)


def test_a_journal_without_a_snapshot_names_the_contact_that_its_lines_show(tmp_path):
    journal = WatchJournal(tmp_path)
    journal.rotate({})
    for kind, minutes in (("window", 9.0), ("edge", 0.0), ("used", 4.0), ("window", 2.5), ("contact", 0.5)):
        journal.append({"kind": kind, "minutes": minutes})
    journal.close()
    lines = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(b"\x00\x01garbage" + b"".join(lines))
    with pytest.raises(DataError, match=r"shows 7 min of contact .* --used 7min, and gauge the edge with --gauge"):
        read_newest(tmp_path)
    journal.path.write_bytes(b"")
    with pytest.raises(DataError, match=r"not known: .* new edge or state what this one has cut with --used"):
        read_newest(tmp_path)


@pytest.mark.parametrize(("emptied", "kinds"), [(False, ["window", "edge", "window"]), (True, ["window", "edge"])])
def test_a_damaged_newest_file_is_read_after_the_one_before(tmp_path, emptied, kinds):
    journal = WatchJournal(tmp_path)
    journal.rotate({"first": True})
    journal.append({"kind": "window"})
    journal.append({"kind": "edge"})
    journal.rotate({})
    journal.append({"kind": "window"})
    journal.close()
    journal.path.write_bytes(b"" if emptied else b"{" + journal.path.read_bytes())
    newest = read_newest(tmp_path)
    assert [record["kind"] for record in newest.records] == ["snapshot", *kinds]
    assert newest.records[0]["state"] == {"first": True}
    assert (newest.path, newest.missing) == (journal.path, 1)


def test_requests_are_left_and_found_once(tmp_path):
    leave_request(tmp_path, {"kind": "gauge", "wear": 0.2, "sd_ln": 0.02})
    (tmp_path / "request-0123456789abcdef.json").write_text("{not json")
    kinds = sorted(facts["kind"] for _, facts in requests(tmp_path))
    assert kinds == ["gauge", "unreadable"]


def test_files_of_lines_are_opened_as_bytes(tmp_path, monkeypatch):
    """Windows would write \\r\\n: the size of the file, by which a torn line is taken back, would be wrong."""
    opened, real = {}, os.open

    def spied(path, flags, *more, **keywords):
        opened[Path(path).name] = flags
        return real(path, flags, *more, **keywords)

    for module in (watch_journal, stream):
        monkeypatch.setattr(module, "AS_BYTES", os.O_SYNC)
    monkeypatch.setattr(os, "open", spied)
    journal = WatchJournal(tmp_path)
    journal.append({"kind": "window"})
    journal.close()
    stream.file_writer(tmp_path / "facts.jsonl")("{}\n")
    assert opened["watch-000000.jsonl"] & os.O_SYNC == opened["facts.jsonl"] & os.O_SYNC == os.O_SYNC
