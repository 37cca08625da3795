"""Random files of every kind that a user may receive, each read, fitted and judged: the one fuzzer.

    python benchmarks/fuzz.py --kind table --files 10000 --seed 1 --jobs 2 --log table.jsonl
    python benchmarks/fuzz.py --only table:1000017 [--write FOLDER]

Without ``--kind`` every kind is tried. A file is drawn from its number (1 000 000 times the seed, plus 0, 1, ...), so
that ``--only KIND:NUMBER`` repeats it alone; with ``--log`` a run that was stopped goes on where it stopped.

table
    A good file of tests (``mutations.py``) written in an *equal* form (other delimiter, units, language, workbook ...),
    with one *cell* corrupted, with another *mutation*, or with a *long* cell; one file in forty runs through the
    whole command with its figures. Equal files have equal exponents; a changed exponent has a message.
record
    A recorded run for ``fitmodels ident`` (``fuzz_records.py``), equal or corrupted.
odd
    A table drawn at random (few rows, constant or exactly dependent columns, copies, zeros, signs, magnitudes from
    1e-300 to 1e300) through ``fitmodels FILE --json --out FOLDER``, then look, next, check, card, predict and export.
laboratory
    The laboratory files of ``tests`` through the same commands.
params, sealed, draws, priors, card, pairs, batch, site, reduce, words
    Changed files of other kinds (``fuzz_forms.py``) through the commands that read them.

A file is at fault where an exponent or model changes without a message, where a command ends with exit 70, where a part
of the checks fails with an internal error, where a numerical library warns, or where CPU or memory exceed their limits,
which are linear in the size of the file. Faults are printed with their numbers, then counts, CPU and memory.
"""

import argparse
import contextlib
import faulthandler
import io
import json
import re
import resource
import shlex
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from copy import deepcopy
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from unittest import mock

import fuzz_forms
import fuzz_records
import mutations
import numpy as np
import pandas as pd
from fitmodels import cli, fit

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from laboratory_files import CASES

DONE = (0, 2, 3, 4, 5)  # exit codes that the command documents
FAILED = re.compile(r"the computation failed \([^\"\n)]*\)")
WHOLE = 40  # one of so many tables runs through the whole command
CPU, CPU_PER_MB = 20.0, 20.0  # s for a file, and for each MB of it; the median is below 0.1 s
MEMORY, MEMORY_PER_MB = 400.0, 100.0  # MB by which a file may enlarge the process
ADDRESSES = 6 << 30  # bytes of address space of a process
HANGS = 300  # s of time after which a process that does not react is ended
LEAST_BYTES = 1000
SHORT = {"table": 100, "record": 12, "odd": 2, "laboratory": 1}  # files of the short run in the tests
SHORT |= {"params": 12, "sealed": 12, "draws": 6, "priors": 2, "card": 6, "pairs": 4, "batch": 4, "site": 3,
          "reduce": 4, "words": 6}  # fmt: skip
UNITS = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm", "VB": "mm", "Fc": "N", "P": "kW", "Ra": "um",
         "Fx": "N", "F": "N", "I": "A", "fm": "mm/min", "n": "1/min", "fz": "mm"}  # fmt: skip


def mutated(seed, folder):
    """A good file with one to three mutations."""
    rng = np.random.default_rng(seed)
    name, sheet = mutations.base(int(rng.integers(mutations.BASES)), seed)
    sheet, done = deepcopy(sheet), []
    for _ in range(int(rng.integers(1, 4))):
        kind = _any(rng, [kind for kind in mutations.KINDS if kind != "cell"])
        with contextlib.suppress(ValueError, IndexError, TypeError):  # a mutation that does not apply to another
            done.append(_any(rng, mutations.KINDS[kind])(sheet, rng))
    path = folder / sheet.name()
    path.write_bytes(sheet.content())
    return path, _options(rng), f"{name}: {'; '.join(filter(None, done))}"


