"""Format of the parameter file: canonical form with its SHA-256, and versions of the schema.

The canonical form is JSON of everything in the file but ``content_sha256`` at its top: keys of every object sorted by
code point, no blanks, ``,`` and ``:`` between, UTF-8 with only quotes, backslashes and control characters escaped as
Python's ``json.dumps`` does, integers as digits, and a float as the shortest decimal that reads back to the same 64
bits, as Python's ``repr`` has it. A float that is a whole number below 2^53 is written without its ``.0``, and only
-0.0 keeps its sign and point: JSON does not distinguish 50.0 from 50, so a program that reads and writes the file again
leaves the checksum valid, and one changed bit of one number makes it invalid.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any, Final

from ..core.errors import ParameterError
from .messages import short

REMEDY = "Restore the file or fit again."
WHOLE = 2.0**53  # every whole number below is a float of its own


def canonical_bytes(data: Mapping[str, Any]) -> bytes:
    """The canonical form, which the checksum is computed from; ValueError for a number that is not finite.

    Examples
    --------
    >>> canonical_bytes({"b": [50.0, 1e-7], "a": "µ", "content_sha256": "0"}).decode()
    '{"a":"µ","b":[50,1e-07]}'
    """
    held = {key: _plain(value) for key, value in data.items() if key != "content_sha256"}
    text = json.dumps(held, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode()


def content_sha256(data: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical form, 64 hexadecimal digits.

    Examples
    --------
    >>> content_sha256({"a": 1}) == content_sha256({"a": 1.0, "content_sha256": "any"})
    True
    """
    return hashlib.sha256(canonical_bytes(data)).hexdigest()


def _is_written_whole(value: float) -> bool:
    """Whether a whole number is written without its ``.0``."""
    return abs(value) < WHOLE and str(value) != "-0.0"


_SAME = frozenset({str, int, bool, type(None)})  # types that are written as they are


def _plain(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, float):
        return int(value) if value.is_integer() and _is_written_whole(value) else value
    # what stays as it is, without a call: a file holds thousands of numbers
    if isinstance(value, list | tuple):
        return [x if type(x) in _SAME or (type(x) is float and not x.is_integer()) else _plain(x) for x in value]
    if isinstance(value, dict | Mapping):
        return {key: x if type(x) in _SAME else _plain(x) for key, x in value.items()}
    return value


FAMILY: Final = "fitmodels.parameters"
SCHEMA: Final = "fitmodels.parameters/10"
Step = Callable[[dict[str, Any]], dict[str, Any]]

JUDGED = ("tool_life", "dynamics", "adaptive_force")  # sections with a verdict, as each law has one


