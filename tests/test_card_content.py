"""The content of a card: composed from the parameter file alone, every number with the text that tells it."""

import json
import math
import re
import shlex
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.app.command_forms import Subject, actions
from fitmodels.cards.content.card import Card, compose
from fitmodels.cards.content.design import middle
from fitmodels.cards.content.identity import slug
from fitmodels.cards.content.laws import law_coefficients
from fitmodels.cards.content.numbers import count, figure, number, percent, places, probability, spread
from fitmodels.cards.content.parts import NumberPart, PublicationPart
from fitmodels.cards.content.profiler import inside, profile, profile_all, profiled, profiler_part
from fitmodels.cards.content.tables import check_table
from fitmodels.cards.content.tool_life import settings as life_settings
from fitmodels.cards.content.uncertainty import of_law, statements
from fitmodels.cards.content.verdicts import OPTION, verdict_part
from fitmodels.cards.content.windows import ENGAGEMENT
from fitmodels.cards.content.worked import scatter, short_equation
from fitmodels.cards.folder import markdown
from fitmodels.cli import main
from fitmodels.controllers.recursion.plan import plan_of
from fitmodels.core.formula import FORMS
from fitmodels.core.intervals import t_quantile
from fitmodels.core.rounding import decimals
from fitmodels.core.verdict import LEVELS, MARKS
from fitmodels.fit.regression import fit_form
from fitmodels.ident.model import Model
from fitmodels.parameters import collect, read, write
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.load_line import Engagement
from hypothesis import example, given, settings
from hypothesis import strategies as st

EXACT = 1e-9  # the profiler and the law do the same arithmetic in another order
FINITE = st.floats(-1e12, 1e12, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-12)


def bundled_file(**more):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs)
    posteriors = [fit.posterior(laws[0], draws=1000, seed=1)]
    return collect(
        tool=runs.tool, work=runs.work, design=runs, laws=laws, tool_life=fit.tool_life(laws[0]),
        posteriors=posteriors, simulated=True, note=runs.disclaimers[0], n_rows=len(runs), seed=1,
        data_file=runs.source.name, data_sha256=runs.source.sha256, command="fitmodels data.csv", **more,
    )  # fmt: skip


def drive_file(**changes):
    """An identified drive with gains that were tuned to more than they reach."""
    model = Model(
        b=[0, 0.1, 0.08], a=[1, -0.8], nk=1, sample_time=0.02, cov_params=np.diag([1e-4] * 3), n=500,
        band=(0.1, 2.0), unit_u="V", unit_y="A",
    )  # fmt: skip
    pi = {
        "kp": 0.4, "ki": 0.5, "sample_time": 0.02, "unit_u": "V", "unit_y": "A", "low": 0.0, "high": 5.0,
        "specification": {"rise_time": 2.0, "phase_margin": 45.0},
        "figures": {"stable": True, "rise_time": 1.5, "settling_time": None, "overshoot": 0.043, "gain_margin": None},
        "probability": 0.93, "draws": 500, **changes,
    }  # fmt: skip
    return collect(tool="drive", work="air", dynamics=model, held_out_fit=87.25, pi=pi)


def load_file():
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    pf = collect(tool="end mill", work="S45C", design=runs, laws=[fit.load_law(runs)], limits={"power": 7})
    return sealed(pf, load_line=parameters.settings(pf, 0.28))


