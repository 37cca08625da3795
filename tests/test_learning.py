"""Learning from finished edges: equal to a fit of all rows, versions of the parameter file, drift over batches."""

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.core.errors import ParameterError, UsageError
from fitmodels.fit.gram_by_edge import edge_triangle, edge_triangles, rows_of
from fitmodels.live.edge_summary import MOST_CELLS, RECENT, EdgeSummary, equivalent_row
from fitmodels.live.learning import learn, learn_file, next_path, parse_measured
from fitmodels.live.samples import LoadMean, Window
from fitmodels.parameters import read
from fitmodels.parameters.draws import read_draws
from fitmodels.parameters.file import sealed
from fitmodels.parameters.gather.learned import drift, law_with, learned_law, posterior_with
from fitmodels.parameters.sections.edge_sums import LawSums

EXACT = 1e-10  # of a standard error or posterior sd: sums by edge keep the digits of a QR of all rows
FACTORS = {"AW": ("V", "f", "d", "t"), "P": ("V", "f", "d", "t", "AW")}


@pytest.fixture(scope="module")
def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def some_edges(runs, which):
    """The runs of the edges whose number fulfils a condition."""
    table = runs.to_frame()
    names = sorted(table["edge"].unique())
    return datasets.runs_from_frame(table[table["edge"].isin([e for i, e in enumerate(names) if which(i)])])


@pytest.fixture(scope="module")
def early(runs):
    """Parameter file of two thirds of the edges."""
    part = some_edges(runs, lambda i: i % 3)
    laws = [fit.power_law(part, name, factors) for name, factors in FACTORS.items()]
    posts = [fit.posterior(law, draws=1000) for law in laws]
    life = fit.tool_life(laws[0])
    return parameters.collect(laws=laws, posteriors=posts, tool_life=life, tool="GC435", work="709M40", simulated=True)


@pytest.fixture
def folder(early, runs, tmp_path):
    from fitmodels.parameters.gather.posterior import draws_of

    part = some_edges(runs, lambda i: i % 3)
    posts = [fit.posterior(fit.power_law(part, name, of), draws=1000) for name, of in FACTORS.items()]
    (tmp_path / early.posterior.draws_file).write_bytes(draws_of(posts))
    parameters.write(early, tmp_path / "params.json")
    return tmp_path


def windows(edge, minutes, V=100.0, load=1.9, **more):
    for _ in range(round(2 * minutes)):
        conditions = {"V": V, "f": 0.2, "d": 2.0, **more}
        edge.add(Window(0.0, 30.0, 0.5, conditions, {"P": LoadMean(math.log(load), 0.01, 50)}))
    return edge


def finished(name="W1", wear=0.16, minutes=12.0, **options):
    edge = windows(EdgeSummary(name), minutes, **options)
    edge.measured("AW", wear)
    return edge


@pytest.mark.parametrize("response", ["AW", "P"])
def test_edges_taken_in_one_by_one_equal_a_fit_of_all_rows(runs, early, response):
    """Through JSON after every edge: coefficients, jackknife, variance components, R2, posterior."""
    whole = fit.power_law(runs, response, FACTORS[response])
    late = fit.power_law(some_edges(runs, lambda i: i % 3 == 0), response, FACTORS[response])
    section, pf = early.laws[response], early
    for number, triangle in enumerate(edge_triangles(late), start=2):
        found = learned_law(pf, section, [replace(triangle, batch=f"{number}")], number)
        section = type(section).model_validate(json.loads(found.section.model_dump_json()))
    law = law_with(pf, section)
    assert (law.nobs, law.n_edges, section.n, section.n_edges) == (239, 24, 239, 24)
    assert np.abs((law.theta - whole.theta) / np.sqrt(np.diag(whole.covariance()))).max() < EXACT
    np.testing.assert_allclose(section.uncertainty.matrix, whole.edges.cov_theta, rtol=1e-9)
    mixed = whole.edges.mixed
    assert section.edges.sd_within == pytest.approx(mixed.sd_within, rel=1e-7)  # the search stops at 1e-7
    assert section.edges.sd_between == pytest.approx(mixed.sd_between, rel=1e-6)
    assert section.statistics.r2 == pytest.approx(whole.rsquared, rel=1e-12)
    learned = sealed(early, laws={**early.model_dump()["laws"], response: section.model_dump()})
    assert not [finding for finding in parameters.check(learned).failed if "scatter" in finding.words]
    here = posterior_with(pf, law)
    there = fit.posterior(whole, draws=1000, priors=here.priors)
    assert np.abs((here.draws - there.draws) / there.draws.std(axis=0)).max() < EXACT


