"""CPU and delay of the sources of ``fitmodels watch``: 50 Hz from an OPC UA server, a growing CSV, and a fast replay.

    python benchmarks/live_sources.py [--seconds 20] [--kills 3]

A server of the tests runs as a process of its own. Printed are the share of a core that the reading process takes, the
time from the stamp of a value to its sample, values lost or doubled, and the time until a server that was killed or
stopped (SIGSTOP) is noticed and gives readings again. Aim: 50 Hz cost less than 10 % of a core.
"""

import argparse
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

from fitmodels.live.samples import Notice, Sample
from fitmodels.live.sources import SourceOptions, open_source

SERVER = Path(__file__).resolve().parent.parent / "tests" / "opcua_machine.py"
RATE = 50  # Hz
STEP = 1e-3  # kW from one value of the server to the next


class Server:
    """The server as a process."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"opc.tcp://127.0.0.1:{self.port}"
        self.start()

    def start(self):
        command = [sys.executable, "-W", "ignore", str(SERVER), str(self.port)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.process.stdout.readline()

    def kill(self):
        self.process.kill()
        self.process.communicate()


def cost(source, seconds):
    """Share of a core in percent, delays in ms, and loads, from the second second on."""
    begun, end = time.monotonic() + 2.0, time.monotonic() + 2.0 + seconds
    cpu, delays, loads = None, [], []
    for item in source:
        now = time.monotonic()
        if cpu is None and now >= begun:
            cpu = time.process_time()
        if isinstance(item, Sample) and now >= begun:
            delays.append(1000 * (time.time() - item.time))
            loads.append(item.loads.get("P"))
        if now >= end:
            break
    return 100 * (time.process_time() - cpu) / seconds, sorted(delays), loads


def report(name, used, delays, lost):
    p99 = delays[int(0.99 * (len(delays) - 1))]
    print(
        f"{name}: {len(delays)} samples, {used:.1f} % of a core, delay median {statistics.median(delays):.0f} ms, "
        f"99 % {p99:.0f} ms, lost or doubled {lost}"
    )


def opcua(seconds):
    server = Server()
    nodes = {"P": "Machine/Spindle/Power", "V": "Machine/Spindle/Speed", "f": "Machine/Spindle/Feed"}
    try:
        with open_source(server.url, SourceOptions(loads={"P": "kW"}, map=nodes)) as source:
            used, delays, loads = cost(source, seconds)
    finally:
        server.kill()
    lost = sum(abs(round((b - a) / STEP) - 1) for a, b in pairwise(loads))
    report(f"OPC UA, {RATE} Hz, 3 nodes", used, delays, lost)
    print(f"  {'under' if used < 10 else 'OVER'} the aim of 10 % of a core")


def csv(seconds):
    path = Path(tempfile.mkdtemp()) / "run.csv"
    path.write_text("time,P [kW],V [m/min],f [mm/rev]\n")
    writer = "import sys, time\nk, due = 0, time.time()\nwith open(sys.argv[1], 'a', buffering=1) as file:\n"
    writer += "    while True:\n        k += 1\n        file.write(f'{time.time():.3f},{k * 1e-3:.3f},120,0.2\\n')\n"
    writer += f"        due += {1 / RATE}\n        time.sleep(max(0.0, due - time.time()))\n"
    process = subprocess.Popen([sys.executable, "-c", writer, str(path)])
    try:
        with open_source(str(path), SourceOptions(loads={"P": "kW"})) as source:
            used, delays, loads = cost(source, seconds)
    finally:
        process.kill()
        process.wait()
    lost = sum(abs(round((b - a) / STEP) - 1) for a, b in pairwise(loads))
    report(f"growing CSV, {RATE} Hz", used, delays, lost)


def replay(rows):
    path = Path(tempfile.mkdtemp()) / "run.csv"
    with path.open("w") as file:
        file.write("t [s],P [kW],V [m/min],f [mm/rev],d [mm]\n")
        file.writelines(f"{k / RATE:.2f},{1 + k % 97 * 1e-3:.3f},120,0.2,2\n" for k in range(rows))
    begun = time.process_time()
    with open_source(str(path), SourceOptions(loads={"P": "kW"}, replay=float("inf"))) as source:
        found = sum(isinstance(item, Sample) for item in source)
    used = time.process_time() - begun
    print(f"replay: {found} of {rows} rows in {used:.1f} s CPU, {1e6 * used / rows:.1f} us a row, "
          f"{rows / RATE / used:.0f} times as fast as recorded")  # fmt: skip


def recovery(kills):
    """Time until a killed and a stopped server is lost, and until readings come again."""
    server = Server()
    options = SourceOptions(loads={"P": "kW"}, map={"P": "Machine/Spindle/Power"})
    found = {"killed": [], "restarted": [], "stopped": [], "continued": []}

    def wait(source, condition):
        begun = time.monotonic()
        for item in source:
            if condition(item):
                return time.monotonic() - begun
        raise RuntimeError("the source ended")

    def lost(item):
        return isinstance(item, Notice) and item.kind == "lost"

    def given(item):
        return isinstance(item, Sample) and bool(item.loads)

    try:
        with open_source(server.url, options) as source:
            wait(source, given)
            for _ in range(kills):
                threading.Timer(0.0, server.kill).start()
                found["killed"].append(wait(source, lost))
                server.start()
                found["restarted"].append(wait(source, given))
                os.kill(server.process.pid, signal.SIGSTOP)
                found["stopped"].append(wait(source, lost))
                os.kill(server.process.pid, signal.SIGCONT)
                found["continued"].append(wait(source, given))
    finally:
        server.kill()
    for what, times in found.items():
        print(f"server {what}: {'lost' if what in ('killed', 'stopped') else 'readings'} after "
              f"{statistics.median(times):.2f} s (median of {len(times)}), at most {max(times):.2f} s")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--rows", type=int, default=500_000)
    given = parser.parse_args()
    opcua(given.seconds)
    csv(given.seconds)
    replay(given.rows)
    recovery(given.kills)


if __name__ == "__main__":
    main()
