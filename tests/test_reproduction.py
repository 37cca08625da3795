"""The reproduction ledger is what the running code gives."""

import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAPERS = ("AC-2016", "AC-2017", "CLM-2023", "SURF", "LYAP")


@pytest.fixture(scope="module")
def page() -> str:
    made = subprocess.run([sys.executable, str(DOCS / "reproduction")], capture_output=True, text=True, check=True)
    return made.stdout


@pytest.mark.slow
def test_the_page_in_the_docs_is_made_by_the_code_as_it_stands(page):
    assert (DOCS / "reproduction.md").read_text("utf-8") == page, "python docs/reproduction > docs/reproduction.md"


@pytest.mark.slow
def test_every_paper_has_its_lines_and_every_line_that_is_not_reproduced_says_why(page):
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| ") and line.count(" | ") >= 6]
    entries = [row for row in rows if row[0] != "| where"]
    assert all(f"\n## {paper}\n" in page for paper in PAPERS)
    assert len(entries) > 200
    silent = [row for row in entries if row[5] != "reproduced" and not row[6].strip(" |")]
    assert not silent, silent[:5]
