"""Comparison of a batch: exponents pooled over families, the table of pairs, what is drawn and printed."""

import errno
from xml.etree import ElementTree

import numpy as np
import openpyxl
import pandas as pd
import pytest
from fitmodels.batch.comparison import FAMILIES, PAIRS, compare
from fitmodels.batch.exponent_figures import _cut, _Panel, write_figures
from fitmodels.batch.law_rows import law_table
from fitmodels.batch.outcomes import PairOutcome
from fitmodels.batch.pair_table import ISO_FAMILIES, is_iso_513, iso_family, read_pairs, unknown_pairs, with_groups
from fitmodels.batch.tables import results_frame
from fitmodels.batch.terminal import comparison_block
from fitmodels.core import journal
from fitmodels.core.errors import DataError, UsageError
from fitmodels.core.files import synchronised
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

MEANS = {"P": 0.45, "K": 0.75, "S": 0.60}
SPREAD, SD = 0.05, 0.1


def parsed(path):
    """The root of an SVG file."""
    return ElementTree.fromstring(path.read_bytes())  # noqa: S314  written by the test


def simulated(n, seed=1, factors=("V", "t"), responses=("AW",)):
    """Results of n pairs with 4 to 24 edges, and the true exponent of V of each."""
    rng = np.random.default_rng(seed)
    letter = np.array(list(MEANS))[rng.integers(0, 3, n)]
    edges = rng.choice([4, 6, 8, 12, 16, 24], n)
    df = np.maximum(edges - 1.0 - len(factors), 1.0)
    held, truth = [], None
    for response in responses:
        s = SD * np.sqrt(rng.chisquare(df) / df)
        row = {
            "tool": [f"T{i}" for i in range(n)], "work": "steel", "response": response, "form": "power", "reason": "",
            "iso513": [f"{name}{10 * (i % 3)}" if i % 3 else name for i, name in enumerate(letter)],
            "coolant": rng.choice(["dry", "flood"], n), "df": df, "scale_se": s, "by_edge": True, "params_c0": 1.0,
            "bse_c0": 0.1, "row_bse_c0": 0.1,
        }  # fmt: skip
        for factor in factors:
            root = 1.2 / np.sqrt(edges)
            beta = np.array([MEANS[name] for name in letter]) + SPREAD * rng.standard_normal(n)
            truth = beta if truth is None else truth
            row |= {f"params_{factor}": beta + SD * root * rng.standard_normal(n),
                    f"bse_{factor}": s * root, f"row_bse_{factor}": s * root}  # fmt: skip
        held.append(pd.DataFrame(row))
    return pd.concat(held, ignore_index=True), truth


def words(made, width=160):
    console = Console(width=width)
    with console.capture() as caught:
        console.print(comparison_block(made))
    return caught.get()


def test_known_means_and_spreads_come_back_by_iso_group():
    """600 pairs in three groups: each mean within 3 of its errors, each tau in its interval, pooling errs less."""
    results, truth = simulated(600)
    made = compare(results, ["iso513"])
    of = made.families.query("factor == 'V' and grouping == 'iso513'").set_index("family")
    assert list(of.index) == ["K cast iron", "P steel", "S superalloys and titanium"]
    for letter, mean in MEANS.items():
        row = of.loc[ISO_FAMILIES[letter]]
        assert abs(row["mean"] - mean) < 3 * row["mean_se"]
        assert row["tau_low"] < SPREAD < row["tau_high"]
        assert row["new_low"] < mean - SPREAD
        assert row["new_high"] > mean + SPREAD
    pairs = made.pairs.query("factor == 'V' and grouping == 'iso513'")
    assert np.mean((pairs["pooled"] - truth) ** 2) < 0.6 * np.mean((pairs["estimate"] - truth) ** 2)
    inside = (pairs["pooled_low"] < truth) & (truth < pairs["pooled_high"])
    assert 0.92 < inside.mean() < 0.98  # Monte Carlo error 0.009


