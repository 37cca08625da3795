"""Text of files in every output: characters that act on a terminal, spreadsheet or page, in every field and command."""

import contextlib
import csv
import io
import json
import re
import unicodedata
from pathlib import Path

import openpyxl
import pandas as pd
import pytest
from fitmodels import datasets, parameters
from fitmodels.cards.content.card import compose
from fitmodels.cards.content.parts import PublicationPart
from fitmodels.cards.forms.page import page_html
from fitmodels.cards.publishing.card_toml import read_toml
from fitmodels.cli import main
from fitmodels.cli.output import Printer
from fitmodels.core.errors import DataError, UsageError
from fitmodels.core.plotting import NotebookFigure, save_figure
from fitmodels.core.text import (
    LONGEST_LINE,
    LONGEST_MESSAGE,
    json_text,
    printable,
    printable_message,
    spreadsheet_cell,
)
from fitmodels.parameters import ParameterFile
from hypothesis import given
from hypothesis import strategies as st

# Escape sequences that colour and clear, bell, C1, right-to-left override, zero-width blank, separator of lines, DEL,
# mathematics of figures, markup of rich and of pages, and syntax of a shell.
HOSTILE = "\x1b[31mX\x1b]0;t\x07\x9b2J\u202e\u2066\u200b\u2028\x7f$\\frac{a}$[red]b[/red]</script>`id`$(id)"
ACTS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]")
SHOWN_AS_IT_IS = "GC435 µm ° · Å ß 超硬 Κοπή резец e\u0301 \u00a0 ✓ ✗ ± 10⁻³ 😀 tab\tline\n"
WRITTEN = (".md", ".html", ".json", ".csv", ".txt", ".toml", ".c", ".h", ".ini", ".ssv", ".st", ".hal", ".ngc", ".comp")


