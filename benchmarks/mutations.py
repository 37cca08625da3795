"""Files of tests in equal forms, and files with one mutation: none may change an exponent without a message.

``trial`` draws a file from its number, for ``benchmarks/fuzz.py``: one of the good files of ``BASES`` (a central
composite design of 24 edges, L9 x 2, 12 edges, no edge column, German CSV, workbook, inches, a units row, no units at
all, tool lives, forces and roughness of single tests, milling), which becomes

equal
    one to four changes of form: delimiter, decimal mark, encoding, ends of lines, quotes, blank lines, comments, kind
    of workbook, units, order of columns and rows, names in four languages, notation of numbers, further columns.
    Exponents, standard errors and edges must be the same.
cell
    one corrupted cell. With ``any cell`` it is drawn once, otherwise until an exponent of a fit of all rows moves by a
    standard error or more. It must be refused, or named by its line or edge, or a message or check must be new; cells
    that only a passed check names, as the largest influence or deviation, and those in whose rows nothing deviates by
    more than three standard deviations of the scatter, are counted apart.
header, unit, delimiter, shift, decimal mark
    a mutation of many cells, that must not be *silent*: an exponent changed (by more than 1e-9 of itself, or a missing
    factor or law) and the command prints neither a refusal nor a message (a doubt, warning or assumption; rows left out
    of each law that changed, unless a column was shifted) that it does not print for the good file. Where values were
    changed in some rows, a check of the fit that the good file passes counts as well. The constant of a column in
    another plausible unit cannot be seen, and is not compared.
long
    a cell, name or comment of up to a million characters, which must cost time in proportion to its length.
"""

import csv
import re
import sys
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.datasets.vocabulary import ROLES, role_of

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from laboratory_truth import UNITS, headed, reads, show, wear_test
from laboratory_workbooks import ods, xls, xlsx

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
    book: str = ""  # kind of workbook
    marks: dict[int, str] = field(default_factory=dict)  # delimiter of single rows
    as_written: set[tuple[int, int]] = field(default_factory=set)  # cells that keep their point
    encoding: str = "utf-8"
    end: str = "\n"
    quotes: bool = False  # around every cell
    closed: bool = False  # a delimiter ends each line
    between: dict[int, str] = field(default_factory=dict)  # lines before single rows

    def name(self):
        return f"data.{self.book or 'csv'}"

    def content(self):
        """Bytes of the file."""
        head = [self.header, *([self.units] if self.units else [])]
        if self.book:
            rows = [*head, *([_number(cell) for cell in row] for row in self.rows)]
            return xlsx({"Data": rows}) if self.book == "xlsx" else {"xls": xls, "ods": ods}[self.book](rows)
        lines = [*self.above, *(self._line(row, self.mark) for row in head)]
        for i, row in enumerate(self.rows):
            lines += [self.between[i]] if i in self.between else []
            lines.append(self._line([self._marked(i, j, cell) for j, cell in enumerate(row)], self.marks.get(i)))
        return (self.end.join(lines) + self.end).encode(self.encoding)

    def _line(self, cells, mark):
        mark = mark or self.mark
        quoted = [f'"{cell}"' if self.quotes else self._quoted(cell, mark) for cell in cells]
        return mark.join(quoted) + (mark if self.closed else "")

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
        return "workbook", _sheet(w, names, book="xlsx")
    if number == 6:
        for role, (_, factor) in INCH.items():
            w[role] = (w[role] * factor).round(6)
        header = [f"{n} [{INCH[n][0]}]" if n in INCH else h for n, h in zip(names, headed(w[names]), strict=True)]
        return "inches", _sheet(w, names, header=header)
    if number == 7:
        units = ["", "m/min", "mm/rev", "mm", "min", "mm", "N"]
        return "units row", _sheet(w, names, header=names, units=units)
    if number == 8:
        return "no units", _sheet(wear_test(f"mutations {seed}", levels=False), names, header=names)
    return SINGLE[number - 9](np.random.default_rng((seed, number)))


def lives(rng):
    """Tool lives of 18 single tests, by Taylor's extended law."""
    V, f, d = _grid(rng, (100, 150, 200, 260), (0.1, 0.16, 0.25), (1, 2))[:, :18]
    T = 4.0 * (V / 200) ** -3.2 * (f / 0.16) ** -0.9 * (d / 1.5) ** -0.4 * 3 * np.exp(0.12 * rng.normal(size=18))
    return "tool lives", _sheet(pd.DataFrame({"V": V, "f": f, "d": d, "T": T.round(1)}), ["V", "f", "d", "T"])


