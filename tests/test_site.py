"""The site of many cards: complete, linked, valid, the same bytes again, names never markup, nothing half-written."""

import base64
import gc
import hashlib
import json
import os
import re
import weakref
from collections import Counter
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree as ET

import pytest
from fitmodels import parameters
from fitmodels.cards import publishing
from fitmodels.cards.content import figure_texts
from fitmodels.cards.publishing import build, pair, pool
from fitmodels.cards.publishing.entries import CardEntry, exponents_data, with_slugs
from fitmodels.cards.publishing.pages import compare_page, index_page, updated
from fitmodels.core.errors import DataError, UsageError
from fitmodels.core.text import printable
from fitmodels.core.verdict import LEVELS
from hypothesis import given, settings
from hypothesis import strategies as st

ATOM = "{http://www.w3.org/2005/Atom}"
RFC3339 = re.compile(r"\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2}Z")
OF_A_CARD = {"index.html", "card.json", "README.md", "params.json"}
VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
HOSTILE = [
    "<img src=x onerror=alert(1)>",
    "](javascript:alert(1))",
    "</script><script>alert(1)</script>",
    "a\nb `c` {{x}} {% x %}",
    "\"' onmouseover=alert(1) x='",
    "]]> --> &amp; \x01 \u202e",
]
TOML = """license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "a lathe"
setup = "dry"
no_sensors = "read by eye"
iso513 = "{group}"
"""


def law(exponent=0.5, se=0.05, df=20, response="AW", form="power", symbol="V"):
    names = {"power": ("c0", symbol), "exponential": ("a", "b")}[form]
    right = f"0.01 {symbol}^{exponent:.6g}" if form == "power" else f"0.01 exp({exponent:.6g} {symbol})"
    return {
        "form": form, "response": response, "quantity": "average wear", "unit": "mm",
        "equation": f"{response} = {right}", "error": "multiplicative",
        "coefficients": {names[0]: 0.01, names[1]: exponent},
        "standard_errors": {names[0]: 0.002, names[1]: se},
        "factors": [{"symbol": symbol, "quantity": "cutting speed", "unit": "m/min", "low": 50.0, "high": 200.0}],
        "uncertainty": {"kind": "covariance", "of": [f"ln {names[0]}", names[1]],
                        "matrix": [[0.04, 0.0], [0.0, se**2]], "df": df},
        "residual_se": 0.1, "residual_scale": "ln", "n": df + 2, "df": df,
    }  # fmt: skip


def add(folder, name, *laws, tool="GC435", work="709M40", group="P20", **provenance):
    """Write a pair that may be published."""
    home = folder / name
    home.mkdir(parents=True)
    pf = parameters.ParameterFile.model_validate({
        "identity": {"tool": tool, "work": work, "simulated": "sim" in name},
        "laws": {one["response"]: one for one in laws},
        "provenance": {"fitmodels": "0.1.0", "data_file": "data.csv", "data_sha256": "a" * 64, **provenance},
    })  # fmt: skip
    parameters.write(pf, home / "params.json")
    (home / "card.toml").write_text(TOML.format(group=group), encoding="utf-8")
    return home


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    add(folder, "a", law(0.5), law(0.8, response="VB"), created="2024-05-01T12:00:00+02:00")
    add(folder, "b/deeper", law(0.7), created="2023-02-03")  # of the same tool and work
    add(
        folder,
        "c-sim",
        law(0.9),
        law(0.01, response="rough", form="exponential", symbol="speed"),
        tool="CNMG",
        group="M10",
    )
    add(folder, "d", tool="nothing fitted", work="yet", group="H")
    for k, name in enumerate(HOSTILE):
        add(folder, f"h{k}", law(0.1 * k, response=name, symbol=name), tool=name, work=name, command=name)
    return folder


@pytest.fixture(scope="module")
def made(pairs, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "site"
    report = publishing.publish(pairs, out)
    assert report.problems == ()
    return out


def content(top):
    return {path.relative_to(top).as_posix(): path.read_bytes() for path in sorted(top.rglob("*")) if path.is_file()}


class Page(HTMLParser):
    """Elements with their attributes, and text by the element it stands in."""

    def __init__(self, path):
        super().__init__(convert_charrefs=True)
        self.elements, self.texts, self.open = [], [], []
        self.feed(path.read_text("utf-8"))
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self.open[-1] if self.open else "", data))

    def all(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]

    def inside(self, tag):
        return [text for name, text in self.texts if name == tag]