def test_all_pairs_come_first_then_each_grouping_for_every_response_and_factor_but_c0():
    made = compare(simulated(30, responses=("AW", "Fz"))[0], ["iso513", "coolant"])
    assert tuple(made.families) == FAMILIES
    assert tuple(made.pairs) == PAIRS
    order = made.families[["response", "factor", "grouping"]].drop_duplicates()
    assert order.to_numpy().tolist() == [
        [response, factor, grouping]
        for response in ("AW", "Fz") for factor in ("V", "t") for grouping in ("all pairs", "iso513", "coolant")
    ]  # fmt: skip
    assert len(made.pairs) == 30 * 2 * 2 * 3
    assert (made.families["pairs"][made.families["grouping"] == "all pairs"] == 30).all()


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 999))
def test_the_order_of_the_pairs_changes_nothing(seed):
    results, _ = simulated(24, seed)
    mixed = results.sample(frac=1, random_state=seed)
    one, other = compare(results, ["iso513"]), compare(mixed, ["iso513"])
    keys = ["response", "factor", "grouping", "tool"]
    a, b = (made.pairs.sort_values(keys, ignore_index=True) for made in (one, other))
    pd.testing.assert_frame_equal(a, b, rtol=1e-6, atol=1e-7)
    pd.testing.assert_frame_equal(one.families, other.families, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(
    ("exponents", "least", "most"),
    [(np.full(20, 0.5), 0.85, 1.0), (np.linspace(-3, 3, 20), 0.0, 0.02)],
    ids=["identical exponents shrink to their mean", "wild ones keep their own"],
)
def test_shrinkage_follows_the_spread(exponents, least, most):
    table = {"tool": [f"T{i}" for i in range(20)], "work": "a", "response": "AW", "form": "power", "reason": "",
             "params_V": exponents, "bse_V": 0.05, "df": 20}  # fmt: skip
    share = compare(pd.DataFrame(table)).pairs["shrinkage"]
    assert share.between(least, most).all()


@pytest.mark.parametrize("n", [0, 2])
def test_fewer_than_three_pairs_are_not_pooled(n):
    made = compare(simulated(3)[0].iloc[:n], ["iso513"])
    assert tuple(made.families) == FAMILIES
    assert tuple(made.pairs) == PAIRS
    assert len(made.families) == 0
    assert made.pairs["reason"].str.contains("fewer than 3|no family").all()
    assert "at least three pairs" in words(made)


def test_laws_without_a_power_form_and_pairs_without_a_law_or_this_exponent_stay_out():
    results, _ = simulated(9)
    results.loc[0, "form"] = "exponential"
    results.loc[1, "reason"] = "3 rows"
    results.loc[2, "params_V"] = np.nan
    results.loc[3, "bse_V"] = np.nan
    results.loc[4, "coolant"] = ""
    made = compare(results, ["coolant"])
    of = made.pairs.query("factor == 'V' and grouping == 'coolant'").set_index("tool")
    assert sorted(of.index) == ["T3", "T4", "T5", "T6", "T7", "T8"]
    assert "no standard error" in of.loc["T3", "reason"]
    assert of.loc["T4", "reason"] == "no family is named"
    assert set(made.pairs.query("factor == 't'")["tool"]) >= {"T2", "T3"}


def test_a_grouping_that_is_not_there_is_said():
    with pytest.raises(UsageError, match="no column 'alloy' to group"):
        compare(simulated(4)[0], ["alloy"])
    with pytest.raises(UsageError, match="level 95"):
        compare(simulated(4)[0], level=95)


def test_the_results_table_of_a_batch_is_compared_with_its_missing_cells():
    """Outcomes -> table (None, NA, a grouping named like a column of its own) -> comparison."""
    law = {"response": "AW", "form": "power", "reason": "", "nobs": 24, "df": 5, "scale_se": 0.1, "by_edge": True,
           "params_V": 0.5, "bse_V": 0.04, "row_bse_V": 0.04}  # fmt: skip
    outcomes = [
        *(PairOutcome(f"T{i}", "a", 24, groups={"form": "bar"}) for i in range(4)),
        PairOutcome("T9", "a", 2, reason="2 rows"),
        PairOutcome("T8", "a", 2),
    ]
    rows = [(i, {**law, "params_V": 0.5 + 0.03 * i}) for i in range(4)]
    laws = law_table([*rows, (5, {**law, "params_V": None, "bse_V": None, "df": None, "by_edge": None})])
    made = compare(results_frame(outcomes, laws, ["form"]), ["form"])
    assert made.families[["grouping", "family", "pairs"]].to_numpy().tolist() == [
        ["all pairs", "all pairs", 4],
        ["form", "bar", 4],
    ]
    assert set(made.pairs["tool"]) == {"T0", "T1", "T2", "T3"}


@pytest.mark.parametrize("header", ["iso513", "ISO 513", "Iso513", "iso group", "ISO_513"])
def test_headers_of_iso_513(header):
    assert is_iso_513(header)


@pytest.mark.parametrize(
    ("value", "family"),
    [("P20", "P steel"), ("p 10", "P steel"), ("ISO M15", "M stainless"), ("H", "H hardened"), ("Stahl", "Stahl"),
     ("P200", "P200"), ("x", "x")],
)  # fmt: skip
def test_values_of_iso_513(value, family):
    assert iso_family(value) == family


TABLES = {
    "all text, semicolons": "tool;work;ISO 513;coolant\nGC435;709M40;P20;dry\nK10;GG25;K;\n",
    "tabs and German headers": "Werkzeug\tWerkstoff\tISO 513\tcoolant\nGC435\t709M40\tP20\tdry\nK10\tGG25\tK\t-\n",
    "commas, a comment, columns moved": "# shop list\nISO 513,coolant,work,tool\nP20,dry,709M40,GC435\nK,,GG25,K10\n",
    "a row said twice": "tool|work|ISO 513|coolant\nGC435|709M40|P20|\nGC435|709M40||dry\nK10|GG25|K|\n",
}


@pytest.mark.parametrize("text", TABLES.values(), ids=TABLES)
def test_the_table_of_pairs_is_read_in_any_dialect(tmp_path, text):
    (tmp_path / "pairs.csv").write_text(text, encoding="utf-8")
    found = read_pairs(tmp_path / "pairs.csv")[["tool", "work", "ISO 513", "coolant"]]
    assert found.to_numpy().tolist() == [["GC435", "709M40", "P20", "dry"], ["K10", "GG25", "K", ""]]


def test_the_table_of_pairs_as_a_workbook_keeps_numbers_as_names(tmp_path):
    book = openpyxl.Workbook()
    for row in (["tool", "iso513", "batch"], [4325, "P20", 7], [4330, "M", None]):
        book.active.append(row)
    book.save(tmp_path / "pairs.xlsx")
    assert read_pairs(tmp_path / "pairs.xlsx").to_numpy().tolist() == [["4325", "", "P20", "7"], ["4330", "", "M", ""]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tool;iso513\nA;P\nA;K\n", r"lines 2 and 3 contradict each other: iso513 of A is 'P' and 'K'"),
        ("insertx;iso513\nA;P\n", "neither tool nor work is a column of its header"),
        ("tool;work\nA;B\n", "has no groups of pairs"),
        ("tool;iso513;iso513\nA;P;P\n", "2 columns named 'iso513'"),
        ("tool;iso513\n;P\n", "line 2 names neither tool nor work"),
        ("tool;iso513\nA;P;x\n", "line 2 has 3 cells, its header has 2"),
        ("\n", "holds only blanks"),
        ("-\n", "holds no filled cell"),
    ],
)
def test_a_table_of_pairs_that_cannot_be_is_said_in_a_sentence(tmp_path, text, said):
    (tmp_path / "pairs.csv").write_text(text)
    with pytest.raises(DataError, match=said):
        read_pairs(tmp_path / "pairs.csv")


