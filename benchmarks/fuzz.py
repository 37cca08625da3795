"""Awkward files through the command: none may end with an internal error (exit 70).

    python benchmarks/fuzz.py [--files 300] [--seed 1]
    python benchmarks/fuzz.py --only odd:1017 [--write FOLDER]

Three sources: the laboratory files of ``tests``, mutations of good files (``mutations.py``), and odd tables drawn at
random: few rows, constant or exactly dependent columns, exact laws, copies, zeros, signs, magnitudes from 1e-300 to
1e300, one edge, edges of one row, levels of a category, with random options of the command. Each file runs through
``fitmodels FILE --json --out FOLDER``, which reads, fits, checks, draws, and writes all files of a card; then the
commands look, next, check, card, predict and export read the file or the first parameter file.

Printed are runs that end with exit 70, with the place of the error; optional parts that failed and cost only themselves
("the computation failed"), which are defects as well; and warnings of the numerical libraries.
"""

import argparse
import contextlib
import io
import re
import shlex
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from copy import deepcopy
from pathlib import Path
from unittest import mock

import mutations
import numpy as np
import pandas as pd
from fitmodels import cli, fit

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from laboratory_files import CASES

DONE = (0, 2, 3, 4, 5)  # exit codes that the command documents
FAILED = re.compile(r"the computation failed \([^\"\n)]*\)")
UNITS = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm", "VB": "mm", "Fc": "N", "P": "kW", "Ra": "um",
         "Fx": "N", "F": "N", "I": "A", "fm": "mm/min", "n": "1/min", "fz": "mm"}  # fmt: skip


def laboratory(number, folder):
    """A laboratory file, and its options."""
    case = list(CASES.values())[number]
    return case.write(folder), shlex.split(case.options), case.name


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


def odd(seed, folder):
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


SOURCES = {"laboratory": laboratory, "mutated": mutated, "odd": odd}


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
    texts = [out.getvalue(), *(file.read_text("utf-8") for file in sorted(out_folder.rglob("*.md")))]
    failed = sorted({found for text in texts for found in FAILED.findall(text)})
    trace = trace or (said.getvalue() if failed else "")
    places = sorted({f"{Path(one.filename).name}:{one.lineno} {one.message}" for one in warned})
    return code, trace, failed, places


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


def tried(source, number):
    """The result of one file."""
    with tempfile.TemporaryDirectory() as scratch:
        path, options, what = SOURCES[source](number, Path(scratch))
        return what, options, *run(path, options, Path(scratch))


def numbers(source, files, seed):
    """Numbers of the files of a source."""
    if source == "laboratory":
        return list(range(len(CASES)))[:files]
    return [1000 * seed + k for k in range(files)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--files", type=int, default=300, help="of each source")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--source", choices=SOURCES, action="append")
    parser.add_argument("--only", metavar="SOURCE:NUMBER")
    parser.add_argument("--write", metavar="FOLDER")
    args = parser.parse_args()
    if args.only:
        source, number = args.only.split(":")
        if args.write:
            print(*SOURCES[source](int(number), Path(args.write)))
            return 0
        print(*tried(source, int(number)), sep="\n")
        return 0
    bad, codes, parts, warned = 0, Counter(), Counter(), Counter()
    for source in args.source or SOURCES:
        for number in numbers(source, args.files, args.seed):
            what, options, code, trace, failed, places = tried(source, number)
            codes[code] += 1
            parts.update(failed)
            warned.update(places)
            bad += code not in DONE
            if code not in DONE or failed:
                last = " <- ".join(reversed(re.findall(r"fitmodels/([\w/]+\.py\", line \d+)", trace)[-3:]))
                print(f"{code}  {source}:{number}  {what}  {' '.join(options)}", flush=True)
                print(f"      {'; '.join(failed) or trace.strip().splitlines()[-1]}  {last}", flush=True)
    print("\nexit codes:", dict(sorted(codes.items())))
    for title, found in (("parts that failed", parts), ("warnings", warned)):
        print(f"{title}: {sum(found.values())}")
        print(*(f"  {n} x {words[:200]}" for words, n in found.most_common(40)), sep="\n")
    return int(bad > 0)


if __name__ == "__main__":
    fit.NotAvailable("")  # loads the lazy package before warnings are recorded
    sys.exit(main())
