"""The gate before a card is published: what is missing, in one go, and the card.toml that tells it."""

import re
import tomllib

import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cards.content.card import compose
from fitmodels.cards.forms.markdown import card_markdown
from fitmodels.cards.publishing.card_toml import read_toml
from fitmodels.cards.publishing.requirements import (
    QUESTIONS,
    SENSOR_EXAMPLE,
    card_toml_template,
    check_publication,
    missing_fields,
)
from fitmodels.core.errors import DataError
from fitmodels.parameters import collect
from fitmodels.parameters.file import sealed
from hypothesis import given
from hypothesis import strategies as st

COMPLETE = """\
license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "Colchester Mascot lathe"
iso513 = "P20"
setup = "dry, overhang 30 mm"

[tool_properties]
RE = 0.8
ISOC = "SNMG 120408"

[[sensors]]
symbol = "AW"
unit = "mm"
model = "toolmaker's microscope"
sd = 0.005
"""
EMPTY = compose(collect(tool="a", work="b"))
ASKED = ["license", "authors", "contact", "machine", "iso513", "setup", "sensors"]


@pytest.fixture(scope="module")
def pf():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    return collect(tool="GC435", work="709M40", laws=[law], data_file="data.csv", data_sha256=runs.source.sha256)


@pytest.fixture
def toml(tmp_path):
    """A card.toml of this text."""

    def make(text):
        path = tmp_path / "card.toml"
        path.write_text(text, encoding="utf-8", newline="\n")
        return path

    return make


def published(pf, reported):
    return compose(reported.applied(pf), publication=reported.publication)


# --- what is missing ----------------------------------------------------------------------------------


def test_all_that_is_missing_is_said_in_one_go(pf):
    assert [item.field for item in missing_fields(compose(pf))] == ASKED
    report = check_publication(compose(pf), pf)
    assert not report.ok
    assert [item.field for item in report.missing] == ASKED
    assert all(QUESTIONS[name].example in card_toml_template(compose(pf)) for name in ASKED)


def test_a_complete_card_passes(pf, toml):
    reported = read_toml(toml(COMPLETE))
    card = published(pf, reported)
    report = check_publication(card, pf)
    assert (report.missing, report.refusals, report.ok) == ((), (), True)
    assert "identity" not in card.empty
    assert "publication" not in card.empty


@pytest.mark.parametrize("line", ["license", "authors", "contact", "machine", "iso513", "setup"])
def test_each_field_is_missed_alone(pf, toml, line):
    text = re.sub(rf"^{line} = .*$", "", COMPLETE, flags=re.M)
    assert [item.field for item in missing_fields(published(pf, read_toml(toml(text))))] == [line]


def test_a_reason_stands_for_sensors(pf, toml):
    text = COMPLETE.partition("[tool_properties]")[0]
    assert [item.field for item in missing_fields(published(pf, read_toml(toml(text))))] == ["sensors"]
    card = published(pf, read_toml(toml(f'{text}no_sensors = "read by eye"\n')))
    assert missing_fields(card) == []
    assert "read by eye" in card_markdown(card)


def test_the_checksum_of_the_data_comes_from_a_fit_alone(toml):
    pf = collect(tool="a", work="b", limits={"power": 7.0})
    (item,) = missing_fields(published(pf, read_toml(toml(COMPLETE))))
    assert (item.field, item.field in QUESTIONS) == ("data_sha256", False)
    assert "Fit the data file again" in item.ask


def test_what_is_wrong_with_the_file_refuses(pf, toml):
    card = published(pf, read_toml(toml(COMPLETE)))
    changed = pf.model_copy(update={"content_sha256": "0" * 64})
    (words,) = check_publication(card, changed).refusals
    assert "changed after it was written" in words


def test_a_shut_gate_of_the_posterior_refuses(pf, toml):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    drawn = collect(tool="a", work="b", laws=[law], posteriors=[fit.posterior(law, draws=1000, seed=1)]).model_dump()
    drawn["posterior"]["laws"]["AW"]["r_hat"] = 1.3
    shut = sealed(parameters.ParameterFile.model_validate(drawn))
    report = check_publication(published(shut, read_toml(toml(COMPLETE))), shut)
    assert any("R-hat 1.3" in words for words in report.refusals)


# --- card.toml ----------------------------------------------------------------------------------------


def test_the_template_asks_for_exactly_what_is_missing(pf, toml):
    text = card_toml_template(compose(pf))
    asked = ["no_sensors" if name == "sensors" else name for name in ASKED]
    assert list(tomllib.loads(text)) == asked
    partly = re.sub(r"^(contact|setup) = .*$", "", COMPLETE, flags=re.M)
    assert list(tomllib.loads(card_toml_template(published(pf, read_toml(toml(partly)))))) == ["contact", "setup"]
    assert tomllib.loads(card_toml_template(published(pf, read_toml(toml(COMPLETE))))) == {}


def test_a_template_that_nobody_filled_in_adds_nothing(pf, toml):
    reported = read_toml(toml(card_toml_template(compose(pf))))
    assert reported.applied(pf) is pf
    assert [item.field for item in missing_fields(published(pf, reported))] == ASKED


def test_the_examples_of_the_template_pass_the_gate(pf, toml):
    lines = [QUESTIONS[name].example for name in ASKED if name != "sensors"]
    assert missing_fields(published(pf, read_toml(toml("\n".join([*lines, *SENSOR_EXAMPLE]))))) == []
    assert missing_fields(published(pf, read_toml(toml("\n".join(QUESTIONS[name].example for name in ASKED))))) == []


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=40))
def test_no_name_gets_out_of_a_comment_of_the_template(name):
    text = card_toml_template(EMPTY.model_copy(update={"title": f'{name}\nmachine = "x"'}))
    assert all(not value for value in tomllib.loads(text).values())