def pages(top):
    return sorted(top.rglob("*.html"))


# --- structure and links


def test_a_site_has_two_pages_a_feed_a_list_and_a_folder_a_card(made):
    assert {path.name for path in made.iterdir()} == {"index.html", "compare.html", "atom.xml", "cards.json", "cards"}
    folders = list((made / "cards").iterdir())
    assert len(folders) == 4 + len(HOSTILE)
    assert all({path.name for path in folder.iterdir()} == OF_A_CARD for folder in folders)


def test_pairs_of_one_tool_and_work_get_the_beginning_of_their_content_as_well(made):
    named = sorted(path.name for path in (made / "cards").glob("gc435-709m40*"))
    assert len(named) == 2
    for name in named:
        card = json.loads((made / "cards" / name / "card.json").read_text("utf-8"))
        assert name == f"gc435-709m40-{card['identity']['content_sha256'][:8]}"


def test_every_relative_link_of_every_page_exists(made):
    found = 0
    for path in pages(made):
        for _, attrs in Page(path).elements:
            for name in ("href", "src"):
                link = urlsplit(attrs.get(name) or "")
                if name not in attrs or link.scheme in ("data", "https"):
                    continue
                assert link.scheme == link.netloc == ""
                target = path.parent / unquote(link.path) if link.path else path
                assert target.is_file(), (path, attrs[name])
                found += 1
    assert found > 10 * len(pages(made))


def test_the_index_links_every_card_without_any_script(made):
    links = [a["href"] for a in Page(made / "index.html").all("a")]
    assert {f"cards/{path.name}/index.html" for path in (made / "cards").iterdir()} <= set(links)


def test_without_a_script_the_exponents_stand_in_tables(made):
    text = "".join(text for _, text in Page(made / "compare.html").texts)
    listed = json.loads((made / "cards.json").read_text("utf-8"))
    exponents = [x for card in listed["cards"] for one in card["laws"] for x in one["exponents"]]
    assert len(exponents) == 5 + len(HOSTILE)
    assert all(f"{x['estimate']['text']}{x['low']['text']} … {x['high']['text']}" in text for x in exponents)


def alike(slug, verdict, data_file):
    """A card of an unnamed pair with one law of this verdict."""
    x = {"factor": "V", "estimate": {"value": 1.0, "text": "1.00"}, "low": {}, "high": {}}
    one = {"response": "P", "verdict": verdict, "quantity": "power", "unit": "kW", "form": "power", "equation": "P = V"}
    names = {"tool": "unnamed-tool", "work": "unnamed-work", "title": "unnamed-tool on unnamed-work"}
    return CardEntry(
        slug=slug, **names, summary="", simulated=False, content_sha256="0" * 64, data_file=data_file,
        laws=({**one, "exponents": (x,)},),
    )  # fmt: skip


def test_exponents_of_a_draft_have_the_verdict_on_their_law_and_the_file_of_their_pair():
    """Laws that must not be used stood unmarked beside others, and two unnamed pairs could not be distinguished."""
    entries = [
        alike("u-1", LEVELS[2], "may.csv"),
        alike("u-2", LEVELS[0], "june.csv"),
        alike("u-3", LEVELS[1], "j.csv"),
    ]
    page = compare_page(entries, "Cards", draft=True)
    rows = dict(re.findall(r'<a href="cards/(u-\d)/index.html">(.+?)</th>', page))
    assert {slug: re.search('class="fine">([^<]+)<', row)[1] for slug, row in rows.items()} == {
        "u-1": "may.csv", "u-2": "june.csv", "u-3": "j.csv"
    }  # fmt: skip
    assert re.search(r'badge do-not-use"><span[^>]*>✗</span> <span>do not use for control<', rows["u-1"])
    assert re.search(r'badge usable"><span[^>]*>✓</span> <span class="hidden">usable inside', rows["u-2"])
    assert re.search(r'badge reservations"><span[^>]*>!</span> <span>usable with reservations<', rows["u-3"])
    data = exponents_data(entries)
    assert [pair["source"] for pair in data["pairs"]] == ["may.csv", "june.csv", "j.csv"]
    assert [data["verdicts"][row[-1]][1] for row in data["sets"][0]["rows"]] == [LEVELS[2], LEVELS[0], LEVELS[1]]
    assert re.findall('class="fine">([^<]+)<', index_page(entries, "Cards")) == ["may.csv", "june.csv", "j.csv"]
    assert 'class="fine"' not in compare_page(entries[:1], "Cards").partition("<tbody>")[2].partition("</tbody>")[0]


