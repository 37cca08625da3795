"""The package tests itself: what pyproject promises, what the README shows, what a wheel holds."""

import gc
import importlib
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import fitmodels
import pytest

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
SETUPTOOLS = PROJECT["tool"]["setuptools"]
README = (ROOT / "README.md").read_text("utf-8")
PACKAGES = ("batch", "cards", "controllers", "datasets", "fit", "ident", "parameters", "pipeline")
COMMANDS = (
    "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/fitmodels datasets/gc435_709m40/data.csv",
    "python3 -m venv .venv && .venv/bin/pip install '.[test]' && .venv/bin/pytest -n auto",
)


def test_packages_are_the_folders_with_python_in_them():
    on_disk = {
        "fitmodels" + "".join(f".{part}" for part in path.parent.relative_to(ROOT).parts)
        for path in ROOT.glob("**/__init__.py")
        if not {"tests", "docs", "benchmarks", "build", ".venv"} & set(path.relative_to(ROOT).parts)
    }
    assert set(SETUPTOOLS["packages"]) == on_disk


def test_only_three_modules_stand_at_the_root():
    assert {path.stem for path in ROOT.glob("*.py")} == {"__init__", "__main__"}


def test_package_data_names_every_file_that_is_not_python():
    for package in (*PACKAGES, "cli", "core"):
        patterns = SETUPTOOLS["package-data"].get(f"fitmodels.{package}", [])
        carried = {path for pattern in patterns for path in (ROOT / package).glob(pattern)}
        files = {path for path in (ROOT / package).rglob("*") if path.is_file() and "__pycache__" not in path.parts}
        left = {path.relative_to(ROOT).as_posix() for path in files - carried if path.suffix not in (".py", ".pyi")}
        assert not left
    assert (ROOT / "py.typed").is_file()


def test_version_is_the_same_everywhere():
    version = PROJECT["project"]["version"]
    assert fitmodels.__version__ == version
    assert f"version: {version}" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.parametrize("package", PACKAGES)
def test_public_names_exist_and_are_documented(package):
    module = importlib.import_module(f"fitmodels.{package}")
    assert module.__doc__
    for name in getattr(module, "__all__", []):
        thing = getattr(module, name)
        assert not callable(thing) or (thing.__doc__ and thing.__module__.startswith("fitmodels.")), name


