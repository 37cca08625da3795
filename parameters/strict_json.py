"""JSON read strictly: what two readers could understand differently is refused."""

import json
from collections.abc import Iterator
from math import isfinite
from typing import Any, NoReturn

from ..core.errors import ParameterError
from .errors import short

DEEPEST = 50  # levels of lists and objects
LONGEST = 300  # digits of an integer: it still is a finite float
CURE = "Restore the file or fit again."


def strict_json(content: bytes, name: str) -> Any:  # noqa: ANN401
    """Parse plain JSON and nothing else.

    Parameters
    ----------
    content : bytes
        UTF-8, with or without a byte order mark.
    name : str
        What the sentence of an error begins with.

    Raises
    ------
    ParameterError
        Not UTF-8, not JSON (with line and column), NaN or infinity, a key twice in one object, a
        number too large, half a surrogate pair, or more than 50 levels of nesting.

    Examples
    --------
    >>> strict_json(b'{"low": 0.1}', "params.json")
    {'low': 0.1}
    """
    try:
        data = json.loads(
            content.decode("utf-8-sig"),
            object_pairs_hook=_once,
            parse_constant=_no_constant,
            parse_float=_finite,
            parse_int=_integer,
        )
        _check_depth(data)
    except UnicodeDecodeError as error:
        raise ParameterError(f"{name}: is not UTF-8 text (byte {error.start}). {CURE}") from None
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        why = error.msg.lower().removesuffix(" at")
        raise ParameterError(f"{name}: is not JSON at {where}: {why}. {CURE}") from None
    except RecursionError:
        raise ParameterError(f"{name}: is nested deeper than {DEEPEST} levels. {CURE}") from None
    except ValueError as error:
        raise ParameterError(f"{name}: {error}. {CURE}") from None
    return data


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {short(twice)} stands twice in one object")
    return found


def _no_constant(literal: str) -> NoReturn:
    raise ValueError(f"holds {literal}; every number must be finite")


def _finite(literal: str) -> float:
    value = float(literal)
    if not isfinite(value):
        raise ValueError(f"holds {literal[:20]}; every number must be finite")
    return value


def _integer(literal: str) -> int:
    if len(literal) > LONGEST:
        raise ValueError(f"holds an integer of {len(literal)} digits; the limit is {LONGEST}")
    return int(literal)


def _check_depth(data: object) -> None:
    layer = [data]
    for _ in range(DEEPEST + 1):
        layer = [inner for outer in layer for inner in _inside(outer)]
        if not layer:
            return
    raise RecursionError


def _inside(outer: object) -> Iterator[object]:
    if isinstance(outer, dict):
        yield from outer
        yield from outer.values()
    elif isinstance(outer, list):
        yield from outer
    elif isinstance(outer, str):
        _check_text(outer)


def _check_text(text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ValueError(f"the text {text[:20]!a} holds half a character") from None
