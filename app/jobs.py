"""Commands in processes of their own: started at once, two at a time, with their output so far; each can be cancelled.

Commands that write the results of one file run one after another, so that none meets what another is writing.

A process is forked from a server that has imported the package, so that a command begins without imports; where the
system has no such servers (Windows), each process imports for itself.
"""

import contextlib
import multiprocessing
import os
import secrets
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Literal

from ..core.errors import FitmodelsError
from ..core.files import cause
from ..core.threads import start_with_one

Runner = Callable[[Sequence[str]], int]

AT_ONCE = 2
GRACE = 5.0  # s between the request to stop and the end of the process
SHOWN = 200_000  # bytes of an output
KEPT = 60  # ended jobs
CANCELLED, NOT_STARTED = 130, 1  # exit codes of commands without a process: cancelled, or refused by the system
LOST = 255  # exit code of a process whose server was ended
COLUMNS = "100"
STARTED_BY_SERVER = "forkserver" in multiprocessing.get_all_start_methods()


@dataclass(slots=True)
class Job:
    """A command that waits, runs or has ended.

    Attributes
    ----------
    id : str
    words : tuple of str
        Without the program.
    started, ended : float
        Of a monotonic clock, s; 0 before.
    clock_time : float
        When it was started, s since 1970, as files state their times.
    code : int or None
        Exit code, None before the end; negative: the signal that ended it.
    cancelled : bool
    writes : str
        File whose results it writes, empty where it writes none.
    by : str
        Page that asked for it.
    check : callable or None
        Called when its turn has come; a package error from it is the reason why it is not run.
    left : str
        Checksum of the parameter files at its end.
    """

    id: str
    words: tuple[str, ...]
    out: Path
    err: Path
    started: float = 0.0
    ended: float = 0.0
    clock_time: float = 0.0
    code: int | None = None
    cancelled: bool = False
    writes: str = ""
    by: str = ""
    check: Callable[[], object] | None = None
    left: str = ""
    process: BaseProcess | None = None
    future: "Future[None]" = field(default_factory=Future, repr=False)

    @property
    def state(self) -> Literal["waiting", "running", "done", "cancelled"]:
        """State of the job."""
        if self.code is None:
            return "running" if self.started else "waiting"
        return "cancelled" if self.cancelled else "done"

    @property
    def seconds(self) -> float:
        """Seconds that it has run."""
        return (self.ended or time.monotonic()) - self.started if self.started else 0.0

    @property
    def output(self) -> str:
        """Standard output so far."""
        return _text(self.out)

    @property
    def whole_output(self) -> str:
        """Standard output of any length."""
        return _text(self.out, None)

    @property
    def errors(self) -> str:
        """Standard error so far."""
        return _text(self.err)


def _text(path: Path, most: int | None = SHOWN) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(-1 if most is None else most + 1)
    except OSError:
        return ""
    text = data[:most].decode("utf-8", "replace")
    return text if most is None or len(data) <= most else f"{text}\n... (more in a terminal)"


