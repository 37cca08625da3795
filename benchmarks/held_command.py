"""Commands that run up to their first change of the file system; copies of them that are killed or fail after it."""

import errno
import hashlib
import json
import mmap
import os
import shlex
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # a copy has only the thread that makes it
LONGEST = 120.0  # s of a command
MAKING = ("open", "os.mkdir", "os.rename", "os.link", "os.symlink", "fsync")  # fail on a full disk
CHANGING = (*MAKING, "getpid", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "os.utime", "fcntl.flock")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


@dataclass
class Watch:
    """Audit hook that counts the calls of a command that change files below a folder, and acts at one of them."""

    top: str
    wait: Callable[["Watch"], None]  # called before the first change
    shared: mmap.mmap = field(default_factory=lambda: mmap.mmap(-1, 16))
    begun: bool = False
    active: bool = True
    moment: tuple[str, float] = ("count", 0.0)

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        """Called by Python before each call that it audits."""
        if self.active and event in CHANGING and self._inside(event, args):
            self.active = False
            try:
                self._change(event)
            finally:
                self.active = True

    def _inside(self, event: str, args: tuple[Any, ...]) -> bool:
        if event == "open" and not (isinstance(args[2], int) and args[2] & WRITES) and not _is_folder(args):
            return False
        path = args[0] if args else None
        if (
            event in ("fcntl.flock", "fsync", "getpid")
            or isinstance(path, int)
            or path is None
            or any(isinstance(other, int) and other >= 0 for other in args[1:] if event in ("os.remove", "os.rmdir"))
        ):
            return True
        return f"{Path.cwd() / os.fsdecode(path)}/".startswith(self.top)  # also the work place itself

    def _change(self, event: str) -> None:
        if not self.begun:
            self.begun = True
            self.wait(self)
        calls, free = struct.unpack("qq", self.shared[:16])
        disk = os.statvfs(self.top)
        kind, at = self.moment
        self.shared[:16] = struct.pack("qq", calls + 1, min(free, disk.f_bavail * disk.f_frsize))
        if kind == "call" and calls >= at:
            os.kill(os.getpid(), signal.SIGKILL)
        if event in MAKING and ((kind == "fails" and calls >= at) or (kind == "fails once" and calls == at)):
            raise OSError(errno.ENOSPC, "No space left on device")


def _is_folder(args: tuple[Any, ...]) -> bool:
    """Whether os.open opens a folder: to lock it, and copies that share the open folder would share the lock."""
    return args[1] is None and isinstance(args[0], (str, Path)) and Path(args[0]).is_dir()


def execute(words: str, log: Path) -> int:
    """Exit code of a command in this process, with its output in a file."""
    from fitmodels import cli

    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(out, stream)
    try:
        code = cli.main(shlex.split(words))
    except BaseException:
        traceback.print_exc()
        code = 70
    sys.stdout.flush()
    sys.stderr.flush()
    return code


def draw_fast() -> None:
    """Replace pictures in PNG files by small ones that differ where what is drawn differs: drawing takes most time."""
    import numpy as np
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text
    from PIL import Image

    save = Figure.savefig

    def saved(figure: Figure, file: Any, **options: Any) -> None:
        name = "png" if hasattr(file, "write") else Path(file).suffix[1:]
        if options.get("format", name) != "png":
            save(figure, file, **options)
            return
        found = hashlib.sha256()
        for line in figure.findobj(Line2D):
            found.update(np.asarray(line.get_xydata()).tobytes())
        for text in figure.findobj(Text):
            found.update(text.get_text().encode("utf-8", "replace"))
        Image.frombytes("L", (16, 16), found.digest() * 8).save(file, format="png")

    Figure.savefig = saved  # type: ignore[method-assign]


def forked(work: Callable[[], int]) -> int:
    """Process that runs a function and ends with what it returns."""
    sys.stdout.flush()
    if pid := os.fork():
        return pid
    code = 71
    try:
        code = work()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def ended(pid: int, within: float = LONGEST, kill: bool = False) -> int:
    """Exit code of a process, negative of a signal; it is killed after ``within`` s, -99 where that is not ``kill``."""
    end = time.monotonic() + within
    while (found := os.waitpid(pid, os.WNOHANG))[0] == 0:
        if time.monotonic() > end:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            return -signal.SIGKILL if kill else -99
        time.sleep(0.0005)
    return os.waitstatus_to_exitcode(found[1])


class Held:
    """A command that stands before its first change, from which copies run on.

    Attributes
    ----------
    changes : bool
        False where it ended without a change.
    """

    def __init__(self, words: str, work: Path, log: Path) -> None:
        asked, self._ask = os.pipe()
        self._hear, said = os.pipe()
        self.shared = mmap.mmap(-1, 16)

        def command() -> int:
            os.close(self._ask)
            os.close(self._hear)
            os.chdir(work)
            watch = Watch(f"{work}/", partial(_copies, os.fdopen(asked, "rb"), said, log), self.shared)
            _replace_functions(watch)
            sys.addaudithook(watch)
            return execute(words, log)

        self._pid = forked(command)
        os.close(said)
        os.close(asked)
        self.changes = os.read(self._hear, 1) == b"+"

    def run(self, kind: str, at: float) -> tuple[int, float, int, int]:
        """Exit code, seconds, changing calls and least free bytes of a copy to which one thing happens."""
        self.shared[:16] = struct.pack("qq", 0, 1 << 62)
        os.write(self._ask, json.dumps([kind, at]).encode() + b"\n")
        code, seconds = struct.unpack("qd", os.read(self._hear, 16))
        return code, seconds, *struct.unpack("qq", self.shared[:16])

    def end(self) -> int:
        """Let the command go, and give its exit code where it made no change."""
        os.close(self._ask)
        os.close(self._hear)
        return ended(self._pid)


def _replace_functions(watch: Watch) -> None:
    """Let `watch` hear of fsync, and before a temporary file is named by the number of its process."""
    fsync, getpid = os.fsync, os.getpid

    def heard_fsync(descriptor: int) -> None:
        watch("fsync", (descriptor,))
        fsync(descriptor)

    def heard_getpid() -> int:
        if sys._getframe(1).f_globals.get("__name__", "").startswith("fitmodels"):
            watch("getpid", ())
        return getpid()

    os.fsync, os.getpid = heard_fsync, heard_getpid  # type: ignore[assignment]


def _copies(asked: Any, said: int, log: Path, watch: Watch) -> None:
    """Copies of this process, one after the other as asked; returns in each of them."""
    os.write(said, b"+")
    while line := asked.readline():
        kind, at = json.loads(line)
        log.write_bytes(b"")
        begin = time.perf_counter()
        if not (pid := os.fork()):
            watch.moment = (kind, at)
            return
        code = ended(pid, at if kind == "time" else LONGEST, kill=kind == "time")
        os.write(said, struct.pack("qd", code, time.perf_counter() - begin))
    os._exit(0)