def odd_table(seed, folder):
    """A table drawn at random, with one to three peculiarities."""
    rng = np.random.default_rng(seed)
    table, what = _table(rng), []
    for change in rng.permutation(len(ODD))[: int(rng.integers(1, 4))]:
        how = ODD[int(change)]
        if not _numbers(table):
            break
        with np.errstate(all="ignore"):
            table = how(table, rng)
        what.append(how.__name__)
    path = folder / "odd.csv"
    head = {name: f"{name} [{UNITS[name]}]" for name in table if name in UNITS and rng.random() < 0.9}
    table.rename(columns=head).to_csv(path, index=False)
    return path, _options(rng, table), f"{', '.join(table)}, {len(table)} rows: {', '.join(what)}"


def _table(rng):
    """Wear, loads and conditions of a few edges."""
    edges, each = int(_any(rng, (1, 2, 3, 5, 8, 12))), int(_any(rng, (1, 2, 3, 6)))
    at = np.repeat(np.arange(edges), each)
    V, f, d = (np.array(levels)[rng.integers(3, size=edges)][at]
               for levels in ((80, 120, 180), (0.1, 0.2, 0.4), (1, 1.5, 2.5)))  # fmt: skip
    t = np.tile(2.0 * np.arange(1, each + 1), edges)
    noise = lambda sd: np.exp(sd * rng.normal(size=len(at)))  # noqa: E731
    AW = 0.0076 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * noise(0.1)
    loads = {"Fc": 1500 * f**0.75 * d * (1 + AW) * noise(0.05), "P": 0.03 * V * f**0.7 * d * noise(0.05),
             "Fx": 300 * f**0.5 * d * noise(0.1), "F": 900 * f**0.6 * noise(0.1), "Ra": 2 * f * 9 * noise(0.2),
             "I": 2 + 0.01 * V + AW, "fm": 900 * f}  # fmt: skip
    wear = _any(rng, ("AW", "VB"))
    table = pd.DataFrame({"edge": [f"E{k + 1}" for k in at], "V": V, "f": f, "d": d, "t": t, wear: AW})
    for name in rng.permutation(list(loads))[: int(rng.integers(0, 4))]:
        table[name] = loads[str(name)]
    gone = [name for name in table if rng.random() < 0.15 and name != wear]
    return table.drop(columns=gone)


def constant_column(table, rng):
    return table.assign(**{_number(table, rng): 1.0})


def nearly_constant(table, rng):
    return table.assign(**{_number(table, rng): 1.5 * (1 + 1e-12 * rng.normal(size=len(table)))})


def dependent_column(table, rng):
    one, other = _number(table, rng), _number(table, rng)
    return table.assign(**{one: 0.3 * table[other] ** _any(rng, (-1.0, 0.5, 2.0))})


def exact_law(table, rng):
    name = _number(table, rng)
    others = [other for other in _numbers(table) if other != name]
    value = 0.1 * np.prod([np.abs(table[other]) ** rng.choice([0.0, 0.3, 1.0]) for other in others], axis=0)
    return table.assign(**{name: value})


def few_rows(table, rng):
    return table[: int(rng.integers(0, 7))]


def copied_rows(table, rng):
    return table.iloc[rng.integers(0, len(table), size=len(table))] if len(table) else table


def zeros(table, rng):
    return _where(table, _number(table, rng), rng.random(len(table)) < 0.3, 0.0)


def fresh_edges(table, rng):
    for name in ("AW", "VB", "t"):
        if name in table and rng.random() < 0.7:
            table = _where(table, name, np.arange(len(table)) % int(rng.integers(2, 6)) == 0, 0.0)
    return table


def signs(table, rng):
    name = _number(table, rng)
    sign = -1.0 if rng.random() < 0.5 else rng.choice([-1.0, 1.0], size=len(table))
    return table.assign(**{name: table[name] * sign})


def magnitude(table, rng):
    name = _number(table, rng)
    return table.assign(**{name: table[name] * 10.0 ** _any(rng, (-300, -100, -9, -3, 3, 9, 100, 290))})


def one_large(table, rng):
    name, at = _number(table, rng), int(rng.integers(max(len(table), 1)))
    scale = np.where(np.arange(len(table)) == at, 10.0 ** _any(rng, (1, 3, 9, 150)), 1.0)
    return table.assign(**{name: table[name] * scale})


def missing(table, rng):
    return _where(table, _number(table, rng), rng.random(len(table)) < _any(rng, (0.2, 0.9, 1.0)), np.nan)


