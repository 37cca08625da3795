"""Random mutations of good files: none may change an exponent without a message.

    python benchmarks/mutations.py [--files 2000] [--seed 1]
    python benchmarks/mutations.py --only 1000017 [--write FOLDER]

Each file is one of nine laboratory files (a central composite design of 24 edges, L9 x 2, 12 edges, no edge column,
German CSV, workbook, inches, a units row, no units at all) with one mutation: of the header, of units, of the
delimiter, of the place of cells, of the decimal mark, or of one cell. Cells are drawn until the mutation moves an
exponent by one standard error or more.

A mutation is *silent* when an exponent changed (by more than one standard error for a cell, by more than 1e-9 of
itself or a missing factor or law for all others) and the command prints neither a refusal nor a message (a doubt,
warning or assumption; rows left out of each law that changed, unless a column was shifted) that it does not print for
the good file. Where values were changed in some
rows, a check of the fit that the good file passes counts as well, in a column of its own. Silent ones are printed with
their seed; ``--only SEED`` shows one of them. A changed constant or number of edges is counted apart: the constant
of a column in another plausible unit cannot be seen.
"""

import argparse
import csv
import re
import sys
import tempfile
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fitmodels import datasets, fit

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from laboratory_truth import headed, reads, show, wear_test
from laboratory_workbooks import xlsx

EXACT = 1e-9  # relative: the same exponent
GERMAN = {
    "edge": "Schneide", "V": "Schnittgeschwindigkeit [m/min]", "f": "Vorschub [mm/U]", "d": "Schnitttiefe [mm]",
    "t": "Zeit [min]", "AW": "mittlerer Verschleiß [mm]", "Fc": "Schnittkraft [N]",
}  # fmt: skip
INCH = {"V": ("sfm", 3.28084), "f": ("in/rev", 1 / 25.4), "d": ("in", 1 / 25.4), "AW": ("in", 1 / 25.4)}
FACTORS = {
    "V": (1 / 60, 3.28084, 1000), "f": (1 / 25.4, 10, 1000), "d": (1 / 25.4, 0.1, 2), "t": (60, 1 / 60),
    "AW": (1000, 1 / 25.4, 39.37), "Fc": (0.001, 1 / 4.448), "P": (1000, 1.341), "Fxz": (0.001, 1 / 4.448),
}  # fmt: skip
OTHER_UNITS = {
    "V": ("m/s", "sfm", "mm/min"), "f": ("in/rev", "um/rev", "mm/min"), "d": ("in", "cm", "um"), "t": ("s", "h"),
    "AW": ("um", "in", "mil"), "Fc": ("kN", "lbf"), "P": ("W", "hp"), "Fxz": ("kN", "lbf"),
}  # fmt: skip


@dataclass
class Sheet:
    """Cells of a file, and how they are written."""

    roles: list[str]
    header: list[str]
    rows: list[list[str]]
    units: list[str] | None = None
    above: list[str] = field(default_factory=list)
    mark: str = ","
    decimal: str = "."
    book: bool = False
    marks: dict[int, str] = field(default_factory=dict)  # delimiter of single rows
    as_written: set[tuple[int, int]] = field(default_factory=set)  # cells that keep their point

    def name(self):
        return "data.xlsx" if self.book else "data.csv"

    def content(self):
        """Bytes of the file."""
        head = [self.header, *([self.units] if self.units else [])]
        if self.book:
            return xlsx({"Data": [*head, *([_number(cell) for cell in row] for row in self.rows)]})
        lines = [*self.above, *(self.mark.join(self._quoted(cell, self.mark) for cell in row) for row in head)]
        for i, row in enumerate(self.rows):
            mark = self.marks.get(i, self.mark)
            lines.append(mark.join(self._quoted(self._marked(i, j, cell), mark) for j, cell in enumerate(row)))
        return ("\n".join(lines) + "\n").encode()

    def _marked(self, i, j, cell):
        if self.decimal == "," and (i, j) not in self.as_written and re.fullmatch(r"-?\d*\.\d+", cell):
            return cell.replace(".", ",")
        return cell

    @staticmethod
    def _quoted(cell, mark):
        return f'"{cell}"' if mark in cell and mark != " " else cell

    def column(self, role):
        return self.roles.index(role)

    def numbers(self, role):
        """Numbers of a column, NaN where there is none."""
        j = self.column(role)
        return np.array([_number(row[j]) if isinstance(_number(row[j]), float) else np.nan for row in self.rows])


