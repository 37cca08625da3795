"""What the tests share: the real measurements, and a guard that the installed copy is the tree."""

import filecmp
import importlib
import os
import shutil
import sys
import tomllib
import warnings
from collections import deque
from operator import mul
from pathlib import Path

import pytest
from hypothesis import settings

# One thread of linear algebra, as the command has: pytest-xdist has as many processes as there are cores. It must stand
# in the environment before numpy is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The same examples every time, and as long as the machine takes; `--hypothesis-profile explore` draws new and more.
settings.register_profile("tests", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile("tests")

ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config):
    """Stop when the installed package differs from the checkout: pytest tests what is installed."""
    import fitmodels

    os.environ.pop("COLUMNS", None)  # pytest-xdist sets the width of its own terminal, which the output would take

    home = Path(fitmodels.__file__).resolve().parent
    if home == ROOT:
        return
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]["packages"]
    folders = {name.split(".")[1] for name in packages if "." in name}
    if stale := stale_files(ROOT, home, folders):
        pytest.exit(
            f"the installed fitmodels differs from this checkout ({', '.join(stale[:10])}): "
            "install again (rm -rf build; pip install .)",
            returncode=3,
        )


def stale_files(tree, home, folders):
    """Files of a package that differ from those of the tree, or are only in one of both: Python, templates, data."""

    def files(root):
        found = [path.relative_to(root) for one in sorted(folders) for path in (root / one).rglob("*.*")]
        found += [path.relative_to(root) for path in root.glob("*.py")]
        hidden = (path for path in found if any(part.startswith((".", "__pycache__")) for part in path.parts))
        return {path.as_posix() for path in {*found} - {*hidden} if (root / path).is_file()}

    there = files(home)
    kinds = {Path(name).suffix for name in there}  # others, such as copies that an editor keeps, are not installed
    here = {name for name in files(tree) if Path(name).suffix in kinds}
    _, differ, odd = filecmp.cmpfiles(tree, home, sorted(here & there), shallow=False)
    return sorted({*(here ^ there), *differ, *odd})


