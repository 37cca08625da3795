"""Each command that writes, killed or on a full disk at random moments, and pairs of commands at the same time.

    python benchmarks/interruptions.py                       # 200 kills and 200 full disks of each command, 50 races
    python benchmarks/interruptions.py --only tune --moments 20 --seed 7
    python benchmarks/interruptions.py --races 50 --moments 0

A command runs up to its first change of the file system and is copied there (fork) for each moment; its PNG pictures
are small ones, made faster. Half of the kills come before a random call (open to write, mkdir, rename, remove, link,
lock, fsync), half at a random time until its end. Half of the full disks are a small memory disk with a random number
of free bytes (root only), half are calls that fail with ENOSPC from a random one on, or only once. Aims: the files are
then the former ones or the new ones, or a reading command makes them so; the same command again leaves the new ones,
and no temporary file, lock or journal. Of a race: both commands end with 0 or a refusal, and the files are those of
the two one after the other in either order, or of the one that was not refused.
"""

import argparse
import json
import os
import random
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent))
from held_command import Held, draw_fast, ended, execute, forked

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "docs" / "examples"
DISK = 256 << 20  # bytes of the memory disk
TIMES = re.compile(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d+)?([+-]\d\d:\d\d|Z)?")
NAMES = re.compile(
    r"(?<![0-9a-f])[0-9a-f]{8}-\d+-[0-9a-f]{16}|(?<=fitmodels-)[a-z0-9_]{8}(?![a-z0-9_])"
)  # of temporary files
# commands that write nothing; watch, which appends to a journal and adds a version beside a file, is killed and meets
# a full disk in tests/test_watch_journal.py and tests/test_learning.py; app runs the others, and replaces its
# project.json whole
READING = ("app", "check", "completion", "confirm", "help", "predict", "watch")
CARD = """license = "CC-BY-4.0"
authors = ["Doe, Jane (0000-0002-1825-0097)"]
contact = "jane.doe@example.org"
machine = "lathe"
iso513 = "P20"
setup = "dry"
no_sensors = "wear read by eye"
"""


class Case(NamedTuple):
    """A command that writes: its words, the examples that it reads, and the steps that make the former state."""

    name: str
    words: str
    inputs: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    parts: str = ""

    @property
    def command(self) -> str:
        """Name of the command, whose moments its cases share."""
        first = self.words.split()[0]
        return "fit" if "." in first else first


def cases() -> tuple[dict[str, Case], dict[str, tuple[Case, str]]]:
    """The commands of interruptions.toml by their names, one for each kind where ``kinds`` are given; the races."""
    given = tomllib.loads((HERE / "interruptions.toml").read_text("utf-8"))
    texts, races, found = given.pop("texts"), given.pop("races"), {}
    for title, one in given.items():
        for kind in one.get("kinds", [""]):
            name = f"{title} {kind}".strip()
            known = {**texts, "kind": kind}
            inputs, before = one.get("inputs", "").format(**known), one.get("before", [])
            found[name] = Case(
                name, one["words"].format(**known), tuple(inputs.split()), tuple(w.format(**known) for w in before),
                one.get("parts", ""),
            )  # fmt: skip
    return found, {name: (found[first], other.format(**texts)) for name, (first, other) in races.items()}


State = Mapping[str, bytes]


def hidden(path: str) -> bool:
    """Whether a file is a temporary one, a journal or a lock of fitmodels."""
    return any(part.startswith(".") and "fitmodels" in part for part in path.split("/"))