def _number(cell):
    try:
        return float(cell)
    except ValueError:
        return cell


def _sheet(w, names, **how):
    header = how.pop("header", None) or headed(w[names])
    return Sheet(list(names), list(header), [[show(v) for v in row] for row in w[names].itertuples(index=False)], **how)


def base(number, seed):
    """One of the good files, its numbers drawn by the seed."""
    names = ["edge", "V", "f", "d", "t", "AW", "Fc"]
    w = wear_test(f"mutations {seed}", edges=12 if number == 2 else 24)
    if number == 0:
        lines = datasets.bundled("gc435_709m40").read_text("utf-8").splitlines()
        notes = [line for line in lines if line.startswith("#")]
        rows = list(csv.reader(lines[len(notes) :]))
        roles = [re.split(r"[ \[]", cell)[0] for cell in rows[0]]
        return "24 edges, composite design", Sheet(roles, rows[0], rows[1:], above=notes)
    if number == 1:
        levels = np.array([(a, b, (a + b) % 3) for a in range(3) for b in range(3)] * 2)
        grid = np.column_stack(
            [np.array(v)[levels[:, k]] for k, v in enumerate(((80, 120, 180), (0.1, 0.2, 0.4), (1, 1.5, 2.5)))]
        )
        w = wear_test(f"mutations {seed}", grid=grid)
        return "L9 x 2", _sheet(w, names)
    if number == 2:
        return "12 edges", _sheet(w, names)
    if number == 3:
        return "no edge column", _sheet(w, names[1:])
    if number == 4:
        return "German CSV", _sheet(w, names, header=[GERMAN[n] for n in names], mark=";", decimal=",")
    if number == 5:
        return "workbook", _sheet(w, names, book=True)
    if number == 6:
        for role, (_, factor) in INCH.items():
            w[role] = (w[role] * factor).round(6)
        header = [f"{n} [{INCH[n][0]}]" if n in INCH else h for n, h in zip(names, headed(w[names]), strict=True)]
        return "inches", _sheet(w, names, header=header)
    if number == 7:
        units = ["", "m/min", "mm/rev", "mm", "min", "mm", "N"]
        return "units row", _sheet(w, names, header=names, units=units)
    return "no units", _sheet(wear_test(f"mutations {seed}", levels=False), names, header=names)


BASES = 9


# Each mutation takes a sheet and a generator, changes the sheet, and returns what it did, or "" where it cannot.


def renamed(s, rng):
    j = _any(rng, range(len(s.header)))
    old = s.header[j]
    word, _, unit = old.partition(" ")
    new = [f"Par_{j}", "X1", word[:-1] + "q", f"{word}_old", "", f"{word}{word}"]
    s.header[j] = f"{_any(rng, new)} {unit}".strip()
    return f"header {old!r} becomes {s.header[j]!r}"


def swapped(s, rng):
    a, b = rng.permutation(len(s.header))[:2]
    s.header[a], s.header[b] = s.header[b], s.header[a]
    return f"headers of columns {a + 1} and {b + 1} are exchanged"


def unit_dropped(s, rng):
    if s.units:
        j = _any(rng, [j for j, unit in enumerate(s.units) if unit])
        s.units[j] = ""
        return f"unit of column {j + 1} is dropped"
    places = [j for j, cell in enumerate(s.header) if "[" in cell]
    if not places:
        return ""
    j = _any(rng, places)
    s.header[j] = s.header[j].split(" [")[0]
    return f"unit of column {j + 1} is dropped"


