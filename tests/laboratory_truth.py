"""One wear test of known laws, tables of it as text, and the reading of a file compared with its clean table."""

import os
import re
import shlex
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from fitmodels import fit
from fitmodels.cli import wear
from fitmodels.cli.options import fit_options
from fitmodels.core.errors import FitmodelsError
from fitmodels.pipeline import reading
from fitmodels.pipeline.analysis import pairs_of

SALT = os.environ.get("LABORATORY_SALT", "")  # another text makes other numbers of every file
READ, REFUSED, DOUBTED, SILENT = "read", "refused", "doubted", "SILENT"

UNITS = {
    "V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm", "VB": "mm", "Fc": "N", "P": "kW", "T": "min",
}  # fmt: skip
BASE = ("edge", "V", "f", "d", "t", "AW", "Fc")
TIMES = (2.0, 4.0, 7.0, 10.0, 14.0, 18.0)
EDGE_SD, ROW_SD = 0.05, 0.08  # of ln AW and ln P, as AC-2016 reports
SAME = 0.05  # standard errors: rounding of converted cells
WRONG = 3.0  # standard errors beyond which a reading without a message is wrong


def wear_test(name, edges=24, times=TIMES, levels=True, grid=None):
    """A wear test: edge, V, f, d, t, AW, Fc, P of the laws AC-2016, its random numbers drawn by a name.

    Conditions are all but three points of a 3 x 3 x 3 grid, random where ``levels`` is False, or those of ``grid``.
    """
    rng = np.random.default_rng(zlib.crc32(f"{name}{SALT}".encode()))
    if grid is not None:
        edges = len(grid)
    elif levels:
        grid = np.array(np.meshgrid((80, 120, 180), (0.1, 0.2, 0.4), (1, 1.5, 2.5))).reshape(3, -1).T
        grid = grid[rng.permutation(len(grid))[:edges]]
    else:
        ends = np.log(((60, 200), (0.08, 0.5), (0.8, 3)))
        grid = np.exp(rng.uniform(ends[:, 0], ends[:, 1], (edges, 3)))
        grid = np.column_stack([grid[:, 0].round(), grid[:, 1].round(3), grid[:, 2].round(2)])
    V, f, d = np.repeat(grid, len(times), axis=0).T
    t = np.tile(times, edges)

    def scatter(row_sd=ROW_SD, edge_sd=EDGE_SD):
        of_edge = np.repeat(rng.normal(0, edge_sd, edges), len(times))
        return np.exp(of_edge + rng.normal(0, row_sd, len(t)))

    AW = (0.00762 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * scatter()).round(4)
    P = 0.14 * V**0.82 * f**0.627 * d**0.844 * t**-0.049 * AW**0.342 * scatter()
    Fc = (P * 60_000 / V * 0.9 * scatter(0.01, 0)).round(1)
    edge = np.repeat([f"E{i + 1:02d}" for i in range(edges)], len(times))
    return pd.DataFrame({"edge": edge, "V": V, "f": f, "d": d, "t": t, "AW": AW, "Fc": Fc, "P": P.round(4)})


def show(value):
    """A cell as laboratories write it."""
    if isinstance(value, str):
        return value
    return "" if np.isnan(value) else f"{value:.7g}"


def cells(frame):
    """Rows of texts."""
    return [[show(value) for value in row] for row in frame.itertuples(index=False)]


def text(header, rows, mark=",", end="\n", above=(), below=()):
    """A table as text."""
    return end.join([*above, *(mark.join(row) for row in (header, *rows)), *below]) + end


def headed(frame, **names):
    """Headers with units, some replaced."""
    usual = {name: f"{name} [{UNITS[name]}]" if name in UNITS else name for name in frame}
    return [{**usual, **names}[name] for name in frame]


def table(frame, mark=",", above=(), below=(), **names):
    """A frame as text; headers are the symbols with their units, unless replaced."""
    return text(headed(frame, **names), cells(frame), mark, above=above, below=below)


