"""Three engines, one behaviour: results, order, what is lost, how it ends."""

import io
import json
import math
import operator
import os
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from itertools import count, islice
from pathlib import Path

import fitmodels
import pytest
from fitmodels.batch.engine import dask_cluster as by_dask
from fitmodels.batch.engine import dask_scheduler as same_versions
from fitmodels.batch.engine import engine, largest_memory
from fitmodels.batch.engine.dask_scheduler import scheduler_address
from fitmodels.batch.engine.joblib_processes import AHEAD, processes
from fitmodels.core.errors import FitmodelsError, UsageError
from fitmodels.core.progress import Meter, progress_bar
from fitmodels.core.threads import ONE_THREAD, cores
from hypothesis import given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.slow  # processes and clusters
progress_module = sys.modules["fitmodels.core.progress"]
needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")


@pytest.fixture(scope="module")
def local():
    """A Dask cluster of two processes."""
    with engine(2, "local") as run:
        yield run


@pytest.fixture(scope="module")
def two():
    """Two processes of joblib."""
    with engine(2) as run:
        yield run


@pytest.fixture(params=["here", "two", "local"])
def run(request):
    """Each engine in turn."""
    if request.param == "here":
        with engine() as here:
            yield here
    else:
        yield request.getfixturevalue(request.param)


def test_a_cluster_of_ones_own_leaves_the_environment_as_it_was(monkeypatch):
    """Dask's nanny writes its own variables into the process that starts it; one of them slows a fit."""
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)
    before = dict(os.environ)
    with engine(1, "local") as run:
        assert run.map(os.environ.get, ["MALLOC_TRIM_THRESHOLD_", "PYTHONHASHSEED"])[0] is None
    assert dict(os.environ) == before


# What all engines do


def test_results_are_those_of_the_function_whatever_runs_it(run):
    assert dict(run(math.factorial, range(40))) == {n: math.factorial(n) for n in range(40)}


def test_map_keeps_the_order_of_the_tasks(run):
    assert run.map(operator.neg, range(25)) == [-n for n in range(25)]


def test_the_first_to_be_done_comes_first_and_says_which_it_was(two, local):
    for run in (two, local):
        run.map(abs, [1, 2, 3, 4])  # all workers have begun
        assert [position for position, _ in run(time.sleep, [0.6, 0.01])] == [1, 0]


def test_no_tasks_give_no_results(run):
    assert list(run(abs, [])) == []


def test_a_task_arrives_as_it_is_and_is_not_taken_for_a_graph(run):
    tasks = [(math.factorial, 3), "key", ("key", 1), [1, (2,)], {"a": (abs, -1)}, None]
    assert run.map(repr, tasks) == [repr(task) for task in tasks]


def test_what_a_task_raises_comes_out_as_it_is_and_the_engine_goes_on(run):
    with pytest.raises(ValueError, match="not defined for negative"):
        run.map(math.factorial, [1, -1, 2])
    assert run.map(math.factorial, [3]) == [6]


def test_only_a_few_tasks_are_under_way_and_closing_begins_no_more(run):
    handed = count()
    results = run(abs, islice(handed, 10_000))
    assert next(results)[1] is not None
    results.close()
    assert next(handed) <= 4 * by_dask.AHEAD
    assert run.map(abs, [-7]) == [7]


def test_results_do_not_pile_up_while_nobody_takes_them(two):
    handed = count()
    results = two(abs, islice(handed, 10_000))
    next(results)
    time.sleep(0.2)  # joblib.Parallel would have handed out all of them
    assert next(handed) <= 2 * AHEAD * 2
    results.close()


def test_tasks_that_wait_do_not_run_once_the_iterator_is_closed(local, tmp_path):
    """Eight were handed to two workers, which end those that they run: the others never begin."""
    slow = [["sh", "-c", f"sleep 0.4; : > {shlex.quote(str(tmp_path / str(k)))}"] for k in range(50)]
    results = local(subprocess.check_call, [["true"], *slow])
    next(results)
    results.close()
    local.map(abs, [1, 2])
    assert len(list(tmp_path.iterdir())) <= 4