def test_the_posterior_of_one_version_is_the_batch_posterior_with_the_priors_of_the_file(runs):
    law = fit.power_law(runs, "AW", FACTORS["AW"])
    pf = parameters.collect(laws=[law], posteriors=[fit.posterior(law, draws=1000)])
    again = posterior_with(pf, law_with(pf, pf.laws["AW"]))
    assert again.priors.of == fit.posterior(law, draws=1000).priors.of
    assert np.abs(again.draws / fit.posterior(law, draws=1000).draws - 1).max() < 1e-9


def test_independent_rows_are_one_group_and_take_in_rows(tmp_path):
    runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    table = runs.to_frame().drop(columns="edge", errors="ignore")
    law = fit.power_law(datasets.runs_from_frame(table), "AW", ["V", "f"])
    (one,) = edge_triangles(law)
    pf = parameters.collect(laws=[law], tool="A", work="B", simulated=True)
    row = np.array([[math.log(100.0), math.log(0.2), math.log(0.3)]])
    found = learned_law(pf, pf.laws["AW"], [edge_triangle("W1", row)], 2)
    more = pd.concat([table, pd.DataFrame([{"V": 100.0, "f": 0.2, "AW": 0.3}])], ignore_index=True)
    whole = fit.power_law(datasets.runs_from_frame(more), "AW", ["V", "f"])
    assert (one.edge, found.section.n_edges, found.section.n) == ("", None, law.nobs + 1)
    np.testing.assert_allclose(found.law.theta, whole.theta, rtol=1e-12)
    np.testing.assert_allclose(found.law.cov_theta, whole.cov_theta, rtol=1e-10)


def test_a_law_by_material_takes_in_an_edge_of_one_level(runs):
    table = pd.DataFrame({name: runs.data[name].to_numpy() for name in ("edge", "V", "f", "d", "t", "AW")})
    names = sorted(table["edge"].unique())
    table["material"] = np.where(table["edge"].isin(names[::2]), "A", "B")
    law = fit.power_law(datasets.runs_from_frame(table), "AW", FACTORS["AW"], by="material")
    pf = parameters.collect(laws=[law], tool="GC435", work="709M40", simulated=True)
    edge = EdgeSummary("W1")
    edge.advance(12.0, {"V": 100.0, "f": 0.2, "d": 2.0})
    edge.measured("AW", 0.17)
    with pytest.raises(UsageError, match=r"level of material \(A, B\) is not given"):
        learn(pf, [edge])
    row = {"V": 100.0, "f": 0.2, "d": 2.0, "t": 12.0, "AW": 0.17, "edge": "W1", "material": "B"}
    more = datasets.runs_from_frame(pd.concat([table, pd.DataFrame([row])], ignore_index=True))
    whole = fit.power_law(more, "AW", FACTORS["AW"], by="material")
    found = learn(pf, [edge], conditions={"material": "B"}).pf.laws["AW"]
    assert found.by.shifts["B"] == pytest.approx(float(whole.params["material[B]"]), rel=1e-10)
    np.testing.assert_allclose(found.uncertainty.matrix, whole.edges.cov_theta, rtol=1e-8)


def test_sums_of_ill_conditioned_columns_keep_the_digits_of_a_qr():
    """Filip-like: products of unshifted columns would lose all of these digits."""
    rng = np.random.default_rng(5)
    x = 1000 + rng.normal(size=40)
    W = np.column_stack([x, x + 1e-5 * rng.normal(size=40), rng.normal(size=40)])
    again = rows_of(edge_triangle("E", W))
    centred = [part - part.mean(axis=0) for part in (W, again)]
    one, two = (np.linalg.lstsq(C[:, :2], C[:, 2], rcond=None)[0] for C in centred)
    np.testing.assert_allclose(two, one, rtol=1e-6)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda runs: fit.power_law(runs, "AW", ["V", "t"], error="additive"), "not linear"),
        (lambda runs: fit.regression.fit_form(runs, "second_order_log", "AW", ["V", "t"]), "second order"),
        (lambda runs: fit.streamed_power_law([runs.data], "AW", ["V", "t"]), "stream"),
        (lambda runs: fit.regression.fit_form(runs, "power", "AW", ["V", "t"], fixed={"V": 0.5}), "given"),
    ],
)
def test_a_law_that_sums_do_not_determine_has_the_reason(runs, make, why):
    from fitmodels.core.formula import FORMS
    from fitmodels.parameters.gather.law import sums_of

    if why == "second order":
        name = next(name for name, form in FORMS.items() if form.second_order and form.log_response)
        law = fit.regression.fit_form(runs, name, "AW", ["V", "t"])
    else:
        law = make(runs)
    assert why in sums_of(law)["reason"]


