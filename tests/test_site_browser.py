"""The pages of a site in Chromium: search, filters, order, and which of fifty exponents differ.

axe-core is Deque's (https://github.com/dequelabs/axe-core, rules of WCAG 2); it comes with axe-playwright-python.
Welch's test is scipy's ``ttest_ind_from_stats``, Holm's adjusted p values are statsmodels'.
"""

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cards import publishing
from fitmodels.cards.publishing.entries import CardEntry
from fitmodels.cards.publishing.pages import compare_page
from fitmodels.core.verdict import LEVELS
from scipy.stats import ttest_ind_from_stats
from statsmodels.stats.multitest import multipletests

pytestmark = pytest.mark.browser

PHONE, DESKTOP, NARROW = {"width": 390, "height": 844}, {"width": 1280, "height": 900}, {"width": 360, "height": 740}
HOSTILE = "</script><img src=http://192.0.2.1/x onerror=alert(1)>"
SE, ALIKE, APART = 0.05, 0.5, 1.0
FAR = {k for k in range(50) if k % 5 == 4}  # ten of fifty lie seven standard errors of a difference away
DIGITS = 1e-4  # of a p value: the page holds seven digits of each exponent
TOML = """license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "none, simulated"
setup = "none, simulated"
no_sensors = "simulated"
iso513 = "{group}"
"""


def law(response, exponents, df):
    return {
        "form": "power", "response": response, "quantity": "average wear", "unit": "mm",
        "equation": f"{response} = 0.01 V^{exponents[0]:.6g} f^{exponents[1]:.6g}", "error": "multiplicative",
        "coefficients": {"c0": 0.01, "V": exponents[0], "f": exponents[1]},
        "standard_errors": {"c0": 0.002, "V": SE, "f": SE},
        "factors": [
            {"symbol": "V", "quantity": "cutting speed", "unit": "m/min", "low": 50.0, "high": 200.0},
            {"symbol": "f", "quantity": "feed", "unit": "mm/rev", "low": 0.1, "high": 0.4},
        ],
        "uncertainty": {"kind": "covariance", "of": ["ln c0", "V", "f"],
                        "matrix": np.diag([0.04, SE**2, SE**2]).tolist(), "df": df},
        "residual_se": 0.1, "residual_scale": "ln", "n": df + 3, "df": df,
    }  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Fifty simulated pairs: ten tools, five work materials; exponents of AW in V and each pair's df, by slug."""
    folder = tmp_path_factory.mktemp("pairs")
    rng = np.random.default_rng(9)
    truth = {}
    for k in range(50):
        tool, work = f"insert {k // 5 + 1}", HOSTILE if k % 5 == 3 else f"work {'PMKNS'[k % 5]}"
        V = (APART if k in FAR else ALIKE) + SE * float(rng.normal())
        df = 12 + k
        laws = {"AW": law("AW", (V, 0.2), df)} | ({"VB": law("VB", (0.3, 0.4), df)} if k < 7 else {})
        pf = parameters.ParameterFile.model_validate({
            "identity": {"tool": tool, "work": work, "simulated": k % 2 == 0}, "laws": laws,
            "provenance": {"fitmodels": "0.1.0", "data_file": "data.csv", "data_sha256": "a" * 64},
        })  # fmt: skip
        home = folder / f"{k:02d}"
        home.mkdir()
        parameters.write(pf, home / "params.json")
        (home / "card.toml").write_text(TOML.format(group="PMKNS"[k % 5]), encoding="utf-8")
        truth[tool, work] = (k, V, df)
    out = tmp_path_factory.mktemp("out") / "site"
    report = publishing.publish(folder, out)
    assert report.problems == ()
    return out, {card.slug: truth[card.tool, card.work] for card in report.cards}


