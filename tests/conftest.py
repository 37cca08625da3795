"""What the tests share: the real measurements, and a guard that the installed copy is the tree."""

import filecmp
import os
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config):
    """Stop when the installed package differs from the checkout: pytest tests what is installed."""
    import fitmodels

    home = Path(fitmodels.__file__).resolve().parent
    if home == ROOT:
        return
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]["packages"]
    rooms = [name.removeprefix("fitmodels").lstrip(".").replace(".", "/") for name in packages]
    for room in rooms:
        here = {path.name for path in (ROOT / room).glob("*.py")}
        there = {path.name for path in (home / room).glob("*.py")}
        _, differ, odd = filecmp.cmpfiles(ROOT / room, home / room, here & there, shallow=False)
        stale = sorted({*(here ^ there), *differ, *odd})
        if stale:
            pytest.exit(
                f"the installed fitmodels differs from this checkout ({room or '.'}: {', '.join(stale)}): "
                "install again (rm -rf build; pip install .)",
                returncode=3,
            )


@pytest.fixture(scope="session")
def measurements() -> Path:
    """Folder of the real measurements, named by FITMODELS_DATA."""
    folder = os.environ.get("FITMODELS_DATA")
    if not folder:
        pytest.skip("FITMODELS_DATA is not set: no real measurements here")
    return Path(folder)


def pytest_sessionfinish(session, exitstatus):
    """Where the real measurements are, nothing may skip: a skip would hide what was never tried."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("FITMODELS_DATA") and reporter is not None and reporter.stats.get("skipped"):
        reporter.write_line("FITMODELS_DATA is set, so a skipped test is a failure")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