def two_materials():
    """A law with levels: the bundled set as one material, and 20 % more wear as another."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    other = runs.data.assign(AW=1.2 * runs.data["AW"], edge=runs.data["edge"] + "x", point="other")
    both = runs.join(replace(runs, data=other, source=replace(runs.source, sha256="f" * 64)))
    return collect(tool="a", work="b", laws=[fit.power_law(both, "AW", ["V", "f", "d", "t"], by="point")])


FILES = {
    "bundled": lambda: bundled_file(limits={"power": {"value": 7.0, "unit": "kW", "of": "P"}}),
    "additive": lambda: collect(
        tool="a", work="b",
        laws=fit.default_laws(datasets.read_runs(datasets.bundled("gc435_709m40")), error="additive")[0],
    ),
    "drive": drive_file,
    "load line": load_file,
    "levels": two_materials,
    "almost empty": lambda: collect(tool="a", work="b"),
}  # fmt: skip


@pytest.fixture(scope="module")
def files():
    return {name: make() for name, make in FILES.items()}


@pytest.fixture(scope="module")
def pf(files):
    return files["bundled"]


@pytest.fixture(scope="module")
def card(pf):
    return compose(pf)


def parts(value):
    """Every `Number` in a card."""
    if isinstance(value, NumberPart):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from parts(item)
    elif hasattr(type(value), "model_fields"):
        for name in type(value).model_fields:
            yield from parts(getattr(value, name))


def half_a_digit(text):
    """Half of the last place that a text shows; trailing zeros of a whole number may be rounding."""
    mantissa, _, power = text.partition("e")
    whole, _, decimals = mantissa.lstrip("-").partition(".")
    zeros = len(whole) - len(whole.rstrip("0")) if not decimals and whole.strip("0") else 0
    return 0.5 * 10.0 ** (zeros - len(decimals) + int(power or 0)) * (1 + 1e-9)


def is_rounded_value(n):
    """Whether a text is its value, rounded."""
    if n.value is None:
        return not re.search(r"\d", n.text)
    if n.text.startswith("<"):
        return n.value < float(n.text[1:])
    return abs(float(n.text) - n.value) <= half_a_digit(n.text) + 1e-12 * abs(n.value)


# --- numbers and texts --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_every_text_is_its_value_rounded(files, name):
    numbers = list(parts(compose(files[name])))
    assert [n for n in numbers if not is_rounded_value(n)] == []


@given(FINITE, st.floats(1e-9, 1e9))
@example(32768.6875, 1.0)  # a tie
def test_a_number_rounded_by_any_uncertainty_is_its_value(value, uncertainty):
    last = 0.5 * 10.0 ** -decimals(uncertainty) * (1 + 1e-9)  # half of the second digit of the uncertainty
    for n in (number(value, uncertainty), spread(value, uncertainty)):
        assert abs(float(n.text) - n.value) <= max(last, half_a_digit(n.text)), n
    for n in (figure(value), places(value, 3), count(value)):
        assert is_rounded_value(n), n


@given(st.floats(0, 1))
def test_shares_are_written_in_per_cent(share):
    assert is_rounded_value(percent(share))
    assert percent(share).value == 100 * share
    assert is_rounded_value(probability(share))


def test_what_cannot_be_had_has_neither_number_nor_text():
    nan = float("nan")
    assert [number(None, 1.0), spread(1.0, None), figure(nan), places(nan, 2), probability(nan)] == [NumberPart()] * 5


def test_the_card_states_the_law_as_the_file_has_it(pf, card):
    for part, law in zip(card.laws, pf.laws.values(), strict=True):
        estimates = {c.name: c.estimate.value for c in part.coefficients}
        assert estimates == dict(law.coefficients)
        assert {c.name: c.se.value for c in part.coefficients} == dict(law.standard_errors)
        assert {c.name: c.row_se.value for c in part.coefficients} == dict(law.row_standard_errors)
        told = {n.name: n.number.value for n in part.statistics}
        F = "F({}, {})".format(*law.statistics.F_df)
        assert (told["R²"], told[F], told["n"]) == (law.statistics.r2, law.statistics.F, law.n)
        by_edge = {n.name: n.number.value for n in part.by_edge}
        assert by_edge["cluster-robust F({}, {})".format(*law.edges.F_df)] == law.edges.F


def test_the_card_has_the_checks_of_the_file(pf, card):
    verdicts = {0: "passed", 1: "warning", 2: "failed"}
    for part, law in zip(card.laws, pf.laws.values(), strict=True):
        made = [check for check in law.checks.values() if check.reason is None]
        shown = [check for check in part.checks if check.verdict != "not testable"]
        expected = [(c.p, verdicts[c.concern], c.verdict) for c in made]
        assert [(c.p.value, c.verdict, c.words) for c in shown] == expected
        pairs = zip(shown, made, strict=True)
        assert all(c.statistic.value == of.statistic for c, of in pairs if c.statistic_name)  # of some there is none
        assert len({c.name for c in part.checks}) == len(law.checks)
        assert set(part.verdict.reasons) >= {c.verdict for c in law.checks.values() if c.concern}


def test_a_check_that_cannot_be_made_gives_its_reason():
    runs = datasets.read_runs(datasets.bundled("surf_table1"))
    laws, _ = fit.default_laws(runs)
    file = collect(design=runs, laws=laws, tool="tool", work="Ck 45")
    for part, law in zip(compose(file).laws, file.laws.values(), strict=True):
        untestable = [c for c in part.checks if c.verdict == "not testable"]
        assert law.checks["form"].reason in [c.words for c in untestable if c.name == "Lack of fit"]
        assert any(untestable[0].words in sentence for sentence in part.check_words)
        assert not [c.name for c in part.checks if "edges" in c.name]  # the file names none


def test_intervals_of_the_table_are_those_of_the_fit(pf, card):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs)
    for law, part in zip(laws, card.laws, strict=True):
        expected = law.conf_int(0.95)
        for c in part.coefficients[1:]:
            np.testing.assert_allclose([c.low.value, c.high.value], expected.loc[c.name], rtol=1e-9)


def test_the_markdown_card_has_the_same_texts(pf, card):
    text = markdown(pf)
    for part in card.laws:
        for c in part.coefficients:
            assert f"| {c.name} | {c.estimate.text} | {c.se.text} |" in text


# --- the whole card -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_a_card_survives_json(files, name):
    card = compose(files[name])
    assert Card.model_validate_json(card.model_dump_json()) == card
    assert Card.model_validate(json.loads(card.model_dump_json(by_alias=True))) == card


@pytest.mark.parametrize("name", FILES)
def test_composing_twice_and_from_the_written_file_gives_the_same(files, name, tmp_path):
    card = compose(files[name])
    again = compose(read(write(files[name], tmp_path / "params.json")))
    assert card.model_dump_json() == compose(files[name]).model_dump_json() == again.model_dump_json()


@pytest.mark.parametrize("name", FILES)
def test_a_section_is_either_there_or_says_why_not(files, name):
    card = compose(files[name])
    for field in ("design", "laws", "tool_life", "uncertainty", "dynamics", "gains", "windows", "figures", "profiler"):
        assert bool(getattr(card, field)) != (field in card.empty), field
    for field, words in card.empty.items():
        assert field == "posterior" or field in Card.model_fields
        assert words.endswith(".")
        assert "\n" not in words


@pytest.mark.parametrize("name", FILES)
def test_every_card_says_what_it_is_for_what_not_and_what_to_check(files, name):
    card = compose(files[name])
    assert card.intended
    assert card.out_of_scope
    assert any("Before a machine moves" in words for words in card.safety)
    assert card.end == f"End of card {card.slug}, {card.identity.content_sha256[:12]}"
    assert all(sentence[:1].isupper() or sentence[:1].isdigit() for sentence in (*card.intended, *card.safety))


def test_the_card_of_the_bundled_set(card):
    assert card.slug == "gc435-709m40-en-19"
    assert card.summary.startswith("Not measured, simulated: laws of average wear AW")
    assert "from 239 rows of 24 edges. At V 100 m/min, f 0.19 mm/rev" in card.summary
    assert card.safety[0].startswith("NOT MEASURED")
    plan = {n.name: (n.number.text, n.words) for n in card.design.facts}
    assert (plan["plan"][1], plan["edges"][0]) == ("central composite", "24")
    assert card.tool_life.equation.startswith("T = ")
    posterior = card.laws[0].posterior
    assert [n.name for n in posterior.gate][:3] == ["draws", "R-hat", "effective draws"]
    assert posterior.parameters[0].prior
    assert card.provenance.command == "fitmodels data.csv"


def test_the_card_of_the_nasa_set(measurements):
    """Agogino & Goebel 2007: 16 cases; of the 146 rows with VB 9 are zero and no power law takes them."""
    runs = datasets.read_runs(measurements / "nasa_milling" / "nasa_mill_runs.csv")
    laws, _ = fit.default_laws(runs, by="material")
    card = compose(collect(tool="KC710", work="two", design=runs, laws=laws))
    facts = {n.name: n.number.text for n in card.design.facts}
    assert (facts["rows"], facts["edges"], facts["rows of material 1"]) == ("167", "16", "109")
    assert facts["rows left out of VB"] == "9"
    assert "levels" in card.empty["tool_life"]
    assert card.profiler.laws[0].by == "material 1"
    assert not card.profiler.removal
    assert all(is_rounded_value(n) for n in parts(card))


def test_the_card_of_a_drive_with_gains(files):
    card = compose(files["drive"])
    gains = card.gains
    facts = {n.name: (n.number.value, n.number.unit) for n in gains.facts}
    assert facts["Kp"] == (0.4, "V/A")
    assert facts["Ki"] == (0.5, "V/A/s")
    assert facts["Ti"] == (0.8, "s")
    reached = {n.name: n.number for n in gains.reached}
    assert reached["overshoot"] == NumberPart(value=4.3, text="4.3", unit="%")
    assert reached["gain margin (factor)"] == NumberPart(text="infinite")
    assert reached["probability of meeting the specification"].text == "93"
    assert [(n.number.text, n.words) for n in gains.asked] == [("2", "at most"), ("45", "at least")]
    told = {n.name: n.number.text for n in card.dynamics.facts}
    assert (told["static gain"], told["held-out fit"], told["excited up to"]) == ("0.9", "87.2", "2")
    assert [f.name for f in card.figures] == ["dynamics", "loop"]
    assert "static gain 0.9 A/V" in card.figures[0].alternative
    assert "overshoots by 4.3 %" in card.figures[1].alternative


def test_forced_gains_are_marked_everywhere():
    card = compose(drive_file(forced="trial on the bench: rise_time 1.5 above 1"))
    assert any(text.startswith("FORCED") for text in card.gains.sentences)
    assert any(text.startswith("FORCED GAINS") for text in card.safety)


def test_the_verdict_of_gains_and_their_probability_are_shown():
    """Gains that must not be used are no longer recommended; gains that were given have no verdict."""
    verdict = {"level": "do not use for control", "reasons": ["The probability is 49 %, below 50 %."]}
    stated = {"probability": 0.49, "draws": 2000, "probability_interval": (0.47, 0.51), "required_probability": 0.9}
    card = compose(drive_file(verdict=verdict, missed={"rise_time": 0.51, "ms": 0.0}, **stated))
    facts = {n.name: n.number.text for n in card.gains.reached}
    assert facts["probability of meeting the specification"] == "49"
    assert (facts["probability, low end"], facts["probability, high end"]) == ("47", "51")
    assert facts["required probability"] == "90"
    assert facts["share of these that miss rise time, 10 to 90 %"] == "51"
    assert card.verdict == "do not use for control"
    assert not any("set up a PI controller" in text for text in card.intended)
    assert any("set up a PI controller" in text for text in compose(drive_file()).intended)


def test_the_settings_of_constant_load(files):
    card = compose(files["load line"])
    limits, load = card.windows
    assert limits.title == "Limits"
    facts = {n.name: n.number for n in load.facts}
    line = files["load line"].load_line
    assert facts["reference load I"].text == "0.24"
    assert facts["lower feed limit"].value == line.lower.value
    assert facts["lower feed limit, low end"].value == line.lower.interval.low
    (feed_line,) = card.profiler.laws
    assert not feed_line.logarithmic
    value, low, high = profile(feed_line, {"VB": 0.1})
    assert value == pytest.approx(files["load line"].laws[feed_line.response].values(VB=0.1), rel=EXACT)
    assert low < value < high


def test_engagement_and_monitoring_are_shown_with_their_units(files):
    """What the file states is a number with its unit; a fault that stops is a sentence; nothing of it is hidden."""
    line = files["load line"].load_line.model_dump()
    given = {"idle": 0.1, "lost_after": 0.05, "stuck_after": 0.0, "on_fault": "stop", "recover": 0.2}
    window = compose(sealed(files["load line"], load_line={**line, "engagement": given})).windows[1]
    facts = {n.name: (n.number.text, n.number.unit) for n in window.facts}
    assert facts["load of the running spindle in air"] == ("0.1", "A")
    assert facts["time of invalid readings that is a fault"] == ("0.05", "s")
    assert facts["time of equal readings in the cut that is a fault, 0: not monitored"] == ("0", "s")
    assert facts["fastest rise of the override"] == ("0.2", "1/s")
    assert "A fault inhibits the feed." in window.sentences
    assert set(ENGAGEMENT) | {"on_fault"} == set(Engagement.model_fields)


def test_the_window_of_operation_is_the_controllers(pf, card):
    from fitmodels.controllers.region.probability import best_point

    window = next(w for w in card.windows if w.title == "Operating window")
    told = {n.name: n.number.value for n in window.facts}
    best = best_point(pf, d=2.12, t=6.32)
    assert told["V of the optimum"] == pytest.approx(best.V, rel=1e-9)
    assert told["metal removal rate of the optimum"] == pytest.approx(best.MRR, rel=1e-9)
    assert "At d 2.12 mm and t 6.32 min" in window.sentences[0]


def test_a_limit_without_its_law_is_said_and_not_raised():
    pf = bundled_file(limits={"force": {"value": 900.0, "unit": "N", "of": "Fc"}})
    window = next(w for w in compose(pf).windows if w.title == "Operating window")
    assert window.sentences[0].startswith("No operating window: ")


HOSTILE = ["<img src=x onerror=alert(1)>", "](javascript:alert(1))", "</script>", "a\nb", "`x`", "{{x}}", "工具"]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_stay_as_they_are(name):
    """Escaping is for the forms; only the slug, which becomes a file name, is made of plain letters."""
    law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    file = name.replace("/", "")  # no name of a file
    pf = collect(tool=name, work=name, machine=name, setup=name, note=name, laws=[law], data_file=file)
    card = compose(pf, publication=PublicationPart(authors=(name,), license=name))
    assert (card.identity.tool, card.identity.machine, card.provenance.data_file) == (name, name, file)
    assert card.title == f"{name} on {name}"
    assert card.publication.authors == (name,)
    assert re.fullmatch(r"[a-z0-9-]+", card.slug)


@given(st.text(min_size=1, max_size=100), st.text(min_size=1, max_size=100))
@settings(max_examples=50)
def test_a_slug_is_a_name_that_every_file_system_takes(tool, work):
    made = slug(collect(tool=tool, work=work))
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", made)
    assert len(made) <= 81


def test_pictures_beside_the_card_are_listed_with_what_they_show(pf, tmp_path):
    (tmp_path / "figures").mkdir()
    for name in ("residuals.png", "observed_predicted.png", "posterior_AW_pairs.png", "notes.txt"):
        (tmp_path / "figures" / name).write_bytes(b"")
    found = {f.name: f for f in compose(pf, folder=tmp_path).figures if f.file}
    assert list(found) == ["observed_predicted", "posterior_AW_pairs", "residuals"]
    assert found["residuals"].file == "figures/residuals.png"
    assert f"AW R² {pf.laws['AW'].statistics.r2:.4f}" in found["observed_predicted"].alternative
    assert str(tmp_path) not in compose(pf, folder=tmp_path).model_dump_json()


def test_every_picture_has_words_whatever_the_form_of_the_law(files, tmp_path):
    (tmp_path / "figures").mkdir()
    for name in ("response_surfaces", "residuals", "pi"):
        (tmp_path / "figures" / f"{name}.png").write_bytes(b"")
    told = {f.name: f for name in ("load line", "drive") for f in compose(files[name], folder=tmp_path).figures}
    load = compose(files["load line"], folder=tmp_path)
    said = next(f for f in load.figures if f.name == "response_surfaces").alternative
    assert said.startswith("fm decreases from 996 mm/min (885 to 1110) at VB 0 mm to 574 mm/min")
    assert "overshoots by 4.3 %" in told["pi"].alternative


def test_a_band_is_of_a_new_edge_only_where_edges_are_known(card):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    alone = replace(runs, data=runs.data.drop(columns="edge"))
    without = compose(collect(tool="a", work="b", laws=[fit.power_law(alone, "AW", ["V", "f", "d", "t"])]))
    for of, each in (("one new observation on a new edge", card), ("one new observation", without)):
        assert each.profiler.of == of
        assert next(f for f in each.figures if f.name == "responses").caption.endswith(f"the band of {of} (95 %)")


def test_the_summary_counts_the_rows_of_the_laws_and_not_those_of_the_file():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    few = runs.data.assign(P=runs.data["P"].where(runs.data["t"] > 5))
    laws = [fit.power_law(replace(runs, data=few), name, ["V", "f", "d"]) for name in ("AW", "P")]
    pf = collect(tool="a", work="b", laws=laws)
    assert laws[1].nobs < laws[0].nobs == 239
    assert f"from {laws[1].nobs} to 239 rows of 24 edges" in compose(pf).summary


def test_a_publication_is_shown_with_what_it_lacks(pf):
    card = compose(pf, publication=PublicationPart(title="My wear tests", license="CC-BY-4.0"))
    assert card.title == "My wear tests"
    assert card.empty["publication"] == "Missing: authors, contact; add them in card.toml."


# --- uncertainty --------------------------------------------------------------------------------------

# JCGM 100:2008 (GUM), table G.2: degrees of freedom -> t for 95 %
GUM_G2 = {1: 12.71, 2: 4.30, 3: 3.18, 5: 2.57, 10: 2.23, 14: 2.14, 20: 2.09, 50: 2.01}


def line_law(df, se=0.3):
    """A line of feed on wear whose uncertainty is known by its making."""
    return parameters.LawSection.model_validate({
        "form": "feed_line", "response": "fm", "quantity": "feed rate", "unit": "mm/min", "equation": "fm = 2 + 1 VB",
        "error": "additive", "coefficients": {"fm0": 2.0, "slope": 1.0},
        "factors": [{"symbol": "VB", "quantity": "wear", "unit": "mm", "low": 0.0, "high": 2.0}],
        "uncertainty": {"kind": "covariance", "of": ["fm0", "slope"], "matrix": [[se**2, 0], [0, 0]], "df": df},
        "residual_se": 0.4, "residual_scale": "mm/min", "n": df + 2, "df": df,
    })  # fmt: skip


@pytest.mark.parametrize(("df", "k"), GUM_G2.items())
def test_coverage_factors_are_those_of_the_gums_table(df, k):
    of_mean, of_row = of_law(line_law(df))
    assert round(of_mean.k.value, 2) == k
    assert of_mean.k.text == f"{k:.2f}"
    assert of_mean.standard.value == pytest.approx(0.3)
    assert of_row.standard.value == pytest.approx(0.5)  # 0.3 of the law and 0.4 of a row
    assert of_mean.expanded.value == pytest.approx(of_mean.k.value * 0.3)


def test_a_statement_reads_as_the_gum_asks():
    """JCGM 100:2008, 7.2.3: value, U, its unit, k and the level; to two digits of the uncertainty (7.2.6)."""
    words = of_law(line_law(10))[0].words
    assert words.startswith("fm = (3.00 ± 0.67) mm/min at VB 1 mm, for the fitted law: U = k u with u = 0.30 mm/min")
    assert "k = 2.23 (Student's t, 10 degrees of freedom), level 95 %" in words
    assert "multiply" not in words


@pytest.mark.parametrize("name", ["bundled", "additive", "load line", "levels"])
def test_statements_are_the_laws_own_intervals(files, name):
    pf = files[name]
    told = {}
    for s in statements(pf):
        told.setdefault(s.symbol, []).append(s)
    for response, law in pf.laws.items():
        logs, by = law.form == "power", law.by.reference if law.by else None
        at = {
            f.symbol: float(f"{math.sqrt(f.low * f.high) if logs else (f.low + f.high) / 2:.3g}") for f in law.factors
        }
        for s, kind in zip(told[response], ("mean", "prediction"), strict=True):
            low, high = law.interval(0.95, kind, by, **at)
            assert (s.value.value, s.low.value, s.high.value) == pytest.approx((law.values(by=by, **at), low, high))
            assert s.expanded.value == pytest.approx(s.k.value * s.standard.value)
            if law.error == "multiplicative":  # to first order the two intervals are one
                assert math.log(high / low) / 2 == pytest.approx(s.expanded.value / s.value.value)
                assert "asymmetric" in s.words


def test_the_uncertainty_of_tool_life_is_near_the_delta_methods(pf):
    """By finite differences of ln T = (ln W - ln c0 - a ln V ...) / h in the parameters of the wear law.

    The ends are Fieller's: at each the interval of the wear has the criterion as its other end.
    """
    law, life = pf.laws["AW"], pf.tool_life
    names, C = law.uncertainty.of, np.array(law.uncertainty.matrix)
    theta = np.array([math.log(law.coefficients["c0"]), *(law.coefficients[n] for n in names[1:])])

    def ln_T(p):
        known = dict(zip(names, p, strict=True))
        rest = sum(known[x] * math.log(value) for x, value in life_settings(life).items())
        return (math.log(life.criterion) - known["ln c0"] - rest) / known["t"]

    h = 1e-6
    g = np.array([(ln_T(theta + h * e) - ln_T(theta - h * e)) / (2 * h) for e in np.eye(len(theta))])
    of_law_, of_edge = [s for s in statements(pf) if s.symbol == "T"]
    assert of_law_.value.value == pytest.approx(math.exp(ln_T(theta)))
    assert of_law_.standard.value / life.typical == pytest.approx(math.sqrt(g @ C @ g), rel=0.05)
    more = law.edges.sd_between / law.coefficients["t"]
    assert of_edge.standard.value / life.typical == pytest.approx(math.hypot(math.sqrt(g @ C @ g), more), rel=0.05)
    for end, other in ((of_law_.low, 1), (of_law_.high, 0)):
        assert law.interval(0.95, "mean", **life_settings(life), t=end.value)[other] == pytest.approx(life.criterion)
    assert "extrapolation" in of_law_.words


# --- the profiler -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["bundled", "additive", "levels"])
@given(data=st.data())
@settings(max_examples=40)
def test_the_profiler_computes_what_the_law_predicts(files, name, data):
    pf = files[name]
    for law in pf.laws.values():
        by = law.by.reference if law.by else None
        at = {f.symbol: data.draw(st.floats(f.low / 2, 2 * f.high)) for f in law.factors}
        value, low, high = profile(profiled(law, pf), at)
        assert value == pytest.approx(law.values(by=by, **at), rel=EXACT)
        assert (low, high) == pytest.approx(law.interval(0.95, "prediction", by, **at), rel=EXACT, abs=1e-12)
        assert inside(profiled(law, pf), at) == law.inside(by, **at)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
@pytest.mark.parametrize("form", list(FORMS))
def test_a_law_of_every_form_is_profiled(form, error):
    rng = np.random.default_rng(3)
    V, f, VB = (rng.uniform(low, high, 60) for low, high in ((80, 250), (0.1, 0.4), (0.02, 0.3)))
    force = (900 * f**0.7 * (V / 100) ** -0.1 + 800 * VB) * np.exp(0.05 * rng.standard_normal(60))
    edges = [f"E{i // 3}" for i in range(60)]
    runs = datasets.runs_from_frame(pd.DataFrame({"edge": edges, "V": V, "f": f, "VB": VB, "Fc": force}))
    factors = {1: ["VB"], 2: ["f", "VB"], None: ["V", "f", "VB"]}[FORMS[form].n_factors]
    law = fit_form(runs, form, "Fc", factors, error=error)
    pf = parameters.collect(design=runs, laws=[law])
    part = profiled(pf.laws["Fc"], pf)
    for at in (
        {"V": 100.0, "f": 0.2, "VB": 0.1},
        {"V": 240.0, "f": 0.12, "VB": 0.29},
        {"V": 300.0, "f": 0.05, "VB": 0.5},
    ):
        here = {name: at[name] for name in law.factors}
        assert profile(part, here)[0] == pytest.approx(law.values(here), rel=EXACT)
        ends = law.predict(here, "prediction").to_frame()
        assert profile(part, here)[1:] == pytest.approx((ends.low[0], ends.high[0]), rel=1e-7)
        assert inside(part, here) == pf.laws["Fc"].inside(None, **here)
    card = compose(pf)
    assert card.profiler.laws[0].form == form
    assert any(figure.name == "responses" for figure in card.figures)


def test_an_exponential_law_is_profiled_too():
    law = parameters.LawSection.model_validate({
        "form": "exponential", "response": "Ra", "quantity": "roughness", "unit": "um", "equation": "", "n": 9, "df": 7,
        "error": "multiplicative", "coefficients": {"a": 0.24, "b": 0.0034}, "residual_se": 0.1, "residual_scale": "ln",
        "factors": [{"symbol": "F", "quantity": "force", "unit": "N", "low": 100.0, "high": 700.0}],
        "uncertainty": {"kind": "covariance", "of": ["ln a", "b"], "matrix": [[4e-3, -8e-6], [-8e-6, 2e-8]], "df": 7},
    })  # fmt: skip
    pf = parameters.ParameterFile(
        identity={"tool": "a", "work": "b", "simulated": False}, provenance={"fitmodels": "1"}, laws={"Ra": law}
    )
    for force in (100.0, 420.0, 900.0):
        value, low, high = profile(profiled(law, pf), {"F": force})
        assert value == pytest.approx(0.24 * math.exp(0.0034 * force), rel=EXACT)  # Ra = a exp(b F)
        assert (low, high) == pytest.approx(law.interval(0.95, "prediction", F=force), rel=EXACT)


def test_wear_is_put_in_from_its_own_law(pf):
    profiler = profiler_part(pf)
    assert [f.symbol for f in profiler.factors] == ["V", "f", "d", "t"]
    assert [law.wear for law in profiler.laws] == ["", "AW", "AW"]
    assert profiler.removal
    found = profile_all(profiler, profiler.start)
    at = {f.symbol: profiler.start[f.symbol] for f in profiler.factors}
    wear = pf.laws["AW"].values(**at)
    assert found["AW"][0] == pytest.approx(wear, rel=EXACT)
    assert found["P"][0] == pytest.approx(pf.laws["P"].values(**at, AW=wear), rel=EXACT)
    assert [f.symbol for f in profiler.wears] == ["AW"]
    held = profile_all(profiler, {**at, "AW": 0.3}, held=True)
    assert held["P"][0] == pytest.approx(pf.laws["P"].values(**at, AW=0.3), rel=EXACT)
    assert held["AW"] == found["AW"]


def test_the_profiler_starts_at_the_middle_of_the_results():
    """That of a law linear in its factors is no geometric mean; the Predict form of the page starts there as well."""
    pf = published("CLM-2023")
    law = next(iter(pf.laws.values()))
    assert not any(law.formula.logs)
    start = profiler_part(pf).start
    assert {name: start[name] for name in law.formula.factors} == middle(law)
    ends = {
        f.symbol: {"symbol": f.symbol, "quantity": "", "unit": "", "low": f.low, "high": f.high} for f in law.factors
    }
    of = Subject("a", "p", {"laws": json.loads(pf.model_dump_json())["laws"], "design": {"factors": [*ends.values()]}})
    form = next(one for one in actions(of) if one.name == "predict")
    assert {one.name: float(one.value) for one in form.inputs} == middle(law)


def test_a_law_without_covariance_has_a_value_and_no_band(pf):
    none = {"kind": "none", "reason": "4 observations, 4 parameters"}
    law = parameters.LawSection.model_validate({**pf.laws["AW"].model_dump(), "uncertainty": none})
    bare = pf.model_copy(update={"laws": {"AW": law}})
    value, low, high = profile(profiled(law, bare), {"V": 100.0, "f": 0.2, "d": 2.0, "t": 8.0})
    assert value == pytest.approx(law.values(V=100.0, f=0.2, d=2.0, t=8.0))
    assert (low, high) == (None, None)
    card = compose(bare)
    assert card.empty["uncertainty"] == "No uncertainty can be given: 4 observations, 4 parameters."


def contrast(one, other):
    """Ratio of the relative luminances of two colours (WCAG 2.2)."""
    light = []
    for colour in (one, other):
        parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
        r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
        light.append(0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05)
    return max(light) / min(light)


def test_a_level_has_one_icon_colour_and_word_each():
    """No two levels share an icon, a word or a class of the page: none is known by its colour alone."""
    for field in ("icon", "ascii", "css", "words"):
        assert len({getattr(mark, field) for mark in MARKS.values()}) == len(MARKS), field
    assert [MARKS[level].words for level in (0, 1, 2)] == list(LEVELS)
    for tone in {mark.tone for mark in MARKS.values()}:  # WCAG 2.2, 1.4.3 on white and 1.4.11 on VS Code's dark ground
        assert contrast(tone, "#ffffff") >= 4.5, tone
        assert contrast(tone, "#1e1e1e") >= 3.5, tone
    assert "".join(mark.ascii for mark in MARKS.values()).isascii()
    assert verdict_part("AW", None).mark == MARKS[None]


def test_checks_have_one_table_on_card_terminal_and_notebook():
    """The same cells and icons from the judgement, the parameter file and the card; no colour without them."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs)
    pf = collect(laws=laws, design=runs)
    for law, part in zip(laws, compose(pf).laws, strict=True):
        table = check_table(part.checks)
        assert pf.laws[law.response]._display().checks == table
        assert len(table.rows) >= 26
        assert {row[-1] for row in table.rows} <= {"✓ passed", "! warning", "✗ failed", "? not testable"}
        assert MARKS[0].tone in pf.laws[law.response]._repr_html_()
        assert "✓ passed</td>" in pf.laws[law.response]._repr_html_()
    judged = fit.judge(laws[0], runs=runs, laws=3)._display().table
    assert judged == check_table(compose(pf).laws[0].checks)


