"""The documentation is true: each page's commands and Python are run, and what it shows is what they print.

The pages themselves are built by Sphinx in ``.ci/run``, where links are checked and notebooks executed.
"""

import re
import shlex
import sys
from importlib import import_module
from pathlib import Path

import pytest
from fitmodels.cli import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = sorted(path for path in DOCS.rglob("*.md") if path.parent.name != "_notebooks")
RUN = re.compile(r"^```(console|python)$", re.M)


def tool(name, folder=DOCS / "_ext"):
    """A module of the documentation's own."""
    sys.path.insert(0, str(folder))
    try:
        return import_module(name)
    finally:
        sys.path.remove(str(folder))


blocks, links = tool("blocks"), tool("links")


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if RUN.search(p.read_text("utf-8"))], ids=lambda p: p.stem)
def test_what_a_page_shows_is_what_is_printed(page, tmp_path):
    found = blocks.differences(page, tmp_path)
    assert not found, "\n\n".join(map(str, found))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_every_fence_is_run_or_is_known_not_to_be(page):
    """``sh`` is the README's install line; a ``text`` block shows what Python printed, and nothing else."""
    text = page.read_text("utf-8")
    fences = [match["info"].strip() for match in blocks.FENCE.finditer(text)]
    known = {"console", "python", "text", "sh", "{commands}", "{roles}", "{toctree}"}
    ours = ("{code-block}", "{include}", "{schema}")
    assert [info for info in fences if info not in known and not info.startswith(ours)] == []
    shown = [item for item in blocks.shown_on(text) if isinstance(item, blocks.Shown)]
    told = [item for item in shown if item.language == "python" and item.start < item.end]
    assert len(told) == fences.count("text")
    readme = (ROOT / "README.md").read_text("utf-8")
    for line in re.findall(r"^```sh\n(.*?)\n```$", text, flags=re.M | re.S):
        assert line in readme


@pytest.mark.parametrize("name", sorted(tool("make", DOCS / "examples").FILES))
def test_an_example_file_is_what_its_maker_makes(name):
    assert (DOCS / "examples" / name).read_text("utf-8") == tool("make", DOCS / "examples").text(name)


def test_every_example_file_says_that_it_was_not_measured():
    for path in (DOCS / "examples").rglob("*.csv"):
        if path.name == "shop-pairs.csv":  # names, no numbers
            continue
        assert "simulated" in path.read_text("utf-8").splitlines()[0]


def test_every_benchmark_a_page_names_is_there():
    for page in (*PAGES, README):
        for name in re.findall(r"(?:benchmarks|tests)/\w+\.py", page.read_text("utf-8")):
            assert (ROOT / name).is_file(), f"{page.name} names {name}"


def test_every_claim_of_the_comparison_names_what_prints_it():
    (table,) = re.findall(r"^\| instead .*\n\|[-|]+\n((?:\|.*\n)+)", README.read_text("utf-8"), flags=re.M)
    for row in table.splitlines():
        assert re.search(r"`(?:benchmarks|tests)/\w+\.py`", row.split("|")[-2]), row


def test_every_file_the_readme_links_to_is_there():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", README.read_text("utf-8")):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("line", re.findall(r"^ {4}(fitmodels .*)$", README.read_text("utf-8"), flags=re.M))
def test_every_command_of_the_readme_is_one_that_the_program_takes(line):
    """Its words, not its files: `fitmodels` knows each option. What the main job prints is held in test_package.py."""
    name, *rest = shlex.split(line, comments=True)[1:]
    command = import_module(f"fitmodels.cli.{name if name in COMMANDS else 'wear'}")
    command.parser().parse_args(rest if name in COMMANDS else [name, *rest])


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("one\ntwo\n", "one  \ntwo", True),
        ("one\n...\nfour\n", "one\ntwo\nthree\nfour\n", True),
        ("one\n...\n", "one\n", True),
        ("took ... s\n", "took 0.3 s\n", True),
        ("a. c\n", "abc\n", False),
        ("one\n", "one\ntwo\n", False),
        ("one\n...\nfour\n", "one\ntwo\n", False),
        ("", "", True),
        ("", "something\n", False),
    ],
)
def test_dots_stand_for_anything_and_nothing_else_does(shown, printed, same):
    assert blocks.agrees(shown, printed) is same


def test_a_page_that_is_wrong_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```python\nprint(1 + 1)\n```\n```text\n3\n```\n\n```console\n$ fitmodels --version\n...\n```\n")
    (tmp_path / "run").mkdir()
    (one,) = blocks.differences(page, tmp_path / "run")
    assert one.printed == "2\n"
    assert "```text\n2\n```" in blocks.written(page.read_text(), [one])


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top1"><a href="b.html#here">b</a><a href="#gone">x</a><a href="c.html">c</a>'
    )
    (tmp_path / "b.html").write_text(
        '<p id="here"><a href="a.html">a</a><a href="https://x.org/y">y</a><script src="//cdn.z/q.js">'
    )
    complaints, outside = links.judge(tmp_path)
    assert [line.split(":")[0] for line in complaints] == [
        "a.html links to #gone",
        "a.html links to c.html",
        "b.html loads //cdn.z/q.js",
    ]
    assert outside == ["//cdn.z/q.js", "https://x.org/y"]