@pytest.fixture
def opened(chromium, made):
    """Open a page of the site; what it asked for, and what its console said, end up in two lists."""
    contexts, heard = [], {"requests": [], "console": []}

    def open_page(name, **options):
        context = chromium.new_context(**options)
        contexts.append(context)
        tab = context.new_page()
        tab.on("request", lambda request: heard["requests"].append(request.url))
        tab.on("console", lambda message: heard["console"].append(message.text))
        tab.on("pageerror", lambda error: heard["console"].append(str(error)))
        tab.on("dialog", lambda dialog: heard["console"].append(f"dialog {dialog.message}"))
        path, _, fragment = name.partition("#")
        tab.goto(f"{(made[0] / path).as_uri()}{'#' if fragment else ''}{fragment}")
        return tab

    yield open_page, heard
    for context in contexts:
        context.close()


def titles(tab):
    return tab.locator("#cards tbody tr:visible th a").all_inner_texts()


def drawn(tab):
    """Slug -> class, of the rows in their order."""
    rows = tab.locator("#forest li")
    return rows.evaluate_all("rows => rows.map((row) => [row.dataset.slug, row.className])")


# --- index


def test_the_search_box_keeps_the_rows_that_hold_every_word(opened):
    tab = opened[0]("index.html")
    assert len(titles(tab)) == 50
    tab.locator("#search").fill("WORK p insert 3")
    assert titles(tab) == ["insert 3 on work P"]
    assert tab.locator("#count").inner_text() == "1 of 50 cards"
    tab.locator("#search").fill("no such thing")
    assert titles(tab) == []
    assert "matches the filters" in tab.locator("#count").inner_text()


@pytest.mark.parametrize(
    ("filters", "left"),
    [
        ({"group": "N"}, 10),
        ({"tool": "insert 2"}, 5),
        ({"work": HOSTILE}, 10),
        ({"law": "VB"}, 7),
        ({"kind": "simulated"}, 25),
        ({"kind": "measured", "law": "VB"}, 3),
        ({"group": "P", "tool": "insert 10"}, 1),
    ],
)
def test_filters_keep_the_rows_that_they_name(opened, filters, left):
    tab = opened[0]("index.html")
    for name, value in filters.items():
        tab.locator(f"#{name}").select_option(value)
    assert len(titles(tab)) == left


def test_a_heading_sorts_the_rows_and_again_the_other_way(opened):
    tab = opened[0]("index.html")
    heading = tab.get_by_role("columnheader", name="Tool")
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    first = titles(tab)
    assert [title.split(" on ")[0] for title in first] == [f"insert {k}" for k in range(1, 11) for _ in range(5)]
    heading.get_by_role("button").press("Enter")
    assert heading.get_attribute("aria-sort") == "descending"
    assert titles(tab)[0].startswith("insert 10 on")
    tab.get_by_role("button", name="Rows").click()
    assert tab.locator("#cards tbody tr td:nth-child(7)").first.inner_text() == "15 rows"


def test_a_link_of_the_index_opens_the_card_and_the_card_leads_back(opened):
    tab = opened[0]("index.html")
    tab.get_by_role("link", name="insert 3 on work P").click()
    assert tab.locator("h1").inner_text() == "insert 3 on work P"
    tab.get_by_role("link", name="All cards").click()
    assert len(titles(tab)) == 50


# --- compare