@pytest.fixture(autouse=True)
def no_open_figures():
    """Close the figures that ``result.plot()`` hands to pyplot."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def small_pictures(monkeypatch):
    """PNG pictures are drawn small, for tests of what is computed and printed: drawing takes half of their time."""
    import matplotlib.figure

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", matplotlib.figure.Figure.savefig)  # restored at the end
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    importlib.import_module("held_command").draw_fast()


@pytest.fixture(scope="session")
def measurements() -> Path:
    """Folder of the real measurements, named by FITMODELS_DATA."""
    folder = os.environ.get("FITMODELS_DATA")
    if not folder:
        pytest.skip("FITMODELS_DATA is not set: no real measurements here")
    return Path(folder)


@pytest.fixture(scope="session")
def consumer():
    """Path of a program that reads our exports; without it a test skips, or fails where all must be there."""

    def find(program: str, install: str) -> str:
        path = shutil.which(program)
        if path is None:
            missing = f"{program} is not installed: {install}"
            pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)
        return path

    return find


LOAD_LAW = {
    "quantity": "", "form": "load_line", "response": "I", "unit": "A", "equation": "", "error": "additive",
    "residual_scale": "A", "n": 20, "df": 17, "coefficients": {"A": 0.09584, "B": 1.2416e-4, "k1": 0.24832},
    "factors": [{"symbol": "fm", "quantity": "", "unit": "mm/min", "low": 600.0, "high": 1000.0},
                {"symbol": "VB", "quantity": "", "unit": "mm", "low": 0.0, "high": 0.2}],
    "uncertainty": {"kind": "none", "reason": "given"}, "verdict": {"level": "usable inside the tested region"},
}  # fmt: skip


@pytest.fixture(scope="session")
def constant_load_file():
    """A parameter file of milling at constant load, made for a sample time in s; keywords replace sections or parts.

    Drive: eq. 18 of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, with 1459 (mm/min)/V; limits near theirs.
    """

    def make(sample_time=0.02, **more):
        from fitmodels.parameters import ParameterFile

        T = sample_time
        exact = {"kind": "none", "reason": "given"}
        sections = {
            "identity": {"tool": "GC435", "work": "S45C", "simulated": True},
            "provenance": {"fitmodels": "0.1.0"},
            "dynamics": {
                "b": [0.0, 0.0611, -0.1338, 0.0752], "a": [1.0, -2.0311, 1.2104, -0.1655], "nk": 1, "sample_time": T,
                "unit_u": "V", "unit_y": "A", "uncertainty": exact,
                "verdict": {"level": "usable inside the tested region"},
            },
            "laws": {"I": LOAD_LAW},
            "pi": {
                "kp": 300.0, "ki": 160.0 / T, "sample_time": T, "filter_time": 4 * T, "unit_u": "mm/min", "unit_y": "A",
                "scaling_u": 1459.0,
            },
            "load_line": {
                "reference": 0.22, "worn": 0.26, "safety_factor": 0.85, "rounded_to": 0.01, "unit_load": "A",
                "upper": {"value": 1000.0, "wear": 0.0, "interval": exact},
                "lower": {"value": 600.0, "wear": 0.2, "interval": exact},
                "unit_feed": "mm/min", "window": [0.18, 0.22], "unit_wear": "mm", "law": "I",
                "engagement": {
                    "feed_programmed": 1000.0, "engage_at": 0.15, "hysteresis": 0.02, "engage_after": 20 * T,
                    "back_off": 0.02 / T, "recover": 0.008 / T, "load_low": 0.02, "load_high": 10.0,
                    "arm_after": 10 * T, "lost_after": 3 * T, "stuck_after": 50 * T, "heartbeat": 10 * T,
                    "overload_after": 25 * T,
                },
            },
        }  # fmt: skip
        for name, value in more.items():
            keep = isinstance(value, dict) and isinstance(sections.get(name), dict)
            sections[name] = {**sections[name], **value} if keep else value
        return ParameterFile.model_validate({name: value for name, value in sections.items() if value is not None})

    return make


class LinearCut:
    """A plant: load(k) = offset + b(q)/a(q) command + wear(t) in the cut, idle outside it; b begins with 0."""

    def __init__(self, b, a, offset=0.0, idle=0.0, wear=lambda t: 0.0, cutting=lambda t: True, noise=0.0):
        self.b, self.a, self.offset, self.idle = b[1:], a[1:], offset, idle  # the replay adds the sample of delay
        self.wear, self.cutting, self.noise, self.samples = wear, cutting, noise, 0
        self.commands, self.drives = deque([0.0] * len(self.b), len(self.b)), deque([0.0] * len(self.a), len(self.a))

    def step(self, command, dt, noise):
        t, self.samples = self.samples * dt, self.samples + 1
        self.commands.appendleft(command)
        drive = sum(map(mul, self.b, self.commands)) - sum(map(mul, self.a, self.drives))
        self.drives.appendleft(drive)
        load = self.offset + drive + self.wear(t) if self.cutting(t) else self.idle
        return load + self.noise * noise.standard_normal()


@pytest.fixture(scope="session")
def linear_cut():
    """The class of a linear plant under a feed override."""
    return LinearCut


def pytest_sessionfinish(session, exitstatus):
    """Where the real measurements are, nothing may skip: a skip would hide what was never tried."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    skipped = [] if reporter is None else reporter.stats.get("skipped", [])
    if os.environ.get("FITMODELS_DATA") and any("consumer" not in report.keywords for report in skipped):
        reporter.write_line("FITMODELS_DATA is set, so a skipped test is a failure")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def missing(what):
    """Skip a test of a page, or fail it where the gate requires its programs."""
    words = f"{what} is not installed: pip install 'fitmodels[browser,app]'; apt-get install chromium"
    pytest.fail(words) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(words)


@pytest.fixture(scope="module")
def chromium():
    """Chromium, driven by Playwright."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright")
    path = shutil.which("chromium")
    if path is None:
        missing("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])  # root has no sandbox
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def axe():
    """The class Axe of axe-playwright-python, with the rules of axe-core."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the import of its own resources
        try:
            from axe_playwright_python.sync_playwright import Axe
        except ImportError:
            missing("axe-playwright-python")
    return Axe