@pytest.mark.parametrize(
    "change",
    [
        lambda sums: sums["edges"][0]["root"].append([1.0]),
        lambda sums: sums["edges"][0]["mean"].pop(),
        lambda sums: sums["edges"][0].update(moves=[0, 0]),
        lambda sums: sums["edges"].append(sums["edges"][0]),
        lambda sums: sums.update(reason="none"),
    ],
)
def test_sums_of_another_shape_are_refused(early, change):
    data = json.loads(early.laws["AW"].sums.model_dump_json())
    change(data)
    with pytest.raises(ValueError, match=r"edge|sums|root|columns"):
        LawSums.model_validate(data)


def test_a_measured_edge_makes_the_next_version_and_leaves_the_former(folder):
    file = folder / "params.json"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    found = learn_file(file, [finished()], batch="B2", command="fitmodels watch", created="2026-11-23")
    assert found.path.name == "params-2.json"
    assert {name: (folder / name).read_bytes() for name in before} == before
    new, old = read(found.path), read(file)
    (entry,) = new.history
    assert (entry.version, entry.batch, entry.edges, entry.rows) == (2, "B2", ("W1",), {"AW": 1, "P": 1})
    assert entry.former_sha256 == old.content_sha256
    assert (new.laws["AW"].n, new.laws["AW"].n_edges) == (old.laws["AW"].n + 1, old.laws["AW"].n_edges + 1)
    assert new.provenance.then[-1] == "fitmodels watch"
    draws = read_draws(new, folder)
    assert draws.keys() == {"AW", "P"}
    assert new.posterior.laws["AW"].parameters["V"].mean == pytest.approx(draws["AW"].to_frame()["V"].mean())
    assert new.tool_life.coefficients["V"] != old.tool_life.coefficients["V"]
    assert new.tool_life.criterion == old.tool_life.criterion
    assert any(line.startswith("Sums of 17 edges and 2 laws") and "kB" in line for line in found.lines)
    third = learn_file(found.path, [finished("W2")])
    assert (third.path.name, len(read(third.path).history)) == ("params-3.json", 2)


def test_checks_that_sums_do_not_determine_keep_their_result_and_are_named(early, runs):
    law = early.laws["AW"]
    found = learn(early, [finished()]).pf.laws["AW"]
    again = [text for text in found.verdict.not_checked if "as sums only" in text]
    assert any(text.startswith("Normality, rows") for text in again)
    assert not any(text.startswith(("Multicollinearity", "Signs and usual")) for text in again)
    assert found.checks["normality"] == law.checks["normality"]
    assert found.checks["collinearity"] != law.checks["collinearity"]
    assert (found.alternative, found.composite, found.smearing) == (None, None, None)
    assert found.region == law.region


def test_a_concern_of_a_check_that_is_not_computed_again_stays(early):
    law = early.laws["AW"]
    bad = law.checks["normality"].model_copy(update={"concern": 2, "verdict": "Rows are not normal."})
    verdict = {"level": "do not use for control", "reasons": ["Rows are not normal."]}
    section = law.model_validate({**law.model_dump(), "checks": {**law.checks, "normality": bad}, "verdict": verdict})
    pf = early.model_copy(update={"laws": {**early.laws, "AW": section}})
    assert learn(pf, [finished()]).pf.laws["AW"].verdict.level == "do not use for control"


def test_edges_of_a_simulation_make_the_file_simulated(early):
    measured = early.model_validate(
        {**early.model_dump(), "identity": {**early.identity.model_dump(), "simulated": False}}
    )
    assert learn(measured, [finished()]).pf.identity.simulated is False
    found = learn(measured, [finished()], simulated=True)
    assert found.pf.identity.simulated is True
    assert "version 2: simulated edges" in found.pf.identity.note
    assert learn(early, [finished()]).pf.identity.simulated is True


