"""The page of a card in Chromium: sliders by keyboard, no request, no script, no serious fault that axe-core knows.

axe-core is Deque's (https://github.com/dequelabs/axe-core, rules of WCAG 2); it comes with axe-playwright-python.
"""

import re

import numpy as np
import pandas as pd
import pytest
from fitmodels import cards, datasets, fit, parameters
from fitmodels.cards.content.card import compose
from fitmodels.cards.content.profiler import profile_all
from fitmodels.cards.forms.page import page_html, value_texts
from fitmodels.core.rounding import format_plain
from fitmodels.fit.regression import fit_form

pytestmark = pytest.mark.browser

PHONE, DESKTOP, NARROW = {"width": 390, "height": 844}, {"width": 1280, "height": 900}, {"width": 360, "height": 740}
HOSTILE = "</script><img src=http://192.0.2.1/x onerror=alert(1)>"


@pytest.fixture(scope="module")
def wear():
    """Laws of wear, force and power of the bundled set."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs)
    return parameters.collect(
        tool="GC435", work="709M40 (En 19)", design=runs, laws=laws, tool_life=fit.tool_life(laws[0], 0.3),
        simulated=True, note="drawn from published laws", command="fitmodels data.csv", data_sha256="5" * 64,
    )  # fmt: skip


@pytest.fixture(scope="module")
def drive():
    """Dynamics of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18, under a name that is markup."""
    model = {
        "b": [0.0, 0.0611, -0.1338, 0.0752], "a": [1.0, -2.0311, 1.2104, -0.1655], "nk": 1, "sample_time": 0.02,
        "unit_u": "V", "unit_y": "A", "band": [0.1, 5.0], "uncertainty": {"kind": "none", "reason": "given"},
    }  # fmt: skip
    return parameters.collect(tool=HOSTILE, work="S45C", dynamics=model, command=HOSTILE)


@pytest.fixture
def opened(chromium, tmp_path):
    """Open the page of a parameter file; what it asked for, and what its console said, end up in two lists."""
    contexts, heard = [], {"requests": [], "console": []}

    def open_page(pf, **options):
        file = tmp_path / f"{len(contexts)}.html"
        file.write_text(page_html(compose(pf), pf), encoding="utf-8")
        context = chromium.new_context(**options)
        contexts.append(context)
        tab = context.new_page()
        tab.on("request", lambda request: heard["requests"].append(request.url))
        tab.on("console", lambda message: heard["console"].append(message.text))
        tab.on("pageerror", lambda error: heard["console"].append(str(error)))
        tab.on("dialog", lambda dialog: heard["console"].append(f"dialog {dialog.message}"))
        tab.goto(file.as_uri())
        return tab

    yield open_page, heard
    for context in contexts:
        context.close()


def shown(tab, pf, at):
    """Whether the page shows what ``profile`` says at a point, for each law."""
    card = compose(pf)
    for i, (response, answer) in enumerate(profile_all(card.profiler, at).items()):
        value, low, high = value_texts(answer)
        row = tab.locator(f"#answer-{i}")
        assert row.locator("th var").first.inner_text() == response
        assert row.locator(".value").inner_text() == value
        assert row.locator(".band").inner_text() == f"{low} to {high}"


def slider_value(tab, i):
    return float(tab.locator(f"#value-{i}").inner_text().split()[0])


def test_a_slider_moved_by_keyboard_changes_the_predictions_to_what_profile_says(opened, wear):
    tab = opened[0](wear)
    profiler = compose(wear).profiler
    at = dict(profiler.start)
    shown(tab, wear, at)
    for i, presses in enumerate(
        ([("ArrowRight", 30)], [("ArrowLeft", 7)], [("PageDown", 1)], [("End", 1), ("ArrowLeft", 60)])
    ):
        tab.locator(f"#slider-{i}").focus()
        for key, times in presses:
            for _ in range(times):
                tab.keyboard.press(key)
        symbol = profiler.factors[i].symbol
        before, at[symbol] = at[symbol], slider_value(tab, i)
        assert at[symbol] != before
        assert tab.locator(f"#slider-{i}").get_attribute("aria-valuetext") == tab.locator(f"#value-{i}").inner_text()
        shown(tab, wear, at)
    removal = float(tab.locator("#answer-removal .value").inner_text())
    assert removal == pytest.approx(1000 * at["V"] * at["f"] * at["d"], rel=5e-4)
    tab.get_by_role("button", name="Reset to the middle").press("Enter")
    shown(tab, wear, profiler.start)


def positions(tab):
    """Texts of each slider at its 241 positions, with the values and bands: lines by slider."""
    return tab.evaluate(
        """() => [...document.querySelectorAll('input[type=range]')].map((slider, i) => {
          const seen = [];
          const cells = [...document.querySelectorAll('.answers tr[id] .value, .answers tr[id] .band')];
          for (let k = 0; k <= 240; k++) {
            slider.value = k;
            slider.dispatchEvent(new Event('input'));
            seen.push([document.getElementById('value-' + i), ...cells].map((e) => e.textContent));
          }
          document.getElementById('profiler-reset').click();
          return seen;
        })"""
    )


@pytest.fixture(scope="module")
def forms():
    """Laws of five forms on V, f and wear."""
    rng = np.random.default_rng(3)
    V, f, VB = (rng.uniform(low, high, 60) for low, high in ((80, 250), (0.1, 0.4), (0.02, 0.3)))
    force = (900 * f**0.7 * (V / 100) ** -0.1 + 800 * VB)[:, None] * np.exp(0.05 * rng.standard_normal((60, 5)))
    frame = pd.DataFrame({"V": V, "f": f, "VB": VB}).join(pd.DataFrame(force, columns=["Fc", "Ff", "Fp", "Fx", "Fy"]))
    runs = datasets.runs_from_frame(frame)
    chosen = ("additive_wear", "second_order", "linear", "second_order_original", "power_exponential")
    laws = [
        fit_form(runs, form, name, ["V", "f", "VB"])
        for form, name in zip(chosen, ("Fc", "Ff", "Fp", "Fx", "Fy"), strict=True)
    ]
    return parameters.collect(tool="a", work="b", design=runs, laws=laws)


def test_every_form_of_law_is_computed_by_the_page_as_by_profile(opened, forms):
    tab, profiler = opened[0](forms), compose(forms).profiler
    for factor, seen in zip(profiler.factors, positions(tab), strict=True):
        for line in seen[::40]:
            at = {**profiler.start, factor.symbol: float(line[0].split()[0])}
            expected = [value_texts(answer) for answer in profile_all(profiler, at).values()]
            assert line[1:] == [text for value, low, high in expected for text in (value, f"{low} to {high}")]


def test_every_step_of_every_slider_says_what_profile_says(opened, wear):
    """All 241 positions of each, set by the page's own script in one go; ends of the tests are among them."""
    tab = opened[0](wear)
    profiler = compose(wear).profiler
    found = positions(tab)
    for factor, seen in zip((*profiler.factors, *profiler.wears), found, strict=True):
        values = [float(line[0].split()[0]) for line in seen]
        assert values == sorted(values)
        assert {factor.low.value, factor.high.value} <= set(values)
        assert values[0] == pytest.approx(factor.low.value / 1.2, rel=0.01)
        assert values[-1] == pytest.approx(factor.high.value * 1.2, rel=0.01)
        for value, line in zip(values, seen, strict=True):
            answers = profile_all(profiler, {**profiler.start, factor.symbol: value}).values()
            reported = [
                text for answer in answers for v, low, high in [value_texts(answer)] for text in (v, f"{low} to {high}")
            ]
            assert line[1:-1] == reported, (factor.symbol, value)