def state(folder: Path) -> State:
    """Content of each file below a folder, and of each link and empty folder; times in them are left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = os.fsencode(path.readlink())
        elif path.is_file():
            timed = "/.batch/blocks/" in f"/{name}"  # how long fits took
            found[name] = b"" if timed else TIMES.sub(b"TIME", path.read_bytes())
        elif not any(path.iterdir()):
            found[name + "/"] = b""
    return found


def part_of(path: str, parts: str) -> str:
    """The part of the result that a file belongs to, which is old or new as a whole: see interruptions.toml."""
    if parts != "batch":
        return {"": "", "folder": path.split("/")[0], "name": path.split(".")[0]}[parts]
    _, *rest = path.split("/")
    return "" if not rest or rest[0] == ".batch" else "/".join(rest[:2] if rest[0] == "pairs" else rest[:1])


def agrees(now: State, old: State, new: State, parts: str) -> str:
    """``old``, ``new`` or, of a result in parts, ``parts``; empty for a mixture."""
    seen = {path: data for path, data in now.items() if not hidden(path) and not path.endswith("/")}
    each: dict[str, list[str]] = {}
    for part in {part_of(path, parts) for path in (*seen, *old, *new)} - ({""} if parts == "batch" else set()):
        of = [{k: v for k, v in one.items() if part_of(k, parts) == part and not k.endswith("/")} for one in
              (seen, old, new)]  # fmt: skip
        each[part] = [name for name, one in zip(("old", "new"), of[1:], strict=True) if of[0] == one]
        each[part] += ["none"] if parts == "batch" and not of[0] else []
    for name in ("new", "old"):
        if all(name in found for found in each.values()):
            return name
    return "parts" if all(each.values()) else ""


class Bench:
    """Former state, work place and output of one case, below a folder that may be a memory disk."""

    def __init__(self, case: Case, top: Path, *, disk: bool) -> None:
        self.case, self.top, self.disk = case, top, disk
        self.work, self.template = top / "work", top / "template"
        self.log, self.modules = top.parent / "log", top.parent / "modules"
        self.known: dict[frozenset[tuple[str, str]], tuple[str, str]] = {}
        self.work.mkdir()
        for name in case.inputs:
            source, to = EXAMPLES / name, self.work / name
            shutil.copytree(source, to) if source.is_dir() else shutil.copyfile(source, to)
        for step in case.before:
            if self.step(step) not in (0, 5):
                raise SystemExit(f"{case.name}: {step}: {self.said()}")
        shutil.copytree(self.work, self.template, symlinks=True)
        self.old = state(self.work)

    def step(self, words: str) -> int:
        """Exit code of a command in the work place, or of a step that is none."""
        from fitmodels import datasets, parameters
        from fitmodels.parameters.published import published

        name, *rest = shlex.split(words)
        if name == "note":
            (self.work / rest[0]).with_name("mine.txt").write_text("mine")
        elif name == "card.toml":
            (self.work / rest[0]).with_name("card.toml").write_text(CARD)
        elif name == "bundled":
            shutil.copyfile(datasets.bundled(rest[0]), self.work / rest[1])
        elif name == "published":
            (self.work / rest[1]).mkdir()
            parameters.write(published(rest[0]), self.work / rest[1] / "params.json")
        else:
            code = ended(self.start(words))
            for module in {*self.modules.read_text().split()} - {*sys.modules}:  # further commands start with them
                with suppress(Exception):
                    import_module(module)
            return code
        return 0

    def start(self, words: str, log: Path | None = None, delay: float = 0.0) -> int:
        """Process that runs a command in the work place."""

        def command() -> int:
            os.chdir(self.work)
            time.sleep(delay)
            code = execute(words, log or self.log)
            self.modules.write_text("\n".join(name for name in list(sys.modules) if not name.startswith("_")))
            return code

        (log or self.log).write_bytes(b"")
        return forked(command)

    def said(self) -> str:
        """The end of what the last command printed."""
        return " ".join(self.log.read_text(errors="replace").split())[-300:]

    def restore(self) -> None:
        """Put the former files back, the same ones: a command remembers them, and writes into none of them."""
        for path in self.work.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        shutil.copytree(self.template, self.work, symlinks=True, dirs_exist_ok=True, copy_function=os.link)

    @contextmanager
    def filled(self, free: float) -> Iterator[None]:
        """A file that leaves so many bytes of the memory disk free."""
        filler, disk = self.top / "filler", os.statvfs(self.top)
        with filler.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, max(disk.f_bavail * disk.f_frsize - int(free), 1))
        try:
            yield
        finally:
            filler.unlink()

    def interrupted(self, count: int, rng: random.Random) -> Iterator[tuple[str, str, str]]:
        """Kind of interruption, what the files were then, and what was wrong (or nothing), for each moment."""
        self.step(self.case.words)
        self.new = state(self.work)
        self.step(self.case.words)
        self.twice = state(self.work)  # the provenance has the second command, too
        self.restore()
        held = Held(self.case.words, self.work, self.log)
        if not held.changes:
            held.end()
            raise SystemExit(f"{self.case.name}: nothing was written: {self.said()}")
        before = os.statvfs(self.top)
        _, seconds, calls, free = held.run("count", 0)
        need = before.f_bavail * before.f_frsize - free
        for number in range(2 * count):
            kinds = ("call", "time") if number < count else ("full", "fails") if self.disk else ("fails",)
            kind = kinds[number % len(kinds)]
            kind = rng.choice(["fails", "fails once"]) if kind == "fails" else kind
            at = rng.uniform(0, {"time": seconds, "full": need}.get(kind, 0)) or rng.randrange(calls)
            self.restore()
            with self.filled(at) if kind == "full" else nullcontext():
                code, *_ = held.run(kind, at)
            found, wrong = self.judged(kind, code)
            yield kind, found, wrong and f"{kind} {at:.6g}: {wrong}"
        held.end()
        if state(self.template) != self.old:
            yield "call", "mixed", "the former files were written into, not replaced"

    def judged(self, kind: str, code: int) -> tuple[str, str]:
        """State of the files after an interruption, and the fault in it or in that after the command again."""
        said, now = self.said(), state(self.work)
        found = agrees(now, self.old, self.new, self.case.parts)
        allowed = (0, -9) if kind in ("call", "time") else (0, 2, 3, 5)
        if code not in allowed or "Traceback" in said:
            return found, f"exit code {code}: {said}"
        key = frozenset((NAMES.sub("*", path), NAMES.sub("*", repr(data))) for path, data in now.items())
        if key not in self.known:  # the command again takes most of the time
            self.known[key] = self._again(now, found)
        return self.known[key]

    def _recovered(self) -> int:
        """Do what every command does that reads or writes in the folders of the result."""
        from fitmodels.core.journal import recover

        for path in {(self.work / name).parent for name in (*self.old, *self.new)}:
            recover(path)
        return 0

    def _again(self, now: State, found: str) -> tuple[str, str]:
        """Whether the next command restores what is neither old nor new, and the command again leaves the new files."""
        if not found:
            ended(forked(self._recovered))
            found = agrees(state(self.work), self.old, self.new, self.case.parts) and "restored"
        again = self.step(self.case.words)
        then = state(self.work)
        if not found:
            return "mixed", f"neither the former files nor the new ones: {_difference(now, self.old, self.new)}"
        if then in (self.new, self.twice):
            return found, "" if again in (0, 2, 5) else f"the command again ends with {again}: {self.said()}"
        left = sorted(path for path in then if hidden(path) or path.endswith("/"))
        return found, f"left {left}" if left else f"then {_difference(then, self.new, self.twice)}; {self.said()}"


def _difference(now: State, *aims: State) -> str:
    """Files in which a state differs from the nearest of others."""
    each = [
        sorted(path for path in {*now, *aim} if now.get(path) != aim.get(path) and not hidden(path)) for aim in aims
    ]
    return ", ".join(min(each, key=len)[:6])


@contextmanager
def bench(case: Case) -> Iterator[Bench]:
    """A bench on a memory disk where this program may mount one."""
    memory = Path("/dev", "shm")
    with TemporaryDirectory(prefix="interruptions-", dir=memory if memory.is_dir() else None) as folder:
        top = Path(folder, "disk")
        top.mkdir()
        words = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(top)]
        disk = os.geteuid() == 0 and subprocess.run(words, capture_output=True).returncode == 0
        try:
            yield Bench(case, top, disk=disk)
        finally:
            if disk:
                subprocess.run(["umount", "-l", str(top)], check=False)


def study(case: Case, count: int, seed: int) -> dict[str, Any]:
    """Counts of what the files were after each kind of interruption, and what was wrong."""
    begun, counts, wrong = time.perf_counter(), Counter[str](), []
    with bench(case) as place:
        for kind, found, problem in place.interrupted(count, random.Random(f"{seed} {case.name}")):  # noqa: S311
            counts[f"{'kill' if kind in ('call', 'time') else 'disk'} {found}"] += 1
            wrong += [problem] if problem else []
        states = len(place.known)
    seconds = time.perf_counter() - begun
    return {"case": case.name, "counts": counts, "states": states, "wrong": wrong, "seconds": seconds}


class Race:
    """Two commands that are run at the same time, and the states that they leave one after the other."""

    def __init__(self, place: Bench, other: str) -> None:
        self.place, self.words = place, (place.case.words, other)
        self.serial: dict[tuple[int, ...], tuple[tuple[int, ...], State]] = {}
        self.seconds = [0.0, 0.0]
        for order in ((0,), (1,), (0, 1), (1, 0)):
            place.restore()
            codes = []
            for number in order:
                begin = time.perf_counter()
                codes.append(place.step(self.words[number]))
                self.seconds[number] = time.perf_counter() - begin
            self.serial[order] = tuple(codes), state(place.work)

    def run(self, rng: random.Random) -> tuple[str, str]:
        """Outcome of the two commands, and its fault; their ends are near each other."""
        place = self.place
        place.restore()
        logs = [place.top.parent / f"log-{number}" for number in (0, 1)]
        late = self.seconds[0] - self.seconds[1] + rng.gauss(0, 0.3) * min(self.seconds)
        pids = [place.start(words, log, max(delay, 0.0)) for words, log, delay in zip(self.words, logs, (-late, late),
                                                                                      strict=True)]  # fmt: skip
        codes = tuple(ended(pid) for pid in pids)
        said = [" ".join(log.read_text(errors="replace").split())[-300:] for log in logs]
        now = state(place.work)
        done = tuple(number for number in (0, 1) if codes[number] in (0, 5))
        allowed = [order for order, (_, then) in self.serial.items() if now == then]
        found = "both" if len(done) == 2 else f"{['neither', 'first', 'second'][done[0] + 1 if done else 0]}"
        if any(code not in (0, 2, 3, 5) for code in codes) or "Traceback" in "".join(said):
            return found, f"exit codes {codes}: {said}"
        if left := [path for path in now if hidden(path)]:
            return found, f"left {left}"
        fits = [order for order in allowed if {*order} >= {*done} and (len(order) == 2 or {*order} == {*done})]
        if not fits or not done:
            near = _difference(now, *(then for order, (_, then) in self.serial.items() if {*order} >= {*done}))
            return found, f"exit codes {codes}, a state of neither order: {near}: {said}"
        return found, ""


def race(name: str, case: Case, other: str, count: int, seed: int) -> dict[str, Any]:
    """Counts of which of two commands ended, and what was wrong, of a number of races."""
    begun, counts, wrong, rng = time.perf_counter(), Counter[str](), [], random.Random(f"{seed} {name}")  # noqa: S311
    with bench(case) as place:
        two = Race(place, other)
        for _ in range(count):
            found, problem = two.run(rng)
            counts[found] += 1
            wrong += [problem] if problem else []
    return {"case": name, "counts": counts, "states": 0, "wrong": wrong, "seconds": time.perf_counter() - begun}


def main() -> int:
    """Run what is asked for, each command in a program of its own, and print counts."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--moments", type=int, default=200, metavar="N", help="kills, and full disks, of each command")
    p.add_argument("--races", type=int, default=50, metavar="N", help="races of two commands in all")
    p.add_argument("--only", action="append", metavar="NAME", help="of these commands or races only")
    p.add_argument("--seed", type=int, default=1, metavar="N")
    p.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N")
    p.add_argument("--one", action="store_true", help=argparse.SUPPRESS)  # in this program, as JSON
    args = p.parse_args()
    known, races = cases()
    if unknown := {*(args.only or ())} - {*known} - {*races}:
        raise SystemExit(f"{', '.join(sorted(unknown))}: choose of {', '.join((*known, *races))}.")
    each = -(-args.races // len(races))  # rounded up
    tried = {name: case for name, case in known.items() if name in (args.only or known)}
    shared = Counter(case.command for case in tried.values())
    work = {name: -(-args.moments // shared[case.command]) for name, case in tried.items()}
    work |= {name: each for name in races if name in (args.only or races)}
    work = {name: count for name, count in work.items() if count}
    if args.one:
        draw_fast()
        (name, count), *_ = work.items()
        one = study(known[name], count, args.seed) if name in known else race(name, *races[name], count, args.seed)
        print(json.dumps(one))
        return 0

    def run(name: str) -> str:
        words = [sys.executable, __file__, "--one", "--only", name, "--seed", str(args.seed)]
        words += ["--moments", str(work[name]), "--races", str(args.races)]
        done = subprocess.run(words, capture_output=True, text=True)
        return done.stdout if done.returncode == 0 else json.dumps({"case": name, "wrong": [done.stderr[-800:]]})

    failed = 0
    with ThreadPoolExecutor(args.jobs) as pool:
        for text in pool.map(run, work):
            one = json.loads(text.splitlines()[-1])
            counts = ", ".join(f"{name} {count}" for name, count in sorted(one.get("counts", {}).items()))
            print(f"{one['case']:28} {one.get('seconds', 0):6.0f} s  {counts}; wrong {len(one['wrong'])}", flush=True)
            for problem, times in Counter(one["wrong"]).most_common(5):
                print(f"    {times} x {problem}")
            failed += len(one["wrong"])
    print(f"{len(work)} commands and races, {failed} faults")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
