"""Files that may come from elsewhere: regular files only, within limits of size, numbers, nesting and members.

Every file that a user may have received is opened here. `LIMITS` holds the largest size of each kind of file; the
other limits are the constants below it.
"""

import json
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from typing import Any, BinaryIO, Final, NoReturn

from .errors import DataError, FitmodelsError

MB: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Limit:
    """Largest size of a kind of file.

    Attributes
    ----------
    kind : str
        With its article, as messages name it.
    size : int
        Bytes.
    remedy : str
        What to do with a larger file.
    piped : bool
        Whether commands read it from standard input too.
    """

    kind: str
    size: int
    remedy: str
    piped: bool = False


_WHOLE = "Give the file as fitmodels wrote it."
LIMITS: Final[Mapping[str, Limit]] = {
    "table": Limit("a table of measurements", 1000 * MB, "Split it, or fit it with fitmodels batch.", piped=True),
    "record": Limit("a record", 1000 * MB, "Export a shorter part of the run.", piped=True),
    "workbook": Limit("a workbook", 200 * MB, "Save the sheet as .csv."),
    "parameters": Limit("a parameter file", 50 * MB, _WHOLE),
    "draws": Limit("a file of draws", 500 * MB, _WHOLE),
    "priors": Limit("a file of priors", 1 * MB, "Keep only the tables of priors in it."),
    "card": Limit("a card.toml", 1 * MB, "Keep only the fields of the template in it."),
    "site": Limit("the list of a site", 200 * MB, "Publish into another folder."),
    "state": Limit("a stored state", 200 * MB, "Remove it; it is made again."),
    "settings": Limit("a file of settings", 1 * MB, _WHOLE),
    "output": Limit("a file written before", 1000 * MB, "Choose another place with --out."),
}
DEEPEST: Final = 50  # levels of nested lists, objects or tables
LONGEST: Final = 300  # digits of an integer: it still is a finite float
MOST_VALUES: Final = 3_000_000  # numbers, texts, lists and objects of a JSON file
_LARGEST_INTEGER = 10**LONGEST

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"))


def regular_status(path: str | os.PathLike[str], kind: str, error: type[FitmodelsError] = DataError) -> os.stat_result:
    """The status of a regular file that is not too large.

    Parameters
    ----------
    path : path
    kind : str
        Of `LIMITS`.
    error : type
        Raised where it is no regular file, or too large.

    Raises
    ------
    OSError
        It does not exist, or cannot be reached.
    """
    try:
        status = os.stat(path)  # noqa: PTH116  follows links as open does
    except ValueError:
        raise OSError(22, "the name contains a character that no file name has") from None
    _check(status, path, LIMITS[kind], error)
    return status


@contextmanager
def open_regular(
    path: str | os.PathLike[str], kind: str, error: type[FitmodelsError] = DataError
) -> Iterator[BinaryIO]:
    """Open a regular file for reading, in binary; pipes, devices, sockets and folders are refused without a wait.

    Parameters
    ----------
    path : path
    kind : str
        Of `LIMITS`; the size is compared with it.
    error : type
        Raised where it is no regular file, or too large.

    Raises
    ------
    OSError
        It does not exist, or cannot be opened.

    Examples
    --------
    >>> with open_regular(__file__, "table") as file:
    ...     file.read(3)
    b'\"\"\"'
    """
    regular_status(path, kind, error)  # before opening: to open a device may act on it
    descriptor = os.open(path, _FLAGS)
    with os.fdopen(descriptor, "rb") as file:
        _check(os.fstat(descriptor), path, LIMITS[kind], error)
        yield file


