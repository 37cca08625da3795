"""Recorded runs for ``fitmodels ident`` in equal forms, and with one fault: the same model, or a message.

``trial`` draws a record from its number, for ``benchmarks/fuzz.py``: a linear chirp through one of the plants of
``PLANTS`` with noise, written as a table of time, input and output, which becomes

equal
    one to four changes of form: units, delimiter, decimal mark, encoding, quotes, names in other languages, order of
    columns, offset of the time, notation of the times, a further column, workbook. The model must be the same.
any other kind
    one fault of measurement. Where the response in the excited band moves by one standard error of the difference or
    more, the record must be refused, or a note, a verdict or a disturbance must be new.
"""

import re
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from fitmodels import ident
from fitmodels.core.errors import FitmodelsError
from fitmodels.datasets import read_record
from fitmodels.ident import Model
from fitmodels.ident.draws import drawn_models

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from laboratory_workbooks import xlsx

RATE = 50.0
SAME = 1e-6  # relative, of the gain in the excited band: cells hold 9 digits
PLANTS = {
    "spindle": (Model(b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02), 0.005),
    "axis": (Model(b=[0, 0, 0.08, 0.05], a=[1, -1.5, 0.63], nk=2, sample_time=0.02), 0.01),
    "lag": (Model(b=[0, 0.12], a=[1, -0.9], nk=1, sample_time=0.02), 0.02),
}


@dataclass
class Run:
    """Samples of a record, and how they are written."""

    t: np.ndarray  # s
    u: np.ndarray
    y: np.ndarray
    names: tuple[str, str, str] = ("t", "u", "y")
    units: tuple[str, str, str] = ("s", "V", "A")
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    order: tuple[int, ...] = (0, 1, 2)
    mark: str = ","
    decimal: str = "."
    quotes: bool = False
    encoding: str = "utf-8"
    end: str = "\n"
    book: bool = False
    time: str = "{:.9g}"
    above: list[str] = field(default_factory=list)
    texts: dict[tuple[int, int], str] = field(default_factory=dict)  # of row and column

    def name(self):
        return "run.xlsx" if self.book else "run.csv"

    def cells(self):
        """Header and rows, as numbers or texts."""
        columns = [values * factor for values, factor in zip((self.t, self.u, self.y), self.factors, strict=True)]
        head = [f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True)]
        rows = [list(row) for row in zip(*columns, strict=True)]
        for (i, j), text in self.texts.items():
            rows[i][j] = text
        return [[row[j] for j in self.order] for row in (head, *rows)]

    def content(self):
        """Bytes of the file."""
        head, *rows = self.cells()
        if self.book:
            return xlsx({"Data": [head, *([_value(cell) for cell in row] for row in rows)]})
        time = self.order.index(0)
        forms = [self.time if j == time else "{:.9g}" for j in range(len(self.order))]
        lines = [self.mark.join(self._shown(cell) for cell in head)]
        for row in rows:
            shown = [c if isinstance(c, str) else form.format(c) for c, form in zip(row, forms, strict=True)]
            lines.append(self.mark.join(self._shown(cell.replace(".", self.decimal)) for cell in shown))
        return (self.end.join([*self.above, *lines]) + self.end).encode(self.encoding)

    def _shown(self, cell):
        return f'"{cell}"' if self.quotes else cell


def _value(cell):
    return cell if isinstance(cell, str) else float(f"{cell:.9g}")


def run_of(plant, seed):
    """A good record of a plant, its noise drawn by the seed."""
    model, noise = PLANTS[plant]
    rng = np.random.default_rng((seed, 7))
    u = ident.chirp(rate=RATE)
    y = model.simulate(u) + 0.24 + noise * rng.standard_normal(len(u))
    return Run(np.arange(len(u)) / RATE, _rounded(u + 5.0), _rounded(y))


def _rounded(values):
    """Values of nine digits, as they are written."""
    return np.array([float(f"{v:.9g}") for v in values])


# Each change of form leaves the samples as they are, and returns what it did.


def delimiter(r, rng):
    r.mark = _any(rng, [";", "\t"] if r.decimal == "," else [";", "\t", "|"])
    return f"delimiter {r.mark!r}"


def comma(r, rng):
    r.decimal, r.mark = ",", _any(rng, [";", "\t"])
    return "decimal comma"


def quotes(r, rng):
    r.quotes = True
    return "quotes"


def encoding(r, rng):
    r.encoding = _any(rng, ["utf-8-sig", "utf-16", "cp1252"])
    return r.encoding


def line_ends(r, rng):
    r.end = _any(rng, ["\r\n", "\r"])
    return f"ends of lines {r.end!r}"


def time_unit(r, rng):
    unit, factor = _any(rng, [("ms", 1e3), ("us", 1e6)])
    r.units, r.factors = (unit, *r.units[1:]), (factor, *r.factors[1:])
    return f"time in {unit}"


def signal_units(r, rng):
    r.units, r.factors = (r.units[0], "mV", "mA"), (r.factors[0], 1e3, 1e3)
    return "mV and mA"