def test_settings_of_the_former_law_are_left_out(early):

    roughness = {"law": "P", "roughness": 1.0, "force": 420.0, "threshold": 100.0, "override_high": 1.5}
    pf = sealed(early, roughness=roughness)
    found = learn(pf, [finished()])
    assert found.pf.roughness is None
    assert any("roughness is left out" in line and "fitmodels roughness" in line for line in found.lines)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda folder: learn_file(folder / "params.json", [EdgeSummary("W1")]), "no measured wear"),
        (lambda folder: learn_file(folder / "params.json", [finished("E02")]), "the law of AW has edge 'E02' already"),
        (lambda folder: learn_file(folder / "params.json", [finished(wear=160.0)]), "unit right"),
        (lambda folder: learn_file(folder / "params.json", [without_depth()]), "d not known"),
        (lambda folder: learn_file(folder / "params.json", []), "no edge"),
        (
            lambda folder: learn_file(folder / "params.json", [with_gap()]),
            "12 min or more: the signal was lost",
        ),
        (lambda folder: learn_file(folder / "params.json", [chipped()]), "1 alarm of chipping"),
        (lambda folder: EdgeSummary("W1").measured("AW", 0.2), "not cut yet"),
        (lambda folder: finished(wear=float("nan")), "above zero"),
        (lambda folder: finished().advance(-1.0, {}), "0 or more"),
    ],
)
def test_what_cannot_be_learned_is_refused_and_nothing_is_written(folder, change, words):
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises((UsageError, ParameterError), match=words):
        change(folder)
    assert sorted(path.name for path in folder.iterdir()) == before


def with_gap():
    edge = finished()
    edge.missed()
    return EdgeSummary.from_json(edge.as_json())


def chipped():
    edge = finished()
    edge.chips += 1
    return EdgeSummary.from_json(edge.as_json())


def test_an_edge_with_a_gap_is_taken_in_where_its_time_is_certain(early):
    assert learn(early, [with_gap()], certain=True).pf.history[0].edges == ("W1",)


