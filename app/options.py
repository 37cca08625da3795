"""Options of the command of a file, as words: set, replaced and removed one by one."""

import shlex
from collections.abc import Iterator, Sequence

from ..datasets.options import OPTIONS, TAKEN, chosen, given_in, merged
from .project import Entry


def pairs(options: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each option with its value; empty for a flag.

    >>> list(pairs(["--unit", "VB=um", "--hidden", "--tool=a b"]))
    [('--unit', 'VB=um'), ('--hidden', ''), ('--tool', 'a b')]
    """
    return ((one.name, one.value) for one in given_in(options))


def words(options: Sequence[tuple[str, str]]) -> list[str]:
    """The words of options.

    >>> words([("--unit", "VB=um"), ("--hidden", ""), ("--value", "-1")])
    ['--unit', 'VB=um', '--hidden', '--value=-1']
    """
    found: list[str] = []
    for name, value in options:
        found += [name] if _is_flag(name) else [f"{name}={value}"] if value.startswith("-") else [name, value]
    return found


def _is_flag(name: str) -> bool:
    return name in OPTIONS and OPTIONS[name].flag


def replaced(options: Sequence[str], name: str, value: str) -> list[str]:
    """Options with one set; what it replaces is left out. Without a value, or after ``ROLE=``, it is removed.

    >>> replaced(["--unit", "VB=mm", "--tool", "A"], "--unit", "VB=um")
    ['--tool', 'A', '--unit', 'VB=um']
    >>> replaced(["--unit", "VB=mm"], "--unit", "VB=")
    []
    """
    by_role = OPTIONS[name].once == "role"
    empty = not value or (by_role and value.endswith("="))
    new = words([(name, value)])
    found = merged(options, new)
    return found[: -len(new)] if empty and not _is_flag(name) else found


def applied(options: Sequence[str], remedy: str) -> list[str]:
    """Options with those of a remedy, as typed.

    >>> applied(["--unit", "VB=mm"], "--unit VB=um --map 'f=col 2'")
    ['--unit', 'VB=um', '--map', 'f=col 2']
    """
    return merged(options, words(list(pairs(shlex.split(remedy)))))


def of_reading(options: Sequence[str]) -> list[str]:
    """Those that say how the file is read.

    >>> of_reading(["--unit", "VB=um", "--form", "linear"])
    ['--unit', 'VB=um']
    """
    return chosen(options, TAKEN["look"])


def of_comparison(options: Sequence[str]) -> list[str]:
    """Those that ``compare`` takes: it compares the forms, for no criterion."""
    return chosen(options, TAKEN["compare"])


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
    if any(one.purpose == "record" for one in given_in(entry.options)):
        return ["ident", entry.name, *entry.options, "--out", f"{entry.stem}-fit", *end]
    return [entry.name, *entry.options, *end]