def unit_exchanged(s, rng):
    role = _any(rng, [r for r in s.roles if r in OTHER_UNITS])
    j, unit = s.column(role), _any(rng, OTHER_UNITS[role])
    if s.units:
        s.units[j] = unit
    else:
        s.header[j] = f"{s.header[j].split(' [')[0]} [{unit}]"
    return f"unit of column {j + 1} becomes {unit}"


def header_extra(s, rng):
    j = int(rng.integers(len(s.header) + 1))
    s.header.insert(j, _any(rng, ["no", "", "remark", "x [mm]"]))
    return f"header has a further cell {s.header[j]!r} at {j + 1}"


def header_missing(s, rng):
    j = int(rng.integers(len(s.header)))
    return f"header lacks {s.header.pop(j)!r}"


def column_scaled(s, rng):
    role = _any(rng, [r for r in s.roles if r in FACTORS])
    factor = _any(rng, FACTORS[role])
    _scale(s, role, range(len(s.rows)), factor)
    return f"{role} x {factor:.5g} in every row"


def some_scaled(s, rng):
    role = _any(rng, [r for r in s.roles if r in FACTORS])
    factor, groups = _any(rng, FACTORS[role]), _edges(s)
    few = rng.permutation(len(groups))[: int(rng.integers(1, 5))]
    if rng.random() < 0.3 and role in ("AW", "Fc", "P", "Fxz"):
        rows = sorted(rng.permutation(len(s.rows))[: int(rng.integers(1, 5))])
    else:
        rows = sorted(row for k in few for row in groups[k])
    _scale(s, role, rows, factor)
    return (
        f"{role} x {factor:.5g} in rows {', '.join(str(row + 1) for row in rows[:12])}{'...' if len(rows) > 12 else ''}"
    )


def delimiter_all(s, rng):
    if s.book:
        return ""
    s.mark = _any(rng, [m for m in (",", ";", "\t", "|", " ") if m != s.mark])
    return f"delimiter becomes {s.mark!r}"


def delimiter_some(s, rng):
    if s.book:
        return ""
    rows = rng.permutation(len(s.rows))[: int(rng.integers(1, 6))]
    mark = _any(rng, [m for m in (",", ";", "\t", " ") if m != s.mark])
    s.marks |= dict.fromkeys(map(int, rows), mark)
    return f"delimiter of rows {sorted(int(r) + 1 for r in rows)} becomes {mark!r}"


def delimiter_doubled(s, rng):
    i, j = int(rng.integers(len(s.rows))), int(rng.integers(len(s.header)))
    s.rows[i].insert(j, "")
    return f"row {i + 1} has a further blank cell at {j + 1}"


def delimiter_lost(s, rng):
    i, j = int(rng.integers(len(s.rows))), int(rng.integers(len(s.header) - 1))
    s.rows[i][j : j + 2] = ["".join(s.rows[i][j : j + 2])]
    return f"row {i + 1}: cells {j + 1} and {j + 2} are one"


def row_shifted(s, rng):
    many = _any(rng, [1, 1, 1, 3, len(_edges(s)[0]), len(s.rows)])
    first = int(rng.integers(len(s.rows) - many + 1))
    j = int(rng.integers(len(s.header)))
    right = rng.random() < 0.5
    for row in s.rows[first : first + many]:
        row[j:] = ["", *row[j:-1]] if right else [*row[j + 1 :], ""]
    return (
        f"rows {first + 1} to {first + many}: cells from {j + 1} on are shifted to the {'right' if right else 'left'}"
    )


def column_shifted(s, rng):
    j, down, roll = int(rng.integers(len(s.header))), rng.random() < 0.5, rng.random() < 0.3
    cells = [row[j] for row in s.rows]
    fill = (cells[-1] if down else cells[0]) if roll else ""
    cells = [fill, *cells[:-1]] if down else [*cells[1:], fill]
    for row, cell in zip(s.rows, cells, strict=True):
        row[j] = cell
    return f"column {j + 1} is shifted {'down' if down else 'up'} by a row, {'rolled' if roll else 'blank at the end'}"