def test_groups_come_from_the_rows_then_the_pair_then_its_tool_then_its_work():
    outcomes = [
        PairOutcome("A", "x", 9, groups={"iso513": "P", "coolant": ""}),
        PairOutcome("A", "y", 9), PairOutcome("B", "y", 9),
    ]  # fmt: skip
    table = pd.DataFrame({"tool": ["A", "A", ""], "work": ["", "x", "y"],
                          "iso513": ["M", "P", "K"], "coolant": ["dry", "", "flood"]})  # fmt: skip
    one, two, three = with_groups(outcomes, table)
    assert (one.groups, two.groups, three.groups) == (
        {"iso513": "P", "coolant": "dry"}, {"iso513": "M", "coolant": "dry"}, {"iso513": "K", "coolant": "flood"},
    )  # fmt: skip
    assert [concern.kind for concern in one.concerns] == ["group differs"]
    assert one.concerns[0].words == "iso513 is 'P' by its own rows and 'M' by the table of pairs for A; 'P' counts"
    assert [concern.words for concern in two.concerns] == [
        "iso513 is 'M' by the table of pairs for A and 'K' by the table of pairs for y; 'M' counts",
        "coolant is 'dry' by the table of pairs for A and 'flood' by the table of pairs for y; 'dry' counts",
    ]
    assert three.concerns == ()
    assert outcomes[0].groups == {"iso513": "P", "coolant": ""}


