"""Share of sound files that the checks accuse, and share of planted defects that they find and name.

    python benchmarks/checks.py [--files 1000] [--defects 200] [--plan NAME ...] [--only sound|defects]

Each file is simulated from the published wear law (Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006, eq. 4) on one of
four plans, read with all doubts of the reading (`datasets.runs_from_frame`), fitted (`fit.default_laws`) and judged
(`fit.judge`). A reservation is any doubt or warning of the reading, any check with a concern, or a law that is refused.

Sound files: intraclass correlation of the edges 0, .2, .5 and .8 at a row sd of .08, normal errors or Student's t with
4 degrees of freedom, 6 sub-tests of each edge or sub-tests until the wear criterion; half of the files with a second
law, of a force. Aim: at most 12 % with a reservation, 15 % with 12 edges.

Defects: at an edge sd of .05 and a row sd of .08. ``named`` is the share of files in which a sentence names the
culprit: all edges or lines concerned, or the column and the kind of the mistake. Monte Carlo error of a share p of n
files: sqrt(p (1 - p) / n).
"""

import argparse
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from time import perf_counter

import numpy as np
import pandas as pd
from fitmodels import datasets, fit
from fitmodels.core.errors import FitmodelsError

C0, EXPONENTS = 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
FORCE = {"V": -0.06, "f": 0.76, "d": 0.97, "AW": 0.2}
RANGES = {"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0)}
TIMES = np.arange(2.0, 13.0, 2.0)  # min
LONG_TIMES = np.arange(2.0, 31.0, 2.0)
CRITERION = 0.25  # mm
ROW_SD, EDGE_SD = 0.08, 0.05
ICCS = (0.0, 0.2, 0.5, 0.8)
AIMS = {"12": 0.15}
AIM, FAMILY = 0.12, 0.10
BIG_PLAN = "24"


def levels(coded):
    """Settings (edges, 3) in their units from coded levels -1 to 1, in logarithms."""
    low, high = (np.log([ends[k] for ends in RANGES.values()]) for k in (0, 1))
    return np.exp((low + high) / 2 + np.asarray(coded, dtype=float) * (high - low) / 2)


def plans():
    """Coded settings of each plan, a row for each edge."""
    cube = np.array(list(product((-1, 1), repeat=3)))
    full = np.array(list(product((-1, 0, 1), repeat=3)))
    latin = np.array([(a, b, (a + b + 3) % 3 - 1) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    axial = np.vstack([np.eye(3), -np.eye(3)])
    centre = np.zeros((4, 3))
    return {
        "L9x2": np.vstack([latin, latin]),
        "L27": full,
        "12": np.vstack([cube, centre]),
        "24": np.vstack([cube * 0.7, centre, axial, axial]),
    }


@dataclass(frozen=True)
class Recipe:
    """How a file is simulated."""

    plan: str
    icc: float | None = None  # None: EDGE_SD
    heavy: bool = False
    stopped: bool = False
    force: bool = False


def errors(rng, heavy, size):
    """Errors of unit variance: normal, or Student's t with 4 degrees of freedom."""
    return rng.standard_t(4, size) / np.sqrt(2.0) if heavy else rng.standard_normal(size)


def simulated(rng, recipe, power=None, bend=None):
    """A sound file; ``power`` multiplies the wear by D^power of a further column, ``bend`` (factor, coefficient) adds
    the coefficient times the square of the logarithm of the factor about its middle."""
    settings = levels(plans()[recipe.plan])
    settings = settings[rng.permutation(len(settings))]
    edge_sd = EDGE_SD if recipe.icc is None else ROW_SD * np.sqrt(recipe.icc / (1 - recipe.icc))
    levels_of_edges = edge_sd * errors(rng, recipe.heavy, len(settings))
    diameters = rng.permutation(np.resize([80.0, 113.0, 160.0], len(settings)))
    rows = []
    for g, (V, f, d) in enumerate(settings):
        for t in LONG_TIMES if recipe.stopped else TIMES:
            eta = np.log(C0) + sum(b * np.log(x) for b, x in zip(EXPONENTS.values(), (V, f, d, t), strict=True))
            if power is not None:
                eta += power * np.log(diameters[g] / 113.0)
            if bend is not None:
                eta += bend[1] * np.log({"V": V, "f": f, "d": d}[bend[0]] / np.sqrt(np.prod(RANGES[bend[0]]))) ** 2
            AW = float(np.exp(eta + levels_of_edges[g] + ROW_SD * errors(rng, recipe.heavy, ())))
            rows.append((f"E{g + 1:02d}", V, f, d, diameters[g], t, AW))
            if recipe.stopped and (AW >= CRITERION or t >= LONG_TIMES[-1]):
                break
    frame = pd.DataFrame(rows, columns=["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "D [mm]", "t [min]", "AW [mm]"])
    if power is None:
        frame = frame.drop(columns="D [mm]")
    frame = frame.round({"V [m/min]": 1, "f [mm/rev]": 4, "d [mm]": 3, "AW [mm]": 4})
    if recipe.force:
        logs = sum(FORCE[name] * np.log(frame[column]) for name, column in zip(FORCE, COLUMNS, strict=True))
        level = pd.Series(
            errors(rng, recipe.heavy, len(settings)), index=[f"E{g + 1:02d}" for g in range(len(settings))]
        )
        noise = 0.03 * frame["edge"].map(level).to_numpy() + 0.04 * errors(rng, recipe.heavy, len(frame))
        frame["Fc [N]"] = np.round(1750 * 1.4 * np.exp(logs + noise), 1)
    return frame


COLUMNS = ("V [m/min]", "f [mm/rev]", "d [mm]", "AW [mm]")


@dataclass
class Outcome:
    """What the program finds in a file."""

    sentences: list[str] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)
    level: int = 0

    def add(self, source, sentence, level=1):
        self.sentences.append(sentence)
        self.sources.append(source)
        self.level = max(self.level, level)


def judged(frame):
    """Reservations of the reading, of the laws that are refused, and of the checks."""
    out = Outcome()
    try:
        runs = datasets.runs_from_frame(frame, tool="T", work="W")
    except FitmodelsError as error:
        out.add("refused by the reading", str(error), 2)
        return out
    for doubt in runs.doubts:
        out.add("reading", str(doubt))
    for warning in runs.warnings:
        out.add("reading", warning)
    laws, refused = fit.default_laws(runs)
    for law in refused:
        out.add("law refused", f"{law.response}: {law.reason}", 2)
    for law in laws:
        found = fit.judge(law, runs=runs, laws=len(laws))
        for name, check in found.checks.items():
            if isinstance(check, fit.NotAvailable):
                if "computation failed" in check.reason:
                    out.add(f"FAILED {name}", check.reason)
            elif check.concern:
                sentence = " ".join([check.verdict, *(suspect.correction for suspect in check.suspects)])
                out.add(name, sentence, check.concern)
    return out


def names(edges):
    """Whether a sentence contains each of these edges."""
    return lambda sentences: any(all(re.search(rf"\b{edge}\b", text) for edge in edges) for text in sentences)


def words(*alternatives):
    """Whether a sentence contains all words of one of the alternatives (regular expressions)."""
    return lambda sentences: any(all(re.search(w, text) for w in one) for one in alternatives for text in sentences)


def chosen(rng, frame, count, column=None, extreme=False):
    """Names of edges at random; among those of the most frequent level of a column where one is given."""
    edges = list(dict.fromkeys(frame["edge"]))
    if column is not None and extreme:
        first = frame.drop_duplicates("edge").set_index("edge")[column]
        edges = list(first[first >= first.quantile(0.25)].index)
    return sorted(rng.choice(edges, min(count, len(edges)), replace=False))


def scaled(frame, edges, column, factor, digits=4):
    """The frame with a column of some edges multiplied."""
    frame = frame.copy()
    at = frame["edge"].isin(edges)
    frame.loc[at, column] = (frame.loc[at, column] * factor).round(digits)
    return frame


def exchanged(rng, frame):
    return frame.rename(columns={"V [m/min]": "f [mm/rev]", "f [mm/rev]": "V [m/min]"}), words(("V", "f"))


def feed_in_inches(rng, frame, count=4):
    edges = chosen(rng, frame, count)
    return scaled(frame, edges, "f [mm/rev]", 1 / 25.4, 5), names(edges)


def time_in_seconds(rng, frame, count=3):
    edges = chosen(rng, frame, count)
    return scaled(frame, edges, "t [min]", 60.0), names(edges)


def speed_in_feet(rng, frame, count=1):
    edges = chosen(rng, frame, count)
    return scaled(frame, edges, "V [m/min]", 3.280839895, 1), names(edges)


def wrong_edge(rng, frame, factor=1.8):
    edges = chosen(rng, frame, 1)
    return scaled(frame, edges, "AW [mm]", factor), names(edges)


def wrong_rows(rng, frame, count=3, factor=25.4):
    frame = frame.copy()
    lines = sorted(rng.choice(len(frame), count, replace=False))
    frame.loc[lines, "AW [mm]"] = (frame.loc[lines, "AW [mm]"] / factor).round(5)
    return frame, names([str(line) for line in lines])


def pasted_rows(rng, frame):
    """The rows of two edges stand twice in the file."""
    edges = chosen(rng, frame, 2)
    return pd.concat([frame, frame[frame["edge"].isin(edges)]], ignore_index=True), words(
        ("duplicate|repeat|twice|copies|copied|identical",)
    )


def copied_edges(rng, frame):
    """Two edges have the wear readings of two others."""
    frame = frame.copy()
    count = frame.groupby("edge")["t [min]"].size()
    edges = list(rng.choice(count[count == count.max()].index, 4, replace=False))
    for source, target in (edges[:2], edges[2:]):
        frame.loc[frame["edge"] == target, "AW [mm]"] = frame.loc[frame["edge"] == source, "AW [mm]"].to_numpy()
    return frame, lambda sentences: names(edges[:2])(sentences) and names(edges[2:])(sentences)


def time_offset(rng, frame, minutes=5.0, share=0.5):
    edges = chosen(rng, frame, max(1, round(share * frame["edge"].nunique())))
    frame = frame.copy()
    frame.loc[frame["edge"].isin(edges), "t [min]"] += minutes
    return frame, words(("offset",), ("time", "count|zero|start"))


def confounded(rng, frame):
    frame = frame.copy()
    edge = frame.drop_duplicates("edge")
    f = edge["f [mm/rev]"] / edge["f [mm/rev]"].median()
    d = (2.1 * f ** rng.choice([0.35, -0.35]) * np.exp(0.01 * rng.standard_normal(len(edge)))).round(3)
    old = frame["d [mm]"].to_numpy()
    frame["d [mm]"] = frame["edge"].map(dict(zip(edge["edge"], d, strict=True)))
    frame["AW [mm]"] = (frame["AW [mm]"] * (frame["d [mm]"] / old) ** EXPONENTS["d"]).round(4)
    return frame, words((r"\bf\b", r"\bd\b"))


CURVED = words(("second[- ]order|curv|quadratic|lack of fit|Lack of fit|square",))
MISSING = words((r"\bD\b|diameter",))
ABSENT = words(("depth|\\bd\\b",))


def unchanged(rng, frame):
    return frame, words(())


@dataclass(frozen=True)
class Defect:
    """A planted defect, and the aim for 24 edges: share detected, share named."""

    title: str
    plant: Callable
    aim: tuple[float, float] | None = None
    simulate: dict = field(default_factory=dict)
    named: Callable | None = None


def with_(plant, **given):
    return lambda rng, frame: plant(rng, frame, **given)


AIMED = (0.9, 0.75)
DEFECTS = (
    Defect("V and f exchanged", exchanged),
    Defect("f / 25.4 in 4 edges", feed_in_inches, AIMED),
    Defect("f / 25.4 in 1 edge", with_(feed_in_inches, count=1)),
    Defect("t x 60 in 3 edges", time_in_seconds, AIMED),
    Defect("V x 3.281 in 1 edge", speed_in_feet),
    Defect("an edge x 1.8", wrong_edge, AIMED),
    Defect("an edge x 1.3", with_(wrong_edge, factor=1.3)),
    Defect("three rows / 25.4", wrong_rows, AIMED),
    Defect("a row / 2", with_(wrong_rows, count=1, factor=2.0)),
    Defect("rows of 2 edges twice", pasted_rows, AIMED),
    Defect("wear of 2 edges copied", copied_edges, AIMED),
    Defect("+5 min in half", time_offset, AIMED),
    Defect("+1 min in half", with_(time_offset, minutes=1.0)),
    Defect("+5 min in all", with_(time_offset, share=1.0)),
    Defect("f and d confounded", confounded),
    Defect(".3 ln(f)^2", unchanged, AIMED, {"bend": ("f", 0.3)}, CURVED),
    Defect(".1 ln(f)^2", unchanged, None, {"bend": ("f", 0.1)}, CURVED),
    Defect(".3 ln(V)^2", unchanged, AIMED, {"bend": ("V", 0.3)}, CURVED),
    Defect("factor D^.5, column not used", unchanged, AIMED, {"power": 0.5}, MISSING),
    Defect("no column of depth", lambda rng, frame: (frame.drop(columns="d [mm]"), ABSENT)),
)


def sound_recipes(plan, files):
    """A recipe for each sound file."""
    cases = list(product(ICCS, (False, True), (False, True), (False, True)))
    for k in range(files):
        icc, heavy, stopped, force = cases[k % len(cases)]
        yield k, Recipe(plan, icc, heavy, stopped, force)


def one_sound(task):
    k, recipe = task
    rng = np.random.default_rng([19, k, sum(map(ord, recipe.plan))])
    return recipe, judged(simulated(rng, recipe))


def one_defect(task):
    k, number, plan = task
    defect = DEFECTS[number]
    rng = np.random.default_rng([91, k, number, sum(map(ord, plan))])
    frame, named = defect.plant(rng, simulated(rng, Recipe(plan), **defect.simulate))
    found = judged(frame)
    return number, found, bool((defect.named or named)(found.sentences))


def progress(pool, work, tasks, title) -> Iterator:
    """Results of the tasks, with their number on standard error."""
    start = perf_counter()
    for k, result in enumerate(pool.map(work, tasks, chunksize=8), 1):
        if sys.stderr.isatty() or k == len(tasks):
            end = "\n" if k == len(tasks) else ""
            print(f"\r{title}: {k} of {len(tasks)} files, {perf_counter() - start:.0f} s", end=end, file=sys.stderr)
        yield result


def share(hits, of):
    return f"{100 * hits / max(of, 1):6.1f} %"


def print_sound(pool, plan, files):
    results = list(progress(pool, one_sound, list(sound_recipes(plan, files)), f"sound, plan {plan}"))
    accused = [(recipe, found) for recipe, found in results if found.sentences]
    aim = AIMS.get(plan, AIM)
    print(
        f"plan {plan:5} {share(len(accused), files)} of {files} sound files have a reservation (aim {100 * aim:.0f} %)"
    )
    for title, of in (
        ("edge ICC", lambda r: r.icc),
        ("heavy tails", lambda r: r.heavy),
        ("stopped at the criterion", lambda r: r.stopped),
        ("with a force law", lambda r: r.force),
    ):
        total, hit = Counter(of(r) for r, _ in results), Counter(of(r) for r, _ in accused)
        print(
            f"           {title}: "
            + ", ".join(f"{value} {share(hit[value], total[value]).strip()}" for value in sorted(total))
        )
    sources = Counter(source for _, found in accused for source in dict.fromkeys(found.sources))
    print(
        "           by check: "
        + (", ".join(f"{name} {share(n, files).strip()}" for name, n in sources.most_common()) or "none")
    )
    forbidden = sum(found.level == 2 for _, found in accused)
    print(f"           verdict 'do not use for control': {share(forbidden, files).strip()}", flush=True)
    return accused


def print_defects(pool, plan, files):
    print(f"plan {plan}: defects, {files} files each{'':12}detected     named   found by (share of the detected)")
    tasks = [(k, number, plan) for number in range(len(DEFECTS)) for k in range(files)]
    results = list(progress(pool, one_defect, tasks, f"defects, plan {plan}"))
    for number, defect in enumerate(DEFECTS):
        own = [(found, named) for which, found, named in results if which == number]
        detected, named = sum(bool(found.sentences) for found, _ in own), sum(named for _, named in own)
        by = Counter(source for found, _ in own for source in dict.fromkeys(found.sources))
        common = ", ".join(f"{name} {100 * n / max(detected, 1):.0f}" for name, n in by.most_common(4))
        aims = ""
        if defect.aim and plan == BIG_PLAN:
            met = detected >= defect.aim[0] * files and named >= defect.aim[1] * files
            aims = "aim 90/75 met" if met else "aim 90/75 NOT MET"
        print(f"  {defect.title:34} {share(detected, files)} {share(named, files)}   {common} {aims}", flush=True)


def main(argv):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=1000, help="sound files of a plan")
    parser.add_argument("--defects", type=int, default=200, help="files of a defect and plan")
    parser.add_argument("--plan", action="append", choices=list(plans()))
    parser.add_argument("--only", choices=("sound", "defects"))
    parser.add_argument("--show", type=int, default=0, help="sentences of this many accused sound files")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(argv)
    from fitmodels.fit.checks.check import FAMILY_LEVEL

    print(f"level of the family of tests: {100 * FAMILY_LEVEL:g} % (aim: at most {100 * FAMILY:g} %)")
    with ProcessPoolExecutor(args.processes) as pool:
        for plan in args.plan or plans():
            if args.only != "defects":
                for recipe, found in print_sound(pool, plan, args.files)[: args.show]:
                    print(f"    {recipe}")
                    for source, sentence in zip(found.sources, found.sentences, strict=True):
                        print(f"      {source}: {sentence}")
        for plan in args.plan or plans():
            if args.only != "sound":
                print_defects(pool, plan, args.defects)


if __name__ == "__main__":
    main(sys.argv[1:])