@pytest.mark.parametrize("name", ["index.html", "compare.html"])
def test_a_page_allows_its_own_style_and_script_and_nothing_else(made, name):
    page = Page(made / name)
    policy = next(m["content"] for m in page.all("meta") if m.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; ")
    for tag, allowed in (("style", "style-src"), ("script", "script-src")):
        runs = page.inside(tag)[-1]  # the data stand before the script
        digest = base64.b64encode(hashlib.sha256(runs.encode()).digest()).decode()
        assert f"{allowed} 'sha256-{digest}'" in policy
    assert not any(k.startswith("on") or k == "style" for _, attrs in page.elements for k in attrs)


def test_the_list_holds_the_numbers_of_the_cards_and_the_hashes_of_their_files(made):
    listed = json.loads((made / "cards.json").read_text("utf-8"))
    assert listed["schema"] == "fitmodels.site/5"
    for one in listed["cards"]:
        home = made / "cards" / one["slug"]
        assert set(one["files"]) == OF_A_CARD
        assert all(hashlib.sha256((home / n).read_bytes()).hexdigest() == sha for n, sha in one["files"].items())
        card = json.loads((home / "card.json").read_text("utf-8"))
        assert one["content_sha256"] == card["identity"]["content_sha256"]
        assert one["title"] == printable(card["title"])
        known = {(printable(k["response"]), printable(c["name"])): c for k in card["laws"] for c in k["coefficients"]}
        for held in one["laws"]:
            for x in held["exponents"]:
                c = known[held["response"], "b" if held["form"] == "exponential" else x["factor"]]
                assert (x["estimate"], x["low"], x["high"], x["se"]) == (
                    c["estimate"], c["low"], c["high"], c["se"]["value"]
                )  # fmt: skip
                assert x["df"] == 20


def test_a_rate_is_reported_with_its_unit_and_an_exponent_has_none(made):
    listed = json.loads((made / "cards.json").read_text("utf-8"))
    units = {one["form"]: x["unit"] for card in listed["cards"] for one in card["laws"] for x in one["exponents"]}
    assert units == {"power": "", "exponential": "1/(m/min)"}


# --- the feed


def test_the_feed_has_what_rfc_4287_requires(made):
    """Sections 4.1.1 and 4.1.2: exactly one id, title and updated; an author; of an entry without content a link."""
    top = ET.parse(made / "atom.xml").getroot()  # noqa: S314  our own file
    assert top.tag == f"{ATOM}feed"
    entries = top.findall(f"{ATOM}entry")
    assert len(entries) == 4 + len(HOSTILE)
    for element in (top, *entries):
        assert all(len(element.findall(f"{ATOM}{name}")) == 1 for name in ("id", "title", "updated"))
        assert element.find(f"{ATOM}id").text.startswith("urn:uuid:")
        assert RFC3339.fullmatch(element.find(f"{ATOM}updated").text)
    assert top.find(f"{ATOM}author/{ATOM}name").text
    for entry in entries:
        alternate = [link for link in entry.findall(f"{ATOM}link") if link.get("rel") == "alternate"]
        assert len(alternate) == 1
        assert (made / alternate[0].get("href")).is_file()
    assert len({entry.find(f"{ATOM}id").text for entry in entries}) == len(entries)


def test_the_newest_stands_first_and_a_card_without_a_date_at_1970(made):
    top = ET.parse(made / "atom.xml").getroot()  # noqa: S314
    dates = [element.text for element in top.findall(f"{ATOM}entry/{ATOM}updated")]
    assert dates[:2] == ["2024-05-01T10:00:00Z", "2023-02-03T00:00:00Z"]
    assert set(dates[2:]) == {"1970-01-01T00:00:00Z"}
    assert top.find(f"{ATOM}updated").text == dates[0]
    assert "dated 1970-01-01" in top.find(f"{ATOM}subtitle").text


@given(st.datetimes(timezones=st.none() | st.timezones()).map(datetime.isoformat) | st.text())
def test_every_date_that_a_file_may_hold_is_a_date_of_atom(created):
    found = updated(created)
    assert RFC3339.fullmatch(found)
    datetime.fromisoformat(found)


# --- names


@pytest.mark.parametrize("name", ["index.html", "compare.html"])
def test_names_that_are_markup_come_out_as_text_on_the_pages(made, name):
    page = Page(made / name)
    assert page.open == []
    assert page.all("img") == []
    assert len(page.all("script")) == (2 if name == "compare.html" else 1)
    for shown in map(printable, HOSTILE):
        assert f"{shown} on {shown}" in page.inside("a")
    assert not any((a.get("href") or "").strip().lower().startswith("javascript") for a in page.all("a"))


def test_names_that_are_markup_come_back_from_the_data_of_a_page_the_list_and_the_feed(made):
    page = Page(made / "compare.html")
    data = json.loads(page.inside("script")[0])
    assert set(map(printable, HOSTILE)) <= {pair["tool"] for pair in data["pairs"]} & {
        one["law"] for one in data["sets"]
    }
    listed = json.loads((made / "cards.json").read_text("utf-8"))
    assert set(map(printable, HOSTILE)) <= {card["tool"] for card in listed["cards"]}
    terms = [e.get("term") for e in ET.parse(made / "atom.xml").getroot().iter(f"{ATOM}category")]  # noqa: S314
    for hostile in HOSTILE:
        assert " ".join(printable(hostile).split()) in [" ".join(term.split()) for term in terms]


def test_filters_hold_names_as_they_are_shown(made):
    values = [option.get("value") for option in Page(made / "index.html").all("option")]
    assert set(map(printable, HOSTILE)) <= set(values)
    held = [json.loads(row["data-laws"]) for row in Page(made / "index.html").all("tr") if "data-laws" in row]
    assert all([printable(name)] in held for name in HOSTILE)


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["a", "a-b", "a-00000000"]), st.integers(0, 3)), unique=True, max_size=8))
def test_slugs_are_always_different(named):
    entries = [
        CardEntry(slug=slug, title="x", summary="", tool="x", work="x", simulated=True,
              content_sha256=f"{k:08d}{number:056d}")
        for number, (slug, k) in enumerate(named)
    ]  # fmt: skip
    slugs = [e.slug for e in with_slugs(entries)]
    assert len(set(slugs)) == len(slugs)


