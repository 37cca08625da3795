"""Plans of tests: orthogonal arrays, aliases, blocks, durations, processes; a filled plan is a data file."""

import json
import re
from itertools import combinations

import numpy as np
import pytest
from fitmodels import datasets, fit
from fitmodels.cli import main
from fitmodels.core.errors import UsageError
from fitmodels.datasets import plan_tests, read_runs
from fitmodels.datasets.derived.rules import removal_rate
from fitmodels.datasets.factorial_designs import (
    ARRAYS,
    alias_sentences,
    array_columns,
    factorial_blocks,
    orthogonal_array,
    two_level,
)
from fitmodels.datasets.planning import DESIGNS, PROCESSES

TURNING = {"V": (80.0, 200.0), "f": (0.1, 0.4), "d": (1.0, 2.5)}
MILLING = {"V": (80.0, 200.0), "fz": (0.05, 0.2), "d": (1.0, 3.0), "ae": (2.0, 8.0)}
MILL = {"V": (80.0, 200.0), "fz": (0.05, 0.2)}
# get_orthogonal_array of pyDOE3 1.6.2, columns as strings
PUBLISHED = {
    "L4": ["0011", "0101", "0110"],
    "L8": ["00001111", "00110011", "00111100", "01010101", "01011010", "01100110", "01101001"],
    "L9": ["000111222", "012012012", "012120201", "012201120"],
    "L18": ["012012012012012012", "012012120201120201", "012120012201201120", "012120201120012201",
            "012201120120201012", "012201201012120120"],  # its 3^6; Taguchi's first two columns make its 6^1
    "L27": ["000000000111111111222222222", "000111222000111222000111222", "000111222111222000222000111",
            "000111222222000111111222000", "012012012012012012012012012", "012012012120120120201201201",
            "012012012201201201120120120", "012120201012120201012120201", "012120201120201012201012120",
            "012120201201012120120201012", "012201120012201120012201120", "012201120120012201201120012",
            "012201120201120012120012201"],
}  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_any_two_columns_of_an_array_hold_every_pair_equally_often(name):
    table = orthogonal_array(name)
    assert len(table) == int(name[1:])
    for i, j in combinations(range(table.shape[1]), 2):
        pairs, counts = np.unique(table[:, [i, j]], axis=0, return_counts=True)
        assert len(pairs) == (table[:, i].max() + 1) * (table[:, j].max() + 1)
        assert len(set(counts)) == 1


@pytest.mark.parametrize("name", PUBLISHED)
def test_arrays_are_the_published_tables(name):
    columns = ["".join(map(str, column)) for column in orthogonal_array(name).T]
    assert columns[-len(PUBLISHED[name]) :] == PUBLISHED[name]


@pytest.mark.parametrize(("name", "rows"), [("L8", 8), ("L16", 16)])
def test_the_product_of_two_columns_stands_in_the_column_of_their_sum(name, rows):
    table = orthogonal_array(name)
    for i, j in combinations(range(1, rows), 2):
        assert ((table[:, i - 1] ^ table[:, j - 1]) == table[:, (i ^ j) - 1]).all()


@pytest.mark.parametrize(("name", "factors"), [("L8", 3), ("L16", 4), ("L16", 5), ("L9", 2), ("L27", 3), ("L27", 4)])
def test_few_factors_take_columns_without_aliases(name, factors):
    columns, block = array_columns(name, [int(name in ("L9", "L27")) + 2] * factors)
    scores = orthogonal_array(name)[:, columns].astype(float)
    assert block is None
    (words,) = alias_sentences(2 * scores / scores.max() - 1, [f"x{i}" for i in range(factors)])
    assert words.startswith("No factor is aliased")


@pytest.mark.parametrize("k", [3, 4, 5, 6])
def test_aliases_of_half_a_factorial_follow_from_its_defining_relation(k):
    names = "abcdef"[:k]
    x = dict(zip(names, two_level(k, half=True).T, strict=True))
    assert (np.prod(list(x.values()), axis=0) == 1).all()  # I = abc...
    words = "".join(alias_sentences(two_level(k, half=True), names)).rstrip(".").partition("estimated: ")[2]
    groups = [set(group.split(" = ")) for group in words.split("; ")]
    for left, right in combinations([*names, *map("·".join, combinations(names, 2))], 2):
        one, other = (np.prod([x[name] for name in side.split("·")], axis=0) for side in (left, right))
        assert (abs(one @ other) == len(one)) == any({left, right} <= group for group in groups)


