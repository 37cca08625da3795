"""The reproduction ledger equals the output of its script."""

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
def test_the_page_equals_the_output_of_the_script(page):
    assert (DOCS / "reproduction.md").read_text("utf-8") == page, "python docs/reproduction > docs/reproduction.md"


@pytest.mark.slow
def test_every_paper_is_listed_and_every_deviation_has_a_reason(page):
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| ") and line.count(" | ") >= 6]
    entries = [row for row in rows if row[0] != "| where"]
    assert all(f"\n## {paper}\n" in page for paper in PAPERS)
    assert len(entries) > 200
    without_reason = [row for row in entries if row[5] != "reproduced" and not row[6].strip(" |")]
    assert not without_reason, without_reason[:5]
