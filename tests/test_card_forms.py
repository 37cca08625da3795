"""The forms of a card: what programs read back, names that mean no good, and the same numbers in all of them.

What reads here was written elsewhere: huggingface_hub, PyYAML, markdown-it-py, lxml, jsonschema.
"""

import io
import json
import re
import sys
from dataclasses import replace
from importlib.resources import files

import jinja2
import pytest
import yaml
from fitmodels import cards, datasets, fit, parameters
from fitmodels.cards.content.card import Card, compose
from fitmodels.cards.content.numbers import UNBOUNDED
from fitmodels.cards.content.parts import FigurePart, NumberPart, Part, PublicationPart, RemedyPart, SensorPart
from fitmodels.cards.folder import markdown
from fitmodels.cards.forms import card_json
from fitmodels.cards.forms.citation import author, citation_cff, zenodo_json
from fitmodels.cards.forms.front_matter import hub_metadata, yaml_text
from fitmodels.cards.forms.linked_data import json_ld
from fitmodels.cards.forms.markdown import card_markdown, text
from fitmodels.cards.forms.page import page_html
from fitmodels.cards.forms.rendering import environment
from fitmodels.cards.terminal import pair_blocks, verdicts_reminder
from fitmodels.cli.output import Printer
from fitmodels.core.errors import UsageError
from fitmodels.ident.model import Model
from fitmodels.parameters import collect
from fitmodels.parameters.file import sealed
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from lxml import html
from markdown_it import MarkdownIt
from rich.console import Console

HOSTILE = (
    "<img src=x onerror=alert(1)>",
    "](javascript:alert(1))",
    "![a](javascript:alert(1))",
    "</script><script>alert(1)</script>",
    "<!-- ",
    "new\n\n# line",
    "\n---\nname: x",
    "a`b``c",
    "{{x}} {% raw %}",
    "a|b\\|c\\",
    "*b* _i_ ~~s~~",
    "&lt;b&gt; &amp;",
    "\u2028\u2029\x85\x00\x1b",
    '"; x = 1 # ',
    "''' \"\"\"",
    "1. ",
    "- ",
    "> ",
    "=",
    "\u202eabc",
)
PUBLISHED_SCHEMA = json.loads((files("fitmodels.cards") / "schema" / "card-8.json").read_text("utf-8"))
PUBLISHED = PublicationPart(
    license="CC-BY-4.0", authors=("Doe, Jane (0000-0002-1825-0097)", "Institute of Machining"), contact="j@example.org",
    doi="10.5281/zenodo.1", keywords=("turning",),
)  # fmt: skip
ELEMENTS = {
    "html", "body", "h1", "h2", "h3", "p", "ul", "li", "table", "thead", "tbody", "tr", "th", "td", "strong", "code",
    "pre", "blockquote", "img", "hr",
}  # fmt: skip


def bundled_file(**more):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs)
    return collect(
        tool=runs.tool, work=runs.work, design=runs, laws=laws, tool_life=fit.tool_life(laws[0]), simulated=True,
        posteriors=[fit.posterior(laws[0], draws=1000, seed=1)], note=runs.disclaimers[0], n_rows=len(runs), seed=1,
        data_file=runs.source.name, data_sha256=runs.source.sha256, command="fitmodels data.csv", **more,
    )  # fmt: skip


def drive_file():
    model = Model(b=[0, 0.1, 0.08], a=[1, -0.8], nk=1, sample_time=0.02, n=500, band=(0.1, 2.0), unit_u="V", unit_y="A")
    pi = {"kp": 0.4, "ki": 0.5, "sample_time": 0.02, "unit_u": "V", "unit_y": "A", "low": 0.0, "high": 5.0,
          "specification": {"rise_time": 2.0}, "figures": {"stable": True, "rise_time": 1.5}}  # fmt: skip
    return collect(tool="drive", work="air", dynamics=model, held_out_fit=87.25, pi=pi, data_sha256="a" * 64)


