"""The documentation: commands and Python of each page are run, and their output is compared with the page.

The pages are built by Sphinx in ``.ci/run``, where links are checked and notebooks executed.
"""

import ast
import re
import shlex
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from fitmodels.cli import COMMANDS, module_name

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAPERS = ("AC-2016", "AC-2017", "CLM-2023", "SURF", "LYAP")
README = ROOT / "README.md"
PAGES = sorted(path for path in DOCS.rglob("*.md") if path.parent.name != "_notebooks")
RUN = re.compile(r"^```(console|python)$", re.M)


def tool(name, folder=DOCS / "_ext"):
    """A module of the documentation."""
    sys.path.insert(0, str(folder))
    try:
        return import_module(name)
    finally:
        sys.path.remove(str(folder))


blocks, links, packages = tool("blocks"), tool("links"), tool("reference_text")


@pytest.mark.slow
@pytest.mark.usefixtures("small_pictures")
@pytest.mark.parametrize("page", [p for p in PAGES if RUN.search(p.read_text("utf-8"))], ids=lambda p: p.stem)
def test_outputs_on_a_page_equal_those_of_the_program(page, tmp_path):
    found = blocks.differences(page, tmp_path)
    assert not found, "\n\n".join(map(str, found))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_fenced_blocks_are_of_known_kinds(page):
    """``sh`` is the install line of the README; a ``text`` block is the output of the Python block before it."""
    text = page.read_text("utf-8")
    fences = [match["info"].strip() for match in blocks.FENCE.finditer(text)]
    known = {"console", "python", "text", "sh", "{commands}", "{roles}", "{ranges}", "{toctree}"}
    ours = ("{code-block}", "{include}", "{schema}")
    assert [info for info in fences if info not in known and not info.startswith(ours)] == []
    examples = [item for item in blocks.examples_of(text) if isinstance(item, blocks.Example)]
    with_output = [item for item in examples if item.language == "python" and item.start < item.end]
    assert len(with_output) == fences.count("text")
    readme = (ROOT / "README.md").read_text("utf-8")
    for line in re.findall(r"^```sh\n(.*?)\n```$", text, flags=re.M | re.S):
        assert line in readme


def test_a_story_has_a_script_of_its_commands_alone():
    for page in sorted(set((DOCS / "stories").glob("*.md")) - {DOCS / "stories/index.md"}):
        text = page.read_text("utf-8")
        assert page.with_suffix(".sh").read_text("utf-8") == blocks.script_of(text, page.name)
        run = [item for item in blocks.examples_of(text) if isinstance(item, blocks.Example)]
        assert {item.language for item in run} == {"console"}
        assert all(item.source.startswith("fitmodels ") for item in run)
        assert {"replay", "export"} <= {item.source.split()[1] for item in run}


@pytest.mark.parametrize("name", sorted(tool("make", DOCS / "examples").FILES))
def test_example_files_equal_the_output_of_their_script(name):
    assert (DOCS / "examples" / name).read_text("utf-8") == tool("make", DOCS / "examples").text(name)


def test_example_files_state_that_they_are_simulated():
    for path in (DOCS / "examples").rglob("*.csv"):
        if path.name == "shop-pairs.csv":  # names, no numbers
            continue
        assert "simulated" in path.read_text("utf-8").splitlines()[0]


def test_benchmarks_named_on_pages_exist():
    for page in (*PAGES, README):
        for name in re.findall(r"(?:benchmarks|tests)/\w+\.py", page.read_text("utf-8")):
            assert (ROOT / name).is_file(), f"{page.name} names {name}"


SCRIPTS = [path for folder in ("benchmarks", "docs/reproduction") for path in sorted((ROOT / folder).glob("*.py"))]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_script_imports_names_that_exist(script):
    """Imports of the package at the head of a script and inside its functions, without running the script."""
    for node in ast.walk(ast.parse(script.read_text("utf-8"))):
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("fitmodels"):
            continue
        module = import_module(node.module)
        for name in node.names:
            found = hasattr(module, name.name) or find_spec(f"{node.module}.{name.name}")
            assert found, f"{node.module} has no {name.name}"


