"""The page of a card: nothing left out, nothing asked of the outside, names never read as markup, same bytes again."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from fitmodels import FitmodelsError, cards, datasets, fit, parameters
from fitmodels.cards.content.card import compose
from fitmodels.cards.content.parts import PublicationPart
from fitmodels.cards.content.profiler import profile_all
from fitmodels.cards.forms import page as module
from fitmodels.cards.forms.page import equation, page_html, points, prose, value_texts
from fitmodels.core.figure_style import DARK, LIGHT, css_colours
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.published import PAPERS, published
from hypothesis import given
from hypothesis import strategies as st

LARGEST = 600_000  # bytes of a page
LARGEST_SCRIPT = 9_000
TEMPLATES = Path(module.__file__).parent.parent / "templates"
# https://html.spec.whatwg.org/multipage/syntax.html#void-elements
VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
# attributes by which an element of HTML or SVG fetches something
FETCHING = {"src", "srcset", "poster", "data", "background", "action", "formaction", "xlink:href", "ping", "manifest"}
HOSTILE = [
    "<img src=x onerror=alert(1)>",
    "](javascript:alert(1))",
    "</script><script>alert(1)</script>",
    '"><svg onload=alert(1)>',
    "' onmouseover=alert(1) x='",
    "</style><style>*{display:none}</style>",
    "a\nb `c` {{x}} {% x %}",
    "--><!-- ]]> $\\frac{a}{b}$ \\5c",
]
MODEL = {
    "b": [0.0, 0.0611, -0.1338, 0.0752], "a": [1.0, -2.0311, 1.2104, -0.1655], "nk": 1, "sample_time": 0.02,
    "unit_u": "V", "unit_y": "A", "band": [0.1, 5.0], "held_out_fit": 87.3,
    "uncertainty": {"kind": "none", "reason": "given"},
}  # fmt: skip  # Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18
GAINS = {
    "kp": 0.43, "ki": 4.8, "sample_time": 0.02, "unit_u": "V", "unit_y": "A",
    "figures": {"stable": True, "rise_time": 2.0, "settling_time": 3.9, "overshoot": 0.0},
}  # fmt: skip


class Page(HTMLParser):
    """Elements with their attributes, the text outside scripts and styles, and what was not closed."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.elements, self.open, self.faults, self.said, self.raw = [], [], [], [], {}
        self.feed(text)
        self.close()
        self.text = " ".join(" ".join(self.said).split())

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if len(dict(attrs)) < len(attrs):
            self.faults.append(f"an attribute twice in {tag}")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> closes something else")

    def handle_data(self, data):
        if self.open and self.open[-1] in ("script", "style"):
            self.raw.setdefault((self.open[-1], self.elements[-1][1].get("type", "")), []).append(data)
        else:
            self.said.append(data)

    def handle_comment(self, data):
        self.faults.append(f"a comment: {data}")

    @property
    def skeleton(self):
        return [(tag, tuple(sorted(attrs))) for tag, attrs in self.elements]


