"""The page of the app in Chromium: files are dropped and corrected, laws go to an export, also by keyboard alone.

axe-core is Deque's (https://github.com/dequelabs/axe-core, rules of WCAG 2); it comes with axe-playwright-python.
"""

import base64
import io
import shlex
import sys
from pathlib import Path

import pytest
from fitmodels import cli, datasets

sys.path.insert(0, str(Path(__file__).parent))

from app_pages import served

sys.path.remove(str(Path(__file__).parent))

pytestmark = pytest.mark.browser

EXAMPLES = Path(__file__).parent.parent / "docs" / "examples"
PHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1400, "height": 900}
FIRST = 60_000  # ms until a command has ended on a busy machine
GERMAN = (EXAMPLES / "verschleiss.csv").read_bytes()
DROP = """([text, name]) => {
  const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  const moved = new DataTransfer();
  moved.items.add(new File([bytes], name));
  return moved;
}"""


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with served(tmp_path_factory.mktemp("project")) as one:
        yield one


@pytest.fixture
def opened(chromium, client):
    """A tab of the page; its console and what it asks of others must stay empty."""
    contexts, faults = [], []

    def open_page(**options):
        context = chromium.new_context(**{"viewport": DESKTOP, "locale": "en-GB", **options})
        contexts.append(context)
        tab = context.new_page()
        tab.set_default_timeout(FIRST)
        own = f"http://{client.host}/"
        tab.on("request", lambda r: None if r.url.startswith((own, "data:")) else faults.append(r.url))
        tab.on("console", lambda message: None if "422" in message.text else faults.append(message.text))  # refusals
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.goto(f"{own}start/{client.token}")
        return tab

    yield open_page
    for context in contexts:
        context.close()
    assert faults == []


def drop(tab, name, content):
    """Drop a file onto the page of the project, and wait for its laws."""
    with tab.expect_navigation():  # a page that is left would take the file along
        tab.get_by_role("link", name="fitmodels", exact=True).click()
    moved = tab.evaluate_handle(DROP, [base64.b64encode(content).decode(), name])
    with tab.expect_navigation(url="**/files/**"):
        tab.dispatch_event("body", "drop", {"dataTransfer": moved})
    fitted(tab)


def fitted(tab):
    tab.locator("#laws").wait_for()
    tab.locator("#reading").wait_for()
    tab.locator("#machine .action, #machine .alert").first.wait_for()


def laws_of(tab):
    return tab.locator("#laws > .terminal").inner_text()


def run(tab, action, **fields):
    """Fill in the form of a command, run it, and return the text of its result."""
    form = tab.locator(f"#action-{action}")
    if form.get_attribute("open") is None:
        form.locator("> summary").click()
    for name, value in fields.items():
        field = form.locator(f"[name='{name}']")
        field.select_option(value) if field.evaluate("e => e.tagName") == "SELECT" else field.fill(value)
    form.locator("form button").click()
    done = form.locator(".done")
    done.wait_for()
    return form.locator(".answer").inner_text()


def taken(tab, name):
    """Bytes of a file of the results, taken by its link."""
    with tab.expect_download() as found:
        tab.locator(f".results a[href$='{name}']").first.click()
    return Path(found.value.path()).read_bytes()


def same_by_command(tab, name, content, folder, monkeypatch):
    """Compare params.json with what the printed command writes in another folder, byte for byte."""
    typed = shlex.split(tab.get_by_label("Command", exact=True).inner_text())
    assert typed[:2] == ["fitmodels", name]
    folder.mkdir()
    (folder / name).write_bytes(content)
    monkeypatch.chdir(folder)
    assert cli.main(typed[1:]) == 0
    (made,) = folder.rglob("params.json")
    assert taken(tab, "/params.json") == made.read_bytes()


def workbook():
    """A workbook with a cover sheet; lengths in inches, a header in German, no column of edges."""
    import openpyxl

    book = openpyxl.Workbook()
    cover = book.active
    cover.title = "Deckblatt"
    for row in (["Verschleissversuche, Halle 3"], [], ["Werkzeug", "GC4035"], ["Werkstoff", "42CrMo4"]):
        cover.append(row)
    sheet = book.create_sheet("Messwerte")
    sheet.append(["Schnittgeschwindigkeit [sfm]", "Vorschub [in/rev]", "Zeit [min]", "Verschleißmarkenbreite [in]"])
    for k, (V, f, t) in enumerate((V, f, t) for V in (100, 150, 200) for f in (0.15, 0.25) for t in (2, 4, 8, 12)):
        wear = 0.004 * V**0.5 * f**0.2 * t**0.4 * (1 + 0.02 * (k * 7 % 5 - 2))
        sheet.append([round(V / 0.3048, 1), round(f / 25.4, 5), t, round(wear / 25.4, 5)])
    made = io.BytesIO()
    book.save(made)
    return made.getvalue()