# --- the same again, whole or not at all


@pytest.mark.slow
def test_one_job_and_two_write_the_same_bytes(pairs, made, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "FEW", 2)
    heard = []
    publishing.publish(pairs, tmp_path / "two", jobs=2, progress=heard.append)
    assert content(tmp_path / "two") == content(made)
    assert heard[-1] == f"{4 + len(HOSTILE)} of {4 + len(HOSTILE)} cards"


def test_what_a_card_leaves_behind_is_freed_before_the_next():
    """A page that was rendered refers to itself; the command runs without the collector of such cycles."""

    class Page:
        itself = None

    left = []

    def work(piece):
        assert [ref() for ref in left] == [None] * piece
        page = Page()
        page.itself = page
        left.append(weakref.ref(page))
        return piece

    collecting = gc.isenabled()
    gc.disable()
    try:
        assert pool.each(work, range(4), 1, lambda done: None) == [0, 1, 2, 3]
    finally:
        if collecting:
            gc.enable()


def test_the_same_site_again_is_unchanged_and_another_needs_force(tmp_path):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "one", law())
    assert not publishing.publish(pairs, out).unchanged
    assert publishing.publish(pairs, out).unchanged
    add(pairs, "two", law(0.9))
    before = content(out)
    with pytest.raises(UsageError, match="holds another site; replace it with --force"):
        publishing.publish(pairs, out)
    assert content(out) == before
    assert len(publishing.publish(pairs, out, force=True).cards) == 2
    assert len(list((out / "cards").iterdir())) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pairs", "site"]


def test_a_law_is_read_once_and_set_up_once_for_the_figures_of_a_card(tmp_path, monkeypatch):
    add(tmp_path / "pairs", "one", law(0.5), law(0.8, response="VB"))
    counts = Counter()

    def counted(module, name):
        of = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *args: (counts.update([name]), of(*args))[1])

    counted(pair, "read")
    counted(figure_texts, "profiled")
    counted(figure_texts, "limits_of")
    publishing.publish(tmp_path / "pairs", tmp_path / "site")
    assert counts == {"read": 1, "profiled": 2, "limits_of": 2}  # limits: for texts and for curves