def test_packages_load_on_first_use():
    code = (
        "import sys, fitmodels; fitmodels.__version__; "
        "print([m for m in ('numpy', 'pandas', 'scipy', 'matplotlib') if m in sys.modules]); "
        "fitmodels.parameters; print('pandas' in sys.modules, 'scipy' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == ["[]", "False False"]


def test_the_structure_stays_within_its_limits():
    """The limits of benchmarks/structure.py, which prints what breaks them."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        structure = importlib.import_module("structure")
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))
    texts = {path: text for path, text in structure.sources().items() if text}
    gc.disable()  # the collector would go through the syntax trees again and again
    try:
        found, remarks = structure.measures(texts)
    finally:
        gc.enable()
    assert found["Python files"] <= 629
    assert found["public names"] <= 106
    assert found["complexity, 90 % at most"] <= 8
    assert remarks == []


def test_the_gate_names_tests_and_studies_that_exist():
    gate = (ROOT / ".ci/run").read_text("utf-8")
    listed = re.search(r"^(sample=\(\n.*?^\))", gate, flags=re.S | re.M)[1]
    shell = f'{listed}\nprintf "%s\\n" "${{sample[@]}}"'
    tests = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, check=True).stdout.split()
    studies = re.findall(r'"(\w+\.py)', re.search(r"studies=\(\n(.*?)\)", gate, flags=re.S)[1])
    assert tests
    assert studies
    for file, _, name in (test.partition("::") for test in tests):
        assert f"\ndef {name}" in (ROOT / file).read_text("utf-8"), f"{file} has no {name}"
    assert [name for name in studies if not (ROOT / "benchmarks" / name).is_file()] == []


def test_the_root_file_runs_on_its_own():
    """pytest does so where the folder of the checkout is no package name, and asks for names of its own."""
    spec = importlib.util.spec_from_file_location("__init__", Path(fitmodels.__file__))
    alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(alone)
    assert not hasattr(alone, "pytest_plugins")


@pytest.mark.parametrize("package", PACKAGES)
def test_dir_lists_the_public_names(package):
    module = importlib.import_module(f"fitmodels.{package}")
    assert set(module.__all__) <= set(dir(module))


def test_the_readme_holds_its_two_commands_a_line_each():
    lines = [line.strip() for line in README.splitlines() if line.strip().startswith("python3 -m venv")]
    assert tuple(lines) == COMMANDS


def test_the_output_in_the_readme_is_what_the_command_prints(tmp_path, monkeypatch, capsys):
    from fitmodels.cli import main
    from fitmodels.datasets import bundled

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    (file := tmp_path / "datasets/gc435_709m40/data.csv").parent.mkdir(parents=True)
    file.write_bytes(bundled("gc435_709m40").read_bytes())
    assert main(["datasets/gc435_709m40/data.csv"]) == 0
    assert re.findall(r"```text\n(.*?)```", README, flags=re.S) == [capsys.readouterr().out]


def test_the_python_in_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```python\n(.*?)```", README, flags=re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {})  # noqa: S102


@pytest.mark.packaging
def test_wheel_and_sdist_hold_what_is_needed_and_install(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "build", "--outdir", str(tmp_path), str(ROOT)], check=True, capture_output=True
    )
    (wheel,) = tmp_path.glob("*.whl")
    (sdist,) = tmp_path.glob("*.tar.gz")
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        "fitmodels/py.typed",
        "fitmodels/cards/templates/card.md",
        "fitmodels/datasets/gc435_709m40/data.csv",
        "fitmodels/datasets/gc435_709m40/README.md",
        "fitmodels/cli/__init__.py",
    }
    assert expected <= names
    assert not [name for name in names if {"tests", "benchmarks", "docs"} & set(name.split("/"))]
    listing = subprocess.run(["tar", "tzf", str(sdist)], check=True, capture_output=True, text=True).stdout
    for part in ("tests/test_package.py", "MANIFEST.in", "datasets/surf_table1/data.csv", "CHANGELOG.md"):
        assert part in listing
    # Alone, beside the dependencies of this environment: the gate installs it with them in environments of their own
    target = tmp_path / "installed"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(wheel)]
    subprocess.run(install, check=True)
    code = "from fitmodels import datasets as d; print(d.__file__, len(d.read_runs(d.bundled('ac2017_table1'))))"
    environment = {**os.environ, "PYTHONPATH": str(target)}
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True, capture_output=True)
    file, rows = run.stdout.decode().split()
    assert Path(file).is_relative_to(target)
    assert rows == "16"


@pytest.mark.parametrize("name", ["a.py", "app/templates/page.html", "controllers/exports/loop.st", "core/data.csv"])
def test_a_file_that_was_changed_after_the_installation_is_seen(tmp_path, name, pytestconfig):
    """The guard of `conftest`: templates and sources in C or structured text are data of the package."""
    guard = next(each for each in pytestconfig.pluginmanager.get_plugins() if hasattr(each, "stale_files"))
    tree, home = tmp_path / "tree", tmp_path / "home"
    for root in (tree, home):
        for one in ("a.py", "app/b.py", "app/templates/page.html", "controllers/exports/loop.st", "core/data.csv"):
            (root / one).parent.mkdir(parents=True, exist_ok=True)
            (root / one).write_text("1")
    folders = ("app", "controllers", "core")
    (tree / "core" / "data.csv~").write_text("kept by an editor")
    (home / "core" / "__pycache__").mkdir()
    (home / "core" / "__pycache__" / "b.pyc").write_text("")
    assert guard.stale_files(tree, home, folders) == []
    (tree / name).write_text("2")
    assert guard.stale_files(tree, home, folders) == [name]
    (tree / name).unlink()
    assert guard.stale_files(tree, home, folders) == [name]
