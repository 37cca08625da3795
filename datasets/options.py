"""Options of reading a file of tests, shared by `read_runs`, the analysis and the command."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import inf
from numbers import Real
from typing import Any, Literal, TypeAlias, get_args

from ..core.display import Displayable
from ..core.errors import UsageError

DecimalMark: TypeAlias = Literal["point", "comma"]
Process: TypeAlias = Literal["turning", "milling", "drilling", "grinding"]
BY_ROLE = ("--map", "--unit", "--range", "--value", "--form")  # options of the command, given once for each role
OF_ROWS = ("--correct", "--leave-out")  # and once for each target


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
