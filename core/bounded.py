"""Files that may come from elsewhere: regular files only, within limits of size, numbers, nesting and members.

Every file that a user may have received is opened here. `LIMITS` holds the largest size of each kind of file; the
other limits are the constants below it.
"""

import hashlib
import io
import json
import os
import re
import stat
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final, NoReturn

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
    "measurements": Limit(
        "a file of measurements", 500 * MB, "Split it; fitmodels batch fits tables of any size.", piped=True
    ),
    "workbook": Limit("a workbook", 200 * MB, "Save the sheet with the table as .csv."),
    "stream": Limit("a file that is read in parts", 1 << 50, "Split it."),
    "parameters": Limit("a parameter file", 50 * MB, _WHOLE),
    "draws": Limit("a file of draws", 500 * MB, _WHOLE),
    "priors": Limit("a file of priors", 1 * MB, "Keep only the tables of priors in it."),
    "card": Limit("a card.toml", 1 * MB, "Keep only the fields of the template in it."),
    "state": Limit("a stored state", 200 * MB, "Remove it; it is made again."),
    "text": Limit("a licence or scheduler file", 1 * MB, "Give another file."),
    "figure": Limit("a picture of a card", 50 * MB, "Draw it again with fitmodels card."),
    "output": Limit("a file written before", 500 * MB, "Choose another place with --out."),
}
DEEPEST: Final = 50  # levels of nested lists, objects or tables
LONGEST: Final = 300  # digits of an integer: it still is a finite float
MOST_VALUES: Final = 3_000_000  # numbers, texts, lists and objects of a JSON file
MOST_MEMBERS: Final = 5000  # of a zip archive
UNREADABLE_ARCHIVE: Final = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError)
_LARGEST_INTEGER = 10**LONGEST
_SURROGATE = re.compile("[\ud800-\udfff]")
_ESCAPED_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
AS_BYTES: Final = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)  # Windows changes ends of lines without it


def regular_status(path: str | os.PathLike[str], kind: str, error: type[FitmodelsError] = DataError) -> os.stat_result:
    """The status of a regular file that is not too large.

    Parameters
    ----------
    path, kind, error
        As in `read_bounded`.

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
) -> Iterator[io.BufferedReader]:
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
    >>> with open_regular(__file__, "text") as file:
    ...     file.read(3)
    b'\"\"\"'
    """
    regular_status(path, kind, error)  # before opening: to open a device may act on it
    descriptor = os.open(path, os.O_RDONLY | AS_BYTES | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))
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


def stored_json(path: str | os.PathLike[str], *, finite: bool = True) -> Any:  # noqa: ANN401
    """Content of a JSON file that an earlier run wrote; None where there is none that can be read.

    Examples
    --------
    >>> stored_json("nowhere.json") is None
    True
    """
    try:
        return parse_json(read_bounded(path, "state"), os.fspath(path), finite=finite)
    except (OSError, DataError):
        return None


def has_content(path: str | os.PathLike[str], content: bytes) -> bool:
    """Whether a path is a regular file of exactly this content."""
    try:
        return regular_status(path, "stream").st_size == len(content) and read_bounded(path, "stream") == content
    except (OSError, DataError):
        return False


def contains(path: str | os.PathLike[str], mark: bytes) -> bool:
    """Whether a path is a regular file that contains some bytes."""
    try:
        return mark in read_bounded(path, "output")
    except (OSError, DataError):
        return False


def sha256_of(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a regular file of any size.

    Raises
    ------
    OSError, DataError
        There is none that can be read.
    """
    with open_regular(path, "stream") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check(status: os.stat_result, path: str | os.PathLike[str], limit: Limit, error: type[FitmodelsError]) -> None:
    if not stat.S_ISREG(status.st_mode):
        what = next((words for is_kind, words in _KINDS if is_kind(status.st_mode)), "a special file")
        if what == "a folder":
            raise error(f"{path} is a folder, not a file: name {limit.kind} in it.")
        other = "; fitmodels, look and compare also read standard input, given as -" if limit.piped else ""
        raise error(f"{path}: is {what}, not a regular file. Save its content as a file{other}.")
    if status.st_size > limit.size:
        raise error(
            f"{path}: has {status.st_size} bytes; {limit.kind} has at most {limit.size} ({limit.size / MB:.0f} MB). "
            f"{limit.remedy}"
        )


@contextmanager
def open_archive(
    content: bytes, name: str, unpacked: int, error: type[FitmodelsError] = DataError, *, remedy: str = "Save it again."
) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive whose members and their stated sizes are within limits.

    Python's ``zipfile`` gives at most the stated size of a member, and compares its checksum.

    Parameters
    ----------
    content : bytes
    name : str
        Beginning of error messages.
    unpacked : int
        Bytes that all members may have.
    error : type
        Raised where it has more than 5000 members, or they are larger.
    remedy : str
        End of error messages.

    Raises
    ------
    UNREADABLE_ARCHIVE
        It is damaged; reading a member raises them too.
    """
    if (members := content.count(b"PK\x01\x02")) > MOST_MEMBERS:  # before a list of a million entries is made of them
        raise error(f"{name}: has {members} parts; at most {MOST_MEMBERS} are read. {remedy}")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if (size := sum(item.file_size for item in archive.infolist())) > unpacked:
            raise error(f"{name}: unpacks to {size} bytes; at most {unpacked / MB:.0f} MB are read. {remedy}")
        yield archive


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
        _check_nested(data, values=_ESCAPED_SURROGATE.search(text) is not None)
    except UnicodeDecodeError as fault:
        raise error(f"{name}: is not UTF-8 text (byte {fault.start}).{end}") from None
    except json.JSONDecodeError as fault:
        where = f"line {fault.lineno}, column {fault.colno}"
        raise error(f"{name}: is not JSON at {where}: {fault.msg.lower().removesuffix(' at')}.{end}") from None
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
    import tomllib

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
        raise ValueError(f"the key {twice[:40]!r} occurs twice in one object")
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


def _check_nested(data: object, *, values: bool = True) -> None:
    """Check parsed data: RecursionError where they are nested too deep, ``values`` for integers and texts too."""
    layer: list[Any] = [data]
    inside: Any = (lambda one: (*one, *one.values())) if values else dict.values
    for _ in range(DEEPEST + 1):
        for each in layer if values else ():
            _check_value(each)
        layer = [x for one in layer if type(one) in (dict, list) for x in (inside(one) if type(one) is dict else one)]
        if not layer:
            return
    raise RecursionError


def _check_value(value: object) -> None:
    if isinstance(value, str) and _SURROGATE.search(value):
        raise ValueError(f"the text {value[:20]!a} contains an unpaired surrogate")
    if type(value) is int and abs(value) >= _LARGEST_INTEGER:
        raise ValueError(f"holds an integer of more than {LONGEST} digits")
