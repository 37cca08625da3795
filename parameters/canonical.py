r"""The canonical form of a parameter file, and its SHA-256: whether it was changed since it was written.

The canonical form is JSON of everything in the file but ``content_sha256`` at its top: keys of every object sorted by
code point, no blanks, ``,`` and ``:`` between, UTF-8 with only ``"``, ``\`` and control characters escaped as Python's
``json.dumps`` does, integers as digits, and a float as the shortest decimal that reads back to the same 64 bits, as
Python's ``repr`` has it. A float that is a whole number below 2^53 stands without its ``.0``, and only -0.0 keeps its
sign and point: JSON does not tell 50.0 from 50, so that a program which reads and writes the file again leaves the
checksum true, and one bit of one number makes it false.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

WHOLE = 2.0**53  # every whole number below is a float of its own


def canonical(data: Mapping[str, Any]) -> bytes:
    """Bytes that the checksum is of; ValueError for a number that is not finite.

    Examples
    --------
    >>> canonical({"b": [50.0, 1e-7], "a": "µ", "content_sha256": "0"}).decode()
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
    return hashlib.sha256(canonical(data)).hexdigest()


def _plain(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, float):
        whole = value.is_integer() and abs(value) < WHOLE and str(value) != "-0.0"
        return int(value) if whole else value
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value