def load_file():
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    pf = collect(tool="end mill", work="S45C", design=runs, laws=[fit.load_law(runs)], limits={"power": 7})
    return sealed(pf, load_line=parameters.settings(pf, 0.28))


def two_materials():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    other = runs.data.assign(AW=1.2 * runs.data["AW"], edge=runs.data["edge"] + "x", point="other")
    both = runs.join(replace(runs, data=other, source=replace(runs.source, sha256="f" * 64)))
    return collect(tool="a", work="b", laws=[fit.power_law(both, "AW", ["V", "f", "d", "t"], by="point")])


def doubted_file():
    doubts = [
        {
            "columns": ["VB"],
            "sentence": "VB 1.2 to 1.9 mm is above the usual <b> .02 to .6 mm",
            "remedy": "--unit VB=um",
        },
        {"columns": ["n"], "sentence": "column n varies and is not used."},
    ]
    return sealed(load_file(), reading={"doubts": doubts})


def suspected_file():
    """The law of wear must not be used: the feed of two edges is in inches, a line is wrong for no known reason."""
    pf = bundled_file()
    law = pf.laws["AW"].model_dump()
    suspects = [
        {
            "column": "f",
            "edges": ["E02", "E11"],
            "factor": 25.4,
            "correction": "E02,E11:f*25.4",
            "cause": "inch for mm",
        },
        {"column": "AW", "lines": [12]},
    ]
    law["checks"]["wrong edges"] = {
        "null": "No edge differs.", "statistic": 9.1, "concern": 2, "verdict": "Edges E02, E11 differ.",
        "suspects": suspects,
    }  # fmt: skip
    law["verdict"] = {"level": "do not use for control", "reasons": ["Edges E02, E11 differ."]}
    law["without"] = {
        "edges": ["E02", "E11"], "lines": [12], "coefficients": {**law["coefficients"], "f": 0.31459},
        "standard_errors": law["standard_errors"], "residual_se": 0.05, "r2": 0.98, "n": 219, "n_edges": 22,
    }  # fmt: skip
    life = {**pf.tool_life.model_dump(), "verdict": {"level": "usable with reservations", "reasons": ["Extrapolated."]}}
    return sealed(pf, laws={**{k: v.model_dump() for k, v in pf.laws.items()}, "AW": law}, tool_life=life)


FILES = {
    "suspected": suspected_file,
    "doubted": doubted_file,
    "bundled": lambda: sealed(suspected_file(), limits={"power": {"value": 7.0, "unit": "kW", "of": "P"}}),
    "drive": drive_file,
    "load line": load_file,
    "levels": two_materials,
    "almost empty": lambda: collect(tool="a", work="b"),
}


@pytest.fixture(scope="module")
def files():
    return {name: make() for name, make in FILES.items()}


@pytest.fixture(scope="module")
def pf(files):
    return files["bundled"]


@pytest.fixture(scope="module")
def card(pf):
    """A card with every part in it."""
    made = compose(pf, publication=PUBLISHED)
    sensor = SensorPart(symbol="AW", unit="mm", model="microscope", words="SD of a reading 0.005 mm")
    identity = made.identity.model_copy(
        update={"machine": "lathe", "setup": "dry", "iso513": "P20", "sensors": (sensor,)}
    )
    picture = FigurePart(
        name="residuals", caption="Residuals", alternative="they scatter", file="figures/residuals.png"
    )
    return made.model_copy(update={"identity": identity, "figures": (*made.figures, picture)})


@pytest.fixture(scope="module")
def small(card):
    """The same with one law, for what is done with every name."""
    return card.model_copy(update={"laws": card.laws[:1], "uncertainty": card.uncertainty[:2]})


def numbers(value):
    """Every `Number` in a card."""
    if isinstance(value, NumberPart):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, Part):
        for name in type(value).model_fields:
            yield from numbers(getattr(value, name))