def names(r, rng):
    r.names = _any(rng, [("Zeit", "Spannung", "Spindelstrom"), ("time", "command", "current"), ("temps", "u", "I")])
    r.order = (0, 1, 2)
    return ", ".join(r.names)


def time_offset(r, rng):
    r.t = r.t + float(_any(rng, [0.02, 1.0, 60.0, 3600.0]))
    return f"times begin at {r.t[0]:g} s"


def time_digits(r, rng):
    r.time = _any(rng, ["{:.4f}", "{:.6e}"])
    return f"times as {r.time}"


def column_order(r, rng):
    """The output comes first only where the names say which it is."""
    r.order = tuple(int(j) for j in rng.permutation(3))
    if r.names[1] not in ("u", "command") and r.order.index(2) < r.order.index(1):
        r.order = (1, 0, 2)
    return f"columns {r.order}"


def comment(r, rng):
    r.above.append("# run 7, axis X, 12:30")
    return "comment"


def workbook(r, rng):
    r.book = True
    return "workbook"


EQUAL = (delimiter, comma, quotes, encoding, line_ends, time_unit, signal_units, names, time_offset, time_digits,
         column_order, comment, workbook)  # fmt: skip


# Each fault changes the samples, and returns what it did.


def spike(r, rng):
    i, size = _at(r, rng), float(_any(rng, [0.5, 1, 3, 10, 100]))
    values = r.y if rng.random() < 0.7 else r.u
    values[i] += size * np.ptp(values) * rng.choice([-1, 1])
    return f"sample {i + 1}: spike of {size:g} ranges of {'output' if values is r.y else 'input'}"


def digit(r, rng):
    i, factor = _at(r, rng), float(_any(rng, [10, 0.1, 1000, -1]))
    values = r.y if rng.random() < 0.7 else r.u
    values[i] *= factor
    return f"sample {i + 1}: {'output' if values is r.y else 'input'} times {factor:g}"


def word(r, rng):
    i, text = _at(r, rng), _any(rng, ["", "nan", "ERR", "overflow", "1.2.3", "--", "1e999"])
    r.texts[i, int(rng.integers(3))] = text
    return f"sample {i + 1}: {text!r}"


def gap(r, rng):
    i, n = _at(r, rng), int(_any(rng, [1, 3, 20, 100]))
    kept = np.r_[0 : min(i, len(r.t) - n), min(i, len(r.t) - n) + n : len(r.t)]
    r.t, r.u, r.y = r.t[kept], r.u[kept], r.y[kept]
    return f"{n} samples missing from {i + 1} on"


def gap_hidden(r, rng):
    """Samples that are lost where the times go on as if none were."""
    text, n = gap(r, rng), len(r.t)
    r.t = np.arange(n) / RATE
    return f"{text}, times without a gap"


def swapped(r, rng):
    r.u, r.y = r.y, r.u
    return "input and output exchanged"


def reversed_sign(r, rng):
    r.y = -r.y
    return "output of reversed sign"


def constant(r, rng):
    if rng.random() < 0.5:
        r.u = np.full_like(r.u, r.u[0])
        return "constant input"
    r.y = np.full_like(r.y, r.y[0])
    return "constant output"


def held(r, rng):
    i, n = _at(r, rng), int(_any(rng, [10, 50, 200]))
    r.y[i : i + n] = r.y[i]
    return f"output held from sample {i + 1} on for {n}"


def clipped(r, rng):
    low, high = np.quantile(r.y, [float(_any(rng, [0.05, 0.2])), float(_any(rng, [0.8, 0.95]))])
    r.y = np.clip(r.y, low, high)
    return f"output clipped to {low:.3g} to {high:.3g}"


def offset_jump(r, rng):
    i, size = _at(r, rng), float(_any(rng, [0.3, 1, 5])) * np.ptp(r.y)
    r.y[i:] += size
    return f"output jumps by {size:.3g} at sample {i + 1}"


def wrong_rate(r, rng):
    factor = float(_any(rng, [2, 10, 0.5, 60]))
    r.t = r.t * factor
    return f"times times {factor:g}"


def time_stuck(r, rng):
    i, n = _at(r, rng), int(_any(rng, [1, 3, 30]))
    r.t[i : i + n] = r.t[i]
    return f"time stands from sample {i + 1} on for {n}"


def rows_exchanged(r, rng):
    i, k = _at(r, rng), int(_any(rng, [1, 20]))
    order = np.arange(len(r.t))
    order[[i, max(i - k, 0)]] = order[[max(i - k, 0), i]]
    r.t, r.u, r.y = r.t[order], r.u[order], r.y[order]
    return f"samples {i + 1} and {max(i - k, 0) + 1} exchanged"


def block_twice(r, rng):
    i, n = _at(r, rng), 100
    order = np.r_[0 : i + 1, max(i - n, 0) : len(r.t)]
    r.t, r.u, r.y = r.t[order], r.u[order], r.y[order]
    return f"{n} samples stand twice at {i + 1}"


