"""Growing files and recorded runs: no row torn, doubled or lost; what happened is a notice."""

import errno
import itertools
import json
import math
import os
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest
from fitmodels.core.errors import DataError, FitmodelsError, UsageError
from fitmodels.live.samples import Notice, Sample
from fitmodels.live.sources import Source, SourceOptions, files, open_source, streams
from fitmodels.live.sources.channels import channels_of
from fitmodels.live.sources.clock import Clock, Stamps
from fitmodels.live.sources.files import Tail
from fitmodels.live.sources.rows import Lines
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

P = SourceOptions(loads={"P": "kW"})


def read(path, **options):
    """Samples and notices of a recorded run without waiting."""
    given = {"loads": {"P": "kW"}, "replay": float("inf"), **options}
    with open_source(str(path), SourceOptions(**given)) as source:
        items = list(source)
    return [i for i in items if isinstance(i, Sample)], [i for i in items if isinstance(i, Notice)]


def written(tmp_path, text, name="run.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def until(source, condition, seconds=5.0):
    """Items of a growing source until a condition holds of the list; fails after some seconds."""
    items, end = [], time.monotonic() + seconds
    for item in source:
        items.append(item)
        if condition(items):
            return items
        assert time.monotonic() < end, [i for i in items if not isinstance(i, Sample)]
    raise AssertionError("the source ended")


def loads(items):
    return [round(i.loads["P"], 9) for i in items if isinstance(i, Sample)]


def kinds(items):
    return [i.kind for i in items if isinstance(i, Notice) and i.kind != "idle"]


@pytest.mark.parametrize(
    "text",
    [
        "t [s],Power [W],Vc [m/min],feed [mm/rev]\n0,1800,120,0.2\n0.5,1900,120,0.2\n",
        "\ufefft [s];Power [W];Vc [m/min];feed [mm/rev]\r\n0;1800;120;0,2\r\n0,5;1900;120;0,2\r\n",
        "Lathe 3\n# operator A\n\nt\tPower\tvc\tfeed\ns\tW\tm/min\tmm/rev\n0\t1800\t120\t0.2\n0.5\t1900\t120\t0.2\n",
        "time_ms,P_W,Vc_m_per_s,fn_um_per_rev\n0,1800,2,200\n500,1900,2,200\n",
        '{"t [s]": 0, "Power [W]": 1800, "Vc": 120, "f": 0.2}\n'
        '{"t [s]": 0.5, "Power [W]": 1900, "Vc": 120, "f": 0.2}\n',
        '{"time": "2026-11-23T10:00:00Z", "spindle": {"P_W": 1800}, "V": 120, "f": 0.2}\n'
        '{"time": "2026-11-23T10:00:00.5Z", "spindle": {"P_W": 1900}, "V": 120, "f": 0.2}\n',
    ],
    ids=["comma", "semicolon", "units in a row", "units in names", "json", "nested json"],
)
def test_one_run_in_several_forms_gives_the_same_samples(tmp_path, text):
    nested = {"map": {"load": "spindle.P_W"}, "units": {"P": "W"}} if "spindle" in text else {}
    samples, notices = read(written(tmp_path, text), **nested)
    assert loads(samples) == [1.8, 1.9]
    assert samples[1].time - samples[0].time == pytest.approx(0.5)
    assert all(s.conditions["V"] == pytest.approx(120) and s.conditions["f"] == pytest.approx(0.2) for s in samples)
    assert kinds(notices)[0] == "connected"
    assert kinds(notices)[-1] == "end"


def test_what_is_assumed_and_what_is_not_read_is_said(tmp_path):
    path = written(tmp_path, "time,P,Comment\n0,1.8,a\n0.02,1.8,b\n")
    _, notices = read(path, loads={"P": "kW", "Fc": "N"})
    said = " ".join(n.text for n in notices)
    for part in ("P from 'P'", "kW is assumed", "does not give Fc", "not read: 'Comment'", "s is assumed"):
        assert part in said


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("t [s],Torque [Nm]\n0,1\n", {}, "gives no load of the laws (P [kW]); it has 't [s]', 'Torque [Nm]'"),
        ("t [s],P [N]\n0,1\n", {}, "is in N, and P in kW"),
        ("t [s],P [kW],Spindle power [W]\n0,1,1000\n", {}, "are both P: choose one with --map P=col2"),
        ("t [s],P [kW]\n0,1\n", {"map": {"V": "speed"}}, "--map V=speed: run.csv has no such column"),
        ("P [kW]\n1\n2\n", {}, "no column of times"),
        ("time,P [kW]\n0,1\n20,1\n", {}, "rise by 20 and name no unit: 20 s or 20 ms?"),
        ("t [s],P [kW]\n", {}, "no readings"),
        (b"\xff\xfet\x00", {}, "UTF-16"),
        ("t [s],P [kW],fm [mm/min]\n0,1,1\n", {"map": {"fm_set": "fm [mm/min]"}}, "needs the override"),
    ],
)
def test_a_run_that_cannot_be_used_is_refused_with_a_remedy(tmp_path, text, options, message):
    with pytest.raises((DataError, UsageError)) as refused:
        read(written(tmp_path, text), **options)
    assert message in str(refused.value)


