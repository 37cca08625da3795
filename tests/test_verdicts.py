"""Verdicts on laws: the bundled and real sets, and files with one fault each, against verdicts written down before.

The faulty files are simulated from the wear law of Alaskari & Oraby 2016 (doi 10.15242/IIE.E1216006, eq. 4) on a
composite design of 24 edges with 6 readings each, edge sd .05 and row sd .08 in logarithms.
"""

import re
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import FitmodelsError
from fitmodels.core.verdict import Verdict

sys.path.insert(0, str(Path(__file__).parent))

from expected_verdicts import BUNDLED, FAULTY, REAL, Expected

sys.path.remove(str(Path(__file__).parent))

C0, EXPONENTS = 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
RANGES = {"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0)}
HEADERS = {"V": "V [m/min]", "f": "f [mm/rev]", "d": "d [mm]", "t": "t [min]", "AW": "AW [mm]"}


def sound(seed=19, edges=24):
    """A sound table with plain symbols as names."""
    rng = np.random.default_rng(seed)
    cube = np.array(list(product((-0.7, 0.7), repeat=3)))
    axial = np.vstack([np.eye(3), -np.eye(3)])
    plan = np.vstack([cube, np.zeros((4, 3)), axial, axial])[rng.permutation(24)[:edges]]
    low, high = (np.log([ends[k] for ends in RANGES.values()]) for k in (0, 1))
    settings = np.exp((low + high) / 2 + plan * (high - low) / 2)
    table = pd.DataFrame(np.repeat(settings, 6, axis=0), columns=list(RANGES))
    table.insert(0, "edge", np.repeat([f"E{g + 1:02d}" for g in range(edges)], 6))
    table["t"] = np.tile(np.arange(2.0, 13.0, 2.0), edges)
    level = 0.05 * np.repeat(rng.standard_normal(edges), 6) + 0.08 * rng.standard_normal(len(table))
    table["AW"] = C0 * np.exp(sum(b * np.log(table[x]) for x, b in EXPONENTS.items()) + level)
    return table.round({"V": 1, "f": 4, "d": 3, "AW": 4})


def edges_of(table, *names):
    return table["edge"].isin(names)


def exchanged():
    table = sound()
    return table.rename(columns={"V": "f", "f": "V"})


def random_wear():
    table = sound().rename(columns={"AW": "VB"})
    return table.assign(VB=0.2 * np.exp(0.3 * np.random.default_rng(2).standard_normal(len(table))))


def falling():
    table = sound().rename(columns={"AW": "VB"})
    return table.assign(VB=(table["VB"] * table["t"] ** -0.6).round(4))


def drilling():
    """Drilling at three feeds, wear on time; the speed of each drill stands under a header that nobody knows."""
    rng = np.random.default_rng(7)
    rows = []
    for g, (f, V) in enumerate(product((0.1, 0.16, 0.25), (60.0, 80.0, 100.0))):
        for t in np.arange(2.0, 13.0, 2.0):
            VB = 0.02 * (f / 0.16) ** 0.4 * (V / 80) ** 1.2 * t**0.8 * np.exp(0.05 * rng.standard_normal())
            rows.append((f"D{g + 1}", f, V, 8.0, t, round(VB, 4)))
    return pd.DataFrame(
        rows, columns=["drill", "f [mm/rev]", "Parameter 7", "Drill diameter [mm]", "t [min]", "VB [mm]"]
    )


def inch_wear():
    table = sound()
    rows = table.index[[20, 61, 100]]
    return table.assign(AW=table["AW"].mask(table.index.isin(rows), table["AW"] / 25.4))


def inch_feed():
    table = sound()
    four = edges_of(table, "E03", "E08", "E14", "E20")
    return table.assign(f=table["f"].mask(four, table["f"] / 25.4))


def seconds():
    table = sound()
    return table.assign(t=table["t"].mask(edges_of(table, "E03", "E08", "E14"), table["t"] * 60))


FILES = {
    "V and f exchanged": exchanged,
    "drilling without its speed column": drilling,
    "wear drawn at random: R2 .02": random_wear,
    "wear that falls with time": falling,
    "three rows of wear in inches": inch_wear,
    "feed of four edges in inches": inch_feed,
    "time of three edges in seconds": seconds,
    "wear in micrometres read as mm": lambda: sound().assign(AW=sound()["AW"] * 1000),
    "four edges": lambda: sound(edges=24)[lambda table: edges_of(table, "E01", "E02", "E03", "E04")],
    "no edge column": lambda: sound().drop(columns="edge"),
}


def name_of(expected):
    return f"{expected.set} {expected.response}"


def verdicts(runs, response):
    """Verdict on the law of a response, as the main job judges it."""
    laws, refused = fit.default_laws(runs)
    found = [law for law in laws if law.response == response]
    assert found, refused
    return [fit.judge(law, runs=runs, laws=len(laws)).verdict for law in found]


def assert_expected(verdict, expected: Expected):
    assert verdict.level in expected.levels, verdict
    text = " ".join(verdict.reasons)
    for names in expected.named:
        assert re.search(rf"\b({names})", text), (names, verdict.reasons)


@pytest.mark.parametrize("expected", BUNDLED, ids=name_of)
def test_bundled_sets(expected):
    (verdict,) = verdicts(datasets.read_runs(datasets.bundled(expected.set)), expected.response)
    assert_expected(verdict, expected)


@pytest.mark.parametrize("expected", REAL, ids=name_of)
def test_real_sets(measurements, expected):
    name, _, work = expected.set.partition(", material ")
    path = measurements / ("nasa_milling/nasa_mill_runs.csv" if work else name)
    runs = datasets.read_runs(path)
    (part,) = [one for one in runs.pairs() if not work or one.work == work]
    (verdict,) = verdicts(part, expected.response)
    assert_expected(verdict, expected)


def outcome(expected, **options):
    """The verdict on a faulty file; of one that is refused, the message as its reason."""
    table = FILES[expected.set]().rename(columns=HEADERS)
    try:
        runs = datasets.runs_from_frame(table, tool="T", work="W", **options)
        (verdict,) = verdicts(runs, expected.response)
    except FitmodelsError as error:
        return Verdict(max(expected.levels), (str(error),))
    return verdict


@pytest.mark.parametrize("expected", FAULTY, ids=name_of)
def test_faulty_files(expected):
    """A file that the reading refuses with the column named is as good as one that must not be used."""
    assert_expected(outcome(expected), expected)


@pytest.mark.parametrize("name", ["V and f exchanged", "wear in micrometres read as mm"])
def test_files_that_were_read_without_judging_are_judged_by_the_law(name):
    expected = next(one for one in FAULTY if one.set == name)
    verdict = outcome(expected, judge=False)
    assert verdict.level == 2
    assert_expected(verdict, expected)


def test_the_sound_file_is_usable():
    (verdict,) = verdicts(datasets.runs_from_frame(sound().rename(columns=HEADERS), tool="T", work="W"), "AW")
    assert verdict.level == 0, verdict.reasons


def test_no_remedy_to_repeat_an_edge_names_a_command_that_repeats_none():
    from fitmodels.cards.content.verdicts import REMEDIES

    repeats = [command for words, command in REMEDIES.values() if words.startswith("Repeat the conditions")]
    assert repeats == ["", "", ""]