def text_cells(table, rng):
    word = _any(rng, ("n/a", "broken", "<0.05", "0.24*", "inf", "1e999", "-"))
    name = _number(table, rng)
    return table.assign(**{name: np.where(rng.random(len(table)) < 0.2, word, table[name].astype(str))})


def rounded(table, rng):
    name = _number(table, rng)
    return table.assign(**{name: table[name].round(int(rng.integers(0, 3)))})


def random_response(table, rng):
    return table.assign(**{_number(table, rng): np.exp(_any(rng, (0.01, 1.0, 20.0)) * rng.normal(size=len(table)))})


def categories(table, rng):
    levels = rng.integers(0, _any(rng, (1, 2, 3, max(len(table), 1))), size=len(table))
    return table.assign(material=[f"m{k}" for k in levels])


def pairs(table, rng):
    return table.assign(work=[f"steel {k}" for k in rng.integers(0, 3, size=len(table))])


def shuffled(table, rng):
    return table.iloc[rng.permutation(len(table))]


def one_edge(table, _):
    return table.assign(edge="E1")


def many_rows(table, rng):
    more = pd.concat([table] * 40, ignore_index=True)
    return more.assign(**{name: more[name] * np.exp(0.03 * rng.normal(size=len(more))) for name in _numbers(more)})


ODD = (constant_column, nearly_constant, dependent_column, exact_law, few_rows, copied_rows, zeros, fresh_edges, signs,
       magnitude, one_large, missing, text_cells, rounded, random_response, categories, pairs, shuffled, one_edge,
       many_rows)  # fmt: skip


def _numbers(table):
    return [name for name in table if pd.api.types.is_numeric_dtype(table[name])]


def _number(table, rng):
    """A column of numbers."""
    return _any(rng, _numbers(table))


def _where(table, name, rows, value):
    return table.assign(**{name: np.where(rows, value, table[name])})


def _options(rng, table=None):
    found = []
    for option, share in (("--student", 0.1), ("--posterior-figures", 0.05), ("--verify", 0.05)):
        found += [option] if rng.random() < share else []
    for words, share in ((("--error", "additive"), 0.15), (("--gauge-sd", "0.01"), 0.2), (("--criterion", "0.3"), 0.1),
                         (("--edge", "none"), 0.1)):  # fmt: skip
        found += words if rng.random() < share else []
    if table is not None and "material" in table and rng.random() < 0.5:
        found += ["--by", "material"]
    return found


def _any(rng, choices):
    choices = list(choices)
    return choices[int(rng.integers(len(choices)))]


def laboratory(number, folder):
    """A laboratory file through the command."""
    case = list(CASES.values())[number % len(CASES)]
    return through_command(case.write(folder), shlex.split(case.options), folder, case.name)


def table(number, folder):
    """A mutated table of tests: read, fitted and judged, or through the command."""
    if number % WHOLE:
        return mutations.trial(number, folder)
    path, options, what = mutated(number, folder)
    return through_command(path, options, folder, what)


def odd(number, folder):
    """A table drawn at random, through the command."""
    path, options, what = odd_table(number, folder)
    return through_command(path, options, folder, what)


KINDS = {"table": table, "record": fuzz_records.trial, "odd": odd, "laboratory": laboratory} | fuzz_forms.KINDS


def through_command(path, options, folder, what):
    """Verdict, fault, description and size of a file that runs through the command."""
    size = path.stat().st_size if path.is_file() else 0
    code, trace, failed, _ = run(path, options, folder)
    fault = "; ".join(failed)
    if code not in DONE:
        last = " <- ".join(reversed(re.findall(r"fitmodels/([\w/]+\.py\", line \d+)", trace)[-3:]))
        fault = f"exit {code}: {trace.strip().splitlines()[-1]}  {last}"
    return f"exit {code}", fault, f"{what} {' '.join(options)}", size