def test_the_commands_of_worked_predictions_give_their_numbers(pf, tmp_path, monkeypatch, capsys):
    """Each command of the card, run in its folder, prints the sentence of the card; of a life its interval."""
    write(pf, tmp_path / "params.json")
    monkeypatch.chdir(tmp_path)
    card = compose(pf)
    shown = [one for law in card.laws for one in law.worked]
    assert [len(law.worked) for law in card.laws] == [1, 2, 2]
    for one in shown:
        assert main(shlex.split(one.command)[1:]) == 0
        assert one.words in " ".join(capsys.readouterr().out.split())
        assert (one.value.text in one.words, one.low.text in one.words, one.inside) == (True, True, True)
    life = card.tool_life
    assert main(shlex.split(life.command)[1:]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "95 % interval of one new edge, by Fieller's theorem, " in printed
    assert life.extrapolated
    ends = [float(text) for text in re.findall(r"theorem, ([\d.]+) to ([\d.]+) min", printed)[0]]
    assert ends == pytest.approx([life.edge_low.value, life.edge_high.value], rel=0.02)


def test_an_equation_to_read_is_rounded_by_its_standard_errors(pf):
    law = pf.laws["AW"]
    exponents = [float(text) for text in re.findall(r"\^(-?[\d.]+)", short_equation(law))]
    errors = [law.standard_errors[name] for name in ("V", "f", "d", "t")]
    fitted = [law.coefficients[name] for name in ("V", "f", "d", "t")]
    assert np.all(np.abs(np.subtract(exponents, fitted)) < np.multiply(errors, 0.1))
    assert len(short_equation(law)) < len(law.equation)
    assert scatter(law).number.text == "10"


def test_a_constant_that_is_hardly_known_has_ends_of_two_digits(pf):
    """Its standard error has the decimals of neither end: the lower one was 0, the upper one had six digits."""
    law = pf.laws["AW"]
    wide = law.uncertainty.model_copy(update={"matrix": tuple(
        tuple(100.0 * x for x in row) for row in law.uncertainty.matrix)})  # fmt: skip
    constant = law_coefficients(law.model_copy(update={"uncertainty": wide}))[0]
    half = t_quantile(law.uncertainty.df) * 10 * law.uncertainty.matrix[0][0] ** 0.5
    c0 = law.coefficients["c0"]
    assert (constant.low.value, constant.high.value) == pytest.approx((c0 * math.exp(-half), c0 * math.exp(half)))
    assert all(0 < len(end.text.lstrip("0.").split("e")[0].replace(".", "").rstrip("0")) <= 2
               for end in (constant.low, constant.high))  # fmt: skip


def test_the_plan_of_an_edge_is_that_of_the_replay_and_the_exports():
    """AC-2017: minutes 1 and 14 of the paper's sequence; a file without a wear criterion has the reason."""
    file = published("AC-2017")
    card, plan = compose(file), plan_of(file)
    assert card.plan is not None
    assert [(row.end.value, row.V.value, row.f.value, row.tested) for row in card.plan.rows] == [
        (row.end, row.V, row.f, row.tested) for row in plan.rows
    ]
    first, last = card.plan.rows[0], card.plan.rows[-1]
    assert (first.V.text, first.f.text, last.V.text, last.f.text) == ("150", "0.58", "200", "0.205")
    assert first.limits == "power 7 kW"
    assert card.plan.sentences[0].startswith("Calculated from the laws, not measured: the edge lasts 14 min")
    assert compose(published("AC-2016")).plan is None
    assert "wear criterion" in compose(published("AC-2016")).empty["plan"]
    simulated = sealed(file, identity={**file.identity.model_dump(), "simulated": True})
    assert any("do not run a machine by this plan" in words for words in compose(simulated).plan.sentences)
    assert "| 14 | 200 | 0.205 |" in markdown(file)


def test_a_remedy_takes_an_option_without_the_end_of_its_sentence():
    """The command of the remedy once read ``--form T=weibull.``, which is no form."""
    assert OPTION.search("the lives prefer Weibull: --form T=weibull.")[0] == "--form T=weibull"


def test_costs_of_the_file_are_in_every_form_of_its_card(tmp_path, capsys, monkeypatch):
    """Figures with units and their source; they stood in the command line of the provenance alone."""
    monkeypatch.chdir(tmp_path)
    write(collect(tool="GC435", work="709M40", limits={"power": 7}), "params.json")
    without = compose(read("params.json"))
    assert without.costs is None
    assert without.empty["costs"] == "The file holds no costs of a part; add them with fitmodels costs params.json."
    stated = [
        "costs params.json machine=72/h insert=16 edges=4 change=1.5min handling=2min volume=120cm3 currency=EUR",
        "costs params.json failure=40 energy=0.3/kWh",
    ]
    assert [main(words.split()) for words in stated] == [0, 0]
    card = compose(read("params.json"))
    facts = {item.name: (item.number.value, item.number.unit) for item in card.costs.facts}
    assert facts == {
        "machine rate": (72.0, "EUR/h"),
        "labour rate": (0.0, "EUR/h"),
        "price of an insert": (16.0, "EUR"),
        "edges of an insert": (4.0, ""),
        "price of an edge": (4.0, "EUR"),
        "time of a change of the edge": (1.5, "min"),
        "handling time of a part": (2.0, "min"),
        "volume cut from a part": (120.0, "cm3"),
        "cost of a failed edge beyond its change": (40.0, "EUR"),
        "price of energy": (0.3, "EUR/kWh"),
    }
    source = f"Costs as stated, not measured; stated by: {' && '.join(f'fitmodels {words}' for words in stated)}."
    assert card.costs.sentences == (source, "The efficiency is not stated: 1 is assumed.")
    assert "costs" not in card.empty
    assert main(["card", "params.json", "--force"]) == 0
    capsys.readouterr()
    readme, page, data = ((tmp_path / name).read_text("utf-8") for name in ("README.md", "card.html", "card.json"))
    assert "## Costs of a part" in readme
    assert "| machine rate | 72 EUR/h |" in readme
    assert re.search(r'<section id="costs".*Costs of a part.*72\s<span class="unit">EUR/h<', page, re.S)
    assert '<a href="#costs">' in page
    assert json.loads(data)["costs"]["facts"][0]["number"] == {"value": 72.0, "text": "72", "unit": "EUR/h"}
    of_volume = collect(tool="a", work="b", costs={"currency": "EUR", "machine": 60.0, "edge": 8.0, "change": 1.5})
    part = compose(of_volume).costs
    assert part.title == "Costs of 1 cm3, because the cut of a part is not stated"
    assert part.sentences == ("Costs as stated, not measured; the file does not name the command that stated them.",)