def decimal_cells(s, rng):
    if s.book:
        return _decimal(s, _places(s, rng, int(rng.integers(1, 4))))
    return _decimal(s, _places(s, rng, int(rng.integers(1, 6))))


def decimal_column(s, rng):
    j = _any(rng, [j for j in range(len(s.roles)) if any("." in row[j] for row in s.rows)])
    return _decimal(s, [(i, j) for i, row in enumerate(s.rows) if "." in row[j]])


def decimal_file(s, rng):
    return _decimal(s, [(i, j) for i, row in enumerate(s.rows) for j, cell in enumerate(row) if "." in cell])


def _decimal(s, places):
    if s.decimal == ",":
        s.as_written |= set(places)
    else:
        for i, j in places:
            s.rows[i][j] = s.rows[i][j].replace(".", ",")
    return f"other decimal mark in {len(places)} cells, the first in row {places[0][0] + 1}, column {places[0][1] + 1}"


def _places(s, rng, many):
    all_of_them = [(i, j) for i, row in enumerate(s.rows) for j, cell in enumerate(row) if "." in cell]
    return [all_of_them[k] for k in sorted(rng.permutation(len(all_of_them))[:many])]


def cell_digits(cell, rng):
    places = [k for k in range(len(cell) - 1) if cell[k].isdigit() and cell[k + 1].isdigit() and cell[k] != cell[k + 1]]
    if not places:
        return cell
    k = _any(rng, places)
    return cell[:k] + cell[k + 1] + cell[k] + cell[k + 2 :]


def cell_other_digit(cell, rng):
    places = [k for k in range(len(cell)) if cell[k].isdigit()]
    k = _any(rng, places)
    return cell[:k] + str(rng.integers(10)) + cell[k + 1 :]


CELLS = {
    "digits exchanged": cell_digits,
    "another digit": cell_other_digit,
    "decimal mark lost": lambda cell, rng: cell.replace(".", ""),
    "blank": lambda cell, rng: "",
    "sign": lambda cell, rng: f"-{cell}",
    "x 10": lambda cell, rng: show(float(cell) * 10),
    "/ 10": lambda cell, rng: show(float(cell) / 10),
    "copy of the neighbour": None,
}
CELL_TRIES = 400


def one_cell(s, rng, laws):
    """A mutation of a cell that moves an exponent by a standard error or more; "" where none was found."""
    laws = {key: law for key, law in laws.items() if {*law.factors, law.response} <= set(s.roles)}  # none derived
    roles = sorted({role for law in laws.values() for role in (*law.factors, law.response)})
    scale = {role: s.numbers(role) for role in roles}
    for _ in range(CELL_TRIES):
        role, i, kind = _any(rng, roles), int(rng.integers(len(s.rows))), _any(rng, list(CELLS))
        j = s.column(role)
        if CELLS[kind] is None:
            k = int(np.clip(j + rng.choice([-1, 1]), 0, len(s.header) - 1))
            new = s.rows[i][k]
        else:
            new = CELLS[kind](s.rows[i][j], rng)
        value = _number(new) if new else np.nan
        if not isinstance(value, float) or value == scale[role][i] or new == s.rows[i][j]:
            continue
        changed = {**scale, role: scale[role].copy()}
        changed[role][i] = value
        if _moves(scale, changed, laws) >= 1:
            text = f"row {i + 1}, {role}: {s.rows[i][j]} becomes {new!r} ({kind})"
            s.rows[i][j] = new
            return text
    return ""


def _moves(before, after, laws):
    """Largest change of an exponent, in standard errors."""
    worst = 0.0
    for law in laws.values():
        a, b = (_exponents(values, law) for values in (before, after))
        se = np.sqrt(np.diag(law.cov_theta))[1:]
        worst = max(worst, float(np.max(np.abs(b - a) / se)))
    return worst