def read_bounded(path: str | os.PathLike[str], kind: str, error: type[FitmodelsError] = DataError) -> bytes:
    """Content of a regular file that is not too large and does not change meanwhile.

    Parameters
    ----------
    path : path
    kind : str
        Of `LIMITS`.
    error : type
        Raised where it is no regular file, too large, or changed while it was read.

    Raises
    ------
    OSError
        It does not exist, or cannot be read.

    Examples
    --------
    >>> read_bounded("/dev/null", "card")
    Traceback (most recent call last):
    fitmodels.core.errors.DataError: /dev/null: is a device, not a regular file. Save its content as a file.
    """
    with open_regular(path, kind, error) as file:
        before = os.fstat(file.fileno())
        try:
            content = file.read(before.st_size + 1)
        except MemoryError:
            raise error(f"{path}: {before.st_size} bytes do not fit into memory. {LIMITS[kind].remedy}") from None
        after = os.fstat(file.fileno())
    if len(content) != before.st_size or (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise error(f"{path}: changed while it was read. Start again when it is complete.")
    return content


def _check(status: os.stat_result, path: str | os.PathLike[str], limit: Limit, error: type[FitmodelsError]) -> None:
    if not stat.S_ISREG(status.st_mode):
        what = next((words for is_kind, words in _KINDS if is_kind(status.st_mode)), "a special file")
        if what == "a folder":
            raise error(f"{path}: is a folder; give the path of {limit.kind} in it.")
        other = ", or give - and redirect it to standard input" if limit.piped else ""
        raise error(f"{path}: is {what}, not a regular file. Save its content as a file{other}.")
    if status.st_size > limit.size:
        raise error(
            f"{path}: has {status.st_size} bytes; {limit.kind} has at most {limit.size} ({limit.size / MB:.0f} MB). "
            f"{limit.remedy}"
        )


def parse_json(
    content: bytes, name: str, *, error: type[FitmodelsError] = DataError, remedy: str = "", finite: bool = True
) -> Any:  # noqa: ANN401
    """Parse plain JSON and nothing else.

    Parameters
    ----------
    content : bytes
        UTF-8, with or without a byte order mark.
    name : str
        Beginning of error messages.
    error : type
        Raised where it is not UTF-8, not JSON (with line and column), has a key twice in one object, a number too
        large, an unpaired surrogate, more than 50 levels of nesting or more than three million values.
    remedy : str
        End of error messages.
    finite : bool
        Whether NaN and infinity are refused.

    Examples
    --------
    >>> parse_json(b'{"low": 0.1}', "params.json")
    {'low': 0.1}
    """
    end = f" {remedy}" if remedy else ""
    try:
        if (values := sum(map(content.count, (b",", b"[", b"{")))) > MOST_VALUES:
            raise ValueError(f"holds up to {values} values; the limit is {MOST_VALUES}")
        options: dict[str, Any] = {"parse_constant": _no_constant, "parse_float": _finite} if finite else {}
        text = content.decode("utf-8-sig")
        data = json.loads(text, object_pairs_hook=_once, parse_int=_integer, **options)
        _check_nested(data)
    except UnicodeDecodeError as fault:
        raise error(f"{name}: is not UTF-8 text (byte {fault.start}).{end}") from None
    except json.JSONDecodeError as fault:
        where = f"line {fault.lineno}, column {fault.colno}"
        why = fault.msg.lower().removesuffix(" at")
        raise error(f"{name}: is not JSON at {where}: {why}.{end}") from None
    except RecursionError:
        raise error(f"{name}: is nested deeper than {DEEPEST} levels.{end}") from None
    except ValueError as fault:
        raise error(f"{name}: {fault}.{end}") from None
    return data


def parse_toml(
    content: bytes, name: str, *, error: type[FitmodelsError] = DataError, remedy: str = ""
) -> dict[str, Any]:
    """Parse TOML within limits of nesting and of the digits of integers.

    Parameters
    ----------
    content : bytes
        UTF-8, with or without a byte order mark.
    name : str
        Beginning of error messages.
    error : type
        Raised where it is not UTF-8, not TOML, has an integer of more than 300 digits, or more than 50 levels of
        nesting.
    remedy : str
        End of error messages.

    Examples
    --------
    >>> parse_toml(b'license = "CC-BY-4.0"', "card.toml")
    {'license': 'CC-BY-4.0'}
    """
    end = f" {remedy}" if remedy else ""
    try:
        text = content.decode("utf-8-sig")
        _check_keys(text)  # the time of tomllib grows with the square of the parts of a key
        data = tomllib.loads(text)
        _check_nested(data)
    except UnicodeDecodeError as fault:
        raise error(f"{name}: is not UTF-8 text (byte {fault.start}).{end}") from None
    except tomllib.TOMLDecodeError as fault:
        raise error(f"{name}: is not TOML: {str(fault)[:1].lower()}{str(fault)[1:]}.{end}") from None
    except RecursionError:
        raise error(f"{name}: is nested deeper than {DEEPEST} levels.{end}") from None
    except ValueError as fault:
        why = str(fault)
        if "integer string conversion" in why:
            why = f"holds an integer of more than {LONGEST} digits"
        raise error(f"{name}: {why}.{end}") from None
    return data


_BETWEEN_KEYS: Final = str.maketrans(dict.fromkeys("=,{}[]#", "\n"))
_DOTS: Final = re.compile(r"\.(?:[ \t]*\.)+")


def _check_keys(text: str) -> None:
    """RecursionError for a key of more than 50 parts, or text that looks like one."""
    if any(part.count(".") > DEEPEST for part in _DOTS.sub("", text.translate(_BETWEEN_KEYS)).split("\n")):
        raise RecursionError


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {_shown(twice)} occurs twice in one object")
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


def _check_nested(data: object) -> None:
    """Check the nesting, integers and texts of parsed data; RecursionError where they are nested too deep."""
    layer = [data]
    for _ in range(DEEPEST + 1):
        layer = [inner for outer in layer for inner in _inside(outer)]
        if not layer:
            return
    raise RecursionError


def _inside(outer: object) -> Iterable[object]:
    if isinstance(outer, dict):
        yield from outer
        yield from outer.values()
    elif isinstance(outer, list):
        yield from outer
    elif isinstance(outer, str):
        _check_text(outer)
    elif type(outer) is int and abs(outer) >= _LARGEST_INTEGER:
        raise ValueError(f"holds an integer of more than {LONGEST} digits")


def _check_text(text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ValueError(f"the text {text[:20]!a} contains an unpaired surrogate") from None


def _shown(text: str) -> str:
    return repr(text if len(text) <= 40 else f"{text[:37]}...")