def late(r, rng):
    n = int(_any(rng, [5, 25, -5]))
    r.y = np.roll(r.y, n)
    return f"output shifted by {n} samples"


def noise(r, rng):
    size = float(_any(rng, [1, 5])) * np.ptp(r.y)
    r.y = r.y + size * rng.standard_normal(len(r.y))
    return f"noise of {size:.3g} on the output"


def coarse(r, rng):
    step = float(_any(rng, [0.1, 0.5])) * np.ptp(r.y)
    r.y = np.round(r.y / step) * step
    return f"output in steps of {step:.3g}"


FAULTS = (spike, digit, word, gap, gap_hidden, swapped, reversed_sign, constant, held, clipped, offset_jump, wrong_rate,
          time_stuck, rows_exchanged, block_twice, late, noise, coarse)  # fmt: skip
UNSEEN = {  # faults that no record shows, with the reason
    "wrong_rate": "times of another scale are those of a slower or faster plant; the rate is printed as a note",
    "late": "a delay of the recorder is one of the plant",
}
SHARE = 0.35  # of equal files


def _at(r, rng):
    return int(rng.integers(20, len(r.t) - 20))


def _any(rng, choices):
    choices = list(choices)
    return choices[int(rng.integers(len(choices)))]


@dataclass(frozen=True)
class Found:
    """Outcome of a record: the gain over frequency with its standard error, what is said of it, or a refusal."""

    gain: np.ndarray | None = None
    error: np.ndarray | None = None
    said: frozenset[str] = frozenset()
    level: int = 0
    refusal: str = ""


FREQUENCIES = np.array([0.2, 0.5, 1.0, 1.5])  # Hz, all excited


def identified(path):
    """Read and identify a record as the command does."""
    try:
        record = read_record(path)
        found = ident.identify([record])
        model = found.model
        said = {*found.verdicts, *record.notes, *found.notes, *found.verdict.reasons}
        response = np.asarray(model.response(FREQUENCIES))
        return Found(response, _errors(model), frozenset(map(_without_numbers, said)), found.verdict.level)
    except FitmodelsError as error:
        return Found(refusal=str(error))


def _without_numbers(text):
    return re.sub(r"[-+]?[0-9][0-9.,e+-]*", "#", text)


def trial(seed, folder):
    """Verdict, fault, description and size of one record."""
    rng = np.random.default_rng(seed)
    plant, noise_seed = _any(rng, PLANTS), int(rng.integers(20))
    run, good = run_of(plant, noise_seed), _good(plant, noise_seed)
    if rng.random() < SHARE:
        done = [EQUAL[k](run, rng) for k in rng.permutation(len(EQUAL))[: int(rng.integers(1, 5))]]
        path, found = _written(run, folder)
        fault = _different(good, found)
        verdict = "equal: DIFFERENT" if fault else "equal: the same"
        return verdict, fault, f"{plant}; {'; '.join(done)}", path.stat().st_size
    how = _any(rng, FAULTS)
    done = how(run, rng)
    path, found = _written(run, folder)
    verdict, fault = _judged(how.__name__, good, found)
    return f"{how.__name__}: {verdict}", fault, f"{plant}; {done}", path.stat().st_size


def _errors(model):
    """Standard errors of the response, complex, by draws of the structures and their coefficients."""
    if model.cov_params is None:
        return np.full(len(FREQUENCIES), np.nan)
    responses = np.array([one.response(FREQUENCIES) for one in drawn_models(model, 200).models])
    return np.sqrt(np.mean(np.abs(responses - model.response(FREQUENCIES)) ** 2, axis=0))


@cache
def _good(plant, seed):
    with TemporaryDirectory() as folder:
        found = _written(run_of(plant, seed), Path(folder))[1]
    if found.refusal:
        raise RuntimeError(f"the good record is refused: {plant}, {seed}: {found.refusal}")
    return found


def _written(run, folder):
    path = folder / run.name()
    path.write_bytes(run.content())
    return path, identified(path)


def _different(good, found):
    """Difference between the models of equal records; "" where there is none."""
    if found.refusal:
        return f"an equal record is refused: {found.refusal}"[:400]
    off = float(np.max(np.abs(found.gain / good.gain - 1)))
    return (
        "" if off < SAME else f"the response differs by {off:.2g} of itself; {'; '.join(found.said - good.said)}"[:400]
    )


def _judged(kind, good, found):
    """Verdict on a record with a fault, and whether that is a fault of the program."""
    if found.refusal:
        return "refused", ""
    moved = float(np.max(np.abs(found.gain - good.gain) / np.hypot(good.error, found.error)))
    if moved < 1:
        return "below 1 SE", ""
    if found.level > good.level:
        return "lower verdict", ""
    if found.said - good.said:
        return "named", ""
    return ("not visible", "") if kind in UNSEEN else ("MISSED", f"not named: the response moves by {moved:.2g} SE")