def test_partial_aliases_of_twelve_edges_are_stated():
    columns, _ = array_columns("L12", [2] * 4)
    words = alias_sentences(2.0 * orthogonal_array("L12")[:, columns] - 1, ["V", "f", "d", "t"])
    assert "correlation up to 0.33" in words[0]  # a third: Plackett & Burman 1946


@pytest.mark.parametrize(
    ("k", "half", "blocks"), [(2, False, 2), (3, False, 2), (3, False, 4), (5, True, 2), (5, False, 4)]
)
def test_blocks_of_a_factorial_are_equal_and_balanced(k, half, blocks):
    points = two_level(k, half=half)
    number, lost = factorial_blocks(points, blocks)
    assert set(np.bincount(number)) == {len(points) // blocks}
    for block in range(blocks):
        assert points[number == block].sum(axis=0) == pytest.approx(0)  # no factor is confounded
    assert all(len(word) > 1 for word in lost)
    means = [[points[number == b][:, word].prod(axis=1).mean() for b in range(blocks)] for word in lost]
    assert abs(np.array(means)) == pytest.approx(1)


def test_the_interaction_of_all_factors_makes_two_blocks():
    assert factorial_blocks(two_level(4), 2)[1] == ((0, 1, 2, 3),)
    with pytest.raises(UsageError, match="would equal the effect of a factor"):
        factorial_blocks(two_level(3, half=True), 2)


@pytest.mark.parametrize("design", DESIGNS)
def test_every_design_reads_back_and_fits_when_filled_in(design, tmp_path):
    plan = plan_tests(TURNING, design=design, duration=(12.0,), readings=3, measure=["VB"], process="turning")
    datasets.write_csv(plan, tmp_path / "plan.csv", plan.attrs["notes"])
    runs = read_runs(tmp_path / "plan.csv")
    edges = plan.groupby("edge").first()
    assert len(runs) == len(plan) == 3 * len(set(runs.labels("edge")))
    assert runs.units.items() >= {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "VB": "mm"}.items()
    assert np.isnan(runs.values("VB")).all()
    assert not runs.warnings
    for name, (low, high) in TURNING.items():
        assert (edges[name].min(), edges[name].max()) == (low, high)
    if len(edges) > 4:
        filled = plan.assign(VB=0.01 * plan["V"] ** 0.5 * plan["f"] ** 0.2 * plan["d"] ** 0.1 * plan["t"] ** 0.4)
        law = fit.power_law(datasets.runs_from_frame(filled), "VB", ["V", "f", "d", "t"])
        assert law.params.tolist() == pytest.approx([0.01, 0.5, 0.2, 0.1, 0.4])


@pytest.mark.parametrize("blocks", [2, 3])
def test_an_array_in_blocks_is_orthogonal_to_them(blocks):
    design, ranges = ("L8", TURNING) if blocks == 2 else ("L27", TURNING)
    plan = plan_tests(ranges, design=design, blocks=blocks)
    counts = plan.groupby(["block", "V"]).size()
    assert counts.nunique() == 1
    assert plan["block"].is_monotonic_increasing


def test_blocks_that_cost_a_product_say_so():
    plan = plan_tests({**TURNING, "ae": (1.0, 2.0)}, design="L8", blocks=2)
    assert any("A difference of blocks cannot be separated from" in words for words in plan.attrs["notes"])


def test_levels_of_ones_own_and_words():
    plan = plan_tests(
        {"V": [100.0, 140.0, 200.0], "f": (0.1, 0.4), "coolant": ["dry", "flood"]}, design="L18", centre=0
    )
    assert set(plan["V"]) == {100, 140, 200}
    assert set(plan["f"]) == {0.1, 0.2, 0.4}
    assert plan.groupby(["coolant", "V", "f"]).size().tolist() == [1] * 18
    assert "coolant_coded" not in plan
    with pytest.raises(UsageError, match="1 of 2 levels, 7 of 3 levels"):
        plan_tests({"a": ["x", "y"], "b": ["x", "y"]}, design="L18")
    with pytest.raises(UsageError, match="coolant has no middle"):
        plan_tests({"V": (1.0, 2.0), "coolant": ["dry", "flood"]}, design="L8", centre=1)
    with pytest.raises(UsageError, match="need an array"):
        plan_tests({"V": [1.0, 2.0, 3.0]})


def test_the_duration_is_a_factor_and_readings_divide_it():
    plan = plan_tests(TURNING, duration=(5.0, 20.0), readings=4, axial_repeats=1)
    ends = plan.groupby("edge")["t"].max()
    assert (ends.min(), ends.max()) == (5.0, 20.0)
    assert len(ends) == 16 + 4 + 8
    assert (plan.groupby("edge")["t"].min() * 4).to_numpy() == pytest.approx(ends.to_numpy(), rel=1e-3)
    x = np.log(plan.groupby("edge")[["V", "f", "d", "t"]].max())
    assert abs(np.corrcoef(x.T) - np.eye(4)).max() < 2e-3
    assert any(words.startswith(f"28 edges, {ends.sum():.4g} min in cut") for words in plan.attrs["notes"])


def test_the_settings_of_the_machine_agree_with_the_reader(tmp_path):
    plan = plan_tests(MILLING, process="milling", constants={"Dc": 20.0, "z": 4.0}, axial_repeats=1)
    assert plan["n"].to_numpy() == pytest.approx(1000 * plan["V"] / (np.pi * 20), rel=1e-3)
    assert plan["fm"].to_numpy() == pytest.approx(plan["fz"] * 4 * plan["n"], rel=1e-3)
    datasets.write_csv(plan, tmp_path / "plan.csv", [])
    runs = read_runs(tmp_path / "plan.csv", process="milling")
    assert not runs.warnings
    assert runs.values("MRR") == pytest.approx(removal_rate(plan, "milling"), rel=2e-3)


def test_the_speed_and_power_of_a_plan_follow_from_spindle_speed_and_diameter():
    plan = plan_tests(
        {"n": (800.0, 2000.0), "f": (0.1, 0.3), "d": (1.0, 2.0)}, process="turning", constants={"D": 80.0}
    )
    assert plan["V"].to_numpy() == pytest.approx(np.pi * 80 * plan["n"] / 1000, rel=1e-3)
    power = (plan["V"] * plan["f"] * plan["d"] / 60).max() * 2  # kW at 2000 N/mm2
    assert any(f"about {power:.2g} kW" in words for words in plan.attrs["notes"])


def test_the_effort_is_that_of_the_cutting_conditions():
    plan = plan_tests({"V": (150.0, 150.1), "f": (0.3, 0.3001), "d": (2.5, 2.5001)}, design="L4", duration=(10.0,))
    assert removal_rate(plan, None) == pytest.approx(np.full(4, 112500.0), rel=2e-3)  # facts of turning: 1000 V f d
    assert "Chips: 4.5 dm3 (35 kg if the work is steel)." in plan.attrs["notes"]
    assert any("about 3.8 kW" in words for words in plan.attrs["notes"])  # 112.5 cm3/min at 2000 N/mm2


@pytest.mark.parametrize("process", PROCESSES)
def test_a_process_without_ranges_names_its_factors(process):
    with pytest.raises(UsageError, match=rf"a plan of {process} varies V \(cutting speed, m/min\)"):
        plan_tests({}, process=process)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            {"ranges": {"V": (100, 200), "ae": (2, 12)}, "process": "milling", "constants": {"Dc": 10}},
            r"ae 12 mm: the width of cut is at most the diameter, Dc 10 mm",
        ),
        (
            {"ranges": MILL, "process": "milling", "constants": {"Dc": 20.0, "ae": 25.0}},
            r"ae 25 mm: the width of cut is at most the diameter, Dc 20 mm",
        ),
        ({"ranges": MILL, "process": "milling", "constants": {"z": 3.5}}, r"z 3.5: a number of teeth is whole"),
        (
            {"ranges": {"n": (800.0, 2000.0), "f": (0.1, 0.3)}, "process": "turning", "constants": {"D": 80, "V": 100}},
            r"V 100 m/min: it follows from n and D, .* \(V = pi D n/1000\). Leave out V, or one of these",
        ),
        (
            {"ranges": {"n": (800.0, 2000.0), **MILL}, "process": "milling", "constants": {"Dc": 20.0}},
            r"n 800 to 2000 1/min: it follows from V and Dc",
        ),
        (
            {"ranges": {**MILL, "fm": (100.0, 200.0)}, "process": "milling", "constants": {"Dc": 20.0, "z": 4.0}},
            r"fm 100 to 200 mm/min: it follows from V, fz, Dc and z",
        ),
        ({"ranges": {"f": (0.1, 0.4), "fz": (0.1, 0.2)}, "constants": {"z": 2.0}}, r"f 0.1 to 0.4 mm/rev: it follows"),
        ({"ranges": {"f": (0.1, 0.2)}, "process": "milling"}, r"f \(feed\) is not set in milling"),
        ({"ranges": TURNING, "process": "turning", "constants": {"z": 4.0}}, "z .* is not set in turning"),
        ({"ranges": TURNING, "process": "sawing"}, "process 'sawing'"),
        ({"ranges": TURNING, "design": "L10"}, "design 'L10'"),
        ({"ranges": TURNING, "design": "L4", "half": True}, "half is of a factorial"),
        ({"ranges": TURNING, "repeats": 2}, "repeats its centre"),
        ({"ranges": {"V": (200.0, 100.0)}, "design": "factorial"}, "200 to 100"),
        ({"ranges": {**TURNING, "t": (1.0, 2.0)}}, "range as the duration"),
        ({"ranges": TURNING, "readings": 3}, "need the duration"),
        ({"ranges": TURNING, "readings": 0}, "readings 0"),
        ({"ranges": TURNING, "duration": (-1.0,)}, "above zero"),
        ({"ranges": TURNING, "constants": {"D": -1.0}}, "D -1"),
        ({"ranges": TURNING, "measure": ["V"]}, "V is a factor"),
        ({"ranges": {"V": [100.0, 100.0]}, "design": "L8"}, "different levels"),
        ({"ranges": {}}, "no range"),
    ],
)
def test_what_cannot_be_planned_is_said(arguments, words):
    with pytest.raises(UsageError, match=words):
        plan_tests(**arguments)