@pytest.fixture
def written(monkeypatch):
    """Names of the pairs whose cards are written, not copied."""
    names = []
    monkeypatch.setattr(build, "review", lambda task: (names.append(task.name), pair.review(task))[1])
    return names


def test_a_pair_that_did_not_change_is_not_written_again(tmp_path, written):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    for name, exponent in (("one", 0.5), ("two", 0.9), ("three", 0.7)):  # of one tool and work: with suffixes
        add(pairs, name, law(exponent))
    publishing.publish(pairs, out)
    assert publishing.publish(pairs, out).unchanged
    assert sorted(written) == ["one", "three", "two"]  # once each
    (pairs / "two" / "params.json").unlink()
    add(pairs, "four", law(0.4), tool="CNMG")
    toml = pairs / "one" / "card.toml"
    toml.write_text(toml.read_text("utf-8").replace("dry", "wet"), encoding="utf-8")
    del written[:]
    publishing.publish(pairs, out, force=True)
    assert sorted(written) == ["four", "one"]
    publishing.publish(pairs, tmp_path / "anew")
    assert content(out) == content(tmp_path / "anew")


@pytest.mark.parametrize(
    "change",
    [
        lambda home: (home / "params.json").write_bytes((home / "params.json").read_bytes() + b"\n"),
        lambda home: (home / "card.toml").write_bytes(b'title = "Another"\n' + (home / "card.toml").read_bytes()),
        lambda home: (home.parent / "card.toml").write_text('doi = "10.1000/182"\n'),
        lambda home: ((home / "figures").mkdir(), (home / "figures" / "bode.png").write_bytes(b"a picture")),
        lambda home: (home / "params-draws-0123456789ab.npz").write_bytes(b"draws"),
    ],
)
def test_a_card_is_written_again_where_what_it_is_made_from_changed(tmp_path, written, change):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    home = add(pairs, "one", law())
    publishing.publish(pairs, out)
    change(home)
    publishing.publish(pairs, out, force=True)
    publishing.publish(pairs, tmp_path / "anew")
    assert written == ["one"] * 3
    assert content(out) == content(tmp_path / "anew")


@pytest.mark.parametrize(
    "damage",
    [
        lambda card: (card / "index.html").unlink(),
        lambda card: (card / "index.html").write_bytes(b"<p>damaged"),
        lambda card: (card / "more.html").write_bytes(b"added"),
        lambda card: [path.unlink() for path in card.iterdir()],
    ],
)
def test_a_card_that_was_changed_in_the_site_is_written_again(tmp_path, written, damage):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "one", law())
    publishing.publish(pairs, out)
    before = content(out)
    damage(out / "cards" / "gc435-709m40")
    publishing.publish(pairs, out, force=True)
    assert written == ["one", "one"]
    assert content(out) == before


@pytest.mark.parametrize(
    ("field", "value"),
    [("slug", "../gc435-709m40"), ("slug", "."), ("slug", 3), ("made_from", "0" * 64), ("files", {"../x": "0" * 64})],
)
def test_an_entry_that_does_not_agree_with_its_folder_is_not_used(tmp_path, written, field, value):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "one", law())
    publishing.publish(pairs, out)
    before = content(out)
    listed = json.loads(before["cards.json"])
    listed["cards"][0][field] = value
    (out / "cards.json").write_text(json.dumps(listed), encoding="utf-8")
    publishing.publish(pairs, out, force=True)
    assert written == ["one", "one"]
    assert content(out) == before


def test_cards_of_other_code_and_of_a_draft_are_written_again(tmp_path, written, monkeypatch):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "one", law())
    publishing.publish(pairs, out, draft=True)
    publishing.publish(pairs, out)
    monkeypatch.setattr(pair, "writer_digest", lambda: "of another version")
    publishing.publish(pairs, out, force=True)
    assert written == ["one"] * 3


def test_what_others_keep_in_the_folder_stays_and_a_card_that_is_gone_goes(tmp_path):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "one", law())
    add(pairs, "two", law(0.9), tool="CNMG")
    publishing.publish(pairs, out)
    (out / "CNAME").write_text("cards.example.org")
    (pairs / "two" / "params.json").unlink()
    publishing.publish(pairs, out, force=True)
    assert (out / "CNAME").read_text() == "cards.example.org"
    assert [path.name for path in (out / "cards").iterdir()] == ["gc435-709m40"]


