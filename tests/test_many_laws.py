"""Laws of many pairs in stacks are those of a loop of ``fit.power_law``, refusals and reasons among them.

References: the loop, on the bundled set, on NASA's milling set and on simulated pairs that are good, bad and ugly; and
statsmodels' OLS with its CRV3 covariance.
"""

import re

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import FitmodelsError, UsageError
from fitmodels.fit.available import NotAvailable
from fitmodels.fit.many.batched import many_power_laws
from fitmodels.fit.many.batched_sums import BLOCK, blocks_of, fitted
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.regression.linear_model import OLS

SAME = 1e-10  # relative: what is asked of a stack against the loop
FACTORS = ["V", "f", "d", "t"]
EXPONENTS = np.array([0.577, 0.168, 0.248, 0.245])
WHOLE = ("rsquared", "rsquared_adj", "fvalue", "f_pvalue", "scale_se")


def pair_rows(name, seed, edges=8, subtests=6, **fixed):
    """Rows of one simulated pair with scatter of edges and of rows; ``fixed`` puts columns in their place."""
    rng = np.random.default_rng([1, seed])
    settings = {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}
    data = {key: np.repeat(np.exp(rng.uniform(*np.log(ends), edges)), subtests) for key, ends in settings.items()}
    data["t"] = np.tile(2.0 * np.arange(1, subtests + 1), edges)
    level = np.repeat(rng.normal(0, 0.07, edges), subtests) + rng.normal(0, 0.07, edges * subtests)
    data |= {key: np.broadcast_to(value, edges * subtests) for key, value in fixed.items()}
    data["AW"] = fixed.get("AW", np.exp(np.log(np.column_stack([data[x] for x in FACTORS])) @ EXPONENTS - 4.9 + level))
    return pd.DataFrame({"tool": name, "edge": [f"E{g}" for g in np.repeat(np.arange(edges), subtests)], **data})


def with_values(frame, column, rows, value):
    out = frame.copy()
    out.loc[rows, column] = value
    return out


def loop(frame, response, factors, pair, edge="edge"):
    """The law, or the sentence that refuses it, of each pair."""
    for key, rows in frame.groupby(pair, sort=False):
        columns = list(dict.fromkeys([response, *factors, *([edge] if edge else [])]))
        try:
            runs = datasets.runs_from_frame(rows[columns].reset_index(drop=True), judge=False)
            yield key, fit.power_law(runs, response, factors, edge=edge)
        except FitmodelsError as error:
            yield key, str(error)


def of_theta(ends):
    """Ends of intervals with that of ln c0: c0 itself may be 1e10 or more, or less than any number but zero."""
    with np.errstate(divide="ignore"):
        return np.append(np.log(ends[0]), ends[1:])


def without_lines(text):
    return re.sub(r"\(lines [^)]*\)|row \d+", "", text)


def assert_as_the_loop(frame, response, factors, pair, edge="edge"):
    many = many_power_laws(frame, response, factors, pair=pair, edge=edge)
    table = many.table
    found = list(loop(frame, response, factors, pair, edge))
    assert len(found) == len(table) == len(many)
    for i, (key, law) in enumerate(found):
        row = table.iloc[i]
        assert tuple(row[: len(many.pairs.columns)]) == (key if isinstance(key, tuple) else (key,))
        if isinstance(law, str):
            assert without_lines(row["reason"]) == without_lines(law), key
            continue
        assert row["reason"] == "", key
        for part in ("params", "bse", "row_bse", "tvalues", "pvalues"):
            theirs = getattr(law, part).reindex(many.names)
            ours = row[[f"{part}_{name}" for name in many.names]].to_numpy(dtype=float)
            np.testing.assert_allclose(ours, theirs, rtol=SAME, err_msg=f"{key} {part}")
        ends, ours = law.conf_int(0.9).reindex(many.names), many.conf_int(0.9).iloc[i]
        for end in ends:
            got = ours[[f"{end}_{name}" for name in many.names]].to_numpy(dtype=float)
            np.testing.assert_allclose(of_theta(got), of_theta(ends[end].to_numpy()), rtol=SAME, atol=SAME)
        for name in WHOLE:
            theirs = getattr(law, name)
            np.testing.assert_allclose(
                row[name], np.nan if theirs is None else theirs, rtol=SAME, err_msg=f"{key} {name}"
            )
        assert (row["nobs"], row["n_edges"], row["df"]) == (law.nobs, law.n_edges or 0, law.df), key
        assert row["left_out"] == "; ".join(f"{item.factor} {item.reason}" for item in law.left_out)
        assert row["edge_reason"] == getattr(law.edges, "reason", ""), key
        assert row["dropped"] == sum(item.count for item in law.dropped)
    return many