def test_settings_that_an_array_repeats_are_a_pure_error():
    """L8 with two factors holds each of its four settings twice."""
    repeated = datasets.plan_tests({"V": (150, 300), "f": (0.1, 0.3)}, design="L8")
    assert not any("No setting is cut twice" in note for note in repeated.attrs["notes"])
    once = datasets.plan_tests({"V": (150, 300), "f": (0.1, 0.3)}, design="L4")
    assert any("No setting is cut twice" in note for note in once.attrs["notes"])


def test_a_factor_that_tests_measure_is_named():
    plan = datasets.plan_tests({"V": (150, 300), "F": (0.1, 0.3)}, design="L4")
    assert any(note.startswith("F is the ") and "do not set" in note for note in plan.attrs["notes"])


@pytest.mark.parametrize(
    ("arguments", "doubted"),
    [
        ({"ranges": TURNING, "process": "turning", "duration": (5.0, 20.0)}, []),
        ({"ranges": MILLING, "process": "milling", "constants": {"Dc": 20.0, "z": 4.0}}, []),
        ({"ranges": {"V": (20.0, 60.0), "fz": (0.003, 0.01), "d": (0.02, 0.1)}, "process": "milling",
          "constants": {"Dc": 0.5, "z": 2.0, "ae": 0.1}}, []),
        ({"ranges": {"V": (20.0, 60.0), "f": (0.05, 0.2)}, "process": "drilling", "constants": {"Dc": 3.0}}, []),
        ({"ranges": {"V": (260.0, 650.0), "f": (0.004, 0.016), "d": (0.04, 0.1)}}, ["f", "d"]),
        ({"ranges": {"V": (60.0, 200.0), "f": (0.012, 0.03), "d": (0.03, 0.1)}}, ["f", "d"]),
        ({"ranges": {"V": (60.0, 200.0), "f": (0.001, 0.01)}, "process": "turning"}, ["f"]),
        ({"ranges": {"V": (500.0, 2000.0), "fz": (0.1, 0.2)}, "process": "milling", "constants": {"Dc": 4.0}}, ["n"]),
        ({"ranges": {"V": (100.0, 400.0), "fz": (0.4, 0.9), "d": (20.0, 40.0)}, "process": "milling",
          "constants": {"Dc": 50.0, "ae": 40.0, "z": 4.0}}, ["P"]),
        ({"ranges": TURNING, "duration": (600.0,)}, ["t"]),
        ({"ranges": TURNING, "duration": (0.001,)}, ["t"]),
    ],
)  # fmt: skip
def test_settings_that_are_unusual_are_doubted_before_they_are_cut(arguments, doubted, tmp_path):
    plan = plan_tests(**arguments, axial_repeats=1)
    notes = [note for note in plan.attrs["notes"] if note.startswith("Doubt: ")]
    assert [note.split()[1] for note in notes] == doubted
    plan["VB"] = 0.1
    datasets.write_csv(plan, tmp_path / "plan.csv", plan.attrs["notes"])
    assert read_runs(tmp_path / "plan.csv").values("V").tolist() == plan["V"].tolist()  # the notes change nothing


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(UsageError, match=r"V 10000 to 20000 m/min cannot be \(usual"):
        plan_tests({"V": (10000.0, 20000.0)}, process="turning")
    with pytest.raises(UsageError, match=r"n 1592000 to 3183000 1/min cannot be .* it follows from other settings"):
        plan_tests({"V": (500.0, 1000.0)}, process="milling", constants={"Dc": 0.1})