def renamed(value, name):
    """A card with a name before and after every text in it; numbers stay."""
    if isinstance(value, str):
        return f"{name}{value}{name}"
    if isinstance(value, tuple):
        return tuple(renamed(item, name) for item in value)
    if isinstance(value, NumberPart):
        return value.model_copy(update={"unit": renamed(value.unit, name)})
    if isinstance(value, Part):
        kept = ("schema_", "profiler") if isinstance(value, Card) else ("file",)
        fields = [f for f in type(value).model_fields if f not in kept]
        return value.model_copy(update={f: renamed(getattr(value, f), name) for f in fields})
    if isinstance(value, dict):
        return {key: renamed(item, name) for key, item in value.items()}
    return value


def rendered(source):
    """A Markdown text as HTML, with tables and raw HTML as on a forge."""
    return html.document_fromstring(MarkdownIt("commonmark", {"html": True}).enable("table").render(source))


def body(readme):
    return readme.split("\n---\n", 1)[1]


def shown(tree):
    """Text that a reader sees, in one line."""
    return " ".join(tree.text_content().split())


# --- verdicts -----------------------------------------------------------------------------------------


def test_the_verdict_stands_first_with_its_reason_and_the_correction(files):
    pf = files["suspected"]
    card = compose(pf)
    assert card.verdict == "do not use for control"
    assert [(v.of, v.level) for v in card.verdicts][:1] == [("AW", 2)]
    assert card.verdicts[-1].words == "usable with reservations"
    assert [s.command for s in card.laws[0].suspects] == [
        "fitmodels data.csv --correct 'E02,E11:f*25.4'",
        "fitmodels data.csv --leave-out 'lines 12'",
    ]
    assert {c.name: c.without.text for c in card.laws[0].coefficients}["f"] == "0.315"
    assert not any("AW" in sentence for sentence in card.intended)
    assert "Edges E02, E11 differ." in card.out_of_scope[0]
    readme, page = shown(rendered(body(card_markdown(card)))), page_html(card, pf)
    assert readme.index("✗ Verdict: do not use for control.") < readme.index("average wear, mm")
    for sentence in (card.laws[0].suspects[0].command, card.laws[0].without_words, "Edges E02, E11 differ."):
        assert sentence in readme
        assert " ".join(sentence.split()) in " ".join(html.document_fromstring(page).text_content().split())
    assert page.index("Verdict: do not use for control.") < page.index('class="summary"')
    assert card.laws[0].worked == ()  # a number beside a refusal would still be read as a prediction
    assert all("No prediction: this law must not be used." in form for form in (readme, page))
    assert page.count('<span class="badge do-not-use"><span class="icon" aria-hidden="true">✗</span> do not use') >= 2


def test_a_file_without_verdicts_is_not_judged(pf):
    laws = {name: {**law.model_dump(), "verdict": None} for name, law in pf.laws.items()}
    card = compose(sealed(pf, laws=laws, tool_life=None))
    assert card.verdict == "not judged"
    assert "earlier version" in card.verdicts[0].reasons[0]


def test_the_terminal_gives_verdict_reason_and_command_before_the_equation(files):
    out = io.StringIO()
    console = Console(file=out, width=100)
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    for block in pair_blocks(runs, files["suspected"], (), "fitmodels x {}".format):
        console.print(block)
    text = out.getvalue()
    order = [
        "Verdicts", "do not use for control: Edges E02, E11 differ.", "AW  average wear, mm   ✗ do not use for control",
        "f of edges E02, E11 (inch for mm), corrected with:", "fitmodels x --correct 'E02,E11:f*25.4'",
        "AW = 0.0086", "without the", "219 of 239 rows",
    ]  # fmt: skip
    places = [text.index(words) for words in order]
    assert places == sorted(places)
    assert verdicts_reminder(files["suspected"]).startswith("Verdicts: AW do not use for control; ")


def test_a_long_command_stays_in_one_piece(files, capsys):
    runs, out = datasets.read_runs(datasets.bundled("gc435_709m40")), Printer()
    long = "--correct 'lines " + ",".join(map(str, range(100, 160))) + ":t+6'"
    for block in pair_blocks(runs, files["suspected"], (), lambda _: f"fitmodels x {long}"):
        out.show(block)
    assert long in capsys.readouterr().out


