"""Options of the command of a file, as words: set, replaced and removed one by one."""

import shlex
from collections.abc import Iterator, Sequence
from typing import Final

from ..datasets.options import BY_ROLE, OF_ROWS
from .project import Entry

FLAGS: Final = ("--hidden",)
OF_FITTING: Final = ("--law", "--error", "--criterion", "--gauge-sd", "--form", "--by")
OF_RECORD: Final = ("--input", "--output", "--reference", "--time", "--rate", "--sample-time", "--resample")
OF_OUTPUT: Final = ("--force", "--out", "--full", "--quiet", "--json")


def pairs(options: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each option with its value; empty for a flag.

    >>> list(pairs(["--unit", "VB=um", "--hidden", "--tool=a b"]))
    [('--unit', 'VB=um'), ('--hidden', ''), ('--tool', 'a b')]
    """
    rest = list(options)
    while rest:
        name, equals, value = rest.pop(0).partition("=")
        if not equals and name not in FLAGS and rest:
            value = rest.pop(0)
        yield name, value


def words(options: Sequence[tuple[str, str]]) -> list[str]:
    """The words of options.

    >>> words([("--unit", "VB=um"), ("--hidden", ""), ("--value", "-1")])
    ['--unit', 'VB=um', '--hidden', '--value=-1']
    """
    found: list[str] = []
    for name, value in options:
        found += [name] if name in FLAGS else [f"{name}={value}"] if value.startswith("-") else [name, value]
    return found


def _key(name: str, value: str) -> tuple[str, str]:
    """Key of an option that is given once."""
    if name in BY_ROLE:
        return name, value.partition("=")[0]
    return (name, value) if name in (*OF_ROWS, "--law") else (name, "")


def replaced(options: Sequence[str], name: str, value: str) -> list[str]:
    """Options with one set; what it replaces is left out. Without a value, or after ``ROLE=``, it is removed.

    >>> replaced(["--unit", "VB=mm", "--tool", "A"], "--unit", "VB=um")
    ['--tool', 'A', '--unit', 'VB=um']
    >>> replaced(["--unit", "VB=mm"], "--unit", "VB=")
    []
    """
    kept = [pair for pair in pairs(options) if _key(*pair) != _key(name, value)]
    empty = not value or (name in BY_ROLE and value.endswith("="))
    return words(kept if empty and name not in FLAGS else [*kept, (name, value)])


def applied(options: Sequence[str], remedy: str) -> list[str]:
    """Options with those of a remedy, as typed.

    >>> applied(["--unit", "VB=mm"], "--unit VB=um --map 'f=col 2'")
    ['--unit', 'VB=um', '--map', 'f=col 2']
    """
    found = list(options)
    for name, value in pairs(shlex.split(remedy)):
        found = replaced(found, name, value)
    return found


def of_reading(options: Sequence[str]) -> list[str]:
    """Those that say how the file is read.

    >>> of_reading(["--unit", "VB=um", "--form", "linear"])
    ['--unit', 'VB=um']
    """
    return words([pair for pair in pairs(options) if pair[0] not in (*OF_FITTING, *OF_RECORD)])


def of_comparison(options: Sequence[str]) -> list[str]:
    """Those that ``compare`` takes: it compares the forms, for no criterion."""
    return words(
        [pair for pair in pairs(options) if pair[0] not in ("--form", "--criterion", "--gauge-sd", *OF_RECORD)]
    )


def typed(options: Sequence[str]) -> list[tuple[str, str]]:
    """Each option as typed, and its value.

    >>> typed(["--leave-out", "E07", "--leave-out", "lines 3"])
    [('--leave-out E07', 'E07'), ("--leave-out 'lines 3'", 'lines 3')]
    """
    return [(shlex.join(words([pair])), pair[1]) for pair in pairs(options)]


def command_of(entry: Entry, *, force: bool = False) -> list[str]:
    """Words of the command that fits a file, or identifies a record; ``force`` replaces the results of other options.

    >>> command_of(Entry(name="d.csv", sha256=64 * "0", options=("--unit", "VB=um")))
    ['d.csv', '--unit', 'VB=um']
    """
    end = ["--force"] if force else []
    if any(name in OF_RECORD for name, _ in pairs(entry.options)):
        return ["ident", entry.name, *entry.options, "--out", f"{entry.stem}-fit", *end]
    return [entry.name, *entry.options, *end]
