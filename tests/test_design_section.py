"""The design section: what the tests behind laws were, distinguished from the runs and kept in the parameter file."""

from dataclasses import replace
from functools import cache
from itertools import combinations, product

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.parameters import collect, read, write
from fitmodels.parameters.gather.description import reading_notes
from fitmodels.parameters.gather.design import (
    constant_by_edge,
    design_section,
    kind_of_plan,
    label_column,
    number_column,
)
from fitmodels.parameters.sections.origin import DesignSection
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pydantic import ValidationError


@cache
def bundled():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@pytest.fixture(scope="module")
def runs():
    return bundled()


@pytest.fixture(scope="module")
def pf(runs):
    laws, _ = fit.default_laws(runs)
    return collect(tool="GC435", work="709M40", design=runs, laws=laws, tool_life=fit.tool_life(laws[0]))


def made(**columns):
    """Runs of the bundled set's roles with other numbers."""
    runs = bundled()
    data = pd.DataFrame(columns)
    uses = tuple(use for use in runs.columns if use.role in data)
    return replace(runs, data=data, lines=np.arange(len(data)), columns=uses)


# --- the bundled set ----------------------------------------------------------------------------------


def test_the_bundled_plan_is_the_papers_central_composite_of_24_edges(pf):
    """Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006: 8 factorial, 4 centre and 6 axial edges cut twice."""
    design = pf.design
    assert design.plan == "central composite"
    edges = design.edges
    assert (edges.edges, edges.settings, edges.replicated, edges.replicated_edges) == (24, 8 + 1 + 6, 7, 4 + 12)
    assert edges.set_by_edge == ("V", "f", "d")
    assert [len(f.levels) for f in design.factors] == [5, 5, 5, 10]


def test_rows_of_the_edges_and_their_wear_are_those_of_the_table(runs, pf):
    """pandas groups the same file."""
    grouped = runs.data.groupby("edge")
    sizes, edges = grouped.size(), pf.design.edges
    assert (edges.rows_least, edges.rows_median, edges.rows_most) == (sizes.min(), sizes.median(), sizes.max())
    assert pf.design.criterion.value == 0.3
    assert edges.worn == int((grouped["AW"].max() >= 0.3).sum())


def test_the_section_is_read_back_as_it_was_written(pf, tmp_path):
    again = read(write(pf, tmp_path / "params.json"))
    assert again.design == pf.design
    assert parameters.check(again).ok


def test_the_file_holds_the_reading_that_the_command_prints(runs, pf):
    assert list(pf.design.understood) == reading_notes(runs, pf.laws)
    assert pf.design.understood[0].startswith("edge: cutting edge, column 1 'edge': 24 values (E02")


def test_a_section_and_a_mapping_are_taken_as_they_are(pf):
    for given_ in (pf.design, pf.design.model_dump()):
        assert collect(tool="a", work="b", design=given_).design == pf.design


def test_a_file_without_the_section_is_still_read(pf, tmp_path):
    """It came later, as an optional section of version 1."""
    old = pf.model_copy(update={"design": None})
    assert read(write(old, tmp_path / "params.json")).design is None


# --- the milling set of NASA --------------------------------------------------------------------------


def test_the_nasa_set_is_eight_conditions_cut_twice(measurements):
    """Agogino & Goebel 2007: 16 cases, 2 depths x 2 feeds x 2 materials, each twice; 167 rows, 146 with VB."""
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    laws, _ = fit.default_laws(runs, by="material")
    design = collect(tool="a", work="b", design=runs, laws=laws).design
    assert (design.rows, design.edges.edges, design.edges.settings, design.edges.replicated) == (167, 16, 8, 8)
    assert design.plan == "full factorial, 2 x 2 levels"
    assert [(level.level, level.edges) for level in design.levels] == [("1", 8), ("2", 8)]
    assert {(rows.reason, rows.count) for rows in design.left_out} >= {("VB missing", 21)}
    assert design.edges.short_edges == ("6",)  # case 6 has a single run
    assert design.criterion is None
    assert design.edges.worn is None


# --- small tables -------------------------------------------------------------------------------------


def test_missing_cells_leave_settings_and_levels_as_they_are():
    runs = made(
        edge=["a", "a", "a", "b", "b", "", "c"], V=[50.0, np.nan, 50.0, 80.0, 80.0, 80.0, 80.0],
        t=[1.0, 2.0, 3.0, 1.0, np.nan, 3.0, 1.0],
    )  # fmt: skip
    section = design_section(runs, {})
    edges = section["edges"]
    assert (edges["edges"], edges["set_by_edge"], edges["settings"], edges["replicated"]) == (3, ["V"], 2, 1)
    assert section["factors"][0]["levels"] == [50.0, 80.0]
    assert edges["rows_least"] == 1


def test_edges_that_ended_early_are_named_and_worn_ones_are_not():
    names = ["a"] * 8 + ["b"] * 8 + ["c"] * 2 + ["d"] * 3
    wear = [0.1] * 18 + [0.2, 0.3, 0.4]
    runs = made(edge=names, V=[50.0] * 21, AW=wear)
    edges = design_section(runs, {}, {"wear": "AW", "value": 0.3, "unit": "mm"})["edges"]
    assert (edges["short"], edges["short_edges"], edges["worn"]) == (1, ["c"], 1)