@pytest.fixture(scope="module")
def gc435():
    """Laws of wear, force and power of the bundled set, with their design and tool life."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs)
    life = fit.tool_life(laws[0], 0.3)
    return parameters.collect(
        tool="GC435", work="709M40 (En 19)", design=runs, laws=laws, tool_life=life, simulated=True, note="drawn",
        data_file="data.csv", data_sha256="5" * 64, command="fitmodels data.csv", n_rows=239, seed=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def drive():
    """Dynamics with gains, of a machine."""
    return parameters.collect(
        tool="end mill", work="S45C", dynamics=MODEL, limits={"power": 7}, machine="TMV-510"
    ).model_copy(update={"pi": parameters.file.PiSection.model_validate(GAINS)})


@pytest.fixture(scope="module")
def bare():
    return parameters.collect(tool="GC435", work="709M40")


@pytest.fixture(scope="module", params=["gc435", "drive", "bare"])
def either(request):
    pf = request.getfixturevalue(request.param)
    card = compose(pf)
    return card, pf, page_html(card, pf)


def numbers(value):
    """Every Number of a card, however deep."""
    if isinstance(value, dict):
        if value.keys() == {"value", "text", "unit"}:
            yield value
        else:
            for part in value.values():
                yield from numbers(part)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from numbers(part)


def test_every_element_is_closed_in_order_and_no_id_is_used_twice(either):
    parsed = Page(either[2])
    assert not parsed.faults
    assert not parsed.open
    ids = [attrs["id"] for _, attrs in parsed.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    named = {word for _, attrs in parsed.elements for key in ("aria-labelledby", "aria-describedby", "for")
             for word in attrs.get(key, "").split()}  # fmt: skip
    links = {attrs["href"][1:] for _, attrs in parsed.elements if attrs.get("href", "").startswith("#")}
    clips = set(re.findall(r"url\(#([^)]*)\)", either[2]))
    assert named | links | clips <= set(ids)


def test_every_number_of_the_card_stands_in_the_page(either):
    card, _, text = either
    parsed = Page(text)
    texts = {number["text"] for number in numbers(card.model_dump())} - {""}
    assert texts or not (card.laws or card.dynamics)
    assert not [each for each in texts if " ".join(each.split()) not in parsed.text]


def test_every_sentence_of_the_card_stands_in_the_page(either):
    card, _, text = either
    said = re.sub(r"\s", "", Page(text).text)
    laws = [
        words
        for law in card.laws
        for words in (
            *law.verdict.reasons,
            *law.check_words,
            *law.cautions,
            law.edge_words,
            law.composite_words,
            law.equation,
        )
    ]
    settings = [words for window in card.windows for words in (window.title, *window.sentences)]
    parts = [part for part in (card.dynamics, card.gains) if part is not None]
    reported = [
        card.title, card.summary, card.about_intervals, card.end, card.provenance.command, card.provenance.data_sha256,
        card.identity.content_sha256, *card.intended, *card.out_of_scope, *card.safety, *card.empty.values(),
        *laws, *settings,
        *(sentence for part in parts for sentence in part.sentences), *(s.words for s in card.uncertainty),
        *(card.tool_life.words if card.tool_life else ()), *(card.design.understood if card.design else ()),
    ]  # fmt: skip
    assert not [words for words in reported if re.sub(r"\s", "", words) not in said]


def test_nothing_is_fetched_from_anywhere(either):
    text = either[2]
    for tag, attrs in Page(text).elements:
        assert not FETCHING & set(attrs)
        assert "style" not in attrs
        assert not [name for name in attrs if name.startswith("on")]
        href = attrs.get("href", "#")
        if tag == "link":
            assert (attrs["rel"], href) == ("icon", "data:,")
        elif tag == "a" and not href.startswith("#"):
            assert href.startswith("https://doi.org/10.")
            assert "noopener" in attrs["rel"]
        else:
            assert href.startswith("#")
    style = Page(text).raw["style", ""][0]
    assert "@import" not in style
    assert "url(" not in style
    assert set(re.findall(r"https?://[^\s<\"]*?(?=/)", text)) <= {"https://doi.org"}


def test_the_policy_of_the_page_allows_its_own_script_and_style_and_no_other(either):
    parsed = Page(either[2])
    policy = next(
        attrs["content"] for _, attrs in parsed.elements if attrs.get("http-equiv") == "Content-Security-Policy"
    )
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for kind, key in (("script", ("script", "")), ("style", ("style", ""))):
        (source,) = parsed.raw[key]
        checksum = base64.b64encode(hashlib.sha256(source.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{checksum}'" in policy


def named(gc435, name):
    """The bundled card with a name wherever a file can bring one."""
    d = gc435.model_dump()
    d["identity"].update(tool=name, work=name, machine=name, setup=name, note=name, iso13399={"DC": name},
                         sensors=[{"symbol": name, "unit": name, "model": name}])  # fmt: skip
    d["provenance"].update(command=name, data_file=re.sub(r"[/\\]", "", name))
    d["design"]["understood"] = [name]
    law = json.dumps(d["laws"]["AW"], ensure_ascii=False)
    for symbol, new in (("V", f"V {name}"), ("AW", name)):
        law = law.replace(json.dumps(symbol), json.dumps(new, ensure_ascii=False))
    more = {"unit": name, "quantity": name, "verdicts": [name], "notes": [name], "published": None, "composite": None}
    d["laws"] = {name: {**json.loads(law), **more}}
    d.update(tool_life=None, content_sha256=None)
    pf = ParameterFile.model_validate(json.loads(json.dumps(d)))
    return pf, compose(
        pf, publication=PublicationPart(title=name, license=name, authors=(name,), contact=name, doi=name)
    )


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_that_is_markup_comes_out_as_text(gc435, name):
    """The page has the elements and attributes of one with a harmless name: none comes from the name."""
    pf, card = named(gc435, name)
    parsed = Page(page_html(card, pf, json_ld=json.dumps({"name": name})))
    harmless = Page(page_html(*reversed(named(gc435, "x")), json_ld=json.dumps({"name": "x"})))
    assert not parsed.faults
    assert parsed.skeleton == harmless.skeleton
    assert parsed.text.count(" ".join(name.split())) > 20
    assert json.loads(parsed.raw["script", "application/ld+json"][0]) == {"name": name}
    held = parsed.raw["script", "application/json"][0]
    assert "<" not in held
    assert json.loads(held) == card.profiler.model_dump(mode="json")
    assert len(parsed.raw["style", ""]) == 1
    hidden = [attrs.get("content", "") for tag, attrs in parsed.elements if tag == "meta"]
    assert name in " ".join(hidden) or "\n" in name


def test_a_simulated_card_says_so_before_all_else_and_a_measured_one_does_not(gc435, drive):
    body = page_html(compose(gc435), gc435).split("<body>")[1]
    assert Page(body).text.startswith("Not measured.")
    assert "Not measured" not in Page(page_html(compose(drive), drive)).text


def test_safety_is_linked_from_the_head_of_the_page(either):
    head = either[2].split('<header class="head">')[1].split("</header>")[0]
    assert 'href="#safety"' in head


def test_the_page_is_small(either):
    assert len(either[2].encode()) < LARGEST
    assert (TEMPLATES / "profiler.js").stat().st_size < LARGEST_SCRIPT


def test_the_same_card_gives_the_same_bytes_whatever_was_drawn_before(gc435, drive):
    first = page_html(compose(gc435), gc435)
    page_html(compose(drive), drive)
    again = ParameterFile.model_validate(json.loads(gc435.model_dump_json()))
    assert page_html(compose(again), again) == first


def test_without_a_parameter_file_figures_are_reported_in_words(drive):
    card = compose(drive)
    text = page_html(card)
    assert "<svg" not in text
    for figure in card.figures:
        assert re.sub(r"\s", "", figure.alternative) in re.sub(r"\s", "", Page(text).text)


def test_every_figure_has_a_name_and_a_description(gc435, drive):
    for pf, panels in ((gc435, 7), (drive, 3)):
        text = page_html(compose(pf), pf)
        svgs = re.findall(r"<svg.*?</svg>", text, re.S)
        assert len(svgs) == panels
        for svg in svgs:
            assert 'role="img"' in svg
            assert re.search(r"<title[^>]*>[^<]+</title>", svg)
            assert len(re.search(r"<desc[^>]*>([^<]+)</desc>", svg)[1]) > 30
            assert "<text" in svg
            assert not re.search(r"#[0-9a-f]{6}", svg)  # colours are the style sheet's


def test_a_law_on_wear_is_drawn_with_the_wear_of_its_own_law_and_held(gc435):
    """Both curves in one panel, read off the ticks: the force rises over speed by the one and falls by the other."""
    text = page_html(compose(gc435), gc435)
    svg = re.search(r"<title[^>]*>Fxz over V</title>.*?</svg>", text, re.S)[0]
    assert "AW from its own law" in svg
    assert "AW held at 0.158 mm" in svg
    own, held = (
        np.array(re.findall(r"([\d.]+) ([\d.]+)", re.search(rf'<path d="([^"]*)"[^>]*class="{c}"', svg)[1]), float)
        for c in ("s-line", "s-second")
    )
    assert own[0, 1] > own[-1, 1]  # px from the top
    assert held[0, 1] < held[-1, 1]
    words = next(f for f in compose(gc435).figures if f.name == "responses").alternative
    assert re.search(r"Fxz increases from .* AW from its own law; with AW held at 0.158 mm it decreases from", words)


def test_a_law_is_drawn_where_its_axes_say(gc435):
    """Ends of the thick line, read off the ticks, are the law at the ends of the tested range."""
    svg = re.search(r"<title[^>]*>AW over V</title>.*?</svg>", page_html(compose(gc435), gc435), re.S)[0]
    ticks = re.findall(r'x="([\d.]+)" y="([\d.]+)" text-anchor="(middle|end)">([\d.]+)<', svg)
    x = np.polyfit(*np.array([(float(px), float(label)) for px, _, anchor, label in ticks if anchor == "middle"]).T, 1)
    y = np.polyfit(*np.array([(float(py), float(label)) for _, py, anchor, label in ticks if anchor == "end"]).T, 1)
    baseline = 0.35 * 11  # a label stands this much below its tick
    line = re.search(r'<path d="([^"]*)"[^>]*class="s-line"[^>]*stroke-width="2"', svg)[1]
    drawn = np.array(re.findall(r"([\d.]+) ([\d.]+)", line), dtype=float)
    law = gc435.laws["AW"]
    at = {"f": 0.19, "d": 2.12, "t": 6.32}  # middle of the ranges, to three digits
    np.testing.assert_allclose(np.polyval(x, drawn[[0, -1], 0]), [50, 200], rtol=2e-3)
    for V, py in zip((50.0, 200.0), drawn[[0, -1], 1], strict=True):
        assert np.polyval(y, py + baseline) == pytest.approx(law.values(V=V, **at), rel=5e-3)


def test_the_table_of_predictions_says_what_the_parameter_file_says(gc435):
    """Against ``Law.tell``, which does not know the profiler; wear at the middle from its own law."""
    card = compose(gc435)
    (start, *rest) = points(card.profiler)
    assert len(rest) == 2 * len(card.profiler.factors)
    at = {f.symbol: card.profiler.start[f.symbol] for f in card.profiler.factors}
    wear = gc435.laws["AW"].values(**at)
    for law, reported in zip(card.profiler.laws, start.values, strict=True):
        more = {"AW": wear} if law.wear else {}
        words = gc435.laws[law.response].predict(**at, **more).words
        assert f"{law.response} {reported.value} {law.unit} at" in words
        assert f"{reported.low} to {reported.high} {law.unit}" in words
        assert reported.inside == ("inside the tested region" in words)
    assert float(start.removal) == pytest.approx(1000 * at["V"] * at["f"] * at["d"], rel=5e-4)
    for law, reported in zip([law for law in card.profiler.laws if law.wear], start.held, strict=True):
        words = gc435.laws[law.response].predict(**card.profiler.start).words
        assert f"{law.response} {reported.value} {law.unit} at" in words
    low_speed = profile_all(card.profiler, {**at, "V": 50.0})["AW"]
    assert rest[0].values[0][:3] == value_texts(low_speed)


@given(st.floats(1e-6, 1e6), st.floats(1e-3, 3.0))
def test_a_prediction_is_reported_between_its_ends(value, spread):
    reported = [float(text) for text in value_texts((value, value * np.exp(-spread), value * np.exp(spread)))]
    assert reported[1] <= reported[0] <= reported[2]


def test_a_doi_is_a_link_and_anything_else_is_not(bare):
    for given_doi, link in (
        ("10.5281/zenodo.1", True),
        ("https://doi.org/10.5281/zenodo.1", True),
        ("javascript:x", False),
    ):
        text = page_html(compose(bare, publication=PublicationPart(doi=given_doi)))
        assert ('href="https://doi.org/10.5281/zenodo.1"' in text) is link


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        ("no lack of fit p .29, so", "p .29"),
        ("by edge (df 3, 23; p <0.001)", "p &lt;0.001"),
        ("rejected, p < .001: edges", "p &lt; .001"),
        ("B 1.085e-4 to", "1.085e-4"),
        ("at f 0.19 mm/rev, so", "f 0.19 mm/rev"),
        ("with u = 0.0038 A and", "u = 0.0038 A"),
    ],
)
def test_no_line_break_parts_a_number_from_what_it_is_of(said, kept):
    assert f'<span class="kept">{kept}</span>' in prose(said)


def test_the_level_of_a_category_is_no_variable():
    reported = equation("VB = 0.026 f^0.3 for material 1; times 3.1 for 2")
    assert reported.endswith("<sup>0.3</sup> for material 1; times 3.1 for 2")


def schemes():
    """Colours of the page by name: light, dark, paper."""
    css = (TEMPLATES / "page.css").read_text("utf-8")
    blocks = [
        dict(re.findall(r"--([\w-]+): (#[0-9a-f]{3,8})", block)) for block in re.findall(r":root \{(.*?)\}", css, re.S)
    ]
    return dict(zip(("light", "dark", "print"), blocks, strict=True))


def luminance(colour):
    short = len(colour) == 4
    parts = [int(colour[1 + i] * 2 if short else colour[1 + 2 * i : 3 + 2 * i], 16) / 255 for i in range(3)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", ["light", "dark", "print"])
def test_text_can_be_read_on_its_ground(scheme):
    """WCAG 2.2, 1.4.3 (4.5 to 1 for text) and 1.4.11 (3 to 1 for lines and edges that mean something)."""
    colours = schemes()[scheme]
    grounds = {"paper": 4.5, "raised": 4.5, "alarm-paper": 4.5, "warn-paper": 4.5}
    wanted = [(text, ground, ratio) for text in ("ink", "mute", "link") for ground, ratio in grounds.items()]
    wanted += [("alarm", "alarm-paper", 4.5), ("alarm", "raised", 4.5), ("warn", "warn-paper", 4.5)]
    wanted += [(line, "paper", 3) for line in ("second", "third", "limit")]
    wanted += [("line", "paper", 3), ("line", "raised", 3), ("edge", "paper", 3), ("edge", "raised", 3)]
    for text, ground, ratio in wanted:
        light, dark = sorted((luminance(colours[text]), luminance(colours[ground])), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= ratio, (text, ground)


def test_the_widget_of_a_notebook_is_a_page_in_a_frame_and_a_table():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    widget = cards.profiler(law, at={"V": 120})
    shown = widget._repr_mimebundle_()
    assert shown["text/html"].count("<iframe") == 1
    assert 'sandbox="allow-scripts"' in shown["text/html"]
    assert "Not measured" in widget.page
    value = parameters.collect(laws=[law]).laws["AW"].values(**widget.card.profiler.start)
    first = shown["text/plain"].splitlines()[2]
    assert first.startswith("120 ")
    assert float(first.split()[4]) == pytest.approx(value, rel=5e-3)
    assert "AW: ✓ usable inside the tested region" in shown["text/plain"]
    assert cards.profiler(parameters.collect(laws=[law], design=runs)).page.count("slider-3") == 2 * 2 - 1
    assert not re.search(r"https?://(?!www.w3.org)", widget.page)


@pytest.mark.parametrize(
    ("source", "at", "words"),
    [
        (3, None, "int: no source of a profiler; give a law"),
        ([], None, "list: no source of a profiler"),
        ("nowhere.json", None, "the file does not exist"),
        ("law", {"v": 1}, "'v' is no slider. Did you mean 'V'?"),
        ("law", {"V": 1000}, "V 1000 is not on its slider; tested 50 to 200 m/min"),
    ],
)
def test_a_widget_that_cannot_be_made_is_refused_with_a_remedy(source, at, words):
    if source == "law":
        source = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    with pytest.raises(FitmodelsError, match=re.escape(words)):
        cards.profiler(source, at)


def deuteranope(colour):
    """Linear red, green and blue as a deuteranope sees them (Vienot, Brettel & Mollon 1999)."""
    value = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]) ** 2.2
    return np.array([[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]]) @ value


@pytest.mark.parametrize(("scheme", "palette"), [("light", LIGHT), ("dark", DARK), ("print", LIGHT)])
def test_colours_of_the_page_are_those_of_the_figures(scheme, palette):
    colours, wanted = schemes()[scheme], css_colours(palette)
    if scheme == "print":
        wanted["ink"] = "#000"
    assert {name: colours[name] for name in wanted} == wanted
    assert np.abs(deuteranope(colours["line"]) - deuteranope(colours["second"])).max() > 0.2


@pytest.mark.parametrize("name", list(PAPERS))
def test_each_published_file_has_a_page(name):
    pf = published(name)
    text = page_html(compose(pf), pf)
    assert text.count("<svg") >= len(pf.laws)