ORPHANS = """
import os, time
from fitmodels.batch.engine import engine, joblib_processes
from fitmodels.batch.records import hash_of
joblib_processes.IDLE = 0.5
if __name__ == "__main__":
    with engine(2) as run:
        run.map(hash_of, ["/"] * 4)
        print(*run.executor._processes, flush=True)
        time.sleep(120)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
def test_processes_whose_batch_was_killed_end():
    """They wait for a task no longer than `IDLE`, and loky 30 s more for their batch to take notice."""
    with subprocess.Popen([sys.executable, "-c", ORPHANS], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as batch:
        left = [int(word) for word in batch.stdout.readline().split()]
        batch.kill()
        batch.wait()
        assert len(left) == 2
        end = time.monotonic() + 90
        while any(map(_runs, left)) and time.monotonic() < end:
            time.sleep(0.2)
        assert not any(map(_runs, left))


def _runs(pid):
    """Whether a process runs, of Linux; one that nobody waits for stays as a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(("jobs", "words"), [(1, "this process"), (3, "3 processes (joblib)")])
def test_an_engine_says_where_it_runs(jobs, words):
    with engine(jobs) as run:
        assert run.describe() == words


def test_a_local_cluster_says_so(local):
    assert local.describe() == "local Dask cluster, 2 workers"


def test_fewer_than_one_process_is_refused():
    with pytest.raises(UsageError, match="--jobs 0"), engine(0):
        pass


@pytest.mark.parametrize("name", ["two", "local"])
def test_workers_run_with_one_thread_of_linear_algebra(request, name):
    run = request.getfixturevalue(name)
    assert run.map(os.getenv, list(ONE_THREAD)) == ["1"] * len(ONE_THREAD)


# joblib's processes


@needs_signals
def test_a_process_ended_from_outside_is_one_sentence():
    with (
        engine(2) as run,
        pytest.raises(FitmodelsError, match=r"SIGKILL.*finished results are kept.*fewer --jobs") as caught,
    ):
        run.map(signal.raise_signal, [signal.SIGKILL])
    assert caught.value.__cause__ is None
    assert "\n" not in str(caught.value)


@needs_signals
def test_what_finished_before_a_process_ended_came_out():
    kept = []
    with engine(2) as run, pytest.raises(FitmodelsError):
        kept.extend(position for position, _ in run(signal.raise_signal, [*[signal.SIGCONT] * 30, signal.SIGKILL]))
    assert set(kept) >= set(range(30 - 2 * AHEAD))


def test_processes_that_are_still_at_work_end_with_the_block():
    begun = time.monotonic()
    with processes(2) as run:
        results = run(time.sleep, [0.01, 30.0, 30.0])
        next(results)
        results.close()
        pids = [process.pid for process in run.executor._processes.values()]
    assert time.monotonic() - begun < 15
    assert not any(_runs(pid) for pid in pids)


# Dask


@needs_signals
def test_a_dask_worker_killed_in_mid_run_costs_no_result():
    with engine(2, "local") as run:
        before = run.client.run(os.getpid)
        results = {}
        for position, result in run(math.sqrt, _slowly(range(60))):
            results[position] = result
            if len(results) == 5:
                os.kill(next(iter(before.values())), signal.SIGKILL)
        assert results == {n: math.sqrt(n) for n in range(60)}
        # and one that is killed while it works
        sleeps = dict(_killing(run, run(time.sleep, [0.1] * 30)))
        assert sorted(sleeps) == list(range(30))


@needs_signals
def test_a_task_that_ends_every_worker_it_meets_is_a_sentence(capfd):
    with engine(2, "local") as run, pytest.raises(FitmodelsError, match=r"one task ended 4 Dask workers.*are kept"):
        run.map(signal.raise_signal, [signal.SIGKILL])
    assert capfd.readouterr().err == ""


def test_a_cluster_at_an_address_is_used_and_its_workers_are_waited_for(local):
    address, said = local.client.scheduler.address, []
    with engine(dask=address.removeprefix("tcp://"), report=said.append) as run:
        assert run.map(abs, [-1, 2]) == [1, 2]
        assert run.describe().startswith("Dask cluster 127.0.0.1:")
    assert "waiting for a worker" in said[-1]