# --- Markdown -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_of_any_letters_changes_no_element_of_the_readme(small, name):
    tame, wild = (rendered(body(card_markdown(renamed(small, n)))) for n in ("x", name))
    assert [e.tag for e in wild.iter()] == [e.tag for e in tame.iter()]
    assert {e.tag for e in wild.iter()} <= ELEMENTS
    for element in wild.iter():
        assert set(element.attrib) <= {"img": {"src", "alt"}, "code": {"class"}}.get(element.tag, {"style"})
    assert [e.get("src") for e in wild.iter("img")] == ["figures/residuals.png"]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_of_any_letters_is_read_as_it_is(small, name):
    seen = shown(rendered(body(card_markdown(small.model_copy(update={"title": f"a{name}b"})))))
    unseen = {ord(c): "\N{REPLACEMENT CHARACTER}" for c in "\x00\x1b\u202e"}
    assert " ".join(f"a{name}b".split()).translate(unseen) in seen


@pytest.mark.parametrize("name", HOSTILE)
def test_the_head_is_no_html_for_a_reader_that_does_not_know_it(small, name):
    tree = rendered(card_markdown(renamed(small, name)))
    assert not {e.tag for e in tree.iter()} & {"a", "script", "iframe", "svg", "form", "input"}
    assert len(list(tree.iter("img"))) == 1


@given(st.text())
def test_text_of_any_kind_stays_one_paragraph_of_text(words):
    (paragraph,) = rendered(f"a\n\n- x{text(words)}x\n").iter("li")
    assert not list(paragraph)
    assert "".join(paragraph.text.split()).startswith("x")


def test_pictures_beside_the_card_have_a_text_alternative(card):
    assert "![Residuals. they scatter](figures/residuals.png)" in card_markdown(card)


@pytest.mark.parametrize("name", FILES)
def test_what_a_card_does_not_say_it_gives_a_reason_for(files, name):
    card = compose(files[name])
    seen = shown(rendered(body(card_markdown(card))))
    assert all(" ".join(why.split()) in seen for why in card.empty.values())
    assert card.end in seen


@pytest.mark.parametrize("name", ["bundled", "load line", "levels"])
def test_the_python_of_a_readme_runs(files, name, tmp_path, monkeypatch):
    cards.write(files[name], tmp_path / "card")
    (code,) = re.findall(r"```python\n(.*?)```", (tmp_path / "card" / "README.md").read_text("utf-8"), flags=re.S)
    monkeypatch.chdir(tmp_path / "card")
    exec(compile(code, "README.md", "exec"), {})  # noqa: S102


def test_simulated_stands_before_everything_else(card):
    lines = body(card_markdown(card)).splitlines()
    assert lines[1].startswith("# ")
    assert lines[3].startswith("> **Not measured.**")
    measured = card.model_copy(update={"identity": card.identity.model_copy(update={"simulated": False})})
    assert "> **Not measured.**" not in card_markdown(measured)


# --- the head -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_the_hub_reads_the_head_and_gives_it_back(files, name, tmp_path):
    hub = pytest.importorskip("huggingface_hub")
    card = compose(files[name], publication=PUBLISHED)
    path = tmp_path / "README.md"
    path.write_text(card_markdown(card), encoding="utf-8")
    loaded = hub.ModelCard.load(path)
    assert loaded.data.to_dict() == hub_metadata(card)
    assert loaded.data.license == "cc-by-4.0"
    told = {(r.dataset_config, r.metric_type): r.metric_value for r in loaded.data.eval_results or ()}
    for law in card.laws:
        s = {item.name: item.number.text for item in law.statistics}
        assert told[law.response, "r_squared"] == float(s["R²"])
        assert told[law.response, "residual_standard_error"] == float(s["residual SE"])
    if name == "drive":
        assert [r.metric_value for r in loaded.data.eval_results] == [87.2]


