"""Which rows a law is fitted to, and that every other one is counted and named."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.fit.rows import select


def runs(**columns):
    return datasets.runs_from_frame(pd.DataFrame(columns))


def varied(n, seed=0, **more):
    rng = np.random.default_rng(seed)
    return {
        "V": rng.uniform(50, 200, n),
        "f": rng.uniform(0.1, 0.5, n),
        "AW": rng.uniform(0.1, 0.3, n),
        **more,
    }


def test_all_rows_are_kept_as_they_stand():
    columns = varied(6)
    rows = select(runs(**columns), "AW", ["f", "V"])
    np.testing.assert_array_equal(rows.X, np.column_stack([columns["f"], columns["V"]]))
    np.testing.assert_array_equal(rows.y, columns["AW"])
    np.testing.assert_array_equal(rows.lines, range(6))
    assert rows.shifts.shape == (6, 0)
    assert (rows.by, rows.edge, rows.dropped, rows.repeats) == (None, None, (), 1)
    np.testing.assert_array_equal(rows.factors([1]), columns["V"][:, None])


def test_a_row_is_left_out_once_and_for_the_first_reason():
    columns = varied(8)
    columns["AW"][[1, 2]] = np.nan
    columns["V"][[2, 3]] = np.nan
    columns["AW"][3] = -1
    columns["f"][4] = 0
    rows = select(runs(**columns), "AW", ["V", "f"])
    assert [(d.reason, d.count, d.lines) for d in rows.dropped] == [
        ("AW missing", 2, (1, 2)),
        ("V missing", 1, (3,)),
        ("f zero or negative", 1, (4,)),
    ]
    np.testing.assert_array_equal(rows.lines, [0, 5, 6, 7])


def test_lines_of_the_file_are_named_and_only_the_first_five(tmp_path):
    path = tmp_path / "wear.csv"
    body = "".join(f"{50 + i},0.{i + 1},{0 if i < 7 else 0.1 * i:g}\n" for i in range(9))
    path.write_text("# a note\nV,f,AW\n" + body, "utf-8")
    (dropped,) = select(datasets.read_runs(path), "AW", ["V"]).dropped
    assert (dropped.count, dropped.lines) == (7, (3, 4, 5, 6, 7))  # the first data row is line 3


@pytest.mark.parametrize(("positive", "kept"), [(None, 3), (["VB"], 4), ([], 5)])
def test_what_must_be_above_zero(positive, kept):
    given = runs(VB=[0.0, 0.1, 0.2, 0.3, 0.4], I=[0.2, -0.1, 0.3, 0.3, 0.4])
    assert len(select(given, "I", ["VB"], positive=positive).y) == kept


def test_rows_without_a_category_are_left_out():
    rows = select(runs(**varied(6, work=["a", "", "b", None, "b", "c"])), "AW", ["V"], by="work")
    assert [(d.reason, d.lines) for d in rows.dropped] == [("work missing", (1, 3))]
    assert (rows.by.column, rows.by.reference, rows.by.levels) == ("work", "a", ("b", "c"))
    np.testing.assert_array_equal(rows.shifts, [[0, 0], [1, 0], [1, 0], [0, 1]])


def test_a_level_that_only_unusable_rows_hold_is_no_level():
    columns = varied(6, work=list("aabbcc"))
    columns["AW"][4:] = 0
    rows = select(runs(**columns), "AW", ["V"], by="work")
    assert rows.by.levels == ("b",)
    columns["AW"][2:] = 0
    with pytest.raises(errors.FitError, match=r"by='work': the usable rows hold one level only \(a\); a shift needs"):
        select(runs(**columns), "AW", ["V"], by="work")


def test_no_usable_row_at_all_is_a_sentence_with_the_reasons():
    columns = varied(3)
    columns["AW"][:] = np.nan
    with pytest.raises(errors.FitError, match=r"AW: 0 usable rows for 2 parameters.*3 rows left out: AW missing"):
        fit.power_law(runs(**columns), "AW", ["V"])


def repeated(times, edge=None):
    columns = {name: np.tile(values, times) for name, values in varied(10).items()}
    columns["edge"] = np.tile(np.arange(10) // 5, times) if edge is None else edge
    return runs(**columns)


@pytest.mark.parametrize("times", [2, 3, 6])
def test_a_file_that_repeats_every_measurement_is_noticed(times):
    rows = select(repeated(times), "AW", ["V", "f"])
    assert rows.repeats == times
    np.testing.assert_array_equal(rows.lines, range(10))
    assert len(rows.edge) == 10


def test_rows_of_other_edges_or_materials_are_no_copies():
    both = np.repeat(["E1", "E2"], 10)
    assert select(repeated(2, both), "AW", ["V", "f"]).repeats == 1
    columns = {name: np.tile(values, 2) for name, values in varied(10).items()}
    assert select(runs(**columns, work=both), "AW", ["V", "f"]).repeats == 2
    rows = select(runs(**columns, work=both), "AW", ["V", "f"], by="work")
    assert (rows.repeats, rows.by.levels) == (1, ("E2",))


def test_a_few_equal_rows_are_chance_not_copies():
    columns = varied(10)
    for name in ("V", "f", "AW"):
        columns[name][1] = columns[name][0]
    assert select(runs(**columns), "AW", ["V", "f"]).repeats == 1
    few = {name: np.tile(values, 2) for name, values in varied(3).items()}  # three rows twice
    assert select(runs(**few), "AW", ["V", "f"]).repeats == 1


def test_uneven_repeats_keep_their_proportion():
    columns = {name: np.repeat(values, [2] * 9 + [4]) for name, values in varied(10).items()}
    rows = select(runs(**columns), "AW", ["V", "f"])
    assert (rows.repeats, len(rows.y)) == (2, 11)


def test_an_edge_column_by_another_name():
    given = runs(**varied(4, insert_no=["a", "b", "a", "b"]))
    assert select(given, "AW", ["V"], edge="insert_no").edge.tolist() == ["a", "b", "a", "b"]
    assert select(given, "AW", ["V"], edge=None).edge is None
    assert fit.power_law(given, "AW", ["V"], edge="insert_no").n_edges == 2