def test_a_site_among_its_pairs_is_not_published_again(tmp_path):
    add(tmp_path, "one", law())
    publishing.publish(tmp_path, tmp_path / "site")
    assert publishing.publish(tmp_path, tmp_path / "site").unchanged


@pytest.mark.parametrize("when", [1, 3])
def test_an_interrupt_leaves_the_old_site_and_nothing_beside_it(tmp_path, when):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "one", law())
    publishing.publish(pairs, out)
    for k in range(3):
        add(pairs, f"more{k}", law(0.1 * k), tool="CNMG")
    before = content(out)

    def reported(words):
        if words.startswith(f"{when} of"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        publishing.publish(pairs, out, force=True, progress=reported)
    assert content(out) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pairs", "site"]


def test_a_failure_while_the_site_is_put_in_its_place_puts_the_old_one_back(pairs, tmp_path, monkeypatch):
    """The new site cannot be renamed; then it can, and what others keep in the folder stays there."""
    out, real = tmp_path / "site", os.rename
    publishing.publish(pairs, out)
    (out / "CNAME").write_text("example.org")
    before = content(out)

    def fails(source, target):
        if Path(target) == out and Path(source).name == "made":
            raise OSError(5, "input/output error")
        real(source, target)

    monkeypatch.setattr(os, "rename", fails)
    with pytest.raises(UsageError, match="the site cannot be written: input/output error"):
        publishing.publish(pairs, out, title="Other", force=True)
    assert content(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
    monkeypatch.undo()
    publishing.publish(pairs, out, title="Other", force=True)
    assert content(out)["CNAME"] == before["CNAME"]
    assert content(out)["index.html"] != before["index.html"]


def test_a_damaged_list_of_a_site_is_named(tmp_path):
    add(tmp_path / "pairs", "one", law())
    out = tmp_path / "site"
    publishing.publish(tmp_path / "pairs", out)
    content = (out / "cards.json").read_bytes()
    for damaged in (content[:50], b"", b"[" * 100_000, b"9" * 5000):
        (out / "cards.json").write_bytes(damaged)
        with pytest.raises(UsageError, match=r"cards\.json: is damaged"):
            publishing.publish(tmp_path / "pairs", out)


def test_a_folder_of_somebody_else_is_not_replaced_even_by_force(tmp_path):
    add(tmp_path / "pairs", "one", law())
    out = tmp_path / "site"
    out.mkdir()
    (out / "index.html").write_text("mine")
    with pytest.raises(UsageError, match=r"holds index\.html that fitmodels publish did not write"):
        publishing.publish(tmp_path / "pairs", out, force=True)
    assert (out / "index.html").read_text() == "mine"


@pytest.mark.parametrize(
    ("folder", "to", "kind", "words"),
    [
        ("nowhere", "site", UsageError, "is no folder"),
        (".", "site", DataError, r"holds no params\.json; fit first"),
        ("pairs", "pairs", UsageError, "the site would be inside the folder of its pairs"),
        ("pairs", "file", UsageError, "is a file"),
        ("pairs", "file/site", UsageError, "cannot be written"),
    ],
)
def test_what_cannot_be_published_is_said(tmp_path, folder, to, kind, words):
    add(tmp_path / "elsewhere" / "pairs", "one", law())
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "file").write_text("")
    top = tmp_path / "elsewhere" if folder == "pairs" else tmp_path / "here"
    where = top / to if to == "pairs" else tmp_path / "here" / to
    with pytest.raises(kind, match=words):
        publishing.publish(top / folder, where)


def test_everything_is_refused_in_one_go_and_what_is_missing_is_asked_for(tmp_path):
    pairs, out = tmp_path / "pairs", tmp_path / "site"
    add(pairs, "good", law())
    add(pairs, "twin", law())
    (add(pairs, "bare", law(0.7)) / "card.toml").unlink()
    (add(pairs, "broken", law(0.8)) / "params.json").write_text("{")
    (add(pairs, "toml", law(0.9)) / "card.toml").write_text("licence = 'x'")
    changed = add(pairs, "changed", law(1.1)) / "params.json"
    changed.write_text(changed.read_text().replace("data.csv", "else.csv"))
    before = content(pairs)
    report = publishing.publish(pairs, out)
    assert not report.ok
    assert [(p.folder, p.kind) for p in report.problems] == [
        ("bare", "field"), ("broken", "unreadable"), ("changed", "check"), ("toml", "unreadable"), ("twin", "twice"),
    ]  # fmt: skip
    said = {p.folder: p.words for p in report.problems}
    assert said["bare"] == "missing: license, authors, contact, machine, iso513, setup, sensors; add them in card.toml."
    assert said["broken"].startswith("params.json: is not JSON at line 1")
    assert "did you mean license?" in said["toml"]
    assert "content was changed after it was written" in said["changed"]
    assert said["twin"] == "same content as good: publish one of the two."
    assert [path.relative_to(pairs).as_posix() for path in report.templates] == ["bare/card.toml"]
    assert not out.exists()
    after = content(pairs)
    assert "license" in after.pop("bare/card.toml").decode()
    assert after == before
    assert publishing.check(pairs).problems == report.problems


def test_what_all_of_many_lack_is_asked_for_once_above_them(tmp_path):
    pairs = tmp_path / "pairs"
    for number, name in enumerate(("a", "b", "c")):
        (add(pairs, name, law(0.5 + 0.1 * number)) / "card.toml").unlink()
    (pairs / "c" / "card.toml").write_text('machine = "another lathe"\niso513 = "M10"\n', encoding="utf-8")
    report = publishing.check(pairs)
    assert [path.relative_to(pairs).as_posix() for path in report.templates] == ["card.toml"]
    asked = (pairs / "card.toml").read_text("utf-8")
    assert "all of the 2 cards below" in asked
    assert 'license = ""' in asked
    assert "iso513 =" not in asked  # that of the material: asked beside each pair
    assert publishing.check(pairs).templates == ()  # it is asked for already
    assert not (pairs / "a" / "card.toml").exists()
    (pairs / "card.toml").write_text(TOML.replace('iso513 = "{group}"\n', ""), encoding="utf-8")
    again = publishing.check(pairs)
    assert [(p.folder, p.fields) for p in again.problems] == [("a", ("iso513",)), ("b", ("iso513",))]
    assert [path.parent.name for path in again.templates] == ["a", "b"]
    for name in ("a", "b"):
        text = 'iso513 = "P20"\nlicense = ""\nno_sensors = ""\nauthors = []\n'  # what is left open hides nothing
        (pairs / name / "card.toml").write_text(text, encoding="utf-8")
    report = publishing.publish(pairs, tmp_path / "site")
    assert report.problems == ()
    found = (tmp_path / "site").rglob("card.json")
    machines = {json.loads(path.read_text("utf-8"))["identity"]["machine"] for path in found}
    assert machines == {"a lathe", "another lathe"}


def test_a_fault_in_the_card_toml_above_is_reported_of_every_pair(tmp_path):
    pairs = tmp_path / "pairs"
    add(pairs, "a", law())
    (pairs / "card.toml").write_text("licence = 'x'", encoding="utf-8")
    (problem,) = publishing.check(pairs).problems
    assert "did you mean license?" in problem.words


def test_a_sensor_of_a_pair_hides_the_reason_above_for_having_none(tmp_path):
    pairs = tmp_path / "pairs"
    home = add(pairs, "a", law())
    (home / "card.toml").write_text('iso513 = "P20"\n[[sensors]]\nsymbol = "AW"\nunit = "mm"\n', encoding="utf-8")
    (pairs / "card.toml").write_text(TOML.replace('iso513 = "{group}"\n', ""), encoding="utf-8")
    assert publishing.check(pairs).ok


def test_figures_and_draws_that_a_card_speaks_of_go_with_it(tmp_path):
    home = add(tmp_path / "pairs", "one", law())
    (home / "figures").mkdir()
    (home / "figures" / "residuals.png").write_bytes(b"\x89PNG")
    (home / "private.csv").write_text("not for others")
    report = publishing.publish(tmp_path / "pairs", tmp_path / "site")
    card = tmp_path / "site" / "cards" / report.cards[0].slug
    assert {p.relative_to(card).as_posix() for p in card.rglob("*") if p.is_file()} == {
        *OF_A_CARD, "figures/residuals.png",
    }  # fmt: skip


def test_a_site_passes_by_hidden_folders(tmp_path):
    add(tmp_path, "one", law())
    add(tmp_path, ".fitmodels-stage/one", law(0.9))
    assert publishing.check(tmp_path).found == 1


def test_results_come_in_the_order_of_the_work():
    assert pool.each(abs, [-3, 2, -1], 1, lambda done: None) == [3, 2, 1]
