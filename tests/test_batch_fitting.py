"""A block of pairs: its table is what a loop over the pairs gives, its files what the single command gives."""

import json
import pickle
import sys
from dataclasses import dataclass, fields, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.batch import records
from fitmodels.batch.fitting import block as block_module
from fitmodels.batch.fitting import pair_laws as laws_module
from fitmodels.batch.fitting.block import fit_block, spoiled_pairs
from fitmodels.batch.fitting.concerns import concerns_of_laws
from fitmodels.batch.law_rows import law_table
from fitmodels.batch.outcomes import BlockOutcome, PairOutcome, cell
from fitmodels.batch.plan import BatchOptions, Block, Pair, Piece, Plan, Reading
from fitmodels.batch.rows import PairRows, PairSource
from fitmodels.cards.folder import markdown
from fitmodels.cli import main
from fitmodels.core import errors
from fitmodels.datasets.doubts import Doubt
from fitmodels.datasets.runs import Source
from fitmodels.fit.defaults import asked_laws, fit_asked
from fitmodels.pipeline import FitOptions
from fitmodels.pipeline.pair import fit_pair
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

SAME = 1e-9  # stacks and a loop of fits, as the tests of many_power_laws hold them
STREAM = 1e-10  # sums of a stream and rows in memory
TABLE = BatchOptions(files=False)
FAST = BatchOptions(draws=1000)
PARTS = ("params", "bse", "row_bse", "tvalues", "pvalues")
UNITS = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm", "P": "kW", "VB": "mm", "I": "A"}
WEAR = datasets.SimulatedLaw("AW", "mm", 0.009, {"V": 0.52, "f": 0.15, "d": 0.3, "t": 0.25}, 0.08, 0.07)
POWER = datasets.SimulatedLaw("P", "kW", 0.01, {"V": 0.9, "f": 0.7, "d": 0.8, "AW": 0.1}, 0.03, 0.03)
PLAN = datasets.central_composite({"V": (72, 117), "f": (0.1, 0.3), "d": (1.5, 3)}, seed=1)


def simulated(tool, seed, plan=PLAN, laws=(WEAR, POWER)):
    frame = datasets.simulate(plan, list(laws), seed=seed)
    return frame.assign(tool=tool, work="En 19", edge=frame["edge"].astype(object))


def rows_of(*frames, reading=None, **more):
    frame = pd.concat(frames, ignore_index=True)
    frame[["tool", "work"]] = frame[["tool", "work"]].astype(object)
    return PairRows(
        frame, np.arange(2, 2 + len(frame)), UNITS, (), Source("shop.parquet", "", len(frame), "Parquet"), **more
    )


@dataclass(frozen=True)
class OutcomeWithLaws(PairOutcome):
    """An outcome with the laws of its pair, each as a mapping of what it has."""

    laws: tuple = ()


def with_laws(block):
    cells = [{name: cell(value) for name, value in row.items()} for row in block.laws.to_dict("records")]
    rows = [{name: value for name, value in row.items() if value is not None} for row in cells]
    pairs = [
        OutcomeWithLaws(
            *(getattr(pair, field.name) for field in fields(pair)), tuple(r for r in rows if r["pair"] == i)
        )
        for i, pair in enumerate(block.pairs)
    ]
    return replace(block, pairs=tuple(pairs))


@pytest.fixture
def fitted(monkeypatch):
    """Fit rows as a block; what the source hands over is given."""

    def call(*tables, how=TABLE, reading=None, unreadable=None, **parts):
        pairs = {
            Pair(*key): None for rows in tables for key in zip(rows.frame["tool"], rows.frame["work"], strict=True)
        }
        block = Block(**{"pairs": tuple(pairs), "pieces": (), "rows": sum(len(r.frame) for r in tables)} | parts)
        plan = Plan("shop", "parquet", (block,), block.rows, (), {}, (), reading or Reading())
        source = SimpleNamespace(rows_of=lambda block, plan: (list(tables), dict(unreadable or {})))
        monkeypatch.setitem(sys.modules, "fitmodels.batch.source", source)
        return with_laws(fit_block(block, plan, how))

    return call


def test_a_pair_of_a_stream_in_another_unit_is_doubted(fitted):
    plain, wrong = simulated("A", 1), simulated("B", 2)
    wrong = wrong.assign(AW=1000 * wrong["AW"])
    wrong.loc[wrong.index[0], "AW"] = 0.0  # a new edge
    found = fitted(rows_of(plain, wrong)).pairs
    doubts = [[c.words for c in pair.concerns if c.kind == "doubt in reading"] for pair in found]
    assert doubts[0] == []
    (words,) = doubts[1]
    assert words.startswith("AW ")
    assert words.endswith("mm is unusual throughout this pair (usual 0.02 to 0.6 mm).")


