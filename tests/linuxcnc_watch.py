"""The whole LinuxCNC with a program of fitmodels beside it: started, killed and reset by the user interface.

It is the machine of `linuxcnc_machine`, but for the heartbeat of the controller, which is that of the program: the
plant's own becomes ``fm-source-heartbeat``. The operator clears a fault once, a second after it began.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import linuxcnc_machine
import numpy as np
from linuxcnc_machine import Run


@dataclass(frozen=True)
class Beside:
    """A program beside the machine.

    Attributes
    ----------
    command : sequence of str
        Its words; the working folder holds the ``files``.
    files : dict
        Name -> text.
    kill_at : float
        s after the first contact at which SIGKILL (``"kill"``) or SIGSTOP (``"stop"``) is sent to it.
    resets : int
        Faults that the operator clears.
    """

    command: Sequence[str]
    files: dict[str, str]
    kill_at: float = 1e9
    signal: str = "KILL"
    resets: int = 1


def run_beside(run: Run, beside: Beside, plant: Path) -> tuple[dict[str, np.ndarray], str]:
    """Trace of the machine, and what the program printed.

    Raises
    ------
    RuntimeError
        LinuxCNC did not end as it should.
    """
    folder = Path(tempfile.mkdtemp(prefix="fitmodels-watch-"))
    try:
        folder.chmod(0o777)
        linuxcnc_machine._write(run, folder, plant)
        wires = (folder / "wires.hal").read_text()
        wires = wires.replace("net fm-heartbeat fmplant", "net fm-source-heartbeat fmplant")
        (folder / "wires.hal").write_text(wires.replace("net fm-reset fmplant.0.reset\n", ""))
        (folder / "driver.py").write_text(_DRIVER)
        settings = [*beside.command, "", repr(beside.kill_at), beside.signal, str(beside.resets)]
        for name, text in {**beside.files, "beside.txt": "\n".join(settings)}.items():
            (folder / name).write_text(text)
            (folder / name).chmod(0o666)
        inside = ["bash", "-c", _INSIDE, str(folder), str(int(run.duration + 60)), *_hidden()]
        said = subprocess.run(
            [*linuxcnc_machine._namespaces(), *inside],
            capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=run.duration + 90,
        )  # fmt: skip
        printed = folder / "printed.txt"
        words = printed.read_text() if printed.exists() else ""
        return linuxcnc_machine._trace(folder, run.duration, said.stdout + said.stderr + words), words
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _hidden() -> list[str]:
    """Folders of this Python below /tmp, which the machine hides behind one of its own."""
    import fitmodels

    used = [sys.executable, sys.prefix, sys.base_prefix, *sys.path, *fitmodels.__path__]
    resolved = [path for each in used for path in (each, os.path.realpath(each))]
    parts = [Path(path).parts for path in resolved]
    return sorted({str(Path(*of[:3])) for of in parts if of[:2] == ("/", "tmp") and len(of) > 2})


_INSIDE = """
ip link set lo up 2>/dev/null || true
folder=$0; limit=$1; shift
mount --bind "$folder/modules" /usr/lib/linuxcnc/modules || exit 90
mount --bind "$folder" /mnt || exit 91
mkdir -p /mnt/tmp && mount --bind /tmp /mnt/tmp && mount -t tmpfs -o mode=1777 none /tmp || exit 92
for hidden in "$@"; do
    [ -d "/mnt/$hidden" ] && mkdir -p "$hidden" && { mount --bind "/mnt/$hidden" "$hidden" || exit 93; }
done
chmod 777 /mnt; cd /mnt
[ "$(id -u)" = 0 ] && export RTAPI_UID=65534
exec env -u DISPLAY HOME=/mnt/home RTAPI_FIFO_PATH=/tmp/fifo timeout -k 5 "$limit" linuxcnc -r machine.ini </dev/null
"""

_DRIVER = (
    linuxcnc_machine._SWITCHED_ON
    + """\
def get(name):
    return subprocess.run(["halcmd", name[0], name[1]], capture_output=True, text=True).stdout.strip()


duration, override = map(float, open("run.txt").read().split())
*words, _, kill_at, name, resets = open("beside.txt").read().split("\\n")
printed = open("printed.txt", "w")
program = subprocess.Popen(words, stdout=printed, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
do(command.feedrate, override)
do(command.mode, linuxcnc.MODE_AUTO)
do(command.program_open, "/mnt/program.ngc")
command.auto(linuxcnc.AUTO_RUN, 0)
errors = linuxcnc.error_channel()
kill_at, resets, fault_since = float(kill_at), int(resets), None
while True:
    now = float(get(("getp", "fmplant.0.seconds")) or 0)
    if now >= kill_at:
        kill_at = 1e9
        program.send_signal(getattr(signal, "SIG" + name))
    if now > duration + 0.1:
        break
    if resets and now == 0 and get(("gets", "fm-fault")) == "TRUE":
        fault_since = fault_since or time.time()
        if time.time() - fault_since > 1.0 and get(("gets", "fm-dead")) == "FALSE":
            resets, fault_since = resets - 1, None
            subprocess.run(["halcmd", "sets", "fm-reset", "TRUE"])
            time.sleep(0.1)
            subprocess.run(["halcmd", "sets", "fm-reset", "FALSE"])
    else:
        fault_since = None
    said = errors.poll()
    if said:
        print("LinuxCNC:", said, flush=True)
    time.sleep(0.05)
program.kill()
program.wait()
sampler.send_signal(signal.SIGINT)
sampler.wait()
sys.exit(0)
"""
)
