"""Compares the installed versions with the lowest ones that pyproject.toml allows; ends with 1 where one differs."""

import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

project = tomllib.loads((Path(__file__).resolve().parent.parent / "pyproject.toml").read_text("utf-8"))["project"]
lines = [*project["dependencies"], *(line for extra in project["optional-dependencies"].values() for line in extra)]
wrong = []
for requirement in map(Requirement, lines):
    least = [bound.version for bound in requirement.specifier if bound.operator == ">="]
    if least and Version(version(requirement.name)) != Version(least[0]):
        wrong.append(f"{requirement.name}>={least[0]}: {version(requirement.name)} is installed")
sys.exit("\n".join(wrong) or None)