@pytest.mark.parametrize("words", ["nowhere.csv", "http://a", "/dev/null", "."])
def test_words_that_name_no_source_are_refused(words):
    with pytest.raises((DataError, UsageError)):
        open_source(words, P)


def test_bad_cells_are_named_and_torn_rows_left_out(tmp_path):
    path = written(tmp_path, "t [s],P [kW],V\n0,1.8,120\n0.02,x,120\n0.04,1.8\n0.06,,120\n0.08,1e999,120\n0.1,1.9,\n")
    samples, notices = read(path)
    assert [s.loads.get("P") for s in samples] == [1.8, None, None, None, 1.9]
    assert [s.bad for s in samples] == ["", "P is 'x'", "", "P is 'inf'", ""]
    assert "V" not in samples[-1].conditions
    assert ["line 4" in n.text for n in notices if n.kind == "bad"] == [True]


@pytest.mark.parametrize("cell", ["", "NaN"])
@pytest.mark.parametrize("usual", [True, False])
def test_an_empty_cell_is_a_loss_in_a_full_column_and_none_in_one_of_changes(tmp_path, cell, usual):
    rows = [f"{k},1.{k % 9},{120 if usual or k % 10 == 0 else cell}\n" for k in range(40)]
    samples, _ = read(written(tmp_path, "t [s],P [kW],V\n" + "".join(rows) + f"40,1.8,{cell}\n41,1.8,130\n"))
    assert [math.isnan(s.conditions["V"]) for s in samples[-2:] if "V" in s.conditions] == [True] * usual + [False]


def test_a_null_of_json_is_a_loss_where_values_are_usual_and_a_missing_key_is_none():
    lines = Lines("tcp", SourceOptions(loads={"P": "kW"}))
    texts = [{"t": k / 2, "P": 1 + k, "V": 120} for k in range(25)] + [{"t": 13, "P": 2}, {"t": 14, "P": 3, "V": None}]
    items = [item for text in texts for item in lines.take(json.dumps(text)) if isinstance(item, Sample)]
    assert items[-2].conditions == {}
    assert math.isnan(items[-1].conditions["V"])


def test_a_run_whose_load_stays_empty_is_noticed_once(tmp_path):
    path = written(tmp_path, "t [s],P [kW]\n0,1\n" + "".join(f"{k / 2},\n" for k in range(1, 60)))
    samples, notices = read(path)
    assert len(samples) == 60
    assert [n.text for n in notices if n.kind == "bad"] == ["run.csv: no load for 5 s; its cells are empty"]


def test_state_tool_and_override(tmp_path):
    rows = (
        "0,1,ACTIVE,T4,1000,50,800",
        "1,1,Feed-Hold,T4,1000,50,800",
        "2,1,ACTIVE,T4,1000,0,800",
        "3,1,,T4,1000,100,0",
    )
    path = written(tmp_path, "\n".join(["t [s],P [kW],status,tool,F prog [mm/min],ovr [%],n [rpm]", *rows, ""]))
    samples, _ = read(path, map={"fm_set": "F prog [mm/min]", "override": "ovr [%]"})
    assert [s.conditions["fm"] for s in samples] == [500, 500, 0, 1000]
    assert [s.state for s in samples] == ["feed", "idle", "idle", "off"]
    assert {s.tool for s in samples} == {"T4"}