def run(path, options, folder):
    """Exit code of the command, or 70 of a later one, its traceback, parts that failed, and warnings."""
    out, said, out_folder = io.StringIO(), io.StringIO(), folder / "result"
    with warnings.catch_warnings(record=True) as warned, contextlib.redirect_stdout(out):
        warnings.simplefilter("always")
        with contextlib.redirect_stderr(said), mock.patch.dict("os.environ", FITMODELS_TRACEBACK="1"):
            code, trace = command(str(path), "--json", "--out", str(out_folder), "--draws", "1000", *options)
            for words in () if trace else later(path, out_folder):
                if not trace:
                    after, trace = command(*words)
                    code = after if trace else code
    for one in warned:
        warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    texts = [out.getvalue(), *(file.read_text("utf-8") for file in sorted(out_folder.rglob("*.md")))]
    failed = sorted({found for text in texts for found in FAILED.findall(text)})
    trace = trace or (said.getvalue() if failed else "")
    return code, trace, failed, places(warned)


def places(warned):
    """Places and texts of warnings that neither this program nor a test helper raised."""
    return sorted(
        {
            f"{Path(one.filename).name}:{one.lineno} {one.category.__name__}: {one.message}"
            for one in warned
            if Path(one.filename).parent.name not in ("benchmarks", "tests")
        }
    )


def command(*words):
    """Exit code of a command, and the traceback of an internal error."""
    try:
        return cli.main(words), ""
    except Exception:
        return cli.DEFECT, f"{' '.join(words)}\n{traceback.format_exc()}"


def later(path, folder):
    """Commands that read the file, and the first parameter file that it gave."""
    yield "look", str(path), "--out", str(folder / "look.png")
    yield "next", str(path), "--runs", "3"
    params = next(iter(sorted(folder.rglob("params.json"))), None)
    if params is not None:
        yield "check", str(params)
        yield "card", str(params), "--force"
        yield "predict", str(params), "V=100", "f=0.2", "d=2", "t=5", "n=1000", "fz=0.1", "ae=1", "AW=0.1", "VB=0.1"
        yield "export", str(params), "--to", "mat", "--out", str(folder / "law.mat")


class TooSlow(BaseException):
    """CPU beyond the limit of a file."""


@dataclass(frozen=True)
class Result:
    """Outcome of a file: verdict, fault ("" where there is none), description, bytes, CPU in s, memory in MB."""

    kind: str
    number: int
    verdict: str
    fault: str
    what: str
    size: int
    cpu: float
    memory: float


def tried(kind, number, folder=None):
    """The result of one file."""
    with tempfile.TemporaryDirectory() as scratch:
        began, before = time.process_time(), _memory()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            verdict, fault, what, size = _limited(kind, number, Path(folder or scratch))
        cpu, memory = time.process_time() - began, _memory() - before
    mb = max(size, LEAST_BYTES) / 1e6
    faults = [fault, *(f"warning: {one}" for one in places(warned))]
    if cpu > CPU + CPU_PER_MB * mb and "CPU" not in fault:
        faults.append(f"{cpu:.1f} s of CPU for {size} bytes")
    if memory > MEMORY + MEMORY_PER_MB * mb:
        faults.append(f"{memory:.0f} MB more memory for {size} bytes")
    return Result(kind, number, verdict, "; ".join(filter(None, faults)), what, size, round(cpu, 3), round(memory, 1))


def _limited(kind, number, folder):
    """Return value of a trial, within the limit of CPU."""

    def stop(*_):
        raise TooSlow

    former = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, 3 * (CPU + CPU_PER_MB))
    try:
        return KINDS[kind](number, folder)
    except TooSlow:
        place = [one for one in traceback.extract_tb(sys.exc_info()[2]) if "fitmodels" in one.filename][-1:]
        where = "".join(f"{Path(one.filename).name}:{one.lineno}" for one in place)
        return "stopped", f"more than {3 * (CPU + CPU_PER_MB):.0f} s of CPU in {where}", "see --only", 0
    except Exception as error:
        trace = traceback.format_exc()
        last = " <- ".join(reversed(re.findall(r"/([\w]+\.py\", line \d+)", trace)[-3:]))
        return "error", f"{type(error).__name__}: {error} at {last}"[:500], "see --only", 0
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, former)


def _memory():
    """Largest memory of the process up to now, MB."""
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / (1e6 if sys.platform == "darwin" else 1e3)


