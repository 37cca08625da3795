"""OPC UA on the loopback: a real server that is killed, stopped, bad, and set to another time."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID
from fitmodels.core.errors import DataError, UsageError
from fitmodels.live.samples import Notice, Sample
from fitmodels.live.sources import SourceOptions, opcua, open_source
from fitmodels.live.sources.channels import channels_for
from fitmodels.live.sources.merging import Merger, Reading
from fitmodels.live.sources.opcua import check_security
from fitmodels.live.sources.opcua_nodes import _nearest

pytest.importorskip("asyncua")
SCRIPT = Path(__file__).parent / "opcua_machine.py"
NODES = {"P": "Machine/Spindle/Power", "V": "Machine/Spindle/Speed", "f": "ns=2;s=feed"}


class Machine:
    """The server as a process."""

    def __init__(self, *words):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.words = words
        self.start()

    @property
    def url(self):
        return f"opc.tcp://127.0.0.1:{self.port}"

    def start(self):
        self.process = subprocess.Popen(
            [sys.executable, "-W", "ignore", str(SCRIPT), str(self.port), *self.words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout.readline() == "ready\n"

    def do(self, command):
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "done\n"

    def kill(self):
        self.process.kill()
        self.process.communicate()


@contextmanager
def machine(*words):
    made = Machine(*words)
    try:
        yield made
    finally:
        made.kill()


@contextmanager
def source(url, **options):
    given = {"loads": {"P": "kW"}, "map": NODES, **options}
    with open_source(url, SourceOptions(**given)) as opened:
        yield opened


def until(items, condition, seconds=10.0):
    """Items up to the one that ends a condition; fails after some seconds."""
    seen, end = [], time.monotonic() + seconds
    for item in items:
        seen.append(item)
        if condition(item, seen):
            return seen
        assert time.monotonic() < end, [i for i in seen if not isinstance(i, Sample)]
    raise AssertionError("the source ended")


def kind(name):
    return lambda item, seen: isinstance(item, Notice) and item.kind == name


def samples(count):
    return lambda item, seen: sum(isinstance(i, Sample) and bool(i.loads) for i in seen) >= count


def powers(items):
    return [round(1000 * i.loads["P"]) for i in items if isinstance(i, Sample) and "P" in i.loads]


def kinds(items):
    return [i.kind for i in items if isinstance(i, Notice) and i.kind != "idle"]


@pytest.fixture(scope="module")
def running():
    with machine("model") as made:
        yield made


def test_every_value_comes_once_with_units_and_the_companion_model(running):
    with source(running.url) as items:
        first = until(items, kind("connected"))[-1].text
        seen = until(items, samples(60))
    values = powers(seen)
    assert values == list(range(values[0], values[0] + len(values)))
    assert kinds(seen) == []
    sample = seen[-1]
    assert sample.conditions == {"V": 120.0, "f": 0.2, "override": 1.0}
    assert (sample.state, sample.tool) == ("unknown", "7")
    assert abs(sample.time - time.time()) < 1.0
    for part in ("P from 'Machine/Spindle/Power'", "V: m/min is assumed", "state from 'Machine/Monitoring/Channel1"):
        assert part in first
    assert "kW is assumed" not in first  # its engineering unit is W


def test_a_connection_that_lasts_is_not_taken_for_lost(running, monkeypatch):
    monkeypatch.setattr(opcua, "BEHIND", 0.3)
    monkeypatch.setattr(opcua, "CHECK", 0.1)
    with source(running.url) as items:
        assert kinds(until(items, samples(100))) == ["connected"]


def test_a_subscription_that_gives_nothing_is_lost(running, monkeypatch):
    monkeypatch.setattr(opcua, "BEHIND", 0.3)
    monkeypatch.setattr(opcua._Handler, "datachange_notification", lambda *_: None)
    with source(running.url) as items:
        assert "no notification" in until(items, kind("lost"))[-1].text


def test_of_several_nodes_the_nearest_is_taken():
    paths = ["A/Monitoring/MachineTool/O", "A/Monitoring/Channel1/O", "B/Monitoring/Channel1/O"]
    nodes = [(path, None) for path in paths]
    assert _nearest(nodes, ["A/Monitoring/Channel1/ChannelState", "A/Power"]) == [nodes[1]]
    assert _nearest(nodes, ["A/Power"]) == nodes[:2]
    assert _nearest(nodes, ["ns=2;s=power"]) == nodes


def test_state_and_override_of_the_model(running):
    nodes = {**NODES, "f": "none", "f_set": "Machine/Spindle/Feed"}
    with source(running.url, map=nodes) as items:
        until(items, samples(3))
        running.do("set state 2")
        running.do("set override 50")
        seen = until(items, lambda item, seen: isinstance(item, Sample) and item.conditions.get("override") == 0.5)
        seen += until(items, samples(20))
        running.do("set state 0")
        running.do("set override 100")
    assert seen[-1].state == "idle"
    assert seen[-1].conditions["f"] == pytest.approx(0.1)


def test_two_loads_written_together_are_one_sample(running):
    loads = {"P": "kW", "Fc": "N"}
    with source(running.url, loads=loads, map={**NODES, "Fc": "Machine/Spindle/Force"}) as items:
        seen = [i for i in until(items, samples(60)) if isinstance(i, Sample) and i.loads]
    whole = [i for i in seen if len(i.loads) == 2]
    assert len(whole) > 0.9 * len(seen)
    assert all(round(1000 * i.loads["P"] - i.loads["Fc"]) == 500 for i in whole)


def test_bad_is_held_until_good(running):
    for command in ("bad", "uncertain"):
        with source(running.url) as items:
            until(items, samples(5))
            running.do(f"{command} power")
            seen = until(items, kind("bad"))
            spell = until(items, lambda item, seen: sum(isinstance(i, Sample) for i in seen) >= 3)
            running.do("good power")
            after = until(items, kind("connected"))
            until(items, samples(5))
        assert "Sensor" in seen[-1].text
        assert all(not i.loads and "Sensor" in i.bad for i in spell if isinstance(i, Sample))
        assert after[-1].text == "P is good again"


def test_a_load_that_does_not_change_is_given_all_the_same(running):
    with source(running.url) as items:
        until(items, samples(5))
        running.do("hold")
        seen = until(items, samples(5))
        running.do("go")
        until(items, samples(30))
    values = powers(seen)[-3:]
    times = [i.time for i in seen if isinstance(i, Sample)][-3:]
    assert len(set(values)) == 1
    assert all(0.3 < b - a < 1.0 for a, b in pairwise(times))
    assert "gap" not in kinds(seen)


def test_clocks_that_are_set_are_noticed(running):
    with source(running.url) as items:
        until(items, samples(20))
        for shift, text in ((-3600, "back by 3.6e+03"), (3600, "forward by 3.6e+03")):
            running.do(f"clock {shift}")
            assert text in until(items, kind("clock"))[-1].text
            assert kinds(until(items, samples(20))) == []


@pytest.mark.slow
def test_a_server_that_is_killed_or_hangs_is_lost_and_comes_back(monkeypatch):
    monkeypatch.setattr(opcua, "ANSWER", 0.8)
    monkeypatch.setattr(opcua, "AGAIN", 0.2)
    with machine() as made, source(made.url) as items:
        before = until(items, samples(20))
        killed = time.monotonic()
        made.kill()
        before += until(items, kind("lost"))
        assert time.monotonic() - killed < 3.0
        assert until(items, kind("idle"))
        made.start()
        began = time.monotonic()
        again = until(items, samples(20))
        assert time.monotonic() - began < 5.0
        os.kill(made.process.pid, signal.SIGSTOP)
        stopped = time.monotonic()
        hung = until(items, kind("lost"))
        assert time.monotonic() - stopped < 6.0
        os.kill(made.process.pid, signal.SIGCONT)
        until(items, samples(20))
    assert kinds(before) == ["connected", "lost"]
    assert kinds(again)[:1] == ["connected"]
    assert kinds(hung)[-1] == "lost"
    for part in (before, again):  # a new server counts from its beginning
        values = powers(part)
        assert values == sorted(set(values))


def test_a_server_that_is_not_there_is_lost_not_an_error():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"opc.tcp://127.0.0.1:{free.getsockname()[1]}"
    with source(url) as items:
        assert "refused" in until(items, kind("lost"))[-1].text


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ({"P": "Machine/Spindel/Power"}, "Did you mean 'Spindle'?"),
        ({"P": "ns=2;s=nowhere"}, "has no such node"),
        ({"P": "Machine/Spindle"}, "is no variable; it holds Power, Force"),
        ({"V": "Machine/Spindle/Speed"}, "has 'Machine/Spindle/Power'. Give it with --node P=Machine/Spindle/Power"),
        ({"Fc": "Machine/Spindle/Power"}, "is in W, and Fc in N"),
    ],
)
def test_a_wrong_node_is_refused_with_a_remedy(running, nodes, message):
    loads = {"Fc": "N"} if "Fc" in nodes else {"P": "kW"}
    with pytest.raises(DataError) as refused, source(running.url, map=nodes, loads=loads) as items:
        until(items, samples(1))
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("url", "options", "message"),
    [
        ("opc.tcp://192.168.0.10:4840", {}, "is not this computer"),
        ("opc.tcp://machine:4840", {"user": "a"}, "signed and encrypted"),
        ("opc.tcp://a:b@127.0.0.1:4840", {}, "password in an address"),
        ("opc.tcp://127.0.0.1", {}, "give host and port"),
        ("opc.tcp://127.0.0.1:4840", {"certificate": Path("a.pem")}, "together"),
        ("opc.tcp://127.0.0.1:4840", {"password_file": Path("nowhere")}, "nowhere"),
    ],
)
def test_an_open_connection_off_the_loopback_is_refused(url, options, message):
    with pytest.raises(UsageError, match=message):
        check_security(url, SourceOptions(loads={"P": "kW"}, **options))


def certificate(folder, name):
    """Write a self-signed certificate and its key."""
    key = rsa.generate_private_key(65537, 2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    uri = x509.SubjectAlternativeName([x509.UniformResourceIdentifier(f"urn:fitmodels:test:{name}")])
    now = datetime.now(UTC)
    made = x509.CertificateBuilder(
        subject, subject, key.public_key(), x509.random_serial_number(), now - timedelta(1), now + timedelta(1)
    )
    made = made.add_extension(uri, critical=False).sign(key, SHA256())
    (folder / f"{name}.pem").write_bytes(made.public_bytes(Encoding.PEM))
    text = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    (folder / f"{name}-key.pem").write_bytes(text)
    return {"certificate": folder / f"{name}.pem", "key": folder / f"{name}-key.pem"}


@pytest.mark.slow
def test_a_connection_is_signed_and_encrypted(tmp_path):
    """Only with the certificate of the server: another one, and none, are not connected."""
    certificate(tmp_path, "server")
    own = certificate(tmp_path, "client")
    with machine(str(tmp_path)) as made:
        with source(made.url, **own, server_certificate=tmp_path / "server.pem") as items:
            assert len(powers(until(items, samples(10)))) == 10
        with source(made.url, **own, server_certificate=tmp_path / "client.pem") as items:
            until(items, kind("lost"))
        with source(made.url) as items:
            until(items, kind("lost"))


def test_a_condition_of_bad_quality_is_no_number_and_a_silent_one_is_as_it_was():
    found = channels_for({"P": ("p", "kW"), "V": ("v", "m/min")}, SourceOptions(loads={"P": "kW"}), "x")
    merger, out = Merger(found), []
    for reading in (Reading(1, 0.0, 150.0, "", 0.0), *(Reading(0, k, 1.0 + k, "", k) for k in (0.0, 1.0))):
        out += merger.add(reading)
    for reading in (Reading(1, 2.0, None, "BadSensorFailure", 2.0), Reading(0, 2.0, 3.0, "", 2.0)):
        out += merger.add(reading)
    out += merger.take(float("inf"))
    given = [item.conditions["V"] for item in out if isinstance(item, Sample)]
    assert given == pytest.approx([150.0, 150.0, float("nan")], nan_ok=True)


def test_loads_of_different_times_are_not_lost_and_not_mixed():
    found = channels_for(
        {"P": ("p", "kW"), "Fc": ("f", "N"), "V": ("v", "m/min")}, SourceOptions(loads={"P": "kW", "Fc": "N"}), "x"
    )
    merger, out = Merger(found), []
    for k in range(50):
        now = k * 0.05
        out += merger.add(Reading(0, now, float(k), "", now))
        out += merger.add(Reading(1, now + (0.005 if k < 25 else 0.02), 10.0 + k, "", now))
        out += merger.take(now)
    out += merger.take(float("inf"))
    values = [i for i in out if isinstance(i, Sample)]
    assert [i for i in out if isinstance(i, Notice)] == []
    assert [i.loads["P"] for i in values if "P" in i.loads] == list(range(50))
    assert [i.loads["Fc"] for i in values if "Fc" in i.loads] == [10.0 + k for k in range(50)]
    assert all(i.loads["Fc"] - i.loads["P"] == 10 for i in values if len(i.loads) == 2)
    assert sum(len(i.loads) == 2 for i in values) == 25