def test_more_than_fifteen_levels_are_a_range():
    factors = design_section(made(V=np.arange(1.0, 17.0), f=np.repeat(np.arange(1.0, 5.0), 4)), {})["factors"]
    assert [(f["levels"], f["low"], f["high"]) for f in factors] == [([], 1.0, 16.0), ([1.0, 2.0, 3.0, 4.0], 1.0, 4.0)]


def test_rows_without_edges_are_a_plan_of_their_own():
    section = design_section(made(V=[50.0, 50.0, 90.0, 90.0], f=[0.1, 0.2, 0.1, 0.2]), {})
    assert section["plan"] == "full factorial, 2 x 2 levels"
    assert section["edges"] is None


@given(
    hnp.arrays(np.int64, st.integers(1, 40), elements=st.integers(0, 4)),
    st.integers(0, 2**32 - 1),
)
def test_a_factor_stands_on_every_edge_exactly_where_pandas_says_so(edge, seed):
    rng = np.random.default_rng(seed)
    v = rng.choice([1.0, 2.0], 5)[edge] if rng.random() < 0.5 else rng.choice([1.0, 2.0], len(edge))
    data = pd.DataFrame({"edge": [f"E{i}" for i in edge], "V": v})
    found = constant_by_edge(number_column(data["V"].to_numpy()), label_column(made(**data), "edge"))
    assert found == bool(data.groupby("edge")["V"].agg(np.ptp).eq(0).all())


@given(hnp.arrays(np.int64, st.integers(1, 40), elements=st.integers(-1, 4)))
def test_names_are_counted_as_pandas_counts_them(edge):
    names = pd.Series([f"E{i}" if i >= 0 else "" for i in edge])
    found = label_column(made(edge=names), "edge")
    expected = names[names != ""].value_counts(sort=False)
    assert dict(zip(found.names, found.counts.tolist(), strict=True)) == expected.to_dict()
    assert [names[i] for i in found.first] == found.names


# --- kinds of plan ------------------------------------------------------------------------------------


def composite(k, faces=False):
    corners, axes = np.array(list(product((-1, 1), repeat=k))), np.kron(np.eye(k, dtype=int), [[-1], [1]])
    z = np.vstack([corners, (1 if faces else 2) * axes, np.zeros((1, k), dtype=int)])
    return z - z.min()


def box_behnken(k):
    """NIST/SEMATECH e-Handbook, 5.3.3.6.2: every pair of factors at its corners, the others at the middle."""
    points = [np.ones(k, dtype=int)]
    for i, j in combinations(range(k), 2):
        for a, b in product((0, 2), repeat=2):
            point = np.ones(k, dtype=int)
            point[[i, j]] = a, b
            points.append(point)
    return np.array(points)


# Taguchi's L9, as NIST/SEMATECH prints it in 5.3.3.10 (three factors of it)
L9 = np.array([[0, 0, 0], [0, 1, 1], [0, 2, 2], [1, 0, 1], [1, 1, 2], [1, 2, 0], [2, 0, 2], [2, 1, 0], [2, 2, 1]])


@pytest.mark.parametrize(
    ("levels", "words"),
    [
        (composite(3), "central composite"),
        (composite(2), "central composite"),
        (composite(3, faces=True), "face-centred central composite"),
        (composite(2, faces=True), "full factorial, 3 x 3 levels"),  # they are one
        (box_behnken(3), "Box-Behnken"),
        (box_behnken(4), "Box-Behnken"),
        (L9, "orthogonal array of 9 settings"),
        (np.array(list(product(range(2), range(3)))), "full factorial, 2 x 3 levels"),
        (np.array([[1, 1], [0, 1], [2, 1], [1, 0], [1, 2]]), "one factor at a time"),
    ],
)
def test_plans_that_are_known(levels, words):
    assert kind_of_plan(levels) == words
    assert kind_of_plan(levels[::-1, ::-1]) in (words, "full factorial, 3 x 2 levels")


@pytest.mark.parametrize(
    "levels",
    [np.zeros((0, 2), dtype=int), np.array([[0], [1], [2]]), np.delete(composite(3), 8, axis=0), L9[:-1]],
    ids=["nothing", "one factor", "an axial point missing", "a setting missing"],
)
def test_plans_that_are_none(levels):
    assert kind_of_plan(levels) is None


# --- what the schema refuses --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "section",
    [
        {"rows": -1},
        {"rows": 1, "factors": [{"symbol": "V", "quantity": "", "unit": "", "low": 2.0, "high": 1.0}]},
        {"rows": 1, "factors": [{"symbol": "V", "quantity": "", "unit": "", "low": 0.0, "high": 1.0,
                                 "levels": [0.0] * 16}]},
        {"rows": 1, "edges": {"edges": 0, "rows_least": 1, "rows_median": 1.0, "rows_most": 1}},
        {"rows": 1, "criterion": {"wear": "AW", "value": 0.0, "unit": "mm"}},
    ],
)  # fmt: skip
def test_sections_that_cannot_be(section):
    with pytest.raises(ValidationError):
        DesignSection.model_validate(section)