def test_pairs_that_the_source_does_not_hold_are_named():
    table = pd.DataFrame({"tool": list("ABCDE"), "work": "x", "iso513": "P"})
    outcomes = [PairOutcome("A", "x", 9)]
    assert with_groups(outcomes, table)[0].groups == {"iso513": "P"}
    assert unknown_pairs(outcomes, table).endswith("does not hold: B on x, C on x, D on x and 1 more.")
    with pytest.raises(UsageError, match="none of which the source holds; it holds Z on x"):
        with_groups([PairOutcome("Z", "x", 9)], table)


@pytest.mark.parametrize(("n", "pictures"), [(2, 0), (3, 2), (60, 2), (61, 2), (10_000, 2)])
def test_pictures_are_drawn_of_any_number_of_pairs(tmp_path, n, pictures):
    made = compare(simulated(n)[0], ["iso513", "coolant"])
    paths = write_figures(made, tmp_path / "figures")
    assert len(paths) == pictures
    for path in paths:
        drawn = parsed(path)
        assert drawn.get("width") == "828pt"
        assert f"of AW: {n} pairs" in drawn[0].text
        assert not {"nan", "inf"} & set(path.read_text(encoding="utf-8").replace('"', " ").split())


def test_a_picture_of_many_families_long_names_and_a_wild_pair(tmp_path):
    results, _ = simulated(300, factors=("f", "F"))
    results["grade"] = [f"a grade with a very long name and number {i % 60}" for i in range(300)]
    results.loc[0, ["params_f", "bse_f"]] = 40.0, 3.0
    made = compare(results, ["grade"])
    assert [path.name for path in write_figures(made, tmp_path)] == ["exponents_AW_f.svg", "exponents_AW_F-2.svg"]
    assert all(float(parsed(path).get("height").removesuffix("pt")) < 800 for path in tmp_path.iterdir())
    assert all("a grade with a...e and number" in path.read_text(encoding="utf-8") for path in tmp_path.iterdir())


def test_a_picture_shows_the_numbers_of_the_comparison(tmp_path):
    made = compare(simulated(30)[0], ["iso513"])
    drawn = parsed(write_figures(made, tmp_path)[0])
    svg = "{http://www.w3.org/2000/svg}"
    of_V = made.families[made.families["factor"] == "V"]
    pooled = made.pairs[(made.pairs["factor"] == "V") & (made.pairs["grouping"] == "iso513")]["pooled"]
    ticks = [(float(text.get("x")), text.text) for text in drawn.iter(f"{svg}text") if text.text.startswith("0.")]
    dots = [float(dot.get("cx")) for dot in drawn.iter(f"{svg}circle") if dot.get("cy") != "0.0"]
    for shown, values in ((0, sorted(of_V["mean"])), (len(of_V), sorted(pooled.dropna()))):
        mine = dots[shown : shown + len(values)]
        x, value = zip(*[tick for tick in ticks if (tick[0] < 414) == (shown == 0)], strict=True)
        read = np.polyval(np.polyfit(x, np.array(value, dtype=float), 1), sorted(mine))
        np.testing.assert_allclose(read, values, atol=1e-3)