def test_contents_of_card_toml_stand_in_the_card_and_are_marked(pf, toml):
    card = published(pf, read_toml(toml(COMPLETE)))
    i = card.identity
    assert (i.machine, i.iso513, i.setup) == ("Colchester Mascot lathe", "P20", "dry, overhang 30 mm")
    assert [(s.symbol, s.words) for s in i.sensors] == [("AW", "SD of a reading 0.005 mm")]
    assert [(p.name, p.number.text or p.words) for p in i.tool_properties] == [("RE", "0.8"), ("ISOC", "SNMG 120408")]
    assert "From card.toml, not from the parameter file: machine, ISO 513 group, set-up, sensors" in i.note
    assert "From card.toml" in card_markdown(card)
    assert i.content_sha256 == pf.content_sha256 == compose(pf).identity.content_sha256


def test_card_toml_fills_in_what_the_file_leaves_open(pf, toml):
    known = sealed(pf, identity={**pf.identity.model_dump(), "machine": "Colchester Mascot lathe",
                                 "sensors": [{"symbol": "AW", "unit": "mm"}]})  # fmt: skip
    card = published(known, read_toml(toml(COMPLETE)))
    assert [(s.symbol, s.model) for s in card.identity.sensors] == [("AW", "toolmaker's microscope")]
    assert "machine" not in card.identity.note


@pytest.mark.parametrize(
    ("there", "word"),
    [
        ({"machine": "another lathe"}, "machine is 'Colchester Mascot lathe', but the parameter file has 'another"),
        ({"iso513": "M10"}, "iso513 is 'P20', but the parameter file has 'M10'"),
        ({"iso13399": {"RE": 1.2}}, "tool_properties.RE is 0.8, but the parameter file has 1.2"),
        ({"sensors": [{"symbol": "AW", "unit": "um"}]}, "unit of sensor AW is 'mm', but the parameter file has 'um'"),
    ],
)
def test_card_toml_never_contradicts_the_file_silently(pf, toml, there, word):
    known = sealed(pf, identity={**pf.identity.model_dump(), **there})
    with pytest.raises(DataError, match=re.escape(word)):
        read_toml(toml(COMPLETE)).applied(known)


def test_no_sensors_beside_sensors_of_the_file_is_refused(pf, toml):
    known = sealed(pf, identity={**pf.identity.model_dump(), "sensors": [{"symbol": "AW", "unit": "mm"}]})
    with pytest.raises(DataError, match="no_sensors is given, but the parameter file has 1"):
        read_toml(toml('no_sensors = "none"')).applied(known)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("licence = 'MIT'", "'licence' is no key; did you mean license?"),
        ("qqqq = 1", "'qqqq' is no key; the keys are license"),
        ("license = 1", "license should be text in double quotes, not 1"),
        ("license = 'all rights reserved'", "license 'all rights reserved' is not an SPDX identifier"),
        ("authors = 'Doe'", "authors should be a list of texts"),
        ("authors = [1]", "authors should be a list of texts"),
        ("doi = '10.1'", "doi '10.1' is not a DOI"),
        ("iso513 = 'X'", "'X' is no group of ISO 513"),
        ("machine = 2024-01-01", "machine should be text"),
        ("sensors = 'AW'", "sensors should be blocks"),
        ("[[sensors]]\nsymbol = 'AW'", "sensors[0].unit is missing"),
        ("[[sensors]]\nsymbol = 'AW'\nunits = 'mm'", "'units' is no key of sensor 1; did you mean unit?"),
        ("[[sensors]]\nsymbol = 'AW'\nunit = 'mm'\nsd = 'x'", "sensors[0].sd should be a"),
        ("no_sensors = 'x'\n[[sensors]]\nsymbol = 'AW'\nunit = 'mm'", "remove one of them"),
        ("[tool_properties]\nre = 1", "'re' is not a symbol of ISO 13399"),
        ("tool_properties = 1", "tool_properties should be an object"),
        ("license = ", "is not TOML"),
        ("a = 1\na = 2", "is not TOML"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(toml, text, word):
    with pytest.raises(DataError, match=re.escape(word)) as caught:
        read_toml(toml(text))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_text_or_not_there_is_refused(tmp_path):
    (tmp_path / "card.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(DataError, match="is not UTF-8"):
        read_toml(tmp_path / "card.toml")
    with pytest.raises(DataError, match="no such file"):
        read_toml(tmp_path / "nowhere.toml")


@pytest.mark.parametrize("written", ["10.1/x", "doi:10.5281/zenodo.1", "https://doi.org/10.5281/zenodo.1"])
def test_a_doi_is_read_in_its_usual_spellings(toml, written):
    path = toml(f'doi = "{written}"')
    if written == "10.1/x":
        with pytest.raises(DataError, match="is not a DOI"):
            read_toml(path)
    else:
        assert read_toml(path).publication.doi == "10.5281/zenodo.1"


def test_a_pair_without_names_is_not_published():
    lacking = missing_fields(compose(collect(tool="unnamed-tool", work="S45C")))
    assert [item.field for item in lacking if item.field in ("tool", "work")] == ["tool"]
    assert "--tool NAME" in lacking[-2].ask