def test_scales_rates_and_times_already_known(tmp_path):
    path = written(tmp_path, "Load [%]\n10\n20\n30\n")
    samples, _ = read(path, map={"load": "Load [%]"}, scales={"load": 0.11}, rate=50.0, after=0.0)
    assert [s.time for s in samples] == pytest.approx([0.02, 0.04])
    assert samples[0].loads["P"] == pytest.approx(2.2)


def test_gaps_and_clocks_that_were_set():
    clock = Clock()
    seen = [clock.take(t) for t in (0, 0.02, 0.04, 0.06, 0.05, 3.0, 3.02, -3600.0, -3599.98, -3599.96)]
    assert [use for use, _ in seen].count(False) == 1
    assert [(k, n.kind) for k, (_, n) in enumerate(seen) if n] == [(5, "gap"), (7, "clock")]
    assert "back by 3.6e+03" in seen[7][1].text


def test_an_extra_value_of_a_slow_source_makes_no_gap_of_its_usual_step():
    """A value each 2 s, and another one 0.15 s after each ninth; 12 s without one are a gap."""
    clock = Clock()
    times = sorted([2.0 * k for k in range(200)] + [2.0 * k + 0.15 for k in range(0, 200, 9)])
    assert [notice for t in times if (notice := clock.take(t)[1])] == []
    assert clock.take(398.0 + 12.0)[1].kind == "gap"