def _prepared():
    """Limits of a process of the pool, with the libraries loaded before the first file is timed."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    fit.NotAvailable("")
    for kind in ("table", "record"):
        tried(kind, 1)


def _watched(kind, number):
    """The result of one file in a process that is ended where it does not react."""
    faulthandler.dump_traceback_later(HANGS, exit=True)
    try:
        return tried(kind, number)
    finally:
        faulthandler.cancel_dump_traceback_later()


def results(wanted, jobs):
    """Results of files (kind and number) in any order; where a process ends, its files are tried again alone."""
    if jobs == 1:
        yield from (tried(*one) for one in wanted)
        return
    wanted = iter(wanted)
    while True:
        left = []
        with ProcessPoolExecutor(jobs, initializer=_prepared) as pool:
            running = {}
            try:
                while True:
                    for one in islice(wanted, 4 * jobs - len(running)):
                        running[pool.submit(_watched, *one)] = one
                    if not running:
                        return
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        yield future.result()
                        running.pop(future)
            except BrokenProcessPool:
                left = list(running.values())
        for one in left:
            yield _alone(*one)


def _alone(kind, number):
    """The result of one file in a process of its own."""
    with ProcessPoolExecutor(1, initializer=_prepared) as pool:
        try:
            return pool.submit(_watched, kind, number).result()
        except BrokenProcessPool:
            return Result(kind, number, "ended", f"the process ended, or hung for {HANGS} s", "", 0, np.nan, np.nan)


def numbers(kind, files, seed):
    """Numbers of the files of a kind."""
    if kind == "laboratory":
        return range(min(files, len(CASES)))
    return range(1_000_000 * seed, 1_000_000 * seed + files)


def summary(done):
    """Counts by verdict, and CPU and memory, of each kind."""
    lines = []
    for kind in dict.fromkeys(one.kind for one in done):
        those = [one for one in done if one.kind == kind]
        cpu = np.array([one.cpu for one in those])
        most, last, longest = np.nanmedian(cpu), np.nanquantile(cpu, 0.99), np.nanmax(cpu)
        bad = sum(bool(one.fault) for one in those)
        lines.append(f"{kind}: {len(those)} files, {bad} at fault; CPU median {most:.2f}, 99 % {last:.2f}, "
                     f"largest {longest:.2f} s, sum {np.nansum(cpu):.0f} s; largest growth of memory "
                     f"{np.nanmax([one.memory for one in those]):.0f} MB")  # fmt: skip
        counts = Counter(one.verdict for one in those)
        lines += [f"  {count:7}  {verdict}" for verdict, count in sorted(counts.items())]
    return lines


def show_one(text, write):
    """Print the result of one file; with a folder, its file stays there."""
    kind, number = text.split(":")
    if write:
        Path(write).mkdir(parents=True, exist_ok=True)
    result = tried(kind, int(number), write)
    print(*asdict(result).items(), sep="\n")
    return int(bool(result.fault))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kind", choices=KINDS, action="append", help="of files; may be repeated (default: all)")
    parser.add_argument("--files", type=int, default=300, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--log", type=Path, metavar="FILE", help="results by line; files in it are not tried again")
    parser.add_argument("--only", metavar="KIND:NUMBER")
    parser.add_argument("--write", metavar="FOLDER", help="with --only, keep the files there")
    args = parser.parse_args()
    if args.only:
        return show_one(args.only, args.write)
    done = []
    if args.log and args.log.exists():
        done = [Result(**json.loads(line)) for line in args.log.read_text("utf-8").splitlines()]
    known = {(one.kind, one.number) for one in done}
    kinds = args.kind or list(KINDS)
    wanted = [(kind, number) for kind in kinds for number in numbers(kind, args.files, args.seed)]
    with contextlib.ExitStack() as open_files:
        log = open_files.enter_context(args.log.open("a", encoding="utf-8")) if args.log else None
        for result in results([one for one in wanted if one not in known], args.jobs):
            done.append(result)
            if result.fault:
                text = f"{result.kind}:{result.number}  {result.what}\n      {result.fault}"
                print(text.encode(errors="backslashreplace").decode(), flush=True)
            if log:
                print(json.dumps(asdict(result)), file=log, flush=True)
    done = [one for one in done if (one.kind, one.number) in set(wanted)]
    print(*summary(done), sep="\n")
    return int(any(one.fault for one in done))


if __name__ == "__main__":
    fit.NotAvailable("")  # loads the lazy package before warnings are recorded
    sys.exit(main())