def test_a_scheduler_file_names_the_scheduler(local, tmp_path):
    path = tmp_path / "scheduler.json"
    path.write_text(json.dumps({"type": "Scheduler", "address": local.client.scheduler.address}), "utf-8")
    with engine(dask=str(path)) as run:
        assert run.map(abs, [-1]) == [1]


def test_a_worker_with_another_version_is_refused_by_name(local, monkeypatch):
    fitmodels_as_it_is = fitmodels.__version__
    monkeypatch.setattr(fitmodels, "__version__", "9.9.9")
    worker = next(iter(local.client.run(os.getpid)))
    with pytest.raises(UsageError) as caught, engine(dask=local.client.scheduler.address):
        pass
    assert f"worker {worker} has fitmodels {fitmodels_as_it_is}" in str(caught.value)
    assert "fitmodels 9.9.9" in str(caught.value)
    assert "pip install 'fitmodels[dask]==9.9.9'" in str(caught.value)


class _Versions:
    """Answers as a client does: what the scheduler and each worker would see."""

    def __init__(self, scheduler, **workers):
        self.scheduler, self.workers = scheduler, workers

    def run_on_scheduler(self, look):
        return look() | self.scheduler

    def run(self, look):
        return {name: look() | seen for name, seen in self.workers.items()}


@pytest.mark.parametrize(
    ("scheduler", "worker", "words"),
    [
        ({}, {"fitmodels": ""}, "worker tcp has no fitmodels"),
        ({}, {"Python": "3.9"}, "in an environment of Python 3.1"),
        ({}, {"numpy": "1"}, r"pip install 'numpy==2\.\*'"),
        ({"fitmodels": "0.0.1"}, {}, "scheduler tcp://a has fitmodels 0.0.1"),
    ],
)
def test_the_first_that_differs_is_reported_with_its_cure(scheduler, worker, words):
    with pytest.raises(UsageError, match=words):
        same_versions.refuse_other_versions(_Versions(scheduler, tcp=worker), "tcp://a")


def test_versions_that_agree_pass():
    same_versions.refuse_other_versions(_Versions({}, one={}, two={}), "tcp://a")