def test_an_interval_that_goes_on_beyond_the_panel_ends_in_an_open_arrow(tmp_path):
    """Ends that are cut without a mark would be read as the ends of the interval."""
    panel, y = _Panel(100, 0, 200, 50, (0.2, 0.8), (0, 1)), np.array([10.0, 20.0, 30.0])
    some = pd.DataFrame({"b": [0.5, 0.7, 0.9], "low": [0.3, 0.1, 0.5], "high": [0.7, 0.9, 1.2]})
    drawn = _cut(panel, some, ("b", "low", "high"), y, "grey")
    assert 'd="M105.0 17.0l-4 3l4 3M295.0 17.0l4 3l-4 3"' in drawn  # the value of the third row is outside
    assert not _cut(panel, some[:1], ("b", "low", "high"), y[:1], "grey")
    picture = write_figures(compare(simulated(12)[0]), tmp_path)[0].read_text(encoding="utf-8")
    assert "open arrow: an interval that goes on" in picture


def test_the_terminal_shows_twelve_rows_of_a_response_and_says_the_rest():
    results, _ = simulated(120)
    results["grade"] = [f"grade {i % 9}" for i in range(120)]
    reported = words(compare(results, ["iso513", "grade"]))
    assert "14 more families in comparison.csv" in reported
    assert sum(line.count(" to ") == 3 for line in reported.splitlines()) == 12
    assert "P steel (iso513)" in reported
    assert "mean, 95 %" in reported


def test_a_law_that_must_not_be_used_does_not_move_its_family():
    results = pd.DataFrame({
        "tool": ["a", "b", "c", "d"], "work": "steel", "response": "AW", "form": "power", "reason": "", "df": 23,
        "params_V": [0.45, 0.55, 0.60, 9.0], "bse_V": 0.05,
        "verdict": ["usable inside the tested region"] * 3 + ["do not use for control"],
    })  # fmt: skip
    made = compare(results)
    assert made.families["pairs"].tolist() == [3]
    assert "d" not in set(made.pairs["tool"])


def test_pictures_are_replaced_all_or_none_and_former_ones_go_with_them(tmp_path, monkeypatch):
    made = compare(simulated(3)[0], ["iso513", "coolant"])
    first, second = write_figures(made, tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    calls = []

    def full(path, data):
        calls.append(path)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        synchronised(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(journal, "synchronised", full)
        with pytest.raises(UsageError, match="no space left on device"):
            write_figures(made, tmp_path, "simulated")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    (tmp_path / "exponents_P_V.svg").write_bytes(b"of a law that is gone")
    assert write_figures(made, tmp_path, "simulated", [first.name, "exponents_P_V.svg"]) == [first, second]
    assert {path.name for path in tmp_path.iterdir()} == {*before}
    assert first.read_bytes() != before[first.name]


def test_a_table_of_pairs_with_many_columns_is_read(tmp_path):
    names = ",".join(f"group {k}" for k in range(2000))
    (tmp_path / "pairs.csv").write_text(f"tool,{names}\nA{',x' * 2000}\n")
    assert read_pairs(tmp_path / "pairs.csv").shape == (1, 2002)
    (tmp_path / "pairs.csv").write_text(f"tool,group,{names},group\nA\n")
    with pytest.raises(DataError, match="2 columns named 'group'"):
        read_pairs(tmp_path / "pairs.csv")


def test_a_table_of_other_pairs_is_named(tmp_path):
    (tmp_path / "pairs.csv").write_text("tool,iso513\nOther,P\n")
    with pytest.raises(UsageError, match=r"pairs\.csv names Other"):
        with_groups([PairOutcome("Z", "x", 9)], read_pairs(tmp_path / "pairs.csv"))