@dataclass(frozen=True)
class Case:
    """A laboratory's file, what it must become, and the clean table of the same numbers.

    ``names``: words of which a doubt or refusal holds at least one; ``typed``: what the user types for a remedy
    that the file alone cannot give; ``corrected``: the file after an edit that the message asks for; ``check``:
    replaces the comparison of laws; ``edges``: whether standard errors must be those by edge.
    """

    name: str
    make: Callable[[], tuple[dict[str, bytes], pd.DataFrame, dict[str, bytes]]]
    expected: tuple[str, ...]
    names: tuple[str, ...] = ()
    options: str = ""
    typed: str = ""
    check: Callable | None = None
    edges: bool = True
    quiet: bool = True  # read without any doubt
    remedy: bool = True  # a refusal holds an option that reads right; False: it shows what to write

    @cached_property
    def made(self):
        """Files, truth and corrected files."""
        return self.make()

    @property
    def files(self):
        return self.made[0]

    @property
    def truth(self):
        return self.made[1]

    @property
    def corrected(self):
        return self.made[2]

    def write(self, folder: Path, files=None) -> Path:
        """The file, or the folder of several."""
        files = files or self.files
        place = folder / re.sub(r"\W+", "_", self.name) if len(files) > 1 else folder
        place.mkdir(exist_ok=True, parents=True)
        for name, content in files.items():
            (place / name).write_bytes(content)
        return place if len(files) > 1 else place / next(iter(files))


def registry(cases, usual="data.csv"):
    """A decorator that adds cases to a list: the function makes the content, or content and truth, of a wear test."""

    def add(name, *expected, names="", file=usual, encoding="utf-8", test=None, corrected=None, **how):
        def register(write):
            def make():
                w = wear_test(name, **(test or {}))
                made = write(w.copy())
                content, truth = made if isinstance(made, tuple) else (made, w[list(BASE)])
                content = content.encode(encoding) if isinstance(content, str) else content
                after = {} if corrected is None else {file: corrected(w).encode(encoding)}
                return content if isinstance(content, dict) else {file: content}, truth, after

            cases.append(Case(name, make, expected, tuple(names.split("|")) if names else (), **how))
            return write

        return register

    return add


@dataclass(frozen=True)
class Outcome:
    """What became of a file: laws by pair and response, doubts and warnings, the refusal, or an error."""

    laws: dict = field(default_factory=dict)
    messages: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    refusal: str = ""
    runs: object = None


def reads(path, options=""):
    """Read and fit a file as the command does with these options, without posterior."""
    args = wear.parser().parse_args([str(path), *shlex.split(options)])
    try:
        how = fit_options(args, "by", "verify", "posterior_figures")
        runs = reading.read_tests(Path(path), how)
    except FitmodelsError as error:
        return Outcome(refusal=str(error))
    laws, refused = {}, []
    for number, pair in enumerate(pairs_of(runs, how)):
        try:
            found, missing = fit.default_laws(pair)
        except FitmodelsError as error:
            return Outcome(refusal=str(error), runs=runs)
        refused += [f"{item.response} is not fitted: {item.reason}" for item in missing]
        laws |= {(number, law.response): law for law in found}
    doubts = tuple(map(str, runs.doubts))
    return Outcome(laws, (*doubts, *runs.warnings, *refused), doubts, runs=runs)


@cache
def _clean(content):
    """Laws of a clean table, and their number of edges."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / "clean.csv"
        path.write_text(content)
        outcome = reads(path)
    assert not outcome.refusal, outcome.refusal
    return outcome.laws


def clean_laws(truth):
    """Laws of the correctly read table."""
    return _clean(table(truth))


def deviation(laws, truth):
    """Largest deviation of an exponent or of the level at the centre, in standard errors of the clean table's law.

    A law, a factor or a pair that is missing is an infinite deviation.
    """
    worst = 0.0
    for key, right in clean_laws(truth).items():
        law = laws.get(key)
        if law is None or set(right.factors) - set(law.factors):
            return np.inf
        order = [law.theta_names.index(name) for name in right.theta_names]
        extra = [law.theta[law.theta_names.index(name)] for name in set(law.theta_names) - set(right.theta_names)]
        if extra:  # a further factor: an exponent of another law
            return np.inf
        difference = law.theta[order] - right.theta
        centre = np.array([1.0, *np.log(right.rows.X).mean(axis=0)])
        se = np.sqrt(np.diag(right.cov_theta))
        level = abs(centre @ difference) / np.sqrt(centre @ right.cov_theta @ centre)
        worst = max(worst, level, *(np.abs(difference[1:]) / se[1:]))
    return worst


def same_edges(laws, truth):
    """Whether each law has the edges of the clean table's."""
    right = clean_laws(truth)
    return all(key in laws and laws[key].n_edges == law.n_edges for key, law in right.items())