def test_a_wear_is_taken_from_its_own_law_or_held_at_its_slider(opened, wear):
    tab, profiler = opened[0](wear), compose(wear).profiler
    assert not tab.locator("#slider-4").is_visible()
    tab.get_by_label("held at a value of its own").check()
    for _ in range(40):
        tab.locator("#slider-4").press("ArrowRight")
    at = {**profiler.start, "AW": slider_value(tab, 4)}
    assert at["AW"] > profiler.start["AW"]
    for i, (value, low, high) in enumerate(map(value_texts, profile_all(profiler, at, held=True).values())):
        assert tab.locator(f"#answer-{i} .value").inner_text() == value
        assert tab.locator(f"#answer-{i} .band").inner_text() == f"{low} to {high}"
    tab.get_by_label("from its own law at these settings").check()
    shown(tab, wear, profiler.start)


def test_outside_the_tested_region_numbers_are_marked_and_a_sentence_says_so(opened, wear):
    tab = opened[0](wear)
    assert tab.locator("#profiler-where").inner_text() == "Inside the tested region."
    tab.locator("#slider-0").press("End")
    words = tab.locator("#profiler-where").inner_text().replace("\u00a0", " ")
    assert words.startswith("Outside the tested region of AW, ")
    assert "V 240 m/min is above 200 m/min, the highest tested" in words
    row = tab.locator("#answer-0")
    assert "out" in row.get_attribute("class")
    assert row.locator(".tested").inner_text() == "no"
    tab.locator("#profiler-status", has_text="Outside").wait_for(state="attached")
    assert tab.locator("#profiler-status").get_attribute("aria-live") == "polite"


def test_a_corner_that_nobody_cut_is_outside_although_every_range_holds_it(opened, wear):
    """A central composite design has no runs at the corners of its outer ranges."""
    tab = opened[0](wear)
    profiler = compose(wear).profiler
    for i, factor in enumerate(profiler.factors[:3]):
        tab.locator(f"#slider-{i}").press("End")
        while slider_value(tab, i) > factor.high.value:
            tab.locator(f"#slider-{i}").press("ArrowLeft")
        assert slider_value(tab, i) == factor.high.value
    words = tab.locator("#profiler-where").inner_text()
    assert "Outside the tested region of AW" in words
    assert "farther from the centre of the tests than any test" in words


