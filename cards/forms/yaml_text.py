"""YAML without a library: plain keys of ours, every text in double quotes, what could be read otherwise escaped.

The head of a README is shown as Markdown by readers that do not know it, so `<`, `[` and their like are escaped too.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

READ_OTHERWISE = "<>&[]`{}"


def yaml_text(data: Mapping[str, Any]) -> str:
    r"""A mapping as YAML in blocks: numbers, truth, texts, and lists and mappings of them.

    >>> print(yaml_text({"tool": "<b>", "simulated": True, "metrics": [{"value": 1e-05}]}), end="")
    tool: "\u003cb\u003e"
    simulated: true
    metrics:
      - value: 1.0e-05
    """
    return "".join(f"{line}\n" for line in _lines(data))


def _lines(value: Mapping[str, Any] | Sequence[Any]) -> Iterator[str]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            if isinstance(item, Mapping | list | tuple) and item:
                yield f"{key}:"
                yield from (f"  {line}" for line in _lines(item))
            else:
                yield f"{key}: {_scalar(item)}"
        return
    for item in value:
        first, *rest = _lines(item) if isinstance(item, Mapping) else [_scalar(item)]
        yield f"- {first}"
        yield from (f"  {line}" for line in rest)


def _scalar(value: object) -> str:
    if isinstance(value, str):
        return f'"{"".join(map(_letter, value))}"'
    if isinstance(value, float):
        return _number(value)
    return json.dumps(value)


def _letter(letter: str) -> str:
    if letter in READ_OTHERWISE or not letter.isprintable():
        code = ord(letter)
        return f"\\U{code:08x}" if code > 0xFFFF else f"\\u{code:04x}"
    return f"\\{letter}" if letter in '\\"' else letter


def _number(value: float) -> str:
    """YAML 1.1 takes 1e-05 for a text: it wants a point in a number with a power."""
    mantissa, e, power = repr(value).partition("e")
    return f"{mantissa}.0e{power}" if e and "." not in mantissa else repr(value)