def test_other_names_of_settings_are_read_as_in_headers():
    plan = plan_tests({"vc": (80, 200), "ap": (1, 2)}, design="L4", constants={"diameter": 80.0})
    assert {"V", "d", "D", "n"} <= set(plan)
    assert plan.attrs["notes"][:2] == ("vc is read as V (cutting speed, m/min).", "ap is read as d (depth of cut, mm).")
    assert "coolant" in plan_tests({"V": (80.0, 200.0), "coolant": ["dry", "flood"]}, design="L4")
    with pytest.raises(UsageError, match="V and vc are one quantity, cutting speed"):
        plan_tests({"V": (80, 200), "vc": (80, 200)})


def test_ranges_and_levels_take_units_as_values_do(capsys):
    words = ["--range", "V=260:650sfm", "--levels", "f=0.004,0.008,0.016in", "--range", "ap=0.04in:2mm"]
    assert main(["plan", "--design", "L9", *words, "--duration", "120s", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    columns = {name: [row[name] for row in plan["rows"]] for name in ("V", "f", "d", "t")}
    ends = {name: (min(values), max(values)) for name, values in columns.items()}
    expected = {"V": (260 * 0.3048, 650 * 0.3048), "f": (0.1016, 0.4064), "d": (1.016, 2), "t": (2, 2)}
    assert all(ends[name] == pytest.approx(values) for name, values in expected.items())
    assert not any(note.startswith("Doubt") for note in plan["notes"])
    assert main(["plan", "--range", "V=260:650mm"]) == 2
    assert "or, with a unit of V, 50:200m/min" in capsys.readouterr().err


def test_edges_beyond_a_limit_of_the_machine_are_named(capsys):
    words = ["--process", "milling", "--range", "V=80:200", "--range", "fz=0.05:0.2", "--range", "d=1:2"]
    words += ["--value", "Dc=10", "--value", "z=4", "--value", "ae=8", "--axial", "1", "--json"]
    limits = ["--limit", "n=80rev/s", "--limit", "P=1kW", "--limit", "fm=50:20000"]
    assert main(["plan", *words, *limits]) == 0
    plan = json.loads(capsys.readouterr().out)
    beyond = [row["edge"] for row in plan["rows"] if row["n"] > 4800]
    power = [row["edge"] for row in plan["rows"] if row["d"] * 8 * row["fm"] * 2000 / 6e7 > 1]
    n, P, fm = (note for note in plan["notes"] if note.startswith("Limit: "))
    assert n.startswith(f"Limit: n at most 4800 1/min; {len(beyond)} of ")
    assert (re.findall(r"E\d\d", n), re.findall(r"E\d\d", P)) == (beyond, power)
    assert len(power) > 0
    assert fm == "Limit: fm from 50 to 20000 mm/min; all edges keep it."
    assert main(["plan", "--range", "V=80:200", "--limit", "n=4800"]) == 2
    assert "the plan has no n (spindle speed)" in capsys.readouterr().err
    assert main(["plan", "--range", "V=80:200", "--limit", "V=many"]) == 2
