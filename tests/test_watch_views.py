"""What shows a watch: terminal, page on the loopback, OPC UA server and JSON stream say the same facts, harmlessly."""

import http.client
import io
import json
import os
import sys
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import pytest
from fitmodels.core.errors import FitmodelsError, UsageError
from fitmodels.live.facts import Reading, facts_of
from fitmodels.live.page import Page
from fitmodels.live.server import NAMESPACE, VALUES, OpcUaServer, address_of
from fitmodels.live.stream import JsonLines, file_writer
from fitmodels.live.view import PlainLines, rows, screen

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import CONDITIONS, monitor, records

sys.path.remove(str(Path(__file__).parent))

HOSTILE = "T\x1b[2J<img src=x onerror=alert(1)>\u202e"


@pytest.fixture(scope="module")
def facts():
    found = monitor()
    for record in records(30):
        found.apply(record)
    found.apply({"kind": "alarm", "time": 300.0, "kind_of_alarm": "lost", "text": f"lost: {HOSTILE}", "latched": True})
    source = {"name": HOSTILE, "state": "connected", "text": "", "age": 0.1}
    now = Reading(300.0, "cutting", 0.1, CONDITIONS, {"P": 2.5}, source, {"file": "a.jsonl", "records": 7, "fault": ""})
    return facts_of(found, now)


def shown(block, width=100):
    from rich.console import Console

    out = io.StringIO()
    Console(file=out, width=width, force_terminal=False).print(block)
    return out.getvalue()


@pytest.mark.parametrize("width", [60, 100])
def test_the_terminal_shows_every_fact_without_control_characters(facts, width):
    text = shown(screen(facts), width)
    assert all(character == "\n" or character.isprintable() for character in text)
    assert len(text.splitlines()) <= 32
    for words in (
        "AW",
        "criterion",
        "min of cutting left",
        "probability",
        "simulated",
        "ALARM",
        "shadow mode",
        "Go on",
    ):
        assert words in " ".join(text.split())


def test_plain_lines_follow_the_clock_of_the_source(facts):
    lines = []
    plain = PlainLines(lines.append)
    for time in (0.0, 10.0, 59.0, 61.0, 62.0):
        plain.report(lambda: facts, ["Go on."] if time == 10.0 else [], time)
    assert len(lines) == 3
    assert lines[1] == "0:00:10  Go on."


def asked(page, path, **headers):
    host, port = page.address.split("/")[2].split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=5)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def test_the_page_gives_the_facts_to_who_knows_the_token_and_names_the_loopback(facts):
    page = Page()
    try:
        page.show(facts)
        path = "/" + page.address.split("/", 3)[3]
        status, headers, content = asked(page, path)
        assert status == 200
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert b"http:" not in content.replace(b"http://www.w3.org/2000/svg", b"")
        given = json.loads(asked(page, f"{path}facts.json")[2])
        assert {name: given[name] for name in ("wear", "life", "loads", "state")} == {
            name: facts[name] for name in ("wear", "life", "loads", "state")
        }
        elsewhere = ("wear", "", "life", "risk", "load")
        labels = [label for label, _ in rows(facts) if label not in elsewhere]
        assert [label for label, _ in given["rows"]] == labels
        port = page.address.split("/")[2].split(":")[1]
        assert asked(page, path, Host=f"evil.example:{port}")[0] == 421
        assert {asked(page, wrong)[0] for wrong in ("/", "/facts.json", "/x/facts.json", f"{path}../x", "/%00")} == {
            404
        }
    finally:
        page.close()


def test_a_port_that_is_taken_is_refused():
    page = Page()
    try:
        with pytest.raises(UsageError, match="--page"):
            Page(int(page.address.split(":")[2].split("/")[0]))
    finally:
        page.close()


def test_the_curve_of_wear_is_bounded(facts):
    page = Page()
    try:
        for k in range(2000):
            page._remember({**facts, "cut_minutes": float(k)})
        assert len(page._history) <= 401
        assert page._history[-1][0] == 1999.0
    finally:
        page.close()