def run(*words):
    """Exit code and output of the command, which may hold nothing that acts on a terminal."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    for text in (out.getvalue(), err.getvalue()):
        assert not ACTS.search(text), (words, ACTS.search(text))
    assert code in (0, 2, 3, 4, 5), err.getvalue()
    return code, out.getvalue(), err.getvalue()


def written_is_clean(folder, but=()):
    """No file that the program wrote holds such a character; the number of files."""
    files = [path for path in sorted(Path(folder).rglob("*")) if path.suffix in WRITTEN and path.name not in but]
    for path in files:
        assert not ACTS.search(path.read_text("utf-8")), path
    return len(files)


# Characters


def test_no_character_that_acts_or_is_not_shown_is_printable():
    """By the categories of Unicode: controls, surrogates, separators of lines; of format those without a sign."""
    kept = set(printable("".join(map(chr, [*range(0x20000), *range(0xE0000, 0xE1000)])), ""))
    assert not [c for c in kept if unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") and c not in "\n\t"]
    signs = re.compile("[\u0600-\u0605\u06dd\u070f\u0890\u0891\u08e2\U000110bd\U000110cd\U00013430-\U0001345f]")
    assert not [c for c in kept if unicodedata.category(c) == "Cf" and not signs.match(c)]
    assert not [c for c in kept if unicodedata.bidirectional(c) in ("RLO", "LRO", "RLE", "LRE", "PDF", "RLI", "LRI")]
    letters = [chr(code) for code in range(0x3000) if unicodedata.category(chr(code))[0] in "LNPS"]
    assert [c for c in letters if c not in kept] == ["\u115f", "\u1160"]  # fillers of Hangul, which are not shown


def test_ordinary_text_stays_as_it_is():
    assert printable(SHOWN_AS_IT_IS) == SHOWN_AS_IT_IS
    assert json.loads(json_text([SHOWN_AS_IT_IS])) == [SHOWN_AS_IT_IS]


@given(st.text())
def test_json_loses_nothing_and_holds_nothing_that_acts(text):
    written = json_text({text: [text]}, indent=1)
    assert not ACTS.search(written)
    assert json.loads(written) == {text: [text]}


@given(st.text())
def test_printable_text_is_clean_and_stays_so(text):
    assert not ACTS.search(printable(text))
    assert printable(printable(text)) == printable(text)


def test_no_value_in_a_message_begins_a_line_or_fills_the_screen():
    lines = printable_message("column 'a\nfitmodels: done\r\nb\u2028c'").split("\n")
    assert lines == ["column 'a", "  fitmodels: done", "  b", "  c'"]
    long = printable_message(f"data.csv: unit '{'x' * 1_000_000}' is not listed; use mm")
    assert len(long) < LONGEST_LINE + 100
    assert long.startswith("data.csv: unit")
    assert long.endswith("is not listed; use mm")
    assert len(printable_message("word\n" * 1_000_000)) < 2 * LONGEST_MESSAGE


def test_a_long_word_is_cut(capsys):
    Printer().show("wide " + "x" * 1_000_000 + " end")
    out = capsys.readouterr().out
    assert len(out) < 5000
    assert out.endswith("end\n")


# Commands


def test_a_workbook_with_hostile_texts_in_every_cell_is_fitted_and_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    escaped = "".join(f"_x{ord(c):04X}_" if ord(c) < 32 else c for c in HOSTILE)
    rows = [line.split(",") for line in datasets.bundled("gc435_709m40").read_text("utf-8").splitlines()
            if not line.startswith("#")]  # fmt: skip
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append([*rows[0][:7], f"remark {escaped}", "tool", "work"])  # AW alone of the responses
    for row in rows[1:]:
        sheet.append([row[0] + escaped, escaped, *map(float, row[2:7]), escaped, f"T{escaped}", f"W{escaped}"])
    book.save("tests.xlsx")
    assert run("look", "tests.xlsx", "--out", "overview.png")[0] == 0
    code, out, _ = run("tests.xlsx")
    assert code == 0
    assert "[red]b[/red]" in out  # markup of rich is text
    assert written_is_clean(".") > 3


def hostile_file(make):
    """The file of a fixture with hostile text in every text that its schema leaves free, and their number."""
    data, count = json.loads(make().model_dump_json()), 0

    def change(place):
        nonlocal count
        for key, value in list(place.items() if isinstance(place, dict) else enumerate(place)):
            if isinstance(value, str) and not str(key).startswith("unit"):
                place[key] = value + HOSTILE
                try:
                    ParameterFile.model_validate(data)
                    count += 1
                except ValueError:
                    place[key] = value
            elif isinstance(value, dict | list):
                change(value)

    change(data)
    return ParameterFile.model_validate(data), count


def test_a_parameter_file_with_hostile_texts_in_every_field_through_the_commands(
    constant_load_file, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    pf, count = hostile_file(constant_load_file)
    assert count > 10
    parameters.write(pf, "params.json")
    for words in (
        ["check"], ["check", "--json"], ["predict", "--json"], ["predict", "wear=0.1"], ["card", "--force"],
        ["card", "--json"], ["limits", "force=900N"], ["costs", "machine=60/h", "edge=8", "change=1.5min"],
        ["settings", "--worn", "0.2mm"], ["optimum"], ["simulate"], ["roughness", "Ra=1.6um"], ["tune"],
        *(["export", "--to", kind, "--accept-verdict"] for kind in ("ini", "h", "ngc", "ssv", "c", "st", "hal")),
    ):  # fmt: skip
        run(words[0], "params.json", *words[1:])
    assert written_is_clean(".") >= 4


@pytest.mark.parametrize("words", [
    [HOSTILE], ["check", HOSTILE], ["predict", f"no{HOSTILE}.json"], ["export", "params.json", "--to", HOSTILE],
    [f"--{HOSTILE}"], ["help", HOSTILE], ["look", "a.csv", "--unit", f"V={HOSTILE}"], ["plan", "--range", HOSTILE],
    ["excite", "--unit", HOSTILE, "--amplitude", "1", "--band", "1:2", "--duration", "9", "--rate", "9", "--out", "e"],
])  # fmt: skip
def test_names_on_the_command_line_and_on_the_disk_are_printed_without_acting(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = Path(HOSTILE.replace("/", "") + "\nline")
    folder.mkdir()
    (folder / "params.json").write_text("{}")
    assert run(*words)[0] in (2, 3)
    run("check", folder / "params.json")
    run("look", folder)


def test_colours_at_a_terminal_are_those_of_the_program(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    from rich.text import Text

    Printer().show(Text(f"tool {HOSTILE}", style="bold red"))
    out = capsys.readouterr().out
    assert set(re.findall("\x1b.[^m]*m?", out)) == {"\x1b[1;31m", "\x1b[0m"}
    assert not ACTS.search(out.replace("\x1b", ""))


@pytest.mark.parametrize("value", ["²", "0", "-5", "9" * 30, "abc", "", "\x1b[31m"])
def test_any_size_of_a_terminal_is_accepted(value, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", value)
    monkeypatch.setenv("LINES", value)
    assert 60 <= Printer().width <= 120
    run("help", "limits")


# Tables, figures, pages


def test_no_cell_of_a_table_is_a_formula_and_numbers_stay(tmp_path):
    frame = pd.DataFrame({"edge": ["=1+2", "@x", "-0.5", "E1"], "=V": [-1.5, 2.0, 3.0, 4.0], "n": [1, 2, 3, 4]})
    datasets.write_csv(frame, tmp_path / "t.csv", [f"note {HOSTILE}"], units={})
    lines = (tmp_path / "t.csv").read_text("utf-8").splitlines()
    header, *rows = csv.reader([line for line in lines if not line.startswith("#")])
    assert header == ["edge", "'=V", "n"]
    assert rows == [["'=1+2", "-1.5", "1"], ["'@x", "2", "2"], ["-0.5", "3", "3"], ["E1", "4", "4"]]
    assert not any(map(ACTS.search, lines))
    assert [spreadsheet_cell(text) for text in ("\t=1", "\r1", "+1", "'=1", "a=1")] == [
        "'\t=1", "'\N{REPLACEMENT CHARACTER}1", "'+1", "''=1", "a=1",
    ]  # fmt: skip


def test_a_name_with_dollars_is_no_mathematics_of_a_figure():
    figure = NotebookFigure(figsize=(3, 2))
    ax = figure.add_subplot()
    ax.set_title(f"tool {HOSTILE}")
    ax.set_xticks([0.0, 1.0], [HOSTILE, "$\\frac{a}$"])
    ax.set_yscale("log")
    ax.plot([1.0, 2.0], [1.0, 1e3])
    ax.set_xlabel("x" * 100_000)  # of a cell; a minute to draw
    save_figure(figure, io.BytesIO(), format="png")
    assert ax.get_xlabel() == f"{'x' * 497}..."
    assert not ACTS.search(ax.get_title())
    assert not any(label.get_parse_math() for label in (ax.title, *ax.get_xticklabels()))
    assert all(label.get_parse_math() for label in ax.get_yticklabels())  # powers of ten


@pytest.mark.parametrize("contact", [
    "javascript:alert(1)", "JavaScript : alert(1)", "see data:text/html;base64,x", "vbscript:x", "file:///etc/passwd",
    "ftp://a.b", "x javascript:y@z.org",
])  # fmt: skip
@pytest.mark.parametrize("key", ["contact", "authors"])
def test_an_address_that_a_browser_would_run_or_open_is_refused(key, contact, tmp_path):
    value = json.dumps([contact] if key == "authors" else contact)
    (tmp_path / "card.toml").write_text(f"{key} = {value}")
    with pytest.raises(DataError, match=rf"card.toml: {key} '.*address that begins with .*; give an e-mail address"):
        read_toml(tmp_path / "card.toml")


@pytest.mark.parametrize("contact", [
    "jane.doe@example.org", "mailto:jane@x.org", "https://x.org/jane", "Jane Doe, room 5: ask at 10:30", "doi:10.1/x",
    "Tel.:+49 711 1234", "https://orcid.org/0000-0002-1825-0097", "E-mail:jane@x.org",
])  # fmt: skip
def test_an_address_of_mail_or_of_the_web_is_accepted(contact, tmp_path):
    (tmp_path / "card.toml").write_text(f"contact = {json.dumps(contact)}")
    assert read_toml(tmp_path / "card.toml").publication.contact == contact


@pytest.mark.parametrize("line", ['title = "%s"', 'keywords = ["a", "%s"]'])
def test_a_text_of_a_card_toml_has_a_limit(line, tmp_path):
    (tmp_path / "card.toml").write_text(line % ("9" * 5001))
    with pytest.raises(DataError, match=r"has 5001 characters; the limit is 5000. Shorten it"):
        read_toml(tmp_path / "card.toml")


@pytest.mark.parametrize("text", [HOSTILE, "javascript:alert(1)", "https://evil.example/", "10.1234/x\"onclick='y'"])
def test_a_page_links_to_dois_and_itself_alone(text, constant_load_file):
    pf = constant_load_file(identity={"tool": text, "work": text, "machine": text, "note": text})
    published = PublicationPart(title=text, license=text, authors=(text,), contact=text, doi=text, keywords=(text,))
    page = page_html(compose(pf, publication=published), pf)
    links = re.findall(r"""\s(?:href|src|action|formaction)\s*=\s*["']?([^"'\s>]*)""", page)
    assert links
    assert all(re.match(r"#|data:,$|https://doi\.org/10\.\d+/", link) for link in links), set(links)
    assert not ACTS.search(page)


def test_a_command_that_is_proposed_for_a_path_quotes_it(tmp_path, monkeypatch, constant_load_file):
    monkeypatch.chdir(tmp_path)
    name = "$(touch x).json"
    parameters.write(constant_load_file(), name)
    assert f"fitmodels costs '{name}' machine=60/h" in run("optimum", name)[2]
    assert [path.name for path in Path().iterdir()] == [name]


def test_the_tests_that_the_threat_model_names_exist():
    root = Path(__file__).resolve().parent.parent
    page = (root / "docs" / "explanation" / "threats.md").read_text("utf-8")
    named = re.findall(r"`(tests/\w+\.py)::(\w+)`", page)
    assert len(named) > 20
    assert [f"{file}::{name}" for file, name in named if f"def {name}(" not in (root / file).read_text("utf-8")] == []


def test_errors_of_the_python_functions_keep_the_value_as_it_is():
    with pytest.raises(UsageError) as error:
        datasets.bundled(HOSTILE)
    assert repr(HOSTILE)[1:9] in str(error.value)