def wrong_unit():
    """Wear in micrometres under a header that says millimetres."""
    rows = [
        f"E{k},{V},{f},{t},{4 * V**0.5 * f**0.2 * t**0.4 * (1 + 0.02 * (k * t % 3 - 1)):.1f}"
        for k, (V, f) in enumerate((V, f) for V in (100, 150, 200) for f in (0.1, 0.2, 0.3))
        for t in (2, 4, 8, 12)
    ]
    return "\n".join(["edge,vc [m/min],f [mm/rev],t [min],VB [mm]", *rows]).encode()


def test_the_bundled_file_is_dropped_and_gives_what_the_command_gives(opened, tmp_path, monkeypatch):
    tab, content = opened(), datasets.bundled("gc435_709m40").read_bytes()
    drop(tab, "gc.csv", content)
    assert "AW = " in laws_of(tab)
    frame = tab.frame_locator("iframe.card")
    frame.locator("#slider-0").press("End")  # the profiler of the card runs in its frame
    assert "Outside the tested region" in frame.locator("#profiler-where").inner_text()
    same_by_command(tab, "gc.csv", content, tmp_path / "other", monkeypatch)
    assert "Power P at most 7 kW" in run(tab, "limits", P="7kW", AW="0.3mm")
    assert "has no costs; write them with Costs" in run(tab, "optimum")
    tab.locator("#answer-optimum a").click()  # opens the form, with the values that the message names
    assert tab.locator("#costs-machine").input_value() == "60/h"
    assert tab.locator("#costs-machine").is_visible()


def test_a_german_file_and_a_workbook_with_a_cover_sheet_are_dropped(opened, tmp_path, monkeypatch):
    tab = opened(locale="de-DE")
    for name, content, wear in (("verschleiss.csv", GERMAN, "VB = "), ("Versuche.xlsx", workbook(), "VB = ")):
        drop(tab, name, content)
        assert wear in laws_of(tab)
        assert "Verschleiß" in tab.locator("#reading table select").nth(0).inner_text()
        same_by_command(tab, name, content, tmp_path / Path(name).stem, monkeypatch)
    assert tab.locator("#role-1 option[lang=de]").count() > 20
    assert tab.locator("#reading > p strong").inner_text() == "Messwerte"
    assert "GC4035 on 42CrMo4" in tab.locator("#reading").inner_text()


def test_a_wrong_unit_is_corrected_by_its_menu(opened, tmp_path, monkeypatch):
    tab, content = opened(), wrong_unit()
    drop(tab, "unit.csv", content)
    assert tab.locator("#reading .doubt, #reading .alert").count()
    with tab.expect_navigation():
        tab.get_by_label("Unit of column 5, VB [mm]").select_option("um")
    fitted(tab)
    assert "--unit VB=um" in tab.get_by_label("Command", exact=True).inner_text()
    assert tab.get_by_label("Unit of column 5, VB [mm]").input_value() == "um"
    assert "VB = " in laws_of(tab)
    same_by_command(tab, "unit.csv", content, tmp_path / "other", monkeypatch)


def test_tests_and_a_record_lead_to_a_hal_file(opened):
    tab = opened()
    drop(tab, "drive.csv", (EXAMPLES / "drive.csv").read_bytes())
    drop(tab, "fraesen.csv", (EXAMPLES / "fraesen.csv").read_bytes())
    assert "Reference 0.24 A" in run(tab, "settings", worn="0.28")
    assert "Dynamics added to" in run(tab, "ident", record="drive.csv")
    assert not tab.get_by_text("noise SD = ").is_visible()
    tab.get_by_text("Details", exact=True).click()
    assert tab.get_by_text("noise SD = ").is_visible()
    assert tab.locator("#tune-low").input_value() == "521"  # of the constant load
    assert "Kp " in run(tab, "tune", rise="2", settle="4")
    assert "all checks passed" in run(tab, "check")
    assert "fraesen-control.hal" in run(tab, "export", to="hal")
    assert b"setp " in taken(tab, "fraesen-control.hal")
    assert not tab.get_by_label("diameter of the part").is_visible()
    former = "#answer-export.former"
    assert tab.locator(former).count() == 0
    tab.locator("#export-to").select_option("nc")
    assert tab.get_by_label("diameter of the part").is_visible()
    assert tab.locator(former).count() == 1


def tabbed_to(tab, words):
    """Go on by Tab until the focused element has these words; it must be visible that it has the focus."""
    for _ in range(120):
        tab.keyboard.press("Tab")
        focused = tab.evaluate(
            "() => { const e = document.activeElement, s = getComputedStyle(e), r = e.getBoundingClientRect();"
            "return [(e.labels && e.labels[0] || e).textContent.trim(), e.matches(':focus-visible'), s.outlineStyle,"
            "r.width * r.height, e.tagName]; }"
        )
        text, is_shown, outline, area, tag = focused
        if tag not in ("BODY", "IFRAME"):
            assert is_shown, focused
            assert outline != "none", focused
            assert area > 0, focused
        if text.startswith(words):
            return
    raise AssertionError(f"no way to {words} by Tab")