class Jobs:
    """Commands of one folder.

    Parameters
    ----------
    run : callable
        Runs the words of a command in the process and returns its exit code; a function of a module.
    folder : path
        In which commands run.
    preload : sequence of str
        Modules that the server of processes imports before the first command.
    ended : callable, optional
        Called with each job whose process has ended, and its exit code.
    held : callable, optional
        Returns the jobs whose output is kept; of the other ended ones that of the last 60 is.

    Examples
    --------
    >>> from fitmodels import cli
    >>> jobs = Jobs(cli.main, ".")
    >>> job = jobs.start(["--version"])
    >>> job.future.result(60), job.code, job.output.split()[0]
    (None, 0, 'fitmodels')
    >>> jobs.close()
    """

    def __init__(
        self,
        run: Runner,
        folder: str | os.PathLike[str],
        preload: Sequence[str] = (),
        ended: Callable[[Job, int], None] | None = None,
        held: Callable[[], Iterable[Job]] = tuple,
    ) -> None:
        start_with_one()
        os.environ["MPLBACKEND"] = "agg"
        self._run, self._ended, self._held, self.folder = run, ended, held, Path(folder).resolve()
        self._context: BaseContext = multiprocessing.get_context("forkserver" if STARTED_BY_SERVER else "spawn")
        if STARTED_BY_SERVER:
            self._context.set_forkserver_preload(list(preload))
        self._outputs = Path(tempfile.mkdtemp(prefix="fitmodels-app-"))
        self._pool = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="job")
        self._jobs: dict[str, Job] = {}
        self._queues: dict[str, deque[Job]] = {}  # of each file whose results are written: the first one runs
        self._lock = threading.Lock()

    def start(
        self, words: Sequence[str], writes: str = "", *, by: str = "", check: Callable[[], object] | None = None
    ) -> Job:
        """Start a command, or let it wait for the end of others.

        Parameters
        ----------
        words : sequence of str
            Without the program.
        writes : str
            File whose results it writes: it begins when the commands before it that write them have ended, also where
            one was cancelled, because a command that is asked to stop ends what it is writing.

        Raises
        ------
        RuntimeError
            The commands were closed.
        """
        name = secrets.token_hex(8)
        out, err = (self._outputs / f"{name}.{end}" for end in ("out", "err"))
        job = Job(name, tuple(words), out, err, writes=writes, by=by, check=check)
        held = {one.id for one in self._held()}
        with self._lock:
            self._jobs[name] = job
            old = [one for one in self._jobs.values() if one.code is not None and one.id not in held][:-KEPT]
            for one in old:
                del self._jobs[one.id]
                one.out.unlink(missing_ok=True)
                one.err.unlink(missing_ok=True)
            queue = self._queues.setdefault(writes or name, deque())
            queue.append(job)
            if queue[0] is job:
                self._pool.submit(self._work, job)
        return job

    def get(self, name: str) -> Job | None:
        """The job of an id."""
        return self._jobs.get(name)

    def cancel(self, job: Job) -> None:
        """Ask a command to stop, and end it where it does not; one that waits is not started."""
        with self._lock:
            if job.code is not None:
                return
            job.cancelled = True
            process = job.process
            if process is None:
                job.code = CANCELLED
                job.future.set_result(None)
        if process is not None and process.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGINT if os.name == "posix" else signal.SIGTERM)
            timer = threading.Timer(GRACE, _end, [process])
            timer.daemon = True  # `close` waits for the process
            timer.start()

    def close(self) -> None:
        """Cancel what runs, and remove the outputs."""
        for job in list(self._jobs.values()):
            self.cancel(job)
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._queues.clear()
        shutil.rmtree(self._outputs, ignore_errors=True)

    def _work(self, job: Job) -> None:
        """Run a command in a process and wait for its end, then begin the next one that writes the same results."""
        code = None
        try:
            code = self._code_of(job)
            if code is not None and self._ended is not None:
                self._ended(job, code)
        except Exception as error:
            _add(job, f"The command has ended, but it could not be recorded: {error!r}.")
        finally:
            self._after(job, NOT_STARTED if code is None else code)

    def _code_of(self, job: Job) -> int | None:
        """Exit code of a command that is run in a process; None where it was cancelled or refused before."""
        try:
            _check(job)
            process = self._process_of(job)
            if process is None:
                return None
            code = _exit_code(job, process)
            if not job.cancelled and (code < 0 or code == LOST):
                _not_ended(job, "it was ended from outside, as the system does when memory runs out")
        except FitmodelsError as refusal:
            _add(job, str(refusal))
            return None
        except Exception as error:  # the system gives no process or file
            _not_ended(job, cause(error) if isinstance(error, OSError) else repr(error))
            return None
        return code

    def _process_of(self, job: Job) -> BaseProcess | None:
        """The process of a command, not started; None for one that was cancelled."""
        with self._lock:
            if not job.cancelled:
                job.process = self._context.Process(  # type: ignore[attr-defined]
                    target=_child,
                    args=(self._run, job.words, str(self.folder), str(job.out), str(job.err)),
                    daemon=True,
                )
                job.started, job.clock_time = time.monotonic(), time.time()
            return job.process

    def _after(self, job: Job, code: int) -> None:
        """Let a command have ended."""
        with self._lock:
            is_open = job.code is None
            if is_open:
                job.ended, job.code = job.ended or time.monotonic(), code
            queue = self._queues[job.writes or job.id]
            while queue and queue[0].code is not None:
                queue.popleft()
            if queue:
                self._pool.submit(self._work, queue[0])
            else:
                del self._queues[job.writes or job.id]
        if is_open:
            job.future.set_result(None)


def _check(job: Job) -> None:
    """Ask whether a command may still be run, unless it was cancelled."""
    if job.check is not None and not job.cancelled:
        job.check()


def _exit_code(job: Job, process: BaseProcess) -> int:
    """Start the process of a command, wait for its end and give its exit code."""
    process.start()
    if job.cancelled:  # asked for while it was started
        _end(process)
    process.join()
    if process.exitcode == LOST and process.pid is not None and os.name == "posix":  # it may still write
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)
    job.ended = time.monotonic()
    return NOT_STARTED if process.exitcode is None else process.exitcode


def _not_ended(job: Job, reason: str) -> None:
    """State on standard error of a command why it was not run to its end."""
    _add(job, f"The command was not run to its end: {reason}. Run it again.")


def _add(job: Job, line: str) -> None:
    """Add a line to standard error of a command."""
    with contextlib.suppress(OSError):
        job.err.write_text(f"{job.errors}{line}\n", "utf-8")


def _end(process: BaseProcess) -> None:
    with contextlib.suppress(ValueError, ProcessLookupError):
        process.kill()


def _child(run: Runner, words: Sequence[str], folder: str, out: str, err: str) -> None:
    """Run a command with its output in files, and end with its exit code."""
    os.chdir(folder)
    os.environ["COLUMNS"] = COLUMNS
    for number, name in ((1, out), (2, err)):
        file = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(file, number)
        os.close(file)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False, buffering=1)  # noqa: SIM115  until the end
    sys.stderr = open(2, "w", encoding="utf-8", closefd=False, buffering=1)  # noqa: SIM115
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        code = run(list(words))
    except SystemExit as stop:
        code = int(stop.code or 0)
    sys.stdout.flush()
    sys.exit(code)