FLAG = re.compile(r"--(?:map|unit|range|value|edge|process|decimal|delimiter|sheet|tool|work|by)\s+"
                  r"(?:\"[^\"]+\"|'[^']+'|[\w]+='[^']+'|[\w]+=\"[^\"]+\"|[^\s;,]+)|--hidden")  # fmt: skip


def remedies(message):
    """Options in a message as typed: each alone, then all of them together."""
    found = [flag for flag in FLAG.findall(message) if "..." not in flag and "COLUMN" not in flag]
    found = list(dict.fromkeys(flag.rstrip(".:),") for flag in found))
    return [*found, " ".join(found)] if len(found) > 1 else found


@dataclass(frozen=True)
class Verdict:
    """What a case came to: the outcome, its deviation in SE, the first message, and why it is not as expected."""

    outcome: str
    deviation: float
    message: str
    fault: str


def judge(case, folder):
    """Read the file of a case and compare with what is expected."""
    path = case.write(folder)
    try:
        seen = reads(path, case.options)
        kind, off = _kind(case, seen)
        message = seen.refusal or next(iter(seen.messages), "")
        fault = "" if kind in case.expected else f"{kind}, expected {' or '.join(case.expected)}"
        if kind == REFUSED and not fault:
            fault = _remedy_fault(case, seen.refusal, path, folder)
        if kind == READ and not fault and case.quiet and seen.doubts:
            fault = f"read right, but doubted: {seen.doubts[0]}"
    except Exception as error:  # a defect of the reading is a result of this table
        return Verdict("ERROR", np.nan, f"{type(error).__name__}: {error}", "an error instead of a message")
    return Verdict(kind, off, " ".join(message.split()), fault)


def _kind(case, seen):
    if seen.refusal:
        return REFUSED, np.nan
    off = 0.0 if case.check else deviation(seen.laws, case.truth)
    right = case.check(seen) if case.check else off < SAME and (not case.edges or same_edges(seen.laws, case.truth))
    named = any(_holds(message, case.names) for message in seen.messages)
    if DOUBTED in case.expected and case.names and named and not (right and READ in case.expected):
        return DOUBTED, off
    if right:
        return READ, off
    if named and case.names:
        return DOUBTED, off
    return SILENT, off


def _holds(message, names):
    return any(re.search(rf"(?<!\w){re.escape(name)}(?!\w)", message) for name in names)


def _remedy_fault(case, refusal, path, folder):
    """Why the remedy of a refusal does not work; empty where it does."""
    if case.names and not _holds(refusal, case.names):
        return f"the refusal names none of {', '.join(case.names)}"
    if case.corrected:
        seen = reads(case.write(folder / "corrected", case.corrected), case.options)
        return "" if _kind(case, seen)[0] == READ else "the corrected file does not read right"
    if case.typed:
        flags = {word for word in shlex.split(case.typed) if word.startswith("--")}
        if missing := [flag for flag in flags if flag not in refusal]:
            return f"the refusal does not name {missing[0]}"
        return "" if _kind(case, reads(path, case.typed))[0] == READ else f"{case.typed} does not read right"
    if case.check or not case.remedy:
        return "" if case.names else "no remedy to check"
    tried = _tried(case, refusal, path, case.options, 3)
    return "" if tried is True else tried


def _typed(options, remedy):
    """Options with further ones, which replace earlier ones for the same role."""
    given = {}
    for word in re.split(r"\s+(?=--)", f"{options} {remedy}".strip()):
        flag, _, value = word.partition(" ")
        given[flag, value.partition("=")[0].strip("\"'")] = word
    return " ".join(given.values())


def _tried(case, refusal, path, options, depth):
    """True where one of the remedies, typed as printed, reads right; else why not."""
    found = remedies(refusal)
    if not found:
        return "the refusal holds no option to type"
    why = ""
    for remedy in found:
        typed = _typed(options, remedy)
        try:
            seen = reads(path, typed)
        except (SystemExit, ValueError):
            why = f"{typed}: not accepted by the command"
            continue
        kind, _ = _kind(case, seen)
        if kind in (READ, DOUBTED):
            return True
        why = f"{typed}: {seen.refusal or kind}"
        if (
            seen.refusal
            and depth > 1
            and seen.refusal != refusal
            and _tried(case, seen.refusal, path, typed, depth - 1) is True
        ):
            return True
    return why


def frame_text(frame, **how):
    """A frame through pandas' own writer."""
    buffer = StringIO()
    frame.to_csv(buffer, lineterminator="\n", **how)
    return buffer.getvalue()