@pytest.mark.parametrize("edge", ["edge", None])
@pytest.mark.parametrize(("response", "factors"), [("AW", FACTORS), ("P", [*FACTORS, "AW"]), ("Fxz", [*FACTORS, "AW"])])
def test_the_bundled_set_split_into_pairs(response, factors, edge):
    frame = datasets.read_runs(datasets.bundled("gc435_709m40")).to_frame()
    number = pd.factorize(frame["edge"])[0]
    frame = frame.assign(part=number % 3, lot=np.array(["x", "y"])[(number == 0).astype(int)])
    many = assert_as_the_loop(frame, response, factors, ["part", "lot"], edge)
    assert len(many) == 4
    assert len(many.reasons) == 0


@pytest.mark.parametrize("pair", ["material", "case"])
def test_nasa_milling(measurements, pair):
    """Both materials, and each of the 16 cases, in which the time alone changes; 30 rows have no wear above zero."""
    frame = pd.read_csv(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    names = {"time": "t", "feed": "f", "DOC": "d", "VB": "AW"}
    frame = frame.rename(columns=names).assign(edge=frame["case"])
    many = assert_as_the_loop(frame, "AW", ["t", "f", "d"], pair)
    assert many.table["dropped"].sum() == 30
    if pair == "material":
        assert many.table["by_edge"].all()


def ugly_pairs():
    """Pairs of every kind that a law refuses, or takes only in part."""
    copies = pair_rows("copies", 1)
    row = pair_rows("of one", 2)
    exact = pair_rows("exact", 3)
    log = np.log(exact[FACTORS].to_numpy())
    alone = pair_rows("edge alone", 4).assign(d=lambda frame: np.where(frame["edge"] == "E3", 3.0, 2.0))
    own = pair_rows("each row an edge", 5, edges=30, subtests=1)
    own["t"] = np.random.default_rng(2).uniform(1, 9, 30)
    yield pair_rows("good", 6)
    yield pair_rows("long", 7, edges=30)
    yield pair_rows("nearly as long", 8, edges=28)
    yield pair_rows("d constant", 9, d=2.5)
    yield pair_rows("V and d constant", 10, d=2.5, V=100.0)
    yield pair_rows("all constant", 11, V=80.0, f=0.2, d=2.0, t=4.0)
    yield pair_rows("d nearly constant", 12).assign(d=lambda frame: 2.5 + 1e-10 * frame["V"])
    yield pair_rows("d from V and f", 13).assign(d=lambda frame: 2 * frame["V"] ** 0.3 * frame["f"] ** -0.2)
    yield pair_rows("d nearly V", 14).assign(d=lambda frame: np.round(frame["V"] ** 0.3, 4))
    yield pair_rows("too few rows", 15).iloc[[0, 7, 14]]
    yield pair_rows("as many rows as parameters", 16, edges=5, subtests=1, t=np.array([1.0, 2, 5, 3, 9]))
    yield pair_rows("one row more", 17, edges=6, subtests=1, t=np.array([1.0, 2, 5, 3, 9, 4]))
    yield pair_rows("one row", 18).iloc[:1]
    yield pair_rows("wear constant", 19, AW=0.2)
    yield with_values(pair_rows("some missing", 20), "AW", slice(3, 9), np.nan)
    yield with_values(pair_rows("some zero", 21), "V", slice(0, 5), 0.0)
    yield with_values(pair_rows("some negative", 22), "AW", slice(40, 47), -0.1)
    yield with_values(pair_rows("all missing", 23), "AW", slice(None), np.nan)
    yield with_values(pair_rows("infinite", 24), "AW", 7, np.inf)
    yield pd.concat([copies, copies, copies])
    yield pd.concat([row, row.iloc[:1]])
    yield exact.assign(AW=np.exp(log @ EXPONENTS - 4.9))
    yield exact.assign(tool="nearly exact", AW=np.exp(log @ EXPONENTS - 4.9 + 1e-9 * np.sin(np.arange(len(log)))))
    yield alone
    yield own
    yield pair_rows("one edge", 25, edges=1)
    yield pair_rows("three edges", 26, edges=3)
    yield pair_rows("four edges", 27, edges=4)
    yield pair_rows("five edges", 28, edges=5)
    yield pair_rows("six edges, t constant", 29, edges=6, t=2.0)
    yield pair_rows("runaway", 30).assign(V=lambda frame: 1e4 + 1e-3 * np.arange(len(frame)))
    yield with_values(pair_rows("edges not named", 31), "edge", slice(0, 12), "")


def test_good_bad_and_ugly_pairs_are_as_in_the_loop():
    frame = pd.concat(ugly_pairs(), ignore_index=True)
    many = assert_as_the_loop(frame, "AW", FACTORS, "tool")
    refused = {"all constant", "too few rows", "one row", "wear constant", "all missing", "infinite"}
    assert refused <= set(many.reasons.index)
    assert 0 < many.one_by_one < 24
    stacked = {"good", "long", "d constant", "V and d constant", "some missing", "each row an edge", "four edges"}
    assert set(many.pairs["tool"][many.estimates.stacked]) >= stacked


def test_two_factors_that_follow_from_a_third_are_left_out_as_in_the_loop():
    frame = pair_rows("f and d from V", 31).assign(
        f=lambda frame: frame["V"] ** -0.5, d=lambda frame: frame["V"] ** 0.2
    )
    assert assert_as_the_loop(frame, "AW", FACTORS, "tool").one_by_one == 1


def test_rows_in_any_order_give_the_same_pairs():
    frame = pd.concat(ugly_pairs(), ignore_index=True)
    shuffled = frame.sample(frac=1, random_state=3).reset_index(drop=True)
    assert_as_the_loop(shuffled, "AW", FACTORS, "tool")


@settings(max_examples=25, deadline=None)
@given(
    shapes=st.lists(st.tuples(st.integers(1, 9), st.integers(1, 7)), min_size=1, max_size=6),
    missing=st.floats(0, 0.5),
    seed=st.integers(0, 99),
)
def test_pairs_of_any_shape_are_as_in_the_loop(shapes, missing, seed):
    rng = np.random.default_rng(seed)
    parts = [pair_rows(f"T{i}", seed + i, *shape) for i, shape in enumerate(shapes)]
    frame = pd.concat(parts, ignore_index=True)
    frame.loc[rng.random(len(frame)) < missing, "AW"] = np.nan
    assert_as_the_loop(frame, "AW", FACTORS, "tool")


def test_statsmodels_gives_the_same():
    frame = pd.concat([pair_rows(f"T{i}", i, edges=12 + i) for i in range(4)], ignore_index=True)
    table = many_power_laws(frame, "AW", FACTORS, pair="tool", edge="edge").table
    for i, (_, rows) in enumerate(frame.groupby("tool", sort=False)):
        Z = np.column_stack([np.ones(len(rows)), np.log(rows[FACTORS])])
        plain = OLS(np.log(rows["AW"].to_numpy()), Z).fit()
        groups = pd.factorize(rows["edge"])[0]
        by_edge = plain.get_robustcov_results("cluster-crv3", groups=groups, use_t=True)
        for name, j in zip(FACTORS, range(1, 5), strict=True):
            ours = table.iloc[i][[f"{part}_{name}" for part in ("params", "row_bse", "bse", "tvalues", "pvalues")]]
            theirs = [plain.params[j], plain.bse[j], by_edge.bse[j], by_edge.tvalues[j], by_edge.pvalues[j]]
            np.testing.assert_allclose(ours.to_numpy(dtype=float), theirs, rtol=1e-6)
        whole = (plain.rsquared, plain.rsquared_adj, plain.fvalue, plain.f_pvalue, np.sqrt(plain.scale))
        np.testing.assert_allclose(table.iloc[i][list(WHOLE)].to_numpy(dtype=float), whole, rtol=1e-9)


def test_edges_of_like_name_in_two_pairs_are_two_edges_and_numbers_are_names():
    frame = pd.concat([pair_rows("A", 1), pair_rows("B", 2)], ignore_index=True)
    numbered = frame.assign(edge=frame["edge"].str[1:].astype(float))
    one, other = (many_power_laws(f, "AW", FACTORS, pair="tool", edge="edge").table for f in (frame, numbered))
    assert one["n_edges"].tolist() == [8, 8]
    pd.testing.assert_frame_equal(one, other)


def test_pairs_that_no_name_is_given_are_a_pair_of_their_own():
    frame = with_values(
        pd.concat([pair_rows("A", 1), pair_rows("B", 2)], ignore_index=True), "tool", slice(48, None), None
    )
    assert many_power_laws(frame, "AW", FACTORS, pair="tool").pairs["tool"].tolist() == ["A", "unnamed-tool"]


def test_a_mapping_of_arrays_will_do_and_is_left_as_it_was():
    frame = pair_rows("A", 1)
    columns = {name: frame[name].to_numpy() for name in frame}
    before = {name: values.copy() for name, values in columns.items()}
    many = many_power_laws(columns, "AW", FACTORS, pair="tool", edge="edge")
    pd.testing.assert_frame_equal(many.table, many_power_laws(frame, "AW", FACTORS, pair="tool", edge="edge").table)
    assert all((before[name] == columns[name]).all() for name in columns)


def test_no_rows_are_no_pairs():
    assert len(many_power_laws(pair_rows("A", 1).iloc[:0], "AW", FACTORS, pair="tool", edge="edge").table) == 0


def test_it_has_a_display_and_a_figure():
    many = many_power_laws(pd.concat(ugly_pairs(), ignore_index=True), "AW", FACTORS, pair="tool", edge="edge")
    assert "pairs" in repr(many)
    assert "fitted singly" in many.summary()
    assert many.plot(factor="t").get_ylabel() == "exponent of t in AW"
    with pytest.raises(UsageError, match="the laws are on V, f, d, t"):
        many.plot(factor="W")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"response": "Ra"}, "no column 'Ra'"),
        ({"factors": []}, "one or more names"),
        ({"factors": "Vf"}, "one or more names"),
        ({"factors": ["V", "AW"]}, "cannot be its own factor"),
        ({"factors": ["edge"]}, "holds text"),
        ({"pair": "work"}, "no column 'work'"),
        ({"pair": []}, "name the column"),
        ({"pair": "V"}, "names the pair"),
        ({"edge": "flute"}, "no column 'flute'"),
    ],
)
def test_what_cannot_be_asked_is_said_before_the_fit(asked, said):
    usual = {"response": "AW", "factors": FACTORS, "pair": "tool", "edge": "edge"} | asked
    response, factors = usual.pop("response"), usual.pop("factors")
    with pytest.raises(UsageError, match=said):
        many_power_laws(pair_rows("A", 1), response, factors, **usual)