def test_a_clock_set_forward_is_no_gap_and_late_rows_are_no_clock():
    clock, wall = Clock(), 100.0
    for k in range(100):  # rows come in blocks of ten
        assert clock.take(k * 0.02, wall + (k // 10 + 1) * 0.2) == (True, None)
    assert clock.take(2.0 + 4.0, wall + 6.2)[1].kind == "gap"
    assert clock.take(6.02 + 3600.0, wall + 6.24)[1].kind == "clock"
    assert clock.take(6.04 + 3600.0, wall + 6.26)[1] is None


@pytest.mark.parametrize(
    ("unit", "values", "seconds"),
    [
        ("min", [1.0], 60.0), ("", [1.7e9], 1.7e9), ("", [1.7e12], 1.7e9), ("", ["2026-11-23 10:00:00"], 1795428000.0),
        ("", ["2026-11-23T11:00:00+01:00"], 1795428000.0), ("", ["01:00:00,5"], 3600.5), ("", ["soon"], None),
    ],
)  # fmt: skip
def test_stamps(unit, values, seconds):
    assert Stamps(unit, "run").seconds(*values) == seconds


def test_a_growing_file_gives_whole_rows_once(tmp_path):
    """Rows written byte by byte, through renaming, truncation and rewriting."""
    path = written(tmp_path, "t [s],P [kW]\n")
    expected = [round(1 + k / 1000, 3) for k in range(600)]

    def write():
        rows = iter(enumerate(expected))
        for part in range(4):
            if part == 1:
                path.rename(tmp_path / "run.1.csv")
            if part == 2:
                time.sleep(0.25)  # what is cut off before it was read is lost to any reader
                os.truncate(path, 0)
            if part == 3:
                time.sleep(0.25)
                path.unlink()
            with path.open("ab", buffering=0) as file:
                if part:
                    file.write(b"t [s],P [kW]\n")
                for k, value in [next(rows) for _ in range(150)]:
                    line = f"{k / 50},{value}\n".encode()
                    file.write(line[: 1 + k % 7])
                    if k % 50 == 0:
                        time.sleep(0.03)
                    file.write(line[1 + k % 7 :])

    with open_source(str(path), P) as source:
        writer = threading.Thread(target=write)
        writer.start()
        items = until(source, lambda items: loads(items[-1:]) == expected[-1:], 10.0)
        writer.join()
    assert loads(items) == expected
    assert kinds(items).count("replaced") == 3
    assert "bad" not in kinds(items)


def test_a_file_that_was_rewritten_with_the_same_header_is_noticed(tmp_path):
    """Longer than before, and with the same first 64 bytes: the last 64 that were read differ."""
    head = "t [s],P [kW],a column with a long name that fills the first sixty-four bytes of it\n"
    path = written(tmp_path, head + "0,1.0,0\n0.1,1.1,0\n")
    tail = Tail(path)
    assert len(tail.poll()[0]) == 3
    path.write_text(head + "0,2.0,0\n0.1,2.1,0\n0.2,2.2,0\n")
    assert "was rewritten" in tail.poll()[1]
    assert len(tail.poll()[0]) == 4
    tail.close()


@pytest.mark.parametrize("failing", range(4))
def test_a_file_that_fails_once_is_read_on_where_it_was(tmp_path, monkeypatch, failing):
    """A network drive that gives ESTALE once, at each of the reads of a poll: no row twice, none lost."""
    path = written(tmp_path, "t [s],P [kW]\n0,1\n0.1,2\n0.2,")
    tail, read, count = Tail(path), files._bytes_at, itertools.count()

    def stale(file, size, at):
        if next(count) == failing:
            raise OSError(errno.ESTALE, "Stale file handle")
        return read(file, size, at)

    assert tail.poll()[0] == [b"t [s],P [kW]", b"0,1", b"0.1,2"]
    with path.open("a") as file:
        file.write("3\n0.3,4\n")
    monkeypatch.setattr(files, "_bytes_at", stale)
    assert tail.poll() == ([], "")
    assert "cannot be read" in tail.missing
    assert not tail.caught_up
    assert tail.poll() == ([b"0.2,3", b"0.3,4"], "")
    assert tail.missing == ""
    tail.close()


@pytest.mark.parametrize("other", ["t [s],P [kW]\n0,5\n", "t [s],P [kW]\n0,5\n0.1,6\n0.2,7\n"])
def test_another_file_after_a_failed_read_is_said_to_be_one(tmp_path, monkeypatch, other):
    path, read = written(tmp_path, "t [s],P [kW]\n0,1\n0.1,2\n"), files._bytes_at
    tail = Tail(path)
    tail.poll()

    def stale(file, size, at):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(files, "_bytes_at", stale)
    tail.poll()
    monkeypatch.setattr(files, "_bytes_at", read)
    path.rename(tmp_path / "old.csv")
    written(tmp_path, other)
    assert tail.poll() == ([], f"another file has the name {path.name}: it is read from its beginning")
    assert tail.poll()[0] == other.encode().splitlines()
    tail.close()


def test_a_successor_that_cannot_be_opened_at_once_is_said_to_be_another_file(tmp_path, monkeypatch):
    path = written(tmp_path, "t [s],P [kW]\n0,1\n0.1,2\n")
    tail = Tail(path)
    tail.poll()
    path.rename(tmp_path / "old.csv")
    written(tmp_path, "t [s],P [kW]\n0,5\n")
    opened, allowed = files.open_regular, []

    def denied(path, kind):
        if not allowed:
            raise PermissionError(errno.EACCES, "Permission denied")
        return opened(path, kind)

    monkeypatch.setattr(files, "open_regular", denied)
    assert [tail.poll() for _ in range(4)] == [([], "")] * 4
    allowed.append(True)
    assert "another file has the name" in tail.poll()[1]
    assert tail.poll()[0] == [b"t [s],P [kW]", b"0,5"]
    tail.close()


def test_a_silent_file_is_lost_and_comes_back(tmp_path):
    path = written(tmp_path, "t [s],P [kW]\n0,1\n0.02,2\n")
    with open_source(str(path), SourceOptions(loads={"P": "kW"}, silent=0.3)) as source:
        items = until(source, lambda items: "lost" in kinds(items))
        assert loads(items) == [1, 2]
        path.unlink()
        items = until(source, lambda items: kinds(items) == [] and len(items) > 1)  # idle, at least twice
        written(tmp_path, "t [s],P [kW]\n9,3\n")
        items = until(source, lambda items: loads(items) == [3])
    assert kinds(items)[0] == "replaced"
    assert kinds(items).count("connected") == 2  # its header, and readings again


def test_idle_comes_at_least_every_half_second(tmp_path):
    path = written(tmp_path, "t [s],P [kW]\n")
    with open_source(str(path), P) as source:
        began = time.monotonic()
        assert [next(source).kind for _ in range(2)] == ["idle", "idle"]
        assert time.monotonic() - began < 1.4


def test_a_new_file_without_the_load_is_refused_in_a_notice(tmp_path):
    path = written(tmp_path, "t [s],P [kW]\n0,1\n0.02,2\n")
    with open_source(str(path), P) as source:
        until(source, lambda items: len(loads(items)) == 2)
        path.write_text("t [s],Torque [Nm]\n1,5\n")
        items = until(source, lambda items: "refused" in kinds(items))
        assert "no load of the laws" in items[-1].text
        (tmp_path / "next").write_text("t [s],P [kW]\n2,3\n")
        (tmp_path / "next").rename(path)
        until(source, lambda items: loads(items) == [3])


def test_from_the_end_only_new_rows_are_read(tmp_path):
    path = written(tmp_path, "t [s],P [kW]\n" + "".join(f"{k / 50},1\n" for k in range(50_000)) + "1000.0,1")
    with open_source(str(path), SourceOptions(loads={"P": "kW"}, from_end=True)) as source:
        assert next(source).kind == "connected"
        with path.open("a") as file:
            file.write("\n1000.02,2\n")
        items = until(source, lambda items: len(loads(items)) == 2)
    assert loads(items) == [1, 2]


def test_a_replay_takes_its_time(tmp_path):
    path = written(tmp_path, "t [s],P [kW]\n" + "".join(f"{k},1\n" for k in range(41)))
    began = time.monotonic()
    samples, _ = read(path, replay=100.0)
    assert len(samples) == 41
    assert 0.39 < time.monotonic() - began < 2.0


def test_json_keys_may_come_later_and_lists_are_ignored():
    lines = Lines("tcp", SourceOptions(loads={"P": "kW"}))
    texts = [{"status": "up"}, {"t": 0.0, "P": 1, "x": [1]}, {"t": 0.5, "P": True}, {"t": 0.6, "P": 2, "V": 100}]
    items = [item for text in texts for item in lines.take(json.dumps(text))]
    assert [i.loads.get("P") for i in items if isinstance(i, Sample)] == [1, None, 2]
    assert items[-1].conditions == {"V": 100}
    for text in ("[1]", "{", "{" * 5000, '{"t": 1' + "0" * 400 + "}"):
        assert all(item.kind in ("bad", "connected") for item in lines.take(text) if isinstance(item, Notice))


def test_options_are_checked():
    for options in ({"replay": 0}, {"replay": float("nan")}, {"rate": -1}, {"map": {"Q": "a"}}, {"scales": {"P": 0}}):
        with pytest.raises(UsageError):
            SourceOptions(loads={"P": "kW"}, **options)
    with pytest.raises(UsageError, match="'load' is open"):
        SourceOptions(loads={"P": "kW", "Fc": "N"}, map={"load": "a"})


def test_a_reading_in_other_units_is_converted():
    found = channels_of(["I_mA", "feed [ipm]", "S [rpm]", "Temp"], SourceOptions(loads={"I": "A"}), "run")
    sample = found.sample(0.0, [1500.0, 10.0, 3000.0])
    assert sample.loads["I"] == pytest.approx(1.5)
    assert sample.conditions == pytest.approx({"fm": 254.0, "n": 3000.0})


def accepted(server, data, reset=False):
    """Send bytes to the next client and end its connection."""
    client, _ = server.accept()
    with client:
        client.sendall(data)
        if reset:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


@pytest.mark.parametrize("family", ["tcp", "unix"])
def test_a_socket_that_ends_is_lost_and_connected_again(tmp_path, monkeypatch, family):
    monkeypatch.setattr(streams, "AGAIN", 0.1)
    monkeypatch.chdir(tmp_path)
    made = socket.socket(socket.AF_UNIX if family == "unix" else socket.AF_INET)
    with made as server:
        server.bind("s" if family == "unix" else ("127.0.0.1", 0))
        server.listen()
        words = "unix:s" if family == "unix" else f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with open_source(words, P) as source:
            client = threading.Thread(target=accepted, args=(server, b"t [s],P [W]\n0,1000\n.02,2000\n.04,30", True))
            client.start()
            items = until(source, lambda items: "lost" in kinds(items))
            client.join()
            assert loads(items) == [1, 2]
            client = threading.Thread(
                target=accepted, args=(server, b'{"t": 5, "P_W": 4000}\n{"t": 5.02, "P_W": 4000}\n')
            )
            client.start()
            items = until(source, lambda items: len(loads(items)) == 2)
            client.join()
    assert loads(items) == [4, 4]
    assert "bad" not in kinds(items)


READ_STANDARD_INPUT = (
    "from fitmodels.live.sources import *\n"
    "print([getattr(i, 'kind', '') or i.loads for i in open_source('-', SourceOptions(loads={'P': 'kW'}))])"
)


@pytest.mark.parametrize("end", ["\n", "\r\n", "", "\r"])
def test_standard_input_ends_with_its_last_line(end):
    words = [sys.executable, "-c", READ_STANDARD_INPUT]
    run = subprocess.run(words, input=f"t,P [kW]\n0,1\n.1,2{end}".encode(), capture_output=True)
    assert run.stdout == b"['connected', {'P': 1.0}, 'connected', {'P': 2.0}, 'end']\n", run.stderr


@pytest.mark.skipif(os.name == "nt", reason="a POSIX shell closes its standard input")
def test_standard_input_that_is_closed_is_refused():
    shell = ["sh", "-c", 'exec "$0" -c "$1" <&-', sys.executable, READ_STANDARD_INPUT]
    run = subprocess.run(shell, capture_output=True, text=True, timeout=60)
    assert "UsageError: standard input cannot be read: bad file descriptor. Give it a file or a pipe." in run.stderr


@pytest.mark.parametrize("words", ["-", "tcp://127.0.0.1:5000", "unix:s"])
def test_streams_are_refused_where_nothing_waits_for_them(monkeypatch, words):
    monkeypatch.setattr(streams, "WAITS", False)
    with pytest.raises(UsageError, match=rf"^--from {words}: Windows .* --from run\.csv\.$"):
        open_source(words, P)


@pytest.mark.parametrize(
    "words",
    ["tcp://192.168.0.10:5000", "tcp://127.0.0.1", "tcp://127.0.0.1:0", "tcp://127.0.0.1:5²", "tcp://a.b:5"],
)
def test_lines_of_another_computer_are_refused(words):
    with pytest.raises(UsageError, match=r"port|ssh -L"):
        open_source(words, P)


def test_notices_are_limited_but_not_those_that_end_a_cut():
    items = [Notice(0.0, kind, "x") for kind in ("bad", "connected", "clock") for _ in range(100)]
    given = list(Source("x", iter(items)))
    assert kinds(given).count("clock") == 100
    assert len(given) == 100 + 20 + 1
    assert "left out for a minute" in given[20].text


def test_numbers_beyond_every_limit_are_no_readings(tmp_path):
    samples, notices = read(written(tmp_path, "t [min],P [kW]\n0,1\n1e999,1\n1e307,1\n1,1e307\n2,1\n"))
    assert [len(s.loads) for s in samples if s.time < 1e6] == [1, 1, 1]
    assert "bad" in kinds(notices)


def test_what_the_journal_holds_is_left_out_and_a_clock_set_back_hides_nothing(tmp_path):
    """Rows that were there are told by their times, rows that are written now are new whatever their times are."""
    path = written(tmp_path, "t [s],P [kW]\n0,1\n1,2\n2,3\n")
    with open_source(str(path), SourceOptions(loads={"P": "kW"}, after=5.0)) as source:
        items = until(source, lambda items: len(items) > 2 and items[-1].kind == "idle")
        assert loads(items) == []
        assert "left out" in items[1].text
        with path.open("a") as file:
            file.write("3,4\n")
        items = until(source, lambda items: loads(items) == [4])
    assert kinds(items) == ["clock"]


CELLS = st.one_of(
    st.text(max_size=8), st.floats(width=32).map(str), st.sampled_from(["P [kW]", "t [s]", "1,5", '"', "{}"])
)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(rows=st.lists(st.lists(CELLS, max_size=5), max_size=12), mark=st.sampled_from(",;\t"), good=st.booleans())
def test_lines_of_any_text_give_samples_notices_or_an_error_of_ours(rows, mark, good):
    lines = Lines("run", SourceOptions(loads={"P": "kW"}, silent=1.0))
    try:
        for line in [*(["t [s]" + mark + "P [kW]"] if good else []), *map(mark.join, rows)]:
            for item in lines.take(line, 0.0):
                assert isinstance(item, (Sample, Notice))
                if isinstance(item, Sample):
                    assert all(math.isfinite(value) for value in (item.time, *item.loads.values()))
    except FitmodelsError:
        pass


PLAIN = st.one_of(st.none(), st.booleans(), st.floats(), st.text(max_size=5), st.integers())
NESTED = st.recursive(
    PLAIN, lambda x: st.lists(x, max_size=3) | st.dictionaries(st.text(max_size=4), x, max_size=4), max_leaves=10
)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(value=NESTED)
def test_json_of_any_kind_gives_samples_notices_or_an_error_of_ours(value):
    lines = Lines("tcp", SourceOptions(loads={"P": "kW"}))
    for data in ({"t": 0, "P": 1}, value, {"t": 1, "P": value}, {"t": value, "P": 1}):
        try:
            for item in lines.take(json.dumps(data)):
                assert isinstance(item, Notice) or math.isfinite(item.time)
        except FitmodelsError:
            pass


def test_a_table_without_a_condition_of_the_laws_is_refused_and_says_what_to_give():
    def first(header, **known):
        lines = Lines("run.csv", SourceOptions(loads={"P": "kW"}, needs=("V", "f", "d"), given=known))
        return [item for line in (header, "0,1,2,3,4", "1,1,2,3,4") for item in lines.take(line)]

    with pytest.raises(DataError, match=r"does not give d, .*--value d=2mm"):
        first("t [s],P [kW],V [m/min],f [mm/rev],x")
    with pytest.raises(DataError, match=r"does not give V, .*--value D=50mm"):
        first("t [s],P [kW],n [1/min],f [mm/rev],d [mm]")
    assert first("t [s],P [kW],n [1/min],f [mm/rev],d [mm]", D=50.0)
    assert first("t [s],P [kW],n [1/min],fm [mm/min],x", D=50.0, d=2.0)


def test_a_header_without_a_load_names_a_column_that_is_not_used():
    lines = Lines("run.csv", SourceOptions(loads={"P": "kW"}))
    list(lines.take("time [s],I [A],V [m/min],state"))
    with pytest.raises(DataError, match=r'--map "P=I \[A\]"'):
        list(lines.take("0,1,2,3"))


@pytest.mark.parametrize(
    ("stamps", "seconds"),
    [
        (("31.12.2026 23:59:59", "01.01.2027 00:00:01,5"), 2.5),
        (("1.3.2026 8:15:00", "1.3.2026 8:15:00.25"), 0.25),
        (("2026-03-01T08:15:00", "2026-03-01T08:15:02"), 2.0),
    ],
)
def test_dates_of_machine_logs_are_times(stamps, seconds):
    first, second = (Stamps("", "run.csv").seconds(stamp) for stamp in stamps)
    assert second - first == pytest.approx(seconds)
    assert Stamps("", "run.csv").seconds("03/01/2026 08:15:00") is None  # the month or the day may be first


def test_a_recorded_run_without_a_readable_time_says_why(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("Date,P [kW]\n" + "".join(f"03/01/2026 08:15:0{k},1.{k}\n" for k in range(5)))
    with pytest.raises(DataError, match=r"no readings below its header: line 6: '03/01/2026 08:15:04' is no time"):
        list(open_source(str(path), SourceOptions(loads={"P": "kW"}, map={"time": "Date"}, replay=math.inf)))


def test_points_between_thousands_are_read_with_a_decimal_comma():
    lines = Lines("run.csv", SourceOptions(loads={"P": "kW"}))
    items = [item for line in ("t [s];P [W]", "0,0;1.005,5", "0,5;5,5") for item in lines.take(line)]
    assert [item.loads["P"] for item in items if isinstance(item, Sample)] == pytest.approx([1.0055, 0.0055])
