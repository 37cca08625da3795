"""Versions of the schema: an older file is brought up step by step, a newer one is refused in words."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from ..core.errors import ParameterError
from .canonical import content_sha256
from .errors import short

FAMILY: Final = "fitmodels.parameters"
SCHEMA: Final = "fitmodels.parameters/1"
Step = Callable[[dict[str, Any]], dict[str, Any]]

# An older version -> what makes its data the data of the next version. A step takes a copy, moves what it must, and
# leaves the rest; ``schema_version`` is set by `migrated`. Version 1 is the first that was published.
STEPS: Mapping[int, Step] = {}


def migrated(data: object, name: str, steps: Mapping[int, Step] = STEPS, current: int = 1) -> dict[str, Any]:
    """Data of a file in the schema of the current version.

    A checksum that held before a step holds after it: the steps are no change by anybody else.

    Parameters
    ----------
    data : object
        As JSON has it.
    name : str
        What the sentence of an error begins with.
    steps : mapping
        From each older version, the step to the next.
    current : int
        The version that is read.

    Raises
    ------
    ParameterError
        No parameter file; a newer version; an older one that no step starts from.

    Examples
    --------
    >>> old = {"schema_version": "fitmodels.parameters/1", "tool": "GC435"}
    >>> def moved(data):
    ...     return {"identity": {"tool": data.pop("tool")}, **data}
    >>> migrated(old, "params.json", {1: moved}, current=2)
    {'identity': {'tool': 'GC435'}, 'schema_version': 'fitmodels.parameters/2'}
    """
    if not isinstance(data, dict) or "schema_version" not in data:
        raise ParameterError(f"{name}: is not a parameter file: it has no schema_version {FAMILY}/{current}.")
    version = _version(data["schema_version"], name, current)
    while version < current:
        if version not in steps:
            raise ParameterError(
                f"{name}: is of the older schema {FAMILY}/{version}, which this version cannot bring to "
                f"{FAMILY}/{current}; fit the data again."
            )
        data = _stepped(data, steps[version], version + 1, name)
        version += 1
    return data


def _stepped(data: dict[str, Any], step: Step, to: int, name: str) -> dict[str, Any]:
    held = data.get("content_sha256") == content_sha256(data)
    try:
        moved = {**step(dict(data)), "schema_version": f"{FAMILY}/{to}"}
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise ParameterError(
            f"{name}: breaks the older schema {FAMILY}/{to - 1} ({type(error).__name__} {short(str(error))}), so it "
            "cannot be brought up to date. Restore the file or fit again."
        ) from None
    return {**moved, "content_sha256": content_sha256(moved)} if held else moved


def _version(found: object, name: str, current: int) -> int:
    family, _, number = found.partition("/") if isinstance(found, str) else ("", "", "")
    if family != FAMILY or not (number.isascii() and number.isdecimal()) or len(number) > 9:
        raise ParameterError(
            f"{name}: schema_version is {short(found)}, not {FAMILY}/{current}; is it a parameter file?"
        )
    if int(number) > current:
        raise ParameterError(
            f"{name}: is of the newer schema {short(found)}; this version reads {FAMILY}/{current}. Upgrade fitmodels."
        )
    return int(number)