def test_doubts_of_a_laboratory_file_are_concerns_and_in_its_parameter_file(fitted):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    doubt = Doubt(("AW",), "AW is doubted", "--unit AW=um")
    data = runs.data.assign(tool=runs.tool, work=runs.work)
    of_pair = {Pair(runs.tool, runs.work): PairSource.of(replace(runs, doubts=(doubt,)))}
    rows = PairRows(data, runs.lines, runs.units, runs.columns, runs.source, of_pair=of_pair)
    (outcome,) = fitted(rows, how=FAST).pairs
    assert "AW is doubted: --unit AW=um" in [c.words for c in outcome.concerns if c.kind == "doubt in reading"]
    pf = parameters.ParameterFile.model_validate_json(outcome.files["params.json"])
    assert [one.sentence for one in pf.reading.doubts] == ["AW is doubted"]
    two = replace(rows, of_pair={**of_pair, Pair("H13A", "C45"): next(iter(of_pair.values()))})
    ((_, words),) = two.remarks([Pair(runs.tool, runs.work)])
    assert words[0] == "data.csv, a file of several pairs: AW is doubted: --unit AW=um"
    (streamed,) = fitted(replace(rows, of_pair={}), how=FAST).pairs
    assert parameters.ParameterFile.model_validate_json(streamed.files["params.json"]).reading is None


def row(outcome, response):
    return next(row for row in outcome.laws if row["response"] == response)


def held_to(row, law, tolerance=SAME):
    """A row of the table says what a fit says."""
    assert row["reason"] == ""
    whole = ("nobs", "df", "df_resid", "rsquared", "rsquared_adj", "fvalue", "f_pvalue", "scale_se")
    for name in whole:
        assert row.get(name) == pytest.approx(getattr(law, name), rel=tolerance), name
    assert row.get("n_edges") == law.n_edges
    for name in law.names:
        for part in PARTS:
            assert row[f"{part}_{name}"] == pytest.approx(getattr(law, part)[name], rel=tolerance, abs=1e-300), part
        ends = law.conf_int(0.95).loc[name]
        assert (row[f"low_{name}"], row[f"high_{name}"]) == pytest.approx(tuple(ends), rel=tolerance)


def test_the_table_of_a_block_is_what_a_loop_over_its_pairs_gives(fitted):
    rows = rows_of(*(simulated(f"T{i}", seed=i) for i in range(5)))
    found = fitted(rows)
    assert [pair.tool for pair in found.pairs] == [f"T{i}" for i in range(5)]
    for outcome, (pair, runs) in zip(found.pairs, rows.runs(), strict=True):
        laws, _ = fit.default_laws(runs)
        assert (outcome.tool, outcome.nobs, outcome.reason, outcome.files) == (pair.tool, len(runs), "", {})
        assert [r["response"] for r in outcome.laws] == [law.response for law in laws] == ["AW", "P"]
        for law in laws:
            held_to(row(outcome, law.response), law)
        assert row(outcome, "AW")["unit"] == "mm"
    assert found.units == UNITS
    assert found.memory > 0


def test_each_pair_gets_the_laws_of_the_columns_that_hold_something_of_it(fitted):
    alone, other = simulated("A", 1, laws=(WEAR,)), simulated("B", 2).rename(columns={"AW": "VB"}).drop(columns="d")
    found = {p.tool: p for p in fitted(rows_of(alone, other)).pairs}
    assert [r["response"] for r in found["A"].laws] == ["AW"]
    assert [r["response"] for r in found["B"].laws] == ["VB", "P"]
    lonely = next(runs for pair, runs in rows_of(other).runs())
    held_to(row(found["B"], "P"), fit.power_law(lonely, "P", ["V", "f", "t", "VB"]))
    assert "params_d" not in row(found["B"], "P")


def test_a_pair_without_a_column_of_edges_is_fitted_by_rows(fitted):
    with_edges, without = simulated("A", 1), simulated("B", 2).drop(columns="edge")
    found = {p.tool: p for p in fitted(rows_of(with_edges, without)).pairs}
    assert row(found["A"], "AW")["by_edge"]
    assert not row(found["B"], "AW")["by_edge"]
    assert [c.kind for c in found["B"].concerns] == ["no errors by edge"]
    assert found["B"].concerns[0].words.startswith("AW, P: no edge column")