def test_each_row_of_the_comparison_names_the_script_that_prints_it():
    (table,) = re.findall(r"^\| alternative .*\n\|[-|]+\n((?:\|.*\n)+)", README.read_text("utf-8"), flags=re.M)
    for row in table.splitlines():
        assert re.search(r"`(?:benchmarks|tests)/\w+\.py`", row.split("|")[-2]), row


def test_files_linked_in_the_readme_exist():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", README.read_text("utf-8")):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("line", re.findall(r"^ {4}(fitmodels .*)$", README.read_text("utf-8"), flags=re.M))
def test_commands_of_the_readme_have_known_options(line):
    """Only the arguments are parsed; the output of the main job is tested in test_package.py."""
    name, *rest = shlex.split(line, comments=True)[1:]
    command = import_module(f"fitmodels.cli.{module_name(name) if name in COMMANDS else 'wear'}")
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
def test_only_dots_match_any_text(shown, printed, same):
    assert blocks.agrees(shown, printed) is same


def test_a_wrong_output_is_found_and_corrected(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```python\nprint(1 + 1)\n```\n```text\n3\n```\n\n```console\n$ fitmodels --version\n...\n```\n")
    (tmp_path / "run").mkdir()
    (one,) = blocks.differences(page, tmp_path / "run")
    assert one.printed == "2\n"
    assert "```text\n2\n```" in blocks.written(page.read_text(), [one])


def test_broken_links_are_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top1"><a href="b.html#here">b</a><a href="#gone">x</a><a href="c.html">c</a>'
    )
    (tmp_path / "b.html").write_text(
        '<p id="here"><a href="a.html">a</a><a href="https://x.org/y">y</a><script src="//cdn.z/q.js">'
    )
    problems, external = links.check_links(tmp_path)
    assert [line.split(":")[0] for line in problems] == [
        "a.html links to #gone",
        "a.html links to c.html",
        "b.html loads //cdn.z/q.js",
    ]
    assert external == ["//cdn.z/q.js", "https://x.org/y"]


@pytest.mark.parametrize("name", packages.PACKAGES)
def test_public_names_have_docstrings_and_their_package_a_page(name):
    package = import_module(f"fitmodels.{name}")
    assert f".. package:: {name}\n" in (DOCS / "reference" / f"{name}.rst").read_text("utf-8")
    text = "\n".join(packages.lines(package))
    for public in package.__all__:
        value = getattr(package, public)
        assert re.search(rf"^\.\. auto\w+:: {public}$", text, flags=re.M), public
        assert isinstance(value, dict | tuple | str) or value.__doc__, public


def test_classes_that_public_functions_return_are_documented():
    documented = {kind.__name__ for kind in packages.returned(import_module("fitmodels.fit"))}
    assert "ToolLife" in documented | set(import_module("fitmodels.fit").__all__)


def test_names_of_the_root_are_in_the_reference():
    text = (DOCS / "reference" / "root.rst").read_text("utf-8")
    import fitmodels

    for name in set(fitmodels.__all__) - set(packages.PACKAGES):
        assert f"``fitmodels.{name}``" in text, name


# The reproduction ledger equals the output of its script


@pytest.fixture(scope="module")
def ledger() -> str:
    made = subprocess.run([sys.executable, str(DOCS / "reproduction")], capture_output=True, text=True, check=True)
    return made.stdout


@pytest.mark.slow
def test_the_page_equals_the_output_of_the_script(ledger):
    assert (DOCS / "reproduction.md").read_text("utf-8") == ledger, "python docs/reproduction > docs/reproduction.md"


@pytest.mark.slow
def test_every_paper_is_listed_and_every_deviation_has_a_reason(ledger):
    rows = [line.split(" | ") for line in ledger.splitlines() if line.startswith("| ") and line.count(" | ") >= 6]
    entries = [row for row in rows if row[0] != "| where"]
    assert all(f"\n## {paper}\n" in ledger for paper in PAPERS)
    assert len(entries) > 200
    without_reason = [row for row in entries if row[5] != "reproduced" and not row[6].strip(" |")]
    assert not without_reason, without_reason[:5]