def forces(rng):
    """Forces of 27 single tests."""
    V, f, d = _grid(rng, (80, 120, 180), (0.1, 0.2, 0.35), (1, 1.5, 2.5))
    scatter = np.exp(0.04 * rng.normal(size=(2, 27)))
    Fc, Ff = 1700 * f**0.74 * d**0.96 * V**-0.08 * scatter[0], 700 * f**0.5 * d**0.9 * V**-0.15 * scatter[1]
    frame = pd.DataFrame({"V": V, "f": f, "d": d, "Fc": Fc.round(), "Ff": Ff.round()})
    return "forces", _sheet(frame, list(frame), header=[f"{n} [{OTHERS.get(n, UNITS.get(n))}]" for n in frame])


def roughness(rng):
    """Roughness of 16 single tests."""
    V, f, d = _grid(rng, (90, 140, 200, 280), (0.08, 0.12, 0.2, 0.3), (0.5,))
    Ra = 40 * f**1.5 * V**-0.1 * np.exp(0.08 * rng.normal(size=16))
    frame = pd.DataFrame({"V": V, "f": f, "d": d * np.where(rng.random(16) < 0.5, 1, 2), "Ra": Ra.round(2)})
    return "roughness", _sheet(frame, list(frame), header=[f"{n} [{OTHERS.get(n, UNITS.get(n))}]" for n in frame])


def milling(rng):
    """Flank wear of 12 mills by speed, feed per tooth and time."""
    n, fz = _grid(rng, (2000, 3000, 4200, 6000), (0.05, 0.08, 0.12))
    n, fz, t = np.repeat(n, 5), np.repeat(fz, 5), np.tile((3.0, 6, 10, 15, 20), 12)
    VB = 0.03 * (n / 3000) ** 0.9 * (fz / 0.08) ** 0.4 * t**0.6
    VB = VB * np.exp(np.repeat(0.06 * rng.normal(size=12), 5) + 0.06 * rng.normal(size=60))
    edge = np.repeat([f"T{k}" for k in range(1, 13)], 5)
    frame = pd.DataFrame({"edge": edge, "n": n, "fz": fz, "t": t, "VB": VB.round(3)})
    return "milling", _sheet(frame, list(frame), header=["tool no", "n [1/min]", "fz [mm]", "t [min]", "VB [mm]"])


def _grid(rng, *levels):
    """Conditions of a full factorial plan in random order, one row for each factor."""
    grid = np.array(np.meshgrid(*levels)).reshape(len(levels), -1)
    return grid[:, rng.permutation(grid.shape[1])]


OTHERS = {"Ff": "N", "Ra": "um"}
SINGLE = (lives, forces, roughness, milling)
BASES = 9 + len(SINGLE)


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


def any_cell(s, rng, laws):
    """A mutation of a cell, whether or not it moves an exponent."""
    return one_cell(s, rng, laws, 0.0)


def one_cell(s, rng, laws, least=1.0):
    """A mutation of a cell that moves an exponent by so many standard errors; "" where none was found."""
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
        if _moves(scale, changed, laws) >= least:
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


LONG = ("{pad} {x}", "{x}{pad}", "{digits}", "1.{digits}", "{brackets}{x}", "{x} {brackets}", "{x}{pad}[mm]", "{words}",
        "{x} ({pad}", "1{commas}", "-{pad}1", "{x}[{digits}")  # fmt: skip