def test_a_cluster_without_workers_is_a_sentence(monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr(by_dask, "ARRIVAL", 0.5)
    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", processes=False, protocol="tcp") as empty:
        address = empty.scheduler_address
        with (
            pytest.raises(UsageError, match=f"{address} has no workers.*'dask worker {address}'"),
            engine(dask=address),
        ):
            pass


def test_a_cluster_that_all_workers_leave_is_a_sentence(monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr(by_dask, "RETURN", 0.5)
    monkeypatch.setattr(by_dask, "OLD", 0.1)
    with (
        LocalCluster(n_workers=1, dashboard_address="127.0.0.1:0", processes=False, protocol="tcp") as small,
        engine(dask=small.scheduler_address) as run,
        pytest.raises(FitmodelsError, match=r"all workers .* have been gone"),
    ):
        _taken(run(time.sleep, [0.05] * 100), lambda: small.scale(0))


def test_a_scheduler_that_ends_in_mid_run_is_a_sentence():
    from distributed import LocalCluster

    small = LocalCluster(n_workers=1, dashboard_address="127.0.0.1:0", processes=False, protocol="tcp")
    with engine(dask=small.scheduler_address) as run, pytest.raises(FitmodelsError, match=r"is lost.*are kept"):
        _taken(run(time.sleep, [0.02] * 1000), small.close)


def _port_without_anybody():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_a_scheduler_that_is_not_there_is_one_sentence_soon():
    address = f"tcp://127.0.0.1:{_port_without_anybody()}"
    begun = time.monotonic()
    words = rf"^no Dask scheduler answers at {address} .*'dask scheduler'.*'dask worker"
    with pytest.raises(UsageError, match=words), engine(dask=address):
        pass
    assert time.monotonic() - begun < 10


def test_somebody_who_answers_nothing_is_not_waited_for_for_ever():
    with socket.create_server(("127.0.0.1", 0)) as mute, pytest.raises(UsageError, match=r"nothing in 0.3 s"):
        scheduler_address(f"127.0.0.1:{mute.getsockname()[1]}", 0.3)


def test_a_worker_is_no_scheduler(local):
    worker = next(iter(local.client.run(os.getpid)))
    with pytest.raises(UsageError, match="there is a worker instead"), engine(dask=worker):
        pass


@pytest.mark.parametrize(
    "address", ["", "somewhere", "tcp://host:99999", "host:abc", "http://host:8786", "tcp://host", "a b:1"]
)
def test_what_is_no_address_is_reported(address):
    with pytest.raises(UsageError, match="not an address of a Dask scheduler"), engine(dask=address):
        pass


def test_a_scheduler_file_that_is_not_there_or_is_none_is_reported(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        scheduler_address(str(tmp_path / "none.json"), 1.0)
    (tmp_path / "other.json").write_text("[1]", "utf-8")
    with pytest.raises(UsageError, match="not a scheduler file"):
        scheduler_address(str(tmp_path / "other.json"), 1.0)


@pytest.mark.parametrize(
    ("package", "arguments", "words"),
    [
        ("distributed", {"dask": "local"}, r"dask is not installed: pip install 'fitmodels\[dask\]'"),
        (
            "joblib.externals.loky",
            {"jobs": 2},
            r"joblib is not installed: .*'fitmodels\[batch\]', or run with --jobs 1",
        ),
    ],
)
def test_a_package_that_is_missing_is_one_sentence(monkeypatch, package, arguments, words):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UsageError, match=words), engine(**arguments):
        pass


def test_neither_package_is_imported_before_it_is_asked_for():
    code = (
        "import sys; from fitmodels.batch.engine import engine\n"
        "with engine() as run: run.map(abs, [1])\n"
        "print([name for name in ('joblib', 'dask', 'distributed') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


# Ctrl-C

INTERRUPTED = """
import signal, sys, time
from fitmodels.batch.engine import engine
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever runs tests in the background ignores it
    try:
        with engine(2, {dask!r}) as run:
            for _ in run(time.sleep, [0.2] * 500):
                print("one", flush=True)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@needs_signals
@pytest.mark.parametrize("dask", [None, "local"])
def test_an_interrupt_ends_all_processes_without_a_word(tmp_path, dask):
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED.format(dask=dask), "utf-8")
    child = subprocess.Popen(
        [sys.executable, "-W", "error", script],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    with child:
        assert child.stdout.readline() == "one\n"
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does: to all of them
        _, errors = child.communicate(timeout=30)
    assert (child.returncode, errors) == (130, "")
    assert not _group(child.pid)


# Progress


class _Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_rate_and_time_left_are_reported_as_they_are_read():
    clock = _Clock()
    meter = Meter(10_000, "pairs", clock=clock)
    clock.now = 12.0
    meter.advance(3400)
    assert meter.line() == "3400 of 10 000 pairs, 283 pairs/s, 23 s left"


def test_what_an_earlier_run_did_does_not_count_for_the_rate():
    clock = _Clock()
    meter = Meter(1000, "pairs", clock=clock)
    meter.skip(900)
    clock.now = 10.0
    meter.advance(10)
    assert meter.rate() == pytest.approx(1.0)
    assert meter.line() == "910 of 1000 pairs, 1 pairs/s, 90 s left"


def test_the_rate_is_that_of_the_recent_past():
    clock = _Clock()
    meter = Meter(100_000, "pairs", clock=clock)
    for pace in (100, 10):
        for _ in range(100):
            clock.now += 1.0
            meter.advance(pace)
    assert meter.rate() == pytest.approx(10.0)


def test_steps_that_take_minutes_have_a_rate_too():
    clock = _Clock()
    meter = Meter(10, "pairs", clock=clock)
    for _ in range(4):
        clock.now += 120.0
        meter.advance(1)
    assert meter.line() == "4 of 10 pairs, 0.5 pairs/min, 12 min left"


@given(st.lists(st.tuples(st.floats(0.01, 100.0), st.integers(1, 1000)), min_size=1, max_size=60))
@settings(max_examples=50, deadline=None)
def test_the_rate_lies_between_the_slowest_and_the_fastest_step(steps):
    clock = _Clock()
    meter = Meter(0, "pairs", clock=clock)
    for seconds, n in steps:
        clock.now += seconds
        meter.advance(n)
    rates = [n / seconds for seconds, n in steps]
    assert min(rates) * (1 - 1e-9) <= meter.rate() <= max(rates) * (1 + 1e-9)


def test_before_the_first_is_done_words_and_count_are_reported_alone():
    meter = Meter(0, "pairs")
    assert meter.line() == ""
    meter.say("reading")
    assert meter.line() == "reading"
    meter.expect(20)
    assert meter.line() == "reading: 0 of 20 pairs"


def test_work_that_is_soon_over_shows_nothing(capsys):
    with progress_bar(10, "pairs") as meter:
        meter.advance(10)
    assert capsys.readouterr().err == ""


def test_without_a_terminal_a_line_comes_now_and_then(capsys, monkeypatch):
    monkeypatch.setattr(progress_module, "PATIENCE", 0.05)
    with progress_bar(10, "pairs") as meter:
        meter.advance(4, "fitting")
        time.sleep(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("fitting: 4 of 10 pairs, ")


class _Terminal(io.StringIO):
    def isatty(self):
        return True


def test_at_a_terminal_there_is_a_bar(monkeypatch):
    terminal = _Terminal()
    monkeypatch.setattr(progress_module, "PATIENCE", 0.05)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    with progress_bar(10_000, "pairs") as meter:
        meter.advance(4000, "fitting [x]")
        time.sleep(0.5)
    assert "fitting [x]" in terminal.getvalue()
    assert "4000 of 10 000 pairs" in terminal.getvalue()
    assert "left" in terminal.getvalue()


def test_an_error_in_the_block_ends_the_watcher():
    with pytest.raises(ValueError, match="invalid literal"), progress_bar(10, "pairs"):
        int("x")
    assert "progress" not in [thread.name for thread in threading.enumerate()]


# Memory


def test_largest_memory_grows_with_what_was_held():
    before = largest_memory()
    held = bytearray(before + 50_000_000)  # zeroed pages count once they are written
    held[::4096] = b"\1" * len(held[::4096])
    assert largest_memory() >= before + 40_000_000


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux has it")
def test_largest_memory_is_at_least_what_is_held_now():
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    assert largest_memory() >= int(status["VmRSS"].split()[0]) * 1024 * 0.99


def test_where_proc_is_missing_the_system_is_asked(monkeypatch):
    resource = pytest.importorskip("resource")
    linux = largest_memory()
    monkeypatch.setattr(sys.modules["fitmodels.batch.engine.base"], "STATUS", Path("/nowhere"))
    assert largest_memory() >= linux * 0.9
    unit = 1 if sys.platform == "darwin" else 1024
    assert largest_memory() == resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def test_there_is_a_core():
    assert 1 <= cores() <= (os.cpu_count() or 1)


# Helpers


def _taken(results, meanwhile):
    """Take all results; after the first something happens."""
    next(results)
    meanwhile()
    for _ in results:
        pass


def _slowly(tasks):
    for task in tasks:
        time.sleep(0.01)
        yield task


def _killing(run, results):
    """Kill a worker while it is at work, and give all results."""
    for seen, one in enumerate(results):
        if seen == 3:
            victim = next(iter(run.client.run(os.getpid).values()))
            os.kill(victim, signal.SIGKILL)
        yield one


def _state(pid):
    shown = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False)
    return shown.stdout.strip()


def _runs(pid):
    return _state(pid)[:1] not in ("", "Z")


def _group(group):
    """Processes of a group that still run, after a moment to end in."""
    for _ in range(50):
        shown = subprocess.run(["ps", "-eo", "pgid=,stat=,args="], capture_output=True, text=True, check=True)
        left = [
            line for line in shown.stdout.splitlines() if line.split()[0] == str(group) and line.split()[1][0] != "Z"
        ]
        if not left:
            return []
        time.sleep(0.1)
    return left