def _exponents(values, law):
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(np.column_stack([values[name] for name in (*law.factors, law.response)]))
    logs = logs[np.isfinite(logs).all(axis=1)]
    X = np.column_stack([np.ones(len(logs)), logs[:, :-1]])
    return np.linalg.lstsq(X, logs[:, -1], rcond=None)[0][1:]


def _any(rng, choices):
    choices = list(choices)
    return choices[int(rng.integers(len(choices)))]


def _scale(s, role, rows, factor):
    j = s.column(role)
    for i in rows:
        s.rows[i][j] = f"{float(s.rows[i][j]) * factor:.15g}"


def _edges(s):
    """Rows of each edge: successive rows of the same conditions."""
    key = [tuple(row[s.column(role)] for role in ("edge", "V", "f", "d") if role in s.roles) for row in s.rows]
    starts = [i for i in range(len(key)) if i == 0 or key[i] != key[i - 1]]
    return [range(a, b) for a, b in zip(starts, [*starts[1:], len(key)], strict=True)]


KINDS = {
    "header": (renamed, swapped, unit_dropped, unit_exchanged, header_extra, header_missing),
    "unit": (column_scaled, some_scaled, some_scaled),
    "delimiter": (delimiter_all, delimiter_some, delimiter_doubled, delimiter_lost),
    "shift": (row_shifted, column_shifted),
    "decimal mark": (decimal_cells, decimal_column, decimal_file),
    "cell": (one_cell,),
}


VERDICTS = ("unchanged", "refused", "message", "check", "SILENT")
OF_VALUES = ("cell", "unit")  # mutations that leave the table as it is: the checks of the fit judge them too


@dataclass(frozen=True)
class Result:
    """One mutated file: what was done, whether an exponent, a constant or the edges changed, and the first message."""

    seed: int
    base: str
    kind: str
    done: str
    verdict: str  # of VERDICTS
    change: str = ""
    message: str = ""
    apart: str = ""  # constant or edges changed without a message


def sentences(outcome):
    """Sentences that the command prints about a reading beside its numbers; of a list of units each item."""
    found = {f"message: {text}" for text in outcome.messages}
    for text in () if outcome.runs is None else outcome.runs.assumed:
        head, _, items = text.partition(": ")
        listed = items.split(", ") if head.startswith("units that the file does not name") else [items]
        found |= {f"assumed: {head}: {re.sub(r'[0-9]+', '#', item)}" for item in listed}
    return found


def left_out(outcome):
    """Factors and rows that each law leaves out, by response."""
    return {
        response: {item.factor for item in law.left_out} | {f"rows: {item.reason}" for item in law.dropped}
        for (_, response), law in outcome.laws.items()
    }


def failed_checks(outcome):
    """Checks of the laws that are not passed, or that cannot be computed."""
    found = set()
    for (_, response), law in outcome.laws.items():
        checks = fit.judge(law).checks
        found |= {f"{response}: {name}" for name, check in checks.items() if getattr(check, "concern", 0)}
    return found


def changes(good, bad, kind):
    """Change of exponents of each law, by response; and of a constant or the edges, as a text."""
    exponents, apart = {}, ""
    for (number, response), right in good.items():
        law = bad.get((number, response))
        if law is None or set(law.theta_names) != set(right.theta_names):
            exponents[response] = "no law" if law is None else f"factors {', '.join(law.factors)}"
            continue
        order = [law.theta_names.index(name) for name in right.theta_names]
        difference = np.abs(law.theta[order] - right.theta)
        se = np.sqrt(np.diag(right.cov_theta))
        limit = se if kind == "cell" else EXACT * np.abs(right.theta)
        if (difference[1:] > limit[1:]).any():
            k = 1 + int(np.argmax((difference / se)[1:]))
            exponents[response] = f"{right.theta_names[k]} by {difference[k] / se[k]:.3g} SE"
        elif difference[0] > 1e-6:
            apart = apart or f"{response}: constant"
        elif law.n_edges != right.n_edges:
            apart = apart or f"{response}: {law.n_edges} edges instead of {right.n_edges}"
    return exponents, apart