def chooser_by_space(tab):
    """The dialog for files of the focused field; a busy browser can lose the first key."""
    choosers = []
    tab.once("filechooser", lambda chooser: choosers.append(chooser))
    for _ in range(12):
        tab.keyboard.press("Space")
        for _ in range(50):
            tab.wait_for_timeout(200)
            if choosers:
                return choosers[0]
    raise AssertionError("Space opens no dialog for files")


def test_by_keyboard_alone_from_a_file_to_an_export(opened):
    tab = opened()
    tabbed_to(tab, "Skip to the content")
    tab.keyboard.press("Enter")
    tabbed_to(tab, "Drop files")
    chooser = chooser_by_space(tab)
    content = datasets.bundled("gc435_709m40").read_bytes() + b"\n"
    with tab.expect_navigation():
        chooser.set_files({"name": "keys.csv", "mimeType": "text/csv", "buffer": content})
    fitted(tab)
    tabbed_to(tab, "Unit of column")
    with tab.expect_navigation():
        tab.keyboard.press("ArrowDown")
    fitted(tab)
    tabbed_to(tab, "Undo")
    with tab.expect_navigation():
        tab.keyboard.press("Enter")
    fitted(tab)
    tabbed_to(tab, "Limits")
    tab.keyboard.press("Enter")
    tabbed_to(tab, "power P at most")
    tab.keyboard.type("7kW")
    tab.keyboard.press("Enter")
    tab.locator("#action-limits .done").wait_for()
    assert "Power P at most 7 kW" in tab.locator("#answer-limits").inner_text()
    tabbed_to(tab, "Export")
    tab.keyboard.press("Enter")
    tabbed_to(tab, "kind")
    tab.keyboard.type("key and")
    tab.keyboard.press("Enter")
    tabbed_to(tab, "Export")
    tab.keyboard.press("Enter")
    tab.locator("#action-export .done").wait_for()
    assert "keys-control.ini" in tab.locator("#answer-export").inner_text()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_axe_finds_no_serious_fault_and_nothing_is_wider_than_the_page(opened, axe, client, viewport, scheme):
    page = client.upload("axe.csv", wrong_unit().replace(b"VB [mm]", b"VB [um]"))[1]
    client.until_done(f"{page}/laws")
    tab = opened(viewport=viewport, color_scheme=scheme)
    for address in ("/", page):
        tab.goto(f"http://{client.host}{address}")
        if address != "/":
            fitted(tab)
            tab.locator("#action-limits summary").click()
            tab.get_by_text("Names, edges, criterion").click()
            tab.wait_for_load_state("networkidle")
        found = axe().run(tab).response["violations"]
        serious = [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in ("serious", "critical")]
        assert serious == [], address
        assert tab.evaluate("() => document.documentElement.scrollWidth") <= viewport["width"]


def wrong_cell():
    """Eight columns and many rows, with one spindle current whose decimal mark slipped in line 31."""
    rows = [
        f"{k},AA238M,S45C,C{1 + k // 16},{feed},{wear},{0.1 + 1e-4 * feed + 3e-4 * wear + 0.002 * (k % 3):.3f},"
        for k, (wear, feed) in enumerate((w, f) for w in range(15, 255, 15) for f in (500, 700, 900, 1100))
    ]
    rows[29] = rows[29].replace(",0.", ",").replace("S45C,C2", "S45C,C2")
    head = "No.,Cutter,Work material,Cutting edge,Feed rate [mm/min],Flank wear [um],Spindle current [A],Remarks"
    return "\n".join([head, *rows]).encode()


def test_a_wrong_cell_is_seen_and_mended_in_place(opened):
    tab = opened()
    drop(tab, "cell.csv", wrong_cell())
    table = tab.locator("#columns")
    assert table.evaluate("e => e.scrollWidth <= e.clientWidth"), "eight columns are cut off"
    assert tab.locator("tr.doubted th").inner_text().startswith("31")
    value = tab.get_by_label("New value of I in line 31").first
    value.scroll_into_view_if_needed()
    value.fill("x")
    form = tab.locator("form.row").first
    form.get_by_label("because").fill("decimal mark")
    form.get_by_role("button").click()
    answer = tab.locator(".doubt .answer .alert").first
    answer.wait_for()
    assert "is no number" in answer.inner_text()
    assert value.input_value() == "x"
    value.fill("0,27")
    place = tab.evaluate("() => window.scrollY")
    with tab.expect_navigation():
        form.get_by_role("button").click()
    fitted(tab)
    assert "becomes 0.27 A: decimal mark" in tab.locator("#reading").inner_text()
    assert abs(tab.evaluate("() => window.scrollY") - place) < 50


def test_an_answer_comes_into_view_with_the_focus(opened):
    tab = opened(viewport={"width": 1000, "height": 500}, reduced_motion="reduce")
    drop(tab, "fraesen.csv", (EXAMPLES / "fraesen.csv").read_bytes())
    run(tab, "settings", worn="0.28")
    tab.wait_for_function("() => document.activeElement.id === 'answer-settings'")
    box = tab.locator("#answer-settings").bounding_box()
    assert 0 <= box["y"] < 500
    assert tab.evaluate("() => document.activeElement.getBoundingClientRect().top") >= 0