def test_a_reference_marks_the_pairs_that_differ_by_construction(opened, made):
    """Marks, p and Holm's adjusted p are those of scipy and statsmodels; none of the alike is marked after Holm."""
    tab = opened[0]("compare.html")
    assert {kind for _, kind in drawn(tab)} == {"plain"}
    truth = made[1]
    reference = next(slug for slug, (k, _, _) in truth.items() if k == 0)
    tab.locator("#reference").select_option(reference)
    rows = drawn(tab)
    assert rows[0] == [reference, "reference"]
    kinds = dict(rows)
    far = {slug for slug, (k, _, _) in truth.items() if k in FAR}
    assert {slug for slug, kind in kinds.items() if kind == "all"} == far

    others = [slug for slug in truth if slug != reference]
    V0, df0 = truth[reference][1:]
    p = [
        ttest_ind_from_stats(V, SE * np.sqrt(df + 1), df + 1, V0, SE * np.sqrt(df0 + 1), df0 + 1, equal_var=False)[1]
        for _, V, df in map(truth.get, others)
    ]
    adjusted = multipletests(p, method="holm")[1]
    for slug, alone, together in zip(others, p, adjusted, strict=True):
        row = tab.locator(f'#forest li[data-slug="{slug}"]')
        assert float(row.get_attribute("data-p")) == pytest.approx(alone, rel=DIGITS)
        assert float(row.get_attribute("data-adjusted")) == pytest.approx(together, rel=DIGITS)
        assert kinds[slug] == ("all" if together < 0.05 else "one" if alone < 0.05 else "plain")
    alone = sum(one < 0.05 for one in p)
    assert tab.locator("#comparison").inner_text() == (
        f"10 of 49 differ from insert 1 on work P, adjusted for 49 comparisons (Holm). Unadjusted {alone} differ, "
        "of which about 2.5 are expected by chance if all were equal."
    )


def test_each_exponent_has_the_verdict_on_its_law_and_pairs_of_one_name_their_files(chromium, tmp_path):
    numbers = {"estimate": {"value": 1.0, "text": "1.00"}, "low": {}, "high": {}}
    power = {"response": "P", "quantity": "power", "unit": "kW", "form": "power", "equation": "P = V"}
    entries = [
        CardEntry(
            slug=f"u-{level}", title="u on u", summary="", tool="u", work="u", simulated=False, content_sha256="0" * 64,
            data_file=f"{level}.csv", laws=({**power, "verdict": words, "exponents": ({"factor": "V", **numbers},)},),
        )
        for level, words in enumerate(LEVELS)
    ]  # fmt: skip
    (tmp_path / "compare.html").write_text(compare_page(entries, "Cards", draft=True), encoding="utf-8")
    tab = chromium.new_page()
    try:
        tab.goto((tmp_path / "compare.html").as_uri())
        names = [" ".join(one.split()) for one in tab.locator("#forest .name").all_inner_texts()]
        assert names == [
            "u on u 0.csv ✓ usable inside the tested region",
            "u on u 1.csv ! usable with reservations",
            "u on u 2.csv ✗ do not use for control",
        ]
        words = tab.locator("#forest .badge > span:last-child")
        assert [words.nth(k).evaluate("e => e.className") for k in range(3)] == ["hidden", "", ""]
        assert tab.locator("#reference option").all_inner_texts() == [
            "none", "u on u (0.csv)", "u on u (1.csv)", "u on u (2.csv)"
        ]  # fmt: skip
    finally:
        tab.close()


def test_the_rows_stand_by_value_by_name_or_by_difference(opened, made):
    tab = opened[0]("compare.html")
    by_value = [slug for slug, _ in drawn(tab)]
    assert by_value == sorted(made[1], key=lambda slug: -made[1][slug][1])
    tab.locator("#order").select_option("name")
    names = tab.locator("#forest .name a").all_inner_texts()
    assert [n.split(" on ")[0] for n in names] == [f"insert {k}" for k in range(1, 11) for _ in range(5)]
    tab.locator("#reference").select_option(by_value[30])
    tab.locator("#order").select_option("difference")
    t = tab.locator("#forest .verdict span[title]").evaluate_all("all => all.map((e) => parseFloat(e.title.slice(2)))")
    assert t == sorted(t, reverse=True)
    assert t[0] > 0 > t[-1]


def test_only_those_that_differ_can_be_shown_and_filters_count_in_holm(opened, made):
    reference = next(slug for slug, (k, _, _) in made[1].items() if k == 0)
    tab = opened[0](f"compare.html#reference={reference}&group=S")
    assert tab.locator("#more").get_attribute("open") is not None
    assert len(drawn(tab)) == 11
    assert tab.locator("#comparison").inner_text().startswith("10 of 10 differ from insert 1 on work P")
    tab.locator("#group").select_option("P")
    tab.locator("#shown").select_option("one")
    assert all(kind != "plain" for _, kind in drawn(tab))
    assert f"reference={reference}" in tab.url