def _without_verdicts(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 2 with a verdict of null, whatever a field of that name held before it was one."""
    judged = {name: {**data[name], "verdict": None} for name in JUDGED if data.get(name) is not None}
    laws = {name: {**law, "verdict": None} for name, law in data.get("laws", {}).items()}
    return {**data, **judged, **({"laws": laws} if "laws" in data else {})}


MONITORING = (
    "idle",
    "arm_after",
    "lost_after",
    "stuck_after",
    "heartbeat",
    "overload_after",
    "on_fault",
    "feed_forward",
)


def _without_disengagement(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 3 with the monitoring of the load left open, whatever fields of those names held before.

    ``load_low`` had to lie below zero, so that a lost sensor, which reads zero, was taken for air: it is left open too.
    """
    line, pi = data.get("load_line"), data.get("pi")
    if pi is not None:
        unknown = dict.fromkeys(("probability_interval", "required_probability", "verdict"))
        data = {**data, "pi": {**pi, **unknown, "missed": {}, "setpoint_weight": 1.0}}
    if line is None or line.get("engagement") is None:
        return data
    kept = {name: value for name, value in line["engagement"].items() if name != "disengage_after"}
    if (kept.get("load_low") or 0.0) <= 0:
        kept["load_low"] = None
    return {**data, "load_line": {**line, "engagement": {**kept, **dict.fromkeys(MONITORING)}}}


def _to_version_5(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 4 with dynamics of one structure and no drive, whatever fields of the new names held before."""
    data = {**data, "drive": None}
    dynamics = data.get("dynamics")
    if dynamics is None:
        return data
    new = {"d": [1.0], "alternatives": [], "held_out_on": None, "own_fit": None}
    return {**data, "dynamics": {**dynamics, **new}}


def _to_version_6(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 5 with laws of first order and limits of power, force and wear alone."""
    if data.get("tool_life"):
        data = {**data, "tool_life": {**data["tool_life"], "taylor": None, "curves": None}}
    limits = {"limits": {**data["limits"], "responses": {}}} if data.get("limits") else {}
    if "laws" not in data:
        return {**data, **limits}
    return {**data, **limits, "laws": {name: _of_first_order(law) for name, law in data["laws"].items()}}


def _of_first_order(law: dict[str, Any]) -> dict[str, Any]:
    other = {"alternative": _of_first_order(law["alternative"])} if law.get("alternative") else {}
    return {**law, **other, "terms": [], "centres": {}, "fixed": {}, "life": None}


def _to_version_7(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 6 without costs, and with the longest life and the largest wear of the tests unknown."""
    laws = {name: _without_longest(law) for name, law in data.get("laws", {}).items()}
    life = data.get("tool_life")
    tool_life = {"tool_life": {**life, "wear_observed": None}} if life else {}
    return {**data, **({"laws": laws} if "laws" in data else {}), **tool_life, "costs": None}


def _to_version_8(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 7 with the origin of settings of force control and of merged sections unknown."""
    roughness = {"force_low": None, "force_high": None, "depth": None, "nose_radius": None, "unit_depth": "mm"}
    both: dict[str, Any] = {"spindle_speed": None, "sources": {}}
    added: dict[str, dict[str, Any]] = {
        "roughness": {**roughness, **both},
        "adaptive_force": both,
        "provenance": {"merged": []},
    }
    return {**data, **{name: {**data[name], **new} for name, new in added.items() if data.get(name)}}


def _to_version_9(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 8 without sums of laws and without history, whatever fields of these names held before."""
    laws = {"laws": {name: _without_sums(law) for name, law in data["laws"].items()}} if "laws" in data else {}
    return {**data, **laws, "history": []}


def _without_sums(law: dict[str, Any]) -> dict[str, Any]:
    other = {"alternative": _without_sums(law["alternative"])} if law.get("alternative") else {}
    return {**law, **other, "sums": None}


def _to_version_10(data: dict[str, Any]) -> dict[str, Any]:
    """Data of version 9 with the check of competing forms under its new name."""
    laws = {name: _with_competing_forms(law) for name, law in data.get("laws", {}).items()}
    return {**data, **({"laws": laws} if "laws" in data else {})}


def _with_competing_forms(law: dict[str, Any]) -> dict[str, Any]:
    other = {"alternative": _with_competing_forms(law["alternative"])} if law.get("alternative") else {}
    checks = {"competing forms" if name == "rival forms" else name: one for name, one in law.get("checks", {}).items()}
    return {**law, **other, **({"checks": checks} if "checks" in law else {})}


def _without_longest(law: dict[str, Any]) -> dict[str, Any]:
    other = {"alternative": _without_longest(law["alternative"])} if law.get("alternative") else {}
    return {**law, **other, **({"life": {**law["life"], "longest": None}} if law.get("life") else {})}


# Older version -> function that converts a copy of its data to the next version; `migrated` sets ``schema_version``.
# Version 2 added ``reading``, the doubts about the data, and ``null`` of ``identity.simulated`` where it is not known.
# Version 3 added ``verdict`` of laws, tool life, dynamics and adaptive force, ``suspects`` and ``without`` of laws.
# Version 4 added the monitoring of the load in ``load_line.engagement`` and ``setpoint_weight``, ``verdict``,
# ``missed``, ``probability_interval`` and ``required_probability`` of gains; it dropped ``disengage_after`` (the loop
# disengages at once and keeps its feed) and any ``load_low`` that is not above zero.
# Version 5 added ``d`` and ``alternatives`` of dynamics: the noise denominator, other structures and their weights;
# ``held_out_on`` and ``own_fit``: which samples and which model a fit is of; ``drive``; and settings of adaptive force
# that are not stated.
# Version 6 added ``terms``, ``centres`` and ``fixed`` of laws: second order, and exponents that were not estimated;
# ``life`` of laws, the distribution of tool lives; ``taylor`` and ``curves`` of the tool life;
# and ``responses`` of limits.
# Version 7 added ``costs``, ``longest`` of the lives of a law and ``wear_observed`` of the tool life.
# Version 8 added ``merged`` of the provenance; ``sources`` and ``spindle_speed`` of roughness and adaptive force; the
# valid readings, depth and nose radius of roughness.
# Version 9 added ``sums`` of laws, their rows as sums by edge, and ``history``, the versions with further edges.
# Version 10 renamed the check ``rival forms`` of laws to ``competing forms``.
STEPS: Mapping[int, Step] = {
    1: lambda data: {"reading": None, **data},
    2: _without_verdicts,
    3: _without_disengagement,
    4: _to_version_5,
    5: _to_version_6,
    6: _to_version_7,
    7: _to_version_8,
    8: _to_version_9,
    9: _to_version_10,
}


def migrated(data: object, name: str, steps: Mapping[int, Step] = STEPS, current: int = 10) -> dict[str, Any]:
    """Data of a file in the schema of the current version.

    A checksum that was valid before a step is renewed after it.

    Parameters
    ----------
    data : object
        As JSON has it.
    name : str
        Beginning of error messages.
    steps : mapping
        From each older version, the step to the next.
    current : int
        The version that is read.

    Raises
    ------
    ParameterError
        Not a parameter file; a newer version; an older one without a conversion.

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