def test_a_stream_is_lines_of_json_without_control_characters(facts, tmp_path):
    stream = JsonLines(file_writer(tmp_path / "s.jsonl"))
    stream.report(lambda: facts, ["Go on."], 1.0)
    stream.show(facts)
    (line,) = (tmp_path / "s.jsonl").read_text("utf-8").splitlines()
    assert line.isprintable()
    assert json.loads(line)["wear"] == facts["wear"]
    assert json.loads(line)["said"] == ["Go on."]
    with pytest.raises(UsageError, match="--stream"):
        file_writer(tmp_path / "nowhere" / "s.jsonl")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_stream_into_a_pipe_waits_for_no_reader(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(UsageError, match="no program reads this pipe; start the reader first"):
        file_writer(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write = file_writer(pipe)
        lines = [f"{number:06d} {'x' * 993}\n" for number in range(400)]  # more than a pipe holds
        for line in lines:
            write(line)
        first = os.read(reader, 1_000_000).decode()
        write("the end\n")
        whole = (first + os.read(reader, 1_000_000).decode()).splitlines(keepends=True)
    finally:
        os.close(reader)
    assert 10 < len(whole) < len(lines)
    assert whole[:-1] == lines[: len(whole) - 1]  # no line is torn
    assert whole[-1] in ("the end\n", lines[len(whole) - 1])


def test_a_value_that_cannot_be_published_ends_the_server_as_an_outlet(facts):
    server = OpcUaServer.__new__(OpcUaServer)
    server._busy, server._last, server._thread = False, Future(), SimpleNamespace(is_alive=lambda: True)
    server._last.set_exception(OSError("the node is gone"))
    with pytest.raises(FitmodelsError, match="the node is gone"):
        server.show(facts)


@pytest.mark.parametrize(
    "words", ["127.0.0.1:4841", "opc.tcp://0.0.0.0:4841", "opc.tcp://shop.example:4841", "http://a"]
)
def test_an_address_that_others_can_reach_is_refused(words):
    with pytest.raises(UsageError, match="--serve"):
        address_of(words)


@pytest.mark.filterwarnings("ignore::DeprecationWarning:asyncua")
def test_the_opc_ua_server_can_be_read_and_not_written(facts, free_port):
    import asyncio

    from asyncua import Client, ua

    server = OpcUaServer(address_of(f"opc.tcp://127.0.0.1:{free_port}"))

    async def read():
        async with Client(server.address, timeout=5) as client:
            index = await client.get_namespace_index(NAMESPACE)
            nodes = {name: client.get_node(f"ns={index};s=fitmodels.{name}") for name in VALUES}
            empty = await nodes["wear"].read_data_value(raise_on_bad_status=False)
            server.show(facts)
            for _ in range(100):
                await asyncio.sleep(0.02)
                values = {name: await node.read_data_value(raise_on_bad_status=False) for name, node in nodes.items()}
                if values["facts"].Value.Value not in (None, ""):
                    break
            refused = []
            for name in ("wear", "state"):
                try:
                    await nodes[name].write_value(1.0 if name == "wear" else "x")
                except ua.UaError as error:
                    refused.append(type(error).__name__)
            return empty, values, refused

    try:
        empty, values, refused = asyncio.run(read())
        assert not empty.StatusCode.is_good()
        assert values["wear"].Value.Value == facts["wear"]["median"]
        assert json.loads(values["facts"].Value.Value)["life"] == facts["life"]
        assert refused == ["BadUserAccessDenied"] * 2
        with pytest.raises(UsageError, match="another port"):
            OpcUaServer(server.address)
    finally:
        server.close()


@pytest.fixture
def free_port():
    """A port that nothing listens on."""
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_long_life_is_shown_in_whole_minutes(facts):
    long = {**facts, "life": {**facts["life"], "low": 1000.4, "median": 3000.4, "high": 9000.4}}
    assert "3000 (1000 to 9000) min" in PlainLines(lambda line: None).line(long)
    assert "3000 min" in shown(screen(long))