def test_every_pair_is_in_one_block():
    counts = np.random.default_rng(1).integers(1, 40_000, 300)
    blocks = list(blocks_of(counts))
    assert np.concatenate([np.arange(300)[block] for block in blocks]).tolist() == list(range(300))
    assert all(counts[block].sum() <= BLOCK or block.stop - block.start == 1 for block in blocks)


def test_the_other_pairs_leave_no_trace():
    frame = pd.concat([pair_rows(name, seed) for seed, name in enumerate("ABCDEFGH")])
    together = many_power_laws(frame, "AW", FACTORS, pair="tool", edge="edge").estimates
    for i, (_, rows) in enumerate(frame.groupby("tool")):
        alone = many_power_laws(rows, "AW", FACTORS, pair="tool", edge="edge").estimates
        for name in ("theta", "se", "row_se", "rss", "tss"):
            np.testing.assert_array_equal(getattr(together, name)[i], getattr(alone, name)[0], err_msg=name)


def test_an_edge_that_alone_holds_a_parameter_is_not_safe():
    """Of two edges the second alone has another x: nothing is left to tell the slope without it."""
    x, y = np.array([0.0, 0, 0, 1, 1]), np.array([0.1, -0.1, 0.05, 1, 1.2])
    assert not fitted(np.stack([x, y]), np.array([0, 3]), np.array([0])).safe[0]


def test_each_law_is_that_of_its_rows():
    rng = np.random.default_rng(4)
    pair, V = np.repeat(["A", "B", "C"], [30, 40, 1]), np.exp(rng.normal(4, 0.4, 71))
    rows = pd.DataFrame({"tool": pair, "V": V, "AW": 0.01 * V**0.5 * np.exp(0.1 * rng.normal(size=71))})
    laws = many_power_laws(rows, "AW", ["V"], pair="tool")
    one = laws[1]
    assert (one.nobs, one.source.tool, len(laws)) == (40, "B", 3)
    np.testing.assert_allclose(one.params, laws.params.loc["B"], rtol=1e-10)
    np.testing.assert_allclose(one.bse, laws.bse.loc["B"], rtol=1e-9)
    assert not laws[-1]
    assert str(laws[2]) == laws.reasons["C"]
    assert [bool(law) for law in laws if isinstance(law, NotAvailable)] == [False]
    with pytest.raises(IndexError):
        laws[3]