@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_any_letters_come_back_from_the_head(small, name):
    wild = renamed(small, name)
    head = card_markdown(wild).split("---\n")[1]
    assert yaml.safe_load(head) == json.loads(json.dumps(hub_metadata(wild)))
    assert yaml.safe_load(head)["tool"] == f"{name}GC435{name}"


@pytest.mark.parametrize(
    ("spdx", "said"),
    [
        ("", {"license": "unknown"}),
        ("BSD-3-Clause", {"license": "bsd-3-clause"}),
        ("GPL-3.0-or-later", {"license": "gpl-3.0"}),
        ("LicenseRef-House", {"license": "other", "license_name": "LicenseRef-House"}),
    ],
)
def test_a_licence_is_written_in_the_words_of_the_hub(card, spdx, said):
    head = hub_metadata(card.model_copy(update={"publication": PublicationPart(license=spdx)}))
    assert {name: value for name, value in head.items() if name.startswith("license")} == said


SCALARS = st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False, allow_infinity=False),
                    st.text(st.characters(exclude_categories=["Cs"])), st.none())  # fmt: skip


@given(st.dictionaries(st.from_regex(r"[a-z]{2,8}_", fullmatch=True), st.recursive(
    SCALARS, lambda inner: st.lists(SCALARS, max_size=3) | st.dictionaries(
        st.from_regex(r"[a-z]{2,8}_", fullmatch=True), inner, max_size=3), max_leaves=8), max_size=4))  # fmt: skip
def test_yaml_of_anything_reads_back(data):
    assert (yaml.safe_load(yaml_text(data)) or {}) == data


# --- JSON ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_card_json_obeys_its_schema_and_reads_back(files, name, tmp_path):
    card = compose(files[name], publication=PUBLISHED)
    path = tmp_path / "card.json"
    path.write_text(card_json.as_json(card), encoding="utf-8")
    Draft202012Validator(PUBLISHED_SCHEMA).validate(json.loads(path.read_text("utf-8")))
    assert Card.model_validate_json(path.read_bytes()) == card
    assert path.read_bytes().endswith(b"}\n")


def test_the_published_schema_is_that_of_the_code():
    Draft202012Validator.check_schema(PUBLISHED_SCHEMA)
    assert json.loads(card_json.schema_text()) == PUBLISHED_SCHEMA
    assert PUBLISHED_SCHEMA["$id"] == "fitmodels.card/8"


@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_any_letters_come_back_from_json(small, name, tmp_path):
    wild = renamed(small, name)
    path = tmp_path / "card.json"
    path.write_text(card_json.as_json(wild), encoding="utf-8", newline="\n")
    assert Card.model_validate_json(path.read_bytes()) == wild


# --- linked data, citation ----------------------------------------------------------------------------


def test_linked_data_tell_the_measurements_and_the_model(card):
    said = json.loads(json_ld(card))
    data, model = said["@graph"]
    assert said["@context"] == "https://schema.org"
    assert (data["@type"], model["@type"]) == ("Dataset", "CreativeWork")
    assert model["isBasedOn"]["@id"] == data["@id"]
    assert data["identifier"]["value"] == card.provenance.data_sha256
    assert model["license"] == "https://spdx.org/licenses/CC-BY-4.0.html"
    assert [v["alternateName"] for v in data["variableMeasured"]] == ["V", "f", "d", "t", "AW", "Fxz", "P"]
    speed = data["variableMeasured"][0]
    assert (speed["unitText"], speed["minValue"], speed["maxValue"]) == ("m/min", 50.0, 200.0)
    assert [who["@type"] for who in model["creator"]] == ["Person", "Organization"]
    assert "dateCreated" not in model


def test_without_a_licence_nothing_is_free(pf):
    assert json.loads(json_ld(compose(pf)))["@graph"][0]["isAccessibleForFree"] is False


def test_without_data_there_is_only_a_model(files):
    (model,) = json.loads(json_ld(compose(files["almost empty"])))["@graph"]
    assert "isBasedOn" not in model