def test_no_request_leaves_the_page_and_its_console_stays_empty(opened, wear, drive):
    open_page, heard = opened
    for pf in (wear, drive):
        tab = open_page(pf)
        tab.wait_for_load_state("networkidle")
    assert len(heard["requests"]) == 2
    assert all(url.startswith(("file:", "data:")) for url in heard["requests"])
    assert heard["console"] == []


def test_without_scripts_the_predictions_stand_in_a_table(opened, wear):
    tab = opened[0](wear, java_script_enabled=False)
    assert tab.locator("#profiler-table").is_visible()
    assert not tab.locator("#profiler-live").is_visible()
    assert tab.locator("button:visible").count() == 0
    profiler = compose(wear).profiler
    first = tab.locator("#profiler-table tbody tr").first.inner_text()
    for answer in profile_all(profiler, profiler.start).values():
        value, low, high = value_texts(answer)
        assert re.search(rf"{re.escape(value)}\s*{re.escape(low)} to {re.escape(high)}", first)
    assert all(format_plain(profiler.start[f.symbol], 4) in first for f in profiler.factors)


def test_print_shows_the_table_instead_of_the_sliders_and_is_light(opened, wear):
    tab = opened[0](wear, color_scheme="dark")
    tab.emulate_media(media="print")
    assert tab.locator("#profiler-table").is_visible()
    assert not tab.locator("#profiler-live").is_visible()
    assert not tab.locator("nav").is_visible()
    assert tab.locator("#provenance pre").first.inner_text() == "fitmodels data.csv"  # of a fold that is closed
    tab.pdf()
    assert tab.locator("details:not([open])").count() == 0  # for browsers whose styles cannot open it
    assert tab.evaluate("getComputedStyle(document.documentElement).backgroundColor") == "rgb(255, 255, 255)"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [PHONE, DESKTOP], ids=["phone", "desktop"])
@pytest.mark.parametrize("which", ["wear", "drive"])
def test_axe_finds_no_serious_fault(opened, axe, request, which, viewport, scheme):
    tab = opened[0](request.getfixturevalue(which), viewport=viewport, color_scheme=scheme)
    if which == "wear":
        tab.locator("#slider-0").press("End")  # grey numbers and the warning are judged too
    found = axe().run(tab).response["violations"]
    assert [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in ("serious", "critical")] == []


@pytest.mark.parametrize("viewport", [NARROW, PHONE, DESKTOP], ids=["360 px", "phone", "desktop"])
def test_the_page_does_not_scroll_sideways(opened, wear, drive, viewport):
    for pf in (wear, drive):
        tab = opened[0](pf, viewport=viewport)
        assert tab.evaluate("document.documentElement.scrollWidth") <= viewport["width"]


def test_text_of_figures_is_no_smaller_than_10_px_on_a_phone(opened, wear):
    tab = opened[0](wear, viewport=NARROW)
    sizes = tab.evaluate(
        "[...document.querySelectorAll('svg.panel')]"
        ".map((s) => 11 * s.getBoundingClientRect().width / s.viewBox.baseVal.width)"
    )
    assert len(sizes) >= 4
    assert min(sizes) >= 10


def test_a_name_that_is_markup_runs_nothing_and_is_copied_as_it_is(opened, drive):
    open_page, heard = opened
    tab = open_page(drive)
    assert tab.locator("img").count() == 0
    assert tab.locator("h1").inner_text() == f"{HOSTILE} on S45C"
    tab.locator("#provenance summary").first.click()
    assert tab.locator("#copy-command").inner_text() == HOSTILE
    tab.get_by_role("button", name="Copy the command").click()
    tab.locator("#copy-status", has_text=re.compile(r"\w")).wait_for(state="attached")
    assert heard["console"] == []


def test_the_widget_of_a_notebook_runs_in_its_frame_without_a_network(chromium, tmp_path, wear):
    """As a notebook shows it: HTML in the page, the frame without the origin of the notebook."""
    file = tmp_path / "notebook.html"
    file.write_text(f"<!DOCTYPE html><body>{cards.profiler(wear)._repr_html_()}</body>", encoding="utf-8")
    tab = chromium.new_page(viewport={"width": 820, "height": 900})
    asked = []
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(file.as_uri())
    frame = tab.frame_locator("iframe")
    before = frame.locator("#answer-0 .value").inner_text()
    frame.locator("#slider-0").focus()
    frame.locator("#slider-0").press("End")
    assert frame.locator("#answer-0 .value").inner_text() != before
    assert "Outside the tested region" in frame.locator("#profiler-where").inner_text()
    assert "usable" in frame.locator("#answer-0 .badge").inner_text()
    assert frame.locator("html").evaluate("e => e.scrollHeight <= e.clientHeight")  # the frame is as high as its page
    assert {url for url in asked if not url.startswith("data:")} <= {file.as_uri(), "about:srcdoc"}
    tab.close()
