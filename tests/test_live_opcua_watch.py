"""The command ``watch`` on a real OPC UA server: bad quality, clocks that are set, a server killed in mid-cut."""

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fitmodels import parameters

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import CONDITIONS, monitor, parameter_file, samples

sys.path.remove(str(Path(__file__).parent))

pytest.importorskip("asyncua")
SCRIPT = Path(__file__).parent / "opcua_machine.py"
AIR, CUT, CUTS = 2.5, 8.0, 2  # s
MINUTES = CUTS * CUT / 60
LOST = 0.5 / 60  # min after an interruption until a cut is found again: 4 interruptions
NODES = {"P": "Machine/Spindle/Power", "state": "Machine/State"}


def server(port, *words):
    """The machine as a process, and what it says first."""
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", str(SCRIPT), str(port), *words],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout.readline() in ("ready\n", "waits\n")
    return process


def tell(process, command, answer="done\n"):
    process.stdin.write(command + "\n")
    process.stdin.flush()
    assert process.stdout.readline() == answer


def trouble(first, second, rows):
    """Bad quality and clocks that are set in the first cut, a killed server in the second."""
    begun = time.time() + 0.2

    def wait(seconds):
        time.sleep(max(0.0, begun + seconds - time.time()))

    tell(first, f"play {rows} {begun}")
    for seconds, command in ((2.0, "bad power"), (3.0, "good power"), (5.0, "clock -3600"), (6.5, "clock 3600")):
        wait(AIR + seconds)
        tell(first, command)
    wait(2 * AIR + CUT + 3.0)
    first.kill()
    first.wait()
    tell(second, "", "ready\n")
    tell(second, f"play {rows} {begun}")
    wait(CUTS * (AIR + CUT) + AIR)


def watching(folder, port):
    """The command as a process, once it reads the server."""
    words = ["watch", "params.json", "--from", f"opc.tcp://127.0.0.1:{port}", "--journal", "kept", "--json"]
    words += [word for symbol, node in NODES.items() for word in ("--node", f"{symbol}={node}")]
    words += [word for symbol, value in CONDITIONS.items() for word in ("--value", f"{symbol}={value}")]
    words += ["--window", "1", "--criterion", "AW=0.25mm", "--stream", "s.jsonl"]
    process = subprocess.Popen(
        [sys.executable, "-m", "fitmodels", *words],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    end = time.monotonic() + 60
    while '"text":"connected' not in "".join(path.read_text() for path in folder.glob("kept/*.jsonl")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.1)
    return process


@pytest.mark.slow
def test_no_record_is_lost_and_the_estimate_is_that_of_the_time_in_cut(tmp_path):
    parameters.write(parameter_file(), tmp_path / "params.json")
    rows = samples(cuts=CUTS, cut=CUT, air=AIR, rate=25.0)
    (tmp_path / "rows.csv").write_text("".join(f"{s.time},{1000 * s.loads['P']:.2f},{s.state}\n" for s in rows))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    processes = [server(port), server(port, "wait")]
    try:
        processes.append(watching(tmp_path, port))
        trouble(*processes[:2], tmp_path / "rows.csv")
        processes[2].send_signal(signal.SIGINT)
        out, err = processes[2].communicate(timeout=20)
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    files = sorted(tmp_path.glob("kept/*.jsonl"))
    records = [json.loads(line) for path in files for line in path.read_text().splitlines()]
    facts, said = json.loads(out), " ".join(str(record.get("text")) for record in records)
    assert err == ""
    assert [record["n"] for record in records] == list(range(1, len(records) + 1))
    for part in ("BadSensorFailure", "P is good again", "set back by 3.6e+03", "set forward by 3.6e+03", "ALARM lost"):
        assert part in said
    lost = next(k for k, record in enumerate(records) if record["kind"] == "alarm")
    assert "connected" in str(records[lost:])
    assert MINUTES - 4 * LOST < facts["cut_minutes"] < MINUTES + 4 * LOST
    truth = monitor()
    truth.estimate.advance(MINUTES, CONDITIONS)
    assert facts["wear"]["low"] < truth.estimate.wear().median < facts["wear"]["high"]
    assert facts["probability_past"] < 0.01