def test_a_bar_spans_the_interval_and_all_rows_share_the_axis(opened, made):
    """Interval = value +- t se: on one axis a bar is as long as the quantile of its own df says."""
    from scipy.stats import t

    tab = opened[0]("compare.html", viewport=DESKTOP)
    found = tab.locator("#forest li").evaluate_all(
        "rows => rows.map((row) => [row.dataset.slug, row.querySelector('.bar').getBoundingClientRect().width,"
        " row.querySelector('.mark').getBoundingClientRect().x])"
    )
    slugs, widths, places = zip(*found, strict=True)
    values = np.array([made[1][slug][1] for slug in slugs])
    quantiles = np.array([t.ppf(0.975, made[1][slug][2]) for slug in slugs])
    scale = np.polyfit(values, places, 1)
    assert np.allclose(np.polyval(scale, values), places, atol=0.6)
    assert np.allclose(2 * quantiles * SE * scale[0], widths, atol=0.6)


def test_the_law_decides_which_exponents_there_are(opened):
    tab = opened[0]("compare.html")
    assert tab.locator("#law option").all_inner_texts() == ["AW, average wear", "VB, average wear"]
    tab.locator("#law").select_option("VB, average wear")
    tab.locator("#factor").select_option("f")
    assert len(drawn(tab)) == 7
    assert tab.locator("#forest .number b").first.inner_text() == "0.400"


def test_a_row_becomes_the_reference_by_keyboard_and_is_let_go(opened):
    tab = opened[0]("compare.html", viewport=DESKTOP)
    button = tab.get_by_role("button", name="reference: insert 4 on work P")
    button.press("Enter")
    assert drawn(tab)[0] == ["insert-4-work-p", "reference"]
    pressed = tab.locator('#forest button[aria-pressed="true"]')
    assert pressed.evaluate("e => e === document.activeElement")
    pressed.press("Enter")
    assert {kind for _, kind in drawn(tab)} == {"plain"}


# --- both


@pytest.mark.parametrize("name", ["index.html", "compare.html"])
def test_no_request_leaves_the_page_and_no_name_runs(opened, name):
    open_page, heard = opened
    tab = open_page(name)
    tab.wait_for_load_state("networkidle")
    assert tab.locator("img").count() == 0
    assert tab.get_by_text(HOSTILE).count() > 0
    assert len(heard["requests"]) == 1
    assert heard["console"] == []


def test_with_scripts_off_the_index_is_a_table_of_links_and_the_exponents_stand_in_tables(opened):
    tab = opened[0]("index.html", java_script_enabled=False)
    assert len(titles(tab)) == 50
    assert not tab.locator("#filters").is_visible()
    tab = opened[0]("compare.html", java_script_enabled=False)
    assert not tab.locator("#live").is_visible()
    assert tab.locator("#tables tbody tr:visible").count() == 57
    assert tab.locator("button:visible, select:visible").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [PHONE, DESKTOP], ids=["phone", "desktop"])
@pytest.mark.parametrize("name", ["index.html", "compare.html", "compare.html#reference=insert-1-work-p&group=S"])
def test_axe_finds_no_serious_fault(opened, axe, name, viewport, scheme):
    tab = opened[0](name, viewport=viewport, color_scheme=scheme)
    found = axe().run(tab).response["violations"]
    assert [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in ("serious", "critical")] == []


@pytest.mark.parametrize("viewport", [NARROW, PHONE, DESKTOP], ids=["360 px", "phone", "desktop"])
@pytest.mark.parametrize("name", ["index.html", "compare.html#reference=insert-1-work-p"])
def test_a_page_does_not_scroll_sideways(opened, name, viewport):
    tab = opened[0](name, viewport=viewport)
    assert tab.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
