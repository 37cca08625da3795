"""Options of reading a file of tests, and the table of all options of the commands that read or fit one, as words."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import inf
from numbers import Real
from types import MappingProxyType
from typing import Any, Final, Literal, TypeAlias, get_args

from ..core.display import Displayable
from ..core.errors import UsageError
from .vocabulary import ROLES, roles_named

DecimalMark: TypeAlias = Literal["point", "comma"]
Process: TypeAlias = Literal["turning", "milling", "drilling", "grinding"]
Purpose: TypeAlias = Literal[
    "reading", "law", "form", "criterion", "gauge", "posterior", "verification", "record", "batch", "comparison",
    "place", "screen",
]  # fmt: skip
Once: TypeAlias = Literal["once", "role", "target", "law", "edge"]


@dataclass(frozen=True, slots=True)
class CommandOption:
    """An option of a command that reads or fits a file.

    Attributes
    ----------
    purpose : str
        ``law``: what is fitted; ``place`` and ``screen``: where and how it is written, which changes no result.
    flag : bool
        Whether it has no value.
    once : {"once", "role", "target", "law", "edge"}
        What it is given once for: the command, a role, rows (and a quantity), the response of a law; ``edge``: the
        role edge, as ``--map edge=COLUMN``.
    """

    purpose: Purpose
    flag: bool = False
    once: Once = "once"


def _options(purpose: Purpose, names: str, *, flag: bool = False, once: Once = "once") -> dict[str, CommandOption]:
    return {f"--{name}": CommandOption(purpose, flag, once) for name in names.split()}


OPTIONS: Final[Mapping[str, CommandOption]] = MappingProxyType({
    **_options("reading", "map unit range value", once="role"),
    **_options("reading", "correct leave-out", once="target"),
    **_options("reading", "edge", once="edge"),
    **_options("reading", "process tool work decimal delimiter sheet"),
    **_options("reading", "hidden", flag=True),
    **_options("law", "law", once="law"),
    **_options("law", "error by"),
    **_options("form", "form", once="role"),
    **_options("criterion", "criterion"),
    **_options("gauge", "gauge-sd"),
    **_options("posterior", "seed draws priors"),
    **_options("posterior", "student", flag=True),
    **_options("verification", "verify posterior-figures", flag=True),
    **_options("record", "input output reference time rate sample-time resample"),
    **_options("batch", "jobs dask card title group pairs"),
    **_options("batch", "table-only keep-draws no-site", flag=True),
    **_options("comparison", "write figure"),
    **_options("place", "out"),
    **_options("screen", "force full quiet json", flag=True),
    "-q": CommandOption("screen", flag=True),
})  # fmt: skip
TAKEN: Final[Mapping[str, tuple[Purpose, ...]]] = MappingProxyType({  # of the options of the main command
    "look": ("reading",), "compare": ("reading", "law"), "next": ("reading", "criterion"),
    "batch": ("reading", "law", "form", "criterion", "gauge", "posterior"),
})  # fmt: skip
_CHANGE_OF_LAW = re.compile(r"([+-])\s*([^,;+-]+)")


@dataclass(frozen=True, slots=True)
class Given:
    """A word of a command, or an option with its value.

    Attributes
    ----------
    name : str
        Of the option; empty for another word.
    value : str
        Of the option, empty for a flag; or the word.
    words : tuple of str
        As typed.
    """

    name: str
    value: str
    words: tuple[str, ...]

    @property
    def purpose(self) -> Purpose | None:
        """Purpose of a known option."""
        return OPTIONS[self.name].purpose if self.name in OPTIONS else None

    @property
    def key(self) -> tuple[str, str]:
        """What is set: two of one key exclude each other.

        >>> [one.key for one in given_in(["--unit=VB=um", "--edge", "Nr", "--law", "ap ~ V", "--correct", "E7:f*2"])]
        [('--unit', 'VB'), ('--map', 'edge'), ('--law', 'd'), ('--correct', 'E7:f')]
        """
        match OPTIONS[self.name].once if self.name in OPTIONS else None:
            case "once":
                return self.name, ""
            case "edge":
                return "--map", "edge"
            case "role":
                role, equals, _ = self.value.partition("=")
                return self.name, role.strip() if equals else ""
            case "target":
                return self.name, re.sub(r":\s*(\w+)\s*[*/+=-][^:]*$", r":\1", self.value).strip()
            case "law":
                return self.name, named_role(self.value.partition("~")[0].strip())
        return self.name, self.value


def given_in(words: Sequence[str]) -> Iterator[Given]:
    """The options and other words of a command; an unknown option has a value where a word follows.

    >>> [(one.name, one.value) for one in given_in(["a.csv", "--unit", "VB=um", "--hidden", "--tool=a b", "-"])]
    [('', 'a.csv'), ('--unit', 'VB=um'), ('--hidden', ''), ('--tool', 'a b'), ('', '-')]
    """
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if not word.startswith("-") or word in ("-", "--"):
            yield Given("", word, (word,))
            continue
        name, equals, value = word.partition("=")
        known = OPTIONS.get(name)
        followed = bool(rest) and (known is not None or not rest[0].startswith("-"))
        if equals or not followed or (known is not None and known.flag):
            yield Given(name, value, (word,))
        else:
            yield Given(name, rest[0], (word, rest.pop(0)))


def words_of(given: Iterable[Given]) -> list[str]:
    """The words of options as typed."""
    return [word for one in given for word in one.words]


def chosen(words: Sequence[str], purposes: Collection[Purpose]) -> list[str]:
    """The words of a command that are no option, and its options of these purposes.

    >>> chosen(["a.csv", "--law", "Fc ~ V", "--draws", "100", "--by=coolant"], TAKEN["compare"])
    ['a.csv', '--law', 'Fc ~ V', '--by=coolant']
    """
    return words_of(one for one in given_in(words) if not one.name or one.purpose in purposes)


def without(words: Sequence[str], *purposes: Purpose) -> list[str]:
    """The words of a command without its options of these purposes."""
    return words_of(one for one in given_in(words) if one.purpose not in purposes)


def merged(words: Sequence[str], added: Sequence[str]) -> list[str]:
    """The words of a command with further options at the end, each in place of those that set the same.

    A change of the factors of a law changes the law that is asked for already.

    >>> merged(["a.csv", "--unit", "VB=mm", "--tool", "A"], ["--unit", "VB=um"])
    ['a.csv', '--tool', 'A', '--unit', 'VB=um']
    >>> merged(["a.csv", "--law", "Fc ~ V, f"], ["--law", "Fc ~ + d", "--force"])
    ['a.csv', '--law', 'Fc ~ V, f, d', '--force']
    """
    former = {one.key: one for one in given_in(words)}
    new: dict[tuple[str, str], Given] = {}
    for one in given_in(added):
        new.setdefault(one.key, _of_changed_law(former[one.key], one) if one.key in former else one)
    return words_of([*(one for one in given_in(words) if one.key not in new), *new.values()])


def _of_changed_law(former: Given, new: Given) -> Given:
    """The option of a law with changes applied to the law that was asked for before; any other option as it is."""
    response, _, right = (part.strip() for part in new.value.partition("~"))
    if new.name != "--law" or right[:1] not in ("+", "-"):
        return new
    before = former.value.partition("~")[2].strip()
    factors = (_signed(before) | _signed(right)).values()
    if before[:1] in ("+", "-"):
        law = " ".join(f"{sign} {name}" for sign, name in factors)
    else:
        law = ", ".join(name for sign, name in factors if sign == "+")
    value = f"{response} ~ {law}" if law else new.value
    return Given(new.name, value, (new.name, value))


def _signed(right: str) -> dict[str, tuple[str, str]]:
    """Factors of the right-hand side of a law by their symbols, each with its sign and as written."""
    changes = right[:1] in ("+", "-")
    found = _CHANGE_OF_LAW.findall(right) if changes else [("+", name) for name in re.split("[,;+]", right)]
    return {named_role(name.strip()): (sign, name.strip()) for sign, name in found}


def named_role(name: str) -> str:
    """The symbol that a name denotes, or the name where it denotes none.

    >>> named_role("ap"), named_role("hardness")
    ('d', 'hardness')
    """
    return name if name in ROLES else next(iter(roles_named(name)), name)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ReadOptions(Displayable):
    """Options of reading a file of tests, as in `datasets.read_runs`.

    Attributes
    ----------
    map, units : mapping of str to str
        Column and unit of a role.
    ranges : mapping of str to tuple of float
        Low and high, or low, centre and high, of conditions in coded levels.
    constants : mapping of str to float
        Values of quantities that are constant and not in the file (``{"D": 80, "z": 4}``), in the unit of the role.
    correct : tuple of str
        Corrections of values, ``TARGET:SYMBOL*NUMBER`` or with ``/ + -``; the target is names of edges (``E07,E11``),
        ``lines 12,14-16`` or ``all``. ``all:t=cumulative`` adds times (or lengths of cut) of sub-tests up within each
        edge, in the order of the file.
    leave_out : tuple of str
        Edges or lines that are left out.
    tool, work : str or None
        Names of the pair where the file does not contain them.
    edge : str or None
        Column of the cutting edges; ``none``: no column is one, and none are inferred from the order of the tests.
    process : {"turning", "milling", "drilling", "grinding"} or None
        Process whose ranges of plausible values apply; found from the columns where None.
    decimal : {"point", "comma"} or None
    delimiter, sheet : str or None
    hidden : bool
        Read hidden rows and columns of a workbook too.
    """

    map: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    correct: tuple[str, ...] = ()
    leave_out: tuple[str, ...] = ()
    tool: str | None = None
    work: str | None = None
    edge: str | None = None
    process: Process | None = None
    decimal: DecimalMark | None = None
    delimiter: str | None = None
    sheet: str | None = None
    hidden: bool = False

    def __post_init__(self) -> None:
        for name in ("map", "units", "ranges", "constants"):
            if not isinstance(getattr(self, name), Mapping):
                raise UsageError(f"{name} {getattr(self, name)!r}: give a mapping, for instance {{'V': ...}}.")
        for name in ("tool", "work", "edge", "delimiter", "sheet"):
            if not isinstance(getattr(self, name), str | None):
                raise UsageError(f"{name} {getattr(self, name)!r}: give a text, or leave it out.")
        for name in ("correct", "leave_out"):
            given = getattr(self, name)
            if not isinstance(given, list | tuple) or not all(isinstance(text, str) for text in given):
                raise UsageError(f"{name} {given!r}: give a list of texts, for instance ['lines 12,14'].")
            object.__setattr__(self, name, tuple(given))
        if self.edge is not None and self.map.get("edge", self.edge) != self.edge:
            raise UsageError(
                f"edge {self.edge!r} and map edge={self.map['edge']!r} name different columns: give one of them."
            )
        check_choice("decimal", self.decimal, (None, *get_args(DecimalMark)))
        check_choice("process", self.process, (None, *get_args(Process)))
        check_choice("hidden", self.hidden, (True, False))
        for symbol, value in self.constants.items():
            number = isinstance(value, Real) and not isinstance(value, bool)
            if not (number and -inf < value < inf):
                raise UsageError(f"constants {symbol}={value!r}: give a number in the unit of {symbol}.")

    @property
    def named(self) -> tuple[str, ...]:
        """Headers of further columns of names, beyond those of roles: none here."""
        return ()

    @property
    def columns(self) -> dict[str, str]:
        """Column of each role that was given, the edge included, as ``map`` has them.

        >>> ReadOptions(map={"V": "col2"}, edge="Insert").columns
        {'V': 'col2', 'edge': 'Insert'}
        """
        return {**self.map, **({} if self.edge is None else {"edge": self.edge})}

    def reading(self) -> dict[str, Any]:
        """The keywords of `datasets.read_runs`."""
        return {one.name: getattr(self, one.name) for one in fields(ReadOptions)}


def check_choice(name: str, value: object, choices: tuple[object, ...]) -> None:
    """Refuse a value that is none of the choices.

    Raises
    ------
    UsageError
    """
    if not any(value is choice or (isinstance(value, str) and value == choice) for choice in choices):
        raise UsageError(f"{name} {value!r}: give one of {', '.join(map(repr, choices))}.")