def test_an_interrupted_write_leaves_the_former_version_and_can_be_repeated(folder, monkeypatch):
    """Draws are written before the file that names them."""
    from fitmodels.parameters import file

    def full(*_, **__):
        raise ParameterError("no space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(file, "write_whole", full)
        with pytest.raises(ParameterError, match="no space"):
            learn_file(folder / "params.json", [finished()])
    assert not (folder / "params-2.json").exists()
    assert read(folder / "params.json").history == ()
    assert read_draws(read(learn_file(folder / "params.json", [finished()]).path), folder)


def without_depth():
    edge = EdgeSummary("W1")
    edge.advance(12.0, {"V": 100.0, "f": 0.2})
    edge.measured("AW", 0.16)
    return edge


def test_a_factor_that_the_source_lacks_is_given(early):
    found = learn(early, [without_depth()], conditions={"d": 2.0})
    assert found.pf.history[0].rows == {"AW": 1}
    assert any("no steady P was read" in line for line in found.lines)


def test_a_later_version_and_a_file_changed_by_hand_are_refused(folder):
    file = folder / "params.json"
    learn_file(file, [finished()])
    with pytest.raises(ParameterError, match="a later version"):
        learn_file(file, [finished("W2")])
    text = file.read_text().replace('"GC435"', '"GC4325"', 1)
    file.write_text(text)
    (folder / "params-2.json").unlink()
    with pytest.raises(ParameterError, match="changed after it was written"):
        learn_file(file, [finished("W2")])


def test_a_file_of_an_earlier_version_says_that_it_has_no_sums(early):
    laws = {name: law.model_copy(update={"sums": None}) for name, law in early.laws.items()}
    with pytest.raises(ParameterError, match="no sums by edge"):
        learn(early.model_copy(update={"laws": laws}), [finished()])


def test_sums_that_are_not_those_of_the_law_are_refused(early):
    other = early.laws["AW"].model_copy(update={"coefficients": {**early.laws["AW"].coefficients, "V": 0.6}})
    with pytest.raises(ParameterError, match="do not give its coefficients: V"):
        learn(early.model_copy(update={"laws": {**early.laws, "AW": other}}), [finished()])


def test_names_of_versions(early):
    entry = {"version": 3, "edges": ["W1"]}
    later = early.model_validate({**early.model_dump(), "history": [entry]})
    assert next_path("a/params.json", early).name == "params-2.json"
    assert next_path("a/params-3.json", later).name == "params-4.json"
    assert next_path("a/steel-2024.json", early).name == "steel-2024-2.json"


@pytest.mark.parametrize(
    ("text", "found"), [("AW=0.21mm", 0.21), ("AW=210um", 0.21), ("AW = 0.21", 0.21), ("AW=2.1e-1 mm", 0.21)]
)
def test_a_measured_wear_is_read_with_its_unit(early, text, found):
    assert parse_measured(early, text) == ("AW", pytest.approx(found))


@pytest.mark.parametrize("text", ["VB=0.21mm", "AW=0.21kW", "AW=-0.2", "AW=0", "0.21", "AW=e", "P=2kW", "AW=1e400"])
def test_a_measured_wear_that_cannot_be_is_refused(early, text):
    with pytest.raises(UsageError, match=r"measured wear|no law of the wear|unit of length|no number"):
        parse_measured(early, text)


def test_an_edge_takes_constant_memory_and_is_exact_through_json():
    rng = np.random.default_rng(3)
    edge = EdgeSummary("W1")
    for _ in range(1000):
        edge.advance(0.1, {"V": float(rng.uniform(50, 200)), "f": float(rng.uniform(0.1, 0.5)), "d": 2.0})
    windows(edge, 100.0)
    edge.measured("AW", 0.2)
    assert (len(edge.cells), len(edge.recent)) == (MOST_CELLS, RECENT)
    assert sum(cell.minutes for cell in edge.cells) == pytest.approx(edge.minutes)
    again = EdgeSummary.from_json(json.loads(json.dumps(edge.as_json())))
    assert again == edge
    windows(again, 1.0)
    windows(edge, 1.0)
    assert again == edge


@pytest.mark.parametrize("wrong", [1.0, 0.9, 1.1])
def test_a_life_at_changing_conditions_is_one_row_of_the_law(wrong):
    """Also with exponents that are 10 % off, the true law at that row gives the true wear."""
    law, m, grown = {"V": 1.5, "f": 0.6}, 0.5, 0.0
    edge = EdgeSummary("W1")
    for minutes, V, f in ((6.0, 80.0, 0.2), (5.0, 110.0, 0.3), (4.0, 95.0, 0.25)):
        edge.advance(minutes, {"V": V, "f": f})
        grown += (V**1.5 * f**0.6) ** (1 / m) * minutes
    mark = edge.measured("AW", 0.2)
    row = equivalent_row(mark, {name: wrong * a for name, a in law.items()}, m)
    error = abs(1.5 * row["V"] + 0.6 * row["f"] + m * row["t"] - m * math.log(grown))
    means = equivalent_row(mark, {}, m)
    of_means = abs(1.5 * means["V"] + 0.6 * means["f"] + m * means["t"] - m * math.log(grown))
    assert error < (1e-12 if wrong == 1.0 else 2e-3)
    assert of_means > 0.05


def test_a_batch_with_more_wear_is_seen_as_drift(early):
    """Ten edges on the law and ten 20 % above it, each measured once without error."""
    law, pf = early.laws["AW"], early
    rng = np.random.default_rng(7)
    for batch, ratio in (("B2", 1.0), ("B3", 1.2)):
        edges = []
        for i in range(10):
            at = {"V": float(rng.uniform(60, 180)), "f": float(rng.uniform(0.1, 0.5)), "d": 2.0}
            edge = EdgeSummary(f"{batch} {i}")
            edge.advance(12.0, at)
            edge.measured("AW", ratio * float(law.values(**at, t=12.0)))
            edges.append(edge)
        pf = learn(pf, edges, batch=batch).pf
    found = drift(pf)
    rows = [row for row in found.rows if row.response == "AW"]
    assert [row.batch for row in rows] == ["first fit", "B2", "B3"]
    assert abs(rows[1].shift) < 0.01
    assert rows[2].shift == pytest.approx(math.log(1.2), abs=0.02)
    assert rows[2].shift > 2 * rows[2].se
    table = found.to_frame()
    assert set(table.columns) >= {"law", "batch", "name", "estimate", "se", "shift", "change"}
    assert "B3" in str(found.summary())
    assert len(found.plot(law="AW").get_legend().get_texts()) == 4
    with pytest.raises(UsageError, match="there are AW, P"):
        found.plot(law="Q")


def test_most_edges_without_checks_of_rows_are_a_reservation(early):
    edges = [finished(f"W{i}", wear=0.16 + 0.001 * i) for i in range(20)]
    verdict = learn(early, edges).pf.laws["AW"].verdict
    assert verdict.level != "usable inside the tested region"
    assert any("20 of 36 edges were added as sums" in reason for reason in verdict.reasons)