def mutate(seed, folder):
    """The result of one file, None where the mutation does not apply."""
    rng = np.random.default_rng(seed)
    name, sheet = base(int(rng.integers(BASES)), seed)
    kind = _any(rng, KINDS)
    good = reads(_written(sheet, folder))
    if good.refusal:
        raise RuntimeError(f"the good file is refused: {name}, seed {seed}: {good.refusal}")
    copy = deepcopy(sheet)
    how = _any(rng, KINDS[kind])
    done = how(copy, rng, good.laws) if kind == "cell" else how(copy, rng)
    if not done or copy.content() == sheet.content():
        return None
    path = _written(copy, folder)
    try:
        bad = reads(path)
    except Exception as error:  # a defect of the reading is a failure too
        return Result(seed, name, kind, done, "SILENT", f"error {type(error).__name__}: {error}")
    if bad.refusal:
        return Result(seed, name, kind, done, "refused", message=bad.refusal)
    changed, apart = changes(good.laws, bad.laws, kind)
    change = "; ".join(f"{response}: {text}" for response, text in changed.items())
    if not changed and not apart:
        return Result(seed, name, kind, done, "unchanged")
    if added := sentences(bad) - sentences(good):
        return Result(seed, name, kind, done, "message", change, min(added))
    before, after = left_out(good), left_out(bad)
    added = {response: after.get(response, set()) - before[response] for response in changed}
    if changed and all(added.values()) and how is not column_shifted:  # there, the row left out is not the fault
        return Result(seed, name, kind, done, "message", change, str(added))
    if changed and kind in OF_VALUES and (added := failed_checks(bad) - failed_checks(good)):
        return Result(seed, name, kind, done, "check", change, ", ".join(sorted(added)))
    return Result(seed, name, kind, done, "SILENT" if changed else "unchanged", change, apart=apart)


def _written(sheet, folder):
    path = Path(folder) / sheet.name()
    path.write_bytes(sheet.content())
    return path


def run(files, seed, report=lambda result: None):
    """Results of this many mutated files."""
    results, number = [], 0
    with tempfile.TemporaryDirectory() as folder:
        while len(results) < files:
            result = mutate(1_000_000 * seed + number, folder)
            number += 1
            if result is not None:
                results.append(result)
                report(result)
    return results


def show_one(seed, folder):
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(folder or scratch)
        place.mkdir(exist_ok=True)
        result = mutate(seed, place)
        print(*vars(result).items(), sep="\n") if result else print("this mutation does not apply")
        if folder:
            print(next(place.iterdir()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--files", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="SEED")
    parser.add_argument("--write", metavar="FOLDER")
    args = parser.parse_args()
    if args.only is not None:
        show_one(args.only, args.write)
        return 0

    def report(result):
        if result.verdict == "SILENT":
            print(f"SILENT {result.seed}  {result.base}; {result.done}  ->  {result.change}", flush=True)

    results = run(args.files, args.seed, report)
    print(f"\n{'':14}{'files':>8}" + "".join(f"{v:>11}" for v in VERDICTS) + f"{'apart':>8}")
    for kind in (*KINDS, "all"):
        of_kind = [r for r in results if kind in (r.kind, "all")]
        count = Counter(r.verdict for r in of_kind)
        apart = sum(bool(r.apart) for r in of_kind)
        print(f"{kind:14}{len(of_kind):8}" + "".join(f"{count[v]:11}" for v in VERDICTS) + f"{apart:8}")
    print("apart: only a constant or the number of edges changed, without a message")
    return int(any(r.verdict == "SILENT" for r in results))


if __name__ == "__main__":
    sys.exit(main())