@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_any_letters_stay_inside_a_script_element(small, name):
    wild = renamed(small, name)
    source = json_ld(wild)
    assert not set(source) & set("<>&\u2028\u2029")
    assert json.loads(source)["@graph"][1]["name"] == wild.title
    (script,) = html.document_fromstring(f"<p></p><script type='x'>{source}</script>").iter("script")
    assert json.loads(script.text) == json.loads(source)


def test_the_citation_has_what_version_1_2_0_asks_for(card):
    """Required keys and the shapes of authors: Citation File Format 1.2.0, schema guide, doi 10.5281/zenodo.5171937."""
    said = yaml.safe_load(citation_cff(card))
    assert {"cff-version", "message", "title", "authors"} <= set(said)
    assert said["cff-version"] == "1.2.0"
    person, institute = said["authors"]
    assert person == {"family-names": "Doe", "given-names": "Jane", "orcid": "https://orcid.org/0000-0002-1825-0097"}
    assert institute == {"name": "Institute of Machining"}
    assert (said["type"], said["license"], said["doi"]) == ("dataset", "CC-BY-4.0", "10.5281/zenodo.1")


def test_zenodo_gets_what_it_asks_for(card):
    said = json.loads(zenodo_json(card))
    assert {"title", "upload_type", "description", "creators", "keywords", "license", "version"} <= set(said)
    assert said["creators"][0] == {"name": "Doe, Jane", "orcid": "0000-0002-1825-0097"}


@pytest.mark.parametrize("form", [citation_cff, zenodo_json])
def test_a_citation_without_an_author_is_refused(pf, form):
    with pytest.raises(UsageError, match="no author is given"):
        form(compose(pf))


@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_any_letters_come_back_from_a_citation(small, name):
    wild = renamed(small, name)
    assert yaml.safe_load(citation_cff(wild))["title"] == wild.title
    said = json.loads(zenodo_json(wild))
    assert said["title"] == wild.title
    paragraphs = html.fragments_fromstring(said["description"])
    assert [p.tag for p in paragraphs] == ["p"] * len(paragraphs)
    assert not [e for p in paragraphs for e in p]


@pytest.mark.parametrize(
    ("written", "family", "orcid"),
    [
        ("Doe, Jane", "Doe", ""),
        ("Doe", "", ""),
        (",", "", ""),
        ("Doe, J. 0000-0002-1825-009X", "Doe", "0000-0002-1825-009X"),
    ],
)
def test_authors_are_persons_where_both_names_are_given(written, family, orcid):
    assert (author(written).family, author(written).orcid) == (family, orcid)


def test_a_life_without_upper_end_is_said_to_have_none(small):
    """An interval by Fieller's theorem need not be bounded above: no form prints a number in its place."""
    life = small.tool_life.model_copy(update={"high": UNBOUNDED, "edge_high": UNBOUNDED})
    card = small.model_copy(update={"tool_life": life})
    said = f"at least {life.edge_low.text} min, not bounded above"
    assert said in card_markdown(card)
    assert said in shown(html.document_fromstring(page_html(card)))


def test_a_remedy_stands_with_its_reason_in_every_form(small):
    """A command of a remedy is code; a reason without remedy stands alone."""
    remedy = RemedyPart(words="Repeat a setting on a new edge:", command="fitmodels next params.json")
    verdict = small.laws[0].verdict.model_copy(
        update={
            "level": 1,
            "words": "usable with reservations",
            "reasons": ("One.", "Two."),
            "remedies": (None, remedy),
        }
    )
    card = small.model_copy(update={"laws": (small.laws[0].model_copy(update={"verdict": verdict}),)})
    assert (
        "  - ! One.\n  - ! Two. **Remedy:** Repeat a setting on a new edge: `fitmodels next params.json`"
        in card_markdown(card)
    )
    page = page_html(card)
    assert (
        page.index("One.") < page.index("1 more reason<") < page.index("Two.") < page.index("<strong>Remedy:</strong>")
    )
    assert "<code>fitmodels next params.json</code>" in page