CASES = {
    "too few rows": (lambda f: f.iloc[[0, 15, 40]], "3 usable rows for 5 parameters"),
    "an infinite value": (lambda f: f.assign(AW=f["AW"].where(f.index != 4, np.inf)), "inf is no measurement"),
    "wear that is not above zero": (lambda f: f.assign(AW=-f["AW"]), "zero or negative"),
    "wear that never changes": (lambda f: f.assign(AW=0.2), "is 0.2 in all"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_pair_that_fails_has_its_reason_and_leaves_the_others(fitted, case):
    mend, words = CASES[case]
    bad = mend(simulated("bad", 3, laws=(WEAR,)))
    found = fitted(rows_of(simulated("A", 1), bad, simulated("B", 2)), how=replace(FAST, files=True))
    alone = fitted(rows_of(simulated("A", 1), simulated("B", 2)), how=replace(FAST, files=True))
    a, ugly, b = found.pairs
    assert words in ugly.reason
    assert words in row(ugly, "AW")["reason"]
    assert "params_V" not in row(ugly, "AW")
    assert not ugly.files
    assert ugly.concerns[0].kind == "no law"
    there = [[{**law, "pair": None} for law in p.laws] for p in (a, b, *alone.pairs)]
    assert there[:2] == there[2:]
    assert (a.files, b.files) == tuple(p.files for p in alone.pairs)


def test_an_infinite_value_is_reported_by_its_line(fitted):
    frame = simulated("B", 3)
    frame.loc[4, "P"] = np.inf
    outcome = fitted(rows_of(simulated("A", 1), frame)).pairs[1]
    line = 2 + len(simulated("A", 1)) + 4
    assert row(outcome, "P")["reason"] == f"column 'P' line {line}: inf is no measurement; leave the row out."
    assert row(outcome, "AW")["reason"] == ""
    assert [c.kind for c in outcome.concerns] == ["law refused"]
    without = fitted(replace(rows_of(simulated("A", 1), frame), lines=None)).pairs[1]
    assert row(without, "P")["reason"].startswith("column 'P' row 5 of this pair: inf is no measurement")


def test_of_many_infinite_values_of_a_pair_one_is_looked_up(fitted, monkeypatch):
    """Where a row stands takes a look at all before it: for each of them the time would be that of rows squared."""
    looked_up, real = [], laws_module._where
    monkeypatch.setattr(laws_module, "_where", lambda of, row: looked_up.append(row) or real(of, row))
    bad = simulated("B", 3, laws=(WEAR,)).assign(AW=np.inf)
    found = fitted(replace(rows_of(simulated("A", 1, laws=(WEAR,)), bad), lines=None))
    assert row(found.pairs[1], "AW")["reason"].startswith("column 'AW' row 1 of this pair")
    assert len(looked_up) == 1


def test_load_and_roughness_laws_stand_in_the_same_table(fitted):
    bundles = [datasets.read_runs(datasets.bundled(name)) for name in ("clm2023_end_milling", "surf_table1")]
    tables = [PairRows(r.data.assign(tool=r.tool, work=r.work), r.lines, r.units, r.columns, r.source) for r in bundles]
    milling, turning = fitted(*tables).pairs
    for outcome, runs in zip((milling, turning), bundles, strict=True):
        laws, refused = fit.default_laws(runs)
        assert [r["response"] for r in outcome.laws if not r["reason"]] == [law.response for law in laws]
        assert sorted(r["response"] for r in outcome.laws if r["reason"]) == sorted(x.response for x in refused)
        for law in laws:
            if law.form != "power":
                held_to(row(outcome, law.response), law)
                assert row(outcome, law.response)["form"] == law.form
    assert row(milling, "fm")["form"] == "feed_line"
    assert row(turning, "Ra")["params_b"] == pytest.approx(fit.exponential_law(bundles[1]).params["b"])


def test_additive_errors_go_pair_by_pair(fitted):
    rows = rows_of(simulated("A", 1), simulated("B", 2))
    found = fitted(rows, how=replace(TABLE, error="additive"))
    for outcome, (_, runs) in zip(found.pairs, rows.runs(), strict=True):
        held_to(row(outcome, "AW"), fit.power_law(runs, "AW", ["V", "f", "d", "t"], error="additive"))


def test_files_of_a_block_are_those_of_the_single_command(fitted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = datasets.bundled("gc435_709m40")
    assert main([str(source), "--out", "single", "--criterion", "0.25", "--draws", "1200"]) == 0
    (path,) = (tmp_path / "single").rglob("params.json")
    runs = datasets.read_runs(source)
    data = runs.data.assign(tool=runs.tool, work=runs.work)
    of_pair = {Pair(runs.tool, runs.work): PairSource.of(runs)}
    rows = PairRows(data, runs.lines, runs.units, runs.columns, runs.source, of_pair=of_pair)
    how = BatchOptions(draws=1200, criterion=0.25, keep_draws=True, command=parameters.read(path).provenance.command)
    (outcome,) = fitted(rows, how=how).pairs
    (tmp_path / "params.json").write_bytes(outcome.files["params.json"])
    (tmp_path / "draws.npz").write_bytes(outcome.files["draws.npz"])
    assert outcome.files["draws.npz"] == (path.parent / "draws.npz").read_bytes()
    assert parameters.read(tmp_path / "params.json") == parameters.read(path)
    assert outcome.files["params.json"] == path.read_bytes()


def test_a_file_whose_draws_are_not_kept_passes_its_check_and_makes_its_card(fitted, tmp_path):
    from fitmodels import cards

    found = fitted(rows_of(simulated("A", 1)), how=FAST).pairs[0]
    assert set(found.files) == {"params.json"}
    (tmp_path / "params.json").write_bytes(found.files["params.json"])
    pf = parameters.read(tmp_path / "params.json")
    assert pf.posterior.laws["AW"].draws == 1000
    assert (pf.posterior.draws_file, pf.posterior.draws_sha256) == (None, None)
    assert parameters.check(pf, tmp_path).ok
    assert "draws" not in [f.name for f in parameters.check(pf, tmp_path).findings]
    assert parameters.read_draws(pf, tmp_path) == {}
    assert "draws.npz" not in cards.files(pf)
    assert markdown(pf)


def test_the_posterior_of_a_file_stands_in_its_row(fitted):
    rows = rows_of(simulated("A", 1))
    (outcome,) = fitted(rows, how=FAST).pairs
    (_, runs), *_ = rows.runs()
    post = fit.posterior(fit.power_law(runs, "AW", ["V", "f", "d", "t"]), seed=1, draws=1000).table()
    reported = row(outcome, "AW")
    assert reported["posterior_V"] == pytest.approx(post.loc["V", "mean"], rel=SAME)
    assert reported["posterior_sd_t"] == pytest.approx(post.loc["t", "sd"], rel=SAME)
    assert reported["no_posterior"] == ""


def test_priors_of_a_file_stand_whole_in_the_options(fitted):
    priors = {"AW": {"V": {"distribution": "normal", "mean": 0.5, "sd": 0.1}}}
    (outcome,) = fitted(rows_of(simulated("A", 1)), how=replace(FAST, priors=priors)).pairs
    assert json.loads(outcome.files["params.json"])["provenance"]["options"]["priors"] == priors


def test_why_there_is_no_posterior_stands_in_its_row(fitted):
    exact = simulated("A", 1, laws=(datasets.SimulatedLaw("AW", "mm", 0.01, {"V": 0.5, "t": 0.3}, 0, 0, digits=15),))
    (outcome,) = fitted(rows_of(exact), how=FAST).pairs
    assert "fits every row exactly" in row(outcome, "AW")["no_posterior"]
    assert "params.json" in outcome.files


def test_behind_a_shut_gate_there_is_no_file_and_the_row_stays(fitted, monkeypatch):
    checks = SimpleNamespace(passed=False, reasons=("R-hat 1.2, above 1.01.",))
    shut = SimpleNamespace(response="AW", convergence=checks)
    monkeypatch.setattr(fit, "posterior", lambda law, **how: shut)
    (outcome,) = fitted(rows_of(simulated("A", 1)), how=FAST).pairs
    assert not outcome.files
    assert row(outcome, "AW")["params_V"] is not None
    assert row(outcome, "AW")["no_posterior"] == "R-hat 1.2, above 1.01."
    assert "draws of AW did not converge" in row(outcome, "P")["no_posterior"]
    assert [(c.kind, "convergence checks" in c.words) for c in outcome.concerns] == [("not converged", True)]


def test_a_criterion_without_a_wear_law_costs_the_tool_life_alone(fitted):
    frame = simulated("A", 1).drop(columns="AW")
    (outcome,) = fitted(rows_of(frame), how=replace(FAST, criterion=0.2)).pairs
    assert "params.json" in outcome.files
    assert "no tool life" in [c.kind for c in outcome.concerns]
    (_, runs), *_ = rows_of(frame).runs()
    with pytest.raises(errors.FitError, match="no wear law on time"):
        fit_pair(runs, FitOptions(criterion=0.2))


def test_groups_go_into_the_outcome_and_the_identity(fitted):
    frame = simulated("A", 1)
    frame["ISO513"], frame["machine"] = "p20", ["", *["lathe 3"] * (len(frame) - 1)]
    frame["coolant"] = ["dry", *["wet"] * (len(frame) - 1)]
    other = simulated("B", 3).assign(ISO513="steel", machine=None, coolant=1.0)
    reading = Reading(groups=("ISO513", "machine", "coolant"))
    a, b = fitted(rows_of(frame, other), how=FAST, reading=reading).pairs
    assert a.groups == {"ISO513": "p20", "machine": "lathe 3", "coolant": "dry"}
    assert b.groups == {"ISO513": "steel", "machine": "", "coolant": "1"}
    identity = json.loads(a.files["params.json"])["identity"]
    assert (identity["iso513"], identity["machine"]) == ("P20", "lathe 3")
    assert json.loads(b.files["params.json"])["identity"]["iso513"] is None
    assert [c.kind for c in a.concerns if c.kind not in ("verdict", "draws too certain")] == [
        "group differs within the pair"
    ]
    assert [c.kind for c in b.concerns if c.kind not in ("verdict", "draws too certain")] == ["no group of ISO 513"]


def test_a_defect_in_the_file_of_one_pair_leaves_the_others(fitted, monkeypatch):
    real = fit.default_laws

    def broken(runs, **how):
        if runs.tool == "B":
            raise TypeError("unexpected\nthing")
        return real(runs, **how)

    monkeypatch.setattr(fit, "default_laws", broken)
    a, b, c = fitted(*[rows_of(*(simulated(x, i) for i, x in zip((0, 1, 3), "ABC", strict=True)))], how=FAST).pairs
    assert a.files
    assert c.files
    assert not b.files
    assert "params_V" in row(b, "AW")
    assert [(k.kind, k.words) for k in b.concerns] == [
        ("no parameter file", "internal error of fitmodels, not of the data: TypeError: unexpected thing.")
    ]


def test_a_defect_in_a_stack_is_the_reason_of_the_pair_at_fault_alone(fitted, monkeypatch):
    real = fit.many_power_laws

    def broken(table, response, factors, **how):
        if response == "AW" and (table["V"] > 1e6).any():
            raise ZeroDivisionError("at speed")
        return real(table, response, factors, **how)

    monkeypatch.setattr(fit, "many_power_laws", broken)
    fast = simulated("B", 2)
    a, b, c = fitted(rows_of(simulated("A", 1), fast.assign(V=fast["V"] * 1e6), simulated("C", 3))).pairs
    assert "ZeroDivisionError" in row(b, "AW")["reason"]
    assert row(b, "P")["reason"] == row(a, "AW")["reason"] == row(c, "AW")["reason"] == ""


def test_a_defect_while_reading_is_the_reason_of_every_pair(fitted, monkeypatch):
    monkeypatch.setattr(block_module, "numbered_rows", lambda *given: 1 / 0)
    found = fitted(rows_of(simulated("A", 1), simulated("B", 2)))
    assert ["ZeroDivisionError" in p.reason for p in found.pairs] == [True, True]


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_an_interrupt_and_a_lack_of_memory_go_through(fitted, monkeypatch, error):
    def stop(*given, **how):
        raise error

    monkeypatch.setattr(laws_module, "requested_laws", stop)
    with pytest.raises(error):
        fitted(rows_of(simulated("A", 1)))


def milled(tool, seed, teeth=(4,), speeds=(60.0, 90, 130), lives=False):
    """Milling of edges at speeds and feeds, with teeth that vary or not; roughness and torque, or lives."""
    rng = np.random.default_rng(seed)
    levels = [(V, fz, z) for V in speeds for fz in (0.05, 0.1, 0.2) for z in teeth for _ in (0, 1)]
    frame = pd.DataFrame(levels, columns=["V", "fz", "z"]).astype(float)
    frame = frame.assign(f=frame["fz"] * frame["z"], tool=tool, work="En 19")
    noise = np.exp(rng.normal(0, 0.05, (2, len(frame))))
    if lives:
        return frame.assign(T=1e5 * frame["V"] ** -2 * noise[0])
    return frame.assign(Ra=3 * frame["fz"] ** 0.8 * noise[0], M=9 * frame["fz"] ** 0.7 * frame["z"] * noise[1])


def test_what_varies_in_a_pair_decides_on_the_factors_of_its_laws(fitted):
    """Each pair has the laws of its own file: z where it varies, f or fz, T by maximum likelihood."""
    rows = rows_of(milled("A", 1), milled("B", 2, teeth=(2, 3, 4)), milled("C", 3, speeds=(90.0,)),
                   milled("D", 4, lives=True))  # fmt: skip
    factors = {}
    for outcome, (pair, runs) in zip(fitted(rows).pairs, rows.runs(), strict=True):
        laws, refused = fit.default_laws(laws_module.without_empty_columns(runs))
        assert [r["response"] for r in outcome.laws] == [law.response for law in laws]
        assert refused == ()
        for law in laws:
            held_to(row(outcome, law.response), law)
        factors[pair.tool] = {law.response: law.factors for law in laws}
    assert factors == {
        "A": {"M": ("V", "f"), "Ra": ("V", "f")},
        "B": {"M": ("V", "fz", "z"), "Ra": ("V", "fz", "z")},
        "C": {"M": ("f",), "Ra": ("f",)},
        "D": {"T": ("V", "f")},
    }


def test_laws_asked_for_are_those_of_every_pair(fitted):
    how = replace(TABLE, laws=("Ra ~ fz", "M ~ - V", "Fc ~ V, f"))
    (outcome,) = fitted(rows_of(milled("A", 1)), how=how).pairs
    found = {law["response"]: law for law in outcome.laws}
    assert found["M"]["params_f"] == pytest.approx(0.7, abs=0.1)
    assert "params_V" not in found["M"]
    assert found["Ra"]["params_fz"] == pytest.approx(0.8, abs=0.1)
    assert found["Fc"]["reason"] == "law 'Fc ~ V, f': there is no column 'Fc'."


def pieces(*names):
    return tuple(Piece(f"/data/{name}", name, "0") for name in names)


def test_half_of_a_pairs_rows_is_another_pair(fitted):
    rows, why = rows_of(simulated("A", 1), simulated("B", 2)), "b.csv: cannot be read: not UTF-8."
    of_pair = ((0,), (0, 1), (1,))
    pairs = (Pair("A", "En 19"), Pair("B", "En 19"), Pair("C", "En 19"))
    known = fitted(rows, unreadable={"b.csv": why}, pairs=pairs, pieces=pieces("a.csv", "b.csv"), of_pair=of_pair)
    assert [p.reason for p in known.pairs] == ["", why, why]
    assert [len(p.laws) for p in known.pairs] == [2, 0, 0]
    assert known.unreadable == {"b.csv": why}
    blind = fitted(rows, unreadable={"b.csv": why}, pairs=pairs, pieces=pieces("a.csv", "b.csv"))
    assert [p.reason for p in blind.pairs] == [why] * 3
    assert spoiled_pairs(Block(pairs, (), 1), {}) == {}


def test_a_pair_that_went_meanwhile_says_so_and_others_rows_are_passed_by(fitted):
    found = fitted(rows_of(simulated("A", 1), simulated("B", 2)), pairs=(Pair("Z", "W"), Pair("B", "En 19")))
    assert [p.tool for p in found.pairs] == ["Z", "B"]
    assert "no row of this pair any more" in found.pairs[0].reason
    held_to(
        row(found.pairs[1], "AW"),
        fit_asked(next(rows_of(simulated("B", 2)).runs())[1], asked_laws(UNITS.__contains__)[0]),
    )


def test_columns_that_ask_for_no_law_are_the_reason(fitted):
    (outcome,) = fitted(rows_of(simulated("A", 1)[["V", "tool", "work"]])).pairs
    assert outcome.laws == ()
    assert (
        outcome.reason
        == "its rows hold V alone: a law needs a response (wear, a force, T, Ra) and conditions (V, f, d, t)."
    )
    assert [c.kind for c in outcome.concerns] == ["no law"]


def test_what_was_odd_in_the_reading_is_a_concern(fitted):
    rows = rows_of(simulated("A", 1), simulated("B", 2))
    own = PairSource(rows.source, (), (), ("3 rows have fewer cells than the header.",), ())
    found = fitted(replace(rows, of_pair={Pair("A", "En 19"): own}))
    assert [[(c.kind, c.words) for c in pair.concerns] for pair in found.pairs] == [
        [("doubt in reading", "3 rows have fewer cells than the header.")], [],
    ]  # fmt: skip


@pytest.mark.parametrize("how", [TABLE, FAST], ids=["the table alone", "with files"])
def test_pairs_without_any_law_do_not_touch_those_of_another_table(fitted, how):
    plan_only, good = simulated("A", 1)[["V", "f", "tool", "work", "edge"]], simulated("B", 2)
    found = fitted(rows_of(plan_only), rows_of(good), how=how)
    assert ["its rows hold V, f" in found.pairs[0].reason, found.pairs[1].reason] == [True, ""]
    assert set(found.laws["pair"]) == {1}
    none = fitted(rows_of(plan_only), how=how)
    assert len(none.laws) == 0
    assert "its rows hold V, f" in none.pairs[0].reason


CONCERNS = {
    "rows left out": {"nobs": 8, "dropped": 1},
    "factor left out": {"left_out": "d constant (2 in all 9 rows)"},
    "few degrees of freedom": {"df": 2},
    "wear falls with time": {"params_t": -0.1},
    "fits badly": {"rsquared": 0.4},
    "no errors by edge": {"edge_reason": "2 edges for 3 parameters"},
    None: {"edge_reason": "each of the 9 rows is a separate edge: rows are independent"},
}


@pytest.mark.parametrize("kind", CONCERNS)
def test_concerns_have_few_kinds(kind):
    fine = {"response": "AW", "reason": "", "rsquared": 0.9, "df": 9, "nobs": 12, "dropped": 0, "params_t": 0.2}
    poor = [fine | CONCERNS[kind], fine | CONCERNS[kind] | {"response": "VB"}]
    none, found = concerns_of_laws(law_table([(0, fine), *((1, each) for each in poor)]), {}, 2)
    assert none == ()
    assert [c.kind for c in found] == ([] if kind is None else [kind])
    assert all(c.words.startswith("AW, VB: ") for c in found)


@pytest.fixture
def streamed(monkeypatch):
    def call(frame, cut, how=TABLE, reading=None, fail=None):
        passes = []

        def chunks_of(block, plan):
            passes.append(1)
            for start in range(0, len(frame), cut):
                if fail is not None and start >= fail:
                    raise errors.DataError("part 2 cannot be read: corrupt.")
                yield frame.iloc[start : start + cut]

        monkeypatch.setitem(sys.modules, "fitmodels.batch.source", SimpleNamespace(chunks_of=chunks_of))
        block = Block((Pair("A", "En 19"),), (), len(frame), streamed=True)
        plan = Plan("shop", "parquet", (block,), len(frame), (), {}, (), reading or Reading())
        return with_laws(fit_block(block, plan, how)), len(passes)

    return call


def test_a_streamed_pair_is_fitted_as_one_in_memory(fitted, streamed):
    frame = simulated("A", 1)
    memory = fitted(rows_of(frame)).pairs[0]
    (outcome,), passes = (found := streamed(frame, 57))[0].pairs, found[1]
    assert passes == 3  # a look at the columns, then one for each law
    assert outcome.nobs == memory.nobs == len(frame)
    for law, of in zip(outcome.laws, memory.laws, strict=True):
        assert list(law) == list(of)
        for name, value in of.items():
            close = value if not isinstance(value, float) else pytest.approx(value, rel=STREAM, abs=1e-290)
            assert law[name] == close, name
    assert found[0].units["AW"] == "mm"


def test_a_streamed_pair_has_a_file_without_posterior(streamed):
    frame = simulated("A", 1).assign(VB=np.nan, machine="lathe")
    found, _ = streamed(frame, 100, how=FAST, reading=Reading(groups=("machine",)))
    (outcome,) = found.pairs
    pf = parameters.ParameterFile.model_validate_json(outcome.files["params.json"])
    assert set(pf.laws) == {"AW", "P"}
    assert pf.identity.machine == "lathe"
    assert pf.provenance.n_rows == len(frame)
    assert "rows of a stream are not kept" in row(outcome, "AW")["no_posterior"]
    assert [r["response"] for r in outcome.laws] == ["AW", "P"]
    assert parameters.check(pf).ok


def test_conditions_that_are_not_known_are_reported_of_a_stream_with_files_too(streamed):
    (outcome,) = streamed(simulated("A", 1).drop(columns="V"), 100, how=FAST)[0].pairs
    (concern,) = [concern for concern in outcome.concerns if concern.kind == "condition not known"]
    assert concern.words.startswith("Cutting speed V is not in the rows of this pair")
    assert row(outcome, "AW")["verdict"]


def test_a_stream_whose_first_law_lacks_a_factor_is_fitted_without_it(streamed):
    frame = simulated("A", 1)
    (outcome,) = streamed(frame.assign(d=np.nan), 100)[0].pairs
    runs = next(rows_of(frame.drop(columns="d")).runs())[1]
    held_to(row(outcome, "AW"), fit.power_law(runs, "AW", ["V", "f", "t"]), STREAM)


@pytest.mark.parametrize(
    ("how", "words"),
    [(TABLE, "part 2 cannot be read"), (replace(TABLE, error="additive"), "additive errors need all rows in memory")],
    ids=["a part that cannot be read", "additive errors"],
)
def test_a_stream_that_cannot_be_fitted_says_why(streamed, how, words):
    (outcome,) = streamed(simulated("A", 1), 50, how=how, fail=100 if how is TABLE else None)[0].pairs
    assert words in outcome.reason
    assert outcome.files == {}


def test_tasks_and_outcomes_travel_between_processes(fitted):
    assert pickle.loads(pickle.dumps(fit_block)) is fit_block  # noqa: S301
    found = fitted(rows_of(simulated("A", 1), simulated("B", 2).head(2)), how=FAST)
    again = pickle.loads(pickle.dumps(found))  # noqa: S301
    assert isinstance(again, BlockOutcome)
    for one, other in zip(again.pairs, found.pairs, strict=True):
        assert [getattr(one, each.name) for each in fields(one)] == [getattr(other, each.name) for each in fields(one)]
    assert pickle.loads(pickle.dumps(Block((), (), 0))).of_pair == ()  # noqa: S301


def test_the_same_block_gives_the_same_outcome(fitted):
    rows = rows_of(simulated("A", 1), simulated("B", 2))
    assert fitted(rows, how=FAST).pairs == fitted(rows, how=FAST).pairs


def test_a_pair_in_a_block_has_the_file_that_it_has_alone(fitted):
    each = [simulated(x, i) for i, x in enumerate("AB")]
    together = fitted(rows_of(*each), how=FAST).pairs
    for frame, outcome in zip(each, together, strict=True):
        alone = fitted(rows_of(frame), how=FAST).pairs[0]
        pf, of = (parameters.ParameterFile.model_validate_json(p.files["params.json"]) for p in (outcome, alone))
        assert (pf.laws.keys(), pf.posterior, pf.tool_life) == (of.laws.keys(), of.posterior, of.tool_life)


UGLY = st.one_of(
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e300, 5e-324, 1.0]), st.floats(0.01, 100)
)


@settings(max_examples=40, deadline=None, phases=[Phase.explicit, Phase.generate])  # a shrink takes minutes
@given(st.data())
def test_a_block_never_raises(data):
    columns = data.draw(st.lists(st.sampled_from(["V", "f", "t", "AW", "VB", "P", "I", "fm", "Ra", "F"]), unique=True))
    n = data.draw(st.integers(1, 12))
    frame = pd.DataFrame({name: data.draw(st.lists(UGLY, min_size=n, max_size=n)) for name in columns}, index=range(n))
    frame["tool"] = data.draw(st.lists(st.sampled_from(["A", "B", ""]), min_size=n, max_size=n))
    frame["work"], frame["edge"] = "W", data.draw(st.lists(st.sampled_from(["1", "2", ""]), min_size=n, max_size=n))
    rows = rows_of(frame)
    pairs = tuple(Pair(tool, "W") for tool in ("A", "B", ""))
    block = Block(pairs, (), n)
    plan = Plan("shop", "parquet", (block,), n, (), {}, (), Reading())
    how = data.draw(st.sampled_from([TABLE, replace(TABLE, error="additive"), replace(FAST, draws=1000)]))
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        patch.setitem(sys.modules, "fitmodels.batch.source", SimpleNamespace(rows_of=lambda b, p: ([rows], {})))
        made = fit_block(block, plan, how)
    found = with_laws(made)
    assert [p.tool for p in found.pairs] == ["A", "B", ""]
    for outcome in found.pairs:
        assert outcome.reason or any(not law["reason"] for law in outcome.laws)
        assert "internal error" not in outcome.reason
    json.dumps(records._plain(made), allow_nan=False)