def long_cell(s, rng):
    """A cell, a name or a comment becomes long."""
    n = int(10 ** rng.uniform(2.5, 5))
    form = _any(rng, LONG)
    text = form.format(
        x=_any(rng, ["x", "V", "0.2", "mm"]),
        pad=_any(rng, [" ", "\t", "\u00a0"]) * n,
        digits="1" * n,
        brackets="[(" * (n // 2),
        words="ab " * (n // 3),
        commas=".000" * (n // 4),
    )
    place = _any(rng, ["cell", "cell", "header", "comment"])
    if place == "comment" and not s.book:
        s.above.append(f"# {text}")
    elif place == "header":
        s.header[int(rng.integers(len(s.header)))] = text[:32_000]
    else:
        s.rows[int(rng.integers(len(s.rows)))][int(rng.integers(len(s.header)))] = text[:32_000]
    return f"{place} of {len(text)} characters, {form}"


KINDS = {
    "header": (renamed, swapped, unit_dropped, unit_exchanged, header_extra, header_missing),
    "unit": (column_scaled, some_scaled, some_scaled),
    "delimiter": (delimiter_all, delimiter_some, delimiter_doubled, delimiter_lost),
    "shift": (row_shifted, column_shifted),
    "decimal mark": (decimal_cells, decimal_column, decimal_file),
    "cell": (one_cell,),
    "any cell": (any_cell,),
    "long": (long_cell,),
}
SHARES = {"equal": 0.3, "cell": 0.35, "any cell": 0.1, "long": 0.05}  # of the files; the others in equal parts


# Each change of form leaves the numbers of a sheet as they are, and returns what it did, or "" where it cannot.


def other_delimiter(s, rng):
    if s.book or (s.mark == ";" and s.decimal == ","):
        return ""
    s.mark = _any(rng, [m for m in (",", ";", "\t", "|") if m != s.mark])
    return f"delimiter {s.mark!r}"


def decimal_comma(s, rng):
    if s.book or s.decimal == ",":
        return ""
    s.decimal, s.mark = ",", _any(rng, [";", "\t"])
    return f"decimal comma, delimiter {s.mark!r}"


def other_encoding(s, rng):
    if s.book:
        return ""
    s.encoding = _any(rng, ["utf-8-sig", "utf-16", "cp1252", "latin-1", "utf-16-le"])
    if s.encoding == "utf-16-le":
        s.encoding = "utf-16"
        s.end = "\r\n"
    return f"encoding {s.encoding}"


def line_ends(s, rng):
    s.end = "" if s.book else _any(rng, ["\r\n", "\r"])
    return f"ends of lines {s.end!r}" if s.end else ""


def quoted(s, rng):
    s.quotes = not s.book
    return "quotes" if s.quotes else ""


def closed(s, rng):
    s.closed = not s.book
    return "a delimiter ends each line" if s.closed else ""


def blank_lines(s, rng):
    if s.book:
        return ""
    s.between |= dict.fromkeys(map(int, rng.integers(len(s.rows), size=3)), _any(rng, ["", " "]))
    return "blank lines"


def comments(s, rng):
    if s.book:
        return ""
    s.above.append(_any(rng, ["# measured by hand", "# lathe 7; 3.4.2019", "% campaign B, 12 of 14", "# a, b: c"]))
    return f"comment {s.above[-1]!r}"


def workbook(s, rng):
    if s.above:
        return ""
    s.book, s.decimal = _any(rng, ["xlsx", "xls", "ods"]), "."
    return s.book


def other_units(s, rng):
    """Columns whose header names the usual unit are converted."""
    done = []
    for j, role in enumerate(s.roles):
        usual = f" [{UNITS.get(role, OTHERS.get(role))}]"
        if s.units or role not in SAME_UNITS or usual not in s.header[j] or rng.random() < 0.5:
            continue
        unit, factor = _any(rng, SAME_UNITS[role])
        s.header[j] = s.header[j].replace(usual, f" [{unit}]")
        for row in s.rows:
            row[j] = f"{float(row[j]) * factor:.17g}" if row[j] else ""
        done.append(f"{role} in {unit}")
    return ", ".join(done)


def other_brackets(s, rng):
    if s.units or not any("[" in cell for cell in s.header):
        return ""
    how = _any(rng, ["({})", "in {}", "/ {}", ", {}"])
    if how == ", {}" and s.mark == ",":
        return ""
    s.header = [re.sub(r"\[(.*)\]", lambda m: how.format(m[1]), cell) for cell in s.header]
    return f"units as {how}"


def units_below(s, rng):
    if s.units or not any("[" in cell for cell in s.header):
        return ""
    found = [re.fullmatch(r"(.*?) ?(?:\[(.*)\])?", cell) for cell in s.header]
    s.header, s.units = [one[1] for one in found], [one[2] or "" for one in found]
    return "units in a row of their own"


def column_order(s, rng):
    order = rng.permutation(len(s.roles))
    s.roles, s.header = [s.roles[j] for j in order], [s.header[j] for j in order]
    s.units = s.units and [s.units[j] for j in order]
    s.rows = [[row[j] for j in order] for row in s.rows]
    return f"columns {', '.join(s.roles)}"


def edge_order(s, rng):
    """Edges in another order, their rows as they were; all rows where each is a test of its own."""
    if "t" in s.roles and "edge" not in s.roles:
        return ""
    groups = _edges(s) if "edge" in s.roles else [[i] for i in range(len(s.rows))]
    s.rows = [s.rows[i] for k in rng.permutation(len(groups)) for i in groups[k]]
    return "edges in another order"


def row_order(s, rng):
    """Rows of named edges by time, as where all edges are measured at a time."""
    if not {"t", "edge"} <= set(s.roles):
        return ""
    j = s.column("t")
    s.rows.sort(key=lambda row: float(row[j] or "nan"))
    return "rows by time"


def other_names(s, rng):
    """Names of the vocabulary in one of its languages, where the name alone or with its unit is that quantity."""
    done = []
    for j, role in enumerate(s.roles):
        if role not in ROLES or rng.random() < 0.4 or (" [" not in s.header[j] and role != "edge"):
            continue
        names = [
            name for name in ROLES[role].names if len(name) > 2 and role_of(name, None) == role and s.mark not in name
        ]
        if names:
            name = _any(rng, names)
            s.header[j] = name if role == "edge" else f"{name} {s.header[j][s.header[j].index('[') :]}"
            done.append(name)
    return ", ".join(done)


def notation(s, rng):
    how = _any(rng, ["{:.10e}", "{:+.12g}", " {:.12g} ", "{:.12f}"])
    for row in () if s.decimal == "," else s.rows:
        row[:] = [how.format(_number(cell)) if _is_number(cell, j, s) else cell for j, cell in enumerate(row)]
    return "" if s.decimal == "," else f"numbers as {how!r}"


def _is_number(cell, j, s):
    return s.roles[j] != "edge" and isinstance(_number(cell), float)


def further_column(s, rng):
    name, cells = _any(rng, [("remark", ["ok", "", "chatter"]), ("operator", ["A. Meier", "B. Roux"]), ("", [""]),
                             ("Datum", ["2019-03-04", "2019-03-05"])])  # fmt: skip
    s.roles, s.header = [*s.roles, "none"], [*s.header, name]
    s.units = s.units and [*s.units, ""]
    s.rows = [[*row, _any(rng, cells)] for row in s.rows]
    return f"further column {name!r}"


def edge_names(s, rng):
    if "edge" not in s.roles:
        return ""
    j, how = s.column("edge"), _any(rng, ["{}", "Versuch {}", "T-{:03d}", "edge {}", "{}.A"])
    known = {name: how.format(k + 1) for k, name in enumerate(dict.fromkeys(row[j] for row in s.rows))}
    for row in s.rows:
        row[j] = known[row[j]]
    return f"edges named {how!r}"


EQUAL = (other_delimiter, decimal_comma, other_encoding, line_ends, quoted, closed, blank_lines, comments, workbook,
         other_units, other_brackets, units_below, column_order, edge_order, row_order, other_names, notation,
         further_column, edge_names)  # fmt: skip
SAME_UNITS = {
    "V": (("m/s", 1 / 60), ("mm/min", 1000.0)), "f": (("um/rev", 1000.0), ("in/rev", 1 / 25.4)),
    "d": (("um", 1000.0), ("cm", 0.1), ("in", 1 / 25.4)), "t": (("s", 60.0), ("h", 1 / 60)), "T": (("s", 60.0),),
    "AW": (("um", 1000.0), ("in", 1 / 25.4)), "VB": (("um", 1000.0),), "Fc": (("kN", 1e-3),), "Ff": (("kN", 1e-3),),
    "P": (("W", 1000.0),), "Fxz": (("kN", 1e-3),), "Ra": (("uin", 1 / 0.0254),), "n": (("1/s", 1 / 60),),
}  # fmt: skip


DOUBLED = 2.0  # growth of the scatter of rows below which nothing shows that a column is shifted or scaled
SCATTER = 3.0  # standard deviations within which good rows lie too: nothing shows such a cell
EQUAL_SE = 1e-7  # relative, of standard errors


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
    found, pairs = set(), [] if outcome.runs is None else list(outcome.runs.pairs())
    for (_, response), law in outcome.laws.items():
        checks = fit.judge(law, runs=pairs[0] if len(pairs) == 1 else None).checks
        found |= {f"{response}: {name}" for name, check in checks.items() if getattr(check, "concern", 0)}
    return found


def changes(good, bad, cell):
    """Change of exponents of each law, by response."""
    exponents = {}
    for (number, response), right in good.items():
        law = bad.get((number, response))
        if law is None or set(law.theta_names) != set(right.theta_names):
            exponents[response] = "no law" if law is None else f"factors {', '.join(law.factors)}"
            continue
        order = [law.theta_names.index(name) for name in right.theta_names]
        difference = np.abs(law.theta[order] - right.theta)
        se = np.sqrt(np.diag(right.cov_theta))
        limit = se if cell else EXACT * np.abs(right.theta)
        if (difference[1:] > limit[1:]).any():
            k = 1 + int(np.argmax((difference / se)[1:]))
            exponents[response] = f"{right.theta_names[k]} by {difference[k] / se[k]:.3g} SE"
    return exponents


def same_laws(good, bad):
    """Difference between the laws of equal files; "" where there is none."""
    if good.keys() != bad.keys():
        return f"laws {[k[1] for k in bad]} instead of {[k[1] for k in good]}"
    for (_, response), right in good.items():
        law = bad[_, response]
        if law.theta_names != right.theta_names:
            return f"{response}: factors {', '.join(law.factors)} instead of {', '.join(right.factors)}"
        if law.n_edges != right.n_edges:
            return f"{response}: {law.n_edges} edges instead of {right.n_edges}"
        se, other = (np.sqrt(np.diag(one.cov_theta)) for one in (right, law))
        off = np.abs(law.theta - right.theta) / np.maximum(np.abs(right.theta), se)
        if not np.allclose(se, other, rtol=EQUAL_SE) or (off > EXACT).any():
            return f"{response}: exponents differ by up to {off.max():.2g}, standard errors by {np.max(other / se):.9g}"
    return ""


def named(changed, good, bad, row, sheet):
    """Kind of message on a corrupted cell: by its line or edge, another message or check, a check passed, or none."""
    line = _line_of(sheet, row)
    mark = re.compile(rf"\b(?:{line}|{re.escape(_edge_of(sheet, row))})\b")
    checks = [check for law in bad.laws.values() for check in fit.judge(law).checks.values()]
    said = sentences(bad) - sentences(good)
    said |= {check.verdict for check in checks if getattr(check, "concern", 0)}
    dropped = {i for law in bad.laws.values() for one in law.dropped for i in one.lines}
    if line in dropped or any(mark.search(text) for text in said):
        return "named"
    if (sentences(bad) - sentences(good)) or failed_checks(bad) - failed_checks(good):
        return "doubted"
    before, after = left_out(good), left_out(bad)
    if any(after.get(key, set()) - before[key] for key in changed):
        return "doubted"
    passed = any(mark.search(getattr(check, "verdict", "")) for check in checks)
    return "named in a check that is passed" if passed else ""


def _edge_of(sheet, row):
    """Name of the edge of a row, as the program names it where the file has none."""
    if "edge" in sheet.roles:
        return sheet.rows[row][sheet.column("edge")]
    at = next((k for k, rows in enumerate(_edges(sheet)) if row in rows), 0) if "t" in sheet.roles else None
    return "no edge" if at is None else f"E{at + 1:02d}"


def _deviation(good, bad, response, line):
    """Deviation of a row with its corrupted cell from the law of the good file, in standard deviations of its rows."""
    right, law = (next((one for key, one in seen.laws.items() if key[1] == response), None) for seen in (good, bad))
    if law is None or law.factors != right.factors or line not in law.lines or not right.formula.log_factors:
        return np.inf
    at = int(np.flatnonzero(law.lines == line)[0])
    eta = right.theta @ [1.0, *np.log(law.X[at])]
    return abs(np.log(law.observed[at]) - eta) / np.sqrt(right.rss / right.df_resid)


def _line_of(sheet, row):
    """Line of a row in the file."""
    return len(sheet.above) + 1 + bool(sheet.units) + row + 1


def trial(seed, folder):
    """Verdict, fault, description and size of one file."""
    rng = np.random.default_rng(seed)
    while True:
        name, sheet = base(int(rng.integers(BASES)), int(rng.integers(2**31)))
        good = reads(_written(sheet, folder))
        if good.refusal:
            raise RuntimeError(f"the good file is refused: {name}: {good.refusal}")
        kind = _kind(rng)
        if kind == "equal":
            return equal(name, sheet, good, rng, folder)
        copy, how = deepcopy(sheet), _any(rng, KINDS[kind])
        done = how(copy, rng, good.laws) if "cell" in kind else how(copy, rng)
        if done and copy.content() != sheet.content():
            path = _written(copy, folder)
            verdict, fault = judged(kind, how, good, reads(path), copy, sheet)
            return f"{kind}: {verdict}", fault, f"{name}; {done}"[:300], path.stat().st_size


def _kind(rng):
    others = [kind for kind in KINDS if kind not in SHARES]
    at = np.searchsorted(np.cumsum(list(SHARES.values())), rng.random())
    return list(SHARES)[at] if at < len(SHARES) else _any(rng, others)


def equal(name, sheet, good, rng, folder):
    """The same numbers in another form."""
    done = [EQUAL[k](sheet, rng) for k in rng.permutation(len(EQUAL))[: int(rng.integers(1, 5))]]
    try:
        path = _written(sheet, folder)
    except UnicodeEncodeError:
        sheet.encoding = "utf-8"
        path = _written(sheet, folder)
    bad = reads(path)
    what = f"{name}; {'; '.join(filter(None, done))}"[:400]
    fault = f"an equal file is refused: {bad.refusal}"[:400] if bad.refusal else same_laws(good.laws, bad.laws)
    doubted = set(bad.doubts) - set(good.doubts)
    verdict = "DIFFERENT" if fault else "the same, doubted" if doubted else "the same"
    return f"equal: {verdict}", fault and f"{fault} {' '.join(bad.messages)}"[:600], what, path.stat().st_size


def judged(kind, how, good, bad, copy, sheet):
    """Verdict on a mutated file, and its fault."""
    if bad.refusal:
        return "refused", ""
    changed = changes(good.laws, bad.laws, "cell" in kind or kind == "long")
    if kind in ("long", "header"):  # a response whose name is lost has no law, and its column is listed as not used
        lost = {response for response, text in changed.items() if text == "no law"}
        changed = {response: text for response, text in changed.items() if not _only_lost(good, bad, response, lost)}
    change = "; ".join(f"{response}: {text}" for response, text in changed.items())
    if not changed:
        return "below 1 SE" if "cell" in kind else "unchanged", ""
    if "cell" in kind:
        row = next(i for i, (a, b) in enumerate(zip(copy.rows, sheet.rows, strict=True)) if a != b)
        seen = named(changed, good, bad, row, copy)
        if not seen and all(_deviation(good, bad, key, _line_of(copy, row)) < SCATTER for key in changed):
            return "not visible: within 3 standard deviations of the scatter", ""
        return (seen, "") if seen else ("MISSED", f"not named: {change}")
    if sentences(bad) - sentences(good):
        return "message", ""
    before, after = left_out(good), left_out(bad)
    added = {response: after.get(response, set()) - before[response] for response in changed}
    if all(added.values()) and how is not column_shifted:  # there, the row left out is not the fault
        return "message", ""
    if failed_checks(bad) - failed_checks(good):
        return "check", ""
    if all(_growth_of_scatter(good, bad, response) < DOUBLED for response in changed):
        return f"not visible: the scatter grows less than {DOUBLED:g} times, and every check is passed", ""
    return "SILENT", change


def _only_lost(good, bad, response, lost):
    """Whether a law is lost with the name of its response, or differs only by factors that are lost."""
    right, law = (next((one for key, one in seen.laws.items() if key[1] == response), None) for seen in (good, bad))
    return law is None or (lost and set(right.factors) - lost == set(law.factors) != set(right.factors))


def _growth_of_scatter(good, bad, response):
    """Ratio of the residual standard errors of a law, infinite where its factors differ."""
    right, law = (next((one for key, one in seen.laws.items() if key[1] == response), None) for seen in (good, bad))
    if law is None or law.factors != right.factors:
        return np.inf
    return np.sqrt(law.rss / law.df_resid / (right.rss / right.df_resid))


def _written(sheet, folder):
    path = Path(folder) / sheet.name()
    path.write_bytes(sheet.content())
    return path