# --- all forms ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_every_number_has_the_same_text_in_all_forms(files, name):
    card = compose(files[name])
    readme, browsed = (
        shown(rendered(body(card_markdown(card)))),
        shown(html.document_fromstring(page_html(card, files[name]))),
    )
    told = {" ".join(n.text.split()) for n in numbers(card) if n.text}
    assert {words for words in told if words not in readme} == set()
    assert {words for words in told if words not in browsed} == set()
    found = []
    json.loads(card_json.as_json(card), object_pairs_hook=lambda pairs: found.append(dict(pairs)) or dict(pairs))
    in_json = [(d["value"], d["text"]) for d in found if set(d) == {"value", "text", "unit"}]
    assert in_json == [(n.value, n.text) for n in numbers(card)]


@pytest.mark.parametrize("name", FILES)
def test_two_runs_give_identical_bytes(files, name, tmp_path):
    for place in ("a", "b"):
        cards.write(files[name], tmp_path / place, publication=PUBLISHED)
    for path in (tmp_path / "a").rglob("*"):
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"params.json", "README.md", "card.json", "card.html"}


@pytest.mark.parametrize("name", FILES)
def test_no_form_holds_the_path_where_it_was_written(files, name, tmp_path):
    cards.write(files[name], tmp_path / "a")
    assert not [p for p in (tmp_path / "a").iterdir() if str(tmp_path) in p.read_text("utf-8")]


def test_lines_of_a_caller_stand_where_the_file_does_not_tell_its_tests(files, tmp_path):
    cards.write(files["drive"], tmp_path / "a", data_lines=["a record"])
    card = Card.model_validate_json((tmp_path / "a" / "card.json").read_bytes())
    assert card.design.understood == ("a record",)
    assert "design" not in card.empty


def test_the_public_name_renders_a_file_in_markdown(pf):
    assert markdown(pf) == card_markdown(compose(pf))


# --- doubts -------------------------------------------------------------------------------------------


def test_doubts_about_the_data_are_in_every_form(files):
    card = compose(files["doubted"])
    command = f"fitmodels {card.provenance.data_file} --unit VB=um"
    readme, page = card_markdown(card), page_html(card, files["doubted"])
    head = readme.split("\n## ")[0]
    assert "**Doubts about the data**" in head
    assert f"&lt;b&gt; .02 to .6 mm. Corrected with: `{command}`\n" in head
    assert "- column n varies and is not used.\n" in head
    assert f"<code>{command}</code>" in page.split("<nav")[0] + page.split("<main")[0]
    assert "usual &lt;b&gt; " in page
    found = json.loads(card_json.as_json(card))["doubts"]
    assert [one["command"] for one in found] == [command, ""]
    assert card.summary.endswith("The reading of its data raised 2 doubts.")


def test_a_card_says_that_its_data_were_not_judged(files):
    assert "not judged" in compose(files["load line"].model_copy(update={"reading": None})).empty["doubts"]
    assert "doubts" not in compose(files["load line"]).empty
    assert "Doubts about the data" not in card_markdown(compose(files["load line"]))


def test_a_template_is_compiled_once_and_again_where_its_copy_is_damaged(tmp_path, monkeypatch):
    compiled = []

    class Counting(jinja2.Environment):
        def _compile(self, source, filename):
            compiled.append(filename)
            return super()._compile(source, filename)

    monkeypatch.setattr(jinja2, "Environment", Counting)
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    environment(autoescape=True).get_template("macros.html")
    assert len(compiled) == 1
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    for _ in range(2):
        environment(autoescape=True).get_template("macros.html")
    assert len(compiled) == 2
    (copy,) = (path for path in tmp_path.rglob("*") if path.is_file())
    whole = copy.read_bytes()
    for damaged in (b"", whole[:-20], whole[:40], b"x" + whole):
        copy.write_bytes(damaged)
        environment(autoescape=True).get_template("macros.html")
        assert copy.read_bytes() == whole
    assert len(compiled) == 6
    monkeypatch.setattr(sys, "pycache_prefix", str(copy))  # where no folder can be made
    environment(autoescape=True).get_template("macros.html")
    assert len(compiled) == 7
